//! Draws any group of parameters from its table, one line each, with the widget for its kind. Hovering shows the help,
//! the key and the range. A double-click on the name resets the parameter, and a right-click on its line offers that and a
//! sweep. Parameters that differ from their defaults are marked.

use egui::{RichText, Sense, Ui};
use param::{Field, Group, Kind, Params, Value};

use crate::shared::language::{in_english, text, translated};
use crate::viewer::look::theme;
use crate::viewer::look::typed::{is_unclear, typed_limit};
use crate::viewer::look::widgets::{
    kept_unless_typed, name_label, number_field, number_slider_in, number_slider_in_words,
};
use crate::viewer::requests::action::Action;
use crate::viewer::scene::idle;

/// How strongly rows of parameters are drawn that change nothing.
const IDLE_OPACITY: f32 = 0.6;

/// Draws the parameters of a group, except those named in `skip`.
pub fn parameters(ui: &mut Ui, params: &dyn Params, skip: &[&str], actions: &mut Vec<Action>) {
    let group = params.group();
    let mut told = None;
    for field in group.fields.iter().filter(|field| !skip.contains(&field.name)) {
        let reason = idle::reason(params, field.name);
        // Those that follow each other for one reason share a line.
        if reason != told {
            idle_notice(ui, reason.as_deref());
        }
        ui.scope(|ui| {
            // What the notice means ends where rows are as strong as before.
            ui.set_opacity(if reason.is_some() { IDLE_OPACITY } else { 1.0 });
            value_row(ui, params, field.name, actions);
        });
        told = reason;
    }
}

/// Says why what follows changes nothing.
fn idle_notice(ui: &mut Ui, reason: Option<&str>) {
    if let Some(reason) = reason {
        ui.add(egui::Label::new(RichText::new(reason).small().color(theme::WARNING)).wrap());
    }
}

/// Where a search finds a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Match {
    /// The search is its key or its title.
    Whole,
    /// All words stand in its key or its title.
    Name,
    /// All words stand in its help, or are words for it that people use.
    Help,
}

impl Match {
    pub const ALL: [Self; 3] = [Self::Whole, Self::Name, Self::Help];

    pub fn of(search: &str, group: &Group, field: &Field) -> Option<Self> {
        let (key, title) = (format!("{}.{}", group.name, field.name), title(field.name).to_lowercase());
        let name = format!("{key} {title} {}", english_title(field.name).to_lowercase());
        let helps = [field.help, translated(field.help)].map(str::to_lowercase);
        let help = format!("{} {} {} {}", helps[0], helps[1], words(&key), in_english(|| words(&key)));
        let search = search.to_lowercase();
        let has_all = |text: &str| search.split_whitespace().all(|word| text.contains(word));
        match () {
            () if [key.as_str(), &title].contains(&search.trim()) => Some(Self::Whole),
            () if has_all(&name) => Some(Self::Name),
            () if has_all(&help) => Some(Self::Help),
            () => None,
        }
    }
}

/// Words that people use for a parameter and that stand neither in its name nor in its help.
pub fn words(key: &str) -> &'static str {
    match key {
        "splat.size" => text!("point size"),
        "view.background" => text!("night dark sky backdrop"),
        "view.field_of_view" => text!("fov lens wide angle"),
        "view.frame_ms" => text!("fps frame rate lag smooth speed"),
        "view.point_budget" => text!("limit number of points"),
        "sun.elevation" | "sun.azimuth" => text!("night day time shadow"),
        "light.by" => text!("night day lamp shading"),
        "tone.exposure" => text!("brightness bright dark"),
        "edl.strength" => text!("outline edges depth shading"),
        "reflection.method" => text!("reflection algorithm technique preset"),
        "sscr.max_splat_size" => text!("splat size"),
        "sscr.initial_step" => text!("step size"),
        _ => "",
    }
}

