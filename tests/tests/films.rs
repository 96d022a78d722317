//! Films of a path: what independent decoders see in them, and what stays of a recording that ends too early.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tests::{Folder, Outcome};

/// Longer than any step of a run on a busy machine.
const PATIENCE: Duration = Duration::from_secs(240);
const SIZE: [usize; 2] = [96, 64];

/// A ball that crosses the picture in a second.
fn crossing_ball() -> Folder {
    let folder = Folder::new();
    let camera = "eye = [0.0, 0.0, 1.9]\npivot = [0.0, 0.0, 0.0]\nup = [0.0, 1.0, 0.0]\n";
    folder.write(
        "ball.toml",
        format!(
            "clouds = [\"five-mirrors/none\"]\n[camera]\n{camera}[parameters]\n\"gi.bounces\" = 0\n\
             \"scene.points\" = 20000\n\"reflection.method\" = \"none\"\n[[mirrors]]\nname = \"ball\"\n\
             shape = \"sphere\"\nposition = [0.0, 0.0, 0.0]\nsize = 0.4\n[[paths]]\nname = \"crossing\"\n\
             [[paths.keyframes]]\ntime = 0.0\n{camera}[[paths.tracks]]\nkey = \"mirrors.ball.position\"\n\
             times = [0.0, 1.0]\nvalues = [[-0.6, 0, 0], [0.6, 0, 0]]\nease = \"linear\"\n"
        ),
    );
    folder
}

fn words<'a>(output: &'a str, fps: &'a str) -> Vec<&'a str> {
    vec!["record", "ball.toml", "-o", output, "--size", "96x64", "--fps", fps]
}

fn record(folder: &Folder, output: &str, fps: &str, more: &[&str]) -> Outcome {
    folder.glint_within(PATIENCE, [&words(output, fps)[..], more].concat())
}

/// Whether this run must be passed over for want of an adapter.
fn lacks_adapter(status: Option<i32>) -> bool {
    let lacks = status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none();
    if lacks {
        println!("skipped: no adapter");
    }
    lacks
}

/// Whether a program is on the PATH.
fn has_program(name: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(name).is_file())
}

