//! Reads PTS, PTX, tables and PCD: those of the test data, and files that these tests write.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;
mod scans;

use std::path::PathBuf;

use codec::{Format, Source};
use glam::DVec3;
use scans::{MEMORY, read, scans};

fn places(source: &Source) -> Vec<DVec3> {
    scans::places(&read(source).0)
}

fn colors(source: &Source) -> Vec<[u8; 3]> {
    let all = read(source).0;
    let all = all.iter().flat_map(|chunk| chunk.colors.clone().unwrap().to_vec());
    all.map(|[red, green, blue, _]| [red, green, blue]).collect()
}

fn values(source: &Source, name: &str) -> Vec<f64> {
    scans::values(source, &read(source).0, name)
}

fn names(source: &Source) -> String {
    let names: Vec<&str> = source.info().properties.iter().map(|property| property.name.as_str()).collect();
    names.join(" ")
}

fn data(name: &str) -> Option<PathBuf> {
    Some(real_data::test_data()?.join("text").join(name))
}

/// Opens a text, and drops it from the disk when the sources are dropped.
fn open(text: impl AsRef<[u8]>) -> codec::Result<Vec<Source>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloud.txt");
    std::fs::write(&path, text).unwrap();
    codec::open_scans(&path, MEMORY)
}

fn error(text: impl AsRef<[u8]>) -> String {
    open(text).err().unwrap().to_string()
}

#[test]
fn texts_of_the_test_data_are_as_the_manifest_says() {
    let known: [(&str, Format, u64, &str); 10] = [
        ("autzen.pts", Format::Pts, 10, "x y z intensity red green blue"),
        ("test.pts", Format::Pts, 19, "x y z intensity red green blue"),
        ("1.2-with-color.ptx", Format::Ptx, 1065, "x y z intensity red green blue row_index column_index"),
        ("complex-transform.ptx", Format::Ptx, 12, "x y z intensity red green blue row_index column_index"),
        ("utm17_space.pcd", Format::Pcd, 10, "x y z"),
        (
            "autzen-utm.pcd",
            Format::Pcd,
            1065,
            "x y z Intensity ReturnNumber NumberOfReturns ScanDirectionFlag EdgeOfFlightLine Classification ScanAngleRank \
             UserData PointSourceId GpsTime Red Green Blue",
        ),
        ("utm17_1.txt", Format::Xyz, 10, "x y z"),
        ("quoted.txt", Format::Xyz, 9, "x y z"),
        ("numeric_dim.txt", Format::Xyz, 5, "x y z Eigenvalue0"),
        ("crlf_test.txt", Format::Xyz, 10, "x y z intensity"),
    ];
    for (name, format, points, properties) in known {
        let Some(path) = data(name) else { return };
        let source = scans(&path).remove(0);
        let (info, summary) = (source.info(), read(&source).1);
        assert_eq!((info.format, info.points, summary.points), (format, points, points), "{name}");
        assert_eq!(names(&source), properties, "{name}");
        // Its points are at coordinates of the world, and its scanner at none.
        let warnings = usize::from(name == "1.2-with-color.ptx");
        assert_eq!(info.warnings.len(), warnings, "{name}: {:?}", info.warnings);
        assert_eq!(summary.warnings.len(), usize::from(name == "complex-transform.ptx"), "{name}: {summary:?}");
    }
    let refused = codec::open(&data("badheader.txt").unwrap()).err().unwrap().to_string();
    assert!(refused.contains("the columns x, y, x have x twice; --columns names them"), "{refused}");
    assert!(codec::open(&data("wrench.vpc").unwrap()).is_err());
}

#[test]
fn values_of_the_test_data_are_those_of_the_text() {
    let Some(pts) = data("autzen.pts") else { return };
    let pts = scans(&pts).remove(0);
    assert!((places(&pts)[0] - DVec3::new(636_110.300_003, 849_345.050_003, 512.139_999)).length() < 1e-4);
    assert_eq!((colors(&pts)[2], values(&pts, "intensity")[0]), ([120, 127, 103], -1613.0));

    let table = scans(&data("crlf_test.txt").unwrap()).remove(0);
    assert_eq!(values(&table, "intensity"), (0..10).map(f64::from).collect::<Vec<_>>());
    assert!((places(&table)[9] - DVec3::new(289_818.50, 4_320_980.59, 170.58)).length() < 1e-6);

    // The transformation of the text, by hand: a row times a matrix.
    let turned = scans(&data("complex-transform.ptx").unwrap()).remove(0);
    let places_of = places(&turned);
    let shown: Vec<usize> = (0..12).filter(|at| places_of[*at].is_finite()).collect();
    assert_eq!(shown, [4, 5, 6, 7]);
    let own = [-0.005_630, 0.645_218, -0.440_506, 1.0];
    let matrix = [
        [0.999_979, -0.003_604, -0.005_365],
        [0.003_613, 0.999_992, 0.001_630],
        [0.005_359, -0.001_650, 0.999_984],
        [-3.028_748, -3.819_741, -1.384_333],
    ];
    let expected: [f64; 3] = std::array::from_fn(|axis| (0..4).map(|row| own[row] * matrix[row][axis]).sum());
    assert!((places_of[4] - DVec3::from(expected)).length() < 1e-9, "{} {expected:?}", places_of[4]);
    assert_eq!(turned.info().scan.clone().unwrap().position, Some(DVec3::new(-3.028_748, -3.819_741, -1.384_333)));
    // Two columns of six rows.
    assert_eq!(values(&turned, "row_index")[4..8], [4.0, 5.0, 0.0, 1.0]);
    assert_eq!(values(&turned, "column_index")[4..8], [0.0, 0.0, 1.0, 1.0]);
    assert!(read(&turned).1.warnings[0].starts_with("8 of 12 points are empty cells of the scanner's grid"));

    let packed = scans(&data("autzen-utm.pcd").unwrap()).remove(0);
    let plain = scans(&data("utm17_space.pcd").unwrap()).remove(0);
    assert!(packed.info().has_colors && places(&packed).iter().all(|place| place.is_finite()));
    assert!((places(&plain)[0] - DVec3::new(289_814.15, 4_320_978.61, 170.76)).length() < 0.5, "of floats");
}

