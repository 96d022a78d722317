//! How accurate hierarchical SSCR must be on the five mirrors, and that broken results miss these bounds.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use cloud::Progress;
use glam::Vec3;
use render::{Aov, Gpu, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{Settings, ViewSettings};
use study::{Accuracy, Exact, MirrorImage, Subject, TracedScene, accuracy_same_input, pixel_errors_same_input};
use trace::{PixelRays, Surfels, primary};

const SIZE: [u32; 2] = [200, 150];
const POINTS: u32 = 200_000;
const MIRRORS: [Variant; 5] = [Variant::Sphere, Variant::Parabolic, Variant::Blob, Variant::Torus, Variant::Coral];

/// A frame's images, and its points in the form for the ray tracer.
struct Frame {
    variant: Variant,
    mirror: Vec<f32>,
    position: Vec<f32>,
    normal: Vec<f32>,
    mirror_position: Vec<f32>,
    uncertain: Vec<f32>,
    surfels: Surfels,
}

/// The renderer and the scenes of the frames.
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

impl Studio {
    fn frame(&mut self, variant: Variant, method: &str) -> Frame {
        self.frame_with(variant, &[("reflection.method", method)])
    }

    fn frame_with(&mut self, variant: Variant, pairs: &[(&str, &str)]) -> Frame {
        let mut settings = Settings::default();
        settings.scene.points = POINTS;
        settings.gi.bounces = 0;
        pairs.iter().for_each(|(key, value)| settings.set_text(key, value).unwrap());
        let subject = Subject::five_mirrors(&self.gpu, variant, &settings).unwrap();
        subject.render(&mut self.renderer, &settings, SIZE).unwrap();
        let traced = TracedScene::new(&subject.parts, None, settings.splat.size, &Progress::default()).unwrap();
        let read = |aov| self.renderer.read_aov_from(aov, traced.origin).unwrap().data;
        Frame {
            variant,
            mirror: read(Aov::Mirror),
            position: read(Aov::Position),
            normal: read(Aov::Normal),
            mirror_position: read(Aov::MirrorPosition),
            uncertain: read(Aov::Uncertain),
            surfels: traced.surfels,
        }
    }
}

/// One of each mirror; `None` without an adapter.
static FRAMES: LazyLock<Vec<Frame>> = LazyLock::new(|| {
    let Some(mut studio) = studio() else { return Vec::new() };
    MIRRORS.map(|variant| studio.frame(variant, "sscr_hierarchical")).into()
});

impl Frame {
    fn image<'a>(&'a self, normal: &'a [f32], mirror_position: &'a [f32]) -> MirrorImage<'a> {
        let rays = PixelRays::new(&five_mirrors::camera(), &ViewSettings::default(), SIZE, 0.0);
        let Self { mirror, position, .. } = self;
        MirrorImage { size: SIZE, viewpoint: rays.viewpoint(), mirror, position, normal, mirror_position }
    }

    fn judge(&self, normal: &[f32], mirror_position: &[f32]) -> Accuracy {
        accuracy_same_input(&self.image(normal, mirror_position), &self.surfels, &Progress::default()).unwrap()
    }

    /// The bounds that a result misses, with its values.
    fn missed(&self, figures: &Accuracy) -> Vec<String> {
        let is_coral = self.variant == Variant::Coral;
        let error = figures.pixel_error;
        let bounds = [
            ("coverage", figures.coverage >= 0.9, figures.coverage),
            ("closed coverage", figures.closed_coverage >= 0.99, figures.closed_coverage),
            ("recall", figures.recall.unwrap_or(0.0) >= 0.98, figures.recall.unwrap_or(0.0)),
            ("false fill", figures.false_fill < 0.005, figures.false_fill),
            ("median pixel error", error.median < 0.5, error.median),
            ("95th percentile of the pixel error", error.p95 < if is_coral { 4.0 } else { 2.0 }, error.p95),
            ("99th percentile of the pixel error", is_coral || error.p99 < 5.0, error.p99),
            ("occlusion error", figures.occlusion_error < 0.02, figures.occlusion_error),
        ];
        let missed = bounds.into_iter().filter(|(_, is_met, _)| !is_met);
        missed.map(|(name, _, value)| format!("{}: {name} {value}", self.variant.name())).collect()
    }
}

#[test]
fn hierarchical_sscr_is_as_accurate_as_it_claims_on_each_mirror() {
    for frame in FRAMES.iter() {
        let figures = frame.judge(&frame.normal, &frame.mirror_position);
        assert!(figures.mirror_pixels > 2000, "{}", figures.mirror_pixels);
        assert_eq!(frame.missed(&figures), Vec::<String>::new());
    }
}

