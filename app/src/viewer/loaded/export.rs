//! Writes the points that are shown to a new file, in the background. The files are read again, so streamed clouds are
//! written with all of their points and attributes.

use std::path::Path;
use std::sync::Arc;

use cloud::Progress;
use codec::Exported;
use serde_json::json;

use crate::shared::export::lack;
use crate::shared::language::text;
use crate::shared::numbers::grouped;
use crate::viewer::loaded::{Loaded, Writing};
use crate::viewer::requests::action::Export;
use crate::viewer::requests::file_names::free_path;
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::{Asked, Effect, Outside, whole};
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;

impl Loaded {
    pub fn export(&mut self, step: Export, scene: &Scene, outside: &mut Outside) {
        if let (Export::Ask | Export::To(_), Some(input)) = (&step, self.shown_in_part()) {
            // Files are read again by the words that opened them.
            let what = "some of its clouds are switched off; show all of them or none, and clip or filter the rest";
            return outside.error(text!("{input}: not saved: {what}", input, what));
        }
        if let (Export::Ask | Export::To(_), Err(error)) = (&step, self.check_unchanged()) {
            return outside.say(Level::Error, error);
        }
        match step {
            Export::Stop => self.writing.iter().for_each(|writing| writing.progress.cancel()),
            Export::Ask | Export::To(_) if self.writing.is_some() => {
                outside.note(text!("A file is being written already"))
            }
            Export::Ask => match self.inputs().first() {
                Some(input) => {
                    let stopped = self.clouds.iter().filter(|entry| entry.is_visible && entry.was_stopped);
                    for name in stopped.map(|entry| &entry.cloud.name) {
                        outside.warning(text!(
                            "{name}: its loading was stopped; the new file gets all points of the file",
                            name
                        ));
                    }
                    let name = Path::new(input).file_stem().unwrap_or_default().to_string_lossy().into_owned();
                    outside.push(Effect::AskPlace(Asked::Points, free_path(Path::new(""), &name, "laz")));
                }
                None => outside.note(text!("There are no points to save yet")),
            },
            Export::To(path) => {
                let progress = Arc::new(Progress::default());
                let (inputs, test, added) = (self.inputs(), scene.objects.test(), self.added_values());
                let lists = added.iter().map(|(.., list)| Arc::downgrade(list)).collect();
                self.writing = Some(Writing { path: path.clone(), progress: progress.clone(), added: lists });
                let own = scene.objects.all_own();
                let settings = Box::new(scene.settings.clone());
                outside.work(Work::Export { inputs, own, test, added, path, settings, progress });
            }
        }
    }

    /// Says which file of the shown clouds is another one than it was, and so are its points where it is read again.
    ///
    /// # Errors
    /// If there is one.
    pub fn check_unchanged(&self) -> Result<(), String> {
        let mut shown = self.clouds.iter().filter(|entry| entry.is_visible);
        shown.try_for_each(|entry| entry.check_unchanged()).map_err(|error| error.to_string())
    }

    /// The input of which some clouds are switched on and others off, if there is one: a folder has several.
    fn shown_in_part(&self) -> Option<&str> {
        let shown = self.clouds.iter().filter(|entry| entry.is_visible).map(|entry| entry.input.as_str());
        let mut hidden = self.clouds.iter().filter(|entry| !entry.is_visible).map(|entry| entry.input.as_str());
        hidden.find(|input| shown.clone().any(|other| other == *input))
    }

    /// Reports how an export ended; `None` if it was stopped.
    pub fn on_exported(&mut self, path: &Path, result: Result<Option<Exported>, String>, outside: &mut Outside) {
        let writing = self.writing.take();
        match result {
            Ok(Some(Exported { points, missing, changes, warnings, .. })) => {
                self.saved_values.extend(writing.into_iter().flat_map(|writing| writing.added));
                outside.log(json!({ "event": "exported", "path": path, "points": points }));
                outside.note(text!("{points} points saved: {path}", points = grouped(points), path = whole(path)));
                let lines = changes.into_iter().chain(param::few(warnings, "warnings"));
                lines.chain(lack(path, missing)).for_each(|warning| outside.warning(warning));
            }
            Ok(None) => outside.note(text!("Not saved: {path}", path = path.display())),
            Err(error) => {
                let input = scene::shown(path).to_string();
                // Some errors begin with the file's name.
                let what = error.strip_prefix(&format!("{input}: ")).unwrap_or(&error);
                outside.say(Level::Error, text!("{input}: not saved: {what}", input, what));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use world::{Event, Opened};

    use super::*;
    use crate::viewer::requests::action::Action;
    use crate::viewer::session::Session;

    #[test]
    fn a_folder_of_which_a_cloud_is_switched_off_is_not_saved_as_a_whole() {
        let mut session = Session::with_two_points();
        let job = session.loaded.add_job(&[], Default::default(), Default::default(), session.outside.now);
        let (name, input) = ("b".into(), "cloud.ply".into());
        let opened = Opened { name, input, expected_points: 1, up: DVec3::Z, ..Opened::default() };
        session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Opened { cloud: 0, opened }, beside));
        let key = session.loaded.clouds[1].key;
        let begins = |session: &mut Session| {
            session.outside.effects.clear();
            session.act(Action::Export(Export::To("a.laz".into())));
            session.loaded.writing = None;
            session.outside.effects.iter().any(|effect| matches!(effect, Effect::Work(Work::Export { .. })))
        };
        assert!(begins(&mut session));
        session.act(Action::ShowCloud(key, false));
        assert!(!begins(&mut session));
        let told = session.outside.messages.all.last().map(|message| message.text.as_str()).unwrap_or_default();
        assert!(told.starts_with("cloud.ply: not saved: some of its clouds are switched off"), "{told}");
        session.act(Action::ShowCloud(key, true));
        assert!(begins(&mut session));
    }

    #[test]
    fn it_is_said_that_a_cloud_whose_loading_was_stopped_is_saved_as_a_whole() {
        let mut session = Session::with_two_points();
        let name = session.loaded.clouds[0].cloud.name.clone();
        let warns = |session: &mut Session| {
            session.act(Action::Export(Export::Ask));
            let said = format!("{name}: its loading was stopped; the new file gets all points of the file");
            session.outside.messages.all.iter().any(|message| message.text == said)
        };
        assert!(!warns(&mut session));
        session.loaded.clouds[0].end(&codec::Summary { cancelled: true, ..Default::default() });
        assert!(warns(&mut session));
    }

    #[test]
    fn a_streamed_cloud_whose_file_was_written_to_is_not_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("b.xyz");
        std::fs::write(&path, "1 2 3\n4 5 6\n").unwrap();
        let files = Arc::new(vec![codec::open(&path).unwrap().bytes().named_file().unwrap()]);
        let mut session = Session::with_two_points();
        let job = session.loaded.add_job(&[], Default::default(), Default::default(), session.outside.now);
        let opened = Opened { name: "b".into(), files, expected_points: 2, up: DVec3::Z, ..Opened::default() };
        session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Opened { cloud: 0, opened }, beside));
        assert_eq!(session.loaded.check_unchanged(), Ok(()));
        std::fs::write(&path, "1 2 3\n").unwrap();
        session.outside.effects.clear();
        session.act(Action::Export(Export::To("a.laz".into())));
        assert!(!session.outside.effects.iter().any(|effect| matches!(effect, Effect::Work(_))));
        let told = session.outside.messages.all.last().map(|message| message.text.clone()).unwrap_or_default();
        assert!(told.ends_with("b.xyz: it has been changed since it was opened; open it again"), "{told}");
    }
}
