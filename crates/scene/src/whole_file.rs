//! Side files (scenes, views, plans, preferences) are small texts that are read whole. Anybody may hand one on, so that what is
//! read is a regular file of a size that such a file may have: a pipe would be waited for, a device never ends.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use crate::{Error, shown};

/// A scene of a thousand clouds, with a camera path of an hour, takes a tenth of it.
pub const MOST_BYTES: u64 = 16 << 20;

/// The text of a side file.
///
/// # Errors
/// Not there, not a regular file, larger than `MOST_BYTES`, or not UTF-8; names it.
pub fn read(path: &Path) -> Result<String, Error> {
    let name = shown(path);
    let unreadable = |reason: io::Error| unreadable(&name, reason.kind(), reason.to_string());
    // Before it is opened, which waits for the other end of a pipe.
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
