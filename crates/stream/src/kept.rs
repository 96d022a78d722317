//! Normals and radii of a file whose points are held in memory, kept in the cache: estimating them takes most of the
//! time of opening such a file.
//!
//! Kept normals and radii are an entry of the cache like an index, with one file: a head with a table of the chunks they
//! belong to, then six bytes a point, chunk after chunk. The head says what they were estimated from. Nothing in the file
//! is trusted: what does not agree with its checksums counts as damaged, and the caller estimates anew.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::Arc;

use cloud::{Chunk, Surfels};
use rayon::prelude::*;

use crate::cache::{Cache, Identity, lock_path};
use crate::entry::{self, BUILDING, KEPT, Unfinished};
use crate::regular_file::is_current;
use crate::storage::Storage;
use crate::surfel_file::{POINT_BYTES, pack, unpack};
use crate::{Error, Result, regular_file};

const MAGIC: [u8; 8] = *b"glintkpt";
/// The number grows with each change of the file's form. What `cloud` estimates has a number of its own,
/// `cloud::ESTIMATOR`.
const VERSION: u32 = 1;
/// The size in bytes of the head before the estimate's description: magic, version, checksum of the remainder, key,
/// length of the description, number of chunks.
const HEAD_BYTES: usize = 16 + 16 + 4 + 4;
/// The size in bytes of a chunk's row in the table: its first point, its number of points, the checksum of its data.
const ROW_BYTES: usize = 8 + 4 + 4;

/// The place in the cache for the normals and radii of a file.
pub struct SurfelPlace {
    cache: Cache,
    identity: Identity,
    estimate: String,
}

/// Normals and radii that were kept. Nobody clears them as long as this value exists.
pub struct KeptSurfels {
    storage: Storage,
    rows: Vec<Row>,
    _lock: Option<File>,
}

/// The normals and radii of one chunk.
struct Row {
    first_point: u64,
    points: u32,
    checksum: u32,
    /// The offset of its data in the file.
    start: u64,
}

impl SurfelPlace {
    /// The place for a file as it is now. `estimate` describes everything beside the file that decides the result.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn new(cache: &Cache, file: &Arc<codec::Source>, estimate: String) -> Result<Self> {
        let identity = Identity::of(std::slice::from_ref(file))?.of_kind(KEPT);
        Ok(Self { cache: cache.clone(), identity, estimate })
    }

    /// What was kept there by the same estimate; `None` if there is nothing, or if somebody writes it just now.
    ///
    /// # Errors
    /// `Damaged`, `Io`.
    pub fn open(&self) -> Result<Option<KeptSurfels>> {
        let entry = self.cache.entry(&self.identity);
        if !entry::is_own(&entry) || !regular_file::is_there(&entry.join(KEPT)) {
            return Ok(None);
        }
        let Some(lock) = self.cache.lock_to_read(&entry) else { return Ok(None) };
        let kept = KeptSurfels::open(&entry.join(KEPT), &self.identity, &self.estimate);
        if lock.as_ref().is_some_and(|lock| !is_current(lock, &lock_path(&entry))) {
            return Ok(None);
        }
        Ok(kept?.map(|kept| KeptSurfels { _lock: lock, ..kept }))
    }

    /// Keeps the normals and radii of all chunks of the file, in place of earlier ones. Does nothing if they would take
    /// more room than the whole cache may, or if somebody else has the entry open.
    ///
    /// # Errors
    /// `Changed` if the file is no longer the same, `NotWritten`, `InTheWay`. Nothing is left behind then.
    pub fn keep(&self, chunks: &[Chunk], surfels: &[Surfels]) -> Result<()> {
        let written = self.write(chunks, surfels);
        written.map_err(|error| error.of_cache(self.cache.folder()))
    }

    fn write(&self, chunks: &[Chunk], surfels: &[Surfels]) -> Result<()> {
        let entry = &self.cache.entry(&self.identity);
        let points: u64 = chunks.iter().map(|chunk| chunk.len() as u64).sum();
        let bytes = (HEAD_BYTES + self.estimate.len() + ROW_BYTES * chunks.len()) as u64 + POINT_BYTES * points;
        if !self.cache.may_hold(bytes) {
            return Ok(());
        }
        let Some(lock) = self.cache.try_lock(entry)? else { return Ok(()) };
        self.cache.make_room(bytes);
        entry::start(entry, &self.cache.aside(entry))?;
        let mut unfinished = Unfinished(entry, false);
        let building = entry.join(BUILDING);
        let path = building.join(KEPT);
        let io = |error| Error::not_written(&path, error);
        let data: Vec<Vec<u8>> = surfels.par_iter().map(pack).collect();
        let mut body = self.identity.key.to_le_bytes().to_vec();
        body.extend((self.estimate.len() as u32).to_le_bytes());
        body.extend((chunks.len() as u32).to_le_bytes());
        body.extend(self.estimate.as_bytes());
        for (chunk, data) in chunks.iter().zip(&data) {
            body.extend(chunk.first_point.to_le_bytes());
            body.extend((chunk.len() as u32).to_le_bytes());
            body.extend(crc32fast::hash(data).to_le_bytes());
        }
        let head = [&MAGIC[..], &VERSION.to_le_bytes(), &crc32fast::hash(&body).to_le_bytes(), &body].concat();
        let mut file = BufWriter::new(File::create_new(&path).map_err(io)?);
        std::iter::once(&head).chain(&data).try_for_each(|bytes| file.write_all(bytes)).map_err(io)?;
        file.flush().map_err(io)?;
        if let Some(path) = self.identity.changed() {
            return Err(Error::Changed { path: path.to_owned() });
        }
        std::fs::rename(&path, entry.join(KEPT)).map_err(io)?;
        std::fs::remove_dir(&building).map_err(io)?;
        unfinished.1 = true;
        drop(unfinished);
        drop(lock);
        Ok(())
    }
}

