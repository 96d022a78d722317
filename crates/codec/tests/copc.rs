//! COPC: reading node by node gives what reading as LAZ gives; an index that does not fit the file is not used; and a
//! written file has everything that the inputs have, as read by this reader and by that of the crate `las`.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

mod las_files;
#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use cloud::{Bounds, Chunk, Cloud, Progress, Random};
use codec::{Copc, CopcNode, CopcSummary, Selection, Source, write_copc};
use glam::DVec3;
use las::copc::CopcInfoVlr;
use las::{BoundsSelection, CopcReader, LodSelection, Point};
use las_files::{Chunks, compress, descriptor, las_file, terrain};
use real_data::test_data;

const FILES: [&str; 3] =
    ["lone_star_las14_pf6.copc.laz", "ellipsoid_las14_pf7.copc.laz", "simple_with_hierarchy_page.copc.laz"];

fn data(name: &str) -> Option<PathBuf> {
    Some(test_data()?.join("copc").join(name))
}

fn everything(source: &Source) -> Selection {
    let attributes = vec![true; source.info().attributes.len()];
    Selection { positions: true, colors: true, normals: true, attributes }
}

fn cloud(source: &Source, mut chunks: Vec<Chunk>) -> Cloud {
    chunks.sort_by_key(|chunk: &Chunk| chunk.first_point);
    let info = source.info();
    Cloud { name: String::new(), attributes: info.attributes.clone(), grid: info.grid, chunks }
}

