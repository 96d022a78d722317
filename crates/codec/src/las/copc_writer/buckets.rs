//! Lists of records that together are larger than memory: what does not fit goes to one temporary file.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A temporary file that many lists share. It has no name, so it vanishes with the program.
pub struct Spill {
    file: Mutex<(File, u64)>,
    /// The number of bytes of all lists that are in memory; `limit` is the most there may be.
    buffered: AtomicUsize,
    limit: usize,
}

impl Spill {
    /// Makes the file in `folder`; lists keep up to `limit` bytes in memory.
    pub fn new(folder: &Path, limit: usize) -> io::Result<Self> {
        Ok(Self { file: Mutex::new((tempfile::tempfile_in(folder)?, 0)), buffered: AtomicUsize::new(0), limit })
    }
}

/// Numbered lists of records.
pub struct Buckets<'a> {
    spill: &'a Spill,
    lists: Vec<Mutex<List>>,
}

#[derive(Default)]
struct List {
    buffer: Vec<u8>,
    /// The offsets and sizes in bytes of the parts in the file.
    written: Vec<(u64, usize)>,
    bytes: u64,
}

impl<'a> Buckets<'a> {
    /// A list of this length is written as soon as memory is short.
    const BLOCK: usize = 256 << 10;

    pub fn new(spill: &'a Spill, count: usize) -> Self {
        Self { spill, lists: (0..count).map(|_| Mutex::default()).collect() }
    }

    pub fn len(&self) -> usize {
        self.lists.len()
    }

    /// The size of a list in bytes.
    pub fn bytes(&self, list: usize) -> u64 {
        locked(&self.lists[list]).bytes
    }

    pub fn append(&self, list: usize, records: &[u8]) -> io::Result<()> {
        let mut list = locked(&self.lists[list]);
        list.buffer.extend_from_slice(records);
        list.bytes += records.len() as u64;
        let buffered = self.spill.buffered.fetch_add(records.len(), Ordering::Relaxed) + records.len();
        let full = buffered > self.spill.limit;
        // With very many lists no block gets long, so at twice the limit short ones are written, too.
        if full && (list.buffer.len() >= Self::BLOCK || buffered > 2 * self.spill.limit) {
            let mut file = locked(&self.spill.file);
            let (file, end) = &mut *file;
            file.seek(SeekFrom::Start(*end))?;
            file.write_all(&list.buffer)?;
            let length = list.buffer.len();
            list.written.push((*end, length));
            *end += length as u64;
            list.buffer = Vec::new();
            self.spill.buffered.fetch_sub(length, Ordering::Relaxed);
        }
        Ok(())
    }

    /// Passes the records of a list to `take`, in pieces of some megabytes at most; the list is then empty.
    pub fn drain(&self, list: usize, mut take: impl FnMut(&[u8]) -> io::Result<()>) -> io::Result<()> {
        let list = std::mem::take(&mut *locked(&self.lists[list]));
        let mut piece = Vec::new();
        for (offset, length) in list.written {
            piece.resize(length, 0);
            {
                let mut file = locked(&self.spill.file);
                file.0.seek(SeekFrom::Start(offset))?;
                file.0.read_exact(&mut piece)?;
            }
            take(&piece)?;
        }
        self.spill.buffered.fetch_sub(list.buffer.len(), Ordering::Relaxed);
        take(&list.buffer)
    }

    /// All records of a list, which is then empty.
    pub fn take(&self, list: usize) -> io::Result<Vec<u8>> {
        let mut records = Vec::with_capacity(self.bytes(list) as usize);
        self.drain(list, |piece| {
            records.extend_from_slice(piece);
            Ok(())
        })?;
        Ok(records)
    }
}

impl Drop for Buckets<'_> {
    fn drop(&mut self) {
        let left: usize = self.lists.iter().map(|list| locked(list).buffer.len()).sum();
        self.spill.buffered.fetch_sub(left, Ordering::Relaxed);
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
