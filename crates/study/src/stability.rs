//! Scenes that provoke the failures of reflection methods, each by one number.
//!
//! A case is named `stability/NAME:VALUE`: what is wrong with it grows or shrinks with the value. The plan
//! `assets/plans/stability.toml` sweeps the values and says which bound must hold; docs/study/stability.md shows what comes of
//! it. All cases stand in the box of the five mirrors, all mirrors are sampled as points, and all
//! surfaces have formulas, so that both truths can judge them.

mod projecting;
mod sampled;

use std::f64::consts::PI;
use std::ops::RangeInclusive;
use std::sync::Arc;

use cloud::sampling::Surface;
use glam::{DQuat, DVec3};
use render::Gpu;
use scene::five_mirrors::{self, walls};
use scene::{Camera, Mirror, Settings, Shape, SpotLight};
use trace::exact::Albedo;

use crate::stability::projecting::{bumps, rows, tilted_plane, touching, two_sided};
use crate::stability::sampled::{Piece, Scene};
use crate::subject::Subject;

/// The prefix of the names of cases.
pub const PREFIX: &str = "stability/";

/// A kind of scene.
struct Case {
    /// The name without [`PREFIX`] and value.
    name: &'static str,
    /// The meaning of its value, in words, with the unit.
    value: &'static str,
    default: f64,
    range: RangeInclusive<f64>,
    scene: fn(f64) -> Scene,
}

/// All cases, in the order of the docs.
const CASES: [Case; 32] = [
    Case { name: "rolled-camera", value: "roll, degrees", default: 45.0, range: 0.0..=90.0, scene: rolled_camera },
    Case {
        name: "wide-view",
        value: "vertical field of view, degrees",
        default: 110.0,
        range: 10.0..=140.0,
        scene: wide_view,
    },
    Case {
        name: "eye-at-focus",
        value: "distance of the eye from the vertex, in focal lengths",
        default: 1.0,
        range: 0.3..=7.5,
        scene: eye_at_focus,
    },
    Case {
        name: "grid",
        value: "width of the holes, pixels of a picture of 240 rows",
        default: 4.0,
        range: 3.0..=100.0,
        scene: grid,
    },
    Case {
        name: "thin-tube",
        value: "width of the tube, pixels of a picture of 240 rows",
        default: 4.0,
        range: 1.0..=40.0,
        scene: thin_tube,
    },
    Case {
        name: "flat-beside-hollow",
        value: "share that the plane covers, from the right",
        default: 0.5,
        range: 0.0..=0.9,
        scene: flat_beside_hollow,
    },
    Case {
        name: "noisy-normals",
        value: "standard deviation of the normals, degrees along each axis",
        default: 2.0,
        range: 0.0..=20.0,
        scene: noisy_normals,
    },
    Case {
        name: "steps",
        value: "depth of the step, share of the distance from the eye",
        default: 0.03,
        range: 0.0..=0.5,
        scene: steps,
    },
    Case {
        name: "sparse-room",
        value: "points of the box",
        default: 3000.0,
        range: 100.0..=10_000_000.0,
        scene: sparse_room,
    },
    Case { name: "open-box", value: "radius of the sphere", default: 0.43, range: 0.05..=0.9, scene: open_box },
    Case { name: "fence", value: "distance of the fence from the wall", default: 0.1, range: 0.02..=0.9, scene: fence },
    Case { name: "crowd", value: "how many", default: 5.0, range: 1.0..=5.0, scene: crowd },
    Case { name: "kinds", value: "how many", default: 5.0, range: 1.0..=5.0, scene: kinds },
    Case {
        name: "near-wall",
        value: "gap between sphere and wall",
        default: 0.05,
        range: 0.001..=0.5,
        scene: near_wall,
    },
    Case {
        name: "hovering-bars",
        value: "gap between bars and mirror",
        default: 0.05,
        range: 0.001..=0.5,
        scene: hovering_bars,
    },
    Case {
        name: "bent-mirror",
        value: "slope at its rim, degrees",
        default: 5.0,
        range: 0.01..=60.0,
        scene: bent_mirror,
    },
    Case { name: "glossy", value: "specular power", default: 300.0, range: 0.0..=1e6, scene: glossy },
    Case {
        name: "looking-down",
        value: "elevation of the eye over a mirror that lies flat, degrees",
        default: 45.0,
        range: 5.0..=85.0,
        scene: looking_down,
    },
    Case { name: "pillars", value: "width of the pillars", default: 0.1, range: 0.01..=0.3, scene: pillars },
    Case {
        name: "wires",
        value: "width of the wires, pixels of a picture of 240 rows",
        default: 3.0,
        range: 1.0..=20.0,
        scene: wires,
    },
    Case { name: "screened", value: "share that the plates cover", default: 0.25, range: 0.01..=0.9, scene: screened },
    Case {
        name: "half-wall",
        value: "share of the side walls that the camera sees",
        default: 0.5,
        range: 0.05..=0.75,
        scene: half_wall,
    },
    Case {
        name: "hanging-mirror",
        value: "gap between mirror and wall",
        default: 0.02,
        range: 0.001..=0.5,
        scene: hanging_mirror,
    },
    Case {
        name: "crease",
        value: "angle between the plates, degrees",
        default: 90.0,
        range: 30.0..=180.0,
        scene: crease,
    },
    Case { name: "deep-room", value: "length of the room", default: 8.0, range: 4.0..=64.0, scene: deep_room },
    Case {
        name: "bumps",
        value: "how many, rounded down to 1, 4, 16 or 64",
        default: 16.0,
        range: 0.0..=64.0,
        scene: bumps,
    },
    Case { name: "touching", value: "gap between bar and mirror", default: 0.02, range: 0.001..=0.5, scene: touching },
    Case {
        name: "tilted-plane",
        value: "angle of its normal to the line of sight, degrees",
        default: 40.0,
        range: 15.0..=85.0,
        scene: tilted_plane,
    },
    Case { name: "two-sided", value: "thickness of the plate", default: 0.04, range: 0.005..=0.5, scene: two_sided },
    Case {
        name: "stray",
        value: "distance of one point from the middle of the box; up to 2 there is none",
        default: 60.0,
        range: 0.0..=10_000.0,
        scene: stray,
    },
    Case { name: "faint", value: "share that the mirrors reflect", default: 0.5, range: 0.01..=1.0, scene: faint },
    Case { name: "rows", value: "how many mirrors", default: 16.0, range: 1.0..=16.0, scene: rows },
];

