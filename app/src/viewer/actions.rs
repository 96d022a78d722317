//! What each action does to the session.

use glam::{DVec2, DVec3};
use param::Choice as _;
use render::MOST_LIGHTS;
use scene::{Camera, ColorBy, Lighting, Mirror, MirrorPoints, Object, Projection, Shape, StandardView};
use serde_json::json;
use world::CloudKey;

use super::action::{Action, Handles, Mode};
use super::clouds::CloudEntry;
use super::inspection::{Inspection, Ray, Surface, Target};
use super::lens::to_vector;
use super::messages::Level;
use super::objects::{ObjectId, Objects, spot, unnamed};
use super::outside::Effect;
use super::path_prompt::PathPrompt;
use super::render_thread::{Command, PickPurpose};
use super::session::Session;
use super::work::Work;
use super::{pick, sweep};

/// Growth of splats and of the field of view per notch: seven notches double.
const STEP: f32 = 1.1;
/// Radians that a notch tilts the inspection mirror.
const TILT_STEP: f64 = 0.087;
/// Size of a mirror that is added, over the scene's radius: a tenth of the scene across.
const MIRROR_SIZE: f64 = 0.1;
/// Pixels about the cursor that its sight line takes in: as when a point is picked.
const CAST_RADIUS: f64 = 4.0;

impl Session {
    /// Does all that a panel or a painting of the window asked for.
    pub fn act_all(&mut self, actions: impl IntoIterator<Item = Action>) {
        actions.into_iter().for_each(|action| self.act(action));
    }

