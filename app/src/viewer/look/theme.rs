//! The colours and sizes of the interface: dark, calm, with one accent colour.

use egui::{Color32, CornerRadius, Stroke, TextStyle};

pub use crate::shared::numbers::grouped;

/// A warm amber for changed values, active tools and links.
pub const ACCENT: Color32 = Color32::from_rgb(0xe6, 0xb2, 0x5c);
pub const ERROR: Color32 = Color32::from_rgb(0xf6, 0x99, 0x8d);
pub const WARNING: Color32 = Color32::from_rgb(0xe8, 0xc4, 0x68);
/// The colour of less important text, on panels and fields; on buttons its contrast is too low.
pub const WEAK: Color32 = Color32::from_rgb(0x95, 0x9b, 0xa5);
pub const PANEL: Color32 = Color32::from_rgb(0x1a, 0x1c, 0x20);
const TEXT: Color32 = Color32::from_rgb(0xd6, 0xd9, 0xde);
const FIELD: Color32 = Color32::from_rgb(0x10, 0x12, 0x15);
const WIDGET: Color32 = Color32::from_rgb(0x2a, 0x2d, 0x33);
const WIDGET_HOVERED: Color32 = Color32::from_rgb(0x32, 0x36, 0x3d);
const WIDGET_ACTIVE: Color32 = Color32::from_rgb(0x3b, 0x40, 0x49);
const STRIPE: Color32 = Color32::from_rgb(0x1f, 0x22, 0x27);
const SELECTION: Color32 = Color32::from_rgb(0x54, 0x44, 0x23);
const LINE: Color32 = Color32::from_rgb(0x2c, 0x2f, 0x36);

/// Sets the colours and sizes.
pub fn apply(context: &egui::Context) {
    context.set_theme(egui::Theme::Dark);
    context.all_styles_mut(|style| {
        let visuals = &mut style.visuals;
        visuals.panel_fill = PANEL;
        visuals.window_fill = PANEL;
        visuals.extreme_bg_color = FIELD;
        visuals.faint_bg_color = STRIPE;
        visuals.weak_text_color = Some(WEAK);
        visuals.window_stroke = Stroke::new(1.0, LINE);
        visuals.selection.bg_fill = SELECTION;
        visuals.selection.stroke = Stroke::new(1.0, ACCENT);
        visuals.hyperlink_color = ACCENT;
        visuals.slider_trailing_fill = true;
        visuals.widgets.noninteractive.bg_stroke = Stroke::new(1.0, LINE);
        visuals.widgets.noninteractive.fg_stroke = Stroke::new(1.0, TEXT);
        let states = [
            (&mut visuals.widgets.inactive, WIDGET, TEXT),
            (&mut visuals.widgets.hovered, WIDGET_HOVERED, Color32::WHITE),
            (&mut visuals.widgets.active, WIDGET_ACTIVE, Color32::WHITE),
            (&mut visuals.widgets.open, WIDGET, TEXT),
        ];
        for (widget, fill, text) in states {
            widget.bg_fill = fill;
            widget.weak_bg_fill = fill;
            widget.bg_stroke = Stroke::NONE;
            widget.fg_stroke = Stroke::new(1.0, text);
            widget.corner_radius = CornerRadius::same(4);
        }
        style.spacing.item_spacing = egui::vec2(8.0, 5.0);
        style.spacing.button_padding = egui::vec2(8.0, 3.0);
        style.spacing.slider_width = 84.0;
        // A scroll bar always has the width that it grows to under the pointer, so it never covers anything.
        style.spacing.scroll.bar_width = 8.0;
        style.spacing.scroll.floating_allocated_width = 8.0;
        let sizes =
            [(TextStyle::Heading, 15.0), (TextStyle::Body, 13.0), (TextStyle::Button, 13.0), (TextStyle::Small, 11.0)];
        for (text_style, size) in sizes {
            if let Some(font) = style.text_styles.get_mut(&text_style) {
                font.size = size;
            }
        }
    });
}

/// Formats a number of bytes for people: `312 MB` (decimal, as in file managers).
pub fn bytes(count: u64) -> String {
    match count {
        0..1_000_000 => format!("{} kB", count / 1000),
        1_000_000..1_000_000_000 => format!("{} MB", count / 1_000_000),
        _ => format!("{:.2} GB", count as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::*;

    /// The contrast of two colours by WCAG 2.2, from 1 to 21.
    fn contrast(one: Color32, other: Color32) -> f64 {
        let linear = |byte: u8| {
            let value = f64::from(byte) / 255.0;
            if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        let luminance = |color: Color32| {
            0.2126 * linear(color.r()) + 0.7152 * linear(color.g()) + 0.0722 * linear(color.b()) + 0.05
        };
        let ratio = luminance(one) / luminance(other);
        ratio.max(1.0 / ratio)
    }

    #[test]
    fn texts_and_the_marks_of_controls_have_the_contrast_of_wcag_aa() {
        assert!((contrast(Color32::BLACK, Color32::WHITE) - 21.0).abs() < 1e-9);
        let gray = Color32::from_gray(0x77);
        assert!((contrast(gray, Color32::WHITE) - 4.478).abs() < 1e-3, "as WebAIM's calculator has it");
        let context = egui::Context::default();
        apply(&context);
        let style = context.style_of(egui::Theme::Dark);
        let visuals = &style.visuals;
        let areas = [visuals.panel_fill, visuals.window_fill, visuals.extreme_bg_color, visuals.faint_bg_color];
        let widgets = &visuals.widgets;
        let states = [&widgets.inactive, &widgets.hovered, &widgets.active, &widgets.open];
        let fills = states.map(|state| state.weak_bg_fill);
        let texts = [visuals.text_color(), Color32::WHITE, ACCENT, WARNING, ERROR, visuals.hyperlink_color];
        for text in texts {
            for area in areas.into_iter().chain(fills) {
                assert!(contrast(text, area) >= 4.5, "{text:?} on {area:?}: {}", contrast(text, area));
            }
        }
        for area in areas {
            assert!(contrast(visuals.weak_text_color(), area) >= 4.5, "{area:?}");
            assert!(contrast(ACCENT, area) >= 3.0, "the ring around what has the keyboard");
        }
        for state in states {
            assert!(contrast(state.fg_stroke.color, state.weak_bg_fill) >= 4.5);
        }
        assert!(contrast(visuals.selection.stroke.color, visuals.selection.bg_fill) >= 4.5);
        assert!(contrast(visuals.text_color(), visuals.selection.bg_fill) >= 4.5);
    }

    fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                sources(&path, found);
            } else if path.extension().is_some_and(|kind| kind == "rs") {
                found.push(path);
            }
        }
    }

    #[test]
    fn the_fonts_have_every_sign_that_the_window_writes() {
        let mut files = Vec::new();
        sources(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src/viewer")), &mut files);
        assert!(files.len() > 50);
        let context = egui::Context::default();
        let _ = context.run_ui(egui::RawInput::default(), |_| ());
        for path in files {
            let text = std::fs::read_to_string(&path).unwrap();
            let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
            for sign in code.flat_map(str::chars).filter(|sign| !sign.is_ascii()) {
                let has_it = context.fonts_mut(|fonts| fonts.has_glyph(&egui::FontId::proportional(13.0), sign));
                assert!(has_it, "{}: {sign}", path.display());
            }
        }
    }
}
