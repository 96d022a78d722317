//! All formats in, all formats out, with all attributes: what becomes of each, as independent readers find it (the crates
//! `las` and `ply-rs-bw`; a table is split at its commas). docs/formats.md has the result.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

mod las_files;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloud::{PointTest, Progress};
use codec::{ExportFormat, export, write_copc};
use las_files::{Chunks, compress, descriptor, las_file, points};
use ply_rs::parser::Parser;
use ply_rs::ply::{DefaultElement, Ply, Property};

const MEMORY: u64 = 64 << 20;
const POINTS: usize = 300;
/// The number of each point, by which those of two files are matched.
const NUMBER: &str = "number";
/// The formats that are written, by the endings of their files.
const OUTPUTS: [&str; 6] = ["las", "laz", "copc.laz", "e57", "ply", "csv"];
/// The two marks between which docs/formats.md has the table.
const MARKS: [&str; 2] = ["<!-- The table is written by a test. -->\n", "<!-- End of the table. -->\n"];

/// The values of points by attribute, in the order of their numbers.
type Table = BTreeMap<String, Vec<f64>>;

fn sorted(mut table: Table) -> Table {
    let numbers = table[NUMBER].clone();
    let mut order: Vec<usize> = (0..numbers.len()).collect();
    order.sort_by(|a, b| numbers[*a].total_cmp(&numbers[*b]));
    table.values_mut().for_each(|values| *values = order.iter().map(|index| values[*index]).collect());
    table
}

fn las_table(path: &Path) -> (Table, u8) {
    let mut reader = las::Reader::from_path(path).unwrap();
    let format = *reader.header().point_format();
    let data = reader.read_all().unwrap();
    let mut table = Table::new();
    let vlrs = reader.header().all_vlrs().filter(|vlr| vlr.user_id == "LASF_Spec" && vlr.record_id == 4);
    let descriptors: Vec<u8> = vlrs.flat_map(|vlr| vlr.data.clone()).collect();
    for point in data.points().map(Result::unwrap) {
        let mut put = |name: &str, value: f64| table.entry(name.to_owned()).or_default().push(value);
        let bit = |value: bool| f64::from(u8::from(value));
        put("x", point.x);
        put("y", point.y);
        put("z", point.z);
        put("intensity", f64::from(point.intensity));
        put("return_number", f64::from(point.return_number));
        put("number_of_returns", f64::from(point.number_of_returns));
        put("scan_direction_flag", bit(point.scan_direction == las::point::ScanDirection::LeftToRight));
        put("edge_of_flight_line", bit(point.is_edge_of_flight_line));
        put("classification", f64::from(u8::from(point.classification)));
        put("synthetic", bit(point.is_synthetic));
        put("key_point", bit(point.is_key_point));
        put("withheld", bit(point.is_withheld));
        put("user_data", f64::from(point.user_data));
        put("scan_angle", f64::from(point.scan_angle));
        put("point_source_id", f64::from(point.point_source_id));
        if format.is_extended {
            put("overlap", bit(point.is_overlap));
            put("scanner_channel", f64::from(point.scanner_channel));
        }
        point.gps_time.into_iter().for_each(|value| put("gps_time", value));
        if let Some(color) = point.color {
            put("red", f64::from(color.red));
            put("green", f64::from(color.green));
            put("blue", f64::from(color.blue));
        }
        point.nir.into_iter().for_each(|value| put("nir", f64::from(value)));
        if let Some(wave) = point.waveform {
            put("wavepacket_index", f64::from(wave.wave_packet_descriptor_index));
            put("wavepacket_offset", wave.byte_offset_to_waveform_data as f64);
            put("wavepacket_size", f64::from(wave.waveform_packet_size_in_bytes));
            put("return_point_wave_location", f64::from(wave.return_point_waveform_location));
            put("x_t", f64::from(wave.x_t));
            put("y_t", f64::from(wave.y_t));
            put("z_t", f64::from(wave.z_t));
        }
        let mut rest = &point.extra_bytes[..];
        for descriptor in descriptors.chunks_exact(192) {
            macro_rules! number {
                ($number:ty) => {{
                    let (own, others) = rest.split_at(size_of::<$number>());
                    rest = others;
                    <$number>::from_le_bytes(own.try_into().unwrap()) as f64
                }};
            }
            let value = match descriptor[2] {
                1 => number!(u8),
                2 => number!(i8),
                3 => number!(u16),
                4 => number!(i16),
                5 => number!(u32),
                6 => number!(i32),
                7 => number!(u64),
                8 => number!(i64),
                9 => number!(f32),
                10 => number!(f64),
                other => panic!("type {other}"),
            };
            let name = descriptor[4..36].split(|byte| *byte == 0).next().unwrap();
            put(std::str::from_utf8(name).unwrap(), value);
        }
    }
    (sorted(table), format.to_u8().unwrap())
}

