//! What the viewer knows: clouds, jobs, parameters, camera, picks. Plain data that panels edit and tests build without a
//! window. What has to happen outside (drawing, reading, the clipboard) is left in `effects` for the window to do.

use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use cloud::{Bounds, Chunk, Cloud, Column, Progress, Surfels};
use glam::DVec3;
use render::{ColorPlan, FrameStats};
use scene::{Camera, Lighting, Mirror, MirrorPoints, MirrorSurface, Settings, SpotLight, StandardView, Surroundings};
use serde_json::json;
use world::{
    Input, Kept, Lookout, Stage, Standing, StreamStats,
    mirrors::{self, Marked},
};

use super::bindings::Mode;
use super::figures::{Basis, Figures, class_column};
use super::gizmo::Gizmo;
use super::history::History;
use super::inspection::{self, Inspection};
use super::lens::Lens;
use super::marking::Draft;
use super::messages::{Level, Messages};
use super::navigation::Navigation;
use super::objects::{Marking, ObjectId, Objects, Origin, Placed, PlacedLight, unnamed};
use super::path_prompt::PathPrompt;
use super::pick::Pick;
use super::preferences::Preferences;
use super::reflection_figures::FigureHistory;
use super::render_thread::{self, CloudKey, Command, FrameRequest, PickPurpose, PickedPoint, Report};
use super::streams::{Pace, Streamed};
use super::sweep::{Ask, Sweep};
use super::theme::grouped;
use super::truth::TruthView;
use super::truth_tasks::{Answer, Task};
use super::tuning::Tuning;

/// What the window is to do.
pub enum Effect {
    Render(Command),
    Load {
        inputs: Vec<Input>,
    },
    FindFigures {
        key: CloudKey,
        cloud: Cloud,
        basis: Basis,
        up: DVec3,
        /// Of a streamed cloud: only what is counted is new.
        kept: Option<Box<Figures>>,
    },
    ReadColumn {
        key: CloudKey,
        source: Arc<codec::Source>,
        attribute: usize,
        progress: Arc<Progress>,
    },
    ReadRecord {
        picked: PickedPoint,
        source: Arc<codec::Source>,
    },
    SampleMirror {
        id: ObjectId,
        mirror: Mirror,
        /// Of the points around it, squared world units.
        area_per_point: f64,
    },
    /// Finds the points of a cloud that are to reflect, or, without `then`, how many they are.
    MarkPoints {
        key: CloudKey,
        cloud: Cloud,
        source: Option<Arc<codec::Source>>,
        wanted: Vec<MirrorPoints>,
        progress: Arc<Progress>,
    },
    CountPoints {
        cloud: Cloud,
        source: Option<Arc<codec::Source>>,
        wanted: MirrorPoints,
    },
    /// Finds out whether the sky is open above all points; `asked` tells the answers apart.
    FindSurroundings {
        asked: u32,
        chunks: Vec<Chunk>,
        up: DVec3,
    },
    /// Finds the surface that a ray meets.
    Cast(inspection::Ray),
    /// Has the ray tracer work.
    Truth(Box<Task>),
    /// Appends a group to a plan of studies, with the scene that it is about.
    AddToStudy {
        plan: PathBuf,
        scene: String,
        group: toml::Table,
    },
    /// Writes what a sweep came to.
    SaveSweep(Box<Sweep>),
    OpenDialog,
    SaveScene {
        path: PathBuf,
        text: String,
    },
    /// Deletes an index that is closed.
    DeleteIndex(Kept),
    /// Finds out how large all indexes are.
    MeasureCache,
    Copy(String),
    SetFullScreen(bool),
    /// A line of the event log.
    Log(serde_json::Value),
}

/// What a worker thread found.
pub enum Found {
    Figures {
        key: CloudKey,
        basis: Basis,
        figures: Box<Figures>,
    },
    Column {
        key: CloudKey,
        attribute: usize,
        result: Result<BTreeMap<u64, Arc<Column>>, String>,
    },
    Record {
        picked: PickedPoint,
        result: Result<Vec<(String, String)>, String>,
    },
    Samples {
        id: ObjectId,
        mirror: Mirror,
        area_per_point: f64,
        samples: Vec<Chunk>,
    },
    /// `None` if it was cancelled.
    Marked {
        key: CloudKey,
        wanted: Vec<MirrorPoints>,
        result: Result<Option<Vec<Marked>>, String>,
    },
    Counted {
        wanted: MirrorPoints,
        result: Result<u64, String>,
    },
    Surroundings {
        asked: u32,
        found: Surroundings,
    },
    Surface(Option<inspection::Surface>),
    Truth(Box<Answer>),
    AddedToStudy {
        plan: PathBuf,
        result: Result<(), String>,
    },
    SweepSaved {
        folder: PathBuf,
        result: Result<(), String>,
    },
    SceneSaved {
        path: PathBuf,
        result: Result<(), String>,
    },
    IndexDeleted {
        kept: Kept,
        result: Result<(), String>,
    },
    CacheSize(u64),
}

/// The points that stand for a mirror, and what they were made for.
pub struct Sample {
    pub key: CloudKey,
    pub mirror: Mirror,
    /// `None` if a built-in scene brought them.
    area_per_point: Option<f64>,
    pub chunks: Vec<(Chunk, Bounds)>,
}

pub struct CloudEntry {
    pub key: CloudKey,
    /// `cloud.name` is shown.
    pub cloud: Cloud,
    /// The word of the command line that it came from; several clouds of a built-in scene share it.
    pub input: String,
    pub source: Option<Arc<codec::Source>>,
    pub up: DVec3,
    pub expected_points: u64,
    pub points: u64,
    pub is_visible: bool,
    /// All chunks are there, or will not come.
    pub is_read: bool,
    /// Grows with the chunks; stray points included.
    pub(super) bounds: Bounds,
    pub figures: Option<Figures>,
    figures_basis: Option<Basis>,
    figures_under_way: bool,
    /// Columns read after the points, also for chunks that are still to come.
    late_columns: HashMap<usize, BTreeMap<u64, Arc<Column>>>,
    /// Attributes that are being read, or could not be (`None`), which are not tried again.
    column_reads: HashMap<usize, Option<Arc<Progress>>>,
    /// By `first_point`.
    pub chunk_bounds: HashMap<u64, Bounds>,
    /// What of it reflects on the render thread.
    marked: Vec<MirrorPoints>,
    /// Which points these are.
    pub marks: Arc<Vec<Marked>>,
    /// What is being found out.
    pub marking: Option<(Vec<MirrorPoints>, Arc<Progress>)>,
    /// Its chunks come and go.
    pub streamed: Option<Streamed>,
    /// What was last planned for it: its index, or normals and radii.
    pub stage: Option<Arc<Stage>>,
}

impl CloudEntry {
    /// Made by the program: there is no file.
    fn is_built_in(&self) -> bool {
        self.source.is_none() && self.streamed.is_none()
    }

    /// Its own points, wherever they are.
    pub fn total(&self) -> u64 {
        self.streamed.as_ref().and_then(Streamed::total).unwrap_or(self.expected_points).max(self.points)
    }
}

/// Loading under way.
pub struct JobEntry {
    pub id: u32,
    pub name: String,
    pub progress: Arc<Progress>,
    pub started: Instant,
    /// By the job's own numbers.
    pub clouds: BTreeMap<usize, CloudKey>,
    /// What is there of its streamed clouds, and where it is told from where they are looked at.
    pub stream: StreamStats,
    pub lookout: Arc<Lookout>,
    /// The number of the last look, 0 before the first one, and the share of the budgets that it had.
    pub(super) look: u64,
    pub share: f64,
    pub(super) has_streamed: bool,
    /// What it opens is shown: streamed clouds are there as far as the first look needs them, and stay under way.
    pub is_loaded: bool,
}

impl JobEntry {
    fn owns(&self, key: CloudKey) -> bool {
        self.clouds.values().any(|cloud| *cloud == key)
    }
}

/// The picture on the screen.
pub struct Shown {
    pub request: FrameRequest,
    pub stats: FrameStats,
    pub total_milliseconds: f64,
}

