//! Ghosts among the points of files: mirrors looked for, points judged, and files written with the verdicts.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context as _;
use cloud::{Chunk, Cloud, Column, GHOST_ERROR, PointTest, Progress};
use codec::{Added, Exported, Runs, Selection, Source, Wanted};
use ghost::{Block, Extent, Found, Gauge, Kind, Mirrors, Points, Suspect, Verdicts};
use glam::DVec3;
use scene::shown;

use crate::shared::export::free_name;
use crate::shared::moved_points;
use crate::shared::numbers::grouped;
use crate::system::failure::usage;

/// The attributes of verdicts: 0 real, 1 ghost, 2 undecided; the number of the mirror; how probable a ghost is.
pub const KIND: &str = render::VERDICT;
pub const MIRROR: &str = "ghost_mirror";
pub const PROBABILITY: &str = "ghost_probability";

/// The mirrors of a scan, and the verdicts on its points by them.
pub struct Looked {
    pub stations: Vec<DVec3>,
    pub found: Vec<Found>,
    /// What further mirrors are measured by.
    pub gauge: Arc<Gauge>,
    pub verdicts: Verdicts,
    pub warnings: BTreeSet<String>,
    /// The number of points that the files promise, and that could not be read.
    pub missing: u64,
}

/// Finds ghosts by the mirrors that are given, and by those that are found besides them if that is wanted. Stations that are
/// named replace those of the files. `None` when cancelled.
///
/// # Errors
/// No station, no points, or a file that cannot be read.
pub fn look(
    sources: &[Arc<Source>],
    named: &[DVec3],
    given: Vec<Found>,
    finds: bool,
    progress: &Progress,
) -> anyhow::Result<Option<Looked>> {
    let (stations, of_file) = stations(sources, named)?;
    let files = Files { sources, of_file: &of_file, progress, warnings: Mutex::default(), missing: AtomicU64::new(0) };
    let total: u64 = sources.iter().map(|source| source.info().points).sum();
    progress.set_total(5 * total);
    let extent = Extent::of(&files, total)?.ok_or_else(|| usage("there are no points among which ghosts could be"))?;
    let Some(gauge) = Gauge::of(&files, &stations, extent, total, progress)? else { return Ok(None) };
    let mut found = given;
    if finds {
        let Some(others) = ghost::find(&gauge, progress) else { return Ok(None) };
        let known = found.len();
        let is_new = |other: &Found| !found[..known].iter().any(|given| given.is_at(other));
        let new: Vec<Found> = others.into_iter().filter(is_new).collect();
        found.extend(new);
    }
    let mirrors = Mirrors::new(found.iter().map(|found| found.reflector.clone()).collect());
    let has_pane = mirrors.reflectors().iter().any(|reflector| reflector.is_open);
    progress.set_total(progress.done() + if has_pane { 5 } else { 3 } * total);
    let verdicts = ghost::judge(&files, &stations, &mirrors, extent, 0.0, progress)?;
    let mut warnings = files.warnings.into_inner().unwrap_or_else(PoisonError::into_inner);
    warnings.extend(gauge.too_few().filter(|_| finds).map(|count| {
        let count = grouped(count as u64);
        format!("mirrors are looked for among {count} points: of so few, some may be missed")
    }));
    let missing = codec::missing_points(sources).saturating_add(files.missing.into_inner());
    let gauge = Arc::new(gauge);
    Ok(verdicts.map(|verdicts| Looked { stations, found, gauge, verdicts, warnings, missing }))
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
        // A scan without points saw nothing.
        let place = source.info().scanner().filter(|_| source.info().points > 0);
        of_file.push(place.map(|place| {
            stations.iter().position(|known| *known == place).unwrap_or_else(|| {
                stations.push(place);
                stations.len() - 1
            })
        }));
    }
    if stations.is_empty() {
        let name = shown(&sources[0].info().path);
        return Err(usage(format!(
            "{name}: it is not known where the scanner stood; say so with --station X,Y,Z, or in the window with the field Scanner"
        )));
    }
    Ok((stations, of_file))
}

