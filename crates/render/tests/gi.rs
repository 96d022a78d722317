//! Indirect light on the GPU against closed forms, and against changes that must not affect it.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod hollow;
#[macro_use]
mod stage;
mod walls;

use std::f64::consts::{FRAC_1_PI, PI};
use std::sync::Arc;

use cloud::{Chunk, Cloud, pack_normal, pack_radius};
use glam::{DVec3, Vec3};
use param::{Kind, Params as _, Value};
use render::{Aov, ColorPlan, Frame, FrameStats, LightReuse, Material, Objects, PointStore};
use scene::five_mirrors::{self, Variant};
use scene::{Camera, Gi, Settings, SpotLight};

use hollow::{cone, hollow_sphere};
use stage::Stage;
use walls::{ALBEDO, settings, sheet, store_of, wall};

const SIZE: [u32; 2] = [64, 48];

fn render(
    stage: &mut Stage,
    store: &PointStore,
    camera: &Camera,
    settings: &Settings,
    lights: &[SpotLight],
) -> FrameStats {
    let objects = Objects { lights, ..Objects::default() };
    let frame = Frame::new(camera, settings, objects, SIZE);
    stage.renderer.render(store, &Frame { effort: stage.effort, ..frame }).unwrap()
}

fn read(stage: &Stage, aov: Aov) -> Vec<DVec3> {
    let image = stage.renderer.read_aov(aov).unwrap();
    image.data.as_chunks::<3>().0.iter().map(|rgb| Vec3::from(*rgb).as_dvec3()).collect()
}

fn brightness(color: DVec3) -> f64 {
    color.element_sum() / 3.0
}

fn bits(colors: &[DVec3]) -> Vec<[u64; 3]> {
    colors.iter().map(|color| color.to_array().map(f64::to_bits)).collect()
}

fn mean(colors: &[DVec3]) -> f64 {
    let seen = colors.iter().filter(|color| !color.is_nan());
    seen.clone().map(|color| brightness(*color)).sum::<f64>() / seen.count() as f64
}

fn five_mirrors_store(stage: &Stage, variant: Variant, points: u64) -> PointStore {
    let mut chunks = Vec::new();
    for part in five_mirrors::sample(variant, points, 1) {
        chunks.extend(part.chunks);
    }
    store_of(stage, chunks, Material::default())
}

#[test]
fn each_bounce_in_a_white_ball_adds_what_the_integrating_sphere_says() {
    let mut stage = stage_or_skip!();
    // The light that a ball reflects inside is the same everywhere: for a flux F the k-th reflection gives albedo^k F /
    // area.
    let store = store_of(&stage, vec![hollow_sphere(2.0, 40_000)], Material::default());
    let (lamp, flux) = cone(DVec3::new(0.3, -0.2, 0.1), DVec3::new(0.3, 2.0, 0.5), 40.0);
    let camera = Camera::looking(DVec3::new(0.0, 0.5, 0.0), -DVec3::Y, 1.0, DVec3::Z);
    let irradiance = flux / (4.0 * PI * 4.0);
    for (bounces, factor) in [(1_u32, 1.0), (2, 1.0), (3, 1.0), (3, 0.5)] {
        let settings = settings(&[
            ("gi.bounces", &bounces.to_string()),
            ("gi.interleave", "1"),
            ("gi.vpls", "512"),
            ("light.diffuse", &factor.to_string()),
        ]);
        let albedo = ALBEDO * factor;
        render(&mut stage, &store, &camera, &settings, &[lamp]);
        let expected: f64 = (1..=bounces).map(|k| albedo.powi(k as i32) * irradiance).sum::<f64>() * albedo * FRAC_1_PI;
        let ratio = mean(&read(&stage, Aov::Indirect)) / expected;
        println!("{bounces} bounces, {factor}: {ratio} of the closed form");
        assert!((ratio - 1.0).abs() < 0.015, "{bounces} bounces, {factor}: {ratio} of the closed form");
    }
}

#[test]
fn the_walls_of_a_closed_box_get_together_what_they_reflected_before() {
    let mut stage = stage_or_skip!();
    let sides = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    let walls = sides.clone().map(|side| {
        let (u, v) = side.any_orthonormal_pair();
        wall(side * 2.0 - (u + v) * 2.0, [u * 4.0, v * 4.0])
    });
    let store = store_of(&stage, walls.collect(), Material::default());
    let (lamp, flux) = cone(DVec3::new(0.3, -0.2, 0.1), DVec3::new(0.3, 2.0, 0.5), 40.0);
    let objects = Objects { lights: &[lamp], ..Objects::default() };
    let mut before = 0.0;
    for bounces in [1, 2] {
        let settings = settings(&[
            ("gi.bounces", &bounces.to_string()),
            ("gi.interleave", "1"),
            ("gi.vpls", "1024"),
            ("view.field_of_view", "90"),
        ]);
        let mut sum = 0.0;
        for side in sides.clone() {
            // A picture of a whole wall: its pixels are equal parts of the wall.
            let camera = Camera::from_eye(DVec3::ZERO, side, side.any_orthonormal_vector());
            stage.renderer.render(&store, &Frame::new(&camera, &settings, objects, [32; 2])).unwrap();
            sum += mean(&read(&stage, Aov::Indirect)) / 6.0;
        }
        let ratio = (sum - before) / (ALBEDO.powi(bounces + 1) * flux / 96.0 * FRAC_1_PI);
        println!("bounce {bounces}: {ratio} of the closed form");
        assert!((ratio - 1.0).abs() < 0.004, "bounce {bounces}: {ratio} of the closed form");
        before = sum;
    }
}

/// An even sky of irradiance 2, whose lights have maps of so many texels a side.
fn sky_alone(shadow_size: &str) -> Settings {
    settings(&[
        ("light.by", "sun"),
        ("sun.irradiance", "0"),
        ("sun.sky", "2"),
        ("gi.bounces", "0"),
        ("gi.sky_lights", "256"),
        ("gi.shadow_size", shadow_size),
        ("gi.interleave", "1"),
    ])
}

