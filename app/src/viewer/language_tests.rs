//! Tests of the window's languages: each table has all texts of the window and no others.

use std::collections::BTreeSet;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use param::Kind;
use render::class_name;
use scene::{ClipShape, Language, METHODS, MeasurementKind, PRESETS, Settings, Shape};

use crate::shared::language::{self, translated};
use crate::viewer::interface;
use crate::viewer::look::tab::Tab;
use crate::viewer::look::theme;
use crate::viewer::look::widgets::{NAME_WIDTH, SMALLEST};
use crate::viewer::panels::parameters::{english_title, title};
use crate::viewer::panels::side;
use crate::viewer::requests::action::Action;
use crate::viewer::requests::bindings::BINDINGS;
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::session::Session;

/// The sources of the program, each until its tests, with its name.
fn sources() -> Vec<(String, String)> {
    let mut folders = vec![std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src")];
    let mut sources = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.display().to_string();
            if path.is_dir() {
                folders.push(path);
            } else if name.ends_with(".rs") && !name.ends_with("tests.rs") && !name.ends_with("language.rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                sources.push((name, text.split("mod tests {").next().unwrap().to_owned()));
            }
        }
    }
    sources
}

/// The string that a piece of source begins with, if it begins with one.
fn literal(source: &str) -> Option<String> {
    let mut letters = source.trim_start().strip_prefix('"')?.chars();
    let mut text = String::new();
    loop {
        match letters.next()? {
            '"' => return Some(text),
            '\\' => match letters.next()? {
                'n' => text.push('\n'),
                // A line that goes on begins where its indentation ends.
                '\n' => letters = letters.as_str().trim_start().chars(),
                letter => text.push(letter),
            },
            letter => text.push(letter),
        }
    }
}

/// All texts of the window, in English: those that the sources mark, and those of the tables that it shows.
fn texts() -> BTreeSet<String> {
    let mut texts = BTreeSet::new();
    for (_, source) in sources() {
        for mark in ["text!(", "english!("] {
            texts.extend(source.split(mark).skip(1).filter_map(literal));
        }
    }
    for binding in BINDINGS {
        texts.extend([binding.section, binding.text].map(str::to_owned));
    }
    for params in Settings::default().groups() {
        let group = params.group();
        texts.extend([group.section, side::subject(group), group.help].map(str::to_owned));
        for field in &group.fields {
            texts.extend([english_title(field.name), field.help.to_owned()]);
            if let Kind::Choice { names, .. } = field.kind {
                // Methods keep their names, by which papers and files know them.
                let is_method = |name: &&str| METHODS.iter().any(|row| row.name == *name);
                texts.extend(names.iter().filter(|name| !is_method(name)).map(|name| (*name).to_owned()));
            }
        }
    }
    texts.extend(METHODS.iter().map(|row| row.help.to_owned()));
    texts.extend(PRESETS.iter().flat_map(|preset| [preset.name, preset.help]).map(str::to_owned));
    texts.extend(Shape::WITH_FORMULA.iter().map(|shape| shape.name().to_owned()));
    texts.extend([ClipShape::Box, ClipShape::Sphere, ClipShape::Slab].map(|shape| shape.name().to_owned()));
    let kinds = ["mirror", "light", "clip", "measurement", "note", "profile"];
    texts.extend(kinds.map(str::to_owned));
    texts.extend((0..=u8::MAX).map(|class| class_name(class).to_owned()).filter(|name| !name.is_empty()));
    texts.extend(MeasurementKind::ALL.map(|kind| kind.name().to_owned()));
    texts
}

/// The names of the places in a text, in order of the alphabet.
fn places(text: &str) -> Vec<&str> {
    let mut names: Vec<&str> =
        text.split('{').skip(1).filter_map(|rest| rest.split_once('}')).map(|(name, _)| name).collect();
    names.sort_unstable();
    names
}

