//! How sure a surface is, as pictures show it: the colours by certainty, and the image of float values.

use exr::prelude::{FlatSamples, read_first_flat_layer_from_file};
use tests::{Folder, Outcome};

const SIZE: [usize; 2] = [160, 120];

/// A number from 0 to 1 for each number, as if drawn at random (the finaliser of splitmix64).
fn drawn(number: u64) -> f64 {
    let mut mixed = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((mixed ^ mixed >> 31) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A plate of 4 by 3 with points 0.02 apart, whose left half has a noise of 1 mm and its right half of 2 cm (of a triangular
/// distribution).
fn plate() -> String {
    let (columns, rows) = (200, 150);
    let point = |index: usize| {
        let (x, y) = ((index % columns) as f64 * 0.02, (index / columns) as f64 * 0.02);
        let noise = if x < 2.0 { 0.001 } else { 0.02 };
        let off = noise * 6.0_f64.sqrt() * (drawn(2 * index as u64) - drawn(2 * index as u64 + 1));
        format!("{x} {y} {off}\n")
    };
    let header = "ply\nformat ascii 1.0\nelement vertex 30000\nproperty float x\nproperty float y\nproperty float z\n";
    format!("{header}end_header\n{}", (0..columns * rows).map(point).collect::<String>())
}

/// Draws the plate from above; `None`, with a note, without an adapter.
fn render(folder: &Folder, words: &[&str]) -> Option<Outcome> {
    let common = ["render", "plate.ply", "-o", "picture.png", "--size", "160x120", "--camera", "top"];
    let flat = ["--set", "light.by=colors", "--set", "color.ramp=gray", "--set", "edl.strength=0"];
    folder.write("plate.ply", plate());
    let outcome = folder.glint(common.iter().chain(&flat).chain(words));
    if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
        println!("skipped: no adapter: {}", outcome.messages.trim());
        return None;
    }
    Some(outcome)
}

/// A channel of a float image.
fn float_image(folder: &Folder, name: &str, channel: usize) -> Vec<f32> {
    let image = read_first_flat_layer_from_file(folder.path(name)).expect("a float image");
    let FlatSamples::F32(values) = &image.layer_data.channel_data.list[channel].sample_data else {
        panic!("not full float")
    };
    values.clone()
}

/// The mean of the values in the left and in the right half of the picture that are numbers, without the middle.
fn halves(values: &[f32]) -> [f64; 2] {
    [0..70, 90..SIZE[0]].map(|columns| {
        let all =
            values.iter().enumerate().filter(|(pixel, value)| columns.contains(&(pixel % SIZE[0])) && !value.is_nan());
        let (count, sum) = all.fold((0.0, 0.0), |(count, sum), (_, value)| (count + 1.0, sum + f64::from(*value)));
        sum / count
    })
}

#[test]
fn the_image_and_the_colours_tell_a_noisy_half_from_a_smooth_one() {
    let folder = Folder::new();
    let images = ["--aov", "surface_error=error.exr", "--aov", "depth=depth.exr", "--aov", "position=position.exr"];
    let words = [&["--set", "color.by=certainty"][..], &images].concat();
    let Some(outcome) = render(&folder, &words) else { return };
    assert_eq!((outcome.status, outcome.messages.contains("warning")), (Some(0), false), "{outcome}");
    let [error, depth] = ["error.exr", "depth.exr"].map(|name| float_image(&folder, name, 0));
    // Seen from above each pixel's half width is some three times the noise.
    let [smooth, noisy] = halves(&error);
    assert!((0.0022..0.0040).contains(&smooth) && (0.044..0.080).contains(&noisy), "{smooth}, {noisy}");
    let pixels = || error.iter().zip(&depth);
    assert!(pixels().any(|(_, depth)| depth.is_nan()) && depth.iter().any(|depth| !depth.is_nan()));
    assert!(pixels().all(|(error, depth)| error.is_nan() == depth.is_nan()), "a number just where something is shown");
    // The plate itself is at height 0, and a half width also has room for the noise of a further measurement.
    let heights = float_image(&folder, "position.exr", 2);
    let held = error.iter().zip(&heights).filter(|(error, height)| height.abs() <= **error).count();
    let shown = depth.iter().filter(|depth| !depth.is_nan()).count();
    assert!(held as f64 > 0.97 * shown as f64, "{held} of {shown}");
    let picture = image::open(folder.path("picture.png")).expect("the picture").into_luma8().into_raw();
    let shades =
        picture.iter().zip(&depth).map(|(shade, depth)| if depth.is_nan() { f32::NAN } else { f32::from(*shade) });
    let [smooth, noisy] = halves(&shades.collect::<Vec<_>>());
    assert!(smooth < 30.0 && noisy > 90.0, "{smooth}, {noisy}");
}

#[test]
fn a_streamed_cloud_says_that_it_does_not_know_how_sure_its_surface_is() {
    let folder = Folder::new();
    let streamed = ["--set", "stream.pages=always", "--set", "color.by=certainty"];
    let Some(outcome) = render(&folder, &streamed) else { return };
    assert_eq!(outcome.status, Some(0), "{outcome}");
    assert!(outcome.messages.contains("no certainty, which only clouds in memory have"), "{outcome}");
    let image = [&streamed[..], &["--aov", "surface_error=error.exr"]].concat();
    let refused = folder.glint(["render", "plate.ply", "-o", "none.png"].iter().chain(&image));
    assert_eq!(refused.status, Some(2), "{refused}");
    assert!(refused.messages.contains("surface_error") && refused.messages.contains("stream.pages"), "{refused}");
    assert!(!folder.path("none.png").exists() && !folder.path("error.exr").exists());
}

/// A mirror above the plate, and a camera between the two that looks up at it.
const MIRROR: &str = "\
clouds = [\"plate.ply\"]
[parameters]
\"light.by\" = \"colors\"
\"color.by\" = \"certainty\"
\"color.ramp\" = \"gray\"
\"edl.strength\" = 0.0
[camera]
eye = [2.0, 1.5, 1.0]
pivot = [2.0, 1.5, 3.0]
up = [0.0, 1.0, 0.0]
[[mirrors]]
shape = { plane = { height = 1.0 } }
position = [2.0, 1.5, 3.0]
rotation = [1.0, 0.0, 0.0, 0.0]
size = 4.0
";

#[test]
fn a_mirror_shows_how_sure_the_surface_is_that_it_reflects() {
    let folder = Folder::new();
    folder.write("plate.ply", plate());
    folder.write("mirror.toml", MIRROR);
    for method in ["sscr_hierarchical", "surfel_trace", "environment_map"] {
        let method_set = format!("reflection.method={method}");
        let words = ["render", "mirror.toml", "-o", "picture.png", "--size", "160x120", "--set", &method_set];
        let images = ["--aov", "mirror_position=seen.exr"];
        let outcome = folder.glint(words.iter().chain(&images));
        if outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none() {
            return println!("skipped: no adapter: {}", outcome.messages.trim());
        }
        assert_eq!(outcome.status, Some(0), "{outcome}");
        let picture = image::open(folder.path("picture.png")).expect("the picture").into_luma8().into_raw();
        // What each pixel reflects: the smooth half of the plate, or the noisy one.
        // The channels are A, X, Y and Z.
        let place = float_image(&folder, "seen.exr", 1);
        let mean = |reflected: std::ops::Range<f32>| {
            let shades = picture.iter().zip(&place).filter(|(_, x)| reflected.contains(x)).map(|(shade, _)| shade);
            let shades: Vec<f64> = shades.map(|shade| f64::from(*shade)).collect();
            assert!(shades.len() > 500, "{method}: {} pixels", shades.len());
            shades.iter().sum::<f64>() / shades.len() as f64
        };
        let (smooth, noisy) = (mean(0.2..1.8), mean(2.2..3.8));
        assert!(smooth < 30.0 && noisy > 90.0, "{method}: {smooth}, {noisy}");
    }
}
