//! The tools over the picture: the picked point, measurements, the inspection mirror, the draft of points that will reflect, and the
//! handles of the gizmo. They also act on what was found under a pixel.

pub mod clicked;
pub mod clips;
pub mod facts;
pub mod measurements;
pub mod profiles;

use std::sync::Arc;

use cloud::{Bounds, Chunk, CloudLayout, PointTest};
use glam::{DVec2, DVec3};
use scene::{Mirror, Object, Projection, Shape};
use serde_json::json;

use crate::overlays::lens::to_vector;
use crate::shared::language::text;
use crate::shared::measuring::PointError;
use crate::viewer::frames::Frames;
use crate::viewer::jobs::point_errors::PointWork;
use crate::viewer::loaded::Loaded;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::objects::inspection::{self, Inspection, Pose, Ray, Surface, Target};
use crate::viewer::objects::{ObjectId, Placed};
use crate::viewer::picture::messages::{PickPurpose, PickedPoint};
use crate::viewer::requests::action::{Handles, Measuring, PictureDraft, Profiling, SavePicture};
use crate::viewer::requests::bindings::COMMAND;
use crate::viewer::requests::draft::Draft;
use crate::viewer::requests::outside::{Asked, Effect, Outside};
use crate::viewer::requests::pick::{Pick, loaded_attributes};
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;
use crate::viewer::tools::clicked::Clicked;
use crate::viewer::tools::clips::PrismDraft;
use crate::viewer::tools::facts::facts;
use crate::viewer::tools::measurements::Measurements;
use crate::viewer::tools::profiles::Profiles;

/// The size of an added mirror over the scene's radius: it spans a tenth of the scene.
const MIRROR_SIZE: f64 = 0.1;

/// The unit direction in which a place is seen.
fn sight(scene: &Scene, world: DVec3) -> DVec3 {
    let ahead = scene.camera.forward();
    match scene.settings.view.projection {
        Projection::Orthographic => ahead,
        Projection::Perspective => (world - scene.camera.eye).normalize_or(ahead),
    }
}

/// Where the eye is that sees a place: in a parallel view before that place, as far from it as from the pivot.
fn eye_before(scene: &Scene, place: DVec3) -> DVec3 {
    match scene.settings.view.projection {
        Projection::Orthographic => place - scene.camera.forward() * scene.camera.distance(),
        Projection::Perspective => scene.camera.eye,
    }
}

/// Asks how far a point may be off the surface; `sight` is the unit direction in which it is seen.
fn find_error(picked: PickedPoint, world: DVec3, sight: DVec3, loaded: &Loaded, outside: &mut Outside) {
    let Some(entry) = loaded.cloud(picked.chunk.cloud) else { return };
    let (cloud, loaded) = (entry.cloud.clone(), entry.loaded_parts());
    outside.work(Work::FindPointError(Box::new(PointWork { picked, world, sight, cloud, loaded })));
}

#[derive(Default)]
pub struct Tools {
    pub inspection: Option<Inspection>,
    pub pick: Option<Pick>,
    pub clicked: Clicked,
    pub measurements: Measurements,
    pub profiles: Profiles,
    /// The choice of points to turn into a mirror.
    pub draft: Draft,
    /// Which handles the gizmo shows, and whether one of them is grabbed.
    pub handles: Handles,
    pub handle_is_grabbed: bool,
    /// Whether the panel of lights is open. The lights are then shown in the picture.
    pub light_panel_is_open: bool,
    /// What is entered about a picture to save, while that window is open.
    pub picture_draft: Option<PictureDraft>,
    /// The polygon that is being drawn.
    pub prism: Option<PrismDraft>,
}

impl Tools {
    /// Whether clicks give corners of something: a measurement, a note, a profile, a prism.
    pub fn is_drawing(&self) -> bool {
        self.measurements.placing.is_some() || self.prism.is_some()
    }

    /// Whether a corner was given that can be taken back.
    pub fn has_corners(&self) -> bool {
        let placing = self.measurements.placing.as_ref().is_some_and(|placing| !placing.corners.is_empty());
        placing || self.prism.as_ref().is_some_and(|draft| !draft.corners.is_empty())
    }

    /// Changes how the inspection mirror is held, if there is one.
    pub fn change_pose(&mut self, change: impl FnOnce(&mut Pose)) {
        if let Some(held) = &mut self.inspection {
            change(&mut held.pose);
        }
    }

