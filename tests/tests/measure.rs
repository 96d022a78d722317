//! `glint measure`: values against closed forms, within their own stated uncertainty; units of real files; refusals.

use serde_json::Value;
use tests::server::{Habits, Server};
use tests::{Folder, Session, Window, test_data};

/// The deviation of the points along z, or from the axis of the column.
const NOISE: f64 = 0.01;
/// The place of the scene, at coordinates of seven digits.
const PLACE: [f64; 2] = [5_000_000.0, 600_000.0];

/// Draws numbers that are about normally distributed, with a deviation of 1: a sum of twelve even ones.
struct Dice(u64);

impl Dice {
    fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn noise(&mut self) -> f64 {
        (0..12).map(|_| self.share()).sum::<f64>() - 6.0
    }
}

fn ply(points: impl Iterator<Item = [f64; 3]>) -> String {
    let lines: Vec<String> = points.map(|[x, y, z]| format!("{} {} {z}\n", PLACE[0] + x, PLACE[1] + y)).collect();
    let header = "property double x\nproperty double y\nproperty double z\nend_header\n";
    format!("ply\nformat ascii 1.0\nelement vertex {}\n{header}{}", lines.len(), lines.concat())
}

/// The height of a slope of 20 x 20 units.
fn height(x: f64, y: f64) -> f64 {
    0.25 * x - 0.5 * y
}

/// The slope, with noise, on a lattice of 0.1.
fn slope() -> String {
    let mut dice = Dice(1);
    let place = |i: i32| (f64::from(i % 201) * 0.1, f64::from(i / 201) * 0.1);
    ply((0..201 * 201).map(place).map(move |(x, y)| [x, y, height(x, y) + NOISE * dice.noise()]))
}

/// An upright column of radius 0.5 and height 2, with noise, about (10, 10).
fn column() -> String {
    let mut dice = Dice(2);
    let point = move |_| {
        let (sine, cosine) = (dice.share() * std::f64::consts::TAU).sin_cos();
        let away = 0.5 + NOISE * dice.noise();
        [10.0 + cosine * away, 10.0 + sine * away, dice.share() * 2.0]
    };
    ply((0..20_000).map(point))
}

fn on_slope(x: f64, y: f64) -> String {
    format!("[{}, {}, {}]", PLACE[0] + x, PLACE[1] + y, height(x, y))
}

fn measurement(name: &str, kind: &str, points: &[String], more: &str) -> String {
    format!("[[measurements]]\nname = \"{name}\"\nkind = \"{kind}\"\npoints = [{}]\n{more}\n", points.join(", "))
}

/// A value with its uncertainty, of a measurement by name.
fn value(report: &Value, measurement: &str, name: &str) -> (f64, Option<f64>) {
    let all = report["measurements"].as_array().expect("a list");
    let own = all.iter().find(|own| own["name"] == measurement).unwrap_or_else(|| panic!("no {measurement}: {report}"));
    let values = own["values"].as_array().unwrap_or_else(|| panic!("{own}"));
    let value = values.iter().find(|value| value["name"] == name).unwrap_or_else(|| panic!("no {name} in {own}"));
    (value["value"].as_f64().expect("a number"), value["uncertainty"].as_f64())
}

