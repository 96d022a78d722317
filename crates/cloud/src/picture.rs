//! What a scanner saw from its place: points by their directions, in the cells of six pictures that are the sides of a
//! cube about it.

use glam::{DVec3, IVec2, Mat4, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::Chunk;
use crate::neighbours::Points;

/// How far around a direction one may look, in the width that cells were asked to have.
pub(crate) const REACH: f32 = 8.0;
/// The most cells along half a side of the cube.
const MOST_ALONG: f32 = 65_536.0;
/// So many cells for each point and more are mostly empty: then they become wider.
const MOST_CELLS: usize = 4;
/// The most that sides go on beyond the edges of the cube, as a share of half a side. They have what belongs to the
/// next side there, so that what is around a direction is all on the side that it belongs to.
const WIDEST_RIM: f32 = 0.25;
/// The most points that are looked at around a direction, in which there may be any number.
const MOST_SEEN: usize = 1 << 14;
/// A tangent t is at t (a - b |t|) of half a side: about its angle's share of an eighth of a turn, so that cells are as
/// wide all over a side as seen from the place.
const BENT: [f32; 2] = [1.273, 0.273];
/// The most that an angle in radians is stretched by that, and towards the corners of a cube.
const MOST_STRETCHED: f32 = 1.85;

/// A point as seen from a place, in the coordinates of a side of the cube (`Side::turned`).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// The way to it is this and 1 along the side's axis, divided by `inverse`.
    pub tangent: Vec2,
    /// One over the distance along the axis.
    pub inverse: f32,
    /// The running index of the point, or `BEYOND`.
    index: u32,
}

/// In place of the index of a point that belongs to the next side: clouds are estimated in parts of fewer points.
const BEYOND: u32 = u32::MAX;

impl Seen {
    /// No point: a lane without one is near to nothing, and hides nothing.
    const NONE: Self = Self { tangent: Vec2::NAN, inverse: f32::NAN, index: BEYOND };

    /// The running index of the point, if it belongs to this side and is not beyond an edge.
    pub fn own_index(&self) -> Option<u32> {
        (self.index != BEYOND).then_some(self.index)
    }

    fn lanes(&self) -> Vec4 {
        Vec4::new(self.tangent.x, self.tangent.y, self.inverse, f32::from_bits(self.index))
    }
}

/// The tangents and inverses of four points. Those of lanes without a point are not a number.
pub(crate) struct Four {
    pub x: Vec4,
    pub y: Vec4,
    pub inverse: Vec4,
}

impl Four {
    /// The first `count` of these points, or all.
    fn first([a, b, c, d]: &[Seen; 4], count: usize) -> Self {
        let lanes = Mat4::from_cols(a.lanes(), b.lanes(), c.lanes(), d.lanes()).transpose();
        let is_there = Vec4::new(0.0, 1.0, 2.0, 3.0).cmplt(Vec4::splat(count as f32));
        Self { x: Vec4::select(is_there, lanes.x_axis, Vec4::NAN), y: lanes.y_axis, inverse: lanes.z_axis }
    }
}

/// A side of the cube.
pub(crate) struct Side {
    axis: usize,
    sign: f32,
    /// The first column and row in which there are points, and the numbers of both.
    low: IVec2,
    size: IVec2,
    /// The number of cells along half a side.
    half: f32,
    rim: f32,
    /// By their cells, and three times none.
    points: Vec<Seen>,
    /// For each cell its first point, row by row, and then their number.
    starts: Vec<u32>,
}

/// The points that were seen from a place, on the sides of a cube.
pub(crate) struct Picture {
    pub place: DVec3,
    pub sides: Vec<Side>,
}

