//! Colours, origins and names of files that other programs wrote.

use std::path::Path;

use serde_json::Value;
use tests::{Folder, Outcome};

fn text(path: &Path) -> String {
    path.to_str().expect("a name in UTF-8").to_owned()
}

/// What the program says of an input that it can read.
fn success(outcome: Outcome) -> Outcome {
    assert!(outcome.status == Some(0), "{outcome}");
    outcome
}

/// What `glint info` says of one file.
fn info(folder: &Folder, path: &Path) -> Value {
    success(folder.glint(["info", "--json", "--scan", &text(path)])).json()["inputs"][0].clone()
}

/// The columns of a table that an export gives, by their names.
fn table(folder: &Folder, input: &Path, columns: &[&str]) -> Vec<Vec<f64>> {
    let output = folder.path("table.csv");
    success(folder.glint(["export", &text(input), "-o", &text(&output)]));
    let table = std::fs::read_to_string(&output).expect("a table");
    std::fs::remove_file(output).expect("a file that is there");
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().expect("a head").split(',').collect();
    let place = |name: &&str| names.iter().position(|known| known == name).unwrap_or_else(|| panic!("{names:?}"));
    let places: Vec<usize> = columns.iter().map(place).collect();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        places.iter().map(|place| cells[*place].parse().unwrap_or(f64::NAN)).collect()
    };
    lines.map(row).collect()
}

/// Full brightness in a table of colours, which has 8 bits or 16.
fn full_of(table: &[Vec<f64>]) -> f64 {
    if table.iter().flatten().any(|value| *value > 255.0) { 65_535.0 } else { 255.0 }
}

/// A PLY file of points in a row, each with further numbers. `properties` has their types and names.
fn ply(properties: &[&str], rows: impl Iterator<Item = String> + Clone) -> String {
    let count = rows.clone().count();
    let more: String = properties.iter().map(|property| format!("property {property}\n")).collect();
    let rows: String = rows.enumerate().map(|(index, row)| format!("{} 0 0 {row}\n", index as f64 * 0.1)).collect();
    format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n{more}\
         end_header\n{rows}"
    )
}

#[test]
fn one_value_above_the_range_of_float_colours_leaves_the_others_as_they_are() {
    let Some(cases) = crate::folder() else { return };
    let path = cases.join("01_ply_float_colours_one_value_1.0000001.ply");
    let bytes = std::fs::read(&path).expect("a case");
    let head = bytes.windows(11).position(|end| end == b"end_header\n").expect("a header") + 11;
    let float = |row: &[u8], at: usize| f32::from_le_bytes([row[at], row[at + 1], row[at + 2], row[at + 3]]);
    let rows = bytes[head..].chunks_exact(24);
    let own: Vec<[f32; 3]> = rows.map(|row| [12, 16, 20].map(|at| float(row, at))).collect();
    let folder = Folder::new();
    let las = folder.path("colours.las");
    success(folder.glint(["export", &text(&path), "-o", &text(&las)]));
    let found = table(&folder, &las, &["red", "green", "blue"]);
    assert_eq!((own.len(), found.len()), (4000, 4000));
    let full = full_of(&found);
    for (own, found) in own.iter().flatten().zip(found.iter().flatten()) {
        assert!((found / full - f64::from(own.clamp(0.0, 1.0))).abs() < 0.005, "{found} for {own}");
    }
}

#[test]
fn one_percent_of_256_among_bytes_leaves_the_colours_of_eight_bits() {
    let Some(cases) = crate::folder() else { return };
    let path = cases.join("01_las_rgb8_one_percent_256.las");
    let folder = Folder::new();
    let points = folder.path("colours.ply");
    success(folder.glint(["export", &text(&path), "-o", &text(&points)]));
    let found = table(&folder, &points, &["red", "green", "blue"]);
    assert_eq!(found.len(), 5000);
    let values = || found.iter().flatten();
    // The upper bytes of the fields would be 0 and 1.
    let mean = values().sum::<f64>() / values().count() as f64;
    assert!(values().all(|value| *value <= 255.0) && mean > 60.0, "{mean}");
}

#[test]
fn colours_of_ten_and_twelve_bits_are_bright_and_told() {
    let folder = Folder::new();
    for bits in [10_u32, 12] {
        let full = (1_u32 << bits) - 1;
        let shade = |index: u32| format!("{0} {0} {0}", index * full / 999);
        let file = ply(&["ushort red", "ushort green", "ushort blue"], (0..1000).map(shade));
        let path = folder.write("deep.ply", file);
        let las = folder.path(&format!("{bits}.las"));
        let outcome = success(folder.glint(["export", &text(&path), "-o", &text(&las)]));
        assert!(outcome.messages.contains(&format!("colours of {bits} bits")), "{outcome}");
        let found = table(&folder, &las, &["red"]);
        for (index, row) in found.iter().enumerate() {
            let share = row[0] / full_of(&found);
            assert!((share - index as f64 / 999.0).abs() < 0.008, "{bits} bits: {} at {index}", row[0]);
        }
    }
}

