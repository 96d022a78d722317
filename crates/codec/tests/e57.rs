//! Reads E57 files: those of the test data, by their manifest, and files that these tests write.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;
mod scans;

use std::io::Cursor;
use std::path::PathBuf;
use std::sync::Mutex;

use cloud::{Chunk, ColumnType, Progress};
use codec::{Selection, Source};
use e57::{E57Writer, Extension, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform, Translation};
use glam::DVec3;
use scans::{MEMORY, places, read, scans, values};

/// A file of the test data; `None` where that is missing.
fn data(name: &str) -> Option<PathBuf> {
    Some(real_data::test_data()?.join(name))
}

#[test]
fn files_of_the_test_data_are_as_the_manifest_says() {
    // Points, the corners of the bounds, and properties in order.
    let known: [(&str, u64, [[f64; 3]; 2], &str); 6] = [
        (
            "pump_structured_scan_rgb_intensity.e57",
            155_201,
            [[-2.904, -5.301, -1.9], [1.722, -0.793, 1.843]],
            "x y z intensity red green blue row_index column_index cartesian_invalid_state",
        ),
        ("bunny_double.e57", 30_571, [[-0.095, 0.04, -0.062], [0.061, 0.187, 0.059]], "x y z cartesian_invalid_state"),
        (
            "bunny_scaled_int24.e57",
            30_571,
            [[-0.095, 0.04, -0.062], [0.061, 0.187, 0.059]],
            "x y z cartesian_invalid_state",
        ),
        ("cartesian_float_rgb.e57", 2090, [[-9.78, 4.514, 295.525], [-6.774, 7.515, 298.532]], "x y z red green blue"),
        ("points_and_images.e57", 2, [[0.0; 3], [1.0; 3]], "x y z"),
        ("pose_translation_only.e57", 4, [[0.0; 3], [1.0, 1.0, 0.0]], "x y z"),
    ];
    for (name, points, bounds, properties) in known {
        let Some(path) = data(&format!("e57/{name}")) else { return };
        let all = scans(&path);
        let info = all[0].info().clone();
        let (chunks, summary) = read(&all[0]);
        assert_eq!((all.len(), info.points, summary.points), (1, points, points), "{name}");
        let names: Vec<&str> = info.properties.iter().map(|property| property.name.as_str()).collect();
        assert_eq!(names.join(" "), properties, "{name}");
        let shift = info.scan.unwrap().position.unwrap_or_default();
        let found = summary.bounds.unwrap();
        for (found, expected) in [(found.min, bounds[0]), (found.max, bounds[1])] {
            // The manifest has them as the scanner sees them.
            assert!((found - shift - DVec3::from(expected)).abs().max_element() < 6e-4, "{name}: {found} {expected:?}");
        }
        assert!(summary.warnings.is_empty() && info.warnings.is_empty(), "{name}: {summary:?} {:?}", info.warnings);
        assert_eq!(places(&chunks).len() as u64, points);
    }
}

#[test]
fn colours_and_grids_of_a_real_scan_are_read_with_their_limits() {
    let Some(path) = data("e57/pump_structured_scan_rgb_intensity.e57") else { return };
    let source = scans(&path).remove(0);
    let (chunks, _) = read(&source);
    let (rows, columns) = (values(&source, &chunks, "row_index"), values(&source, &chunks, "column_index"));
    let most = |values: &[f64]| values.iter().copied().fold(f64::MIN, f64::max);
    assert!(most(&rows) > 100.0 && most(&columns) > 100.0, "{} {}", most(&rows), most(&columns));
    let intensity = values(&source, &chunks, "intensity");
    let [(name, [low, high])] = source.info().limits.as_slice() else { panic!("{:?}", source.info().limits) };
    assert!(name == "intensity" && intensity.iter().all(|value| (*low..=*high).contains(value)));
    let colors: Vec<[u8; 4]> = chunks.iter().flat_map(|chunk| chunk.colors.as_ref().unwrap().to_vec()).collect();
    let own = ["red", "green", "blue"].map(|name| values(&source, &chunks, name));
    let is_own = |at: usize| (0..3).all(|channel| f64::from(colors[at][channel]) == own[channel][at]);
    assert!((0..colors.len()).all(is_own) && colors.iter().any(|color| color[..3] != [0; 3]));
    // A point alone is the same.
    let record = source.record(77_777).unwrap();
    let value = |name: &str| record.iter().find(|(own, _)| own == name).unwrap().1.parse::<f64>().unwrap();
    assert_eq!((value("row_index"), value("intensity")), (rows[77_777], intensity[77_777]));
    assert!((value("x") - places(&chunks)[77_777].x).abs() < 1e-6);
}

#[test]
fn doubles_and_packed_integers_of_one_cloud_agree() {
    let (Some(doubles), Some(packed)) = (data("e57/bunny_double.e57"), data("e57/bunny_scaled_int24.e57")) else {
        return;
    };
    let [doubles, packed] = [doubles, packed].map(|path| places(&read(&scans(&path)[0]).0));
    let apart = std::iter::zip(&doubles, &packed).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    assert!(apart < 1e-6, "{apart}");
}

