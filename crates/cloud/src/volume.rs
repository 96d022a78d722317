//! Volumes that points lie in or not: boxes, ellipsoids, slabs and prisms, anywhere and turned in any way.
//!
//! A point is tested in f64; one on the border is inside. A box of points is wholly inside, wholly outside, or neither
//! is certain: within the rounding of f64 the answer is `Cover::Partly`, so a certain answer holds for every point.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::Bounds;

/// The rounding of f64 in the test of a point, relative to its coordinates, with room to spare.
const ROUNDING: f64 = 1e-12;

/// How much of a box of points a volume contains, or how many of the points in a box are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// All of it.
    Inside,
    /// Nothing of it.
    Outside,
    /// A part of it, as far as is known.
    Partly,
}

/// The shape of a volume in its own coordinates: relative to its position, along its own axes.
#[derive(Clone, Debug, PartialEq)]
pub enum VolumeShape {
    /// As long along each axis as its size says.
    Box,
    /// An ellipsoid whose three diameters are its size.
    Sphere,
    /// All that is within half of the third component of its size from the plane of the first two axes.
    Slab,
    /// All points that the lines through a polygon meet. The lines are parallel to `direction` and endless, or they are
    /// rays from `eye` in the directions that `direction` points to. The polygon is projected along the lines, and its
    /// size scales it. Where its outline crosses itself, a place is inside if an odd number of windings is around it.
    Prism { points: Vec<DVec3>, direction: DVec3, eye: Option<DVec3> },
}

/// A volume in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    shape: VolumeShape,
    position: DVec3,
    /// From the world's axes to its own.
    own_from_world: DMat3,
    /// `own_from_world` with the absolute values of its numbers, which gives the half of a turned box from that of a box.
    own_reach: DMat3,
    size: DVec3,
    lines: Lines,
    /// The outline of a prism, projected along its lines.
    outline: Vec<DVec2>,
}

/// The lines of a prism, in its own coordinates.
#[derive(Clone, Debug, PartialEq)]
struct Lines {
    along: DVec3,
    right: DVec3,
    up: DVec3,
    /// The place from which rays go, if the lines are rays.
    eye: Option<DVec3>,
}

impl Lines {
    fn new(direction: DVec3, eye: Option<DVec3>) -> Self {
        let along = direction.normalize_or(DVec3::Z);
        let (right, up) = along.any_orthonormal_pair();
        Self { along, right, up, eye }
    }

    /// How far a place is along the lines.
    fn depth(&self, place: DVec3) -> f64 {
        (place - self.eye.unwrap_or_default()).dot(self.along)
    }

    /// Where the line through a place meets the plane across the lines; `None` behind the eye of rays.
    fn project(&self, place: DVec3) -> Option<DVec2> {
        let offset = place - self.eye.unwrap_or_default();
        let at = DVec2::new(offset.dot(self.right), offset.dot(self.up));
        match self.eye {
            None => Some(at),
            Some(_) => Some(self.depth(place)).filter(|depth| *depth > 0.0).map(|depth| at / depth),
        }
    }
}

impl Volume {
    /// `rotation` turns the volume's own axes into the world's.
    pub fn new(shape: VolumeShape, position: DVec3, rotation: DQuat, size: DVec3) -> Self {
        let (lines, outline) = match &shape {
            VolumeShape::Prism { points, direction, eye } => {
                let lines = Lines::new(*direction, eye.map(|eye| eye * size));
                let outline = points.iter().filter_map(|point| lines.project(*point * size)).collect();
                (lines, outline)
            }
            VolumeShape::Box | VolumeShape::Sphere | VolumeShape::Slab => (Lines::new(DVec3::Z, None), Vec::new()),
        };
        let own_from_world = DMat3::from_quat(rotation.normalize()).transpose();
        let own_reach = absolute(own_from_world);
        Self { shape, position, own_from_world, own_reach, size, lines, outline }
    }