#[test]
fn an_open_floor_is_lit_by_the_whole_sky_and_one_beside_a_wall_by_what_the_wall_leaves() {
    let mut stage = stage_or_skip!();
    let floor = || wall(DVec3::new(-2.0, -2.0, 0.0), [DVec3::X * 4.0, DVec3::Y * 4.0]);
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.0, -0.2, 1.0), 1.2, DVec3::Z);
    let settings = sky_alone("128");
    let store = store_of(&stage, vec![floor()], Material::default());
    render(&mut stage, &store, &camera, &settings, &[]);
    let open = read(&stage, Aov::Indirect);
    let expected = ALBEDO * 2.0 * FRAC_1_PI;
    assert!(open.iter().filter(|light| !light.is_nan()).count() > 500);
    for light in open.iter().filter(|light| !light.is_nan()) {
        assert!((light.x / expected - 1.0).abs() < 0.02, "{light} instead of {expected}");
    }
    // A wide wall of height h at distance d hides (1 - d / sqrt(d^2 + h^2)) / 2 of the light of a floor.
    let beside = wall(DVec3::new(2.0, -8.0, 0.0), [DVec3::Y * 16.0, DVec3::Z * 4.0]);
    let store = store_of(&stage, vec![floor(), beside], Material::default());
    render(&mut stage, &store, &camera, &settings, &[]);
    let positions = read(&stage, Aov::Position);
    let shaded = read(&stage, Aov::Indirect);
    let (mut sum, mut compared) = (0.0, 0);
    for (at, light) in positions.iter().zip(&shaded).filter(|(at, _)| at.z.abs() < 0.01 && at.x.abs() < 1.2) {
        let distance = 2.0 - at.x;
        let hidden = (1.0 - distance / (distance * distance + 16.0).sqrt()) / 2.0;
        sum += light.x / (expected * (1.0 - hidden));
        compared += 1;
    }
    let ratio = sum / f64::from(compared);
    assert!(compared > 500 && (ratio - 1.0).abs() < 0.06, "{ratio} of the closed form on {compared} pixels");
}

#[test]
fn a_thin_wall_that_is_lit_from_behind_is_dark_in_front() {
    let mut stage = stage_or_skip!();
    // At a slant, so that rounding moves its points before and behind its plane.
    let normal = DVec3::new(0.31, -0.87, 0.23).normalize();
    let (u, v) = normal.any_orthonormal_pair();
    let store = store_of(&stage, vec![wall((u + v) * -2.0, [u * 4.0, v * 4.0])], Material::default());
    let settings = settings(&[("gi.interleave", "1"), ("gi.vpls", "256")]);
    let camera = Camera::from_eye(normal * 3.0, -normal, u);
    // One lamp shines straight upon the wall's back, the other along it.
    for lamp in [-normal * 1.5, u * -3.0 - normal * 0.2] {
        let (lamp, _) = cone(lamp, DVec3::ZERO, 40.0);
        render(&mut stage, &store, &camera, &settings, &[lamp]);
        let front = read(&stage, Aov::Indirect);
        let brightest =
            front.iter().filter(|light| !light.is_nan()).map(|light| brightness(*light)).fold(0.0, f64::max);
        assert!(brightest < 1e-3, "{brightest} in front of a wall that is lit from behind");
    }
}

/// The pixels of two frames that show the same place, and the values of `images` in them.
fn matched(cameras: [&Camera; 2], positions: [&[DVec3]; 2], near: f64) -> Vec<(usize, usize)> {
    let [_, after] = cameras;
    let focal = f64::from(SIZE[1]) * 0.5 / 30_f64.to_radians().tan();
    let turn = after.view_from_world();
    let pixel = |at: DVec3| {
        let view = turn * (at - after.eye);
        let x = (f64::from(SIZE[0]) * 0.5 + view.x / view.z * focal).floor();
        let y = (f64::from(SIZE[1]) * 0.5 - view.y / view.z * focal).floor();
        let inside = x >= 0.0 && y >= 0.0 && x < f64::from(SIZE[0]) && y < f64::from(SIZE[1]);
        inside.then_some(y as usize * SIZE[0] as usize + x as usize)
    };
    let matches = positions[0].iter().enumerate().filter(|(_, at)| !at.is_nan());
    matches
        .filter_map(|(index, at)| {
            let other = pixel(*at)?;
            (positions[1][other].distance(*at) < near).then_some((index, other))
        })
        .collect()
}

#[test]
fn the_indirect_light_of_a_place_is_the_same_from_wherever_it_is_seen() {
    let mut stage = stage_or_skip!();
    let store = five_mirrors_store(&stage, Variant::Sphere, 100_000);
    let light = [five_mirrors::light()];
    let camera = five_mirrors::camera();
    for interleave in ["1", "4"] {
        let settings = settings(&[("gi.interleave", interleave), ("gi.vpls", "64"), ("gi.bounces", "2")]);
        render(&mut stage, &store, &camera, &settings, &light);
        let (positions, albedo, indirect) =
            (read(&stage, Aov::Position), read(&stage, Aov::Albedo), read(&stage, Aov::Indirect));
        // A quarter of a pixel, and a step of some pixels.
        for shift in [DVec3::X * 0.02, DVec3::new(0.1, 0.05, -0.1)] {
            let moved = Camera { eye: camera.eye + shift, pivot: camera.pivot + shift, ..camera };
            let stats = render(&mut stage, &store, &moved, &settings, &light);
            let is_made_anew = stats.passes.iter().any(|pass| pass.name.starts_with("vpl_"));
            assert!(!is_made_anew, "virtual lights were placed again");
            let (there, albedo_there, after) =
                (read(&stage, Aov::Position), read(&stage, Aov::Albedo), read(&stage, Aov::Indirect));
            // Irradiance, on walls: colours differ where a pixel straddles squares of the floor.
            let grey = |light: DVec3, albedo: DVec3| 255.0 * (brightness(light) / brightness(albedo)).powf(1.0 / 2.2);
            let on_walls = |at: DVec3| {
                at.length() > 0.6
                    && (DVec3::new(1.0, 1.0, 2.0) - at.abs()).to_array().iter().filter(|gap| **gap < 0.15).count() == 1
            };
            let mut differences: Vec<f64> = matched([&camera, &moved], [&positions, &there], 0.02)
                .into_iter()
                .filter(|(before, _)| on_walls(positions[*before]))
                .map(|(before, now)| {
                    (grey(after[now], albedo_there[now]) - grey(indirect[before], albedo[before])).abs()
                })
                .collect();
            differences.sort_by(f64::total_cmp);
            let median = differences[differences.len() / 2];
            assert!(differences.len() > 300, "{} places are seen twice", differences.len());
            assert!(median < 1.0, "interleave {interleave}, {shift}: {median} grey levels");
        }
    }
}

