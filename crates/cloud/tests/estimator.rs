//! The number of the estimator belongs to its results: what the cache keeps is known by it.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use cloud::{
    Chunk, Cloud, ESTIMATOR, Orientation, PointTest, Progress, RadiusRule, Random, SeenFrom, SurfelOptions, estimate,
    guess_orientation, hash, is_depth_image, radii_among, stretch_ratio,
};
use glam::{DVec3, Vec3};

/// The number of the estimator, and the checksum of its results on the clouds below.
const RESULTS: (u32, u64) = (11, 0xebec_0d95_70c8_9746);

/// A made-up place: a sheet that bends, its border, a wall upon it, a line, a pile at one place, and points far from all
/// others. Coordinates follow from whole numbers without functions of the system, which differ between systems.
fn place() -> Vec<Chunk> {
    let mut random = Random(34);
    let mut noise = || random.below(1000) as f32 * 2e-5;
    let mut points = Vec::new();
    for (x, y) in (0..24).flat_map(|x| (0..24).map(move |y| (x as f32 * 0.05, y as f32 * 0.05))) {
        points.push([x + noise(), y + noise(), x * x * 0.4 + noise()]);
        if x < 0.6 && y > 0.9 {
            points.push([x + noise(), 1.2 + noise(), y - 0.5]);
        }
    }
    points.extend((0..20).map(|step| [2.0 + step as f32 * 0.1, 0.5, 0.25]));
    points.extend([[0.5, 0.5, 2.0]; 5]);
    points.extend((0..6).map(|step| [step as f32 * 7.0 - 20.0, 30.0, step as f32 * 3.0]));
    points.push([f32::NAN, 0.0, 0.0]);
    let (one, two) = points.split_at(points.len() / 3);
    let origin = DVec3::new(512.0, -1024.0, 64.0);
    vec![Chunk::new(0, origin, one.to_vec()), Chunk::new(one.len() as u64, origin, two.to_vec())]
}

/// A floor in the rows of two stations, which lie between one another and have other spacings.
fn rows() -> Vec<Chunk> {
    let row = |apart: f32, aside: f32, step: f32| {
        let point = move |index: usize| {
            let (row, along) = (index / 60, index % 60);
            [aside + row as f32 * apart, (row % 3) as f32 * 0.007 + along as f32 * step, 0.0]
        };
        (0..480).map(point)
    };
    let points: Vec<[f32; 3]> = row(0.5, 0.0, 0.02).chain(row(0.5, 0.17, 0.024)).collect();
    vec![Chunk::new(0, DVec3::ZERO, points)]
}

/// What a camera at the origin sees: two walls, one before the other, in even steps of the picture.
fn depth_image() -> Vec<Chunk> {
    let pixel = |index: i32| {
        let (column, row) = (index % 30 - 15, index / 30 - 15);
        let depth = if column < 0 { 2.0 } else { 4.0 };
        [column as f32 * 0.02 * depth, row as f32 * 0.02 * depth, depth]
    };
    vec![Chunk::new(0, DVec3::ZERO, (0..900).map(pixel).collect())]
}

/// What two stations see: a rough wall, and another one behind it.
fn stations() -> Vec<Chunk> {
    let wall = |number: u64, depth: f32| {
        let pixel = |index: u64| {
            let [x, y] = [index % 30, index / 30].map(|along| (along as f32 - 14.7) * 0.02);
            let depth = depth * (1.0 + 0.005 * ((hash(index + 900 * number) >> 40) as f32 / (1 << 24) as f32));
            [x * depth + number as f32 * 1.25, y * depth, depth]
        };
        let station = Some(DVec3::X * number as f64 * 1.25);
        Chunk { station, ..Chunk::new(900 * number, DVec3::ZERO, (0..900).map(pixel).collect()) }
    };
    vec![wall(0, 2.0), wall(1, 4.0)]
}

/// A shrub: leaves in a cube, with six points on each.
fn shrub() -> Vec<Chunk> {
    let mut random = Random(35);
    let mut place = |width: f32| [0; 3].map(|_| random.below(1024) as f32 * width);
    let leaf = |_| {
        let middle = place(1.0 / 1024.0);
        [0; 6].map(|_| {
            let offset = place(0.1 / 1024.0);
            [0, 1, 2].map(|axis| middle[axis] + offset[axis])
        })
    };
    vec![Chunk::new(0, DVec3::ZERO, (0..200).flat_map(leaf).collect())]
}

/// A strip of hilly ground.
fn strip() -> Vec<Chunk> {
    let point = |index: i32| [index as f32 * 0.5, (index % 7) as f32 * 0.5, (index % 200 - 100).abs() as f32 * 0.0625];
    vec![Chunk::new(0, DVec3::ZERO, (0..1000).map(point).collect())]
}

