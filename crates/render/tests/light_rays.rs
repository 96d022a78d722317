//! Indirect light by rays against closed forms, and the sums of rays over frames.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod hollow;
#[macro_use]
mod stage;
mod walls;

use std::f64::consts::{FRAC_1_PI, PI};
use std::sync::Arc;

use cloud::{Chunk, STRAY_RADIUS};
use glam::{DVec3, Vec3};
use render::{Aov, Effort, Frame, FrameStats, LightReuse, Material, Objects, PointStore};
use scene::five_mirrors::{self, Variant};
use scene::{Camera, Mirror, Settings, Shape, SpotLight};

use hollow::{cone, hollow_sphere};
use stage::Stage;
use walls::{ALBEDO, DISC, settings, store_of, wall};

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

/// The settings of an even sky without a sun, whose light comes by rays.
fn sky(rays: u32) -> Settings {
    let rays = rays.to_string();
    settings(&[
        ("light.by", "sun"),
        ("sun.irradiance", "0"),
        ("sun.sky", "2"),
        ("gi.by", "rays"),
        ("gi.bounces", "0"),
        ("gi.rays_per_pixel", &rays),
        ("reflection.method", "none"),
    ])
}

fn floor() -> Chunk {
    wall(DVec3::new(-2.0, -2.0, 0.0), [DVec3::X * 4.0, DVec3::Y * 4.0])
}

/// A white floor's light from the sky of `sky`.
const OPEN: f64 = ALBEDO * 2.0 * FRAC_1_PI;

#[test]
fn an_open_floor_sees_the_whole_sky_by_any_number_of_rays() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![floor()], Material::default());
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.0, -0.2, 1.0), 1.2, DVec3::Z);
    for rays in [1, 7] {
        render(&mut stage, &store, &camera, &sky(rays), &[]);
        let light = read(&stage, Aov::Indirect);
        assert!(light.iter().filter(|light| !light.is_nan()).count() > 500);
        for light in light.iter().filter(|light| !light.is_nan()) {
            // Colour, irradiance and light are halves.
            assert!((light.x / OPEN - 1.0).abs() < 3e-3, "{light} instead of {OPEN} by {rays} rays");
        }
    }
}

#[test]
fn a_floor_at_the_foot_of_a_wall_sees_what_the_wall_leaves_of_the_sky_even_a_disc_away() {
    let mut stage = stage_or_skip!();
    // A wide wall of height h at distance d hides (1 - d / sqrt(d^2 + h^2)) / 2 of the light of a floor.
    let beside = wall(DVec3::new(2.0, -8.0, 0.0), [DVec3::Y * 16.0, DVec3::Z * 4.0]);
    let store = store_of(&stage, vec![floor(), beside], Material::default());
    // The first looks at the floor, the second at its last centimetres before the wall, which are five discs wide.
    let cameras = [(0.0, 1.2, 3.2), (1.95, 0.15, 5.0 * DISC)];
    for (x, distance, reach) in cameras {
        let camera = Camera::looking(DVec3::new(x, 0.0, 0.0), DVec3::new(-0.2, -0.2, 1.0), distance, DVec3::Z);
        render(&mut stage, &store, &camera, &sky(64), &[]);
        let (positions, light) = (read(&stage, Aov::Position), read(&stage, Aov::Indirect));
        let is_floor = |at: &DVec3| at.z.abs() < 0.002 && at.x < 2.0 - 0.5 * DISC && at.x > 2.0 - reach;
        let shares: Vec<f64> = positions
            .iter()
            .zip(&light)
            .filter(|(at, _)| is_floor(at))
            .map(|(at, light)| {
                let distance = 2.0 - at.x;
                let hidden = (1.0 - distance / (distance * distance + 16.0).sqrt()) / 2.0;
                light.x / (OPEN * (1.0 - hidden))
            })
            .collect();
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        println!("{mean} of the closed form on {} pixels", shares.len());
        assert!(shares.len() > 300 && (mean - 1.0).abs() < 0.02, "{mean} of the closed form on {}", shares.len());
    }
}