#[test]
fn several_scans_in_one_text_are_clouds_of_their_own() {
    let scan = |x: i32| {
        format!("1\n2\n{x} 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{x} 0 0 1\n1 0 0 0.5\n0 2 0 0.25\n")
    };
    let all = open(scan(10) + &scan(20)).unwrap();
    let first: Vec<DVec3> = all.iter().map(|source| places(source)[0]).collect();
    assert_eq!(first, [DVec3::new(11.0, 0.0, 0.0), DVec3::new(21.0, 0.0, 0.0)]);
    let positions: Vec<_> = all.iter().map(|source| source.info().scan.clone().unwrap().position.unwrap().x).collect();
    assert_eq!(positions, [10.0, 20.0]);
    assert_eq!(all[1].info().name(), "cloud.txt, scan 2");
    let all = open("2\n1 2 3\n4 5 6\n1\n7 8 9 10 20 30\n").unwrap();
    assert_eq!(all.iter().map(|source| source.info().points).collect::<Vec<_>>(), [2, 1]);
    assert_eq!(colors(&all[1]), [[10, 20, 30]]);
}

#[test]
fn points_behind_the_count_of_a_pts_file_are_left_out_and_counted() {
    let first = "2\n1 2 3 10\n4 5 6 20\n7 8 9 30\n\n1 1 1 40\n";
    for (text, points, warned) in
        [(first.to_owned(), vec![2], vec![true]), (format!("{first}1\n9 9 9 50\n"), vec![2, 1], vec![true, false])]
    {
        let all = open(text).unwrap();
        assert_eq!(all.iter().map(|scan| scan.info().points).collect::<Vec<_>>(), points);
        assert_eq!(all.iter().map(|scan| scan.info().missing).collect::<Vec<_>>(), vec![0; points.len()]);
        let warnings = all.iter().map(|scan| scan.info().warnings.concat());
        let expected = warned.iter().map(|is| if *is { "2 points behind the 2 of its count are left out" } else { "" });
        assert_eq!(warnings.collect::<Vec<_>>(), expected.collect::<Vec<_>>());
        assert_eq!(values(&all[0], "intensity"), [10.0, 20.0]);
    }
    assert!(error("1\n1 2 3\na word\n").contains("`a word`, expected the number of points"));
}

