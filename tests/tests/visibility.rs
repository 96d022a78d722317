//! What a scene file hides: pictures, mirrors, light and truth are as if it were not there, without a window and in one.

use std::collections::BTreeMap;

use tests::{Folder, Session, lacks_adapter};

/// A point of a LAS file.
struct Point {
    position: [f64; 3],
    color: [u8; 3],
    class: u8,
}

/// Of coordinates. Offsets in f32 are exact, wherever chunks begin.
const STEP: f64 = 1.0 / 1024.0;

/// A file 1.2 of point format 2.
fn las<'a>(points: impl Iterator<Item = &'a Point> + Clone) -> Vec<u8> {
    let count = points.clone().count() as u32;
    let mut file = b"LASF".to_vec();
    file.resize(24, 0);
    file.extend([1, 2]);
    file.resize(94, 0);
    file.extend(227_u16.to_le_bytes());
    file.extend(227_u32.to_le_bytes());
    file.extend(0_u32.to_le_bytes());
    file.push(2);
    file.extend(26_u16.to_le_bytes());
    file.extend(count.to_le_bytes());
    file.extend(count.to_le_bytes());
    file.resize(131, 0);
    file.extend([STEP; 3].iter().flat_map(|scale| scale.to_le_bytes()));
    file.resize(179, 0);
    for axis in 0..3 {
        let values = || points.clone().map(|point| point.position[axis]);
        for end in [values().fold(f64::MIN, f64::max), values().fold(f64::MAX, f64::min)] {
            file.extend(end.to_le_bytes());
        }
    }
    for point in points {
        file.extend(point.position.iter().flat_map(|value| ((value / STEP).round() as i32).to_le_bytes()));
        // Intensity; the only return; class; scan angle; user data; source. Some noise has other user data.
        let user_data = if point.class == 7 { 4 } else { 5 };
        file.extend([0, 0, 0b1001, point.class, 0, user_data, 0, 0]);
        file.extend(point.color.iter().flat_map(|value| (u16::from(*value) * 257).to_le_bytes()));
    }
    file
}

/// A floor and two walls of classes 2 and 6; then noise, so far from them that their normals do not know of it: some of it right
/// before the camera, and some far beyond the walls.
fn points() -> Vec<Point> {
    points_of(60_000)
}

/// The floor and walls of `points` with another number of points, a quarter of them noise.
fn points_of(count: u32) -> Vec<Point> {
    let even = |index: u32| [0.754_877_666, 0.569_840_29].map(|step: f64| (f64::from(index) * step).fract());
    let wall = |index: u32| {
        let ([u, v], axis) = (even(index), (index % 3) as usize);
        let mut position = [0.0; 3];
        position[(axis + 1) % 3] = 4.0 * u;
        position[(axis + 2) % 3] = 4.0 * v;
        let color = [90 + 60 * axis as u8, (150.0 * u) as u8 + 60, (150.0 * v) as u8 + 60];
        Point { position, color, class: if axis == 2 { 2 } else { 6 } }
    };
    let noise = |index: u32| {
        let [u, v] = even(index);
        let position =
            if index.is_multiple_of(2) { [5.0, 3.0 * u + 3.0, 3.0 * v + 1.0] } else { [60.0 + u, 90.0, 30.0 * v] };
        Point { position, color: [20, 250, 20], class: if index.is_multiple_of(3) { 7 } else { 18 } }
    };
    (0..count / 4 * 3).map(wall).chain((0..count / 4).map(noise)).collect()
}

const SCENE: &str = "[camera]\neye = [7.0, 6.0, 3.5]\npivot = [1.0, 1.0, 1.0]\nup = [0.0, 0.0, 1.0]\n\
    [parameters]\n\"gi.vpls\" = 16\n\"gi.shadow_points\" = 1000\n\"trace.samples\" = 4\n\
    [[mirrors]]\nname = \"ball\"\nshape = \"sphere\"\nposition = [1.5, 1.5, 1.2]\nsize = 0.8\n\
    [[lights]]\nposition = [3.0, 3.0, 3.8]\ntarget = [0.5, 0.5, 0.0]\nintensity = [20.0, 19.0, 17.0]\n\
    inner_degrees = 40.0\nouter_degrees = 60.0\n";
