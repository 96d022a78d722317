//! `glint profile`: the table of a section against its closed form.

use tests::Folder;

/// A slope z = 0.25 x - 0.5 y on a lattice of a quarter of a unit, at coordinates of seven digits, with an attribute.
fn slope() -> String {
    let header = "ply\nformat ascii 1.0\nelement vertex 6561\nproperty double x\nproperty double y\nproperty double z\n\
                  property uchar red\nproperty uchar green\nproperty uchar blue\nproperty ushort intensity\nend_header\n";
    let line = |i: i32, j: i32| {
        let (x, y) = (f64::from(i) * 0.25, f64::from(j) * 0.25);
        let z = 0.25 * x - 0.5 * y;
        format!("{} {} {} {} 20 30 {}\n", 5_000_000.0 + x, 600_000.0 + y, z, i, 10 * j)
    };
    header.to_string() + &(0..81).flat_map(|i| (0..81).map(move |j| line(i, j))).collect::<String>()
}

/// The columns by name. Where an interval is not known, it is no number.
fn table(text: &str) -> Vec<Vec<f64>> {
    let mut lines = text.lines();
    let names = "along,height,across,x,y,z,red,green,blue,intensity,along_interval,height_interval";
    assert_eq!(lines.next(), Some(names));
    let number = |(column, value): (usize, &str)| match value {
        "" if column >= OWN => f64::NAN,
        value => value.parse().expect("a number"),
    };
    lines.map(|line| line.split(',').enumerate().map(number).collect()).collect()
}

/// The number of columns before the intervals.
const OWN: usize = 10;

#[test]
fn a_profile_of_a_slope_is_a_straight_line_of_it() {
    let folder = Folder::new();
    folder.write("slope.ply", slope());
    let line = ["--line", "5000002,600003,0:5000010,600009,99", "--width", "1"];
    let outcome = folder.glint(["profile", "slope.ply"].iter().chain(&line));
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let rows = table(&String::from_utf8_lossy(&outcome.output));
    // As many points as the area of the slice, 10 square units with 16 points each.
    assert!((150..170).contains(&rows.len()), "{} points", rows.len());
    for row in &rows {
        let [along, height, across, x, y, z, red, _, _, intensity, of_along, of_height] = row[..] else {
            panic!("{row:?}")
        };
        let (dx, dy) = (x - 5_000_002.0, y - 600_003.0);
        // The line runs along (0.8, 0.6), and its left is (-0.6, 0.8).
        assert!((along - (0.8 * dx + 0.6 * dy)).abs() < 1e-6 && (across - (0.8 * dy - 0.6 * dx)).abs() < 1e-6);
        assert!((0.0..=10.0).contains(&along) && across.abs() <= 0.5 && height == z);
        let slope = 0.25 * (2.0 + 0.8 * along - 0.6 * across) - 0.5 * (3.0 + 0.6 * along + 0.8 * across);
        assert!((height - slope).abs() < 1e-5, "{row:?}: {slope}");
        assert_eq!((red, intensity), ((x - 5_000_000.0) * 4.0, (y - 600_000.0) * 40.0));
        // A place that is meant is off the point nearest to it in the chart by the root of an eighth of the area of a
        // point there, and along the line, which is nearly level on the slope, by that of half of the square of how far
        // the points of the strip are apart.
        let (area, part_of_normal) = (0.0625 * 1.3125_f64.sqrt(), 0.55 / 1.3125_f64.sqrt());
        let (in_chart, apart) = (area * part_of_normal / 8.0, area * (1.0 - part_of_normal * part_of_normal).sqrt());
        let expected = [in_chart + 0.5 * apart * apart, in_chart].map(|variance| 1.96 * variance.sqrt());
        for (found, expected) in [(of_along, expected[0]), (of_height, expected[1])] {
            assert!((0.9..1.1).contains(&(found / expected)), "{row:?}: {expected}");
        }
    }
    assert!(rows.windows(2).all(|pair| pair[0][0] <= pair[1][0]), "not in order");

    // A scene file's clips and filters hold, and the file has what standard output has.
    folder.write(
        "some.toml",
        "clouds = [\"slope.ply\"]\n[visibility]\nfilters = [{ attribute = \"intensity\", low = 200.0 }]\n[[clips]]\n\
         position = [5000005.0, 600005.0, 0.0]\nsize = [6.0, 20.0, 20.0]\n",
    );
    let outcome = folder.glint(["profile", "some.toml", "-o", "some.csv"].iter().chain(&line));
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let some = table(&std::fs::read_to_string(folder.path("some.csv")).expect("the table"));
    let is_shown = |row: &&Vec<f64>| row[9] >= 200.0 && (5_000_002.0..=5_000_008.0).contains(&row[3]);
    let own = |row: &Vec<f64>| row[..OWN].to_vec();
    let expected: Vec<Vec<f64>> = rows.iter().filter(is_shown).map(own).collect();
    let some: Vec<Vec<f64>> = some.iter().map(own).collect();
    assert!(some == expected && !some.is_empty() && some.len() < rows.len(), "{} of {}", some.len(), rows.len());
}

