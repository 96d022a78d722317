//! Exported files hold the points that are shown, and no others, with everything that their files have of them, as the
//! crate `las` and this crate's own readers find it.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

mod las_files;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use cloud::{Chunk, ClipVolume, Cloud, Column, Filter, Placement, PointTest, Progress, Volume, VolumeShape};
use codec::{Added, Exported, Runs, Selection, Source, export};
use glam::{DQuat, DVec3};
use las::Point;
use las_files::{Chunks, OFFSETS, SCALE, compress, descriptor, las_file, points, terrain};
use tempfile::TempDir;

const MEMORY: u64 = 256 << 20;

/// The border of the box is at coordinates of points.
const BOX_SIZE: DVec3 = DVec3::new(800.0, 900.0, 30.0);

fn clipped() -> PointTest {
    let (shape, middle) = (VolumeShape::Box, DVec3::from(OFFSETS) + DVec3::new(450.0, 450.0, 20.0));
    let volume = Volume::new(shape, middle, DQuat::IDENTITY, BOX_SIZE);
    let filter = Filter { attribute: "intensity".into(), low: 1000.0, high: 60000.0 };
    PointTest::new([3], vec![filter], vec![ClipVolume { volume, keeps_inside: true }])
}

fn is_shown(point: &Point) -> bool {
    let offset = (DVec3::new(point.x, point.y, point.z) - DVec3::from(OFFSETS) - DVec3::new(450.0, 450.0, 20.0)).abs();
    offset.cmple(BOX_SIZE * 0.5 + 1e-7).all()
        && (1000..=60000).contains(&point.intensity)
        && u8::from(point.classification) != 3
}

fn sources(paths: &[&Path]) -> Vec<Arc<Source>> {
    paths.iter().map(|path| Arc::new(codec::open(path).unwrap())).collect()
}

fn written(paths: &[&Path], test: &PointTest, output: &Path) -> Exported {
    let progress = Progress::default();
    let exported = export(&sources(paths), test, &[], output, MEMORY, &progress).unwrap().unwrap();
    assert_eq!(progress.done(), progress.total());
    let left = std::fs::read_dir(output.parent().unwrap()).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(!left.into_iter().any(|name| name.to_string_lossy().contains("unfinished")));
    exported
}

fn las_points(path: &Path) -> Vec<Point> {
    las::Reader::from_path(path).unwrap().read_all().unwrap().points().map(Result::unwrap).collect()
}

fn header(path: &Path) -> las::raw::Header {
    las::raw::Header::read_from(std::fs::File::open(path).unwrap()).unwrap()
}

fn file(folder: &TempDir, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn read_whole(path: &Path) -> Cloud {
    let source = codec::open(path).unwrap();
    assert!(source.info().warnings.is_empty(), "{:?}", source.info().warnings);
    read_points(&source)
}

fn read_points(source: &Source) -> Cloud {
    let info = source.info();
    let attributes = vec![true; info.attributes.len()];
    let selection = Selection { positions: true, colors: true, normals: true, attributes };
    let chunks = Mutex::new(Vec::new());
    let emit = |chunk| chunks.lock().unwrap().push(chunk);
    let summary = source.read(&selection, &Progress::default(), &emit).unwrap();
    assert!(summary.warnings.is_empty() && summary.points == info.points, "{summary:?}");
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk: &Chunk| chunk.first_point);
    Cloud { name: String::new(), attributes: info.attributes.clone(), grid: info.grid, chunks }
}

/// Places, colours and the values of an attribute, in file order.
fn values(cloud: &Cloud, attribute: &str) -> Vec<(DVec3, Option<[u8; 4]>, f64)> {
    let column = cloud.column_of(attribute).unwrap();
    let of = |chunk: &Chunk| {
        let value = |index: usize| {
            let color = chunk.colors.as_ref().map(|colors| colors[index]);
            (cloud.world_position(chunk, index), color, chunk.columns[column].as_ref().unwrap().value(index))
        };
        (0..chunk.len()).map(value).collect::<Vec<_>>()
    };
    cloud.chunks.iter().flat_map(of).collect()
}

#[test]
fn records_of_every_format_stay_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    for format in 0..=10_u8 {
        let version = if format >= 6 {
            (1, 4)
        } else if format >= 4 {
            (1, 3)
        } else {
            (1, 2)
        };
        let mut made = points(format, 3000);
        made.iter_mut().zip(0_u32..).for_each(|(point, index)| point.extra_bytes = index.to_le_bytes().into());
        let vlrs = [("LASF_Spec", 4, descriptor("number", 5, None)), ("someone", 77, vec![1, 2, 3])];
        let original = file(&folder, "original.las", las_file(version, format, &made, &vlrs));
        let packed = compress(&std::fs::read(&original).unwrap(), &Chunks::Fixed(700));
        let packed = file(&folder, "packed.laz", packed);
        let expected: Vec<Point> = las_points(&original).into_iter().filter(is_shown).collect();
        assert!(expected.len() > 500 && expected.len() < 2500, "{}", expected.len());
        for (input, output) in [(&original, "a.laz"), (&packed, "a.las"), (&packed, "b.laz"), (&original, "b.las")] {
            let output = folder.path().join(output);
            let exported = written(&[input], &clipped(), &output);
            assert_eq!(exported.points, expected.len() as u64);
            assert!(las_points(&output) == expected, "format {format}: {}", output.display());
            let (found, of_input) = (header(&output), header(&original));
            assert_eq!(found.version, of_input.version);
            assert_eq!(found.point_data_record_format & 0x3f, format);
            assert_eq!(found.point_data_record_length, of_input.point_data_record_length);
            assert_eq!((found.x_scale_factor, found.y_offset), (of_input.x_scale_factor, of_input.y_offset));
            let highest = expected.iter().map(|point| point.z).fold(f64::MIN, f64::max);
            assert_eq!(found.max_z, highest, "the header has the bounds of the file before");
            let reader = las::Reader::from_path(&output).unwrap();
            let vlrs = reader.header().all_vlrs().filter(|vlr| vlr.user_id == "someone").collect::<Vec<_>>();
            assert!(vlrs.len() == 1 && vlrs[0].data == [1, 2, 3]);
            assert_eq!(reader.header().has_wkt_crs(), format >= 6);
            let cloud = read_whole(&output);
            assert!(cloud.column_of("number").is_some() && cloud.len() == expected.len() as u64);
            std::fs::remove_file(output).unwrap();
        }
    }
}

