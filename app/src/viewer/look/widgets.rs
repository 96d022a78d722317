//! Small widgets that several panels share. They know egui and plain values, but not the session.

use std::cell::RefCell;
use std::ops::RangeInclusive;
use std::rc::Rc;

use egui::emath::Numeric;
use egui::{Sense, Ui, ValueFormat};
use glam::DVec3;

use crate::shared::language::text;
use crate::viewer::look::theme;
use crate::viewer::look::theme::grouped;
use crate::viewer::look::typed::{typed_number, typed_whole_number};

/// The width of a line's name, in points of the window. The longest name fits.
pub const NAME_WIDTH: f32 = 96.0;

/// The smallest size of a letter that is still read, in points.
pub const SMALLEST: f32 = 9.5;

/// Draws the name of a line, in smaller letters where it is long. All names have the same width and can be clicked.
pub fn name_label(ui: &mut Ui, text: impl Into<egui::WidgetText>) -> egui::Response {
    let height = ui.spacing().interact_size.y;
    let layout = egui::Layout::left_to_right(egui::Align::Center);
    let text = text.into();
    let font = egui::TextStyle::Body.resolve(ui.style());
    let wide = text.clone().into_galley(ui, Some(egui::TextWrapMode::Extend), f32::INFINITY, font.clone()).size().x;
    let label = egui::Label::new(text).sense(egui::Sense::click()).selectable(false).truncate();
    ui.allocate_ui_with_layout(egui::vec2(NAME_WIDTH, height), layout, |ui| {
        ui.set_min_width(NAME_WIDTH);
        if wide > NAME_WIDTH {
            let size = (font.size * NAME_WIDTH / wide).max(SMALLEST);
            ui.style_mut().override_font_id = Some(egui::FontId { size, ..font });
        }
        ui.add(label)
    })
    .inner
}

/// A field for the name of an object, by which files and tracks know it. While someone types, a name that another object
/// has is not taken; when they leave the field, `free_name` makes it one that is free.
pub fn name_field(ui: &mut Ui, name: &mut String, width: f32, free_name: impl Fn(&str) -> String) -> egui::Response {
    // With it are the name of its object and the pass in which it was typed: the next one may be of another object.
    let memory = ui.scope_id().with("name that is not taken");
    let pass = ui.ctx().cumulative_pass_nr();
    let typed: Option<(String, String, u64)> = ui.data(|data| data.get_temp(memory));
    let typed = typed.filter(|(of, _, at)| of == name && at + 1 >= pass);
    let mut text = typed.map_or_else(|| name.clone(), |(_, text, _)| text);
    let response = ui.add(egui::TextEdit::singleline(&mut text).desired_width(width));
    let is_left = !response.has_focus();
    if text != *name {
        let free = free_name(&text);
        if is_left || free == text.trim() {
            *name = free;
        }
    }
    ui.data_mut(|data| {
        data.remove::<(String, String, u64)>(memory);
        if !is_left && text != *name {
            data.insert_temp(memory, (name.clone(), text, pass));
        }
    });
    response
}

/// Draws a line with a list to choose from. Returns the response of the list.
pub fn choice<'a, T: PartialEq + Copy>(
    ui: &mut Ui,
    name: &str,
    chosen: &mut T,
    options: impl Iterator<Item = (T, &'a str)>,
) -> egui::Response {
    let options: Vec<(T, &str)> = options.collect();
    let shown = options.iter().find(|(option, _)| option == chosen).map_or(text!("none"), |(_, text)| *text);
    ui.horizontal(|ui| {
        let label = name_label(ui, name);
        let combo = egui::ComboBox::from_id_salt(name).width(150.0).truncate().selected_text(shown);
        let list = combo.show_ui(ui, |ui| {
            for (option, text) in &options {
                ui.selectable_value(chosen, *option, *text);
            }
        });
        list.response.labelled_by(label.id)
    })
    .inner
}

thread_local! {
    /// Says which text a field has not taken, until the window does.
    static REFUSED: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Says which text a field has not taken, if one has not since the last call.
pub fn refused() -> Option<String> {
    REFUSED.take()
}

/// A field for a number that is dragged or typed. What is typed counts once it is complete; what is no number changes
/// nothing.
pub fn number_field<N: Numeric>(value: &mut N) -> egui::DragValue<'_> {
    number_field_in(value, "")
}

