//! The volume between the points above a polygon and a plane.

use cloud::Bounds;
use glam::{DVec2, DVec3};

use crate::error::{Error, Result};
use crate::figures::sides_cross;
use crate::fit::plane;

/// The number of cells along the longer side of the finest grid.
const FINEST: usize = 1024;
/// The points that a cell with points has on average: the finest grid with as many is taken.
const POINTS_PER_CELL: f64 = 16.0;
/// A cell without points takes the mean of the four cells about it, or of the sixteen, that are one at a coarser level.
const FILLING_LEVELS: usize = 2;
/// Heights are counted in this share of the edge of the finest cells. Sums of whole numbers do not depend on their
/// order, so that the result is the same however many threads read the points.
const STEP: f64 = 1.0 / (1 << 20) as f64;
/// The largest height over that edge; points beyond are left out.
const MOST_HEIGHT: f64 = (1 << 20) as f64;

/// A volume in cells, as seen from above: in each, the mean height of its points above the plane times the cell's area
/// within the polygon. The density of the points decides the size of the cells.
#[derive(Clone, Debug)]
pub struct VolumeGrid {
    /// Level axes and up; unit vectors.
    axes: [DVec3; 3],
    origin: DVec3,
    /// The plane's height above the origin, and how it rises along the level axes.
    base: f64,
    slope: DVec2,
    polygon: Vec<DVec2>,
    /// The size of the polygon's box.
    size: DVec2,
    finest: Level,
}

/// A grid of cells of one size.
#[derive(Clone, Debug)]
struct Level {
    edge: f64,
    columns: usize,
    cells: Vec<Cell>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    points: u32,
    sum: i64,
    squares: i128,
    /// The sums of the level coordinates.
    at: [i64; 2],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// The volumes above and below the plane.
    pub above: f64,
    pub below: f64,
    /// The standard deviation of their difference that follows from the scatter of heights in cells, where points
    /// deviate independently.
    pub deviation: f64,
    /// The area of the polygon as seen from above, of its parts without points, which add nothing, and of cells without
    /// points that take the height of those around them, of which the deviation knows nothing.
    pub area: f64,
    pub empty_area: f64,
    pub filled_area: f64,
    /// The edge of the cells.
    pub cell: f64,
    pub points: u64,
}

impl Level {
    /// The grid of cells with edges of twice the length.
    fn coarser(&self) -> Self {
        let (columns, rows) = (self.columns.div_ceil(2), (self.cells.len() / self.columns).div_ceil(2));
        let mut cells = vec![Cell::default(); columns * rows];
        for (index, cell) in self.cells.iter().enumerate() {
            let joined = &mut cells[index / self.columns / 2 * columns + index % self.columns / 2];
            joined.points = joined.points.saturating_add(cell.points);
            joined.sum += cell.sum;
            joined.squares += cell.squares;
            joined.at = [0, 1].map(|axis| joined.at[axis].saturating_add(cell.at[axis]));
        }
        Self { edge: self.edge * 2.0, columns, cells }
    }

    /// The mean height of a cell's points and their mean place, in steps.
    fn mean(&self, index: usize) -> Option<(f64, DVec2)> {
        let cell = self.cells.get(index).filter(|cell| cell.points > 0)?;
        let count = f64::from(cell.points);
        Some((cell.sum as f64 / count, DVec2::from(cell.at.map(|sum| sum as f64)) / count))
    }

    /// How heights rise along the two axes at a cell: of the slopes to its neighbours on both sides the smaller one, or
    /// none if they differ in sign, so that nothing is overshot at an edge.
    fn slope(&self, index: usize) -> DVec2 {
        let Some((height, place)) = self.mean(index) else { return DVec2::ZERO };
        let (column, row) = (index % self.columns, index / self.columns);
        let along = |axis: usize, before: Option<usize>, after: Option<usize>| {
            let to = |other: Option<usize>| {
                let (other, at) = self.mean(other?)?;
                Some((other - height) / (at - place)[axis]).filter(|slope| slope.is_finite())
            };
            match (to(before), to(after)) {
                (Some(a), Some(b)) if a * b <= 0.0 => 0.0,
                (Some(a), Some(b)) => {
                    if a.abs() < b.abs() {
                        a
                    } else {
                        b
                    }
                }
                (one, other) => one.or(other).unwrap_or(0.0),
            }
        };
        let left = (column > 0).then(|| index - 1);
        let right = (column + 1 < self.columns).then_some(index + 1);
        let below = (row > 0).then(|| index - self.columns);
        DVec2::new(along(0, left, right), along(1, below, Some(index + self.columns)))
    }

