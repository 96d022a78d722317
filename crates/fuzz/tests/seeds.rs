//! The seeds are written by our own writers, here: `UPDATE=1 cargo test --package fuzz --test seeds` writes them anew.
//! Beside them lie inputs that once broke something, under names that start with `found-`.
#![allow(clippy::unwrap_used, reason = "a seed that cannot be made is a failed test")]

use std::collections::BTreeSet;
use std::io::{Cursor, Seek as _, SeekFrom};
use std::sync::Arc;

use cloud::{Bounds, Orientation, Progress, SurfelOptions};
use fuzz::{MOST_BYTES, TARGETS, Target, folder, join};
use glam::{DVec3, Vec3};
use laz::laszip::{ChunkTable, LazItemRecordBuilder};
use laz::{LazVlr, LazVlrBuilder, ParLasZipCompressor};
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use scene::{
    Bookmark, Camera, CameraPath, Caption, Clip, ClipShape, CloudSettings, Filter, Keep, Keyframe, Measurement,
    MeasurementKind, Mirror, MirrorNormals, MirrorPoints, Note, PointChoice, Preferences, Prism, SceneFile, Settings,
    Shape, SpotLight, WipeState,
};

/// The most bytes of all seeds together.
const MOST_SEED_BYTES: usize = 100_000;