/// A field for a number with its unit behind it, which may be typed, too.
pub fn number_field_in<'a, N: Numeric>(value: &'a mut N, unit: &'a str) -> egui::DragValue<'a> {
    egui::DragValue::new(value).format(kept_unless_typed::<N>(plain::<N>, typed::<N>, unit))
}

fn typed<N: Numeric>(text: &str) -> Option<f64> {
    if N::INTEGRAL { typed_whole_number(text) } else { typed_number(text) }
}

/// The most digits of a number of 32 and of 64 bits that is shown in full: such a one was typed or dragged, and a computed
/// one has more, but for a few.
const MOST_DIGITS: [usize; 2] = [6, 12];
/// The longest text of a number that is shown in full.
const MOST_LETTERS: usize = 15;

/// A number in figures, without decimals where it is a whole one by its type. All digits of one that was typed are shown,
/// however many a field has else.
pub fn plain<N: Numeric>(number: f64, decimals: RangeInclusive<usize>) -> String {
    if N::INTEGRAL {
        return format!("{number:.0}");
    }
    let is_single = size_of::<N>() == size_of::<f32>();
    let exact = if is_single { (number as f32).to_string() } else { number.to_string() };
    let digits = exact.trim_start_matches(['-', '0', '.']).bytes().filter(u8::is_ascii_digit).count();
    let own = exact.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    // egui asks for more decimals of a logarithmic slider the nearer it is to 0, for 0 itself as well.
    let decimals = (*decimals.start()).min(3)..=*decimals.end();
    let is_short = digits <= MOST_DIGITS[usize::from(!is_single)] && exact.len() <= MOST_LETTERS;
    if own > *decimals.start() && is_short {
        return exact;
    }
    egui::emath::format_with_decimals_in_range(number, decimals)
}

/// A field for a number that is written and read in a way of its own.
pub fn number_field_in_words<'a, N: Numeric>(
    value: &'a mut N,
    written: impl Fn(f64, RangeInclusive<usize>) -> String + 'a,
    read: impl Fn(&str) -> Option<f64> + 'a,
) -> egui::DragValue<'a> {
    egui::DragValue::new(value).format(kept_unless_typed::<N>(written, read, ""))
}

/// A slider with such a field. A number that nobody edits keeps all its digits, and its place beyond the ends. Whoever sets
/// the slider's decimals has it round what is typed, too.
pub fn number_slider<N: Numeric>(value: &mut N, range: RangeInclusive<N>) -> egui::Slider<'_> {
    number_slider_in(value, range, "")
}

/// A slider for a number with its unit behind it, which may be typed, too.
pub fn number_slider_in<'a, N: Numeric>(value: &'a mut N, range: RangeInclusive<N>, unit: &'a str) -> egui::Slider<'a> {
    number_slider_in_words(value, range, kept_unless_typed::<N>(plain::<N>, typed::<N>, unit))
}

/// A slider for a number that is written and read in a way of its own.
pub fn number_slider_in_words<'a, N: Numeric>(
    value: &'a mut N,
    range: RangeInclusive<N>,
    format: ValueFormat<'a>,
) -> egui::Slider<'a> {
    egui::Slider::new(value, range).format(format).clamping(egui::SliderClamping::Edits)
}

/// Leaves a number as it is while its field has the text that it showed: egui reads the text of a field that was visited as
/// if it had been typed, and the field may not show all digits. What is typed and not read is told.
pub fn kept_unless_typed<'a, N: Numeric>(
    written: impl Fn(f64, RangeInclusive<usize>) -> String + 'a,
    read: impl Fn(&str) -> Option<f64> + 'a,
    unit: &'a str,
) -> ValueFormat<'a> {
    let shown = Rc::new(RefCell::new(String::new()));
    let last = shown.clone();
    let written = move |number, decimals| {
        let text = written(number, decimals);
        shown.replace(text.clone());
        text
    };
    let read = move |text: &str| {
        let (value, text) = (last.borrow(), text.trim());
        if *value == text {
            return None;
        }
        let typed = text.strip_suffix(unit.trim()).unwrap_or(text);
        let number = read(typed);
        if number.is_none() && !text.is_empty() {
            let value = format_args!("{value}{unit}");
            // All that is not sure of it is what its only point or comma separates.
            let is_number = typed.matches(['.', ',']).count() == 1 && read(&typed.replace(['.', ','], "'")).is_some();
            REFUSED.set(Some(match () {
                () if N::INTEGRAL => text!("“{text}” is no whole number; {value} stays", text, value),
                () if is_number => text!("“{text}” may have thousands or decimals; {value} stays", text, value),
                () => text!("“{text}” is no number; {value} stays", text, value),
            }));
        }
        number
    };
    let format = ValueFormat::default().custom_formatter(written).custom_parser(read).update_while_editing(false);
    let format = format.max_decimals_opt(N::INTEGRAL.then_some(0));
    if unit.is_empty() { format } else { format.suffix(unit) }
}

