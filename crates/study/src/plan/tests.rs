//! What plans mean, and every way in which one can be wrong.

use super::*;

fn parse(text: &str) -> Result<Plan, PlanError> {
    Plan::parse("plan.toml", text)
}

fn with_group(group: &str) -> Result<Plan, PlanError> {
    parse(&format!("title = \"Test\"\n\n[[group]]\nscenes = [\"five-mirrors/sphere\"]\n{group}"))
}

#[test]
fn a_plan_says_little_and_the_rest_is_the_default() {
    let plan = with_group("").unwrap();
    assert_eq!((plan.size, plan.repeats, plan.truth_samples, plan.flicker), (Size([800, 600]), 3, 64, false));
    assert_eq!(plan.truths, [Truth::SameInput]);
    assert_eq!((plan.groups[0].name.as_str(), &plan.groups[0].methods[..]), ("group-1", &["auto".to_owned()][..]));
    assert_eq!(plan.cases().len(), 1);
}

#[test]
fn charted_errors_are_those_of_the_truths_unless_the_plan_says_which() {
    let errors = |head: &str| parse(&format!("title = \"a\"\n{head}\n[[group]]\nscenes = [\"b\"]")).unwrap().errors;
    assert_eq!(errors(""), ["same_input_pixel_error_p95", "same_input_delta_e"]);
    assert_eq!(errors("truths = [\"exact\"]"), ["exact_pixel_error_p95", "exact_delta_e"]);
    assert_eq!(errors("truths = []"), [""; 0]);
    assert_eq!(errors("errors = []"), [""; 0]);
    assert_eq!(errors("errors = [\"coverage\"]"), ["coverage"]);
}

#[test]
fn settings_are_all_combinations_in_a_fixed_order() {
    let plan = parse(
        "title = \"Test\"\nsize = \"64x48\"\n[set]\n\"gi.bounces\" = 0\n\"splat.size\" = 2\n\
         [[group]]\nscenes = [\"a/{shape}\", \"b\"]\nmethods = [\"sscr\", \"ray_trace\"]\n\
         set = { \"splat.size\" = 3.5, \"sscr.solver\" = \"newton\" }\n\
         sweep = { \"sscr.pull_levels\" = [0, 4], shape = [\"x\", \"y\"], size = [\"32x24\", \"16x12\"] }\n\
         [[group]]\nscenes = [\"b\"]\n",
    )
    .unwrap();
    let cases = plan.cases();
    assert_eq!(cases.len(), 2 * 2 * 2 * 2 * 2 + 1);
    assert!(cases.iter().enumerate().all(|(index, case)| case.index == index));
    let first = &cases[0];
    assert_eq!((first.scene.as_str(), first.scene_pattern.as_str(), first.size), ("a/x", "a/{shape}", [32, 24]));
    let swept: Vec<&str> = first.swept.iter().map(|(key, _)| key.as_str()).collect();
    assert_eq!(swept, ["shape", "size", "sscr.pull_levels"]);
    assert_eq!([1, 2, 4].map(|index| cases[index].swept_value("sscr.pull_levels").unwrap()), ["4", "0", "0"]);
    assert_eq!((cases[2].size, cases[4].scene.as_str(), cases[8].method.as_str()), ([16, 12], "a/y", "ray_trace"));
    assert_eq!((cases[16].scene.as_str(), cases[32].group, cases[32].size), ("b", 1, [64, 48]));
    let settings = cases[1].settings(&Settings::default()).unwrap();
    assert_eq!((settings.splat.size, settings.gi.bounces, settings.sscr.pull_levels), (3.5, 0, 4));
    assert_eq!(settings.reflection.method, Method::Sscr);
    assert_eq!(cases[8].settings(&Settings::default()).unwrap().reflection.method, Method::None);
    assert_eq!(cases[32].settings(&Settings::default()).unwrap().splat.size, 2.0);
    // What a scene brings stays where the plan says nothing.
    let base = Settings { edl: scene::Edl { strength: 0.0, ..scene::Edl::default() }, ..Settings::default() };
    assert_eq!(cases[0].settings(&base).unwrap().edl.strength, 0.0);
}

