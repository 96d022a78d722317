//! The questions about unsaved work: what to do with it before it would be lost, or where another program has changed its
//! file, and whether to restore what a program has left that ended before it was saved. Work that runs is asked about in
//! the same way before the program ends.

use std::time::Duration;

use egui::{Key, RichText};

use crate::shared::language::text;
use crate::viewer::loaded::Running;
use crate::viewer::look::theme;
use crate::viewer::objects::clouds::short_name;
use crate::viewer::requests::action::{Action, Filing};
use crate::viewer::requests::bindings::COMMAND;
use crate::viewer::session::Session;
use crate::viewer::session::document::Leaving;

/// Draws the question that waits for an answer, if there is one.
pub fn show(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    if let Some(leaving) = &session.document.asked {
        let running = if *leaving == Leaving::Quit { session.loaded.running() } else { Vec::new() };
        // Work that was asked about may be done by now.
        if *leaving == Leaving::Quit && !session.is_unsaved() {
            ends_work(context, session, &running, actions);
        } else {
            unsaved(context, session, leaving, &running, actions);
        }
        if !running.is_empty() {
            context.request_repaint_after(Duration::from_millis(200));
        }
    } else if session.document.asks_to_replace {
        changed(context, session, actions);
    } else {
        left(context, session, actions);
    }
}

/// Says what ends with the program: work that runs, and what was computed and is in no file.
fn list(ui: &mut egui::Ui, session: &Session, running: &[Running<'_>]) {
    for cloud in session.loaded.unsaved_values() {
        ui.label(text!(
            "{cloud}: its distances or ghosts are in no file, and lost if glint ends now. {COMMAND}+E saves the points \
             with them.",
            cloud,
            COMMAND
        ));
    }
    for work in running {
        ui.label(text!("{work}. It is stopped if glint ends now, and nothing is kept of it.", work));
    }
}

/// Asks whether to end work that runs.
fn ends_work(context: &egui::Context, session: &Session, running: &[Running<'_>], actions: &mut Vec<Action>) {
    egui::Modal::new(egui::Id::unique("unsaved")).show(context, |ui| {
        ui.set_max_width(420.0);
        ui.heading(text!("Close glint?"));
        list(ui, session, running);
        if running.is_empty() && session.loaded.unsaved_values().next().is_none() {
            ui.label(text!("Nothing runs any more. What was computed and is in no file is lost if glint ends."));
        }
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let stay = ui.button(text!("Keep open"));
            if ui.memory(|memory| memory.focused().is_none()) {
                stay.request_focus();
            }
            let close = if running.is_empty() { text!("Close") } else { text!("Stop it and close") };
            let closes = ui.button(close).clicked();
            let stays = stay.clicked() || ui.input(|input| input.key_pressed(Key::Escape));
            let answers = [(closes, Filing::Discard), (stays, Filing::Stay)];
            let given = answers.into_iter().find(|(is_given, _)| *is_given);
            actions.extend(given.map(|(_, answer)| Action::File(answer)));
        });
    });
}

fn unsaved(
    context: &egui::Context,
    session: &Session,
    leaving: &Leaving,
    running: &[Running<'_>],
    actions: &mut Vec<Action>,
) {
    let before = match leaving {
        Leaving::Quit => text!("before glint ends"),
        Leaving::Open(_) | Leaving::Restore => text!("before it makes room for another"),
        Leaving::Close(_) => text!("before its last cloud is closed"),
    };
    egui::Modal::new(egui::Id::unique("unsaved")).show(context, |ui| {
        ui.set_max_width(420.0);
        ui.heading(text!("Save the scene?"));
        let name = session.document.place.as_ref().map(|place| place.display().to_string());
        let name = name.as_deref().map_or(text!("This scene, which has no file yet,"), short_name);
        ui.label(text!("{name} has changes that are not saved. Save them {before}?", name, before));
        if *leaving == Leaving::Quit {
            list(ui, session, running);
        }
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let save = ui.button(text!("Save"));
            if ui.memory(|memory| memory.focused().is_none()) {
                save.request_focus();
            }
            let answers = [
                (save.clicked(), Filing::SaveAndLeave),
                (ui.button(text!("Discard")).on_hover_text(text!("The changes are lost")).clicked(), Filing::Discard),
                (
                    ui.button(text!("Cancel")).clicked() || ui.input(|input| input.key_pressed(Key::Escape)),
                    Filing::Stay,
                ),
            ];
            let given = answers.into_iter().find(|(is_given, _)| *is_given);
            actions.extend(given.map(|(_, answer)| Action::File(answer)));
        });
    });
}

