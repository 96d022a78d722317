//! `glint info`: reports what files hold, for people or as JSON. An input that cannot be read gets an error in its
//! place.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use cloud::{Attribute, Bounds, Chunk, ColorCount, Column, Progress};
use codec::{Info, Source, Unit, Units};
use scene::shown;
use serde::Serialize;
use world::Input;

use crate::shared::command_line::InfoArguments;
use crate::shared::export;
use crate::shared::numbers::{coordinate, grouped, two_digits};
use crate::system::failure::UNUSABLE;
use crate::system::terminal::Few;
use crate::system::{interrupt, progress_bar, terminal};

/// Files up to this size, in bytes, are read whole, so that the figures come from the points and not from a header. LAZ
/// of this size takes about two seconds on two cores.
const READ_WITHOUT_ASKING: u64 = 64 << 20;

/// The neighbours of more points are not looked at: their places would take more than 200 MB.
const MOST_LOOKED_AT: u64 = 16_000_000;

/// The most parts of a cloud in which strays are counted, of some 50 thousand points each: all of 3 million points.
const MOST_PARTS: usize = 64;

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
    /// The scans of a file, in formats that have several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    scans: Vec<ScanReport>,
    /// The pictures that the file holds beside its points.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    images: Vec<ImageReport>,
    warnings: Vec<String>,
    /// Tiles that cannot be opened, and the number of points of tiles that cannot be read.
    #[serde(skip)]
    lost: Vec<String>,
    #[serde(skip)]
    missing: u64,
    #[serde(skip)]
    known_units: Units,
    /// How many decimals coordinates are printed with for people, if they lie on a grid.
    #[serde(skip)]
    decimals: Option<usize>,
}

#[derive(Serialize)]
struct ScanReport {
    name: String,
    points: u64,
    /// Where the scanner stood, if the file says so.
    position: Option<[f64; 3]>,
}

#[derive(Serialize)]
struct ImageReport {
    name: String,
    projection: &'static str,
    /// Width and height in pixels.
    size: [u32; 2],
    bytes: u64,
    /// Where the camera stood, if the file says so.
    position: Option<[f64; 3]>,
}

/// The units of coordinates by their short names, such as `m`, `ftUS` and `deg`, where the file names them.
#[derive(Debug, PartialEq, Serialize)]
struct UnitsReport {
    horizontal: Option<String>,
    /// The unit of the heights, if the file names one.
    vertical: Option<String>,
}

#[derive(Serialize)]
pub struct BoundsReport {
    min: [f64; 3],
    max: [f64; 3],
}

/// What the neighbours of some points show.
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
    /// The least and the greatest value that the sensor gives, if the file gives them.
    #[serde(skip_serializing_if = "Option::is_none")]
    limits: Option<[f64; 2]>,
    /// How many attributes of this name follow it.
    #[serde(skip)]
    followers: usize,
}