#[test]
fn several_scans_are_clouds_of_their_own_where_their_poses_put_them() {
    let (Some(still), Some(moved)) = (data("e57/two_scans.e57"), data("e57/A_moved_B.e57")) else { return };
    let still = scans(&still);
    assert_eq!(still.iter().map(|scan| scan.info().points).collect::<Vec<_>>(), [2, 4]);
    // The manifest has the bounds of the first one.
    let bounds = read(&still[0]).1.bounds.unwrap();
    let known = [DVec3::new(-42.642, 1.873, 0.51), DVec3::new(-42.639, 2.058, 0.667)];
    let apart = |(found, known): (DVec3, DVec3)| (found - known).abs().max_element();
    assert!([(bounds.min, known[0]), (bounds.max, known[1])].into_iter().all(|pair| apart(pair) < 6e-4), "{bounds:?}");
    let names: Vec<String> = still.iter().map(|scan| scan.info().name()).collect();
    assert!(names[0] != names[1] && names.iter().all(|name| name.starts_with("two_scans.e57, ")), "{names:?}");

    let moved = scans(&moved);
    assert_eq!(moved.len(), 2);
    let shifts = std::iter::zip(&still, &moved).map(|(still, moved)| {
        let (before, after) = (places(&read(still).0), places(&read(moved).0));
        let shift = after[0] - before[0];
        assert!(
            std::iter::zip(&before, &after).all(|(a, b)| (*b - *a - shift).length() < 1e-4),
            "{before:?} {after:?}"
        );
        shift
    });
    // The file has the second scan at other coordinates, without a pose.
    let shifts: Vec<DVec3> = shifts.collect();
    assert!(shifts[0].length() < 1e-6 && (shifts[1] - DVec3::new(0.833, 2.055, 0.0)).length() < 1e-3, "{shifts:?}");
}

#[test]
fn spherical_coordinates_normals_pictures_and_files_without_scans_are_known() {
    let Some(spherical) = data("e57/spherical_coordinates.e57") else { return };
    let source = scans(&spherical).remove(0);
    let (chunks, summary) = read(&source);
    assert_eq!((source.info().points, source.info().scan.clone().unwrap().position), (360, Some(DVec3::ZERO)));
    let ranges = values(&source, &chunks, "spherical_range");
    let azimuths = values(&source, &chunks, "spherical_azimuth");
    let places = places(&chunks);
    let shown = places.iter().filter(|place| place.is_finite()).count();
    assert!(shown > 0 && (shown == 360 || summary.warnings[0].contains("marked as invalid")), "{summary:?}");
    for at in (0..360).filter(|at| places[*at].is_finite()) {
        assert!((places[at].length() - ranges[at]).abs() < 1e-5);
        let turn = places[at].y.atan2(places[at].x) - azimuths[at];
        assert!(turn.sin().abs() < 1e-4, "{at}: {turn}");
    }

    let normals = scans(&data("e57/normals_extension.e57").unwrap()).remove(0);
    assert!(normals.info().has_normals && normals.info().points == 2, "{:?}", normals.info().properties);
    assert!(read(&normals).0[0].normals.is_some());

    let images = scans(&data("e57/points_and_images.e57").unwrap()).remove(0).info().images.clone();
    assert!(!images.is_empty() && images.iter().all(|image| image.bytes > 0 && image.size[0] > 0), "{images:?}");

    let error = codec::open(&data("e57/zero_scans.e57").unwrap()).err().unwrap().to_string();
    assert!(error.contains("an E57 file without scans"), "{error}");
    let error = codec::open(&data("malformed/e57_bad_page_crc.e57").unwrap()).map(|source| {
        let chunks = Mutex::new(0);
        source.read(&Selection::default(), &Progress::default(), &|chunk| *chunks.lock().unwrap() += chunk.len())
    });
    let told = match error {
        Err(error) | Ok(Err(error)) => error.to_string(),
        Ok(Ok(summary)) => summary.warnings.join("; "),
    };
    assert!(told.contains("checksum"), "{told}");
}

const INVALID: Record =
    Record { name: RecordName::CartesianInvalidState, data_type: RecordDataType::Integer { min: 0, max: 2 } };

fn record(name: RecordName, data_type: RecordDataType) -> Record {
    Record { name, data_type }
}

