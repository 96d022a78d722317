//! The folder that keeps indexes, and normals and radii of files that are held in memory (`kept`): one entry for each
//! set of files and kind, with a name made from the files' identity. When the entries take too much room, the least
//! recently opened is cleared first. Anything else in the folder is left alone (`entry`).
//!
//! An entry is a folder; its lock file lies beside it. A builder of an entry holds its lock exclusively, readers share
//! it. A lock file is removed, or renamed with its entry, only by a holder of the lock; and whoever has locked one
//! checks that the file still has its name (`is_current`), so that nobody trusts the lock of a removed file.

use std::collections::BTreeSet;
use std::fs::{File, TryLockError};
use std::io::ErrorKind::{NotFound, PermissionDenied};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::SystemTime;

use crate::pages::{self, Pages};
use crate::regular_file::is_current;
use crate::{Error, Result, entry, plan, regular_file, surfel_file};

/// The size of a sample of a file's content in bytes, smaller where there are many files: the most and the least, and that
/// of a sample of each of the files together.
const SAMPLE_BYTES: usize = 64 << 10;
const LEAST_SAMPLE_BYTES: usize = 4 << 10;
const SAMPLES_OF_ALL: usize = 1 << 20;
/// The number of samples between those at the ends of a file.
const INNER_SAMPLES: u64 = 4;

/// The folder of indexes and its limit.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
    limit: u64,
    /// The names of attributes that indexes keep besides the usual ones.
    also: BTreeSet<String>,
    /// The identities of files that are open: their contents are sampled once.
    known: Arc<Mutex<Vec<Known>>>,
}

/// Files, and their identity.
type Known = (Vec<Weak<codec::Source>>, Identity);

/// The identity of a set of files when they were looked at.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Identity {
    pub key: u128,
    stamps: Vec<Stamp>,
}

#[derive(Clone, Debug, PartialEq)]
struct Stamp {
    path: PathBuf,
    length: u64,
    modified: Option<SystemTime>,
}

impl Stamp {
    fn of(path: &Path) -> Result<Self> {
        if codec::is_address(path) {
            // The bytes of an address are those that were opened, or cannot be read.
            return Ok(Self { path: path.to_owned(), length: 0, modified: None });
        }
        if path == Path::new(codec::Bytes::STANDARD_INPUT) {
            // Standard input is known by its content.
            let length =
                codec::Bytes::open(path).map_err(|error| Error::io(path, std::io::Error::other(error)))?.length();
            return Ok(Self { path: path.to_owned(), length, modified: None });
        }
        let metadata = std::fs::metadata(path).map_err(|error| Error::io(path, error))?;
        Ok(Self { path: path.to_owned(), length: metadata.len(), modified: metadata.modified().ok() })
    }
}

impl Identity {
    /// Hashes paths, sizes, times and samples of the contents.
    pub fn of(inputs: &[Arc<codec::Source>]) -> Result<Self> {
        let mut hash = Fnv::new();
        hash.add(&pages::BUILDER.to_le_bytes());
        let mut stamps = Vec::new();
        let sample = (SAMPLES_OF_ALL / inputs.len().max(1)).clamp(LEAST_SAMPLE_BYTES, SAMPLE_BYTES);
        for input in inputs {
            let path = &input.info().path;
            let stamp = Stamp::of(path)?;
            let canonical = match stamp.modified {
                None if path == Path::new(codec::Bytes::STANDARD_INPUT) || codec::is_address(path) => path.clone(),
                _ => std::fs::canonicalize(path).map_err(|error| Error::io(path, error))?,
            };
            hash.add(canonical.as_os_str().as_encoded_bytes());
            hash.add(&stamp.length.to_le_bytes());
            // The first scan of a file, or the only one, is known by the file alone.
            if input.info().scan_number() > 0 {
                hash.add(&input.info().scan_number().to_le_bytes());
            }
            // A person may have named the columns of a table otherwise, or left out others.
            if input.info().format == codec::Format::Xyz {
                hash.add(input.info().version.as_bytes());
            }
            let since = stamp.modified.and_then(|time| time.duration_since(SystemTime::UNIX_EPOCH).ok());
            hash.add(&since.map_or(0, |since| since.as_nanos()).to_le_bytes());
            match input.bytes().remote_identity() {
                Some(identity) => hash.add(identity.as_bytes()),
                None => add_samples(&mut hash, input.bytes(), sample),
            }
            stamps.push(stamp);
        }
        Ok(Self { key: hash.0, stamps })
    }

