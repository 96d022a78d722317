//! LAS and LAZ: what is read, the warnings about damaged files, and that no file crashes the reader.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

mod las_files;
#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use cloud::{Chunk, Cloud, Column, Progress, Random};
use codec::{Error, Format, Selection, Source, Summary};
use glam::DVec3;
use las_files::{Chunks, compress, descriptor, las_file, points, terrain};
use laz::encoders::ArithmeticEncoder;
use laz::laszip::LazItemRecordBuilder;
use laz::models::ArithmeticModelBuilder;
use laz::record::{
    FieldCompressor, LayeredPointRecordCompressor, RecordCompressor as _, SequentialPointRecordCompressor,
};
use real_data::test_data;

fn data(path: &str) -> Option<PathBuf> {
    Some(test_data()?.join(path))
}

/// A file that is removed with the test.
fn file(bytes: &[u8]) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    file
}

fn everything(source: &Source) -> Selection {
    let attributes = vec![true; source.info().attributes.len()];
    Selection { positions: true, colors: true, normals: true, attributes }
}

fn read(source: &Source, selection: &Selection) -> (Cloud, Summary) {
    let chunks = Mutex::new(Vec::new());
    let summary = source.read(selection, &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk: &Chunk| chunk.first_point);
    let info = source.info();
    let cloud = Cloud { name: String::new(), attributes: info.attributes.clone(), grid: info.grid, chunks };
    (cloud, summary)
}

fn read_bytes(bytes: &[u8]) -> (Source, Cloud, Summary) {
    let file = file(bytes);
    let source = codec::open(file.path()).unwrap();
    let (cloud, summary) = read(&source, &everything(&source));
    (source, cloud, summary)
}

fn positions(cloud: &Cloud) -> Vec<DVec3> {
    let of = |chunk: &Chunk| (0..chunk.len()).map(|i| cloud.world_position(chunk, i)).collect::<Vec<_>>();
    cloud.chunks.iter().flat_map(of).collect()
}

fn colors(cloud: &Cloud) -> Vec<[u8; 4]> {
    cloud.chunks.iter().flat_map(|chunk| chunk.colors.iter().flat_map(|colors| colors.iter().copied())).collect()
}

fn values(cloud: &Cloud, name: &str) -> Vec<f64> {
    let index =
        cloud.attributes.iter().position(|attribute| attribute.name == name).unwrap_or_else(|| panic!("{name}"));
    let of = |chunk: &Chunk| {
        let column: &Column = chunk.columns[index].as_ref().unwrap();
        (0..column.len()).map(|i| column.value(i)).collect::<Vec<_>>()
    };
    cloud.chunks.iter().flat_map(of).collect()
}

/// Asserts the same points, colours and attributes; chunks may be cut differently.
fn assert_same(a: &Cloud, b: &Cloud, name: &str) {
    assert_eq!(a.attributes, b.attributes, "{name}");
    assert!(positions(a) == positions(b), "{name}: positions differ");
    assert!(colors(a) == colors(b), "{name}: colours differ");
    for attribute in &a.attributes {
        let bits = |cloud| values(cloud, &attribute.name).into_iter().map(f64::to_bits).collect::<Vec<_>>();
        assert!(bits(a) == bits(b), "{name}: {} differs", attribute.name);
    }
}

#[test]
fn every_point_format_comes_back_as_it_was_written_in_las_and_laz() {
    for format in 0..=10 {
        let version = match format {
            0..=1 => (1, 1),
            2..=3 => (1, 2),
            4..=5 => (1, 3),
            _ => (1, 4),
        };
        let points = points(format, 2_500);
        let las = las_file(version, format, &points, &[]);
        let (source, cloud, summary) = read_bytes(&las);
        let name = format!("point format {format}");
        let info = source.info();
        assert_eq!((info.point_format, info.points, info.format), (Some(format), 2_500, Format::Las), "{name}");
        assert_eq!(info.version, format!("{}.{}", version.0, version.1));
        assert_eq!((summary.points, &info.warnings, &summary.warnings), (2_500, &vec![], &vec![]), "{name}");

        for (found, point) in positions(&cloud).into_iter().zip(&points) {
            let expected = DVec3::new(point.x, point.y, point.z);
            assert!((found - expected).abs().max_element() < 1e-8, "{name}: {found} for {expected}");
        }
        let expect = |attribute: &str, value: &dyn Fn(&las::Point) -> f64| {
            let expected: Vec<f64> = points.iter().map(value).collect();
            assert!(values(&cloud, attribute) == expected, "{name}: {attribute}");
        };
        expect("intensity", &|p| p.intensity.into());
        expect("return_number", &|p| p.return_number.into());
        expect("number_of_returns", &|p| p.number_of_returns.into());
        expect("classification", &|p| u8::from(p.classification).into());
        expect("user_data", &|p| p.user_data.into());
        expect("point_source_id", &|p| p.point_source_id.into());
        expect("classification_flags", &|p| {
            f64::from(
                u8::from(p.is_synthetic)
                    | u8::from(p.is_key_point) << 1
                    | u8::from(p.is_withheld) << 2
                    | u8::from(p.is_overlap) << 3,
            )
        });
        expect("synthetic", &|p| p.is_synthetic.into());
        expect("key_point", &|p| p.is_key_point.into());
        expect("withheld", &|p| p.is_withheld.into());
        expect("scan_direction_flag", &|p| (p.scan_direction == las::point::ScanDirection::LeftToRight).into());
        expect("edge_of_flight_line", &|p| p.is_edge_of_flight_line.into());
        if format >= 6 {
            expect("overlap", &|p| p.is_overlap.into());
            expect("scanner_channel", &|p| p.scanner_channel.into());
        }
        if points[0].color.is_some() {
            expect("red", &|p| p.color.unwrap().red.into());
            expect("blue", &|p| p.color.unwrap().blue.into());
        }
        if points[0].waveform.is_some() {
            expect("wavepacket_offset", &|p| p.waveform.unwrap().byte_offset_to_waveform_data as f64);
            expect("y_t", &|p| p.waveform.unwrap().y_t.into());
        }
        // Whatever is listed can be selected.
        assert!(info.properties.iter().all(|own| info.attributes.iter().any(|other| other.name == own.name)), "{name}");
        // The writer rounds angles down to steps of 0.006 degrees.
        for (found, point) in values(&cloud, "scan_angle").into_iter().zip(&points) {
            assert!((found - f64::from(point.scan_angle)).abs() < 0.0061, "{name}: {found} for {}", point.scan_angle);
            let text = (found as f32).to_string();
            let decimals = text.split_once('.').map_or(0, |(_, decimals)| decimals.len());
            assert!(decimals <= 3, "{name}: {text} is no number of steps");
        }
        if points[0].gps_time.is_some() {
            expect("gps_time", &|p| p.gps_time.unwrap());
        }
        if points[0].nir.is_some() {
            expect("nir", &|p| p.nir.unwrap().into());
        }
        assert_eq!(info.has_colors, points[0].color.is_some(), "{name}");
        for (found, point) in colors(&cloud).into_iter().zip(&points) {
            let color = point.color.unwrap();
            let byte = |value: u16| (value >> 8) as u8;
            assert_eq!(found, [byte(color.red), byte(color.green), byte(color.blue), 255], "{name}");
        }

        let laz = compress(&las, &Chunks::Fixed(1_000));
        let (compressed, from_laz, summary) = read_bytes(&laz);
        assert_eq!(compressed.info().format, Format::Laz);
        assert_eq!((summary.points, summary.warnings), (2_500, vec![]), "{name}");
        assert_same(&cloud, &from_laz, &name);

        let (las, laz) = (file(&las), file(&laz));
        let (las, laz) = (codec::open(las.path()).unwrap(), codec::open(laz.path()).unwrap());
        for point in [0, 999, 1_000, 2_499] {
            let record = las.record(point).unwrap();
            assert_eq!(record, laz.record(point).unwrap(), "{name}: record {point}");
            assert_eq!(record[0].1, format!("{:.3}", points[point as usize].x), "{name}");
            assert_eq!(record.len(), info.properties.len());
        }
        assert!(matches!(las.record(2_500), Err(Error::Malformed { .. })));
        assert!(matches!(laz.record(2_500), Err(Error::Malformed { .. })));
    }
}