/// Draws a line with a slider.
pub fn slider(ui: &mut Ui, name: &str, slider: egui::Slider<'_>) -> egui::Response {
    ui.horizontal(|ui| {
        let label = name_label(ui, name);
        ui.add(slider).labelled_by(label.id)
    })
    .inner
}

/// Draws a line with a slider for a length, from a ten-thousandth of `largest` up to `largest`.
pub fn length(ui: &mut Ui, name: &str, value: &mut f64, largest: f64) {
    let largest = largest.max(1e-6);
    let range = largest * 1e-4..=largest;
    ui.horizontal(|ui| {
        let label = name_label(ui, name);
        ui.add(number_slider(value, range).logarithmic(true)).labelled_by(label.id);
    });
}

/// The longest text of a number of which three fit beside their name.
const MOST_OF_THREE: usize = 9;

/// Draws a line of three numbers, below their name where they are as long as coordinates of a survey. Returns them if a
/// person edited one and all are finite.
pub fn three(ui: &mut Ui, name: &str, value: DVec3, speed: f64, suffix: &str) -> Option<DVec3> {
    let mut edited = value;
    let mut fields = |ui: &mut Ui, label: &egui::Response| {
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.spacing_mut().button_padding.x = 2.0;
        let width = ((ui.available_width() - 6.0) / 3.0).floor().max(40.0);
        for axis in 0..3 {
            let drag = number_field_in(&mut edited[axis], suffix).speed(speed).max_decimals(4);
            ui.add_sized([width, ui.spacing().interact_size.y], drag).labelled_by(label.id);
        }
    };
    let letters = |axis: f64| plain::<f64>(axis, 0..=4).len() + suffix.chars().count();
    let longest = value.to_array().map(letters).into_iter().max().unwrap_or(0);
    // The fields are the same ones in both places: the keyboard and a drag stay with them.
    if longest <= MOST_OF_THREE && value.abs().max_element() < 1e5 {
        ui.skip_ahead_auto_ids(1);
        ui.horizontal(|ui| {
            let label = name_label(ui, name);
            fields(ui, &label);
        });
    } else {
        let label = name_label(ui, name);
        ui.horizontal(|ui| {
            ui.skip_ahead_auto_ids(1);
            fields(ui, &label);
        });
    }
    (edited != value && edited.is_finite()).then_some(edited)
}

/// Draws the entries of a menu that may have more than fit into the window, and scrolls them then.
pub fn tall_menu(ui: &mut Ui, entries: impl FnOnce(&mut Ui)) {
    let height = ui.ctx().content_rect().height();
    egui::ScrollArea::vertical().max_height(0.6 * height).show(ui, entries);
}

/// Draws an open or closed eye that can be clicked. Screen readers read `of` aloud.
pub fn eye(ui: &mut Ui, open: bool, of: &str) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(egui::vec2(20.0, 16.0), Sense::click());
    response.widget_info(|| egui::WidgetInfo::selected(egui::Role::CheckBox, true, open, text!("Show {of}", of)));
    let color = match (open, response.hovered()) {
        (_, true) => egui::Color32::WHITE,
        (true, false) => ui.visuals().text_color(),
        (false, false) => theme::WEAK.gamma_multiply(0.6),
    };
    let stroke = egui::Stroke::new(1.3, color);
    let center = rect.center();
    // Two arcs meet at the corners of the eye. A closed eye has only the lower lid and a lash.
    let lid = |height: f32| {
        (0..=12).map(move |i| {
            let along = i as f32 / 6.0 - 1.0;
            center + egui::vec2(along * 7.5, height * (1.0 - along * along))
        })
    };
    let painter = ui.painter();
    painter.add(egui::Shape::line(lid(4.5).collect(), stroke));
    if open {
        painter.add(egui::Shape::line(lid(-4.5).collect(), stroke));
        painter.circle_filled(center, 2.2, color);
    } else {
        painter.line_segment([center + egui::vec2(0.0, 4.5), center + egui::vec2(0.0, 7.0)], stroke);
    }
    response.on_hover_text(if open { text!("Hide") } else { text!("Show") })
}

