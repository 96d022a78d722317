//! Finds the exact k nearest neighbours of every point of a cloud with little memory, however the points are divided
//! into chunks.
//!
//! Points are divided by planes into *tiles* of some 50 thousand, and each tile by medians into *bricks* of at most 32,
//! with a tree of boxes over them. For the whole cloud four bytes of order and 1.5 bytes of boxes a point stay in
//! memory. A tile is then searched by one thread: it copies its own points, relative to an origin in their middle, and
//! copies bricks of other tiles only when a search reaches them, so there is no halo whose width could be wrong.
//!
//! A library's k-d tree over everything would store all positions a second time, and one per tile would need that halo;
//! `benches/normals.rs` runs `kiddo` beside this search.

mod search;

use std::cmp::Ordering;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::atomic::{self, AtomicU32};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use search::{Aside, Ball, Search};
pub use search::{Neighbourhood, is_aside};

use crate::{Bounds, Chunk, Progress, hash};

/// The most points of a tile when planes through the medians of a sample divide evenly: its copy stays in a core's
/// second-level cache.
const TILE_POINTS: usize = 65_536;
/// The number of points per tile that decide where space is divided.
const SAMPLE_PER_TILE: usize = 256;
/// The most points of a brick. Fewer cost more boxes, more cost more distances; 16 and 24 were slower.
const BRICK_POINTS: usize = 32;
/// The number of a tile's points from which the precision of its offsets is estimated.
const REACH_SAMPLE: usize = 99;

/// The points of a list of chunks under one running index.
pub struct Points<'a> {
    chunks: &'a [Chunk],
    /// The index of each chunk's first point, and the number of points at the end.
    starts: Vec<u32>,
}

impl<'a> Points<'a> {
    /// Numbers the points of `chunks`, at most `u32::MAX`.
    pub fn new(chunks: &'a [Chunk]) -> Self {
        let mut starts = vec![0];
        let mut total = 0;
        for chunk in chunks {
            total += chunk.len() as u32;
            starts.push(total);
        }
        Self { chunks, starts }
    }

    pub fn len(&self) -> usize {
        self.starts.last().map_or(0, |&total| total as usize)
    }

    pub(crate) fn chunks(&self) -> &'a [Chunk] {
        self.chunks
    }

    /// The running index of the first point of a chunk.
    pub(crate) fn first_of(&self, chunk: usize) -> u32 {
        self.starts[chunk]
    }

    /// The chunk of point `index`, and its index there.
    pub fn locate(&self, index: u32) -> (usize, usize) {
        let chunk = self.starts.partition_point(|&start| start <= index) - 1;
        (chunk, (index - self.starts[chunk]) as usize)
    }

    pub fn position(&self, index: u32) -> DVec3 {
        let (chunk, local) = self.locate(index);
        self.chunks[chunk].position(local)
    }

    /// The median of the largest components of some of these points' offsets.
    fn usual_reach(&self, indices: &[u32]) -> f64 {
        let step = indices.len().div_ceil(REACH_SAMPLE).max(1);
        let mut reaches: Vec<f32> = indices
            .iter()
            .step_by(step)
            .map(|&index| {
                let (chunk, local) = self.locate(index);
                Vec3::from(self.chunks[chunk].positions[local]).abs().max_element()
            })
            .collect();
        let middle = reaches.len() / 2;
        f64::from(*reaches.select_nth_unstable_by(middle, f32::total_cmp).1)
    }
}

/// A box in the coordinates of a tile.
#[derive(Clone, Copy)]
struct Box3 {
    min: Vec3,
    max: Vec3,
}

impl Box3 {
    fn of(points: &[(Vec3, u32)]) -> Self {
        let empty = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
        points.iter().fold(empty, |all, (point, _)| Self { min: all.min.min(*point), max: all.max.max(*point) })
    }

    /// The squared distance to a point. It is never more than that to a point inside the box as `Nearest::scan`
    /// computes it in f32: the same differences are rounded the same way.
    #[inline]
    fn distance_squared(&self, point: Vec3) -> f32 {
        let outside = (self.min - point).max(point - self.max).max(Vec3::ZERO);
        outside.x * outside.x + outside.y * outside.y + outside.z * outside.z
    }

    fn longest_axis(&self) -> usize {
        (self.max - self.min).max_position()
    }
}

