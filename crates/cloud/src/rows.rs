//! The ellipses of points that were scanned in rows.
//!
//! A scanner measures in even steps of two angles. Where a surface is seen at a grazing angle the rows of the scan are
//! drawn apart: along a row the points are as close as ever, and the next row is many steps away. The nearest points of
//! such a point lie in its own row, which has no normal, and whose discs reach no other row. So the rows beside it are
//! searched, and the splat is an ellipse from row to row in the plane through them.
//!
//! Where rows of two stations lie between one another, all neighbours together form no line, but the nearest ones do. Most
//! of such points see the rows on both sides among their neighbours already, and only others ask for a search.

use glam::Vec3;

use crate::Stretch;
use crate::neighbours::{Neighbourhood, is_aside};

/// The half axes of an ellipse in spacings: a little more than what closes a grid (0.71).
const CLOSING: f32 = 0.75;
/// Beside the last row of a surface, the half axis in spacings: up to the middle of the way to the next row.
const BORDER: f32 = 0.5;
/// The nearest neighbours are a row if so many of them are within 15 degrees of one line (by the squared cosine) ...
const FEWEST_NEAR: usize = 4;
/// ... and nearer than all others.
const NEAR_LINE: f32 = 0.933;
/// Rows by the nearest neighbours alone make ellipses that are longer than wide by so much; less is packed as a disc.
const LEAST_RATIO: f32 = 2.75;
/// The fewest points of a row: others beside a point lie there by chance.
const FEWEST_IN_ROW: usize = 2;
/// Points belong to the nearest row up to this multiple of its distance.
const SAME_ROW: f32 = 1.4;
/// The most that points of a row are beside its plane, relative to its distance.
const FLAT: f32 = 0.25;
/// The two rows beside a point are on one plane if the angle between the ways to them is straight within 20 degrees.
const STRAIGHT: f32 = -0.94;
/// Rows that are no further apart than so many spacings are one row.
const NARROWEST: f32 = 2.0;
/// Rows that are further apart, in spacings along them, are not of one surface, like wires side by side: scanners that
/// graze a surface within 3 degrees measure next to nothing, and where rows of two stations coincide, points are twice as
/// close along them.
const FARTHEST: f32 = 40.0;

/// The row that a point is in.
pub(crate) struct Line {
    /// The unit direction.
    pub axis: Vec3,
    /// The mean distance between its points.
    spacing: f32,
    /// The least ratio of an ellipse.
    least: f32,
}

impl Line {
    /// The row along the unit vector `axis` that neighbours of a point are in.
    pub(crate) fn along(axis: Vec3, offsets: impl Iterator<Item = Vec3>) -> Self {
        let along = offsets.filter(|offset| !is_aside(*offset, axis)).map(|offset| offset.dot(axis));
        let (count, low, high) =
            along.fold((0, 0.0_f32, 0.0_f32), |(count, low, high), along| (count + 1, low.min(along), high.max(along)));
        Self { axis, spacing: (high - low) / count as f32, least: 0.0 }
    }

    /// The row that the nearest neighbours are in, whatever lies beyond them.
    pub(crate) fn of_nearest(around: &Neighbourhood) -> Option<Self> {
        let first = around.first()?;
        let narrow = NEAR_LINE * first.length_squared();
        // Which neighbours are near the line, the nearest that is not, and how many are nearer than that.
        let is_near_line = |offset: Vec3| offset.dot(first).powi(2) >= narrow * offset.length_squared();
        let beside =
            around.offsets().map(|offset| if is_near_line(offset) { f32::INFINITY } else { offset.length_squared() });
        let limit = beside.fold(f32::INFINITY, f32::min);
        let row = around.offsets().filter(|offset| offset.length_squared() < limit);
        if row.clone().count() < FEWEST_NEAR {
            return None;
        }
        let axis = row.clone().map(|offset| if offset.dot(first) < 0.0 { -offset } else { offset }).sum::<Vec3>();
        Some(Self { least: LEAST_RATIO, ..Self::along(axis.try_normalize()?, row) })
    }

    /// Adds the ways across the row to those of some points that are aside from it in other rows.
    pub(crate) fn add_across(&self, points: &Neighbourhood, ways: &mut Vec<Vec3>) {
        let narrowest = (NARROWEST * self.spacing).powi(2);
        for offset in points.offsets().filter(|offset| is_aside(*offset, self.axis)) {
            let way = offset - offset.dot(self.axis) * self.axis;
            if way.length_squared() >= narrowest {
                ways.push(way);
            }
        }
    }

    /// How far away rows of this surface may be.
    pub(crate) fn reach(&self) -> f32 {
        2.0 * FARTHEST * self.spacing
    }

