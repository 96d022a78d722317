use super::*;

fn points(chunks: &[Chunk]) -> Vec<DVec3> {
    chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index))).collect()
}

#[test]
fn each_scan_has_the_rays_that_were_asked_for_and_the_same_seed_gives_the_same_points() {
    for tripod in Tripod::ALL {
        let one = points(&scan(tripod, 20_000, 1));
        let is_open = tripod == Tripod::Street;
        let least = if is_open { 8_000 } else { 19_500 };
        assert!((least..=20_500).contains(&one.len()), "{tripod:?}: {}", one.len());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert!(one == pool.install(|| points(&scan(tripod, 20_000, 1))), "{tripod:?} differs with the threads");
        assert!(tripod == Tripod::Room || one != points(&scan(tripod, 20_000, 2)), "{tripod:?} has no seed");
    }
}

#[test]
fn only_the_scan_of_one_station_is_seen_from_it() {
    for (tripod, is_scan) in
        [(Tripod::Room, true), (Tripod::Hall30, true), (Tripod::Even, false), (Tripod::Mixed, false)]
    {
        for seed in 1..4 {
            let station = tripod.stations()[0];
            assert_eq!(cloud::is_seen_from(&scan(tripod, 60_000, seed), station), is_scan, "{tripod:?}, seed {seed}");
            assert!(!cloud::is_seen_from(&scan(tripod, 60_000, seed), station + DVec3::new(1.5, 1.0, 0.4)));
        }
    }
}

/// The points of one station in a closed hall: one for each ray.
fn hall_points(survey: Survey, rays: f64) -> (Vec<DVec3>, DVec3) {
    let (solids, station) = (Tripod::Hall.solids(), Tripod::Hall.stations()[0]);
    let points = swept(&survey, &solids, station, rays, 1, 0);
    (points.into_iter().map(|(place, _)| place).collect(), station)
}

#[test]
fn rays_are_even_in_angle_so_that_spacing_grows_with_the_range() {
    let (points, station) = hall_points(CLEAN, 20_000.0);
    let [columns, rows] = grid(20_000.0);
    assert_eq!(
        (points.len(), rows as f64 / columns as f64),
        (columns * rows, (columns as f64 * 150.0 / 360.0).round() / columns as f64)
    );
    let step = TAU / columns as f64;
    let ways: Vec<DVec3> = points.iter().map(|point| (*point - station).normalize()).collect();
    for ray in 0..points.len() - columns {
        let up = ways[ray].angle_between(ways[ray + columns]);
        assert!((up / step - 1.0).abs() < 1e-6, "ray {ray}: {up}, expected {step}");
        if (ray + 1) % columns > 0 {
            // A chord across the row.
            let aside = ways[ray].distance(ways[ray + 1]);
            let expected = 2.0 * (step / 2.0).sin() * (1.0 - ways[ray].z.powi(2)).sqrt();
            assert!((aside / expected - 1.0).abs() < 1e-6, "ray {ray}: {aside}, expected {expected}");
        }
    }
    let lowest = ways.iter().map(|way| way.z).fold(1.0, f64::min);
    assert!(lowest >= -(60.0_f64.to_radians().sin()), "blind below 60 degrees: {lowest}");
}

#[test]
fn the_points_of_a_clean_scan_lie_on_what_was_scanned() {
    for tripod in [Tripod::Even, Tripod::Room, Tripod::Hall40] {
        let (solids, stations) = (tripod.solids(), tripod.stations());
        let clean = tripod.survey().noise == 0.0;
        let mut far = 0;
        let found = points(&scan(tripod, 5000, 1));
        for point in &found {
            let way = *point - stations[0];
            let hit = solid::nearest(&solids, stations[0], way.normalize()).unwrap();
            far += usize::from((hit.distance - way.length()).abs() > 1e-5);
        }
        assert!(if clean { far == 0 } else { far * 2 > found.len() }, "{tripod:?}: {far} of {}", found.len());
    }
}

