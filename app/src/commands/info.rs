//! `glint info`: reports what files hold, for people or as JSON. An input that cannot be read gets an error in its
//! place.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use cloud::{Attribute, Bounds, Chunk, ColorCount, Column, Progress};
use codec::{Format, Unit, Units};
use scene::shown;
use serde::Serialize;
use world::Input;

use crate::shared::command_line::InfoArguments;
use crate::shared::numbers::{coordinate, grouped, two_digits};
use crate::system::failure::UNUSABLE;
use crate::system::terminal::Few;
use crate::system::{interrupt, progress_bar, terminal};

/// Files up to this size, in bytes, are read whole, so that the figures come from the points and not from a header. LAZ
/// of this size takes about two seconds on two cores.
const READ_WITHOUT_ASKING: u64 = 64 << 20;

/// The neighbours of more points are not looked at: their places would take more than 200 MB.
const MOST_LOOKED_AT: u64 = 16_000_000;

#[derive(Serialize)]
struct Report {
    inputs: Vec<Entry>,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Entry {
    Read(Box<FileReport>),
    Unreadable { path: String, error: String },
}

/// The report on one input. The JSON has its fields in this order and under these names.
#[derive(Serialize)]
struct FileReport {
    path: String,
    format: &'static str,
    version: String,
    point_format: Option<u8>,
    points: u64,
    bounds: Option<BoundsReport>,
    attributes: Vec<AttributeReport>,
    crs: Option<String>,
    units: UnitsReport,
    /// The number of points that have no colour although the cloud has colours, if all were read.
    #[serde(skip_serializing_if = "Option::is_none")]
    without_colour: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    neighbourhoods: Option<NeighbourhoodReport>,
    warnings: Vec<String>,
    #[serde(skip)]
    known_units: Units,
    /// How many decimals coordinates are printed with for people, if they lie on a grid.
    #[serde(skip)]
    decimals: Option<usize>,
}

/// The units of coordinates as they are written, such as `m` and `ftUS`, where the file tells them.
#[derive(Debug, PartialEq, Serialize)]
struct UnitsReport {
    level: Option<String>,
    /// The unit of the heights, if the file names one.
    height: Option<String>,
}

#[derive(Serialize)]
pub struct BoundsReport {
    min: [f64; 3],
    max: [f64; 3],
}

/// What the neighbours of some points tell.
#[derive(Serialize)]
struct NeighbourhoodReport {
    /// The number of points that were looked at.
    points: u64,
    /// The shares of those that are lone strays, and mixed pixels.
    strays: f64,
    mixed: f64,
    /// The standard deviation of points from the surface through their neighbours, in the file's unit.
    noise: Option<f64>,
}

#[derive(Serialize)]
pub struct AttributeReport {
    name: String,
    #[serde(rename = "type")]
    type_name: &'static str,
    /// The value that all points have, if all were read and it is the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    constant: Option<f64>,
    /// The smallest and the largest value, if all points were read.
    #[serde(skip_serializing_if = "Option::is_none")]
    min: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max: Option<f64>,
    /// The number of points without a value, if all were read and there are some.
    #[serde(skip_serializing_if = "Option::is_none")]
    without_value: Option<u64>,
}

/// Reports all inputs. Returns exit status 2 if one of them cannot be read, and says so on standard error, too.
///
/// # Errors
/// If the report cannot be written, or on Ctrl-C.
pub fn run(arguments: &InfoArguments) -> anyhow::Result<u8> {
    let mut inputs = Vec::new();
    for word in &arguments.inputs {
        let request = world::resolve(std::slice::from_ref(word));
        terminal::warn(&request.warnings);
        if request.inputs.is_empty() {
            let path = shown(word);
            inputs.push(Entry::Unreadable { error: format!("{path}: no clouds in it"), path });
        }
        for input in &request.inputs {
            inputs.extend(entries(input, arguments.scan));
            interrupt::check()?;
        }
    }
    let report = Report { inputs };
    let mut unreadable = Few::of("that cannot be read");
    if arguments.json {
        terminal::print_json(&report)?;
    }
    let mut separator = None;
    for entry in &report.inputs {
        match entry {
            Entry::Read(_) if arguments.json => {}
            Entry::Read(file) => terminal::print(separator.replace(String::new()).into_iter().chain(lines(file)))?,
            Entry::Unreadable { error, .. } => unreadable.complain(error),
        }
    }
    let is_complete = unreadable.count() == 0;
    unreadable.end();
    Ok(if is_complete { 0 } else { UNUSABLE })
}

/// Returns an entry for each file of the input, or one with an error if the input is no file.
fn entries(input: &Input, scan: bool) -> Vec<Entry> {
    let error = match input {
        Input::File(_) | Input::Tiles { .. } => {
            return input.files().iter().map(|path| file_entry(path, scan)).collect();
        }
        Input::BuiltIn { .. } => {
            format!("{}: a built-in scene, not a file; `glint scenes` lists them", input.name())
        }
        Input::Unknown { error, .. } => error.clone(),
    };
    vec![Entry::Unreadable { path: input.name(), error }]
}

fn file_entry(path: &Path, scan: bool) -> Entry {
    match file_report(path, scan) {
        Ok(report) => Entry::Read(Box::new(report)),
        Err(error) => Entry::Unreadable { path: shown(path), error: error.to_string() },
    }
}

fn file_report(path: &Path, scan: bool) -> codec::Result<FileReport> {
    let source = codec::open(path)?;
    let info = source.info();
    let mut report = FileReport {
        path: shown(path),
        format: format_name(info.format),
        version: info.version.clone(),
        point_format: info.point_format,
        points: info.points,
        bounds: info.bounds.and_then(bounds_report),
        attributes: attributes_report(&info.properties),
        crs: info.crs.clone(),
        units: units(&info.units),
        known_units: info.units,
        without_colour: None,
        neighbourhoods: None,
        warnings: info.warnings.iter().cloned().chain(info.units.warning()).collect(),
        decimals: info.grid.map(|grid| decimals(grid.scale.min_element())),
    };
    let small = std::fs::metadata(path).is_ok_and(|metadata| metadata.len() <= READ_WITHOUT_ASKING);
    if scan || small {
        // The bounds tell of coordinates.
        let is_place = |name: &str| ["x", "y", "z"].iter().any(|axis| name.eq_ignore_ascii_case(axis));
        let attributes = info.attributes.iter().map(|attribute| !is_place(&attribute.name)).collect();
        let selection = codec::Selection { positions: true, colors: true, attributes, ..Default::default() };
        let progress = Progress::default();
        let ranges = Mutex::new(vec![Range::NONE; info.attributes.len()]);
        let (colors, places) = (Mutex::new(ColorCount::default()), Mutex::new(Vec::new()));
        let look = |chunk: Chunk| {
            if let Some(own) = &chunk.colors {
                colors.lock().unwrap_or_else(PoisonError::into_inner).add(own);
            }
            if info.points <= MOST_LOOKED_AT {
                let bare = Chunk::new(chunk.first_point, chunk.origin, Vec::new());
                let place = Chunk { positions: chunk.positions.clone(), ..bare };
                places.lock().unwrap_or_else(PoisonError::into_inner).push(place);
            }
            for (index, column) in chunk.columns.iter().enumerate() {
                let Some(range) = column.as_ref().map(|column| Range::of(column)) else { continue };
                if let Some(known) = ranges.lock().unwrap_or_else(PoisonError::into_inner).get_mut(index) {
                    *known = known.with(range);
                }
            }
        };
        let read = progress_bar::watch("reading", &progress, || source.read(&selection, &progress, &look));
        let summary = read?;
        let ranges = ranges.into_inner().unwrap_or_else(PoisonError::into_inner);
        for (attribute, range) in info.attributes.iter().zip(ranges).filter(|_| summary.points > 1) {
            let reported = report.attributes.iter_mut().find(|reported| reported.name == attribute.name);
            if let Some(reported) = reported {
                range.report(reported);
            }
        }
        let colors = colors.into_inner().unwrap_or_else(PoisonError::into_inner);
        report.without_colour = info.has_colors.then(|| colors.blanks());
        let mut places = places.into_inner().unwrap_or_else(PoisonError::into_inner);
        places.sort_by_key(|chunk| chunk.first_point);
        report.neighbourhoods = neighbourhoods(&places);
        report.points = summary.points;
        report.bounds = summary.bounds.and_then(bounds_report);
        for warning in summary.warnings {
            if !report.warnings.contains(&warning) {
                report.warnings.push(warning);
            }
        }
    } else if report.bounds.is_none() {
        report.warnings.push("the header gives no believable bounds; --scan reads all points to find them".into());
    }
    Ok(report)
}

/// What the neighbours of points tell. `None` where there are too few.
fn neighbourhoods(chunks: &[Chunk]) -> Option<NeighbourhoodReport> {
    let progress = Progress::default();
    let found = progress_bar::watch("neighbours", &progress, || cloud::neighbourhoods(chunks, &progress))?;
    let [strays, mixed] = [found.strays, found.mixed].map(|count| count as f64 / found.points as f64);
    (found.points > 0).then_some(NeighbourhoodReport { points: found.points, strays, mixed, noise: found.noise })
}

/// The smallest and the largest value, of which the first is larger if there is none, and the number of points without
/// a value.
#[derive(Clone, Copy)]
struct Range {
    low: f64,
    high: f64,
    without: u64,
}

impl Range {
    const NONE: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY, without: 0 };

