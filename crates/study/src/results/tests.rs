//! Rows hold what the runs hold, and tables what the rows hold.

use super::*;

fn plan() -> Plan {
    let text = "title = \"Test, with a comma\"\n[[group]]\nscenes = [\"tube:{width}\"]\nmethods = [\"sscr\"]\n\
                sweep = { width = [1, 2], \"splat.size\" = [0.5] }";
    Plan::parse("test", text).unwrap()
}

fn machine() -> Machine {
    Machine { adapter: "A, B".into(), clock: "gpu".into(), ..Machine::default() }
}

fn timed(case: usize, round: u32, milliseconds: f64) -> Run {
    let passes = [
        ("splat_nearest", PassStage::Surface, 1.0),
        ("sscr_solve", PassStage::Method, milliseconds),
        ("push", PassStage::Method, 2.0),
        ("shade", PassStage::Light, 4.0),
        ("a_pass_of_tomorrow", PassStage::View, 8.0),
    ];
    let passes = passes.map(|(name, stage, ms)| TimedPass { name: name.to_owned(), stage, ms }).into();
    Run { case, round, machine: machine(), frame_ms: Some(milliseconds + 15.0), passes, ..Run::default() }
}

fn judged(case: usize) -> Run {
    let figures = [("coverage", 0.75), ("same_input_recall", 0.5)].map(|(name, value)| (name.to_owned(), value));
    let (figures, set) = (figures.into(), "gi.bounces=0".into());
    Run { case, figures, points: Some(7), set, machine: machine(), ..Run::default() }
}

#[test]
fn a_spread_is_the_median_between_the_least_and_the_most() {
    let spread = Spread::of(vec![4.0, 1.0, 3.0, 2.0]).unwrap();
    assert_eq!([spread.low, spread.median, spread.high], [1.0, 2.5, 4.0]);
    let odd = Spread::of(vec![9.0, 1.0, 2.0]).unwrap();
    assert_eq!([odd.low, odd.median, odd.high], [1.0, 2.0, 9.0]);
    let single = Spread::of(vec![3.0]).unwrap();
    assert_eq!([single.low, single.median, single.high], [3.0; 3]);
    assert_eq!(Spread::of(Vec::new()), None);
}

#[test]
fn rows_bring_the_rounds_of_a_setting_together() {
    let plan = plan();
    let runs = [judged(0), timed(0, 2, 30.0), timed(0, 1, 10.0), timed(0, 3, 20.0)];
    let rows = rows(&plan, &plan.cases(), &runs);
    assert_eq!(rows.len(), 1, "only what was run");
    let row = &rows[0];
    assert_eq!((row.repeats, row.points, row.value("coverage")), (3, Some(7), Some(0.75)));
    // Only the search and the closing count, whatever other passes there are.
    assert_eq!((row.value(METHOD_MS), row.value(FRAME_MS)), (Some(22.0), Some(35.0)));
    assert_eq!(row.method_ms.map(|spread| (spread.low, spread.high)), Some((12.0, 32.0)));
    assert_eq!(row.passes[1], ("sscr_solve".to_owned(), 20.0));
    let stages = PassStage::all().zip([1.0, 22.0, 4.0, 8.0]);
    assert_eq!(row.stages, stages.collect::<Vec<_>>());
    assert_eq!(row.value("same_input_delta_e"), None);
}

#[test]
fn a_part_of_a_plan_is_the_sum_of_its_passes() {
    let part = |name: &str, passes: &str| format!("[[part]]\nname = \"{name}\"\nlabel = \"x\"\npasses = [{passes}]\n");
    let parts = part("search_ms", "\"sscr_solve\", \"push\", \"unknown\"") + &part("other_ms", "\"unknown\"");
    let text = format!("title = \"a\"\n{parts}[[group]]\nscenes = [\"a\"]\nmethods = [\"sscr\"]\n");
    let plan = Plan::parse("test", &text).unwrap();
    let runs = [judged(0), timed(0, 1, 10.0), timed(0, 2, 20.0), timed(0, 3, 30.0)];
    let row = rows(&plan, &plan.cases(), &runs).remove(0);
    assert_eq!(row.spread("search_ms").map(|spread| (spread.low, spread.median)), Some((12.0, 22.0)));
    assert_eq!((row.value("search_ms"), row.value("other_ms")), (Some(22.0), None), "no pass of the other was run");
    let cells = cells(&plan, &row);
    let cell = |name: &str| cells.iter().find(|(known, _)| known == name).map(|(_, cell)| cell.clone());
    assert_eq!([cell("search_ms_high"), cell("other_ms")], [Some(Cell::Number(32.0)), Some(Cell::Empty)]);
}

