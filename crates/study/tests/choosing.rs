//! What `auto` chooses where other work disturbs single frames. The times are made up, the pictures are drawn.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use render::{Error, FrameStats, Gpu, PassStage, PassTime, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{IndirectBy, Method, Settings};
use study::auto::{Hands, choose};
use study::{Choice, CostModel, Subject, Target};

const SIZE: [u32; 2] = [48, 36];

/// The other methods are refused, as if they could not show the scene.
const METHODS_TRIED: [Method; 5] =
    [Method::None, Method::EnvironmentMap, Method::SscrHierarchical, Method::SurfelTrace, Method::ScreenTrace];

/// The milliseconds that the passes of a frame take on a machine that has no other work: 71 with `surfel_trace`.
fn times(settings: &Settings, size: [u32; 2]) -> Vec<PassTime> {
    let share = f64::from(size[0] * size[1]) / f64::from(SIZE[0] * SIZE[1]);
    let method = match settings.reflection.method {
        Method::None => 0.0,
        Method::SurfelTrace => 30.0,
        Method::SscrHierarchical => 120.0,
        Method::ScreenTrace => 60.0,
        _ => 300.0,
    };
    let passes = [
        ("splat_nearest", PassStage::Surface, 20.0),
        ("surfel_trace", PassStage::Method, method),
        ("shade", PassStage::Light, 20.0),
        ("present", PassStage::View, 1.0),
    ];
    let passes = passes.into_iter().filter(|(_, _, milliseconds)| *milliseconds > 0.0);
    passes.map(|(name, stage, milliseconds)| PassTime { name, stage, milliseconds: milliseconds * share }).collect()
}

/// What is chosen for a time where the frame of a number takes so many times longer as `disturbed` says, and the methods
/// of the frames.
fn chosen(
    (subject, renderer): (&Subject, &mut Renderer),
    target: f64,
    model: &mut CostModel,
    disturbed: impl Fn(usize) -> f64,
) -> (Choice, Vec<Method>) {
    let mut settings = Settings::default();
    settings.gi.bounces = 0;
    let fixed = ["view.resolution", "splat.step", "splat.quality", "mirror.surface", "reflection.bounces"];
    let mut drawn = Vec::new();
    let mut draw = |renderer: &mut Renderer, settings: &Settings, size| {
        if !METHODS_TRIED.contains(&settings.reflection.method) {
            return Err(Error::PerfectMirrorsOnly { method: settings.reflection.method.row().name }.into());
        }
        let stats = subject.render_next(renderer, settings, size)?;
        let mut passes = times(settings, size);
        passes.iter_mut().for_each(|pass| pass.milliseconds *= disturbed(drawn.len()));
        drawn.push(settings.reflection.method);
        Ok(FrameStats { frame_milliseconds: passes.iter().map(|pass| pass.milliseconds).sum(), passes, ..stats })
    };
    let mut hands = Hands { renderer, draw: &mut draw, model };
    let view = (&subject.camera, SIZE);
    let target = Target::Milliseconds(target);
    let choice = choose(target, &settings, &fixed.map(str::to_owned), view, &mut hands).unwrap();
    (choice, drawn)
}

/// A sphere that mirrors, and what draws it; `None` where there is no adapter and none is required.
fn scene() -> Option<(Subject, Renderer)> {
    let gpu = match Gpu::headless(None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            return None;
        }
    };
    let parts = five_mirrors::sample(Variant::Sphere, 10_000, 1);
    let (lights, camera) = (vec![five_mirrors::light()], five_mirrors::camera());
    let subject = Subject::sampled(&gpu, parts, lights, camera, None, &Settings::default()).unwrap();
    Some((subject, Renderer::new(gpu).unwrap()))
}