    pub fn act(&mut self, action: Action) {
        match action {
            // Keys that are held come as `Travel` and `Hold`, the clipboard as `Paste`.
            Action::Fly(_) | Action::Fast | Action::Slow => {}
            Action::RawColors | Action::ShowTruth | Action::PasteView => {}

            Action::Orbit(_) | Action::Look(_) | Action::Pan(_) => self.drag_camera(&action),
            Action::Zoom(notches) => self.zoom(notches),
            Action::FieldOfView(notches) => {
                let view = &self.settings.view;
                self.settings.view.field_of_view = scaled(view, "field_of_view", view.field_of_view, notches);
            }
            Action::FlySpeed(notches) => {
                // Six doublings either way: from an ant's pace to a jet's.
                self.navigation.speed = (self.navigation.speed + notches * 0.5).clamp(-6.0, 6.0);
                self.outside.note(format!("Speed × {:.2}", self.navigation.speed.exp2()));
            }
            Action::Travel(way) => self.travel(way),
            Action::PivotHere => self.pick_under_cursor(PickPurpose::Pivot),
            Action::FrameAll => self.frame_all(),
            Action::FrameCloud(key) => self.frame_cloud(key),
            Action::ToggleMode => {
                self.mode = if self.mode == Mode::Orbit { Mode::Fly } else { Mode::Orbit };
                let text = if self.is_flying() { "Fly: drag to look, W A S D Q E to move" } else { "Orbit" };
                self.outside.note(text);
            }
            Action::LookFrom(view) => self.look_from(view),
            Action::LookAlong { eye, pivot } => self.look_along(eye, pivot),
            Action::ToggleProjection => {
                let projection = &mut self.settings.view.projection;
                *projection = match projection {
                    Projection::Perspective => Projection::Orthographic,
                    Projection::Orthographic => Projection::Perspective,
                };
            }
            Action::PointAt(pixel) => self.navigation.point_at(pixel, self.outside.now),
            Action::AskHover => self.ask_hover(),

            Action::SetParameter { key, value } => self.set_parameter(&key, value),
            Action::ChangeSettings(settings) => self.settings = *settings,
            Action::PointSize(notches) => {
                self.settings.splat.size = scaled(&self.settings.splat, "size", self.settings.splat.size, notches);
            }
            Action::ColorBy(by) => self.color_by(by),
            Action::ShowClasses(classes, is_shown) => self.show_classes(classes, is_shown),
            Action::ToggleEdl => {
                let strength = &mut self.settings.edl.strength;
                *strength = if *strength > 0.0 { 0.0 } else { scene::Edl::default().strength };
            }
            Action::Hold { raw_colors, truth } => {
                self.raw_colors = raw_colors;
                // The truth of nothing cannot be shown.
                let is_held = truth && (self.truth.is_held || !self.clouds.is_empty());
                self.truth.hold(is_held, &mut self.outside);
            }
            Action::ToggleLight => {
                let is_lit = self.settings.light.by != Lighting::Colors;
                self.light_by(if is_lit { Lighting::Colors } else { self.lit_by });
            }
            Action::NextLight => {
                let next = (self.settings.light.by as u32 + 1) % Lighting::NAMES.len() as u32;
                self.light_by(Lighting::from_index(next).unwrap_or(Lighting::Auto));
            }
            Action::LightBy(by) => self.light_by(by),
            Action::Undo => {
                let done = self.history.undo(&mut self.settings, &mut self.objects, &mut self.camera);
                self.after_history(done, "Nothing to undo");
            }
            Action::Redo => {
                let done = self.history.redo(&mut self.settings, &mut self.objects, &mut self.camera);
                self.after_history(done, "Nothing to redo");
            }

            Action::Open(path) => drop(self.open(&[path])),
            Action::OpenDialog => self.outside.push(Effect::OpenDialog),
            Action::OpenPrompt => self.path_prompt = Some(PathPrompt::default()),
            Action::PromptForMirror => self.path_prompt = Some(PathPrompt::for_mirror()),
            Action::ChangePrompt(prompt) => self.path_prompt = Some(*prompt),
            Action::OpenPrompted(path) => self.open_prompted(path),
            Action::ClosePrompt => self.path_prompt = None,
            Action::Copy(text) => self.outside.push(Effect::Copy(text)),
            Action::CopyView => {
                self.outside.push(Effect::Copy(self.view_as_text()));
                self.outside.note("View copied as text");
            }
            Action::Paste(text) => self.paste_view(&text),
            Action::CopyCommandLine => {
                self.outside.push(Effect::Copy(self.command_line()));
                self.outside.note("Command line copied");
            }
            Action::SaveScene => self.save_scene(),
            Action::SavePicture => self.save_picture(),
            Action::StopLoading => self.stop_loading(),
            Action::ShowCloud(key, is_visible) => self.set_visible(key, is_visible),
            Action::RemoveCloud(key) => self.remove_cloud(key),
            Action::StopMaking(key) => self.stop_making(key),
            Action::ResumeMaking(key) => self.resume_making(key),
            Action::DeleteIndex(key) => self.delete_index(key),

            Action::AddMirror(shape) => self.add_mirror(shape),
            Action::AddSpot => self.add_spot(),
            Action::Select(id) => self.selected = id,
            Action::ChangeObject(id, object) => self.change_object(id, *object),
            Action::Gizmo(handles) => {
                self.handles = if self.handles == handles { Handles::All } else { handles };
            }
            Action::GrabHandle(is_grabbed) => {
                if std::mem::replace(&mut self.handle_is_grabbed, is_grabbed) && !is_grabbed {
                    self.log_moved();
                }
            }
            Action::Duplicate => self.duplicate(),
            Action::Delete => {
                if let Some(id) = self.selected.take() {
                    self.edit_objects(|objects| objects.remove(id));
                }
            }
            Action::ShowLights(are_shown) => self.light_panel_is_open = are_shown,
            Action::Inspect => self.toggle_inspection(),
            Action::InspectDistance(notches) => {
                if let Some(Inspection { pose, .. }) = &mut self.inspection {
                    pose.distance = (pose.distance * f64::from(STEP.powf(notches))).clamp(0.005, 0.9);
                }
            }
            Action::InspectTilt(notches) => {
                if let Some(Inspection { pose, .. }) = &mut self.inspection {
                    pose.tilt = (pose.tilt + TILT_STEP * f64::from(notches)).clamp(-3.0, 3.0);
                }
            }
            Action::ChangeInspection(pose) => {
                if let Some(held) = &mut self.inspection {
                    held.pose = pose;
                }
            }
            Action::ChangeDraft(draft) => self.draft = *draft,
            Action::CountPoints(key, wanted) => {
                if let Some(entry) = self.cloud(key) {
                    let (cloud, source, wanted) = (entry.cloud.clone(), entry.source.clone(), *wanted);
                    self.outside.work(Work::CountPoints { cloud, source, wanted });
                }
            }
            Action::Mark(marking) => self.edit_objects(|objects| objects.markings.push(*marking)),
            Action::Unmark(marking) => {
                self.edit_objects(|objects| {
                    let index = objects.markings.iter().position(|known| *known == *marking);
                    index.map(|index| objects.markings.remove(index));
                });
            }
            Action::StopMarking(key) => {
                let marking = self.cloud(key).and_then(|entry| entry.marking.as_ref());
                marking.iter().for_each(|(_, progress)| progress.cancel());
            }

            Action::Pick => {
                self.navigation.picks_before = self.picks.clone();
                match self.inspection {
                    Some(_) => self.pin_inspection(),
                    None => self.pick_under_cursor(PickPurpose::Select),
                }
            }
            Action::UndoPick => self.picks = std::mem::take(&mut self.navigation.picks_before),
            Action::PickTool => self.pick_tool = !self.pick_tool,
            Action::CopyPicks => {
                self.outside.push(Effect::Copy(pick::as_text(&self.picks)));
                self.outside.note("Picked points copied");
            }
            Action::ClearPicks => self.picks.clear(),

            Action::PinTruth => self.truth.is_pinned = !self.truth.is_pinned,
            Action::LookAtTruth(look) => self.truth.look = look,
            Action::MeasureTruth(measure) => self.truth.measure = measure,
            Action::SplitTruth(share) => self.truth.split = share,
            Action::KeepTruthReady(is_on) => self.truth.keeps_ready = is_on,
            Action::JudgeSettings(is_on) => self.truth.judges = is_on,
            Action::StopTruth => self.stop_truth(),
            Action::ToggleChart => self.tuning.is_open = !self.tuning.is_open,
            Action::ReturnTo(settings) => self.return_to(*settings),
            Action::ForgetTrials => self.tuning.forget_trials(),
            Action::AddToStudy => self.add_to_study(),
            Action::AskSweep(key) => self.sweeps.ask(&key, &self.settings, &mut self.outside),
            Action::ChangeSweep(range) => self.sweeps.asked = range.map(|range| *range),
            Action::StartSweep { key, values } => self.start_sweep(&key, values, &sweep::places()),
            Action::EndSweep => self.sweeps.stop(&mut self.outside),

            Action::EndTool => self.end_tool(),
            Action::ToggleInterface => self.interface_is_hidden = !self.interface_is_hidden,
            Action::TogglePanel => self.preferences.panel_is_open = !self.preferences.panel_is_open,
            Action::ToggleFullScreen => {
                self.is_full_screen = !self.is_full_screen;
                self.outside.push(Effect::SetFullScreen(self.is_full_screen));
            }
            Action::ToggleShortcuts => self.shortcuts_are_open = !self.shortcuts_are_open,
            Action::ListMessages(is_open) => self.outside.messages.list_is_open = is_open,
            Action::DismissMessage(place) => self.outside.messages.dismiss(place),
            Action::Resize(size) => self.set_view_size(size),
            Action::Quit => self.wants_to_quit = true,
        }
    }

