//! Claims about estimated normals and radii, on clouds whose truth is known.

use std::sync::Arc;

use cloud::sampling::{Surface, SurfacePoint};
use cloud::{
    Bounds, Chunk, NO_NORMAL, NO_RADIUS, Orientation, Progress, RadiusRule, STRAY_RADIUS, SurfelOptions, Surfels,
    estimate, guess_orientation, normals_from_triangles, pack_normal, provisional_radius, unpack_normal, unpack_radius,
};
use glam::{DVec3, Vec3};

fn chunked(positions: &[[f32; 3]], size: usize) -> Vec<Chunk> {
    chunked_at(positions, size, DVec3::ZERO)
}

fn chunked_at(positions: &[[f32; 3]], size: usize, origin: DVec3) -> Vec<Chunk> {
    positions.chunks(size).enumerate().map(|(i, part)| Chunk::new((i * size) as u64, origin, part.to_vec())).collect()
}

fn positions(points: &[SurfacePoint]) -> Vec<[f32; 3]> {
    points.iter().map(|point| point.position.as_vec3().to_array()).collect()
}

fn run(chunks: &[Chunk], orientation: Orientation) -> Surfels {
    let surfels = estimate(chunks, &SurfelOptions::new(orientation), &Progress::default()).expect("not cancelled");
    assert_eq!(surfels.len(), chunks.len());
    for (surfels, chunk) in surfels.iter().zip(chunks) {
        assert_eq!((surfels.normals.len(), surfels.radii.len()), (chunk.len(), chunk.len()));
    }
    Surfels {
        normals: surfels.iter().flat_map(|surfels| surfels.normals.clone()).collect(),
        radii: surfels.iter().flat_map(|surfels| surfels.radii.clone()).collect(),
    }
}

/// Evenly random in 0 .. 1.
fn random(seed: u64) -> f64 {
    cloud::hash(seed) as f64 / u64::MAX as f64
}

/// Hills 512 wide with coordinates on a grid of 2^-13, whose differences f32 holds exactly.
fn hills(points: usize) -> Vec<[f32; 3]> {
    let point = |i: usize| {
        let (x, y) = (512.0 * random(2 * i as u64 + 1), 512.0 * random(2 * i as u64 + 2));
        let z = 9.0 * (x / 40.0).sin() * (y / 30.0).cos();
        [x, y, z].map(|v| ((v * 8192.0).round() / 8192.0) as f32)
    };
    (0..points).map(point).collect()
}

fn degrees_between(a: Vec3, b: Vec3) -> f32 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// Median and 99th percentile of the angle to the true normals, whichever way these point.
fn normal_errors(surface: &Surface, count: usize) -> (f32, f32) {
    let points = surface.sample(count, 7);
    let surfels = run(&chunked(&positions(&points), 10_000), Orientation::AwayFrom(DVec3::ZERO));
    let error = |(&normal, point): (&u32, &SurfacePoint)| {
        let angle = degrees_between(unpack_normal(normal).expect("a normal"), point.normal.as_vec3());
        angle.min(180.0 - angle)
    };
    let mut errors: Vec<f32> = surfels.normals.iter().zip(&points).map(error).collect();
    errors.sort_by(f32::total_cmp);
    (errors[count / 2], errors[count * 99 / 100])
}

const SPHERE: Surface = Surface::Sphere { radius: 1.0 };
const TORUS: Surface = Surface::Torus { ring: 1.0, tube: 0.4 };
const SQUARE: Surface = Surface::Rectangle {
    corner: DVec3::new(-1.0, -1.0, 0.5),
    edges: [DVec3::new(2.0, 0.0, 0.0), DVec3::new(0.0, 2.0, 0.0)],
};

#[test]
fn normals_of_a_plane_are_exact() {
    let (median, most) = normal_errors(&SQUARE, 50_000);
    assert!(median < 0.01 && most < 0.01, "{median}, {most}");
}

#[test]
fn normals_of_sphere_and_torus_are_off_by_degrees_that_fall_with_density() {
    for surface in [SPHERE, TORUS] {
        let [coarse, fine, finest] = [2_000, 20_000, 200_000].map(|count| normal_errors(&surface, count));
        assert!(coarse.0 < 3.0 && coarse.1 < 8.0, "{surface:?}: {coarse:?}");
        assert!(fine.0 < coarse.0 / 2.0 && fine.1 < coarse.1 / 2.0, "{surface:?}: {coarse:?} to {fine:?}");
        assert!(finest.0 < fine.0 / 2.0 && finest.1 < fine.1 / 2.0, "{surface:?}: {fine:?} to {finest:?}");
    }
}

#[test]
fn normals_point_away_from_or_towards_the_place_given() {
    let sphere = positions(&SPHERE.sample(20_000, 1));
    for (orientation, sign) in [(Orientation::AwayFrom(DVec3::ZERO), 1.0), (Orientation::Toward(DVec3::ZERO), -1.0)] {
        let surfels = run(&chunked(&sphere, 8192), orientation);
        for (&normal, &position) in surfels.normals.iter().zip(&sphere) {
            assert!(unpack_normal(normal).expect("a normal").dot(Vec3::from(position)) * sign > 0.9);
        }
    }
}