pub struct State {
    pub clouds: Vec<CloudEntry>,
    pub jobs: Vec<JobEntry>,
    pub settings: Settings,
    pub objects: Objects,
    /// A mirror or a light.
    pub selected: Option<ObjectId>,
    /// What is around the points, once they are all there.
    surroundings: Option<Surroundings>,
    /// Times that the surroundings were asked for, and the last of them that was answered.
    surroundings_asked: u32,
    surroundings_known: u32,
    /// The lights are being looked after: they are shown in the picture.
    pub light_panel_is_open: bool,
    /// What lit the points before the data's own colours were asked for.
    pub lit_by: Lighting,
    pub gizmo: Gizmo,
    pub inspection: Option<Inspection>,
    pub samples: HashMap<ObjectId, Sample>,
    /// A mirror whose points are being made.
    sampling: Option<ObjectId>,
    /// Of what is loaded, squared world units.
    area_per_point: Option<f64>,
    /// Points that may be turned into a mirror.
    pub draft: Draft,
    /// Of scene files whose clouds are still to come.
    awaited_markings: Vec<MirrorPoints>,
    pub figure_history: FigureHistory,
    pub camera: Camera,
    /// Someone chose the camera: loading no longer moves it.
    pub camera_is_placed: bool,
    pub mode: Mode,
    pub navigation: Navigation,
    pub visible_classes: [bool; 256],
    pub picks: Vec<Pick>,
    pub pick_tool: bool,
    pub raw_colors: bool,
    pub truth: TruthView,
    pub tuning: Tuning,
    /// A sweep that is being set up, and one that is under way.
    pub sweep_asked: Option<Ask>,
    pub sweep: Option<Sweep>,
    pub history: History,
    pub messages: Messages,
    pub preferences: Preferences,
    pub path_prompt: Option<PathPrompt>,
    pub shortcuts_are_open: bool,
    pub interface_is_hidden: bool,
    pub is_full_screen: bool,
    /// Adapter that draws; `None` until its shaders are compiled.
    pub adapter: Option<String>,
    pub shown: Option<Shown>,
    /// Time of the last frame in the wanted quality.
    careful_milliseconds: f64,
    /// Counts changes of the points and their colours.
    pub revision: u64,
    /// The frame that is wanted now, as far as it has been asked for.
    pub requested: Option<FrameRequest>,
    requested_at: Option<Instant>,
    pub frames_under_way: u32,
    /// The picture on the screen is the final one, and that is logged.
    is_at_rest: bool,
    /// Pixels of the picture.
    pub view_size: [u32; 2],
    pub effects: Vec<Effect>,
    next_cloud: u32,
    next_job: u32,
    next_object: u32,
    /// Why nothing can be drawn any more.
    pub fatal: Option<String>,
    pub wants_to_quit: bool,
    /// Warnings that were given: not twice, though figures are renewed.
    warned: Vec<String>,
    pub pace: Pace,
    /// Bytes of all indexes, once they are counted.
    pub cache_size: Option<u64>,
    /// Streamed points are coloured by level.
    pub(super) levels_are_shown: bool,
    /// As the render thread was told.
    pub(super) expected_points: u64,
}

/// While points come in, a frame at most this often: each takes time from reading.
const LOADING_FRAME_INTERVAL: Duration = Duration::from_millis(100);

impl State {
    pub fn new(preferences: Preferences) -> Self {
        let (settings, warnings) = preferences.settings();
        let mut messages = Messages::default();
        warnings.into_iter().for_each(|warning| messages.warning(format!("kept parameters: {warning}")));
        Self {
            clouds: Vec::new(),
            jobs: Vec::new(),
            settings,
            objects: Objects::default(),
            selected: None,
            surroundings: None,
            surroundings_asked: 0,
            surroundings_known: 0,
            light_panel_is_open: false,
            lit_by: Lighting::Auto,
            gizmo: Gizmo::default(),
            inspection: None,
            samples: HashMap::new(),
            sampling: None,
            area_per_point: None,
            draft: Draft::default(),
            awaited_markings: Vec::new(),
            figure_history: FigureHistory::default(),
            camera: Camera::looking(DVec3::ZERO, DVec3::ONE, 5.0, DVec3::Z),
            camera_is_placed: false,
            mode: Mode::Orbit,
            navigation: Navigation::default(),
            visible_classes: [true; 256],
            picks: Vec::new(),
            pick_tool: false,
            raw_colors: false,
            truth: TruthView::new(),
            tuning: Tuning::default(),
            sweep_asked: None,
            sweep: None,
            history: History::default(),
            messages,
            preferences,
            path_prompt: None,
            shortcuts_are_open: false,
            interface_is_hidden: false,
            is_full_screen: false,
            adapter: None,
            shown: None,
            careful_milliseconds: 0.0,
            revision: 0,
            requested: None,
            requested_at: None,
            frames_under_way: 0,
            is_at_rest: false,
            view_size: [1, 1],
            effects: Vec::new(),
            next_cloud: 0,
            next_job: 0,
            next_object: 0,
            fatal: None,
            wants_to_quit: false,
            warned: Vec::new(),
            pace: Pace::default(),
            cache_size: None,
            levels_are_shown: false,
            expected_points: 0,
        }
    }

    pub fn cloud(&self, key: CloudKey) -> Option<&CloudEntry> {
        self.clouds.iter().find(|entry| entry.key == key)
    }

    pub(super) fn cloud_mut(&mut self, key: CloudKey) -> Option<&mut CloudEntry> {
        self.clouds.iter_mut().find(|entry| entry.key == key)
    }

    pub fn render(&mut self, command: Command) {
        self.effects.push(Effect::Render(command));
    }

    pub fn log(&mut self, event: serde_json::Value) {
        self.effects.push(Effect::Log(event));
    }

    pub fn say(&mut self, level: Level, text: impl Into<String>) {
        let text = text.into();
        self.log(json!({ "event": "message", "level": level.name(), "text": text }));
        self.messages.push(level, text);
    }

    // ---- opening ----

    /// Opens what the words name: files, scenes, built-in scenes. Says what is wrong if they name nothing, and returns
    /// whether they do.
    pub fn open(&mut self, words: &[String]) -> bool {
        let request = world::resolve(words);
        match request.check() {
            Ok(()) => {
                self.open_request(request);
                true
            }
            Err(error) => {
                self.say(Level::Error, error.to_string());
                false
            }
        }
    }

    pub fn open_request(&mut self, request: world::Request) {
        let built_in_light = request.built_in_light();
        for warning in request.warnings {
            self.say(Level::Warning, warning);
        }
        if let Some(view) = request.view {
            // The camera of a built-in scene comes without parameters of its own: those at hand stay.
            let settings =
                if view.settings == Settings::default() { self.settings.clone() } else { view.settings.clone() };
            match view.camera {
                Some(camera) if self.clouds.is_empty() => self.jump(settings, camera),
                _ => self.settings = settings,
            }
        }
        let built_in = built_in_light.map(|light| (light, Origin::BuiltIn));
        self.bring_lights(request.lights.into_iter().map(|light| (light, Origin::Person)).chain(built_in));
        for mirror in request.mirrors {
            self.bring_mirror(mirror, None);
        }
        self.awaited_markings.extend(request.mirror_points);
        if !request.inputs.is_empty() {
            self.effects.push(Effect::Load { inputs: request.inputs });
        }
    }

    /// The job that the window started for `inputs`; returns its number.
    pub fn add_job(&mut self, inputs: &[Input], progress: Arc<Progress>, lookout: Arc<Lookout>) -> u32 {
        let id = self.next_job;
        self.next_job += 1;
        let name = match inputs {
            [one] => short_name(&one.name()).to_string(),
            several => format!("{} inputs", several.len()),
        };
        let started = Instant::now();
        self.jobs.push(JobEntry {
            id,
            name,
            progress,
            started,
            clouds: BTreeMap::new(),
            stream: StreamStats::default(),
            lookout,
            look: 0,
            share: 1.0,
            has_streamed: false,
            is_loaded: false,
        });
        id
    }

