//! `glint profile`: the points of one or more sections as a table, a chart or a file of points.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use cloud::Progress;
use codec::{Exported, Wanted};
use scene::{Profile, shown};
use world::Request;

use crate::commands::recording;
use crate::shared::command_line::ProfileArguments;
use crate::shared::export;
use crate::shared::numbers::grouped;
use crate::shared::profiles::{Asked, Kind, Table, read};
use crate::system::failure::{self, FAILED, UNUSABLE, usage};
use crate::system::terminal::{self, Few};
use crate::system::{interrupt, picture_file, progress_bar};

/// Writes the sections. Returns exit status 2 if one of several inputs, or a part of one, cannot be read, and says so on
/// standard error.
///
/// # Errors
/// Bad usage, no input can be read, the file cannot be written, or Ctrl-C.
pub fn run(arguments: &ProfileArguments) -> anyhow::Result<u8> {
    let mut kind = Kind::Table;
    if let Some(output) = &arguments.output {
        let expected =
            "the name must end in .csv, .svg, .png, .laz, .las, .copc.laz or .ply, which is what will be in it";
        kind = Kind::of(output).ok_or_else(|| usage(format!("{}: {expected}", shown(output))))?;
        picture_file::check_place(output)?;
    }
    let mut request = world::resolve(&arguments.inputs);
    request.check()?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    let profiles = match (&arguments.line, arguments.width) {
        (Some(line), Some(width)) => vec![Profile::new(line.0.clone(), width)],
        _ => request.profiles().filter(|profile| profile.on).cloned().collect(),
    };
    if profiles.is_empty() {
        let expected = "--line and --width, or a scene file with a profile that is switched on";
        return Err(usage(format!("no profile is asked for, expected {expected}")));
    }
    let test = request.test();
    recording::settings(&mut request).clone_from(&settings);
    let memory = world::half_of(settings.stream.host_bytes);
    request.leave_out_hidden(memory)?;
    terminal::warn(&request.warnings);
    terminal::warn(request.check_filters(&settings)?);
    terminal::warn(request.settings_without_cloud(memory));
    let stack = (arguments.copies, arguments.spacing.unwrap_or_default());
    if !stack.1.is_finite() {
        return Err(usage(format!("--spacing {}: expected a finite distance", stack.1)));
    }
    let keeps_points = kind != Kind::Points && (arguments.output.is_some() || !arguments.json);
    let has_intervals = keeps_points && kind == Kind::Table;
    let (profiles, test, settings) = (&profiles, &test, &settings);
    let asked = Asked { profiles, stack, test, settings, is_watched: true, keeps_points, has_intervals };
    if let (Kind::Points, Some(output)) = (kind, &arguments.output) {
        return export_points(&request, &asked, output, arguments.json);
    }
    let (mut table, mut status, mut missing, mut read_ones) = (Table::new(&asked), 0, 0_u64, Vec::new());
    let mut failed = Few::of("that cannot be read");
    for input in &request.inputs {
        let files = input.files();
        if files.is_empty() {
            status = UNUSABLE;
            failed.complain(&format!("{}: a profile is made of files", input.name()));
        }
        let is_output = |file: &PathBuf| {
            arguments.output.as_deref().is_some_and(|output| picture_file::place(output) == picture_file::place(file))
        };
        if let Some(file) = files.iter().find(|file| is_output(file)) {
            return Err(usage(format!("{}: named for an input and an output", shown(file))));
        }
        let mut complain = |error: &anyhow::Error| {
            let is_unusable = failure::exit_status(error) == UNUSABLE && status != FAILED;
            status = if is_unusable { UNUSABLE } else { FAILED };
            failed.complain(&format!("{error:#}"));
        };
        let mut sources = Vec::new();
        for file in files {
            match request.open(input, file, memory).map_err(usage) {
                Ok(scans) => {
                    world::lost_tiles(&scans).for_each(|lost| complain(&usage(lost.clone())));
                    sources.extend(scans);
                }
                Err(error) => complain(&error),
            }
        }
        let left_out = asked.strays(&sources)?;
        for (number, source) in sources.iter().enumerate() {
            match read(source, &left_out[number..=number], &asked, &mut table) {
                Ok((warnings, own)) => {
                    missing += own;
                    let info = source.info();
                    let of_points = warnings.iter().map(|warning| format!("{}: {warning}", shown(&info.path)));
                    terminal::warn(world::file_warnings(info).chain(of_points));
                    read_ones.push(info.clone());
                }
                Err(error) => complain(&error),
            }
            interrupt::check()?;
        }
    }
    failed.end();
    if read_ones.is_empty() {
        return Ok(status);
    }
    terminal::warn(param::few(world::system_warnings(&read_ones), "warnings"));
    let is_empty = |section: usize| table.extents[section].points == 0;
    let empty: Vec<usize> = (0..table.sections.len()).filter(|section| is_empty(*section)).collect();
    match empty.as_slice() {
        [] => {}
        _ if table.sections.len() == 1 => terminal::warn(["the section holds no points"]),
        empty if empty.len() == table.sections.len() => terminal::warn(["no section holds points"]),
        some => {
            let told = some.iter().map(|section| format!("{}: the section holds no points", table.sections[*section]));
            terminal::warn(param::few(told.collect(), "sections without points"));
        }
    }
    terminal::warn(table.of_colors());
    let report = arguments.json.then(|| table.report(arguments.output.as_deref()));
    match &arguments.output {
        Some(output) => {
            let points: u64 = table.extents.iter().map(|extent| extent.points).sum();
            match kind {
                Kind::Chart => table.draw(settings, &request.cloud_settings, output)?,
                _ => picture_file::write_text(output, &table.into_csv()?)?,
            }
            if report.is_none() {
                terminal::print([format!("{}: {} points", shown(output), grouped(points))])?;
            }
        }
        None if arguments.json => {}
        None => terminal::print(table.into_csv()?.lines())?,
    }
    if let Some(report) = report {
        terminal::print_json(&report)?;
    }
    Ok(export::say_missing(missing, status))
}

