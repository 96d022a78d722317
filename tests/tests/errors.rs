//! Failures are the same in every command: exit status, words, and nothing left behind. docs/errors.md is the table.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Child, Command, Output};
use std::time::{Duration, Instant};

use tests::{Folder, Outcome, lacks_adapter};

const SCENE: &str = "five-mirrors/none";
/// Drawn in a moment.
const FEW_POINTS: &str = "scene.points=20000";
/// Small pictures in direct light: most of the time of a start goes into passes, and half of those make indirect light.
const SMALL: [&str; 6] = ["--size", "64x48", "--set", FEW_POINTS, "--set", "gi.bounces=0"];
/// A study of one setting.
const PLAN: &str = "title = 'one'\nrepeats = 1\n[[group]]\nscenes = ['five-mirrors/none']\nmethods = ['none']\n";
/// A path of one picture, and one of more than anybody waits for.
const PATH: &str =
    "[[paths]]\nname = 'still'\n[[paths.keyframes]]\ntime = 0\neye = [0, -9, 2]\npivot = [0, 0, 1]\nup = [0, 0, 1]\n";
const LONG_PATH: &str = "[[paths.keyframes]]\ntime = 9999\neye = [0, 9, 2]\npivot = [0, 0, 1]\nup = [0, 0, 1]\n";
const PATIENCE: Duration = Duration::from_secs(120);

/// A LAS file 1.2 of point format 0 whose points are all zero, of which the disk holds none.
fn las(folder: &Folder, name: &str, points: u32) {
    let mut header = b"LASF".to_vec();
    header.resize(24, 0);
    header.extend([1, 2]);
    header.resize(94, 0);
    header.extend(227_u16.to_le_bytes());
    header.extend(227_u32.to_le_bytes());
    header.extend(0_u32.to_le_bytes());
    header.push(0);
    header.extend(20_u16.to_le_bytes());
    header.extend(points.to_le_bytes());
    header.extend(points.to_le_bytes());
    header.resize(131, 0);
    header.extend([0.01_f64; 3].iter().flat_map(|scale| scale.to_le_bytes()));
    header.resize(227, 0);
    let path = folder.write(name, header);
    let file = std::fs::File::options().write(true).open(path).expect("the file");
    file.set_len(227 + 20 * u64::from(points)).expect("a sparse file");
}

/// One line, without the insides and without the same reason twice.
fn assert_failed(outcome: &Outcome, status: i32, mentioned: &[&str]) {
    assert_eq!(outcome.status, Some(status), "{outcome}");
    assert_eq!(outcome.messages.lines().count(), 1, "{outcome}");
    assert!(outcome.messages.starts_with("glint: "), "{outcome}");
    for inside in [".partial", ".unfinished", "panicked", "internal error", "/building"] {
        assert!(!outcome.messages.contains(inside), "`{inside}`: {outcome}");
    }
    for word in mentioned {
        assert_eq!(outcome.messages.matches(word).count(), 1, "`{word}`: {outcome}");
    }
}

/// `setting` prepares mounts and the like for one run in the folder, in a namespace of its own.
fn within(folder: &Folder, unshare: &[&str], setting: &str, arguments: &[&str]) -> Outcome {
    let program = folder.command(arguments);
    let mut command = Command::new("unshare");
    command.args(unshare).args(["sh", "-c", &format!("{setting}\nexec \"$@\""), "sh"]);
    command.arg(program.get_program()).args(program.get_args());
    for (name, value) in program.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    let command = command.current_dir(folder.path(""));
    let Output { status, stdout, stderr } = command.output().expect("unshare starts");
    let messages = String::from_utf8_lossy(&stderr).into_owned();
    let command = format!("({}) glint {}", setting.replace('\n', "; "), arguments.join(" "));
    Outcome { command, status: status.code(), output: stdout, messages, peak_memory: 0 }
}

/// Whether mounts can be made here, which a test is passed over without: said aloud, and an error under CI.
fn can_mount() -> bool {
    let tried = Command::new("unshare").args(["-rm", "mount", "-t", "tmpfs", "none", "/mnt"]).output();
    let can = tried.is_ok_and(|output| output.status.success());
    if !can {
        assert!(std::env::var_os("CI").is_none(), "no file systems can be mounted here, and CI is set");
        println!("skipped: `unshare -rm` cannot mount a file system here");
    }
    can
}