#[test]
fn points_stay_in_the_order_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let las = terrain(300_000);
    let original = file(&folder, "original.las", &las);
    let packed = file(&folder, "packed.laz", compress(&las, &Chunks::Variable(&[1, 170_000, 20_001, 109_998])));
    let test = PointTest::hiding([5]);
    let expected: Vec<Point> =
        las_points(&original).into_iter().filter(|point| u8::from(point.classification) != 5).collect();
    for (input, output) in [(&original, "a.laz"), (&packed, "b.laz"), (&packed, "c.las")] {
        let output = folder.path().join(output);
        written(&[input], &test, &output);
        assert!(las_points(&output) == expected, "{}", output.display());
    }
    // A file of which all is shown is as it was.
    let whole = folder.path().join("d.las");
    written(&[&packed], &PointTest::default(), &whole);
    let start = |path: &Path| header(path).offset_to_point_data as usize;
    let bytes = std::fs::read(&whole).unwrap();
    assert!(bytes[start(&whole)..] == las[start(&original)..]);
}

#[test]
fn extra_bytes_without_a_type_keep_their_length() {
    let folder = tempfile::tempdir().unwrap();
    // The options of such a dimension are its number of bytes, here as many as the flags of a range.
    let mut blob = descriptor("blob", 0, None);
    blob[3] = 7;
    let mut made = points(7, 300);
    for (point, index) in made.iter_mut().zip(0_u32..) {
        point.extra_bytes = [&[9; 7][..], &(index + 70_000).to_le_bytes()].concat();
    }
    let vlrs = [("LASF_Spec", 4, [blob, descriptor("number", 5, None)].concat())];
    let original = file(&folder, "original.las", las_file((1, 4), 7, &made, &vlrs));
    let expected = las_points(&original);
    for output in ["a.las", "a.laz", "a.copc.laz"] {
        let output = folder.path().join(output);
        written(&[&original], &PointTest::default(), &output);
        let mut numbers: Vec<f64> = values(&read_points(&codec::open(&output).unwrap()), "number")
            .into_iter()
            .map(|(.., value)| value)
            .collect();
        numbers.sort_by(f64::total_cmp);
        assert_eq!(
            numbers,
            (0..300).map(|index| f64::from(index + 70_000)).collect::<Vec<_>>(),
            "{}",
            output.display()
        );
        let reader = las::Reader::from_path(&output).unwrap();
        let written = reader.header().all_vlrs().find(|vlr| vlr.record_id == 4).unwrap();
        assert_eq!(written.data[2..4], [0, 7], "{}", output.display());
    }
    assert_eq!(las_points(&folder.path().join("a.laz")), expected);
}

#[test]
fn points_that_a_broken_off_or_damaged_file_announces_are_counted_as_missing() {
    let folder = tempfile::tempdir().unwrap();
    let las = las_file((1, 2), 1, &points(1, 4_000), &[]);
    let length = 28;
    let mut damaged = compress(&las_file((1, 4), 6, &points(6, 4_000), &[]), &Chunks::Fixed(1_000));
    let start = u32::from_le_bytes(damaged[96..100].try_into().unwrap()) as usize;
    // The lengths of the first chunk's layers, after the place of the chunk table, a point and the number of points.
    damaged[start + 8 + 30 + 4..][..36].fill(0xff);
    let rows: String = (0..100).map(|at| format!("{at} {at} 0\n")).collect();
    let declared = "property float x\nproperty float y\nproperty float z\nend_header\n";
    let ply = format!("ply\nformat ascii 1.0\nelement vertex 130\n{declared}{rows}");
    for (name, bytes, expected) in [
        ("whole.las", las.clone(), Some(0)),
        ("short.las", las[..las.len() - 500 * length].to_vec(), Some(500)),
        ("damaged.laz", damaged, None),
        ("short.ply", ply.into_bytes(), Some(30)),
        ("short.pts", format!("150\n{rows}").into_bytes(), Some(50)),
    ] {
        let input = file(&folder, name, bytes);
        for ending in ["las", "ply", "e57", "csv", "copc.laz"] {
            let output = folder.path().join(format!("{name}.{ending}"));
            let exported =
                export(&sources(&[&input]), &PointTest::default(), &[], &output, MEMORY, &Progress::default());
            let Exported { points, missing, .. } = exported.unwrap().unwrap();
            assert_eq!(missing, expected.unwrap_or(4_000 - points), "{}", output.display());
            assert_eq!(missing > 0, name != "whole.las", "{}", output.display());
        }
    }
}

/// A file of 100 points whose system is given by keys of GeoTIFF.
fn file_with_keys(folder: &TempDir, name: &str, keys: &[[u16; 4]]) -> PathBuf {
    let head = [1, 1, 0, keys.len() as u16];
    let keys = [head].iter().chain(keys).flatten().flat_map(|number| number.to_le_bytes()).collect();
    let vlrs = [("LASF_Projection", 34735, keys)];
    file(folder, name, las_file((1, 2), 1, &points(1, 100), &vlrs))
}