#[test]
fn the_seeds_are_what_our_writers_write() {
    let update = std::env::var_os("UPDATE").is_some();
    let mut wrong = Vec::new();
    let mut total = 0;
    for (target, seeds) in seeds() {
        let target = Target::named(target).unwrap();
        let folder = folder(target);
        let mut names: BTreeSet<String> = BTreeSet::new();
        for (name, bytes) in seeds {
            let path = folder.join(&name);
            if update {
                std::fs::create_dir_all(&folder).unwrap();
                std::fs::write(&path, &bytes).unwrap();
            }
            if !std::fs::read(&path).is_ok_and(|kept| kept == bytes) {
                wrong.push(format!("{}/{name} is not what is written today", target.name));
            }
            names.insert(name);
        }
        for entry in std::fs::read_dir(&folder).unwrap().flatten() {
            let name = entry.file_name().into_string().unwrap();
            total += entry.metadata().unwrap().len() as usize;
            if !names.contains(&name) && !name.starts_with("found-") {
                wrong.push(format!("nothing writes {}/{name}", target.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}; UPDATE=1 writes them anew");
    assert!(total < MOST_SEED_BYTES, "{total} bytes of seeds");
}

#[test]
fn every_target_has_seeds_that_are_read_to_their_end() {
    let bench = fuzz::Bench::new().unwrap();
    let all = seeds();
    let names: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, TARGETS.iter().map(|target| target.name).collect::<Vec<_>>());
    for (name, seeds) in all {
        let has_points = !["catalogue", "scene", "view", "plan", "preferences"].contains(&name);
        for (seed, bytes) in seeds {
            assert!(bytes.len() < MOST_BYTES);
            let points = bench.run(Target::named(name).unwrap(), &bytes).unwrap();
            assert_eq!(points > 0, has_points, "{name}/{seed}: {points} points");
        }
    }
}

type Seeds = Vec<(String, Vec<u8>)>;

/// The seeds of each target, in the order of `TARGETS`.
fn seeds() -> Vec<(&'static str, Seeds)> {
    let named = |seeds: Vec<(&str, Vec<u8>)>| seeds.into_iter().map(|(name, bytes)| (name.to_owned(), bytes)).collect();
    let index = vec![("terrain", index())];
    vec![
        ("las_header", headers()),
        ("las_records", named(vec![("las", with_records()), ("laz", compressed(&with_records(), &[5, 3]))])),
        (
            "las_points",
            named(vec![
                ("las-2", las(2, &[], 60)),
                ("las-7", las(7, &extra_bytes(), 40)),
                ("laz-3", compressed(&las(3, &[], 300), &[300])),
                ("laz-8", compressed(&las(8, &extra_bytes(), 300), &[300])),
            ]),
        ),
        (
            "laz_chunks",
            named(vec![
                ("fixed-0", compressed(&las(0, &[], 20), &[])),
                ("fixed-3", compressed(&las(3, &extra_bytes(), 20), &[])),
                ("variable-1", compressed(&las(1, &[], 20), &[7, 12, 1])),
                ("fixed-6", compressed(&las(6, &[], 20), &[])),
                ("variable-7", compressed(&las(7, &extra_bytes(), 20), &[7, 12, 1])),
                ("variable-8", compressed(&las(8, &[], 20), &[10, 10])),
            ]),
        ),
        ("copc", named(vec![("one-node", copc_of_ours()), ("pages", copc_with_pages())])),
        ("ply_header", named(vec![("text", ply_text()), ("little", ply_bytes(false)), ("splats", ply_splats())])),
        ("ply_rows", named(vec![("text", ply_text()), ("little", ply_bytes(false)), ("big", ply_bytes(true))])),
        ("e57", named(vec![("scans", e57_scans())])),
        (
            "pcd",
            named(vec![
                ("text", pcd("ascii", b"1 2 3 4.2e6 9\n2 3 4 0 8\n3 4 5 1e-39 7\n")),
                ("binary", pcd("binary", &pcd_rows())),
                ("compressed", pcd("binary_compressed", &pcd_compressed())),
            ]),
        ),
        (
            "table",
            named(vec![
                (
                    "names.csv",
                    b"X,Y,Z,Intensity,R,G,B\n1.5,2,3,-700,255,0,9\n4,5.25,6,12,0,128,9\n7,8,9,1,2,3,4\n".to_vec(),
                ),
                ("commas.txt", b"1,5 2,5 3,25 7\n4,0 5,0 6,0 8\n".to_vec()),
                ("two.pts", b"3\n1 2 3 -5 1 2 3\n4 5 6 -6 4 5 6\n7 8 9 -7 7 8 9\n1\n1 2 3 4\n".to_vec()),
                ("two.ptx", [ptx(2, 2), ptx(1, 3)].concat().into_bytes()),
            ]),
        ),
        ("ept", named(vec![("binary", ept_of_rows()), ("laszip", ept_of_laz()), ("zstandard", ept_compressed())])),
        ("catalogue", named(vec![("two.vpc", catalogue())])),
        ("answers", named(vec![("whole", answer(false)), ("part", answer(true))])),
        ("index_nodes", named(index.clone())),
        ("index_pages", named(index.clone())),
        ("index_surfels", named(index)),
        ("scene", named(vec![("all.toml", scene().into_bytes())])),
        ("view", named(vec![("all.toml", view().into_bytes())])),
        ("plan", named(vec![("sweeps.toml", plan("initial-step")), ("methods.toml", plan("methods"))])),
        ("preferences", named(vec![("viewer.toml", preferences().into_bytes())])),
    ]
}

/// Two scans with columns of all kinds, one with a pose, and some invalid points.
fn e57_scans() -> Vec<u8> {
    use e57::{E57Writer, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform, Translation};
    let record = |name: RecordName, data_type: RecordDataType| Record { name, data_type };
    let scaled = RecordDataType::ScaledInteger { min: -1000, max: 1000, scale: 0.01, offset: 1.0 };
    let prototype = vec![
        record(RecordName::CartesianX, RecordDataType::F64),
        record(RecordName::CartesianY, RecordDataType::F32),
        record(RecordName::CartesianZ, scaled),
        record(RecordName::CartesianInvalidState, RecordDataType::Integer { min: 0, max: 2 }),
        record(RecordName::Intensity, RecordDataType::Integer { min: 0, max: 4095 }),
        record(RecordName::ColorRed, RecordDataType::U8),
        record(RecordName::ColorGreen, RecordDataType::U8),
        record(RecordName::ColorBlue, RecordDataType::U8),
    ];
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "file").unwrap();
    for number in 0..2 {
        let mut scan = writer.add_pointcloud("scan", prototype.clone()).unwrap();
        let turned = Transform {
            rotation: Quaternion { w: 0.6, x: 0.0, y: 0.0, z: 0.8 },
            translation: Translation { x: 1.0, y: 2.0, z: 3.0 },
        };
        scan.set_transform((number == 0).then_some(turned));
        for at in 0..20_u8 {
            let whole = i64::from(at);
            let values = vec![
                RecordValue::Double(f64::from(at) * 0.1),
                RecordValue::Single(f32::from(at)),
                RecordValue::ScaledInteger(whole - 10),
                RecordValue::Integer(2 * i64::from(at % 7 == 3)),
                RecordValue::Integer(whole * 200),
                RecordValue::Integer(whole),
                RecordValue::Integer(255 - whole),
                RecordValue::Integer(9),
            ];
            scan.add_point(values).unwrap();
        }
        scan.finalize().unwrap();
    }
    writer.finalize().unwrap();
    drop(writer);
    bytes.into_inner()
}

fn pcd(data: &str, points: &[u8]) -> Vec<u8> {
    let header = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb label\nSIZE 4 4 4 4 2\nTYPE F F F F U\nCOUNT 1 1 1 1 1\n\
                  WIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 1 1 0 0 0\nPOINTS 3\nDATA ";
    [header.as_bytes(), data.as_bytes(), b"\n", points].concat()
}

fn pcd_rows() -> Vec<u8> {
    (0..3 * 18).map(|byte: u8| byte / 4).collect()
}

fn pcd_compressed() -> Vec<u8> {
    let rows = pcd_rows();
    // Runs of up to 32 bytes.
    let runs: Vec<u8> = rows.chunks(32).flat_map(|run| [&[run.len() as u8 - 1], run].concat()).collect();
    [&(runs.len() as u32).to_le_bytes()[..], &(rows.len() as u32).to_le_bytes(), &runs].concat()
}

fn ptx(columns: usize, rows: usize) -> String {
    let frame = "1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n0 0 0 0.5\n";
    let points: String = (1..columns * rows).map(|at| format!("{at} 0.5 -2 0.25\n")).collect();
    format!("{columns}\n{rows}\n{frame}{points}")
}

/// The bytes of a record of point formats 0 to 10.
const LENGTHS: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// A LAS file of `points` points, of version 1.4 if the format needs it, else 1.2. `records` are (user, identifier,
/// data).
fn las(format: u8, records: &[(&str, u16, Vec<u8>)], points: usize) -> Vec<u8> {
    let extra: usize =
        records.iter().filter(|(_, identifier, _)| *identifier == 4).map(|record| record.2.len() / 192).sum();
    let record_length = usize::from(LENGTHS[usize::from(format)]) + 4 * extra;
    let minor: u8 = if format >= 6 { 4 } else { 2 };
    let header_length: usize = if minor == 4 { 375 } else { 227 };
    let records: Vec<u8> =
        records.iter().flat_map(|(user, identifier, data)| record(user, *identifier, data)).collect();
    let count = records_in(&records);
    let mut file = vec![0; header_length];
    let mut put = |at: usize, field: &[u8]| file[at..at + field.len()].copy_from_slice(field);
    put(0, b"LASF");
    put(24, &[1, minor]);
    put(26, b"glint");
    put(94, &(header_length as u16).to_le_bytes());
    put(96, &((header_length + records.len()) as u32).to_le_bytes());
    put(100, &count.to_le_bytes());
    put(104, &[format]);
    put(105, &(record_length as u16).to_le_bytes());
    if minor == 4 {
        put(6, &16_u16.to_le_bytes());
        put(247, &(points as u64).to_le_bytes());
    } else {
        put(107, &(points as u32).to_le_bytes());
    }
    let bounds = [(0.0, 64.0), (100.0, 164.0), (0.0, 8.0)];
    for (axis, (least, most)) in bounds.into_iter().enumerate() {
        put(131 + 8 * axis, &0.01_f64.to_le_bytes());
        put(155 + 8 * axis, &f64::to_le_bytes(least));
        put(179 + 16 * axis, &f64::to_le_bytes(most));
        put(187 + 16 * axis, &f64::to_le_bytes(least));
    }
    file.extend(records);
    for index in 0..points {
        let mut record = vec![0; record_length];
        let side = index as i32 % 8;
        let raw = [side * 700 + index as i32, (index as i32 / 8 * 40) % 6000, (side - 4).abs() * 90];
        record[..12].copy_from_slice(raw.map(i32::to_le_bytes).as_flattened());
        for (at, byte) in record.iter_mut().enumerate().skip(12) {
            *byte = (index / 4 + at) as u8;
        }
        record[14] = 0x11;
        file.extend(record);
    }
    file
}

fn record(user: &str, identifier: u16, data: &[u8]) -> Vec<u8> {
    let mut record = vec![0; 54];
    record[2..2 + user.len()].copy_from_slice(user.as_bytes());
    record[18..20].copy_from_slice(&identifier.to_le_bytes());
    record[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
    record.extend_from_slice(data);
    record
}

fn records_in(records: &[u8]) -> u32 {
    let (mut at, mut count) = (0, 0);
    while at < records.len() {
        at += 54 + usize::from(u16::from_le_bytes([records[at + 20], records[at + 21]]));
        count += 1;
    }
    count
}

/// Extra dimensions of four bytes each: a scaled integer and a float.
fn extra_bytes() -> Vec<(&'static str, u16, Vec<u8>)> {
    let descriptor = |name: &str, data_type: u8, options: u8| {
        let mut bytes = vec![0; 192];
        bytes[2] = data_type;
        bytes[3] = options;
        bytes[4..4 + name.len()].copy_from_slice(name.as_bytes());
        bytes[112..120].copy_from_slice(&0.5_f64.to_le_bytes());
        bytes[136..144].copy_from_slice(&10.0_f64.to_le_bytes());
        bytes
    };
    vec![("LASF_Spec", 4, [descriptor("range", 6, 24), descriptor("planarity", 9, 0)].concat())]
}

fn headers() -> Seeds {
    let of = |format: u8| (format!("las-{format}"), las(format, &[], 8));
    let mut seeds: Seeds = [0, 1, 3, 4, 6, 7, 8, 10].map(of).into();
    seeds.push(("laz-7".into(), compressed(&las(7, &[], 8), &[])));
    seeds
}

fn with_records() -> Vec<u8> {
    let keys: Vec<u8> =
        [1_u16, 1, 0, 2, 3072, 0, 1, 25832, 1026, 34737, 6, 0].into_iter().flat_map(u16::to_le_bytes).collect();
    let mut records = vec![
        ("LASF_Projection", 2112, b"PROJCS[\"ETRS89 / UTM zone 32N\"]\0".to_vec()),
        ("LASF_Projection", 34735, keys),
        ("LASF_Projection", 34737, b"ETRS89|".to_vec()),
    ];
    records.extend(extra_bytes());
    las(7, &records, 8)
}

/// Makes a LAZ file of a LAS file, in chunks of the given numbers of points, or of eight if none are given.
fn compressed(las: &[u8], chunks: &[usize]) -> Vec<u8> {
    let number = |at: usize| u32::from_le_bytes([las[at], las[at + 1], las[at + 2], las[at + 3]]);
    let (start, count, format) = (number(96) as usize, number(100), las[104]);
    let length = u16::from_le_bytes([las[105], las[106]]);
    let items =
        LazItemRecordBuilder::default_for_point_format_id(format, length - LENGTHS[usize::from(format)]).unwrap();
    let vlr = LazVlrBuilder::new(items);
    let vlr = if chunks.is_empty() { vlr.with_fixed_chunk_size(8) } else { vlr.with_variable_chunk_size() }.build();
    let mut data = Vec::new();
    vlr.write_to(&mut data).unwrap();
    let mut file = las[..start].to_vec();
    file.extend(record(LazVlr::USER_ID, LazVlr::RECORD_ID, &data));
    file[104] |= 0x80;
    let data_start = file.len() as u32;
    file[96..100].copy_from_slice(&data_start.to_le_bytes());
    file[100..104].copy_from_slice(&(count + 1).to_le_bytes());

    let mut cursor = Cursor::new(file);
    cursor.seek(SeekFrom::End(0)).unwrap();
    let mut compressor = ParLasZipCompressor::new(cursor, vlr).unwrap();
    if chunks.is_empty() {
        compressor.compress_many(&las[start..]).unwrap();
    } else {
        let mut rest = &las[start..];
        let pieces: Vec<&[u8]> =
            chunks.iter().map(|points| rest.split_off(..points * usize::from(length)).unwrap()).collect();
        compressor.compress_chunks(pieces).unwrap();
    }
    compressor.done().unwrap();
    compressor.into_inner().into_inner()
}

fn copc_of_ours() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("a.las"), folder.path().join("a.copc.laz"));
    std::fs::write(&input, las(7, &[], 40)).unwrap();
    codec::write_copc(&[input], &output, 64 << 20, &Progress::default()).unwrap().unwrap();
    std::fs::read(output).unwrap()
}

/// A COPC file with a root, two nodes below it, and one of them on a page of its own. The project's writer makes no
/// second page for so few points.
fn copc_with_pages() -> Vec<u8> {
    let chunks = [20, 12, 8];
    let mut info = vec![0; 160];
    let cube = [128.0, 128.0, 128.0, 128.0, 2.0];
    for (field, value) in cube.into_iter().enumerate() {
        info[8 * field..8 * field + 8].copy_from_slice(&f64::to_le_bytes(value));
    }
    let mut file = compressed(&las(7, &[("copc", 1, info)], 40), &chunks);
    let number = |file: &[u8], at: usize| u64::from_le_bytes(file[at..at + 8].try_into().unwrap());
    let start = u64::from(number(&file, 96) as u32);
    let mut table = Cursor::new(&file[number(&file, start as usize) as usize..]);
    let table = ChunkTable::read(&mut table, true).unwrap();
    let mut offset = start + 8;
    let pages_start = file.len() as u64 + 60;
    let entry = |key: [u32; 4], offset: u64, length: u64, points: i32| {
        let mut entry = key.map(u32::to_le_bytes).as_flattened().to_vec();
        entry.extend(offset.to_le_bytes());
        entry.extend((length as u32).to_le_bytes());
        entry.extend(points.to_le_bytes());
        entry
    };
    let mut entries = Vec::new();
    for (key, chunk) in [[0, 0, 0, 0], [1, 0, 0, 0], [2, 0, 1, 0]].into_iter().zip(&table) {
        if key[0] == 2 {
            entries.push(entry(key, pages_start + 96, 32, -1));
        }
        entries.push(entry(key, offset, chunk.byte_count, chunk.point_count as i32));
        offset += chunk.byte_count;
    }
    let pages = entries.concat();
    // The head of an extended record has a length of eight bytes.
    let mut head = record("copc", 1000, &[]);
    head.splice(20..22, (pages.len() as u64).to_le_bytes());
    let at = file.len() as u64;
    file.extend(head);
    file.extend(&pages);
    file[235..243].copy_from_slice(&at.to_le_bytes());
    file[243..247].copy_from_slice(&1_u32.to_le_bytes());
    file[429 + 40..429 + 48].copy_from_slice(&pages_start.to_le_bytes());
    file[429 + 48..429 + 56].copy_from_slice(&96_u64.to_le_bytes());
    file
}

fn ply_text() -> Vec<u8> {
    let rows: String = (0..12)
        .map(|i| {
            format!("{}.5 {} -{}e-2 {} {} 0 0.1 0.2 0.9 {}\n", i, i * 3 % 7, i, 20 * i, 255 - i, f64::from(i) / 7.0)
        })
        .collect();
    format!(
        "ply\nformat ascii 1.0\ncomment of glint\nelement vertex 12\nproperty double x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float nx\nproperty float ny\nproperty float nz\n\
         property float scalar_Intensity\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n{rows}\
         3 0 1 2\n4 3 4 5 6\n"
    )
    .into_bytes()
}

fn ply_bytes(is_big: bool) -> Vec<u8> {
    let order = if is_big { "big" } else { "little" };
    let mut file = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement station 1\nproperty list ushort double where\nelement vertex 20\n\
         property float x\nproperty float y\nproperty float z\nproperty ushort intensity\nproperty list uchar short echoes\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\nelement tristrips 1\n\
         property list int int vertex_indices\nend_header\n"
    )
    .into_bytes();
    let mut put = |bytes: &[u8]| if is_big { file.extend(bytes.iter().rev()) } else { file.extend(bytes) };
    put(&1_u16.to_le_bytes());
    put(&2.5_f64.to_le_bytes());
    for index in 0..20_u16 {
        let at = f32::from(index);
        [at, at * 0.5, -at].iter().for_each(|value| put(&value.to_le_bytes()));
        put(&(index * 300).to_le_bytes());
        let echoes = index % 3;
        put(&[echoes as u8]);
        (0..echoes).for_each(|echo| put(&echo.to_le_bytes()));
        [10, 200, index as u8, 255].iter().for_each(|byte| put(&[*byte]));
    }
    put(&5_i32.to_le_bytes());
    [0, 1, 2, -1, 3].iter().for_each(|index: &i32| put(&index.to_le_bytes()));
    file
}

