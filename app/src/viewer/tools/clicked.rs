//! Clicks whose points the render thread still looks up, and what waits for them: what a person adds right after a click
//! goes to the point of that click.

use crate::viewer::requests::action::{Action, Clipping};

/// How many clicks have asked for a point, and how many of them are answered: each is, in their order.
#[derive(Default)]
pub struct Clicked {
    asked: u64,
    answered: u64,
    /// Each with the number of clicks that must be answered first.
    waiting: Vec<(u64, Action)>,
}

impl Clicked {
    pub fn ask(&mut self) {
        self.asked += 1;
    }

    pub fn answer(&mut self) {
        self.answered += 1;
    }

    /// Drops what waits: no answers come any more.
    pub fn give_up(&mut self) {
        self.answered = self.asked;
        self.drop_waiting();
    }

    /// Drops what waits: it was meant for a scene that is gone.
    pub fn drop_waiting(&mut self) {
        self.waiting.clear();
    }

    pub fn is_waited_for(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Keeps what goes to a point that is still looked up, and what adds to it or acts on it after that; undo takes the
    /// last of it back. Returns any other action.
    pub fn keep(&mut self, action: Action) -> Option<Action> {
        match action {
            Action::AddSpot | Action::Delete | Action::Duplicate if self.is_waited_for() => {
                self.waiting.push((self.asked, action));
                None
            }
            Action::AddMirror(_) | Action::Clip(Clipping::AroundPick) if self.answered < self.asked => {
                self.waiting.push((self.asked, action));
                None
            }
            Action::Undo if self.waiting.pop().is_some() => None,
            action => Some(action),
        }
    }

    /// Hands over what waits for no click any more.
    pub fn due(&mut self) -> Vec<Action> {
        let due = self.waiting.partition_point(|(asked, _)| *asked <= self.answered);
        self.waiting.drain(..due).map(|(_, action)| action).collect()
    }
}
