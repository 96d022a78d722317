//! The results of a study: runs as they are journalled, the figures of tables and charts, and a row for each setting.
//!
//! `results.csv` and `results.json` hold the same rows. A new figure is one line in `FRAME_FIGURES`,
//! `TRUTH_FIGURES`, `SIGHTLINE_FIGURES`, `STILL_FIGURES` or `FLICKER_FIGURES`.

use std::collections::{BTreeMap, HashMap};
use std::sync::LazyLock;

use param::Choice as _;
use render::{FrameStats, PassStage};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::estimate::{Estimate, EstimatedPercentiles};
use crate::metrics::{Accuracy, Truth};
use crate::plan::{Case, DISTANCE, ORBIT, Part, Plan, RAY_TRACE, SIZE, TARGET};
use crate::sightlines::Sightlines;
use crate::still::StillError;

/// The time of all passes that find what mirrors show, in milliseconds.
pub const METHOD_MS: &str = "method_ms";
/// The time of the whole frame, in milliseconds.
pub const FRAME_MS: &str = "frame_ms";

/// The errors against the still picture.
pub const STILL_DELTA_E: &str = "still_delta_e";
pub const STILL_WORSE_DELTA_E: &str = "still_worse_delta_e";
pub const STILL_PIXELS: &str = "still_pixel_error_p95";
/// The time that `auto` was to keep to, in milliseconds.
pub const TARGET_MS: &str = "target_ms";

/// A figure that is measured for a setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Figure {
    /// The name in the table and in plans.
    pub name: String,
    /// The name for people.
    pub label: String,
    /// The unit; empty for a pure number.
    pub unit: &'static str,
}

impl Figure {
    /// The label and the unit.
    pub fn title(&self) -> String {
        if self.unit.is_empty() { self.label.clone() } else { format!("{} [{}]", self.label, self.unit) }
    }

    /// Whether a larger value is better; of errors and times a smaller one is.
    pub fn more_is_better(&self) -> bool {
        let name = self.truth().and_then(|(_, prefix)| self.name.strip_prefix(prefix)).unwrap_or(&self.name);
        MORE_IS_BETTER.contains(&name.trim_start_matches('_'))
    }

    /// The truth by which it is judged, and the figure's name in plans.
    pub fn truth(&self) -> Option<(Truth, &'static str)> {
        let named = TRUTHS.iter().find(|(_, prefix, _)| self.name.starts_with(prefix));
        named.map(|(truth, prefix, _)| (*truth, *prefix))
    }

    /// Whether it is measured only if `still` is asked for.
    pub fn is_of_still(&self) -> bool {
        STILL_FIGURES.iter().any(|(name, ..)| *name == self.name)
    }

    /// Whether it is measured only if `sightlines` are asked for.
    pub fn is_of_sightlines(&self) -> bool {
        SIGHTLINE_FIGURES.iter().any(|(name, ..)| *name == self.name)
    }

    /// Whether it is measured only if `light` is asked for.
    pub fn is_of_light(&self) -> bool {
        let truth = self.truth().and_then(|(_, prefix)| self.name.strip_prefix(prefix));
        truth.is_some_and(|name| name.starts_with("_light_"))
    }

    /// Whether it is measured over the pixels of mirrors that show something, so that it says nothing of the others.
    pub fn is_of_filled(&self) -> bool {
        const NAMES: [&str; 4] = ["_angle_error", "_pixel_error", "_occlusion_error", "_wrong"];
        let name = self.truth().and_then(|(_, prefix)| self.name.strip_prefix(prefix));
        name.is_some_and(|name| NAMES.iter().any(|known| name.starts_with(known)))
    }

    /// Whether it is measured only if `flicker` is asked for.
    pub fn is_of_flicker(&self) -> bool {
        FLICKER_FIGURES.iter().any(|(name, ..)| *name == self.name)
    }
}

