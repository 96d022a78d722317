//! The command palette: a person types part of a name, or another word for it, and Enter does it or goes to it.

use egui::{Key, Modifiers, RichText};

use crate::shared::language::{self, text};
use crate::viewer::look::theme;
use crate::viewer::panels::commands::{Entry, entries};
use crate::viewer::panels::side;
use crate::viewer::requests::action::Action;
use crate::viewer::session::Session;

fn id() -> egui::Id {
    egui::Id::unique("command palette")
}

/// The part of the window that the palette takes, if it has been drawn.
pub fn area(context: &egui::Context) -> Option<egui::Rect> {
    context.memory(|memory| memory.area_rect(id()))
}

/// Draws the palette if it is open.
pub fn show(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    let Some(before) = &session.palette else { return };
    let mut palette = before.clone();
    let mut rows = found(&palette.text, session);
    palette.chosen = palette.chosen.min(rows.len().saturating_sub(1));
    let (mut run, mut is_open) = (None, true);
    let whole = context.content_rect().size();
    let top = 70.0_f32.min(0.1 * whole.y);
    egui::Window::new(text!("Command palette"))
        .id(id())
        .title_bar(false)
        .resizable(false)
        .anchor(egui::Align2::CENTER_TOP, [0.0, top])
        .show(context, |ui| {
            ui.set_width(520.0_f32.min(whole.x - 40.0));
            // The arrows belong to the list, not to the text.
            for (key, step) in [(Key::ArrowDown, 1), (Key::ArrowUp, -1), (Key::PageDown, 8), (Key::PageUp, -8)] {
                if ui.input_mut(|input| input.consume_key(Modifiers::NONE, key)) {
                    let last = rows.len().saturating_sub(1);
                    palette.chosen = palette.chosen.saturating_add_signed(step).min(last);
                }
            }
            let field = egui::TextEdit::singleline(&mut palette.text).hint_text(text!("Part of a name"));
            let response = ui.add(field.desired_width(f32::INFINITY)).accessible_name(text!("Command"));
            if !palette.is_shown {
                palette.is_shown = true;
                response.request_focus();
            }
            if response.changed() {
                // Enter may come in the same frame of the window as the last letters.
                rows = found(&palette.text, session);
                palette.chosen = 0;
            }
            if response.lost_focus() {
                is_open = false;
                if ui.input(|input| input.key_pressed(Key::Enter)) {
                    run = rows.get(palette.chosen).map(|entry| entry.action.clone());
                }
            }
            let most_high = 340.0_f32.min(whole.y - top - 90.0);
            run = list(ui, &rows, palette.chosen, palette != *before, most_high).or(run.take());
            ui.label(RichText::new(text!("Up and Down choose, Enter does it, Esc closes")).small().color(theme::WEAK));
        });
    if let Some(run) = run {
        actions.push(Action::ChangePalette(None));
        if matches!(run, Action::FindParameter(_)) {
            // From there, Tab leads to the value.
            context.memory_mut(|memory| memory.request_focus(side::search_id()));
        } else if matches!(run, Action::OpenTab(_)) {
            side::focus_first_section(context);
        }
        actions.push(run);
    } else if !is_open {
        actions.push(Action::ChangePalette(None));
    } else if palette != *before {
        actions.push(Action::ChangePalette(Some(Box::new(palette))));
    }
}

/// Draws the rows. Returns what a click asks for.
fn list(ui: &mut egui::Ui, entries: &[Entry], chosen: usize, has_changed: bool, most_high: f32) -> Option<Action> {
    let mut clicked = None;
    egui::ScrollArea::vertical().max_height(most_high).auto_shrink([false, true]).show(ui, |ui| {
        for (index, entry) in entries.iter().enumerate() {
            let row = ui.horizontal(|ui| {
                let label = ui.selectable_label(index == chosen, &entry.text);
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    ui.label(RichText::new(&entry.detail).monospace().size(11.0).color(theme::WEAK));
                });
                label
            });
            let label = row.inner;
            if index == chosen && has_changed {
                label.scroll_to_me(None);
            }
            if label.clicked() {
                clicked = Some(entry.action.clone());
            }
        }
        if entries.is_empty() {
            ui.label(RichText::new(text!("No command and no parameter has these words.")).color(theme::WEAK));
        }
    });
    clicked
}

