//! Chunks on their way from the loading threads to the render thread. The queues of the window's events and of the
//! render thread's commands have no limit, and a frame can take long. So chunks wait here before they enter the queues.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// The most bytes of chunks that may be under way: about two million points.
const MOST_BYTES: u64 = 64 << 20;

#[derive(Default)]
pub struct UnderWay {
    bytes: Mutex<u64>,
    has_less: Condvar,
}

/// Travels with a chunk. Dropping it marks the chunk as received.
pub struct Pass {
    bytes: u64,
    under_way: Arc<UnderWay>,
}

impl UnderWay {
    /// Waits until there is room for `bytes`. More bytes than the limit wait until nothing else is under way.
    pub fn enter(self: &Arc<Self>, bytes: u64) -> Pass {
        let is_full = |under_way: &mut u64| *under_way > 0 && *under_way + bytes > MOST_BYTES;
        let waited = self.has_less.wait_while(self.lock(), is_full);
        *waited.unwrap_or_else(PoisonError::into_inner) += bytes;
        Pass { bytes, under_way: self.clone() }
    }

    fn lock(&self) -> MutexGuard<'_, u64> {
        self.bytes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Pass {
    fn drop(&mut self) {
        *self.under_way.lock() -= self.bytes;
        self.under_way.has_less.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;

    #[test]
    fn no_more_is_under_way_than_may_be_and_all_arrives() {
        let under_way = Arc::new(UnderWay::default());
        let (sender, receiver) = channel::<Pass>();
        let sizes = [MOST_BYTES / 3, MOST_BYTES / 5, 2 * MOST_BYTES, 1000];
        let all = 40;
        std::thread::scope(|scope| {
            let entering = under_way.clone();
            scope.spawn(move || {
                for index in 0..all {
                    let pass = entering.enter(sizes[index % sizes.len()]);
                    let bytes = *entering.lock();
                    assert!(bytes <= MOST_BYTES.max(pass.bytes), "{bytes} bytes are under way");
                    sender.send(pass).unwrap();
                }
            });
            let arrive = |pass| {
                // The receiver is slower than the sender.
                std::thread::sleep(Duration::from_millis(1));
                drop(pass);
            };
            assert_eq!(receiver.into_iter().map(arrive).count(), all);
        });
        assert_eq!(*under_way.lock(), 0);
    }
}