#[test]
fn a_first_vertex_at_zero_among_coordinates_of_a_map_leaves_the_room_as_it_is() {
    let Some(cases) = crate::folder() else { return };
    let found = info(&Folder::new(), &cases.join("02_ply_double_utm_first_vertex_000.ply"));
    let noise = found["neighbourhoods"]["noise"].as_f64().unwrap_or(f64::NAN);
    assert!((0.0005..0.002).contains(&noise), "{found}");
}

#[test]
fn decimal_commas_are_an_error_that_names_the_line() {
    let Some(cases) = crate::folder() else { return };
    let folder = Folder::new();
    for command in ["info", "export"] {
        let path = text(&cases.join("14_ply_decimal_commas.ply"));
        let output = text(&folder.path("out.las"));
        let more = if command == "export" { vec!["-o", &output] } else { vec![] };
        let outcome = folder.glint([command, &path].into_iter().chain(more));
        assert!(outcome.status == Some(2), "{outcome}");
        assert!(outcome.messages.contains("line 8: `25,003819` has a decimal comma"), "{outcome}");
    }
}

#[test]
fn compressed_splats_are_points_with_colours() {
    let Some(cases) = crate::folder() else { return };
    let path = cases.join("14_ply_supersplat_compressed.ply");
    let folder = Folder::new();
    let found = info(&folder, &path);
    assert_eq!(found["points"], 512, "{found}");
    let places = table(&folder, &path, &["x", "y", "z", "scale_0", "f_dc_0", "opacity"]);
    assert!(places.len() == 512 && places.iter().flatten().all(|value| value.is_finite()));
    // Each lies within the ranges of its 256 neighbours.
    let bytes = std::fs::read(&path).expect("a case");
    let head = bytes.windows(11).position(|end| end == b"end_header\n").expect("a header") + 11;
    let range = |at: usize| f64::from(f32::from_le_bytes(bytes[head + at..head + at + 4].try_into().expect("4 bytes")));
    for (index, place) in places.iter().enumerate() {
        for axis in 0..3 {
            let at = index / 256 * 48 + axis * 4;
            assert!(place[axis] >= range(at) - 1e-5 && place[axis] <= range(at + 12) + 1e-5, "{index}: {place:?}");
        }
    }
}

#[test]
fn names_of_cloudcompare_are_those_that_filters_and_classes_ask_for() {
    let folder = Folder::new();
    let properties = ["float scalar_Intensity", "float scalar_Classification", "float scalar_GpsTime"];
    let row = |index: u32| format!("{index} {} {}", if index < 100 { 7 } else { 2 }, f64::from(index) * 0.5);
    let path = folder.write("scalars.ply", ply(&properties, (0..1000).map(row)));
    for (rule, count) in [
        ("filters = [{ attribute = \"intensity\", low = 900.0 }]", 100),
        ("filters = [{ attribute = \"scalar_Intensity\", low = 900.0 }]", 100),
        ("filters = [{ attribute = \"gps_time\", high = 10.0 }]", 21),
        ("hidden_classes = [7]", 900),
    ] {
        let scene = folder.write("scene.toml", format!("clouds = [\"scalars.ply\"]\n[visibility]\n{rule}\n"));
        let output = folder.path("out.ply");
        success(folder.glint(["export", &text(&scene), "-o", &text(&output)]));
        assert_eq!(info(&folder, &output)["points"], count, "{rule}");
        std::fs::remove_file(output).expect("a file that is there");
    }
    assert!(path.is_file());
}

#[test]
fn hidden_names_in_a_folder_are_no_tiles_and_a_link_to_nothing_is_named() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("tiles")).expect("a folder");
    for name in ["a.ply", "b.ply"] {
        folder.write(&format!("tiles/{name}"), ply(&["uchar wet"], (0..30).map(|index| index.to_string())));
        folder.write(&format!("tiles/._{name}"), [0, 5, 0x16, 7, 0, 2, 0, 0]);
    }
    folder.write("tiles/.partial.las", "");
    let outcome = success(folder.glint(["info", "--json", "tiles"]));
    assert_eq!(outcome.json()["inputs"].as_array().map(Vec::len), Some(2), "{outcome}");
    let alone = folder.glint(["info", "tiles/._a.ply"]);
    assert!(alone.status == Some(2) && alone.messages.contains("AppleDouble"), "{alone}");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("../gone.ply", folder.path("tiles/c.ply")).expect("a link");
        let outcome = folder.glint(["info", "tiles/c.ply"]);
        assert!(outcome.status == Some(2) && !outcome.messages.contains("did you mean"), "{outcome}");
        assert!(outcome.messages.contains("c.ply: a link to ../gone.ply, which leads to nothing"), "{outcome}");
        let outcome = folder.glint(["info", "tiles"]);
        assert!(outcome.status == Some(2) && outcome.messages.contains("c.ply"), "a tile is missed: {outcome}");
        assert!(outcome.messages.contains("c.ply: a link to ../gone.ply, which leads to nothing"), "{outcome}");
    }
}

#[test]
fn a_byte_order_mark_before_a_header_is_passed_over() {
    let folder = Folder::new();
    let file = ply(&["uchar wet"], (0..30).map(|index| index.to_string()));
    for before in ["\u{feff}", "\n", "  "] {
        let path = folder.write("marked.ply", format!("{before}{file}"));
        assert_eq!(info(&folder, &path)["points"], 30, "{before:?}");
    }
}
