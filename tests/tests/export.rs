//! `glint export`: the new file has the points that the scene shows.

use std::collections::BTreeSet;

use tests::{Folder, Outcome, lacks_adapter, test_data};

/// What a scene file hides of a scan: all clip shapes, and classes.
fn clips(middle: [f64; 3], width: f64) -> String {
    let [x, y, z] = middle;
    let (a, b, c) = (x - width, x + width, y + width);
    let polygon = format!("[[{a}, {y}, {z}], [{b}, {y}, {z}], [{x}, {c}, {z}]]");
    format!(
        "[visibility]\nhidden_classes = [6]\nfilters = [{{ attribute = \"intensity\", low = 20.0 }}]\n\
         [[clips]]\nposition = [{x}, {y}, {z}]\nsize = [{width}, {width}, 1000.0]\nrotation = [0.0, 0.0, 0.38268, 0.92388]\n\
         [[clips]]\nshape = {{ prism = {{ points = {polygon}, direction = [0.0, 0.0, 1.0] }} }}\n\
         [[clips]]\nshape = \"sphere\"\nkeep = \"outside\"\nposition = [{x}, {y}, {z}]\nsize = [{half}, {half}, {half}]\n\
         [[clips]]\nshape = \"slab\"\nkeep = \"outside\"\nposition = [{x}, {y}, {z}]\nsize = [1.0, 1.0, 2.0]\n",
        half = width / 2.0
    )
}

