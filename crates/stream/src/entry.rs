//! The folder of one index in the cache: how it is distinguished from folders of other programs, and what may be
//! deleted in it.
//!
//! The cache may lie anywhere, even by mistake in a folder that holds other things or links to them. So a folder counts
//! as an entry only if it is no link, has the name of an entry and contains the marker, which is the first file written
//! there; and only names that this program makes are deleted, one by one. Versions before the marker wrote none: their
//! entries are recognised by the first bytes of `nodes`. Entries that they left unfinished have neither and stay.

use std::fs::File;
use std::io::{ErrorKind, Read as _, Write as _};
use std::path::Path;

use crate::regular_file::{is_there, kind, open_regular};
use crate::{Error, Result, surfel_file};

/// The file that describes the nodes of an index, its first bytes, and its name while it is being written.
pub const NODES: &str = "nodes";
pub const MAGIC: [u8; 8] = *b"glintidx";
pub const UNFINISHED: &str = "nodes.unfinished";
/// The file that holds the points of an index.
pub const PAGES: &str = "pages";
/// The folder within an entry in which an index is made.
pub const BUILDING: &str = "building";
/// The file in `BUILDING` that holds the records of all points while an index is made.
pub const RECORDS: &str = "records";
/// The file that holds kept normals and radii.
pub const KEPT: &str = "kept";
/// The file that marks a folder as an entry of the cache.
pub const MARKER: &str = "glint-index";
const MARKER_TEXT: &[u8] = b"glint makes this folder again from the point clouds; it may be deleted\n";

/// Whether the path has the name of an entry.
pub fn has_key(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name.len() == 32 && name.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

/// Whether the folder is an entry that this program made.
pub fn is_own(entry: &Path) -> bool {
    let starts_with = |name: &str, start: &[u8]| {
        let file = open_regular(&entry.join(name)).ok();
        let mut bytes = Vec::new();
        file.is_some_and(|file| file.take(start.len() as u64).read_to_end(&mut bytes).is_ok() && bytes == start)
    };
    let is_marked = || starts_with(MARKER, MARKER_TEXT) || starts_with(NODES, &MAGIC);
    has_key(entry) && kind(entry).is_some_and(|kind| kind.is_dir()) && is_marked()
}

/// Whether the entry is complete: an index, or kept normals and radii.
pub fn is_whole(entry: &Path) -> bool {
    is_there(&entry.join(NODES)) || is_there(&entry.join(KEPT))
}

/// Makes an empty entry; clears what an earlier one left there.
///
/// # Errors
/// `InTheWay` if something else has its name, `NotWritten`.
pub fn start(entry: &Path, aside: &Path) -> Result<()> {
    let io = |error| Error::not_written(entry, error);
    if is_own(entry) {
        clear(entry);
        if names().any(|(_, name)| is_there(&entry.join(name))) {
            // A folder with other content has the name of one of our files: it is kept.
            std::fs::rename(entry, aside).map_err(io)?;
        }
    }
    match std::fs::create_dir(entry) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            let is_folder = kind(entry).is_some_and(|kind| kind.is_dir());
            let is_empty = || std::fs::read_dir(entry).is_ok_and(|mut items| items.next().is_none());
            let is_usable = is_own(entry) || is_folder && is_empty();
            if !is_usable {
                return Err(Error::InTheWay { path: entry.to_owned() });
            }
        }
        made => made.map_err(io)?,
    }
    if !is_there(&entry.join(MARKER)) {
        let marked = File::options().write(true).create_new(true).open(entry.join(MARKER));
        marked.and_then(|mut file| file.write_all(MARKER_TEXT)).map_err(io)?;
    }
    std::fs::create_dir(entry.join(BUILDING)).map_err(io)
}

/// The names of all files and folders in an entry except the marker, each with whether it is a folder. The content of a
/// folder comes before the folder.
fn names() -> impl Iterator<Item = (bool, String)> {
    // `nodes` is deleted first: an entry that cannot be cleared whole must not look like an index.
    let files = [NODES, UNFINISHED, PAGES, KEPT].into_iter().chain(surfel_file::NAMES);
    let files = files.map(String::from);
    let building = [RECORDS, PAGES, KEPT].map(|name| format!("{BUILDING}/{name}"));
    files.chain(building).map(|name| (false, name)).chain([(true, BUILDING.to_owned())])
}

/// Deletes what this program has made in one of its entries, and the entry itself if it holds nothing else. Returns
/// whether the entry is gone.
pub fn clear(entry: &Path) -> bool {
    if !is_own(entry) {
        return !is_there(entry);
    }
    // If a link has replaced the folder, it is not followed.
    let is_building = kind(&entry.join(BUILDING)).is_some_and(|kind| kind.is_dir());
    for (is_folder, name) in names().filter(|(_, name)| is_building || !name.contains('/')) {
        let path = entry.join(name);
        let _ = if is_folder && is_building { std::fs::remove_dir(&path) } else { std::fs::remove_file(&path) };
    }
    let is_alone = |items: std::fs::ReadDir| items.flatten().all(|item| item.file_name() == MARKER);
    if !std::fs::read_dir(entry).is_ok_and(is_alone) {
        return false;
    }
    let _ = std::fs::remove_file(entry.join(MARKER));
    std::fs::remove_dir(entry).is_ok()
}

/// Clears an entry when it is dropped, unless the flag is set.
pub(crate) struct Unfinished<'a>(pub &'a Path, pub bool);

impl Drop for Unfinished<'_> {
    fn drop(&mut self) {
        if !self.1 {
            clear(self.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_entries_are_32_lower_case_hexadecimal_digits() {
        for (name, is_key) in [
            ("0123456789abcdef0123456789abcdef", true),
            ("0123456789ABCDEF0123456789abcdef", false),
            ("0123456789abcdef0123456789abcde", false),
            ("0123456789abcdef0123456789abcdeg", false),
        ] {
            assert_eq!(has_key(&Path::new("/cache").join(name)), is_key, "{name}");
        }
    }
}
