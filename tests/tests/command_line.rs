//! The command line as scripts see it: exit status, output, files. Everything goes through the real program.

use std::path::Path;
use std::time::Duration;

use exr::prelude::read_first_flat_layer_from_file;
use serde_json::{Value, json};
use tests::{Folder, Outcome, test_data};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

/// Fewer points than the default: enough to close every surface at 160x120, sampled in a moment.
const FEW_POINTS: &str = "scene.points=100000";

/// A file that cannot be read, or only in part, gives its message in that time ...
const REFUSAL_TIME: Duration = Duration::from_secs(5);
/// ... and in that much memory, whatever its header claims.
const REFUSAL_MEMORY: u64 = 500_000_000;

/// A failure as scripts and people want it: its status, one or two lines that name what is wrong, no panic, no output.
fn assert_refused(outcome: &Outcome, status: i32, mentioned: &[&str]) {
    assert_eq!(outcome.status, Some(status), "{outcome}");
    let lines = outcome.messages.lines().filter(|line| !line.trim().is_empty()).count();
    assert!((1..=2).contains(&lines), "{lines} lines: {outcome}");
    assert!(!outcome.messages.contains("panicked"), "{outcome}");
    for word in mentioned {
        assert!(outcome.messages.contains(word), "`{word}` is not mentioned: {outcome}");
    }
}

fn assert_done(outcome: &Outcome) {
    assert_eq!(outcome.status, Some(0), "{outcome}");
}

/// `glint render ARGUMENTS` at 160x120 in direct light, into `picture.png`. None, with a note, where there is no
/// adapter to draw with and none is required.
fn render(folder: &Folder, arguments: &[&str]) -> Option<Outcome> {
    let common = ["render", "-o", "picture.png", "--size", "160x120", "--set", "gi.bounces=0"];
    let outcome = folder.glint(common.iter().chain(arguments));
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        println!("skipped: no adapter: {}", outcome.messages.trim());
        return None;
    }
    Some(outcome)
}

/// A float image: named channels, rows from the top.
struct FloatImage {
    channels: Vec<(String, Vec<f32>)>,
}

impl FloatImage {
    fn read(path: &Path) -> FloatImage {
        let image = read_first_flat_layer_from_file(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let size = image.layer_data.size;
        assert_eq!([size.width(), size.height()], [WIDTH, HEIGHT]);
        let channels = image.layer_data.channel_data.list.iter().map(|channel| {
            let samples = &channel.sample_data;
            assert!(matches!(samples, exr::prelude::FlatSamples::F32(_)), "{} is not full float", channel.name);
            (channel.name.to_string(), samples.values_as_f32().collect())
        });
        FloatImage { channels: channels.collect() }
    }

    /// The only value of a pixel.
    fn value(&self, [x, y]: [usize; 2]) -> f32 {
        self.channels[0].1[y * WIDTH + x]
    }

    /// The three values of a pixel, from channels named in either of the usual ways.
    fn vector(&self, [x, y]: [usize; 2]) -> [f32; 3] {
        [["R", "X"], ["G", "Y"], ["B", "Z"]].map(|names| {
            let channel =
                self.channels.iter().find(|(name, _)| names.iter().any(|wanted| name.eq_ignore_ascii_case(wanted)));
            let (_, values) = channel.unwrap_or_else(|| panic!("no channel {names:?}"));
            values[y * WIDTH + x]
        })
    }
}

fn assert_near(found: [f32; 3], expected: [f32; 3], tolerance: f32) {
    let near = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= tolerance);
    assert!(near, "found {found:?}, expected {expected:?} within {tolerance}");
}

#[test]
fn help_and_version_are_results() {
    let folder = Folder::new();
    let help = folder.glint(["--help"]);
    assert_done(&help);
    for command in ["info", "render", "record", "methods", "scenes", "surfaces", "doctor"] {
        assert!(help.text().contains(command), "{help}");
        assert_done(&folder.glint([command, "--help"]));
    }
    let version = folder.glint(["--version"]);
    assert_done(&version);
    assert!(version.text().starts_with("glint "), "{version}");
    let commit = std::process::Command::new("git").args(["rev-parse", "--short=12", "HEAD"]).output();
    // The tests may be run from an archive of the sources.
    if let Some(commit) = commit.ok().filter(|output| output.status.success()) {
        assert!(version.text().contains(String::from_utf8_lossy(&commit.stdout).trim()), "{version}");
    }
}

#[test]
fn without_a_display_the_viewer_names_render() {
    let folder = Folder::new();
    let cloud = folder.write("cloud.ply", THREE_POINTS);
    assert_refused(&folder.glint(["five-mirrors/sphere"]), 3, &["glint render"]);
    assert_refused(&folder.glint([&cloud]), 3, &["glint render"]);
    assert_refused(&folder.glint(["view", "five-mirrors/sphere"]), 3, &["glint render"]);
    assert_refused(&folder.glint([""; 0]), 3, &["glint render"]);
}

#[test]
fn bad_usage_is_refused_before_any_work() {
    let folder = Folder::new();
    let scene = "five-mirrors/sphere";
    assert_refused(&folder.glint(["info"]), 2, &[]);
    assert_refused(&folder.glint(["info", "--no-such-flag", "a.ply"]), 2, &["--no-such-flag"]);
    assert_refused(&folder.glint(["render", scene]), 2, &["--output"]);
    assert_refused(&folder.glint(["view", "--camera", "iso"]), 2, &["--camera", "name an input"]);
    let refused = |arguments: &[&str], mentioned: &[&str]| {
        let common = ["render", "-o", "picture.png"];
        assert_refused(&folder.glint(common.iter().chain(arguments)), 2, mentioned);
    };
    refused(&[scene, "--size", "large"], &["large"]);
    refused(&[scene, "--size", "0x600"], &["0x600"]);
    refused(&[scene, "--set", "splat.sise=2"], &["splat.sise", "splat.size"]);
    refused(&[scene, "--set", "splat.size=1e9"], &["splat.size", "1e9"]);
    refused(&[scene, "--set", "splat.size=NaN"], &["splat.size"]);
    refused(&[scene, "--method", "no_such_method"], &["no_such_method"]);
    refused(&[scene, "--aov", "no_such_image=a.exr"], &["no_such_image"]);
    refused(&[scene, "--camera", "no-such-view.toml"], &["no-such-view.toml"]);
    refused(&["five-mirrors/teapot"], &["five-mirrors/teapot"]);
    refused(&[scene, "--bounces", "9"], &["--bounces", "0 to 8"]);
    refused(&["no-such-file.laz"], &["no-such-file.laz"]);
    refused(&["."], &[]);
    assert!(!folder.path("picture.png").exists());
}

