//! From words on the command line to points in memory, the same way for the window, the picture file and `glint info`.
//!
//! `resolve` tells what each word names. `start` opens and reads it on a thread of its own and hands events over as they
//! come: first every header, then chunks, and when all clouds are in, the normals and radii that were missing. The channel
//! is bounded, so a slow receiver holds the readers back and memory stays what the receiver keeps.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use cloud::{Attribute, Bounds, Chunk, Column, Grid, Orientation, Progress, SurfelOptions, Surfels};
use glam::DVec3;
use scene::{
    ColorBy, Mirror, MirrorPoints, SceneFile, SceneSettings, Settings, SpotLight, SurfaceOrientation, UpAxis, View,
    five_mirrors,
};
use stream::{BuildOptions, Cache, Pages};

use crate::failure::usage;
use crate::stage::{Making, Stage};
use crate::streaming::{Arrival, Director, Lookout, Paged, StreamStats, Wish, cache, half_of, most_preview_points};

/// Chunks on their way from the readers to the receiver: enough that neither waits for the other, and at 65 thousand
/// points of some 30 bytes each no more than 32 MB.
const CHUNKS_UNDER_WAY: usize = 16;

/// What a person named.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    File(PathBuf),
    /// A folder with several files that are one cloud.
    Tiles {
        folder: PathBuf,
        /// In the order of their names.
        files: Vec<PathBuf>,
    },
    BuiltIn {
        variant: five_mirrors::Variant,
        /// Names of its mirrors that are left out: others have taken their places.
        without: Vec<String>,
    },
    /// A word that names nothing, or a scene file that cannot be read. It keeps its place, and fails when it is loaded.
    Unknown {
        name: String,
        error: String,
    },
}

impl Input {
    /// As a person would type it.
    pub fn name(&self) -> String {
        match self {
            Self::File(path) | Self::Tiles { folder: path, .. } => path.display().to_string(),
            Self::BuiltIn { variant, .. } => built_in_name(*variant),
            Self::Unknown { name, .. } => name.clone(),
        }
    }

    /// The files that are read.
    pub fn files(&self) -> &[PathBuf] {
        match self {
            Self::File(path) => std::slice::from_ref(path),
            Self::Tiles { files, .. } => files,
            Self::BuiltIn { .. } | Self::Unknown { .. } => &[],
        }
    }
}

/// All words of a command line together.
#[derive(Clone, Debug, Default)]
pub struct Request {
    pub inputs: Vec<Input>,
    /// Camera and parameters of the scene file, or the camera of a built-in scene that is shown alone.
    pub view: Option<View>,
    /// Of scene files; built-in scenes bring theirs when they are loaded.
    pub mirrors: Vec<Mirror>,
    pub mirror_points: Vec<MirrorPoints>,
    /// Of scene files.
    pub lights: Vec<SpotLight>,
    pub warnings: Vec<String>,
}

impl Request {
    /// # Errors
    /// If words were given and none of them names anything; a line for each.
    pub fn check(&self) -> anyhow::Result<()> {
        let errors: Vec<&str> = self
            .inputs
            .iter()
            .filter_map(|input| if let Input::Unknown { error, .. } = input { Some(error.as_str()) } else { None })
            .collect();
        if errors.is_empty() || errors.len() < self.inputs.len() { Ok(()) } else { Err(usage(errors.join("\n"))) }
    }

    /// The built-in scene that this is, with its own mirrors and nothing beside it.
    pub fn built_in(&self) -> Option<five_mirrors::Variant> {
        let is_changed = !self.mirrors.is_empty() || !self.mirror_points.is_empty();
        match self.inputs.as_slice() {
            [Input::BuiltIn { variant, without }] if !is_changed && without.is_empty() => Some(*variant),
            _ => None,
        }
    }

    /// The light that a built-in scene brings; lights of scene files take its place.
    pub fn built_in_light(&self) -> Option<SpotLight> {
        let is_built_in = |input: &Input| matches!(input, Input::BuiltIn { .. });
        (self.lights.is_empty() && self.inputs.iter().any(is_built_in)).then(five_mirrors::light)
    }

    /// Takes in what a view brings to the scene that it is of: its lights take the place of all, its mirrors and marked points
    /// that of the same ones.
    pub fn refurnish(&mut self, file: &SceneFile) {
        if !file.lights.is_empty() {
            self.lights.clear();
        }
        let is_same = |a: &Mirror, b: &Mirror| a == b || (!a.name.is_empty() && a.name == b.name);
        self.mirrors.retain(|known| !file.mirrors.iter().any(|mirror| is_same(known, mirror)));
        self.mirror_points.retain(|known| !file.mirror_points.contains(known));
        self.furnish(file);
    }

    /// Takes in the mirrors and lights of a scene file.
    pub fn furnish(&mut self, file: &SceneFile) {
        self.mirrors.extend(file.mirrors.iter().cloned());
        self.mirror_points.extend(file.mirror_points.iter().cloned());
        self.lights.extend(file.lights.iter().copied());
        for input in &mut self.inputs {
            if let Input::BuiltIn { without, .. } = input {
                without.extend(file.mirrors.iter().map(|mirror| mirror.name.clone()));
            }
        }
    }
}