/// Draws a ring around the control that has the keyboard, above all else: many controls show that by a shade alone.
pub fn focus_ring(context: &egui::Context) {
    let focused = context.memory(egui::Memory::focused).and_then(|id| context.read_response(id));
    // A window is measured before it is shown, at another place.
    let is_shown =
        |layer| layer == egui::LayerId::background() || context.memory(|m| m.areas().visible_last_frame(&layer));
    let Some(response) = focused.filter(|response| is_shown(response.layer_id)) else { return };
    let stroke = egui::Stroke::new(1.5, theme::ACCENT);
    let painter = context.layer_painter(response.layer_id);
    painter.rect_stroke(response.interact_rect.expand(1.5), 4.0, stroke, egui::StrokeKind::Outside);
}

/// Draws a short bar that is filled up to `share`, from 0 to 1.
pub fn progress_bar(ui: &mut Ui, share: f32) {
    let bar = egui::ProgressBar::new(share).desired_width(140.0).desired_height(12.0);
    ui.add(bar.fill(theme::ACCENT.gamma_multiply(0.7)));
}

/// Formats progress: `1,203,400 of 3,214,786 · 1.20 M/s · 3 s left`. `pace` is in points a second; without it the text
/// has no speed and no time.
pub fn progress_text(done: u64, total: u64, pace: Option<f64>) -> String {
    let mut text = if total > 0 {
        text!("{done} of {total}", done = grouped(done), total = grouped(total))
    } else {
        grouped(done)
    };
    if let Some(pace) = pace {
        text += &format!(" · {:.2} M/s", pace / 1e6);
        if total > done {
            text += &format!(" · {}", time_left((total - done) as f64 / pace));
        }
    }
    text
}