/// The measurements of one frame of a setting.
#[derive(Clone, Debug, Default)]
pub struct Measured {
    pub mirror_pixels: f64,
    /// The share of the mirror pixels in which a point was found.
    pub coverage: Option<f64>,
    pub closed_coverage: Option<f64>,
    /// The share of the points that found a pixel.
    pub hit_rate: Option<f64>,
    pub unconverged: Option<f64>,
    pub regions: Option<f64>,
    /// The share of the mirror pixels whose ray no map resolves.
    pub unresolved: Option<f64>,
    /// How many cells of a picture, or nodes of a tree, a ray was compared with, on the mean.
    pub tests_per_ray: Option<f64>,
    /// What the maps of light fields took.
    pub maps: Option<MapFigures>,
    /// The share of the points found that a list of rays projects, how many copies there are of each ray, the bytes of
    /// all cells of space, and the milliseconds that it took to make them.
    pub listed: Option<f64>,
    pub ray_copies: Option<f64>,
    pub cameras_bytes: Option<f64>,
    pub cameras_ms: Option<f64>,
    /// The share of the mirror pixels that the renderer itself does not trust.
    pub uncertain: Option<f64>,
    /// The errors as the renderer estimates them from random pixels.
    pub estimate: Option<Estimate>,
    pub judged: Vec<Accuracy>,
    /// How far the surface is from the scan, by the pictures and by the ray tracer.
    pub drawn_sightlines: Option<Sightlines>,
    pub traced_sightlines: Option<Sightlines>,
    /// The error against the still picture.
    pub still: Option<StillError>,
    /// The time that `auto` was to keep to, in milliseconds.
    pub target_ms: Option<f64>,
    /// The time that `auto` expected, in milliseconds.
    pub predicted_ms: Option<f64>,
    /// The flicker in grey levels.
    pub flicker_still: Option<f64>,
    pub flicker_moving: Option<f64>,
}

/// What the maps of light fields took, on the mean over the frames that count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapFigures {
    /// Maps drawn for a frame.
    pub new: f64,
    /// The share of what mirror pixels ask for of which no map stood.
    pub missed: f64,
    /// The memory of the maps.
    pub bytes: f64,
    /// The share of mirror pixels that are predicted to be off, if that chooses maps.
    pub off: Option<f64>,
    /// Texels traced for a frame, where that is left until a ray looks at them.
    pub texels: Option<f64>,
}

impl MapFigures {
    /// The mean over frames; `None` if a method has no such maps.
    pub fn of(frames: &[FrameStats]) -> Option<Self> {
        let uses: Vec<_> = frames.iter().filter_map(|frame| frame.reflection?.map_use).collect();
        let some = |value: fn(&render::MapUse) -> Option<f64>| {
            uses.iter().map(value).sum::<Option<f64>>().map(|sum| sum / uses.len() as f64)
        };
        let mean = |value: fn(&render::MapUse) -> f64| uses.iter().map(value).sum::<f64>() / uses.len() as f64;
        let of = || Self {
            new: mean(|map_use| map_use.new.into()),
            missed: mean(|map_use| map_use.missed),
            bytes: mean(|map_use| map_use.bytes as f64),
            off: some(|map_use| map_use.off),
            texels: some(|map_use| map_use.texels.map(f64::from)),
        };
        (!uses.is_empty()).then(of)
    }
}

