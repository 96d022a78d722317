//! Converts point records of any format and grid to those of a COPC file: point formats 6 to 8 on one grid.

use cloud::Grid;
use glam::DVec3;

use crate::las::LasSource;
use crate::las::layout::{Layout, bytes};

/// The size in bytes of a record of formats 6 to 8 before its colours.
const BASE_LENGTH: usize = 30;
/// The number of steps of an angle of formats 6 to 10 in a degree.
const ANGLE_STEPS: f64 = 1.0 / 0.006;
/// The class that means "overlap" in formats 0 to 5; later ones have a flag for it.
const OVERLAP_CLASS: u8 = 12;

/// The contents of points in the file to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Target {
    pub colors: bool,
    pub near_infrared: bool,
    /// The number of bytes of extra dimensions.
    pub extra: usize,
}

impl Target {
    /// A format that holds everything that points of these formats have, except wave packets.
    pub fn new(formats: impl Iterator<Item = u8> + Clone, extra: usize) -> Self {
        let any = |of: &[u8]| formats.clone().any(|format| of.contains(&format));
        Self { colors: any(&[2, 3, 5, 7, 8, 10]), near_infrared: any(&[8, 10]), extra }
    }

    pub fn format(&self) -> u8 {
        match (self.colors, self.near_infrared) {
            (_, true) => 8,
            (true, false) => 7,
            (false, false) => 6,
        }
    }

    pub fn record_length(&self) -> usize {
        BASE_LENGTH + if self.colors { 6 } else { 0 } + if self.near_infrared { 2 } else { 0 } + self.extra
    }
}

/// Converts records of one file to the target.
pub struct Upgrade {
    target: Target,
    target_grid: Grid,
    grid: Grid,
    same_grid: bool,
    extended: bool,
    base_length: usize,
    gps_time: Option<usize>,
    red: Option<usize>,
    near_infrared: Option<usize>,
    /// The size in bytes of a record of the file.
    pub record_length: usize,
}

impl Upgrade {
    pub fn new(source: &LasSource, target: Target, target_grid: Grid) -> Self {
        let format = source.info.point_format.unwrap_or(0);
        let layout = &source.layout;
        Self {
            target,
            target_grid,
            grid: source.grid,
            same_grid: source.grid == target_grid,
            extended: format >= 6,
            base_length: Layout::base_length(format).unwrap_or(layout.record_length),
            gps_time: Layout::gps_time(format),
            red: layout.red,
            near_infrared: Layout::near_infrared(format),
            record_length: layout.record_length,
        }
    }

    /// Whether the target's grid represents the coordinates exactly.
    pub fn is_exact(&self) -> bool {
        let shift = (self.grid.offset - self.target_grid.offset) / self.target_grid.scale;
        let ratio = self.grid.scale / self.target_grid.scale;
        let whole = |value: DVec3| (value - value.round()).abs().max_element() < 1e-6;
        whole(shift) && whole(ratio)
    }

    /// Appends a record; returns `false` if its coordinates are too far away for the target's grid.
    pub fn push(&self, record: &[u8], out: &mut Vec<u8>) -> bool {
        if self.same_grid {
            out.extend_from_slice(&record[..12]);
        } else {
            let raw = DVec3::from([0, 4, 8].map(|at| f64::from(i32::from_le_bytes(bytes(record, at)))));
            let world = raw * self.grid.scale + self.grid.offset;
            let integers = ((world - self.target_grid.offset) / self.target_grid.scale).round().to_array();
            if integers.iter().any(|integer| integer.abs() > f64::from(i32::MAX)) {
                return false;
            }
            integers.iter().for_each(|integer| out.extend((*integer as i32).to_le_bytes()));
        }
        if self.extended {
            out.extend_from_slice(&record[12..BASE_LENGTH]);
        } else {
            self.push_old(record, out);
        }
        let field = |at: Option<usize>, length: usize| at.map_or(&[0; 6][..length], |at| &record[at..at + length]);
        if self.target.colors {
            out.extend_from_slice(field(self.red, 6));
        }
        if self.target.near_infrared {
            out.extend_from_slice(field(self.near_infrared, 2));
        }
        out.extend_from_slice(&record[self.base_length..]);
        true
    }

    /// Writes the fields between coordinates and colours of formats 0 to 5. Nothing is lost: a class of 12 (overlap)
    /// stays, and the flag that later formats have for it is set, too.
    fn push_old(&self, record: &[u8], out: &mut Vec<u8>) {
        let (returns, class) = (record[14], record[15]);
        let overlap = if class & 0x1f == OVERLAP_CLASS { 8 } else { 0 };
        let angle = f64::from(record[16] as i8) * ANGLE_STEPS;
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
    /// Counts a record of the target.
    pub fn add(&mut self, record: &[u8]) {
        self.points += 1;
        if let Some(count) = usize::from(record[14] & 15).checked_sub(1).and_then(|at| self.by_return.get_mut(at)) {
            *count += 1;
        }
        for axis in 0..3 {
            let raw = i32::from_le_bytes(bytes(record, 4 * axis));
            self.lowest[axis] = self.lowest[axis].min(raw);
            self.highest[axis] = self.highest[axis].max(raw);
        }
        let time = time(record);
        self.first_time = self.first_time.min(time);
        self.last_time = self.last_time.max(time);
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

/// The GPS time of a record of the target.
pub fn time(record: &[u8]) -> f64 {
    f64::from_le_bytes(bytes(record, 22))
}