#[test]
fn each_table_has_all_texts_of_the_window_and_no_others() {
    let texts = texts();
    for (code, table) in language::tables() {
        let known: BTreeSet<String> = table.keys().cloned().collect();
        let assert_none =
            |found: BTreeSet<&String>, what: &str| assert!(found.is_empty(), "{code}: {what}: {found:#?}");
        assert_none(texts.difference(&known).collect(), "texts that the table lacks");
        assert_none(known.difference(&texts).collect(), "texts that the window has not");
        let other_places =
            |(english, text): (&'static String, &String)| (places(english) != places(text)).then_some(english);
        assert_none(table.iter().filter_map(other_places).collect(), "texts with other places than the English ones");
    }
}

#[test]
fn what_the_window_shows_is_marked_for_translation() {
    let shows = [
        ".label(",
        ".heading(",
        ".button(",
        ".small_button(",
        ".menu_button(",
        ".on_hover_text(",
        ".on_disabled_hover_text(",
        ".accessible_name(",
        ".hint_text(",
        "RichText::new(",
        "Button::new(",
        "Window::new(",
        "name_label(ui, ",
        "outside.note(",
        "outside.warning(",
    ];
    let mut unmarked = Vec::new();
    for (name, source) in sources() {
        for call in shows {
            for rest in source.split(call).skip(1) {
                let rest = rest.strip_prefix("format!(").unwrap_or(rest);
                let text = literal(rest).unwrap_or_default();
                let words = text
                    .split(['{', '}'])
                    .step_by(2)
                    .flat_map(|part| part.split(|letter: char| !letter.is_alphabetic()));
                let has_words = words.filter(|word| word.len() > 1).count() > 0;
                // Options, names of files and that of the program are the same in each language.
                let is_name = text.starts_with("--") || text.ends_with(".laz") || text == "glint";
                unmarked.extend((has_words && !is_name).then(|| format!("{name}: {call}\"{text}\"")));
            }
        }
    }
    assert_eq!(unmarked, Vec::<String>::new());
}

#[test]
fn the_names_of_all_parameters_fit_into_their_lines_in_each_language() {
    language::speak(Language::German);
    let context = egui::Context::default();
    let mut wide = Vec::new();
    drop(context.run_ui(egui::RawInput::default(), |ui| {
        for field in Settings::default().groups().into_iter().flat_map(|params| &params.group().fields) {
            let font = egui::FontId::proportional(SMALLEST);
            let name = egui::WidgetText::from(title(field.name));
            let galley = name.into_galley(ui, Some(egui::TextWrapMode::Extend), f32::INFINITY, font);
            wide.extend((galley.size().x > NAME_WIDTH).then(|| (title(field.name), galley.size().x)));
        }
    }));
    assert_eq!(wide, []);
}

#[test]
fn the_language_changes_at_once_and_the_palette_finds_both() {
    let mut session = Session::new(Preferences::default());
    session.act(Action::OpenTab(Tab::Look));
    let mut harness = Harness::builder().with_size([1280.0, 2400.0]).with_max_steps(32).build_ui_state(
        |ui, session: &mut Session| {
            theme::apply(ui.ctx());
            language::speak(match session.preferences.language {
                Language::System => Language::English,
                chosen => chosen,
            });
            let mut actions = interface::show(ui, session, None);
            actions.retain(|action| !matches!(action, Action::Resize(_)));
            session.act_all(actions);
        },
        session,
    );
    harness.run_steps(3);
    assert!(harness.query_by_label("Point size").is_none() && harness.query_by_label("Open…").is_some());
    harness.get_by_role_and_label(egui::accesskit::Role::ComboBox, "Language").click();
    harness.run_steps(3);
    harness.get_by_label("Deutsch").click();
    harness.run_steps(4);
    for label in ["Öffnen…", "Licht", "Farbe", "Lesezeichen und Pfade", "Ansicht merken", "Hintergrund"] {
        assert!(harness.query_all_by_label(label).next().is_some(), "{label}");
    }
    assert!(harness.query_by_label("Open…").is_none());
    let searches = [
        ("in den raum", "Ansichten: In den Raum"),
        ("inside of the room", "Ansichten: In den Raum"),
        ("hilfe", "Werkzeuge und Fenster: Diese Übersicht"),
        ("vollbild", "Werkzeuge und Fenster: Vollbild"),
        ("bildschirmfoto", "Dateien und Bilder: Bild speichern"),
        ("querschnitt", "Messungen und Notizen: Linie eines Profils zeichnen; nochmals: aufgeben"),
        ("draufsicht", "Ansichten: Von oben"),
        ("maßband", "Messungen und Notizen: Ein Abstand"),
        ("punktgröße", "Farben und Punkte: Punkte größer"),
        ("seitenleiste", "Werkzeuge und Fenster: Leisten verbergen oder zeigen"),
    ];
    for (search, row) in searches {
        harness.state_mut().act(Action::TogglePalette);
        harness.run_steps(3);
        let palette = harness.state_mut().palette.as_mut().unwrap();
        palette.text = search.to_owned();
        harness.run_steps(3);
        assert!(harness.query_by_label(row).is_some(), "{search}");
        harness.state_mut().act(Action::TogglePalette);
        harness.run_steps(2);
    }
    assert_eq!(translated("Open…"), "Öffnen…");
}

#[test]
fn values_stand_at_their_places_whatever_the_order() {
    let fill = |text| language::filled(text, &[("count", &3), ("of", &"B{of}")]);
    assert_eq!(fill("{count} points of {of}"), "3 points of B{of}");
    assert_eq!(fill("of {of}: {count}, {else} {"), "of B{of}: 3, {else} {");
}
