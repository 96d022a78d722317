//! Names, words and files that somebody has made in order to break something: what a person sees is reported in short, on
//! one line, and nothing is waited for.
#![cfg(unix)]

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt as _;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;
use tests::{Folder, Outcome};

/// Whatever is refused is refused at once, on a busy machine.
const AT_ONCE: Duration = Duration::from_secs(10);
/// And in little memory.
const LITTLE: u64 = 200_000_000;

const SCENE: &str = "five-mirrors/none";

/// Colours, a title, the bell, a line of its own that looks like ours, C1 codes, and text from right to left.
const EVIL: &str = "\u{1b}[31mevil\u{1b}]0;title\u{7}\nglint: done\r\u{9b}2J\u{202e}\u{2066}x";
const SHOWN: &str = r"\u{1b}[31mevil\u{1b}]0;title\u{7}\nglint: done\r\u{9b}2J\u{202e}\u{2066}x";

const THREE_POINTS: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    end_header\n0 0 0\n1 0 0\n0 1 0\n";

fn is_steering(character: char) -> bool {
    let is_bidirectional = matches!(character, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    character.is_control() && character != '\n' || is_bidirectional
}

/// Nothing that steers a terminal is in the output or the messages, each of which begins as ours do.
fn assert_harmless(outcome: &Outcome) {
    assert!(!outcome.text().contains(is_steering) && !outcome.messages.contains(is_steering), "{outcome}");
    assert!(outcome.messages.lines().all(|line| line.starts_with("glint: ")), "{outcome}");
    assert!(!outcome.messages.lines().any(|line| line.starts_with("glint: done")), "{outcome}");
    assert!(!outcome.text().lines().any(|line| line.starts_with("glint: ")), "{outcome}");
}

fn refused(folder: &Folder, words: &[&str], mentioned: &str) -> Outcome {
    let outcome = folder.glint_within(AT_ONCE, words);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    assert!(outcome.messages.contains(mentioned), "`{mentioned}`: {outcome}");
    assert!(outcome.peak_memory < LITTLE, "{} bytes: {outcome}", outcome.peak_memory);
    assert!(outcome.messages.len() < 3000, "{} bytes of messages", outcome.messages.len());
    outcome
}

#[test]
fn texts_and_grids_that_claim_more_than_they_hold_are_read_as_far_as_they_go() {
    let folder = Folder::new();
    let grid = "1000000000\n1000000000\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 0.5\n";
    let fields = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\n";
    let texts = [
        ("grid.ptx", grid.to_owned(), "999999999999999999 of 1000000000000000000 cells are missing"),
        ("list.pts", "18446744073709551615\n1 2 3 4\n".into(), "points are missing: the file ends early"),
        ("rows.pcd", format!("{fields}POINTS 18446744073709551615\nDATA ascii\n1 2 3\n"), "points are missing"),
    ];
    for (name, text, told) in texts {
        folder.write(name, text);
        let outcome = folder.glint_within(AT_ONCE, ["info", name]);
        assert!(outcome.status == Some(0) && outcome.text().contains(told), "{name}: {outcome}");
        assert!(outcome.peak_memory < LITTLE, "{name}: {outcome}");
    }
    folder.write("many.pts", "1\n1 2 3\n".to_owned() + &"0\n".repeat(300_000));
    refused(&folder, &["info", "many.pts"], "more than 10000 of them");
    let packed = format!("{fields}POINTS 300000000\nDATA binary_compressed\n");
    let sizes = [9_u32.to_le_bytes(), 3_600_000_000_u32.to_le_bytes()].concat();
    folder.write("packed.pcd", [packed.as_bytes(), &sizes, &[0; 9]].concat());
    refused(&folder, &["info", "packed.pcd"], "less than LZF can take");
    let mut header = b"ASTM-E57".to_vec();
    [0x1_u64, 2048, 1024, 1 << 40, 1024].iter().for_each(|word| header.extend(word.to_le_bytes()));
    header.resize(2048, 0);
    folder.write("lying.e57", header);
    refused(&folder, &["info", "lying.e57"], "a description of 1099511627776 bytes");
}

#[test]
fn words_and_names_that_steer_a_terminal_are_shown_as_escapes() {
    let folder = Folder::new();
    folder.write("cloud.ply", THREE_POINTS);
    let named = format!("{EVIL}.ply");
    folder.write(&named, THREE_POINTS);
    let scene = |text: String| folder.write("scene.toml", text);
    let quoted = toml::Value::String(format!("{EVIL}.las")).to_string();
    scene(format!("clouds = [{quoted}]"));

    let told = folder.glint(["info", &named]);
    assert_eq!(told.status, Some(0), "{told}");
    assert!(told.text().contains(SHOWN), "{told}");
    assert_harmless(&told);
    let told = folder.glint(["info", "--json", &named, &format!("gone{EVIL}.las")]);
    assert_harmless(&told);
    assert_eq!(told.json()["inputs"][0]["path"], Value::String(named.clone()), "JSON's own escapes");
    assert!(told.messages.contains(SHOWN) && told.messages.lines().count() == 1, "{told}");

    let picture = |words: &[&str]| [&["render", SCENE, "-o", "a.png"][..], words].concat().join("\0");
    let pair = |key: &str, value: &str| format!("{key}={value}");
    let commands = [
        picture(&["--set", &pair(EVIL, "1")]),
        picture(&["--set", &pair("splat.size", EVIL)]),
        picture(&["--aov", &pair(EVIL, "a.exr")]),
        picture(&["--aov", &pair("depth", EVIL)]),
        picture(&["--camera", EVIL]),
        picture(&["--method", EVIL]),
        picture(&["--size", EVIL]),
        picture(&["--gpu", EVIL]),
        picture(&[&format!("--{EVIL}")]),
        format!("render\0{SCENE}\0-o\0{EVIL}.jpg"),
        "info\0scene.toml".into(),
        "render\0scene.toml\0-o\0a.png".into(),
        format!("study\0{EVIL}\0-o\0results"),
        format!("index\0cloud.ply\0-o\0{EVIL}"),
        format!("{EVIL}.las"),
    ];
    for command in commands {
        let outcome = folder.glint(command.split('\0'));
        assert!(matches!(outcome.status, Some(2 | 3)), "{outcome}");
        assert!(outcome.messages.contains(r"\u{1b}[31mevil"), "{outcome}");
        assert_harmless(&outcome);
    }
    let doctor = folder.command(["doctor"]).env("DISPLAY", EVIL).output().expect("the program starts");
    let text = String::from_utf8_lossy(&doctor.stdout);
    assert!(text.contains(SHOWN) && !text.contains(is_steering), "{text}");
    let mut logged = folder.command(["info", &named, "--scan"]);
    let logged = logged.env("GLINT_LOG", "trace").output().expect("the program starts");
    assert!(!String::from_utf8_lossy(&logged.stderr).contains(is_steering));
}

#[test]
fn side_files_that_never_end_or_never_begin_are_refused_at_once() {
    let folder = Folder::new();
    let made = Command::new("mkfifo").arg(folder.path("pipe.toml")).status();
    assert!(made.is_ok_and(|status| status.success()));
    let sparse = std::fs::File::create(folder.path("sparse.toml")).expect("a file");
    sparse.set_len(20 << 30).expect("a sparse file");
    std::os::unix::fs::symlink("/dev/zero", folder.path("zero.toml")).expect("a link");
    for (file, problem) in
        [("pipe.toml", "not a regular file"), ("zero.toml", "not a regular file"), ("sparse.toml", "more than 16 MB")]
    {
        refused(&folder, &["info", file], problem);
        refused(&folder, &["render", file, "-o", "a.png"], problem);
        refused(&folder, &["index", file], problem);
        refused(&folder, &["view", file], problem);
        refused(&folder, &["render", SCENE, "-o", "a.png", "--camera", file], problem);
        refused(&folder, &["study", file, "-o", "results"], problem);
    }
    refused(&folder, &["render", SCENE, "-o", "a.png", "--camera", "/dev/zero"], "not a regular file");
    refused(&folder, &["study", "/dev/zero", "-o", "results"], "not a regular file");
    // The plan that is kept in a study's folder.
    std::fs::create_dir(folder.path("results")).expect("a folder");
    std::fs::rename(folder.path("pipe.toml"), folder.path("results/plan.toml")).expect("a pipe");
    refused(&folder, &["study", "methods", "-o", "results"], "not a regular file");
    refused(&folder, &["study", "merge", "results", "-o", "joined"], "not a regular file");
}

#[test]
fn a_view_comes_from_standard_input_up_to_its_limit() {
    let folder = Folder::new();
    let view = "[camera]\neye = [0.0, 0.0, 1.9]\npivot = [0.0, 0.0, 0.0]\nup = [0.0, 1.0, 0.0]\n";
    let glint = folder.command([""; 0]);
    let shell = |line: &str| {
        let mut command = Command::new("sh");
        command.args(["-c", line, "sh"]).arg(glint.get_program()).current_dir(folder.path("")).stdin(Stdio::null());
        command.env("HOME", folder.path("")).env("XDG_RUNTIME_DIR", folder.path("runtime"));
        command.envs(tests::shader_cache().map(|folder| ("MESA_SHADER_CACHE_DIR", folder)));
        command.output().expect("sh starts")
    };
    let render = format!("\"$1\" render {SCENE} -o a.png --size 64x48 --set scene.points=20000 --camera -");
    let said = |output: &std::process::Output| String::from_utf8_lossy(&output.stderr).into_owned();
    let endless = shell(&format!("{render} < /dev/zero"));
    assert_eq!(endless.status.code(), Some(2), "{}", said(&endless));
    assert!(said(&endless).contains("standard input: more than 16 MB"), "{}", said(&endless));
    let broken = shell(&format!("echo 'camera = [' | {render}"));
    assert_eq!(broken.status.code(), Some(2), "{}", said(&broken));
    assert!(said(&broken).contains("standard input") && said(&broken).contains("line 1"), "{}", said(&broken));
    let drawn = shell(&format!("{render} <<'VIEW1'\n{view}VIEW1\n"));
    if drawn.status.code() == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        return println!("skipped: no adapter: {}", said(&drawn).trim());
    }
    assert_eq!(drawn.status.code(), Some(0), "{}", said(&drawn));
    assert!(folder.path("a.png").exists());
}