    /// What widgets cannot give is not set.
    fn set_parameter(&mut self, key: &str, value: param::Value) {
        let Some((group, name)) = key.split_once('.') else { return };
        let group = self.settings.groups_mut().into_iter().find(|known| known.group().name == group);
        if let Some(Err(error)) = group.map(|group| group.set(name, value)) {
            tracing::warn!("{error}");
        }
    }

    fn pick_under_cursor(&mut self, purpose: PickPurpose) {
        if let Some(pixel) = self.cursor() {
            self.outside.render(Command::Pick { pixel, purpose });
        }
    }

    /// If what was typed names nothing, the prompt stays.
    fn open_prompted(&mut self, path: String) {
        let is_for_mirror = self.path_prompt.as_ref().is_some_and(|prompt| prompt.is_for_mirror);
        if self.open(std::slice::from_ref(&path)) {
            self.path_prompt = None;
            if is_for_mirror {
                self.await_marking(MirrorPoints::whole(path));
            }
        }
    }

    fn change_object(&mut self, id: ObjectId, changed: Object) {
        let is_renamed_alone = match (&changed, self.objects.mirror(id)) {
            (Object::Mirror(changed), Some(mirror)) => unnamed(changed) == unnamed(mirror),
            _ => false,
        };
        self.objects.set(id, changed);
        if !is_renamed_alone {
            self.navigation.camera_moved(self.outside.now);
        }
    }

    /// Looks at a cloud as at what is looked at now.
    fn frame_cloud(&mut self, key: CloudKey) {
        let figures = self.cloud(key).and_then(|entry| entry.figures.as_ref());
        let outline = figures.map(|figures| figures.outline.clone());
        if let Some(outline) = outline.filter(|outline| !outline.is_empty()) {
            let mut camera = self.framed(&outline, StandardView::Isometric);
            camera.eye = camera.pivot - self.camera.forward() * camera.distance();
            camera.frame(&outline, self.settings.view.field_of_view, self.aspect());
            self.jump(self.settings.clone(), camera);
        }
    }

