//! What the user copies, pastes and saves: views, scenes, pictures and command lines.

use std::path::{Path, PathBuf};

use scene::{Object, SceneFile, Settings, Shape};
use serde_json::json;

use crate::overlays::Facts;
use crate::shared::command_line::quoted;
use crate::shared::language::text;
use crate::viewer::frames::Frames;
use crate::viewer::jobs::study_file::{STUDY, group_of};
use crate::viewer::loaded::Loaded;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::objects::{OwnSettings, Placed, PlacedClip};
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::requests::action::PictureDraft;
use crate::viewer::requests::file_names::{free_path, picture_name};
use crate::viewer::requests::outside::{Effect, Outside};
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;

impl Scene {
    /// Adds the current setting to the plan in the current folder, and writes the view as a scene file beside it.
    pub fn add_to_study(&self, loaded: &Loaded, outside: &mut Outside) {
        if loaded.clouds.is_empty() {
            outside.note(text!("There is no setting to add yet"));
            return;
        }
        // The path is absolute because a plan may be run from any folder.
        let folder = std::env::current_dir().unwrap_or_default();
        let group = group_of(&self.written_settings(loaded), self.view_size);
        let scene = self.view_as_scene(loaded, &folder);
        outside.work(Work::AddToStudy { plan: folder.join(STUDY), scene, group });
    }

    pub fn copy_view(&self, loaded: &Loaded, outside: &mut Outside) {
        outside.push(Effect::Copy(self.view_as_text(loaded)));
        outside.note(text!("View copied as text"));
    }

    /// Returns the view as text, without its clouds.
    pub fn view_as_text(&self, loaded: &Loaded) -> String {
        let mut inputs: Vec<String> = loaded.clouds.iter().map(|entry| entry.input.clone()).collect();
        inputs.dedup();
        SceneFile { clouds: Vec::new(), ..self.scene_file_of(&inputs, &self.written_settings(loaded)) }.to_text()
    }

    /// Applies a view that `CopyView` copied, or that of a scene file.
    pub fn paste_view(&mut self, text: &str, clouds: &[CloudEntry], outside: &mut Outside) {
        match SceneFile::parse(text) {
            Ok(file) => {
                let view = file.view();
                for warning in view.warnings {
                    outside.warning(text!("pasted view: {warning}", warning));
                }
                self.jump(outside.now, view.settings, view.camera.unwrap_or(self.camera));
                self.take_objects(&file, clouds, outside);
                outside.note(text!("View pasted"));
                outside.log(json!({ "event": "pasted" }));
            }
            Err(error) => outside.error(text!("The clipboard holds no view: {error}", error)),
        }
    }