#[test]
fn a_group_starts_from_its_own_preset_else_from_the_plans() {
    let text = "title = \"a\"\npreset = \"published\"\n[[group]]\nscenes = [\"b\"]\nset = { \"sscr.threshold\" = 5 }\n\
                [[group]]\nscenes = [\"b\"]\npreset = \"fast\"\n";
    let mut plan = parse(text).unwrap();
    let names = |plan: &Plan| plan.cases().iter().map(|case| case.preset.map(|preset| preset.name)).collect::<Vec<_>>();
    assert_eq!(names(&plan), [Some("Published"), Some("Fast")]);
    assert_eq!(parse(&plan.to_text()).unwrap(), plan);
    // What the plan sets comes after the preset, which the scene brings.
    let case = &plan.cases()[0];
    let base = case.preset.unwrap().applied(&Settings::default(), std::iter::empty());
    let settings = case.settings(&base).unwrap();
    assert_eq!((settings.sscr.threshold, settings.sscr.max_splat_size), (5.0, 2.0));
    plan.replace_preset(Preset::named("accurate").unwrap());
    assert_eq!(names(&plan), [Some("Accurate"); 2]);
    let problem = with_group("preset = \"best\"").unwrap_err();
    assert_eq!(problem.to_string(), "plan.toml:5: preset `best` is unknown; available: published, fast, accurate");
}

#[test]
fn ranges_are_even_or_of_even_ratios_and_whole_where_the_parameter_is() {
    let values = |sweep: &str| -> Vec<String> {
        let plan = with_group(&format!("methods = [\"sscr\"]\nsweep = {{ {sweep} }}")).unwrap();
        plan.cases().iter().map(|case| case.swept[0].1.clone()).collect()
    };
    assert_eq!(values("\"splat.size\" = { from = 1, to = 2, count = 5 }"), ["1", "1.25", "1.5", "1.75", "2"]);
    let log = "\"sscr.initial_step\" = { from = 0.02, to = 0.5, count = 3, scale = \"log\" }";
    assert_eq!(values(log), ["0.02", "0.1", "0.5"]);
    let whole = "\"sscr.max_steps\" = { from = 1, to = 4, count = 7 }";
    assert_eq!(values(whole), ["1", "2", "3", "4"], "halves are rounded up, none occurs twice");
}