    /// Whether cells have enough points, or are the largest that there are.
    fn is_coarse(&self) -> bool {
        let filled = self.cells.iter().filter(|cell| cell.points > 0);
        let (count, points) =
            filled.fold((0.0, 0.0), |(count, points), cell| (count + 1.0, points + f64::from(cell.points)));
        self.cells.len() == 1 || points >= POINTS_PER_CELL * count
    }
}

impl VolumeGrid {
    /// A grid over a polygon. The plane is level at a height, or goes through the corners, as well as they lie on one.
    /// `up` is a unit vector.
    ///
    /// # Errors
    /// Fewer than three corners, sides that cross, no area, or no plane.
    pub fn new(corners: &[DVec3], level: Option<f64>, up: DVec3) -> Result<Self> {
        if corners.len() < 3 {
            return Err(Error::TooFew { points: corners.len(), least: 3 });
        }
        let (u, v) = up.any_orthonormal_pair();
        let axes = [u, v, up];
        let origin = corners[0];
        let flat = |corner: &DVec3| DVec2::new((*corner - origin).dot(u), (*corner - origin).dot(v));
        let polygon: Vec<DVec2> = corners.iter().map(flat).collect();
        let (low, high) = reach(&polygon);
        let area = area(&polygon).abs();
        // NaN fails the comparison.
        if !(area > 0.0 && area.is_finite()) {
            return Err(Error::NoArea);
        }
        let (base, slope) = match level {
            Some(level) => (level - origin.dot(up), DVec2::ZERO),
            None => {
                let (center, normal) = plane_of(corners)?;
                let upward = normal.dot(up);
                if upward.abs() < 1e-6 {
                    return Err(Error::Upright);
                }
                let slope = -DVec2::new(normal.dot(u), normal.dot(v)) / upward;
                ((center - origin).dot(up) - slope.dot(flat(&center)), slope)
            }
        };
        if sides_cross(corners, up) {
            return Err(Error::Crossed);
        }
        let size = high - low;
        let edge = size.max_element() / FINEST as f64;
        let [columns, rows] = (size / edge).to_array().map(|count| (count.ceil() as usize).clamp(1, FINEST));
        Ok(Self {
            axes,
            origin: origin + u * low.x + v * low.y,
            base: base + slope.dot(low),
            slope,
            polygon: polygon.into_iter().map(|corner| corner - low).collect(),
            size,
            finest: Level { edge, columns, cells: vec![Cell::default(); columns * rows] },
        })
    }

    /// Whether a point within the bounds could be above or below the polygon.
    pub fn wants(&self, bounds: Bounds) -> bool {
        let corners = bounds.corners().map(|corner| self.flat(corner));
        let (low, high) = reach(&corners);
        !bounds.is_empty() && low.cmple(self.size).all() && high.cmpge(DVec2::ZERO).all()
    }

    fn flat(&self, point: DVec3) -> DVec2 {
        let offset = point - self.origin;
        DVec2::new(offset.dot(self.axes[0]), offset.dot(self.axes[1]))
    }

    /// The cell of a place that is in the polygon.
    fn cell_at(&self, flat: DVec2) -> Option<usize> {
        let place = (flat / self.finest.edge).floor();
        let (columns, rows) = (self.finest.columns, self.finest.cells.len() / self.finest.columns);
        // NaN fails the comparison.
        let is_in = place.min_element() >= 0.0 && place.x < columns as f64 && place.y < rows as f64;
        (is_in && contains(&self.polygon, flat)).then(|| place.y as usize * columns + place.x as usize)
    }

    /// Whether a point is above or below the polygon.
    pub fn covers(&self, point: DVec3) -> bool {
        self.cell_at(self.flat(point)).is_some()
    }

    /// Takes a point into account, if it is above or below the polygon.
    pub fn add(&mut self, point: DVec3) {
        let flat = self.flat(point);
        let edge = self.finest.edge;
        let Some(cell) = self.cell_at(flat) else { return };
        let height = ((point - self.origin).dot(self.axes[2]) - self.base - self.slope.dot(flat)) / edge;
        if height.abs() <= MOST_HEIGHT {
            let cell = &mut self.finest.cells[cell];
            let steps = (height / STEP).round() as i64;
            cell.points = cell.points.saturating_add(1);
            cell.sum += steps;
            cell.squares += i128::from(steps) * i128::from(steps);
            let at = (flat / edge / STEP).round().to_array();
            cell.at = [0, 1].map(|axis| cell.at[axis].saturating_add(at[axis] as i64));
        }
    }

