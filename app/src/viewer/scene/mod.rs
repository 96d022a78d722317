//! What the user looks at: the parameters, the objects, the camera, and the history that undoes changes of them.

pub mod approach;
pub mod confines;
pub mod flight;
pub mod furnishing;
pub mod idle;
pub mod light_search;
pub mod navigation;
pub mod orbit;
pub mod past_views;
pub mod posing;
pub mod scene_parameters;
pub mod turning;

use std::time::{Duration, Instant};

use cloud::Bounds;
use glam::DVec3;
use param::Choice as _;
use render::MOST_LIGHTS;
use scene::{
    Camera, Clip, ColorBy, Lighting, Mirror, Object, Projection, Settings, SpotLight, StandardView, Start, Visibility,
};
use serde_json::json;
use world::{CloudKey, mirrors};

use crate::overlays::lens::{Lens, to_vector};
use crate::shared::language::{text, translated};
use crate::viewer::objects::clouds::{CloudEntry, colored_chunks};
use crate::viewer::objects::history::History;
use crate::viewer::objects::posed::Posed;
use crate::viewer::objects::{ObjectId, Objects, Origin, Placed, PlacedClip, PlacedLight, SPOT, spot, unnamed};
use crate::viewer::picture::messages::{Command, PickPurpose};
use crate::viewer::requests::action::{Action, Mode};
use crate::viewer::requests::bindings::COMMAND;
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::Outside;
use crate::viewer::scene::confines::Confines;
use crate::viewer::scene::flight::Flight;
use crate::viewer::scene::navigation::Navigation;
use crate::viewer::scene::past_views::PastViews;
use crate::viewer::scene::scene_parameters::SceneParameters;

/// The factor by which a notch of the wheel changes the distance.
const ZOOM_PER_NOTCH: f64 = 0.85;
/// The longest wait for the point under the cursor. A zoom that starts later feels stuck.
const ZOOM_PATIENCE: Duration = Duration::from_millis(120);
/// The factor by which a notch enlarges splats or the field of view. Seven notches double them.
pub const STEP: f32 = 1.1;

pub struct Scene {
    pub settings: Settings,
    /// Set while a scene shows other parameters than the person's own.
    pub brought: Option<SceneParameters>,
    pub objects: Objects,
    /// The selected object.
    pub selected: Option<ObjectId>,
    pub camera: Camera,
    /// True if a person or a file chose the camera: then loading no longer moves it.
    pub camera_is_placed: bool,
    /// The view that the first scene opened with, to which framing goes back.
    pub opening: Option<Camera>,
    /// A camera in the room that is open, if it is one.
    pub room: Option<Camera>,
    pub confines: Confines,
    /// The side from which everything is seen until then, if the command line names one.
    pub first_side: Option<StandardView>,
    /// A move of the camera that is under way.
    pub flight: Option<Flight>,
    pub mode: Mode,
    pub navigation: Navigation,
    pub history: History,
    pub past_views: PastViews,
    /// The light before the user switched to the data's own colours.
    pub lit_by: Lighting,
    /// The size of the picture in pixels.
    pub view_size: [u32; 2],
    /// Set while tracks of a path have changed the scene.
    pub posed: Option<Posed>,
    next_object: u32,
}