    pub fn measure(&mut self, measuring: Measuring, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        match measuring {
            Measuring::End if self.prism.is_some() => return self.end_prism(scene, outside),
            Measuring::RemoveCorner if self.prism.is_some() => return self.remove_corner(outside),
            measuring => self.measurements.act(measuring, scene, loaded, outside),
        }
        if self.measurements.placing.is_some() {
            // Clicks belong to one tool.
            (self.prism, self.inspection) = (None, None);
        }
    }

    pub fn profile(&mut self, step: Profiling, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        match step {
            Profiling::Pick(point) => {
                if let Some(world) = loaded.world_position(point) {
                    self.select(point, world, sight(scene, world), loaded, outside);
                }
            }
            Profiling::Rule(at, point) => {
                self.profiles.rule(at, point);
                let seen = point.and_then(|point| Some((point, loaded.world_position(point)?)));
                if let Some((point, world)) = seen {
                    find_error(point, world, sight(scene, world), loaded, outside);
                }
            }
            step => self.profiles.act(step, scene, loaded, outside),
        }
    }

    /// Asks for values that are not known for what is shown now, unless that changes just now.
    pub fn sync_measurements(&mut self, scene: &Scene, loaded: &Loaded, outside: &mut Outside) {
        // A profile follows its handles live.
        self.profiles.sync(scene, loaded, outside);
        if !self.handle_is_grabbed {
            self.measurements.sync(scene, loaded, outside);
        }
    }

    /// Saves the picture as a file, with the overlays that are switched on, or does a step of asking for its size and
    /// place. Returns whether one is saved.
    pub fn save_picture(
        &mut self,
        step: SavePicture,
        scene: &Scene,
        frames: &Frames,
        loaded: &Loaded,
        outside: &mut Outside,
    ) -> bool {
        let draft = match step {
            SavePicture::AtOnce => None,
            SavePicture::To(draft) => Some(draft),
            SavePicture::Ask => {
                self.picture_draft = Some(scene.picture_draft(loaded));
                return false;
            }
            SavePicture::Change(draft) => {
                self.picture_draft = draft.map(|draft| *draft);
                return false;
            }
            SavePicture::Browse(proposed) => {
                outside.push(Effect::AskPlace(Asked::Picture, proposed));
                return false;
            }
        };
        self.picture_draft = None;
        scene.save_picture(draft.as_deref(), frames, loaded, facts(scene, loaded, &self.measurements), outside)
    }

    /// Shows one kind of handles, or all of them again.
    pub fn show_handles(&mut self, handles: Handles) {
        self.handles = if self.handles == handles { Handles::All } else { handles };
    }

    /// Notes that a handle is grabbed or released.
    pub fn grab(&mut self, is_grabbed: bool, scene: &mut Scene, outside: &mut Outside) {
        if std::mem::replace(&mut self.handle_is_grabbed, is_grabbed) && !is_grabbed {
            scene.log_moved(outside);
        }
    }

    /// Begins a drag that moves the camera: on a mirror it orbits the mirror.
    pub fn begin_drag(&mut self, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        let mirror = scene.cursor().and_then(|pixel| mirror_at(pixel, scene, loaded));
        scene.begin_drag(mirror.map(|(_, at)| at), outside);
    }

    /// Whether clicks in the picture give a tool its points.
    pub fn waits_for_points(&self) -> bool {
        self.measurements.placing.is_some() || self.prism.is_some()
    }

    /// Handles a click in the picture: it belongs to the tool that is in use, or picks what is under the cursor.
    pub fn click(&mut self, scene: &mut Scene, outside: &mut Outside) {
        scene.navigation.pick_before = self.pick.clone();
        if self.measurements.placing.is_some() {
            self.measurements.ask_corner(scene, outside);
        } else if self.prism.is_some() {
            self.add_corner(scene, outside);
        } else if self.inspection.is_some() {
            self.pin_inspection(scene, outside);
        } else if scene.cursor().is_some() {
            self.clicked.ask();
            scene.pick_under_cursor(PickPurpose::Select, outside);
        }
    }

    /// Ends the tool in use, or else the selection, or else closes the card of the pick. Returns whether there was any.
    pub fn end_one(&mut self, scene: &mut Scene, outside: &mut Outside) -> bool {
        if self.inspection.take().is_some() {
            scene.navigation.camera_moved(outside.now);
        } else if self.prism.take().is_some() {
            outside.note(text!("Prism given up"));
        } else if let Some(placing) = self.measurements.placing.take() {
            outside.note(text!("The {wanted} is given up", wanted = placing.wanted.name()));
        } else {
            return scene.selected.take().is_some() || self.pick.take().is_some();
        }
        true
    }