fn ply_table(path: &Path) -> Table {
    let ply: Ply<DefaultElement> = Parser::new().read_ply(&mut Cursor::new(std::fs::read(path).unwrap())).unwrap();
    let mut table = Table::new();
    for row in &ply.payload["vertex"] {
        for (name, value) in row {
            let value = match value {
                Property::Char(value) => f64::from(*value),
                Property::UChar(value) => f64::from(*value),
                Property::Short(value) => f64::from(*value),
                Property::UShort(value) => f64::from(*value),
                Property::Int(value) => f64::from(*value),
                Property::UInt(value) => f64::from(*value),
                Property::Float(value) => f64::from(*value),
                Property::Double(value) => *value,
                other => panic!("{other:?}"),
            };
            table.entry(name.to_string()).or_default().push(value);
        }
    }
    sorted(table)
}

/// The points of the first scan, with the names that columns have here, read by the crate `e57`.
fn e57_table(path: &Path) -> Table {
    let mut reader = e57::E57Reader::from_file(path).unwrap();
    let scan = reader.pointclouds().remove(0);
    let name = |record: &e57::Record| match &record.name {
        e57::RecordName::CartesianX => "x".to_owned(),
        e57::RecordName::CartesianY => "y".into(),
        e57::RecordName::CartesianZ => "z".into(),
        e57::RecordName::ColorRed => "red".into(),
        e57::RecordName::ColorGreen => "green".into(),
        e57::RecordName::ColorBlue => "blue".into(),
        e57::RecordName::Intensity => "intensity".into(),
        e57::RecordName::ReturnIndex => "return_number".into(),
        e57::RecordName::ReturnCount => "number_of_returns".into(),
        e57::RecordName::Unknown { name, .. } => match name.strip_prefix("normal") {
            Some(axis) => format!("n{}", axis.to_lowercase()),
            None => name.clone(),
        },
        other => panic!("{other:?}"),
    };
    let names: Vec<String> = scan.prototype.iter().map(name).collect();
    let mut table = Table::new();
    for point in reader.pointcloud_raw(&scan).unwrap() {
        for ((name, record), value) in names.iter().zip(&scan.prototype).zip(point.unwrap()) {
            // Returns count from 0 there.
            let first = f64::from(u8::from(name == "return_number"));
            table.entry(name.clone()).or_default().push(value.to_f64(&record.data_type).unwrap() + first);
        }
    }
    sorted(table)
}

fn csv_table(path: &Path) -> Table {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().unwrap();
    let mut table = Table::new();
    for line in lines {
        for (name, value) in names.iter().zip(line) {
            table.entry((*name).into()).or_default().push(value.parse().unwrap());
        }
    }
    sorted(table)
}