#[test]
fn a_run_that_succeeds_takes_the_place_of_one_that_failed() {
    let plan = plan();
    let failed = Run { case: 1, error: Some("lost".into()), ..Run::default() };
    let all = rows(&plan, &plan.cases(), std::slice::from_ref(&failed));
    assert_eq!(all[0].error.as_deref(), Some("lost"));
    let all = rows(&plan, &plan.cases(), &[failed.clone(), judged(1), failed]);
    assert_eq!((all[0].error.as_deref(), all[0].points), (None, Some(7)));
}

#[test]
fn a_row_is_of_one_machine_and_version() {
    let plan = plan();
    let newer = |run: Run| Run { machine: Machine { commit: "newer".into(), ..machine() }, ..run };
    let older = [judged(0), timed(0, 1, 10.0), timed(0, 3, 10.0)];
    let row = |runs: &[Run]| rows(&plan, &plan.cases(), runs).remove(0);
    // The machine that made more rounds; the first of two that made as many.
    let mut runs = [newer(timed(0, 2, 90.0)), newer(judged(0))].to_vec();
    runs.extend(older);
    let found = row(&runs);
    assert_eq!((found.machine.commit.as_str(), found.repeats, found.value(METHOD_MS)), ("", 2, Some(12.0)));
    runs.push(newer(timed(0, 1, 90.0)));
    let found = row(&runs);
    assert_eq!((found.machine.commit.as_str(), found.repeats, found.value(METHOD_MS)), ("newer", 2, Some(92.0)));
}

#[test]
fn the_ray_tracers_clock_is_also_the_hosts() {
    let text = "title = \"a\"\n[[group]]\nscenes = [\"a\"]\nmethods = [\"sscr\", \"ray_trace\"]";
    let plan = Plan::parse("test", text).unwrap();
    let clocks = |clock: &str| -> Vec<String> {
        let machine = || Machine { clock: clock.into(), ..Machine::default() };
        let runs = [0, 1].map(|case| Run { case, machine: machine(), ..Run::default() });
        let rows = rows(&plan, &plan.cases(), &runs);
        let clock = |row| cells(&plan, row).into_iter().find(|(name, _)| name == "clock").unwrap().1.text();
        rows.iter().map(clock).collect()
    };
    assert_eq!((clocks("gpu"), clocks("host")), (vec!["gpu".into(), "gpu+host".into()], vec!["host".into(); 2]));
}

#[test]
fn figures_know_their_direction_and_what_they_need() {
    let better: Vec<&str> =
        figures().iter().filter(|figure| figure.more_is_better()).map(|figure| figure.name.as_str()).collect();
    let expected = [
        "coverage",
        "closed_coverage",
        "hit_rate",
        "same_input_recall",
        "same_input_ssim",
        "exact_ssim",
        "within",
        "traced_within",
    ];
    assert_eq!(better, expected);
    assert_eq!(figure("exact_flip").unwrap().truth(), Some((Truth::Exact, "exact")));
    assert!(figure("in_front").unwrap().is_of_sightlines() && !figure("coverage").unwrap().is_of_sightlines());
    assert!(figure("exact_light_mean").unwrap().is_of_light() && !figure("exact_rmse").unwrap().is_of_light());
    assert!(figure("flicker_still").unwrap().is_of_flicker() && !figure("coverage").unwrap().is_of_flicker());
}

