//! Measures how far points of a cloud are from another one. Files are read chunk by chunk; places and distances are kept.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context as _;
use cloud::{Bounds, Chunk, Cloud, Column, PointTest, Progress, ShownPoints};
use codec::{Runs, Selection, Source, Units, Wanted};
use glam::DVec3;
use measure::{Change, DistanceFigures, M3c2, PointTree, TriangleTree, nearest_distances};
use param::Bytes;
use rayon::prelude::*;
use scene::{Settings, shown};
use world::half_of;

use crate::shared::core_points::CorePoints;
use crate::shared::{export, numbers::grouped};
use crate::system::failure::usage;

/// The number of points of the first cloud that decide to which side normals point.
const ORIENTING_POINTS: usize = 200_000;
/// The bytes that a point takes in a tree: its place, and its share of the planes and boxes, of which there are at most
/// two for twelve points.
const TREE_BYTES: u64 = 31;
/// The bytes that a triangle of a mesh takes in a tree and beside it, and those of a vertex.
const TRIANGLE_BYTES: u64 = 124;
const VERTEX_BYTES: u64 = 48;
/// The bytes of a distance or a level of detection, which every point of the first cloud gets, and those more of a double.
const VALUE_BYTES: u64 = 4;
const MORE_BYTES: u64 = 4;
/// Points whose numbers are all below this get floats, whose steps are half a thousandth at most; others get doubles.
const LONGEST_FLOAT: f64 = 4096.0;
/// The bytes of a core point with its cube.
const CORE_BYTES: u64 = 112;
const GIB: u64 = 1 << 30;

/// One of the two clouds, and which of its points are shown.
pub struct Side {
    pub points: Points,
    pub test: PointTest,
    /// The points of each file that are left out whatever the test says: their indices in the file, ascending.
    pub left_out: Vec<Vec<u64>>,
    /// The axis that points up.
    pub up: DVec3,
    pub units: Units,
    pub settings: Settings,
}

#[allow(clippy::large_enum_variant, reason = "a comparison has two")]
pub enum Points {
    Files(Vec<Arc<Source>>),
    /// A cloud whose points are all in memory.
    Memory(Cloud),
}

/// What is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Method {
    /// The distance to the nearest point, or to the nearest face of a mesh.
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
    /// The number of points of both clouds that could not be read, although they seemed to be there.
    pub unread: u64,
    /// The median level of detection, which is the half width of the interval of 95 % of a distance, if the method has
    /// levels.
    pub interval: Option<f64>,
}

/// A distance and its level of detection; NaN where there is none.
pub type Value = [f64; 2];

/// The places of the vertices of meshes, NaN for hidden ones, by the number of the mesh's file.
type Vertices = HashMap<usize, Vec<DVec3>>;

impl Side {
    fn files(&self) -> usize {
        match &self.points {
            Points::Files(sources) => sources.len(),
            Points::Memory(_) => 1,
        }
    }

    /// What the cloud is called: by its first file, if it has files.
    fn name(&self) -> String {
        match &self.points {
            Points::Files(sources) => {
                let name = sources.first().map_or(String::new(), |source| shown(&source.info().path));
                if sources.len() > 1 { format!("{name} and {} more", sources.len() - 1) } else { name }
            }
            Points::Memory(cloud) => cloud.name.clone(),
        }
    }

    /// The files of the cloud; a cloud in memory has none.
    pub fn sources(&self) -> &[Arc<Source>] {
        match &self.points {
            Points::Files(sources) => sources,
            Points::Memory(_) => &[],
        }
    }