#[test]
fn an_output_that_cannot_be_written_is_a_failure_of_the_work() {
    let folder = Folder::new();
    let picture = "no-such-folder/picture.png";
    let arguments = ["render", "five-mirrors/sphere", "--set", FEW_POINTS, "--size", "160x120", "-o", picture];
    assert_refused(&folder.glint(arguments), 1, &[picture]);
    let aov = "depth=no-such-folder/depth.exr";
    if let Some(outcome) = render(&folder, &["five-mirrors/sphere", "--set", FEW_POINTS, "--aov", aov]) {
        assert_refused(&outcome, 1, &["no-such-folder/depth.exr"]);
    }
}

#[test]
fn a_picture_by_class_stays_one_where_hidden_classes_leave_one() {
    let folder = Folder::new();
    let point = |at: usize| format!("{} {} {} {}\n", at % 10, at / 10, at % 7, [1, 2, 9][at % 3]);
    let points: String = (0..90).map(point).collect();
    let header = "ply\nformat ascii 1.0\nelement vertex 90\nproperty float x\nproperty float y\nproperty float z\n";
    folder.write("kinds.ply", format!("{header}property uchar classification\nend_header\n{points}"));
    folder.write("ground.toml", "clouds = [\"kinds.ply\"]\n[visibility]\nhidden_classes = [1, 9]\n");
    let Some(outcome) = render(&folder, &["ground.toml", "--set", "color.by=class"]) else { return };
    assert_done(&outcome);
    assert!(!outcome.messages.contains("classification"), "{outcome}");
}

const THREE_POINTS: &str = "ply
format ascii 1.0
element vertex 3
property double x
property double y
property double z
property uchar red
property uchar green
property uchar blue
end_header
2500000.125 1200000.25 100.5 255 0 0
2500001.125 1200000.25 100.5 0 255 0
2500000.125 1200001.25 101.5 0 0 255
";

#[test]
fn info_lists_columns_of_the_same_name_each_with_its_values_and_a_name() {
    let folder = Folder::new();
    let columns = "property float x\nproperty float y\nproperty float z\nproperty uchar q\nproperty short q\n";
    let rows = "0 0 0 1 -5\n1 2 3 2 -6\n";
    folder.write("two.ply", format!("ply\nformat ascii 1.0\nelement vertex 2\n{columns}end_header\n{rows}"));
    let outcome = folder.glint(["info", "--json", "two.ply"]);
    let info = &outcome.json()["inputs"][0];
    let all =
        info["attributes"].as_array().into_iter().flatten().filter(|each| each["name"] == "q" || each["name"] == "q_2");
    let found: Vec<_> = all.map(|each| json!([each["type"], each["min"], each["max"]])).collect();
    assert_eq!(found, [json!(["u8", 1.0, 2.0]), json!(["i16", -6.0, -5.0])], "{outcome}");
    let text = folder.glint(["info", "two.ply"]);
    assert!(text.text().contains("x f32, y f32, z f32, q u8, q_2 i16\n"), "{text}");
}

#[test]
fn info_tells_what_a_file_holds_in_full_precision() {
    let folder = Folder::new();
    folder.write("cloud.ply", THREE_POINTS);
    for options in [&["--json"][..], &["--json", "--scan"]] {
        let outcome = folder.glint(["info", "cloud.ply"].iter().chain(options));
        assert_done(&outcome);
        let info = &outcome.json()["inputs"][0];
        assert_eq!(info["path"], "cloud.ply");
        assert_eq!(info["format"], "ply");
        assert_eq!(info["points"], 3);
        assert_eq!(info["crs"], Value::Null);
        assert_eq!(info["warnings"], json!([]));
        let names: Vec<_> = info["attributes"].as_array().into_iter().flatten().map(|each| &each["name"]).collect();
        assert_eq!(names, ["x", "y", "z", "red", "green", "blue"]);
        assert!(info["attributes"].as_array().into_iter().flatten().all(|each| each["type"].is_string()), "{outcome}");
        for key in ["version", "point_format", "bounds"] {
            assert!(info.get(key).is_some(), "no {key}: {outcome}");
        }
        if options.contains(&"--scan") {
            let bounds = json!({"min": [2500000.125, 1200000.25, 100.5], "max": [2500001.125, 1200001.25, 101.5]});
            assert_eq!(info["bounds"], bounds);
        }
    }
    let marked = THREE_POINTS.replace("end_header", "property uchar mark\nend_header");
    let marked = marked.replace(" 0 0\n", " 0 0 7\n").replace(" 255 0\n", " 255 0 7\n").replace(" 255\n", " 255 7\n");
    folder.write("marked.ply", marked);
    let text = folder.glint(["info", "marked.ply"]);
    assert!(text.text().contains("blue u8, mark u8 (7 everywhere)"), "{text}");
    let text = folder.glint(["info", "--scan", "cloud.ply"]);
    assert_done(&text);
    assert!(text.text().contains("cloud.ply") && text.text().contains("2500000.125"), "{text}");
}

#[test]
fn a_bad_input_is_reported_in_its_place_and_the_others_still_are() {
    let folder = Folder::new();
    folder.write("good.ply", THREE_POINTS);
    folder.write("bad.las", "this is no point cloud");
    let outcome = folder.glint(["info", "--json", "bad.las", "good.ply", "absent.laz"]);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    let inputs = &outcome.json()["inputs"];
    for (place, path) in [(0, "bad.las"), (2, "absent.laz")] {
        assert_eq!(inputs[place]["path"], path);
        assert!(inputs[place]["error"].as_str().is_some_and(|error| !error.is_empty()), "{outcome}");
        assert_eq!(inputs[place].get("points"), None);
    }
    assert_eq!(inputs[1]["points"], 3);
    assert_eq!(inputs.as_array().map(Vec::len), Some(3));
    let text = folder.glint(["info", "bad.las", "good.ply"]);
    assert_refused(&text, 2, &["bad.las"]);
    assert!(text.text().contains("good.ply"), "{text}");
}