/// A file system in `place` that is full, or that can only be read.
const FULL: &str = "mount -t tmpfs -o size=64k none place && ! cat /dev/zero > place/filler 2>/dev/null";
const READ_ONLY: &str = "mount -t tmpfs none place && mount -o remount,ro place";

/// Every command that reads points, for this input and into the folder itself.
fn readers(input: &str) -> Vec<Vec<&str>> {
    let render = [&["render", input, "-o", "picture.png"][..], &SMALL].concat();
    let mut commands = vec![vec!["info", input], vec!["info", "--json", input], render];
    commands.push([&["record", input, "-o", "pictures"][..], &SMALL].concat());
    commands.push(vec!["index", input]);
    commands.push(vec!["index", input, "-o", "out.copc.laz"]);
    commands.push(vec!["surfaces", input]);
    commands.push(vec!["profile", input, "--line", "0,0,0:1,0,0", "--width", "1"]);
    commands.push(vec!["export", input, "-o", "out.laz"]);
    commands.push(vec!["ghosts", input, "--station", "0,0,0"]);
    commands.push(vec!["view", input]);
    commands
}

#[test]
fn inputs_that_cannot_be_read_are_bad_input_in_every_command() {
    let folder = Folder::new();
    folder.write("broken.toml", "clouds = [");
    folder.write("odd.las", "this is no point cloud");
    std::fs::create_dir(folder.path("empty")).expect("a folder");
    std::fs::create_dir(folder.path("folder.toml")).expect("a folder");
    let made = Command::new("mkfifo").arg(folder.path("pipe.las")).arg(folder.path("pipe.toml")).status();
    assert!(made.is_ok_and(|status| status.success()));
    let failures = [
        ("gone.las", "no such file or built-in scene"),
        ("empty", "a folder without files of points"),
        ("broken.toml", "broken.toml: not a scene: line 1, column"),
        ("folder.toml", "a folder, not a file"),
        ("pipe.toml", "not a regular file"),
        ("pipe.las", "not a regular file"),
        ("odd.las", "not a file of a known format"),
    ];
    for (input, problem) in failures {
        for command in readers(input) {
            // What is wrong inside of a file is found when there is a display to show it on, and recordings are made of scene files.
            if ["view", "record"].contains(&command[0]) && input.ends_with(".las") && input != "gone.las" {
                continue;
            }
            let outcome = folder.glint_within(PATIENCE, &command);
            if !lacks_adapter(&outcome) {
                assert_failed(&outcome, 2, &[problem, input]);
            }
        }
    }
    for (plan, problem) in [
        ("gone.toml", "No such file"),
        ("broken.toml", "broken.toml:1"),
        ("folder.toml", "a folder"),
        ("pipe.toml", "not a regular file"),
    ] {
        assert_failed(&folder.glint_within(PATIENCE, ["study", plan, "-o", "results"]), 2, &[problem]);
        assert!(!folder.path("results").exists());
    }
    for (view, problem) in [
        ("gone.toml", "no such file"),
        ("broken.toml", "line 1"),
        ("folder.toml", "a folder"),
        ("pipe.toml", "not a regular file"),
    ] {
        let command = ["render", SCENE, "-o", "picture.png", "--camera", view];
        assert_failed(&folder.glint_within(PATIENCE, command), 2, &[problem]);
    }
    assert!(!folder.path("picture.png").exists() && !folder.path("out.copc.laz").exists());
    assert!(!folder.path("out.laz").exists());
    assert!(!folder.path("pictures").exists());
}

#[cfg(unix)]
#[test]
fn a_scene_that_hides_all_of_its_clouds_is_bad_input_in_every_command() {
    let folder = Folder::new();
    las(&folder, "a.las", 10);
    let measurement = "[[measurements]]\nkind = 'point'\npoints = [[0, 0, 0]]\n";
    let hidden = "[[cloud_settings]]\ncloud = 'a.las'\non = false\n";
    folder.write("hidden.toml", format!("clouds = ['a.las']\n{hidden}{measurement}{PATH}"));
    let line = ["--line", "0,0,0:1,0,0", "--width", "1"];
    let commands: [&[&str]; 7] = [
        &["render", "hidden.toml", "-o", "a.png"],
        &["record", "hidden.toml", "-o", "a"],
        &[&["profile", "hidden.toml"], &line[..]].concat(),
        &["measure", "hidden.toml"],
        &["export", "hidden.toml", "-o", "a.ply"],
        &["compare", "hidden.toml", "a.las"],
        &["ghosts", "hidden.toml"],
    ];
    for words in commands {
        let outcome = folder.glint(words);
        if !lacks_adapter(&outcome) {
            assert_failed(&outcome, 2, &["a.las: the scene hides all of its clouds"]);
        }
    }
    assert!(["a.png", "a", "a.ply"].iter().all(|name| !folder.path(name).exists()), "nothing is left behind");
}