#[test]
fn files_whose_heights_are_in_other_systems_do_not_become_one() {
    let folder = tempfile::tempdir().unwrap();
    let with_keys = |name: &str, keys: &[[u16; 4]]| file_with_keys(&folder, name, keys);
    let on_map = [3072, 0, 1, 26910];
    let heights = |code: u16| [4096, 0, 1, code];
    let plain = with_keys("plain.las", &[on_map]);
    let metres = with_keys("metres.las", &[on_map, heights(5703)]);
    let feet = with_keys("feet.las", &[on_map, heights(8228)]);
    let ellipsoid = with_keys("ellipsoid.las", &[on_map, heights(5030)]);
    let feet_by_unit = with_keys("feet_by_unit.las", &[on_map, [4099, 0, 1, 9002]]);
    assert_eq!(codec::open(&metres).unwrap().info().crs.as_deref(), Some("EPSG:26910+5703"));
    let (system, unit) = ("is in another coordinate system than", "is in another unit of heights (ft, not m) than");
    let others = [(&plain, None), (&feet, Some(system)), (&ellipsoid, Some(system)), (&feet_by_unit, Some(unit))];
    for (other, difference) in others {
        for ending in ["las", "csv"] {
            let output = other.with_extension(format!("one.{ending}"));
            let progress = Progress::default();
            let outcome = export(&sources(&[&metres, other]), &PointTest::default(), &[], &output, MEMORY, &progress);
            match outcome {
                Ok(_) => assert_eq!(difference, None, "{}", other.display()),
                Err(error) => assert!(error.to_string().contains(difference.unwrap()), "{error}"),
            }
        }
    }
}

#[test]
fn a_file_that_was_written_to_is_not_read_further() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(&folder, "first.las", las_file((1, 2), 1, &points(1, 500), &[]));
    let source = sources(&[&path]);
    let named = source[0].bytes().named_file().unwrap();
    named.check_unchanged().unwrap();
    let later = std::fs::metadata(&path).unwrap().modified().unwrap() + std::time::Duration::from_secs(2);
    std::fs::write(&path, las_file((1, 2), 1, &points(1, 500), &[])).unwrap();
    std::fs::File::options().write(true).open(&path).unwrap().set_modified(later).unwrap();
    for name in ["one.csv", "one.las", "one.laz", "one.copc.laz", "one.ply", "one.e57"] {
        let output = folder.path().join(name);
        let error = export(&source, &PointTest::default(), &[], &output, MEMORY, &Progress::default()).unwrap_err();
        let told = error.to_string();
        assert!(told.contains("first.las: it has been changed since it was opened"), "{name}: {told}");
        assert!(!output.exists());
    }
    assert!(named.check_unchanged().unwrap_err().to_string().contains("changed since it was opened"));
}

#[test]
fn several_files_get_the_finest_steps_and_a_format_for_all() {
    let folder = tempfile::tempdir().unwrap();
    let first = file(&folder, "first.las", las_file((1, 2), 1, &points(1, 500), &[]));
    let mut coarse = las_file((1, 2), 1, &points(1, 400), &[]);
    for axis in 0..3 {
        coarse[131 + 8 * axis..139 + 8 * axis].copy_from_slice(&(10.0 * SCALE).to_le_bytes());
    }
    let coarse = file(&folder, "coarse.las", coarse);
    let colored = file(&folder, "colored.las", las_file((1, 4), 7, &points(7, 300), &[]));
    let output = folder.path().join("one.laz");
    written(&[&coarse, &first], &PointTest::default(), &output);
    let found = header(&output);
    assert_eq!((found.x_scale_factor, found.point_data_record_format & 0x3f), (SCALE, 1));
    assert_eq!(found.version.minor, 2);
    let expected: Vec<Point> = [las_points(&coarse), las_points(&first)].concat();
    let found = las_points(&output);
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        let same = Point { x: expected.x, y: expected.y, z: expected.z, ..found.clone() };
        assert!((found.x - expected.x).abs() < 1e-6 && same == *expected, "{found:?} {expected:?}");
    }
    // Format 1 and 7 become 7, with all that either has; colours that a file lacks are black.
    let output = folder.path().join("both.las");
    let told = written(&[&first, &colored], &PointTest::default(), &output);
    assert_eq!((told.points, header(&output).point_data_record_format), (800, 7));
    let found = las_points(&output);
    let marked = |mark: u8| move |point: Point| Point { extra_bytes: vec![mark], ..point };
    assert!(found[500..] == las_points(&colored).into_iter().map(marked(1)).collect::<Vec<_>>()[..]);
    assert!(found[..500].iter().all(|point| point.extra_bytes == [0] && point.color == Some(las::Color::default())));
    assert!(told.changes.iter().any(|word| word.contains("where has_color is 0")), "{:?}", told.changes);
    assert!(found[..500].iter().zip(las_points(&first)).all(|(found, point)| found.gps_time == point.gps_time));
    // Beside a file that says which points have colours, those of others that are coloured have theirs.
    let third = folder.path().join("third.las");
    written(&[&output, &colored], &PointTest::default(), &third);
    let marks: Vec<u8> = las_points(&third).iter().map(|point| point.extra_bytes[0]).collect();
    assert!(marks[..500].iter().all(|mark| *mark == 0) && marks[500..].iter().all(|mark| *mark == 1), "{marks:?}");
    // Extra dimensions differ.
    let mut other = points(1, 10);
    other.iter_mut().for_each(|point| point.extra_bytes = vec![1]);
    let other = file(&folder, "other.las", las_file((1, 2), 1, &other, &[]));
    let several = output.with_file_name("several.las");
    let told = written(&[&first, &other], &PointTest::default(), &several);
    assert!(told.changes.iter().any(|word| word.contains("which have no type, are left out")), "{:?}", told.changes);
    assert_eq!(las_points(&several).len(), 510);
}

