//! The grid of a LAS file that is made of points that are on none: the coarsest steps that hold their coordinates as
//! they are, or steps so fine that nobody sees them; the finest ones that 32 bits reach, where a few points lie far away.

use cloud::{Bounds, Column, Grid};
use glam::DVec3;

/// The steps from an offset to the ends of 32 bits.
const REACH: f64 = i32::MAX as f64 - 1.0;
/// The coarsest step that is tried; each of the next ones is a tenth.
const COARSEST: f64 = 1000.0;
/// The number of steps that are tried.
const LEVELS: u32 = 17;
/// The coarsest step of coordinates that are whole numbers, in a file whose points lie near one another.
const USUAL: f64 = 0.001;
/// The share of the extent of most points that no step needs to be finer than.
pub const UNSEEN: f64 = 1e-9;
/// The number of points of each piece of a file of which the extent of most points is found.
const SAMPLES: usize = 64;
/// The share of the samples at each end that are left out of it.
const FEW: f64 = 0.1;

/// What is known of the coordinates of points along an axis.
#[derive(Clone, Debug)]
pub struct Axis {
    /// The offset and the coarsest step of the grids that are tried.
    offset: f64,
    coarsest: f64,
    pub least: f64,
    pub greatest: f64,
    /// The number of tenths of the coarsest step that hold all coordinates.
    level: u32,
    samples: Vec<f64>,
}

/// A coordinate as it is in its file may be that far from the step for which it stands.
fn tolerance(column: &Column, value: f64) -> f64 {
    let share = if matches!(column, Column::F32(_)) { 2_f64.powi(-24) } else { 2_f64.powi(-50) };
    value.abs() * share + 1e-13
}

/// How far a coordinate of a column is moved to a step, where that is more than the column's numbers tell apart.
pub fn rounding(column: &Column, value: f64, on_grid: f64) -> f64 {
    let distance = (on_grid - value).abs();
    if distance > tolerance(column, value) { distance } else { 0.0 }
}

impl Axis {
    /// `grid` has the offset and the step of LAS files that are written to the same file.
    pub fn new(grid: Option<(f64, f64)>) -> Self {
        let (offset, coarsest) = grid.unwrap_or((0.0, COARSEST));
        let (least, greatest) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { offset, coarsest, least, greatest, level: 0, samples: Vec::new() }
    }

    fn step(&self, level: u32) -> f64 {
        self.coarsest / 10_f64.powi(level as i32)
    }

    pub fn add(&mut self, column: &Column, kept: &[u32]) {
        let mut step = self.step(self.level);
        for (place, index) in kept.iter().enumerate() {
            let value = column.value(*index as usize);
            if !value.is_finite() {
                continue;
            }
            self.least = self.least.min(value);
            self.greatest = self.greatest.max(value);
            while self.level < LEVELS
                && rounding(column, value, ((value - self.offset) / step).round() * step + self.offset) > 0.0
            {
                self.level += 1;
                step = self.step(self.level);
            }
            if place % kept.len().div_ceil(SAMPLES) == 0 {
                self.samples.push(value);
            }
        }
    }

    pub fn merge(&mut self, other: Self) {
        self.least = self.least.min(other.least);
        self.greatest = self.greatest.max(other.greatest);
        self.level = self.level.max(other.level);
        self.samples.extend(other.samples);
    }

    /// The extent of most points.
    fn bulk(&mut self) -> f64 {
        self.samples.sort_by(f64::total_cmp);
        let last = self.samples.len().saturating_sub(1) as f64;
        let at = |share: f64| self.samples.get((last * share).round() as usize).copied().unwrap_or(0.0);
        (at(1.0 - FEW) - at(FEW)) / (1.0 - 2.0 * FEW)
    }
}

/// The grid for coordinates between the `bounds` of all points, of which those without a grid are known by `axes`.
/// `own` is the grid of LAS files among them, with the finest steps of any. Also gives the extent of most points.
pub fn grid_of(mut axes: [Axis; 3], bounds: Bounds, own: Option<Grid>) -> (Grid, f64) {
    let bulk = axes.each_mut().map(Axis::bulk).into_iter().fold(0.0, f64::max);
    let mut grid = own.unwrap_or(Grid::new(DVec3::ONE, DVec3::ZERO));
    for (number, axis) in axes.iter().enumerate() {
        let (least, greatest) = (bounds.min[number], bounds.max[number]);
        let finest = finest_step(least, greatest);
        let exact = axis.exact_steps(own.map(|own| own.scale[number].abs()));
        let step = exact.into_iter().find(|step| *step >= finest).unwrap_or_else(|| {
            let reaching = nice_steps(axis.coarsest).take_while(|step| *step >= finest);
            let unseen = reaching.filter(|step| *step <= bulk * UNSEEN).reduce(f64::max);
            unseen.unwrap_or_else(|| two_digits(finest))
        });
        grid.scale[number] = tidy(step);
        let own = own.map(|own| (own.offset[number], own.scale[number].abs()));
        grid.offset[number] = offset_of(least, greatest, grid.scale[number], own);
    }
    (grid, bulk)
}

