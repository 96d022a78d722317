//! Kept views, and paths of the camera that are made and played in the window.

mod bookmarks;
pub mod presets;
mod recording;
mod timeline;
mod wiping;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

pub use bookmarks::Thumbnails;
use codec::Units;
use recording::Recording;
use scene::{CaptureFormat, Preferences, Settings};
use serde_json::json;
pub use timeline::Timeline;
pub use wiping::Wiping;

use crate::shared::language::text;
use crate::viewer::frames::Frames;
use crate::viewer::loaded::Loaded;
use crate::viewer::picture::capture::{self, Captured};
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::Picture;
use crate::viewer::requests::action::{Action, Film};
use crate::viewer::requests::bindings::COMMAND;
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::{Effect, Outside, whole};
use crate::viewer::scene::Scene;
use crate::viewer::tools::measurements::units;
use crate::viewer::truth::tuning::Tuning;

/// The time between two steps while the camera moves by itself: that of a frame of most screens.
const STEP: Duration = Duration::from_millis(16);

#[derive(Default)]
pub struct Filming {
    pub timeline: Timeline,
    pub thumbnails: Thumbnails,
    pub recording: Recording,
    /// The recording of the window that is under way.
    pub live: Option<Live>,
}

/// A recording of the window.
pub struct Live {
    pub name: PathBuf,
    pub since: Instant,
    pub dropped: Arc<AtomicU64>,
    /// Whether its film is being made.
    pub is_ending: bool,
}

/// What paths are made from besides the scene.
pub struct Around<'a> {
    pub loaded: &'a Loaded,
    /// The frame that the window asks for.
    pub view: Option<&'a FrameRequest>,
    /// The settings of the kept state of the picture.
    pub kept: Option<&'a Settings>,
    pub tuning: &'a Tuning,
    /// The adapter that draws the window.
    pub adapter: Option<&'a str>,
}

impl<'a> Around<'a> {
    pub fn new(
        loaded: &'a Loaded,
        frames: &'a Frames,
        tuning: &'a Tuning,
        kept: Option<&'a Settings>,
        adapter: Option<&'a str>,
    ) -> Self {
        Self { loaded, view: frames.requested.as_ref(), kept, tuning, adapter }
    }
}

impl Filming {
    /// Prepares for an action: a move of the camera by hand ends those that it makes by itself, and what reads or
    /// changes the scene's own values gets them.
    pub fn before(&mut self, action: &Action, scene: &mut Scene) {
        match action {
            Action::Orbit(_) | Action::Look(_) | Action::Pan(_) | Action::Zoom(_) | Action::Travel(_) => {
                scene.flight = None;
                self.timeline.pause();
            }
            // The actions below concern the picture as it is, or the window.
            Action::BeginDrag
            | Action::EndDrag
            | Action::Fly(_)
            | Action::Fast
            | Action::Slow
            | Action::PointAt(_)
            | Action::AskHover
            | Action::Hold { .. }
            | Action::PivotHere
            | Action::Pick
            | Action::PickMiddle
            | Action::UndoPick
            | Action::CopyPick
            | Action::ClearPick
            | Action::Select(_)
            | Action::Gizmo(_)
            | Action::GrabHandle(_)
            | Action::ShowLights(_)
            | Action::SavePicture(_)
            | Action::PinTruth
            | Action::LookAtTruth(_)
            | Action::MeasureTruth(_)
            | Action::SplitTruth(_)
            | Action::KeepTruthReady(_)
            | Action::EstimateErrors(_)
            | Action::StopTruth
            | Action::Copy(_)
            | Action::ToggleInterface
            | Action::TogglePanel
            | Action::ToggleFullScreen
            | Action::ToggleShortcuts
            | Action::TogglePalette
            | Action::ChangePalette(_)
            | Action::OpenTab(_)
            | Action::Speak(_)
            | Action::Search(_)
            | Action::Warn(_)
            | Action::ListMessages(_)
            | Action::DismissMessage(_)
            | Action::Resize(_) => {}
            // A recording is one of the scene's own values.
            Action::Film(film) if *film != Film::StartRecording => {}
            // The picture goes on to follow the path, which may be another one then.
            Action::Undo | Action::Redo => {
                scene.flight = None;
                scene.unpose();
            }
            _ => {
                scene.flight = None;
                self.timeline.leave();
                scene.unpose();
            }
        }
    }