/// A PLY file of one Gaussian splat and half of a second one.
fn ply_splats() -> Vec<u8> {
    let names = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String = names.split(' ').map(|name| format!("property float {name}\n")).collect();
    let mut file =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex 8\n{properties}end_header\n").into_bytes();
    (0..8 * 17).for_each(|value: u16| file.extend((f32::from(value) / 16.0).to_le_bytes()));
    file
}

/// The description of an EPT whose cube is 100 wide.
fn ept_description(kind: &str, points: usize) -> String {
    let axis = |name| format!(r#"{{ "name": "{name}", "type": "signed", "size": 4, "scale": 0.01, "offset": 0 }}"#);
    let color = r#"{ "name": "Red", "type": "unsigned", "size": 2 }"#;
    let schema = [axis("X"), axis("Y"), axis("Z"), color.to_owned()].join(",\n    ");
    format!(
        "{{\n  \"bounds\": [ 0, 0, 0, 100, 100, 100 ],\n  \"boundsConforming\": [ 0, 0, 0, 50, 50, 50 ],\n  \
         \"dataType\": \"{kind}\",\n  \"hierarchyType\": \"json\",\n  \"points\": {points},\n  \"schema\": [\n    \
         {schema}\n  ],\n  \"span\": 128,\n  \"srs\": {{ \"wkt\": \"\" }},\n  \"version\": \"1.0.0\"\n}}\n"
    )
}

fn ept_rows(count: i32) -> Vec<u8> {
    let row =
        |row: i32| [row * 100, row * 200, row * 300].map(i32::to_le_bytes).concat().into_iter().chain([7, row as u8]);
    (0..count).flat_map(row).collect()
}

fn ept_of_rows() -> Vec<u8> {
    join([ept_description("binary", 8).as_bytes(), b"{ \"0-0-0-0\": 8 }\n", &ept_rows(8)])
}

fn ept_compressed() -> Vec<u8> {
    let tile = compress_to_vec(ept_rows(30).as_slice(), CompressionLevel::Fastest);
    join([ept_description("zstandard", 30).as_bytes(), b"{ \"0-0-0-0\": 30 }\n", &tile])
}

fn ept_of_laz() -> Vec<u8> {
    let tile = compressed(&las(7, &[], 20), &[20]);
    join([ept_description("laszip", 20).as_bytes(), b"{ \"0-0-0-0\": 20, \"1-0-0-0\": -1 }\n", &tile])
}

fn catalogue() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["a.las", "b.las"].map(|name| folder.path().join(name));
    let sources = paths.map(|path| {
        std::fs::write(&path, las(3, &[], 20)).unwrap();
        codec::open(&path).unwrap()
    });
    let tile = |source| {
        let info = codec::Source::info(source);
        codec::CatalogueTile { info, points: info.points, bounds: info.bounds.unwrap() }
    };
    let output = folder.path().join("two.vpc");
    codec::write_catalogue(&sources.iter().map(tile).collect::<Vec<_>>(), &output).unwrap();
    std::fs::read(output).unwrap()
}

