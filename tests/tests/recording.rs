//! Pictures along a path of the camera: over a streamed cloud, frame by frame the same as `glint render` gives and as any other
//! recording of the same path.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tests::server::{Habits, Server};
use tests::{Folder, Outcome, lacks_adapter, test_data};

/// Longer than any step of a run on a busy machine.
const PATIENCE: Duration = Duration::from_secs(240);

/// A hilly square of coloured points with blocks on it, as binary PLY.
fn hills(points: u32) -> Vec<u8> {
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {points}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
    )
    .into_bytes();
    for index in 0..points {
        // Steps of the plastic number fill the square evenly.
        let [x, y] = [0.754_877_666, 0.569_840_29].map(|step: f64| (f64::from(index) * step).fract() * 100.0);
        let is_block = (x / 20.0).fract() < 0.3 && (y / 25.0).fract() < 0.3;
        let z = if is_block { 9.0 } else { 4.0 * (x / 9.0).sin() * (y / 14.0).cos() };
        file.extend([x, y, z].iter().flat_map(|value| (*value as f32).to_le_bytes()));
        file.extend([x * 2.5, 140.0 + z * 10.0, y * 2.5].map(|value| value as u8));
    }
    file
}

const FIRST_EYE: &str = "eye = [20.0, -30.0, 40.0]\npivot = [50.0, 40.0, 0.0]\nup = [0.0, 0.0, 1.0]\n";
const LAST_EYE: &str = "eye = [95.0, 90.0, 15.0]\npivot = [50.0, 50.0, 0.0]\nup = [0.0, 0.1, 1.0]\n";

/// A scene of a streamed cloud that is seen from the beginning of a path. The path leads to its other end in 0.4 seconds and stays
/// there until 0.5.
fn streamed_scene() -> String {
    format!(
        "clouds = [\"hills.ply\"]\n[camera]\n{FIRST_EYE}[parameters]\n\"stream.pages\" = \"always\"\n\"gi.vpls\" = 16\n\
         [[paths]]\nname = \"tour\"\n[[paths.keyframes]]\ntime = 0.0\n{FIRST_EYE}\
         [[paths.keyframes]]\ntime = 0.4\n{LAST_EYE}[[paths.keyframes]]\ntime = 0.5\n{LAST_EYE}"
    )
}

/// A folder with the scene and its cloud of so many points.
fn folder(points: u32) -> Folder {
    let folder = Folder::new();
    folder.write("hills.ply", hills(points));
    folder.write("tour.toml", streamed_scene());
    folder
}

fn record(folder: &Folder, output: &str, words: &[&str]) -> Outcome {
    let common = ["record", "tour.toml", "-o", output, "--size", "96x64", "--fps", "10"];
    folder.glint_within(PATIENCE, common.iter().chain(words))
}

/// Names of all that lies in a folder beside what says what the pictures are of, in their order.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.filter(|name| name != "record.json").collect();
    names.sort();
    names
}

fn bytes(path: PathBuf) -> Vec<u8> {
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The bytes of a picture without the text that says which frame of which recording it is, and which a render has not.
fn unnamed(path: PathBuf) -> Vec<u8> {
    let mut bytes = bytes(path);
    let kind = b"tEXtRecording\0";
    if let Some(at) = bytes.windows(kind.len()).take(1000).position(|own| own == kind) {
        let length = bytes[at - 4..at].iter().fold(0, |length, byte| length << 8 | usize::from(*byte));
        bytes.drain(at - 4..at + 4 + length + 4);
    }
    bytes
}

/// What a picture was drawn from.
fn stats(folder: &Folder, output: &str, frame: usize) -> serde_json::Value {
    let file = folder.path(output).join(format!("frame-{frame:06}.json"));
    serde_json::from_slice(&bytes(file)).expect("JSON")
}

/// Holds that a picture of the hills lacks no node that its view needs.
fn all_nodes_are_there(stats: &serde_json::Value, points: u32) {
    let stream = &stats["stream"];
    assert_eq!((&stream["settled"], &stream["nodes_missing"]), (&true.into(), &0.into()), "{stats}");
    assert!(stream["nodes"].as_u64().is_some_and(|nodes| nodes > 0), "{stats}");
    assert_eq!(stream["points_total"], points, "{stats}");
}

#[test]
fn a_frame_that_lacks_points_of_a_failing_server_is_made_by_the_next_run() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let name = "lone_star_las14_pf6.copc.laz";
    let server = Server::of_folder(&data.join("copc"), Habits::default());
    // All that the opening asks for, and of the nodes of the first frame the first one.
    server.fail_after(19);
    let address = server.path(name).display().to_string();
    let common = ["--size", "96x64", "--set", "view.point_budget=100000", "--set", "gi.bounces=0"];
    let words =
        ["record", &address, "--path", "turntable", "-o", "turn.gif", "--fps", "1", "--frames", "0..2", "--stats"];
    let record = || folder.glint_within(PATIENCE, words.iter().chain(&common));
    let outcome = record();
    if lacks_adapter(&outcome) {
        return;
    }
    assert_eq!(outcome.status, Some(2), "{outcome}");
    let told = "glint: frame 0 is not made: it lacks points that cannot be read now";
    assert!(outcome.messages.contains(told) && outcome.text().is_empty(), "{outcome}");
    assert_eq!(names(&folder.path("turn.frames")), [""; 0]);
    assert!(!folder.path("turn.gif").exists());
    // A single picture shows what is there, and says so.
    server.fail_after(server.requests() + 3);
    let render = ["render", &address, "-o", "a.png", "--stats", "a.json", "--set", "stream.pages=always"];
    let outcome = folder.glint_within(PATIENCE, render.iter().chain(&common));
    assert_eq!(outcome.status, Some(2), "{outcome}");
    let drawn: serde_json::Value = serde_json::from_slice(&bytes(folder.path("a.json"))).expect("JSON");
    let stream = &drawn["stream"];
    assert_eq!(stream["settled"], false, "{drawn}");
    assert!(["nodes_missing", "points_missing"].iter().all(|key| stream[*key].as_u64() > Some(0)), "{drawn}");

    server.fail_after(0);
    let outcome = record();
    assert_eq!((outcome.status, outcome.messages.as_str()), (Some(0), ""), "{outcome}");
    assert!(outcome.text().starts_with("2 pictures in turn.frames\n"), "{outcome}");
    let stream = &stats(&folder, "turn.frames", 1)["stream"];
    assert!(stream["settled"] == true && stream["nodes_missing"] == 0 && stream["points_missing"] == 0, "{stream}");
}