/// Finds out what each word names: a scene file (`.toml`, replaced by its clouds), a built-in scene, or else a cloud file.
/// A word that names nothing becomes `Input::Unknown`, with the name that may have been meant: the others count.
pub fn resolve(words: &[String]) -> Request {
    let mut request = Request::default();
    let mut files = Vec::new();
    for word in words {
        if Path::new(word).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
            let file = match SceneFile::read(Path::new(word)) {
                Ok(file) => file,
                Err(error) => {
                    request.inputs.push(Input::Unknown { name: word.clone(), error: error.to_string() });
                    continue;
                }
            };
            request.inputs.extend(file.clouds.iter().map(|cloud| match input(cloud) {
                Ok(input) => input,
                Err(error) => Input::Unknown { name: cloud.clone(), error: format!("{word}: {error}") },
            }));
            let view = file.view();
            files.push(file);
            request.warnings.extend(view.warnings.iter().map(|warning| format!("{word}: {warning}")));
            if request.view.replace(view).is_some() {
                request
                    .warnings
                    .push(format!("{word}: its camera and parameters replace those of the scene before it"));
            }
        } else {
            let named = input(word).unwrap_or_else(|error| Input::Unknown { name: word.clone(), error });
            request.inputs.push(named);
        }
    }
    files.iter().for_each(|file| request.furnish(file));
    let is_built_in = |input: &Input| matches!(input, Input::BuiltIn { .. });
    let built_in_alone = !request.inputs.is_empty() && request.inputs.iter().all(is_built_in);
    if built_in_alone {
        let camera = five_mirrors::camera();
        let view = request.view.get_or_insert_with(|| View {
            camera: None,
            settings: Settings::default(),
            warnings: Vec::new(),
        });
        view.camera.get_or_insert(camera);
    }
    request
}

/// The file or built-in scene that `word` names, or what to say.
fn input(word: &str) -> Result<Input, String> {
    if let Some(mirror) = five_mirrors::Variant::ALL.into_iter().find(|mirror| built_in_name(*mirror) == word) {
        return Ok(Input::BuiltIn { variant: mirror, without: Vec::new() });
    }
    let path = Path::new(word);
    if path.is_dir() {
        return tiles(path).map_err(|problem| format!("{word}: {problem}"));
    }
    if path.exists() {
        return Ok(Input::File(path.to_owned()));
    }
    // Compared by their last part: a typing error in a short name must not drown in a long folder's.
    let last = |name: &str| Path::new(name).file_name().unwrap_or_default().to_string_lossy().into_owned();
    let known: BTreeMap<String, String> =
        files_beside(path).into_iter().chain(built_in_names()).map(|name| (last(&name), name)).collect();
    let near = param::nearest(&last(word), known.keys().map(String::as_str)).and_then(|near| known.get(near));
    let hint = match near {
        Some(near) => format!("; did you mean `{near}`?"),
        None if word.starts_with("five-mirrors") => "; `glint scenes` lists the built-in scenes".into(),
        None => String::new(),
    };
    Err(format!("{word}: no such file or built-in scene{hint}"))
}

/// The clouds in a folder, or what is wrong with it.
fn tiles(folder: &Path) -> Result<Input, String> {
    let is_cloud = |path: &PathBuf| {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        ["las", "laz", "ply"].iter().any(|known| extension.eq_ignore_ascii_case(known)) && path.is_file()
    };
    let entries = std::fs::read_dir(folder).map_err(|error| error.to_string())?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_cloud).collect();
    files.sort();
    match files.as_slice() {
        [] => Err("a folder without .las, .laz and .ply files".into()),
        [one] => Ok(Input::File(one.clone())),
        _ => Ok(Input::Tiles { folder: folder.to_owned(), files }),
    }
}

/// Files in the folder where `path` was looked for, written as `path` is.
fn files_beside(path: &Path) -> Vec<String> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(listed).into_iter().flatten().flatten();
    entries.map(|entry| folder.join(entry.file_name()).to_string_lossy().into_owned()).collect()
}

pub fn built_in_name(mirror: five_mirrors::Variant) -> String {
    format!("five-mirrors/{}", mirror.name())
}

pub fn built_in_names() -> Vec<String> {
    five_mirrors::Variant::ALL.into_iter().map(built_in_name).collect()
}

/// A cloud on its way in. `cloud` counts from 0 within the job.
pub enum Event {
    /// A header was read, or a built-in scene begun.
    Opened {
        cloud: usize,
        name: String,
        /// As on the command line or in the scene file.
        input: String,
        source: Option<Arc<codec::Source>>,
        attributes: Vec<Attribute>,
        grid: Option<Grid>,
        /// Points a full read should yield.
        expected_points: u64,
        /// Unit vector.
        up: DVec3,
        /// World units, for points whose radius is not known yet; 0 where not even the extent is known.
        provisional_radius: f32,
        warnings: Vec<String>,
    },
    /// Some of its points. Of a streamed cloud (`Pages`) it may take the place of the chunk with the same first point.
    Chunk { cloud: usize, chunk: Chunk },
    /// The cloud is streamed: its chunks are those of its points that the last look needs, and come and go. Follows `Opened`,
    /// and comes again when more is known.
    Pages { cloud: usize, pages: Paged },
    /// Something is or will be made for the cloud, in the place of what was made for it before.
    Stage { cloud: usize, stage: Arc<Stage> },
    /// The chunk with that first point is no more needed.
    Dropped { cloud: usize, first_point: u64 },
    /// What is there of all streamed clouds, whenever that changes, a few times a second at most.
    Stream(StreamStats),
    /// A mirror of a built-in scene, and the points that stand for it.
    Mirror { input: String, mirror: Mirror, samples: Vec<Chunk> },
    /// All chunks of the cloud that will come have been sent; of a streamed one, all that the first look needs.
    Read { cloud: usize, summary: codec::Summary },
    /// Normals and radii that the file lacks, one per chunk in the order of `first_point`.
    Surfels { cloud: usize, surfels: Vec<Surfels> },
    /// An input, or what is left of it, cannot be read; the others go on.
    Failed { input: String, error: String },
    /// The last event; where clouds are streamed, it comes when they are closed. A channel that closes without it means that the loading thread died.
    Finished,
}