const HIDING: &str = "[visibility]\nhidden_classes = [7, 18]\n";
/// Ways to hide the noise: by class, by places, and by attributes.
const HIDINGS: [(&str, &str); 3] = [
    ("classes", HIDING),
    (
        "clips",
        "[[clips]]\nname = \"room\"\nposition = [2.0, 2.0, 2.0]\nsize = [4.0, 4.0, 4.0]\n\
         [[clips]]\nshape = \"sphere\"\nposition = [60.5, 90.0, 15.0]\nsize = [60.0, 60.0, 60.0]\nkeep = \"outside\"\n\
         [[clips]]\nshape = \"slab\"\non = false\n",
    ),
    (
        "filters",
        "[visibility]\nfilters = [{ attribute = \"classification\", high = 17.0 }, \
         { attribute = \"user_data\", low = 5.0, high = 6.0 }]\n",
    ),
];

/// The picture alone by `surfel_trace`, without its truth.
fn picture(folder: &Folder, scene: &str, arguments: &[&str]) -> Vec<u8> {
    let words = ["render", scene, "-o", "alone.png", "--size", "96x72", "--method", "surfel_trace"];
    let outcome = folder.glint(words.iter().chain(arguments));
    assert_eq!(outcome.status, Some(0), "{outcome}");
    std::fs::read(folder.path("alone.png")).expect("the picture")
}

/// All that a run writes by name: the picture, images of it and of its truth, and what its statistics say of points and accuracy.
fn rendered(folder: &Folder, scene: &str, method: &str) -> Option<BTreeMap<&'static str, Vec<u8>>> {
    let images = ["depth", "normal", "indirect", "mirror_position", "reference_position", "reference_color"];
    let aovs: Vec<String> = images.iter().map(|name| format!("{name}={name}.exr")).collect();
    let common = ["render", scene, "-o", "picture.png", "--size", "96x72", "--method", method, "--stats", "stats.json"];
    let aovs = aovs.iter().flat_map(|aov| ["--aov", aov]);
    let outcome = folder.glint(common.into_iter().chain(aovs));
    if lacks_adapter(&outcome) {
        return None;
    }
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let read = |name: &str| std::fs::read(folder.path(name)).expect("a file that was written");
    let mut written: BTreeMap<_, _> = images.iter().map(|name| (*name, read(&format!("{name}.exr")))).collect();
    let stats: serde_json::Value = serde_json::from_slice(&read("stats.json")).expect("JSON");
    written.insert("picture", read("picture.png"));
    written.insert("points drawn", stats["points"]["drawn"].to_string().into());
    written.insert("mirror pixels", stats["mirror_pixels"].to_string().into());
    written.insert("accuracy", stats["accuracy"].to_string().into());
    Some(written)
}

/// The number of pixels that are not equal in two pictures.
fn differing_pixels(one: &[u8], other: &[u8]) -> usize {
    let [one, other] = [one, other].map(|png| image::load_from_memory(png).expect("a picture").into_rgba8());
    one.pixels().zip(other.pixels()).filter(|(a, b)| a != b).count()
}