#[test]
fn a_cloud_goes_to_ply_and_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut made = points(7, 2000);
    made.iter_mut().for_each(|point| point.color = Some(las::Color::new(point.intensity & 0xff00, 513, 65_535)));
    let original = file(&folder, "original.las", las_file((1, 4), 7, &made, &[]));
    let ply = folder.path().join("cloud.ply");
    let told = written(&[&original], &clipped(), &ply);
    assert!(told.changes.iter().any(|word| word.contains("upper 8")), "{:?}", told.changes);
    let expected = read_whole(&original).shown(&clipped());
    let found = read_whole(&ply);
    for attribute in ["intensity", "return_number", "classification", "gps_time", "scan_angle", "point_source_id"] {
        assert_eq!(values(&found, attribute), values(&expected, attribute), "{attribute}");
    }
    let las = folder.path().join("back.laz");
    written(&[&ply], &PointTest::default(), &las);
    let back = las_points(&las);
    let shown: Vec<Point> = las_points(&original).into_iter().filter(is_shown).collect();
    assert_eq!(back.len(), shown.len());
    for (back, point) in back.iter().zip(&shown) {
        let color = point.color.unwrap();
        let upper = |channel: u16| (channel >> 8) * 257;
        let same = Point {
            color: Some(las::Color::new(upper(color.red), upper(color.green), upper(color.blue))),
            ..point.clone()
        };
        let near = Point { x: same.x, y: same.y, z: same.z, scan_angle: same.scan_angle, ..back.clone() };
        assert_eq!(near, same);
        let distance = DVec3::new(back.x - same.x, back.y - same.y, back.z - same.z).abs().max_element();
        assert!(distance < 1e-6 && (back.scan_angle - same.scan_angle).abs() < 1e-5, "{back:?} {same:?}");
    }
    // PLY to PLY: the bytes of the rows that are shown, and nothing of a list.
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
                property float nx\nproperty list uchar int more\nproperty short scalar_a_b\nproperty float intensity\n\
                end_header\n1 2 3 0.5 2 1 1 -7 0.25\nnan 2 3 0.5 0 -7 0.25\n4 5.5 6 0.25 1 9 300 0.75\n7 8 9 1 0 5 0.5\n";
    let original = file(&folder, "text.ply", text);
    let filter = Filter { attribute: "intensity".into(), low: 0.0, high: 0.6 };
    let output = folder.path().join("some.ply");
    written(&[&original], &PointTest::new([], vec![filter], Vec::new()), &output);
    let bytes = std::fs::read(&output).unwrap();
    let mut rows = Vec::new();
    for (x, y, z, nx, a, intensity) in [(1_f32, 2_f64, 3_f32, 0.5_f32, -7_i16, 0.25_f32), (7.0, 8.0, 9.0, 1.0, 5, 0.5)]
    {
        rows.extend([&x.to_le_bytes()[..], &y.to_le_bytes(), &z.to_le_bytes(), &nx.to_le_bytes()].concat());
        rows.extend([&a.to_le_bytes()[..], &intensity.to_le_bytes()].concat());
    }
    assert!(bytes.ends_with(&[b"end_header\n", &rows[..]].concat()), "{}", String::from_utf8_lossy(&bytes));
    assert_eq!(codec::open(&output).unwrap().info().points, 2);
    // A PLY file beside a LAS file: fields that LAS has are its own, the others extra dimensions.
    let both = folder.path().join("both.laz");
    let beside = file(&folder, "beside.las", las_file((1, 4), 7, &points(7, 10), &[]));
    let near = text.replace("1 2 3 0.5", "600001 5000002 103 0.5").replace("7 8 9 1", "600007 5000008 109 1");
    let near =
        file(&folder, "near.ply", near.replace("4 5.5 6", "600004 5000005.5 106").replace("float x", "double x"));
    written(&[&beside, &near], &PointTest::default(), &both);
    let found = values(&read_whole(&both), "scalar_a_b");
    assert!(found[..10].iter().all(|(.., value)| value.is_nan()), "the LAS file has none");
    assert_eq!(found.iter().map(|(.., value)| *value).collect::<Vec<_>>()[10..], [-7.0, 300.0, 5.0]);
    assert_eq!(found[11].0, DVec3::new(600_004.0, 5_000_005.5, 106.0));
    assert!(las_points(&both)[..10].iter().zip(las_points(&beside)).all(|(a, b)| a.color == b.color && a.x == b.x));
}

#[test]
fn a_clip_becomes_copc() {
    let folder = tempfile::tempdir().unwrap();
    let original = file(&folder, "original.laz", compress(&terrain(200_000), &Chunks::Fixed(50_000)));
    let test = PointTest::hiding([2]);
    let output = folder.path().join("trees.copc.laz");
    let told = written(&[&original], &test, &output);
    let source = codec::open(&output).unwrap();
    assert!(source.copc().is_some_and(|copc| copc.nodes.len() > 1), "{:?}", source.info().warnings);
    let sorted = |mut points: Vec<Point>| {
        points.sort_by(|a, b| a.gps_time.unwrap().total_cmp(&b.gps_time.unwrap()));
        points
    };
    let trees = las_points(&original).into_iter().filter(|point| u8::from(point.classification) != 2).collect();
    assert!(sorted(las_points(&output)) == sorted(trees) && told.points > 10_000);
}