#[test]
fn sixteen_virtual_lights_more_or_less_do_not_jump() {
    let mut stage = stage_or_skip!();
    let store = five_mirrors_store(&stage, Variant::None, 100_000);
    let mut images = Vec::new();
    for vpls in ["240", "256", "272"] {
        let settings = settings(&[("gi.interleave", "1"), ("gi.vpls", vpls)]);
        render(&mut stage, &store, &five_mirrors::camera(), &settings, &[five_mirrors::light()]);
        images.push(read(&stage, Aov::Indirect));
    }
    for other in [0, 2] {
        let change = mean(&images[other]) / mean(&images[1]) - 1.0;
        assert!(change.abs() < 0.02, "the picture's brightness changes by {change}");
        let grey = |color: DVec3| 255.0 * brightness(color).powf(1.0 / 2.2);
        let mut steps: Vec<f64> = images[other]
            .iter()
            .zip(&images[1])
            .filter(|(color, _)| !color.is_nan())
            .map(|(a, b)| (grey(*a) - grey(*b)).abs())
            .collect();
        steps.sort_by(f64::total_cmp);
        let p95 = steps[steps.len() * 95 / 100];
        assert!(p95 < 2.0, "{p95} grey levels at one pixel in twenty");
    }
}

#[test]
fn atomics_of_32_bits_give_the_same_light() {
    let mut stage = stage_or_skip!();
    let store = five_mirrors_store(&stage, Variant::Sphere, 50_000);
    let mut light = |atomics: &str| {
        let settings = settings(&[("splat.atomics", atomics), ("gi.vpls", "64")]);
        render(&mut stage, &store, &five_mirrors::camera(), &settings, &[five_mirrors::light()]);
        mean(&read(&stage, Aov::Indirect))
    };
    let (wide, narrow) = (light("auto"), light("32"));
    assert!(wide > 0.001 && (narrow / wide - 1.0).abs() < 0.01, "{narrow} instead of {wide}");
}

#[test]
fn a_thin_wall_keeps_the_light_of_one_room_out_of_the_other() {
    let mut stage = stage_or_skip!();
    // A room from x = -2 to 2, y and z from -1 to 1, divided at x = 0 by a wall of one layer of points; the lamp is on
    // the left.
    let rectangle = |corner: [f64; 3], a: DVec3, b: DVec3| wall(DVec3::from(corner), [a, b]);
    let (x, y, z) = (DVec3::X * 4.0, DVec3::Y * 2.0, DVec3::Z * 2.0);
    let store = store_of(
        &stage,
        vec![
            rectangle([-2.0, -1.0, -1.0], x, y),
            rectangle([-2.0, -1.0, 1.0], y, x),
            rectangle([-2.0, -1.0, -1.0], z, x),
            rectangle([-2.0, 1.0, -1.0], x, z),
            rectangle([-2.0, -1.0, -1.0], y, z),
            rectangle([2.0, -1.0, -1.0], z, y),
            rectangle([0.0, -1.0, -1.0], y, z),
        ],
        Material::default(),
    );
    let lamp = SpotLight {
        position: DVec3::new(-1.8, 0.0, 0.8),
        target: DVec3::new(-1.0, 0.0, -1.0),
        intensity: [10.0; 3],
        inner_degrees: 30.0,
        outer_degrees: 35.0,
    };
    let settings = settings(&[("gi.interleave", "1"), ("gi.bounces", "2")]);
    let mut room = |side: f64| {
        let eye = DVec3::new(0.3 * side, 0.0, 0.2);
        let camera = Camera { eye, pivot: eye + DVec3::new(side, 0.0, -0.2), up: DVec3::Z };
        render(&mut stage, &store, &camera, &settings, &[lamp]);
        mean(&read(&stage, Aov::Indirect))
    };
    let (lit, dark) = (room(-1.0), room(1.0));
    assert!(lit > 0.01 && dark < 0.02 * lit, "{dark} behind the wall, {lit} before it");
}