/// Planes that divide space into `2^depth` cells, through the medians of a sample.
struct Planes {
    depth: u32,
    /// The axis and coordinate of each plane, in heap order from index 1.
    planes: Vec<(usize, f64)>,
    cells: Vec<Bounds>,
    /// A position amid each cell's points; a stray point in the cell does not move it.
    middles: Vec<DVec3>,
}

impl Planes {
    fn new(points: &Points) -> Self {
        let tiles = points.len().div_ceil(TILE_POINTS).next_power_of_two();
        let mut sample = sample_of(points, tiles * SAMPLE_PER_TILE);
        // A cloud of mostly points that are not finite gives a small sample; every cell must still get some of it.
        let depth = tiles.ilog2().min((sample.len() / 16).max(1).ilog2());
        let everywhere = Bounds { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };
        let mut planes = Self { depth, planes: vec![(0, 0.0); 1 << depth], cells: Vec::new(), middles: Vec::new() };
        planes.divide(1, &mut sample, everywhere);
        planes
    }

    fn divide(&mut self, node: usize, sample: &mut [DVec3], cell: Bounds) {
        let middle = sample.len() / 2;
        let mut median = |axis: usize| {
            if sample.is_empty() {
                return 0.0;
            }
            sample.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis])).1[axis]
        };
        if node >> self.depth == 1 {
            self.middles.push(DVec3::new(median(0), median(1), median(2)));
            self.cells.push(cell);
            return;
        }
        let mut bounds = Bounds::EMPTY;
        sample.iter().for_each(|position| bounds.include(*position));
        let axis = bounds.size().max_position();
        let plane = sample.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis])).1[axis];
        self.planes[node] = (axis, plane);
        let (mut below, mut above) = (cell, cell);
        below.max[axis] = plane;
        above.min[axis] = plane;
        let (left, right) = sample.split_at_mut(middle);
        self.divide(2 * node, left, below);
        self.divide(2 * node + 1, right, above);
    }

    fn cell_of(&self, position: DVec3) -> usize {
        let mut node = 1;
        for _ in 0..self.depth {
            let (axis, plane) = self.planes[node];
            node = 2 * node + usize::from(position[axis] >= plane);
        }
        node - (1 << self.depth)
    }
}

/// About `wanted` of the places of finite points, each once, drawn by their coordinates, so that it does not depend on
/// the order of the points.
fn sample_of(points: &Points, wanted: usize) -> Vec<DVec3> {
    let limit = (wanted as f64 / points.len().max(1) as f64 * 2.0_f64.powi(64)) as u64;
    let of_chunk = |chunk: &Chunk| {
        let places = (0..chunk.len()).map(|local| chunk.position(local));
        places.filter(|place| place.is_finite() && hash_of(*place) <= limit).collect::<Vec<_>>()
    };
    let mut sample: Vec<DVec3> = points.chunks.par_iter().flat_map_iter(of_chunk).collect();
    sample.sort_unstable_by(|a, b| total_order(a.to_array(), b.to_array()));
    sample.dedup();
    sample
}

/// A hash of a place; the two zeros are equal.
fn hash_of(place: DVec3) -> u64 {
    (place + DVec3::ZERO).to_array().into_iter().fold(0, |mixed, value| hash(mixed ^ value.to_bits()))
}

/// The order of coordinates one after the other.
fn total_order(a: [f64; 3], b: [f64; 3]) -> Ordering {
    (0..3).map(|axis| a[axis].total_cmp(&b[axis])).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
}

/// The points of one cell, arranged in bricks.
struct Tile {
    origin: DVec3,
    /// The points of other tiles lie outside this cell.
    cell: Bounds,
    /// The range of its points in `Tiles::order`: one of each place, brick by brick, then the others.
    range: Range<usize>,
    places: Places,
}

/// The places of a tile's points.
#[derive(Default)]
struct Places {
    count: usize,
    /// The tree of boxes, in heap order from index 1; the second half are the bricks. Empty if the tile is.
    boxes: Vec<Box3>,
    /// For each point that is not the first of its place, the index of that place. Ascending.
    of_others: Vec<u32>,
}

impl Tile {
    fn bricks(&self) -> usize {
        self.places.boxes.len() / 2
    }

