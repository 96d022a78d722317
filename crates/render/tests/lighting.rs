//! Light on the GPU against closed forms.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;
mod walls;

use std::f64::consts::{FRAC_1_PI, PI};

use cloud::Chunk;
use glam::{DVec3, Vec3};
use render::{Aov, Frame, Material, Objects, PointStore};
use scene::five_mirrors::{self, Variant};
use scene::{Camera, LightClues, Settings, SpotLight};

use stage::Stage;
use walls::{ALBEDO, settings, store_of, wall};

const SIZE: [u32; 2] = [64, 48];

/// A wall in z = `z`, x and y from -`half` to `half`.
fn square(z: f64, half: f64) -> Chunk {
    wall(DVec3::new(-half, -half, z), [DVec3::X * 2.0 * half, DVec3::Y * 2.0 * half])
}

/// A lamp two above the wall in z = 0.
fn camera() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::Z, 2.0, DVec3::Y)
}

fn lamp() -> SpotLight {
    SpotLight {
        position: DVec3::new(0.4, 0.2, 1.5),
        target: DVec3::new(0.1, 0.0, 0.0),
        intensity: [4.0, 2.0, 1.0],
        inner_degrees: 65.0,
        outer_degrees: 70.0,
    }
}

/// The direction of the ray through a pixel's centre.
fn ray(camera: &Camera, size: [u32; 2], pixel: usize) -> DVec3 {
    let (x, y) = ((pixel as u32 % size[0]) as f64 + 0.5, (pixel as u32 / size[0]) as f64 + 0.5);
    let [width, height] = size.map(f64::from);
    let focal = height * 0.5 / 30_f64.to_radians().tan();
    camera.view_from_world().transpose() * DVec3::new((x - width * 0.5) / focal, (height * 0.5 - y) / focal, 1.0)
}

/// Where the ray through a pixel's centre meets the plane z = 0.
fn on_floor(camera: &Camera, pixel: usize) -> DVec3 {
    let direction = ray(camera, SIZE, pixel);
    camera.eye - direction * (camera.eye.z / direction.z)
}

fn read(stage: &Stage, aov: Aov) -> Vec<DVec3> {
    let image = stage.renderer.read_aov(aov).unwrap();
    image.data.as_chunks::<3>().0.iter().map(|rgb| Vec3::from(*rgb).as_dvec3()).collect()
}

/// The definition of highlights, radiance per irradiance.
fn highlight(kind: &str, normal: DVec3, to_light: DVec3, to_eye: DVec3, power: f64) -> f64 {
    if kind == "phong" {
        let mirrored = normal * (2.0 * normal.dot(to_light)) - to_light;
        return (power + 2.0) / (2.0 * PI) * mirrored.dot(to_eye).max(0.0).powf(power);
    }
    let scale = (power + 2.0) * (power + 4.0) / (8.0 * PI * (2_f64.powf(-power / 2.0) + power));
    scale * normal.dot((to_light + to_eye).normalize()).max(0.0).powf(power)
}

/// The irradiance of the floor by the lamp, within its inner cone.
fn irradiance(lamp: &SpotLight, at: DVec3) -> DVec3 {
    let offset = lamp.position - at;
    DVec3::from(lamp.intensity.map(f64::from)) * (offset.z / offset.length().powi(3))
}

#[test]
fn a_lamp_on_a_glossy_wall_is_the_closed_form() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![square(0.0, 2.5)], Material::default());
    let (camera, lamp) = (camera(), lamp());
    for (kind, diffuse) in [("phong", 1.0), ("blinn", 1.0), ("phong", 2.5)] {
        let settings = settings(&[
            ("light.diffuse", &diffuse.to_string()),
            ("light.gloss", "0.4"),
            ("light.gloss_power", "30"),
            ("light.highlight", kind),
            ("reflection.method", "none"),
        ]);
        let objects = Objects { lights: &[lamp], ..Objects::default() };
        stage.renderer.render(&store, &Frame::new(&camera, &settings, objects, SIZE)).unwrap();
        let direct = read(&stage, Aov::Direct);
        assert_eq!(direct, read(&stage, Aov::Color));
        for (pixel, direct) in direct.into_iter().enumerate() {
            let at = on_floor(&camera, pixel);
            let [to_light, to_eye] = [lamp.position, camera.eye].map(|place| (place - at).normalize());
            let shape = highlight(kind, DVec3::Z, to_light, to_eye, 30.0);
            let expected = irradiance(&lamp, at) * (0.6 * diffuse * ALBEDO * FRAC_1_PI + 0.4 * shape);
            let error = ((direct - expected) / expected).abs().max_element();
            assert!(error < 0.01, "{kind} at {at}: {direct}, expected {expected}");
        }
    }
}

