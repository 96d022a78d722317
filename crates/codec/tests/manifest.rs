//! Checks every file of the test data against the tables of its `README.md`: format, points, bounds, attributes.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::path::PathBuf;
use std::sync::Mutex;

use cloud::{Bounds, Chunk, Column, Progress};
use codec::{Format, Selection, Source};
use glam::DVec3;
use real_data::test_data;

/// A row of the manifest.
struct Row {
    path: PathBuf,
    name: String,
    format: String,
    points: String,
    bounds: String,
    attributes: String,
}

/// The rows of all tables but `e57` and `malformed`; `None` if the data is missing.
fn manifest() -> Option<Vec<Row>> {
    let folder = test_data()?;
    let readme = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let mut section = "";
    let mut rows = Vec::new();
    for line in readme.lines() {
        if let Some(title) = line.strip_prefix("## ") {
            section = title.trim();
        }
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if matches!(section, "e57" | "malformed") || cells.len() < 10 || !cells[1].starts_with('`') {
            continue;
        }
        let name = cells[1].trim_matches('`').to_owned();
        rows.push(Row {
            path: folder.join(section).join(&name),
            name,
            format: cells[5].into(),
            points: cells[6].into(),
            bounds: cells[7].into(),
            attributes: cells[8].into(),
        });
    }
    Some(rows)
}

fn read_all(source: &Source) -> (Vec<Chunk>, codec::Summary) {
    let selection = Selection {
        positions: true,
        colors: true,
        normals: true,
        attributes: vec![true; source.info().attributes.len()],
    };
    let chunks = Mutex::new(Vec::new());
    let summary = source.read(&selection, &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk| chunk.first_point);
    (chunks, summary)
}

/// `(x, y, z) to (x, y, z)`, and the tolerance of the printed digits: 3 decimals, or 7 digits where an exponent is
/// used.
fn parse_bounds(text: &str) -> Option<(Bounds, f64)> {
    let (min, max) = text.split_once(" to ")?;
    let corner = |text: &str| {
        let numbers: Vec<f64> = text.trim_matches(['(', ')']).split(',').map(|n| n.trim().parse().unwrap()).collect();
        DVec3::from_slice(&numbers)
    };
    let bounds = Bounds { min: corner(min), max: corner(max) };
    let tolerance =
        if text.contains("e+") { bounds.min.abs().max(bounds.max.abs()).max_element() * 1e-6 } else { 0.00051 };
    Some((bounds, tolerance))
}

fn columns<'a>(source: &Source, chunks: &'a [Chunk], name: &str) -> impl Iterator<Item = &'a Column> + use<'a> {
    let index = source.info().attributes.iter().position(|attribute| attribute.name == name);
    chunks.iter().filter_map(move |chunk| chunk.columns.get(index?)?.as_deref())
}

fn values(source: &Source, chunks: &[Chunk], name: &str) -> Vec<f64> {
    columns(source, chunks, name).flat_map(|column| (0..column.len()).map(|i| column.value(i))).collect()
}

fn range(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)))
}

