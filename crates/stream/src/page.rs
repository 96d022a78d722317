//! The format of a page: one column after the other, points in batch order.
//!
//! Positions are lattice integers relative to the page's own corner, with as many bits per axis as its extent needs,
//! packed into whole bytes: 32 m by 32 m by 8 m on a millimetre grid take 6 bytes a point.

use std::sync::Arc;

use cloud::{Chunk, Column, Grid, amid};
use glam::DVec3;

use crate::batches;
use crate::lattice::Lattice;
use crate::records::{Layout, each_type};

/// The size in bytes of a position of more than 128 bits: it is written as three 64-bit integers.
const WIDE: usize = 24;

/// The extent of a page's points; it also determines how their positions are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The least lattice integers.
    pub corner: [i64; 3],
    /// The greatest lattice integers, never less than those of the corner.
    pub far: [i64; 3],
}

impl Place {
    fn extent(&self, axis: usize) -> u64 {
        self.far[axis].abs_diff(self.corner[axis])
    }

    /// The number of bits per axis, x lowest.
    fn bits(&self) -> [u32; 3] {
        std::array::from_fn(|axis| u64::BITS - self.extent(axis).leading_zeros())
    }

    /// The size of a position in bytes.
    fn position_bytes(&self) -> usize {
        match self.bits().iter().sum::<u32>() {
            bits @ 0..=128 => bits.div_ceil(8) as usize,
            _ => WIDE,
        }
    }

    /// The size of a page in bytes.
    pub fn length(&self, layout: &Layout, points: usize) -> usize {
        points * (self.position_bytes() + layout.widths().sum::<usize>())
    }

    fn at_steps(&self, steps: [u64; 3]) -> [i64; 3] {
        std::array::from_fn(|axis| self.corner[axis].wrapping_add_unsigned(steps[axis]))
    }

    fn write(&self, at: impl Iterator<Item = [i64; 3]>, bytes: &mut Vec<u8>) {
        let [x, y, _] = self.bits();
        let steps = |at: [i64; 3]| -> [u64; 3] { std::array::from_fn(|axis| at[axis].abs_diff(self.corner[axis])) };
        match self.position_bytes() {
            0 => {}
            // Copying is much faster with a fixed length.
            length @ 1..=8 => at.map(steps).for_each(|[a, b, c]| {
                let word = (shifted(b, x) | shifted(c, x + y) | a).to_le_bytes();
                match length {
                    5 => bytes.extend_from_slice(&word[..5]),
                    6 => bytes.extend_from_slice(&word[..6]),
                    7 => bytes.extend_from_slice(&word[..7]),
                    8 => bytes.extend_from_slice(&word),
                    _ => bytes.extend_from_slice(&word[..length]),
                }
            }),
            WIDE => at.for_each(|at| at.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()))),
            length => at.map(steps).for_each(|[a, b, c]| {
                let wide = |value: u64, bits: u32| u128::from(value).checked_shl(bits).unwrap_or(0);
                let word = (wide(b, x) | wide(c, x + y) | u128::from(a)).to_le_bytes();
                bytes.extend_from_slice(&word[..length]);
            }),
        }
    }

    /// Calls `give` with the lattice integers of all points, in order.
    fn read(&self, points: usize, bytes: &[u8], mut give: impl FnMut([i64; 3])) {
        let [x, y, z] = self.bits();
        match self.position_bytes() {
            0 => (0..points).for_each(|_| give(self.corner)),
            length @ 1..=8 => {
                let mut unpack = |word: [u8; 8]| {
                    let word = u64::from_le_bytes(word);
                    let part = |skip: u32, bits: u32| word.checked_shr(skip).unwrap_or(0) & ones(bits);
                    give(self.at_steps([part(0, x), part(x, y), part(x + y, z)]));
                };
                // Reads eight bytes at once, of which the last belong to the next point; the last points are read one
                // by one.
                let whole = points.saturating_sub(8usize.div_ceil(length));
                for index in 0..whole {
                    let mut word = [0; 8];
                    word.copy_from_slice(&bytes[index * length..index * length + 8]);
                    unpack(word);
                }
                for bytes in bytes[whole * length..].chunks_exact(length) {
                    let mut word = [0; 8];
                    word[..length].copy_from_slice(bytes);
                    unpack(word);
                }
            }
            WIDE => bytes.as_chunks::<8>().0.as_chunks::<3>().0.iter().for_each(|at| give(at.map(i64::from_le_bytes))),
            length => bytes.chunks_exact(length).for_each(|bytes| {
                let mut word = [0; 16];
                word[..length].copy_from_slice(bytes);
                let word = u128::from_le_bytes(word);
                let part = |skip: u32, bits: u32| word.checked_shr(skip).unwrap_or(0) as u64 & ones(bits);
                give(self.at_steps([part(0, x), part(x, y), part(x + y, z)]));
            }),
        }
    }

    /// The lattice integers that offsets are relative to: the middle, which keeps offsets short; in a page too large
    /// for that, a place amid most points.
    fn origin(&self, points: usize, bytes: &[u8]) -> [i64; 3] {
        if self.fits_f32() {
            return self.at_steps([0, 1, 2].map(|axis| self.extent(axis) / 2));
        }
        let mut all = Vec::with_capacity(points);
        self.read(points, bytes, |at| all.push(at));
        let place = |index: usize| DVec3::from(all[index].map(|value| value as f64));
        amid(points, place).map_or(self.corner, |amid| all[amid.index])
    }

    /// Whether f32 offsets from the middle are exact.
    pub fn fits_f32(&self) -> bool {
        (0..3).all(|axis| self.extent(axis) < Grid::F32_STEPS)
    }
}