#[test]
fn messages_are_short_and_few_whatever_a_scene_holds() {
    let folder = Folder::new();
    let long = "x".repeat(1_000_000);
    folder.write("line.toml", format!("clouds = [\"{long}"));
    folder.write("name.toml", format!("clouds = [\"{long}.las\"]"));
    folder.write("key.toml", format!("{long} = 1"));
    let missing = |count: usize| (0..count).map(|index| format!("\"gone-{index}.las\", ")).collect::<String>();
    folder.write("missing.toml", format!("clouds = [{}]", missing(1000)));
    folder.write("many.toml", format!("clouds = [{}]", missing(20_000)));
    folder.write("cloud.ply", THREE_POINTS);
    folder.write("partly.toml", format!("clouds = [\"cloud.ply\", {}]", missing(900)));
    for (name, told) in [("line.toml", "unclosed array"), ("name.toml", "xxx...xxx"), ("key.toml", "xxx...xxx")] {
        let outcome = refused(&folder, &["render", name, "-o", "a.png"], told);
        assert_eq!(outcome.messages.lines().count(), 1, "{outcome}");
    }
    refused(&folder, &["render", "missing.toml", "-o", "a.png"], "and 997 more that name nothing");
    refused(&folder, &["render", "many.toml", "-o", "a.png"], "20000 clouds, expected at most 1000");
    let info = refused(&folder, &["info", "partly.toml"], "and 895 more that cannot be read");
    assert_eq!(info.messages.lines().count(), 6, "{info}");
    let index = refused(&folder, &["index", "missing.toml"], "and 997 more");
    assert_eq!(index.messages.lines().count(), 1, "{index}");
}

