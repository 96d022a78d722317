//! The bytes of a page: one column after the other, points in batch order.
//!
//! Positions are lattice integers relative to the page's own corner, in as few bytes as its extent needs: a page of a
//! survey on a millimetre grid that is up to 65 m wide takes 6 bytes a point, a coarser one 8.

use std::sync::Arc;

use cloud::{Chunk, Column};
use glam::DVec3;

use crate::batches;
use crate::lattice::Lattice;
use crate::records::{Layout, each_type};

/// Bits per axis of positions that share a 64-bit word.
const WORD_BITS: u32 = 21;

/// How positions are written: bytes a point takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Coding {
    /// 3 x u16.
    Short = 6,
    /// 3 x 21 bits of one u64, x lowest.
    Word = 8,
    /// 3 x u32.
    Long = 12,
    /// 3 x i64.
    Wide = 24,
}

impl Coding {
    pub fn from_byte(byte: u8) -> Option<Self> {
        [Self::Short, Self::Word, Self::Long, Self::Wide].into_iter().find(|coding| *coding as u8 == byte)
    }

    fn for_extent(extent: u64) -> Self {
        match extent {
            0..=0xffff => Self::Short,
            0x1_0000..=0x1f_ffff => Self::Word,
            0x20_0000..=0xffff_ffff => Self::Long,
            _ => Self::Wide,
        }
    }
}

/// What is needed to read a page besides its bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pub coding: Coding,
    /// Least lattice integers.
    pub corner: [i64; 3],
    /// Greatest lattice integers.
    pub far: [i64; 3],
}

/// Bytes of a page.
pub fn length(layout: &Layout, coding: Coding, points: usize) -> usize {
    points * (coding as usize + layout.widths().sum::<usize>())
}

/// A page of `records`, which are in the order of the Morton curve.
pub fn encode(layout: &Layout, records: &[u8]) -> (Place, Vec<u8>) {
    let stride = layout.stride();
    let points = records.len() / stride;
    let (mut corner, mut far) = ([i64::MAX; 3], [i64::MIN; 3]);
    for record in records.chunks_exact(stride) {
        let at = layout.at(record);
        for axis in 0..3 {
            corner[axis] = corner[axis].min(at[axis]);
            far[axis] = far[axis].max(at[axis]);
        }
    }
    let extent = (0..3).map(|axis| far[axis].abs_diff(corner[axis])).max().unwrap_or(0);
    let coding = Coding::for_extent(extent);
    let mut bytes = Vec::with_capacity(length(layout, coding, points));
    let ordered = || batches::order(points).map(|rank| &records[rank * stride..(rank + 1) * stride]);
    for record in ordered() {
        let at = layout.at(record);
        let offset: [u64; 3] = std::array::from_fn(|axis| at[axis].abs_diff(corner[axis]));
        match coding {
            Coding::Short => {
                let mut six = [0; 6];
                for axis in 0..3 {
                    six[axis * 2..axis * 2 + 2].copy_from_slice(&(offset[axis] as u16).to_le_bytes());
                }
                bytes.extend_from_slice(&six);
            }
            Coding::Word => {
                let word = offset[0] | offset[1] << WORD_BITS | offset[2] << (2 * WORD_BITS);
                bytes.extend_from_slice(&word.to_le_bytes());
            }
            Coding::Long => offset.iter().for_each(|value| bytes.extend_from_slice(&(*value as u32).to_le_bytes())),
            Coding::Wide => at.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes())),
        }
    }
    let mut start = layout.position_bytes();
    for width in layout.widths() {
        let end = start + width;
        match width {
            // Known widths make each copy one instruction.
            1 => bytes.extend(ordered().map(|record| record[start])),
            2 => ordered().for_each(|record| bytes.extend_from_slice(&[record[start], record[start + 1]])),
            3 => ordered()
                .for_each(|record| bytes.extend_from_slice(&[record[start], record[start + 1], record[start + 2]])),
            0 => {}
            _ => ordered().for_each(|record| bytes.extend_from_slice(&record[start..end])),
        }
        start = end;
    }
    (Place { coding, corner, far }, bytes)
}

/// The points of a page of `length` bytes.
pub fn decode(
    layout: &Layout,
    lattice: &Lattice,
    place: &Place,
    points: usize,
    first_point: u64,
    bytes: &[u8],
) -> Chunk {
    // Half-way, rounded to the lattice, so that offsets are short and the origin is in the page.
    let middle: [i64; 3] = std::array::from_fn(|axis| {
        place.corner[axis].wrapping_add_unsigned(place.far[axis].abs_diff(place.corner[axis]) / 2)
    });
    let (positions, rest) = bytes.split_at(points * place.coding as usize);
    let scale = lattice.grid.scale;
    let offset = |at: [i64; 3]| {
        let steps: [f64; 3] = std::array::from_fn(|axis| at[axis].wrapping_sub(middle[axis]) as f64);
        (DVec3::from(steps) * scale).as_vec3().to_array()
    };
    let from_corner =
        |steps: [u64; 3]| std::array::from_fn(|axis| place.corner[axis].wrapping_add_unsigned(steps[axis]));
    let positions: Vec<[f32; 3]> = match place.coding {
        Coding::Short => triples::<2>(positions)
            .map(|triple| offset(from_corner(triple.map(|bytes| u64::from(u16::from_le_bytes(bytes))))))
            .collect(),
        Coding::Word => positions
            .as_chunks::<8>()
            .0
            .iter()
            .map(|bytes| {
                let word = u64::from_le_bytes(*bytes);
                let mask = (1 << WORD_BITS) - 1;
                offset(from_corner([word & mask, word >> WORD_BITS & mask, word >> (2 * WORD_BITS)]))
            })
            .collect(),
        Coding::Long => triples::<4>(positions)
            .map(|triple| offset(from_corner(triple.map(|bytes| u64::from(u32::from_le_bytes(bytes))))))
            .collect(),
        Coding::Wide => triples::<8>(positions).map(|triple| offset(triple.map(i64::from_le_bytes))).collect(),
    };
    let mut chunk = Chunk::new(first_point, lattice.world(middle), positions);

    let mut rest = rest;
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

/// Three numbers of `N` bytes each, and three again.
fn triples<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [[u8; N]; 3]> {
    bytes.as_chunks::<N>().0.as_chunks::<3>().0.iter().copied()
}
