//! `glint export`: the points that a scene shows as a new file.

use std::sync::Arc;

use anyhow::Context as _;
use cloud::{Bounds, Chunk, Progress, STRAY};
use codec::{ExportFormat, Exported, Source, Wanted};
use scene::five_mirrors::Variant;
use scene::{SceneFile, Settings, Strays, Tripod, shown, tripod};
use serde_json::json;
use world::{Input, half_of};

use crate::commands::info::{attributes_report, bounds_report};
use crate::commands::recording;
use crate::shared::command_line::ExportArguments;
use crate::shared::export::{lack, open, strays};
use crate::system::failure::{UNUSABLE, usage};
use crate::system::terminal::{self, Few};
use crate::system::{picture_file, progress_bar};

/// Writes the file. Returns exit status 2 if one of several inputs, or a part of an input, cannot be read, and says so on
/// standard error.
///
/// # Errors
/// Bad usage, no input can be read, no point is shown, the file cannot be written, or Ctrl-C.
pub fn run(arguments: &ExportArguments) -> anyhow::Result<u8> {
    let output = &arguments.output;
    if ExportFormat::of(output).is_none() {
        let expected = "the name must end in .laz, .las, .copc.laz, .e57, .ply or .csv, which is what will be in it";
        return Err(usage(format!("{}: {expected}", shown(output))));
    }
    picture_file::check_place(output)?;
    let mut request = world::resolve(&arguments.inputs);
    request.check()?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    if let Some(scene) = &arguments.scene {
        let (file, _) = SceneFile::read(scene)?;
        let Settings { splat, surface, .. } = file.view().settings;
        if splat.strays == Strays::Hidden || file.visibility.filters.iter().any(|filter| filter.attribute == STRAY) {
            (settings.splat.strays, settings.surface) = (splat.strays, surface);
        }
        request.visibility.hide(&file.visibility);
        request.clips.extend(file.clips);
        request.take_cloud_settings(&file.cloud_settings);
    }
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    recording::settings(&mut request).clone_from(&settings);
    let memory = half_of(settings.stream.host_bytes);
    request.leave_out_hidden(memory)?;
    terminal::warn(&request.warnings);
    if let [Input::BuiltIn { variant: Variant::Tripod(scan), .. }] = request.inputs.as_slice() {
        return write_made(*scan, &settings, arguments);
    }
    terminal::warn(request.check_filters(&settings)?);
    terminal::warn(request.settings_without_cloud(memory));
    let mut failed = Few::of("that cannot be read");
    let inputs = open(&request, memory, &mut failed);
    let mut status = if failed.count() > 0 { UNUSABLE } else { 0 };
    failed.end();
    let (test, progress) = (request.test(), Progress::default());
    let mut left_out = Vec::new();
    for sources in &inputs {
        let find = || strays(sources, &test, &settings, &progress);
        let found = progress_bar::watch("strays", &progress, find).map_err(usage)?;
        left_out.extend(found.ok_or(stream::Error::Cancelled)?);
    }
    let sources: Vec<Arc<Source>> = inputs.into_iter().flatten().collect();
    if sources.is_empty() {
        return Ok(status);
    }
    let (wanted, progress) = (Wanted { test: &test, left_out: &left_out }, Progress::default());
    let write = || codec::export(&sources, wanted, &[], output, memory, &progress);
    let written = progress_bar::watch("exporting", &progress, write)?;
    let Exported { points, missing, bounds, attributes, changes, warnings } =
        written.ok_or(stream::Error::Cancelled)?;
    terminal::warn(changes);
    terminal::warn(param::few(warnings, "warnings"));
    if let Some(lack) = lack(output, missing) {
        terminal::complain(&lack);
        status = UNUSABLE;
    }
    let all: u64 = sources.iter().map(|source| source.info().points).sum();
    if arguments.json {
        let announced = all.saturating_add(codec::missing_points(&sources));
        terminal::print_json(&json!({
            "path": shown(output), "points": points, "missing": missing,
            "left_out": announced.saturating_sub(points).saturating_sub(missing),
            "bounds": bounds_report(bounds), "attributes": attributes_report(&attributes),
        }))?;
    } else {
        terminal::print([format!("{}: {points} of {all} points", shown(output))])?;
    }
    Ok(status)
}

/// Writes all points of a made scan, as it comes from the scanner: places and colours.
///
/// # Errors
/// The name of the file does not end in `.ply`, what is to be left out is named, or the file cannot be written.
fn write_made(scan: Tripod, settings: &Settings, arguments: &ExportArguments) -> anyhow::Result<u8> {
    let output = &arguments.output;
    if ExportFormat::of(output) != Some(ExportFormat::Ply) || arguments.scene.is_some() {
        return Err(usage(format!("{}: a made scan is written whole, to a file that ends in .ply", shown(output))));
    }
    let scene::SceneSettings { points, seed } = settings.scene;
    let cloud = tripod::scan(scan, points.into(), seed.into());
    let count: usize = cloud.iter().map(Chunk::len).sum();
    codec::export_chunks(&cloud, output)?;
    if arguments.json {
        let bounds = cloud.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
        terminal::print_json(&json!({
            "path": shown(output), "points": count, "left_out": 0,
            "bounds": bounds_report(bounds), "attributes": attributes_report(&[]),
        }))?;
    } else {
        terminal::print([format!("{}: {count} of {count} points", shown(output))])?;
    }
    Ok(0)
}