#[test]
fn las_and_laz_twins_are_the_same_cloud() {
    let twins = [
        "airborne/autzen_trim_las12_pf3",
        "airborne/megaplot_forest_las12_pf1",
        "las_matrix/las12_pf2_color",
        "las_matrix/las12_pf1_pointwise_laz_v1",
        "las_matrix/las14_pf6_evlr",
        "las_matrix/las14_pf9_waveform",
        "las_matrix/las14_pf10_waveform_rgbnir",
        "same_cloud_four_files/ripple",
    ];
    for twin in twins {
        let Some(las) = data(&format!("{twin}.las")) else { return };
        let [las, laz] = [las.clone(), las.with_extension("laz")].map(|path| {
            let source = codec::open(&path).unwrap();
            let (cloud, summary) = read(&source, &everything(&source));
            let records: Vec<_> = (0..summary.points).step_by(997).map(|point| source.record(point).unwrap()).collect();
            (cloud, records)
        });
        assert_same(&las.0, &laz.0, twin);
        assert_eq!(las.1, laz.1, "{twin}: records");
    }
}

#[test]
fn extra_bytes_of_all_types_are_columns_in_their_own_type() {
    let mut all = points(6, 300);
    let mut descriptors = Vec::new();
    for data_type in 1..=10 {
        descriptors.extend(descriptor(&format!("type {data_type}"), data_type, None));
    }
    // A second record continues where the first stopped.
    let mut second = descriptor("height", 4, Some((0.01, 100.0)));
    second.extend(descriptor("triple", 23, None));
    second.extend(descriptor("type 1", 1, None));
    let mut undocumented = descriptor("blob", 0, None);
    undocumented[3] = 3;
    second.extend(undocumented);
    for (index, point) in all.iter_mut().enumerate() {
        let (small, value) = (index as u8 % 100, index as i64 - 150);
        let bytes = &mut point.extra_bytes;
        bytes.extend([small, small.wrapping_neg()]);
        bytes.extend((index as u16).to_le_bytes());
        bytes.extend((value as i16).to_le_bytes());
        bytes.extend((index as u32 + 70_000).to_le_bytes());
        bytes.extend((value as i32).to_le_bytes());
        bytes.extend((index as u64).to_le_bytes());
        bytes.extend(value.to_le_bytes());
        bytes.extend((index as f32 * 0.5).to_le_bytes());
        bytes.extend((index as f64 * 0.1).to_le_bytes());
        bytes.extend((value as i16).to_le_bytes());
        for element in 0..3_u16 {
            bytes.extend((index as u16 * 3 + element).to_le_bytes());
        }
        bytes.extend([7, 1, 2, 255]);
        // Two bytes that no record describes.
        bytes.extend([9, 9]);
    }
    let vlrs = [("LASF_Spec", 4, descriptors), ("LASF_Spec", 4, second)];
    let las = las_file((1, 4), 6, &all, &vlrs);
    for bytes in [las.clone(), compress(&las, &Chunks::Fixed(100))] {
        let file = file(&bytes);
        let source = codec::open(file.path()).unwrap();
        let (cloud, _) = read(&source, &everything(&source));
        let expect = |name: &str, value: &dyn Fn(usize) -> f64| {
            assert_eq!(values(&cloud, name), (0..300).map(value).collect::<Vec<_>>(), "{name}");
        };
        expect("type 1", &|i| (i as u8 % 100).into());
        expect("type 2", &|i| f64::from((i as u8 % 100).wrapping_neg() as i8));
        expect("type 3", &|i| i as f64);
        expect("type 4", &|i| i as f64 - 150.0);
        expect("type 5", &|i| i as f64 + 70_000.0);
        expect("type 6", &|i| i as f64 - 150.0);
        expect("type 7", &|i| i as f64);
        expect("type 8", &|i| i as f64 - 150.0);
        expect("type 9", &|i| i as f64 * 0.5);
        expect("type 10", &|i| i as f64 * 0.1);
        expect("height", &|i| (i as f64 - 150.0) * 0.01 + 100.0);
        expect("triple[2]", &|i| (i * 3 + 2) as f64);
        expect("type 1 (extra)", &|_| 7.0);
        let info = source.info();
        let types: Vec<&str> =
            info.attributes[info.attributes.len() - 15..].iter().map(|a| a.column_type.name()).collect();
        assert_eq!(types[..11], ["u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64", "f32", "f64", "f64"]);
        // Opaque bytes are listed, but are not columns.
        let record = source.record(0).unwrap();
        let said = |name: &str| record.iter().find(|property| property.0 == name).unwrap().1.as_str();
        assert_eq!((said("blob"), said("ExtraBytes"), said("height")), ("0x0102ff", "0x0909", "98.5"));
        let names: Vec<&str> = info.properties.iter().map(|property| property.name.as_str()).collect();
        assert!(names.ends_with(&["blob", "ExtraBytes"]), "{names:?}");
        assert!(info.attributes.iter().all(|attribute| attribute.name != "blob"));
        assert!(
            info.warnings.iter().any(|w| w.contains("blob")) && info.warnings.iter().any(|w| w.contains("2 bytes"))
        );
    }
}

