//! What is looked at: the parameters, the objects and the camera, with what was before them. What a person changes of it can be
//! undone.

use std::time::{Duration, Instant};

use cloud::Bounds;
use glam::{DVec2, DVec3};
use param::Choice as _;
use render::MOST_LIGHTS;
use scene::{Camera, CameraPath, ColorBy, Lighting, Mirror, Object, Projection, Settings, SpotLight, StandardView};
use serde_json::json;
use world::{CloudKey, mirrors};

use crate::viewer::action::{Action, Mode};
use crate::viewer::history::History;
use crate::viewer::input::lens::{Lens, to_vector};
use crate::viewer::input::navigation::Navigation;
use crate::viewer::loaded::clouds::CloudEntry;
use crate::viewer::messages::Level;
use crate::viewer::objects::{ObjectId, Objects, Origin, Placed, PlacedLight, spot, unnamed};
use crate::viewer::outside::Outside;
use crate::viewer::tools::inspection::{Ray, Target};
use crate::viewer::window::render_thread::{Command, PickPurpose};

/// Radians per pixel of the mouse: a half turn takes 630 pixels, about half a window.
const RADIANS_PER_PIXEL: f64 = 0.005;
/// Distance that is left after a notch of the wheel.
const ZOOM_PER_NOTCH: f64 = 0.85;
/// Longest wait for the point under the cursor: a zoom that starts later than this feels stuck.
const ZOOM_PATIENCE: Duration = Duration::from_millis(120);
/// Growth of splats and of the field of view per notch: seven notches double.
pub const STEP: f32 = 1.1;
/// Pixels about the cursor that its sight line takes in: as when a point is picked.
const CAST_RADIUS: f64 = 4.0;

pub struct Scene {
    pub settings: Settings,
    pub objects: Objects,
    /// A mirror or a light.
    pub selected: Option<ObjectId>,
    pub camera: Camera,
    /// Someone chose the camera: loading no longer moves it.
    pub camera_is_placed: bool,
    pub mode: Mode,
    pub navigation: Navigation,
    pub history: History,
    /// What lit the points before the data's own colours were asked for.
    pub lit_by: Lighting,
    /// Pixels of the picture.
    pub view_size: [u32; 2],
    /// Ways of the camera that scene files bring.
    pub paths: Vec<CameraPath>,
    next_object: u32,
}