    /// Whether a point is in it or on its border; a point that is not finite is not.
    pub fn contains(&self, point: DVec3) -> bool {
        let own = self.own_from_world * (point - self.position);
        let half = self.size * 0.5;
        match &self.shape {
            VolumeShape::Box => own.abs().cmple(half).all(),
            VolumeShape::Sphere => (own / half).length_squared() <= 1.0,
            VolumeShape::Slab => own.z.abs() <= half.z && own.is_finite(),
            VolumeShape::Prism { .. } => self.lines.project(own).is_some_and(|at| is_in_polygon(&self.outline, at)),
        }
    }

    /// How much of a box it contains.
    pub fn cover(&self, bounds: Bounds) -> Cover {
        if bounds.is_empty() {
            return Cover::Outside;
        }
        let reach = bounds.min.abs().max(bounds.max.abs()).max_element() + self.position.abs().max_element();
        let rounding = (reach + self.size.max_element()) * ROUNDING;
        let own = self.own_from_world * (bounds.center() - self.position);
        // The half of the box around the turned one.
        let spread = self.own_reach * (bounds.size() * 0.5) + rounding;
        let half = self.size * 0.5;
        match &self.shape {
            VolumeShape::Box => {
                let world_half = self.own_reach.transpose() * half + bounds.size() * 0.5 + rounding;
                let is_apart = (own.abs() - spread).cmpgt(half).any()
                    || (bounds.center() - self.position).abs().cmpgt(world_half).any();
                cover_of((own.abs() + spread).cmple(half).all(), is_apart)
            }
            VolumeShape::Slab => cover_of(own.z.abs() + spread.z <= half.z, own.z.abs() - spread.z > half.z),
            VolumeShape::Sphere => {
                let farthest = ((own.abs() + spread) / half).length_squared();
                let nearest = ((own.abs() - spread).max(DVec3::ZERO) / half).length_squared();
                cover_of(farthest <= 1.0 - ROUNDING, nearest > 1.0 + ROUNDING)
            }
            VolumeShape::Prism { .. } => {
                let corners = bounds.corners().map(|corner| self.own_from_world * (corner - self.position));
                let at: Vec<DVec2> = corners.iter().filter_map(|corner| self.lines.project(*corner)).collect();
                if at.len() < corners.len() {
                    return cover_of(false, corners.iter().all(|corner| self.lines.depth(*corner) < -rounding));
                }
                let low = at.iter().fold(DVec2::INFINITY, |low, at| low.min(*at));
                let high = at.iter().fold(DVec2::NEG_INFINITY, |high, at| high.max(*at));
                // Rays that almost end at the eye magnify the rounding.
                let margin = (high - low + low.abs().max(high.abs())) * 1e-9 + rounding;
                let (low, high) = (low - margin, high + margin);
                let ends = self.outline.iter().zip(self.outline.iter().cycle().skip(1));
                if ends.into_iter().any(|(from, to)| may_cross(low, high, *from, *to)) {
                    return Cover::Partly;
                }
                let is_in = is_in_polygon(&self.outline, (low + high) * 0.5);
                cover_of(is_in, !is_in)
            }
        }
    }

    /// A box in the world that contains all of it; `None` if it is endless.
    pub fn bounds(&self) -> Option<Bounds> {
        match self.shape {
            VolumeShape::Box | VolumeShape::Sphere => {
                let reach = self.own_reach.transpose() * (self.size * 0.5);
                Some(Bounds { min: self.position - reach, max: self.position + reach })
            }
            VolumeShape::Slab | VolumeShape::Prism { .. } => None,
        }
    }
}

fn cover_of(is_inside: bool, is_outside: bool) -> Cover {
    match (is_inside, is_outside) {
        (true, _) => Cover::Inside,
        (_, true) => Cover::Outside,
        _ => Cover::Partly,
    }
}

fn absolute(matrix: DMat3) -> DMat3 {
    DMat3::from_cols(matrix.x_axis.abs(), matrix.y_axis.abs(), matrix.z_axis.abs())
}