#[cfg(unix)]
#[test]
fn tiles_that_cannot_be_read_are_bad_input_in_every_command() {
    let folder = Folder::new();
    let head = "ply\nformat ascii 1.0\nelement vertex 90\nproperty float x\nproperty float y\nproperty float z\n";
    std::fs::create_dir(folder.path("tiles")).expect("a folder");
    for (name, shift) in [("a", 0), ("b", 10), ("c", 20)] {
        let rows: String = (0..90).map(|at| format!("{} {} 0\n", at % 9 + shift, at / 9)).collect();
        folder.write("one.ply", format!("{head}end_header\n{rows}"));
        let written = folder.glint(["export", "one.ply", "-o", &format!("tiles/{name}.laz")]);
        assert_eq!(written.status, Some(0), "{written}");
    }
    let written = folder.glint(["index", "--catalogue", "tiles", "-o", "all.vpc"]);
    assert_eq!(written.status, Some(0), "{written}");
    let line = "[[0.0, 5.0, 0.0], [30.0, 5.0, 0.0]]";
    folder.write(
        "scene.toml",
        format!(
            "clouds = ['all.vpc']\n[[measurements]]\nkind = 'distance'\npoints = {line}\n\
                 [[profiles]]\nline = {line}\nwidth = 1\n"
        ),
    );
    let commands = [
        "info all.vpc",
        "render all.vpc -o a.png --size 64x48",
        "render all.vpc -o b.png --size 64x48 --set stream.pages=never",
        "index all.vpc",
        "index all.vpc -o all.copc.laz",
        "measure scene.toml",
        "profile scene.toml --json",
        "profile scene.toml -o profile.csv",
        "profile scene.toml -o profile.laz",
        "export all.vpc -o all.laz",
        "compare tiles/a.laz all.vpc",
        "compare all.vpc tiles/a.laz",
    ];
    let run = |words: &str| folder.glint(words.split(' '));
    for words in commands {
        let outcome = run(words);
        assert!(lacks_adapter(&outcome) || outcome.status == Some(0), "{outcome}");
    }
    for name in ["all.copc.laz", "profile.laz", "all.laz", "tiles/b.laz"] {
        std::fs::remove_file(folder.path(name)).expect("a file");
    }
    for words in commands {
        let outcome = run(words);
        if lacks_adapter(&outcome) {
            continue;
        }
        let told =
            outcome.messages.lines().filter(|line| line.starts_with("glint: all.vpc: a tile is missing: tiles/b.laz"));
        assert!(outcome.status == Some(2) && told.count() == 1, "{outcome}");
        let is_refused = outcome.messages.contains("not all of this cloud can be read, so nothing is compared");
        assert!(is_refused == words.starts_with("compare"), "{outcome}");
    }
}

