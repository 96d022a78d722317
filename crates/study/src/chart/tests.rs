//! Charts hold what the rows hold: read back from the model and from the SVG's text.

use proptest::prelude::*;

use super::*;
use crate::results::{Machine, Spread};

fn plan(groups: &str) -> Plan {
    let head = "title = \"Test\"\nerrors = [\"same_input_delta_e\"]\nfigures = [\"coverage\", \"method_ms\"]\n";
    Plan::parse("test", &format!("{head}{groups}")).unwrap()
}

/// A row for each setting, of `value(case, figure)`.
fn rows(plan: &Plan, value: impl Fn(&Case, &str) -> Option<f64>) -> Vec<Row> {
    let row = |case: Case| {
        let spread = |figure: &str| {
            let spread = |median: f64| Spread { median, low: median * 0.9, high: median * 1.1 };
            value(&case, figure).map(spread)
        };
        let figures = ["same_input_delta_e", "coverage"];
        let figures =
            figures.into_iter().filter_map(|figure| Some((figure.to_owned(), value(&case, figure)?))).collect();
        Row {
            group: plan.groups[case.group].name.clone(),
            set: String::new(),
            points: Some(1000),
            repeats: 3,
            frame_ms: spread("frame_ms"),
            method_ms: spread("method_ms"),
            parts: Vec::new(),
            passes: Vec::new(),
            stages: Vec::new(),
            figures,
            machine: Machine::default(),
            error: None,
            case,
        }
    };
    plan.cases().into_iter().map(row).collect()
}

const GROUPS: &str = "[[group]]\nscenes = [\"one\", \"two\"]\nmethods = [\"none\", \"sscr_hierarchical\"]\n\
                      [[group]]\nname = \"published\"\nscenes = [\"one\", \"two\"]\nmethods = [\"sscr\"]\n\
                      [[group]]\nname = \"swept\"\nscenes = [\"one\", \"two\"]\nmethods = [\"sscr\"]\n\
                      sweep = { \"sscr.seed_attempts\" = [0, 4, 16] }\nbound = { figure = \"coverage\", at_least = 0.5 }\n";

fn swept(case: &Case) -> f64 {
    case.swept_value("sscr.seed_attempts").map_or(8.0, |value| value.parse().unwrap())
}

fn value(case: &Case, figure: &str) -> Option<f64> {
    let step = swept(case) + 1.0;
    match (case.method.as_str(), figure) {
        ("none", "coverage") => None,
        ("none", "same_input_delta_e") => Some(40.0),
        ("none", _) => Some(0.0),
        ("sscr_hierarchical", "same_input_delta_e") => Some(0.0),
        (_, "same_input_delta_e") => Some(20.0 / step),
        (_, "coverage") => Some(1.0 - 0.5 / step),
        _ => Some(10.0 * step),
    }
}

#[test]
fn charts_are_one_a_figure_and_hold_every_setting() {
    let plan = plan(GROUPS);
    let charts = charts(&plan, &rows(&plan, value));
    let names: Vec<&str> = charts.iter().map(|chart| chart.name.as_str()).collect();
    // The group with a bound is charted by the bound's figure alone.
    assert_eq!(names, ["time-same-input-delta-e", "sscr-seed-attempts-coverage"]);
    let [time, sweep] = &charts[..] else { panic!("two charts") };
    assert_eq!(time.panels.len(), 2);
    for panel in &time.panels {
        let marks: usize = panel.curves.iter().map(|curve| curve.marks.len()).sum();
        assert_eq!((marks, panel.levels.len()), (5, 1));
        let joined: Vec<usize> =
            panel.curves.iter().filter(|curve| curve.is_joined).map(|curve| curve.marks.len()).collect();
        assert_eq!(joined, [3], "only the sweep is a line");
        // From the quickest to the best; nothing is better than zero.
        assert_eq!(panel.front.first(), Some(&(10.0, 20.0)));
        assert_eq!(panel.front.last(), Some(&(90.0, 0.0)));
    }
    // One method, so a line for each scene.
    let [panel] = &sweep.panels[..] else { panic!("one panel") };
    let curves: Vec<(&str, usize)> =
        panel.curves.iter().map(|curve| (curve.name.as_str(), curve.marks.len())).collect();
    assert_eq!(curves, [("one", 3), ("two", 3)]);
    assert_eq!(panel.limit.map(|limit| (limit.y, limit.is_least)), Some((0.5, true)));
    let x = |value| panel.x.share(value);
    assert!(x(0.0) < x(4.0) && x(4.0) < x(16.0));
}

