//! Makes the index of some files: distribution to buckets, then nodes, in a folder of the cache.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use cloud::{Chunk, Progress};
use codec::Source;

use crate::buckets::{self, Bucket, Distribution};
use crate::cache::{Cache, Identity};
use crate::lattice::Cell;
use crate::pages::{self, Pages, Summary, Written};
use crate::plan::{Extent, Plan, measure, spread};
use crate::records::convert;
use crate::storage::Storage;
use crate::tree::{BYTES_PER_POINT, Tree};
use crate::{Error, Result};

/// Between two looks at an entry that somebody else has locked.
const LOCK_WAIT: Duration = Duration::from_millis(30);
/// Where an index is made, within its entry.
const BUILDING: &str = "building";
/// Points of a bucket: at least, however little memory there is; as many as are fast to sort; at most.
const BUCKET_POINTS: [u64; 3] = [20_000, 400_000, 1_500_000];
/// Buckets of a cloud so large that they would be more become larger instead.
const MOST_BUCKETS: u64 = 1000;
/// Cells of the first distribution per bucket that comes of it: clouds are not even, and joining cells is free.
const CELLS_PER_BUCKET: u64 = 6;

/// How an index is made.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// Bytes to work in, besides what decoding takes (some 20 MB a core).
    pub memory: u64,
    /// Points that are shown meanwhile.
    pub preview_points: u64,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self { memory: 1 << 30, preview_points: 2_000_000 }
    }
}

/// The index of some files as one cloud: the one in the cache, or made now. `progress` counts each point twice, as it is
/// read and as it gets its node. `preview` gets a thinned share of each chunk that is read, from many threads at once;
/// its `first_point` counts through all files.
///
/// A file that cannot be read is left out with a warning, if others can. An index that was found to be damaged must be
/// dropped before it can be made again: this waits until nobody has it open.
///
/// # Errors
/// `Cancelled`; `Changed` if a file is not the same at the end; `Full`; `Empty`; `Io`; `Input` if no file can be read.
/// Nothing is left behind then.
pub fn build(
    inputs: &[Arc<Source>],
    cache: &Cache,
    options: &BuildOptions,
    progress: &Progress,
    preview: &(dyn Fn(Chunk) + Sync),
) -> Result<Pages> {
    build_on_disk(inputs, cache, options, progress, preview, u64::MAX)
}

/// `disk`: bytes each file may have.
fn build_on_disk(
    inputs: &[Arc<Source>],
    cache: &Cache,
    options: &BuildOptions,
    progress: &Progress,
    preview: &(dyn Fn(Chunk) + Sync),
    disk: u64,
) -> Result<Pages> {
    let identity = Identity::of(inputs)?;
    let entry = cache.entry(&identity);
    loop {
        if let Some(pages) = cache.open_known(&identity)? {
            return Ok(pages);
        }
        let Some(lock) = cache.try_lock(&entry)? else {
            // Somebody else makes it.
            if progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            std::thread::sleep(LOCK_WAIT);
            continue;
        };
        // It may have been made since this looked.
        if !Pages::open_locked(&entry, None).is_ok_and(|pages| pages.key() == identity.key) {
            let build = Build { inputs, options, progress, preview, disk };
            make_entry(&build, cache, &entry, &identity)?;
        }
        drop(lock);
    }
}

/// Removes a folder unless it is told not to.
struct Unfinished<'a>(&'a Path, bool);

impl Drop for Unfinished<'_> {
    fn drop(&mut self) {
        if !self.1 {
            let _ = std::fs::remove_dir_all(self.0);
        }
    }
}

/// Makes an entry whose lock is held.
fn make_entry(build: &Build<'_>, cache: &Cache, entry: &Path, identity: &Identity) -> Result<()> {
    let io = |error| Error::io(entry, error);
    if entry.exists() {
        // Damaged, or of a builder that was killed.
        std::fs::remove_dir_all(entry).map_err(io)?;
    }
    let points: u64 = build.inputs.iter().map(|input| input.info().points).sum();
    cache.make_room(points * 18);
    let mut unfinished = Unfinished(entry, false);
    let building = entry.join(BUILDING);
    std::fs::create_dir_all(&building).map_err(|error| full_or(error, entry, cache, points))?;
    let outcome = build.run(&building, identity).and_then(|(summary, nodes)| {
        if let Some(path) = identity.changed() {
            return Err(Error::Changed { path: path.to_owned() });
        }
        std::fs::rename(building.join(pages::PAGES), entry.join(pages::PAGES)).map_err(io)?;
        std::fs::remove_dir_all(&building).map_err(io)?;
        pages::write(entry, &summary, nodes)
    });
    outcome.map_err(|error| match error {
        Error::Io { source, path } if path.starts_with(entry) => full_or(source, &path, cache, points),
        error => error,
    })?;
    unfinished.1 = true;
    drop(unfinished);
    cache.make_room(0);
    Ok(())
}