    /// The points of its files that are shown.
    pub fn wanted(&self) -> Wanted<'_> {
        Wanted { test: &self.test, left_out: &self.left_out }
    }

    /// A length for people.
    fn with_unit(&self, length: &str) -> String {
        self.units.length().map_or_else(|| format!("{length} units"), |unit| format!("{length} {unit}"))
    }

    fn shows_all(&self) -> bool {
        self.test.shows_all() && self.left_out.iter().all(Vec::is_empty)
    }

    /// The number of points, hidden ones too.
    fn count(&self) -> u64 {
        match &self.points {
            Points::Files(sources) => sources.iter().map(|source| source.info().points).sum(),
            Points::Memory(cloud) => own_chunks(cloud).map(|chunk| chunk.len() as u64).sum(),
        }
    }

    /// Calls `give` with the chunks of all files, the number of the file, what the chunks belong to, and which of their
    /// points are shown, until it has no room for more. Returns the files' warnings, and how many points were not read.
    fn read(
        &self,
        progress: &Progress,
        room: &Room,
        give: impl Fn(usize, &Cloud, &Chunk, &ShownPoints) + Sync,
    ) -> anyhow::Result<(Vec<String>, u64)> {
        let ends = || progress.is_cancelled() || room.is_exceeded();
        let sources = match &self.points {
            Points::Files(sources) => sources,
            Points::Memory(cloud) => {
                let test = cloud.test(&self.test);
                let chunks: Vec<&Chunk> = own_chunks(cloud).collect();
                chunks.into_par_iter().filter(|_| !ends()).for_each(|chunk| {
                    give(0, cloud, chunk, &test.shown(chunk, chunk.bounds()));
                    progress.add(chunk.len() as u64);
                });
                return Ok((Vec::new(), 0));
            }
        };
        let (mut warnings, mut unread) = (Vec::new(), 0);
        let wanted = self.wanted();
        for (number, source) in sources.iter().enumerate() {
            let info = source.info();
            let (name, attributes) = (shown(&info.path), info.attributes.clone());
            let selected = self.test.reads(&attributes);
            let cloud = Cloud { name, attributes, grid: info.grid, chunks: Vec::new() };
            let test = cloud.test(&self.test);
            let selection = Selection { positions: true, attributes: selected, ..Selection::default() };
            let reading = Progress::default();
            let emit = |chunk: Chunk| {
                if ends() {
                    return reading.cancel();
                }
                let left_out = wanted.left_out(number, chunk.first_point, chunk.len());
                let shown = test.shown(&chunk, chunk.bounds()).besides(chunk.len(), |index| left_out.has(index));
                give(number, &cloud, &chunk, &shown);
                progress.add(chunk.len() as u64);
            };
            let summary = source.read(&selection, &reading, &emit)?;
            export::check_whole(&cloud.name, &summary)?;
            let all = info.warnings.iter().chain(&summary.warnings);
            warnings.extend(all.map(|warning| format!("{}: {warning}", cloud.name)));
            unread += info.points.saturating_sub(summary.points);
        }
        Ok((warnings, unread))
    }

    /// The points that are shown, the vertices of meshes if these are kept, and the number of points that could not be read.
    /// The tree does not depend on the order in which chunks come.
    fn tree(
        &self,
        which: &str,
        keeps_vertices: bool,
        progress: &Progress,
        room: &Room,
        warnings: &mut Vec<String>,
    ) -> anyhow::Result<Option<(PointTree, Vertices, u64)>> {
        let found = Mutex::new(Vec::new());
        let (mut told, unread) = self.read(progress, room, |number, cloud, chunk, shown| {
            let places = places_of(cloud, chunk, shown.indices(chunk.len()));
            let is_mesh = keeps_vertices && self.sources().get(number).is_some_and(|source| source.is_mesh());
            let kept = if is_mesh { chunk.len() } else { 0 };
            if !room.take(places.len() as u64 * TREE_BYTES + kept as u64 * VERTEX_BYTES) {
                return;
            }
            let mut own = vec![DVec3::NAN; kept];
            shown.indices(kept).zip(&places).for_each(|(index, place)| own[index] = *place);
            found.lock().unwrap_or_else(PoisonError::into_inner).push(((number, chunk.first_point), places, own));
        })?;
        warnings.append(&mut told);
        room.check()?;
        if progress.is_cancelled() {
            return Ok(None);
        }
        let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
        found.sort_unstable_by_key(|(place, ..)| *place);
        let mut places = Vec::with_capacity(found.iter().map(|(_, places, _)| places.len()).sum());
        let mut vertices = Vertices::new();
        for ((number, first_point), mut part, mut own) in found {
            places.append(&mut part);
            if !own.is_empty() {
                let all = vertices.entry(number).or_default();
                all.resize(first_point as usize, DVec3::NAN);
                all.append(&mut own);
            }
        }
        let tree = PointTree::new(places);
        let filled = (!tree.is_empty()).then_some((tree, vertices, unread));
        filled.map(Some).ok_or_else(|| usage(format!("{}: the {which} cloud shows no points", self.name())))
    }

    /// The names of its meshes.
    fn meshes(&self) -> Vec<String> {
        match &self.points {
            Points::Files(sources) => {
                let meshes = sources.iter().filter(|source| source.is_mesh());
                meshes.map(|source| shown(&source.info().path)).collect()
            }
            Points::Memory(cloud) => {
                let is_mesh = cloud.chunks.iter().any(|chunk| chunk.corners.is_some());
                is_mesh.then(|| cloud.name.clone()).into_iter().collect()
            }
        }
    }

    /// The faces of the meshes among its files, all of whose vertices are shown.
    fn faces(&self, vertices: &Vertices, room: &Room, warnings: &mut Vec<String>) -> TriangleTree {
        let mut triangles = Vec::new();
        for (number, source) in self.sources().iter().enumerate().filter(|(_, source)| source.is_mesh()) {
            if !room.take(source.info().faces.saturating_mul(TRIANGLE_BYTES)) {
                break;
            }
            let faces = match source.triangles() {
                Ok(faces) => faces,
                Err(error) => {
                    warnings.push(format!("{error}: distances are those to its vertices"));
                    continue;
                }
            };
            let own = vertices.get(&number).map(Vec::as_slice).unwrap_or_default();
            let place = |index: u32| own.get(index as usize).copied().unwrap_or(DVec3::NAN);
            triangles.extend(faces.into_iter().map(|corners| corners.map(place)));
        }
        TriangleTree::new(triangles)
    }
}