/// The name, the label, the unit, and the source of a figure.
type Reading<From> = (&'static str, &'static str, &'static str, fn(&From) -> Option<f64>);

const FRAME_FIGURES: [Reading<Measured>; 24] = [
    ("mirror_pixels", "mirror pixels", "", |measured| Some(measured.mirror_pixels)),
    ("coverage", "coverage", "share of mirror pixels", |measured| measured.coverage),
    ("closed_coverage", "closed coverage", "share of mirror pixels", |measured| measured.closed_coverage),
    ("hit_rate", "hit rate", "share of points", |measured| measured.hit_rate),
    ("unconverged", "unconverged", "share of points", |measured| measured.unconverged),
    ("regions", "regions", "", |measured| measured.regions),
    ("unresolved", "unresolved rays", "share of mirror pixels", |measured| measured.unresolved),
    ("tests_per_ray", "cells or nodes that a ray is compared with", "", |measured| measured.tests_per_ray),
    ("maps_new", "maps drawn for a frame", "", |measured| Some(measured.maps?.new)),
    ("maps_missed", "maps missed", "share of what is asked for", |measured| Some(measured.maps?.missed)),
    ("maps_bytes", "memory of maps", "bytes", |measured| Some(measured.maps?.bytes)),
    ("maps_off", "pixels predicted to be off", "share of mirror pixels", |measured| measured.maps?.off),
    ("texels_traced", "texels traced for a frame", "", |measured| measured.maps?.texels),
    ("listed", "points projected by lists", "share of points found", |measured| measured.listed),
    ("ray_copies", "copies of each ray", "", |measured| measured.ray_copies),
    ("cameras_bytes", "cells of space", "bytes", |measured| measured.cameras_bytes),
    ("cameras_ms", "making cells of space", "ms", |measured| measured.cameras_ms),
    ("uncertain", "uncertain", "share of mirror pixels", |measured| measured.uncertain),
    ("estimated_pixel_error_median", "estimated pixel error, median", "pixels", |measured| {
        Some(measured.estimated_error()?.median)
    }),
    ("estimated_pixel_error_p95", "estimated pixel error, 95th percentile", "pixels", |measured| {
        Some(measured.estimated_error()?.p95)
    }),
    ("estimated_wrong", "estimated wrong pixels", "share of filled pixels", |measured| {
        Some(measured.estimate.as_ref()?.wrong)
    }),
    ("estimated_wrong_low", "estimated wrong pixels, at least", "share of filled pixels", |measured| {
        Some(measured.estimate.as_ref()?.wrong_interval?[0])
    }),
    ("estimated_wrong_high", "estimated wrong pixels, at most", "share of filled pixels", |measured| {
        Some(measured.estimate.as_ref()?.wrong_interval?[1])
    }),
    ("estimated_light_error", "estimated error of indirect light", "relative RMSE", |measured| {
        Some(measured.estimate.as_ref()?.indirect?.relative_rmse)
    }),
];

const TRUTH_FIGURES: [Reading<Accuracy>; 21] = [
    ("false_fill", "false fill", "share of mirror pixels", |accuracy| Some(accuracy.false_fill)),
    ("angle_error_median", "angle error, median", "degrees", |accuracy| Some(accuracy.angle_error.median)),
    ("angle_error_p95", "angle error, 95th percentile", "degrees", |accuracy| Some(accuracy.angle_error.p95)),
    ("angle_error_p99", "angle error, 99th percentile", "degrees", |accuracy| Some(accuracy.angle_error.p99)),
    ("pixel_error_median", "pixel error, median", "pixels", |accuracy| Some(accuracy.pixel_error.median)),
    ("pixel_error_p95", "pixel error, 95th percentile", "pixels", |accuracy| Some(accuracy.pixel_error.p95)),
    ("pixel_error_p99", "pixel error, 99th percentile", "pixels", |accuracy| Some(accuracy.pixel_error.p99)),
    ("occlusion_error", "occlusion error", "share of filled pixels", |accuracy| Some(accuracy.occlusion_error)),
    ("wrong", "wrong pixels", "share of filled pixels", |accuracy| Some(accuracy.wrong)),
    ("recall", "recall", "share of visible points", |accuracy| accuracy.recall),
    ("rmse", "colour RMSE", "linear", |accuracy| accuracy.image.map(|image| image.rmse)),
    ("delta_e", "colour difference", "CIEDE2000", |accuracy| accuracy.image.map(|image| image.delta_e)),
    ("delta_e_p95", "colour difference, 95th percentile", "CIEDE2000", |accuracy| {
        accuracy.image.map(|image| image.delta_e_p95)
    }),
    ("flip", "FLIP", "0 to 1", |accuracy| accuracy.image.map(|image| image.flip)),
    ("ssim", "SSIM", "-1 to 1", |accuracy| accuracy.image.map(|image| image.ssim)),
    ("rmse_l", "RMSE of L*", "CIELAB", |accuracy| accuracy.image.map(|image| image.rmse_lab[0])),
    ("rmse_a", "RMSE of a*", "CIELAB", |accuracy| accuracy.image.map(|image| image.rmse_lab[1])),
    ("rmse_b", "RMSE of b*", "CIELAB", |accuracy| accuracy.image.map(|image| image.rmse_lab[2])),
    ("light_error", "error of indirect light", "relative RMSE", |of| of.indirect.map(|light| light.relative_rmse)),
    ("light_mean", "mean of indirect light", "share of the truth's", |of| of.indirect.map(|light| light.mean_ratio)),
    ("light_brightest", "brightest indirect light", "share of the truth's", |of| {
        of.indirect.map(|light| light.brightest_ratio)
    }),
];

/// The figures of the pictures, or of the ray tracer where there are no pictures.
const SIGHTLINE_FIGURES: [Reading<Measured>; 9] = [
    ("within", "surface within 1 %", "share of sightlines", |measured| Some(measured.sightlines()?.within)),
    ("in_front", "surface in front of the point", "share of sightlines", |measured| {
        Some(measured.sightlines()?.in_front)
    }),
    ("behind", "surface behind the point", "share of sightlines", |measured| Some(measured.sightlines()?.behind)),
    ("open", "no surface", "share of sightlines", |measured| Some(measured.sightlines()?.open)),
    ("depth_error_median", "depth error, median", "m per m", |measured| measured.sightlines()?.depth_error.median),
    ("depth_error_p95", "depth error, 95th percentile", "m per m", |measured| measured.sightlines()?.depth_error.p95),
    ("colour_error_median", "colour error, median", "CIEDE2000", |measured| measured.sightlines()?.colour_error.median),
    ("traced_within", "surface within 1 %, ray tracer", "share of sightlines", |measured| {
        Some(measured.traced_sightlines.as_ref()?.within)
    }),
    ("traced_in_front", "surface in front of the point, ray tracer", "share of sightlines", |measured| {
        Some(measured.traced_sightlines.as_ref()?.in_front)
    }),
];

const STILL_FIGURES: [Reading<Measured>; 9] = [
    (STILL_DELTA_E, "colour difference to the still picture", "CIEDE2000", |measured| {
        measured.still.map(|still| still.delta_e)
    }),
    (STILL_WORSE_DELTA_E, "colour difference to the still picture, the worse of mirrors and rest", "CIEDE2000", |of| {
        of.still.map(|still| still.worse_delta_e())
    }),
    ("still_mirrors_delta_e", "colour difference of mirrors to the still picture", "CIEDE2000", |measured| {
        Some(measured.still?.mirrors?.mean)
    }),
    ("still_mirrors_delta_e_p95", "colour difference of mirrors, 95th percentile", "CIEDE2000", |measured| {
        Some(measured.still?.mirrors?.p95)
    }),
    ("still_rest_delta_e", "colour difference of the rest to the still picture", "CIEDE2000", |measured| {
        Some(measured.still?.rest?.mean)
    }),
    ("still_rest_delta_e_p95", "colour difference of the rest, 95th percentile", "CIEDE2000", |measured| {
        Some(measured.still?.rest?.p95)
    }),
    (STILL_PIXELS, "pixel error to the still picture, 95th percentile", "pixels", |measured| {
        measured.still.map(|still| still.pixels)
    }),
    (TARGET_MS, "time to keep to", "ms", |measured| measured.target_ms),
    ("predicted_ms", "expected time", "ms", |measured| measured.predicted_ms),
];

const FLICKER_FIGURES: [Reading<Measured>; 2] = [
    ("flicker_still", "flicker, camera still", "grey levels", |measured| measured.flicker_still),
    ("flicker_moving", "flicker, camera moving", "grey levels", |measured| measured.flicker_moving),
];

/// The figures of which a larger value is better.
const MORE_IS_BETTER: [&str; 7] =
    ["within", "traced_within", "coverage", "closed_coverage", "hit_rate", "recall", "ssim"];

/// The truths in the order of the columns, with their names.
const TRUTHS: [(Truth, &str, &str); 2] =
    [(Truth::SameInput, "same_input", "same input"), (Truth::Exact, "exact", "exact")];

/// Figures that a truth does not give: recall needs points.
fn is_given(truth: Truth, figure: &str) -> bool {
    truth == Truth::SameInput || figure != "recall"
}

impl Measured {
    fn sightlines(&self) -> Option<&Sightlines> {
        self.drawn_sightlines.as_ref().or(self.traced_sightlines.as_ref())
    }

    fn estimated_error(&self) -> Option<EstimatedPercentiles> {
        self.estimate.as_ref()?.pixel_error
    }

    /// The values by name; those that could not be measured are left out.
    pub fn figures(&self) -> BTreeMap<String, f64> {
        let own = FRAME_FIGURES.iter().chain(&SIGHTLINE_FIGURES).chain(&STILL_FIGURES).chain(&FLICKER_FIGURES);
        let own = own.map(|(name, _, _, read)| ((*name).to_owned(), read(self)));
        let judged = self.judged.iter().flat_map(|accuracy| {
            let truth = truth_name(accuracy.truth);
            let given = TRUTH_FIGURES.iter().filter(|(name, ..)| is_given(accuracy.truth, name));
            given.map(move |(name, _, _, read)| (format!("{truth}_{name}"), read(accuracy)))
        });
        own.chain(judged)
            .filter_map(|(name, value)| Some((name, value?)))
            .filter(|(_, value)| value.is_finite())
            .collect()
    }
}

/// All figures in the order of the table's columns: times first.
pub fn figures() -> &'static [Figure] {
    static FIGURES: LazyLock<Vec<Figure>> = LazyLock::new(|| {
        let figure = |name: &str, label: String, unit| Figure { name: name.to_owned(), label, unit };
        let plain = |(name, label, unit, _): &Reading<Measured>| figure(name, (*label).to_owned(), unit);
        let times = [(FRAME_MS, "time of the frame"), (METHOD_MS, "time of the method")];
        let mut all: Vec<Figure> = times.map(|(name, label)| figure(name, label.to_owned(), "ms")).into();
        all.extend(FRAME_FIGURES.iter().map(plain));
        for (truth, prefix, words) in TRUTHS {
            let given = TRUTH_FIGURES.iter().filter(|(name, ..)| is_given(truth, name));
            all.extend(given.map(|(name, label, unit, _)| Figure {
                name: format!("{prefix}_{name}"),
                label: format!("{label} ({words})"),
                unit,
            }));
        }
        all.extend(SIGHTLINE_FIGURES.iter().chain(&STILL_FIGURES).chain(&FLICKER_FIGURES).map(plain));
        all
    });
    &FIGURES
}

