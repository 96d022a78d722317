//! The line of the timeline in which the selected caption is written.

use egui::{ComboBox, TextEdit, Ui};
use scene::{Caption, Place};

use crate::shared::language::{english, text, translated};
use crate::viewer::look::widgets::number_field_in;

const PLACES: [(Place, &str); 3] =
    [(Place::Top, english!("top")), (Place::Middle, english!("middle")), (Place::Bottom, english!("bottom"))];

/// Draws the fields of a caption of a path that lasts until `end`, in seconds.
pub fn row(ui: &mut Ui, caption: &mut Caption, end: f64) {
    ui.horizontal(|ui| {
        let field = TextEdit::multiline(&mut caption.text).desired_rows(1).desired_width(320.0);
        let help = text!(
            "Enter begins a line. The key of a parameter in braces stands for its value: {key}",
            key = "{reflection.method}",
        );
        ui.add(field).on_hover_text(help).accessible_name(text!("Text of the caption"));
        let mut stays = caption.end.is_none();
        if ui.checkbox(&mut stays, text!("Stays")).on_hover_text(text!("Until the end of the path")).changed() {
            caption.end = (!stays).then_some(end.max(caption.start + 1.0));
        }
        if let Some(end) = &mut caption.end {
            ui.label(text!("until"));
            let drag = number_field_in(end, " s").speed(0.02).range(caption.start + 0.01..=1e6);
            ui.add(drag.fixed_decimals(2)).accessible_name(text!("End of the caption"));
        }
        let shown = PLACES.iter().find(|(place, _)| *place == caption.place).map_or("", |(_, name)| translated(name));
        let list = ComboBox::from_id_salt("place of the caption").width(70.0).selected_text(shown);
        let list = list.show_ui(ui, |ui| {
            for (place, name) in PLACES {
                ui.selectable_value(&mut caption.place, place, translated(name));
            }
        });
        list.response.accessible_name(text!("Place of the caption"));
        let mut percent = caption.size * 100.0;
        let drag = number_field_in(&mut percent, " %").speed(0.05).range(1.0..=10.0).max_decimals(1);
        let drag = ui.add(drag).on_hover_text(text!("Height of the text, of that of the picture"));
        if drag.accessible_name(text!("Size of the caption")).changed() {
            caption.size = percent / 100.0;
        }
    });
}