#[test]
fn brightness_and_colours_change_the_light_but_not_the_shadow_maps() {
    let mut stage = stage_or_skip!();
    // A floor with a black half, and a wall beside it.
    let floor = |x: f64, color: [u8; 4]| {
        let mut chunk = wall(DVec3::new(x, -1.0, 0.0), [DVec3::X, DVec3::Y * 2.0]);
        chunk.colors = Some(Arc::new(vec![color; chunk.len()]));
        chunk
    };
    let beside = wall(DVec3::new(-1.0, 1.0, 0.0), [DVec3::X * 2.0, DVec3::Z]);
    let chunks = vec![floor(-1.0, [0, 0, 0, 255]), floor(0.0, [188, 188, 188, 255]), beside];
    let mut store = PointStore::new(stage.gpu.clone());
    let id = store.add_cloud(Material::default());
    let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
    let cloud = Cloud { chunks, ..Cloud::default() };
    let paint = |store: &mut PointStore, by: &str| {
        let settings = settings(&[("color.by", by)]);
        let (plan, _) = ColorPlan::new(&cloud, &settings.color, DVec3::Z);
        store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
    };
    paint(&mut store, "rgb");
    let camera = Camera { eye: DVec3::new(0.0, -3.0, 1.5), pivot: DVec3::new(0.0, 0.5, 0.3), up: DVec3::Z };
    let mut lamp = SpotLight {
        position: DVec3::new(0.0, 0.0, 2.0),
        target: DVec3::ZERO,
        intensity: [10.0; 3],
        inner_degrees: 15.0,
        outer_degrees: 20.0,
    };
    let mut settings = settings(&[("gi.vpls", "64")]);
    let drew = |stats: &FrameStats, name| stats.passes.iter().any(|pass| pass.name == name);
    let drew_maps = |stats: &FrameStats| {
        let of_lights = drew(stats, "vpl_shadow_splat");
        assert_eq!(of_lights, drew(stats, "shadow_maps"), "the lamp's map lags with the lights'");
        of_lights
    };
    stage.renderer.forget();
    assert!(drew_maps(&render(&mut stage, &store, &camera, &settings, &[lamp])));
    let before = mean(&read(&stage, Aov::Indirect));
    lamp.intensity = [30.0; 3];
    assert!(!drew_maps(&render(&mut stage, &store, &camera, &settings, &[lamp])));
    let after = mean(&read(&stage, Aov::Indirect));
    assert!(before > 1e-4 && (after / before - 3.0).abs() < 0.01, "{before} became {after}");
    settings.tone.exposure = 1.0;
    let stats = render(&mut stage, &store, &camera, &settings, &[lamp]);
    assert!(stats.passes.iter().all(|pass| !pass.name.starts_with("indirect")), "light was computed again for a tone");
    // The black half shines now, and its lights have shadow maps.
    paint(&mut store, "plain");
    assert!(!drew_maps(&render(&mut stage, &store, &camera, &settings, &[lamp])));
    let painted = mean(&read(&stage, Aov::Indirect));
    stage.renderer.forget();
    render(&mut stage, &store, &camera, &settings, &[lamp]);
    let anew = mean(&read(&stage, Aov::Indirect));
    assert!(painted > 1.5 * after && painted == anew, "{painted} instead of {anew}, {after} before");
    lamp.position.x += 0.1;
    assert!(drew_maps(&render(&mut stage, &store, &camera, &settings, &[lamp])));
}

#[test]
fn a_frame_that_forgets_all_but_shadow_maps_draws_all_but_those_and_the_same_picture() {
    let mut stage = stage_or_skip!();
    let (store, mirrors) = (five_mirrors_store(&stage, Variant::None, 20_000), Variant::Sphere.mirrors());
    let [mut traced, mut mapped] = [(); 2].map(|()| settings(&[("gi.vpls", "64"), ("mirror.surface", "exact")]));
    traced.set_text("reflection.method", "surfel_trace").unwrap();
    mapped.set_text("reflection.method", "environment_map").unwrap();
    let mut draw = |settings: &Settings, keeps_maps: bool| {
        match keeps_maps {
            true => stage.renderer.forget_all_but_shadow_maps(),
            false => stage.renderer.forget(),
        }
        let (camera, lights) = (five_mirrors::camera(), [five_mirrors::light()]);
        let objects = Objects { mirrors: &mirrors, lights: &lights, ..Objects::default() };
        let stats = stage.renderer.render(&store, &Frame::new(&camera, settings, objects, SIZE)).unwrap();
        (stats.passes, stage.renderer.read_picture().unwrap())
    };
    let (whole, picture) = draw(&traced, false);
    let (mapped, _) = draw(&mapped, true);
    let draws = |name| mapped.iter().any(|pass| pass.name == name);
    assert!(draws("environment_map") && mapped.iter().all(|pass| !pass.is_of_shadow_maps()), "{mapped:?}");
    for _ in 0..2 {
        let (passes, again) = draw(&traced, true);
        let drawn: Vec<&str> = passes.iter().map(|pass| pass.name).collect();
        let others = whole.iter().filter(|pass| !pass.is_of_shadow_maps());
        assert_eq!(drawn, others.map(|pass| pass.name).collect::<Vec<_>>());
        assert!(passes.len() < whole.len() && again == picture);
    }
    // Light sees all points, whatever the camera sees of them.
    let mut thinned = traced.clone();
    thinned.splat.step = 8;
    let [(kept, picture), (drawn, again)] = [true, false].map(|keeps_maps| draw(&thinned, keeps_maps));
    assert!(drawn.iter().any(|pass| pass.is_of_shadow_maps()) && picture == again);
    assert!(kept.iter().all(|pass| !pass.is_of_shadow_maps()), "{kept:?}");
}

#[test]
fn light_may_lag_behind_points_that_come_and_is_right_when_it_may_not() {
    let mut stage = stage_or_skip!();
    let floor = wall(DVec3::new(-1.0, -1.0, 0.0), [DVec3::X * 2.0, DVec3::Y * 2.0]);
    let beside = wall(DVec3::new(-1.0, 1.0, 0.0), [DVec3::X * 2.0, DVec3::Z]);
    let mut store = store_of(&stage, vec![floor.clone()], Material::default());
    let camera = Camera { eye: DVec3::new(0.0, -3.0, 1.5), pivot: DVec3::new(0.0, 0.5, 0.3), up: DVec3::Z };
    let lamp = SpotLight {
        position: DVec3::new(0.0, 0.0, 2.0),
        target: DVec3::ZERO,
        intensity: [10.0; 3],
        inner_degrees: 15.0,
        outer_degrees: 40.0,
    };
    let settings = settings(&[("gi.vpls", "64")]);
    let drew = |stats: &FrameStats, name| stats.passes.iter().any(|pass| pass.name == name);
    let drew_maps = |stats: &FrameStats| {
        let of_lights = drew(stats, "vpl_shadow_splat");
        assert_eq!(of_lights, drew(stats, "shadow_maps"), "the lamp's map lags with the lights'");
        of_lights
    };
    stage.renderer.forget();
    assert!(drew_maps(&render(&mut stage, &store, &camera, &settings, &[lamp])));
    let other = store.add_cloud(Material::default());
    store.add_chunk(other, &beside, None).unwrap();
    stage.effort.light_may_lag = true;
    assert!(!drew_maps(&render(&mut stage, &store, &camera, &settings, &[lamp])));
    assert!(mean(&read(&stage, Aov::Indirect)) > 1e-4, "what has come is lit");
    let moved = SpotLight { position: DVec3::new(0.2, 0.0, 2.0), ..lamp };
    assert!(drew_maps(&render(&mut stage, &store, &camera, &settings, &[moved])), "only the points may lag");
    stage.effort.light_may_lag = false;
    store.set_provisional_radius(other, 0.0);
    assert!(drew_maps(&render(&mut stage, &store, &camera, &settings, &[lamp])));
    let late = read(&stage, Aov::Indirect);
    stage.renderer.forget();
    render(&mut stage, &store, &camera, &settings, &[lamp]);
    let anew = read(&stage, Aov::Indirect);
    assert!(mean(&late) == mean(&anew));
}

