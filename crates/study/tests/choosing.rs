//! What `auto` chooses where other work disturbs single frames. The times are made up, the pictures are drawn.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use render::{Error, FrameStats, Gpu, PassStage, PassTime, Renderer};
use scene::five_mirrors::{self, Variant};
use scene::{Method, Settings};
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
