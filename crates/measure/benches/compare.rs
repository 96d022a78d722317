//! Distances between two scans of the same terrain with houses, beside the nearest points that `kiddo` finds.
//! `cargo bench -p measure --bench compare -- 10000000` takes as many points of each; one million if none is given.

use std::hint::black_box;
use std::time::Instant;

use cloud::{Orientation, hash};
use glam::{DVec3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use measure::{M3c2, PointTree, nearest_distances};
use rayon::prelude::*;

/// As many places are measured at once, as in the program.
const CHUNK: usize = 1 << 16;

fn main() {
    let number = std::env::args().find_map(|argument| argument.parse().ok());
    // Tests run this without the flag, and only to see that it runs.
    let is_bench = std::env::args().any(|argument| argument == "--bench");
    let points = number.unwrap_or(if is_bench { 1_000_000 } else { 10_000 });
    let [first, second] = [(1, 0.0), (2, 0.1)].map(|(seed, rise)| terrain(points, seed, rise));
    let trees = timed("two trees", points, || [&first, &second].map(|places| PointTree::new(places.clone())));
    timed("nearest points", points, || {
        first.par_chunks(CHUNK).for_each(|places| {
            black_box(nearest_distances(&trees[1], places));
        })
    });
    let up = Orientation::Up(Vec3::Z);
    let method = M3c2::new(&trees[0], None, None, None, 0.0, up).expect("a spacing");
    timed("M3C2", points, || {
        first.par_chunks(CHUNK).for_each(|places| {
            black_box(method.changes(&trees[0], &trees[1], places));
        })
    });
    drop(trees);
    let places: Vec<[f64; 3]> = second.iter().map(DVec3::to_array).collect();
    let tree = timed("kiddo: a tree", points, || ImmutableKdTree::<f64, 3>::new_from_slice(&places).expect("a tree"));
    timed("kiddo: nearest points", points, || {
        first.par_iter().for_each(|place| {
            black_box(tree.query(&place.to_array()).nearest_one::<SquaredEuclidean<f64>>().execute());
        })
    });
}

fn timed<T>(name: &str, points: usize, work: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let result = work();
    let seconds = started.elapsed().as_secs_f64();
    println!("{name:>22} {seconds:8.2} s {:8.2} M points a second", points as f64 / seconds / 1e6);
    result
}

/// One point a square metre, at random places, of hills with a house in four of ten squares of 40 metres, with noise of
/// 2 cm; the eastern half is raised by `rise`.
fn terrain(points: usize, seed: u64, rise: f64) -> Vec<DVec3> {
    let side = (points as f64).sqrt();
    let unit = |index: usize, which: u64| hash((8 * index as u64 + which) ^ (seed << 56)) as f64 / u64::MAX as f64;
    let point = |index: usize| {
        // In strips, as a scan is flown.
        let x = unit(index, 0) * side;
        let y = (index as f64 + unit(index, 1)) / points as f64 * side;
        let wave = |number: i32| {
            let (size, length) = (8.0 * 0.5_f64.powi(number), 64.0 * 0.5_f64.powi(number));
            size * (x / length + f64::from(number)).sin() * (0.9 * y / length).cos()
        };
        let square = (x / 40.0) as u64 + (((y / 40.0) as u64) << 20);
        let is_house = hash(square) % 10 < 4 && (8.0..32.0).contains(&(x % 40.0)) && (10.0..28.0).contains(&(y % 40.0));
        let noise = (0..4).map(|which| unit(index, 2 + which) - 0.5).sum::<f64>() * 0.02 * 3.0_f64.sqrt();
        let height = (0..7).map(wave).sum::<f64>() + if is_house { 7.0 } else { 0.0 };
        DVec3::new(x + 431_000.0, y + 5_412_000.0, height + noise + if x > 0.5 * side { rise } else { 0.0 })
    };
    (0..points).into_par_iter().map(point).collect()
}
