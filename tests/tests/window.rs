//! The window, driven as a person drives it: by mouse and keyboard, in an X session of its own. Judged by its picture and by
//! its event log.

use image::RgbaImage;
use serde_json::Value;
use tests::{Session, Window, colors};

/// A built-in scene of few points and few virtual lights: quick to load and to draw.
const SMALL_SCENE: &str =
    "clouds = [\"five-mirrors/sphere\"]\n[parameters]\n\"scene.points\" = 20000\n\"gi.vpls\" = 16\n";

/// The points of `SMALL_SCENE` in their own colours, for what has nothing to do with light.
const UNLIT_SCENE: &str =
    "clouds = [\"five-mirrors/sphere\"]\n[parameters]\n\"scene.points\" = 20000\n\"light.by\" = \"colors\"\n";

/// Opens `lattice.ply` with few virtual lights.
const LATTICE: [&str; 6] = ["view", "lattice.ply", "--set", "gi.vpls=16", "--set", "gi.sky_lights=8"];

/// Opens `lattice.ply` in its own colours.
const UNLIT_LATTICE: [&str; 4] = ["view", "lattice.ply", "--set", "light.by=colors"];

/// Somewhere on the picture, right of the panel.
const MIDDLE: [i32; 2] = [790, 380];

/// A square of points two units apart at coordinates of seven digits, with an intensity.
fn lattice() -> String {
    let header = "ply\nformat ascii 1.0\nelement vertex 1681\nproperty double x\nproperty double y\nproperty double z\n\
                  property ushort intensity\nend_header\n";
    let line =
        |i: i32, j: i32| format!("{} {} {}.25 {}\n", 5_000_000 + 2 * i, 600_000 + 2 * j, (i + j) / 20, 100 * i + j);
    let lines = (0..41).flat_map(|i| (0..41).map(move |j| line(i, j)));
    header.to_string() + &lines.collect::<String>()
}

/// Two gigabytes of points that are all zero, which take no room on the disk: long to read, quick to write.
fn large_las(session: &Session, points: u32) {
    let mut header = vec![0_u8; 227];
    header[..4].copy_from_slice(b"LASF");
    // Version 1.2, header size, offset to the points, point format 0 of 20 bytes.
    header[24..26].copy_from_slice(&[1, 2]);
    header[94..96].copy_from_slice(&227_u16.to_le_bytes());
    header[96..100].copy_from_slice(&227_u32.to_le_bytes());
    header[105..107].copy_from_slice(&20_u16.to_le_bytes());
    header[107..111].copy_from_slice(&points.to_le_bytes());
    for axis in 0..3 {
        header[131 + 8 * axis..139 + 8 * axis].copy_from_slice(&0.01_f64.to_le_bytes());
    }
    let path = session.folder.write("large.las", &header);
    let file = std::fs::File::options().write(true).open(path).expect("the file just written");
    file.set_len(227 + 20 * u64::from(points)).expect("a sparse file");
}

/// A hilly square of coloured points, as binary PLY.
fn hills(points: u32) -> Vec<u8> {
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {points}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    .into_bytes();
    // Steps of the golden ratio and of the plastic number fill a square evenly.
    for i in 0..points {
        let [x, y] = [0.754_877_666, 0.569_840_29].map(|step: f64| (f64::from(i) * step).fract() * 100.0);
        let z = 4.0 * (x / 9.0).sin() * (y / 14.0).cos();
        file.extend([x, y, z].iter().flat_map(|value| (*value as f32).to_le_bytes()));
        file.extend([x * 2.5, 40.0 + z * 20.0 + 100.0, y * 2.5].map(|value| value as u8));
    }
    file
}

/// The part of the window that shows the points.
fn view(picture: &RgbaImage) -> RgbaImage {
    image::imageops::crop_imm(picture, 320, 60, 940, 640).to_image()
}

fn number(event: &Value, path: &str) -> f64 {
    event.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("no {path} in {event}"))
}

