//! `glint study scan` and `glint ghosts`: scans with mirrors, of which the truth is known.

use exr::prelude::read_first_flat_layer_from_file;
use tests::Folder;

const MIRROR: &str = r#"
[[mirrors]]
name = "wall mirror"
shape = { plane = { height = 0.8 } }
position = [3.4, 5.96, 1.6]
rotation = [0.7071067811865476, 0.0, 0.0, 0.7071067811865476]
size = 0.9
"#;

/// Scans the made room with the mirror on its wall.
fn scanned(output: &str, further: &[&str]) -> Folder {
    let folder = Folder::new();
    folder.write("mirror.toml", MIRROR);
    let scan = ["study", "scan", "tripod/room", "--scene", "mirror.toml", "-o", output, "--json"];
    let rays: &[&str] = if further.contains(&"--rays") { &[] } else { &["--rays", "120000"] };
    let outcome = folder.glint(scan.iter().chain(rays).chain(further));
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let report = outcome.json();
    assert!(report["ghosts"].as_u64() > Some(500) && report["points"].as_u64() > Some(100_000), "{report}");
    folder
}

/// The columns of a table.
fn table(folder: &Folder, name: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(folder.path(name)).expect("the table");
    let mut lines = text.lines();
    let names = lines.next().expect("names of columns").split(',').map(str::to_owned).collect();
    (names, lines.map(|line| line.split(',').map(|word| word.parse().unwrap_or(f64::NAN)).collect()).collect())
}