impl Axis {
    /// The steps that hold all coordinates as they are. `own` is that of LAS files.
    fn exact_steps(&self, own: Option<f64>) -> Vec<f64> {
        let step = self.step(self.level);
        match own {
            Some(own) if self.least > self.greatest => vec![own],
            _ if self.level == LEVELS => Vec::new(),
            Some(_) => vec![step],
            // Steps of a metre look odd in a file.
            None => vec![step.min(USUAL), step],
        }
    }
}

/// The step below which 32 bits do not reach from one end to the other, or beyond what doubles tell apart.
fn finest_step(least: f64, greatest: f64) -> f64 {
    let far = least.abs().max(greatest.abs());
    ((greatest - least) / (2.0 * REACH)).max(far * f64::EPSILON).max(1e-15)
}

/// A step, and its halves, fifths and tenths, and those of these, ever finer.
fn nice_steps(coarsest: f64) -> impl Iterator<Item = f64> {
    (0..30).flat_map(move |level| [1.0, 2.0, 5.0].map(|part| coarsest / 10_f64.powi(level) / part))
}

/// The number that a text of few digits stands for, if that is the step but for rounding.
fn tidy(step: f64) -> f64 {
    let few: f64 = format!("{step:.3e}").parse().unwrap_or(step);
    if (few / step - 1.0).abs() < 1e-14 { few } else { step }
}

/// The next greater number of two digits.
fn two_digits(step: f64) -> f64 {
    let exponent = step.log10().floor() as i32 - 1;
    let digits = (step / 10_f64.powi(exponent) - 1e-10).ceil();
    format!("{digits}e{exponent}").parse().unwrap_or(step)
}

/// An offset from which steps reach both ends: that of other files if it does, else the roundest one near the points.
fn offset_of(least: f64, greatest: f64, step: f64, own: Option<(f64, f64)>) -> f64 {
    let reaches = |offset: &f64| (least - offset).abs().max((greatest - offset).abs()) / step <= REACH;
    let middle = least / 2.0 + greatest / 2.0;
    let near = (10.0 * (greatest - least)).max(1e6 * step);
    let (origin, unit) = own.unwrap_or((0.0, 1.0));
    let round = (-15..=12).rev().map(|power| {
        let unit = unit * 10_f64.powi(power);
        tidy(origin + ((middle - origin) / unit).round() * unit)
    });
    let round = round.filter(|offset| (offset - middle).abs() <= near);
    own.map(|(offset, _)| offset).into_iter().chain(round).find(reaches).unwrap_or(middle)
}

/// The grid with the finest steps of LAS files whose points are in one file, or with the finest that reach them all.
pub fn common_grid(grids: impl Iterator<Item = Grid>, bounds: Bounds) -> Option<Grid> {
    let own = finest(grids)?;
    let reach = (bounds.min - own.offset).abs().max((bounds.max - own.offset).abs()) / own.scale.abs();
    let is_reached = bounds.is_empty() || reach.max_element() <= REACH;
    Some(if is_reached { own } else { grid_of([0; 3].map(|_| Axis::new(None)), bounds, Some(own)).0 })
}

