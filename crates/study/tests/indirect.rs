//! How accurate indirect light must be in the box of the five mirrors, and that broken light misses these bounds.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::{Arc, LazyLock, Mutex, MutexGuard};

use render::{Aov, Gpu, Renderer};
use scene::Settings;
use scene::five_mirrors::Variant;
use study::{FiveMirrors, IndirectTruth, JudgedLight, LightError, TracedLight};

/// The columns in the middle of a picture of 320 x 240, so that pixels have equal places and sizes in both.
const SIZE: [u32; 2] = [160, 240];
/// Of the box without a ball, which is as wide as it is high, columns that show its back, its floor and its ceiling are
/// enough.
const OPEN: [u32; 2] = [96, 240];
/// 960 or 1536 pixels of 1024 paths each: a noise of three hundredths, which is subtracted from the errors.
const TRACED: TracedLight = TracedLight { stride: 5, paths: 1024, over_mirrors: false };

/// Drivers take a while to compile each pass: one renderer, and one scene at a time.
struct Studio {
    gpu: Arc<Gpu>,
    renderer: Renderer,
    open: FiveMirrors,
    with_sphere: FiveMirrors,
    truth: IndirectTruth,
    truth_of_sphere: IndirectTruth,
}

/// `None` without an adapter.
static STUDIO: LazyLock<Option<Mutex<Studio>>> = LazyLock::new(|| {
    let gpu = match Gpu::headless(None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            return None;
        }
    };
    let settings = settings("");
    let stage = |variant| FiveMirrors::new(&gpu, variant, &settings).unwrap();
    let (open, with_sphere) = (stage(Variant::None), stage(Variant::Sphere));
    let truth = open.indirect_truth(&settings, OPEN, TRACED).unwrap();
    let truth_of_sphere = with_sphere.indirect_truth(&settings, SIZE, TRACED).unwrap();
    println!("noise of the truths: {} {}", truth.noise, truth_of_sphere.noise);
    let renderer = Renderer::new(gpu.clone()).unwrap();
    Some(Mutex::new(Studio { gpu, renderer, open, with_sphere, truth, truth_of_sphere }))
});

