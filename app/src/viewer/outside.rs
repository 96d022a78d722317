//! What lies outside of the session's parts: the clock, what is to be done elsewhere, and what a person is told. Whoever changes
//! a part hands it in.

use std::time::Instant;

use serde_json::json;
use world::{Change, Event, Input};

use crate::viewer::messages::{Level, Messages};
use crate::viewer::window::render_thread::{Command, Report};
use crate::viewer::window::under_way::Pass;
use crate::viewer::work::{Found, Work};

/// What is to be done outside of the session.
pub enum Effect {
    Render(Command),
    Load {
        inputs: Vec<Input>,
    },
    Work(Work),
    OpenDialog,
    Copy(String),
    SetFullScreen(bool),
    /// A line of the event log.
    Log(serde_json::Value),
}

/// What other threads tell.
pub enum News {
    /// An event of a job, and with a chunk its pass to the render thread.
    Loading(u32, Event, Option<Pass>),
    Report(Report),
    Found(Found),
}

pub struct Outside {
    /// The time, by the clock of whoever drives the session; set at every step and input.
    pub now: Instant,
    /// Oldest first.
    pub effects: Vec<Effect>,
    pub messages: Messages,
}

impl Outside {
    pub fn new(messages: Messages) -> Self {
        Self { now: Instant::now(), effects: Vec::new(), messages }
    }

    pub fn push(&mut self, effect: Effect) {
        self.effects.push(effect);
    }

    pub fn render(&mut self, command: Command) {
        self.push(Effect::Render(command));
    }

    /// A change of the points that the render thread has.
    pub fn change(&mut self, change: Change) {
        self.render(Command::Change(change));
    }

    pub fn work(&mut self, work: Work) {
        self.push(Effect::Work(work));
    }

    pub fn log(&mut self, event: serde_json::Value) {
        self.push(Effect::Log(event));
    }

    /// Tells a person, and the event log.
    pub fn say(&mut self, level: Level, text: impl Into<String>) {
        let text = text.into();
        self.log(json!({ "event": "message", "level": level.name(), "text": text }));
        self.messages.push(level, text);
    }

    /// Tells a person alone: of what was asked for, and is seen.
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