#[test]
fn radii_of_evenly_sampled_surfaces_follow_from_area_and_number() {
    for surface in [SQUARE, SPHERE, TORUS] {
        let count = 100_000;
        let surfels = run(&chunked(&positions(&surface.sample(count, 3)), 65_536), Orientation::Up(Vec3::Z));
        let expected =
            f64::from(cloud::SPLAT_OVERLAP) * (surface.area() / (std::f64::consts::PI * count as f64)).sqrt();
        let mut radii: Vec<f32> =
            surfels.radii.iter().map(|&radius| unpack_radius(radius).expect("a radius")).collect();
        radii.sort_by(f32::total_cmp);
        let ratio = f64::from(radii[count / 2]) / expected;
        assert!((ratio - 1.0).abs() < 0.05, "{surface:?}: median radius is {ratio} of the formula's");
        // Only points at the square's rim, whose neighbours lie on one side, have larger splats.
        let ratio = f64::from(radii[count * 98 / 100]) / expected;
        assert!(ratio < 1.3, "{surface:?}: 98 % are below {ratio}");
    }
}

#[test]
fn radii_are_those_of_exhaustive_search() {
    // Several tiles, clusters, strays far away and above: wherever a search could miss a neighbour.
    let mut cloud = hills(150_000);
    cloud.extend((0..300).map(|i| [random(900 + i), random(1900 + i), random(2900 + i)].map(|v| (3000.0 * v) as f32)));
    cloud.extend((0..3000).map(|i| [random(i), random(5000 + i), random(9000 + i)].map(|v| 100.0 + 0.1 * v as f32)));
    cloud.extend([[1e6, 1e6, 1e6], [-1e6, 5.0, 0.0]]);
    let neighbours = 9;
    let options = SurfelOptions {
        neighbours,
        orientation: Orientation::Up(Vec3::Z),
        radii: cloud::RadiusRule::Full,
        seen_from: None,
    };
    let surfels = estimate(&chunked(&cloud, 40_000), &options, &Progress::default()).expect("not cancelled");
    let radii: Vec<u16> = surfels.into_iter().flat_map(|surfels| surfels.radii).collect();
    // Search rounds offsets within a tile some hundred wide to f32, which moves points of the narrow cluster.
    let rounding = f64::from(512.0_f32.next_up() - 512.0);
    let (mut exact, mut all) = (0, 0);
    let checked = (0..cloud.len()).step_by(997).chain(150_000..cloud.len());
    for index in checked.step_by(11) {
        let from = DVec3::from(cloud[index].map(f64::from));
        let mut distances: Vec<f64> =
            cloud.iter().map(|p| DVec3::from(p.map(f64::from)).distance(from)).filter(|d| *d > 0.0).collect();
        let distance = *distances.select_nth_unstable_by(neighbours - 1, f64::total_cmp).1;
        let radius_at =
            |distance: f64| (f64::from(cloud::SPLAT_OVERLAP) * distance / (neighbours as f64).sqrt()) as f32;
        let (least, most) = (radius_at(distance - rounding), radius_at(distance + rounding));
        let radius = unpack_radius(radii[index]).expect("a radius");
        assert!(radius < 1.006 * most, "point {index}: {radius}, not {least} to {most}");
        // Radii are bounded by those around where the neighbours are crowded, like those of a stray point.
        let is_exact = radius > 0.994 * least;
        assert!(is_exact || index >= 150_000 || distance > 2.5, "point {index}: {radius}, not {least} to {most}");
        exact += usize::from(is_exact);
        all += 1;
    }
    assert!(exact * 10 > all * 8, "{exact} of {all}");
}

#[test]
fn chunks_do_not_change_the_result() {
    let cloud = hills(200_000);
    let whole = run(&chunked(&cloud, cloud.len()), Orientation::Up(Vec3::Z));
    for size in [65_536, 10_007, 313] {
        assert_eq!(run(&chunked(&cloud, size), Orientation::Up(Vec3::Z)), whole, "chunks of {size}");
    }
    // Chunks with origins of their own: the same positions up to nothing, as coordinates are on a coarse grid.
    let shifted: Vec<Chunk> = chunked(&cloud, 5_000)
        .into_iter()
        .map(|chunk| {
            let shift = Vec3::from(chunk.positions[0]);
            let moved = chunk.positions.iter().map(|&p| (Vec3::from(p) - shift).to_array()).collect();
            Chunk::new(chunk.first_point, shift.as_dvec3(), moved)
        })
        .collect();
    assert_eq!(run(&shifted, Orientation::Up(Vec3::Z)), whole);
}