    /// The identity of something else that is kept of the same files.
    pub fn of_kind(self, kind: &str) -> Self {
        let mut hash = Fnv::new();
        hash.add(&self.key.to_le_bytes());
        hash.add(kind.as_bytes());
        Self { key: hash.0, ..self }
    }

    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.stamps.iter().map(|stamp| stamp.path.as_path())
    }

    /// The first file that has changed since.
    pub fn changed(&self) -> Option<&Path> {
        let changed = |stamp: &&Stamp| Stamp::of(&stamp.path).ok().as_ref() != Some(*stamp);
        self.stamps.iter().find(changed).map(|stamp| stamp.path.as_path())
    }
}

/// Samples of `length` bytes of the file that is open: of one that has taken its name since, an index would be of other
/// points than its name says.
fn add_samples(hash: &mut Fnv, bytes: &codec::Bytes, length: usize) {
    let last = bytes.length().saturating_sub(length as u64);
    let mut buffer = vec![0; length];
    for sample in 0..INNER_SAMPLES + 2 {
        let start = (u128::from(last) * u128::from(sample) / u128::from(INNER_SAMPLES + 1)) as u64;
        // What cannot be read is left out of an index, which is that of other contents once it can.
        let count = bytes.read_at(start, &mut buffer).unwrap_or(0);
        hash.add(&buffer[..count]);
    }
}

/// FNV-1a with 128 bits. Nobody gains by a collision in their own cache.
struct Fnv(u128);

impl Fnv {
    fn new() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }

    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes.iter().chain(&(bytes.len() as u64).to_le_bytes()) {
            self.0 = (self.0 ^ u128::from(*byte)).wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b);
        }
    }
}

/// The lock file of an entry.
pub(crate) fn lock_path(entry: &Path) -> PathBuf {
    entry.with_extension("lock")
}

impl Cache {
    /// Keeps up to `limit` bytes in `folder`, which is made when it is needed.
    pub fn new(folder: PathBuf, limit: u64) -> Self {
        Self { folder, limit, also: BTreeSet::new(), known: Arc::default() }
    }

    /// A cache in this folder; indexes that are opened or made there also have the attributes with these names, as far
    /// as their files have them. Those with other attributes stay beside them.
    pub fn keeping(&self, also: BTreeSet<String>) -> Self {
        Self { also, ..self.clone() }
    }

    pub(crate) fn also(&self) -> &BTreeSet<String> {
        &self.also
    }

    /// The identity of the index of these files with the attributes that are wanted.
    pub(crate) fn identity(&self, inputs: &[Arc<codec::Source>]) -> Result<Identity> {
        let identity = self.files(inputs)?;
        let usual = plan::index_attributes(inputs, &BTreeSet::new()).len();
        let further = plan::index_attributes(inputs, &self.also).split_off(usual);
        if further.is_empty() {
            return Ok(identity);
        }
        let names: Vec<&str> = further.iter().map(|attribute| attribute.name.as_str()).collect();
        Ok(identity.of_kind(&format!("with {}", names.join("\0"))))
    }

    /// The identity of these files, whose contents are sampled again only where their stamps have changed.
    fn files(&self, inputs: &[Arc<codec::Source>]) -> Result<Identity> {
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let stamps = inputs.iter().map(|input| Stamp::of(&input.info().path)).collect::<Result<Vec<_>>>()?;
        let files: Vec<Weak<codec::Source>> = inputs.iter().map(Arc::downgrade).collect();
        let is_same = |other: &[Weak<codec::Source>]| {
            other.len() == files.len() && other.iter().zip(&files).all(|(one, other)| one.ptr_eq(other))
        };
        if let Some((_, found)) = known().iter().find(|(other, found)| found.stamps == stamps && is_same(other)) {
            return Ok(found.clone());
        }
        let identity = Identity::of(inputs)?;
        let mut known = known();
        known.retain(|(other, _)| !is_same(other) && other.iter().all(|file| file.strong_count() > 0));
        known.push((files.clone(), identity.clone()));
        Ok(identity)
    }

    pub fn folder(&self) -> &Path {
        &self.folder
    }

    pub(crate) fn entry(&self, identity: &Identity) -> PathBuf {
        self.folder.join(format!("{:032x}", identity.key))
    }

    /// The index of these files, if there is one; a damaged one counts as missing.
    ///
    /// # Errors
    /// If the files cannot be read.
    pub fn open(&self, inputs: &[Arc<codec::Source>]) -> Result<Option<Pages>> {
        self.open_known(&self.identity(inputs)?)
    }

