//! Measures how far the points of a cloud are from another one, for `glint compare` and for the window. Files are read
//! chunk by chunk; only places and distances stay in memory.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context as _;
use cloud::{Chunk, Cloud, PointTest, Progress, ShownPoints};
use codec::{Runs, Selection, Source};
use glam::{DVec3, I64Vec3};
use measure::{Change, DistanceFigures, M3c2, PointTree, nearest_distances};
use rayon::prelude::*;
use scene::{Settings, shown};

use crate::failure::usage;

/// The number of points of the first cloud that decide to which side normals point.
const ORIENTING_POINTS: usize = 200_000;
/// Core points that one task measures.
const CORES_AT_ONCE: usize = 1 << 14;

/// One of the two clouds, and which of its points are shown.
pub struct Side {
    pub points: Points,
    pub test: PointTest,
    /// The axis that points up.
    pub up: DVec3,
    pub settings: Settings,
}

pub enum Points {
    Files(Vec<Arc<Source>>),
    /// A cloud whose points are all in memory.
    Memory(Cloud),
}

/// What is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Method {
    /// The distance to the nearest point.
    #[default]
    Nearest,
    /// The distance along the normal.
    M3c2(Scales),
}

/// The lengths that M3C2 takes, in units of the coordinates; those that are not given follow from the spacing of the
/// first cloud.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scales {
    pub normal: Option<f64>,
    pub cylinder: Option<f64>,
    pub reach: Option<f64>,
    /// The standard deviation of the registration of the clouds.
    pub registration: f64,
}

/// What was measured at the points of the first cloud, for each of its files. Points that are hidden or have no distance
/// are NaN.
pub struct Measured {
    pub distances: Vec<Runs>,
    /// The levels of detection, if the method has them.
    pub levels: Option<Vec<Runs>>,
    pub figures: DistanceFigures,
    /// The share of the distances that are beyond their level of detection, if the method has levels.
    pub significant: Option<f64>,
}

/// A distance and its level of detection; NaN where there is none.
type Value = [f32; 2];

impl Side {
    fn files(&self) -> usize {
        match &self.points {
            Points::Files(sources) => sources.len(),
            Points::Memory(_) => 1,
        }
    }

    /// The number of points, hidden ones too.
    fn count(&self) -> u64 {
        match &self.points {
            Points::Files(sources) => sources.iter().map(|source| source.info().points).sum(),
            Points::Memory(cloud) => own_chunks(cloud).map(|chunk| chunk.len() as u64).sum(),
        }
    }

    /// Calls `give` with the chunks of all files, the number of the file, what the chunks belong to, and which of their
    /// points are shown. Returns the files' warnings.
    fn read(
        &self,
        progress: &Progress,
        give: impl Fn(usize, &Cloud, &Chunk, &ShownPoints) + Sync,
    ) -> anyhow::Result<Vec<String>> {
        let sources = match &self.points {
            Points::Files(sources) => sources,
            Points::Memory(cloud) => {
                let test = cloud.test(&self.test);
                let chunks: Vec<&Chunk> = own_chunks(cloud).collect();
                chunks.into_par_iter().filter(|_| !progress.is_cancelled()).for_each(|chunk| {
                    give(0, cloud, chunk, &test.shown(chunk, chunk.bounds()));
                    progress.add(chunk.len() as u64);
                });
                return Ok(Vec::new());
            }
        };
        let mut warnings = Vec::new();
        for (number, source) in sources.iter().enumerate() {
            let info = source.info();
            let (name, attributes) = (shown(&info.path), info.attributes.clone());
            let is_read =
                |name: &str| name == "classification" || self.test.filtered().any(|filtered| filtered == name);
            let selected = attributes.iter().map(|attribute| is_read(&attribute.name)).collect();
            let cloud = Cloud { name, attributes, grid: info.grid, chunks: Vec::new() };
            let test = cloud.test(&self.test);
            let selection = Selection { positions: true, attributes: selected, ..Selection::default() };
            let reading = Progress::default();
            let emit = |chunk: Chunk| {
                if progress.is_cancelled() {
                    return reading.cancel();
                }
                give(number, &cloud, &chunk, &test.shown(&chunk, chunk.bounds()));
                progress.add(chunk.len() as u64);
            };
            let summary = source.read(&selection, &reading, &emit)?;
            let all = info.warnings.iter().chain(&summary.warnings);
            warnings.extend(all.map(|warning| format!("{}: {warning}", cloud.name)));
        }
        Ok(warnings)
    }

