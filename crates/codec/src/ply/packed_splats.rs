//! Reads the Gaussian splats that SuperSplat and PlayCanvas call compressed PLY: four words a splat, whose positions,
//! scales and colours are fractions of the ranges of its 256 neighbours in the file. Unpacked rows have the properties
//! of splats that are not compressed.

use std::io;

use cloud::ColumnType;

use super::header::{Element, Encoding, Header, Kind, Property};
use super::maker::RowMaker;
use super::reader::Reader;
use super::rows::{self, Block};
use crate::bytes::Bytes;

/// The zeroth spherical harmonic, 1 / (2 sqrt(pi)): it scales `f_dc_*` of a Gaussian splat to a colour (Kerbl et al.
/// 2023).
pub const SH_C0: f32 = 0.282_094_79;

/// The number of splats that have their ranges in common.
const IN_CHUNK: u64 = 256;
const RANGES: [&str; 18] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
    "min_r",
    "min_g",
    "min_b",
    "max_r",
    "max_g",
    "max_b",
];
/// The ranges of colours may be left out: then they are 0 to 1.
const NEEDED_RANGES: usize = 12;
const WORDS: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];
const UNPACKED: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
    "rot_3",
];

#[derive(Debug)]
pub struct PackedSplats {
    /// The vertices with the properties that they have when they are unpacked, all f32.
    element: Element,
    /// The size of a packed vertex in bytes.
    stride: usize,
    /// Where the words are in it.
    words: [usize; 4],
    big_endian: bool,
    /// The ranges of each run of splats, in the order of `RANGES`.
    ranges: Vec<[f32; 18]>,
}

impl PackedSplats {
    /// `None` if the element does not hold packed splats. The inner error says why it cannot be read.
    pub fn open(file: &Bytes, header: &Header, vertex: usize) -> io::Result<Result<Option<Self>, String>> {
        let packed = &header.elements[vertex];
        let Some(words) = WORDS.map(|name| offset_of(packed, name)).into_iter().collect::<Option<Vec<_>>>() else {
            return Ok(Ok(None));
        };
        let refused = |problem: &str| Ok(Err(format!("compressed Gaussian splats, {problem}")));
        let Some(chunk) = header.elements.iter().position(|element| element.name == "chunk") else {
            return refused("but no element chunk with their ranges");
        };
        let binary = |element: &Element| element.stride().filter(|_| header.encoding != Encoding::Ascii);
        let (Some(stride), Some(chunk_stride)) = (binary(packed), binary(&header.elements[chunk])) else {
            return refused("but as text or with lists");
        };
        let places = RANGES.map(|name| offset_of(&header.elements[chunk], name));
        if places[..NEEDED_RANGES].iter().any(Option::is_none) {
            return refused("but element chunk lacks the ranges of their positions or scales");
        }
        let big_endian = header.encoding == Encoding::BigEndian;
        let mut reader = Reader::new(file, header.length, file.length());
        rows::skip_elements(&mut reader, header, &header.elements[..chunk])?;
        let mut ranges = Vec::new();
        for _ in 0..header.elements[chunk].count {
            let Some(row) = reader.take(chunk_stride as usize)? else { break };
            let range = |(number, place): (usize, &Option<usize>)| match place {
                Some(at) => f32::from_bits(word(row, *at, big_endian)),
                // The upper ends of the ranges of colours are the last three.
                None => {
                    if number < RANGES.len() - 3 {
                        0.0
                    } else {
                        1.0
                    }
                }
            };
            let all: Vec<f32> = places.iter().enumerate().map(range).collect();
            ranges.extend(<[f32; 18]>::try_from(all));
        }
        if (ranges.len() as u64).saturating_mul(IN_CHUNK) < packed.count {
            let (there, count) = (ranges.len(), packed.count);
            return refused(&format!("of which {count} need more ranges than the {there} that the file has"));
        }
        let property = |name: &str| Property { name: name.to_owned(), kind: Kind::Scalar(ColumnType::F32) };
        let properties = UNPACKED.map(property).into();
        let element = Element { name: packed.name.clone(), count: packed.count, properties };
        let words = [words[0], words[1], words[2], words[3]];
        Ok(Ok(Some(Self { element, stride: stride as usize, words, big_endian, ranges })))
    }

