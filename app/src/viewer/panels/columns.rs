//! The window that asks what the columns of a table are, where neither a line of the file nor `--columns` names them.

use egui::{Key, RichText, Ui};

use crate::shared::language::text;
use crate::viewer::look::theme;
use crate::viewer::requests::action::Action;
use crate::viewer::requests::columns::{ColumnsDraft, MEANINGS, Naming, attribute};
use crate::viewer::session::Session;

/// Draws the window for the table that waits first, if one does.
pub fn show(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    let Some(before) = session.unnamed.first() else { return };
    let (mut draft, mut is_open, mut answer) = (before.clone(), true, None);
    // Esc closes what is open over the window.
    let takes_esc = session.palette.is_none() && !egui::Popup::is_any_open(context);
    let name = before.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    egui::Window::new(text!("Columns of {name}", name))
        .id(egui::Id::unique("columns of a table"))
        .open(&mut is_open)
        .collapsible(false)
        .resizable(false)
        .anchor(egui::Align2::CENTER_TOP, [0.0, 80.0])
        .show(context, |ui| answer = contents(ui, &mut draft, takes_esc));
    if draft != *before {
        actions.push(Action::Name(Naming::Change(Box::new(draft))));
    }
    let answer = answer.or_else(|| (!is_open).then(|| Naming::Cancel(before.path.clone())));
    actions.extend(answer.map(Action::Name));
}

/// `takes_esc` says that Esc gives the table up.
fn contents(ui: &mut Ui, draft: &mut ColumnsDraft, takes_esc: bool) -> Option<Naming> {
    ui.set_width(560.0);
    ui.label(format!("{}.", draft.table.by));
    egui::ScrollArea::horizontal().show(ui, |ui| table(ui, draft));
    ui.add_space(4.0);
    let names = draft.names();
    let entered = ui.horizontal(|ui| text_line(ui, draft)).inner;
    let told = match &names {
        Ok(_) => RichText::new(text!("Names of attributes may be any: x,y,z,gps_time")).color(theme::WEAK),
        Err(problem) => RichText::new(problem).color(theme::ERROR),
    };
    ui.label(told.small());
    ui.horizontal(|ui| {
        let opens =
            ui.add_enabled(names.is_ok(), egui::Button::new(text!("Open"))).clicked() || entered && names.is_ok();
        let is_esc = takes_esc && ui.input(|input| input.key_pressed(Key::Escape));
        let is_cancelled = ui.button(text!("Cancel")).clicked() || is_esc;
        match (is_cancelled, opens) {
            (true, _) => Some(Naming::Cancel(draft.path.clone())),
            (false, opens) => opens.then_some(Naming::Open),
        }
    })
    .inner
}

/// Draws the list of meanings of each column above its first values.
fn table(ui: &mut Ui, draft: &mut ColumnsDraft) {
    egui::Grid::new("columns").striped(true).show(ui, |ui| {
        for column in 0..draft.table.names.len() {
            let name = draft.name(column);
            let list = egui::ComboBox::from_id_salt(column).width(84.0).height(340.0).truncate().selected_text(&name);
            let list = list.show_ui(ui, |ui| {
                let attribute = if MEANINGS.contains(&name.as_str()) { attribute(column) } else { name.clone() };
                for meaning in MEANINGS.into_iter().chain([attribute.as_str()]) {
                    let help =
                        if meaning == attribute { text!("An attribute, to colour and to filter by") } else { "" };
                    let option = ui.selectable_label(name == meaning, meaning);
                    let option = if help.is_empty() { option } else { option.on_hover_text(help) };
                    if option.clicked() {
                        draft.choose(column, meaning);
                    }
                }
            });
            list.response.accessible_name(text!("Column {column}", column = column + 1));
        }
        ui.end_row();
        for line in &draft.table.lines {
            for value in line {
                ui.label(RichText::new(value).monospace().size(11.5));
            }
            ui.end_row();
        }
    });
}

