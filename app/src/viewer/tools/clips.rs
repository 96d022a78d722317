//! Adds clip volumes: around everything, around the last pick, around what is seen, or as a prism whose polygon is
//! drawn over the picture; and sets the filters.

use cloud::Bounds;
use glam::{DVec2, DVec3};
use scene::{Clip, ClipShape, Object, Prism, Projection};
use serde_json::json;

use crate::overlays::lens::to_vector;
use crate::shared::language::{english, text, translated};
use crate::viewer::loaded::Loaded;
use crate::viewer::requests::action::Clipping;
use crate::viewer::requests::outside::Outside;
use crate::viewer::scene::Scene;
use crate::viewer::tools::Tools;

/// A polygon that is being drawn.
pub struct PrismDraft {
    /// The corners so far, in a plane across the view.
    pub corners: Vec<DVec3>,
    /// A place in that plane.
    middle: DVec3,
    direction: DVec3,
    /// The eye, if the view is in perspective.
    eye: Option<DVec3>,
}

/// What to do while a polygon is drawn.
pub const PRISM_HINT: &str =
    english!("Click the corners of the prism; a click on the first one or Enter closes it, Backspace takes one back");

/// The edge of the box about a pick, as a share of the picture's height.
const PICK_SHARE: f64 = 0.3;
/// The number of points that are looked at to find the box about what is seen.
const LOOKED_AT: u64 = 200_000;
/// The distance in pixels within which a click on the first corner closes the polygon.
const CLOSING: f64 = 9.0;

impl Tools {
    pub fn clip(&mut self, clipping: Clipping, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        let (shape, bounds) = match clipping {
            Clipping::AroundAll(shape) => (shape, scene.bounds(&loaded.clouds)),
            Clipping::AroundPick => match &self.pick {
                Some(pick) => (ClipShape::Box, around_pick(pick.world, scene)),
                None => return outside.note(text!("Pick a point first: the box goes around it")),
            },
            Clipping::AroundView => (ClipShape::Box, seen(scene, loaded)),
            Clipping::DrawPrism => return self.draw_prism(scene, loaded, outside),
            Clipping::EndPrism => return self.end_prism(scene, outside),
            Clipping::Filter(filters) => {
                scene.objects.visibility.filters = filters;
                return scene.navigation.camera_moved(outside.now);
            }
        };
        if bounds.is_empty() {
            return outside.note(text!("There is nothing to clip"));
        }
        let id = scene.next_object_id();
        scene.place(id, Object::Clip(Clip::around(shape, bounds)), outside);
    }

    fn draw_prism(&mut self, scene: &Scene, loaded: &Loaded, outside: &mut Outside) {
        if self.prism.take().is_some() || loaded.clouds.is_empty() {
            return;
        }
        let is_parallel = scene.settings.view.projection == Projection::Orthographic;
        let eye = (!is_parallel).then_some(scene.camera.eye);
        let (middle, direction) = (scene.camera.pivot, scene.lens().forward());
        self.measurements.placing = None;
        self.prism = Some(PrismDraft { corners: Vec::new(), middle, direction, eye });
        outside.note(translated(PRISM_HINT));
    }

    /// Adds a corner under the cursor to the polygon, or closes it there.
    pub fn add_corner(&mut self, scene: &mut Scene, outside: &mut Outside) {
        let (Some(draft), Some(pixel)) = (&mut self.prism, scene.cursor()) else { return };
        let (lens, pixel) = (scene.lens(), to_vector(pixel));
        let is_near = |place: DVec2| place.distance(pixel) < CLOSING;
        if draft.corners.len() >= 3 && draft.corners.first().and_then(|first| lens.project(*first)).is_some_and(is_near)
        {
            return self.end_prism(scene, outside);
        }
        let (origin, direction) = lens.ray(pixel);
        let depth = (draft.middle - origin).dot(draft.direction) / direction.dot(draft.direction);
        if depth.is_finite() && depth > 0.0 {
            draft.corners.push(origin + direction * depth);
            outside.log(json!({ "event": "corner", "corners": draft.corners.len() }));
        }
    }

    /// Takes the last corner of the polygon back, if there is any.
    pub fn remove_corner(&mut self, outside: &mut Outside) {
        if let Some(draft) = self.prism.as_mut().filter(|draft| !draft.corners.is_empty()) {
            draft.corners.pop();
            outside.log(json!({ "event": "corner", "corners": draft.corners.len() }));
        }
    }

    pub fn end_prism(&mut self, scene: &mut Scene, outside: &mut Outside) {
        if self.prism.as_ref().is_some_and(|draft| draft.corners.len() < 3) {
            return outside.note(text!("A prism needs three corners"));
        }
        let Some(PrismDraft { corners, direction, eye, .. }) = self.prism.take() else { return };
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let points = corners.iter().map(|corner| *corner - middle).collect();
        let shape = ClipShape::Prism(Prism { points, direction, eye: eye.map(|eye| eye - middle) });
        let around = Clip::around(shape, Bounds { min: middle, max: middle });
        let id = scene.next_object_id();
        scene.place(id, Object::Clip(Clip { size: DVec3::ONE, ..around }), outside);
    }
}

fn around_pick(world: DVec3, scene: &Scene) -> Bounds {
    let units = scene.lens().units_per_pixel(world).unwrap_or(0.0);
    let half = 0.5 * PICK_SHARE * units * f64::from(scene.view_size[1]);
    Bounds { min: world - half, max: world + half }
}

/// The bounds of the shown points in the picture, hidden ones behind others too, by an even sample of them.
fn seen(scene: &Scene, loaded: &Loaded) -> Bounds {
    let (lens, test) = (scene.lens(), scene.objects.test());
    let [width, height] = scene.view_size.map(f64::from);
    let is_in = |at: DVec2| at.x >= 0.0 && at.y >= 0.0 && at.x <= width && at.y <= height;
    let visible = || loaded.clouds.iter().filter(|entry| entry.is_visible);
    let step = (visible().map(|entry| entry.points).sum::<u64>() / LOOKED_AT).max(1) as usize;
    let mut bounds = Bounds::EMPTY;
    for entry in visible() {
        let test = entry.cloud.test(&test);
        for chunk in &entry.cloud.chunks {
            for index in (0..chunk.len()).step_by(step).filter(|index| test.shows(chunk, *index)) {
                let place = chunk.position(index);
                if lens.project(place).is_some_and(is_in) {
                    bounds.include(place);
                }
            }
        }
    }
    bounds
}
