//! Converts point records of any format and grid to those of the file that is written: on its grid, in the same format
//! or in one of the formats 6 to 8.

use std::io;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use cloud::{Bounds, Grid, Placement};
use glam::DVec3;
use laz::LazItem;
use laz::laszip::LazItemRecordBuilder;
use param::shown;

use super::columns::ColorDepth;
use super::layout::{Layout, bytes};
use super::{LasSource, items};
use crate::error::{Error, Result};
use crate::export::grid;
use crate::export::standard::ANGLE_STEPS;
use crate::export::words::Words;
use crate::info::Info;

/// The size in bytes of a record of formats 6 to 8 before its colours.
const BASE_LENGTH: usize = 30;
/// The header's bit that says that GPS time is standard time.
const STANDARD_TIME: u16 = 1;
/// The angles of formats 0 to 5 that are multiples of a step of later ones, in degrees.
const WHOLE_ANGLES: i8 = 3;
/// The class that means "overlap" in formats 0 to 5; later ones have a flag for it.
const OVERLAP_CLASS: u8 = 12;

/// The format of points in the file to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Target {
    pub format: u8,
    /// The number of bytes of extra dimensions.
    pub extra: usize,
}

impl Target {
    /// The format of 6 to 8 that holds everything that points of these formats have, except wave packets.
    pub fn new(formats: impl Iterator<Item = u8> + Clone, extra: usize) -> Self {
        let any = |of: fn(u8) -> Option<usize>| formats.clone().any(|format| of(format).is_some());
        let format = match (any(Layout::red_of), any(Layout::near_infrared)) {
            (_, true) => 8,
            (true, false) => 7,
            (false, false) => 6,
        };
        Self { format, extra }
    }

    pub fn record_length(&self) -> usize {
        Layout::base_length(self.format).unwrap_or(BASE_LENGTH) + self.extra
    }
}

/// Converts records of one file to the target.
pub struct Upgrade {
    target: Target,
    target_grid: Grid,
    grid: Grid,
    placement: Option<Placement>,
    same_grid: bool,
    same_format: bool,
    extended: bool,
    base_length: usize,
    gps_time: Option<usize>,
    red: Option<usize>,
    near_infrared: Option<usize>,
    /// The range of its colours, which become colours of 16 bits.
    depth: ColorDepth,
    /// Whether an angle of its records is between the steps of the target.
    has_rounded_angles: AtomicBool,
    /// The size in bytes of a record of the file.
    pub record_length: usize,
}

impl Upgrade {
    /// Colours of `depth` become colours of 16 bits; `ColorDepth::Sixteen` leaves them as they are.
    pub fn new(source: &LasSource, target: Target, target_grid: Grid, depth: ColorDepth) -> Self {
        let format = source.info.point_format.unwrap_or(0);
        let layout = &source.layout;
        Self {
            target,
            target_grid,
            grid: source.grid,
            placement: source.info.placement,
            same_grid: source.grid == target_grid && source.info.placement.is_none(),
            same_format: format == target.format,
            extended: format >= 6,
            base_length: Layout::base_length(format).unwrap_or(layout.record_length),
            gps_time: Layout::gps_time(format),
            red: layout.red,
            near_infrared: Layout::near_infrared(format),
            depth,
            has_rounded_angles: AtomicBool::new(false),
            record_length: layout.record_length,
        }
    }

    /// Whether the target's grid represents the coordinates exactly, or as well as any grid does: where points are moved,
    /// nobody expects them on one.
    pub fn is_exact(&self) -> bool {
        if self.placement.is_some() {
            return true;
        }
        let shift = (self.grid.offset - self.target_grid.offset) / self.target_grid.scale;
        let ratio = self.grid.scale / self.target_grid.scale;
        let whole = |value: DVec3| (value - value.round()).abs().max_element() < 1e-6;
        whole(shift) && whole(ratio)
    }

