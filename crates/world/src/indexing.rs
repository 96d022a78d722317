//! Finds, makes, mends and completes the indexes of streamed clouds.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use cloud::{Attribute, Bounds, Chunk, SurfelOptions};
use glam::DVec3;
use stream::{BuildOptions, Pages, Previewed};

use crate::budget::{half_of, most_preview_points};
use crate::chunk_key::Part;
use crate::error::is_of_inputs;
use crate::event::{Event, IndexState, Opened};
use crate::input::Input;
use crate::loader::Loader;
use crate::mailbox::{Arrival, IndexRequest};
use crate::reading::Loading;
use crate::source::{called, common_scanner, file_warnings, surfel_options, up_of};
use crate::task::{CloudTask, TaskKind};

/// A streamed cloud while its index is found or made.
pub(crate) struct StreamedInput {
    cloud: usize,
    input: String,
    name: String,
    sources: Vec<Arc<codec::Source>>,
    up: DVec3,
    /// The index that was found in the file or in the cache, until it is passed on.
    found: Option<Pages>,
    is_native: bool,
    /// The number of points of each chunk that is shown while there is no index.
    previews: Mutex<HashMap<Part, u64>>,
    /// The number of previews so far.
    previews_begun: AtomicU32,
}

impl StreamedInput {
    /// Whether its points are read from a server.
    pub(crate) fn is_far(&self) -> bool {
        self.is_native && self.sources.iter().any(|source| source.bytes().is_remote())
    }
}

/// The share of the memory for building that a preview may take (one in this number), and the memory of one of its
/// points in bytes: as a chunk and on the GPU, which may have no memory of its own.
const PREVIEW_SHARE: u64 = 8;
const PREVIEW_POINT_BYTES: u64 = 80;

/// Why there is no index.
enum Stopped {
    Cancelled,
    /// The cache cannot hold it, with the message.
    NotWritten(String),
    /// The message, and whether the input is at fault.
    Failed(String, bool),
}

impl Stopped {
    fn of(error: stream::Error) -> Self {
        match error {
            stream::Error::Cancelled => Self::Cancelled,
            stream::Error::Full { .. } | stream::Error::NotWritten { .. } | stream::Error::InTheWay { .. } => {
                Self::NotWritten(error.to_string())
            }
            error => Self::Failed(error.to_string(), is_of_inputs(&error)),
        }
    }
}

impl Loader {
    /// Streams clouds that have an index at once, reads clouds that are held in memory, and makes missing indexes. Then
    /// waits for requests: to mend damaged indexes, and to resume stopped tasks. `has_tiles` says that the streaming thread
    /// has tiles, too, which it opens itself.
    pub(crate) fn stream_all(
        &self,
        mut streamed_inputs: Vec<StreamedInput>,
        has_tiles: bool,
        opened: Vec<Loading>,
    ) -> Option<()> {
        let mut there: Vec<(&StreamedInput, Pages)> = Vec::new();
        let mut missing = Vec::new();
        let found: Vec<Option<Pages>> = streamed_inputs.iter_mut().map(|streamed| streamed.found.take()).collect();
        for (streamed, found) in streamed_inputs.iter().zip(found) {
            match found {
                Some(pages) => there.push((streamed, pages)),
                None => missing.push((streamed, self.plan_index(streamed)?)),
            }
        }
        // Room is kept before any of the indexes found can take the place of the previews.
        let preview_points = self.preview_points() / missing.len().max(1) as u64;
        missing.iter().for_each(|(streamed, _)| self.mailbox.keep_room(streamed.cloud, preview_points));
        let stream = |(streamed, pages)| {
            self.stream(streamed, pages, false, HashMap::new());
            streamed
        };
        // The clouds that have an index, or may still get one.
        let mut open: Vec<&StreamedInput> = there.into_iter().map(stream).collect();
        self.read_all(opened)?;
        for (streamed, task) in missing {
            if self.index(streamed, &task, preview_points)? || task.progress.is_cancelled() {
                open.push(streamed);
            }
        }
        self.refine_all(&open)?;
        let mut again = HashSet::new();
        while has_tiles || !open.is_empty() {
            for request in self.mailbox.wait_for_requests()? {
                let cloud = match request {
                    IndexRequest::Mend(cloud) | IndexRequest::Resume(cloud) => cloud,
                    IndexRequest::Keep(names) => {
                        self.keep_attributes(names, &open)?;
                        continue;
                    }
                };
                let Some(streamed) = open.iter().copied().find(|streamed| streamed.cloud == cloud) else { continue };
                let is_kept = match request {
                    IndexRequest::Resume(_) => self.resume(streamed, preview_points)?,
                    // Only once: a disk that damages the data written to it would keep this going for ever.
                    IndexRequest::Mend(_) if again.insert(cloud) => {
                        self.discard(streamed);
                        let task = self.plan_index(streamed)?;
                        // The chunks shown stay meanwhile.
                        self.index(streamed, &task, 0)? || task.progress.is_cancelled()
                    }
                    _ => {
                        let problem = "its pages were damaged again after they had been made anew";
                        let error = format!("{}: {problem}", streamed.input);
                        self.send(Event::Failed { input: streamed.input.clone(), error, is_usage: false })?;
                        false
                    }
                };
                if is_kept {
                    self.refine_all(&[streamed])?;
                } else {
                    self.mailbox.close(cloud);
                    open.retain(|streamed| streamed.cloud != cloud);
                }
            }
        }
        Some(())
    }

