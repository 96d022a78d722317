//! Estimates normals and splat radii of points that have none.
//!
//! The normal of a point is the direction in which its neighbourhood is thinnest: the eigenvector of the smallest
//! eigenvalue of the covariance of the point and its k nearest neighbours (Hoppe et al. 1992, section 3.2). The points
//! do not determine its sign; an `Orientation` does.
//!
//! The splat radius follows from the distance r to the k-th neighbour. The disc of that radius holds k other points of
//! a locally flat surface, so a point's share of area is pi r^2 / k, and a splat of 2 sqrt(area / (pi n)) has the
//! radius 2 r / sqrt(k): discs wide enough to close the surface between evenly spread points.
//!
//! At the border of a surface the neighbours lie on one side, so that the k-th is further away, and half of the splat
//! stands beside the surface. A stray point's neighbours are all far away, and where there is no surface, as in a tree,
//! discs stand in free space. `RadiusRule` says which radii follow.

use std::sync::atomic::{AtomicU16, AtomicU32, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::carve::{are_seen_from_stations, carve, is_depth_image, is_seen_from};
use crate::leaves::{self, leaves_of};
use crate::neighbours::{Neighbourhood, Points, Surroundings, Tiles};
use crate::robust::{bounds_of_sampled, spread_sample};
use crate::rows::{Line, RowSplat};
use crate::shape::Shape;
use crate::strays::{Look, Stray, kinds_of, median_radius, strays_of};
use crate::{
    Bounds, Chunk, MIXED_RADIUS, NO_NORMAL, NO_RADIUS, Progress, STRAY_RADIUS, pack_ellipse, pack_normal, pack_radius,
    stray_kind, unpack_normal,
};

/// The number of the estimator of normals, radii and stray points: what was estimated with another one is estimated anew
/// where it was kept. It grows with each change of the results; a test holds it (tests/estimator.rs).
pub const ESTIMATOR: u32 = 11;
/// The splat radius relative to the radius of a disc with a point's share of area. Points that fall at random leave
/// exp(-2^2) = 2 % of a surface bare; scans, which are more even, leave less.
pub const SPLAT_OVERLAP: f32 = 2.0;
/// The middle of 16 points that fall at random is about this far aside, so this much says nothing ...
const AMID: f32 = 0.2;
/// ... and this share of the radius is taken off for each unit more. On a straight border half of the disc about the
/// neighbours is bare, in a corner three quarters: their share of area asks for 0.71 and 0.5 of the radius, and this
/// line gives 0.73 and 0.52.
const BORDER: f32 = 1.2;
/// The least share of a radius that is left, for points beside a surface and where there is none.
const LEAST_SHARE: f32 = 0.4;
/// The least spread of neighbours that counts: a point ever so far from a speck of points stays visible near by.
const LEAST_SPREAD: f32 = 0.1;
/// The spread of the neighbours is taken as this much wider: that of 16 points at random differs from place to place,
/// and no radius is larger than by how far they reach.
const WIDER: f32 = 1.1;
/// A neighbourhood as thick as this share of its width is still a surface, as rough as depth cameras measure it ...
const FLAT: f32 = 0.3;
/// ... and this share of the radius is taken off for each unit more.
const ROUGH: f32 = 1.0;
/// Neighbours as thick as this share of their width turn a normal by a degree and more.
const PLANE: f32 = 0.1;
/// The largest radius of a splat relative to the median one of the points around it: a point between two surfaces is
/// far from both, whose points are close together. A bound from the whole cloud would be too small far from a scanner.
const LARGEST_RADIUS: f32 = 2.0;
/// Radii are bounded where the neighbours are crowded: this share of their pairs, or more, are nearer to one another than
/// half of the distance to the last of them. On an even surface these are a fifth, and nine twentieths in a line.
const CROWDED: f32 = 0.4;
/// Neighbours that are spread by so much about the point are not crowded; others are looked at.
const EVEN: std::ops::RangeInclusive<f32> = 0.88..=1.12;
/// The most neighbours whose pairs are counted, the nearest ones.
const MOST_PAIRED: usize = 16;
/// The side of a surface to which normals point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Orientation {
    /// Along this direction: for ground and roofs seen from the air.
    Up(Vec3),
    /// Towards this world position: the scanner, or the middle of a room.
    Toward(DVec3),
    /// Away from this world position: the middle of an object.
    AwayFrom(DVec3),
}