/// The bytes of a file with one scan.
fn written(prototype: Vec<Record>, pose: Option<Transform>, points: &[Vec<RecordValue>]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
    writer.register_extension(Extension::new("nor", "http://www.libe57.org/E57_NOR_surface_normals.txt")).unwrap();
    let is_whole = |record: &Record| matches!(record.data_type, RecordDataType::Integer { .. });
    let has_intensity = prototype.iter().any(|record| record.name == RecordName::Intensity && is_whole(record));
    let mut scan = writer.add_pointcloud("a scan", prototype).unwrap();
    scan.set_name(Some("hall".into()));
    let limits = [1, 60_000].map(|limit| Some(RecordValue::Integer(limit)));
    let [intensity_min, intensity_max] = limits;
    scan.set_intensity_limits(has_intensity.then_some(e57::IntensityLimits { intensity_min, intensity_max }));
    let time = |gps_time| Some(e57::DateTime { gps_time, atomic_reference: true });
    scan.set_acquisition_start(time(1.2345e9));
    scan.set_acquisition_end(time(1.2345e9 + 0.25));
    scan.set_transform(pose);
    for point in points {
        scan.add_point(point.clone()).unwrap();
    }
    scan.finalize().unwrap();
    writer.finalize().unwrap();
    drop(writer);
    bytes.into_inner()
}

fn place(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hall.e57");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn numbers(values: [f64; 3]) -> Vec<RecordValue> {
    values.map(RecordValue::Double).to_vec()
}

/// A scan of 200,000 points with odd widths of bits, so that values cross the borders of packets and of blocks.
#[test]
fn values_that_cross_packets_and_blocks_are_read_as_they_were_written() {
    let scaled = RecordDataType::ScaledInteger { min: -3, max: 1_000_000, scale: 0.001, offset: 5.0 };
    let prototype = vec![
        record(RecordName::CartesianX, scaled.clone()),
        record(RecordName::CartesianY, RecordDataType::F64),
        record(RecordName::CartesianZ, RecordDataType::F32),
        record(RecordName::RowIndex, RecordDataType::Integer { min: 0, max: 1000 }),
        record(RecordName::ColumnIndex, RecordDataType::Integer { min: 7, max: 7 }),
        record(RecordName::ReturnIndex, RecordDataType::Integer { min: 0, max: 2 }),
        record(RecordName::ReturnCount, RecordDataType::Integer { min: 3, max: 3 }),
    ];
    let count = 200_000_i64;
    let point = |at: i64| {
        vec![
            RecordValue::ScaledInteger(at * 5 - 3),
            RecordValue::Double(at as f64 * 0.1),
            RecordValue::Single(at as f32),
            RecordValue::Integer(at % 1001),
            RecordValue::Integer(7),
            RecordValue::Integer(at % 3),
            RecordValue::Integer(3),
        ]
    };
    let points: Vec<_> = (0..count).map(point).collect();
    let (_folder, path) = place(&written(prototype, None, &points));
    let source = scans(&path).remove(0);
    let (chunks, summary) = read(&source);
    assert_eq!((summary.points, chunks.len() > 3), (count as u64, true));
    let types = |name: &str| source.info().properties.iter().find(|own| own.name == name).unwrap().column_type;
    assert_eq!(
        (types("x"), types("row_index"), types("column_index")),
        (ColumnType::F64, ColumnType::U16, ColumnType::U8)
    );
    let [x, y, z, rows, columns, returns] =
        ["x", "y", "z", "row_index", "column_index", "return_number"].map(|name| values(&source, &chunks, name));
    for at in 0..count as usize {
        assert!((x[at] - ((at * 5) as f64 - 3.0) * 0.001 - 5.0).abs() < 1e-9, "{at}");
        assert_eq!((rows[at], columns[at], returns[at]), ((at % 1001) as f64, 7.0, (at % 3 + 1) as f64), "{at}");
        assert_eq!((y[at], z[at]), (at as f64 * 0.1, at as f64), "{at}");
    }
    let alone = source.record(131_071).unwrap();
    assert!(alone.contains(&("row_index".to_owned(), (131_071 % 1001).to_string())), "{alone:?}");
}

#[test]
fn a_pose_turns_and_moves_points_and_normals_and_is_the_scanners_place() {
    let normal = |axis: &str| RecordName::Unknown { namespace: "nor".into(), name: format!("normal{axis}") };
    let mut prototype: Vec<Record> = [Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64].into();
    prototype.extend(["X", "Y", "Z"].map(|axis| record(normal(axis), RecordDataType::F32)));
    // A quarter turn about z.
    let half = 0.5_f64.sqrt();
    let rotation = Quaternion { w: half, x: 0.0, y: 0.0, z: half };
    let translation = Translation { x: 100.0, y: 200.0, z: 300.0 };
    let mut point = numbers([1.0, 2.0, 3.0]);
    point.extend([1.0, 0.0, 0.0].map(RecordValue::Single));
    let bytes = written(prototype, Some(Transform { rotation, translation }), &[point]);
    let (_folder, path) = place(&bytes);
    let source = scans(&path).remove(0);
    let (chunks, _) = read(&source);
    assert!((places(&chunks)[0] - DVec3::new(98.0, 201.0, 303.0)).length() < 1e-9, "{}", places(&chunks)[0]);
    let normal = cloud::unpack_normal(chunks[0].normals.as_ref().unwrap()[0]).unwrap();
    assert!((normal - glam::Vec3::Y).length() < 1e-3, "{normal}");
    let scan = source.info().scan.clone().unwrap();
    assert_eq!((scan.name.as_str(), scan.position), ("hall", Some(DVec3::new(100.0, 200.0, 300.0))));
    assert_eq!(source.info().name(), "hall.e57", "a scan alone has the name of its file");
}