fn check_common(row: &Row, source: &Source, chunks: &[Chunk], summary: &codec::Summary) {
    let info = source.info();
    let name = &row.name;
    let points: u64 = row.points.split(' ').next().unwrap().parse().unwrap();
    assert_eq!(info.points, points, "{name}: points of the header");
    assert_eq!(summary.points, points, "{name}: points read");
    assert_eq!(chunks.iter().map(|chunk| chunk.len() as u64).sum::<u64>(), points, "{name}: points in chunks");
    let mut next = 0;
    for chunk in chunks {
        assert_eq!(chunk.first_point, next, "{name}: chunks tile the file");
        assert!(chunk.len() <= cloud::CHUNK_POINTS, "{name}: chunk of {}", chunk.len());
        assert_eq!(chunk.columns.len(), info.attributes.len(), "{name}: columns of a chunk");
        for (column, attribute) in chunk.columns.iter().zip(&info.attributes) {
            let column = column.as_ref().unwrap_or_else(|| panic!("{name}: no {}", attribute.name));
            assert_eq!(
                (column.len(), column.column_type()),
                (chunk.len(), attribute.column_type),
                "{name}: {attribute:?}"
            );
        }
        assert_eq!(chunk.colors.is_some(), info.has_colors, "{name}: colours");
        next += chunk.len() as u64;
    }
    match parse_bounds(&row.bounds) {
        None => assert_eq!(summary.bounds, None, "{name}: bounds of nothing"),
        Some((expected, tolerance)) => {
            let near = |found: Bounds| {
                (found.min - expected.min).abs().max_element() <= tolerance
                    && (found.max - expected.max).abs().max_element() <= tolerance
            };
            let found = summary.bounds.unwrap();
            assert!(near(found), "{name}: bounds of the points are {found:?}, expected {expected:?}");
            let positions = chunks.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
            // Half a step of an f32 offset as long as the cloud, or as the unit to which origins are rounded.
            let slack = 1e-7 * found.size().max_element().max(1.0);
            assert!((positions.min - found.min).abs().max_element() <= slack, "{name}: {positions:?} {found:?}");
            assert!((positions.max - found.max).abs().max_element() <= slack, "{name}: {positions:?} {found:?}");
        }
    }
    // A record has the values of the columns, at both ends and in the middle.
    for point in [0, points / 2, points.saturating_sub(1)].into_iter().filter(|&point| point < points) {
        let record = source.record(point).unwrap();
        let chunk = chunks.iter().rev().find(|chunk| chunk.first_point <= point).unwrap();
        let index = (point - chunk.first_point) as usize;
        for (column, attribute) in chunk.columns.iter().zip(&info.attributes) {
            if let Some((_, text)) = record.iter().find(|(name, _)| *name == attribute.name) {
                let column = column.as_ref().unwrap();
                // Texts of PLY files, and coordinates with the decimals of their grid, are written in other ways.
                let is_near = |told: f64| (told - column.value(index)).abs() <= 1e-6 * told.abs().max(1e-4);
                let is_same = *text == column.text(index) || text.parse().is_ok_and(is_near);
                assert!(is_same, "{name}: point {point}, {}: {text}, {}", attribute.name, column.text(index));
            }
        }
        assert_eq!(record.len(), info.properties.len(), "{name}: record of point {point}");
    }
}

fn check_las(row: &Row) {
    let source = codec::open(&row.path).unwrap_or_else(|error| panic!("{}: {error}", row.name));
    let (chunks, summary) = read_all(&source);
    check_common(row, &source, &chunks, &summary);
    let (info, name) = (source.info(), &row.name);
    assert_eq!(summary.warnings, Vec::<String>::new(), "{name}");

    let words: Vec<&str> = row.format.split(' ').collect();
    let kind = if name.ends_with(".las") { Format::Las } else { Format::Laz };
    assert_eq!(info.format, kind, "{name}");
    assert_eq!(info.version, words[1], "{name}");
    assert_eq!(info.point_format, words[2].strip_prefix("PF").unwrap().parse().ok(), "{name}");

    let is_there = |wanted: &str| info.properties.iter().any(|property| property.name == wanted);
    let facts = row.attributes.split(';').map(str::trim);
    for fact in facts.clone() {
        let (word, rest) = fact.split_once(' ').unwrap_or((fact, ""));
        match (word, rest) {
            ("intensity", "all 0") => assert_eq!(range(&values(&source, &chunks, word)), (0.0, 0.0), "{name}"),
            ("intensity", expected) => {
                let (low, high) = expected.split_once('-').unwrap();
                let expected = (low.parse().unwrap(), high.parse().unwrap());
                assert_eq!(range(&values(&source, &chunks, word)), expected, "{name}: intensity");
            }
            ("up", _) => {
                let most: f64 = rest.split(' ').nth(1).unwrap().parse().unwrap();
                assert_eq!(range(&values(&source, &chunks, "number_of_returns")).1, most, "{name}: returns");
            }
            ("classes", expected) => {
                let mut found = values(&source, &chunks, "classification");
                found.sort_by(f64::total_cmp);
                found.dedup();
                let expected: Vec<f64> = expected.split(' ').filter_map(|class| class.parse().ok()).collect();
                found.truncate(expected.len());
                assert_eq!(found, expected, "{name}: classes");
            }
            ("GPS", "time all 0") => assert_eq!(range(&values(&source, &chunks, "gps_time")), (0.0, 0.0), "{name}"),
            ("GPS", _) => assert!(!values(&source, &chunks, "gps_time").is_empty(), "{name}: GPS time"),
            ("NIR", _) => assert!(!values(&source, &chunks, "nir").is_empty(), "{name}: near infrared"),
            ("RGB", "all 0") => {
                assert!(!info.has_colors && is_there("red"), "{name}: black is no colour");
                assert!(info.warnings.iter().any(|warning| warning.contains("zero")), "{name}: {:?}", info.warnings);
            }
            ("RGB", expected) => {
                let expected: Vec<u16> =
                    expected.trim_start_matches("max ").split('/').map(|v| v.parse().unwrap()).collect();
                let shift = if expected.iter().any(|&value| value > 255) { 8 } else { 0 };
                let mut most = [0; 3];
                for color in chunks.iter().flat_map(|chunk| chunk.colors.iter().flat_map(|colors| colors.iter())) {
                    most = std::array::from_fn(|channel| color[channel].max(most[channel]));
                    assert_eq!(color[3], 255, "{name}: opacity");
                }
                assert_eq!(
                    most.map(u16::from).to_vec(),
                    expected.iter().map(|v| v >> shift).collect::<Vec<_>>(),
                    "{name}"
                );
            }
            ("waveform", _) => assert!(is_there("wavepacket_size"), "{name}: wave packet"),
            ("extra:", expected) => {
                for extra in expected.split(", ") {
                    // The manifest's reader knows one Extra Bytes record and calls the dimensions of a second one
                    // "ExtraBytes".
                    let found = is_there(extra) || is_there(&format!("{extra}[0]"));
                    assert!(found || (extra == "ExtraBytes" && is_there("confidence")), "{name}: {extra}");
                }
            }
            ("writer", _) | ("", _) => {}
            _ => panic!("{name}: the manifest says \"{fact}\", which this test does not know"),
        }
    }
    let says = |word: &str| facts.clone().any(|fact| fact.starts_with(word));
    if info.points > 0 {
        assert_eq!(is_there("gps_time"), says("GPS"), "{name}: GPS time");
        assert_eq!(is_there("red"), says("RGB") || name == "las_bad_vlr_count.las", "{name}: RGB");
        assert_eq!(is_there("nir"), says("NIR"), "{name}: near infrared");
    }
}