#[test]
fn a_scene_named_as_argument_is_shown_and_turns_with_the_mouse() {
    let session = Session::start();
    session.folder.write("small.toml", UNLIT_SCENE);
    let window = session.open(["small.toml"]);
    let loaded = window.wait_for_event("loaded", 0, |_| true);
    assert_eq!(number(&loaded, "/points"), 20_000.0);
    let before = view(&window.settled(0));
    assert!(colors(&before) > 50, "{} colours", colors(&before));
    window.drag(1, MIDDLE, [MIDDLE[0] + 120, MIDDLE[1] + 40]);
    window.wait_for_picture("the scene turned", |picture| view(picture) != before);
    let seen = window.events().len();
    window.press("ctrl+z Home 6");
    let (_, colored) = window.settled_after("colored", seen, |event| event["by"] == "normal");
    let colored = view(&colored);
    window.hide_and_show();
    window.wait_for_picture("the picture of a window that was hidden", |picture| view(picture) == colored);
    assert!(window.is_open(), "{}", window.messages());
}

#[test]
fn a_window_whose_device_is_lost_has_another_one_with_the_same_picture_and_all_that_was_done() {
    let session = Session::start();
    session.folder.write("small.toml", UNLIT_SCENE);
    let expected = {
        let window = session.open(["small.toml"]);
        view(&window.settled(0))
    };
    let seen = std::fs::read_to_string(session.folder.path("events.jsonl")).expect("the log").lines().count();
    let window = session.open_acting_like("lost-window", ["small.toml"]);
    window.wait_for_event("frame", seen, |_| true);
    let lost = window.events().len();
    // The window is opened a second time.
    let is_opened = |event: &Value| event["event"] == "window";
    let again = || window.events().into_iter().skip(seen).filter(is_opened).count() == 2;
    window.wait_for_picture("a window of another device", |_| again());
    window.wait_for_picture("the same picture as without a loss", |picture| view(picture) == expected);
    // The window goes on as before.
    window.press("6");
    window.wait_for_event("colored", lost, |event| event["by"] == "normal");
    window.wait_for_picture("another picture", |picture| view(picture) != expected);
    assert!(window.is_open(), "{}", window.messages());
}

#[test]
fn a_path_that_is_typed_is_opened_where_no_dialog_answers() {
    let session = Session::start();
    session.folder.write("lattice.ply", lattice());
    let window = session.open::<[&str; 0]>([]);
    window.wait_for_event("ready", 0, |_| true);
    window.press("ctrl+o");
    // The field takes the keyboard when it is painted.
    window.wait_until_painted("prompt", 0);
    window.type_text("latt");
    window.press("Tab Return");
    // The courtyard that the window opened with may be read before the file is.
    let is_lattice = |event: &Value| event["event"] == "loaded" && number(event, "/points") == 1681.0;
    window.wait_for_event("loaded", 0, is_lattice);
    let loaded = window.events().iter().position(is_lattice).expect("the event");
    assert!(colors(&view(&window.settled(loaded))) > 20);
}

#[test]
fn clicks_give_full_coordinates_attributes_and_the_distance() {
    let session = Session::start();
    session.folder.write("lattice.ply", lattice());
    let window = session.open(UNLIT_LATTICE);
    window.settled(0);
    // From above, so that the middle of the picture is the middle of the lattice.
    let seen = window.events().len();
    window.press("KP_7");
    window.settled(seen);
    window.click(1, MIDDLE);
    let first = window.wait_for_event("picked", 0, |_| true);
    let record = window.wait_for_event("record", 0, |_| true);
    for (axis, origin) in [(0, 5_000_000.0), (1, 600_000.0)] {
        let steps = (number(&first, &format!("/world/{axis}")) - origin) / 2.0;
        assert!(steps.fract() == 0.0 && (0.0..=40.0).contains(&steps), "{first}");
    }
    let (i, j) = ((number(&first, "/world/0") - 5e6) / 2.0, (number(&first, "/world/1") - 6e5) / 2.0);
    assert_eq!(record["attributes"]["intensity"], format!("{}", 100.0 * i + j), "{record} at {first}");
    // Points of a distance snap to points.
    let seen = window.events().len();
    window.press("i");
    window.wait_for_event("placing", seen, |event| event["kind"] == "distance");
    let ends = [MIDDLE, [MIDDLE[0] + 90, MIDDLE[1] + 30]].map(|at| {
        let seen = window.events().len();
        window.click(1, at);
        let corner = window.wait_for_event("corner", seen, |_| true);
        [0, 1, 2].map(|axis| number(&corner, &format!("/world/{axis}")))
    });
    for [x, y, _] in ends {
        let steps = [(x - 5_000_000.0) / 2.0, (y - 600_000.0) / 2.0];
        assert!(steps.iter().all(|step| step.fract() == 0.0 && (0.0..=40.0).contains(step)), "{ends:?}");
    }
    assert!(ends[0] != ends[1], "{ends:?}");
    let measured = window.wait_for_event("measured", seen, |_| true);
    let difference = [0, 1, 2].map(|axis| ends[1][axis] - ends[0][axis]);
    let horizontal = difference[0].hypot(difference[1]);
    let expected = [horizontal.hypot(difference[2]), horizontal, difference[2]];
    for (index, (name, value)) in ["distance", "horizontal", "vertical"].into_iter().zip(expected).enumerate() {
        assert_eq!(measured["values"][index]["name"], name, "{measured}");
        assert!((number(&measured, &format!("/values/{index}/value")) - value).abs() < 1e-9, "{measured}");
    }
}