#[test]
fn a_floor_beside_a_mirror_wall_sees_the_sky_in_it() {
    let mut stage = stage_or_skip!();
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(-0.2, -0.2, 1.0), 3.2, DVec3::Z);
    let mut settings = sky(16);
    settings.set_text("reflection.method", "surfel_trace").unwrap();
    for share in [1.0_f64, 0.5] {
        let mut store = store_of(&stage, vec![floor()], Material::default());
        let center = DVec3::new(2.0, 0.0, 2.0);
        let plane = Mirror {
            specular_intensity: share as f32,
            ..Mirror::standing(Shape::Plane { height: 0.25 }, center, -DVec3::X, DVec3::Z, 8.0)
        };
        // By its formula, and as points.
        let by_formula = [plane];
        for mirrors in [&by_formula[..], &[]] {
            if mirrors.is_empty() {
                let wall = wall(DVec3::new(2.0, -8.0, 0.0), [DVec3::Z * 4.0, DVec3::Y * 16.0]);
                let material = Material { specular_intensity: share as f32, ..Material::default() };
                let cloud = store.add_cloud(material);
                store.add_chunk(cloud, &wall, None).unwrap();
            }
            let objects = Objects { mirrors, ..Objects::default() };
            stage.renderer.render(&store, &Frame::new(&camera, &settings, objects, SIZE)).unwrap();
            let is_floor = |at: &DVec3| at.z.abs() < 0.002 && at.x < 2.0 - DISC;
            // The mirror hides (1 - d / sqrt(d^2 + h^2)) / 2 of the light of a floor, and reflects its share of that.
            let shares =
                read(&stage, Aov::Position).into_iter().zip(read(&stage, Aov::Indirect)).filter(|(at, _)| is_floor(at));
            let shares: Vec<f64> = shares
                .map(|(at, light)| {
                    let distance = 2.0 - at.x;
                    let hidden = (1.0 - distance / (distance * distance + 16.0).sqrt()) / 2.0;
                    light.x / (OPEN * (1.0 - hidden * (1.0 - share)))
                })
                .collect();
            let mean = shares.iter().sum::<f64>() / shares.len() as f64;
            println!("{mean} of the closed form by a mirror of {share}");
            assert!(
                shares.len() > 300 && (mean - 1.0).abs() < 0.01,
                "{mean} of the closed form by a mirror of {share}"
            );
        }
    }
}

#[test]
fn no_sky_shines_into_a_closed_room_through_the_gaps_between_its_discs() {
    let mut stage = stage_or_skip!();
    let chunks = five_mirrors::sample(Variant::None, 20_000, 1).into_iter().flat_map(|part| part.chunks).collect();
    let store = store_of(&stage, chunks, Material::default());
    let mut share_of_sky = |close_gaps: bool| {
        let mut settings = sky(32);
        (settings.gi.filtered, settings.splat.close_gaps) = (false, close_gaps);
        render(&mut stage, &store, &five_mirrors::camera(), &settings, &[]);
        let (positions, albedo) = (read(&stage, Aov::Position), read(&stage, Aov::Albedo));
        // Where walls meet, a pixel shows a mean of both, which may lie outside.
        let is_on_one_wall = |at: &DVec3| {
            let gaps = (DVec3::new(1.0, 1.0, 2.0) - at.abs()).to_array();
            gaps.iter().filter(|gap| **gap < 0.1).count() == 1
        };
        let light = read(&stage, Aov::Indirect).into_iter().zip(albedo).zip(positions);
        let shares: Vec<f64> = light
            .filter(|(_, at)| is_on_one_wall(at))
            .map(|((light, albedo), _)| light.element_sum() / (albedo.element_sum() * 2.0 * FRAC_1_PI))
            .collect();
        assert!(shares.len() > 2000, "{} pixels", shares.len());
        shares.iter().sum::<f64>() / shares.len() as f64
    };
    let (closed, open) = (share_of_sky(true), share_of_sky(false));
    println!("{closed} of the sky, {open} where gaps stay open");
    // Discs leave 1.5 % of the walls open, and about half of the rays go up.
    assert!(open > 0.004 && closed < 0.0002, "{closed} of the sky, {open} where gaps stay open");
}