fn read_whole(source: &Source) -> Cloud {
    let chunks = Mutex::new(Vec::new());
    source.read(&everything(source), &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    cloud(source, chunks.into_inner().unwrap())
}

/// All attributes of each point, in file order.
fn points(cloud: &Cloud) -> Vec<(DVec3, Option<[u8; 4]>, Vec<u64>)> {
    let of = |chunk: &Chunk| {
        let point = |index: usize| {
            let values = chunk.columns.iter().flatten().map(|column| column.value(index).to_bits());
            let color = chunk.colors.as_ref().map(|colors| colors[index]);
            (cloud.world_position(chunk, index), color, values.collect())
        };
        (0..chunk.len()).map(point).collect::<Vec<_>>()
    };
    cloud.chunks.iter().flat_map(of).collect()
}

fn cube(copc: &Copc, node: &CopcNode) -> Bounds {
    let width = copc.width / f64::from(node.level).exp2();
    let corner = copc.corner + width * glam::UVec3::from(node.cell).as_dvec3();
    Bounds { min: corner, max: corner + width }
}

#[test]
fn nodes_hold_every_point_once_in_their_cubes_as_the_file_read_as_laz() {
    for name in FILES {
        let Some(path) = data(name) else { return };
        check_nodes(&path);
    }
}

/// Every point is in one node, in its cube, and equal to that of the file read as LAZ.
fn check_nodes(path: &Path) {
    let name = path.display();
    let source = codec::open(path).unwrap();
    assert!(source.info().warnings.is_empty(), "{:?}", source.info().warnings);
    let copc = source.copc().unwrap();
    {
        assert_eq!(copc.nodes.iter().map(|node| u64::from(node.points)).sum::<u64>(), source.info().points);
        assert_eq!((copc.nodes[0].level, copc.nodes[0].cell), (0, [0; 3]));
        for node in copc.nodes.iter().filter(|node| node.level > 0) {
            let parent = (node.level - 1, node.cell.map(|cell| cell / 2));
            assert!(copc.nodes.iter().any(|other| (other.level, other.cell) == parent), "{name}: {node:?}");
        }

        // Several threads read, as they do for pages.
        let selection = everything(&source);
        let chunks = std::thread::scope(|scope| {
            let read = |nodes: &[CopcNode]| -> Vec<Chunk> {
                nodes.iter().map(|node| source.read_copc_node(node, &selection).unwrap()).collect()
            };
            let (first, second) = copc.nodes.split_at(copc.nodes.len() / 2);
            let other = scope.spawn(move || read(first));
            let mut chunks = read(second);
            chunks.splice(0..0, other.join().unwrap());
            chunks
        });
        let step = source.info().grid.unwrap().scale;
        for (node, chunk) in copc.nodes.iter().zip(&chunks) {
            assert_eq!(chunk.len(), node.points as usize);
            let cube = cube(copc, node);
            let cube = Bounds { min: cube.min - step, max: cube.max + step };
            let of = Cloud { grid: source.info().grid, ..Cloud::default() };
            let outside = (0..chunk.len()).find(|index| !cube.contains(of.world_position(chunk, *index)));
            assert_eq!(outside, None, "{name}: {node:?} {cube:?}");
        }
        let chunks = chunks.into_iter().filter(|chunk| !chunk.is_empty()).collect();
        assert!(points(&cloud(&source, chunks)) == points(&read_whole(&source)), "{name}");
    }
}

#[test]
fn only_what_is_selected_of_a_node_comes() {
    let Some(path) = data("ellipsoid_las14_pf7.copc.laz") else { return };
    let source = codec::open(&path).unwrap();
    let node = &source.copc().unwrap().nodes[0];
    let index = source.info().attributes.iter().position(|attribute| attribute.name == "classification").unwrap();
    let mut attributes = vec![false; index + 1];
    attributes[index] = true;
    let whole = source.read_copc_node(node, &everything(&source)).unwrap();
    let column = source.read_copc_node(node, &Selection { attributes, ..Selection::default() }).unwrap();
    assert_eq!(column.columns[index], whole.columns[index]);
    assert!(column.positions.is_empty() && column.colors.is_none());
    assert_eq!(column.columns.iter().flatten().count(), 1);
}

#[test]
fn a_plain_laz_file_has_no_nodes_and_no_warning() {
    let Some(path) = data("ellipsoid_las14_pf7_plain.laz") else { return };
    let source = codec::open(&path).unwrap();
    assert!(source.copc().is_none() && source.info().warnings.is_empty(), "{:?}", source.info().warnings);
}

/// The info record's field at `at` in `file`.
fn info_field(file: &[u8], at: usize) -> usize {
    u64::from_le_bytes(file[429 + at..][..8].try_into().unwrap()) as usize
}

/// `source` and its warning; it must still read as LAZ in full.
fn without_index(bytes: &[u8], expected_points: u64) -> String {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let source = codec::open(file.path()).unwrap();
    assert!(source.copc().is_none());
    assert_eq!(read_whole(&source).len(), expected_points);
    source.info().warnings.join("\n")
}

#[test]
fn an_index_that_does_not_fit_the_file_is_not_used_and_the_file_is_read_as_laz() {
    let Some(path) = data("simple_with_hierarchy_page.copc.laz") else { return };
    let file = std::fs::read(path).unwrap();
    let root = info_field(&file, 40);
    let entries = info_field(&file, 48) / 32;
    let entry = |index: usize| root + 32 * index;
    let i32_at = |at: usize| i32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    let link = (0..entries).map(entry).find(|at| i32_at(at + 28) == -1).unwrap();
    let page = u64::from_le_bytes(file[link + 16..link + 24].try_into().unwrap()) as usize;

    let patch = |at: usize, bytes: &[u8]| {
        let mut file = file.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        file
    };
    // The sub-page names the root page: a circle.
    let mut circle = file[link..link + 32].to_vec();
    circle[16..24].copy_from_slice(&(root as u64).to_le_bytes());
    circle[24..28].copy_from_slice(&(32 * entries as i32).to_le_bytes());
    let twice: [u8; 32] = file[entry(1)..entry(2)].try_into().unwrap();
    let (half, header_max) = (info_field(&file, 24) as u64, 179);
    let cases: [(&str, Vec<u8>, &str); 21] = [
        ("a circle of pages", patch(page + 32, &circle), "a page that is named twice"),
        ("a page outside", patch(link + 16, &(file.len() as u64).to_le_bytes()), "outside the record of pages"),
        ("a page before", patch(link + 16, &375_u64.to_le_bytes()), "outside the record of pages"),
        ("a huge page", patch(link + 24, &i32::MAX.to_le_bytes()), "outside the record of pages"),
        ("a negative page", patch(link + 24, &(-32_i32).to_le_bytes()), "a page of -32 bytes"),
        ("a root page without end", patch(429 + 48, &u64::MAX.to_le_bytes()), "outside the record of pages"),
        ("an empty root page", patch(429 + 48, &0_u64.to_le_bytes()), "outside the record of pages"),
        ("a node past the end", patch(entry(0) + 16, &u64::MAX.to_le_bytes()), "no compressed chunk of"),
        ("a huge count", patch(entry(0) + 28, &i32::MAX.to_le_bytes()), "are read at once"),
        ("another count", patch(entry(0) + 28, &23_i32.to_le_bytes()), "no compressed chunk of 23 points"),
        ("a count below zero", patch(entry(0) + 28, &(-2_i32).to_le_bytes()), "-2 points"),
        ("a node outside", patch(entry(1) + 4, &2_i32.to_le_bytes()), "outside of the root's cube"),
        ("a node twice", patch(entry(2), &twice), "no compressed chunk of"),
        ("no cube", patch(429 + 24, &f64::NAN.to_le_bytes()), "no cube"),
        ("a cube without end", patch(429 + 24, &1e308_f64.to_le_bytes()), "no cube"),
        ("a cube of nothing", patch(429 + 24, &1e-300_f64.to_le_bytes()), "no cube"),
        ("too small a cube", patch(429 + 24, &(0.4 * f64::from_bits(half)).to_le_bytes()), "does not hold the points"),
        ("a cube elsewhere", patch(429, &0_f64.to_le_bytes()), "does not hold the points"),
        ("no spacing", patch(429 + 32, &1e-300_f64.to_le_bytes()), "no cube"),
        ("a huge spacing", patch(429 + 32, &1e300_f64.to_le_bytes()), "no cube"),
        ("points elsewhere", patch(header_max, &1e6_f64.to_le_bytes()), "does not hold the points"),
    ];
    for (name, bytes, expected) in cases {
        let warnings = without_index(&bytes, 1065);
        assert!(warnings.contains("the COPC index is not usable") && warnings.contains(expected), "{name}: {warnings}");
    }
    // Nodes that are left out would hide their points.
    let warnings = without_index(&patch(429 + 48, &64_u64.to_le_bytes()), 1065);
    assert!(warnings.contains("belong to no node"), "{warnings}");
}

#[test]
fn nodes_without_points_make_none_above_them() {
    let Some(path) = data("simple_with_hierarchy_page.copc.laz") else { return };
    let file = std::fs::read(&path).unwrap();
    let copc = codec::open(&path).unwrap().copc().unwrap().clone();
    let (root, length) = (info_field(&file, 40), info_field(&file, 48));
    // Copies the root page to the end of the file and appends entries without points; the record grows to that end.
    let with = |empty: usize| {
        let mut bytes = file.clone();
        let at = bytes.len() as u64;
        bytes.extend_from_slice(&file[root..root + length]);
        for index in 0..empty as i32 {
            // 30 levels down, each on a path of its own.
            bytes.extend([30, index << 18, index, 0].iter().flat_map(|number: &i32| number.to_le_bytes()));
            bytes.extend([0; 16]);
        }
        bytes[429 + 40..429 + 48].copy_from_slice(&at.to_le_bytes());
        bytes[429 + 48..429 + 56].copy_from_slice(&((length + 32 * empty) as u64).to_le_bytes());
        let record = u64::from_le_bytes(bytes[235..243].try_into().unwrap()) as usize;
        let new_length = bytes.len() - record - 60;
        bytes[record + 20..record + 28].copy_from_slice(&(new_length as u64).to_le_bytes());
        bytes
    };
    let some = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(some.path(), with(1_000)).unwrap();
    let source = codec::open(some.path()).unwrap();
    let places = |copc: &Copc| copc.nodes.iter().map(|node| (node.level, node.cell, node.points)).collect::<Vec<_>>();
    assert_eq!(source.copc().map(places), Some(places(&copc)), "{:?}", source.info().warnings);
    let warnings = without_index(&with(100_000), 1065);
    assert!(warnings.contains("compressed chunks"), "{warnings}");
}

#[test]
fn a_file_cut_short_gives_the_points_that_are_there() {
    let Some(path) = data("simple_with_hierarchy_page.copc.laz") else { return };
    let file = std::fs::read(path).unwrap();
    let root = info_field(&file, 40);
    let warnings = without_index(&file[..root + 40], 1065);
    assert!(warnings.contains("the COPC index is not usable: the record of its pages is missing"), "{warnings}");
}

#[test]
fn no_damaged_byte_of_the_index_brings_the_reader_down() {
    let Some(path) = data("simple_with_hierarchy_page.copc.laz") else { return };
    let file = std::fs::read(path).unwrap();
    let root = info_field(&file, 40);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.copc.laz");
    let mut noise = Random(3);
    let mut used = 0;
    for _ in 0..150 {
        let mut damaged = file.clone();
        for _ in 0..1 + noise.below(3) {
            let places = [375..589, root - 60..file.len(), 1432..root];
            let place = &places[noise.below(3) as usize];
            damaged[place.start + noise.below(place.len() as u64) as usize] = noise.draw() as u8;
        }
        std::fs::write(&path, &damaged).unwrap();
        let Ok(source) = codec::open(&path) else { continue };
        let Some(copc) = source.copc() else { continue };
        used += 1;
        let all: u64 = copc
            .nodes
            .iter()
            .filter_map(|node| source.read_copc_node(node, &everything(&source)).ok())
            .map(|chunk| chunk.len() as u64)
            .sum();
        assert!(all <= source.info().points);
    }
    assert!(used > 10, "too few were read for this to prove anything: {used}");
}

const MEMORY: u64 = 256 << 20;

fn write(inputs: &[&Path], output: &Path, memory: u64) -> CopcSummary {
    let inputs: Vec<PathBuf> = inputs.iter().map(|path| path.to_path_buf()).collect();
    let progress = Progress::default();
    let summary = write_copc(&inputs, output, memory, &progress).unwrap().unwrap();
    assert_eq!(progress.done(), progress.total());
    summary
}

/// The points of a file as the crate `las` reads them, in an order that depends only on their values.
fn las_points(path: &Path) -> Vec<Point> {
    let mut points: Vec<Point> =
        las::Reader::from_path(path).unwrap().read_all().unwrap().points().map(Result::unwrap).collect();
    points.sort_by(compare);
    points
}

/// The same points, found through the hierarchy.
fn queried_points(path: &Path) -> Vec<Point> {
    let mut reader = CopcReader::from_path(path).unwrap();
    let found = reader.query(LodSelection::All, BoundsSelection::All).unwrap();
    let mut points: Vec<Point> = found.points().map(Result::unwrap).collect();
    points.sort_by(compare);
    points
}

fn compare(a: &Point, b: &Point) -> std::cmp::Ordering {
    let of = |point: &Point| [point.x, point.y, point.z, point.gps_time.unwrap_or(0.0), f64::from(point.intensity)];
    let ordered = of(a).iter().zip(of(b)).map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne());
    let bytes =
        |point: &Point| (point.point_source_id, point.user_data, point.return_number, point.extra_bytes.clone());
    ordered.unwrap_or_else(|| bytes(a).cmp(&bytes(b)))
}