/// Whether the name has the form of a case, known or not.
pub fn is_case(name: &str) -> bool {
    name.starts_with(PREFIX)
}

/// The settings of a case: all defaults, except its field of view.
///
/// # Errors
/// Those of [`subject`].
pub fn settings(name: &str) -> anyhow::Result<Settings> {
    let mut settings = Settings::default();
    settings.view.field_of_view = scene(name)?.field_of_view;
    Ok(settings)
}

/// The mirrors of a case.
///
/// # Errors
/// Unknown name, no number, or out of range.
pub fn mirrors(name: &str) -> anyhow::Result<Vec<Mirror>> {
    Ok(scene(name)?.pieces.into_iter().filter_map(Piece::into_mirror).collect())
}

/// The subject of a case `stability/NAME:VALUE`, or of `stability/NAME` with its default value.
///
/// # Errors
/// Unknown name, no number, out of range; no memory on the GPU.
pub fn subject(gpu: &Arc<Gpu>, name: &str, settings: &Settings) -> anyhow::Result<Subject> {
    scene(name)?.subject(gpu, lamps(), settings)
}

fn scene(name: &str) -> anyhow::Result<Scene> {
    let (case, value) = find(name)?;
    Ok((case.scene)(value))
}

/// A case and its value.
fn find(name: &str) -> anyhow::Result<(&'static Case, f64)> {
    let rest = name.strip_prefix(PREFIX).unwrap_or(name);
    let (key, value) = rest.split_once(':').map_or((rest, None), |(key, value)| (key, Some(value)));
    let Some(case) = CASES.iter().find(|case| case.name == key) else {
        let names: Vec<&str> = CASES.iter().map(|case| case.name).collect();
        anyhow::bail!(
            "{name}: no such stability case\nexpected {PREFIX}NAME or {PREFIX}NAME:VALUE with a NAME of: {}",
            names.join(", ")
        );
    };
    let (first, last) = (case.range.start(), case.range.end());
    let parsed = value.map_or(Ok(case.default), str::parse);
    match parsed {
        Ok(number) if case.range.contains(&number) => Ok((case, number)),
        _ => anyhow::bail!(
            "{name}: the value is {}, expected a number from {first} to {last} ({})",
            value.unwrap_or_default(),
            case.value
        ),
    }
}

