//! Makes the index of some files in a folder of the cache: distributes the points to buckets, then builds the nodes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use cloud::{Bounds, Chunk, Progress};
use codec::{Selection, Source};
use param::shown;

use crate::buckets::{self, Bucket, Distribution};
use crate::cache::{Cache, Identity};
use crate::entry::{self, BUILDING, RECORDS};
use crate::lattice::Cell;
use crate::pages::{self, Pages, Summary, Written};
use crate::plan::{self, Extent, IndexPlan, Places};
use crate::preview::{Preview, Previewed};
use crate::storage::Storage;
use crate::tree::{BYTES_PER_POINT, Tree};
use crate::{Error, Result};

/// The disk space per point in bytes that the error of a full disk states.
const BYTES_WHILE_MADE: u64 = 40;
/// The time between two attempts to lock an entry that somebody else has locked.
const LOCK_WAIT: Duration = Duration::from_millis(30);
/// The disk space of a point in bytes while an index is made: a record, and most of a page.
const WORKING_DISK_BYTES: u64 = 33;
/// The number of points of a bucket: the least, however little memory there is; the number that is fast to sort; the
/// most.
const BUCKET_POINTS: [u64; 3] = [20_000, 400_000, 1_500_000];
/// The largest number of buckets; larger clouds get larger buckets instead of more.
const MOST_BUCKETS: u64 = 1000;
/// The number of cells of the first distribution per resulting bucket: clouds are uneven, and joining cells costs
/// nothing.
const CELLS_PER_BUCKET: u64 = 6;

/// The number of points per byte of the tables that stay in memory: the offsets of the blocks of records (16 bytes for
/// 32 KiB), and the nodes (some 330 bytes for 17,700 points).
const POINTS_PER_TABLE_BYTE: u64 = 25;
/// An upper limit for any file, whatever its header says.
const MOST_POINTS_PER_BYTE: u64 = 64;

/// The limits for making an index.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// The working memory in bytes, besides what decoding takes (some 20 MB a core).
    pub memory: u64,
    /// The largest number of points in the preview.
    pub preview_points: u64,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self { memory: 1 << 30, preview_points: 2_000_000 }
    }
}

/// The index of some files as one cloud: the one in the cache, or one made now. `progress` counts each point twice,
/// when it is read and when it is put in a node; and once more where headers lack the bounds or state wrong ones.
/// `preview` receives the first points of the compressed chunks of all files, and in their place an even share of the
/// points, from many threads at once; its `first_point` counts through all files.
///
/// A file that cannot be read to its end is left out from there on with a warning, if others can be read. An index that
/// was found to be damaged is made again although somebody may still have it open.
///
/// # Errors
/// `Cancelled`; `Changed` if a file is not the same at the end; `TooMany`; `Full`; `NotWritten`; `InTheWay`; `Empty`;
/// `Io`; `Input` if no file can be read. Nothing is left behind then.
pub fn build(
    inputs: &[Arc<Source>],
    cache: &Cache,
    options: &BuildOptions,
    progress: &Progress,
    preview: &(dyn Fn(Previewed) + Sync),
) -> Result<Pages> {
    build_in_order(inputs, cache, options, progress, preview, &|_| 0)
}

/// Does what `build` does, and reads the files in another order, so that the preview of what is looked at comes first. The
/// index does not depend on the order. `next` is called with the boxes of the files that are not read yet, in the order of
/// `inputs`, and says the place of the one that is read next; the boxes of files whose headers state none are empty.
///
/// # Errors
/// Those of `build`.
pub fn build_in_order(
    inputs: &[Arc<Source>],
    cache: &Cache,
    options: &BuildOptions,
    progress: &Progress,
    preview: &(dyn Fn(Previewed) + Sync),
    next: &(dyn Fn(&[Bounds]) -> usize + Sync),
) -> Result<Pages> {
    build_on_disk(inputs, cache, options, progress, preview, next, u64::MAX)
}

