//! Where all formats read from: the bytes of a source, which many threads read at once, each at its own offset. A source that is
//! not a file would be read here, too: nothing else opens one.

use std::fs::File;
use std::io::{self, IsTerminal as _, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::{Error, Result};

/// The bytes of an open file. It stays open, so they are those of the file that was opened, whatever has its name later.
pub struct Bytes {
    path: PathBuf,
    length: u64,
    #[cfg(unix)]
    file: File,
    #[cfg(not(unix))]
    file: Mutex<File>,
}

impl Bytes {
    /// The name of standard input among files. What comes from there is copied to a temporary file without a name when it is
    /// first opened, since points are read out of order and clouds are opened again.
    pub const STANDARD_INPUT: &str = "-";

    /// # Errors
    /// If the path leads to no regular file, or to one that cannot be read.
    pub fn open(path: &Path) -> Result<Self> {
        let io = |error| Error::io(path, error);
        if path == Path::new(Self::STANDARD_INPUT) {
            return standard_input().and_then(|file| Self::of_file(path, file)).map_err(io);
        }
        if !std::fs::metadata(path).map_err(io)?.is_file() {
            // Opening a pipe would wait for someone to write.
            return Err(io(io::Error::other(
                "not a regular file; points are read out of order, so save it as one first",
            )));
        }
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        #[cfg(not(unix))]
        let file = Mutex::new(file);
        Ok(Self { path: path.to_owned(), length, file })
    }

    /// All bytes, which are at most `most`.
    ///
    /// # Errors
    /// If the file is longer, or cannot be read.
    pub(crate) fn all(&self, most: u64) -> Result<Vec<u8>> {
        if self.length > most {
            let problem = format!("{} bytes, expected at most {most}", self.length);
            return Err(Error::malformed(&self.path, "length", problem));
        }
        let mut all = vec![0; self.length as usize];
        let read = self.read_at(0, &mut all).map_err(|error| Error::io(&self.path, error))?;
        all.truncate(read);
        Ok(all)
    }

    /// The bytes of a file without a name, which messages name by `path`.
    pub(crate) fn of_file(path: &Path, file: File) -> io::Result<Self> {
        let length = file.metadata()?.len();
        #[cfg(not(unix))]
        let file = Mutex::new(file);
        Ok(Self { path: path.to_owned(), length, file })
    }

    /// Where the source is: how messages name it, and how it is opened again.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The length of the file in bytes when it was opened.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Fills `buffer` from byte `offset` on, as far as the file goes; returns the number of bytes read.
    ///
    /// # Errors
    /// If the file cannot be read there.
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.read_some_at(offset.saturating_add(filled as u64), &mut buffer[filled..]) {
                Ok(0) => break,
                Ok(bytes) => filled += bytes,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(filled)
    }

    /// The `N` bytes at `offset`, or `None` if the file is too short.
    pub(crate) fn bytes_at<const N: usize>(&self, offset: u64) -> io::Result<Option<[u8; N]>> {
        let mut bytes = [0; N];
        Ok((self.read_at(offset, &mut bytes)? == N).then_some(bytes))
    }

    #[cfg(unix)]
    fn read_some_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        std::os::unix::fs::FileExt::read_at(&self.file, buffer, offset)
    }

    #[cfg(not(unix))]
    fn read_some_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(offset))?;
        file.read(buffer)
    }

    /// Bytes `start..end` as a stream with a cursor of its own.
    pub(crate) fn section(&self, start: u64, end: u64) -> Section<'_> {
        Section { file: self, start, position: start, end }
    }
}

/// The file of this name in the folder of another one.
pub(crate) fn beside(path: &Path, name: &str) -> PathBuf {
    path.parent().unwrap_or(Path::new("")).join(name)
}

/// The last part of a path.
pub(crate) fn last_part(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// All that comes from standard input, as a file.
fn standard_input() -> io::Result<File> {
    static COPY: Mutex<Option<File>> = Mutex::new(None);
    let mut copy = COPY.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(file) = &*copy {
        return file.try_clone();
    }
    let mut input = io::stdin().lock();
    if input.is_terminal() {
        return Err(io::Error::other("standard input is a terminal; pipe a file of points into it"));
    }
    let mut file = tempfile::tempfile()?;
    io::copy(&mut input, &mut file)?;
    copy.insert(file).try_clone()
}

/// A part of a file as `Read` and `Seek` (positions count from the start of the part), for decoders that need a stream.
pub(crate) struct Section<'a> {
    file: &'a Bytes,
    start: u64,
    position: u64,
    end: u64,
}

impl Read for Section<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.end.saturating_sub(self.position);
        let wanted = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        let bytes = self.file.read_some_at(self.position, &mut buffer[..wanted])?;
        self.position += bytes as u64;
        Ok(bytes)
    }
}

impl Seek for Section<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let target = match to {
            SeekFrom::Start(offset) => self.start.checked_add(offset),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
            SeekFrom::End(offset) => self.end.checked_add_signed(offset),
        };
        self.position = target
            .filter(|&target| target >= self.start)
            .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "seek to before the section"))?;
        Ok(self.position - self.start)
    }
}