/// The corners of a room of 4 m about a place, often enough that they say where the points are.
fn room(middle: DVec3) -> Vec<Vec<RecordValue>> {
    let corner = |at: u32| DVec3::new(f64::from(at & 1), f64::from(at >> 1 & 1), f64::from(at >> 2 & 1)) * 4.0 - 2.0;
    (0..64).map(|at| numbers((middle + corner(at)).to_array())).collect()
}

#[test]
fn a_pose_that_was_left_empty_beside_coordinates_of_the_world_is_no_place_of_a_scanner() {
    let axes = || vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64];
    let world = DVec3::new(448_000.0, 5_411_000.0, 300.0);
    let none = Transform { rotation: Quaternion::default(), translation: Translation::default() };
    let registered =
        Transform { rotation: Quaternion::default(), translation: Translation { x: 512.0, y: 87.0, z: 101.0 } };
    let cell = RecordDataType::Integer { min: 0, max: 100 };
    let grid = [RecordName::RowIndex, RecordName::ColumnIndex].map(|name| record(name, cell.clone()));
    let in_cell = |mut point: Vec<RecordValue>| {
        point.extend([1, 2].map(RecordValue::Integer));
        point
    };
    let in_grid = |middle: DVec3| room(middle).into_iter().map(in_cell).collect();
    // The pose and the points of each, and where its scanner stood.
    let own = Some(DVec3::ZERO);
    // Its first points are side by side on a wall.
    let begins_aside = || {
        let aside = (0..1500).map(|at| numbers([3.0, 1e-4 * f64::from(at), 0.0]));
        aside.chain((0..10).flat_map(|_| room(DVec3::ZERO))).collect()
    };
    // So many that a sample of the first points has none with a place.
    let begins_empty = |middle: DVec3| {
        let in_state = |state: i64, points: Vec<Vec<RecordValue>>| {
            let with = move |point: Vec<RecordValue>| [point, vec![RecordValue::Integer(state)]].concat();
            points.into_iter().map(with)
        };
        let empty = (0..3000).map(|_| numbers([0.0; 3])).collect();
        in_state(2, empty).chain(in_state(0, room(middle))).collect()
    };
    let cases = [
        (axes(), Some(none.clone()), begins_aside(), own),
        ([axes(), vec![INVALID]].concat(), Some(none.clone()), begins_empty(world), None),
        ([axes(), vec![INVALID]].concat(), Some(none.clone()), begins_empty(DVec3::ZERO), own),
        (axes(), Some(none.clone()), room(world), None),
        ([axes(), grid.to_vec()].concat(), None, in_grid(world), None),
        (axes(), Some(none.clone()), room(DVec3::ZERO), own),
        ([axes(), grid.to_vec()].concat(), None, in_grid(DVec3::ZERO), own),
        (axes(), Some(none.clone()), room(DVec3::new(20.0, 0.0, 0.0)), own),
        // A narrow window from afar, and one whose place somebody has written down.
        (axes(), Some(none), room(DVec3::new(90.0, 0.0, 0.0)), own),
        (axes(), Some(registered), room(DVec3::new(300.0, 0.0, 0.0)), Some(DVec3::new(512.0, 87.0, 101.0))),
    ];
    for (number, (prototype, pose, points, expected)) in cases.into_iter().enumerate() {
        let (_folder, path) = place(&written(prototype, pose, &points));
        let info = scans(&path).remove(0).info().clone();
        assert_eq!(info.scanner(), expected, "{number}");
        let is_told = info.warnings.iter().any(|warning| warning.contains("its place is taken as unknown"));
        assert_eq!(is_told, expected.is_none(), "{number}: {:?}", info.warnings);
    }
}

#[test]
fn a_scan_that_cannot_be_read_hides_no_others() {
    let opened = |names: &[&str]| {
        let mut bytes = Cursor::new(Vec::new());
        let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
        for name in names {
            let axes = vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64];
            let mut scan = writer.add_pointcloud(name, axes).unwrap();
            scan.set_name(Some((*name).into()));
            let x = if name.starts_with("lost") { f64::NAN } else { 1.0 };
            let translation = Translation { x, y: 2.0, z: 3.0 };
            scan.set_transform(Some(Transform { rotation: Quaternion::default(), translation }));
            scan.add_point(numbers([1.0, 2.0, 3.0])).unwrap();
            scan.finalize().unwrap();
        }
        writer.finalize().unwrap();
        drop(writer);
        let (_folder, path) = place(&bytes.into_inner());
        codec::open_scans(&path, MEMORY)
    };
    let all = opened(&["lost one", "hall", "lost two", "attic"]).unwrap();
    let names: Vec<String> = all.iter().map(|source| source.info().name()).collect();
    assert_eq!(names, ["hall.e57, hall", "hall.e57, attic"]);
    assert!(all.iter().all(|source| read(source).1.points == 1));
    let lost = &all[0].info().lost;
    assert_eq!((lost.len(), all[1].info().lost.len()), (2, 0), "{lost:?}");
    for (told, name) in std::iter::zip(lost, ["lost one", "lost two"]) {
        assert!(told.contains(&format!("hall.e57: scan {name}: its pose has numbers")), "{told}");
    }
    let error = opened(&["lost one"]).err().unwrap().to_string();
    assert!(error.contains("scan lost one: its pose has numbers"), "{error}");
}