#[test]
fn columns_are_told_by_names_separators_and_values() {
    let cases: [(&str, &str, [f64; 3]); 18] = [
        ("1 2 3\n4 5 6\n", "x y z", [1.0, 2.0, 3.0]),
        ("1.5;2;3\n4;5;6\n", "x y z", [1.5, 2.0, 3.0]),
        ("1,5;2,5;3\n4;5;6\n", "x y z", [1.5, 2.5, 3.0]),
        ("1,5 2,5 3,25\n4,0 5,0 6,0\n", "x y z", [1.5, 2.5, 3.25]),
        ("1,2,3,0.5\n4,5,6,0.25\n", "x y z intensity", [1.0, 2.0, 3.0]),
        ("1\t2\t3\t255\t0\t9\n4\t5\t6\t1\t2\t3", "x y z red green blue", [1.0, 2.0, 3.0]),
        ("1 2 3 0.1 0.5 1\n4 5 6 0 0.25 1\n", "x y z red green blue", [1.0, 2.0, 3.0]),
        ("1 2 3 0 0.6 0.8\n4 5 6 0 -1 0\n", "x y z nx ny nz", [1.0, 2.0, 3.0]),
        ("1 2 3 -700 1 2 3\n4 5 6 -800 255 0 0\n", "x y z intensity red green blue", [1.0, 2.0, 3.0]),
        ("//X Y Z R G B Deviation\n1 2 3 4 5 6 0.5\n", "x y z red green blue Deviation", [1.0, 2.0, 3.0]),
        ("# a comment\n# y x z\n2 1 3\n", "y x z", [1.0, 2.0, 3.0]),
        ("Easting [m];Northing [m];Height [m];Class\n1,5;2;3;7\n", "x y z Class", [1.5, 2.0, 3.0]),
        ("\u{feff}x,y,z\r\n1,2,3\r\n", "x y z", [1.0, 2.0, 3.0]),
        ("x,y,z,nan,inf,Infinity\n1,2,3,nan,5,6\n", "x y z nan inf Infinity", [1.0, 2.0, 3.0]),
        ("# x y z\n# nodata = nan\n1 2 3\n", "x y z", [1.0, 2.0, 3.0]),
        ("# z y x\n# nodata = nan\n1 2 3\n", "z y x", [3.0, 2.0, 1.0]),
        ("# missing values are NaN\n1 2 3 0.5\n4 5 6 0.25\n", "x y z intensity", [1.0, 2.0, 3.0]),
        ("x,y,z,i\nNaN,NaN,NaN,NA\n1,2,3,4\n", "x y z intensity", [1.0, 2.0, 3.0]),
    ];
    for (text, expected, first) in cases {
        let source = open(text).unwrap_or_else(|error| panic!("{text}: {error}")).remove(0);
        assert_eq!(names(&source), expected, "{text}");
        assert_eq!(places(&source)[0], DVec3::from(first), "{text}");
        assert!(source.info().warnings.is_empty(), "{text}: {:?}", source.info().warnings);
    }
    let shares = open("1 2 3 0.1 0.5 1\n4 5 6 0 0.25 1\n").unwrap().remove(0);
    assert_eq!(colors(&shares)[0], [26, 128, 255]);
    let unsure = open("1 2 3 4 5\n4 5 6 7 8\n").unwrap().remove(0);
    let warning = &unsure.info().warnings[0];
    assert!(warning.contains("taken for x,y,z,column_4,column_5; --columns names others"), "{warning}");
    // An empty cell between tabs stays one.
    let tabs = "X\tY\tZ\tIntensity\tClass\n1\t2\t3\t\t7\n4\t5\t6\t8\t9\n";
    let tabs = open(tabs).unwrap().remove(0);
    assert_eq!((names(&tabs).as_str(), values(&tabs, "Class")), ("x y z intensity Class", vec![7.0, 9.0]));
    assert!(values(&tabs, "intensity")[0].is_nan() && values(&tabs, "intensity")[1] == 8.0);
    let edges = open("Class\tX\tY\tZ\tI\n\t1\t2\t3\t\n7\t4\t5\t6\t8\n").unwrap().remove(0);
    assert_eq!((places(&edges)[0], values(&edges, "Class")[1]), (DVec3::new(1.0, 2.0, 3.0), 7.0));
    assert!(values(&edges, "Class")[0].is_nan() && values(&edges, "intensity")[0].is_nan());
    // Columns may be aligned by several tabs, and commas may stand before them.
    for aligned in ["1.5\t\t2.5\t\t3.5\n4\t\t5\t\t6\n", "1.5,\t2.5,\t3.5\n4,\t5,\t6\n"] {
        let aligned = open(aligned).unwrap().remove(0);
        assert_eq!((names(&aligned).as_str(), places(&aligned)[0]), ("x y z", DVec3::new(1.5, 2.5, 3.5)));
    }
    // Times are no intensities, and intensities of many digits are kept.
    let timed = open("1 2 3 1600000001\n4 5 7 1600000002\n").unwrap().remove(0);
    assert_eq!((names(&timed).as_str(), values(&timed, "column_4")[1]), ("x y z column_4", 1_600_000_002.0));
    assert!(timed.info().warnings[0].contains("taken for x,y,z,column_4"), "{:?}", timed.info().warnings);
    let fine = open("x,y,z,intensity\n1,2,3,1600000001.25\n4,5,6,0.1\n").unwrap().remove(0);
    assert_eq!(values(&fine, "intensity"), [1_600_000_001.25, 0.1]);
    // A first column that counts is no coordinate, unless the lines are those of a grid.
    let counted = "1 482002.6 5462003.8 101.9 7 5\n2 482003.1 5462003.7 101.7 8 5\n3 482003.5 5462003.9 101.8 9 5\n";
    let counted = open(counted).unwrap().remove(0);
    assert_eq!((names(&counted).as_str(), places(&counted)[1].x), ("number x y z column_5 column_6", 482_003.1));
    let warning = &counted.info().warnings[0];
    assert!(warning.contains("taken for number,x,y,z,column_5,column_6; --columns names others"), "{warning}");
    let grid = open("1 5 9.5 3\n2 5 9.4 4\n3 5 9.7 3\n4 5 9.6 1\n").unwrap().remove(0);
    assert_eq!((names(&grid).as_str(), places(&grid)[3].x), ("x y z intensity", 4.0));
}

#[test]
fn the_last_line_counts_without_an_end_and_odd_lines_are_counted() {
    let source = open("x y z\n1 2 3\n4 five 6\n7 8\n9 9 9").unwrap().remove(0);
    let (_, summary) = read(&source);
    assert_eq!(source.info().points, 4);
    assert!(summary.warnings[0].starts_with("2 of 4 points have text that is not a number"), "{summary:?}");
    let record = source.record(3).unwrap();
    assert_eq!(record[2], ("z".to_owned(), "9".to_owned()));
}

