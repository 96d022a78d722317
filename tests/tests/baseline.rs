//! Pictures that must not change by accident: checksums of pictures and float images, made by the real program, are kept in
//! tests/baseline, one file for each adapter. `cargo xtask baseline` writes the file of this machine's adapter anew, for
//! changes that are meant to change a picture. On an adapter without a file the test says that it skips.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use exr::prelude::read_first_flat_layer_from_file;
use tests::{Folder, test_data};

const SIZE: &str = "96x72";
const MIRRORS: [&str; 5] = ["sphere", "parabolic", "blob", "torus", "coral"];
/// Methods that find what mirrors show, with the images that only they make.
const METHODS: [(&str, &[&str]); 5] = [
    ("environment_map", &[]),
    ("mirrored_viewpoint", &[]),
    ("sscr", &["regions", "curvature"]),
    ("sscr_hierarchical", &[]),
    ("surfel_trace", &[]),
];

/// One picture of the set.
struct Case {
    name: String,
    arguments: Vec<String>,
    images: Vec<&'static str>,
}

fn case(name: impl Into<String>, arguments: &str, images: &[&'static str]) -> Case {
    let arguments = arguments.split_whitespace().map(str::to_owned).collect();
    Case { name: name.into(), arguments, images: [&["depth", "normal", "color"], images].concat() }
}

/// The built-in scene with its mirrors by every method, and with indirect light.
fn built_in_cases() -> Vec<Case> {
    const FEW: &str = "--set scene.points=30000";
    let mut cases = Vec::new();
    for mirror in MIRRORS {
        for (method, images) in METHODS {
            let images = [&["mirror_position", "mirror_normal"], images].concat();
            let line = format!("five-mirrors/{mirror} {FEW} --set gi.bounces=0 --method {method}");
            cases.push(case(format!("{mirror} {method}"), &line, &images));
        }
    }
    let light = "--set gi.vpls=64";
    cases.push(case("all none", &format!("five-mirrors/all {FEW} --set gi.bounces=0 --method none"), &["mirror"]));
    cases.push(case("all three bounces", &format!("five-mirrors/all {FEW} {light} --bounces 3"), &["mirror_albedo"]));
    cases.push(case("box indirect", &format!("five-mirrors/none {FEW} {light} --set gi.bounces=2"), &["indirect"]));
    let plain = "--set gi.interleave=1 --set gi.bounces=1";
    cases.push(case("sphere indirect", &format!("five-mirrors/sphere {FEW} {light} {plain}"), &["direct", "indirect"]));
    cases
}

/// Real scans: a room under the lamp that it gets, a landscape under sun and sky, water that reflects, a streamed cloud of
/// which a third is drawn. They name the light, the colours and the view that they were first drawn with, whatever the
/// defaults are. Scans of millions of points take ten times as long, and go through the same code.
fn scan_cases(folder: &Folder, data: &Path) -> Vec<Case> {
    let file = |name: &str| data.join(name).display().to_string();
    let office = file("ply/indoor_office_tls_rgb_third_binary_le.ply");
    let autzen = file("airborne/autzen_trim_las12_pf3.laz");
    let crop = file("airborne/ign_france_crop_las14_pf6_extradims.laz");
    let lake = file("airborne/topography_mountain_lake_las12_pf1.laz");
    let water = format!(
        "clouds = [{lake:?}]\n[parameters]\n\"gi.vpls\" = 64\n[[mirror_points]]\ncloud = {lake:?}\npoints = {{ class = 9 }}\n\
         normals = \"flatten\"\nspecular_intensity = 0.8\n"
    );
    folder.write("lake.toml", water);
    const LIGHT: &str = "--camera iso --set light.by=surroundings";
    const GREY: &str = "--set color.by=intensity";
    const STREAMED: &str = "--set stream.pages=always --set view.point_budget=100000 --set light.by=headlight";
    let streamed = format!("{crop} --camera iso {GREY} {STREAMED}");
    const RADII: &str = "--set surface.radii=full";
    const BLACK: &str = "--set color.blank=black";
    vec![
        case("office", &format!("{office} {LIGHT} {RADII} {BLACK} --set gi.vpls=64"), &["indirect"]),
        case("autzen", &format!("{autzen} {LIGHT} {GREY} {RADII} --set gi.bounces=0"), &["direct"]),
        case("lake", &format!("lake.toml {LIGHT} {GREY} {RADII}"), &["mirror_position"]),
        case("streamed", &format!("{streamed} {RADII}"), &["albedo"]),
    ]
}

/// `IMAGE checksum` of each image of a case. None, with a note, where there is no adapter and none is required.
fn checksums(folder: &Folder, case: &Case) -> Option<Vec<(&'static str, u32)>> {
    let mut words = vec!["render".to_owned(), "-o".into(), "picture.png".into(), "--size".into(), SIZE.into()];
    words.extend(case.arguments.iter().cloned());
    words.extend(case.images.iter().flat_map(|image| ["--aov".to_owned(), format!("{image}={image}.exr")]));
    let outcome = folder.glint(&words);
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        println!("skipped: no adapter: {}", outcome.messages.trim());
        return None;
    }
    assert_eq!(outcome.status, Some(0), "{}: {outcome}", case.name);
    let picture = image::open(folder.path("picture.png")).expect("a PNG").into_rgba8();
    let mut sums = vec![("picture", crc32fast::hash(&picture))];
    for image in &case.images {
        sums.push((image, crc32fast::hash(&samples(&folder.path(&format!("{image}.exr"))))));
    }
    Some(sums)
}