fn shifted(value: u64, bits: u32) -> u64 {
    value.checked_shl(bits).unwrap_or(0)
}

fn ones(bits: u32) -> u64 {
    u64::MAX.checked_shr(u64::BITS - bits).unwrap_or(0)
}

/// Writes a page of `records`, which are in the order of the Morton curve.
pub fn encode(layout: &Layout, records: &[u8]) -> (Place, Vec<u8>) {
    let stride = layout.stride();
    let points = records.len() / stride;
    let mut place = Place { corner: [i64::MAX; 3], far: [i64::MIN; 3] };
    for record in records.chunks_exact(stride) {
        let at = layout.at(record);
        for axis in 0..3 {
            place.corner[axis] = place.corner[axis].min(at[axis]);
            place.far[axis] = place.far[axis].max(at[axis]);
        }
    }
    let mut bytes = Vec::with_capacity(place.length(layout, points));
    let ordered = || batches::order(points).map(|rank| &records[rank * stride..(rank + 1) * stride]);
    place.write(ordered().map(|record| layout.at(record)), &mut bytes);
    let mut start = layout.position_bytes();
    for width in layout.widths() {
        let end = start + width;
        match width {
            // Copying is much faster with a fixed length.
            0 => {}
            1 => bytes.extend(ordered().map(|record| record[start])),
            2 => ordered().for_each(|record| bytes.extend_from_slice(&[record[start], record[start + 1]])),
            3 => ordered()
                .for_each(|record| bytes.extend_from_slice(&[record[start], record[start + 1], record[start + 2]])),
            _ => ordered().for_each(|record| bytes.extend_from_slice(&record[start..end])),
        }
        start = end;
    }
    (place, bytes)
}

/// Reads the points of a page. `bytes` has the length that `Place::length` gives. `exact`: the lattice is the files'
/// own grid, so the precision that f32 offsets lose is kept beside them.
pub fn decode(
    layout: &Layout,
    lattice: &Lattice,
    place: &Place,
    points: usize,
    first_point: u64,
    exact: bool,
    bytes: &[u8],
) -> Chunk {
    let (positions, mut rest) = bytes.split_at(points * place.position_bytes());
    let scale = lattice.grid.scale.to_array();
    let origin = place.origin(points, positions);
    let mut offsets = Vec::with_capacity(points);
    place.read(points, positions, |at| {
        offsets.push(std::array::from_fn(|axis| (at[axis].wrapping_sub(origin[axis]) as f64 * scale[axis]) as f32));
    });
    let mut chunk = Chunk::new(first_point, lattice.world(origin), offsets);
    if exact && !place.fits_f32() {
        let mut all = Vec::with_capacity(points);
        place.read(points, positions, |at| all.push(lattice.world(at).to_array()));
        chunk.exact_positions = Some(Arc::new(all));
    }

    let mut take = |width: usize| {
        let (column, after) = rest.split_at(points * width);
        rest = after;
        column
    };
    let colors = take(layout.color_bytes);
    match layout.color_bytes {
        3 => {
            let opaque = |color: &[u8; 3]| [color[0], color[1], color[2], 255];
            chunk.colors = Some(Arc::new(colors.as_chunks::<3>().0.iter().map(opaque).collect()));
        }
        4 => chunk.colors = Some(Arc::new(colors.as_chunks::<4>().0.to_vec())),
        _ => {}
    }
    if layout.normals {
        let normals = take(4).as_chunks::<4>().0;
        chunk.normals = Some(Arc::new(normals.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect()));
    }
    for attribute in &layout.attributes {
        let mut column = Column::with_capacity(attribute.column_type, points);
        let bytes = take(attribute.column_type.size());
        each_type!(&mut column, Number, values => {
            let numbers = bytes.as_chunks::<{ size_of::<Number>() }>().0;
            values.extend(numbers.iter().map(|bytes| Number::from_le_bytes(*bytes)));
        });
        chunk.columns.push(Some(Arc::new(column)));
    }
    chunk
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_of_any_extent_come_back() {
        for bits in 0..=63 {
            for (x, y, z) in [(bits, bits, bits), (bits, 0, 1), (0, bits, 63 - bits), (bits, 63, 63)] {
                let far = |bits: u32| ((1_u64 << bits) - 1) as i64;
                let place = Place { corner: [-5, 7, i64::MIN], far: [0; 3] };
                let far = [far(x), far(y), far(z)];
                let place = Place { far: std::array::from_fn(|a| place.corner[a].saturating_add(far[a])), ..place };
                let middle: [i64; 3] = place.at_steps([0, 1, 2].map(|axis| place.extent(axis) / 3));
                for points in [1, 2, 9, 20] {
                    let all: Vec<[i64; 3]> = (0..points).map(|i| [place.corner, place.far, middle][i % 3]).collect();
                    let mut bytes = Vec::new();
                    place.write(all.iter().copied(), &mut bytes);
                    assert_eq!(bytes.len(), points * place.position_bytes());
                    let mut back = Vec::new();
                    place.read(points, &bytes, |at| back.push(at));
                    assert_eq!(back, all, "{x} {y} {z} bits");
                }
            }
        }
    }
}