/// What the radii of points follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RadiusRule {
    /// How far the neighbours reach.
    #[default]
    Full,
    /// How far the neighbours reach, but smaller, the more they lie on one side.
    Narrow,
    /// How far the neighbours are spread about their own middle, and smaller where they form no surface. In the middle
    /// of an even surface it is the same. A point that is far from all of its neighbours gets `STRAY_RADIUS`.
    Spread,
}

/// How normals and radii are estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelOptions {
    /// The number of neighbours of a point, itself not counted; clamped to 3 ..= 64.
    pub neighbours: usize,
    pub orientation: Orientation,
    pub radii: RadiusRule,
    /// Where the points were seen from, if that is known: then discs and ellipses end before they hide other points from
    /// there. `estimate_part`, by which clouds are streamed, does not carve.
    pub seen_from: Option<SeenFrom>,
}

/// Where points were seen from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SeenFrom {
    /// All from this place.
    Place(DVec3),
    /// Those of each chunk from its own station.
    Stations,
}

impl SurfelOptions {
    /// 16 neighbours: about the two rings around a point of an even grid.
    pub fn new(orientation: Orientation) -> Self {
        Self { neighbours: 16, orientation, radii: RadiusRule::Full, seen_from: None }
    }

    /// The options for these points, which a scanner at `scanner` measured if that is known: then surfaces face it, and
    /// discs end before they hide a point from it. Where each chunk names its station, its points are seen from there, and
    /// those of a depth image from the origin. `up` is the vertical axis, by which the side that was scanned is guessed.
    pub fn of_scan(chunks: &[Chunk], up: Vec3, scanner: Option<DVec3>) -> Self {
        let guessed = || guess_orientation(chunks, up);
        let from_scanner = || scanner.filter(|place| is_seen_from(chunks, *place)).map(SeenFrom::Place);
        let from_origin = || is_depth_image(chunks).then_some(SeenFrom::Place(DVec3::ZERO));
        let stations = are_seen_from_stations(chunks).then_some(SeenFrom::Stations);
        let seen_from = stations.or_else(from_scanner).or_else(from_origin);
        Self { seen_from, ..Self::new(scanner.map_or_else(guessed, Orientation::Toward)) }
    }
}

/// The estimate for one chunk: one entry per point, in its order.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfels {
    /// The normals, packed by `pack_normal`: the chunk's own where it has them, `NO_NORMAL` where the neighbourhood is
    /// a line, a single place or not finite.
    pub normals: Vec<u32>,
    /// The radii, packed by `pack_radius`; `NO_RADIUS` for points that are not finite, and for a cloud at a single
    /// place.
    pub radii: Vec<u16>,
}

/// Estimates normals and radii of all points, on all cores; one entry per chunk, in order. `progress` counts points.
/// `None` when cancelled.
///
/// Needs about 6 bytes a point beside the result, 8 more for each ellipse, and some 5 MB a thread. Clouds of 2^32 points
/// and more are divided into parts whose points do not see one another.
pub fn estimate(chunks: &[Chunk], options: &SurfelOptions, progress: &Progress) -> Option<Vec<Surfels>> {
    progress.set_total(chunks.iter().map(|chunk| chunk.len() as u64).sum());
    let mut surfels = Vec::with_capacity(chunks.len());
    for part in parts(chunks, u32::MAX as usize) {
        let points = Points::new(part);
        let estimate = Estimate::of(part, &points, options, progress)?;
        if let Some(seen_from) = options.seen_from {
            carve(&points, &estimate.results, &estimate.rough, seen_from, progress)?;
        }
        surfels.extend(estimate.surfels());
    }
    Some(surfels)
}

