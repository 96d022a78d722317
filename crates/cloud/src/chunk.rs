//! Chunks of points, and the cloud they make up.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::origin::offsets;
use crate::{Attribute, Bounds, Column, Placement, attribute_named, resized_radius};

/// Up to some 65 thousand points. The vectors are behind `Arc`, so a chunk is cheap to clone and one column can be
/// added or replaced (normals that were estimated later) while the others are shared.
///
/// Every column that is present has `len()` entries. A point that is not finite in the file keeps its place with a NaN
/// position, so that indices are those of the file.
#[derive(Clone, Debug)]
pub struct Chunk {
    /// The index in the file of the chunk's first point; the others follow in file order.
    pub first_point: u64,
    /// The world position that `positions` are relative to; it lies amid the points (`amid`).
    pub origin: DVec3,
    /// The offsets from `origin` in world units.
    pub positions: Arc<Vec<[f32; 3]>>,
    /// The file's own coordinates, where f32 offsets cannot represent them (PLY doubles, LAS points millions of steps
    /// apart, strays among floats of maps).
    pub exact_positions: Option<Arc<Vec<[f64; 3]>>>,
    /// sRGB red, green, blue; the fourth byte is opacity (255 where the file has none).
    pub colors: Option<Arc<Vec<[u8; 4]>>>,
    /// The normals, packed by `pack_normal`.
    pub normals: Option<Arc<Vec<u32>>>,
    /// The splat radii, packed by `pack_radius`.
    pub radii: Option<Arc<Vec<u16>>>,
    /// For points that are spread over a mesh, which the file does not have: the index in the file of the corner that
    /// each is nearest to.
    pub corners: Option<Arc<Vec<u32>>>,
    /// The place of the scanner that all of its points were measured from, if that is known, in the coordinates of its
    /// points.
    pub station: Option<DVec3>,
    /// One column for each attribute of the cloud, in its order; `None` until it is read.
    pub columns: Vec<Option<Arc<Column>>>,
}

impl Chunk {
    /// A chunk of positions only.
    pub fn new(first_point: u64, origin: DVec3, positions: Vec<[f32; 3]>) -> Self {
        Self {
            first_point,
            origin,
            positions: Arc::new(positions),
            exact_positions: None,
            colors: None,
            normals: None,
            radii: None,
            corners: None,
            station: None,
            columns: Vec::new(),
        }
    }

    /// A chunk of points at these places, with an origin amid them.
    pub fn of_places(first_point: u64, places: &[DVec3]) -> Self {
        let (origin, offsets) = offsets(places);
        Self::new(first_point, origin, offsets)
    }

    pub fn len(&self) -> usize {
        self.positions.len()
    }

    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// The world position of point `index` to the precision of the f32 offset; `Cloud::world_position` gives the file's
    /// own.
    #[inline]
    pub fn position(&self, index: usize) -> DVec3 {
        self.origin + Vec3::from(self.positions[index]).as_dvec3()
    }

    /// The index in the file of point `index`, or of the corner that it is nearest to.
    pub fn point_in_file(&self, index: usize) -> u64 {
        self.corners.as_ref().map_or(self.first_point + index as u64, |corners| u64::from(corners[index]))
    }

    /// The bounds of the finite points.
    pub fn bounds(&self) -> Bounds {
        let mut min = Vec3::INFINITY;
        let mut max = Vec3::NEG_INFINITY;
        for &position in self.positions.iter() {
            let position = Vec3::from(position);
            if position.is_finite() {
                min = min.min(position);
                max = max.max(position);
            }
        }
        if min.cmpgt(max).any() {
            return Bounds::EMPTY;
        }
        Bounds { min: self.origin + min.as_dvec3(), max: self.origin + max.as_dvec3() }
    }

    /// Some of its points with all their columns as a chunk of their own, in the order of `indices`. Their indices in
    /// the file are no longer consecutive.
    pub fn select(&self, indices: &[u32]) -> Self {
        fn of<T: Copy>(values: &[T], indices: &[u32]) -> Arc<Vec<T>> {
            Arc::new(indices.iter().map(|index| values[*index as usize]).collect())
        }
        Self {
            first_point: self.first_point,
            origin: self.origin,
            positions: of(&self.positions, indices),
            exact_positions: self.exact_positions.as_ref().map(|values| of(values, indices)),
            colors: self.colors.as_ref().map(|values| of(values, indices)),
            normals: self.normals.as_ref().map(|values| of(values, indices)),
            radii: self.radii.as_ref().map(|values| of(values, indices)),
            corners: self.corners.as_ref().map(|values| of(values, indices)),
            station: self.station,
            columns: self.columns.iter().map(|column| Some(Arc::new(column.as_ref()?.select(indices)))).collect(),
        }
    }

    /// The same points with `size` times their radii; it shares everything else.
    pub fn resized(&self, size: f32) -> Self {
        let resized =
            |radii: &Arc<Vec<u16>>| Arc::new(radii.iter().map(|radius| resized_radius(*radius, size)).collect());
        let radii = if size == 1.0 { self.radii.clone() } else { self.radii.as_ref().map(resized) };
        Self { radii, ..self.clone() }
    }

    pub fn size_in_bytes(&self) -> usize {
        let points = self.len();
        points * 12
            + self.exact_positions.as_ref().map_or(0, |_| points * 24)
            + self.colors.as_ref().map_or(0, |_| points * 4)
            + self.normals.as_ref().map_or(0, |_| points * 4)
            + self.radii.as_ref().map_or(0, |_| points * 2)
            + self.corners.as_ref().map_or(0, |_| points * 4)
            + self.columns.iter().flatten().map(|column| column.size_in_bytes()).sum::<usize>()
    }
}