/// Pixels that are a mirror only in the frame or only in truth, and have no pixel of the other kind beside them in
/// truth.
fn far_from_the_silhouette(drawn: &[f32], truth: &[bool]) -> usize {
    let [width, height] = SIZE.map(|side| side as usize);
    let is_far = |pixel: &usize| {
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let mut beside = rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
        beside.all(|other| truth[other] == truth[*pixel])
    };
    (0..truth.len()).filter(|&pixel| (drawn[pixel] > 0.0) != truth[pixel]).filter(is_far).count()
}

#[test]
fn masks_of_mirrors_are_those_of_the_exact_surfaces_within_a_pixel() {
    for frame in FRAMES.iter() {
        let rays = PixelRays::new(&five_mirrors::camera(), &ViewSettings::default(), SIZE, 0.0);
        let exact = Exact::five_mirrors(frame.variant);
        let seen = primary(&exact, &rays, &Progress::default()).unwrap();
        let truth: Vec<bool> = seen.iter().map(|hit| hit.is_some_and(|hit| hit.specular_intensity > 0.0)).collect();
        let name = frame.variant.name();
        assert_eq!(far_from_the_silhouette(&frame.mirror, &truth), 0, "{name}");
        let shifted: Vec<f32> = frame.mirror.iter().copied().skip(3).chain([0.0; 3]).collect();
        assert!(far_from_the_silhouette(&shifted, &truth) > 20, "{name}: three pixels aside");
    }
}

/// Compares a frame's doubts with the truth: the share that it marks of the wrong pixels, and of the right ones.
fn marked_shares(frame: &Frame) -> [f64; 2] {
    let image = frame.image(&frame.normal, &frame.mirror_position);
    let errors = pixel_errors_same_input(&image, &frame.surfels, &Progress::default()).unwrap();
    let mut counts = [[0.0; 2]; 2];
    for (error, doubt) in errors.iter().zip(&frame.uncertain) {
        let Some(error) = error else { continue };
        counts[usize::from(!error.is_wrong())][usize::from(*doubt > 0.0)] += 1.0;
    }
    counts.map(|[trusted, marked]| marked / (trusted + marked))
}

#[test]
fn most_of_what_is_wrong_is_marked_as_uncertain_and_little_of_what_is_right() {
    let Some(mut studio) = studio() else { return };
    for variant in MIRRORS {
        // On the coral neighbouring pixels see different walls, so right pixels may be alone as well.
        let most = if variant == Variant::Coral { [0.75, 0.6] } else { [0.4, 0.1] };
        for (method, least, most) in [("sscr", 0.6, most[0]), ("sscr_hierarchical", 0.6, most[1])] {
            let [wrong, right] = marked_shares(&studio.frame(variant, method));
            println!("{} {method}: {wrong:.3} of what is wrong, {right:.3} of what is right", variant.name());
            assert!(wrong.is_nan() || wrong > least, "{}, {method}: {wrong}", variant.name());
            assert!(right < most, "{}, {method}: {right}", variant.name());
        }
    }
}

#[test]
fn broken_results_miss_the_bounds() {
    for frame in FRAMES.iter() {
        let mut shifted = frame.mirror_position.clone();
        shifted.rotate_right(4);
        let mut scaled = frame.mirror_position.clone();
        scaled.as_chunks_mut::<4>().0.iter_mut().for_each(|[x, y, z, _]| {
            [x, y, z].into_iter().for_each(|value| *value *= 1.05);
        });
        // What the method found with right normals is judged by wrong ones: the error is as large as the other way
        // round.
        let flipped: Vec<f32> = frame.normal.as_chunks::<3>().0.iter().flat_map(|[x, y, z]| [-x, *y, *z]).collect();
        for (name, normal, found) in [
            ("shifted by a pixel", &frame.normal, &shifted),
            ("scaled by 5 %", &frame.normal, &scaled),
            ("by flipped normals", &flipped, &frame.mirror_position),
        ] {
            let figures = frame.judge(normal, found);
            assert!(!frame.missed(&figures).is_empty(), "{}, {name}: {figures:?}", frame.variant.name());
        }
    }
}