/// The points of files, read anew each time.
struct Files<'a> {
    sources: &'a [Arc<Source>],
    of_file: &'a [Option<usize>],
    progress: &'a Progress,
    warnings: Mutex<BTreeSet<String>>,
    /// The number of points that the last read could not read.
    missing: AtomicU64,
}

impl Points for Files<'_> {
    type Error = codec::Error;

    fn read(&self, give: &(dyn Fn(&Block) + Sync)) -> codec::Result<()> {
        let mut missing = 0_u64;
        for (file, source) in self.sources.iter().enumerate() {
            let info = source.info();
            let cloud = Cloud { grid: info.grid, ..Cloud::default() };
            let reading = Progress::default();
            let intensity =
                info.attributes.iter().position(|attribute| attribute.name.eq_ignore_ascii_case("intensity"));
            let emit = |chunk: Chunk| {
                if self.progress.is_cancelled() {
                    return reading.cancel();
                }
                let places = (0..chunk.len()).map(|index| cloud.world_position(&chunk, index)).collect();
                let column = intensity.and_then(|index| chunk.columns.get(index)?.as_ref());
                let values = |column: &Arc<Column>| (0..chunk.len()).map(|index| column.value(index) as f32).collect();
                let intensities = column.map_or_else(Vec::new, values);
                let (first_point, station) = (chunk.first_point, self.of_file[file]);
                give(&Block { file, first_point, station, places, intensities });
                self.progress.add(chunk.len() as u64);
            };
            let attributes = (0..info.attributes.len()).map(|index| Some(index) == intensity).collect();
            let selection = Selection { positions: true, attributes, ..Selection::default() };
            let summary = source.read(&selection, &reading, &emit)?;
            missing = missing.saturating_add(summary.missing);
            let warnings = summary.warnings.iter().map(|warning| format!("{}: {warning}", shown(&info.path)));
            self.warnings.lock().unwrap_or_else(PoisonError::into_inner).extend(warnings);
        }
        self.missing.store(missing, Ordering::Relaxed);
        Ok(())
    }
}

/// Writes all points with their verdicts, and if wanted the ghosts again after them, where they are. Returns warnings and
/// the number of points that could not be read, `None` when cancelled.
///
/// # Errors
/// A file that cannot be read or written.
pub fn write(
    sources: &[Arc<Source>],
    verdicts: &Verdicts,
    output: &Path,
    puts_back: bool,
    memory: u64,
    progress: &Progress,
) -> anyhow::Result<Option<(Vec<String>, u64)>> {
    let names = [KIND, MIRROR, PROBABILITY, GHOST_ERROR].map(|name| free_name(sources, name));
    let test = PointTest::default();
    let (mut all, mut columns): (_, [Vec<Runs>; 4]) = (sources.to_vec(), Default::default());
    for (file, source) in sources.iter().enumerate() {
        let ends = run_ends(source.info().points);
        let own = |value: &dyn Fn(&Suspect) -> f32| runs(verdicts, file, ends.clone(), value);
        columns[0].push(own(&|suspect| f32::from(suspect.kind.number())));
        columns[1].push(own(&|suspect| f32::from(suspect.mirror())));
        if puts_back {
            columns[2].push(own(&|suspect| suspect.probability));
            columns[3].push(Runs::new());
        }
    }
    let mut temporary = Temporary(Vec::new());
    for (file, source) in sources.iter().enumerate().filter(|_| puts_back) {
        let ghosts = ghosts_of(verdicts, file);
        if ghosts.is_empty() {
            continue;
        }
        let is_las = matches!(**source, Source::Las(_));
        let ending = if is_las { "las" } else { "ply" };
        let name = output.file_name().unwrap_or_default().to_string_lossy();
        let path = output.with_file_name(format!(".{name}.{file}.put-back.{ending}"));
        temporary.0.push(path.clone());
        let left_out = [others(&ghosts, source.info().points)];
        let wanted = Wanted { test: &test, left_out: &left_out };
        if codec::export(std::slice::from_ref(source), wanted, &[], &path, memory, progress)?.is_none() {
            return Ok(None);
        }
        let places: Vec<DVec3> = ghosts.iter().map(|(_, suspect)| suspect.place).collect();
        moved_points::put(&path, &places).with_context(|| shown(&path))?;
        all.extend(codec::open_scans(&path, memory)?.into_iter().map(Arc::new));
        let whole = |value: &dyn Fn(&Suspect) -> f32| {
            let values = ghosts.iter().map(|(_, suspect)| value(suspect)).collect();
            Runs::from([(0, Arc::new(Column::F32(values)))])
        };
        // Where it is now, the point is real; the number says by which mirror it was seen.
        columns[0].push(whole(&|_| 0.0));
        columns[1].push(whole(&|suspect| f32::from(suspect.mirror())));
        columns[2].push(whole(&|_| 0.0));
        columns[3].push(whole(&|suspect| suspect.error));
    }
    let mut added: Vec<Added> = names.into_iter().zip(columns).map(|(name, runs)| Added::new(name, runs)).collect();
    added.truncate(match (puts_back, temporary.0.is_empty()) {
        (false, _) => 2,
        (true, true) => 3,
        (true, false) => 4,
    });
    let exported = codec::export(&all, &test, &added, output, memory, progress)?;
    Ok(exported.map(|Exported { changes, warnings, missing, .. }| {
        (changes.into_iter().chain(param::few(warnings, "warnings")).collect(), missing)
    }))
}