#[test]
fn a_path_over_a_streamed_cloud_is_recorded_as_it_is_rendered_and_the_same_each_time() {
    let folder = folder(150_000);
    let outcome = record(&folder, "pictures", &["--path", "tour"]);
    if lacks_adapter(&outcome) {
        return;
    }
    assert_eq!((outcome.status, outcome.messages.as_str()), (Some(0), ""), "{outcome}");
    assert_eq!(outcome.text(), "5 pictures in pictures\n");
    let pictures = names(&folder.path("pictures"));
    assert_eq!(pictures, (0..5).map(|frame| format!("frame-{frame:06}.png")).collect::<Vec<_>>());
    let picture = |at: &str, frame: usize| bytes(folder.path(at).join(&pictures[frame]));
    let unnamed = |frame: usize| unnamed(folder.path("pictures").join(&pictures[frame]));

    folder.write("end.toml", streamed_scene().replacen(FIRST_EYE, LAST_EYE, 1));
    for (scene, frame, name) in [("tour.toml", 0, "first.png"), ("end.toml", 4, "last.png")] {
        let rendered = folder.glint(["render", scene, "-o", name, "--size", "96x64"]);
        assert_eq!(rendered.status, Some(0), "{rendered}");
        assert!(unnamed(frame) == bytes(folder.path(name)), "frame {frame} is another than a render");
    }
    let first = image::open(folder.path("first.png")).expect("a PNG").into_rgba8();
    assert!(tests::colors(&first) > 100, "{} colours", tests::colors(&first));
    for frame in 1..5 {
        assert!(unnamed(frame) != unnamed(frame - 1), "frame {frame} shows no other view");
    }

    let again = record(&folder, "again", &["--stats"]);
    assert_eq!(again.status, Some(0), "{again}");
    for frame in 0..5 {
        assert!(picture("again", frame) == picture("pictures", frame), "frame {frame} is another the second time");
        all_nodes_are_there(&stats(&folder, "again", frame), 150_000);
    }

    for frame in [1, 2] {
        let time = format!("{}", frame as f64 / 10.0);
        let words = ["render", "tour.toml", "-o", "then.png", "--size", "96x64", "--path", "tour", "--time", &time];
        let then = folder.glint_within(PATIENCE, words);
        assert_eq!((then.status, then.messages.as_str()), (Some(0), ""), "{then}");
        assert!(unnamed(frame) == bytes(folder.path("then.png")), "frame {frame} is another by itself");
    }

    // What was seen on the way there leaves no trace.
    let part = record(&folder, "part", &["--frames", "3..4"]);
    assert_eq!(part.text(), "1 pictures in part\n", "{part}");
    assert_eq!(names(&folder.path("part")), [pictures[3].as_str()]);
    assert!(picture("part", 3) == picture("pictures", 3), "the frame depends on those before it");
}

/// The number of points that are drawn follows the keys, as if each were the scene's own, and rises again after it fell.
#[test]
fn the_point_budget_and_the_detail_change_along_a_path() {
    let folder = folder(400_000);
    let track = |key: &str, times: &str, values: &str, ease: &str| {
        format!("[[paths.tracks]]\nkey = \"{key}\"\ntimes = {times}\nvalues = {values}\nease = \"{ease}\"\n")
    };
    let keys = track("view.point_budget", "[0.0, 0.4, 0.8]", "[400000, 100000, 400000]", "linear")
        + &track("stream.detail", "[0.0, 0.6]", "[0.25, 8.0]", "hold");
    let scene = streamed_scene().replacen("\"gi.vpls\" = 16", "\"gi.bounces\" = 0", 1);
    let still = &scene[..scene.find("[[paths.keyframes]]\ntime = 0.4").expect("the second keyframe")];
    folder.write("tour.toml", format!("{still}{keys}"));
    let words = "record tour.toml -o budgets --size 192x128 --fps 10 --frames 2..7 --stats";
    let recorded = folder.glint_within(PATIENCE, words.split(' '));
    if lacks_adapter(&recorded) {
        return;
    }
    assert_eq!((recorded.status, recorded.messages.as_str()), (Some(0), ""), "{recorded}");
    let points = |frame: usize| {
        let stats = stats(&folder, "budgets", frame);
        all_nodes_are_there(&stats, 400_000);
        stats["points"].as_u64().expect("a count")
    };
    let counts: Vec<u64> = (2..7).map(points).collect();
    for (count, budget) in counts.iter().zip([250_000, 175_000, 100_000, 175_000]) {
        assert!((budget * 2 / 3..=budget).contains(count), "{counts:?}");
    }
    assert!(counts[4] < 50_000, "with little detail: {counts:?}");
    let sets = [
        (2, "view.point_budget=250000", "stream.detail=0.25"),
        (5, "view.point_budget=175000", "stream.detail=0.25"),
        (6, "view.point_budget=250000", "stream.detail=8"),
    ];
    for (frame, budget, detail) in sets {
        let words = ["render", "tour.toml", "-o", "still.png", "--size", "192x128", "--set", budget, "--set", detail];
        let still = folder.glint_within(PATIENCE, words);
        assert_eq!(still.status, Some(0), "{still}");
        let picture = unnamed(folder.path(&format!("budgets/frame-{frame:06}.png")));
        assert!(picture == bytes(folder.path("still.png")), "frame {frame}: {budget}, {detail}");
    }
}

