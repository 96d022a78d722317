//! The scene that opens first: a courtyard of coloured walls about a pool, under the sun, with a ball and a ring that
//! mirror it. It is bright, its points are made in a moment, and its mirrors can be moved.

use std::f64::consts::FRAC_1_SQRT_2;

use cloud::sampling::Surface;
use glam::{DQuat, DVec3};

use crate::surface_points::Albedo;
use crate::{Camera, Lighting, Mirror, Settings, Shape};

// Linear red, green and blue.
const PINK: [f64; 3] = [0.745, 0.06, 0.198];
const OCHRE: [f64; 3] = [0.888, 0.386, 0.011];
const BLUE: [f64; 3] = [0.034, 0.089, 0.456];
const GREEN: [f64; 3] = [0.014, 0.254, 0.162];
const WHITE: [f64; 3] = [0.905, 0.863, 0.791];
const CREAM: [f64; 3] = [0.807, 0.644, 0.434];
const SAND: [f64; 3] = [0.694, 0.352, 0.133];
const TURQUOISE: [f64; 3] = [0.107, 0.546, 0.604];

/// Half the width of the courtyard. Lengths are metres, y points up.
const HALF: f64 = 7.2;
/// The height of its floor.
pub(crate) const FLOOR: f64 = 0.0;
/// The width of a tile of the floor.
const TILE: f64 = 0.8;
/// The pool's lower and upper corner on the floor, its depth, and how far its water is below the floor.
const POOL: [[f64; 2]; 2] = [[-3.2, -1.6], [3.2, 4.0]];
const DEPTH: f64 = 0.6;
const WATER: f64 = 0.14;

/// What is no mirror.
pub(crate) fn walls() -> Vec<(Surface, Albedo)> {
    let tiles: Albedo = |at| {
        let tile = (at.x / TILE).floor() + (at.z / TILE).floor();
        if tile.rem_euclid(2.0) == 0.0 { CREAM } else { SAND }
    };
    let [[left, far], [right, near]] = POOL;
    let floor = |[x, z]: [f64; 2], [x1, z1]: [f64; 2]| {
        (rectangle([x, FLOOR, z], DVec3::Z * (z1 - z), DVec3::X * (x1 - x)), tiles)
    };
    let rim: Albedo = |_| TURQUOISE;
    let (down, along, across) = (DVec3::Y * DEPTH, DVec3::Z * (near - far), DVec3::X * (right - left));
    let mut walls = vec![
        floor([-HALF, -HALF], [HALF, far]),
        floor([-HALF, far], [left, near]),
        floor([right, far], [HALF, near]),
        floor([-HALF, near], [HALF, HALF]),
        (rectangle([left, -DEPTH, far], down, along), rim),
        (rectangle([right, -DEPTH, far], along, down), rim),
        (rectangle([left, -DEPTH, far], across, down), rim),
        (rectangle([left, -DEPTH, near], down, across), rim),
    ];
    let (pink, ochre, blue, green, white): (Albedo, Albedo, Albedo, Albedo, Albedo) =
        (|_| PINK, |_| OCHRE, |_| BLUE, |_| GREEN, |_| WHITE);
    let mut block = |low: [f64; 3], high: [f64; 3], albedo| {
        walls.extend(block(low, high).into_iter().map(|side| (side, albedo)));
    };
    // A wall with a gate.
    block([-HALF, 0.0, -7.6], [-1.6, 4.2, -HALF], pink);
    block([1.0, 0.0, -7.6], [HALF, 4.2, -HALF], pink);
    block([-1.6, 3.0, -7.6], [1.0, 4.2, -HALF], pink);
    block([-7.6, 0.0, -HALF], [-HALF, 3.2, 1.5], ochre);
    block([4.6, 0.0, -HALF], [5.0, 2.6, -1.0], blue);
    block([-6.5, 0.0, 7.3], [-2.5, 3.0, 7.7], green);
    // A bench, an arcade, and what the ball and the ring stand on.
    block([-5.4, 0.0, -5.2], [-3.2, 0.5, -4.6], white);
    for column in [0.6, 2.6, 4.6, 6.6] {
        block([5.9, 0.0, column - 0.18], [6.26, 3.4, column + 0.18], white);
    }
    block([5.8, 3.4, 0.2], [6.36, 3.7, HALF], white);
    block([0.0, -DEPTH, -0.3], [1.8, 0.12, 1.5], white);
    block([-5.4, 0.0, -1.4], [-3.8, 0.25, 0.2], white);
    walls
}