fn information(folder: &Folder, file: &str) -> serde_json::Value {
    let outcome = folder.glint(["info", "--json", "--scan", file]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    outcome.json()["inputs"][0].clone()
}

/// The rows of a table of points, without the first three columns: what a line says of a point depends on the line.
fn rows(outcome: &Outcome) -> BTreeSet<String> {
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let text = outcome.text();
    let row = |line: &str| line.splitn(4, ',').nth(3).expect("a row has coordinates").to_owned();
    text.lines().skip(1).map(row).collect()
}

/// The names and types of the attributes that a report lists.
fn kinds(of: &serde_json::Value) -> Vec<(String, String)> {
    let text = |value: &serde_json::Value| value.as_str().expect("text").to_owned();
    let attributes = of["attributes"].as_array().expect("a list");
    attributes.iter().map(|own| (text(&own["name"]), text(&own["type"]))).collect()
}

#[test]
fn what_a_scene_shows_of_a_scan_is_exported_point_by_point() {
    let Some(data) = test_data() else { return };
    let scan = data.join("airborne/autzen_trim_las12_pf3.laz");
    let scan = scan.to_str().expect("text");
    let folder = Folder::new();
    let before = information(&folder, scan);
    let corner = |end: &str, axis: usize| before["bounds"][end][axis].as_f64().expect("a coordinate");
    let middle = [0, 1, 2].map(|axis| (corner("min", axis) + corner("max", axis)) / 2.0);
    let width = (corner("max", 0) - corner("min", 0)) * 0.7;
    folder.write("some.toml", format!("clouds = ['{scan}']\n{}", clips(middle, width)));
    // A section as wide as the scan is a table of all that is shown.
    let [x, y, _] = middle;
    let line = format!("{},{y},0:{},{y},0", x - 1e5, x + 1e5);
    let table = |file: &str| rows(&folder.glint(["profile", file, "--line", &line, "--width", "1e6"]));
    let shown = table("some.toml");
    let all = before["points"].as_u64().expect("a number");
    assert!(shown.len() > 1000 && (shown.len() as u64) < all, "{} of {all}", shown.len());
    for name in ["some.laz", "some.las", "some.copc.laz"] {
        let outcome = folder.glint(["export", scan, "--scene", "some.toml", "-o", name]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
        let found = information(&folder, name);
        assert_eq!(outcome.text(), format!("{name}: {} of {} points\n", found["points"], before["points"]));
        // Later point formats have the system as WKT.
        let crs = found["crs"].as_str().expect("text");
        assert!(name == "some.copc.laz" && crs.contains("CS[") || found["crs"] == before["crs"], "{crs}");
        if name != "some.copc.laz" {
            assert_eq!(kinds(&found), kinds(&before));
            assert_eq!(found["point_format"], before["point_format"]);
            assert!(table(name) == shown, "{name} has other points");
        }
    }
    // The scene file can be the input, too; a PLY file has the same points. The report is true of every kind of file.
    for name in ["some.ply", "told.laz", "told.copc.laz", "told.csv"] {
        let outcome = folder.glint(["export", "some.toml", "--json", "-o", name]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
        let (report, written) = (outcome.json(), shown.len() as u64);
        assert_eq!((&report["path"], &report["points"]), (&name.into(), &written.into()));
        assert_eq!(report["left_out"], all - written);
        if name == "told.csv" {
            let text = std::fs::read_to_string(folder.path(name)).expect("the table");
            let names: Vec<&str> = text.lines().next().expect("names").split(',').collect();
            let told: Vec<&str> = report["attributes"]
                .as_array()
                .expect("a list")
                .iter()
                .map(|own| own["name"].as_str().expect("a name"))
                .collect();
            assert_eq!(told, names);
            let row = |line: &str| line.split(',').take(3).map(|value| value.parse().expect("a number")).collect();
            let rows: Vec<Vec<f64>> = text.lines().skip(1).map(row).collect();
            for axis in 0..3 {
                let values = || rows.iter().map(|row| row[axis]);
                let ends = [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)];
                let told = ["min", "max"].map(|end| report["bounds"][end][axis].as_f64().expect("a number"));
                assert!(ends.iter().zip(told).all(|(end, told)| (end - told).abs() < 1e-6), "{ends:?}: {report}");
            }
            continue;
        }
        let found = information(&folder, name);
        assert_eq!(report["bounds"], found["bounds"], "{name}");
        assert_eq!(kinds(&report), kinds(&found), "{name}");
    }
    assert_eq!(information(&folder, "some.ply")["points"], information(&folder, "some.las")["points"]);
    assert_eq!(information(&folder, "some.copc.laz")["points"], information(&folder, "some.las")["points"]);
}

#[test]
fn hidden_strays_are_not_exported() {
    let folder = Folder::new();
    let mut rows: Vec<String> = (0..1600).map(|at| format!("{} {} 0 1\n", at % 40, at / 40)).collect();
    // The last of three strays has a patch of the other class beside it.
    rows.extend(["20 20 60 1\n", "90 5 30 1\n", "1.02 20.05 90 1\n"].map(String::from));
    rows.extend((0..60).map(|at| format!("{} {} 90 2\n", 0.1 * f64::from(at % 10), 20.0 + 0.1 * f64::from(at / 10))));
    let header = "property float x\nproperty float y\nproperty float z\nproperty uchar classification\nend_header\n";
    folder.write("grid.ply", format!("ply\nformat ascii 1.0\nelement vertex 1663\n{header}{}", rows.concat()));
    folder.write("hiding.toml", "clouds = ['grid.ply']\n[parameters]\n\"splat.strays\" = \"hidden\"\n");
    let class = "[parameters]\n\"splat.strays\" = \"hidden\"\n[visibility]\nhidden_classes = [2]\n";
    folder.write("class.toml", class);
    let exported = |arguments: &[&str], name: &str, points: u64| {
        let outcome = folder.glint(["export", "-o", name].iter().chain(arguments));
        assert_eq!(outcome.text(), format!("{name}: {points} of 1663 points\n"), "{outcome}");
        assert_eq!(information(&folder, name)["points"], points);
    };
    exported(&["grid.ply"], "all.laz", 1663);
    for name in ["a.laz", "a.ply", "a.copc.laz"] {
        exported(&["hiding.toml"], name, 1661);
    }
    // Whole records are left out, too.
    exported(&["all.laz", "--set", "splat.strays=hidden"], "b.las", 1661);
    exported(&["grid.ply", "--scene", "hiding.toml"], "c.laz", 1661);
    exported(&["grid.ply", "--scene", "class.toml"], "d.laz", 1600);
    exported(&["hiding.toml", "--set", "splat.strays=faded"], "e.laz", 1663);
    exported(&["hiding.toml", "--set", "surface.radii=full"], "f.laz", 1663);
    // A filter leaves all others out.
    let filter = |low: u32, high: u32| {
        format!("[visibility]\nfilters = [{{ attribute = 'stray', low = {low}, high = {high} }}]\n")
    };
    folder.write("stray.toml", format!("clouds = ['grid.ply']\n{}", filter(1, 2)));
    exported(&["stray.toml"], "g.laz", 2);
    folder.write("surface.toml", filter(0, 0));
    exported(&["grid.ply", "--scene", "surface.toml"], "h.laz", 1661);
    let outcome = folder.glint(["export", "stray.toml", "-o", "i.laz", "--set", "surface.radii=full"]);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    assert!(
        outcome.messages.contains("no attribute `stray` to filter by; surface.radii = spread finds it"),
        "{outcome}"
    );
}

#[test]
fn an_export_that_cannot_be_made_is_refused() {
    let folder = Folder::new();
    let header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
    folder.write("two.ply", format!("{header}end_header\n0 0 0\n1 2 3\n"));
    folder.write("none.toml", "[[clips]]\nposition = [90.0, 0.0, 0.0]\n");
    folder.write("there.ply", "kept");
    let refused = |arguments: &[&str], status: i32, mentioned: &str| {
        let outcome = folder.glint(["export", "two.ply"].iter().chain(arguments));
        assert_eq!(outcome.status, Some(status), "{outcome}");
        assert!(outcome.messages.contains(mentioned), "{mentioned}: {outcome}");
    };
    refused(&["-o", "a.txt"], 2, "must end in .laz, .las, .copc.laz, .e57, .ply or .csv");
    refused(&["-o", "there.ply"], 1, "a file of this name is there, and is not replaced; name another place");
    refused(&["-o", "two.ply"], 1, "is not replaced");
    refused(&["-o", "a.laz", "--scene", "gone.toml"], 2, "gone.toml");
    refused(&["-o", "a.laz", "--scene", "none.toml"], 2, "no point is shown");
    let built_in = folder.glint(["export", "five-mirrors/none", "-o", "a.laz"]);
    assert!(built_in.status == Some(2) && built_in.messages.contains("this command reads files"), "{built_in}");
    let made = folder.glint(["export", "tripod/room", "-o", "a.laz"]);
    assert!(made.status == Some(2) && made.messages.contains("a file that ends in .ply"), "{made}");
    assert_eq!(std::fs::read_to_string(folder.path("there.ply")).expect("the file"), "kept");
    assert!(!folder.path("a.laz").exists());
    // One of several inputs is missing: the others are exported.
    let outcome = folder.glint(["export", "two.ply", "gone.ply", "-o", "a.laz"]);
    assert!(outcome.status == Some(2) && outcome.text() == "a.laz: 2 of 2 points\n", "{outcome}");
}

#[test]
fn an_export_of_a_source_that_breaks_off_fails_and_writes_the_points_that_there_are() {
    let folder = Folder::new();
    let header = "property float x\nproperty float y\nproperty float z\nend_header\n";
    let rows: String = (0..70).map(|at| format!("{} {} 0\n", at % 9, at / 9)).collect();
    folder.write("short.ply", format!("ply\nformat ascii 1.0\nelement vertex 1100\n{header}{rows}"));
    let lack = |name: &str| format!("glint: {name}: lacks 1,030 points of its sources, which cannot be read\n");
    for name in ["a.laz", "a.ply", "a.csv"] {
        let outcome = folder.glint(["export", "short.ply", "-o", name]);
        assert_eq!(outcome.status, Some(2), "{outcome}");
        assert!(outcome.messages.contains(&lack(name)), "{outcome}");
        assert_eq!(outcome.text(), format!("{name}: 70 of 70 points\n"));
    }
    assert_eq!(information(&folder, "a.laz")["points"], 70);
    // Numbers of the rest are no success either. A report or a picture of a file that ends early is.
    let points = "points = [[0.0, 3.0, 0.0], [8.0, 3.0, 0.0]]";
    folder.write("short.toml", format!("clouds = ['short.ply']\n[[measurements]]\nkind = 'distance'\n{points}\n"));
    let section = ["--line", "0,0,0:9,0,0", "--width", "0.5"];
    let of_rest = "glint: 1,030 points of the inputs cannot be read\n";
    let profile = [&["profile", "short.ply"], &section[..]].concat();
    for command in [&["measure", "short.toml"][..], &profile, &["surfaces", "short.ply"]] {
        let outcome = folder.glint(command);
        if lacks_adapter(&outcome) {
            continue;
        }
        assert!(outcome.status == Some(2) && outcome.messages.ends_with(of_rest), "{outcome}");
    }
    folder.glint(["export", "short.ply", "-o", "cut.las"]);
    let cut = std::fs::read(folder.path("cut.las")).expect("the file");
    folder.write("cut.las", &cut[..cut.len() - 200]);
    let outcome = folder.glint(["index", "cut.las", "-o", "cut.copc.laz"]);
    assert!(outcome.status == Some(2) && outcome.messages.contains("glint: cut.copc.laz: lacks "), "{outcome}");
    for command in ["info", "index"] {
        assert_eq!(folder.glint([command, "cut.las"]).status, Some(0));
    }
    let outcome = folder.glint(["profile", "short.ply", "-o", "b.ply"].iter().chain(&section));
    assert!(outcome.status == Some(2) && outcome.messages.contains(&lack("b.ply")), "{outcome}");
    let outcome = folder.glint(["compare", "short.ply", "a.ply", "-o", "c.ply"]);
    let of_parts = "glint: the distances are those of parts: 1,030 points of the clouds cannot be read\n";
    assert!(outcome.status == Some(2) && outcome.messages.contains(of_parts), "{outcome}");
    assert!(outcome.messages.contains(&lack("c.ply")) && outcome.text().contains("points       70"), "{outcome}");
    let outcome = folder.glint(["compare", "a.ply", "a.ply"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
}

#[test]
fn a_made_scan_is_exported_with_its_colours_and_read_back() {
    let folder = Folder::new();
    let few = ["--set", "scene.points=5000"];
    let outcome = folder.glint(["export", "tripod/mixed", "-o", "mixed.ply"].iter().chain(&few));
    assert!(outcome.status == Some(0), "{outcome}");
    let written = information(&folder, "mixed.ply");
    let points = written["points"].as_u64().expect("a count");
    assert!((4800..=5200).contains(&points), "{written}");
    assert_eq!(outcome.text(), format!("mixed.ply: {points} of {points} points\n"));
    let names: Vec<String> = kinds(&written).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["x", "y", "z", "red", "green", "blue"]);
    // The corridor behind the room ends at 10.15 m.
    let high = [0, 2].map(|axis| written["bounds"]["max"][axis].as_f64().expect("a number"));
    assert!((high[0] - 10.15).abs() < 0.03 && (high[1] - 3.0).abs() < 0.03, "{high:?}");
}

#[test]
fn a_made_scan_replaces_no_file() {
    let folder = Folder::new();
    std::fs::write(folder.path("there.ply"), "kept").expect("a file");
    let outcome = folder.glint(["export", "tripod/room", "-o", "there.ply", "--set", "scene.points=1000"]);
    assert!(outcome.status == Some(1) && outcome.messages.contains("is not replaced"), "{outcome}");
    assert_eq!(std::fs::read_to_string(folder.path("there.ply")).expect("the file"), "kept");
}

#[test]
fn every_command_warns_of_settings_of_no_cloud_and_none_moves_a_tile_of_a_folder() {
    let folder = Folder::new();
    let header = "ply\nformat ascii 1.0\nelement vertex 64\nproperty float x\nproperty float y\nproperty float z\n";
    let tile = |shift: u32| {
        let rows: String = (0..64).map(|at| format!("{} {} 0\n", at % 8 + shift, at / 8)).collect();
        format!("{header}end_header\n{rows}")
    };
    folder.write("one.ply", tile(0));
    std::fs::create_dir(folder.path("tiles")).expect("a folder");
    folder.write("two.ply", tile(8));
    for (from, to) in [("one.ply", "tiles/a.las"), ("two.ply", "tiles/b.las")] {
        assert_eq!(folder.glint(["export", from, "-o", to]).status, Some(0), "{to}");
    }
    let scene = |clouds: &str, own: &str| {
        let line = "[[0.0, 3.0, 0.0], [15.0, 3.0, 0.0]]";
        format!(
            "clouds = ['{clouds}']\n{own}[[measurements]]\nkind = 'distance'\npoints = {line}\n\
             [[profiles]]\nname = 'a'\nline = {line}\nwidth = 1.0\n"
        )
    };
    let typo = "[[cloud_settings]]\ncloud = 'oen.ply'\non = false\nmove = [0.0, 0.0, 7.0]\n";
    folder.write("typo.toml", scene("one.ply", typo));
    folder.write("tile.toml", scene("tiles", "[[cloud_settings]]\ncloud = 'tiles/a.las'\nmove = [0.0, 0.0, 7.0]\n"));
    for (file, name) in [("typo.toml", "oen.ply"), ("tile.toml", "tiles/a.las")] {
        let commands = [
            format!("export {file} -o {file}.csv"),
            format!("measure {file}"),
            format!("profile {file} --json"),
            format!("compare {file} tiles --json"),
            format!("info {file}"),
            format!("index {file}"),
            format!("record {file} -o {file}.pictures --path turntable --frames 0..1 --size 64x48"),
            format!("render {file} -o a.png --size 64x48"),
        ];
        for command in commands {
            let outcome = folder.glint(command.split(' '));
            if lacks_adapter(&outcome) {
                continue;
            }
            assert_eq!(outcome.status, Some(0), "{outcome}");
            let told = outcome.messages.lines().filter(|line| line.contains("cloud settings: no cloud is called `"));
            assert!(told.clone().count() == 1 && told.clone().all(|line| line.contains(name)), "{command}: {outcome}");
        }
        let table = std::fs::read_to_string(folder.path(&format!("{file}.csv"))).expect("the points");
        assert!(table.lines().skip(1).all(|row| row.split(',').nth(2).and_then(|z| z.parse().ok()) == Some(0.0)));
    }
    // Clouds of a folder that are all switched off are no success without a file.
    let off =
        "[[cloud_settings]]\ncloud = 'one.ply'\non = false\n[[cloud_settings]]\ncloud = 'tiles/a.las'\non = false\n";
    let apart = scene("tiles", &off.replace("one.ply", "tiles/b.las")) + "[parameters]\n\"stream.pages\" = \"never\"\n";
    folder.write("off.toml", apart);
    let commands = [
        "export off.toml -o off.csv",
        "profile off.toml -o off.csv",
        "profile off.toml -o off.las",
        "measure off.toml",
        "compare off.toml one.ply",
        "ghosts off.toml -o off.las",
    ];
    for command in commands {
        let outcome = folder.glint(command.split(' '));
        let messages = &outcome.messages;
        assert!(outcome.status == Some(2) && messages.contains("the scene hides all of its clouds"), "{outcome}");
        assert!(!messages.contains("not all of this cloud can be read"), "{outcome}");
    }
    // Tiles near each other have the name of the folder, a lone one that of its file.
    folder.write("three.ply", tile(9000));
    assert_eq!(folder.glint(["export", "three.ply", "-o", "tiles/c.las"]).status, Some(0));
    folder.write("group.toml", scene("tiles", "[[cloud_settings]]\ncloud = 'tiles'\non = false\n"));
    let outcome = folder.glint(["export", "group.toml", "-o", "group.csv"]);
    assert!(outcome.status == Some(0) && outcome.text() == "group.csv: 64 of 64 points\n", "{outcome}");
    let table = std::fs::read_to_string(folder.path("group.csv")).expect("the points");
    assert!(table.lines().skip(1).all(|row| row.starts_with("900")), "only the lone tile: {table}");
}