#[test]
fn the_number_row_changes_the_colours() {
    let session = Session::start();
    session.folder.write("lattice.ply", lattice());
    let window = session.open(UNLIT_LATTICE);
    let intensity = view(&window.settled(0));
    let seen = window.events().len();
    window.press("2");
    window.wait_for_event("colored", seen, |event| event["by"] == "height");
    window.wait_for_picture("colours by height", |picture| view(picture) != intensity);
    let seen = window.events().len();
    window.press("9");
    window.wait_for_event("colored", seen, |event| event["by"] == "plain");
}

#[test]
fn loading_can_be_stopped_and_what_is_loaded_stays() {
    let session = Session::start();
    let points = 100_000_000;
    large_las(&session, points);
    let window = session.open(["large.las"]);
    window.wait_for_event("opened", 0, |_| true);
    window.press("ctrl+period");
    window.wait_for_event("cancelled", 0, |_| true);
    let loaded = window.wait_for_event("loaded", 0, |_| true);
    assert!(number(&loaded, "/points") < f64::from(points), "{loaded}");
    assert!(window.is_open(), "{}", window.messages());
}

#[test]
fn a_bad_file_shows_its_message_and_the_rest_keeps_working() {
    let session = Session::start();
    session.folder.write("broken.laz", "LASF, but nothing else");
    session.folder.write("lattice.ply", lattice());
    let window = session.open(["broken.laz", "lattice.ply"]);
    let message = window.wait_for_event("message", 0, |event| event["level"] == "error");
    assert!(message["text"].as_str().is_some_and(|text| text.contains("broken.laz")), "{message}");
    let picture = window.settled(0);
    assert!(colors(&view(&picture)) > 20);
    let seen = window.events().len();
    window.press("2");
    window.wait_for_event("colored", seen, |event| event["by"] == "height");
}

#[test]
fn the_saved_picture_is_what_the_command_line_renders() {
    let session = Session::start();
    session.folder.write("small.toml", SMALL_SCENE);
    let window = session.open(["small.toml"]);
    window.settled(0);
    let seen = window.events().len();
    window.drag(1, MIDDLE, [MIDDLE[0] - 70, MIDDLE[1] + 30]);
    window.settled(seen);
    window.press("F12 ctrl+c");
    let saved = window.wait_for_event("saved", 0, |_| true);
    let copied = window.wait_for_event("copied", 0, |_| true);
    session.folder.write("view.toml", copied["text"].as_str().expect("the view"));
    let name = saved["path"].as_str().expect("a path");
    let picture = image::open(session.folder.path(name)).expect("the saved picture").into_rgba8();
    let size = format!("{}x{}", picture.width(), picture.height());
    let rendered = session.folder.glint([
        "render",
        "five-mirrors/sphere",
        "--set",
        "scene.points=20000",
        "--set",
        "gi.vpls=16",
        "--camera",
        "view.toml",
        "--size",
        &size,
        "-o",
        "rendered.png",
    ]);
    assert_eq!(rendered.status, Some(0), "{rendered}");
    let rendered = image::open(session.folder.path("rendered.png")).expect("the rendered picture").into_rgba8();
    let differing = picture.pixels().zip(rendered.pixels()).filter(|(a, b)| a != b).count();
    assert_eq!(differing, 0, "of {size} pixels");
}

