//! Draws a profile as a chart: the points by their distance along the line and their height, in their colours.

use std::path::Path;

use cloud::{Chunk, Cloud};
use glam::DVec3;
use render::ColorPlan;
use study::SubjectPart;
use study::chart::shapes::{self, Anchor, Shape};

use crate::info::grouped;
use crate::overlays::steps;
use crate::picture_file;

/// A point of a profile: where it is on the chart, in world units, and its sRGB colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dot {
    pub along: f64,
    pub height: f64,
    pub color: [u8; 3],
}

/// The most points that a chart shows: of more, evenly many are left out, and the title says so. Each is a line of an
/// SVG file.
const MOST_VECTORS: usize = 50_000;
const MOST_PIXELS: usize = 500_000;
/// The width of the chart in pixels, and the least and the largest height of its axes.
const WIDTH: f64 = 1200.0;
const HEIGHTS: [f64; 2] = [120.0, 900.0];
/// The room for numbers and titles: left, right, above, below.
const MARGINS: [f64; 4] = [86.0, 24.0, 40.0, 58.0];
const TEXT: f64 = 14.0;
const INK: [u8; 3] = [40, 40, 40];
const GRID: [u8; 3] = [225, 225, 225];

/// Writes the chart as the file's ending says: `.svg`, or else a PNG. `total` is the number of points that there are,
/// and `unit` that of the coordinates, if it is known.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, dots: &[Dot], total: u64, name: &str, unit: Option<&str>) -> anyhow::Result<()> {
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg")) {
        let (drawn, size) = chart(dots, total, name, unit, MOST_VECTORS);
        return picture_file::write_text(path, &shapes::svg(&drawn, size)?);
    }
    let (drawn, size) = chart(dots, total, name, unit, MOST_PIXELS);
    picture_file::write_bytes(path, &shapes::png(&drawn, size)?)
}

/// Lengths along and up have the same scale, unless the chart would be too low or too high; then its axis says how much
/// it is stretched.
fn chart(dots: &[Dot], total: u64, name: &str, unit: Option<&str>, most: usize) -> (Vec<Shape>, [u32; 2]) {
    let range = |of: fn(&Dot) -> f64| {
        let (low, high) = dots
            .iter()
            .map(of)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if high > low {
            (low, high)
        } else if high == low {
            (low - 0.5, high + 0.5)
        } else {
            (0.0, 1.0)
        }
    };
    let (along, height) = (range(|dot| dot.along), range(|dot| dot.height));
    let [left, right, above, below] = MARGINS;
    let plot_width = WIDTH - left - right;
    let even = (height.1 - height.0) / (along.1 - along.0) * plot_width;
    let plot_height = even.clamp(HEIGHTS[0], HEIGHTS[1]);
    let place = |x: f64, y: f64| {
        let across = left + (x - along.0) / (along.1 - along.0) * plot_width;
        (across, above + plot_height - (y - height.0) / (height.1 - height.0) * plot_height)
    };
    let mut drawn = Vec::new();
    let line = |points: Vec<(f64, f64)>, color| Shape::Line { points, color, width: 1 };
    let words = |at: (f64, f64), text: String, anchor| Shape::Words { at, text, size: TEXT, color: INK, anchor };
    let (ticks, decimals) = steps::ticks(along.0, along.1, 12);
    for value in ticks {
        drawn.push(line(vec![place(value, height.0), place(value, height.1)], GRID));
        let (x, y) = place(value, height.0);
        drawn.push(words((x, y + 16.0), format!("{value:.decimals$}"), Anchor::Middle));
    }
    let (ticks, decimals) = steps::ticks(height.0, height.1, ((plot_height / 40.0) as usize).clamp(2, 12));
    for value in ticks {
        drawn.push(line(vec![place(along.0, value), place(along.1, value)], GRID));
        let (x, y) = place(along.0, value);
        drawn.push(words((x - 8.0, y), format!("{value:.decimals$}"), Anchor::End));
    }
    let step = dots.len().div_ceil(most).max(1);
    drawn.extend(dots.iter().step_by(step).map(|dot| {
        let center = place(dot.along, dot.height);
        Shape::Disc { center, radius: 1.0, color: dot.color, is_filled: true }
    }));
    let corners =
        [(along.0, height.0), (along.1, height.0), (along.1, height.1), (along.0, height.1), (along.0, height.0)];
    drawn.push(line(corners.into_iter().map(|(x, y)| place(x, y)).collect(), INK));
    let shown = dots.len().div_ceil(step) as u64;
    let count = if shown < total { format!("{} of {}", grouped(shown), grouped(total)) } else { grouped(total) };
    drawn.push(words((left, above * 0.5), format!("{name}: {count} points"), Anchor::Start));
    let unit = unit.map_or(String::new(), |unit| format!(" ({unit})"));
    let stretch = plot_height / even;
    let stretched = if (stretch - 1.0).abs() > 0.005 { format!(", heights x {stretch:.2}") } else { String::new() };
    let bottom = above + plot_height + below - 16.0;
    drawn.push(words((left + plot_width * 0.5, bottom), format!("along{unit}{stretched}"), Anchor::Middle));
    drawn.push(words((18.0, above + plot_height * 0.5), format!("height{unit}"), Anchor::Upward));
    (drawn, [WIDTH as u32, (above + plot_height + below) as u32])
}

