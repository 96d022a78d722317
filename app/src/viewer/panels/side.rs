//! The panel on the left: buttons, the tabs with their sections, and the search for parameters, which shows those of
//! all tabs.

use egui::{Rect, RichText, Ui};

use param::{Group, Params};
use scene::{Language, Object};

use crate::shared::language::{english, text, translated};
use crate::system::fetching;
use crate::viewer::look::tab::Tab;
use crate::viewer::look::theme;
use crate::viewer::look::widgets::choice;
use crate::viewer::objects::ObjectId;
use crate::viewer::objects::clouds::{CloudEntry, short_name};
use crate::viewer::panels;
use crate::viewer::panels::parameters::Match;
use crate::viewer::requests::action::{Action, Filing};
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;

/// The sections of parameters that have panels of their own. All other sections are generated from the parameter
/// tables.
pub const OWN_PANELS: [&str; 4] = ["Colour", "Light", "Reflections", "Truth"];

/// Parameters that are shown elsewhere: the panel of streaming shows the point budget, and the window draws all pixels
/// of a picture at rest.
const ELSEWHERE: [&str; 2] = ["point_budget", "resolution"];

/// Draws the panel. Returns true if the section of the lights is open.
pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) -> bool {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        action_button(ui, text!("Open…"), Action::OpenDialog, actions);
        recent_menu(ui, session, actions);
        action_button(ui, text!("Save"), Action::File(Filing::Save), actions);
        action_button(ui, text!("Frame all"), Action::FrameAll, actions);
        action_button(ui, "?", Action::ToggleShortcuts, actions);
    });
    follow_selection(ui, session, actions);
    tab_row(ui, session, actions);
    search_field(ui, session, actions);
    ui.add_space(2.0);
    let tab = Tab::named(&session.preferences.tab);
    let place = ui.available_rect_before_wrap();
    let is_searched = !session.search.trim().is_empty();
    let has_chart = tab == Tab::Tuning && session.tuning.is_open && !is_searched;
    // The chart stays in view while the parameters above it are scrolled.
    let chart = if has_chart { panels::tuning::height(place.height()) } else { 0.0 };
    let (above, below) = place.split_top_bottom_at_y(place.bottom() - chart);
    // Each tab has a place of its own to which it is scrolled.
    let area = egui::ScrollArea::vertical().auto_shrink(false).id_salt(tab.name());
    let mut upper = ui.new_child(egui::UiBuilder::new().max_rect(above));
    let scrolled = area.show(&mut upper, |ui| {
        if is_searched {
            found(ui, session, actions);
            false
        } else {
            contents(ui, session, tab, actions)
        }
    });
    if has_chart {
        let mut lower = ui.new_child(egui::UiBuilder::new().max_rect(below));
        panels::tuning::show(&mut lower, session, actions);
    }
    ui.advance_cursor_after_rect(place);
    if session.frames.time_to_late(session.outside.now).is_some_and(|left| left.is_zero()) {
        late_notice(ui);
    }
    scrolled.inner
}

/// Opens the tab of an object that has just been selected or placed, so that a note can be written at once. Mirrors are
/// selected when a scene is opened, too, and leave the tab as it is.
fn follow_selection(ui: &Ui, session: &Session, actions: &mut Vec<Action>) {
    let place = egui::Id::unique("the object that was selected last");
    let before = ui.data_mut(|data| data.get_temp::<Option<ObjectId>>(place));
    let selected = session.scene.selected;
    if before == Some(selected) {
        return;
    }
    ui.data_mut(|data| data.insert_temp(place, selected));
    let tab = match selected.and_then(|id| session.scene.objects.get(id)).map(|(_, object)| object) {
        Some(object) if object.kind().is_over_picture => Tab::Measure,
        Some(Object::Light(_)) => Tab::Light,
        Some(Object::Clip(_)) => Tab::Data,
        _ => return,
    };
    actions.push(Action::OpenTab(tab));
}

fn tab_row(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let open = Tab::named(&session.preferences.tab);
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing = egui::vec2(1.0, 1.0);
        // All names fit into one row of the panel as it opens.
        ui.spacing_mut().button_padding.x = 2.0;
        for tab in Tab::ALL {
            let is_open = tab == open && session.search.is_empty();
            let name = RichText::new(translated(tab.name())).size(11.5);
            if ui.selectable_label(is_open, name).on_hover_text(tab.help()).clicked() {
                actions.push(Action::OpenTab(tab));
            }
        }
    });
}

/// Where egui keeps the focus of the search field.
pub fn search_id() -> egui::Id {
    egui::Id::unique("search for parameters")
}

