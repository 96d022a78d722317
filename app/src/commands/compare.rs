//! `glint compare`: how far the points of a cloud are from another one.

use std::ffi::OsStr;

use anyhow::Context as _;
use cloud::{COMPARED, Progress};
use codec::{Added, ExportFormat, Units};
use glam::DVec3;
use measure::DistanceFigures;
use scene::shown;
use serde_json::json;
use world::half_of;

use crate::commands::recording;
use crate::shared::command_line::CompareArguments;
use crate::shared::comparing::{self, Measured, Method, Points, Scales, Side};
use crate::shared::export::{self, free_name};
use crate::shared::numbers::grouped;
use crate::system::failure::{UNUSABLE, usage};
use crate::system::terminal::{self, Few};
use crate::system::{picture_file, progress_bar};

/// Measures the distances, prints what they amount to, and writes them if a file is named. Returns exit status 2 if a part
/// of a cloud cannot be read.
///
/// # Errors
/// Bad usage, a cloud that cannot be read or has no points, no distances, the file cannot be written, or Ctrl-C.
pub fn run(arguments: &CompareArguments) -> anyhow::Result<u8> {
    if let Some(output) = &arguments.output {
        if ExportFormat::of(output).is_none() {
            let expected =
                "the name must end in .laz, .las, .copc.laz, .e57, .ply or .csv, which is what will be in it";
            return Err(usage(format!("{}: {expected}", shown(output))));
        }
        picture_file::check_place(output)?;
    }
    check_scales(arguments)?;
    let first = open(&arguments.first, &arguments.set)?;
    let second = open(&arguments.second, &arguments.set)?;
    let all = first.sources().iter().chain(second.sources());
    let lacking = codec::missing_points(all.clone());
    terminal::warn(param::few(world::system_warnings(all.map(|source| source.info())), "warnings"));
    let CompareArguments { normal_scale: normal, cylinder_scale: cylinder, reach, registration, core, .. } = *arguments;
    let method = match arguments.method.as_str() {
        "m3c2" => Method::M3c2(Scales { normal, cylinder, reach, registration: registration.unwrap_or_default() }),
        _ => Method::Nearest,
    };
    let progress = Progress::default();
    let compare = || comparing::compare(&first, &second, method, core, &progress);
    let (measured, warnings) = progress_bar::watch("comparing", &progress, compare)?.ok_or(stream::Error::Cancelled)?;
    terminal::warn(param::few(warnings, "warnings"));
    report(arguments, &measured, &Units::in_common([first.units, second.units]))?;
    let (mut status, missing) = (0, lacking.saturating_add(measured.unread));
    if missing > 0 {
        let points = grouped(missing);
        terminal::complain(&format!("the distances are those of parts: {points} points of the clouds cannot be read"));
        status = UNUSABLE;
    }
    if let Some(output) = &arguments.output {
        let [distance, level] = COMPARED.map(|name| free_name(first.sources(), name));
        let mut added = vec![Added::new(distance, measured.distances)];
        added.extend(measured.levels.map(|values| Added::new(level, values)));
        let progress = Progress::default();
        let memory = half_of(first.settings.stream.host_bytes);
        let write = || codec::export(first.sources(), first.wanted(), &added, output, memory, &progress);
        let exported = progress_bar::watch("writing", &progress, write)?.ok_or(stream::Error::Cancelled)?;
        terminal::warn(exported.changes);
        terminal::warn(param::few(exported.warnings, "warnings"));
        if let Some(lack) = export::lack(output, exported.missing) {
            terminal::complain(&lack);
            status = UNUSABLE;
        }
    }
    Ok(status)
}

/// Refuses arguments of a method that is not asked for, as bad usage.
fn check_scales(arguments: &CompareArguments) -> anyhow::Result<()> {
    let CompareArguments { method, normal_scale, cylinder_scale, reach, registration, .. } = arguments;
    let scales = [
        ("--normal-scale", normal_scale),
        ("--cylinder-scale", cylinder_scale),
        ("--reach", reach),
        ("--registration", registration),
    ];
    match scales.into_iter().find(|(_, value)| value.is_some()) {
        Some((name, _)) if method != "m3c2" => Err(usage(format!("{name}: only --method m3c2 has it"))),
        _ => Ok(()),
    }
}

/// Opens the cloud that a word names.
fn open(word: &OsStr, set: &[(String, String)]) -> anyhow::Result<Side> {
    let mut request = world::resolve(&[word]);
    request.check()?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    for (key, value) in set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    recording::settings(&mut request).clone_from(&settings);
    let memory = half_of(settings.stream.host_bytes);
    request.leave_out_hidden(memory)?;
    terminal::warn(&request.warnings);
    terminal::warn(request.check_filters(&settings)?);
    terminal::warn(request.settings_without_cloud(memory));
    let mut failed = Few::of("that cannot be read");
    let inputs = export::open(&request, memory, &mut failed);
    let is_whole = failed.count() == 0 && inputs.iter().any(|sources| !sources.is_empty());
    failed.end();
    if !is_whole {
        // Distances to a part of a cloud would be wrong.
        return Err(usage(format!("{}: {}", shown(word), export::NOT_WHOLE)));
    }
    let (test, progress) = (request.test(), Progress::default());
    let mut left_out = Vec::new();
    for sources in &inputs {
        let find = || export::strays(sources, &test, &settings, &progress);
        let found = progress_bar::watch("strays", &progress, find).map_err(usage)?;
        left_out.extend(found.ok_or(stream::Error::Cancelled)?);
    }
    let sources = inputs.concat();
    let up = sources.first().map_or(DVec3::Z, |source| world::up_of(source.info(), &settings));
    let units = Units::in_common(sources.iter().map(|source| source.info().units));
    Ok(Side { points: Points::Files(sources), test, left_out, up, units, settings })
}

fn report(arguments: &CompareArguments, measured: &Measured, units: &Units) -> anyhow::Result<()> {
    let DistanceFigures { points, mean, median, std, rms, p95, max } = measured.figures;
    let Measured { significant, interval, .. } = *measured;
    let unit = units.length().map(|unit| unit.to_string());
    if arguments.json {
        return terminal::print_json(&json!({
            "points": points, "mean": mean, "median": median, "std": std, "rms": rms, "p95": p95, "max": max,
            "significant": significant, "interval": interval, "unit": unit,
        }));
    }
    let unit = unit.map_or(String::new(), |unit| format!(" {unit}"));
    let mut lines = vec![
        format!("  points       {points}"),
        format!("  mean         {mean:.6}{unit}"),
        format!("  median       {median:.6}{unit}"),
        format!("  std          {std:.6}{unit}"),
        format!("  rms          {rms:.6}{unit}"),
        format!("  95 % within  {p95:.6}{unit}"),
        format!("  max          {max:.6}{unit}"),
    ];
    lines.extend(interval.map(|interval| format!("  each ±       {interval:.6}{unit}   (95 %, the median)")));
    lines.extend(significant.map(|share| format!("  significant  {:.1} %", share * 100.0)));
    terminal::print(lines)
}