    /// The hand has let go of the selected object.
    fn log_moved(&mut self) {
        let Some((name, object)) = self.selected.and_then(|id| self.objects.get(id)) else { return };
        let places: Vec<[f64; 3]> = object.places().iter().map(DVec3::to_array).collect();
        let event = format!("{}_moved", object.kind().name);
        let event = json!({ "event": event, "name": name, "position": places[0], "target": places.get(1) });
        self.outside.log(event);
    }

    fn after_history(&mut self, done: bool, otherwise: &str) {
        if done {
            self.navigation.camera_moved(self.outside.now);
            let Objects { mirrors, lights, .. } = &self.objects;
            self.outside.log(json!({ "event": "history", "mirrors": mirrors.len(), "lights": lights.len() }));
        } else {
            self.outside.note(otherwise);
        }
    }

    fn frame_all(&mut self) {
        if !self.bounds().is_empty() {
            let mut camera = self.camera;
            camera.frame(&self.outline(), self.settings.view.field_of_view, self.aspect());
            self.jump(self.settings.clone(), camera);
        }
    }

    fn look_from(&mut self, view: StandardView) {
        if !self.bounds().is_empty() {
            let camera = self.framed(&self.outline(), view);
            self.jump(self.settings.clone(), camera);
        }
    }

    fn color_by(&mut self, by: ColorBy) {
        self.settings.color.by = by;
        if by == ColorBy::Attribute && self.settings.color.attribute.is_empty() {
            let first = self.clouds.iter().flat_map(|entry| &entry.cloud.attributes).next();
            self.settings.color.attribute = first.map_or(String::new(), |attribute| attribute.name.clone());
        }
        self.outside.note(format!("Colour: {}", by.name()));
    }

    /// Esc: closes what lies on top, else ends the tool, else clears the picks.
    fn end_tool(&mut self) {
        if self.shortcuts_are_open {
            self.shortcuts_are_open = false;
        } else if self.path_prompt.is_some() {
            self.path_prompt = None;
        } else if self.inspection.is_some() {
            self.inspection = None;
            self.navigation.camera_moved(self.outside.now);
        } else if self.pick_tool {
            self.pick_tool = false;
        } else if self.selected.is_some() {
            self.selected = None;
        } else if !self.picks.is_empty() {
            self.picks.clear();
        } else if self.is_full_screen {
            self.act(Action::ToggleFullScreen);
        }
    }

    // ---- mirrors ----

    /// Adds a mirror on the surface at the last pick, or at the pivot, and selects it.
    pub fn add_mirror(&mut self, shape: Shape) {
        let up = self.up();
        let size = self.bounds().radius() * MIRROR_SIZE;
        let size = if size > 0.0 { size } else { self.camera.distance() * MIRROR_SIZE };
        let picked = self.picks.last().map(|pick| (pick.world, self.normal_at(pick.point)));
        let (point, normal) = picked.unwrap_or((self.camera.pivot, None));
        let to_eye = self.camera.eye - point;
        let normal = normal.map_or(up, |normal| if normal.dot(to_eye) < 0.0 { -normal } else { normal });
        let name = shape.name().to_owned();
        let mirror = Mirror { name, ..Mirror::standing(shape, point, normal, up, size) };
        let id = self.next_object_id();
        self.place(id, Object::Mirror(mirror));
    }

    /// Adds an object in one step of undo, and selects it. A light shines then.
    fn place(&mut self, id: ObjectId, object: Object) {
        let kind = object.kind();
        if self.objects.count(kind) >= kind.most {
            return self.outside.note(format!("There are {} {}s, and no room for more", kind.most, kind.name));
        }
        let (position, is_light) = (object.places()[0].to_array(), matches!(object, Object::Light(_)));
        self.history.settle(&self.settings, &self.objects);
        if is_light && self.settings.light.by != Lighting::Auto {
            self.settings.light.by = Lighting::Lights;
        }
        self.objects.add(id, object);
        self.history.settle(&self.settings, &self.objects);
        let name = self.objects.get(id).map(|(name, _)| name);
        self.outside.log(json!({ "event": kind.name, "name": name, "position": position }));
        self.navigation.camera_moved(self.outside.now);
        self.selected = Some(id);
        if is_light {
            self.warn_of_dark_lights();
        }
    }

    fn duplicate(&mut self) {
        let selected = self.selected.and_then(|id| self.objects.get(id));
        if let Some((_, object)) = selected {
            let (id, copy) = (self.next_object_id(), object.beside(self.camera.right()));
            self.place(id, copy);
        }
    }

    // ---- lights ----