impl Picture {
    /// What was seen from a place of the chunks that `is_seen` names, with cells about `width` wide, in radians.
    pub(crate) fn new(points: &Points, place: DVec3, width: f32, is_seen: impl Fn(usize) -> bool + Sync) -> Self {
        let mut sides: Vec<(Side, Vec<Vec<Seen>>)> = (0..6).map(|side| (Side::new(side, width), Vec::new())).collect();
        let chunks = points.chunks().par_iter().enumerate().filter(|(number, _)| is_seen(*number));
        let of_chunk = |(number, chunk)| seen_of(&sides, chunk, points.first_of(number), place);
        let seen: Vec<[Vec<Seen>; 6]> = chunks.map(of_chunk).collect();
        for of_chunk in seen {
            sides.iter_mut().zip(of_chunk).for_each(|((_, seen), of_side)| seen.push(of_side));
        }
        let filled = |(mut side, seen): (Side, Vec<Vec<Seen>>)| {
            side.fill(seen);
            side
        };
        Self { place, sides: sides.into_par_iter().map(filled).collect() }
    }

    /// The side that a direction goes through.
    pub(crate) fn side(&self, way: Vec3) -> &Side {
        &self.sides[side_of(way)]
    }
}

fn side_of(way: Vec3) -> usize {
    let axis = way.abs().max_position();
    2 * axis + usize::from(way[axis] < 0.0)
}

/// The points of a chunk, whose first one has this running index, by the sides on which they are seen from a place.
fn seen_of(sides: &[(Side, Vec<Vec<Seen>>)], chunk: &Chunk, first: u32, place: DVec3) -> [Vec<Seen>; 6] {
    let mut seen: [Vec<Seen>; 6] = Default::default();
    for local in 0..chunk.len() {
        let way = (chunk.position(local) - place).as_vec3();
        if !way.is_finite() {
            continue;
        }
        let own = side_of(way);
        let reach = way.abs() * sides[0].0.widest();
        for axis in (0..3).filter(|axis| *axis == own / 2 || reach[*axis] > way[own / 2].abs()) {
            let number = 2 * axis + usize::from(way[axis] < 0.0);
            let side = &sides[number].0;
            let index = if number == own { first + local as u32 } else { BEYOND };
            seen[number].extend(side.seen(way, index));
        }
    }
    seen
}

fn bent(tangent: Vec2) -> Vec2 {
    tangent * (BENT[0] - BENT[1] * tangent.abs())
}

/// The largest whole numbers that are not larger. `f32::floor` is a call where processors may be old ones.
fn floor(values: Vec2) -> IVec2 {
    let towards_zero = values.as_ivec2();
    let back = towards_zero.as_vec2().cmpgt(values);
    towards_zero - IVec2::new(i32::from(back.x), i32::from(back.y))
}

impl Side {
    fn new(side: usize, width: f32) -> Self {
        Self {
            axis: side / 2,
            sign: if side.is_multiple_of(2) { 1.0 } else { -1.0 },
            low: IVec2::ZERO,
            size: IVec2::ZERO,
            half: (std::f32::consts::FRAC_PI_4 / width).clamp(1.0, MOST_ALONG),
            rim: (REACH * width * MOST_STRETCHED).min(WIDEST_RIM),
            points: Vec::new(),
            starts: Vec::new(),
        }
    }

    /// A vector of the world in the coordinates of this side: its axis comes last.
    pub(crate) fn turned(&self, way: Vec3) -> Vec3 {
        let [x, y, z] = way.to_array();
        match self.axis {
            0 => Vec3::new(y, z, self.sign * x),
            1 => Vec3::new(z, x, self.sign * y),
            _ => Vec3::new(x, y, self.sign * z),
        }
    }

    /// A vector in the coordinates of this side as one of the world.
    pub(crate) fn turned_back(&self, way: Vec3) -> Vec3 {
        let Vec3 { x, y, z } = way;
        match self.axis {
            0 => Vec3::new(self.sign * z, x, y),
            1 => Vec3::new(y, self.sign * z, x),
            _ => Vec3::new(x, y, self.sign * z),
        }
    }

    /// What is seen on the side, rim included, has no larger tangent.
    fn widest(&self) -> f32 {
        1.001 + 2.0 * self.rim
    }