#[test]
fn a_moving_camera_takes_its_light_from_the_frame_before() {
    let mut stage = stage_or_skip!();
    let store = five_mirrors_store(&stage, Variant::None, 60_000);
    let lights = [five_mirrors::light()];
    let settings = settings(&[("gi.vpls", "64"), ("gi.interleave", "1"), ("mirror.surface", "exact")]);
    let start = five_mirrors::camera();
    let at = |step: u32| {
        let shift = DVec3::new(0.01, 0.004, 0.0) * f64::from(step);
        Camera { eye: start.eye + shift, pivot: start.pivot + 0.5 * shift, up: start.up }
    };
    let still = |stage: &mut Stage, camera: &Camera| {
        stage.effort.light_reuse = LightReuse::Keep;
        render(stage, &store, camera, &settings, &lights);
        read(stage, Aov::Indirect)
    };
    // Sorted, as shares of the mean.
    let differences = |a: &[DVec3], b: &[DVec3]| {
        let seen = a.iter().zip(b).filter(|(a, b)| !a.is_nan() && !b.is_nan());
        let whole = mean(b);
        let mut shares: Vec<f64> = seen.map(|(a, b)| (*a - *b).length() / whole).collect();
        shares.sort_by(f64::total_cmp);
        shares
    };
    stage.renderer.forget();
    let first = still(&mut stage, &at(0));
    stage.effort.light_reuse = LightReuse::Reuse;
    let mut moving = Vec::new();
    for step in 1..=20 {
        let stats = render(&mut stage, &store, &at(step), &settings, &lights);
        assert!(stats.passes.iter().any(|pass| pass.name == "indirect_reuse"));
        moving = read(&stage, Aov::Indirect);
    }
    let fresh = still(&mut stage, &at(20));
    let errors = differences(&moving, &fresh);
    let [median, ninth_decile] = [5, 9].map(|tenths| errors[errors.len() * tenths / 10]);
    // The picture is so coarse that whole pixels lie on the edges of walls.
    assert!(median < 0.03 && ninth_decile < 0.15, "{median}, {ninth_decile}");
    let (ratio, before) = (mean(&moving) / mean(&fresh), mean(&first) / mean(&fresh));
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}, of the first frame {before}");
    // Moving leaves no trace in still pictures.
    stage.renderer.forget();
    assert!(bits(&still(&mut stage, &at(20))) == bits(&fresh));
    // Where the camera has not moved, all light is taken over but for its rounding.
    stage.effort.light_reuse = LightReuse::Reuse;
    render(&mut stage, &store, &at(20), &settings, &lights);
    let rounding = differences(&read(&stage, Aov::Indirect), &fresh);
    assert!(rounding.last().unwrap() < &0.02, "{:?}", rounding.last());
    // Other lights give other light.
    let brighter = SpotLight { intensity: [20.0; 3], ..lights[0] };
    render(&mut stage, &store, &at(20), &settings, &[brighter]);
    let ratio = mean(&read(&stage, Aov::Indirect)) / mean(&fresh);
    assert!((ratio - 2.0).abs() < 0.02, "{ratio}");
    // The other side of a wall has other light, some twentieth.
    let mut beside = |reuse| {
        let outside = Camera { eye: DVec3::X * 4.0, pivot: DVec3::ZERO, up: start.up };
        stage.effort.light_reuse = LightReuse::Keep;
        render(&mut stage, &store, &start, &settings, &lights);
        stage.effort.light_reuse = reuse;
        render(&mut stage, &store, &outside, &settings, &lights);
        read(&stage, Aov::Indirect)
    };
    let [taken, fresh] = [LightReuse::Reuse, LightReuse::Keep].map(&mut beside);
    // The reused light is computed from fewer lights, but as bright.
    let [taken, fresh] = [taken, fresh].map(|outside| mean(&outside) / mean(&first));
    assert!(fresh < 0.1 && (taken - fresh).abs() < 0.01, "{taken} and {fresh} of the light inside");
    // What a mirror shows is lit by fewer lights, but as brightly.
    let mirrors = Variant::Sphere.mirrors();
    let mut shown = |reuse| {
        stage.effort.light_reuse = reuse;
        let objects = Objects { lights: &lights, mirrors: &mirrors, ..Objects::default() };
        let camera = at(20);
        let frame = Frame { effort: stage.effort, ..Frame::new(&camera, &settings, objects, SIZE) };
        stage.renderer.render(&store, &frame).unwrap();
        let [color, mirror] = [Aov::Color, Aov::Mirror].map(|aov| stage.renderer.read_aov(aov).unwrap().data);
        let of_mirrors = color.as_chunks::<3>().0.iter().zip(mirror).filter(|(_, share)| *share > 0.0);
        mean(&of_mirrors.map(|(rgb, _)| Vec3::from(*rgb).as_dvec3()).collect::<Vec<_>>())
    };
    let [all, fewer] = [LightReuse::Keep, LightReuse::Reuse].map(&mut shown);
    assert!(all != fewer && (fewer / all - 1.0).abs() < 0.05, "{fewer} instead of {all}");
}

