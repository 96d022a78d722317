//! Streamed clouds while their indexes are found, made, mended or made better.

use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use cloud::{Bounds, Chunk, SurfelOptions};
use glam::DVec3;
use stream::{BuildOptions, Pages};

use crate::budget::{half_of, most_preview_points};
use crate::chunk_key::Part;
use crate::error::is_of_inputs;
use crate::event::{Event, Opened, Paged};
use crate::loader::Loader;
use crate::mailbox::{Arrival, Wish};
use crate::reading::Loading;
use crate::source::{file_name, file_warnings, surfel_options, up_of};
use crate::stage::{Making, Stage};
use crate::words::Input;

/// A streamed cloud while its pages are found or made.
pub(crate) struct Paging {
    cloud: usize,
    input: String,
    sources: Vec<Arc<codec::Source>>,
    up: DVec3,
    /// Found in the file or in the cache; handed on.
    found: Option<Pages>,
    is_native: bool,
    /// Points of the chunks that are shown while there is no index.
    previews: Mutex<HashMap<Part, u64>>,
    /// Previews that there were so far.
    previews_begun: AtomicU32,
}

/// Part of the memory for building that goes into a preview, and bytes that a point of it takes: as a chunk and on the GPU, which
/// may have no memory of its own.
const PREVIEW_SHARE: u64 = 8;
const PREVIEW_POINT_BYTES: u64 = 80;

/// Why there is no index.
enum Stopped {
    Cancelled,
    /// What to say of it, and whether the input is at fault.
    Failed(String, bool),
}

impl Stopped {
    fn of(error: stream::Error) -> Self {
        match error {
            stream::Error::Cancelled => Self::Cancelled,
            error => Self::Failed(error.to_string(), is_of_inputs(&error)),
        }
    }
}

impl Loader {
    /// Streams what is there at once, reads what is held in memory, makes indexes that are missing, and stays to make those again
    /// that turn out to be damaged, and those after all that were stopped.
    pub(crate) fn page_all(&self, mut paged: Vec<Paging>, opened: Vec<Loading>) -> Option<()> {
        let mut there: Vec<(&Paging, Pages)> = Vec::new();
        let mut missing = Vec::new();
        let found: Vec<Option<Pages>> = paged.iter_mut().map(|paging| paging.found.take()).collect();
        for (paging, found) in paged.iter().zip(found) {
            match found {
                Some(pages) => there.push((paging, pages)),
                None => missing.push((paging, self.plan_index(paging)?)),
            }
        }
        // Before anything of what is there takes the place of the previews.
        let preview_points = self.preview_points() / missing.len().max(1) as u64;
        missing.iter().for_each(|(paging, _)| self.mailbox.keep_room(paging.cloud, preview_points));
        let stream = |(paging, pages)| {
            self.stream(paging, pages, false, HashMap::new());
            paging
        };
        // Clouds that there is an index of, or may still be.
        let mut open: Vec<&Paging> = there.into_iter().map(stream).collect();
        self.read_all(opened)?;
        for (paging, stage) in missing {
            if self.index(paging, &stage, preview_points)? || stage.progress.is_cancelled() {
                open.push(paging);
            }
        }
        self.refine_all(&open)?;
        let mut again = HashSet::new();
        while !open.is_empty() {
            for wish in self.mailbox.rest()? {
                let (Wish::Mend(cloud) | Wish::Resume(cloud)) = wish;
                let Some(paging) = open.iter().copied().find(|paging| paging.cloud == cloud) else { continue };
                let is_kept = match wish {
                    Wish::Resume(_) => self.resume(paging, preview_points)?,
                    // Once: a disk that damages what is written to it would keep this going for ever.
                    Wish::Mend(_) if again.insert(cloud) => {
                        self.discard(paging);
                        let stage = self.plan_index(paging)?;
                        // What is shown stays meanwhile.
                        self.index(paging, &stage, 0)? || stage.progress.is_cancelled()
                    }
                    Wish::Mend(_) => {
                        let problem = "its pages were damaged again after they had been made anew";
                        let error = format!("{}: {problem}", paging.input);
                        self.send(Event::Failed { input: paging.input.clone(), error, is_usage: false })?;
                        false
                    }
                };
                if is_kept {
                    self.refine_all(&[paging])?;
                } else {
                    self.mailbox.close(cloud);
                    open.retain(|paging| paging.cloud != cloud);
                }
            }
        }
        Some(())
    }

    /// Makes the index of a cloud if that was stopped; false if there will never be one.
    fn resume(&self, paging: &Paging, preview_points: u64) -> Option<bool> {
        if self.mailbox.stage(paging.cloud).is_none_or(|stopped| stopped.making != Making::Index) {
            return Some(true);
        }
        let stage = self.plan_index(paging)?;
        Some(self.index(paging, &stage, preview_points)? || stage.progress.is_cancelled())
    }

