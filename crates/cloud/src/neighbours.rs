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

use std::collections::HashMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

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

    /// The chunk of point `index`, and its index there.
    pub fn locate(&self, index: u32) -> (usize, usize) {
        let chunk = self.starts.partition_point(|&start| start <= index) - 1;
        (chunk, (index - self.starts[chunk]) as usize)
    }

    fn position(&self, index: u32) -> DVec3 {
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
        let wanted = (tiles * SAMPLE_PER_TILE).min(points.len());
        let mut sample: Vec<DVec3> = (0..wanted as u64)
            .map(|i| points.position((i * points.len() as u64 / wanted as u64) as u32))
            .filter(|position| position.is_finite())
            .collect();
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

    /// The number of places no further than `radius`, to about a brick's; no more are counted than `most` and a node's.
    pub fn count_within(&mut self, radius: f32, most: usize) -> usize {
        let point = self.search.place(self.brick, self.place);
        self.search.count_within(point, radius * radius, most)
    }

    /// Searches the nearest points aside from the line along the unit vector `axis` through the point, by more than 30
    /// degrees.
    pub fn search_aside(&mut self, axis: Vec3) -> &Neighbourhood {
        self.search.run_aside(self.brick, self.place, axis)
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
            order[cursor[cell] as usize].store(index, Ordering::Relaxed);
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
        let cell = if step > 0.0 { (local / step).round() } else { local };
        // Adding zero makes the two zeros equal.
        (cell + DVec3::ZERO).to_array().into_iter().fold(0, |mixed, value| hash(mixed ^ value.to_bits()))
    };
    let mut places: Vec<(u64, u32)> = order.iter().zip(0..).map(|(&index, at)| (place(index), at)).collect();
    places.sort_unstable();
    let mut firsts = order.to_vec();
    for same in places.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
        let first = order[same[0].1 as usize];
        same.iter().for_each(|(_, at)| firsts[*at as usize] = first);
    }
    firsts
}

/// Splits the points of a node, which are to fill the bricks `covered`, at the median of the longest side of their box.
fn halve(located: &mut [(Vec3, u32)], total: usize, node: usize, covered: Range<usize>, boxes: &mut [Box3]) {
    boxes[node] = Box3::of(located);
    if covered.len() == 1 {
        return;
    }
    let bricks = boxes.len() / 2;
    let axis = boxes[node].longest_axis();
    let middle = covered.start + covered.len() / 2;
    let split = brick_start(total, bricks, middle) - brick_start(total, bricks, covered.start);
    if split < located.len() {
        located.select_nth_unstable_by(split, |a, b| a.0[axis].total_cmp(&b.0[axis]));
    }
    let (left, right) = located.split_at_mut(split);
    halve(left, total, 2 * node, covered.start..middle, boxes);
    halve(right, total, 2 * node + 1, middle..covered.end, boxes);
}

/// The neighbours of one point: as many as were asked for, all others at the distance of the last of them (so that ties
/// do not depend on the order of the points), and fewer only if the cloud has no more. Several points at one place
/// count as one: a cloud that stores every point many times gives the same neighbours as one that stores it once.
pub struct Neighbourhood {
    /// Candidates beyond `distance_squared` are not neighbours.
    candidates: Vec<Candidate>,
    /// The squared distance of the last neighbour asked for.
    pub distance_squared: f32,
    /// The number of neighbours asked for, or of all there are.
    pub count: usize,
}

/// A point that may be a neighbour.
struct Candidate {
    /// The offset from the point whose neighbours are searched.
    offset: Vec3,
    distance_squared: f32,
    /// The running index of the point (`Points`).
    index: u32,
}

impl Neighbourhood {
    fn new(distance_squared: f32) -> Self {
        Self { candidates: Vec::new(), distance_squared, count: 0 }
    }

    fn neighbours(&self) -> impl Iterator<Item = &Candidate> {
        self.candidates.iter().filter(|candidate| candidate.distance_squared <= self.distance_squared)
    }

    pub fn offsets(&self) -> impl Iterator<Item = Vec3> {
        self.neighbours().map(|candidate| candidate.offset)
    }

    /// The running indices of the neighbours (`Points`).
    pub fn indices(&self) -> impl Iterator<Item = u32> {
        self.neighbours().map(|candidate| candidate.index)
    }
}

/// Whether an offset leads aside from a line, by more than 30 degrees; `axis` is the unit direction of the line.
pub fn is_aside(offset: Vec3, axis: Vec3) -> bool {
    let along = offset.dot(axis);
    along * along < 0.75 * offset.length_squared()
}

