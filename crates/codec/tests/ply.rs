//! PLY: real files against each other, a small file for every trap, and files that were damaged on purpose.

#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use cloud::{CHUNK_POINTS, Chunk, Cloud, Column, Progress, unpack_normal};
use codec::{Error, Info, Selection, Source, Summary};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use real_data::test_data;

fn data(name: &str) -> Option<PathBuf> {
    Some(test_data()?.join(name))
}

/// Everything a file says, in file order.
struct Read {
    info: Info,
    summary: Summary,
    source: Source,
    positions: Vec<DVec3>,
    colors: Vec<[u8; 4]>,
    normals: Vec<u32>,
    /// The values of each attribute, by name.
    attributes: HashMap<String, Vec<f64>>,
    chunks: Vec<Chunk>,
}

fn everything(info: &Info) -> Selection {
    Selection { positions: true, colors: true, normals: true, attributes: vec![true; info.attributes.len()] }
}

fn read_source(source: Source) -> Result<Read, Error> {
    let info = source.info().clone();
    let chunks = Mutex::new(Vec::new());
    let progress = Progress::default();
    let summary = source.read(&everything(&info), &progress, &|chunk| chunks.lock().unwrap().push(chunk))?;
    assert_eq!(progress.done(), summary.points);
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk| chunk.first_point);
    let mut read = Read {
        positions: Vec::new(),
        colors: Vec::new(),
        normals: Vec::new(),
        attributes: HashMap::new(),
        chunks: Vec::new(),
        info,
        summary,
        source,
    };
    let cloud = Cloud::default();
    for chunk in &chunks {
        assert_eq!(chunk.first_point as usize, read.positions.len(), "chunks follow each other");
        assert!((1..=CHUNK_POINTS).contains(&chunk.len()));
        read.positions.extend((0..chunk.len()).map(|index| cloud.world_position(chunk, index)));
        read.colors.extend(chunk.colors.iter().flat_map(|colors| colors.iter()));
        read.normals.extend(chunk.normals.iter().flat_map(|normals| normals.iter()));
        for (attribute, column) in read.info.attributes.iter().zip(&chunk.columns) {
            let column = column.as_ref().unwrap();
            assert_eq!((column.len(), column.column_type()), (chunk.len(), attribute.column_type));
            let values = read.attributes.entry(attribute.name.clone()).or_default();
            values.extend((0..column.len()).map(|index| column.value(index)));
        }
    }
    assert_eq!(read.summary.points, read.positions.len() as u64);
    read.chunks = chunks;
    Ok(read)
}

fn read_path(path: &Path) -> Read {
    read_source(codec::open(path).unwrap()).unwrap()
}

/// A file in a folder of its own that lives as long as the test needs it.
fn file(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("test.ply");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn read_bytes(bytes: &[u8]) -> Read {
    let (_folder, path) = file(bytes);
    read_path(&path)
}

fn ascii(header: &str, body: &str) -> Vec<u8> {
    format!("ply\nformat ascii 1.0\n{header}\nend_header\n{body}").into_bytes()
}

fn error_of(bytes: &[u8]) -> String {
    let (_folder, path) = file(bytes);
    match codec::open(&path) {
        Ok(_) => panic!("opened {:?}", String::from_utf8_lossy(bytes)),
        Err(error) => error.to_string(),
    }
}

const XYZ: &str = "property float x\nproperty float y\nproperty float z";

#[test]
fn twins_of_different_encoding_are_equal() {
    for names in [
        ["ply/platonic_shelf_ascii.ply", "ply/platonic_shelf_binary_le.ply"],
        ["ply/platonic_shelf_ascii.ply", "ply/platonic_shelf_binary_be.ply"],
        ["ply/stanford_bunny_full_ascii_mesh.ply", "ply/stanford_bunny_full_binary_be_mesh.ply"],
        ["same_cloud_four_files/ripple_ascii.ply", "same_cloud_four_files/ripple_bin.ply"],
    ] {
        let [Some(first), Some(second)] = names.map(data) else { return };
        let (first, second) = (read_path(&first), read_path(&second));
        // The text of the ripple was printed with six decimals; that of the others reproduces the binary.
        let tolerance = if names[0].contains("ripple") || names[0].contains("platonic") { 1e-5 } else { 0.0 };
        assert_eq!(first.positions.len(), second.positions.len(), "{names:?}");
        for (a, b) in first.positions.iter().zip(&second.positions) {
            assert!((*a - *b).abs().max_element() <= tolerance, "{names:?}: {a} and {b}");
        }
        assert_eq!(first.colors, second.colors, "{names:?}");
        assert_eq!(first.normals.len(), second.normals.len(), "{names:?}");
        for (&a, &b) in first.normals.iter().zip(&second.normals) {
            let (a, b) = (unpack_normal(a).unwrap(), unpack_normal(b).unwrap());
            assert!(a.distance(b) < 1e-4, "{names:?}: {a} and {b}");
        }
        assert_eq!(first.attributes.len(), second.attributes.len(), "{names:?}");
        for (name, values) in &first.attributes {
            let pairs = || values.iter().zip(&second.attributes[name]);
            assert!(pairs().all(|(a, b)| (a - b).abs() <= tolerance), "{names:?}: {name}");
        }
        let triangles = first.source.triangles().unwrap();
        assert_eq!(triangles, second.source.triangles().unwrap(), "{names:?}");
        assert_eq!(triangles.is_empty(), names[0].contains("ripple"), "{names:?}");
    }
}

#[test]
fn ply_and_las_of_one_cloud_are_equal() {
    let [Some(ply), Some(las)] =
        ["ripple_bin.ply", "ripple.las"].map(|name| data(&format!("same_cloud_four_files/{name}")))
    else {
        return;
    };
    let (ply, las) = (read_path(&ply), read_path(&las));
    assert_eq!(ply.positions.len(), 10_201);
    assert_eq!(ply.colors, las.colors);
    for (a, b) in ply.positions.iter().zip(&las.positions) {
        assert!((*a - *b).abs().max_element() < 1e-3, "{a} and {b}");
    }
}

#[test]
fn bunny_has_its_triangles() {
    let Some(path) = data("ply/stanford_bunny_full_ascii_mesh.ply") else { return };
    let read = read_path(&path);
    let triangles = read.source.triangles().unwrap();
    assert_eq!((read.info.faces, triangles.len()), (69_451, 69_451));
    assert!(read.info.warnings.iter().any(|warning| warning.starts_with("69451 faces are shown by points")));
    // The mesh is known to be consistently wound outwards: its signed volume is positive, some 7.5e-4 cubic metres.
    let volume: f64 = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|index| read.positions[index as usize]);
            a.dot(b.cross(c)) / 6.0
        })
        .sum();
    assert!((7.0e-4..8.0e-4).contains(&volume), "{volume}");
}