/// Draws one parameter.
pub fn parameter(ui: &mut Ui, params: &dyn Params, name: &str, actions: &mut Vec<Action>) {
    idle_notice(ui, idle::reason(params, name).as_deref());
    value_row(ui, params, name, actions);
}

fn value_row(ui: &mut Ui, params: &dyn Params, name: &str, actions: &mut Vec<Action>) {
    let group = params.group();
    let Some(index) = group.fields.iter().position(|field| field.name == name) else { return };
    let field = &group.fields[index];
    let value = params.values().swap_remove(index);
    let edited = ui.push_id((group.name, field.name), |ui| line(ui, group.name, field, value, actions)).inner;
    actions.extend(edited.map(|edited| Action::set(group.name, field.name, edited)));
}

fn line(ui: &mut Ui, group: &str, field: &Field, value: Value, actions: &mut Vec<Action>) -> Option<Value> {
    let is_changed = field.default() != value;
    ui.horizontal(|ui| {
        let name = title(field.name);
        let text = if is_changed { RichText::new(name).color(theme::ACCENT) } else { RichText::new(name) };
        let label = name_label(ui, text);
        if label.double_clicked() {
            actions.push(Action::Reset(format!("{group}.{}", field.name)));
        }
        let label_id = label.id;
        label.on_hover_ui(|ui| {
            ui.set_max_width(300.0);
            ui.label(translated(field.help));
            ui.label(
                RichText::new(format!("{group}.{} · {}", field.name, field.range_text())).small().color(theme::WEAK),
            );
            let reset = text!(
                "default {default} · a double-click resets, a right-click offers more",
                default = field.format(&field.default())
            );
            ui.label(RichText::new(reset).small().color(theme::WEAK));
        });
        let edited = widget(ui, field, value, label_id);
        let whole = ui.interact(ui.min_rect(), ui.scope_id().with("menu"), Sense::hover());
        let by_secondary = ui.input(|input| {
            let button = egui::PointerButton::Secondary;
            input.pointer.button_down(button) || input.pointer.button_released(button)
        });
        menu(&whole, group, field, actions);
        // A slider follows any mouse button, even slightly beside it. This right-click is meant for the menu.
        edited.filter(|_| !by_secondary)
    })
    .inner
}

/// What a right-click offers.
fn menu(response: &egui::Response, group: &str, field: &Field, actions: &mut Vec<Action>) {
    let key = format!("{group}.{}", field.name);
    let is_asked = response.ctx.rect_contains_pointer(response.layer_id, response.rect)
        && response.ctx.input(|input| input.pointer.secondary_clicked());
    let menu = egui::Popup::menu(response).open_memory(is_asked.then_some(egui::SetOpenCommand::Bool(true)));
    menu.at_pointer_fixed().show(|ui| {
        if ui.button(text!("Reset to {default}", default = field.format(&field.default()))).clicked() {
            actions.push(Action::Reset(key.clone()));
            ui.close();
        }
        let help = text!("Draws, times and judges this view with a range of values: a contact sheet and a table");
        if field.can_be_swept() && ui.button(text!("Sweep…")).on_hover_text(help).clicked() {
            actions.push(Action::AskSweep(key.clone()));
            ui.close();
        }
        if ui.button(text!("Copy its name")).on_hover_text(&key).clicked() {
            actions.push(Action::Copy(key));
            ui.close();
        }
    });
}

/// What an entry of a list means, where that is known: of the methods it is.
fn help_of_choice(field: &Field, name: &str) -> Option<&'static str> {
    let is_method = field.name == "method";
    scene::METHODS.iter().find(|row| is_method && row.name == name).map(|row| row.help)
}

