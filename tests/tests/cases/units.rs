//! Units and coordinate systems, and clouds that lie far apart.

use serde_json::Value;
use tests::Folder;

/// The units that `glint info` reports for a case, level and height, and its warnings.
fn units(name: &str) -> Option<(Value, Value, String)> {
    let path = crate::folder()?.join(name);
    let report = Folder::new().glint(["info".as_ref(), "--json".as_ref(), path.as_os_str()]).json();
    let entry = &report["inputs"][0];
    Some((entry["units"]["horizontal"].clone(), entry["units"]["vertical"].clone(), entry["warnings"].to_string()))
}

fn assert_units(name: &str, level: &str, height: Option<&str>) {
    let Some((found, found_height, warnings)) = units(name) else { return };
    assert_eq!((found.as_str(), found_height.as_str()), (Some(level), height), "{name}: {warnings}");
}

#[test]
fn wkt_2_of_a_geodetic_system_says_degrees() {
    assert_units("13_las_wkt2_2015_geodcrs_degrees.las", "deg", None);
}

#[test]
fn wkt_2_in_record_4224_says_its_units() {
    assert_units("13_las_wkt2_in_record_4224.las", "m", Some("m"));
}

#[test]
fn a_user_defined_unit_has_the_size_of_key_3077() {
    let Some((level, ..)) = units("13_las_geotiff_user_unit_size_3077.las") else { return };
    assert_eq!(level, "ftUS");
}

#[test]
fn the_wkt_bit_says_which_of_two_systems_counts() {
    let name = "13_las_geotiff_and_stale_wkt_bit_clear.las";
    let Some((level, _, warnings)) = units(name) else { return };
    assert_eq!(level, "m", "{warnings}");
    assert!(warnings.contains("the WKT bit is clear: GeoTIFF counts"), "{warnings}");
    // The same file with the bit set.
    let folder = Folder::new();
    let mut bytes = std::fs::read(crate::folder().expect("it was there").join(name)).expect("the case");
    bytes[6] |= 16;
    let path = folder.write("set.las", bytes);
    let report = folder.glint(["info".as_ref(), "--json".as_ref(), path.as_os_str()]).json();
    let entry = &report["inputs"][0];
    assert_eq!(entry["units"]["horizontal"], "ftUS");
    assert!(entry["warnings"].to_string().contains("the WKT bit is set: WKT counts"), "{entry}");
}

#[test]
fn heights_have_the_unit_of_their_own_system() {
    let Some(cases) = crate::folder() else { return };
    let folder = Folder::new();
    let report = folder.glint(["measure".as_ref(), "--json".as_ref(), cases.join("11_height.toml").as_os_str()]);
    let values = &report.json()["measurements"][0]["values"];
    assert_eq!((&values[0]["value"], &values[0]["unit"]), (&Value::from(6.0), &Value::from("m")), "{report}");
    assert_eq!((&values[1]["value"], &values[1]["unit"]), (&Value::from(10.0), &Value::from("ftUS")), "{report}");
    let mixed = "the units are mixed: x and y are in ftUS, heights in m";
    assert!(report.messages.contains(mixed), "{report}");
    let file = cases.join("11_las_geotiff_2927_ftus_vertical_5703.las");
    let profile = folder.glint([
        "profile".as_ref(),
        file.as_os_str(),
        "--line=1200000,600000,0:1200100,600000,0".as_ref(),
        "--width=100".as_ref(),
        "--json".as_ref(),
    ]);
    let json = profile.json();
    assert_eq!((json["along_unit"].as_str(), json["height_unit"].as_str()), (Some("ftUS"), Some("m")), "{profile}");
    assert!(json["unit"].is_null() && profile.messages.contains(mixed), "{profile}");
    let info = folder.glint(["info".as_ref(), file.as_os_str()]);
    assert!(info.text().contains("ftUS, heights in m") && info.text().contains(mixed), "{info}");
}

/// A text PLY file of these points.
fn ply(folder: &Folder, name: &str, points: &[[f64; 3]]) -> std::path::PathBuf {
    let axes = "property double x\nproperty double y\nproperty double z\n";
    let rows: String = points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let header = format!("ply\nformat ascii 1.0\nelement vertex {}\n{axes}end_header\n", points.len());
    folder.write(name, header + &rows)
}

