//! The views of where light comes from show what they claim.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;

use std::sync::Arc;

use cloud::{Chunk, Cloud, pack_normal, pack_radius};
use glam::{DVec3, Vec3};
use render::{Aov, ColorPlan, Frame, FrameStats, Material, Objects, PointStore};
use scene::{Camera, Settings, SpotLight};

use stage::Stage;

const SIZE: [u32; 2] = [64, 48];
const BACKGROUND: [u8; 3] = [0x12, 0x34, 0x56];
/// The radius of the squares' splats.
const DISC: f64 = 0.02;

/// A square in z = `z` that faces up, of one sRGB colour.
fn square(z: f64, half: f64, color: [u8; 3]) -> Chunk {
    let count = (2.0 * half / DISC).ceil() as u32;
    let at = |i: u32| ((f64::from(i) + 0.5) / f64::from(count) * 2.0 - 1.0) * half;
    let points: Vec<[f32; 3]> =
        (0..count * count).map(|i| [at(i % count), at(i / count), z].map(|value| value as f32)).collect();
    let mut chunk = Chunk::new(0, DVec3::ZERO, points);
    chunk.colors = Some(Arc::new(vec![[color[0], color[1], color[2], 255]; chunk.len()]));
    chunk.normals = Some(Arc::new(vec![pack_normal(Vec3::Z); chunk.len()]));
    chunk.radii = Some(Arc::new(vec![pack_radius(DISC as f32); chunk.len()]));
    chunk
}

/// A red floor in z = 0, and a blue square above its middle.
fn store(stage: &Stage) -> PointStore {
    let chunks = vec![square(0.0, 0.9, [200, 60, 40]), square(0.5, 0.25, [40, 80, 220])];
    let mut store = PointStore::new(stage.gpu.clone());
    let id = store.add_cloud(Material::default());
    let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
    let cloud = Cloud { chunks, ..Cloud::default() };
    let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
    store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
    store
}

/// A camera two above the floor, looking straight down.
fn camera() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::Z, 2.0, DVec3::Y)
}

fn lamp() -> SpotLight {
    SpotLight {
        position: DVec3::new(0.3, 0.2, 1.5),
        target: DVec3::ZERO,
        intensity: [4.0; 3],
        inner_degrees: 30.0,
        outer_degrees: 35.0,
    }
}

/// A lamp whose light all meets one place, within two pixels.
fn pointer(target: DVec3) -> SpotLight {
    let position = DVec3::new(-0.8, -0.7, 1.2);
    SpotLight { position, target, intensity: [100.0; 3], inner_degrees: 1.0, outer_degrees: 1.5 }
}

fn settings(pairs: &[(&str, &str)]) -> Settings {
    let mut settings = Settings::default();
    // The scene is small and lit by few lamps.
    let small = [("gi.vpls", "16"), ("gi.shadow_size", "32"), ("gi.shadow_points", "2000"), ("gi.interleave", "1")];
    for (key, value) in [("view.background", "#123456")].iter().chain(&small).chain(pairs) {
        settings.set_text(key, value).unwrap();
    }
    settings
}

/// The picture in sRGB of 8 bits.
fn picture(
    stage: &mut Stage,
    store: &PointStore,
    pairs: &[(&str, &str)],
    lights: &[SpotLight],
) -> (Vec<[u8; 3]>, FrameStats) {
    let objects = Objects { lights, ..Objects::default() };
    let stats = stage.renderer.render(store, &Frame::new(&camera(), &settings(pairs), objects, SIZE)).unwrap();
    let picture = stage.renderer.read_picture().unwrap();
    (picture.as_chunks::<4>().0.iter().map(|[red, green, blue, _]| [*red, *green, *blue]).collect(), stats)
}

fn aov(stage: &Stage, aov: Aov) -> Vec<Vec3> {
    let image = stage.renderer.read_aov(aov).unwrap();
    let channels = image.channels.len();
    image
        .data
        .chunks_exact(channels)
        .map(|texel| Vec3::from_array([0, 1, 2].map(|i| texel[i.min(channels - 1)])))
        .collect()
}

fn srgb(linear: f32) -> f32 {
    let clamped = linear.clamp(0.0, 1.0);
    if clamped <= 0.003_130_8 { 12.92 * clamped } else { 1.055 * clamped.powf(1.0 / 2.4) - 0.055 }
}

fn filmic(linear: f32) -> f32 {
    srgb(linear * (2.51 * linear + 0.03) / (linear * (2.43 * linear + 0.59) + 0.14))
}