/// A PLY file with a property of each type, classes below 12 (of which the crate `las` makes a flag), and properties that mean what fields of LAS mean.
fn ply_file(encoding: &str) -> Vec<u8> {
    let properties = [
        ("double", "x"),
        ("double", "y"),
        ("double", "z"),
        ("float", "nx"),
        ("float", "ny"),
        ("float", "nz"),
        ("uchar", "red"),
        ("uchar", "green"),
        ("uchar", "blue"),
        ("float", "scalar_Intensity"),
        ("int", "classification"),
        ("float", "scalar_Scan_Angle_Rank"),
        ("double", "scalar_Gps_Time"),
        ("uint", NUMBER),
        ("char", "tiny"),
        ("uchar", "byte"),
        ("short", "signed"),
        ("ushort", "unsigned"),
        ("int", "whole"),
        ("float", "single"),
        ("double", "precise"),
    ];
    let mut file = format!("ply\nformat {encoding} 1.0\nelement vertex {POINTS}\n").into_bytes();
    properties.iter().for_each(|(kind, name)| file.extend(format!("property {kind} {name}\n").bytes()));
    file.extend(b"end_header\n");
    for index in 0..POINTS {
        let part = index as f64 / (POINTS - 1) as f64;
        let values = [
            600_000.0 + 0.001 * index as f64,
            5_000_000.25,
            100.0 - 0.5 * index as f64,
            0.0,
            0.6,
            0.8,
            (index % 256) as f64,
            7.0,
            255.0,
            part,
            (index % 12) as f64,
            (index % 31) as f64 - 15.0,
            3e5 + 0.25 * index as f64,
            index as f64,
            -(index as f64 % 128.0),
            (index % 200) as f64,
            -(index as f64),
            40_000.0 + index as f64,
            -70_000.0 - index as f64,
            part - 0.5,
            part * 1e-9,
        ];
        for ((kind, _), value) in properties.iter().zip(values) {
            macro_rules! bytes {
                ($number:ty) => {{
                    let value = value as $number;
                    match encoding {
                        "ascii" => format!("{value} ").into_bytes(),
                        "binary_little_endian" => value.to_le_bytes().to_vec(),
                        _ => value.to_be_bytes().to_vec(),
                    }
                }};
            }
            file.extend(match *kind {
                "char" => bytes!(i8),
                "uchar" => bytes!(u8),
                "short" => bytes!(i16),
                "ushort" => bytes!(u16),
                "int" => bytes!(i32),
                "uint" => bytes!(u32),
                "float" => bytes!(f32),
                _ => bytes!(f64),
            });
        }
        if encoding == "ascii" {
            file.push(b'\n');
        }
    }
    file
}

/// The names under which LAS has what a PLY file of this test has.
fn name_in_las(name: &str) -> &str {
    match name {
        "scalar_Intensity" => "intensity",
        "scalar_Scan_Angle_Rank" => "scan_angle",
        "scalar_Gps_Time" => "gps_time",
        own => own,
    }
}

/// What became of the values of an attribute; `None` if they are as they were.
fn change(before: &[f64], after: Option<&Vec<f64>>) -> Option<String> {
    let Some(after) = after else { return Some("left out".into()) };
    assert_eq!(before.len(), after.len());
    let pairs = || before.iter().zip(after);
    if pairs().all(|(before, after)| before == after) {
        return None;
    }
    let all = |of: &dyn Fn(f64) -> f64| pairs().all(|(before, after)| of(*before) == *after);
    if all(&|value| value * 257.0) {
        return Some("times 257".into());
    }
    if all(&|value| (value * 65535.0).round()) {
        return Some("times 65535".into());
    }
    if all(&|value| (value / 256.0).floor()) {
        return Some("the upper 8 bits".into());
    }
    let error = pairs().map(|(before, after)| (before - after).abs()).fold(0.0, f64::max);
    let size = before.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    match error {
        // The steps of 0.006 degrees, as floats.
        error if error < 1e-6 * size.max(1e-3) && error < 1e-6 => None,
        error if error < 0.0031 => Some("to 0.006".into()),
        _ => panic!("{before:?} became {after:?}"),
    }
}