    pub fn on_loading(&mut self, job: u32, event: world::Event) {
        match event {
            world::Event::Opened {
                name,
                input,
                source,
                attributes,
                grid,
                expected_points,
                up,
                provisional_radius,
                warnings,
                cloud: index,
            } => {
                let cloud = Cloud { name, attributes, grid, chunks: Vec::new() };
                let key = CloudKey(self.next_cloud);
                self.next_cloud += 1;
                self.render(Command::AddCloud { key, provisional_radius });
                if self.visible_classes.contains(&false) {
                    let visible = Box::new(self.visible_classes);
                    self.render(Command::SetVisibleClasses { key, visible });
                }
                for warning in warnings {
                    self.say(Level::Warning, format!("{}: {warning}", cloud.name));
                }
                self.log(json!({ "event": "opened", "name": cloud.name, "expected_points": expected_points }));
                // Streamed clouds have no source to look records up in; built-in scenes have no file.
                if source.is_some() || std::path::Path::new(&input).exists() {
                    self.preferences.remember_file(&input);
                }
                let bounds = source.as_ref().and_then(|source| source.info().bounds);
                self.clouds.push(CloudEntry {
                    key,
                    cloud,
                    input,
                    source,
                    up,
                    expected_points,
                    points: 0,
                    is_visible: true,
                    is_read: false,
                    bounds: Bounds::EMPTY,
                    figures: None,
                    figures_basis: None,
                    figures_under_way: false,
                    late_columns: HashMap::new(),
                    column_reads: HashMap::new(),
                    chunk_bounds: HashMap::new(),
                    marked: Vec::new(),
                    marks: Arc::default(),
                    marking: None,
                    streamed: None,
                    stage: None,
                });
                if let Some(entry) = self.jobs.iter_mut().find(|entry| entry.id == job) {
                    entry.clouds.insert(index, key);
                }
                self.make_room();
                if let Some(bounds) = bounds {
                    self.frame_while_unplaced(bounds);
                }
            }
            world::Event::Chunk { cloud, chunk } => self.add_chunk(job, cloud, chunk),
            world::Event::Pages { cloud, pages } => self.on_pages(job, cloud, pages),
            world::Event::Stage { cloud, stage } => {
                let key = self.key_of(job, cloud);
                if let Some(entry) = key.and_then(|key| self.cloud_mut(key)) {
                    entry.stage = Some(stage);
                }
            }
            world::Event::Dropped { cloud, first_point } => self.drop_chunk(job, cloud, first_point),
            world::Event::Stream(stats) => self.on_stream(job, stats),
            world::Event::Mirror { input, mirror, samples } => {
                let id = self.bring_mirror(mirror.clone(), Some(input));
                self.put_samples(id, mirror, None, samples);
            }
            world::Event::Read { cloud, summary } => self.on_read(job, cloud, &summary),
            world::Event::Surfels { cloud, surfels } => self.add_surfels(job, cloud, surfels),
            world::Event::Failed { input, error } => {
                let name = short_name(&input).to_string();
                // Errors name the file already, with its path.
                let text = if error.contains(&name) { error } else { format!("{name}: {error}") };
                self.say(Level::Error, text);
            }
            world::Event::Finished => self.finish_job(job),
        }
    }

    pub(super) fn key_of(&self, job: u32, cloud: usize) -> Option<CloudKey> {
        self.jobs.iter().find(|entry| entry.id == job)?.clouds.get(&cloud).copied()
    }

    /// Adds a chunk, or puts it in the place of the one with the same first point.
    fn add_chunk(&mut self, job: u32, cloud: usize, mut chunk: Chunk) {
        let key = self.key_of(job, cloud);
        let Some(entry) = key.and_then(|key| self.cloud_mut(key)) else { return };
        for (attribute, columns) in &entry.late_columns {
            put_column(&mut chunk, *attribute, columns);
        }
        let chunk_bounds = chunk.bounds();
        let first_point = chunk.first_point;
        entry.points += chunk.len() as u64;
        match entry.chunk_bounds.insert(first_point, chunk_bounds) {
            Some(_) => {
                let same = entry.cloud.chunks.iter_mut().find(|same| same.first_point == first_point);
                if let Some(same) = same {
                    entry.points -= same.len() as u64;
                    *same = chunk.clone();
                }
            }
            None => entry.cloud.chunks.push(chunk.clone()),
        }
        entry.bounds = entry.bounds.union(chunk_bounds);
        let (key, classes, bounds) = (entry.key, class_column(&entry.cloud), entry.bounds);
        let is_first = entry.figures.is_none() && entry.cloud.chunks.len() == 1;
        let uncolored = is_first.then(|| (entry.cloud.clone(), entry.up));
        let has_header_bounds = entry.source.as_ref().is_some_and(|source| source.info().bounds.is_some());
        self.render(Command::Chunk { key, chunk, classes });
        if let Some((cloud, up)) = uncolored {
            // What is drawn before the figures are known has colours, too.
            let (plan, _) = ColorPlan::new(&cloud, &self.settings.color, up);
            if plan.missing_column(&cloud).is_none() {
                self.render(Command::Color { key, cloud, plan, up });
            }
        }
        self.tint_chunk(key, first_point);
        self.revision += 1;
        if !has_header_bounds && self.shown.is_none() {
            self.frame_while_unplaced(bounds);
        }
    }

    /// Forgets a chunk of a streamed cloud.
    fn drop_chunk(&mut self, job: u32, cloud: usize, first_point: u64) {
        let key = self.key_of(job, cloud);
        let Some(entry) = key.and_then(|key| self.cloud_mut(key)) else { return };
        let Some(index) = entry.cloud.chunks.iter().position(|chunk| chunk.first_point == first_point) else { return };
        let gone = entry.cloud.chunks.swap_remove(index);
        entry.points -= gone.len() as u64;
        entry.chunk_bounds.remove(&first_point);
        // Those of the index hold whatever comes.
        if entry.streamed.as_ref().and_then(Streamed::bounds).is_none() {
            entry.bounds = entry.chunk_bounds.values().fold(Bounds::EMPTY, |all, bounds| all.union(*bounds));
        }
        let key = entry.key;
        self.render(Command::RemoveChunk { key, first_point });
        self.revision += 1;
    }

    fn on_read(&mut self, job: u32, cloud: usize, summary: &codec::Summary) {
        let key = self.key_of(job, cloud);
        let Some(entry) = key.and_then(|key| self.cloud_mut(key)) else { return };
        entry.is_read = true;
        entry.cloud.chunks.sort_by_key(|chunk| chunk.first_point);
        let (name, points) = (entry.cloud.name.clone(), entry.points);
        let warnings = summary.warnings.iter().map(|warning| format!("{name}: {warning}"));
        for warning in warnings.collect::<Vec<_>>() {
            self.say(Level::Warning, warning);
        }
        if summary.cancelled {
            let rest =
                if points > 0 { format!("; the {} points read so far stay", grouped(points)) } else { String::new() };
            self.say(Level::Note, format!("{name}: stopped{rest}"));
        }
        self.log(json!({ "event": "read", "name": name, "points": points, "cancelled": summary.cancelled }));
        // Its index could not be made, which was said.
        let is_lost = |entry: &CloudEntry| entry.streamed.is_some() && !entry.is_indexed() && entry.points == 0;
        if let Some(key) = key.filter(|key| !summary.cancelled && self.cloud(*key).is_some_and(is_lost)) {
            self.remove_cloud(key);
        }
        self.note_loaded();
    }

    /// Jobs with streamed clouds stay under way; loaded is what their first look needs.
    fn note_loaded(&mut self) {
        for index in 0..self.jobs.len() {
            let of_job = || self.clouds.iter().filter(|entry| self.jobs[index].owns(entry.key));
            let is_loaded = of_job().any(|entry| entry.streamed.is_some()) && of_job().all(|entry| entry.is_read);
            if is_loaded && !std::mem::replace(&mut self.jobs[index].is_loaded, true) {
                self.on_loaded();
            }
        }
    }

    fn add_surfels(&mut self, job: u32, cloud: usize, surfels: Vec<Surfels>) {
        let key = self.key_of(job, cloud);
        let Some(entry) = key.and_then(|key| self.cloud_mut(key)) else { return };
        // One per chunk, by first_point: as the chunks have been ordered since the read ended.
        for (chunk, surfels) in entry.cloud.chunks.iter_mut().zip(surfels) {
            chunk.normals = Some(Arc::new(surfels.normals));
            chunk.radii = Some(Arc::new(surfels.radii));
        }
        // What reflects is to be found again, with these.
        entry.marked = Vec::new();
        let (key, classes, chunks) = (entry.key, class_column(&entry.cloud), entry.cloud.chunks.clone());
        // Chunks of normals are new colours, too.
        entry.figures_basis = None;
        let name = entry.cloud.name.clone();
        for chunk in chunks {
            self.render(Command::Chunk { key, chunk, classes });
        }
        self.revision += 1;
        self.log(json!({ "event": "surfels", "name": name }));
    }

    fn finish_job(&mut self, job: u32) {
        let Some(index) = self.jobs.iter().position(|entry| entry.id == job) else { return };
        let job = self.jobs.remove(index);
        for entry in self.clouds.iter_mut().filter(|entry| job.owns(entry.key)) {
            entry.is_read = true;
        }
        // What could be opened but holds nothing would be a line without a picture.
        let empty = |entry: &CloudEntry| job.owns(entry.key) && entry.points == 0;
        let empty: Vec<(CloudKey, String)> = self
            .clouds
            .iter()
            .filter(|entry| empty(entry))
            .map(|entry| (entry.key, entry.cloud.name.clone()))
            .collect();
        for (key, name) in empty {
            self.remove_cloud(key);
            if !job.progress.is_cancelled() {
                self.say(Level::Warning, format!("{name}: has no points"));
            }
        }
        if !job.is_loaded {
            self.on_loaded();
        }
    }