#[test]
fn tiles_of_ept_that_cannot_be_read_are_bad_input_in_every_command() {
    let Some(data) = tests::test_data() else { return };
    let folder = Folder::new();
    let from = data.join("ept/lone-star-laszip");
    let mut points = 0;
    for part in ["", "ept-hierarchy", "ept-data"] {
        std::fs::create_dir_all(folder.path("ept").join(part)).expect("a folder");
        for file in std::fs::read_dir(from.join(part)).expect("a folder").flatten().map(|entry| entry.path()) {
            if file.is_file() {
                let to = folder.path("ept").join(part).join(file.file_name().expect("a name"));
                std::fs::copy(file, to).expect("a copy");
            }
        }
    }
    // Some of its tiles, two of them by a list of their own, are as telling as all.
    let read = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(folder.path(name)).expect("a file")).expect("JSON")
    };
    let mut nodes = read("ept/ept-hierarchy/0-0-0-0.json");
    let few = ["0-0-0-0", "1-0-0-0", "1-1-1-0", "2-2-2-1"];
    nodes.as_object_mut().expect("nodes").retain(|node, _| few.contains(&node.as_str()));
    folder.write("ept/ept-hierarchy/0-0-0-0.json", nodes.to_string());
    let lists = [nodes, read("ept/ept-hierarchy/2-2-2-1.json")];
    let counts = lists.iter().filter_map(serde_json::Value::as_object).flat_map(|list| list.values());
    let mut about = read("ept/ept.json");
    about["points"] = counts.filter_map(serde_json::Value::as_u64).sum::<u64>().into();
    folder.write("ept/ept.json", about.to_string());
    let whole = folder.path("ept/ept-data/0-0-0-0.laz").display().to_string();
    for tile in ["1-0-0-0", "2-2-2-1"] {
        let path = folder.path(&format!("ept/ept-data/{tile}.laz"));
        let info = folder.glint(["info", "--json", &path.display().to_string()]).json();
        points += info["inputs"][0]["points"].as_u64().expect("a number");
        std::fs::write(path, "no tile").expect("a file");
    }
    let line = "--line 515360,4918340,2320:515420,4918340,2320 --width 3";
    folder.write(
        "scene.toml",
        "clouds = ['ept']\n[[measurements]]\nkind = 'distance'\npoints = [[515380.0, 4918340.0, 2330.0], [515390.0, 4918340.0, 2330.0]]\n",
    );
    let clip = "shape = 'box'\nposition = [515385.0, 4918345.0, 2330.0]\nsize = [10.0, 10.0, 100.0]\nkeep = 'inside'\n";
    folder.write("near.toml", format!("clouds = ['ept']\n[[clips]]\n{clip}"));
    let commands = [
        "info ept".to_owned(),
        "render ept -o a.png --size 64x48 --set stream.pages=never --set light.by=headlight".to_owned(),
        "render ept -o b.png --size 640x480 --set stream.pages=always --set light.by=headlight".to_owned(),
        "measure scene.toml".to_owned(),
        format!("profile ept {line} --json"),
        "export ept -o ept.laz".to_owned(),
        format!("compare ept {whole}"),
        format!("compare {whole} ept"),
        "ghosts ept --station 515380,4918340,2400".to_owned(),
        "surfaces near.toml".to_owned(),
    ];
    let number = format!("{},{:03} points", points / 1000, points % 1000);
    for words in commands {
        let outcome = folder.glint(words.split(' '));
        if lacks_adapter(&outcome) {
            continue;
        }
        // A view may not need all of them.
        let told = if words.contains("always") { "points of the inputs cannot be read" } else { &number };
        assert!(outcome.status == Some(2) && outcome.messages.contains(told), "{told}: {outcome}");
        let is_refused = outcome.messages.contains("not all of this cloud can be read, so nothing is compared");
        assert!(is_refused == words.starts_with("compare"), "{outcome}");
    }
}

#[test]
fn files_without_permission_are_bad_input_in_every_command() {
    use std::os::unix::fs::PermissionsExt as _;
    // In a namespace where it is mapped to nobody even root may not read what nobody may.
    let can = Command::new("unshare").args(["-U", "true"]).output().is_ok_and(|output| output.status.success());
    if !can {
        assert!(std::env::var_os("CI").is_none(), "no namespaces of users here, and CI is set");
        return println!("skipped: `unshare -U` does not work here");
    }
    let folder = Folder::new();
    las(&folder, "secret.las", 10);
    folder.write("secret.toml", PLAN);
    for name in ["secret.las", "secret.toml"] {
        std::fs::set_permissions(folder.path(name), std::fs::Permissions::from_mode(0o000)).expect("its permissions");
    }
    let mut commands = readers("secret.las");
    commands.retain(|command| !["view", "record"].contains(&command[0]));
    commands.extend(readers("secret.toml"));
    commands.push(vec!["study", "secret.toml", "-o", "results"]);
    commands.push(vec!["render", SCENE, "-o", "picture.png", "--camera", "secret.toml"]);
    for command in commands {
        let outcome = within(&folder, &["-U"], "", &command);
        if !lacks_adapter(&outcome) {
            assert_failed(&outcome, 2, &["Permission denied", "secret."]);
        }
    }
}

#[test]
fn a_word_that_is_nearly_a_command_is_taken_for_one() {
    let folder = Folder::new();
    folder.write("cloud.ply", "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n");
    for words in [&["rendr", "cloud.ply"][..], &["rendr"]] {
        assert_failed(&folder.glint(words), 2, &["neither a file nor a command; did you mean `glint render`?"]);
    }
}

