//! Clouds that are streamed, through the real program: the picture that memory gives, and what can go wrong on the way;
//! and what is kept of clouds in memory.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use image::RgbaImage;
use serde_json::Value;
use tests::{Folder, Outcome};

/// From where all pictures are taken.
const CAMERA: &str = "[camera]\neye = [431060, 5412000, 70]\npivot = [431050, 5412050, 0]\nup = [0, 0, 1]\n";
const ALWAYS: &str = "stream.pages=always";
/// Longer than any step of a run on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A hilly square of 100 m with blocks on it, which alone have user data, as LAS 1.2, point format 2: `points` of it in rows from `first` to `last`, shares
/// of the whole.
fn scan(points: usize, first: f64, last: f64) -> Vec<u8> {
    const SCALE: f64 = 0.001;
    const OFFSET: [f64; 3] = [431_000.0, 5_412_000.0, 0.0];
    let mut state = 1_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1_u64 << 24) as f64
    };
    let mut records = Vec::with_capacity(points * 26);
    let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
    for index in 0..points {
        let y = 100.0 * (first + (last - first) * (index as f64 + random()) / points as f64);
        let x = 100.0 * random();
        let ground = 4.0 * (x / 9.0).sin() * (y / 14.0).cos();
        let is_block = (x / 20.0).fract() < 0.3 && (y / 25.0).fract() < 0.3;
        let position = [x, y, if is_block { 9.0 } else { ground }];
        for (axis, value) in position.iter().enumerate() {
            let steps = (value / SCALE).round();
            records.extend((steps as i32).to_le_bytes());
            let world = steps * SCALE + OFFSET[axis];
            bounds[axis] = [bounds[axis][0].min(world), bounds[axis][1].max(world)];
        }
        let class = if is_block { 6 } else { 2 };
        records.extend((1000 + (x * 300.0) as u16).to_le_bytes());
        // The only return; class; scan angle, user data, source.
        records.extend([0b00_1001, class, 0, u8::from(is_block), 0, 0]);
        let shade = 0.5 + 0.5 * (x / 3.0).sin() * (y / 4.0).sin();
        let color = if is_block { [220.0, 90.0, 60.0] } else { [60.0 + 120.0 * shade, 160.0, 70.0 + 60.0 * shade] };
        records.extend(color.iter().flat_map(|value| (*value as u16 * 257).to_le_bytes()));
    }
    let mut header = b"LASF".to_vec();
    header.resize(24, 0);
    header.extend([1, 2]);
    header.resize(24 + 2 + 64 + 4, 0);
    header.extend(227_u16.to_le_bytes());
    header.extend(227_u32.to_le_bytes());
    header.extend(0_u32.to_le_bytes());
    header.push(2);
    header.extend(26_u16.to_le_bytes());
    header.extend((points as u32).to_le_bytes());
    header.extend((points as u32).to_le_bytes());
    header.resize(header.len() + 16, 0);
    let numbers = [SCALE; 3].into_iter().chain(OFFSET);
    let extents = bounds.iter().flat_map(|[least, most]| [*most, *least]);
    header.extend(numbers.chain(extents).flat_map(f64::to_le_bytes));
    assert_eq!(header.len(), 227);
    header.extend(records);
    header
}

/// A folder with the camera.
fn folder() -> Folder {
    let folder = Folder::new();
    folder.write("view.toml", CAMERA);
    folder
}

/// What `glint render ARGUMENTS` says at 160x120. None, with a note, where there is no adapter and none is required.
fn run(folder: &Folder, picture: &str, arguments: &[&str]) -> Option<Outcome> {
    let common = ["render", "-o", picture, "--size", "160x120", "--camera", "view.toml", "--stats", "stats.json"];
    let outcome = folder.glint(common.iter().chain(arguments));
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        println!("skipped: no adapter: {}", outcome.messages.trim());
        return None;
    }
    Some(outcome)
}

/// The picture, and what the statistics say of streaming.
fn render(folder: &Folder, arguments: &[&str]) -> Option<(RgbaImage, Value)> {
    let outcome = run(folder, "picture.png", arguments)?;
    assert_eq!(outcome.status, Some(0), "{outcome}");
    Some((picture(folder, "picture.png"), stats(folder)))
}

fn picture(folder: &Folder, name: &str) -> RgbaImage {
    image::open(folder.path(name)).expect("a PNG").into_rgba8()
}

