//! What the cache keeps of files of servers: a folder for each address, with the stamp of the file, its bytes as far as they
//! were fetched, and a list of the blocks with their checksums. The longest unused addresses are deleted first.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use super::network::network;
use super::request::Stamp;
use crate::address::Address;

/// The names of files in a folder; data and list have the hash of the stamp in their names, too.
const STAMP: &str = "stamp";
const DATA: &str = "data";
const BLOCKS: &str = "blocks";
/// The size of a block in bytes.
pub const BLOCK: u64 = 16 << 10;
/// The size of an entry in the list of blocks: number and checksum.
const ENTRY: usize = 8;
/// The longest list that is read: that of a file of some hundred gigabytes.
const MOST_LIST: u64 = 256 << 20;
/// The share of the limit that is filled after others were deleted.
const FILLED: f64 = 0.8;

/// What all addresses take in bytes, once it was counted.
static TAKEN: Mutex<Option<u64>> = Mutex::new(None);
/// The folders that are in use in this process.
static OPEN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// The list of blocks of an open file.
pub struct Kept {
    folder: PathBuf,
    list: Mutex<File>,
}

/// The folder of an address.
pub fn folder(all: &Path, address: &Address) -> PathBuf {
    all.join(hash(address.text().as_bytes()))
}

/// The stamp of the file that was kept last.
pub fn known(folder: &Path) -> Option<Stamp> {
    let mut text = String::new();
    File::open(folder.join(STAMP)).ok()?.take(8192).read_to_string(&mut text).ok()?;
    let mut lines = text.lines();
    let length = lines.next()?.parse().ok()?;
    let stamp = Stamp { length, etag: lines.next()?.to_owned(), modified: lines.next()?.to_owned() };
    let is_whole = folder.join(name(DATA, &stamp)).is_file();
    (is_whole && stamp.is_sure()).then_some(stamp)
}

fn name(of: &str, stamp: &Stamp) -> String {
    let Stamp { length, etag, modified } = stamp;
    format!("{of}-{}", hash(format!("{length}\n{etag}\n{modified}").as_bytes()))
}

impl Kept {
    /// Opens what is kept of a file: its bytes, and the checksums of the blocks that are there.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn open(folder: &Path, stamp: &Stamp) -> io::Result<(File, Self, HashMap<u64, u32>)> {
        std::fs::create_dir_all(folder)?;
        OPEN.lock().unwrap_or_else(PoisonError::into_inner).push(folder.to_owned());
        make_room(0);
        let text = format!("{}\n{}\n{}\n", stamp.length, stamp.etag, stamp.modified);
        std::fs::write(folder.join(STAMP), text)?;
        // What was kept of the file before it changed.
        let own = [name(DATA, stamp), name(BLOCKS, stamp)];
        for entry in std::fs::read_dir(folder)?.flatten() {
            let other = entry.file_name().to_string_lossy().into_owned();
            let is_ours = other.starts_with(&format!("{DATA}-")) || other.starts_with(&format!("{BLOCKS}-"));
            if is_ours && !own.contains(&other) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
        let open = |name: &String| {
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(folder.join(name))
        };
        let data = open(&own[0])?;
        let list = OpenOptions::new().read(true).append(true).create(true).open(folder.join(&own[1]))?;
        let mut bytes = Vec::new();
        (&list).take(MOST_LIST).read_to_end(&mut bytes)?;
        let entry = |entry: &[u8]| {
            let (block, checksum) = entry.split_at(4);
            let number = |bytes: &[u8]| bytes.iter().rev().fold(0_u32, |number, byte| number << 8 | u32::from(*byte));
            (u64::from(number(block)), number(checksum))
        };
        let blocks = bytes.chunks_exact(ENTRY).map(entry).collect();
        Ok((data, Self { folder: folder.to_owned(), list: Mutex::new(list) }, blocks))
    }

    /// Empties the list of blocks.
    pub fn forget(&self) {
        let list = self.list.lock().unwrap_or_else(PoisonError::into_inner);
        // What cannot be forgotten is found damaged again.
        let _ = list.set_len(0);
    }

    /// Notes a block that was written.
    pub fn note(&self, block: u64, checksum: u32) {
        let Ok(number) = u32::try_from(block) else { return };
        let mut entry = [0; ENTRY];
        entry[..4].copy_from_slice(&number.to_le_bytes());
        entry[4..].copy_from_slice(&checksum.to_le_bytes());
        // Without its entry a block is fetched again.
        let _ = self.list.lock().unwrap_or_else(PoisonError::into_inner).write_all(&entry);
        make_room(BLOCK);
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(index) = open.iter().position(|folder| *folder == self.folder) {
            open.swap_remove(index);
        }
    }
}

/// Counts `more` bytes, and deletes what was not opened for the longest time where all take more than they may.
fn make_room(more: u64) {
    let Some(all) = &network().folder else { return };
    let mut taken = TAKEN.lock().unwrap_or_else(PoisonError::into_inner);
    let now = taken.map(|taken| taken + more);
    if now.is_some_and(|now| now <= network().limit) {
        *taken = now;
        return;
    }
    let size = |folder: &Path| {
        let lists = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let lists = lists.filter(|entry| entry.file_name().to_string_lossy().starts_with(BLOCKS));
        lists.filter_map(|entry| Some(entry.metadata().ok()?.len() / ENTRY as u64 * BLOCK)).sum::<u64>()
    };
    let entries = std::fs::read_dir(all).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut folders: Vec<(SystemTime, PathBuf, u64)> = entries
        .filter_map(|folder| {
            let used = std::fs::metadata(folder.join(STAMP)).ok()?.modified().ok()?;
            let size = size(&folder);
            Some((used, folder, size))
        })
        .collect();
    folders.sort();
    let mut total: u64 = folders.iter().map(|(_, _, size)| size).sum();
    if total > network().limit {
        let open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        let most = (network().limit as f64 * FILLED) as u64;
        for (_, folder, size) in folders.iter().filter(|(_, folder, _)| !open.contains(folder)) {
            if total <= most {
                break;
            }
            total -= clear(folder).map_or(0, |()| *size);
        }
    }
    // What is in use stays, and may be more than the limit: it is counted again when as much has come anew.
    *taken = Some(total.min(network().limit));
}

/// Deletes what this program has made in the folder of an address.
fn clear(folder: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)?.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name == STAMP || name.starts_with(&format!("{DATA}-")) || name.starts_with(&format!("{BLOCKS}-")) {
            std::fs::remove_file(entry.path())?;
        }
    }
    std::fs::remove_dir(folder)
}

/// FNV-1a with 128 bits, in hexadecimal digits.
fn hash(bytes: &[u8]) -> String {
    let start = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d_u128;
    let step =
        |hash: u128, byte: &u8| (hash ^ u128::from(*byte)).wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b);
    format!("{:032x}", bytes.iter().fold(start, step))
}
