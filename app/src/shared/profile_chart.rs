//! Draws profiles as a chart: the points by their distance along the line and their height, in their colours.

use std::path::Path;

use cloud::{Chunk, Cloud};
use codec::{Unit, Units};
use glam::DVec3;
use render::ColorPlan;
use study::SubjectPart;
use study::chart::shapes::{self, Anchor, Shape};

use crate::shared::numbers::grouped;
use crate::shared::steps;
use crate::system::picture_file;

/// A point of a profile: where it is on the chart, in world units, and its sRGB colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dot {
    pub along: f64,
    pub height: f64,
    pub color: [u8; 3],
}

/// The points of a profile.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    pub name: String,
    pub dots: Vec<Dot>,
    /// How many points there are, of which some may have no dot.
    pub total: u64,
    /// Whether the files may have more points there, which are not loaded.
    pub is_thinned: bool,
}

/// The units along the line of a profile and of its heights.
pub type AxisUnits = [Option<Unit>; 2];

/// The units of the axes of a profile of coordinates with these units. Only where z points up, lines lie on the map.
pub fn axis_units(units: &Units, up: DVec3) -> AxisUnits {
    if up.z.abs() > 0.999 { [units.level, units.rise()] } else { [units.length(); 2] }
}

/// A unit behind the name of an axis.
pub fn in_brackets(unit: Option<Unit>) -> String {
    unit.map_or(String::new(), |unit| format!(" ({unit})"))
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
/// The height of a line of names, the least width of a name, and that of a letter.
const NAMES: [f64; 3] = [20.0, 90.0, 7.5];
/// The most names that are listed.
const MOST_NAMES: usize = 24;
const INK: [u8; 3] = [40, 40, 40];
const GRID: [u8; 3] = [225, 225, 225];

/// Writes the chart as the file's ending says: `.svg`, or else a PNG. The first profile has the colours of its points;
/// the others lie behind it, each in a colour of its own. `units` are those along the line and of heights, if they are
/// known (`axis_units`).
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, series: &[Series], units: AxisUnits) -> anyhow::Result<()> {
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg")) {
        let (drawn, size) = chart(series, units, MOST_VECTORS);
        return picture_file::write_text(path, &shapes::svg(&drawn, size)?);
    }
    let (drawn, size) = chart(series, units, MOST_PIXELS);
    picture_file::write_bytes(path, &shapes::png(&drawn, size)?)
}

/// The colour of a profile behind the first: along a ramp, in their order.
pub fn color_behind(index: usize, count: usize) -> [u8; 3] {
    let place = (index as f32 + 0.5) / count.max(1) as f32;
    let [red, green, blue, _] = render::ramp_colors(scene::Ramp::Turbo)[(place * 255.0) as usize];
    [red, green, blue]
}

/// The names of several profiles with their colours, from left to right in lines, and the height of the lines.
fn names(series: &[Series]) -> (Vec<Shape>, f64) {
    let [line, least, letter] = NAMES;
    let (left, right) = (MARGINS[0], WIDTH - MARGINS[1]);
    let (mut drawn, mut at) = (Vec::new(), (left, line * 0.5));
    let behind = series.len().saturating_sub(1);
    for (index, Series { name, .. }) in series.iter().enumerate().take(MOST_NAMES) {
        let color = index.checked_sub(1).map_or(INK, |index| color_behind(index, behind));
        let is_last = index + 1 == MOST_NAMES && series.len() > MOST_NAMES;
        let text = if is_last {
            format!("and {} more", series.len() - index)
        } else {
            param::shortened(name.lines().next().unwrap_or_default(), 40)
        };
        let width = (text.chars().count() as f64 * letter + 30.0).max(least);
        if at.0 + width > right {
            at = (left, at.1 + line);
        }
        drawn.push(Shape::Disc { center: (at.0 + 5.0, at.1), radius: 5.0, color, is_filled: index > 0 });
        let anchor = Anchor::Start;
        drawn.push(Shape::Words { at: (at.0 + 16.0, at.1), text, size: TEXT, color: INK, anchor });
        at.0 += width;
    }
    (drawn, at.1 + line * 0.5)
}