/// The first of several grids with the finest steps of any.
pub fn finest(mut grids: impl Iterator<Item = Grid>) -> Option<Grid> {
    let mut own = grids.next()?;
    for grid in grids {
        let is_finer = grid.scale.abs().cmplt(own.scale.abs());
        own.scale = DVec3::select(is_finer, grid.scale, own.scale);
    }
    Some(own)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(axes: [&[f64]; 3], is_float: bool, own: Option<Grid>) -> Grid {
        let column = |values: &[f64]| match is_float {
            true => Column::F32(values.iter().map(|value| *value as f32).collect()),
            false => Column::F64(values.to_vec()),
        };
        let axes = [0, 1, 2].map(|number| {
            let mut axis = Axis::new(own.map(|own| (own.offset[number], own.scale[number])));
            let kept: Vec<u32> = (0..axes[number].len() as u32).collect();
            axis.add(&column(axes[number]), &kept);
            axis
        });
        let end = |of: fn(&Axis) -> f64| DVec3::from(axes.each_ref().map(of));
        let bounds = Bounds { min: end(|axis| axis.least), max: end(|axis| axis.greatest) };
        let (grid, _) = grid_of(axes, bounds, own);
        let reach = (bounds.min - grid.offset).abs().max((bounds.max - grid.offset).abs()) / grid.scale;
        assert!(reach.max_element() <= f64::from(i32::MAX), "{grid:?}");
        grid
    }

    /// Numbers that are on no grid, from `from` on.
    fn rough(from: f64, extent: f64) -> Vec<f64> {
        (0..1000).map(|index| from + extent * (f64::from(index) * 0.618_033_988_749_894_8).fract()).collect()
    }

    #[test]
    fn coordinates_of_some_decimals_keep_them() {
        let values: Vec<f64> = (0..1000).map(|index| 500_000.0 + f64::from(index) * 0.0125).collect();
        let grid = chosen([&values, &[0.5, 0.25, 7.0], &[1.0, 2.0]], false, None);
        assert_eq!(grid, Grid::new(DVec3::new(0.0001, 0.001, 0.001), DVec3::new(500_000.0, 0.0, 0.0)));
        // Floats stand for the decimals that they were written from.
        assert_eq!(chosen([&[0.1, 39.977], &[2.4], &[1.3]], true, None).scale, DVec3::splat(0.001));
        assert_eq!(chosen([&[2.4], &[1.3], &[0.4]], true, None), Grid::new(DVec3::splat(0.001), DVec3::ZERO));
    }

    #[test]
    fn coordinates_on_no_grid_get_a_billion_steps() {
        let grid = chosen([&rough(500_000.0, 40.0), &rough(5_400_000.0, 40.0), &rough(0.0, 8.0)], false, None);
        assert!(grid.scale.cmple(DVec3::splat(5e-8)).all() && grid.scale.cmpge(DVec3::splat(5e-9)).all(), "{grid:?}");
        let values = rough(0.475, 0.05);
        let small = chosen([&values, &values, &values], true, None);
        for value in values.iter().map(|value| *value as f32) {
            let steps = ((f64::from(value) - small.offset.x) / small.scale.x).round();
            assert_eq!((steps * small.scale.x + small.offset.x) as f32, value, "{small:?}");
        }
    }

    #[test]
    fn one_point_far_away_leaves_the_finest_steps_that_reach_it() {
        let with_zero = |mut values: Vec<f64>| {
            values[0] = 0.0;
            values
        };
        let (x, y) = (with_zero(rough(500_000.0, 40.0)), with_zero(rough(5_400_000.0, 40.0)));
        let grid = chosen([&x, &y, &rough(296.0, 8.0)], false, None);
        let least = DVec3::new(500_040.0, 5_400_040.0, 0.0) / f64::from(u32::MAX);
        assert!(grid.scale.x < 1.1 * least.x && grid.scale.y < 1.1 * least.y && grid.scale.z <= 4e-8, "{grid:?}");
        // Decimals that 32 bits hold stay.
        let whole: Vec<f64> = with_zero((0..1000).map(|index| 4_000_000.0 + f64::from(index) * 0.01).collect());
        assert_eq!(chosen([&whole, &[0.0], &[0.0]], false, None).scale, DVec3::splat(USUAL));
        let farther: Vec<f64> = with_zero((0..1000).map(|index| 2e7 + f64::from(index) * 0.01).collect());
        assert_eq!(chosen([&farther, &[0.0], &[0.0]], false, None).scale.x, 0.01);
    }

    #[test]
    fn a_grid_of_other_files_stays_or_is_divided() {
        let own = Grid::new(DVec3::splat(0.01), DVec3::new(600_000.0, 0.0, 0.0));
        let near = [600_000.25, 600_001.0];
        assert_eq!(chosen([&near, &[1.0], &[2.0]], false, Some(own)), own);
        let finer = chosen([&[600_000.255], &[1.0], &[2.0]], false, Some(own));
        assert_eq!((finer.scale, finer.offset), (DVec3::new(0.001, 0.01, 0.01), own.offset));
        let rough = chosen([&rough(600_000.0, 40.0), &[1.0], &[2.0]], false, Some(own));
        let ratio = own.scale.x / rough.scale.x;
        assert!((ratio - ratio.round()).abs() < 1e-6 && rough.scale.x <= 5e-8, "{rough:?}");
        assert_eq!((two_digits(0.001_257_3), two_digits(1e-7)), (0.0013, 1e-7));
    }

    #[test]
    fn files_that_lie_too_far_apart_for_the_steps_of_either_get_coarser_ones() {
        let grids = [0.001, 0.0001].map(|step| Grid::new(DVec3::splat(step), DVec3::ZERO));
        let bounds = |width: f64| Bounds { min: DVec3::ZERO, max: DVec3::new(width, 1.0, 1.0) };
        assert_eq!(common_grid(grids.into_iter(), bounds(1000.0)), Some(grids[1]));
        let far = common_grid(grids.into_iter(), bounds(5e6)).unwrap();
        assert_eq!(far.scale, DVec3::new(0.0012, 0.0001, 0.0001));
        assert!((far.offset.x - 2.5e6).abs() < 0.1e6 && far.offset.y == 0.0, "{far:?}");
    }
}
