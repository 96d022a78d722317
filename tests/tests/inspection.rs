//! The tools of an inspection in the window, used on a real scan one after the other, and judged by the picture on the
//! screen, by what the window logs and by the scene that it saves.

use image::RgbaImage;
use serde_json::Value;
use tests::{Session, Window, test_data};

/// Where the mouse is over nothing.
const ASIDE: [i32; 2] = [1250, 740];
/// Tabs and buttons of the panel, where a window of this size has them.
const DATA: [i32; 2] = [23, 45];
const LOOK: [i32; 2] = [53, 45];
const MEASURE: [i32; 2] = [166, 45];

/// Waits until the picture is final after the last event of this name, of which there are several in a row.
fn rest_after(window: &Window, name: &str, seen: usize) {
    window.wait_for_event(name, seen, |_| true);
    loop {
        let events = window.events();
        let last = |name: &str| events.iter().rposition(|event| event["event"] == name);
        window.settled(last(name).expect("just seen"));
        std::thread::sleep(std::time::Duration::from_secs(1));
        if window.events()[events.len()..].iter().all(|event| event["event"] != name) {
            return;
        }
    }
}

/// The part of a screenshot that shows the picture alone: below messages and charts, right of the panel, and left of what
/// is said of a picked point.
fn view(picture: &RgbaImage) -> RgbaImage {
    part(picture, 330, 950)
}

fn part(picture: &RgbaImage, left: u32, right: u32) -> RgbaImage {
    image::imageops::crop_imm(picture, left, 330, right - left, 400).to_image()
}

/// The number of pixels of the picture that points cover.
fn covered(picture: &RgbaImage) -> usize {
    view(picture).pixels().filter(|pixel| **pixel != BACKGROUND).count()
}

/// The outermost pixel of an arrow in a colour, away from the handles' middle: to the right, or upward.
fn arrow(picture: &RgbaImage, color: [u8; 3], upward: bool) -> Option<[i32; 2]> {
    let is_arrow = |(_, y, pixel): &(u32, u32, &image::Rgba<u8>)| *y > 60 && pixel.0[..3] == color;
    let places = picture.enumerate_pixels().filter(is_arrow).map(|(x, y, _)| [x as i32, y as i32]);
    places.max_by_key(|[x, y]| if upward { (-y, *x) } else { (*x, *y) })
}

const BACKGROUND: image::Rgba<u8> = image::Rgba([29, 32, 37, 255]);
const RED: [u8; 3] = [0xe8, 0x5b, 0x54];
const BLUE: [u8; 3] = [0x5b, 0x9c, 0xf0];

/// Drags the handle of an arrow, and returns where the object is then.
fn drag_arrow(window: &Window, color: [u8; 3], upward: bool, what: &str) -> [f64; 3] {
    let picture = window.wait_for_picture("the handles", |picture| arrow(picture, color, upward).is_some());
    let [x, y] = arrow(&picture, color, upward).expect("just seen");
    let seen = window.events().len();
    let (from, to) = if upward { ([x, y + 10], [x, y - 90]) } else { ([x - 10, y], [x + 90, y]) };
    window.drag(1, from, to);
    place(&window.wait_for_event(&format!("{what}_moved"), seen, |_| true))
}

fn place(event: &Value) -> [f64; 3] {
    [0, 1, 2].map(|axis| event["position"][axis].as_f64().expect("a coordinate"))
}

/// Chooses a row of the command palette.
fn command(window: &Window, words: &str) {
    let seen = window.events().len();
    window.press("ctrl+p");
    window.wait_until_painted("palette", seen);
    window.type_text(words);
    window.press("Return");
}