#[test]
fn a_scene_file_counts_for_what_is_there_of_it() {
    let folder = Folder::new();
    folder.write("good.ply", THREE_POINTS);
    folder.write("scene.toml", "clouds = [\"gone.ply\", \"good.ply\"]\n[parameters]\n\"splat.nope\" = 1\n");
    folder.write("none.toml", "clouds = []\n");
    let outcome = folder.glint(["info", "--json", "scene.toml", "none.toml"]);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    let inputs = &outcome.json()["inputs"];
    assert!(inputs[0]["error"].as_str().is_some_and(|error| error.contains("gone.ply")), "{outcome}");
    assert_eq!(inputs[1]["points"], 3);
    assert!(inputs[2]["error"].as_str().is_some_and(|error| error.contains("no clouds")), "{outcome}");
    assert!(outcome.messages.contains("splat.nope"), "{outcome}");
    if let Some(rendered) = render(&folder, &["good.ply", "absent.laz"]) {
        assert_refused(&rendered, 2, &["absent.laz"]);
        assert!(folder.path("picture.png").exists(), "{rendered}");
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_is_refused_instead_of_waited_for() {
    let folder = Folder::new();
    let pipe = folder.path("points.ply");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.is_ok_and(|status| status.success()));
    let outcome = folder.glint_within(REFUSAL_TIME, ["info", "points.ply"]);
    assert_refused(&outcome, 2, &["points.ply", "not a regular file"]);
}

/// A row of the data folder's README.md: what an independent reader found in a file.
struct ManifestRow {
    path: String,
    format: String,
    points: u64,
    bounds: Option<[[String; 3]; 2]>,
    attributes: Vec<String>,
}

/// The point clouds outside `malformed` and `e57`.
fn manifest(data: &Path) -> Vec<ManifestRow> {
    let text = std::fs::read_to_string(data.join("README.md")).expect("the data folder's manifest");
    let mut rows = Vec::new();
    let mut section = "";
    for line in text.lines() {
        section = line.strip_prefix("## ").unwrap_or(section);
        let cells: Vec<&str> = line.split(" | ").map(|cell| cell.trim_matches(['|', ' ', '`'])).collect();
        let is_file = line.starts_with("| `") && cells.len() >= 9;
        if !is_file || ["malformed", "e57"].contains(&section) {
            continue;
        }
        let first_number = cells[5].split(|character: char| !character.is_ascii_digit()).next();
        let corners: Vec<[String; 3]> = cells[6]
            .split(") to (")
            .filter_map(|corner| {
                let coordinates = corner.trim_matches(['(', ')']).split(", ").map(str::to_owned);
                coordinates.collect::<Vec<_>>().try_into().ok()
            })
            .collect();
        // PLY: `x:f4, y:f4; face: ...`; LAS: `...; extra: Deviation, confidence; ...`.
        let ply = cells[4].starts_with("PLY");
        let mut groups = cells[7].split("; ");
        let group = if ply { groups.next() } else { groups.find_map(|group| group.strip_prefix("extra: ")) };
        let names = group.into_iter().flat_map(|group| group.split(", "));
        let names = names.filter_map(|name| if ply { name.split_once(':').map(|(name, _)| name) } else { Some(name) });
        rows.push(ManifestRow {
            path: format!("{section}/{}", cells[0]),
            format: cells[4].to_owned(),
            points: first_number.and_then(|number| number.parse().ok()).expect("a count"),
            bounds: corners.try_into().ok(),
            attributes: names.map(str::to_owned).collect(),
        });
    }
    rows
}

/// Within half of the last decimal that the manifest prints.
fn is_rounded_to(value: f64, printed: &str) -> bool {
    let expected: f64 = printed.parse().expect("a number");
    let half = if printed.contains('e') {
        // Seven digits.
        expected.abs() * 5e-7
    } else {
        // Three decimals, less where zeros were dropped; 32-bit floats were rounded twice, -0.0645 to -0.065.
        0.51e-3
    };
    (value - expected).abs() <= half + expected.abs() * 1e-12
}

/// What is wrong with the report on a file, in words.
fn differences(row: &ManifestRow, info: &Value) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut expect = |what: &str, right: bool, found: &Value| {
        if !right {
            wrong.push(format!("{}: {what}: {found}", row.path));
        }
    };
    let format = &info["format"];
    let words: Vec<&str> = row.format.split(' ').collect();
    // A COPC file is a LAZ file.
    let expected_format = words[0].replace("COPC", "LAZ").to_lowercase();
    expect("format", *format == expected_format, format);
    let version = info["version"].as_str().unwrap_or_default();
    expect("version", version.starts_with(words[1]), &info["version"]);
    if let Some(point_format) = words.get(2).and_then(|word| word.strip_prefix("PF")) {
        expect(
            "point format",
            point_format.parse() == Ok(info["point_format"].as_u64().unwrap_or(u64::MAX)),
            &info["point_format"],
        );
    }
    expect("points", info["points"] == row.points, &info["points"]);
    for (corner, key) in row.bounds.iter().flatten().zip(["min", "max"]) {
        let found = &info["bounds"][key];
        let near = |axis: usize| found[axis].as_f64().is_some_and(|value| is_rounded_to(value, &corner[axis]));
        expect(&format!("{key}, {corner:?} expected"), (0..3).all(near), found);
    }
    let found: Vec<&str> =
        info["attributes"].as_array().into_iter().flatten().filter_map(|each| each["name"].as_str()).collect();
    for name in &row.attributes {
        // An extra dimension of two or three values is an attribute for each.
        let is_there = found.contains(&name.as_str()) || found.contains(&format!("{name}[0]").as_str());
        // `ExtraBytes` is the reference reader's word for bytes that it found no description of.
        expect(&format!("no attribute {name}"), is_there || name == "ExtraBytes", &info["attributes"]);
    }
    wrong
}

