//! The search of the neighbours of one point.

use std::ops::Range;

use glam::{DVec3, Vec3};

use super::{BRICK_POINTS, Box3, TILE_POINTS, Tile, Tiles, by_place};

/// The neighbours of one point: as many as were asked for, all others at the distance of the last of them (so that ties
/// do not depend on the order of the points), and fewer only if the cloud has no more. Several points at one place
/// count as one: a cloud that stores every point many times gives the same neighbours as one that stores it once.
pub struct Neighbourhood {
    /// During a search, some of them are beyond `distance_squared`.
    neighbours: Vec<Candidate>,
    /// The squared distance of the last neighbour asked for.
    pub distance_squared: f32,
    /// That of the fourth one, or of the last one if there are fewer.
    pub fourth_squared: f32,
    /// Whether all neighbours are points of the tile that is searched.
    pub is_in_tile: bool,
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
        Self { neighbours: Vec::new(), distance_squared, fourth_squared: distance_squared, is_in_tile: true, count: 0 }
    }

    pub fn offsets(&self) -> impl Iterator<Item = Vec3> + Clone {
        self.neighbours.iter().map(|candidate| candidate.offset)
    }

    /// The offset of the nearest neighbour; of equally near ones, the first by its coordinates.
    pub fn first(&self) -> Option<Vec3> {
        let (nearest, others) = self.neighbours.split_first()?;
        let is_before = |a: &Candidate, b: &Candidate| {
            a.distance_squared < b.distance_squared
                || a.distance_squared == b.distance_squared && by_place(&a.offset, &b.offset).is_lt()
        };
        Some(others.iter().fold(nearest, |first, other| if is_before(other, first) { other } else { first }).offset)
    }

    /// The offsets of the nearest `most` neighbours; equally near ones follow in the order of their coordinates.
    pub fn nearest(&self, most: usize) -> Vec<Vec3> {
        let mut all: Vec<&Candidate> = self.neighbours.iter().collect();
        if all.len() > most {
            let by_distance = |a: &&Candidate, b: &&Candidate| a.distance_squared.total_cmp(&b.distance_squared);
            all.sort_unstable_by(|a, b| by_distance(a, b).then_with(|| by_place(&a.offset, &b.offset)));
        }
        all.into_iter().take(most).map(|candidate| candidate.offset).collect()
    }

    /// The running indices of the neighbours (`Points`).
    pub fn indices(&self) -> impl Iterator<Item = u32> {
        self.neighbours.iter().map(|candidate| candidate.index)
    }
}

/// Whether an offset leads aside from a line, by more than 30 degrees; `axis` is the unit direction of the line.
#[inline]
pub fn is_aside(offset: Vec3, axis: Vec3) -> bool {
    let along = offset.dot(axis);
    along * along < 0.75 * offset.length_squared()
}

/// Where points lie aside from a line.
pub(super) struct Aside {
    /// The unit direction of the line.
    pub axis: Vec3,
    /// A direction to the side where they lie; zero for all sides.
    pub side: Vec3,
}

impl Aside {
    #[inline]
    fn holds(&self, offset: Vec3) -> bool {
        is_aside(offset, self.axis) && offset.dot(self.side) >= 0.0
    }
}

/// A ball without a layer about a plane through its middle.
pub(super) struct Ball {
    pub middle: Vec3,
    pub radius_squared: f32,
    /// The unit normal of the plane.
    pub normal: Vec3,
    /// Half of the layer's thickness.
    pub layer: f32,
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