    pub fn act(
        &mut self,
        film: Film,
        scene: &mut Scene,
        around: &Around<'_>,
        preferences: &mut Preferences,
        outside: &mut Outside,
    ) {
        match film {
            Film::Keep(digit) => bookmarks::keep(digit, scene, outside),
            Film::FlyToDigit(digit) => {
                match scene.objects.bookmarks.iter().position(|bookmark| bookmark.digit == Some(digit)) {
                    Some(index) => self.fly(index, scene, outside),
                    None => {
                        outside.note(text!("No view is kept: {COMMAND}+Shift+{digit} keeps this one", COMMAND, digit))
                    }
                }
            }
            Film::FlyTo(index) => self.fly(index, scene, outside),
            Film::ChangeBookmark(index, changed) => {
                if let Some(known) = scene.objects.bookmarks.get_mut(index) {
                    *known = *changed;
                }
            }
            Film::RemoveBookmark(index) => {
                if index < scene.objects.bookmarks.len() {
                    scene.edit_objects(outside.now, |objects| drop(objects.bookmarks.remove(index)));
                }
            }
            Film::Add(preset) => match presets::path(preset, self.height(&units(around.loaded)), scene, around) {
                Ok(path) => self.timeline.add(path, scene, outside),
                Err(problem) => outside.note(problem),
            },
            Film::AskRecording => {
                if let Some(path) = self.timeline.path(scene) {
                    self.recording.ask(&path.name, scene);
                }
            }
            Film::ChangeRecording(asked) => self.recording.asked = asked.map(|asked| *asked),
            Film::StartRecording => self.recording.start(scene, around.loaded, around.adapter, outside),
            Film::StopRecording => self.recording.stop(),
            Film::Capture => self.capture(preferences.capture, outside),
            Film::CaptureAs(format) => preferences.capture = format,
            other => self.timeline.act(other, scene, outside),
        }
    }

    /// How high above a measurement a new path flies, in world units.
    pub fn height(&self, units: &Units) -> f64 {
        self.timeline.height.unwrap_or_else(|| presets::eye_height(units))
    }

    /// Begins to record the window, or ends that.
    fn capture(&mut self, format: CaptureFormat, outside: &mut Outside) {
        match &mut self.live {
            None => {
                let (name, dropped) = (capture::free_name("".as_ref(), format), Arc::<AtomicU64>::default());
                outside.log(json!({ "event": "capture", "path": name }));
                outside.push(Effect::Capture(Some((name.clone(), format, dropped.clone()))));
                self.live = Some(Live { name, since: outside.now, dropped, is_ending: false });
            }
            Some(live) if live.is_ending => outside.note(text!("The film of the window is still being made")),
            Some(live) => {
                live.is_ending = true;
                outside.push(Effect::Capture(None));
            }
        }
    }

    /// Reports how a recording of the window has ended.
    pub fn on_captured(&mut self, captured: Captured, outside: &mut Outside) {
        let Some(live) = self.live.take() else { return };
        let (name, dropped) = (whole(&live.name), live.dropped.load(Ordering::Relaxed));
        outside.log(json!({ "event": "captured", "path": live.name, "frames": captured.result.as_ref().ok(), "dropped": dropped }));
        let told = if dropped > 0 {
            format!("; {dropped} were dropped, because writing took too long")
        } else {
            String::new()
        };
        match captured.result {
            Ok(frames) => {
                let seconds = f64::from(frames) / f64::from(capture::FPS);
                let level = if dropped > 0 { Level::Warning } else { Level::Note };
                outside.say(
                    level,
                    text!(
                        "Window recorded: {name}, {seconds} s{told}",
                        name,
                        seconds = format_args!("{seconds:.1}"),
                        told
                    ),
                );
            }
            Err(problem) => outside.say(Level::Error, text!("Recording of the window: {problem}{told}", problem, told)),
        }
    }

    fn fly(&mut self, index: usize, scene: &mut Scene, outside: &mut Outside) {
        // A key that is held down repeats.
        if scene.flight.as_ref().is_some_and(|flight| flight.bookmark == Some(index)) {
            return;
        }
        self.timeline.leave();
        scene.unpose();
        bookmarks::fly(index, scene, outside);
    }

    /// Moves what moves by itself. `still` is the picture on the screen, if it is final. Returns the time after which to call this
    /// again.
    pub fn step(&mut self, scene: &mut Scene, still: Option<&FrameRequest>, outside: &mut Outside) -> Option<Duration> {
        let flies = scene.step_flight(outside.now);
        let plays = self.timeline.step(scene, outside);
        if let Some(still) = still.filter(|_| !flies && !plays) {
            self.thumbnails.step(scene, still, outside);
        }
        (flies || plays).then_some(STEP)
    }

    /// Takes a small picture of a bookmark; returns any other.
    pub fn on_picture(&mut self, picture: Picture) -> Option<Picture> {
        self.thumbnails.take(picture)
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod track_tests;