#[test]
fn inputs_that_cannot_be_shown_are_said_and_leave_no_folder() {
    let folder = folder(20_000);
    folder.write("odd.las", "this is no point cloud");
    let scene = |clouds: &str| streamed_scene().replace("\"hills.ply\"", clouds);
    folder.write("tour.toml", scene("\"odd.las\""));
    let outcome = record(&folder, "pictures", &[]);
    if lacks_adapter(&outcome) {
        return;
    }
    assert_eq!(outcome.status, Some(2), "{outcome}");
    assert!(outcome.messages.contains("odd.las: not a file of a known format"), "{outcome}");
    assert_eq!((outcome.messages.lines().count(), folder.path("pictures").exists()), (1, false), "{outcome}");
    // The others are shown.
    folder.write("tour.toml", scene("\"odd.las\", \"hills.ply\""));
    let outcome = record(&folder, "pictures", &["--frames", "4..5"]);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    assert_eq!(outcome.messages.lines().count(), 1, "{outcome}");
    assert_eq!(names(&folder.path("pictures")), ["frame-000004.png"]);
}

#[test]
fn two_shards_and_a_recording_that_goes_on_make_the_same_pictures_as_one_run() {
    let folder = folder(150_000);
    let whole = record(&folder, "whole", &[]);
    if lacks_adapter(&whole) {
        return;
    }
    assert_eq!(whole.status, Some(0), "{whole}");
    let is_whole = |at: &str| {
        assert_eq!(names(&folder.path(at)), names(&folder.path("whole")), "{at}");
        for name in names(&folder.path("whole")) {
            assert!(bytes(folder.path(at).join(&name)) == bytes(folder.path("whole").join(&name)), "{at}/{name}");
        }
    };
    let second = record(&folder, "shards", &["--shard", "2/2"]);
    assert_eq!(second.text(), "2 pictures in shards\n", "{second}");
    assert_eq!(names(&folder.path("shards")), ["frame-000001.png", "frame-000003.png"]);
    let first = record(&folder, "shards", &["--shard", "1/2"]);
    assert_eq!(first.text(), "3 pictures in shards\n", "{first}");
    is_whole("shards");

    // One picture is gone and one was cut off. Those that are there are not made again.
    let cut = folder.path("shards/frame-000002.png");
    let half = bytes(cut.clone());
    std::fs::write(&cut, &half[..half.len() / 2]).expect("a file that can be written");
    std::fs::remove_file(folder.path("shards/frame-000004.png")).expect("the picture");
    let kept =
        || std::fs::metadata(folder.path("shards/frame-000000.png")).and_then(|kept| kept.modified()).expect("it");
    let before = kept();
    let again = record(&folder, "shards", &[]);
    assert_eq!(again.text(), "5 pictures in shards, 3 of them were there\n", "{again}");
    is_whole("shards");
    assert_eq!(kept(), before);

    // A whole picture that says it is something else is neither taken nor replaced. One that says nothing is taken.
    let third = folder.path("shards/frame-000003.png");
    std::fs::rename(&third, folder.path("kept.png")).expect("the picture");
    let first = bytes(folder.path("shards/frame-000001.png"));
    std::fs::write(&third, &first).expect("a copy");
    let refused = record(&folder, "shards", &[]);
    assert_eq!(refused.status, Some(2), "{refused}");
    assert!(refused.messages.contains("frame-000003.png: it is no picture of this recording"), "{refused}");
    assert!(bytes(third.clone()) == first);
    std::fs::write(&third, unnamed(folder.path("kept.png"))).expect("a picture");
    let taken = record(&folder, "shards", &[]);
    assert_eq!(taken.text(), "5 pictures in shards, 5 of them were there\n", "{taken}");
    std::fs::rename(folder.path("kept.png"), &third).expect("the picture");

    for (words, told) in [
        (
            "--set splat.size=2 --fps 10 --size 96x64",
            "record.json: its pictures are drawn with splat.size = its default",
        ),
        ("--fps 20 --size 96x64", "record.json: its pictures are 10 a second"),
        ("--fps 10 --size 64x96", "record.json: its pictures have 96x64 pixels"),
        ("--fps 10 --size 96x64 --path turntable", "record.json: its pictures are of"),
    ] {
        let refused = folder.glint_within(PATIENCE, "record tour.toml -o shards".split(' ').chain(words.split(' ')));
        assert_eq!(refused.status, Some(2), "{refused}");
        assert!(refused.messages.contains(told) && refused.messages.lines().count() == 1, "{refused}");
    }
    folder.write("tour.toml", streamed_scene().replace("95.0, 90.0", "95.0, 91.0"));
    let refused = record(&folder, "shards", &[]);
    assert!(refused.messages.contains("record.json: its pictures are of another scene"), "{refused}");
    is_whole("shards");
}

#[test]
fn built_in_paths_need_no_scene_file() {
    let folder = Folder::new();
    folder.write("hills.ply", hills(20_000));
    let mut ends = Vec::new();
    for path in ["turntable", "orbit", "flight"] {
        let few = ["--size", "96x64", "--fps", "1", "--frames", "2..4", "--set", "gi.bounces=0"];
        let recorded =
            folder.glint_within(PATIENCE, ["record", "hills.ply", "--path", path, "-o", path].iter().chain(&few));
        if lacks_adapter(&recorded) {
            return;
        }
        assert_eq!((recorded.status, recorded.messages.as_str()), (Some(0), ""), "{recorded}");
        let words = ["--path", path, "--time", "3", "--size", "96x64", "--set", "gi.bounces=0"];
        let then = folder.glint_within(PATIENCE, ["render", "hills.ply", "-o", "then.png"].iter().chain(&words));
        assert_eq!(then.status, Some(0), "{then}");
        let frame = unnamed(folder.path(path).join("frame-000003.png"));
        assert!(frame == bytes(folder.path("then.png")), "{path}");
        let picture = image::load_from_memory(&frame).expect("a PNG").into_rgba8();
        assert!(tests::colors(&picture) > 100, "{path}: {} colours", tests::colors(&picture));
        ends.push(frame);
    }
    assert!(ends[0] != ends[1] && ends[1] != ends[2]);
    let all = folder.glint(["record", "hills.ply", "-o", "none"]);
    assert_eq!(all.status, Some(2), "{all}");
    assert!(all.messages.contains("name a built-in one with --path (turntable, orbit, flight)"), "{all}");
}