/// Files that are removed in the end.
struct Temporary(Vec<PathBuf>);

impl Drop for Temporary {
    fn drop(&mut self) {
        // What is left of them does no harm.
        self.0.iter().for_each(|path| drop(std::fs::remove_file(path)));
    }
}

/// A value of each point of a file: that of suspects, and 0 for all others. Each run goes from one index to another.
pub fn runs(
    verdicts: &Verdicts,
    file: usize,
    ends: impl Iterator<Item = (u64, u64)>,
    value: &dyn Fn(&Suspect) -> f32,
) -> Runs {
    let mut marked: Vec<(u64, f32)> = Vec::new();
    for ((_, first), suspects) in verdicts.suspects.range((file, 0)..(file + 1, 0)) {
        marked.extend(suspects.iter().map(|suspect| (first + u64::from(suspect.index), value(suspect))));
    }
    let run = |(from, to): (u64, u64)| {
        let mut values = vec![0.0; (to - from) as usize];
        let start = marked.partition_point(|(index, _)| *index < from);
        for (index, value) in marked[start..].iter().take_while(|(index, _)| *index < to) {
            values[(index - from) as usize] = *value;
        }
        (from, Arc::new(Column::F32(values)))
    };
    ends.map(run).collect()
}

/// The ends of runs of all points of a file.
pub fn run_ends(points: u64) -> impl Iterator<Item = (u64, u64)> + Clone {
    /// Points of a run at most.
    const LONGEST: u64 = 1 << 20;
    (0..points.div_ceil(LONGEST)).map(move |run| (run * LONGEST, points.min((run + 1) * LONGEST)))
}

/// The ghosts of a file with their indices in it, in its order.
fn ghosts_of(verdicts: &Verdicts, file: usize) -> Vec<(u64, Suspect)> {
    let own = verdicts.suspects.range((file, 0)..(file + 1, 0));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_without_points_has_no_station() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("two.ptx");
        let axes = "1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n";
        let head = |columns: usize, place: &str| format!("{columns}\n1\n{place}\n{axes}{place} 1\n");
        let points = "0 0 1 0.5\n1 0 1 0.5\n";
        std::fs::write(&path, format!("{}{points}{}", head(2, "1 2 3"), head(0, "7 8 9"))).unwrap();
        let sources = world::open_file(&path, 1 << 28).unwrap();
        let places: Vec<_> = sources.iter().map(|source| source.info().scanner()).collect();
        assert_eq!(places, [Some(DVec3::new(1.0, 2.0, 3.0)), Some(DVec3::new(7.0, 8.0, 9.0))]);
        let (stations, of_file) = stations(&sources, &[]).unwrap();
        assert_eq!((stations, of_file), (vec![DVec3::new(1.0, 2.0, 3.0)], vec![Some(0), None]));
    }
}
