//! Rays per second and core among a million discs of the reference scene: those of a camera's pixels, which lie side by side,
//! and rays from anywhere to anywhere. `cargo bench -p trace --bench rays`; ITEMS are rays, or paths of indirect light, all on
//! one thread. Embree 3.13 answers 0.7 million incoherent rays a second among as many discs.

use cloud::Progress;
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::DVec3;
use scene::five_mirrors::{Variant, camera, light, sample};
use scene::{MirrorSettings, ViewSettings};
use trace::{Geometry, Illuminant, Illumination, Indirect, MaterialPoints, PixelRays, Ray, Surfels, indirect};

const DISCS: u64 = 1_000_000;
const SIZE: [u32; 2] = [400, 300];

fn main() {
    divan::main();
}

fn unit(seed: u64) -> f64 {
    let mut mixed = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (mixed ^ (mixed >> 31)) as f64 / u64::MAX as f64
}

fn surfels(variant: Variant) -> Surfels {
    let parts = sample(variant, DISCS, 1);
    let part = |part| MaterialPoints {
        chunks: part,
        specular_intensity: 0.0,
        specular_power: 0.0,
        clear: None,
        plain: [0.5; 3],
    };
    let parts: Vec<MaterialPoints> = parts.iter().map(|points| part(&points.chunks)).collect();
    Surfels::new(&parts, 1.0, &Progress::default()).expect("not cancelled")
}

fn coherent() -> Vec<Ray> {
    let rays = PixelRays::new(&camera(), &ViewSettings::default(), SIZE, 0.0);
    (0..rays.pixel_count()).map(|pixel| rays.ray(pixel)).collect()
}

/// Origins even in the box, directions even on the sphere.
fn incoherent() -> Vec<Ray> {
    (0..u64::from(SIZE[0] * SIZE[1]))
        .map(|index| {
            let random = |n: u64| 2.0 * unit(8 * index + n) - 1.0;
            let (z, turn) = (random(0), random(1) * std::f64::consts::PI);
            let direction = DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            Ray::from_eye(DVec3::new(random(2), random(3), 2.0 * random(4)), direction)
        })
        .collect()
}

#[divan::bench(args = ["coherent", "incoherent"], sample_count = 5, sample_size = 1)]
fn nearest(bencher: Bencher, kind: &str) {
    let (surfels, rays) = (surfels(Variant::Sphere), if kind == "coherent" { coherent() } else { incoherent() });
    let hits = rays.iter().filter(|ray| surfels.nearest(ray).is_some()).count();
    assert!(hits as f64 > 0.99 * rays.len() as f64, "{hits} of {} rays hit the closed box", rays.len());
    bencher
        .counter(ItemsCount::new(rays.len()))
        .bench_local(|| rays.iter().filter(|ray| black_box(surfels.nearest(ray)).is_some()).count());
}

/// Light of one lamp in the box alone, after one reflection: a ray and a shadow ray a path.
#[divan::bench(sample_count = 5, sample_size = 1)]
fn paths(bencher: Bencher) {
    let (surfels, lights, mirror) = (surfels(Variant::None), [light()], MirrorSettings::default());
    let samples = 4;
    let illumination = Illumination {
        indirect: Indirect { bounces: 1, samples, seed: 1 },
        ..Illumination::new(Illuminant::Lights(&lights), &mirror)
    };
    let seen: Vec<_> = coherent().into_iter().filter_map(|ray| Some((surfels.nearest(&ray)?, ray.direction))).collect();
    let light_of = |pixel: usize| indirect(&surfels, &seen[pixel].0, seen[pixel].1, pixel, &illumination);
    bencher
        .counter(ItemsCount::new(seen.len() * samples as usize))
        .bench_local(|| black_box((0..seen.len()).map(light_of).sum::<DVec3>()));
}

#[divan::bench(sample_count = 3, sample_size = 1)]
fn build(bencher: Bencher) {
    bencher.counter(ItemsCount::new(DISCS)).with_inputs(|| sample(Variant::Sphere, DISCS, 1)).bench_local_values(
        |parts| {
            let part = |part| MaterialPoints {
                chunks: part,
                specular_intensity: 0.0,
                specular_power: 0.0,
                clear: None,
                plain: [0.5; 3],
            };
            let parts: Vec<MaterialPoints> = parts.iter().map(|points| part(&points.chunks)).collect();
            Surfels::new(&parts, 1.0, &Progress::default())
        },
    );
}