/// Says what to do about a full disk.
fn full_or(error: std::io::Error, path: &Path, cache: &Cache, points: u64) -> Error {
    match error.kind() {
        // Records in the temporary file and then in pages.
        std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => {
            Error::Full { folder: cache.folder().to_owned(), needed: points * 2 * 20 }
        }
        _ => Error::io(path, error),
    }
}

/// One run of the builder.
struct Build<'a> {
    inputs: &'a [Arc<Source>],
    options: &'a BuildOptions,
    progress: &'a Progress,
    preview: &'a (dyn Fn(Chunk) + Sync),
    disk: u64,
}

/// What came of reading all files.
#[derive(Default)]
struct Counts {
    points: AtomicU64,
    skipped: AtomicU64,
    /// Points whose integers need more bits.
    misfits: AtomicU64,
    /// There are points outside of the cube.
    outside: AtomicBool,
}

impl Build<'_> {
    fn run(&self, folder: &Path, identity: &Identity) -> Result<(Summary, Vec<Written>)> {
        let total: u64 = self.inputs.iter().map(|input| input.info().points).sum();
        let first_path = || identity.paths().next().map(Path::to_owned).unwrap_or_default();
        self.progress.set_total(2 * total);
        let mut extent: Option<Extent> = None;
        let mut wide = false;
        loop {
            let Some(plan) = Plan::new(self.inputs, extent.as_ref(), wide) else {
                if extent.is_some() {
                    return Err(self.why_empty(first_path()));
                }
                extent = Some(measure(self.inputs, self.progress)?);
                continue;
            };
            let path = folder.join("records");
            let temporary = Storage::create(&path, self.disk)?;
            let counts = Counts::default();
            let (distributed, warnings) = self.distribute(&plan, &temporary, &counts, extent.is_none())?;
            let outside = extent.is_none() && counts.outside.load(Ordering::Relaxed);
            if outside || (!plan.layout.wide && counts.misfits.load(Ordering::Relaxed) > 0) {
                // The headers are wrong: again, with what the points say.
                wide |= counts.misfits.load(Ordering::Relaxed) > 0;
                extent = Some(measure(self.inputs, self.progress)?);
                drop(temporary);
                std::fs::remove_file(&path).map_err(|error| Error::io(&path, error))?;
                continue;
            }
            if counts.points.load(Ordering::Relaxed) == 0 {
                return Err(Error::Empty { path: first_path() });
            }
            let nodes = self.nodes(&plan, distributed, &temporary, &folder.join(pages::PAGES))?;
            drop(temporary);
            std::fs::remove_file(&path).map_err(|error| Error::io(&path, error))?;
            let summary = Summary {
                key: identity.key,
                on_grid: plan.on_grid,
                lattice: plan.lattice,
                layout: plan.layout,
                skipped: counts.skipped.load(Ordering::Relaxed),
                warnings,
            };
            return Ok((summary, nodes));
        }
    }

    /// The error of the first file that cannot be read, or that there are no points.
    fn why_empty(&self, path: PathBuf) -> Error {
        let error = |input: &Arc<Source>| input.read(&codec::Selection::default(), &Progress::default(), &|_| ()).err();
        self.inputs.iter().find_map(error).map_or(Error::Empty { path }, Error::Input)
    }

    /// Points a bucket should have, and may have.
    fn bucket_points(&self, plan: &Plan) -> (u64, u64) {
        let bytes = BYTES_PER_POINT + plan.layout.stride() as u64;
        let total: u64 = self.inputs.iter().map(|input| input.info().points).sum();
        let [least, usual, most] = BUCKET_POINTS;
        let target = (total / MOST_BUCKETS).clamp(usual, most).min(self.options.memory / 8 / bytes).max(least);
        (target, (self.options.memory / 4 / bytes).max(2 * least))
    }

    /// Reads all files and sorts their points into buckets. `trusting`: stop at the first point that is not where the
    /// headers say.
    fn distribute(
        &self,
        plan: &Plan,
        temporary: &Storage,
        counts: &Counts,
        trusting: bool,
    ) -> Result<(Vec<Bucket>, Vec<String>)> {
        let total: u64 = self.inputs.iter().map(|input| input.info().points).sum();
        let (target, _) = self.bucket_points(plan);
        let cells = if total > target { total * CELLS_PER_BUCKET / target } else { 1 };
        // Surfaces: four cells below each.
        let depth = (cells as f64).log(4.0).round() as u8;
        let placing = plan.lattice.placing();
        let memory = self.options.memory / 4;
        let distribution =
            Distribution::new(&plan.layout, placing, temporary, Cell::ROOT, depth, 2 << (2 * depth), memory);
        let failure: Mutex<Option<Error>> = Mutex::new(None);
        let mut warnings = Vec::new();
        let mut errors = Vec::new();
        let mut first_point = 0;
        for (input, (selection, columns)) in self.inputs.iter().zip(&plan.inputs) {
            let reading = Progress::default();
            let add = |chunk: Chunk| {
                let encoded = plan.layout.encode(&chunk, &plan.lattice, columns);
                counts.skipped.fetch_add(encoded.skipped, Ordering::Relaxed);
                counts.misfits.fetch_add(encoded.misfits, Ordering::Relaxed);
                let points = (encoded.records.len() / plan.layout.stride()) as u64;
                let inside = points == 0 || placing.is_inside(encoded.least) && placing.is_inside(encoded.greatest);
                counts.points.fetch_add(points, Ordering::Relaxed);
                counts.outside.fetch_or(!inside, Ordering::Relaxed);
                let wrong = !inside && trusting || encoded.misfits > 0;
                if self.progress.is_cancelled() || wrong {
                    return reading.cancel();
                }
                if let Err(error) = distribution.add(&encoded.records) {
                    failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                    return reading.cancel();
                }
                self.progress.add(chunk.len() as u64);
                drop(encoded);
                self.show(plan, chunk, columns, first_point, total);
            };
            let summary = input.read(selection, &reading, &add);
            if let Some(error) = failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
                return Err(error);
            }
            if self.progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            let path = input.info().path.display();
            match summary {
                Ok(summary) => warnings.extend(summary.warnings.iter().map(|warning| format!("{path}: {warning}"))),
                Err(error) => errors.push(error),
            }
            if reading.is_cancelled() {
                break;
            }
            first_point += input.info().points;
        }
        if errors.len() == self.inputs.len()
            && let Some(error) = errors.pop()
        {
            return Err(error.into());
        }
        warnings.extend(errors.into_iter().map(|error| format!("left out: {error}")));
        Ok((distribution.finish(), warnings))
    }

    /// Gives a share of a chunk to be seen.
    fn show(&self, plan: &Plan, chunk: Chunk, columns: &[Option<usize>], first_point: u64, total: u64) {
        let share = self.options.preview_points as f64 / total.max(1) as f64;
        let count = (chunk.len() as f64 * share.min(1.0)).ceil() as usize;
        if self.options.preview_points == 0 || count == 0 {
            return;
        }
        let mut some = chunk.select(&spread(chunk.len(), count));
        some.first_point += first_point;
        let column = |(attribute, column): (&cloud::Attribute, &Option<usize>)| {
            let column = column.and_then(|column| some.columns.get(column)?.clone())?;
            let same = column.column_type() == attribute.column_type;
            Some(if same { column } else { Arc::new(convert(&column, attribute.column_type)) })
        };
        some.columns = plan.layout.attributes.iter().zip(columns).map(column).collect();
        (self.preview)(some);
    }

    /// Buckets that fit memory, and nodes of them.
    fn nodes(&self, plan: &Plan, distributed: Vec<Bucket>, temporary: &Storage, path: &Path) -> Result<Vec<Written>> {
        let (target, most) = self.bucket_points(plan);
        let placing = plan.lattice.placing();
        let memory = self.options.memory / 4;
        let mut fitting = Vec::new();
        let mut todo = distributed;
        while let Some(mut bucket) = todo.pop() {
            if self.progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            if bucket.points <= most {
                fitting.push(bucket);
            } else if bucket.cell.level >= buckets::LAST_LEVEL {
                bucket.heap = true;
                fitting.push(bucket);
            } else {
                todo.extend(buckets::split(&bucket, &plan.layout, placing, temporary, most, memory)?);
            }
        }
        let buckets = buckets::merge(fitting, target);
        let pages = Storage::create(path, self.disk)?;
        let tree = Tree { layout: &plan.layout, placing, temporary, pages: &pages, progress: self.progress };
        let nodes = tree.build(&buckets, self.options.memory * 3 / 4)?;
        pages.sync()?;
        Ok(nodes)
    }
}

#[cfg(test)]
#[path = "../tests/made_up/mod.rs"]
mod made_up;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_by_its_folder_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.las");
        made_up::write_las(&path, &made_up::terrain(200_000));
        let inputs = [Arc::new(codec::open(&path).unwrap())];
        let cache = Cache::new(folder.path().join("cache"), u64::MAX);
        let options = BuildOptions { memory: 1 << 20, preview_points: 0 };
        let index = |disk| build_on_disk(&inputs, &cache, &options, &Progress::default(), &|_| (), disk);
        // Too small for the records; large enough for these (which stay in memory as far as they may), not for pages.
        for disk in [10_000, 1_000_000, 2_500_000] {
            let error = index(disk).err().unwrap();
            assert!(matches!(&error, Error::Full { folder, .. } if folder == cache.folder()), "{error}");
            let message = error.to_string();
            assert!(message.contains("cache") && message.contains("9 MB"), "{message}");
            assert_eq!(cache.size(), 0);
        }
        assert_eq!(index(u64::MAX).unwrap().octree().points(), 200_000);
    }
}