fn stats(folder: &Folder) -> Value {
    let text = std::fs::read_to_string(folder.path("stats.json")).expect("the statistics");
    serde_json::from_str::<Value>(&text).expect("JSON")["stream"].clone()
}

/// Share of the pixels that differ by more than two of 255 steps in a channel.
fn share_of_others(a: &RgbaImage, b: &RgbaImage) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let differs = |(a, b): (&image::Rgba<u8>, &image::Rgba<u8>)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 2);
    a.pixels().zip(b.pixels()).filter(|pair| differs(*pair)).count() as f64 / (a.width() * a.height()) as f64
}

/// What a person sees of the difference, 0 to 1 (FLIP's mean).
fn flip(a: &RgbaImage, b: &RgbaImage) -> f64 {
    let linear = |picture: &RgbaImage| -> Vec<[f64; 3]> {
        let decode = |byte: u8| {
            let value = f64::from(byte) / 255.0;
            if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        picture.pixels().map(|pixel| [0, 1, 2].map(|channel| decode(pixel.0[channel]))).collect()
    };
    let differences = study::flip::flip(a.width() as usize, &linear(a), &linear(b));
    differences.iter().sum::<f64>() / differences.len() as f64
}

/// Folders of indexes in the cache.
fn entries(folder: &Folder) -> Vec<PathBuf> {
    let cache = folder.path(".cache/glint/pages");
    let entries = std::fs::read_dir(cache).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.filter(|path| path.is_dir()).collect()
}

fn the_entry(folder: &Folder) -> PathBuf {
    let entries = entries(folder);
    assert_eq!(entries.len(), 1, "{entries:?}");
    entries[0].clone()
}

fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < PATIENCE, "never: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// An index is being made.
fn is_building(folder: &Folder) -> bool {
    entries(folder).iter().any(|entry| entry.join("building").exists())
}

#[test]
fn pages_give_the_picture_that_memory_gives_and_a_tenth_of_them_nearly() {
    let folder = folder();
    folder.write("scan.las", scan(1_000_000, 0.0, 1.0));
    let held = ["scan.las", "--set", "stream.pages=never"];
    let all = ["scan.las", "--set", ALWAYS, "--set", "stream.detail=0.25", "--set", "stream.unseen=1"];
    let some = ["scan.las", "--set", ALWAYS, "--set", "view.point_budget=100000"];
    let with = |arguments: &[&'static str], light: &'static str| [arguments, &["--set", light]].concat();
    // By normals alone, and by sun and sky, whose shadows some of the points cast.
    for light in ["light.by=headlight", "light.by=auto"] {
        let Some((memory, none)) = render(&folder, &with(&held, light)) else { return };
        assert_eq!(none, Value::Null);
        let Some((pages, stats)) = render(&folder, &with(&all, light)) else { return };
        assert_eq!(stats["settled"], true, "{stats}");
        assert_eq!(stats["built_index"], light == "light.by=headlight", "the index is made once: {stats}");
        let points = (&stats["points_total"], &stats["points_resident"]);
        assert_eq!(points, (&1_000_000.into(), &1_000_000.into()), "{stats}");
        let (others, seen) = (share_of_others(&memory, &pages), flip(&memory, &pages));
        println!("{light}: {others} of the pixels differ, FLIP {seen}");
        assert!(others < 0.001 && seen < 0.001, "{light}: {others} of the pixels differ, FLIP {seen}");

        let Some((tenth, stats)) = render(&folder, &with(&some, light)) else { return };
        assert_eq!((&stats["settled"], &stats["built_index"]), (&true.into(), &false.into()), "{stats}");
        let resident = stats["points_resident"].as_u64().unwrap_or_default();
        assert!((50_000..=100_000).contains(&resident), "{stats}");
        let seen = flip(&memory, &tenth);
        println!("{light}: FLIP of a tenth of the points: {seen}");
        assert!(seen < 0.05, "{light}: {seen}");
    }
}

#[test]
fn normals_of_a_streamed_scan_face_its_scanner_as_those_in_memory_do() {
    let folder = folder();
    let scan = ["study", "scan", "tripod/room", "--rays", "60000", "--station", "2.9,2.6,1.55", "-o", "room.e57"];
    let outcome = folder.glint(scan);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    folder.write("view.toml", "[camera]\neye = [3.5, 3.5, 1.6]\npivot = [1.0, 1.0, 1.0]\nup = [0, 0, 1]\n");
    let pictures = ["stream.pages=never", ALWAYS].map(|pages| {
        let drawn =
            ["room.e57", "--set", "color.by=normal", "--set", "light.by=headlight", "--set", "surface.carve=false"];
        let all = ["--set", "stream.detail=0.25", "--set", "stream.unseen=1", "--set", pages];
        render(&folder, &[&drawn[..], &all].concat()).map(|(picture, _)| picture)
    });
    let [Some(memory), Some(pages)] = pictures else { return };
    let others = share_of_others(&memory, &pages);
    assert!(others < 0.001, "{others} of the pixels differ");
}

/// An index keeps few attributes unless it is asked to.
#[test]
fn points_of_a_streamed_cloud_are_mirrors_by_any_attribute_of_its_file() {
    let folder = folder();
    folder.write("scan.las", scan(60_000, 0.0, 1.0));
    let blocks = "[[mirror_points]]\ncloud = \"scan.las\"\n\
        points = { attribute = { name = \"user_data\", low = 1.0, high = 1.0 } }\n";
    folder.write("blocks.toml", format!("clouds = [\"scan.las\"]\n{blocks}"));
    let pictures = ["stream.pages=never", ALWAYS].map(|pages| {
        let light = ["--set", "light.by=headlight"];
        let all = ["--set", "stream.detail=0.25", "--set", "stream.unseen=1"];
        render(&folder, &[&["blocks.toml", "--set", pages][..], &light, &all].concat()).map(|(picture, _)| picture)
    });
    let [Some(memory), Some(pages)] = pictures else { return };
    let others = share_of_others(&memory, &pages);
    assert!(others < 0.01, "{others} of the pixels differ");
}

#[test]
fn damaged_and_deleted_indexes_are_made_again() {
    let folder = folder();
    folder.write("scan.las", scan(60_000, 0.0, 1.0));
    // The headlight shows every normal without maps of shadows, which take longer than all else.
    let arguments = ["scan.las", "--set", ALWAYS, "--set", "light.by=headlight"];
    let Some((whole, _)) = render(&folder, &arguments) else { return };
    let damage = |name: &str| {
        let path = the_entry(&folder).join(name);
        let mut bytes = std::fs::read(&path).expect("a file of the index");
        // Somewhere that every picture needs.
        for byte in bytes.iter_mut().skip(200).step_by(1000) {
            *byte ^= 0x55;
        }
        std::fs::write(&path, bytes).expect("it can be damaged");
    };
    let cut = |name: &str| {
        let file = std::fs::File::options().write(true).open(the_entry(&folder).join(name)).expect("a file");
        file.set_len(file.metadata().expect("its length").len() / 2).expect("it can be cut short");
    };
    let faults: [(&str, &dyn Fn()); 6] = [
        ("nodes damaged", &|| damage("nodes")),
        ("nodes cut", &|| cut("nodes")),
        ("pages damaged", &|| damage("pages")),
        ("pages cut", &|| cut("pages")),
        ("pages deleted", &|| std::fs::remove_file(the_entry(&folder).join("pages")).expect("it was there")),
        ("all deleted", &|| std::fs::remove_dir_all(folder.path(".cache")).expect("it was there")),
    ];
    for (what, fault) in faults {
        fault();
        let Some((again, stats)) = render(&folder, &arguments) else { return };
        assert_eq!(stats["built_index"], true, "{what}: {stats}");
        assert!(again == whole, "{what}: another picture");
    }
    // Normals and radii are a file of their own.
    damage("surfels");
    let Some((again, _)) = render(&folder, &arguments) else { return };
    assert!(again == whole, "surfels damaged: another picture");
}

#[test]
fn kept_normals_and_radii_make_the_picture_that_estimated_ones_make() {
    let folder = folder();
    folder.write("scan.las", scan(500_000, 0.0, 1.0));
    let arguments = ["scan.las", "--set", "color.by=normal", "--set", "light.by=sun", "--set", "gi.vpls=16"];
    let Some((estimated, _)) = render(&folder, &arguments) else { return };
    let kept = the_entry(&folder).join("kept");
    let bytes = std::fs::read(&kept).expect("normals and radii are kept");
    let Some((again, _)) = render(&folder, &arguments) else { return };
    assert!(again == estimated, "kept: another picture");
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 2] ^= 1;
    std::fs::write(&kept, damaged).expect("it can be damaged");
    let Some(outcome) = run(&folder, "picture.png", &arguments) else { return };
    assert_eq!(outcome.messages.lines().count(), 1, "{outcome}");
    assert!(outcome.messages.contains("scan.las: the normals and radii kept in the cache are damaged"), "{outcome}");
    assert!(picture(&folder, "picture.png") == estimated, "damaged: another picture");
    assert!(std::fs::read(&kept).expect("they are kept anew") == bytes);
}

#[test]
fn a_build_that_was_killed_is_made_anew_by_the_next() {
    let folder = folder();
    folder.write("scan.las", scan(1_500_000, 0.0, 1.0));
    let mut program = folder.command(["index", "scan.las"]).spawn().expect("the program starts");
    wait_until("a build begins", || is_building(&folder));
    program.kill().expect("a child can be ended");
    program.wait().expect("a child can be waited for");
    assert!(!the_entry(&folder).join("nodes").exists(), "it had finished");
    let outcome = folder.glint(["index", "scan.las"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    assert!(outcome.text().contains("1,500,000 points"), "{outcome}");
    assert!(!is_building(&folder) && the_entry(&folder).join("nodes").exists());
}

#[test]
#[cfg(unix)]
fn an_index_that_is_interrupted_clears_away_what_it_has_begun() {
    let folder = folder();
    folder.write("scan.las", scan(3_000_000, 0.0, 1.0));
    folder.write("next.las", scan(1_000, 0.0, 1.0));
    let mut command = folder.command(["index", "scan.las", "next.las"]);
    let program = command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn();
    let program = program.expect("the program starts");
    wait_until("a build begins", || is_building(&folder));
    let interrupt = std::process::Command::new("kill").args(["-INT", &program.id().to_string()]).status();
    assert!(interrupt.expect("kill starts").success());
    let output = program.wait_with_output().expect("a child can be waited for");
    let messages = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), &*messages), (Some(130), "glint: interrupted\n"));
    assert_eq!((output.stdout.as_slice(), entries(&folder)), (&b""[..], Vec::new()));
}

