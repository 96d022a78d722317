//! Rows that several threads make of the blocks of a file, written in the order of the blocks.
//!
//! Threads take the blocks in order. Each waits for its turn to hand its rows over; then they are cut into pieces of
//! one length, which the thread encodes after its turn, while the next thread has its own. Pieces are written in order,
//! too. Threads that are ahead wait, so what is held in memory does not grow with the file.

use std::collections::BTreeMap;
use std::io;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A thread that holds rows of this size in bytes waits for its turn within its block.
const MOST_HELD: usize = 4 << 20;
/// The number of encoded pieces that wait for one before them, for each thread.
const PIECES_PER_THREAD: usize = 4;
/// The time after which a waiting thread looks whether the work was cancelled.
const PATIENCE: Duration = Duration::from_millis(50);

pub struct InOrder<'a> {
    /// The length of a piece in bytes.
    length: usize,
    encode: &'a (dyn Fn(Vec<u8>) -> io::Result<Vec<u8>> + Sync),
    is_cancelled: &'a (dyn Fn() -> bool + Sync),
    most_waiting: usize,
    line: Mutex<Line>,
    turned: Condvar,
    out: Mutex<Out<'a>>,
    written: Condvar,
}

struct Line {
    /// The block whose turn it is.
    block: usize,
    /// Rows of the piece that is not full yet.
    pending: Vec<u8>,
    /// The number of full pieces.
    pieces: usize,
}

struct Out<'a> {
    write: &'a mut (dyn FnMut(Vec<u8>) -> io::Result<()> + Send),
    /// The piece that is written next.
    next: usize,
    waiting: BTreeMap<usize, Vec<u8>>,
    error: Option<io::Error>,
    has_failed: bool,
}

impl<'a> InOrder<'a> {
    /// `write` gets what `encode` makes of pieces of `length` bytes, in order; the last piece may be shorter.
    pub fn new(
        length: usize,
        encode: &'a (dyn Fn(Vec<u8>) -> io::Result<Vec<u8>> + Sync),
        write: &'a mut (dyn FnMut(Vec<u8>) -> io::Result<()> + Send),
        is_cancelled: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        Self {
            length,
            encode,
            is_cancelled,
            most_waiting: PIECES_PER_THREAD * rayon::current_num_threads(),
            line: Mutex::new(Line { block: 0, pending: Vec::with_capacity(length), pieces: 0 }),
            turned: Condvar::new(),
            out: Mutex::new(Out { write, next: 0, waiting: BTreeMap::new(), error: None, has_failed: false }),
            written: Condvar::new(),
        }
    }

    /// Calls `work` with the numbers of blocks, on several threads, and with a buffer that each thread reuses. The rows
    /// that it gives follow those of earlier calls.
    pub fn blocks(&self, count: usize, threads: usize, work: &(dyn Fn(usize, &mut Rows<'_, 'a>, &mut Vec<u8>) + Sync)) {
        locked(&self.line).block = 0;
        let next = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..threads.min(count) {
                scope.spawn(|| {
                    let mut buffer = Vec::new();
                    while !self.is_stopped() {
                        let block = next.fetch_add(1, Ordering::Relaxed);
                        if block >= count {
                            break;
                        }
                        let mut rows = Rows { order: self, block, held: Vec::new() };
                        work(block, &mut rows, &mut buffer);
                        self.hand_over(block, &mut rows.held, true);
                    }
                });
            }
        });
    }

    /// Whether the work was cancelled or has failed.
    pub fn is_stopped(&self) -> bool {
        (self.is_cancelled)() || locked(&self.out).has_failed
    }

    /// Ends the work with an error.
    pub fn fail(&self, error: io::Error) {
        let mut out = locked(&self.out);
        out.has_failed = true;
        out.error.get_or_insert(error);
    }

    /// Writes the rows that are left.
    ///
    /// # Errors
    /// What failed first.
    pub fn finish(self) -> io::Result<()> {
        let Line { pending, pieces, .. } =
            std::mem::replace(&mut *locked(&self.line), Line { block: 0, pending: Vec::new(), pieces: 0 });
        if !pending.is_empty() && !self.is_stopped() {
            self.put(pieces, pending);
        }
        locked(&self.out).error.take().map_or(Ok(()), Err)
    }

    fn hand_over(&self, block: usize, rows: &mut Vec<u8>, is_end: bool) {
        let mut line = locked(&self.line);
        while line.block != block {
            if self.is_stopped() {
                return;
            }
            line = self.turned.wait_timeout(line, PATIENCE).unwrap_or_else(PoisonError::into_inner).0;
        }
        let mut full = Vec::new();
        let mut rest = rows.as_slice();
        while !rest.is_empty() {
            let (now, later) = rest.split_at((self.length - line.pending.len()).min(rest.len()));
            line.pending.extend_from_slice(now);
            rest = later;
            if line.pending.len() == self.length {
                full.push((line.pieces, std::mem::replace(&mut line.pending, Vec::with_capacity(self.length))));
                line.pieces += 1;
            }
        }
        rows.clear();
        if is_end {
            line.block += 1;
            self.turned.notify_all();
        }
        drop(line);
        full.into_iter().for_each(|(number, piece)| self.put(number, piece));
    }

    fn put(&self, number: usize, piece: Vec<u8>) {
        let encoded = match (self.encode)(piece) {
            Ok(encoded) => encoded,
            Err(error) => return self.fail(error),
        };
        let mut out = locked(&self.out);
        while number >= out.next + self.most_waiting {
            if out.has_failed || (self.is_cancelled)() {
                return;
            }
            out = self.written.wait_timeout(out, PATIENCE).unwrap_or_else(PoisonError::into_inner).0;
        }
        let out = &mut *out;
        out.waiting.insert(number, encoded);
        while let Some(encoded) = out.waiting.remove(&out.next) {
            out.next += 1;
            if !out.has_failed
                && let Err(error) = (out.write)(encoded)
            {
                out.has_failed = true;
                out.error = Some(error);
            }
        }
        self.written.notify_all();
    }
}