#[test]
fn values_of_a_slope_and_a_column_are_those_of_their_formulas_within_their_uncertainty() {
    let folder = Folder::new();
    folder.write("slope.ply", slope());
    folder.write("column.ply", column());
    let square = [(4.0, 4.0), (12.0, 4.0), (12.0, 12.0), (4.0, 12.0)].map(|(x, y)| on_slope(x, y));
    let rim = [0.0_f64, 1.0, 2.5, 4.0]
        .map(|turn| format!("[{}, {}, 1.0]", PLACE[0] + 10.0 + 0.5 * turn.cos(), PLACE[1] + 10.0 + 0.5 * turn.sin()));
    let slope = [
        "clouds = [\"slope.ply\"]\n".to_string(),
        measurement("p", "point", &[on_slope(3.0, 5.0)], ""),
        measurement("d", "distance", &[on_slope(2.0, 2.0), on_slope(8.0, 10.0)], ""),
        measurement("l", "polyline", &square[..3], "on = false"),
        measurement("h", "height", &[on_slope(2.0, 2.0), on_slope(8.0, 10.0)], ""),
        measurement("a", "angle", &square[..3], ""),
        measurement("s", "area", &square, ""),
        measurement("plane", "plane", &[on_slope(10.0, 10.0)], "reach = 3.0"),
        measurement("v", "volume", &square, "level = -10.0"),
        measurement("flat", "volume", &square, ""),
    ];
    folder.write("slope.toml", slope.concat());
    let outcome = folder.glint(["measure", "slope.toml", "--json"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let report = outcome.json();
    assert_eq!(report["unit"], Value::Null);
    let length = (36.0 + 64.0 + height(6.0, 8.0).powi(2)).sqrt();
    let (side, other) = ((64.0 + 4.0_f64).sqrt(), (64.0 + 16.0_f64).sqrt());
    let corner = (-(2.0 * -4.0) / (side * other)).acos().to_degrees();
    let steepness = (0.25_f64 * 0.25 + 0.5 * 0.5).sqrt();
    // The slope is 2.5 lower than level 0 at the middle of the square, (8, 8): 2.0 lower.
    let volume = 64.0 * (height(8.0, 8.0) + 10.0);
    // What is known to be certain to this figure, and the largest uncertainty that is plausible.
    for (name, figure, expected, least, most) in [
        ("p", "x", PLACE[0] + 3.0, 0.01, 0.1),
        ("p", "z", height(3.0, 5.0), 0.005, 0.05),
        ("d", "distance", length, 0.01, 0.1),
        ("d", "horizontal", 10.0, 0.01, 0.1),
        ("d", "vertical", height(6.0, 8.0), 0.005, 0.1),
        ("l", "length", side + other, 0.01, 0.1),
        ("h", "height", height(6.0, 8.0), 0.005, 0.1),
        ("a", "angle", corner, 0.05, 1.0),
        ("s", "area", 64.0 * (1.0 + steepness * steepness).sqrt(), 0.05, 1.0),
        ("s", "level area", 64.0, 0.05, 1.0),
        ("plane", "dip", steepness.atan().to_degrees(), 0.0005, 0.02),
        ("v", "volume", volume, 0.002, 0.1),
        ("flat", "volume", 0.0, 0.002, 0.1),
    ] {
        let (value, uncertainty) = value(&report, name, figure);
        let uncertainty = uncertainty.unwrap_or_else(|| panic!("{name}, {figure}: no uncertainty"));
        assert!((value - expected).abs() < 4.0 * uncertainty, "{name}, {figure}: {value}, not {expected}");
        assert!((least..most).contains(&uncertainty), "{name}, {figure}: ± {uncertainty}");
    }
    let noise = NOISE / (1.0 + steepness * steepness).sqrt();
    assert!((value(&report, "p", "noise").0 / noise - 1.0).abs() < 0.5, "{report}");
    // Along x and y 0.1, and the slope stretches it.
    assert!((0.08..0.14).contains(&value(&report, "p", "spacing").0), "{report}");
    assert!((value(&report, "plane", "rms").0 / noise - 1.0).abs() < 0.05, "{report}");
    let points = value(&report, "plane", "points").0;
    assert!((points / (100.0 * 9.0 * std::f64::consts::PI / (1.0 + steepness * steepness).sqrt()) - 1.0).abs() < 0.05);
    assert_eq!(report["measurements"][2]["on"], false);

    let tube = "reach = 0.6";
    let column = [
        "clouds = [\"column.ply\"]\n".to_string(),
        measurement("c", "circle", &rim, ""),
        measurement("t", "cylinder", &[rim[0].clone(), rim[2].clone()], tube),
        // A quarter of the turn is clipped away, and nothing is left of its points.
        "[[clips]]\nposition = [5000010.0, 600010.0, 1.0]\nsize = [3.0, 3.0, 1.0]\n".to_string(),
    ];
    folder.write("column.toml", column.concat());
    let outcome = folder.glint(["measure", "column.toml", "--json"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let report = outcome.json();
    for (name, most) in [("c", 0.1), ("t", 0.001)] {
        let (value, uncertainty) = value(&report, name, "radius");
        let uncertainty = uncertainty.unwrap_or_else(|| panic!("{name}: no uncertainty"));
        assert!((value - 0.5).abs() < 4.0 * uncertainty && uncertainty < most, "{name}: {value} ± {uncertainty}");
    }
    assert!((value(&report, "t", "rms").0 / NOISE - 1.0).abs() < 0.05, "{report}");
    assert!((value(&report, "t", "length").0 - 1.0).abs() < 0.02, "the clip is 1 high: {report}");

    // As a table, with the same numbers.
    let outcome = folder.glint(["measure", "column.toml", "--csv"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let text = outcome.text();
    let mut rows = text.lines();
    assert_eq!(rows.next(), Some("measurement,kind,on,figure,value,unit,uncertainty,error,interval"));
    let told = report["measurements"].as_array().expect("a list").iter();
    let values = told.flat_map(|own| own["values"].as_array().expect("values").iter().map(move |value| (own, value)));
    let rows: Vec<Vec<&str>> = rows.map(|row| row.split(',').collect()).collect();
    assert!(rows.len() > 10 && rows.len() == values.clone().count(), "{text}");
    for (row, (own, value)) in rows.iter().zip(values) {
        assert_eq!((row[0], row[1], row[2]), (own["name"].as_str().unwrap(), own["kind"].as_str().unwrap(), "true"));
        let unit = value["unit"].as_str().unwrap_or_default();
        assert_eq!((row[3], row[5], row[7]), (value["name"].as_str().unwrap(), unit, ""));
        let numbers = [(row[4], &value["value"]), (row[6], &value["uncertainty"]), (row[8], &value["interval"])];
        let ratio = value["uncertainty"].as_f64().zip(value["interval"].as_f64()).map(|(one, most)| most / one);
        assert!(
            ratio.is_none_or(|ratio| (ratio - 1.96).abs() < 1e-3) && value["uncertainty"].is_null() == ratio.is_none()
        );
        for (text, told) in numbers {
            let (own, told): (Option<f64>, _) = (text.parse().ok(), told.as_f64());
            let is_same = own.zip(told).map_or(own == told, |(own, told)| (own - told).abs() <= 1e-12 * told.abs());
            assert!(is_same, "{text:?} is not {told:?}");
        }
    }

    // For people, with as many digits as the uncertainty allows.
    let text = folder.glint(["measure", "column.toml"]);
    let line = text.text().lines().find(|line| line.contains("radius")).map(str::to_owned);
    assert!(line.is_some_and(|line| line.contains(" ± 0.0")), "{text}");
}

#[test]
fn values_are_the_same_in_every_run_and_feet_are_feet() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let scene = |file: &str| {
        let points = ["[0.0, 0.0, 0.0]", "[3.0, 4.0, 0.0]"].map(str::to_owned);
        let clouds = format!("clouds = [{:?}]\n", data.join(file));
        folder.write(
            "some.toml",
            clouds
                + &measurement("d", "distance", &points, "")
                + &measurement("s", "area", &[points[0].clone(), "[3, 0, 0]".into(), points[1].clone()], ""),
        );
        let outcome = folder.glint(["measure", "some.toml", "--json"]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
        assert_eq!(outcome.json(), folder.glint(["measure", "some.toml", "--json"]).json());
        let (report, messages) = (outcome.json(), outcome.messages.clone());
        assert_eq!(value(&report, "d", "distance").0, 5.0);
        (report, messages)
    };
    let unit = |report: &Value| {
        let values = &report["measurements"];
        (values[0]["values"][0]["unit"].clone(), values[1]["values"][0]["unit"].clone())
    };
    let (feet, _) = scene("airborne/certainty3d_color_feet_las12_pf3.las");
    assert_eq!((feet["unit"].clone(), unit(&feet)), ("ftUS".into(), ("ftUS".into(), "ftUS²".into())));
    let (metres, _) = scene("airborne/megaplot_forest_las12_pf1.laz");
    assert_eq!(unit(&metres), ("m".into(), "m²".into()));
    let (mixed, messages) = scene("copc/simple_with_hierarchy_page.copc.laz");
    assert_eq!(unit(&mixed), (Value::Null, Value::Null));
    assert!(messages.contains("the units are mixed: x and y are in m, heights in ftUS"), "{messages}");
}

#[test]
fn what_cannot_be_measured_is_told_and_the_rest_is_measured() {
    let folder = Folder::new();
    folder.write("slope.ply", slope());
    let refused = |scene: &str, status: i32, mentioned: &str| {
        folder.write("some.toml", scene);
        let outcome = folder.glint(["measure", "some.toml"]);
        assert_eq!(outcome.status, Some(status), "{outcome}");
        assert!(outcome.messages.contains(mentioned), "{mentioned}: {outcome}");
        outcome.text()
    };
    let distance = measurement("d", "distance", &[on_slope(0.0, 0.0), on_slope(1.0, 0.0)], "");
    refused("clouds = [\"slope.ply\"]\n", 2, "some.toml: no measurements in it");
    refused(&format!("clouds = [\"gone.ply\"]\n{distance}"), 2, "gone.ply");
    refused(&format!("clouds = [\"five-mirrors/sphere\"]\n{distance}"), 2, "points of files are measured");
    let odd = distance.replace("distance", "distence");
    refused(&format!("clouds = [\"slope.ply\"]\n{odd}"), 2, "line 4, column 8: unknown variant `distence`");
    let far = measurement("far", "plane", &["[0.0, 0.0, 0.0]".into()], "reach = 1.0");
    let text = refused(&format!("clouds = [\"slope.ply\"]\n{far}{distance}"), 1, "measurement 1 (`far`): 0 points");
    assert!(text.contains("1.03 ± 0."), "{text}");
    let text = folder.glint(["measure", "some.toml", "--csv"]).text();
    assert!(
        text.contains("\nfar,plane,true,,,,,\"0 points") && text.contains("\nd,distance,true,distance,1.03"),
        "{text}"
    );
    assert_eq!(folder.glint(["measure", "some.toml", "--csv", "--json"]).status, Some(2));
    let huge = measurement("huge", "plane", &[on_slope(10.0, 10.0)], "reach = 1e6");
    let round = huge.replace("plane", "cylinder");
    refused(&format!("clouds = [\"slope.ply\"]\n{round}"), 1, "no curvature");
    let line = measurement("line", "circle", &[on_slope(0.0, 0.0), on_slope(1.0, 0.0), on_slope(2.0, 0.0)], "");
    refused(&format!("clouds = [\"slope.ply\"]\n{line}"), 1, "no curvature");
    assert_eq!(folder.glint(["measure", "slope.ply"]).status, Some(2));
}

/// Clicks the points of a measurement, one by one, and returns the event with its values.
fn measured(window: &Window, key: &str, at: &[[i32; 2]], end: &str) -> Value {
    let seen = window.events().len();
    window.press(key);
    window.wait_for_event("placing", seen, |_| true);
    for (index, at) in at.iter().enumerate() {
        let seen = window.events().len();
        window.click(1, *at);
        let corner = window.wait_for_event("corner", seen, |_| true);
        assert_eq!(corner["corners"], index + 1, "{corner}");
        // Too slow for a double-click.
        std::thread::sleep(std::time::Duration::from_millis(400));
    }
    if !end.is_empty() {
        window.press(end);
    }
    window.wait_for_event("measured", seen, |event| event["error"].is_null())
}

#[test]
fn every_tool_of_the_window_measures_a_scan_as_the_command_line_does_from_the_saved_scene() {
    let Some(data) = test_data() else { return };
    let scan = data.join("airborne/autzen_trim_las12_pf3.laz");
    let session = Session::start();
    let scan = scan.to_str().expect("text");
    let window = session.open(["view", scan, "--camera", "top", "--set", "light.by=headlight"]);
    window.wait_for_event("settled", 0, |_| true);
    let seen = window.events().len();
    window.wait_until_painted("settled", 0);
    // On the scan as it is seen from above, right of the panel.
    let places = [[680, 440], [720, 440], [700, 480], [660, 500], [690, 410]];
    let tools = [
        ("alt+1", 1, "", "point"),
        ("alt+2", 2, "", "distance"),
        ("alt+3", 4, "Return", "polyline"),
        ("alt+4", 2, "", "height"),
        ("alt+5", 3, "", "angle"),
        ("alt+6", 3, "Return", "area"),
        ("alt+7", 2, "Return", "plane"),
        ("alt+8", 3, "Return", "circle"),
        ("alt+0", 4, "Return", "volume"),
    ];
    let mut events = Vec::new();
    for (key, count, end, kind) in tools {
        let event = measured(&window, key, &places[..count], end);
        assert_eq!(event["kind"], kind, "{event}");
        events.push(event);
    }
    let (horizontal, vertical) = (events[1]["values"][1]["value"].as_f64(), events[1]["values"][2]["value"].as_f64());
    let distance = horizontal.expect("a number").hypot(vertical.expect("a number"));
    assert!((events[1]["values"][0]["value"].as_f64().expect("a number") - distance).abs() < 1e-9, "{}", events[1]);
    // The room of what is not a point.
    let gap = window.events().len();
    window.press("alt+2");
    window.click(1, [400, 100]);
    window.wait_for_event("gap", gap, |_| true);
    window.press("Escape");
    // A note, written at once, and gone to.
    let noted = window.events().len();
    window.press("shift+n");
    window.wait_for_event("placing", noted, |event| event["kind"] == "note");
    window.click(1, places[0]);
    window.wait_for_event("note", noted, |_| true);
    window.wait_until_painted("note", noted);
    window.type_text("a door");
    // Letters that come in the same frame as Escape are lost, as Escape takes the keyboard away first.
    window.wait_for_event("note_changed", noted, |event| event["text"] == "a door");
    window.press("Escape");
    window.press("period");
    window.wait_for_event("note_shown", noted, |event| event["text"] == "a door");
    let saved = window.save_scene_as();
    let outcome = session.folder.glint(["measure", &saved, "--json"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let report = outcome.json();
    for (index, event) in events.iter().enumerate() {
        let headless = &report["measurements"][index];
        assert_eq!((&headless["name"], &headless["kind"]), (&event["name"], &event["kind"]));
        for (own, other) in
            headless["values"].as_array().expect("values").iter().zip(event["values"].as_array().expect("values"))
        {
            assert_eq!(own["name"], other["name"]);
            for field in ["value", "uncertainty"] {
                let [own, other] = [own, other].map(|value| value[field].as_f64());
                let is_same = own.zip(other).map_or(own == other, |(a, b)| (a - b).abs() <= 1e-9 * a.abs().max(1.0));
                assert!(is_same, "{headless} is not {event}");
            }
        }
    }
    let text = std::fs::read_to_string(&saved).expect("the scene");
    assert!(text.contains("text = \"a door\""), "{text}");
    // Undo takes the note away, and says so.
    let undone = window.events().len();
    window.press("ctrl+z ctrl+z ctrl+z");
    window
        .wait_for_event("history", undone, |event| event["what"].as_str().is_some_and(|what| what.starts_with("note")));
    assert!(window.is_open() && seen <= undone, "{}", window.messages());
}

#[test]
fn a_mesh_is_measured_on_its_faces_as_the_window_shows_it() {
    let folder = Folder::new();
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    folder.write("square.ply", format!("{header}0 0 2\n10 0 2\n10 10 2\n0 10 2\n4 0 1 2 3\n"));
    let plane = measurement("plane", "plane", &["[5.0, 5.0, 2.0]".into()], "reach = 1.0");
    let points = "\"surface.mesh_points\" = 40000\n";
    folder.write("scene.toml", format!("clouds = [\"square.ply\"]\n{plane}[parameters]\n{points}"));
    let report = folder.glint(["measure", "scene.toml", "--json"]).json();
    // Even by area: of a hundred square units, those within one of the middle.
    let points = value(&report, "plane", "points").0;
    assert!((points / (400.0 * std::f64::consts::PI) - 1.0).abs() < 0.1, "{report}");
    let across = value(&report, "plane", "normal z").0.abs();
    assert!((across - 1.0).abs() < 1e-6 && value(&report, "plane", "rms").0 < 1e-5, "{report}");
}

#[test]
fn values_of_a_part_of_the_points_say_so_and_state_no_interval() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let name = "lone_star_las14_pf6.copc.laz";
    let file = data.join("copc").join(name);
    let corners = [[515_375.0, 4_918_350.0], [515_395.0, 4_918_350.0], [515_395.0, 4_918_370.0]];
    let corners = corners.map(|[x, y]| format!("[{x:?}, {y:?}, 2325.0]"));
    let write = |scene: &str, cloud: &str| {
        let volume = measurement("v", "volume", &corners, "level = 2300.0");
        folder.write(scene, format!("clouds = [\"{cloud}\"]\n{volume}"));
    };
    write("whole.toml", &file.display().to_string());
    let whole = folder.glint(["measure", "whole.toml", "--json"]);
    assert_eq!(whole.status, Some(0), "{whole}");
    let report = whole.json();
    assert_eq!((&report["whole"], &report["points_missing"]), (&true.into(), &0.into()));
    assert!(value(&report, "v", "volume").1.is_some() && value(&report, "v", "points").0 > 1000.0, "{report}");
    // The head, the list of nodes and some points come before the file goes.
    let of_part = |format: Option<&str>| {
        let served = folder.path(format.unwrap_or("text"));
        std::fs::create_dir(&served).expect("a folder");
        let own = served.join(name);
        std::fs::copy(&file, &own).expect("a copy");
        let server = Server::of_folder_after(&served, Habits::default(), move |request| {
            if request.number == 6 {
                let _ = std::fs::remove_file(&own);
            }
        });
        write("part.toml", &server.path(name).display().to_string());
        let mut command = folder.command(["measure", "part.toml"].into_iter().chain(format));
        let outcome = command.env("GLINT_SERVERS", &server.address).output().expect("the program starts");
        assert_eq!(outcome.status.code(), Some(2), "{outcome:?}");
        String::from_utf8(outcome.stdout).expect("text")
    };
    let report: Value = serde_json::from_str(&of_part(Some("--json"))).expect("JSON");
    assert!(report["whole"] == false && report["points_missing"].as_u64() > Some(1000), "{report}");
    assert!(value(&report, "v", "volume").1.is_none() && value(&report, "v", "loaded points").0 > 0.0, "{report}");
    let text = of_part(None);
    assert!(text.contains("values are of a part of the points: ") && !text.contains('±'), "{text}");
}