/// Reports all inputs. Returns exit status 2 if one of them, or a tile of one, cannot be read, and says so on standard error, too.
///
/// # Errors
/// If the report cannot be written, or on Ctrl-C.
pub fn run(arguments: &InfoArguments) -> anyhow::Result<u8> {
    let mut inputs = Vec::new();
    for word in &arguments.inputs {
        let request = world::resolve(std::slice::from_ref(word));
        terminal::warn(&request.warnings);
        terminal::warn(request.settings_without_cloud(DECODER_MEMORY));
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
    let (mut separator, mut missing) = (None, 0);
    for entry in &report.inputs {
        match entry {
            Entry::Read(file) => {
                if !arguments.json {
                    terminal::print(separator.replace(String::new()).into_iter().chain(lines(file)))?;
                }
                file.lost.iter().for_each(|lost| unreadable.complain(lost));
                missing += file.missing;
            }
            Entry::Unreadable { error, .. } => unreadable.complain(error),
        }
    }
    let status = if unreadable.count() == 0 { 0 } else { UNUSABLE };
    unreadable.end();
    Ok(export::say_missing(missing, status))
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

/// The memory in bytes that the decoders of a file may take.
const DECODER_MEMORY: u64 = 1 << 30;

fn file_report(path: &Path, scan: bool) -> codec::Result<FileReport> {
    let sources = codec::open_scans(path, DECODER_MEMORY)?;
    let mut report = header_report(path, &sources);
    // Of a cloud on a server that is read node by node, only what is asked for is fetched.
    let is_far = |source: &Source| source.bytes().is_remote() && source.copc().is_some();
    let mut paths = std::collections::BTreeSet::new();
    let files = sources.iter().filter(|source| paths.insert(&source.info().path));
    let stored: u64 = files.map(Source::stored_bytes).sum();
    let small = stored <= READ_WITHOUT_ASKING && !sources.iter().any(is_far);
    if !(scan || small) {
        if report.bounds.is_none() {
            report.warnings.push("the header gives no believable bounds; --scan reads all points to find them".into());
        }
        return Ok(report);
    }
    let mut found = Found::default();
    let total: u64 = sources.iter().map(|source| source.info().points).sum();
    let (mut points, mut bounds) = (0, Bounds::EMPTY);
    for (number, source) in sources.iter().enumerate() {
        let summary = found.read(source, total)?;
        points += summary.points;
        // A file that ends early has what its report says; a tile that cannot be read is a file of its own, and a server that
        // fails has more than it sends.
        if source.info().format == codec::Format::Ept || source.bytes().has_failed() {
            report.missing += summary.missing;
        }
        bounds = bounds.union(summary.bounds.unwrap_or(Bounds::EMPTY));
        if let Some(own) = report.scans.get_mut(number) {
            own.points = summary.points;
        }
        for warning in summary.warnings {
            let warning = told(source.info(), warning);
            if !report.warnings.contains(&warning) {
                report.warnings.push(warning);
            }
        }
    }
    for reported in report.attributes.iter_mut().filter(|_| points > 0) {
        if let Some(range) = found.ranges.get(&(reported.name.clone(), reported.followers)) {
            range.report(reported);
        }
    }
    report.without_colour = sources.iter().any(|source| source.info().has_colors).then(|| found.colors.blanks());
    report.neighbourhoods = neighbourhoods(&found.places);
    report.points = points;
    report.bounds = bounds_report(bounds);
    Ok(report)
}

/// What the heads of a file's scans say.
fn header_report(path: &Path, sources: &[Source]) -> FileReport {
    let infos = || sources.iter().map(Source::info);
    let first = infos().next();
    let mut attributes: Vec<AttributeReport> = Vec::new();
    for info in infos() {
        for mut own in attributes_report(&info.properties) {
            own.limits = info.limits.iter().find(|(name, _)| *name == own.name).map(|(_, limits)| *limits);
            if !attributes.iter().any(|known| known.name == own.name && known.followers == own.followers) {
                attributes.push(own);
            }
        }
    }
    let bounds: Option<Bounds> =
        infos().map(|info| info.bounds).try_fold(Bounds::EMPTY, |all, own| Some(all.union(own?)));
    let units_of = first.map(|info| info.units).unwrap_or_default();
    let has_tiles = sources.iter().any(|source| source.info().path != path);
    let of_files = infos().flat_map(|info| {
        let of_tile = if has_tiles { format!("{}: ", info.name()) } else { String::new() };
        info.warnings.iter().map(move |warning| format!("{of_tile}{}", told(info, warning.clone())))
    });
    let scan = |info: &Info| {
        let scan = info.scan.as_ref()?;
        let position = scan.position.map(|place| place.to_array());
        Some(ScanReport { name: scan.name.clone(), points: info.points, position })
    };
    let image = |image: &codec::Image| {
        let codec::Image { name, projection, size, bytes, position } = image.clone();
        ImageReport { name, projection, size, bytes, position: position.map(|place| place.to_array()) }
    };
    FileReport {
        path: shown(path),
        format: first.map_or("", |info| info.format.name()),
        version: first.map(|info| info.version.clone()).unwrap_or_default(),
        point_format: first.and_then(|info| info.point_format),
        points: infos().map(|info| info.points).sum(),
        bounds: bounds.and_then(bounds_report),
        attributes,
        crs: first.and_then(|info| info.crs.clone()),
        units: units(&units_of),
        known_units: units_of,
        without_colour: None,
        neighbourhoods: None,
        scans: infos().filter_map(scan).collect(),
        images: infos().flat_map(|info| info.images.iter().map(image)).collect(),
        lost: infos().flat_map(|info| info.lost.iter().cloned()).collect(),
        missing: infos().filter(|info| info.format == codec::Format::Ept).map(|info| info.missing).sum(),
        warnings: of_files.chain(units_of.warning()).chain(world::other_systems(infos())).collect(),
        decimals: first.and_then(|info| info.grid).map(|grid| decimals(grid.scale.min_element())),
    }
}

/// A warning about a scan, with the scan's name where the file has several.
fn told(info: &Info, warning: String) -> String {
    match &info.scan {
        Some(scan) if scan.of > 1 => format!("{}: {warning}", scan.name),
        _ => warning,
    }
}

/// What is known of the points of a file.
#[derive(Default)]
struct Found {
    /// By the name of an attribute, and how many of this name follow it.
    ranges: BTreeMap<(String, usize), Range>,
    colors: ColorCount,
    places: Vec<Chunk>,
}

impl Found {
    /// Reads a scan of a file of `total` points.
    fn read(&mut self, source: &Source, total: u64) -> codec::Result<codec::Summary> {
        let info = source.info();
        // The bounds show the range of the coordinates.
        let is_place = |name: &str| ["x", "y", "z"].iter().any(|axis| name.eq_ignore_ascii_case(axis));
        let attributes = info.attributes.iter().map(|attribute| !is_place(&attribute.name)).collect();
        let keys: Vec<(String, usize)> =
            info.attributes.iter().map(|own| own.name.clone()).zip(followers(&info.attributes)).collect();
        let selection = codec::Selection { positions: true, colors: true, attributes, ..Default::default() };
        let progress = Progress::default();
        let mut places = Vec::new();
        let found = Mutex::new((&mut *self, &mut places));
        let look = |chunk: Chunk| {
            let ranges: Vec<Option<Range>> =
                chunk.columns.iter().map(|column| column.as_deref().map(Range::of)).collect();
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(own) = &chunk.colors {
                found.0.colors.add(own);
            }
            if total <= MOST_LOOKED_AT {
                let bare = Chunk::new(chunk.first_point, chunk.origin, Vec::new());
                found.1.push(Chunk { positions: chunk.positions.clone(), ..bare });
            }
            for (key, range) in keys.iter().zip(ranges) {
                let Some(range) = range else { continue };
                let known = found.0.ranges.entry(key.clone()).or_insert(Range::NONE);
                *known = known.with(range);
            }
        };
        let summary = progress_bar::watch("reading", &progress, || source.read(&selection, &progress, &look))?;
        places.sort_by_key(|chunk| chunk.first_point);
        self.places.append(&mut places);
        Ok(summary)
    }
}

/// What the neighbours of points show. `None` where there are too few.
fn neighbourhoods(chunks: &[Chunk]) -> Option<NeighbourhoodReport> {
    let progress = Progress::default();
    let found = progress_bar::watch("neighbours", &progress, || cloud::neighbourhoods(chunks, MOST_PARTS, &progress))?;
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

pub fn attributes_report(attributes: &[Attribute]) -> Vec<AttributeReport> {
    let report = |(attribute, followers): (&Attribute, usize)| AttributeReport {
        name: attribute.name.clone(),
        type_name: attribute.column_type.name(),
        constant: None,
        min: None,
        max: None,
        without_value: None,
        limits: None,
        followers,
    };
    attributes.iter().zip(followers(attributes)).map(report).collect()
}

/// For each attribute, how many of its name follow it. Places and colours, which some lists of attributes lack, are the
/// first ones of their names.
fn followers(attributes: &[Attribute]) -> Vec<usize> {
    let mut seen: HashMap<&str, usize> = HashMap::new();
    let mut all = vec![0; attributes.len()];
    for (count, attribute) in all.iter_mut().zip(attributes).rev() {
        let seen = seen.entry(&attribute.name).or_default();
        *count = *seen;
        *seen += 1;
    }
    all
}

pub fn bounds_report(bounds: Bounds) -> Option<BoundsReport> {
    (!bounds.is_empty()).then(|| BoundsReport { min: bounds.min.to_array(), max: bounds.max.to_array() })
}

fn units(units: &Units) -> UnitsReport {
    let written = |unit: Option<Unit>| unit.map(Unit::short_name);
    UnitsReport { horizontal: written(units.level), vertical: written(units.height) }
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
    line("format", format!("{} {}{point_format}", report.format.to_uppercase(), report.version).trim_end());
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
    // Of one point, each value is that of all.
    let is_told = report.points > 1;
    let attributes: Vec<String> = report
        .attributes
        .iter()
        .map(|attribute| {
            let constant = attribute.constant.filter(|_| is_told);
            let always = constant.map_or(String::new(), |value| format!(" ({value} everywhere)"));
            let without = attribute
                .without_value
                .filter(|_| is_told)
                .map_or(String::new(), |count| format!(" ({} points without a value)", grouped(count)));
            let limits = attribute.limits.map_or(String::new(), |[low, high]| format!(" (of {low} to {high})"));
            format!("{} {}{limits}{always}{without}", attribute.name, attribute.type_name)
        })
        .collect();
    for (index, some) in wrapped(&attributes, 90).iter().enumerate() {
        line(if index == 0 { "attributes" } else { "" }, some);
    }
    let place = |place: Option<[f64; 3]>| match place {
        Some(place) => format!(", at {}", place.map(|value| coordinate(value, 3)).join("  ")),
        None => String::new(),
    };
    let scans = report
        .scans
        .iter()
        .map(|scan| format!("{}, {} points{}", scan.name, grouped(scan.points), place(scan.position)));
    for (index, scan) in param::few(scans.collect(), "scans").iter().enumerate() {
        line(if index == 0 { "scans" } else { "" }, scan);
    }
    let images = report.images.iter().map(|image| {
        let ImageReport { name, projection, size: [width, height], bytes, position } = image;
        format!("{name}, {projection}, {width} x {height} pixels, {bytes} bytes{}", place(*position))
    });
    for (index, image) in param::few(images.collect(), "pictures").iter().enumerate() {
        line(if index == 0 { "pictures" } else { "" }, image);
    }
    let crs = report.crs.as_deref().and_then(|crs| crs.lines().find(|line| !line.trim().is_empty()));
    line("crs", &crs.map_or("none".into(), |crs| shortened(crs.trim(), 100)));
    line("units", &report.known_units.text());
    if let Some(blank) = report.without_colour.filter(|blank| *blank > 0) {
        line("no colour", &format!("{} points", grouped(blank)));
    }
    if let Some(NeighbourhoodReport { points, strays, mixed, noise }) = &report.neighbourhoods {
        let of = format!("of {} points that were looked at", grouped(*points));
        line("strays", &format!("{}% {of}", two_digits(100.0 * strays)));
        line("mixed", &format!("{}% of them, between two surfaces", two_digits(100.0 * mixed)));
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
    fn the_values_of_a_single_point_are_ranges_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.ply");
        let axes = ["x", "y", "z", "heat"].map(|name| format!("property float {name}\n")).concat();
        std::fs::write(&path, format!("ply\nformat ascii 1.0\nelement vertex 1\n{axes}end_header\n1 2 3 4.5\n"))
            .unwrap();
        let report = file_report(&path, false).unwrap();
        let heat = report.attributes.iter().find(|attribute| attribute.name == "heat").unwrap();
        assert_eq!([heat.min, heat.max, heat.constant], [Some(4.5); 3]);
        assert!(!lines(&report).concat().contains("everywhere"));
    }

    #[test]
    fn long_lists_break_between_words() {
        let words: Vec<String> = (0..5).map(|index| format!("word{index} u8")).collect();
        assert_eq!(wrapped(&words, 20), ["word0 u8, word1 u8,", "word2 u8, word3 u8,", "word4 u8"]);
    }
}