    pub(crate) fn open_known(&self, identity: &Identity) -> Result<Option<Pages>> {
        let entry = self.entry(identity);
        if !entry::is_own(&entry) || !regular_file::is_there(&entry.join(entry::NODES)) {
            return Ok(None);
        }
        let Some(lock) = self.lock_to_read(&entry) else { return Ok(None) };
        let opened = Pages::open_locked(&entry, None);
        // The entry was renamed meanwhile: the files opened may belong to another one.
        if lock.as_ref().is_some_and(|lock| !is_current(lock, &lock_path(&entry))) {
            return Ok(None);
        }
        match opened.map(|pages| pages.locked_by(lock)) {
            Ok(pages) if pages.key() == identity.key => Ok(Some(pages.kept_in(self))),
            Ok(_) | Err(Error::Damaged { .. }) => Ok(None),
            // The index can be read when it has been made anew.
            Err(Error::Io { reason, .. }) if matches!(reason.kind(), NotFound | PermissionDenied) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Locks an entry so that nobody clears it while it is read; `None` if somebody builds or clears it just now. An
    /// entry in a folder that cannot be written to, or without locks, gets no lock but can still be read: nobody clears
    /// it then.
    pub(crate) fn lock_to_read(&self, entry: &Path) -> Option<Option<File>> {
        let lock = self.lock_file(entry).ok().or_else(|| regular_file::open_regular(&lock_path(entry)).ok());
        if let Some(lock) = &lock {
            if let Err(TryLockError::WouldBlock) = lock.try_lock_shared() {
                return None;
            }
            // The lock file's time is the time of last use. If it cannot be set, only the order of clearing suffers.
            let _ = lock.set_modified(SystemTime::now());
        }
        Some(lock)
    }

    fn lock_file(&self, entry: &Path) -> Result<File> {
        let path = lock_path(entry);
        let file = std::fs::create_dir_all(&self.folder)
            .and_then(|()| regular_file::check_writable(&path))
            .and_then(|()| File::options().create(true).truncate(false).read(true).write(true).open(&path));
        file.map_err(|error| Error::not_written(&self.folder, error))
    }

    /// Locks an entry exclusively; `None` if somebody else has locked it. Where files cannot be locked everybody gets
    /// the entry: two who build the same one then disturb each other, and one of them reports it.
    pub(crate) fn try_lock(&self, entry: &Path) -> Result<Option<File>> {
        let file = self.lock_file(entry)?;
        match file.try_lock() {
            Ok(()) => Ok(is_current(&file, &lock_path(entry)).then_some(file)),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(_)) => Ok(Some(file)),
        }
    }

    /// Renames an entry that is damaged but still open somewhere, so that it can be made anew at once. The renamed
    /// entry is cleared when nobody has it open any more. Where open files cannot be renamed, a builder waits for that
    /// instead.
    pub(crate) fn set_aside(&self, entry: &Path, identity: &Identity) {
        if !cfg!(unix) {
            return;
        }
        // One at a time: a second one must not look at an entry that the first has just set aside.
        let Some(_turn) = self.no_setting_aside() else { return };
        // A shared lock shows that nobody builds the entry.
        let lock = regular_file::open_regular(&lock_path(entry)).ok().filter(|lock| lock.try_lock_shared().is_ok());
        if let Some(lock) = lock.filter(|lock| is_current(lock, &lock_path(entry))) {
            self.set_locked_aside(entry, identity, &lock);
        }
    }

    /// Prevents entries from being set aside while the file is kept. `None` where the file cannot be locked.
    pub(crate) fn no_setting_aside(&self) -> Option<File> {
        let path = self.folder.join("aside.lock");
        regular_file::check_writable(&path).ok()?;
        let turn = File::options().create(true).truncate(false).write(true).open(path);
        turn.ok().filter(|turn| turn.lock().is_ok())
    }

    /// Sets an entry aside; the caller holds a shared lock of it.
    fn set_locked_aside(&self, entry: &Path, identity: &Identity, _lock: &File) {
        let is_missing = |error: &Error| match error {
            Error::Io { reason, .. } => matches!(reason.kind(), NotFound | PermissionDenied),
            error => matches!(error, Error::Damaged { .. }),
        };
        let is_useless = match Pages::open_locked(entry, None) {
            Ok(pages) => pages.key() != identity.key,
            Err(error) => is_missing(&error),
        };
        let aside = self.aside(entry);
        // The lock is renamed last: until then nobody else can lock the entry exclusively.
        if is_useless
            && entry::is_own(entry)
            && !regular_file::is_there(&aside)
            && std::fs::rename(entry, &aside).is_ok()
        {
            let _ = std::fs::remove_file(aside.join(entry::NODES));
            let _ = std::fs::rename(lock_path(entry), lock_path(&aside));
        }
    }

    /// A name that no entry has, for one that makes room for another.
    pub(crate) fn aside(&self, entry: &Path) -> PathBuf {
        let mut name = Fnv::new();
        name.add(entry.as_os_str().as_encoded_bytes());
        name.add(&std::process::id().to_le_bytes());
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        name.add(&now.as_nanos().to_le_bytes());
        self.folder.join(format!("{:032x}", name.0))
    }

    /// Forgets an index that turned out to be damaged: it is made anew for the next caller who asks for it. If only its
    /// normals and radii are damaged, only they are forgotten.
    pub fn discard(&self, pages: Pages) {
        if pages.has_bad_surfels_only() {
            let path = pages.folder().join(surfel_file::SURFELS);
            drop(pages);
            let _ = std::fs::remove_file(path);
            return;
        }
        // The other files are removed when the index is made anew: others may still read them.
        let _ = std::fs::remove_file(pages.folder().join(entry::NODES));
    }

    /// The size of all entries in bytes.
    pub fn size(&self) -> u64 {
        self.entries().iter().map(|entry| entry.bytes).sum()
    }

    /// Whether that many bytes are within the limit of the whole cache.
    pub(crate) fn may_hold(&self, bytes: u64) -> bool {
        bytes <= self.limit
    }

    /// Clears entries, least recently opened first, until there is room for `bytes` more. Leaves those that are open.
    pub(crate) fn make_room(&self, bytes: u64) {
        self.clear_remains();
        let mut entries = self.entries();
        entries.sort_by_key(|entry| entry.used);
        let mut size: u64 = entries.iter().map(|entry| entry.bytes).sum();
        for entry in entries {
            if size.saturating_add(bytes) <= self.limit {
                return;
            }
            if self.clear_entry(&entry.path) {
                size -= entry.bytes;
            }
        }
    }

    /// Clears the entry in that folder. Returns false if it is still there because somebody has it open.
    pub fn remove(&self, entry: &Path) -> bool {
        entry.parent() == Some(&self.folder) && entry::is_own(entry) && self.clear_entry(entry)
    }

    /// Clears all entries that are not open.
    pub fn clear(&self) {
        for entry in self.entries() {
            self.clear_entry(&entry.path);
        }
        self.clear_remains();
    }

    /// Clears folders and files that are not and will never be an index: those of builders that were killed, entries
    /// set aside, and lock files without an entry.
    fn clear_remains(&self) {
        for entry in self.entries() {
            if !entry::is_whole(&entry.path) {
                self.clear_entry(&entry.path);
            }
        }
        let Ok(folder) = std::fs::read_dir(&self.folder) else { return };
        for path in folder.flatten().map(|item| item.path()) {
            let entry = path.with_extension("");
            let is_lock = path.extension().is_some_and(|extension| extension == "lock") && entry::has_key(&entry);
            if is_lock && is_empty_file(&path) && !regular_file::is_there(&entry) {
                self.clear_entry(&entry);
            }
        }
    }

    fn clear_entry(&self, entry: &Path) -> bool {
        let Ok(lock) = self.lock_file(entry) else { return false };
        if lock.try_lock().is_err() || !is_current(&lock, &lock_path(entry)) {
            return false;
        }
        let is_gone = entry::clear(entry);
        if is_gone && cfg!(unix) && is_empty_file(&lock_path(entry)) {
            let _ = std::fs::remove_file(lock_path(entry));
        }
        is_gone
    }

    /// The entries of the folder; those that cannot be read are left out.
    fn entries(&self) -> Vec<Entry> {
        let Ok(folder) = std::fs::read_dir(&self.folder) else { return Vec::new() };
        let entry = |path: PathBuf| {
            let used = std::fs::metadata(lock_path(&path)).and_then(|metadata| metadata.modified());
            Entry { bytes: bytes_in(&path), used: used.unwrap_or(SystemTime::UNIX_EPOCH), path }
        };
        folder.flatten().map(|item| item.path()).filter(|path| entry::is_own(path)).map(entry).collect()
    }
}

/// Whether the path is an empty regular file, as lock files are.
fn is_empty_file(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file() && metadata.len() == 0)
}

struct Entry {
    path: PathBuf,
    bytes: u64,
    used: SystemTime,
}

/// The size in bytes of all files in a folder and below it.
pub(crate) fn bytes_in(folder: &Path) -> u64 {
    let Ok(items) = std::fs::read_dir(folder) else { return 0 };
    let bytes = |item: std::fs::DirEntry| match item.metadata() {
        Ok(metadata) if metadata.is_dir() => bytes_in(&item.path()),
        Ok(metadata) => metadata.len(),
        Err(_) => 0,
    };
    items.flatten().map(bytes).sum()
}