#[test]
fn ghosts_keep_order_and_attributes_and_are_put_back_where_they_are() {
    let folder = scanned("scan.laz", &[]);
    let ghosts = ["ghosts", "scan.laz", "--scene", "mirror.toml", "--station", "2.9,2.6,1.55", "--json"];
    let outcome = folder.glint(ghosts.iter().chain(&["-o", "told.laz", "--put-back"]));
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let report = outcome.json();
    assert_eq!(report["stations"], serde_json::json!([[2.9, 2.6, 1.55]]));
    let mirror = &report["mirrors"][0];
    assert_eq!((&mirror["kind"], &mirror["points"]), (&"plane".into(), &report["ghosts"]));
    assert!(mirror["residual"].as_f64() < Some(0.003) && mirror["parameters"]["position"].is_array(), "{report}");
    assert_eq!((&report["put_back"], &report["undecided"]), (&report["ghosts"], &0.into()));

    for name in ["scan", "told"] {
        let (from, to) = (format!("{name}.laz"), format!("{name}.csv"));
        let outcome = folder.glint(["export", &from, "-o", &to]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
    }
    let ((names, before), (all_names, after)) = (table(&folder, "scan.csv"), table(&folder, "told.csv"));
    let own: Vec<usize> = names.iter().map(|name| all_names.iter().position(|other| other == name).unwrap()).collect();
    let at = |name: &str| all_names.iter().position(|other| other == name).unwrap();
    let [x, y, z, ghost, mirror, error] = ["x", "y", "z", "ghost", "ghost_mirror", "ghost_error"].map(at);
    let [is_true, true_x, true_y, true_z] = ["true_ghost", "true_x", "true_y", "true_z"].map(at);
    for (before, after) in before.iter().zip(&after) {
        assert_eq!(*before, own.iter().map(|column| after[*column]).collect::<Vec<_>>());
        // Mixed pixels are neither.
        assert!(after[is_true] == 2.0 || after[ghost] == after[is_true], "{after:?}");
        assert!(after[mirror] == after[ghost] && after[error].is_nan());
    }
    let (mut within, mut count) = (0, 0);
    let put_back = &after[before.len()..];
    assert_eq!(Some(put_back.len() as u64), report["ghosts"].as_u64());
    for point in put_back.iter().filter(|point| point[is_true] == 1.0) {
        assert!(point[ghost] == 0.0 && point[mirror] == 1.0, "{point:?}");
        let squares = [[x, true_x], [y, true_y], [z, true_z]].map(|[own, truth]| (point[own] - point[truth]).powi(2));
        let off = squares.iter().sum::<f64>().sqrt();
        assert!(off < 0.02, "{point:?}");
        count += 1;
        // The grid of the file rounds by a millimetre.
        within += u32::from(off <= point[error] + 0.001);
    }
    assert!(count > 500 && f64::from(within) > 0.9 * f64::from(count), "{within} of {count}");
    let entries = std::fs::read_dir(folder.path("")).unwrap();
    let left: Vec<String> = entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    assert!(left.iter().all(|name| !name.contains("put-back") && !name.ends_with(".ptx")), "{left:?}");
}

/// A mirror that shows, from the station at (2.9, 2.6, 1.55), more than one wall.
const BALL: &str = r#"
[[mirrors]]
name = "ball"
shape = "sphere"
position = [4.4, 3.9, 1.0]
size = 0.4
"#;

const COLUMN: &str = r#"
[[mirrors]]
name = "column"
shape = { cylinder = { height = 8.0 } }
position = [4.4, 3.9, 1.2]
size = 0.15
"#;

/// The lengths of the way from the station over a mirror to what it shows, in metres, row by row; NaN elsewhere.
fn lengths(folder: &Folder, station: [f64; 3]) -> Vec<f64> {
    let images = ["position", "mirror_position"].map(|name| {
        let path = folder.path(&format!("{name}.exr"));
        let channels = read_first_flat_layer_from_file(path).expect("a float image").layer_data.channel_data.list;
        ["X", "Y", "Z"].map(|name| {
            let channel = channels.iter().find(|channel| channel.name.eq(name)).expect("its channel");
            channel.sample_data.values_as_f32().map(f64::from).collect::<Vec<_>>()
        })
    });
    let [mirror, shown] = &images;
    let apart = |one: [f64; 3], other: [f64; 3]| {
        one.iter().zip(other).map(|(one, other)| (one - other).powi(2)).sum::<f64>().sqrt()
    };
    let at = |image: &[Vec<f64>; 3], pixel: usize| [0, 1, 2].map(|axis: usize| image[axis][pixel]);
    (0..mirror[0].len())
        .map(|pixel| apart(station, at(mirror, pixel)) + apart(at(mirror, pixel), at(shown, pixel)))
        .collect()
}

/// The differences in metres, in order, between the ranges of a made scan's ghosts, which are seen from the eye on the
/// way to the pivot, and the lengths of the way in a picture of the scan's other points with the mirror.
fn range_differences(mirror: &str, pivot: [f64; 3], degrees: f64, noise: &str) -> Option<Vec<f64>> {
    const SIZE: usize = 400;
    let station = [2.9, 2.6, 1.55];
    let folder = Folder::new();
    folder.write("mirror.toml", mirror);
    let scan = ["study", "scan", "tripod/room", "--scene", "mirror.toml", "-o", "scan.laz", "--rays", "400000"];
    let outcome = folder.glint(scan.iter().chain(&["--noise", noise]));
    assert_eq!(outcome.status, Some(0), "{outcome}");
    assert_eq!(folder.glint(["export", "scan.laz", "-o", "scan.csv"]).status, Some(0));
    let scene = format!(
        "clouds = [\"scan.laz\"]\n{mirror}\n[camera]\neye = {station:?}\npivot = {pivot:?}\nup = [0.0, 0.0, 1.0]\n\
         [visibility]\nfilters = [{{ attribute = \"true_ghost\", low = 0.0, high = 0.5 }}]\n"
    );
    folder.write("scene.toml", &scene);
    let images = ["--aov", "position=position.exr", "--aov", "mirror_position=mirror_position.exr"];
    let size = format!("{SIZE}x{SIZE}");
    // Places are asked for, and no light.
    let render = ["render", "scene.toml", "-o", "a.png", "--method", "surfel_trace", "--set", "gi.bounces=0"];
    let outcome = folder.glint(render.iter().chain(&images).chain(&[
        "--size",
        &size,
        "--set",
        &format!("view.field_of_view={degrees}"),
    ]));
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        println!("skipped: no adapter: {}", outcome.messages.trim());
        return None;
    }
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let lengths = lengths(&folder, station);

    let minus = |one: [f64; 3], other: [f64; 3]| [0, 1, 2].map(|axis: usize| one[axis] - other[axis]);
    let dot = |one: [f64; 3], other: [f64; 3]| one.iter().zip(other).map(|(one, other)| one * other).sum::<f64>();
    let unit = |vector: [f64; 3]| vector.map(|value| value / dot(vector, vector).sqrt());
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let forward = unit(minus(pivot, station));
    let right = unit(cross(forward, [0.0, 0.0, 1.0]));
    let down = cross(forward, right);
    let scale = SIZE as f64 / 2.0 / (degrees / 2.0).to_radians().tan();
    let (names, points) = table(&folder, "scan.csv");
    let at = |name: &str| names.iter().position(|other| other == name).expect("its column");
    let [x, y, z, is_ghost] = ["x", "y", "z", "true_ghost"].map(at);
    let mut differences: Vec<f64> = points
        .iter()
        .filter(|point| point[is_ghost] == 1.0)
        .filter_map(|point| {
            let way = minus([point[x], point[y], point[z]], station);
            let ahead = dot(way, forward);
            let place = [right, down].map(|axis| SIZE as f64 / 2.0 + scale * dot(way, axis) / ahead - 0.5);
            let inside = ahead > 0.0 && place.iter().all(|at| (0.0..(SIZE - 1) as f64).contains(at));
            let ([column, row], [u, v]) = (place.map(|at| at.max(0.0) as usize), place.map(f64::fract));
            let near = |dx, dy| lengths.get((row + dy) * SIZE + column + dx).copied().unwrap_or(f64::NAN);
            let corners = [near(0, 0), near(1, 0), near(0, 1), near(1, 1)];
            // The way is as long as it is between pixels only where all four show one surface.
            let bent = (corners[0] + corners[3] - corners[1] - corners[2]).abs();
            let between =
                (1.0 - v) * ((1.0 - u) * corners[0] + u * corners[1]) + v * ((1.0 - u) * corners[2] + u * corners[3]);
            (inside && bent < 0.005).then(|| (dot(way, way).sqrt() - between).abs())
        })
        .collect();
    differences.sort_by(f64::total_cmp);
    Some(differences)
}