    /// Appends a record; returns `false` if its coordinates are too far away for the target's grid.
    pub fn push(&self, record: &[u8], out: &mut Vec<u8>) -> bool {
        let start = out.len();
        if self.same_grid {
            out.extend_from_slice(&record[..12]);
        } else {
            let raw = DVec3::from([0, 4, 8].map(|at| f64::from(i32::from_le_bytes(bytes(record, at)))));
            let own = raw * self.grid.scale + self.grid.offset;
            let world = self.placement.map_or(own, |placement| placement.point(own));
            let integers = ((world - self.target_grid.offset) / self.target_grid.scale).round().to_array();
            if integers.iter().any(|integer| integer.abs() > f64::from(i32::MAX)) {
                return false;
            }
            integers.iter().for_each(|integer| out.extend((*integer as i32).to_le_bytes()));
        }
        if self.same_format {
            out.extend_from_slice(&record[12..]);
            self.scale_colors(&mut out[start..]);
            return true;
        }
        if self.extended {
            out.extend_from_slice(&record[12..BASE_LENGTH]);
        } else {
            self.push_old(record, out);
        }
        let field = |at: Option<usize>, length: usize| at.map_or(&[0; 6][..length], |at| &record[at..at + length]);
        if Layout::red_of(self.target.format).is_some() {
            out.extend_from_slice(field(self.red, 6));
        }
        if Layout::near_infrared(self.target.format).is_some() {
            out.extend_from_slice(field(self.near_infrared, 2));
        }
        out.extend_from_slice(&record[self.base_length..]);
        self.scale_colors(&mut out[start..]);
        true
    }

    fn scale_colors(&self, record: &mut [u8]) {
        if self.depth == ColorDepth::Sixteen {
            return;
        }
        if let Some(red) = Layout::red_of(self.target.format) {
            for field in record[red..red + 6].chunks_exact_mut(2) {
                let value = self.depth.widen(u16::from_le_bytes(bytes(field, 0)));
                field.copy_from_slice(&value.to_le_bytes());
            }
        }
    }

    /// Writes the fields between coordinates and colours of formats 0 to 5. Nothing is lost: a class of 12 (overlap)
    /// stays, and the flag that later formats have for it is set, too.
    fn push_old(&self, record: &[u8], out: &mut Vec<u8>) {
        let (returns, class) = (record[14], record[15]);
        let overlap = if class & 0x1f == OVERLAP_CLASS { 8 } else { 0 };
        let degrees = record[16] as i8;
        let angle = f64::from(degrees) * ANGLE_STEPS;
        if degrees % WHOLE_ANGLES != 0 && !self.has_rounded_angles.load(Ordering::Relaxed) {
            self.has_rounded_angles.store(true, Ordering::Relaxed);
        }
        out.extend_from_slice(&record[12..14]);
        out.push(returns & 7 | (returns >> 3 & 7) << 4);
        out.push(class >> 5 | overlap | returns & 0xc0);
        out.push(class & 0x1f);
        out.push(record[17]);
        out.extend((angle.round() as i16).to_le_bytes());
        out.extend_from_slice(&record[18..20]);
        out.extend(self.gps_time.map_or([0; 8], |at| bytes(record, at)));
    }
}

/// The header's statistics of all its points.
#[derive(Clone, Debug)]
pub struct Statistics {
    pub points: u64,
    pub by_return: [u64; 15],
    pub lowest: [i32; 3],
    pub highest: [i32; 3],
    pub first_time: f64,
    pub last_time: f64,
}

impl Default for Statistics {
    fn default() -> Self {
        Self {
            points: 0,
            by_return: [0; 15],
            lowest: [i32::MAX; 3],
            highest: [i32::MIN; 3],
            first_time: f64::INFINITY,
            last_time: f64::NEG_INFINITY,
        }
    }
}

impl Statistics {
    /// Counts a record of a format.
    pub fn add(&mut self, record: &[u8], format: u8) {
        self.points += 1;
        let number = record[14] & if format >= 6 { 15 } else { 7 };
        if let Some(count) = usize::from(number).checked_sub(1).and_then(|at| self.by_return.get_mut(at)) {
            *count += 1;
        }
        for axis in 0..3 {
            let raw = i32::from_le_bytes(bytes(record, 4 * axis));
            self.lowest[axis] = self.lowest[axis].min(raw);
            self.highest[axis] = self.highest[axis].max(raw);
        }
        if let Some(at) = Layout::gps_time(format) {
            let time = f64::from_le_bytes(bytes(record, at));
            self.first_time = self.first_time.min(time);
            self.last_time = self.last_time.max(time);
        }
    }

    /// The bounds of all points, which are on `grid`.
    pub fn bounds(&self, grid: Grid) -> Bounds {
        let world = |raw: [i32; 3]| DVec3::from(raw.map(f64::from)) * grid.scale + grid.offset;
        let (a, b) = (world(self.lowest), world(self.highest));
        // A scale may be negative.
        Bounds { min: a.min(b), max: a.max(b) }
    }

    pub fn merge(&mut self, other: &Self) {
        self.points += other.points;
        for (count, others) in self.by_return.iter_mut().zip(other.by_return) {
            *count += others;
        }
        for axis in 0..3 {
            self.lowest[axis] = self.lowest[axis].min(other.lowest[axis]);
            self.highest[axis] = self.highest[axis].max(other.highest[axis]);
        }
        self.first_time = self.first_time.min(other.first_time);
        self.last_time = self.last_time.max(other.last_time);
    }
}