#[test]
fn comments_among_the_lines_of_a_table_are_no_points() {
    for (text, columns) in [
        ("x,y,z\n1,2,3\n# a pause of the scanner\n  // 4,5,6\n7,8,9\n%\n! the end", "x y z"),
        ("1 2 3\n# a pause\n7 8 9\n", "x y z"),
        ("1;2;3;5\n//\n7;8;9;6\n", "x y z intensity"),
        ("1\t2\t3\t5\n#\n7\t8\t9\t6", "x y z intensity"),
        ("# a comment\r\n# x y z\r\n1 2 3\r\n# another\r\n7 8 9\r\n", "x y z"),
    ] {
        let source = open(text).unwrap_or_else(|error| panic!("{text}: {error}")).remove(0);
        assert_eq!((names(&source).as_str(), source.info().points), (columns, 2), "{text}");
        assert_eq!(places(&source), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(7.0, 8.0, 9.0)], "{text}");
        assert!(read(&source).1.warnings.is_empty(), "{text}: {:?}", read(&source).1.warnings);
        assert_eq!(source.record(1).unwrap()[0], ("x".to_owned(), "7".to_owned()));
    }
    // Comments between blocks, and so many that the points of a block are few.
    let line = |at: usize| match at % 3 {
        0 => format!("# line {at}, {at}, {at}\n"),
        _ => format!("{at},{},0\n", at % 7),
    };
    let source = open("x,y,z\n".to_owned() + &(0..300_000).map(line).collect::<String>()).unwrap().remove(0);
    assert_eq!(source.info().points, 200_000);
    assert!((0..300_000).filter(|at| at % 3 > 0).eq(places(&source).iter().map(|place| place.x as usize)));
    // Points whose names look like comments are points.
    let named = unnamed("#1 1 2 3\n#2 4 5 6\n").unwrap();
    assert_eq!((named.names.join(",").as_str(), named.lines.len()), ("skip,y,z,intensity", 2));
}

#[test]
fn long_tables_are_read_in_blocks_and_in_the_order_of_their_lines() {
    let count = 300_000;
    let text: String = (0..count).map(|at| format!("{at},{},{}\n", at * 2, at % 7)).collect();
    let source = open(format!("x,y,z\n{text}")).unwrap().remove(0);
    let all = places(&source);
    assert_eq!(all.len(), count);
    assert!((0..count).all(|at| all[at] == DVec3::new(at as f64, (at * 2) as f64, (at % 7) as f64)));
    assert_eq!(source.record(200_000).unwrap()[0].1, "200000");
}

fn pcd(data: &str, points: usize) -> String {
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb label\nSIZE 4 4 4 4 2\nTYPE F F F F U\n\
         COUNT 1 1 1 1 1\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    )
}

/// Ten points of a PCD file by their values: place, colour, label.
fn point(at: u32) -> ([f32; 3], u32, u16) {
    ([at as f32, 0.5, -2.0], 0x0010_2000 + at, 40_000 + at as u16)
}

#[test]
fn the_three_kinds_of_pcd_are_read_alike() {
    let count = 10;
    let mut binary = pcd("binary", 10).into_bytes();
    let mut columns = vec![Vec::new(); 5];
    let mut text = pcd("ascii", 10);
    for ([x, y, z], color, label) in (0..count).map(point) {
        let values = [x.to_le_bytes(), y.to_le_bytes(), z.to_le_bytes(), color.to_le_bytes()];
        values.iter().for_each(|value| binary.extend(value));
        binary.extend(label.to_le_bytes());
        std::iter::zip(&mut columns, values).for_each(|(column, value)| column.extend(value));
        columns[4].extend(label.to_le_bytes());
        text += &format!("{x} {y} {z} {} {label}\n", f32::from_bits(color));
    }
    let whole = columns.concat();
    let mut packed = Vec::new();
    for run in whole.chunks(32) {
        packed.push(run.len() as u8 - 1);
        packed.extend(run);
    }
    let mut compressed = pcd("binary_compressed", 10).into_bytes();
    compressed.extend((packed.len() as u32).to_le_bytes());
    compressed.extend((whole.len() as u32).to_le_bytes());
    compressed.extend(&packed);
    for (kind, bytes) in [("ascii", text.into_bytes()), ("binary", binary), ("compressed", compressed)] {
        let source = open(bytes).unwrap_or_else(|error| panic!("{kind}: {error}")).remove(0);
        assert_eq!(names(&source), "x y z red green blue label", "{kind}");
        let last = count as usize - 1;
        assert_eq!(
            (places(&source)[last], colors(&source)[last]),
            (DVec3::new(9.0, 0.5, -2.0), [0x10, 0x20, 9]),
            "{kind}"
        );
        assert_eq!(values(&source, "label")[last], 40_009.0, "{kind}");
        assert_eq!(source.info().scan.clone().unwrap().position, Some(DVec3::new(1.0, 2.0, 3.0)), "{kind}");
    }
}

