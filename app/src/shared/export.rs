//! Points of files as a new file: which of them are hidden as strays, and writing the others.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloud::{Chunk, Orientation, PointTest, Progress, RadiusRule, SurfelOptions, stray_kind};
use codec::{Added, ExportFormat, Exported, Runs, Source, Wanted};
use glam::Vec3;
use scene::five_mirrors::Variant;
use scene::{CloudSettings, Settings, Strays, SurfaceRadii, shown};
use world::{Input, Request, half_of};

use crate::shared::numbers::grouped;
use crate::system::failure::{FAILED, UNUSABLE, usage};
use crate::system::terminal::{self, Few};

/// The formats of a new file, and the endings of their names.
pub const FORMATS: (&str, &[&str]) = ("LAZ, LAS, COPC, E57, PLY, CSV", &["laz", "las", "e57", "ply", "csv"]);

/// The memory in bytes that a point takes while strays are looked for: its place and columns as they are read, another
/// place among those that are shown, and what the search for neighbours needs.
const BYTES_A_POINT: u64 = 64;

/// The points of the files of one cloud that are hidden because of their `stray_kind`, by the settings or by filters of
/// `cloud::STRAY`: for each file their indices in it, ascending. Strays are found as in pictures: among the points of all
/// its files that classes and filters show. `None` when cancelled.
///
/// # Errors
/// A file that cannot be read, or more points than memory allows.
pub fn strays(
    sources: &[Arc<Source>],
    test: &PointTest,
    settings: &Settings,
    progress: &Progress,
) -> Result<Option<Vec<Vec<u64>>>, String> {
    let mut strays = vec![Vec::new(); sources.len()];
    let whole = test.hiding_strays(settings.splat.strays == Strays::Hidden);
    let hidden: Vec<[bool; 3]> = sources.iter().map(|source| whole.hidden_kinds(&source.info().attributes)).collect();
    if hidden.iter().all(|kinds| *kinds == [false; 3]) || settings.surface.radii != SurfaceRadii::Spread {
        return Ok(Some(strays));
    }
    let test = test.of_attributes();
    let most = half_of(settings.stream.host_bytes) / BYTES_A_POINT;
    let points: u64 = sources.iter().map(|source| source.info().points).sum();
    if let Some(first) = sources.first().filter(|_| points > most) {
        return Err(format!(
            "{}: it cannot be said which of {points} points are stray, as at most {most} fit into stream.host_bytes = {}; \
             raise it, or keep stray points with --set splat.strays=faded and without a filter of `stray`",
            shown(&first.info().path),
            settings.stream.host_bytes
        ));
    }
    // The points that are shown, and the file and the indices of those of each chunk.
    let (mut chunks, mut places) = (Vec::new(), Vec::new());
    for (file, source) in sources.iter().enumerate() {
        if world::shows_faces(source, settings) {
            // Pictures show points on the faces, and none of those is stray.
            continue;
        }
        let attributes: Vec<&str> = test.filtered().collect();
        let read = world::read_cloud(source, &attributes, settings, progress);
        let (cloud, _) = read.map_err(|error| error.to_string())?;
        let test = cloud.test(&test);
        for chunk in &cloud.chunks {
            let shown = test.shown(chunk, chunk.bounds());
            let indices: Vec<u32> = shown.indices(chunk.len()).map(|index| index as u32).collect();
            let bare = Chunk { positions: chunk.positions.clone(), ..Chunk::new(0, chunk.origin, Vec::new()) };
            chunks.push(bare.select(&indices));
            places.push((file, chunk.first_point, indices));
        }
    }
    progress.set_total(progress.done() + chunks.iter().map(|chunk| chunk.len() as u64).sum::<u64>());
    let options = SurfelOptions {
        neighbours: settings.surface.neighbours as usize,
        radii: RadiusRule::Spread,
        ..SurfelOptions::new(Orientation::Up(Vec3::Z))
    };
    let Some(surfels) = cloud::estimate_part(&chunks, &options, progress) else { return Ok(None) };
    for ((file, first_point, indices), surfels) in places.into_iter().zip(surfels) {
        let is_hidden = |(_, radius): &(&u32, &u16)| hidden[file][usize::from(stray_kind(**radius))];
        let found = indices.iter().zip(&surfels.radii).filter(is_hidden);
        strays[file].extend(found.map(|(index, _)| first_point + u64::from(*index)));
    }
    Ok(Some(strays))
}

