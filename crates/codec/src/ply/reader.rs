//! Buffered reads at a place of a file that other threads read too: whole lines, small pieces, long skips. Memory stays
//! at one piece, whatever the file says of itself.

use std::io;

use crate::positioned_file::PositionedFile;

/// Bytes asked of the system at a time: large enough to hide the call, small enough to stay in the second-level cache
/// while the piece is decoded.
pub const PIECE_BYTES: usize = 256 << 10;

/// A longer line is cut here and its rest passed over, so that a file without line ends cannot fill the memory.
pub const MAX_LINE_BYTES: usize = 4 << 20;

pub struct Reader<'a> {
    file: &'a PositionedFile,
    buffer: Vec<u8>,
    /// Bytes of `buffer` before this are used up.
    at: usize,
    /// Offset in the file of the end of `buffer`.
    next: u64,
    end: u64,
    piece: usize,
    /// A cut line's rest is still to be passed over.
    in_cut_line: bool,
}

impl<'a> Reader<'a> {
    /// Reads `offset..end` of the file.
    pub fn new(file: &'a PositionedFile, offset: u64, end: u64) -> Self {
        Self { file, buffer: Vec::new(), at: 0, next: offset, end, piece: PIECE_BYTES, in_cut_line: false }
    }

    /// The same for a few bytes: 4 KiB are read at a time, not a whole piece.
    pub fn short(file: &'a PositionedFile, offset: u64, end: u64) -> Self {
        Self { piece: 4096, ..Self::new(file, offset, end) }
    }

    /// Offset in the file of the next byte that is not used up.
    pub fn position(&self) -> u64 {
        self.next - (self.buffer.len() - self.at) as u64
    }

    pub fn end(&self) -> u64 {
        self.end
    }

    /// Drops what is used up and adds a piece; false at the end.
    fn fill(&mut self) -> io::Result<bool> {
        self.buffer.drain(..self.at);
        self.at = 0;
        let kept = self.buffer.len();
        let wanted = (self.end - self.next).min(self.piece as u64) as usize;
        self.buffer.resize(kept + wanted, 0);
        let filled = match self.file.read_at(self.next, &mut self.buffer[kept..]) {
            Ok(filled) => filled,
            Err(error) => {
                self.buffer.truncate(kept);
                return Err(error);
            }
        };
        self.buffer.truncate(kept + filled);
        self.next += filled as u64;
        if filled < wanted {
            // The file is shorter than it was.
            self.end = self.next;
        }
        Ok(filled > 0)
    }

    /// The next `length` bytes, `None` if there are fewer. For small lengths: all of it is buffered.
    #[inline]
    pub fn take(&mut self, length: usize) -> io::Result<Option<&[u8]>> {
        while self.buffer.len() - self.at < length {
            if !self.fill()? {
                return Ok(None);
            }
        }
        let start = self.at;
        self.at += length;
        Ok(Some(&self.buffer[start..self.at]))
    }

    /// Passes over `length` bytes; false, at the end, if there are fewer.
    #[inline]
    pub fn skip(&mut self, length: u64) -> io::Result<bool> {
        let buffered = (self.buffer.len() - self.at) as u64;
        if length <= buffered {
            self.at += length as usize;
            return Ok(true);
        }
        let target = self.next.saturating_add(length - buffered);
        self.buffer.clear();
        self.at = 0;
        self.next = target.min(self.end);
        Ok(target <= self.end)
    }

    /// A whole number of `stride`-byte rows, as many as fit a piece; empty at the end. A last row that is cut off is
    /// not given.
    pub fn rows(&mut self, stride: usize) -> io::Result<&[u8]> {
        // After the first piece a part of a row may be left over; it is moved to the front.
        if self.buffer.len() - self.at < stride {
            while self.buffer.len() - self.at < stride && self.fill()? {}
        }
        let length = (self.buffer.len() - self.at) / stride * stride;
        let start = self.at;
        self.at += length;
        Ok(&self.buffer[start..self.at])
    }

    /// A run of whole lines, as many as a piece has; empty at the end. Each ends in `newline` but the last of the file,
    /// and one longer than `MAX_LINE_BYTES`, which comes alone and cut.
    pub fn lines(&mut self, newline: u8) -> io::Result<&[u8]> {
        while self.in_cut_line {
            let length = self.buffer[self.at..].iter().position(|&byte| byte == newline);
            self.in_cut_line = length.is_none();
            self.at = length.map_or(self.buffer.len(), |length| self.at + length + 1);
            if self.in_cut_line && !self.fill()? {
                self.in_cut_line = false;
            }
        }
        let mut searched = self.at;
        loop {
            if let Some(last) = self.buffer[searched..].iter().rposition(|&byte| byte == newline) {
                let start = self.at;
                self.at = searched + last + 1;
                return Ok(&self.buffer[start..self.at]);
            }
            let unused = self.buffer.len() - self.at;
            if unused >= MAX_LINE_BYTES {
                self.in_cut_line = true;
            } else if self.fill()? {
                searched = unused;
                continue;
            }
            let start = self.at;
            self.at = self.buffer.len();
            return Ok(&self.buffer[start..]);
        }
    }

    /// The next line that is not blank, and whether the file ends in it without a line end; `None` at the end.
    pub fn line(&mut self, newline: u8) -> io::Result<Option<(&[u8], bool)>> {
        loop {
            let run = self.lines(newline)?;
            if run.is_empty() {
                return Ok(None);
            }
            let length = run.iter().position(|&byte| byte == newline).map_or(run.len(), |length| length + 1);
            let (unused, is_blank) = (run.len() - length, is_blank(&run[..length]));
            self.at -= unused;
            if !is_blank {
                let line = &self.buffer[self.at - length..self.at];
                return Ok(Some((line, line.last() != Some(&newline))));
            }
        }
    }

    /// Passes over `count` lines that are not blank; how many there were.
    pub fn skip_lines(&mut self, count: u64, newline: u8) -> io::Result<u64> {
        let mut skipped = 0;
        while skipped < count {
            let run = self.lines(newline)?;
            if run.is_empty() {
                break;
            }
            let in_run = count_lines(run, newline);
            if skipped + in_run <= count {
                skipped += in_run;
                continue;
            }
            let mut unused = run.len();
            for line in run.split_inclusive(|&byte| byte == newline) {
                if skipped == count {
                    break;
                }
                skipped += u64::from(!is_blank(line));
                unused -= line.len();
            }
            self.at -= unused;
        }
        Ok(skipped)
    }
}

/// Lines of a run that are not blank.
pub fn count_lines(run: &[u8], newline: u8) -> u64 {
    let Some((&first, &last)) = run.first().zip(run.last()) else { return 0 };
    // Nearly always each line begins with its content; then two counts that the compiler turns into vector code tell.
    let ends = run.iter().filter(|&&byte| byte == newline).count() + usize::from(last != newline);
    let begun = run.iter().zip(&run[1..]).filter(|&(&before, &byte)| (before == newline) & (byte > b' ')).count();
    if begun + usize::from(first > b' ') == ends {
        return ends as u64;
    }
    run.split(|&byte| byte == newline).filter(|line| !is_blank(line)).count() as u64
}

/// Control characters count as white space: no number has them.
pub fn is_blank(line: &[u8]) -> bool {
    line.iter().all(|&byte| byte <= b' ')
}