    /// A point as seen on this side, if it is.
    fn seen(&self, way: Vec3, index: u32) -> Option<Seen> {
        let turned = self.turned(way);
        let inverse = turned.z.recip();
        let tangent = turned.truncate() * inverse;
        let is_within = bent(tangent).abs().max_element() < 1.0 + self.rim && inverse.is_finite();
        (turned.z > 0.0 && is_within).then_some(Seen { tangent, inverse, index })
    }

    /// The points of the side that belong to it.
    pub(crate) fn own_points(&self) -> impl ParallelIterator<Item = (u32, &Seen)> {
        self.points.par_iter().filter_map(|seen| Some((seen.own_index()?, seen)))
    }

    fn fill(&mut self, lists: Vec<Vec<Seen>>) {
        let count = lists.iter().map(Vec::len).sum();
        if count == 0 {
            return;
        }
        let cells = self.frame(&lists, count);
        // Sorted by counting. Points of a cell follow by their places, so that the order does not depend on that of the
        // chunks.
        let mut starts = vec![0; cells + 1];
        lists.iter().flatten().for_each(|seen| starts[self.cell(seen.tangent)] += 1);
        let mut total = 0;
        for start in &mut starts {
            total += std::mem::replace(start, total);
        }
        self.points = vec![Seen::NONE; count + 3];
        for seen in lists.into_iter().flatten() {
            let place = &mut starts[self.cell(seen.tangent)];
            self.points[*place as usize] = seen;
            *place += 1;
        }
        // Each is the end of its cell now, which is the start of the next one.
        starts.copy_within(..cells, 1);
        starts[0] = 0;
        self.starts = starts;
        let bits = |seen: &Seen| (seen.inverse.to_bits(), seen.tangent.to_array().map(f32::to_bits));
        let mut rest = &mut self.points[..];
        for ends in self.starts.windows(2) {
            let (own, others) = std::mem::take(&mut rest).split_at_mut((ends[1] - ends[0]) as usize);
            if own.len() > 1 {
                own.sort_unstable_by_key(bits);
            }
            rest = others;
        }
    }

