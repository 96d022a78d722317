//! `glint study scan` and `glint ghosts`: scans with mirrors, of which the truth is known.

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
    let outcome = folder.glint(["study", "scan", "five-mirrors/sphere", "-o", "other.laz"]);
    assert!(outcome.status == Some(2) && outcome.messages.contains("no made scan"), "{outcome}");
}