/// Shows an even share of the points of some files of which no index can be made, at most `most_points`. `also` names the
/// attributes that are shown besides the usual ones; `progress` counts each point once, and `preview` is that of [`build`].
/// Returns what is wrong with files that cannot be read to their end.
///
/// # Errors
/// `Cancelled`.
pub fn show_share(
    inputs: &[Arc<Source>],
    also: &BTreeSet<String>,
    most_points: u64,
    progress: &Progress,
    preview: &(dyn Fn(Previewed) + Sync),
) -> Result<Vec<String>> {
    let preview = Preview::new(most_points, header_points(inputs), preview);
    let (layout, starts) = (plan::layout(inputs, also, true), first_points(inputs));
    progress.set_total(progress.done().saturating_add(header_points(inputs)));
    preview.show_first(&layout, inputs, &starts, progress);
    let mut problems = Vec::new();
    for (input, start) in inputs.iter().zip(starts) {
        let (selection, columns) = plan::selection(input, &layout);
        let reading = Progress::default();
        let show = |chunk: Chunk| {
            if progress.is_cancelled() {
                reading.cancel();
            }
            progress.add(chunk.len() as u64);
            preview.add(&layout, &chunk, &columns, start);
        };
        problems.extend(input.read(&selection, &reading, &show).err().map(|error| error.to_string()));
        if progress.is_cancelled() {
            return Err(Error::Cancelled);
        }
    }
    preview.finish(&layout);
    Ok(problems)
}

/// Builds an index; `disk` limits the size of each file in bytes.
fn build_on_disk(
    inputs: &[Arc<Source>],
    cache: &Cache,
    options: &BuildOptions,
    progress: &Progress,
    preview: &(dyn Fn(Previewed) + Sync),
    next: &(dyn Fn(&[Bounds]) -> usize + Sync),
    disk: u64,
) -> Result<Pages> {
    let identity = cache.identity(inputs)?;
    let entry = cache.entry(&identity);
    let mut is_made = false;
    loop {
        if let Some(pages) = cache.open_known(&identity)? {
            progress.set_waiting(false);
            return Ok(pages);
        }
        let Some(lock) = cache.try_lock(&entry)? else {
            // Somebody else makes it, or reads what is left of it.
            cache.set_aside(&entry, &identity);
            if progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            progress.set_waiting(true);
            std::thread::sleep(LOCK_WAIT);
            continue;
        };
        progress.set_waiting(false);
        // Another builder may have made it since the last look.
        match Pages::open_locked(&entry, None) {
            Ok(pages) if pages.key() == identity.key && entry::is_own(&entry) => {}
            // The builder made the index a moment ago, so making it again would not help.
            Err(error) if is_made => return Err(error),
            Ok(_) | Err(_) => {
                let preview = Preview::new(options.preview_points, header_points(inputs), preview);
                let build = Build { inputs, also: cache.also(), options, progress, preview, next, disk };
                make_entry(&build, cache, &entry, &identity)?;
                is_made = true;
            }
        }
        drop(lock);
    }
}

/// Makes an entry whose lock the caller holds.
fn make_entry(build: &Build<'_>, cache: &Cache, entry: &Path, identity: &Identity) -> Result<()> {
    let io = |error| Error::not_written(entry, error);
    check_memory(build.inputs, build.options.memory)?;
    let points = header_points(build.inputs);
    let not_written = |error: Error| match error {
        error if error.is_full() => {
            Error::Full { folder: cache.folder().to_owned(), needed: points.saturating_mul(BYTES_WHILE_MADE) }
        }
        error => error.of_cache(cache.folder()),
    };
    cache.make_room(points.saturating_mul(WORKING_DISK_BYTES));
    // Clears what is left of a damaged entry or of a builder that was killed.
    entry::start(entry, &cache.aside(entry)).map_err(not_written)?;
    let mut unfinished = entry::Unfinished(entry, false);
    let building = entry.join(BUILDING);
    let outcome = build.run(&building, identity).and_then(|(summary, nodes)| {
        if let Some(path) = identity.changed() {
            return Err(Error::Changed { path: path.to_owned() });
        }
        std::fs::rename(building.join(entry::PAGES), entry.join(entry::PAGES)).map_err(io)?;
        std::fs::remove_dir(&building).map_err(io)?;
        pages::write(entry, &summary, nodes)?;
        Pages::open_locked(entry, None).map(drop)
    });
    outcome.map_err(not_written)?;
    unfinished.1 = true;
    drop(unfinished);
    cache.make_room(0);
    Ok(())
}

/// The depth in levels of the first distribution, whose cells are joined or split into buckets of `target` points.
fn first_depth(points: u64, target: u64, memory: u64) -> u8 {
    let cells = if points > target { points.saturating_mul(CELLS_PER_BUCKET) / target } else { 1 };
    // Points lie on surfaces, so each cell has about four occupied ones below it.
    let levels = |cells: u64| (cells as f64).log(4.0);
    levels(cells).round().min(levels(buckets::most_cells(memory)).floor()) as u8
}