/// The GPS time of a record of formats 6 to 10.
pub fn time(record: &[u8]) -> f64 {
    f64::from_le_bytes(bytes(record, 22))
}

/// The files of which the first one that has a coordinate system comes first: its header and records go on to the file
/// that is written.
pub fn leading<'a>(sources: &[&'a LasSource]) -> Vec<&'a LasSource> {
    let mut sources = sources.to_vec();
    if let Some(first) = sources.iter().position(|source| source.info.crs.is_some()) {
        sources[..=first].rotate_right(1);
    }
    sources
}

/// Checks that the points of all files can be in one file; says which files have no coordinate system where others have.
/// Returns whether their times are standard time, if they have times.
pub fn check_alike(sources: &[&LasSource], words: &mut Words) -> Result<Option<bool>> {
    let first = sources[0];
    for source in sources {
        let refuse = |problem: &str| Err(unlike(&source.info, problem, &first.info));
        if extra_dimensions(source) != extra_dimensions(first) {
            return refuse("has other extra dimensions");
        }
        match (&source.info.crs, &first.info.crs) {
            (Some(_), Some(_)) => {
                if let Some(difference) = source.info.system_difference(&first.info) {
                    return refuse(&format!("is in {difference}"));
                }
            }
            (None, Some(_)) => {
                let of = shown(&first.info.path);
                words.say(&source.info.path, format!("has no coordinate system: taken to be in that of {of}"));
            }
            _ => {}
        }
    }
    common_time(sources.iter().filter_map(|source| Some((&source.info, source.standard_time()?))))
}

fn unlike(other: &Info, problem: &str, first: &Info) -> Error {
    let problem = format!("{problem} than {}; files of one kind can become one file", shown(&first.path));
    Error::unsuitable(&other.path, problem)
}

/// Whether the times of all files are standard time; `None` if no file has times. Checks that all count time in one way.
pub fn common_time<'a>(mut times: impl Iterator<Item = (&'a Info, bool)>) -> Result<Option<bool>> {
    let Some((first, is_standard)) = times.next() else { return Ok(None) };
    match times.find(|(_, other)| *other != is_standard) {
        Some((other, _)) => Err(unlike(other, "counts GPS time in another way (weeks or standard time)", first)),
        None => Ok(Some(is_standard)),
    }
}

/// The header's bits of a file whose times are standard time or not; as they were if that is not known.
pub fn with_time(global_encoding: u16, is_standard: Option<bool>) -> u16 {
    match is_standard {
        Some(true) => global_encoding | STANDARD_TIME,
        Some(false) => global_encoding & !STANDARD_TIME,
        None => global_encoding,
    }
}

/// Whether records of all files end with the same extra dimensions.
pub fn have_same_extra_dimensions(sources: &[&LasSource]) -> bool {
    sources.windows(2).all(|pair| extra_dimensions(pair[0]) == extra_dimensions(pair[1]))
}

/// Adds the warnings of all files.
pub fn warn_of(sources: &[&LasSource], warnings: &mut Vec<String>) {
    for info in sources.iter().map(|source| &source.info) {
        warnings.extend(info.warnings.iter().map(|warning| format!("{}: {warning}", shown(&info.path))));
    }
}

/// Says which files have wave packets that the file that is written does not have.
pub fn leave_out_waves(sources: &[&LasSource], reason: &str, words: &mut Words) {
    for source in sources.iter().filter(|source| source.has_waves()) {
        words.say(&source.info.path, format!("{reason}: left out"));
    }
}

/// Says which files have no colours or times, where others have.
pub fn say_black(sources: &[&LasSource], mark: &str, words: &mut Words) {
    let any = |of: fn(&LasSource) -> bool| sources.iter().any(|source| of(source));
    for source in sources {
        if any(LasSource::has_colors) && !source.has_colors() {
            words.say(&source.info.path, format!("has no colours: its points are black in the new file{mark}"));
        }
        if any(LasSource::has_time) && !source.has_time() {
            words.say(&source.info.path, "has no gps_time: 0 in the new file");
        }
    }
}

/// Says which files had angles that were rounded.
pub fn say_rounded_angles(sources: &[&LasSource], upgrades: &[Upgrade], words: &mut Words) {
    for (source, upgrade) in sources.iter().zip(upgrades) {
        if upgrade.has_rounded_angles.load(Ordering::Relaxed) {
            words.say(&source.info.path, "scan_angle: whole degrees became steps of 0.006 degrees");
        }
    }
}