#[test]
fn point_order_does_not_change_the_result() {
    let cloud = hills(150_000);
    let order: Vec<usize> = (0..cloud.len()).map(|i| i * 65_537 % cloud.len()).collect();
    let shuffled: Vec<[f32; 3]> = order.iter().map(|&index| cloud[index]).collect();
    let (a, b) = (
        run(&chunked(&cloud, 9999), Orientation::Up(Vec3::Z)),
        run(&chunked(&shuffled, 9999), Orientation::Up(Vec3::Z)),
    );
    for (place, &index) in order.iter().enumerate() {
        assert_eq!((b.radii[place], b.normals[place]), (a.radii[index], a.normals[index]));
    }
}

#[test]
fn points_of_a_grid_have_symmetric_neighbours_in_any_order() {
    // Every search ends in a tie here: which of the tied come first in the file must not matter.
    let grid: Vec<[f32; 3]> =
        (0..10_000).map(|i| [(i % 100) as f32, (i / 100) as f32, ((i % 100) as f32 / 9.0).sin()]).collect();
    let backwards: Vec<[f32; 3]> = grid.iter().rev().copied().collect();
    let (a, b) =
        (run(&chunked(&grid, 777), Orientation::Up(Vec3::Z)), run(&chunked(&backwards, 777), Orientation::Up(Vec3::Z)));
    for (&one, &other) in a.normals.iter().zip(b.normals.iter().rev()) {
        let [one, other] = [one, other].map(|normal| unpack_normal(normal).expect("a normal"));
        assert!(degrees_between(one, other) < 0.02, "{one} and {other}");
    }
}

#[test]
fn coordinates_of_seven_digits_cost_no_accuracy() {
    let cloud = hills(100_000);
    let near = run(&chunked(&cloud, 8192), Orientation::Up(Vec3::Z));
    let far =
        run(&chunked_at(&cloud, 8192, DVec3::new(6_312_345.25, 5_077_123.5, -1_000_000.0)), Orientation::Up(Vec3::Z));
    let packed = |surfels: &Surfels| surfels.radii.iter().copied().zip(surfels.normals.clone()).collect::<Vec<_>>();
    for ((radius, normal), (far_radius, far_normal)) in packed(&near).into_iter().zip(packed(&far)) {
        // Other coordinates divide space elsewhere: sums in another order differ in their last digits.
        assert!(radius.abs_diff(far_radius) <= 32, "{radius} and {far_radius}");
        let [one, other] = [normal, far_normal].map(|normal| unpack_normal(normal).expect("a normal"));
        assert!(degrees_between(one, other) < 0.05, "{one} and {other}");
    }
}

#[test]
fn points_that_are_not_finite_have_nothing_and_do_no_harm() {
    let clean = hills(50_000);
    let mut dirty = clean.clone();
    for i in 0..500 {
        dirty.insert(i * 90, [[f32::NAN, 1.0, 1.0], [1.0, f32::INFINITY, 1.0], [0.0, 0.0, f32::NEG_INFINITY]][i % 3]);
    }
    let expected = run(&chunked(&clean, 1000), Orientation::Up(Vec3::Z));
    let surfels = run(&chunked(&dirty, 1000), Orientation::Up(Vec3::Z));
    let mut left = expected.normals.iter().zip(&expected.radii);
    for (position, (&normal, &radius)) in dirty.iter().zip(surfels.normals.iter().zip(&surfels.radii)) {
        if position.iter().all(|v| v.is_finite()) {
            let (&expected_normal, &expected_radius) = left.next().expect("as many points");
            assert_eq!(radius, expected_radius);
            let [one, other] = [normal, expected_normal].map(|n| unpack_normal(n).expect("a normal"));
            assert!(degrees_between(one, other) < 0.05);
        } else {
            assert_eq!((normal, radius), (NO_NORMAL, NO_RADIUS));
        }
    }
}

#[test]
fn huge_and_tiny_coordinates_give_finite_results() {
    for scale in [1e-30_f32, 1e-12, 1e15, 1e30, f32::MAX] {
        let cloud: Vec<[f32; 3]> = (0..5000)
            .map(|i| [random(i + 1), random(i + 10_001), random(i + 20_001)].map(|v| v as f32 * scale))
            .collect();
        let surfels = run(&chunked(&cloud, 1000), Orientation::AwayFrom(DVec3::ZERO));
        assert!(surfels.normals.iter().all(|&normal| unpack_normal(normal).is_none_or(|n| n.is_finite())));
    }
}

#[test]
fn numbers_of_random_bits_give_finite_results() {
    // What a misread file gives: half of the squares over- or underflow.
    let bits = |seed: u64| f32::from_bits((random(seed) * f64::from(u32::MAX)) as u32);
    let noise: Vec<[f32; 3]> = (0..100_000).map(|i| [bits(3 * i + 1), bits(3 * i + 2), bits(3 * i + 3)]).collect();
    let surfels = run(&chunked(&noise, 65_536), Orientation::Up(Vec3::Z));
    assert!(surfels.normals.iter().all(|&normal| unpack_normal(normal).is_none_or(|normal| normal.is_finite())));
    assert!(surfels.radii.iter().any(|&radius| radius != NO_RADIUS));
}

