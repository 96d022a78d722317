//! Whether estimates from random pixels hold the figures of all pixels, on the five mirrors.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use cloud::Progress;
use render::{Aov, Gpu, MANY_LIGHTS, Renderer};
use scene::Settings;
use scene::five_mirrors::Variant;
use study::{Accuracy, Estimate, Judged, RAYS, Subject, TracedScene, Tracer, Truth, View, estimate, light_error};

const SIZE: [u32; 2] = [200, 150];

struct Studio {
    gpu: Arc<Gpu>,
    renderer: Renderer,
}

static STUDIO: LazyLock<Option<Mutex<Studio>>> = LazyLock::new(|| {
    let gpu = match Gpu::headless(None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            return None;
        }
    };
    Some(Mutex::new(Studio { renderer: Renderer::new(gpu.clone()).unwrap(), gpu }))
});

/// `None` without an adapter.
fn studio() -> Option<MutexGuard<'static, Studio>> {
    STUDIO.as_ref().map(|studio| studio.lock().unwrap_or_else(PoisonError::into_inner))
}

/// `text` has keys and values.
fn settings(text: &str) -> Settings {
    let mut settings = Settings::default();
    let all = format!("scene.points=150000 {text}");
    for (key, value) in all.split_whitespace().map(|word| word.split_once('=').unwrap()) {
        settings.set_text(key, value).unwrap();
    }
    settings
}

/// A scene on the GPU and for the ray tracer.
struct Stage {
    subject: Subject,
    traced: TracedScene,
}

impl Stage {
    fn new(gpu: &Arc<Gpu>, variant: Variant) -> Self {
        let settings = settings("");
        let subject = Subject::five_mirrors(gpu, variant, &settings).unwrap();
        let traced = TracedScene::new(&subject.parts, None, settings.splat.size, &Progress::default()).unwrap();
        Self { subject, traced }
    }

    /// Draws a frame; judges all of its pixels, and estimates the same from some of them.
    fn judge(&self, renderer: &mut Renderer, settings: &Settings, seed: u64) -> (Accuracy, Estimate) {
        let Self { subject, traced } = self;
        subject.render(renderer, settings, SIZE).unwrap();
        let view = View { camera: &subject.camera, settings, objects: subject.objects(), size: SIZE };
        let tracer = Tracer::new(traced, view);
        let drawn = tracer.drawn(renderer).unwrap();
        let full = tracer.judge(Truth::SameInput, &drawn, &Progress::default()).unwrap();
        let estimate = estimate(renderer, &subject.store, settings, subject.objects(), RAYS, seed).unwrap();
        (full, estimate.unwrap())
    }
}

fn holds([low, high]: [f64; 2], figure: f64) -> bool {
    low <= figure && figure <= high
}

#[test]
fn estimates_hold_the_figures_of_all_pixels_in_nine_of_ten_cases() {
    let Some(mut studio) = studio() else { return };
    let Studio { gpu, renderer } = &mut *studio;
    let single = [Variant::Sphere, Variant::Parabolic, Variant::Blob, Variant::Torus, Variant::Coral];
    let (mut cases, mut held) = (0, [0; 3]);
    for variant in single.into_iter().chain([Variant::All]) {
        let stage = Stage::new(gpu, variant);
        let others = ["environment_map", "mirrored_viewpoint", "sscr_hierarchical"];
        let other = others[variant as usize % others.len()];
        for method in ["sscr", other] {
            let settings = settings(&format!("gi.bounces=0 reflection.method={method}"));
            let (full, estimate) = stage.judge(renderer, &settings, cases);
            println!("{} {method}: {full:?}, {estimate:?}", variant.name());
            let pixel_error = estimate.pixel_error.unwrap();
            let figures = [
                (pixel_error.median_interval, full.pixel_error.median),
                (pixel_error.p95_interval, full.pixel_error.p95),
                (estimate.wrong_interval.unwrap(), full.wrong),
            ];
            cases += 1;
            for (held, (interval, figure)) in held.iter_mut().zip(figures) {
                *held += u64::from(holds(interval, figure));
            }
            assert!((estimate.filled - full.closed_coverage).abs() < 0.1);
            // An interval that holds everything would be no estimate.
            let [low, high] = estimate.wrong_interval.unwrap();
            assert!(high - low < 0.2, "{method}: {estimate:?}");
        }
    }
    println!("of {cases}: {held:?}");
    assert!(held.iter().all(|held| 10 * held >= 9 * cases), "{held:?} of {cases}");
}