    /// The places of a brick.
    fn brick(&self, brick: usize) -> Range<usize> {
        let start = |brick| brick_start(self.places.count, self.bricks(), brick);
        start(brick)..start(brick + 1)
    }

    /// A box of this tile in the coordinates of another. It is widened by more than the rounding of coordinates: half a
    /// unit in the last place of f32 in either tile and of f64 in the world, and some more.
    fn box_seen_from(&self, home: &Tile, local: &Box3) -> Box3 {
        let shift = self.origin - home.origin;
        let world = 1e-15 * (self.origin.abs() + home.origin.abs());
        let slack = |corner: DVec3| 2.0_f64.powi(-22) * (corner.abs() + (corner + shift).abs()) + world;
        let (min, max) = (local.min.as_dvec3(), local.max.as_dvec3());
        Box3 { min: (min + shift - slack(min)).as_vec3(), max: (max + shift + slack(max)).as_vec3() }
    }
}

fn brick_start(points: usize, bricks: usize, brick: usize) -> usize {
    (points as u64 * brick as u64 / bricks as u64) as usize
}

/// All finite points in tiles, ready for searches.
pub struct Tiles<'a> {
    points: &'a Points<'a>,
    /// The indices of the points, tile by tile and brick by brick.
    order: Vec<u32>,
    tiles: Vec<Tile>,
}

impl<'a> Tiles<'a> {
    /// Builds the tiles; `None` when cancelled.
    pub fn new(points: &'a Points<'a>, progress: &Progress) -> Option<Self> {
        let planes = Planes::new(points);
        let (order, ends) = sort_into_cells(points, &planes, progress)?;
        let mut order = order;
        let mut rest = order.as_mut_slice();
        let mut slices = Vec::with_capacity(ends.len());
        let mut start = 0;
        for &end in &ends {
            let (slice, others) = rest.split_at_mut(end - start);
            slices.push((start..end, slice));
            (rest, start) = (others, end);
        }
        let tiles = slices
            .into_par_iter()
            .zip(planes.cells.par_iter().zip(&planes.middles))
            .map(|((range, slice), (&cell, &origin))| {
                let places = if progress.is_cancelled() { Places::default() } else { arrange(points, slice, origin) };
                Tile { origin, cell, range, places }
            })
            .collect();
        (!progress.is_cancelled()).then_some(Self { points, order, tiles })
    }

    pub fn len(&self) -> usize {
        self.tiles.len()
    }

    /// The number of finite points of a tile.
    pub fn points_of(&self, tile: usize) -> usize {
        self.tiles[tile].range.len()
    }

    /// Calls `visit` with each point of a tile and its surroundings; for each it searches `count` others
    /// (`1 ..= LANES`).
    pub fn search<const LANES: usize>(
        &self,
        tile: usize,
        count: usize,
        mut visit: impl FnMut(u32, &mut Surroundings<'_, '_, LANES>),
        progress: &Progress,
    ) {
        let Tile { range, places, .. } = &self.tiles[tile];
        if places.count == 0 {
            return;
        }
        let (firsts, others) = self.order[range.clone()].split_at(places.count);
        let mut others = places.of_others.iter().zip(others).peekable();
        let mut search = Search::<LANES>::new(self, tile, count, false);
        for brick in 0..self.tiles[tile].bricks() {
            if progress.is_cancelled() {
                return;
            }
            for place in self.tiles[tile].brick(brick) {
                search.run(brick, place);
                visit(firsts[place], &mut Surroundings { search: &mut search, brick, place });
                while let Some((_, other)) = others.next_if(|(of, _)| **of as usize == place) {
                    search.run(brick, place);
                    visit(*other, &mut Surroundings { search: &mut search, brick, place });
                }
            }
        }
    }