#[test]
fn thousands_of_points_at_one_place_count_once() {
    let cloud = hills(100_000);
    let expected = run(&chunked(&cloud, 5000), Orientation::Up(Vec3::Z));
    // Two places in the middle of the hills hold a hundred thousand points each, in turn.
    let mut crowded = cloud.clone();
    crowded.extend((0..200_000).map(|i| cloud[1 + i % 2]));
    let surfels = run(&chunked(&crowded, 5000), Orientation::Up(Vec3::Z));
    for index in [1, 2, 100_000, 150_001, 299_999] {
        let place = if index < 100_000 { index } else { 1 + index % 2 };
        assert_eq!(surfels.radii[index], expected.radii[place], "point {index}");
        assert_eq!(surfels.normals[index], expected.normals[place], "point {index}");
    }
}

#[test]
fn a_cloud_that_is_one_place_has_no_normals_and_no_radii() {
    let surfels = run(&chunked(&vec![[1.0, 2.0, 3.0]; 200_000], 65_536), Orientation::Up(Vec3::Z));
    assert!(surfels.normals.iter().all(|&normal| normal == NO_NORMAL));
    assert!(surfels.radii.iter().all(|&radius| radius == NO_RADIUS));
}

#[test]
fn points_on_a_line_have_radii_but_no_normals() {
    let line: Vec<[f32; 3]> = (0..3000).map(|i| [i as f32, 2.0 * i as f32, -i as f32]).collect();
    let surfels = run(&chunked(&line, 500), Orientation::Up(Vec3::Z));
    assert!(surfels.normals.iter().all(|&normal| normal == NO_NORMAL));
    assert!(surfels.radii.iter().all(|&radius| unpack_radius(radius).is_some()));
}

#[test]
fn clouds_of_few_points_use_the_neighbours_there_are() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    for count in 0..=4 {
        let surfels = run(&chunked(&corners[..count], 2), Orientation::Up(Vec3::Z));
        let has = |yes| vec![yes; count];
        assert_eq!(
            surfels.radii.iter().map(|&r| r != NO_RADIUS).collect::<Vec<_>>(),
            has(count >= 2),
            "{count} points"
        );
        assert_eq!(
            surfels.normals.iter().map(|&n| n != NO_NORMAL).collect::<Vec<_>>(),
            has(count >= 3),
            "{count} points"
        );
    }
    let empty = Chunk::new(0, DVec3::ZERO, Vec::new());
    let full = Chunk::new(0, DVec3::ZERO, corners.to_vec());
    assert_eq!(run(&[empty.clone(), full, empty.clone(), empty], Orientation::Up(Vec3::Z)).radii.len(), 4);
}

#[test]
fn two_parallel_sheets_keep_their_own_normals() {
    // Ten spacings apart, as the two sides of a wall: both normals level, each towards the viewer's side of its sheet.
    let mut cloud = positions(&SQUARE.sample(40_000, 1));
    cloud.extend(positions(&SQUARE.sample(40_000, 2)).into_iter().map(|[x, y, z]| [x, y, z + 0.1]));
    let surfels = run(&chunked(&cloud, 30_000), Orientation::Toward(DVec3::new(0.0, 0.0, 0.55)));
    for (index, &normal) in surfels.normals.iter().enumerate() {
        let expected = if index < 40_000 { Vec3::Z } else { -Vec3::Z };
        assert!(degrees_between(unpack_normal(normal).expect("a normal"), expected) < 0.01, "point {index}");
    }
}

#[test]
fn a_stray_point_becomes_no_huge_splat() {
    let mut cloud = hills(20_000);
    cloud.push([100.0, 100.0, 50_000.0]);
    let surfels = run(&chunked(&cloud, 20_001), Orientation::Up(Vec3::Z));
    let mut radii: Vec<f32> = surfels.radii.iter().map(|&radius| unpack_radius(radius).expect("a radius")).collect();
    let stray = radii[20_000];
    radii.sort_by(f32::total_cmp);
    assert!(stray <= 2.5 * radii[10_000], "{stray} beside a median of {}", radii[10_000]);
}

#[test]
fn normals_a_chunk_has_are_kept_and_missing_ones_filled_in() {
    let mut chunks = chunked(&hills(3000), 1000);
    let odd = pack_normal(Vec3::new(1.0, 2.0, -3.0));
    let some = (0..1000).map(|i| if i % 2 == 0 { odd } else { NO_NORMAL }).collect();
    chunks[1].normals = Some(Arc::new(some));
    let surfels = run(&chunks, Orientation::Up(Vec3::Z));
    for index in 0..3000 {
        let normal = surfels.normals[index];
        let kept = (1000..2000).contains(&index) && index % 2 == 0;
        assert_eq!(normal == odd, kept, "point {index}");
        assert!(kept || unpack_normal(normal).expect("a normal").z > 0.0);
        assert_ne!(surfels.radii[index], NO_RADIUS);
    }
}