#[test]
fn feet_become_metres_in_e57_and_degrees_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let foot = 1200.0 / 3937.0;
    let feet = file_with_keys(&folder, "feet.las", &[[3072, 0, 1, 2229]]);
    let mixed = file_with_keys(&folder, "mixed.las", &[[3072, 0, 1, 2229], [4099, 0, 1, 9001]]);
    for (input, of_heights, told) in
        [(&feet, foot, "in ftUS became metres"), (&mixed, 1.0, "in ftUS, heights in m bec")]
    {
        let output = input.with_extension("e57");
        let exported = written(&[input], &PointTest::default(), &output);
        let word = exported.changes.iter().find(|word| word.contains("became metres"));
        assert!(word.is_some_and(|word| word.contains(told) && word.contains("coordinate system")), "{exported:?}");
        let source = codec::open(&output).unwrap();
        assert_eq!((source.info().crs.as_deref(), source.info().units.text()), (None, "m".into()));
        let scale = DVec3::new(foot, foot, of_heights);
        let found: Vec<DVec3> = values(&read_points(&source), "point_source_id").iter().map(|value| value.0).collect();
        let expected: Vec<DVec3> =
            las_points(input).iter().map(|point| DVec3::new(point.x, point.y, point.z) * scale).collect();
        assert!(found.len() == 100 && found.iter().zip(&expected).all(|(a, b)| (*a - *b).length() < 1e-6));
        let bounds = expected.iter().fold(cloud::Bounds::EMPTY, |mut bounds, place| {
            bounds.include(*place);
            bounds
        });
        assert!((exported.bounds.max - bounds.max).length() < 1e-6, "{:?}", exported.bounds);
    }
    // Lengths of a comparison are in feet, too.
    let output = folder.path().join("distances.e57");
    let ones = Runs::from([(0, Arc::new(Column::F32(vec![1.0; 100])))]);
    let added =
        [("distance", ones.clone()), ("confidence", ones)].map(|(name, ones)| Added::new(name.into(), vec![ones]));
    let progress = Progress::default();
    let exported = export(&sources(&[&feet]), &PointTest::default(), &added, &output, MEMORY, &progress);
    let told = exported.unwrap().unwrap().changes;
    assert!(told.iter().any(|word| word.contains("coordinates, distance in ftUS became metres")), "{told:?}");
    let source = codec::open(&output).unwrap();
    for (name, expected) in [("distance", foot), ("confidence", 1.0)] {
        assert!(values(&read_points(&source), name).iter().all(|value| (value.2 - expected).abs() < 1e-6));
    }
    let degrees = file_with_keys(&folder, "degrees.las", &[[1024, 0, 1, 2], [2048, 0, 1, 4326]]);
    let export_to = |inputs: &[&Path], name: &str| {
        let (output, progress) = (folder.path().join(name), Progress::default());
        export(&sources(inputs), &PointTest::default(), &[], &output, MEMORY, &progress).unwrap_err().to_string()
    };
    let error = export_to(&[&degrees], "degrees.e57");
    assert!(error.contains("degrees.las: x and y are in deg, and E57 has metres alone"), "{error}");
    // The E57 file has no system, and is in metres all the same.
    let metres = feet.with_extension("e57");
    for name in ["both.las", "both.e57", "both.csv"] {
        let error = export_to(&[&feet, &metres], name);
        assert!(error.contains("feet.e57: is in another unit of x and y (m, not ftUS) than"), "{error}");
    }
}

#[test]
fn times_are_marked_as_what_they_are_and_two_kinds_do_not_become_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str, format: u8, is_standard: bool| {
        let mut bytes = las_file((1, 2), format, &points(format, 50), &[]);
        bytes[6] |= u8::from(is_standard);
        file(&folder, name, bytes)
    };
    let (week, standard) = (of("week.las", 1, false), of("standard.las", 1, true));
    let (without, odd) = (of("without.las", 0, false), of("odd.las", 0, true));
    let table = |name: &str, times: [f64; 2]| {
        let [first, second] = times;
        file(&folder, name, format!("x,y,z,gps_time\n600000,5000000,100,{first}\n600001,5000001,101,{second}\n"))
    };
    let (late, early) = (table("late.csv", [2.5e8, 2.5e8 + 1.0]), table("early.csv", [-1.5e8, 3.0]));
    let (of_week, zeros) = (table("of_week.csv", [1.5, 604_800.0]), table("zeros.csv", [0.0, 0.0]));
    let test = PointTest::default();
    for (number, (inputs, is_standard)) in [
        (vec![&without, &standard], true),
        (vec![&odd, &week], false),
        (vec![&late], true),
        (vec![&early], true),
        (vec![&of_week], false),
        (vec![&late, &standard], true),
        (vec![&without, &late], true),
        (vec![&odd, &of_week, &week], false),
        (vec![&zeros, &standard], true),
    ]
    .into_iter()
    .enumerate()
    {
        let inputs: Vec<&Path> = inputs.into_iter().map(PathBuf::as_path).collect();
        for ending in ["las", "laz", "copc.laz"] {
            let output = folder.path().join(format!("{number}.{ending}"));
            written(&inputs, &test, &output);
            assert_eq!(header(&output).global_encoding & 1 == 1, is_standard, "{inputs:?} {ending}");
        }
    }
    let refused = |inputs: [&PathBuf; 2], ending: &str| {
        let (output, progress) = (folder.path().join("both").with_extension(ending), Progress::default());
        let inputs = sources(&inputs.map(PathBuf::as_path));
        let error = export(&inputs, &test, &[], &output, MEMORY, &progress).unwrap_err().to_string();
        assert!(error.contains("counts GPS time in another way"), "{error}");
    };
    for ending in ["las", "copc.laz", "csv", "ply", "e57"] {
        refused([&week, &standard], ending);
    }
    for (number, (inputs, odd_one, is_standard)) in [
        ([&week, &late], "late.csv: gps_time is standard time by", false),
        ([&of_week, &standard], "of_week.csv: gps_time is seconds of a week by", true),
        ([&of_week, &late], "of_week.csv: gps_time is seconds of a week by", true),
    ]
    .into_iter()
    .enumerate()
    {
        let output = folder.path().join(format!("odd {number}.laz"));
        let told = written(&inputs.map(PathBuf::as_path), &test, &output).changes.concat();
        assert!(told.contains(odd_one), "{told}");
        assert_eq!(header(&output).global_encoding & 1 == 1, is_standard, "{inputs:?}");
    }
}