/// The height of the pictures for which widths in pixels are given.
const ROWS: f64 = 240.0;
/// The field of view in the five mirrors' definition.
const FIELD_OF_VIEW: f32 = 60.0;
/// The radius of the sphere of the five mirrors.
const RADIUS: f64 = 0.43;
/// The width of the squares on the walls, equal to those of the five mirrors' floor.
const CHECK: f64 = 0.25;

/// The width of a pixel at a distance of one along the line of sight, with the field of view above.
fn pixel() -> f64 {
    2.0 * (f64::from(FIELD_OF_VIEW).to_radians() / 2.0).tan() / ROWS
}

/// The box of the five mirrors, with checkered walls, so that a misplaced reflection is visible.
fn room() -> Vec<Piece> {
    walls().map(|(surface, _)| Piece::wall(surface, Albedo::At(checkered))).into()
}

/// The linear albedo of the box's walls: left red, right green, the others pale.
fn checkered(position: DVec3) -> [f64; 3] {
    // The wall is across the axis along which the place is farthest out.
    let axis = (position / DVec3::new(1.0, 1.0, 2.0)).abs().max_position();
    let along: f64 = (0..3).filter(|other| *other != axis).map(|other| (position[other] / CHECK).floor()).sum();
    let own = match axis {
        0 if position.x < 0.0 => [0.63, 0.065, 0.05],
        0 => [0.14, 0.45, 0.091],
        _ => [0.725, 0.71, 0.68],
    };
    let is_dark = along.rem_euclid(2.0) == 1.0;
    own.map(|value| if is_dark { 0.25 * value } else { value })
}

/// Two wide lamps under the ceiling, which light the whole box.
fn lamps() -> Vec<SpotLight> {
    let lamp = |z| SpotLight {
        position: DVec3::new(0.0, 0.95, z),
        target: DVec3::new(0.0, -1.0, z),
        intensity: [4.0; 3],
        inner_degrees: 60.0,
        outer_degrees: 80.0,
    };
    [-1.0, 1.0].map(lamp).into()
}

/// The box with these mirrors, seen like the five mirrors.
fn in_room(mirrors: impl IntoIterator<Item = Piece>) -> Scene {
    let mut pieces = room();
    pieces.extend(mirrors);
    Scene { pieces, camera: five_mirrors::camera(), field_of_view: FIELD_OF_VIEW }
}

/// A mirror that faces the camera.
fn mirror(shape: Shape, position: DVec3, size: f64) -> Mirror {
    Mirror { position, as_points: true, ..Mirror::standing(shape, DVec3::ZERO, DVec3::Z, DVec3::Y, size) }
}

/// A mirror with enough points for smooth normals: 25 thousand.
fn sphere(position: DVec3, radius: f64) -> Piece {
    Piece::mirror(mirror(Shape::Sphere, position, radius)).spaced(radius / 45.0)
}

/// A ring seen from its side, which bends eight times as much one way as the other; the camera is rolled.
fn rolled_camera(degrees: f64) -> Scene {
    // The ring's axis is level: the part before the eye is an upright tube that bends back slowly.
    let ring = Mirror {
        rotation: DQuat::from_rotation_y(PI / 2.0),
        ..mirror(Shape::Torus { tube: 0.14 }, DVec3::Z * -0.6, 0.8)
    };
    let (sin, cos) = degrees.to_radians().sin_cos();
    let camera = Camera { up: DVec3::new(sin, cos, 0.0), ..five_mirrors::camera() };
    Scene { camera, ..in_room([Piece::mirror(ring).spaced(0.009)]) }
}

/// A sphere of the same size on the screen and as near to its corner, whatever the field of view.
fn wide_view(degrees: f64) -> Scene {
    // Two thirds of the way to the upper right corner of a picture of 4 by 3; at a distance of one from the eye.
    let slope = (degrees.to_radians() / 2.0).tan();
    let direction = DVec3::new(slope * 4.0 / 3.0 * 0.66, slope * 0.66, -1.0).normalize();
    let eye = DVec3::Z;
    // An eighth of the picture's height at that depth.
    let radius = 0.25 * slope * -direction.z;
    let camera = Camera { eye, pivot: DVec3::ZERO, up: DVec3::Y };
    Scene { camera, field_of_view: degrees as f32, ..in_room([sphere(eye + direction, radius)]) }
}