/// What of a streamed cloud is there while it is opened differs from run to run, and the path must not follow from it.
#[test]
fn a_built_in_path_over_a_streamed_cloud_is_the_same_each_time() {
    let folder = Folder::new();
    folder.write("hills.ply", hills(200_000));
    let common = ["--path", "flight", "--size", "96x64", "--set", "gi.bounces=0", "--set", "stream.pages=always"];
    let mut frames = Vec::new();
    for output in ["one", "two"] {
        let words = ["record", "hills.ply", "-o", output, "--fps", "1", "--frames", "3..4"];
        let recorded = folder.glint_within(PATIENCE, words.iter().chain(&common));
        if lacks_adapter(&recorded) {
            return;
        }
        assert_eq!(recorded.status, Some(0), "{recorded}");
        frames.push(folder.path(output).join("frame-000003.png"));
    }
    let words = ["render", "hills.ply", "-o", "then.png", "--time", "3"];
    let then = folder.glint_within(PATIENCE, words.iter().chain(&common));
    assert_eq!(then.status, Some(0), "{then}");
    assert!(bytes(frames[0].clone()) == bytes(frames[1].clone()));
    assert!(unnamed(frames[0].clone()) == bytes(folder.path("then.png")));
}

/// What tracks change is as if the scene file had it so, and does not depend on the frames before.
#[test]
fn tracks_move_mirrors_and_parameters() {
    let folder = Folder::new();
    let scene = |place: &str, background: &str, tracks: &str| {
        let camera = "eye = [0.0, 0.0, 1.9]\npivot = [0.0, 0.0, 0.0]\nup = [0.0, 1.0, 0.0]\n";
        format!(
            "clouds = [\"five-mirrors/none\"]\n[camera]\n{camera}[parameters]\n\"gi.bounces\" = 0\n\"scene.points\" = 20000\n\
             \"reflection.method\" = \"surfel_trace\"\n\"view.background\" = \"{background}\"\n[[mirrors]]\nname = \"ball\"\n\
             shape = \"sphere\"\nposition = {place}\nsize = 0.4\n[[paths]]\nname = \"still\"\n[[paths.keyframes]]\ntime = 0.0\n\
             {camera}{tracks}"
        )
    };
    let track = |key: &str, values: &str| {
        format!("[[paths.tracks]]\nkey = \"{key}\"\ntimes = [0.0, 1.0]\nvalues = {values}\nease = \"linear\"\n")
    };
    let tracks = track("mirrors.ball.position", "[[-0.5, 0, 0], [0.5, 0.25, 0.0]]")
        + &track("view.background", "[\"#102030\", \"#405060\"]");
    folder.write("moving.toml", scene("[0.5, 0.5, 0.5]", "#ffffff", &tracks));
    let words = "record moving.toml -o moving --size 96x64 --fps 4 --frames 1..4";
    let recorded = folder.glint_within(PATIENCE, words.split(' '));
    if lacks_adapter(&recorded) {
        return;
    }
    assert_eq!((recorded.status, &*recorded.text()), (Some(0), "3 pictures in moving\n"), "{recorded}");
    for (frame, place) in [(2, "[0.0, 0.125, 0.0]"), (3, "[0.25, 0.1875, 0.0]")] {
        folder.write("there.toml", scene(place, "#102030", ""));
        let there = folder.glint_within(PATIENCE, "render there.toml -o there.png --size 96x64".split(' '));
        assert_eq!(there.status, Some(0), "{there}");
        let picture = unnamed(folder.path(&format!("moving/frame-{frame:06}.png")));
        assert!(picture == bytes(folder.path("there.png")), "frame {frame}");
    }
    let then = "render moving.toml -o then.png --size 96x64 --time 0.75 --aov mirror=mirror.exr";
    assert_eq!(folder.glint_within(PATIENCE, then.split(' ')).status, Some(0));
    assert!(bytes(folder.path("then.png")) == unnamed(folder.path("moving/frame-000003.png")));
    assert!(folder.path("mirror.exr").exists());

    let wrong = [
        ("mirrors.bal.position", "[[0, 0, 0], [1, 0, 0]]", "no mirror is called `bal`; there are: ball"),
        ("mirrors.ball.size", "[1, -1]", "at 0.5 s: size is 0, expected more than 0"),
        ("sun.elevatio", "[1, 2]", "track 1: key: sun.elevatio: no such parameter"),
        ("mirrors.ball.place", "[1, 2]", "a mirror has no `place`"),
    ];
    for (key, values, told) in wrong {
        folder.write("wrong.toml", scene("[0, 0, 0]", "#ffffff", &track(key, values)));
        let refused = folder.glint_within(PATIENCE, "record wrong.toml -o wrong --size 96x64 --fps 4".split(' '));
        assert_eq!(refused.status, Some(2), "{refused}");
        assert!(refused.messages.contains(told) && refused.messages.lines().count() == 1, "{refused}");
    }
}