/// What became of all attributes of a file.
fn changes(before: &Table, after: &Table, is_las: bool) -> String {
    let mut grouped: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for (name, values) in before {
        let own = if is_las { name_in_las(name) } else { name };
        if let Some(change) = change(values, after.get(own)) {
            let name = if name.starts_with("wavepacket") || name.ends_with("_t") || name.contains("wave_location") {
                "wave packets"
            } else {
                own
            };
            let names = grouped.entry(change).or_default();
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    let texts: Vec<String> = grouped.iter().map(|(change, names)| format!("{} {change}", names.join(", "))).collect();
    texts.join("; ")
}

fn exported(input: &Path, output: &str) -> PathBuf {
    let path = input.with_extension(format!("out.{output}"));
    let _ = std::fs::remove_file(&path);
    let sources = [Arc::new(codec::open(input).unwrap())];
    let done = export(&sources, &PointTest::default(), &[], &path, MEMORY, &Progress::default()).unwrap().unwrap();
    assert_eq!(done.points, POINTS as u64);
    assert!(done.warnings.is_empty(), "{:?}", done.warnings);
    path
}

/// The cells of the row of an input.
fn row(input: &Path, before: &Table) -> Vec<String> {
    let cell = |output: &&str| {
        let path = exported(input, output);
        let (after, kind) = match ExportFormat::of(&path).unwrap() {
            ExportFormat::Ply => (ply_table(&path), String::new()),
            ExportFormat::E57 => (e57_table(&path), String::new()),
            ExportFormat::Csv => (csv_table(&path), String::new()),
            ExportFormat::Las | ExportFormat::Laz | ExportFormat::Copc => {
                let (table, format) = las_table(&path);
                (table, format!("{format}: "))
            }
        };
        let changes = changes(before, &after, !kind.is_empty());
        format!("{kind}{}", if changes.is_empty() { "all as it is" } else { &changes })
    };
    OUTPUTS.iter().map(cell).collect()
}

#[test]
fn all_attributes_of_all_formats_go_to_all_formats() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // Rows that are equal are one.
    let mut rows: Vec<(Vec<String>, Vec<String>)> = Vec::new();
    let mut add = |name: String, cells: Vec<String>| match rows.iter_mut().find(|(_, known)| *known == cells) {
        Some((names, _)) => names.push(name),
        None => rows.push((vec![name], cells)),
    };
    for format in 0..=10_u8 {
        let mut made = points(format, POINTS);
        made.iter_mut().zip(0_u32..).for_each(|(point, index)| point.extra_bytes = index.to_le_bytes().into());
        let oldest = [2, 2, 2, 2, 3, 3, 4, 4, 4, 4, 4][usize::from(format)];
        for minor in oldest..=4 {
            let vlrs = [("LASF_Spec", 4, descriptor(NUMBER, 5, None))];
            let las = path(&format!("{format}-{minor}.las"));
            std::fs::write(&las, las_file((1, minor), format, &made, &vlrs)).unwrap();
            let (before, _) = las_table(&las);
            add(format!("LAS 1.{minor} format {format}"), row(&las, &before));
            let laz = path(&format!("{format}-{minor}.laz"));
            std::fs::write(&laz, compress(&std::fs::read(&las).unwrap(), &Chunks::Fixed(100))).unwrap();
            add(format!("LAZ 1.{minor} format {format}"), row(&laz, &before));
            if minor == 4 && (6..=8).contains(&format) {
                let copc = path(&format!("{format}.copc.laz"));
                write_copc(&[las], &copc, MEMORY, &Progress::default()).unwrap().unwrap();
                add(format!("COPC format {format}"), row(&copc, &before));
            }
        }
    }
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let ply = path(&format!("{encoding}.ply"));
        std::fs::write(&ply, ply_file(encoding)).unwrap();
        add(format!("PLY {encoding}"), row(&ply, &ply_table(&ply)));
    }
    let mut table = format!("| in | {} |\n|---|---|---|---|---|---|---|\n", OUTPUTS.join(" | "));
    for (names, cells) in &rows {
        let _ = writeln!(table, "| {} | {} |", short(names), cells.join(" | "));
    }
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/formats.md");
    let text = std::fs::read_to_string(&page).unwrap();
    let (before, rest) = text.split_once(MARKS[0]).unwrap();
    let (known, after) = rest.split_once(MARKS[1]).unwrap();
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&page, [before, MARKS[0], &table, MARKS[1], after].concat()).unwrap();
        return;
    }
    assert!(known == table, "docs/formats.md is not what was found; UPDATE=1 with this test writes it anew:\n{table}");
}

/// The names of inputs of one row, without what they have in common.
fn short(names: &[String]) -> String {
    let mut formats: Vec<(&str, Vec<&str>)> = Vec::new();
    for name in names {
        let (kind, format) = name.split_once(" format ").unwrap_or((name, ""));
        match formats.iter_mut().find(|(known, _)| *known == format) {
            Some((_, kinds)) => kinds.push(kind),
            None => formats.push((format, vec![kind])),
        }
    }
    let text = |(format, kinds): &(&str, Vec<&str>)| match *format {
        "" => kinds.join(", "),
        format => format!("format {format} in {}", kinds.join(", ")),
    };
    formats.iter().map(text).collect::<Vec<_>>().join("; ")
}