#[test]
fn triangle_strips_become_triangles() {
    let Some(path) = data("ply/stanford_bunny_tristrips_binary_le.ply") else { return };
    let read = read_path(&path);
    let triangles = read.source.triangles().unwrap();
    // The strips are made of the mesh of `stanford_bunny_full_*`.
    assert_eq!(triangles.len(), 69_451);
    // Adjacent triangles of a strip have one orientation only if every other one is turned: no directed edge occurs
    // twice.
    let mut edges = HashMap::new();
    for t in &triangles {
        for edge in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *edges.entry(edge).or_insert(0) += 1;
        }
    }
    let twice = edges.values().filter(|&&count| count > 1).count();
    assert!(twice * 1000 < edges.len(), "{twice} of {} edges are used twice in one direction", edges.len());
}

#[test]
fn polygons_become_fans_and_strips_restart() {
    let read = read_bytes(&ascii(
        &format!(
            "element vertex 5\n{XYZ}\nelement face 2\nproperty uchar flags\nproperty list ushort uint vertex_index\nelement tristrips 1\nproperty list int int vertex_indices"
        ),
        "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n7 5 0 1 2 3 4\n7 3 4 3 2\n7 0 1 2 3 -1 2 3\n",
    ));
    assert_eq!(
        read.source.triangles().unwrap(),
        [[0, 1, 2], [0, 2, 3], [0, 3, 4], [4, 3, 2], [0, 1, 2], [2, 1, 3]],
        "a fan, a triangle, a strip of two; the strip after the restart has no triangle"
    );
    assert_eq!(read.info.faces, 2);
}

#[test]
fn faces_that_name_missing_vertices_are_an_error() {
    let header = format!("element vertex 3\n{XYZ}\nelement face 1\nproperty list uchar int vertex_indices");
    for (face, problem) in
        [("3 0 1 3", "vertex 3 of 3"), ("3 0 1 -1", "vertex -1"), ("3 0 1 x", "not a number"), ("3 0 1", "ends in")]
    {
        let read = read_bytes(&ascii(&header, &format!("0 0 0\n1 0 0\n0 1 0\n{face}\n")));
        let error = read.source.triangles().unwrap_err().to_string();
        assert!(error.contains("face 0") && error.contains(problem), "{face}: {error}");
    }
}

#[test]
fn every_type_alias_is_read() {
    for (names, value) in [
        (["char", "int8"], -7.0),
        (["uchar", "uint8"], 250.0),
        (["short", "int16"], -30_000.0),
        (["ushort", "uint16"], 65_000.0),
        (["int", "int32"], -2_000_000_000.0),
        (["uint", "uint32"], 4_000_000_000.0),
        (["float", "float32"], 0.15625),
        (["double", "float64"], 1e300),
    ] {
        for name in names {
            let header = format!("element vertex 1\n{XYZ}\nproperty {name} value");
            let read = read_bytes(&ascii(&header, &format!("1 2 3 {value}\n")));
            assert_eq!(read.attributes["value"], [value], "{name}");
        }
    }
}

#[test]
fn coordinates_of_integer_types_are_read() {
    let read = read_bytes(&ascii(
        "element vertex 2\nproperty int x\nproperty short y\nproperty uint z",
        "-2000000001 -5 4000000001\n-2000000000 5 4000000003\n",
    ));
    assert_eq!(read.positions[0], DVec3::new(-2_000_000_001.0, -5.0, 4_000_000_001.0));
    assert_eq!(read.positions[1], DVec3::new(-2_000_000_000.0, 5.0, 4_000_000_003.0));
}

#[test]
fn doubles_are_kept_where_offsets_lose_digits() {
    let header = "element vertex 2\nproperty double x\nproperty double y\nproperty double z";
    let read = read_bytes(&ascii(header, "394554.123456789 6403831.1 790.74\n394555.2 6403832.3 791.5\n"));
    assert_eq!(read.positions[0], DVec3::new(394_554.123456789, 6_403_831.1, 790.74));
    assert_eq!(read.chunks[0].origin, DVec3::new(394_555.0, 6_403_832.0, 792.0));
    assert!(read.chunks[0].exact_positions.is_some());
    let read = read_bytes(&ascii(header, "394554.125 6403831.5 790.75\n394555.25 6403832 791.5\n"));
    assert!(read.chunks[0].exact_positions.is_none(), "offsets give these back");
    assert_eq!(read.positions[0], DVec3::new(394_554.125, 6_403_831.5, 790.75));
}

#[test]
fn floats_far_from_zero_move_to_an_origin_and_stay_exact() {
    let header = format!("element vertex 2\n{XYZ}");
    let read = read_bytes(&ascii(&header, "394554.13 6403831.5 790.74\n394555.2 6403832.5 791.5\n"));
    assert_eq!(read.chunks[0].origin, DVec3::new(394_555.0, 6_403_833.0, 792.0));
    let expected = DVec3::new(394_554.13_f32.into(), 6_403_831.5_f32.into(), 790.74_f32.into());
    assert_eq!(read.chunks[0].position(0), expected);
    // Around zero they are unchanged, along each axis.
    for (body, origin) in
        [("-1.1 0 0\n1.1 0 1e-7\n", DVec3::ZERO), ("100000.5 1 0\n100001.5 0.001 1\n", DVec3::new(100_002.0, 0.0, 0.0))]
    {
        let read = read_bytes(&ascii(&header, body));
        assert_eq!(read.chunks[0].origin, origin, "{body}");
        assert!(read.chunks[0].exact_positions.is_none(), "{body}");
    }
}

#[test]
fn lists_inside_the_vertex_are_passed_over() {
    for length in ["uchar", "char", "ushort", "short", "uint", "int"] {
        let header = format!(
            "element vertex 3\nproperty float x\nproperty list {length} float weights\nproperty float y\nproperty float z\nproperty uchar last"
        );
        let rows: [(&[f32], u8); 3] = [(&[], 1), (&[1.0, 2.0, 3.0], 2), (&[9.5], 3)];
        let text: String = (rows.iter().enumerate())
            .map(|(row, (list, last))| {
                let list: String = list.iter().map(|item| format!("{item} ")).collect();
                format!("{row} {} {list}0.5 -1 {last}\n", list.split_whitespace().count())
            })
            .collect();
        let mut files = vec![ascii(&header, &text)];
        for big in [false, true] {
            let name = if big { "big" } else { "little" };
            let mut bytes = format!("ply\nformat binary_{name}_endian 1.0\n{header}\nend_header\n").into_bytes();
            let mut put = |value: &[u8]| {
                let mut value = value.to_vec();
                if big {
                    value.reverse();
                }
                bytes.extend(value);
            };
            for (row, (list, last)) in rows.iter().enumerate() {
                put(&(row as f32).to_le_bytes());
                let size = match length {
                    "uchar" | "char" => 1,
                    "ushort" | "short" => 2,
                    _ => 4,
                };
                put(&(list.len() as u32).to_le_bytes()[..size]);
                for item in *list {
                    put(&item.to_le_bytes());
                }
                put(&0.5_f32.to_le_bytes());
                put(&(-1.0_f32).to_le_bytes());
                put(&[*last]);
            }
            files.push(bytes);
        }
        for bytes in files {
            let (_folder, path) = file(&bytes);
            let read = read_path(&path);
            let expected: Vec<_> = (0..3).map(|row| DVec3::new(f64::from(row), 0.5, -1.0)).collect();
            assert_eq!(read.positions, expected, "{length} {}", read.info.version);
            assert_eq!(read.attributes["last"], [1.0, 2.0, 3.0]);
            assert_eq!(read.source.record(1).unwrap()[1], ("weights".into(), "[1, 2, 3]".into()));
            assert!(read.info.warnings.iter().any(|warning| warning.contains("weights")), "{:?}", read.info.warnings);
        }
    }
}

