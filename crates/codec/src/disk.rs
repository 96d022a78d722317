//! A file that many threads read and write at once, each at its own offset.

use std::fs::{File, Metadata};
use std::io;
#[cfg(not(unix))]
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
#[cfg(not(unix))]
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

/// What is different after another program has written to a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    pub length: u64,
    modified: Option<SystemTime>,
}

impl State {
    pub fn of(metadata: &Metadata) -> Self {
        Self { length: metadata.len(), modified: metadata.modified().ok() }
    }
}

pub struct Disk {
    #[cfg(unix)]
    file: File,
    #[cfg(not(unix))]
    file: Mutex<File>,
}

impl Disk {
    pub fn new(file: File) -> Self {
        #[cfg(not(unix))]
        let file = Mutex::new(file);
        Self { file }
    }

    /// The length in bytes, and when the file was last written to, if the system knows.
    pub fn state(&self) -> io::Result<State> {
        #[cfg(unix)]
        let metadata = self.file.metadata()?;
        #[cfg(not(unix))]
        let metadata = self.file.lock().unwrap_or_else(PoisonError::into_inner).metadata()?;
        Ok(State::of(&metadata))
    }

    #[cfg(unix)]
    pub fn read_some_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        std::os::unix::fs::FileExt::read_at(&self.file, buffer, offset)
    }

    #[cfg(not(unix))]
    pub fn read_some_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(offset))?;
        file.read(buffer)
    }

    #[cfg(unix)]
    pub fn write_all_at(&self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        std::os::unix::fs::FileExt::write_all_at(&self.file, bytes, offset)
    }

    #[cfg(not(unix))]
    pub fn write_all_at(&self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(offset))?;
        file.write_all(bytes)
    }
}