    /// The points that are shown. The tree does not depend on the order in which chunks come.
    fn tree(&self, which: &str, progress: &Progress, warnings: &mut Vec<String>) -> anyhow::Result<Option<PointTree>> {
        let found = Mutex::new(Vec::new());
        warnings.append(&mut self.read(progress, |number, cloud, chunk, shown| {
            let indices = shown.indices(chunk.len());
            let places: Vec<DVec3> = indices.map(|index| cloud.world_position(chunk, index)).collect();
            found.lock().unwrap_or_else(PoisonError::into_inner).push(((number, chunk.first_point), places));
        })?);
        if progress.is_cancelled() {
            return Ok(None);
        }
        let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
        found.sort_unstable_by_key(|(place, _)| *place);
        let mut places = Vec::with_capacity(found.iter().map(|(_, places)| places.len()).sum());
        found.into_iter().for_each(|(_, mut part)| places.append(&mut part));
        let tree = PointTree::new(places);
        if tree.is_empty() { Err(usage(format!("the {which} cloud shows no points"))) } else { Ok(Some(tree)) }
    }
}

/// The chunks of the points that are in the file: those spread over a mesh are not.
fn own_chunks(cloud: &Cloud) -> impl Iterator<Item = &Chunk> {
    cloud.chunks.iter().filter(|chunk| chunk.corners.is_none())
}

/// Measures the shown points of the first cloud, or one in each cube with edges of `core`, whose distance the others
/// in the cube take. `progress` counts points that are read and measured. Returns the files' warnings, too; `None` if it
/// was cancelled.
///
/// # Errors
/// Bad lengths, a cloud that cannot be read or shows no points, or no distances.
pub fn compare(
    first: &Side,
    second: &Side,
    method: Method,
    core: Option<f64>,
    progress: &Progress,
) -> anyhow::Result<Option<(Measured, Vec<String>)>> {
    let [own, other] = [first, second].map(Side::count);
    let has_tree = method != Method::Nearest || core.is_some();
    progress.set_total(other + own * (1 + u64::from(has_tree) + u64::from(core.is_some())));
    if core.is_some_and(|core| !(core > 0.0 && core.is_finite())) {
        return Err(usage(format!("core points {} apart, expected more than 0", core.unwrap_or_default())));
    }
    let mut warnings = Vec::new();
    let Some(second_tree) = second.tree("second", progress, &mut warnings)? else { return Ok(None) };
    let first_tree = match has_tree.then(|| first.tree("first", progress, &mut warnings)).transpose()? {
        Some(None) => return Ok(None),
        Some(Some(tree)) => tree,
        None => PointTree::default(),
    };
    let m3c2 = match method {
        Method::Nearest => None,
        Method::M3c2(scales) => Some(m3c2(scales, first, &first_tree).map_err(|error| usage(error.to_string()))?),
    };
    let values = |places: &[DVec3]| -> Vec<Value> {
        let Some(method) = &m3c2 else {
            return nearest_distances(&second_tree, places).into_iter().map(|distance| [distance, f32::NAN]).collect();
        };
        let level = |change: Change| change.level.map_or(f32::NAN, |level| level as f32);
        let value =
            |change: Option<Change>| change.map_or([f32::NAN; 2], |change| [change.distance as f32, level(change)]);
        method.changes(&first_tree, &second_tree, places).into_iter().map(value).collect()
    };
    let cores = core.map(|edge| Cores::measure(edge, &first_tree, &values, progress, own));
    let none = || vec![Runs::new(); first.files()];
    let lists = Mutex::new((none(), m3c2.is_some().then(none)));
    let read = first.read(progress, |number, cloud, chunk, shown| {
        let indices: Vec<usize> = shown.indices(chunk.len()).collect();
        let places: Vec<DVec3> = indices.iter().map(|index| cloud.world_position(chunk, *index)).collect();
        let values = match &cores {
            Some(cores) => places.iter().map(|place| cores.value(*place)).collect(),
            None => values(&places),
        };
        let run = |which: usize| {
            let mut run = vec![f32::NAN; chunk.len()];
            indices.iter().zip(&values).for_each(|(index, value)| run[*index] = value[which]);
            run
        };
        let mut lists = lists.lock().unwrap_or_else(PoisonError::into_inner);
        let (distances, levels) = &mut *lists;
        distances[number].insert(chunk.first_point, run(0));
        levels.iter_mut().for_each(|levels| drop(levels[number].insert(chunk.first_point, run(1))));
    })?;
    if progress.is_cancelled() {
        return Ok(None);
    }
    warnings.extend(read.into_iter().filter(|_| !has_tree));
    let (distances, levels) = lists.into_inner().unwrap_or_else(PoisonError::into_inner);
    let all = |runs: &[Runs]| -> Vec<f32> { runs.iter().flat_map(Runs::values).flatten().copied().collect() };
    let measured: Vec<Value> = match cores {
        Some(cores) => cores.in_order(),
        None => {
            let levels = levels.as_deref().map_or_else(Vec::new, all).into_iter().chain(std::iter::repeat(f32::NAN));
            all(&distances).into_iter().zip(levels).map(|(distance, level)| [distance, level]).collect()
        }
    };
    let is_significant = |[distance, level]: &&Value| distance.abs() > *level;
    let beyond = measured.iter().filter(is_significant).count() as f64;
    let figures = DistanceFigures::of(measured.into_iter().map(|[distance, _]| distance).collect());
    let figures = figures.context("no point of the first cloud has a distance to the second");
    let figures = figures.map_err(|error| usage(error.to_string()))?;
    let significant = levels.is_some().then(|| beyond / figures.points as f64);
    Ok(Some((Measured { distances, levels, figures, significant }, warnings)))
}