/// The lattice on which a file's coordinates lie: `offset + integer * scale` per axis (LAS).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    pub scale: DVec3,
    pub offset: DVec3,
    /// How the points have been moved from there, if they have.
    pub placement: Option<Placement>,
}

impl Grid {
    /// The number of steps from an origin within which f32 offsets distinguish all points.
    pub const F32_STEPS: u64 = 1 << 23;

    pub const fn new(scale: DVec3, offset: DVec3) -> Self {
        Self { scale, offset, placement: None }
    }

    /// The grid of the file, before its points were moved.
    pub const fn of_file(self) -> Self {
        Self { placement: None, ..self }
    }

    /// The file's grid moved along with its points.
    pub const fn placed(self, placement: Placement) -> Self {
        Self { placement: Some(placement), ..self }
    }

    /// The point of the grid that is nearest.
    fn nearest(&self, position: DVec3) -> DVec3 {
        let own = self.placement.map_or(position, |placement| placement.own_point(position));
        let own = ((own - self.offset) / self.scale).round() * self.scale + self.offset;
        self.placement.map_or(own, |placement| placement.point(own))
    }

    /// How far along each axis the nearest point of the grid may be from an offset that was rounded.
    pub(crate) fn reach(&self) -> DVec3 {
        match self.placement {
            Some(_) => DVec3::splat(self.scale.length()),
            None => self.scale.abs(),
        }
    }

    /// Whether f32 offsets are exact for points within these bounds, so that their chunks need no `exact_positions`.
    pub fn fits_f32(&self, bounds: Bounds) -> bool {
        (bounds.size() / self.scale.abs()).max_element() < Self::F32_STEPS as f64
    }
}

/// A cloud: its chunks in file order, and the names and types of their columns.
#[derive(Clone, Debug, Default)]
pub struct Cloud {
    pub name: String,
    /// The attributes that `Chunk::columns` hold, in order.
    pub attributes: Vec<Attribute>,
    /// The grid, if the file stores scaled integers.
    pub grid: Option<Grid>,
    pub chunks: Vec<Chunk>,
}

impl Cloud {
    /// The same points with `size` times their radii.
    pub fn resized(&self, size: f32) -> Self {
        Self { chunks: self.chunks.iter().map(|chunk| chunk.resized(size)).collect(), ..self.clone() }
    }

    pub fn len(&self) -> u64 {
        self.chunks.iter().map(|chunk| chunk.len() as u64).sum()
    }

    pub fn is_empty(&self) -> bool {
        self.chunks.iter().all(Chunk::is_empty)
    }

    /// The index of an attribute's column, under its own name or another name of the same.
    pub fn column_of(&self, attribute: &str) -> Option<usize> {
        attribute_named(&self.attributes, attribute)
    }

    pub fn bounds(&self) -> Bounds {
        self.chunks.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()))
    }

    /// A point's coordinates as the file has them: exact doubles if the chunk has them, else snapped to the file's
    /// grid. Snapping undoes the rounding of the f32 offset, as chunks wider than 8 million grid steps keep doubles.
    pub fn world_position(&self, chunk: &Chunk, index: usize) -> DVec3 {
        world_position(self.grid.as_ref(), chunk, index)
    }

    pub fn size_in_bytes(&self) -> usize {
        self.chunks.iter().map(Chunk::size_in_bytes).sum()
    }
}

/// See `Cloud::world_position`; `grid` is that of the cloud.
pub(crate) fn world_position(grid: Option<&Grid>, chunk: &Chunk, index: usize) -> DVec3 {
    if let Some(exact) = &chunk.exact_positions {
        return DVec3::from(exact[index]);
    }
    let position = chunk.position(index);
    match grid {
        Some(grid) => grid.nearest(position),
        None => position,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selected_points_keep_all_that_is_known_of_them() {
        let mut chunk = Chunk::new(7, DVec3::X, vec![[0.0; 3], [1.0; 3], [2.0; 3]]);
        chunk.colors = Some(Arc::new(vec![[0; 4], [1; 4], [2; 4]]));
        chunk.radii = Some(Arc::new(vec![10, 11, 12]));
        chunk.columns = vec![None, Some(Arc::new(Column::I16(vec![-1, -2, -3])))];
        let some = chunk.select(&[2, 0]);
        assert_eq!((some.len(), some.position(0), some.position(1)), (2, DVec3::new(3.0, 2.0, 2.0), DVec3::X));
        assert_eq!((some.colors.unwrap()[0], some.radii.unwrap()[0]), ([2; 4], 12));
        assert!(some.normals.is_none() && some.columns[0].is_none());
        assert_eq!(some.columns[1].as_deref(), Some(&Column::I16(vec![-3, -1])));
    }

    #[test]
    fn coordinates_on_a_millimetre_grid_come_back_exactly() {
        let grid = Grid::new(DVec3::splat(0.001), DVec3::new(600_000.0, 5_000_000.0, 0.0));
        let raw = [31_234_567_i64, 77_123_451, -12_345];
        let world = DVec3::new(raw[0] as f64, raw[1] as f64, raw[2] as f64) * grid.scale + grid.offset;
        let origin = DVec3::new(631_000.0, 5_077_000.0, 0.0);
        let chunk = Chunk::new(0, origin, vec![(world - origin).as_vec3().to_array()]);
        let cloud = Cloud { grid: Some(grid), ..Cloud::default() };
        assert_eq!(cloud.world_position(&chunk, 0), world);
        assert_ne!(chunk.position(0), world, "the f32 offset alone is not exact: the test would prove nothing");
    }
}
