//! Files of servers, fetched in blocks as they are needed, to a cache on disk.
//!
//! A file is the one that was opened: each answer has its stamp (length, ETag, time of change), or the read fails; so it does
//! where a weak ETag is another one. The cache keeps blocks under address and stamp. An opening asks the server whether the
//! file still has that stamp; a block of an earlier run is used if its checksum is right. A file without a sure ETag and time
//! of change is kept for one opening only.

mod certificates;
mod kept;
mod network;
mod request;

use std::cell::Cell;
use std::collections::{BTreeSet, HashMap};
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, OnceLock, PoisonError};

use crate::address::Address;
use crate::at_once::at_once;
use crate::bytes::MOST_AGAIN;
use crate::disk::Disk;
use kept::{BLOCK, Kept};
use network::network;
pub use network::{Network, trust_address, use_network};
pub use request::NO_ANSWER;
pub use request::Stamp;
use request::{Answer, Failure, First, STOPPED};

/// The bytes that the first request of a file asks for: most heads are shorter.
const FIRST: u64 = BLOCK;
/// The fewest bytes that are asked for at once after that.
const LEAST: u64 = 64 << 10;
/// The most bytes of a request, and the number of requests of one read at a time.
const PIECE: u64 = 1 << 20;
const PIECES_AT_ONCE: usize = 4;
/// The bytes between two reports of a whole file's progress, each of which may stop the fetch.
const REPORT: u64 = 64 << 10;

/// A file of a server.
pub struct Remote {
    path: PathBuf,
    address: Address,
    /// What parts lie beside.
    base: PathBuf,
    stamp: Stamp,
    /// The weak ETag of the first answer that has one.
    weak: OnceLock<String>,
    disk: Disk,
    kept: Option<Kept>,
    state: Mutex<State>,
    changed: Condvar,
    /// Whether the server sends parts of the file. Not known before the first one where the cache has the first bytes.
    has_parts: OnceLock<bool>,
    /// Held while the whole file comes although a part was asked for.
    whole: Mutex<()>,
    /// How often it was said not to go on.
    stops: AtomicUsize,
    /// The bytes that are there of a whole file that is being fetched.
    so_far: Mutex<Option<u64>>,
}

#[derive(Default)]
struct State {
    present: BTreeSet<Run>,
    pending: BTreeSet<u64>,
    /// The checksums of blocks that an earlier run has fetched.
    unchecked: HashMap<u64, u32>,
    /// Whether bytes have turned out to be damaged, and the blocks that have.
    is_doubted: bool,
    dropped: BTreeSet<u64>,
    /// Whether bytes could not be fetched.
    has_failed: bool,
}

/// Blocks that follow one another: the last one, and the first.
type Run = (u64, u64);

impl State {
    fn has(&self, block: u64) -> bool {
        self.present.range((block, 0)..).next().is_some_and(|(_, first)| *first <= block)
    }

    fn take(&mut self, block: u64) {
        let run = self.present.range((block, 0)..).next().copied().filter(|(_, first)| *first <= block);
        if let Some((last, first)) = run {
            self.present.remove(&(last, first));
            self.present.extend((first < block).then(|| (block - 1, first)));
            self.present.extend((block < last).then_some((last, block + 1)));
        }
    }

    fn put(&mut self, block: u64) {
        if self.has(block) {
            return;
        }
        let (mut first, mut last) = (block, block);
        let before =
            block.checked_sub(1).and_then(|end| self.present.range((end, 0)..=(end, u64::MAX)).next().copied());
        let after = self.present.range((block, 0)..).next().copied().filter(|(_, start)| *start == block + 1);
        for run in before.into_iter().chain(after) {
            self.present.remove(&run);
            (last, first) = (last.max(run.0), first.min(run.1));
        }
        self.present.insert((last, first));
    }
}

