//! The surfaces that a scan is of, as small planes in the cells of grids: memory grows with the surfaces, not with the
//! number of points. Sums are whole numbers, so the map does not depend on the order in which points come. The grids are
//! turned against the axes, because most walls and floors are not: a wall along the border of cells would be in halves.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::{Mutex, PoisonError};

use cloud::{hash, smallest_eigenvector};
use glam::{DMat3, DVec3, I64Vec3, Vec3};
use rayon::prelude::*;

/// Hashes the key of a cell.
#[derive(Default)]
pub struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u64(u64::from(*byte)));
    }

    fn write_u64(&mut self, key: u64) {
        self.0 = hash(self.0 ^ key);
    }
}

pub type ByKey<V> = HashMap<u64, V, BuildHasherDefault<KeyHasher>>;

/// Bits of a cell's key for each axis.
const AXIS_BITS: u32 = 21;

/// The key of a cell; `None` for cells too far away to count.
pub fn key_of(cell: I64Vec3) -> Option<u64> {
    let half = 1_i64 << (AXIS_BITS - 1);
    let shifted = cell + half;
    let is_in = (0..3).all(|axis| (0..2 * half).contains(&shifted[axis]));
    is_in.then(|| (0..3).fold(0, |key, axis| key << AXIS_BITS | shifted[axis] as u64))
}

fn cell_of(key: u64) -> I64Vec3 {
    let half = 1_i64 << (AXIS_BITS - 1);
    let axis = |shift: u32| ((key >> shift & ((1 << AXIS_BITS) - 1)) as i64) - half;
    I64Vec3::new(axis(2 * AXIS_BITS), axis(AXIS_BITS), axis(0))
}

/// Steps of a sum to the edge of a cell of the finest grid.
const STEPS: f64 = 65_536.0;

/// The sums of the points in a cell, in steps from its middle.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: i64,
    first: [i64; 3],
    /// Of xx, yy, zz, xy, xz, yz.
    second: [i64; 6],
}

/// The two axes of each second sum.
const PAIRS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [0, 2], [1, 2]];

impl Sums {
    fn add_point(&mut self, steps: [i64; 3]) {
        self.count += 1;
        for axis in 0..3 {
            self.first[axis] += steps[axis];
        }
        for (second, [a, b]) in self.second.iter_mut().zip(PAIRS) {
            *second += steps[a] * steps[b];
        }
    }

    /// Adds sums that count from another middle, which is at `shift` from the own one.
    fn add_shifted(&mut self, other: &Self, shift: [i64; 3]) {
        for (index, [a, b]) in PAIRS.into_iter().enumerate() {
            let (first, count) = (other.first, other.count);
            self.second[index] +=
                other.second[index] + shift[a] * first[b] + shift[b] * first[a] + count * shift[a] * shift[b];
        }
        for axis in 0..3 {
            self.first[axis] += other.first[axis] + other.count * shift[axis];
        }
        self.count += other.count;
    }
}

/// A small plane through the points of a cell.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    pub center: DVec3,
    /// A unit vector; its sign is arbitrary.
    pub normal: Vec3,
    /// The standard deviation of the points from the plane.
    pub thickness: f32,
    pub count: u32,
    /// The edge of its cell.
    pub edge: f32,
}

impl Patch {
    fn in_world(self, frame: &Frame) -> Self {
        let back = frame.turn.transpose();
        let normal = (back * self.normal.as_dvec3()).as_vec3();
        Self { center: frame.origin + back * self.center, normal, ..self }
    }
}

/// What a place is near to.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// The distance from the plane of the patch, with the sign of its normal.
    pub distance: f64,
    pub patch: Patch,
}

/// The coordinates of the grids.
#[derive(Clone, Copy)]
struct Frame {
    origin: DVec3,
    /// From the world's axes to those of the grids.
    turn: DMat3,
}

/// The angles in radians by which the grids are turned: no wall is likely to stand so.
const TURNED: [f64; 3] = [0.531, 0.287, 0.412];

impl Frame {
    fn new(origin: DVec3) -> Self {
        let [x, y, z] = TURNED;
        Self { origin, turn: DMat3::from_euler(glam::EulerRot::XYZ, x, y, z) }
    }

    fn own(&self, place: DVec3) -> DVec3 {
        self.turn * (place - self.origin)
    }
}

/// Collects points, from any number of threads.
pub struct MapBuilder {
    frame: Frame,
    edge: f64,
    levels: usize,
    shards: Vec<Mutex<ByKey<Sums>>>,
}

const SHARDS: u64 = 64;
/// The usual number of grids of a map; each has cells twice as wide as the one before.
const LEVELS: usize = 3;