/// Formats a time in seconds that something still takes: `3 s left`, `5 min left`.
pub fn time_left(seconds: f64) -> String {
    if seconds < 120.0 {
        text!("{seconds} s left", seconds = format_args!("{:.0}", seconds.ceil()))
    } else {
        text!("{minutes} min left", minutes = format_args!("{:.0}", (seconds / 60.0).ceil()))
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn progress_tells_rate_and_time_left() {
        let text = progress_text(1_000_000, 3_000_000, Some(500_000.0));
        assert_eq!(text, "1,000,000 of 3,000,000 · 0.50 M/s · 4 s left");
        let text = progress_text(1_000_000, 301_000_000, Some(1_000_000.0));
        assert_eq!(text, "1,000,000 of 301,000,000 · 1.00 M/s · 5 min left");
        assert_eq!(progress_text(5, 0, None), "5");
    }

    #[test]
    fn a_field_that_is_only_visited_keeps_the_digits_that_it_does_not_show() {
        let exact = (20_000_005.654_321, 3.123_456_7_f32, 6.123_456);
        let mut harness = egui_kittest::Harness::builder().with_size([600.0, 120.0]).build_ui_state(
            |ui, (place, share, high): &mut (f64, f32, f64)| {
                ui.add(number_field(place).speed(0.1).max_decimals(4)).accessible_name("place");
                slider(ui, "share", number_slider(share, 0.0..=1.0));
                let written = |number, decimals| egui::emath::format_with_decimals_in_range(number, decimals);
                ui.add(number_field_in_words(high, written, typed_number)).accessible_name("high");
            },
            exact,
        );
        harness.run();
        assert_eq!(*harness.state(), exact, "what is only shown");
        for key in [egui::Key::Tab, egui::Key::Enter] {
            (0..8).for_each(|_| {
                harness.key_press(egui::Key::Tab);
                harness.run();
                assert!(harness.ctx.memory(egui::Memory::focused).is_some(), "no field has the keyboard");
                harness.key_press(key);
                harness.run();
                assert_eq!(*harness.state(), exact, "{key:?}");
            });
        }
        // What is typed counts, and it is the number that was typed.
        let field = harness.get_by_label("high");
        field.click();
        harness.run();
        harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
        harness.event(egui::Event::Text("2.000001".into()));
        harness.run();
        harness.key_press(egui::Key::Enter);
        harness.run();
        assert_eq!(*harness.state(), (exact.0, exact.1, 2.000_001));
    }

    #[test]
    fn what_is_typed_is_kept_and_shown_in_full() {
        let mut harness = egui_kittest::Harness::builder().with_size([600.0, 160.0]).build_ui_state(
            |ui, (share, small, place): &mut (f32, f32, f64)| {
                slider(ui, "share", number_slider(share, 0.0..=1.0));
                slider(ui, "small", number_slider(small, 0.0..=10.0).logarithmic(true));
                let label = name_label(ui, "place");
                ui.add(number_field(place).speed(0.05).max_decimals(4)).labelled_by(label.id);
            },
            (0.5, 1.0, 2.0),
        );
        harness.run();
        let typed = ["0.123456", "0.0000125", "5413587.34125"];
        for (at, text) in typed.iter().enumerate() {
            harness.get_all_by_role(egui::Role::SpinButton).nth(at).unwrap().focus();
            harness.run();
            harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
            harness.run();
            harness.get_by(|node| node.is_focused()).type_text(text);
            harness.run();
            harness.key_press(egui::Key::Enter);
            harness.run();
        }
        assert_eq!(*harness.state(), (0.123_456, 0.000_012_5, 5_413_587.341_25));
        let shown = harness.get_all_by_role(egui::Role::SpinButton).filter_map(|field| field.value());
        assert_eq!(shown.collect::<Vec<_>>(), typed);
        // What is computed has no long tail, and nothing has a long one.
        assert_eq!(plain::<f32>(f64::from(2.0_f32 / 3.0), 1..=3), "0.667");
        assert_eq!(plain::<f32>(f64::from(60.0_f32 / 7.0), 1..=3), "8.571");
        assert_eq!((plain::<f64>(1e-300, 2..=4), plain::<f32>(0.0, 6..=8)), ("0.00".into(), "0.000".into()));
        assert_eq!(plain::<f64>(1.0 / 3.0, 2..=4), "0.3333");
        assert_eq!(plain::<f32>(f64::from(1.0_f32 / 3.0), 1..=3), "0.333");
        assert_eq!((plain::<f64>(2.0, 2..=4), plain::<f32>(f64::from(0.1_f32), 1..=3)), ("2.00".into(), "0.1".into()));
    }

    #[test]
    fn three_numbers_keep_the_keyboard_when_they_become_long() {
        let mut harness = egui_kittest::Harness::builder().with_size([310.0, 160.0]).build_ui_state(
            |ui, place: &mut DVec3| {
                *place = three(ui, "Place", *place, 0.1, "").unwrap_or(*place);
            },
            DVec3::new(1.0, 2.0, 3.0),
        );
        harness.run();
        harness.get_all_by_role(egui::Role::SpinButton).next().unwrap().focus();
        harness.run();
        // The first number is too long for the line.
        for text in ["1234.56789", "-5.25", "7"] {
            harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
            harness.run();
            harness.get_by(|node| node.is_focused()).type_text(text);
            harness.run();
            harness.key_press(egui::Key::Tab);
            harness.run();
        }
        assert_eq!(*harness.state(), DVec3::new(1_234.567_89, -5.25, 7.0));
    }

    #[test]
    fn whole_numbers_have_no_decimals() {
        use egui_kittest::kittest::Queryable as _;
        let mut harness = egui_kittest::Harness::builder().with_size([600.0, 160.0]).build_ui_state(
            |ui, (fields, sliders, neighbours): &mut (usize, u32, u32)| {
                let label = ui.label("Values");
                ui.add(number_field(fields)).labelled_by(label.id);
                let label = ui.label("Bounces");
                ui.add(number_slider(sliders, 0..=8)).labelled_by(label.id);
                slider(ui, "Neighbours", number_slider(neighbours, 3..=64));
            },
            (6, 1, 12),
        );
        harness.run();
        let fields = harness.get_all_by_role(egui::Role::SpinButton).filter_map(|field| field.value());
        assert_eq!(fields.collect::<Vec<_>>(), ["6", "1", "12"]);
        // What is typed has separators of thousands and no decimals.
        let mut typed = |text: &str| {
            harness.get_all_by_role(egui::Role::SpinButton).next().unwrap().focus();
            harness.run();
            harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
            harness.run();
            harness.get_by(|node| node.is_focused()).type_text(text);
            harness.run();
            harness.key_press(egui::Key::Enter);
            harness.run();
            (*harness.state(), refused())
        };
        assert_eq!(typed("500.000"), ((500_000, 1, 12), None));
        let told = Some("“2.7” is no whole number; 500000 stays".to_owned());
        assert_eq!(typed("2.7"), ((500_000, 1, 12), told));
    }

    #[test]
    fn a_unit_that_a_field_shows_may_be_typed_and_what_is_no_number_is_told() {
        let mut harness = egui_kittest::Harness::new_ui_state(
            |ui, value: &mut f64| {
                ui.add(number_field_in(value, " m").max_decimals(2)).accessible_name("Width");
            },
            1.0,
        );
        let mut typed = |text: &str| {
            harness.get_by_role(egui::Role::SpinButton).focus();
            harness.run();
            harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
            harness.run();
            harness.get_by(|node| node.is_focused()).type_text(text);
            harness.run();
            harness.key_press(egui::Key::Enter);
            harness.run();
            (*harness.state(), refused())
        };
        for (text, number) in [("2,5 m", 2.5), ("3m", 3.0), ("1.250,5 m", 1250.5), ("2.5", 2.5)] {
            assert_eq!(typed(text), (number, None), "{text}");
        }
        for (text, told) in [
            ("2,5 km", "“2,5 km” is no number; 2.5 m stays"),
            ("1.234 km", "“1.234 km” is no number; 2.5 m stays"),
            ("1,234 m", "“1,234 m” may have thousands or decimals; 2.5 m stays"),
        ] {
            assert_eq!(typed(text), (2.5, Some(told.to_owned())));
        }
    }

    #[test]
    fn a_field_takes_a_decimal_comma_and_keeps_its_number_where_none_is_typed() {
        use egui_kittest::kittest::Queryable as _;
        let mut harness = egui_kittest::Harness::new_ui_state(
            |ui, value: &mut f64| {
                let label = ui.label("Size");
                ui.add(number_field(value).range(0.0..=10.0)).labelled_by(label.id);
            },
            1.0,
        );
        let mut typed = |text: &str| {
            harness.get_by_role(egui::Role::SpinButton).focus();
            harness.run();
            harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
            harness.run();
            let field = harness.get_by(|node| node.is_focused());
            field.type_text(text);
            harness.run();
            let while_typed = *harness.state();
            harness.key_press(egui::Key::Enter);
            harness.run();
            (while_typed, *harness.state())
        };
        assert_eq!(typed("2,5"), (1.0, 2.5), "what is typed counts once it is complete");
        assert_eq!(typed("nan"), (2.5, 2.5));
        assert_eq!(typed("1e30"), (2.5, 10.0));
    }

    #[test]
    fn coordinates_of_a_survey_fit_into_the_panel() {
        use egui_kittest::kittest::Queryable as _;
        for value in [DVec3::new(432_493.12, 5_413_587.34, 336.28), DVec3::new(-1234.56, 987.65, 0.5)] {
            let size = egui::vec2(285.0, 100.0);
            let mut harness = egui_kittest::Harness::builder().with_size(size).build_ui(|ui| {
                assert_eq!(three(ui, "Position", value, 0.05, ""), None);
            });
            harness.run_ok();
            let fields: Vec<_> = harness.get_all_by_role(egui::accesskit::Role::SpinButton).collect();
            assert_eq!(fields.len(), 3);
            for (axis, field) in fields.iter().enumerate() {
                assert!(field.rect().max.x <= size.x, "{value}, {axis}: {:?}", field.rect());
            }
        }
    }
}
