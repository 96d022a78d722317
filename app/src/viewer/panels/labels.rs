//! Draws the measurement that is being placed over the picture: its corners so far, and the value at the cursor.

use egui::{Painter, Pos2, Stroke, vec2};
use glam::DVec3;
use scene::Measurement;

use crate::overlays::labels::{label, lines};
use crate::shared::language::translated;
use crate::viewer::look::theme;
use crate::viewer::session::Session;
use crate::viewer::tools::measurements::units;

/// Draws the corners so far, a line to the cursor, and the value there. `place` projects into the window.
pub fn placing(painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, session: &Session) {
    let Some(placing) = &session.tools.measurements.placing else { return };
    let Some(kind) = placing.wanted.drawn_as() else { return };
    let draft = Measurement {
        name: String::new(),
        kind,
        on: true,
        color: [0.9, 0.7, 0.36],
        points: placing.corners.clone(),
        reach: placing.reach,
        level: None,
    };
    let size = session.scene.settings.overlay.text;
    if !draft.points.is_empty() {
        lines(painter, place, &draft, true, size);
    }
    let Some(pointer) = painter.ctx().input(|input| input.pointer.latest_pos()) else { return };
    if let Some(last) = placing.corners.last().and_then(|corner| place(*corner)).filter(|_| !kind.has_reach()) {
        painter.line_segment([last, pointer], Stroke::new(1.0, theme::ACCENT));
    }
    if let Some(figure) = placing.live(session.scene.hovered(), session.up()).first() {
        let text = format!("{}  {}", translated(figure.name), figure.text(&units(&session.loaded)));
        label(painter, pointer + vec2(14.0, 0.0), &text, theme::ACCENT, false, size);
    }
}