#[test]
fn bad_words_are_bad_usage_in_every_command() {
    let folder = Folder::new();
    las(&folder, "cloud.las", 10);
    folder.write("plan.toml", PLAN);
    folder.write("tour.toml", format!("clouds = ['{SCENE}']\n{PATH}"));
    let set = |value: &'static str| {
        let commands = [
            vec!["render", SCENE, "-o", "picture.png"],
            vec!["record", "tour.toml", "-o", "pictures"],
            vec!["index", "cloud.las"],
            vec!["study", "plan.toml", "-o", "results"],
            vec!["surfaces", "cloud.las"],
            vec!["export", "cloud.las", "-o", "out.laz"],
            vec!["view", "cloud.las"],
        ];
        commands.map(|command| [command, vec!["--set", value]].concat())
    };
    for command in set("splat.sise=1") {
        assert_failed(&folder.glint(&command), 2, &["no such parameter; did you mean `splat.size`?"]);
    }
    for command in set("splat.size=99") {
        assert_failed(&folder.glint(&command), 2, &["expected 0.05 to 20"]);
    }
    for command in [
        "info", "render", "record", "index", "methods", "scenes", "study", "surfaces", "profile", "measure", "export",
        "ghosts", "doctor", "view",
    ] {
        assert_failed(&folder.glint([command, "--nonsense"]), 2, &["unexpected argument '--nonsense' found"]);
    }
    let record = ["record", "tour.toml", "-o", "pictures"];
    for words in [&["--path", "tour"][..], &["--frames", "0..2"]] {
        assert_failed(&folder.glint([&record, words].concat()), 2, &["still"]);
    }
    for command in [&["render", SCENE, "-o", "picture.png"][..], &["study", "plan.toml", "-o", "results"], &record] {
        let outcome = folder.glint([command, &["--gpu", "no such adapter"]].concat());
        assert_failed(&outcome, 3, &[]);
    }
}

#[test]
fn outputs_that_cannot_be_written_are_a_failure_of_the_work_in_every_command() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("place")).expect("a folder");
    las(&folder, "cloud.las", 100_000);
    folder.write("plan.toml", PLAN);
    folder.write("tour.toml", format!("clouds = ['{SCENE}']\n{PATH}"));
    let record = |output: &'static str| [&["record", "tour.toml", "-o", output][..], &SMALL].concat();
    let picture = [&["render", SCENE][..], &SMALL].concat();
    let with = |words: &[&'static str]| [&picture, words].concat();
    let commands = |place: &'static str| -> Vec<Vec<&str>> {
        match place {
            "place" => vec![
                with(&["-o", "place/a.png"]),
                with(&["-o", "a.png", "--aov", "depth=place/a.exr"]),
                with(&["-o", "a.png", "--stats", "place/a.json"]),
                vec!["index", "cloud.las", "-o", "place/a.copc.laz"],
                vec!["export", "cloud.las", "-o", "place/a.las"],
                record("place/a."),
                record("place"),
                vec!["study", "plan.toml", "--size", "64x48", "--set", FEW_POINTS, "-o", "place"],
            ],
            _ => vec![
                with(&["-o", "gone/a.png"]),
                with(&["-o", "a.png", "--aov", "depth=gone/a.exr"]),
                with(&["-o", "a.png", "--stats", "gone/a.json"]),
                vec!["index", "cloud.las", "-o", "gone/a.copc.laz"],
                vec!["export", "cloud.las", "-o", "gone/a.laz"],
                record("gone/a."),
            ],
        }
    };
    for command in commands("gone") {
        let told = "cannot be written: there is no such folder; make it first, or name another place";
        assert_failed(&folder.glint(&command), 1, &[told, "gone/a."]);
    }
    if !can_mount() {
        return;
    }
    for (setting, reason) in [
        (READ_ONLY, "cannot be written: its disk can only be read; name another place"),
        (FULL, "cannot be written: the disk is full; make room there, or name another place"),
    ] {
        for command in commands("place") {
            let outcome = within(&folder, &["-rm"], &format!("{setting} || exit 99"), &command);
            if !lacks_adapter(&outcome) {
                assert_failed(&outcome, 1, &[reason, "place/"]);
            }
        }
    }
    let full = |setting: &str, words: &[&str]| within(&folder, &["-rm"], setting, words);
    for words in [&["methods"][..], &["scenes", "--json"], &["info", "cloud.las"], &["--help"]] {
        let outcome = full("exec > /dev/full", words);
        assert_failed(&outcome, 1, &["standard output: cannot be written: the disk is full"]);
    }
}

