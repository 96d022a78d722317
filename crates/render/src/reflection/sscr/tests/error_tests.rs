//! Tests of the error function and the labels, against closed forms.

use glam::{UVec2, Vec2, Vec3};

use crate::reflection::sscr::twin::{
    self, MirrorPixel, Random, mapped_error, mirror_space_error, reflected_in_mirror_space,
};

fn pixel(point: Vec3, normal: Vec3, eye: Vec3) -> MirrorPixel {
    MirrorPixel { point, normal, toward_eye: (eye - point).normalize(), linear_depth: (eye - point).length() }
}

pub(super) fn error(pixel: &MirrorPixel, q: Vec3) -> Vec2 {
    mirror_space_error(reflected_in_mirror_space(pixel, Vec3::X, q))
}

pub(super) fn random_vector(random: &mut Random) -> Vec3 {
    Vec3::new(random.next(), random.next(), random.next()) * 2.0 - 1.0
}

#[test]
fn the_error_vanishes_at_reflection_points_that_are_known_in_closed_form() {
    let mut random = Random(3);
    for _ in 0..200 {
        let error = |pixel: MirrorPixel, q: Vec3| {
            let reflected = reflected_in_mirror_space(&pixel, Vec3::X, q);
            mirror_space_error(reflected).length().max(mapped_error(reflected).length())
        };
        // Plane z = 0: the point is on the line to the mirrored eye.
        let eye = random_vector(&mut random) + Vec3::Z * 1.5;
        let q = random_vector(&mut random) + Vec3::Z * 1.5;
        let mirrored = eye * Vec3::new(1.0, 1.0, -1.0);
        let p = mirrored + (q - mirrored) * (eye.z / (eye.z + q.z));
        assert!(error(pixel(p, Vec3::Z, eye), q) < 1e-5);
        // Sphere: if eye and point are equally far from the centre, the reflection is half way between.
        let (a, b) = (random_vector(&mut random).normalize() * 3.0, random_vector(&mut random).normalize() * 3.0);
        let p = (a + b).normalize_or(Vec3::Y);
        assert!(error(pixel(p, p, a), b) < 1e-5);
        // Paraboloid z = (x^2 + y^2) / 4: light along the axis goes to the focus at z = 1.
        let (x, y) = (random.next() * 2.0 - 1.0, random.next() * 2.0 - 1.0);
        let p = Vec3::new(x, y, (x * x + y * y) / 4.0);
        let normal = Vec3::new(-x / 2.0, -y / 2.0, 1.0).normalize();
        let along = MirrorPixel { point: p, normal, toward_eye: Vec3::Z, linear_depth: 1.0 };
        assert!(error(along, Vec3::Z) < 1e-5);
    }
}

#[test]
fn the_angle_to_the_eye_is_the_same_with_point_and_eye_exchanged() {
    let mut random = Random(5);
    for _ in 0..500 {
        let normal = random_vector(&mut random).normalize();
        let (a, b) = (random_vector(&mut random), random_vector(&mut random));
        let angle = |eye: Vec3, q: Vec3| {
            let Vec2 { x, y } = error(&pixel(Vec3::ZERO, normal, eye), q);
            // From the tangents of the two angles, for a direction behind or in front of the plane across the eye's.
            let z = if x.abs() < std::f32::consts::FRAC_PI_2 { 1.0 } else { -1.0 };
            Vec3::new(x.tan() * z, y.tan() * z, z).angle_between(Vec3::Z)
        };
        assert!((angle(a, b) - angle(b, a)).abs() < 2e-3, "{} {}", angle(a, b), angle(b, a));
    }
}

#[test]
fn along_a_line_over_a_planar_or_convex_mirror_the_error_changes_its_sign_once() {
    let mut random = Random(7);
    let eye = Vec3::Z * 3.0;
    // Across a plane and across the visible side of a unit sphere, along the view's x axis through the mirror point.
    let plane = |t: f32| pixel(Vec3::new(t * 4.0, 0.0, 0.0), Vec3::Z, eye);
    let sphere = |t: f32| {
        let angle = t * 1.2;
        let normal = Vec3::new(angle.sin(), 0.0, angle.cos());
        pixel(normal, normal, eye)
    };
    for surface in [&plane as &dyn Fn(f32) -> MirrorPixel, &sphere] {
        for _ in 0..50 {
            let mirror_point = surface(random.next() * 1.6 - 0.8);
            let incoming =
                mirror_point.normal * 2.0 * mirror_point.normal.dot(mirror_point.toward_eye) - mirror_point.toward_eye;
            let q = mirror_point.point + incoming * (0.3 + random.next() * 3.0);
            // Only where the point is in front of the surface: behind it, the angle runs on past half a turn.
            let signs: Vec<bool> = (0..=400)
                .map(|step| surface(step as f32 / 200.0 - 1.0))
                .filter(|pixel| pixel.normal.dot(q - pixel.point) > 0.0)
                .map(|pixel| error(&pixel, q).x > 0.0)
                .collect();
            assert_eq!(signs.windows(2).filter(|pair| pair[0] != pair[1]).count(), 1);
        }
    }
}

#[test]
fn labels_by_contours_are_those_of_a_flood_fill() {
    let mut random = Random(11);
    for (round, size) in
        [[1, 1], [7, 1], [1, 9], [16, 12], [40, 30], [64, 48]].into_iter().cycle().take(240).enumerate()
    {
        let size = UVec2::from_array(size);
        let density = 0.3 + 0.5 * (round as f32 / 240.0);
        let inside: Vec<bool> = (0..size.x * size.y).map(|_| random.next() < density).collect();
        assert_eq!(twin::label_by_contours(&inside, size), flood_fill(&inside, size), "{inside:?} {size}");
    }
}

fn flood_fill(inside: &[bool], size: UVec2) -> Vec<u32> {
    let width = size.x as usize;
    let (mut labels, mut count) = (vec![0; inside.len()], 0);
    for start in 0..inside.len() {
        if !inside[start] || labels[start] != 0 {
            continue;
        }
        count += 1;
        let mut front = vec![start];
        while let Some(at) = front.pop() {
            if !inside[at] || labels[at] != 0 {
                continue;
            }
            labels[at] = count;
            let x = at % width;
            front.extend((x > 0).then(|| at - 1));
            front.extend((x + 1 < width).then_some(at + 1));
            front.extend(at.checked_sub(width));
            front.extend((at + width < inside.len()).then_some(at + width));
        }
    }
    labels
}
