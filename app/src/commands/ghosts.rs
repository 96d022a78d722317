//! `glint ghosts`: points that a scanner saw in mirrors and panes, told and put back.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use cloud::{Chunk, Cloud, Column, PointTest, Progress};
use codec::{Added, ExportFormat, Runs, Selection, Source, Wanted};
use ghost::{Block, Extent, Found, Kind, Mirrors, Points, Reflector, Suspect, Told};
use glam::DVec3;
use scene::{Mirror, SceneFile, Shape, shown};
use serde_json::json;
use world::half_of;

use crate::commands::made_scan::name_of;
use crate::shared::comparing::free_name;
use crate::shared::export;
use crate::shared::ghost_arguments::GhostsArguments;
use crate::shared::moved_points;
use crate::shared::numbers::grouped;
use crate::system::failure::{UNUSABLE, usage};
use crate::system::terminal::{self, Few};
use crate::system::{picture_file, progress_bar};

/// Tells the ghosts, prints a report, and writes the points if a file is named. Returns exit status 2 if one of several
/// inputs cannot be read.
///
/// # Errors
/// Bad usage, no station, no input can be read, the file cannot be written, or Ctrl-C.
pub fn run(arguments: &GhostsArguments) -> anyhow::Result<u8> {
    check_output(arguments)?;
    let mut request = world::resolve(&arguments.inputs);
    request.check()?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    let mut given = std::mem::take(&mut request.mirrors);
    if let Some(path) = &arguments.scene {
        let (file, _) = SceneFile::read(path)?;
        given.extend(file.mirrors);
    }
    terminal::warn(&request.warnings);
    let memory = half_of(settings.stream.host_bytes);
    let mut failed = Few::of("that cannot be read");
    let sources = export::open(&request, memory, &mut failed).concat();
    let status = if failed.count() > 0 { UNUSABLE } else { 0 };
    failed.end();
    if sources.is_empty() {
        return Ok(status);
    }
    let (stations, of_file) = stations(&sources, &arguments.station)?;
    let total: u64 = sources.iter().map(|source| source.info().points).sum();
    let progress = Progress::default();
    let files = Files { sources: &sources, of_file: &of_file, progress: &progress };
    let (found, told) = progress_bar::watch("ghosts", &progress, || tell(&files, &stations, &given, total))?;
    let put_back = told.count(Kind::Ghost) * u64::from(arguments.put_back);
    if let Some(output) = &arguments.output {
        write(&sources, &told, output, arguments.put_back, memory)?;
    }
    report(arguments, &stations, &found, &told, put_back)?;
    Ok(status)
}

fn check_output(arguments: &GhostsArguments) -> anyhow::Result<()> {
    let Some(output) = &arguments.output else {
        return match arguments.put_back {
            true => Err(usage("--put-back: name the file to write the points to with -o")),
            false => Ok(()),
        };
    };
    if ExportFormat::of(output).is_none() {
        let expected = "the name must end in .laz, .las, .copc.laz, .e57, .ply or .csv, which is what will be in it";
        return Err(usage(format!("{}: {expected}", shown(output))));
    }
    if output.symlink_metadata().is_ok() {
        return Err(usage(format!("{}: a file of this name is there", shown(output))));
    }
    picture_file::check_place(output)
}

/// The stations, and for each file the index of its own, if that is known.
fn stations(sources: &[Arc<Source>], named: &[DVec3]) -> anyhow::Result<(Vec<DVec3>, Vec<Option<usize>>)> {
    if let Some(place) = named.iter().find(|place| !place.is_finite()) {
        return Err(usage(format!("--station {place}: expected finite coordinates")));
    }
    if !named.is_empty() {
        let own = (named.len() == 1).then_some(0);
        return Ok((named.to_vec(), vec![own; sources.len()]));
    }
    let (mut stations, mut of_file) = (Vec::new(), Vec::new());
    for source in sources {
        let place = source.info().scan.as_ref().and_then(|scan| scan.position);
        of_file.push(place.map(|place| {
            stations.iter().position(|known| *known == place).unwrap_or_else(|| {
                stations.push(place);
                stations.len() - 1
            })
        }));
    }
    if stations.is_empty() {
        let name = shown(&sources[0].info().path);
        return Err(usage(format!("{name}: it is not known where the scanner stood; say so with --station X,Y,Z")));
    }
    Ok((stations, of_file))
}

/// The points of files, read anew each time.
struct Files<'a> {
    sources: &'a [Arc<Source>],
    of_file: &'a [Option<usize>],
    progress: &'a Progress,
}