/// A point as a COPC file keeps it.
fn upgraded(mut point: Point, colors: bool) -> Point {
    point.waveform = None;
    point.gps_time = Some(point.gps_time.unwrap_or(0.0));
    if colors && point.color.is_none() {
        point.color = Some(las::Color::new(0, 0, 0));
    }
    point
}

/// Angles of formats 0 to 5 are whole degrees, later ones steps of 0.006.
fn assert_same_points(found: &[Point], expected: &[Point], name: &str) {
    assert_eq!(found.len(), expected.len(), "{name}");
    for (found, expected) in found.iter().zip(expected) {
        assert!((found.scan_angle - expected.scan_angle).abs() < 0.004, "{name}: {found:?} {expected:?}");
        let found = Point { scan_angle: expected.scan_angle, ..found.clone() };
        assert_eq!(&found, expected, "{name}");
    }
}

#[test]
fn points_of_every_format_come_back_with_all_they_have() {
    let folder = tempfile::tempdir().unwrap();
    let extra = [descriptor("one", 1, None), descriptor("two", 9, Some((0.5, 1.0)))].concat();
    for format in 0..=10_u8 {
        let mut points = las_files::points(format, 3_000);
        for (index, point) in points.iter_mut().enumerate() {
            point.extra_bytes = (index as u32).to_le_bytes().into_iter().chain([7]).collect();
        }
        let version = if format < 6 { (1, 3) } else { (1, 4) };
        let vlrs = [("LASF_Spec", 4, extra.clone()), ("somebody", 5, vec![1, 2, 3])];
        let las = las_file(version, format, &points, &vlrs);
        let input = folder.path().join("input.las");
        std::fs::write(&input, &las).unwrap();
        let output = folder.path().join("output.copc.laz");
        let summary = write(&[&input], &output, MEMORY);
        let wave_packets = [4, 5, 9, 10].contains(&format);
        // Whole degrees lie between the steps of later formats.
        let changes = usize::from(wave_packets) + usize::from(format < 6);
        assert_eq!((summary.points, summary.changes.len()), (3_000, changes), "{:?}", summary.changes);
        assert_eq!(summary.warnings, Vec::<String>::new());

        check_nodes(&output);
        let name = format!("format {format}");
        let expected: Vec<Point> = las_points(&input).into_iter().map(|point| upgraded(point, false)).collect();
        assert_same_points(&las_points(&output), &expected, &name);
        assert_same_points(&queried_points(&output), &expected, &name);

        let reader = las::Reader::from_path(&output).unwrap();
        let header = reader.header();
        let kept = header.vlrs().iter().find(|vlr| vlr.user_id == "somebody").unwrap();
        assert_eq!(kept.data, [1, 2, 3]);
        let range = |of: fn(&Point) -> f64| {
            let values = expected.iter().map(of);
            (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
        };
        let las::Bounds { min, max } = header.bounds();
        assert_eq!([(min.x, max.x), (min.y, max.y), (min.z, max.z)], [range(|p| p.x), range(|p| p.y), range(|p| p.z)]);
        let returns: u64 = (1..=15).filter_map(|number| header.number_of_points_by_return(number)).sum();
        assert_eq!(returns, 3_000);
        let (before, after) = (codec::open(&input).unwrap(), codec::open(&output).unwrap());
        assert_eq!(before.info().attributes.last(), after.info().attributes.last(), "{name}");
    }
}

#[test]
fn scans_come_back_node_by_node_as_they_were() {
    let names = [
        "airborne/ign_france_lidarhd_las14_pf8_extrabytes.laz",
        "airborne/autzen_trim_las12_pf3.las",
        "copc/ellipsoid_las14_pf7.copc.laz",
        "las_matrix/las12_pf2_color.las",
    ];
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("output.copc.laz");
    for name in names {
        let Some(input) = data(&format!("../{name}")) else { return };
        let summary = write(&[&input], &output, MEMORY);
        assert_eq!(summary.warnings, Vec::<String>::new());
        check_nodes(&output);
        let expected: Vec<Point> = las_points(&input).into_iter().map(|point| upgraded(point, false)).collect();
        assert_same_points(&queried_points(&output), &expected, name);
        let (before, after) = (codec::open(&input).unwrap(), codec::open(&output).unwrap());
        // Keys of GeoTIFF become WKT, where their codes say everything.
        let [before_crs, after_crs] = [&before, &after].map(|source| source.info().crs.as_deref().unwrap_or_default());
        let is_text = |crs: &str| crs.contains("CS[") || crs.contains("CRS[");
        assert!(
            before_crs == after_crs || !is_text(before_crs) && is_text(after_crs),
            "{name}: {before_crs} {after_crs}"
        );
        assert!(las::Reader::from_path(&output).unwrap().header().has_wkt_crs(), "{name}");
        let mut reader = CopcReader::from_path(&output).unwrap();
        // A level is an even subset: the root has some points, but not all of a large cloud.
        let root = reader.query(LodSelection::Level(0), BoundsSelection::All).unwrap().len();
        assert!(root > 0 && (root < 60_000 || expected.len() < 60_000), "{name}: {root}");
        let info = CopcInfoVlr::try_from(reader.header().vlrs().first().unwrap()).unwrap();
        let (first, last) = (info.gpstime_minimum, info.gpstime_maximum);
        assert!(expected.iter().all(|point| point.gps_time.is_some_and(|time| (first..=last).contains(&time))));
    }
}

#[test]
fn a_file_is_the_same_each_time() {
    let Some(input) = data("../airborne/autzen_trim_las12_pf3.laz") else { return };
    let folder = tempfile::tempdir().unwrap();
    let outputs = ["a.copc.laz", "b.copc.laz"].map(|name| folder.path().join(name));
    for output in &outputs {
        write(&[&input], output, MEMORY);
    }
    assert!(std::fs::read(&outputs[0]).unwrap() == std::fs::read(&outputs[1]).unwrap());
}

#[test]
fn little_memory_gives_the_same_points() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("input.las");
    std::fs::write(&input, terrain(700_000)).unwrap();
    let expected = las_points(&input);
    let outputs = [(1, "little.copc.laz"), (1 << 30, "much.copc.laz")].map(|(memory, name)| {
        let output = folder.path().join(name);
        write(&[&input], &output, memory);
        check_nodes(&output);
        let expected: Vec<Point> = expected.iter().map(|point| upgraded(point.clone(), false)).collect();
        assert_same_points(&queried_points(&output), &expected, name);
        output
    });
    let levels = outputs.map(|output| codec::open(&output).unwrap().copc().unwrap().nodes.last().unwrap().level);
    assert!(levels[0] >= 3, "one part for each eighth: {levels:?}");
}

