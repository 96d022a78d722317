//! Where the values of a scan are: its packets, each with a piece of the stream of each column.
//!
//! A value may begin in one packet and end in the next, and a packet has pieces of different numbers of values. So the
//! packets are walked once when a file is opened: their heads alone are read. For each block of points the walk keeps the
//! packet in which the first of its streams begins, and how many bytes of each stream come before it. Threads then read
//! blocks in any order.

use std::io;

use super::pages::{Pages, logical};
use crate::bytes::Bytes;
use crate::ply::rows::{Block, Rows};

/// Blocks may together walk over this many times the length of the points: more where the streams of a file are so far apart
/// that each block would have to look through much of it.
const MOST_WALKED: u64 = 16;

/// The compressed points of a scan.
pub struct Packets {
    /// The number of bits of a value in each stream; 0 where all values are equal.
    widths: Vec<u32>,
    /// For each block the bytes of each stream before its first packet.
    before: Vec<u64>,
    block_points: u64,
}

/// The head of a packet.
struct Head {
    /// The logical place after it.
    next: u64,
    /// Where the piece of the first stream begins, and the lengths of all; empty for packets without points.
    start: u64,
    lengths: Vec<u16>,
}

impl Packets {
    /// Walks over the packets of `points` points whose section begins at byte `section` of the file.
    ///
    /// # Errors
    /// In words, if there are no points to be found at all.
    pub fn find(
        file: &Bytes,
        section: u64,
        points: u64,
        widths: Vec<u32>,
        block_points: u64,
    ) -> Result<(Self, Rows), String> {
        let mut packets = Self { widths, before: Vec::new(), block_points };
        let mut rows = Rows::default();
        if points == 0 {
            return Ok((packets, rows));
        }
        if packets.widths.iter().all(|width| *width == 0) {
            return Err(format!("its {points} points are all equal and take no bytes, which is not read"));
        }
        let mut pages = Pages::new(file, 1);
        let begin = logical(section);
        let mut head = [0; 32];
        pages.read(begin, &mut head).map_err(|error| error.to_string())?;
        let word = |at: usize| head[at..at + 8].iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte));
        if head[0] != 1 {
            return Err(format!("no compressed points at byte {section}, where its list says that they are"));
        }
        let end = begin.saturating_add(word(8)).min(Pages::length(file));
        let mut place = logical(word(16));
        if place < begin {
            return Err("its first packet is before its section".into());
        }
        let mut bytes = vec![0_u64; packets.widths.len()];
        let (mut ended, mut walked) = (0, 0);
        // Whether a stream has come beyond the first values of a point, and whether all have.
        let begins = |bytes: &[u64], widths: &[u32], point: u64| {
            std::iter::zip(bytes, widths)
                .any(|(bytes, width)| *width > 0 && u128::from(*bytes) * 8 > u128::from(point) * u128::from(*width))
        };
        let reaches = |bytes: &[u64], widths: &[u32], point: u64| {
            std::iter::zip(bytes, widths)
                .all(|(bytes, width)| u128::from(*bytes) * 8 >= u128::from(point) * u128::from(*width))
        };
        while !reaches(&bytes, &packets.widths, points) {
            let found = match packets.head(&mut pages, place, end) {
                Ok(Some(found)) => found,
                Ok(None) => break,
                Err(error) => {
                    rows.problem = Some(error.to_string());
                    break;
                }
            };
            if !found.lengths.is_empty() {
                let previous = bytes.clone();
                std::iter::zip(&mut bytes, &found.lengths).for_each(|(all, own)| *all += u64::from(*own));
                let first = |block: usize| block as u64 * block_points;
                while first(rows.blocks.len()) < points && begins(&bytes, &packets.widths, first(rows.blocks.len())) {
                    let first_row = first(rows.blocks.len());
                    let rows_there = block_points.min(points - first_row);
                    rows.blocks.push(Block { offset: place, end: found.next, first_row, rows: rows_there });
                    packets.before.extend_from_slice(&previous);
                }
                for block in &mut rows.blocks[ended..] {
                    block.end = found.next;
                    if !reaches(&bytes, &packets.widths, block.first_row + block.rows) {
                        break;
                    }
                    ended += 1;
                    walked += block.end - block.offset;
                }
                if walked > (end - begin).saturating_mul(MOST_WALKED) {
                    return Err("the columns of its points lie far from one another, which is not read".into());
                }
            }
            place = found.next;
        }
        let there = std::iter::zip(&bytes, &packets.widths)
            .filter(|(_, width)| **width > 0)
            .map(|(bytes, width)| u64::try_from(u128::from(*bytes) * 8 / u128::from(*width)).unwrap_or(u64::MAX));
        rows.count = points.min(there.min().unwrap_or(0));
        rows.blocks.retain(|block| block.first_row < rows.count);
        if let Some(last) = rows.blocks.last_mut() {
            last.rows = rows.count - last.first_row;
            last.end = place;
        }
        rows.end = place;
        Ok((packets, rows))
    }

    /// The head of the packet at a logical place; `None` at the end of the section.
    fn head(&self, pages: &mut Pages<'_>, place: u64, end: u64) -> io::Result<Option<Head>> {
        let invalid =
            |problem: &str| io::Error::new(io::ErrorKind::InvalidData, format!("{problem} at logical byte {place}"));
        if end.saturating_sub(place) < 4 {
            return Ok(None);
        }
        let mut head = [0; 6];
        pages.read(place, &mut head[..4])?;
        let next = place + u64::from(u16::from_le_bytes([head[2], head[3]])) + 1;
        if !(next - place).is_multiple_of(4) {
            return Err(invalid("a packet of a length that is no multiple of 4"));
        }
        match head[0] {
            0 | 2 => return Ok(Some(Head { next, start: next, lengths: Vec::new() })),
            1 => {}
            _ => return Err(invalid("a packet of no known kind")),
        }
        pages.read(place + 4, &mut head[4..])?;
        let streams = usize::from(u16::from_le_bytes([head[4], head[5]]));
        if streams != self.widths.len() {
            return Err(invalid(&format!("a packet of {streams} columns, expected {},", self.widths.len())));
        }
        let mut lengths = vec![0; 2 * streams];
        pages.read(place + 6, &mut lengths)?;
        let lengths: Vec<u16> = lengths.as_chunks::<2>().0.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect();
        let start = place + 6 + 2 * streams as u64;
        if start + lengths.iter().map(|length| u64::from(*length)).sum::<u64>() > next {
            return Err(invalid("a packet whose columns are longer than itself"));
        }
        Ok(Some(Head { next, start, lengths }))
    }

    /// The bytes of the streams that are `needed` with the values of the first points of a block, and by how many bits each
    /// begins before them.
    pub fn streams(&self, file: &Bytes, block: Block, needed: &[bool]) -> io::Result<Vec<Bits>> {
        let number = (block.first_row / self.block_points) as usize;
        let known = self.before.chunks_exact(self.widths.len().max(1)).nth(number);
        let mut before = known.ok_or(io::ErrorKind::InvalidInput)?.to_vec();
        let range = |width: u32| {
            let bit = |point: u64| u128::from(point) * u128::from(width);
            let (from, to) = (bit(block.first_row), bit(block.first_row + block.rows));
            ((from / 8) as u64, to.div_ceil(8) as u64, (from % 8) as usize)
        };
        let ranges: Vec<_> = self.widths.iter().map(|width| range(*width)).collect();
        let mut streams: Vec<Bits> =
            std::iter::zip(&self.widths, &ranges).map(|(width, range)| Bits::new(*width, range.2)).collect();
        let mut pages = Pages::new(file, 64);
        let mut place = block.offset;
        let is_lacking = |streams: &[Bits]| {
            let mut all = std::iter::zip(streams, &ranges).zip(needed);
            all.any(|((stream, (from, to, _)), needed)| *needed && (stream.bytes.len() as u64) < to - from)
        };
        while is_lacking(&streams) {
            let Some(head) = self.head(&mut pages, place, block.end)? else {
                return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the file ends inside of its points"));
            };
            let mut piece = head.start;
            for (index, length) in head.lengths.iter().enumerate() {
                let own = (before[index], before[index] + u64::from(*length));
                let (from, to) = (own.0.max(ranges[index].0), own.1.min(ranges[index].1));
                if needed[index] && from < to {
                    let bytes = &mut streams[index].bytes;
                    let filled = bytes.len();
                    bytes.resize(filled + (to - from) as usize, 0);
                    pages.read(piece + (from - own.0), &mut bytes[filled..])?;
                }
                piece += u64::from(*length);
                before[index] = own.1;
            }
            place = head.next;
        }
        // A value is taken out of 16 bytes.
        streams.iter_mut().for_each(|stream| stream.bytes.extend([0; 16]));
        Ok(streams)
    }
}

/// Values of some bits each, one after the other.
pub struct Bits {
    bytes: Vec<u8>,
    width: u32,
    skipped: usize,
}

impl Bits {
    fn new(width: u32, skipped: usize) -> Self {
        Self { bytes: Vec::new(), width, skipped }
    }

    /// A value; 0 where all are equal.
    #[inline]
    pub fn value(&self, index: usize) -> u64 {
        let bit = self.skipped + index * self.width as usize;
        let Some((bytes, _)) = self.bytes.get(bit / 8..).and_then(<[u8]>::split_first_chunk::<16>) else { return 0 };
        let word = u128::from_le_bytes(*bytes) >> (bit % 8);
        (word & ((1_u128 << self.width) - 1)) as u64
    }
}
