//! Bit fields as attributes, filters that name nothing, values that are no value.

use std::path::Path;

use tests::{Folder, Outcome};

use crate::folder;

/// A scene of a file with these lines under it.
fn scene(folder: &Folder, name: &str, cloud: &Path, rest: &str) {
    folder.write(name, format!("clouds = ['{}']\n{rest}", cloud.display()));
}

fn table(folder: &Folder, name: &str) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(folder.path(name)).expect("a table");
    text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

fn succeeded(outcome: Outcome) -> Outcome {
    assert_eq!(outcome.status, Some(0), "{outcome}");
    outcome
}

#[test]
fn a_filter_of_a_flag_leaves_3000_points_in_every_command() {
    let Some(cases) = folder() else { return };
    let (scene_file, cloud) = (cases.join("04_filter_withheld.toml"), cases.join("04_las_flags_channels.las"));
    let (folder, scene_file) = (Folder::new(), scene_file.to_str().expect("text"));
    for output in ["a.las", "a.laz", "a.ply", "a.csv", "a.copc.laz"] {
        let outcome = succeeded(folder.glint(["export", scene_file, "--json", "-o", output]));
        assert_eq!(outcome.json()["points"], 3000, "{outcome}");
    }
    // The flags are in the table and in the PLY file, and those that are shown are not withheld.
    let rows = table(&folder, "a.csv");
    let column = rows[0].iter().position(|name| name == "withheld").expect("a column");
    assert!(rows.len() == 3001 && rows[1..].iter().all(|row| row[column] == "0"));
    let line = ["--line", "0,20,0:40,20,0", "--width", "1000", "--json"];
    let outcome = succeeded(folder.glint([&["profile", scene_file][..], &line].concat()));
    assert_eq!(outcome.json()["profiles"][0]["points"], 3000, "{outcome}");
    let whole = cloud.to_str().expect("text");
    let outcome = succeeded(folder.glint(["compare", scene_file, whole, "--json"]));
    assert_eq!(outcome.json()["points"], 3000, "{outcome}");
    // Corners around all points, above which lie all that are shown.
    let corners = "[[0.0, 0.0, -5.0], [41.0, 0.0, -5.0], [41.0, 41.0, -5.0], [0.0, 41.0, -5.0]]";
    let volume = format!("[[measurements]]\nname = 'v'\nkind = 'volume'\npoints = {corners}\n");
    let filter = "[visibility]\nfilters = [{ attribute = 'withheld', low = 0.0, high = 0.0 }]\n";
    scene(&folder, "all.toml", &cloud, &volume);
    scene(&folder, "some.toml", &cloud, &format!("{filter}{volume}"));
    let counts = ["all.toml", "some.toml"].map(|name| {
        let outcome = succeeded(folder.glint(["measure", name, "--json"]));
        let values = outcome.json()["measurements"][0]["values"].as_array().expect("values").clone();
        values.iter().find(|value| value["name"] == "points").expect("a count")["value"].as_f64().expect("a number")
    });
    assert_eq!(counts, [4000.0, 3000.0]);
}

#[test]
fn whatever_info_lists_can_be_filtered_by() {
    let Some(cases) = folder() else { return };
    let folder = Folder::new();
    for name in ["04_las_flags_channels.las", "12_las_pf4_wave_offsets_u64.las", "07_ply_with_scalar_rgb_normals.ply"] {
        let cloud = cases.join(name);
        let info = succeeded(folder.glint(["info", "--json", cloud.to_str().expect("text")])).json();
        let info = &info["inputs"][0];
        let names: Vec<&str> = info["attributes"]
            .as_array()
            .expect("a list")
            .iter()
            .map(|own| own["name"].as_str().expect("a name"))
            .collect();
        assert!(names.len() > 6, "{info}");
        // Everything has values in an endless range.
        let filters: Vec<String> =
            names.iter().map(|name| format!("{{ attribute = '{name}', low = -1e30 }}")).collect();
        scene(&folder, "all.toml", &cloud, &format!("[visibility]\nfilters = [{}]\n", filters.join(", ")));
        let outcome = succeeded(folder.glint(["export", "all.toml", "--json", "-o", &format!("{name}.all.csv")]));
        assert_eq!(outcome.json()["points"], info["points"], "{outcome}");
        // And each hides everything in a range where nothing is.
        for attribute in ["scan_direction_flag", "wavepacket_offset", "nx", "red", "x"] {
            if !names.contains(&attribute) {
                continue;
            }
            let filter = format!("[visibility]\nfilters = [{{ attribute = '{attribute}', low = 1e29 }}]\n");
            scene(&folder, "none.toml", &cloud, &filter);
            let outcome = folder.glint(["export", "none.toml", "-o", "none.csv"]);
            assert!(outcome.status == Some(2) && outcome.messages.contains("no point is shown"), "{outcome}");
        }
    }
}