/// What is left in the pipe then is not taken for the file.
#[test]
fn standard_input_without_room_for_it_fails_as_often_as_it_is_named() {
    if !can_mount() {
        return;
    }
    let folder = Folder::new();
    folder.write("points.xyz", "1 2 3\n".repeat(15_000));
    let setting = "mkdir place && mount -t tmpfs -o size=64k none place && export TMPDIR=place && exec < points.xyz";
    let outcome = within(&folder, &["-rm"], &format!("{setting} || exit 99"), &["info", "-", "-"]);
    assert!(outcome.status == Some(2) && outcome.text().is_empty(), "{outcome}");
    let told = "glint: -: cannot be kept in the temporary folder place: the disk is full; TMPDIR can name another\n";
    assert_eq!(outcome.messages, told.repeat(2), "{outcome}");
}

#[test]
fn a_cache_that_cannot_be_written_is_a_failure_of_the_work_in_every_command() {
    if !can_mount() {
        return;
    }
    let folder = Folder::new();
    std::fs::create_dir(folder.path("place")).expect("a folder");
    las(&folder, "cloud.las", 100_000);
    let render = [&["render", "cloud.las", "-o", "a.png", "--set", "stream.pages=always"][..], &SMALL].concat();
    for (setting, reason) in [
        (READ_ONLY, "the cache cannot be written: its disk can only be read"),
        (FULL, "the cache cannot be written: the disk is full"),
    ] {
        let setting = format!("{setting} || exit 99\nexport GLINT_CACHE_DIR=place");
        for command in [&["index", "cloud.las"][..], &render] {
            let outcome = within(&folder, &["-rm"], &setting, command);
            if !lacks_adapter(&outcome) {
                assert_failed(&outcome, 1, &[reason, "GLINT_CACHE_DIR can name another folder"]);
            }
        }
    }
    assert!(!folder.path("a.png").exists());
}

/// Names of all that lies in a folder and below.
fn names(folder: &Path) -> Vec<OsString> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let below = entries.flat_map(|entry| [vec![entry.file_name()], names(&entry.path())].concat());
    below.collect()
}