#[test]
fn what_is_wrong_is_told_with_its_line() {
    let refused = |group: &str, expected: &str| {
        let error = with_group(group).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{group}: {error}\nexpected {expected}");
        assert_eq!(error.lines().count(), 1, "{error}");
    };
    refused("sweep = { \"sscr.sead\" = [1] }", "plan.toml:5: sscr.sead: no such parameter");
    refused(
        "sweep = { \"sscr.pull_levels\" = [1, 9] }",
        "plan.toml:5: sscr.pull_levels: 9 is out of range, expected 0 to 4",
    );
    refused(
        "[group.sweep]\n\"splat.size\" = [1]\n\"sscr.solver\" = [\"newtn\"]",
        "plan.toml:7: sscr.solver: `newtn` is none of",
    );
    refused(
        "set = { \"splat.size\" = 1.0 }\nsweep = { \"splat.size\" = [1, 2] }",
        "plan.toml:5: splat.size: the group sweeps it, expected one value or a sweep",
    );
    refused("sweep = { \"splat.size\" = [] }", "plan.toml:5: splat.size: the list is empty");
    refused("sweep = { \"splat.size\" = [1, 1] }", "plan.toml:5: splat.size: the value 1 occurs twice");
    refused("sweep = { \"splat.size\" = 1 }", "plan.toml:5: splat.size: expected a list, or a range");
    refused("sweep = { \"splat.size\" = [[1]] }", "plan.toml:5: splat.size: expected numbers");
    refused("sweep = { \"splat.size\" = { from = 1, to = 2 } }", "plan.toml:5: splat.size: missing field `count`");
    refused(
        "sweep = { \"splat.size\" = { from = 1, to = 2, count = 1 } }",
        "plan.toml:5: splat.size: `count` must be 2",
    );
    let log = "sweep = { \"splat.size\" = { from = 0, to = 2, count = 3, scale = \"log\" } }";
    refused(log, "plan.toml:5: splat.size: a log scale needs");
    refused("sweep = { size = [\"64\"] }", "plan.toml:5: `64` is no size, expected WIDTHxHEIGHT");
    refused("sweep = { width = [1] }", "plan.toml:5: the variable `width` is in no scene");
    refused("methods = []", "plan.toml:5: methods is empty");
    refused("methods = [\"sscr\",\n\"ssrc\"]", "plan.toml:6: method `ssrc` is unknown; available: auto, none");
    refused("methods = [\"sscr\", \"sscr\"]", "plan.toml:5: `sscr` is named twice");
    refused("set = { \"reflection.method\" = \"sscr\" }", "plan.toml:5: reflection.method: name methods");
    refused("set = { \"splat.size\" = [1] }", "plan.toml:5: splat.size: expected a number");
    refused("nonsense = 1", "plan.toml:5: unknown field `nonsense`");
    refused(
        "bound = { figure = \"coverag\", at_least = 1 }",
        "plan.toml:5: figure `coverag` is unknown; did you mean `coverage`?",
    );
    refused("bound = { figure = \"coverage\" }", "plan.toml:5: expected either at_least or at_most");
    refused(
        "bound = { figure = \"coverage\", at_least = 1, up_to = 2 }",
        "plan.toml:5: `from` and `up_to` of a bound need",
    );
    let other = "bound = { figure = \"coverage\", at_least = 1, methods = [\"sscr\"] }";
    refused(other, "plan.toml:5: the bound is of `sscr`, which is none");
    refused("name = \"a\"\n[[group]]\nname = \"a\"\nscenes = [\"b\"]", "plan.toml:7: a second group is called `a`");
    let alike = "name = \"a b\"\n[[group]]\nname = \"A, b\"\nscenes = [\"b\"]";
    refused(alike, "plan.toml:7: `A, b` and `a b` give files the same name `a-b`");
    refused("name = \"--\"", "plan.toml:5: `--` names no file, expected a letter from a to z or a digit");
    refused("figures = [\"exact_flip\"]", "plan.toml:5: figure `exact_flip` is never measured");
    refused(
        "bound = { figure = \"flicker_moving\", at_most = 1 }\n[[group]]\nscenes = [\"b\"]\nflicker = true",
        "plan.toml:5: figure `flicker_moving` is never measured",
    );
    let whole = |text: &str, expected: &str| {
        let error = parse(text).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{text}: {error}");
    };
    whole("title = \"a\"", "plan.toml:1: missing field `group`");
    whole("title = \"a\"\ngroup = []", "plan.toml:2: no [[group]]");
    whole("title = \"a\"\nsize = \"big\"\n[[group]]\nscenes = [\"b\"]", "plan.toml:2: `big` is no size");
    whole("title = \"a\"\nrepeats = 0\n[[group]]\nscenes = [\"b\"]", "plan.toml:2: repeats is 0");
    whole("title = \"a\"\nerrors = [\"x\"]\n[[group]]\nscenes = [\"b\"]", "plan.toml:2: figure `x` is unknown");
    whole(
        "title = \"a\"\nerrors = [\"exact_flip\"]\n[[group]]\nscenes = [\"b\"]",
        "plan.toml:2: figure `exact_flip` is never measured, expected \"exact\" among the `truths`",
    );
    whole(
        "title = \"a\"\nfigures = [\"flicker_still\"]\n[[group]]\nscenes = [\"b\"]",
        "plan.toml:2: figure `flicker_still` is never measured, expected `flicker = true`",
    );
    whole(
        "title = \"a\"\n[[group]]\nscenes = [\"b/{size_of}\"]",
        "plan.toml:3: `b/{size_of}`: the variable `size_of` is not swept",
    );
    whole("title = \"a\"\n[[group]]\nscenes = []", "plan.toml:3: scenes is empty");
    whole("title =", "plan.toml:1: ");
}

