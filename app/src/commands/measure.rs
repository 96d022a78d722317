//! `glint measure`: the measurements that a scene file keeps, carried out on the points of its files. Each file is read
//! chunk by chunk, so it may be larger than memory: once, or several times where measurements take much memory.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::Context as _;
use cloud::{Chunk, Cloud, PointTest, Progress};
use codec::{Info, Selection, Units, Wanted};
use glam::DVec3;
use scene::{Measurement, Settings, Strays, shown};
use serde_json::{Value, json};
use world::{Input, Request};

use crate::shared::command_line::MeasureArguments;
use crate::shared::export;
use crate::shared::measuring::{Figure, Gathering, Outcome, of_a_part};
use crate::shared::numbers::grouped;
use crate::system::failure::{self, FAILED, UNUSABLE, usage};
use crate::system::terminal::{self, Few};
use crate::system::{interrupt, progress_bar};

/// The files whose points are measured, and which of the points.
struct Job<'a> {
    request: &'a Request,
    files: Vec<(Input, PathBuf)>,
    test: PointTest,
    /// The stray points of each file, if they are hidden: their indices in the file, ascending.
    left_out: HashMap<(PathBuf, usize), Vec<u64>>,
    settings: Settings,
    /// The direction up of the first file, once it is open.
    up: Option<DVec3>,
    /// What the files say that have been read.
    read: Vec<Info>,
    /// The number of points of them that cannot be read, in the reading that lacked most.
    missing: u64,
    /// The exit status so far.
    status: u8,
    failed: Few,
}

/// Prints the measurements. Returns exit status 2 if a file, or a part of one, cannot be read, and 1 if something cannot
/// be measured; both are reported on standard error.
///
/// # Errors
/// Bad usage, no file can be read, or Ctrl-C.
pub fn run(arguments: &MeasureArguments) -> anyhow::Result<u8> {
    let name = shown(&arguments.scene);
    let mut request = world::resolve(std::slice::from_ref(&arguments.scene));
    request.check()?;
    let settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    let memory = world::half_of(settings.stream.host_bytes);
    request.leave_out_hidden(memory)?;
    terminal::warn(&request.warnings);
    let measurements: Vec<Measurement> = request.measurements().cloned().collect();
    if measurements.is_empty() {
        return Err(usage(format!("{name}: no measurements in it, expected a scene file with [[measurements]]")));
    }
    terminal::warn(request.check_filters(&settings)?);
    terminal::warn(request.settings_without_cloud(memory));
    let files = request.files();
    let failed = Few::of("that cannot be measured");
    let (read, test) = (Vec::new(), request.test());
    let mut left_out = HashMap::new();
    let hidden = test.hiding_strays(settings.splat.strays == Strays::Hidden).hidden_kinds(&[]);
    for input in request.inputs.iter().filter(|_| hidden != [false; 3]) {
        // What cannot be read is reported when it is measured.
        let open = |file: &PathBuf| request.open(input, file, memory).unwrap_or_default();
        let sources: Vec<_> = input.files().iter().flat_map(open).collect();
        let progress = Progress::default();
        let find = || export::strays(&sources, &test, &settings, &progress);
        let found = progress_bar::watch("strays", &progress, find).map_err(usage)?;
        let paths = sources.iter().map(|source| (source.info().path.clone(), source.info().scan_number()));
        left_out.extend(paths.zip(found.ok_or(stream::Error::Cancelled)?));
    }
    let (missing, status) = (0, 0);
    let mut job = Job { request: &request, files, test, left_out, settings, up: None, read, missing, status, failed };
    for input in request.inputs.iter().filter(|input| input.files().is_empty()) {
        job.status = UNUSABLE;
        job.failed.complain(&format!("{}: points of files are measured", input.name()));
    }
    let mut results = Vec::new();
    for round in rounds(&measurements, memory) {
        results.append(&mut job.measure(round)?);
    }
    let Job { up, read, missing, mut status, mut failed, .. } = job;
    if up.is_none() {
        failed.end();
        return Ok(status.max(UNUSABLE));
    }
    // Files that cannot be read at all have points, too.
    let is_whole = missing == 0 && status == 0;
    let is_of_part = |one: &Measurement| !is_whole && Gathering::is_large(one.kind);
    let results = results.into_iter().zip(&measurements);
    let results: Vec<Outcome> =
        results.map(|(outcome, one)| if is_of_part(one) { of_a_part(outcome) } else { outcome }).collect();
    let units = Units::in_common(read.iter().map(|info| info.units));
    let measured = || measurements.iter().zip(&results);
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
        terminal::print_json(&json!({
            "scene": name, "unit": unit, "measurements": measurements, "whole": is_whole, "points_missing": missing,
        }))?;
    } else if arguments.csv {
        terminal::print(table(measured(), &units)?.lines())?;
    } else {
        terminal::print(measured().flat_map(|(measurement, figures)| lines(measurement, figures, &units)))?;
        if !is_whole {
            let lost = if missing == 0 {
                "not all can be read".into()
            } else {
                format!("{} cannot be read", grouped(missing))
            };
            terminal::print([format!("values are of a part of the points: {lost}")])?;
        }
    }
    failed.end();
    Ok(export::say_missing(missing, status))
}