#[test]
fn coordinates_of_a_table_have_the_digits_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let original = file(&folder, "original.las", las_file((1, 2), 0, &points(0, 500), &[]));
    let output = folder.path().join("table.csv");
    written(&[&original], &PointTest::default(), &output);
    let table = std::fs::read_to_string(&output).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 500);
    for (row, point) in rows.iter().zip(las_points(&original)) {
        let expected = [point.x, point.y, point.z].map(|coordinate| format!("{coordinate:.3}"));
        assert_eq!(row[..3], expected);
        assert_eq!(row[3], point.intensity.to_string());
    }
}

#[test]
fn whole_numbers_of_a_table_keep_all_their_digits() {
    let folder = tempfile::tempdir().unwrap();
    let rows = "1,2,3,9007199254740993,18446744073709551615,9007199254740993\n\
        4,5,6,-9223372036854775807,9007199254740995,\n";
    let input = file(&folder, "ids.csv", format!("x,y,z,id,hash,sparse\n{rows}"));
    let source = codec::open(&input).unwrap();
    assert_eq!(source.info().warnings, ["sparse: whole numbers beyond 2^53 lose digits as doubles"]);
    let cells = |source: &Source| {
        let record = |point: u64| source.record(point).unwrap();
        let of = |point: u64, name: &str| record(point).into_iter().find(|(own, _)| own == name).unwrap().1;
        [0, 1].map(|point| [of(point, "id"), of(point, "hash")])
    };
    let exact = [["9007199254740993", "18446744073709551615"], ["-9223372036854775807", "9007199254740995"]];
    assert_eq!(cells(&source), exact);
    for name in ["new.csv", "new.las"] {
        let output = folder.path().join(name);
        written(&[&input], &PointTest::default(), &output);
        assert_eq!(cells(&codec::open(&output).unwrap()), exact, "{name}");
    }
    for name in ["new.ply", "new.e57"] {
        let told = written(&[&input], &PointTest::default(), &folder.path().join(name)).changes.concat();
        assert!(told.contains("id, hash: whole numbers beyond 2^53 lost digits as doubles"), "{told}");
    }
    // What is no whole number of 64 bits among them is counted.
    let text =
        format!("x,y,z,id\n{}1,2,3,1.5\n1,2,3,1e17\n1,2,3,9e18\n1,2,3,9e19\n", "1,2,3,9007199254740993\n".repeat(500));
    let source = codec::open(&file(&folder, "later.csv", text)).unwrap();
    let attributes = vec![true; source.info().attributes.len()];
    let selection = Selection { positions: true, attributes, ..Selection::default() };
    let warnings = source.read(&selection, &Progress::default(), &|_| {}).unwrap().warnings.concat();
    assert!(warnings.contains("2 of 504") || warnings.contains("2 points"), "{warnings}");
    // Those that come first after the lines by which the type is chosen are doubles, and that is said.
    let rows = "1,2,3,1e300\n1,2,3,9007199254740993\n1,2,3,9007199254740992\n";
    let text = format!("x,y,z,id\n{}{rows}", "1,2,3,7\n".repeat(500));
    let source = codec::open(&file(&folder, "late.csv", text)).unwrap();
    let warnings = source.read(&selection, &Progress::default(), &|_| {}).unwrap().warnings.concat();
    assert!(warnings.contains("1 of 503 points have") && warnings.contains("beyond 2^53 among doubles"), "{warnings}");
}

/// The coordinates of a point, and the point without them.
fn apart(point: &Point) -> (DVec3, Point) {
    (DVec3::new(point.x, point.y, point.z), Point { x: 0.0, y: 0.0, z: 0.0, ..point.clone() })
}

fn exported_as(source: Source, test: &PointTest, output: &Path) -> u64 {
    let sources = [Arc::new(source)];
    let exported = export(&sources, test, &[], output, MEMORY, &Progress::default()).unwrap().unwrap();
    assert!(exported.changes.iter().all(|word| !word.contains("another grid")), "{:?}", exported.changes);
    exported.points
}