fn bytes(path: PathBuf) -> Vec<u8> {
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The names of the pictures in a folder, in their order.
fn pictures(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.filter(|name| name.ends_with(".png")).collect();
    names.sort();
    names
}

/// Holds that two folders have the same pictures, to the bit.
fn same_pictures(one: &Path, two: &Path) {
    assert_eq!(pictures(one), pictures(two));
    assert!(!pictures(one).is_empty(), "{}", one.display());
    for name in pictures(one) {
        assert!(bytes(one.join(&name)) == bytes(two.join(&name)), "{name} of {}", two.display());
    }
}

/// What a run of another program writes.
fn output_of(program: &str, folder: &Folder, words: &[&str]) -> Vec<u8> {
    let output = Command::new(program).args(words).current_dir(folder.path("")).output().expect("it starts");
    assert!(output.status.success(), "{program} {words:?}: {}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

/// Decodes a film with `ffmpeg` and compares it with its pictures: what `ffprobe` says of it, and the ratio of peak
/// signal to noise of all pictures together, in decibels.
fn decoded(folder: &Folder, film: &str) -> (serde_json::Value, f64) {
    let entries = "stream=codec_name,width,height,r_frame_rate,nb_read_frames,color_range,color_space,color_primaries,\
                   color_transfer";
    let probe =
        ["-v", "error", "-count_frames", "-select_streams", "v:0", "-show_entries", entries, "-of", "json", film];
    let told: serde_json::Value = serde_json::from_slice(&output_of("ffprobe", folder, &probe)).expect("JSON");
    // Colours that a file does not name are those of sRGB already.
    let filter = if film.ends_with(".mp4") { "scale=in_color_matrix=bt709:in_range=tv" } else { "null" };
    let decode = ["-v", "error", "-i", film, "-vf", filter, "-fps_mode", "passthrough", "-pix_fmt", "rgb24"];
    let values = output_of("ffmpeg", folder, &[&decode[..], &["-f", "rawvideo", "-"]].concat());
    let names = pictures(&folder.path("ball.frames"));
    let whole = names
        .iter()
        .flat_map(|name| image::open(folder.path("ball.frames").join(name)).expect("a picture").into_rgb8().into_raw());
    let whole: Vec<u8> = whole.collect();
    assert_eq!(values.len(), whole.len(), "{film}: {} pictures of {SIZE:?}", names.len());
    let square = |(one, two): (&u8, &u8)| (f64::from(*one) - f64::from(*two)).powi(2);
    let mean = values.iter().zip(&whole).map(square).sum::<f64>() / values.len() as f64;
    (told["streams"][0].clone(), 20.0 * 255.0_f64.log10() - 10.0 * mean.log10())
}

#[test]
fn the_last_shard_makes_a_film_that_an_independent_decoder_plays() {
    let folder = crossing_ball();
    let second = record(&folder, "ball.mp4", "8", &["--shard", "2/2"]);
    if lacks_adapter(second.status) {
        return;
    }
    let told = "4 pictures in ball.frames\nball.mp4 is made by the shard that ends last: 4 pictures are missing\n";
    assert_eq!((second.status, &*second.text()), (Some(0), told), "{second}");
    assert!(!folder.path("ball.mp4").exists());
    let first = record(&folder, "ball.mp4", "8", &["--shard", "1/2"]);
    assert_eq!(first.text(), "4 pictures in ball.frames\n8 pictures in ball.mp4\n", "{first}");
    let gif = record(&folder, "ball.gif", "8", &[]);
    assert_eq!(gif.text(), "8 pictures in ball.frames, 8 of them were there\n8 pictures in ball.gif\n", "{gif}");
    if !(has_program("ffmpeg") && has_program("ffprobe")) {
        return println!("skipped: the films are not decoded, because ffmpeg is not on the PATH");
    }
    let check = |film: &str, codec: &str, decibels: f64| {
        let (told, ratio) = decoded(&folder, film);
        let what = [&told["codec_name"], &told["nb_read_frames"], &told["r_frame_rate"]];
        assert_eq!(what, [codec, "8", "8/1"], "{told}");
        assert_eq!([&told["width"], &told["height"]].map(|side| side.as_u64()), SIZE.map(|side| Some(side as u64)));
        if film.ends_with(".mp4") {
            let colors = ["color_space", "color_primaries", "color_transfer", "color_range"].map(|key| &told[key]);
            assert_eq!(colors, ["bt709", "bt709", "bt709", "tv"], "{told}");
        }
        println!("{film} by {codec}: {ratio:.1} dB");
        assert!(ratio > decibels, "{film} by {codec}: {ratio:.1} dB");
    };
    check("ball.mp4", "av1", 30.0);
    check("ball.gif", "gif", 30.0);
    let h264 = record(&folder, "ball.mp4", "8", &["--codec", "h264"]);
    if h264.messages.contains("libx264") {
        return println!("skipped: H.264, because this ffmpeg has no libx264");
    }
    assert_eq!((h264.status, h264.messages.as_str()), (Some(0), ""), "{h264}");
    check("ball.mp4", "h264", 30.0);
}

/// A program that the PATH finds as `ffmpeg`, before the real one.
#[cfg(unix)]
fn put_ffmpeg(folder: &Folder, script: &str) {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::create_dir_all(folder.path("bin")).expect("a folder");
    let program = folder.write("bin/ffmpeg", format!("#!/bin/sh\n{script}\n"));
    std::fs::set_permissions(program, std::fs::Permissions::from_mode(0o755)).expect("a program");
}

#[test]
#[cfg(unix)]
fn an_ffmpeg_that_is_missing_or_makes_no_film_is_told_and_pictures_stay() {
    let folder = crossing_ball();
    let bin = folder.path("bin").display().to_string();
    let run = |path: &str| {
        let mut command = folder.command([&words("ball.mp4", "4")[..], &["--codec", "h264"]].concat());
        let output = command.env("PATH", path).output().expect("it starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    // A missing and a failing ffmpeg are refused before there is an adapter.
    let (status, told) = run(&bin);
    assert_eq!(status, Some(2), "{told}");
    assert!(told.contains("ball.mp4: ffmpeg: it is not on the PATH") && told.contains("leave --codec out"), "{told}");
    put_ffmpeg(&folder, "cat > /dev/null; echo \"[vost#0:0 @ 0x12] Unknown encoder 'libx264'\" >&2; exit 1");
    let path = format!("{bin}:/usr/bin:/bin");
    let (status, told) = run(&path);
    assert_eq!(status, Some(2), "{told}");
    let why = "ball.mp4: ffmpeg: it makes no H.264 of 96x64 pixels at 4 a second: Unknown encoder 'libx264'; leave \
               --codec out for AV1";
    assert!(told.contains(why) && !folder.path("ball.frames").exists(), "{told}");
    // The last ffmpeg encodes the picture of the check, of which nothing is kept, and fails in the film.
    put_ffmpeg(&folder, "cat > /dev/null; case \"$*\" in *'-f null'*) exit 0;; esac; echo 'No space left' >&2; exit 1");
    let (status, told) = run(&path);
    if lacks_adapter(status) {
        return;
    }
    assert_eq!(status, Some(1), "{told}");
    assert!(told.contains("ball.mp4: ffmpeg: No space left"), "{told}");
    assert!(told.contains("the pictures stay in ball.frames; the same command makes the film of them"), "{told}");
    assert_eq!((pictures(&folder.path("ball.frames")).len(), folder.path("ball.mp4").exists()), (4, false));
    let film = record(&folder, "ball.mp4", "4", &[]);
    assert_eq!(film.text(), "4 pictures in ball.frames, 4 of them were there\n4 pictures in ball.mp4\n", "{film}");
}

/// What makes a recording end in the middle.
#[cfg(unix)]
#[derive(Clone, Copy, Debug)]
enum End {
    Killed,
    CtrlC,
    /// The window that has started it is closed.
    WindowClosed,
}

#[test]
#[cfg(unix)]
fn a_recording_that_ends_in_the_middle_and_goes_on_makes_the_pictures_of_one_run() {
    let folder = crossing_ball();
    let whole = record(&folder, "whole", "16", &[]);
    if lacks_adapter(whole.status) {
        return;
    }
    assert_eq!(whole.text(), "16 pictures in whole\n", "{whole}");
    for (output, end) in [("killed", End::Killed), ("stopped", End::CtrlC), ("closed", End::WindowClosed)] {
        let more: &[&str] = if matches!(end, End::WindowClosed) { &["--report"] } else { &[] };
        let mut command = folder.command([&words(output, "16")[..], more].concat());
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        let mut program = command.spawn().expect("it starts");
        let start = Instant::now();
        while pictures(&folder.path(output)).len() < 3 {
            assert!(start.elapsed() < PATIENCE, "{end:?}: no picture comes");
            std::thread::sleep(Duration::from_millis(2));
        }
        match end {
            End::Killed => program.kill().expect("it runs"),
            End::CtrlC => {
                let sent = Command::new("kill").args(["-INT", &program.id().to_string()]).status();
                assert!(sent.is_ok_and(|status| status.success()));
            }
            End::WindowClosed => drop(program.stdin.take()),
        }
        let status = program.wait().expect("its end").code();
        let expected = if matches!(end, End::Killed) { None } else { Some(130) };
        assert_eq!(status, expected, "{end:?}");
        let count = pictures(&folder.path(output)).len();
        assert!((3..16).contains(&count), "{end:?}: it had made {count} pictures");
        let rest = record(&folder, output, "16", &[]);
        let there = format!("16 pictures in {output}, {count} of them were there\n");
        assert_eq!((rest.status, rest.text()), (Some(0), there), "{end:?}: {rest}");
        same_pictures(&folder.path("whole"), &folder.path(output));
    }
}

/// `/dev/full` is a place where nothing can be written, as on a disk that is full.
#[test]
#[cfg(target_os = "linux")]
fn a_disk_that_gets_full_leaves_the_pictures_so_far() {
    let folder = crossing_ball();
    let whole = record(&folder, "whole", "6", &[]);
    if lacks_adapter(whole.status) {
        return;
    }
    let first = record(&folder, "full", "6", &["--frames", "0..1"]);
    assert_eq!(first.text(), "1 pictures in full\n", "{first}");
    let place = folder.path("full/frame-000003.png");
    std::os::unix::fs::symlink("/dev/full", &place).expect("a link");
    let full = record(&folder, "full", "6", &[]);
    assert_eq!((full.status, full.messages.lines().count()), (Some(1), 1), "{full}");
    assert!(full.messages.contains("frame-000003.png: cannot be written: the disk is full"), "{full}");
    std::fs::remove_file(place).expect("the link");
    assert_eq!(pictures(&folder.path("full")), ["frame-000000.png", "frame-000001.png", "frame-000002.png"]);
    let rest = record(&folder, "full", "6", &[]);
    assert_eq!(rest.text(), "6 pictures in full, 3 of them were there\n", "{rest}");
    same_pictures(&folder.path("whole"), &folder.path("full"));
}

/// A PNG file whose text `Source` is another.
fn drawn_by(png: &[u8], source: &str) -> Vec<u8> {
    let kind = b"tEXtSource\0".as_slice();
    let at = png.windows(kind.len()).position(|own| own == kind).expect("a source") - 4;
    let length = u32::from_be_bytes(png[at..at + 4].try_into().expect("four bytes")) as usize;
    let chunk = [kind, source.as_bytes()].concat();
    let length_now = (chunk.len() as u32 - 4).to_be_bytes();
    [&png[..at], &length_now, &chunk, &crc32fast::hash(&chunk).to_be_bytes(), &png[at + length + 12..]].concat()
}

#[test]
fn pictures_name_their_adapter_and_a_recording_says_if_there_are_several() {
    let folder = crossing_ball();
    let first = record(&folder, "mixed", "4", &["--frames", "0..1", "--stats"]);
    if lacks_adapter(first.status) {
        return;
    }
    assert_eq!((first.status, first.messages.as_str()), (Some(0), ""), "{first}");
    let json = |name: &str| -> serde_json::Value { serde_json::from_slice(&bytes(folder.path(name))).expect("JSON") };
    let mut plan = json("mixed/record.json");
    assert_eq!(json("mixed/frame-000000.json")["adapter"], plan["adapter"]);
    let text = |key: &str| plan["adapter"][key].as_str().expect("a text").to_owned();
    let source = format!("{} ({}, {})", text("name"), text("backend"), text("driver"));
    let picture = bytes(folder.path("mixed/frame-000000.png"));
    assert!(drawn_by(&picture, &source) == picture, "the file names {source}");
    // As if another card had begun.
    folder.write("mixed/frame-000000.png", drawn_by(&picture, "A card (Vulkan, 1)"));
    plan["adapter"] = serde_json::json!({ "name": "A card", "backend": "Vulkan", "driver": "1" });
    folder.write("mixed/record.json", plan.to_string());
    let refused = record(&folder, "mixed", "4", &[]);
    assert_eq!((refused.status, refused.messages.lines().count()), (Some(2), 1), "{refused}");
    assert!(refused.messages.contains("its pictures are drawn by A card (Vulkan, 1), and here "), "{refused}");
    let mixed = record(&folder, "mixed", "4", &["--mixed"]);
    assert_eq!(mixed.text(), "4 pictures in mixed, 1 of them were there\n", "{mixed}");
    let told = format!("of several adapters, each of which rounds otherwise: 1 by A card (Vulkan, 1), 3 by {source}");
    assert!(mixed.messages.contains(&told) || source.as_str() < "A card", "{mixed}");
    assert_eq!(mixed.messages.lines().count(), 1, "{mixed}");
}

#[test]
fn supersampling_averages_the_light_of_a_render_that_is_larger() {
    let folder = crossing_ball();
    let smooth = record(&folder, "smooth", "2", &["--frames", "1..2", "--supersample", "2"]);
    if lacks_adapter(smooth.status) {
        return;
    }
    assert_eq!((smooth.status, smooth.messages.as_str()), (Some(0), ""), "{smooth}");
    let large = folder.glint_within(PATIENCE, "render ball.toml -o large.png --size 192x128 --time 0.5".split(' '));
    assert_eq!(large.status, Some(0), "{large}");
    let picture = |name: &str| image::open(folder.path(name)).expect("a picture").into_rgb8();
    let (smooth, large) = (picture("smooth/frame-000001.png"), picture("large.png"));
    let light = |value: u8| {
        let value = f64::from(value) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    let mut edges = 0;
    for (x, y, pixel) in smooth.enumerate_pixels() {
        for channel in 0..3 {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| large.get_pixel(2 * x + i, 2 * y + j)[channel]);
            let mean = four.iter().map(|value| light(*value)).sum::<f64>() / 4.0;
            let expected = if mean <= 0.0031308 { mean * 12.92 } else { 1.055 * mean.powf(1.0 / 2.4) - 0.055 };
            assert!((f64::from(pixel[channel]) - expected * 255.0).abs() < 0.51, "{pixel:?} at {x}, {y}: {expected}");
            edges += u32::from(four.iter().any(|value| value.abs_diff(four[0]) > 20));
        }
    }
    assert!(edges > 100, "{edges} values are of pixels that differ");
}
