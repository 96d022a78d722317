//! Work that waits more than it computes, on threads of its own.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// The results of `work` for all items, made by up to `threads` threads, in order.
pub fn at_once<Item: Sync, Out: Send>(items: &[Item], threads: usize, work: impl Fn(&Item) -> Out + Sync) -> Vec<Out> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(items.len()));
    let run = || {
        while let Some((index, item)) = {
            let index = next.fetch_add(1, Ordering::Relaxed);
            items.get(index).map(|item| (index, item))
        } {
            let out = work(item);
            done.lock().unwrap_or_else(PoisonError::into_inner).push((index, out));
        }
    };
    match items.len() {
        0 | 1 => run(),
        count => std::thread::scope(|scope| (0..threads.min(count)).for_each(|_| drop(scope.spawn(run)))),
    }
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, out)| out).collect()
}