/// Asks what to do with a file that is not as this window knows it. Nothing is replaced unasked, so no button has the
/// keyboard.
fn changed(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    egui::Modal::new(egui::Id::unique("changed")).show(context, |ui| {
        ui.set_max_width(420.0);
        ui.heading(text!("Replace the file?"));
        let name = session.document.place.as_ref().map(|place| place.display().to_string()).unwrap_or_default();
        ui.label(text!(
            "Another program has changed {name} since it was opened or saved here. The scene is not saved yet.",
            name = short_name(&name)
        ));
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let answers = [
                (
                    ui.button(text!("Replace")).on_hover_text(text!("What the other program has written is lost")),
                    Filing::Replace,
                ),
                (ui.button(text!("Save as…")), Filing::SaveAs),
                (ui.button(text!("Cancel")), Filing::Stay),
            ];
            let is_esc = ui.input(|input| input.key_pressed(Key::Escape));
            let given = answers.into_iter().find(|(button, _)| button.clicked()).map(|(_, answer)| answer);
            actions.extend(given.or(is_esc.then_some(Filing::Stay)).map(Action::File));
        });
    });
}

/// Offers the newest work that was not saved. It waits while something else asks, and takes no key unasked.
fn left(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    let Some(abandoned) = session.document.abandoned.last().filter(|_| session.document.offers) else { return };
    let has_question = session.path_prompt.is_some()
        || session.palette.is_some()
        || session.shortcuts_are_open
        || session.tools.picture_draft.is_some()
        || session.sweeps.asked.is_some()
        || session.filming.recording.asked.is_some();
    if has_question {
        return;
    }
    let window = egui::Window::new(text!("Unsaved work")).collapsible(false).resizable(false);
    window.anchor(egui::Align2::CENTER_TOP, [0.0, 60.0]).show(context, |ui| {
        ui.set_width(400.0);
        ui.label(text!(
            "glint ended {age} before its work on {abandoned} was saved.",
            age = abandoned.age(),
            abandoned = abandoned.name()
        ));
        let more = session.document.abandoned.len() - 1;
        if more > 0 {
            let left =
                if more == 1 { text!("One more is left.").to_owned() } else { text!("{more} more are left.", more) };
            ui.label(RichText::new(left).small().color(theme::WEAK));
        }
        ui.horizontal(|ui| {
            let answers = [
                (text!("Restore"), text!("Closes what is open, and shows the work as it was"), Filing::Restore),
                (text!("Delete"), text!("The work is lost"), Filing::DeleteLeft),
                (text!("Later"), text!("Recent has it, and the next start asks again"), Filing::Later),
            ];
            for (text, help, answer) in answers {
                if ui.button(text).on_hover_text(help).clicked() {
                    actions.push(Action::File(answer));
                }
            }
        });
    });
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use crate::viewer::interface;
    use crate::viewer::loaded::Writing;
    use crate::viewer::requests::outside::{Asked, Effect};
    use crate::viewer::requests::work::Work;

    #[test]
    fn the_question_names_the_scene_and_each_button_answers_it() {
        let mut harness = Harness::builder().with_size([800.0, 600.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                session.show_and_act(|session, actions| show(ui.ctx(), session, actions));
            },
            Session::with_two_points(),
        );
        harness.state_mut().act(Action::AddMirror(scene::Shape::Sphere));
        for (button, quits) in [("Cancel", false), ("Save", false), ("Discard", true)] {
            harness.state_mut().act(Action::Quit);
            harness.run_ok();
            assert!(harness.query_by_label_contains("This scene, which has no file yet, has changes").is_some());
            harness.get_by_label(button).click();
            harness.run_ok();
            assert_eq!((harness.state().document.asked.is_none(), harness.state().wants_to_quit), (true, quits));
        }
        let effects = &harness.state().outside.effects;
        let asks_place = effects.iter().any(|effect| matches!(effect, Effect::AskPlace(Asked::Scene, _)));
        assert!(asks_place, "a scene without a file asks for its place");
    }

    #[test]
    fn work_that_runs_is_named_before_glint_ends_and_each_button_answers() {
        let mut harness = Harness::builder().with_size([800.0, 600.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                session.show_and_act(|session, actions| show(ui.ctx(), session, actions));
            },
            Session::with_two_points(),
        );
        let progress = |done| {
            let progress = std::sync::Arc::new(cloud::Progress::default());
            progress.set_total(5);
            progress.add(done);
            progress
        };
        let says = |harness: &Harness<'_, Session>, text: &str| harness.query_by_label_contains(text).is_some();
        let writing = Writing { path: "/scans/big3.csv".into(), progress: progress(2), added: Vec::new() };
        harness.state_mut().loaded.writing = Some(writing);
        harness.state_mut().act(Action::Quit);
        harness.run_steps(2);
        assert!(!harness.state().wants_to_quit && says(&harness, "big3.csv is being saved (40 %). It is stopped"));
        harness.get_by_label("Keep open").click();
        harness.run_steps(2);
        let session = harness.state_mut();
        assert!(
            !session.document.asks() && !session.wants_to_quit && !session.loaded.running()[0].progress.is_cancelled()
        );
        // Where a scene is unsaved as well, one question names both.
        session.loaded.comparisons.under_way = Some(("a to b, M3C2".into(), progress(1)));
        session.act(Action::AddMirror(scene::Shape::Sphere));
        session.act(Action::Quit);
        harness.run_steps(2);
        assert!(says(&harness, "has changes that are not saved") && says(&harness, "big3.csv is being saved (40 %)"));
        assert!(says(&harness, "a to b, M3C2: being compared (20 %)"));
        harness.get_by_label("Cancel").click();
        harness.run_steps(2);
        harness.state_mut().act(Action::Undo);
        harness.state_mut().act(Action::Quit);
        harness.run_steps(2);
        assert!(says(&harness, "Close glint?") && !says(&harness, "has changes that are not saved"));
        // What was asked about ends by itself.
        let loaded = &mut harness.state_mut().loaded;
        (loaded.writing, loaded.comparisons.under_way) = (None, None);
        harness.run_steps(2);
        assert!(says(&harness, "Nothing runs any more"));
        harness.state_mut().loaded.comparisons.under_way = Some(("a to b, M3C2".into(), progress(1)));
        harness.run_steps(2);
        harness.get_by_label("Stop it and close").click();
        harness.run_steps(2);
        assert!(harness.state().wants_to_quit);
    }

    #[test]
    fn a_file_that_another_program_has_changed_is_asked_about_with_three_answers() {
        let mut harness = Harness::builder().with_size([800.0, 600.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                session.show_and_act(|session, actions| show(ui.ctx(), session, actions));
            },
            Session::with_two_points(),
        );
        let place = std::path::PathBuf::from("/scans/hall.toml");
        for (button, saves, asks_place) in
            [("Cancel", false, false), ("Save as…", false, true), ("Replace", true, false)]
        {
            let session = harness.state_mut();
            session.outside.effects.clear();
            (session.document.place, session.document.asks_to_replace) = (Some(place.clone()), true);
            harness.run_ok();
            assert!(harness.query_by_label_contains("Another program has changed hall.toml").is_some());
            harness.get_by_label(button).click();
            harness.run_ok();
            let effects = &harness.state().outside.effects;
            let is_saved = |effect: &Effect| matches!(effect, Effect::Work(Work::SaveScene { known: None, path, .. }) if *path == place);
            assert_eq!(effects.iter().any(is_saved), saves, "{button}");
            let is_asked = |effect: &Effect| matches!(effect, Effect::AskPlace(Asked::Scene, _));
            assert_eq!(effects.iter().any(is_asked), asks_place, "{button}");
            assert!(!harness.state().document.asks());
        }
    }

    #[test]
    fn keys_act_that_follow_the_esc_which_answers_the_question_in_the_same_frame() {
        let mut harness = Harness::builder().with_size([1100.0, 800.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                let actions = interface::show(ui, session, None);
                session.act_all(actions);
            },
            Session::with_two_points(),
        );
        harness.run_ok();
        let key = |key| egui::Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers: egui::Modifiers::NONE,
        };
        let by = |harness: &Harness<'_, Session>| harness.state().scene.settings.color.by;
        let before = by(&harness);
        harness.state_mut().document.asked = Some(Leaving::Quit);
        harness.run_ok();
        harness.input_mut().events.push(key(Key::Num3));
        harness.run_ok();
        assert!(by(&harness) == before && harness.state().document.asked.is_some());
        harness.input_mut().events.extend([key(Key::Num4), key(Key::Escape), key(Key::Num2)]);
        harness.run_ok();
        assert_eq!(harness.state().document.asked, None);
        assert_eq!(by(&harness), scene::ColorBy::Height);
    }

    #[test]
    fn unsaved_work_is_offered_without_taking_a_key_and_never_where_something_else_was_named() {
        let folder = tempfile::tempdir().unwrap();
        let left = || {
            use crate::viewer::requests::autosave::{Home, Keeper};
            let keeper = Keeper::new(folder.path().to_owned());
            let home = Home { path: "/scans/hall.toml".into(), known: 0 };
            keeper.keep(Some(("clouds = [\"a.laz\"]\n", Some(&home)))).unwrap();
            drop(keeper);
            crate::viewer::requests::autosave::abandoned(folder.path())
        };
        let mut harness = Harness::builder().with_size([1100.0, 800.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                let actions = interface::show(ui, session, None);
                session.act_all(actions);
            },
            Session::with_two_points(),
        );
        let offers = |harness: &Harness<'_, Session>| harness.query_by_label("Restore").is_some();
        let session = harness.state_mut();
        session.document.find_abandoned(left(), &["tile.laz".into()], &mut session.outside);
        harness.run_ok();
        assert!(!offers(&harness), "a file was named");
        harness.get_by_label("Recent").click();
        harness.run_ok();
        harness.get_by_label_contains("ago…").click();
        harness.run_ok();
        assert!(offers(&harness));
        harness.key_press(Key::Enter);
        harness.run_ok();
        assert!(offers(&harness) && harness.state().document.abandoned.len() == 1, "Enter answers nothing");
        harness.state_mut().act(Action::OpenPrompt);
        harness.run_ok();
        assert!(!offers(&harness), "one question at a time");
        harness.state_mut().act(Action::ClosePrompt);
        // The scene file itself, or nothing, is named.
        for named in [vec!["/scans/hall.toml".into()], Vec::new()] {
            let session = harness.state_mut();
            session.document.offers = false;
            let abandoned = std::mem::take(&mut session.document.abandoned);
            session.document.find_abandoned(abandoned, &named, &mut session.outside);
            harness.run_ok();
            assert!(offers(&harness), "{named:?}");
        }
    }
}