#[test]
fn more_of_a_scene_than_can_be_shown_is_refused_at_once() {
    let folder = Folder::new();
    folder.write("cloud.ply", THREE_POINTS);
    let mirror = "[[mirrors]]\nshape = \"sphere\"\nposition = [0.0, 0.0, 0.0]\nsize = 0.5\n";
    folder.write("mirrors.toml", format!("clouds = [\"cloud.ply\"]\n{}", mirror.repeat(8000)));
    folder.write("again.toml", format!("clouds = [{}]", "\"cloud.ply\", ".repeat(3000)));
    refused(&folder, &["render", "mirrors.toml", "-o", "a.png"], "8000 mirrors, expected at most 64");
    refused(&folder, &["render", SCENE, "-o", "a.png", "--camera", "mirrors.toml"], "expected at most 64");
    refused(&folder, &["render", "again.toml", "-o", "a.png"], "3000 clouds, expected at most 1000");
    folder.write("again.toml", format!("clouds = [{}]", "\"cloud.ply\", ".repeat(300)));
    let outcome = folder.glint_within(AT_ONCE, ["info", "--json", "again.toml"]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    assert_eq!(outcome.json()["inputs"].as_array().map(Vec::len), Some(1), "{outcome}");
    assert!(outcome.messages.contains("cloud.ply: named more than once, and opened once"), "{outcome}");
}

#[test]
fn names_that_are_no_text_are_opened_everywhere() {
    let folder = Folder::new();
    let place = folder.path("").join(OsStr::from_bytes(b"pl\xe4tze"));
    std::fs::create_dir(&place).expect("a folder");
    let [cloud, scene, view, picture, depth, stats, plan, results] = [
        &b"w\xe4ld.ply"[..],
        b"sz\xe4ne.toml",
        b"s\xefcht.toml",
        b"b\xefld.png",
        b"t\xefefe.exr",
        b"z\xe4hl.json",
        b"pl\xe4n.toml",
        b"erg\xe4b",
    ]
    .map(|name| place.join(OsStr::from_bytes(name)));
    let write = |path: &std::path::Path, text: &str| std::fs::write(path, text).expect("a file");
    write(&cloud, THREE_POINTS);
    write(&place.join("plain.ply"), THREE_POINTS);
    write(&scene, "clouds = ['plain.ply']\n");
    write(&view, "[camera]\neye = [0.3, 0.3, 5.0]\npivot = [0.3, 0.3, 0.0]\nup = [0.0, 1.0, 0.0]\n");
    write(&plan, "title = 'one'\nrepeats = 1\n[[group]]\nscenes = ['five-mirrors/none']\nmethods = ['none']\n");
    for input in [&cloud, &scene] {
        let outcome = folder.glint([OsStr::new("info"), "--json".as_ref(), input.as_ref()]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
        assert_eq!(outcome.json()["inputs"][0]["points"], 3, "{outcome}");
        assert!(
            outcome.json()["inputs"][0]["path"].as_str().is_some_and(|path| path.contains(r"pl\xe4tze/")),
            "{outcome}"
        );
    }
    let mut image = OsStr::new("depth=").to_owned();
    image.push(&depth);
    let words: [&OsStr; 14] = [
        "render".as_ref(),
        cloud.as_ref(),
        scene.as_ref(),
        "-o".as_ref(),
        picture.as_ref(),
        "--camera".as_ref(),
        view.as_ref(),
        "--aov".as_ref(),
        &image,
        "--stats".as_ref(),
        stats.as_ref(),
        "--size".as_ref(),
        "64x48".as_ref(),
        "--frames=1".as_ref(),
    ];
    let outcome = folder.glint(words);
    let study: [&OsStr; 8] = [
        "study".as_ref(),
        plan.as_ref(),
        "-o".as_ref(),
        results.as_ref(),
        "--size".as_ref(),
        "64x48".as_ref(),
        "--set".as_ref(),
        "scene.points=20000".as_ref(),
    ];
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        return println!("skipped: no adapter: {}", outcome.messages.trim());
    }
    assert_eq!(outcome.status, Some(0), "{outcome}");
    assert!([&picture, &depth, &stats].iter().all(|file| file.exists()), "{outcome}");
    let outcome = folder.glint(study);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    assert!(results.join("index.html").exists());
}

#[test]
fn a_folder_that_is_set_to_nothing_is_the_default_place() {
    let folder = Folder::new();
    folder.write("cloud.ply", THREE_POINTS);
    let before = std::fs::read_dir(folder.path("")).expect("the folder").count();
    let mut command = folder.command(["index", "cloud.ply"]);
    let output = command.env("GLINT_CACHE_DIR", "").env("GLINT_CONFIG_DIR", "").output().expect("the program starts");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("/.cache/glint/pages/"), "{text}");
    // The home is this folder, too: nothing but its hidden cache has come.
    assert_eq!(std::fs::read_dir(folder.path("")).expect("the folder").count(), before + 1);
    let mut command = folder.command(["doctor", "--json"]);
    let output = command.env("GLINT_CONFIG_DIR", "").output().expect("the program starts");
    let report: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(report["settings_folder"].as_str().is_some_and(|folder| folder.ends_with("/.config/glint")), "{report}");
}

#[test]
fn info_as_json_tells_of_an_unreadable_file_on_standard_error_too() {
    let folder = Folder::new();
    folder.write("bad.las", "this is no point cloud");
    let outcome = folder.glint(["info", "--json", "bad.las"]);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    let error = outcome.json()["inputs"][0]["error"].as_str().expect("an error").to_owned();
    assert_eq!(outcome.messages, format!("glint: {error}\n"));
}