    /// Makes the index of a cloud if that was stopped; returns false if there will never be one.
    fn resume(&self, streamed: &StreamedInput, preview_points: u64) -> Option<bool> {
        if self.mailbox.task(streamed.cloud).is_none_or(|stopped| stopped.kind != TaskKind::Index) {
            return Some(true);
        }
        let task = self.plan_index(streamed)?;
        Some(self.index(streamed, &task, preview_points)? || task.progress.is_cancelled())
    }

    /// Has the clouds keep further attributes, as far as their files have them and they do not keep them yet.
    fn keep_attributes(&self, names: BTreeSet<String>, open: &[&StreamedInput]) -> Option<()> {
        let before = self.also();
        self.also.lock().unwrap_or_else(PoisonError::into_inner).extend(names);
        let also = self.also();
        for streamed in open.iter().copied().filter(|streamed| !self.mailbox.is_closed(streamed.cloud)) {
            let [kept, wanted] = [&before, &also].map(|names| stream::index_attributes(&streamed.sources, names));
            if kept == wanted {
                continue;
            }
            let native = streamed.sources.first().filter(|_| streamed.is_native);
            if let Some(pages) = native.and_then(|source| Pages::copc(source, &also)) {
                self.stream(streamed, pages, false, HashMap::new());
                continue;
            }
            // The cloud is streamed from the old index meanwhile, so nobody hears that it has none.
            let points = streamed.sources.iter().map(|source| source.info().points).sum();
            let task = self.plan(streamed.cloud, TaskKind::Index, points)?;
            if self.index(streamed, &task, 0)? {
                self.refine_all(&[streamed])?;
            }
        }
        Some(())
    }

    /// Opens files that are streamed as one cloud. `is_all` says that they are all files of the input.
    pub(crate) fn begin_streamed(
        &self,
        input: &Input,
        (sources, native): (Vec<Arc<codec::Source>>, Option<Pages>),
        is_all: bool,
        cloud: usize,
    ) -> Option<StreamedInput> {
        let infos = || sources.iter().map(|source| source.info());
        let (path, name) = called(input, &sources, is_all);
        let is_native = native.is_some();
        let found = native.or_else(|| match self.index_cache().map(|cache| cache.open(&sources)) {
            Ok(Ok(found)) => found,
            // A problem with the folder is reported when an index is to be written there.
            Ok(Err(_)) | Err(_) => None,
        });
        let (attributes, grid) = match &found {
            Some(pages) => (pages.attributes().to_vec(), pages.grid()),
            None => {
                let grid = infos().next().and_then(|info| info.grid);
                (
                    stream::index_attributes(&sources, &self.also()),
                    grid.filter(|grid| infos().all(|info| info.grid == Some(*grid))),
                )
            }
        };
        let points = infos().map(|info| info.points).sum();
        let bounds = infos().filter_map(|info| info.bounds).fold(Bounds::EMPTY, Bounds::union);
        let up = infos().next().map_or(DVec3::Z, |info| up_of(info, &self.settings));
        let crs = infos().next().and_then(|info| info.crs.clone());
        let units = infos().next().map(|info| info.units).unwrap_or_default();
        let mut warnings: Vec<String> = match sources.as_slice() {
            [one] => one.info().warnings.clone(),
            several => several.iter().flat_map(|source| file_warnings(source.info())).collect(),
        };
        let first = infos().next();
        let other = infos().find_map(|info| Some((info, info.system_difference(first?)?)));
        if let Some((other, difference)) = other {
            let other = scene::shown(&other.path);
            warnings.push(format!("{other} has {difference} than the first file of {name}"));
        }
        let mut offered: Vec<Attribute> = Vec::new();
        for attribute in infos().flat_map(|info| &info.attributes) {
            if !offered.iter().any(|known| known.name == attribute.name) {
                offered.push(attribute.clone());
            }
        }
        let opened = Opened {
            name: name.clone(),
            input: scene::shown(&path),
            // Points come in the order of pages: looking up a point's number in a file would give another point.
            source: None,
            files: Arc::new(sources.iter().filter_map(|source| source.bytes().named_file()).collect()),
            attributes,
            offered,
            grid,
            crs,
            units,
            expected_points: points,
            up,
            scanner: common_scanner(&sources),
            provisional_radius: if bounds.is_empty() { 0.0 } else { cloud::provisional_radius(bounds, points) },
            warnings,
        };
        self.send(Event::Opened { cloud, opened })?;
        let input = scene::shown(&path);
        Some(StreamedInput {
            cloud,
            input,
            name,
            sources,
            up,
            found,
            is_native,
            previews: Mutex::default(),
            previews_begun: AtomicU32::new(0),
        })
    }