    /// Takes over the mirrors, lights, clips and visibility of a view. A mirror replaces the one of the same name, or
    /// is added. The view's lights, if it has any, replace all others. Its clips and visibility replace those before.
    /// So does what it says of single clouds. Its measurements, notes and profiles are added.
    fn take_objects(&mut self, file: &SceneFile, clouds: &[CloudEntry], outside: &mut Outside) {
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
            self.warn_of_dark_lights(outside);
        }
        self.objects.own_settings.clear();
        for entry in clouds {
            let own = file.cloud_settings.iter().find(|own| own.is_of(&entry.input, &entry.cloud.name));
            if let Some(settings) = own.cloned() {
                self.objects.set_own(OwnSettings { key: entry.key, input: entry.input.clone(), settings });
            }
        }
        self.objects.visibility = file.visibility.clone();
        self.objects.clips.clear();
        for clip in &file.clips {
            let id = self.next_object_id();
            self.objects.clips.push(PlacedClip { id, clip: clip.clone() });
        }
        self.add_objects(file.marks());
        self.history.after_jump(&self.settings, &self.objects);
    }

    /// Returns what is on the screen as a scene, with the parameters of `settings`.
    fn scene_file(&self, settings: &Settings, loaded: &Loaded) -> SceneFile {
        self.scene_file_of(&loaded.inputs(), settings)
    }

    fn scene_file_of(&self, inputs: &[String], settings: &Settings) -> SceneFile {
        SceneFile {
            camera: Some(self.camera),
            parameters: SceneFile::new(Vec::new(), self.camera, settings).parameters,
            ..self.objects.scene_file(inputs)
        }
    }

    /// Returns the parameters that a scene file needs to show the same picture. If the user removed all lights, they
    /// name the kind of lighting, because otherwise the built-in scene's light or the guessed lamp would come back.
    pub fn written_settings(&self, loaded: &Loaded) -> Settings {
        self.naming_light(self.settings.clone(), loaded)
    }

    /// Returns parameters that name the kind of lighting, if all lights were removed.
    fn naming_light(&self, mut settings: Settings, loaded: &Loaded) -> Settings {
        if self.objects.lights.is_empty() && loaded.lacks_light() {
            settings.light.by = loaded.lighting(self);
        }
        settings
    }

    /// Returns what is on the screen as a scene file that may lie in any folder: the paths of files are absolute. Names
    /// of built-in scenes stay as they are.
    fn movable_scene_of(&self, inputs: &[String], settings: &Settings) -> SceneFile {
        let mut file = self.scene_file_of(inputs, settings);
        let built_in = world::built_in_names();
        let is_there = |name: &&mut String| !built_in.contains(name) && Path::new(name.as_str()).exists();
        for name in named_files(&mut file).filter(is_there) {
            if let Ok(path) = std::path::absolute(&*name) {
                *name = path.display().to_string();
            }
        }
        file
    }

    /// Returns everything that a scene file holds as text. `inputs` are all clouds of the scene. In a file for `folder`,
    /// the names of files in that folder are relative to it, so that both may be moved together.
    ///
    /// # Errors
    /// Several scenes that are open have more objects together than one file may have: says of what.
    pub fn session_text(&self, inputs: &[String], loaded: &Loaded, folder: Option<&Path>) -> Result<String, String> {
        let mut file = self.whole_file_of(inputs, &self.naming_light(self.settings_to_save(), loaded));
        file.mirror_points.extend(loaded.awaited_markings.iter().cloned());
        file.cloud_settings.extend(loaded.settings_of_absent().cloned());
        if let Some(folder) = folder {
            name_from(&mut file, folder);
        }
        file.problem().map_or_else(|| Ok(file.to_text()), Err)
    }

    /// Returns the scene as the text of a file for `folder`. Of the parameters it has only those that built-in scenes are
    /// made with.
    pub fn view_as_scene(&self, loaded: &Loaded, folder: &Path) -> String {
        let settings = Settings { scene: self.settings.scene.clone(), ..Settings::default() };
        let mut file = self.movable_scene_of(&loaded.inputs(), &settings);
        name_from(&mut file, folder);
        file.to_text()
    }

    /// Returns everything that is kept of the scene.
    pub fn whole_file(&self, loaded: &Loaded) -> SceneFile {
        self.whole_file_of(&loaded.inputs(), &self.written_settings(loaded))
    }

    fn whole_file_of(&self, inputs: &[String], settings: &Settings) -> SceneFile {
        let mut file = self.movable_scene_of(inputs, settings);
        self.marks().for_each(|mark| file.add(mark));
        let (bookmarks, paths) = (self.objects.bookmarks.clone(), self.objects.paths.clone());
        SceneFile { bookmarks, paths, ..file }
    }

    /// What is drawn over the picture: measurements, notes and profiles, switched on or off.
    fn marks(&self) -> impl Iterator<Item = Object> + '_ {
        self.objects.all().map(|(.., object)| object).filter(|object| object.kind().is_over_picture)
    }

    pub fn copy_command_line(&self, loaded: &Loaded, outside: &mut Outside) {
        outside.push(Effect::Copy(self.command_line(loaded)));
        outside.note(text!("Command line copied"));
    }

    /// Returns the command that renders what is on the screen, for a POSIX shell.
    pub fn command_line(&self, loaded: &Loaded) -> String {
        let [width, height] = self.view_size;
        let file = self.scene_file(&Settings::default(), loaded);
        // A path that begins with `-` would be read as a flag.
        let path = |input: &String| if input.starts_with('-') { format!("./{input}") } else { input.clone() };
        let inputs: Vec<String> = file.clouds.iter().map(|input| quoted(&path(input))).collect();
        let mut line = format!("glint render {} -o glint.png --size {width}x{height}", inputs.join(" "));
        let mut settings = self.written_settings(loaded);
        // The window shows them always.
        settings.overlay.labels |= self.marks().any(|mark| mark.is_on());
        for (key, text) in settings.differing() {
            line += &format!(" --set {}", quoted(&format!("{key}={text}")));
        }
        let mut view = SceneFile { clouds: Vec::new(), ..file };
        self.marks().filter(Object::is_on).for_each(|mark| view.add(mark));
        let view = view.to_text();
        // The names in a view may contain any line, so the end mark must be one that the view does not contain.
        let end = (1..).map(|number| format!("VIEW{number}")).find(|end| !view.lines().any(|line| line == *end));
        let end = end.unwrap_or_default();
        format!("{line} --camera - <<'{end}'\n{view}{end}\n")
    }

    /// What is proposed for a picture that a person gives a name: the next free name, in the size of the window.
    pub fn picture_draft(&self, loaded: &Loaded) -> PictureDraft {
        let path = std::path::absolute(free_picture(loaded)).unwrap_or_else(|_| free_picture(loaded));
        PictureDraft { path: path.display().to_string(), size: self.view_size, is_shown: false }
    }

    /// Saves the picture: as it is shown and under a free name, or as a person has asked for it. Returns whether there is
    /// one that can be saved.
    pub fn save_picture(
        &self,
        draft: Option<&PictureDraft>,
        frames: &Frames,
        loaded: &Loaded,
        facts: Facts,
        outside: &mut Outside,
    ) -> bool {
        let Some(shown) = &frames.shown else {
            outside.note(text!("There is no picture to save yet"));
            return false;
        };
        if self.posed.as_ref().is_some_and(|posed| posed.is_wiped) {
            outside.note(text!("This picture shows several states: Record… in the timeline saves it"));
            return false;
        }
        let size = draft.map_or(self.view_size, |draft| draft.size);
        let request = FrameRequest { camera: self.camera, size, ..shown.request.clone() };
        let request = request.unhurried(&self.settings);
        let path = draft.map_or_else(|| free_picture(loaded), |draft| draft.place().into());
        outside.save_picture(request, path, facts);
        true
    }
}