    /// Takes in the attributes of a picked point, which is the point `record` of its file.
    pub fn on_record(
        &mut self,
        picked: PickedPoint,
        record: u64,
        result: Result<Vec<(String, String)>, String>,
        outside: &mut Outside,
    ) {
        for pick in self.pick.iter_mut().filter(|pick| pick.point == picked) {
            pick.record = Some(result.clone());
        }
        let attributes: serde_json::Map<_, _> =
            result.unwrap_or_default().into_iter().map(|(name, value)| (name, value.into())).collect();
        outside.log(json!({ "event": "record", "point": record, "attributes": attributes }));
    }

    /// Takes in how far a picked point may be off the surface.
    pub fn on_point_error(&mut self, picked: PickedPoint, error: Option<PointError>, outside: &mut Outside) {
        for pick in self.pick.iter_mut().filter(|pick| pick.point == picked) {
            pick.error = error;
        }
        self.profiles.on_point_error(picked, error);
        let (across, sight) = error.map(|error| (error.across, error.sight)).unzip();
        let is_thinned = error.map(|error| error.is_thinned);
        outside.log(json!({ "event": "point_error", "across": across, "sight": sight, "thinned": is_thinned }));
    }

    pub fn on_picked(
        &mut self,
        pixel: [u32; 2],
        purpose: PickPurpose,
        point: Option<PickedPoint>,
        scene: &mut Scene,
        loaded: &Loaded,
        outside: &mut Outside,
    ) {
        let found = point.and_then(|point| Some((point, loaded.world_position(point)?)));
        // A mirror drawn by its formula has no points, and if a mirror stands in front of the point, the user means the
        // mirror.
        let lens = scene.lens();
        let depth = |world: DVec3| lens.forward().dot(world - scene.camera.eye);
        let mirror = mirror_at(pixel, scene, loaded);
        let mirror = mirror.filter(|(_, at)| found.is_none_or(|(_, world)| depth(*at) <= depth(world)));
        let world = mirror.map(|(_, world)| world).or(found.map(|(_, world)| world));
        match (purpose, world) {
            (PickPurpose::Hover, world) => {
                scene.navigation.on_hover(pixel, world);
                scene.on_drag_point(world);
                scene.apply_pending_zoom(true, outside.now);
            }
            (PickPurpose::Pivot, Some(world)) => {
                scene.approach(world, outside.now);
                outside.log(json!({ "event": "pivot", "world": world.to_array() }));
            }
            (PickPurpose::Pivot, None) => outside.note(text!("No point there to go to")),
            (PickPurpose::Corner, _) => {
                let found = found.map(|(_, world)| world);
                self.measurements.on_corner(found, mirror.is_some(), scene, outside);
            }
            (PickPurpose::Select, _) => {
                self.clicked.answer();
                match (mirror, found) {
                    (Some((id, _)), _) => {
                        scene.selected = Some(id);
                        let name = scene.objects.mirror(id).map(|mirror| &mirror.name);
                        outside.log(json!({ "event": "selected", "mirror": name }));
                    }
                    (None, Some((point, world))) => {
                        scene.selected = None;
                        self.select(point, world, sight(scene, world), loaded, outside);
                    }
                    (None, None) => {}
                }
            }
        }
    }

    /// `sight` is the unit direction in which the point is seen.
    fn select(&mut self, point: PickedPoint, world: DVec3, sight: DVec3, loaded: &Loaded, outside: &mut Outside) {
        let Some(entry) = loaded.cloud(point.chunk.cloud) else { return };
        // A place on a mesh stands for the vertex beside it.
        let Some((part, index)) = entry.point_in_file(point.chunk.part, point.index) else { return };
        let is_beside = (part, index) != (point.chunk.part, point.index);
        let point = PickedPoint { chunk: point.chunk.cloud.chunk(part), index };
        let world = loaded.world_position(point).filter(|_| is_beside).unwrap_or(world);
        let Some(chunk) = entry.chunk(part) else { return };
        let number = chunk.first_point + index as u64;
        let is_streamed = entry.streamed.is_some();
        let source = entry.source.clone().filter(|_| !is_streamed);
        let cloud = entry.cloud.name.clone();
        let record = source.is_none().then(|| Ok(loaded_attributes(&entry.cloud, chunk, point.index)));
        let value = |runs: &codec::Runs| {
            let (start, run) = runs.range(..=number).next_back()?;
            let index = usize::try_from(number - start).ok().filter(|index| *index < run.len())?;
            Some(run.text(index))
        };
        // What is known without the file has them already.
        let added = entry.added.iter().filter(|_| record.is_none());
        let added = added.filter_map(|(name, list)| Some((name.clone(), value(list)?))).collect();
        outside.log(json!({ "event": "picked", "cloud": cloud, "point": number, "world": world.to_array() }));
        let is_moved = entry.placement().is_some();
        self.pick = Some(Pick { point, number, cloud, world, record, added, error: None, is_streamed, is_moved });
        if let Some(source) = source {
            outside.work(Work::ReadRecord { picked: point, record: number, source });
        }
        find_error(point, world, sight, loaded, outside);
    }