/// Larger files are read whole beside the same manifest by crates/codec/tests/manifest.rs; what `--scan` looks for between
/// the neighbours of their points takes far longer.
#[test]
fn info_agrees_with_independent_readers_on_every_file_of_up_to_half_a_million_points() {
    let Some(data) = test_data() else { return };
    let mut rows = manifest(&data);
    rows.retain(|row| row.points <= 500_000);
    assert!(rows.len() > 65, "only {} rows of the manifest were understood", rows.len());
    let folder = Folder::new();
    let paths = rows.iter().map(|row| data.join(&row.path).into_os_string());
    let outcome = folder.glint(["info", "--json", "--scan"].iter().map(Into::into).chain(paths));
    assert_done(&outcome);
    let report = outcome.json();
    let wrong: Vec<String> =
        rows.iter().enumerate().flat_map(|(index, row)| differences(row, &report["inputs"][index])).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn every_malformed_file_gives_an_error_or_what_can_be_read() {
    let Some(data) = test_data() else { return };
    // Files that hold what can be read entirely, or to a known number of points.
    let readable = [
        ("las_truncated_points.las", 1064),
        ("las_bad_vlr_count.las", 10),
        ("las_bad_geotiff_keys.las", 10),
        ("las_points_header_spurious_bounds.las", 1065),
        // 227 bytes of header and 34 bytes a point: what the file has room for.
        ("las_claims_4294967295_points.las", 100),
        ("laz_truncated_good_original.laz", 64572),
        // 27 bytes a vertex, behind the header.
        ("ply_claims_2e9_vertices.ply", 10201),
    ];
    let complete = ["las_points_header_spurious_bounds.las", "laz_truncated_good_original.laz"];
    let folder = Folder::new();
    let files = std::fs::read_dir(data.join("malformed")).expect("a folder of the manifest");
    for file in files.map(|entry| entry.expect("an entry").path()) {
        let name = file.file_name().and_then(|name| name.to_str()).expect("a plain name").to_owned();
        for scan in [None, Some("--scan")] {
            let words = ["info", "--json"].into_iter().chain(scan).map(Path::new);
            let outcome = folder.glint_within(REFUSAL_TIME, words.chain([file.as_path()]));
            assert!(outcome.peak_memory < REFUSAL_MEMORY, "{} bytes: {outcome}", outcome.peak_memory);
            assert!(!outcome.messages.contains("panicked"), "{outcome}");
            let info = &outcome.json()["inputs"][0];
            let warnings = info["warnings"].as_array().map_or(0, Vec::len);
            match info["error"].as_str() {
                Some(error) => {
                    assert_eq!(outcome.status, Some(2), "{outcome}");
                    assert!(!error.is_empty(), "{outcome}");
                }
                None => {
                    assert_eq!(outcome.status, Some(0), "{outcome}");
                    assert!(
                        warnings > 0 || complete.contains(&name.as_str()) || name == "las_bad_geotiff_keys.las",
                        "no warning: {outcome}"
                    );
                }
            }
            if let Some((_, points)) = readable.iter().find(|(readable, _)| *readable == name) {
                assert_eq!(info["points"], *points, "{outcome}");
            }
        }
    }
}

#[test]
fn the_same_cloud_in_four_formats_is_the_same_cloud() {
    let Some(data) = test_data() else { return };
    let names = ["ripple.las", "ripple.laz", "ripple_ascii.ply", "ripple_bin.ply"];
    let paths = names.map(|name| data.join("same_cloud_four_files").join(name));
    let outcome = Folder::new().glint(["info", "--json", "--scan"].map(Into::into).iter().chain(&paths));
    assert_done(&outcome);
    let report = outcome.json();
    for file in report["inputs"].as_array().into_iter().flatten() {
        assert_eq!(file["points"], 10201);
        for corner in ["min", "max"] {
            for axis in 0..3 {
                let found = file["bounds"][corner][axis].as_f64().expect("a coordinate");
                let expected = report["inputs"][0]["bounds"][corner][axis].as_f64().expect("a coordinate");
                // The LAS files have a grid of 0.01, half of which is lost in rounding.
                assert!((found - expected).abs() <= 0.0051, "{}: {found}, expected {expected}", file["path"]);
            }
        }
    }
}

/// Every string in a JSON value, at any depth.
fn strings(value: &Value) -> Vec<&str> {
    match value {
        Value::String(text) => vec![text],
        Value::Array(values) => values.iter().flat_map(strings).collect(),
        Value::Object(values) => values.values().flat_map(strings).collect(),
        _ => Vec::new(),
    }
}

#[test]
fn methods_lists_every_parameter_with_its_key_unit_range_default_and_help() {
    let folder = Folder::new();
    let outcome = folder.glint(["methods", "--json"]);
    assert_done(&outcome);
    let report = outcome.json();
    let methods = strings(&report["methods"]);
    for method in ["auto", "none", "environment_map", "mirrored_viewpoint", "sscr", "sscr_hierarchical", "surfel_trace"]
    {
        assert!(methods.contains(&method), "{method}: {outcome}");
    }
    let parameters = report["parameters"].as_array().expect("an array");
    for parameter in parameters {
        for key in ["key", "unit", "range", "default", "help"] {
            assert!(parameter.get(key).is_some(), "no {key}: {parameter}");
        }
        assert!(parameter["help"].as_str().is_some_and(|help| !help.is_empty()), "{parameter}");
    }
    assert!(parameters.iter().any(|parameter| parameter["key"] == "splat.size"), "{outcome}");
    let text = folder.glint(["methods"]);
    assert_done(&text);
    for parameter in parameters {
        let key = parameter["key"].as_str().expect("text");
        assert!(text.text().contains(key), "{key} is not in the table");
    }
}

#[test]
fn scenes_lists_the_five_mirrors_and_the_made_scans() {
    let folder = Folder::new();
    let (outcome, text) = (folder.glint(["scenes", "--json"]), folder.glint(["scenes"]));
    assert_done(&outcome);
    assert_done(&text);
    let report = outcome.json();
    for mirror in ["none", "sphere", "parabolic", "blob", "torus", "coral", "all", "bunny", "bowl", "open-box"] {
        let name = format!("five-mirrors/{mirror}");
        assert!(strings(&report).contains(&name.as_str()), "{name}: {outcome}");
        assert!(text.text().contains(&name), "{name}: {text}");
    }
    for scan in ["even", "room", "mixed", "four", "hall", "hall-30", "hall-40", "street", "church"] {
        let name = format!("tripod/{scan}");
        assert!(strings(&report).contains(&name.as_str()) && text.text().contains(&name), "{name}: {text}");
    }
}

#[test]
fn surfaces_judges_made_scans_by_their_exact_surfaces() {
    let folder = Folder::new();
    let arguments = ["surfaces", "tripod/room", "tripod/hall-40", "--set", "scene.points=5000"];
    let outcome = folder.glint(arguments.iter().chain(&["--json"]));
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        return println!("skipped: no adapter: {}", outcome.messages.trim());
    }
    assert_done(&outcome);
    let report = outcome.json();
    for (index, (name, stations)) in [("tripod/room", 1), ("tripod/hall-40", 2)].into_iter().enumerate() {
        let input = &report["inputs"][index];
        assert_eq!((&input["path"], &input["scanner_from"]), (&json!(name), &json!("file")));
        assert_eq!(input["scanners"].as_array().expect("places").len(), stations);
        for group in ["camera", "mirrors"] {
            let number = |key: &str| input["exact"][group][key].as_f64().expect("a number");
            let all: f64 = ["right", "in_front", "behind", "empty"].map(number).iter().sum();
            assert!((all - 1.0).abs() < 1e-9 && number("pixels") > 8000.0 && number("unscanned") > 50.0, "{input}");
        }
        assert_intervals(input);
        assert!(input["picture_held"].as_f64().is_some_and(|held| (0.5..=1.0).contains(&held)), "{input}");
    }
    let text = folder.glint(arguments);
    assert_done(&text);
    assert!(text.text().contains("unscanned") && text.text().contains("tripod/hall-40"), "{text}");
    assert!(text.text().contains("stated error") && text.text().contains("incidence 30"), "{text}");
}

