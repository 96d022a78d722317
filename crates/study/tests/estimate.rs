//! Whether estimates from random pixels hold the figures of all pixels, on the five mirrors.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod studio;

use std::sync::Arc;

use cloud::Progress;
use render::{Aov, Frame, Gpu, Renderer};
use scene::Settings;
use scene::five_mirrors::Variant;
use study::{
    Accuracy, Estimate, RAYS, STILL_LIGHTS, Subject, TracedScene, Tracer, Truth, View, estimate, judge, light_error,
    still_settings,
};

use studio::{Studio, studio};

const SIZE: [u32; 2] = [200, 150];

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
        let estimate = estimate(renderer, &subject.store, view.frame(), RAYS, seed).unwrap();
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
    for (index, variant) in single.into_iter().chain([Variant::All]).enumerate() {
        let stage = Stage::new(gpu, variant);
        let others = ["environment_map", "mirrored_viewpoint", "sscr_hierarchical"];
        let other = others[(index + 1) % others.len()];
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
    let Subject { store, camera, .. } = &stage.subject;
    let objects = stage.subject.objects();
    let mut probe = |seed| renderer.probe(store, &still_settings(&settings), objects, RAYS, seed).unwrap().mirrors;
    assert_eq!(probe(1), probe(1));
    assert_ne!(probe(1), probe(2));
    // Of eight points one is left, so that the mirror's normals differ. Pixels of half the size are 0.71 pixels of the
    // still picture beside the middle of the one that shows them, those of a quarter 0.7 to 2.1.
    for (divisor, step, range) in [(1, 8, 0.1..2.0), (2, 1, 0.5..0.9), (4, 1, 1.0..1.8)] {
        let mut coarse = settings.clone();
        coarse.splat.step = step;
        let drawn = SIZE.map(|edge| edge / divisor);
        let frame = Frame::new(camera, &coarse, objects, SIZE);
        stage.subject.render(renderer, &coarse, drawn).unwrap();
        let picture = renderer.read_picture().unwrap();
        let small = judge(renderer, store, frame, RAYS, 1).unwrap().estimate().unwrap().pixel_error.unwrap();
        assert!(renderer.read_picture().unwrap() == picture, "the frame is the same as before");
        println!("1 / {divisor}, one point in {step}: {small:?}");
        assert!(range.contains(&small.median), "1 / {divisor}, one point in {step}: {small:?}");
    }
}

#[test]
fn indirect_light_is_compared_with_that_of_many_lights() {
    let Some(mut studio) = studio() else { return };
    let Studio { gpu, renderer } = &mut *studio;
    let stage = Stage::new(gpu, Variant::Sphere);
    let Subject { store, camera, .. } = &stage.subject;
    let objects = stage.subject.objects();
    let mut drawn = |text: &str, seeds: &[u64]| {
        let settings = &settings(text);
        stage.subject.render(renderer, settings, SIZE).unwrap();
        let frame = Frame::new(camera, settings, objects, SIZE);
        let mut by_seed =
            |seed: &u64| estimate(renderer, store, frame, RAYS, *seed).unwrap().unwrap().indirect.unwrap();
        let estimates: Vec<_> = seeds.iter().map(&mut by_seed).collect();
        let image = renderer.read_aov(Aov::Indirect).unwrap().data.as_chunks::<3>().0.to_vec();
        (estimates, image)
    };
    let (same, truth) = drawn(&format!("gi.vpls={STILL_LIGHTS} gi.interleave=1"), &[5]);
    assert!(same[0].relative_rmse < 1e-3, "{same:?}");
    // Of 16 lights a few bright pixels have most of the error, which most draws of rays miss: no interval is held to it.
    let (mut before, mut held, mut all) = (0.0, 0, 0);
    for lights in [256, 64, 16] {
        let (estimates, image) = drawn(&format!("gi.vpls={lights}"), &[1, 2, 3, 4]);
        let full = light_error(&vec![true; image.len()], &image, &truth).relative_rmse;
        println!("{lights} lights: {full}, {estimates:?}");
        if lights > 16 {
            held += estimates.iter().filter(|found| holds(found.relative_rmse_interval, full)).count();
            all += estimates.len();
        }
        let mean = estimates.iter().map(|found| found.relative_rmse).sum::<f64>() / estimates.len() as f64;
        assert!(mean > before && mean < 1.5 * full, "{lights} lights: {full}, {estimates:?}");
        before = mean;
    }
    assert!(held * 4 >= all * 3, "{held} of {all} intervals hold the error of all pixels");
    let settings = &settings("gi.bounces=0 reflection.method=none");
    stage.subject.render(renderer, settings, SIZE).unwrap();
    let without = estimate(renderer, store, Frame::new(camera, settings, objects, SIZE), RAYS, 5).unwrap();
    assert_eq!(without, None, "nothing to estimate");
}

#[test]
fn a_probe_that_is_given_up_leaves_the_frame_and_can_be_made_again() {
    let Some(mut studio) = studio() else { return };
    let Studio { gpu, renderer } = &mut *studio;
    let Stage { subject, .. } = Stage::new(gpu, Variant::Torus);
    let settings = settings("gi.vpls=16 reflection.method=environment_map");
    subject.render(renderer, &settings, SIZE).unwrap();
    let picture = renderer.read_picture().unwrap();
    let mut probe = |flag: bool| {
        renderer.give_up_when(Some(Arc::new(move || flag)));
        let probe = renderer.probe(&subject.store, &still_settings(&settings), subject.objects(), 64, 1);
        renderer.give_up_when(None);
        probe.map(|probe| (probe.mirrors, probe.lights))
    };
    assert!(matches!(probe(true), Err(render::Error::GivenUp)));
    let first = probe(false).unwrap();
    assert!(first.0.len() == 64 && first.1.len() == 64);
    assert!(matches!(probe(true), Err(render::Error::GivenUp)));
    assert_eq!(probe(false).unwrap(), first);
    assert!(renderer.read_picture().unwrap() == picture);
}