#[test]
fn a_point_a_hundred_sizes_away_in_the_chunk_of_a_wall_changes_no_light_by_rays() {
    let mut stage = stage_or_skip!();
    // A wall stands in the sky of the floor before it.
    let camera = Camera::from_eye(DVec3::new(-1.0, -1.6, 1.5), DVec3::new(0.0, 1.0, 0.0), DVec3::Z);
    let mut settings = sky(32);
    settings.gi.filtered = false;
    let mut light = |sizes: Option<f64>| {
        let wall = wall(DVec3::new(-2.0, 2.0, 0.0), [DVec3::X * 4.0, DVec3::Z * 2.0]);
        // Leaves of the tree are full but for one, and the stray is to share that with others.
        let mut wall = wall.select(&(4..wall.len() as u32).collect::<Vec<_>>());
        if let Some(sizes) = sizes {
            let stray = wall.select(&[0]);
            let place = Vec3::new(0.6, -0.5, 0.62) * 4.0 * sizes as f32;
            Arc::make_mut(&mut wall.positions).push(place.to_array());
            wall.normals = wall.normals.zip(stray.normals).map(|(all, one)| [&all[..], &one[..]].concat().into());
            wall.colors = wall.colors.zip(stray.colors).map(|(all, one)| [&all[..], &one[..]].concat().into());
            wall.radii = wall.radii.map(|all| [&all[..], &[STRAY_RADIUS]].concat().into());
        }
        let store = store_of(&stage, vec![floor(), wall], Material::default());
        render(&mut stage, &store, &camera, &settings, &[]);
        read(&stage, Aov::Indirect)
    };
    let without = light(None);
    let mean = without.iter().filter(|light| light.is_finite()).map(|light| light.x).sum::<f64>() / 3072.0;
    for sizes in [10.0, 100.0, 1000.0] {
        let pairs: Vec<f64> = light(Some(sizes)).iter().zip(&without).map(|(a, b)| (*a - *b).length()).collect();
        let squares: Vec<f64> = pairs.into_iter().filter(|d| d.is_finite()).map(|d| d * d).collect();
        let rmse = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt() / mean;
        assert!(squares.len() > 500 && rmse < 0.01, "{sizes} sizes: {rmse} of {mean}");
    }
}

#[test]
fn light_is_averaged_over_a_face_and_none_runs_around_its_edge() {
    let mut stage = stage_or_skip!();
    // The top of a block sees the whole sky, its side half of it, right up to their edge.
    let side = wall(DVec3::new(-1.0, -1.0, -2.0), [DVec3::X * 2.0, DVec3::Z * 2.0]);
    let top = wall(DVec3::new(-1.0, -1.0, 0.0), [DVec3::X * 2.0, DVec3::Y * 2.0]);
    let store = store_of(&stage, vec![top, side], Material::default());
    let camera = Camera::looking(DVec3::new(0.0, -1.0, 0.0), DVec3::new(0.1, -1.0, 0.8), 0.6, DVec3::Z);
    let mut shares = |settings: &Settings| {
        render(&mut stage, &store, &camera, settings, &[]);
        let faces: Vec<(DVec3, DVec3)> =
            read(&stage, Aov::Normal).into_iter().zip(read(&stage, Aov::Indirect)).collect();
        [(DVec3::Z, OPEN), (DVec3::NEG_Y, OPEN / 2.0)].map(|(normal, expected)| {
            let of_face = faces.iter().filter(|(seen, _)| seen.dot(normal) > 0.9999);
            of_face.map(|(_, light)| light.x / expected).collect::<Vec<f64>>()
        })
    };
    let noise =
        |shares: &[f64]| (shares.iter().map(|share| (share - 1.0).powi(2)).sum::<f64>() / shares.len() as f64).sqrt();
    let [top, side] = shares(&sky(16));
    assert!(top.len() > 300 && side.len() > 300, "{} and {} pixels", top.len(), side.len());
    for share in top.iter().chain(&side) {
        assert!((share - 1.0).abs() < 0.06, "{share} of a face's light");
    }
    let mut alone = sky(16);
    alone.gi.filtered = false;
    let noises = [side, shares(&alone)[1].clone()].map(|shares| noise(&shares));
    println!("{noises:?} with and without the mean of neighbours");
    assert!(noises[0] < 0.5 * noises[1], "{noises:?} with and without the mean of neighbours");
}

