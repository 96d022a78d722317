//! Measures how far a surface has moved between two clouds of points, by the nearest points and along the normal:
//! `cargo run --release --example compare_clouds`.

use cloud::{Orientation, Random};
use glam::{DVec3, Vec3};
use measure::{DistanceFigures, M3c2, PointTree, nearest_distances};

const POINTS: usize = 50_000;
/// How far the second surface lies above the first one, and the noise of either.
const MOVED: f64 = 0.05;
const NOISE: f64 = 0.01;

/// Random points of a hilly square of 10 by 10, this much higher.
fn hills(random: &mut Random, height: f64) -> Vec<DVec3> {
    let mut unit = || (random.draw() >> 11) as f64 / (1_u64 << 53) as f64;
    let mut point = |_| {
        let (x, y) = (unit() * 10.0, unit() * 10.0);
        DVec3::new(x, y, (x * 0.7).sin() * (y * 0.5).cos() + height + (unit() - 0.5) * NOISE)
    };
    (0..POINTS).map(&mut point).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut random = Random(1);
    let (before, after) = (hills(&mut random, 0.0), hills(&mut random, MOVED));
    let tree = PointTree::new(before.clone());
    let nearest = DistanceFigures::of(nearest_distances(&tree, &after)).ok_or("no distance")?;
    println!("to the nearest point: median {:.4}, at most {:.4}", nearest.median, nearest.max);
    let m3c2 = M3c2::new(&tree, None, None, None, 0.0, Orientation::Up(Vec3::Z))?;
    let changes = m3c2.changes(&tree, &PointTree::new(after), &before);
    let distances = changes.into_iter().flatten().map(|change| change.distance).collect();
    let signed = DistanceFigures::of(distances).ok_or("no distance")?;
    println!(
        "along the normal: median {:.4}, with a standard deviation of {:.4}; it has moved by {MOVED}",
        signed.median, signed.std
    );
    Ok(())
}