#[test]
fn tiles_of_different_formats_and_grids_become_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["one.las", "three.laz"].map(|name| folder.path().join(name));
    let (one, three) = (las_files::points(1, 2_000), las_files::points(3, 3_000));
    std::fs::write(&paths[0], las_file((1, 2), 1, &one, &[])).unwrap();
    // The same steps, counted from elsewhere.
    let mut las = las_file((1, 2), 3, &three, &[]);
    let offset = f64::from_le_bytes(las[155..163].try_into().unwrap()) + 25.0;
    las[155..163].copy_from_slice(&offset.to_le_bytes());
    for at in [179, 187] {
        let bound = f64::from_le_bytes(las[at..at + 8].try_into().unwrap()) + 25.0;
        las[at..at + 8].copy_from_slice(&bound.to_le_bytes());
    }
    std::fs::write(&paths[1], compress(&las, &Chunks::Fixed(700))).unwrap();
    let output = folder.path().join("both.copc.laz");
    let summary = write(&[&paths[0], &paths[1]], &output, MEMORY);
    assert_eq!(summary.warnings, Vec::<String>::new());
    check_nodes(&output);
    let mut expected = las_points(&paths[0]);
    expected.extend(las_points(&paths[1]));
    let grid = |value: f64| (value * 1000.0).round() / 1000.0;
    let rounded = |point: Point| {
        let (x, y, z) = (grid(point.x), grid(point.y), grid(point.z));
        Point { x, y, z, ..upgraded(point, true) }
    };
    let mut expected: Vec<Point> = expected.into_iter().map(rounded).collect();
    let mut found: Vec<Point> = queried_points(&output).into_iter().map(rounded).collect();
    expected.sort_by(compare);
    found.sort_by(compare);
    assert_same_points(&found, &expected, "both");
}