fn search_field(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        let mut text = session.search.clone();
        let width = ui.available_width() - if text.is_empty() { 0.0 } else { 34.0 };
        let hint =
            text!("Find a parameter ({shortcut}: anything)", shortcut = bindings::shortcut(&Action::TogglePalette));
        let field = egui::TextEdit::singleline(&mut text).id(search_id()).hint_text(hint).desired_width(width);
        let response = ui.add(field).accessible_name(text!("Find a parameter"));
        if text != session.search {
            actions.push(Action::Search(text));
        }
        let is_left = response.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Escape));
        if session.search.is_empty() {
            return;
        }
        let help = text!("Show the tab again");
        if ui.small_button("×").on_hover_text(help).accessible_name(help).clicked() || is_left {
            actions.push(Action::Search(String::new()));
        }
    });
}

/// Draws the parameters of all tabs that the search finds: first those that have its words in their names, and then those
/// that have them in their helps.
fn found(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let mut count = 0;
    for rank in Match::ALL {
        for params in session.scene.settings.groups() {
            let group = params.group();
            let is_found = |field: &&param::Field| Match::of(&session.search, group, field) == Some(rank);
            let fields: Vec<&param::Field> = group.fields.iter().filter(is_found).collect();
            if fields.is_empty() {
                continue;
            }
            let tab = Tab::of_section(group.section);
            let place = format!("{} · {}", translated(tab.name()), translated(subject(group)));
            if ui.link(RichText::new(place).small()).on_hover_text(text!("Open its tab")).clicked() {
                actions.push(Action::OpenTab(tab));
            }
            panels::reflections::unused_notice(ui, session, group, actions);
            for field in fields {
                panels::parameters::parameter(ui, params, field.name, actions);
                count += 1;
            }
            ui.add_space(4.0);
        }
    }
    if count == 0 {
        ui.label(RichText::new(text!("No parameter has these words in its name or its help.")).color(theme::WEAK));
    }
}

/// What stands in place of the list of clouds: what is fetched or read, if anything is.
fn nothing_yet(session: &Session) -> String {
    let Some(job) = session.loaded.jobs.iter().find(|job| !job.is_loaded) else {
        return text!("Nothing is open.").to_owned();
    };
    match fetching::first() {
        Some((fetch, _)) => {
            text!("fetching {address}{others}", address = codec::last_part(&fetch.address), others = "")
        }
        None => text!("reading {job}", job = job.name),
    }
}

/// Draws the sections of a tab. Returns true if the section of the lights is open.
fn contents(ui: &mut Ui, session: &Session, tab: Tab, actions: &mut Vec<Action>) -> bool {
    let is_streaming = session.loaded.clouds.iter().any(|entry| entry.streamed.is_some());
    let mut lights_are_shown = false;
    match tab {
        Tab::Data => {
            section(ui, english!("Clouds"), true, |ui| {
                panels::clouds::show(ui, session, actions);
                if session.loaded.clouds.is_empty() {
                    ui.label(RichText::new(nothing_yet(session)).color(theme::WEAK));
                }
            });
            section(ui, english!("Clips and filters"), true, |ui| panels::clips::show(ui, session, actions));
        }
        Tab::Look => {
            section(ui, english!("Colour"), true, |ui| panels::colors::show(ui, session, actions));
            section(ui, english!("Bookmarks and paths"), true, |ui| panels::bookmarks::show(ui, session, actions));
        }
        Tab::Light => {
            lights_are_shown = section(ui, english!("Light"), true, |ui| panels::light::show(ui, session, actions));
        }
        Tab::Mirrors => drop(section(ui, english!("Mirrors"), true, |ui| {
            panels::mirrors::show(ui, session, actions);
            let text = text!("How reflections are found: tab {tab}", tab = translated(Tab::Tuning.name()));
            if ui.link(RichText::new(text).small()).on_hover_text(Tab::Tuning.help()).clicked() {
                actions.push(Action::OpenTab(Tab::Tuning));
            }
        })),
        Tab::Measure => {
            section(ui, english!("Measurements and notes"), true, |ui| {
                panels::measurements::show(ui, session, actions)
            });
            section(ui, english!("Profiles"), true, |ui| panels::profiles::show(ui, session, actions));
            section(ui, english!("Compare"), true, |ui| panels::comparing::show(ui, session, actions));
            section(ui, english!("Ghosts"), false, |ui| panels::ghosts::show(ui, session, actions));
        }
        Tab::Tuning => {
            section(ui, english!("Reflections"), true, |ui| panels::reflections::show(ui, session, actions));
            section(ui, english!("Truth"), true, |ui| panels::truth::show(ui, session, actions));
            section(ui, english!("Timings"), true, |ui| panels::timings::show(ui, session));
        }
        Tab::Streaming if is_streaming => {
            section(ui, english!("Streaming"), true, |ui| panels::streaming::show(ui, session, actions));
        }
        Tab::Streaming => {
            ui.label(RichText::new(text!("Nothing that is open is streamed.")).color(theme::WEAK));
        }
    }
    let mut shown: Vec<&str> = OWN_PANELS.into();
    // While a cloud is streamed, the panel of streaming shows its parameters.
    shown.extend(is_streaming.then_some(scene::Stream::table().section));
    for group in session.scene.settings.groups().map(Params::group) {
        if shown.contains(&group.section) || Tab::of_section(group.section) != tab {
            continue;
        }
        shown.push(group.section);
        // How files are read is chosen before they are open: what is open comes first.
        let is_open = group.section != scene::Surface::table().section;
        section(ui, group.section, is_open, |ui| parameter_groups(ui, session, group.section, actions));
    }
    if tab == Tab::Look {
        section(ui, english!("Window"), true, |ui| {
            let mut language = session.preferences.language;
            choice(ui, text!("Language"), &mut language, languages().into_iter());
            actions.extend((language != session.preferences.language).then_some(Action::Speak(language)));
        });
    }
    lights_are_shown
}