pub(crate) fn mirrors() -> Vec<Mirror> {
    let [[left, far], [right, near]] = POOL;
    let water = Mirror {
        position: DVec3::new((left + right) * 0.5, -WATER, (far + near) * 0.5),
        // The plane's z turned to y.
        rotation: DQuat::from_xyzw(-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2),
        color: [0.1, 0.62, 0.68],
        specular_intensity: 0.5,
        ..mirror("water", Shape::Plane { height: (near - far) / (right - left) }, (right - left) * 0.5)
    };
    let ring = Mirror {
        position: DVec3::new(-4.6, 0.25 + 1.12 * 1.3, -0.6),
        rotation: DQuat::from_rotation_y(0.715),
        color: [1.0, 0.72, 0.3],
        specular_intensity: 0.9,
        ..mirror("ring", Shape::Torus { tube: 0.3 }, 1.12)
    };
    let ball = Mirror { position: DVec3::new(0.9, 0.12 + 1.3, 0.6), ..mirror(BALL, Shape::Sphere, 1.3) };
    vec![ball, ring, water]
}

/// The name of the mirror to take in hand first.
pub const BALL: &str = "ball";

fn mirror(name: &str, shape: Shape, size: f64) -> Mirror {
    Mirror {
        name: name.to_owned(),
        shape,
        position: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        size,
        color: [0.95; 3],
        specular_intensity: 0.97,
        specular_power: 0.0,
        refraction: None,
        as_points: false,
        method: None,
    }
}

pub(crate) fn camera() -> Camera {
    Camera::from_eye(DVec3::new(3.7, EYE_HEIGHT, 8.2), DVec3::new(-0.8, 0.85, 0.0), DVec3::Y)
}

/// The parameters that belong to the scene: its sun and its sky.
pub(crate) fn settings() -> Settings {
    let mut settings = Settings::default();
    settings.light.by = Lighting::Sun;
    settings.view.background = param::Color(0x8fc4_f0ff);
    settings.view.field_of_view = 50.0;
    (settings.sun.azimuth, settings.sun.elevation) = (150.0, 42.0);
    (settings.mirror.tint, settings.mirror.fresnel) = (1.0, 1.0);
    settings.reflection.bounces = 2;
    // Light and shadows show depth.
    settings.edl.strength = 0.0;
    settings.tone.exposure = 0.6;
    // No hole is left between the discs of large flat surfaces.
    settings.splat.size = 1.35;
    // Large discs need few points, and few points are ready soon.
    settings.scene.points = 1_000_000;
    settings
}

fn rectangle(corner: [f64; 3], u: DVec3, v: DVec3) -> Surface {
    Surface::Rectangle { corner: DVec3::from(corner), edges: [u, v] }
}

/// How far the top and the underside of a wall that is higher than the eye keep from its border, about the radius of
/// its discs: from below, one would see dark discs stand out over the wall.
const INSET: f64 = 0.03;
const EYE_HEIGHT: f64 = 2.5;

/// The sides of a block, with its underside if it does not stand on the floor.
fn block(low: [f64; 3], high: [f64; 3]) -> Vec<Surface> {
    let size = DVec3::from(high) - DVec3::from(low);
    let (x, y, z) = (DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z);
    let (low, at) = (DVec3::from(low), |offset: DVec3| (DVec3::from(low) + offset).to_array());
    let inset = if low.y + size.y > EYE_HEIGHT { INSET } else { 0.0 };
    let corner = (DVec3::X + DVec3::Z) * inset;
    let (inset_x, inset_z) = (x - DVec3::X * (2.0 * inset), z - DVec3::Z * (2.0 * inset));
    let mut sides = vec![
        rectangle(low.to_array(), z, y),
        rectangle(at(x), y, z),
        rectangle(at(y + corner), inset_z, inset_x),
        rectangle(low.to_array(), y, x),
        rectangle(at(z), x, y),
    ];
    if low.y > FLOOR {
        sides.push(rectangle(at(corner), inset_x, inset_z));
    }
    sides
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_of_blocks_face_outwards_and_mirrors_stand_on_what_is_under_them() {
        let middle = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(block([0.0; 3], [2.0; 3]).len(), 5);
        let hanging = block([0.0, 1.0, 2.0], [2.0, 3.0, 4.0]);
        assert_eq!(hanging.len(), 6);
        for side in hanging {
            let Surface::Rectangle { corner, edges: [u, v] } = side else { panic!("{side:?}") };
            let outward = corner + (u + v) * 0.5 - middle;
            assert!(u.cross(v).dot(outward) > 0.0, "{side:?}");
        }
        for mirror in mirrors() {
            assert_eq!(mirror.problem(), None);
        }
        let [ball, ring, water] = &mirrors()[..] else { panic!("three mirrors") };
        assert!((ball.position.y - ball.size - 0.12).abs() < 1e-12);
        assert!((ring.position.y - ring.size * 1.3 - 0.25).abs() < 1e-12);
        assert!((water.rotation * DVec3::Z - DVec3::Y).length() < 1e-12);
        // Each point of the pool's rim is at the border of its water.
        let reach = water.rotation * DVec3::new(water.size, water.size * 0.875, 0.0);
        assert!((water.position + reach - DVec3::new(3.2, -WATER, -1.6)).length() < 1e-9, "{reach}");
    }
}
