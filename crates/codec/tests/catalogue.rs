//! Reads and writes catalogues of tiles.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;
#[path = "../../../tests/src/server.rs"]
#[allow(dead_code, reason = "other tests use all of it")]
mod server;

use std::fs;
use std::io::Write as _;
use std::path::Path;

use cloud::{Bounds, Progress};
use codec::{CatalogueTile, Source};
use glam::DVec3;

const MEMORY: u64 = 1 << 28;

fn message(path: &Path) -> String {
    codec::open_scans(path, MEMORY).err().map(|error| error.to_string()).unwrap_or_default()
}

/// Writes a catalogue of two tiles of two points each, of which one lies in a folder.
fn write(folder: &Path, output: &Path) {
    let head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\n";
    fs::create_dir_all(folder.join("tiles")).unwrap();
    let paths = ["tiles/a.ply", "b.ply"].map(|name| folder.join(name));
    fs::write(&paths[0], format!("{head}end_header\n0 0 0\n10 20 30\n")).unwrap();
    fs::write(&paths[1], format!("{head}end_header\n10 0 0\n20 20 30\n")).unwrap();
    let sources = paths.map(|path| codec::open(&path).unwrap());
    let tile = |source| {
        let bounds = codec::bounds_of(source, &Progress::default()).unwrap().unwrap();
        CatalogueTile { info: Source::info(source), points: 2, bounds }
    };
    codec::write_catalogue(&sources.iter().map(tile).collect::<Vec<_>>(), output).unwrap();
}

#[test]
fn a_catalogue_that_was_written_opens_its_tiles() {
    let folder = tempfile::tempdir().unwrap();
    for (name, reference) in [("all.vpc", "\"./tiles/a.ply\""), ("tiles/all.vpc", "\"./../b.ply\"")] {
        let output = folder.path().join(name);
        write(folder.path(), &output);
        let text = fs::read_to_string(&output).unwrap();
        assert!(text.contains(reference) && text.contains("\"pc:count\":2"), "{text}");
        let opened = codec::open_scans(&output, MEMORY).unwrap();
        let names: Vec<String> = opened.iter().map(|source| source.info().name()).collect();
        assert_eq!(names, ["a.ply", "b.ply"]);
        assert!(opened.iter().all(|source| source.info().points == 2 && source.info().warnings.is_empty()));
    }
}

#[test]
fn a_tile_that_is_missing_or_has_changed_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("all.vpc");
    write(folder.path(), &output);
    let text = fs::read_to_string(&output).unwrap().replace("\"pc:count\":2", "\"pc:count\":3");
    fs::write(&output, text).unwrap();
    fs::remove_file(folder.path().join("b.ply")).unwrap();
    let opened = codec::open_scans(&output, MEMORY).unwrap();
    assert_eq!(opened.len(), 1);
    let (told, lost) = (opened[0].info().warnings.join("\n"), opened[0].info().lost.join("\n"));
    assert!(told.starts_with("the catalogue ") && told.ends_with("all.vpc says 3 points, the file has 2"), "{told}");
    assert!(lost.contains("all.vpc: a tile is missing: ") && lost.contains("b.ply"), "{lost}");
    fs::remove_file(folder.path().join("tiles/a.ply")).unwrap();
    assert!(message(&output).contains("a.ply"), "{}", message(&output));
}