#[test]
fn hidden_points_are_as_good_as_absent_in_pictures_and_in_their_truth() {
    let folder = Folder::new();
    let points = points();
    folder.write("all.las", las(points.iter()));
    folder.write("shown.las", las(points.iter().filter(|point| ![7, 18].contains(&point.class))));
    folder.write("all.toml", format!("clouds = [\"all.las\"]\n{SCENE}"));
    folder.write("shown.toml", format!("clouds = [\"shown.las\"]\n{SCENE}"));
    folder.write("view.toml", format!("{SCENE}{HIDING}"));
    let mut by_class = None;
    for method in ["surfel_trace", "sscr"] {
        let Some(mut shown) = rendered(&folder, "shown.toml", method) else { return };
        assert!(shown["mirror pixels"].len() >= 3, "{method}: fewer than 100 mirror pixels");
        let mut traced = None;
        if method == "surfel_trace" {
            // Discs have their places in boxes that hold hidden points too, in steps of a 1023rd of these, and their
            // radii in steps of 2 %: a ray beside the rim of a disc may meet another one.
            ["mirror_position", "accuracy"].iter().for_each(|name| drop(shown.remove(name)));
            traced = shown.remove("picture");
        }
        for (how, hiding) in HIDINGS {
            folder.write("hiding.toml", format!("clouds = [\"all.las\"]\n{SCENE}{hiding}"));
            let hiding = rendered(&folder, "hiding.toml", method).expect("an adapter");
            for (name, written) in &shown {
                assert!(hiding[name] == *written, "{method}: {how}: {name}");
            }
            if let Some(picture) = &traced {
                let differing = differing_pixels(picture, &hiding["picture"]);
                assert!(differing < 96 * 72 / 100, "{method}: {how}: {differing} pixels differ");
                by_class = by_class.or_else(|| (how == "classes").then(|| hiding["picture"].clone()));
            }
        }
    }
    let all = picture(&folder, "all.toml", &[]);
    let view = picture(&folder, "all.toml", &["--camera", "view.toml"]);
    assert!(Some(&all) != by_class.as_ref() && Some(&view) == by_class.as_ref(), "--camera FILE hides what it says");
    folder.write("hiding.toml", format!("clouds = [\"all.las\"]\n{SCENE}{HIDING}"));
    // Framed without a camera: what is hidden takes no room.
    let framed = |name: &str, scene: &str| {
        let words = ["render", scene, "-o", name, "--size", "96x72", "--camera", "iso", "--set", "gi.bounces=0"];
        let outcome = folder.glint(words);
        assert_eq!(outcome.status, Some(0), "{outcome}");
        std::fs::read(folder.path(name)).expect("the picture")
    };
    assert!(framed("a.png", "hiding.toml") == framed("b.png", "shown.toml"), "framing differs");
    folder.write("none.toml", "clouds = [\"all.las\"]\n[visibility]\nhidden_classes = [2, 6, 7, 18]\n");
    let outcome = folder.glint(["render", "none.toml", "-o", "none.png", "--size", "96x72"]);
    assert!(outcome.status == Some(0) && outcome.messages.contains("hides all of their points"), "{outcome}");
}

#[test]
fn the_legend_names_the_classes_that_are_shown_however_others_are_hidden() {
    let folder = Folder::new();
    folder.write("all.las", las(points().iter()));
    let mut pictures = Vec::new();
    // The last one has no legend.
    let all = HIDINGS.map(|(how, hiding)| (how, hiding, true)).into_iter().chain([("nothing", HIDING, false)]);
    for (how, hiding, legend) in all {
        folder.write("hiding.toml", format!("clouds = [\"all.las\"]\n{SCENE}{hiding}"));
        let words = format!("render hiding.toml -o a.png --size 320x240 --method none --set overlay.legend={legend}");
        let colors = "--set color.by=class --set light.by=colors";
        let outcome = folder.glint(words.split(' ').chain(colors.split(' ')));
        if lacks_adapter(&outcome) {
            return;
        }
        assert_eq!(outcome.status, Some(0), "{outcome}");
        pictures.push((how, std::fs::read(folder.path("a.png")).expect("the picture")));
    }
    let (_, without) = pictures.pop().expect("the last one");
    let (how, first) = &pictures[0];
    assert!(*first != without, "there is no legend");
    pictures[1..].iter().for_each(|(other, picture)| assert!(picture == first, "{how} and {other} differ"));
}

/// The points elsewhere, at coordinates that are exact, too.
fn away(points: Vec<Point>) -> Vec<Point> {
    let away =
        |Point { position: [x, y, z], color, class }| Point { position: [x + 3.0, y - 800.0, z + 1.0], color, class };
    points.into_iter().map(away).collect()
}

