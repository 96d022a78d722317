//! The one place that writes to standard output and standard error.
//!
//! Messages quote file names, attributes and words of the command line, which may hold any characters. Those that
//! control a terminal, break a line or change the direction of writing are escaped, so that no file name can pass for a
//! message of this program.

use std::borrow::Cow;
use std::io::Write;

use serde::Serialize;
use tracing_subscriber::fmt::MakeWriter;

/// The most characters of a message: about a screen full.
const MOST_TOLD: usize = 1500;

/// Whether a terminal interprets a character instead of showing it.
fn is_steering(character: char) -> bool {
    character.is_control()
        // Marks, embeddings, overrides and isolates of bidirectional text, and line and paragraph separators.
        || matches!(character, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Returns the text on one line. Characters that control a terminal become escapes such as `\u{1b}` and `\n`.
pub fn escaped(text: &str) -> Cow<'_, str> {
    if !text.contains(is_steering) {
        return Cow::Borrowed(text);
    }
    let escape = |character: char| {
        if is_steering(character) { character.escape_default().to_string() } else { character.to_string() }
    };
    Cow::Owned(text.chars().map(escape).collect())
}

/// Writes the lines of a result to standard output. It is no error if the reader has seen enough (`| head`) and closes
/// the pipe.
///
/// # Errors
/// If the output cannot be written, as on a full disk.
pub fn print<Line: AsRef<str>>(lines: impl IntoIterator<Item = Line>) -> anyhow::Result<()> {
    let text: String = lines.into_iter().flat_map(|line| [escaped(line.as_ref()).into_owned(), "\n".into()]).collect();
    put(&text)
}

/// Writes a result as JSON to standard output, escaped by JSON's own rules.
///
/// # Errors
/// As for `print`.
pub fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    put(&(json_text(value)? + "\n"))
}

/// Formats JSON on several lines. Outside of its strings, only line breaks control a terminal.
fn json_text(value: &impl Serialize) -> serde_json::Result<String> {
    let text = serde_json::to_string_pretty(value)?;
    // Within strings serde_json has escaped the characters below U+0020. The others to be escaped lie below U+10000, so
    // that four digits suffice.
    let escape = |character: char| match character {
        '\n' => "\n".to_owned(),
        character if is_steering(character) => format!("\\u{:04x}", u32::from(character)),
        character => character.to_string(),
    };
    Ok(text.chars().map(escape).collect())
}

fn put(text: &str) -> anyhow::Result<()> {
    let mut output = std::io::stdout().lock();
    match output.write_all(text.as_bytes()).and_then(|()| output.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(codec::Error::not_written("standard output".as_ref(), error).into())
        }
        _ => Ok(()),
    }
}

/// Writes an error or a warning to standard error, as one line. If that fails, there is no other place to report it.
pub fn complain(message: &str) {
    let line = format!("glint: {}\n", escaped(&param::shortened(message, MOST_TOLD)));
    let _ = std::io::stderr().write_all(line.as_bytes());
}

/// Writes each message as a warning.
pub fn warn<Message: AsRef<str>>(messages: impl IntoIterator<Item = Message>) {
    messages.into_iter().for_each(|message| complain(&format!("warning: {}", message.as_ref())));
}

/// Writes the first few of many messages of one kind, and at the end how many more there were.
pub struct Few {
    what: &'static str,
    count: usize,
}

/// How many messages of one kind are written.
const FEW: usize = 5;

impl Few {
    /// `what` names the subject of the messages, in the plural: `clouds that cannot be read`.
    pub fn of(what: &'static str) -> Self {
        Self { what, count: 0 }
    }

    pub fn complain(&mut self, message: &str) {
        self.count += 1;
        if self.count <= FEW {
            complain(message);
        }
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// Writes how many messages were left out, when no more will come.
    pub fn end(&mut self) {
        let untold = std::mem::take(&mut self.count).saturating_sub(FEW);
        if untold > 0 {
            complain(&format!("and {untold} more {}", self.what));
        }
    }
}

/// Writes lines of the log to standard error.
pub struct Log;

impl<'a> MakeWriter<'a> for Log {
    type Writer = Self;

    fn make_writer(&'a self) -> Self {
        Self
    }
}

impl Write for Log {
    /// Writes one event, which ends with a line break.
    fn write(&mut self, event: &[u8]) -> std::io::Result<usize> {
        let text = String::from_utf8_lossy(event);
        let line = format!("{}\n", escaped(text.trim_end_matches('\n')));
        std::io::stderr().write_all(line.as_bytes())?;
        Ok(event.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Text that controls a terminal in every way: sequences of C0 and C1, the bell, line breaks, bidirectional marks.
    const EVIL: &str = "a\u{1b}[31m\u{7}\r\nglint: \u{9b}2J\u{7f}\u{202e}\u{2066}\u{61c}\u{2028}z";

    #[test]
    fn what_steers_a_terminal_is_shown_as_escapes_on_one_line() {
        let told = r"a\u{1b}[31m\u{7}\r\nglint: \u{9b}2J\u{7f}\u{202e}\u{2066}\u{61c}\u{2028}z";
        assert_eq!(escaped(EVIL), told);
        assert_eq!(escaped("Straße 東京 🏔, 5 µm"), "Straße 東京 🏔, 5 µm");
    }

    #[test]
    fn json_stays_json_and_steers_nothing() {
        let value = serde_json::json!({ EVIL: [EVIL, "plain"] });
        let text = json_text(&value).unwrap();
        assert!(!text.replace('\n', "").contains(is_steering), "{text}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), value);
    }

    #[test]
    fn a_log_takes_whole_events() {
        assert_eq!(Log.write("an event of a test, escaped: \u{1b}\n".as_bytes()).unwrap(), 31);
    }
}