#[test]
fn points_with_a_gloss_of_their_own_are_no_mirror_and_show_it() {
    let mut stage = stage_or_skip!();
    let material = Material { specular_intensity: -0.4, specular_power: 30.0, ..Default::default() };
    let store = store_of(&stage, vec![square(0.0, 2.5)], material);
    let (camera, lamp) = (camera(), lamp());
    for (quality, method) in [("high", "surfel_trace"), ("nearest", "surfel_trace"), ("high", "sscr"), ("high", "none")]
    {
        let settings = settings(&[("light.gloss", "0.9"), ("splat.quality", quality), ("reflection.method", method)]);
        let objects = Objects { lights: &[lamp], ..Objects::default() };
        stage.renderer.render(&store, &Frame::new(&camera, &settings, objects, SIZE)).unwrap();
        let (direct, mirror) = (read(&stage, Aov::Direct), stage.renderer.read_aov(Aov::Mirror).unwrap().data);
        assert!(mirror.iter().all(|mirror| *mirror == 0.0), "{quality}, {method}: a mirror");
        for (pixel, direct) in direct.into_iter().enumerate() {
            let at = on_floor(&camera, pixel);
            let [to_light, to_eye] = [lamp.position, camera.eye].map(|place| (place - at).normalize());
            let shape = highlight("phong", DVec3::Z, to_light, to_eye, 30.0);
            let expected = irradiance(&lamp, at) * (0.6 * ALBEDO * FRAC_1_PI + 0.4 * shape);
            let error = ((direct - expected) / expected).abs().max_element();
            assert!(error < 0.01, "{quality}, {method} at {at}: {direct}, expected {expected}");
        }
    }
}

#[test]
fn a_mirror_with_a_power_shows_the_lamp_and_one_without_does_not() {
    let mut stage = stage_or_skip!();
    let (camera, lamp) = (camera(), lamp());
    let objects = Objects { lights: &[lamp], ..Objects::default() };
    let background = [0x40; 3].map(|level: u8| ((f64::from(level) / 255.0 + 0.055) / 1.055).powf(2.4));
    for (power, bounces, tint) in [(0.0, "1", 0.0), (40.0, "1", 0.0), (40.0, "1", 1.0), (40.0, "0", 0.0)] {
        let material = Material { specular_intensity: 0.75, specular_power: power, ..Default::default() };
        let store = store_of(&stage, vec![square(0.0, 2.5)], material);
        let settings = settings(&[
            ("view.background", "#404040"),
            ("reflection.method", "surfel_trace"),
            ("reflection.bounces", bounces),
            ("mirror.tint", &tint.to_string()),
        ]);
        stage.renderer.render(&store, &Frame::new(&camera, &settings, objects, SIZE)).unwrap();
        let (direct, color) = (read(&stage, Aov::Direct), read(&stage, Aov::Color));
        for (pixel, (direct, color)) in direct.into_iter().zip(color).enumerate() {
            let at = on_floor(&camera, pixel);
            let [to_light, to_eye] = [lamp.position, camera.eye].map(|place| (place - at).normalize());
            let shape = if power > 0.0 { highlight("phong", DVec3::Z, to_light, to_eye, power.into()) } else { 0.0 };
            // Beside a reflection that is followed, diffuse light is the remainder that the mirror leaves.
            let share = if bounces == "0" { 0.0 } else { 0.75 };
            let tint = 1.0 + tint * (ALBEDO - 1.0);
            let expected = irradiance(&lamp, at) * ((1.0 - share) * ALBEDO * FRAC_1_PI + 0.75 * tint * shape);
            let error = ((direct - expected) / expected).abs().max_element();
            assert!(error < 0.01, "power {power}, {bounces} bounces at {at}: {direct}, expected {expected}");
            let reflected = DVec3::from(background) * (share * tint);
            // The rounding of two half floats of ten bits.
            assert!(((color - direct - reflected) / color).abs().max_element() < 2e-3, "{color}, direct {direct}");
        }
    }
}

