//! The layout of the window: the panel on the left, the status bar at the bottom, and the picture with its overlays
//! between them.

use egui::{Align2, CentralPanel, Color32, Frame, Panel, Rect, Sense, Ui};

use crate::shared::language::text;
use crate::viewer::input::gizmo;
use crate::viewer::look::theme;
use crate::viewer::look::widgets::{focus_ring, refused};
use crate::viewer::panels::{overlay, welcome};
use crate::viewer::picture::canvas::Picture;
use crate::viewer::requests::action::Action;
use crate::viewer::requests::bindings;
use crate::viewer::requests::path_prompt::Outcome;
use crate::viewer::session::Session;
use crate::viewer::{input, panels};

/// Draws the whole window. `picture` is the render thread's last frame. Returns what the user asked for, in order.
pub fn show(ui: &mut Ui, session: &Session, picture: Option<&Picture>) -> Vec<Action> {
    let mut actions = open_dropped(ui);
    let asks_for_palette = input::before_widgets(ui, session);
    let mut lights_are_shown = false;
    if !session.interface_is_hidden {
        Panel::bottom("status")
            .exact_size(28.0)
            .resizable(false)
            .frame(Frame::new().fill(theme::PANEL).inner_margin(egui::Margin::symmetric(10, 3)))
            .show(ui, |ui| panels::status::show(ui, session, &mut actions));
        if session.filming.timeline.is_open {
            panels::timeline::dock(ui, session, &mut actions);
        }
        if session.preferences.panel_is_open {
            Panel::left("panel")
                .default_size(310.0)
                .size_range(270.0..=480.0)
                .frame(Frame::new().fill(theme::PANEL).inner_margin(egui::Margin::symmetric(10, 8)))
                .show(ui, |ui| {
                    // What is too wide for the panel does not widen it: the picture must not move under the mouse.
                    let area = ui.available_rect_before_wrap();
                    let mut inside = ui.new_child(egui::UiBuilder::new().max_rect(area));
                    lights_are_shown = panels::side::show(&mut inside, session, &mut actions);
                    ui.advance_cursor_after_rect(area);
                });
        }
    }
    if lights_are_shown != session.tools.light_panel_is_open {
        actions.push(Action::ShowLights(lights_are_shown));
    }
    let area = CentralPanel::default().frame(Frame::new()).show(ui, |ui| {
        let area = ui.available_rect_before_wrap();
        let rect = panels::comparing::beside(ui, area, session, &mut actions);
        picture_area(ui, session, picture, rect, &mut actions);
        area
    });
    let area = area.inner;
    // The toasts and the card leave the timeline free, and the palette while it is open.
    let palette = session.palette.as_ref().and_then(|_| panels::palette::area(ui.ctx()));
    let free = palette.map_or(area, |palette| area.with_min_y(palette.bottom().clamp(area.top(), area.bottom())));
    session.outside.messages.show(ui.ctx(), free, &mut actions);
    panels::pick::show(ui.ctx(), area, session, &mut actions);
    panels::sweep::show(ui.ctx(), session, &mut actions);
    panels::recording::show(ui.ctx(), session, &mut actions);
    panels::profiles::window(ui.ctx(), session, &mut actions);
    if session.shortcuts_are_open {
        let mut stays = true;
        bindings::sheet_window(ui.ctx(), &mut stays);
        if !stays {
            actions.push(Action::ToggleShortcuts);
        }
    }
    path_prompt(ui.ctx(), session, &mut actions);
    panels::columns::show(ui.ctx(), session, &mut actions);
    panels::palette::show(ui.ctx(), session, &mut actions);
    panels::picture::show(ui.ctx(), session, &mut actions);
    panels::leaving::show(ui.ctx(), session, &mut actions);
    if let Some(problem) = &session.fatal {
        fatal_notice(ui.ctx(), problem, &mut actions);
    }
    if asks_for_palette {
        input::open_palette(ui, &mut actions);
    }
    actions.extend(refused().map(Action::Warn));
    focus_ring(ui.ctx());
    actions
}

