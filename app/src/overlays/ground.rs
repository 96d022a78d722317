//! What lies behind overlays so that they can be read over any picture.

use egui::{Color32, Painter, Rect};

/// The colour around lines.
pub const SHADOW: Color32 = Color32::from_black_alpha(160);

/// Fills the place of an overlay, and a margin around it, for a height of the text.
pub fn paint(painter: &Painter, area: Rect, size: f32) {
    painter.rect_filled(area.expand(size * 0.4), size * 0.3, SHADOW);
}