impl Scene {
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            objects: Objects::default(),
            selected: None,
            camera: Camera::looking(DVec3::ZERO, DVec3::ONE, 5.0, DVec3::Z),
            camera_is_placed: false,
            mode: Mode::Orbit,
            navigation: Navigation::default(),
            history: History::default(),
            lit_by: Lighting::Auto,
            view_size: [1, 1],
            paths: Vec::new(),
            next_object: 0,
        }
    }

    pub fn undo(&mut self, outside: &mut Outside) {
        let done = self.history.undo(&mut self.settings, &mut self.objects, &mut self.camera);
        self.after_history(done, "Nothing to undo", outside);
    }

    pub fn redo(&mut self, outside: &mut Outside) {
        let done = self.history.redo(&mut self.settings, &mut self.objects, &mut self.camera);
        self.after_history(done, "Nothing to redo", outside);
    }

    pub fn next_object_id(&mut self) -> ObjectId {
        self.next_object += 1;
        ObjectId(self.next_object - 1)
    }

    /// Changes the objects in one step of undo.
    pub fn edit_objects(&mut self, now: Instant, change: impl FnOnce(&mut Objects)) {
        self.history.settle(&self.settings, &self.objects);
        change(&mut self.objects);
        self.history.settle(&self.settings, &self.objects);
        self.navigation.camera_moved(now);
    }

    /// Changes the objects in a way that is no step of undo: something came or went with a file.
    pub fn rewrite_objects(&mut self, change: impl Fn(&mut Objects)) {
        self.history.settle(&self.settings, &self.objects);
        change(&mut self.objects);
        self.history.rewrite(change);
    }

    /// A mirror that a file or a built-in scene brings.
    pub fn bring_mirror(&mut self, mirror: Mirror, input: Option<String>, outside: &mut Outside) -> ObjectId {
        let id = self.next_object_id();
        let mirror = Mirror { name: self.objects.free_name(&mirror.name, None), ..mirror };
        outside.log(json!({ "event": "mirror", "name": mirror.name }));
        self.rewrite_objects(|objects| {
            objects.mirrors.push(Placed { id, mirror: mirror.clone(), input: input.clone() });
        });
        id
    }

    /// Lights that files and a built-in scene bring, less those that are there already.
    pub fn bring_lights(&mut self, lights: impl Iterator<Item = (SpotLight, Origin)>, outside: &mut Outside) {
        let mut named = Objects { lights: self.objects.lights.clone(), ..Objects::default() };
        let mut brought: Vec<PlacedLight> = Vec::new();
        for (light, origin) in lights {
            let placed = PlacedLight { id: self.next_object_id(), name: named.free_light_name("spot"), light, origin };
            named.lights.push(placed.clone());
            brought.push(placed);
        }
        if brought.is_empty() {
            return;
        }
        self.rewrite_objects(|objects| {
            // A guess stands in for lights that are not there.
            objects.lights.retain(|other| other.origin != Origin::Guess);
            let known = objects.lights.clone();
            let is_new = |placed: &&PlacedLight| known.iter().all(|other| other.light != placed.light);
            objects.lights.extend(brought.iter().filter(is_new).cloned());
        });
        self.warn_of_dark_lights(outside);
    }

    /// Says so after lights came of which not all shine.
    pub fn warn_of_dark_lights(&mut self, outside: &mut Outside) {
        if self.objects.lights.len() > MOST_LIGHTS {
            outside.say(Level::Warning, format!("Only the first {MOST_LIGHTS} lights shine"));
        }
    }

    /// Adds an object in one step of undo, and selects it. A light shines then.
    pub fn place(&mut self, id: ObjectId, object: Object, outside: &mut Outside) {
        let kind = object.kind();
        if self.objects.count(kind) >= kind.most {
            return outside.note(format!("There are {} {}s, and no room for more", kind.most, kind.name));
        }
        let (position, is_light) = (object.places()[0].to_array(), matches!(object, Object::Light(_)));
        self.history.settle(&self.settings, &self.objects);
        if is_light && self.settings.light.by != Lighting::Auto {
            self.settings.light.by = Lighting::Lights;
        }
        self.objects.add(id, object);
        self.history.settle(&self.settings, &self.objects);
        let name = self.objects.get(id).map(|(name, _)| name);
        outside.log(json!({ "event": kind.name, "name": name, "position": position }));
        self.navigation.camera_moved(outside.now);
        self.selected = Some(id);
        if is_light {
            self.warn_of_dark_lights(outside);
        }
    }

    pub fn duplicate(&mut self, outside: &mut Outside) {
        let selected = self.selected.and_then(|id| self.objects.get(id));
        if let Some((_, object)) = selected {
            let (id, copy) = (self.next_object_id(), object.beside(self.camera.right()));
            self.place(id, copy, outside);
        }
    }

    /// Adds a spot light where the eye is.
    pub fn add_spot(&mut self, outside: &mut Outside) {
        let light = spot(self.camera.eye, self.camera.pivot, self.settings.view.field_of_view);
        let id = self.next_object_id();
        self.place(id, Object::Light(light), outside);
    }

    pub fn change_object(&mut self, id: ObjectId, changed: Object, now: Instant) {
        let is_renamed_alone = match (&changed, self.objects.mirror(id)) {
            (Object::Mirror(changed), Some(mirror)) => unnamed(changed) == unnamed(mirror),
            _ => false,
        };
        self.objects.set(id, changed);
        if !is_renamed_alone {
            self.navigation.camera_moved(now);
        }
    }

    /// The hand has let go of the selected object.
    pub fn log_moved(&mut self, outside: &mut Outside) {
        let Some((name, object)) = self.selected.and_then(|id| self.objects.get(id)) else { return };
        let places: Vec<[f64; 3]> = object.places().iter().map(DVec3::to_array).collect();
        let event = format!("{}_moved", object.kind().name);
        let event = json!({ "event": event, "name": name, "position": places[0], "target": places.get(1) });
        outside.log(event);
    }

    /// Shows or hides classes in all clouds, in one step of undo.
    pub fn show_classes(&mut self, classes: impl IntoIterator<Item = u8>, is_shown: bool, now: Instant) {
        self.edit_objects(now, |objects| {
            let hidden = &mut objects.visibility.hidden_classes;
            for class in classes {
                if is_shown {
                    hidden.remove(&class);
                } else {
                    hidden.insert(class);
                }
            }
        });
    }

    /// What widgets cannot give is not set.
    pub fn set_parameter(&mut self, key: &str, value: param::Value, now: Instant) {
        let Some((group, name)) = key.split_once('.') else { return };
        let group = self.settings.groups_mut().into_iter().find(|known| known.group().name == group);
        if let Some(Err(error)) = group.map(|group| group.set(name, value)) {
            tracing::warn!("{error}");
        }
        if self.navigation.is_held() {
            // A slider that is dragged moves the picture as a camera does.
            self.navigation.camera_moved(now);
        }
    }

    pub fn light_by(&mut self, by: Lighting, outside: &mut Outside) {
        let before = &mut self.settings.light.by;
        if *before != Lighting::Colors {
            self.lit_by = *before;
        }
        *before = by;
        let name = by.name();
        outside.note(if by == Lighting::Colors { "Data colours, no light".into() } else { format!("Light: {name}") });
    }

    pub fn color_by(&mut self, by: ColorBy, clouds: &[CloudEntry], outside: &mut Outside) {
        self.settings.color.by = by;
        if by == ColorBy::Attribute && self.settings.color.attribute.is_empty() {
            let first = clouds.iter().flat_map(|entry| &entry.cloud.attributes).next();
            self.settings.color.attribute = first.map_or(String::new(), |attribute| attribute.name.clone());
        }
        outside.note(format!("Colour: {}", by.name()));
    }

    /// Goes back to a setting: one step of undo.
    pub fn return_to(&mut self, settings: Settings, outside: &mut Outside) {
        self.history.settle(&self.settings, &self.objects);
        self.settings = settings;
        self.history.settle(&self.settings, &self.objects);
        outside.log(json!({ "event": "returned" }));
    }

    pub fn after_history(&mut self, done: bool, otherwise: &str, outside: &mut Outside) {
        if done {
            self.navigation.camera_moved(outside.now);
            let Objects { mirrors, lights, .. } = &self.objects;
            outside.log(json!({ "event": "history", "mirrors": mirrors.len(), "lights": lights.len() }));
        } else {
            outside.note(otherwise);
        }
    }

    /// Moves the camera at once, perhaps with other parameters: one step of undo.
    pub fn jump(&mut self, now: Instant, settings: Settings, camera: Camera) {
        self.history.before_jump(&self.settings, &self.objects, self.camera);
        self.settings = settings;
        self.camera = camera;
        self.camera_is_placed = true;
        self.history.after_jump(&self.settings, &self.objects);
        self.navigation.camera_moved(now);
    }

    pub fn lens(&self) -> Lens {
        Lens::new(&self.camera, &self.settings.view, self.view_size)
    }

    pub fn aspect(&self) -> f64 {
        f64::from(self.view_size[0].max(1)) / f64::from(self.view_size[1].max(1))
    }

    /// Of what is visible, without stray points.
    pub fn bounds(&self, clouds: &[CloudEntry]) -> Bounds {
        let of = |entry: &CloudEntry| entry.figures.as_ref().map_or(entry.bounds, |figures| figures.bounds);
        let visible = clouds.iter().filter(|entry| entry.is_visible && entry.points > 0);
        let mut bounds = visible.fold(Bounds::EMPTY, |all, entry| all.union(of(entry)));
        if !bounds.is_empty() {
            self.objects
                .mirrors
                .iter()
                .flat_map(|placed| mirrors::outline(&placed.mirror))
                .for_each(|p| bounds.include(p));
        }
        bounds
    }

    pub fn up(&self, clouds: &[CloudEntry]) -> DVec3 {
        match self.settings.view.up {
            scene::UpAxis::Y => DVec3::Y,
            scene::UpAxis::Z => DVec3::Z,
            scene::UpAxis::Auto => clouds.first().map_or(DVec3::Z, |entry| entry.up),
        }
    }

    /// What sticks out furthest of the visible clouds: what framing has to keep in the picture.
    pub fn outline(&self, clouds: &[CloudEntry]) -> Vec<DVec3> {
        let visible = clouds.iter().filter(|entry| entry.is_visible);
        let of = |entry: &CloudEntry| match &entry.figures {
            Some(figures) => figures.outline.clone(),
            None if entry.bounds.is_empty() => Vec::new(),
            None => entry.bounds.corners().to_vec(),
        };
        let mirrors = self.objects.mirrors.iter().flat_map(|placed| mirrors::outline(&placed.mirror));
        visible.flat_map(of).chain(mirrors).collect()
    }

    pub fn framed(&self, outline: &[DVec3], view: StandardView, clouds: &[CloudEntry]) -> Camera {
        Camera::framing(outline, view, self.up(clouds), self.settings.view.field_of_view, self.aspect())
    }

    /// Shows everything unless someone has chosen the camera: the clouds' outlines, or `bounds` while none is known.
    pub fn frame_while_unplaced(&mut self, bounds: Bounds, clouds: &[CloudEntry]) {
        if self.camera_is_placed {
            return;
        }
        if clouds.iter().any(|entry| entry.is_visible && entry.figures.is_some()) {
            self.camera = self.framed(&self.outline(clouds), StandardView::Isometric, clouds);
        } else if !bounds.is_empty() {
            self.camera = self.framed(&bounds.corners(), StandardView::Isometric, clouds);
        }
    }

    pub fn frame_all(&mut self, clouds: &[CloudEntry], now: Instant) {
        if !self.bounds(clouds).is_empty() {
            let mut camera = self.camera;
            camera.frame(&self.outline(clouds), self.settings.view.field_of_view, self.aspect());
            self.jump(now, self.settings.clone(), camera);
        }
    }

    pub fn look_from(&mut self, view: StandardView, clouds: &[CloudEntry], now: Instant) {
        if !self.bounds(clouds).is_empty() {
            let camera = self.framed(&self.outline(clouds), view, clouds);
            self.jump(now, self.settings.clone(), camera);
        }
    }

    /// Moves the camera to `eye`, looking at `pivot`.
    pub fn look_along(&mut self, eye: DVec3, pivot: DVec3, now: Instant) {
        let camera = Camera::looking(pivot, eye - pivot, eye.distance(pivot), self.camera.up);
        self.jump(now, self.settings.clone(), camera);
    }

    /// Pixel under the cursor.
    pub fn cursor(&self) -> Option<[u32; 2]> {
        self.navigation.cursor.map(|(pixel, _)| pixel)
    }

    /// The camera was moved by hand.
    pub fn camera_moved_by_hand(&mut self, now: Instant) {
        self.camera_is_placed = true;
        self.navigation.camera_moved(now);
    }

    /// Drags the picture by points of the window; by pixels of the picture to pan.
    pub fn drag_camera(&mut self, drag: &Action, now: Instant) {
        let (Action::Orbit(delta) | Action::Look(delta) | Action::Pan(delta)) = drag else { return };
        if *delta != DVec2::ZERO {
            let angles = *delta * -RADIANS_PER_PIXEL;
            match drag {
                Action::Orbit(_) => self.camera.orbit(angles.x, angles.y),
                Action::Look(_) => self.camera.look(angles.x, angles.y),
                _ => {
                    let height = f64::from(self.view_size[1].max(1));
                    self.camera.pan(*delta, self.settings.view.field_of_view, height);
                }
            }
            self.camera_moved_by_hand(now);
        }
        if !matches!(drag, Action::Look(_)) {
            self.navigation.show_pivot(now);
        }
    }

    /// World units right, up, forward.
    pub fn travel(&mut self, way: DVec3, now: Instant) {
        self.camera.fly(way);
        self.camera_moved_by_hand(now);
    }

    pub fn ask_hover(&mut self, outside: &mut Outside) {
        if let Some(pixel) = self.cursor() {
            self.navigation.asked = Some(pixel);
            outside.render(Command::Pick { pixel, purpose: PickPurpose::Hover });
        }
    }

    /// Turns of the wheel: done at once if the point under the cursor is known, else when it is.
    pub fn zoom(&mut self, notches: f32, outside: &mut Outside) {
        self.navigation.pending_zoom += notches;
        self.navigation.zoom_since.get_or_insert(outside.now);
        if self.navigation.anchor().is_none() && self.navigation.asked.is_none() {
            self.ask_hover(outside);
        }
        self.apply_pending_zoom(false, outside.now);
    }

    /// `at_once`: even if the point under the cursor is not known.
    pub fn apply_pending_zoom(&mut self, at_once: bool, now: Instant) {
        let anchor = self.navigation.anchor();
        if self.navigation.zoom_since.is_none() || !at_once && anchor.is_none() {
            return;
        }
        let notches = std::mem::take(&mut self.navigation.pending_zoom);
        self.navigation.zoom_since = None;
        let on_plane = || self.cursor().map_or(self.camera.pivot, |pixel| self.lens().on_pivot_plane(to_vector(pixel)));
        let toward = anchor.flatten().unwrap_or_else(on_plane);
        self.camera.zoom_toward(toward, ZOOM_PER_NOTCH.powf(f64::from(notches)));
        let hovered = self.navigation.hovered;
        self.camera_moved_by_hand(now);
        // The point stays under the cursor: that is what zooming toward it means.
        self.navigation.hovered = hovered.map(|(pixel, world)| (self.cursor().unwrap_or(pixel), world));
    }

    /// Zooms toward the plane of the pivot where the point under the cursor has been waited for long enough. Returns when to look
    /// again.
    pub fn end_zoom_wait(&mut self, now: Instant) -> Option<Duration> {
        self.cursor()?;
        let waited = now.saturating_duration_since(self.navigation.zoom_since?);
        let left = ZOOM_PATIENCE.checked_sub(waited).filter(|left| !left.is_zero());
        self.apply_pending_zoom(left.is_none(), now);
        left.filter(|_| self.navigation.zoom_since.is_some())
    }

    /// Whether the wheel steers flight.
    pub fn is_flying(&self) -> bool {
        self.mode == Mode::Fly
    }

    /// What a pixel looks along.
    pub fn sight_line(&self, pixel: [u32; 2], targets: Vec<Target>) -> Ray {
        let lens = self.lens();
        let pixel = to_vector(pixel);
        let (origin, direction) = lens.ray(pixel);
        let (_, beside) = lens.ray(pixel + DVec2::X * CAST_RADIUS);
        let is_parallel = self.settings.view.projection == Projection::Orthographic;
        let width = lens.units_per_pixel(self.camera.pivot).filter(|_| is_parallel).unwrap_or(0.0) * CAST_RADIUS;
        let test = self.objects.visibility.test();
        Ray { origin, direction, spread: direction.distance(beside), width, targets, test }
    }

    /// Does what is asked of the scene alone; gives back what is asked of other parts.
    pub fn act(&mut self, action: Action, clouds: &[CloudEntry], outside: &mut Outside) -> Option<Action> {
        match action {
            Action::Orbit(_) | Action::Look(_) | Action::Pan(_) => self.drag_camera(&action, outside.now),
            Action::Zoom(notches) => self.zoom(notches, outside),
            Action::FieldOfView(notches) => {
                let view = &self.settings.view;
                self.settings.view.field_of_view = scaled(view, "field_of_view", view.field_of_view, notches);
            }
            Action::FlySpeed(notches) => {
                // Six doublings either way: from an ant's pace to a jet's.
                self.navigation.speed = (self.navigation.speed + notches * 0.5).clamp(-6.0, 6.0);
                outside.note(format!("Speed × {:.2}", self.navigation.speed.exp2()));
            }
            Action::Travel(way) => self.travel(way, outside.now),
            Action::PivotHere => self.pick_under_cursor(PickPurpose::Pivot, outside),
            Action::FrameAll => self.frame_all(clouds, outside.now),
            Action::FrameCloud(key) => self.frame_cloud(key, clouds, outside.now),
            Action::ToggleMode => {
                self.mode = if self.mode == Mode::Orbit { Mode::Fly } else { Mode::Orbit };
                let text = if self.is_flying() { "Fly: drag to look, W A S D Q E to move" } else { "Orbit" };
                outside.note(text);
            }
            Action::LookFrom(view) => self.look_from(view, clouds, outside.now),
            Action::LookAlong { eye, pivot } => self.look_along(eye, pivot, outside.now),
            Action::ToggleProjection => {
                let projection = &mut self.settings.view.projection;
                *projection = match projection {
                    Projection::Perspective => Projection::Orthographic,
                    Projection::Orthographic => Projection::Perspective,
                };
            }
            Action::PointAt(pixel) => self.navigation.point_at(pixel, outside.now),
            Action::AskHover => self.ask_hover(outside),
            Action::SetParameter { key, value } => self.set_parameter(&key, value, outside.now),
            Action::ChangeSettings(settings) => self.settings = *settings,
            Action::PointSize(notches) => {
                self.settings.splat.size = scaled(&self.settings.splat, "size", self.settings.splat.size, notches);
            }
            Action::ColorBy(by) => self.color_by(by, clouds, outside),
            Action::ShowClasses(classes, is_shown) => self.show_classes(classes, is_shown, outside.now),
            Action::ToggleEdl => {
                let strength = &mut self.settings.edl.strength;
                *strength = if *strength > 0.0 { 0.0 } else { scene::Edl::default().strength };
            }
            Action::ToggleLight => {
                let is_lit = self.settings.light.by != Lighting::Colors;
                self.light_by(if is_lit { Lighting::Colors } else { self.lit_by }, outside);
            }
            Action::NextLight => {
                let next = (self.settings.light.by as u32 + 1) % Lighting::NAMES.len() as u32;
                self.light_by(Lighting::from_index(next).unwrap_or(Lighting::Auto), outside);
            }
            Action::LightBy(by) => self.light_by(by, outside),
            Action::Undo => self.undo(outside),
            Action::Redo => self.redo(outside),
            Action::Paste(text) => self.paste_view(&text, outside),
            Action::AddSpot => self.add_spot(outside),
            Action::Select(id) => self.selected = id,
            Action::ChangeObject(id, object) => self.change_object(id, *object, outside.now),
            Action::Duplicate => self.duplicate(outside),
            Action::Delete => {
                if let Some(id) = self.selected.take() {
                    self.edit_objects(outside.now, |objects| objects.remove(id));
                }
            }
            Action::Mark(marking) => self.edit_objects(outside.now, |objects| objects.markings.push(*marking)),
            Action::Unmark(marking) => {
                self.edit_objects(outside.now, |objects| {
                    let index = objects.markings.iter().position(|known| *known == *marking);
                    index.map(|index| objects.markings.remove(index));
                });
            }
            Action::ReturnTo(settings) => self.return_to(*settings, outside),
            of_others => return Some(of_others),
        }
        None
    }

    /// Looks at a cloud as at what is looked at now.
    fn frame_cloud(&mut self, key: CloudKey, clouds: &[CloudEntry], now: Instant) {
        let figures = clouds.iter().find(|entry| entry.key == key).and_then(|entry| entry.figures.as_ref());
        let outline = figures.map(|figures| figures.outline.clone());
        if let Some(outline) = outline.filter(|outline| !outline.is_empty()) {
            let mut camera = self.framed(&outline, StandardView::Isometric, clouds);
            camera.eye = camera.pivot - self.camera.forward() * camera.distance();
            camera.frame(&outline, self.settings.view.field_of_view, self.aspect());
            self.jump(now, self.settings.clone(), camera);
        }
    }

    pub fn pick_under_cursor(&self, purpose: PickPurpose, outside: &mut Outside) {
        if let Some(pixel) = self.cursor() {
            outside.render(Command::Pick { pixel, purpose });
        }
    }
}

/// `value` after `notches` steps, within the range of the parameter.
fn scaled(params: &dyn param::Params, name: &str, value: f32, notches: f32) -> f32 {
    let field = params.group().fields.iter().find(|field| field.name == name);
    let range = field.map(|field| &field.kind);
    let wanted = value * STEP.powf(notches);
    match range {
        Some(param::Kind::F32 { min, max, .. }) => wanted.clamp(*min, *max),
        _ => wanted,
    }
}