    /// Puts the picked point where its cloud has it now, where its error is found anew, and forgets it where the cloud
    /// is gone.
    pub fn follow_pick(&mut self, scene: &Scene, loaded: &Loaded, outside: &mut Outside) {
        let entry_of = |pick: &Pick| loaded.cloud(pick.point.chunk.cloud);
        self.pick = self.pick.take().filter(|pick| entry_of(pick).is_some());
        let Some(pick) = &mut self.pick else { return };
        let Some(world) = loaded.world_position(pick.point).filter(|world| *world != pick.world) else { return };
        (pick.world, pick.error) = (world, None);
        pick.is_moved = entry_of(pick).is_some_and(|entry| entry.placement().is_some());
        find_error(pick.point, world, sight(scene, world), loaded, outside);
    }

    pub fn copy_pick(&self, outside: &mut Outside) {
        if let Some(pick) = &self.pick {
            outside.push(Effect::Copy(pick.as_text()));
            outside.note(text!("Picked point copied"));
        }
    }

    /// Adds a mirror on the surface at the last pick, or at the pivot, and selects it.
    pub fn add_mirror(&mut self, shape: Shape, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        let up = scene.up(&loaded.clouds);
        let size = scene.bounds(&loaded.clouds).radius() * MIRROR_SIZE;
        let size = if size > 0.0 { size } else { scene.camera.distance() * MIRROR_SIZE };
        let picked = self.pick.as_ref().map(|pick| (pick.world, loaded.normal_at(pick.point)));
        let (point, normal) = picked.unwrap_or((scene.camera.pivot, None));
        let to_eye = eye_before(scene, point) - point;
        let normal = normal.map_or(up, |normal| if normal.dot(to_eye) < 0.0 { -normal } else { normal });
        let name = shape.name().to_owned();
        let mirror = Mirror { name, ..Mirror::standing(shape, point, normal, up, size) };
        let id = scene.next_object_id();
        scene.place(id, Object::Mirror(mirror), outside);
    }

    pub fn toggle_inspection(&mut self, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        if self.inspection.take().is_some() {
            scene.navigation.camera_moved(outside.now);
            return;
        }
        if !loaded.clouds.is_empty() {
            let id = scene.next_object_id();
            self.inspection = Some(Inspection::new(id));
            scene.selected = None;
            let told = text!(
                "Inspection mirror: {COMMAND}+wheel distance, {COMMAND}+Shift+wheel tilt, click pins it",
                COMMAND
            );
            outside.note(told);
        }
    }

    /// Leaves the inspection mirror where it is, as a mirror of the scene.
    pub fn pin_inspection(&mut self, scene: &mut Scene, outside: &mut Outside) {
        let Some(mut held) = self.inspection.take() else { return };
        if let Some(mirror) = held.mirror.take() {
            scene.place(held.id, Object::Mirror(mirror), outside);
        }
    }

    /// Keeps the inspection mirror at the cursor; called every frame of the window.
    pub fn follow_cursor(&mut self, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        let (up, cursor) = (scene.up(&loaded.clouds), scene.cursor());
        let Some(held) = &mut self.inspection else { return };
        let before = held.mirror.clone();
        held.update(None, |place| eye_before(scene, place), up);
        let is_changed = held.mirror != before;
        if is_changed {
            scene.navigation.camera_moved(outside.now);
        }
        let Some(pixel) = cursor else { return };
        let Some(held) = &mut self.inspection else { return };
        if held.asked.is_some() || held.known == Some(pixel) {
            return;
        }
        held.asked = Some(pixel);
        let visible = loaded.clouds.iter().filter(|entry| entry.is_visible);
        let test = scene.objects.test();
        let targets = |entry: &CloudEntry| {
            let (test, chunks) = (Arc::new(entry.cloud.test(&test)), entry.cloud.chunks.iter().cloned());
            let target = |(chunk, (_, bounds))| Target { chunk, bounds, test: test.clone() };
            chunks.zip(entry.chunk_bounds()).map(target).collect::<Vec<_>>()
        };
        let ray = sight_line(scene, pixel, visible.flat_map(targets).collect());
        outside.work(Work::Cast(ray));
    }

