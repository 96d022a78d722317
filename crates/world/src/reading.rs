//! Reads clouds that are held in memory: whole files, and built-in scenes.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use cloud::{Attribute, Bounds, Chunk, MeshPoints};
use glam::DVec3;
use scene::{SceneSettings, Settings, five_mirrors, shown};
use stream::{KeptSurfels, SurfelPlace};

use crate::budget::half_of;
use crate::chunk_key::Part;
use crate::event::{Event, Opened};
use crate::input::{Input, built_in_name, walls_name};
use crate::loader::Loader;
use crate::source::{estimate_description, is_one_file, lost_tiles, open_file, options_for, selection, up, up_of};
use crate::task::{CloudTask, TaskKind};

/// Normals and radii of fewer points are not kept: a core estimates them within a second.
const FEWEST_KEPT: u64 = 500_000;

/// The points of a mesh are the same each time.
const MESH_SEED: u64 = 1;

/// A cloud that is being read. `chunks` share their columns with those that were sent.
pub(crate) struct Loading {
    pub(crate) cloud: usize,
    pub(crate) source: Arc<codec::Source>,
    pub(crate) up: DVec3,
    pub(crate) chunks: Vec<Chunk>,
    /// The place in the cache for its normals and radii, if it was read to its end.
    pub(crate) place: Option<SurfelPlace>,
    /// Whether all chunks were sent with the normals and radii that the cache had.
    pub(crate) has_kept_surfels: bool,
    /// Whether its points were read.
    pub(crate) is_read: bool,
}

/// Whether a file is a mesh that shows points on its faces, besides its vertices.
pub fn shows_faces(source: &codec::Source, settings: &Settings) -> bool {
    source.is_mesh() && u64::from(settings.surface.mesh_points) > source.info().points
}

/// The points between the vertices of a mesh, if it shows any: a face list that cannot be parsed has none. `vertices` are
/// all chunks of the file in order.
pub fn points_on_faces(source: &codec::Source, vertices: &[Chunk], settings: &Settings) -> Option<MeshPoints> {
    if !shows_faces(source, settings) {
        return None;
    }
    let start = Instant::now();
    let count = settings.surface.mesh_points as usize;
    let points = MeshPoints::new(vertices, &source.triangles().ok()?, count, MESH_SEED);
    tracing::debug!(seconds = start.elapsed().as_secs_f64(), is_surface = points.is_some(), "points of a mesh");
    points
}

impl Loading {
    /// Whether any points lack a normal or a radius.
    fn lacks_surfels(&self) -> bool {
        let is_complete = |chunk: &Chunk| chunk.is_empty() || chunk.normals.is_some() && chunk.radii.is_some();
        !self.has_kept_surfels && !self.chunks.iter().all(is_complete)
    }
}

impl Loader {
    pub(crate) fn read_all(&self, mut opened: Vec<Loading>) -> Option<()> {
        for loading in opened.iter_mut().filter(|loading| !loading.is_read) {
            self.read(loading)?;
        }
        let mut planned = Vec::new();
        for loading in opened.into_iter().filter(Loading::lacks_surfels) {
            let points = loading.chunks.iter().map(|chunk| chunk.len() as u64).sum();
            planned.push((self.plan(loading.cloud, TaskKind::Surfels, points)?, loading));
        }
        for (task, loading) in planned {
            self.estimate(loading, &task)?;
        }
        Some(())
    }

    /// The files of an input that can be opened; `None` if the receiver is gone.
    pub(crate) fn open(&self, input: &Input) -> Option<Vec<Arc<codec::Source>>> {
        let mut sources = Vec::new();
        for path in input.files() {
            match open_file(path, half_of(self.settings.stream.host_bytes)) {
                Ok(scans) => {
                    for error in lost_tiles(&scans) {
                        self.send(Event::Failed { input: shown(path), error: error.clone(), is_usage: true })?;
                    }
                    sources.extend(scans);
                }
                Err(error) => self.send(Event::Failed { input: shown(path), error, is_usage: true })?,
            }
        }
        Some(sources)
    }