/// Draws the field of the names. Returns whether Enter was pressed in it.
fn text_line(ui: &mut Ui, draft: &mut ColumnsDraft) -> bool {
    let label = ui.label("--columns");
    let field = egui::TextEdit::singleline(&mut draft.text).desired_width(400.0);
    let response = ui.add(field).labelled_by(label.id);
    if !draft.is_shown {
        draft.is_shown = true;
        response.request_focus();
    }
    if ui.button(text!("Copy")).on_hover_text(text!("Copies the option for the command line")).clicked() {
        ui.ctx().copy_text(format!("--columns {}", draft.text.trim()));
    }
    response.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter))
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use crate::viewer::interface;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::requests::work::Work;

    fn harness() -> Harness<'static, Session> {
        Harness::builder().with_size([1100.0, 800.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                let actions = interface::show(ui, session, None);
                session.act_all(actions);
            },
            Session::new(Preferences::default()),
        )
    }

    /// Opens files as a drop does, and looks at tables as the window does.
    fn open(harness: &mut Harness<'static, Session>, paths: &[PathBuf]) {
        paths.iter().for_each(|path| harness.state_mut().act(Action::Open(path.clone())));
        look(harness);
    }

    fn look(harness: &mut Harness<'static, Session>) {
        let found = std::cell::RefCell::new(Vec::new());
        for effect in std::mem::take(&mut harness.state_mut().outside.effects) {
            match effect {
                Effect::Work(work @ Work::LookAtTable(_)) => {
                    work.run(&scene::Stream::default(), |one| found.borrow_mut().push(one));
                }
                other => harness.state_mut().outside.effects.push(other),
            }
        }
        found.into_inner().into_iter().for_each(|found| harness.state_mut().on_found(found));
        harness.run_ok();
    }

    fn opened(harness: &Harness<'_, Session>) -> Vec<PathBuf> {
        let effects = harness.state().outside.effects.iter();
        let inputs = effects.flat_map(|effect| match effect {
            Effect::Load { inputs } => inputs.iter().map(|input| PathBuf::from(input.name())).collect(),
            _ => Vec::new(),
        });
        inputs.collect()
    }

    fn properties(path: &Path) -> Vec<String> {
        let source = codec::open(path).unwrap();
        source.info().properties.iter().map(|property| property.name.clone()).collect()
    }

    fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    const UNNAMED: &str = "1 2 3 0.25 7.5\n4 5 6 0.5 8.5\n";

    #[test]
    fn a_table_is_asked_about_only_where_no_line_names_its_columns() {
        let folder = tempfile::tempdir().unwrap();
        let named = write(folder.path(), "named.csv", "x,y,z,class\n1,2,3,4\n5,6,7,8\n");
        let scanner = write(folder.path(), "scan.txt", "2\n1 2 3\n4 5 6\n");
        let plain = write(folder.path(), "plain.xyz", "1 2 3\n4 5 6\n");
        let unnamed = write(folder.path(), "unnamed.xyz", UNNAMED);
        let mut harness = harness();
        open(&mut harness, &[named.clone(), scanner.clone(), plain.clone(), unnamed.clone()]);
        assert_eq!(opened(&harness), [named, scanner, plain]);
        assert!(harness.query_by_label("Columns of unnamed.xyz").is_some());
        assert!(harness.query_by_label_contains("No line names the columns. Taken for a place by the order").is_some());
        for text in ["1", "0.25", "8.5"] {
            assert!(harness.query_all_by_label(text).next().is_some(), "{text}");
        }
        harness.get_by_label("Cancel").click();
        harness.run_ok();
        assert!(harness.state().unnamed.is_empty() && opened(&harness).len() == 3);
    }

    #[test]
    fn a_table_that_the_program_is_started_with_is_asked_about_too() {
        let folder = tempfile::tempdir().unwrap();
        let named = write(folder.path(), "named.csv", "x,y,z,class\n1,2,3,4\n5,6,7,8\n");
        let plain = write(folder.path(), "plain.xyz", "1 2 3\n4 5 6\n");
        let unnamed = write(folder.path(), "unnamed.csv", "a;b;c;d\n1;2;3;4\n");
        let mut harness = harness();
        harness.state_mut().open_at_start(world::resolve(&[&unnamed, &named, &plain]));
        harness.run_ok();
        assert_eq!(opened(&harness), [named, plain]);
        assert!(harness.query_by_label("Columns of unnamed.csv").is_some());
        harness.state_mut().unnamed[0].text = "x,y,z,class".into();
        harness.run_ok();
        harness.get_by_label("Open").click();
        harness.run_ok();
        assert_eq!(opened(&harness)[2..], [unnamed]);
        // A scene file may say more of its clouds.
        let table = write(folder.path(), "scene.xyz", UNNAMED);
        let scene = write(folder.path(), "scene.toml", "clouds = [\"scene.xyz\"]\n");
        harness.state_mut().open_at_start(world::resolve(&[scene]));
        assert_eq!(opened(&harness)[3..], [table]);
    }

    #[test]
    fn a_table_that_is_given_up_becomes_no_mirror_later() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), "a.xyz", UNNAMED);
        let mut harness = harness();
        let prompt = crate::viewer::requests::path_prompt::PathPrompt::for_mirror_points();
        harness.state_mut().act(Action::ChangePrompt(Box::new(prompt)));
        harness.state_mut().act(Action::OpenPrompted(path.display().to_string()));
        assert_eq!(harness.state().loaded.awaited_markings.len(), 1);
        look(&mut harness);
        harness.get_by_label("Cancel").click();
        harness.run_ok();
        assert!(harness.state().loaded.awaited_markings.is_empty());
    }

    #[test]
    fn what_is_chosen_is_the_text_of_the_option_and_how_the_file_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let (first, second) = (write(folder.path(), "a.xyz", UNNAMED), write(folder.path(), "b.txt", UNNAMED));
        let mut harness = harness();
        open(&mut harness, &[first.clone(), second.clone()]);
        let text = |harness: &Harness<'_, Session>| harness.state().unnamed[0].text.clone();
        assert_eq!(text(&harness), "x,y,z,column_4,column_5");
        // y and z change places.
        for (column, meaning) in [("Column 2", "z"), ("Column 4", "intensity"), ("Column 5", "skip")] {
            harness.get_by_label(column).click();
            harness.run_ok();
            harness.get_by_role_and_label(egui::accesskit::Role::Button, meaning).click();
            harness.run_ok();
        }
        assert_eq!(text(&harness), "x,z,y,intensity,skip");
        harness.get_by_label("Copy").click();
        harness.run_ok();
        harness.get_by_label("Open").click();
        harness.run_ok();
        assert_eq!(opened(&harness), std::slice::from_ref(&first));
        assert_eq!(properties(&first), ["x", "z", "y", "intensity"]);
        let session = harness.state();
        let saved = session.scene.session_text(&[first.display().to_string()], &session.loaded, None).unwrap();
        let saved = scene::SceneFile::parse(&saved).unwrap();
        let columns: Vec<_> = saved.cloud_settings.iter().map(|own| (Path::new(&own.cloud), &own.columns)).collect();
        assert_eq!(columns, [(first.as_path(), &Some("x,z,y,intensity,skip".to_owned()))]);
        assert_eq!(properties(&second), ["x", "y", "z", "column_4", "column_5"], "the other file has its own columns");
        assert!(harness.query_by_label("Columns of b.txt").is_some(), "the next file is asked about");
        // What cannot be is said, and is not opened.
        harness.state_mut().unnamed[0].text = "x,y,q".into();
        harness.run_ok();
        assert!(harness.query_by_label_contains("no column z").is_some());
        harness.key_press(Key::Enter);
        harness.run_ok();
        assert!(harness.state().unnamed.len() == 1);
        harness.state_mut().unnamed[0].text = "x,y,z,gps_time".into();
        harness.run_ok();
        harness.get_by_label("--columns").focus();
        harness.run_ok();
        harness.key_press(Key::Enter);
        harness.run_ok();
        assert!(harness.state().unnamed.is_empty());
        assert_eq!(properties(&second), ["x", "y", "z", "gps_time"]);
        assert_eq!(opened(&harness), [first, second]);
    }

    #[test]
    fn esc_gives_up_one_table_and_the_next_is_asked_about() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a.xyz", "b.xyz"].map(|name| write(folder.path(), name, UNNAMED));
        let mut harness = harness();
        open(&mut harness, &paths);
        harness.key_press(Key::Escape);
        harness.run_ok();
        assert_eq!(harness.state().unnamed.iter().map(|draft| draft.path.clone()).collect::<Vec<_>>(), paths[1..]);
    }

    #[test]
    fn esc_in_an_open_list_closes_the_list_only() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), "a.xyz", UNNAMED);
        let mut harness = harness();
        open(&mut harness, &[path]);
        harness.get_by_label("Column 2").click();
        harness.run_ok();
        assert!(egui::Popup::is_any_open(&harness.ctx));
        harness.key_press(Key::Escape);
        harness.run_ok();
        assert!(!egui::Popup::is_any_open(&harness.ctx) && harness.state().unnamed.len() == 1);
    }

    #[test]
    fn the_palette_costs_no_names_that_are_typed() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), "a.xyz", UNNAMED);
        let mut harness = harness();
        open(&mut harness, &[path]);
        harness.get_by_label("--columns").focus();
        harness.run_ok();
        harness.key_press_modifiers(egui::Modifiers::COMMAND, Key::K);
        harness.run_ok();
        assert!(harness.state().palette.is_none(), "the field of the names keeps the keyboard");
        harness.state_mut().act(Action::TogglePalette);
        harness.run_ok();
        harness.key_press(Key::Escape);
        harness.run_ok();
        assert!(harness.state().palette.is_none());
        assert_eq!(harness.state().unnamed.len(), 1, "Esc has closed the palette only");
    }
}