/// Loading under way. Dropping it stops it.
pub struct Job {
    pub events: Receiver<Event>,
    /// Points read, of all inputs that are held in memory. Cancelling it ends the reading; what has been sent stays and gets its
    /// surfels.
    pub progress: Arc<Progress>,
    /// Where to tell from where streamed clouds are looked at, and what is not to be made.
    pub lookout: Arc<Lookout>,
}

impl Drop for Job {
    fn drop(&mut self) {
        self.lookout.end();
        self.progress.cancel();
    }
}

/// Loads `inputs` on a background thread. Of `settings` the groups `view` (up axis, point budget), `color` (which attribute to read),
/// `stream`, `surface` and `scene` matter.
pub fn start(inputs: Vec<Input>, settings: &Settings) -> Job {
    start_with(inputs, settings, true, cache(&settings.stream))
}

/// The same without a preview of clouds whose index is being made, where nobody would see it.
pub fn start_unseen(inputs: Vec<Input>, settings: &Settings) -> Job {
    start_with(inputs, settings, false, cache(&settings.stream))
}

/// `cache`: where indexes are kept.
fn start_with(inputs: Vec<Input>, settings: &Settings, has_preview: bool, cache: anyhow::Result<Cache>) -> Job {
    let (sender, events) = sync_channel(CHUNKS_UNDER_WAY);
    let progress = Arc::new(Progress::default());
    let lookout = Arc::new(Lookout::default());
    let job = Job { events, progress: progress.clone(), lookout: lookout.clone() };
    let (sender_of_loader, settings) = (sender.clone(), settings.clone());
    let cache = cache.map_err(|error| error.to_string());
    let loader = Loader { sender: sender_of_loader, progress, lookout, settings, has_preview, cache };
    // A pool of its own: readers that wait for room in the channel must not keep the receiver's parallel work waiting.
    let started = rayon::ThreadPoolBuilder::new()
        .thread_name(|index| format!("loader {index}"))
        .build()
        .map_err(|error| error.to_string())
        .and_then(|pool| {
            let work = move || pool.install(|| loader.load(&inputs));
            std::thread::Builder::new().name("loading".into()).spawn(work).map_err(|error| error.to_string())
        });
    if let Err(error) = started {
        // There is room for both: nothing else has been sent.
        let _ = sender.try_send(Event::Failed { input: "loading".into(), error });
        let _ = sender.try_send(Event::Finished);
    }
    job
}