/// A hollow mirror with the eye on its axis.
fn eye_at_focus(distance: f64) -> Scene {
    let (focal_length, rim) = (0.4, 0.5);
    let vertex = DVec3::Z * -1.2;
    let shape = Shape::Paraboloid { focal_length: focal_length / rim };
    let camera = Camera { eye: vertex + DVec3::Z * distance * focal_length, pivot: vertex, up: DVec3::Y };
    Scene { camera, ..in_room([Piece::mirror(mirror(shape, vertex, rim)).spaced(0.004)]) }
}

/// A sphere behind a grid of bars.
fn grid(hole: f64) -> Scene {
    // Half way to the sphere, where it covers half of what it does at its middle.
    let distance = 1.0;
    let pixel = pixel() * distance;
    let (bar, period) = (3.0 * pixel, (3.0 + hole) * pixel);
    let reach = 0.3;
    let z = five_mirrors::camera().eye.z - distance;
    let lines = (reach / period).ceil() as i32;
    let bars = (-lines..=lines).flat_map(|line| {
        let at = f64::from(line) * period - bar / 2.0;
        let upright =
            Surface::Rectangle { corner: DVec3::new(at, -reach, z), edges: [DVec3::X * bar, DVec3::Y * (2.0 * reach)] };
        let level =
            Surface::Rectangle { corner: DVec3::new(-reach, at, z), edges: [DVec3::X * (2.0 * reach), DVec3::Y * bar] };
        // Two thirds of a pixel between points: a bar keeps its width.
        [upright, level].map(|surface| Piece::wall(surface, Albedo::Even([0.5, 0.4, 0.1])).spaced(0.66 * pixel))
    });
    in_room(bars.chain([sphere(DVec3::ZERO, RADIUS)]))
}

/// A ring of a thin tube.
fn thin_tube(width: f64) -> Scene {
    let ring = 0.55;
    let tube = width / 2.0 * pixel() * five_mirrors::camera().eye.z;
    let mirror = mirror(Shape::Torus { tube: tube / ring }, DVec3::ZERO, ring);
    // Splats wider than the tube would widen it; on a wide one, no more points than others have.
    in_room([Piece::mirror(mirror).spaced((tube / 2.5).min(0.006))])
}

/// A paraboloid with this slope at its rim.
fn paraboloid(slope: f64) -> Shape {
    // z = r^2 / 4 f, whose slope is r / 2 f.
    Shape::Paraboloid { focal_length: 0.5 / slope.to_radians().tan() }
}

/// A hollow mirror, and a plane that touches its rim and covers a part of it.
fn flat_beside_hollow(share: f64) -> Scene {
    // The eye is more than five focal lengths away: the focus plays no role.
    let (rim, slope) = (0.45, 35.0_f64);
    let rim_height = rim * slope.to_radians().tan() / 2.0;
    let hollow = mirror(paraboloid(slope), DVec3::Z * -rim_height, rim);
    let right = 2.0 * rim * share;
    let plane = mirror(
        Shape::Plane { height: rim / right.max(1e-3) * 2.0 },
        DVec3::X * (rim - right / 2.0),
        right.max(1e-3) / 2.0,
    );
    let pieces = [Some(hollow), (share > 0.0).then_some(plane)];
    in_room(pieces.into_iter().flatten().map(|mirror| Piece::mirror(mirror).spaced(0.006)))
}

/// A sphere whose points have noisy normals.
fn noisy_normals(degrees: f64) -> Scene {
    in_room([sphere(DVec3::ZERO, RADIUS).noisy(degrees)])
}

/// Plates side by side, every other one set back.
fn steps(step: f64) -> Scene {
    // Plates of a tenth, turned a little upwards: reflections differ from plate to plate.
    let plate = |index: i32| {
        let (column, row) = (index % 6 - 3, index / 6 - 2);
        let back = if (column + row) % 2 == 0 { 0.0 } else { step * five_mirrors::camera().eye.z };
        let position = DVec3::new(0.2 * f64::from(column) + 0.1, 0.2 * f64::from(row) + 0.1, -back);
        Piece::mirror(mirror(Shape::Plane { height: 1.0 }, position, 0.1)).spaced(0.008)
    };
    in_room((0..24).map(plate))
}

