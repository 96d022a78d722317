//! Reads Entwine Point Tiles: those of the test data, by their manifest, and clouds that these tests write.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use cloud::{Chunk, PointTest, Progress};
use codec::{Format, Selection, Source, Summary};
use glam::DVec3;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};

fn everything(source: &Source) -> Selection {
    let attributes = vec![true; source.info().attributes.len()];
    Selection { positions: true, colors: true, normals: true, attributes }
}

fn read(source: &Source) -> (Vec<Chunk>, Summary) {
    let chunks = Mutex::new(Vec::new());
    let emit = |chunk| chunks.lock().unwrap().push(chunk);
    let summary = source.read(&everything(source), &Progress::default(), &emit).unwrap();
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk| chunk.first_point);
    (chunks, summary)
}

fn message(path: &Path) -> String {
    codec::open(path).err().map(|error| error.to_string()).unwrap_or_default()
}

/// A copy of a cloud of the test data that a test may change; `None` where that is missing.
fn copy(name: &str) -> Option<(tempfile::TempDir, PathBuf)> {
    fn copy_folder(from: &Path, to: &Path) {
        fs::create_dir_all(to).unwrap();
        for entry in fs::read_dir(from).unwrap().flatten() {
            let own = to.join(entry.file_name());
            match entry.path().is_dir() {
                true => copy_folder(&entry.path(), &own),
                // Written anew: the test data cannot be written to.
                false => fs::write(own, fs::read(entry.path()).unwrap()).unwrap(),
            }
        }
    }
    let from = real_data::test_data()?.join("ept").join(name);
    let folder = tempfile::tempdir().unwrap();
    copy_folder(&from, folder.path());
    let path = folder.path().join("ept.json");
    Some((folder, path))
}

fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

#[test]
fn clouds_of_the_test_data_are_as_the_manifest_says() {
    let Some(data) = real_data::test_data() else { return };
    let known = [
        ("1.2-with-color", 1065, true, [[635_619.85, 848_899.7, 406.59], [638_982.55, 853_535.43, 586.38]]),
        ("lone-star-laszip", 518_862, false, [[515_368.6, 4_918_340.4, 2322.9], [515_401.0, 4_918_381.1, 2338.6]]),
    ];
    for (name, points, has_colors, [min, max]) in known {
        let source = codec::open(&data.join("ept").join(name).join("ept.json")).unwrap();
        let info = source.info();
        assert_eq!((info.format, info.points, info.has_colors), (Format::Ept, points, has_colors), "{name}");
        assert_eq!((info.name().as_str(), info.warnings.as_slice()), (name, &[][..]));
        assert!(info.crs.is_some() && info.grid.is_some());
        let (chunks, summary) = read(&source);
        assert_eq!((summary.points, summary.warnings.len()), (points, 0), "{name}: {:?}", summary.warnings);
        let found = summary.bounds.unwrap();
        assert!((found.min - DVec3::from(min)).abs().max_element() < 0.5, "{name}: {found:?}");
        assert!((found.max - DVec3::from(max)).abs().max_element() < 0.5, "{name}: {found:?}");
        // Each point comes once, under its own number.
        let mut next = 0;
        for chunk in &chunks {
            assert_eq!(chunk.first_point, next, "{name}");
            next += chunk.len() as u64;
        }
    }
}

#[test]
fn nodes_have_the_points_of_their_tiles() {
    let Some(data) = real_data::test_data() else { return };
    let folder = data.join("ept/lone-star-laszip");
    let source = codec::open(&folder.join("ept.json")).unwrap();
    let octree = source.copc().unwrap();
    assert_eq!(octree.nodes.iter().filter(|node| node.points > 0).count(), 13);
    let mut all = 0;
    for node in octree.nodes.iter().filter(|node| node.points > 0) {
        let [x, y, z] = node.cell;
        let tile = codec::open(&folder.join(format!("ept-data/{}-{x}-{y}-{z}.laz", node.level))).unwrap();
        let whole = source.read_copc_node(node, &everything(&source)).unwrap();
        assert_eq!(whole.first_point, all);
        all += whole.len() as u64;
        let (chunks, _) = read(&tile);
        let places = |chunks: &[Chunk]| -> Vec<DVec3> {
            chunks
                .iter()
                .flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index)).collect::<Vec<_>>())
                .collect()
        };
        for (own, expected) in places(std::slice::from_ref(&whole)).into_iter().zip(places(&chunks)) {
            assert!((own - expected).length() < 1e-4, "{own} instead of {expected}");
        }
        let own = source.record(whole.first_point + 5).unwrap();
        assert_eq!(own, tile.record(5).unwrap());
    }
    assert_eq!(all, 518_862);
}