/// Clicks a field or a tab of the panel, and waits until it looks different: letters that come in the same frame are lost.
fn click_and_see(window: &Window, at: [i32; 2]) {
    let field = |picture: &RgbaImage| {
        image::imageops::crop_imm(picture, at[0] as u32 - 20, at[1] as u32 - 10, 40, 20).to_image()
    };
    let pause = || std::thread::sleep(std::time::Duration::from_millis(300));
    window.move_to(at);
    pause();
    let before = field(&window.screenshot());
    window.click(1, at);
    window.wait_for_picture("what was clicked looks different", |picture| field(picture) != before);
    pause();
}

/// Clicks places one after the other, slowly enough that no two are a double-click.
fn click_corners(window: &Window, places: &[[i32; 2]]) {
    for (number, at) in places.iter().enumerate() {
        let seen = window.events().len();
        window.click(1, *at);
        window.wait_for_event("corner", seen, |event| event["corners"] == number + 1);
        std::thread::sleep(std::time::Duration::from_millis(400));
    }
}

fn scene_text(session: &Session, window: &Window) -> (String, String) {
    let path = window.save_scene_as();
    let text = std::fs::read_to_string(session.folder.path(&path)).expect("the saved scene");
    (path, text)
}

#[test]
fn a_scan_is_fitted_cut_filtered_and_clipped_by_handles_in_one_window() {
    let Some(data) = test_data() else { return };
    let scan = data.join("airborne/autzen_trim_las12_pf3.laz");
    let session = Session::start();
    let scan = scan.to_str().expect("text");
    let window = session.open(["view", scan, "--camera", "top", "--set", "light.by=headlight"]);
    window.settled(0);

    // A cylinder through the points along the bridge.
    let seen = window.events().len();
    window.press("alt+9");
    window.wait_for_event("placing", seen, |_| true);
    click_corners(&window, &[[712, 230], [690, 300]]);
    window.press("Return");
    let cylinder = window.wait_for_event("measured", seen, |event| event["kind"] == "cylinder");
    assert!(cylinder["error"].is_null(), "{cylinder}");

    // A section: two clicks and Enter. Its arrow drags it along, and its points follow.
    let seen = window.events().len();
    window.press("shift+i");
    window.wait_for_event("placing", seen, |_| true);
    click_corners(&window, &[[560, 480], [860, 500]]);
    window.press("Return");
    let cut = window.wait_for_event("profile_cut", seen, |event| event["points"].as_u64() > Some(100));
    let before = place(&window.wait_for_event("profile", seen, |_| true));
    window.move_to(ASIDE);
    let seen = window.events().len();
    let after = drag_arrow(&window, RED, false, "profile");
    assert!(after[0] > before[0] + 1.0 && after[1..] == before[1..], "along its arrow: {before:?}, {after:?}");
    let moved = window.wait_for_event("profile_cut", seen, |event| event["points"] != cut["points"]);
    window.wait_for_event("step", seen, |_| true);
    let (scene, _) = scene_text(&session, &window);
    let seen = window.events().len();
    window.click(1, [506, 67]);
    let written = window.wait_for_event("profile_saved", seen, |_| true);
    let table = std::fs::read(session.folder.path(written["path"].as_str().expect("a path"))).expect("the table");
    let headless = session.folder.glint(["profile", &scene]);
    assert!(headless.status == Some(0) && headless.output == table, "the window and `glint profile` disagree");
    assert!(table.split(|byte| *byte == b'\n').count() > 100, "{moved}");
    let measured = session.folder.glint(["measure", &scene, "--json"]).json();
    let radius = |values: &Value| values[0]["value"].as_f64().expect("a radius");
    let (own, other) = (radius(&cylinder["values"]), radius(&measured["measurements"][0]["values"]));
    assert!((own - other).abs() <= 1e-9 * own, "{cylinder}, {measured}");
    command(&window, "profiles: close");

    // A filter from the handles of the histogram.
    click_and_see(&window, LOOK);
    window.move_to(ASIDE);
    let seen = window.events().len();
    window.press("3");
    let (_, all) = window.settled_after("colored", seen, |event| event["by"] == "intensity");
    let seen = window.events().len();
    window.drag(1, [17, 225], [150, 225]);
    rest_after(&window, "colored", seen);
    let seen = window.events().len();
    window.click(1, [78, 277]);
    window.move_to(ASIDE);
    let filtered = window.settled(seen);
    assert!(covered(&filtered) < covered(&all), "{} of {} pixels", covered(&filtered), covered(&all));
    let (scene, text) = scene_text(&session, &window);
    let file: toml::Table = text.parse().expect("a scene file");
    let filter = &file["visibility"]["filters"][0];
    let ends = ["low", "high"].map(|end| filter[end].as_float().expect("a number"));
    assert!(filter["attribute"].as_str() == Some("intensity") && ends[0] > 50.0 && ends[1] > ends[0], "{filter}");
    let report = session.folder.glint(["export", &scene, "--json", "-o", "filtered.laz"]).json();
    let points = report["points"].as_u64().expect("a number");
    assert!(points > 1000 && report["left_out"] == 110_000 - points, "{report}");
    let seen = window.events().len();
    window.press("ctrl+z");
    window.settled_after("history", seen, |_| true);

    // A sphere about everything, and a box about what is picked, dragged by its arrow.
    let whole = covered(&window.screenshot());
    let seen = window.events().len();
    command(&window, "clips: sphere");
    let (_, sphere) = window.settled_after("clip", seen, |event| event["name"] == "sphere");
    assert!(covered(&sphere) < whole, "the sphere hides nothing");
    undo_clip(&window);
    let picked = window.events().len();
    window.click(1, [700, 480]);
    window.wait_for_event("picked", picked, |_| true);
    let seen = window.events().len();
    window.press("j");
    let (added, boxed) = window.settled_after("clip", seen, |event| event["name"] == "box");
    let before = place(&added);
    assert!(covered(&boxed) * 2 < whole, "the box shows what is outside: {} of {whole} pixels", covered(&boxed));
    let seen = window.events().len();
    let after = drag_arrow(&window, RED, false, "clip");
    assert!(after[0] > before[0] + 1.0 && after[1..] == before[1..], "along its arrow: {before:?}, {after:?}");
    let (_, dragged) = window.settled_after("clip_moved", seen, |_| true);
    assert!(view(&dragged) != view(&boxed), "the box shows what it did before");
    let (_, text) = scene_text(&session, &window);
    let file: toml::Table = text.parse().expect("a scene file");
    assert_eq!(file["clips"][0]["position"][0].as_float(), Some(after[0]), "{text}");
    undo_clip(&window);

    // From the front, a slab that is dragged upward leaves the lower points out.
    let seen = window.events().len();
    window.press("ctrl+1");
    let front = covered(&window.settled(seen));
    let seen = window.events().len();
    command(&window, "clips: slab");
    let (added, _) = window.settled_after("clip", seen, |event| event["name"] == "slab");
    let before = place(&added);
    let seen = window.events().len();
    let after = drag_arrow(&window, BLUE, true, "clip");
    assert!(after[2] > before[2] + 1.0 && after[..2] == before[..2], "upward: {before:?}, {after:?}");
    let slab = covered(&window.settled_after("clip_moved", seen, |_| true).1);
    assert!(slab < front, "the slab hides nothing: {slab} of {front} pixels");
    assert!(window.is_open(), "{}", window.messages());
}

