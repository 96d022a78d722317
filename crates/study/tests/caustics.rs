//! How much of the light that a mirror throws from a lamp pictures show, against photons on exact surfaces.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use cloud::Progress;
use render::{Aov, Gpu, Renderer};
use scene::Settings;
use scene::five_mirrors::{self, Variant};
use study::metrics::Truth;
use study::{Exact, Subject, TracedScene, Tracer, View, light_error};

const SIZE: [u32; 2] = [80, 60];

/// The sums of the light of `mask` in squares of ten pixels.
fn blocks(mask: &[bool], image: &[[f32; 3]]) -> Vec<f64> {
    let mut sums = vec![0.0; 48];
    for (pixel, color) in image.iter().enumerate().filter(|(pixel, _)| mask[*pixel]) {
        sums[pixel / 80 / 10 * 8 + pixel % 80 / 10] += color.iter().copied().map(f64::from).sum::<f64>();
    }
    sums
}

#[test]
fn walls_get_the_light_that_a_mirror_throws_where_it_belongs_and_send_it_on() {
    let gpu = match Gpu::headless(None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => return println!("skipped: {error}"),
    };
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let (camera, progress) = (five_mirrors::camera(), Progress::default());
    for variant in [Variant::Sphere, Variant::Torus] {
        let settings = |text: &str| {
            let mut settings: Settings = variant.settings();
            let all = format!("scene.points=200000 reflection.method=surfel_trace gi.interleave=1 gi.vpls=256 {text}");
            for (key, value) in all.split_whitespace().map(|word| word.split_once('=').unwrap()) {
                settings.set_text(key, value).unwrap();
            }
            settings
        };
        let subject = Subject::five_mirrors(&gpu, variant, &settings("")).unwrap();
        let scene = TracedScene::new(&subject.parts, Some(Exact::five_mirrors(variant)), 1.0, &progress).unwrap();
        for (bounces, most_off, least_dark) in [(0, 0.03, 0.7), (1, 0.05, 0.7)] {
            let settings =
                settings(&format!("gi.bounces={bounces} light.photons=65536 trace.photons=300000 trace.samples=128"));
            let view = View { camera: &camera, settings: &settings, objects: subject.objects(), size: SIZE };
            let tracer = Tracer::new(&scene, view);
            let seen = tracer.exactly_seen(&progress).unwrap();
            let mask: Vec<bool> =
                seen.iter().map(|seen| seen.is_some_and(|(hit, _)| hit.specular_intensity == 0.0)).collect();
            let truth = tracer.colors(Truth::Exact, &seen, &progress).unwrap();
            let mut errors = Vec::new();
            for photons in [65_536, 0] {
                let mut settings = settings.clone();
                settings.light.photons = photons;
                subject.render(&mut renderer, &settings, SIZE).unwrap();
                let image = renderer.read_aov(Aov::Color).unwrap().data;
                let image = image.as_chunks::<3>().0;
                let (found, expected) = (blocks(&mask, image), blocks(&mask, &truth));
                let off: f64 = found.iter().zip(&expected).map(|(found, expected)| (found - expected).abs()).sum();
                errors.push((light_error(&mask, image, &truth), off / expected.iter().sum::<f64>()));
            }
            println!("{variant:?}, {bounces} bounces: with and without photons {errors:?}");
            let [(with, off), (without, _)] = errors[..] else { unreachable!() };
            assert!((with.mean_ratio - 1.0).abs() < most_off && off < 2.0 * most_off, "{variant:?}: {with:?}, {off}");
            assert!(without.mean_ratio < least_dark, "{variant:?}: {without:?}");
        }
    }
}
