//! Clip volumes in the window, on a real scan: added, drawn, saved and undone. The saved scene gives the same picture
//! without a window.

use image::RgbaImage;
use tests::{Session, Window, test_data};

/// On the scan in the picture, right of the panel.
const PLACE: [i32; 2] = [680, 440];

/// Waits until the picture is final after the first `seen` events, saves it and reads it.
fn saved(session: &Session, window: &Window, seen: usize) -> RgbaImage {
    window.wait_for_event("settled", seen, |_| true);
    let seen = window.events().len();
    window.press("F12");
    let saved = window.wait_for_event("saved", seen, |_| true);
    let path = session.folder.path(saved["path"].as_str().expect("a path"));
    image::open(path).expect("the saved picture").into_rgba8()
}

#[test]
fn a_box_about_a_pick_and_a_prism_clip_a_scan_are_saved_and_undone() {
    let Some(data) = test_data() else { return };
    let scan = data.join("airborne/autzen_trim_las12_pf3.laz");
    let session = Session::start();
    let arguments = ["view", scan.to_str().expect("text"), "--camera", "top", "--set", "light.by=headlight"];
    let window = session.open(arguments);
    let whole = saved(&session, &window, 0);
    let size = format!("{}x{}", whole.width(), whole.height());
    let scan = scan.to_str().expect("text");
    let top = ["render", scan, "--size", &size, "--camera", "top", "--set", "light.by=headlight", "-o", "top.png"];
    let rendered = session.folder.glint(top);
    assert_eq!(rendered.status, Some(0), "{rendered}");
    let top = image::open(session.folder.path("top.png")).expect("the rendered picture").into_rgba8();
    assert!(top == whole, "`view --camera top --set` shows another picture than `render`");

    let seen = window.events().len();
    window.click(1, PLACE);
    window.wait_for_event("picked", seen, |_| true);
    window.press("j");
    window.wait_for_event("clip", seen, |event| event["name"] == "box");
    let clipped = saved(&session, &window, seen);
    assert!(clipped != whole, "the box hides nothing");
    let scene = window.save_scene_as();
    let scene = scene.as_str();
    let text = std::fs::read_to_string(session.folder.path(scene)).expect("the saved scene");
    assert!(text.contains("[[clips]]") && text.contains("shape = \"box\""), "{text}");
    let rendered = session.folder.glint(["render", scene, "--size", &size, "-o", "clipped.png"]);
    assert_eq!(rendered.status, Some(0), "{rendered}");
    let rendered = image::open(session.folder.path("clipped.png")).expect("the rendered picture").into_rgba8();
    assert!(rendered == clipped, "the saved scene is another picture");

    // What is shown is saved, as `export` saves it.
    let seen = window.events().len();
    window.press("ctrl+e");
    // No dialog answers here, so the path is asked for.
    window.wait_until_painted("prompt", seen);
    window.press("Return");
    let exported = window.wait_for_event("exported", seen, |_| true);
    let path = session.folder.path(exported["path"].as_str().expect("a path"));
    let told = session.folder.glint(["export", scene, "-o", "same.laz"]);
    assert!(told.text().starts_with(&format!("same.laz: {} of ", exported["points"])), "{told}");
    let bytes = std::fs::read(path).expect("the exported file");
    assert!(bytes == std::fs::read(session.folder.path("same.laz")).expect("the file"), "`export` writes another file");

    let seen = window.events().len();
    window.press("ctrl+z");
    window.wait_for_event("history", seen, |event| event["clips"] == 0);
    assert!(saved(&session, &window, seen) == whole, "undo leaves something hidden");

    let seen = window.events().len();
    window.press("ctrl+j");
    let corners = [[650, 300], [900, 320], [760, 560]];
    for (number, corner) in corners.iter().enumerate() {
        window.click(1, *corner);
        window.wait_for_event("corner", seen, |event| event["corners"] == number + 1);
    }
    window.click(1, corners[0]);
    window.wait_for_event("clip", seen, |event| event["name"] == "prism");
    let clipped = saved(&session, &window, seen);
    // Only what was seen within the polygon is still there: a ninth of the picture, and less than that.
    let drawn = |picture: &RgbaImage| {
        let background = *picture.get_pixel(0, 0);
        picture.pixels().filter(|pixel| **pixel != background).count()
    };
    assert!(drawn(&clipped) * 3 < drawn(&whole) && drawn(&clipped) > 100, "{} pixels", drawn(&clipped));
    let seen = window.events().len();
    window.press("ctrl+s");
    window.wait_for_event("scene_saved", seen, |_| true);
    assert!(window.quit().success());
}