    /// Whether the files of an input are streamed. `held` is the memory in bytes of the clouds held in memory; it grows
    /// if they are not.
    pub(crate) fn is_streamed(&self, sources: &[Arc<codec::Source>], held: &mut u64) -> bool {
        if sources.iter().all(|source| source.info().points == 0) {
            return false;
        }
        let bytes: u64 = sources.iter().map(|source| self.memory_of(source.info())).sum();
        let is_streamed = match self.settings.stream.pages {
            scene::Paging::Always => true,
            scene::Paging::Never => false,
            scene::Paging::Auto => {
                // What a view does not need stays on the server.
                let is_far = |source: &Arc<codec::Source>| source.bytes().is_remote() && source.copc().is_some();
                let is_paged = |source: &Arc<codec::Source>| source.copc().is_some_and(|copc| !copc.further.is_empty());
                !is_one_file(sources)
                    || sources.iter().any(is_paged)
                    || sources.iter().all(is_far)
                    || held.saturating_add(bytes) > half_of(self.settings.stream.host_bytes)
            }
        };
        if !is_streamed {
            *held = held.saturating_add(bytes);
        }
        is_streamed
    }

    /// The memory in bytes of the points of a file.
    fn memory_of(&self, info: &codec::Info) -> u64 {
        let selection = selection(info, &self.settings);
        let columns = info.attributes.iter().zip(selection.attributes).filter(|(_, is_read)| *is_read);
        let columns: usize = columns.map(|(attribute, _)| attribute.column_type.size()).sum();
        let is_double = |property: &Attribute| property.name == "x" && property.column_type == cloud::ColumnType::F64;
        let is_exact = match info.format {
            codec::Format::Las | codec::Format::Laz | codec::Format::Ept => {
                info.grid.zip(info.bounds).is_some_and(|(grid, bounds)| !grid.fits_f32(bounds))
            }
            _ => info.properties.iter().any(is_double),
        };
        // Position, normal and radius; colour; the file's own coordinates where they are kept.
        let point = 12 + 4 + 2 + 4 * usize::from(info.has_colors) + 24 * usize::from(is_exact) + columns;
        // Points that are spread over a mesh also have the corner that they are nearest to.
        let is_spread = info.faces > 0 && u64::from(self.settings.surface.mesh_points) > info.points;
        let spread = if is_spread { u64::from(self.settings.surface.mesh_points) * (point as u64 + 4) } else { 0 };
        info.points.saturating_mul(point as u64).saturating_add(spread)
    }

    /// Announces a file that is read into memory.
    pub(crate) fn begin(&self, source: Arc<codec::Source>, cloud: usize) -> Option<Loading> {
        let info = source.info();
        let path = &info.path;
        let up = up_of(info, &self.settings);
        let opened = Opened {
            name: info.name(),
            input: shown(path),
            source: Some(source.clone()),
            files: Arc::new(source.bytes().named_file().into_iter().collect()),
            attributes: info.attributes.clone(),
            offered: info.attributes.clone(),
            grid: info.grid,
            crs: info.crs.clone(),
            units: info.units,
            expected_points: info.points,
            up,
            scanner: info.scanner(),
            provisional_radius: info.bounds.map_or(0.0, |bounds| cloud::provisional_radius(bounds, info.points)),
            warnings: info.warnings.clone(),
        };
        self.send(Event::Opened { cloud, opened })?;
        Some(Loading { cloud, source, up, chunks: Vec::new(), place: None, has_kept_surfels: false, is_read: false })
    }