    /// Passes pages to the streaming thread. If they lack normals and radii and will not get them, each node's are
    /// estimated from its own points.
    pub(crate) fn stream(&self, streamed: &StreamedInput, pages: Pages, was_built: bool, previews: HashMap<Part, u64>) {
        let estimate = streamed.is_native.then(|| self.surfel_options(streamed, &pages)).flatten();
        let points: u64 = streamed.sources.iter().map(|source| source.info().points).sum();
        let kept = pages.octree().points().saturating_add(pages.skipped_points());
        let unread = if streamed.is_native { 0 } else { points.saturating_sub(kept) };
        let (input, name) = (streamed.input.clone(), streamed.name.clone());
        let (cloud, pages) = (streamed.cloud, Arc::new(pages));
        self.mailbox.arrive(Arrival {
            cloud,
            input,
            name,
            fit: None,
            pages,
            is_own: !streamed.is_native,
            missing: codec::missing_points(&streamed.sources).saturating_add(unread),
            was_built,
            estimate,
            previews,
        });
    }

    /// The number of points of all previews of the job.
    fn preview_points(&self) -> u64 {
        if !self.has_preview {
            return 0;
        }
        let memory = half_of(self.settings.stream.host_bytes);
        most_preview_points(&self.settings).min(memory / PREVIEW_SHARE / PREVIEW_POINT_BYTES)
    }

    fn plan_index(&self, streamed: &StreamedInput) -> Option<Arc<CloudTask>> {
        self.send(Event::Pages { cloud: streamed.cloud, pages: IndexState::Indexing })?;
        self.plan(streamed.cloud, TaskKind::Index, streamed.sources.iter().map(|source| source.info().points).sum())
    }

