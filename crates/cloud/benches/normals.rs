//! Normals and spacing of 2 million points of terrain with houses, k = 16, beside the same with a k-d tree over the whole
//! cloud (`kiddo`). `cargo bench -p cloud --bench normals`; ITEMS are points, and RAYON_NUM_THREADS=1 gives points per
//! CPU-second.

use std::num::NonZeroUsize;

use cloud::{CHUNK_POINTS, Chunk, Orientation, Progress, SurfelOptions, estimate};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::{DVec3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

const POINTS: usize = 2_000_000;
const NEIGHBOURS: NonZeroUsize = NonZeroUsize::new(16).expect("not zero");

fn main() {
    divan::main();
}

fn unit(seed: u64) -> f64 {
    cloud::hash(seed) as f64 / u64::MAX as f64
}

/// Ten points a square metre in scan lines over five flight strips, hills, a house of flat roof and walls every 40 m,
/// noise of 2 cm, one point in a thousand high in the air; UTM coordinates.
fn town() -> Vec<Chunk> {
    let origin = DVec3::new(631_000.0, 5_077_000.0, 100.0);
    let side = (POINTS as f64 / 10.0).sqrt();
    let point = |i: usize| {
        let random = |n: u64| unit(4 * i as u64 + n);
        // Every strip is half as wide again as its share, so that strips overlap.
        let strip = i * 5 / POINTS;
        let along = (i % (POINTS / 5)) as f64 / (POINTS / 5) as f64;
        let line_phase = (along * side * 1.5).fract();
        let across = if ((along * side * 1.5) as u64).is_multiple_of(2) { line_phase } else { 1.0 - line_phase };
        let x = ((strip as f64 + across * 1.5) * side / 5.0).min(side) + 0.02 * random(0);
        let y = along * side + 0.02 * random(1);
        let ground = 8.0 * (x / 90.0).sin() * (y / 70.0).cos() + 0.5 * (x / 7.0).sin() * (y / 5.0).sin();
        let (house_x, house_y) = (x.rem_euclid(40.0), y.rem_euclid(40.0));
        let inside = house_x < 12.0 && house_y < 10.0;
        let wall = inside && (house_x < 0.4 || house_y < 0.4);
        let height = if wall {
            ground + 6.0 * random(2)
        } else if inside {
            ground.round() + 6.0
        } else {
            ground
        };
        let stray = if i % 1000 == 999 { 200.0 * random(3) } else { 0.0 };
        [x as f32, y as f32, (height + 0.02 * random(2) + stray) as f32]
    };
    let positions: Vec<[f32; 3]> = (0..POINTS).into_par_iter().map(point).collect();
    positions
        .chunks(CHUNK_POINTS)
        .enumerate()
        .map(|(i, chunk)| Chunk::new((i * CHUNK_POINTS) as u64, origin, chunk.to_vec()))
        .collect()
}

#[divan::bench(sample_count = 5)]
fn surfels(bencher: Bencher) {
    let chunks = town();
    let options = SurfelOptions::new(Orientation::Up(Vec3::Z));
    bencher
        .counter(ItemsCount::new(POINTS))
        .bench_local(|| estimate(black_box(&chunks), &options, &Progress::default()));
}

/// Building the tree and finding 16 neighbours of every point, no normals: the least that this way costs.
#[divan::bench(sample_count = 3)]
fn neighbours_by_one_kiddo_tree(bencher: Bencher) {
    let positions: Vec<[f32; 3]> = town().iter().flat_map(|chunk| chunk.positions.iter().copied()).collect();
    bencher.counter(ItemsCount::new(POINTS)).bench_local(|| {
        let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(black_box(&positions)).expect("a tree");
        let total: f64 = positions
            .par_iter()
            .map(|position| {
                let found = tree.query(position).nearest_n::<SquaredEuclidean<f32>>(NEIGHBOURS).execute();
                found.last().map_or(0.0, |last| f64::from(last.distance))
            })
            .sum();
        black_box(total)
    });
}