    /// The points of a job are there, or as many as the first look needs.
    fn on_loaded(&mut self) {
        self.area_per_point = None;
        self.place_awaited_markings();
        self.ask_surroundings();
        let points = self.points();
        self.log(json!({ "event": "loaded", "points": points, "clouds": self.clouds.len() }));
    }

    /// Whether points are still to come, whatever is looked at.
    pub fn is_loading(&self) -> bool {
        self.jobs.iter().any(|job| !job.is_loaded)
    }

    /// Of all clouds, as far as they are there, and of the mirrors of built-in scenes.
    pub fn points(&self) -> u64 {
        let brought = self.samples.values().filter(|sample| sample.area_per_point.is_none());
        let of_mirrors = brought.flat_map(|sample| &sample.chunks).map(|(chunk, _)| chunk.len() as u64).sum::<u64>();
        self.clouds.iter().map(|entry| entry.points).sum::<u64>() + of_mirrors
    }

    /// The same, with those of streamed clouds that are not there.
    pub fn all_points(&self) -> u64 {
        let elsewhere = self.clouds.iter().filter(|entry| entry.streamed.is_some());
        self.points() + elsewhere.map(|entry| entry.total() - entry.points).sum::<u64>()
    }

    /// What is made for one of a job's clouds now, or comes next.
    pub fn stage_of(&self, job: &JobEntry) -> Option<(&CloudEntry, &Stage)> {
        let of_job = self.clouds.iter().filter(|entry| job.owns(entry.key));
        let pending =
            of_job.filter_map(|entry| Some((entry, entry.stage.as_deref().filter(|stage| stage.is_pending())?)));
        pending.min_by_key(|(_, stage)| stage.standing() == Standing::Queued)
    }

    /// Whether a job shows how far it is: it loads, or makes something of what is shown.
    pub fn is_at_work(&self, job: &JobEntry) -> bool {
        !job.is_loaded || self.stage_of(job).is_some()
    }

    /// What has been read stays.
    pub fn stop_loading(&mut self) {
        for job in self.jobs.iter().filter(|job| self.is_at_work(job)) {
            job.progress.cancel();
            job.lookout.stop_all();
        }
        self.log(json!({ "event": "cancelled" }));
    }

    pub fn remove_cloud(&mut self, key: CloudKey) {
        let Some(index) = self.clouds.iter().position(|entry| entry.key == key) else { return };
        let input = self.clouds.remove(index).input;
        self.area_per_point = None;
        let is_last = self.clouds.is_empty();
        // Built-in scenes have no file.
        let is_built_in_left = self.clouds.iter().any(CloudEntry::is_built_in);
        // Mirrors of a built-in scene go with it, its light with the last such scene, and with the last cloud all of them.
        self.rewrite_objects(|objects| {
            objects.lights.retain(|placed| !is_last && (is_built_in_left || placed.origin != Origin::BuiltIn));
            objects.no_guess &= !is_last;
            objects.markings.retain(|marking| marking.key != key);
            objects.mirrors.retain(|placed| !is_last && placed.input.as_ref() != Some(&input));
        });
        self.picks.retain(|pick| pick.point.key != key);
        self.render(Command::Remove { key });
        self.revision += 1;
        // The job of a cloud that is gone need not go on.
        for job in &self.jobs {
            if let Some((index, _)) = job.clouds.iter().find(|(_, cloud)| **cloud == key) {
                job.lookout.close(*index);
            }
            if !job.clouds.is_empty() && !self.clouds.iter().any(|entry| job.owns(entry.key)) {
                job.progress.cancel();
                job.lookout.end();
            }
        }
        self.note_loaded();
        if is_last {
            self.camera_is_placed = false;
            self.shown = None;
            self.surroundings = None;
            // An answer that is under way is about what is gone.
            self.surroundings_asked += 1;
            self.surroundings_known = self.surroundings_asked;
        }
        self.ask_surroundings();
    }

    pub fn set_visible(&mut self, key: CloudKey, visible: bool) {
        if let Some(entry) = self.cloud_mut(key) {
            entry.is_visible = visible;
            self.render(Command::SetVisible { key, visible });
            self.revision += 1;
            self.ask_surroundings();
        }
    }

    pub fn set_class_visible(&mut self, classes: impl IntoIterator<Item = u8>, visible: bool) {
        for class in classes {
            self.visible_classes[usize::from(class)] = visible;
        }
        for key in self.clouds.iter().map(|entry| entry.key).collect::<Vec<_>>() {
            self.render(Command::SetVisibleClasses { key, visible: Box::new(self.visible_classes) });
        }
        self.revision += 1;
    }

    // ---- figures and columns ----

    /// Asks for colours, histograms and bounds of clouds that have changed. Called every frame of the window.
    pub fn renew_figures(&mut self) {
        let color = &self.settings.color;
        for entry in self.clouds.iter_mut().filter(|entry| entry.points > 0 && !entry.figures_under_way) {
            let basis = Basis {
                color: color.clone(),
                doublings: if entry.is_read { 0 } else { entry.points.ilog2() },
                is_read: entry.is_read,
                late_columns: entry.late_columns.len(),
                rests: entry.streamed.as_ref().map_or(0, |streamed| streamed.rests),
            };
            if entry.figures_basis.as_ref() != Some(&basis) {
                entry.figures_under_way = true;
                let (key, cloud, up) = (entry.key, entry.cloud.clone(), entry.up);
                let same_color = entry.figures_basis.as_ref().is_some_and(|old| old.color == basis.color);
                // Ramps of a streamed cloud must not change with what of it is there.
                let kept = entry.figures.as_ref().filter(|_| same_color && entry.is_indexed());
                let kept = kept.cloned().map(Box::new);
                self.effects.push(Effect::FindFigures { key, cloud, basis, up, kept });
            }
        }
    }

    pub fn on_found(&mut self, found: Found) {
        match found {
            Found::Figures { key, basis, figures } => self.on_figures(key, basis, *figures),
            Found::Column { key, attribute, result } => self.on_column(key, attribute, result),
            Found::Record { picked, result } => {
                for pick in self.picks.iter_mut().filter(|pick| pick.point == picked) {
                    pick.record = Some(result.clone());
                }
                let attributes: serde_json::Map<_, _> =
                    result.unwrap_or_default().into_iter().map(|(name, value)| (name, value.into())).collect();
                self.log(json!({ "event": "record", "point": picked.point, "attributes": attributes }));
            }
            Found::Samples { id, mirror, area_per_point, samples } => {
                self.sampling = None;
                // Of a mirror that has been deleted meanwhile there is nothing to show.
                if self.all_mirrors().any(|(known, _)| known == id) {
                    self.put_samples(id, mirror, Some(area_per_point), samples);
                }
            }
            Found::Marked { key, wanted, result } => self.on_marked(key, wanted, result),
            Found::Counted { wanted, result } => self.draft.on_counted(wanted, result),
            Found::Surroundings { asked, found } => self.on_surroundings(asked, found),
            Found::Surface(surface) => self.on_surface(surface),
            Found::Truth(answer) => self.on_truth(*answer),
            Found::AddedToStudy { plan, result } => self.on_added_to_study(&plan, result),
            Found::SweepSaved { folder, result } => self.on_sweep_saved(&folder, result),
            Found::SceneSaved { path, result } => match result {
                Ok(()) => {
                    self.log(json!({ "event": "scene_saved", "path": path }));
                    self.messages.note(format!("Scene saved: {}", path.display()));
                }
                Err(error) => self.say(Level::Error, format!("{}: {error}", path.display())),
            },
            Found::IndexDeleted { kept, result } => self.on_index_deleted(&kept, result),
            Found::CacheSize(bytes) => self.cache_size = Some(bytes),
        }
    }

    // ---- mirrors ----

    /// Changes the objects in one step of undo.
    pub fn edit_objects(&mut self, change: impl FnOnce(&mut Objects)) {
        self.history.settle(&self.settings, &self.objects);
        change(&mut self.objects);
        self.history.settle(&self.settings, &self.objects);
        self.navigation.camera_moved();
    }

    /// Whole clouds to be turned into mirrors when they have come.
    pub fn await_marking(&mut self, points: MirrorPoints) {
        self.awaited_markings.push(points);
    }

    pub fn next_object_id(&mut self) -> ObjectId {
        self.next_object += 1;
        ObjectId(self.next_object - 1)
    }

    /// Changes the objects in a way that is no step of undo: something came or went with a file.
    pub(super) fn rewrite_objects(&mut self, change: impl Fn(&mut Objects)) {
        self.history.settle(&self.settings, &self.objects);
        change(&mut self.objects);
        self.history.rewrite(change);
    }