    fn of(column: &Column) -> Self {
        let add = |range: Self, value: f64| match value.is_nan() {
            true => Self { without: range.without + 1, ..range },
            false => Self { low: range.low.min(value), high: range.high.max(value), ..range },
        };
        (0..column.len()).map(|index| column.value(index)).fold(Self::NONE, add)
    }

    fn with(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high), without: self.without + other.without }
    }

    fn report(self, report: &mut AttributeReport) {
        let is_any = self.low <= self.high;
        report.constant = (self.low == self.high && self.without == 0).then_some(self.low);
        report.min = is_any.then_some(self.low);
        report.max = is_any.then_some(self.high);
        report.without_value = (self.without > 0).then_some(self.without);
    }
}

fn format_name(format: Format) -> &'static str {
    match format {
        Format::Las => "las",
        Format::Laz => "laz",
        Format::Ply => "ply",
    }
}

pub fn attributes_report(attributes: &[Attribute]) -> Vec<AttributeReport> {
    let report = |attribute: &Attribute| AttributeReport {
        name: attribute.name.clone(),
        type_name: attribute.column_type.name(),
        constant: None,
        min: None,
        max: None,
        without_value: None,
    };
    attributes.iter().map(report).collect()
}

pub fn bounds_report(bounds: Bounds) -> Option<BoundsReport> {
    (!bounds.is_empty()).then(|| BoundsReport { min: bounds.min.to_array(), max: bounds.max.to_array() })
}