    pub fn volume(&self) -> Volume {
        let mut level = self.finest.clone();
        while !level.is_coarse() {
            level = level.coarser();
        }
        let mut coarser: Vec<Level> = Vec::new();
        for _ in 0..FILLING_LEVELS {
            coarser.push(coarser.last().unwrap_or(&level).coarser());
        }
        let (mut above, mut below, mut points) = (0.0, 0.0, 0);
        let [mut whole_area, mut empty_area, mut filled_area] = [0.0; 3];
        // The squares of heights about the means of cells; the weights of the means in the volume.
        let (mut squares, mut free, mut weights) = (0.0, 0.0, 0.0);
        let unit = STEP * self.finest.edge;
        for (index, own) in level.cells.iter().enumerate() {
            let [x, y] = [index % level.columns, index / level.columns];
            let low = DVec2::new(x as f64, y as f64) * level.edge;
            let part = clipped(&self.polygon, low, low + level.edge);
            let area = area(&part).abs();
            whole_area += area;
            let around =
                coarser.iter().zip(1..).map(|(level, step)| level.cells[(y >> step) * level.columns + (x >> step)]);
            let Some(cell) = std::iter::once(*own).chain(around).find(|cell| cell.points > 0) else {
                empty_area += area;
                continue;
            };
            let count = f64::from(cell.points);
            // The points of a cell need not lie about the middle of its part of the polygon: on a lattice they do not.
            let aside = level.mean(index).map_or(DVec2::ZERO, |(_, at)| middle(&part) / unit - at);
            let height = (cell.sum as f64 / count + level.slope(index).dot(aside)) * unit;
            above += area * height.max(0.0);
            below += area * (-height).max(0.0);
            weights += area * area / count;
            if own.points > 0 {
                points += u64::from(own.points);
                // Exact in whole numbers: n times the sum of squares less the square of the sum.
                let about = i128::from(own.points) * own.squares - i128::from(own.sum) * i128::from(own.sum);
                squares += about as f64 / count * unit * unit;
                free += count - 1.0;
            } else {
                filled_area += area;
            }
        }
        let deviation = if free > 0.0 { (squares / free * weights).sqrt() } else { f64::NAN };
        Volume { above, below, deviation, area: whole_area, empty_area, filled_area, cell: level.edge, points }
    }
}

/// The plane through corners; three have exactly one.
fn plane_of(corners: &[DVec3]) -> Result<(DVec3, DVec3)> {
    if let [a, b, c] = corners {
        return (*b - *a).cross(*c - *a).try_normalize().map(|normal| (*a, normal)).ok_or(Error::NoArea);
    }
    plane(corners).map(|plane| (plane.center, plane.normal))
}

fn reach(polygon: &[DVec2]) -> (DVec2, DVec2) {
    let low = polygon.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = polygon.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    (low, high)
}

/// The area of a polygon, positive if its corners go around to the left.
fn area(polygon: &[DVec2]) -> f64 {
    let Some(first) = polygon.first() else { return 0.0 };
    polygon.windows(2).map(|ends| (ends[0] - *first).perp_dot(ends[1] - *first)).sum::<f64>() * 0.5
}

/// The centre of a polygon's area; of one without area, of its corners.
fn middle(polygon: &[DVec2]) -> DVec2 {
    let Some(first) = polygon.first() else { return DVec2::ZERO };
    let mean = polygon.iter().sum::<DVec2>() / polygon.len() as f64;
    let triangle = |ends: &[DVec2]| {
        let doubled = (ends[0] - *first).perp_dot(ends[1] - *first);
        (doubled, (*first + ends[0] + ends[1]) / 3.0 * doubled)
    };
    let (doubled, moments) = polygon
        .windows(2)
        .map(triangle)
        .fold((0.0, DVec2::ZERO), |(areas, moments), (area, moment)| (areas + area, moments + moment));
    let center = moments / doubled;
    if center.is_finite() { center } else { mean }
}

/// Whether a place is in a polygon: a ray from it crosses the border an odd number of times.
fn contains(polygon: &[DVec2], place: DVec2) -> bool {
    let sides = polygon.iter().zip(polygon.iter().cycle().skip(1));
    let crosses = |(a, b): &(&DVec2, &DVec2)| {
        (a.y > place.y) != (b.y > place.y) && place.x < a.x + (place.y - a.y) / (b.y - a.y) * (b.x - a.x)
    };
    sides.filter(crosses).count() % 2 == 1
}