#[test]
fn further_columns_and_fields_of_a_name_are_read_under_names_of_their_own() {
    let source = open("x,y,z,a,a,r,g,b,a_2,red\n1,2,3,4,5,6,7,8,9,10\n").unwrap().remove(0);
    assert_eq!(names(&source), "x y z a a_3 red green blue a_2 red_2");
    assert_eq!(["a", "a_3", "a_2", "red_2"].map(|name| values(&source, name)[0]), [4.0, 5.0, 9.0, 10.0]);
    assert_eq!(colors(&source), [[6, 7, 8]]);
    let told = ["a further column a is called a_3 here", "a further column red is called red_2 here"];
    assert_eq!(source.info().warnings, told);
    // Columns that are left out need no names.
    let source = open("skip,x,y,z,skip\n0,1,2,3,0\n").unwrap().remove(0);
    assert!(names(&source) == "x y z" && source.info().warnings.is_empty());

    let fields = "FIELDS x y z a a X\nSIZE 4 4 4 1 1 4\nTYPE F F F U U F\nCOUNT 1 1 1 1 1 1\n";
    let head = format!("VERSION 0.7\n{fields}WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA");
    let mut binary = format!("{head} binary\n").into_bytes();
    [1.0_f32, 2.0, 3.0].iter().for_each(|value| binary.extend(value.to_le_bytes()));
    binary.extend([4, 5]);
    binary.extend(6.0_f32.to_le_bytes());
    for bytes in [format!("{head} ascii\n1 2 3 4 5 6\n").into_bytes(), binary] {
        let source = open(bytes).unwrap().remove(0);
        assert_eq!(names(&source), "x y z a a_2 x_2");
        assert_eq!((places(&source), values(&source, "a")), (vec![DVec3::new(1.0, 2.0, 3.0)], vec![4.0]));
        assert_eq!((values(&source, "a_2"), values(&source, "x_2")), (vec![5.0], vec![6.0]));
        let told = ["a further field a is called a_2 here", "a further field x is called x_2 here"];
        assert_eq!(source.info().warnings, told);
    }
}

#[test]
fn hostile_texts_end_in_an_error_that_says_what_is_wrong() {
    let grid = "1 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    let ptx = |size: &str| format!("{size}\n{grid}1 1 1\n");
    assert!(error(ptx("18446744073709551615\n2")).contains("a grid of 18446744073709551615 columns and 2 rows"));
    let claimed = open(ptx("1000000000\n1000000000")).unwrap().remove(0);
    assert!(
        claimed.info().points == 1 && claimed.info().warnings[0].contains("cells are missing"),
        "{:?}",
        claimed.info()
    );
    let claimed = open("18446744073709551615\n1 2 3\n").unwrap().remove(0);
    assert!(claimed.info().points == 1 && claimed.info().warnings[0].contains("points are missing"));
    assert!(error("2\n1 2 3 4 5\n1 2 3 4 5\n").contains("5 numbers of a point, expected 3, 4, 6 or 7"));
    assert!(error("0\n1 2 3\n".to_owned() + &"0\n".repeat(20_000)).contains("expected the number of points"));
    assert!(error("1\n1 2 3\n".to_owned() + &"0\n".repeat(20_000)).contains("more than 10000 of them"));
    assert!(error("one two three\n1 2 3 4\n").contains("does not name the 4 columns of the lines below it"));
    assert!(error("a text of no numbers\n").contains("not a file of a known format"));

    let head = |line: &str, other: &str| pcd("binary", 10).replace(line, other);
    assert!(error(head("DATA binary", "DATA zipped")).contains("none of ascii, binary and binary_compressed"));
    assert!(error(head("COUNT 1 1 1 1 1", "COUNT 1 1 1 1 99999999")).contains("COUNT of label is `99999999`"));
    assert!(error(head("COUNT 1 1 1 1 1", "COUNT 0 0 0 0 0")).contains("points without numbers"));
    assert!(error(head("TYPE F F F F U", "TYPE F F F F X")).contains("label is of type X and size 2"));
    assert!(error(head("FIELDS x y z rgb label", "FIELDS x y rgb label")).contains("expected as many of each"));
    assert!(error(head("FIELDS x y z", "FIELDS x y w")).contains("no columns x, y and z"));
    let cut = open(head("POINTS 10", "POINTS 18446744073709551615")).unwrap().remove(0);
    assert!(
        cut.info().points == 0 && cut.info().warnings[0].contains("points are missing"),
        "{:?}",
        cut.info().warnings
    );
    let packed = |points: u64, sizes: [u32; 2], bytes: &[u8]| {
        let mut file = pcd("binary_compressed", 1).replace("POINTS 1", &format!("POINTS {points}")).into_bytes();
        sizes.iter().for_each(|size| file.extend(size.to_le_bytes()));
        file.extend(bytes);
        error(file)
    };
    assert!(packed(1, [9, 4_000_000_000], &[]).contains("4000000000 bytes, expected 18 for 1 points"));
    assert!(packed(200_000_000, [9, 3_600_000_000], &[0; 9]).contains("less than LZF can take"));
    assert!(packed(1, [9, 18], &[255; 9]).contains("reaches to before the points"));
    assert!(packed(1, [9, 18], &[5, 1]).contains("compressed points"));
}