#[test]
fn a_chart_names_its_conditions_and_marks_settings_that_leave_much_empty() {
    let plan = plan(GROUPS);
    let charts = charts(&plan, &rows(&plan, value));
    for chart in &charts {
        assert_eq!(chart.conditions[0], "800x600; 1,000 points; 3 timed rounds", "{}", chart.name);
        assert!(chart.svg().unwrap().contains("1,000 points"), "{}", chart.name);
    }
    let marks = charts[0].panels[0].curves.iter().flat_map(|curve| &curve.marks);
    let sparse: Vec<f64> = marks.filter(|mark| mark.is_sparse).map(|mark| mark.x).collect();
    assert_eq!(sparse, [10.0], "only the setting that covers half");
}

#[test]
fn unlike_scenes_and_unlike_tasks_have_no_front_in_common() {
    let groups = "[[group]]\nscenes = [\"tube:{width}\"]\nmethods = [\"sscr\"]\nsweep = { width = [1, 2] }\n\
                  [[group]]\nname = \"sizes\"\nscenes = [\"box\"]\nmethods = [\"sscr\"]\nsweep = { size = [\"64x48\", \"32x24\"] }";
    let plan = plan(groups);
    let time = &charts(&plan, &rows(&plan, value))[0];
    let panels: Vec<(&str, usize, usize)> = time
        .panels
        .iter()
        .map(|panel| (panel.title.as_str(), panel.curves[0].marks.len(), panel.front.len()))
        .collect();
    assert_eq!(panels, [("tube:1", 1, 1), ("tube:2", 1, 1), ("box", 2, 0)]);
    assert!(time.panels[2].curves[0].is_joined && !time.panels[0].curves[0].is_joined);
    assert_eq!(time.panels[0].curves[0].name, "sscr", "its scene's variable is no parameter of the method");
}

#[test]
fn where_more_is_better_the_front_rises() {
    let mut plan = plan(GROUPS);
    plan.errors = vec!["coverage".into()];
    let time = &charts(&plan, &rows(&plan, value))[0];
    assert!(time.title.ends_with("against coverage, upper left is better"), "{}", time.title);
    let panel = &time.panels[0];
    assert_eq!(panel.front.first(), Some(&(10.0, 0.5)));
    assert!(panel.front.len() > 1 && panel.front.is_sorted_by(|a, b| a.0 < b.0 && a.1 < b.1), "{:?}", panel.front);
}