fn path_prompt(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    let Some(before) = &session.path_prompt else { return };
    let mut prompt = before.clone();
    let outcome = prompt.show(context);
    if prompt != *before {
        actions.push(Action::ChangePrompt(Box::new(prompt)));
    }
    actions.extend(outcome.map(|outcome| match outcome {
        Outcome::Open(path) => Action::OpenPrompted(path),
        Outcome::Close => Action::ClosePrompt,
    }));
}

/// Says that nothing can be drawn any more. The program ends when the user confirms it.
fn fatal_notice(context: &egui::Context, problem: &str, actions: &mut Vec<Action>) {
    egui::Modal::new(egui::Id::unique("fatal")).show(context, |ui| {
        ui.set_max_width(420.0);
        ui.heading(text!("The points cannot be drawn any more"));
        ui.label(problem);
        ui.add_space(8.0);
        if ui.button(text!("Quit")).clicked() {
            actions.push(Action::Quit);
        }
    });
}

/// Opens dropped files one by one, so that a wrong file does not prevent the others from opening.
fn open_dropped(ui: &Ui) -> Vec<Action> {
    let dropped = ui.input(|input| input.raw.dropped_files.clone());
    dropped.iter().map(|file| Action::Open(file.path().to_path_buf())).collect()
}

fn picture_area(ui: &mut Ui, session: &Session, picture: Option<&Picture>, rect: Rect, actions: &mut Vec<Action>) {
    let scale = ui.ctx().pixels_per_point();
    let side = |length: f32| (length * scale).round().max(0.0) as u32;
    let size = [side(rect.width()), side(rect.height())];
    actions.extend((size != session.scene.view_size).then_some(Action::Resize(size)));
    // Tab leads through the widgets, and the picture is none: its keys are those of the whole window.
    let response = ui.interact(rect, ui.scope_id().with("picture"), Sense::CLICK | Sense::DRAG);
    let shown = picture.zip(session.frames.shown.as_ref());
    let shown = shown.map(|(picture, shown)| (picture, shaped(rect, size, shown.request.size)));
    // On software Vulkan its pixels take longer than those of the picture over them.
    if shown.is_none_or(|(_, place)| place != rect) {
        let [red, green, blue, _] = session.scene.settings.view.background.bytes();
        ui.painter().rect_filled(rect, 0.0, Color32::from_rgb(red, green, blue));
    }
    if let Some((picture, place)) = shown {
        ui.painter().add(picture.within(place));
    } else {
        // Until there is a picture, the place of the picture says what it waits for.
        let is_empty = session.loaded.clouds.is_empty() && !session.loaded.is_loading();
        if let Some(wait) = panels::status::waiting(session).filter(|_| !is_empty) {
            let is_compiling = session.frames.compiled().is_some();
            let more = if is_compiling { text!("; the first start takes longest") } else { "" };
            welcome::caption(ui, rect, rect.center(), &format!("{wait}{more}"));
        }
    }
    panels::truth::paint(ui, rect, session, actions);
    panels::comparing::paint(ui, rect, session, actions);
    panels::wipe::paint(ui, rect, session);
    overlay::paint(ui.painter(), rect, session);
    if session.tools.waits_for_points() && input::is_by_keyboard(ui) {
        overlay::middle(ui.painter(), rect);
    }
    let is_taken = gizmo::interact(&response, session, actions);
    input::handle(ui, &response, is_taken, session, actions);
    if session.tools.measurements.placing.is_some() && response.contains_pointer() {
        ui.ctx().set_cursor_icon(egui::CursorIcon::Crosshair);
    }
    if session.loaded.clouds.is_empty() && !session.loaded.is_loading() {
        welcome::empty_state(ui, session, rect, actions);
    }
    welcome::hint(ui, rect, session);
    welcome::lost(ui, rect, session);
    welcome::first_reflection(ui, rect, session);
    if ui.input(|input| !input.raw.hovered_files.is_empty()) {
        ui.painter().rect_filled(rect, 0.0, Color32::from_black_alpha(150));
        let font = egui::FontId::proportional(22.0);
        ui.painter().text(rect.center(), Align2::CENTER_CENTER, text!("Drop to open"), font, theme::ACCENT);
    }
}