#[test]
fn mixed_pixels_are_a_share_of_the_rays_and_lie_between_two_neighbours() {
    let (clean, station) = hall_points(CLEAN, 60_000.0);
    let (mixed, _) = hall_points(Survey { mixed: 2e-3, ..CLEAN }, 60_000.0);
    let columns = grid(60_000.0)[0];
    let range = |point: &DVec3| point.distance(station);
    let mut count = 0;
    for (ray, (own, split)) in clean.iter().zip(&mixed).enumerate() {
        if own == split {
            continue;
        }
        count += 1;
        let next = if (ray + 1) % columns == 0 { ray + 1 - columns } else { ray + 1 };
        let [one, other] = [range(own), range(&clean[next])];
        assert!((one - other).abs() > EDGE, "ray {ray}: {one}, {other}");
        let between = (range(split) - one) / (other - one);
        assert!((0.0..=1.0).contains(&between), "ray {ray}: {between}");
    }
    assert_eq!(count, (2e-3 * clean.len() as f64) as usize);
}

#[test]
fn noise_and_strays_are_as_large_and_as_many_as_stated() {
    let (clean, station) = hall_points(CLEAN, 60_000.0);
    let errors = |survey: Survey| -> Vec<f64> {
        let found = hall_points(survey, 60_000.0).0;
        clean.iter().zip(&found).map(|(own, found)| found.distance(station) - own.distance(station)).collect()
    };
    let noise = errors(Survey { noise: 0.003, ..CLEAN });
    let deviation = (noise.iter().map(|error| error * error).sum::<f64>() / noise.len() as f64).sqrt();
    let mean = noise.iter().sum::<f64>() / noise.len() as f64;
    assert!((deviation / 0.003 - 1.0).abs() < 0.02 && mean.abs() < 5e-5, "{deviation}, mean {mean}");
    let strays = errors(Survey { strays: 0.01, ..CLEAN }).into_iter().filter(|error| error.abs() > 1e-9).count();
    let share = strays as f64 / clean.len() as f64;
    assert!((share / 0.01 - 1.0).abs() < 0.15, "{share}");
}

#[test]
fn points_that_are_even_by_area_are_as_dense_on_the_ceiling_as_on_a_wall() {
    let found = points(&scan(Tripod::Even, 100_000, 1));
    assert_eq!(found.len(), 100_000);
    let density = |low: [f64; 3], high: [f64; 3], area: f64| {
        let (low, high) = (DVec3::from(low) - 1e-6, DVec3::from(high) + 1e-6);
        found.iter().filter(|point| point.cmpge(low).all() && point.cmple(high).all()).count() as f64 / area
    };
    let ceiling = density([1.0, 1.0, 3.0], [5.0, 3.5, 3.0], 10.0);
    let wall = density([0.0, 1.0, 1.0], [0.0, 4.0, 3.0], 6.0);
    assert!((ceiling / wall - 1.0).abs() < 0.05 && wall > 200.0, "{ceiling}, {wall}");
}

#[test]
fn cameras_and_stations_stand_in_the_open_and_see_the_mirrors() {
    for tripod in Tripod::ALL {
        let (solids, camera) = (tripod.solids(), tripod.camera());
        for place in tripod.stations().into_iter().chain([camera.eye]) {
            for axis in DVec3::AXES.into_iter().chain([DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z]) {
                let hit = solid::nearest(&solids, place, axis);
                assert!(hit.is_none_or(|hit| hit.distance > 0.3), "{tripod:?}: {place} {axis} {hit:?}");
            }
        }
        for mirror in tripod.mirrors() {
            let way = mirror.position - camera.eye;
            let free = solid::nearest(&solids, camera.eye, way.normalize()).unwrap();
            assert!(free.distance > way.length() - mirror.size, "{tripod:?}: {} is hidden", mirror.name);
        }
    }
}
