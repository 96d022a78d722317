//! Draws measurements and notes over the picture: their lines, and a label with the value or the text.

use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, vec2};
use glam::DVec3;
use scene::{Measurement, MeasurementKind};

use crate::measuring::Figure;
use crate::viewer::panels::overlay::{SHADOW, seen};
use crate::viewer::session::Session;
use crate::viewer::theme;
use crate::viewer::tools::measurements::{Wanted, units};

/// The number of pieces of a circle.
const RING_STEPS: u32 = 48;
/// The most characters of a note's label.
const MOST_SHOWN: usize = 40;

/// Draws all that are switched on, and what is being placed. `place` projects into the window.
pub fn paint(painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, session: &Session) {
    let (units, objects) = (units(&session.loaded), &session.scene.objects);
    for placed in objects.measurements.iter().filter(|placed| placed.measurement.on) {
        let measurement = &placed.measurement;
        let is_selected = session.scene.selected == Some(placed.id);
        lines(painter, place, measurement, is_selected);
        let figures = session.tools.measurements.figures(placed.id).and_then(|figures| figures.as_ref().ok());
        let values = figures.map_or(String::new(), |figures| {
            let main = figures.iter().take(Figure::main_ones(measurement.kind));
            main.map(|figure| figure.short(&units)).collect::<Vec<_>>().join("  ")
        });
        if let Some(at) = place(anchor(measurement)) {
            label(painter, at, &format!("{}  {values}", measurement.name), of(measurement.color), is_selected);
        }
    }
    for placed in objects.notes.iter().filter(|placed| placed.note.on) {
        let Some(at) = place(placed.note.position) else { continue };
        let color = of(placed.note.color);
        for (radius, color) in [(5.5, SHADOW), (4.0, color)] {
            painter.circle_filled(at, radius, color);
        }
        let text = param::shortened(placed.note.title(), MOST_SHOWN);
        label(painter, at, &text, color, session.scene.selected == Some(placed.id));
    }
    placing(painter, place, session);
}

/// Draws the corners so far, a line to the cursor, and the value there.
fn placing(painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, session: &Session) {
    let Some(placing) = &session.tools.measurements.placing else { return };
    let Wanted::Measurement(kind) = placing.wanted else { return };
    let draft = Measurement {
        name: String::new(),
        kind,
        on: true,
        color: [0.9, 0.7, 0.36],
        points: placing.corners.clone(),
        reach: placing.reach,
        level: None,
    };
    if !draft.points.is_empty() {
        lines(painter, place, &draft, true);
    }
    let Some(pointer) = painter.ctx().input(|input| input.pointer.latest_pos()) else { return };
    if let Some(last) = placing.corners.last().and_then(|corner| place(*corner)).filter(|_| !kind.has_reach()) {
        painter.line_segment([last, pointer], Stroke::new(1.0, theme::ACCENT));
    }
    if let Some(figure) = placing.live(session.hovered(), session.up()).first() {
        let text = format!("{}  {}", figure.name, figure.text(&units(&session.loaded)));
        label(painter, pointer + vec2(14.0, 0.0), &text, theme::ACCENT, false);
    }
}

/// Where the label of a measurement is.
fn anchor(measurement: &Measurement) -> DVec3 {
    let points = &measurement.points;
    match measurement.kind {
        MeasurementKind::Angle => points[1],
        MeasurementKind::Polyline => points[points.len() - 1],
        _ => points.iter().sum::<DVec3>() / points.len() as f64,
    }
}

fn of(color: [f32; 3]) -> Color32 {
    let [red, green, blue] = color.map(|share| (share * 255.0).round() as u8);
    Color32::from_rgb(red, green, blue)
}

/// Draws the points, and the lines between them.
fn lines(painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, measurement: &Measurement, is_selected: bool) {
    let (points, color) = (&measurement.points, of(measurement.color));
    let width = if is_selected { 2.4 } else { 1.5 };
    let segment = |from: DVec3, to: DVec3| {
        if let Some(ends) = seen(place, from, to) {
            painter.line_segment(ends, Stroke::new(width + 2.0, SHADOW));
            painter.line_segment(ends, Stroke::new(width, color));
        }
    };
    match measurement.kind {
        MeasurementKind::Plane | MeasurementKind::Cylinder => {
            for point in points {
                ring(painter, place, *point, measurement.reach.unwrap_or(0.0), Stroke::new(width, color));
            }
        }
        MeasurementKind::Circle => match measure::circle(points) {
            Ok(round) => {
                let (u, v) = round.axis.any_orthonormal_pair();
                let at = |step: u32| {
                    let (sine, cosine) = (f64::from(step) / f64::from(RING_STEPS) * std::f64::consts::TAU).sin_cos();
                    round.center + (u * cosine + v * sine) * round.radius
                };
                (0..RING_STEPS).for_each(|step| segment(at(step), at(step + 1)));
            }
            Err(_) => points.windows(2).for_each(|ends| segment(ends[0], ends[1])),
        },
        kind => {
            points.windows(2).for_each(|ends| segment(ends[0], ends[1]));
            if let (true, [first, .., last]) = (kind.is_polygon() && points.len() > 2, points.as_slice()) {
                segment(*last, *first);
            }
        }
    }
    for at in points.iter().filter_map(|point| place(*point)) {
        painter.circle_filled(at, width + 2.4, SHADOW);
        painter.circle_filled(at, width + 1.0, color);
    }
}

/// Draws a circle about a place that faces the eye, as large as a ball of that radius there.
fn ring(painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, middle: DVec3, radius: f64, stroke: Stroke) {
    let Some(at) = place(middle) else { return };
    let ends = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().filter_map(|axis| place(middle + axis * radius));
    // Of three axes at right angles, one is at most 55 degrees off the plane that faces the eye; the sum of their
    // squares is that of two whole radii.
    let squares: f32 = ends.map(|end| end.distance_sq(at)).sum();
    painter.circle_stroke(at, (squares * 0.5).sqrt(), Stroke::new(stroke.width + 2.0, SHADOW));
    painter.circle_stroke(at, (squares * 0.5).sqrt(), stroke);
}

/// Writes a line above a place, on a ground that can be read over any picture.
fn label(painter: &Painter, at: Pos2, text: &str, color: Color32, is_selected: bool) {
    let text = text.trim();
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(13.0), Color32::WHITE);
    let area = Align2::CENTER_BOTTOM.anchor_size(at - vec2(0.0, 10.0), galley.size());
    let ground: Rect = area.expand2(vec2(6.0, 3.0));
    painter.rect_filled(ground, 4.0, Color32::from_black_alpha(190));
    let width = if is_selected { 1.8 } else { 1.0 };
    painter.rect_stroke(ground, 4.0, Stroke::new(width, color), egui::StrokeKind::Outside);
    painter.galley(area.min, galley, Color32::WHITE);
}