#[test]
fn rays_and_virtual_lights_behind_them_keep_the_energy_that_the_integrating_sphere_says() {
    let mut stage = stage_or_skip!();
    // The light that a ball reflects inside is the same everywhere: for a flux F the k-th reflection gives albedo^k F /
    // area. With a factor of 1.6 four fifths of the light come back.
    let store = store_of(&stage, vec![hollow_sphere(2.0, 40_000)], Material::default());
    let (lamp, flux) = cone(DVec3::new(0.3, -0.2, 0.1), DVec3::new(0.3, 2.0, 0.5), 40.0);
    let camera = Camera::looking(DVec3::new(0.0, 0.5, 0.0), -DVec3::Y, 1.0, DVec3::Z);
    let irradiance = flux / (4.0 * PI * 4.0);
    for (bounces, ray_bounces, factor, most) in
        [(1_u32, 1, 1.0, 0.02), (2, 2, 1.0, 0.02), (4, 4, 1.6, 0.03), (3, 1, 1.0, 0.05), (1, 4, 1.0, 0.02)]
    {
        let settings = settings(&[
            ("gi.by", "rays"),
            ("gi.rays_per_pixel", "16"),
            ("gi.bounces", &bounces.to_string()),
            ("gi.ray_bounces", &ray_bounces.to_string()),
            ("light.diffuse", &factor.to_string()),
        ]);
        let albedo = ALBEDO * factor;
        render(&mut stage, &store, &camera, &settings, &[lamp]);
        let expected: f64 = (1..=bounces).map(|k| albedo.powi(k as i32) * irradiance).sum::<f64>() * albedo * FRAC_1_PI;
        let light = read(&stage, Aov::Indirect);
        let seen: Vec<f64> =
            light.iter().filter(|light| !light.is_nan()).map(|light| light.element_sum() / 3.0).collect();
        let ratio = seen.iter().sum::<f64>() / seen.len() as f64 / expected;
        println!("{bounces} bounces, {ray_bounces} by rays, {factor}: {ratio} of the closed form");
        assert!((ratio - 1.0).abs() < most, "{bounces} bounces, {ray_bounces} by rays: {ratio} of the closed form");
    }
}

#[test]
fn a_still_picture_has_the_same_bits_however_many_rays_a_frame_adds_and_then_keeps_them() {
    let mut stage = stage_or_skip!();
    let chunks = five_mirrors::sample(Variant::None, 20_000, 1).into_iter().flat_map(|part| part.chunks).collect();
    let store = store_of(&stage, chunks, Material::default());
    let by_rays = |pairs: &[(&str, &str)]| {
        let all = [("gi.by", "rays"), ("gi.rays_per_pixel", "7"), ("gi.vpls", "64")];
        settings(&[&all[..], pairs].concat())
    };
    let mut draw = |settings: &Settings, most_samples: Option<u32>| {
        stage.effort.most_samples = most_samples;
        let stats = render(&mut stage, &store, &five_mirrors::camera(), settings, &[five_mirrors::light()]);
        (stats.light_rays, stage.renderer.read_picture().unwrap(), stage.renderer.read_aov(Aov::Indirect).unwrap().data)
    };
    let plain = by_rays(&[]);
    let (rays, whole, light) = draw(&plain, None);
    assert_eq!(rays, [7, 7]);
    let other = by_rays(&[("gi.ray_seed", "2")]);
    assert!(draw(&other, None).1 != whole, "the seed changes nothing");
    let mut counts = Vec::new();
    let mut first = None;
    for _ in 0..4 {
        let (rays, picture, _) = draw(&plain, Some(3));
        counts.push(rays[0]);
        first.get_or_insert(picture);
    }
    assert_eq!(counts, [3, 6, 7, 7]);
    assert!(first.is_some_and(|first| first != whole), "three rays are as good as seven");
    let (_, again, same) = draw(&plain, Some(3));
    let bits = |light: &[f32]| light.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert!(again == whole && bits(&same) == bits(&light), "frames that add a part of the rays make another picture");
    // Another light needs all rays anew, and one of another way of mapping none.
    let brighter = by_rays(&[("tone.exposure", "1")]);
    assert_eq!(draw(&brighter, Some(3)).0, [7, 7]);
    let duller = by_rays(&[("light.diffuse", "0.5")]);
    assert_eq!(draw(&duller, Some(3)).0, [3, 7]);
    // Virtual lights in their place know nothing of them.
    let by_lights = settings(&[("gi.vpls", "64")]);
    assert_eq!(draw(&by_lights, Some(3)).0, [0, 0]);
}