/// Moves them back.
const BACK: &str = "[[cloud_settings]]\ncloud = \"away.las\"\nmove = [-3, 800, -1]\n";

#[test]
fn a_moved_cloud_is_as_if_its_file_had_it_where_it_stands_in_pictures_and_in_their_truth() {
    let folder = Folder::new();
    folder.write("all.las", las(points().iter()));
    folder.write("away.las", las(away(points()).iter()));
    folder.write("all.toml", format!("clouds = [\"all.las\"]\n{SCENE}"));
    folder.write("moved.toml", format!("clouds = [\"away.las\"]\n{SCENE}{BACK}"));
    folder.write("away.toml", format!("clouds = [\"away.las\"]\n{SCENE}"));
    let Some(all) = rendered(&folder, "all.toml", "surfel_trace") else { return };
    let moved = rendered(&folder, "moved.toml", "surfel_trace").expect("an adapter");
    for (name, written) in &all {
        assert!(moved[name] == *written, "{name}");
    }
    assert!(picture(&folder, "away.toml", &[]) != all["picture"], "the test would prove nothing");
}

/// What is said of a picture of a scene, so large that the finest points are more than `stream.detail` apart. None where
/// there is no adapter and none is required.
fn statistics(folder: &Folder, scene: &str, pages: &str) -> Option<serde_json::Value> {
    let settings = ["light.by=headlight", pages, "stream.detail=0.25", "stream.unseen=1"];
    let picture = ["render", scene, "-o", "picture.png", "--size", "384x288", "--stats", "stats.json"];
    let outcome = folder.glint(picture.into_iter().chain(settings.into_iter().flat_map(|one| ["--set", one])));
    if lacks_adapter(&outcome) {
        return None;
    }
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let text = std::fs::read_to_string(folder.path("stats.json")).expect("the statistics");
    Some(serde_json::from_str(&text).expect("JSON"))
}

/// What a scene file clips of streamed points is neither drawn nor loaded.
#[test]
fn clipped_points_of_a_streamed_cloud_are_as_good_as_absent_and_most_are_not_loaded() {
    let folder = Folder::new();
    // More than a node of an index holds.
    let points = points_of(300_000);
    let [low, high] = [[0.0, 0.0, 0.5], [4.0, 2.5, 4.0]];
    let written = |value: f64| (value / STEP).round() * STEP;
    let is_in = |point: &&Point| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&written(point.position[axis])));
    folder.write("all.las", las(points.iter()));
    let kept = points.iter().filter(is_in).count() as u64;
    let clip = "[[clips]]\nposition = [2.0, 1.25, 2.25]\nsize = [4.0, 2.5, 3.5]\n";
    folder.write("clipped.toml", format!("clouds = [\"all.las\"]\n{clip}"));
    // A file from elsewhere, which the scene moves here, is clipped alike: the clip is in the world.
    folder.write("away.las", las(away(points).iter()));
    folder.write("moved.toml", format!("clouds = [\"away.las\"]\n{clip}{BACK}"));
    let points = points_of(300_000);
    let both = ["stream.pages=never", "stream.pages=always"]
        .map(|pages| ["clipped.toml", "moved.toml"].map(|scene| (scene, pages)));
    for (scene, pages) in both.into_iter().flatten() {
        let Some(stats) = statistics(&folder, scene, pages) else { return };
        assert_eq!(stats["points"]["drawn"].as_u64(), Some(kept), "{scene}, {pages}: {stats}");
        if let Some(resident) = stats["stream"]["points_resident"].as_u64() {
            // The root of the index is always loaded, and so are the nodes that the border cuts.
            assert!((kept..points.len() as u64 * 9 / 10).contains(&resident), "{scene}: {resident} of {kept} loaded");
        } else {
            assert!(pages.ends_with("never"), "{stats}");
        }
    }
}