impl Points for Files<'_> {
    type Error = codec::Error;

    fn read(&self, give: &(dyn Fn(&Block) + Sync)) -> codec::Result<()> {
        for (file, source) in self.sources.iter().enumerate() {
            let info = source.info();
            let cloud = Cloud { grid: info.grid, ..Cloud::default() };
            let reading = Progress::default();
            let emit = |chunk: Chunk| {
                if self.progress.is_cancelled() {
                    return reading.cancel();
                }
                let places = (0..chunk.len()).map(|index| cloud.world_position(&chunk, index)).collect();
                give(&Block { file, first_point: chunk.first_point, station: self.of_file[file], places });
                self.progress.add(chunk.len() as u64);
            };
            let selection = Selection { positions: true, ..Selection::default() };
            let summary = source.read(&selection, &reading, &emit)?;
            terminal::warn(summary.warnings.iter().map(|warning| format!("{}: {warning}", shown(&info.path))));
        }
        Ok(())
    }
}

/// The mirrors, given or found, and what is told of the points.
fn tell(files: &Files<'_>, stations: &[DVec3], given: &[Mirror], total: u64) -> anyhow::Result<(Vec<Found>, Told)> {
    files.progress.set_total(if given.is_empty() { 5 } else { 4 } * total);
    let extent = Extent::of(files, total)?.ok_or_else(|| usage("no points to tell ghosts among"))?;
    let found = match given {
        [] => ghost::find(files, stations, extent, total, files.progress)?.ok_or(stream::Error::Cancelled)?,
        given => given.iter().cloned().map(Found::given).collect(),
    };
    let reflectors: Vec<Reflector> = found.iter().map(|found| found.reflector.clone()).collect();
    let mirrors = Mirrors::new(reflectors);
    let told = ghost::tell(files, stations, &mirrors, extent, 0.0, files.progress)?;
    Ok((found, told.ok_or(stream::Error::Cancelled)?))
}

/// Writes the points with what is told of them, and the unfolded ones after them.
fn write(sources: &[Arc<Source>], told: &Told, output: &Path, puts_back: bool, memory: u64) -> anyhow::Result<()> {
    let names = ["ghost", "ghost_mirror", "ghost_error"].map(|name| free_name(sources, name));
    let test = PointTest::default();
    let mut all = sources.to_vec();
    let mut columns: [Vec<Runs>; 3] = [Vec::new(), Vec::new(), Vec::new()];
    for (file, source) in sources.iter().enumerate() {
        let points = source.info().points;
        let own = |value: &dyn Fn(&Suspect) -> f32, plain| runs(told, file, points, value, plain);
        columns[0].push(own(&|suspect| f32::from(suspect.kind.number()), 0.0));
        columns[1].push(own(&|suspect| f32::from(suspect.mirror), 0.0));
        columns[2].push(Runs::new());
    }
    let mut temporary = Temporary(Vec::new());
    if puts_back && told.count(Kind::Ghost) > 0 {
        for (file, source) in sources.iter().enumerate() {
            let ghosts = ghosts_of(told, file);
            if ghosts.is_empty() {
                continue;
            }
            let is_las = matches!(**source, Source::Las(_));
            let ending = if is_las { "las" } else { "ply" };
            let path = output.with_file_name(format!(".{}.{file}.put-back.{ending}", name_of(output)));
            temporary.0.push(path.clone());
            let left_out = [others(&ghosts, source.info().points)];
            let wanted = Wanted { test: &test, left_out: &left_out };
            let progress = Progress::default();
            let copy = || codec::export(std::slice::from_ref(source), wanted, &[], &path, memory, &progress);
            progress_bar::watch("unfolding", &progress, copy)?.ok_or(stream::Error::Cancelled)?;
            let places: Vec<DVec3> = ghosts.iter().map(|(_, suspect)| suspect.place).collect();
            moved_points::put(&path, &places).with_context(|| shown(&path))?;
            all.extend(codec::open_scans(&path, memory)?.into_iter().map(Arc::new));
            let whole = |value: &dyn Fn(&Suspect) -> f32| {
                let values = ghosts.iter().map(|(_, suspect)| value(suspect)).collect();
                Runs::from([(0, Arc::new(Column::F32(values)))])
            };
            // Where it is now, the point is real; the number tells by which mirror it was seen.
            columns[0].push(whole(&|_| 0.0));
            columns[1].push(whole(&|suspect| f32::from(suspect.mirror)));
            columns[2].push(whole(&|suspect| suspect.error));
        }
    }
    let mut added: Vec<Added> = names.into_iter().zip(columns).map(|(name, runs)| Added::new(name, runs)).collect();
    added.truncate(if temporary.0.is_empty() { 2 } else { 3 });
    let progress = Progress::default();
    let copy = || codec::export(&all, &test, &added, output, memory, &progress);
    let exported = progress_bar::watch("writing", &progress, copy)?.ok_or(stream::Error::Cancelled)?;
    terminal::warn(exported.changes);
    terminal::warn(param::few(exported.warnings, "warnings"));
    Ok(())
}

/// Files that are removed in the end.
struct Temporary(Vec<PathBuf>);

impl Drop for Temporary {
    fn drop(&mut self) {
        // What is left of them does no harm.
        self.0.iter().for_each(|path| drop(std::fs::remove_file(path)));
    }
}