#[test]
fn a_profile_and_measurements_of_a_moved_cloud_are_of_where_it_stands() {
    let folder = Folder::new();
    folder.write("slope.ply", slope());
    // A quarter of a turn: the slope rises by 0.25 a unit of y, and by 0.5 a unit of x, and is 7 higher.
    let measured = "[[measurements]]\nname = 'p'\nkind = 'plane'\npoints = [[5000010, 600010, 4.5]]\nreach = 4.0\n";
    let own =
        "[[cloud_settings]]\ncloud = 'slope.ply'\nturn = [0, 0, 90]\nabout = [5000010, 600010, 0]\nmove = [0, 0, 7]\n";
    folder.write("turned.toml", format!("clouds = ['slope.ply']\n{own}{measured}"));
    let line = ["--line", "5000000,600004.1,0:5000020,600004.1,0", "--width", "1"];
    let outcome = folder.glint(["profile", "turned.toml"].iter().chain(&line));
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let rows = table(&outcome.text());
    assert!((300..360).contains(&rows.len()), "{} points", rows.len());
    for row in &rows {
        let (x, y) = (row[3] - 5_000_010.0, row[4] - 600_010.0);
        let height = 7.0 - 2.5 + 0.25 * y + 0.5 * x;
        assert!((row[1] - height).abs() < 1e-6 && row[5] == row[1], "{row:?}: {height}");
        // Colours and attributes are those of the point of the file.
        assert!((row[6] - (y + 10.0) * 4.0).abs() < 1e-6 && (row[9] - (10.0 - x) * 40.0).abs() < 1e-5, "{row:?}");
    }
    let outcome = folder.glint(["profile", "turned.toml", "-o", "turned.ply"].iter().chain(&line));
    assert_eq!(outcome.text(), format!("turned.ply: {} points\n", rows.len()), "{outcome}");
    let outcome = folder.glint(["measure", "turned.toml", "--json"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let report = outcome.json();
    let values = report["measurements"][0]["values"].as_array().expect("a list");
    let value =
        |name: &str| values.iter().find(|value| value["name"] == name).and_then(|value| value["value"].as_f64());
    let length = (0.5_f64.powi(2) + 0.25_f64.powi(2) + 1.0).sqrt();
    for (name, expected) in [("normal x", -0.5 / length), ("normal y", -0.25 / length), ("rms", 0.0)] {
        assert!(value(name).is_some_and(|value| (value - expected).abs() < 1e-6), "{name}: {report}");
    }
}

#[test]
fn a_profile_is_drawn_and_its_points_are_written_as_files() {
    let folder = Folder::new();
    folder.write("slope.ply", slope());
    // No point lies on the border of the section, where rounding decides whether it is inside.
    let line = ["--line", "5000002.01,600003.02,0:5000010,600009,0:5000012,600003.1,0", "--width", "1.06"];
    let run = |output: &str| {
        let words = ["profile", "slope.ply", "-o", output];
        let outcome = folder.glint(words.iter().chain(&line));
        assert_eq!(outcome.status, Some(0), "{outcome}");
    };
    run("some.csv");
    let rows = table(&std::fs::read_to_string(folder.path("some.csv")).expect("the table"));
    // The chart has a dot for each point, in the colours of the file.
    run("some.svg");
    let drawn = std::fs::read_to_string(folder.path("some.svg")).expect("the chart");
    assert_eq!(drawn.matches("<circle").count(), rows.len());
    assert!(drawn.contains(&format!("profile: {} points", rows.len())), "{}", &drawn[..400]);
    let red = rows[0][6] as u8;
    assert!(drawn.contains(&format!("fill=\"#{red:02X}141E\"")), "{red}: {}", &drawn[..2000]);
    run("some.png");
    let picture = std::fs::read(folder.path("some.png")).expect("the picture");
    assert_eq!(&picture[1..4], b"PNG");
    // The file of points has those of the table, with their attributes.
    run("some.laz");
    let back = folder.glint(["profile", "some.laz", "--line", "5e6,600000,0:5000030,600000,0", "--width", "100"]);
    let text = String::from_utf8_lossy(&back.output).into_owned();
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().expect("names");
    let columns =
        ["x", "y", "intensity"].map(|name| names.iter().position(|known| *known == name).expect("the column"));
    let thousandths = |text: &str| (text.parse::<f64>().expect("a number") * 1000.0).round() as i64;
    let mut points: Vec<[i64; 3]> = lines.map(|row| columns.map(|column| thousandths(row[column]))).collect();
    let mut expected: Vec<[i64; 3]> =
        rows.iter().map(|row| [row[3], row[4], row[9]].map(|value| (value * 1000.0).round() as i64)).collect();
    points.sort_unstable();
    expected.sort_unstable();
    assert_eq!(points, expected);
    let again = folder.glint(["profile", "slope.ply", "-o", "some.laz"].iter().chain(&line));
    assert!(again.status != Some(0) && again.messages.contains("some.laz"), "a file is not replaced: {again}");
}

#[test]
fn several_sections_make_one_table_one_chart_and_one_file() {
    let folder = Folder::new();
    folder.write("slope.ply", slope());
    let run = |words: &[&str]| {
        let outcome = folder.glint(["profile"].iter().chain(words));
        assert_eq!(outcome.status, Some(0), "{outcome}");
        String::from_utf8_lossy(&outcome.output).into_owned()
    };
    // Along x, each section is a row of points, and the copies are two rows to the left: 0.5 in y, -0.25 in height.
    let line = ["slope.ply", "--line", "5000002,600003,0:5000004,600003,0", "--width", "0.1"];
    let stack = [&line[..], &["--copies", "2", "--spacing", "0.5"]].concat();
    let text = run(&stack);
    let mut rows = text.lines().map(|row| row.split(',').collect::<Vec<_>>());
    assert_eq!(rows.next().expect("names")[..3], ["profile", "along", "height"]);
    let rows: Vec<Vec<&str>> = rows.collect();
    let of = |name: &str| -> Vec<(f64, f64)> {
        let own = rows.iter().filter(|row| row[0] == name);
        own.map(|row| (row[1].parse().expect("along"), row[2].parse().expect("height"))).collect()
    };
    let (first, second, third) = (of("profile"), of("profile 2"), of("profile 3"));
    assert_eq!((first.len(), second.len(), third.len(), rows.len()), (9, 9, 9, 27));
    for (index, (along, height)) in first.iter().enumerate() {
        let (step, base) = (index as f64 * 0.25, 0.5 - 1.5 + index as f64 * 0.0625);
        assert!((along - step).abs() < 1e-6 && (height - base).abs() < 1e-6, "{along} {height}");
        assert!((second[index].1 - base + 0.25).abs() < 1e-6 && (third[index].1 - base + 0.5).abs() < 1e-6);
    }
    run(&[&stack[..], &["-o", "stack.svg"]].concat());
    let drawn = std::fs::read_to_string(folder.path("stack.svg")).expect("the chart");
    assert!(drawn.contains("3 profiles: 27 points") && drawn.contains("profile 3"), "{}", &drawn[..600]);
    run(&[&stack[..], &["-o", "stack.ply"]].concat());
    let back = run(&["stack.ply", "--line", "5000000,600000,0:5000030,600000,0", "--width", "100"]);
    assert_eq!(back.lines().count(), 28, "each point once");

    // The report has the sections without their points.
    let extents = |text: String| {
        let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let range = |range: &serde_json::Value| [0, 1].map(|end| range[end].as_f64().expect("a number"));
        let section = |own: &serde_json::Value| {
            let name = own["name"].as_str().expect("a name").to_owned();
            (name, own["points"].as_u64(), range(&own["along"]), range(&own["height"]))
        };
        let sections: Vec<_> = report["profiles"].as_array().expect("a list").iter().map(section).collect();
        (report["path"].clone(), sections)
    };
    let ends = |points: &[(f64, f64)]| {
        let (first, last) = (points[0], points[points.len() - 1]);
        (Some(points.len() as u64), [first.0, last.0], [first.1, last.1])
    };
    let expected: Vec<_> = [("profile", &first), ("profile 2", &second), ("profile 3", &third)]
        .map(|(name, points)| (name.to_owned(), ends(points)))
        .map(|(name, (points, along, height))| (name, points, along, height))
        .into();
    assert_eq!(extents(run(&[&stack[..], &["--json"]].concat())), (serde_json::Value::Null, expected.clone()));
    for name in ["told.csv", "told.png", "told.laz"] {
        let told = extents(run(&[&stack[..], &["--json", "-o", name]].concat()));
        assert!(told == (name.into(), expected.clone()) && folder.path(name).exists(), "{name}: {told:?}");
    }
    // Only a table has intervals, of which the report has the medians, and none where profiles are thinner than half of
    // the distance between points: then a warning says so.
    for (name, width, is_known) in
        [("certain.csv", "0.3", true), ("certain.png", "0.3", false), ("thin.csv", "0.1", false)]
    {
        let words =
            [&["profile"][..], &line[..line.len() - 1], &[width], &stack[line.len()..], &["--json", "-o", name]];
        let outcome = folder.glint(&words.concat());
        assert_eq!(outcome.status, Some(0), "{outcome}");
        assert_eq!(outcome.messages.contains("27 of 27 points have no intervals"), name == "thin.csv", "{outcome}");
        for own in outcome.json()["profiles"].as_array().expect("a list") {
            let [along, height] = ["along_interval", "height_interval"].map(|key| own[key].as_f64());
            let is_plausible = |interval: Option<f64>| interval.is_some_and(|interval| (0.01..0.5).contains(&interval));
            assert!(is_plausible(along) == is_known && is_plausible(height) == is_known, "{name}: {own}");
            assert!(is_known || along.is_none() && height.is_none(), "{name}: {own}");
        }
    }

    // The profiles of a scene file, of which one is switched off.
    folder.write(
        "walls.toml",
        "clouds = [\"slope.ply\"]\n[[profiles]]\nname = \"north\"\nwidth = 0.1\nline = [[5000002.0, 600003.0, 0.0], \
         [5000004.0, 600003.0, 0.0]]\n[[profiles]]\nname = \"east\"\nwidth = 0.1\nline = [[5000002.0, 600004.0, 0.0], \
         [5000003.0, 600004.0, 0.0]]\n[[profiles]]\nname = \"off\"\non = false\nwidth = 9.0\nline = [[5000002.0, \
         600004.0, 0.0], [5000003.0, 600004.0, 0.0]]\n",
    );
    let text = run(&["walls.toml"]);
    let of = |name: &str| text.lines().filter(|row| row.starts_with(name)).count();
    assert_eq!((of("north,"), of("east,"), of("off,"), text.lines().count()), (9, 5, 0, 15));
    for (words, mentioned) in [
        (vec!["slope.ply"], "no profile is asked for"),
        ([&line[..], &["--copies", "2"]].concat(), "--spacing"),
        (vec!["walls.toml", "--copies", "2", "--spacing", "1"], "--line"),
        ([&line[..], &["--copies", "1000", "--spacing", "1"]].concat(), "100"),
        ([&line[..], &["--copies", "2", "--spacing", "nan"]].concat(), "expected a finite distance"),
    ] {
        let outcome = folder.glint(["profile"].iter().chain(&words));
        assert!(outcome.status == Some(2) && outcome.messages.contains(mentioned), "{mentioned}: {outcome}");
    }
}

#[test]
fn stray_points_are_in_no_section_if_they_are_hidden() {
    let folder = Folder::new();
    let mut rows = slope();
    rows = rows.replace("vertex 6561", "vertex 6562");
    rows += "5000010 600010 60 1 1 1 1\n";
    folder.write("slope.ply", rows);
    let line = ["profile", "slope.ply", "--line", "5000002,600010,0:5000018,600010,0", "--width", "0.1"];
    let count = |more: &[&str]| {
        let outcome = folder.glint(line.iter().chain(more));
        assert_eq!(outcome.status, Some(0), "{outcome}");
        String::from_utf8_lossy(&outcome.output).lines().count() - 1
    };
    assert_eq!((count(&[]), count(&["--set", "splat.strays=hidden"])), (66, 65));
    let words = [&line[..], &["--set", "splat.strays=hidden", "-o", "some.laz"]].concat();
    let outcome = folder.glint(&words);
    assert!(String::from_utf8_lossy(&outcome.output).contains("65 points"), "{outcome}");
}

#[test]
fn a_profile_that_cannot_be_made_is_refused() {
    let folder = Folder::new();
    folder.write("slope.ply", slope());
    let refused = |arguments: &[&str], mentioned: &str| {
        let outcome = folder.glint(["profile", "slope.ply"].iter().chain(arguments));
        assert_eq!(outcome.status, Some(2), "{outcome}");
        assert!(outcome.messages.contains(mentioned), "{mentioned}: {outcome}");
    };
    refused(&["--width", "1"], "--line");
    refused(&["--line", "0,0,0", "--width", "1"], "expected at least 2");
    refused(&["--line", "0,0:1,1", "--width", "1"], "expected X,Y,Z");
    refused(&["--line", "0,0,0:0,0,1", "--width", "1"], "above one another");
    refused(&["--line", "0,0,0:1,0,0", "--width", "0"], "width of 0");
    refused(&["--line", "0,0,0:1,0,0", "--width", "1", "-o", "a.txt"], ".csv");
    let empty = folder.glint(["profile", "slope.ply", "--line", "0,0,0:1,0,0", "--width", "1"]);
    assert!(empty.status == Some(0) && empty.messages.contains("holds no points"), "{empty}");
    let told = folder.glint(["profile", "slope.ply", "--line", "0,0,0:1,0,0", "--width", "1", "--json"]).json();
    let nothing = serde_json::json!([{
        "name": "profile", "points": 0, "along": null, "height": null, "along_interval": null, "height_interval": null,
    }]);
    assert!(told["profiles"] == nothing && told["unit"].is_null(), "{told}");
    assert_eq!(table(&String::from_utf8_lossy(&empty.output)).len(), 0);
}
