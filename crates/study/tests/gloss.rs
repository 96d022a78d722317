//! Glossy mirrors of the renderer against those of the ray tracer.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use cloud::Progress;
use render::{Error, Gpu, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{METHODS, Method, Settings, Shape};
use study::auto::{self, Hands};
use study::{CostModel, Subject, Target, TracedScene, Tracer, Truth, View};

const SIZE: [u32; 2] = [96, 72];

#[test]
fn the_error_falls_with_the_root_of_the_samples() {
    let gpu = match Gpu::headless(None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => return println!("skipped: {error}"),
    };
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let mut settings = Settings::default();
    (settings.gi.bounces, settings.trace.samples) = (0, 1024);
    settings.set_text("gloss.pattern", "pixel").unwrap();
    for (variant, power, lobe) in
        [(Variant::Sphere, 30.0, "phong"), (Variant::Torus, 100.0, "blinn"), (Variant::Sphere, 100.0, "blinn")]
    {
        let mut parts = five_mirrors::sample(variant, 60_000, 1);
        parts.iter_mut().filter_map(|part| part.mirror.as_mut()).for_each(|mirror| mirror.specular_power = power);
        let (lights, camera) = (vec![five_mirrors::light()], five_mirrors::camera());
        let subject = Subject::sampled(&gpu, parts, lights, camera, None, &settings).unwrap();
        let traced = TracedScene::new(&subject.parts, None, settings.splat.size, &Progress::default()).unwrap();
        settings.set_text("gloss.lobe", lobe).unwrap();
        // Lamps that one glossy mirror shows in another are seen by few rays, each very bright.
        settings.set_text("light.by", if variant == Variant::Torus { "colors" } else { "lights" }).unwrap();
        // The second bounce is glossy, too.
        settings.reflection.bounces = if variant == Variant::Torus { 2 } else { 1 };
        for method in [Method::SurfelTrace, Method::SscrHierarchical] {
            settings.reflection.method = method;
            let (mut errors, mut truth) = (Vec::new(), None);
            for samples in [1, 4, 16, 64] {
                settings.gloss.samples = samples;
                subject.render(&mut renderer, &settings, SIZE).unwrap();
                let view =
                    View { camera: &subject.camera, settings: &settings, objects: subject.objects(), size: SIZE };
                let tracer = Tracer::new(&traced, view);
                let drawn = tracer.drawn(&renderer).unwrap();
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
                errors.push((squares / count).sqrt());
            }
            let slope = (errors[3] / errors[0]).ln() / 64_f64.ln();
            let what = format!("{}, power {power}, {lobe}, {}", variant.name(), method.row().name);
            println!("{what}: {errors:.5?}, as samples to the power of {slope:.2}");
            assert!(slope <= -0.4, "{what}: {errors:?}");
        }
    }
}

#[test]
fn auto_chooses_no_method_that_refuses_the_glossy_mirrors_of_a_scene() {
    let gpu = match Gpu::headless(None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => return println!("skipped: {error}"),
    };
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
    for target in [Target::Milliseconds(0.001), Target::Milliseconds(1e6), Target::Pixels(1e3)] {
        let mut draw =
            |renderer: &mut Renderer, settings: &Settings, size| Ok(subject.render(renderer, settings, size)?);
        let mut hands = Hands { renderer: &mut renderer, draw: &mut draw, model: &mut CostModel::default() };
        let choice = auto::choose(target, &settings, &fixed, (&camera, [48, 36]), &mut hands).unwrap();
        let mut chosen = settings.clone();
        choice.apply(&mut chosen).unwrap();
        assert!(!refused.contains(&chosen.reflection.method), "{target}: {choice:?}");
        subject.render(&mut renderer, &chosen, [48, 36]).unwrap();
    }
}