/// Runs of chunks with at most `limit` points (or a single chunk).
pub(crate) fn parts(chunks: &[Chunk], limit: usize) -> Vec<&[Chunk]> {
    let mut parts = Vec::new();
    let (mut first, mut points) = (0, 0);
    for (index, chunk) in chunks.iter().enumerate() {
        if points + chunk.len() > limit && index > first {
            parts.push(&chunks[first..index]);
            (first, points) = (index, 0);
        }
        points += chunk.len();
    }
    parts.push(&chunks[first..]);
    parts
}

/// What [`estimate`] does, for a part of a cloud, with two differences: radii are not carved, and the total of
/// `progress` is not set. For less than 2^32 points.
pub fn estimate_part(chunks: &[Chunk], options: &SurfelOptions, progress: &Progress) -> Option<Vec<Surfels>> {
    let points = Points::new(chunks);
    Some(Estimate::of(chunks, &points, options, progress)?.surfels())
}

/// What is found in a tile beside the radii and normals that follow from each point's own neighbours.
#[derive(Default)]
struct OfTile {
    /// The points that are on no surface.
    strays: Vec<Stray>,
    /// The running indices of points whose packed radius is another one, with it. Radii of the points around bound some,
    /// so none is written before all are known.
    radii: Vec<(u32, u16)>,
    /// Crowded points with neighbours in other tiles, whose radii are not known yet.
    at_border: Vec<Crowded>,
}

/// A point whose radius those of its neighbours bound.
struct Crowded {
    /// The running index.
    index: u32,
    /// The running indices of its neighbours.
    neighbours: Vec<u32>,
}

/// The packed normals and radii of a chunk, while they are made.
pub(crate) type Stored = (Vec<AtomicU32>, Vec<AtomicU16>);

/// The estimate of a part of a cloud, while it is made.
struct Estimate<'a> {
    chunks: &'a [Chunk],
    points: &'a Points<'a>,
    options: &'a SurfelOptions,
    /// For each chunk the packed normals and radii. A tile's points are scattered over the chunks: atomics let the tiles
    /// write them without unsafe code.
    results: Vec<Stored>,
    /// A bit for each point, in words of 32, if radii are carved: whether its neighbours are rough, so that their plane says
    /// little of the surface's.
    rough: Vec<AtomicU32>,
}

impl<'a> Estimate<'a> {
    fn new(chunks: &'a [Chunk], points: &'a Points<'a>, options: &'a SurfelOptions) -> Self {
        let empty = |chunk: &Chunk| {
            let normals = match &chunk.normals {
                Some(normals) => normals.iter().map(|&normal| AtomicU32::new(normal)).collect(),
                None => chunk.positions.iter().map(|_| AtomicU32::new(NO_NORMAL)).collect(),
            };
            (normals, chunk.positions.iter().map(|_| AtomicU16::new(NO_RADIUS)).collect())
        };
        let words = options.seen_from.map_or(0, |_| points.len().div_ceil(32));
        let rough = (0..words).map(|_| AtomicU32::new(0)).collect();
        Self { chunks, points, options, results: chunks.par_iter().map(empty).collect(), rough }
    }

    /// Estimates all points. `None` when cancelled.
    fn of(
        chunks: &'a [Chunk],
        points: &'a Points<'a>,
        options: &'a SurfelOptions,
        progress: &Progress,
    ) -> Option<Self> {
        let tiles = Tiles::new(points, progress)?;
        let estimate = Self::new(chunks, points, options);
        let found: Vec<OfTile> =
            (0..tiles.len()).into_par_iter().map(|tile| estimate.search(&tiles, tile, progress)).collect();
        let searched: usize = (0..tiles.len()).map(|tile| tiles.points_of(tile)).sum();
        drop(tiles);
        let strays: Vec<&Stray> = found.iter().flat_map(|of_tile| &of_tile.strays).collect();
        let kinds = kinds_of(points, &strays, progress)?;
        let mut radii: Vec<(u32, u16)> = Vec::new();
        radii.par_extend(
            found
                .par_iter()
                .flat_map_iter(|of_tile| &of_tile.at_border)
                .map(|crowded| (crowded.index, estimate.bounded(crowded.index, &crowded.neighbours))),
        );
        let decided = found.iter().flat_map(|of_tile| &of_tile.radii).chain(&radii);
        decided.for_each(|(index, radius)| estimate.set_radius(*index, *radius));
        strays.iter().zip(kinds).for_each(|(stray, kind)| estimate.set_radius(stray.index, kind));
        progress.add((points.len() - searched) as u64);
        Some(estimate)
    }