#[test]
fn invalid_points_are_left_out_and_counted() {
    let prototype = vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64, INVALID];
    let with = |state: i64, at: f64| {
        let mut point = numbers([at, 0.0, 0.0]);
        point.push(RecordValue::Integer(state));
        point
    };
    let points = [with(0, 1.0), with(2, 2.0), with(1, 3.0), with(0, 4.0)];
    let (_folder, path) = place(&written(prototype, None, &points));
    let source = scans(&path).remove(0);
    let (chunks, summary) = read(&source);
    let shown: Vec<bool> = places(&chunks).iter().map(|place| place.is_finite()).collect();
    assert_eq!(shown, [true, false, false, true]);
    assert_eq!(summary.warnings, ["2 of 4 points are marked as invalid by the scanner and are left out"]);
    assert_eq!(summary.bounds.unwrap().max.x, 4.0);
}

#[test]
fn points_whose_colour_is_invalid_say_that_they_have_none() {
    let mut prototype = vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64];
    prototype.extend([Record::COLOR_RED_U8, Record::COLOR_GREEN_U8, Record::COLOR_BLUE_U8]);
    prototype.push(record(RecordName::IsColorInvalid, RecordDataType::Integer { min: 0, max: 1 }));
    let point = |invalid: i64| {
        let mut point = numbers([invalid as f64, 0.0, 0.0]);
        point.extend([200, 100, 50, invalid].map(RecordValue::Integer));
        point
    };
    let (folder, path) = place(&written(prototype, None, &[point(0), point(1), point(0)]));
    let source = scans(&path).remove(0);
    assert_eq!(values(&source, &read(&source).0, "has_color"), [1.0, 0.0, 1.0]);
    let output = folder.path().join("hall.laz");
    let (sources, test) = ([std::sync::Arc::new(source)], cloud::PointTest::default());
    codec::export(&sources, &test, &[], &output, MEMORY, &Progress::default()).unwrap().unwrap();
    let exported = scans(&output).remove(0);
    let chunks = read(&exported).0;
    assert_eq!(values(&exported, &chunks, "has_color"), [1.0, 0.0, 1.0]);
    let colors = chunks[0].colors.as_ref().unwrap();
    assert_eq!([0, 1].map(|at| colors[at][0]), [200, 0]);
}

#[test]
fn hostile_files_end_in_an_error_or_with_the_points_that_they_have() {
    let prototype: Vec<Record> = [Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64].into();
    let points: Vec<_> = (0..200_000).map(|at| numbers([f64::from(at), 0.0, 0.0])).collect();
    let whole = written(prototype, None, &points);
    let reads = |bytes: &[u8]| {
        let (_folder, path) = place(bytes);
        match codec::open_scans(&path, MEMORY) {
            Ok(all) => {
                let (chunks, mut summary) = read(&all[0]);
                let is_own = |chunk: &Chunk, at: usize| chunk.position(at).x == (chunk.first_point + at as u64) as f64;
                assert!(chunks.iter().all(|chunk| (0..chunk.len()).all(|at| is_own(chunk, at))));
                summary.warnings.extend(all[0].info().warnings.clone());
                (summary.points, summary.warnings.join("; "))
            }
            Err(error) => (0, error.to_string()),
        }
    };
    assert_eq!(reads(&whole).0, 200_000);
    // A page in the midst of the points is damaged: whatever depends on it is missing, with a word.
    let mut damaged = whole.clone();
    damaged[700 * 1024 + 5] ^= 1;
    let (count, told) = reads(&damaged);
    assert!((1..200_000).contains(&count) && told.contains("checksum"), "{count}: {told}");
    // Words of the header that point far away, and files that are cut.
    for (at, bytes) in [(24, u64::MAX), (32, u64::MAX), (32, 1 << 40), (24, 5), (16, 7), (40, 0), (40, u64::MAX)] {
        let mut lying = whole.clone();
        lying[at..at + 8].copy_from_slice(&bytes.to_le_bytes());
        let (_, told) = reads(&lying);
        assert!(at == 16 || told.contains("hall.e57: "), "{at}: {told}");
    }
    for length in [10, 48, 1024, 5000, 512 * 1024] {
        let (count, told) = reads(&whole[..length]);
        assert!(count == 0 && told.contains("hall.e57: "), "{length}: {told}");
    }
}

