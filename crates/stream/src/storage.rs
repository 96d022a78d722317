//! Files that many threads write and read at any offset.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::{Error, Result, regular_file};

/// A file that grows at its end and is read at any offset.
pub struct Storage {
    path: PathBuf,
    end: AtomicU64,
    /// The largest size in bytes; tests simulate small disks with it.
    limit: u64,
    #[cfg(unix)]
    file: File,
    #[cfg(not(unix))]
    file: std::sync::Mutex<File>,
}

impl Storage {
    pub fn create(path: &Path, limit: u64) -> Result<Self> {
        let file = File::options().read(true).write(true).create_new(true).open(path);
        Ok(Self::new(path, file.map_err(|error| Error::not_written(path, error))?, 0, limit))
    }

    /// Opens an existing file for reading only. `Damaged` if it is not a regular file but a link, a pipe or a folder.
    pub fn open(path: &Path) -> Result<Self> {
        let io = |error| Error::io(path, error);
        regular_file::check_writable(path).map_err(|error| Error::damaged(path, error.to_string()))?;
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        Ok(Self::new(path, file, length, length))
    }

    /// Opens a file for writing at any offset and gives it `length` bytes: existing ones are kept, missing ones are
    /// zero.
    pub fn sized(path: &Path, length: u64) -> Result<Self> {
        let file = regular_file::check_writable(path)
            .and_then(|()| File::options().read(true).write(true).create(true).truncate(false).open(path));
        let file = file.and_then(|file| file.set_len(length).map(|()| file));
        Ok(Self::new(path, file.map_err(|error| Error::not_written(path, error))?, length, length))
    }

    fn new(path: &Path, file: File, end: u64, limit: u64) -> Self {
        #[cfg(not(unix))]
        let file = std::sync::Mutex::new(file);
        Self { path: path.to_owned(), end: AtomicU64::new(end), limit, file }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the open file is still the one with its name.
    pub fn is_in_place(&self) -> bool {
        #[cfg(unix)]
        let file = &self.file;
        #[cfg(not(unix))]
        let file = &self.locked();
        regular_file::is_current(file, &self.path)
    }

    /// The size of the file in bytes.
    pub fn length(&self) -> u64 {
        self.end.load(Ordering::Relaxed)
    }

    /// Appends `bytes` and returns their offset.
    pub fn append(&self, bytes: &[u8]) -> Result<u64> {
        let offset = self.end.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        let written = if offset + bytes.len() as u64 > self.limit {
            Err(io::ErrorKind::StorageFull.into())
        } else {
            self.write_at(offset, bytes)
        };
        written.map_err(|error| Error::not_written(&self.path, error))?;
        Ok(offset)
    }

    /// Writes `bytes` at byte `offset`, within the file.
    pub fn write(&self, offset: u64, bytes: &[u8]) -> Result<()> {
        self.write_at(offset, bytes).map_err(|error| Error::not_written(&self.path, error))
    }

    /// Fills `buffer` from byte `offset`.
    pub fn read(&self, offset: u64, buffer: &mut [u8]) -> Result<()> {
        self.read_at(offset, buffer).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => Error::damaged(&self.path, "the file is cut short"),
            _ => Error::io(&self.path, error),
        })
    }

    /// Waits until the whole file is on the disk.
    pub fn sync(&self) -> Result<()> {
        #[cfg(unix)]
        let synced = self.file.sync_data();
        #[cfg(not(unix))]
        let synced = self.locked().sync_data();
        synced.map_err(|error| Error::not_written(&self.path, error))
    }

    #[cfg(unix)]
    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        std::os::unix::fs::FileExt::write_all_at(&self.file, bytes, offset)
    }

    #[cfg(unix)]
    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, buffer, offset)
    }

    #[cfg(not(unix))]
    fn locked(&self) -> std::sync::MutexGuard<'_, File> {
        self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    #[cfg(not(unix))]
    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        use io::{Seek as _, Write as _};
        let mut file = self.locked();
        file.seek(io::SeekFrom::Start(offset))?;
        file.write_all(bytes)
    }

    #[cfg(not(unix))]
    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        use io::{Read as _, Seek as _};
        let mut file = self.locked();
        file.seek(io::SeekFrom::Start(offset))?;
        file.read_exact(buffer)
    }
}
