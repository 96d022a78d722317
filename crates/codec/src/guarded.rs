//! Lets decoders of other crates panic on damaged bytes without harm.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

/// Runs a decoder on bytes that may be garbage. `laz` indexes and divides by what it decodes, and `ruzstd`
/// asserts what it expects, so garbage can make them panic; that panic ends the decoding of one chunk or tile and becomes a message. (It needs unwinding: `panic = "abort"` in a
/// profile would end the program instead.)
///
/// The default panic hook would print to standard error before the unwinding starts. It is replaced, once, by one that
/// prints nothing for panics of a thread inside this function and passes all others on.
pub fn guarded<T>(decode: impl FnOnce() -> T) -> Result<T, String> {
    thread_local! {
        static GUARDED: Cell<bool> = const { Cell::new(false) };
    }
    static QUIET_HOOK: Once = Once::new();
    QUIET_HOOK.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !GUARDED.get() {
                previous(info);
            }
        }));
    });
    GUARDED.set(true);
    let outcome = panic::catch_unwind(AssertUnwindSafe(decode));
    GUARDED.set(false);
    outcome.map_err(|_| "not valid compressed data".into())
}