#[test]
fn points_are_exported_from_all_tiles() {
    let Some(data) = real_data::test_data() else { return };
    let source = std::sync::Arc::new(codec::open(&data.join("ept/lone-star-laszip/ept.json")).unwrap());
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.laz");
    let test = PointTest::default();
    let progress = Progress::default();
    let written = codec::export(&[source], &test, &[], &output, 1 << 30, &progress).unwrap().unwrap();
    assert_eq!(written.points, 518_862);
    assert_eq!(codec::open(&output).unwrap().info().points, 518_862);
}

/// Writes a cloud of two binary tiles, of 3 and 2 points, with coordinates in hundredths.
fn binary(folder: &Path) -> PathBuf {
    let dimension = |name: &str, kind: &str, size: usize, more: &str| {
        format!(r#"{{"name":"{name}","type":"{kind}","size":{size}{more}}}"#)
    };
    let axis = |name: &str| dimension(name, "signed", 4, r#","scale":0.01,"offset":1000.0"#);
    let schema = [
        axis("X"),
        axis("Y"),
        axis("Z"),
        dimension("Intensity", "unsigned", 2, ""),
        dimension("GpsTime", "float", 8, ""),
        dimension("Red", "unsigned", 2, ""),
        dimension("Green", "unsigned", 2, ""),
        dimension("Blue", "unsigned", 2, ""),
    ];
    let text = format!(
        r#"{{"bounds":[1000,1000,1000,1008,1008,1008],"boundsConforming":[1000,1000,1000,1004,1001,1000],"dataType":"binary",
        "hierarchyType":"json","points":5,"span":128,"version":"1.0.0","schema":[{}]}}"#,
        schema.join(",")
    );
    write(folder, "ept.json", &text);
    write(folder, "ept-hierarchy/0-0-0-0.json", r#"{"0-0-0-0":3,"1-0-0-0":2}"#);
    fs::create_dir_all(folder.join("ept-data")).unwrap();
    let row = |number: i32| {
        let mut row = Vec::new();
        for raw in [number * 100, number, 0] {
            row.extend(raw.to_le_bytes());
        }
        row.extend((number as u16 * 7).to_le_bytes());
        row.extend((f64::from(number) + 0.5).to_le_bytes());
        for value in [65_535_u16, 256 * number as u16, 0] {
            row.extend(value.to_le_bytes());
        }
        row
    };
    let rows = |numbers: std::ops::Range<i32>| numbers.flat_map(row).collect::<Vec<u8>>();
    fs::write(folder.join("ept-data/0-0-0-0.bin"), rows(0..3)).unwrap();
    fs::write(folder.join("ept-data/1-0-0-0.bin"), rows(3..5)).unwrap();
    folder.join("ept.json")
}

#[test]
fn binary_tiles_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let source = codec::open(&binary(folder.path())).unwrap();
    let info = source.info();
    assert_eq!((info.points, info.has_colors, info.warnings.len()), (5, true, 0), "{:?}", info.warnings);
    assert!(info.grid.is_some());
    let (chunks, summary) = read(&source);
    assert_eq!((summary.points, chunks.len()), (5, 2));
    let column = |name: &str| info.attributes.iter().position(|attribute| attribute.name == name).unwrap();
    for chunk in &chunks {
        for index in 0..chunk.len() {
            let number = (chunk.first_point + index as u64) as f64;
            let place = chunk.position(index) - DVec3::new(1000.0 + number, 1000.0 + number / 100.0, 1000.0);
            assert!(place.length() < 1e-4, "{place}");
            let value = |name: &str| chunk.columns[column(name)].as_ref().unwrap().value(index);
            assert_eq!((value("intensity"), value("gps_time")), (number * 7.0, number + 0.5));
            assert_eq!(chunk.colors.as_ref().unwrap()[index], [255, number as u8, 0, 255]);
        }
    }
    let node = source.copc().unwrap().nodes[1].clone();
    assert_eq!(source.read_copc_node(&node, &everything(&source)).unwrap().len(), 2);
    let record = source.record(4).unwrap();
    assert!(record.contains(&("x".into(), "1004".into())), "{record:?}");
}

