//! Files that other programs open, and merges that lose nothing.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use las::Point;
use ply_rs::parser::Parser;
use ply_rs::ply::{DefaultElement, Ply, Property};
use tests::{Folder, Outcome};

/// Exports cases to a new file, and gives what was said.
fn export(folder: &Folder, cases: &[&str], output: &str) -> Option<Outcome> {
    let from = crate::folder()?;
    let inputs = cases.iter().map(|case| from.join(case));
    let outcome =
        folder.glint([PathBuf::from("export"), PathBuf::from("-o"), PathBuf::from(output)].into_iter().chain(inputs));
    assert_eq!(outcome.status, Some(0), "{outcome}");
    Some(outcome)
}

/// The header, the points, and the values of extra dimensions by their names, as the crate `las` has them.
struct LasFile {
    header: las::Header,
    points: Vec<Point>,
    extra: Vec<(String, Vec<f64>)>,
}

/// All points of a file, with its header.
fn read_las(path: &Path) -> (Vec<Point>, las::Header) {
    let mut reader = las::Reader::from_path(path).expect("a LAS file");
    let points = reader.read_all().expect("points").points().map(|point| point.expect("a point")).collect();
    (points, reader.header().clone())
}

impl LasFile {
    fn read(path: &Path) -> Self {
        let (points, header) = read_las(path);
        let mut extra = Vec::new();
        let mut at = 0;
        let is_extra = |vlr: &&las::Vlr| vlr.user_id == "LASF_Spec" && vlr.record_id == 4;
        for descriptor in header.all_vlrs().filter(is_extra).flat_map(|vlr| vlr.data.chunks_exact(192)) {
            let name = descriptor[4..36].split(|byte| *byte == 0).next().expect("a name");
            let (size, value): (usize, fn(&[u8]) -> f64) = match descriptor[2] {
                1 => (1, |bytes| f64::from(bytes[0])),
                9 => (4, |bytes| f64::from(f32::from_le_bytes(bytes.try_into().expect("4 bytes")))),
                10 => (8, |bytes| f64::from_le_bytes(bytes.try_into().expect("8 bytes"))),
                other => panic!("no type {other} is expected here"),
            };
            let values = points.iter().map(|point| value(&point.extra_bytes[at..at + size])).collect();
            extra.push((String::from_utf8(name.to_vec()).expect("UTF-8"), values));
            at += size;
        }
        Self { header, points, extra }
    }

    fn extra(&self, name: &str) -> &[f64] {
        let found = self.extra.iter().find(|(own, _)| own == name);
        &found
            .unwrap_or_else(|| {
                panic!("no {name} among {:?}", self.extra.iter().map(|(own, _)| own).collect::<Vec<_>>())
            })
            .1
    }

    fn wkt(&self) -> Option<String> {
        let vlr = self.header.all_vlrs().find(|vlr| vlr.user_id == "LASF_Projection" && vlr.record_id == 2112)?;
        Some(String::from_utf8(vlr.data.clone()).expect("UTF-8"))
    }
}

/// The columns of vertices and their types, as the crate `ply-rs-bw` has them.
fn read_ply(path: &Path) -> (BTreeMap<String, Vec<f64>>, String) {
    let bytes = std::fs::read(path).expect("a file");
    let end = bytes.windows(11).position(|window| window == b"end_header\n").expect("a header");
    let ply: Ply<DefaultElement> = Parser::new().read_ply(&mut std::io::Cursor::new(&bytes)).expect("a PLY file");
    let mut columns: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for row in &ply.payload["vertex"] {
        for (name, value) in row {
            let value = match value {
                Property::UChar(value) => f64::from(*value),
                Property::UShort(value) => f64::from(*value),
                Property::UInt(value) => f64::from(*value),
                Property::Int(value) => f64::from(*value),
                Property::Float(value) => f64::from(*value),
                Property::Double(value) => *value,
                other => panic!("{other:?}"),
            };
            columns.entry(name.to_string()).or_default().push(value);
        }
    }
    (columns, String::from_utf8_lossy(&bytes[..end]).into_owned())
}