/// Takes the last clip and its moves back.
fn undo_clip(window: &Window) {
    loop {
        let seen = window.events().len();
        window.press("ctrl+z");
        let (history, _) = window.settled_after("history", seen, |_| true);
        if history["clips"] == 0 {
            return;
        }
    }
}

#[test]
fn a_scan_is_moved_compared_and_shown_beside_its_kept_state() {
    let Some(data) = test_data() else { return };
    let scan = data.join("airborne/autzen_trim_las12_pf3.laz");
    let session = Session::start();
    let scan = scan.to_str().expect("text");
    let own = "[[cloud_settings]]\ncloud = 'autzen_trim_las12_pf3.laz'\nmove = [0.0, 0.0, 10.0]\n";
    session.folder.write("later.toml", format!("clouds = ['{scan}']\n{own}"));
    let made = session.folder.glint(["export", "later.toml", "-o", "later.laz"]);
    assert_eq!(made.status, Some(0), "{made}");
    let window = session.open(["view", scan, "--camera", "top", "--set", "light.by=headlight"]);
    let first = window.settled(0);

    // The place of the cloud, typed in the panel: it is turned about the axis that points to the eye.
    window.click(1, DATA);
    window.click(1, [38, 212]);
    // The numbers appear one row after the other.
    window.wait_for_picture("the last row", |picture| picture.get_pixel(140, 270) != picture.get_pixel(5, 740));
    let seen = window.events().len();
    click_and_see(&window, [270, 264]);
    window.type_text("30");
    window.press("Return");
    window.move_to(ASIDE);
    let (_, turned) = window.settled_after("placed", seen, |_| true);
    assert!(view(&turned) != view(&first), "the cloud stands where it stood");
    let (scene, text) = scene_text(&session, &window);
    let file: toml::Table = text.parse().expect("a scene file");
    assert_eq!(file["cloud_settings"][0]["turn"][2].as_float(), Some(30.0), "{text}");

    // The distances of the turned cloud from the other one, beside the state before.
    window.press("shift+F3");
    window.click(1, MEASURE);
    click_and_see(&window, [205, 372]);
    window.type_text("later.laz");
    let seen = window.events().len();
    window.click(1, [44, 449]);
    let compared = window.wait_for_event("compared", seen, |_| true);
    let headless = session.folder.glint(["compare", &scene, "later.laz", "--json"]).json();
    for key in ["points", "mean", "p95"] {
        assert_eq!(compared[key], headless[key], "{key}");
    }
    assert!(compared["p95"].as_f64().is_some_and(|p95| p95 > 1.0), "{compared}");
    window.move_to(ASIDE);
    let (_, distances) = window.settled_after("colored", seen, |event| event["by"] == "distance");
    assert!(view(&distances) != view(&turned), "the points have the colours that they had");
    let (left, right) = (|picture: &RgbaImage| part(picture, 330, 760), |picture: &RgbaImage| part(picture, 830, 1270));
    window.press("ctrl+F3");
    window.wait_for_picture("the kept state on the left, the present one on the right", |picture| {
        left(picture) == left(&turned) && right(picture) == right(&distances)
    });
    window.hold("F3");
    window.wait_for_picture("the kept state alone", |picture| view(picture) == view(&turned));
    window.release("F3");
    window.press("ctrl+F3");
    window.wait_for_picture("the present state alone", |picture| view(picture) == view(&distances));
    let seen = window.events().len();
    window.press("alt+F3");
    window.wait_for_event("kept_state", seen, |_| true);
    // Each has a half of the window, at the same scale: where one has points, the other one has, too.
    let both = |picture: &RgbaImage| {
        let (left, right) = (part(picture, 320, 780), part(picture, 804, 1264));
        let is_empty = |picture: &RgbaImage| picture.pixels().map(|pixel| *pixel == BACKGROUND).collect::<Vec<_>>();
        let (one, other) = (is_empty(&left), is_empty(&right));
        let agreeing = one.iter().zip(&other).filter(|(a, b)| a == b).count();
        left != right && agreeing * 100 > one.len() * 97 && one.iter().filter(|is_empty| !**is_empty).count() > 10_000
    };
    window.wait_for_picture("both side by side", both);
    window.press("alt+F3");
    window.wait_for_picture("one picture again", |picture| view(picture) == view(&distances));
    assert!(window.is_open(), "{}", window.messages());
}