/// A truth's name in figures.
pub fn truth_name(truth: Truth) -> &'static str {
    TRUTHS.iter().find(|(known, ..)| *known == truth).map_or("", |(_, name, _)| name)
}

/// The figure of this name.
pub fn figure(name: &str) -> Option<&'static Figure> {
    figures().iter().find(|figure| figure.name == name)
}

/// The machine and the program that made a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Machine {
    pub adapter: String,
    pub adapter_kind: String,
    /// The clock that times passes, `gpu` or `host`.
    pub clock: String,
    /// The program's version and commit.
    pub commit: String,
}

/// A line of the journal: one drawing of a setting.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Run {
    /// The index of the setting.
    pub case: usize,
    /// The round; 0 is judged and not timed.
    pub round: u32,
    pub machine: Machine,
    /// The parameters that are neither swept nor at their defaults, `key=value` separated by spaces (round 0).
    #[serde(skip_serializing_if = "String::is_empty")]
    pub set: String,
    /// The number of points of the scene (round 0).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<u64>,
    /// The figures (round 0).
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub figures: BTreeMap<String, f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_ms: Option<f64>,
    /// The passes in order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub passes: Vec<TimedPass>,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

impl Run {
    fn stage_ms(&self, stage: PassStage) -> f64 {
        // The sum of nothing begins with a negative zero.
        self.passes.iter().filter(|pass| pass.stage == stage).fold(0.0, |sum, pass| sum + pass.ms)
    }
}