#[test]
fn a_filter_that_names_nothing_is_an_error_of_every_command() {
    let Some(cases) = folder() else { return };
    let scene_file = cases.join("04_filter_no_such_attribute.toml");
    let (folder, file) = (Folder::new(), scene_file.to_str().expect("text"));
    let cloud = cases.join("04_las_flags_channels.las");
    let cloud = cloud.to_str().expect("text");
    let corners = "[[measurements]]\nname = 'd'\nkind = 'distance'\npoints = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]\n";
    let filter = "[visibility]\nfilters = [{ attribute = 'nonsense', low = 0.0, high = 1.0 }]\n";
    let path = "[[paths]]\nname = 'still'\n[[paths.keyframes]]\ntime = 0\neye = [0, -9, 2]\npivot = [0, 0, 1]\n\
        up = [0, 0, 1]\n";
    scene(&folder, "measured.toml", Path::new(cloud), &format!("{filter}{corners}{path}"));
    let small = ["--size", "64x48"];
    let commands: [&[&str]; 10] = [
        &["export", file, "-o", "a.csv"],
        &["export", cloud, "--scene", file, "-o", "b.csv"],
        &["profile", file, "--line", "0,20,0:40,20,0", "--width", "9", "-o", "c.csv"],
        &["compare", file, cloud],
        &["compare", cloud, file, "-o", "d.laz"],
        &["measure", "measured.toml"],
        &["index", file],
        &["surfaces", file],
        &["render", file, "-o", "e.png", small[0], small[1]],
        &["record", "measured.toml", "-o", "f", small[0], small[1]],
    ];
    for command in commands {
        let outcome = folder.glint(command);
        if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
            println!("skipped: no adapter: {}", outcome.messages.trim());
            continue;
        }
        assert_eq!(outcome.status, Some(2), "{outcome}");
        // The message names the file and what is in it.
        for word in ["04_las_flags_channels.las", "no attribute `nonsense`", "withheld", "scanner_channel"] {
            assert!(outcome.messages.contains(word), "`{word}`: {outcome}");
        }
    }
    for output in ["a.csv", "b.csv", "c.csv", "d.laz", "e.png", "f"] {
        assert!(!folder.path(output).exists(), "{output}");
    }
    // A name that is nearly right is suggested.
    scene(&folder, "near.toml", Path::new(cloud), &filter.replace("nonsense", "witheld"));
    let outcome = folder.glint(["export", "near.toml", "-o", "g.csv"]);
    assert!(outcome.status == Some(2) && outcome.messages.contains("did you mean `withheld`?"), "{outcome}");
}

#[test]
fn a_cloud_that_lacks_what_another_is_filtered_by_is_named() {
    let Some(cases) = folder() else { return };
    let folder = Folder::new();
    let [one, other] = ["04_las_flags_channels.las", "07_ply_xyz_only.ply"].map(|name| cases.join(name));
    let filter = "[visibility]\nfilters = [{ attribute = 'withheld', high = 0.0 }]\n";
    folder.write("two.toml", format!("clouds = ['{}', '{}']\n{filter}", one.display(), other.display()));
    let outcome = succeeded(folder.glint(["export", "two.toml", "--json", "-o", "two.csv"]));
    assert_eq!(outcome.json()["left_out"], 1000, "{outcome}");
    let lacks = "07_ply_xyz_only.ply: no attribute `withheld`, so its filter hides nothing there";
    assert!(outcome.messages.contains(lacks), "{outcome}");
    // Where no cloud has a class, none can be hidden.
    let hidden = "[visibility]\nhidden_classes = [7]\n";
    folder.write("classes.toml", format!("clouds = ['{}']\n{hidden}", other.display()));
    let outcome = folder.glint(["export", "classes.toml", "-o", "classes.csv"]);
    assert!(outcome.status == Some(2) && outcome.messages.contains("whose classes are hidden"), "{outcome}");
}

