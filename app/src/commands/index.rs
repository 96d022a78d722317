//! `glint index`: makes the indexes of large clouds ahead of time, so that nobody has to wait for them in the viewer.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::Context as _;
use cloud::Progress;
use scene::Settings;
use stream::{BuildOptions, Cache};
use world::{CloudTask, Input, TaskKind, half_of};

use crate::commands::recording;
use crate::shared::command_line::IndexArguments;
use crate::shared::export;
use crate::shared::numbers::grouped;
use crate::system::failure::{self, FAILED, UNUSABLE, usage};
use crate::system::terminal::{self, Few, print};
use crate::system::{interrupt, picture_file, progress_bar};

/// Makes the indexes. Returns exit status 2 if one of several inputs, a tile of one or points for a file could not be read.
///
/// # Errors
/// Fails on bad usage, on Ctrl-C, if the only cloud cannot be indexed, or if the output cannot be written.
pub fn run(arguments: &IndexArguments) -> anyhow::Result<u8> {
    if let Some(output) = &arguments.output {
        let name = output.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        if arguments.catalogue && !name.ends_with(".vpc") {
            return Err(usage(format!("{}: the name of a catalogue must end in .vpc", scene::shown(output))));
        }
        if !arguments.catalogue && !name.ends_with(".copc.laz") {
            return Err(usage(format!(
                "{}: the name must end in .copc.laz, which is what will be in it; without -o the index goes into the cache",
                scene::shown(output)
            )));
        }
        picture_file::check_place(output)?;
    }
    let mut request = world::resolve(&arguments.inputs);
    request.check()?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    recording::settings(&mut request).clone_from(&settings);
    let (own, mirrors) = (&request.cloud_settings, &request.mirror_points);
    let asked = world::asked_attributes(&settings, &request.visibility, own, mirrors);
    let cache = world::cache(&settings.stream)?.keeping(asked);
    terminal::warn(&request.warnings);
    terminal::warn(request.check_filters(&settings)?);
    terminal::warn(request.settings_without_cloud(half_of(settings.stream.host_bytes)));
    let mut unreadable = Few::of("that cannot be read");
    let mut clouds = Vec::new();
    for input in &request.inputs {
        let sources = open(input, half_of(settings.stream.host_bytes), &mut unreadable);
        if !sources.is_empty() {
            clouds.push((input.name(), sources));
        }
    }
    let mut status = if unreadable.count() > 0 { UNUSABLE } else { 0 };
    unreadable.end();
    if clouds.is_empty() {
        return Ok(UNUSABLE);
    }
    match &arguments.output {
        Some(output) => {
            let sources: Vec<Arc<codec::Source>> = clouds.into_iter().flat_map(|(_, sources)| sources).collect();
            if arguments.catalogue {
                write_catalogue(&sources, output)?;
            } else {
                let missing = write(&sources, &settings, output)?;
                if let Some(lack) = export::lack(output, missing) {
                    terminal::complain(&lack);
                    status = UNUSABLE;
                }
            }
        }
        None => {
            let task = Task { cache: &cache, settings: &settings };
            for (place, (name, sources)) in clouds.iter().enumerate() {
                let place = if clouds.len() > 1 { format!(" {}/{}", place + 1, clouds.len()) } else { String::new() };
                if let Err(error) = task.index(name, sources, &place) {
                    if clouds.len() == 1 || interrupt::is_wanted() {
                        return Err(error);
                    }
                    // Failed work (status 1) outranks unusable inputs (status 2).
                    status =
                        if failure::exit_status(&error) == UNUSABLE && status != FAILED { UNUSABLE } else { FAILED };
                    terminal::complain(&format!("{name}: {error:#}"));
                }
            }
        }
    }
    Ok(status)
}