/// The stated intervals of an input of `glint surfaces --json`: all sightlines within first, then bins of distance, of
/// incidence and of spacing, which have as many.
fn assert_intervals(input: &Value) {
    let intervals = input["intervals"].as_array().expect("intervals");
    let rays = |kind: &str| {
        let of_kind = intervals.iter().filter(|bin| bin["bin"].as_str().is_some_and(|name| name.starts_with(kind)));
        of_kind.map(|bin| bin["rays"].as_u64().expect("a number")).sum::<u64>()
    };
    assert!(intervals[0]["bin"] == "all" && rays("all") > 100, "{input}");
    assert_eq!([rays("distance"), rays("incidence"), rays("spacing")], [rays("all"); 3], "{input}");
    for bin in intervals {
        assert_eq!(bin["stated"], 0.95, "{bin}");
        assert!(bin["held"].as_f64().is_some_and(|held| (0.0..=1.0).contains(&held)), "{bin}");
        assert!(bin["half_width"].as_f64().is_some_and(|width| width > 0.0), "{bin}");
    }
}

#[test]
fn doctor_names_the_adapter_that_render_uses() {
    let folder = Folder::new();
    let scene = ["five-mirrors/none", "--set", FEW_POINTS, "--stats", "stats.json"];
    let Some(outcome) = render(&folder, &scene) else { return };
    assert_done(&outcome);
    let doctor = folder.glint(["doctor", "--json"]);
    assert_done(&doctor);
    let report = doctor.json();
    let used = stats(&folder)["adapter"]["name"].as_str().expect("text").to_owned();
    assert!(strings(&report).iter().any(|text| text.contains(&used)), "{used} is not in {doctor}");
    let adapters = report["adapters"].as_array().expect("a list");
    let chosen = adapters.iter().find(|adapter| adapter["chosen"] == true).expect("the one that is used");
    let needs = chosen["needs"].as_array().expect("what passes need");
    assert!(needs.len() > 5 && needs.iter().all(|need| need["has"].as_u64() >= need["least"].as_u64()), "{chosen}");
    let text = folder.glint(["doctor"]);
    assert_done(&text);
    assert!(text.text().contains(&used), "{text}");
}

#[test]
fn doctor_says_of_an_adapter_that_lacks_something_that_it_cannot_be_used() {
    let folder = Folder::new();
    let acting = |arguments: &[&str]| {
        let mut command = folder.command(arguments);
        let output = command.env("GLINT_ACT_LIKE", "few-buffers").output().expect("the program starts");
        let [text, messages] = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        (output.status.code(), text, messages)
    };
    let (status, report, _) = acting(&["doctor", "--json"]);
    assert_eq!(status, Some(0), "{report}");
    let report: Value = serde_json::from_str(&report).expect("JSON");
    let adapters = report["adapters"].as_array().expect("a list");
    assert!(adapters.iter().all(|adapter| adapter["chosen"] == false), "{report}");
    assert_eq!(report["can_open_window"], false, "{report}");
    let (_, text, _) = acting(&["doctor"]);
    assert!(!text.contains("will be used"), "{text}");
    if adapters.is_empty() {
        return;
    }
    assert!(text.contains("No adapter can be used."), "{text}");
    assert!(text.contains("cannot be used: it has 4 storage buffers in a shader where 8 are needed"), "{text}");
    let (status, _, messages) = acting(&["render", "five-mirrors/none", "--set", FEW_POINTS, "-o", "none.png"]);
    assert!(status != Some(0) && messages.contains("it has 4 storage buffers"), "{status:?}: {messages}");
}

fn stats(folder: &Folder) -> Value {
    let text = std::fs::read_to_string(folder.path("stats.json")).expect("the statistics");
    serde_json::from_str(&text).expect("JSON")
}

/// Pixels of five-mirrors/sphere from its own camera, at (0, 0, 1.9) with 60 degrees of view: the middle, where the sphere
/// is nearest; between sphere and walls, where the back wall is seen; beside both.
const ON_SPHERE: [usize; 2] = [80, 60];
const ON_BACK_WALL: [usize; 2] = [104, 36];
const ON_LEFT_WALL: [usize; 2] = [2, 60];

#[test]
fn the_images_of_five_mirrors_are_where_its_definition_puts_them() {
    let folder = Folder::new();
    let names = ["depth", "position", "normal", "albedo", "mirror"];
    let wanted = names.map(|name| format!("{name}={name}.exr"));
    let wanted = wanted.iter().flat_map(|image| ["--aov", image]);
    let scene: Vec<&str> = ["five-mirrors/sphere", "--set", FEW_POINTS].into_iter().chain(wanted).collect();
    let Some(outcome) = render(&folder, &scene) else { return };
    assert_done(&outcome);
    let [depth, position, normal, albedo, mirror] =
        names.map(|name| FloatImage::read(&folder.path(&format!("{name}.exr"))));

    // Splats are flat disks, some 0.009 in radius: a curved surface is met that much too late or too soon.
    let tolerance = 0.01;
    for (pixel, expected) in [(ON_BACK_WALL, 3.9), (ON_SPHERE, 1.47), (ON_LEFT_WALL, 1.0 / ray_slope(ON_LEFT_WALL[0]))]
    {
        let found = depth.value(pixel);
        // A splat at a grazing angle covers its pixel from up to a pixel away.
        let pixel_step = if pixel == ON_LEFT_WALL { 0.02 } else { 0.0 };
        assert!((found - expected).abs() < tolerance + pixel_step, "depth at {pixel:?}: {found}, expected {expected}");
    }
    assert_near(position.vector(ON_SPHERE), [0.0, 0.0, 0.43], tolerance);
    assert!((position.vector(ON_BACK_WALL)[2] + 2.0).abs() < tolerance, "{:?}", position.vector(ON_BACK_WALL));
    assert!((position.vector(ON_LEFT_WALL)[0] + 1.0).abs() < tolerance, "{:?}", position.vector(ON_LEFT_WALL));

    assert_near(normal.vector(ON_BACK_WALL), [0.0, 0.0, 1.0], 0.02);
    assert_near(normal.vector(ON_LEFT_WALL), [1.0, 0.0, 0.0], 0.02);
    assert_near(normal.vector(ON_SPHERE), [0.0, 0.0, 1.0], 0.05);

    // Linear RGB. Colours kept as 8-bit sRGB are off by half a step, 0.004 at this brightness.
    assert_near(albedo.vector(ON_LEFT_WALL), [0.63, 0.065, 0.05], 0.005);
    assert_near(albedo.vector(ON_BACK_WALL), [0.725, 0.71, 0.68], 0.005);

    assert_eq!([ON_SPHERE, ON_BACK_WALL, ON_LEFT_WALL].map(|pixel| mirror.value(pixel)), [1.0, 0.0, 0.0]);
    // The sphere's outline: a disk of tan(asin(0.43 / 1.9)) / tan(30 degrees) half picture heights; splats add up to half
    // a pixel to its radius of 24.1.
    let outline = std::f64::consts::PI * 24.1_f64.powi(2);
    let mirrors = mirror.channels[0].1.iter().filter(|value| **value == 1.0).count() as f64;
    assert!((mirrors / outline - 1.0).abs() < 0.08, "{mirrors} mirror pixels, expected {outline:.0}");
}

