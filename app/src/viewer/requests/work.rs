//! The work that the session asks for and that needs neither the window nor the render thread: reading, counting,
//! sampling, tracing, writing. The window runs it on threads of its own, and tests run it in place. Both call
//! `Work::run`.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::Arc;

use cloud::{Chunk, Cloud, Column, Placement, PointTest, Progress};
use glam::DVec3;
use scene::{CloudSettings, Measurement, Mirror, MirrorNormals, MirrorPoints, Settings, Shape, Stream};
use world::mirrors::{self, Marked};
use world::{AutoLight, CloudKey, IndexEntry, LoadedParts, Moved, Own};

use crate::shared::export;
use crate::shared::measuring::{self, Outcome, PointError};
use crate::system::picture_file;
use crate::system::progress_bar::Stage;
use crate::viewer::jobs::comparisons::{Comparing, Comparison};
use crate::viewer::jobs::ghosts::{GaugeWork, GhostOutcome, GhostWork};
use crate::viewer::jobs::point_errors::PointWork;
use crate::viewer::jobs::process::{self, Ended, Leash};
use crate::viewer::jobs::slices::{ProfileFound, ProfileWork};
use crate::viewer::jobs::study_file;
use crate::viewer::jobs::sweep_files::SweepResult;
use crate::viewer::jobs::tasks::{Answer, Task};
use crate::viewer::objects::ObjectId;
use crate::viewer::objects::figures::{Basis, Figures};
use crate::viewer::objects::inspection;
use crate::viewer::picture::capture::Captured;
use crate::viewer::picture::messages::PickedPoint;
use crate::viewer::requests::autosave::{Home, Keeper};

/// The parts of a cloud of some 50 thousand points that tell its noise.
const PARTS_FOR_NOISE: usize = 6;

/// Work that the session asks for.
pub enum Work {
    FindFigures {
        key: CloudKey,
        cloud: Cloud,
        basis: Basis,
        up: DVec3,
        /// For a streamed cloud, its earlier figures: colours and bounds stay, and only the counts are new.
        kept: Option<Box<Figures>>,
    },
    /// Measures the noise of a cloud's points.
    MeasureNoise {
        key: CloudKey,
        cloud: Cloud,
    },
    /// Estimates the radii of the points that a test shows.
    FitRadii {
        key: CloudKey,
        cloud: Cloud,
        up: DVec3,
        scanner: Option<DVec3>,
        settings: Box<Settings>,
        test: PointTest,
        progress: Arc<Progress>,
    },
    /// Finds out how sure the surface of a cloud is.
    FindErrors {
        key: CloudKey,
        cloud: Cloud,
    },
    /// Turns and moves the points of a cloud.
    Place {
        key: CloudKey,
        own: Own,
        placement: Option<Placement>,
    },
    ReadColumn {
        key: CloudKey,
        source: Arc<codec::Source>,
        attribute: usize,
        progress: Arc<Progress>,
    },
    ReadRecord {
        picked: PickedPoint,
        /// The number of the point in the file.
        record: u64,
        source: Arc<codec::Source>,
    },
    /// Finds how far a picked point may be off the surface.
    FindPointError(Box<PointWork>),
    SampleMirror {
        id: ObjectId,
        mirror: Mirror,
        /// The area that each sample covers, in squared world units. It matches the points around the mirror.
        area_per_point: f64,
    },
    /// Reads the mesh of a mirror that is to be added.
    ReadMesh(Shape),
    /// Finds the points of a cloud that will reflect.
    MarkPoints {
        key: CloudKey,
        cloud: Cloud,
        source: Option<Arc<codec::Source>>,
        wanted: Vec<MirrorPoints>,
        progress: Arc<Progress>,
    },
    /// Counts the points of a cloud that would reflect.
    CountPoints {
        cloud: Cloud,
        source: Option<Arc<codec::Source>>,
        wanted: MirrorPoints,
    },
    /// Finds out whether the sky above the shown points is open. `asked` is the number of the question, which comes
    /// back with the answer.
    FindSurroundings {
        asked: u32,
        clouds: Vec<Cloud>,
        up: DVec3,
    },
    /// Carries out a measurement on the points of clouds that are loaded and shown. Clouds come with the bounds of their
    /// chunks.
    Measure {
        id: ObjectId,
        measurement: Measurement,
        up: DVec3,
        clouds: Vec<(Cloud, LoadedParts)>,
        test: PointTest,
    },
    /// Finds the points of a profile, or writes it to a file.
    Profile(Box<ProfileWork>),
    /// Finds the surface that a sight line meets.
    Cast(inspection::Ray),
    /// Runs a task of the ray tracer.
    Truth(Box<Task>),
    /// Appends a group to a plan of studies, and writes the group's scene beside the plan.
    AddToStudy {
        plan: PathBuf,
        scene: String,
        group: toml::Table,
    },
    /// Writes the results of a sweep.
    SaveSweep(Box<SweepResult>),
    /// Writes a scene file. One that another program has changed is left as it is: whose checksum is not `known`.
    SaveScene {
        path: PathBuf,
        text: String,
        known: Option<u32>,
    },
    /// Keeps unsaved work against a crash: a scene that belongs to a file. Without text it removes what was kept.
    Keep {
        keeper: Arc<Keeper>,
        text: Option<String>,
        home: Option<Home>,
    },
    /// Writes the points of files that are shown to a new file.
    Export {
        inputs: Vec<String>,
        /// Where clouds stand.
        own: Vec<CloudSettings>,
        test: PointTest,
        /// Values that the files do not have: the file, their name, and those of its points.
        added: Vec<(export::Place, String, Arc<codec::Runs>)>,
        path: PathBuf,
        settings: Box<Settings>,
        progress: Arc<Progress>,
    },
    /// Measures the distances between two clouds.
    Compare(Box<Comparing>),
    /// Looks for ghosts, or puts them back.
    Ghosts(Box<GhostWork>),
    /// Measures or fits a mirror by the points that were seen in it.
    Gauge(Box<GaugeWork>),
    /// Has `glint record` make a film or pictures of a scene; `words` follow the scene.
    Record {
        scene: String,
        words: Vec<OsString>,
        leash: Leash,
    },
    /// Finds out whether something names the columns of a table that is to be opened.
    LookAtTable(PathBuf),
    /// Deletes an index that no cloud uses.
    DeleteIndex(IndexEntry),
    /// Measures the size of the cache of indexes.
    MeasureCache,
}

