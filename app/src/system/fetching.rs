//! The files that are being fetched whole from servers, for the window to show and to stop.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A file that is being fetched.
#[derive(Clone, Debug, PartialEq)]
pub struct Fetch {
    pub address: PathBuf,
    /// Bytes so far, and in all.
    pub done: u64,
    pub total: u64,
    is_stopped: bool,
}

static UNDER_WAY: Mutex<Vec<Fetch>> = Mutex::new(Vec::new());

fn under_way() -> MutexGuard<'static, Vec<Fetch>> {
    UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Notes how much of a file was fetched, of `total` bytes at its end. Returns whether to go on.
pub fn note(address: &Path, done: u64, total: u64) -> bool {
    let mut all = under_way();
    let place = all.iter().position(|fetch| fetch.address == address);
    let is_stopped = place.is_some_and(|place| all[place].is_stopped);
    match place {
        Some(place) if done >= total => drop(all.remove(place)),
        Some(place) => (all[place].done, all[place].total) = (done, total),
        None if done < total => all.push(Fetch { address: address.to_owned(), done, total, is_stopped }),
        None => {}
    }
    !is_stopped
}

/// The file that has been fetched for the longest time, and the number of all.
pub fn first() -> Option<(Fetch, usize)> {
    let all = under_way();
    Some((all.first()?.clone(), all.len()))
}

/// Stops all fetches at their next report. What has come stays in the cache.
pub fn stop_all() {
    under_way().iter_mut().for_each(|fetch| fetch.is_stopped = true);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fetch_is_known_until_its_end_and_stops_when_it_is_told_to() {
        let address = Path::new("http://host/a.laz");
        assert!(note(address, 0, 10) && note(address, 4, 10));
        assert_eq!(first().map(|(fetch, count)| (fetch.done, fetch.total, count)), Some((4, 10, 1)));
        stop_all();
        assert!(!note(address, 8, 10), "it stops at the next report");
        assert!(!note(address, 10, 10) && first().is_none(), "its end is told, too");
        assert!(note(address, 8, 10), "and it may begin again");
        note(address, 10, 10);
    }
}