#[test]
fn two_who_build_at_once_end_with_one_index() {
    let folder = folder();
    folder.write("scan.las", scan(500_000, 0.0, 1.0));
    let spawn = || {
        let mut command = folder.command(["index", "scan.las"]);
        command.stdout(std::process::Stdio::piped()).spawn().expect("the program starts")
    };
    let said = [spawn(), spawn()].map(|program| {
        let output = program.wait_with_output().expect("a child can be waited for");
        assert!(output.status.success());
        String::from_utf8_lossy(&output.stdout).into_owned()
    });
    assert_eq!(said.iter().filter(|said| said.contains("was there")).count(), 1, "{said:?}");
    assert!(the_entry(&folder).join("nodes").exists());
    let outcome = folder.glint(["index", "scan.las"]);
    assert!(outcome.text().contains("was there"), "{outcome}");
}

#[test]
fn a_file_that_changes_while_it_is_indexed_gives_an_error_and_no_index() {
    let folder = folder();
    let path = folder.write("scan.las", scan(1_500_000, 0.0, 1.0));
    let before = std::fs::metadata(&path).expect("its length").len();
    let program = folder.command(["index", "scan.las"]).stderr(std::process::Stdio::piped()).spawn();
    let program = program.expect("the program starts");
    wait_until("a build begins", || is_building(&folder));
    let file = std::fs::File::options().write(true).open(&path).expect("the scan");
    file.set_len(before / 2).expect("it can be cut short");
    let output = program.wait_with_output().expect("a child can be waited for");
    let messages = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && messages.contains("scan.las"), "{messages}");
    assert!(!messages.contains("internal error"), "{messages}");
    assert_eq!(entries(&folder), Vec::<PathBuf>::new());
    let outcome = folder.glint(["index", "scan.las"]);
    assert_eq!(outcome.status, Some(0), "what is left can be indexed: {outcome}");
}