    /// Files that are streamed as one cloud.
    pub(crate) fn begin_paging(
        &self,
        input: &Input,
        sources: Vec<Arc<codec::Source>>,
        native: Option<Pages>,
        cloud: usize,
    ) -> Option<Paging> {
        let infos = || sources.iter().map(|source| source.info());
        let path = match (input, sources.as_slice()) {
            (Input::Tiles { folder, .. }, [_, _, ..]) => folder.clone(),
            _ => infos().next().map(|info| info.path.clone()).unwrap_or_default(),
        };
        let is_native = native.is_some();
        let found = native.or_else(|| match self.cache.as_ref().map(|cache| cache.open(&sources)) {
            Ok(Ok(found)) => found,
            // What is wrong with the folder is said when an index is to be written there.
            Ok(Err(_)) | Err(_) => None,
        });
        let (attributes, grid) = match &found {
            Some(pages) => (pages.attributes().to_vec(), pages.grid()),
            None => {
                let grid = infos().next().and_then(|info| info.grid);
                (stream::index_attributes(&sources), grid.filter(|grid| infos().all(|info| info.grid == Some(*grid))))
            }
        };
        let points = infos().map(|info| info.points).sum();
        let bounds = infos().filter_map(|info| info.bounds).fold(Bounds::EMPTY, Bounds::union);
        let up = infos().next().map_or(DVec3::Z, |info| up_of(info, &self.settings));
        let opened = Opened {
            name: file_name(&path),
            input: scene::shown(&path),
            // Points come in the order of pages: what is looked up in a file by a point's number would be another's.
            source: None,
            attributes,
            grid,
            expected_points: points,
            up,
            provisional_radius: if bounds.is_empty() { 0.0 } else { cloud::provisional_radius(bounds, points) },
            warnings: match sources.as_slice() {
                [one] => one.info().warnings.clone(),
                several => several.iter().flat_map(|source| file_warnings(source.info())).collect(),
            },
        };
        self.send(Event::Opened { cloud, opened })?;
        let input = scene::shown(&path);
        Some(Paging {
            cloud,
            input,
            sources,
            up,
            found,
            is_native,
            previews: Mutex::default(),
            previews_begun: AtomicU32::new(0),
        })
    }

    /// Has pages streamed. Where they lack normals and radii and will not get them, each node's are estimated from its own points.
    fn stream(&self, paging: &Paging, pages: Pages, was_built: bool, previews: HashMap<Part, u64>) {
        let estimate = paging.is_native.then(|| self.surfel_options(paging, &pages)).flatten();
        let (cloud, input, pages) = (paging.cloud, paging.input.clone(), Arc::new(pages));
        self.mailbox.arrive(Arrival { cloud, input, pages, is_own: !paging.is_native, was_built, estimate, previews });
    }

    /// Points of all previews of the job.
    fn preview_points(&self) -> u64 {
        if !self.has_preview {
            return 0;
        }
        let memory = half_of(self.settings.stream.host_bytes);
        most_preview_points(&self.settings).min(memory / PREVIEW_SHARE / PREVIEW_POINT_BYTES)
    }

    fn plan_index(&self, paging: &Paging) -> Option<Arc<Stage>> {
        self.send(Event::Pages { cloud: paging.cloud, pages: Paged::Indexing })?;
        self.plan(paging.cloud, Making::Index, paging.sources.iter().map(|source| source.info().points).sum())
    }

