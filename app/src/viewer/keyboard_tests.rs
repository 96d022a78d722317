//! Tests of the keyboard: where the keys of a person go who has no mouse, and what becomes of what is typed.

use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};

use crate::viewer::interface;
use crate::viewer::look::tab::Tab;
use crate::viewer::picture::messages::{Command, PickPurpose};
use crate::viewer::requests::action::Action;
use crate::viewer::requests::outside::Effect;
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::session::Session;

fn harness() -> Harness<'static, Session> {
    Harness::builder().with_size([1100.0, 800.0]).with_max_steps(16).build_ui_state(
        |ui, session: &mut Session| {
            let actions = interface::show(ui, session, None);
            session.act_all(actions);
        },
        Session::new(Preferences::default()),
    )
}

#[test]
fn the_palette_opens_from_a_field_of_text_whose_text_stays() {
    for key in [egui::Key::P, egui::Key::K] {
        let mut harness = harness();
        harness.state_mut().act(Action::Search("budget".into()));
        harness.run_ok();
        harness.get_by_label("Find a parameter").focus();
        harness.run_ok();
        harness.key_press(egui::Key::Home);
        harness.run_ok();
        harness.key_press_modifiers(egui::Modifiers::COMMAND, key);
        harness.run_ok();
        harness.event(egui::Event::Text("truth".into()));
        harness.run_ok();
        let session = harness.state();
        assert_eq!(session.palette.as_ref().expect("the palette is open").text, "truth");
        assert_eq!(session.search, "budget");
    }
}

#[test]
fn a_tab_comes_into_view_while_a_search_has_a_text() {
    let mut harness = harness();
    harness.state_mut().act(Action::Search("budget".into()));
    harness.state_mut().act(Action::OpenTab(Tab::Light));
    assert_eq!((harness.state().preferences.tab.as_str(), harness.state().search.as_str()), (Tab::Light.name(), ""));
}

#[test]
fn the_keyboard_is_at_the_first_section_of_a_tab_that_the_palette_opens() {
    let mut harness = harness();
    harness.run_ok();
    harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::P);
    harness.run_ok();
    harness.event(egui::Event::Text("tab: light".into()));
    harness.run_ok();
    harness.key_press(egui::Key::Enter);
    harness.run_ok();
    assert_eq!(harness.state().preferences.tab, Tab::Light.name());
    let focused = harness.get_by(|node| node.is_focused());
    assert_eq!(focused.accesskit_node().label().as_deref(), Some("Light"));
}

#[test]
fn a_number_begun_on_a_slider_goes_to_its_field_and_is_no_shortcut() {
    let mut harness = harness();
    harness.state_mut().act(Action::Search("splat.size".into()));
    harness.run_ok();
    let by = |harness: &Harness<'_, Session>| harness.state().scene.settings.color.by;
    let before = by(&harness);
    // A key and its text come together, and a French keyboard has its digits with Shift, which flies to a view else.
    let press = |harness: &mut Harness<'_, Session>, key, modifiers, text: &str| {
        let key = egui::Event::Key { key, physical_key: Some(key), pressed: true, repeat: false, modifiers };
        harness.input_mut().events.extend([key, egui::Event::Text(text.into())]);
        harness.run_ok();
    };
    for (modifiers, size) in [(egui::Modifiers::NONE, 2.5), (egui::Modifiers::SHIFT, 3.5)] {
        harness.get_by_role_and_label(egui::accesskit::Role::Slider, "Size").focus();
        harness.run_ok();
        let (key, text) = if size < 3.0 { (egui::Key::Num2, "2") } else { (egui::Key::Num3, "3") };
        press(&mut harness, key, modifiers, text);
        harness.event(egui::Event::Text(",5".into()));
        harness.run_ok();
        harness.key_press(egui::Key::Enter);
        harness.run_ok();
        assert_eq!(by(&harness), before);
        assert_eq!(harness.state().scene.settings.splat.size, size);
        let told = &harness.state().outside.messages.all;
        assert!(told.is_empty(), "{:?}", told.iter().map(|message| &message.text).collect::<Vec<_>>());
    }
    // Elsewhere, Shift and a digit are another letter, which begins no number.
    harness.get_by_role_and_label(egui::accesskit::Role::Slider, "Size").focus();
    harness.run_ok();
    press(&mut harness, egui::Key::Num3, egui::Modifiers::SHIFT, "§");
    assert_eq!(harness.state().outside.messages.all.len(), 1, "no view is kept as 3");
}

#[test]
fn a_text_that_is_no_number_is_told() {
    let mut harness = harness();
    harness.state_mut().act(Action::Search("splat.size".into()));
    harness.run_ok();
    harness.get_by_role(egui::accesskit::Role::SpinButton).focus();
    harness.run_ok();
    harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
    harness.event(egui::Event::Text("large".into()));
    harness.run_ok();
    harness.key_press(egui::Key::Enter);
    harness.run_ok();
    let told: Vec<_> = harness.state().outside.messages.all.iter().map(|message| message.text.clone()).collect();
    assert_eq!(told, ["“large” is no number; 1.0 × stays"]);
}

#[test]
fn keys_alone_set_the_points_of_a_measurement() {
    let mut harness = harness();
    *harness.state_mut() = Session::with_two_points();
    harness.run_ok();
    harness.key_press_modifiers(egui::Modifiers::ALT, egui::Key::Num2);
    harness.run_ok();
    harness.key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::M);
    harness.run_ok();
    let session = harness.state();
    let middle = session.scene.view_size.map(|side| side / 2);
    let is_asked = |effect: &Effect| {
        let Effect::Render(Command::Pick { pixel, purpose: PickPurpose::Corner }) = effect else { return false };
        *pixel == middle
    };
    assert!(session.outside.effects.iter().any(is_asked));
}