/// A sphere with enough points in a box with few.
fn sparse_room(points: f64) -> Scene {
    let mut pieces = room();
    let area: f64 = walls().iter().map(|(surface, _)| surface.area()).sum();
    pieces = pieces.into_iter().map(|wall| wall.spaced((area / points).sqrt())).collect();
    pieces.push(sphere(DVec3::ZERO, RADIUS));
    Scene { pieces, camera: five_mirrors::camera(), field_of_view: FIELD_OF_VIEW }
}

/// A sphere in a box without its ceiling and the wall behind the eye.
fn open_box(radius: f64) -> Scene {
    let mut pieces = room();
    // The last is behind the eye, the fourth is the ceiling.
    pieces.pop();
    pieces.remove(3);
    pieces.push(sphere(DVec3::ZERO, radius));
    Scene { pieces, camera: five_mirrors::camera(), field_of_view: FIELD_OF_VIEW }
}

/// A sphere before a fence at this distance from the wall that it hides.
fn fence(distance: f64) -> Scene {
    // Slats along both side walls, a tenth wide and a tenth apart.
    let slats = (-18..18).step_by(2).flat_map(|slat| {
        let z = f64::from(slat) * 0.1;
        [-1.0, 1.0].map(|side| {
            let corner = DVec3::new(side * (1.0 - distance), -1.0, z);
            let surface = Surface::Rectangle { corner, edges: [DVec3::Y * 2.0, DVec3::Z * 0.1] };
            Piece::wall(surface, Albedo::Even([0.6, 0.5, 0.1]))
        })
    });
    in_room(slats.chain([sphere(DVec3::ZERO, RADIUS)]))
}

/// Spheres side by side, of a size for which five have room.
fn crowd(mirrors: f64) -> Scene {
    let count = mirrors.round() as i32;
    let at = |index: i32| DVec3::X * 0.36 * (f64::from(index) - f64::from(count - 1) / 2.0);
    // Equally dense, however many there are.
    in_room((0..count).map(|index| sphere(at(index), 0.16).spaced(0.006)))
}

/// Mirrors of different kinds side by side: the first of the five in one picture. Each stays where it is.
fn kinds(mirrors: f64) -> Scene {
    let mirrors = five_mirrors::Variant::All.mirrors().into_iter().take(mirrors.round() as usize);
    in_room(mirrors.map(|mirror| Piece::mirror(mirror).spaced(0.006)))
}

/// All five mirrors, which show one another, and reflect a share of what they meet.
fn faint(share: f64) -> Scene {
    let mirrors = five_mirrors::Variant::All.mirrors().into_iter();
    in_room(mirrors.map(|mirror| Piece::mirror(Mirror { specular_intensity: share as f32, ..mirror }).spaced(0.006)))
}

/// A sphere in front of a wall.
fn near_wall(gap: f64) -> Scene {
    // Beside the left wall, and seen from the right, so that their gap shows.
    let radius = 0.35;
    let middle = DVec3::new(-1.0 + gap + radius, 0.0, 0.0);
    let camera = Camera::looking(middle, DVec3::new(0.4, 0.1, 1.0), 1.4, DVec3::Y);
    Scene { camera, ..in_room([sphere(middle, radius)]) }
}

/// A plane mirror that lies flat: the higher the eye, the farther behind it is what the mirror shows.
fn looking_down(elevation: f64) -> Scene {
    let (sin, cos) = elevation.to_radians().sin_cos();
    let at = DVec3::new(0.0, -0.7, -0.3);
    let flat = Mirror {
        position: at,
        as_points: true,
        ..Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::ZERO, DVec3::Y, DVec3::Z, 0.35)
    };
    let camera = Camera::looking(at, DVec3::new(0.0, sin, cos), 1.4, DVec3::Y);
    Scene { camera, ..in_room([Piece::mirror(flat).spaced(0.006)]) }
}

/// An upright rectangle that faces the camera.
fn plate(middle: DVec3, width: f64, height: f64) -> Surface {
    let edges = [DVec3::X * width, DVec3::Y * height];
    Surface::Rectangle { corner: middle - (edges[0] + edges[1]) * 0.5, edges }
}