/// Compresses the tiles of a binary cloud, in place of which they stand.
fn compress(path: &Path) {
    let text = fs::read_to_string(path).unwrap();
    fs::write(path, text.replace(r#""dataType":"binary""#, r#""dataType":"zstandard""#)).unwrap();
    for entry in fs::read_dir(path.with_file_name("ept-data")).unwrap().flatten() {
        let rows = fs::read(entry.path()).unwrap();
        let compressed = compress_to_vec(rows.as_slice(), CompressionLevel::Fastest);
        fs::write(entry.path().with_extension("zst"), compressed).unwrap();
        fs::remove_file(entry.path()).unwrap();
    }
}

#[test]
fn compressed_tiles_are_those_of_plain_rows_to_the_bit() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [plain, compressed] = folders.each_ref().map(|folder| binary(folder.path()));
    compress(&compressed);
    let sources = [plain, compressed].map(|path| codec::open(&path).unwrap());
    let [plain, compressed] = sources.each_ref().map(|source| {
        let (chunks, summary) = read(source);
        assert_eq!((summary.points, summary.warnings.as_slice()), (5, &[][..]));
        let (info, records) = (source.info(), [0, 2, 3, 4].map(|point| source.record(point).unwrap()));
        let told = (info.attributes.clone(), info.grid, info.crs.clone(), info.bounds, info.warnings.clone());
        (format!("{chunks:?}"), records, told)
    });
    assert_eq!(plain, compressed);
    assert!(sources[1].info().version.contains("zstandard"), "{}", sources[1].info().version);
}

#[test]
fn a_compressed_tile_that_is_not_as_told_is_missed_and_the_others_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = binary(folder.path());
    compress(&path);
    let tile = path.with_file_name("ept-data").join("1-0-0-0.zst");
    let whole = fs::read(&tile).unwrap();
    let rows = compress_to_vec([0_u8; 3 * 28].as_slice(), CompressionLevel::Uncompressed);
    // A frame of 8 MiB of memory, and a block that repeats a byte 131,072 times.
    let bomb = [0x28, 0xb5, 0x2f, 0xfd, 0, 13 << 3, 3, 0, 16, 7];
    for (bytes, problem) in [
        (&whole[..whole.len() / 2], "tile: not decompressed"),
        (&rows, "tile: more than the 56 bytes"),
        (&bomb, "tile: more than the 56 bytes"),
        (&[7; 100_000], "100000 bytes, expected at most"),
    ] {
        fs::write(&tile, bytes).unwrap();
        let source = codec::open(&path).unwrap();
        let (_, summary) = read(&source);
        let told = summary.warnings.join("\n");
        assert!(summary.points == 3 && told.contains("2 points are missing") && told.contains(problem), "{told}");
    }
    write(folder.path(), "ept-hierarchy/0-0-0-0.json", r#"{"0-0-0-0":16000000}"#);
    let told = codec::open_within(&path, 64 << 20).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(told.contains("448000000 bytes of points") && told.contains("fit in the memory for one tile"), "{told}");
}

#[test]
fn a_hierarchy_that_lies_ends_with_a_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = binary(folder.path());
    let page = "ept-hierarchy/0-0-0-0.json";
    for (text, problem) in [
        (r#"{"0-0-0-0":-1}"#, "it names itself"),
        (r#"{"0-0-0-0":3,"../../../../etc/passwd":3}"#, "is no node"),
        (r#"{"0-0-0-0":-7}"#, "-7 points, expected 0 to 16777216"),
        (r#"{"0-0-0-0":4000000000}"#, "4000000000 points, expected 0 to 16777216"),
        (r#"{"0-0-0-0":4}"#, "3 points, the hierarchy says 4"),
        (r#"{"0-0-0-0":"#, "not a page"),
        ("[]", "not a page"),
    ] {
        write(folder.path(), page, text);
        let told = message(&path);
        assert!(told.contains(problem), "{text}: {told}");
    }
    fs::remove_file(folder.path().join(page)).unwrap();
    assert!(message(&path).contains("0-0-0-0.json"), "{}", message(&path));
}

#[test]
fn a_page_that_cannot_be_used_is_told_and_the_others_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = binary(folder.path());
    write(folder.path(), "ept-hierarchy/0-0-0-0.json", r#"{"0-0-0-0":3,"1-0-0-0":-1,"1-1-0-0":-1}"#);
    // The first has a node elsewhere in the tree, which the page before could have, too; the other is not there.
    write(folder.path(), "ept-hierarchy/1-0-0-0.json", r#"{"1-0-0-0":2,"0-0-0-0":-1}"#);
    let source = codec::open(&path).unwrap();
    let told = source.info().warnings.join("\n");
    assert_eq!(source.info().points, 3);
    assert!(told.contains("below node 1-0-0-0 is missing") && told.contains("node 0-0-0-0 is not below it"), "{told}");
    assert!(told.contains("below node 1-1-0-0 is missing"), "{told}");
    assert!(told.contains("it says 5 points, its hierarchy has 3"), "{told}");
}

#[test]
fn pages_without_end_are_left_out_where_their_number_or_memory_ends() {
    let folder = tempfile::tempdir().unwrap();
    let path = binary(folder.path());
    // A thousand nodes may take the memory of this opening.
    let cells = |level: u32| (0..1_u32 << level).flat_map(move |x| (0..1_u32 << level).map(move |y| (level, x, y)));
    let nodes = (1..=6).flat_map(cells).map(|(level, x, y)| format!(r#""{level}-{x}-{y}-0":1"#));
    let entries: Vec<String> = nodes.collect();
    write(folder.path(), "ept-hierarchy/0-0-0-0.json", &format!(r#"{{"0-0-0-0":3,{}}}"#, entries.join(",")));
    let source = codec::open_within(&path, 1 << 10).unwrap();
    let told = source.info().warnings.join("\n");
    assert!(told.contains("the hierarchy is larger than the memory for it"), "{told}");
    assert_eq!(source.copc().unwrap().nodes.iter().filter(|node| node.points > 0).count(), 1024);
    // A chain of pages, each of which names the next one, ends with the deepest level.
    for level in 0..=40 {
        let next = format!(r#"{{"{level}-0-0-0":{},"{}-0-0-0":-1}}"#, if level == 0 { 3 } else { 0 }, level + 1);
        write(folder.path(), &format!("ept-hierarchy/{level}-0-0-0.json"), &next);
    }
    let told = codec::open(&path).unwrap().info().warnings.join("\n");
    assert!(told.contains("below node 30-0-0-0 is missing") && told.contains("`31-0-0-0` is no node"), "{told}");
}

#[test]
fn a_tile_that_is_not_as_told_is_missed_and_the_others_are_read() {
    let Some((_folder, path)) = copy("lone-star-laszip") else { return };
    let tile = path.with_file_name("ept-data").join("2-2-2-1.laz");
    let whole = fs::read(&tile).unwrap();
    fs::write(&tile, &whole[..whole.len() / 2]).unwrap();
    fs::remove_file(path.with_file_name("ept-data").join("3-5-4-4.laz")).unwrap();
    let source = codec::open(&path).unwrap();
    let (_, summary) = read(&source);
    let told = summary.warnings.join("\n");
    assert_eq!(summary.points, 518_862 - 85_048 - 21_327, "{told}");
    assert!(told.contains("85048 points are missing") && told.contains("21327 points are missing"), "{told}");
    let Some(data) = real_data::test_data() else { return };
    let told = message(&data.join("ept/bad-pointcount-laszip/ept.json"));
    assert!(told.contains("1065 points, the hierarchy says 1000"), "{told}");
}

#[test]
fn what_is_not_read_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = binary(folder.path());
    let text = fs::read_to_string(&path).unwrap();
    for (from, to, problem) in [
        (r#""dataType":"binary""#, r#""dataType":"\u001b[31m""#, "expected laszip, binary or zstandard"),
        (r#""hierarchyType":"json""#, r#""hierarchyType":"gzip""#, "expected json"),
        ("1008,1008,1008", "1008,1008,1000", "no cube"),
        (r#""span":128"#, r#""span":0"#, "no cube"),
        (r#""type":"float""#, r#""type":"complex""#, "dimension GpsTime is complex of 8 bytes"),
        (r#""bounds":["#, r#""bounds":[1,"#, "not one of EPT"),
    ] {
        write(folder.path(), "ept.json", &text.replace(from, to));
        let told = message(&path);
        assert!(told.contains(problem), "{to}: {told}");
        assert!(!told.contains('\u{1b}'), "{told}");
    }
}