#[test]
fn neighbour_counts_at_and_beyond_their_limits_work() {
    let cloud = chunked(&positions(&SPHERE.sample(20_000, 1)), 20_000);
    for neighbours in [0, 3, 16, 17, 32, 33, 64, 1000] {
        let options = SurfelOptions {
            neighbours,
            orientation: Orientation::AwayFrom(DVec3::ZERO),
            radii: cloud::RadiusRule::Full,
            seen_from: None,
        };
        let surfels = estimate(&cloud, &options, &Progress::default()).expect("not cancelled");
        let close = |(&normal, position): (&u32, &[f32; 3])| {
            unpack_normal(normal).is_some_and(|normal| degrees_between(normal, Vec3::from(*position)) < 20.0)
        };
        let good = surfels[0].normals.iter().zip(cloud[0].positions.iter()).filter(|pair| close(*pair)).count();
        assert!(good > 19_000, "{neighbours} neighbours: {good} good normals");
    }
}

#[test]
fn progress_ends_at_its_total() {
    let mut cloud = hills(100_000);
    cloud[5] = [f32::NAN; 3];
    let progress = Progress::default();
    estimate(&chunked(&cloud, 4096), &SurfelOptions::new(Orientation::Up(Vec3::Z)), &progress).expect("not cancelled");
    assert_eq!((progress.done(), progress.total()), (100_000, 100_000));
}

#[test]
fn a_cancelled_estimate_returns_nothing_and_soon() {
    let chunks = chunked(&hills(400_000), 65_536);
    let options = SurfelOptions::new(Orientation::Up(Vec3::Z));
    let progress = Progress::default();
    progress.cancel();
    assert_eq!(estimate(&chunks, &options, &progress), None);
    assert_eq!(progress.done(), 0);
    let progress = Progress::default();
    std::thread::scope(|scope| {
        let worker = scope.spawn(|| estimate(&chunks, &options, &progress));
        while progress.done() == 0 && !worker.is_finished() {
            std::thread::yield_now();
        }
        progress.cancel();
        assert_eq!(worker.join().expect("no panic"), None);
    });
    assert!(progress.done() < 400_000);
}

#[test]
fn orientation_is_guessed_from_the_shape() {
    let up = Vec3::Z;
    assert_eq!(guess_orientation(&chunked(&hills(50_000), 8192), up), Orientation::Up(up));
    assert_eq!(guess_orientation(&[], up), Orientation::Up(up));
    let sphere = chunked(&positions(&SPHERE.sample(50_000, 1)), 8192);
    assert!(matches!(guess_orientation(&sphere, up), Orientation::AwayFrom(centre) if centre.length() < 0.1));
    let flat = chunked(&positions(&SQUARE.sample(50_000, 1)), 8192);
    assert_eq!(guess_orientation(&flat, up), Orientation::Up(up));
    // A room of 8 x 6 x 2.5 with some furniture.
    let mut room = Vec::new();
    for i in 0..50_000_u64 {
        let mut p = [8.0 * random(3 * i + 1), 6.0 * random(3 * i + 2), 2.5 * random(3 * i + 3)];
        match i % 8 {
            0 => p[0] = 0.0,
            1 => p[0] = 8.0,
            2 => p[1] = 0.0,
            3 => p[1] = 6.0,
            4 | 5 => p[2] = 0.0,
            6 => p[2] = 2.5,
            _ => p[2] *= 0.4,
        }
        room.push(p.map(|v| v as f32));
    }
    let guess = guess_orientation(&chunked(&room, 8192), up);
    assert!(
        matches!(guess, Orientation::Toward(centre) if centre.distance(DVec3::new(4.0, 3.0, 1.25)) < 0.1),
        "{guess:?}"
    );
}

#[test]
fn scanned_rooms_tilted_ones_and_few_points_of_one_are_seen_from_within() {
    let is_room = |points: &[[f32; 3]]| {
        let guess = guess_orientation(&chunked(points, 8192), Vec3::Z);
        assert!(matches!(guess, Orientation::Toward(_)), "{guess:?} of {} points", points.len());
    };
    // A scanner turns in even steps in the middle of a room of 8 x 8 x 2.4, and sees nothing steep below itself.
    let ray = |index: u32| {
        let [turn, tilt] = [f64::from(index % 360), f64::from(index / 360) - 60.0].map(f64::to_radians);
        let toward = DVec3::new(turn.cos() * tilt.cos(), turn.sin() * tilt.cos(), tilt.sin());
        let wall = 4.0 / toward.x.abs().max(toward.y.abs());
        let lid = if toward.z > 0.0 { 0.65 } else { 1.75 } / toward.z.abs();
        (toward * wall.min(lid)).as_vec3().to_array()
    };
    is_room(&(0..360 * 150).map(ray).collect::<Vec<_>>());
    // Floor and ceiling of a room of 10 x 10 x 2.5 that rise together by 4 degrees, and its walls.
    let tilted = |i: u64| {
        let mut p = [10.0 * random(3 * i + 1), 10.0 * random(3 * i + 2), 2.5 * random(3 * i + 3)];
        match i % 6 {
            side @ (0 | 1) => p[0] = 10.0 * side as f64,
            lid => p[2] = 2.5 * (lid % 2) as f64,
        }
        p[2] += p[0] * 4_f64.to_radians().tan();
        p.map(|v| v as f32)
    };
    is_room(&(0..50_000).map(tilted).collect::<Vec<_>>());
    is_room(&(0..300).map(tilted).collect::<Vec<_>>());
}