#[test]
fn a_moving_camera_takes_over_the_rays_of_the_frames_before() {
    let mut stage = stage_or_skip!();
    let chunks = five_mirrors::sample(Variant::None, 60_000, 1).into_iter().flat_map(|part| part.chunks).collect();
    let store = store_of(&stage, chunks, Material::default());
    let lights = [five_mirrors::light()];
    let settings =
        settings(&[("gi.by", "rays"), ("gi.rays_per_pixel", "32"), ("gi.vpls", "64"), ("edl.strength", "0")]);
    let start = five_mirrors::camera();
    // Steps of about half a pixel at the back wall, and then beside where the camera has been.
    let at = |step: u32| {
        let shift = DVec3::new(0.02, 0.008, 0.0) * f64::from(step);
        Camera { eye: start.eye + shift, pivot: start.pivot + 0.5 * shift, up: start.up }
    };
    let draw = |stage: &mut Stage, step: u32, reuse: LightReuse, most_samples: Option<u32>| {
        (stage.effort.light_reuse, stage.effort.most_samples) = (reuse, most_samples);
        render(stage, &store, &at(step), &settings, &lights);
        (read(stage, Aov::Indirect), stage.renderer.read_picture().unwrap())
    };
    let mean = |light: &[DVec3]| {
        let seen: Vec<f64> = light.iter().filter(|light| !light.is_nan()).map(|light| light.element_sum()).collect();
        seen.iter().sum::<f64>() / seen.len() as f64
    };
    let drag = |stage: &mut Stage, reuse: LightReuse| {
        let (mut light, _) = draw(stage, 0, LightReuse::Keep, None);
        for step in 1..=12 {
            (light, _) = draw(stage, step, reuse, Some(1));
        }
        light
    };
    let [taken, single] = [LightReuse::Reuse, LightReuse::Keep].map(|reuse| drag(&mut stage, reuse));
    let (still, picture) = draw(&mut stage, 12, LightReuse::Keep, None);
    // The relative RMSE and the median error. The picture is so coarse that whole pixels lie on the edges of walls.
    let errors = |light: &[DVec3]| {
        let seen = light.iter().zip(&still).filter(|(a, b)| !a.is_nan() && !b.is_nan());
        let mut errors: Vec<f64> = seen.map(|(a, b)| (*a - *b).element_sum().abs() / mean(&still)).collect();
        errors.sort_by(f64::total_cmp);
        let square = errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64;
        [square.sqrt(), errors[errors.len() / 2]]
    };
    let [[taken_rmse, taken_median], [single_rmse, single_median]] = [errors(&taken), errors(&single)];
    println!("{taken_rmse}, {taken_median} with and {single_rmse}, {single_median} without the frames before");
    assert!(taken_rmse < 0.5 * single_rmse && taken_median < 0.05 && single_median > 0.1);
    let ratio = mean(&taken) / mean(&still);
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    // Moving leaves no trace in still pictures.
    draw(&mut stage, 11, LightReuse::Reuse, Some(1));
    draw(&mut stage, 12, LightReuse::Reuse, Some(1));
    assert!(draw(&mut stage, 12, LightReuse::Keep, None).1 == picture);
    stage.renderer.forget();
    assert!(draw(&mut stage, 12, LightReuse::Never, None).1 == picture);
    // Another light needs rays of its own.
    draw(&mut stage, 0, LightReuse::Keep, None);
    let brighter = SpotLight { intensity: lights[0].intensity.map(|part| 2.0 * part), ..lights[0] };
    (stage.effort.light_reuse, stage.effort.most_samples) = (LightReuse::Reuse, Some(1));
    render(&mut stage, &store, &at(1), &settings, &[brighter]);
    let ratio = mean(&read(&stage, Aov::Indirect)) / mean(&still);
    assert!((ratio - 2.0).abs() < 0.2, "{ratio}");
}