/// The right-most pixel of the picture in the colour of the arrow along x.
fn red_arrow(picture: &RgbaImage) -> Option<[i32; 2]> {
    let red = |(_, _, pixel): &(u32, u32, &image::Rgba<u8>)| pixel.0[..3] == [0xe8, 0x5b, 0x54];
    picture.enumerate_pixels().filter(red).map(|(x, y, _)| [x as i32, y as i32]).max()
}

#[test]
fn a_mirror_is_added_moved_undone_saved_and_rendered_from_its_file() {
    let session = Session::start();
    session.folder.write("box.toml", UNLIT_SCENE.replace("sphere", "none"));
    let window = session.open(["box.toml"]);
    window.settled(0);
    let seen = window.events().len();
    window.press("b");
    let (added, _) = window.settled_after("mirror", seen, |event| event["name"] == "sphere");
    let with_handles = window.wait_for_picture("the handles", |picture| red_arrow(picture).is_some());
    let [x, y] = red_arrow(&with_handles).expect("just seen");
    let seen = window.events().len();
    window.drag(1, [x - 10, y], [x + 90, y]);
    let moved = window.wait_for_event("mirror_moved", seen, |_| true);
    window.wait_for_event("step", seen, |_| true);
    let shift = [0, 1, 2].map(|axis| {
        let path = format!("/position/{axis}");
        number(&moved, &path) - number(&added, &path)
    });
    assert!(shift[0] > 0.05 && shift[1] == 0.0 && shift[2] == 0.0, "along its arrow, not {shift:?}");

    // The first file is of the scene with the step undone, the second with it done again.
    let mut files = Vec::new();
    for keys in ["ctrl+z", "ctrl+shift+z"] {
        let seen = window.events().len();
        window.press(keys);
        window.settled_after("history", seen, |_| true);
        files.push(window.save_scene_as());
    }
    let position = |file: &String| {
        let text = std::fs::read_to_string(session.folder.path(file)).expect("the saved scene");
        let mirror = text.split("[[mirrors]]").nth(1).unwrap_or_else(|| panic!("no mirror in {text}"));
        let line = mirror.lines().find_map(|line| line.strip_prefix("position = ")).expect("its position");
        serde_json::from_str::<Vec<f64>>(line).expect("three numbers")
    };
    assert_eq!(position(&files[0])[0], number(&added, "/position/0"));
    assert_eq!(position(&files[1])[0], number(&moved, "/position/0"));

    window.press("F12");
    let saved = window.wait_for_event("saved", 0, |_| true);
    let picture = image::open(session.folder.path(saved["path"].as_str().expect("a path"))).expect("the saved picture");
    let picture = picture.into_rgba8();
    let size = format!("{}x{}", picture.width(), picture.height());
    let rendered = session.folder.glint(["render", &files[1], "--size", &size, "-o", "rendered.png"]);
    assert_eq!(rendered.status, Some(0), "{rendered}");
    let rendered = image::open(session.folder.path("rendered.png")).expect("the rendered picture").into_rgba8();
    let differing = picture.pixels().zip(rendered.pixels()).filter(|(a, b)| a != b).count();
    assert_eq!(differing, 0, "of {size} pixels");
}