/// The definition of tone mapping, to 8 bits.
fn on_screen(linear: f64, exposure: f64, is_filmic: bool) -> u8 {
    let x = linear * 2_f64.powf(exposure);
    let shown = if is_filmic { x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14) } else { x }.clamp(0.0, 1.0);
    let srgb = if shown <= 0.003_130_8 { 12.92 * shown } else { 1.055 * shown.powf(1.0 / 2.4) - 0.055 };
    (srgb * 255.0).round() as u8
}

#[test]
fn tone_mapping_is_its_formula_and_leaves_the_background_alone() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![square(0.0, 0.9)], Material::default());
    let lamp = lamp();
    // The setting, whether there is a lamp, and whether the curve is then filmic.
    let cases = [("auto", true, true), ("auto", false, false), ("filmic", false, true), ("srgb", true, false)];
    for (curve, is_lit, is_filmic) in cases {
        for exposure in [-2.0, 0.0, 1.5] {
            let settings = settings(&[
                ("tone.curve", curve),
                ("tone.exposure", &exposure.to_string()),
                ("edl.strength", "0"),
                ("view.background", "#123456"),
            ]);
            let lights = if is_lit { &[lamp][..] } else { &[] };
            let objects = Objects { lights, ..Objects::default() };
            stage.renderer.render(&store, &Frame::new(&camera(), &settings, objects, SIZE)).unwrap();
            let (color, picture) = (read(&stage, Aov::Color), stage.renderer.read_picture().unwrap());
            let texels: Vec<[f32; 3]> = color.iter().map(|color| color.as_vec3().to_array()).collect();
            stage.renderer.present(&settings, &texels, false).unwrap();
            assert!(
                stage.renderer.read_picture().unwrap() == picture,
                "{curve} {exposure}: traced colours are mapped alike"
            );
            let mut seen = [0; 2];
            for (color, shown) in color.into_iter().zip(picture.as_chunks::<4>().0) {
                let is_empty = color.is_nan();
                seen[usize::from(is_empty)] += 1;
                let expected = color.to_array().map(|linear| on_screen(linear, exposure, is_filmic));
                let expected = if is_empty { [0x12, 0x34, 0x56] } else { expected };
                // Powers in 32 bits may round the other way.
                let off = (0..3).map(|channel| shown[channel].abs_diff(expected[channel])).max().unwrap();
                assert!(off <= u8::from(!is_empty), "{curve} {exposure}: {shown:?}, expected {expected:?}");
            }
            assert!(seen.iter().all(|count| *count > 200), "{seen:?}");
        }
    }
}

/// A floor in z = 0 that extends to `half`, and a square of half width 0.3 at 0.5 above it.
fn floor_with_blocker(stage: &Stage, half: f64) -> PointStore {
    store_of(stage, vec![square(0.0, half), square(0.5, 0.3)], Material::default())
}

/// A camera above the floor that sees below the blocker; z is up.
fn slanted_camera() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::new(-0.25, -0.4, 1.0), 2.0, DVec3::Z)
}

fn by_sun(more: &[(&str, &str)]) -> Settings {
    let sun = [
        ("light.by", "sun"),
        ("sun.azimuth", "90"),
        ("sun.elevation", "50"),
        ("sun.irradiance", "3"),
        ("sun.sky", "0"),
    ];
    settings(&[&sun[..], more].concat())
}