/// A sphere with a pillar on each side, nearer to the camera, behind which reflected rays pass.
fn pillars(width: f64) -> Scene {
    let pillar = |side: f64| {
        let middle = DVec3::new(side * 0.62, 0.0, 0.3);
        Piece::wall(plate(middle, width, 2.0), Albedo::Even([0.6, 0.5, 0.1])).spaced(0.008)
    };
    in_room([pillar(-1.0), pillar(1.0), sphere(DVec3::ZERO, RADIUS)])
}

/// A sphere before rows of upright wires, which it reflects.
fn wires(width: f64) -> Scene {
    // At the middle of the wires.
    let (at, wire) = (-0.8, width * pixel() * (five_mirrors::camera().eye.z + 0.8));
    let wires = (-9..=9).map(|wire_index| {
        let middle = DVec3::new(f64::from(wire_index) * 0.1, 0.0, at);
        Piece::wall(plate(middle, wire, 2.0), Albedo::Even([0.6, 0.5, 0.1])).spaced((0.5 * wire).min(0.008))
    });
    in_room(wires.chain([sphere(DVec3::ZERO, 0.35)]))
}

/// A sphere between lattices of square plates before both side walls.
fn screened(share: f64) -> Scene {
    let period = 0.25;
    let width = period * share.sqrt();
    let plates = (0..8 * 16 * 2).map(|index| {
        let (row, column, side) = (index % 8, index / 8 % 16, if index < 128 { -1.0 } else { 1.0 });
        let middle = DVec3::new(0.65 * side, period * (f64::from(row) - 3.5), period * (f64::from(column) - 7.5));
        let edges = [DVec3::Y * width, DVec3::Z * width];
        let surface = Surface::Rectangle { corner: middle - (edges[0] + edges[1]) * 0.5, edges };
        Piece::wall(surface, Albedo::Even([0.6, 0.5, 0.1])).spaced((width / 6.0).min(0.016))
    });
    in_room(plates.chain([sphere(DVec3::ZERO, RADIUS)]))
}

/// A sphere before an eye that sees so much of the side walls' length.
fn half_wall(share: f64) -> Scene {
    // The wall behind the eye is left out, so that the eye may stand there.
    let mut pieces = room();
    pieces.pop();
    // The picture is 4 to 3 wide: at the edge of its sight a wall begins, one away from the eye's axis.
    let across = 4.0 / 3.0 * (f64::from(FIELD_OF_VIEW).to_radians() / 2.0).tan();
    let eye = -2.0 + 4.0 * share + 1.0 / across;
    pieces.push(sphere(DVec3::Z * (eye - 1.0), 0.2));
    let camera = Camera::looking(DVec3::Z * (eye - 1.9), DVec3::Z, 1.9, DVec3::Y);
    Scene { pieces, camera, field_of_view: FIELD_OF_VIEW }
}

/// A sphere in the box, and one point behind the camera, so far off that nothing sees it but the bounds of all points.
fn stray(distance: f64) -> Scene {
    let side = 0.01;
    let point = || Piece::wall(plate(DVec3::Z * distance, side, side), Albedo::Even([0.7; 3])).spaced(side);
    in_room((distance > 2.0).then(point).into_iter().chain([sphere(DVec3::ZERO, RADIUS)]))
}

/// A plane mirror close before the far wall.
fn hanging_mirror(gap: f64) -> Scene {
    let flat = mirror(Shape::Plane { height: 1.0 }, DVec3::new(0.2, 0.1, -2.0 + gap), 0.6);
    in_room([Piece::mirror(flat).spaced(0.006)])
}

/// Two plane mirrors that meet at an upright edge and open towards the camera.
fn crease(degrees: f64) -> Scene {
    let half = degrees.to_radians() / 2.0;
    let plates = [-1.0, 1.0].map(|side| {
        let along = DVec3::new(side * half.sin(), 0.0, half.cos());
        let normal = DVec3::new(-side * half.cos(), 0.0, half.sin());
        let plate = Mirror {
            position: DVec3::Z * -0.4 + along * 0.35,
            as_points: true,
            ..Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::ZERO, normal, DVec3::Y, 0.35)
        };
        Piece::mirror(plate).spaced(0.006)
    });
    in_room(plates)
}