#[test]
fn a_folder_of_tiles_is_one_cloud_and_a_bad_tile_leaves_the_others() {
    let folder = folder();
    std::fs::create_dir(folder.path("tiles")).expect("a folder");
    folder.write("tiles/a.las", scan(60_000, 0.0, 0.5));
    folder.write("tiles/b.las", scan(60_000, 0.5, 1.0));
    let Some((whole, stats)) = render(&folder, &["tiles"]) else { return };
    assert_eq!(stats["points_total"], 120_000, "{stats}");
    assert!(tests::colors(&whole) > 100);
    folder.write("tiles/bad.las", "this is no scan");
    let Some(outcome) = run(&folder, "others.png", &["tiles"]) else { return };
    assert_eq!(outcome.status, Some(2), "{outcome}");
    assert!(outcome.messages.contains("bad.las"), "{outcome}");
    assert!(picture(&folder, "others.png") == whole, "the good tiles look different");
}

#[test]
fn a_cache_folder_that_cannot_be_written_is_named() {
    let folder = folder();
    folder.write("scan.las", scan(20_000, 0.0, 1.0));
    folder.write("file", "in the way");
    let cache = folder.path("file/pages");
    let outcome = folder.command(["index", "scan.las"]).env("GLINT_CACHE_DIR", &cache).output().expect("it starts");
    let messages = String::from_utf8_lossy(&outcome.stderr);
    assert!(!outcome.status.success() && messages.contains(&*Path::new(&cache).to_string_lossy()), "{messages}");
}