/// The memory for points and their distances that is left.
struct Room {
    left: AtomicU64,
    is_exceeded: AtomicBool,
    /// What is said when it is exceeded.
    refusal: String,
}

impl Room {
    /// `bytes` is what a point of each cloud takes. Where no points are hidden, it is known at once whether there is
    /// enough.
    fn new(sides: [&Side; 2], bytes: [u64; 2]) -> Self {
        let (settings, points) = (&sides[0].settings, sides.map(Side::count));
        let (all, memory) = (settings.stream.host_bytes, half_of(settings.stream.host_bytes));
        let needed =
            points.iter().zip(bytes).map(|(points, bytes)| points.saturating_mul(bytes)).fold(0, u64::saturating_add);
        let enough = Bytes(needed.saturating_mul(2).div_ceil(GIB) * GIB);
        let [own, other] = points.map(grouped);
        let refusal = format!(
            "to compare {own} points with {other} takes up to {:.1} GiB of memory, and half of stream.host_bytes = {all} is \
             allowed; set that to {enough}, or hide points with clips or classes in a scene file",
            needed as f64 / GIB as f64
        );
        let is_exceeded = needed > memory && sides.iter().all(|side| side.shows_all());
        Self { left: AtomicU64::new(memory), is_exceeded: AtomicBool::new(is_exceeded), refusal }
    }

    /// Takes some of it; false if that is not left.
    fn take(&self, bytes: u64) -> bool {
        let rest = |left: u64| left.checked_sub(bytes);
        let is_there = self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, rest).is_ok();
        self.is_exceeded.fetch_or(!is_there, Ordering::Relaxed);
        is_there
    }

    fn is_exceeded(&self) -> bool {
        self.is_exceeded.load(Ordering::Relaxed)
    }

    fn check(&self) -> anyhow::Result<()> {
        if self.is_exceeded() { Err(usage(self.refusal.clone())) } else { Ok(()) }
    }
}

/// The values of all files in their order.
fn values_of(runs: &[Runs]) -> impl Iterator<Item = f64> {
    runs.iter().flat_map(Runs::values).flat_map(|run| (0..run.len()).map(|index| run.value(index)))
}

/// Numbers in the type that keeps their precision: floats near 4,424 km differ by half a metre.
fn column_of(values: Vec<f64>) -> Column {
    if values.iter().any(|value| value.abs() >= LONGEST_FLOAT) {
        Column::F64(values)
    } else {
        Column::F32(values.into_iter().map(|value| value as f32).collect())
    }
}