#[test]
fn an_svg_shows_the_labels_of_all_points_and_no_mark_outside() {
    let plan = plan(GROUPS);
    let all = charts(&plan, &rows(&plan, value));
    let svg = all[0].svg().unwrap();
    let words: Vec<&str> = svg.lines().map(str::trim).collect();
    let count = |label: &str| words.iter().filter(|line| **line == label).count();
    // Two panels, each with the sweep's three values and the single setting.
    for label in ["4", "16", "published"] {
        assert_eq!(count(label), 2, "{label}: {svg}");
    }
    assert!(count("0") >= 2 && count("time of the method [ms]") == 2, "{svg}");
    assert_eq!(count("sscr: sscr.seed_attempts"), 1);
    // A disc for each setting of sscr, and one for each of the two entries of the legend.
    assert_eq!(svg.matches("<circle").count(), 2 * 4 + 2);
    for (name, low, high) in [("cx", 0.0, 900.0), ("cy", 0.0, 1200.0)] {
        let start = format!(" {name}=\"");
        let places: Vec<f64> =
            svg.split(&start).skip(1).filter_map(|rest| rest.split('"').next()?.parse().ok()).collect();
        assert!(places.len() == 10 && places.iter().all(|at| (low..high).contains(at)), "{places:?}");
    }
    let image = image::load_from_memory(&all[0].png().unwrap()).unwrap().to_rgb8();
    assert_eq!(image.width(), 1800);
    let [red, green, blue] = Style::of_method("sscr").color;
    assert!(image.pixels().filter(|pixel| pixel.0 == [red, green, blue]).count() > 400, "discs are filled");
}

#[test]
fn labels_never_lie_on_one_another() {
    // Forty points within a few pixels of each other.
    let values: Vec<String> = (0..17).map(|value| value.to_string()).collect();
    let plan = plan(&format!(
        "[[group]]\nscenes = [\"one\"]\nmethods = [\"sscr\"]\nsweep = {{ \"sscr.seed_attempts\" = [{}] }}",
        values.join(", ")
    ));
    let crowded = |case: &Case, figure: &str| match figure {
        "same_input_delta_e" => Some(1.0 + swept(case) * 0.001),
        _ => Some(10.0 + swept(case) * 0.001),
    };
    let chart = &charts(&plan, &rows(&plan, crowded))[0];
    let (shapes, _) = layout::layout(chart);
    let boxes: Vec<(f64, f64, f64)> = shapes
        .iter()
        .filter_map(|shape| match shape {
            // Labels have the colour of their curve.
            shapes::Shape::Words { at, text, size, color, .. } if color[0] > 100 => {
                Some((at.0, at.1, shapes::width(text, *size)))
            }
            _ => None,
        })
        .collect();
    assert!(boxes.len() > 1, "some find a place");
    for (index, a) in boxes.iter().enumerate() {
        for b in &boxes[..index] {
            let is_apart = (a.0 - b.0).abs() >= (a.2 + b.2) / 2.0 || (a.1 - b.1).abs() >= 11.0 * 1.2;
            assert!(is_apart, "{a:?} {b:?}");
        }
    }
}

#[test]
fn text_values_and_sizes_have_places_side_by_side() {
    let plan = plan(
        "[[group]]\nscenes = [\"one\"]\nmethods = [\"sscr\", \"surfel_trace\"]\nsweep = { size = [\"64x48\", \"32x24\"] }\n\
         [[group]]\nname = \"flat\"\nscenes = [\"one\"]\nmethods = [\"ray_trace\"]",
    );
    let charts = charts(&plan, &rows(&plan, value));
    let coverage = charts.iter().find(|chart| chart.name == "size-coverage").unwrap();
    let panel = &coverage.panels[0];
    let names: Vec<&str> = panel.curves.iter().map(|curve| curve.name.as_str()).collect();
    assert_eq!(names, ["sscr", "surfel_trace"]);
    assert_eq!(panel.curves[0].marks.iter().map(|mark| mark.x).collect::<Vec<_>>(), [0.25, 0.75]);
    assert_eq!(panel.levels.iter().map(|level| level.name.as_str()).collect::<Vec<_>>(), ["ray_trace"]);
    let times = charts.iter().find(|chart| chart.name == "size-method-ms").unwrap();
    assert!(times.panels[0].curves.iter().flat_map(|curve| &curve.marks).all(|mark| mark.whisker.is_some()));
}

