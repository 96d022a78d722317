//! The pages of an E57 file: 1020 bytes of content each, and a checksum of them. Places in the content are logical, places
//! in the file physical.

use std::io;
use std::ops::Range;

use crate::bytes::Bytes;

pub const PAGE_BYTES: u64 = 1024;
const CONTENT_BYTES: u64 = PAGE_BYTES - 4;

/// The logical place of a physical one. One inside of a checksum is taken for the end of its page.
pub fn logical(physical: u64) -> u64 {
    physical / PAGE_BYTES * CONTENT_BYTES + (physical % PAGE_BYTES).min(CONTENT_BYTES)
}

/// The bytes of the file whose pages have the content of a range of logical places.
pub fn physical(content: Range<u64>) -> Range<u64> {
    let page = |number: u64| number.saturating_mul(PAGE_BYTES);
    page(content.start / CONTENT_BYTES)..page(content.end.div_ceil(CONTENT_BYTES))
}

/// Reads content, with checksums verified.
pub struct Pages<'a> {
    file: &'a Bytes,
    /// The number of pages that are read at a time.
    ahead: u64,
    /// The pages in `buffer`: the number of the first one, and how many are verified.
    first: u64,
    buffer: Vec<u8>,
    is_verified: Vec<bool>,
}

impl<'a> Pages<'a> {
    /// For reads that skip much (`ahead` 1) or little.
    pub fn new(file: &'a Bytes, ahead: u64) -> Self {
        Self { file, ahead, first: 0, buffer: Vec::new(), is_verified: Vec::new() }
    }

    /// The length of the content of the whole file in bytes.
    pub fn length(file: &Bytes) -> u64 {
        file.length() / PAGE_BYTES * CONTENT_BYTES
    }

    /// Fills `out` from a logical place on.
    ///
    /// # Errors
    /// If the file ends before, or a page has another checksum.
    pub fn read(&mut self, mut place: u64, mut out: &mut [u8]) -> io::Result<()> {
        while !out.is_empty() {
            let page = self.page(place / CONTENT_BYTES)?;
            let from = (place % CONTENT_BYTES) as usize;
            let count = out.len().min(CONTENT_BYTES as usize - from);
            let (now, later) = out.split_at_mut(count);
            now.copy_from_slice(&page[from..from + count]);
            out = later;
            place += count as u64;
        }
        Ok(())
    }

    /// The content of a page.
    fn page(&mut self, number: u64) -> io::Result<&[u8]> {
        if number < self.first || number - self.first >= self.is_verified.len() as u64 {
            self.buffer.resize((self.ahead * PAGE_BYTES) as usize, 0);
            let read = self.file.read_at(number.saturating_mul(PAGE_BYTES), &mut self.buffer)?;
            self.first = number;
            self.is_verified = vec![false; read / PAGE_BYTES as usize];
            if self.is_verified.is_empty() {
                return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the file ends inside of its points"));
            }
        }
        let index = (number - self.first) as usize;
        let start = index * PAGE_BYTES as usize;
        let (content, sum) = self.buffer[start..start + PAGE_BYTES as usize].split_at(CONTENT_BYTES as usize);
        if !self.is_verified[index] {
            if checksum(content).to_be_bytes() != *sum {
                let problem = format!("the page at byte {} has a wrong checksum", number * PAGE_BYTES);
                return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
            }
            self.is_verified[index] = true;
        }
        Ok(content)
    }
}

/// CRC-32C of one to four bytes each, by which four bytes are added at once (Kounavis and Berry 2005).
const TABLES: [[u32; 256]; 4] = tables();

const fn tables() -> [[u32; 256]; 4] {
    let mut tables = [[0; 256]; 4];
    let mut byte = 0;
    while byte < 256 {
        let (mut sum, mut bit) = (byte as u32, 0);
        while bit < 8 {
            sum = if sum & 1 == 1 { sum >> 1 ^ 0x82f6_3b78 } else { sum >> 1 };
            bit += 1;
        }
        tables[0][byte] = sum;
        byte += 1;
    }
    let mut table = 1;
    while table < 4 {
        byte = 0;
        while byte < 256 {
            let before = tables[table - 1][byte];
            tables[table][byte] = before >> 8 ^ tables[0][(before & 255) as usize];
            byte += 1;
        }
        table += 1;
    }
    tables
}

fn checksum(content: &[u8]) -> u32 {
    let at = |table: usize, byte: u32| TABLES[table][(byte & 255) as usize];
    let mut sum = !0_u32;
    let (words, rest) = content.as_chunks::<4>();
    for word in words {
        let own = sum ^ u32::from_le_bytes(*word);
        sum = at(3, own) ^ at(2, own >> 8) ^ at(1, own >> 16) ^ at(0, own >> 24);
    }
    !rest.iter().fold(sum, |sum, byte| at(0, sum ^ u32::from(*byte)) ^ sum >> 8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_castagnoli() {
        assert_eq!(checksum(b"123456789"), 0xe306_9283);
        assert_eq!(checksum(&[]), 0);
    }

    #[test]
    fn places_in_the_content_leave_checksums_out() {
        assert_eq!([0, 48, 1019, 1024, 2053].map(logical), [0, 48, 1019, 1020, 2045]);
        assert_eq!([physical(0..1020), physical(1019..1021), physical(2045..2045)], [0..1024, 0..2048, 2048..3072]);
    }
}