/// How far to the left the eye ray of a column's centre goes per unit of depth.
fn ray_slope(column: usize) -> f32 {
    let half_height = HEIGHT as f32 / 2.0;
    let from_middle = WIDTH as f32 / 2.0 - (column as f32 + 0.5);
    from_middle / half_height * 30_f32.to_radians().tan()
}

#[test]
fn a_picture_is_what_size_asks_for_and_the_same_again() {
    let folder = Folder::new();
    // The seed decides where virtual lights lie.
    let light = ["--set", "gi.bounces=1", "--set", "gi.vpls=16"];
    let scene = [&["five-mirrors/sphere", "--set", FEW_POINTS, "--seed", "7"][..], &light].concat();
    let picture = || Some(std::fs::read(folder.path("picture.png")).expect("the picture"));
    let Some(outcome) = render(&folder, &scene) else { return };
    assert_done(&outcome);
    let first = picture();
    let decoded = image::open(folder.path("picture.png")).expect("a PNG").into_rgba8();
    assert_eq!(decoded.dimensions(), (WIDTH as u32, HEIGHT as u32));
    assert!(tests::colors(&decoded) > 100, "a plain picture");
    let Some(outcome) = render(&folder, &scene) else { return };
    assert_done(&outcome);
    assert!(picture() == first, "the same seed gave another picture");
}

#[test]
fn the_statistics_tell_adapter_passes_counts_and_memory() {
    let folder = Folder::new();
    let scene =
        ["five-mirrors/sphere", "--set", FEW_POINTS, "--frames", "3", "--stats", "stats.json", "--bounces", "1"];
    let Some(outcome) = render(&folder, &scene) else { return };
    assert_done(&outcome);
    let stats = stats(&folder);
    for key in ["name", "backend", "kind"] {
        assert!(stats["adapter"][key].as_str().is_some_and(|text| !text.is_empty()), "adapter.{key}: {stats}");
    }
    assert_eq!(stats["size"], json!([WIDTH, HEIGHT]));
    assert_eq!(stats["method"], "auto");
    let key_and_value: Vec<&str> = FEW_POINTS.split('=').collect();
    assert_eq!(stats["set"][key_and_value[0]].to_string().trim_matches('"'), key_and_value[1]);
    // Rounded up to whole points a surface.
    let points = stats["points"]["scene"].as_f64().expect("a number");
    assert!((points / 100_000.0 - 1.0).abs() < 0.01, "{points} points");
    assert!(stats["points"]["drawn"].as_f64().is_some_and(|drawn| 0.0 < drawn && drawn <= points), "{stats}");
    let passes = stats["passes"].as_array().expect("an array");
    assert!(!passes.is_empty());
    for pass in passes {
        assert!(pass["name"].as_str().is_some_and(|name| !name.is_empty()), "{pass}");
        assert!(["surface", "method", "light", "view"].iter().any(|stage| pass["stage"] == *stage), "{pass}");
        assert!(pass["ms"].as_f64().is_some_and(|time| time >= 0.0), "{pass}");
    }
    assert!(stats["frame_ms"].as_f64().is_some_and(|time| time > 0.0), "{stats}");
    assert!(stats["clock"] == "gpu" || stats["clock"] == "host", "{stats}");
    assert!(stats["mirror_pixels"].as_u64().is_some_and(|pixels| pixels > 1000), "{stats}");
    for key in ["gpu_bytes", "host_peak_bytes"] {
        assert!(stats["memory"][key].as_u64().is_some_and(|bytes| bytes > 0), "memory.{key}: {stats}");
    }
    for key in ["coverage", "closed_coverage", "hit_rate", "regions", "bounces", "accuracy"] {
        assert!(stats.get(key).is_some(), "no {key}: {stats}");
    }
}

#[test]
fn empty_pixels_are_not_a_number() {
    let folder = Folder::new();
    folder.write("cloud.ply", THREE_POINTS);
    let arguments = ["cloud.ply", "--aov", "depth=depth.exr", "--aov", "position=position.exr"];
    let Some(outcome) = render(&folder, &arguments) else { return };
    assert_done(&outcome);
    let [depth, position] = ["depth.exr", "position.exr"].map(|name| FloatImage::read(&folder.path(name)));
    let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| [x, y]));
    let (full, empty): (Vec<_>, Vec<_>) = pixels.partition(|pixel| depth.value(*pixel).is_finite());
    assert!(!full.is_empty() && !empty.is_empty(), "{} full pixels, {} empty ones", full.len(), empty.len());
    assert!(
        empty.iter().all(|pixel| depth.value(*pixel).is_nan() && position.vector(*pixel).iter().all(|x| x.is_nan()))
    );
    // World coordinates of seven digits are relative to a place that the file names.
    let file = read_first_flat_layer_from_file(folder.path("position.exr")).expect("a float image");
    let origin = file.layer_data.attributes.other.get(&exr::prelude::Text::from("origin"));
    let Some(exr::prelude::AttributeValue::Text(origin)) = origin else { panic!("no origin: {origin:?}") };
    let origin: Vec<f64> = origin.to_string().split(' ').map(|part| part.parse().expect("a number")).collect();
    for pixel in full {
        let near = position.vector(pixel).map(f64::from);
        let [x, y, z] = [0, 1, 2].map(|axis| origin[axis] + near[axis]);
        let inside = (2499998.0..=2500003.5).contains(&x) && (1199998.0..=1200003.5).contains(&y);
        assert!(inside && (99.0..=103.0).contains(&z), "{pixel:?} is at {:?}", [x, y, z]);
    }
}