/// What is said of the columns of a text that nothing names.
fn unnamed(text: impl AsRef<[u8]>) -> Option<codec::UnnamedTable> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloud.txt");
    std::fs::write(&path, text).unwrap();
    codec::unnamed_table(&path)
}

#[test]
fn tables_whose_columns_no_line_names_are_found_with_a_guess_and_its_reason() {
    let long = "1.5 2 3 0.1 7 9 9\n".repeat(100_000);
    let cases = [
        ("1 2 3\n4 5 6\n", "x,y,z", "No line names the columns. Taken for a place by the order"),
        ("1;2;3;0,5\n4;5;6;0,25\n", "x,y,z,intensity", "Taken for a place and an intensity"),
        ("# a comment\n1 2 3 255 0 9\n4 5 6 1 2 3\n", "x,y,z,red,green,blue", "whole numbers from 0 to 255"),
        ("1 2 3 0 0.6 0.8\n4 5 6 0 -1 0\n", "x,y,z,nx,ny,nz", "have the length 1"),
        (&long, "x,y,z,intensity,red,green,blue", "an intensity beside it"),
        ("1 2 3 4.5 7.5\n", "x,y,z,column_4,column_5", "the values of the others say nothing"),
        // What cannot be opened without an answer.
        ("one two three\n1 2 3 4\n", "x,y,z,intensity", "`one two three` does not name the 4 columns"),
        ("id,a,b,c\n1,2,3,4\n", "id,a,blue,c", "the columns id, a, blue, c have no x"),
        ("1 2 3 tree\n4 5 6 wall\n", "x,y,z,skip", "texts are left out"),
    ];
    for (text, names, by) in cases {
        let table = unnamed(text).unwrap_or_else(|| panic!("{names}: nothing is asked"));
        assert_eq!(table.names.join(","), names);
        assert!(table.by.contains(by), "{names}: {}", table.by);
        assert!(table.lines.len() <= 8 && table.lines.iter().all(|line| line.len() == table.names.len()));
    }
    // What a line names, but coordinates that contradict each other, and names that are guessed for such.
    let refused = unnamed("X;Y;Z;Ost;Nord\n8.780;8.843;336,563;8780,5;8843,5\n").unwrap();
    assert_eq!(refused.names, ["x", "y", "z", "Ost", "Nord"]);
    assert!(refused.by.starts_with("`8.780` in line 2 has a point, `336,563` in line 2 a comma"), "{}", refused.by);
    let refused = unnamed("1.001 8780,171 8843,482 336,563\n1.002 8780,172 8843,482 336,563\n").unwrap();
    assert!(refused.by.starts_with("`1.001` in line 1 has a point, `8780,171` in line 1 a comma"), "{}", refused.by);
    assert_eq!(unnamed("1;2;3;0,5\n4;5;6;0,25\n").unwrap().lines, [["1", "2", "3", "0,5"], ["4", "5", "6", "0,25"]]);
    let certain = [
        "x y z\n1 2 3\n",
        "Easting [m];Northing [m];Height [m];Class\n1,5;2;3;7\n",
        // PTS, PTX, PLY and what is no table.
        "2\n1 2 3\n4 5 6\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n",
        "a text with 1, 2 and 3 in it\nand another line\n",
        "",
        "1 2 3\0",
    ];
    for text in certain {
        assert_eq!(unnamed(text), None, "{text}");
    }
    let pose = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    assert_eq!(unnamed(format!("1\n2\n{pose}1 2 3 0.5\n4 5 6 0.5\n")), None);
    assert_eq!(codec::unnamed_table(&PathBuf::from("/nothing/is/here.xyz")), None);
    assert_eq!(codec::unnamed_table(&PathBuf::from("https://127.0.0.1:1/a.xyz")), None);
}

#[test]
fn columns_that_are_named_for_a_file_are_those_of_this_file_alone() {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["a.xyz", "b.xyz"].map(|name| folder.path().join(name));
    paths.iter().for_each(|path| std::fs::write(path, "1 2 3 4\n5 6 7 8\n").unwrap());
    let words = |text: &str| text.split(',').map(str::to_owned).collect::<Vec<_>>();
    codec::name_columns_of(&paths[0], &words("X,skip,z,y")).unwrap();
    let [first, second] = paths.each_ref().map(|path| codec::open(path).unwrap());
    assert_eq!((names(&first).as_str(), names(&second).as_str()), ("x z y", "x y z intensity"));
    assert_eq!((first.info().version.as_str(), places(&first)[0]), ("x,skip,z,y", DVec3::new(1.0, 4.0, 3.0)));
    assert_eq!(codec::unnamed_table(&paths[0]), None, "a person has named them");
    assert!(codec::unnamed_table(&paths[1]).is_some());
    for (text, problem) in [("x,y,q", "no column z"), ("x,y,z,i,i", "the column intensity is named twice")] {
        assert!(codec::name_columns_of(&paths[1], &words(text)).unwrap_err().contains(problem), "{text}");
    }
}