#[test]
fn line_ends_blanks_and_comments_do_not_matter() {
    let plain = format!("ply\nformat ascii 1.0\nelement vertex 2\n{XYZ}\nend_header\n1 2 3\n4 5 6\n");
    let commented = plain.replace("property float y", "comment \u{e9}\nobj_info a b\ncomment\nproperty float y");
    let padded = plain.replace("float", " float\t ").replace("1 2 3\n", "\n  1\t2  3 \n\n");
    let mut latin = plain.clone().into_bytes();
    latin.splice(4..4, *b"comment \xe9\xff\n");
    for (what, bytes) in [
        ("CRLF", plain.replace('\n', "\r\n").into_bytes()),
        ("CR", plain.replace('\n', "\r").into_bytes()),
        ("comments", commented.into_bytes()),
        ("blanks", padded.into_bytes()),
        ("Latin-1", latin),
        ("no line end at the end", plain.trim_end().as_bytes().to_vec()),
        ("capitals", plain.replace("float x", "float X").into_bytes()),
    ] {
        let read = read_bytes(&bytes);
        assert_eq!(read.positions, [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)], "{what}");
        assert_eq!(read.info.warnings, Vec::<String>::new(), "{what}");
        assert_eq!(read.source.record(1).unwrap()[2].1, "6", "{what}");
    }
}

#[test]
fn binary_after_a_crlf_header_starts_after_the_line_feed() {
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex 1\n{XYZ}\nend_header\n")
        .replace('\n', "\r\n")
        .into_bytes();
    // 13 and 10 in the data are numbers, not line ends.
    bytes.extend([13, 10, 13, 64].repeat(3));
    let expected = f64::from(f32::from_le_bytes([13, 10, 13, 64]));
    assert_eq!(read_bytes(&bytes).positions, [DVec3::splat(expected)]);
}

#[test]
fn colors_are_scaled_by_their_type_and_range() {
    for (kind, file_values, bytes) in [
        ("uchar", "0 128 255", [0, 128, 255]),
        ("char", "0 64 127", [0, 64, 127]),
        ("ushort", "0 32768 65535", [0, 128, 255]),
        ("ushort", "0 128 255", [0, 128, 255]),
        ("int", "0 128 255", [0, 128, 255]),
        ("float", "0 0.5 1", [0, 128, 255]),
        ("double", "0 0.5 1", [0, 128, 255]),
        ("float", "0 127.6 255", [0, 128, 255]),
        ("float", "-1 nan 2e9", [0, 0, 255]),
    ] {
        for names in [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]] {
            let [r, g, b] = names;
            let header =
                format!("element vertex 1\nproperty {kind} {g}\n{XYZ}\nproperty {kind} {r}\nproperty {kind} {b}");
            let values: Vec<_> = file_values.split(' ').collect();
            let body = format!("{} 1 2 3 {} {}\n", values[1], values[0], values[2]);
            let read = read_bytes(&ascii(&header, &body));
            assert_eq!(read.colors, [[bytes[0], bytes[1], bytes[2], 255]], "{kind} {file_values}");
            assert!(read.info.has_colors && read.info.attributes.len() == 6);
        }
    }
}

#[test]
fn opacity_is_read_unless_it_is_zero_everywhere() {
    let header = format!(
        "element vertex 2\n{XYZ}\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty ALPHA alpha"
    );
    for (kind, values, opacity) in
        [("uchar", ["10", "200"], [10, 200]), ("float", ["0.5", "1"], [128, 255]), ("uchar", ["0", "0"], [255, 255])]
    {
        let body = format!("0 0 0 1 2 3 {}\n0 0 0 1 2 3 {}\n", values[0], values[1]);
        let read = read_bytes(&ascii(&header.replace("ALPHA", kind), &body));
        assert_eq!(read.colors.iter().map(|color| color[3]).collect::<Vec<_>>(), opacity);
        assert_eq!(read.info.warnings.is_empty(), values[1] != "0", "{:?}", read.info.warnings);
    }
}

#[test]
fn normals_that_are_zero_everywhere_are_missing() {
    for names in [["nx", "ny", "nz"], ["normal_x", "normal_y", "normal_z"]] {
        let properties: String = names.iter().map(|name| format!("\nproperty float {name}")).collect();
        let header = format!("element vertex 2\n{XYZ}{properties}");
        let read = read_bytes(&ascii(&header, "0 0 0 0 0 0\n1 1 1 0 -0 0\n"));
        assert!(!read.info.has_normals && read.normals.is_empty());
        assert!(read.info.warnings.iter().any(|warning| warning.contains("normals")), "{:?}", read.info.warnings);
        let read = read_bytes(&ascii(&header, "0 0 0 0 0 0\n1 1 1 0 -2 0\n"));
        assert!(read.info.has_normals);
        assert_eq!(unpack_normal(read.normals[0]), None, "one point may have none");
        assert_eq!(unpack_normal(read.normals[1]), Some(-Vec3::Y));
    }
}

#[test]
fn normals_that_appear_late_in_a_file_are_found() {
    let mut body = "0 0 0 0 0 0\n".repeat(100_000);
    body.push_str(&"0 0 0 0 0 1\n".repeat(50_000));
    let header = format!("element vertex 150000\n{XYZ}\nproperty float nx\nproperty float ny\nproperty float nz");
    assert!(read_bytes(&ascii(&header, &body)).info.has_normals);
}