/// A value of each point of a file: that of suspects, and one for all others.
fn runs(told: &Told, file: usize, points: u64, value: &dyn Fn(&Suspect) -> f32, plain: f32) -> Runs {
    /// Points of a run at most, where no suspects are.
    const LONGEST: u64 = 1 << 20;
    let mut runs = BTreeMap::new();
    let mut blocks: Vec<(u64, u64)> = Vec::new();
    let mut add = |from: u64, to: u64| {
        let mut from = from;
        while from < to {
            let end = to.min(from + LONGEST);
            blocks.push((from, end));
            from = end;
        }
    };
    let own = told.suspects.range((file, 0)..(file + 1, 0));
    let mut marked: Vec<(u64, f32)> = Vec::new();
    for ((_, first), suspects) in own {
        marked.extend(suspects.iter().map(|suspect| (first + u64::from(suspect.index), value(suspect))));
    }
    add(0, points);
    for (from, to) in blocks {
        let mut values = vec![plain; (to - from) as usize];
        let start = marked.partition_point(|(index, _)| *index < from);
        for (index, value) in marked[start..].iter().take_while(|(index, _)| *index < to) {
            values[(index - from) as usize] = *value;
        }
        runs.insert(from, Arc::new(Column::F32(values)));
    }
    runs
}

/// The ghosts of a file with their indices in it, in its order.
fn ghosts_of(told: &Told, file: usize) -> Vec<(u64, Suspect)> {
    let own = told.suspects.range((file, 0)..(file + 1, 0));
    own.flat_map(|((_, first), suspects)| {
        let ghosts = suspects.iter().filter(|suspect| suspect.kind == Kind::Ghost);
        ghosts.map(move |suspect| (first + u64::from(suspect.index), *suspect))
    })
    .collect()
}

/// The indices of all points of a file but these.
fn others(ghosts: &[(u64, Suspect)], points: u64) -> Vec<u64> {
    let mut ghosts = ghosts.iter().map(|(index, _)| *index).peekable();
    (0..points).filter(|index| ghosts.next_if_eq(index).is_none()).collect()
}

/// The shape of a mirror in numbers.
fn parameters(mirror: &Mirror) -> serde_json::Value {
    let Mirror { shape, position, rotation, size, .. } = mirror;
    let mut parameters = json!({
        "position": position.to_array(), "rotation": rotation.to_array(), "size": size, "name": mirror.name,
    });
    match shape {
        Shape::Plane { height } => {
            parameters["normal"] = json!((*rotation * DVec3::Z).to_array());
            parameters["height"] = json!(height);
        }
        Shape::Sphere => parameters["radius"] = json!(size),
        Shape::Paraboloid { focal_length } => parameters["focal_length"] = json!(focal_length),
        Shape::Torus { tube } => parameters["tube"] = json!(tube),
        Shape::Blob | Shape::Coral | Shape::Mesh(_) => {}
    }
    parameters
}

fn report(
    arguments: &GhostsArguments,
    stations: &[DVec3],
    found: &[Found],
    told: &Told,
    put_back: u64,
) -> anyhow::Result<()> {
    let (ghosts, undecided) = (told.count(Kind::Ghost), told.count(Kind::Undecided));
    if arguments.json {
        let mirror = |(index, found): (usize, &Found)| {
            let (points, residual) = told.of_mirror(index);
            let mirror = &found.reflector.mirror;
            json!({
                "kind": mirror.shape.name(), "parameters": parameters(mirror), "points": points, "residual": residual,
                "reason": found.reason,
            })
        };
        let mirrors: Vec<_> = found.iter().enumerate().map(mirror).collect();
        let stations: Vec<[f64; 3]> = stations.iter().map(|station| station.to_array()).collect();
        return terminal::print_json(&json!({
            "stations": stations, "mirrors": mirrors, "ghosts": ghosts, "undecided": undecided, "put_back": put_back,
        }));
    }
    let place = |place: &DVec3| format!("({:.2}, {:.2}, {:.2})", place.x, place.y, place.z);
    let places: Vec<String> = stations.iter().map(place).collect();
    let mut lines = vec![format!("  stations     {}", places.join(", "))];
    for (index, found) in found.iter().enumerate() {
        let (points, residual) = told.of_mirror(index);
        let mirror = &found.reflector.mirror;
        let residual = residual.map_or("-".into(), |residual| format!("{residual:.4}"));
        lines.push(format!(
            "  mirror {:<5} {} at {}, size {:.3}: {} ghosts, {residual} from surfaces; {}",
            index + 1,
            mirror.shape.name(),
            place(&mirror.position),
            mirror.size,
            grouped(points),
            found.reason
        ));
    }
    lines.extend(found.is_empty().then(|| "  mirrors      none found".to_owned()));
    lines.push(format!("  ghosts       {}", grouped(ghosts)));
    lines.push(format!("  undecided    {}", grouped(undecided)));
    lines.extend(arguments.put_back.then(|| format!("  put back     {}", grouped(put_back))));
    terminal::print(lines)
}
