//! Claims about the splats of scans that are even in angle: dense at the scanner and sparse far from it.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use cloud::{
    Chunk, Orientation, Progress, RadiusRule, Random, SeenFrom, SurfelOptions, Surfels, estimate, hash, neighbourhoods,
    resized_radius, stray_kind, stretch_ratio, unpack_normal, unpack_radius, unpack_stretch,
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

/// The rows of two scanners that see a floor from the side of its far end, some 22 m away, where they cross at a few degrees.
fn rows_of_two() -> Vec<Vec3> {
    let step = 0.2_f32.to_radians();
    let mut points = Vec::new();
    for (station, row, column) in (0..2).flat_map(|s| (15..30).flat_map(move |r| (-60..=60).map(move |c| (s, r, c)))) {
        let place = [Vec3::new(0.0, 0.0, 1.5), Vec3::new(1.1, 2.4, 1.5)][station];
        let (elevation, azimuth) = (-(row as f32) * step, column as f32 * step);
        let range = 1.5 / -elevation.sin();
        let way = Vec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
        points.push(place + range * way);
    }
    points
}

#[test]
fn rows_of_two_stations_that_lie_between_one_another_close_the_floor() {
    let points = rows_of_two();
    let surfels = surfels(&points);
    let mut random = Random(9);
    let mut share = || random.below(1000) as f32 / 1000.0;
    let places: Vec<Vec3> = (0..400).map(|_| Vec3::new(16.5 + 6.0 * share(), 2.0 * share(), 0.0)).collect();
    let covered = places.iter().filter(|place| is_covered(**place, &points, &surfels)).count();
    assert!(covered >= 392, "{covered} of 400");
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

/// The kinds of points by `stray_kind`, the number of each.
fn kinds(radii: &[u16]) -> [usize; 3] {
    let mut counts = [0; 3];
    radii.iter().for_each(|radius| counts[usize::from(stray_kind(*radius))] += 1);
    counts
}

/// Points between the edge of a wall and the wall behind it, as a scanner at the origin measures them: rays that an edge
/// splits have any range between its own and that of what is behind. Then some points of nothing in the air, and the walls.
fn edge() -> (Vec<Vec3>, usize, usize) {
    let mut random = Random(8);
    let mut share = || random.below(1000) as f32 / 1000.0;
    let between = (0..40).map(|_| {
        let distance = 2.3 + 1.4 * share();
        Vec3::new(distance, 0.5 * distance, share() * distance)
    });
    let mut points: Vec<Vec3> = between.collect();
    points.extend([[3.0, 3.0, 0.5], [3.1, 4.4, 1.0], [2.6, 2.6, 2.2], [3.3, 3.6, 2.6]].map(Vec3::from));
    let strays = points.len() - 40;
    points.extend(wall(2.0, 1.0, 0.005));
    points.extend(wall(4.0, 3.0, 0.01).into_iter().map(|point| point.with_y(point.y + 2.0)));
    (points, 40, strays)
}

#[test]
fn points_between_the_edge_of_a_thing_and_what_is_behind_it_are_mixed_pixels() {
    let (points, between, strays) = edge();
    let radii = surfels(&points).radii;
    let [on_surface, lone, mixed] = kinds(&radii[..between]);
    assert!(on_surface <= 2 && mixed >= 36, "{on_surface} on a surface, {lone} lone, {mixed} mixed of 40");
    let [on_surface, _, mixed] = kinds(&radii[between..between + strays]);
    assert!(on_surface == 0 && mixed <= 1, "{on_surface} on a surface, {mixed} mixed of {strays} strays");
    assert_eq!(kinds(&radii[between + strays..])[1..], [0, 0]);
}

#[test]
fn the_sparse_part_of_a_dense_surface_is_no_stray() {
    // A scanner does not see the floor below itself; another one measures it there, far more sparsely.
    let floor = |step: f32, is_in: &dyn Fn(f32) -> bool| {
        let count = (3.0 / step) as i32;
        let place = |i: i32| Vec3::new((i % count) as f32 * step - 1.5, (i / count) as f32 * step - 1.5, 0.0);
        (0..count * count).map(place).filter(|place| is_in(place.length())).collect::<Vec<_>>()
    };
    let sparse = floor(0.06, &|distance| distance < 0.5);
    let count = sparse.len();
    let radii = surfels(&[sparse, floor(0.01, &|distance| distance >= 0.5)].concat()).radii;
    assert_eq!(kinds(&radii)[1..], [0, 0], "of {count}");
}

#[test]
fn strays_are_counted_as_they_are_estimated() {
    let (points, ..) = edge();
    let [_, lone, mixed] = kinds(&surfels(&points).radii);
    let chunk = Chunk::new(0, DVec3::ZERO, points.iter().map(|point| point.to_array()).collect());
    let found = neighbourhoods(&[chunk], 6, &Progress::default()).unwrap();
    assert_eq!([found.strays, found.mixed], [lone as u64, mixed as u64]);
}

#[test]
fn the_order_of_points_changes_no_surfel() {
    // Several tiles, with grids whose distances tie, rows, strays and places with two points.
    let (mut points, ..) = edge();
    points.extend(floor(0.002).into_iter().map(|point| point - Vec3::new(0.0, 0.0, 3.0)));
    points.extend_from_within(..300);
    let estimated = |order: &[usize], neighbours: usize| {
        let chunk =
            |order: &[usize]| Chunk::new(0, DVec3::ZERO, order.iter().map(|at| points[*at].to_array()).collect());
        let chunks: Vec<Chunk> = order.chunks(30_000).map(chunk).collect();
        let radii = RadiusRule::Spread;
        let options = SurfelOptions { radii, neighbours, ..SurfelOptions::new(Orientation::Up(Vec3::Z)) };
        let surfels = estimate(&chunks, &options, &Progress::default()).unwrap();
        let found = surfels.into_iter().flat_map(|surfels| surfels.normals.into_iter().zip(surfels.radii));
        let mut found: Vec<(usize, (u32, u16))> = order.iter().copied().zip(found).collect();
        found.sort_unstable();
        found
    };
    let in_order: Vec<usize> = (0..points.len()).collect();
    let mut shuffled = in_order.clone();
    shuffled.sort_by_key(|at| hash(*at as u64));
    for neighbours in [16, 24] {
        let (one, other) = (estimated(&in_order, neighbours), estimated(&shuffled, neighbours));
        let differing = one.iter().zip(&other).filter(|(one, other)| one != other).count();
        assert_eq!(differing, 0, "of {} with {neighbours} neighbours", points.len());
    }
}

/// What a scanner 1.5 m above a floor sees of it up to an edge aslant, and of another floor 2 m below: the points of the
/// upper one, and of the lower one.
fn floors() -> [Vec<Vec3>; 2] {
    let step = 0.2_f32.to_radians();
    let way = |row: i32, column: i32| {
        let ((sine, cosine), (across, along)) = ((-row as f32 * step).sin_cos(), (column as f32 * step).sin_cos());
        Vec3::new(cosine * along, cosine * across, sine)
    };
    let ways = (25..70).flat_map(|row| (-60..=60).map(move |column| way(row, column)));
    let met = |way: Vec3, below: f32| Vec3::Z * 1.5 - way * (below / way.z);
    let (upper, lower): (Vec<Vec3>, Vec<Vec3>) = ways.partition(|way| {
        let met = met(*way, 1.5);
        met.x + 0.8 * met.y < 11.0
    });
    [(upper, 1.5), (lower, 3.5)].map(|(ways, below)| ways.into_iter().map(|way| met(way, below)).collect())
}

#[test]
fn ellipses_end_before_they_hide_a_point_from_their_scanner_and_stay_ellipses() {
    let ([upper, lower], scanner) = (floors(), DVec3::Z * 1.5);
    let chunk = Chunk::new(0, DVec3::ZERO, upper.iter().chain(&lower).map(|point| point.to_array()).collect());
    let surfels = |seen_from| {
        let options = SurfelOptions::new(Orientation::Toward(scanner));
        let options = SurfelOptions { radii: RadiusRule::Spread, seen_from, ..options };
        estimate(std::slice::from_ref(&chunk), &options, &Progress::default()).unwrap().swap_remove(0)
    };
    // Where the sightlines to the points of the lower floor pass the upper one.
    let passed: Vec<Vec3> = lower.iter().map(|own| scanner.as_vec3().lerp(*own, 1.5 / 3.5)).collect();
    let hides = |middle: Vec3, packed: u16, normal: u32| {
        let radius = unpack_radius(packed).unwrap();
        let axis = unpack_stretch(packed, unpack_normal(normal).unwrap()).map_or(Vec3::ZERO, |stretch| stretch.axis);
        passed.iter().any(|passed| {
            let offset = *passed - middle;
            let along = offset.dot(axis).powi(2);
            let across = offset.length_squared() - along;
            along + across * stretch_ratio(packed).powi(2) <= radius * radius
        })
    };
    let (before, after) = (surfels(None), surfels(Some(SeenFrom::Place(scanner))));
    let (mut hiding, mut ellipses, mut longer) = (0, 0, 0);
    for (index, &middle) in upper.iter().enumerate() {
        let (own, carved) = (before.radii[index], after.radii[index]);
        // Half as long again, which closes holes.
        let long = resized_radius(own, 1.5);
        hiding += usize::from(hides(middle, long, before.normals[index]));
        assert!(!hides(middle, carved, after.normals[index]), "{middle} hides a point from the scanner");
        if stretch_ratio(own) > 1.0 {
            assert!(stretch_ratio(carved) > 1.0, "the ellipse at {middle} is no longer one");
            assert_eq!(after.normals[index], before.normals[index]);
            ellipses += 1;
            longer += usize::from(carved.abs_diff(long) <= 32);
        }
    }
    assert!(hiding > 20 && ellipses > 1000, "{hiding} would hide points, {ellipses} ellipses");
    assert!(longer > ellipses * 9 / 10, "{longer} of {ellipses} ellipses became longer");
}

#[test]
fn discs_end_before_they_hide_a_point_from_another_station_that_saw_it() {
    // Of a wall at z = 2 the one station sees the half left of x = 0, and of a wall at z = 3 the other one sees what is
    // past the edge of the first.
    let stations = [DVec3::ZERO, DVec3::new(1.51, 0.0, 0.0)];
    let step = 0.02;
    let pixels = (-40..40).flat_map(|i| (-40..40).map(move |j| Vec3::new(i as f32 + 0.5, j as f32 + 0.5, 1.0 / step)));
    let near: Vec<Vec3> = pixels.clone().filter(|way| way.x < 0.0).map(|way| way * step * 2.0).collect();
    let far: Vec<Vec3> = pixels.map(|way| stations[1].as_vec3() + way * step * 3.0).collect();
    // The other station sees the wall behind past the edge of the one before it, and not through it.
    let passed = |far: &Vec3| stations[1].as_vec3().lerp(*far, 2.0 / 3.0);
    let far: Vec<Vec3> = far.into_iter().filter(|far| passed(far).x > 0.0).collect();
    let chunk = |(points, station): (&Vec<Vec3>, DVec3)| {
        let positions = points.iter().map(|point| point.to_array()).collect();
        Chunk { station: Some(station), ..Chunk::new(0, DVec3::ZERO, positions) }
    };
    let chunks: Vec<Chunk> = [&near, &far].into_iter().zip(stations).map(chunk).collect();
    let radii = |chunks: &[Chunk], seen_from| {
        let options = SurfelOptions { seen_from, ..SurfelOptions::new(Orientation::Toward(DVec3::ZERO)) };
        estimate(chunks, &options, &Progress::default()).unwrap().swap_remove(0).radii
    };
    let hiding = |radii: &[u16]| {
        let hides = |(middle, radius): &(&Vec3, &u16)| {
            far.iter().any(|far| passed(far).distance(**middle) < unpack_radius(**radius).unwrap())
        };
        near.iter().zip(radii).filter(hides).count()
    };
    let (before, after) = (radii(&chunks, None), radii(&chunks, Some(SeenFrom::Stations)));
    assert!(hiding(&before) > 30, "{} discs hid a point before", hiding(&before));
    assert_eq!(hiding(&after), 0);
    // As seen from the first station alone nothing is behind the rim.
    let unknown = Chunk { station: None, ..chunks[1].clone() };
    let alone = radii(&[chunks[0].clone(), unknown], Some(SeenFrom::Stations));
    assert!(hiding(&alone) > 30, "{} discs hide a point from the other station", hiding(&alone));
    let wider = before.iter().zip(&after).filter(|(before, after)| after > before).count();
    assert!(wider > near.len() * 9 / 10, "{wider} of {} discs are wider", near.len());
}