/// The answer of a server that gives a file of 20 points whole, or says that it is all of a part.
fn answer(is_part: bool) -> Vec<u8> {
    let file = las(3, &[], 20);
    let (last, length) = (file.len() - 1, file.len());
    let head = match is_part {
        true => format!("HTTP/1.1 206 Part\r\ncontent-range: bytes 0-{last}/{length}"),
        false => "HTTP/1.1 200 OK".to_owned(),
    };
    let head = format!("{head}\r\ncontent-length: {length}\r\netag: \"1\"\r\n\r\n");
    [head.as_bytes(), &file].concat()
}

/// An index with normals and radii. Its key belongs to no file, so that it is the same each time.
fn index() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("a.las");
    std::fs::write(&input, las(7, &extra_bytes(), 100)).unwrap();
    let source = Arc::new(codec::open(&input).unwrap());
    let cache = stream::Cache::new(folder.path().join("cache"), u64::MAX);
    let progress = Progress::default();
    let pages = stream::build(&[source], &cache, &stream::BuildOptions::default(), &progress, &|_| ()).unwrap();
    let options = SurfelOptions {
        neighbours: 16,
        orientation: Orientation::Up(Vec3::Z),
        radii: cloud::RadiusRule::Full,
        seen_from: None,
    };
    stream::estimate_surfels(&pages, &options, 64 << 20, &progress).unwrap();
    let file = |name: &str| std::fs::read(pages.folder().join(name)).unwrap();
    let mut nodes = file("nodes");
    nodes[16..32].fill(0);
    let mut index = join([&nodes, &file("pages"), &file("surfels")]);
    Target::named("index_nodes").unwrap().repair(&mut index);
    index
}