#[test]
fn what_is_exact_has_no_error_and_a_small_picture_has_that_of_its_pixels() {
    let Some(mut studio) = studio() else { return };
    let Studio { gpu, renderer } = &mut *studio;
    let stage = Stage::new(gpu, Variant::Sphere);
    let settings = settings("gi.bounces=0 reflection.method=surfel_trace splat.close_gaps=false");
    let (full, estimate) = stage.judge(renderer, &settings, 1);
    let pixel_error = estimate.pixel_error.unwrap();
    assert!(full.mirror_pixels > RAYS && estimate.rays == RAYS, "{full:?}");
    assert!(pixel_error.p95 < 0.01 && estimate.wrong == 0.0, "{estimate:?}");
    assert_eq!(estimate.indirect, None);
    let Subject { store, .. } = &stage.subject;
    let objects = stage.subject.objects();
    let probe = renderer.probe(store, &settings, objects, RAYS, 1).unwrap();
    assert_eq!(probe.mirrors, renderer.probe(store, &settings, objects, RAYS, 1).unwrap().mirrors);
    assert_ne!(probe.mirrors, renderer.probe(store, &settings, objects, RAYS, 2).unwrap().mirrors);
    let mut before = pixel_error;
    for divisor in [2, 4] {
        stage.subject.render(renderer, &settings, SIZE.map(|edge| edge / divisor)).unwrap();
        let shown = renderer.shown_at(store, &settings, &probe).unwrap();
        let small = Judged::new(&probe, &shown).estimate().unwrap().pixel_error.unwrap();
        // Pixels lie up to half of a large pixel beside the middle of one.
        assert!(small.median > before.median + 0.3 && small.median < f64::from(divisor), "{divisor}: {small:?}");
        before = small;
    }
}

#[test]
fn indirect_light_is_compared_with_that_of_many_lights() {
    let Some(mut studio) = studio() else { return };
    let Studio { gpu, renderer } = &mut *studio;
    let stage = Stage::new(gpu, Variant::Sphere);
    let Subject { store, .. } = &stage.subject;
    let objects = stage.subject.objects();
    let mut drawn = |text: &str| {
        let settings = settings(text);
        stage.subject.render(renderer, &settings, SIZE).unwrap();
        let estimate = estimate(renderer, store, &settings, objects, RAYS, 5).unwrap();
        let image = renderer.read_aov(Aov::Indirect).unwrap().data.as_chunks::<3>().0.to_vec();
        (estimate.unwrap(), image)
    };
    let (same, truth) = drawn(&format!("gi.vpls={MANY_LIGHTS} gi.interleave=1"));
    assert!(same.indirect.unwrap().relative_rmse < 1e-3, "{same:?}");
    let mut before = 0.0;
    for lights in [256, 64, 16] {
        let (estimate, image) = drawn(&format!("gi.vpls={lights}"));
        let full = light_error(&vec![true; image.len()], &image, &truth).relative_rmse;
        let found = estimate.indirect.unwrap();
        println!("{lights} lights: {full}, {found:?}");
        assert!(holds(found.relative_rmse_interval, full), "{full}, {found:?}");
        assert!(found.relative_rmse > before && found.relative_rmse_interval[1] < 2.0 * full);
        before = found.relative_rmse;
    }
    let without = settings("gi.bounces=0 reflection.method=none");
    stage.subject.render(renderer, &without, SIZE).unwrap();
    assert_eq!(estimate(renderer, store, &without, objects, RAYS, 5).unwrap(), None, "nothing to estimate");
}