    /// Estimates each point of a tile from its own neighbours.
    fn search(&self, tiles: &Tiles, tile: usize, progress: &Progress) -> OfTile {
        let count = self.options.neighbours.clamp(3, 64);
        let found = match count {
            ..=16 => self.search_in::<16>(tiles, tile, count, progress),
            17..=32 => self.search_in::<32>(tiles, tile, count, progress),
            _ => self.search_in::<64>(tiles, tile, count, progress),
        };
        if !progress.is_cancelled() {
            progress.add(tiles.points_of(tile) as u64);
        }
        found
    }

    fn search_in<const LANES: usize>(&self, tiles: &Tiles, tile: usize, count: usize, progress: &Progress) -> OfTile {
        let (mut found, mut looks) = (OfTile::default(), Vec::with_capacity(tiles.points_of(tile)));
        let (mut ways, mut leaves) = (Vec::new(), Vec::new());
        // Crowded points whose neighbours are all in the tile, with the ends of their neighbours in one list.
        let (mut crowded, mut neighbours): (Vec<(u32, usize)>, Vec<u32>) = (Vec::new(), Vec::new());
        let visit = |index: u32, surroundings: &mut Surroundings<'_, '_, LANES>| {
            let (chunk, local) = self.points.locate(index);
            let (normals, radii) = &self.results[chunk];
            let around = surroundings.neighbourhood();
            let shape = Shape::of(around);
            let normal = shape.as_ref().and_then(Shape::normal);
            let brick = surroundings.brick() as u32;
            let look = look([index, brick], around, shape.as_ref(), normal, self.options.radii);
            let is_stray = stray_kind(look.radius) != 0;
            radii[local].store(look.radius, Ordering::Relaxed);
            if normals[local].load(Ordering::Relaxed) == NO_NORMAL
                && let Some(normal) = normal
            {
                let normal = orient(normal, self.chunks[chunk].position(local), self.options.orientation);
                normals[local].store(pack_normal(normal), Ordering::Relaxed);
            }
            looks.push(look);
            if let Some(word) = self.rough.get(index as usize / 32)
                && shape.as_ref().is_none_or(|shape| shape.roughness() > PLANE)
            {
                word.fetch_or(1 << (index % 32), Ordering::Relaxed);
            }
            let Some(shape) = shape.filter(|_| !is_stray) else {
                return;
            };
            let lines = [shape.line().map(|axis| Line::along(axis, around.offsets())), Line::of_nearest(around)];
            let row = lines.iter().flatten().find_map(|line| self.row(line, index, surroundings, &mut ways));
            if let Some(row) = row {
                found.radii.push((index, self.set_row(index, &row)));
                return;
            }
            let around = surroundings.neighbourhood();
            let is_bounded = !shape.is_wide() || !EVEN.contains(&shape.spread) && is_crowded(around);
            if is_bounded && around.is_in_tile {
                neighbours.extend(around.indices());
                crowded.push((index, neighbours.len()));
            } else if is_bounded {
                found.at_border.push(Crowded { index, neighbours: around.indices().collect() });
            }
        };
        tiles.search::<LANES>(tile, count, visit, progress);
        if self.options.radii == RadiusRule::Spread {
            // Whatever is crowded beside leaves is bounded by their radii, too.
            leaves = leaves_of(self.points, &looks);
            leaves.iter().for_each(|(leaf, radius)| self.set_leaf(leaf, *radius));
            found.strays = strays_of(tiles, tile, count, &looks, progress);
            found.strays.iter().for_each(|stray| self.set_radius(stray.index, STRAY_RADIUS));
        }
        let mut first = 0;
        for (index, end) in crowded {
            let (before, bounded) = (self.radius(index), self.bounded(index, &neighbours[first..end]));
            if bounded != before {
                found.radii.push((index, bounded));
            }
            first = end;
        }
        // Neighbours in a row are chance among leaves.
        found.radii.extend(leaves.iter().map(|(leaf, radius)| (leaf.index, *radius)));
        found.radii.shrink_to_fit();
        found
    }