#[test]
fn what_is_missing_of_a_folder_of_tiles_is_said_when_it_is_indexed_and_drawn() {
    let folder = folder();
    std::fs::create_dir(folder.path("tiles")).expect("a folder");
    let whole = scan(20_000, 0.0, 1.0);
    // A header, and nothing of what it promises; half of what it promises.
    folder.write("tiles/a_empty.las", &whole[..227]);
    folder.write("tiles/b_half.las", &whole[..227 + 10_000 * 26]);
    folder.write("tiles/c.las", &whole);
    let check = |outcome: &Outcome| {
        assert_eq!(outcome.status, Some(2), "{outcome}");
        let said = |name: &str, what: &str| {
            let mut lines = outcome.messages.lines();
            assert!(lines.any(|line| line.contains(name) && line.contains(what)), "{name}, {what}: {outcome}");
        };
        said("a_empty.las", "no points can be read");
        said("b_half.las", "20000");
        assert_eq!(outcome.messages.matches("b_half.las").count(), 1, "{outcome}");
        assert!(!outcome.messages.contains("c.las"), "{outcome}");
    };
    let outcome = folder.glint(["index", "tiles"]);
    check(&outcome);
    assert!(outcome.text().contains("30,000 points"), "{outcome}");
    check(&folder.glint(["index", "tiles"]));
    if let Some(outcome) = run(&folder, "picture.png", &["tiles"]) {
        check(&outcome);
        assert_eq!(stats(&folder)["built_index"], false, "what is drawn is what was indexed");
    }
    let nothing = folder.glint(["index", "tiles/a_empty.las"]);
    assert_eq!(nothing.status, Some(2), "{nothing}");
    assert!(nothing.messages.contains("no points can be read"), "{nothing}");
}

#[test]
fn a_copc_file_that_was_written_is_streamed_without_an_index() {
    let folder = folder();
    folder.write("scan.las", scan(300_000, 0.0, 1.0));
    let outcome = folder.glint(["index", "scan.las", "-o", "scan.copc.laz"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    assert!(outcome.text().contains("scan.copc.laz: 300,000 points") && outcome.messages.is_empty(), "{outcome}");
    let info = |name: &str| {
        let outcome = folder.glint(["info", "--json", "--scan", name]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
        outcome.json()["inputs"][0].clone()
    };
    let (before, after) = (info("scan.las"), info("scan.copc.laz"));
    assert_eq!(after["points"], 300_000);
    assert_eq!(after["bounds"], before["bounds"]);
    assert_eq!(after["warnings"], Value::Array(Vec::new()), "{after}");
    let outcome = folder.glint(["index", "scan.copc.laz"]);
    assert!(outcome.status == Some(0) && outcome.text().contains("needs no index"), "{outcome}");

    let everything = ["--set", "stream.detail=0.25", "--set", "stream.unseen=1", "--set", "light.by=headlight"];
    let with = |first: &[&'static str]| [first, &everything].concat();
    let Some((memory, _)) = render(&folder, &with(&["scan.las", "--set", "stream.pages=never"])) else { return };
    let Some((pages, stats)) = render(&folder, &with(&["scan.copc.laz", "--set", ALWAYS])) else { return };
    assert_eq!((&stats["built_index"], &stats["settled"]), (&false.into(), &true.into()), "{stats}");
    assert_eq!(stats["points_resident"], 300_000, "{stats}");
    assert_eq!(entries(&folder), Vec::<PathBuf>::new());
    let seen = flip(&memory, &pages);
    println!("FLIP {seen}");
    assert!(seen < 0.05, "{seen}");
}