fn studio() -> Option<MutexGuard<'static, Studio>> {
    STUDIO.as_ref().map(|studio| studio.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

/// `text` has keys and values in addition to those of all tests.
fn settings(text: &str) -> Settings {
    let mut settings = Settings::default();
    let all = format!("scene.points=200000 reflection.method=none {text}");
    for (key, value) in all.split_whitespace().map(|word| word.split_once('=').unwrap()) {
        settings.set_text(key, value).unwrap();
    }
    settings
}

impl Studio {
    /// The error on pixels that show the truth's surface: the smaller the picture, the more pixels contain edges.
    fn judge(&mut self, text: &str) -> LightError {
        self.open.render(&mut self.renderer, &settings(text), OPEN).unwrap();
        told(text, self.open.judge_indirect(&self.renderer, &self.truth).unwrap(), self.truth.noise)
    }

    fn judge_sphere(&mut self, text: &str) -> LightError {
        // The truth's ball is black, and so is one whose reflections are followed.
        let settings = settings(&format!("{text} reflection.method=environment_map"));
        self.with_sphere.render(&mut self.renderer, &settings, SIZE).unwrap();
        let judged = self.with_sphere.judge_indirect(&self.renderer, &self.truth_of_sphere).unwrap();
        told(text, judged, self.truth_of_sphere.noise)
    }
}

/// The error without the truth's own noise, which is independent of it.
fn told(text: &str, judged: JudgedLight, noise: f64) -> LightError {
    let mut error = judged.same_surface;
    error.relative_rmse = (error.relative_rmse.powi(2) - noise * noise).max(0.0).sqrt();
    println!("{text}: {judged:?}, without noise {:.4}", error.relative_rmse);
    assert!(judged.share > 0.95, "{judged:?}");
    error
}

/// The bounds for 1024 lights, in the open box and with a ball in it, whose shadows have soft edges of a few texels.
fn is_accurate(error: &LightError, most: f64) -> bool {
    error.relative_rmse < most && (error.mean_ratio - 1.0).abs() < 0.03
}

#[test]
fn a_thousand_lights_are_as_accurate_as_claimed_and_fewer_less_so() {
    let Some(mut studio) = studio() else { return };
    let few = studio.judge("gi.interleave=1 gi.vpls=64");
    let more = studio.judge("gi.interleave=1 gi.vpls=256");
    let many = studio.judge("gi.interleave=1 gi.vpls=1024");
    assert!(is_accurate(&many, 0.08), "{many:?}");
    assert!(few.relative_rmse > more.relative_rmse && more.relative_rmse > many.relative_rmse);
    let interleaved = studio.judge("gi.interleave=4 gi.vpls=1024");
    // 0.03 at 800 x 600, where the filter's window is a sixth of this one's area.
    assert!(interleaved.relative_rmse < many.relative_rmse + 0.04, "{interleaved:?}");
    let unfiltered = studio.judge("gi.interleave=4 gi.vpls=1024 gi.filtered=false");
    assert!(unfiltered.relative_rmse > interleaved.relative_rmse, "the filter is good for nothing: {unfiltered:?}");
}

#[test]
fn two_bounces_of_a_thousand_lights_bring_what_the_truth_has() {
    let Some(mut studio) = studio() else { return };
    let traced = TracedLight { stride: 7, paths: 512, ..TRACED };
    let truth = studio.open.indirect_truth(&settings("gi.bounces=2"), OPEN, traced).unwrap();
    let Studio { renderer, open, .. } = &mut *studio;
    let text = "gi.bounces=2 gi.interleave=1 gi.vpls=1024";
    open.render(renderer, &settings(text), OPEN).unwrap();
    let error = told(text, open.judge_indirect(renderer, &truth).unwrap(), truth.noise);
    assert!(error.relative_rmse < 0.1 && (error.mean_ratio - 1.0).abs() < 0.015, "{error:?}");
}

#[test]
fn light_by_rays_is_within_a_hundredth_of_the_truth_and_the_more_rays_the_nearer() {
    let Some(mut studio) = studio() else { return };
    let few = studio.judge("gi.by=rays gi.rays_per_pixel=1");
    let many = studio.judge("gi.by=rays gi.rays_per_pixel=64");
    assert!(many.relative_rmse < 0.04 && (many.mean_ratio - 1.0).abs() < 0.01, "{many:?}");
    assert!(few.relative_rmse > 1.5 * many.relative_rmse && few.relative_rmse < 0.3, "{few:?} and {many:?}");
}

#[test]
fn shadows_of_a_ball_are_where_they_belong_and_broken_light_misses_the_bounds() {
    const MOST: f64 = 0.12;
    let Some(mut studio) = studio() else { return };
    let right = studio.judge_sphere("gi.interleave=1 gi.vpls=1024");
    assert!(is_accurate(&right, MOST), "{right:?}");
    // Half of the flux.
    let image = studio.renderer.read_aov(Aov::Indirect).unwrap().data;
    let halved: Vec<[f32; 3]> = image.as_chunks::<3>().0.iter().map(|color| color.map(|value| value / 2.0)).collect();
    assert!(!is_accurate(&studio.truth_of_sphere.judge(&halved), MOST));
    let without_shadows = studio.judge_sphere("gi.interleave=1 gi.vpls=1024 gi.shadows=false");
    assert!(!is_accurate(&without_shadows, MOST), "{without_shadows:?}");
}

#[test]
fn spherical_lights_do_not_sparkle_where_points_do() {
    let Some(mut studio) = studio() else { return };
    let glossy = "light.gloss=0.95 light.gloss_power=1000 gi.interleave=1";
    // The brightest pixels are the same, within a thousandth, as with 1024 paths.
    let traced = TracedLight { stride: 2, paths: 256, ..TRACED };
    let truth = studio.open.indirect_truth(&settings(glossy), SIZE, traced).unwrap();
    println!("noise of the glossy truth: {}", truth.noise);
    let mut brightest = |text: &str| {
        let Studio { renderer, open, .. } = &mut *studio;
        open.render(renderer, &settings(&format!("{glossy} {text}")), SIZE).unwrap();
        let judged = open.judge_indirect(renderer, &truth).unwrap();
        println!("{text}: {judged:?}");
        judged.all.brightest_ratio
    };
    let points = brightest("gi.vpl=point gi.vpls=64");
    assert!(points > 10.0, "{points}");
    for vpls in [64, 256] {
        let spheres = brightest(&format!("gi.vpl=spherical gi.vpls={vpls}"));
        assert!(spheres < 2.0, "{vpls} lights: {spheres}");
    }
}

#[test]
fn a_still_picture_does_not_change_and_a_moving_one_does_not_flicker() {
    let Some(mut studio) = studio() else { return };
    let Studio { renderer, open, .. } = &mut *studio;
    let settings = settings("");
    open.render(renderer, &settings, SIZE).unwrap();
    let first = renderer.read_aov(Aov::Indirect).unwrap().data;
    // Frames keep what did not change, from the second one on.
    for _ in 1..4 {
        open.render(renderer, &settings, SIZE).unwrap();
        let again = renderer.read_aov(Aov::Indirect).unwrap().data;
        let is_same = first.iter().zip(&again).all(|(one, other)| one.to_bits() == other.to_bits());
        assert!(is_same, "a still picture changed");
    }
    let flicker = open.flicker_of_indirect(renderer, &settings, SIZE, 16).unwrap();
    println!("{flicker:?}");
    assert!(flicker.mean < 1.0, "{flicker:?}");
}

#[test]
fn rays_of_light_find_what_a_mirror_ball_throws_on_the_walls_and_virtual_lights_do_not() {
    let Some(mut studio) = studio() else { return };
    let studio = &mut *studio;
    let [rays, lights] = ["gi.by=rays gi.rays_per_pixel=8", "gi.by=lights"]
        .map(|text| settings(&format!("{text} reflection.method=surfel_trace")));
    let traced = TracedLight { over_mirrors: true, paths: 256, stride: 10 };
    let truth = studio.with_sphere.indirect_truth(&rays, SIZE, traced).unwrap();
    let [rays, lights] = [rays, lights].map(|settings| {
        studio.with_sphere.render(&mut studio.renderer, &settings, SIZE).unwrap();
        studio.with_sphere.judge_indirect(&studio.renderer, &truth).unwrap().same_surface
    });
    println!("rays {rays:?}, lights {lights:?}, noise {}", truth.noise);
    assert!((rays.mean_ratio - 1.0).abs() < 0.02, "{rays:?}");
    assert!(lights.mean_ratio < 0.95, "{lights:?}");
}

#[test]
fn a_mirror_whose_reflections_are_not_followed_sends_as_much_light_as_a_diffuse_surface() {
    let Some(mut studio) = studio() else { return };
    let settings = settings("gi.vpls=1024 gi.interleave=1");
    let with_torus = FiveMirrors::new(&studio.gpu, Variant::Torus, &settings).unwrap();
    let traced = TracedLight { over_mirrors: true, paths: 256, ..TRACED };
    let truth = with_torus.indirect_truth(&settings, SIZE, traced).unwrap();
    with_torus.render(&mut studio.renderer, &settings, SIZE).unwrap();
    let image = studio.renderer.read_aov(Aov::Indirect).unwrap().data;
    let [torus, walls] = [true, false].map(|mirrors| truth.of_mirrors(mirrors).judge(image.as_chunks::<3>().0));
    println!("torus {torus:?}, walls {walls:?}, noise {}", truth.noise);
    // Shadow maps darken the curved torus a little more than the walls.
    assert!((torus.mean_ratio - 1.0).abs() < 0.06, "{torus:?}");
    assert!((walls.mean_ratio - 1.0).abs() < 0.03, "{walls:?}");
}