/// The time of one pass of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimedPass {
    pub name: String,
    #[serde(serialize_with = "write_stage", deserialize_with = "read_stage")]
    pub stage: PassStage,
    /// The time in milliseconds.
    pub ms: f64,
}

fn write_stage<S: Serializer>(stage: &PassStage, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(stage.name())
}

fn read_stage<'de, D: Deserializer<'de>>(deserializer: D) -> Result<PassStage, D::Error> {
    let name = String::deserialize(deserializer)?;
    let stage = PassStage::from_name(&name);
    stage.ok_or_else(|| serde::de::Error::unknown_variant(&name, PassStage::NAMES))
}

/// The median of the rounds, with the least and the most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    pub median: f64,
    pub low: f64,
    pub high: f64,
}

impl Spread {
    /// The spread of some values; `None` if there are none.
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let (low, high) = (*values.first()?, *values.last()?);
        let middle = [(values.len() - 1) / 2, values.len() / 2].map(|at| values[at]);
        Some(Self { median: (middle[0] + middle[1]) / 2.0, low, high })
    }
}

/// A setting and its measurements.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    pub case: Case,
    /// The name of its group.
    pub group: String,
    /// The other parameters, `key=value` separated by spaces.
    pub set: String,
    pub points: Option<u64>,
    /// The number of timed frames.
    pub repeats: usize,
    pub frame_ms: Option<Spread>,
    pub method_ms: Option<Spread>,
    /// The times of the plan's parts, in its order; those of which no pass was run are left out.
    pub parts: Vec<(String, Spread)>,
    /// The medians of each pass, and of all passes of each stage.
    pub passes: Vec<(String, f64)>,
    pub stages: Vec<(PassStage, f64)>,
    pub figures: BTreeMap<String, f64>,
    pub machine: Machine,
    pub error: Option<String>,
}

