//! Writes the points that are shown to a new file, in the background. The files are read again, so streamed clouds are
//! written with all of their points and attributes.

use std::path::Path;
use std::sync::Arc;

use cloud::Progress;
use codec::Exported;
use serde_json::json;

use crate::viewer::action::Export;
use crate::viewer::loaded::{Loaded, Writing};
use crate::viewer::messages::Level;
use crate::viewer::outside::{Effect, Outside};
use crate::viewer::scene::Scene;
use crate::viewer::views::free_path;
use crate::viewer::work::Work;

impl Loaded {
    pub fn export(&mut self, step: Export, scene: &Scene, outside: &mut Outside) {
        match step {
            Export::Stop => self.writing.iter().for_each(|writing| writing.progress.cancel()),
            Export::Ask | Export::To(_) if self.writing.is_some() => outside.note("A file is being written already"),
            Export::Ask => match self.inputs().first() {
                Some(input) => {
                    let name = Path::new(input).file_stem().unwrap_or_default().to_string_lossy().into_owned();
                    outside.push(Effect::AskPlace(free_path(Path::new(""), &name, "laz")));
                }
                None => outside.note("There are no points to save yet"),
            },
            Export::To(path) => {
                let progress = Arc::new(Progress::default());
                self.writing = Some(Writing { path: path.clone(), progress: progress.clone() });
                outside.work(Work::Export { inputs: self.inputs(), test: scene.objects.test(), path, progress });
            }
        }
    }

    /// Tells how an export ended; `None` if it was stopped.
    pub fn on_exported(&mut self, path: &Path, result: Result<Option<Exported>, String>, outside: &mut Outside) {
        self.writing = None;
        match result {
            Ok(Some(Exported { points, warnings })) => {
                outside.log(json!({ "event": "exported", "path": path, "points": points }));
                outside.note(format!("{points} points saved: {}", path.display()));
                param::few(warnings, "warnings").into_iter().for_each(|warning| outside.warning(warning));
            }
            Ok(None) => outside.note(format!("Not saved: {}", path.display())),
            Err(error) => outside.say(Level::Error, error),
        }
    }
}