#[test]
fn an_intensity_of_floats_fills_that_of_las_and_leaves_that_of_another_file_alone() {
    let folder = Folder::new();
    let float = "03_ply_float_intensity.ply";
    let Some(said) = export(&folder, &[float], "one.las") else { return };
    assert!(said.messages.contains("intensity: 0 to 1 became 0 to 65535 of intensity"), "{said}");
    let (source, _) = read_ply(&crate::folder().expect("there").join(float));
    let one = LasFile::read(&folder.path("one.las"));
    let scaled: Vec<u16> = source["intensity"].iter().map(|value| (value * 65535.0).round() as u16).collect();
    assert!(one.extra.is_empty() && one.points.iter().map(|point| point.intensity).eq(scaled.iter().copied()));
    export(&folder, &["03_las_u16_intensity.las", float], "both.laz");
    let both = LasFile::read(&folder.path("both.laz"));
    let found: Vec<u16> = both.points.iter().map(|point| point.intensity).collect();
    assert!(found[..2000].iter().copied().eq(0..2000), "the intensity of the LAS file");
    assert_eq!(found[2000..], scaled);
}

#[test]
fn whole_numbers_fill_the_classification() {
    let folder = Folder::new();
    let Some(_) = export(&folder, &["03_ply_int_classification.ply"], "a.las") else { return };
    let found = LasFile::read(&folder.path("a.las"));
    let classes = found.points.iter().map(|point| u8::from(point.classification));
    assert!(found.extra.is_empty() && classes.eq((0..2000).map(|index| (index % 6) as u8)));
    assert!(found.points.iter().map(|point| point.intensity).eq(0..2000));
}

#[test]
fn names_that_are_equal_in_32_bytes_become_different() {
    let folder = Folder::new();
    let Some(said) = export(&folder, &["03_ply_names_equal_in_32_characters.ply"], "a.las") else { return };
    let found = LasFile::read(&folder.path("a.las"));
    let names: Vec<&str> = found.extra.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["Roughness_radius_0.250000_m_a", "Roughness_radius_0.250000_m_b"]);
    assert!(said.messages.contains("became the extra dimension Roughness_radius_0.250000_m_b"), "{said}");
}

#[test]
fn newer_point_formats_say_their_system_as_wkt() {
    let folder = Folder::new();
    let Some(_) = export(&folder, &["06_las_pf1_geotiff_26910.las"], "a.copc.laz") else { return };
    let found = LasFile::read(&folder.path("a.copc.laz"));
    assert!(found.header.has_wkt_crs());
    let wkt = found.wkt().expect("a record of WKT");
    assert!(wkt.starts_with("COMPD_CS[\"NAD83 / UTM zone 10N + NAVD88 height\",PROJCS["), "{wkt}");
    let codes = ["26910", "5703"].map(|code| format!("AUTHORITY[\"EPSG\",\"{code}\"]"));
    assert!(codes.iter().all(|code| wkt.contains(code)), "{wkt}");
    let is_keys = |vlr: &las::Vlr| vlr.user_id == "LASF_Projection" && vlr.record_id != 2112;
    assert!(!found.header.all_vlrs().any(is_keys));
    // The old format keeps its records.
    export(&folder, &["06_las_pf1_geotiff_26910.las"], "a.laz");
    let found = LasFile::read(&folder.path("a.laz"));
    assert!(!found.header.has_wkt_crs() && found.wkt().is_none() && found.header.all_vlrs().any(is_keys));
    // No system is known, and the bit is set.
    let said = export(&folder, &["06_las_pf1_no_crs.las", "06_las_pf3_no_crs.las"], "b.laz").expect("there");
    let found = LasFile::read(&folder.path("b.laz"));
    assert!(found.header.has_wkt_crs() && found.points.len() == 10_000);
    assert!(
        said.messages.contains("has no colours: its points are black in the new file, where has_color is 0"),
        "{said}"
    );
    assert_eq!([found.extra("has_color")[0], found.extra("has_color")[9999]], [0.0, 1.0]);
    assert!(said.messages.contains("scan_angle: whole degrees became steps of 0.006 degrees"), "{said}");
}