/// Writes a catalogue of files, each of which is a tile with all of its scans.
fn write_catalogue(sources: &[Arc<codec::Source>], output: &Path) -> anyhow::Result<()> {
    let mut tiles: Vec<codec::CatalogueTile<'_>> = Vec::new();
    for source in sources {
        let info = source.info();
        let Some(bounds) = codec::bounds_of(source, &Progress::default())? else {
            terminal::warn([format!("{}: no points, so the catalogue leaves it out", scene::shown(&info.path))]);
            continue;
        };
        interrupt::check()?;
        match tiles.last_mut().filter(|last| last.info.path == info.path) {
            Some(last) => (last.points, last.bounds) = (last.points + info.points, last.bounds.union(bounds)),
            None => tiles.push(codec::CatalogueTile { info, points: info.points, bounds }),
        }
    }
    let warnings = codec::write_catalogue(&tiles, output)?;
    terminal::warn(warnings.iter().map(|warning| format!("{}: {warning}", scene::shown(output))));
    print([format!("{}: {} tiles", scene::shown(output), tiles.len())])?;
    Ok(())
}

/// Opens the files of an input, and reports those that cannot be opened.
fn open(input: &Input, memory: u64, unreadable: &mut Few) -> Vec<Arc<codec::Source>> {
    let mut sources = Vec::new();
    let mut fail = |error: String| unreadable.complain(&error);
    for path in input.files() {
        match world::open_file(path, memory) {
            Ok(scans) => {
                world::lost_tiles(&scans).for_each(|error| fail(error.clone()));
                sources.extend(scans);
            }
            Err(error) => fail(error),
        }
    }
    match input {
        Input::BuiltIn { .. } => fail(format!("{}: a built-in scene, not a file; it needs no index", input.name())),
        Input::Unknown { error, .. } => fail(error.clone()),
        Input::File(_) | Input::Tiles { .. } => {}
    }
    sources
}

/// The time that a piece of work took.
struct Effort {
    seconds: f64,
    /// CPU time of all threads, where the system reports it.
    cpu_seconds: Option<f64>,
}

impl Effort {
    fn of<Result>(work: impl FnOnce() -> Result) -> (Self, Result) {
        let (start, cpu) = (Instant::now(), cpu_seconds());
        let result = work();
        let cpu_seconds = cpu_seconds().zip(cpu).map(|(now, before)| now - before);
        (Self { seconds: start.elapsed().as_secs_f64(), cpu_seconds }, result)
    }

    /// For example `5.2 s, 3.10 M points per CPU-second`.
    fn text(&self, points: u64) -> String {
        let rate = self.cpu_seconds.filter(|seconds| *seconds > 0.0).map(|seconds| points as f64 / seconds / 1e6);
        let rate = rate.map(|rate| format!(", {rate:.2} M points per CPU-second")).unwrap_or_default();
        format!("{:.1} s{rate}", self.seconds)
    }
}

/// Makes indexes in the cache.
struct Task<'a> {
    cache: &'a Cache,
    settings: &'a Settings,
}

