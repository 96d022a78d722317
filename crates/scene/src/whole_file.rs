//! Reads side files (scenes, views, plans, preferences), which are small texts, as a whole. Anybody may pass one on, so
//! only regular files of a plausible size are read: a pipe would block, a device never ends.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use serde::de::{DeserializeOwned, Error as _};

use crate::{Error, shown};

/// The most bytes of a side file; a scene of a thousand clouds, with a camera path of an hour, takes a tenth.
pub const MOST_BYTES: u64 = 16 << 20;

/// The memory that the values of a side file may take while it is parsed, besides ten times its bytes.
const MOST_VALUE_BYTES: usize = 48 << 20;
/// The memory of a table in bytes (1 kB measured, with the map of its keys), and of a value (280 measured).
const TABLE_BYTES: usize = 1100;
const VALUE_BYTES: usize = 300;

/// The text of a side file.
///
/// # Errors
/// Not there, not a regular file, larger than `MOST_BYTES`, or not UTF-8; names it.
pub fn read(path: &Path) -> Result<String, Error> {
    let name = shown(path);
    let unreadable = |reason: io::Error| unreadable(&name, reason.kind(), reason.to_string());
    // Checked before it is opened, because opening a pipe waits for its other end.
    check(&name, &std::fs::metadata(path).map_err(unreadable)?)?;
    let file = File::open(path).map_err(unreadable)?;
    check(&name, &file.metadata().map_err(unreadable)?)?;
    read_from(file, &name)
}

fn check(name: &str, metadata: &std::fs::Metadata) -> Result<(), Error> {
    if metadata.is_dir() {
        return Err(unreadable(name, ErrorKind::IsADirectory, "a folder, not a file".into()));
    }
    if !metadata.is_file() {
        return Err(unreadable(name, ErrorKind::InvalidInput, "not a regular file; save it as one first".into()));
    }
    if metadata.len() > MOST_BYTES { Err(too_large(name)) } else { Ok(()) }
}

/// The text that `input` gives until its end; `name` says what it is.
///
/// # Errors
/// More than `MOST_BYTES`, or not UTF-8.
pub fn read_from(input: impl Read, name: &str) -> Result<String, Error> {
    let mut bytes = Vec::new();
    let read = input.take(MOST_BYTES + 1).read_to_end(&mut bytes);
    read.map_err(|reason| unreadable(name, reason.kind(), reason.to_string()))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(too_large(name));
    }
    String::from_utf8(bytes).map_err(|error| {
        let place = error.utf8_error().valid_up_to();
        unreadable(name, ErrorKind::InvalidData, format!("not a text: byte {place} is no UTF-8"))
    })
}

/// Parses TOML. Two bytes of it may be a value, which takes some hundred bytes in memory, so values are counted first.
///
/// # Errors
/// Not TOML, not of this form, or more values than there is memory for.
pub fn from_toml<T: DeserializeOwned>(text: &str) -> Result<T, toml::de::Error> {
    // A table or list starts with a bracket, or behind the dot of a key.
    let (mut tables, mut values) = (0, 0);
    for (at, byte) in text.bytes().enumerate() {
        match byte {
            b'.' if !is_of_number(&text.as_bytes()[at + 1..]) => tables += 1,
            b'[' | b'{' => tables += 1,
            b',' | b'=' | b'.' => values += 1,
            _ => {}
        }
    }
    let bytes = TABLE_BYTES * tables + VALUE_BYTES * values;
    if bytes > MOST_VALUE_BYTES.saturating_add(8 * text.len()) {
        let problem = format!("{tables} tables and {values} values: too many for a text that is read whole");
        return Err(toml::de::Error::custom(problem));
    }
    toml::from_str(text)
}

/// Whether the text behind a dot ends a number, and not a key.
fn is_of_number(rest: &[u8]) -> bool {
    let digits = rest.iter().take_while(|byte| byte.is_ascii_alphanumeric() || b"_+-".contains(byte)).count();
    let next = rest[digits..].iter().find(|byte| !b" \t".contains(byte));
    rest.first().is_some_and(u8::is_ascii_digit) && !next.is_some_and(|byte| b"=.".contains(byte))
}

fn too_large(name: &str) -> Error {
    let problem = format!("more than {} MB, expected a text of some kilobytes", MOST_BYTES >> 20);
    unreadable(name, ErrorKind::FileTooLarge, problem)
}

fn unreadable(name: &str, kind: ErrorKind, problem: String) -> Error {
    Error::Unreadable { name: name.to_owned(), kind, problem }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(path: &Path) -> String {
        read(path).unwrap_err().to_string()
    }

    #[test]
    fn what_is_no_regular_file_of_a_believable_size_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("small"), "text").unwrap();
        assert_eq!(read(&path("small")).unwrap(), "text");
        let sparse = File::create(path("sparse")).unwrap();
        sparse.set_len(20 << 30).unwrap();
        assert!(problem(&path("sparse")).contains("sparse: more than 16 MB"));
        sparse.set_len(MOST_BYTES).unwrap();
        assert_eq!(read(&path("sparse")).unwrap().len() as u64, MOST_BYTES);
        assert!(problem(folder.path()).contains("a folder"));
        std::fs::write(path("bytes"), [b'a', 0xff]).unwrap();
        assert!(problem(&path("bytes")).contains("byte 1 is no UTF-8"));
        let missing = read(&path("missing"));
        assert!(matches!(missing, Err(Error::Unreadable { kind: ErrorKind::NotFound, .. })), "{missing:?}");
    }

    #[test]
    fn more_values_than_there_is_memory_for_are_refused() {
        let problem = |text: &str| from_toml::<toml::Table>(text).unwrap_err().to_string();
        assert!(problem(&format!("a = [{}]", "0,".repeat(4_000_000))).contains("4000001 values: too many"));
        let keys: String = (0..100_000).map(|index| format!("a{index}.b.c.d.e = 1\n")).collect();
        assert!(problem(&keys).contains("400000 tables"));
        // The path of a camera: an hour, ten times a second.
        let places = "[635619.123, 848899.732, 406.591],\n".repeat(12_000);
        assert!(from_toml::<toml::Table>(&format!("places = [\n{places}]")).is_ok());
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_refused_instead_of_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        assert!(problem(&pipe).contains("not a regular file"));
        assert!(problem(Path::new("/dev/zero")).contains("not a regular file"));
    }

    #[test]
    fn an_input_without_an_end_is_read_to_the_limit() {
        let error = read_from(io::repeat(b' '), "standard input").unwrap_err().to_string();
        assert!(error.starts_with("standard input: more than 16 MB"), "{error}");
        assert_eq!(read_from(&b"a view"[..], "standard input").unwrap(), "a view");
    }
}