#[test]
fn an_export_to_e57_keeps_scans_with_their_names_places_and_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let prototype = vec![
        Record::CARTESIAN_X_F64,
        Record::CARTESIAN_Y_F64,
        Record::CARTESIAN_Z_F64,
        Record::INTENSITY_U16,
        Record::COLOR_RED_U8,
        Record::COLOR_GREEN_U8,
        Record::COLOR_BLUE_U8,
        record(RecordName::RowIndex, RecordDataType::Integer { min: 0, max: 500 }),
        INVALID,
    ];
    let points: Vec<_> = (0..1000_i64)
        .map(|at| {
            let mut point = numbers([at as f64 * 0.25, 1.5, -2.0]);
            let whole = [at * 60, at % 256, 7, 255, at / 2, 2 * i64::from(at % 10 == 3)];
            point.extend(whole.map(RecordValue::Integer));
            point
        })
        .collect();
    let translation = Translation { x: 1000.0, y: 2000.0, z: 3.0 };
    let pose = Transform { rotation: Quaternion::default(), translation };
    std::fs::write(path("hall.e57"), written(prototype, Some(pose), &points)).unwrap();
    std::fs::write(path("table.csv"), "x,y,z,odd name\n1,2,3,0.5\n4,5,6,0.25\n").unwrap();
    let mut sources: Vec<Source> = scans(&path("hall.e57"));
    sources.extend(scans(&path("table.csv")));
    let sources: Vec<_> = sources.into_iter().map(std::sync::Arc::new).collect();
    let test = cloud::PointTest::default();
    let exported = codec::export(&sources, &test, &[], &path("both.e57"), MEMORY, &Progress::default());
    let exported = exported.unwrap().unwrap();
    assert_eq!(exported.points, 902);
    let told = exported.changes.iter().find(|word| word.contains("odd name"));
    assert!(told.is_some_and(|word| word.ends_with("table.csv: odd name became the column odd_name")), "{exported:?}");

    let all = scans(&path("both.e57"));
    let positions: Vec<_> = all.iter().map(|scan| scan.info().scan.clone().unwrap()).collect();
    assert_eq!(positions.iter().map(|scan| scan.name.as_str()).collect::<Vec<_>>(), ["hall", "table.csv"]);
    assert_eq!(
        positions.iter().map(|scan| scan.position).collect::<Vec<_>>(),
        [Some(DVec3::new(1000.0, 2000.0, 3.0)), None]
    );
    let (before, after) = (read(&sources[0]).0, read(&all[0]).0);
    let kept: Vec<usize> = (0..1000).filter(|at| at % 10 != 3).collect();
    for name in ["x", "y", "z", "intensity", "row_index", "red", "green", "blue"] {
        let (before, after) = (values(&sources[0], &before, name), values(&all[0], &after, name));
        assert_eq!(kept.iter().map(|at| before[*at]).collect::<Vec<_>>(), after, "{name}");
    }
    assert!(all[0].info().has_colors && read(&all[0]).1.warnings.is_empty());
    // So are the range of the sensor and the time of the scan.
    assert_eq!(all[0].info().limits, [("intensity".to_owned(), [1.0, 60_000.0])]);
    assert_eq!(positions[0].times, [Some((1.2345e9, true)), Some((1.2345e9 + 0.25, true))]);
    assert_eq!((positions[1].times, all[1].info().limits.len()), ([None; 2], 0));
    assert_eq!(values(&all[1], &read(&all[1]).0, "odd_name"), [0.5, 0.25]);
}

#[test]
fn exported_scans_have_guids_of_their_own_and_pictures_that_are_left_out_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
    let prototype = vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64];
    for name in ["one", "two"] {
        let mut scan = writer.add_pointcloud(name, prototype.clone()).unwrap();
        scan.add_point(numbers([1.0, 2.0, 3.0])).unwrap();
        scan.finalize().unwrap();
        let mut image = writer.add_image(name).unwrap();
        let size = e57::VisualReferenceImageProperties { width: 2, height: 2 };
        image.add_visual_reference(e57::ImageFormat::Png, &mut &b"no picture"[..], size, None).unwrap();
        image.finalize().unwrap();
    }
    writer.finalize().unwrap();
    drop(writer);
    let input = folder.path().join("pictures.e57");
    std::fs::write(&input, bytes.into_inner()).unwrap();
    let sources: Vec<_> = scans(&input).into_iter().map(std::sync::Arc::new).collect();
    let mut guids = Vec::new();
    for name in ["a.e57", "b.e57", "c.las"] {
        let output = folder.path().join(name);
        let exported =
            codec::export(&sources, &cloud::PointTest::default(), &[], &output, MEMORY, &Progress::default());
        let told = exported.unwrap().unwrap().changes;
        assert!(told.iter().any(|word| word.contains("pictures.e57: its 2 pictures are left out")), "{told:?}");
        if name.ends_with("e57") {
            let reader = e57::E57Reader::from_file(&output).unwrap();
            guids.push(reader.guid().to_owned());
            guids.extend(reader.pointclouds().into_iter().map(|scan| scan.guid.unwrap()));
        }
    }
    assert_eq!(guids.len(), 6);
    for (number, guid) in guids.iter().enumerate() {
        assert!(!guids[..number].contains(guid), "{guids:?}");
        let parts: Vec<&str> = guid.strip_prefix('{').unwrap().strip_suffix('}').unwrap().split('-').collect();
        assert_eq!(parts.iter().map(|part| part.len()).collect::<Vec<_>>(), [8, 4, 4, 4, 12]);
        assert!(guid.chars().all(|letter| letter.is_ascii_hexdigit() || "{}-".contains(letter)), "{guid}");
        assert!(parts[2].starts_with('4') && parts[3].starts_with(['8', '9', 'A', 'B']), "{guid}");
    }
}