fn check_ply(row: &Row) {
    let source = codec::open(&row.path).unwrap_or_else(|error| panic!("{}: {error}", row.name));
    let (chunks, summary) = read_all(&source);
    check_common(row, &source, &chunks, &summary);
    let (info, name) = (source.info(), &row.name);
    assert_eq!(info.format, Format::Ply, "{name}");
    assert_eq!(format!("PLY {}", info.version.trim_end_matches(" 1.0")), row.format, "{name}");
    let faces =
        row.points.split(" + ").filter_map(|part| part.strip_suffix(" face")).next().map_or(0, |n| n.parse().unwrap());
    assert_eq!(info.faces, faces, "{name}: faces");
    // `x:f4, y:f4, ...` of the vertices; other elements follow after a semicolon.
    let vertex = row.attributes.split(';').next().unwrap();
    for (index, property) in vertex.split(", ").enumerate() {
        let Some((property, kind)) = property.split_once(':') else { break };
        // The last property may be followed by " ... (62 in all)".
        let kind = kind.split(' ').next().unwrap();
        let found = &info.properties[index];
        assert_eq!(found.name, property, "{name}");
        let (sign, bytes) = kind.split_at(1);
        let long = format!("{sign}{}", bytes.parse::<u32>().unwrap() * 8);
        assert_eq!(found.column_type.name(), long, "{name}: {property}");
    }
}

#[test]
fn las_and_laz_files_are_what_the_manifest_says() {
    let Some(rows) = manifest() else { return };
    let mut checked = 0;
    for row in rows.iter().filter(|row| !row.name.ends_with(".ply")) {
        check_las(row);
        checked += 1;
    }
    assert!(checked > 40, "only {checked} files in the manifest");
}

#[test]
fn ply_files_are_what_the_manifest_says() {
    let Some(rows) = manifest() else { return };
    let mut checked = 0;
    for row in rows.iter().filter(|row| row.name.ends_with(".ply")) {
        check_ply(row);
        checked += 1;
    }
    assert!(checked > 20, "only {checked} files in the manifest");
}