/// The part of a polygon in a rectangle (Sutherland and Hodgman 1974). Parts of a polygon that is not convex may be
/// joined by lines there and back, which have no area.
fn clipped(polygon: &[DVec2], low: DVec2, high: DVec2) -> Vec<DVec2> {
    let limits = [(DVec2::X, high.x), (-DVec2::X, -low.x), (DVec2::Y, high.y), (-DVec2::Y, -low.y)];
    limits.into_iter().fold(polygon.to_vec(), |corners, (outward, limit)| {
        let mut kept = Vec::with_capacity(corners.len() + 4);
        for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
            let (a, b) = (from.dot(outward) - limit, to.dot(outward) - limit);
            if a <= 0.0 {
                kept.push(*from);
            }
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                kept.push(from.lerp(*to, a / (a - b)));
            }
        }
        kept
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::tests::Dice;

    const PLACE: DVec3 = DVec3::new(635_000.0, 5_077_000.0, 120.0);

    /// An L of two squares of edge 2 and one of edge 2 beside the lower one; its area is 12.
    fn ell() -> Vec<DVec3> {
        [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 4.0], [0.0, 4.0]]
            .map(|[x, y]| PLACE + DVec3::new(x, y, 0.0))
            .to_vec()
    }

    fn filled(mut grid: VolumeGrid, dice: &mut Dice, count: usize, height: impl Fn(f64, f64) -> f64) -> Volume {
        for _ in 0..count {
            let (x, y) = (dice.share() * 6.0 - 1.0, dice.share() * 6.0 - 1.0);
            let height = height(x, y) + dice.noise(0.01);
            grid.add(PLACE + DVec3::new(x, y, height));
        }
        grid.volume()
    }

    #[test]
    fn volumes_of_a_slab_a_ramp_and_a_pyramid_are_those_of_their_formulas() {
        let mut dice = Dice::new(7);
        let grid = || VolumeGrid::new(&ell(), Some(120.0), DVec3::Z).unwrap();
        let slab = filled(grid(), &mut dice, 200_000, |_, _| 0.5);
        assert!((slab.area - 12.0).abs() < 1e-6 && slab.empty_area < 0.01, "{slab:?}");
        assert!((slab.above - 6.0).abs() < 4.0 * slab.deviation && slab.below == 0.0, "{slab:?}");
        // 12 square units, 66,667 points within, noise 0.01.
        assert!((slab.deviation / (12.0 * 0.01 / 66_667.0_f64.sqrt()) - 1.0).abs() < 0.1, "{slab:?}");
        // A ramp from -1 to 3 along x: the volume is the area times the height at the middle of the area, 10/6 - 1.
        let ramp = filled(grid(), &mut dice, 200_000, |x, _| x - 1.0);
        assert!((ramp.above - ramp.below - 12.0 * (10.0 / 6.0 - 1.0)).abs() < 4.0 * ramp.deviation, "{ramp:?}");
        // Below the plane is a wedge, 4 long and 1 high at the end.
        assert!((ramp.below - 2.0).abs() < 0.03, "{ramp:?}");
        let pyramid = |x: f64, y: f64| (1.0 - (x - 1.0).abs().max((y - 1.0).abs())).max(0.0) * 0.9;
        let pyramid = filled(grid(), &mut dice, 400_000, pyramid);
        assert!((pyramid.above - pyramid.below - 4.0 * 0.9 / 3.0).abs() < 4.0 * pyramid.deviation, "{pyramid:?}");
    }

    #[test]
    fn a_slope_has_no_volume_over_its_own_corners_in_any_order_of_points() {
        let height = |x: f64, y: f64| 0.3 * x - 0.2 * y;
        let corners: Vec<DVec3> = ell()
            .into_iter()
            .map(|corner| corner + DVec3::Z * height(corner.x - PLACE.x, corner.y - PLACE.y))
            .collect();
        for corners in [&corners[..], &corners[..3]] {
            let mut dice = Dice::new(8);
            let grid = VolumeGrid::new(corners, None, DVec3::Z).unwrap();
            let slope = filled(grid, &mut dice, 100_000, height);
            assert!((slope.above - slope.below).abs() < 4.0 * slope.deviation, "{slope:?}");
        }
        let points: Vec<DVec3> = (0..5000).map(|i| PLACE + DVec3::new(0.1, 0.2, 0.001) * f64::from(i % 37)).collect();
        let of = |points: &mut dyn Iterator<Item = &DVec3>| {
            let mut grid = VolumeGrid::new(&corners, None, DVec3::Z).unwrap();
            points.for_each(|point| grid.add(*point));
            grid.volume()
        };
        assert_eq!(of(&mut points.iter()), of(&mut points.iter().rev()));
    }

    #[test]
    fn a_lattice_on_a_slope_has_the_volume_of_the_slope() {
        // Points on the borders of cells belong to the cell on one side.
        let square = [[4.0, 4.0], [12.0, 4.0], [12.0, 12.0], [4.0, 12.0]].map(|[x, y]| PLACE + DVec3::new(x, y, 0.0));
        let mut grid = VolumeGrid::new(&square, Some(110.0), DVec3::Z).unwrap();
        for i in 0..201 * 201 {
            let (x, y) = (f64::from(i % 201) * 0.1, f64::from(i / 201) * 0.1);
            grid.add(PLACE + DVec3::new(x, y, 0.25 * x - 0.5 * y));
        }
        let volume = grid.volume();
        assert!((volume.above - 64.0 * (10.0 - 2.0)).abs() < 0.01, "{volume:?}");
    }

    #[test]
    fn parts_without_points_add_nothing_and_are_told() {
        let mut dice = Dice::new(9);
        let mut grid = VolumeGrid::new(&ell(), Some(119.0), DVec3::Z).unwrap();
        for _ in 0..1000 {
            grid.add(PLACE + DVec3::new(dice.share() * 2.0, dice.share() * 4.0, 2.0));
        }
        grid.add(DVec3::NAN);
        let volume = grid.volume();
        assert_eq!((volume.points, volume.below), (1000, 0.0));
        assert!((volume.above - 8.0 * 3.0).abs() < 1e-5 && (volume.empty_area - 4.0).abs() < 1e-6, "{volume:?}");
        assert_eq!(volume.cell, 0.5);
        let empty = VolumeGrid::new(&ell(), None, DVec3::Z).unwrap().volume();
        assert_eq!((empty.points, empty.above), (0, 0.0));
        assert!(empty.deviation.is_nan() && (empty.empty_area - 12.0).abs() < 1e-6, "{empty:?}");
    }

    #[test]
    fn cells_that_take_the_height_of_those_around_them_are_told() {
        let mut dice = Dice::new(11);
        let square = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]].map(|[x, y]| PLACE + DVec3::new(x, y, 0.0));
        let mut grid = VolumeGrid::new(&square, Some(119.0), DVec3::Z).unwrap();
        for _ in 0..6000 {
            let (x, y) = (dice.share() * 4.0, dice.share() * 4.0);
            // A hole of the size of a few cells.
            if !((1.0..1.5).contains(&x) && (1.0..1.5).contains(&y)) {
                grid.add(PLACE + DVec3::new(x, y, 2.0));
            }
        }
        let volume = grid.volume();
        assert!(volume.cell <= 0.5 && volume.empty_area == 0.0, "{volume:?}");
        assert!((volume.filled_area - 0.25).abs() < 1e-6 && (volume.above - 16.0 * 3.0).abs() < 1e-5, "{volume:?}");
    }

    #[test]
    fn boxes_beside_the_polygon_are_not_wanted() {
        let grid = VolumeGrid::new(&ell(), None, DVec3::Z).unwrap();
        let around = |x: f64, y: f64| {
            let middle = PLACE + DVec3::new(x, y, 50.0);
            grid.wants(Bounds { min: middle - 0.5, max: middle + 0.5 })
        };
        assert!(around(2.0, 2.0) && around(-0.4, 4.4) && !around(-0.6, 2.0) && !around(2.0, 4.6));
        assert!(!grid.wants(Bounds::EMPTY));
    }

    #[test]
    fn what_has_no_volume_is_refused() {
        let grid = |corners: &[DVec3]| VolumeGrid::new(corners, None, DVec3::Z).map(drop);
        assert!(matches!(grid(&ell()[..2]), Err(Error::TooFew { points: 2, least: 3 })));
        assert!(matches!(grid(&[DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Z]), Err(Error::NoArea)));
        assert!(matches!(grid(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0]), Err(Error::NoArea)));
        assert!(matches!(grid(&[DVec3::ZERO, DVec3::X, DVec3::NAN]), Err(Error::NoArea)));
        let crossed = [DVec3::ZERO, DVec3::new(2.0, 2.0, 0.0), DVec3::X * 2.0, DVec3::new(0.0, 1.0, 0.0)];
        assert!(matches!(grid(&crossed), Err(Error::Crossed)));
    }
}
