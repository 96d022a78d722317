//! `glint study` through the real program: what it writes, how it goes on, how shards become one.

use std::collections::BTreeSet;

use serde_json::Value;
use tests::{Folder, Outcome};

const PLAN: &str = r#"
title = "Tiny"
size = "64x48"
repeats = 3
truths = ["same_input", "exact"]
[set]
"gi.bounces" = 0
"scene.points" = 5000
[[group]]
name = "single"
scenes = ["five-mirrors/sphere"]
methods = ["none", "ray_trace"]
[[group]]
name = "swept"
pictures = true
scenes = ["five-mirrors/sphere"]
methods = ["sscr", "sscr_hierarchical"]
sweep = { "splat.size" = [1, 1.5] }
bound = { figure = "same_input_false_fill", at_most = 0.01 }
"#;

/// None, with a note, where there is no adapter to draw with and none is required.
fn study(folder: &Folder, words: &[&str]) -> Option<Outcome> {
    let outcome = folder.glint(["study"].iter().chain(words));
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        println!("skipped: no adapter: {}", outcome.messages.trim());
        return None;
    }
    Some(outcome)
}

fn with_plan(text: &str) -> Folder {
    let folder = Folder::new();
    std::fs::write(folder.path("plan.toml"), text).expect("the plan");
    folder
}