    /// Sends a whole built-in scene: its walls as a cloud and its mirrors, complete with normals and radii, which are
    /// estimated if it is a made scan.
    pub(crate) fn sample(&self, variant: five_mirrors::Variant, without: &[String], clouds: &mut usize) -> Option<()> {
        let SceneSettings { points, seed } = self.settings.scene;
        let up = up(variant.camera().up, &self.settings);
        let input = built_in_name(variant);
        let mut made = None;
        for part in five_mirrors::sample(variant, u64::from(points), u64::from(seed)) {
            let points = part.chunks.iter().map(|chunk| chunk.len() as u64).sum();
            if let Some(mirror) = part.mirror {
                if !without.contains(&mirror.name) {
                    self.progress.add(points);
                    self.send(Event::Mirror { input: input.clone(), mirror, samples: part.chunks })?;
                }
                continue;
            }
            let cloud = *clouds;
            *clouds += 1;
            let name = walls_name(variant);
            let lacking = part.chunks.iter().filter(|chunk| chunk.radii.is_none());
            let lacking: Vec<Chunk> = lacking.cloned().collect();
            let bounds = lacking.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
            let provisional_radius = if lacking.is_empty() { 0.0 } else { cloud::provisional_radius(bounds, points) };
            let (input, expected_points, scanner) = (input.clone(), points, variant.scanner());
            let opened = Opened { name, input, expected_points, up, scanner, provisional_radius, ..Opened::default() };
            self.send(Event::Opened { cloud, opened })?;
            for chunk in part.chunks {
                self.progress.add(chunk.len() as u64);
                self.send(Event::Chunk { cloud, part: Part::Block(chunk.first_point), chunk })?;
            }
            let summary = codec::Summary { points, ..Default::default() };
            self.send(Event::Read { cloud, summary })?;
            made = (!lacking.is_empty()).then_some((cloud, points, lacking)).or(made);
        }
        // The mirrors are there by now.
        if let Some((cloud, points, chunks)) = made {
            let task = self.plan(cloud, TaskKind::Surfels, points)?;
            let options = options_for(&chunks, up, variant.scanner(), &self.settings);
            if let Some(surfels) = task.run(|progress| cloud::estimate(&chunks, &options, progress)) {
                self.send(Event::Surfels { cloud, surfels })?;
            }
        }
        Some(())
    }

    /// Reads a file and sends its points.
    pub(crate) fn read(&self, loading: &mut Loading) -> Option<()> {
        loading.is_read = true;
        let (source, cloud) = (&loading.source, loading.cloud);
        let place = self.place_of(loading);
        let found = place.as_ref().map_or(Ok(None), SurfelPlace::open);
        let (is_complete, is_damaged) = (AtomicBool::new(true), AtomicBool::new(found.is_err()));
        let found: Option<KeptSurfels> = found.ok().flatten();
        let chunks = Mutex::new(Vec::new());
        let total = self.progress.total();
        let is_mesh = source.is_mesh();
        let emit = |mut chunk: Chunk| {
            // The reader has set the total of its own file.
            self.progress.set_total(total);
            // Should normals and radii have to be estimated, they are estimated from what the file has.
            let columns = if is_mesh { chunk.columns.clone() } else { Vec::new() };
            chunks.lock().unwrap_or_else(PoisonError::into_inner).push(Chunk { columns, ..chunk.clone() });
            match found.as_ref().map(|kept| kept.of(&chunk)) {
                Some(Ok(surfels)) => {
                    chunk.normals = Some(Arc::new(surfels.normals));
                    chunk.radii = Some(Arc::new(surfels.radii));
                }
                Some(Err(_)) => is_damaged.store(true, Ordering::Relaxed),
                None => is_complete.store(false, Ordering::Relaxed),
            }
            if self.send(Event::Chunk { cloud, part: Part::Block(chunk.first_point), chunk }).is_none() {
                self.progress.cancel();
            }
        };
        let start = Instant::now();
        let mut read = source.read(&selection(source.info(), &self.settings), &self.progress, &emit);
        tracing::debug!(path = %source.info().path.display(), seconds = start.elapsed().as_secs_f64(), "read");
        let is_damaged = is_damaged.into_inner();
        let mut chunks = chunks.into_inner().unwrap_or_else(PoisonError::into_inner);
        chunks.sort_by_key(|chunk| chunk.first_point);
        let is_whole = read.as_ref().is_ok_and(|summary| !summary.cancelled);
        let on_faces = if is_whole { points_on_faces(source, &chunks, &self.settings) } else { None };
        if let Ok(summary) = &mut read {
            if is_damaged {
                let warning = "the normals and radii kept in the cache are damaged, and are estimated anew";
                summary.warnings.push(warning.into());
            }
            loading.place = place.filter(|_| !summary.cancelled);
        }
        loading.has_kept_surfels = is_complete.into_inner() && !is_damaged || on_faces.is_some();
        loading.chunks = chunks;
        if let Some(MeshPoints { chunks, vertices }) = on_faces {
            self.send(Event::Surfels { cloud, surfels: vertices })?;
            for chunk in chunks {
                self.send(Event::Chunk { cloud, part: Part::Block(chunk.first_point), chunk })?;
            }
        }
        self.end(loading, read)
    }