/// The pixels of a picture that differ from that of its corner: the middle of them as shares of the picture's size.
fn middle_of_points(picture: &std::path::Path) -> Option<[f64; 2]> {
    let picture = image::open(picture).expect("a picture").into_rgb8();
    let background = picture.get_pixel(0, 0);
    let seen: Vec<[f64; 2]> = picture
        .enumerate_pixels()
        .filter(|(_, _, pixel)| *pixel != background)
        .map(|(x, y, _)| [f64::from(x) + 0.5, f64::from(y) + 0.5])
        .collect();
    let mean =
        |axis: usize, size: u32| seen.iter().map(|at| at[axis]).sum::<f64>() / seen.len() as f64 / f64::from(size);
    (!seen.is_empty()).then(|| [mean(0, picture.width()), mean(1, picture.height())])
}

#[test]
fn points_at_one_place_are_in_the_middle_of_the_picture() {
    let folder = Folder::new();
    let mut files = vec![ply(&folder, "same.ply", &[[512_345.5, 5_412_345.5, 301.5]; 30])];
    files.extend(crate::folder().map(|cases| cases.join("10_ply_one_point.ply")));
    for file in files {
        let picture = folder.path("picture.png");
        let arguments = ["render".as_ref(), file.as_os_str(), "-o".as_ref(), picture.as_os_str()];
        let outcome = folder.glint(arguments.into_iter().chain(["--size=160x120".as_ref()]));
        assert_eq!(outcome.status, Some(0), "{outcome}");
        let middle = middle_of_points(&picture);
        let is_middle = middle.is_some_and(|middle| middle.iter().all(|share| (share - 0.5).abs() < 0.02));
        assert!(is_middle, "{}: {middle:?}\n{outcome}", file.display());
        std::fs::remove_file(picture).expect("the picture");
    }
}

#[test]
fn degrees_beside_metres_are_told_once_with_a_picture() {
    let Some(cases) = crate::folder() else { return };
    let folder = Folder::new();
    let file = cases.join("13_las_wkt2_2015_geodcrs_degrees.las");
    let again = folder.path("again.las");
    std::fs::copy(&file, &again).expect("a copy");
    let told = "the units are mixed: x and y are in °";
    let info = folder.glint(["info".as_ref(), file.as_os_str()]);
    assert_eq!(info.text().matches(told).count(), 1, "{info}");
    let arguments = ["render".as_ref(), file.as_os_str(), again.as_os_str(), "--size=64x64".as_ref(), "-o".as_ref()];
    let render = folder.glint(arguments.into_iter().chain([folder.path("needle.png").as_os_str()]));
    assert_eq!((render.status, render.messages.matches(told).count()), (Some(0), 1), "{render}");
}

#[test]
fn clouds_that_lie_far_apart_keep_the_precision_of_their_distances() {
    let folder = Folder::new();
    let near: Vec<[f64; 3]> = (0..200).map(|index| [f64::from(index) * 0.125, f64::from(index % 7), 0.0]).collect();
    let first = ply(&folder, "first.ply", &near);
    let second = ply(&folder, "second.ply", &[[4_424_000.0, 0.0, 0.0]]);
    let table = folder.path("distances.csv");
    let words = ["compare".as_ref(), first.as_os_str(), second.as_os_str(), "-o".as_ref(), table.as_os_str()];
    let outcome = folder.glint(words);
    assert!(outcome.status == Some(0) && outcome.messages.contains("the clouds lie 4423975 units apart"), "{outcome}");
    let text = std::fs::read_to_string(&table).expect("the table");
    let mut rows = text.lines();
    let column = rows.next().and_then(|head| head.split(',').position(|name| name == "distance")).expect("distances");
    for (row, [x, y, _]) in rows.zip(&near) {
        let distance: f64 = row.split(',').nth(column).and_then(|value| value.parse().ok()).expect("a number");
        assert!((distance - (4_424_000.0 - x).hypot(*y)).abs() < 1e-6, "{row}");
    }
}
