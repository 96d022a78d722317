//! Measurements, notes and profiles over a picture: their lines, and a label with the value or the text.

use codec::Units;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, vec2};
use glam::DVec3;
use scene::{Measurement, MeasurementKind, Note, Profile};

use super::ground::SHADOW;
use crate::measuring::{Figure, Outcome};

/// The number of pieces of a circle.
const RING_STEPS: u32 = 48;
/// The most characters of a note's label.
const MOST_SHOWN: usize = 40;
/// The height of the text for which widths of lines are given.
const USUAL: f32 = 13.0;

/// A measurement or a note to draw.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    pub drawn: Drawn,
    pub text: String,
    pub is_selected: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Drawn {
    Measurement(Measurement),
    Note(Note),
    /// A profile, and the two borders of its slice.
    Profile(Profile, [Profile; 2]),
}

impl Mark {
    /// A measurement with its main figures, as far as they are known.
    pub fn of_measurement(measurement: &Measurement, figures: Option<&Outcome>, units: &Units) -> Self {
        let values = figures.and_then(|figures| figures.as_ref().ok()).map_or(String::new(), |figures| {
            let main = figures.iter().take(Figure::main_ones(measurement.kind));
            main.map(|figure| figure.short(units)).collect::<Vec<_>>().join("  ")
        });
        let text = format!("{}  {values}", measurement.name);
        Self { drawn: Drawn::Measurement(measurement.clone()), text, is_selected: false }
    }

    pub fn of_note(note: &Note) -> Self {
        let text = param::shortened(note.title(), MOST_SHOWN);
        Self { drawn: Drawn::Note(note.clone()), text, is_selected: false }
    }

    pub fn of_profile(profile: &Profile, up: DVec3) -> Self {
        let sides = [0.5, -0.5].map(|share| profile.beside(up, profile.width * share));
        let drawn = Drawn::Profile(profile.clone(), sides);
        Self { drawn, text: profile.name.clone(), is_selected: false }
    }

    /// Draws it, with text of a height. `place` projects into the picture.
    pub fn paint(&self, painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, size: f32) {
        match &self.drawn {
            Drawn::Measurement(measurement) => {
                lines(painter, place, measurement, self.is_selected, size);
                if let Some(at) = place(anchor(measurement)) {
                    label(painter, at, &self.text, of(measurement.color), self.is_selected, size);
                }
            }
            Drawn::Note(note) => {
                let Some(at) = place(note.position) else { return };
                let (color, scale) = (of(note.color), size / USUAL);
                for (radius, color) in [(5.5, SHADOW), (4.0, color)] {
                    painter.circle_filled(at, radius * scale, color);
                }
                label(painter, at, &self.text, color, self.is_selected, size);
            }
            Drawn::Profile(profile, sides) => {
                let (color, scale) = (of(profile.color), size / USUAL);
                let width = if self.is_selected { 2.4 } else { 1.5 } * scale;
                let thin = |side: &Profile| (side.line.clone(), width * 0.5);
                let all = std::iter::once((profile.line.clone(), width)).chain(sides.iter().map(thin));
                for (line, width) in all {
                    for ends in line.windows(2).filter_map(|ends| seen(place, ends[0], ends[1])) {
                        painter.line_segment(ends, Stroke::new(width + 2.0 * scale, SHADOW));
                        painter.line_segment(ends, Stroke::new(width, color));
                    }
                }
                if let Some(at) = profile.line.first().and_then(|start| place(*start)) {
                    label(painter, at, &self.text, color, self.is_selected, size);
                }
            }
        }
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

/// The part of a line between two places that lies before the eye, in points of the picture.
pub fn seen(place: &impl Fn(DVec3) -> Option<Pos2>, a: DVec3, b: DVec3) -> Option<[Pos2; 2]> {
    let (mut before, mut behind) = match (place(a), place(b)) {
        (Some(a), Some(b)) => return Some([a, b]),
        (Some(_), None) => (a, b),
        (None, Some(_)) => (b, a),
        (None, None) => return None,
    };
    let start = place(before)?;
    // Halve the line until the missing rest is far outside of the picture.
    for _ in 0..10 {
        let middle = (before + behind) * 0.5;
        if place(middle).is_some() { before = middle } else { behind = middle }
    }
    Some([start, place(before)?])
}

/// Draws the points, and the lines between them.
pub fn lines(
    painter: &Painter,
    place: &impl Fn(DVec3) -> Option<Pos2>,
    measurement: &Measurement,
    is_selected: bool,
    size: f32,
) {
    let (points, color, scale) = (&measurement.points, of(measurement.color), size / USUAL);
    let width = if is_selected { 2.4 } else { 1.5 } * scale;
    let segment = |from: DVec3, to: DVec3| {
        if let Some(ends) = seen(place, from, to) {
            painter.line_segment(ends, Stroke::new(width + 2.0 * scale, SHADOW));
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
        painter.circle_filled(at, width + 2.4 * scale, SHADOW);
        painter.circle_filled(at, width + scale, color);
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
pub fn label(painter: &Painter, at: Pos2, text: &str, color: Color32, is_selected: bool, size: f32) {
    let (text, scale) = (text.trim(), size / USUAL);
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(size), Color32::WHITE);
    let area = Align2::CENTER_BOTTOM.anchor_size(at - vec2(0.0, 10.0 * scale), galley.size());
    let ground: Rect = area.expand2(vec2(6.0, 3.0) * scale);
    painter.rect_filled(ground, 4.0 * scale, Color32::from_black_alpha(190));
    let width = if is_selected { 1.8 } else { 1.0 } * scale;
    painter.rect_stroke(ground, 4.0 * scale, Stroke::new(width, color), egui::StrokeKind::Outside);
    painter.galley(area.min, galley, Color32::WHITE);
}

#[cfg(test)]
mod tests {
    use egui::pos2;

    use super::*;

    /// A camera that sees places with a z above 0, each at its x and y.
    fn place(world: DVec3) -> Option<Pos2> {
        (world.z > 0.0).then(|| pos2(world.x as f32, world.y as f32))
    }

    #[test]
    fn a_line_is_cut_where_it_passes_the_eye() {
        let (before, behind) = (DVec3::new(0.0, 0.0, 1.0), DVec3::new(8.0, 4.0, -3.0));
        assert_eq!(seen(&place, before, before + DVec3::X), Some([pos2(0.0, 0.0), pos2(1.0, 0.0)]));
        assert_eq!(seen(&place, behind, behind + DVec3::X), None);
        // The line passes the eye after a quarter of its length; ten halvings come within a thousandth of that place.
        for ends in [[before, behind], [behind, before]] {
            let [from, to] = seen(&place, ends[0], ends[1]).expect("a part of it is before the eye");
            assert_eq!(from, pos2(0.0, 0.0));
            assert!(to.x <= 2.0 && to.distance(pos2(2.0, 1.0)) < 0.01, "{to}");
        }
    }
}
