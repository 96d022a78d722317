//! What the window shows is what `glint render` shows, to the bit: in a scanned room, which gets its lamp of itself, and in a
//! streamed cloud, whose chunks come in another order each time.

use tests::Session;

/// Coloured points of a box as a scanner sees it from inside, as binary PLY: 8 by 6 units, and 3 high. Every tenth point is
/// there twice, in another colour, far from its twin in the file.
fn room(points: u32) -> Vec<u8> {
    let size = [8.0, 6.0, 3.0];
    let point = |index: u32| {
        // Steps of the golden ratio and of the plastic number fill each side evenly.
        let [u, v] = [0.754_877_666, 0.569_840_29].map(|step: f64| (f64::from(index) * step).fract());
        let (axis, end) = ((index % 3) as usize, f64::from(index / 3 % 2));
        let mut position = [0.0; 3];
        position[axis] = end * size[axis];
        position[(axis + 1) % 3] = u * size[(axis + 1) % 3];
        position[(axis + 2) % 3] = v * size[(axis + 2) % 3];
        (position, [80 + 50 * axis as u8, (150.0 * u) as u8 + 60, (150.0 * v) as u8 + 60])
    };
    let twins = (0..points).step_by(10).map(|index| (point(index).0, [250, 20, 20]));
    ply((0..points).map(point).chain(twins).map(|point| (point, 1)).collect())
}

/// A hilly square of coloured points, and among them noise of class 7 high above.
fn hills(points: u32) -> Vec<u8> {
    let point = |index: u32| {
        let [x, y] = [0.754_877_666, 0.569_840_29].map(|step: f64| (f64::from(index) * step).fract() * 100.0);
        let z = 4.0 * (x / 9.0).sin() * (y / 14.0).cos();
        let color = [x * 2.5, 140.0 + z * 20.0, y * 2.5].map(|value| value as u8);
        if index.is_multiple_of(50) { (([x, y, z + 12.0], [0, 0, 0]), 7) } else { (([x, y, z], color), 2) }
    };
    ply((0..points).map(point).collect())
}

/// Place and colour.
type Point = ([f64; 3], [u8; 3]);

/// Points, each with its class.
fn ply(points: Vec<(Point, u8)>) -> Vec<u8> {
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar classification\nend_header\n",
        points.len()
    )
    .into_bytes();
    for ((position, color), class) in points {
        file.extend(position.iter().flat_map(|value| (*value as f32).to_le_bytes()));
        file.extend(color);
        file.push(class);
    }
    file
}

/// Opens a scene in the window and renders it without one; the lights of the scene, as the window found them.
fn compare(session: &Session, scene: &str) -> serde_json::Value {
    let window = session.open([scene]);
    window.wait_for_event("settled", 0, |_| true);
    let surroundings = window.wait_for_event("surroundings", 0, |_| true);
    window.press("F12");
    let saved = window.wait_for_event("saved", 0, |_| true);
    let picture = image::open(session.folder.path(saved["path"].as_str().expect("a path"))).expect("the saved picture");
    let picture = picture.into_rgba8();
    assert!(window.quit().success());
    let size = format!("{}x{}", picture.width(), picture.height());
    let rendered = session.folder.glint(["render", scene, "--size", &size, "-o", "rendered.png"]);
    assert_eq!(rendered.status, Some(0), "{rendered}");
    let rendered = image::open(session.folder.path("rendered.png")).expect("the rendered picture").into_rgba8();
    assert!(tests::colors(&picture) > 100, "{} colours", tests::colors(&picture));
    let differing = picture.pixels().zip(rendered.pixels()).filter(|(a, b)| a != b).count();
    assert_eq!(differing, 0, "of {size} pixels of {scene}");
    surroundings
}

#[test]
fn a_room_with_the_lamp_that_it_gets_is_the_same_in_the_window_and_without_one() {
    let session = Session::start();
    session.folder.write("room.ply", room(100_000));
    session.folder.write("hidden.ply", hills(3000));
    let scene = "clouds = [\"hidden.ply\", \"room.ply\"]\n[camera]\neye = [1.0, 1.0, 1.7]\npivot = [5.0, 4.0, 1.2]\n\
                 up = [0.0, 0.0, 1.0]\n[parameters]\n\"gi.vpls\" = 16\n\
                 [[cloud_settings]]\ncloud = \"hidden.ply\"\non = false\n\
                 [[cloud_settings]]\ncloud = \"room.ply\"\nsize = 1.3\ncolor = { by = \"height\", ramp = \"magma\" }\n\
                 turn = [0.0, 0.0, 3.0]\nabout = [5.0, 4.0, 0.0]\nmove = [0.1, 0.0, 0.02]\n\
                 [[mirrors]]\nname = \"ball\"\nshape = \"sphere\"\nposition = [5.0, 4.0, 1.2]\nsize = 0.6\n";
    session.folder.write("room.toml", scene);
    let surroundings = compare(&session, "room.toml");
    assert_eq!((&surroundings["sky_is_open"], &surroundings["lights"]), (&false.into(), &1.into()));
}

#[test]
fn a_streamed_cloud_of_which_a_class_is_hidden_is_the_same_in_the_window_and_without_one() {
    let session = Session::start();
    session.folder.write("hills.ply", hills(250_000));
    let scene = "clouds = [\"hills.ply\"]\n[camera]\neye = [20.0, -30.0, 40.0]\npivot = [50.0, 40.0, 0.0]\n\
                 up = [0.0, 0.0, 1.0]\n[parameters]\n\"stream.pages\" = \"always\"\n\"view.point_budget\" = 100000\n\
                 \"gi.vpls\" = 16\n[visibility]\nhidden_classes = [7]\n\
                 [[cloud_settings]]\ncloud = \"hills.ply\"\nsize = 1.3\ncolor = { by = \"normal\" }\n\
                 turn = [0.0, 2.0, 30.0]\nabout = [50.0, 50.0, 0.0]\nmove = [0.0, 5.0, 0.0]\n";
    session.folder.write("hills.toml", scene);
    let surroundings = compare(&session, "hills.toml");
    assert_eq!(surroundings["sky_is_open"], true);
}