    /// The unpacked values of a vertex, in the order of `element`. `row` is the packed one.
    pub fn unpack(&self, vertex: u64, row: &[u8]) -> [f32; 14] {
        let Some(ranges) = self.ranges.get((vertex / IN_CHUNK) as usize) else { return [f32::NAN; 14] };
        let [position, rotation, scale, color] = self.words.map(|at| word(row, at, self.big_endian));
        let part = |word: u32, shift: u32, bits: u32| {
            let most = (1 << bits) - 1;
            (word >> shift & most) as f32 / most as f32
        };
        let between = |least: usize, share: f32| ranges[least] * (1.0 - share) + ranges[least + 3] * share;
        let triple = |word: u32, least: usize| {
            let shares = [part(word, 21, 11), part(word, 11, 10), part(word, 0, 11)];
            [0, 1, 2].map(|axis| between(least + axis, shares[axis]))
        };
        let ([x, y, z], scales) = (triple(position, 0), triple(scale, 6));
        let shares = [24, 16, 8].map(|shift| part(color, shift, 8));
        let [red, green, blue] = [0, 1, 2].map(|channel| (between(12 + channel, shares[channel]) - 0.5) / SH_C0);
        // The logistic function of the opacity reaches neither 0 nor 1.
        let opacity = part(color, 0, 8).clamp(1e-6, 1.0 - 1e-6);
        let opacity = (opacity / (1.0 - opacity)).ln();
        // A quaternion without its largest component, whose number the upper two bits are.
        let mut others =
            [20, 10, 0].map(|shift| (part(rotation, shift, 10) - 0.5) * std::f32::consts::SQRT_2).into_iter();
        let rest: f32 = 1.0 - others.clone().map(|value| value * value).sum::<f32>();
        let largest = (rotation >> 30) as usize;
        let turn: [f32; 4] =
            std::array::from_fn(|at| if at == largest { rest.max(0.0).sqrt() } else { others.next().unwrap_or(0.0) });
        let ([a, b, c], [w, i, j, k]) = (scales, turn);
        [x, y, z, red, green, blue, opacity, a, b, c, w, i, j, k]
    }
}

impl RowMaker for PackedSplats {
    fn element(&self) -> &Element {
        &self.element
    }

    fn stride(&self) -> Option<usize> {
        Some(self.stride)
    }

    fn make(&self, file: &Bytes, block: Block, keep: &[bool], give: &mut dyn FnMut(&[u8])) -> io::Result<(u64, u64)> {
        let mut reader = Reader::new(file, block.offset, block.end);
        let (mut rows, mut packed) = (0, Vec::new());
        while rows < block.rows {
            let piece = reader.rows(self.stride)?;
            if piece.is_empty() {
                break;
            }
            packed.clear();
            for row in piece.chunks_exact(self.stride).take((block.rows - rows) as usize) {
                let kept = std::iter::zip(self.unpack(block.first_row + rows, row), keep).filter(|(_, keep)| **keep);
                kept.for_each(|(value, _)| packed.extend_from_slice(&value.to_le_bytes()));
                rows += 1;
            }
            give(&packed);
        }
        Ok((rows, 0))
    }
}

/// Where a scalar of four bytes is in a row of its element.
fn offset_of(element: &Element, name: &str) -> Option<usize> {
    let mut offset = 0;
    for property in &element.properties {
        let Kind::Scalar(scalar) = property.kind else { return None };
        if property.name == name {
            return (scalar.size() == 4).then_some(offset);
        }
        offset += scalar.size();
    }
    None
}

fn word(row: &[u8], at: usize, big_endian: bool) -> u32 {
    let mut bytes = [0; 4];
    bytes.copy_from_slice(&row[at..at + 4]);
    if big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
}