/// A file of one point with a text for its coordinate system.
fn with_system(folder: &tempfile::TempDir, name: &str, system: &str) -> PathBuf {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
    writer.set_coordinate_metadata(Some(system.into()));
    let prototype = vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64];
    let mut scan = writer.add_pointcloud("a scan", prototype).unwrap();
    scan.add_point(numbers([500_000.0, 5_400_000.0, 300.0])).unwrap();
    scan.finalize().unwrap();
    writer.finalize().unwrap();
    drop(writer);
    let path = folder.path().join(name);
    std::fs::write(&path, bytes.into_inner()).unwrap();
    path
}

#[test]
fn the_coordinate_system_of_an_e57_file_goes_on_to_las_or_is_said_to_be_lost() {
    let folder = tempfile::tempdir().unwrap();
    let of = |unit: &str| {
        format!(
            "PROJCS[\"a grid\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],\
             PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],PROJECTION[\"Transverse_Mercator\"],{unit}]"
        )
    };
    let (metres, feet) = (of("UNIT[\"metre\",1]"), of("UNIT[\"US survey foot\",0.304800609601219]"));
    let long = metres.replace("a grid", &"long ".repeat(14_000));
    for (name, text, lost) in [
        ("metres.e57", &metres, None),
        ("feet.e57", &feet, Some("has other units than the coordinates: it is left out")),
        ("name.e57", &"WGS 84 / UTM 32N".to_owned(), Some("is no WKT, which LAS asks for: it is left out")),
        ("long.e57", &long, Some("is longer than a record of LAS: it is left out")),
    ] {
        let input = with_system(&folder, name, text);
        let sources = [std::sync::Arc::new(codec::open(&input).unwrap())];
        for ending in ["las", "laz", "copc.laz"] {
            let (output, test) = (input.with_extension(ending), cloud::PointTest::default());
            let exported = codec::export(&sources, &test, &[], &output, MEMORY, &Progress::default()).unwrap().unwrap();
            let info = codec::open(&output).unwrap().info().clone();
            let told = exported.changes.concat();
            match lost {
                None => assert!(info.crs.as_ref() == Some(text) && !told.contains("system"), "{info:?} {told}"),
                Some(lost) => assert!(info.crs.is_none() && told.contains(lost), "{info:?} {told}"),
            }
        }
    }
}

#[test]
fn colours_of_any_limits_fill_the_range_of_16_bits_in_an_export() {
    let limits = [[0, 1023], [0, 4095], [100, 1123]];
    let mut prototype = vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64];
    let names = [RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue];
    let channels = names.into_iter().zip(limits);
    prototype.extend(channels.map(|(name, [min, max])| record(name, RecordDataType::Integer { min, max })));
    let point = |at: i64| {
        let mut point = numbers([at as f64, 0.0, 0.0]);
        point.extend(limits.map(|[min, max]| RecordValue::Integer(min + (max - min) * at / 100)));
        point
    };
    let (folder, path) = place(&written(prototype, None, &(0..=100).map(point).collect::<Vec<_>>()));
    let output = folder.path().join("wide.las");
    let sources = [std::sync::Arc::new(codec::open(&path).unwrap())];
    codec::export(&sources, &cloud::PointTest::default(), &[], &output, MEMORY, &Progress::default()).unwrap().unwrap();
    let points = las::Reader::from_path(&output).unwrap().read_all().unwrap();
    let colors: Vec<_> = points.points().map(|point| point.unwrap().color.unwrap()).collect();
    assert_eq!(colors.len(), 101);
    for (at, color) in (0..).zip(colors) {
        for ([min, max], found) in limits.into_iter().zip([color.red, color.green, color.blue]) {
            let share = ((max - min) * at / 100) as f64 / (max - min) as f64;
            assert!((f64::from(found) - share * 65_535.0).abs() <= 1.0, "{found} of {min} to {max} at {at}");
        }
    }
}

