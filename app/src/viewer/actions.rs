//! What the actions of the table of bindings do to the state, one by one, and the views, scenes and command lines that are
//! copied and saved.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use param::Choice as _;
use render::MOST_LIGHTS;
use scene::{Camera, ColorBy, Lighting, Mirror, Object, Projection, SceneFile, Settings, Shape, StandardView};
use serde_json::json;

use super::bindings::{Action, Handles, Mode};
use super::clouds::{CloudEntry, short_name};
use super::inspection::{Inspection, Ray, Surface, Target};
use super::lens::to_vector;
use super::light_panel;
use super::messages::Level;
use super::objects::{ObjectId, Objects, Placed};
use super::path_prompt::PathPrompt;
use super::render_thread::{Command, FrameRequest, PickPurpose};
use super::state::{Effect, State};
use super::work::Work;

/// Growth of splats and of the field of view per notch: seven notches double.
const STEP: f32 = 1.1;
/// Radians that a notch tilts the inspection mirror.
const TILT_STEP: f64 = 0.087;
/// Size of a mirror that is added, over the scene's radius: a tenth of the scene across.
const MIRROR_SIZE: f64 = 0.1;
/// Pixels about the cursor that its sight line takes in: as when a point is picked.
const CAST_RADIUS: f64 = 4.0;

impl State {
    pub fn act(&mut self, action: Action) {
        match action {
            // Done where the gesture is: they need its extent.
            Action::Orbit | Action::Pan | Action::Look | Action::Fly(_) | Action::Fast | Action::Slow => {}
            Action::RawColors | Action::ShowTruth | Action::PasteView => {}
            Action::PinTruth => self.toggle_truth(),
            Action::ToggleChart => self.tuning.is_open = !self.tuning.is_open,
            Action::Zoom(notches) => self.zoom(notches),
            Action::PointSize(notches) => {
                self.settings.splat.size = scaled(&self.settings.splat, "size", self.settings.splat.size, notches);
            }
            Action::FieldOfView(notches) => {
                let view = &self.settings.view;
                self.settings.view.field_of_view = scaled(view, "field_of_view", view.field_of_view, notches);
            }
            Action::FlySpeed(notches) => {
                // Six doublings either way: from an ant's pace to a jet's.
                self.navigation.speed = (self.navigation.speed + notches * 0.5).clamp(-6.0, 6.0);
                self.messages.note(format!("Speed × {:.2}", self.navigation.speed.exp2()));
            }
            Action::PivotHere => {
                if let Some(pixel) = self.cursor() {
                    self.render(Command::Pick { pixel, purpose: PickPurpose::Pivot });
                }
            }
            Action::Pick if self.inspection.is_some() => self.pin_inspection(),
            Action::Pick => {
                if let Some(pixel) = self.cursor() {
                    self.render(Command::Pick { pixel, purpose: PickPurpose::Select });
                }
            }
            Action::FrameAll => self.frame_all(),
            Action::LookFrom(view) => self.look_from(view),
            Action::ToggleMode => {
                self.mode = if self.mode == Mode::Orbit { Mode::Fly } else { Mode::Orbit };
                let text = if self.is_flying() { "Fly: drag to look, W A S D Q E to move" } else { "Orbit" };
                self.messages.note(text);
            }
            Action::ToggleProjection => {
                let projection = &mut self.settings.view.projection;
                *projection = match projection {
                    Projection::Perspective => Projection::Orthographic,
                    Projection::Orthographic => Projection::Perspective,
                };
            }
            Action::ColorBy(by) => self.color_by(by),
            Action::ToggleEdl => {
                let strength = &mut self.settings.edl.strength;
                *strength = if *strength > 0.0 { 0.0 } else { scene::Edl::default().strength };
            }
            Action::Open => self.effects.push(Effect::OpenDialog),
            Action::OpenPath => self.path_prompt = Some(PathPrompt::default()),
            Action::CopyView => {
                let text = SceneFile { clouds: Vec::new(), ..self.scene_file(&self.written_settings()) }.to_text();
                self.effects.push(Effect::Copy(text));
                self.messages.note("View copied as text");
            }
            Action::SaveScene => self.save_scene(),
            Action::AddMirror(shape) => self.add_mirror(shape),
            Action::Gizmo(handles) => {
                let shown = &mut self.gizmo.handles;
                *shown = if *shown == handles { Handles::All } else { handles };
            }
            Action::Duplicate => self.duplicate(),
            Action::Delete => {
                if let Some(id) = self.selected.take() {
                    self.edit_objects(|objects| objects.remove(id));
                }
            }
            Action::AddSpot => self.add_spot(),
            Action::NextLight => {
                let next = (self.settings.light.by as u32 + 1) % Lighting::NAMES.len() as u32;
                self.light_by(Lighting::from_index(next).unwrap_or(Lighting::Auto));
            }
            Action::ToggleLight => {
                let is_lit = self.settings.light.by != Lighting::Colors;
                self.light_by(if is_lit { Lighting::Colors } else { self.lit_by });
            }
            Action::Inspect => self.toggle_inspection(),
            Action::InspectDistance(notches) => {
                if let Some(held) = &mut self.inspection {
                    held.distance = (held.distance * f64::from(STEP.powf(notches))).clamp(0.005, 0.9);
                }
            }
            Action::InspectTilt(notches) => {
                if let Some(held) = &mut self.inspection {
                    held.tilt = (held.tilt + TILT_STEP * f64::from(notches)).clamp(-3.0, 3.0);
                }
            }
            Action::CopyCommandLine => {
                self.effects.push(Effect::Copy(self.command_line()));
                self.messages.note("Command line copied");
            }
            Action::Undo => {
                let done = self.history.undo(&mut self.settings, &mut self.objects, &mut self.camera);
                self.after_history(done, "Nothing to undo");
            }
            Action::Redo => {
                let done = self.history.redo(&mut self.settings, &mut self.objects, &mut self.camera);
                self.after_history(done, "Nothing to redo");
            }
            Action::PickTool => self.pick_tool = !self.pick_tool,
            Action::EndTool => self.end_tool(),
            Action::ToggleInterface => self.interface_is_hidden = !self.interface_is_hidden,
            Action::ToggleFullScreen => {
                self.is_full_screen = !self.is_full_screen;
                self.effects.push(Effect::SetFullScreen(self.is_full_screen));
            }
            Action::SavePicture => self.save_picture(),
            Action::StopLoading => self.stop_loading(),
            Action::Quit => self.wants_to_quit = true,
            Action::ToggleShortcuts => self.shortcuts_are_open = !self.shortcuts_are_open,
        }
    }