impl MapBuilder {
    /// `edge` is that of the finest cells; cells count from `origin`.
    pub fn new(origin: DVec3, edge: f64) -> Self {
        Self {
            frame: Frame::new(origin),
            edge,
            levels: LEVELS,
            shards: (0..SHARDS).map(|_| Mutex::default()).collect(),
        }
    }

    /// With so many grids, of which the widest one says how far away surfaces are that are not near.
    pub fn with_levels(self, levels: usize) -> Self {
        Self { levels, ..self }
    }

    pub fn add(&self, places: impl Iterator<Item = DVec3>) {
        let mut own: ByKey<Sums> = ByKey::default();
        for place in places.filter(|place| place.is_finite()) {
            let at = self.frame.own(place) / self.edge;
            let cell = at.floor();
            if let Some(key) = key_of(cell.as_i64vec3()) {
                let steps = ((at - cell - 0.5) * STEPS).round().as_i64vec3();
                own.entry(key).or_default().add_point(steps.to_array());
            }
        }
        let mut of_shards: Vec<Vec<(u64, Sums)>> = vec![Vec::new(); SHARDS as usize];
        own.into_iter().for_each(|(key, sums)| of_shards[(hash(key) % SHARDS) as usize].push((key, sums)));
        for (shard, sums) in self.shards.iter().zip(of_shards) {
            let mut shard = shard.lock().unwrap_or_else(PoisonError::into_inner);
            sums.into_iter().for_each(|(key, sums)| shard.entry(key).or_default().add_shifted(&sums, [0; 3]));
        }
    }

    pub fn finish(self) -> SurfaceMap {
        let Self { frame, edge, levels: count, shards } = self;
        let mut cells: Vec<(u64, Sums)> =
            shards.into_iter().flat_map(|shard| shard.into_inner().unwrap_or_else(PoisonError::into_inner)).collect();
        let mut levels = Vec::new();
        for level in 0..count {
            let width = edge * f64::from(1 << level);
            let patch = |(key, sums): &(u64, Sums)| {
                let middle = (cell_of(*key).as_dvec3() + 0.5) * width;
                Some((*key, patch_of(sums, middle, edge / STEPS, width)?.in_world(&frame)))
            };
            levels.push(cells.par_iter().filter_map(patch).collect::<Vec<_>>());
            if level + 1 < count {
                cells = wider(&cells, level);
            }
        }
        SurfaceMap::new(frame, edge, levels)
    }
}

/// The cells of the grid that is twice as wide as that of a level.
fn wider(cells: &[(u64, Sums)], level: usize) -> Vec<(u64, Sums)> {
    // The middle of a cell is half its edge from that of the wider one.
    let half = (STEPS as i64 / 2) << level;
    let mut wide: ByKey<Sums> = ByKey::default();
    for (key, sums) in cells {
        let cell = cell_of(*key);
        let above = cell.div_euclid(I64Vec3::splat(2));
        let shift = (cell - above * 2).to_array().map(|odd| if odd == 1 { half } else { -half });
        if let Some(key) = key_of(above) {
            wide.entry(key).or_default().add_shifted(sums, shift);
        }
    }
    wide.into_iter().collect()
}

/// The fewest points of a patch.
const FEWEST: i64 = 12;
/// The share of a cell's edge that a patch is wide at least.
const LEAST_WIDTH: f64 = 0.08;
/// The share of a patch's width that it is thick at most: cells with an edge or a corner have no patch.
const MOST_THICKNESS: f64 = 0.4;

fn patch_of(sums: &Sums, middle: DVec3, step: f64, width: f64) -> Option<Patch> {
    if sums.count < FEWEST {
        return None;
    }
    let count = sums.count as f64;
    let mean = DVec3::from(sums.first.map(|sum| sum as f64)) / count;
    let second = |index: usize| {
        let [a, b] = PAIRS[index];
        (sums.second[index] as f64 / count - mean[a] * mean[b]) * step * step
    };
    let [xx, yy, zz, xy, xz, yz] = std::array::from_fn(second);
    let covariance = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz));
    let normal = smallest_eigenvector(covariance)?;
    let least = normal.dot(covariance * normal).max(0.0);
    let rest = xx + yy + zz - least;
    // The sum of the principal minors is that of the products of two eigenvalues.
    let minors = xx * yy + yy * zz + xx * zz - xy * xy - xz * xz - yz * yz;
    let product = minors - least * rest;
    let between = 0.5 * (rest - (rest * rest - 4.0 * product).max(0.0).sqrt());
    let (thickness, breadth) = ((least * count / (count - 3.0)).sqrt(), between.max(0.0).sqrt());
    let is_plane = breadth > LEAST_WIDTH * width && thickness < MOST_THICKNESS * breadth;
    is_plane.then_some(Patch {
        center: middle + mean * step,
        normal: normal.as_vec3(),
        thickness: thickness as f32,
        count: sums.count.min(i64::from(u32::MAX)) as u32,
        edge: width as f32,
    })
}