#[test]
fn moved_points_are_exported_where_they_stand_to_the_steps_of_the_file_and_nothing_else_of_them_changes() {
    let folder = tempfile::tempdir().unwrap();
    let original =
        file(&folder, "original.laz", compress(&las_file((1, 4), 7, &points(7, 3000), &[]), &Chunks::Fixed(700)));
    let middle = DVec3::from(OFFSETS) + DVec3::new(450.0, 450.0, 20.0);
    let turn = DQuat::from_rotation_z(1_f64.to_radians()) * DQuat::from_rotation_x(0.02);
    // The second is farther than the grid of the file reaches.
    for (number, shift) in [DVec3::new(0.05, 0.0, 0.0), DVec3::new(5e6, -3.0, 0.001)].into_iter().enumerate() {
        let placement = Placement::new(turn, middle, shift);
        let open = || codec::open(&original).unwrap().placed(placement);
        // A clip counts where the points stand.
        let volume = Volume::new(VolumeShape::Box, middle + shift, DQuat::IDENTITY, BOX_SIZE);
        let test = PointTest::new([3], Vec::new(), vec![ClipVolume { volume, keeps_inside: true }]);
        let moved = |point: &Point| {
            let (own, rest) = apart(point);
            (placement.point(own), rest)
        };
        let is_shown = |(place, point): &(DVec3, Point)| {
            (*place - middle - shift).abs().cmple(BOX_SIZE * 0.5).all() && u8::from(point.classification) != 3
        };
        let expected: Vec<_> = las_points(&original).iter().map(moved).filter(is_shown).collect();
        assert!((500..2500).contains(&expected.len()), "{}", expected.len());
        for name in ["a.las", "a.laz", "a.copc.laz"].map(|name| format!("{number}{name}")) {
            let output = folder.path().join(&name);
            assert_eq!(exported_as(open(), &test, &output), expected.len() as u64);
            let mut found: Vec<_> = las_points(&output).iter().map(apart).collect();
            let mut expected = expected.clone();
            for points in [&mut found, &mut expected] {
                points.sort_by(|(_, a), (_, b)| a.gps_time.unwrap().total_cmp(&b.gps_time.unwrap()));
            }
            for ((place, rest), (of_place, of_rest)) in found.iter().zip(&expected) {
                assert!((*place - *of_place).abs().max_element() <= SCALE * 0.5 + 1e-6, "{name}: {place} {of_place}");
                assert_eq!(rest, of_rest, "{name}");
            }
            let highest = found.iter().map(|(place, _)| place.z).fold(f64::MIN, f64::max);
            assert!((header(&output).max_z - highest).abs() < 1e-9 && header(&output).x_scale_factor == SCALE);
        }
        // Columns: a table has the digits of the file, and PLY doubles, which go back to LAS.
        let table = folder.path().join(format!("{number}.csv"));
        exported_as(open(), &test, &table);
        let table = std::fs::read_to_string(table).unwrap();
        for (row, (place, _)) in table.lines().skip(1).zip(&expected) {
            let row: Vec<&str> = row.split(',').collect();
            assert_eq!(row[..3], place.to_array().map(|coordinate| format!("{coordinate:.3}")));
        }
        let ply = folder.path().join(format!("{number}.ply"));
        exported_as(open(), &test, &ply);
        let back = folder.path().join(format!("{number}back.las"));
        exported_as(codec::open(&ply).unwrap(), &PointTest::default(), &back);
        for (point, (place, rest)) in las_points(&back).iter().zip(&expected) {
            let (found, own) = apart(point);
            assert!((found - *place).abs().max_element() < 1e-5 && own.intensity == rest.intensity, "{found} {place}");
        }
    }
}

#[test]
fn a_moved_ply_file_has_doubles_for_its_places_and_turned_normals() {
    let folder = tempfile::tempdir().unwrap();
    let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                property float nx\nproperty float ny\nproperty float nz\nproperty uchar class\nend_header\n\
                1 0 0.25 1 0 0 7\n0 2 0.5 0 0 1 8\n";
    let original = file(&folder, "original.ply", text);
    let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let placement = Placement::new(quarter, DVec3::ZERO, DVec3::new(5_000_000.001, 0.0, 0.0));
    let output = folder.path().join("moved.ply");
    exported_as(codec::open(&original).unwrap().placed(placement), &PointTest::default(), &output);
    let cloud = read_whole(&output);
    let found = values(&cloud, "class");
    for ((place, _, class), expected) in
        found.iter().zip([(DVec3::new(5_000_000.001, 1.0, 0.25), 7.0), (DVec3::new(4_999_998.001, 0.0, 0.5), 8.0)])
    {
        assert!((*place - expected.0).abs().max_element() < 1e-6 && *class == expected.1, "{place} {class}");
    }
    let normals = cloud.chunks[0].normals.as_ref().unwrap();
    assert!(cloud::unpack_normal(normals[0]).unwrap().distance(glam::Vec3::Y) < 1e-3);
    assert!(cloud::unpack_normal(normals[1]).unwrap().distance(glam::Vec3::Z) < 1e-3);
}

#[test]
fn points_that_are_read_moved_are_where_the_closed_form_has_them_and_so_are_bounds_and_nodes() {
    let folder = tempfile::tempdir().unwrap();
    let original = file(&folder, "original.laz", compress(&terrain(200_000), &Chunks::Fixed(50_000)));
    let octree = folder.path().join("octree.copc.laz");
    written(&[&original], &PointTest::default(), &octree);
    let own = codec::open(&octree).unwrap();
    let middle = own.info().bounds.unwrap().center();
    let placement = Placement::new(DQuat::from_rotation_y(0.7), middle, DVec3::new(1.0, 2.0, 3.0));
    let selection = Selection { positions: true, ..Selection::default() };
    let read = |source: &Source| {
        let chunks = Mutex::new(Vec::new());
        let emit = |chunk| chunks.lock().unwrap().push(chunk);
        let summary = source.read(&selection, &Progress::default(), &emit).unwrap();
        let mut chunks = chunks.into_inner().unwrap();
        chunks.sort_by_key(|chunk: &Chunk| chunk.first_point);
        (Cloud { grid: source.info().grid, chunks, ..Cloud::default() }, summary.bounds.unwrap())
    };
    let places = |cloud: &Cloud| -> Vec<DVec3> {
        let of = |chunk: &Chunk| (0..chunk.len()).map(|index| cloud.world_position(chunk, index)).collect::<Vec<_>>();
        cloud.chunks.iter().flat_map(of).collect()
    };
    let (before, _) = read(&own);
    let node = own.copc().unwrap().nodes[0].clone();
    let of_node = own.read_copc_node(&node, &selection).unwrap();
    let moved = own.placed(placement);
    let (after, bounds) = read(&moved);
    let both = places(&before).into_iter().zip(places(&after));
    let far = both.map(|(own, place)| place.distance(placement.point(own)));
    assert!(far.fold(0.0, f64::max) < 1e-8);
    let (stated, all) = (moved.info().bounds.unwrap(), after.bounds());
    assert!(bounds == all && stated.contains(all.min + 1e-3) && stated.contains(all.max - 1e-3));
    let placed = moved.read_copc_node(&node, &selection).unwrap();
    assert_eq!(placed.len(), of_node.len());
    let place = placement.point(before.world_position(&of_node, 7));
    assert!(after.world_position(&placed, 7).distance(place) < 1e-8);
}