    /// A mirror that a file or a built-in scene brings.
    fn bring_mirror(&mut self, mirror: Mirror, input: Option<String>) -> ObjectId {
        let id = self.next_object_id();
        let mirror = Mirror { name: self.objects.free_name(&mirror.name, None), ..mirror };
        self.log(json!({ "event": "mirror", "name": mirror.name }));
        self.rewrite_objects(|objects| {
            objects.mirrors.push(Placed { id, mirror: mirror.clone(), input: input.clone() });
        });
        id
    }

    // ---- light ----

    /// Lights that files and a built-in scene bring, less those that are there already.
    fn bring_lights(&mut self, lights: impl Iterator<Item = (SpotLight, Origin)>) {
        let mut named = Objects { lights: self.objects.lights.clone(), ..Objects::default() };
        let mut brought: Vec<PlacedLight> = Vec::new();
        for (light, origin) in lights {
            let placed = PlacedLight { id: self.next_object_id(), name: named.free_light_name("spot"), light, origin };
            named.lights.push(placed.clone());
            brought.push(placed);
        }
        if brought.is_empty() {
            return;
        }
        self.rewrite_objects(|objects| {
            // A guess stands in for lights that are not there.
            objects.lights.retain(|other| other.origin != Origin::Guess);
            let known = objects.lights.clone();
            let is_new = |placed: &&PlacedLight| known.iter().all(|other| other.light != placed.light);
            objects.lights.extend(brought.iter().filter(is_new).cloned());
        });
        self.warn_of_dark_lights();
    }

    /// Asks what is around the points that are shown, once they are all there.
    fn ask_surroundings(&mut self) {
        let visible = self.clouds.iter().filter(|entry| entry.is_visible);
        let chunks: Vec<Chunk> = visible.flat_map(|entry| entry.cloud.chunks.iter().cloned()).collect();
        if !self.is_loading() && !chunks.is_empty() {
            self.surroundings_asked += 1;
            let (asked, up) = (self.surroundings_asked, self.up());
            self.effects.push(Effect::FindSurroundings { asked, chunks, up });
        }
    }

    /// A scan of a room that has no light gets a lamp, which is no step of undo.
    fn on_surroundings(&mut self, asked: u32, found: Surroundings) {
        if asked != self.surroundings_asked {
            return;
        }
        self.surroundings_known = asked;
        self.surroundings = Some(found);
        let id = self.next_object_id();
        let lamp = if let Surroundings::Room(room) = found { Some(room.lamp) } else { None };
        self.rewrite_objects(|objects| objects.guess(id, lamp));
        self.log(json!({
            "event": "surroundings", "sky_is_open": self.sky_is_open(), "lights": self.objects.lights.len(),
        }));
    }

    /// Whether a light would come of itself if what is open were opened anew.
    pub fn lacks_light(&self) -> bool {
        let is_room = matches!(self.surroundings, Some(Surroundings::Room(_)));
        is_room || self.clouds.iter().any(CloudEntry::is_built_in)
    }

    pub fn sky_is_open(&self) -> bool {
        self.surroundings == Some(Surroundings::OpenSky)
    }

    /// The lights that are there to shine. From outside of a room its lamp would light nothing that is seen.
    fn lights(&self) -> Vec<SpotLight> {
        match self.surroundings {
            Some(Surroundings::Room(room))
                if self.objects.has_guess() && !room.lamp_shines(self.settings.light.by, self.camera.eye) =>
            {
                return Vec::new();
            }
            _ => {}
        }
        self.objects.lights.iter().map(|placed| placed.light).collect()
    }

    /// What lights the points: what `auto` stands for now.
    pub fn lighting(&self) -> Lighting {
        self.settings.light.lighting(!self.lights().is_empty(), self.sky_is_open())
    }

    /// Whether the picture shows the data's own colours.
    pub fn is_unlit(&self) -> bool {
        self.raw_colors || self.settings.light.by == Lighting::Colors
    }

    // ---- mirrors and their points ----

    /// Those of the scene, and the one that is held over it.
    pub fn all_mirrors(&self) -> impl Iterator<Item = (ObjectId, &Mirror)> {
        let placed = self.objects.mirrors.iter().map(|placed| (placed.id, &placed.mirror));
        let held = self.inspection.iter().filter_map(|held| Some((held.id, held.mirror.as_ref()?)));
        placed.chain(held)
    }

    fn put_samples(&mut self, id: ObjectId, mirror: Mirror, area_per_point: Option<f64>, chunks: Vec<Chunk>) {
        let next = &mut self.next_cloud;
        let key = self.samples.get(&id).map_or_else(
            || {
                *next += 1;
                CloudKey(*next - 1)
            },
            |sample| sample.key,
        );
        self.render(Command::Mirror { key, mirror: mirror.clone(), samples: chunks.clone() });
        let with_bounds = |chunk: Chunk| {
            let bounds = chunk.bounds();
            (chunk, bounds)
        };
        let chunks = chunks.into_iter().map(with_bounds).collect();
        self.samples.insert(id, Sample { key, mirror, area_per_point, chunks });
        self.revision += 1;
    }

    /// Brings the render thread to what the objects say: points of mirrors that were added or changed, of clouds that begin or
    /// end to reflect. Called every frame of the window; what takes time is done elsewhere, one thing at a time, so that what
    /// is dragged is always the latest.
    pub fn sync_objects(&mut self) {
        let gone: Vec<ObjectId> =
            self.samples.keys().copied().filter(|id| self.all_mirrors().all(|(known, _)| known != *id)).collect();
        for id in gone {
            if let Some(sample) = self.samples.remove(&id) {
                self.render(Command::Remove { key: sample.key });
                self.revision += 1;
            }
        }
        if self.selected.is_some_and(|id| self.objects.mirror(id).is_none() && self.objects.light(id).is_none()) {
            self.selected = None;
        }
        // The spacing of the points is known when they are all there.
        if self.is_loading() || self.clouds.is_empty() {
            return;
        }
        self.refuse_marking_streamed();
        let clouds = &self.clouds;
        let area_per_point = *self
            .area_per_point
            .get_or_insert_with(|| mirrors::area_per_point(clouds.iter().flat_map(|entry| &entry.cloud.chunks)));
        if self.sampling.is_none() {
            let is_current = |id: ObjectId, mirror: &Mirror| {
                self.samples.get(&id).is_some_and(|sample| {
                    let same_area = sample.area_per_point.is_none_or(|area| area.to_bits() == area_per_point.to_bits());
                    same_area && unnamed(mirror) == unnamed(&sample.mirror)
                })
            };
            // What moves and is drawn by its formula needs its points when it stands still.
            let is_held = |id: ObjectId| {
                let by_formula = self.settings.mirror.surface != MirrorSurface::Points;
                self.inspection.as_ref().is_some_and(|held| held.id == id && by_formula)
                    || self.selected == Some(id) && self.gizmo.is_dragging() && self.is_slow()
            };
            let stale = self.all_mirrors().find(|(id, mirror)| !is_held(*id) && !is_current(*id, mirror));
            if let Some((id, mirror)) = stale.map(|(id, mirror)| (id, mirror.clone())) {
                self.sampling = Some(id);
                self.effects.push(Effect::SampleMirror { id, mirror, area_per_point });
            }
        }
        for entry in &mut self.clouds {
            let wanted: Vec<MirrorPoints> =
                self.objects.markings.iter().filter(|m| m.key == entry.key).map(|m| m.points.clone()).collect();
            match &entry.marking {
                Some((under_way, progress)) if *under_way != wanted => progress.cancel(),
                Some(_) => {}
                None if entry.marked != wanted => {
                    let progress = Arc::<Progress>::default();
                    entry.marking = Some((wanted.clone(), progress.clone()));
                    let (key, cloud, source) = (entry.key, entry.cloud.clone(), entry.source.clone());
                    self.effects.push(Effect::MarkPoints { key, cloud, source, wanted, progress });
                }
                None => {}
            }
        }
    }