/// The pixel coordinates of a place.
fn pixel_of(place: DVec3) -> [f64; 2] {
    let camera = camera();
    let view = camera.view_from_world() * (place - camera.eye);
    let focal = f64::from(SIZE[1]) * 0.5 / 30_f64.to_radians().tan();
    [f64::from(SIZE[0]) * 0.5 + view.x / view.z * focal, f64::from(SIZE[1]) * 0.5 - view.y / view.z * focal]
}

fn at(picture: &[[u8; 3]], [x, y]: [u32; 2]) -> [u8; 3] {
    picture[(y * SIZE[0] + x) as usize]
}

/// The picture `plain` as it is drawn under marks.
fn is_dimmed(shown: [u8; 3], plain: [u8; 3]) -> bool {
    let dimmed = plain.map(|channel| (f32::from(channel) * 0.4).round() as u8);
    plain == BACKGROUND && shown == plain || (0..3).all(|channel| shown[channel].abs_diff(dimmed[channel]) <= 1)
}

#[test]
fn views_of_the_surface_are_their_images_through_the_curve() {
    let mut stage = stage_or_skip!();
    let store = store(&stage);
    type Shown = fn(Vec3) -> Vec3;
    let through_curve: Shown = |light| light.map(filmic);
    let views: [(&str, Aov, Shown); 4] = [
        ("direct", Aov::Direct, through_curve),
        ("indirect", Aov::Indirect, through_curve),
        ("albedo", Aov::Albedo, |albedo| albedo.map(srgb)),
        ("normal", Aov::Normal, |normal| normal * 0.5 + 0.5),
    ];
    let methods = ["none", "auto"];
    let (plain, _) = picture(&mut stage, &store, &[], &[lamp()]);
    for (index, (view, image, shown)) in views.into_iter().enumerate() {
        let quality = if index % 2 == 0 { "high" } else { "nearest" };
        let pairs = [("light.show", view), ("reflection.method", methods[index % 2]), ("splat.quality", quality)];
        let (picture, stats) = picture(&mut stage, &store, &pairs, &[lamp()]);
        assert!(picture != plain, "{view}");
        assert!(stats.passes.iter().all(|pass| pass.name != "present"), "{view}");
        let (expected, mut seen) = (aov(&stage, image), [0, 0]);
        for (shown_there, image) in picture.iter().zip(expected) {
            seen[usize::from(image.is_nan())] += 1;
            let expected = if image.is_nan() {
                BACKGROUND
            } else {
                shown(image).to_array().map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8)
            };
            // Powers in 32 bits may round the other way.
            let off = (0..3).map(|channel| shown_there[channel].abs_diff(expected[channel])).max().unwrap();
            assert!(off <= 1, "{view}: {shown_there:?}, expected {expected:?}");
        }
        assert!(seen.iter().all(|count| *count > 200), "{seen:?}");
    }
}

#[test]
fn what_is_near_is_bright_in_the_view_of_depth_and_in_that_of_the_lamp() {
    let mut stage = stage_or_skip!();
    let store = store(&stage);
    let brightness = |color: [u8; 3]| color.map(u32::from).iter().sum::<u32>();
    let (depth, _) = picture(&mut stage, &store, &[("light.show", "depth")], &[lamp()]);
    let [middle, beside] = [[32, 24], [48, 24]].map(|pixel| brightness(at(&depth, pixel)));
    assert!(middle > beside + 50, "{middle} {beside}");
    assert_eq!(at(&depth, [1, 1]), BACKGROUND);

    // From straight above the middle, seeing to 0.8 about the square, whose half width is 0.25.
    let above = SpotLight { position: DVec3::new(0.0, 0.0, 1.5), target: DVec3::ZERO, outer_degrees: 38.65, ..lamp() };
    let (seen, _) = picture(&mut stage, &store, &[("light.show", "light-buffer"), ("gi.bounces", "0")], &[above]);
    for x in 0..SIZE[0] {
        // The map is square: it fills the height, and the pixels beside it are black.
        let is_outside = !(8..56).contains(&x);
        assert_eq!(at(&seen, [x, 24]) == [0; 3], is_outside, "{x}");
    }
    // The square is at a distance of one from the lamp and the nearest, 0.25 / 0.8 of half the map; the floor is the
    // farthest.
    let wide = (8..56).filter(|x| brightness(at(&seen, [*x, 24])) > 300).count();
    assert!(wide.abs_diff(15) <= 1, "{wide} of 48 pixels");
    // Two lamps have a cell each.
    let (both, _) = picture(&mut stage, &store, &[("light.show", "light-buffer")], &[above, above]);
    assert!([16, 48].map(|x| at(&both, [x, 24])) != [[0; 3]; 2] && at(&both, [32, 4]) == [0; 3]);
}