/// Opens the files of all inputs, input by input, and reports what cannot be opened.
pub fn open(request: &Request, memory: u64, failed: &mut Few) -> Vec<Vec<Arc<Source>>> {
    let mut inputs = Vec::new();
    for input in &request.inputs {
        match input {
            Input::BuiltIn { variant, .. } => {
                let name = input.name();
                let scan = match variant {
                    Variant::Tripod(_) => format!("; `glint study scan {name} -o scan.laz` writes one"),
                    _ => String::new(),
                };
                failed.complain(&format!("{name}: a built-in scene; this command reads files{scan}"));
            }
            Input::Unknown { error, .. } => failed.complain(error),
            Input::File(_) | Input::Tiles { .. } => {}
        }
        let mut sources = Vec::new();
        for path in input.files() {
            match request.open(input, path, memory) {
                Ok(scans) => {
                    world::lost_tiles(&scans).for_each(|error| failed.complain(error));
                    sources.extend(scans);
                }
                Err(error) => failed.complain(&error),
            }
        }
        inputs.push(sources);
    }
    inputs
}

/// Writes the points of files that a test shows, for the window, without strays if the settings hide these. `added`
/// holds values that the files do not have: the file, their name, and those of its points. Returns `None` if it was
/// cancelled.
///
/// # Errors
/// A cloud that is no file or cannot be read, or what `codec::export` cannot do.
pub fn write(
    inputs: &[String],
    own: Vec<CloudSettings>,
    test: &PointTest,
    added: &[(Place, String, Arc<Runs>)],
    path: &Path,
    settings: &Settings,
    progress: &Progress,
) -> Result<Option<Exported>, String> {
    let memory = half_of(settings.stream.host_bytes);
    let (mut sources, mut left_out, mut lost) = (Vec::new(), Vec::new(), Vec::new());
    let request = world::resolve_open(inputs, own, settings);
    for input in &request.inputs {
        if input.files().is_empty() {
            return Err(format!("{}: not a file; points of files can be saved", input.name()));
        }
        let open = |file: &PathBuf| request.open(input, file, memory);
        let own = input.files().iter().map(open).collect::<Result<Vec<_>, _>>()?.concat();
        let Some(found) = strays(&own, test, settings, progress)? else { return Ok(None) };
        left_out.extend(found);
        lost.extend(world::lost_tiles(&own).cloned());
        sources.extend(own);
    }
    if ExportFormat::of(path).is_none() {
        return Err(format!("{}: the name must end in .laz, .las, .copc.laz, .e57, .ply or .csv", shown(path)));
    }
    let wanted = Wanted { test, left_out: &left_out };
    let written = codec::export(&sources, wanted, &columns(&sources, added), path, memory, progress);
    let written = written.map_err(|error| error.to_string())?;
    Ok(written.map(|written| Exported { warnings: [written.warnings, lost].concat(), ..written }))
}

/// Says that a new file lacks points that could not be read, if there are any.
pub fn lack(output: &Path, missing: u64) -> Option<String> {
    let missing = Some(missing).filter(|missing| *missing > 0)?;
    Some(format!("{}: lacks {} points of its sources, which cannot be read", shown(output), grouped(missing)))
}

/// A name that no attribute of the files has.
pub fn free_name(sources: &[Arc<Source>], name: &str) -> String {
    let is_taken = |name: &String| {
        sources.iter().any(|source| source.info().properties.iter().any(|property| property.name == *name))
    };
    let numbered = (2..).map(|number| format!("{name}_{number}"));
    std::iter::once(name.to_owned()).chain(numbered).find(|name| !is_taken(name)).unwrap_or_default()
}

/// What is said of a cloud that is not compared because distances to the rest of it would be wrong.
pub const NOT_WHOLE: &str = "not all of this cloud can be read, so nothing is compared";

/// Refuses to compare a cloud of which points could not be read.
///
/// # Errors
/// Says how many, and why.
pub fn check_whole(name: &str, read: &codec::Summary) -> anyhow::Result<()> {
    if read.missing == 0 {
        return Ok(());
    }
    let (points, why) = (grouped(read.missing), param::few(read.warnings.clone(), "warnings").join("; "));
    Err(usage(format!("{name}: {NOT_WHOLE}; it lacks {points} points: {why}")))
}