/// A floor and a wall in squares of two colours, and a mirror ball before them, times a size.
fn room_with_ball(folder: &Folder, size: f64) -> String {
    let square = |a: i32, b: i32| if (a / 15 + b / 15) % 2 == 0 { "230 40 30" } else { "40 60 210" };
    let points = (0..120).flat_map(|i| (0..120).map(move |j| (i, j))).flat_map(|(i, j)| {
        let [a, b] = [i, j].map(|index| f64::from(index) / 30.0 * size);
        [format!("{a:e} {b:e} 0 {}\n", square(i, j)), format!("{a:e} {:e} {b:e} {}\n", 4.0 * size, square(i, j + 15))]
    });
    let header = "ply\nformat ascii 1.0\nelement vertex 28800\nproperty double x\nproperty double y\nproperty double z\n\
                  property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    folder.write(&format!("{size:e}.ply"), header.to_owned() + &points.collect::<String>());
    let place = |place: [f64; 3]| format!("{:?}", place.map(|length| length * size));
    let (eye, pivot, ball) = (place([1.0, -1.0, 3.0]), place([2.0, 3.0, 1.0]), place([2.0, 2.5, 1.0]));
    let scene = format!(
        "clouds = ['{size:e}.ply']\n[camera]\neye = {eye}\npivot = {pivot}\nup = [0.0, 0.0, 1.0]\n[[mirrors]]\n\
         shape = 'sphere'\nposition = {ball}\nsize = {:?}\n",
        0.8 * size
    );
    let name = format!("{size:e}.toml");
    folder.write(&name, scene);
    name
}

#[test]
fn a_scene_of_a_millionth_of_the_size_looks_the_same() {
    let folder = Folder::new();
    let mut pictures = Vec::new();
    for size in [1.0, 1e-6] {
        let Some(outcome) = render(&folder, &[&room_with_ball(&folder, size)]) else { return };
        assert_done(&outcome);
        pictures.push(image::open(folder.path("picture.png")).expect("the picture").into_rgb8());
    }
    let pixels = pictures[0].pixels().zip(pictures[1].pixels());
    let differing = pixels.filter(|(a, b)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 16)).count();
    // So small, radii are off by up to a tenth, which shows where squares meet.
    assert!(differing * 20 < WIDTH * HEIGHT, "{differing} pixels differ");
}

#[test]
fn light_that_is_missing_or_brighter_than_images_hold_is_told() {
    let folder = Folder::new();
    folder.write("cloud.ply", THREE_POINTS);
    let by_lights = ["cloud.ply", "--set", "light.by=lights", "--set", "color.by=plain"];
    let Some(outcome) = render(&folder, &by_lights) else { return };
    assert_done(&outcome);
    assert!(outcome.messages.contains("light.by = lights: the scene has no light"), "{outcome}");
    for (intensity, is_cut) in [("1e9", true), ("1", false)] {
        let lamp =
            format!("intensity = [{intensity}, {intensity}, {intensity}]\ninner_degrees = 60\nouter_degrees = 70");
        let place = "[[lights]]\nposition = [2500001.0, 1200001.0, 120.0]\ntarget = [2500001.0, 1200001.0, 100.0]";
        folder.write("lit.toml", format!("clouds = ['cloud.ply']\n{place}\n{lamp}\n"));
        let outcome =
            render(&folder, &["lit.toml", "--set", "light.by=lights", "--aov", "direct=a.exr"]).expect("a picture");
        assert_done(&outcome);
        assert!(!outcome.messages.contains("has no light"), "{outcome}");
        assert_eq!(outcome.messages.contains("--aov: direct ends at 65504"), is_cut, "{outcome}");
    }
}

/// A box whose mirror has moved to the left wall, a ball beside it and a lamp, and a puddle: points of the floor.
const FURNISHED: &str = "
clouds = ['five-mirrors/sphere']
[[mirrors]]
name = 'sphere'
shape = 'sphere'
position = [-0.6, 0, 0]
size = 0.3
[[mirrors]]
name = 'plate'
shape = { plane = { height = 0.5 } }
position = [0.6, 0, 0]
size = 0.3
[[lights]]
position = [0, 0.9, 1.5]
target = [0, 0, -2]
intensity = [30, 30, 30]
inner_degrees = 60
outer_degrees = 70
[[mirror_points]]
cloud = 'five-mirrors/sphere, walls'
points = { box = { min = [-0.4, -1.1, -1], max = [0.4, -0.9, 0] } }
normals = 'flatten'
[parameters]
'scene.points' = 400000
'reflection.method' = 'surfel_trace'
";

#[test]
fn mirrors_of_a_scene_file_reflect_and_take_the_place_of_the_built_in_one() {
    let folder = Folder::new();
    folder.write("room.toml", FURNISHED);
    let images = ["--aov", "mirror=mirror.exr", "--aov", "mirror_position=seen.exr", "--aov", "depth=depth.exr"];
    let scene = ["room.toml", "--stats", "stats.json"];
    let Some(outcome) = render(&folder, &[&scene[..], &images].concat()) else { return };
    assert_done(&outcome);
    let [mirror, seen, depth] =
        ["mirror.exr", "seen.exr", "depth.exr"].map(|name| FloatImage::read(&folder.path(name)));
    // Pixels of places from their offset and distance, by the tangent of half the field of view.
    let pixels = |offset: f32, away: f32| offset / away / 30.0_f32.to_radians().tan() * 60.0;
    let at = |[x, y, z]: [f32; 3]| [(80.0 + pixels(x, 1.9 - z)) as usize, (60.0 - pixels(y, 1.9 - z)) as usize];
    let (ball, plate, puddle) = (at([-0.6, 0.0, 0.0]), at([0.6, 0.0, 0.0]), at([0.0, -1.0, -0.5]));
    assert_eq!([ball, [80, 60], plate, puddle].map(|pixel| mirror.value(pixel)), [1.0, 0.0, 1.0, 1.0]);
    assert!((depth.value(ball) - 1.61).abs() < 0.03, "the ball is {} away", depth.value(ball));
    // The plate throws the sight line back and on to the right wall; the puddle, up to the back wall.
    assert_near(seen.vector(plate), [1.0, 0.0, 0.4 / 0.6 * 1.9], 0.06);
    assert_near(seen.vector(puddle), [0.0, -1.0 + 1.5 / 2.4, -2.0], 0.06);
    let stats = stats(&folder);
    let pixels = mirror.channels[0].1.iter().filter(|value| **value == 1.0).count();
    assert_eq!(stats["mirror_pixels"], pixels);
    assert!(stats["closed_coverage"].as_f64().is_some_and(|share| share > 0.9), "{stats}");
    assert_eq!((&stats["bounces"], &stats["method"]), (&json!(1), &json!("surfel_trace")));
}