impl Task<'_> {
    /// Makes the index of a cloud in the cache, with normals and radii. If an index that is already there turns out to
    /// be damaged, makes it again. `place` shows the user which of several clouds this is.
    fn index(&self, name: &str, sources: &[Arc<codec::Source>], place: &str) -> anyhow::Result<()> {
        match self.index_once(name, sources, place) {
            Err(error) if matches!(error.downcast_ref(), Some(stream::Error::Damaged { .. })) => {
                terminal::warn([format!("{error}: its index is made again")]);
                if let Some(pages) = self.cache.open(sources)? {
                    self.cache.discard(pages);
                }
                self.index_once(name, sources, place)
            }
            result => result,
        }
    }

    fn index_once(&self, name: &str, sources: &[Arc<codec::Source>], place: &str) -> anyhow::Result<()> {
        let of_files: Vec<String> = sources.iter().flat_map(|source| world::file_warnings(source.info())).collect();
        terminal::warn(param::few(of_files.clone(), "warnings"));
        let parts = world::parts(sources.to_vec(), &BTreeSet::new());
        if parts.iter().all(|(_, native)| native.is_some()) {
            return print([format!("{name}: COPC, which needs no index")]);
        }
        let memory = half_of(self.settings.stream.host_bytes);
        let options = BuildOptions { memory, preview_points: 0 };
        let expected = sources.iter().map(|source| source.info().points).sum();
        let build = |progress: &Progress| stream::build(sources, self.cache, &options, progress, &|_| {});
        let (task, effort, pages) = self.make(CloudTask::new(TaskKind::Index, expected), place, build);
        let pages = pages?;
        let further = pages.warnings().iter().filter(|warning| !of_files.contains(warning));
        terminal::warn(param::few(further.map(|warning| format!("{name}: {warning}")).collect(), "warnings"));
        let up = sources.first().map_or(glam::DVec3::Z, |source| world::up_of(source.info(), self.settings));
        let options = world::surfel_options(&pages, up, world::common_scanner(sources), self.settings)?;
        let points = pages.octree().points();
        let estimate = |progress: &Progress| stream::estimate_surfels(&pages, &options, memory, progress);
        let (_, normals, estimated) = self.make(CloudTask::new(TaskKind::Surfels, points), place, estimate);
        estimated?;
        let what = summary(name, points, pages.octree().nodes.len(), pages.bytes());
        // Another program may have made it while this one waited.
        let effort = if task.progress.done() == 0 { "was there".to_owned() } else { effort.text(points) };
        let folder = scene::shown(pages.folder());
        print([format!("{what}, {effort}; normals and radii {:.1} s; {folder}", normals.seconds)])
    }

    /// Runs the work of a task and shows its progress.
    fn make<Result>(
        &self,
        task: CloudTask,
        place: &str,
        work: impl FnOnce(&Progress) -> Result,
    ) -> (CloudTask, Effort, Result) {
        let (effort, result) = Effort::of(|| progress_bar::watch_task(&task, place, work));
        (task, effort, result)
    }
}

/// Writes all files as one cloud, as COPC. Returns the number of points that cannot be read.
fn write(sources: &[Arc<codec::Source>], settings: &Settings, output: &Path) -> anyhow::Result<u64> {
    let paths: Vec<PathBuf> = sources.iter().map(|source| source.info().path.clone()).collect();
    let memory = half_of(settings.stream.host_bytes);
    let progress = Progress::default();
    let write = || codec::write_copc(&paths, output, memory, &progress);
    let (effort, written) = Effort::of(|| progress_bar::watch("writing", &progress, write));
    let codec::CopcSummary { points, missing, nodes, changes, warnings } = written?.ok_or(stream::Error::Cancelled)?;
    let name = scene::shown(output);
    let lines = changes.into_iter().chain(param::few(warnings, "warnings"));
    terminal::warn(lines.map(|warning| format!("{name}: {warning}")));
    let bytes = std::fs::metadata(output).map_or(0, |metadata| metadata.len());
    print([format!("{}, {}", summary(&name, points, nodes, bytes), effort.text(points))])?;
    Ok(missing)
}

/// For example `scan.laz: 10,653,336 points in 412 nodes, 17.9 bytes a point`.
fn summary(name: &str, points: u64, nodes: usize, bytes: u64) -> String {
    let per_point = bytes as f64 / points.max(1) as f64;
    format!("{name}: {} points in {} nodes, {per_point:.1} bytes a point", grouped(points), grouped(nodes as u64))
}

/// The CPU time that this process has used so far, in seconds, where the system reports it (Linux).
fn cpu_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    // proc(5): the name of the process stands in brackets and may hold spaces. Fields 14 and 15 are user and system
    // time, in hundredths of a second.
    let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |field: usize| fields.get(field - 3)?.parse::<f64>().ok();
    Some((ticks(14)? + ticks(15)?) / 100.0)
}