    /// The splat of a point in a row. The buffer `ways` is for ways to other rows.
    fn row<const LANES: usize>(
        &self,
        line: &Line,
        index: u32,
        surroundings: &mut Surroundings<'_, '_, LANES>,
        ways: &mut Vec<Vec3>,
    ) -> Option<RowSplat> {
        ways.clear();
        line.add_across(surroundings.neighbourhood(), ways);
        let search = |side: Vec3, ways: &mut Vec<Vec3>| {
            line.add_across(surroundings.search_aside(line.axis, side, line.reach()), ways);
        };
        line.splat(ways, search, self.own_normal(index))
    }

    /// The packed radius of a point by those of its neighbours.
    fn bounded(&self, index: u32, neighbours: &[u32]) -> u16 {
        let radius = self.radius(index);
        let mut radii: Vec<u16> = neighbours.iter().map(|index| self.radius(*index)).collect();
        radii.retain(|radius| *radius > MIXED_RADIUS);
        let largest = median_radius(&mut radii).map_or(u16::MAX, |median| pack_radius(LARGEST_RADIUS * median));
        radius.min(largest)
    }

    /// The packed radius of a point so far.
    fn radius(&self, index: u32) -> u16 {
        let (chunk, local) = self.points.locate(index);
        self.results[chunk].1[local].load(Ordering::Relaxed)
    }

    /// The normal that the file has for a point.
    fn own_normal(&self, index: u32) -> Option<Vec3> {
        let (chunk, local) = self.points.locate(index);
        self.chunks[chunk].normals.as_ref().and_then(|normals| unpack_normal(normals[local]))
    }

    fn set_radius(&self, index: u32, radius: u16) {
        let (chunk, local) = self.points.locate(index);
        self.results[chunk].1[local].store(radius, Ordering::Relaxed);
    }

    /// Sets the radius of a point among leaves, and the normal of the plane of its neighbours, unless the file has one.
    fn set_leaf(&self, leaf: &Look, radius: u16) {
        self.set_radius(leaf.index, radius);
        if let (None, Some(normal)) = (self.own_normal(leaf.index), unpack_normal(leaf.normal)) {
            let (chunk, local) = self.points.locate(leaf.index);
            let normal = orient(normal, self.chunks[chunk].position(local), self.options.orientation);
            self.results[chunk].0[local].store(pack_normal(normal), Ordering::Relaxed);
        }
    }

    /// Sets the normal of a point in a row, unless the file has one; its packed radius.
    fn set_row(&self, index: u32, RowSplat { normal, stretch, long }: &RowSplat) -> u16 {
        let (chunk, local) = self.points.locate(index);
        let stored = &self.results[chunk].0[local];
        if self.own_normal(index).is_none() {
            let normal = orient(*normal, self.chunks[chunk].position(local), self.options.orientation);
            stored.store(pack_normal(normal), Ordering::Relaxed);
        }
        // The shape is packed for the normal as it is unpacked.
        pack_ellipse(*long, *stretch, unpack_normal(stored.load(Ordering::Relaxed)).unwrap_or(*normal))
    }

    fn surfels(self) -> Vec<Surfels> {
        let surfels = self.results.into_iter().map(|(normals, radii)| Surfels {
            normals: normals.into_iter().map(AtomicU32::into_inner).collect(),
            radii: radii.into_iter().map(AtomicU16::into_inner).collect(),
        });
        surfels.collect()
    }
}

