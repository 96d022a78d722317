//! `--budget` and `--error` through the real program: what `auto` chooses keeps to the target, is written down and can
//! be set again. No test asserts a time.

use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use tests::{Folder, Outcome};

/// Longer than choosing takes on a busy machine, most of it for compiling the passes of all methods.
const PATIENCE: Duration = Duration::from_secs(600);

/// A small scene. Coarse shadows of a thousand lights take a third of the time of fine ones.
const SCENE: [&str; 9] = [
    "five-mirrors/sphere",
    "--size",
    "64x48",
    "--set",
    "scene.points=5000",
    "--set",
    "gi.shadow_points=256",
    "--set",
    "gi.shadow_size=16",
];

/// `glint render` of the small scene. None, with a note, where there is no adapter to draw with and none is required.
fn render(folder: &Folder, picture: &str, words: &[&str]) -> Option<Outcome> {
    let words = [&["render"], &SCENE[..], &["-o", picture], words].concat();
    let outcome = folder.glint_within(PATIENCE, words);
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        println!("skipped: no adapter: {}", outcome.messages.trim());
        return None;
    }
    Some(outcome)
}

/// The stats of a picture that must be drawn.
fn stats(folder: &Folder, picture: &str, words: &[&str]) -> Option<Value> {
    let outcome = render(folder, picture, &[&["--stats", "stats.json"], words].concat())?;
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let text = std::fs::read_to_string(folder.path("stats.json")).expect("stats");
    Some(serde_json::from_str(&text).expect("JSON"))
}

/// `--set` with what was chosen.
fn chosen(auto: &Value) -> Vec<String> {
    let set = auto["set"].as_object().expect("an object");
    let value = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    set.iter().flat_map(|(key, of)| ["--set".to_owned(), format!("{key}={}", value(of))]).collect()
}

fn pixels(folder: &Folder, picture: &str) -> image::RgbImage {
    let picture = image::open(folder.path(picture)).expect("a picture").to_rgb8();
    assert_eq!(picture.dimensions(), (64, 48), "whatever the resolution in which it is drawn");
    picture
}