/// The rows of one block.
pub struct Rows<'o, 'a> {
    order: &'o InOrder<'a>,
    block: usize,
    held: Vec<u8>,
}

impl Rows<'_, '_> {
    pub fn give(&mut self, rows: &[u8]) {
        self.held.extend_from_slice(rows);
        if self.held.len() >= MOST_HELD {
            self.order.hand_over(self.block, &mut self.held, false);
        }
    }
}

impl Drop for Rows<'_, '_> {
    fn drop(&mut self) {
        // The others must not wait for the turn of a thread that is gone.
        if std::thread::panicking() {
            self.order.fail(io::Error::other("a thread that made rows has failed"));
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;

    /// The rows of a block: its number as often as it says; some blocks are larger than what is held of one.
    fn block(number: usize) -> Vec<u8> {
        let count = if number % 17 == 3 { MOST_HELD + 1234 } else { number * 7919 % 5000 };
        vec![number as u8; count]
    }

    #[test]
    fn rows_are_written_in_the_order_of_blocks_and_in_pieces_of_one_length() {
        let mut pieces: Vec<Vec<u8>> = Vec::new();
        let mut write = |piece| {
            pieces.push(piece);
            Ok(())
        };
        let order = InOrder::new(1000, &|piece| Ok(piece), &mut write, &|| false);
        let work = |number: usize, rows: &mut Rows<'_, '_>, _: &mut Vec<u8>| {
            block(number).chunks(70_001).for_each(|part| rows.give(part));
        };
        order.blocks(40, 4, &work);
        order.blocks(3, 4, &work);
        order.finish().unwrap();
        let expected: Vec<u8> = (0..40).chain(0..3).flat_map(block).collect();
        assert!(pieces.concat() == expected);
        assert!(pieces[..pieces.len() - 1].iter().all(|piece| piece.len() == 1000));
    }

    #[test]
    fn what_fails_or_is_cancelled_ends_the_work() {
        let work = |number: usize, rows: &mut Rows<'_, '_>, _: &mut Vec<u8>| rows.give(&block(number));
        let mut count = 0;
        let mut write = |_| {
            count += 1;
            if count > 5 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(()) }
        };
        let order = InOrder::new(1000, &|piece| Ok(piece), &mut write, &|| false);
        order.blocks(1000, 4, &work);
        assert_eq!(order.finish().unwrap_err().kind(), io::ErrorKind::StorageFull);
        assert_eq!(count, 6, "nothing is written after the failure");
        let is_cancelled = AtomicBool::new(false);
        let mut write = |_| {
            is_cancelled.store(true, Ordering::Relaxed);
            Ok(())
        };
        let is_over = || is_cancelled.load(Ordering::Relaxed);
        let order = InOrder::new(1000, &|piece| Ok(piece), &mut write, &is_over);
        order.blocks(1000, 4, &work);
        order.finish().unwrap();
        assert!(is_cancelled.into_inner());
    }
}