fn level() -> Camera {
    Camera::looking(DVec3::new(1.0, 2.0, 3.0), DVec3::X, 12.5, DVec3::Z)
}

fn scene() -> String {
    let mut settings = Settings::default();
    settings.set_text("splat.size", "0.3").unwrap();
    settings.set_text("splat.quality", "nearest").unwrap();
    let mut file = SceneFile::new(vec!["office.laz".into(), "five-mirrors/sphere".into()], level(), &settings);
    file.mirrors = Shape::WITH_FORMULA
        .into_iter()
        .map(|shape| Mirror::standing(shape, DVec3::ONE, DVec3::Z, DVec3::Z, 0.5))
        .collect();
    file.lights = vec![SpotLight {
        position: DVec3::new(0.0, 0.0, 3.0),
        target: DVec3::ZERO,
        intensity: [10.0; 3],
        inner_degrees: 20.0,
        outer_degrees: 25.0,
    }];
    let points = [
        PointChoice::All,
        PointChoice::Class(9),
        PointChoice::Box { min: DVec3::ZERO, max: DVec3::ONE },
        PointChoice::Attribute { name: "intensity".into(), low: 1.0, high: 2.0 },
    ];
    let normals = [
        MirrorNormals::Own,
        MirrorNormals::Flatten,
        MirrorNormals::Smooth { radius: 0.5 },
        MirrorNormals::Fit { neighbours: 12 },
    ];
    file.mirror_points = points
        .into_iter()
        .zip(normals)
        .map(|(points, normals)| MirrorPoints { points, normals, ..MirrorPoints::whole("office.laz".into()) })
        .collect();
    let mut own = CloudSettings { on: false, size: 1.5, ..CloudSettings::of("office.laz".into()) };
    own.set_color("by", "height");
    own.set_color("low", "0.25");
    file.cloud_settings = vec![own];
    file.visibility.hidden_classes = [7, 18].into();
    file.visibility.filters = vec![Filter { attribute: "intensity".into(), low: 100.0, high: f64::INFINITY }];
    let prism = Prism { points: vec![DVec3::ZERO, DVec3::X, DVec3::Y], direction: DVec3::Z, eye: Some(-DVec3::Z) };
    let shapes = [ClipShape::Box, ClipShape::Sphere, ClipShape::Slab, ClipShape::Prism(prism)];
    let around = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
    file.clips = shapes.into_iter().map(|shape| Clip::around(shape, around)).collect();
    file.clips[1].keep = Keep::Outside;
    file.measurements = MeasurementKind::ALL.map(measurement).to_vec();
    file.notes = vec![Note::new("a crack".into(), DVec3::ONE, level())];
    let keyframe = |time: f64| {
        let Camera { eye, pivot, up } = level();
        Keyframe { time, eye: eye + DVec3::Y * time, pivot, up }
    };
    file.bookmarks = vec![Bookmark::new("door".into(), Some(1), level())];
    file.paths = vec![CameraPath {
        name: "tour".into(),
        keyframes: vec![keyframe(0.0), keyframe(2.5)],
        captions: vec![Caption::new("by {reflection.method}".into(), 0.5, Some(2.0))],
        states: vec![WipeState::of_method("sscr"), WipeState::of_method("ray_trace")],
        ..CameraPath::default()
    }];
    file.to_text()
}

