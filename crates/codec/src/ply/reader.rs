//! Buffered reads from a part of a file that other threads read too: whole lines, small pieces, long skips. The memory
//! is bounded by one piece, whatever the file contains.

use std::io;

use crate::bytes::Bytes;

/// The bytes read per system call: enough to hide the cost of the call, and few enough to stay in the second-level
/// cache while the piece is decoded.
pub const PIECE_BYTES: usize = 256 << 10;

/// The longest line. A longer one is cut here and the remainder skipped, so that a file without line ends cannot fill
/// the memory.
pub const MAX_LINE_BYTES: usize = 4 << 20;

pub struct Reader<'a> {
    file: &'a Bytes,
    /// `at..filled` has been read but not used.
    buffer: Vec<u8>,
    at: usize,
    filled: usize,
    /// The offset in the file of the byte after the buffer.
    next: u64,
    end: u64,
    piece: usize,
    /// Whether the remainder of a cut line has still to be skipped.
    in_cut_line: bool,
    has_comments: bool,
}

impl<'a> Reader<'a> {
    /// Reads `offset..end` of the file.
    pub fn new(file: &'a Bytes, offset: u64, end: u64) -> Self {
        let piece = PIECE_BYTES;
        let (in_cut_line, has_comments) = (false, false);
        Self { file, buffer: Vec::new(), at: 0, filled: 0, next: offset, end, piece, in_cut_line, has_comments }
    }

    /// Skips comments as it skips blank lines, if the text has comments.
    pub fn with_comments(self, has_comments: bool) -> Self {
        Self { has_comments, ..self }
    }

    /// Reads `offset..end` of the file 4 KiB at a time, for those who need a few bytes.
    pub fn short(file: &'a Bytes, offset: u64, end: u64) -> Self {
        Self { piece: 4096, ..Self::new(file, offset, end) }
    }

    /// The offset in the file of the next unused byte.
    pub fn position(&self) -> u64 {
        self.next - (self.filled - self.at) as u64
    }

    pub fn end(&self) -> u64 {
        self.end
    }

    /// Drops the used bytes and adds a piece; returns false at the end.
    fn fill(&mut self) -> io::Result<bool> {
        self.buffer.copy_within(self.at..self.filled, 0);
        self.filled -= self.at;
        self.at = 0;
        let wanted = (self.end - self.next).min(self.piece as u64) as usize;
        if self.buffer.len() < self.filled + wanted {
            self.buffer.resize(self.filled + wanted, 0);
        }
        let count = self.file.read_at(self.next, &mut self.buffer[self.filled..self.filled + wanted])?;
        self.filled += count;
        self.next += count as u64;
        if count < wanted {
            // The file is shorter than it was.
            self.end = self.next;
        }
        Ok(count > 0)
    }

    /// The next `length` bytes; `None` if there are fewer. For small lengths: all of them are buffered.
    #[inline]
    pub fn take(&mut self, length: usize) -> io::Result<Option<&[u8]>> {
        while self.filled - self.at < length {
            if !self.fill()? {
                return Ok(None);
            }
        }
        let start = self.at;
        self.at += length;
        Ok(Some(&self.buffer[start..self.at]))
    }

    /// Skips `length` bytes; returns false, at the end, if there are fewer.
    #[inline]
    pub fn skip(&mut self, length: u64) -> io::Result<bool> {
        let buffered = (self.filled - self.at) as u64;
        if length <= buffered {
            self.at += length as usize;
            return Ok(true);
        }
        let target = self.next.saturating_add(length - buffered);
        (self.at, self.filled) = (0, 0);
        self.next = target.min(self.end);
        Ok(target <= self.end)
    }