/// Where a picture of some size is drawn in an area of another: until one of the area's size comes, it keeps its shape.
fn shaped(area: Rect, size: [u32; 2], picture: [u32; 2]) -> Rect {
    if size == picture || size.contains(&0) || picture.contains(&0) {
        return area;
    }
    let [across, down] = [0, 1].map(|axis| size[axis] as f32 / picture[axis] as f32);
    let share = egui::vec2(across.min(down) / across, across.min(down) / down);
    Rect::from_center_size(area.center(), area.size() * share)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use cloud::Progress;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use param::Params;
    use scene::{Measurement, MeasurementKind, Note, Object, Profile};
    use world::{CloudTask, Mailbox, TaskKind};

    use super::*;
    use crate::overlays::lens::Lens;
    use crate::viewer::bench::Bench;
    use crate::viewer::look::tab::Tab;
    use crate::viewer::panels::side::OWN_PANELS;
    use crate::viewer::picture::messages::Report;
    use crate::viewer::requests::action::{Filing, Film, Measuring};
    use crate::viewer::requests::outside::{Asked, Effect};
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::requests::work::{Found, Work};

    fn harness() -> Harness<'static, Session> {
        Harness::builder().with_size([1100.0, 800.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                let actions = show(ui, session, None);
                session.act_all(actions);
            },
            Session::new(Preferences::default()),
        )
    }

    #[test]
    fn an_address_that_could_not_be_opened_can_be_tried_again() {
        let mut harness = harness();
        let (text, address) = ("a.laz: no such file on the server".to_owned(), "http://127.0.0.1:1/a.laz".to_owned());
        harness.state_mut().outside.say_of_address(text, address);
        harness.state_mut().act(Action::ListMessages(true));
        harness.run_ok();
        harness.get_by_label("Try again").click();
        harness.run_ok();
        let effects = &harness.state().outside.effects;
        assert!(effects.iter().any(|effect| matches!(effect, Effect::Load { .. })));
    }

    #[test]
    fn a_newcomer_is_told_how_to_open_a_file_and_can_open_a_scene() {
        let mut harness = harness();
        harness.run_ok();
        assert!(harness.query_by_label("Drop a file of points here, or press Ctrl+O").is_some());
        harness.get_by_label("sphere").click();
        harness.run_ok();
        let loads = harness.state().outside.effects.iter().any(|effect| matches!(effect, Effect::Load { .. }));
        assert!(loads, "the scene's button loads nothing");
    }

    #[test]
    fn keys_act_unless_a_text_is_being_typed() {
        let mut harness = harness();
        harness.run_ok();
        harness.key_press(egui::Key::Num2);
        harness.run_ok();
        assert_eq!(harness.state().scene.settings.color.by, scene::ColorBy::Height);
        harness.state_mut().act(Action::OpenPrompt);
        harness.run_ok();
        harness.key_press(egui::Key::Num3);
        harness.event(egui::Event::Text("3".into()));
        harness.run_ok();
        assert_eq!(harness.state().scene.settings.color.by, scene::ColorBy::Height);
    }

    #[test]
    fn toasts_and_the_card_of_a_point_lie_neither_over_the_timeline_nor_over_the_palette() {
        let mut harness = harness();
        let session = harness.state_mut();
        session.act(Action::Film(Film::Toggle));
        (0..9).for_each(|number| {
            session.outside.messages.warning(format!("warning {number} {}", "of many words ".repeat(20)))
        });
        session.tools.pick = Some(panels::pick::tests::pick(glam::DVec3::ZERO));
        harness.run_ok();
        let rect = |harness: &Harness<'_, Session>, label: &str| harness.get_by_label_contains(label).rect();
        let timeline = rect(&harness, "Close the timeline");
        assert!(rect(&harness, "warning 8").left() > 310.0);
        for label in ["warning 8", "warning 7", "Forgets"] {
            let bottom = harness.query_by_label_contains(label).map(|node| node.rect().bottom());
            assert!(bottom.is_none_or(|bottom| bottom < timeline.top()), "{label} {bottom:?}");
        }
        assert!(rect(&harness, "Copy").bottom() < timeline.top());
        harness.state_mut().act(Action::TogglePalette);
        harness.run_ok();
        let palette = rect(&harness, "Up and Down choose");
        assert!(rect(&harness, "warning 8").top() > palette.bottom());
    }

    #[test]
    fn dragging_over_the_picture_orbits_and_the_right_button_pans() {
        let mut harness = harness();
        harness.run_ok();
        let before = harness.state().scene.camera;
        drag(&mut harness, egui::PointerButton::Primary);
        let orbited = harness.state().scene.camera;
        assert!(orbited.eye.distance(before.eye) > 0.1 && orbited.pivot == before.pivot);
        drag(&mut harness, egui::PointerButton::Secondary);
        let panned = harness.state().scene.camera;
        assert!(panned.pivot.distance(orbited.pivot) > 0.1 && panned.forward().dot(orbited.forward()) > 0.999_999);
    }

    fn drag(harness: &mut Harness<'static, Session>, button: egui::PointerButton) {
        let modifiers = egui::Modifiers::NONE;
        let (from, to) = (egui::pos2(700.0, 120.0), egui::pos2(760.0, 150.0));
        harness.event(egui::Event::PointerMoved(from));
        harness.event(egui::Event::PointerButton { pos: from, button, pressed: true, modifiers });
        harness.run_ok();
        harness.event(egui::Event::PointerMoved(to));
        harness.run_ok();
        harness.event(egui::Event::PointerButton { pos: to, button, pressed: false, modifiers });
        harness.run_ok();
    }

    #[test]
    fn the_tabs_show_every_group_of_parameters() {
        let mut harness = harness();
        let mut labels: Vec<String> = Vec::new();
        for tab in Tab::ALL {
            harness.state_mut().act(Action::OpenTab(tab));
            harness.run_ok();
            let sections = harness.state().scene.settings.groups().map(|params| params.group().section);
            let titles = ["Clouds", "Mirrors", "Clips and filters", "Measurements and notes", "Timings"];
            let is_shown = |title: &&str| harness.query_all_by_label(title).next().is_some();
            labels.extend(titles.into_iter().chain(sections).filter(is_shown).map(str::to_owned));
        }
        for title in ["Clouds", "Mirrors", "Clips and filters", "Measurements and notes", "Timings"] {
            assert!(labels.iter().any(|label| label == title), "{title}");
        }
        for group in harness.state().scene.settings.groups().map(Params::group) {
            assert!(labels.iter().any(|label| label == group.section), "{}", group.section);
        }
        for title in OWN_PANELS {
            let is_of = |group: &param::Group| group.section == title;
            assert!(harness.state().scene.settings.groups().map(Params::group).into_iter().any(is_of), "{title}");
        }
    }

    #[test]
    fn tab_reaches_the_widgets_and_arrows_orbit_until_one_has_the_focus() {
        let mut harness = harness();
        harness.run_ok();
        let press = |harness: &mut Harness<'static, Session>, key| {
            let before = harness.state().scene.camera;
            harness.key_down(key);
            harness.run_steps(3);
            harness.key_up(key);
            harness.run_ok();
            harness.state().scene.camera != before
        };
        assert!(press(&mut harness, egui::Key::ArrowLeft), "an arrow orbits");
        harness.key_press(egui::Key::Tab);
        harness.run_ok();
        assert!(harness.ctx.memory(|memory| memory.focused().is_some()));
        assert!(!press(&mut harness, egui::Key::ArrowRight), "an arrow belongs to the widget that has the focus");
        harness.key_press(egui::Key::Escape);
        harness.run_ok();
        assert!(press(&mut harness, egui::Key::ArrowRight));
    }

    #[test]
    fn keys_of_an_open_menu_neither_turn_the_camera_nor_end_tools() {
        let mut harness = harness();
        *harness.state_mut() = Session::with_two_points();
        harness.state_mut().act(Action::Measuring(Measuring::Begin(MeasurementKind::Distance)));
        harness.run_ok();
        harness.get_by_label("Recent").click();
        harness.run_ok();
        assert!(egui::Popup::is_any_open(&harness.ctx));
        let camera = harness.state().scene.camera;
        harness.key_down(egui::Key::ArrowDown);
        harness.run_steps(3);
        harness.key_up(egui::Key::ArrowDown);
        harness.run_ok();
        assert_eq!(harness.state().scene.camera, camera);
        harness.key_press(egui::Key::Escape);
        harness.run_ok();
        assert!(!egui::Popup::is_any_open(&harness.ctx), "it closes the menu");
        assert!(harness.state().tools.measurements.placing.is_some(), "and nothing else");
        harness.key_press(egui::Key::Escape);
        harness.run_ok();
        assert!(harness.state().tools.measurements.placing.is_none());
    }

    #[test]
    fn a_picture_of_another_size_keeps_its_shape_until_one_of_the_area_comes() {
        let area = Rect::from_min_size(egui::pos2(310.0, 0.0), egui::vec2(400.0, 300.0));
        assert_eq!(shaped(area, [800, 600], [800, 600]), area);
        assert_eq!(shaped(area, [800, 600], [400, 300]), area, "a coarse one of the same shape fills it");
        let low = shaped(area, [800, 600], [800, 300]);
        assert_eq!((low.center(), low.size()), (area.center(), egui::vec2(400.0, 150.0)));
        let narrow = shaped(area, [800, 600], [100, 300]);
        assert_eq!((narrow.center(), narrow.size()), (area.center(), egui::vec2(100.0, 300.0)));
    }

    #[test]
    fn coordinates_of_the_cursor_are_shown_only_where_they_lie_over_nothing() {
        for (width, is_shown) in [(1400.0, true), (420.0, false)] {
            let mut session = Session::with_two_points();
            session.preferences.panel_is_open = false;
            let mut harness = Harness::builder().with_size([width, 600.0]).with_max_steps(16).build_ui_state(
                |ui, session: &mut Session| {
                    // Where the cursor points is not asked for here.
                    session.scene.navigation.on_hover([0, 0], Some(glam::DVec3::new(2_635_000.5, 1_248_000.25, 410.0)));
                    drop(show(ui, session, None));
                },
                session,
            );
            harness.run_ok();
            let text = "2635000.500  1248000.250  410.000";
            assert_eq!(harness.query_by_label(text).is_some(), is_shown, "{width}");
        }
    }

    #[test]
    fn the_scene_is_saved_while_a_text_has_the_keyboard() {
        let mut harness = harness();
        *harness.state_mut() = Session::with_two_points();
        harness.run_ok();
        harness.get_by_label("Find a parameter").focus();
        harness.run_ok();
        assert!(harness.ctx.text_edit_focused());
        harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::S);
        harness.run_ok();
        let asks = |effect: &Effect| matches!(effect, Effect::AskPlace(Asked::Scene, _));
        assert!(harness.state().outside.effects.iter().any(asks));
    }

    #[test]
    fn a_number_that_is_being_typed_is_saved_with_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("two.toml");
        let mut harness = harness();
        *harness.state_mut() = Session::with_two_points();
        harness.state_mut().act(Action::AddMirror(scene::Shape::Sphere));
        harness.state_mut().act(Action::File(Filing::SaveTo(place.clone())));
        harness.state_mut().on_found(Found::SceneSaved { path: place, result: Ok(0) });
        harness.run_ok();
        harness.state_mut().act(Action::OpenTab(Tab::Mirrors));
        harness.run_ok();
        let field = harness.get_all_by_role(egui::accesskit::Role::SpinButton).next().expect("a number of the mirror");
        field.focus();
        harness.run_ok();
        harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
        harness.event(egui::Event::Text("12.625".into()));
        harness.run_ok();
        harness.state_mut().outside.effects.clear();
        harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::S);
        harness.run_ok();
        let saved = harness.state().outside.effects.iter().find_map(|effect| match effect {
            Effect::Work(Work::SaveScene { text, .. }) => Some(text.clone()),
            _ => None,
        });
        let saved = saved.expect("a saved scene");
        assert!(saved.contains("12.625"), "{saved}");
        assert!(harness.ctx.text_edit_focused(), "a person goes on typing");
    }

    #[test]
    fn the_panel_keeps_its_width_in_all_tabs_and_while_something_is_placed() {
        let mut session = Session::with_two_points();
        session.act(Action::Measuring(Measuring::Begin(MeasurementKind::Area)));
        let long = "a name that is longer than the panel is wide, as names of measurements may be".to_owned();
        let (color, points) = ([1.0; 3], vec![glam::DVec3::ZERO, glam::DVec3::X]);
        let kind = MeasurementKind::Distance;
        let measurement =
            Measurement { name: long.clone(), kind, on: true, color, points: points.clone(), reach: None, level: None };
        let note = Note { text: long.clone(), on: true, color, position: points[0], camera: None };
        let profile = Profile { name: long, on: true, color, line: points, width: 0.1 };
        let objects = [Object::Measurement(measurement), Object::Note(note), Object::Profile(profile)];
        session.scene.add_objects(objects);
        let mut harness = Harness::builder().with_size([1100.0, 800.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                theme::apply(ui.ctx());
                let actions = show(ui, session, None);
                session.act_all(actions);
            },
            session,
        );
        harness.run_ok();
        let width = harness.state().scene.view_size[0];
        let ids: Vec<_> = harness.state().scene.objects.all().map(|(id, ..)| id).collect();
        for tab in Tab::ALL {
            for selected in ids.iter().map(|id| Some(*id)).chain([None]) {
                harness.state_mut().scene.selected = selected;
                harness.run_ok();
                harness.state_mut().act(Action::OpenTab(tab));
                harness.run_ok();
                assert_eq!(harness.state().scene.view_size[0], width, "{} {selected:?}", tab.name());
            }
        }
        assert!(harness.state().tools.measurements.placing.is_some(), "something is being placed");
    }

    #[test]
    fn keys_do_nothing_while_a_note_waits_for_its_place() {
        let mut harness = harness();
        *harness.state_mut() = Session::with_two_points();
        harness.run_ok();
        let by = |harness: &Harness<'_, Session>| harness.state().scene.settings.color.by;
        harness.state_mut().act(Action::Measuring(Measuring::BeginNote));
        harness.run_ok();
        harness.key_press(egui::Key::Num2);
        harness.run_ok();
        assert_eq!(by(&harness), scene::ColorBy::Height, "before the click they act");
        harness.state_mut().act(Action::PointAt(Some([10, 10])));
        harness.state_mut().act(Action::Pick);
        harness.key_press(egui::Key::Num9);
        harness.run_ok();
        assert_eq!(by(&harness), scene::ColorBy::Height);
    }

    #[test]
    fn esc_that_ends_typing_ends_nothing_else() {
        let mut harness = harness();
        *harness.state_mut() = Session::with_two_points();
        harness.run_ok();
        harness.state_mut().act(Action::Measuring(Measuring::Begin(MeasurementKind::Area)));
        harness.run_ok();
        harness.get_by_label("Find a parameter").focus();
        harness.run_ok();
        harness.key_press(egui::Key::Escape);
        harness.run_ok();
        let is_placing = |harness: &Harness<'_, Session>| harness.state().tools.measurements.placing.is_some();
        assert!(!harness.ctx.text_edit_focused());
        assert!(is_placing(&harness));
        harness.key_press(egui::Key::Escape);
        harness.run_ok();
        assert!(!is_placing(&harness));
    }

    #[test]
    fn a_handle_that_comes_under_a_drag_of_the_camera_is_not_grabbed() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let placed = bench.session.scene.objects.mirrors[0].clone();
        bench.session.act(Action::Select(None));
        let mut harness = Harness::builder()
            .with_size([1100.0, 800.0])
            .with_max_steps(16)
            .build_ui_state(|ui, bench: &mut Bench| bench.show(ui), bench);
        harness.run_ok();
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        let at = egui::pos2(310.0 + 395.0, 386.0);
        harness.event(egui::Event::PointerMoved(at));
        harness.event(egui::Event::PointerButton { pos: at, button, pressed: true, modifiers });
        harness.run_ok();
        // Now the handles of the mirror are where the button was pressed.
        let session = &mut harness.state_mut().session;
        let (origin, direction) = session
            .frames
            .shown
            .as_ref()
            .map(|shown| {
                let request = &shown.request;
                let lens = Lens::new(&request.camera, &request.settings.view, request.size);
                lens.ray(glam::DVec2::new(32.0, 24.0))
            })
            .unwrap();
        let mut mirror = placed.mirror.clone();
        mirror.position = origin + direction * 2.0;
        session.act(Action::ChangeObject(placed.id, Box::new(Object::Mirror(mirror.clone()))));
        session.act(Action::Select(Some(placed.id)));
        for step in 1..6 {
            harness.event(egui::Event::PointerMoved(at + egui::vec2(8.0, 3.0) * step as f32));
            harness.run_ok();
        }
        let now = &harness.state().session.scene.objects.mirrors[0].mirror;
        assert_eq!(now.position, mirror.position);
        // A press there grabs it.
        harness.event(egui::Event::PointerButton { pos: at, button, pressed: false, modifiers });
        harness.run_ok();
        harness.event(egui::Event::PointerMoved(at));
        harness.event(egui::Event::PointerButton { pos: at, button, pressed: true, modifiers });
        harness.run_ok();
        harness.event(egui::Event::PointerMoved(at + egui::vec2(30.0, 20.0)));
        harness.run_ok();
        let now = &harness.state().session.scene.objects.mirrors[0].mirror;
        assert_ne!(now.position, mirror.position);
    }

    #[test]
    fn the_panel_says_when_the_picture_is_not_yet_that_of_its_values() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let mut harness = Harness::builder()
            .with_size([1100.0, 800.0])
            .with_max_steps(16)
            .build_ui_state(|ui, bench: &mut Bench| bench.show(ui), bench);
        let says = |harness: &mut Harness<'_, Bench>| {
            harness.run_ok();
            harness.query_by_label("Picture of earlier values; drawing…").is_some()
        };
        let start = harness.state().session.outside.now;
        harness.state_mut().session.act(Action::set("splat", "size", param::Value::F32(2.0)));
        harness.state_mut().session.step(start, false);
        assert!(!says(&mut harness), "the picture may come at once");
        harness.state_mut().session.outside.now = start + Duration::from_millis(310);
        assert!(says(&mut harness));
        harness.state_mut().settle();
        assert!(!says(&mut harness));
    }

    #[test]
    fn shaders_that_are_compiled_are_counted() {
        let mut harness = harness();
        harness.run_ok();
        assert!(harness.query_by_label("preparing the renderer").is_some());
        let shaders = harness.state().frames.shaders.clone();
        shaders.set_total(40);
        shaders.add(10);
        harness.run_steps(2);
        assert!(harness.query_by_label("compiling shaders: 25 %").is_some());
        shaders.set_total(80);
        harness.run_steps(2);
        assert!(harness.query_by_label("compiling shaders: 25 %").is_some(), "it does not go back when more are found");
        shaders.set_total(40);
        shaders.add(30);
        harness.state_mut().on_report(Report::Ready { adapter: "any".into() });
        harness.run_ok();
        assert!(
            harness.query_by_label_contains("shaders").is_none()
                && harness.query_by_label_contains("renderer").is_none()
        );
    }

    #[test]
    fn the_first_picture_is_announced_until_it_is_there() {
        let mut harness = harness();
        let says = |harness: &mut Harness<'_, Session>| {
            harness.run_steps(2);
            harness.query_by_label("drawing the first picture").is_some()
        };
        harness.state_mut().frames.under_way = 1;
        assert!(!says(&mut harness), "the renderer comes first");
        harness.state_mut().on_report(Report::Ready { adapter: "any".into() });
        assert!(says(&mut harness));
        harness.state_mut().frames.under_way = 0;
        assert!(!says(&mut harness), "nothing is drawn");
        harness.state_mut().frames.under_way = 1;
        harness.state_mut().fatal = Some("the device is gone".into());
        assert!(!says(&mut harness), "there will be none");
    }

    #[test]
    fn cancel_stops_reading_and_estimating() {
        let mut harness = harness();
        let progress = Arc::<Progress>::default();
        progress.set_total(100);
        let mailbox = Arc::<Mailbox>::default();
        let stage = mailbox.plan(0, CloudTask::new(TaskKind::Surfels, 100));
        let session = harness.state_mut();
        session.loaded.add_job(&[], progress.clone(), mailbox, session.outside.now);
        harness.run_ok();
        harness.get_by_label("Cancel").click();
        harness.run_ok();
        assert!(progress.is_cancelled() && !stage.is_pending());
    }
}