impl KeptSurfels {
    /// Opens the file; `None` if it comes from another estimate, or has another form.
    fn open(path: &Path, identity: &Identity, estimate: &str) -> Result<Option<Self>> {
        let storage = Storage::open(path)?;
        let damaged = |problem: &str| Error::damaged(path, problem);
        let mut head = [0; HEAD_BYTES];
        storage.read(0, &mut head)?;
        if head[..8] != MAGIC {
            return Err(damaged("not a file of normals and radii"));
        }
        if head[8..12] != VERSION.to_le_bytes() {
            return Ok(None);
        }
        let number = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let (described, chunks) = (number(32) as usize, number(36) as usize);
        // What the head says is checked against the file's size before anything is allocated.
        let start = HEAD_BYTES as u64 + described as u64 + (ROW_BYTES * chunks) as u64;
        if start > storage.length() {
            return Err(damaged("the file is cut short"));
        }
        let mut rest = vec![0; start as usize - HEAD_BYTES];
        storage.read(HEAD_BYTES as u64, &mut rest)?;
        let mut checksum = crc32fast::Hasher::new();
        checksum.update(&head[16..]);
        checksum.update(&rest);
        if checksum.finalize() != number(12) {
            return Err(damaged("its table has changed"));
        }
        let (description, table) = rest.split_at(described);
        if head[16..32] != identity.key.to_le_bytes() || description != estimate.as_bytes() {
            return Ok(None);
        }
        let (mut rows, mut end, mut next_point) = (Vec::with_capacity(chunks), start, 0);
        for bytes in table.as_chunks::<ROW_BYTES>().0 {
            let [a, b, c, d, e, f, g, h, points @ .., _, _, _, _] = *bytes;
            let (first_point, points) = (u64::from_le_bytes([a, b, c, d, e, f, g, h]), u32::from_le_bytes(points));
            let checksum = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]);
            if first_point < next_point {
                return Err(damaged("its chunks are in no order"));
            }
            rows.push(Row { first_point, points, checksum, start: end });
            next_point = first_point.saturating_add(u64::from(points));
            end += POINT_BYTES * u64::from(points);
        }
        if end != storage.length() {
            return Err(damaged("not as long as its table says"));
        }
        Ok(Some(Self { storage, rows, _lock: None }))
    }

    /// The number of points.
    pub fn points(&self) -> u64 {
        self.rows.iter().map(|row| u64::from(row.points)).sum()
    }

    /// The normals and radii of a chunk. Several threads may read at once.
    ///
    /// # Errors
    /// `Damaged`, also if there is no such chunk; `Io`.
    pub fn of(&self, chunk: &Chunk) -> Result<Surfels> {
        let damaged = |problem: &str| {
            Error::damaged(self.storage.path(), format!("{problem} the points from {} on", chunk.first_point))
        };
        let row = self.rows.binary_search_by_key(&chunk.first_point, |row| row.first_point);
        let row = row.ok().map(|index| &self.rows[index]).filter(|row| row.points as usize == chunk.len());
        let row = row.ok_or_else(|| damaged("no normals and radii of"))?;
        let mut bytes = vec![0; POINT_BYTES as usize * chunk.len()];
        self.storage.read(row.start, &mut bytes)?;
        if crc32fast::hash(&bytes) != row.checksum {
            return Err(damaged("changed normals and radii of"));
        }
        Ok(unpack(&bytes))
    }
}