    fn on_marked(&mut self, key: CloudKey, wanted: Vec<MirrorPoints>, result: Result<Option<Vec<Marked>>, String>) {
        let Some(entry) = self.cloud_mut(key) else { return };
        entry.marking = None;
        match result {
            Ok(None) => {
                let now: Vec<&MirrorPoints> =
                    self.objects.markings.iter().filter(|m| m.key == key).map(|m| &m.points).collect();
                // Unless it was overtaken by another wish, someone has stopped it: what reflects already stays.
                if now.into_iter().eq(&wanted) {
                    let kept = self.cloud(key).map_or(Vec::new(), |entry| entry.marked.clone());
                    self.rewrite_objects(|objects| {
                        objects.markings.retain(|marking| marking.key != key || kept.contains(&marking.points));
                    });
                }
            }
            Ok(Some(marked)) => {
                let marked = Arc::new(marked);
                (entry.marked, entry.marks) = (wanted, marked.clone());
                let (cloud, classes) = (entry.cloud.clone(), class_column(&entry.cloud));
                let name = cloud.name.clone();
                let count: u64 = marked.iter().map(|marked| marked.count).sum();
                self.render(Command::Mark { key, cloud, classes, marked });
                self.revision += 1;
                self.log(json!({ "event": "marked", "name": name, "points": count }));
            }
            Err(error) => {
                entry.marked = wanted.clone();
                self.rewrite_objects(|objects| {
                    objects.markings.retain(|marking| marking.key != key || !wanted.contains(&marking.points));
                });
                self.say(Level::Error, error);
            }
        }
    }

    /// Markings of scene files whose clouds have come.
    fn place_awaited_markings(&mut self) {
        for points in std::mem::take(&mut self.awaited_markings) {
            let entry = self.clouds.iter().find(|entry| points.is_of(&entry.input, &entry.cloud.name));
            match entry.map(|entry| entry.key) {
                Some(key) => {
                    self.rewrite_objects(|objects| objects.markings.push(Marking { key, points: points.clone() }));
                }
                None => self.say(Level::Warning, format!("mirror points: no cloud is called `{}`", points.cloud)),
            }
        }
    }

    fn on_figures(&mut self, key: CloudKey, basis: Basis, figures: Figures) {
        let Some(entry) = self.cloud_mut(key) else { return };
        entry.figures_under_way = false;
        let source = entry.source.clone().filter(|_| entry.streamed.is_none());
        if let (Some(attribute), Some(source)) = (figures.plan.missing_column(&entry.cloud), source) {
            // What is shown stays until the column has come.
            entry.figures_basis = Some(basis);
            if let Entry::Vacant(read) = entry.column_reads.entry(attribute) {
                let progress = Arc::<Progress>::default();
                read.insert(Some(progress.clone()));
                self.effects.push(Effect::ReadColumn { key, source, attribute, progress });
            }
            return;
        }
        let same_plan = entry.figures.as_ref().is_some_and(|old| old.plan == figures.plan);
        let same_points = entry.figures_basis.as_ref().is_some_and(|old| {
            old.doublings == basis.doublings && old.is_read == basis.is_read && old.late_columns == basis.late_columns
        });
        // Chunks of streamed clouds are coloured as they come.
        let same_points = same_points || entry.is_indexed();
        entry.figures_basis = Some(basis);
        let outline_changed = entry.figures.as_ref().is_none_or(|old| old.outline != figures.outline);
        let (cloud, up, plan) = (entry.cloud.clone(), entry.up, figures.plan.clone());
        let warning = figures.warning.clone();
        entry.figures = Some(figures);
        if !(same_plan && same_points) {
            self.log(json!({ "event": "colored", "name": cloud.name, "by": plan.label }));
            self.render(Command::Color { key, cloud, plan, up });
            self.revision += 1;
        }
        if let Some(warning) = warning.filter(|warning| !self.warned.contains(warning)) {
            self.say(Level::Warning, warning.clone());
            self.warned.push(warning);
        }
        if outline_changed {
            self.frame_while_unplaced(self.bounds());
        }
    }

    fn on_column(&mut self, key: CloudKey, attribute: usize, result: Result<BTreeMap<u64, Arc<Column>>, String>) {
        let Some(entry) = self.cloud_mut(key) else { return };
        match result {
            Ok(columns) => {
                entry.column_reads.remove(&attribute);
                for chunk in &mut entry.cloud.chunks {
                    put_column(chunk, attribute, &columns);
                }
                entry.late_columns.insert(attribute, columns);
                let classes = class_column(&entry.cloud);
                if classes == Some(attribute) {
                    entry.marked = Vec::new();
                    for chunk in entry.cloud.chunks.clone() {
                        self.render(Command::Chunk { key, chunk, classes });
                    }
                }
            }
            Err(error) => {
                entry.column_reads.insert(attribute, None);
                let name = entry.cloud.attributes.get(attribute).map_or(String::new(), |known| known.name.clone());
                self.say(Level::Error, format!("{name}: {error}"));
            }
        }
    }

    /// Attributes that are being read now, with how far they are.
    pub fn columns_under_way(&self) -> impl Iterator<Item = (&str, &Progress)> {
        self.clouds.iter().flat_map(|entry| {
            let reads = entry.column_reads.iter();
            let reads = reads.filter_map(|(attribute, progress)| Some((*attribute, progress.as_deref()?)));
            reads.map(|(attribute, progress)| (entry.cloud.attributes[attribute].name.as_str(), progress))
        })
    }

    // ---- camera ----

    /// Of what is visible, without stray points.
    pub fn bounds(&self) -> Bounds {
        let of = |entry: &CloudEntry| entry.figures.as_ref().map_or(entry.bounds, |figures| figures.bounds);
        let visible = self.clouds.iter().filter(|entry| entry.is_visible && entry.points > 0);
        let mut bounds = visible.fold(Bounds::EMPTY, |all, entry| all.union(of(entry)));
        if !bounds.is_empty() {
            self.objects
                .mirrors
                .iter()
                .flat_map(|placed| mirrors::outline(&placed.mirror))
                .for_each(|p| bounds.include(p));
        }
        bounds
    }

    pub fn up(&self) -> DVec3 {
        match self.settings.view.up {
            scene::UpAxis::Y => DVec3::Y,
            scene::UpAxis::Z => DVec3::Z,
            scene::UpAxis::Auto => self.clouds.first().map_or(DVec3::Z, |entry| entry.up),
        }
    }

    pub fn aspect(&self) -> f64 {
        f64::from(self.view_size[0].max(1)) / f64::from(self.view_size[1].max(1))
    }

    /// What sticks out furthest of the visible clouds: what framing has to keep in the picture.
    pub fn outline(&self) -> Vec<DVec3> {
        let visible = self.clouds.iter().filter(|entry| entry.is_visible);
        let of = |entry: &CloudEntry| match &entry.figures {
            Some(figures) => figures.outline.clone(),
            None if entry.bounds.is_empty() => Vec::new(),
            None => entry.bounds.corners().to_vec(),
        };
        let mirrors = self.objects.mirrors.iter().flat_map(|placed| mirrors::outline(&placed.mirror));
        visible.flat_map(of).chain(mirrors).collect()
    }

    pub fn framed(&self, outline: &[DVec3], view: StandardView) -> Camera {
        Camera::framing(outline, view, self.up(), self.settings.view.field_of_view, self.aspect())
    }

    /// Shows everything unless someone has chosen the camera: the clouds' outlines, or `bounds` while none is known.
    pub(super) fn frame_while_unplaced(&mut self, bounds: Bounds) {
        if self.camera_is_placed {
            return;
        }
        if self.clouds.iter().any(|entry| entry.is_visible && entry.figures.is_some()) {
            self.camera = self.framed(&self.outline(), StandardView::Isometric);
        } else if !bounds.is_empty() {
            self.camera = self.framed(&bounds.corners(), StandardView::Isometric);
        }
    }

    /// Pixels of the picture.
    pub fn set_view_size(&mut self, size: [u32; 2]) {
        if self.view_size != size {
            self.view_size = size;
            let bounds = self.bounds();
            self.frame_while_unplaced(bounds);
        }
    }

    /// Moves the camera at once, perhaps with other parameters: one step of undo.
    pub fn jump(&mut self, settings: Settings, camera: Camera) {
        self.history.before_jump(&self.settings, &self.objects, self.camera);
        self.settings = settings;
        self.camera = camera;
        self.camera_is_placed = true;
        self.history.after_jump(&self.settings, &self.objects);
        self.navigation.camera_moved();
    }

    pub fn lens(&self) -> Lens {
        Lens::new(&self.camera, &self.settings.view, self.view_size)
    }

    // ---- frames ----

    /// Whether frames in the wanted quality take too long to move by.
    fn is_slow(&self) -> bool {
        // Below 20 frames a second a turn no longer feels like a turn.
        const TOO_LONG: f64 = 50.0;
        self.careful_milliseconds > TOO_LONG
    }