fn units(units: &Units) -> UnitsReport {
    let written = |unit: Option<Unit>| unit.map(|unit| unit.to_string());
    UnitsReport { level: written(units.level), height: written(units.height) }
}

/// How many decimals a multiple of `scale` needs: 2 for 0.01 and for 0.05.
fn decimals(scale: f64) -> usize {
    let is_whole = |scaled: f64| scaled.round() >= 1.0 && (scaled - scaled.round()).abs() < 1e-6;
    (0..=12).find(|&digits| is_whole(scale * 10_f64.powi(digits))).unwrap_or(12) as usize
}

/// The report for people, one line for each fact.
fn lines(report: &FileReport) -> Vec<String> {
    let mut lines = vec![report.path.clone()];
    let mut line = |name: &str, value: &str| lines.push(format!("  {name:<11} {value}"));
    let point_format = report.point_format.map_or(String::new(), |number| format!(", point format {number}"));
    line("format", &format!("{} {}{point_format}", report.format.to_uppercase(), report.version));
    line("points", &grouped(report.points));
    match &report.bounds {
        Some(bounds) => {
            let size: [f64; 3] = std::array::from_fn(|axis| bounds.max[axis] - bounds.min[axis]);
            let size = size.map(|length| coordinate(length, report.decimals.unwrap_or(6)));
            line("extent", &size.join(" x "));
            let corner = |corner: [f64; 3]| {
                let digits = corner.map(|value| match report.decimals {
                    Some(decimals) => coordinate(value, decimals),
                    None => value.to_string(),
                });
                digits.join("  ")
            };
            line("from", &corner(bounds.min));
            line("to", &corner(bounds.max));
        }
        None => line("extent", "unknown"),
    }
    let attributes: Vec<String> = report
        .attributes
        .iter()
        .map(|attribute| {
            let always = attribute.constant.map_or(String::new(), |value| format!(" ({value} everywhere)"));
            let without = attribute
                .without_value
                .map_or(String::new(), |count| format!(" ({} points without a value)", grouped(count)));
            format!("{} {}{always}{without}", attribute.name, attribute.type_name)
        })
        .collect();
    for (index, some) in wrapped(&attributes, 90).iter().enumerate() {
        line(if index == 0 { "attributes" } else { "" }, some);
    }
    let crs = report.crs.as_deref().and_then(|crs| crs.lines().find(|line| !line.trim().is_empty()));
    line("crs", &crs.map_or("none".into(), |crs| shortened(crs.trim(), 100)));
    line("units", &report.known_units.text());
    if let Some(blank) = report.without_colour.filter(|blank| *blank > 0) {
        line("no colour", &format!("{} points", grouped(blank)));
    }
    if let Some(NeighbourhoodReport { strays, mixed, noise, .. }) = &report.neighbourhoods {
        line("strays", &format!("{}% of the points", two_digits(100.0 * strays)));
        line("mixed", &format!("{}% of the points, between two surfaces", two_digits(100.0 * mixed)));
        let unit = report.known_units.length().map_or(String::new(), |unit| format!(" {unit}"));
        line("noise", &noise.map_or("unknown: no surface".into(), |noise| format!("{}{unit}", two_digits(noise))));
    }
    for warning in param::few(report.warnings.clone(), "warnings") {
        line("warning", &warning);
    }
    lines
}

