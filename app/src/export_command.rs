//! `glint export`: the points that a scene shows as a new file.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use cloud::{PointTest, Progress};
use codec::{Added, ExportFormat, Exported, Runs, Source};
use scene::{SceneFile, shown};
use world::{Request, half_of};

use crate::command_line::ExportArguments;
use crate::failure::{UNUSABLE, usage};
use crate::terminal::{self, Few};
use crate::{picture_file, progress_bar};

/// Writes the file. Returns exit status 2 if one of several inputs cannot be read, and says so on standard error.
///
/// # Errors
/// Bad usage, no input can be read, no point is shown, the file cannot be written, or Ctrl-C.
pub fn run(arguments: &ExportArguments) -> anyhow::Result<u8> {
    let output = &arguments.output;
    if ExportFormat::of(output).is_none() {
        let expected = "the name must end in .laz, .las, .copc.laz, .ply or .csv, which is what will be in it";
        return Err(usage(format!("{}: {expected}", shown(output))));
    }
    picture_file::check_place(output)?;
    let mut request = world::resolve(&arguments.inputs);
    request.check()?;
    if let Some(scene) = &arguments.scene {
        let (file, _) = SceneFile::read(scene)?;
        request.visibility.hide(&file.visibility);
        request.clips.extend(file.clips);
    }
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    terminal::warn(&request.warnings);
    let memory = half_of(settings.stream.host_bytes);
    let mut failed = Few::of("that cannot be read");
    let sources = open(&request, memory, &mut failed);
    let status = if failed.count() > 0 { UNUSABLE } else { 0 };
    failed.end();
    if sources.is_empty() {
        return Ok(status);
    }
    let progress = Progress::default();
    let write = || codec::export(&sources, &request.test(), &[], output, memory, &progress);
    let written = progress_bar::watch("exporting", &progress, write)?;
    let Exported { points, warnings } = written.ok_or(stream::Error::Cancelled)?;
    terminal::warn(param::few(warnings, "warnings"));
    let all: u64 = sources.iter().map(|source| source.info().points).sum();
    terminal::print([format!("{}: {points} of {all} points", shown(output))])?;
    Ok(status)
}

/// Opens the files of all inputs, and reports what cannot be opened.
pub fn open(request: &Request, memory: u64, failed: &mut Few) -> Vec<Arc<Source>> {
    let mut sources = Vec::new();
    for input in &request.inputs {
        match input {
            world::Input::BuiltIn { .. } => {
                failed.complain(&format!("{}: a built-in scene; this command reads files", input.name()));
            }
            world::Input::Unknown { error, .. } => failed.complain(error),
            world::Input::File(_) | world::Input::Tiles { .. } => {}
        }
        for path in input.files() {
            match world::open_file(path, memory) {
                Ok(source) => sources.push(source),
                Err(error) => failed.complain(&error),
            }
        }
    }
    sources
}

/// Writes the points of files that a test shows, for the window. `added` holds values that the files do not have: the
/// file, their name, and those of its points. Returns `None` if it was cancelled.
///
/// # Errors
/// A cloud that is no file or cannot be read, or what `codec::export` cannot do.
pub fn write(
    inputs: &[String],
    test: &PointTest,
    added: &[(PathBuf, String, Arc<Runs>)],
    path: &Path,
    memory: u64,
    progress: &Progress,
) -> Result<Option<Exported>, String> {
    let mut sources = Vec::new();
    for input in world::resolve(inputs).inputs {
        if input.files().is_empty() {
            return Err(format!("{}: not a file; points of files can be saved", input.name()));
        }
        for file in input.files() {
            sources.push(world::open_file(file, memory)?);
        }
    }
    if ExportFormat::of(path).is_none() {
        return Err(format!("{}: the name must end in .laz, .las, .copc.laz, .ply or .csv", shown(path)));
    }
    codec::export(&sources, test, &columns(&sources, added), path, memory, progress).map_err(|error| error.to_string())
}

/// The added values by their names, for each file; some files have none.
fn columns(sources: &[Arc<Source>], added: &[(PathBuf, String, Arc<Runs>)]) -> Vec<Added> {
    let names: BTreeSet<&String> = added.iter().map(|(_, name, _)| name).collect();
    let list = |source: &Arc<Source>, wanted: &String| {
        let of_file = added.iter().find(|(path, name, _)| *path == source.info().path && name == wanted);
        of_file.map_or_else(Runs::new, |(_, _, values)| values.as_ref().clone())
    };
    let column =
        |name: &String| Added { name: name.clone(), values: sources.iter().map(|source| list(source, name)).collect() };
    names.into_iter().map(column).collect()
}
