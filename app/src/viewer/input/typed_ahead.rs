//! Letters that are typed before the field for them has the keyboard.
//!
//! A shortcut such as Ctrl+P opens a field of text, which has the keyboard two frames of the window later. Where frames
//! take long, the letters that follow come before that: they would be lost, and act as shortcuts of their own.

use egui::{Event, RawInput};

use crate::viewer::requests::action::{Action, Export, Filing, Mode, SavePicture};
use crate::viewer::requests::bindings::{self, Trigger};

/// The field that a shortcut asks for is drawn in the next frame, and has the keyboard in the one after that.
const FRAMES_UNTIL_FOCUS: u32 = 2;
/// After this many frames and seconds the letters are given back: the shortcut may have closed a field, or opened a
/// dialog of the desktop.
const MOST_FRAMES: u32 = 4;
const MOST_SECONDS: f64 = 0.4;

struct Awaited {
    frames: u32,
    /// When the shortcut came, by the input's clock.
    since: Option<f64>,
}

/// Keys and letters that wait for a field of text.
#[derive(Default)]
pub struct TypedAhead {
    events: Vec<Event>,
    /// The shortcut, while its field is awaited.
    awaited: Option<Awaited>,
}

impl TypedAhead {
    /// Takes what was typed after a shortcut that opens a field of text from the input of a frame of the window, and adds it
    /// to that of a later one. `has_field` says that a field of text has the keyboard.
    pub fn delay(&mut self, input: &mut RawInput, has_field: bool) {
        if let Some(Awaited { frames, since }) = &mut self.awaited {
            *frames += 1;
            let is_over = input.time.zip(*since).is_none_or(|(now, since)| now - since >= MOST_SECONDS);
            let is_due = *frames >= MOST_FRAMES && is_over || has_field && *frames >= FRAMES_UNTIL_FOCUS;
            if !is_due {
                self.events.extend(input.events.extract_if(.., |event| is_typed(event)));
                return;
            }
            self.awaited = None;
            input.events.splice(0..0, std::mem::take(&mut self.events));
        }
        if let Some(shortcut) = input.events.iter().position(asks_for_text) {
            self.events.extend(input.events.extract_if(shortcut + 1.., |event| is_typed(event)));
            self.awaited = Some(Awaited { frames: 0, since: input.time });
        }
    }

    pub fn is_waiting(&self) -> bool {
        self.awaited.is_some()
    }
}

fn is_typed(event: &Event) -> bool {
    matches!(event, Event::Key { .. } | Event::Text(_) | Event::Paste(_) | Event::Ime(_))
}

/// Whether a field of text opens after a key.
fn asks_for_text(event: &Event) -> bool {
    let Event::Key { key, pressed: true, repeat: false, modifiers, .. } = event else { return false };
    let action = bindings::action(Trigger::Key((*modifiers).into(), *key), Mode::default());
    let saves = matches!(
        action,
        Some(Action::File(Filing::Save | Filing::SaveAs) | Action::Export(Export::Ask))
            | Some(Action::SavePicture(SavePicture::Ask))
    );
    saves || matches!(action, Some(Action::TogglePalette | Action::OpenPrompt))
}

#[cfg(test)]
mod tests {
    use egui::{Key, Modifiers, Pos2};

    use super::*;

    fn key(key: Key, modifiers: Modifiers) -> Event {
        Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers }
    }

    fn letters() -> [Event; 2] {
        [key(Key::M, Modifiers::NONE), Event::Text("m".into())]
    }

    #[test]
    fn letters_after_a_shortcut_wait_for_the_field_in_their_order() {
        let mut typed = TypedAhead::default();
        let mut frame = |events: Vec<Event>, has_field| {
            let mut input = RawInput { events, ..Default::default() };
            typed.delay(&mut input, has_field);
            input.events
        };
        let moved = Event::PointerMoved(Pos2::ZERO);
        let shortcut = key(Key::P, Modifiers::COMMAND);
        let [m, text] = letters();
        let first = vec![m.clone(), shortcut.clone(), m.clone(), moved.clone(), text.clone()];
        assert_eq!(frame(first, false), [m.clone(), shortcut.clone(), moved.clone()]);
        let later = Event::Text("i".into());
        assert_eq!(frame(vec![moved.clone(), later.clone()], true), [moved], "another field may have it still");
        assert_eq!(frame(vec![later.clone()], true), [m.clone(), text.clone(), later.clone(), later.clone()]);
        assert_eq!(frame(vec![m.clone(), text.clone()], true), [m.clone(), text.clone()]);
        // The letters may all come with the next frame.
        assert_eq!(frame(vec![shortcut.clone()], false), std::slice::from_ref(&shortcut));
        assert!(frame(vec![m.clone(), text.clone()], false).is_empty());
        assert_eq!(frame(vec![], true), [m.clone(), text.clone()]);
        // A field that never comes keeps nothing.
        assert_eq!(frame(vec![shortcut.clone(), m.clone()], false), [shortcut]);
        assert!(frame(vec![], false).is_empty() && frame(vec![], false).is_empty() && frame(vec![], false).is_empty());
        assert_eq!(frame(vec![], false), [m]);
    }

    #[test]
    fn letters_wait_longer_than_a_few_frames_where_the_field_takes_its_time() {
        for opens in [key(Key::P, Modifiers::COMMAND), key(Key::S, Modifiers::COMMAND)] {
            let mut typed = TypedAhead::default();
            let mut frame = |time, events: Vec<Event>, has_field| {
                let mut input = RawInput { time: Some(time), events, ..Default::default() };
                typed.delay(&mut input, has_field);
                input.events
            };
            assert_eq!(frame(1.0, vec![opens.clone()], false), std::slice::from_ref(&opens));
            for number in 1..10 {
                let events = if number == 1 { letters().into() } else { Vec::new() };
                assert!(frame(1.0 + f64::from(number) * 0.03, events, false).is_empty());
            }
            assert_eq!(frame(1.3, vec![], true), letters());
            // Few frames are waited for, however long they take.
            frame(2.0, vec![opens.clone()], false);
            assert!(frame(4.0, letters().into(), false).is_empty());
            assert!(frame(5.0, vec![], false).is_empty() && frame(6.0, vec![], false).is_empty());
            assert_eq!(frame(7.0, vec![], false), letters());
        }
    }

    #[test]
    fn letters_without_a_shortcut_come_at_once() {
        let mut typed = TypedAhead::default();
        let mut input = RawInput { events: letters().into(), ..Default::default() };
        typed.delay(&mut input, false);
        assert_eq!(input.events, letters());
        assert!(!typed.is_waiting());
    }
}