/// What decides whether a point is on a surface: its neighbours, their shape and their normal. The first argument has
/// the running index of the point and the number of its brick.
pub(crate) fn look(
    [index, brick]: [u32; 2],
    around: &Neighbourhood,
    shape: Option<&Shape>,
    normal: Option<Vec3>,
    rule: RadiusRule,
) -> Look {
    let is_far = rule == RadiusRule::Spread && shape.is_some_and(Shape::is_stray);
    let radius = if is_far { STRAY_RADIUS } else { pack_radius(splat_radius(around, shape, rule)) };
    let normal = normal.map_or(NO_NORMAL, pack_normal);
    let is_rough = shape.is_some_and(|shape| shape.roughness() > leaves::ROUGH);
    let near = is_rough.then(|| around.fourth_squared.sqrt());
    Look { index, brick, radius, normal, reach: around.distance_squared.sqrt(), near }
}

fn splat_radius(neighbourhood: &Neighbourhood, shape: Option<&Shape>, rule: RadiusRule) -> f32 {
    let radius = SPLAT_OVERLAP * (neighbourhood.distance_squared / neighbourhood.count as f32).sqrt();
    match (rule, shape) {
        (RadiusRule::Narrow, _) => radius * (1.0 - BORDER * (aside(neighbourhood) - AMID)).clamp(LEAST_SHARE, 1.0),
        (RadiusRule::Spread, Some(shape)) => {
            let share = (WIDER * shape.spread).clamp(LEAST_SPREAD, 1.0);
            radius * share * (1.0 - ROUGH * (shape.roughness() - FLAT)).clamp(LEAST_SHARE, 1.0)
        }
        _ => radius,
    }
}

/// Whether the nearest neighbours are nearer to one another than they would be if they were spread evenly about the point.
fn is_crowded(neighbourhood: &Neighbourhood) -> bool {
    let limit = neighbourhood.distance_squared / 4.0;
    // Lanes without a neighbour are far from all others, and from themselves.
    let mut places = [[f32::INFINITY; MOST_PAIRED]; 3];
    let mut count = 0;
    let mut place = |offset: Vec3| {
        (0..3).for_each(|axis| places[axis][count] = offset[axis]);
        count += 1;
    };
    if neighbourhood.offsets().nth(MOST_PAIRED).is_none() {
        neighbourhood.offsets().for_each(place);
    } else {
        neighbourhood.nearest(MOST_PAIRED).into_iter().for_each(&mut place);
    }
    let [x, y, z] = &places;
    let mut near = 0;
    for at in 0..count {
        for other in 0..MOST_PAIRED {
            let (dx, dy, dz) = (x[other] - x[at], y[other] - y[at], z[other] - z[at]);
            near += u32::from(dx * dx + dy * dy + dz * dz < limit);
        }
    }
    // Each pair is counted twice, and each neighbour once with itself.
    count > 1 && (near as f32 - count as f32) >= CROWDED * (count * (count - 1)) as f32
}

/// How far the middle of the neighbours is from the point, relative to the most distant one: 0 in the middle of an even
/// surface, 4 / (3 pi) = 0.42 on a straight border, 0.6 in a corner, up to 1 where all neighbours lie in one direction.
fn aside(neighbourhood: &Neighbourhood) -> f32 {
    let reach = neighbourhood.distance_squared.sqrt() * neighbourhood.count as f32;
    let sum: Vec3 = neighbourhood.offsets().sum();
    if reach > 0.0 { sum.length() / reach } else { 0.0 }
}

/// Turns a normal at a world position to the side that `orientation` asks for; the result is the same for both signs of
/// the input.
fn orient(normal: Vec3, position: DVec3, orientation: Orientation) -> Vec3 {
    let outward = match orientation {
        Orientation::Up(up) => up,
        Orientation::Toward(viewer) => (viewer - position).as_vec3(),
        Orientation::AwayFrom(centre) => (position - centre).as_vec3(),
    };
    let along = normal.dot(outward);
    // Exactly sideways: the first component that is not zero is made positive.
    let along = if along == 0.0 { normal.to_array().into_iter().find(|v| *v != 0.0).unwrap_or(0.0) } else { along };
    if along < 0.0 { -normal } else { normal }
}