#[test]
fn a_plan_of_too_many_settings_is_refused_without_making_them() {
    let range = |key: &str| format!("\"{key}\" = {{ from = 0.1, to = 9, count = 4000000000 }}");
    let error = with_group(&format!("sweep = {{ {}, {} }}", range("splat.size"), range("edl.radius"))).unwrap_err();
    assert!(error.problem.contains("expected at most 100000"), "{error}");
    let thousand = "{ from = 0.5, to = 9, count = 1000 }";
    let group = |name: &str| {
        let sweep = format!("{{ \"splat.size\" = {thousand}, \"edl.radius\" = {{ from = 0.5, to = 9, count = 60 }} }}");
        format!("[[group]]\nname = \"{name}\"\nscenes = [\"a\"]\nsweep = {sweep}\n")
    };
    let error = parse(&format!("title = \"a\"\n{}{}", group("one"), group("two"))).unwrap_err();
    assert!(error.problem.contains("120000 settings"), "{error}");
}

#[test]
fn a_plan_written_and_read_again_is_the_same() {
    let plan = with_group(
        "methods = [\"sscr\"]\npictures = true\nmends = \"x\"\nset = { \"color.attribute\" = \"a b\", \"gi.shadows\" = false }\n\
         sweep = { \"splat.size\" = { from = 1, to = 2, count = 5 } }\nbound = { figure = \"coverage\", at_least = 0.5, up_to = 1.5 }",
    )
    .unwrap();
    assert_eq!(parse(&plan.to_text()), Ok(plan));
}

const PARTS: &str = "title = \"a\"\nfigures = [\"search_ms\"]\n[[part]]\nname = \"search_ms\"\nlabel = \"search\"\n\
                     passes = [\"sscr_solve\"]\n";

#[test]
fn parts_pictures_and_distances_survive_being_written() {
    let group = "[[group]]\nscenes = [\"b\"]\npictures = \"each\"\nframes_before = 3\nlags = true\nstacked = [[\"search_ms\", \"frame_ms\"]]\n\
                 sweep = { distance = [0.5, 1] }\n";
    let plan = parse(&format!("{PARTS}{group}")).unwrap();
    assert_eq!(parse(&plan.to_text()), Ok(plan.clone()));
    assert_eq!(plan.cases().iter().map(|case| case.distance).collect::<Vec<_>>(), [0.5, 1.0]);
    let turning = parse(&format!("{PARTS}{}", group.replace("distance = [0.5, 1]", "orbit = [0, -2.5]"))).unwrap();
    assert_eq!(parse(&turning.to_text()), Ok(turning.clone()));
    assert_eq!(turning.cases().iter().map(|case| case.orbit).collect::<Vec<_>>(), [0.0, -2.5]);
    let figure = plan.figure("search_ms").unwrap();
    assert_eq!((figure.title().as_str(), figure.more_is_better()), ("time of search [ms]", false));
    assert!(plan.figure("search").is_none() && plan.figure("coverage").is_some());
}