#[test]
fn a_spot_at_the_camera_is_one_key_lights_the_scene_and_is_undone() {
    let session = Session::start();
    session.folder.write("lattice.ply", lattice());
    let window = session.open(LATTICE);
    let surroundings = window.wait_for_event("surroundings", 0, |_| true);
    assert_eq!((&surroundings["sky_is_open"], &surroundings["lights"]), (&true.into(), &0.into()));
    let by_sun = view(&window.settled(0));
    let seen = window.events().len();
    window.press("k");
    let (_, by_spot) = window.settled_after("light", seen, |_| true);
    assert!(view(&by_spot) != by_sun, "the spot's light");
    // Data colours, and lit again.
    let seen = window.events().len();
    window.press("u");
    let unlit = view(&window.settled(seen));
    window.wait_for_event("step", seen, |_| true);
    let seen = window.events().len();
    window.press("u");
    assert!(view(&window.settled(seen)) != unlit, "the light came back");
    window.wait_for_event("step", seen, |_| true);
    let text = std::fs::read_to_string(window.save_scene_as()).expect("the scene");
    assert_eq!(text.matches("[[lights]]").count(), 1, "{text}");
    // The switch to data colours and back are steps of their own.
    for lights in [1, 1, 0] {
        let seen = window.events().len();
        window.press("ctrl+z");
        let history = window.wait_for_event("history", seen, |_| true);
        assert_eq!(history["lights"], lights, "{history}");
    }
    assert!(window.is_open(), "{}", window.messages());
}

#[test]
fn unsaved_work_comes_back_after_a_crash_and_is_asked_for_before_the_window_closes() {
    let session = Session::start();
    session.folder.write("small.toml", UNLIT_SCENE);
    let window = session.open(["small.toml"]);
    window.wait_for_event("settled", 0, |_| true);
    window.press("b");
    window.wait_for_event("kept", 0, |event| event["unsaved"] == true);
    window.kill();
    session.folder.write("events.jsonl", "");

    let window = session.open(["small.toml"]);
    window.wait_for_event("left", 0, |event| event["count"] == 1);
    window.wait_until_painted("loaded", 0);
    let seen = window.events().len();
    window.press("ctrl+p");
    window.wait_until_painted("palette", seen);
    window.type_text("restore unsaved");
    window.press("Return");
    window.wait_for_event("kept", seen, |event| event["unsaved"] == true);
    // The window stays while the question has no answer, and when the answer is to stay.
    window.press("ctrl+q");
    window.wait_until_painted("asked", seen);
    window.press("Escape");
    window.press("ctrl+s");
    let saved = window.wait_for_event("scene_saved", seen, |_| true);
    let text = std::fs::read_to_string(saved["path"].as_str().expect("a path")).expect("the scene");
    assert!(text.contains("[[mirrors]]") && saved["path"].as_str().is_some_and(|path| path.ends_with("small.toml")));
    window.press("b");
    window.wait_for_event("mirror", seen, |_| true);
    let seen = window.events().len();
    window.press("ctrl+q");
    window.wait_until_painted("asked", seen);
    assert!(window.is_open(), "{}", window.messages());
    window.press("Tab Return");
    assert!(window.end().success());
    let left = std::fs::read_dir(session.folder.path(".config/glint/unsaved")).expect("the folder").count();
    assert_eq!(left, 0);
}

#[test]
fn the_truth_is_in_the_picture_while_its_key_is_down() {
    let session = Session::start();
    session.folder.write("small.toml", SMALL_SCENE);
    let window = session.open(["small.toml"]);
    let drawn = view(&window.settled(0));
    window.hold("x");
    // Not the note that it is being traced.
    window.wait_for_event("truth", 0, |_| true);
    let truth = window.wait_for_picture("the truth", |picture| differing(&view(picture), &drawn) > 0.2);
    window.release("x");
    window.wait_for_picture("the picture again", |picture| view(picture) == drawn);
    // What was traced is there at once, and gone when the view turns.
    window.hold("x");
    window.wait_for_picture("the truth again", |picture| differing(&view(picture), &drawn) > 0.2);
    let seen = window.events().len();
    window.drag(1, MIDDLE, [MIDDLE[0] + 60, MIDDLE[1]]);
    window.wait_for_event("truth", seen, |_| true);
    let turned =
        window.wait_for_picture("the truth of the new view", |picture| differing(&view(picture), &view(&truth)) > 0.2);
    window.release("x");
    assert!(colors(&view(&turned)) > 50 && window.is_open(), "{}", window.messages());
}

/// Share of the pixels that are not the same.
fn differing(a: &RgbaImage, b: &RgbaImage) -> f64 {
    let count = a.pixels().zip(b.pixels()).filter(|(a, b)| a != b).count();
    count as f64 / f64::from(a.width() * a.height())
}