#[test]
fn a_sun_lights_a_plane_evenly_but_for_the_shadow_of_what_is_above_it() {
    let mut stage = stage_or_skip!();
    // The view is a small part of the larger floor: there the sun has a map of the view. Another cloud may lie far away.
    for (half, is_alone) in [(1.2, true), (8.0, true), (8.0, false)] {
        let mut store = floor_with_blocker(&stage, half);
        if !is_alone {
            let cloud = store.add_cloud(Material::default());
            store.add_chunk(cloud, &Chunk { origin: DVec3::new(4e6, 3e6, 0.0), ..square(0.0, half) }, None).unwrap();
        }
        let camera = slanted_camera();
        let settings = by_sun(&[]);
        stage.renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), SIZE)).unwrap();
        let (direct, depth) = (read(&stage, Aov::Direct), stage.renderer.read_aov(Aov::Depth).unwrap().data);
        let to_sun = settings.sun.direction(camera.up);
        let lit = 3.0 * to_sun.z * ALBEDO * FRAC_1_PI;
        let mut counts = [0; 3];
        for (pixel, direct) in direct.into_iter().enumerate() {
            let at = on_floor(&camera, pixel);
            let is_floor = ((at - camera.eye).dot(camera.forward()) - f64::from(depth[pixel])).abs() < 0.01;
            // Where the ray to the sun passes the blocker's plane.
            let passes = (at + to_sun * (0.5 / to_sun.z)).abs();
            let outside = passes.x.max(passes.y) - 0.3;
            // Within a splat and the filter of the outline either is right.
            let expected = if !is_floor || outside > 0.06 {
                lit
            } else if outside < -0.06 {
                0.0
            } else {
                continue;
            };
            if !is_floor && at.abs().max_element() > half {
                continue;
            }
            counts[if !is_floor { 2 } else { usize::from(expected == 0.0) }] += 1;
            let tolerance = lit * 0.003;
            assert!(
                (direct - expected).abs().max_element() < tolerance,
                "{half}, at {at}: {direct}, expected {expected}"
            );
        }
        assert!(counts.iter().all(|count| *count > 50), "{half}: {counts:?}");
    }
}

#[test]
fn shadows_of_a_sun_stand_still_while_the_camera_moves() {
    let mut stage = stage_or_skip!();
    let store = floor_with_blocker(&stage, 8.0);
    // Looking straight down without perspective: a step of whole pixels shows the same points shifted by as many.
    let camera = camera();
    let pixel = 2.0 * 2.0 * 30_f64.to_radians().tan() / f64::from(SIZE[1]);
    // With y up, the sun is in the south, toward z.
    let settings = by_sun(&[("view.projection", "orthographic"), ("sun.azimuth", "180")]);
    let mut direct = |camera: &Camera| {
        stage.renderer.render(&store, &Frame::new(camera, &settings, Objects::default(), SIZE)).unwrap();
        read(&stage, Aov::Direct)
    };
    let before = direct(&camera);
    let [width, height] = SIZE.map(|edge| edge as usize);
    for steps in [1_usize, 3, 17] {
        let shift = DVec3::X * (pixel * steps as f64);
        let after = direct(&Camera { eye: camera.eye + shift, pivot: camera.pivot + shift, ..camera });
        let mut counts = [0; 2];
        for (y, x) in (0..height).flat_map(|y| (0..width - steps).map(move |x| (y, x))) {
            let (was, is) = (before[y * width + x + steps], after[y * width + x]);
            assert!((was - is).abs().max_element() < 2e-3, "{steps} steps, at {x} {y}: {was} became {is}");
            counts[usize::from(was.x > 0.1)] += 1;
        }
        assert!(counts.iter().all(|count| *count > 100), "in shadow and lit: {counts:?}");
    }
}