/// Lengths along and up have the same scale, unless the chart would be too low or too high; then its axis says how much
/// it is stretched.
fn chart(series: &[Series], units: AxisUnits, most: usize) -> (Vec<Shape>, [u32; 2]) {
    let all = || series.iter().flat_map(|one| &one.dots);
    let (count, total) = (all().count(), series.iter().map(|one| one.total).sum());
    let range = |of: fn(&Dot) -> f64, margin: f64| {
        let (low, high) = cloud::robust_range(all().map(of), margin).unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
        if high > low {
            (low, high)
        } else if high == low {
            (low - 0.5, high + 0.5)
        } else {
            (0.0, 1.0)
        }
    };
    let along = range(|dot| dot.along, f64::INFINITY);
    // Masts and wires of a flat country are no strays.
    let height = range(|dot| dot.height, along.1 - along.0);
    let [left, right, title, below] = MARGINS;
    let (listed, listed_height) = if series.len() > 1 { names(series) } else { (Vec::new(), 0.0) };
    let above = title + listed_height;
    let plot_width = WIDTH - left - right;
    // Of two known lengths, the axes have one scale; those of angles and heights have none in common.
    let [of_along, of_height] = units.map(|unit| unit.map(|unit| unit.metres()));
    let scale = match (of_along, of_height) {
        (Some(along), Some(height)) => along.zip(height).map(|(along, height)| height / along),
        (along, height) => [along, height].into_iter().flatten().all(|metres| metres.is_some()).then_some(1.0),
    };
    let even = (height.1 - height.0) / (along.1 - along.0) * plot_width * scale.unwrap_or(1.0);
    let plot_height = even.clamp(HEIGHTS[0], HEIGHTS[1]);
    let place = |x: f64, y: f64| {
        let across = left + (x - along.0) / (along.1 - along.0) * plot_width;
        (across, above + plot_height - (y - height.0) / (height.1 - height.0) * plot_height)
    };
    let mut drawn = Vec::new();
    let line = |points: Vec<(f64, f64)>, color| Shape::Line { points, color, width: 1 };
    let words = |at: (f64, f64), text: String, anchor| Shape::Words { at, text, size: TEXT, color: INK, anchor };
    for (value, text) in steps::ticks(along.0, along.1, 12) {
        drawn.push(line(vec![place(value, height.0), place(value, height.1)], GRID));
        let (x, y) = place(value, height.0);
        drawn.push(words((x, y + 16.0), text, Anchor::Middle));
    }
    for (value, text) in steps::ticks(height.0, height.1, ((plot_height / 40.0) as usize).clamp(2, 12)) {
        drawn.push(line(vec![place(along.0, value), place(along.1, value)], GRID));
        let (x, y) = place(along.0, value);
        drawn.push(words((x - 8.0, y), text, Anchor::End));
    }
    let step = count.div_ceil(most).max(1);
    let mut shown = 0;
    for (index, Series { dots, .. }) in series.iter().enumerate().rev() {
        let own = index.checked_sub(1).map(|index| color_behind(index, series.len() - 1));
        // Strays beyond the axes are not drawn, and the title counts without them.
        let is_on =
            |dot: &&Dot| (along.0..=along.1).contains(&dot.along) && (height.0..=height.1).contains(&dot.height);
        for dot in dots.iter().step_by(step).filter(is_on) {
            let center = place(dot.along, dot.height);
            drawn.push(Shape::Disc { center, radius: 1.0, color: own.unwrap_or(dot.color), is_filled: true });
            shown += 1;
        }
    }
    let corners =
        [(along.0, height.0), (along.1, height.0), (along.1, height.1), (along.0, height.1), (along.0, height.0)];
    drawn.push(line(corners.into_iter().map(|(x, y)| place(x, y)).collect(), INK));
    let count = if shown < total { format!("{} of {}", grouped(shown), grouped(total)) } else { grouped(total) };
    let name = match series {
        [one] => one.name.clone(),
        several => format!("{} profiles", several.len()),
    };
    let points = if series.iter().any(|one| one.is_thinned) { "loaded points" } else { "points" };
    drawn.push(words((left, title * 0.5), format!("{name}: {count} {points}"), Anchor::Start));
    // The list of names begins below the title.
    drawn.extend(listed.into_iter().map(|shape| match shape {
        Shape::Disc { center: (x, y), radius, color, is_filled } => {
            Shape::Disc { center: (x, y + title - 6.0), radius, color, is_filled }
        }
        Shape::Words { at: (x, y), text, size, color, anchor } => {
            Shape::Words { at: (x, y + title - 6.0), text, size, color, anchor }
        }
        other => other,
    }));
    let [of_along, of_height] = units.map(in_brackets);
    let stretch = plot_height / even;
    let stretched = if scale.is_some() && (stretch - 1.0).abs() > 0.005 {
        format!(", heights x {stretch:.2}")
    } else {
        String::new()
    };
    let bottom = above + plot_height + below - 16.0;
    drawn.push(words((left + plot_width * 0.5, bottom), format!("along{of_along}{stretched}"), Anchor::Middle));
    drawn.push(words((18.0, above + plot_height * 0.5), format!("height{of_height}"), Anchor::Upward));
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

    const NONE: AxisUnits = [None; 2];

    fn slope(count: usize) -> Vec<Dot> {
        let dot = |index: usize| {
            let along = index as f64 / (count - 1) as f64 * 20.0;
            Dot { along, height: 100.0 + along * 0.5, color: [200, 30, 30] }
        };
        (0..count).map(dot).collect()
    }

    fn one(name: &str, dots: Vec<Dot>, total: u64) -> Vec<Series> {
        vec![Series { name: name.into(), dots, total, is_thinned: false }]
    }

    fn discs(drawn: &[Shape]) -> Vec<(f64, f64)> {
        let disc = |shape: &Shape| if let Shape::Disc { center, .. } = shape { Some(*center) } else { None };
        drawn.iter().filter_map(disc).collect()
    }

    #[test]
    fn a_slope_is_a_slope_on_the_chart_at_one_scale_both_ways() {
        let (drawn, size) = chart(&one("slope", slope(1000), 1000), [Some(Unit::Metre); 2], MOST_PIXELS);
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
    fn axes_in_different_units_have_one_scale_where_both_are_lengths() {
        let rise = |units: AxisUnits| {
            let (drawn, size) = chart(&one("slope", slope(1000), 1000), units, MOST_PIXELS);
            let (places, text) = (discs(&drawn), shapes::svg(&drawn, size).unwrap());
            ((places[0].1 - places[999].1) / (places[999].0 - places[0].0), text)
        };
        let (slope, text) = rise([Some(Unit::Other(0.5)), Some(Unit::Metre)]);
        assert!((slope - 900.0 / (WIDTH - MARGINS[0] - MARGINS[1])).abs() < 1e-9 && text.contains("heights x 0.8"));
        let (slope, text) = rise([Some(Unit::Metre), Some(Unit::Foot)]);
        assert!((slope - 0.1524).abs() < 1e-9 && text.contains("along (m)") && !text.contains("heights x"), "{slope}");
        let (_, text) = rise([Some(Unit::Degree), Some(Unit::Metre)]);
        assert!(text.contains("along (°)") && text.contains("height (m)") && !text.contains("heights x"));
        let units = Units { level: Some(Unit::Foot), height: Some(Unit::Metre) };
        assert_eq!(axis_units(&units, DVec3::Z), [Some(Unit::Foot), Some(Unit::Metre)]);
        assert_eq!(axis_units(&units, DVec3::Y), NONE);
    }

    #[test]
    fn too_many_points_and_a_stretch_are_told() {
        let mut dots = slope(1000);
        dots.iter_mut().for_each(|dot| dot.height = 100.0 + dot.along * 0.001);
        let (drawn, size) = chart(&one("flat", dots, 4000), NONE, 300);
        assert_eq!(discs(&drawn).len(), 250);
        let text = shapes::svg(&drawn, size).unwrap();
        assert!(text.contains("flat: 250 of 4") && text.contains("along, heights x "), "{text}");
        let (nothing, _) = chart(&one("empty", Vec::new(), 0), NONE, 300);
        assert_eq!(discs(&nothing).len(), 0);
        assert!(shapes::png(&nothing, size).is_ok());
    }

    #[test]
    fn a_chart_of_the_points_that_are_loaded_says_so() {
        let mut series = one("slope", slope(100), 100);
        series[0].is_thinned = true;
        let (drawn, size) = chart(&series, NONE, 300);
        let text = shapes::svg(&drawn, size).unwrap();
        assert!(text.contains("slope: 100 loaded points"), "{text:.300}");
    }

    #[test]
    fn profiles_behind_the_first_have_colours_of_their_own_and_all_are_named() {
        let name = |index: usize| if index == 0 { "wall".to_owned() } else { format!("wall {}", index + 1) };
        let series: Vec<Series> = (0..30).map(|index| one(&name(index), slope(100), 100).remove(0)).collect();
        let (drawn, size) = chart(&series[..5], NONE, MOST_PIXELS);
        let text = shapes::svg(&drawn, size).unwrap();
        assert!(text.contains("5 profiles: 500 points") && text.contains("wall 5"), "{text:.300}");
        // The first is drawn last, over the others.
        let points: Vec<[u8; 3]> = drawn
            .iter()
            .filter_map(|shape| if let Shape::Disc { radius: 1.0, color, .. } = shape { Some(*color) } else { None })
            .collect();
        assert_eq!(points.len(), 500);
        assert!(points[400..].iter().all(|color| *color == [200, 30, 30]));
        assert!(points[..100].iter().all(|color| *color == color_behind(3, 4)));
        // Names take lines of their own, above the points.
        let lowest_name = |drawn: &[Shape]| {
            let low = drawn.iter().filter_map(|shape| match shape {
                Shape::Words { at, text, .. } if text.starts_with("wall") || text.starts_with("and") => Some(at.1),
                _ => None,
            });
            low.fold(0.0, f64::max)
        };
        let highest = |drawn: &[Shape]| discs(drawn).iter().map(|at| at.1).rev().take(100).fold(f64::MAX, f64::min);
        let (many, _) = chart(&series, NONE, MOST_PIXELS);
        assert!(lowest_name(&many) > lowest_name(&drawn));
        let text = shapes::svg(&many, size).unwrap();
        assert!(text.contains("and 7 more") && !text.contains("wall 24"), "{text:.300}");
        assert!(highest(&many) > 0.0);
    }
}