impl Row {
    /// A figure's value; times are medians.
    pub fn value(&self, figure: &str) -> Option<f64> {
        match figure {
            FRAME_MS => self.frame_ms.map(|spread| spread.median),
            METHOD_MS => self.method_ms.map(|spread| spread.median),
            _ => self.part(figure).map(|spread| spread.median).or(self.figures.get(figure).copied()),
        }
    }

    fn part(&self, figure: &str) -> Option<Spread> {
        self.parts.iter().find(|(name, _)| name == figure).map(|(_, spread)| *spread)
    }

    /// The median, the least and the most of a time.
    pub fn spread(&self, figure: &str) -> Option<Spread> {
        match figure {
            FRAME_MS => self.frame_ms,
            METHOD_MS => self.method_ms,
            _ => self.part(figure),
        }
    }
}

/// The runs that count for each setting, by round. All are of one machine and version, as figures and times of
/// different ones cannot be mixed: of that which made the most rounds, and of several such the first. Among several
/// runs of a round the first that did not fail counts.
pub fn counted(runs: &[Run]) -> HashMap<usize, BTreeMap<u32, &Run>> {
    let mut of_machine: HashMap<usize, Vec<BTreeMap<u32, &Run>>> = HashMap::new();
    for run in runs {
        let machines = of_machine.entry(run.case).or_default();
        let is_same = |rounds: &BTreeMap<u32, &Run>| rounds.values().all(|other| other.machine == run.machine);
        let index = machines.iter().position(is_same).unwrap_or_else(|| {
            machines.push(BTreeMap::new());
            machines.len() - 1
        });
        let known = machines[index].entry(run.round).or_insert(run);
        if known.error.is_some() {
            *known = run;
        }
    }
    let made = |rounds: &BTreeMap<u32, &Run>| rounds.values().filter(|run| run.error.is_none()).count();
    // The last of equal ones is the greatest.
    let best = |machines: Vec<_>| machines.into_iter().rev().max_by_key(made).unwrap_or_default();
    of_machine.into_iter().map(|(case, machines)| (case, best(machines))).collect()
}

