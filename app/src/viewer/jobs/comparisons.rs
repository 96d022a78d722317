//! What is compared, and the work of it: the distances of the points of one cloud to another.

use std::path::PathBuf;
use std::sync::Arc;

use cloud::{COMPARED, Cloud, PointTest, Progress};
use codec::{Added, Units};
use glam::DVec3;
use measure::DistanceFigures;
use scene::{CloudSettings, Settings, Strays};
use world::{CloudKey, half_of};

use crate::shared::comparing::{self, Measured, Method, Points, Scales, Side};
use crate::shared::export::{self, free_name, lack};

/// What a person has chosen to compare.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CompareDraft {
    /// The cloud whose points are measured; the first one if none is chosen.
    pub first: Option<CloudKey>,
    pub second: Second,
    pub is_m3c2: bool,
    pub scales: Scales,
    pub core: Option<f64>,
    /// The file for the distances of a streamed cloud.
    pub output: String,
}

/// What the distances are measured to.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Second {
    /// Another cloud that is open, if there is one, else a file that is still to be named.
    #[default]
    Other,
    Cloud(CloudKey),
    File(String),
}

/// What the panel shows of comparisons, and the one under way: which clouds and how, and how far it is.
#[derive(Default)]
pub struct Comparisons {
    pub draft: CompareDraft,
    pub under_way: Option<(String, Arc<Progress>)>,
    pub last: Option<Compared>,
}

/// The result of a comparison.
pub struct Compared {
    /// Which clouds, and how.
    pub what: String,
    pub figures: DistanceFigures,
    /// The share of distances beyond their level of detection, if the method has levels.
    pub significant: Option<f64>,
    /// The median of the half widths of the intervals of 95 %, if the method has levels.
    pub interval: Option<f64>,
}

/// A cloud of a comparison as the window knows it.
#[allow(clippy::large_enum_variant, reason = "a comparison has two")]
pub enum Ends {
    Memory {
        cloud: Cloud,
        up: DVec3,
        units: Units,
    },
    /// Words as on the command line.
    Files(Vec<String>),
}

/// A comparison that a worker thread carries out.
pub struct Comparing {
    pub key: CloudKey,
    pub what: String,
    pub first: Ends,
    pub second: Ends,
    pub method: Method,
    pub core: Option<f64>,
    /// The points of the first cloud that are measured, and those of the second.
    pub tests: [PointTest; 2],
    pub settings: Box<Settings>,
    /// Where clouds stand whose files are read.
    pub own: Vec<CloudSettings>,
    /// The file to write for a streamed cloud.
    pub output: Option<PathBuf>,
    pub progress: Arc<Progress>,
}

/// How it ended; nothing was found if it was cancelled.
pub struct Comparison {
    pub key: CloudKey,
    pub what: String,
    pub result: Result<Option<Outcome>, String>,
}

pub struct Outcome {
    pub measured: Measured,
    /// The new file for a streamed cloud, or why it could not be written.
    pub output: Option<Result<Written, String>>,
    pub warnings: Vec<String>,
}

/// A new file with the points and their distances.
pub struct Written {
    pub path: PathBuf,
    /// The name of the attribute that holds the distances.
    pub attribute: String,
}

impl Ends {
    /// `None` if it was cancelled.
    fn side(
        self,
        test: PointTest,
        settings: &Settings,
        own: &[CloudSettings],
        progress: &Progress,
    ) -> Result<Option<Side>, String> {
        let settings = settings.clone();
        // Strays of clouds in memory are known, and the test finds them.
        let test = test.hiding_strays(settings.splat.strays == Strays::Hidden);
        let words = match self {
            Self::Memory { cloud, up, units } => {
                let (points, left_out) = (Points::Memory(cloud), Vec::new());
                return Ok(Some(Side { points, test, left_out, up, units, settings }));
            }
            Self::Files(words) => words,
        };
        let request = world::resolve_open(&words, own.to_vec(), &settings);
        request.check().map_err(|error| error.to_string())?;
        let (mut sources, mut left_out) = (Vec::new(), Vec::new());
        for input in &request.inputs {
            if input.files().is_empty() {
                return Err(format!("{}: not a file; files and open clouds can be compared", input.name()));
            }
            let memory = half_of(settings.stream.host_bytes);
            let open = |file: &PathBuf| request.open(input, file, memory);
            let own = input.files().iter().map(open).collect::<Result<Vec<_>, _>>()?.concat();
            if let Some(lost) = world::lost_tiles(&own).next() {
                return Err(lost.clone());
            }
            let Some(strays) = export::strays(&own, &test, &settings, progress)? else { return Ok(None) };
            left_out.extend(strays);
            sources.extend(own);
        }
        let up = sources.first().map_or(DVec3::Z, |source| world::up_of(source.info(), &settings));
        let units = Units::in_common(sources.iter().map(|source| source.info().units));
        Ok(Some(Side { points: Points::Files(sources), test, left_out, up, units, settings }))
    }
}

impl Comparing {
    /// Measures the distances, and writes the file.
    pub fn run(self) -> Comparison {
        let (key, what) = (self.key, self.what.clone());
        Comparison { key, what, result: self.outcome() }
    }

    fn outcome(self) -> Result<Option<Outcome>, String> {
        let Self { first, second, method, core, tests, settings, own, output, progress, .. } = self;
        let [of_first, of_second] = tests;
        let Some(first) = first.side(of_first, &settings, &own, &progress)? else { return Ok(None) };
        let Some(second) = second.side(of_second, &settings, &own, &progress)? else { return Ok(None) };
        let compared = comparing::compare(&first, &second, method, core, &progress);
        let Some((mut measured, mut warnings)) = compared.map_err(|error| format!("{error:#}"))? else {
            return Ok(None);
        };
        let [distance, level] = COMPARED.map(|name| free_name(first.sources(), name));
        let Some(path) = output else { return Ok(Some(Outcome { measured, output: None, warnings })) };
        let distances = std::mem::take(&mut measured.distances);
        let mut added = vec![Added::new(distance.clone(), distances)];
        added.extend(measured.levels.take().map(|values| Added::new(level, values)));
        let memory = half_of(settings.stream.host_bytes);
        // What was measured is worth knowing even if it cannot be written.
        let output = match codec::export(first.sources(), first.wanted(), &added, &path, memory, &progress) {
            Ok(Some(written)) => {
                let own = written.changes.into_iter().chain(written.warnings);
                warnings.extend(own.chain(lack(&path, written.missing)));
                Some(Ok(Written { path, attribute: distance }))
            }
            Ok(None) => return Ok(None),
            Err(error) => Some(Err(error.to_string())),
        };
        Ok(Some(Outcome { measured, output, warnings }))
    }
}
