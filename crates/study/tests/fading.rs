//! Reflections that fade by distance, and the published law of the angle: the renderer against the ray tracer.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod studio;

use cloud::Progress;
use render::Renderer;
use scene::five_mirrors::Variant;
use scene::{FresnelLaw, Settings};
use study::{Subject, TracedScene, Tracer, Truth, View};

use studio::{Studio, studio};

const SIZE: [u32; 2] = [96, 72];

/// The root of the mean square of the errors of what mirrors show, by a truth with settings of its own.
fn error(renderer: &mut Renderer, subject: &Subject, traced: &TracedScene, drawn: &Settings, truth: &Settings) -> f64 {
    subject.render(renderer, drawn, SIZE).unwrap();
    let view = View { camera: &subject.camera, settings: truth, objects: subject.objects(), size: SIZE };
    let tracer = Tracer::new(traced, view);
    let drawn = tracer.drawn(renderer).unwrap();
    let seen = study::mirrors_of(&tracer.seen(&drawn.surface));
    let colors = tracer.colors(Truth::SameInput, &seen, &Progress::default()).unwrap();
    tracer.image_error(&drawn, &seen, &colors).rmse
}

#[test]
fn what_fades_in_the_picture_fades_in_the_truth() {
    let Some(mut studio) = studio() else { return };
    let Studio { gpu, renderer } = &mut *studio;
    let mut settings = Settings::default();
    (settings.scene.points, settings.trace.samples, settings.gi.bounces) = (100_000, 64, 1);
    settings.set_text("reflection.method", "surfel_trace").unwrap();
    settings.set_text("light.by", "lights").unwrap();
    // The second reflection fades, too.
    settings.reflection.bounces = 2;
    let subject = Subject::five_mirrors(gpu, Variant::Torus, &settings).unwrap();
    let traced = TracedScene::new(&subject.parts, None, settings.splat.size, &Progress::default()).unwrap();
    let off = error(renderer, &subject, &traced, &settings, &settings);
    for (distance, least, law, fresnel, rays) in [
        (1.0, 0.0, FresnelLaw::Schlick, 0.0, 1),
        (3.0, 0.2, FresnelLaw::Schlick, 1.0, 4),
        (0.0, 0.0, FresnelLaw::Published, 1.0, 1),
        (4.0, 0.5, FresnelLaw::Published, 0.5, 1),
    ] {
        let mut faded = settings.clone();
        (faded.mirror.fade_distance, faded.mirror.fade_least) = (distance, least);
        (faded.mirror.fresnel_law, faded.mirror.fresnel) = (law, fresnel);
        faded.reflection.samples = rays;
        let found = error(renderer, &subject, &traced, &faded, &faded);
        let other = error(renderer, &subject, &traced, &faded, &settings);
        let what = format!("{distance}, {least}, {law:?} {fresnel}, {rays} rays: {found:.4}");
        println!("{what}; unfaded {off:.4}; by the unfaded truth {other:.4}");
        assert!(found < 1.5 * off && other > 3.0 * found, "{what}; {off} {other}");
    }
}