    /// The splat of a point in the row by the ways across to the neighbours in other rows; `search` adds ways to the
    /// nearest points on the side of a vector (on all sides if it is zero). `None` where these form no rows on one plane
    /// (that of `normal`, if the point has one), and where rows are no further apart than their points.
    pub(crate) fn splat(
        &self,
        ways: &mut Vec<Vec3>,
        mut search: impl FnMut(Vec3, &mut Vec<Vec3>),
        normal: Option<Vec3>,
    ) -> Option<RowSplat> {
        let mut sides = Sides::of(ways);
        for _ in 0..2 {
            let Some(bare) = sides.bare() else { break };
            ways.retain(|way| way.dot(bare) < 0.0);
            search(bare, ways);
            sides = Sides::of(ways);
        }
        if sides.nearest_squared[0].max(sides.nearest_squared[1]) < (self.least * self.spacing).powi(2) {
            return None;
        }
        let splat = row_splat(self.axis, self.spacing, ways, &sides, normal)?;
        (splat.stretch.ratio >= self.least).then_some(splat)
    }
}

/// What lies on the two sides of a row: that of the nearest point aside, and the other.
struct Sides {
    /// The way to the nearest point.
    nearest: Vec3,
    counts: [usize; 2],
    nearest_squared: [f32; 2],
}

impl Sides {
    fn of(ways: &[Vec3]) -> Self {
        let by_length = |a: &&Vec3, b: &&Vec3| a.length_squared().total_cmp(&b.length_squared());
        let nearest = ways.iter().min_by(by_length).copied().unwrap_or_default();
        let mut sides = Self { nearest, counts: [0; 2], nearest_squared: [f32::INFINITY; 2] };
        for way in ways {
            let side = usize::from(way.dot(nearest) <= 0.0);
            sides.counts[side] += 1;
            sides.nearest_squared[side] = sides.nearest_squared[side].min(way.length_squared());
        }
        sides
    }

    /// A direction to the side on which there is no row: zero if there is none on either, `None` if there are two.
    fn bare(&self) -> Option<Vec3> {
        match self.counts.map(|count| count >= FEWEST_IN_ROW) {
            [true, true] => None,
            [true, false] => Some(-self.nearest),
            [false, true] => Some(self.nearest),
            [false, false] => Some(Vec3::ZERO),
        }
    }

    /// The row on one side; `None` if its points do not lie in one plane with the point's own row.
    fn row(&self, side: usize, ways: &[Vec3], normal: Option<Vec3>) -> Option<Row> {
        let farthest = SAME_ROW * SAME_ROW * self.nearest_squared[side];
        let is_in_row =
            |way: &&Vec3| usize::from(way.dot(self.nearest) <= 0.0) == side && way.length_squared() <= farthest;
        let row = || ways.iter().filter(is_in_row);
        let way = row().map(|way| way.normalize_or_zero()).sum::<Vec3>().try_normalize()?;
        let (mut count, mut sum) = (0, 0.0);
        for other in row() {
            let along = other.dot(way);
            if other.length_squared() - along * along > FLAT * FLAT * other.length_squared() {
                return None;
            }
            (count, sum) = (count + 1, sum + along);
        }
        let is_on_plane = normal.is_none_or(|normal| normal.dot(way).abs() <= FLAT);
        (count >= FEWEST_IN_ROW && is_on_plane).then_some(Row { way, distance: sum / count as f32 })
    }
}

/// The splat of a point in a row.
#[derive(Debug, PartialEq)]
pub(crate) struct RowSplat {
    /// The unit normal of the plane through the rows; its sign is arbitrary.
    pub normal: Vec3,
    pub stretch: Stretch,
    /// The half axis across the rows in world units.
    pub long: f32,
}

/// The row beside a point on one side.
struct Row {
    /// The unit direction to it, square to the row.
    way: Vec3,
    distance: f32,
}