/// Joins words by commas and breaks them into lines of about `width` characters.
fn wrapped(words: &[String], width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in words {
        match lines.last_mut() {
            Some(line) if line.len() + word.len() + 2 <= width => {
                line.push_str(", ");
                line.push_str(word);
                continue;
            }
            Some(line) => line.push(','),
            None => {}
        }
        lines.push(word.clone());
    }
    lines
}

fn shortened(text: &str, limit: usize) -> String {
    if text.chars().count() <= limit {
        return text.to_owned();
    }
    text.chars().take(limit - 3).collect::<String>() + "..."
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(["0", "999", "1,000", "3,234,126"].map(str::to_owned), [0, 999, 1000, 3_234_126].map(grouped));
        assert_eq!(coordinate(413_219.240_000_000_05, 2), "413219.24");
        assert_eq!(coordinate(-5.0, 3), "-5");
        assert_eq!(coordinate(1200.0, 0), "1200");
        assert_eq!([0.001_63, 12.3, 0.2, 0.0, 1234.0].map(two_digits), ["0.0016", "12", "0.2", "0", "1234"]);
        assert_eq!([0.01, 0.001, 1.0, 0.25, 1e-7].map(decimals), [2, 3, 0, 2, 7]);
    }

    #[test]
    fn long_lists_break_between_words() {
        let words: Vec<String> = (0..5).map(|index| format!("word{index} u8")).collect();
        assert_eq!(wrapped(&words, 20), ["word0 u8, word1 u8,", "word2 u8, word3 u8,", "word4 u8"]);
    }
}