#[test]
fn a_streamed_cloud_is_shown_and_stays_in_the_picture_while_the_camera_flies() {
    const BUDGET: f64 = 100_000.0;
    let session = Session::start();
    session.folder.write("hills.ply", hills(600_000));
    let scene = "clouds = [\"hills.ply\"]\n[parameters]\n\"stream.pages\" = \"always\"\n\
                 \"view.point_budget\" = 100000\n\"light.by\" = \"headlight\"\n";
    session.folder.write("hills.toml", scene);
    let window = session.open(["hills.toml"]);
    let pages = window.wait_for_event("pages", 0, |_| true);
    assert_eq!(number(&pages, "/points"), 600_000.0);
    let first = view(&window.settled(0));
    assert!(colors(&first) > 100, "{} colours", colors(&first));
    // From above, so that the middle of the picture is the middle of the hills.
    let before = window.events().len();
    window.press("KP_7");
    window.settled(before);
    let is_frame = |event: &&Value| event["event"] == "frame" && number(event, "/points") > 0.0;
    let shown = window.events().iter().position(|event| is_frame(&event)).expect("a frame");
    let seen = window.events().len();
    // Nearer, about, and away again.
    for (button, way) in [(4, 60), (4, -90), (5, 40)] {
        (0..4).for_each(|_| window.click(button, MIDDLE));
        window.drag(1, MIDDLE, [MIDDLE[0] + way, MIDDLE[1]]);
        assert!(colors(&view(&window.screenshot())) > 50, "nothing is left in the picture");
    }
    window.settled(seen);
    let events = window.events();
    let frames: Vec<&Value> = events[shown..].iter().filter(|event| event["event"] == "frame").collect();
    assert!(frames.len() > 10, "{}", frames.len());
    let is_within = |frame: &&Value| (1.0..=BUDGET).contains(&number(frame, "/points"));
    assert!(frames.iter().all(is_within), "a frame without points, or with too many: {frames:?}");
    let rests: Vec<&Value> = events.iter().filter(|event| event["event"] == "streamed").collect();
    assert!(rests.len() > 1 && rests.iter().all(|rest| number(rest, "/points") <= BUDGET), "{rests:?}");
    // What is picked has its own attributes, and the file is not asked.
    window.click(1, MIDDLE);
    let record = window.wait_for_event("picked", seen, |_| true);
    assert!((0.0..=100.0).contains(&number(&record, "/world/0")), "{record}");
    assert!(window.is_open(), "{}", window.messages());
}

#[test]
fn a_window_that_is_closed_while_an_index_is_made_leaves_no_part_of_it_behind() {
    closed_while_an_index_is_made(|window| assert!(window.quit().success()));
}

#[test]
fn ctrl_c_closes_the_window_with_130_and_leaves_no_part_of_an_index_behind() {
    closed_while_an_index_is_made(|window| assert_eq!(window.interrupt().code(), Some(130)));
}

fn closed_while_an_index_is_made(close: impl FnOnce(Window<'_>)) {
    let session = Session::start();
    session.folder.write("hills.ply", hills(1_500_000));
    session.folder.write("hills.toml", "clouds = [\"hills.ply\"]\n[parameters]\n\"stream.pages\" = \"always\"\n");
    let window = session.open(["hills.toml"]);
    window.wait_for_event("indexing", 0, |_| true);
    close(window);
    let cache = session.folder.path(".cache/glint/pages");
    let left = std::fs::read_dir(cache).into_iter().flatten().flatten().map(|entry| entry.path());
    let left: Vec<_> = left.filter(|path| path.is_dir()).collect();
    // The index may have been complete by then.
    assert!(left.iter().all(|path| path.join("nodes").exists() && !path.join("building").exists()), "{left:?}");
    let outcome = session.folder.glint(["index", "hills.ply"]);
    assert!(outcome.status == Some(0) && outcome.text().contains("1,500,000 points"), "{outcome}");
    assert_eq!(outcome.text().contains("was there"), !left.is_empty(), "{outcome}");
}