/// The bytes of a number of a data type (1 to 10) in a record, and in the 64 bits of a descriptor.
fn number_bytes(data_type: u8, value: i8) -> (Vec<u8>, [u8; 8]) {
    let (whole, float) = (i64::from(value).to_le_bytes(), f64::from(value).to_le_bytes());
    match data_type {
        9 => (f32::from(value).to_le_bytes().to_vec(), float),
        10 => (float.to_vec(), float),
        _ => (whole[..1 << ((data_type - 1) / 2)].to_vec(), whole),
    }
}

#[test]
fn the_no_data_of_extra_bytes_is_no_value_in_every_type() {
    // Each type has a dimension as it is, one with a scale, and one without a number for "no value".
    let (mut all, mut descriptors, mut expected) = (points(6, 200), Vec::new(), Vec::new());
    for data_type in 1..=10 {
        let is_signed = data_type % 2 == 0 || data_type > 8;
        let none = if is_signed { -7 } else { 7 };
        for (kind, scale) in [("plain", None), ("scaled", Some((0.5, 10.0))), ("whole", None)] {
            let mut own = descriptor(&format!("{kind} {data_type}"), data_type, scale);
            if kind != "whole" {
                own[3] |= 1;
                own[40..48].copy_from_slice(&number_bytes(data_type, none).1);
            }
            descriptors.extend(own);
            let value = |index: usize| if index.is_multiple_of(4) { none } else { (index % 100) as i8 + 20 };
            for (index, point) in all.iter_mut().enumerate() {
                point.extra_bytes.extend(number_bytes(data_type, value(index)).0);
            }
            let of = |index: usize| match (index.is_multiple_of(4), kind) {
                (true, "plain" | "scaled") => None,
                (_, "scaled") => Some(f64::from(value(index)) * 0.5 + 10.0),
                _ => Some(f64::from(value(index))),
            };
            expected.push((format!("{kind} {data_type}"), (0..200).map(of).collect::<Vec<_>>()));
        }
    }
    let las = las_file((1, 4), 6, &all, &[("LASF_Spec", 4, descriptors)]);
    for bytes in [las.clone(), compress(&las, &Chunks::Fixed(100))] {
        let file = file(&bytes);
        let source = codec::open(file.path()).unwrap();
        let (cloud, _) = read(&source, &everything(&source));
        for (name, expected) in &expected {
            let found: Vec<Option<f64>> =
                values(&cloud, name).into_iter().map(|value| Some(value).filter(|value| !value.is_nan())).collect();
            assert!(found == *expected, "{name}: {found:?}");
            // A record has the same, with no text where there is no value.
            let column = cloud.attributes.iter().position(|own| own.name == *name).unwrap();
            for point in [0, 1, 120, 199] {
                let record = source.record(point).unwrap();
                let said = &record.iter().find(|own| own.0 == *name).unwrap().1;
                let (chunk, index) = (&cloud.chunks[point as usize / 100 % cloud.chunks.len()], point as usize);
                let text = chunk.columns[column].as_ref().unwrap().text(index - chunk.first_point as usize);
                assert_eq!((said, said.is_empty()), (&text, expected[index].is_none()), "{name}: point {point}");
            }
        }
        // Whole numbers of 64 bits may be too large for floats, which is said.
        let warnings = source.info().warnings.join("\n");
        assert!(warnings.contains("\"plain 7\" is u64") && warnings.contains("\"plain 8\" is i64"), "{warnings}");
        assert_eq!(source.info().warnings.len(), 2, "{warnings}");
    }
}

#[test]
fn no_data_is_found_in_arrays_and_where_writers_leave_its_upper_bytes_empty() {
    let mut all = points(6, 4);
    let mut triple = descriptor("triple", 24, Some((0.1, 0.0)));
    triple[3] |= 1;
    for (element, none) in [-1_i64, -2, -3].into_iter().enumerate() {
        triple[40 + 8 * element..48 + 8 * element].copy_from_slice(&none.to_le_bytes());
    }
    let mut short = descriptor("short", 4, None);
    short[3] = 1;
    short[40..42].copy_from_slice(&(-32768_i16).to_le_bytes());
    let mut float = descriptor("float", 9, None);
    float[3] = 1;
    float[40..44].copy_from_slice(&(-9999.9_f32).to_le_bytes());
    let mut rounded = descriptor("rounded", 9, None);
    rounded[3] = 1;
    rounded[40..48].copy_from_slice(&(-9999.9_f64).to_le_bytes());
    for (index, point) in all.iter_mut().enumerate() {
        for element in 0..3 {
            point.extra_bytes.extend((if index == element { -1 - index as i16 } else { -2 }).to_le_bytes());
        }
        point.extra_bytes.extend((if index == 1 { i16::MIN } else { 5 }).to_le_bytes());
        point.extra_bytes.extend((if index == 2 { -9999.9_f32 } else { 0.0 }).to_le_bytes());
        point.extra_bytes.extend((if index == 3 { -9999.9_f32 } else { 0.0 }).to_le_bytes());
    }
    let vlr = [triple, short, float, rounded].concat();
    let (_, cloud, _) = read_bytes(&las_file((1, 4), 6, &all, &[("LASF_Spec", 4, vlr)]));
    let none = |name: &str| -> Vec<usize> {
        let values = values(&cloud, name).into_iter().enumerate();
        values.filter(|(_, value)| value.is_nan()).map(|(index, _)| index).collect()
    };
    assert_eq!([none("triple[0]"), none("triple[2]")], [vec![0], vec![2]]);
    assert_eq!(none("triple[1]"), [0, 1, 2, 3], "-2 is the none of the second alone");
    assert_eq!([none("short"), none("float"), none("rounded")], [vec![1], vec![2], vec![3]]);
}