#[test]
fn colours_that_are_zero_everywhere_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("black.txt"), "x,y,z,r,g,b\n1,2,3,0,0,0\n4,5,6,0,0,0\n").unwrap();
    let source = scans(&path("black.txt")).remove(0);
    let info = source.info().clone();
    assert!(
        !info.has_colors && info.warnings == ["all colours are zero: shown as a cloud without colours"],
        "{info:?}"
    );
    let sources = [std::sync::Arc::new(source)];
    let test = cloud::PointTest::default();
    codec::export(&sources, &test, &[], &path("black.e57"), MEMORY, &Progress::default()).unwrap().unwrap();
    let written = scans(&path("black.e57")).remove(0);
    assert!(!written.info().has_colors, "{:?}", written.info());
}

#[test]
fn scans_of_a_text_keep_their_poses_and_bytes_of_color() {
    let folder = tempfile::tempdir().unwrap();
    // The scanner is turned by a quarter about z.
    let text = "1\n2\n5 6 7\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n5 6 7 1\n\
        1 0 0.5 0.6 33 33 33\n2 3 0 0.25 200 33 0\n";
    let (input, output) = (folder.path().join("one.ptx"), folder.path().join("one.e57"));
    std::fs::write(&input, text).unwrap();
    let sources = || scans(&input).into_iter().map(std::sync::Arc::new).collect::<Vec<_>>();
    codec::export(&sources(), &cloud::PointTest::default(), &[], &output, MEMORY, &Progress::default())
        .unwrap()
        .unwrap();
    let [ours, theirs] = [&input, &output].map(|path| scans(path).remove(0));
    for (read, wanted) in places(&read(&theirs).0).into_iter().zip([[5.0, 7.0, 7.5], [2.0, 8.0, 7.0]]) {
        assert!((read - DVec3::from(wanted)).length() < 1e-12, "{read}");
    }
    let [of_text, of_file] = [&ours, &theirs].map(|source| source.info().scan.clone().unwrap());
    assert_eq!(of_text.position, of_file.position);
    assert!(of_text.turn.angle_between(of_file.turn) < 1e-7 && (of_file.turn * DVec3::X - DVec3::Y).length() < 1e-12);

    let mut reader = e57::E57Reader::from_file(&output).unwrap();
    let scan = reader.pointclouds().remove(0);
    let column = |name: RecordName| scan.prototype.iter().position(|record| record.name == name).unwrap();
    let rows: Vec<_> = reader.pointcloud_raw(&scan).unwrap().map(Result::unwrap).collect();
    let number = |row: usize, name| {
        let column = column(name);
        rows[row][column].to_f64(&scan.prototype[column].data_type).unwrap()
    };
    let own = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ].map(|name| number(1, name));
    assert!((DVec3::from(own) - DVec3::new(2.0, 3.0, 0.0)).length() < 1e-12, "{own:?}");
    assert_eq!([0, 1].map(|row| number(row, RecordName::ColorRed)), [33.0, 200.0]);
}

#[test]
fn an_export_to_e57_of_a_scan_that_is_turned_and_placed_has_its_own_coordinates_and_normals() {
    let normal = |axis: &str| RecordName::Unknown { namespace: "nor".into(), name: format!("normal{axis}") };
    let mut prototype: Vec<Record> = [Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64].into();
    prototype.extend(["X", "Y", "Z"].map(|axis| record(normal(axis), RecordDataType::F32)));
    let own = [[2.0, 3.0, 0.5], [0.0, 0.6, 0.8]];
    let mut point = numbers(own[0]);
    point.extend(own[1].map(|value| RecordValue::Single(value as f32)));
    let turn = glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    let rotation = Quaternion { w: turn.w, x: turn.x, y: turn.y, z: turn.z };
    let pose = Transform { rotation, translation: Translation { x: 10.0, y: 20.0, z: 3.0 } };
    let (folder, path) = place(&written(prototype, Some(pose), &[point]));
    let moved = cloud::Placement::new(glam::DQuat::from_rotation_z(1.1), DVec3::ONE, DVec3::new(5.0, 0.0, 0.0));
    let source = codec::open(&path).unwrap().placed(moved);
    let output = folder.path().join("placed.e57");
    let sources = [std::sync::Arc::new(source)];
    codec::export(&sources, &cloud::PointTest::default(), &[], &output, MEMORY, &Progress::default()).unwrap().unwrap();

    let mut reader = e57::E57Reader::from_file(&output).unwrap();
    let scan = reader.pointclouds().remove(0);
    let row = reader.pointcloud_raw(&scan).unwrap().next().unwrap().unwrap();
    let numbers = row.iter().zip(&scan.prototype).map(|(value, record)| value.to_f64(&record.data_type).unwrap());
    for (found, expected) in numbers.zip(own.concat()) {
        assert!((found - expected).abs() < 1e-6, "{row:?}");
    }
    let turned = scans(&output).remove(0).info().scan.clone().unwrap().turn;
    assert!(turned.angle_between(glam::DQuat::from_rotation_z(1.1) * turn) < 1e-6, "{turned}");
}