/// A checksum of results, coarse enough that the last digit of a logarithm, which systems round in their own ways, does
/// not count.
#[derive(PartialEq, Debug)]
struct Checksum(u64);

impl Checksum {
    fn add(&mut self, value: u64) {
        self.0 = hash(self.0 ^ value);
    }

    fn add_surfels(&mut self, chunks: &[Chunk], options: &SurfelOptions) {
        for surfels in estimate(chunks, options, &Progress::default()).unwrap() {
            let halves = surfels.normals.iter().flat_map(|normal| [normal & 0xffff, normal >> 16]);
            halves.for_each(|half| self.add(u64::from(half / 16)));
            // The marks of points without a radius, and of stray ones, are no lengths.
            surfels
                .radii
                .iter()
                .for_each(|radius| self.add(u64::from(if *radius < 32 { *radius } else { radius / 16 })));
        }
    }
}

fn results() -> Checksum {
    let mut sum = Checksum(0);
    let (place, image) = (place(), depth_image());
    let up = Orientation::Up(Vec3::Z);
    for radii in [RadiusRule::Full, RadiusRule::Narrow, RadiusRule::Spread] {
        sum.add_surfels(&place, &SurfelOptions { radii, ..SurfelOptions::new(up) });
    }
    let few =
        SurfelOptions { neighbours: 7, ..SurfelOptions::new(Orientation::Toward(DVec3::new(513.0, -1023.0, 65.0))) };
    sum.add_surfels(&place, &few);
    sum.add(u64::from(is_depth_image(&image)) + 2 * u64::from(is_depth_image(&place)));
    let seen_from = Some(SeenFrom::Place(DVec3::ZERO));
    sum.add_surfels(&image, &SurfelOptions { seen_from, radii: RadiusRule::Spread, ..SurfelOptions::new(up) });
    for chunks in [&place, &image, &strip()] {
        let (kind, center) = match guess_orientation(chunks, Vec3::Z) {
            Orientation::Up(up) => (0, up.as_dvec3()),
            Orientation::Toward(center) => (1, center),
            Orientation::AwayFrom(center) => (2, center),
        };
        sum.add(kind);
        center.to_array().into_iter().for_each(|value| sum.add((value * 64.0).round() as i64 as u64));
    }
    let spread = SurfelOptions { radii: RadiusRule::Spread, ..SurfelOptions::new(up) };
    sum.add_surfels(&rows(), &spread);
    sum.add_surfels(&shrub(), &spread);
    let station = DVec3::new(-4.0, 0.5, 1.0);
    sum.add_surfels(&rows(), &SurfelOptions { seen_from: Some(SeenFrom::Place(station)), ..spread });
    sum.add_surfels(&stations(), &SurfelOptions { seen_from: Some(SeenFrom::Stations), ..spread });
    let cloud = Cloud { chunks: place, ..Cloud::default() };
    let all = radii_among(&cloud, &PointTest::default(), &SurfelOptions::new(up), &Progress::default()).unwrap();
    all.iter().flat_map(|radii| radii.iter()).for_each(|radius| sum.add(u64::from(*radius)));
    sum
}

#[test]
fn other_results_of_the_estimator_have_another_number() {
    let (number, Checksum(found)) = (ESTIMATOR, results());
    let next = if RESULTS.0 == number { number + 1 } else { number };
    assert_eq!(
        RESULTS,
        (number, found),
        "normals, radii or stray points differ from those that caches keep: set cloud::ESTIMATOR to {next}, and RESULTS \
         here to ({next}, {found:#x})"
    );
}

#[test]
fn the_rows_of_two_stations_that_the_checksum_has_get_ellipses() {
    let surfels = estimate(&rows(), &SurfelOptions::new(Orientation::Up(Vec3::Z)), &Progress::default()).unwrap();
    let of_station = surfels[0].radii.chunks(480).map(|radii| {
        let ellipses = radii.iter().filter(|radius| stretch_ratio(**radius) > 3.0).count();
        ellipses as f64 / radii.len() as f64
    });
    assert!(of_station.clone().all(|share| share > 0.5), "{:?}", of_station.collect::<Vec<_>>());
}

#[test]
fn the_results_of_the_estimator_do_not_depend_on_the_number_of_threads() {
    let pool = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let all = |threads: usize| {
        let estimated = || {
            let options = SurfelOptions { radii: RadiusRule::Spread, ..SurfelOptions::new(Orientation::Up(Vec3::Z)) };
            estimate(&place(), &options, &Progress::default()).unwrap()
        };
        pool(threads).install(estimated)
    };
    let one = all(1);
    assert!(one == all(2) && one == all(5));
}