#[test]
fn points_outside_of_the_headers_bounds_are_in_their_nodes() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("input.las");
    let mut las = las_file((1, 2), 1, &las_files::points(1, 100_000), &[]);
    // The largest x of 900 m becomes 10 m.
    las[179..187].copy_from_slice(&600_010.0_f64.to_le_bytes());
    std::fs::write(&input, las).unwrap();
    let output = folder.path().join("output.copc.laz");
    write(&[&input], &output, MEMORY);
    check_nodes(&output);
    assert!(codec::open(&output).unwrap().copc().unwrap().nodes.len() > 4);
}

#[test]
fn what_cannot_be_written_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let points = las_files::points(1, 500);
    std::fs::write(path("plain.las"), las_file((1, 2), 1, &points, &[])).unwrap();
    let mut with_extra = points.clone();
    with_extra.iter_mut().for_each(|point| point.extra_bytes = vec![1]);
    let extra = ("LASF_Spec", 4, descriptor("one", 1, None));
    std::fs::write(path("extra.las"), las_file((1, 2), 1, &with_extra, &[extra])).unwrap();
    for name in ["here", "elsewhere"] {
        let wkt = ("LASF_Projection", 2112, format!("PROJCS[\"{name}\"]").into_bytes());
        std::fs::write(path(&format!("{name}.las")), las_file((1, 4), 1, &points, &[wkt])).unwrap();
    }
    std::fs::write(path("empty.las"), las_file((1, 2), 1, &[], &[])).unwrap();
    std::fs::write(
        path("mesh.ply"),
        "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
    )
    .unwrap();
    let before = std::fs::read_dir(folder.path()).unwrap().count();
    let cases: [(&[&str], &str, &str); 7] = [
        (&[], "out.copc.laz", "there are no inputs"),
        (&["plain.las"], "plain.las", "one of the inputs"),
        (&["mesh.ply"], "out.copc.laz", "no LAS or LAZ file; `glint export FILE -o OUT.copc.laz` writes COPC of it"),
        (&["plain.las", "extra.las"], "out.copc.laz", "other extra dimensions"),
        (&["here.las", "elsewhere.las"], "out.copc.laz", "another coordinate system"),
        (&["empty.las"], "out.copc.laz", "no points"),
        (&["plain.las"], "nowhere/out.copc.laz", "nowhere"),
    ];
    for (inputs, output, expected) in cases {
        let inputs: Vec<PathBuf> = inputs.iter().map(|name| path(name)).collect();
        let error = write_copc(&inputs, &path(output), MEMORY, &Progress::default()).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let cancelled = Progress::default();
    cancelled.cancel();
    assert!(write_copc(&[path("plain.las")], &path("out.copc.laz"), MEMORY, &cancelled).unwrap().is_none());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before);
    assert_eq!(std::fs::read(path("plain.las")).unwrap(), las_file((1, 2), 1, &points, &[]));
}