#[test]
fn rays_of_before_are_not_taken_over_where_a_mirror_has_moved() {
    let mut stage = stage_or_skip!();
    let beside = wall(DVec3::new(-2.0, 2.0, 0.0), [DVec3::X * 4.0, DVec3::Z * 2.0]);
    let store = store_of(&stage, vec![floor(), beside], Material::default());
    let settings = settings(&[("gi.by", "rays"), ("gi.rays_per_pixel", "32"), ("mirror.surface", "exact")]);
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.3, -1.0, 0.6), 4.0, DVec3::Z);
    let lights = [SpotLight {
        position: DVec3::new(0.0, -1.0, 3.0),
        target: DVec3::ZERO,
        intensity: [10.0; 3],
        inner_degrees: 60.0,
        outer_degrees: 70.0,
    }];
    let mirror = |x: f64| [Mirror::standing(Shape::Sphere, DVec3::new(x, 0.5, 0.5), DVec3::Z, DVec3::Y, 0.5)];
    let draw = |stage: &mut Stage, mirrors: &[Mirror], reuse: LightReuse, samples: Option<u32>| {
        let effort = Effort { light_reuse: reuse, most_samples: samples, ..Effort::FULL };
        let objects = Objects { lights: &lights, mirrors, ..Objects::default() };
        stage.renderer.render(&store, &Frame { effort, ..Frame::new(&camera, &settings, objects, SIZE) }).unwrap();
        read(stage, Aov::Indirect)
    };
    let is_near = |a: &[DVec3], b: &[DVec3]| {
        let pairs: Vec<_> = a.iter().zip(b).filter(|(a, b)| !a.is_nan() && !b.is_nan()).collect();
        let difference = pairs.iter().map(|(a, b)| (**a - **b).length()).sum::<f64>();
        difference / pairs.iter().map(|(_, b)| b.length()).sum::<f64>()
    };
    let all = draw(&mut stage, &mirror(0.5), LightReuse::Keep, None);
    let same = draw(&mut stage, &mirror(0.5), LightReuse::Reuse, Some(1));
    assert!(is_near(&same, &all) < 0.01, "{}", is_near(&same, &all));
    let moved = draw(&mut stage, &mirror(-0.5), LightReuse::Reuse, Some(1));
    stage.renderer.forget();
    let anew = draw(&mut stage, &mirror(-0.5), LightReuse::Reuse, Some(1));
    assert_eq!(is_near(&moved, &anew), 0.0, "light of where the mirror was");
}

#[test]
fn rays_of_before_count_little_where_points_have_come() {
    let mut stage = stage_or_skip!();
    let chunks = five_mirrors::sample(Variant::None, 20_000, 1).into_iter().flat_map(|part| part.chunks).collect();
    let mut store = store_of(&stage, chunks, Material::default());
    let settings = settings(&[("gi.by", "rays"), ("gi.rays_per_pixel", "32"), ("gi.vpls", "64")]);
    let (camera, lights) = (five_mirrors::camera(), [five_mirrors::light()]);
    let mut draw = |store: &PointStore, reuse: LightReuse, samples: Option<u32>| {
        (stage.effort.light_reuse, stage.effort.most_samples) = (reuse, samples);
        stage.effort.light_may_lag = reuse == LightReuse::Reuse;
        render(&mut stage, store, &camera, &settings, &lights);
        read(&stage, Aov::Indirect)
    };
    let all = draw(&store, LightReuse::Keep, None);
    let error = |light: &[DVec3]| {
        let pairs: Vec<_> = light.iter().zip(&all).filter(|(a, b)| !a.is_nan() && !b.is_nan()).collect();
        let difference: f64 = pairs.iter().map(|(a, b)| (**a - **b).length()).sum();
        difference / pairs.iter().map(|(_, b)| b.length()).sum::<f64>()
    };
    let same = error(&draw(&store, LightReuse::Reuse, Some(1)));
    // A small thing in the middle of the box.
    let other = store.add_cloud(Material::default());
    store.add_chunk(other, &wall(DVec3::ZERO, [DVec3::X * 0.02, DVec3::Y * 0.02]), None).unwrap();
    let after: Vec<f64> = (0..12).map(|_| error(&draw(&store, LightReuse::Reuse, Some(1)))).collect();
    println!("{same} with the same points, then {after:?}");
    assert!(same < 0.01 && after[0] > 3.0 * same && after[11] > 3.0 * same && after[11] < 0.2);
}
