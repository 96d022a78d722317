//! Cases for methods that project points through the reflected rays of many pixels, or look rays up in maps that stand
//! on the mirror: what lies between such rays, before such maps or behind them.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use cloud::TriangleMesh;
use cloud::sampling::{StarShape, Surface};
use glam::{DQuat, DVec3};
use scene::{Camera, Mirror, MirrorMesh, Shape, five_mirrors};
use trace::exact::Albedo;

use super::sampled::{Piece, Scene};
use super::{FIELD_OF_VIEW, in_room, mirror, paraboloid, room, sphere};

/// A ball with so many bumps, rounded down to a power of four.
pub fn bumps(count: f64) -> Scene {
    let shape = match count as u32 {
        0 => bumpy::<0>(),
        1..4 => bumpy::<1>(),
        4..16 => bumpy::<4>(),
        16..64 => bumpy::<16>(),
        _ => bumpy::<64>(),
    };
    let ball = points_alone("bumps", 0.36);
    in_room([Piece::mirror(ball).shaped(Surface::Star(shape)).spaced(0.008)])
}

/// A mirror whose shape is none of those that have a formula: a mesh, of which nobody needs the triangles, because its
/// points are given.
fn points_alone(name: &str, size: f64) -> Mirror {
    let shape = Shape::Mesh(MirrorMesh { name: name.into(), surface: Arc::new(TriangleMesh::default()) });
    Mirror { name: name.into(), shape, ..mirror(Shape::Sphere, DVec3::ZERO, size) }
}

fn bumpy<const COUNT: u32>() -> StarShape {
    StarShape { radius: bumpy_radius::<COUNT>, gradient: bumpy_gradient::<COUNT> }
}

fn bumpy_radius<const COUNT: u32>(direction: DVec3) -> f64 {
    1.0 + bumps_near::<COUNT>(direction).map(|(_, height)| height).sum::<f64>()
}

fn bumpy_gradient<const COUNT: u32>(direction: DVec3) -> DVec3 {
    let width = bump_width(COUNT);
    bumps_near::<COUNT>(direction).map(|(middle, height)| middle * (height / (width * width))).sum()
}

/// The standard deviation of a bump, an angle in radians: neighbours touch where there are many.
fn bump_width(count: u32) -> f64 {
    (0.3 * (2.0 * TAU / f64::from(count)).sqrt()).min(0.35)
}

/// The middles of the bumps, and how high each is in a direction. A height of 0.7 widths bends their feet hollow.
fn bumps_near<const COUNT: u32>(direction: DVec3) -> impl Iterator<Item = (DVec3, f64)> {
    let width = bump_width(COUNT);
    (0..COUNT).filter_map(move |index| {
        // A spiral from the pole that faces the camera: equally many to an area.
        let z = 1.0 - 2.0 * f64::from(index) / f64::from(COUNT);
        // The golden angle.
        let (sin, cos) = (f64::from(index) * PI * (3.0 - 5_f64.sqrt())).sin_cos();
        let across = (1.0 - z * z).sqrt();
        let middle = DVec3::new(across * cos, across * sin, z);
        let exponent = (direction.dot(middle) - 1.0) / (width * width);
        // Beyond, it is lower than 1e-9.
        (exponent > -20.0).then(|| (middle, 0.7 * width * exponent.exp()))
    })
}

/// A bulging mirror and a bar across it at this distance, which shows its side to the mirror.
pub fn touching(gap: f64) -> Scene {
    let bulge = Mirror { rotation: DQuat::from_rotation_y(PI), ..mirror(paraboloid(30.0), DVec3::ZERO, 0.5) };
    let bar = block(DVec3::new(-0.4, -0.05, gap), DVec3::new(0.4, 0.05, gap + 0.4))
        .map(|side| Piece::wall(side, Albedo::At(striped)).spaced(0.008));
    // From above: the bar hides the lower half of the mirror, and the upper one shows its upper side.
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.0, 0.5, 1.0), 1.4, DVec3::Y);
    Scene { camera, ..in_room(bar.into_iter().chain([Piece::mirror(bulge).spaced(0.006)])) }
}