/// The rows that have all words of the search: first the one whose name or key it is, then those that have its words in
/// what is read, and then those that have them among the words that people use, or in their help.
/// The names are those of the window's language and the English ones.
fn found(search: &str, session: &Session) -> Vec<Entry> {
    let search = search.to_lowercase();
    let plain = |text: &str| text.to_lowercase().replace(['.', '_'], " ");
    let wanted = plain(search.trim());
    let rank = |entry: &Entry| {
        let read = format!("{} {}", entry.text, entry.detail).to_lowercase();
        let name = plain(entry.text.split_once(": ").map_or(entry.text.as_str(), |(_, name)| name));
        let has_all = |text: &str| search.split_whitespace().all(|word| text.contains(word));
        let more = || format!("{read} {} {}", entry.words, entry.help.to_lowercase());
        match () {
            () if plain(&entry.detail) == wanted => Some(0),
            () if name == wanted => Some(1),
            () if read.starts_with(search.trim()) || name.starts_with(&wanted) => Some(2),
            () if has_all(&read) => Some(3),
            () if has_all(entry.words) => Some(4),
            () if has_all(&more()) => Some(5),
            () => None,
        }
    };
    let english = language::in_english(|| entries(session));
    let both = entries(session).into_iter().zip(english);
    let ranked =
        both.filter_map(|(entry, english)| Some((rank(&entry).into_iter().chain(rank(&english)).min()?, entry)));
    let mut found: Vec<(u8, Entry)> = ranked.collect();
    found.sort_by_key(|(rank, _)| *rank);
    found.into_iter().map(|(_, entry)| entry).collect()
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;
    use scene::{Object, Profile};

    use super::*;
    use crate::viewer::interface;
    use crate::viewer::requests::action::{Film, Profiling, SavePicture};
    use crate::viewer::requests::bindings::{BINDINGS, Trigger};
    use crate::viewer::requests::preferences::Preferences;

    fn harness() -> Harness<'static, Session> {
        let mut harness = Harness::builder().with_size([1280.0, 800.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                let actions = interface::show(ui, session, None);
                session.act_all(actions);
            },
            Session::new(Preferences::default()),
        );
        harness.run_ok();
        harness
    }

    /// Opens the palette by its key, types and presses Enter.
    fn command(harness: &mut Harness<'static, Session>, text: &str) {
        harness.key_press_modifiers(Modifiers::COMMAND, Key::P);
        harness.run_ok();
        harness.event(egui::Event::Text(text.into()));
        harness.run_ok();
        harness.key_press(Key::Enter);
        harness.run_ok();
    }

    #[test]
    fn every_action_with_a_key_and_every_parameter_is_found_by_its_name() {
        let session = Session::new(Preferences::default());
        for binding in BINDINGS {
            let is_at_once = matches!(binding.trigger, Trigger::Key(..) | Trigger::Numpad(..));
            let is_left_out = matches!(binding.action, Action::PasteView | Action::TogglePalette);
            let is_found = || found(binding.text, &session).iter().any(|entry| entry.action == binding.action);
            assert!(!is_at_once || is_left_out || is_found(), "{}", binding.text);
        }
        for params in session.scene.settings.groups() {
            for field in &params.group().fields {
                let key = format!("{}.{}", params.group().name, field.name);
                let action = Action::FindParameter(key.clone());
                assert!(found(&key, &session).first().is_some_and(|entry| entry.action == action), "{key}");
            }
        }
    }

    #[test]
    fn the_palette_fits_into_small_windows() {
        for size in [[1280.0, 800.0], [480.0, 320.0]] {
            let mut harness = Harness::builder().with_size(size).with_max_steps(16).build_ui_state(
                |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui.ctx(), session, actions)),
                Session::new(Preferences::default()),
            );
            harness.state_mut().act(Action::TogglePalette);
            harness.run_ok();
            let area = area(&harness.ctx).unwrap();
            let whole = harness.ctx.content_rect();
            assert!(whole.contains_rect(area), "{area} in {whole}");
            assert!(whole.contains_rect(harness.get_by_label_contains("Esc closes").rect()), "{whole}");
        }
    }

    #[test]
    fn part_of_a_name_and_enter_do_an_action_and_close_the_palette() {
        let mut harness = harness();
        command(&mut harness, "colour by hei");
        assert_eq!(harness.state().scene.settings.color.by, scene::ColorBy::Height);
        assert!(harness.state().palette.is_none());
        // The second row.
        harness.key_press_modifiers(Modifiers::COMMAND, Key::P);
        harness.run_ok();
        harness.event(egui::Event::Text("tab:".into()));
        harness.run_ok();
        harness.key_press(Key::ArrowDown);
        harness.run_ok();
        harness.key_press(Key::Enter);
        harness.run_ok();
        assert_eq!(harness.state().preferences.tab, "Look");
    }

    #[test]
    fn letters_that_come_in_one_frame_with_enter_count() {
        let mut harness = harness();
        harness.key_press_modifiers(Modifiers::COMMAND, Key::P);
        harness.run_ok();
        let enter = |pressed| egui::Event::Key {
            key: Key::Enter,
            physical_key: None,
            pressed,
            repeat: false,
            modifiers: Modifiers::NONE,
        };
        harness.input_mut().events = vec![egui::Event::Text("tab: streaming".into()), enter(true), enter(false)];
        harness.step();
        harness.run_ok();
        assert_eq!(harness.state().preferences.tab, "Streaming");
        assert!(harness.state().palette.is_none());
    }

    #[test]
    fn words_that_people_use_find_actions_parameters_and_bookmarks() {
        let mut session = Session::with_two_points();
        session.act(Action::Film(Film::Keep(None)));
        session.scene.objects.bookmarks[0].name = "North gate".into();
        let first = |text: &str| found(text, &session).into_iter().next().map(|entry| (entry.text, entry.action));
        let parameter = |key: &str| Action::FindParameter(key.into());
        for (text, action) in [
            ("reflection method", parameter("reflection.method")),
            ("screenshot", Action::SavePicture(SavePicture::AtOnce)),
            ("north gate", Action::Film(Film::FlyTo(0))),
            ("bookmark", Action::Film(Film::Keep(None))),
        ] {
            assert_eq!(first(text).map(|(_, action)| action), Some(action), "{text}");
        }
        let all = |text: &str| -> Vec<String> {
            found(text, &session).into_iter().map(|entry| format!("{} {}", entry.text, entry.detail)).collect()
        };
        for (text, expected) in [
            ("preset", "Preset: Published"),
            ("sweep", "Sweep: Bounces"),
            ("point size", "splat.size"),
            ("point size", "Points larger"),
            ("reset", "Reset all parameters"),
            ("night", "sun.elevation"),
            ("section", "Draw the line of a profile"),
            ("section", "Add a clip box"),
            ("bookm", "Fly to North gate"),
            ("torus", "Add a mirror: torus"),
            ("water", "Add a mirror"),
            ("4k", "picture"),
            ("class", "Tab: Look"),
            ("courtyard", "Open: courtyard/pool"),
        ] {
            let rows = all(text);
            assert!(rows.iter().any(|row| row.contains(expected)), "{text}: {rows:?}");
        }
        // What changes nothing now says so.
        let seeds = all("sscr.seed_attempts");
        assert!(seeds[0].contains("sscr is not in use"), "{seeds:?}");
    }

    #[test]
    fn a_parameter_is_gone_to_though_its_panel_and_its_method_are_folded() {
        let mut harness = harness();
        harness.state_mut().act(Action::TogglePanel);
        command(&mut harness, "sscr.seed_attempts");
        assert!(harness.state().preferences.panel_is_open);
        assert!(harness.query_all_by_label("Seed attempts").next().is_some());
    }

    #[test]
    fn a_profile_is_shown_from_the_side_and_saved() {
        let mut harness = harness();
        let session = harness.state_mut();
        let id = session.scene.next_object_id();
        let profile = Profile { name: "north wall".into(), ..Profile::new(vec![DVec3::ZERO, DVec3::X], 0.5) };
        session.scene.place(id, Object::Profile(profile), &mut session.outside);
        let saves = |entry: &Entry| matches!(entry.action, Action::Profile(_));
        assert!(!found("save as csv", session).iter().any(saves), "none is in view");
        command(&mut harness, "north side");
        assert_eq!(harness.state().tools.profiles.in_view, Some(id));
        let save = found("save as csv", harness.state()).remove(0);
        assert_eq!(save.action, Action::Profile(Profiling::Save("csv")));
        command(&mut harness, "profiles: all in one");
        assert!(harness.state().tools.profiles.is_together);
    }

    #[test]
    fn escape_closes_it_and_nothing_is_done() {
        let mut harness = harness();
        harness.key_press_modifiers(Modifiers::COMMAND, Key::K);
        harness.run_ok();
        assert!(harness.state().palette.is_some());
        harness.event(egui::Event::Text("quit".into()));
        harness.run_ok();
        harness.key_press(Key::Escape);
        harness.run_ok();
        assert!(harness.state().palette.is_none() && !harness.state().wants_to_quit);
    }
}