#[test]
fn odd_objects_of_a_scene_file_are_refused_by_name() {
    let folder = Folder::new();
    let refused = |from: &str, to: &str, mentioned: &[&str]| {
        assert!(FURNISHED.contains(from));
        folder.write("room.toml", FURNISHED.replace(from, to));
        assert_refused(&folder.glint(["render", "room.toml", "-o", "picture.png"]), 2, mentioned);
    };
    refused("size = 0.3", "size = 0", &["room.toml", "mirror 1", "`sphere`", "size"]);
    refused("position = [0.6, 0, 0]", "position = [nan, 0, 0]", &["room.toml", "`plate`", "position"]);
    refused("shape = 'sphere'", "shape = 'ball'", &["room.toml", "line 5", "ball"]);
    refused("outer_degrees = 70", "outer_degrees = 7", &["room.toml", "light 1"]);
    refused("normals = 'flatten'", "specular_intensity = 2", &["room.toml", "mirror points 1", "specular_intensity"]);
    assert!(!folder.path("picture.png").exists());
}

#[test]
fn a_clouds_own_colours_span_the_values_of_its_attribute_as_those_of_the_view_do() {
    let folder = Folder::new();
    // A square of points whose values go from 0 to 99.
    let point = |at: u32| {
        let (x, y) = (at % 100, at / 100);
        format!("{} {} 0 {x}\n", f64::from(x) * 0.02, f64::from(y) * 0.02)
    };
    let numbers = "property float x\nproperty float y\nproperty float z\nproperty float temperature\n";
    let header = format!("ply\nformat ascii 1.0\nelement vertex 10000\n{numbers}end_header\n");
    folder.write("steps.ply", header + &(0..10_000).map(point).collect::<String>());
    let colors = "by = 'attribute', attribute = 'temperature', ramp = 'magma', low = 0.0, high = 1.0";
    folder.write(
        "own.toml",
        format!("clouds = ['steps.ply']\n[[cloud_settings]]\ncloud = 'steps.ply'\ncolor = {{ {colors} }}\n"),
    );
    let parameters: Vec<String> =
        colors.split(", ").map(|color| format!("color.{}", color.replace([' ', '\''], ""))).collect();
    let of_view: Vec<&str> = parameters.iter().flat_map(|parameter| ["--set", parameter]).collect();
    let common = ["--camera", "top", "--set", "overlay.legend=true", "--set", "light.by=colors"];
    let picture = |words: &[&str]| {
        let outcome = render(&folder, &[&common[..], words].concat())?;
        assert_done(&outcome);
        Some(std::fs::read(folder.path("picture.png")).expect("the picture"))
    };
    let Some(own) = picture(&["own.toml"]) else { return };
    assert!(Some(own) == picture(&[&["steps.ply"][..], &of_view].concat()), "the colours are not the same");
}

#[test]
fn surfaces_judges_a_depth_image_by_the_half_of_it_that_is_held_out() {
    let folder = Folder::new();
    // A wall of 120 x 90 pixels at a distance of 4 along the axis, seen from the origin, with a box before it at 2.
    let pixel = |at: i32| {
        let (x, y) = (f64::from(at % 120) / 60.0 - 1.0, f64::from(at / 120) / 60.0 - 0.75);
        let depth = if x.abs() < 0.3 && y.abs() < 0.3 { 2.0 } else { 4.0 };
        format!("{} {} {depth} 200 100 50\n", x * 0.5 * depth, y * 0.5 * depth)
    };
    let header = "ply\nformat ascii 1.0\nelement vertex 10800\nproperty float x\nproperty float y\nproperty float z\n\
                  property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    folder.write("image.ply", format!("{header}{}", (0..10_800).map(pixel).collect::<String>()));
    let outcome = folder.glint(["surfaces", "image.ply", "--json", "--seed", "3", "--set", "splat.size=1"]);
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        return println!("skipped: no adapter: {}", outcome.messages.trim());
    }
    assert_done(&outcome);
    let report = outcome.json();
    let entry = &report["inputs"][0];
    assert_eq!((&entry["scanner_from"], &entry["scanners"]), (&json!("origin"), &json!([[0.0, 0.0, 0.0]])));
    assert_eq!((&entry["path"], &entry["set"]), (&json!("image.ply"), &json!({ "splat.size": 1.0 })));
    let figure = |name: &str| entry[name].as_f64().unwrap_or_else(|| panic!("{name}: {entry}"));
    let shares = ["within", "in_front", "behind", "open"].map(figure);
    assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{entry}");
    // The splats at the border of the box stand before the wall by their radius.
    assert!(shares[0] > 0.93 && shares[1] < 0.06 && shares[3] < 0.01, "{entry}");
    assert!((5200.0..5600.0).contains(&figure("rays")), "{entry}");
    assert!(entry["depth_error"]["median"].as_f64().is_some_and(|error| error < 1e-4), "{entry}");
    assert!(entry["colour_error"]["median"].as_f64().is_some_and(|error| error < 0.5), "{entry}");
    assert!(entry["traced"]["within"].as_f64().is_some_and(|within| within > 0.93), "{entry}");
    assert_intervals(entry);
    // Of the same seed, to the digit; from elsewhere the box hides the wall.
    let again = folder.glint(["surfaces", "image.ply", "--json", "--seed", "3", "--set", "splat.size=1"]);
    assert_eq!(again.text(), outcome.text());
    let aside = folder.glint(["surfaces", "image.ply", "--json", "--scanner", "-6,0,0", "--scanner", "0,0,0.5"]);
    let report = aside.json();
    assert_eq!(report["inputs"][0]["scanner_from"], "flag");
    assert_eq!(report["inputs"][0]["scanners"], json!([[-6.0, 0.0, 0.0], [0.0, 0.0, 0.5]]));
    // What cannot be judged is reported, and the others are judged all the same.
    folder.write("few.ply", header.replace("10800", "2") + "0 0 1 9 9 9\n0 1 1 9 9 9\n");
    let few = folder.glint(["surfaces", "few.ply", "image.ply", "--json"]);
    assert_refused(&few, 2, &["few.ply", "2 points", "too few"]);
    let report = few.json();
    assert!(report["inputs"][0]["error"].is_string() && report["inputs"][1]["within"].is_f64(), "{few}");
}

/// What comes from standard input is kept in a temporary file.
#[test]
#[cfg(unix)]
fn a_temporary_folder_that_cannot_take_what_comes_is_named_with_its_variable() {
    let folder = Folder::new();
    let points = std::fs::File::open(folder.write("points.xyz", "1 2 3\n4 5 6\n")).expect("what was written");
    let mut command = folder.command(["info", "-"]);
    let missing = folder.path("missing");
    let output = command.stdin(points).env("TMPDIR", &missing).output().expect("the program starts");
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    for word in ["-: ", &missing.display().to_string(), "there is no such folder", "TMPDIR"] {
        assert!(told.contains(word), "{told}");
    }
}