#[test]
fn no_light_is_dark_and_an_open_sky_brings_a_sun() {
    let mut stage = stage_or_skip!();
    let store = floor_with_blocker(&stage, 1.0);
    let mut brightest = |settings: &Settings, lights: &[SpotLight], sky_is_open| {
        let clues = LightClues { sky_is_open, ..LightClues::default() };
        let objects = Objects { lights, clues, ..Objects::default() };
        stage.renderer.render(&store, &Frame::new(&slanted_camera(), settings, objects, SIZE)).unwrap();
        read(&stage, Aov::Direct)
            .into_iter()
            .filter(|color| !color.is_nan())
            .fold(0.0, |most: f64, color| most.max(color.max_element()))
    };
    let dark = SpotLight { intensity: [0.0; 3], ..lamp() };
    assert_eq!(brightest(&Settings::default(), &[dark], true), 0.0);
    assert_eq!(brightest(&by_sun(&[("sun.irradiance", "0")]), &[lamp()], true), 0.0);
    // Just above the horizon, it lights no floor.
    assert!(brightest(&by_sun(&[("sun.elevation", "0")]), &[], true) < 1e-6);
    let sun =
        brightest(&settings(&[("light.by", "surroundings"), ("light.fill", "0"), ("sun.elevation", "90")]), &[], true);
    let expected = 2.5 * ALBEDO * FRAC_1_PI;
    assert!((sun / expected - 1.0).abs() < 0.003, "{sun}, expected {expected}");
    let lamp_at_eye = brightest(&settings(&[("light.headlight", "0")]), &[], false);
    assert!((lamp_at_eye / ALBEDO - 1.0).abs() < 0.003, "{lamp_at_eye}");
}

#[test]
fn shadow_maps_are_drawn_again_only_where_something_changed() {
    let mut stage = stage_or_skip!();
    let store = floor_with_blocker(&stage, 8.0);
    let mut draws = |settings: &Settings| {
        let stats = stage.renderer.render(&store, &Frame::new(&camera(), settings, Objects::default(), SIZE)).unwrap();
        stats.passes.iter().any(|pass| pass.name == "shadow_maps")
    };
    draws(&by_sun(&[]));
    assert!(!draws(&by_sun(&[])), "all is kept");
    assert!(!draws(&by_sun(&[("sun.irradiance", "1"), ("light.gloss", "0.5")])), "the light is of another strength");
    assert!(!draws(&settings(&[("light.by", "colors")])), "no light");
    assert!(!draws(&by_sun(&[])), "light again");
    assert!(draws(&by_sun(&[("sun.azimuth", "200")])), "the sun has moved");
}

/// Where a ray from inside the box of five mirrors meets it, and on which of `five_mirrors::walls`.
fn on_box(origin: DVec3, direction: DVec3) -> (DVec3, usize) {
    let half = DVec3::new(1.0, 1.0, 2.0);
    let steps = (half * direction.signum() - origin) / direction;
    let axis = (0..3).min_by(|a, b| steps[*a].total_cmp(&steps[*b])).unwrap();
    (origin + direction * steps[axis], axis * 2 + usize::from(direction[axis] > 0.0))
}

#[test]
fn the_lamp_of_five_mirrors_lights_its_walls_as_the_closed_form_does_within_a_hundredth() {
    let mut stage = stage_or_skip!();
    // As many points per pixel as 1.6 million have at 800 x 600.
    let (size, points) = ([160_u32, 120], 64_000);
    let parts = five_mirrors::sample(Variant::None, points, 1);
    let radius = 1.5 * (40.0 / (PI * points as f64)).sqrt();
    let store = store_of(&stage, parts.into_iter().flat_map(|part| part.chunks).collect(), Material::default());
    let (camera, lamp) = (five_mirrors::camera(), five_mirrors::light());
    let objects = Objects { lights: &[lamp], ..Objects::default() };
    stage.renderer.render(&store, &Frame::new(&camera, &Settings::default(), objects, size)).unwrap();
    let walls = five_mirrors::walls();
    let mut compared = [0; 6];
    for (pixel, direct) in read(&stage, Aov::Direct).into_iter().enumerate() {
        let (at, wall) = on_box(camera.eye, ray(&camera, size, pixel));
        let offset = lamp.position - at;
        let angle = (lamp.target - lamp.position).angle_between(-offset).to_degrees();
        // Places nearer than this to an edge of the box or a square of the floor belong to two surfaces.
        let mut gaps = [1.0 - at.x.abs(), 1.0 - at.y.abs(), 2.0 - at.z.abs()];
        gaps.sort_by(f64::total_cmp);
        let to_square = |along: f64| (along / 0.25 - (along / 0.25).round()).abs() * 0.25;
        let gap = if wall == 2 { gaps[1].min(to_square(at.x)).min(to_square(at.z)) } else { gaps[1] };
        // Light falls to nothing at 25 degrees, where relative errors are large. Through a gap between splats, which so
        // few points leave, nothing is seen.
        if gap < 3.0 * radius || angle > 24.0 || direct.is_nan() {
            continue;
        }
        let intensity = 10.0 * ((25.0 - angle) / 5.0).min(1.0);
        let normal = [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z][wall];
        let irradiance = intensity * offset.normalize().dot(normal) / offset.length_squared();
        let expected = DVec3::from(walls[wall].1(at)) * (irradiance * FRAC_1_PI);
        let error = ((direct - expected) / expected).abs().max_element();
        assert!(error < 0.01, "at {at}: {direct}, expected {expected}");
        compared[wall] += 1;
    }
    // The right wall, the floor and the far wall are lit.
    assert!(compared.iter().filter(|count| **count > 300).count() == 3, "{compared:?}");
}

