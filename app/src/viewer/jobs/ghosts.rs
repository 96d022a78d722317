//! The search for mirrors and ghosts in open files, and the work of putting ghosts back.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use cloud::Progress;
use codec::Source;
use ghost::{Found, Gauge, Kind, Residual, Verdicts};
use glam::DVec3;
use scene::{CloudSettings, Mirror, Settings};
use world::half_of;

use crate::shared::export::{Place, lack};
use crate::shared::ghosts::{self, Looked};
use crate::viewer::objects::ObjectId;

/// What a person has chosen for the search.
#[derive(Clone, Debug, PartialEq)]
pub struct GhostsDraft {
    /// X,Y,Z of the scanner; empty if the files know it.
    pub station: String,
    /// Whether planes, balls and columns are looked for besides the mirrors of the scene.
    pub finds: bool,
    /// The file for points that are put back.
    pub output: String,
}

impl Default for GhostsDraft {
    fn default() -> Self {
        Self { station: String::new(), finds: true, output: String::new() }
    }
}

/// What the panel shows of ghosts, and the work under way.
#[derive(Default)]
pub struct Ghosts {
    pub draft: GhostsDraft,
    pub under_way: Option<Arc<Progress>>,
    pub seen: Option<Seen>,
    pub live: Live,
}

/// How well the mirrors of the scene fit as they stand now.
#[derive(Default)]
pub struct Live {
    /// What was measured last of each, and as which mirror.
    pub measured: BTreeMap<ObjectId, (Mirror, Residual)>,
    /// Measures one mirror at a time, so that one that is dragged is always up to date.
    pub is_measuring: bool,
    /// The mirror that is being fitted.
    pub fitting: Option<ObjectId>,
}

/// Measures a mirror, or moves it to where it fits best and measures it there.
pub struct GaugeWork {
    pub gauge: Arc<Gauge>,
    pub id: ObjectId,
    pub mirror: Mirror,
    pub fits: bool,
}

/// A mirror that was measured, or fitted.
pub struct Gauged {
    pub gauge: Arc<Gauge>,
    pub id: ObjectId,
    pub before: Mirror,
    /// What it was moved to, if it was to be fitted; `None` if too few points were seen in it.
    pub fitted: Option<Option<Mirror>>,
    /// Of the mirror as it was moved.
    pub residual: Residual,
}

impl GaugeWork {
    pub fn run(self) -> Gauged {
        let Self { gauge, id, mirror, fits } = self;
        let fitted = fits.then(|| gauge.fitted(&mirror));
        let residual = gauge.measured(fitted.as_ref().and_then(Option::as_ref).unwrap_or(&mirror));
        Gauged { gauge, id, before: mirror, fitted, residual }
    }
}

/// What a search has found.
pub struct Seen {
    pub looked: Looked,
    /// Of each mirror that was found or given.
    pub decisions: Vec<Decision>,
    pub sources: Vec<Arc<Source>>,
    /// The number of ghosts of each mirror, and the median distance of their unfolded places from surfaces.
    pub figures: Vec<(u64, Option<f64>)>,
    /// The ghosts and the undecided points of all mirrors that are not refused.
    pub counts: [u64; 2],
}

/// What a person thinks of a mirror.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    Open,
    /// The mirror is in the scene, as long as the object is there.
    Accepted(ObjectId),
    Refused,
}

impl Seen {
    /// The first mirrors are those of the scene.
    pub fn new(looked: Looked, of_scene: Vec<ObjectId>, sources: Vec<Arc<Source>>) -> Self {
        let mut decisions: Vec<Decision> = of_scene.into_iter().map(Decision::Accepted).collect();
        decisions.resize(looked.found.len(), Decision::Open);
        let figures = (0..looked.found.len()).map(|mirror| looked.verdicts.of_mirror(mirror)).collect();
        let counts = [Kind::Ghost, Kind::Undecided].map(|kind| looked.verdicts.count(kind));
        Self { looked, decisions, sources, figures, counts }
    }

    /// The verdicts by all mirrors that are not refused.
    pub fn verdicts(&self) -> Verdicts {
        self.looked.verdicts.of_mirrors(|mirror| !self.is_refused(mirror))
    }

    pub fn is_refused(&self, mirror: usize) -> bool {
        self.decisions[mirror] == Decision::Refused
    }

    /// The files and scans that were read, in the order of the verdicts.
    pub fn places(&self) -> impl Iterator<Item = Place> {
        self.sources.iter().map(|source| (source.info().path.clone(), source.info().scan_number()))
    }
}

/// Work on ghosts that a thread carries out.
pub struct GhostWork {
    pub task: GhostTask,
    pub settings: Box<Settings>,
    pub progress: Arc<Progress>,
}

pub enum GhostTask {
    Look {
        /// The words that opened the clouds, and where these stand.
        inputs: Vec<String>,
        own: Vec<CloudSettings>,
        station: Option<DVec3>,
        given: Vec<(ObjectId, Found)>,
        finds: bool,
    },
    PutBack {
        sources: Vec<Arc<Source>>,
        verdicts: Verdicts,
        output: PathBuf,
    },
}

/// How it ended; nothing came out if it was cancelled.
pub enum GhostOutcome {
    Looked(Result<Option<Box<Seen>>, String>),
    PutBack {
        output: PathBuf,
        /// Warnings.
        result: Result<Option<Vec<String>>, String>,
    },
    Gauged(Box<Gauged>),
}

impl GhostWork {
    pub fn run(self) -> GhostOutcome {
        let Self { task, settings, progress } = self;
        let memory = half_of(settings.stream.host_bytes);
        match task {
            GhostTask::Look { inputs, own, station, given, finds } => {
                let sources = open(&inputs, own, &settings);
                GhostOutcome::Looked(sources.and_then(|sources| {
                    let (ids, given): (Vec<_>, Vec<_>) = given.into_iter().unzip();
                    let named: Vec<DVec3> = station.into_iter().collect();
                    let looked = ghosts::look(&sources, &named, given, finds, &progress);
                    let looked = looked.map_err(|error| format!("{error:#}"))?;
                    Ok(looked.map(|looked| Box::new(Seen::new(looked, ids, sources))))
                }))
            }
            GhostTask::PutBack { sources, verdicts, output } => {
                let result = ghosts::write(&sources, &verdicts, &output, true, memory, &progress);
                let lost = world::lost_tiles(&sources).cloned();
                let told = |(warnings, missing): (Vec<String>, u64)| {
                    warnings.into_iter().chain(lost).chain(lack(&output, missing)).collect::<Vec<_>>()
                };
                let result = result.map(|written| written.map(told)).map_err(|error| format!("{error:#}"));
                // Whoever waits for the end of the work waits for the file to be gone, or whole.
                drop(progress);
                GhostOutcome::PutBack { output, result }
            }
        }
    }
}

fn open(inputs: &[String], own: Vec<CloudSettings>, settings: &Settings) -> Result<Vec<Arc<Source>>, String> {
    let (request, memory) = (world::resolve_open(inputs, own, settings), half_of(settings.stream.host_bytes));
    let mut sources = Vec::new();
    for input in &request.inputs {
        if input.files().is_empty() {
            return Err(format!("{}: not a file; ghosts are looked for in files", input.name()));
        }
        for file in input.files() {
            sources.extend(request.open(input, file, memory)?);
        }
    }
    Ok(sources)
}