    /// Makes the index of a cloud and has it streamed; whether there is one now.
    fn index(&self, paging: &Paging, stage: &Stage, preview_points: u64) -> Option<bool> {
        let cloud = paging.cloud;
        let memory = half_of(self.settings.stream.host_bytes);
        let previews = || paging.previews.lock().unwrap_or_else(PoisonError::into_inner);
        // Where it was stopped before, what was shown then still is: until the new preview is as large.
        let shown: u64 = previews().values().sum();
        let preview_points = if shown < preview_points { preview_points } else { 0 };
        self.mailbox.keep_room(cloud, preview_points + shown);
        let old: Vec<Part> = if preview_points > 0 { previews().keys().copied().collect() } else { Vec::new() };
        let old = Mutex::new(old);
        // Points of the new preview so far.
        let counted = AtomicU64::new(0);
        let preview = |chunk: Chunk| {
            self.mailbox.give_way();
            let points = chunk.len() as u64;
            let part = Part::Preview(paging.previews_begun.fetch_add(1, Ordering::Relaxed));
            previews().insert(part, points);
            let is_as_large = counted.fetch_add(points, Ordering::Relaxed) + points >= shown;
            let mut sent = self.send(Event::Chunk { cloud, part, chunk });
            if is_as_large {
                for part in std::mem::take(&mut *old.lock().unwrap_or_else(PoisonError::into_inner)) {
                    previews().remove(&part);
                    sent = sent.and_then(|()| self.send(Event::Dropped { cloud, part }));
                }
            }
            if sent.is_none() {
                stage.progress.cancel();
            }
        };
        let start = Instant::now();
        let options = BuildOptions { memory, preview_points };
        let built = match &self.cache {
            Ok(_) if stage.progress.is_cancelled() => Err(Stopped::Cancelled),
            Ok(cache) => stage
                .run(|progress| stream::build(&paging.sources, cache, &options, progress, &preview))
                .map_err(Stopped::of),
            Err(error) => Err(Stopped::Failed(error.clone(), false)),
        };
        tracing::debug!(input = paging.input, seconds = start.elapsed().as_secs_f64(), "indexed");
        match built {
            Ok(pages) => {
                // Another program may have made it.
                let was_built = stage.progress.done() > 0;
                self.stream(paging, pages, was_built, std::mem::take(&mut *previews()));
                Some(true)
            }
            Err(Stopped::Cancelled) => {
                let points = previews().values().sum();
                self.mailbox.keep_room(cloud, points);
                let summary = codec::Summary { points, cancelled: true, ..Default::default() };
                self.send(Event::Read { cloud, summary }).map(|()| false)
            }
            Err(Stopped::Failed(error, is_usage)) => {
                let input = paging.input.clone();
                self.send(Event::Failed { input, error, is_usage })?;
                let gone = std::mem::take(&mut *previews());
                for part in gone.into_keys() {
                    self.send(Event::Dropped { cloud, part })?;
                }
                self.mailbox.keep_room(cloud, 0);
                self.send(Event::Read { cloud, summary: codec::Summary::default() }).map(|()| false)
            }
        }
    }

    /// Normals and radii of all points of indexes of ours, where they are missing.
    fn refine_all(&self, paged: &[&Paging]) -> Option<()> {
        let mut planned = Vec::new();
        for paging in paged {
            if let Some((options, points)) = self.lacking_surfels(paging) {
                planned.push((paging, options, self.plan(paging.cloud, Making::Surfels, points)?));
            }
        }
        planned.iter().try_for_each(|(paging, options, stage)| self.refine(paging, options, stage))
    }

    /// How normals and radii of an index of ours are to be estimated, and of how many points, if they are missing.
    fn lacking_surfels(&self, paging: &Paging) -> Option<(SurfelOptions, u64)> {
        if paging.is_native || self.mailbox.is_closed(paging.cloud) {
            return None;
        }
        let pages = self.cache.as_ref().ok()?.open(&paging.sources).ok()??;
        let options = self.surfel_options(paging, &pages)?;
        (pages.surfel_options() != Some(&options)).then(|| (options, pages.octree().points()))
    }

    /// Estimates normals and radii from all points of an index; then they are streamed with it.
    fn refine(&self, paging: &Paging, options: &SurfelOptions, stage: &Stage) -> Option<()> {
        if stage.progress.is_cancelled() {
            return Some(());
        }
        let Ok(cache) = &self.cache else { return Some(()) };
        let Ok(Some(pages)) = cache.open(&paging.sources) else { return Some(()) };
        let start = Instant::now();
        let memory = half_of(self.settings.stream.host_bytes);
        let estimated = stage.run(|progress| stream::estimate_surfels(&pages, options, memory, progress));
        tracing::debug!(cloud = paging.cloud, ?options, seconds = start.elapsed().as_secs_f64(), "normals and radii");
        drop(pages);
        match estimated.and_then(|()| cache.open(&paging.sources)) {
            Ok(Some(pages)) => self.stream(paging, pages, false, HashMap::new()),
            Ok(None) | Err(stream::Error::Cancelled) => {}
            Err(stream::Error::Damaged { .. }) => self.mailbox.report_damage(paging.cloud),
            Err(error) => {
                let (input, is_usage) = (paging.input.clone(), is_of_inputs(&error));
                self.send(Event::Failed { input, error: error.to_string(), is_usage })?;
            }
        }
        Some(())
    }

    fn discard(&self, paging: &Paging) {
        if let Ok(cache) = &self.cache
            && let Ok(Some(pages)) = cache.open(&paging.sources)
        {
            cache.discard(pages);
        }
    }

    fn surfel_options(&self, paging: &Paging, pages: &Pages) -> Option<SurfelOptions> {
        let options = surfel_options(pages, paging.up, &self.settings);
        options.map_err(|error| tracing::warn!(input = paging.input, %error, "pages cannot be read")).ok()
    }
}