/// The splat of a point in a row along the unit vector `axis`, in which points are `spacing` apart, by the ways across to
/// points of other rows.
fn row_splat(axis: Vec3, spacing: f32, ways: &[Vec3], sides: &Sides, normal: Option<Vec3>) -> Option<RowSplat> {
    let (way, long) = match (sides.row(0, ways, normal), sides.row(1, ways, normal)) {
        (Some(a), Some(b)) if a.way.dot(b.way) <= STRAIGHT => {
            // The rows of several stations lie between one another, so that their distances differ.
            ((a.way - b.way).normalize(), CLOSING * a.distance.max(b.distance))
        }
        // At an edge the splat lies in the plane of the nearer row.
        (Some(a), Some(b)) => {
            let nearer = if a.distance <= b.distance { a } else { b };
            (nearer.way, BORDER * nearer.distance)
        }
        (Some(only), None) | (None, Some(only)) => (only.way, BORDER * only.distance),
        (None, None) => return None,
    };
    let way = normal.map_or(Some(way), |normal| (way - way.dot(normal) * normal).try_normalize())?;
    let ratio = long / (CLOSING * spacing);
    let is_in_rows = ratio.is_finite() && ratio < FARTHEST;
    let own = axis.cross(way).try_normalize();
    let normal = normal.or(own).filter(|_| is_in_rows)?;
    Some(RowSplat { normal, stretch: Stretch { axis: way, ratio }, long })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The splat of a point in a row along x whose points are a unit apart, without a search.
    fn splat_of(mut ways: Vec<Vec3>, normal: Option<Vec3>) -> Option<RowSplat> {
        Line { axis: Vec3::X, spacing: 1.0, least: 0.0 }.splat(&mut ways, |_, _| {}, normal)
    }

    /// The ways across from a row along x to the points of other rows, seven in each, `apart` along `way`.
    fn grid(way: Vec3, apart: f32, rows: &[i32]) -> Vec<Vec3> {
        rows.iter().flat_map(|number| [*number as f32 * apart * way; 7]).collect()
    }

    #[test]
    fn ellipses_reach_from_row_to_row_in_their_plane() {
        let way = Vec3::new(0.0, 0.6, 0.8);
        let splat = splat_of(grid(way, 8.0, &[-1, 1]), None).unwrap();
        assert!((splat.long - 6.0).abs() < 1e-5 && (splat.stretch.ratio - 8.0).abs() < 1e-5, "{splat:?}");
        assert!(splat.stretch.axis.dot(way).abs() > 0.9999 && splat.normal.dot(Vec3::X.cross(way)).abs() > 0.9999);
        // Beside the border it ends midway, and it lies in the plane of the point's own normal.
        let border = splat_of(grid(way, 8.0, &[1]), None).unwrap();
        assert!((border.long - 4.0).abs() < 1e-5, "{border:?}");
        let own = splat_of(grid(way, 8.0, &[-1, 1]), Some(Vec3::new(0.0, -0.8, 0.6))).unwrap();
        assert_eq!(own.normal, Vec3::new(0.0, -0.8, 0.6));
    }

    #[test]
    fn what_forms_no_rows_on_a_plane_has_no_ellipse() {
        let none = |ways: Vec<Vec3>, normal: Option<Vec3>| splat_of(ways, normal).is_none();
        assert!(none(Vec::new(), None));
        // Single points; wires far apart; a bundle on one side; rows square to the point's own surface.
        assert!(none(vec![Vec3::new(0.0, 5.0, 0.0), Vec3::new(0.0, -4.0, 1.0)], None));
        assert!(none(grid(Vec3::Y, 50.0, &[-1, 1]), None));
        let bundle = (0..12).map(|i| Vec3::new(0.0, 5.0, i as f32 - 6.0)).collect();
        assert!(none(bundle, None));
        assert!(none(grid(Vec3::Y, 6.0, &[-1, 1]), Some(Vec3::Y)));
    }

    #[test]
    fn at_an_edge_an_ellipse_lies_on_the_nearer_side() {
        let ways = [grid(Vec3::Y, 5.0, &[1]), grid(Vec3::Z, 7.0, &[1])].concat();
        let splat = splat_of(ways, None).unwrap();
        assert!(splat.normal.dot(Vec3::Z).abs() > 0.999 && (splat.long - 2.5).abs() < 1e-5, "{splat:?}");
    }

    #[test]
    fn only_a_side_on_which_no_row_is_known_is_searched() {
        let line = Line { axis: Vec3::X, spacing: 1.0, least: LEAST_RATIO };
        let found = |rows: &[i32], there: &[i32]| {
            let mut sides = Vec::new();
            let search = |side: Vec3, ways: &mut Vec<Vec3>| {
                sides.push(side);
                ways.extend(grid(Vec3::Y, 4.0, there).into_iter().filter(|way| way.dot(side) >= 0.0));
            };
            let splat = line.splat(&mut grid(Vec3::Y, 4.0, rows), search, None);
            (sides, splat.map(|splat| splat.long))
        };
        assert_eq!(found(&[-1, 1], &[]), (Vec::new(), Some(3.0)));
        assert_eq!(found(&[1], &[-2]), (vec![Vec3::NEG_Y * 4.0], Some(6.0)));
        assert_eq!(found(&[], &[-1, 1]), (vec![Vec3::ZERO], Some(3.0)));
        // An ellipse that is hardly longer than wide is none.
        let near = line.splat(&mut grid(Vec3::Y, 2.5, &[-1, 1]), |_, _| {}, None);
        assert_eq!(near, None);
    }
}
