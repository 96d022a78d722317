use cloud::Cloud;
use scene::LightClues;
use scene::five_mirrors::{self, Variant};

use super::*;

/// What mirrors throw on what is seen, and what mirrors show of it: the difference that photons make.
fn thrown(scene: &TracedScene, variant: Variant, truth: Truth) -> Vec<[f32; 3]> {
    let (camera, lights, progress) = (five_mirrors::camera(), [five_mirrors::light()], Progress::default());
    let objects = Objects { mirrors: &[], lights: &lights, clues: LightClues::default() };
    let [with, without] = [200_000, 0].map(|photons| {
        let mut settings = variant.settings();
        (settings.trace.photons, settings.gi.bounces) = (photons, 0);
        let tracer = Tracer::new(scene, View { camera: &camera, settings: &settings, objects, size: [80, 60] });
        tracer.colors(truth, &tracer.exactly_seen(&progress).unwrap(), &progress).unwrap()
    });
    with.iter().zip(without).map(|(with, without)| [0, 1, 2].map(|color| with[color] - without[color])).collect()
}

/// The sums of the light in squares of ten pixels.
fn blocks(image: &[[f32; 3]]) -> Vec<f64> {
    let mut sums = vec![0.0; 48];
    for (pixel, color) in image.iter().enumerate() {
        sums[pixel / 80 / 10 * 8 + pixel % 80 / 10] += color.iter().copied().map(f64::from).sum::<f64>();
    }
    sums
}

#[test]
fn mirrors_throw_the_same_light_in_points_and_on_exact_surfaces() {
    for variant in [Variant::Sphere, Variant::Torus] {
        let parts = five_mirrors::sample(variant, 300_000, 1).into_iter().map(|part| {
            let cloud = Cloud { chunks: part.chunks, ..Cloud::default() };
            let wall = scene::Mirror { specular_intensity: 0.0, ..variant.mirrors()[0].clone() };
            SubjectPart::of_mirror(&part.mirror.unwrap_or(wall), cloud)
        });
        let (parts, exact) = (parts.collect::<Vec<_>>(), Exact::five_mirrors(variant));
        let scene = TracedScene::new(&parts, Some(exact), 1.0, &Progress::default()).unwrap();
        let [points, exact] = [Truth::SameInput, Truth::Exact].map(|truth| thrown(&scene, variant, truth));
        let sum = |image: &[[f32; 3]]| image.as_flattened().iter().copied().map(f64::from).sum::<f64>();
        assert!(exact.as_flattened().iter().all(|light| *light > -1e-6), "photons take light away");
        // Discs reflect like small plane mirrors, which spots as large as they are show.
        let off: f64 = blocks(&points).iter().zip(blocks(&exact)).map(|(points, exact)| (points - exact).abs()).sum();
        let (lit, ratio, off) = (blocks(&exact), sum(&points) / sum(&exact), off / sum(&exact));
        let lit = lit.iter().filter(|light| **light > 0.0).count();
        println!("{variant:?}: {lit} blocks are lit, ratio {ratio}, off {off}");
        assert!(lit > 20 && (ratio - 1.0).abs() < 0.03 && off < 0.1, "{variant:?}: {lit} blocks, {ratio}, {off}");
    }
}