#[test]
fn extra_bytes_that_make_no_sense_are_warnings() {
    let mut all = points(1, 10);
    all.iter_mut().for_each(|point| point.extra_bytes = vec![1, 2, 3]);
    for (data_type, message) in [(200, "unknown type 200"), (10, "skipped")] {
        let las = las_file((1, 4), 1, &all, &[("LASF_Spec", 4, descriptor("odd", data_type, None))]);
        let (source, cloud, _) = read_bytes(&las);
        assert_eq!(cloud.len(), 10);
        assert!(source.info().warnings.iter().any(|w| w.contains("odd") && w.contains(message)), "{:?}", source.info());
    }
}

#[test]
fn only_what_is_selected_comes_and_it_is_what_a_full_read_gives() {
    let files = [8, 10].map(|format| las_file((1, 4), format, &points(format, 3_000), &[]));
    for bytes in files.iter().flat_map(|las| [las.clone(), compress(las, &Chunks::Fixed(1_000))]) {
        let file = file(&bytes);
        let source = codec::open(file.path()).unwrap();
        let (full, _) = read(&source, &everything(&source));
        let attributes = source.info().attributes.clone();

        let (bare, summary) = read(&source, &Selection { positions: true, ..Selection::default() });
        assert!(positions(&bare) == positions(&full));
        assert!(bare.chunks.iter().all(|chunk| chunk.colors.is_none() && chunk.columns.iter().all(Option::is_none)));
        assert_eq!(bare.chunks[0].columns.len(), attributes.len());
        assert!(summary.bounds.is_some());

        for (index, attribute) in attributes.iter().enumerate() {
            let selection =
                Selection { attributes: (0..=index).map(|other| other == index).collect(), ..Selection::default() };
            let (one, summary) = read(&source, &selection);
            assert!(values(&one, &attribute.name) == values(&full, &attribute.name), "{}", attribute.name);
            assert!(one.chunks.iter().all(|chunk| chunk.is_empty() && chunk.colors.is_none()));
            assert!(one.chunks.iter().all(|chunk| chunk.columns.iter().flatten().count() == 1));
            assert_eq!((summary.points, summary.bounds), (3_000, None));
        }
        let (painted, _) = read(&source, &Selection { colors: true, ..Selection::default() });
        assert!(colors(&painted) == colors(&full));
    }
}

#[test]
fn colors_are_8_or_16_bit_for_a_whole_file() {
    let with_colors = |color: &dyn Fn(usize) -> u16| {
        let mut points = points(2, 2_000);
        for (index, point) in points.iter_mut().enumerate() {
            point.color = Some(las::Color::new(color(index), 0, 1));
        }
        las_file((1, 2), 2, &points, &[])
    };
    let both = |las: Vec<u8>| [compress(&las, &Chunks::Fixed(500)), las];
    for bytes in both(with_colors(&|index| (index % 256) as u16)) {
        let (_, cloud, _) = read_bytes(&bytes);
        assert!(colors(&cloud).iter().enumerate().all(|(i, color)| *color == [i as u8, 0, 1, 255]));
    }
    // A bright part makes all dark points 16 bit; a few bright values do not.
    for bytes in both(with_colors(&|index| if index > 1_700 { 0xff00 } else { 200 })) {
        let (_, cloud, _) = read_bytes(&bytes);
        assert_eq!((colors(&cloud)[0], colors(&cloud)[1_999]), ([0, 0, 0, 255], [255, 0, 0, 255]));
    }
    for bytes in both(with_colors(&|index| if index % 50 == 49 { 0x0100 } else { 200 })) {
        let (source, cloud, _) = read_bytes(&bytes);
        assert_eq!((colors(&cloud)[0], colors(&cloud)[49]), ([200, 0, 1, 255], [255, 0, 1, 255]));
        assert!(source.info().warnings.is_empty(), "{:?}", source.info().warnings);
    }
    for (bits, full) in [(10, 1023), (12, 4095)] {
        for bytes in both(with_colors(&|index| (index * 37 % (full + 1)) as u16)) {
            let (source, cloud, _) = read_bytes(&bytes);
            let expected = |index: usize| index * 37 % (full + 1) * 256 / (full + 1);
            assert!(colors(&cloud).iter().enumerate().all(|(index, color)| usize::from(color[0]) == expected(index)));
            assert!(source.info().warnings[0].contains(&format!("{bits} bits")), "{:?}", source.info().warnings);
        }
    }
    let mut black = points(2, 500);
    black.iter_mut().for_each(|point| point.color = Some(las::Color::new(0, 0, 0)));
    for bytes in both(las_file((1, 2), 2, &black, &[])) {
        let (source, cloud, _) = read_bytes(&bytes);
        assert!(!source.info().has_colors && colors(&cloud).is_empty());
        assert!(source.info().warnings.iter().any(|warning| warning.contains("all colours are zero")));
    }
}

#[test]
fn the_range_of_colors_is_found_wherever_in_their_layers_the_bytes_are() {
    // Of two chunks of 40,000 points the first 16,384 of each are looked at, in as many bytes as they take on average.
    for (format, noisy) in [(7, 40_000), (7, 12_000), (8, 12_000)] {
        let mut points = points(format, 80_000);
        let calm = |index: &usize| index % 40_000 >= noisy;
        (0..points.len()).filter(calm).for_each(|index| points[index].color = Some(las::Color::new(5, 5, 5)));
        let las = las_file((1, 4), format, &points, &[]);
        let (plain, expected, _) = read_bytes(&las);
        let (source, found, _) = read_bytes(&compress(&las, &Chunks::Fixed(40_000)));
        assert!(plain.info().has_colors && source.info().has_colors, "{format}, {noisy}");
        assert_eq!(colors(&expected), colors(&found), "{format}, {noisy}");
    }
}