#[test]
fn a_field_with_a_pit_and_a_terrace_are_seen_from_above() {
    let up = Vec3::Z;
    // 20 by 20, on two levels, with a noise of some centimetres.
    let levels = |is_low: fn(f64, f64) -> bool| -> Vec<[f32; 3]> {
        let place = |i: u64| {
            let [x, y] = [20.0 * random(3 * i + 1), 20.0 * random(3 * i + 2)];
            let level = if is_low(x, y) { -1.5 } else { 0.0 };
            [x, y, level + 0.05 * random(3 * i + 3)].map(|v| v as f32)
        };
        (0..40_000).map(place).collect()
    };
    for is_low in [|x: f64, y: f64| (x - 10.0).abs() < 5.0 && (y - 10.0).abs() < 5.0, |x, _| x < 10.0] {
        assert_eq!(guess_orientation(&chunked(&levels(is_low), 8192), up), Orientation::Up(up));
    }
}

#[test]
fn a_strip_of_ground_is_seen_from_above_and_walls_corridors_and_beams_are_not() {
    let up = Vec3::Z;
    let guess = |count: u64, place: &dyn Fn(u64, [f64; 3]) -> [f64; 3]| {
        let point = |i: u64| place(i, [1, 2, 3].map(|next| random(3 * i + next))).map(|v| v as f32);
        guess_orientation(&chunked(&(0..count).map(point).collect::<Vec<_>>(), 8192), up)
    };
    // 500 by 5, as high as wide, with a noise of some centimetres; few points and many, along either axis.
    let ground = |x: f64, noise: f64| 3.0 * (x / 60.0).sin() + 0.1 * noise;
    for count in [1000, 50_000] {
        assert_eq!(guess(count, &|_, [x, y, z]| [500.0 * x, 5.0 * y, ground(500.0 * x, z)]), Orientation::Up(up));
        assert_eq!(guess(count, &|_, [x, y, z]| [5.0 * y, 500.0 * x, ground(500.0 * x, z)]), Orientation::Up(up));
    }
    // 2 km by 300 m that fall by 160 m, with birds and echoes below the ground.
    let with_noise = guess(50_000, &|i, [x, y, z]| {
        let stray = if i % 1000 == 0 { 240.0 * z - 120.0 } else { 0.0 };
        [2000.0 * x, 300.0 * y, 160.0 * x + stray]
    });
    assert_eq!(with_noise, Orientation::Up(up));
    for count in [300, 1000, 50_000] {
        let is_object = |place: &dyn Fn(u64, [f64; 3]) -> [f64; 3]| {
            let guess = guess(count, place);
            assert!(matches!(guess, Orientation::AwayFrom(_)), "{guess:?} of {count} points");
        };
        // A wall; the upper half of a pipe; one side of a roof.
        is_object(&|_, [x, y, z]| [50.0 * x, 0.2 * y, 3.0 * z]);
        is_object(&|_, [x, turn, _]| {
            let (sin, cos) = (turn * std::f64::consts::PI).sin_cos();
            [50.0 * x, 0.5 * cos, 0.5 * sin]
        });
        is_object(&|_, [x, y, _]| [50.0 * x, 4.0 * y, 2.0 * y]);
        // A corridor of 40 by 2 by 2.5.
        let corridor = guess(count, &|i, [x, y, z]| match i % 4 {
            lid @ (0 | 1) => [40.0 * x, 2.0 * y, 2.5 * lid as f64],
            side => [40.0 * x, 2.0 * (side - 2) as f64, 2.5 * z],
        });
        assert!(matches!(corridor, Orientation::Toward(_)), "{corridor:?} of {count} points");
    }
}

#[test]
fn mesh_normals_are_weighted_by_area_and_bad_triangles_are_counted() {
    // A flat square of two triangles, and a small steep one at its first corner; chunks split the vertices.
    let vertices = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 0.01],
        [0.0, 0.01, 0.0],
        [5.0, 5.0, 5.0],
    ];
    let triangles = [[0, 1, 2], [0, 2, 3], [0, 5, 4], [0, 1, 7], [u32::MAX, 0, 1], [1, 1, 2]];
    let mesh = normals_from_triangles(&chunked(&vertices, 3), &triangles);
    assert_eq!(mesh.skipped_triangles, 2);
    let normals: Vec<Option<Vec3>> = mesh.normals.iter().flatten().map(|&normal| unpack_normal(normal)).collect();
    assert_eq!(normals[1..4], [Some(Vec3::Z); 3]);
    assert!(degrees_between(normals[0].expect("a normal"), Vec3::Z) < 0.01);
    assert_eq!((normals[4], normals[6]), (Some(Vec3::X), None));
    assert_eq!(normals_from_triangles(&[], &[[0, 0, 0]]).skipped_triangles, 1);
}