/// Checks that the tables of all nodes and of all blocks of records fit in memory.
fn check_memory(inputs: &[Arc<Source>], budget: u64) -> Result<()> {
    let length = |input: &Arc<Source>| std::fs::metadata(&input.info().path).map_or(0, |file| file.len());
    let believable = inputs.iter().map(length).sum::<u64>().saturating_mul(MOST_POINTS_PER_BYTE);
    let points = header_points(inputs).min(believable);
    let needed = points / POINTS_PER_TABLE_BYTE;
    if needed > budget { Err(Error::TooMany { points, needed, budget }) } else { Ok(()) }
}

/// The number of points of all files, as far as their headers can be believed.
fn header_points(inputs: &[Arc<Source>]) -> u64 {
    inputs.iter().fold(0, |sum, input| sum.saturating_add(input.info().points))
}

/// The number of the first point of each file among the points of all files.
fn first_points(inputs: &[Arc<Source>]) -> Vec<u64> {
    let first = inputs.iter().scan(0_u64, |next, input| {
        let first = *next;
        *next = first.saturating_add(input.info().points);
        Some(first)
    });
    first.collect()
}

/// One run of the builder.
struct Build<'a> {
    inputs: &'a [Arc<Source>],
    /// The names of attributes that are kept besides the usual ones.
    also: &'a BTreeSet<String>,
    options: &'a BuildOptions,
    progress: &'a Progress,
    preview: Preview<'a>,
    /// Which of the files with these boxes is read next.
    next: &'a (dyn Fn(&[Bounds]) -> usize + Sync),
    disk: u64,
}

/// The counts from reading all files.
#[derive(Default)]
struct Counts {
    points: AtomicU64,
    skipped: AtomicU64,
    /// The number of points whose integers need more bits.
    misfits: AtomicU64,
    /// Whether there are points outside the cube.
    outside: AtomicBool,
    places: Places,
}

