//! The variable length records of a file that is written, and which of another file it keeps.

use std::io::{self, Write};
use std::ops::Range;

use super::LasSource;
use super::layout::{bytes, text};
use super::systems::System;

/// The size in bytes of a record's head.
pub const HEAD_LENGTH: usize = 54;
/// The header's bits that say where wave packets are.
pub const WAVE_PACKETS: u16 = 2 | 4;

/// Whether the record at byte `start` goes on to the file. Not kept is what describes how points were stored:
/// compression, wave packets, indices of their order; and coordinate systems that the file has otherwise.
pub fn is_kept(source: &LasSource, start: u64, system: &System) -> io::Result<bool> {
    let head: [u8; 20] = source.file.bytes_at(start)?.unwrap_or([0; 20]);
    let (user, identifier) = (text(&head[2..18]), u16::from_le_bytes(bytes(&head, 18)));
    let dropped = matches!(
        (user.as_str(), identifier),
        ("copc", _) | ("laszip encoded", _) | ("LASF_Spec", 100..=354 | 65535) | ("LAStools", 10 | 30)
    );
    Ok(!dropped && system.keeps(&user, identifier))
}

/// Writes the record of a system that the other file does not have; returns the number of records.
pub fn write_system(out: &mut Vec<u8>, system: &System) -> u32 {
    let Some(text) = &system.added else { return 0 };
    write_record(out, ("LASF_Projection", 2112, "coordinate system"), &[text.as_bytes(), &[0]].concat());
    1
}

/// Copies a record of another file as it is; returns its length in bytes.
pub fn copy_record(source: &LasSource, place: &Range<u64>, out: &mut impl Write) -> io::Result<u64> {
    let copied = io::copy(&mut source.file.section(place.start, place.end), out)?;
    if copied < place.end - place.start {
        return Err(io::Error::other("its source has become shorter since it was opened"));
    }
    Ok(copied)
}

pub fn is_extra_bytes(record: &[u8]) -> bool {
    text(&record[2..18]) == "LASF_Spec" && record[18..20] == [4, 0]
}

/// A variable length record: user, identifier and description, then data.
pub fn write_record(out: &mut Vec<u8>, (user, identifier, description): (&str, u16, &str), data: &[u8]) {
    out.extend([0; 2]);
    out.extend(padded::<16>(user));
    out.extend(identifier.to_le_bytes());
    out.extend((data.len() as u16).to_le_bytes());
    out.extend(padded::<32>(description));
    out.extend_from_slice(data);
}

pub fn padded<const N: usize>(text: &str) -> [u8; N] {
    let mut field = [0; N];
    let length = text.len().min(N);
    field[..length].copy_from_slice(&text.as_bytes()[..length]);
    field
}
