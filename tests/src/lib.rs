//! What the end-to-end tests use: the real program, run as a person or a script runs it, the folder of real and
//! malformed files, and a private X session for the program's window.
//!
//! A command, its exit status and its output:
//! ```no_run
//! let folder = tests::Folder::new();
//! let outcome = folder.glint(["info", "--json", "scan.laz"]);
//! assert_eq!(outcome.status, Some(0));
//! assert!(outcome.json()["inputs"][0]["points"].is_u64());
//! ```
//!
//! The window, driven by mouse and keyboard and judged by what is on the screen:
//! ```no_run
//! let session = tests::Session::start();
//! let window = session.open(["five-mirrors/sphere"]);
//! let before = window.wait_for_picture("the scene", |picture| tests::colors(picture) > 50);
//! window.drag(1, [400, 300], [500, 300]);
//! window.wait_for_picture("another view", |picture| *picture != before);
//! window.press("2");
//! window.type_text("office.laz");
//! assert!(window.is_open(), "{}", window.messages());
//! ```

pub mod copc_lists;
mod program;
mod real_data;
pub mod server;
mod session;

pub use program::{Folder, Outcome, lacks_adapter, shader_cache};
pub use real_data::test_data;
pub use session::{Session, Window, colors};