#[test]
fn what_a_catalogue_says_of_a_tile_is_used_where_it_can_be_true() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.vpc");
    let entry = |properties: &str| {
        let item = format!(r#"{{"properties":{{{properties}}},"assets":{{"data":{{"href":"a.laz"}}}}}}"#);
        fs::write(&path, format!(r#"{{"type":"FeatureCollection","features":[{item}]}}"#)).unwrap();
        let entry = codec::tiles_of(&path).unwrap().unwrap().remove(0);
        (entry.points, entry.bounds.map(|bounds| bounds.max.x))
    };
    let bounds = |text: &str| format!(r#""pc:count":3,"proj:bbox":{text}"#);
    assert_eq!(entry(&bounds("[0,0,0,7,1,1]")), (Some(3), Some(7.0)));
    let many = format!("[{}0]", "0,".repeat(1_000_000));
    for text in
        ["[0,0,7,1]", "[0,0,0,null,1,1]", "[9,0,0,7,1,1]", "[0,0,0,7,1,1,1]", "\"x\"", "{}", "null", "true", &many]
    {
        assert_eq!(entry(&bounds(text)), (Some(3), None), "{text:.20}");
    }
    assert_eq!(entry(r#""pc:count":"many""#), (None, None));
}

#[test]
fn a_catalogue_that_is_none_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.vpc");
    let items = |items: &str| format!(r#"{{"type":"FeatureCollection","features":[{items}]}}"#);
    for (text, problem) in [
        (items(""), "a catalogue without tiles"),
        (r#"{"type":"Feature","features":[]}"#.into(), "a `Feature`, expected a FeatureCollection"),
        (items(r#"{"assets":{}}"#), "item 0: no reference to a file"),
        (items(r#"{"assets":{"data":{"href":7}}}"#), "not a collection of items: invalid type: integer `7`"),
        (items(&format!("{}{{}}", "{},".repeat(1_000_000))), "more than 100000 tiles"),
        (r#"{"type":"FeatureCollection""#.into(), "not a collection of items"),
        // A catalogue that names itself.
        (items(r#"{"assets":{"data":{"href":"a.vpc"}}}"#), "a catalogue among the tiles"),
    ] {
        fs::write(&path, &text).unwrap();
        assert!(message(&path).contains(problem), "{problem}: {}", message(&path));
    }
    let Some(data) = real_data::test_data() else { return };
    let told = message(&data.join("text/wrench.vpc"));
    assert!(told.contains("autzen_trim.laz"), "{told}");
}

#[test]
fn a_tile_has_its_box_in_degrees_for_other_programs_and_in_its_own_coordinates() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("all.vpc");
    write(folder.path(), &folder.path().join("first.vpc"));
    let mut infos = [0, 1].map(|_| codec::open(&folder.path().join("b.ply")).unwrap().info().clone());
    (infos[0].crs, infos[0].epsg) = (Some("UTM 33N".into()), Some(32_633));
    infos[1].crs = Some("a plan of the hall".into());
    let bounds = Bounds { min: DVec3::new(499_900.0, 4.9999e6, 3.0), max: DVec3::new(500_100.0, 5.0001e6, 9.0) };
    let tiles: Vec<_> = infos.iter().map(|info| CatalogueTile { info, points: 2, bounds }).collect();
    let warnings = codec::write_catalogue(&tiles, &output).unwrap();
    assert!(
        warnings[0].contains("2 coordinate systems") && warnings[1].contains("on the globe: 1 of 2;"),
        "{warnings:?}"
    );

    let all: serde_json::Value = serde_json::from_slice(&fs::read(&output).unwrap()).unwrap();
    let [placed, own] = [0, 1].map(|number| &all["features"][number]);
    let numbers = |list: &serde_json::Value| -> Vec<f64> {
        list.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    // By PROJ 9: the corners of the box are within 0.0013 and 0.0009 degrees of its middle.
    let expected = [14.998_73, 45.152_58, 3.0, 15.001_27, 45.154_38, 9.0];
    for (found, expected) in numbers(&placed["bbox"]).into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
    let ring = placed["geometry"]["coordinates"][0].as_array().unwrap();
    assert!(ring.len() == 5 && ring[0] == ring[4] && numbers(&ring[1])[1] > 45.154, "{ring:?}");
    for item in [placed, own] {
        let native = [499_900.0, 4.9999e6, 3.0, 500_100.0, 5.0001e6, 9.0];
        assert_eq!(numbers(&item["properties"]["proj:bbox"]), native);
    }
    assert_eq!(numbers(&own["bbox"])[0], 499_900.0);
    let text = |item: &serde_json::Value| item["properties"]["proj:wkt2"].as_str().map(|text| text[..7].to_owned());
    assert_eq!((text(placed), text(own)), (Some("PROJCS[".into()), None), "a name is no text");
    assert_eq!([placed, own].map(|item| item["id"].as_str().unwrap()), ["b", "b.ply"]);
}

#[test]
fn tiles_with_signs_of_addresses_in_their_names_are_found_on_disk_and_on_a_server() {
    let folder = tempfile::tempdir().unwrap();
    let head = "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\n";
    let names: &[&str] = match cfg!(windows) {
        true => &["area x.ply", "area%20x.ply", "a#1.ply", "a%231.ply", "tile #2.ply", "50%.ply", "plan ä.ply"],
        false => {
            &["area x.ply", "area%20x.ply", "a#1.ply", "a%231.ply", "tile #2.ply", "what?.ply", "50%.ply", "plan ä.ply"]
        }
    };
    let paths: Vec<_> = names.iter().map(|name| folder.path().join(name)).collect();
    for (number, path) in paths.iter().enumerate() {
        fs::write(path, format!("{head}end_header\n{number} 0 0\n")).unwrap();
    }
    let sources: Vec<Source> = paths.iter().map(|path| codec::open(path).unwrap()).collect();
    let bounds = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
    let tile = |source| CatalogueTile { info: Source::info(source), points: 1, bounds };
    let output = folder.path().join("all.vpc");
    codec::write_catalogue(&sources.iter().map(tile).collect::<Vec<_>>(), &output).unwrap();
    let places = |path: &Path| -> Vec<f64> {
        let opened = codec::open_scans(path, MEMORY).unwrap();
        assert!(opened.iter().all(|source| source.info().warnings.is_empty() && source.info().lost.is_empty()));
        opened.iter().map(|own| codec::bounds_of(own, &Progress::default()).unwrap().unwrap().min.x).collect()
    };
    let expected: Vec<f64> = (0..names.len()).map(|number| number as f64).collect();
    assert_eq!(places(&output), expected);
    // A server that takes names from addresses, as servers do.
    let root = folder.path().to_owned();
    let server = server::Server::new(move |request, stream| {
        let path = request.path.split('?').next().unwrap_or_default().trim_start_matches('/');
        let mut bytes = path.bytes();
        let mut name = Vec::new();
        while let Some(byte) = bytes.next() {
            let mut digit = || char::from(bytes.next().unwrap()).to_digit(16).unwrap() as u8;
            name.push(if byte == b'%' { digit() * 16 + digit() } else { byte });
        }
        let file = fs::read(root.join(String::from_utf8(name).unwrap()));
        let (status, file) = file.map_or(("404 No", Vec::new()), |file| ("200 OK", file));
        write!(stream, "HTTP/1.1 {status}\r\ncontent-length: {}\r\n\r\n", file.len())?;
        stream.write_all(&file)
    });
    let address = server.path("all.vpc");
    codec::trust_address(&address);
    assert_eq!(places(&address), expected);
    // Catalogues of other programs and of versions before have names as they are.
    let item = |name: &str| format!(r#"{{"assets":{{"data":{{"href":"./{name}"}}}}}}"#);
    let items: Vec<String> = names.iter().map(|name| item(name)).collect();
    let text = format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, items.join(","));
    fs::write(folder.path().join("plain.vpc"), text).unwrap();
    assert_eq!(places(&folder.path().join("plain.vpc")), expected);
    // Names that could be escapes, all of them, and are none, since two would be one.
    let text = format!(r#"{{"type":"FeatureCollection","features":[{},{}]}}"#, items[0], items[1]);
    fs::write(folder.path().join("two.vpc"), text).unwrap();
    assert_eq!(places(&folder.path().join("two.vpc")), expected[..2]);
}

#[test]
fn a_tile_that_is_named_twice_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("all.vpc");
    write(folder.path(), &output);
    let text = fs::read_to_string(&output).unwrap().replace("./b.ply", "./tiles/a.ply");
    fs::write(&output, text).unwrap();
    let opened = codec::open_scans(&output, MEMORY).unwrap();
    let told = opened[0].info().warnings.join("\n");
    assert!(opened.len() == 1 && told.contains("names a.ply more than once"), "{told}");
}