#[test]
fn wrong_parts_and_stacks_are_refused() {
    let refused = |text: &str, expected: &str| {
        let error = parse(text).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    };
    let group = "[[group]]\nscenes = [\"b\"]\n";
    let with = |group_line: &str| format!("{PARTS}{group}{group_line}\n");
    refused(
        &format!("{}{group}", PARTS.replace("search_ms\"\nlabel", "search\"\nlabel")),
        "`search` is no name of a time",
    );
    refused(&format!("{}{group}", PARTS.replace("search_ms", "frame_ms")), "`frame_ms` is the name of another figure");
    refused(&format!("{}{group}", PARTS.replace("[\"sscr_solve\"]", "[]")), "passes is empty");
    refused(&with("stacked = [[\"serch_ms\"]]"), "did you mean `search_ms`?");
    refused(&with("stacked = [[\"coverage\"]]"), "`coverage` is no time");
    refused(&with("pictures = \"all\""), "expected true, false or \"each\"");
    refused(&with("frames_before = 1001"), "frames_before is 1001, expected at most 1000");
    refused(&with("sweep = { distance = [0] }"), "distance `0`: expected a share");
    refused(&with("frames_before = 2\nsweep = { orbit = [200] }"), "orbit `200`: expected the degrees");
    refused(&with("sweep = { orbit = [2] }"), "nothing to turn through");
    refused(&with("lags = true"), "no frame to lag behind");
    refused(&format!("still_set = {{ \"view.point_budget\" = 1000000 }}\n{PARTS}{group}"), "still_set has no effect");
}

#[test]
fn a_still_picture_is_drawn_with_its_own_parameters() {
    let text = "title = \"a\"\nstill = true\nstill_set = { \"view.point_budget\" = 9000000 }\n[[group]]\nscenes = [\"b\"]\n\
                methods = [\"sscr\"]\nset = { \"splat.size\" = 2 }\nsweep = { \"view.point_budget\" = [200000, 400000] }";
    let plan = parse(text).unwrap();
    for case in plan.cases() {
        let own = case.settings(&Settings::default()).unwrap();
        let still = plan.of_still(&case).settings(&Settings::default()).unwrap();
        assert_eq!((still.view.point_budget, still.splat.size), (9_000_000, 2.0));
        assert!(own.view.point_budget < 9_000_000);
    }
}

#[test]
fn a_replaced_parameter_counts_everywhere_but_where_it_is_swept() {
    let mut plan = parse(
        "title = \"a\"\n[[group]]\nscenes = [\"a\"]\nset = { \"splat.size\" = 2 }\n\
         [[group]]\nname = \"swept\"\nscenes = [\"a\"]\nsweep = { \"splat.size\" = [1, 2] }",
    )
    .unwrap();
    assert_eq!(plan.replace("splat.size", "3"), Ok(vec!["swept"]));
    let sizes: Vec<f32> =
        plan.cases().iter().map(|case| case.settings(&Settings::default()).unwrap().splat.size).collect();
    assert_eq!(sizes, [3.0, 1.0, 2.0]);
    assert!(plan.replace("splat.size", "99").is_err() && plan.replace("splat.sise", "1").is_err());
}

#[test]
fn bounds_hold_for_their_methods_within_their_range() {
    let plan = with_group(
        "methods = [\"sscr\", \"none\"]\nsweep = { \"splat.size\" = [1, 2, 3] }\n\
         bound = { figure = \"coverage\", methods = [\"sscr\"], at_most = 0.5, from = 1.5 }",
    )
    .unwrap();
    let bound = plan.groups[0].bound.clone().unwrap();
    let about: Vec<bool> = plan.cases().iter().map(|case| bound.is_about(case)).collect();
    assert_eq!(about, [false, true, true, false, false, false]);
    assert!(bound.holds(0.5) && !bound.holds(0.51) && !bound.holds(f64::NAN));
}