impl Build<'_> {
    fn run(&self, folder: &Path, identity: &Identity) -> Result<(Summary, Vec<Written>)> {
        let first_path = || identity.paths().next().map(Path::to_owned).unwrap_or_default();
        let mut extent: Option<Extent> = None;
        let mut wide = false;
        let mut scene = None;
        let layout = plan::layout(self.inputs, self.also, true);
        self.preview.show_first(&layout, self.inputs, &first_points(self.inputs), self.progress);
        loop {
            let Some(plan) = IndexPlan::new(self.inputs, self.also, extent.as_ref(), wide, scene) else {
                if extent.is_some() {
                    return Err(self.why_empty(first_path()));
                }
                extent = Some(self.measure()?);
                continue;
            };
            self.expect(2);
            let path = folder.join(RECORDS);
            let temporary = Storage::create(&path, self.disk)?;
            let counts = Counts::default();
            let trusting = extent.is_none() && scene.is_none();
            let (distributed, warnings) = self.distribute(&plan, &temporary, &counts, trusting)?;
            let outside = trusting && counts.outside.load(Ordering::Relaxed);
            if outside || (!plan.layout.wide && counts.misfits.load(Ordering::Relaxed) > 0) {
                // The headers are wrong: read again with the measured extent.
                wide |= counts.misfits.load(Ordering::Relaxed) > 0;
                extent = Some(self.measure()?);
                drop(temporary);
                std::fs::remove_file(&path).map_err(|error| Error::not_written(&path, error))?;
                continue;
            }
            if counts.points.load(Ordering::Relaxed) == 0 {
                return Err(Error::Empty { path: first_path() });
            }
            if scene.is_none() {
                scene = counts.places.scene_within(plan.lattice.width);
                if scene.is_some() {
                    // Strays lie far away: read again with a cube about the others.
                    drop((distributed, temporary));
                    std::fs::remove_file(&path).map_err(|error| Error::not_written(&path, error))?;
                    continue;
                }
            }
            let nodes = self.nodes(&plan, distributed, &temporary, &folder.join(entry::PAGES))?;
            drop(temporary);
            std::fs::remove_file(&path).map_err(|error| Error::not_written(&path, error))?;
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

    /// Adds `passes` passes over all points to the total of the progress.
    fn expect(&self, passes: u64) {
        let points = header_points(self.inputs).saturating_mul(passes);
        self.progress.set_total(self.progress.done().saturating_add(points));
    }

    /// Measures where the points are, when headers do not say. The preview is filled during this pass.
    fn measure(&self) -> Result<Extent> {
        self.expect(3);
        let layout = plan::layout(self.inputs, self.also, true);
        let (mut selections, columns): (Vec<Selection>, Vec<_>) =
            self.inputs.iter().map(|input| plan::selection(input, &layout)).unzip();
        if !self.preview.is_wanted() {
            selections.fill(Selection { positions: true, ..Selection::default() });
        }
        let starts = first_points(self.inputs);
        let extent = plan::measure(self.inputs, &selections, self.progress, &|file, chunk| {
            self.progress.add(chunk.len() as u64);
            self.preview.add(&layout, &chunk, &columns[file], starts[file]);
        });
        self.preview.finish(&layout);
        extent
    }

    /// The error of the first file that cannot be read, or `Empty`.
    fn why_empty(&self, path: PathBuf) -> Error {
        let error = |input: &Arc<Source>| input.read(&codec::Selection::default(), &Progress::default(), &|_| ()).err();
        self.inputs.iter().find_map(error).map_or(Error::Empty { path }, Error::Input)
    }

    /// The number of points that a bucket should have, and the most that it may have.
    fn bucket_points(&self, plan: &IndexPlan) -> (u64, u64) {
        let bytes = BYTES_PER_POINT + plan.layout.stride() as u64;
        let total = header_points(self.inputs);
        let [least, usual, most] = BUCKET_POINTS;
        let target = (total / MOST_BUCKETS).clamp(usual, most).min(self.options.memory / 8 / bytes).max(least);
        (target, (self.options.memory / 4 / bytes).max(2 * least))
    }

    /// Reads all files and sorts their points into buckets. With `trusting` it stops at the first point that is not
    /// where the headers say.
    fn distribute(
        &self,
        plan: &IndexPlan,
        temporary: &Storage,
        counts: &Counts,
        trusting: bool,
    ) -> Result<(Vec<Bucket>, Vec<String>)> {
        let total = header_points(self.inputs);
        let (target, _) = self.bucket_points(plan);
        let placing = plan.lattice.placing();
        let memory = self.options.memory / 4;
        let depth = first_depth(total, target, memory);
        let distribution =
            Distribution::new(&plan.layout, placing, temporary, Cell::ROOT, depth, 2 << (2 * depth), memory);
        let failure: Mutex<Option<Error>> = Mutex::new(None);
        // What is wrong with a file, by its place among the files.
        let (mut warnings, mut errors) = (BTreeMap::new(), BTreeMap::new());
        let starts = first_points(self.inputs);
        let mut left: Vec<usize> = (0..self.inputs.len()).collect();
        let mut boxes: Vec<Bounds> =
            self.inputs.iter().map(|input| input.info().bounds.unwrap_or(Bounds::EMPTY)).collect();
        while !left.is_empty() {
            let place = (self.next)(&boxes).min(left.len() - 1);
            boxes.remove(place);
            let file = left.remove(place);
            let (input, (selection, columns), first_point) = (&self.inputs[file], &plan.inputs[file], starts[file]);
            let before = counts.points.load(Ordering::Relaxed);
            let reading = Progress::default();
            let add = |chunk: Chunk| {
                let chunk = plan.exact(chunk, input.info().grid);
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
                counts.places.add(&chunk);
                drop(encoded);
                self.preview.add(&plan.layout, &chunk, columns, first_point);
            };
            let summary = input.read(selection, &reading, &add);
            if let Some(error) = failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
                return Err(error);
            }
            if self.progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            let path = shown(&input.info().path);
            match summary {
                Ok(summary) => {
                    let named = summary.warnings.iter().map(|warning| format!("{path}: {warning}"));
                    warnings.insert(file, named.collect::<Vec<String>>());
                }
                Err(error) => {
                    let has_some = counts.points.load(Ordering::Relaxed) > before;
                    errors.insert(file, (if has_some { "read only in part" } else { "left out" }, error));
                }
            }
            if reading.is_cancelled() {
                break;
            }
        }
        self.preview.finish(&plan.layout);
        if errors.len() == self.inputs.len()
            && let Some((_, (_, error))) = errors.pop_last()
        {
            return Err(error.into());
        }
        let problems = errors.into_values().map(|(what, error)| format!("{what}: {error}"));
        let warnings = warnings.into_values().flatten().chain(problems).collect();
        Ok((distribution.finish(), warnings))
    }

    /// Joins and splits buckets until they fit in memory, and builds nodes of them.
    fn nodes(
        &self,
        plan: &IndexPlan,
        distributed: Vec<Bucket>,
        temporary: &Storage,
        path: &Path,
    ) -> Result<Vec<Written>> {
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
#[path = "build_tests.rs"]
mod tests;