/// Yellow with dark stripes across, so that misplaced reflections of a bar are visible.
fn striped(position: DVec3) -> [f64; 3] {
    let shade = if (position.x * 20.0).floor().rem_euclid(2.0) == 1.0 { 0.25 } else { 1.0 };
    [0.6, 0.5, 0.1].map(|value: f64| value * shade)
}

/// The sides of a box, with outward normals.
fn block(low: DVec3, high: DVec3) -> [Surface; 6] {
    let size = high - low;
    let [across, up, along] = [DVec3::X * size, DVec3::Y * size, DVec3::Z * size];
    let side = |corner: DVec3, edges: [DVec3; 2]| Surface::Rectangle { corner, edges };
    [
        side(low, [along, up]),
        side(low, [across, along]),
        side(low, [up, across]),
        side(high, [-up, -along]),
        side(high, [-along, -across]),
        side(high, [-across, -up]),
    ]
}

/// A plane mirror that leans back from the camera, whose box is open behind the eye: in parallel projection the wall
/// there would hide the mirror.
pub fn tilted_plane(degrees: f64) -> Scene {
    let mut pieces = room();
    pieces.pop();
    let (sin, cos) = degrees.to_radians().sin_cos();
    let normal = DVec3::new(0.0, sin, cos);
    let leaning = Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::ZERO, normal, DVec3::Y, 0.5);
    pieces.push(Piece::mirror(Mirror { as_points: true, ..leaning }).spaced(0.008));
    Scene { pieces, camera: five_mirrors::camera(), field_of_view: FIELD_OF_VIEW }
}

/// An upright plate that is a mirror all around, seen at a slant.
pub fn two_sided(thickness: f64) -> Scene {
    let half = DVec3::new(0.4, 0.4, 0.5 * thickness);
    let plate = Mirror { rotation: DQuat::from_rotation_y(0.5), ..points_alone("plate", 1.0) };
    let sides = block(-half, half).map(|side| Piece::mirror(plate.clone()).shaped(side).spaced(0.008));
    in_room(sides.into_iter().enumerate().map(|(index, side)| if index > 0 { side.joined() } else { side }))
}

/// Small balls in rows of four.
pub fn rows(mirrors: f64) -> Scene {
    let at = |index: i32| DVec3::new(f64::from(index % 4) - 1.5, 1.5 - f64::from(index / 4), 0.0) * 0.42;
    in_room((0..mirrors.round() as i32).map(|index| sphere(at(index), 0.17)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_bumps_is_that_of_their_radius() {
        let step = 1e-6;
        for (radius, gradient) in [
            (bumpy_radius::<4> as fn(DVec3) -> f64, bumpy_gradient::<4> as fn(DVec3) -> DVec3),
            (bumpy_radius::<64>, bumpy_gradient::<64>),
        ] {
            for direction in [DVec3::Z, DVec3::new(0.3, 0.2, 0.9), DVec3::new(-0.5, 0.7, 0.4)] {
                let direction = direction.normalize();
                let given = gradient(direction);
                for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                    let by_steps = (radius(direction + axis * step) - radius(direction - axis * step)) / (2.0 * step);
                    assert!((given.dot(axis) - by_steps).abs() < 1e-6, "{direction} {axis}: {given}, {by_steps}");
                }
            }
        }
        assert_eq!((bumpy_radius::<0>(DVec3::X), bumpy_gradient::<0>(DVec3::X)), (1.0, DVec3::ZERO));
    }

    #[test]
    fn the_sides_of_a_block_face_outwards_and_enclose_it() {
        let (low, high) = (DVec3::new(-1.0, 0.0, 2.0), DVec3::new(0.0, 3.0, 4.0));
        let mut area = 0.0;
        for side in block(low, high) {
            area += side.area();
            for point in side.sample(20, 1) {
                let outside = point.position + point.normal * 1e-6;
                assert!(outside.cmplt(low).any() || outside.cmpgt(high).any(), "{point:?}");
                assert!(point.position.cmpge(low - 1e-9).all() && point.position.cmple(high + 1e-9).all());
            }
        }
        assert!((area - 2.0 * (3.0 + 2.0 + 6.0)).abs() < 1e-12, "{area}");
    }

    #[test]
    fn both_sides_of_a_plate_are_one_mirror() {
        let scene = two_sided(0.1);
        assert_eq!(scene.pieces.into_iter().filter_map(Piece::into_mirror).count(), 1);
    }
}