fn measurement(kind: MeasurementKind) -> Measurement {
    let points = (0..*kind.corners().start()).map(|i| DVec3::new(i as f64, (i % 2) as f64, 0.5)).collect();
    Measurement {
        name: kind.name().into(),
        kind,
        on: true,
        color: [1.0, 0.5, 0.0],
        points,
        reach: kind.has_reach().then_some(0.25),
        level: (kind == MeasurementKind::Volume).then_some(1.5),
    }
}

/// A view with every parameter at its default.
fn view() -> String {
    let mut file = SceneFile::new(Vec::new(), level(), &Settings::default());
    for params in Settings::default().groups() {
        let group = params.group();
        for (field, value) in group.fields.iter().zip(params.values()) {
            let text = toml::Value::String(field.format(&value));
            file.parameters.insert(format!("{}.{}", group.name, field.name), text);
        }
    }
    file.to_text()
}

fn preferences() -> String {
    let mut preferences = Preferences::default();
    ["office.laz", "five-mirrors/sphere"].iter().for_each(|name| preferences.remember_file(name));
    let mut settings = Settings::default();
    for (key, text) in [("splat.size", "2.5"), ("edl.strength", "0.5"), ("reflection.method", "sscr")] {
        settings.set_text(key, text).unwrap();
    }
    preferences.remember_settings(&settings);
    preferences.to_text()
}

fn plan(name: &str) -> Vec<u8> {
    study::built_in_plan(name).unwrap().unwrap().to_text().into_bytes()
}