/// An index keeps few attributes unless it is asked to.
#[test]
fn a_filter_hides_points_of_a_streamed_cloud_by_any_attribute_of_its_file() {
    let folder = Folder::new();
    // So near to each other that a picture needs all of them.
    let points: Vec<Point> = points().into_iter().filter(|point| point.position[0] < 10.0).collect();
    folder.write("all.las", las(points.iter()));
    let shown = points.iter().filter(|point| point.class != 7).count() as u64;
    let [_, _, (_, filters)] = HIDINGS;
    let filters = filters.replace("17.0", "18.0");
    folder.write("hiding.toml", format!("clouds = [\"all.las\"]\n{filters}"));
    folder.write("all.toml", "clouds = [\"all.las\"]\n");
    for (scene, expected) in [("all.toml", points.len() as u64), ("hiding.toml", shown)] {
        let Some(stats) = statistics(&folder, scene, "stream.pages=always") else { return };
        assert_eq!(stats["stream"]["points_resident"].as_u64(), Some(points.len() as u64), "{stats}");
        assert_eq!(stats["points"]["drawn"].as_u64(), Some(expected), "{scene}: {stats}");
    }
}

#[test]
fn a_study_measures_what_the_scene_shows() {
    let folder = Folder::new();
    let points = points();
    folder.write("all.las", las(points.iter()));
    folder.write("shown.las", las(points.iter().filter(|point| ![7, 18].contains(&point.class))));
    folder.write("hiding.toml", format!("clouds = [\"all.las\"]\n{SCENE}{HIDING}"));
    folder.write("shown.toml", format!("clouds = [\"shown.las\"]\n{SCENE}"));
    let figures = |scene: &str| {
        let plan = format!(
            "title = 'one'\nsize = '96x72'\nrepeats = 1\n[[group]]\nscenes = ['{scene}.toml']\nmethods = ['sscr']\n"
        );
        folder.write("plan.toml", plan);
        let outcome = folder.glint(["study", "plan.toml", "-o", scene]);
        if lacks_adapter(&outcome) {
            return None;
        }
        assert_eq!(outcome.status, Some(0), "{outcome}");
        let text = std::fs::read_to_string(folder.path(&format!("{scene}/results.json"))).expect("the results");
        let results: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let row = results[0].as_object().expect("a row");
        let is_of_picture = |key: &str| key.starts_with("same_input") || key == "hit_rate" || key == "mirror_pixels";
        let figures: Vec<_> = row.iter().filter(|(key, _)| is_of_picture(key)).collect();
        assert!(figures.iter().filter(|(_, value)| value.is_number()).count() > 8, "{figures:?}");
        Some(format!("{figures:?}"))
    };
    assert_eq!(figures("hiding"), figures("shown"));
}

#[test]
fn the_window_hides_what_a_scene_file_hides_and_saves_it() {
    let session = Session::start();
    session.folder.write("all.las", las(points().iter()));
    session.folder.write("hiding.toml", format!("clouds = [\"all.las\"]\n{SCENE}{HIDING}"));
    let window = session.open(["hiding.toml"]);
    window.wait_for_event("settled", 0, |_| true);
    window.press("F12");
    let saved = window.wait_for_event("saved", 0, |_| true);
    let scene = window.save_scene_as();
    assert!(window.quit().success());
    let picture = image::open(session.folder.path(saved["path"].as_str().expect("a path"))).expect("the saved picture");
    let size = format!("{}x{}", picture.width(), picture.height());
    let scene = scene.as_str();
    for scene in ["hiding.toml", scene] {
        let rendered = session.folder.glint(["render", scene, "--size", &size, "-o", "rendered.png"]);
        assert_eq!(rendered.status, Some(0), "{rendered}");
        let rendered = image::open(session.folder.path("rendered.png")).expect("the rendered picture");
        assert!(rendered.into_rgba8() == picture.clone().into_rgba8(), "{scene} is another picture");
    }
    let text = std::fs::read_to_string(session.folder.path(scene)).expect("the saved scene");
    assert!(text.contains("hidden_classes = [7, 18]"), "{text}");
}