/// The languages of the window, each as it calls itself.
pub fn languages() -> [(Language, &'static str); 3] {
    [(Language::System, text!("as the system")), (Language::English, "English"), (Language::German, "Deutsch")]
}

/// Says at the lower end of the panel that the picture does not show its values yet. It covers the lowest line, so that
/// nothing moves when it comes and goes.
fn late_notice(ui: &mut Ui) {
    let panel = ui.max_rect();
    let area = Rect::from_min_max(egui::pos2(panel.left(), panel.bottom() - 18.0), panel.right_bottom());
    ui.painter().rect_filled(area, 0.0, theme::PANEL);
    let text = RichText::new(text!("Picture of earlier values; drawing…")).small().color(theme::WEAK);
    ui.place(area, egui::Label::new(text).selectable(false));
}

/// Where egui keeps in which frame of the window the keyboard was wanted for the first section of a tab.
fn wanted_section() -> egui::Id {
    egui::Id::unique("first section that gets the keyboard")
}

/// Gives the keyboard to the first section of the tab that is drawn in the next frame of the window.
pub fn focus_first_section(context: &egui::Context) {
    let frame = context.cumulative_frame_nr();
    context.data_mut(|data| data.insert_temp(wanted_section(), frame));
}

/// Draws a section that can be folded, by its English title. Returns true if it is open.
fn section(ui: &mut Ui, title: &str, is_open: bool, contents: impl FnOnce(&mut Ui)) -> bool {
    let heading = RichText::new(translated(title)).strong().size(13.5);
    let header = egui::CollapsingHeader::new(heading).id_salt(title).default_open(is_open);
    let shown = header.show_unindented(ui, |ui| {
        ui.add_space(2.0);
        contents(ui);
        ui.add_space(6.0);
    });
    let wanted: Option<u64> = ui.data_mut(|data| data.remove_temp(wanted_section()));
    if wanted.is_some_and(|frame| ui.ctx().cumulative_frame_nr() <= frame + 2) {
        shown.header_response.request_focus();
    }
    ui.separator();
    shown.body_response.is_some()
}

/// The subject of a group, with which its help begins: `Light.`, `Eye-dome lighting (Boucheny 2009): ...`.
pub fn subject(group: &Group) -> &str {
    group.help.split([':', '.', '(']).next().unwrap_or(group.help).trim()
}

/// The parameters that change nothing of what is open: the points of meshes and of built-in scenes where there are none.
/// The search finds them.
fn idle(session: &Session) -> Vec<(&'static str, &'static str)> {
    let clouds = &session.loaded.clouds;
    let has_mesh = clouds.iter().any(|entry| entry.source.as_ref().is_some_and(|source| source.is_mesh()));
    let has_built_in = clouds.iter().any(CloudEntry::is_built_in);
    let (surface, scene) = (scene::Surface::table().name, scene::SceneSettings::table().name);
    let of_meshes = (!has_mesh).then_some((surface, "mesh_points"));
    let of_scenes = (!has_built_in).then_some([(scene, "points"), (scene, "seed")]);
    of_meshes.into_iter().chain(of_scenes.into_iter().flatten()).collect()
}

fn parameter_groups(ui: &mut Ui, session: &Session, section: &str, actions: &mut Vec<Action>) {
    let groups = session.scene.settings.groups().into_iter().filter(|params| params.group().section == section);
    let groups: Vec<&dyn Params> = groups.collect();
    for params in &groups {
        parameter_group(ui, session, *params, groups.len() > 1, actions);
    }
}

pub fn parameter_group(
    ui: &mut Ui,
    session: &Session,
    params: &dyn Params,
    has_heading: bool,
    actions: &mut Vec<Action>,
) {
    let group = params.group();
    let idle = idle(session).into_iter().filter(|(name, _)| *name == group.name).map(|(_, field)| field);
    let skipped: Vec<&str> = ELSEWHERE.into_iter().chain(idle).collect();
    if group.fields.iter().all(|field| skipped.contains(&field.name)) {
        return;
    }
    if has_heading {
        ui.label(RichText::new(translated(subject(group))).small().color(theme::WEAK))
            .on_hover_text(translated(group.help));
    }
    panels::parameters::parameters(ui, params, &skipped, actions);
}

fn action_button(ui: &mut Ui, text: &str, action: Action, actions: &mut Vec<Action>) {
    let is_listed = |binding: &&bindings::Binding| binding.action == action;
    let help = bindings::BINDINGS.iter().find(is_listed).map_or("", |binding| translated(binding.text));
    let shortcut = bindings::shortcut(&action);
    let button = ui.button(text).on_hover_text(format!("{help} ({shortcut})"));
    let is_sign = !text.contains(char::is_alphabetic);
    let button = if is_sign { button.accessible_name(help) } else { button };
    if button.clicked() {
        actions.push(action);
    }
}

fn recent_menu(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    ui.menu_button(text!("Recent"), |ui| {
        for path in &session.preferences.sessions {
            let help = text!("Closes what is open, and opens {path}", path);
            if ui.button(short_name(path)).on_hover_text(help).clicked() {
                actions.push(Action::File(Filing::Open(path.into())));
            }
        }
        if let Some(left) = session.document.abandoned.last() {
            let text = text!("Unsaved work on {left}, {age}…", left = left.name(), age = left.age());
            if ui.button(text).on_hover_text(text!("Asks whether to restore it")).clicked() {
                actions.push(Action::File(Filing::Offer));
            }
        }
        let mut reopens = session.preferences.reopens;
        let help = text!("Where nothing else is named on the command line");
        if ui.checkbox(&mut reopens, text!("Open the last scene at the start")).on_hover_text(help).changed() {
            actions.push(Action::File(Filing::Reopen(reopens)));
        }
        ui.separator();
        let built_in = world::built_in_names();
        for recent in session.preferences.recent.iter().filter(|recent| !built_in.contains(recent)) {
            let help = text!("Adds {path} to what is open", path = recent);
            if ui.button(short_name(recent)).on_hover_text(help).clicked() {
                actions.push(Action::Open(recent.into()));
            }
        }
        ui.separator();
        for name in built_in {
            let help = text!("Closes what is open, and opens {path}", path = name);
            if ui.button(&name).on_hover_text(help).clicked() {
                actions.push(Action::File(Filing::Open(name.into())));
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;
    use scene::{Method, Note};

    use super::*;
    use crate::shared::language;
    use crate::viewer::requests::preferences::Preferences;

    fn harness(tab: Tab) -> Harness<'static, Session> {
        let mut session = Session::new(Preferences::default());
        session.act(Action::OpenTab(tab));
        Harness::builder().with_size([310.0, 1600.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                let mut actions = Vec::new();
                show(ui, session, &mut actions);
                session.act_all(actions);
            },
            session,
        )
    }

    fn has(harness: &Harness<'_, Session>, label: &str) -> bool {
        harness.query_all_by_label(label).next().is_some()
    }

    #[test]
    fn a_tab_shows_its_own_sections_and_is_remembered() {
        let mut harness = harness(Tab::Data);
        harness.run_ok();
        assert!(has(&harness, "Clouds") && !has(&harness, "Measurements and notes"));
        harness.get_by_label("Measure").click();
        harness.run_ok();
        assert!(!has(&harness, "Clouds") && has(&harness, "Measurements and notes"));
        assert_eq!(harness.state().preferences.tab, "Measure");
    }

    #[test]
    fn a_folded_section_stays_folded_in_another_language() {
        let mut harness = harness(Tab::Data);
        harness.run_ok();
        assert!(has(&harness, "Add clip"));
        harness.get_by_label("Clips and filters").click();
        harness.run_ok();
        assert!(!has(&harness, "Add clip"));
        language::speak(scene::Language::German);
        harness.run_ok();
        let is_folded = has(&harness, text!("Clips and filters")) && !has(&harness, text!("Add clip"));
        language::speak(scene::Language::English);
        assert!(is_folded);
    }

    #[test]
    fn the_first_tab_has_no_parameters_of_meshes_and_built_in_scenes_where_none_is_open() {
        let mut harness = harness(Tab::Data);
        harness.run_ok();
        assert!(!has(&harness, "Neighbours"), "how files are read is folded");
        harness.get_by_label("When loading").click();
        harness.run_ok();
        assert!(has(&harness, "Neighbours") && !has(&harness, "Mesh points") && !has(&harness, "Seed"));
        assert!(!has(&harness, "Built-in scenes"));
        harness.state_mut().act(Action::Search("mesh points".into()));
        harness.run_ok();
        assert!(has(&harness, "Mesh points"));
    }

    #[test]
    fn a_note_that_is_placed_opens_the_tab_in_which_it_is_written() {
        let mut harness = harness(Tab::Data);
        harness.run_ok();
        let note = Note { text: String::new(), on: true, color: [1.0; 3], position: DVec3::X, camera: None };
        let scene = &mut harness.state_mut().scene;
        scene.add_objects([Object::Note(note)]);
        scene.selected = scene.objects.notes.first().map(|placed| placed.id);
        harness.run_ok();
        assert_eq!(harness.state().preferences.tab, "Measure");
        // Another tab stays open while the note stays selected.
        harness.state_mut().act(Action::OpenTab(Tab::Look));
        harness.run_ok();
        assert_eq!(harness.state().preferences.tab, "Look");
    }

    #[test]
    fn parameters_of_other_methods_are_folded_but_found_by_the_search() {
        let mut harness = harness(Tab::Tuning);
        harness.state_mut().scene.settings.reflection.method = Method::CubemapTrace;
        harness.run_ok();
        assert!(has(&harness, "Maps") && !has(&harness, "Seed attempts") && has(&harness, "Other methods"));
        harness.state_mut().scene.settings.reflection.method = Method::Sscr;
        harness.run_ok();
        assert!(!has(&harness, "Maps") && has(&harness, "Seed attempts"));
        // The search shows parameters of any method and any tab.
        for (words, label) in [("cubemap maps", "Maps"), ("light.headlight", "Headlight"), ("spLAT siz", "Size")] {
            harness.state_mut().act(Action::Search(words.into()));
            harness.run_ok();
            assert!(has(&harness, label) && !has(&harness, "Other methods"), "{words}");
        }
        harness.get_by_label("Show the tab again").click();
        harness.run_ok();
        assert!(has(&harness, "Other methods") && harness.state().search.is_empty());
    }

    #[test]
    fn a_parameter_of_a_method_that_is_not_in_use_says_so_and_offers_the_method() {
        let mut harness = harness(Tab::Data);
        harness.state_mut().act(Action::Search("seed attempts".into()));
        harness.run_ok();
        assert!(has(&harness, "Seed attempts"));
        let told = "sscr is not in use: these change nothing.";
        assert!(has(&harness, told));
        harness.get_by_label("Use sscr").click();
        harness.run_ok();
        assert_eq!(harness.state().scene.settings.reflection.method, Method::Sscr);
        assert!(!has(&harness, told) && has(&harness, "Seed attempts"));
        // What has the words in its name comes before what has them in its help.
        harness.state_mut().act(Action::Search("reflection.method".into()));
        harness.run_ok();
        let top = |label: &str| harness.query_all_by_label(label).map(|node| node.rect().top()).next().unwrap();
        assert!(top("Method") < top("Still ms"));
    }

    #[test]
    fn the_tuning_tab_has_method_presets_parameters_sweep_truth_and_the_chart_beside_them() {
        let mut harness = harness(Tab::Data);
        harness.state_mut().scene.settings.reflection.method = Method::Sscr;
        harness.state_mut().act(Action::ToggleChart);
        harness.run_ok();
        assert_eq!(harness.state().preferences.tab, "Tuning");
        for label in ["Method", "Published", "Seed attempts", "Sweep…", "Truth", "Timings"] {
            assert!(has(&harness, label), "{label}");
        }
        let chart = harness.get_by_label("Tuning chart").rect();
        assert!(chart.right() < 310.0, "it lies beside the picture: {chart}");
        // From another tab, its key shows it; in view, the key closes it.
        harness.state_mut().act(Action::OpenTab(Tab::Look));
        harness.state_mut().act(Action::ToggleChart);
        harness.run_ok();
        assert!(harness.state().tuning.is_open && harness.state().preferences.tab == "Tuning");
        harness.state_mut().act(Action::ToggleChart);
        assert!(!harness.state().tuning.is_open);
    }
}
