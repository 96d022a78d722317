//! The ellipses of points that were scanned in rows.
//!
//! A scanner measures in even steps of two angles. Where a surface is seen at a grazing angle the rows of the scan are
//! drawn apart: along a row the points are as close as ever, and the next row is many steps away. The nearest points of
//! such a point lie in its own row, which has no normal, and whose discs reach no other row. So the rows beside it are
//! searched, and the splat is an ellipse from row to row in the plane through them.

use glam::Vec3;

use crate::Stretch;

/// The half axes of an ellipse in spacings: a little more than what closes a grid (0.71).
const CLOSING: f32 = 0.75;
/// Beside the last row of a surface, the half axis in spacings: up to the middle of the way to the next row.
const BORDER: f32 = 0.5;
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
/// graze a surface within 3 degrees measure next to nothing.
const FARTHEST: f32 = 20.0;

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

/// The splat of a point in a row along the unit vector `axis`, in which points are `spacing` apart; `beside` are the
/// offsets of the nearest points aside from the row. `None` where they form no rows on one plane (that of `normal`, if
/// the point has one), and where rows are no further apart than their points.
pub(crate) fn row_splat(axis: Vec3, spacing: f32, beside: &[Vec3], normal: Option<Vec3>) -> Option<RowSplat> {
    let across = beside.iter().map(|offset| offset - offset.dot(axis) * axis);
    let across: Vec<Vec3> = across.filter(|way| way.length() >= NARROWEST * spacing).collect();
    let nearest = *across.iter().min_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?;
    let row_of = |side: f32| {
        let ways = || across.iter().copied().filter(move |way| side * way.dot(nearest) > 0.0);
        let reach = SAME_ROW * ways().map(Vec3::length).fold(f32::INFINITY, f32::min);
        let row = || ways().filter(move |way| way.length() <= reach);
        let way = row().map(|way| way.normalize_or_zero()).sum::<Vec3>().try_normalize()?;
        let is_flat = |other: &Vec3| (other - other.dot(way) * way).length() <= FLAT * other.length();
        let is_on_plane = normal.is_none_or(|normal| normal.dot(way).abs() <= FLAT);
        let count = row().filter(is_flat).count();
        let is_row = count >= FEWEST_IN_ROW && count == row().count() && is_on_plane;
        let distance = row().map(|other| other.dot(way)).sum::<f32>() / count as f32;
        is_row.then_some(Row { way, distance })
    };
    let (way, long) = match (row_of(1.0), row_of(-1.0)) {
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

    /// The offsets of a grid's points aside from its own row: rows along x, `apart` from one another along `way`.
    fn grid(way: Vec3, apart: f32, rows: &[i32]) -> Vec<Vec3> {
        let row = |row: i32| (-3..=3).map(move |step| step as f32 * Vec3::X + row as f32 * apart * way);
        rows.iter().flat_map(|number| row(*number)).collect()
    }

    #[test]
    fn ellipses_reach_from_row_to_row_in_their_plane() {
        let way = Vec3::new(0.0, 0.6, 0.8);
        let splat = row_splat(Vec3::X, 1.0, &grid(way, 8.0, &[-1, 1]), None).unwrap();
        assert!((splat.long - 6.0).abs() < 1e-5 && (splat.stretch.ratio - 8.0).abs() < 1e-5, "{splat:?}");
        assert!(splat.stretch.axis.dot(way).abs() > 0.9999 && splat.normal.dot(Vec3::X.cross(way)).abs() > 0.9999);
        // Beside the border it ends midway, and it lies in the plane of the point's own normal.
        let border = row_splat(Vec3::X, 1.0, &grid(way, 8.0, &[1]), None).unwrap();
        assert!((border.long - 4.0).abs() < 1e-5, "{border:?}");
        let own = row_splat(Vec3::X, 1.0, &grid(way, 8.0, &[-1, 1]), Some(Vec3::new(0.0, -0.8, 0.6))).unwrap();
        assert_eq!(own.normal, Vec3::new(0.0, -0.8, 0.6));
    }

    #[test]
    fn what_forms_no_rows_on_a_plane_has_no_ellipse() {
        let none = |beside: &[Vec3], normal: Option<Vec3>| row_splat(Vec3::X, 1.0, beside, normal).is_none();
        assert!(none(&[], None));
        // Single points; wires far apart; a bundle on one side; rows square to the point's own surface.
        assert!(none(&[Vec3::new(0.3, 5.0, 0.0), Vec3::new(0.1, -4.0, 1.0)], None));
        assert!(none(&grid(Vec3::Y, 30.0, &[-1, 1]), None));
        let bundle = (0..12).map(|i| Vec3::new(0.2 * i as f32, 5.0, i as f32 - 6.0)).collect::<Vec<_>>();
        assert!(none(&bundle, None));
        assert!(none(&grid(Vec3::Y, 6.0, &[-1, 1]), Some(Vec3::Y)));
    }

    #[test]
    fn at_an_edge_an_ellipse_lies_on_the_nearer_side() {
        let floor = grid(Vec3::Y, 5.0, &[1]);
        let wall: Vec<Vec3> = (-3..=3).map(|step| Vec3::new(step as f32, 0.0, 7.0)).collect();
        let splat = row_splat(Vec3::X, 1.0, &[floor, wall].concat(), None).unwrap();
        assert!(splat.normal.dot(Vec3::Z).abs() > 0.999 && (splat.long - 2.5).abs() < 1e-5, "{splat:?}");
    }
}