    /// The place in the cache for the normals and radii of a file, if they are worth keeping.
    fn place_of(&self, loading: &Loading) -> Option<SurfelPlace> {
        if loading.source.info().points < FEWEST_KEPT {
            return None;
        }
        let cache = self.cache.as_ref().ok()?;
        let scanner = loading.source.info().scanner();
        let description = estimate_description(loading.up, scanner, &self.settings);
        let place = SurfelPlace::new(cache, &loading.source, description);
        // A file that cannot be read is reported when its points are read.
        place.inspect_err(|error| tracing::debug!(%error, "kept normals and radii")).ok()
    }

    /// Reports how the reading of a file ended; the chunks read stay.
    pub(crate) fn end(&self, loading: &Loading, read: codec::Result<codec::Summary>) -> Option<()> {
        let cloud = loading.cloud;
        match read {
            Ok(summary) => self.send(Event::Read { cloud, summary }),
            Err(error) => {
                let input = shown(&loading.source.info().path);
                self.send(Event::Failed { input, error: error.to_string(), is_usage: true })?;
                let points = loading.chunks.iter().map(|chunk| chunk.len() as u64).sum();
                let missing = loading.source.info().points.saturating_sub(points);
                self.send(Event::Read { cloud, summary: codec::Summary { points, missing, ..Default::default() } })
            }
        }
    }

    /// Estimates normals and radii where one of them is missing; those of the file are kept.
    fn estimate(&self, loading: Loading, task: &CloudTask) -> Option<()> {
        let Loading { cloud, source, up, mut chunks, place, .. } = loading;
        if task.progress.is_cancelled() {
            return Some(());
        }
        // A face list that cannot be parsed is a warning of the read; the normals are then estimated.
        if source.info().faces > 0
            && !source.info().has_normals
            && let Ok(triangles) = source.triangles()
        {
            let mesh = cloud::normals_from_triangles(&chunks, &triangles);
            for (chunk, normals) in chunks.iter_mut().zip(mesh.normals) {
                chunk.normals = Some(Arc::new(normals));
            }
        }
        let options = options_for(&chunks, up, source.info().scanner(), &self.settings);
        let start = Instant::now();
        let estimated = task.run(|progress| cloud::estimate(&chunks, &options, progress));
        tracing::debug!(cloud, ?options, seconds = start.elapsed().as_secs_f64(), "normals and radii");
        let Some(surfels) = estimated else { return Some(()) };
        let kept = place.map(|place| (place, surfels.clone()));
        self.send(Event::Surfels { cloud, surfels })?;
        if let Some((place, surfels)) = kept {
            // Without them the next opening takes longer, and shows the same.
            let written = place.keep(&chunks, &surfels);
            let _ = written.inspect_err(|error| tracing::debug!(%error, "normals and radii are not kept"));
        }
        Some(())
    }
}
