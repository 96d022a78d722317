//! Divides the box around the points of a chunk into cells, so that a test of places looks at most points a cell at a
//! time.

use glam::{DVec3, U16Vec3, Vec3};

use crate::{Bounds, Chunk, Cover};

/// The number of cells along each axis.
const ACROSS: u16 = 16;
/// How far a cell reaches beyond its sides, as a share of its width: f32 rounds the numbers of cells.
const MARGIN: f64 = 1.0 / 64.0;

/// The cells of a chunk, with the cover of each that has been asked for.
pub struct Cells<'a, Find> {
    positions: &'a [[f32; 3]],
    low: Vec3,
    per_unit: Vec3,
    min: DVec3,
    /// The size of a cell.
    size: DVec3,
    covers: Vec<Option<Cover>>,
    find: Find,
}

impl<'a, Find: Fn(Bounds) -> Cover> Cells<'a, Find> {
    /// `bounds` are those of the points. `find` says how many of the points in a part of them are kept.
    pub fn new(chunk: &'a Chunk, bounds: Bounds, find: Find) -> Self {
        let size = bounds.size() / f64::from(ACROSS);
        // The farthest points are still in the last cell; where all have the same coordinate, one cell has them.
        let per_unit = size.map(|size| if size > 0.0 { 0.99999 / size } else { 0.0 }).as_vec3();
        let low = (bounds.min - chunk.origin).as_vec3();
        let covers = vec![None; usize::from(ACROSS).pow(3)];
        Self { positions: &chunk.positions, low, per_unit, min: bounds.min, size, covers, find }
    }

    /// Whether a point is kept, as far as its cell decides that.
    #[inline]
    pub fn cover(&mut self, point: usize) -> Cover {
        let place = Vec3::from(self.positions[point]);
        let at = (place - self.low) * self.per_unit;
        // What is not a number has no cell.
        if !(at.min_element() >= 0.0 && at.max_element() < f32::from(ACROSS) && !at.is_nan()) {
            return Cover::Partly;
        }
        let cell = at.as_u16vec3();
        let index = cell.to_array().iter().fold(0, |index, cell| index * usize::from(ACROSS) + usize::from(*cell));
        match self.covers[index] {
            Some(cover) => cover,
            None => self.find(cell, index),
        }
    }

    #[cold]
    fn find(&mut self, cell: U16Vec3, index: usize) -> Cover {
        let cell = cell.as_dvec3();
        let min = self.min + (cell - MARGIN) * self.size;
        let cover = (self.find)(Bounds { min, max: self.min + (cell + 1.0 + MARGIN) * self.size });
        self.covers[index] = Some(cover);
        cover
    }
}