impl Scene {
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            brought: None,
            objects: Objects::default(),
            selected: None,
            camera: Camera::looking(DVec3::ZERO, DVec3::ONE, 5.0, DVec3::Z),
            camera_is_placed: false,
            opening: None,
            room: None,
            confines: Confines::default(),
            first_side: None,
            flight: None,
            mode: Mode::Orbit,
            navigation: Navigation::default(),
            history: History::default(),
            past_views: PastViews::default(),
            lit_by: Lighting::Auto,
            view_size: [1, 1],
            posed: None,
            next_object: 0,
        }
    }

    pub fn undo(&mut self, outside: &mut Outside) {
        let done = self.history.undo(&mut self.settings, &mut self.objects, &mut self.camera);
        self.after_history(done, |what| text!("Undone: {what}", what), text!("Nothing to undo"), outside);
    }

    pub fn redo(&mut self, outside: &mut Outside) {
        let done = self.history.redo(&mut self.settings, &mut self.objects, &mut self.camera);
        self.after_history(done, |what| text!("Done again: {what}", what), text!("Nothing to redo"), outside);
    }

    pub fn next_object_id(&mut self) -> ObjectId {
        self.next_object += 1;
        ObjectId(self.next_object - 1)
    }

    /// Changes the objects in one step of undo.
    pub fn edit_objects(&mut self, now: Instant, change: impl FnOnce(&mut Objects)) {
        self.edit(now, |_, objects| change(objects));
    }

    /// Changes parameters and objects in one step of undo.
    pub fn edit(&mut self, now: Instant, change: impl FnOnce(&mut Settings, &mut Objects)) {
        self.unpose();
        self.history.settle(&self.settings, &self.objects);
        change(&mut self.settings, &mut self.objects);
        self.history.settle(&self.settings, &self.objects);
        self.navigation.camera_moved(now);
    }

    /// Changes the objects without a step of undo, because a file was opened or closed.
    pub fn rewrite_objects(&mut self, change: impl Fn(&mut Objects)) {
        self.unpose();
        self.history.settle(&self.settings, &self.objects);
        change(&mut self.objects);
        self.history.rewrite(change);
    }

    /// Adds a mirror of a file or a built-in scene.
    pub fn bring_mirror(&mut self, mirror: Mirror, input: Option<String>, outside: &mut Outside) -> ObjectId {
        let id = self.next_object_id();
        let mirror = Mirror { name: self.objects.free_name("mirror", &mirror.name, None), ..mirror };
        outside.log(json!({ "event": "mirror", "name": mirror.name }));
        self.rewrite_objects(|objects| {
            objects.mirrors.push(Placed { id, mirror: mirror.clone(), input: input.clone() });
        });
        id
    }

    /// Adds lights of files and built-in scenes, except those that are there already.
    pub fn bring_lights(&mut self, lights: impl Iterator<Item = (SpotLight, Origin)>, outside: &mut Outside) {
        let placed = |(light, origin)| PlacedLight { id: self.next_object_id(), name: SPOT.into(), light, origin };
        let brought: Vec<PlacedLight> = lights.map(placed).collect();
        if brought.is_empty() {
            return;
        }
        self.rewrite_objects(|objects| {
            // A guessed lamp is only for scenes without other lights.
            objects.keep_tracks(|objects| objects.lights.retain(|other| other.origin != Origin::Guess));
            let known = objects.lights.clone();
            let is_new = |placed: &&PlacedLight| known.iter().all(|other| other.light != placed.light);
            objects.lights.extend(brought.iter().filter(is_new).cloned());
        });
        self.warn_of_dark_lights(outside);
    }

    /// Adds what a scene file hides and its clip volumes.
    pub fn bring_visibility(&mut self, visibility: &Visibility, clips: Vec<Clip>) {
        let placed = |clip| PlacedClip { id: self.next_object_id(), clip };
        let clips: Vec<PlacedClip> = clips.into_iter().map(placed).collect();
        self.rewrite_objects(|objects| {
            objects.visibility.hide(visibility);
            objects.clips.extend(clips.iter().cloned());
        });
    }

    /// Adds objects of scene files as they are, except those that are there already.
    pub fn bring_objects(&mut self, objects: impl IntoIterator<Item = Object>) {
        let brought = self.numbered_if_new(objects);
        self.rewrite_objects(|objects| brought.iter().for_each(|(id, object)| objects.push(*id, object.clone())));
    }

    /// Adds objects of a view as they are, except those that are there already.
    pub fn add_objects(&mut self, objects: impl IntoIterator<Item = Object>) {
        let added = self.numbered_if_new(objects);
        added.into_iter().for_each(|(id, object)| self.objects.push(id, object));
    }

    /// Numbers objects, without those that the scene has already.
    fn numbered_if_new(&mut self, objects: impl IntoIterator<Item = Object>) -> Vec<(ObjectId, Object)> {
        let known: Vec<Object> = self.objects.all().map(|(.., object)| object).collect();
        let mut new: Vec<(ObjectId, Object)> = Vec::new();
        for object in objects {
            if !known.contains(&object) && new.iter().all(|(_, before)| *before != object) {
                new.push((self.next_object_id(), object));
            }
        }
        new
    }

    /// Warns the user if there are more lights than can shine.
    pub fn warn_of_dark_lights(&mut self, outside: &mut Outside) {
        if self.objects.lights.len() > MOST_LIGHTS {
            outside.say(Level::Warning, text!("Only the first {MOST_LIGHTS} lights shine", MOST_LIGHTS));
        }
    }

    /// Adds an object in one step of undo, and selects it. For a light, also switches to a kind of lighting that shows
    /// it.
    pub fn place(&mut self, id: ObjectId, object: Object, outside: &mut Outside) {
        let kind = object.kind();
        if self.objects.count(kind) >= kind.most {
            let (most, kind) = (kind.most, translated(kind.name));
            return outside.note(text!("There are {most} {kind}s, and no room for more", most, kind));
        }
        let (position, is_light) = (object.places().first().map(DVec3::to_array), matches!(object, Object::Light(_)));
        self.history.settle(&self.settings, &self.objects);
        if is_light && self.settings.light.by != Lighting::Auto {
            self.settings.light.by = Lighting::Lights;
        }
        self.objects.add(id, object);
        self.history.settle(&self.settings, &self.objects);
        let name = self.objects.get(id).map(|(name, _)| name);
        outside.log(json!({ "event": kind.name, "name": name, "position": position }));
        if !kind.is_over_picture {
            self.navigation.camera_moved(outside.now);
        }
        self.selected = Some(id);
        if is_light {
            self.warn_of_dark_lights(outside);
        }
    }

    pub fn duplicate(&mut self, outside: &mut Outside) {
        let selected = self.selected.and_then(|id| self.objects.get(id));
        if let Some((_, object)) = selected {
            let Some(copy) = object.beside(self.camera.right()) else {
                let kind = translated(object.kind().name);
                return outside.note(text!("A {kind} belongs to its points, and has no copy", kind));
            };
            let id = self.next_object_id();
            self.place(id, copy, outside);
        }
    }

    /// Adds a spot light at the eye.
    pub fn add_spot(&mut self, outside: &mut Outside) {
        let light = spot(self.camera.eye, self.camera.pivot, self.settings.view.field_of_view);
        let id = self.next_object_id();
        self.place(id, Object::Light(light), outside);
    }

    pub fn change_object(&mut self, id: ObjectId, changed: Object, outside: &mut Outside) {
        if let Object::Note(note) = &changed {
            outside.log(json!({ "event": "note_changed", "text": note.text }));
        }
        let is_seen = match (&changed, self.objects.mirror(id)) {
            (Object::Mirror(changed), Some(mirror)) => unnamed(changed) != unnamed(mirror),
            _ => !changed.kind().is_over_picture,
        };
        self.objects.set(id, changed);
        if is_seen {
            self.navigation.camera_moved(outside.now);
        }
    }

    /// Logs the new place of the selected object when the user releases it.
    pub fn log_moved(&self, outside: &mut Outside) {
        let Some((name, object)) = self.selected.and_then(|id| self.objects.get(id)) else { return };
        let places: Vec<[f64; 3]> = object.places().iter().map(DVec3::to_array).collect();
        let event = format!("{}_moved", object.kind().name);
        let event = json!({ "event": event, "name": name, "position": places.first(), "target": places.get(1) });
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

    /// Sets a parameter. An invalid value is refused with a warning in the log.
    pub fn set_parameter(&mut self, key: &str, value: param::Value, now: Instant) {
        let Some((group, name)) = key.split_once('.') else { return };
        let group = self.settings.groups_mut().into_iter().find(|known| known.group().name == group);
        if let Some(Err(error)) = group.map(|group| group.set(name, value)) {
            tracing::warn!("{error}");
        }
        if self.navigation.is_held() {
            // A slider that is dragged makes frames hurried, as a moving camera does.
            self.navigation.camera_moved(now);
        }
    }

    /// Gives a parameter its default, in one step of undo.
    fn reset(&mut self, key: &str, outside: &mut Outside) {
        let group = |settings: &Settings| {
            let (group, name) = key.split_once('.')?;
            let group = settings.groups().into_iter().map(param::Params::group).find(|known| known.name == group)?;
            let field = group.fields.iter().find(|field| field.name == name)?;
            Some(field.format(&field.default()))
        };
        let Some(default) = group(&self.settings) else { return };
        self.edit(outside.now, |settings, _| {
            if let Err(error) = settings.set_text(key, &default) {
                tracing::warn!("{error}");
            }
        });
        outside.note(text!("{key} is {default} again; {COMMAND}+Z takes that back", key, default, COMMAND));
    }

    /// Whether the points are shown in their own colours when they are lit by `by`.
    fn is_unlit_by(&self, by: Lighting, clouds: &[CloudEntry]) -> bool {
        let chunks = colored_chunks(clouds, &self.objects);
        let clues = world::AutoLight::default().clues(chunks, self.objects.has_guess());
        let mut settings = Settings { color: self.settings.color.clone(), ..Settings::default() };
        settings.light.by = by;
        settings.resolved_light(!self.objects.lights.is_empty(), clues).by == Lighting::Colors
    }

    pub fn is_unlit(&self, clouds: &[CloudEntry]) -> bool {
        self.is_unlit_by(self.settings.light.by, clouds)
    }

    /// The light that replaces the data's own colours when somebody asks for light.
    fn lit_by(&self, clouds: &[CloudEntry]) -> Lighting {
        if self.is_unlit_by(self.lit_by, clouds) { Lighting::Surroundings } else { self.lit_by }
    }

    pub fn light_by(&mut self, by: Lighting, outside: &mut Outside) {
        let before = &mut self.settings.light.by;
        if *before != Lighting::Colors {
            self.lit_by = *before;
        }
        *before = by;
        let (is_raw, name) = (by == Lighting::Colors, translated(by.name()));
        outside.note(if is_raw { text!("Data colours, no light").into() } else { text!("Light: {name}", name) });
    }

    pub fn color_by(&mut self, by: ColorBy, clouds: &[CloudEntry], outside: &mut Outside) {
        self.settings.color.by = by;
        if by == ColorBy::Attribute && self.settings.color.attribute.is_empty() {
            let first = clouds.iter().flat_map(|entry| &entry.cloud.attributes).next();
            self.settings.color.attribute = first.map_or(String::new(), |attribute| attribute.name.clone());
        }
        outside.note(text!("Colour: {by}", by = translated(by.name())));
    }

    /// Restores earlier settings in one step of undo.
    pub fn return_to(&mut self, settings: Settings, outside: &mut Outside) {
        self.history.settle(&self.settings, &self.objects);
        self.settings = settings;
        self.history.settle(&self.settings, &self.objects);
        outside.log(json!({ "event": "returned" }));
    }

    /// Reports what was undone or done again, in the words of `told`; `nothing` says that nothing was.
    fn after_history(&mut self, done: Option<String>, told: fn(&str) -> String, nothing: &str, outside: &mut Outside) {
        if let Some(done) = done {
            self.navigation.camera_moved(outside.now);
            let Objects { mirrors, lights, clips, .. } = &self.objects;
            let [mirrors, lights, clips] = [mirrors.len(), lights.len(), clips.len()];
            outside.log(json!({
                "event": "history", "mirrors": mirrors, "lights": lights, "clips": clips, "what": done,
            }));
            outside.note(told(&done));
        } else {
            outside.note(nothing);
        }
    }

    /// Moves the camera at once, perhaps with other parameters, in one step of undo.
    pub fn jump(&mut self, now: Instant, settings: Settings, camera: Camera) {
        self.history.before_jump(&self.settings, &self.objects, self.camera);
        self.flight = None;
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

    /// Returns the bounds of the visible clouds, without stray points, and of the mirrors.
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
            scene::UpAxis::Auto => {
                let first = clouds.iter().find(|entry| entry.is_visible).or(clouds.first());
                first.map_or(DVec3::Z, |entry| entry.up)
            }
        }
    }

    /// Returns the outermost points of the visible clouds and the mirrors, which framing keeps in the picture.
    pub fn outline(&self, clouds: &[CloudEntry]) -> Vec<DVec3> {
        let mirrors = self.objects.mirrors.iter().flat_map(|placed| mirrors::outline(&placed.mirror));
        clouds.iter().filter(|entry| entry.is_visible).flat_map(|entry| entry.extent().outline).chain(mirrors).collect()
    }

    pub fn framed(&self, outline: &[DVec3], view: StandardView, clouds: &[CloudEntry]) -> Camera {
        Camera::framing(outline, view, self.up(clouds), self.settings.view.field_of_view, self.aspect())
    }

    /// Moves the camera to where it stands when clouds open, unless it has been chosen: into a room, or to where it
    /// sees everything. It frames the clouds' outlines, or `bounds` while no outline is known.
    pub fn frame_while_unplaced(&mut self, bounds: Bounds, clouds: &[CloudEntry]) {
        if self.camera_is_placed {
            return;
        }
        let has_figures = clouds.iter().any(|entry| entry.is_visible && entry.figures.is_some());
        let stands_inside = self.room.is_some() && self.first_side.is_none() && self.settings.view.start == Start::Auto;
        let outline = if has_figures && self.first_side.is_some() {
            self.outline(clouds)
        } else if has_figures {
            let visible = clouds.iter().filter(|entry| entry.is_visible).map(CloudEntry::extent).collect();
            world::first_outline(visible, self.objects.mirrors.iter().map(|placed| &placed.mirror)).0
        } else if stands_inside || !bounds.is_empty() {
            bounds.corners().to_vec()
        } else {
            return;
        };
        let up = self.up(clouds);
        self.camera = world::first_camera(self.first_side, self.room, &outline, up, &self.settings.view, self.aspect());
    }

    pub fn frame_all(&mut self, clouds: &[CloudEntry], now: Instant) {
        if let Some(opening) = self.opening {
            return self.jump(now, self.settings.clone(), opening);
        }
        if !self.bounds(clouds).is_empty() {
            let mut camera = self.camera;
            camera.frame(&self.outline(clouds), self.settings.view.field_of_view, self.aspect());
            self.jump(now, self.settings.clone(), camera);
        }
    }

    /// Goes into the room, or to the place of a depth image, or out of it, from where it looks like a doll's house:
    /// without the backs of its walls.
    fn show_room(&mut self, is_inside: bool, clouds: &[CloudEntry], outside: &mut Outside) {
        let Some(room) = self.room else {
            return outside.note(text!("Neither a closed room nor a depth image is open"));
        };
        let mut settings = self.settings.clone();
        settings.splat.back_faces = is_inside;
        let camera = if is_inside { room } else { self.framed(&self.outline(clouds), StandardView::Isometric, clouds) };
        self.jump(outside.now, settings, camera);
    }

    pub fn look_from(&mut self, view: StandardView, clouds: &[CloudEntry], now: Instant) {
        if !self.bounds(clouds).is_empty() {
            let camera = self.framed(&self.outline(clouds), view, clouds);
            self.jump(now, self.settings.clone(), camera);
        }
    }

    /// Moves the camera to `eye` and turns it to `pivot`.
    pub fn look_along(&mut self, eye: DVec3, pivot: DVec3, now: Instant) {
        let camera = Camera::looking(pivot, eye - pivot, eye.distance(pivot), self.camera.up);
        self.jump(now, self.settings.clone(), camera);
    }

    /// Returns the pixel under the cursor.
    pub fn cursor(&self) -> Option<[u32; 2]> {
        self.navigation.cursor.map(|(pixel, _)| pixel)
    }

    /// The place of the point under the cursor, if it is known.
    pub fn hovered(&self) -> Option<DVec3> {
        self.navigation.hovered.and_then(|(_, world)| world)
    }

    /// Records that a person moved the camera.
    pub fn camera_moved_by_hand(&mut self, now: Instant) {
        self.camera_is_placed = true;
        self.navigation.camera_moved(now);
    }

    /// Flies by `way`: world units right, up, forward.
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

    /// Zooms by `notches` of the wheel: at once if the point under the cursor is known, else when its answer comes.
    pub fn zoom(&mut self, notches: f32, outside: &mut Outside) {
        self.navigation.pending_zoom += notches;
        self.navigation.zoom_since.get_or_insert(outside.now);
        if self.navigation.anchor().is_none() && self.navigation.asked.is_none() {
            self.ask_hover(outside);
        }
        // Without a cursor over the picture there is nothing to wait for.
        self.apply_pending_zoom(self.cursor().is_none(), outside.now);
    }

    /// Does the zoom that waits. With `at_once` it does so even if the point under the cursor is not known.
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
        // Zooming toward the point keeps it under the cursor.
        self.navigation.hovered = hovered.map(|(pixel, world)| (self.cursor().unwrap_or(pixel), world));
    }

    /// Zooms toward the plane of the pivot if the answer about the point under the cursor takes too long. Returns the
    /// time after which to call this again.
    pub fn end_zoom_wait(&mut self, now: Instant) -> Option<Duration> {
        self.cursor()?;
        let waited = now.saturating_duration_since(self.navigation.zoom_since?);
        let left = ZOOM_PATIENCE.checked_sub(waited).filter(|left| !left.is_zero());
        self.apply_pending_zoom(left.is_none(), now);
        left.filter(|_| self.navigation.zoom_since.is_some())
    }

    /// Returns true in fly mode, in which the wheel changes the speed.
    pub fn is_flying(&self) -> bool {
        self.mode == Mode::Fly
    }

    /// Carries out an action if it concerns only the scene. Returns all other actions.
    pub fn act(&mut self, action: Action, clouds: &[CloudEntry], outside: &mut Outside) -> Option<Action> {
        match action {
            Action::Orbit(_) | Action::Look(_) | Action::Pan(_) => self.drag_camera(&action, outside.now),
            Action::EndDrag => self.end_drag(),
            Action::Zoom(notches) => self.zoom(notches, outside),
            Action::FieldOfView(notches) => {
                let view = &self.settings.view;
                self.settings.view.field_of_view = scaled(view, "field_of_view", view.field_of_view, notches);
            }
            Action::FlySpeed(notches) => {
                // The speed can be doubled or halved six times, from a crawl to the speed of a jet.
                self.navigation.speed = (self.navigation.speed + notches * 0.5).clamp(-6.0, 6.0);
                outside.note(text!("Speed × {speed}", speed = format_args!("{:.2}", self.navigation.speed.exp2())));
            }
            Action::Travel(way) => self.travel(way, outside.now),
            Action::PivotHere => self.pick_under_cursor(PickPurpose::Pivot, outside),
            Action::FrameAll => self.frame_all(clouds, outside.now),
            Action::GoInside => self.show_room(true, clouds, outside),
            Action::DollHouse => self.show_room(false, clouds, outside),
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
            Action::LastView => self.step_view(true, outside),
            Action::NextView => self.step_view(false, outside),
            Action::PointAt(pixel) => self.navigation.point_at(pixel, outside.now),
            Action::AskHover => self.ask_hover(outside),
            Action::SetParameter { key, value } => self.set_parameter(&key, value, outside.now),
            Action::Reset(key) => self.reset(&key, outside),
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
                let by = if self.is_unlit(clouds) { self.lit_by(clouds) } else { Lighting::Colors };
                self.light_by(by, outside);
            }
            Action::NextLight => {
                let next = (self.settings.light.by as u32 + 1) % Lighting::NAMES.len() as u32;
                self.light_by(Lighting::from_index(next).unwrap_or(Lighting::Auto), outside);
            }
            Action::LightBy(by) => self.light_by(by, outside),
            Action::Undo => self.undo(outside),
            Action::Redo => self.redo(outside),
            Action::Paste(text) => self.paste_view(&text, clouds, outside),
            Action::AddSpot => self.add_spot(outside),
            Action::Select(id) => self.selected = id,
            Action::ChangeObject(id, object) => self.change_object(id, *object, outside),
            Action::Duplicate => self.duplicate(outside),
            Action::Delete => {
                if let Some(id) = self.selected.take() {
                    let tracks = self.objects.track_count();
                    self.edit_objects(outside.now, |objects| objects.remove(id));
                    self.tell_lost_tracks(tracks, outside);
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

    /// Frames one cloud, and keeps the direction of view.
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

/// Returns `value` after `notches` steps, within the range of the parameter.
fn scaled(params: &dyn param::Params, name: &str, value: f32, notches: f32) -> f32 {
    let field = params.group().fields.iter().find(|field| field.name == name);
    let range = field.map(|field| &field.kind);
    let wanted = value * STEP.powf(notches);
    match range {
        Some(param::Kind::F32 { min, max, .. }) => wanted.clamp(*min, *max),
        _ => wanted,
    }
}