#[test]
fn a_lamp_close_to_a_closed_surface_does_not_shine_through_it() {
    let mut stage = stage_or_skip!();
    let store = floor_with_blocker(&stage, 1.2);
    let (camera, settings) = (slanted_camera(), settings(&[("gi.bounces", "0")]));
    for (gap, is_dark) in [(0.05, true), (0.02, true), (-0.05, false)] {
        let position = DVec3::new(0.003, 0.004, 0.5 + gap);
        let lamp = SpotLight { position, target: DVec3::new(0.003, 0.004, 0.0), ..lamp() };
        let objects = Objects { lights: &[lamp], ..Objects::default() };
        stage.renderer.render(&store, &Frame::new(&camera, &settings, objects, SIZE)).unwrap();
        let (direct, depth) = (read(&stage, Aov::Direct), stage.renderer.read_aov(Aov::Depth).unwrap().data);
        let is_floor = |pixel: usize| {
            let at = on_floor(&camera, pixel) - camera.eye;
            (at.dot(camera.forward()) - f64::from(depth[pixel])).abs() < 0.01
        };
        let floor: Vec<usize> = (0..direct.len()).filter(|pixel| is_floor(*pixel)).collect();
        let lit = floor.iter().filter(|pixel| direct[**pixel].max_element() > 0.0).count();
        assert!(floor.len() > 1000 && (lit == 0) == is_dark, "{gap}: {lit} of {} pixels are lit", floor.len());
    }
}

#[test]
fn surfaces_that_turn_their_back_are_left_out_if_asked_for_and_the_inside_of_a_room_is_seen() {
    let mut stage = stage_or_skip!();
    let plane = |z: f64, edges: [DVec3; 2]| {
        let corner = -(edges[0] + edges[1]) * 0.5 + DVec3::Z * z;
        wall(corner, edges)
    };
    // A ceiling whose normal points down, above a floor whose normal points up.
    let chunks = vec![plane(1.0, [DVec3::Y * 4.0, DVec3::X * 4.0]), plane(0.0, [DVec3::X * 4.0, DVec3::Y * 4.0])];
    let store = store_of(&stage, chunks, Material::default());
    for projection in ["perspective", "orthographic"] {
        for quality in ["high", "nearest"] {
            for (backs, expected) in [("true", 1.0), ("false", 2.0)] {
                let pairs = [("splat.back_faces", backs), ("splat.quality", quality), ("view.projection", projection)];
                let camera = Camera::looking(DVec3::ZERO, DVec3::Z, 2.0, DVec3::Y);
                let objects = Objects::default();
                stage.renderer.render(&store, &Frame::new(&camera, &settings(&pairs), objects, [64, 48])).unwrap();
                let depth = stage.renderer.read_aov(Aov::Depth).unwrap().data[24 * 64 + 32];
                assert!((f64::from(depth) - expected).abs() < 0.01, "{projection} {quality} {backs}: {depth}");
            }
        }
    }
}