    /// A whole number of `stride`-byte rows, as many as fit a piece; empty at the end. An incomplete last row is left
    /// out.
    pub fn rows(&mut self, stride: usize) -> io::Result<&[u8]> {
        // After the first piece a part of a row may be left over; it is moved to the front.
        if self.filled - self.at < stride {
            while self.filled - self.at < stride && self.fill()? {}
        }
        let length = (self.filled - self.at) / stride * stride;
        let start = self.at;
        self.at += length;
        Ok(&self.buffer[start..self.at])
    }

    /// A run of whole lines, as many as a piece has; empty at the end. Each ends in `newline` except the last of the
    /// file and one longer than `MAX_LINE_BYTES`, which is cut and comes alone.
    pub fn lines(&mut self, newline: u8) -> io::Result<&[u8]> {
        while self.in_cut_line {
            let length = self.buffer[self.at..self.filled].iter().position(|&byte| byte == newline);
            self.in_cut_line = length.is_none();
            self.at = length.map_or(self.filled, |length| self.at + length + 1);
            if self.in_cut_line && !self.fill()? {
                self.in_cut_line = false;
            }
        }
        let mut searched = self.at;
        loop {
            if let Some(last) = self.buffer[searched..self.filled].iter().rposition(|&byte| byte == newline) {
                let start = self.at;
                self.at = searched + last + 1;
                return Ok(&self.buffer[start..self.at]);
            }
            let unused = self.filled - self.at;
            if unused >= MAX_LINE_BYTES {
                self.in_cut_line = true;
            } else if self.fill()? {
                searched = unused;
                continue;
            }
            let start = self.at;
            self.at = self.filled;
            return Ok(&self.buffer[start..self.filled]);
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

    /// Skips `count` lines of content; returns how many there were.
    pub fn skip_lines(&mut self, count: u64, newline: u8) -> io::Result<u64> {
        let (mut skipped, has_comments) = (0, self.has_comments);
        while skipped < count {
            let run = self.lines(newline)?;
            if run.is_empty() {
                break;
            }
            let in_run = count_lines(run, newline, has_comments);
            if skipped + in_run <= count {
                skipped += in_run;
                continue;
            }
            let mut unused = run.len();
            for line in run.split_inclusive(|&byte| byte == newline) {
                if skipped == count {
                    break;
                }
                skipped += u64::from(has_content(line, has_comments));
                unused -= line.len();
            }
            self.at -= unused;
        }
        Ok(skipped)
    }
}

/// The number of lines of content of a run.
pub fn count_lines(run: &[u8], newline: u8, has_comments: bool) -> u64 {
    let Some(&first) = run.first() else { return 0 };
    // Nearly always each line begins with its content; then two counts are enough, in runs of 255 so that a vector of
    // bytes holds the counts. No comment begins with a byte above the comma other than the slash.
    let least = if has_comments { b',' } else { b' ' };
    let begins = |byte: u8| byte > least && !(has_comments && byte == b'/');
    let (mut lines, mut begun) = (1, u64::from(begins(first)));
    for (bytes, followers) in run.chunks(255).zip(run[1..].chunks(255)) {
        let (mut ends, mut starts) = (0_u8, 0_u8);
        for (&byte, &follower) in bytes.iter().zip(followers) {
            let is_end = u8::from(byte == newline);
            ends += is_end;
            starts += is_end & u8::from(begins(follower));
        }
        lines += u64::from(ends);
        begun += u64::from(starts);
    }
    if begun == lines {
        return lines;
    }
    run.split(|&byte| byte == newline).filter(|line| has_content(line, has_comments)).count() as u64
}

/// Whether a line is blank. Control characters count as white space: no number has them.
pub fn is_blank(line: &[u8]) -> bool {
    line.iter().all(|&byte| byte <= b' ')
}

/// Whether a line of a table is a comment.
pub fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    [&b"#"[..], b"//", b"%", b"!"].iter().any(|mark| line.starts_with(mark))
}

/// Whether a line is neither blank nor, in a text that has comments, one of these.
pub fn has_content(line: &[u8], has_comments: bool) -> bool {
    !(is_blank(line) || has_comments && is_comment(line))
}
