//! What the parts of the session need from outside of it: the clock, the list of effects and the messages. Each
//! function that needs it gets it as a parameter.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Weak};
use std::time::Instant;

use scene::CaptureFormat;
use serde_json::json;
use world::{Change, Event, Input};

use crate::overlays::Facts;
use crate::shared::language::text;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Command, Report};
use crate::viewer::picture::under_way::Pass;
use crate::viewer::requests::messages::{Level, Messages};
use crate::viewer::requests::work::{Found, Work};

/// A path from the root, as messages name what was written: a person may look for it from another folder.
pub fn whole(path: &Path) -> String {
    std::path::absolute(path).unwrap_or(path.to_owned()).display().to_string()
}

/// A request of the session for something outside of it.
pub enum Effect {
    Render(Command),
    Load {
        inputs: Vec<Input>,
    },
    Work(Work),
    OpenDialog,
    /// Asks where to save something; this place is proposed.
    AskPlace(Asked, PathBuf),
    Copy(String),
    SetFullScreen(bool),
    /// Begins to record the window under this name, and counts the pictures that are dropped; or ends that.
    Capture(Option<(PathBuf, CaptureFormat, Arc<AtomicU64>)>),
    /// Writes a line to the event log.
    Log(serde_json::Value),
}

/// What a place is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    Points,
    Scene,
    Picture,
}

/// News from other threads.
pub enum News {
    /// The job's number and its event; a chunk comes with its `Pass`, which goes on to the render thread.
    Loading(u32, Event, Option<Pass>),
    Report(Report),
    Found(Found),
}

pub struct Outside {
    /// The time by the driver's clock: the window's or the recording's. The driver sets it at every step and input.
    pub now: Instant,
    /// The time of the newest input that the session has seen: of the mouse, of a key, of text.
    pub input_at: Option<Instant>,
    /// The effects that nobody has carried out yet, the oldest first.
    pub effects: Vec<Effect>,
    pub messages: Messages,
    /// The pictures that are being saved. The commands own the paths, and are dropped when they are carried out, however
    /// that ends.
    saving: Vec<Weak<PathBuf>>,
}

impl Outside {
    pub fn new(messages: Messages) -> Self {
        Self { now: Instant::now(), input_at: None, effects: Vec::new(), messages, saving: Vec::new() }
    }

    /// Saves a picture on the render thread.
    pub fn save_picture(&mut self, request: FrameRequest, path: PathBuf, facts: Facts) {
        let path = Arc::new(path);
        self.saving.retain(|saved| saved.strong_count() > 0);
        self.saving.push(Arc::downgrade(&path));
        self.render(Command::Save { request: Box::new(request), path, facts: Box::new(facts) });
    }

    /// The pictures that are being saved, the oldest first.
    pub fn saving(&self) -> impl Iterator<Item = Arc<PathBuf>> {
        self.saving.iter().filter_map(Weak::upgrade)
    }

    pub fn push(&mut self, effect: Effect) {
        self.effects.push(effect);
    }

    pub fn render(&mut self, command: Command) {
        self.push(Effect::Render(command));
    }

    /// Sends the render thread a change of its points.
    pub fn change(&mut self, change: Change) {
        self.render(Command::Change(change));
    }

    pub fn work(&mut self, work: Work) {
        self.push(Effect::Work(work));
    }

    pub fn log(&mut self, event: serde_json::Value) {
        self.push(Effect::Log(event));
    }

    /// Shows a message and writes it to the event log.
    pub fn say(&mut self, level: Level, text: impl Into<String>) {
        let text = text.into();
        self.log(json!({ "event": "message", "level": level.name(), "text": text }));
        self.messages.push(level, text);
    }

    /// Takes back what was said of a cloud, with its name before it or without.
    pub fn take_back(&mut self, name: &str, problem: &str) {
        self.log(json!({ "event": "taken back", "text": problem }));
        self.messages.take_back(name, problem);
    }

    /// Says what is wrong with an address, which can be opened again.
    pub fn say_of_address(&mut self, text: String, address: String) {
        self.say(Level::Error, text);
        self.messages.name_address(address);
    }

    /// Reports that a picture was written.
    pub fn saved(&mut self, path: &Path) {
        self.log(json!({ "event": "saved", "path": path }));
        self.note(text!("Picture saved: {path}", path = whole(path)));
    }

    /// Reports whether a scene file was written.
    pub fn scene_saved(&mut self, path: &Path, result: Result<(), String>) {
        match result {
            Ok(()) => {
                self.log(json!({ "event": "scene_saved", "path": path }));
                self.note(text!("Scene saved: {path}", path = path.display()));
            }
            Err(error) => self.say(Level::Error, error),
        }
    }

    /// Reports whether an index was deleted, and how much room that made.
    pub fn index_deleted(&mut self, freed: &str, result: Result<(), String>) {
        match result {
            Ok(()) => self.say(Level::Note, text!("Index deleted: {freed} free", freed)),
            Err(error) => self.say(Level::Error, error),
        }
        self.work(Work::MeasureCache);
    }

    /// Shows a note without logging it: it only confirms what a person asked for.
    pub fn note(&mut self, text: impl Into<String>) {
        self.messages.push(Level::Note, text);
    }

    pub fn warning(&mut self, text: impl Into<String>) {
        self.messages.push(Level::Warning, text);
    }

    pub fn error(&mut self, text: impl Into<String>) {
        self.messages.push(Level::Error, text);
    }
}