impl Remote {
    /// Opens the file at an address. If it is small, `is_small`, all of it is asked for at once. A file that was opened
    /// before with a stamp, `before`, is the one that it was: what the cache has of it is taken without a request.
    ///
    /// # Errors
    /// Says why it cannot be read; if it is not the one that it was.
    pub fn open(path: &Path, is_small: bool, before: Option<&Stamp>) -> io::Result<Self> {
        let address = Address::parse(&path.to_string_lossy()).map_err(io::Error::other)?;
        let folder = network().folder.as_ref().map(|folder| kept::folder(folder, &address));
        let known = folder.as_deref().and_then(kept::known);
        let most = if is_small { None } else { Some(FIRST) };
        let first = match before {
            Some(before) if known.as_ref() == Some(before) => First::Unchanged(address.clone()),
            _ => {
                // A wait is shown, and may be stopped.
                let has_waited = Cell::new(false);
                let goes_on = || {
                    has_waited.set(true);
                    (network().watch)(path, Some((0, 1)))
                };
                let first = request::first(&address, most, known.as_ref(), &goes_on);
                if has_waited.get() {
                    (network().watch)(path, Some((1, 1)));
                }
                first?
            }
        };
        let (base, stamp, answer) = match (first, known) {
            (First::Unchanged(base), Some(known)) => (base, known, None),
            (First::Unchanged(_), None) => return Err(io::Error::other("the server says nothing about the file")),
            (First::Answer(answer), _) => (answer.base.clone(), answer.stamp.clone(), Some(answer)),
        };
        if before.is_some_and(|before| *before != stamp) {
            return Err(io::Error::other(request::CHANGED));
        }
        let folder = folder.filter(|_| stamp.is_sure());
        // Where the cache cannot be written, the file is kept for this opening only.
        let kept = folder.and_then(|folder| Kept::open(&folder, &stamp).ok());
        let (file, kept, unchecked) = match kept {
            Some((file, kept, unchecked)) => (file, Some(kept), unchecked),
            None => (tempfile::tempfile()?, None, HashMap::new()),
        };
        let state = Mutex::new(State { unchecked, ..State::default() });
        let disk = Disk::new(file);
        let weak = answer.as_ref().map(|answer| answer.weak.clone()).filter(|weak| !weak.is_empty());
        let weak = weak.map_or_else(OnceLock::new, OnceLock::from);
        let has_parts = answer.as_ref().map(|answer| answer.range.end < stamp.length);
        let remote = Self {
            path: path.to_owned(),
            address,
            base: base.text().into(),
            stamp,
            weak,
            disk,
            kept,
            state,
            changed: Condvar::new(),
            has_parts: has_parts.map_or_else(OnceLock::new, OnceLock::from),
            whole: Mutex::default(),
            stops: AtomicUsize::new(0),
            so_far: Mutex::default(),
        };
        match answer.map_or(Ok(()), |answer| remote.take(answer)) {
            // What is missing is asked for again when it is read.
            Ok(()) | Err(Failure::Again(_) | Failure::Unable(_) | Failure::Later(..) | Failure::Silent) => {}
            Err(Failure::Final(problem)) => return Err(io::Error::other(problem)),
        }
        Ok(remote)
    }

    pub fn base(&self) -> &Path {
        &self.base
    }

    pub fn length(&self) -> u64 {
        self.stamp.length
    }

    /// The stamp of the file, if another file would have another one.
    pub fn stamp(&self) -> Option<&Stamp> {
        self.stamp.is_sure().then_some(&self.stamp)
    }

    /// What makes the file the one that it is; `None` if the server does not say.
    pub fn identity(&self) -> Option<String> {
        let Stamp { length, etag, modified } = &self.stamp;
        self.stamp.is_sure().then(|| format!("{length} {etag} {modified}"))
    }