/// A row for each of the settings that have runs, in the plan's order, from the runs that are [`counted`].
pub fn rows(plan: &Plan, cases: &[Case], runs: &[Run]) -> Vec<Row> {
    let of_case = counted(runs);
    let row = |case: &Case| {
        let rounds = of_case.get(&case.index)?;
        let first = rounds.values().next()?;
        let timed: Vec<&Run> = rounds.iter().filter(|(round, _)| **round > 0).map(|(_, run)| *run).collect();
        let timed: Vec<&Run> = timed.into_iter().filter(|run| run.error.is_none()).collect();
        let spread =
            |time: &dyn Fn(&Run) -> Option<f64>| Spread::of(timed.iter().filter_map(|run| time(run)).collect());
        let names = timed.first().map(|run| run.passes.iter().map(|pass| pass.name.as_str())).into_iter().flatten();
        let passes = names.filter_map(|name| {
            let of_pass = |run: &Run| {
                let pass = run.passes.iter().find(|pass| pass.name == name);
                pass.map(|pass| pass.ms)
            };
            Some((name.to_owned(), spread(&of_pass)?.median))
        });
        let part = |part: &Part| {
            let of_part = |run: &Run| {
                let of_part = run.passes.iter().filter(|pass| part.passes.contains(&pass.name));
                of_part.map(|pass| pass.ms).reduce(|sum, ms| sum + ms)
            };
            Some((part.name.clone(), spread(&of_part)?))
        };
        let stage = |stage: PassStage| Some((stage, spread(&|run| Some(run.stage_ms(stage)))?.median));
        Some(Row {
            case: case.clone(),
            group: plan.groups[case.group].name.clone(),
            set: first.set.clone(),
            points: first.points,
            repeats: timed.len(),
            frame_ms: spread(&|run| run.frame_ms),
            method_ms: spread(&|run| Some(run.stage_ms(PassStage::Method))),
            parts: plan.parts.iter().filter_map(part).collect(),
            passes: passes.collect(),
            stages: PassStage::all().filter_map(stage).collect(),
            figures: first.figures.clone(),
            machine: first.machine.clone(),
            error: rounds.values().find_map(|run| run.error.clone()),
        })
    };
    cases.iter().filter_map(row).collect()
}

/// A cell of the table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    Empty,
    Text(String),
    Number(f64),
}

impl Cell {
    fn of(value: Option<f64>) -> Self {
        value.filter(|value| value.is_finite()).map_or(Self::Empty, Self::Number)
    }

    /// Numbers are cells as they are.
    fn of_text(text: &str) -> Self {
        let number = text.parse::<f64>().ok().filter(|value| value.is_finite());
        number.map_or_else(|| Self::Text(text.to_owned()), Self::Number)
    }

    /// The text of the cell; empty for an empty one.
    pub fn text(&self) -> String {
        match self {
            Self::Empty => String::new(),
            Self::Text(text) => text.clone(),
            Self::Number(number) => number.to_string(),
        }
    }

    fn json(&self) -> serde_json::Value {
        match self {
            Self::Empty => serde_json::Value::Null,
            Self::Text(text) => text.as_str().into(),
            // Whole numbers have no decimal point, as in the CSV.
            Self::Number(number) if number.fract() == 0.0 && number.abs() < 1e15 => (*number as i64).into(),
            Self::Number(number) => (*number).into(),
        }
    }
}

/// Whether a swept key is a variable of scenes.
pub(crate) fn is_variable(key: &str) -> bool {
    !key.contains('.') && ![SIZE, TARGET, DISTANCE, ORBIT].contains(&key)
}