/// Writes the points of sections to a new file, with all that is known of each. Points of several of them come once.
fn export_points(request: &Request, asked: &Asked, output: &Path, is_json: bool) -> anyhow::Result<u8> {
    let memory = world::half_of(asked.settings.stream.host_bytes);
    let mut failed = Few::of("that cannot be read");
    let inputs = export::open(request, memory, &mut failed);
    let mut status = if failed.count() > 0 { UNUSABLE } else { 0 };
    failed.end();
    let left_out: Vec<Vec<u64>> =
        inputs.iter().map(|sources| asked.strays(sources)).collect::<anyhow::Result<Vec<_>>>()?.concat();
    let sources = inputs.concat();
    let Some(first) = sources.first() else { return Ok(status) };
    let test = asked.test.within(asked.volumes(first.info())?);
    let (wanted, progress) = (Wanted { test: &test, left_out: &left_out }, Progress::default());
    let write = || codec::export(&sources, wanted, &[], output, memory, &progress);
    let written = progress_bar::watch("exporting", &progress, write)?;
    let Exported { points, missing, changes, warnings, .. } = written.ok_or(stream::Error::Cancelled)?;
    terminal::warn(changes);
    terminal::warn(param::few(warnings, "warnings"));
    if let Some(lack) = export::lack(output, missing) {
        terminal::complain(&lack);
        status = UNUSABLE;
    }
    if is_json {
        // The files are read once more: the new one no longer shows which points are in which section.
        let mut table = Table::new(asked);
        for (number, source) in sources.iter().enumerate() {
            read(source, &left_out[number..=number], asked, &mut table)?;
        }
        terminal::print_json(&table.report(Some(output)))?;
    } else {
        terminal::print([format!("{}: {} points", shown(output), grouped(points))])?;
    }
    Ok(status)
}