    /// Sends the frame that is wanted now, unless it is drawn or shown already. Returns when to look again.
    pub fn request_frame(&mut self) -> Option<Duration> {
        let is_first = self.shown.is_none();
        let is_empty = self.clouds.is_empty() || is_first && self.points() == 0 && self.is_loading();
        if self.adapter.is_none() || self.view_size.contains(&0) || is_empty {
            return None;
        }
        let mut settings = self.settings.clone();
        if self.raw_colors {
            settings.edl.strength = 0.0;
            settings.light.by = Lighting::Colors;
        }
        let settings = settings.drawn();
        let mut wanted = FrameRequest {
            camera: self.camera,
            settings,
            mirrors: self.all_mirrors().map(|(_, mirror)| mirror.clone()).collect(),
            lights: self.lights(),
            sky_is_open: self.sky_is_open(),
            size: self.view_size,
            revision: self.revision,
            hurried: false,
            light_may_lag: self.light_may_lag(),
        };
        let rest = self.navigation.time_to_rest();
        let is_mirror = self.selected.is_some_and(|id| self.objects.mirror(id).is_some());
        let is_dragged = is_mirror && self.gizmo.is_dragging();
        // The first picture comes soon, and a better one after it.
        let is_hurried = is_first || rest.is_some() && self.is_slow();
        let hurried = is_hurried.then(|| render_thread::hurried(&wanted.settings, is_dragged));
        if let Some(settings) = hurried.filter(|hurried| *hurried != wanted.settings) {
            wanted.settings = settings;
            wanted.hurried = true;
        }
        if self.requested.as_ref() == Some(&wanted) {
            self.note_rest(wanted.hurried);
            return rest;
        }
        let only_points_changed = self.requested.as_ref().is_some_and(|requested| {
            FrameRequest { revision: wanted.revision, ..requested.clone() } == wanted && self.points_come()
        });
        if only_points_changed {
            if self.frames_under_way > 0 {
                // Its report wakes the window.
                return None;
            }
            let since = self.requested_at.map_or(LOADING_FRAME_INTERVAL, |at| at.elapsed());
            if since < LOADING_FRAME_INTERVAL {
                return Some(LOADING_FRAME_INTERVAL - since);
            }
        }
        self.is_at_rest = false;
        self.requested = Some(wanted.clone());
        self.requested_at = Some(Instant::now());
        self.frames_under_way += 1;
        if is_first {
            self.jobs.iter().for_each(|job| job.lookout.draw_first(true));
        }
        self.render(Command::Frame(Box::new(wanted)));
        rest
    }

    /// The frame that is wanted now, as far as it has been asked for.
    pub fn wanted_frame(&self) -> Option<&FrameRequest> {
        self.requested.as_ref()
    }

    /// The frame on the screen, if it is the final one and nothing is under way that would change it.
    pub fn still_frame(&self) -> Option<&FrameRequest> {
        let is_busy = |entry: &CloudEntry| entry.marking.is_some() || entry.figures_under_way;
        let is_still = self.is_at_rest && !self.points_come() && self.sampling.is_none() && self.inspection.is_none();
        let shown = self.shown.as_ref().filter(|_| is_still && !self.clouds.iter().any(is_busy))?;
        (self.requested.as_ref() == Some(&shown.request) && !shown.request.hurried).then_some(&shown.request)
    }

    /// Logs when the picture that is wanted is the one that is shown, and nothing is under way that could change it.
    fn note_rest(&mut self, is_hurried: bool) {
        let is_known = self.surroundings_known == self.surroundings_asked;
        let is_shown = self.frames_under_way == 0 && self.shown.is_some() && !is_hurried;
        if !self.is_at_rest && is_shown && is_known && !self.points_come() {
            self.is_at_rest = true;
            self.log(json!({ "event": "settled" }));
        }
    }

    /// What the render thread says, except the picture itself, which the window has taken.
    pub fn on_report(&mut self, report: Report) {
        if matches!(report, Report::Frame(_) | Report::NotDrawn(_) | Report::Lost(_)) {
            self.jobs.iter().for_each(|job| job.lookout.draw_first(false));
        }
        match report {
            Report::Ready { adapter } => {
                self.log(json!({ "event": "ready", "adapter": adapter }));
                self.adapter = Some(adapter);
                // The window is painted before the frame is asked for.
                let has_points = self.points() > 0;
                self.jobs.iter().for_each(|job| job.lookout.draw_first(has_points));
            }
            // Of clouds that have been removed since.
            Report::Frame(_) if self.clouds.is_empty() => self.frames_under_way = 0,
            Report::Frame(frame) => {
                // Those that were overtaken are never drawn.
                self.frames_under_way = u32::from(self.requested.as_ref() != Some(&frame.request));
                if !frame.request.hurried {
                    self.careful_milliseconds = frame.total_milliseconds;
                }
                self.keep_pace(frame.total_milliseconds);
                self.log(json!({
                    "event": "frame", "points": frame.stats.points_drawn, "ms": frame.total_milliseconds,
                }));
                if !frame.request.hurried {
                    self.figure_history.push(&frame.stats);
                }
                self.shown = Some(Shown {
                    request: frame.request,
                    stats: frame.stats,
                    total_milliseconds: frame.total_milliseconds,
                });
            }
            Report::Picked { pixel, purpose, point } => self.on_picked(pixel, purpose, point),
            Report::Saved(path) => {
                self.log(json!({ "event": "saved", "path": path }));
                self.messages.note(format!("Picture saved: {}", path.display()));
            }
            Report::Captured(captured) => self.on_captured(*captured),
            Report::Measured { request, stats } => self.on_measured(&request, &stats),
            Report::Presented { request, pass, rgba } => self.on_presented(*request, pass, rgba),
            Report::NotJudged(problem) => self.on_not_judged(&problem),
            Report::Problem(problem) => self.say(Level::Error, problem),
            Report::NotDrawn(problem) => {
                self.frames_under_way = 0;
                self.say(Level::Error, problem);
            }
            Report::Lost(problem) => {
                self.log(json!({ "event": "lost", "text": problem }));
                self.fatal = Some(problem);
            }
        }
    }

    // ---- picks ----

    /// World position of a point: the file's own coordinates.
    pub fn world_position(&self, picked: PickedPoint) -> Option<DVec3> {
        let holds =
            |chunk: &&Chunk| (chunk.first_point..chunk.first_point + chunk.len() as u64).contains(&picked.point);
        let cloud = &self.cloud(picked.key)?.cloud;
        let chunk = cloud.chunks.iter().find(holds)?;
        Some(cloud.world_position(chunk, (picked.point - chunk.first_point) as usize))
    }

    /// Normal of a point, if it has one.
    pub fn normal_at(&self, picked: PickedPoint) -> Option<DVec3> {
        let chunks = &self.cloud(picked.key)?.cloud.chunks;
        let chunk = chunks
            .iter()
            .find(|chunk| (chunk.first_point..chunk.first_point + chunk.len() as u64).contains(&picked.point))?;
        let normal = chunk.normals.as_ref()?[(picked.point - chunk.first_point) as usize];
        Some(cloud::unpack_normal(normal)?.as_dvec3())
    }

    fn on_picked(&mut self, pixel: [u32; 2], purpose: PickPurpose, point: Option<PickedPoint>) {
        let found = point.and_then(|point| Some((point, self.world_position(point)?)));
        // Where a mirror is drawn by its formula there is no point, and where it stands in front the point is not meant.
        let lens = self.lens();
        let depth = |world: DVec3| lens.forward().dot(world - self.camera.eye);
        let mirror = self.mirror_at(pixel);
        let mirror = mirror.filter(|(_, at)| found.is_none_or(|(_, world)| depth(*at) <= depth(world)));
        let world = mirror.map(|(_, world)| world).or(found.map(|(_, world)| world));
        match (purpose, world) {
            (PickPurpose::Hover, world) => {
                self.navigation.on_hover(pixel, world);
                self.apply_pending_zoom(true);
            }
            (PickPurpose::Pivot, Some(world)) => {
                let mut camera = self.camera;
                camera.recenter(world);
                self.jump(self.settings.clone(), camera);
                self.navigation.show_pivot();
                self.log(json!({ "event": "pivot", "world": world.to_array() }));
            }
            (PickPurpose::Pivot, None) => self.messages.note("No point there to turn about"),
            (PickPurpose::Select, _) => match (mirror, found) {
                (Some((id, _)), _) => {
                    self.selected = Some(id);
                    self.log(json!({ "event": "selected", "mirror": self.objects.mirror(id).map(|m| &m.name) }));
                }
                (None, Some((point, world))) => {
                    self.selected = None;
                    self.select(point, world);
                }
                (None, None) => {}
            },
        }
    }

    /// The mirror under a pixel, and where: by the points that stand for it.
    fn mirror_at(&self, pixel: [u32; 2]) -> Option<(ObjectId, DVec3)> {
        let lens = self.lens();
        let hit = |placed: &Placed| {
            let sample = self.samples.get(&placed.id)?;
            let ray = self.sight_line(pixel, sample.chunks.clone());
            Some((placed.id, inspection::cast(&ray)?.position))
        };
        let depth = |world: DVec3| lens.forward().dot(world - self.camera.eye);
        let hits = self.objects.mirrors.iter().filter_map(hit);
        hits.min_by(|a, b| depth(a.1).total_cmp(&depth(b.1)))
    }

