//! Measurements, notes and profiles over a picture: their lines, and a label with the value or the text.

use std::sync::Arc;

use codec::Units;
use egui::{Align2, Color32, FontId, Galley, Painter, Pos2, Rect, Stroke, vec2};
use glam::DVec3;
use scene::{Measurement, MeasurementKind, Note, Profile};

use super::ground::SHADOW;
use crate::shared::language::text;
use crate::shared::measuring::{Figure, OF_SQUARE_DEGREES, Outcome, are_of_loaded};

/// The number of pieces of a circle.
const RING_STEPS: u32 = 48;
/// The most characters of a note's label.
const MOST_SHOWN: usize = 40;
/// The height of the text for which widths of lines are given.
const USUAL: f32 = 13.0;
/// How many times its height a label goes up at most to make room for others.
const MOST_LIFTS: u32 = 8;
/// The most labels that are kept apart; among more, nothing could be read all the same.
const MOST_APART: usize = 200;
/// How far outside of the picture a point can be whose label reaches into it, in points.
const LONGEST_NAME: f32 = 400.0;

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
            if are_of_loaded(figures) {
                let values = main.map(|figure| rough(figure, units)).collect::<Vec<_>>().join("  ");
                return text!("{values} of loaded points", values);
            }
            main.map(|figure| short(figure, units)).collect::<Vec<_>>().join("  ")
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

    /// Draws it without its label; `size` is the height of text. `place` projects into the picture.
    fn paint(&self, painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, size: f32) {
        match &self.drawn {
            Drawn::Measurement(measurement) => lines(painter, place, measurement, self.is_selected, size),
            Drawn::Note(note) => {
                let Some(at) = place(note.position) else { return };
                let (color, scale) = (of(note.color), size / USUAL);
                for (radius, color) in [(5.5, SHADOW), (4.0, color)] {
                    painter.circle_filled(at, radius * scale, color);
                }
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
            }
        }
    }

    /// The point that the label stands above, and the label's colour.
    fn labelled(&self) -> Option<(DVec3, Color32)> {
        match &self.drawn {
            Drawn::Measurement(measurement) => Some((anchor(measurement), of(measurement.color))),
            Drawn::Note(note) => Some((note.position, of(note.color))),
            Drawn::Profile(profile, _) => Some((*profile.line.first()?, of(profile.color))),
        }
    }
}

/// The value with its unit, without its interval.
fn short(figure: &Figure, units: &Units) -> String {
    let text = figure.text(units);
    match text.split_once(" ± ") {
        Some((value, _)) => with_unit(value, figure, units),
        None => text,
    }
}

/// The value with its unit where it is of a thinned choice of the points: at most three digits. How far it is
/// off is not known; some percent were seen.
fn rough(figure: &Figure, units: &Units) -> String {
    let value: f64 = format!("{:.2e}", figure.value).parse().unwrap_or(figure.value);
    let digits = if value == 0.0 { 0.0 } else { 2.0 - value.abs().log10().floor() };
    let decimals = digits.clamp(0.0, OF_SQUARE_DEGREES as f64) as usize;
    with_unit(&format!("≈ {value:.decimals$}"), figure, units)
}

fn with_unit(value: &str, figure: &Figure, units: &Units) -> String {
    match figure.unit(units) {
        Some(unit) if unit == "°" => format!("{value}{unit}"),
        Some(unit) => format!("{value} {unit}"),
        None => value.to_owned(),
    }
}

/// Draws marks, with text of a height. A label that would cover another one stands higher, on a thin line; that of a
/// selected mark keeps its place.
pub fn paint_all(marks: &[Mark], painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, size: f32) {
    marks.iter().for_each(|mark| mark.paint(painter, place, size));
    let mut taken: Vec<Rect> = Vec::new();
    let (selected, others): (Vec<&Mark>, Vec<&Mark>) = marks.iter().partition(|mark| mark.is_selected);
    for mark in selected.into_iter().chain(others) {
        let labelled = mark.labelled().and_then(|(world, color)| Some((place(world)?, color)));
        let Some((at, color)) = labelled.filter(|(at, _)| painter.clip_rect().expand(LONGEST_NAME).contains(*at))
        else {
            continue;
        };
        let (galley, ground) = laid_out(painter, at, &mark.text, size);
        let lift = free_lift(ground, &taken);
        let ground = ground.translate(vec2(0.0, -lift));
        if lift > 0.0 {
            painter.line_segment([at, ground.center_bottom()], Stroke::new(1.0, color.gamma_multiply(0.7)));
        }
        if taken.len() < MOST_APART {
            taken.push(ground);
        }
        paint_label(painter, galley, ground, color, mark.is_selected, size);
    }
}