/// Draws the widget of a value. Returns the new value if it was edited.
fn widget(ui: &mut Ui, field: &Field, value: Value, label: egui::Id) -> Option<Value> {
    match (&field.kind, value) {
        (Kind::Bool { .. }, Value::Bool(mut on)) => {
            ui.checkbox(&mut on, "").labelled_by(label).changed().then_some(Value::Bool(on))
        }
        (Kind::F32 { min, max, .. }, Value::F32(mut number)) => {
            let slider = number_slider_in(&mut number, *min..=*max, suffix(field.unit));
            // A logarithmic slider that begins at 0 spans four decades, with 0 at its end.
            let slider = slider.logarithmic(field.is_logarithmic()).smallest_positive(f64::from(*max) * 1e-4);
            ui.add(slider).labelled_by(label).changed().then_some(Value::F32(number))
        }
        // A slider over all 32-bit numbers would be of no use, so these are dragged and typed.
        (Kind::U32 { min, max: u32::MAX, .. }, Value::U32(mut number)) => {
            let drag = number_field(&mut number).range(*min..=u32::MAX);
            ui.add(drag).labelled_by(label).changed().then_some(Value::U32(number))
        }
        (Kind::U32 { min, max, .. }, Value::U32(mut number)) => {
            let slider = number_slider_in(&mut number, *min..=*max, suffix(field.unit));
            ui.add(slider.logarithmic(field.is_logarithmic()))
                .labelled_by(label)
                .changed()
                .then_some(Value::U32(number))
        }
        (Kind::Choice { names, .. }, Value::Choice(index)) => {
            let mut chosen = index as usize;
            let shown = translated(names.get(chosen).copied().unwrap_or_default());
            let combo = egui::ComboBox::from_id_salt("choice").width(130.0).selected_text(shown);
            combo
                .show_ui(ui, |ui| {
                    for (index, name) in names.iter().enumerate() {
                        let entry = ui.selectable_value(&mut chosen, index, translated(name));
                        if let Some(help) = help_of_choice(field, name) {
                            entry.on_hover_text(translated(help));
                        }
                    }
                })
                .response
                .labelled_by(label);
            (chosen != index as usize).then_some(Value::Choice(chosen as u32))
        }
        (Kind::Color { .. }, Value::Color(color)) => {
            let [red, green, blue, opacity] = color.bytes();
            let mut rgb = [red, green, blue];
            let changed = ui.color_edit_button_srgb(&mut rgb).labelled_by(label).changed();
            let [red, green, blue] = rgb;
            changed.then(|| Value::Color(param::Color::from_bytes([red, green, blue, opacity])))
        }
        (Kind::Bytes { min, max, .. }, Value::Bytes(bytes)) => {
            let mut number = bytes.0 as f64;
            let written = |number, _| param::Bytes(number as u64).to_string();
            let format = kept_unless_typed::<f64>(written, typed_bytes, "");
            let slider = number_slider_in_words(&mut number, min.0 as f64..=max.0 as f64, format);
            let response = ui.add(slider.logarithmic(true)).labelled_by(label);
            let exact = param::Bytes(number as u64);
            response.changed().then(|| Value::Bytes(if response.dragged() { even_amount(exact) } else { exact }))
        }
        (Kind::Text { .. }, Value::Text(mut text)) => {
            let edit = egui::TextEdit::singleline(&mut text).desired_width(130.0);
            ui.add(edit).labelled_by(label).changed().then_some(Value::Text(text))
        }
        _ => None,
    }
}

/// The bytes that a person typed, with a unit or without. One point or comma that may separate thousands does where there is
/// no unit; with one, as in 2.048 MiB, nobody knows.
fn typed_bytes(text: &str) -> Option<f64> {
    let (number, unit) = text.split_at(text.find(|letter: char| letter.is_ascii_alphabetic()).unwrap_or(text.len()));
    if is_unclear(number) && !unit.is_empty() {
        return None;
    }
    format!("{}{unit}", typed_limit(number)?).parse::<param::Bytes>().ok().map(|bytes| bytes.0 as f64)
}

/// Rounds to the nearest amount that people would write, with eight steps to a doubling.
fn even_amount(bytes: param::Bytes) -> param::Bytes {
    let step = (1_u64 << bytes.0.max(8).ilog2()) / 8;
    param::Bytes(bytes.0.saturating_add(step / 2) / step * step)
}