/// The most columns along each horizontal axis in which what is below a ceiling is looked for, and the points that each has
/// in the mean.
const MOST_COLUMNS: usize = 64;
const COLUMN_POINTS: usize = 16;
/// The height of a landscape relative to its width is less.
const LANDSCAPE_HEIGHT: f64 = 0.35;
/// The fewest square pieces of a strip.
const FEWEST_PIECES: f64 = 4.0;

/// Guesses from its shape which side of a cloud was scanned: the inside of a room, the top of a landscape, or the
/// outside of an object. `up` is the vertical axis.
///
/// - A room has a floor and a ceiling: the lowest and the highest tenth of its height hold an eighth of the points each
///   (a sphere, a cylinder or a box without lids has a tenth there, terrain next to nothing at the top), and under most of
///   the ceiling there are points of the lower half (not under a field with a pit in it, or a terrace).
/// - A landscape is less high than a third of its width. So is one that is much longer than wide, a strip, if most of its
///   points are in square pieces that are; such a piece of a wall, of a corridor or of a beam is higher.
/// - Anything else is an object. The outside of a box or a can with both lids looks like a room and is taken for one.
pub fn guess_orientation(chunks: &[Chunk], up: Vec3) -> Orientation {
    let mut sample: Vec<DVec3> = spread_sample(chunks).collect();
    let bounds = bounds_of_sampled(chunks, sample.clone());
    let up = up.normalize_or(Vec3::Z);
    let vertical = up.abs().max_position();
    if bounds.is_empty() {
        return Orientation::Up(up);
    }
    let size = bounds.size();
    let height = size[vertical];
    let width = (0..3).filter(|&axis| axis != vertical).map(|axis| size[axis]).fold(f64::INFINITY, f64::min);
    // Whether each of a grid of columns has points of the lower half, and of a ceiling.
    let across = (sample.len() / COLUMN_POINTS).isqrt().clamp(4, MOST_COLUMNS);
    let mut columns = vec![[false; 2]; across * across];
    let (mut lowest, mut highest) = (0, 0);
    sample.retain(|position| bounds.contains(*position));
    for position in &sample {
        let share = (position - bounds.min) / size;
        let [column, row] =
            [1, 2].map(|next| ((share[(vertical + next) % 3] * across as f64) as usize).min(across - 1));
        let (is_lowest, is_highest) = (share[vertical] < 0.1, share[vertical] > 0.9);
        let [is_below, has_ceiling] = &mut columns[row * across + column];
        *is_below |= share[vertical] < 0.5;
        *has_ceiling |= is_highest;
        lowest += usize::from(is_lowest);
        highest += usize::from(is_highest);
    }
    let ceiling = columns.iter().filter(|[_, has_ceiling]| *has_ceiling);
    let above = ceiling.clone().filter(|[is_below, _]| *is_below).count();
    // A level field is not a room, whatever its noise looks like.
    let has_lids = 8 * lowest.min(highest) >= sample.len() && height > 0.02 * width;
    if has_lids && 2 * above > ceiling.count() {
        Orientation::Toward(bounds.center())
    } else if height < LANDSCAPE_HEIGHT * width || is_strip(&sample, bounds, vertical) {
        Orientation::Up(up)
    } else {
        Orientation::AwayFrom(bounds.center())
    }
}

/// Whether the points in these bounds are a strip of a landscape.
fn is_strip(points: &[DVec3], bounds: Bounds, vertical: usize) -> bool {
    let size = bounds.size();
    let [one, other] = [1, 2].map(|next| (vertical + next) % 3);
    let (along, across) = if size[one] > size[other] { (one, other) } else { (other, one) };
    let count = (size[along] / size[across]).min((points.len() / COLUMN_POINTS) as f64);
    if count < FEWEST_PIECES {
        return false;
    }
    let mut pieces: Vec<Vec<f64>> = vec![Vec::new(); count as usize];
    for point in points {
        let share = (point[along] - bounds.min[along]) / size[along];
        let place = ((share * pieces.len() as f64) as usize).min(pieces.len() - 1);
        pieces[place].push(point[vertical]);
    }
    // Birds and echoes below the ground are few.
    let held_if_flat = |heights: &mut Vec<f64>| {
        heights.sort_unstable_by(f64::total_cmp);
        let stray = heights.len() / 50;
        let ends = [heights.get(stray), heights.iter().nth_back(stray)].map(|end| end.copied().unwrap_or(0.0));
        if ends[1] - ends[0] < LANDSCAPE_HEIGHT * size[across] { heights.len() } else { 0 }
    };
    2 * pieces.iter_mut().map(held_if_flat).sum::<usize>() > points.len()
}