    /// Makes the index of a cloud and has it streamed; returns whether there is one now.
    fn index(&self, streamed: &StreamedInput, task: &CloudTask, preview_points: u64) -> Option<bool> {
        let cloud = streamed.cloud;
        let memory = half_of(self.settings.stream.host_bytes);
        let previews = || streamed.previews.lock().unwrap_or_else(PoisonError::into_inner);
        // After an earlier stop its preview is still shown, until the new preview is as large.
        let shown: u64 = previews().values().sum();
        let preview_points = if shown < preview_points { preview_points } else { 0 };
        self.mailbox.keep_room(cloud, preview_points + shown);
        let old: Vec<Part> = if preview_points > 0 { previews().keys().copied().collect() } else { Vec::new() };
        let old = Mutex::new(old);
        let old = || old.lock().unwrap_or_else(PoisonError::into_inner);
        let drop_part = |part: Part| {
            previews().remove(&part);
            self.send(Event::Dropped { cloud, part })
        };
        // The number of points of the new preview so far.
        let counted = AtomicU64::new(0);
        let show = |chunk: Chunk| {
            self.mailbox.give_way();
            let points = chunk.len() as u64;
            let part = Part::Preview(streamed.previews_begun.fetch_add(1, Ordering::Relaxed));
            previews().insert(part, points);
            let is_as_large = counted.fetch_add(points, Ordering::Relaxed) + points >= shown;
            self.send(Event::Chunk { cloud, part, chunk })?;
            let gone = if is_as_large { std::mem::take(&mut *old()) } else { Vec::new() };
            gone.into_iter().try_for_each(&drop_part)?;
            Some(part)
        };
        // The parts of first points, by their groups.
        let first: Mutex<HashMap<u32, Part>> = Mutex::default();
        let first = || first.lock().unwrap_or_else(PoisonError::into_inner);
        let preview = |change: Previewed| {
            let sent = match change {
                Previewed::Share(chunk) => show(chunk).map(drop),
                // What is shown of an earlier preview has more points, some of them the same ones.
                Previewed::First(_, chunk) if shown > 0 => {
                    counted.fetch_add(chunk.len() as u64, Ordering::Relaxed);
                    Some(())
                }
                Previewed::First(group, chunk) => show(chunk).map(|part| {
                    first().insert(group, part);
                }),
                Previewed::FirstGone(group) => first().remove(&group).map_or(Some(()), drop_part),
            };
            if sent.is_none() {
                task.progress.cancel();
            }
        };
        let next = |boxes: &[Bounds]| self.mailbox.first_seen(cloud, boxes);
        let start = Instant::now();
        let options = BuildOptions { memory, preview_points };
        let built = match &self.index_cache() {
            Ok(_) if task.progress.is_cancelled() => Err(Stopped::Cancelled),
            Ok(cache) => task
                .run(|progress| stream::build_in_order(&streamed.sources, cache, &options, progress, &preview, &next))
                .map_err(Stopped::of),
            Err(error) => Err(Stopped::NotWritten((*error).to_owned())),
        };
        tracing::debug!(input = streamed.input, seconds = start.elapsed().as_secs_f64(), "indexed");
        match built {
            Ok(pages) => {
                // Another program may have made it.
                let was_built = task.progress.done() > 0;
                self.stream(streamed, pages, was_built, std::mem::take(&mut *previews()));
                Some(true)
            }
            Err(Stopped::Cancelled) => {
                let points = previews().values().sum();
                self.mailbox.keep_room(cloud, points);
                let summary = codec::Summary { points, cancelled: true, ..Default::default() };
                self.send(Event::Read { cloud, summary }).map(|()| false)
            }
            // What a preview shows is better than nothing.
            Err(Stopped::NotWritten(error)) if preview_points > 0 || !previews().is_empty() => {
                let error = format!("{error}; until then an even share of the cloud's points is read and shown");
                self.send(Event::Failed { input: streamed.input.clone(), error, is_usage: false })?;
                // A preview that is not as large as the one before it goes, and that one stays.
                let before = std::mem::take(&mut *old());
                let is_new = |part: &Part| !before.is_empty() && !before.contains(part);
                let gone: Vec<Part> = previews().keys().copied().filter(is_new).collect();
                gone.into_iter().try_for_each(&drop_part)?;
                self.show_share(streamed, task, preview_points, &preview)?;
                let cancelled = task.progress.is_cancelled();
                // It can be resumed.
                task.progress.cancel();
                let points = previews().values().sum();
                self.mailbox.keep_room(cloud, points);
                let summary = codec::Summary { points, cancelled, ..Default::default() };
                self.send(Event::Read { cloud, summary }).map(|()| false)
            }
            Err(Stopped::NotWritten(error)) => self.failed(streamed, error, false),
            Err(Stopped::Failed(error, is_usage)) => self.failed(streamed, error, is_usage),
        }
    }

    /// Says that there will be no index, and takes the preview away.
    fn failed(&self, streamed: &StreamedInput, error: String, is_usage: bool) -> Option<bool> {
        let cloud = streamed.cloud;
        self.send(Event::Failed { input: streamed.input.clone(), error, is_usage })?;
        let gone = std::mem::take(&mut *streamed.previews.lock().unwrap_or_else(PoisonError::into_inner));
        for part in gone.into_keys() {
            self.send(Event::Dropped { cloud, part })?;
        }
        self.mailbox.keep_room(cloud, 0);
        self.send(Event::Read { cloud, summary: codec::Summary::default() }).map(|()| false)
    }