#[test]
fn light_that_was_off_comes_back_as_it_is_where_the_camera_is_now() {
    let mut stage = stage_or_skip!();
    let store = five_mirrors_store(&stage, Variant::Sphere, 50_000);
    let lights = [five_mirrors::light()];
    let (lit, off) = (settings(&[("gi.vpls", "64")]), settings(&[("gi.vpls", "64"), ("light.by", "headlight")]));
    let camera = five_mirrors::camera();
    let moved = Camera { eye: camera.eye + DVec3::X * 0.3, ..camera };
    render(&mut stage, &store, &camera, &lit, &lights);
    render(&mut stage, &store, &moved, &off, &lights);
    render(&mut stage, &store, &moved, &lit, &lights);
    let back = stage.renderer.read_aov(Aov::Indirect).unwrap().data;
    stage.renderer.forget();
    render(&mut stage, &store, &moved, &lit, &lights);
    let anew = stage.renderer.read_aov(Aov::Indirect).unwrap().data;
    assert!(back.iter().zip(&anew).all(|(a, b)| a.to_bits() == b.to_bits()));
}

#[test]
fn a_lamp_that_mostly_shines_past_things_loses_none_of_what_meets_them() {
    let mut stage = stage_or_skip!();
    // A plate in the middle of a wide cone and a wall beside it that only the plate's light reaches; and the same with
    // a narrow cone.
    let plate = wall(DVec3::new(-0.5, -0.5, 0.0), [DVec3::X, DVec3::Y]);
    let beside = wall(DVec3::new(-0.5, 0.5, 0.0), [DVec3::X, DVec3::Z]);
    let store = store_of(&stage, vec![plate, beside], Material::default());
    let camera = Camera { eye: DVec3::new(0.0, -2.0, 1.0), pivot: DVec3::new(0.0, 0.5, 0.3), up: DVec3::Z };
    let mut light = |degrees: f32| {
        let lamp = SpotLight {
            position: DVec3::new(0.0, -0.4, 1.5),
            target: DVec3::new(0.0, -0.4, 0.0),
            intensity: [10.0; 3],
            inner_degrees: degrees,
            outer_degrees: degrees,
        };
        let settings = settings(&[("gi.vpls", "512"), ("gi.interleave", "1")]);
        render(&mut stage, &store, &camera, &settings, &[lamp]);
        let positions = read(&stage, Aov::Position);
        // The upper wall, which the plate lights.
        let indirect = read(&stage, Aov::Indirect);
        let wall = indirect.iter().zip(&positions).filter(|(_, at)| at.y > 0.49 && at.z > 0.5);
        let light: Vec<DVec3> = wall.map(|(light, _)| *light).collect();
        assert!(light.len() > 50);
        mean(&light)
    };
    // The narrow and the wide cone contain plate and wall; the wide one sends nine tenths of its light past them.
    let (narrow, wide) = (light(45.0), light(80.0));
    assert!((wide / narrow - 1.0).abs() < 0.1, "{wide} instead of {narrow}");
}

#[test]
fn every_end_of_every_parameter_of_indirect_light_gives_a_finite_picture() {
    let mut stage = stage_or_skip!();
    let store = five_mirrors_store(&stage, Variant::None, 10_000);
    let plain =
        settings(&[("gi.vpls", "16"), ("gi.shadow_points", "500"), ("gi.shadow_size", "16"), ("gi.sky_lights", "8")]);
    let ends = Gi::table().fields.iter().flat_map(|field| {
        let values = match &field.kind {
            // The largest number of lights takes a while on software Vulkan, and their maps may exceed its bindings.
            Kind::U32 { min, max, .. } => vec![Value::U32(*min), Value::U32((*max).min(300))],
            Kind::F32 { min, max, .. } => vec![Value::F32(*min), Value::F32(*max)],
            Kind::Choice { names, .. } => (0..names.len() as u32).map(Value::Choice).collect(),
            Kind::Bool { .. } => vec![Value::Bool(false), Value::Bool(true)],
            _ => Vec::new(),
        };
        values.into_iter().map(|value| (field.name, value))
    });
    for (name, value) in ends {
        for by in ["lights", "sun"] {
            let mut settings = plain.clone();
            settings.set_text("light.by", by).unwrap();
            settings.gi.set(name, value.clone()).unwrap();
            render(&mut stage, &store, &five_mirrors::camera(), &settings, &[five_mirrors::light()]);
            let depth = stage.renderer.read_aov(Aov::Depth).unwrap().data;
            let light = read(&stage, Aov::Indirect);
            let is_fine =
                |(color, depth): (&DVec3, &f32)| depth.is_nan() || (color.is_finite() && color.min_element() >= 0.0);
            assert!(depth.iter().filter(|depth| depth.is_finite()).count() > 2000);
            assert!(light.iter().zip(&depth).all(is_fine), "{name} {value:?}, {by}");
        }
    }
}

#[test]
fn too_many_shadow_maps_are_refused_with_what_to_lower() {
    let mut stage = stage_or_skip!();
    let store = five_mirrors_store(&stage, Variant::None, 5_000);
    let settings = settings(&[("gi.vpls", "4096"), ("gi.bounces", "4"), ("gi.shadow_size", "256")]);
    let lights = [five_mirrors::light()];
    let objects = Objects { lights: &lights, ..Objects::default() };
    // More than five gigabytes: more than any adapter binds at once here.
    match stage.renderer.render(&store, &Frame::new(&five_mirrors::camera(), &settings, objects, SIZE)) {
        Err(error) => assert!(error.to_string().contains("gi.shadow_size"), "{error}"),
        Ok(_) => println!("this adapter binds more than five gigabytes at once"),
    }
    let few = walls::settings(&[("gi.vpls", "16")]);
    render(&mut stage, &store, &five_mirrors::camera(), &few, &lights);
    assert!(mean(&read(&stage, Aov::Indirect)) > 0.0, "the renderer goes on");
}

/// An open court of 3 by 2 by 1, or a closed room.
fn court(is_closed: bool) -> Vec<Chunk> {
    let [x, y, z] = [DVec3::X * 3.0, DVec3::Y * 2.0, DVec3::Z];
    let mut walls = vec![wall(DVec3::ZERO, [x, y])];
    walls.extend([(DVec3::ZERO, x), (DVec3::ZERO, y), (x, y), (y, x)].map(|(from, along)| wall(from, [along, z])));
    if is_closed {
        walls.push(wall(z, [x, y]));
    }
    walls
}

