//! The free space of a building that was scanned: where an eye can be without passing a wall.

use std::collections::HashMap;

use glam::DVec3;

/// Cells of the ground plan over which a ceiling hangs. Each is free from its floor up to its ceiling.
#[derive(Clone, Debug, PartialEq)]
pub struct Interior {
    /// Two horizontal axes and the vertical one, unit vectors.
    pub(crate) axes: [DVec3; 3],
    /// The low corner of cell (0, 0) along the axes.
    pub(crate) corner: DVec3,
    /// The width of a cell in world units.
    pub(crate) edge: f64,
    /// The heights of floor and ceiling along the vertical axis.
    pub(crate) cells: HashMap<(i32, i32), [f64; 2]>,
}

impl Interior {
    /// Whether a place in world coordinates is free.
    pub fn contains(&self, place: DVec3) -> bool {
        self.is_free(place, 0)
    }

    /// Whether a place is free, or beside free space of this height: furniture and frames of doors fill cells.
    pub fn surrounds(&self, place: DVec3) -> bool {
        self.is_free(place, 1)
    }

    fn is_free(&self, place: DVec3, reach: i32) -> bool {
        let local = DVec3::from(self.axes.map(|axis| axis.dot(place)));
        let cell = ((local - self.corner) / self.edge).floor();
        let (x, y) = (cell.x as i32, cell.y as i32);
        let is_free = |cell: (i32, i32)| {
            self.cells.get(&cell).is_some_and(|[floor, ceiling]| (*floor..*ceiling).contains(&local.z))
        };
        let row = |dy: i32| (-reach..=reach).any(|dx| is_free((x.saturating_add(dx), y.saturating_add(dy))));
        local.is_finite() && (-reach..=reach).any(row)
    }
}