#[test]
fn a_virtual_light_is_drawn_where_it_stands_and_darker_where_it_is_hidden() {
    let mut stage = stage_or_skip!();
    let store = store(&stage);
    // Splats as large as the pointer's fine map needs them.
    let common = [("tone.curve", "srgb"), ("edl.strength", "0"), ("splat.max_pixels", "512")];
    // In the open, and below the blue square.
    for (target, is_hidden) in [(DVec3::new(0.6, -0.5, 0.0), false), (DVec3::new(0.05, 0.1, 0.0), true)] {
        let (plain, _) = picture(&mut stage, &store, &common, &[pointer(target)]);
        let pairs = [&common[..], &[("light.show", "virtual-lights")]].concat();
        let (shown, _) = picture(&mut stage, &store, &pairs, &[pointer(target)]);
        let [x, y] = pixel_of(target);
        let drawn = at(&shown, [x as u32, y as u32]);
        // The radiance of the red floor there clips at white; hidden lights are three tenths as bright.
        let brightest = if is_hidden { 77 } else { 255 };
        assert!(drawn[0].abs_diff(brightest) <= 1 && drawn[0] > drawn[2], "{target}: {drawn:?}");
        for (pixel, (shown, plain)) in shown.iter().zip(&plain).enumerate() {
            let [column, row] = [pixel as u32 % SIZE[0], pixel as u32 / SIZE[0]].map(|place| f64::from(place) + 0.5);
            let is_near = (column - x).hypot(row - y) < 4.0;
            assert!(is_near || is_dimmed(*shown, *plain), "{target}: {column} {row}: {shown:?}, {plain:?}");
        }
    }
}

#[test]
fn every_virtual_light_has_a_cell_of_shadow_maps() {
    let mut stage = stage_or_skip!();
    let store = store(&stage);
    for (by, vpls, columns, edge, count) in [("lights", "16", 4, 12, 16), ("sun", "20", 6, 10, 24_u32)] {
        let pairs = [("light.show", "shadow-maps"), ("light.by", by), ("gi.vpls", vpls), ("gi.sky_lights", "4")];
        let (shown, _) = picture(&mut stage, &store, &pairs, &[lamp()]);
        let rows = SIZE[1] / edge;
        let margin = [(SIZE[0] - columns * edge) / 2, (SIZE[1] - rows.min(count.div_ceil(columns)) * edge) / 2];
        let mut drawn = 0;
        for cell in 0..columns * rows {
            let corner = [margin[0] + cell % columns * edge, margin[1] + cell / columns * edge];
            let middle = at(&shown, [corner[0] + edge / 2, corner[1] + edge / 2]);
            drawn += u32::from(middle != [0; 3]);
            // Outside the half space.
            assert_eq!(at(&shown, corner), [0; 3], "{by}: cell {cell}");
        }
        // Lights that the sun or the sky sends past the scene have no place.
        let least = if by == "sun" { count * 3 / 4 } else { count };
        assert!((least..=count).contains(&drawn), "{by}: {drawn} of {count}");
        // Something is near, and something is empty.
        assert!(shown.iter().any(|color| color[0] > 100) && shown.iter().any(|color| color[0] == 0 && color[2] > 20));
    }
}

#[test]
fn views_of_lights_show_the_dimmed_picture_where_there_are_none() {
    let mut stage = stage_or_skip!();
    let store = store(&stage);
    let (plain, stats) = picture(&mut stage, &store, &[("edl.strength", "0")], &[]);
    assert!(stats.passes.iter().all(|pass| !pass.name.starts_with("show")));
    for view in ["light-buffer", "virtual-lights", "shadow-maps"] {
        for by in ["headlight", "lights"] {
            let pairs = [("light.show", view), ("light.by", by), ("edl.strength", "0"), ("reflection.show", "albedo")];
            let (shown, _) = picture(&mut stage, &store, &pairs, &[]);
            for (shown, plain) in shown.iter().zip(&plain) {
                let is_right = match by {
                    "lights" => [[0; 3], BACKGROUND].contains(shown),
                    _ => is_dimmed(*shown, *plain),
                };
                assert!(is_right, "{view} {by}: {shown:?}, {plain:?}");
            }
        }
    }
    // A lamp at the eye gives no indirect light.
    let (shown, _) = picture(&mut stage, &store, &[("light.show", "indirect")], &[]);
    assert!(shown.iter().all(|color| *color == [0; 3] || *color == BACKGROUND));
}
