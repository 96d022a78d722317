//! The colours and sizes of the interface: dark, calm, with one accent colour.

use egui::{Color32, CornerRadius, Stroke, TextStyle};

pub use crate::shared::numbers::grouped;

/// A warm amber for changed values, active tools and links.
pub const ACCENT: Color32 = Color32::from_rgb(0xe6, 0xb2, 0x5c);
pub const ERROR: Color32 = Color32::from_rgb(0xf0, 0x7a, 0x6a);
pub const WARNING: Color32 = Color32::from_rgb(0xe8, 0xc4, 0x68);
/// The colour of less important text. Its contrast with the panel is 5 : 1.
pub const WEAK: Color32 = Color32::from_rgb(0x95, 0x9b, 0xa5);
pub const PANEL: Color32 = Color32::from_rgb(0x1a, 0x1c, 0x20);
const TEXT: Color32 = Color32::from_rgb(0xd6, 0xd9, 0xde);
const FIELD: Color32 = Color32::from_rgb(0x10, 0x12, 0x15);
const WIDGET: Color32 = Color32::from_rgb(0x2a, 0x2d, 0x33);
const WIDGET_HOVERED: Color32 = Color32::from_rgb(0x35, 0x39, 0x41);
const WIDGET_ACTIVE: Color32 = Color32::from_rgb(0x43, 0x48, 0x52);
const LINE: Color32 = Color32::from_rgb(0x2c, 0x2f, 0x36);

/// Sets the colours and sizes.
pub fn apply(context: &egui::Context) {
    context.set_theme(egui::Theme::Dark);
    context.all_styles_mut(|style| {
        let visuals = &mut style.visuals;
        visuals.panel_fill = PANEL;
        visuals.window_fill = PANEL;
        visuals.extreme_bg_color = FIELD;
        visuals.faint_bg_color = Color32::from_rgb(0x1f, 0x22, 0x27);
        visuals.window_stroke = Stroke::new(1.0, LINE);
        visuals.selection.bg_fill = Color32::from_rgb(0x5c, 0x4a, 0x28);
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
