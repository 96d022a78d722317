//! Reads and writes catalogues of tiles.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::fs;
use std::path::Path;

use cloud::Progress;
use codec::{CatalogueTile, Source};

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
    let told = opened[0].info().warnings.join("\n");
    assert_eq!(opened.len(), 1);
    assert!(told.contains("b.ply") && told.contains("the catalogue says 3 points"), "{told}");
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