#[test]
fn gaussian_splats_are_points_with_the_color_of_their_first_harmonic() {
    let Some(path) = data("ply/gaussian_splats_1000_binary_le.ply") else { return };
    let read = read_path(&path);
    assert!(read.info.warnings.iter().any(|warning| warning == "Gaussian splats, shown as points"));
    assert!(read.info.has_colors && !read.info.has_normals);
    assert_eq!(read.info.attributes.len(), 62);
    let others = &read.info.attributes[..62 - 3 - 3 - 3 - 1];
    assert!(others.iter().all(|attribute| !["x", "nx", "f_dc_0", "opacity"].contains(&attribute.name.as_str())));
    for point in [0, 500, 999] {
        let record: HashMap<_, _> = read.source.record(point).unwrap().into_iter().collect();
        let number = |name: &str| record[name].parse::<f64>().unwrap();
        let color = read.colors[point as usize];
        for channel in 0..3 {
            let expected = (0.5 + 0.282_094_79 * number(&format!("f_dc_{channel}"))).clamp(0.0, 1.0) * 255.0;
            assert!((f64::from(color[channel]) - expected).abs() <= 0.51, "{point}: {color:?} {expected}");
        }
        let opacity = 255.0 / (1.0 + (-number("opacity")).exp());
        assert!((f64::from(color[3]) - opacity).abs() <= 0.51, "{point}: {color:?} {opacity}");
    }
}

#[test]
fn attributes_keep_the_names_of_the_file() {
    let header = format!(
        "element vertex 1\nproperty float scalar_Illuminance_(PCV)\n{XYZ}\nproperty uchar quality\nproperty float my value"
    );
    let read = read_bytes(&ascii(&header, "0.5 1 2 3 9 -1\n"));
    let names: Vec<_> = read.info.attributes.iter().map(|attribute| attribute.name.as_str()).collect();
    assert_eq!(names, ["scalar_Illuminance_(PCV)", "quality", "my value", "x", "y", "z"]);
    assert_eq!(read.attributes["scalar_Illuminance_(PCV)"], [0.5]);
    assert_eq!(read.info.properties.len(), 6);
}

#[test]
fn a_repeated_name_does_not_shift_what_follows() {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty uchar a\nproperty float x\nproperty uchar a\nproperty float y\nproperty float z\nend_header\n".to_vec();
    bytes.push(1);
    bytes.extend(1.5_f32.to_be_bytes());
    bytes.push(2);
    bytes.extend(2.5_f32.to_be_bytes());
    bytes.extend(3.5_f32.to_be_bytes());
    let read = read_bytes(&bytes);
    assert_eq!(read.positions, [DVec3::new(1.5, 2.5, 3.5)]);
    assert_eq!((&read.attributes["a"], &read.attributes["a_2"]), (&vec![1.0], &vec![2.0]));
    assert_eq!(read.info.warnings, ["a further property a is called a_2 here"]);
    // The one that places have keeps its name.
    let read = read_bytes(&ascii(&format!("element vertex 1\n{XYZ}\nproperty float x"), "1 2 3 4\n"));
    assert_eq!((read.positions[0], &read.attributes["x"]), (DVec3::new(1.0, 2.0, 3.0), &vec![1.0]));
    assert_eq!(read.attributes["x_2"], [4.0]);
    // So does one that is called as a further one would be, and a scalar beside a list.
    let header = format!("element vertex 1\n{XYZ}\nproperty uchar a\nproperty uchar a\nproperty uchar a_2");
    let read = read_bytes(&ascii(&header, "1 2 3 4 5 6\n"));
    assert_eq!(["a", "a_2", "a_3"].map(|name| read.attributes[name][0]), [4.0, 6.0, 5.0]);
    assert_eq!(read.info.warnings, ["a further property a is called a_3 here"]);
    let header = format!("element vertex 1\nproperty list uchar float x\n{XYZ}");
    assert_eq!(read_bytes(&ascii(&header, "1 9 1 2 3\n")).positions, [DVec3::new(1.0, 2.0, 3.0)]);
}

#[test]
fn points_of_a_second_element_vertex_are_told_and_are_not_missing() {
    let read =
        read_bytes(&ascii(&format!("element vertex 1\n{XYZ}\nelement vertex 2\n{XYZ}"), "1 2 3\n4 5 6\n7 8 9\n"));
    assert_eq!(read.positions, [DVec3::new(1.0, 2.0, 3.0)]);
    let told = "the header has several elements vertex: 2 points of others than the first are not read";
    assert_eq!((read.info.warnings, read.info.missing), (vec![told.to_owned()], 0));
    let read = read_bytes(&ascii(&format!("element vertex 1\n{XYZ}\nelement vertex 1\n{XYZ}"), "1 2 3\n4 5 6\n"));
    let told = "the header has several elements vertex: 1 point of others than the first is not read";
    assert_eq!((read.info.warnings, read.info.missing), (vec![told.to_owned()], 0));
    // An empty one is not the one that is read.
    let header = format!("element vertex 0\n{XYZ}\nelement vertex 2\n{XYZ}");
    let read = read_bytes(&ascii(&header, "0 0 0\n1 2 3\n"));
    assert_eq!((read.positions.len(), read.info.warnings.len()), (2, 0), "{:?}", read.info.warnings);
}

#[test]
fn elements_without_properties_and_absurd_counts_cost_nothing() {
    let huge = u64::MAX;
    let header = format!(
        "element nothing {huge}\nelement vertex {huge}\n{XYZ}\nelement face {huge}\nproperty list uchar int vertex_indices"
    );
    let start = Instant::now();
    let read = read_bytes(&ascii(&header, "1 2 3\n4 5 6\n"));
    assert_eq!(read.positions.len(), 2);
    assert!(read.info.warnings[0].starts_with(&format!("{} of {huge} vertices are missing", huge - 2)));
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\n{header}\nend_header\n").into_bytes();
    bytes.extend([0; 30]);
    assert_eq!(read_bytes(&bytes).positions.len(), 2);
    assert!(start.elapsed() < Duration::from_secs(2));
}

#[test]
fn numbers_that_are_not_finite_keep_their_place() {
    let header = format!("element vertex 5\n{XYZ}");
    let read = read_bytes(&ascii(&header, "1 2 3\nnan 2 3\n1 inf 3\n1 2 -Infinity\n4 5 6\n"));
    // NaN and infinity are numbers, but no places.
    assert_eq!(read.summary.warnings, ["3 vertices have no finite coordinates and are left out"]);
    for index in 1..4 {
        assert!(read.positions[index].is_nan(), "{}", read.positions[index]);
    }
    assert_eq!(read.positions[4], DVec3::new(4.0, 5.0, 6.0));
    let bounds = read.summary.bounds.unwrap();
    assert_eq!((bounds.min, bounds.max), (DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)));
}

#[test]
fn damaged_lines_are_counted_and_keep_their_place() {
    let header = format!("element vertex 4\n{XYZ}\nproperty int id");
    let read = read_bytes(&ascii(&header, "1 2 3 4\n1 2\n1 1.2.3 3 4\n5 6 7 8\n"));
    assert_eq!(read.summary.warnings.len(), 1);
    assert!(read.summary.warnings[0].starts_with("2 of 4 vertices"), "{:?}", read.summary.warnings);
    assert_eq!(read.positions[3], DVec3::new(5.0, 6.0, 7.0));
    assert!(read.positions[1].is_nan() && read.positions[2].is_nan());
    assert_eq!(read.attributes["id"], [4.0, 0.0, 4.0, 8.0]);
}

