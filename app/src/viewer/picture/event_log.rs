//! A machine-readable log of events in the file that `GLINT_EVENT_LOG` names, with a JSON object on each line. Scripts
//! that drive the window read from it what a person sees.

use std::fs::File;
use std::io::Write as _;

use anyhow::Context as _;

/// The log; without a file it writes nothing.
pub struct EventLog {
    file: Option<File>,
    /// True if the window has not been painted since the last event was written.
    has_news: bool,
}

impl EventLog {
    /// Opens the file that the environment names.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn from_environment() -> anyhow::Result<Self> {
        let Some(path) = std::env::var_os("GLINT_EVENT_LOG").filter(|path| !path.is_empty()) else {
            return Ok(Self { file: None, has_news: false });
        };
        let open = File::options().create(true).append(true).open(&path);
        let file = open.with_context(|| format!("GLINT_EVENT_LOG: {}", std::path::Path::new(&path).display()))?;
        Ok(Self { file: Some(file), has_news: false })
    }

    pub fn write(&mut self, event: &serde_json::Value) {
        if let Some(file) = &mut self.file {
            self.has_news = true;
            // Each line is one write, so that a reader never sees half a line from this program. A full disk is no
            // reason to stop.
            if file.write_all(format!("{event}\n").as_bytes()).is_err() {
                *self = Self { file: None, has_news: false };
            }
        }
    }

    /// Notes that the window now shows the results of all events. Writes `painted` if there were events since the last
    /// paint.
    pub fn on_painted(&mut self) {
        if self.has_news {
            self.write(&serde_json::json!({ "event": "painted" }));
            self.has_news = false;
        }
    }

    /// Whether the window must be painted so that `painted` can follow the last events.
    pub fn has_news(&self) -> bool {
        self.has_news
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn painted_follows_events_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.jsonl");
        let mut log = EventLog { file: Some(File::create(&path).unwrap()), has_news: false };
        log.on_painted();
        assert!(!log.has_news());
        log.write(&json!({ "event": "ready" }));
        assert!(log.has_news());
        log.on_painted();
        log.on_painted();
        assert!(!log.has_news());
        log.write(&json!({ "event": "loaded" }));
        let text = std::fs::read_to_string(path).unwrap();
        let events: Vec<&str> = text.lines().collect();
        assert_eq!(events, [r#"{"event":"ready"}"#, r#"{"event":"painted"}"#, r#"{"event":"loaded"}"#]);
    }

    #[test]
    fn nothing_is_painted_for_a_log_without_a_file() {
        let mut log = EventLog { file: None, has_news: false };
        log.write(&json!({ "event": "ready" }));
        assert!(!log.has_news());
    }
}