    /// Moves the inspection mirror to the surface that a sight line met. If it met none, the mirror stays where it was.
    pub fn on_surface(&mut self, surface: Option<Surface>, scene: &mut Scene, loaded: &Loaded, outside: &mut Outside) {
        let up = scene.up(&loaded.clouds);
        let Some(held) = &mut self.inspection else { return };
        held.known = held.asked.take();
        if surface.is_some() {
            held.update(surface, |place| eye_before(scene, place), up);
            scene.navigation.camera_moved(outside.now);
        }
    }
}

/// The nearest mirror under a pixel, and the place where the pixel meets it, by the points sampled on the mirrors.
fn mirror_at(pixel: [u32; 2], scene: &Scene, loaded: &Loaded) -> Option<(ObjectId, DVec3)> {
    let lens = scene.lens();
    // What hides points of clouds hides no mirror.
    let everything = Arc::new(PointTest::default().of(&CloudLayout::default()));
    let hit = |placed: &Placed| {
        let sample = loaded.samples.of.get(&placed.id)?;
        let target = |(chunk, bounds): &(Chunk, Bounds)| Target {
            chunk: chunk.clone(),
            bounds: *bounds,
            test: everything.clone(),
        };
        let ray = sight_line(scene, pixel, sample.chunks.iter().map(target).collect());
        Some((placed.id, inspection::cast(&ray)?.position))
    };
    let depth = |world: DVec3| lens.forward().dot(world - scene.camera.eye);
    let hits = scene.objects.mirrors.iter().filter_map(hit);
    hits.min_by(|a, b| depth(a.1).total_cmp(&depth(b.1)))
}

/// The radius of a sight line in pixels. It is the same as when a point is picked.
const CAST_RADIUS: f64 = 4.0;

/// Returns the line of sight through a pixel.
fn sight_line(scene: &Scene, pixel: [u32; 2], targets: Vec<Target>) -> Ray {
    let lens = scene.lens();
    let pixel = to_vector(pixel);
    let (origin, direction) = lens.ray(pixel);
    let (_, beside) = lens.ray(pixel + DVec2::X * CAST_RADIUS);
    let is_parallel = scene.settings.view.projection == Projection::Orthographic;
    let width = lens.units_per_pixel(scene.camera.pivot).filter(|_| is_parallel).unwrap_or(0.0) * CAST_RADIUS;
    // A parallel view shows what is behind its eye, too.
    let depth =
        |target: &Target| (target.bounds.center() - origin).dot(direction) - 2.0 * target.bounds.radius() - width;
    let before = targets.iter().map(depth).fold(0.0, f64::min);
    let origin = if is_parallel { origin + direction * before } else { origin };
    Ray { origin, direction, spread: direction.distance(beside), width, targets }
}

#[cfg(test)]
mod tests {
    use scene::Camera;

    use super::*;
    use crate::viewer::session::Session;

    #[test]
    fn in_a_parallel_view_a_surface_behind_the_eye_is_met_and_is_seen_from_before_it() {
        let mut session = Session::with_two_points();
        let scene = &mut session.scene;
        (scene.view_size, scene.camera) = ([64, 48], Camera::from_eye(DVec3::ZERO, DVec3::X * 10.0, DVec3::Z));
        let at = |place: i32| (f64::from(place) * 0.1 - 2.0) as f32;
        let chunk = Chunk::new(0, DVec3::ZERO, (0..1600).map(|i| [-3.0, at(i % 40), at(i / 40)]).collect());
        let test = Arc::new(PointTest::default().of(&CloudLayout::default()));
        let wall = Target { bounds: chunk.bounds(), chunk, test: test.clone() };
        // Another part of the cloud lies far behind the eye, and beside the line.
        let chunk = Chunk::new(1600, DVec3::ZERO, vec![[-4000.0, 90.0, 0.0]]);
        let far = Target { bounds: chunk.bounds(), chunk, test };
        for (projection, is_met) in [(Projection::Orthographic, true), (Projection::Perspective, false)] {
            scene.settings.view.projection = projection;
            let met = inspection::cast(&sight_line(scene, [32, 24], vec![far.clone(), wall.clone()]));
            let (place, seen_from) = (met.map(|met| met.position), met.map(|met| eye_before(scene, met.position)));
            let is_near = |found: Option<DVec3>, x: f64| {
                found.is_some_and(|found| (found.x - x).abs() < 1e-3 && DVec2::new(found.y, found.z).length() < 0.2)
            };
            assert_eq!((is_near(place, -3.0), is_near(seen_from, -13.0)), (is_met, is_met), "{place:?} {seen_from:?}");
        }
    }
}