#[test]
fn lines_far_too_short_for_their_header_are_refused_where_they_are_many() {
    let more: String = (0..100).map(|index| format!("property double a{index}\n")).collect();
    let header = |lines: usize| format!("element vertex {lines}\n{XYZ}\n{}", more.trim_end());
    let read = read_bytes(&ascii(&header(1000), &"1 2 3\n".repeat(1000)));
    assert_eq!((read.positions.len(), read.positions[999]), (1000, DVec3::new(1.0, 2.0, 3.0)));
    let refused = error_of(&ascii(&header(20_000), &"1 2 3\n".repeat(20_000)));
    assert!(refused.contains("103 properties, but its 20000 lines only 120000 bytes"), "{refused}");
}

#[test]
fn files_cut_short_give_what_is_there() {
    let header = format!("element vertex 4\n{XYZ}");
    // The last line may end inside a number: it is left out.
    let read = read_bytes(&ascii(&header, "1 2 3\n4 5 6\n7 8 9"));
    assert_eq!(read.positions.len(), 2);
    assert!(read.info.warnings[0].starts_with("2 of 4 vertices are missing"), "{:?}", read.info.warnings);
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\n{header}\nend_header\n").into_bytes();
    bytes.extend([0; 12 * 3 + 7]);
    let read = read_bytes(&bytes);
    assert_eq!((read.info.points, read.positions.len()), (3, 3));
    assert!(read.info.warnings[0].starts_with("1 of 4 vertices are missing"), "{:?}", read.info.warnings);
}

#[test]
fn malformed_test_files_give_what_is_there() {
    let Some(path) = data("malformed/ply_claims_2e9_vertices.ply") else { return };
    let read = read_path(&path);
    assert_eq!(read.info.points, 10_201);
    assert!(read.info.warnings[0].starts_with("1999989799 of 2000000000 vertices are missing"));

    let Some(path) = data("malformed/ply_truncated_mesh.ply") else { return };
    let read = read_path(&path);
    assert_eq!((read.info.points, read.info.faces), (486, 912));
    assert_eq!(read.source.triangles().unwrap().len(), 259);
    assert!(
        read.info.warnings.iter().any(|warning| warning.starts_with("653 of 912 rows of element face")),
        "{:?}",
        read.info.warnings
    );

    let Some(path) = data("malformed/ply_list_in_vertex_missing.ply") else { return };
    let read = read_path(&path);
    assert_eq!(read.positions.len(), 24);
    assert!(read.positions.iter().all(|position| position.is_finite()));
    assert!(read.info.warnings.iter().any(|warning| warning.contains("end before its property vertex_indices")));

    let Some(path) = data("malformed/ply_zero_bytes.ply") else { return };
    assert!(codec::open(&path).err().unwrap().to_string().contains("empty"));
}

#[test]
fn malformed_headers_say_where_and_what() {
    let vertex = format!("element vertex 1\n{XYZ}");
    for (bytes, expected) in [
        (format!("ply\nformat ascii 1.0\n{vertex}\n").into_bytes(), "line 7: the file ends before end_header"),
        (format!("ply\nformat utf8 1.0\n{vertex}\nend_header\n").into_bytes(), "line 2: format `utf8`"),
        (format!("ply\n{vertex}\nend_header\n").into_bytes(), "no format line"),
        (ascii("element vertex -5", ""), "count `-5`"),
        (ascii("element vertex 99999999999999999999", ""), "not a whole number"),
        (ascii("property float x", ""), "line 3: a property before"),
        (ascii("element vertex 1\nproperty quux x", ""), "line 4: `quux` is not a PLY type"),
        (ascii("element vertex 1\nproperty list float int x", ""), "not of an integer type"),
        (ascii("element vertex 1\nproperty float", ""), "without a name"),
        (ascii("element vertex 1\nproperty float x\nproperty float y", ""), "no scalar properties x, y and z"),
        (ascii("element face 1\nproperty float x", ""), "no element vertex"),
        (ascii(&format!("{vertex}\nfoo"), ""), "line 7: `foo` is not a PLY keyword"),
        (b"plyx\n".to_vec(), "not a file of a known format"),
        (b"ply\n".to_vec(), "line 2: the file ends before end_header"),
        ([b"ply\n".to_vec(), b"comment\n".repeat(200_000)].concat(), "no end_header in the first 1048576 bytes"),
    ] {
        let error = error_of(&bytes);
        assert!(error.contains(expected), "expected {expected:?}: {error}");
    }
}

#[test]
fn negative_list_lengths_end_the_vertices_with_a_warning() {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\n{XYZ}\nproperty list char int l\nend_header\n"
    )
    .into_bytes();
    bytes.extend([0; 13]);
    bytes.extend([255; 13]);
    bytes.extend([0; 13]);
    let read = read_bytes(&bytes);
    assert_eq!(read.positions.len(), 1);
    assert_eq!(read.info.warnings[0], "2 of 3 vertices are missing: vertex 1 has a list l of length -1");
}

#[test]
fn a_file_without_line_ends_stays_small_in_memory_and_ends() {
    let header = format!("element vertex 100\n{XYZ}");
    let read = read_bytes(&ascii(&header, &"1 ".repeat(10 << 20)));
    assert_eq!(read.positions.len(), 0, "the one line is cut off: no line end");
    let read = read_bytes(&ascii(&header, &format!("1 2 3 {}\n4 5 6\n", "1 ".repeat(10 << 20))));
    assert_eq!(read.positions, [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)]);
}

#[test]
fn records_are_what_the_columns_say() {
    let names = [
        "ply/s3dis_graph_edges_ascii.ply",
        "ply/stanford_bunny_full_binary_be_mesh.ply",
        "ply/office_kinect_rgba_binary_le.ply",
        "ply/csf_airborne_utm_double_binary_le.ply",
        "ply/platonic_shelf_binary_le.ply",
    ];
    for name in names {
        let Some(path) = data(name) else { return };
        let read = read_path(&path);
        for point in [0, 1, read.info.points / 3, read.info.points - 1] {
            let record = read.source.record(point).unwrap();
            assert_eq!(record.len(), read.info.properties.len());
            let position = read.positions[point as usize];
            for (axis, name) in ["x", "y", "z"].iter().enumerate() {
                let text = &record.iter().find(|(property, _)| property == name).unwrap().1;
                let is_f32 = read.info.properties[0].column_type == cloud::ColumnType::F32;
                let value = if is_f32 { f64::from(text.parse::<f32>().unwrap()) } else { text.parse().unwrap() };
                assert_eq!(value, position[axis], "{path:?} {point} {name}");
            }
        }
        assert!(read.source.record(read.info.points).is_err());
    }
}