#[test]
fn provisional_radius_of_a_plane_is_the_estimated_one() {
    let chunks = chunked(&positions(&SQUARE.sample(40_000, 1)), 8192);
    let bounds = chunks.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
    let provisional = provisional_radius(bounds, 40_000);
    let mut radii: Vec<f32> =
        run(&chunks, Orientation::Up(Vec3::Z)).radii.iter().map(|&r| unpack_radius(r).expect("a radius")).collect();
    radii.sort_by(f32::total_cmp);
    assert!((provisional / radii[20_000] - 1.0).abs() < 0.05, "{provisional} instead of {}", radii[20_000]);
    let line = Bounds { min: DVec3::ZERO, max: DVec3::new(10.0, 0.0, 0.0) };
    assert!(provisional_radius(line, 100) > 0.05);
    assert_eq!(provisional_radius(Bounds::EMPTY, 0), 0.0);
}

#[test]
fn a_cloud_stored_many_times_has_the_surfels_of_one_stored_once() {
    let cloud = hills(20_000);
    let expected = run(&chunked(&cloud, 5000), Orientation::Up(Vec3::Z));
    for copies in [2, 30] {
        let many: Vec<[f32; 3]> = (0..copies * cloud.len()).map(|i| cloud[i * 7 % cloud.len()]).collect();
        let surfels = run(&chunked(&many, 65_536), Orientation::Up(Vec3::Z));
        for index in 0..many.len() {
            assert_eq!(surfels.radii[index], expected.radii[index * 7 % cloud.len()]);
            let [one, other] = [surfels.normals[index], expected.normals[index * 7 % cloud.len()]]
                .map(|normal| unpack_normal(normal).expect("a normal"));
            assert!(degrees_between(one, other) < 0.05, "{copies} times: {one} and {other}");
        }
    }
}

#[test]
fn points_that_another_chunk_rounds_otherwise_are_at_one_place() {
    // Each copy of the hills is in chunks with origins of its own, all of them some hundred metres off: the same places, but
    // for the last digits.
    let cloud = hills(5_000);
    let copy = |number: u32| {
        let origin = DVec3::new(300.1, 150.3, 70.7) * f64::from(number + 1) / 10.0;
        let offset = |p: &[f32; 3]| (Vec3::from(*p).as_dvec3() - origin).as_vec3().to_array();
        Chunk::new(0, origin, cloud.iter().map(offset).collect())
    };
    let chunks: Vec<Chunk> = (0..40).map(copy).collect();
    let expected = run(&chunks[..1], Orientation::Up(Vec3::Z));
    let surfels = run(&chunks, Orientation::Up(Vec3::Z));
    let mut angles: Vec<f32> = (0..surfels.normals.len())
        .map(|index| {
            let [one, other] = [surfels.normals[index], expected.normals[index % cloud.len()]].map(unpack_normal);
            one.zip(other).map_or(90.0, |(one, other)| degrees_between(one, other))
        })
        .collect();
    angles.sort_by(f32::total_cmp);
    assert!(angles[angles.len() * 9 / 10] < 5.0, "{} degrees", angles[angles.len() * 9 / 10]);
}

fn radii_by(rule: RadiusRule, positions: &[[f32; 3]]) -> Vec<f32> {
    let options = SurfelOptions { radii: rule, ..SurfelOptions::new(Orientation::Up(Vec3::Z)) };
    let surfels = estimate(&chunked(positions, 500), &options, &Progress::default()).expect("not cancelled");
    surfels
        .iter()
        .flat_map(|surfels| surfels.radii.iter().map(|radius| unpack_radius(*radius).expect("a radius")))
        .collect()
}

/// A grid of 41 x 41 points: an inner point has the index 20 * 41 + 20, one on the border 20, one in a corner 0.
fn grid() -> Vec<[f32; 3]> {
    (0..41 * 41).map(|at| [(at % 41) as f32, (at / 41) as f32, 0.0]).collect()
}

#[test]
fn narrow_borders_make_splats_smaller_where_their_neighbours_lie_on_one_side() {
    let grid = grid();
    let (full, narrow) = (radii_by(RadiusRule::Full, &grid), radii_by(RadiusRule::Narrow, &grid));
    let share = |at: usize| narrow[at] / full[at];
    assert_eq!(narrow[20 * 41 + 20], full[20 * 41 + 20]);
    // The middle of the neighbours on the border is 18 / (16 * 3) = 0.375 aside, in the corner 25 sqrt(2) / (16 * 4).
    assert!((share(20) - 0.79).abs() < 0.01, "{}", share(20));
    assert!((share(0) - 0.577).abs() < 0.01, "{}", share(0));
}