    /// Considers some points of one brick; with an `aside`, those that it holds.
    fn scan(
        &mut self,
        places: &Copies,
        at: Range<usize>,
        point: Vec3,
        aside: Option<&Aside>,
        found: &mut Vec<Candidate>,
    ) {
        let mut squared = [0.0; BRICK_POINTS];
        let (x, y, z) = (&places.x[at.clone()], &places.y[at.clone()], &places.z[at.clone()]);
        let length = x.len().min(BRICK_POINTS);
        let (x, y, z, indices) = (&x[..length], &y[..length], &z[..length], &places.indices[at]);
        for i in 0..length {
            let (dx, dy, dz) = (x[i] - point.x, y[i] - point.y, z[i] - point.z);
            squared[i] = dx * dx + dy * dy + dz * dz;
        }
        // The near ones are listed without branches, which would be guessed wrong as often as not.
        let (mut near, mut count) = ([0; BRICK_POINTS], 0);
        for (i, squared) in squared[..length].iter().enumerate() {
            near[count % BRICK_POINTS] = i;
            count += usize::from((*squared <= self.bound) & (*squared > 0.0));
        }
        for &i in &near[..count] {
            if squared[i] <= self.bound {
                let offset = Vec3::new(x[i], y[i], z[i]) - point;
                if aside.is_none_or(|aside| aside.holds(offset)) {
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
    /// The number of the tile's places in a ball and outside of a layer; bricks count by their middles.
    fn count_beside(&self, tile: &Tile, ball: &Ball, most: usize) -> usize {
        let bricks = self.starts.len();
        let (mut count, mut pending) = (0, vec![(1, 0..bricks)]);
        while let Some((node, covered)) = pending.pop() {
            let Box3 { min, max } = self.boxes[node];
            if count >= most || self.boxes[node].distance_squared(ball.middle) > ball.radius_squared {
                continue;
            }
            let farthest = (ball.middle - min).abs().max((max - ball.middle).abs()).length_squared();
            let (middle, half) = ((min + max) / 2.0 - ball.middle, (max - min) / 2.0);
            let is_in =
                farthest <= ball.radius_squared || node >= bricks && middle.length_squared() <= ball.radius_squared;
            let reach = if node >= bricks { 0.0 } else { half.dot(ball.normal.abs()) };
            if is_in && middle.dot(ball.normal).abs() - reach > ball.layer {
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
pub(super) struct Search<'a, const LANES: usize> {
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
    pub(super) neighbourhood: Neighbourhood,
    /// The points aside from a line that were searched last.
    beside: Neighbourhood,
}

impl<'a, const LANES: usize> Search<'a, LANES> {
    /// A search about the points of a tile, about each or about `few`.
    pub(super) fn new(tiles: &'a Tiles<'a>, home: usize, count: usize, few: bool) -> Self {
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
            beside: Neighbourhood::new(f32::INFINITY),
        };
        search.copies.append(tiles, home, 0..kept, tile.origin);
        search
    }

    /// The neighbours of point `local` of `brick` of the home tile.
    pub(super) fn run(&mut self, brick: usize, local: usize) -> &Neighbourhood {
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

    /// The nearest points `aside` of a point of the home tile, no farther than `reach`; its neighbours stay.
    pub(super) fn run_aside(&mut self, brick: usize, local: usize, aside: &Aside, reach: f32) -> &Neighbourhood {
        let point = self.place(brick, local);
        std::mem::swap(&mut self.neighbourhood, &mut self.beside);
        self.within(reach * reach, brick, point, Some(aside));
        std::mem::swap(&mut self.neighbourhood, &mut self.beside);
        &self.beside
    }

    /// The position of point `local` of `brick` of the home tile.
    pub(super) fn place(&mut self, brick: usize, local: usize) -> Vec3 {
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
    fn within(&mut self, bound: f32, brick: usize, point: Vec3, aside: Option<&Aside>) {
        self.neighbourhood.neighbours.clear();
        let mut nearest = Nearest::<LANES>::new(self.count, bound.min(f32::MAX));
        // Goes up from the point's own brick and visits the subtree on the other side of each node.
        let mut node = brick + self.home_view.starts.len();
        self.visit(None, node, point, aside, &mut nearest);
        while node > 1 {
            if self.home_view.boxes[node ^ 1].distance_squared(point) <= nearest.bound {
                self.visit(None, node ^ 1, point, aside, &mut nearest);
            }
            node /= 2;
        }
        let in_tile = self.neighbourhood.neighbours.len();
        let to_border = (point - self.cell.min).min(self.cell.max - point).min_element();
        if to_border * to_border <= nearest.bound {
            for other in 0..self.others.len() {
                if self.others[other].distance_squared > nearest.bound {
                    break;
                }
                if self.others[other].bounds.distance_squared(point) <= nearest.bound {
                    self.reach(other);
                    self.visit(Some(other), 1, point, aside, &mut nearest);
                }
            }
        }
        let found = nearest.distances[..self.count].iter().filter(|distance| distance.is_finite()).count();
        let squared_of = |rank: usize| if rank > 0 { nearest.distances[rank - 1] } else { 0.0 };
        let (distance_squared, fourth_squared) = (squared_of(found), squared_of(found.min(4)));
        let Neighbourhood { neighbours, .. } = &mut self.neighbourhood;
        let is_in_tile = neighbours[in_tile..].iter().all(|other| other.distance_squared > distance_squared);
        neighbours.retain(|candidate| candidate.distance_squared <= distance_squared);
        let neighbours = std::mem::take(neighbours);
        self.neighbourhood = Neighbourhood { neighbours, distance_squared, fourth_squared, is_in_tile, count: found };
    }

    pub(super) fn count_beside(&mut self, ball: &Ball, most: usize) -> usize {
        let mut count = self.home_view.count_beside(&self.tiles.tiles[self.home], ball, most);
        for other in 0..self.others.len() {
            if count >= most || self.others[other].distance_squared > ball.radius_squared {
                break;
            }
            if self.others[other].bounds.distance_squared(ball.middle) <= ball.radius_squared {
                self.reach(other);
                if let Some(view) = &self.others[other].view {
                    count += view.count_beside(&self.tiles.tiles[view.tile], ball, most - count);
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
        aside: Option<&Aside>,
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
            nearest.scan(&self.copies, at, point, aside, &mut self.neighbourhood.neighbours);
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