/// How far a label goes up so that it covers none of those that are there. Where there is no room in reach, it stays.
fn free_lift(ground: Rect, taken: &[Rect]) -> f32 {
    let step = ground.height() + 3.0;
    let is_free = |lift: &f32| {
        let lifted = ground.translate(vec2(0.0, -lift));
        !taken.iter().any(|other| other.intersects(lifted))
    };
    (0..MOST_LIFTS).map(|lift| lift as f32 * step).find(is_free).unwrap_or(0.0)
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
    let (galley, ground) = laid_out(painter, at, text, size);
    paint_label(painter, galley, ground, color, is_selected, size);
}

/// A label's text, and its ground above a place.
fn laid_out(painter: &Painter, at: Pos2, text: &str, size: f32) -> (Arc<Galley>, Rect) {
    let scale = size / USUAL;
    let galley = painter.layout_no_wrap(text.trim().to_owned(), FontId::proportional(size), Color32::WHITE);
    let area = Align2::CENTER_BOTTOM.anchor_size(at - vec2(0.0, 10.0 * scale), galley.size());
    (galley, area.expand2(vec2(6.0, 3.0) * scale))
}

fn paint_label(painter: &Painter, text: Arc<Galley>, ground: Rect, color: Color32, is_selected: bool, size: f32) {
    let scale = size / USUAL;
    painter.rect_filled(ground, 4.0 * scale, Color32::from_black_alpha(190));
    let width = if is_selected { 1.8 } else { 1.0 } * scale;
    painter.rect_stroke(ground, 4.0 * scale, Stroke::new(width, color), egui::StrokeKind::Outside);
    let corner = ground.center() - text.size() * 0.5;
    painter.galley(corner, text, Color32::WHITE);
}

#[cfg(test)]
mod tests {
    use egui::pos2;

    use super::*;
    use crate::shared::measuring::{LOADED_POINTS, Quantity};

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

    #[test]
    fn values_of_loaded_points_are_rough_and_say_what_they_are_of() {
        let figure = |name, quantity, value, deviation| Figure { name, quantity, value, deviation };
        let volume = Measurement {
            name: "vol".into(),
            kind: MeasurementKind::Volume,
            on: true,
            color: [1.0; 3],
            points: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            reach: None,
            level: None,
        };
        let metres = Units { level: Some(codec::Unit::Metre), height: Some(codec::Unit::Metre) };
        let text = |points, value, deviation| {
            let count = figure(points, Quantity::Count, 1000.0, None);
            let figures = Ok(vec![figure("volume", Quantity::Volume, value, deviation), count]);
            Mark::of_measurement(&volume, Some(&figures), &metres).text
        };
        for (value, expected) in [
            (-64464.7233, "vol  ≈ -64500 m³ of loaded points"),
            (0.0123456, "vol  ≈ 0.0123 m³ of loaded points"),
            (9.999, "vol  ≈ 10.0 m³ of loaded points"),
            (0.0, "vol  ≈ 0 m³ of loaded points"),
        ] {
            assert_eq!(text(LOADED_POINTS, value, None), expected);
        }
        assert_eq!(text("points", -68633.0, Some(44.0)), "vol  -68633 m³");
    }

    #[test]
    fn a_label_goes_up_until_it_covers_no_other_and_the_selected_one_stays() {
        let ground = Rect::from_min_size(pos2(100.0, 100.0), vec2(80.0, 20.0));
        assert_eq!(free_lift(ground, &[]), 0.0);
        assert_eq!(free_lift(ground, &[ground.translate(vec2(90.0, 0.0))]), 0.0);
        let above = ground.translate(vec2(30.0, -23.0));
        assert_eq!(free_lift(ground, &[ground, above]), 46.0);
        let tower: Vec<Rect> = (0..20).map(|floor| ground.translate(vec2(0.0, floor as f32 * -20.0))).collect();
        assert_eq!(free_lift(ground, &tower), 0.0, "there is no room");
        // In a picture of two notes at one place, the selected one is the lower one.
        let note = |text: &str, is_selected| {
            let note = Note {
                text: text.into(),
                on: true,
                color: [1.0; 3],
                position: DVec3::new(200.0, 200.0, 1.0),
                camera: None,
            };
            Mark { is_selected, ..Mark::of_note(&note) }
        };
        let marks = [note("first", false), note("second", true)];
        let context = egui::Context::default();
        let output = context.run_ui(egui::RawInput::default(), |ui| paint_all(&marks, ui.painter(), &place, 13.0));
        let height = |wanted: &str| {
            let mut texts = output.shapes.iter().filter_map(|clipped| match &clipped.shape {
                egui::Shape::Text(text) if text.galley.text() == wanted => Some(text.pos.y),
                _ => None,
            });
            texts.next_back().unwrap()
        };
        assert!(height("first") < height("second") - 10.0);
    }
}