/// The median and the 95th percentile of `range_differences` in millimetres, for a plane, a ball and a column.
fn loop_errors(noise: &str) -> Option<Vec<[f64; 2]>> {
    let cases = [
        ("plane", MIRROR, [3.4, 5.96, 1.6], 40.0),
        ("ball", BALL, [4.4, 3.9, 1.0], 40.0),
        ("column", COLUMN, [4.4, 3.9, 1.2], 10.0),
    ];
    let errors = cases.map(|(name, mirror, pivot, degrees)| {
        let differences = range_differences(mirror, pivot, degrees, noise)?;
        assert!(differences.len() > 300, "{name}");
        let errors = [0.5, 0.95].map(|share| 1000.0 * differences[(share * (differences.len() - 1) as f64) as usize]);
        println!("{name}, noise of {noise} m: {} ghosts, median and 95 %, mm: {errors:.2?}", differences.len());
        Some(errors)
    });
    errors.into_iter().collect()
}

#[test]
fn pictures_with_a_mirror_show_the_ranges_that_the_scanner_wrote_down() {
    let errors = loop_errors("0").unwrap_or_default();
    // A column shows much of a room in few pixels, so that some of its ghosts lie beside edges of what is seen in it.
    let right = errors.iter().zip([2.0, 2.0, 25.0]).all(|([median, p95], most)| *median < 0.5 && *p95 < most);
    assert!(right, "{errors:?}");
}

#[test]
#[ignore = "prints figures of docs/ghosts.md"]
fn pictures_of_noisy_scans_show_the_ranges_that_the_scanner_wrote_down() {
    loop_errors("0.002");
}

#[test]
fn stations_come_from_the_file_where_it_has_them() {
    let stations = ["--station", "2.9,2.6,1.55", "--station", "6.9,5.1,1.55"];
    let folder = scanned("scans.e57", &stations);
    let outcome =
        folder.glint(["ghosts", "scans.e57", "--scene", "mirror.toml", "--json", "-o", "told.e57", "--put-back"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let report = outcome.json();
    assert_eq!(report["stations"].as_array().map(Vec::len), Some(2), "{report}");
    assert!(report["ghosts"].as_u64() > Some(500), "{report}");
    let info = folder.glint(["info", "told.e57", "--json"]).json();
    assert!(info.to_string().contains("ghost_mirror"), "{info}");
}

#[test]
fn a_mirror_that_nobody_names_is_found_and_a_reason_is_given() {
    let folder = scanned("scan.laz", &["--rays", "400000"]);
    let outcome = folder.glint(["ghosts", "scan.laz", "--station", "2.9,2.6,1.55", "--json"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let report = outcome.json();
    let mirrors = report["mirrors"].as_array().unwrap();
    assert!(mirrors.len() == 1 && mirrors[0]["kind"] == "plane", "{report}");
    let height = mirrors[0]["parameters"]["position"][1].as_f64().unwrap();
    assert!((height - 5.96).abs() < 0.002, "{report}");
    assert!(mirrors[0]["reason"].as_str().unwrap().starts_with("found: "), "{report}");
}

#[test]
fn what_is_missing_is_named() {
    let folder = scanned("scan.ply", &[]);
    let fails = |words: &[&str], expected: &str| {
        let outcome = folder.glint(["ghosts", "scan.ply"].iter().chain(words));
        assert_eq!(outcome.status, Some(2), "{outcome}");
        assert!(outcome.messages.contains(expected), "{outcome}");
    };
    fails(&["--scene", "mirror.toml"], "where the scanner stood; say so with --station X,Y,Z");
    let station = ["--scene", "mirror.toml", "--station", "2.9,2.6,1.55"];
    fails(&[&station[..], &["--put-back"]].concat(), "--put-back: name the file");
    fails(&[&station[..], &["-o", "scan.txt"]].concat(), "the name must end in");
    fails(&[&station[..], &["-o", "scan.ply"]].concat(), "a file of this name is there");
    let outcome = folder.glint(["ghosts", "tripod/room", "--station", "2.9,2.6,1.55"]);
    let expected = "this command reads files; `glint study scan tripod/room -o scan.laz` writes one";
    assert!(outcome.status == Some(2) && outcome.messages.contains(expected), "{outcome}");
    let outcome = folder.glint(["study", "scan", "five-mirrors/sphere", "-o", "other.laz"]);
    assert!(outcome.status == Some(2) && outcome.messages.contains("no made scan"), "{outcome}");
}
