//! The viewer's messages: toasts, which stay for a few seconds, and a list of all messages.

use std::time::{Duration, Instant};

use egui::{Align2, Color32, RichText};

use crate::shared::language::text;
use crate::viewer::look::theme;
use crate::viewer::requests::action::Action;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    Note,
    Warning,
    Error,
}

pub struct Message {
    pub level: Level,
    pub text: String,
    /// The address that could not be opened, and may be tried again.
    address: Option<String>,
    since: Instant,
    dismissed: bool,
    /// Whether it is no longer so.
    is_over: bool,
}

#[derive(Default)]
pub struct Messages {
    /// All messages, the oldest first.
    pub all: Vec<Message>,
    pub list_is_open: bool,
}

/// The height of a toast of one line, in points of the window.
const LINE: f32 = 38.0;
/// The largest number of toasts at a time. The list has the older ones.
const TOASTS: usize = 4;

impl Messages {
    pub fn push(&mut self, level: Level, text: impl Into<String>) {
        let text = text.into();
        // A message that repeats while it is on the screen is not added again.
        if let Some(same) = self.all.iter_mut().rev().take(TOASTS).find(|message| message.text == text) {
            same.since = Instant::now();
            (same.dismissed, same.is_over) = (false, false);
            return;
        }
        self.all.push(Message { level, text, address: None, since: Instant::now(), dismissed: false, is_over: false });
    }

    pub fn warning(&mut self, text: impl Into<String>) {
        self.push(Level::Warning, text);
    }

    /// Takes back all messages of this problem, with the name of the cloud before it or without: they go from the screen,
    /// and are struck out in the list.
    pub fn take_back(&mut self, name: &str, problem: &str) {
        let named = format!("{name}: {problem}");
        for message in self.all.iter_mut().filter(|message| message.text == problem || message.text == named) {
            (message.dismissed, message.is_over, message.address) = (true, true, None);
        }
    }

    /// Says which address the last message is about.
    pub fn name_address(&mut self, address: String) {
        if let Some(last) = self.all.last_mut() {
            last.address = Some(address);
        }
    }

    /// Draws the toasts in the upper right corner of `rect`, and the list if it is open.
    pub fn show(&self, context: &egui::Context, rect: egui::Rect, actions: &mut Vec<Action>) {
        let mut toasts: Vec<_> = self.all.iter().enumerate().rev().filter(|(_, message)| message.is_fresh()).collect();
        // The last message is the answer to what was just done. Of the others, warnings and notes hide no error.
        if let Some((_, others)) = toasts.split_first_mut() {
            others.sort_by_key(|(_, message)| message.level != Level::Error);
        }
        toasts.truncate(TOASTS);
        let mut soonest: Option<Duration> = None;
        let mut top = rect.top() + 12.0;
        for (index, (place, message)) in toasts.into_iter().enumerate() {
            // One line more would not fit.
            if index > 0 && top + LINE > rect.bottom() {
                break;
            }
            let left = message.level.duration().saturating_sub(message.since.elapsed());
            soonest = Some(soonest.map_or(left, |soonest| soonest.min(left)));
            let area = egui::Area::new(egui::Id::unique(("toast", index)))
                .pivot(Align2::RIGHT_TOP)
                .fixed_pos(egui::pos2(rect.right() - 12.0, top))
                .order(egui::Order::Foreground);
            let shown = area.show(context, |ui| {
                let width = (rect.width() - 24.0).clamp(120.0, 420.0);
                egui::Frame::popup(ui.style()).inner_margin(10).show(ui, |ui| {
                    ui.set_max_width(width);
                    // Text that can be selected would take the click that dismisses the toast.
                    ui.style_mut().interaction.selectable_labels = false;
                    ui.horizontal_top(|ui| {
                        ui.label(RichText::new(message.level.mark()).color(message.level.color()).strong());
                        ui.add(egui::Label::new(&message.text).wrap());
                    });
                });
            });
            if shown.response.interact(egui::Sense::CLICK).clicked() {
                actions.push(Action::DismissMessage(place));
            }
            top = shown.response.rect.bottom() + 6.0;
        }
        if let Some(soonest) = soonest {
            context.request_repaint_after(soonest);
        }
        let mut list_is_open = self.list_is_open;
        egui::Window::new(text!("Messages"))
            .open(&mut list_is_open)
            .collapsible(false)
            .default_size([460.0, 260.0])
            .anchor(Align2::RIGHT_BOTTOM, [-16.0, -40.0])
            .show(context, |ui| {
                egui::ScrollArea::vertical().stick_to_bottom(true).auto_shrink(false).show(ui, |ui| {
                    for message in &self.all {
                        ui.horizontal_top(|ui| {
                            ui.label(RichText::new(message.level.mark()).color(message.level.color()).strong());
                            if let Some(address) = &message.address
                                && ui
                                    .small_button(text!("Try again"))
                                    .on_hover_text(text!("Open the address again"))
                                    .clicked()
                            {
                                actions.push(Action::Open(address.into()));
                            }
                            let said = RichText::new(&message.text);
                            let said = if message.is_over { said.strikethrough().weak() } else { said };
                            ui.add(egui::Label::new(said).wrap());
                        });
                    }
                    if self.all.is_empty() {
                        ui.label(RichText::new(text!("Nothing so far.")).color(theme::WEAK));
                    }
                });
            });
        if list_is_open != self.list_is_open {
            actions.push(Action::ListMessages(list_is_open));
        }
    }