#[test]
fn radii_by_spread_are_those_of_an_even_surface_at_its_border_too() {
    // At random, so that shares of area are those of a surface: the mean radius inside, along borders and in corners.
    let square: Vec<[f32; 3]> =
        (0..40_000).map(|at| [random(2 * at) as f32 * 200.0, random(2 * at + 1) as f32 * 200.0, 0.0]).collect();
    let (full, spread) = (radii_by(RadiusRule::Full, &square), radii_by(RadiusRule::Spread, &square));
    assert!(full.iter().zip(&spread).all(|(full, spread)| *spread <= full * 1.001));
    let mean = |radii: &[f32], is_wanted: &dyn Fn(f32, f32) -> bool| {
        let wanted = || square.iter().zip(radii).filter(|([x, y, _], _)| is_wanted(*x, *y));
        wanted().map(|(_, radius)| radius).sum::<f32>() / wanted().count() as f32
    };
    let inside = |x: f32, y: f32| x.min(200.0 - x).min(y).min(200.0 - y) > 5.0;
    let border = |x: f32, y: f32| x.min(200.0 - x) < 0.3 && y.min(200.0 - y) > 5.0;
    // A point has an area of 1, so the disc of 16 neighbours has a radius of 2.26 and the splat half of it.
    let area = 2.0 / std::f32::consts::PI.sqrt();
    assert!((mean(&spread, &inside) / area - 0.98).abs() < 0.03, "{}", mean(&spread, &inside));
    // In a half disc of radius R the spread is R sqrt(1 - 32 / (9 pi^2)) = 0.8 R, and R is the root of 2 larger; a tenth
    // is added to the spread.
    let (wide, even) = (mean(&full, &border), mean(&spread, &border));
    assert!((wide / area - 1.41).abs() < 0.1 && (even / area - 1.24).abs() < 0.06, "{wide}, {even}");
}

#[test]
fn radii_by_spread_make_dots_of_stray_points_and_of_what_is_no_surface() {
    let mut points = grid();
    let on_surface = points.len();
    // The point's 16 neighbours fill a disc with a radius of 2.26. The point is stray from 1.7 times that on.
    for (height, is_stray) in [(3.0, false), (4.5, true), (8.0, true), (100.0, true)] {
        points.truncate(on_surface);
        points.push([20.3, 20.4, height]);
        let (full, spread) = (radii_by(RadiusRule::Full, &points), radii_by(RadiusRule::Spread, &points));
        let dot = unpack_radius(STRAY_RADIUS).unwrap();
        assert_eq!(spread[on_surface] == dot, is_stray, "at {height}: {}", spread[on_surface]);
        assert!(full[on_surface] > 1.5 && spread[..on_surface].iter().all(|radius| *radius > 0.5));
        assert!(is_stray || spread[on_surface] < 0.8 * full[on_surface]);
    }
    // Points at random in a cube are as thick as wide; the floor of the share is 0.4.
    let tree: Vec<[f32; 3]> = (0..8000).map(|at| [0, 1, 2].map(|axis| random(3 * at + axis) as f32 * 20.0)).collect();
    let (full, spread) = (radii_by(RadiusRule::Full, &tree), radii_by(RadiusRule::Spread, &tree));
    let share = spread.iter().zip(&full).map(|(spread, full)| spread / full).sum::<f32>() / tree.len() as f32;
    assert!(share > 0.5 && share < 0.8, "{share}");
}

#[test]
fn leaves_are_small_and_noisy_walls_stay_closed() {
    const EACH: u64 = 12_000;
    let of = |at: u64, axis: u64| random(7 * at + axis) as f32;
    let about = |at: u64, axis: u64| of(at, axis) - 0.5;
    // A tree: leaves in a cube of one unit, with six points on each.
    let leaf = |at: u64| [0, 1, 2].map(|axis| of(90_000 + at / 6, axis) + 0.08 * about(at, axis));
    // The corner of a room: a wall, and a floor whose noise is larger than the distance between its points.
    let wall = |at: u64| [5.0, of(at, 0), of(at, 1)];
    let floor = |at: u64| [5.0 + of(at, 0), of(at, 1), 0.03 * (about(at, 2) + about(at, 3) + about(at, 4))];
    let mut points: Vec<[f32; 3]> = (0..EACH).map(leaf).collect();
    points.extend((EACH..2 * EACH).map(wall).chain((2 * EACH..3 * EACH).map(floor)));
    let radii = radii_by(RadiusRule::Spread, &points);
    let [tree, room] = [0, EACH as usize].map(|first| first..if first == 0 { EACH as usize } else { points.len() });
    // Discs among leaves end before the fourth neighbour.
    let fourth = |at: usize| {
        let place = Vec3::from(points[at]);
        let mut distances: Vec<f32> =
            points[tree.clone()].iter().map(|other| place.distance((*other).into())).collect();
        *distances.select_nth_unstable_by(4, f32::total_cmp).1
    };
    let sample: Vec<usize> = tree.clone().step_by(29).collect();
    let small = sample.iter().filter(|at| radii[**at] <= 0.65 * fourth(**at)).count() as f32 / sample.len() as f32;
    assert!(small > 0.9, "{small} of the points among leaves are small");
    // A point of a wall or floor has an area of 1 / EACH; discs of 1.2 times that leave no holes between even points.
    let closing = 1.2 / (std::f32::consts::PI * EACH as f32).sqrt();
    let closed = radii[room.clone()].iter().filter(|radius| **radius > closing).count() as f32 / room.len() as f32;
    assert!(closed > 0.95, "{closed} of the points of a room are large enough");
}