#[test]
fn a_far_point_changes_neither_the_light_of_an_open_court_nor_that_of_a_closed_room() {
    let mut stage = stage_or_skip!();
    let camera = Camera::from_eye(DVec3::new(0.4, 0.4, 0.6), DVec3::new(2.0, 1.4, 0.2), DVec3::Z);
    let settings = settings(&[
        ("light.by", "sun"),
        ("sun.elevation", "50"),
        ("sun.sky", "2"),
        ("gi.vpls", "256"),
        ("gi.sky_lights", "64"),
        ("reflection.method", "none"),
    ]);
    for is_closed in [false, true] {
        let mut light = |far: Option<f64>| {
            let mut chunks = court(is_closed);
            if let Some(sizes) = far {
                let place = DVec3::new(0.6, -0.5, 0.62) * 3.0 * sizes;
                let one = Chunk { positions: Arc::new(vec![[0.0; 3]]), ..chunks[0].select(&[0]) };
                chunks.push(Chunk { origin: place, ..one });
            }
            let store = store_of(&stage, chunks, Material::default());
            render(&mut stage, &store, &camera, &settings, &[]);
            [Aov::Direct, Aov::Indirect].map(|aov| read(&stage, aov))
        };
        let without = light(None);
        // What a closed room gets is what leaks; errors are compared with what the sky gives an open floor.
        let scale = if is_closed { 2.0 * ALBEDO * FRAC_1_PI } else { mean(&without[1]) };
        for sizes in [10.0, 100.0, 1000.0] {
            for (with, without) in light(Some(sizes)).iter().zip(&without) {
                let pairs = || with.iter().zip(without).filter(|(with, without)| !with.is_nan() && !without.is_nan());
                let count = pairs().count() as f64;
                let squares: f64 = pairs().map(|(with, without)| (*with - *without).length_squared() / 3.0).sum();
                let (rmse, change) = ((squares / count).sqrt() / scale, (mean(with) - mean(without)).abs() / scale);
                assert!(rmse < 0.01 && change < 0.01, "closed: {is_closed}, {sizes} sizes: {rmse}, {change}");
            }
        }
    }
}

/// A ground of 50 by 50, with fewer points where no camera looks, and what stands on it.
fn on_wide_ground(mut chunks: Vec<Chunk>) -> Vec<Chunk> {
    let mut ground = |low: [f64; 2], edges: [f64; 2], step: f64| {
        chunks.push(sheet(DVec3::new(low[0], low[1], 0.0), [DVec3::X * edges[0], DVec3::Y * edges[1]], step));
    };
    ground([-5.0, -10.0], [10.0, 20.0], 0.1);
    for side in [-25.0, 5.0] {
        ground([side, -25.0], [20.0, 50.0], 0.5);
    }
    for end in [-25.0, 10.0] {
        ground([-5.0, end], [10.0, 15.0], 0.5);
    }
    chunks
}

/// What a sky of irradiance 2 gives to the floor that the camera sees, over what an open floor gets, with its places.
fn sky_on_floor(stage: &mut Stage, chunks: Vec<Chunk>, camera: &Camera, size: &str) -> Vec<(DVec3, f64)> {
    let settings = sky_alone(size);
    let store = store_of(stage, chunks, Material::default());
    render(stage, &store, camera, &settings, &[]);
    let light = read(stage, Aov::Indirect);
    let places = read(stage, Aov::Position).into_iter().zip(light).filter(|(at, _)| at.z.abs() < 0.01);
    places.map(|(at, light)| (at, light.x / (ALBEDO * 2.0 * FRAC_1_PI))).collect()
}

#[test]
fn the_sky_lights_a_street_in_a_wide_scene_by_the_strip_that_its_walls_leave_open() {
    let mut stage = stage_or_skip!();
    // Walls of height 1.5 on both sides of a street that is 1 wide.
    let walls = [-0.5, 0.5].map(|x| sheet(DVec3::new(x, -10.0, 0.0), [DVec3::Y * 20.0, DVec3::Z * 1.5], 0.05));
    // The pivot is on the floor, or close before the eye, so that the floor lies outside of the finest maps' ball.
    let [near, far] = [(0.0, 1.4), (2.0, 0.6)]
        .map(|(height, distance)| Camera::looking(DVec3::Z * height, DVec3::new(0.0, -0.3, 1.0), distance, DVec3::Z));
    for (size, camera, most) in [("64", &near, 0.05), ("128", &near, 0.05), ("64", &far, 0.08), ("128", &far, 0.08)] {
        let floor = sky_on_floor(&mut stage, on_wide_ground(walls.to_vec()), camera, size);
        let inside = |(at, _): &&(DVec3, f64)| at.x.abs() < 0.45;
        // The sines of the angles under which the open strip is seen to both sides (Lambert).
        let open = |at: DVec3| [0.5 - at.x, 0.5 + at.x].iter().map(|to| to / to.hypot(1.5)).sum::<f64>() / 2.0;
        let ratios: Vec<f64> = floor.iter().filter(inside).map(|(at, share)| share / open(*at)).collect();
        let count = ratios.len() as f64;
        let mean = ratios.iter().sum::<f64>() / count;
        let off = (ratios.iter().map(|ratio| (ratio - 1.0).powi(2)).sum::<f64>() / count).sqrt();
        println!("{size} texels: {mean} of the closed form, off by {off}, {count} pixels");
        assert!(count > 400.0 && (mean - 1.0).abs() < most, "{size} texels: {mean} of the closed form, {count} pixels");
    }
}

#[test]
fn a_closed_room_in_a_wide_scene_is_dark_under_the_sky() {
    let mut stage = stage_or_skip!();
    let camera = Camera::from_eye(DVec3::new(0.4, 0.4, 0.6), DVec3::new(2.0, 1.4, 0.2), DVec3::Z);
    let floor = sky_on_floor(&mut stage, on_wide_ground(court(true)), &camera, "64");
    let mean = floor.iter().map(|(_, share)| share).sum::<f64>() / floor.len() as f64;
    // Beside walls, shadows begin late by a disc's radius.
    let is_inside = |at: DVec3| at.x > 0.5 && at.x < 2.5 && at.y > 0.5 && at.y < 1.5;
    let amid: Vec<f64> = floor.iter().filter(|(at, _)| is_inside(*at)).map(|(_, share)| *share).collect();
    let most = amid.iter().copied().fold(0.0, f64::max);
    println!("{mean} of the sky on {} pixels, up to {most} amid them on {}", floor.len(), amid.len());
    assert!(floor.len() > 400 && mean < 0.025, "{mean} of the sky on {} pixels", floor.len());
    assert!(amid.len() > 100 && most < 0.01, "{most} of the sky on {} pixels half a unit from the walls", amid.len());
}