#[test]
fn only_changes_that_may_be_chosen_are_tried_by_what_views_before_had() {
    let Some((subject, mut renderer)) = scene() else { return };
    let mut known = CostModel::default();
    let (calm, drawn) = chosen((&subject, &mut renderer), 150.0, &mut known, |_| 1.0);
    assert!(METHODS_TRIED.iter().all(|method| drawn.contains(method)), "nothing is known: {drawn:?}");
    let (again, drawn) = chosen((&subject, &mut renderer), 150.0, &mut known.clone(), |_| 1.0);
    assert_eq!((&again.set, again.predicted_error), (&calm.set, calm.predicted_error));
    assert!(!drawn.contains(&Method::None) && again.frames < calm.frames, "no mirror is far off: {drawn:?}");
    // In less time nothing else keeps to the target.
    let (least, drawn) = chosen((&subject, &mut renderer), 45.0, &mut known.clone(), |_| 1.0);
    assert_eq!(&*least.set["reflection.method"], "none", "{least:?}");
    assert!(!drawn.contains(&Method::ScreenTrace), "{drawn:?}");
    // Views before flattered one method and had a hundred times the square of another's error: what is found here tells.
    let mut wrong: serde_json::Value = serde_json::from_str(&known.to_text()).unwrap();
    let squares = wrong["errors"]["squares"].as_object_mut().unwrap();
    let mut falsified = 0;
    for (key, value) in squares.iter_mut() {
        for (method, square) in [("none", 0.0), ("surfel_trace", 100.0)] {
            if key.ends_with(&format!(" reflection.method={method} from sscr_hierarchical")) {
                *value = serde_json::json!([square, 0.0, square]);
                falsified += 1;
            }
        }
    }
    assert_eq!(falsified, 2);
    let mut wrong = CostModel::parse(&wrong.to_string()).unwrap();
    let (right, _) = chosen((&subject, &mut renderer), 80.0, &mut wrong, |_| 1.0);
    assert_eq!(&*right.set["reflection.method"], "surfel_trace", "{right:?}");
}

#[test]
fn large_still_pictures_share_their_lights_among_pixels_and_small_ones_do_not() {
    let Some((subject, mut renderer)) = scene() else { return };
    let mut settings = Settings::default();
    (settings.gi.bounces, settings.gi.vpls, settings.gi.sky_lights, settings.gi.shadow_points) = (1, 16, 16, 256);
    settings.view.resolution = 0.5;
    let fixed = ["splat.step", "splat.quality", "reflection.method", "reflection.bounces", "gi.bounces"];
    let mut drawn = Vec::new();
    let mut draw = |renderer: &mut Renderer, settings: &Settings, size| {
        drawn.push((settings.clone(), size));
        Ok(subject.render_next(renderer, settings, size)?)
    };
    let (mut model, view) = (CostModel::default(), (&subject.camera, [324, 244]));
    let mut hands = Hands { renderer: &mut renderer, draw: &mut draw, model: &mut model };
    let choice = choose(Target::DeltaE(90.0), &settings, &fixed.map(str::to_owned), view, &mut hands).unwrap();
    assert!(choice.errors.is_some(), "{choice:?}");
    // Only the still pictures have as many lights of the sky.
    let stills: Vec<_> = drawn.iter().filter(|(settings, _)| settings.gi.sky_lights > 16).collect();
    let [(small, small_size), (whole, whole_size)] = stills[..] else { panic!("{} still pictures", stills.len()) };
    assert_eq!((*small_size, *whole_size), ([319, 240], [324, 244]));
    let mut expected = study::still_settings(&settings);
    expected.mirror.surface = scene::MirrorSurface::Exact;
    assert!(expected == *small, "a small one has all lights on each pixel");
    let gi = &small.gi;
    assert_eq!((gi.vpls, gi.sky_lights, gi.interleave, small.view.resolution), (1024, 1024, 1, 1.0));
    assert_eq!((small.reflection.method, small.mirror.surface), (Method::SurfelTrace, scene::MirrorSurface::Exact));
    expected.gi.interleave = 3;
    assert!(expected == *whole, "a large one differs in that alone");
}