/// The patches of one grid, and which of them lie about each corner of its cells. A look-up of a corner takes the place
/// of eight look-ups of cells, most of which are empty.
struct Grid {
    /// The patches with the keys of their cells.
    patches: Vec<(u64, Patch)>,
    /// The range of `about` for each corner that has patches. A corner has the key of the cell before it on all axes.
    corners: ByKey<[u32; 2]>,
    /// Indices into `patches`: corner by corner, in the order of `beside`.
    about: Vec<u32>,
}

/// The cell that is one of the eight about a corner, whose key is that of the first.
fn beside(index: i64) -> I64Vec3 {
    I64Vec3::new(index & 1, index >> 1 & 1, index >> 2)
}

impl Grid {
    fn new(patches: Vec<(u64, Patch)>) -> Self {
        let corners_of = |(number, (key, _)): (usize, &(u64, Patch))| {
            let cell = cell_of(*key);
            (0..8).filter_map(move |index| Some((key_of(cell - beside(index))?, index as u8, number as u32)))
        };
        let mut all: Vec<(u64, u8, u32)> = patches.iter().enumerate().flat_map(corners_of).collect();
        all.par_sort_unstable();
        let (mut corners, mut start) = (ByKey::default(), 0);
        for own in all.chunk_by(|a, b| a.0 == b.0) {
            let end = start + own.len() as u32;
            corners.insert(own[0].0, [start, end]);
            start = end;
        }
        Self { patches, corners, about: all.into_iter().map(|(.., number)| number).collect() }
    }

    /// The patches of the eight cells about a corner.
    fn about(&self, corner: I64Vec3) -> impl Iterator<Item = &Patch> {
        let range = key_of(corner).and_then(|key| self.corners.get(&key));
        let [start, end] = range.map_or([0, 0], |range| range.map(|index| index as usize));
        self.about[start..end].iter().map(|number| &self.patches[*number as usize].1)
    }
}

/// Patches in grids of several widths.
pub struct SurfaceMap {
    frame: Frame,
    edge: f64,
    levels: Vec<Grid>,
    /// The usual thickness of patches: the noise of the scan.
    noise: f64,
}

/// The patches with so many points that their thickness is well known, of the grid that has most points in such patches.
fn full_patches<'a>(levels: &[&'a [(u64, Patch)]]) -> impl Iterator<Item = &'a Patch> {
    let full = |level: &&[(u64, Patch)]| {
        level.iter().filter(|(_, patch)| patch.count >= FULL).map(|(_, patch)| u64::from(patch.count)).sum::<u64>()
    };
    let most = levels.iter().map(full).max().unwrap_or(0);
    let finest = levels.iter().copied().find(|level| 2 * full(level) >= most);
    finest.into_iter().flatten().map(|(_, patch)| patch).filter(|patch| patch.count >= FULL)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The points of a patch whose thickness is well known.
const FULL: u32 = 30;
/// The least mean square of the cosine of incidence at which the noise of ranges follows from a patch.
const LEAST_FACING: f64 = 0.1;
/// Patches are thinner than this share of their cell's edge, or than so many times the noise.
const THIN: f64 = 0.04;
const NOISY: f64 = 3.0;
/// How far beside its center a patch reaches, in edges of its cell.
const REACH: f64 = 0.75;

impl SurfaceMap {
    fn new(frame: Frame, edge: f64, levels: Vec<Vec<(u64, Patch)>>) -> Self {
        let all: Vec<&[(u64, Patch)]> = levels.iter().map(Vec::as_slice).collect();
        let noise = median(full_patches(&all).map(|patch| f64::from(patch.thickness)).collect()).unwrap_or(0.0);
        let is_thin = |patch: &Patch| f64::from(patch.thickness) < (THIN * f64::from(patch.edge)).max(NOISY * noise);
        let thin =
            |patches: Vec<(u64, Patch)>| Grid::new(patches.into_iter().filter(|(_, patch)| is_thin(patch)).collect());
        Self { frame, edge, levels: levels.into_iter().map(thin).collect(), noise }
    }

    /// The standard deviation of ranges that makes surfaces as thick as they are, seen from these stations: a range that is
    /// off by t is off by t times the cosine of the incidence across the surface.
    pub fn range_noise(&self, stations: &[DVec3]) -> f64 {
        let levels: Vec<&[(u64, Patch)]> = self.levels.iter().map(|level| level.patches.as_slice()).collect();
        let along = |patch: &Patch| {
            let cosine = |station: &DVec3| (patch.center - *station).normalize().dot(patch.normal.as_dvec3());
            let mean = stations.iter().map(|station| cosine(station).powi(2)).sum::<f64>() / stations.len() as f64;
            (mean > LEAST_FACING).then(|| f64::from(patch.thickness) / mean.sqrt())
        };
        median(full_patches(&levels).filter_map(along).collect()).unwrap_or(self.noise)
    }