    /// Finds the rectangle of cells in which there are points, and the number of its cells. Cells become twice as wide
    /// as often as it takes until there are not many more of them than points.
    fn frame(&mut self, lists: &[Vec<Seen>], count: usize) -> usize {
        let bent = lists.iter().flatten().map(|seen| bent(seen.tangent));
        let (least, most) =
            bent.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(least, most), bent| (least.min(bent), most.max(bent)));
        loop {
            self.low = floor(least * self.half);
            self.size = floor(most * self.half) - self.low + 1;
            let cells = self.size.x as usize * self.size.y as usize;
            if cells <= MOST_CELLS * count + (1 << 16) {
                return cells;
            }
            self.half /= 2.0;
        }
    }

    fn cell(&self, tangent: Vec2) -> usize {
        let place = floor(bent(tangent) * self.half) - self.low;
        place.y as usize * self.size.x as usize + place.x as usize
    }

    /// Visits the points whose directions differ from that of a tangent by less than an angle in radians, which is at
    /// most `REACH` cells and the rim, and some around them, row by row. No more than `MOST_SEEN`: the last rows are
    /// left out.
    pub(crate) fn visit_around(&self, tangent: Vec2, angle: f32, mut visit: impl FnMut(Four)) {
        let slope = BENT[0] - 2.0 * BENT[1] * tangent.abs();
        let squares = tangent * tangent;
        let stretch = slope * ((squares + 1.0) * (1.0 + squares.element_sum())).map(f32::sqrt);
        let reach = (stretch * angle * (1.0 + angle)).min(Vec2::splat(self.rim)) * self.half;
        let middle = bent(tangent) * self.half;
        let from = (floor(middle - reach) - self.low).max(IVec2::ZERO);
        let to = (floor(middle + reach) - self.low).min(self.size - 1);
        if from.x > to.x {
            return;
        }
        let mut left = MOST_SEEN;
        for row in from.y..=to.y {
            let first = row as usize * self.size.x as usize;
            let mut start = self.starts[first + from.x as usize] as usize;
            let end = (self.starts[first + to.x as usize + 1] as usize).min(start + left);
            left -= end - start;
            while start < end {
                if let Some(points) = self.points[start..].first_chunk() {
                    visit(Four::first(points, end - start));
                }
                start += 4;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is seen of places from the origin, in cells about `width` wide.
    fn picture(places: &[Vec3], width: f32) -> Picture {
        let chunk = Chunk::new(0, DVec3::ZERO, places.iter().map(|place| place.to_array()).collect());
        Picture::new(&Points::new(&[chunk]), DVec3::ZERO, width, |_| true)
    }

    /// The places that are found around a direction.
    fn around(picture: &Picture, way: Vec3, angle: f32) -> Vec<Vec3> {
        let side = picture.side(way);
        let turned = side.turned(way);
        let mut found = Vec::new();
        side.visit_around(turned.truncate() / turned.z, angle, |Four { x, y, inverse }| {
            let of_lane = |lane: usize| side.turned_back(Vec3::new(x[lane], y[lane], 1.0) / inverse[lane]);
            found.extend((0..4).filter(|lane| !x[*lane].is_nan()).map(of_lane));
        });
        found
    }

    #[test]
    fn all_points_within_an_angle_are_around_a_direction_wherever_it_is_on_the_cube() {
        let mut random = crate::Random(4);
        let mut any = || random.below(2001) as f32 / 1000.0 - 1.0;
        let places: Vec<Vec3> =
            (0..40_000).map(|_| Vec3::new(any(), any(), any()).normalize_or(Vec3::X) * (2.0 + any())).collect();
        let width = 0.01;
        let picture = picture(&places, width);
        let own: usize = picture.sides.iter().map(|side| side.own_points().count()).sum();
        assert_eq!(own, places.len(), "each point belongs to one side");
        let corner = Vec3::new(1.0, -1.0, 0.999);
        for way in [Vec3::X, Vec3::new(0.3, -0.2, -1.0), Vec3::new(1.0, 0.01, 0.999), corner, -corner] {
            for angle in [0.5 * width, 3.0 * width, REACH * width] {
                let found = around(&picture, way, angle);
                let expected: Vec<&Vec3> = places.iter().filter(|place| place.angle_between(way) < angle).collect();
                let is_found = |place: &&Vec3| found.iter().any(|found| found.distance(**place) < 1e-5);
                assert!(expected.iter().all(is_found), "{way} {angle}");
                let most = 3 * expected.len() + 20;
                assert!(found.len() <= most, "{way} {angle}: {} for {}", found.len(), expected.len());
            }
        }
    }

    #[test]
    fn a_side_turns_ways_there_and_back() {
        let way = Vec3::new(0.5, -2.0, 3.0);
        for side in picture(&[Vec3::X], 0.1).sides {
            assert_eq!(side.turned_back(side.turned(way)), way);
            assert_eq!(side.turned(side.sign * Vec3::AXES[side.axis]), Vec3::Z);
        }
    }

    #[test]
    fn few_points_are_looked_at_where_many_lie_in_one_direction_and_empty_cells_are_few() {
        let line: Vec<Vec3> = (0..MOST_SEEN * 3).map(|index| Vec3::Z * (1.0 + index as f32 * 1e-4)).collect();
        let picture_of_line = picture(&line, 0.01);
        assert_eq!(around(&picture_of_line, Vec3::Z, 0.04).len(), MOST_SEEN);
        assert_eq!(around(&picture_of_line, Vec3::X, 0.04).len(), 0);
        let none = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].map(|none| Vec3::new(none, 0.0, 1.0));
        let none = [none, none.map(|place| Vec3::new(0.0, 1.0, place.x))].concat();
        assert!(picture(&none, 0.01).sides.iter().all(|side| side.points.is_empty()), "places that are no numbers");
        let apart = picture(&[Vec3::new(-0.9, -0.9, 1.0), Vec3::new(0.9, 0.9, 1.0)], 1e-5);
        assert!(apart.sides.iter().all(|side| side.starts.len() < 1 << 17));
    }
}