    fn select(&mut self, point: PickedPoint, world: DVec3) {
        let Some(entry) = self.cloud(point.key) else { return };
        let is_streamed = entry.streamed.is_some();
        let source = entry.source.clone().filter(|_| !is_streamed);
        let cloud = entry.cloud.name.clone();
        let record = source.is_none().then(|| Ok(loaded_attributes(&entry.cloud, point.point)));
        if self.picks.len() == 2 {
            self.picks.remove(0);
        }
        self.log(json!({ "event": "picked", "cloud": cloud, "point": point.point, "world": world.to_array() }));
        self.picks.push(Pick { point, cloud, world, record, is_streamed });
        if let Some(source) = source {
            self.effects.push(Effect::ReadRecord { picked: point, source });
        }
        if let Some(distance) = self.distance() {
            self.log(json!({
                "event": "distance", "total": distance.total, "horizontal": distance.horizontal,
                "vertical": distance.vertical,
            }));
        }
    }

    /// Between the two picked points.
    pub fn distance(&self) -> Option<Distance> {
        let [first, second] = self.picks.as_slice() else { return None };
        let difference = second.world - first.world;
        let vertical = difference.dot(self.up());
        let horizontal = (difference - self.up() * vertical).length();
        Some(Distance { total: difference.length(), horizontal, vertical })
    }

    // ---- words for the outside ----

    pub fn title(&self) -> String {
        let points = self.all_points();
        match self.inputs().as_slice() {
            [] => "glint".into(),
            [one] => format!("{} - {} points - glint", short_name(one), grouped(points)),
            several => format!("{} clouds - {} points - glint", several.len(), grouped(points)),
        }
    }

    /// The words of the command line that give what is visible.
    pub fn inputs(&self) -> Vec<String> {
        let mut inputs: Vec<String> = Vec::new();
        for entry in self.clouds.iter().filter(|entry| entry.is_visible) {
            if !inputs.contains(&entry.input) {
                inputs.push(entry.input.clone());
            }
        }
        inputs
    }
}

/// World units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    pub total: f64,
    pub horizontal: f64,
    /// Along the up axis; negative if the second point is lower.
    pub vertical: f64,
}

/// The last part of a path, or all of another name.
pub fn short_name(input: &str) -> &str {
    if input.starts_with("five-mirrors/") {
        return input;
    }
    std::path::Path::new(input).file_name().and_then(|name| name.to_str()).unwrap_or(input)
}

fn put_column(chunk: &mut Chunk, attribute: usize, columns: &BTreeMap<u64, Arc<Column>>) {
    let Some(column) = columns.get(&chunk.first_point).filter(|column| column.len() == chunk.len()) else { return };
    if chunk.columns.len() <= attribute {
        chunk.columns.resize(attribute + 1, None);
    }
    chunk.columns[attribute] = Some(column.clone());
}

/// What is known of a point without a file.
fn loaded_attributes(cloud: &Cloud, point: u64) -> Vec<(String, String)> {
    let chunk =
        cloud.chunks.iter().find(|chunk| (chunk.first_point..chunk.first_point + chunk.len() as u64).contains(&point));
    let Some(chunk) = chunk else { return Vec::new() };
    let index = (point - chunk.first_point) as usize;
    let mut attributes = Vec::new();
    if let Some(colors) = &chunk.colors {
        let [red, green, blue, _] = colors[index];
        attributes.push(("color".into(), format!("{red} {green} {blue}")));
    }
    if let Some(normal) = chunk.normals.as_ref().and_then(|normals| cloud::unpack_normal(normals[index])) {
        attributes.push(("normal".into(), format!("{:.4} {:.4} {:.4}", normal.x, normal.y, normal.z)));
    }
    for (attribute, column) in cloud.attributes.iter().zip(&chunk.columns) {
        if let Some(column) = column {
            attributes.push((attribute.name.clone(), column.text(index)));
        }
    }
    attributes
}

#[cfg(test)]
impl State {
    /// A scene of two points that is completely read, for tests of the panels.
    pub fn with_two_points() -> Self {
        use super::preferences::Preferences;
        let mut state = Self::new(Preferences::default());
        let job = state.add_job(&[], Arc::default(), Arc::default());
        state.on_loading(
            job,
            world::Event::Opened {
                cloud: 0,
                name: "cloud.ply".into(),
                input: "cloud.ply".into(),
                source: None,
                attributes: Vec::new(),
                grid: None,
                expected_points: 2,
                up: DVec3::Z,
                provisional_radius: 0.0,
                warnings: Vec::new(),
            },
        );
        let chunk = cloud::Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [10.0, 10.0, 0.0]]);
        state.on_loading(job, world::Event::Chunk { cloud: 0, chunk });
        state.on_loading(job, world::Event::Finished);
        state.history.watch(&state.settings, &state.objects, false);
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cloud with one attribute whose header has been read, by job 0.
    fn opened() -> (State, CloudKey) {
        let mut state = State::new(Preferences::default());
        let job = state.add_job(&[], Arc::default(), Arc::default());
        let event = world::Event::Opened {
            cloud: 0,
            name: "cloud.ply".into(),
            input: "cloud.ply".into(),
            source: None,
            attributes: vec![cloud::Attribute { name: "intensity".into(), column_type: cloud::ColumnType::U8 }],
            grid: None,
            expected_points: 3,
            up: DVec3::Z,
            provisional_radius: 0.0,
            warnings: Vec::new(),
        };
        state.on_loading(job, event);
        let key = state.clouds[0].key;
        (state, key)
    }

    #[test]
    fn a_column_that_cannot_be_read_is_no_longer_under_way() {
        let (mut state, key) = opened();
        state.clouds[0].column_reads.insert(0, Some(Arc::default()));
        assert_eq!(state.columns_under_way().map(|(name, _)| name).collect::<Vec<_>>(), ["intensity"]);
        state.on_found(Found::Column { key, attribute: 0, result: Err("gone".into()) });
        assert_eq!(state.columns_under_way().count(), 0);
        assert!(state.messages.all.last().is_some_and(|message| message.text == "intensity: gone"));
    }

    #[test]
    fn a_cloud_that_is_opened_as_a_mirror_reflects_when_it_has_come_and_is_no_step_of_undo() {
        let (mut state, key) = opened();
        state.history.watch(&state.settings, &state.objects, false);
        state.await_marking(MirrorPoints::whole("cloud.ply".into()));
        state.await_marking(MirrorPoints::whole("gone.ply".into()));
        let chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0; 3]]);
        state.on_loading(0, world::Event::Chunk { cloud: 0, chunk });
        state.sync_objects();
        assert!(state.objects.markings.is_empty(), "its points are still to come");
        state.on_loading(0, world::Event::Finished);
        assert_eq!(state.objects.markings, [Marking { key, points: MirrorPoints::whole("cloud.ply".into()) }]);
        assert!(state.messages.all.last().is_some_and(|message| message.text.contains("gone.ply")));
        assert!(!state.history.undo(&mut state.settings, &mut state.objects, &mut state.camera));
        state.sync_objects();
        assert!(state.effects.iter().any(|effect| matches!(effect, Effect::MarkPoints { .. })));
        state.remove_cloud(key);
        assert!(state.objects.markings.is_empty());
    }

    #[test]
    fn a_cloud_without_points_leaves_the_renderer_too() {
        let (mut state, removed) = opened();
        state.on_loading(0, world::Event::Finished);
        assert!(state.clouds.is_empty());
        let is_removal = |effect: &Effect| matches!(effect, Effect::Render(Command::Remove { key }) if *key == removed);
        assert!(state.effects.iter().any(is_removal));
    }

    #[test]
    fn a_frame_that_cannot_be_drawn_ends_neither_the_window_nor_later_frames() {
        let (mut state, _) = opened();
        state.on_report(Report::Ready { adapter: "any".into() });
        state.request_frame();
        assert_eq!(state.frames_under_way, 0, "there is nothing to show yet");
        let chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0; 3]]);
        state.on_loading(0, world::Event::Chunk { cloud: 0, chunk });
        state.request_frame();
        assert_eq!(state.frames_under_way, 1);
        assert!(state.requested.as_ref().is_some_and(|request| request.hurried), "the first picture comes soon");
        state.on_report(Report::NotDrawn("too large".into()));
        assert_eq!((state.frames_under_way, state.fatal.as_deref()), (0, None));
    }
}