    /// Shows an even share of the points of a cloud whose index cannot be written, unless the preview is one.
    fn show_share(
        &self,
        streamed: &StreamedInput,
        task: &CloudTask,
        most_points: u64,
        preview: &(dyn Fn(Previewed) + Sync),
    ) -> Option<()> {
        let previews = || streamed.previews.lock().unwrap_or_else(PoisonError::into_inner);
        let before: HashMap<Part, u64> = previews().clone();
        let shown: u64 = before.values().sum();
        // Fewer points are those of the beginnings of files.
        if shown >= most_points.min(task.points()) / 10 * 9 {
            return Some(());
        }
        self.mailbox.keep_room(streamed.cloud, most_points + shown);
        let also = self.also();
        let share = task.run(|progress| stream::show_share(&streamed.sources, &also, most_points, progress, preview));
        // Where it was stopped, what was there before stays, or else what has come.
        let gone = |part: &Part| match share {
            Ok(_) => before.contains_key(part),
            Err(_) => !before.is_empty() && !before.contains_key(part),
        };
        let gone: Vec<Part> = previews().keys().copied().filter(gone).collect();
        for part in gone {
            previews().remove(&part);
            self.send(Event::Dropped { cloud: streamed.cloud, part })?;
        }
        let problems = share.unwrap_or_default();
        let Some(error) = problems.first() else { return Some(()) };
        let more = match problems.len() - 1 {
            0 => String::new(),
            more => format!("; and {more} more of its files cannot be read"),
        };
        self.send(Event::Failed { input: streamed.input.clone(), error: format!("{error}{more}"), is_usage: true })
    }

    /// Estimates missing normals and radii of all points of indexes of ours.
    fn refine_all(&self, streamed_inputs: &[&StreamedInput]) -> Option<()> {
        let mut planned = Vec::new();
        for streamed in streamed_inputs {
            if let Some((options, points)) = self.lacking_surfels(streamed) {
                planned.push((streamed, options, self.plan(streamed.cloud, TaskKind::Surfels, points)?));
            }
        }
        planned.iter().try_for_each(|(streamed, options, task)| self.refine(streamed, options, task))
    }

    /// The options for estimating normals and radii of an index of ours, and the number of points, if they are missing.
    fn lacking_surfels(&self, streamed: &StreamedInput) -> Option<(SurfelOptions, u64)> {
        if streamed.is_native || self.mailbox.is_closed(streamed.cloud) {
            return None;
        }
        let pages = self.index_cache().ok()?.open(&streamed.sources).ok()??;
        let options = self.surfel_options(streamed, &pages)?;
        (pages.surfel_options() != Some(&options)).then(|| (options, pages.octree().points()))
    }

    /// Estimates normals and radii from all points of an index; then streams it with them.
    fn refine(&self, streamed: &StreamedInput, options: &SurfelOptions, task: &CloudTask) -> Option<()> {
        if task.progress.is_cancelled() {
            return Some(());
        }
        let Ok(cache) = self.index_cache() else { return Some(()) };
        let Ok(Some(pages)) = cache.open(&streamed.sources) else { return Some(()) };
        let start = Instant::now();
        let memory = half_of(self.settings.stream.host_bytes);
        let estimated = task.run(|progress| stream::estimate_surfels(&pages, options, memory, progress));
        tracing::debug!(cloud = streamed.cloud, ?options, seconds = start.elapsed().as_secs_f64(), "normals and radii");
        drop(pages);
        match estimated.and_then(|()| cache.open(&streamed.sources)) {
            Ok(Some(pages)) => self.stream(streamed, pages, false, HashMap::new()),
            Ok(None) | Err(stream::Error::Cancelled) => {}
            Err(stream::Error::Damaged { .. }) => self.mailbox.report_damage(streamed.cloud),
            Err(error) => {
                let (input, is_usage) = (streamed.input.clone(), is_of_inputs(&error));
                self.send(Event::Failed { input, error: error.to_string(), is_usage })?;
            }
        }
        Some(())
    }

    fn discard(&self, streamed: &StreamedInput) {
        if let Ok(cache) = self.index_cache()
            && let Ok(Some(pages)) = cache.open(&streamed.sources)
        {
            cache.discard(pages);
        }
    }

    fn surfel_options(&self, streamed: &StreamedInput, pages: &Pages) -> Option<SurfelOptions> {
        let options = surfel_options(pages, streamed.up, common_scanner(&streamed.sources), &self.settings);
        options.map_err(|error| tracing::warn!(input = streamed.input, %error, "pages cannot be read")).ok()
    }
}