    /// Reads as many bytes as there are, up to the length of the buffer.
    ///
    /// # Errors
    /// If they cannot be fetched.
    pub fn read_some_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        let wanted = (buffer.len() as u64).min(self.length().saturating_sub(offset));
        self.fetch(offset..offset + wanted)?;
        self.disk.read_some_at(offset, &mut buffer[..wanted as usize])
    }

    /// Fetches the whole file.
    ///
    /// # Errors
    /// If it is longer than fetched files may be, or cannot be fetched; what has come stays.
    pub fn fetch_all(&self) -> io::Result<()> {
        self.check_length()?;
        let length = self.length();
        let step = PIECE * PIECES_AT_ONCE as u64;
        let fetched = (0..length).step_by(step as usize).try_for_each(|start| {
            *self.so_far() = Some(start);
            if self.goes_on() { self.fetch(start..(start + step).min(length)) } else { Err(io::Error::other(STOPPED)) }
        });
        *self.so_far() = None;
        (network().watch)(&self.path, Some((length, length)));
        fetched
    }

    fn so_far(&self) -> MutexGuard<'_, Option<u64>> {
        self.so_far.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells how much of the whole file is there, if it is being fetched. Returns whether to go on.
    fn goes_on(&self) -> bool {
        // All of it is told at the end alone.
        let so_far = self.so_far().map(|so_far| (so_far.min(self.length().saturating_sub(1)), self.length()));
        let goes_on = (network().watch)(&self.path, so_far);
        self.stops.fetch_add(usize::from(!goes_on), Ordering::Relaxed);
        goes_on
    }

    fn stops(&self) -> usize {
        self.stops.load(Ordering::Relaxed)
    }

    /// Counts bytes that have come.
    fn count(&self, more: u64) -> io::Result<()> {
        let is_due = self.so_far().as_mut().is_some_and(|so_far| {
            let before = *so_far;
            *so_far += more;
            before / REPORT != *so_far / REPORT
        });
        if is_due && !self.goes_on() { Err(io::Error::other(STOPPED)) } else { Ok(()) }
    }

    /// Says that these bytes have turned out to be damaged. Nothing of the file that was fetched so far, or will be from now
    /// on, stays in the cache: damage elsewhere may not show. The first time, all that was fetched is fetched once more, later
    /// only bytes of which none were said to be damaged before. Returns whether reading them again brings other bytes; false
    /// where the server has failed.
    pub fn fetch_again(&self, bytes: Range<u64>) -> bool {
        let mut state = self.lock();
        if state.has_failed {
            return false;
        }
        let is_first = !std::mem::replace(&mut state.is_doubted, true);
        self.kept.iter().for_each(Kept::forget);
        if is_first {
            state.present.clear();
            state.unchecked.clear();
        }
        if bytes.start == 0 && bytes.end >= self.length() {
            return is_first;
        }
        let mut is_any = false;
        for block in bytes.start / BLOCK..bytes.end.div_ceil(BLOCK) {
            if state.dropped.insert(block) {
                state.take(block);
                is_any = true;
            }
        }
        is_any
    }

    /// Whether some bytes could not be fetched.
    pub fn has_failed(&self) -> bool {
        self.lock().has_failed
    }

    fn check_length(&self) -> io::Result<()> {
        let (length, limit) = (self.length(), network().limit);
        if length > limit {
            let [length, limit] = [length, limit].map(|bytes| bytes.div_ceil(1_000_000));
            let told =
                format!("{length} MB, more than the {limit} MB that GLINT_FETCHED_BYTES allows for fetched files");
            return Err(io::Error::other(told));
        }
        Ok(())
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn block_length(&self, block: u64) -> u64 {
        BLOCK.min(self.length().saturating_sub(block * BLOCK))
    }

    /// Makes sure that these bytes are on the disk.
    ///
    /// # Errors
    /// If they cannot be fetched, or written.
    pub fn fetch(&self, bytes: Range<u64>) -> io::Result<()> {
        if bytes.is_empty() {
            return Ok(());
        }
        let blocks = bytes.start / BLOCK..bytes.end.div_ceil(BLOCK);
        // Who stops one fetch stops all that wait meanwhile.
        let stops = self.stops();
        loop {
            let mut state = self.lock();
            self.check(&mut state, blocks.clone());
            let missing: Vec<u64> = blocks.clone().filter(|block| !state.has(*block)).collect();
            if missing.is_empty() {
                return Ok(());
            }
            if self.stops() != stops {
                return Err(io::Error::other(STOPPED));
            }
            let free: Vec<u64> = missing.into_iter().filter(|block| !state.pending.contains(block)).collect();
            if free.is_empty() {
                drop(self.changed.wait(state).unwrap_or_else(PoisonError::into_inner));
                continue;
            }
            let pieces = self.pieces(&state, &free);
            state.pending.extend(pieces.iter().cloned().flatten());
            drop(state);
            let pending = Pending { remote: self, pieces };
            let done = at_once(&pending.pieces, PIECES_AT_ONCE, |piece| self.fetch_piece(piece.clone(), stops));
            self.lock().has_failed |= done.iter().any(io::Result::is_err);
            drop(pending);
            done.into_iter().collect::<io::Result<()>>()?;
        }
    }

    /// Looks whether blocks that an earlier run has fetched are as they were.
    fn check(&self, state: &mut State, blocks: Range<u64>) {
        for block in blocks {
            let Some(checksum) = state.unchecked.remove(&block) else { continue };
            let mut bytes = vec![0; self.block_length(block) as usize];
            let mut filled = 0;
            while let Ok(count @ 1..) = self.disk.read_some_at(block * BLOCK + filled as u64, &mut bytes[filled..]) {
                filled += count;
            }
            if filled == bytes.len() && crc32fast::hash(&bytes) == checksum {
                state.put(block);
            }
        }
    }

    /// The requests for some missing blocks.
    fn pieces(&self, state: &State, missing: &[u64]) -> Vec<Range<u64>> {
        let mut pieces: Vec<Range<u64>> = Vec::new();
        for block in missing {
            match pieces.last_mut() {
                Some(last) if last.end == *block && last.end - last.start < PIECE / BLOCK => last.end += 1,
                _ => pieces.push(*block..*block + 1),
            }
        }
        // Heads and lists are read bit by bit.
        if let [one] = pieces.as_mut_slice() {
            let last = self.length().div_ceil(BLOCK);
            let is_free = |block: u64| block < last && !state.has(block) && !state.pending.contains(&block);
            while one.end - one.start < LEAST / BLOCK && is_free(one.end) {
                one.end += 1;
            }
        }
        pieces
    }

    /// Fetches blocks for a read that began after so many `stops`.
    fn fetch_piece(&self, blocks: Range<u64>, stops: usize) -> io::Result<()> {
        let range = blocks.start * BLOCK..(blocks.end * BLOCK).min(self.length());
        let mut filler = Filler { remote: self, block: blocks.start, bytes: Vec::with_capacity(BLOCK as usize) };
        let mut wholes = 0;
        let mut take_whole = |answer: Answer| {
            wholes += 1;
            // A cache on the way may send all of it now and then.
            let is_usual = self.has_parts.get().map_or(wholes > 1, |has_parts| !has_parts);
            if !is_usual && self.length() > MOST_AGAIN {
                return Err(Failure::Again("the server sends the whole file in place of a part".into()));
            }
            // Several pieces are asked for at once, and one answer has them all.
            let _alone = self.whole.lock().unwrap_or_else(PoisonError::into_inner);
            let state = self.lock();
            if blocks.clone().all(|block| state.has(block)) {
                return Ok(());
            }
            drop(state);
            if self.stops() != stops {
                return Err(Failure::Final(STOPPED.into()));
            }
            self.take(answer)
        };
        let give = &mut |at, bytes: &[u8]| {
            self.has_parts.get_or_init(|| true);
            filler.give(at, bytes)
        };
        let goes_on = || self.stops() == stops && self.goes_on();
        request::part(&self.address, range, &self.stamp, &self.weak, give, &mut take_whole, &goes_on)
    }

    /// Writes what an answer brings that is not a part of a known file.
    fn take(&self, answer: Answer) -> Result<(), Failure> {
        let range = answer.range.clone();
        let total = range.end - range.start;
        if total > FIRST {
            self.check_length().map_err(|error| Failure::Final(error.to_string()))?;
        }
        let mut filler = Filler { remote: self, block: range.start / BLOCK, bytes: Vec::with_capacity(BLOCK as usize) };
        if total <= LEAST {
            return answer.read(&mut |at, bytes| filler.give(at, bytes));
        }
        let before = self.so_far().replace(0);
        let read = answer.read(&mut |at, bytes| filler.give(at, bytes));
        if before.is_none() {
            *self.so_far() = None;
            (network().watch)(&self.path, Some((total, total)));
        }
        read
    }
}