#[test]
fn finer_maps_follow_the_view_and_the_points_and_depend_on_no_earlier_frame() {
    let mut stage = stage_or_skip!();
    let walls = [-0.5, 0.5].map(|x| sheet(DVec3::new(x, -10.0, 0.0), [DVec3::Y * 20.0, DVec3::Z * 1.5], 0.05));
    let mut store = store_of(&stage, on_wide_ground(walls.to_vec()), Material::default());
    let [here, there] = [0.0, 6.0].map(|y| Camera::looking(DVec3::Y * y, DVec3::new(0.0, -0.3, 1.0), 1.4, DVec3::Z));
    let mut settings = sky_alone("16");
    settings.gi.sky_lights = 32;
    let light = |stage: &mut Stage, store: &PointStore, camera: &Camera| {
        let stats = render(stage, store, camera, &settings, &[]);
        let drew = |name| stats.passes.iter().any(|pass| pass.name == name);
        let bits: Vec<[u64; 3]> = read(stage, Aov::Indirect).iter().map(|c| c.to_array().map(f64::to_bits)).collect();
        (bits, [drew("vpl_shadow_splat"), drew("vpl_points")])
    };
    stage.renderer.forget();
    let (first, drew) = light(&mut stage, &store, &here);
    assert_eq!(drew, [true; 2]);
    stage.effort.light_may_lag = true;
    let (lagging, drew) = light(&mut stage, &store, &there);
    assert_eq!(drew, [false; 2], "while something moves the maps serve that are there");
    stage.effort.light_may_lag = false;
    let (moved, drew) = light(&mut stage, &store, &there);
    assert!(drew[0] && moved != lagging, "at rest the maps are those of the view");
    assert!(light(&mut stage, &store, &here).0 == first, "the view before counts");
    let id = store.add_cloud(Material::default());
    store.add_chunk(id, &sheet(DVec3::new(-0.3, -0.3, 1.0), [DVec3::X * 0.6, DVec3::Y * 0.6], 0.05), None).unwrap();
    let (roofed, _) = light(&mut stage, &store, &here);
    assert!(roofed != first, "new points cast shadows");
    stage.renderer.forget();
    assert!(light(&mut stage, &store, &here).0 == roofed, "the points before count");
}

#[test]
fn a_far_disc_before_the_sun_casts_a_shadow() {
    let mut stage = stage_or_skip!();
    let settings = settings(&[("light.by", "sun"), ("sun.elevation", "50"), ("gi.bounces", "0"), ("sun.sky", "0")]);
    let camera = Camera::from_eye(DVec3::new(0.5, 0.5, 2.0), DVec3::new(1.5, 1.0, 0.0), DVec3::Z);
    let floor = || wall(DVec3::ZERO, [DVec3::X * 3.0, DVec3::Y * 2.0]);
    let mut shaded = |sizes: Option<f64>| {
        let mut chunks = vec![floor()];
        if let Some(sizes) = sizes {
            let toward = settings.sun.direction(DVec3::Z);
            let mut disc = Chunk { origin: camera.pivot + toward * 3.0 * sizes, ..floor().select(&[0]) };
            disc.positions = Arc::new(vec![[0.0; 3]]);
            disc.normals = Some(Arc::new(vec![pack_normal(toward.as_vec3())]));
            disc.radii = Some(Arc::new(vec![pack_radius(0.3)]));
            chunks.push(disc);
        }
        let store = store_of(&stage, chunks, Material::default());
        render(&mut stage, &store, &camera, &settings, &[]);
        read(&stage, Aov::Direct).iter().filter(|light| brightness(**light) == 0.0).count()
    };
    let without = shaded(None);
    let near = shaded(Some(2.0));
    assert!(without == 0 && near > 8, "{near} pixels are in the shadow, {without} without the disc");
    for sizes in [10.0, 100.0, 1000.0] {
        let far = shaded(Some(sizes));
        assert!(far.abs_diff(near) <= 2, "{far} pixels are in the shadow at {sizes} sizes, {near} nearby");
    }
}

#[test]
fn one_point_more_changes_at_most_a_thousandth_of_the_pixels_of_the_five_mirrors() {
    let mut stage = stage_or_skip!();
    let settings = settings(&[("gi.vpls", "64")]);
    let chunks = || five_mirrors::sample(Variant::Sphere, 60_000, 1).into_iter().flat_map(|part| part.chunks);
    let mut picture = |more: Option<DVec3>| {
        let mut chunks: Vec<Chunk> = chunks().collect();
        if let Some(place) = more {
            let one = Chunk { positions: Arc::new(vec![[0.0; 3]]), ..chunks[0].select(&[700]) };
            chunks.push(Chunk { origin: place, ..one });
        }
        let store = store_of(&stage, chunks, Material::default());
        render(&mut stage, &store, &five_mirrors::camera(), &settings, &[five_mirrors::light()]);
        stage.renderer.read_picture().unwrap()
    };
    let before = picture(None);
    let near = chunks().next().unwrap().position(700);
    let far = [10.0, 100.0, 1000.0].map(|sizes| DVec3::new(0.6, -0.5, 0.62) * 4.0 * sizes);
    for place in [near, near + DVec3::X * 0.003].into_iter().chain(far) {
        let after = picture(Some(place));
        let pixels = before.chunks_exact(4).zip(after.chunks_exact(4));
        let differing = pixels.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2)).count();
        assert!(differing * 1000 <= before.len() / 4, "{place}: {differing} pixels differ");
    }
}