/// The name of a parameter for people, in the language of the window.
pub fn title(name: &str) -> String {
    translated(&english_title(name)).to_owned()
}

/// Turns a name into English words: `min_pixels` becomes `Min pixels`. A single word that says little gets others.
pub fn english_title(name: &str) -> String {
    let said = match name {
        "across" => "Power across",
        "carve" => "End at edges",
        "keep" => "Keep reflections",
        "planar_normal_threshold" => "Planar normals",
        "depth_step_threshold" => "Depth step",
        "point" => "Error of point",
        "reading" => "Interleaved as in",
        _ => "",
    };
    if !said.is_empty() {
        return said.to_owned();
    }
    let mut words = name.replace('_', " ");
    if let Some(first) = words.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    words
}

/// Shortens a unit so that it fits behind a number.
fn suffix(unit: &str) -> &str {
    match unit {
        "degrees" => "°",
        "pixels" => " px",
        "x spacing" => " ×",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use scene::Settings;

    use super::*;
    use crate::viewer::look::widgets::{NAME_WIDTH, SMALLEST};

    /// The parameters, and the other actions that were asked for.
    type Shown = (Settings, Vec<Action>);

    fn harness(settings: Settings) -> Harness<'static, Shown> {
        // A frame takes a hundredth of a second, so that the four frames of a double-click are short enough.
        Harness::builder().with_size([360.0, 900.0]).with_step_dt(0.01).build_ui_state(
            |ui, (settings, others): &mut Shown| {
                let mut actions = Vec::new();
                for group in settings.groups() {
                    parameters(ui, group, &[], &mut actions);
                }
                for action in actions {
                    if let Action::Reset(key) = &action {
                        let (group, name) = key.split_once('.').unwrap();
                        let known =
                            settings.groups_mut().into_iter().find(|known| known.group().name == group).unwrap();
                        let default = known.group().fields.iter().find(|field| field.name == name).unwrap().default();
                        known.set(name, default).unwrap();
                        continue;
                    }
                    let Action::SetParameter { key, value } = action else {
                        others.push(action);
                        continue;
                    };
                    let (group, name) = key.split_once('.').unwrap();
                    let group = settings.groups_mut().into_iter().find(|known| known.group().name == group);
                    group.unwrap().set(name, value).unwrap();
                }
            },
            (settings, Vec::new()),
        )
    }

    #[test]
    fn every_parameter_of_the_table_has_a_line() {
        let mut harness = harness(Settings::default());
        harness.run();
        for group in Settings::default().groups() {
            for field in &group.group().fields {
                assert!(harness.query_all_by_label(&title(field.name)).next().is_some(), "{}", field.name);
            }
        }
    }

    #[test]
    fn amounts_of_memory_have_separators_of_thousands() {
        let mebi = f64::from(1 << 20);
        let typed = [
            ("2 048 MiB", 2048.0),
            ("1,5 MiB", 1.5),
            ("1.25MiB", 1.25),
            ("512mib", 512.0),
            ("0.125 MiB", 0.125),
            (",5MiB", 0.5),
        ];
        for (text, number) in typed {
            assert_eq!(typed_bytes(text), Some(number * mebi), "{text}");
        }
        assert_eq!(typed_bytes("1.000.000"), Some(1e6));
        assert!(
            ["", "MiB", "two", "1.2.3 MiB", "5 apples", "-1", "2.048 MiB", "2,048MiB"]
                .iter()
                .all(|text| typed_bytes(text).is_none())
        );
    }

    #[test]
    fn what_changes_nothing_says_so_once_and_why() {
        let told = |harness: &Harness<'_, Shown>, text: &str| harness.query_all_by_label(text).count();
        let mut harness = harness(Settings::default());
        harness.run();
        assert_eq!(told(&harness, "gloss.samples is 0: these change nothing."), 1);
        harness.state_mut().0.gloss.samples = 4;
        harness.run();
        assert_eq!(told(&harness, "gloss.samples is 0: these change nothing."), 0);
        assert_eq!(told(&harness, "gloss.cache_power is 0: these change nothing."), 1);
    }

    #[test]
    fn the_names_of_all_parameters_fit_into_their_lines() {
        let context = egui::Context::default();
        let mut wide = Vec::new();
        drop(context.run_ui(egui::RawInput::default(), |ui| {
            for field in Settings::default().groups().into_iter().flat_map(|params| &params.group().fields) {
                let font = egui::FontId::proportional(SMALLEST);
                let name = egui::WidgetText::from(title(field.name));
                let galley = name.into_galley(ui, Some(egui::TextWrapMode::Extend), f32::INFINITY, font);
                wide.extend((galley.size().x > NAME_WIDTH).then(|| (field.name, galley.size().x)));
            }
        }));
        assert_eq!(wide, []);
    }

    #[test]
    fn a_double_click_on_the_name_resets_the_parameter() {
        let mut settings = Settings::default();
        settings.splat.min_pixels = 9.0;
        settings.splat.max_pixels = 99.0;
        let mut harness = harness(settings);
        harness.run();
        let pos = harness.get_by_role_and_label(egui::accesskit::Role::Label, "Min pixels").rect().center();
        harness.event(egui::Event::PointerMoved(pos));
        for pressed in [true, false, true, false] {
            let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
            harness.event(egui::Event::PointerButton { pos, button, pressed, modifiers });
            harness.step();
        }
        harness.run();
        assert_eq!(harness.state().0.splat.min_pixels, scene::Splat::default().min_pixels);
        assert_eq!(harness.state().0.splat.max_pixels, 99.0);
    }

    #[test]
    fn a_value_with_more_digits_than_its_slider_shows_is_kept() {
        let mut settings = Settings::default();
        (settings.sscr.initial_step, settings.cubemap_trace.step) = (0.123_456_79, 0.000_123_456);
        let mut harness = harness(settings.clone());
        harness.run();
        assert_eq!(harness.state().0, settings);
    }

    #[test]
    fn a_right_click_on_a_slider_offers_a_sweep_and_changes_nothing() {
        let mut harness = harness(Settings::default());
        harness.run();
        let pos = harness.get_by_role_and_label(egui::accesskit::Role::Slider, "Min pixels").rect().center();
        harness.event(egui::Event::PointerMoved(pos));
        harness.step();
        for pressed in [true, false] {
            let (button, modifiers) = (egui::PointerButton::Secondary, egui::Modifiers::NONE);
            harness.event(egui::Event::PointerButton { pos, button, pressed, modifiers });
            harness.step();
        }
        harness.run();
        assert_eq!(*harness.state(), (Settings::default(), Vec::new()));
        harness.get_by_label("Sweep…").click();
        harness.run();
        assert_eq!(harness.state().1, [Action::AskSweep("splat.min_pixels".into())]);
    }

    #[test]
    fn choosing_from_a_list_and_typing_a_number_edit_the_value() {
        let mut harness = harness(Settings::default());
        harness.run();
        harness.get_by_role_and_label(egui::accesskit::Role::ComboBox, "Quality").click();
        harness.run();
        harness.get_by_label("nearest").click();
        harness.run();
        assert_eq!(harness.state().0.splat.quality, scene::Quality::Nearest);
    }

    #[test]
    fn each_method_says_in_the_list_what_it_does() {
        let field = |name: &str| scene::Reflection::table().fields.iter().find(|field| field.name == name).unwrap();
        let Kind::Choice { names, .. } = field("method").kind else { panic!("methods are chosen") };
        assert!(names.iter().all(|name| help_of_choice(field("method"), name).is_some_and(|help| !help.is_empty())));
        assert_eq!(help_of_choice(field("show"), "none"), None, "another list");
    }
}
