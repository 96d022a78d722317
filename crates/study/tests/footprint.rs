//! What mirrors show, filtered to the footprint of a pixel, against many rays a pixel on exact surfaces.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use cloud::Progress;
use render::{Gpu, Renderer};
use scene::five_mirrors::Variant;
use scene::{Method, MirrorSurface, Settings};
use study::{Subject, TracedScene, Tracer, Truth, View};

const SIZE: [u32; 2] = [96, 72];

#[test]
fn rays_from_several_places_of_a_pixel_come_nearer_to_its_mean_for_every_method_that_traces() {
    let gpu = match Gpu::headless(None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => return println!("skipped: {error}"),
    };
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let mut settings = Settings::default();
    (settings.gi.bounces, settings.scene.points, settings.trace.rays) = (0, 200_000, 64);
    // The lamp leaves most of what mirrors show dark.
    settings.set_text("light.by", "colors").unwrap();
    let methods = [Method::SurfelTrace, Method::SscrHierarchical, Method::CubemapTrace, Method::ScreenTrace];
    for (variant, surface, most) in [
        (Variant::Sphere, MirrorSurface::Exact, 0.5),
        (Variant::Sphere, MirrorSurface::Points, 0.8),
        (Variant::Torus, MirrorSurface::Exact, 0.5),
        (Variant::Coral, MirrorSurface::Exact, 0.5),
    ] {
        settings.mirror.surface = surface;
        let subject = Subject::five_mirrors(&gpu, variant, &settings).unwrap();
        let exact = study::Exact::five_mirrors(variant);
        let traced = TracedScene::new(&subject.parts, Some(exact), 1.0, &Progress::default()).unwrap();
        let mut reference = None;
        for method in methods {
            settings.reflection.method = method;
            let errors = [1, 5].map(|samples| {
                settings.reflection.samples = samples;
                renderer.forget();
                subject.render(&mut renderer, &settings, SIZE).unwrap();
                let (camera, objects) = (&subject.camera, subject.objects());
                let tracer = Tracer::new(&traced, View { camera, settings: &settings, objects, size: SIZE });
                let (seen, colors) = reference.get_or_insert_with(|| {
                    let seen = study::mirrors_of(&tracer.exactly_seen(&Progress::default()).unwrap());
                    let colors = tracer.colors(Truth::Exact, &seen, &Progress::default()).unwrap();
                    (seen, colors)
                });
                tracer.image_error(&tracer.drawn(&renderer).unwrap(), seen, colors).delta_e
            });
            let what = format!("{}, {surface:?}, {}: {errors:?}", variant.name(), method.row().name);
            println!("{what}");
            assert!(errors[1] < most * errors[0], "{what}");
        }
    }
}
