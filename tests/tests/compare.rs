//! `glint compare`: distances between clouds whose distances are known.

use tests::Folder;

/// Twenty units square at `height`, in steps of a fifth of a unit, that scatter evenly by `scatter` to both sides.
fn plane(height: f64, scatter: f64) -> String {
    let header = "ply\nformat ascii 1.0\nelement vertex 10000\nproperty double x\nproperty double y\nproperty double z\n\
                  property uchar classification\nend_header\n";
    let mut rows = header.to_owned();
    for index in 0..10_000_u32 {
        let (x, y) = (f64::from(index % 100) * 0.2, f64::from(index / 100) * 0.2);
        let z = height + if (index % 100 + index / 100) % 2 == 0 { scatter } else { -scatter };
        rows += &format!("{} {} {z} {}\n", 600_000.0 + x, 5_000_000.0 + y, index % 3);
    }
    rows
}

fn figures(folder: &Folder, words: &[&str]) -> serde_json::Value {
    let outcome = folder.glint(["compare", "a.ply", "b.ply", "--json"].iter().chain(words));
    assert_eq!(outcome.status, Some(0), "{outcome}");
    outcome.json()
}

fn is_near(value: &serde_json::Value, expected: f64, error: f64) -> bool {
    value.as_f64().is_some_and(|value| (value - expected).abs() <= error)
}