    /// Calls `visit` with the number and the surroundings of each point `wanted` of a tile, which are in the order of
    /// `search`. No neighbours are searched.
    pub fn search_some(
        &self,
        tile: usize,
        wanted: &[u32],
        mut visit: impl FnMut(usize, &mut Surroundings<'_, '_, 1>),
        progress: &Progress,
    ) {
        let Tile { range, places, .. } = &self.tiles[tile];
        if wanted.is_empty() {
            return;
        }
        let (firsts, others) = self.order[range.clone()].split_at(places.count);
        let mut others = places.of_others.iter().zip(others).peekable();
        let mut wanted = wanted.iter().enumerate().peekable();
        let mut search = Search::<1>::new(self, tile, 1, true);
        for brick in 0..self.tiles[tile].bricks() {
            if progress.is_cancelled() {
                return;
            }
            for place in self.tiles[tile].brick(brick) {
                let mut visit_if_wanted = |index: u32| {
                    if let Some((number, _)) = wanted.next_if(|(_, next)| **next == index) {
                        visit(number, &mut Surroundings { search: &mut search, brick, place });
                    }
                };
                visit_if_wanted(firsts[place]);
                while let Some((_, other)) = others.next_if(|(of, _)| **of as usize == place) {
                    visit_if_wanted(*other);
                }
            }
        }
    }
}

/// A point of a tile, whose neighbours can be searched.
pub struct Surroundings<'a, 'b, const LANES: usize> {
    search: &'a mut Search<'b, LANES>,
    brick: usize,
    place: usize,
}

impl<const LANES: usize> Surroundings<'_, '_, LANES> {
    /// The neighbours that were searched last.
    pub fn neighbourhood(&self) -> &Neighbourhood {
        &self.search.neighbourhood
    }

    /// The brick of the point in its tile.
    pub fn brick(&self) -> usize {
        self.brick
    }

    /// The number of places no further than `radius` that are more than `layer` beside the plane with this unit normal
    /// through the point, to about a brick's; no more are counted than `most` and a node's.
    pub fn count_beside(&mut self, radius: f32, normal: Vec3, layer: f32, most: usize) -> usize {
        let middle = self.search.place(self.brick, self.place);
        self.search.count_beside(&Ball { middle, radius_squared: radius * radius, normal, layer }, most)
    }

    /// Searches the nearest points aside from the line along the unit vector `axis` through the point, by more than 30
    /// degrees, no farther than `reach`, on the side to which `side` points (on all sides if it is zero).
    pub fn search_aside(&mut self, axis: Vec3, side: Vec3, reach: f32) -> &Neighbourhood {
        self.search.run_aside(self.brick, self.place, &Aside { axis, side }, reach)
    }
}

/// The indices of the finite points cell by cell, in rising order within each, and the end of each cell.
fn sort_into_cells(points: &Points, planes: &Planes, progress: &Progress) -> Option<(Vec<u32>, Vec<usize>)> {
    // A counting sort in parallel: every group of chunks counts its points per cell, then knows where its own go.
    let per_group = points.chunks.len().div_ceil(4 * rayon::current_num_threads()).max(1);
    let chunks: Vec<usize> = (0..points.chunks.len()).collect();
    let groups: Vec<&[usize]> = chunks.chunks(per_group).collect();
    let mut cursors: Vec<Vec<u32>> = groups
        .par_iter()
        .map(|group| {
            let mut counts = vec![0; 1 << planes.depth];
            for_each_cell(points, planes, group, progress, |_, cell| counts[cell] += 1);
            counts
        })
        .collect();
    let mut ends = Vec::with_capacity(1 << planes.depth);
    let mut total = 0;
    for cell in 0..1 << planes.depth {
        for cursor in &mut cursors {
            let count = std::mem::replace(&mut cursor[cell], total);
            total += count;
        }
        ends.push(total as usize);
    }
    if progress.is_cancelled() {
        return None;
    }
    // Every slot is written once; atomics let several threads do so without unsafe code.
    let order: Vec<AtomicU32> = (0..total).map(|_| AtomicU32::new(0)).collect();
    groups.par_iter().zip(&mut cursors).for_each(|(group, cursor)| {
        for_each_cell(points, planes, group, progress, |index, cell| {
            order[cursor[cell] as usize].store(index, atomic::Ordering::Relaxed);
            cursor[cell] += 1;
        });
    });
    (!progress.is_cancelled()).then(|| (order.into_iter().map(AtomicU32::into_inner).collect(), ends))
}

/// Calls `each` with the index and the cell of each finite point of some chunks.
fn for_each_cell(
    points: &Points,
    planes: &Planes,
    chunks: &[usize],
    progress: &Progress,
    mut each: impl FnMut(u32, usize),
) {
    for &chunk in chunks {
        if progress.is_cancelled() {
            return;
        }
        for local in 0..points.chunks[chunk].len() {
            let position = points.chunks[chunk].position(local);
            if position.is_finite() {
                each(points.starts[chunk] + local as u32, planes.cell_of(position));
            }
        }
    }
}