/// The mean CIEDE2000 difference of two pictures.
fn difference(one: &image::RgbImage, other: &image::RgbImage) -> f64 {
    let linear = |value: u8| {
        let value = f32::from(value) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    let colors =
        |picture: &image::RgbImage| -> Vec<[f32; 3]> { picture.pixels().map(|pixel| pixel.0.map(linear)).collect() };
    let differences = study::delta_e(&colors(one), &colors(other));
    differences.iter().map(|value| f64::from(*value)).sum::<f64>() / differences.len() as f64
}

#[test]
fn an_error_of_colours_is_kept_to_and_what_was_chosen_can_be_set_again() {
    let folder = Folder::new();
    let Some(stats) = stats(&folder, "auto.png", &["--error", "2dE"]) else { return };
    let auto = &stats["auto"];
    assert_eq!((&auto["method"], &auto["error_unit"]), (&stats["method"], &"dE".into()), "{stats}");
    assert!(auto["predicted_ms"].as_f64().is_some_and(|time| time > 0.0), "{auto}");
    let predicted = auto["predicted_error"].as_f64().expect("a number");
    assert!((0.0..=2.0).contains(&predicted), "{auto}");
    assert!(auto["why"].as_str().is_some_and(|why| why.contains("2dE") && why.contains("settings")), "{auto}");
    // The error is that against the still picture, as the program's own commands draw it.
    let light = ["--set", "gi.vpls=1024", "--set", "gi.interleave=1"];
    let still = [&["--method", "surfel_trace", "--set", "mirror.surface=exact"][..], &light].concat();
    render(&folder, "still.png", &still);
    let [made, still] = ["auto.png", "still.png"].map(|name| pixels(&folder, name));
    let error = difference(&made, &still);
    let of = |pointer: &str| auto.pointer(pointer).and_then(Value::as_f64).expect("a number");
    let of_all = of("/errors/delta_e");
    assert!((error - of_all).abs() < 0.1, "{error} CIEDE2000, predicted {of_all}");
    // The worse of mirrors and of the rest counts, each with its 95th percentile beside it.
    let [mirrors, rest] = [of("/errors/mirrors/mean"), of("/errors/rest/mean")];
    assert_eq!(predicted, mirrors.max(rest), "{auto}");
    assert!(mirrors.min(rest) <= of_all && of_all <= predicted, "{auto}");
    assert!(of("/errors/mirrors/p95") >= 0.0 && of("/errors/rest/p95") >= 0.0, "{auto}");
    let set = chosen(auto);
    let set: Vec<&str> = set.iter().map(String::as_str).collect();
    let again = render(&folder, "again.png", &set).expect("an adapter");
    assert_eq!(again.status, Some(0), "{again}");
    assert!(pixels(&folder, "again.png") == made, "the same picture from {set:?}");
}

#[test]
fn errors_of_one_picture_are_kept_and_do_not_replace_those_of_the_next() {
    let folder = Folder::new();
    let words = ["--error", "3dE", "--method", "sscr_hierarchical"];
    let Some(first) = stats(&folder, "first.png", &words) else { return };
    let mut costs = std::fs::read_dir(folder.path(".config/glint/costs")).expect("the folder of costs");
    let costs = costs.next().expect("a file").expect("an entry").path();
    let text = std::fs::read_to_string(&costs).expect("the costs");
    assert!(text.contains("mirrors: view.resolution=0.5 from 1"), "{text}");
    let words = [&words[..], &["--set", "mirror.fresnel=0.2"]].concat();
    let next = stats(&folder, "next.png", &words).expect("an adapter");
    for stats in [first, next] {
        let error = stats["auto"]["predicted_error"].as_f64().expect("a number");
        assert!(error <= 3.0 && stats["auto"]["errors"].is_object(), "{stats}");
    }
}

#[test]
fn an_error_of_reflections_leaves_the_light_alone_and_named_parameters_stay() {
    let folder = Folder::new();
    let words = ["--error", "0.5px", "--method", "sscr_hierarchical", "--set", "splat.step=1"];
    let Some(stats) = stats(&folder, "auto.png", &words) else { return };
    let auto = &stats["auto"];
    assert_eq!((&auto["method"], &auto["error_unit"]), (&"sscr_hierarchical".into(), &"px".into()), "{auto}");
    assert!(auto["predicted_error"].as_f64().is_some_and(|error| error <= 0.5), "{auto}");
    let set = auto["set"].as_object().expect("an object");
    let is_other = |key: &&String| key.starts_with("gi.") || *key == "splat.step";
    assert_eq!(set.keys().find(is_other), None, "{auto}");
}

#[test]
fn a_method_that_is_named_stays_where_only_another_one_keeps_to_the_target() {
    let folder = Folder::new();
    let Some(stats) = stats(&folder, "a.png", &["--method", "environment_map", "--error", "0.05px"]) else { return };
    let set = &stats["auto"]["set"];
    assert_eq!(set["reflection.method"], "environment_map", "{set}");
}

#[test]
fn a_time_without_end_gives_the_still_picture_and_one_that_nothing_keeps_to_is_told() {
    let folder = Folder::new();
    let words = ["--method", "surfel_trace", "--set", "gi.vpls=16"];
    let Some(rich) = stats(&folder, "rich.png", &[&words[..], &["--budget", "1000s"]].concat()) else { return };
    assert_eq!(rich["auto"]["predicted_error"], 0.0, "{rich}");
    // The times were kept. A file that is damaged is reported, and does no harm.
    let costs: Vec<PathBuf> = std::fs::read_dir(folder.path(".config/glint/costs"))
        .expect("the folder of costs")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    assert_eq!(costs.len(), 1, "{costs:?}");
    std::fs::write(&costs[0], "{\"stages\": 1}").expect("a file");
    let poor = render(&folder, "poor.png", &[&words[..], &["--budget", "0.0001ms", "--stats", "stats.json"]].concat());
    let poor = poor.expect("an adapter");
    assert_eq!(poor.status, Some(0), "{poor}");
    assert!(poor.messages.contains("times are measured anew"), "{poor}");
    assert!(poor.text().contains("nothing keeps to 0.0001ms, this is about the fastest"), "{poor}");
    let text = std::fs::read_to_string(&costs[0]).expect("the costs");
    assert!(text.contains("surfel_trace"), "learned anew: {text}");
}

#[test]
fn without_a_target_the_choice_is_fixed() {
    let folder = Folder::new();
    let Some(stats) = stats(&folder, "auto.png", &[]) else { return };
    assert_eq!((stats.get("auto"), &stats["method"]), (None, &"auto".into()), "{stats}");
    render(&folder, "named.png", &["--method", "sscr_hierarchical"]);
    assert!(pixels(&folder, "auto.png") == pixels(&folder, "named.png"));
    assert!(!folder.path(".config/glint/costs").exists(), "nothing is measured");
}

#[test]
fn targets_that_make_no_sense_are_refused() {
    let folder = Folder::new();
    for (words, told) in [
        (&["--budget", "fast"][..], "50ms"),
        (&["--budget", "0ms"], "above 0"),
        (&["--budget", "2dE"], "50ms"),
        (&["--error", "50ms"], "1px or 2dE"),
        (&["--error=-1px"], "1px or 2dE"),
        (&["--error", "nanpx"], "1px or 2dE"),
        (&["--budget", "50ms", "--error", "1px"], "--error"),
        (&["--budget", "50ms", "--method", "ray_trace"], "ray_trace runs on the CPU"),
        (&["--set", "view.resolution=0.5", "--aov", "depth=a.exr"], "view.resolution is 0.5"),
    ] {
        let common = ["render", "five-mirrors/none", "-o", "a.png"];
        let outcome = folder.glint(common.iter().chain(words));
        assert_eq!(outcome.status, Some(2), "{outcome}");
        assert!(outcome.messages.contains(told) && outcome.messages.trim().lines().count() <= 2, "{outcome}");
        assert!(!folder.path("a.png").exists());
    }
}