#[test]
fn a_damaged_input_gives_what_is_there_and_says_what_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("input.laz");
    let laz = compress(&las_file((1, 2), 1, &las_files::points(1, 5_000), &[]), &Chunks::Fixed(1_000));
    std::fs::write(&input, &laz[..laz.len() / 2]).unwrap();
    let output = folder.path().join("output.copc.laz");
    let summary = write(&[&input], &output, MEMORY);
    assert!((1_000..5_000).contains(&summary.points), "{summary:?}");
    assert!(summary.warnings.iter().any(|warning| warning.contains("input.laz") && warning.contains("missing")));
    check_nodes(&output);
}

/// Points on a grid of thousandths, with an offset in x and y, and the header's bounds.
fn far_away(offset: f64, header_bounds: [f64; 2]) -> Vec<u8> {
    let mut file = las_file((1, 2), 0, &las_files::points(0, 100), &[]);
    let numbers = [1e-3, 1e-3, 1e-3, offset, offset, 0.0];
    let [least, most] = header_bounds;
    let numbers = numbers.into_iter().chain([most, least, most, least, 0.0, 0.0]);
    for (place, number) in numbers.enumerate() {
        file[131 + 8 * place..139 + 8 * place].copy_from_slice(&number.to_le_bytes());
    }
    file
}