#[test]
fn a_point_beside_a_comma_is_never_taken_for_decimals_where_it_may_set_thousands_apart() {
    let refused = [
        (
            "X;Y;Z\r\n8.780;8.843;336,563\r\n4.424;8.506;339,960\r\n",
            "`8.780` in line 2 has a point, `336,563` in line 2",
        ),
        ("X;Y;Z\n8,780;8,843;336.563\n4,424;8,506;339.960\n", "`336.563` in line 2 has a point, `8,780` in line 2"),
        ("X;Y;Z\n8,780;8,843;36.5\n", "`36.5` in line 2 has a point, `8,780` in line 2"),
        (
            "# a table\n\nx\ty\tz\n780,5\t843,25\t336,5\n-8.780\t843,25\t336,5\n",
            "`-8.780` in line 5 has a point, `780,5` in line 4",
        ),
        ("780,5 843,25 336,5\n+8.780 843,25 336,5\n", "`+8.780` in line 2 has a point, `780,5` in line 1"),
    ];
    for (text, told) in refused {
        let error = error(text);
        let end = "a comma, and one of them may set thousands apart; write numbers without separators of thousands, or \
                   leave out a column that is no coordinate: --columns skip,x,y,z";
        assert!(error.contains(told) && error.ends_with(end), "{text}: {error}");
    }
    // Times of another program may have points beside coordinates with commas, and dates and texts are no numbers.
    let times = open("x;y;z;time\n8780,171;8843,482;336,563;1600000001.25\n").unwrap().remove(0);
    assert_eq!((places(&times)[0].z, values(&times, "time")[0]), (336.563, 1_600_000_001.25));
    let told = "`1600000001.25` in line 2 has a point, `8780,171` in line 2 a comma; both are taken for decimals";
    assert_eq!(times.info().warnings, [told]);
    // Where coordinates agree with each other, an attribute that may have thousands is a doubt and no more.
    for (text, place, (name, value), told) in [
        (
            "Punkt;X;Y;Z\n1.001;8780,171;8843,482;336,563\n",
            [8780.171, 8843.482, 336.563],
            ("Punkt", 1.001),
            "`1.001` in line 2 has a point, `8780,171`",
        ),
        (
            "id\tx\ty\tz\n1,000\t8780.5\t8843.25\t336.5\n",
            [8780.5, 8843.25, 336.5],
            ("id", 1.0),
            "`8780.5` in line 2 has a point, `1,000`",
        ),
        (
            "x;y;z;t\n512,250;843,500;336,563;1.5E-5\n",
            [512.25, 843.5, 336.563],
            ("t", 1.5e-5),
            "`1.5E-5` in line 2 has a point, `512,250`",
        ),
    ] {
        let source = open(text).unwrap().remove(0);
        assert_eq!((places(&source)[0], values(&source, name)[0]), (DVec3::from(place), value), "{text}");
        let doubt =
            " in line 2 a comma; both are taken for decimals, but one of them may set thousands apart; write numbers";
        let warnings = &source.info().warnings;
        assert!(warnings.len() == 1 && warnings[0].starts_with(&format!("{told}{doubt}")), "{text}: {warnings:?}");
        assert_eq!(unnamed(text), None, "{text}");
    }
    for text in [
        "Datum;X;Y;Z\n30.11.2026;8780,171;8843,482;336,563\n",
        "skip;X;Y;Z\n8.780;8780,171;8843,482;336,563\n",
        "X;Y;Z\n8780,171;8843,482;336,563\n",
        "X;Y;Z\n8780.171;8843.482;336.563\n",
    ] {
        let source = open(text).unwrap().remove(0);
        assert_eq!(places(&source), [DVec3::new(8780.171, 8843.482, 336.563)], "{text}");
        assert!(source.info().warnings.is_empty(), "{text}: {:?}", source.info().warnings);
    }
}