#[test]
fn times_have_whiskers_and_those_of_less_than_three_rounds_are_not_shown() {
    let plan = plan(GROUPS);
    let mut rows = rows(&plan, value);
    let time = &charts(&plan, &rows)[0];
    let marks = || time.panels.iter().flat_map(|panel| &panel.curves).flat_map(|curve| &curve.marks);
    assert!(marks().all(|mark| mark.whisker == Some(Whisker::Across { low: mark.x * 0.9, high: mark.x * 1.1 })));
    // The axis holds the whiskers.
    let panel = &time.panels[0];
    let mut ends = panel.curves.iter().flat_map(|curve| &curve.marks).flat_map(Mark::across);
    assert!(ends.all(|end| (0.0..=1.0).contains(&panel.x.share(end))));
    for row in &mut rows {
        row.repeats = if row.case.method == "sscr" { 2 } else { 3 };
    }
    let fewer = &charts(&plan, &rows)[0];
    let names: Vec<&str> = fewer.panels[0].curves.iter().map(|curve| curve.name.as_str()).collect();
    assert_eq!(names, ["sscr_hierarchical"]);
    rows.iter_mut().for_each(|row| row.repeats = 1);
    let names: Vec<String> = charts(&plan, &rows).into_iter().map(|chart| chart.name).collect();
    assert_eq!(names, ["sscr-seed-attempts-coverage"], "errors stay");
}

#[test]
fn names_of_scenes_are_short() {
    assert_eq!(short_scene("five-mirrors/sphere"), "five-mirrors/sphere");
    assert_eq!(short_scene("stability/tube:{width}"), "stability/tube");
    assert_eq!(short_scene("five-mirrors/{mirror}"), "five-mirrors");
    assert_eq!(short_scene("/data/scenes/office.toml"), "office");
    let apart = |scenes: &[&str]| names_apart(scenes, short_scene);
    assert_eq!(apart(&["/a/one/room.toml", "/a/hall.toml", "/a/two/room.toml"]), ["one/room", "hall", "two/room"]);
    assert_eq!(apart(&["/a/x/room.toml", "/b/x/room.toml", "x/room.toml"])[..2], ["a/x/room", "b/x/room"]);
    assert_eq!(apart(&["room.toml", "b/room.toml"]), ["room.toml", "b/room"]);
}

#[test]
fn curves_of_several_methods_and_values_are_told_apart_by_colour_and_mark() {
    let plan = plan(
        "[[group]]\nscenes = [\"one\"]\nmethods = [\"sscr\", \"sscr_hierarchical\"]\n\
         sweep = { \"sscr.seed_attempts\" = [0, 4], \"splat.step\" = [1, 2] }\n",
    );
    let rows = rows(&plan, |case, figure| Some(value(case, figure).unwrap_or(1.0)));
    let charts = charts(&plan, &rows);
    let chart = charts.iter().find(|chart| chart.name == "splat-step-coverage").unwrap();
    let styles: Vec<Style> = chart.panels[0].curves.iter().map(|curve| curve.style).collect();
    assert_eq!(styles.len(), 4);
    assert!((0..4).all(|one| (0..one).all(|other| styles[one] != styles[other])), "{styles:?}");
    for (curve, style) in chart.panels[0].curves.iter().zip(&styles) {
        let method = curve.name.split(' ').next().unwrap();
        assert_eq!(style.color, Style::of_method(method).color, "{}", curve.name);
    }
}

#[test]
fn the_front_is_of_settings_that_fill_the_mirrors_in_pixels_of_one_size() {
    let group =
        |sweep: &str| plan(&format!("[[group]]\nscenes = [\"one\"]\nmethods = [\"sscr\"]\nsweep = {{ {sweep} }}\n"));
    let front = |plan: &Plan, coverage: f64, error: &str| {
        let of = |case: &Case, figure: &str| match figure {
            "coverage" => Some(if case.index == 0 { coverage } else { 1.0 }),
            _ => value(case, figure),
        };
        let mut rows = rows(plan, of);
        for row in &mut rows {
            let own = row.figures["same_input_delta_e"];
            row.figures.insert("same_input_wrong".into(), own);
        }
        let plan = Plan { errors: vec![error.to_owned()], ..plan.clone() };
        charts(&plan, &rows)[0].panels[0].front.len()
    };
    let attempts = group("\"sscr.seed_attempts\" = [0, 4]");
    // Colours count empty pixels, the share of wrong ones does not.
    let [colors, wrong] = ["same_input_delta_e", "same_input_wrong"];
    assert_eq!([1.0, 0.5].map(|coverage| front(&attempts, coverage, colors)), [2, 2]);
    assert_eq!([1.0, 0.5].map(|coverage| front(&attempts, coverage, wrong)), [2, 1]);
    assert_eq!(front(&group("\"view.resolution\" = [0.5, 1]"), 1.0, colors), 0);
}

