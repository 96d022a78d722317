//! Where all formats read from: the bytes of a source, which many threads read at once, each at its own offset. A source is a
//! file, standard input or an address of the web; nothing else opens one.

use std::fs::File;
use std::io::{self, ErrorKind, IsTerminal as _, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use param::shown;

use crate::address::is_address;
use crate::disk::{Disk, State};
use crate::error::{is_for_want_of_room, why_unwritten};
use crate::remote::{Remote, Stamp};
use crate::{Error, Result};

/// The longest file of a server, in bytes, that is fetched as a whole where a part would do: once more where its head or its
/// lists are damaged, or where the server sends all of it.
pub(crate) const MOST_AGAIN: u64 = 64 << 20;

/// The bytes of an open file. It stays open, so they are those of the file that was opened, whatever has its name later.
/// Where another program has written to that file since, nothing more is read of it.
pub struct Bytes {
    path: PathBuf,
    length: u64,
    place: Place,
}

/// A file of the disk that was opened, to be opened again by its name.
#[derive(Clone, Debug)]
pub struct NamedFile {
    path: PathBuf,
    opened: State,
}

impl NamedFile {
    /// Says what is wrong if the file with the name is another one than it was.
    ///
    /// # Errors
    /// If the file was written to, or another one has taken its place.
    pub fn check_unchanged(&self) -> Result<()> {
        let failed = |error| Error::io(&self.path, error);
        let now = State::of(&std::fs::metadata(&self.path).map_err(failed)?);
        check_same(self.opened, now).map_err(failed)
    }
}

enum Place {
    /// A file, and its state when it was opened.
    Disk(Disk, State),
    Remote(Box<Remote>),
    Memory(Vec<u8>),
}

/// The error of a file that was not opened. Of a link to nothing it says that: the link itself is there.
fn told(path: &Path, error: io::Error) -> io::Error {
    match path.read_link() {
        Ok(target) if error.kind() == io::ErrorKind::NotFound => {
            io::Error::new(io::ErrorKind::NotFound, format!("a link to {}, which leads to nothing", shown(&target)))
        }
        _ => error,
    }
}

impl Bytes {
    /// The name of standard input among files. What comes from there is copied to a temporary file without a name when it is
    /// first opened, since points are read out of order and clouds are opened again.
    pub const STANDARD_INPUT: &str = "-";

    /// # Errors
    /// If the path leads to no regular file, or to one that cannot be read.
    pub fn open(path: &Path) -> Result<Self> {
        let io = |error| Error::io(path, told(path, error));
        if path == Path::new(Self::STANDARD_INPUT) {
            return standard_input().and_then(|file| Self::of_file(path, file)).map_err(io);
        }
        if is_address(path) {
            return Self::open_remote(path, false, None);
        }
        if !std::fs::metadata(path).map_err(io)?.is_file() {
            // Opening a pipe would wait for someone to write.
            return Err(io(io::Error::other(
                "not a regular file; points are read out of order, so save it as one first",
            )));
        }
        File::open(path).and_then(|file| Self::of_file(path, file)).map_err(io)
    }

    /// Opens a file that is read whole: one request brings all of it from an address.
    pub(crate) fn open_small(path: &Path) -> Result<Self> {
        Self::open_small_again(path, None)
    }

    /// Opens a file that is read whole and was opened before with a stamp: what was fetched of it needs no request.
    pub(crate) fn open_small_again(path: &Path, before: Option<&Stamp>) -> Result<Self> {
        if is_address(path) { Self::open_remote(path, true, before) } else { Self::open(path) }
    }

    fn open_remote(path: &Path, is_small: bool, before: Option<&Stamp>) -> Result<Self> {
        let remote = Remote::open(path, is_small, before).map_err(|error| Error::io(path, error))?;
        Ok(Self { path: path.to_owned(), length: remote.length(), place: Place::Remote(Box::new(remote)) })
    }

    /// Opens a file by `open` and makes something of it by `make`. Where that shows that bytes from a server are damaged, they
    /// are fetched once more.
    pub(crate) fn open_twice<T>(
        path: &Path,
        open: impl Fn(&Path) -> Result<Self>,
        make: impl Fn(Self) -> Result<T>,
    ) -> Result<T> {
        let first = open(path)?;
        let is_again = first.is_short_remote();
        match make(first) {
            Err(Error::Malformed { .. } | Error::UnknownFormat { .. }) if is_again => {
                let again = open(path)?;
                again.fetch_again(0..again.length);
                make(again).map_err(Error::same_again)
            }
            made => made,
        }
    }

    /// Whether it is a file of a server that is short enough to be fetched twice.
    pub(crate) fn is_short_remote(&self) -> bool {
        self.is_remote() && self.length <= MOST_AGAIN
    }

    /// Drops what was fetched of a file of which a part has turned out to be damaged, from the cache, too. Returns whether the
    /// part is fetched once more when it is read again: each is at most once, and only where the server has not failed.
    pub(crate) fn fetch_again(&self, part: Range<u64>) -> bool {
        match &self.place {
            Place::Disk(..) | Place::Memory(_) => false,
            Place::Remote(remote) => remote.fetch_again(part.start..part.end.min(self.length)),
        }
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
        let disk = Disk::new(file);
        let state = disk.state()?;
        Ok(Self { path: path.to_owned(), length: state.length, place: Place::Disk(disk, state) })
    }

    /// What a file holds when it is decompressed; messages name it by the path of the file.
    pub(crate) fn of_memory(path: &Path, bytes: Vec<u8>) -> Self {
        Self { path: path.to_owned(), length: bytes.len() as u64, place: Place::Memory(bytes) }
    }

    /// Where the source is: how messages name it, and how it is opened again.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the parts of a cloud that the file names lie beside: its path, or the address that its folder has moved to.
    pub fn base(&self) -> &Path {
        match &self.place {
            Place::Remote(remote) => remote.base(),
            Place::Disk(..) | Place::Memory(_) => &self.path,
        }
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

    fn read_some_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        match &self.place {
            Place::Disk(file, opened) => {
                let count = file.read_some_at(offset, buffer)?;
                check_same(*opened, file.state()?).map(|()| count)
            }
            Place::Remote(remote) => remote.read_some_at(offset, buffer),
            Place::Memory(bytes) => {
                let rest = usize::try_from(offset).ok().and_then(|offset| bytes.get(offset..)).unwrap_or_default();
                let count = rest.len().min(buffer.len());
                buffer[..count].copy_from_slice(&rest[..count]);
                Ok(count)
            }
        }
    }

    /// The file as it was opened; `None` for what is no file of the disk with a name.
    pub fn named_file(&self) -> Option<NamedFile> {
        let Place::Disk(_, opened) = &self.place else { return None };
        let has_name = self.path != Path::new(Self::STANDARD_INPUT);
        has_name.then(|| NamedFile { path: self.path.clone(), opened: *opened })
    }

    /// Checks that nobody has written to the file since it was opened; what was read may be of both files.
    ///
    /// # Errors
    /// If somebody has.
    pub(crate) fn check_as_opened(&self) -> Result<()> {
        self.check_same().map_err(|error| Error::io(&self.path, error))
    }

    /// As `check_as_opened`, without the name of the file.
    pub(crate) fn check_same(&self) -> io::Result<()> {
        let Place::Disk(file, opened) = &self.place else { return Ok(()) };
        check_same(*opened, file.state()?)
    }

    /// Whether it comes from an address.
    pub fn is_remote(&self) -> bool {
        matches!(self.place, Place::Remote(_))
    }

    /// Whether a server has failed to send some of it.
    pub fn has_failed(&self) -> bool {
        matches!(&self.place, Place::Remote(remote) if remote.has_failed())
    }

    /// What tells the file at an address from others that were or will be there; `None` for files, and where the server
    /// sends nothing of the kind.
    pub fn remote_identity(&self) -> Option<String> {
        match &self.place {
            Place::Disk(..) | Place::Memory(_) => None,
            Place::Remote(remote) => remote.identity(),
        }
    }

    /// The stamp of a file at an address, if another file would have another one.
    pub(crate) fn stamp(&self) -> Option<&Stamp> {
        match &self.place {
            Place::Disk(..) | Place::Memory(_) => None,
            Place::Remote(remote) => remote.stamp(),
        }
    }

    /// Brings a part that is about to be read, by few requests.
    ///
    /// # Errors
    /// If it cannot be fetched.
    pub(crate) fn fetch(&self, offset: u64, length: u64) -> io::Result<()> {
        match &self.place {
            Place::Disk(..) | Place::Memory(_) => Ok(()),
            Place::Remote(remote) => {
                let end = offset.saturating_add(length).min(self.length);
                remote.fetch(offset.min(end)..end)
            }
        }
    }

    /// Brings all of it.
    ///
    /// # Errors
    /// If it is longer than fetched files may be, or cannot be fetched.
    pub(crate) fn fetch_all(&self) -> Result<()> {
        match &self.place {
            Place::Disk(..) | Place::Memory(_) => Ok(()),
            Place::Remote(remote) => remote.fetch_all().map_err(|error| Error::io(&self.path, error)),
        }
    }

    /// Bytes `start..end` as a stream with a cursor of its own.
    pub(crate) fn section(&self, start: u64, end: u64) -> Section<'_> {
        Section { file: self, start, position: start, end }
    }
}