fn places_of(cloud: &Cloud, chunk: &Chunk, indices: impl Iterator<Item = usize>) -> Vec<DVec3> {
    indices.map(|index| cloud.world_position(chunk, index)).collect()
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
/// Bad lengths, a cloud that cannot be read or shows no points, more points than fit into half of `stream.host_bytes`, or
/// no distances.
pub fn compare(
    first: &Side,
    second: &Side,
    method: Method,
    core: Option<f64>,
    progress: &Progress,
) -> anyhow::Result<Option<(Measured, Vec<String>)>> {
    let [own, other] = [first, second].map(Side::count);
    let has_tree = method != Method::Nearest;
    progress.set_total(other + own * (1 + u64::from(has_tree || core.is_some()) + u64::from(core.is_some())));
    if core.is_some_and(|core| !(core > 0.0 && core.is_finite())) {
        return Err(usage(format!("core points {} apart, expected more than 0", core.unwrap_or_default())));
    }
    let value_bytes = VALUE_BYTES * (1 + u64::from(has_tree));
    let room = Room::new([first, second], [value_bytes + TREE_BYTES * u64::from(has_tree), TREE_BYTES]);
    room.take(own.saturating_mul(value_bytes));
    room.check()?;
    let mut warnings: Vec<String> = unit_warning(first, second).into_iter().collect();
    let Some((second_tree, vertices, lost)) = second.tree("second", !has_tree, progress, &room, &mut warnings)? else {
        return Ok(None);
    };
    let first_tree = match has_tree.then(|| first.tree("first", false, progress, &room, &mut warnings)).transpose()? {
        Some(None) => return Ok(None),
        Some(Some((tree, ..))) => tree,
        None => PointTree::default(),
    };
    let m3c2 = match method {
        Method::Nearest => None,
        Method::M3c2(scales) => {
            let fail = |error| usage(format!("{}: {error}", first.name()));
            Some(m3c2(scales, first, &first_tree).map_err(fail)?)
        }
    };
    let faces = match method {
        Method::Nearest => second.faces(&vertices, &room, &mut warnings),
        Method::M3c2(_) => {
            let meshes = first.meshes().into_iter().chain(second.meshes());
            warnings.extend(meshes.map(|name| format!("{name}: M3C2 takes the vertices of a mesh, and not its faces")));
            TriangleTree::default()
        }
    };
    room.check()?;
    let values = |places: &[DVec3]| -> Vec<Value> {
        let Some(method) = &m3c2 else {
            let to_points = places.iter().zip(nearest_distances(&second_tree, places));
            let nearest = |(place, distance): (&DVec3, f64)| match faces.is_empty() {
                true => distance,
                false => distance.min(faces.distance(*place)),
            };
            return to_points.map(|pair| [nearest(pair), f64::NAN]).collect();
        };
        let value = |change: Option<Change>| {
            change.map_or([f64::NAN; 2], |change| [change.distance, change.level.unwrap_or(f64::NAN)])
        };
        method.changes(&first_tree, &second_tree, places).into_iter().map(value).collect()
    };
    let cores = match core {
        Some(edge) => {
            let found = Mutex::new(CorePoints::new(edge));
            let add = |places: &[DVec3]| {
                let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
                let known = found.len();
                places.iter().for_each(|place| found.add(*place));
                room.take((found.len() - known) as u64 * CORE_BYTES);
            };
            if has_tree {
                add(first_tree.points());
            } else {
                let read = first.read(progress, &room, |_, cloud, chunk, shown| {
                    add(&places_of(cloud, chunk, shown.indices(chunk.len())));
                });
                warnings.append(&mut read?.0);
            }
            room.check()?;
            Some(found.into_inner().unwrap_or_else(PoisonError::into_inner).measured(&values, progress, own))
        }
        None => None,
    };
    let none = || vec![Runs::new(); first.files()];
    let lists = Mutex::new((none(), m3c2.is_some().then(none)));
    let first_bounds = Mutex::new(Bounds::EMPTY);
    let (read, unread) = first.read(progress, &room, |number, cloud, chunk, shown| {
        let indices: Vec<usize> = shown.indices(chunk.len()).collect();
        let places = places_of(cloud, chunk, indices.iter().copied());
        let values = match &cores {
            Some(cores) => places.iter().map(|place| cores.value(*place)).collect(),
            None => values(&places),
        };
        let run = |which: usize| {
            let mut run = vec![f64::NAN; chunk.len()];
            indices.iter().zip(&values).for_each(|(index, value)| run[*index] = value[which]);
            let run = column_of(run);
            room.take(if matches!(run, Column::F64(_)) { run.len() as u64 * MORE_BYTES } else { 0 });
            Arc::new(run)
        };
        let mut own = Bounds::EMPTY;
        places.iter().for_each(|place| own.include(*place));
        let mut bounds = first_bounds.lock().unwrap_or_else(PoisonError::into_inner);
        *bounds = bounds.union(own);
        drop(bounds);
        let mut lists = lists.lock().unwrap_or_else(PoisonError::into_inner);
        let (distances, levels) = &mut *lists;
        distances[number].insert(chunk.first_point, run(0));
        levels.iter_mut().for_each(|levels| drop(levels[number].insert(chunk.first_point, run(1))));
    })?;
    room.check()?;
    if progress.is_cancelled() {
        return Ok(None);
    }
    let first_bounds = first_bounds.into_inner().unwrap_or_else(PoisonError::into_inner);
    let gap = world::far_gap(first_bounds, second_tree.bounds());
    let apart = gap.map(|gap| format!("the clouds lie {} apart", first.with_unit(&format!("{gap:.0}"))));
    let of_systems = "more than ten times the size of the larger one: do they have one coordinate system?";
    warnings.extend(apart.iter().map(|apart| format!("{apart}, {of_systems}")));
    warnings.extend(read.into_iter().filter(|_| !has_tree && core.is_none()));
    drop((first_tree, second_tree, faces));
    let (distances, levels) = lists.into_inner().unwrap_or_else(PoisonError::into_inner);
    let measured: Vec<Value> = match cores {
        Some(cores) => cores.in_order(),
        None => {
            let levels = levels.as_deref().into_iter().flat_map(values_of).chain(std::iter::repeat(f64::NAN));
            values_of(&distances).zip(levels).map(|(distance, level)| [distance, level]).collect()
        }
    };
    let is_significant = |[distance, level]: &&Value| distance.abs() > *level;
    let beyond = measured.iter().filter(is_significant).count() as f64;
    let of_levels = DistanceFigures::of(measured.iter().map(|[_, level]| *level).collect());
    let interval = of_levels.map(|levels| levels.median);
    let figures = DistanceFigures::of(measured.into_iter().map(|[distance, _]| distance).collect());
    let apart = apart.map_or(String::new(), |apart| format!(": {apart}"));
    let figures = figures.with_context(|| format!("no point of the first cloud has a distance to the second{apart}"));
    let figures = figures.map_err(|error| usage(error.to_string()))?;
    let significant = levels.is_some().then(|| beyond / figures.points as f64);
    let unread = unread.saturating_add(lost);
    Ok(Some((Measured { distances, levels, figures, significant, unread, interval }, warnings)))
}

/// What a person should know where the units of both clouds are known and differ.
fn unit_warning(first: &Side, second: &Side) -> Option<String> {
    let units = [first, second].map(|side| Units { height: side.units.rise(), ..side.units });
    let [own, other] = [(first, units[0]), (second, units[1])]
        .map(|(side, units)| format!("{} has its coordinates in {}", side.name(), units.text()));
    let ends = "numbers are compared as they are, so distances have no unit";
    units[0].contradict(&units[1]).then(|| format!("{own}, and {other}: {ends}"))
}

fn m3c2(scales: Scales, first: &Side, tree: &PointTree) -> measure::Result<M3c2> {
    let step = tree.len().div_ceil(ORIENTING_POINTS).max(1);
    let origin = tree.points().first().copied().unwrap_or_default().round();
    let some = tree.points().iter().step_by(step).map(|point| (*point - origin).as_vec3().to_array()).collect();
    let orientation = world::options_for(&[Chunk::new(0, origin, some)], first.up, None, &first.settings).orientation;
    M3c2::new(tree, scales.normal, scales.cylinder, scales.reach, scales.registration, orientation)
}

#[cfg(test)]
mod tests {
    use cloud::{Filter, Random, Volume, VolumeShape};
    use glam::DQuat;

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
        let (test, left_out) = (PointTest::default(), Vec::new());
        let (units, settings) = (Units::default(), Settings::default());
        Side { points, test, left_out, up: DVec3::Z, units, settings }
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
        assert!(values_of(&some.distances).all(|distance| (distance - 0.5).abs() < 0.02));
        assert!(some.distances[0].values().all(|run| matches!(**run, Column::F32(_))));
        let mut different: Vec<u64> = values_of(&some.distances).map(f64::to_bits).collect();
        different.sort_unstable();
        different.dedup();
        assert!(different.len() <= 64, "{}", different.len());
        let is_same = |a: &Measured, b: &Measured| a.distances == b.distances && a.figures == b.figures;
        assert!(is_same(&some, &of(Method::M3c2(scales), Some(0.5))));
        assert!(of(Method::Nearest, Some(1.0)).levels.is_none());
    }

    #[test]
    fn units_that_differ_are_named_and_an_error_names_the_cloud() {
        let [mut first, mut second] = [side(100, 1, 10.0), side(100, 2, 10.5)];
        let warnings = |first: &Side, second: &Side| {
            compare(first, second, Method::Nearest, None, &Progress::default()).unwrap().unwrap().1
        };
        first.units.level = Some(codec::Unit::Other(0.001));
        assert!(warnings(&first, &second).is_empty(), "nothing is known of the second");
        second.units.level = Some(codec::Unit::Metre);
        let [warning] = warnings(&first, &second).try_into().unwrap();
        assert!(warning.contains("coordinates in ") && warning.contains(" has its coordinates in m: "), "{warning}");
        second.units = first.units;
        assert!(warnings(&first, &second).is_empty());
        let chunk = Chunk::new(0, DVec3::ZERO, vec![[1.0; 3]; 1000]);
        first.points = Points::Memory(Cloud { name: "one.ply".into(), chunks: vec![chunk], ..Cloud::default() });
        let error = compare(&first, &second, Method::M3c2(Scales::default()), None, &Progress::default());
        let error = error.err().unwrap().to_string();
        assert!(error.starts_with("one.ply: "), "{error}");
    }

    #[test]
    fn distances_to_a_mesh_are_those_to_its_faces_as_far_as_all_corners_are_shown() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("square.ply");
        let corners = "599990 4999990 10 1\n600010 4999990 10 1\n600010 5000010 10 1\n599990 5000010 10 0";
        let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
            property uchar kept\nelement face 1\nproperty list uchar int vertex_indices\nend_header";
        std::fs::write(&path, format!("{header}\n{corners}\n4 0 1 2 3\n")).unwrap();
        let first = side(2000, 1, 10.25);
        let mut second = side(0, 1, 0.0);
        second.points = Points::Files(vec![Arc::new(codec::open(&path).unwrap())]);
        let progress = Progress::default();
        let (measured, warnings) = compare(&first, &second, Method::Nearest, None, &progress).unwrap().unwrap();
        assert_eq!((progress.done(), progress.total()), (2004, 2004), "each point of both is read once");
        assert!((measured.figures.mean - 0.26).abs() < 1e-3 && measured.figures.max < 0.2701, "{:?}", measured.figures);
        assert!(!warnings.iter().any(|warning| warning.contains("vertices of a mesh")), "{warnings:?}");
        // One of the two triangles has a hidden corner; the points lie about the edge between them.
        second.test = PointTest::new([], vec![Filter { attribute: "kept".into(), low: 1.0, high: 1.0 }], Vec::new());
        let (half, _) = compare(&first, &second, Method::Nearest, None, &Progress::default()).unwrap().unwrap();
        assert!(half.figures.max > 1.0 && half.figures.mean < 2.0, "{:?}", half.figures);
        let m3c2 = Method::M3c2(Scales { reach: Some(40.0), cylinder: Some(40.0), ..Scales::default() });
        let (_, warnings) = compare(&first, &second, m3c2, None, &Progress::default()).unwrap().unwrap();
        assert!(warnings.iter().any(|warning| warning.contains("takes the vertices of a mesh")), "{warnings:?}");
    }

    #[test]
    fn more_points_than_fit_into_memory_are_refused_and_cores_need_less() {
        let of = |points: u64, bytes: u64, method, core| {
            let [mut first, second] = [side(points, 1, 0.0), side(8000, 2, 0.5)];
            first.settings.stream.host_bytes.0 = 2 * bytes;
            let compared = compare(&first, &second, method, core, &Progress::default());
            compared.map(|compared| compared.unwrap().0.figures.points).map_err(|error| error.to_string())
        };
        let (nearest, m3c2) = (Method::Nearest, Method::M3c2(Scales::default()));
        let needed = 4000 * VALUE_BYTES + 8000 * TREE_BYTES;
        assert_eq!(of(4000, needed, nearest, None), Ok(4000));
        let refused = of(4000, needed - 1, nearest, None).unwrap_err();
        let told = "to compare 4,000 points with 8,000 takes up to 0.0 GiB of memory, and half of stream.host_bytes = ";
        assert!(refused.starts_with(told) && refused.contains("set that to 1GiB"), "{refused}");
        // M3C2 needs the points of the first cloud, too, and two numbers for each.
        let both = needed + 4000 * (VALUE_BYTES + TREE_BYTES);
        assert!(of(4000, both, m3c2, None).is_ok());
        assert!(of(4000, both - 1, m3c2, None).is_err());
        // There are 16 cubes, and the points in them are not kept.
        assert_eq!(of(4000, needed + 16 * CORE_BYTES, nearest, Some(1.0)), Ok(16));
        assert!(of(4000, needed + 15 * CORE_BYTES, nearest, Some(1.0)).is_err());
        // Points that a clip hides take no room beside their distances.
        let [mut first, second] = [side(4000, 1, 0.0), side(8000, 2, 0.5)];
        let volume = Volume::new(VolumeShape::Box, DVec3::new(6e5, 5e6, 0.0), DQuat::IDENTITY, DVec3::splat(2.0));
        first.test = first.test.within(vec![volume]);
        first.settings.stream.host_bytes.0 = 2 * (both - 2000 * TREE_BYTES);
        let some = compare(&first, &second, m3c2, None, &Progress::default()).unwrap().unwrap().0;
        assert!((100..1000).contains(&some.figures.points), "{:?}", some.figures);
        // Not even the distances fit.
        assert!(of(4000, 4000 * VALUE_BYTES - 1, nearest, None).is_err());
    }

    #[test]
    fn clouds_that_lie_far_apart_are_told_and_keep_the_precision_of_their_distances() {
        let [first, mut second] = [side(4000, 1, 0.0), side(4000, 2, 0.0)];
        let Points::Memory(cloud) = &mut second.points else { unreachable!() };
        cloud.chunks.iter_mut().for_each(|chunk| chunk.origin.x += 4_424_000.0);
        let compared = compare(&first, &second, Method::Nearest, None, &Progress::default());
        let (measured, warnings) = compared.unwrap().unwrap();
        assert!(warnings.len() == 1 && warnings[0].starts_with("the clouds lie 4423996 units apart"), "{warnings:?}");
        let mut distances: Vec<u64> = values_of(&measured.distances).map(f64::to_bits).collect();
        distances.sort_unstable();
        distances.dedup();
        assert!(distances.len() > 3900, "{} different ones", distances.len());
        let Points::Memory(cloud) = &first.points else { unreachable!() };
        let Points::Memory(other) = &second.points else { unreachable!() };
        let place = cloud.chunks[0].position(7);
        let others = other.chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index)));
        let nearest = others.map(|other| other.distance(place)).fold(f64::INFINITY, f64::min);
        assert!((values_of(&measured.distances).nth(7).unwrap() - nearest).abs() < 1e-6);
        let m3c2 = compare(&first, &second, Method::M3c2(Scales::default()), None, &Progress::default());
        let error = m3c2.err().unwrap().to_string();
        assert!(error.ends_with("a distance to the second: the clouds lie 4423996 units apart"), "{error}");
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