#[test]
fn what_a_file_lacks_is_missing_beside_one_that_has_it() {
    let folder = Folder::new();
    let cases = ["07_ply_with_scalar_rgb_normals.ply", "07_ply_xyz_only.ply"];
    let Some(said) = export(&folder, &cases, "a.ply") else { return };
    assert!(said.messages.contains("has no scalar_C2M, nx, ny, nz: NaN in the new file"), "{said}");
    assert!(said.messages.contains("has no colours"), "{said}");
    let (found, _) = read_ply(&folder.path("a.ply"));
    for name in ["scalar_C2M", "nx", "nz"] {
        assert!(found[name][..1000].iter().all(|value| value.is_finite()), "{name}");
        assert!(found[name][1000..].iter().all(|value| value.is_nan()), "{name}");
    }
    assert_eq!((found["red"][0], found["has_color"][0], found["has_color"][1000]), (200.0, 1.0, 0.0));
    export(&folder, &cases, "a.las");
    let found = LasFile::read(&folder.path("a.las"));
    assert!(found.extra("scalar_C2M")[1000..].iter().chain(&found.extra("nz")[1000..]).all(|value| value.is_nan()));
    assert_eq!((found.extra("scalar_C2M")[0], found.extra("has_color")[1000]), (0.25, 0.0));
    export(&folder, &cases, "a.csv");
    let table = std::fs::read_to_string(folder.path("a.csv")).expect("a table");
    assert!(table.lines().nth(1001).expect("a row").ends_with(",,,,,,,"), "{:?}", table.lines().nth(1001));
}

#[test]
fn colours_of_two_depths_come_to_one_scale() {
    let folder = Folder::new();
    let cases = ["08_las_pf7_rgb8.las", "08_las_pf7_rgb16.las"];
    for name in ["a.las", "b.copc.laz", "c.csv"] {
        let Some(said) = export(&folder, &cases, name) else { return };
        assert!(said.messages.contains("0 to 65535"), "{said}");
    }
    let brightest = |points: &[Point]| points.iter().map(|point| point.color.expect("a colour").red).max();
    let found = LasFile::read(&folder.path("a.las"));
    assert_eq!(brightest(&found.points[..5000]), Some(254 * 257));
    assert_eq!(brightest(&found.points[5000..]), Some(65278));
    // Alone they stay as they are.
    export(&folder, &cases[..1], "alone.las");
    assert_eq!(brightest(&LasFile::read(&folder.path("alone.las")).points), Some(254));
}

#[test]
fn a_point_far_away_leaves_the_finest_steps_that_reach_it() {
    let folder = Folder::new();
    let case = "09_ply_utm_one_point_000.ply";
    let Some(said) = export(&folder, &[case], "a.las") else { return };
    assert!(said.messages.contains("coordinates are rounded to steps of"), "{said}");
    let (source, _) = read_ply(&crate::folder().expect("there").join(case));
    let found = LasFile::read(&folder.path("a.las"));
    let worst = |name: &str, of: fn(&Point) -> f64| {
        source[name].iter().zip(&found.points).map(|(value, point)| (value - of(point)).abs()).fold(0.0, f64::max)
    };
    let errors = [worst("x", |point| point.x), worst("y", |point| point.y), worst("z", |point| point.z)];
    assert!(errors[0] < 1e-4 && errors[1] < 7e-4 && errors[2] < 1e-6, "{errors:?}");
    for case in ["10_ply_5cm_object_at_half.ply", "10_ply_one_point.ply"] {
        let name = format!("{case}.laz");
        let said = export(&folder, &[case], &name).expect("there");
        assert!(!said.messages.contains("rounded"), "{said}");
        let (source, _) = read_ply(&crate::folder().expect("there").join(case));
        let found = LasFile::read(&folder.path(&name));
        assert!(source["x"].iter().zip(&found.points).all(|(value, point)| point.x as f32 == *value as f32), "{case}");
    }
}