/// Checks that the state of a file is that which it had when it was opened.
fn check_same(opened: State, now: State) -> io::Result<()> {
    if now == opened { Ok(()) } else { Err(io::Error::other("it has been changed since it was opened; open it again")) }
}

/// All that comes from standard input, as a file.
fn standard_input() -> io::Result<File> {
    // A failure is kept, too: what is left in the pipe is no file.
    static COPY: OnceLock<std::result::Result<File, (ErrorKind, String)>> = OnceLock::new();
    let copy = || copy_of_standard_input().map_err(|error| (error.kind(), error.to_string()));
    match COPY.get_or_init(copy) {
        Ok(file) => file.try_clone(),
        Err((kind, problem)) => Err(io::Error::new(*kind, problem.as_str())),
    }
}

fn copy_of_standard_input() -> io::Result<File> {
    let mut input = io::stdin().lock();
    if input.is_terminal() {
        return Err(io::Error::other("standard input is a terminal; pipe a file of points into it"));
    }
    let mut file = tempfile::tempfile().map_err(no_room)?;
    io::copy(&mut input, &mut file)
        .map_err(|error| if is_for_want_of_room(&error) { no_room(error) } else { error })?;
    Ok(file)
}

/// Why what comes from standard input cannot be kept, and what can be done.
fn no_room(reason: io::Error) -> io::Error {
    let variable = if cfg!(windows) { "TMP" } else { "TMPDIR" };
    let (folder, why) = (std::env::temp_dir(), why_unwritten(&reason));
    let problem =
        format!("cannot be kept in the temporary folder {}: {why}; {variable} can name another", shown(&folder));
    io::Error::new(reason.kind(), problem)
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