#[test]
fn warnings_about_a_copc_file_name_files_that_people_know() {
    let folder = tempfile::tempdir().unwrap();
    let original = file(&folder, "waves.las", las_file((1, 3), 4, &points(4, 100), &[]));
    let told = written(&[&original], &PointTest::default(), &folder.path().join("waves.copc.laz"));
    assert!(told.changes.iter().any(|word| word.contains("left out")), "{:?}", told.changes);
    let all = [told.changes, told.warnings].concat();
    assert!(!all.iter().any(|warning| warning.contains("unfinished")), "{all:?}");
}

#[test]
fn points_beyond_the_grid_of_a_new_file_are_refused_and_not_moved() {
    let folder = tempfile::tempdir().unwrap();
    let near = file(&folder, "near.las", las_file((1, 4), 7, &points(7, 10), &[]));
    // The header keeps the bounds, which the file's grid only just reaches with another offset of x. Most points lie
    // further away than that of the first file reaches.
    let mut far = las_file((1, 4), 7, &points(7, 10), &[]);
    far[155..163].copy_from_slice(&(OFFSETS[0] + 2_147_400.0).to_le_bytes());
    let far = file(&folder, "far.las", far);
    let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                end_header\n600001 5000002 103\n";
    let ply = file(&folder, "a.ply", text);
    for inputs in [&[&near, &far][..], &[&near, &far, &ply]] {
        let inputs: Vec<&Path> = inputs.iter().map(|path| path.as_path()).collect();
        let output = folder.path().join("out.las");
        let refused = export(&sources(&inputs), &PointTest::default(), &[], &output, MEMORY, &Progress::default());
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains("a point lies too far outside of what the header says"), "{refused}");
        assert!(!output.exists());
    }
}

#[test]
fn a_file_is_new_and_whole_or_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let original = file(&folder, "original.laz", compress(&terrain(200_000), &Chunks::Fixed(50_000)));
    let before = std::fs::read(&original).unwrap();
    let all = PointTest::default();
    for name in ["out.laz", "out.las", "out.ply", "out.copc.laz"] {
        let output = folder.path().join(name);
        let refusal = |inputs: &[&Path], test: &PointTest, output: &Path| {
            export(&sources(inputs), test, &[], output, MEMORY, &Progress::default()).unwrap_err().to_string()
        };
        let hidden = refusal(&[&original], &PointTest::hiding(0..=255), &output);
        assert!(hidden.contains("no point is shown"), "{hidden}");
        assert!(refusal(&[&original], &all, &original).contains("is there, and is not replaced"));
        assert!(refusal(&[&original], &all, &folder.path().join("gone").join(name)).contains("no such folder"));
        let progress = Progress::default();
        progress.cancel();
        assert!(export(&sources(&[&original]), &all, &[], &output, MEMORY, &progress).unwrap().is_none());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "something is left of {name}");
    }
    assert!(std::fs::read(&original).unwrap() == before);
}

/// Two scans of a scanner on its side. The first is dark.
const PTX: &str = "1\n2\n5 6 7\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n5 6 7 1\n\
    1 0 0 0.6 33 33 33\n2 0 0 0.25 200 33 0\n1\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\
    1 0 0 100.6 255 33 33\n2 0 0 255 33 33 33\n";

#[test]
fn a_scan_without_intensities_leaves_those_of_others_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let text = PTX.replace("255 33 33 33", "0.5 33 33 33").replace(" 100.6 ", " nan ");
    let scans = codec::open_scans(&file(&folder, "two.ptx", text), MEMORY).unwrap();
    let scans: Vec<_> = scans.into_iter().map(Arc::new).collect();
    let output = folder.path().join("two.las");
    let written = export(&scans, &PointTest::default(), &[], &output, MEMORY, &Progress::default()).unwrap().unwrap();
    let intensities: Vec<u16> = las_points(&output).iter().map(|point| point.intensity).collect();
    assert_eq!(intensities[..2], [39321, 16384], "{:?}", written.changes);
    assert!(written.changes.iter().all(|line| !line.contains("beyond")), "{:?}", written.changes);
}

#[test]
fn scans_of_one_file_have_one_scale_of_intensity() {
    let folder = tempfile::tempdir().unwrap();
    for (end, of_dark) in [("255", [154, 64]), ("300", [1, 0])] {
        let text = PTX.replace("255 33 33 33", &format!("{end} 33 33 33"));
        let scans: Vec<_> =
            codec::open_scans(&file(&folder, "two.ptx", text), MEMORY).unwrap().into_iter().map(Arc::new).collect();
        let output = folder.path().join(format!("{end}.las"));
        export(&scans, &PointTest::default(), &[], &output, MEMORY, &Progress::default()).unwrap().unwrap();
        let factor = if end == "255" { 257.0 } else { 1.0 };
        let bright = [100.6 * factor, end.parse::<f64>().unwrap() * factor].map(|value: f64| value.round() as u16);
        let intensities: Vec<u16> = las_points(&output).iter().map(|point| point.intensity).collect();
        assert_eq!(intensities, [of_dark, bright].concat());
        let stations: Vec<u16> = las_points(&output).iter().map(|point| point.point_source_id).collect();
        assert_eq!(stations, [1, 1, 2, 2], "LAS numbers the setups of a scanner so");
    }
}
