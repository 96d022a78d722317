//! `glint measure`: the measurements that a scene file keeps, carried out on the points of its files. Each file is read
//! once, chunk by chunk, so it may be larger than memory.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use anyhow::Context as _;
use cloud::{Chunk, Cloud, PointTest, Progress};
use codec::{Info, Selection, Units};
use glam::DVec3;
use scene::{Measurement, Settings, shown};
use serde_json::{Value, json};

use crate::command_line::MeasureArguments;
use crate::failure::{self, FAILED, UNUSABLE, usage};
use crate::measuring::{Gathering, Outcome};
use crate::terminal::{self, Few};
use crate::{interrupt, progress_bar};

/// What all measurements share, known when the first file is open.
struct Basis {
    units: Units,
    gatherings: Vec<Mutex<Gathering>>,
}

/// Tells the measurements. Returns exit status 2 if a file cannot be read, and 1 if something cannot be measured; both
/// are told on standard error.
///
/// # Errors
/// Bad usage, no file can be read, or Ctrl-C.
pub fn run(arguments: &MeasureArguments) -> anyhow::Result<u8> {
    let name = shown(&arguments.scene);
    let request = world::resolve(std::slice::from_ref(&arguments.scene));
    request.check()?;
    terminal::warn(&request.warnings);
    if request.measurements.is_empty() {
        return Err(usage(format!("{name}: no measurements in it, expected a scene file with [[measurements]]")));
    }
    let settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    let test = request.test();
    let (mut basis, mut status) = (None, 0);
    let mut failed = Few::of("that cannot be measured");
    for input in &request.inputs {
        if input.files().is_empty() {
            status = UNUSABLE;
            failed.complain(&format!("{}: points of files are measured", input.name()));
        }
        for file in input.files() {
            if let Err(error) = read(file, &request.measurements, &test, &settings, &mut basis) {
                let of_error = failure::exit_status(&error);
                status = if of_error == UNUSABLE && status != FAILED { UNUSABLE } else { FAILED };
                failed.complain(&format!("{error:#}"));
            }
            interrupt::check()?;
        }
    }
    let Some(Basis { units, gatherings }) = basis else {
        failed.end();
        return Ok(status.max(UNUSABLE));
    };
    let gatherings = gatherings.into_iter().map(|one| one.into_inner().unwrap_or_else(PoisonError::into_inner));
    let results: Vec<Outcome> = gatherings.map(Gathering::finish).collect();
    let measured = || request.measurements.iter().zip(&results);
    for (index, (measurement, figures)) in measured().enumerate() {
        if let Err(problem) = figures {
            status = if status == 0 { FAILED } else { status };
            failed.complain(&format!("measurement {} (`{}`): {problem}", index + 1, measurement.name));
        }
    }
    if arguments.json {
        let measurements: Vec<Value> =
            measured().map(|(measurement, figures)| entry(measurement, figures, &units)).collect();
        let unit = units.length().map(|unit| unit.to_string());
        terminal::print_json(&json!({ "scene": name, "unit": unit, "measurements": measurements }))?;
    } else {
        terminal::print(measured().flat_map(|(measurement, figures)| lines(measurement, figures, &units)))?;
    }
    failed.end();
    Ok(status)
}

impl Basis {
    fn new(info: &Info, measurements: &[Measurement], up: DVec3) -> Self {
        if let (true, Some(level), Some(height)) = (info.units.are_mixed(), info.units.level, info.units.height) {
            terminal::warn([format!(
                "heights are in {height} and the other coordinates in {level}: no lengths have a unit"
            )]);
        } else if info.units.are_mixed() {
            terminal::warn(["the coordinates are angles: no lengths have a unit"]);
        }
        let gathering = |measurement| Mutex::new(Gathering::new(measurement, up));
        Self { units: info.units, gatherings: measurements.iter().map(gathering).collect() }
    }
}

/// Takes the points of a file into account that are shown.
fn read(
    path: &Path,
    measurements: &[Measurement],
    test: &PointTest,
    settings: &Settings,
    basis: &mut Option<Basis>,
) -> anyhow::Result<()> {
    let source = world::open_file(path, world::half_of(settings.stream.host_bytes)).map_err(usage)?;
    let info = source.info();
    let basis = basis.get_or_insert_with(|| Basis::new(info, measurements, world::up_of(info, settings)));
    let cloud = Cloud { name: shown(path), attributes: info.attributes.clone(), grid: info.grid, chunks: Vec::new() };
    let shown_ones = cloud.test(test);
    let gather = |chunk: Chunk| {
        let bounds = chunk.bounds();
        for gathering in &basis.gatherings {
            let mut gathering = gathering.lock().unwrap_or_else(PoisonError::into_inner);
            if gathering.wants(bounds) {
                for index in 0..chunk.len() {
                    gathering.add(cloud.world_position(&chunk, index), || shown_ones.shows(&chunk, index));
                }
            }
        }
    };
    // The test reads attributes.
    let attributes = vec![!test.shows_all(); info.attributes.len()];
    let selection = Selection { positions: true, colors: false, normals: false, attributes };
    let progress = Progress::default();
    let summary = progress_bar::watch("reading", &progress, || source.read(&selection, &progress, &gather));
    let summary = summary.with_context(|| shown(path))?;
    terminal::warn(summary.warnings.iter().map(|warning| format!("{}: {warning}", shown(path))));
    Ok(())
}

fn entry(measurement: &Measurement, figures: &Outcome, units: &Units) -> Value {
    let Measurement { name, kind, on, points, .. } = measurement;
    let points: Vec<[f64; 3]> = points.iter().map(DVec3::to_array).collect();
    let mut entry = json!({ "name": name, "kind": kind.name(), "on": on, "points": points });
    match figures {
        Ok(figures) => {
            let value = |figure: &crate::measuring::Figure| {
                let (unit, uncertainty) = (figure.unit(units), figure.deviation);
                json!({ "name": figure.name, "value": figure.value, "unit": unit, "uncertainty": uncertainty })
            };
            entry["values"] = figures.iter().map(value).collect();
        }
        Err(problem) => entry["error"] = json!(problem),
    }
    entry
}

/// The report for people: a measurement, and a line for each of its values.
fn lines(measurement: &Measurement, figures: &Outcome, units: &Units) -> Vec<String> {
    let mut lines = vec![format!("{}: {}", measurement.name, measurement.kind.name())];
    match figures {
        Ok(figures) => {
            lines.extend(figures.iter().map(|figure| format!("  {:<20} {}", figure.name, figure.text(units))));
        }
        Err(problem) => lines.push(format!("  {problem}")),
    }
    lines
}