fn m3c2(scales: Scales, first: &Side, tree: &PointTree) -> measure::Result<M3c2> {
    let step = tree.len().div_ceil(ORIENTING_POINTS).max(1);
    let origin = tree.points().first().copied().unwrap_or_default().round();
    let some = tree.points().iter().step_by(step).map(|point| (*point - origin).as_vec3().to_array()).collect();
    let orientation = world::options_for(&[Chunk::new(0, origin, some)], first.up, &first.settings).orientation;
    M3c2::new(tree, scales.normal, scales.cylinder, scales.reach, scales.registration, orientation)
}

/// Core points: of the points in a cube, that which is nearest to its middle, with what was measured there.
struct Cores {
    edge: f64,
    values: HashMap<I64Vec3, Value>,
}

impl Cores {
    fn measure(
        edge: f64,
        tree: &PointTree,
        values: &(impl Fn(&[DVec3]) -> Vec<Value> + Sync),
        progress: &Progress,
        points: u64,
    ) -> Self {
        let mut nearest: HashMap<I64Vec3, (f64, DVec3)> = HashMap::new();
        for point in tree.points() {
            let cell = cell_of(*point, edge);
            let off = point.distance_squared((cell.as_dvec3() + 0.5) * edge);
            match nearest.entry(cell) {
                Entry::Vacant(place) => drop(place.insert((off, *point))),
                Entry::Occupied(mut place) if off < place.get().0 => drop(place.insert((off, *point))),
                Entry::Occupied(_) => {}
            }
        }
        let mut cores: Vec<(I64Vec3, DVec3)> = nearest.into_iter().map(|(cell, (_, point))| (cell, point)).collect();
        cores.sort_unstable_by_key(|(cell, _)| cell.to_array());
        let share = points as f64 / cores.len().max(1) as f64;
        let measured = cores.par_chunks(CORES_AT_ONCE).filter(|_| !progress.is_cancelled()).flat_map_iter(|cores| {
            let places: Vec<DVec3> = cores.iter().map(|(_, point)| *point).collect();
            let values = values(&places);
            progress.add((share * cores.len() as f64) as u64);
            cores.iter().map(|(cell, _)| *cell).zip(values)
        });
        Self { edge, values: measured.collect() }
    }

    fn value(&self, place: DVec3) -> Value {
        self.values.get(&cell_of(place, self.edge)).copied().unwrap_or([f32::NAN; 2])
    }