    pub fn light_by(&mut self, by: Lighting) {
        let before = &mut self.settings.light.by;
        if *before != Lighting::Colors {
            self.lit_by = *before;
        }
        *before = by;
        let name = by.name();
        self.outside.note(if by == Lighting::Colors {
            "Data colours, no light".into()
        } else {
            format!("Light: {name}")
        });
    }

    /// Adds a spot light where the eye is.
    fn add_spot(&mut self) {
        let light = spot(self.camera.eye, self.camera.pivot, self.settings.view.field_of_view);
        let id = self.next_object_id();
        self.place(id, Object::Light(light));
    }

    /// Says so after lights came of which not all shine.
    pub(super) fn warn_of_dark_lights(&mut self) {
        if self.objects.lights.len() > MOST_LIGHTS {
            self.outside.say(Level::Warning, format!("Only the first {MOST_LIGHTS} lights shine"));
        }
    }

    /// Moves the camera to `eye`, looking at `pivot`.
    pub fn look_along(&mut self, eye: DVec3, pivot: DVec3) {
        let camera = Camera::looking(pivot, eye - pivot, eye.distance(pivot), self.camera.up);
        self.jump(self.settings.clone(), camera);
    }

    fn toggle_inspection(&mut self) {
        if self.inspection.take().is_some() {
            self.navigation.camera_moved(self.outside.now);
            return;
        }
        if !self.clouds.is_empty() {
            let id = self.next_object_id();
            self.inspection = Some(Inspection::new(id));
            self.selected = None;
            self.outside.note("Inspection mirror: Ctrl+wheel distance, Ctrl+Shift+wheel tilt, click pins it");
        }
    }

    /// Leaves the inspection mirror where it is.
    fn pin_inspection(&mut self) {
        let Some(mut held) = self.inspection.take() else { return };
        if let Some(mirror) = held.mirror.take() {
            self.place(held.id, Object::Mirror(mirror));
        }
    }

    /// Keeps the inspection mirror at the cursor; called every frame of the window.
    pub fn follow_cursor(&mut self) {
        let (eye, up, cursor) = (self.camera.eye, self.up(), self.cursor());
        let Some(held) = &mut self.inspection else { return };
        let before = held.mirror.clone();
        held.update(None, eye, up);
        let is_changed = held.mirror != before;
        if is_changed {
            self.navigation.camera_moved(self.outside.now);
        }
        let Some(pixel) = cursor else { return };
        let Some(held) = &mut self.inspection else { return };
        if held.asked.is_some() || held.known == Some(pixel) {
            return;
        }
        held.asked = Some(pixel);
        let visible = self.clouds.iter().filter(|entry| entry.is_visible);
        let targets = |entry: &CloudEntry| {
            let (classes, chunks) = (entry.cloud.class_column(), entry.cloud.chunks.iter().cloned());
            let target = |(chunk, (_, bounds))| Target { chunk, bounds, classes };
            chunks.zip(entry.chunk_bounds()).map(target).collect::<Vec<_>>()
        };
        let ray = self.sight_line(pixel, visible.flat_map(targets).collect());
        self.outside.work(Work::Cast(ray));
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

    /// What a sight line has met. Beyond the scan the mirror stays where it was.
    pub fn on_surface(&mut self, surface: Option<Surface>) {
        let (eye, up) = (self.camera.eye, self.up());
        let Some(held) = &mut self.inspection else { return };
        held.known = held.asked.take();
        if surface.is_some() {
            held.update(surface, eye, up);
            self.navigation.camera_moved(self.outside.now);
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

#[cfg(test)]
mod tests {
    use scene::MOST_MIRRORS;

    use super::super::preferences::Preferences;
    use super::*;

    #[test]
    fn mirrors_are_added_up_to_the_number_that_a_scene_may_have() {
        let mut session = Session::new(Preferences::default());
        for _ in 0..MOST_MIRRORS + 2 {
            session.add_mirror(Shape::Sphere);
        }
        assert_eq!(session.objects.mirrors.len(), MOST_MIRRORS);
        assert!(session.outside.messages.all.last().is_some_and(|message| message.text.contains("64 mirrors")));
    }

    #[test]
    fn point_size_and_field_of_view_stop_at_their_ranges() {
        let mut session = Session::new(Preferences::default());
        for _ in 0..200 {
            session.act(Action::PointSize(1.0));
            session.act(Action::FieldOfView(-1.0));
        }
        assert_eq!((session.settings.splat.size, session.settings.view.field_of_view), (20.0, 1.0));
    }
}
