//! `glint compare`: how far the points of a cloud are from another one. Both are read chunk by chunk; only places and
//! distances stay in memory.

use std::ffi::OsStr;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context as _;
use cloud::{Chunk, Cloud, PointTest, Progress};
use codec::{Added, ExportFormat, Runs, Selection, Source};
use glam::DVec3;
use measure::{DistanceFigures, M3c2, PointTree};
use scene::{Settings, shown};
use serde_json::json;
use world::half_of;

use crate::command_line::CompareArguments;
use crate::failure::usage;
use crate::terminal::{self, Few};
use crate::{export_command, interrupt, picture_file, progress_bar};

/// The number of points of the first cloud that decide to which side normals point.
const ORIENTING_POINTS: usize = 200_000;

/// The files of a cloud, and which of their points are shown.
struct Side {
    sources: Vec<Arc<Source>>,
    test: PointTest,
    settings: Settings,
}

/// What is measured at the points of the first cloud, for each of its files. Points that are hidden or have no distance
/// are NaN.
struct Measured {
    distances: Vec<Runs>,
    /// The levels of detection, if the method has them.
    levels: Option<Vec<Runs>>,
}

/// Measures the distances, prints what they amount to, and writes them if a file is named. Returns the exit status.
///
/// # Errors
/// Bad usage, a cloud that cannot be read or has no points, no distances, the file cannot be written, or Ctrl-C.
pub fn run(arguments: &CompareArguments) -> anyhow::Result<u8> {
    if let Some(output) = &arguments.output {
        if ExportFormat::of(output).is_none() {
            let expected = "the name must end in .laz, .las, .copc.laz, .ply or .csv, which is what will be in it";
            return Err(usage(format!("{}: {expected}", shown(output))));
        }
        picture_file::check_place(output)?;
    }
    let [first, second] = [&arguments.first, &arguments.second].map(|word| open(word, &arguments.set));
    let (first, second) = (first?, second?);
    let all = first.sources.iter().chain(&second.sources);
    terminal::warn(param::few(world::other_systems(all.map(|source| source.info())), "warnings"));
    let second_tree = read_tree(&second, "second")?;
    let is_m3c2 = arguments.method == "m3c2";
    let measured = if is_m3c2 {
        let first_tree = read_tree(&first, "first")?;
        let options = options(arguments, &first, &first_tree).map_err(|error| usage(error.to_string()))?;
        measure(&first, true, |place, around| {
            let change = options.change(&first_tree, &second_tree, place, around);
            change.map_or([f32::NAN; 2], |change| [change.distance as f32, change.level.map_or(f32::NAN, |l| l as f32)])
        })?
    } else {
        measure(&first, false, |place, _| [second_tree.distance(place).map_or(f32::NAN, |d| d as f32), f32::NAN])?
    };
    drop(second_tree);
    report(arguments, &measured)?;
    if let Some(output) = &arguments.output {
        let mut added = vec![Added { name: free_name(&first, "distance"), values: measured.distances }];
        added.extend(measured.levels.map(|values| Added { name: free_name(&first, "level_of_detection"), values }));
        let progress = Progress::default();
        let memory = half_of(first.settings.stream.host_bytes);
        let write = || codec::export(&first.sources, &first.test, &added, output, memory, &progress);
        let exported = progress_bar::watch("writing", &progress, write)?.ok_or(stream::Error::Cancelled)?;
        terminal::warn(param::few(exported.warnings, "warnings"));
    }
    Ok(0)
}

/// Opens the cloud that a word names.
fn open(word: &OsStr, set: &[(String, String)]) -> anyhow::Result<Side> {
    let request = world::resolve(&[word]);
    request.check()?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    for (key, value) in set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    terminal::warn(&request.warnings);
    let mut failed = Few::of("that cannot be read");
    let sources = export_command::open(&request, half_of(settings.stream.host_bytes), &mut failed);
    let is_whole = failed.count() == 0 && !sources.is_empty();
    failed.end();
    if !is_whole {
        // Distances to a part of a cloud would be wrong.
        return Err(usage(format!("{}: not all of this cloud can be read, so nothing is compared", shown(word))));
    }
    Ok(Side { sources, test: request.test(), settings })
}

/// Calls `give` with the chunks of all files, the number of the file, what the chunks belong to, and which of their
/// points are shown.
fn read(
    side: &Side,
    task: &str,
    give: impl Fn(usize, &Cloud, &Chunk, &cloud::ShownPoints) + Sync,
) -> anyhow::Result<()> {
    for (number, source) in side.sources.iter().enumerate() {
        let info = source.info();
        let (name, attributes) = (shown(&info.path), info.attributes.clone());
        let is_read = |name: &str| name == "classification" || side.test.filtered().any(|filtered| filtered == name);
        let selected = attributes.iter().map(|attribute| is_read(&attribute.name)).collect();
        let cloud = Cloud { name, attributes, grid: info.grid, chunks: Vec::new() };
        let test = cloud.test(&side.test);
        let selection = Selection { positions: true, attributes: selected, ..Selection::default() };
        let progress = Progress::default();
        let emit = |chunk: Chunk| give(number, &cloud, &chunk, &test.shown(&chunk, chunk.bounds()));
        let summary = progress_bar::watch(task, &progress, || source.read(&selection, &progress, &emit))?;
        interrupt::check()?;
        terminal::warn(
            info.warnings.iter().chain(&summary.warnings).map(|warning| format!("{}: {warning}", cloud.name)),
        );
    }
    Ok(())
}