/// A sphere at the end of a box that reaches far behind the eye.
fn deep_room(length: f64) -> Scene {
    let low = DVec3::new(-1.0, -1.0, -2.0);
    let [across, up, along] = [DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * length];
    let wall =
        |corner: DVec3, edges: [DVec3; 2]| Piece::wall(Surface::Rectangle { corner, edges }, Albedo::At(checkered));
    let walls = [
        wall(low, [along, across]),
        wall(low + up, [across, along]),
        wall(low, [up, along]),
        wall(low + across, [along, up]),
        wall(low, [across, up]),
        wall(low + along, [up, across]),
    ];
    let pieces = walls.into_iter().chain([sphere(DVec3::ZERO, RADIUS)]).collect();
    Scene { pieces, camera: five_mirrors::camera(), field_of_view: FIELD_OF_VIEW }
}

/// A mirror that is almost flat.
fn bent_mirror(slope: f64) -> Scene {
    // The outer side of the mirror faces the camera, so that reflected rays never cross.
    let bent = Mirror { rotation: DQuat::from_rotation_y(PI), ..mirror(paraboloid(slope), DVec3::ZERO, 0.5) };
    in_room([Piece::mirror(bent).spaced(0.006)])
}

/// A glossy ball in the box.
fn glossy(power: f64) -> Scene {
    let ball = Mirror { specular_power: power as f32, ..mirror(Shape::Sphere, DVec3::ZERO, 0.43) };
    in_room([Piece::mirror(ball).spaced(0.43 / 45.0)])
}

/// Bars close before a plane mirror.
fn hovering_bars(gap: f64) -> Scene {
    // Seen at a slant, so that the bars do not hide their reflections.
    let mirror = mirror(Shape::Plane { height: 1.0 }, DVec3::ZERO, 0.5);
    let bars = (-2..=2).map(|bar| {
        let corner = DVec3::new(-0.5, 0.2 * f64::from(bar) - 0.03, gap);
        let surface = Surface::Rectangle { corner, edges: [DVec3::X, DVec3::Y * 0.06] };
        Piece::wall(surface, Albedo::Even([0.6, 0.5, 0.1]))
    });
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.0, 0.5, 1.0), 1.05, DVec3::Y);
    Scene { camera, ..in_room(bars.chain([Piece::mirror(mirror)])) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_case_and_value() {
        let (case, value) = find("stability/thin-tube:2.5").unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((case.name, value), ("thin-tube", 2.5));
        let (case, value) = find("stability/grid").unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((case.name, value), ("grid", case.default));
    }

    #[test]
    fn wrong_names_say_what_was_expected() {
        let error = |name| find(name).map(|(_, value)| value).expect_err(name).to_string();
        let unknown = error("stability/mist");
        assert!(unknown.starts_with("stability/mist: ") && unknown.lines().count() == 2, "{unknown}");
        assert!(CASES.iter().all(|case| unknown.contains(case.name)), "{unknown}");
        for name in ["stability/grid:0", "stability/grid:many", "stability/grid:", "stability/grid:NaN"] {
            let error = error(name);
            assert!(error.contains("expected a number from 3 to 100 (width of the holes"), "{error}");
        }
    }

    #[test]
    fn each_case_can_be_made_from_end_to_end_of_its_range() {
        for case in &CASES {
            for value in [*case.range.start(), case.default, *case.range.end()] {
                assert!(case.range.contains(&value), "{}", case.name);
                let scene = (case.scene)(value);
                assert!(scene.mirrors().count() > 0, "{}", case.name);
                for mirror in scene.mirrors() {
                    assert_eq!(mirror.problem(), None, "{} {value}", case.name);
                }
            }
        }
    }

    #[test]
    fn mirrors_of_different_kinds_stay_where_they_are_as_others_are_added() {
        let placed = |count| {
            let scene = kinds(count);
            scene.mirrors().map(|mirror| (mirror.name.clone(), mirror.position, mirror.size)).collect::<Vec<_>>()
        };
        let all = placed(5.0);
        assert_eq!(all.iter().map(|(name, ..)| name.as_str()).collect::<std::collections::BTreeSet<_>>().len(), 5);
        for count in 1..5 {
            assert_eq!(placed(f64::from(count)), all[..count as usize]);
        }
    }

    #[test]
    fn the_field_of_view_is_the_case_s() {
        let degrees = |name| settings(name).map(|settings| settings.view.field_of_view).unwrap_or(0.0);
        assert_eq!((degrees("stability/wide-view:125"), degrees("stability/grid")), (125.0, FIELD_OF_VIEW));
    }
}