/// The sRGB colours of a chunk's points, as the view has them without light.
pub fn colors_of(cloud: &Cloud, chunk: &Chunk, plan: &ColorPlan, up: DVec3) -> Vec<[u8; 3]> {
    let chunks = vec![chunk.clone()];
    let cloud = Cloud { name: String::new(), attributes: cloud.attributes.clone(), grid: cloud.grid, chunks };
    let (specular_intensity, specular_power) = (0.0, 1.0);
    let part = SubjectPart { cloud, specular_intensity, specular_power, clear: None, plan: plan.clone(), up };
    let painted = part.painted(DVec3::ZERO).into_iter().next().and_then(|chunk| chunk.colors);
    let rgb = |[red, green, blue, _]: [u8; 4]| [red, green, blue];
    match painted {
        Some(colors) => colors.iter().map(|color| rgb(*color)).collect(),
        None => vec![rgb(plan.plain); chunk.len()],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slope(count: usize) -> Vec<Dot> {
        let dot = |index: usize| {
            let along = index as f64 / (count - 1) as f64 * 20.0;
            Dot { along, height: 100.0 + along * 0.5, color: [200, 30, 30] }
        };
        (0..count).map(dot).collect()
    }

    fn discs(drawn: &[Shape]) -> Vec<(f64, f64)> {
        let disc = |shape: &Shape| if let Shape::Disc { center, .. } = shape { Some(*center) } else { None };
        drawn.iter().filter_map(disc).collect()
    }

    #[test]
    fn a_slope_is_a_slope_on_the_chart_at_one_scale_both_ways() {
        let (drawn, size) = chart(&slope(1000), 1000, "slope", Some("m"), MOST_PIXELS);
        let places = discs(&drawn);
        assert_eq!(places.len(), 1000);
        let (first, last) = (places[0], places[999]);
        assert!(((first.1 - last.1) / (last.0 - first.0) - 0.5).abs() < 1e-9, "{first:?} {last:?}");
        assert!((last.0 - (f64::from(size[0]) - MARGINS[1])).abs() < 1e-9);
        let text = shapes::svg(&drawn, size).unwrap();
        assert!(text.contains(&format!("slope: {} points", grouped(1000))), "{text:.300}");
        assert!(text.contains("along (m)") && text.contains("height (m)") && !text.contains("heights x"));
    }

    #[test]
    fn too_many_points_and_a_stretch_are_told() {
        let mut dots = slope(1000);
        dots.iter_mut().for_each(|dot| dot.height = 100.0 + dot.along * 0.001);
        let (drawn, size) = chart(&dots, 4000, "flat", None, 300);
        assert_eq!(discs(&drawn).len(), 250);
        let text = shapes::svg(&drawn, size).unwrap();
        assert!(text.contains("flat: 250 of 4") && text.contains("along, heights x "), "{text}");
        let (nothing, _) = chart(&[], 0, "empty", None, 300);
        assert_eq!(discs(&nothing).len(), 0);
        assert!(shapes::png(&nothing, size).is_ok());
    }
}