#[test]
fn doubts_of_maps_alone_mark_what_is_wrong_and_what_is_proven_is_right() {
    let Some(mut studio) = studio() else { return };
    // Between mirrors there is no neighbour that agrees.
    for (variant, most) in [(Variant::Torus, 0.1), (Variant::All, 0.3)] {
        let pairs = [("reflection.method", "cubemap_trace"), ("cubemap_trace.rest", "none")];
        let frame = studio.frame_with(variant, &pairs);
        let [wrong, right] = marked_shares(&frame);
        println!("{}: {wrong:.3} of what is wrong, {right:.3} of what is right", variant.name());
        assert!(wrong.is_nan() || wrong > 0.7, "{}: {wrong}", variant.name());
        assert!(right < most, "{}: {right}", variant.name());
        // Found, not closed: by planes that is proven.
        let mut proven = frame.mirror_position.clone();
        proven.as_chunks_mut::<4>().0.iter_mut().filter(|pixel| pixel[3] < 1.0).for_each(|pixel| pixel[3] = 0.0);
        let figures = frame.judge(&frame.normal, &proven);
        assert!(figures.coverage > 0.93 && figures.wrong < 0.02, "{}: {figures:?}", variant.name());
    }
}

/// The shares of the true hits that the picture holds: all that it holds, and of these, those that the walk finds.
fn held_and_found(truth: &Frame, walked: &Frame) -> [f64; 2] {
    let camera = five_mirrors::camera();
    let view_from_world = camera.view_from_world();
    let [width, height] = SIZE.map(f64::from);
    let focal = height * 0.5 / (f64::from(ViewSettings::default().field_of_view).to_radians() * 0.5).tan();
    let vector = |data: &[f32], index: usize| Vec3::from_slice(&data[index..]).as_dvec3();
    let (mut hits, mut held, mut found) = (0.0, 0.0, 0.0);
    for pixel in (0..truth.mirror.len()).filter(|pixel| truth.mirror_position[pixel * 4 + 3] == 1.0) {
        hits += 1.0;
        let hit = vector(&truth.mirror_position, pixel * 4);
        let view = view_from_world * (hit - camera.eye);
        let (x, y) = (width * 0.5 + view.x / view.z * focal, height * 0.5 - view.y / view.z * focal);
        if view.z <= 0.0 || !(0.0..width).contains(&x) || !(0.0..height).contains(&y) {
            continue;
        }
        let shown = y as usize * SIZE[0] as usize + x as usize;
        let [place, normal] = [&walked.position, &walked.normal].map(|data| vector(data, shown * 3));
        // On the plane of the pixel, as far as a pixel is wide.
        if normal.dot(place - hit).abs() < view.z / focal {
            held += 1.0;
            let end = vector(&walked.mirror_position, pixel * 4);
            let distance = hit.distance(vector(&walked.position, pixel * 3));
            found += f64::from(u8::from(end.distance(hit) < 0.05 * distance));
        }
    }
    [held / hits, found / held]
}

#[test]
fn screen_tracing_finds_nearly_all_that_the_picture_holds() {
    let Some(mut studio) = studio() else { return };
    for (variant, least) in [(Variant::Sphere, 0.88), (Variant::Blob, 0.88), (Variant::Torus, 0.85)] {
        let truth = studio.frame(variant, "surfel_trace");
        let pairs = [("reflection.method", "screen_trace"), ("screen_trace.rest", "none")];
        let walked = studio.frame_with(variant, &pairs);
        let [held, found] = held_and_found(&truth, &walked);
        println!("{}: the picture holds {held:.3} of the hits, of which the walk finds {found:.3}", variant.name());
        assert!(held > 0.2 && held < 0.8 && found >= least, "{}: {held}, {found}", variant.name());
    }
}

#[test]
fn a_chain_of_methods_is_as_accurate_as_its_last_link() {
    let Some(mut studio) = studio() else { return };
    for variant in [Variant::Coral, Variant::Torus] {
        let mut judged = |pairs: &[(&str, &str)]| {
            let frame = studio.frame_with(variant, pairs);
            frame.judge(&frame.normal, &frame.mirror_position)
        };
        let walked = |rest: &'static str| [("reflection.method", "screen_trace"), ("screen_trace.rest", rest)];
        let alone = judged(&walked("none"));
        for last in ["surfel_trace", "cubemap_trace"] {
            let chained = judged(&walked(last));
            let reference = judged(&[("reflection.method", last)]);
            let errors = [&alone, &chained, &reference].map(|figures| figures.occlusion_error);
            println!("{}: alone, chained, {last}: {errors:.4?}", variant.name());
            assert!(errors[1] <= errors[0] && errors[1] <= errors[2] + 0.003, "{}: {errors:?}", variant.name());
            assert!(chained.coverage > 0.97, "{}: {}", variant.name(), chained.coverage);
        }
    }
}