    /// The standard deviation of points from the surfaces that they are of.
    pub fn noise(&self) -> f64 {
        self.noise
    }

    pub fn edge(&self) -> f64 {
        self.edge
    }

    /// The patches of a grid with wide cells: the finest of these that has at least half as many points in patches as any.
    pub fn wide_patches(&self) -> Vec<Patch> {
        let wide = self.levels.get(LEVELS - 1..).unwrap_or_default();
        let points = |grid: &Grid| grid.patches.iter().map(|(_, patch)| u64::from(patch.count)).sum::<u64>();
        let most = wide.iter().map(points).max().unwrap_or(0);
        let finest = wide.iter().find(|grid| 2 * points(grid) >= most);
        let mut patches = finest.map(|grid| grid.patches.clone()).unwrap_or_default();
        patches.sort_unstable_by_key(|(key, _)| *key);
        patches.into_iter().map(|(_, patch)| patch).collect()
    }

    /// The patch that a place is nearest to, of the finest grid that has one within half an edge of its cells.
    pub fn nearest(&self, place: DVec3) -> Option<Fit> {
        let own = self.frame.own(place);
        self.levels.iter().enumerate().find_map(|(level, grid)| {
            let width = self.edge * f64::from(1 << level);
            let fits = grid.about((own / width - 0.5).floor().as_i64vec3()).filter_map(|patch| {
                let (offset, normal) = (place - patch.center, patch.normal.as_dvec3());
                let distance = offset.dot(normal);
                let beside = (offset - normal * distance).length();
                let is_near = distance.abs() < 0.5 * width && beside < REACH * width;
                is_near.then_some(Fit { distance, patch: *patch })
            });
            fits.min_by(|a, b| a.distance.abs().total_cmp(&b.distance.abs()))
        })
    }
}

#[cfg(test)]
mod tests {
    use cloud::unit;

    use super::*;

    /// A floor at z = 0 and a wall at x = 4, with noise across them.
    fn corner(noise: f64) -> Vec<DVec3> {
        let number = |index: u64, draw: u64| unit(draw, index);
        let point = |index: u64| {
            let across = (number(index, 3) + number(index, 4) + number(index, 5) - 1.5) * 2.0 * noise;
            let (u, v) = (4.0 * number(index, 1), 3.0 * number(index, 2));
            if index.is_multiple_of(2) { DVec3::new(u, v, across) } else { DVec3::new(4.0 + across, v, u) }
        };
        (0..60_000).map(point).map(|point| point + DVec3::new(5e5, 5e6, 0.0)).collect()
    }

    fn map_of(points: &[DVec3], parts: usize) -> SurfaceMap {
        let builder = MapBuilder::new(DVec3::new(5e5, 5e6, 0.0), 0.04);
        points.par_chunks(parts).for_each(|part| builder.add(part.iter().copied()));
        builder.finish()
    }

    #[test]
    fn a_map_tells_the_noise_and_how_far_places_are_from_its_surfaces() {
        let map = map_of(&corner(0.002), 1000);
        assert!((map.noise() / 0.002 - 1.0).abs() < 0.2, "{}", map.noise());
        for (place, expected) in [([2.0, 1.0, 0.01], 0.01), ([4.005, 2.0, 2.0], 0.005), ([1.03, 2.22, 0.0], 0.0)] {
            let fit = map.nearest(DVec3::from(place) + DVec3::new(5e5, 5e6, 0.0)).unwrap();
            assert!((fit.distance.abs() - expected).abs() < 0.0015, "{place:?}: {fit:?}");
        }
        assert!(map.nearest(DVec3::new(5e5 + 2.0, 5e6 + 1.0, 1.5)).is_none(), "in the air");
        assert!(map.nearest(DVec3::new(5e5 + 2.0, 5e6 + 3.5, 0.0)).is_none(), "beside the floor");
    }

    #[test]
    fn a_map_does_not_depend_on_how_points_come() {
        let points = corner(0.003);
        let mut turned = points.clone();
        turned.reverse();
        let [one, other] = [map_of(&points, 777), map_of(&turned, 5000)];
        let places =
            |map: &SurfaceMap| map.wide_patches().iter().map(|patch| (patch.center, patch.normal)).collect::<Vec<_>>();
        assert_eq!(places(&one), places(&other));
        assert!(places(&one).len() > 100 && one.noise() == other.noise());
    }
}
