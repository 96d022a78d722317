//! Claims about the splats of scans that are even in angle: dense at the scanner and sparse far from it.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use cloud::{
    Chunk, Orientation, Progress, RadiusRule, Random, STRAY_RADIUS, SurfelOptions, Surfels, estimate, stretch_ratio,
    unpack_normal, unpack_radius, unpack_stretch,
};
use glam::{DVec3, Vec3};

fn surfels(points: &[Vec3]) -> Surfels {
    let chunk = Chunk::new(0, DVec3::ZERO, points.iter().map(|point| point.to_array()).collect());
    let options = SurfelOptions { radii: RadiusRule::Spread, ..SurfelOptions::new(Orientation::Up(Vec3::Z)) };
    estimate(&[chunk], &options, &Progress::default()).unwrap().swap_remove(0)
}

/// What a scanner 1.5 m above a floor sees of it, in steps of 0.2 degrees, with so much noise along its rays.
fn floor(noise: f32) -> Vec<Vec3> {
    let mut random = Random(5);
    let step = 0.2_f32.to_radians();
    let mut points = Vec::new();
    for row in 0..285 {
        let elevation = -60.0_f32.to_radians() + row as f32 * step;
        for column in -60..=60 {
            let (sine, cosine) = (column as f32 * step).sin_cos();
            let way = Vec3::new(elevation.cos() * cosine, elevation.cos() * sine, elevation.sin());
            let range = -1.5 / way.z + noise * (random.below(2001) as f32 / 1000.0 - 1.0);
            points.push(Vec3::new(0.0, 0.0, 1.5) + range * way);
        }
    }
    points
}

/// Whether a place of the floor is within a splat.
fn is_covered(place: Vec3, points: &[Vec3], surfels: &Surfels) -> bool {
    points.iter().zip(&surfels.radii).zip(&surfels.normals).any(|((point, &packed), &normal)| {
        let offset = (place - point).with_z(0.0);
        let radius = unpack_radius(packed).unwrap();
        let along = unpack_normal(normal).and_then(|normal| unpack_stretch(packed, normal));
        let along = along.map_or(0.0, |stretch| offset.dot(stretch.axis));
        let across = offset.length_squared() - along * along;
        along * along + across * stretch_ratio(packed).powi(2) <= radius * radius
    })
}

#[test]
fn a_floor_is_closed_from_the_scanner_to_where_it_grazes_at_three_degrees() {
    for noise in [0.0, 0.002] {
        let points = floor(noise);
        let surfels = surfels(&points);
        let mut random = Random(6);
        let mut places = (0..).map(|_| {
            let (distance, side) =
                (3.0 + 22.0 * random.below(1000) as f32 / 1000.0, random.below(1000) as f32 / 1000.0);
            Vec3::new(distance, (side - 0.5) * 0.3 * distance, 0.0)
        });
        let places: Vec<Vec3> = places.by_ref().take(400).collect();
        let covered = places.iter().filter(|place| is_covered(**place, &points, &surfels)).count();
        assert!(covered >= 392, "noise {noise}: {covered} of 400");
        // Far away the splats are ellipses in the floor, and no splat is longer than the way to the next row.
        for ((point, &packed), &normal) in points.iter().zip(&surfels.radii).zip(&surfels.normals) {
            let (distance, side) = (point.x, point.y.abs() / point.x);
            let apart = (0.2_f32).to_radians() * distance * distance / 1.5;
            if side > 0.15 || !(14.0..22.0).contains(&distance) {
                continue;
            }
            assert!(unpack_normal(normal).unwrap().z > 0.99, "noise {noise}: {point}");
            assert!(stretch_ratio(packed) > 1.0 && unpack_radius(packed).unwrap() < apart, "noise {noise}: {point}");
        }
    }
}

/// A square of wall `size` wide whose points are `step` apart, at a distance along x.
fn wall(distance: f32, size: f32, step: f32) -> Vec<Vec3> {
    let count = (size / step) as i32;
    let point = |i: i32| Vec3::new(distance, (i % count) as f32 * step, (i / count) as f32 * step);
    (0..count * count).map(point).collect()
}

#[test]
fn a_radius_follows_from_the_points_around_and_not_from_the_whole_cloud() {
    let mut random = Random(7);
    let mut aside = || random.below(1000) as f32 / 3000.0;
    let far: Vec<Vec3> =
        wall(400.0, 20.0, 1.0).into_iter().map(|point| point + Vec3::new(0.0, aside(), aside())).collect();
    let alone = surfels(&far);
    let dense = wall(3.0, 1.0, 0.004);
    let together = surfels(&[far.clone(), dense].concat());
    for (one, other) in together.radii.iter().zip(&alone.radii) {
        let [one, other] = [one, other].map(|radius| unpack_radius(*radius).unwrap());
        assert!((one / other - 1.0).abs() < 0.012, "{one} beside a dense wall far away, and {other}");
    }
    assert!(unpack_radius(alone.radii[10 * 20 + 10]).unwrap() > 0.8);
}

#[test]
fn points_between_the_edge_of_a_thing_and_what_is_behind_it_are_strays() {
    // Rays that an edge splits have any range between its own and that of the wall behind.
    let edge = |i: u64| {
        let mut random = Random(i);
        let distance = 2.3 + 1.4 * random.below(1000) as f32 / 1000.0;
        Vec3::new(distance, 0.5 * distance, random.below(1000) as f32 / 1000.0 * distance)
    };
    let between: Vec<Vec3> = (0..40).map(edge).collect();
    let mut points = between.clone();
    points.extend(wall(2.0, 1.0, 0.005));
    points.extend(wall(4.0, 3.0, 0.01).into_iter().map(|point| point.with_y(point.y + 2.0)));
    let surfels = surfels(&points);
    let strays = |radii: &[u16]| radii.iter().filter(|radius| **radius == STRAY_RADIUS).count();
    let found = strays(&surfels.radii[..between.len()]);
    assert!(found >= 38, "{found} of 40");
    assert_eq!(strays(&surfels.radii[between.len()..]), 0);
}
