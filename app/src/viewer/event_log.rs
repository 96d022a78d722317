//! A machine-readable log of what happens, a JSON object a line, into the file that `GLINT_EVENT_LOG` names. Scripts that
//! drive the window read from it what a person sees.

use std::fs::File;
use std::io::Write as _;

use anyhow::Context as _;

/// Without a file: writes nothing.
pub struct EventLog(Option<File>);

impl EventLog {
    /// # Errors
    /// If the file cannot be written.
    pub fn from_environment() -> anyhow::Result<Self> {
        let Some(path) = std::env::var_os("GLINT_EVENT_LOG").filter(|path| !path.is_empty()) else {
            return Ok(Self(None));
        };
        let open = File::options().create(true).append(true).open(&path);
        let file = open.with_context(|| format!("GLINT_EVENT_LOG: {}", std::path::Path::new(&path).display()))?;
        Ok(Self(Some(file)))
    }

    pub fn write(&mut self, event: &serde_json::Value) {
        if let Some(file) = &mut self.0 {
            // One write a line, so that a reader never sees half a line from here. A full disk is no reason to stop.
            if file.write_all(format!("{event}\n").as_bytes()).is_err() {
                self.0 = None;
            }
        }
    }
}
