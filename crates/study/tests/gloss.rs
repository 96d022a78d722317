//! Glossy mirrors of the renderer against those of the ray tracer.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::{Arc, LazyLock};

use cloud::Progress;
use render::{Error, Gpu, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{METHODS, Method, Settings, Shape};
use study::auto::{Explored, Hands};
use study::{CostModel, Subject, Target, TracedScene, Tracer, Truth, View};

const SIZE: [u32; 2] = [96, 72];

/// The device of all tests, so that each pass is compiled once; `None` without an adapter.
static GPU: LazyLock<Option<Arc<Gpu>>> = LazyLock::new(|| match Gpu::headless(None) {
    Ok(gpu) => Some(gpu),
    Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
    Err(error) => {
        println!("skipped: {error}");
        None
    }
});

/// A glossy mirror in a box, and the colours that the ray tracer finds for its pixels.
struct Judged {
    subject: Subject,
    traced: TracedScene,
    truth: Option<Vec<[f32; 3]>>,
}

impl Judged {
    fn new(gpu: &Arc<Gpu>, variant: Variant, power: f32, settings: &Settings) -> Self {
        let mut parts = five_mirrors::sample(variant, 60_000, 1);
        parts.iter_mut().filter_map(|part| part.mirror.as_mut()).for_each(|mirror| mirror.specular_power = power);
        let (lights, camera) = (vec![five_mirrors::light()], five_mirrors::camera());
        let subject = Subject::sampled(gpu, parts, lights, camera, None, settings).unwrap();
        let traced = TracedScene::new(&subject.parts, None, settings.splat.size, &Progress::default()).unwrap();
        Self { subject, traced, truth: None }
    }

    /// Draws a picture, and returns the root of the mean square of its errors.
    fn error(&mut self, renderer: &mut Renderer, settings: &Settings) -> f64 {
        let Self { subject, traced, truth } = self;
        subject.render(renderer, settings, SIZE).unwrap();
        let view = View { camera: &subject.camera, settings, objects: subject.objects(), size: SIZE };
        let tracer = Tracer::new(traced, view);
        let drawn = tracer.drawn(renderer).unwrap();
        let truth = truth.get_or_insert_with(|| {
            let seen = study::mirrors_of(&tracer.seen(&drawn.surface));
            tracer.colors(Truth::SameInput, &seen, &Progress::default()).unwrap()
        });
        let (mut squares, mut count) = (0.0, 0.0);
        for (shown, traced) in drawn.color.iter().zip(truth.iter()).filter(|(_, traced)| !traced[0].is_nan()) {
            let parts = shown.iter().zip(traced).map(|(a, b)| f64::from(a - b).powi(2));
            (squares, count) = (squares + parts.sum::<f64>(), count + 3.0);
        }
        assert!(count > 1000.0);
        (squares / count).sqrt()
    }
}

#[test]
fn the_error_falls_with_the_root_of_the_samples() {
    let Some(gpu) = GPU.clone() else { return };
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let mut settings = Settings::default();
    // A truth of 256 samples has a quarter of the variance of a picture of 64: slopes are flatter by some hundredths.
    (settings.gi.bounces, settings.trace.samples) = (0, 256);
    settings.set_text("gloss.pattern", "pixel").unwrap();
    for (variant, power, lobe) in [
        (Variant::Sphere, 30.0, "phong"),
        (Variant::Torus, 100.0, "blinn"),
        (Variant::Sphere, 100.0, "blinn"),
        (Variant::Torus, 1000.0, "ashikhmin_shirley"),
        (Variant::Sphere, 10.0, "ashikhmin_shirley"),
    ] {
        settings.set_text("gloss.lobe", lobe).unwrap();
        // The exponents of Ashikhmin and Shirley are 1000 and 10, or 10 and 1000.
        settings.gloss.across = if power < 100.0 { 100.0 } else { 0.01 };
        // Lamps that one glossy mirror shows in another are seen by few rays, each very bright.
        settings.set_text("light.by", if variant == Variant::Torus { "colors" } else { "lights" }).unwrap();
        // The second bounce is glossy, too.
        settings.reflection.bounces = if variant == Variant::Torus { 2 } else { 1 };
        let mut judged = Judged::new(&gpu, variant, power, &settings);
        for method in [Method::SurfelTrace, Method::SscrHierarchical] {
            settings.reflection.method = method;
            let errors = [1, 64].map(|samples| {
                settings.gloss.samples = samples;
                judged.error(&mut renderer, &settings)
            });
            let slope = (errors[1] / errors[0]).ln() / 64_f64.ln();
            let what = format!("{}, power {power}, {lobe}, {}", variant.name(), method.row().name);
            println!("{what}: {errors:.5?}, as samples to the power of {slope:.2}");
            assert!(slope <= -0.4, "{what}: {errors:?}");
        }
    }
}

#[test]
fn rays_of_one_lobe_show_other_powers_with_a_little_more_noise() {
    let Some(gpu) = GPU.clone() else { return };
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let mut settings = Settings::default();
    (settings.trace.samples, settings.gloss.samples) = (512, 16);
    settings.reflection.method = Method::SurfelTrace;
    for (key, value) in [("light.by", "colors"), ("gloss.pattern", "pixel"), ("gloss.cache_trust", "0")] {
        settings.set_text(key, value).unwrap();
    }
    for power in [100.0, 300.0, 1000.0, 3000.0] {
        let mut judged = Judged::new(&gpu, Variant::Sphere, power, &settings);
        let [own, two, one] = [(0.0, 1.0), (1000.0, 10.0), (1000.0, 1.0)].map(|(cache_power, spread)| {
            (settings.gloss.cache_power, settings.gloss.cache_spread) = (cache_power, spread);
            let squares = (1..=4).map(|seed| {
                settings.gloss.seed = seed;
                judged.error(&mut renderer, &settings).powi(2)
            });
            (squares.sum::<f64>() / 4.0).sqrt()
        });
        let what = format!("power {power}: {own:.4}, by two lobes {:.2}, by one {:.2}", two / own, one / own);
        println!("{what}");
        assert!(two < 2.0 * own, "{what}");
        // Of a mirror that is less polished one lobe alone has too few rays.
        assert!(power >= 1000.0 || one > 1.5 * two, "{what}");
    }
}

#[test]
fn a_blur_lowers_the_error_of_few_samples() {
    let Some(gpu) = GPU.clone() else { return };
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let mut settings = Settings::default();
    settings.trace.samples = 1024;
    settings.reflection.method = Method::SurfelTrace;
    settings.set_text("light.by", "colors").unwrap();
    for (variant, power, pattern, most) in [
        (Variant::Sphere, 30.0, "pixel", [0.6, 0.65, 0.85]),
        (Variant::Sphere, 30.0, "shared", [0.9, 0.75, 0.85]),
        (Variant::Torus, 10.0, "pixel", [0.6, 0.7, 1.0]),
    ] {
        settings.set_text("gloss.pattern", pattern).unwrap();
        let mut judged = Judged::new(&gpu, variant, power, &settings);
        for (samples, most) in [1, 4, 16].into_iter().zip(most) {
            settings.gloss.samples = samples;
            let [sharp, half, blurred] = [0.0, 0.5, 1.0].map(|blur| {
                settings.gloss.blur = blur;
                judged.error(&mut renderer, &settings)
            });
            let what = format!(
                "{}, power {power}, {pattern}, {samples} rays: {sharp:.4}, {half:.4}, {blurred:.4}",
                variant.name()
            );
            println!("{what}");
            assert!(blurred < most * sharp, "{what}");
        }
    }
}

#[test]
fn auto_chooses_no_method_that_refuses_the_glossy_mirrors_of_a_scene() {
    let Some(gpu) = GPU.clone() else { return };
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let mut settings = Settings::default();
    (settings.gi.bounces, settings.gloss.samples) = (0, 2);
    let mut parts = five_mirrors::sample(Variant::Sphere, 20_000, 1);
    for mirror in parts.iter_mut().filter_map(|part| part.mirror.as_mut()) {
        // A flat mirror shows what any method that refuses it would show best.
        (mirror.shape, mirror.specular_power) = (Shape::Plane { height: 1.0 }, 300.0);
    }
    let (lights, camera) = (vec![five_mirrors::light()], five_mirrors::camera());
    let subject = Subject::sampled(&gpu, parts, lights, camera, None, &settings).unwrap();
    let mut refused = Vec::new();
    for row in METHODS.iter() {
        let drawn = subject.render(
            &mut renderer,
            &Settings {
                reflection: scene::Reflection { method: row.method, ..settings.reflection.clone() },
                ..settings.clone()
            },
            [48, 36],
        );
        match drawn {
            Ok(_) => {}
            Err(Error::PerfectMirrorsOnly { .. }) => refused.push(row.method),
            Err(error) => panic!("{}: {error}", row.name),
        }
    }
    assert!(refused.contains(&Method::MirroredViewpoint), "{refused:?}");
    // Only the method and its parameters are free.
    let fixed = [
        "view.resolution",
        "splat.step",
        "splat.quality",
        "reflection.bounces",
        "gi.bounces",
        "gi.vpls",
        "gi.interleave",
    ];
    let fixed = fixed.map(str::to_owned);
    let mut draw =
        |renderer: &mut Renderer, settings: &Settings, size| Ok(subject.render_next(renderer, settings, size)?);
    let mut hands = Hands { renderer: &mut renderer, draw: &mut draw, model: &mut CostModel::default() };
    // Light is fixed, so what is known of the view serves targets of all kinds.
    let mut explored = Explored::new(&settings, &fixed, (&camera, [48, 36]), true, &mut hands).unwrap();
    for target in [Target::Milliseconds(0.001), Target::Milliseconds(1e6), Target::Pixels(1e3)] {
        let choice = explored.choose(target, &mut hands).unwrap();
        let mut chosen = settings.clone();
        choice.apply(&mut chosen).unwrap();
        assert!(!refused.contains(&chosen.reflection.method), "{target}: {choice:?}");
        subject.render(hands.renderer, &chosen, [48, 36]).unwrap();
    }
}