/// Blocks that are being fetched. However that ends, by a panic, too, nobody waits for them after that.
struct Pending<'a> {
    remote: &'a Remote,
    pieces: Vec<Range<u64>>,
}

impl Drop for Pending<'_> {
    fn drop(&mut self) {
        self.remote.lock().pending.retain(|block| !self.pieces.iter().any(|piece| piece.contains(block)));
        self.remote.changed.notify_all();
    }
}

/// Puts the bytes of an answer together to blocks.
struct Filler<'a> {
    remote: &'a Remote,
    block: u64,
    bytes: Vec<u8>,
}

impl Filler<'_> {
    fn give(&mut self, at: u64, mut bytes: &[u8]) -> io::Result<()> {
        if at != self.block * BLOCK + self.bytes.len() as u64 {
            // A request that was cut is made again.
            self.block = at / BLOCK;
            self.bytes.clear();
        }
        while !bytes.is_empty() {
            let length = self.remote.block_length(self.block) as usize;
            let (now, later) = bytes.split_at((length - self.bytes.len()).min(bytes.len()));
            self.bytes.extend_from_slice(now);
            bytes = later;
            if self.bytes.len() == length {
                self.remote.disk.write_all_at(self.block * BLOCK, &self.bytes)?;
                let mut state = self.remote.lock();
                if let Some(kept) = self.remote.kept.as_ref().filter(|_| !state.is_doubted) {
                    kept.note(self.block, crc32fast::hash(&self.bytes));
                }
                state.unchecked.remove(&self.block);
                state.put(self.block);
                drop(state);
                self.block += 1;
                self.bytes.clear();
                self.remote.count(length as u64)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_that_have_come_are_known_in_any_order() {
        let mut state = State::default();
        for block in [5, 3, 4, 9, 0, 4] {
            state.put(block);
        }
        let has: Vec<u64> = (0..12).filter(|block| state.has(*block)).collect();
        assert_eq!((has, state.present.len()), (vec![0, 3, 4, 5, 9], 3));
        [4, 9, 7].into_iter().for_each(|block| state.take(block));
        let has: Vec<u64> = (0..12).filter(|block| state.has(*block)).collect();
        assert_eq!((has, state.present.len()), (vec![0, 3, 5], 3));
    }
}