/// The names and cells of a row; all rows of a plan have the same names in the same order.
pub fn cells(plan: &Plan, row: &Row) -> Vec<(String, Cell)> {
    let text = |text: &str| if text.is_empty() { Cell::Empty } else { Cell::Text(text.to_owned()) };
    let Row { case, machine, .. } = row;
    let mut cells: Vec<(String, Cell)> = Vec::new();
    let mut put = |name: &str, cell: Cell| cells.push((name.to_owned(), cell));
    put("plan", text(&plan.title));
    put("group", text(&row.group));
    put("scene", text(&case.scene));
    put("method", text(&case.method));
    for key in plan.swept_keys() {
        // A variable may have the name of another column, so its name is in braces, as in the pattern.
        let column = if is_variable(key) { format!("{{{key}}}") } else { key.to_owned() };
        put(&column, case.swept_value(key).map_or(Cell::Empty, Cell::of_text));
    }
    put("set", text(&row.set));
    put("width", Cell::Number(f64::from(case.size[0])));
    put("height", Cell::Number(f64::from(case.size[1])));
    put("points", Cell::of(row.points.map(|points| points as f64)));
    put("repeats", Cell::Number(row.repeats as f64));
    let times = [(FRAME_MS, row.frame_ms), (METHOD_MS, row.method_ms)].into_iter();
    for (name, spread) in times.chain(plan.parts.iter().map(|part| (part.name.as_str(), row.part(&part.name)))) {
        put(name, Cell::of(spread.map(|spread| spread.median)));
        put(&format!("{name}_low"), Cell::of(spread.map(|spread| spread.low)));
        put(&format!("{name}_high"), Cell::of(spread.map(|spread| spread.high)));
    }
    for Figure { name, .. } in figures().iter().filter(|figure| ![FRAME_MS, METHOD_MS].contains(&figure.name.as_str()))
    {
        put(name, Cell::of(row.figures.get(name).copied()));
    }
    put("adapter", text(&machine.adapter));
    put("adapter_kind", text(&machine.adapter_kind));
    // The ray tracer works on the CPU, whatever drew the surface from which it starts.
    let is_by_both = case.method == RAY_TRACE && machine.clock == "gpu";
    put("clock", text(if is_by_both { "gpu+host" } else { &machine.clock }));
    put("commit", text(&machine.commit));
    put("error", row.error.as_deref().map_or(Cell::Empty, text));
    cells
}

/// Writes the table as CSV (RFC 4180), with names in the first line.
///
/// # Errors
/// Never in memory; the writer's type has one.
pub fn csv(plan: &Plan, rows: &[Row]) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for (index, row) in rows.iter().enumerate() {
        let cells = cells(plan, row);
        if index == 0 {
            writer.write_record(cells.iter().map(|(name, _)| name))?;
        }
        writer.write_record(cells.iter().map(|(_, cell)| cell.text()))?;
    }
    Ok(writer.into_inner()?)
}

/// Writes the table as a JSON list of objects, with the time of each pass and of each stage.
///
/// # Errors
/// Never in memory; the writer's type has one.
pub fn json(plan: &Plan, rows: &[Row]) -> anyhow::Result<String> {
    let object = |row: &Row| {
        let mut object: serde_json::Map<String, serde_json::Value> =
            cells(plan, row).into_iter().map(|(name, cell)| (name, cell.json())).collect();
        let passes = row.passes.iter().map(|(name, milliseconds)| (name.clone(), Cell::of(Some(*milliseconds)).json()));
        object.insert("passes".into(), passes.collect::<serde_json::Map<_, _>>().into());
        let stages = row.stages.iter().map(|(stage, ms)| (stage.name().to_owned(), Cell::of(Some(*ms)).json()));
        object.insert("stages".into(), stages.collect::<serde_json::Map<_, _>>().into());
        serde_json::Value::from(object)
    };
    Ok(serde_json::to_string_pretty(&rows.iter().map(object).collect::<Vec<_>>())? + "\n")
}

#[cfg(test)]
mod tests;
