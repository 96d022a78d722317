//! The ruler of the profile in view, and readings with their intervals.

use codec::Unit;
use egui::{Color32, Rect, Stroke, vec2};
use egui_plot::{PlotPoint, PlotTransform};
use glam::{DMat2, DVec2};
use measure::{IN_95_PERCENT, Section};

use crate::shared::language::{english, text, translated};
use crate::shared::measuring::{decimals, decimals_of_length};
use crate::shared::profile_chart::AxisUnits;
use crate::viewer::look::theme;
use crate::viewer::tools::profiles::RulerEnd;

/// Why a reading has no interval although it is known how the points around it scatter.
pub const TOO_THIN: &str = english!(", no ± in so thin a profile");

/// The distance between two places of a profile, with its parts: `5.0000 m   along 3.0000 m   up 4.0000 m`. Parts in
/// different units have no distance. Where the covariance of the difference is known, all have intervals of 95 %.
pub fn measured(from: [f64; 2], to: [f64; 2], covariance: Option<DMat2>, units: AxisUnits) -> String {
    let difference = DVec2::from(to) - DVec2::from(from);
    let interval = |direction: DVec2| {
        let variance = direction.dot(covariance? * direction);
        Some(IN_95_PERCENT * variance.sqrt())
    };
    let [of_along, of_up] = units;
    let along = length(difference.x, interval(DVec2::X), of_along);
    let up = length(difference.y, interval(DVec2::Y), of_up);
    let parts = text!("along {along}   up {up}", along, up);
    if of_along.map(|unit| unit.to_string()) == of_up.map(|unit| unit.to_string()) {
        let whole = interval(difference.normalize_or_zero());
        format!("{}   {parts}", length(difference.length(), whole, of_along))
    } else {
        parts
    }
}

/// A length with its interval, if that is known, and its unit: `1.203 ± 0.012 m`.
pub fn length(value: f64, interval: Option<f64>, unit: Option<Unit>) -> String {
    let name = unit.map_or(String::new(), |unit| format!(" {unit}"));
    let interval = interval.filter(|interval| interval.is_finite() && *interval > 0.0);
    let places = interval.map_or_else(|| decimals_of_length(unit), decimals);
    let spread = interval.map_or(String::new(), |interval| format!(" ± {interval:.places$}"));
    format!("{value:.places$}{spread}{name}")
}

/// Draws the ruler of a profile and what it measures.
pub fn ruler(
    painter: &egui::Painter,
    transform: &PlotTransform,
    ends: &[RulerEnd],
    pointer: Option<[f64; 2]>,
    section: Option<&Section>,
    units: AxisUnits,
) {
    let covariance = |end: &RulerEnd| {
        let error = end.error?;
        section?.covariance(error.place, &error.scatter)
    };
    let is_inside = |end: &RulerEnd| {
        let place = end.error.map(|error| error.place);
        section.zip(place).is_some_and(|(section, place)| section.place(place).is_some())
    };
    let (from, to, certain, are_inside) = match (ends, pointer) {
        ([from, to], _) => {
            let both = covariance(from).zip(covariance(to)).map(|(from, to)| from + to);
            (from.at, to.at, both, is_inside(from) && is_inside(to))
        }
        ([from], Some(to)) => (from.at, to, None, false),
        _ => return,
    };
    let place = |[along, height]: [f64; 2]| transform.position_from_point(&PlotPoint::new(along, height));
    let line = [place(from), place(to)];
    painter.line_segment(line, Stroke::new(4.0, Color32::BLACK));
    painter.line_segment(line, Stroke::new(1.6, theme::ACCENT));
    let why = if are_inside && certain.is_none() { translated(TOO_THIN) } else { "" };
    let text = measured(from, to, certain, units) + why;
    let middle = line[0].lerp(line[1], 0.5);
    let galley = painter.layout_no_wrap(text, egui::FontId::proportional(13.0), Color32::WHITE);
    let area = Rect::from_center_size(middle - vec2(0.0, 16.0), galley.size());
    painter.rect_filled(area.expand2(vec2(6.0, 3.0)), 4.0, Color32::from_black_alpha(190));
    painter.galley(area.min, galley, Color32::WHITE);
}