fn read(folder: &Folder, name: &str) -> String {
    std::fs::read_to_string(folder.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn rows(folder: &Folder, name: &str) -> Vec<Value> {
    serde_json::from_str(&read(folder, &format!("{name}/results.json"))).expect("a list of rows")
}

/// What a row is about, and what was found there; times differ from run to run.
fn found(row: &Value) -> String {
    let names = ["group", "scene", "method", "splat.size", "coverage", "same_input_pixel_error_p95", "exact_delta_e"];
    names.map(|name| row[name].to_string()).join(" ")
}

#[test]
fn a_study_writes_its_results_goes_on_where_it_was_cut_and_comes_in_shards() {
    let folder = with_plan(PLAN);
    let Some(outcome) = study(&folder, &["plan.toml", "-o", "whole"]) else { return };
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let whole = rows(&folder, "whole");
    assert_eq!(whole.len(), 2 + 4);
    for row in &whole {
        assert_eq!((&row["repeats"], &row["points"], &row["error"]), (&3.into(), &5000.into(), &Value::Null), "{row}");
        assert!(row["frame_ms"].as_f64().is_some_and(|time| time > 0.0), "{row}");
        assert!(row["adapter"].is_string() && row["commit"].is_string() && row["clock"].is_string(), "{row}");
        assert!(row["passes"]["splat_nearest"].is_number() || row["passes"]["splat_narrow"].is_number(), "{row}");
    }
    let of = |method: &str| whole.iter().find(|row| row["method"] == method).expect("a row of each method");
    let error = |method: &str| of(method)["same_input_delta_e"].as_f64().unwrap_or(f64::NAN);
    // Without light from surface to surface the ray tracer has no noise: it is the truth.
    assert_eq!((error("ray_trace"), &of("ray_trace")["coverage"]), (0.0, &1.into()));
    assert!(error("sscr_hierarchical") < 2.0 && error("sscr") > error("sscr_hierarchical"), "{whole:#?}");
    assert!(error("none") > 10.0 && of("none")["method_ms"] == 0, "{whole:#?}");
    assert_eq!(read(&folder, "whole/results.csv").lines().count(), 1 + whole.len());
    for chart in ["time-same-input-delta-e", "splat-size-same-input-false-fill"] {
        assert!(read(&folder, &format!("whole/{chart}.svg")).contains("<svg"));
        assert!(folder.path(&format!("whole/{chart}.png")).metadata().is_ok_and(|file| file.len() > 5000), "{chart}");
    }
    let page = read(&folder, "whole/index.html");
    assert!(
        page.contains("src=\"time-same-input-delta-e.svg\"")
            && page.contains("id=\"bounds\"")
            && page.contains("id=\"pictures\""),
        "{page}"
    );
    let pictures = std::fs::read_dir(folder.path("whole/pictures")).expect("pictures").count();
    assert_eq!(pictures, 2, "one a method");

    // Nothing is left to do.
    let journal = read(&folder, "whole/runs.jsonl");
    assert_eq!(journal.lines().count(), (1 + 3) * whole.len());
    let again = study(&folder, &["plan.toml", "-o", "whole"]).expect("an adapter");
    assert!(again.status == Some(0) && read(&folder, "whole/runs.jsonl") == journal, "{again}");
    // Cut in the middle of the fifth line: the rest is made again, and found again.
    let cut = journal.match_indices('\n').nth(4).expect("five lines").0 - 30;
    std::fs::write(folder.path("whole/runs.jsonl"), &journal[..cut]).expect("the journal");
    let resumed = study(&folder, &["plan.toml", "-o", "whole"]).expect("an adapter");
    assert_eq!(resumed.status, Some(0), "{resumed}");
    assert!(read(&folder, "whole/runs.jsonl").starts_with(&journal[..cut]));
    let all: BTreeSet<String> = whole.iter().map(found).collect();
    assert_eq!(rows(&folder, "whole").iter().map(found).collect::<BTreeSet<_>>(), all);
    // The plan that is kept makes the same study.
    let kept = folder.path("whole/plan.toml").display().to_string();
    let same = study(&folder, &[&kept, "-o", "whole"]).expect("an adapter");
    assert!(same.status == Some(0) && String::from_utf8_lossy(&same.output).contains("nothing was left"), "{same}");
    let other = study(&folder, &["plan.toml", "-o", "whole", "--repeats", "2"]).expect("an adapter");
    assert!(other.status == Some(2) && other.messages.contains("another plan"), "{other}");

    for number in ["1", "2"] {
        let shard = format!("{number}/2");
        let outcome = study(&folder, &["plan.toml", "-o", number, "--shard", &shard]).expect("an adapter");
        assert_eq!((outcome.status, rows(&folder, number).len()), (Some(0), 3), "{outcome}");
    }
    let part = study(&folder, &["merge", "1", "-o", "half"]).expect("no adapter is needed");
    assert!(part.status == Some(0) && part.messages.contains("3 of 6 settings are missing"), "{part}");
    let merged = study(&folder, &["merge", "1", "2", "-o", "merged"]).expect("no adapter is needed");
    assert!(merged.status == Some(0) && merged.messages.is_empty(), "{merged}");
    assert_eq!(
        rows(&folder, "merged").iter().map(found).collect::<Vec<_>>(),
        whole.iter().map(found).collect::<Vec<_>>()
    );
}

#[test]
fn more_rays_bring_indirect_light_nearer_to_the_paths_of_the_truth() {
    let folder = with_plan(
        r#"
title = "Light"
size = "64x48"
repeats = 1
truths = ["exact"]
truth_samples = 256
light = true
errors = []
figures = ["exact_light_error", "exact_light_mean"]
[set]
"gi.by" = "rays"
"scene.points" = 20000
[[group]]
name = "rays"
scenes = ["five-mirrors/none"]
methods = ["none"]
sweep = { "gi.rays_per_pixel" = [1, 16] }
"#,
    );
    let Some(outcome) = study(&folder, &["plan.toml", "-o", "out"]) else { return };
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let figure = |name: &str| -> Vec<f64> {
        rows(&folder, "out").iter().map(|row| row[name].as_f64().expect("a measured figure")).collect()
    };
    let (errors, means) = (figure("exact_light_error"), figure("exact_light_mean"));
    assert!(errors[0] > 1.5 * errors[1] && errors[1] < 0.2, "{errors:?}");
    assert!(means.iter().all(|mean| (mean - 1.0).abs() < 0.1), "{means:?}");
}

#[test]
fn plans_that_are_wrong_are_refused_before_anything_is_written() {
    let broken = PLAN.replace("[1, 1.5]", "[1, 99]");
    for (text, mentioned) in [
        (broken.as_str(), "plan.toml:18: splat.size: 99 is out of range"),
        ("title = \"a\"\n[[group]]\nscenes = [\"five-mirrors/sphre\"]", "did you mean `five-mirrors/sphere`?"),
        ("title = \"a\"", "missing field `group`"),
    ] {
        let folder = with_plan(text);
        let outcome = folder.glint(["study", "plan.toml", "-o", "out"]);
        assert!(outcome.status == Some(2) && outcome.messages.contains(mentioned), "{outcome}");
        assert!(outcome.messages.lines().count() <= 2 && !folder.path("out").exists(), "{outcome}");
    }
    let folder = Folder::new();
    let unknown = folder.glint(["study", "method", "-o", "out"]);
    assert!(unknown.status == Some(2) && unknown.messages.contains("did you mean `methods`?"), "{unknown}");
    let list = folder.glint(["study", "--list"]);
    let names = String::from_utf8_lossy(&list.output).into_owned();
    for name in
        ["methods", "seed-attempts", "step-attempts", "initial-step", "pull-levels", "viewport", "mirrors", "points"]
    {
        assert!(names.lines().any(|line| line.starts_with(name)), "{name}: {list}");
    }
}

#[test]
fn a_scene_that_cannot_be_read_is_a_row_and_the_others_go_on() {
    let plan = "title = \"a\"\nsize = \"64x48\"\nrepeats = 1\nflicker = true\n[set]\n\"gi.bounces\" = 0\n\"scene.points\" = 5000\n\
                [[group]]\nscenes = [\"broken.laz\", \"cut.ply\", \"tiles\", \"five-mirrors/sphere\"]\n\
                methods = [\"surfel_trace\"]\n[[group]]\nscenes = [\"cut.ply\", \"damaged.laz\"]\n\
                methods = [\"surfel_trace\"]\nset = { \"stream.pages\" = \"always\" }";
    let folder = with_plan(plan);
    std::fs::write(folder.path("broken.laz"), "no points").expect("a broken file");
    let ply = |announced: u32, points: u32| {
        let points: String = (0..points).map(|at| format!("{} {} 0\n", at % 20, at / 20)).collect();
        let axes = "property float x\nproperty float y\nproperty float z\n";
        format!("ply\nformat ascii 1.0\nelement vertex {announced}\n{axes}end_header\n{points}")
    };
    folder.write("cut.ply", ply(229, 200));
    folder.write("whole.ply", ply(60_000, 60_000));
    std::fs::create_dir(folder.path("tiles")).expect("a folder");
    for name in ["tiles/a.las", "damaged.laz"] {
        let outcome = folder.glint(["export", "whole.ply", "-o", name]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
    }
    let whole = std::fs::read(folder.path("tiles/a.las")).expect("a tile");
    folder.write("tiles/b.las", &whole[..whole.len() - 1]);
    // The end of the compressed points, which their table follows.
    let mut damaged = std::fs::read(folder.path("damaged.laz")).expect("a file");
    let points = u32::from_le_bytes(damaged[96..100].try_into().expect("four bytes")) as usize;
    let table = u64::from_le_bytes(damaged[points..points + 8].try_into().expect("eight bytes")) as usize;
    damaged[table * 4 / 5..table].fill(0xff);
    folder.write("damaged.laz", damaged);
    let Some(outcome) = study(&folder, &["plan.toml", "-o", "out"]) else { return };
    assert!(outcome.status == Some(1) && outcome.messages.contains("settings that failed: 5"), "{outcome}");
    let rows = rows(&folder, "out");
    assert!(rows[0]["error"].as_str().is_some_and(|error| error.contains("broken.laz")), "{rows:#?}");
    // Nor is one measured of which only a part can be read, in memory or streamed.
    let parts = [(1, "cut.ply: 29 points "), (2, "tiles: 1 points "), (4, "cut.ply: 29 points "), (5, "damaged.laz: ")];
    for (row, told) in parts {
        let error = rows[row]["error"].as_str().unwrap_or_default();
        assert!(error.contains(told) && error.contains("points cannot be read"), "{told}: {rows:#?}");
    }
    let whole = &rows[3];
    assert_eq!((&whole["error"], &whole["repeats"]), (&Value::Null, &1.into()));
    // Nothing random is in this method, and a reflection moves with the camera.
    let flicker = ["flicker_still", "flicker_moving"].map(|name| whole[name].as_f64().unwrap_or(f64::NAN));
    assert!(flicker[0] < 1e-9 && (0.01..100.0).contains(&flicker[1]), "{flicker:?}");
}

/// What the thesis's experiments need of a plan.
const PARTS: &str = r#"
title = "Parts"
size = "64x48"
repeats = 3
truths = []
errors = []
figures = ["search_ms"]
still = true
still_set = { "scene.points" = 20000 }
[set]
"gi.bounces" = 0
[[part]]
name = "search_ms"
label = "searches"
passes = ["sscr_solve", "sscr_solve_again"]
[[group]]
name = "distances"
scenes = ["five-mirrors/sphere"]
methods = ["sscr"]
sweep = { distance = [1, 0.6], "scene.points" = [2000, 20000] }
pictures = "each"
stacked = [["search_ms", "method_ms"]]
[[group]]
name = "learned"
scenes = ["five-mirrors/sphere"]
methods = ["sscr"]
set = { "sscr.seeds" = "last-frame", "scene.points" = 2000 }
frames_before = 4
[[group]]
name = "first"
scenes = ["five-mirrors/sphere"]
methods = ["sscr"]
set = { "sscr.seeds" = "last-frame", "scene.points" = 2000 }
"#;

#[test]
fn a_plan_moves_the_camera_sums_passes_shows_each_picture_and_judges_by_all_points() {
    let folder = with_plan(PARTS);
    let Some(outcome) = study(&folder, &["plan.toml", "-o", "parts"]) else { return };
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let rows = rows(&folder, "parts");
    let of = |group: &str| rows.iter().filter(|row| row["group"] == group).collect::<Vec<_>>();
    let number = |row: &Value, name: &str| row[name].as_f64().unwrap_or_else(|| panic!("{name} of {row}"));
    // Distances of 1 and 0.6, each with few points and many.
    let distances = of("distances");
    let pixels: Vec<f64> = distances.iter().map(|row| number(row, "mirror_pixels")).collect();
    assert!(pixels[2] > 2.0 * pixels[0] && pixels[3] > 2.0 * pixels[1], "{pixels:?}");
    for pair in distances.chunks(2) {
        // Against the picture of many points, few are farther off.
        assert!(number(pair[0], "still_delta_e") > number(pair[1], "still_delta_e"), "{pair:#?}");
    }
    for row in &distances {
        let passes = &row["passes"];
        let sum = number(passes, "sscr_solve") + number(passes, "sscr_solve_again");
        // In at least one of three rounds neither pass is below its median, and in one neither is above.
        let ends = [number(row, "search_ms_low"), number(row, "search_ms_high")];
        assert!(sum > ends[0] * (1.0 - 1e-9) && sum < ends[1] * (1.0 + 1e-9), "{row}");
        assert!(number(row, "search_ms") < number(row, "method_ms"), "{row}");
    }
    // From frame to frame, more points are found.
    let hits = ["first", "learned"].map(|group| number(of(group)[0], "hit_rate"));
    assert!(hits[1] > 1.1 * hits[0], "{hits:?}");
    let pictures = std::fs::read_dir(folder.path("parts/pictures")).expect("pictures").count();
    assert_eq!(pictures, 4, "one a setting");
    assert!(read(&folder, "parts/stacked-distances.svg").contains("<svg"));
}

#[test]
fn each_setting_is_judged_by_what_it_shows_in_the_size_in_which_it_is_drawn() {
    let folder = with_plan(
        "title = \"a\"\nsize = \"64x48\"\nrepeats = 1\nstill = true\nflicker = true\n[set]\n\"gi.bounces\" = 0\n\
         \"scene.points\" = 5000\n[[group]]\nname = \"all\"\nscenes = [\"five-mirrors/sphere\"]\n\
         methods = [\"none\", \"ray_trace\", \"surfel_trace\"]\npictures = \"each\"\n\
         [[group]]\nname = \"half\"\nscenes = [\"five-mirrors/sphere\"]\nmethods = [\"surfel_trace\"]\n\
         set = { \"view.resolution\" = 0.5 }\n\
         [[group]]\nname = \"small\"\nscenes = [\"five-mirrors/sphere\"]\nmethods = [\"surfel_trace\"]\n\
         sweep = { size = [\"32x24\"] }",
    );
    let Some(outcome) = study(&folder, &["plan.toml", "-o", "out"]) else { return };
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let rows = rows(&folder, "out");
    let number = |row: usize, name: &str| rows[row][name].as_f64().unwrap_or_else(|| panic!("{name} of {}", rows[row]));
    // What the ray tracer sees in the mirror counts, and not what the frame without reflections shows.
    let errors = [0, 1, 2].map(|row| number(row, "still_mirrors_delta_e"));
    assert!(errors[0] > 10.0 && errors[1] < 3.0 && errors[2] < 3.0, "{errors:?}");
    assert!(number(0, "still_pixel_error_p95") > 1e3 && number(1, "still_pixel_error_p95") < 2.0, "{rows:#?}");
    assert!(number(0, "mirror_pixels") > 100.0 && number(0, "mirror_pixels") == number(2, "mirror_pixels"));
    let [grey, traced] = [0, 1].map(|at| std::fs::read(folder.path(&format!("out/pictures/all-{at}.png"))));
    assert!(grey.expect("a picture") != traced.expect("a picture"), "the traced picture shows no reflections");
    // Half of the resolution is the picture of half the size.
    assert_eq!(number(3, "flicker_moving"), number(4, "flicker_moving"), "{rows:#?}");
}

#[test]
fn a_still_picture_with_parameters_of_its_own_is_of_the_size_of_each_setting() {
    let plan = |own: &str| {
        format!(
            "title = \"a\"\nsize = \"64x48\"\nrepeats = 1\ntruths = []\nerrors = []\nfigures = []\nstill = true\n{own}\n\
             [set]\n\"gi.bounces\" = 0\n\"scene.points\" = 5000\n[[group]]\nscenes = [\"five-mirrors/sphere\"]\n\
             methods = [\"surfel_trace\"]\nsweep = {{ size = [\"64x48\", \"32x24\"] }}"
        )
    };
    let folder = with_plan(&plan(""));
    folder.write("own.toml", plan("still_set = { \"scene.points\" = 5000 }"));
    let errors = |name: &str| {
        let outcome = study(&folder, &[&format!("{name}.toml"), "-o", name])?;
        assert_eq!(outcome.status, Some(0), "{outcome}");
        Some(rows(&folder, name).iter().map(|row| row["still_delta_e"].to_string()).collect::<Vec<_>>())
    };
    let (Some(plain), Some(own)) = (errors("plan"), errors("own")) else { return };
    assert_eq!(own, plain, "the same points");
}

#[test]
fn a_study_does_not_go_on_with_a_scene_that_has_changed() {
    let plan = "title = \"a\"\nsize = \"64x48\"\nrepeats = 1\n[set]\n\"gi.bounces\" = 0\n\"scene.points\" = 5000\n\
                [[group]]\nscenes = [\"ball.toml\"]\nmethods = [\"none\"]";
    let folder = with_plan(plan);
    let ball = |size: &str| {
        let text = format!(
            "clouds = [\"five-mirrors/none\"]\n[[mirrors]]\nname = \"ball\"\nshape = \"sphere\"\n\
             position = [0.0, 0.0, 0.0]\nsize = {size}\n"
        );
        folder.write("ball.toml", text)
    };
    ball("0.4");
    let Some(outcome) = study(&folder, &["plan.toml", "-o", "out"]) else { return };
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let table = read(&folder, "out/results.csv");
    assert!(!table.contains(",-0,"), "{table}");
    ball("0.2");
    let changed = study(&folder, &["plan.toml", "-o", "out"]).expect("an adapter");
    assert!(changed.status == Some(2), "{changed}");
    assert!(changed.messages.contains("ball.toml has changed since the scene was measured"), "{changed}");
    assert_eq!(read(&folder, "out/results.csv"), table);
    let other = study(&folder, &["plan.toml", "-o", "other"]).expect("an adapter");
    assert_eq!(other.status, Some(0), "{other}");
    let joined = study(&folder, &["merge", "out", "other", "-o", "joined"]).expect("no adapter is needed");
    assert!(joined.status == Some(2) && joined.messages.contains("ball.toml was another one in"), "{joined}");
    ball("0.4");
    let again = study(&folder, &["plan.toml", "-o", "out"]).expect("an adapter");
    assert!(again.status == Some(0) && again.text().contains("nothing was left"), "{again}");
}