/// Divides measurements among readings of the files, so that those of one reading have room in `memory` bytes.
fn rounds(measurements: &[Measurement], memory: u64) -> Vec<&[Measurement]> {
    let most = (memory / Gathering::LARGE_BYTES).max(1) as usize;
    let (mut rounds, mut rest) = (Vec::new(), measurements);
    while !rest.is_empty() {
        let mut large = rest.iter().enumerate().filter(|(_, one)| Gathering::is_large(one.kind));
        let count = large.nth(most).map_or(rest.len(), |(index, _)| index);
        let (round, later) = rest.split_at(count);
        rounds.push(round);
        rest = later;
    }
    rounds
}

/// What the measurements take from the points; `up` is the direction up.
fn begin(measurements: &[Measurement], up: DVec3) -> Vec<Mutex<Gathering>> {
    measurements.iter().map(|one| Mutex::new(Gathering::new(one, up))).collect()
}

impl Job<'_> {
    /// Reads the files once for these measurements. Files that cannot be read are left out from then on. Without a
    /// file there are no results.
    fn measure(&mut self, measurements: &[Measurement]) -> anyhow::Result<Vec<Outcome>> {
        let is_first = self.read.is_empty();
        let missing_before = std::mem::take(&mut self.missing);
        let mut gatherings = self.up.map(|up| begin(measurements, up)).unwrap_or_default();
        let mut readable = Vec::new();
        for (input, file) in std::mem::take(&mut self.files) {
            match self.read((&input, &file), measurements, &mut gatherings, is_first) {
                Ok(()) => readable.push((input, file)),
                Err(error) => {
                    let is_unusable = failure::exit_status(&error) == UNUSABLE && self.status != FAILED;
                    self.status = if is_unusable { UNUSABLE } else { FAILED };
                    self.failed.complain(&format!("{error:#}"));
                }
            }
            interrupt::check()?;
        }
        self.files = readable;
        self.missing = self.missing.max(missing_before);
        if is_first {
            let systems = world::system_warnings(&self.read);
            terminal::warn(param::few(systems, "warnings"));
        }
        let gathered = gatherings.into_iter().map(|one| one.into_inner().unwrap_or_else(PoisonError::into_inner));
        Ok(gathered.map(Gathering::finish).collect())
    }

    /// Takes the points of a file's scans into account that are shown. `tells` says that its warnings are not known yet.
    fn read(
        &mut self,
        (input, path): (&Input, &Path),
        measurements: &[Measurement],
        gatherings: &mut Vec<Mutex<Gathering>>,
        tells: bool,
    ) -> anyhow::Result<()> {
        let memory = world::half_of(self.settings.stream.host_bytes);
        let sources = self.request.open(input, path, memory).map_err(usage)?;
        for lost in world::lost_tiles(&sources).filter(|_| tells) {
            self.status = if self.status == FAILED { FAILED } else { UNUSABLE };
            self.failed.complain(lost);
        }
        for source in sources {
            self.read_scan(&source, measurements, gatherings, tells)?;
        }
        Ok(())
    }

    fn read_scan(
        &mut self,
        source: &codec::Source,
        measurements: &[Measurement],
        gatherings: &mut Vec<Mutex<Gathering>>,
        tells: bool,
    ) -> anyhow::Result<()> {
        let info = source.info();
        let path = info.path.as_path();
        let up = *self.up.get_or_insert_with(|| world::up_of(info, &self.settings));
        if gatherings.is_empty() {
            *gatherings = begin(measurements, up);
        }
        let cloud =
            Cloud { name: shown(path), attributes: info.attributes.clone(), grid: info.grid, chunks: Vec::new() };
        let shown_ones = cloud.test(&self.test);
        let left_out =
            self.left_out.get(&(info.path.clone(), info.scan_number())).map(std::slice::from_ref).unwrap_or_default();
        let wanted = Wanted { test: &self.test, left_out };
        let shows_faces = world::shows_faces(source, &self.settings);
        let vertices = Mutex::new(Vec::new());
        let gather = |chunk: Chunk| {
            if shows_faces && chunk.corners.is_none() {
                vertices.lock().unwrap_or_else(PoisonError::into_inner).push(chunk.clone());
            }
            let bounds = chunk.bounds();
            let left_out = wanted.left_out(0, chunk.first_point, chunk.len());
            for gathering in &*gatherings {
                let mut gathering = gathering.lock().unwrap_or_else(PoisonError::into_inner);
                if gathering.wants(bounds) {
                    for index in 0..chunk.len() {
                        gathering.add(cloud.world_position(&chunk, index), || {
                            shown_ones.shows(&chunk, index) && !left_out.has(index)
                        });
                    }
                }
            }
        };
        let attributes = self.test.reads(&info.attributes);
        let selection = Selection { positions: true, colors: false, normals: false, attributes };
        let progress = Progress::default();
        let summary = progress_bar::watch("reading", &progress, || source.read(&selection, &progress, &gather));
        let summary = summary.with_context(|| shown(path))?;
        let mut chunks = std::mem::take(&mut *vertices.lock().unwrap_or_else(PoisonError::into_inner));
        chunks.sort_by_key(|chunk| chunk.first_point);
        // A mesh is measured as the window shows it.
        let on_faces = world::points_on_faces(source, &chunks, &self.settings);
        on_faces.into_iter().flat_map(|points| points.chunks).for_each(gather);
        self.missing = self.missing.saturating_add(info.missing).saturating_add(summary.missing);
        if tells {
            let of_points = summary.warnings.iter().map(|warning| format!("{}: {warning}", shown(path)));
            terminal::warn(world::file_warnings(info).chain(of_points));
            self.read.push(info.clone());
        }
        Ok(())
    }
}