/// The samples of all channels of a float image, one channel after the other. All NaNs count as one.
fn samples(path: &Path) -> Vec<u8> {
    let image = read_first_flat_layer_from_file(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let channels = &image.layer_data.channel_data.list;
    let values = channels.iter().flat_map(|channel| channel.sample_data.values_as_f32());
    values.flat_map(|value| if value.is_nan() { f32::NAN } else { value }.to_le_bytes()).collect()
}

/// What decides the last bits of a picture: the adapter with its driver, and for a processor the instructions that it has.
fn adapter(folder: &Folder) -> Option<String> {
    let doctor = folder.glint(["doctor", "--json"]).json();
    let chosen = doctor["adapters"].as_array()?.iter().find(|adapter| adapter["chosen"] == true)?.clone();
    let mut name = format!("{} {}", chosen["name"].as_str()?, chosen["driver"].as_str()?);
    if chosen["kind"] == "cpu" {
        name = format!("{name} {}", instructions());
    }
    Some(name)
}

#[cfg(target_arch = "x86_64")]
fn instructions() -> &'static str {
    if std::arch::is_x86_feature_detected!("avx512f") {
        "avx512f"
    } else if std::arch::is_x86_feature_detected!("fma") {
        "fma"
    } else {
        "sse"
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn instructions() -> &'static str {
    std::env::consts::ARCH
}

/// The file that keeps the checksums of an adapter.
fn baseline(adapter: &str) -> PathBuf {
    let words = adapter.split(|letter: char| !letter.is_ascii_alphanumeric() && letter != '.');
    let name = words.filter(|word| !word.is_empty()).collect::<Vec<_>>().join("-");
    Path::new(env!("CARGO_MANIFEST_DIR")).join("baseline").join(name + ".txt")
}

#[test]
fn pictures_are_those_of_the_baseline_to_the_bit() {
    let folder = Folder::new();
    let Some(adapter) = adapter(&folder) else {
        assert!(std::env::var_os("GLINT_REQUIRE_GPU").is_none(), "no adapter");
        println!("skipped: no adapter");
        return;
    };
    let path = baseline(&adapter);
    let is_written_anew = std::env::var_os("UPDATE").is_some();
    let known = std::fs::read_to_string(&path).unwrap_or_default();
    if known.is_empty() && !is_written_anew {
        println!("skipped: no baseline of `{adapter}`; `cargo xtask baseline` writes one");
        return;
    }
    let expected: BTreeMap<&str, &str> = known.lines().filter_map(|line| line.rsplit_once(' ')).collect();
    let mut cases = built_in_cases();
    if let Some(data) = test_data() {
        cases.extend(scan_cases(&folder, &data));
    }
    let mut text = String::new();
    let mut changed = Vec::new();
    for case in &cases {
        let Some(sums) = checksums(&folder, case) else { return };
        for (image, sum) in sums {
            let (key, sum) = (format!("{} {image}", case.name), format!("{sum:08x}"));
            if expected.get(key.as_str()) != Some(&sum.as_str()) {
                changed.push(key.clone());
            }
            let _ = writeln!(text, "{key} {sum}");
        }
    }
    if is_written_anew {
        std::fs::write(&path, text).expect("the file of the baseline");
    } else {
        assert!(
            changed.is_empty(),
            "{} images are not those of {}: {changed:#?}\n`cargo xtask baseline` writes them anew where that is meant",
            changed.len(),
            path.display()
        );
    }
}