/// Says how many points of the inputs cannot be read, if there are any. Returns the exit status, which was `status` before.
pub fn say_missing(missing: u64, status: u8) -> u8 {
    if missing == 0 {
        return status;
    }
    terminal::complain(&format!("{} points of the inputs cannot be read", grouped(missing)));
    if status == FAILED { FAILED } else { UNUSABLE }
}

/// A file, and the number of a scan in it.
pub type Place = (PathBuf, usize);

/// The added values by their names, for each file; some files have none.
fn columns(sources: &[Arc<Source>], added: &[(Place, String, Arc<Runs>)]) -> Vec<Added> {
    let names: BTreeSet<&String> = added.iter().map(|(_, name, _)| name).collect();
    let list = |source: &Arc<Source>, wanted: &String| {
        let own = (source.info().path.clone(), source.info().scan_number());
        let of_file = added.iter().find(|(place, name, _)| *place == own && name == wanted);
        of_file.map_or_else(Runs::new, |(_, _, values)| values.as_ref().clone())
    };
    let column = |name: &String| Added::new(name.clone(), sources.iter().map(|source| list(source, name)).collect());
    names.into_iter().map(column).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use scene::Paging;

    use super::*;

    #[test]
    fn tiles_that_are_named_with_their_folder_are_written_once_and_have_the_names_of_the_window() {
        let folder = tempfile::tempdir().unwrap();
        let [tiles, table] = ["tiles", "table.csv"].map(|name| folder.path().join(name));
        std::fs::create_dir(&tiles).unwrap();
        let whole = PointTest::default();
        let mut settings = Settings::default();
        for (name, x) in [("a.las", 0), ("b.las", 1), ("c.las", 9000)] {
            std::fs::write(&table, format!("x,y,z\n{x},0,0\n{x},1,0\n{x},2,1\n")).unwrap();
            let path = tiles.join(name);
            let progress = Progress::default();
            write(&[shown(&table)], Vec::new(), &whole, &[], &path, &settings, &progress).unwrap().unwrap();
        }
        let written = |own: CloudSettings, settings: &Settings, name: &str| {
            let words = [&tiles, &tiles.join("c.las")].map(shown);
            let path = folder.path().join(name);
            write(&words, vec![own], &whole, &[], &path, settings, &Progress::default()).unwrap().unwrap()
        };
        let own = CloudSettings { shift: DVec3::Z * 5.0, ..CloudSettings::of("a.las".into()) };
        let near = written(own.clone(), &settings, "near.las");
        assert_eq!((near.points, near.bounds.max.z), (9, 1.0));
        settings.stream.pages = Paging::Never;
        assert_eq!(written(own, &settings, "never.las").bounds.max.z, 6.0, "each tile is a cloud");
    }

    #[test]
    fn strays_of_more_points_than_fit_into_memory_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let header = "ply\nformat ascii 1.0\nelement vertex 40\nproperty float x\nproperty float y\nproperty float z\n";
        let rows: String = (0..40).map(|at| format!("{} {} 0\n", at % 8, at / 8)).collect();
        std::fs::write(&path, format!("{header}end_header\n{rows}")).unwrap();
        let mut settings = Settings::default();
        let sources = world::open_file(&path, half_of(settings.stream.host_bytes)).unwrap();
        settings.stream.host_bytes.0 = 2 * BYTES_A_POINT * 39;
        let of = |settings: &Settings| strays(&sources, &PointTest::default(), settings, &Progress::default());
        assert_eq!(of(&settings), Ok(Some(vec![Vec::new()])), "they are shown");
        settings.splat.strays = Strays::Hidden;
        let refused = of(&settings).unwrap_err();
        assert!(
            refused.contains("it cannot be said which of 40 points are stray, as at most 39 fit into"),
            "{refused}"
        );
        settings.stream.host_bytes.0 += 2 * BYTES_A_POINT;
        assert_eq!(of(&settings), Ok(Some(vec![Vec::new()])));
        let progress = Progress::default();
        progress.cancel();
        assert_eq!(strays(&sources, &PointTest::default(), &settings, &progress), Ok(None));
    }
}