/// Sorts a tile's indices: one of each place into bricks, then the others in the order of their places.
fn arrange(points: &Points, order: &mut [u32], origin: DVec3) -> Places {
    if order.is_empty() {
        return Places::default();
    }
    let local = |index: u32| (points.position(index) - origin).as_vec3();
    let firsts = firsts_of_places(points, order, local);
    let (firsts, others): (Vec<_>, Vec<_>) =
        order.iter().copied().zip(firsts).partition(|(index, first)| index == first);
    let mut located: Vec<(Vec3, u32)> = firsts.into_iter().map(|(index, _)| (local(index), index)).collect();
    let count = located.len();
    let bricks = count.div_ceil(BRICK_POINTS).next_power_of_two();
    let mut boxes = vec![Box3::of(&[]); 2 * bricks];
    halve(&mut located, count, 1, 0..bricks, &mut boxes);
    for (slot, (_, index)) in order.iter_mut().zip(&located) {
        *slot = *index;
    }
    if others.is_empty() {
        return Places { count, boxes, of_others: Vec::new() };
    }
    let place_of: HashMap<u32, u32> = located.iter().zip(0..).map(|((_, first), place)| (*first, place)).collect();
    let mut others: Vec<(u32, u32)> = others.into_iter().map(|(index, first)| (place_of[&first], index)).collect();
    others.sort_unstable();
    for (slot, (_, index)) in order[count..].iter_mut().zip(&others) {
        *slot = *index;
    }
    Places { count, boxes, of_others: others.into_iter().map(|(place, _)| place).collect() }
}

/// For each point the first of those at its place. Points nearer to one another than four steps of the offsets in their
/// chunks are at one place: a point that a file has twice may differ by that much in another chunk.
fn firsts_of_places(points: &Points, order: &[u32], local: impl Fn(u32) -> Vec3) -> Vec<u32> {
    let step = points.usual_reach(order).log2().ceil().exp2() * 2.0_f64.powi(-22);
    let place = |index: u32| {
        let local = local(index).as_dvec3();
        hash_of(if step > 0.0 { (local / step).round() } else { local })
    };
    let mut places: Vec<(u64, u32)> = order.iter().zip(0..).map(|(&index, at)| (place(index), at)).collect();
    places.sort_unstable();
    let mut firsts = order.to_vec();
    for same in places.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
        let least =
            |a: &&(u64, u32), b: &&(u64, u32)| by_place(&local(order[a.1 as usize]), &local(order[b.1 as usize]));
        let Some(first) = same.iter().min_by(least).map(|(_, at)| order[*at as usize]) else { continue };
        same.iter().for_each(|(_, at)| firsts[*at as usize] = first);
    }
    firsts
}

/// The order of places by their coordinates.
fn by_place(a: &Vec3, b: &Vec3) -> Ordering {
    total_order(a.as_dvec3().to_array(), b.as_dvec3().to_array())
}

/// Splits the points of a node, which are to fill the bricks `covered`, at the median of the longest side of their box.
fn halve(located: &mut [(Vec3, u32)], total: usize, node: usize, covered: Range<usize>, boxes: &mut [Box3]) {
    boxes[node] = Box3::of(located);
    if covered.len() == 1 {
        located.sort_unstable_by(|a, b| by_place(&a.0, &b.0));
        return;
    }
    let bricks = boxes.len() / 2;
    let axis = boxes[node].longest_axis();
    let middle = covered.start + covered.len() / 2;
    let split = brick_start(total, bricks, middle) - brick_start(total, bricks, covered.start);
    if split < located.len() {
        let order =
            |a: &(Vec3, u32), b: &(Vec3, u32)| a.0[axis].total_cmp(&b.0[axis]).then_with(|| by_place(&a.0, &b.0));
        located.select_nth_unstable_by(split, order);
    }
    let (left, right) = located.split_at_mut(split);
    halve(left, total, 2 * node, covered.start..middle, boxes);
    halve(right, total, 2 * node + 1, middle..covered.end, boxes);
}