#[test]
fn records_of_text_are_the_tokens_of_the_file() {
    let Some(path) = data("ply/double_1e9_coordinates_ascii.ply") else { return };
    let text = std::fs::read_to_string(&path).unwrap();
    let last = text.lines().last().unwrap();
    let record = codec::open(&path).unwrap().record(0).unwrap();
    assert_eq!(record.iter().map(|(_, value)| value.as_str()).collect::<Vec<_>>(), last.split(' ').collect::<Vec<_>>());
}

#[test]
fn only_what_is_selected_is_given() {
    let Some(path) = data("ply/stanford_bunny_full_ascii_mesh.ply") else { return };
    let source = codec::open(&path).unwrap();
    let all = read_path(&path);
    let read = |selection: &Selection| {
        let chunks = Mutex::new(Vec::new());
        let summary =
            source.read(selection, &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
        assert_eq!(summary.points, 35_947);
        let mut chunks = chunks.into_inner().unwrap();
        chunks.sort_by_key(|chunk: &Chunk| chunk.first_point);
        chunks
    };
    let chunks = read(&Selection { attributes: vec![false, true], ..Selection::default() });
    assert!(chunks.iter().all(|chunk| chunk.positions.is_empty() && chunk.columns[0].is_none()));
    let intensity: Vec<f64> = (chunks.iter())
        .flat_map(|chunk| match chunk.columns[1].as_deref() {
            Some(Column::F32(values)) => values.iter().map(|&value| f64::from(value)).collect::<Vec<_>>(),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(intensity, all.attributes["intensity"]);
    let chunks = read(&Selection { positions: true, ..Selection::default() });
    assert!(chunks.iter().all(|chunk| chunk.columns == [const { None }; 5] && chunk.colors.is_none()));
    read(&Selection::default());
}

#[test]
fn a_cancelled_read_stops() {
    let Some(path) = data("ply/indoor_office_tls_rgb_third_binary_le.ply") else { return };
    let source = codec::open(&path).unwrap();
    let progress = Progress::default();
    let selection = everything(source.info());
    let summary = source.read(&selection, &progress, &|_| progress.cancel()).unwrap();
    assert!(summary.cancelled && summary.points > 0);
    assert!(summary.points < source.info().points, "{}", summary.points);
    assert_eq!(progress.total(), source.info().points);
}

#[test]
fn the_first_chunks_are_spread_over_the_file() {
    let Some(path) = data("ply/indoor_office_tls_rgb_third_binary_le.ply") else { return };
    let source = codec::open(&path).unwrap();
    let order = Mutex::new(Vec::new());
    let selection = Selection { positions: true, ..Selection::default() };
    source.read(&selection, &Progress::default(), &|chunk| order.lock().unwrap().push(chunk.first_point)).unwrap();
    let order = order.into_inner().unwrap();
    let quarters: std::collections::HashSet<u64> =
        order[..8].iter().map(|first| first * 4 / source.info().points).collect();
    assert_eq!(quarters.len(), 4, "{order:?}");
}

#[test]
fn blocks_of_uneven_lines_still_give_whole_chunks_in_order() {
    // The first lines are long, so blocks are cut for long lines, and then hold more short ones than a chunk may.
    let count = 300_000;
    let body: String = (0..count)
        .map(|row| if row < 5000 { format!("{row}.{} 0 0\n", "0".repeat(100)) } else { format!("{row} 0 0\n") })
        .collect();
    let read = read_bytes(&ascii(&format!("element vertex {count}\n{XYZ}"), &body));
    assert_eq!(read.positions.len(), count);
    assert!(read.positions.iter().enumerate().all(|(row, position)| position.x == row as f64));
    for row in [0, 4999, 5000, 65_535, 65_536, 200_001, 299_999] {
        assert_eq!(read.source.record(row).unwrap()[0].1.split('.').next(), Some(row.to_string().as_str()));
    }
}

/// A small generator for the damage: xorshift64, Marsaglia 2003.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit as u64) as usize
    }
}

#[test]
fn damaged_files_never_panic_and_end_soon() {
    let faces = "element face 3\nproperty list uchar int vertex_indices";
    let vertex = format!(
        "element vertex 4\n{XYZ}\nproperty double t\nproperty list ushort short l\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float nx\nproperty float ny\nproperty float nz"
    );
    let text = ascii(
        &format!("{faces}\n{vertex}"),
        "3 0 1 2\n3 1 2 3\n4 0 1 2 3\n0 0 0 1e5 2 7 8 1 2 3 0 0 1\n1 0 0 2 0 1 2 3 0 0 1\n0 1 0 3 1 5 1 2 3 0 0 1\n1 1 1 4 0 1 2 3 0 1 0\n",
    );
    let mut binary = format!("ply\nformat binary_big_endian 1.0\n{faces}\n{vertex}\nend_header\n").into_bytes();
    for face in 0..3 {
        binary.push(3);
        binary.extend([0, 0, 0, face, 0, 0, 0, 1, 0, 0, 0, 2]);
    }
    for row in 0..4_u8 {
        binary.extend([row; 20]);
        binary.extend([0, 2, 0, 1, 0, 2, 9, 8, 7]);
        binary.extend(0.5_f32.to_be_bytes().repeat(3));
    }
    let strided = [b"ply\nformat binary_little_endian 1.0\nelement vertex 20\nproperty float x\nproperty double y\nproperty short z\nproperty ushort r\nproperty ushort g\nproperty ushort b\nend_header\n".as_slice(), &[65; 20 * 20]].concat();
    let mut originals = vec![text, binary, strided];
    for name in [
        "malformed/ply_truncated_mesh.ply",
        "ply/text_extra_dim_ascii.ply",
        "ply/fuze_mesh_texcoord_list_binary_le.ply",
    ] {
        originals.extend(data(name).map(|path| std::fs::read(path).unwrap()));
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.ply");
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut opened = 0;
    for round in 0..3000 {
        let mut bytes = originals[round % originals.len()].clone();
        // Most damage goes into the header and the first rows, where it does most harm.
        let reach = if random.below(4) == 0 { bytes.len() } else { bytes.len().min(600) };
        for _ in 0..=random.below(6) {
            let at = random.below(reach.min(bytes.len()));
            match random.below(4) {
                0 => bytes[at] = random.below(256) as u8,
                1 => bytes[at] ^= 1 << random.below(8),
                2 => bytes[at] = b"0123456789 \n\r-.e"[random.below(16)],
                _ => bytes.truncate(at.max(5)),
            }
        }
        std::fs::write(&path, &bytes).unwrap();
        let start = Instant::now();
        if let Ok(source) = codec::open(&path) {
            opened += 1;
            let points = source.info().points;
            let _ = source.triangles();
            for point in [0, points / 2, points] {
                let _ = source.record(point);
            }
            let read = read_source(source).unwrap();
            assert_eq!(read.info.points, points);
            assert_eq!(read.summary.points, points, "round {round}: a read gives what opening promised");
        }
        assert!(start.elapsed() < Duration::from_secs(2), "round {round} took {:?}", start.elapsed());
    }
    assert!(opened > 500, "only {opened} of the damaged files opened: the damage is too coarse to test reading");
}

/// A property of a random file: its type, and for a list the type of its length.
#[derive(Clone, Debug)]
struct Schema {
    scalar: ply_rs::ply::ScalarType,
    list: bool,
}

fn schema() -> impl Strategy<Value = Vec<Schema>> {
    use ply_rs::ply::ScalarType::*;
    let scalar = prop::sample::select(vec![Char, UChar, Short, UShort, Int, UInt, Float, Double]);
    prop::collection::vec((scalar, prop::bool::weighted(0.2)).prop_map(|(scalar, list)| Schema { scalar, list }), 0..6)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Files of any schema and encoding that `ply-rs` writes are read back value for value.
    #[test]
    fn files_written_by_another_library_are_read_back(
        extra in schema(),
        at in 0_usize..6,
        encoding in 0..3,
        before in 0_usize..3,
        values in prop::collection::vec(prop::collection::vec(any::<i32>(), 12), 0..20),
    ) {
        use ply_rs::ply::{Addable, DefaultElement, ElementDef, Encoding, Ply, Property, PropertyDef, PropertyType, ScalarType};
        let make = |scalar: &ScalarType, value: i32| match scalar {
            ScalarType::Char => Property::Char(value as i8),
            ScalarType::UChar => Property::UChar(value as u8),
            ScalarType::Short => Property::Short(value as i16),
            ScalarType::UShort => Property::UShort(value as u16),
            ScalarType::Int => Property::Int(value),
            ScalarType::UInt => Property::UInt(value as u32),
            ScalarType::Float => Property::Float(value as f32 / 1000.0),
            ScalarType::Double => Property::Double(f64::from(value) / 1e6),
        };
        let make_list = |scalar: &ScalarType, length: usize| match scalar {
            ScalarType::Float => Property::ListFloat(vec![0.5; length]),
            ScalarType::Double => Property::ListDouble(vec![0.25; length]),
            ScalarType::Char => Property::ListChar(vec![-1; length]),
            ScalarType::UChar => Property::ListUChar(vec![1; length]),
            ScalarType::Short => Property::ListShort(vec![-2; length]),
            ScalarType::UShort => Property::ListUShort(vec![2; length]),
            ScalarType::Int => Property::ListInt(vec![-3; length]),
            ScalarType::UInt => Property::ListUInt(vec![3; length]),
        };
        // x, y and z as doubles, with the other properties between them.
        let mut names: Vec<(String, Schema)> =
            extra.iter().enumerate().map(|(index, schema)| (format!("p{index}"), schema.clone())).collect();
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            let place = (at + axis).min(names.len());
            names.insert(place, ((*name).into(), Schema { scalar: ScalarType::Double, list: false }));
        }
        let mut ply = Ply::<DefaultElement>::new();
        ply.header.encoding = [Encoding::Ascii, Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian][encoding as usize];
        let mut other = ElementDef::new("other".into());
        other.properties.add(PropertyDef::new("list".into(), PropertyType::List(ScalarType::UShort, ScalarType::Int)));
        let mut vertex = ElementDef::new("vertex".into());
        for (name, schema) in &names {
            let kind = if schema.list {
                PropertyType::List(ScalarType::UChar, schema.scalar.clone())
            } else {
                PropertyType::Scalar(schema.scalar.clone())
            };
            vertex.properties.add(PropertyDef::new(name.clone(), kind));
        }
        let rows: Vec<DefaultElement> = (values.iter())
            .map(|row| {
                let mut element = DefaultElement::new();
                for (index, (name, schema)) in names.iter().enumerate() {
                    let value = if schema.list {
                        make_list(&schema.scalar, row[index].unsigned_abs() as usize % 4)
                    } else {
                        make(&schema.scalar, row[index])
                    };
                    element.insert(name.clone(), value);
                }
                element
            })
            .collect();
        if before > 0 {
            let mut element = DefaultElement::new();
            element.insert("list".into(), Property::ListInt(vec![1; before - 1]));
            ply.header.elements.add(other);
            ply.payload.insert("other".into(), vec![element; before]);
        }
        ply.header.elements.add(vertex);
        ply.payload.insert("vertex".into(), rows);
        let mut bytes = Vec::new();
        ply_rs::writer::Writer::new().write_ply(&mut bytes, &mut ply).unwrap();

        let read = read_bytes(&bytes);
        prop_assert_eq!(read.positions.len(), values.len());
        for (point, row) in values.iter().enumerate() {
            for (index, (name, schema)) in names.iter().enumerate() {
                if schema.list {
                    let items = row[index].unsigned_abs() as usize % 4;
                    let text = &read.source.record(point as u64).unwrap()[index].1;
                    prop_assert_eq!(text.split(", ").filter(|item| *item != "[]").count(), items);
                    continue;
                }
                let expected = match make(&schema.scalar, row[index]) {
                    Property::Char(v) => f64::from(v),
                    Property::UChar(v) => f64::from(v),
                    Property::Short(v) => f64::from(v),
                    Property::UShort(v) => f64::from(v),
                    Property::Int(v) => f64::from(v),
                    Property::UInt(v) => f64::from(v),
                    Property::Float(v) => f64::from(v),
                    Property::Double(v) => v,
                    other => panic!("{other:?}"),
                };
                let found = match name.as_str() {
                    "x" => read.positions[point].x,
                    "y" => read.positions[point].y,
                    "z" => read.positions[point].z,
                    name => read.attributes[name][point],
                };
                prop_assert_eq!(found, expected, "{} of point {}", name, point);
            }
        }
    }
}

#[test]
fn colours_do_not_depend_on_a_few_values_beyond_their_range() {
    let header = format!("element vertex 1000\n{XYZ}\n");
    let file = |kind: &str, value: &dyn Fn(usize) -> String| {
        let colors = ["red", "green", "blue"].map(|name| format!("property {kind} {name}")).join("\n");
        let line = |index: usize| format!("{index} 0 0 {0} {0} {0}\n", value(index));
        read_bytes(&ascii(&format!("{header}{colors}"), &(0..1000).map(line).collect::<String>()))
    };
    for (kind, full, others) in [
        ("float", 1.0, &["1.0000001", "1.5", "255", "nan", "1e30"][..]),
        ("double", 255.0, &["255.001", "300", "65535", "nan"]),
        ("ushort", 255.0, &["256", "1000", "65535"]),
        ("ushort", 1023.0, &["1024", "65535"]),
        ("ushort", 4095.0, &["4096", "65535"]),
        ("ushort", 65_535.0, &["65535"]),
    ] {
        for other in others {
            let shade = |index: usize| full * ((index * 7 % 250) as f64 / 249.0);
            let text = |index: usize| match (index % 200, kind) {
                (199, _) => (*other).to_owned(),
                (_, "ushort") => shade(index).floor().to_string(),
                _ => shade(index).to_string(),
            };
            let read = file(kind, &text);
            let what = format!("{kind} to {full} with {other}");
            for (index, color) in read.colors.iter().enumerate().filter(|(index, _)| index % 200 != 199) {
                let expected = shade(index) / full * 255.0;
                assert!((f64::from(color[0]) - expected).abs() <= 1.0, "{what}: {} for {expected}", color[0]);
            }
            let clamped = if *other == "nan" { 0 } else { 255 };
            assert_eq!(read.colors[199], [clamped, clamped, clamped, 255], "{what}");
            let is_told = read.info.warnings.iter().any(|warning| warning.contains("bits"));
            assert_eq!(is_told, matches!(full, 1023.0 | 4095.0), "{what}: {:?}", read.info.warnings);
        }
    }
}

#[test]
fn decimal_commas_and_coordinates_that_are_no_numbers_are_refused_by_their_line() {
    let header = format!("element vertex 3\n{XYZ}\nproperty float wet");
    for (body, words) in [
        ("25,003819 32,5 0,2 1\n1,5 2 3 1\n1 2 3 1\n", "line 9: `25,003819` has a decimal comma"),
        ("\n1 2 3 4\n1 2 -3,25 4\n1 2 3 4\n", "line 11: `-3,25` has a decimal comma"),
        ("1 2 3 0,5\n1 2 3 0,25\n1 2 3 1\n", "line 9: `0,5` has a decimal comma"),
        ("1;2;3;4\n1;2;3;4\n1;2;3;4\n", "line 9: `1;2;3;4` is no number"),
    ] {
        let error = error_of(&ascii(&header, body));
        assert!(error.contains(words), "{error}");
    }
    let read = read_bytes(&ascii(&header, "1 2 3 4\n1, 2 3 4\n1 2 3 4\n"));
    assert!(read.positions[1].is_nan() && read.summary.warnings.len() == 1, "one line alone is damage");
}

#[test]
fn marks_and_blanks_before_the_signature_are_passed_over() {
    let plain = ascii(&format!("element vertex 1\n{XYZ}"), "1 2 3\n");
    for before in ["\u{feff}", " ", "\n", "\u{feff}\r\n"] {
        let read = read_bytes(&[before.as_bytes(), &plain].concat());
        assert_eq!(read.positions, [DVec3::new(1.0, 2.0, 3.0)], "{before:?}");
    }
    let blank = String::from_utf8(plain.clone()).unwrap().replacen("ply\n", "ply \r\n", 1);
    assert_eq!(read_bytes(blank.as_bytes()).positions.len(), 1);
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(plain.iter().flat_map(|byte| [*byte, 0])).collect();
    assert!(error_of(&wide).contains("UTF-16"));
}

#[test]
fn compressed_splats_are_read_as_those_that_are_not() {
    let scalars =
        |kind: &str, names: &[&str]| names.iter().map(|name| format!("property {kind} {name}\n")).collect::<String>();
    let ranges = ["min_x", "min_y", "min_z", "max_x", "max_y", "max_z", "min_scale_x", "min_scale_y", "min_scale_z"];
    let more = ["max_scale_x", "max_scale_y", "max_scale_z"];
    let colors = ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"];
    let words = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];
    for (has_colors, encoding) in
        [(false, "binary_little_endian"), (true, "binary_little_endian"), (true, "binary_big_endian")]
    {
        let is_big = encoding == "binary_big_endian";
        let mut file = format!("ply\nformat {encoding} 1.0\nelement chunk 2\n{}", scalars("float", &ranges));
        file += &scalars("float", &more);
        file += &scalars("float", if has_colors { &colors } else { &[] });
        file += &format!("element vertex 300\n{}end_header\n", scalars("uint", &words));
        let mut file = file.into_bytes();
        let mut put = |word: u32| file.extend(if is_big { word.to_be_bytes() } else { word.to_le_bytes() });
        for chunk in 0..2 {
            let start = 100.0 * chunk as f32;
            let values = [start, 0.0, -4.0, start + 20.47, 10.23, 16.47, -8.0, -8.0, -8.0, -2.0, -2.0, -2.0];
            values.into_iter().for_each(|value| put(value.to_bits()));
            [0.25_f32, 0.0, 0.0, 0.75, 1.0, 2.0]
                .into_iter()
                .take(if has_colors { 6 } else { 0 })
                .for_each(|v| put(v.to_bits()));
        }
        for vertex in 0..300_u32 {
            put((2 * vertex) << 21 | vertex << 11 | (3 * vertex));
            // The largest component is the second; the others are 0.
            put(1 << 30 | 511 << 20 | 512 << 10 | 511);
            put(2047 << 21 | 1023);
            put(255 << 24 | 51 << 16 | 128);
        }
        let read = read_bytes(&file);
        assert_eq!((read.positions.len(), read.info.has_colors), (300, true));
        assert!(
            read.info.warnings.iter().any(|warning| warning.contains("Gaussian splats")),
            "{:?}",
            read.info.warnings
        );
        for (vertex, place) in read.positions.iter().enumerate() {
            let number = vertex as f64;
            let start = if vertex < 256 { 0.0 } else { 100.0 };
            let expected = DVec3::new(start + 0.02 * number, 0.01 * number, -4.0 + 20.47 / 2047.0 * 3.0 * number);
            assert!((*place - expected).abs().max_element() < 1e-4, "{vertex}: {place} for {expected}");
        }
        // From 0.25 to 0.75, 0 to 1 and 0 to 2, where the file says so.
        assert_eq!(read.colors[7], if has_colors { [191, 51, 0, 128] } else { [255, 51, 0, 128] });
        let value = |name: &str| read.attributes[name][299];
        assert!((value("scale_0") + 2.0).abs() < 1e-6 && (value("scale_1") + 8.0).abs() < 1e-6);
        assert!((value("rot_1") - 1.0).abs() < 1e-5 && value("rot_0").abs() < 1e-3 && value("rot_3").abs() < 1e-3);
        let record = read.source.record(299).unwrap();
        assert!(record[0].0 == "x" && (record[0].1.parse::<f64>().unwrap() - 105.98).abs() < 1e-4, "{record:?}");
        // Fewer ranges than splats need, and no ranges at all.
        let text = String::from_utf8_lossy(&file[..file.iter().rposition(|b| *b == b'_').unwrap()]).into_owned();
        let header = text.find("end_header").unwrap();
        let few = [text[..header].replace("vertex 300", "vertex 600").as_bytes(), &file[header..]].concat();
        assert!(error_of(&few).contains("compressed Gaussian splats"));
        let none = [text[..header].replace("element chunk", "element lump").as_bytes(), &file[header..]].concat();
        assert!(error_of(&none).contains("no element chunk"));
    }
}