#[test]
fn scenes_in_files_are_beside_the_plan_and_addresses_stay() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("plans")).unwrap();
    std::fs::write(folder.path().join("office.toml"), "").unwrap();
    let path = folder.path().join("plans/plan.toml");
    let address = "https://scans.example/a//b.copc.laz";
    let scenes = format!("[\"../office.toml\", \"five-mirrors/sphere\", \"{address}\"]");
    std::fs::write(&path, format!("title = \"a\"\n[[group]]\nscenes = {scenes}")).unwrap();
    let scenes = Plan::read(&path).unwrap().groups[0].scenes.clone();
    let office = folder.path().canonicalize().unwrap().join("office.toml");
    assert_eq!(scenes, [office.to_string_lossy().into_owned(), "five-mirrors/sphere".into(), address.into()]);
    let missing = Plan::read(&folder.path().join("none.toml")).unwrap_err().to_string();
    assert!(missing.contains("none.toml: "), "{missing}");
}

#[test]
fn what_a_value_holds_is_not_replaced_again() {
    let plan = "title = \"t\"\n[[group]]\nscenes = [\"{a}/{b}-{a}\"]\n[group.sweep]\na = [\"{b}{b}\"]\nb = [\"x\"]\n";
    let cases = Plan::parse("plan", plan).unwrap().cases();
    assert_eq!(cases[0].scene, "{b}{b}/x-{b}{b}");
}

#[test]
fn settings_that_take_too_much_memory_are_refused_before_they_are_made() {
    let refused = |scene: &str, sweep: &str| {
        let plan = format!("title = \"t\"\n[[group]]\nscenes = [\"{scene}\"]\n[group.sweep]\n{sweep}\n");
        Plan::parse("plan", &plan).unwrap_err().to_string()
    };
    let range = "v = { from = 0, to = 1, count = 9000 }";
    let long = "x".repeat(10_000);
    assert!(refused(&format!("{long}{{v}}"), range).starts_with("plan:3: the plan's settings take "));
    assert!(refused("{v}", &format!("{range}\n\"gi.bounces\" = [\"{long}\"]")).contains("gi.bounces"));
    let names: String = (0..3000).map(|index| format!("{{v{index}}}")).collect();
    let values: String = (0..3000).map(|index| format!("v{index} = [1]\n")).collect();
    assert!(refused(&format!("{names}{{v}}"), &format!("{values}{range}")).contains("3001 keys are swept"));
}

#[test]
fn targets_are_times_shares_and_errors_and_only_auto_keeps_to_them() {
    let plan = |group: &str| {
        Plan::parse("plan.toml", &format!("title = \"x\"\n[[group]]\nscenes = [\"five-mirrors/none\"]\n{group}"))
    };
    let targets = plan("sweep = { target = [\"50ms\", \"0.5x\", \"1px\", \"2dE\"] }").unwrap();
    let targets: Vec<_> = targets.cases().iter().map(|case| case.target.unwrap().target(80.0).to_string()).collect();
    assert_eq!(targets, ["50ms", "40ms", "1px", "2dE"]);
    for (group, told) in [
        ("sweep = { target = [\"fast\"] }", "target `fast`: expected a time as in 50ms or 0.5x"),
        ("sweep = { target = [\"-1x\"] }", "above 0"),
        ("methods = [\"sscr\"]\nsweep = { target = [\"1x\"] }", "only `auto` keeps to a target"),
        ("sweep = { target = [\"1x\"], \"splat.step\" = [1, 8] }", "splat.step: `auto` chooses it for the `target`"),
        ("set = { \"gi.sky_lights\" = 64 }\nsweep = { target = [\"1x\"] }", "gi.sky_lights: `auto` chooses it"),
        ("set = { \"reflection.own_methods\" = true }", "each method in all mirrors"),
        ("figures = [\"still_delta_e\"]", "expected `still = true`"),
        ("figures = [\"in_front\"]", "expected `sightlines = true`"),
        ("figures = [\"same_input_light_error\"]", "expected `light = true`"),
    ] {
        let error = plan(group).unwrap_err().to_string();
        assert!(error.contains(told), "{error}");
    }
}