#[test]
fn chunks_tile_the_file_and_are_cut_the_same_in_every_read() {
    let las = terrain(200_000);
    // A LAZ chunk of the size of the file, many tiny ones, and a mixture, as COPC has.
    let variable: Vec<usize> = [vec![70_000, 1], vec![37; 1_000], vec![65_536, 20_000, 5_000, 2_463]].concat();
    let files = [
        las.clone(),
        compress(&las, &Chunks::Fixed(50_000)),
        compress(&las, &Chunks::Fixed(200_000)),
        compress(&las, &Chunks::Fixed(100)),
        compress(&las, &Chunks::Variable(&variable)),
    ];
    let (_, whole, _) = read_bytes(&las);
    for (index, bytes) in files.iter().enumerate() {
        let file = file(bytes);
        let source = codec::open(file.path()).unwrap();
        let (cloud, summary) = read(&source, &everything(&source));
        assert_eq!((summary.points, &summary.warnings), (200_000, &vec![]), "file {index}");
        let mut next = 0;
        for chunk in &cloud.chunks {
            assert_eq!(chunk.first_point, next, "file {index}");
            assert!((1..=cloud::CHUNK_POINTS).contains(&chunk.len()), "file {index}: {}", chunk.len());
            next += chunk.len() as u64;
        }
        assert!(cloud.chunks.len() < 25, "file {index}: tiny compressed chunks are joined, not {}", cloud.chunks.len());
        assert_same(&whole, &cloud, &format!("file {index}"));
        let starts = |cloud: &Cloud| cloud.chunks.iter().map(|chunk| chunk.first_point).collect::<Vec<_>>();
        let (again, _) = read(&source, &Selection { positions: true, ..Selection::default() });
        assert_eq!(starts(&cloud), starts(&again));
    }
}

#[test]
fn a_cancelled_read_stops_and_keeps_what_it_delivered() {
    let las = terrain(1_000_000);
    for bytes in [compress(&las, &Chunks::Fixed(20_000)), compress(&las, &Chunks::Fixed(1_000_000)), las] {
        let file = file(&bytes);
        let source = codec::open(file.path()).unwrap();
        let (progress, delivered) = (Progress::default(), AtomicU64::new(0));
        let emit = |chunk: Chunk| {
            delivered.fetch_add(chunk.len() as u64, Ordering::Relaxed);
            progress.cancel();
        };
        let summary = source.read(&Selection { positions: true, ..Selection::default() }, &progress, &emit).unwrap();
        assert!(summary.cancelled);
        assert_eq!(summary.points, delivered.load(Ordering::Relaxed));
        assert_eq!((progress.done(), progress.total()), (summary.points, 1_000_000));
        assert!((1..500_000).contains(&summary.points), "{}", summary.points);
    }
}

#[test]
fn malformed_files_give_their_error_or_what_is_there() {
    /// The number of points, and words of the warnings or the error.
    type Expected = (&'static str, Result<u64, &'static str>, &'static [&'static str]);
    let expected: [Expected; 12] = [
        ("las_truncated_points.las", Ok(1_064), &["1 are missing"]),
        ("las_header_says_1065_but_none.las", Ok(0), &["1065 are missing"]),
        ("las_garbage_number_of_vlrs.las", Ok(718), &["of 1069128089", "1 are missing"]),
        ("las_bad_vlr_count.las", Ok(10), &["record 3 of 3"]),
        ("las_bad_geotiff_keys.las", Ok(10), &[]),
        ("las_points_header_spurious_bounds.las", Ok(1_065), &[]),
        ("las_claims_4294967295_points.las", Ok(100), &["4294967195 are missing"]),
        ("laz_truncated.laz", Ok(0), &["no offset to the points", "chunk table is missing", "no compressed chunk"]),
        ("laz_truncated_good_original.laz", Ok(64_572), &[]),
        ("laz_unknown_coder.laz", Err("coder 15, expected 0"), &[]),
        ("laz_unknown_item_type.laz", Err("22 is unknown"), &[]),
        ("well_log_ascii_named_las.las", Err("well log"), &[]),
    ];
    for (name, points, words) in expected {
        let Some(path) = data(&format!("malformed/{name}")) else { return };
        let start = Instant::now();
        match (codec::open(&path), points) {
            (Ok(source), Ok(points)) => {
                let (cloud, summary) = read(&source, &everything(&source));
                assert_eq!((source.info().points, summary.points, cloud.len()), (points, points, points), "{name}");
                let warnings = source.info().warnings.join("\n");
                for word in words {
                    assert!(warnings.contains(word), "{name}: {warnings}");
                }
            }
            (Err(error), Err(word)) => {
                let text = error.to_string();
                assert!(text.contains(word) && text.contains(name), "{name}: {text}");
            }
            (outcome, expected) => panic!("{name}: {:?}, expected {expected:?}", outcome.map(|s| s.info().clone())),
        }
        assert!(start.elapsed() < Duration::from_secs(5), "{name} took {:?}", start.elapsed());
    }
}

#[test]
fn a_file_cut_anywhere_yields_the_points_that_are_whole() {
    let las = las_file((1, 4), 7, &points(7, 3_000), &[]);
    let old = las_file((1, 2), 3, &points(3, 3_000), &[]);
    let (_, layered, _) = read_bytes(&las);
    let (_, pointwise, _) = read_bytes(&old);
    let files = [
        (compress(&las, &Chunks::Fixed(1_000)), &layered),
        (compress(&las, &Chunks::Variable(&[500, 1_500, 1_000])), &layered),
        (compress(&old, &Chunks::Fixed(1_000)), &pointwise),
        (las, &layered),
        (old, &pointwise),
    ];
    for (index, (bytes, whole)) in files.iter().enumerate() {
        let mut most = 0;
        for part in 1..20 {
            let (source, cloud, summary) = match codec::open(file(&bytes[..bytes.len() * part / 20]).path()) {
                Ok(_) => read_bytes(&bytes[..bytes.len() * part / 20]),
                Err(error) => {
                    // In the header, or before the records that say how to decompress.
                    assert!(part < 3, "file {index}, {part}/20: {error}");
                    continue;
                }
            };
            assert_eq!(source.info().points, summary.points, "file {index}, {part}/20");
            assert!(source.info().warnings.iter().any(|w| w.contains("are missing")), "{:?}", source.info().warnings);
            assert!(summary.points >= most && summary.points < 3_000, "file {index}, {part}/20: {}", summary.points);
            most = summary.points;
            assert!(positions(&cloud)[..] == positions(whole)[..most as usize], "file {index}, {part}/20");
            assert!(colors(&cloud)[..] == colors(whole)[..most as usize], "file {index}, {part}/20");
        }
        assert!(most >= 2_000, "file {index}: {most}");
    }
}