/// Reads one column of a file whose points are loaded, by `first_point` of the chunks they belong to.
///
/// # Errors
/// If the file has gone or changed.
pub fn read_column(
    source: &codec::Source,
    attribute: usize,
    progress: &Progress,
) -> codec::Result<BTreeMap<u64, Arc<Column>>> {
    let mut wanted = vec![false; attribute + 1];
    wanted[attribute] = true;
    let selection = codec::Selection { attributes: wanted, ..Default::default() };
    let columns = Mutex::new(BTreeMap::new());
    source.read(&selection, progress, &|mut chunk| {
        if let Some(column) = chunk.columns.get_mut(attribute).and_then(Option::take) {
            columns.lock().unwrap_or_else(PoisonError::into_inner).insert(chunk.first_point, column);
        }
    })?;
    Ok(columns.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// The state of a loading thread. Where a send fails the job was dropped, and the thread ends.
struct Loader {
    sender: SyncSender<Event>,
    progress: Arc<Progress>,
    lookout: Arc<Lookout>,
    settings: Settings,
    has_preview: bool,
    /// Or why there is none.
    cache: Result<Cache, String>,
}

/// A cloud between its events. `chunks` share their columns with those that were sent.
struct Loading {
    cloud: usize,
    source: Arc<codec::Source>,
    up: DVec3,
    chunks: Vec<Chunk>,
}

impl Loading {
    /// There are points without a normal or a radius.
    fn lacks_surfels(&self) -> bool {
        let is_complete = |chunk: &Chunk| chunk.is_empty() || chunk.normals.is_some() && chunk.radii.is_some();
        !self.chunks.iter().all(is_complete)
    }
}

/// A streamed cloud while its pages are found or made.
struct Paging {
    cloud: usize,
    input: String,
    sources: Vec<Arc<codec::Source>>,
    up: DVec3,
    /// Found in the file or in the cache; handed on.
    found: Option<Pages>,
    is_native: bool,
    /// Points of chunks that are shown while there is no index, by the first of them.
    previews: Mutex<HashMap<u64, u64>>,
}

/// From here on chunks of previews are counted: no file has as many points.
const PREVIEW_POINTS: u64 = 1 << 62;

/// Points that are read to see what kind of cloud it is.
const KIND_POINTS: u64 = 500_000;

/// Part of the memory for building that goes into a preview, and bytes that a point of it takes: as a chunk and on the GPU, which
/// may have no memory of its own.
const PREVIEW_SHARE: u64 = 8;
const PREVIEW_POINT_BYTES: u64 = 80;

impl Loader {
    fn load(&self, inputs: &[Input]) {
        let _ = self.load_all(inputs);
        let _ = self.sender.send(Event::Finished);
    }

    fn load_all(&self, inputs: &[Input]) -> Option<()> {
        let (mut opened, mut paged) = (Vec::new(), Vec::new());
        // Clouds so far, and bytes of those that are to be held in memory.
        let (mut clouds, mut held) = (0, 0);
        for input in inputs {
            match input {
                Input::File(_) | Input::Tiles { .. } => {
                    let sources = self.open(input)?;
                    if self.is_streamed(&sources, &mut held) {
                        for (sources, native) in parts(sources) {
                            paged.push(self.begin_paging(input, sources, native, clouds)?);
                            clouds += 1;
                        }
                    } else {
                        for source in sources {
                            opened.push(self.begin(source, clouds)?);
                            clouds += 1;
                        }
                    }
                }
                Input::BuiltIn { variant, without } => self.sample(*variant, without, &mut clouds)?,
                Input::Unknown { name, error } => {
                    self.send(Event::Failed { input: name.clone(), error: error.clone() })?;
                }
            }
        }
        let expected = opened.iter().map(|loading| loading.source.info().points);
        self.progress.set_total(self.progress.done() + expected.sum::<u64>());
        if paged.is_empty() {
            return self.read_all(opened);
        }
        let stopped = |error: std::io::Error| Event::Failed { input: "streaming".into(), error: error.to_string() };
        let director = match Director::new(self.lookout.clone(), self.sender.clone(), &self.settings) {
            Ok(director) => director,
            Err(error) => return self.send(stopped(error)),
        };
        std::thread::scope(|scope| {
            let thread = std::thread::Builder::new().name("streaming".into());
            if let Err(error) = thread.spawn_scoped(scope, || director.run()) {
                return self.send(stopped(error));
            }
            let done = self.page_all(paged, opened);
            self.lookout.end();
            done
        })
    }

    fn read_all(&self, mut opened: Vec<Loading>) -> Option<()> {
        for loading in &mut opened {
            self.read(loading)?;
        }
        let mut planned = Vec::new();
        for loading in opened.into_iter().filter(Loading::lacks_surfels) {
            let points = loading.chunks.iter().map(|chunk| chunk.len() as u64).sum();
            planned.push((self.plan(loading.cloud, Making::Surfels, points)?, loading));
        }
        for (stage, loading) in planned {
            self.estimate(loading, &stage)?;
        }
        Some(())
    }

    /// Announces what will be made for a cloud.
    fn plan(&self, cloud: usize, making: Making, points: u64) -> Option<Arc<Stage>> {
        let stage = self.lookout.plan(cloud, Stage::new(making, points));
        self.send(Event::Stage { cloud, stage: stage.clone() })?;
        Some(stage)
    }

    /// Streams what is there at once, reads what is held in memory, makes indexes that are missing, and stays to make those again
    /// that turn out to be damaged, and those after all that were stopped.
    fn page_all(&self, mut paged: Vec<Paging>, opened: Vec<Loading>) -> Option<()> {
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
        missing.iter().for_each(|(paging, _)| self.lookout.keep_room(paging.cloud, preview_points));
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
            for wish in self.lookout.rest()? {
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
                        self.send(Event::Failed { input: paging.input.clone(), error })?;
                        false
                    }
                };
                if is_kept {
                    self.refine_all(&[paging])?;
                } else {
                    self.lookout.close(cloud);
                    open.retain(|paging| paging.cloud != cloud);
                }
            }
        }
        Some(())
    }

    /// Makes the index of a cloud if that was stopped; false if there will never be one.
    fn resume(&self, paging: &Paging, preview_points: u64) -> Option<bool> {
        if self.lookout.stage(paging.cloud).is_none_or(|stopped| stopped.making != Making::Index) {
            return Some(true);
        }
        let stage = self.plan_index(paging)?;
        Some(self.index(paging, &stage, preview_points)? || stage.progress.is_cancelled())
    }

    /// The files of an input that can be opened; `None` if nobody listens any more.
    fn open(&self, input: &Input) -> Option<Vec<Arc<codec::Source>>> {
        let mut sources = Vec::new();
        for path in input.files() {
            match open_file(path) {
                Ok(source) => sources.push(source),
                Err(error) => self.send(Event::Failed { input: path.display().to_string(), error })?,
            }
        }
        Some(sources)
    }

    /// Whether the files of an input are streamed. `held`: bytes of what is held in memory, which grow if they are not.
    fn is_streamed(&self, sources: &[Arc<codec::Source>], held: &mut u64) -> bool {
        if sources.iter().all(|source| source.info().points == 0) {
            return false;
        }
        let bytes: u64 = sources.iter().map(|source| self.memory_of(source.info())).sum();
        let is_streamed = match self.settings.stream.pages {
            scene::Paging::Always => true,
            scene::Paging::Never => false,
            scene::Paging::Auto => {
                sources.len() > 1 || held.saturating_add(bytes) > half_of(self.settings.stream.host_bytes)
            }
        };
        if !is_streamed {
            *held = held.saturating_add(bytes);
        }
        is_streamed
    }

    /// Bytes that the points of a file take in memory.
    fn memory_of(&self, info: &codec::Info) -> u64 {
        let selection = selection(info, &self.settings);
        let columns = info.attributes.iter().zip(selection.attributes).filter(|(_, is_read)| *is_read);
        let columns: usize = columns.map(|(attribute, _)| attribute.column_type.size()).sum();
        let is_double = |property: &Attribute| property.name == "x" && property.column_type == cloud::ColumnType::F64;
        let is_exact = match info.format {
            codec::Format::Ply => info.properties.iter().any(is_double),
            _ => info.grid.zip(info.bounds).is_some_and(|(grid, bounds)| !grid.fits_f32(bounds)),
        };
        // Position, normal and radius; colour; the file's own coordinates where they are kept.
        let point = 12 + 4 + 2 + 4 * usize::from(info.has_colors) + 24 * usize::from(is_exact) + columns;
        info.points.saturating_mul(point as u64)
    }

    /// A file that is read into memory.
    fn begin(&self, source: Arc<codec::Source>, cloud: usize) -> Option<Loading> {
        let info = source.info();
        let path = &info.path;
        let up = up_of(info, &self.settings);
        self.send(Event::Opened {
            cloud,
            name: file_name(path),
            input: path.display().to_string(),
            source: Some(source.clone()),
            attributes: info.attributes.clone(),
            grid: info.grid,
            expected_points: info.points,
            up,
            provisional_radius: info.bounds.map_or(0.0, |bounds| cloud::provisional_radius(bounds, info.points)),
            warnings: info.warnings.clone(),
        })?;
        Some(Loading { cloud, source, up, chunks: Vec::new() })
    }

    /// Files that are streamed as one cloud.
    fn begin_paging(
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
        self.send(Event::Opened {
            cloud,
            name: file_name(&path),
            input: path.display().to_string(),
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
        })?;
        let input = path.display().to_string();
        Some(Paging { cloud, input, sources, up, found, is_native, previews: Mutex::default() })
    }

    /// Has pages streamed. Where they lack normals and radii and will not get them, each node's are estimated from its own points.
    fn stream(&self, paging: &Paging, pages: Pages, was_built: bool, previews: HashMap<u64, u64>) {
        let estimate = paging.is_native.then(|| self.surfel_options(paging, &pages)).flatten();
        let (cloud, input, pages) = (paging.cloud, paging.input.clone(), Arc::new(pages));
        self.lookout.arrive(Arrival { cloud, input, pages, is_own: !paging.is_native, was_built, estimate, previews });
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
        self.lookout.keep_room(cloud, preview_points + shown);
        let first = previews().iter().map(|(first, points)| first + points).max().unwrap_or(PREVIEW_POINTS);
        let old: Vec<u64> = if preview_points > 0 { previews().keys().copied().collect() } else { Vec::new() };
        let old = Mutex::new(old);
        let counted = AtomicU64::new(first);
        let preview = |mut chunk: Chunk| {
            self.lookout.give_way();
            let points = chunk.len() as u64;
            chunk.first_point = counted.fetch_add(points, Ordering::Relaxed);
            previews().insert(chunk.first_point, points);
            let is_as_large = chunk.first_point + points - first >= shown;
            let mut sent = self.send(Event::Chunk { cloud, chunk });
            if is_as_large {
                for first_point in std::mem::take(&mut *old.lock().unwrap_or_else(PoisonError::into_inner)) {
                    previews().remove(&first_point);
                    sent = sent.and_then(|()| self.send(Event::Dropped { cloud, first_point }));
                }
            }
            if sent.is_none() {
                stage.progress.cancel();
            }
        };
        let start = Instant::now();
        let options = BuildOptions { memory, preview_points };
        let built = self.cache.as_ref().map_err(|error| anyhow::Error::msg(error.clone())).and_then(|cache| {
            let build = |progress: &Progress| stream::build(&paging.sources, cache, &options, progress, &preview);
            let is_stopped = stage.progress.is_cancelled();
            Ok(if is_stopped { Err(stream::Error::Cancelled) } else { stage.run(build) }?)
        });
        tracing::debug!(input = paging.input, seconds = start.elapsed().as_secs_f64(), "indexed");
        match built {
            Ok(pages) => {
                // Another program may have made it.
                let was_built = stage.progress.done() > 0;
                self.stream(paging, pages, was_built, std::mem::take(&mut *previews()));
                Some(true)
            }
            Err(error) if matches!(error.downcast_ref(), Some(stream::Error::Cancelled)) => {
                let points = previews().values().sum();
                self.lookout.keep_room(cloud, points);
                let summary = codec::Summary { points, cancelled: true, ..Default::default() };
                self.send(Event::Read { cloud, summary }).map(|()| false)
            }
            Err(error) => {
                let (input, error) = (paging.input.clone(), error.to_string());
                self.send(Event::Failed { input, error })?;
                let gone = std::mem::take(&mut *previews());
                for first_point in gone.into_keys() {
                    self.send(Event::Dropped { cloud, first_point })?;
                }
                self.lookout.keep_room(cloud, 0);
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
        if paging.is_native || self.lookout.is_closed(paging.cloud) {
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
            Err(stream::Error::Damaged { .. }) => self.lookout.report_damage(paging.cloud),
            Err(error) => self.send(Event::Failed { input: paging.input.clone(), error: error.to_string() })?,
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

    /// A built-in scene, all of it at once: its walls as a cloud and its mirrors, complete with normals and radii.
    fn sample(&self, variant: five_mirrors::Variant, without: &[String], clouds: &mut usize) -> Option<()> {
        let SceneSettings { points, seed } = self.settings.scene;
        let up = up(DVec3::Y, &self.settings);
        let input = built_in_name(variant);
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
            self.send(Event::Opened {
                cloud,
                name: format!("{input}, walls"),
                input: input.clone(),
                source: None,
                attributes: Vec::new(),
                grid: None,
                expected_points: points,
                up,
                provisional_radius: 0.0,
                warnings: Vec::new(),
            })?;
            for chunk in part.chunks {
                self.progress.add(chunk.len() as u64);
                self.send(Event::Chunk { cloud, chunk })?;
            }
            let summary = codec::Summary { points, ..Default::default() };
            self.send(Event::Read { cloud, summary })?;
        }
        Some(())
    }

    fn read(&self, loading: &mut Loading) -> Option<()> {
        let (source, cloud) = (&loading.source, loading.cloud);
        let kept = Mutex::new(Vec::new());
        let total = self.progress.total();
        let emit = |chunk: Chunk| {
            // The reader has set the total of its own file.
            self.progress.set_total(total);
            kept.lock().unwrap_or_else(PoisonError::into_inner).push(Chunk { columns: Vec::new(), ..chunk.clone() });
            if self.send(Event::Chunk { cloud, chunk }).is_none() {
                self.progress.cancel();
            }
        };
        let start = Instant::now();
        let read = source.read(&selection(source.info(), &self.settings), &self.progress, &emit);
        tracing::debug!(path = %source.info().path.display(), seconds = start.elapsed().as_secs_f64(), "read");
        loading.chunks = kept.into_inner().unwrap_or_else(PoisonError::into_inner);
        loading.chunks.sort_by_key(|chunk| chunk.first_point);
        self.end(loading, read)
    }

    /// Says how the reading of a file ended; what came of it stays.
    fn end(&self, loading: &Loading, read: codec::Result<codec::Summary>) -> Option<()> {
        let cloud = loading.cloud;
        match read {
            Ok(summary) => self.send(Event::Read { cloud, summary }),
            Err(error) => {
                let input = loading.source.info().path.display().to_string();
                self.send(Event::Failed { input, error: error.to_string() })?;
                let points = loading.chunks.iter().map(|chunk| chunk.len() as u64).sum();
                self.send(Event::Read { cloud, summary: codec::Summary { points, ..Default::default() } })
            }
        }
    }

    /// Both normals and radii, wherever one of them is missing; what the file has is kept.
    fn estimate(&self, loading: Loading, stage: &Stage) -> Option<()> {
        let Loading { cloud, source, up, mut chunks } = loading;
        if stage.progress.is_cancelled() {
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
        let options = options_for(&chunks, up, &self.settings);
        let start = Instant::now();
        let estimated = stage.run(|progress| cloud::estimate(&chunks, &options, progress));
        tracing::debug!(cloud, ?options, seconds = start.elapsed().as_secs_f64(), "normals and radii");
        match estimated {
            Some(surfels) => self.send(Event::Surfels { cloud, surfels }),
            None => Some(()),
        }
    }

    fn send(&self, event: Event) -> Option<()> {
        self.sender.send(event).ok()
    }
}

/// Opens a file; the error says why nothing of it can be shown.
pub fn open_file(path: &Path) -> Result<Arc<codec::Source>, String> {
    let source = codec::open(path).map_err(|error| error.to_string())?;
    let codec::Info { points, warnings, .. } = source.info();
    // A file that is as empty as it says is none of anybody's concern.
    if *points == 0 && !warnings.is_empty() {
        return Err(format!("{}: no points can be read: {}", path.display(), warnings.join("; ")));
    }
    Ok(Arc::new(source))
}

/// What is wrong with a file, each with its name.
pub fn file_warnings(info: &codec::Info) -> impl Iterator<Item = String> + '_ {
    info.warnings.iter().map(|warning| format!("{}: {warning}", info.path.display()))
}

/// Files that are streamed, as the clouds that they make: those that are COPC, if all of them are, one each; else all together.
pub fn parts(sources: Vec<Arc<codec::Source>>) -> Vec<(Vec<Arc<codec::Source>>, Option<Pages>)> {
    let native = |source: &Arc<codec::Source>| Pages::copc(source);
    match sources.iter().map(native).collect::<Option<Vec<Pages>>>() {
        Some(native) => sources.into_iter().zip(native).map(|(source, pages)| (vec![source], Some(pages))).collect(),
        None => vec![(sources, None)],
    }
}

/// The axis that points up: what the setting says, or what fits the data.
fn up(fitting: DVec3, settings: &Settings) -> DVec3 {
    match settings.view.up {
        UpAxis::Auto => fitting,
        UpAxis::Y => DVec3::Y,
        UpAxis::Z => DVec3::Z,
    }
}

/// The axis that points up in a file.
pub fn up_of(info: &codec::Info, settings: &Settings) -> DVec3 {
    // Scanners and surveys have z up; the tools that make meshes mostly y.
    let is_mesh = info.format == codec::Format::Ply && info.faces > 0;
    up(if is_mesh { DVec3::Y } else { DVec3::Z }, settings)
}

/// How the normals of such points are estimated.
fn options_for(chunks: &[Chunk], up: DVec3, settings: &Settings) -> SurfelOptions {
    let center = || cloud::robust_bounds(chunks).center();
    let orientation = match settings.surface.orientation {
        SurfaceOrientation::Auto => cloud::guess_orientation(chunks, up.as_vec3()),
        SurfaceOrientation::Up => Orientation::Up(up.as_vec3()),
        SurfaceOrientation::Inward => Orientation::Toward(center()),
        SurfaceOrientation::Outward => Orientation::AwayFrom(center()),
    };
    SurfelOptions { neighbours: settings.surface.neighbours as usize, orientation }
}

/// The same for an index, from its coarse pages.
///
/// # Errors
/// If they cannot be read.
pub fn surfel_options(pages: &Pages, up: DVec3, settings: &Settings) -> stream::Result<SurfelOptions> {
    Ok(options_for(&stream::coarsest(pages, KIND_POINTS)?, up, settings))
}

/// The last part of a path, as a cloud is called.
fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// What is read at once: all that most pictures need, and the attribute that `color.by` asks for. Others come on demand
/// (`read_column`).
fn selection(info: &codec::Info, settings: &Settings) -> codec::Selection {
    let color = &settings.color;
    let wanted = |name: &str| {
        matches!(name, "intensity" | "classification" | "return_number")
            || color.by == ColorBy::GpsTime && name == "gps_time"
            || color.by == ColorBy::Attribute && name == color.attribute
    };
    let attributes = info.attributes.iter().map(|attribute| wanted(&attribute.name)).collect();
    codec::Selection { positions: true, colors: true, normals: true, attributes }
}

#[cfg(test)]
#[path = "loading_streamed_tests.rs"]
mod streamed_tests;

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    const THREE_POINTS: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar intensity\nend_header\n0 0 0 7\n1 0 0 8\n0 1 0 9\n";

    fn words(words: &[&str]) -> Vec<String> {
        words.iter().map(|word| (*word).to_owned()).collect()
    }

    fn message(word: &str) -> String {
        resolve(&words(&[word])).check().unwrap_err().to_string()
    }

    #[test]
    fn words_name_files_scenes_and_built_in_scenes() {
        let folder = tempfile::tempdir().unwrap();
        let cloud = folder.path().join("cloud.ply");
        let scene = folder.path().join("scene.toml");
        std::fs::write(&cloud, THREE_POINTS).unwrap();
        std::fs::write(
            &scene,
            "clouds = [\"cloud.ply\", \"five-mirrors/torus\"]\n[parameters]\n\"splat.size\" = 2.0\n\"splat.nope\" = 1\n",
        )
        .unwrap();
        let request = resolve(&words(&[scene.to_str().unwrap()]));
        let torus = Input::BuiltIn { variant: five_mirrors::Variant::Torus, without: Vec::new() };
        assert_eq!(request.inputs, [Input::File(cloud), torus.clone()]);
        let view = request.view.unwrap();
        assert_eq!((view.settings.splat.size, view.camera), (2.0, None));
        assert!(request.warnings.len() == 1 && request.warnings[0].contains("splat.nope"), "{:?}", request.warnings);

        let alone = resolve(&words(&["five-mirrors/torus"]));
        assert_eq!(alone.inputs, [torus]);
        assert_eq!(alone.view.unwrap().camera, Some(five_mirrors::camera()));
        let nothing = resolve(&[]);
        assert!(nothing.inputs.is_empty() && nothing.check().is_ok());
    }

    #[test]
    fn a_folder_names_the_clouds_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str| {
            std::fs::write(folder.path().join(name), THREE_POINTS).unwrap();
            folder.path().join(name)
        };
        let word = words(&[folder.path().to_str().unwrap()]);
        write("notes.txt");
        let last = write("b.LAZ");
        assert_eq!(resolve(&word).inputs, [Input::File(last.clone())]);
        let first = write("a.ply");
        std::fs::create_dir(folder.path().join("c.las")).unwrap();
        let tiles = Input::Tiles { folder: folder.path().to_owned(), files: vec![first, last] };
        assert_eq!(resolve(&word).inputs, [tiles]);
    }

    #[test]
    fn a_view_of_a_scene_brings_none_of_its_objects_twice() {
        let light = "[[lights]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nintensity = [1, 1, 1]\n\
                     inner_degrees = 20\nouter_degrees = 30\n";
        let mirror =
            |line: &str| format!("[[mirrors]]\nshape = \"sphere\"\nposition = [0, 0, 0]\nsize = 0.2\n{line}\n");
        let points = "[[mirror_points]]\ncloud = \"a.laz\"\n";
        let text = |line: &str| format!("{light}{}{}{points}", mirror(""), mirror(line));
        let mut request = Request::default();
        request.furnish(&SceneFile::parse(&text("name = \"ball\"")).unwrap());
        let view = SceneFile::parse(&text("name = \"ball\"\nas_points = true")).unwrap();
        request.refurnish(&view);
        assert_eq!((request.lights.len(), request.mirror_points.len()), (1, 1));
        assert_eq!(request.mirrors, view.mirrors);
        request.refurnish(&SceneFile::default());
        assert_eq!(request.lights.len(), 1, "a view without lights leaves those that are there");
    }

    #[test]
    fn mirrors_and_lights_of_a_scene_file_take_the_place_of_a_built_in_scenes_own() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene.toml");
        let text = "clouds = [\"five-mirrors/all\"]\n[[mirrors]]\nname = \"torus\"\nshape = \"sphere\"\n\
                    position = [0, 0, 0]\nsize = 0.2\n";
        std::fs::write(&scene, text).unwrap();
        let request = resolve(&words(&[scene.to_str().unwrap()]));
        assert_eq!((request.mirrors.len(), request.lights.len()), (1, 0));
        assert_eq!(request.built_in_light(), Some(five_mirrors::light()));
        let light = "[[lights]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nintensity = [1, 1, 1]\n\
                     inner_degrees = 20\nouter_degrees = 30\n";
        std::fs::write(&scene, format!("{text}{light}")).unwrap();
        let lit = resolve(&words(&[scene.to_str().unwrap()]));
        assert_eq!((lit.lights.len(), lit.built_in_light()), (1, None));
        let mut settings = Settings::default();
        settings.scene.points = 10_000;
        let job = start(request.inputs, &settings);
        let brought = job.events.iter().filter_map(|event| match event {
            Event::Mirror { mirror, .. } => Some(mirror.name),
            _ => None,
        });
        assert_eq!(brought.collect::<Vec<_>>(), ["sphere", "parabolic", "blob", "coral"]);
    }

    #[test]
    fn a_word_that_names_nothing_leaves_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene.toml");
        std::fs::write(&scene, "clouds = [\"gone.ply\", \"five-mirrors/torus\"]\n").unwrap();
        let request = resolve(&words(&["no_such.laz", scene.to_str().unwrap(), "no_such.toml"]));
        assert!(request.check().is_ok());
        let unknown = request.inputs.iter().map(|input| matches!(input, Input::Unknown { .. }));
        assert_eq!(unknown.collect::<Vec<_>>(), [true, true, false, true]);
        let both = resolve(&words(&["no_such.laz", "no_such.ply"])).check().unwrap_err().to_string();
        assert!(both.contains("no_such.laz") && both.contains("no_such.ply"), "{both}");
    }

    #[test]
    fn words_that_name_nothing_are_refused_with_the_nearest_name() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("office.laz"), "").unwrap();
        let typo = folder.path().join("ofice.laz").display().to_string();
        assert!(message(&typo).contains("office.laz`?"), "{}", message(&typo));
        assert!(message("five-mirrors/sphre").contains("did you mean `five-mirrors/sphere`?"));
        assert!(message("sphere").contains("did you mean `five-mirrors/sphere`?"));
        assert!(message("five-mirrors/teapot").contains("glint scenes"));
        std::fs::create_dir(folder.path().join("empty")).unwrap();
        let empty = message(folder.path().join("empty").to_str().unwrap());
        assert!(empty.ends_with("empty: a folder without .las, .laz and .ply files"), "{empty}");
        assert!(message("no_such_scene.toml").contains("no_such_scene.toml"));
    }

    #[test]
    fn a_file_comes_in_as_header_chunks_and_the_surfels_it_lacks() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        std::fs::write(&path, THREE_POINTS).unwrap();
        let missing = Input::File(folder.path().join("gone.ply"));
        let job = start(vec![missing, Input::File(path)], &Settings::default());
        let mut seen = Vec::new();
        for event in &job.events {
            seen.push(match event {
                Event::Failed { input, .. } => {
                    assert!(input.ends_with("gone.ply"));
                    "failed"
                }
                Event::Opened { cloud, expected_points, up, .. } => {
                    assert_eq!((cloud, expected_points, up), (0, 3, DVec3::Z));
                    "opened"
                }
                Event::Chunk { chunk, .. } => {
                    assert_eq!(chunk.len(), 3);
                    assert!(chunk.columns[0].is_some(), "intensity is read without being asked for");
                    "chunk"
                }
                Event::Read { summary, .. } => {
                    assert_eq!(summary.points, 3);
                    "read"
                }
                Event::Mirror { .. } => panic!("there is none"),
                Event::Surfels { surfels, .. } => {
                    assert_eq!(surfels.iter().map(|surfels| surfels.normals.len()).collect::<Vec<_>>(), [3]);
                    "surfels"
                }
                Event::Stage { cloud, stage } => {
                    assert_eq!((cloud, stage.making, stage.points()), (0, Making::Surfels, 3));
                    "stage"
                }
                Event::Pages { .. } | Event::Dropped { .. } | Event::Stream(_) => "streamed",
                Event::Finished => "finished",
            });
        }
        assert_eq!(seen, ["failed", "opened", "chunk", "read", "stage", "surfels", "finished"]);
        assert_eq!((job.progress.done(), job.progress.total()), (3, 3));
    }

    #[test]
    fn a_built_in_scene_has_as_many_points_as_asked_for() {
        let mut settings = Settings::default();
        settings.scene.points = 200_000;
        let input = Input::BuiltIn { variant: five_mirrors::Variant::Sphere, without: Vec::new() };
        let job = start(vec![input], &settings);
        let (mut points, mut mirrors) = (0, 0);
        for event in &job.events {
            match event {
                Event::Opened { .. } => {}
                Event::Mirror { mirror, samples, .. } => {
                    assert_eq!((mirror.name.as_str(), mirror.specular_intensity), ("sphere", 1.0));
                    mirrors += 1;
                    points += samples.iter().map(Chunk::len).sum::<usize>();
                }
                Event::Chunk { chunk, .. } => points += chunk.len(),
                Event::Stage { .. } | Event::Surfels { .. } | Event::Failed { .. } => {
                    panic!("its points are complete")
                }
                Event::Read { .. } | Event::Finished => {}
                Event::Pages { .. } | Event::Dropped { .. } | Event::Stream(_) => panic!("nothing is streamed"),
            }
        }
        assert_eq!((points, mirrors), (200_000, 1));
    }

    #[test]
    fn a_dropped_job_ends_its_thread() {
        let mut settings = Settings::default();
        // More chunks than the channel holds, so that the thread waits for room when the job is dropped.
        settings.scene.points = 2_000_000;
        let input = Input::BuiltIn { variant: five_mirrors::Variant::Sphere, without: Vec::new() };
        let job = start(vec![input], &settings);
        let progress = job.progress.clone();
        assert!(job.events.recv().is_ok());
        drop(job);
        assert!(progress.is_cancelled());
        let deadline = Instant::now() + Duration::from_secs(60);
        while Arc::strong_count(&progress) > 1 {
            assert!(Instant::now() < deadline, "the thread is still there");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