    /// What was measured, in the order of the cubes, so that sums come out the same each time.
    fn in_order(self) -> Vec<Value> {
        let mut cores: Vec<(I64Vec3, Value)> = self.values.into_iter().collect();
        cores.sort_unstable_by_key(|(cell, _)| cell.to_array());
        cores.into_iter().map(|(_, value)| value).collect()
    }
}

fn cell_of(place: DVec3, edge: f64) -> I64Vec3 {
    (place / edge).floor().as_i64vec3()
}

/// A name that no attribute of the files has.
pub fn free_name(sources: &[Arc<Source>], name: &str) -> String {
    let is_taken = |name: &String| {
        sources.iter().any(|source| source.info().properties.iter().any(|property| property.name == *name))
    };
    let numbered = (2..).map(|number| format!("{name}_{number}"));
    std::iter::once(name.to_owned()).chain(numbered).find(|name| !is_taken(name)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use cloud::Random;

    use super::*;

    /// A plate of 4 by 4 units, at a height that falls by a tenth in its middle.
    fn side(count: u64, seed: u64, height: f64) -> Side {
        let mut random = Random(seed);
        let mut unit = || random.below(1 << 24) as f32 / (1 << 24) as f32;
        let mut chunk = |first: u64, count: u64| {
            let points = (0..count).map(|_| [unit() * 4.0, unit() * 4.0, 0.02 * unit()]).collect();
            Chunk::new(first, DVec3::new(6e5, 5e6, height), points)
        };
        let chunks = vec![chunk(0, count / 2), chunk(count / 2, count - count / 2)];
        let points = Points::Memory(Cloud { chunks, ..Cloud::default() });
        Side { points, test: PointTest::default(), up: DVec3::Z, settings: Settings::default() }
    }

    #[test]
    fn points_in_memory_are_compared_and_every_point_of_a_cube_has_the_distance_of_its_core() {
        let [first, second] = [side(8000, 1, 10.0), side(8000, 2, 10.5)];
        let scales = Scales { normal: Some(1.0), cylinder: Some(0.5), reach: Some(2.0), registration: 0.0 };
        let of = |method, core| compare(&first, &second, method, core, &Progress::default()).unwrap().unwrap().0;
        let all = of(Method::M3c2(scales), None);
        assert_eq!((all.distances.len(), all.distances[0].len(), all.figures.points), (1, 2, 8000));
        assert!((all.figures.mean - 0.5).abs() < 1e-3 && all.significant == Some(1.0), "{:?}", all.figures);
        let some = of(Method::M3c2(scales), Some(0.5));
        // The plate is in one layer of cubes, as it is thinner than they are.
        assert_eq!(some.figures.points, 64);
        assert!((some.figures.mean - 0.5).abs() < 1e-3);
        assert!(some.distances[0].values().flatten().all(|distance| (distance - 0.5).abs() < 0.02));
        let mut different: Vec<u32> = some.distances[0].values().flatten().map(|distance| distance.to_bits()).collect();
        different.sort_unstable();
        different.dedup();
        assert!(different.len() <= 64, "{}", different.len());
        let is_same = |a: &Measured, b: &Measured| a.distances == b.distances && a.figures == b.figures;
        assert!(is_same(&some, &of(Method::M3c2(scales), Some(0.5))));
        assert!(of(Method::Nearest, Some(1.0)).levels.is_none());
    }

    #[test]
    fn a_comparison_that_is_cancelled_gives_nothing_and_bad_lengths_are_refused() {
        let [first, second] = [side(2000, 1, 0.0), side(2000, 2, 0.1)];
        let cancelled = Progress::default();
        cancelled.cancel();
        assert!(compare(&first, &second, Method::Nearest, None, &cancelled).unwrap().is_none());
        let counted = Progress::default();
        let method = Method::M3c2(Scales::default());
        assert!(compare(&first, &second, method, None, &counted).unwrap().is_some());
        assert_eq!((counted.done(), counted.total()), (6000, 6000));
        let refused = |method, core| compare(&first, &second, method, core, &Progress::default()).is_err();
        assert!(refused(method, Some(0.0)) && refused(method, Some(f64::NAN)));
        assert!(refused(Method::M3c2(Scales { registration: -1.0, ..Scales::default() }), None));
        let nothing = side(0, 1, 0.0);
        assert!(compare(&first, &nothing, Method::Nearest, None, &Progress::default()).is_err());
    }
}