#[test]
fn a_chunk_table_may_be_missing_or_at_the_end() {
    for format in [3, 7] {
        let las = las_file((1, 4), format, &points(format, 2_500), &[]);
        let (_, expected, _) = read_bytes(&las);
        let laz = compress(&las, &Chunks::Fixed(1_000));
        let start = u32::from_le_bytes(laz[96..100].try_into().unwrap()) as usize;
        let table: [u8; 8] = laz[start..start + 8].try_into().unwrap();
        let with_offset = |offset: u64| {
            let mut bytes = laz.clone();
            bytes[start..start + 8].copy_from_slice(&offset.to_le_bytes());
            bytes
        };
        let at_end = [with_offset(u64::MAX), table.to_vec()].concat();
        for (bytes, missing) in
            [(at_end, false), (with_offset(u64::MAX), true), (with_offset(0), true), (with_offset(1 << 40), true)]
        {
            let (source, cloud, summary) = read_bytes(&bytes);
            assert_eq!(summary.points, 2_500, "point format {format}: {:?}", source.info().warnings);
            assert_eq!(source.info().warnings.iter().any(|w| w.contains("chunk table is missing")), missing);
            assert_same(&expected, &cloud, "without a table");
        }
        // A writer that was stopped leaves no count either.
        let mut bytes = with_offset(u64::MAX);
        let table = u64::from_le_bytes(table) as usize;
        bytes.truncate(table);
        bytes[107..111].fill(0);
        bytes[247..255].fill(0);
        let (source, cloud, _) = read_bytes(&bytes);
        // Point-wise chunks do not say where they end, so some bytes of the coder's tail may be decoded as points.
        assert!((2_500..2_510).contains(&source.info().points), "{format}: {}", source.info().points);
        assert!(positions(&cloud)[..2_500] == positions(&expected)[..]);
    }
}

#[test]
fn a_header_without_a_count_does_not_hide_the_points() {
    let mut las = las_file((1, 2), 1, &points(1, 100), &[]);
    las[107..111].fill(0);
    let (source, cloud, _) = read_bytes(&las);
    assert_eq!((source.info().points, cloud.len()), (100, 100));
    assert!(source.info().warnings.iter().any(|warning| warning.contains("0 points")));
    // The last compressed chunk is not full.
    for format in [3, 7] {
        let mut laz = compress(&las_file((1, 4), format, &points(format, 2_500), &[]), &Chunks::Fixed(1_000));
        laz[107..111].fill(0);
        laz[247..255].fill(0);
        let (source, cloud, summary) = read_bytes(&laz);
        assert!((2_500..2_510).contains(&source.info().points), "{format}: {}", source.info().points);
        assert_eq!((cloud.len(), summary.warnings), (source.info().points, Vec::new()));
    }
}

#[test]
fn las_1_5_is_read_with_a_warning_and_later_versions_are_not() {
    let mut las = las_file((1, 4), 6, &points(6, 10), &[]);
    las[25] = 5;
    let (source, cloud, _) = read_bytes(&las);
    assert!(cloud.len() == 10 && source.info().warnings.iter().any(|warning| warning.contains("1.5")));
    las[25] = 6;
    let error = codec::open(file(&las).path()).err().unwrap().to_string();
    assert!(error.contains("1.6") && error.contains("1.0 to 1.5"), "{error}");
}

#[test]
fn a_damaged_chunk_costs_its_own_points_only() {
    for format in [3, 7] {
        let las = las_file((1, 4), format, &points(format, 4_000), &[]);
        let (_, expected, _) = read_bytes(&las);
        let mut laz = compress(&las, &Chunks::Fixed(1_000));
        let start = u32::from_le_bytes(laz[96..100].try_into().unwrap()) as usize;
        let length = (laz.len() - start) / 4;
        // The inside of the second chunk: points of noise compress to chunks of about the same size.
        let mut noise = Random(3);
        laz[start + length + 2_000..start + 2 * length - 2_000].fill_with(|| noise.draw() as u8);
        let (_, cloud, summary) = read_bytes(&laz);
        let (all, known) = (positions(&cloud), positions(&expected));
        assert!(all[..1_000] == known[..1_000], "point format {format}: the chunk before");
        assert!(all[all.len() - 2_000..] == known[2_000..], "point format {format}: the chunks after");
        let last = cloud.chunks.last().unwrap();
        assert_eq!(last.first_point + last.len() as u64, 4_000);
        assert!(summary.points == 4_000 || !summary.warnings.is_empty(), "{summary:?}");
    }
}

#[test]
fn a_file_that_somebody_writes_to_while_it_is_open_is_not_called_damaged() {
    for format in [3, 7] {
        let las = las_file((1, 4), format, &points(format, 4_000), &[]);
        for bytes in [compress(&las, &Chunks::Fixed(1_000)), las] {
            let file = file(&bytes);
            let source = codec::open(file.path()).unwrap();
            std::fs::write(file.path(), [bytes, vec![0; 100]].concat()).unwrap();
            let read = source.read(&everything(&source), &Progress::default(), &|_| {});
            let told = [read.unwrap_err(), source.record(2_000).unwrap_err()].map(|error| error.to_string());
            let is_said = |told: &String| told.contains("it has been changed since it was opened; open it again");
            assert!(told.iter().all(is_said), "point format {format}: {told:?}");
        }
    }
}