    /// Hides the toast of the message with index `place`.
    pub fn dismiss(&mut self, place: usize) {
        if let Some(message) = self.all.get_mut(place) {
            message.dismissed = true;
        }
    }
}

impl Message {
    fn is_fresh(&self) -> bool {
        !self.dismissed && self.since.elapsed() < self.level.duration()
    }
}

impl Level {
    /// Returns how long a toast stays: a note long enough to read one line, an error long enough to read two that
    /// nobody expected.
    fn duration(self) -> Duration {
        Duration::from_secs(match self {
            Self::Note => 5,
            Self::Warning => 9,
            Self::Error => 15,
        })
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }

    fn mark(self) -> &'static str {
        match self {
            Self::Note => "•",
            Self::Warning | Self::Error => "!",
        }
    }

    pub fn color(self) -> Color32 {
        match self {
            Self::Note => theme::ACCENT,
            Self::Warning => theme::WARNING,
            Self::Error => theme::ERROR,
        }
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    fn harness(messages: Messages) -> Harness<'static, Messages> {
        Harness::builder().with_size([600.0, 500.0]).with_max_steps(16).build_ui_state(
            |ui, messages: &mut Messages| {
                let mut actions = Vec::new();
                messages.show(ui.ctx(), ui.ctx().content_rect(), &mut actions);
                for action in actions {
                    let Action::DismissMessage(place) = action else { panic!("{action:?}") };
                    messages.dismiss(place);
                }
            },
            messages,
        )
    }

    fn texts(messages: &Messages) -> Vec<&str> {
        messages.all.iter().map(|message| message.text.as_str()).collect()
    }

    #[test]
    fn a_message_that_repeats_while_it_is_shown_is_one_message() {
        let mut messages = Messages::default();
        messages.push(Level::Note, "a");
        messages.push(Level::Error, "b");
        messages.push(Level::Note, "a");
        assert_eq!(texts(&messages), ["a", "b"]);
        // Four other messages have taken its place on the screen.
        ["c", "d", "e", "f"].into_iter().for_each(|text| messages.push(Level::Note, text));
        messages.push(Level::Note, "a");
        assert_eq!(texts(&messages), ["a", "b", "c", "d", "e", "f", "a"]);
    }

    #[test]
    fn what_is_taken_back_goes_from_the_screen_and_stays_in_the_list() {
        let mut messages = Messages::default();
        ["all.vpc: a tile is missing: 7", "all.vpc: a tile is missing: 8", "b.vpc: a tile is missing: 7"]
            .into_iter()
            .for_each(|text| messages.warning(text));
        messages.take_back("all.vpc", "a tile is missing: 7");
        let shown = |messages: &Messages| messages.all.iter().map(Message::is_fresh).collect::<Vec<_>>();
        assert_eq!((shown(&messages), messages.all[0].is_over), (vec![false, true, true], true));
        // It is missing once more.
        messages.warning("all.vpc: a tile is missing: 7");
        assert_eq!((shown(&messages), messages.all[0].is_over), (vec![true; 3], false));
    }

    #[test]
    fn the_last_four_are_shown_until_a_click_and_the_list_has_all() {
        let mut messages = Messages::default();
        ["one", "two", "three", "four", "five"].into_iter().for_each(|text| messages.warning(text));
        let mut harness = harness(messages);
        harness.run_ok();
        let shown = |harness: &Harness<'_, Messages>, text: &str| harness.query_all_by_label(text).count();
        assert_eq!(["one", "two", "five"].map(|text| shown(&harness, text)), [0, 1, 1]);
        // A click removes a toast and makes room for an older one.
        let pos = harness.get_by_label("five").rect().center();
        harness.event(egui::Event::PointerMoved(pos));
        for pressed in [true, false] {
            let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
            harness.event(egui::Event::PointerButton { pos, button, pressed, modifiers });
        }
        harness.run_ok();
        assert_eq!(["one", "two", "five"].map(|text| shown(&harness, text)), [1, 1, 0]);
        harness.state_mut().list_is_open = true;
        harness.run_ok();
        assert_eq!(["one", "two", "five"].map(|text| shown(&harness, text)), [2, 2, 1]);
    }

    #[test]
    fn warnings_hide_no_error_and_the_last_message_is_shown() {
        let mut messages = Messages::default();
        messages.push(Level::Error, "not read");
        ["one", "two", "three", "four"].into_iter().for_each(|text| messages.warning(text));
        messages.push(Level::Note, "saved");
        let mut harness = harness(messages);
        harness.run_ok();
        let top = |text: &str| harness.query_by_label(text).map(|node| node.rect().top());
        assert!(top("saved") < top("not read") && top("not read") < top("four") && top("four") < top("three"));
        assert!(top("saved").is_some() && top("two").is_none());
    }
}