/// The conversion of each file's records; says where it changes colours or rounds coordinates.
pub fn upgrades(sources: &[&LasSource], target: Target, grid: Grid, words: &mut Words) -> Vec<Upgrade> {
    let mut depths = sources.iter().filter_map(|source| source.color_depth());
    let first = depths.next();
    let are_alike = depths.all(|depth| Some(depth) == first);
    let mut upgrades = Vec::new();
    for source in sources {
        let depth = source.color_depth().filter(|_| !are_alike).unwrap_or(ColorDepth::Sixteen);
        if depth != ColorDepth::Sixteen {
            let most = depth.most();
            words.say(
                &source.info.path,
                format!("colours from 0 to {most} became colours from 0 to 65535, for one scale"),
            );
        }
        let upgrade = Upgrade::new(source, target, grid, depth);
        if !upgrade.is_exact() {
            let of = shown(&sources[0].info.path);
            let steps = crate::brief::vector(grid.scale);
            words.say(
                &source.info.path,
                format!(
                    "its coordinates lie on another grid than those of {of}: rounded to the nearest step of {steps}"
                ),
            );
        }
        upgrades.push(upgrade);
    }
    upgrades
}

/// The items of points of a format in a LAZ file, if they can be compressed. `memory` bounds what that takes, in bytes.
pub fn check_items(path: &Path, target: Target, memory: u64) -> Result<Vec<LazItem>> {
    let refuse = |problem: String| Err(Error::unsuitable(path, problem));
    let length = target.record_length();
    if length > usize::from(u16::MAX) {
        return refuse(format!(
            "its points take {length} bytes in the file to write, which can have {} at most",
            u16::MAX
        ));
    }
    let items = LazItemRecordBuilder::default_for_point_format_id(target.format, target.extra as u16)
        .map_err(|error| Error::unsuitable(path, error.to_string()))?;
    let bytes = items::encoder_bytes(&items);
    if bytes > memory.max(items::BASE_BYTES) {
        return refuse(format!(
            "points of {length} bytes take {} MB to compress, the memory for that is {} MB: stream.host_bytes is too small \
             for it",
            bytes.div_ceil(1_000_000),
            memory / 1_000_000
        ));
    }
    Ok(items)
}

/// A lock for threads that compress one after the other, if several at a time would take too much memory.
pub fn one_at_a_time(items: &[LazItem], memory: u64) -> Option<Mutex<()>> {
    (items::encoder_bytes(items) * rayon::current_num_threads() as u64 > memory).then(Mutex::default)
}

/// The bytes that identify extra dimensions: everything but the ranges of their values.
fn extra_dimensions(source: &LasSource) -> (usize, Vec<Vec<u8>>) {
    let descriptors = source.descriptors.chunks_exact(192).map(|descriptor| {
        let mut fixed = descriptor.to_vec();
        forget_range(&mut fixed);
        fixed[64..112].fill(0);
        fixed
    });
    (source.layout.record_length - source.base_length(), descriptors.collect())
}

/// The options of a descriptor that say that it contains the smallest and the largest value.
const RANGE_OPTIONS: u8 = 2 | 4;

/// Says in the descriptor of an extra dimension that it does not contain the smallest and the largest value. The options
/// of one without a type are its number of bytes.
pub fn forget_range(descriptor: &mut [u8]) {
    if descriptor[2] != 0 {
        descriptor[3] &= !RANGE_OPTIONS;
    }
}

/// The first file's grid with the finest steps of any; with coarser ones where 32 bits do not reach all points.
pub fn common_grid(sources: &[&LasSource]) -> Grid {
    let bounds = sources.iter().filter_map(|source| source.info.bounds).fold(Bounds::EMPTY, Bounds::union);
    grid::common_grid(sources.iter().map(|source| source.grid), bounds).unwrap_or(sources[0].grid)
}

/// The failure of a point beyond the grid, which was chosen by the bounds that files claim.
pub fn far_outside() -> io::Error {
    io::Error::other("a point lies too far outside of what the header says")
}

impl LasSource {
    pub fn base_length(&self) -> usize {
        let base = self.info.point_format.and_then(Layout::base_length);
        base.unwrap_or(self.layout.record_length)
    }

    pub fn has_time(&self) -> bool {
        self.info.point_format.and_then(Layout::gps_time).is_some()
    }

    pub fn has_waves(&self) -> bool {
        self.info.point_format.and_then(Layout::wave_packet).is_some()
    }

    /// Whether its times are standard time rather than seconds of a week; `None` if it has none.
    pub fn standard_time(&self) -> Option<bool> {
        self.has_time().then_some(self.standard_time)
    }
}
