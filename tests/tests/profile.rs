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

/// The columns by name.
fn table(text: &str) -> Vec<Vec<f64>> {
    let mut lines = text.lines();
    let names = "along,height,across,x,y,z,red,green,blue,intensity";
    assert_eq!(lines.next(), Some(names));
    lines.map(|line| line.split(',').map(|value| value.parse().expect("a number")).collect()).collect()
}

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
        let [along, height, across, x, y, z, red, _, _, intensity] = row[..] else { panic!("{row:?}") };
        let (dx, dy) = (x - 5_000_002.0, y - 600_003.0);
        // The line runs along (0.8, 0.6), and its left is (-0.6, 0.8).
        assert!((along - (0.8 * dx + 0.6 * dy)).abs() < 1e-6 && (across - (0.8 * dy - 0.6 * dx)).abs() < 1e-6);
        assert!((0.0..=10.0).contains(&along) && across.abs() <= 0.5 && height == z);
        let slope = 0.25 * (2.0 + 0.8 * along - 0.6 * across) - 0.5 * (3.0 + 0.6 * along + 0.8 * across);
        assert!((height - slope).abs() < 1e-5, "{row:?}: {slope}");
        assert_eq!((red, intensity), ((x - 5_000_000.0) * 4.0, (y - 600_000.0) * 40.0));
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
    let expected: Vec<Vec<f64>> = rows.iter().filter(is_shown).cloned().collect();
    assert!(some == expected && !some.is_empty() && some.len() < rows.len(), "{} of {}", some.len(), rows.len());
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
    assert_eq!(table(&String::from_utf8_lossy(&empty.output)).len(), 0);
}