/// The result of some work.
pub enum Found {
    Figures {
        key: CloudKey,
        basis: Basis,
        figures: Box<Figures>,
    },
    /// The noise in world units; `None` if the points form no surface.
    Noise {
        key: CloudKey,
        noise: Option<f64>,
    },
    /// `radii` is `None` if the work was cancelled.
    Radii {
        key: CloudKey,
        test: PointTest,
        radii: Option<Vec<Arc<Vec<u16>>>>,
    },
    /// How far a picked point may be off the surface, if that is known.
    PointError {
        picked: PickedPoint,
        error: Option<PointError>,
    },
    /// How sure the surface is, by the first records of the chunks.
    Errors {
        key: CloudKey,
        errors: BTreeMap<u64, Arc<Column>>,
    },
    Placed {
        key: CloudKey,
        moved: Moved,
    },
    Column {
        key: CloudKey,
        attribute: usize,
        result: Result<BTreeMap<u64, Arc<Column>>, String>,
    },
    Record {
        picked: PickedPoint,
        record: u64,
        result: Result<Vec<(String, String)>, String>,
    },
    Samples {
        id: ObjectId,
        mirror: Mirror,
        area_per_point: f64,
        /// The mirror's shape with the triangles of its mesh, and its points.
        result: Result<(Shape, Vec<Chunk>), String>,
    },
    Mesh(Result<Shape, String>),
    /// `result` holds `None` if the work was cancelled.
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
        found: AutoLight,
    },
    Measured {
        id: ObjectId,
        measurement: Measurement,
        figures: Outcome,
    },
    Profile(ProfileFound),
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
    /// `result` holds the checksum of what was written.
    SceneSaved {
        path: PathBuf,
        result: Result<u32, String>,
    },
    /// Nothing was written, because the file is not as it was known.
    SceneChanged {
        path: PathBuf,
    },
    Kept(Result<(), String>),
    /// `result` holds `None` if the work was cancelled.
    Exported {
        path: PathBuf,
        result: Result<Option<codec::Exported>, String>,
    },
    Compared(Box<Comparison>),
    Ghosts(GhostOutcome),
    Recording(Stage),
    Recorded(Ended),
    Captured(Captured),
    /// `unnamed` is there if nothing names the columns of the table.
    Table {
        path: PathBuf,
        unnamed: Option<Box<codec::UnnamedTable>>,
    },
    IndexDeleted {
        kept: IndexEntry,
        result: Result<(), String>,
    },
    CacheSize(u64),
}