/// The nearest distances so far.
struct Nearest<const LANES: usize> {
    /// The squared distances, ascending; infinite where none was found.
    distances: [f32; LANES],
    /// The squared distance beyond which points are ignored.
    bound: f32,
    count: usize,
}

impl<const LANES: usize> Nearest<LANES> {
    fn new(count: usize, bound: f32) -> Self {
        Self { distances: [f32::INFINITY; LANES], bound, count }
    }

    /// Considers some points of one brick; with an `axis`, those aside from the line along it.
    fn scan(&mut self, places: &Copies, at: Range<usize>, point: Vec3, axis: Option<Vec3>, found: &mut Vec<Candidate>) {
        let mut squared = [0.0; BRICK_POINTS];
        let (x, y, z) = (&places.x[at.clone()], &places.y[at.clone()], &places.z[at.clone()]);
        let length = x.len().min(BRICK_POINTS);
        let (x, y, z, indices) = (&x[..length], &y[..length], &z[..length], &places.indices[at]);
        for i in 0..length {
            let (dx, dy, dz) = (x[i] - point.x, y[i] - point.y, z[i] - point.z);
            squared[i] = dx * dx + dy * dy + dz * dz;
        }
        for i in 0..length {
            if squared[i] <= self.bound && squared[i] > 0.0 {
                let offset = Vec3::new(x[i], y[i], z[i]) - point;
                if axis.is_none_or(|axis| is_aside(offset, axis)) {
                    found.push(Candidate { offset, distance_squared: squared[i], index: indices[i] });
                    self.insert(squared[i]);
                }
            }
        }
    }

    /// One step of an insertion sort without branches: every entry becomes the middle one of its left neighbour, itself
    /// and the new value. Compiles to a few vector minima and maxima.
    fn insert(&mut self, value: f32) {
        let old = self.distances;
        let min = |a: f32, b: f32| if a < b { a } else { b };
        let max = |a: f32, b: f32| if a > b { a } else { b };
        self.distances[0] = min(old[0], value);
        for i in 1..LANES {
            self.distances[i] = max(old[i - 1], min(old[i], value));
        }
        self.bound = min(self.bound, self.distances[self.count - 1]);
    }
}

/// The inside of a tile as the tile being searched sees it.
struct View {
    tile: usize,
    boxes: Vec<Box3>,
    /// The start of each brick's points among the search's copies, or `ABSENT`.
    starts: Vec<u32>,
}

impl View {
    /// The number of the tile's places whose squared distance is within `limit`; bricks count by their middles.
    fn count_within(&self, tile: &Tile, point: Vec3, limit: f32, most: usize) -> usize {
        let bricks = self.starts.len();
        let (mut count, mut pending) = (0, vec![(1, 0..bricks)]);
        while let Some((node, covered)) = pending.pop() {
            let Box3 { min, max } = self.boxes[node];
            if count >= most || self.boxes[node].distance_squared(point) > limit {
                continue;
            }
            let farthest = (point - min).abs().max((max - point).abs()).length_squared();
            let middle = ((min + max) / 2.0).distance_squared(point);
            if farthest <= limit || node >= bricks && middle <= limit {
                count += tile.brick(covered.end - 1).end - tile.brick(covered.start).start;
            } else if node < bricks {
                let middle = covered.start + covered.len() / 2;
                pending.extend([(2 * node, covered.start..middle), (2 * node + 1, middle..covered.end)]);
            }
        }
        count
    }
}

/// A tile other than the one being searched.
struct Other {
    tile: usize,
    bounds: Box3,
    /// The squared distance from its bounds to those of the home tile.
    distance_squared: f32,
    /// The view of the tile, made when a search reaches it.
    view: Option<View>,
}

const ABSENT: u32 = u32::MAX;

/// Copies of points, relative to the origin of a tile.
#[derive(Default)]
struct Copies {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    /// The running indices of the points (`Points`).
    indices: Vec<u32>,
}

impl Copies {
    fn len(&self) -> usize {
        self.indices.len()
    }

    fn truncate(&mut self, length: usize) {
        [&mut self.x, &mut self.y, &mut self.z].into_iter().for_each(|values| values.truncate(length));
        self.indices.truncate(length);
    }

    /// Appends the points of some places of a tile, relative to `origin`.
    fn append(&mut self, tiles: &Tiles, tile: usize, range: Range<usize>, origin: DVec3) {
        let first = tiles.tiles[tile].range.start;
        for &index in &tiles.order[first + range.start..first + range.end] {
            let local = (tiles.points.position(index) - origin).as_vec3();
            self.x.push(local.x);
            self.y.push(local.y);
            self.z.push(local.z);
            self.indices.push(index);
        }
    }
}