#[test]
#[cfg(unix)]
fn ctrl_c_ends_a_recording_with_130_and_leaves_whole_pictures() {
    let folder = folder(20_000);
    // More pictures than anybody waits for.
    folder.write("tour.toml", streamed_scene().replace("time = 0.5", "time = 10000.0"));
    let words = ["record", "tour.toml", "-o", "pictures", "--size", "96x64"];
    let mut program = folder.command(words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let start = Instant::now();
    while !folder.path("pictures/frame-000001.png").exists() {
        if let Some(status) = program.try_wait().expect("a child") {
            assert!(status.code() == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none(), "{status}");
            return println!("skipped: no adapter");
        }
        assert!(start.elapsed() < PATIENCE, "no picture comes");
        std::thread::sleep(Duration::from_millis(5));
    }
    let sent = Command::new("kill").args(["-INT", &program.id().to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()));
    let output = program.wait_with_output().expect("its end");
    let messages = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), &*messages), (Some(130), "glint: interrupted\n"));
    for name in names(&folder.path("pictures")) {
        let picture =
            image::open(folder.path("pictures").join(&name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((picture.width(), picture.height()), (96, 64), "{name}");
    }
}

/// What `--error` chooses is written down, and every further run in the folder takes it from there.
#[test]
fn a_recording_for_an_error_chooses_once() {
    let folder = Folder::new();
    folder.write(
        "tour.toml",
            "clouds = [\"five-mirrors/sphere\"]\n[parameters]\n\"gi.bounces\" = 0\n\"reflection.method\" = \"surfel_trace\"\n\
             [[paths]]\nname = \"tour\"\n[[paths.keyframes]]\ntime = 0.0\neye = [0.0, 0.0, 1.9]\n\
             pivot = [0.0, 0.0, 0.0]\nup = [0.0, 1.0, 0.0]\n[[paths.keyframes]]\ntime = 0.2\neye = [0.1, 0.0, 1.9]\n\
             pivot = [0.0, 0.0, 0.0]\nup = [0.0, 1.0, 0.0]\n",
    );
    let few = ["--set", "scene.points=20000", "--error", "3dE"];
    let first = record(&folder, "pictures", &[&few[..], &["--frames", "0..1"]].concat());
    if lacks_adapter(&first) {
        return;
    }
    assert_eq!(first.status, Some(0), "{first}");
    let plan = std::fs::read_to_string(folder.path("pictures/record.json")).expect("the plan");
    let plan: serde_json::Value = serde_json::from_str(&plan).expect("JSON");
    assert_eq!((&plan["auto"]["target"], &plan["size"]), (&"3dE".into(), &serde_json::json!([96, 64])), "{plan}");
    assert!(plan["auto"]["predicted_error"].as_f64().is_some_and(|error| error <= 3.0), "{plan}");
    let again = record(&folder, "pictures", &[&few[..], &["--frames", "0..1"]].concat());
    assert_eq!(again.text(), "1 pictures in pictures, 1 of them were there\n", "{again}");
    // Another choice in the file: the second run takes it, and chooses nothing itself.
    let mut other = plan;
    other["auto"]["set"] = serde_json::json!({ "view.background": "#ff0000", "splat.step": 64 });
    folder.write("pictures/record.json", other.to_string());
    let second = record(&folder, "pictures", &[&few[..], &["--frames", "1..2"]].concat());
    assert_eq!(second.status, Some(0), "{second}");
    assert!(!second.text().contains("auto:"), "{second}");
    let words = ["render", "tour.toml", "-o", "named.png", "--size", "96x64", "--set", "scene.points=20000"];
    let camera = "[camera]\neye = [0.05, 0.0, 1.9]\npivot = [0.0, 0.0, 0.0]\nup = [0.0, 1.0, 0.0]\n";
    folder.write("view.toml", camera);
    let named = ["--camera", "view.toml", "--set", "view.background=#ff0000", "--set", "splat.step=64"];
    let named = folder.glint_within(PATIENCE, words.iter().chain(&named));
    assert_eq!(named.status, Some(0), "{named}");
    let picture = |name: &str| image::open(folder.path(name)).expect("a picture").to_rgb8();
    assert!(picture("pictures/frame-000001.png") == picture("named.png"), "drawn with what the file says");
    let refused = record(&folder, "pictures", &["--set", "scene.points=20000", "--error", "1dE"]);
    assert_eq!(refused.status, Some(2), "{refused}");
    assert!(refused.messages.contains("drawn for 3dE; ask for the same"), "{refused}");
    // What was chosen makes a picture another one than that of the command's own settings.
    let plain = ["--set", "scene.points=20000", "--frames", "1..2"];
    assert_eq!(record(&folder, "plain", &plain).status, Some(0));
    std::fs::copy(folder.path("pictures/frame-000001.png"), folder.path("plain/frame-000001.png")).expect("a copy");
    let refused = record(&folder, "plain", &plain);
    assert_eq!(refused.status, Some(2), "{refused}");
    assert!(refused.messages.contains("frame-000001.png: it is no picture of this recording"), "{refused}");
}

#[test]
fn the_exposure_of_a_path_is_that_of_its_keyframes_and_goes_evenly_between_them() {
    let folder = Folder::new();
    // Without colours the hills get a sun, and the exposure fits.
    let grey = hills(20_000);
    let end = grey.windows(10).position(|word| word == b"end_header").expect("a header");
    let text = String::from_utf8_lossy(&grey[..end]).replace("uchar red", "uchar a").replace("uchar green", "uchar b");
    folder.write("grey.ply", [text.replace("uchar blue", "uchar c").as_bytes(), &grey[end..]].concat());
    let eyes = ["[20.0, -30.0, 40.0]", "[95.0, 90.0, 15.0]"];
    let pivots = ["[50.0, 40.0, 0.0]", "[50.0, 50.0, 0.0]"];
    let at = |place: usize| format!("eye = {}\npivot = {}\nup = [0.0, 0.0, 1.0]\n", eyes[place], pivots[place]);
    let scene = |place: usize| {
        format!(
            "clouds = [\"grey.ply\"]\n[camera]\n{}[parameters]\n\"gi.vpls\" = 16\n[[paths]]\nname = \"tour\"\n\
             [[paths.keyframes]]\ntime = 0.0\n{}[[paths.keyframes]]\ntime = 0.2\n{}",
            at(place),
            at(0),
            at(1)
        )
    };
    let render = |name: &str| {
        let words = ["render", name, "-o", "still.png", "--size", "96x64", "--stats", "still.json"];
        folder.glint_within(PATIENCE, words)
    };
    let stops = || -> f32 {
        let stats: serde_json::Value = serde_json::from_slice(&bytes(folder.path("still.json"))).expect("stats");
        stats["exposure"].as_f64().expect("a fitted exposure") as f32
    };
    (0..2).for_each(|place| drop(folder.write(&format!("{place}.toml"), scene(place))));
    let last = render("1.toml");
    if lacks_adapter(&last) {
        return;
    }
    assert_eq!(last.status, Some(0), "{last}");
    let last = stops();
    assert_eq!(render("0.toml").status, Some(0));
    let (first, still) = (stops(), bytes(folder.path("still.png")));
    assert!((first - last).abs() > 0.01, "{first} and {last} are too close to tell anything");
    let words = ["record", "0.toml", "-o", "tour", "--size", "96x64", "--fps", "10"];
    let recorded = folder.glint_within(PATIENCE, words);
    assert_eq!(recorded.status, Some(0), "{recorded}");
    assert!(unnamed(folder.path("tour/frame-000000.png")) == still, "the first picture");
    let between = format!("tone.exposure={}", first + (last - first) * 0.5);
    let words = ["render", "0.toml", "-o", "still.png", "--size", "96x64", "--path", "tour", "--time", "0.1"];
    let locked = folder.glint_within(PATIENCE, words.iter().chain(&["--set", "tone.fit=locked", "--set", &between]));
    assert_eq!(locked.status, Some(0), "{locked}");
    assert!(unnamed(folder.path("tour/frame-000001.png")) == bytes(folder.path("still.png")), "{between}");
}

#[test]
fn tracks_and_states_of_a_wipe_add_their_exposure_to_the_one_that_fits() {
    let folder = Folder::new();
    // Without colours the hills get a sun, and the exposure fits; a sun that is asked for has none.
    let grey = hills(20_000);
    let end = grey.windows(10).position(|word| word == b"end_header").expect("a header");
    let text = String::from_utf8_lossy(&grey[..end]).replace("uchar red", "uchar a").replace("uchar green", "uchar b");
    folder.write("grey.ply", [text.replace("uchar blue", "uchar c").as_bytes(), &grey[end..]].concat());
    let scene = |light: &str, more: &str| {
        let keyframe = |time: u32| format!("[[paths.keyframes]]\ntime = {time}.0\n{FIRST_EYE}");
        let keyframes = [keyframe(0), keyframe(1)].concat();
        format!(
            "clouds = [\"grey.ply\"]\n[camera]\n{FIRST_EYE}[parameters]\n\"gi.bounces\" = 0\n\"light.by\" = \"{light}\"\n\
             [[paths]]\nname = \"still\"\n{keyframes}{more}"
        )
    };
    let track =
        "[[paths.tracks]]\nkey = \"tone.exposure\"\ntimes = [0.0, 1.0]\nvalues = [0.5, -1.5]\nease = \"linear\"\n";
    let states = |own: &str| format!("[[paths.states]]\n[[paths.states]]\nparameters = {{ {own} }}\n");
    let render = |words: &str| {
        let rendered = folder.glint_within(PATIENCE, format!("render a.toml -o a.png --size 96x64 {words}").split(' '));
        let is_fine = !lacks_adapter(&rendered);
        is_fine.then(|| {
            assert_eq!(rendered.status, Some(0), "{rendered}");
            image::open(folder.path("a.png")).expect("a picture").into_rgba8()
        })
    };
    let own_locked = "\"tone.fit\" = \"locked\", \"tone.exposure\" = -1.0";
    for light in ["auto", "sun"] {
        folder.write("a.toml", scene(light, ""));
        let stills =
            ["tone.exposure=0", "tone.exposure=0.5", "tone.exposure=-1", "tone.exposure=-1 --set tone.fit=locked"];
        let [Some(plain), Some(brighter), Some(darker), Some(locked)] =
            stills.map(|own| render(&format!("--set {own}")))
        else {
            return;
        };
        assert!([&brighter, &darker, &locked].iter().all(|own| **own != plain), "an exposure shows nothing");
        for (more, time, set) in [
            (track.to_owned(), "0", &brighter),
            (track.to_owned(), "0.75", &darker),
            (states("\"tone.exposure\" = -1.0"), "0.5", &darker),
            (states(own_locked), "0.5", &locked),
        ] {
            folder.write("a.toml", scene(light, &more));
            let Some(made) = render(&format!("--path still --time {time}")) else { return };
            let left = if more.starts_with("[[paths.states]]") { 48 } else { 0 };
            // The stops are sums, which round.
            let is_off = |(x, y, pixel): (u32, u32, &image::Rgba<u8>)| {
                let expected = if x < left { &plain } else { set }.get_pixel(x, y);
                pixel.0.iter().zip(expected.0).any(|(value, expected)| value.abs_diff(expected) > 1)
            };
            let off = made.enumerate_pixels().filter(|pixel| is_off(*pixel)).count();
            assert_eq!(off, 0, "{light}, at {time} of {more}: pixels of another brightness");
        }
    }
}

/// Without names nothing is drawn over the states, so each part is that of the picture which the state alone gives.
#[test]
fn a_wipe_shows_parts_of_the_pictures_of_its_states_to_the_bit() {
    let folder = Folder::new();
    let camera = "eye = [0.0, 0.0, 1.9]\npivot = [0.0, 0.0, 0.0]\nup = [0.0, 1.0, 0.0]\n";
    let scene = |states: &str, lines: &str| {
        format!(
            "clouds = [\"five-mirrors/none\"]\n[camera]\n{camera}[parameters]\n\"gi.bounces\" = 0\n\"scene.points\" = 20000\n\
             \"reflection.method\" = \"none\"\n\"tone.fit\" = \"locked\"\n[[mirrors]]\nname = \"ball\"\nshape = \"sphere\"\n\
             position = [0.1, 0.0, 0.0]\nsize = 0.6\n[[paths]]\nname = \"wipe\"\n[[paths.keyframes]]\ntime = 0.0\n{camera}{states}\
             [[paths.tracks]]\nkey = \"wipe\"\ntimes = [0.0, 1.0]\nvalues = {lines}\nease = \"linear\"\n"
        )
    };
    let traced = "[[paths.states]]\nmethod = \"ray_trace\"\n";
    let found = "[[paths.states]]\nmethod = \"surfel_trace\"\nparameters = { \"view.background\" = \"#405060\" }\n";
    let plain = "[[paths.states]]\n";
    folder.write("two.toml", scene(&[found, traced].concat(), "[1.0, 0.0]"));
    let recorded = folder.glint_within(PATIENCE, "record two.toml -o two --size 96x64 --fps 4 --stats".split(' '));
    if lacks_adapter(&recorded) {
        return;
    }
    assert_eq!((recorded.status, &*recorded.text()), (Some(0), "4 pictures in two\n"), "{recorded}");
    let picture = |name: &str| image::open(folder.path(name)).expect("a picture").into_rgba8();
    let render = |name: &str, words: &str| {
        let words = format!("render two.toml -o {name} --size 96x64 {words}");
        let rendered = folder.glint_within(PATIENCE, words.split_whitespace());
        assert_eq!((rendered.status, rendered.messages.as_str()), (Some(0), ""), "{rendered}");
        picture(name)
    };
    let states = [
        render("found.png", "--method surfel_trace --set view.background=#405060"),
        render("plain.png", ""),
        render("traced.png", "--method ray_trace"),
    ];
    assert!(states[0] != states[2] && states[1] != states[2], "the states have pictures of their own");
    let is_of = |wiped: &image::RgbaImage, edges: &[u32]| {
        wiped.enumerate_pixels().all(|(x, y, pixel)| {
            let state = edges.iter().filter(|edge| **edge <= x).count();
            states[state].get_pixel(x, y) == pixel
        })
    };
    for (frame, line) in [(0, 96), (1, 72), (2, 48), (3, 24)] {
        let wiped = picture(&format!("two/frame-{frame:06}.png"));
        assert!(is_of(&wiped, &[line, line]), "frame {frame}");
    }
    assert!(render("end.png", "--time 1") == states[2], "the right state alone");
    let then = render("then.png", "--time 0.5");
    assert!(then == picture("two/frame-000002.png"), "by itself");
    let stats: serde_json::Value = serde_json::from_slice(&bytes(folder.path("two/frame-000001.json"))).expect("JSON");
    assert_eq!(stats["method"], "surfel_trace | ray_trace", "{stats}");

    folder.write("two.toml", scene(&[found, plain, traced].concat(), "[[0.25, 0.75], [0.25, 0.75]]"));
    assert!(is_of(&render("three.png", "--time 0"), &[24, 72]), "three states");
    folder.write("two.toml", scene(&[found, traced].concat().replace("surfel_trace", "surfels"), "[1.0, 0.0]"));
    let refused = folder.glint_within(PATIENCE, "record two.toml -o wrong".split(' '));
    assert_eq!(refused.status, Some(2), "{refused}");
    assert!(
        refused.messages.contains("path 1 (`wipe`), state 1: method: `surfels` is unknown; available: "),
        "{refused}"
    );
}

/// A ball that crosses the picture, on black.
fn crossing_ball() -> Folder {
    let folder = Folder::new();
    let camera = "eye = [0.0, 0.0, 1.9]\npivot = [0.0, 0.0, 0.0]\nup = [0.0, 1.0, 0.0]\n";
    folder.write(
        "ball.toml",
        format!(
            "clouds = [\"five-mirrors/none\"]\n[camera]\n{camera}[parameters]\n\"gi.bounces\" = 0\n\"scene.points\" = 20000\n\
             \"reflection.method\" = \"none\"\n[[mirrors]]\nname = \"ball\"\nshape = \"sphere\"\n\
             position = [0.0, 0.0, 0.0]\nsize = 0.4\n[[paths]]\nname = \"crossing\"\n[[paths.keyframes]]\ntime = 0.0\n\
             {camera}[[paths.tracks]]\nkey = \"mirrors.ball.position\"\ntimes = [0.0, 1.0]\n\
             values = [[-0.6, 0, 0], [0.6, 0, 0]]\nease = \"linear\"\n"
        ),
    );
    folder
}

/// Frame 1 of two a second, with a shutter that is open for half of it: the pictures at 0.5, 0.5625, 0.625 and 0.6875
/// seconds.
#[test]
fn sub_frames_average_the_light_of_the_pictures_while_the_shutter_is_open() {
    let folder = crossing_ball();
    let record = |output: &str, more: &str| {
        let words = format!("record ball.toml -o {output} --size 64x48 --fps 2 --frames 1..2 {more}");
        folder.glint_within(PATIENCE, words.split_whitespace())
    };
    let sharp = record("sharp", "");
    if lacks_adapter(&sharp) {
        return;
    }
    assert_eq!(sharp.status, Some(0), "{sharp}");
    let blurred = record("blurred", "--subframes 4 --shutter 0.5 --aov depth,normal");
    assert_eq!((blurred.status, blurred.messages.as_str()), (Some(0), ""), "{blurred}");
    let picture = |name: &str| image::open(folder.path(name)).expect("a picture").into_rgb8();
    let light = |value: u8| {
        let value = f64::from(value) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    // The moments of the sub-frames, which are frames of their own here.
    let words = "record ball.toml -o moments --size 64x48 --fps 16 --frames 8..12";
    assert_eq!(folder.glint_within(PATIENCE, words.split(' ')).status, Some(0));
    let pictures = [8, 9, 10, 11].map(|frame| picture(&format!("moments/frame-{frame:06}.png")));
    let whole = picture("blurred/frame-000001.png");
    for (place, value) in whole.as_raw().iter().enumerate() {
        let mean = pictures.iter().map(|picture| light(picture.as_raw()[place])).sum::<f64>() / 4.0;
        let expected = if mean <= 0.0031308 { mean * 12.92 } else { 1.055 * mean.powf(1.0 / 2.4) - 0.055 };
        assert!((f64::from(*value) - expected * 255.0).abs() < 0.51, "{value} at {place}, expected {expected}");
    }
    assert!(whole != pictures[0], "the ball moves");
    // The numbers are those of the frame's own time, and a single sub-frame is the frame itself.
    let words = "render ball.toml -o then.png --size 64x48 --time 0.5 --aov depth=depth.exr";
    assert_eq!(folder.glint_within(PATIENCE, words.split(' ')).status, Some(0));
    assert!(bytes(folder.path("depth.exr")) == bytes(folder.path("blurred/frame-000001.depth.exr")));
    assert!(folder.path("blurred/frame-000001.normal.exr").exists());
    assert!(bytes(folder.path("then.png")) == unnamed(folder.path("sharp/frame-000001.png")));
    // A frame whose numbers are missing is made again, and no other.
    std::fs::remove_file(folder.path("blurred/frame-000001.normal.exr")).expect("the normals");
    let again = record("blurred", "--subframes 4 --shutter 0.5 --aov depth,normal");
    assert_eq!(again.text(), "1 pictures in blurred\n");
    assert!(folder.path("blurred/frame-000001.normal.exr").exists());
    let refused = record("blurred", "--aov depth,normal");
    assert!(refused.messages.contains("record.json: its pictures have 4 sub-frames"), "{refused}");
}

/// A track that changes nothing of the picture changes a caption from one sub-frame to the next.
#[test]
fn captions_and_overlays_are_drawn_once_over_an_average_and_keep_their_size() {
    let folder = crossing_ball();
    let ball = std::fs::read_to_string(folder.path("ball.toml")).expect("the scene");
    let (still, _) = ball.split_once("[[paths.tracks]]").expect("a track");
    folder.write(
        "still.toml",
        still.replace("[parameters]\n", "[parameters]\n\"overlay.axes\" = true\n").to_owned()
            + "[[paths.tracks]]\nkey = \"sscr.seed_attempts\"\ntimes = [0.0, 1.0]\nvalues = [0, 16]\nease = \"linear\"\n\
               [[paths.captions]]\ntext = \"{sscr.seed_attempts}\"\nstart = 0.0\nsize = 0.1\n",
    );
    let record = |output: &str, more: &str| {
        let words = format!("record still.toml -o {output} --size 160x120 --fps 2 --frames 1..2 {more}");
        folder.glint_within(PATIENCE, words.split_whitespace())
    };
    let sharp = record("sharp", "");
    if lacks_adapter(&sharp) {
        return;
    }
    assert_eq!(sharp.status, Some(0), "{sharp}");
    for (output, more) in [("blurred", "--subframes 4"), ("smooth", "--supersample 2")] {
        let outcome = record(output, more);
        assert_eq!(outcome.status, Some(0), "{outcome}");
    }
    let picture =
        |name: &str| image::open(folder.path(&format!("{name}/frame-000001.png"))).expect("a picture").into_rgb8();
    let (sharp, blurred, smooth) = (picture("sharp"), picture("blurred"), picture("smooth"));
    assert!(sharp == blurred, "the caption is that of the frame's own time");
    // The axis that points up is as long and as wide in both, and where it was.
    let axis = *sharp.get_pixel(54, 50);
    let of_axis = |of: &image::RgbImage| -> Vec<[u32; 2]> {
        of.enumerate_pixels().filter(|(_, _, pixel)| **pixel == axis).map(|(x, y, _)| [x, y]).collect()
    };
    assert!((50..150).contains(&of_axis(&sharp).len()), "{axis:?}: {}", of_axis(&sharp).len());
    assert_eq!(of_axis(&sharp), of_axis(&smooth));
}

/// How the window runs a recording: with lines of progress, until its end of a pipe closes.
#[test]
fn a_reported_recording_makes_the_same_pictures_and_stops_when_its_input_ends() {
    let folder = crossing_ball();
    let words = "record ball.toml --size 64x48 --fps 8 --path crossing";
    let plain = folder.glint_within(PATIENCE, words.split(' ').chain(["-o", "plain"]));
    if lacks_adapter(&plain) {
        return;
    }
    assert_eq!(plain.status, Some(0), "{plain}");
    let start = |output: &str, more: &[&str]| {
        let words = words.split(' ').chain(["-o", output, "--report"]).chain(more.iter().copied());
        let mut command = folder.command(words);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts")
    };
    let mut whole = start("whole", &[]);
    // The pipe stays open until the end.
    let input = whole.stdin.take();
    let output = whole.wait_with_output().expect("its end");
    drop(input);
    let told = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{told}");
    let lines: Vec<serde_json::Value> = told.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    assert!(lines.iter().any(|line| line["task"] == "recording" && line["total"] == 8), "{told}");
    assert_eq!(told.lines().last(), Some("8 pictures in whole"), "{told}");
    for name in names(&folder.path("plain")) {
        assert!(bytes(folder.path("plain").join(&name)) == bytes(folder.path("whole").join(&name)), "{name}");
    }
    let stopped = start("stopped", &["--subframes", "200"]);
    let output = stopped.wait_with_output().expect("its end");
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
}