/// Whether a place is in a closed polygon or on its outline.
fn is_in_polygon(outline: &[DVec2], at: DVec2) -> bool {
    let mut is_in = false;
    for (from, to) in outline.iter().zip(outline.iter().cycle().skip(1)) {
        let (edge, place) = (*to - *from, at - *from);
        let side = edge.perp_dot(place);
        let is_beside = |from: f64, to: f64, at: f64| from.min(to) <= at && at <= from.max(to);
        if side == 0.0 && is_beside(from.x, to.x, at.x) && is_beside(from.y, to.y, at.y) {
            return true;
        }
        // An end belongs to the edge above it, so that a line through a corner crosses the outline there once.
        if (from.y > at.y) != (to.y > at.y) && (side > 0.0) == (to.y > from.y) {
            is_in = !is_in;
        }
    }
    is_in
}

/// Whether an edge may touch a rectangle; never false where it does.
fn may_cross(low: DVec2, high: DVec2, from: DVec2, to: DVec2) -> bool {
    if from.max(to).cmplt(low).any() || from.min(to).cmpgt(high).any() {
        return false;
    }
    let edge = to - from;
    let corners = [low, high, DVec2::new(low.x, high.y), DVec2::new(high.x, low.y)];
    let sides = corners.map(|corner| edge.perp_dot(corner - from));
    !(sides.iter().all(|side| *side > 0.0) || sides.iter().all(|side| *side < 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    /// Even random numbers from 0 to 1.
    fn draws(seed: u64) -> impl FnMut() -> f64 {
        let mut number = 0;
        move || {
            number += 1;
            random::unit(seed, number)
        }
    }

    const TURN: DQuat = DQuat::from_xyzw(0.18, 0.36, 0.54, 0.74);

    fn prism(points: &[[f64; 3]], eye: Option<DVec3>) -> VolumeShape {
        VolumeShape::Prism { points: points.iter().copied().map(DVec3::from).collect(), direction: DVec3::Z, eye }
    }

    fn shapes() -> Vec<VolumeShape> {
        // An L, which is not convex.
        let l =
            [[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [-0.5, 0.5, 0.0]];
        let far = l.map(|[x, y, _]| [x, y, 1.0]);
        vec![
            VolumeShape::Box,
            VolumeShape::Sphere,
            VolumeShape::Slab,
            prism(&l, None),
            prism(&far, Some(DVec3::new(0.1, 0.0, -1.0))),
        ]
    }

    #[test]
    fn borders_are_inside_and_what_is_next_to_them_is_outside() {
        let (at, size) = (DVec3::new(635_000.0, 5_077_000.0, 120.0), DVec3::new(4.0, 2.0, 1.0));
        let of = |shape| Volume::new(shape, at, DQuat::IDENTITY, size);
        let beyond = |value: f64| value + 1e-9 * value.abs().max(1.0);
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let border = |reach: f64| at + DVec3::AXES[axis] * (sign * reach);
                let half = size[axis] * 0.5;
                for shape in [VolumeShape::Box, VolumeShape::Sphere] {
                    let volume = of(shape);
                    assert!(volume.contains(border(half)) && !volume.contains(border(beyond(half) + 1e-8)));
                }
                assert_eq!(of(VolumeShape::Slab).contains(border(0.75)), axis != 2);
            }
        }
        assert!(of(VolumeShape::Slab).contains(at + DVec3::new(1e6, -1e6, 0.5)));
        let square = prism(&[[0.0; 3], [1.0, 0.0, 5.0], [1.0, 1.0, 7.0], [0.0, 1.0, -3.0]], None);
        let square = Volume::new(square, DVec3::ZERO, DQuat::IDENTITY, DVec3::ONE);
        for (place, is_in) in [([0.0, 0.0], true), ([1.0, 0.5], true), ([0.5, 1.0], true), ([1.0, 1.0], true)]
            .into_iter()
            .chain([([1.0 + 1e-12, 0.5], false), ([0.5, -1e-12], false), ([0.5, 0.5], true), ([2.0, 1.0], false)])
        {
            assert_eq!(square.contains(DVec3::new(place[0], place[1], 1e9)), is_in, "{place:?}");
        }
        for shape in shapes() {
            assert!(!of(shape).contains(DVec3::splat(f64::NAN)));
        }
    }

    #[test]
    fn volumes_have_the_share_of_their_formula() {
        let size = DVec3::new(3.0, 2.0, 1.5);
        let mut draw = draws(7);
        let mut unit = || draw() - 0.5;
        const DRAWS: u32 = 200_000;
        let places: Vec<DVec3> = (0..DRAWS).map(|_| DVec3::new(unit(), unit(), unit()) * 6.0).collect();
        let pi = std::f64::consts::PI;
        // The L is three quarters of a rectangle; the cube's edge is 6 along the lines.
        let expected = [9.0, pi / 6.0 * 9.0, 1.5 * 36.0, 0.75 * 6.0 * 6.0];
        for (shape, expected) in shapes().into_iter().zip(expected) {
            let volume = Volume::new(shape.clone(), DVec3::ZERO, DQuat::IDENTITY, size);
            let inside = places.iter().filter(|place| volume.contains(**place)).count();
            let found = inside as f64 / f64::from(DRAWS) * 216.0;
            assert!((found / expected - 1.0).abs() < 0.03, "{shape:?}: {found}, expected {expected}");
        }
        // Rays: as wide at the distance 2 as the polygon at 1, twice.
        let cone = prism(&[[-0.5, -0.5, 1.0], [0.5, -0.5, 1.0], [0.5, 0.5, 1.0], [-0.5, 0.5, 1.0]], Some(DVec3::ZERO));
        let cone = Volume::new(cone, DVec3::ZERO, DQuat::IDENTITY, DVec3::ONE);
        assert!(cone.contains(DVec3::new(1.0, 0.0, 2.0)) && !cone.contains(DVec3::new(1.001, 0.0, 2.0)));
        assert!(!cone.contains(DVec3::new(0.0, 0.0, -2.0)) && !cone.contains(DVec3::ZERO));
    }

    #[test]
    fn a_turned_volume_contains_the_turned_points() {
        let (at, size) = (DVec3::new(1e5, -2e5, 40.0), DVec3::new(3.0, 2.0, 1.5));
        let mut unit = draws(3);
        for shape in shapes() {
            let plain = Volume::new(shape.clone(), DVec3::ZERO, DQuat::IDENTITY, size);
            let turned = Volume::new(shape.clone(), at, TURN, size);
            let mut agreed = 0;
            for _ in 0..2000 {
                let place = DVec3::from([(); 3].map(|()| unit() * 5.0 - 2.5));
                agreed += u32::from(plain.contains(place) == turned.contains(at + TURN.normalize() * place));
            }
            assert!(agreed >= 1999, "{shape:?}: {agreed}");
        }
    }

    #[test]
    fn what_is_said_of_a_box_holds_for_every_point_of_it() {
        let mut unit = draws(11);
        for shape in shapes() {
            let mut seen = [0; 3];
            for round in 0..4000 {
                let size = DVec3::new(1.0 + 3.0 * unit(), 1.0 + 2.0 * unit(), 0.5 + unit());
                let at = DVec3::new(1e4 * unit(), 1e4 * unit(), unit());
                let rotation = if round % 2 == 0 { TURN } else { DQuat::IDENTITY };
                let volume = Volume::new(shape.clone(), at, rotation, size);
                let corner = at + DVec3::new(unit(), unit(), unit()) * 5.0 - 2.5;
                let extent = DVec3::new(unit(), unit(), unit()) * [0.2, 1.0, 4.0][round % 3];
                let bounds = Bounds { min: corner, max: corner + extent };
                let cover = volume.cover(bounds);
                let within = (0..12).map(|_| corner + extent * DVec3::new(unit(), unit(), unit()));
                let places: Vec<DVec3> = within.chain(bounds.corners()).collect();
                match cover {
                    Cover::Inside => assert!(places.iter().all(|place| volume.contains(*place)), "{shape:?}"),
                    Cover::Outside => assert!(!places.iter().any(|place| volume.contains(*place)), "{shape:?}"),
                    Cover::Partly => {}
                }
                seen[cover as usize] += 1;
            }
            assert!(seen.iter().all(|count| *count > 10), "{shape:?}: {seen:?}");
            let nothing = Volume::new(shape, DVec3::ZERO, TURN, DVec3::ONE).cover(Bounds::EMPTY);
            assert_eq!(nothing, Cover::Outside);
        }
    }
}