/// Normals from the faces of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshNormals {
    /// The normals per chunk, packed by `pack_normal`; `NO_NORMAL` for vertices of no triangle with an area.
    pub normals: Vec<Vec<u32>>,
    /// The number of triangles that name a vertex that does not exist.
    pub skipped_triangles: usize,
}

/// The vertex normals of a mesh whose vertices are the points of `chunks` in order: the mean of the normals of the
/// triangles about a vertex, weighted by area. Triangles are counter-clockwise as seen from outside.
pub fn normals_from_triangles(chunks: &[Chunk], triangles: &[[u32; 3]]) -> MeshNormals {
    let mut starts = Vec::with_capacity(chunks.len());
    let mut total = 0;
    for chunk in chunks {
        starts.push(total);
        total += chunk.len();
    }
    let locate = |index: u32| {
        let index = index as usize;
        let chunk = starts.partition_point(|&start| start <= index) - 1;
        (chunk, index - starts[chunk])
    };
    let mut sums: Vec<Vec<Vec3>> = chunks.iter().map(|chunk| vec![Vec3::ZERO; chunk.len()]).collect();
    let mut skipped_triangles = 0;
    for triangle in triangles {
        if triangle.iter().any(|&index| index as usize >= total) {
            skipped_triangles += 1;
            continue;
        }
        let corners = triangle.map(locate);
        let [a, b, c] = corners.map(|(chunk, local)| chunks[chunk].position(local));
        // The length of the sum is twice the area.
        let normal = (b - a).cross(c - a).as_vec3();
        if normal.is_finite() {
            corners.into_iter().for_each(|(chunk, local)| sums[chunk][local] += normal);
        }
    }
    let normals = sums.into_iter().map(|sums| sums.into_iter().map(pack_normal).collect()).collect();
    MeshNormals { normals, skipped_triangles }
}

/// A splat radius for points until theirs is estimated: it assumes `points` points spread evenly over the largest face
/// of the box. About right for terrain and facades; up to 3 times too small for rooms and closed objects, whose surface
/// is several faces, and too large where the scan is much denser than on average. 0 for an empty box or a single place.
pub fn provisional_radius(bounds: Bounds, points: u64) -> f32 {
    let size = bounds.size();
    let mut sides = size.to_array();
    sides.sort_by(f64::total_cmp);
    let area = sides[2] * sides[1];
    let points = points.max(1) as f64;
    // Points on a line are its length divided by their number apart.
    let apart = (area / (std::f64::consts::PI * points)).sqrt().max(sides[2] / (2.0 * points));
    SPLAT_OVERLAP * apart as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_keep_every_chunk_and_their_limit() {
        let chunks: Vec<Chunk> =
            [3, 0, 4, 9, 1].map(|points| Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; points])).to_vec();
        let sizes: Vec<Vec<usize>> =
            parts(&chunks, 7).into_iter().map(|part| part.iter().map(Chunk::len).collect()).collect();
        assert_eq!(sizes, [vec![3, 0, 4], vec![9], vec![1]]);
    }

    #[test]
    fn sign_of_a_normal_does_not_depend_on_the_sign_given() {
        let position = DVec3::new(1.0, 2.0, 3.0);
        for orientation in
            [Orientation::Up(Vec3::Z), Orientation::Toward(DVec3::ZERO), Orientation::AwayFrom(DVec3::ONE)]
        {
            for normal in [Vec3::X, Vec3::Z, Vec3::new(0.6, -0.8, 0.0), Vec3::new(0.36, 0.48, -0.8)] {
                assert_eq!(orient(normal, position, orientation), orient(-normal, position, orientation));
            }
        }
    }
}