#[test]
fn columns_of_csv_and_json_are_fixed() {
    let plan = plan();
    let rows = rows(&plan, &plan.cases(), &[judged(0), timed(0, 1, 10.0), judged(1)]);
    let text = String::from_utf8(csv(&plan, &rows).unwrap()).unwrap();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let names: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let truth = "false_fill angle_error_median angle_error_p95 angle_error_p99 pixel_error_median pixel_error_p95 \
                 pixel_error_p99 occlusion_error wrong";
    let expected = format!(
        "plan group scene method splat.size {{width}} set width height points repeats frame_ms frame_ms_low \
         frame_ms_high method_ms method_ms_low method_ms_high mirror_pixels coverage closed_coverage hit_rate \
         unconverged regions unresolved tests_per_ray maps_new maps_missed maps_bytes maps_off texels_traced listed ray_copies cameras_bytes cameras_ms uncertain estimated_pixel_error_median estimated_pixel_error_p95 estimated_wrong \
         estimated_wrong_low estimated_wrong_high estimated_light_error {} same_input_recall same_input_rmse same_input_delta_e same_input_delta_e_p95 same_input_flip same_input_ssim same_input_rmse_l \
         same_input_rmse_a same_input_rmse_b same_input_light_error same_input_light_mean same_input_light_brightest {} exact_rmse \
         exact_delta_e exact_delta_e_p95 exact_flip exact_ssim exact_rmse_l exact_rmse_a exact_rmse_b exact_light_error exact_light_mean exact_light_brightest within in_front behind open depth_error_median depth_error_p95 colour_error_median \
         traced_within traced_in_front still_delta_e still_worse_delta_e still_mirrors_delta_e still_mirrors_delta_e_p95 \
         still_rest_delta_e still_rest_delta_e_p95 still_pixel_error_p95 target_ms predicted_ms flicker_still flicker_moving adapter adapter_kind clock commit error",
        truth.split_whitespace().map(|name| format!("same_input_{name}")).collect::<Vec<_>>().join(" "),
        truth.split_whitespace().map(|name| format!("exact_{name}")).collect::<Vec<_>>().join(" ")
    );
    assert_eq!(names, expected.split_whitespace().collect::<Vec<_>>());
    let records: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let cell = |row: usize, name: &str| records[row].get(names.iter().position(|other| other == name).unwrap());
    assert_eq!((cell(0, "plan"), cell(0, "adapter")), (Some("Test, with a comma"), Some("A, B")));
    assert_eq!((cell(0, "{width}"), cell(0, "width"), cell(1, "{width}")), (Some("1"), Some("800"), Some("2")));
    assert_eq!((cell(0, "frame_ms"), cell(1, "frame_ms"), cell(0, "exact_flip")), (Some("25"), Some(""), Some("")));
    let objects: serde_json::Value = serde_json::from_str(&json(&plan, &rows).unwrap()).unwrap();
    let object = &objects[0];
    assert!(names.iter().all(|name| object.get(name).is_some()), "{object}");
    assert_eq!((&object["splat.size"], &object["{width}"]), (&serde_json::json!(0.5), &serde_json::json!(1)));
    assert_eq!(
        (&object["passes"]["sscr_solve"], &object["stages"]["method"], &object["exact_flip"]),
        (&serde_json::json!(10), &serde_json::json!(12), &serde_json::Value::Null)
    );
}

#[test]
fn every_figure_has_a_name_of_its_own() {
    let mut names: Vec<&str> = figures().iter().map(|figure| figure.name.as_str()).collect();
    assert!(names.contains(&"exact_pixel_error_p95") && !names.contains(&"exact_recall"));
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), figures().len());
}

#[test]
fn a_setting_without_passes_of_its_method_takes_no_time_and_not_less() {
    let plan = plan();
    let runs = [1, 2, 3].map(|round| Run { passes: Vec::new(), ..timed(0, round, 10.0) });
    let rows = rows(&plan, &plan.cases(), &[&[judged(0)][..], &runs].concat());
    assert_eq!(rows[0].value(METHOD_MS).map(f64::to_bits), Some(0.0_f64.to_bits()));
}