/// The names of files in a scene file: of clouds, and of meshes.
fn named_files(file: &mut SceneFile) -> impl Iterator<Item = &mut String> {
    let clouds = file.clouds.iter_mut().chain(file.mirror_points.iter_mut().map(|points| &mut points.cloud));
    let clouds = clouds.chain(file.cloud_settings.iter_mut().map(|own| &mut own.cloud));
    let meshes = file.mirrors.iter_mut().filter_map(|mirror| match &mut mirror.shape {
        Shape::Mesh(mesh) if mesh.is_file() => Some(&mut mesh.name),
        _ => None,
    });
    clouds.chain(meshes)
}

/// Makes the names of files in a folder relative to it.
fn name_from(file: &mut SceneFile, folder: &Path) {
    for name in named_files(file) {
        let beside = Path::new(&*name).strip_prefix(folder).ok().and_then(Path::to_str);
        // The folder itself would have no name.
        if let Some(beside) = beside.filter(|beside| !beside.is_empty()) {
            *name = beside.to_owned();
        }
    }
}

/// Returns the next free name of a picture of what is open.
fn free_picture(loaded: &Loaded) -> PathBuf {
    let name = loaded.inputs().first().map_or("scene".into(), |input| picture_name(input));
    free_path(Path::new(""), &name, "png")
}

#[cfg(test)]
mod tests {
    use scene::{Mirror, Note, Shape};

    use super::*;
    use crate::viewer::requests::action::Action;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::session::Session;

    #[test]
    fn files_are_named_from_the_folder_that_they_lie_in_but_the_folder_itself_keeps_its_name() {
        let names = ["/scans/a.laz", "/scans/tiles", "/scans", "/other/b.laz", "http://host/c.laz"];
        let mut file = SceneFile { clouds: names.map(str::to_owned).to_vec(), ..SceneFile::default() };
        name_from(&mut file, Path::new("/scans"));
        assert_eq!(file.clouds, ["a.laz", "tiles", "/scans", "/other/b.laz", "http://host/c.laz"]);
    }

    #[test]
    fn a_view_that_is_copied_and_pasted_elsewhere_is_the_same() {
        let mut one = Session::new(Preferences::default());
        one.scene.camera.orbit(0.3, 0.2);
        one.scene.settings.splat.size = 2.5;
        one.act(Action::CopyView);
        let Some(Effect::Copy(text)) = one.outside.effects.pop() else { panic!("nothing was copied") };
        let mut other = Session::new(Preferences::default());
        other.act(Action::Paste(text.to_string()));
        assert_eq!(other.scene.settings, one.scene.settings);
        assert!(other.scene.camera.eye.distance(one.scene.camera.eye) < 1e-9);
        other.act(Action::Undo);
        assert_eq!(other.scene.settings, Settings::default());
    }