/// Searches the neighbours of the points of one tile; for each at most `LANES`.
struct Search<'a, const LANES: usize> {
    tiles: &'a Tiles<'a>,
    home: usize,
    count: usize,
    /// The points of the home tile, unless few of them are searched, then those of the bricks that were reached.
    copies: Copies,
    /// The number of copies that stay.
    kept: usize,
    home_view: View,
    /// The home tile's cell in its own coordinates.
    cell: Box3,
    /// The other tiles, nearest first.
    others: Vec<Other>,
    /// The nodes that a visit has still to look into, with their squared distances.
    pending: Vec<(f32, usize)>,
    previous: Option<Vec3>,
    neighbourhood: Neighbourhood,
}

impl<'a, const LANES: usize> Search<'a, LANES> {
    /// A search about the points of a tile, about each or about `few`.
    fn new(tiles: &'a Tiles<'a>, home: usize, count: usize, few: bool) -> Self {
        let tile = &tiles.tiles[home];
        let mut others: Vec<Other> = (0..tiles.tiles.len())
            .filter(|&other| other != home && !tiles.tiles[other].places.boxes.is_empty())
            .map(|other| {
                let bounds = tiles.tiles[other].box_seen_from(tile, &tiles.tiles[other].places.boxes[1]);
                let apart =
                    (bounds.min - tile.places.boxes[1].max).max(tile.places.boxes[1].min - bounds.max).max(Vec3::ZERO);
                Other { tile: other, bounds, distance_squared: apart.length_squared(), view: None }
            })
            .collect();
        others.sort_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared));
        let start_of = |brick| if few { ABSENT } else { tile.brick(brick).start as u32 };
        let starts = (0..tile.bricks()).map(start_of).collect();
        let kept = if few { 0 } else { tile.places.count };
        let mut search = Self {
            tiles,
            home,
            count: count.clamp(1, LANES),
            copies: Copies::default(),
            kept,
            home_view: View { tile: home, boxes: tile.places.boxes.clone(), starts },
            cell: Box3 { min: (tile.cell.min - tile.origin).as_vec3(), max: (tile.cell.max - tile.origin).as_vec3() },
            others,
            pending: Vec::new(),
            previous: None,
            neighbourhood: Neighbourhood::new(f32::INFINITY),
        };
        search.copies.append(tiles, home, 0..kept, tile.origin);
        search
    }

    /// The neighbours of point `local` of `brick` of the home tile.
    fn run(&mut self, brick: usize, local: usize) -> &Neighbourhood {
        let point = self.place(brick, local);
        if !point.is_finite() {
            // The point is further from the rest of its tile than f32 reaches.
            self.neighbourhood = Neighbourhood::new(0.0);
            self.previous = None;
            return &self.neighbourhood;
        }
        let radius = self.neighbourhood.distance_squared.sqrt();
        match self.previous {
            // The point is so near to the previous one that f32 cannot square the distance: thousands of such points
            // cost one search.
            Some(previous) if previous.distance_squared(point) == 0.0 => return &self.neighbourhood,
            // The ball about this point that contains the ball about the previous one contains as many points, unless
            // some of them are at this very place; the margin is far above the rounding of an f32.
            Some(previous) => self.within((radius + previous.distance(point)).powi(2) * 1.000_01, brick, point, None),
            None => self.within(f32::MAX, brick, point, None),
        }
        if self.neighbourhood.count < self.count {
            self.within(f32::MAX, brick, point, None);
        }
        self.previous = Some(point);
        &self.neighbourhood
    }

    /// The nearest points aside from the line along the unit vector `axis` through a point of the home tile, by more
    /// than 30 degrees.
    fn run_aside(&mut self, brick: usize, local: usize, axis: Vec3) -> &Neighbourhood {
        self.previous = None;
        let point = self.place(brick, local);
        self.within(f32::MAX, brick, point, Some(axis));
        &self.neighbourhood
    }

    /// The position of point `local` of `brick` of the home tile.
    fn place(&mut self, brick: usize, local: usize) -> Vec3 {
        let home = &self.tiles.tiles[self.home];
        if self.home_view.starts[brick] == ABSENT {
            self.home_view.starts[brick] = self.copies.len() as u32;
            self.copies.append(self.tiles, self.home, home.brick(brick), home.origin);
        }
        let at = self.home_view.starts[brick] as usize + local - home.brick(brick).start;
        Vec3::new(self.copies.x[at], self.copies.y[at], self.copies.z[at])
    }

    /// The neighbours of a point no further than the square root of `bound`. Squared distances that overflow find none,
    /// so that a cloud of random numbers is not searched from end to end for each point.
    fn within(&mut self, bound: f32, brick: usize, point: Vec3, axis: Option<Vec3>) {
        self.neighbourhood.candidates.clear();
        let mut nearest = Nearest::<LANES>::new(self.count, bound.min(f32::MAX));
        // Goes up from the point's own brick and visits the subtree on the other side of each node.
        let mut node = brick + self.home_view.starts.len();
        self.visit(None, node, point, axis, &mut nearest);
        while node > 1 {
            if self.home_view.boxes[node ^ 1].distance_squared(point) <= nearest.bound {
                self.visit(None, node ^ 1, point, axis, &mut nearest);
            }
            node /= 2;
        }
        let to_border = (point - self.cell.min).min(self.cell.max - point).min_element();
        if to_border * to_border <= nearest.bound {
            for other in 0..self.others.len() {
                if self.others[other].distance_squared > nearest.bound {
                    break;
                }
                if self.others[other].bounds.distance_squared(point) <= nearest.bound {
                    self.reach(other);
                    self.visit(Some(other), 1, point, axis, &mut nearest);
                }
            }
        }
        let found = nearest.distances[..self.count].iter().filter(|distance| distance.is_finite()).count();
        self.neighbourhood.count = found;
        self.neighbourhood.distance_squared = if found > 0 { nearest.distances[found - 1] } else { 0.0 };
    }

    fn count_within(&mut self, point: Vec3, limit: f32, most: usize) -> usize {
        let mut count = self.home_view.count_within(&self.tiles.tiles[self.home], point, limit, most);
        for other in 0..self.others.len() {
            if count >= most || self.others[other].distance_squared > limit {
                break;
            }
            if self.others[other].bounds.distance_squared(point) <= limit {
                self.reach(other);
                if let Some(view) = &self.others[other].view {
                    count += view.count_within(&self.tiles.tiles[view.tile], point, limit, most - count);
                }
            }
        }
        count
    }

    /// Searches the subtree of a node of the home tile, or of one of the others.
    fn visit(
        &mut self,
        other: Option<usize>,
        root: usize,
        point: Vec3,
        axis: Option<Vec3>,
        nearest: &mut Nearest<LANES>,
    ) {
        let view = match other {
            None => Some(&mut self.home_view),
            Some(other) => self.others[other].view.as_mut(),
        };
        let Some(view) = view else { return };
        let bricks = view.starts.len();
        self.pending.clear();
        self.pending.push((view.boxes[root].distance_squared(point), root));
        while let Some((distance, node)) = self.pending.pop() {
            if distance > nearest.bound {
                continue;
            }
            if node < bricks {
                let (a, b) = (2 * node, 2 * node + 1);
                let near = (view.boxes[a].distance_squared(point), a);
                let far = (view.boxes[b].distance_squared(point), b);
                let (near, far) = if far.0 < near.0 { (far, near) } else { (near, far) };
                self.pending.extend([far, near]);
                continue;
            }
            let brick = node - bricks;
            let range = self.tiles.tiles[view.tile].brick(brick);
            if view.starts[brick] == ABSENT {
                view.starts[brick] = self.copies.len() as u32;
                self.copies.append(self.tiles, view.tile, range.clone(), self.tiles.tiles[self.home].origin);
            }
            let start = view.starts[brick] as usize;
            let at = start..start + range.len();
            nearest.scan(&self.copies, at, point, axis, &mut self.neighbourhood.candidates);
        }
    }

    /// Makes the view of another tile if there is none yet.
    fn reach(&mut self, other: usize) {
        let home = &self.tiles.tiles[self.home];
        // Stray points may reach far into the cloud; the copies that they cause must not accumulate.
        if self.copies.len() > 8 * TILE_POINTS.max(home.places.count) {
            self.copies.truncate(self.kept);
            if self.kept == 0 {
                self.home_view.starts.fill(ABSENT);
            }
            self.others.iter_mut().for_each(|other| other.view = None);
        }
        let Other { tile, view, .. } = &mut self.others[other];
        let there = &self.tiles.tiles[*tile];
        view.get_or_insert_with(|| View {
            tile: *tile,
            boxes: there.places.boxes.iter().map(|local| there.box_seen_from(home, local)).collect(),
            starts: vec![ABSENT; there.bricks()],
        });
    }
}