fn entry(measurement: &Measurement, figures: &Outcome, units: &Units) -> Value {
    let Measurement { name, kind, on, points, .. } = measurement;
    let points: Vec<[f64; 3]> = points.iter().map(DVec3::to_array).collect();
    let mut entry = json!({ "name": name, "kind": kind.name(), "on": on, "points": points });
    match figures {
        Ok(figures) => {
            let value = |figure: &Figure| {
                let (unit, uncertainty, interval) = (figure.unit(units), figure.deviation, figure.interval());
                json!({
                    "name": figure.name, "value": figure.value, "unit": unit, "uncertainty": uncertainty,
                    "interval": interval,
                })
            };
            entry["values"] = figures.iter().map(value).collect();
        }
        Err(problem) => entry["error"] = json!(problem),
    }
    entry
}

/// A row for each value, and one with the problem for a measurement that has none.
fn table<'a>(measured: impl Iterator<Item = (&'a Measurement, &'a Outcome)>, units: &Units) -> anyhow::Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record([
        "measurement",
        "kind",
        "on",
        "figure",
        "value",
        "unit",
        "uncertainty",
        "error",
        "interval",
    ])?;
    for (measurement, figures) in measured {
        let Measurement { name, kind, on, .. } = measurement;
        let mut row = |rest: [&str; 6]| {
            writer
                .write_record([name.as_str(), kind.name(), if *on { "true" } else { "false" }].into_iter().chain(rest))
        };
        match figures {
            Ok(figures) => {
                for figure in figures {
                    let (value, unit) = (cloud::number(figure.value), figure.unit(units).unwrap_or_default());
                    let text = |number: Option<f64>| number.map_or(String::new(), cloud::number);
                    let (uncertainty, interval) = (text(figure.deviation), text(figure.interval()));
                    row([figure.name, &value, &unit, &uncertainty, "", &interval])?;
                }
            }
            Err(problem) => row(["", "", "", "", problem, ""])?,
        }
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
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

#[cfg(test)]
mod tests {
    use scene::MeasurementKind;

    use super::*;

    #[test]
    fn measurements_that_take_much_memory_are_divided_among_readings() {
        let measurement = |kind: MeasurementKind| Measurement {
            name: String::new(),
            kind,
            on: true,
            color: [1.0; 3],
            points: vec![DVec3::ZERO],
            reach: None,
            level: None,
        };
        use MeasurementKind::{Cylinder, Distance, Plane, Volume};
        let all = [Distance, Volume, Plane, Distance, Cylinder, Distance, Volume, Volume].map(measurement);
        let lengths = |count: u64| {
            let rounds = rounds(&all, count * Gathering::LARGE_BYTES);
            assert_eq!(rounds.concat(), all);
            rounds.iter().map(|round| round.len()).collect::<Vec<_>>()
        };
        assert_eq!(lengths(100), [8]);
        assert_eq!(lengths(2), [4, 3, 1]);
        assert_eq!(lengths(0), [2, 2, 2, 1, 1]);
        assert!(rounds(&[], 0).is_empty());
    }
}
