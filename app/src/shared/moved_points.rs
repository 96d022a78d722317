//! Moves points of a file that this program wrote, in their order: LAS, or PLY with binary rows.

use std::fs::OpenOptions;
use std::io::{Error, ErrorKind, Read as _, Result, Seek as _, SeekFrom, Write as _};
use std::path::Path;

use glam::DVec3;

/// Points whose records are changed at once.
const AT_ONCE: usize = 1 << 14;

/// Where the records of points are, and how they hold coordinates.
struct Layout {
    offset: u64,
    length: usize,
    /// Where in a record each coordinate is.
    at: [usize; 3],
    kind: Kind,
}

enum Kind {
    /// Whole steps of a grid: the scales and the offsets.
    Steps([f64; 3], [f64; 3]),
    Floats,
    Doubles,
}

/// Puts the points of a file at new places, in world coordinates.
///
/// # Errors
/// The file cannot be changed, has no such records, or cannot hold a place.
pub fn put(path: &Path, places: &[DVec3]) -> Result<()> {
    let mut file = OpenOptions::new().read(true).write(true).open(path)?;
    let mut head = vec![0; file.metadata()?.len().min(1 << 16) as usize];
    file.read_exact(&mut head)?;
    let Layout { offset, length, at, kind } = if head.starts_with(b"LASF") { las(&head) } else { ply(&head) }
        .ok_or_else(|| Error::new(ErrorKind::InvalidData, "no records whose points can be moved"))?;
    for (part, places) in places.chunks(AT_ONCE).enumerate() {
        let start = offset + (part * AT_ONCE * length) as u64;
        let mut records = vec![0; places.len() * length];
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(&mut records)?;
        for (record, place) in records.chunks_exact_mut(length).zip(places) {
            for axis in 0..3 {
                let (from, value) = (at[axis], place[axis]);
                match &kind {
                    Kind::Steps(scales, offsets) => {
                        let steps = ((value - offsets[axis]) / scales[axis]).round();
                        if steps.abs() > f64::from(i32::MAX) {
                            return Err(Error::new(ErrorKind::InvalidData, "a point is beyond the grid of the file"));
                        }
                        record[from..from + 4].copy_from_slice(&(steps as i32).to_le_bytes());
                    }
                    Kind::Floats => record[from..from + 4].copy_from_slice(&(value as f32).to_le_bytes()),
                    Kind::Doubles => record[from..from + 8].copy_from_slice(&value.to_le_bytes()),
                }
            }
        }
        file.seek(SeekFrom::Start(start))?;
        file.write_all(&records)?;
    }
    Ok(())
}

fn bytes<const N: usize>(head: &[u8], at: usize) -> Option<[u8; N]> {
    head.get(at..at + N)?.try_into().ok()
}

fn las(head: &[u8]) -> Option<Layout> {
    let three = |at: usize| {
        let value = |index: usize| bytes(head, at + 8 * index).map(f64::from_le_bytes);
        Some([value(0)?, value(1)?, value(2)?])
    };
    Some(Layout {
        offset: u64::from(u32::from_le_bytes(bytes(head, 96)?)),
        length: usize::from(u16::from_le_bytes(bytes(head, 105)?)),
        at: [0, 4, 8],
        kind: Kind::Steps(three(131)?, three(155)?),
    })
}

fn ply(head: &[u8]) -> Option<Layout> {
    const END: &[u8] = b"end_header\n";
    let offset = head.windows(END.len()).position(|window| window == END)? + END.len();
    let text = std::str::from_utf8(&head[..offset]).ok()?;
    text.contains("format binary_little_endian").then_some(())?;
    let (mut length, mut at, mut sizes) = (0, [None; 3], [0; 3]);
    for line in text.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        if let ["property", kind, name] = words.as_slice() {
            let size = match *kind {
                "uchar" | "char" => 1,
                "ushort" | "short" => 2,
                "uint" | "int" | "float" => 4,
                _ => 8,
            };
            if let Some(axis) = ["x", "y", "z"].iter().position(|axis| axis == name) {
                (at[axis], sizes[axis]) = (Some(length), if *kind == "int" { 0 } else { size });
            }
            length += size;
        }
    }
    let kind = match sizes {
        [4, 4, 4] => Kind::Floats,
        [8, 8, 8] => Kind::Doubles,
        _ => return None,
    };
    Some(Layout { offset: offset as u64, length, at: [at[0]?, at[1]?, at[2]?], kind })
}