/// The checksum of the text of a scene file, which tells whether another program has changed it; 0 if it is empty.
pub fn checksum(text: &str) -> u32 {
    crc32fast::hash(text.as_bytes())
}

/// The checksum of a scene file as it was read; 0 if it is empty or not there.
fn checksum_of(file: &Result<String, scene::Error>) -> u32 {
    match file {
        Ok(text) => checksum(text),
        Err(scene::Error::Unreadable { kind: ErrorKind::NotFound, .. }) => 0,
        Err(problem) => crc32fast::hash(problem.to_string().as_bytes()),
    }
}

impl Work {
    /// Returns the name of the thread that does the work.
    pub fn name(&self) -> &'static str {
        match self {
            Self::FindFigures { .. } => "figures",
            Self::MeasureNoise { .. } => "noise",
            Self::FitRadii { .. } => "radii",
            Self::FindErrors { .. } => "certainty",
            Self::Place { .. } => "placement",
            Self::ReadColumn { .. } => "column",
            Self::ReadRecord { .. } => "record",
            Self::FindPointError(_) => "error of a point",
            Self::SampleMirror { .. } => "mirror",
            Self::ReadMesh(_) => "mesh",
            Self::MarkPoints { .. } => "mirror points",
            Self::CountPoints { .. } => "count",
            Self::FindSurroundings { .. } => "surroundings",
            Self::Measure { .. } => "measurement",
            Self::Profile(_) => "profile",
            Self::Cast(_) => "sight line",
            Self::SaveScene { .. } => "scene",
            Self::Keep { .. } => "unsaved work",
            Self::Export { .. } => "export",
            Self::Compare(_) => "comparison",
            Self::Ghosts(_) => "ghosts",
            Self::Gauge(_) => "gauge",
            Self::Record { .. } => "recording",
            Self::Truth(_) => "truth",
            Self::AddToStudy { .. } => "study",
            Self::SaveSweep(_) => "sweep",
            Self::LookAtTable(_) => "table",
            Self::DeleteIndex(_) => "index",
            Self::MeasureCache => "cache",
        }
    }

    /// Does the work and hands the results to `found`: once, or for the truth as often as there is news. `stream` says
    /// where the cache of indexes is.
    pub fn run(self, stream: &Stream, found: impl Fn(Found)) {
        match self {
            Self::FindFigures { key, cloud, basis, up, kept } => {
                let figures = Box::new(match kept {
                    Some(kept) => kept.recounted(&cloud, &basis.test, up),
                    None => Figures::of(&cloud, &basis.color, &basis.test, up),
                });
                found(Found::Figures { key, basis, figures });
            }
            Self::MeasureNoise { key, cloud } => {
                let neighbourhoods = cloud::neighbourhoods(&cloud.chunks, PARTS_FOR_NOISE, &Progress::default());
                found(Found::Noise { key, noise: neighbourhoods.and_then(|found| found.noise) });
            }
            Self::FitRadii { key, cloud, up, scanner, settings, test, progress } => {
                let radii = world::radii_of_shown(&cloud, up, scanner, &settings, &test, &progress);
                found(Found::Radii { key, test, radii });
            }
            Self::FindErrors { key, cloud } => {
                let errors = world::surface_errors(&cloud, &Progress::default()).unwrap_or_default();
                found(Found::Errors { key, errors });
            }
            Self::Place { key, own, placement } => found(Found::Placed { key, moved: own.placed(placement) }),
            Self::ReadColumn { key, source, attribute, progress } => {
                let result = world::read_column(&source, attribute, &progress).map_err(|error| error.to_string());
                found(Found::Column { key, attribute, result });
            }
            Self::FindPointError(work) => found(Found::PointError { picked: work.picked, error: work.run() }),
            Self::ReadRecord { picked, record, source } => {
                let result = source.record(record).map_err(|error| error.to_string());
                found(Found::Record { picked, record, result });
            }
            Self::SampleMirror { id, mirror, area_per_point } => {
                let sample = |shape: Shape| {
                    let samples = mirrors::sample(&Mirror { shape: shape.clone(), ..mirror.clone() }, area_per_point);
                    (shape, samples)
                };
                let result = world::with_mesh(mirror.shape.clone()).map(sample).map_err(|error| error.to_string());
                found(Found::Samples { id, mirror, area_per_point, result });
            }
            Self::ReadMesh(shape) => {
                found(Found::Mesh(world::with_mesh(shape).map_err(|error| error.to_string())));
            }
            Self::MarkPoints { key, cloud, source, wanted, progress } => {
                let mark = |wanted| mirrors::mark(&cloud, source.as_deref(), wanted, &progress);
                let result = wanted.iter().map(mark).collect::<world::Result<Option<Vec<_>>>>();
                let result = result.map_err(|error| format!("{error:#}"));
                found(Found::Marked { key, wanted, result });
            }
            Self::CountPoints { cloud, source, wanted } => {
                let own = MirrorPoints { normals: MirrorNormals::Own, ..wanted.clone() };
                let marked = mirrors::mark(&cloud, source.as_deref(), &own, &Progress::default());
                let result = marked.map(|marked| marked.map_or(0, |marked| marked.count));
                let result = result.map_err(|error| format!("{error:#}"));
                found(Found::Counted { wanted, result });
            }
            Self::FindSurroundings { asked, clouds, up } => {
                let chunks: Vec<Chunk> = clouds.into_iter().flat_map(|cloud| cloud.chunks).collect();
                found(Found::Surroundings { asked, found: AutoLight::around(&chunks, up) });
            }
            Self::Measure { id, measurement, up, clouds, test } => {
                let figures = measuring::of_clouds(&measurement, up, clouds, &test);
                found(Found::Measured { id, measurement, figures });
            }
            Self::Profile(work) => found(Found::Profile(work.run())),
            Self::Cast(ray) => found(Found::Surface(inspection::cast(&ray))),
            Self::SaveScene { path, text, known } => {
                let before = scene::whole_file::read(&path);
                let now = checksum_of(&before);
                match &before {
                    // Whether it has changed cannot be told.
                    Err(problem) if now != 0 && known.is_some() => {
                        return found(Found::SceneSaved { path, result: Err(problem.to_string()) });
                    }
                    _ if known.is_some_and(|known| now != known && now != 0) => {
                        return found(Found::SceneChanged { path });
                    }
                    _ => {}
                }
                // A person may have written the file that is replaced.
                let text = scene::with_comments(&text, &before.unwrap_or_default());
                let written = picture_file::write_text(&path, &text).map_err(|error| format!("{error:#}"));
                let result = written.map(|()| checksum(&text));
                found(Found::SceneSaved { path, result });
            }
            Self::Keep { keeper, text, home } => {
                let kept = keeper.keep(text.as_deref().map(|text| (text, home.as_ref())));
                found(Found::Kept(kept.map_err(|error| format!("{error:#}"))));
            }
            Self::Truth(task) => task.run(|answer| found(Found::Truth(Box::new(answer)))),
            Self::AddToStudy { plan, scene, group } => {
                let result = study_file::add_to_study(&plan, &scene, group).map_err(|error| format!("{error:#}"));
                found(Found::AddedToStudy { plan, result });
            }
            Self::SaveSweep(sweep) => {
                let (folder, result) = sweep.save();
                let result = result.map_err(|error| format!("{error:#}"));
                found(Found::SweepSaved { folder, result });
            }
            Self::Export { inputs, own, test, added, path, settings, progress } => {
                let result = export::write(&inputs, own, &test, &added, &path, &settings, &progress);
                // Whoever waits for the end of the work waits for the file to be gone, or whole.
                drop(progress);
                found(Found::Exported { path, result });
            }
            Self::Compare(comparing) => found(Found::Compared(Box::new(comparing.run()))),
            Self::Ghosts(work) => found(Found::Ghosts(work.run())),
            Self::Gauge(work) => found(Found::Ghosts(GhostOutcome::Gauged(Box::new(work.run())))),
            Self::Record { scene, words, leash } => {
                let ended = process::run(&scene, &words, &leash, |stage| found(Found::Recording(stage)));
                found(Found::Recorded(ended));
            }
            Self::LookAtTable(path) => {
                let unnamed = codec::unnamed_table(&path).map(Box::new);
                found(Found::Table { path, unnamed });
            }
            Self::DeleteIndex(kept) => {
                let result = world::delete(stream, &kept).map_err(|error| error.to_string());
                found(Found::IndexDeleted { kept, result });
            }
            Self::MeasureCache => {
                if let Ok(cache) = world::cache(stream) {
                    found(Found::CacheSize(cache.size()));
                }
            }
        }
    }
}