/// The values of a channel of a float image, and the origin that it names.
fn channel(file: &std::path::Path, name: &str) -> (Vec<f64>, String) {
    use exr::prelude::{AttributeValue, FlatSamples, Text, read_first_flat_layer_from_file};
    let layer = read_first_flat_layer_from_file(file).expect("a float image").layer_data;
    let channel = layer.channel_data.list.iter().find(|channel| channel.name.eq(name)).expect("the channel");
    let FlatSamples::F32(values) = &channel.sample_data else { panic!("not float32") };
    let origin = match layer.attributes.other.get(&Text::from("origin")) {
        Some(AttributeValue::Text(text)) => text.to_string(),
        other => panic!("no origin: {other:?}"),
    };
    (values.iter().map(|value| f64::from(*value)).collect(), origin)
}

#[test]
fn positions_in_the_coordinates_of_a_survey_keep_their_millimetres() {
    let folder = Folder::new();
    for (name, [east, north]) in [("near", [0.0, 0.0]), ("far", [500_000.25, 4_600_000.75])] {
        let point = |at: u32| {
            let [x, y] = [at % 80, at / 80].map(|step| f64::from(step) * 0.05 - 2.0);
            format!("{} {} 100.125\n", east + x, north + y)
        };
        let rows: String = (0..6400).map(point).collect();
        let axes: String = ["x", "y", "z"].map(|axis| format!("property double {axis}\n")).concat();
        folder.write("plane.ply", format!("ply\nformat ascii 1.0\nelement vertex 6400\n{axes}end_header\n{rows}"));
        folder.write(
            "plane.toml",
            format!(
                "clouds = [\"plane.ply\"]\n[camera]\neye = [{east}, {north}, 103.125]\n\
                 pivot = [{east}, {north}, 100.125]\nup = [0.0, 1.0, 0.0]\n[[mirrors]]\nname = \"ball\"\nshape = \"sphere\"\n\
                 position = [{}, {north}, 100.6]\nsize = 0.4\n",
                east + 0.8
            ),
        );
        let aovs = ["position", "mirror_position", "reference_position"].map(|aov| format!("{aov}={aov}.exr"));
        let aovs = aovs.iter().flat_map(|aov| ["--aov", aov]);
        let words = "render plane.toml -o a.png --size 96x72 --method sscr_hierarchical".split(' ');
        let outcome = folder.glint(words.chain(aovs));
        if lacks_adapter(&outcome) {
            return;
        }
        assert_eq!(outcome.status, Some(0), "{outcome}");
        assert_eq!(outcome.messages.contains("relative to 500000 4600001 100"), name == "far", "{outcome}");
        let origin = if name == "far" { [500_000.0, 4_600_001.0, 100.0] } else { [0.0; 3] };
        for aov in ["position", "mirror_position", "reference_position"] {
            let file = folder.path(&format!("{aov}.exr"));
            let [x, y, z] = ["X", "Y", "Z"].map(|name| channel(&file, name));
            assert_eq!(x.1, format!("{} {} {}", origin[0], origin[1], origin[2]), "{aov}");
            let places =
                x.0.iter().zip(&y.0).zip(&z.0).map(|((x, y), z)| [origin[0] + x, origin[1] + y, origin[2] + z]);
            // What the plane shows, and not the ball.
            let on_plane = |place: &[f64; 3]| (place[2] - 100.125).abs() < 2e-3;
            let places: Vec<[f64; 3]> = places.filter(on_plane).collect();
            assert!(places.len() > 40, "{aov}: {}", places.len());
            assert!(
                places.iter().all(|place| (place[0] - east).abs() < 2.1 && (place[1] - north).abs() < 2.1),
                "{aov}"
            );
            // Rounded to half a metre there would be nine of them.
            let rows: std::collections::BTreeSet<i64> =
                places.iter().map(|place| ((place[1] - north) * 1e3).round() as i64).collect();
            assert!(rows.len() > 20, "{aov}: {}", rows.len());
        }
    }
}