/// Waits until a program has ended or has worked for a second of a processor; for three seconds where the system does
/// not say how long it has.
fn wait_for_work(program: &mut Child) {
    const TICKS_A_SECOND: u64 = 100;
    let ticks = |id| {
        let status = std::fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
        // The times in user and system code are the 14th and 15th word; the second word is a name in brackets.
        let words = status.rsplit_once(')')?.1.split_whitespace().skip(11).take(2);
        words.map(|word| word.parse::<u64>().ok()).sum::<Option<u64>>()
    };
    let start = Instant::now();
    while program.try_wait().expect("a child").is_none() {
        let is_busy = ticks(program.id()).map(|ticks| ticks >= TICKS_A_SECOND);
        if is_busy.unwrap_or(start.elapsed() > Duration::from_secs(3)) {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Whether programs that are started here ignore that their terminal is closed.
fn ignores_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_none_or(|mask| mask & 1 == 1)
}

#[cfg(unix)]
#[test]
fn a_program_that_nohup_starts_outlives_its_terminal() {
    let folder = Folder::new();
    las(&folder, "large.las", 200_000_000);
    let of_glint = folder.command(["info", "--scan", "large.las"]);
    let mut shell = Command::new("sh");
    shell.args(["-c", "trap '' HUP; exec \"$@\"", "sh"]).arg(of_glint.get_program()).args(of_glint.get_args());
    for (name, value) in of_glint.get_envs() {
        match value {
            Some(value) => shell.env(name, value),
            None => shell.env_remove(name),
        };
    }
    shell.current_dir(folder.path("")).stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
    let mut program = shell.spawn().expect("the program starts");
    wait_for_work(&mut program);
    let send = |signal: &str| Command::new("kill").args([signal, &program.id().to_string()]).status();
    assert!(send("-HUP").is_ok_and(|status| status.success()));
    std::thread::sleep(Duration::from_secs(1));
    let sent = send("-TERM");
    assert!(sent.is_ok_and(|status| status.success()));
    assert_eq!(program.wait().expect("its end").code(), Some(143));
}

#[test]
fn ctrl_c_and_signals_end_every_command_and_leave_no_partial_files() {
    let folder = Folder::new();
    // Many seconds of work, whatever is done with them.
    las(&folder, "large.las", 200_000_000);
    let many = PLAN.replace("repeats = 1", "repeats = 1000");
    folder.write("plan.toml", many);
    let render = [&["render", "large.las", "-o", "a.png"][..], &SMALL].concat();
    folder.write("tour.toml", format!("clouds = ['{SCENE}']\n{PATH}{LONG_PATH}"));
    let record = [&["record", "tour.toml", "-o", "pictures"][..], &SMALL].concat();
    let commands: [&[&str]; 7] = [
        &["info", "--scan", "large.las"],
        &["export", "large.las", "-o", "exported.copc.laz"],
        &["index", "large.las"],
        &["index", "large.las", "-o", "a.copc.laz"],
        &render,
        &record,
        &["study", "plan.toml", "--size", "64x48", "--set", FEW_POINTS, "-o", "results"],
    ];
    let ends = commands.map(|words| (words, &["-INT"][..], 130)).into_iter();
    // A shell and the system each send the signal of a terminal that is closed, and sessions end with both signals.
    let signals: [(&[&str], i32); 3] = [(&["-TERM"], 143), (&["-TERM", "-HUP"], 143), (&["-HUP", "-HUP"], 129)];
    let signals = signals.map(|(signals, status)| (commands[1], signals, status));
    for (words, signals, status) in ends.chain(signals) {
        if signals.contains(&"-HUP") && ignores_hangup() {
            println!("skipped: SIGHUP is ignored");
            continue;
        }
        let mut command = folder.command(words);
        command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
        let mut program = command.spawn().expect("the program starts");
        wait_for_work(&mut program);
        if let Some(status) = program.try_wait().expect("a child") {
            // Without an adapter there is nothing to interrupt.
            assert!(status.code() == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none(), "{words:?}: {status}");
            println!("skipped: no adapter for {words:?}");
            continue;
        }
        let pressed = Instant::now();
        for signal in signals {
            // A program that has ended already has stopped in time.
            let _ = Command::new("kill").args([*signal, &program.id().to_string()]).status();
            std::thread::sleep(Duration::from_millis(20));
        }
        let output = program.wait_with_output().expect("its end");
        assert!(pressed.elapsed() < PATIENCE, "{words:?} ended after {:?}", pressed.elapsed());
        let messages = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(status), "{words:?}: {messages}");
        assert_eq!(messages, "glint: interrupted\n", "{words:?}");
        for name in names(&folder.path("")) {
            let name = name.to_string_lossy();
            let is_partial = [".partial", ".unfinished", "a.png", "copc.laz"].iter().any(|part| name.contains(part));
            assert!(!is_partial && name != "building", "{words:?} left {name}");
        }
    }
}

#[test]
fn two_interruptions_end_a_program_whose_output_nobody_reads() {
    let folder = Folder::new();
    let mut command = folder.command(["methods", "--json"]);
    command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    let mut program = command.spawn().expect("the program starts");
    // It writes more than a pipe holds, and waits for a reader for ever.
    let start = Instant::now();
    while !catches_interruptions(program.id()).unwrap_or(start.elapsed() > Duration::from_secs(5)) {
        assert!(start.elapsed() < PATIENCE, "it does not catch signals");
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(Duration::from_millis(500));
    assert!(program.try_wait().expect("a child").is_none(), "all of its output fits into the pipe");
    for _ in 0..2 {
        let _ = Command::new("kill").args(["-INT", &program.id().to_string()]).status();
        std::thread::sleep(Duration::from_millis(50));
    }
    let pressed = Instant::now();
    let status = loop {
        if let Some(status) = program.try_wait().expect("a child") {
            break status;
        }
        if pressed.elapsed() > PATIENCE {
            let _ = program.kill();
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert_eq!(status.code(), Some(130), "after {:?}", pressed.elapsed());
}

/// Whether a process catches SIGINT; `None` where the system does not say.
fn catches_interruptions(id: u32) -> Option<bool> {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).ok()?;
    let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:"))?;
    Some(u64::from_str_radix(mask.trim(), 16).ok()? & 1 << 1 != 0)
}