fn read_tree(side: &Side, which: &str) -> anyhow::Result<PointTree> {
    // By file and chunk, so that the tree does not depend on the order in which chunks come.
    let found = Mutex::new(Vec::new());
    read(side, "reading", |number, cloud, chunk, shown| {
        let places: Vec<DVec3> = shown.indices(chunk.len()).map(|index| cloud.world_position(chunk, index)).collect();
        found.lock().unwrap_or_else(PoisonError::into_inner).push(((number, chunk.first_point), places));
    })?;
    let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    found.sort_unstable_by_key(|(place, _)| *place);
    let mut places = Vec::with_capacity(found.iter().map(|(_, places)| places.len()).sum());
    found.into_iter().for_each(|(_, mut part)| places.append(&mut part));
    let tree = PointTree::new(places);
    interrupt::check()?;
    if tree.is_empty() { Err(usage(format!("the {which} cloud shows no points"))) } else { Ok(tree) }
}

fn options(arguments: &CompareArguments, first: &Side, tree: &PointTree) -> measure::Result<M3c2> {
    let CompareArguments { normal_scale, cylinder_scale, reach, .. } = arguments;
    let up = first.sources.first().map_or(DVec3::Z, |source| world::up_of(source.info(), &first.settings));
    let step = tree.len().div_ceil(ORIENTING_POINTS).max(1);
    let origin = tree.points().first().copied().unwrap_or_default().round();
    let some = tree.points().iter().step_by(step).map(|point| (*point - origin).as_vec3().to_array()).collect();
    let orientation = world::options_for(&[Chunk::new(0, origin, some)], up, &first.settings).orientation;
    M3c2::new(tree, *normal_scale, *cylinder_scale, *reach, orientation)
}

/// Measures all shown points of the first cloud: `at` gives the distance and the level of detection.
fn measure(
    first: &Side,
    has_levels: bool,
    at: impl Fn(DVec3, &mut Vec<DVec3>) -> [f32; 2] + Sync,
) -> anyhow::Result<Measured> {
    let none = || vec![Runs::new(); first.sources.len()];
    let lists = Mutex::new((none(), has_levels.then(none)));
    read(first, "comparing", |number, cloud, chunk, shown| {
        let mut around = Vec::new();
        let mut value = |index: usize| match shown.has(index) {
            true => at(cloud.world_position(chunk, index), &mut around),
            false => [f32::NAN; 2],
        };
        let values: Vec<[f32; 2]> = (0..chunk.len()).map(&mut value).collect();
        let run = |which: usize| values.iter().map(|value| value[which]).collect();
        let mut lists = lists.lock().unwrap_or_else(PoisonError::into_inner);
        let (distances, levels) = &mut *lists;
        distances[number].insert(chunk.first_point, run(0));
        levels.iter_mut().for_each(|levels| drop(levels[number].insert(chunk.first_point, run(1))));
    })?;
    let (distances, levels) = lists.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Measured { distances, levels })
}

/// A name that no attribute of the cloud has.
fn free_name(side: &Side, name: &str) -> String {
    let is_taken = |name: &String| {
        side.sources.iter().any(|source| source.info().properties.iter().any(|property| property.name == *name))
    };
    let numbered = (2..).map(|number| format!("{name}_{number}"));
    std::iter::once(name.to_owned()).chain(numbered).find(|name| !is_taken(name)).unwrap_or_default()
}

fn report(arguments: &CompareArguments, measured: &Measured) -> anyhow::Result<()> {
    let all = |runs: &[Runs]| -> Vec<f32> { runs.iter().flat_map(Runs::values).flatten().copied().collect() };
    let distances = all(&measured.distances);
    let significant = measured.levels.as_ref().map(|levels| {
        let levels = all(levels);
        distances.iter().zip(levels).filter(|(distance, level)| distance.abs() > *level).count()
    });
    let figures = DistanceFigures::of(distances);
    let DistanceFigures { points, mean, median, std, rms, p95, max } =
        figures.ok_or_else(|| usage("no point of the first cloud has a distance to the second"))?;
    let significant = significant.map(|count| count as f64 / points as f64);
    if arguments.json {
        return terminal::print_json(&json!({
            "points": points, "mean": mean, "median": median, "std": std, "rms": rms, "p95": p95, "max": max,
            "significant": significant,
        }));
    }
    let mut lines = vec![
        format!("  points       {points}"),
        format!("  mean         {mean:.6}"),
        format!("  median       {median:.6}"),
        format!("  std          {std:.6}"),
        format!("  rms          {rms:.6}"),
        format!("  95 % within  {p95:.6}"),
        format!("  max          {max:.6}"),
    ];
    lines.extend(significant.map(|share| format!("  significant  {:.1} %", share * 100.0)));
    terminal::print(lines)
}