#[test]
fn a_colour_by_an_attribute_that_is_not_there_is_said() {
    let Some(cases) = folder() else { return };
    let cloud = cases.join("04_las_flags_channels.las");
    let (folder, cloud) = (Folder::new(), cloud.to_str().expect("text"));
    let set = ["--set", "color.by=attribute", "--set", "color.attribute=witheld", "-o", "a.png"];
    let line = ["--line", "0,20,0:40,20,0", "--width", "9"];
    let outcome = succeeded(folder.glint([&["profile", cloud][..], &line, &set].concat()));
    let said = "no attribute `witheld` (did you mean `withheld`?); colouring is automatic";
    assert!(outcome.messages.contains(said), "{outcome}");
}

#[test]
fn an_extra_dimension_has_no_value_where_its_no_data_is() {
    let Some(cases) = folder() else { return };
    let cloud = cases.join("05_las_extra_i16_scaled_no_data.las");
    let (folder, file) = (Folder::new(), cloud.to_str().expect("text"));
    let height = |file: &str| {
        let info = succeeded(folder.glint(["info", "--json", file])).json();
        let all = info["inputs"][0]["attributes"].as_array().expect("a list").clone();
        all.into_iter().find(|own| own["name"] == "height_above").expect("an attribute")
    };
    let own = height(file);
    let number = |own: &serde_json::Value, name: &str| own[name].as_f64().expect("a number");
    assert_eq!(
        (number(&own, "min"), number(&own, "max"), own["without_value"].as_u64()),
        (0.0, 7.99, Some(400)),
        "{own}"
    );
    // Empty cells in both tables.
    let line = ["--line", "500000,4000020,0:500040,4000020,0", "--width", "1000", "-o", "profile.csv"];
    succeeded(folder.glint([&["profile", file][..], &line].concat()));
    for name in ["a.csv", "a.ply", "a.las", "a.laz"] {
        succeeded(folder.glint(["export", file, "-o", name]));
    }
    for name in ["a.csv", "profile.csv"] {
        let rows = table(&folder, name);
        let column = rows[0].iter().position(|name| name == "height_above").expect("a column");
        let values = || rows[1..].iter().map(|row| row[column].as_str());
        assert_eq!((values().count(), values().filter(|value| value.is_empty()).count()), (4000, 400), "{name}");
        assert!(values().all(|value| value.is_empty() || value.parse::<f64>().expect("a number") >= 0.0), "{name}");
    }
    // NaN in PLY; LAS files keep the number and what it means.
    for name in ["a.ply", "a.las", "a.laz"] {
        assert_eq!(height(name)["without_value"], 400, "{name}");
    }
    let [before, after] =
        [std::fs::read(&cloud), std::fs::read(folder.path("a.las"))].map(|bytes| bytes.expect("a file"));
    let record = |bytes: &[u8]| -> Vec<u8> {
        let start = bytes.windows(12).position(|name| name == b"height_above").expect("a descriptor") - 4;
        let mut head = bytes[start..start + 64].to_vec();
        // That the smallest and the largest value are known: other points may have others.
        head[3] &= !6;
        head
    };
    assert_eq!(record(&before), record(&after));
    // No range contains what is not there, not even an endless one.
    scene(&folder, "endless.toml", &cloud, "[visibility]\nfilters = [{ attribute = 'height_above', high = 1000.0 }]\n");
    let outcome = succeeded(folder.glint(["export", "endless.toml", "--json", "-o", "some.csv"]));
    assert_eq!(outcome.json()["points"], 3600, "{outcome}");
}