    fn after_history(&mut self, done: bool, otherwise: &str) {
        if done {
            self.navigation.camera_moved(self.now);
            let Objects { mirrors, lights, .. } = &self.objects;
            self.log(json!({ "event": "history", "mirrors": mirrors.len(), "lights": lights.len() }));
        } else {
            self.messages.note(otherwise);
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
        self.messages.note(format!("Colour: {}", by.name()));
    }

    /// Esc: closes what lies on top, else ends the tool, else clears the picks.
    fn end_tool(&mut self) {
        if self.shortcuts_are_open {
            self.shortcuts_are_open = false;
        } else if self.path_prompt.is_some() {
            self.path_prompt = None;
        } else if self.inspection.is_some() {
            self.inspection = None;
            self.navigation.camera_moved(self.now);
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

    /// A view as `CopyView` gives it, or a scene file's.
    pub fn paste_view(&mut self, text: &str) {
        match SceneFile::parse(text) {
            Ok(file) => {
                let view = file.view();
                for warning in view.warnings {
                    self.messages.warning(format!("pasted view: {warning}"));
                }
                self.jump(view.settings, view.camera.unwrap_or(self.camera));
                self.take_objects(&file);
                self.messages.note("View pasted");
                self.log(json!({ "event": "pasted" }));
            }
            Err(error) => self.messages.error(format!("The clipboard holds no view: {error}")),
        }
    }

    /// Mirrors, lights and hidden classes of a view: mirrors whose names are known move there, others are added; lights take the
    /// place of all that there were, and the classes that it hides alone are hidden.
    fn take_objects(&mut self, file: &SceneFile) {
        for mirror in &file.mirrors {
            let known = self.objects.mirrors.iter_mut().find(|placed| placed.mirror.name == mirror.name);
            match known {
                Some(known) => known.mirror = mirror.clone(),
                None => {
                    let id = self.next_object_id();
                    self.objects.mirrors.push(Placed { id, mirror: mirror.clone(), input: None });
                }
            }
        }
        if !file.lights.is_empty() {
            self.objects.lights.clear();
            for light in &file.lights {
                let id = self.next_object_id();
                self.objects.add(id, Object::Light(*light));
            }
            self.warn_of_dark_lights();
        }
        self.objects.visibility = file.visibility.clone();
        self.history.after_jump(&self.settings, &self.objects);
    }

    /// What is on the screen as a scene, with these of its parameters.
    fn scene_file(&self, settings: &Settings) -> SceneFile {
        SceneFile {
            camera: Some(self.camera),
            parameters: SceneFile::new(Vec::new(), self.camera, settings).parameters,
            ..self.objects.scene_file(&self.inputs())
        }
    }

    /// The parameters that show what is on the screen when it is opened anew. Without lights, the one that a built-in scene
    /// brings or the lamp of a room would be there again.
    pub(super) fn written_settings(&self) -> Settings {
        let mut settings = self.settings.clone();
        if self.objects.lights.is_empty() && self.lacks_light() {
            settings.light.by = self.lighting();
        }
        settings
    }

    /// What is on the screen as a scene file that may stand anywhere, with these of its parameters: only built-in scenes have no
    /// place of their own.
    fn movable_scene(&self, settings: &Settings) -> SceneFile {
        let mut file = self.scene_file(settings);
        let clouds = file.clouds.iter_mut().chain(file.mirror_points.iter_mut().map(|points| &mut points.cloud));
        for cloud in clouds.filter(|cloud| Path::new(cloud).is_file()) {
            if let Ok(path) = std::path::absolute(&*cloud) {
                *cloud = path.display().to_string();
            }
        }
        file
    }

    /// The same without parameters but for those that points are made with.
    pub(super) fn view_as_scene(&self) -> String {
        let settings = Settings { scene: self.settings.scene.clone(), ..Settings::default() };
        self.movable_scene(&settings).to_text()
    }

    fn save_scene(&mut self) {
        let file = self.movable_scene(&self.written_settings());
        if file.clouds.is_empty() {
            self.messages.note("There is no scene to save yet");
            return;
        }
        let name = self.inputs().first().map_or("scene".into(), |input| picture_name(input));
        let path = free_path(Path::new(""), &name, "toml");
        let file = SceneFile { paths: self.paths.clone(), ..file };
        self.effects.push(Effect::Work(Work::SaveScene { path, text: file.to_text() }));
    }

    /// The command that renders what is on the screen, for a POSIX shell.
    pub fn command_line(&self) -> String {
        let [width, height] = self.view_size;
        let file = self.scene_file(&Settings::default());
        // What begins like a flag is none as a path.
        let path = |input: &String| if input.starts_with('-') { format!("./{input}") } else { input.clone() };
        let inputs: Vec<String> = file.clouds.iter().map(|input| quoted(&path(input))).collect();
        let mut line = format!("glint render {} -o glint.png --size {width}x{height}", inputs.join(" "));
        for (key, text) in self.written_settings().differing() {
            line += &format!(" --set {}", quoted(&format!("{key}={text}")));
        }
        let view = SceneFile { clouds: Vec::new(), ..file }.to_text();
        // A name in the view may have a line that would end it.
        let end = (1..).map(|number| format!("VIEW{number}")).find(|end| !view.lines().any(|line| line == *end));
        let end = end.unwrap_or_default();
        format!("{line} --camera - <<'{end}'\n{view}{end}\n")
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
            return self.messages.note(format!("There are {} {}s, and no room for more", kind.most, kind.name));
        }
        let (position, is_light) = (object.places()[0].to_array(), matches!(object, Object::Light(_)));
        self.history.settle(&self.settings, &self.objects);
        if is_light && self.settings.light.by != Lighting::Auto {
            self.settings.light.by = Lighting::Lights;
        }
        self.objects.add(id, object);
        self.history.settle(&self.settings, &self.objects);
        let name = self.objects.get(id).map(|(name, _)| name);
        self.log(json!({ "event": kind.name, "name": name, "position": position }));
        self.navigation.camera_moved(self.now);
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
        self.messages.note(if by == Lighting::Colors {
            "Data colours, no light".into()
        } else {
            format!("Light: {name}")
        });
    }

    /// Adds a spot light where the eye is.
    fn add_spot(&mut self) {
        let light = light_panel::spot(self.camera.eye, self.camera.pivot, self.settings.view.field_of_view);
        let id = self.next_object_id();
        self.place(id, Object::Light(light));
    }

    /// Says so after lights came of which not all shine.
    pub(super) fn warn_of_dark_lights(&mut self) {
        if self.objects.lights.len() > MOST_LIGHTS {
            self.say(Level::Warning, format!("Only the first {MOST_LIGHTS} lights shine"));
        }
    }

    /// Moves the camera to `eye`, looking at `pivot`.
    pub fn look_along(&mut self, eye: DVec3, pivot: DVec3) {
        let camera = Camera::looking(pivot, eye - pivot, eye.distance(pivot), self.camera.up);
        self.jump(self.settings.clone(), camera);
    }

    fn toggle_inspection(&mut self) {
        if self.inspection.take().is_some() {
            self.navigation.camera_moved(self.now);
            return;
        }
        if !self.clouds.is_empty() {
            let id = self.next_object_id();
            self.inspection = Some(Inspection::new(id));
            self.selected = None;
            self.messages.note("Inspection mirror: Ctrl+wheel distance, Ctrl+Shift+wheel tilt, click pins it");
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
            self.navigation.camera_moved(self.now);
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
        self.effects.push(Effect::Work(Work::Cast(ray)));
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
            self.navigation.camera_moved(self.now);
        }
    }

    fn save_picture(&mut self) {
        let Some(shown) = &self.frames.shown else {
            self.messages.note("There is no picture to save yet");
            return;
        };
        let request = FrameRequest { camera: self.camera, size: self.view_size, ..shown.request.clone() };
        let request = request.unhurried(&self.settings);
        let name = self.inputs().first().map_or("scene".into(), |input| picture_name(input));
        let path = free_path(Path::new(""), &name, "png");
        self.render(Command::Save { request: Box::new(request), path });
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

/// For a POSIX shell: in single quotes unless it is plain.
fn quoted(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=+,:@%".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        return text.to_string();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// `office` of `scans/office.laz`, `five-mirrors-sphere` of a built-in scene.
fn picture_name(input: &str) -> String {
    let name = short_name(input);
    if name.contains('/') {
        return name.replace('/', "-");
    }
    Path::new(name).file_stem().map_or(name.into(), |stem| stem.to_string_lossy().into_owned())
}

/// `glint-NAME-1.png`, or the first number that is free.
fn free_path(folder: &Path, name: &str, extension: &str) -> PathBuf {
    let path = |number: u32| folder.join(format!("glint-{name}-{number}.{extension}"));
    (1..u32::MAX).map(path).find(|path| !path.exists()).unwrap_or_else(|| path(0))
}

#[cfg(test)]
mod tests {
    use scene::MOST_MIRRORS;

    use super::super::preferences::Preferences;
    use super::*;

    #[test]
    fn a_view_that_is_copied_and_pasted_elsewhere_is_the_same() {
        let mut one = State::new(Preferences::default());
        one.camera.orbit(0.3, 0.2);
        one.settings.splat.size = 2.5;
        one.act(Action::CopyView);
        let Some(Effect::Copy(text)) = one.effects.pop() else { panic!("nothing was copied") };
        let mut other = State::new(Preferences::default());
        other.paste_view(&text);
        assert_eq!(other.settings, one.settings);
        assert!(other.camera.eye.distance(one.camera.eye) < 1e-9);
        other.act(Action::Undo);
        assert_eq!(other.settings, Settings::default());
    }

    #[test]
    fn hidden_classes_are_copied_saved_and_pasted_and_a_view_that_shows_all_shows_them_again() {
        let mut one = State::with_two_points();
        let view = |state: &mut State| {
            state.act(Action::CopyView);
            let Some(Effect::Copy(text)) = state.effects.pop() else { panic!("nothing was copied") };
            text
        };
        let all = view(&mut one);
        one.show_classes([7, 18], false);
        let hiding = view(&mut one);
        assert!(hiding.contains("hidden_classes = [7, 18]"), "{hiding}");
        assert!(one.command_line().contains("hidden_classes = [7, 18]"), "{}", one.command_line());
        assert!(one.view_as_scene().contains("hidden_classes = [7, 18]"));
        let mut other = State::new(Preferences::default());
        other.paste_view(&hiding);
        assert_eq!(other.objects.visibility, one.objects.visibility);
        one.paste_view(&all);
        assert!(one.objects.visibility.shows_all());
        one.act(Action::Undo);
        assert_eq!(one.objects.visibility, other.objects.visibility);
        one.act(Action::Undo);
        assert!(one.objects.visibility.shows_all());
        one.act(Action::Redo);
        assert_eq!(one.objects.visibility, other.objects.visibility);
        one.remove_cloud(one.clouds[0].key);
        assert!(one.objects.visibility.shows_all(), "what is hidden goes with the last cloud");
    }

    #[test]
    fn text_that_is_no_view_is_refused_and_changes_nothing() {
        let mut state = State::new(Preferences::default());
        let before = state.camera;
        state.paste_view("hello");
        assert_eq!(state.camera, before);
        assert!(state.messages.all.last().is_some_and(|message| message.text.contains("no view")));
    }

    /// Runs the copied command line by `sh`, with a `glint` that keeps its words and its standard input.
    #[cfg(unix)]
    fn run_by_shell(line: &str) -> (Vec<String>, String) {
        let folder = tempfile::tempdir().unwrap();
        let keep = "glint() { printf '%s\\0' \"$@\" > words; cat > input; }\n";
        let mut shell = std::process::Command::new("sh");
        let output = shell.arg("-c").arg(keep.to_owned() + line).current_dir(folder.path()).output().unwrap();
        assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
        assert!(output.stdout.is_empty(), "{output:?}");
        let words = std::fs::read_to_string(folder.path().join("words")).unwrap();
        let words = words.split_terminator('\0').map(str::to_owned).collect();
        (words, std::fs::read_to_string(folder.path().join("input")).unwrap())
    }

    #[cfg(unix)]
    #[test]
    fn the_copied_command_line_is_what_the_shell_runs() {
        use clap::Parser as _;

        use crate::command_line::{Command, CommandLine};

        let mut state = State::new(Preferences::default());
        state.settings.set_text("color.attribute", "it's; $(echo no) `no`").unwrap();
        state.camera.pivot = glam::DVec3::new(1.25, -2.0, 635_619.123_456_7);
        let mut mirror = Mirror::standing(Shape::Sphere, glam::DVec3::ZERO, glam::DVec3::Z, glam::DVec3::Z, 1.0);
        // Would end the view and go on as commands.
        mirror.name = "a\nVIEW1\nVIEW\necho broken out\n".into();
        let id = state.next_object_id();
        state.place(id, Object::Mirror(mirror.clone()));
        let (words, input) = run_by_shell(&state.command_line());
        let Some(Command::Render(arguments)) = CommandLine::try_parse_from(
            ["glint".to_owned(), "render".into(), "a.laz".into()].into_iter().chain(words[1..].iter().cloned()),
        )
        .unwrap()
        .command
        else {
            panic!("not a render command")
        };
        assert_eq!(arguments.camera.as_deref(), Some("-".as_ref()));
        assert!(
            arguments.set.contains(&("color.attribute".into(), "it's; $(echo no) `no`".into())),
            "{:?}",
            arguments.set
        );
        let view =
            SceneFile::parse(&scene::whole_file::read_from(input.as_bytes(), "standard input").unwrap()).unwrap();
        assert_eq!(view.camera.map(|camera| camera.pivot), Some(state.camera.pivot));
        assert_eq!(view.mirrors[0].name, mirror.name.trim());
    }

    #[test]
    fn mirrors_are_added_up_to_the_number_that_a_scene_may_have() {
        let mut state = State::new(Preferences::default());
        for _ in 0..MOST_MIRRORS + 2 {
            state.add_mirror(Shape::Sphere);
        }
        assert_eq!(state.objects.mirrors.len(), MOST_MIRRORS);
        assert!(state.messages.all.last().is_some_and(|message| message.text.contains("64 mirrors")));
    }

    #[test]
    fn names_with_blanks_and_quotes_survive_the_shell() {
        assert_eq!(quoted("a/b.laz"), "a/b.laz");
        assert_eq!(quoted("my scan.laz"), "'my scan.laz'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted("view.background=#ffffff"), "'view.background=#ffffff'");
    }

    #[test]
    fn point_size_and_field_of_view_stop_at_their_ranges() {
        let mut state = State::new(Preferences::default());
        for _ in 0..200 {
            state.act(Action::PointSize(1.0));
            state.act(Action::FieldOfView(-1.0));
        }
        assert_eq!((state.settings.splat.size, state.settings.view.field_of_view), (20.0, 1.0));
    }

    #[test]
    fn pictures_never_overwrite_one_another() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("glint-office-1.png"), "").unwrap();
        assert!(free_path(folder.path(), "office", "png").ends_with("glint-office-2.png"));
        assert!(free_path(folder.path(), "office", "toml").ends_with("glint-office-1.toml"));
        assert_eq!(picture_name("scans/office.laz"), "office");
        assert_eq!(picture_name("office.laz"), "office");
        assert_eq!(picture_name("five-mirrors/sphere"), "five-mirrors-sphere");
    }
}