proptest! {
    #[test]
    fn the_front_is_what_nothing_beats(points in prop::collection::vec((0_u8..12, 0_u8..12), 0..30)) {
        let points: Vec<(f64, f64)> = points.into_iter().map(|(time, error)| (time.into(), error.into())).collect();
        let front = pareto(&points);
        let beats = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
        for (index, point) in points.iter().enumerate() {
            let is_beaten = points.iter().any(|other| beats(*other, *point));
            let is_first = points.iter().position(|other| other == point) == Some(index);
            prop_assert_eq!(front.contains(&index), !is_beaten && is_first);
        }
        prop_assert!(front.is_sorted_by(|a, b| points[*a].0 < points[*b].0 && points[*a].1 > points[*b].1));
    }
}

#[test]
fn stacked_times_are_a_column_for_each_setting_as_high_as_their_sum() {
    let head = "title = \"Test\"\nerrors = []\nfigures = []\n[[part]]\nname = \"search_ms\"\nlabel = \"search\"\n\
                passes = [\"sscr_solve\"]\n";
    let group = "[[group]]\nname = \"all\"\nscenes = [\"a/one\", \"a/two\"]\nmethods = [\"sscr\"]\n\
                 stacked = [[\"search_ms\", \"method_ms\"], [\"frame_ms\"]]\nsweep = { \"sscr.seed_attempts\" = [0, 4] }\n";
    let plan = Plan::parse("test", &format!("{head}{group}")).unwrap();
    let mut rows = rows(&plan, value);
    for row in &mut rows {
        row.parts = vec![("search_ms".into(), Spread { median: 5.0, low: 4.0, high: 6.0 })];
    }
    let charts = super::charts(&plan, &rows);
    assert_eq!(charts.iter().map(|chart| chart.name.as_str()).collect::<Vec<_>>(), ["stacked-all", "stacked-all-2"]);
    let columns = &charts[0].panels[0].columns;
    let heights: Vec<f64> = columns.iter().map(|column| column.layers.iter().map(|layer| layer.height).sum()).collect();
    assert_eq!(heights, [15.0, 55.0, 15.0, 55.0]);
    assert!(columns.is_sorted_by(|a, b| a.x < b.x));
    let svg = charts[0].svg().unwrap();
    for text in ["one 0", "two 4", "search", "the method", "time [ms]"] {
        assert!(svg.contains(text), "{text}");
    }
    // The second layer lies on the first: of four rectangles with the colour of each, none overlap.
    assert_eq!(svg.matches("<polygon").count(), 4 * 2 + 2, "and two in the legend");
    assert!(columns.iter().all(|column| column.layers[0].ends == (4.0, 6.0)));
    rows.iter_mut().for_each(|row| row.repeats = 2);
    assert!(super::charts(&plan, &rows).is_empty());
}

#[test]
fn no_two_methods_have_the_same_colour() {
    // `auto` is drawn in the grey of `none`, since it runs as one of the others.
    let mut colors: Vec<[u8; 3]> = METHOD_STYLES[1..].iter().map(|style| style.color).collect();
    colors.sort_unstable();
    colors.dedup();
    assert_eq!(colors.len(), scene::METHODS.len() - 1);
}