#[test]
fn coordinates_that_numbers_hardly_tell_apart_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("input.las");
    let output = folder.path().join("output.copc.laz");
    for offset in [1e9, 1e14, 1e15, 1e17] {
        // A header with the bounds of one point, where there are others.
        std::fs::write(&input, far_away(offset, [offset; 2])).unwrap();
        let summary = write_copc(std::slice::from_ref(&input), &output, MEMORY, &Progress::default()).unwrap().unwrap();
        assert_eq!(summary.points, 100, "{offset}");
        let source = codec::open(&output).unwrap();
        assert!(source.copc().is_some(), "{offset}: {:?}", source.info().warnings);
        assert_eq!(read_whole(&source).len(), 100);
    }
}

#[test]
fn many_damaged_chunks_are_one_warning_with_their_number() {
    let folder = tempfile::tempdir().unwrap();
    let las = las_file((1, 4), 6, &las_files::points(6, 4_000), &[]);
    let mut laz = compress(&las, &Chunks::Fixed(100));
    let start = u32::from_le_bytes(laz[96..100].try_into().unwrap()) as usize;
    let table = u64::from_le_bytes(laz[start..start + 8].try_into().unwrap()) as usize;
    // Sizes of layers that are too long, in all chunks but the first.
    laz[start + (table - start) / 20..table].fill(0xff);
    let input = folder.path().join("a.laz");
    std::fs::write(&input, &laz).unwrap();
    let summary = write_copc(&[input], &folder.path().join("a.copc.laz"), MEMORY, &Progress::default());
    let warnings = summary.unwrap().unwrap().warnings;
    assert!(
        warnings.len() < 5 && warnings.iter().any(|warning| warning.contains(" times, first at record ")),
        "{warnings:?}"
    );
}

#[test]
fn a_file_that_cannot_be_written_is_named_once_and_no_temporary_one() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("a.las");
    std::fs::write(&input, las_file((1, 4), 6, &las_files::points(6, 10), &[])).unwrap();
    let output = folder.path().join("missing/a.copc.laz");
    let error = write_copc(&[input], &output, MEMORY, &Progress::default()).err().unwrap().to_string();
    let name = output.display().to_string();
    assert!(error.starts_with(&format!("{name}: cannot be written: ")), "{error}");
    assert!(
        !error.contains("unfinished") && !error.contains(" at path ") && error.matches("missing").count() == 1,
        "{error}"
    );
}