#[test]
fn a_table_has_the_numbers_of_the_file_and_ply_types_that_readers_know() {
    let folder = Folder::new();
    let case = "12_las_pf7_random_16bit_rgb.las";
    let Some(_) = export(&folder, &[case], "a.csv") else { return };
    let table = std::fs::read_to_string(folder.path("a.csv")).expect("a table");
    let mut rows = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = rows.next().expect("names");
    let column = |name: &str| names.iter().position(|own| *own == name).expect("a column");
    let (source, _) = read_las(&crate::folder().expect("there").join(case));
    for (row, point) in rows.zip(&source) {
        let color = point.color.expect("a colour");
        let found = ["red", "green", "blue"].map(|name| row[column(name)].parse::<u16>().expect("a number"));
        assert_eq!(found, [color.red, color.green, color.blue]);
    }
    // Numbers of 64 bits lose digits as doubles, and that is said.
    let said = export(&folder, &[case], "a.ply").expect("there");
    assert!(said.messages.contains("u64: whole numbers beyond 2^53 lost digits as doubles"), "{said}");
    let said = export(&folder, &["12_las_pf4_wave_offsets_u64.las"], "b.ply").expect("there");
    assert!(!said.messages.contains("lost digits"), "{said}");
    let (found, header) = read_ply(&folder.path("b.ply"));
    assert!(header.contains("property double wavepacket_offset") && !header.contains("int64"), "{header}");
    assert!(found["wavepacket_offset"].iter().zip(0..).all(|(value, index)| *value == f64::from(60 + 120 * index)));
}

#[test]
fn an_output_may_have_a_long_name() {
    let folder = Folder::new();
    for ending in [".las", ".copc.laz", ".ply", ".csv"] {
        let name = format!("{}{ending}", "n".repeat(250 - ending.len()));
        let Some(_) = export(&folder, &["08_las_pf7_rgb16.las"], &name) else { return };
        assert!(folder.path(&name).exists());
    }
}

/// Opens files by laspy or plyfile, and fails where one does not open, has two dimensions of a name, or no points.
const PYTHON: &str = r#"
import sys, numpy
import laspy, plyfile
for path in sys.argv[1:]:
    if path.endswith('.ply'):
        names = [p.name for p in plyfile.PlyData.read(path)['vertex'].properties]
        points = len(plyfile.PlyData.read(path)['vertex'].data)
    else:
        cloud = laspy.read(path)
        names = list(cloud.point_format.dimension_names)
        points = len(cloud.points)
        for name in names:
            numpy.asarray(cloud[name])
        for axis in range(3):
            assert cloud.xyz[:, axis].min() >= cloud.header.mins[axis] - 1e-6, path
        if cloud.point_format.id >= 6:
            assert cloud.header.global_encoding.wkt, path
    assert points > 0 and len(set(name.lower() for name in names)) == len(names), (path, names)
print('opened', len(sys.argv) - 1)
"#;

#[test]
fn laspy_and_plyfile_open_what_is_written() {
    let python = std::env::var_os("GLINT_PYTHON").unwrap_or_else(|| "python3".into());
    let has = Command::new(&python).args(["-c", "import laspy, lazrs, plyfile"]).output();
    if !has.is_ok_and(|has| has.status.success()) {
        println!("skipped: no Python with laspy, lazrs and plyfile");
        return;
    }
    let folder = Folder::new();
    let sets: [&[&str]; 9] = [
        &["03_ply_float_intensity.ply"],
        &["03_las_u16_intensity.las", "03_ply_float_intensity.ply", "03_ply_int_classification.ply"],
        &["03_ply_names_equal_in_32_characters.ply"],
        &["06_las_pf1_no_crs.las", "06_las_pf3_no_crs.las"],
        &["07_ply_with_scalar_rgb_normals.ply", "07_ply_xyz_only.ply"],
        &["09_ply_utm_one_point_000.ply"],
        &["10_ply_one_point.ply"],
        &["12_las_pf7_random_16bit_rgb.las", "07_ply_xyz_only.ply"],
        &["12_las_pf4_wave_offsets_u64.las", "08_las_pf7_rgb8.las"],
    ];
    let mut written = Vec::new();
    for (number, set) in sets.iter().enumerate() {
        for ending in ["las", "copc.laz", "ply"] {
            let name = format!("{number}.{ending}");
            let Some(_) = export(&folder, set, &name) else { return };
            written.push(folder.path(&name));
        }
    }
    let output = Command::new(&python).args(["-c", PYTHON]).args(&written).output().expect("Python starts");
    let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(said.trim().ends_with(&format!("opened {}", written.len())), "{said}");
}