#[test]
fn no_damaged_byte_brings_the_reader_down() {
    let mut with_extra = points(7, 300);
    with_extra.iter_mut().for_each(|point| point.extra_bytes = vec![1, 2, 3, 4]);
    let extra = [("LASF_Spec", 4, descriptor("height", 9, None)), ("LASF_Projection", 2112, b"PROJCS[\"x\"]".to_vec())];
    let new = las_file((1, 4), 7, &with_extra, &extra);
    let geotiff = [("LASF_Projection", 34735, vec![1, 0, 1, 0, 0, 0, 1, 0, 0, 12, 0, 0, 1, 0, 0x69, 0x7f])];
    let old = las_file((1, 2), 3, &points(3, 300), &geotiff);
    let files = [
        compress(&new, &Chunks::Fixed(100)),
        compress(&new, &Chunks::Variable(&[50, 250])),
        compress(&old, &Chunks::Fixed(100)),
        new,
        old,
    ];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged");
    let mut noise = Random(11);
    let (mut opened, mut refused) = (0, 0);
    for bytes in &files {
        let points_start = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as u64;
        for _ in 0..600 {
            let mut damaged = bytes.clone();
            for _ in 0..=noise.below(3) {
                // Mostly the header and the records; the points and the chunk table too.
                let within = if noise.below(3) == 0 { bytes.len() as u64 } else { points_start + 16 };
                let place = noise.below(within) as usize;
                damaged[place] = match noise.below(4) {
                    0 => 0,
                    1 => 255,
                    2 => damaged[place] ^ (1 << noise.below(8)),
                    _ => noise.draw() as u8,
                };
            }
            std::fs::write(&path, &damaged).unwrap();
            let start = Instant::now();
            let Ok(source) = codec::open(&path) else {
                refused += 1;
                continue;
            };
            opened += 1;
            let found = AtomicU64::new(0);
            let emit = |chunk: Chunk| {
                found.fetch_add(chunk.len() as u64, Ordering::Relaxed);
            };
            if let Ok(summary) = source.read(&everything(&source), &Progress::default(), &emit) {
                assert_eq!(summary.points, found.into_inner());
            }
            for point in [0, source.info().points / 2, source.info().points] {
                let _ = source.record(point);
            }
            assert!(start.elapsed() < Duration::from_secs(5), "took {:?}", start.elapsed());
        }
    }
    assert!(opened > 1_000 && refused > 100, "{opened} opened, {refused} refused: the damage proves nothing");
}

/// Writes times as no encoder does: the second one switches its sequence for ever.
struct EndlessSwitches;

impl EndlessSwitches {
    /// Symbols that take 150 bytes in all, as the model learns them, and the stack of any thread if each is a call.
    const COUNT: usize = 5_000_000;

    /// Writes the symbol of a switch, one of `symbols`.
    fn write<W: std::io::Write>(encoder: &mut ArithmeticEncoder<W>, symbols: u32) {
        let mut model = ArithmeticModelBuilder::new(symbols).with_compression(true).build();
        (0..Self::COUNT).for_each(|_| encoder.encode_symbol(&mut model, symbols - 1).unwrap());
    }
}

impl<W: std::io::Write> FieldCompressor<W> for EndlessSwitches {
    fn size_of_field(&self) -> usize {
        8
    }

    fn compress_first(&mut self, target: &mut W, time: &[u8]) -> std::io::Result<()> {
        target.write_all(time)
    }

    fn compress_with(&mut self, encoder: &mut ArithmeticEncoder<W>, _: &[u8]) -> std::io::Result<()> {
        Self::write(encoder, 6);
        Ok(())
    }
}

/// A chunk of point format 1 or 7 whose second time switches its sequence for ever.
fn chunk_of_endless_switches(format: u8, records: &[u8]) -> Vec<u8> {
    if format == 1 {
        let mut encoder = SequentialPointRecordCompressor::new(Vec::new());
        encoder.add_field_compressor(laz::las::v2::LasPoint0Compressor::default());
        encoder.add_field_compressor(EndlessSwitches);
        records[..2 * 28].chunks_exact(28).for_each(|record| encoder.compress_next(record).unwrap());
        encoder.done().unwrap();
        return encoder.into_inner();
    }
    let items = LazItemRecordBuilder::default_for_point_format_id(7, 0).unwrap();
    let mut encoder = LayeredPointRecordCompressor::new(Vec::new());
    encoder.set_fields_from(&items).unwrap();
    encoder.compress_many(records).unwrap();
    encoder.done().unwrap();
    let mut chunk = encoder.into_inner();
    // The first record, the number of points, the lengths of nine layers and that of the colours, the layers.
    let layer = |index: usize| 36 + 4 + index * 4..36 + 4 + index * 4 + 4;
    let length = |index: usize| u32::from_le_bytes(chunk[layer(index)].try_into().unwrap()) as usize;
    let start = layer(10).start + (0..8).map(length).sum::<usize>();
    let times = start..start + length(8);
    let mut encoder = ArithmeticEncoder::new(std::io::Cursor::new(Vec::new()));
    EndlessSwitches::write(&mut encoder, 5);
    encoder.done().unwrap();
    let switches = encoder.into_inner().into_inner();
    chunk[layer(8)].copy_from_slice(&(switches.len() as u32).to_le_bytes());
    chunk.splice(times, switches);
    chunk
}

