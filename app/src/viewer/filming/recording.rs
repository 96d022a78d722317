//! A recording that the window asks for: its dialog, its progress, and its end.

use std::path::Path;
use std::sync::PoisonError;
use std::time::Instant;

use serde_json::json;

use crate::shared::language::text;
use crate::system::film::folder_of;
use crate::system::progress_bar::Stage;
use crate::viewer::jobs::process::{Ended, Leash};
use crate::viewer::loaded::Loaded;
use crate::viewer::requests::file_names::free_path;
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::{Outside, whole};
use crate::viewer::requests::recording::Wanted;
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;

#[derive(Default)]
pub struct Recording {
    /// The dialog, while it is open.
    pub asked: Option<Wanted>,
    /// What was asked for last, if it was stopped.
    stopped: Option<Wanted>,
    pub under_way: Option<UnderWay>,
}

pub struct UnderWay {
    pub wanted: Wanted,
    pub stage: Option<Stage>,
    /// When the stage began, and what of it was done then.
    since: (Instant, u64),
    leash: Leash,
    pub is_stopping: bool,
}

impl UnderWay {
    /// The pictures, or points, that are done in a second of the stage, if that is known.
    pub fn rate(&self, now: Instant) -> Option<f64> {
        let (stage, (since, before)) = (self.stage.as_ref()?, self.since);
        let done = stage.done.checked_sub(before).filter(|done| *done > 0)?;
        let passed = now.saturating_duration_since(since).as_secs_f64();
        Some(done as f64 / passed).filter(|rate| rate.is_finite())
    }

    /// The seconds that are left of the stage, if its pace is known.
    pub fn seconds_left(&self, now: Instant) -> Option<f64> {
        let (stage, rate) = (self.stage.as_ref()?, self.rate(now)?);
        Some(stage.total.saturating_sub(stage.done) as f64 / rate)
    }
}

impl Recording {
    /// Opens the dialog for a path of the scene. A recording of it that was stopped is asked for as before, so that it goes
    /// on.
    pub fn ask(&mut self, path: &str, scene: &Scene) {
        let stopped = self.stopped.clone().filter(|wanted| wanted.path == path);
        let kept = self.asked.take().or(stopped);
        let kept = kept.map(|wanted| Wanted { path: path.to_owned(), is_shown: false, ..wanted });
        let name: String = path.chars().map(|letter| if letter.is_alphanumeric() { letter } else { '-' }).collect();
        let output = free_path("".as_ref(), &name, "mp4").display().to_string();
        // Sides of films are even numbers of pixels.
        let size = scene.view_size.map(|side| (side & !1).max(16));
        let (subframes, shutter, supersample) = (1, 0.5, 1);
        self.asked = Some(kept.unwrap_or(Wanted {
            path: path.to_owned(),
            output,
            size,
            fps: 30,
            frames: [0, 0],
            is_h264: false,
            subframes,
            shutter,
            supersample,
            is_shown: false,
        }));
    }

    /// Begins what the dialog asks for.
    pub fn start(&mut self, scene: &Scene, loaded: &Loaded, adapter: Option<&str>, outside: &mut Outside) {
        if self.under_way.is_some() {
            return outside.note(text!("A recording is under way"));
        }
        let Some(wanted) = self.asked.take() else { return };
        let file = scene.whole_file(loaded);
        if file.clouds.is_empty() {
            return outside.note(text!("There is no scene to record yet"));
        }
        let leash = Leash::default();
        let words = wanted.words(adapter);
        outside.log(json!({ "event": "recording", "output": wanted.output }));
        outside.work(Work::Record { scene: file.to_text(), words, leash: leash.clone() });
        let since = (outside.now, 0);
        self.under_way = Some(UnderWay { wanted, stage: None, since, leash, is_stopping: false });
    }

    pub fn stop(&mut self) {
        if let Some(under_way) = &mut self.under_way {
            under_way.is_stopping = true;
            under_way.leash.lock().unwrap_or_else(PoisonError::into_inner).take();
        }
    }

    pub fn on_stage(&mut self, stage: Stage, outside: &Outside) {
        if let Some(under_way) = &mut self.under_way {
            if under_way.stage.as_ref().is_none_or(|before| before.task != stage.task) {
                under_way.since = (outside.now, stage.done);
            }
            under_way.stage = Some(stage);
        }
    }

    pub fn on_end(&mut self, ended: Ended, outside: &mut Outside) {
        let Some(UnderWay { wanted, .. }) = self.under_way.take() else { return };
        let output = wanted.output.clone();
        outside.log(json!({ "event": "recorded", "output": output, "ended": format!("{ended:?}") }));
        self.stopped = matches!(ended, Ended::Stopped).then_some(wanted);
        match ended {
            Ended::Done(told) => {
                let told = with_whole_paths(told, output.as_ref());
                outside.note(text!("Recorded: {told}", told));
            }
            Ended::Stopped => outside.note(text!(
                "Recording stopped; what is done of {output} stays, and the same recording goes on from there",
                output
            )),
            Ended::Failed(problem) => outside.say(Level::Error, text!("Recording: {problem}", problem)),
        }
    }
}

/// What the command has printed, which names its pictures and its film as they were given.
fn with_whole_paths(told: String, output: &Path) -> String {
    [output, &folder_of(output)]
        .into_iter()
        .fold(told, |told, path| told.replace(&format!(" in {}", path.display()), &format!(" in {}", whole(path))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_says_where_its_pictures_and_its_film_are() {
        let here = std::env::current_dir().unwrap();
        let whole = |name: &str| here.join(name).display().to_string();
        let told = "10 pictures in tour.frames, 3 of them were there; 10 pictures in tour.mp4";
        let (pictures, film) = (whole("tour.frames"), whole("tour.mp4"));
        let expected = format!("10 pictures in {pictures}, 3 of them were there; 10 pictures in {film}");
        assert_eq!(with_whole_paths(told.to_owned(), Path::new("tour.mp4")), expected);
        let folder = format!("10 pictures in {}", whole("tour"));
        assert_eq!(with_whole_paths("10 pictures in tour".to_owned(), Path::new("tour")), folder);
    }
}