#[test]
fn distances_of_planes_are_those_that_they_were_made_with() {
    let folder = Folder::new();
    folder.write("a.ply", plane(0.0, 0.0));
    folder.write("b.ply", plane(-0.05, 0.0));
    let found = figures(&folder, &[]);
    assert_eq!(found["points"], 10_000);
    for key in ["mean", "median", "rms", "p95", "max"] {
        assert!(is_near(&found[key], 0.05, 1e-6), "{key}: {found}");
    }
    assert!(
        is_near(&found["std"], 0.0, 1e-6) && found["significant"].is_null() && found["interval"].is_null(),
        "{found}"
    );
    // Along the normals, which point up, it is below. Without any scatter, all of it is significant.
    let found = figures(&folder, &["--method", "m3c2"]);
    assert!(is_near(&found["mean"], -0.05, 1e-6) && is_near(&found["max"], 0.05, 1e-6), "{found}");
    assert_eq!((&found["points"], &found["significant"]), (&10_000.into(), &1.0.into()));
    // Points that scatter by 0.15 show no change of 0.02: with n points in either cylinder the level is 1.96 * 0.15 *
    // sqrt(2 / n), or 0.07 for 32 of them.
    folder.write("a.ply", plane(0.0, 0.15));
    folder.write("b.ply", plane(0.02, 0.15));
    let scales = ["--method", "m3c2", "--normal-scale", "6", "--cylinder-scale", "1.28", "--reach", "3"];
    let found = figures(&folder, &scales);
    assert!(is_near(&found["mean"], 0.02, 0.002) && is_near(&found["significant"], 0.0, 0.02), "{found}");
    assert!(is_near(&found["interval"], 0.07, 0.02), "{found}");

    // A registration that may be off by 0.05 hides a change of 0.05, which is beyond a level of 0.
    folder.write("a.ply", plane(0.0, 0.0));
    folder.write("b.ply", plane(-0.05, 0.0));
    let found = figures(&folder, &["--method", "m3c2", "--registration", "0.05"]);
    assert!(is_near(&found["mean"], -0.05, 1e-6) && found["significant"] == 0.0, "{found}");
    // One point in each cube of 2 units, 10 by 10 of them.
    let found = figures(&folder, &["--method", "m3c2", "--core", "2"]);
    assert!(is_near(&found["mean"], -0.05, 1e-6) && found["points"] == 100, "{found}");

    // The file has the points that are shown, and their distances.
    folder.write("a.ply", plane(0.0, 0.0));
    folder.write("b.ply", plane(0.25, 0.0));
    folder.write("some.toml", "clouds = ['a.ply']\n[visibility]\nhidden_classes = [1]\n");
    let outcome = folder.glint(["compare", "some.toml", "b.ply", "--method", "m3c2", "-o", "some.csv"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    assert!(outcome.text().contains("  points       6667\n"), "{outcome}");
    let table = std::fs::read_to_string(folder.path("some.csv")).expect("the table");
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("x,y,z,classification,distance,level_of_detection"));
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|value| value.parse().expect("a number")).collect()).collect();
    assert_eq!(rows.len(), 6667);
    assert!(rows.iter().all(|row| row[3] != 1.0 && (row[4] - 0.25).abs() < 1e-6 && row[5].abs() < 1e-6));
    for name in ["some.laz", "some.ply", "some.copc.laz"] {
        let outcome = folder.glint(["compare", "some.toml", "b.ply", "-o", name]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
        let info = folder.glint(["info", "--json", name]).json();
        let attributes = info["inputs"][0]["attributes"].as_array().expect("a list");
        assert!(attributes.iter().any(|attribute| attribute["name"] == "distance"), "{name}: {info}");
        assert_eq!(info["inputs"][0]["points"], 6667);
    }
    // Measured again, the new numbers get a name of their own.
    let outcome = folder.glint(["compare", "some.laz", "b.ply", "-o", "again.laz"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let again = folder.glint(["profile", "again.laz", "--line", "5e5,5e6,0:7e5,5e6,0", "--width", "100"]).text();
    let names: Vec<&str> = again.lines().next().expect("a header").split(',').collect();
    let place = |name: &str| names.iter().position(|known| *known == name).expect("the column");
    let (distance, second) = (place("distance"), place("distance_2"));
    let is_known = |line: &str| {
        let values: Vec<f64> = line.split(',').map(|value| value.parse().unwrap_or(f64::NAN)).collect();
        (values[distance] - 0.25).abs() < 1e-6 && (values[second] - 0.25).abs() < 1e-6
    };
    assert!(again.lines().count() == 6668 && again.lines().skip(1).all(is_known), "{}", names.join(","));
}

#[test]
fn a_cloud_that_its_scene_moves_or_turns_is_compared_from_where_it_stands() {
    let folder = Folder::new();
    folder.write("a.ply", plane(0.0, 0.0));
    folder.write("b.ply", plane(0.0, 0.0));
    let own = |lines: &str| format!("clouds = ['a.ply']\n[[cloud_settings]]\ncloud = 'a.ply'\n{lines}\n");
    folder.write("moved.toml", own("move = [0, 0, 0.05]"));
    folder.write("upright.toml", own("turn = [90, 0, 0]\nabout = [600000, 5000000, 0]\nmove = [0, 0.1, 0]"));
    let figures = |words: &[&str]| {
        let outcome = folder.glint(["compare", "--json"].iter().chain(words));
        assert_eq!(outcome.status, Some(0), "{outcome}");
        outcome.json()
    };
    for (first, second) in [("moved.toml", "b.ply"), ("b.ply", "moved.toml")] {
        let found = figures(&[first, second]);
        assert!(is_near(&found["mean"], 0.05, 1e-9) && is_near(&found["max"], 0.05, 1e-6), "{found}");
        let sign = if first == "b.ply" { 1.0 } else { -1.0 };
        let found = figures(&[first, second, "--method", "m3c2"]);
        assert!(is_near(&found["mean"], sign * 0.05, 1e-6), "{found}");
    }
    // The rows of the upright cloud stand 0, 0.2, ... 19.8 above the plane, between two rows of it.
    let expected = (0..100).map(|row| (0.1_f64.powi(2) + (0.2 * f64::from(row)).powi(2)).sqrt()).sum::<f64>() / 100.0;
    let found = figures(&["upright.toml", "b.ply", "-o", "upright.csv"]);
    assert!(is_near(&found["mean"], expected, 1e-6), "{found}, not {expected}");
    let table = std::fs::read_to_string(folder.path("upright.csv")).expect("the table");
    let rows =
        table.lines().skip(1).map(|line| line.split(',').map(|value| value.parse().expect("a number")).collect());
    let rows: Vec<Vec<f64>> = rows.collect();
    assert_eq!(rows.len(), 10_000);
    assert!(rows.iter().all(|row| (row[1] - 5_000_000.1).abs() < 1e-6 && (-1e-6..=19.81).contains(&row[2])));
    // A place that is none is refused by name.
    for (lines, told) in [
        ("move = [nan, 0, 0]", "move is [NaN, 0, 0]"),
        ("turn = [0, 0, 1]", "turn has no `about"),
        ("turn = [0, 0, 1e9]\nabout = [0, 0, 0]", "turn is [0, 0, 1000000000]"),
    ] {
        folder.write("odd.toml", own(lines));
        let outcome = folder.glint(["compare", "odd.toml", "b.ply"]);
        assert!(outcome.status == Some(2) && outcome.messages.contains("odd.toml"), "{outcome}");
        assert!(
            outcome.messages.contains("cloud settings 1 (`a.ply`)") && outcome.messages.contains(told),
            "{outcome}"
        );
    }
}

#[test]
fn a_file_with_a_damaged_chunk_is_not_compared_with_and_without_an_output() {
    let folder = Folder::new();
    let rows: String = (0..60_000).map(|at| format!("{},{},0\n", at % 200, at / 200)).collect();
    folder.write("a.csv", format!("x,y,z\n{rows}"));
    folder.write("b.csv", "x,y,z\n1,1,1\n4,4,1\n7,7,1\n");
    assert_eq!(folder.glint(["export", "a.csv", "-o", "a.laz"]).status, Some(0));
    let mut bytes = std::fs::read(folder.path("a.laz")).expect("the file");
    // Behind the first record of the first chunk, which has 50,000 points, are their number and the sizes of the layers.
    let start = u32::from_le_bytes([bytes[96], bytes[97], bytes[98], bytes[99]]) as usize + 8;
    let length = usize::from(bytes[105]);
    bytes[start + length + 4..][..4].fill(0xff);
    folder.write("a.laz", bytes);
    for words in [&["a.laz", "b.csv"][..], &["b.csv", "a.laz"], &["a.laz", "b.csv", "-o", "c.laz"]] {
        let outcome = folder.glint(std::iter::once(&"compare").chain(words));
        assert_eq!(outcome.status, Some(2), "{outcome}");
        assert!(outcome.messages.contains("nothing is compared; it lacks 50,000 points"), "{outcome}");
        assert!(!folder.path("c.laz").exists());
    }
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = Folder::new();
    folder.write("a.ply", plane(0.0, 0.0));
    folder.write("b.ply", plane(0.0, 0.0));
    folder.write("none.toml", "clouds = ['a.ply']\n[[clips]]\nposition = [90.0, 0.0, 0.0]\n");
    let refused = |arguments: &[&str], status: i32, mentioned: &str| {
        let outcome = folder.glint(["compare"].iter().chain(arguments));
        assert_eq!(outcome.status, Some(status), "{outcome}");
        assert!(outcome.messages.contains(mentioned), "{mentioned}: {outcome}");
    };
    refused(&["a.ply"], 2, "<SECOND>");
    refused(&["a.ply", "gone.ply"], 2, "no such file");
    refused(&["a.ply", "b.ply", "--method", "icp"], 2, "nearest, m3c2");
    refused(&["a.ply", "b.ply", "--method", "m3c2", "--reach", "0"], 2, "a scale of 0");
    refused(&["a.ply", "b.ply", "--method", "m3c2", "--registration", "-1"], 2, "a registration off by -1");
    for scale in ["--normal-scale", "--cylinder-scale", "--reach", "--registration"] {
        refused(&["a.ply", "b.ply", scale, "0.1"], 2, &format!("{scale}: only --method m3c2 has it"));
    }
    refused(&["a.ply", "b.ply", "--core", "0"], 2, "core points 0 apart");
    refused(&["a.ply", "b.ply", "-o", "a.txt"], 2, ".csv");
    refused(&["a.ply", "b.ply", "-o", "b.ply"], 1, "is not replaced");
    refused(&["a.ply", "none.toml"], 2, "the second cloud shows no points");
    refused(&["none.toml", "b.ply"], 2, "no point of the first cloud");
}