#[test]
fn a_number_that_may_have_thousands_in_the_middle_of_a_table_is_missing_and_told() {
    // Blank lines and comments are no lines of points.
    let lines = |line: &str, count: usize| "x;y;z;a\n\n# a comment\n".to_owned() + &line.repeat(count);
    let cases = [
        ("512,25;843,5;336,563;0,5\n", "8.780;843,5;336,563;0,5\n", "`8.780`", "`512,25`", 0),
        ("8,512;8,843;336;7,125\n", "8,780;8,843;336.5;7,125\n", "`336.5`", "`8,512`", 2),
        ("512,25;843,5;336,563;0,5\n", "512,25;843,5;336,563;1.001\n", "`1.001`", "`512,25`", 3),
    ];
    for (before, odd, number, example, column) in cases {
        // At the end of a short and a long table, and in each block of one.
        for (count, times) in [(600, 1), (200_000, 1), (1_000, 200)] {
            let text = lines(before, count) + &(odd.to_owned() + &before.repeat(1_000)).repeat(times);
            let source = open(text).unwrap().remove(0);
            let all = count + 1_001 * times;
            assert_eq!((source.info().points, source.info().warnings.len()), (all as u64, 0));
            let (chunks, summary) = read(&source);
            let told = summary.warnings.concat();
            assert!(told.starts_with(&format!("{times} of {all} points have text that is not a number")), "{told}");
            let expected = format!(
                "and points without a place are left out; {number} in line {} of the points is taken for no number, since it \
                 has a point, and numbers before it a comma, like {example}; write numbers without separators",
                count + 1
            );
            assert!(told.contains(&expected), "{told}");
            let places = scans::places(&chunks);
            let first = places[0];
            for (at, place) in places.iter().enumerate() {
                let is_odd = at >= count && (at - count) % 1_001 == 0;
                assert!(if is_odd && column < 3 { !place.is_finite() } else { (*place - first).length() < 1e-3 });
            }
            let missing = scans::values(&source, &chunks, "a").iter().filter(|value| value.is_nan()).count();
            assert_eq!(missing, if column == 3 { times } else { 0 });
        }
    }
    // Attributes may go on as they began, and coordinates may not begin to differ from each other.
    for (line, odd, told) in [
        (
            "8780,5;843,5;336,563;1.001\n",
            "8.780;843,5;336,563;1.002\n",
            "a point, and numbers before it a comma, like `8780,5`",
        ),
        (
            "8780.5;843.5;336.563;1,001\n",
            "8,780;843.5;336.563;1,002\n",
            "a comma, and numbers before it a point, like `8780.5`",
        ),
    ] {
        let source = open(lines(line, 600) + odd + line).unwrap().remove(0);
        assert!(source.info().warnings.concat().contains("both are taken for decimals, but one of them"));
        let (chunks, summary) = read(&source);
        let told = [format!("`{}` in line 601 of the points", &odd[..5]), told.to_owned()];
        assert!(told.iter().all(|told| summary.warnings.concat().contains(told)), "{summary:?}");
        let missing = scans::places(&chunks).iter().filter(|place| !place.is_finite()).count();
        assert_eq!((missing, scans::values(&source, &chunks, "a")[600]), (1, 1.002));
    }
    // Points that can only stand before decimals are read.
    let text = lines("512,25;843,5;336,563;0,5\n", 600) + "0.780;843.5;1336.563;1.5E-5\n";
    let source = open(text).unwrap().remove(0);
    let last = places(&source)[600];
    assert!((last - DVec3::new(0.78, 843.5, 1336.563)).length() < 1e-6, "{last}");
    assert!(values(&source, "a")[600] == 1.5e-5 && read(&source).1.warnings.is_empty());
}

#[test]
fn german_names_of_columns_are_known_in_the_texts_of_older_programs_too() {
    for line in ["Rechtswert;Hochwert;Höhe;Intensität", "OST;Nord;Hoehe [m];Intensität", "RW;HW;H;Intensität"] {
        // Code page 1252 has one byte for each of these characters.
        let old: Vec<u8> = line.chars().map(|character| u8::try_from(u32::from(character)).unwrap()).collect();
        for names_line in [line.as_bytes(), &old] {
            let text = [names_line, b"\n1,5;2;3;65\n"].concat();
            let source = open(text).unwrap().remove(0);
            assert_eq!(names(&source), "x y z Intensität", "{line}");
            assert_eq!(places(&source), [DVec3::new(1.5, 2.0, 3.0)], "{line}");
        }
    }
    // Beside x, y and z they are attributes.
    for (line, expected) in [
        ("X;Y;Z;Höhe", "x y z Höhe"),
        ("x;y;z;Hoehe", "x y z Hoehe"),
        ("X [m];Y [m];Z [m];h", "x y z h"),
        ("Ost;Nord;x;y;z", "Ost Nord x y z"),
        ("Ost;y;Höhe", "x y z"),
    ] {
        let count = line.split(';').count();
        let source = open(format!("{line}\n{}\n", ["1,5"; 5][..count].join(";"))).unwrap().remove(0);
        assert_eq!(names(&source), expected, "{line}");
        // The names that a file reports are those that a person may give.
        let given: Vec<String> = expected.split(' ').map(str::to_owned).collect();
        assert_eq!(codec::column_names(&given).unwrap(), given);
    }
    assert!(error("Ost;East;y;z\n1;2;3;4\n").contains("the columns x, x, y, z have x twice"));
    assert!(error("x;X;Ost;y;z\n1;2;3;4;5\n").contains("the columns x, x, Ost, y, z have x twice"));
    let table = unnamed(b"a;b;Gr\xf6\xdfe \x80;M\xfcll\n1;2;3;4\n").unwrap();
    assert_eq!(table.names, ["a", "blue", "Größe €", "Müll"]);
    assert!(table.by.contains("the columns a, blue, Größe €, Müll have no x"), "{}", table.by);
    let table = unnamed(b"1 2 3 B\xe4ume\n4 5 6 W\xe4nde\n").unwrap();
    assert_eq!(table.lines[0][3], "Bäume");
    let names = ["ost", "nord", "Höhe"].map(str::to_owned);
    assert_eq!(codec::column_names(&names).unwrap(), ["x", "y", "z"]);
}