#[test]
fn times_that_switch_their_sequence_for_ever_cost_their_chunk_only() {
    for (version, format, length) in [((1, 2), 1, 28), ((1, 4), 7, 36)] {
        let las = las_file(version, format, &points(format, 4_000), &[]);
        let (_, expected, _) = read_bytes(&las);
        let records = u32::from_le_bytes(las[96..100].try_into().unwrap()) as usize;
        let chunk = chunk_of_endless_switches(format, &las[records..records + 1_000 * length]);
        let whole = compress(&las, &Chunks::Fixed(1_000));
        let start = u32::from_le_bytes(whole[96..100].try_into().unwrap()) as usize + 8;
        // The chunk table says of the first chunk that it is longer.
        let mut laz = whole.clone();
        laz[start..start + chunk.len()].copy_from_slice(&chunk);
        let started = Instant::now();
        let (source, cloud, summary) = read_bytes(&laz);
        assert_eq!((source.info().points, summary.points), (4_000, 3_001), "point format {format}: {summary:?}");
        let warning = "record 1: not valid compressed data: a time switches its sequence more than 4 times (the rest of \
                       this compressed chunk is skipped); 999 points are missing, 3001 were read";
        assert_eq!(summary.warnings, [warning]);
        assert!(positions(&cloud)[1..] == positions(&expected)[1_000..], "point format {format}: the chunks after");

        // Without the chunk table: chunks of 1000 points are found by their lengths, or decoded one after the other.
        let mut alone = [&whole[..start], &chunk].concat();
        alone[start - 8..start].fill(0);
        let (_, cloud, summary) = read_bytes(&alone);
        assert_eq!((cloud.len(), summary.points), (1, 1), "point format {format}: {summary:?}");
        assert!(started.elapsed() < Duration::from_secs(5), "took {:?}", started.elapsed());
    }
}

#[test]
fn points_far_away_cost_the_others_no_precision_wherever_they_come() {
    for strays in [vec![0], vec![40_000], vec![0, 1, 5_000, 65_536, 79_999]] {
        let mut points = points(0, 80_000);
        strays.iter().for_each(|&stray| points[stray].x += 1_500_000.0);
        let (_, cloud, _) = read_bytes(&las_file((1, 2), 0, &points, &[]));
        let exact = positions(&cloud);
        let offsets = cloud.chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index)));
        for (index, (offset, point)) in offsets.zip(&points).enumerate() {
            let place = DVec3::new(point.x, point.y, point.z);
            assert!(exact[index].distance(place) < 1e-6, "point {index}: {} instead of {place}", exact[index]);
            assert!(strays.contains(&index) || offset.distance(place) < 1e-4, "point {index}: {offset}, not {place}");
        }
        let kept = cloud.chunks.iter().filter(|chunk| chunk.exact_positions.is_some()).count();
        assert!((1..=strays.len()).contains(&kept), "chunks with doubles: {kept}");
    }
}

#[test]
fn tiny_chunks_without_a_table_are_refused_instead_of_set_up_one_by_one() {
    let las = las_file((1, 2), 1, &points(1, 3_000), &[]);
    let without_table = |points: u32| {
        let mut laz = compress(&las, &Chunks::Fixed(points));
        let start = u32::from_le_bytes(laz[96..100].try_into().unwrap()) as usize;
        laz[start..start + 8].fill(0xff);
        laz
    };
    for points in [1, 2, 999] {
        let error = codec::open(file(&without_table(points)).path()).err().unwrap().to_string();
        assert!(error.contains(&format!("a chunk size of {points} without a usable chunk table")), "{error}");
    }
    assert_eq!(read_bytes(&without_table(1_000)).2.points, 3_000);
}

#[test]
fn thousands_of_extra_dimensions_of_one_name_are_told_apart_in_a_line() {
    let mut all = points(6, 4);
    all.iter_mut().for_each(|point| point.extra_bytes = vec![9; 1_000]);
    let undocumented = |size: u8| {
        let mut bytes = descriptor("same", 0, None);
        bytes[3] = size;
        bytes
    };
    let vlrs: Vec<(&str, u16, Vec<u8>)> = (0..4)
        .map(|_| ("LASF_Spec", 4, (0..300).flat_map(|_| descriptor("same", 1, None)).collect()))
        .chain([("LASF_Spec", 4, (0..300).flat_map(|index| undocumented(index as u8 % 2)).collect())])
        .collect();
    let (source, cloud, _) = read_bytes(&las_file((1, 4), 6, &all, &vlrs));
    let names: Vec<&str> = source.info().attributes.iter().map(|attribute| attribute.name.as_str()).collect();
    assert!(names.contains(&"same") && names.contains(&"same (extra)") && names.contains(&"same (extra 999)"));
    assert!(cloud.len() == 4 && source.info().warnings.len() < 5, "{:?}", source.info().warnings);
    // Undocumented bytes come first: a block of none is ignored, and the others are counted.
    let vlrs: Vec<_> = vlrs.into_iter().rev().collect();
    let (source, _, _) = read_bytes(&las_file((1, 4), 6, &all, &vlrs));
    let warnings = source.info().warnings.join("\n");
    assert!(warnings.contains("149 more extra dimensions are of no documented type"), "{warnings}");
}

#[test]
fn what_a_file_says_is_quoted_in_a_part_of_a_line() {
    let mut las = las_file((1, 2), 0, &points(0, 2), &[]);
    las[131..139].copy_from_slice(&1e-310_f64.to_le_bytes());
    las[155..163].copy_from_slice(&1.7e308_f64.to_le_bytes());
    let error = codec::open(file(&las).path()).err().unwrap().to_string();
    assert!(error.contains("1e-310") && error.contains("1.7e308") && error.len() < 300, "{error}");
    let long = "x".repeat(100_000);
    for (element, property) in [("vertex", long.as_str()), (long.as_str(), "x")] {
        let ply =
            format!("ply\nformat ascii 1.0\nelement {element} 1\nproperty list uchar int {property}\nend_header\n0\n");
        let error = codec::open(file(ply.as_bytes()).path()).err().unwrap().to_string();
        assert!(error.len() < 300, "{} bytes", error.len());
    }
}

#[test]
fn chunks_of_one_point_are_read_like_any_other() {
    for format in [3, 7] {
        let las = las_file((1, 4), format, &points(format, 60), &[]);
        let (_, expected, _) = read_bytes(&las);
        let counts: Vec<usize> = [1, 2, 1, 1, 10].into_iter().cycle().take(20).collect();
        for chunks in [Chunks::Fixed(1), Chunks::Fixed(59), Chunks::Variable(&counts)] {
            let laz = compress(&las, &chunks);
            let (source, cloud, summary) = read_bytes(&laz);
            assert_eq!((summary.points, &summary.warnings), (60, &vec![]));
            assert_same(&expected, &cloud, "chunks of one point");
            assert_eq!(source.record(59).unwrap().len(), source.info().properties.len());
        }
    }
}