    #[test]
    fn a_picture_is_being_saved_until_its_command_is_carried_out() {
        let mut session = Session::with_two_points();
        let request = session.picture();
        session.outside.save_picture(request, "folder/a.png".into(), Facts::default());
        let saving = |session: &Session| session.outside.saving().map(|path| path.to_path_buf()).collect::<Vec<_>>();
        assert_eq!(saving(&session), [PathBuf::from("folder/a.png")]);
        session.outside.effects.clear();
        assert!(saving(&session).is_empty());
    }

    #[test]
    fn hidden_classes_are_copied_saved_and_pasted_and_a_view_that_shows_all_shows_them_again() {
        let mut one = Session::with_two_points();
        let view = |session: &mut Session| {
            session.act(Action::CopyView);
            let Some(Effect::Copy(text)) = session.outside.effects.pop() else { panic!("nothing was copied") };
            text
        };
        let all = view(&mut one);
        one.scene.show_classes([7, 18], false, one.outside.now);
        let hiding = view(&mut one);
        assert!(hiding.contains("hidden_classes = [7, 18]"), "{hiding}");
        assert!(
            one.scene.command_line(&one.loaded).contains("hidden_classes = [7, 18]"),
            "{}",
            one.scene.command_line(&one.loaded)
        );
        assert!(one.scene.view_as_scene(&one.loaded, Path::new("")).contains("hidden_classes = [7, 18]"));
        let mut other = Session::new(Preferences::default());
        other.act(Action::Paste(hiding.to_string()));
        assert_eq!(other.scene.objects.visibility, one.scene.objects.visibility);
        one.act(Action::Paste(all.to_string()));
        assert!(one.scene.objects.visibility.shows_all());
        one.act(Action::Undo);
        assert_eq!(one.scene.objects.visibility, other.scene.objects.visibility);
        one.act(Action::Undo);
        assert!(one.scene.objects.visibility.shows_all());
        one.act(Action::Redo);
        assert_eq!(one.scene.objects.visibility, other.scene.objects.visibility);
        one.with_loaded(|loaded, beside| loaded.remove_cloud(loaded.clouds[0].key, beside));
        assert!(one.scene.objects.visibility.shows_all(), "what is hidden goes with the last cloud");
    }

    #[test]
    fn text_that_is_no_view_is_refused_and_changes_nothing() {
        let mut session = Session::new(Preferences::default());
        let before = session.scene.camera;
        session.act(Action::Paste("hello".to_string()));
        assert_eq!(session.scene.camera, before);
        assert!(session.outside.messages.all.last().is_some_and(|message| message.text.contains("no view")));
    }

    /// Runs the copied command line with `sh`. Returns the arguments and the standard input that `glint` would get.
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

        use crate::shared::command_line::{Command, CommandLine};

        let mut session = Session::new(Preferences::default());
        session.scene.settings.set_text("color.attribute", "it's; $(echo no) `no`").unwrap();
        session.scene.camera.pivot = glam::DVec3::new(1.25, -2.0, 635_619.123_456_7);
        let mut mirror = Mirror::standing(Shape::Sphere, glam::DVec3::ZERO, glam::DVec3::Z, glam::DVec3::Z, 1.0);
        // A name with the end mark would end the view, and the shell would run the rest.
        mirror.name = "a\nVIEW1\nVIEW\necho broken out\n".into();
        let id = session.scene.next_object_id();
        session.scene.edit_objects(session.outside.now, |objects| objects.add(id, Object::Mirror(mirror.clone())));
        for (text, on) in [("a crack", true), ("switched off", false)] {
            let note = Note { on, ..Note::new(text.into(), glam::DVec3::X, session.scene.camera) };
            let id = session.scene.next_object_id();
            session.scene.edit_objects(session.outside.now, |objects| objects.add(id, Object::Note(note)));
        }
        let (words, input) = run_by_shell(&session.scene.command_line(&session.loaded));
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
        assert_eq!(view.camera.map(|camera| camera.pivot), Some(session.scene.camera.pivot));
        assert_eq!(view.mirrors[0].name, mirror.name.trim());
        let notes: Vec<&str> = view.notes.iter().map(|note| note.text.as_str()).collect();
        assert_eq!(notes, ["a crack"], "what the picture shows");
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