#[test]
fn frames_that_other_work_disturbed_decide_nothing() {
    let Some((subject, mut renderer)) = scene() else { return };
    let mut known = CostModel::default();
    let (calm, _) = chosen((&subject, &mut renderer), 150.0, &mut known, |_| 1.0);
    assert_eq!((&*calm.set["reflection.method"], calm.predicted_ms.round()), ("surfel_trace", 71.0), "{calm:?}");
    // Each case: the frames that take so many times longer, and whether times are known from a choice before.
    let every = |count: usize, at: usize| move |frame: usize| frame % count == at;
    type Case<'a> = (&'a dyn Fn(usize) -> bool, f64, bool);
    let cases: [Case<'_>; 5] = [
        (&every(3, 0), 6.0, true),
        (&every(3, 1), 6.0, false),
        (&every(2, 0), 6.0, false),
        (&every(2, 1), 6.0, true),
        (&|frame| (5..20).contains(&frame), 3.0, false),
    ];
    for (case, (is_disturbed, factor, is_known)) in cases.into_iter().enumerate() {
        let mut model = if is_known { known.clone() } else { CostModel::default() };
        let disturbed = |frame| if is_disturbed(frame) { factor } else { 1.0 };
        let (choice, _) = chosen((&subject, &mut renderer), 150.0, &mut model, disturbed);
        let [method, of_calm] = [&choice, &calm].map(|choice| &choice.set["reflection.method"]);
        assert_eq!((method, choice.predicted_ms.round()), (of_calm, 71.0), "case {case}: {choice:?}");
    }
}

/// With light by rays in the settings, which take three milliseconds each beside twenty of all else, and `fixed` besides
/// what is no light: what is chosen.
fn lit((subject, renderer): (&Subject, &mut Renderer), target: Target, fixed: &[&str]) -> Choice {
    let mut settings = Settings::default();
    for (key, value) in [
        ("gi.by", "rays"),
        ("gi.rays_per_pixel", "8"),
        ("gi.vpls", "16"),
        ("gi.shadows", "false"),
        ("reflection.method", "surfel_trace"),
    ] {
        settings.set_text(key, value).unwrap();
    }
    let others =
        ["view.resolution", "splat.step", "splat.quality", "mirror.surface", "reflection.method", "gi.bounces"];
    let fixed: Vec<String> = others.iter().chain(fixed).map(|key| (*key).to_owned()).collect();
    let mut draw = |renderer: &mut Renderer, settings: &Settings, size| {
        let stats = subject.render_next(renderer, settings, size)?;
        let rays = if settings.gi.by == IndirectBy::Rays { settings.gi.rays_per_pixel } else { 0 };
        assert_eq!(stats.light_rays, [rays; 2]);
        let passes =
            [("shade", 20.0), ("indirect", 0.2 * f64::from(settings.gi.vpls)), ("light_rays", 3.0 * f64::from(rays))];
        let pass = |(name, milliseconds)| PassTime { name, stage: PassStage::Light, milliseconds };
        let passes: Vec<PassTime> = passes.into_iter().map(pass).collect();
        Ok(FrameStats { frame_milliseconds: passes.iter().map(|pass| pass.milliseconds).sum(), passes, ..stats })
    };
    let mut hands = Hands { renderer, draw: &mut draw, model: &mut CostModel::default() };
    choose(target, &settings, &fixed, (&subject.camera, [24, 18]), &mut hands).unwrap()
}

#[test]
fn lights_take_the_place_of_rays_where_time_is_short() {
    let Some((subject, mut renderer)) = scene() else { return };
    let mut lit = |target, fixed: &[&str]| lit((&subject, &mut renderer), target, fixed);
    let fixed = ["gi.vpls", "gi.interleave"];
    let set = |choice: &Choice, key: &str| choice.set.get(key).cloned();
    let short = lit(Target::Milliseconds(24.0), &fixed);
    assert_eq!(
        (set(&short, "gi.by").as_deref(), set(&short, "gi.rays_per_pixel")),
        (Some("lights"), None),
        "{short:?}"
    );
    let some = lit(Target::Milliseconds(38.0), &fixed);
    assert_eq!((set(&some, "gi.by"), set(&some, "gi.rays_per_pixel").as_deref()), (None, Some("4")), "{some:?}");
    let all = lit(Target::Milliseconds(50.0), &fixed);
    assert_eq!((set(&all, "gi.by"), set(&all, "gi.rays_per_pixel"), all.predicted_error), (None, None, 0.0), "{all:?}");
    assert!(short.predicted_error > some.predicted_error && some.predicted_error > 0.0);
    let few = lit(Target::Milliseconds(28.0), &["gi.vpls", "gi.interleave", "gi.by"]);
    assert_eq!((set(&few, "gi.by"), set(&few, "gi.rays_per_pixel").as_deref()), (None, Some("1")), "{few:?}");
    // Light is no error of pixels.
    let pixels = lit(Target::Pixels(1.0), &fixed);
    assert!(pixels.set.keys().all(|key| !key.starts_with("gi.")), "{pixels:?}");
}
