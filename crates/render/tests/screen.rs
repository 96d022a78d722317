//! Screen-space tracing against closed forms and against rays through the points.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;
#[allow(dead_code, reason = "each test takes what it needs of it")]
mod walls;

use glam::{DQuat, DVec3, Vec3};
use render::{Aov, Frame, FrameStats, Material, Objects, PointStore};
use scene::{Camera, Mirror, Settings, Shape};

use stage::Stage;
use walls::{settings, store_of, wall};

struct Scene {
    store: PointStore,
    mirrors: Vec<Mirror>,
    camera: Camera,
}

impl Scene {
    fn render(&self, stage: &mut Stage, settings: &Settings, size: [u32; 2]) -> FrameStats {
        let objects = Objects { mirrors: &self.mirrors, ..Objects::default() };
        stage.renderer.render(&self.store, &Frame::new(&self.camera, settings, objects, size)).unwrap()
    }
}

fn by_screen(pairs: &[(&str, &str)]) -> Settings {
    settings(&[&[("reflection.method", "screen_trace")], pairs].concat())
}

fn sphere(position: DVec3, size: f64) -> Mirror {
    Mirror { position, ..Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Y, size) }
}

fn flat(position: DVec3, normal: DVec3, size: f64) -> Mirror {
    Mirror { position, ..Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::ZERO, normal, DVec3::Y, size) }
}

/// A box from -1 to 1 without its front, with a pillar and two balls in it, seen from before it.
fn furnished(stage: &Stage) -> Scene {
    let mut chunks: Vec<_> = [0, 1, 3, 4, 5]
        .into_iter()
        .map(|side: usize| {
            let axis = |offset: usize| DVec3::AXES[(side + offset) % 3];
            let corner = if side < 3 { axis(0) } else { -axis(0) } - axis(1) - axis(2);
            wall(corner, [axis(1) * 2.0, axis(2) * 2.0])
        })
        .collect();
    chunks.push(wall(DVec3::new(0.5, -1.0, -0.4), [DVec3::X * 0.2, DVec3::Y * 2.0]));
    let mirrors = vec![sphere(DVec3::new(-0.1, -0.2, -0.2), 0.4), sphere(DVec3::new(-0.7, 0.5, -0.4), 0.2)];
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0), 2.4, DVec3::Y);
    Scene { store: store_of(stage, chunks, Material::default()), mirrors, camera }
}

fn vectors<const N: usize>(stage: &Stage, aov: Aov) -> Vec<[f32; N]> {
    let image = stage.renderer.read_aov(aov).unwrap();
    image.data.chunks(N).map(|part| part.try_into().unwrap()).collect()
}

#[test]
fn a_picture_that_shows_nothing_of_what_is_reflected_leaves_all_to_the_next_method_bit_for_bit() {
    let mut stage = stage_or_skip!();
    // The camera sees the mirror alone, and all it reflects, through the open front or not, is behind the camera.
    let mut scene = furnished(&stage);
    scene.mirrors = vec![flat(DVec3::Z * -0.5, DVec3::new(0.2, 0.1, 1.0).normalize(), 0.8)];
    scene.camera = Camera::looking(DVec3::Z * -0.5, DVec3::Z, 0.5, DVec3::Y);
    let mut of_points = furnished(&stage);
    let material = Material { specular_intensity: 1.0, ..Material::default() };
    let id = of_points.store.add_cloud(material);
    for chunk in scene.mirrors[0].sample(20_000, 1) {
        of_points.store.add_chunk(id, &chunk, None).unwrap();
    }
    (of_points.mirrors, of_points.camera) = (Vec::new(), scene.camera);
    for (scene, bounces) in [(&scene, "1"), (&scene, "2"), (&of_points, "1")] {
        let pairs = [("reflection.bounces", bounces)];
        let mut drawn = |method: &str, rest: &str| {
            let chosen = [("reflection.method", method), ("screen_trace.rest", rest)];
            let settings = settings(&[&chosen, &pairs[..]].concat());
            let stats = scene.render(&mut stage, &settings, [64, 48]);
            let found = [Aov::MirrorPosition, Aov::MirrorAlbedo, Aov::MirrorNormal].map(|aov| {
                let image = stage.renderer.read_aov(aov).unwrap();
                image.data.iter().map(|value| value.to_bits()).collect::<Vec<_>>()
            });
            (stats.reflection.unwrap(), found, stage.renderer.read_picture().unwrap())
        };
        for next in ["surfel_trace", "cubemap_trace", "environment_map"] {
            let (figures, found, picture) = drawn("screen_trace", next);
            let (traced, mut expected_points, expected) = drawn(next, "none");
            if next == "environment_map" {
                // Nothing proves what a map shows in a direction.
                let places = &mut expected_points[0];
                let proven = places.iter_mut().skip(3).step_by(4).filter(|coverage| **coverage == 1_f32.to_bits());
                proven.for_each(|coverage| *coverage = 0.75_f32.to_bits());
            }
            let left = if next == "cubemap_trace" { traced.unresolved } else { Some(1.0) };
            assert_eq!(figures.unresolved, left, "bounces {bounces}, {next}: {figures:?}");
            assert!(traced.mirror_pixels > 2000 && traced.coverage > 0.4, "{next}: {traced:?}");
            assert!(found == expected_points && picture == expected, "bounces {bounces}, {next}");
        }
    }
}

#[test]
fn a_picture_that_resolves_every_ray_leaves_the_next_method_nothing() {
    let mut stage = stage_or_skip!();
    // A mirror that lies flat reflects the lines of sight into the upper part of the picture, where nothing is. The
    // wall behind the camera is never reflected.
    let behind = wall(DVec3::new(-1.0, -1.0, 6.0), [DVec3::X * 2.0, DVec3::Y * 2.0]);
    let scene = Scene {
        store: store_of(&stage, vec![behind], Material::default()),
        mirrors: vec![flat(DVec3::ZERO, DVec3::Y, 0.6)],
        camera: Camera::looking(DVec3::ZERO, DVec3::new(0.0, 0.26, 1.0), 1.5, DVec3::Y),
    };
    for rest in ["none", "surfel_trace", "cubemap_trace", "environment_map"] {
        let settings = by_screen(&[("screen_trace.rest", rest), ("view.field_of_view", "120")]);
        let stats = scene.render(&mut stage, &settings, [240, 180]).reflection.unwrap();
        assert!(stats.mirror_pixels > 200, "{stats:?}");
        assert_eq!((stats.unresolved, stats.coverage, stats.uncertain), (Some(0.0), 0.0, 0.0), "{rest}: {stats:?}");
    }
}

#[test]
fn rays_through_the_picture_end_where_rays_through_the_points_end() {
    let mut stage = stage_or_skip!();
    let scene = furnished(&stage);
    for (projection, bounces) in [("perspective", "1"), ("orthographic", "1"), ("perspective", "3")] {
        let mut found = |method: &str, rest: &str| {
            let pairs = [
                ("reflection.method", method),
                ("screen_trace.rest", rest),
                ("view.projection", projection),
                ("reflection.bounces", bounces),
            ];
            let stats = scene.render(&mut stage, &settings(&pairs), [240, 180]);
            (stats.reflection.unwrap(), vectors::<4>(&stage, Aov::MirrorPosition), vectors::<3>(&stage, Aov::Color))
        };
        let (figures, truth, color) = found("surfel_trace", "none");
        let place = |found: &[f32; 4]| Vec3::new(found[0], found[1], found[2]);
        let there = truth.iter().filter(|place| place[3] == 1.0).count() as f64;
        assert!(there > 0.7 * f64::from(figures.mirror_pixels) && there > 700.0, "{figures:?}");
        for (rest, least) in [("none", 0.98), ("surfel_trace", 0.98)] {
            let (figures, seen, other) = found("screen_trace", rest);
            let (mut alike, mut compared) = (0, 0);
            for (a, b) in seen.iter().zip(&truth).filter(|(a, b)| a[3] == 1.0 && b[3] == 1.0) {
                compared += 1;
                alike += u32::from(place(a).distance(place(b)) < 0.03);
            }
            assert!(f64::from(alike) > least * f64::from(compared), "{projection} {rest}: {alike} of {compared}");
            let unresolved = figures.unresolved.unwrap();
            if rest == "none" {
                assert!((0.2..0.8).contains(&unresolved) && figures.coverage > 0.2, "{figures:?}");
                assert!(f64::from(compared) > 0.2 * there && figures.coverage + unresolved < 1.02);
            } else {
                assert!(f64::from(compared) > 0.98 * there, "{projection}: {compared} of {there}");
                let near = |(a, b): &(&[f32; 3], &[f32; 3])| {
                    a[0].is_nan() && b[0].is_nan() || Vec3::from(**a).distance(Vec3::from(**b)) < 0.05
                };
                let same = other.iter().zip(&color).filter(near).count();
                assert!(same * 100 > color.len() * 98, "{projection}, {bounces} bounces: {same} of {}", color.len());
            }
        }
    }
}

#[test]
fn what_bounds_skip_changes_no_pixel() {
    let mut stage = stage_or_skip!();
    let scene = furnished(&stage);
    for (size, projection) in [([131, 97], "perspective"), ([64, 64], "orthographic"), ([160, 3], "perspective")] {
        let mut drawn = |skip: &str| {
            let settings = by_screen(&[("screen_trace.skip", skip), ("view.projection", projection)]);
            let stats = scene.render(&mut stage, &settings, size).reflection.unwrap();
            let bits = |aov| stage.renderer.read_aov(aov).unwrap().data.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            (stats.unresolved, bits(Aov::MirrorPosition), stats.tests_per_ray.map_or(0.0, |tests| tests[0]))
        };
        let (all, skipping) = (drawn("off"), drawn("on"));
        assert!(all.0 == skipping.0 && all.1 == skipping.1, "{size:?}");
        assert!(size[1] < 10 || skipping.2 < 0.8 * all.2, "{} cells, {} without skipping", skipping.2, all.2);
    }
}

#[test]
fn in_a_parallel_picture_a_wall_is_seen_in_a_flat_mirror_where_the_closed_form_says() {
    let mut stage = stage_or_skip!();
    // The mirror at 45 degrees turns the lines of sight, which all are -z, towards the wall at x = 1.
    let back = wall(DVec3::new(-1.0, -1.0, -1.0), [DVec3::X * 2.0, DVec3::Y * 2.0]);
    let right = wall(DVec3::new(1.0, -1.0, -1.0), [DVec3::Y * 2.0, DVec3::Z * 2.0]);
    let scene = Scene {
        store: store_of(&stage, vec![back, right], Material::default()),
        mirrors: vec![flat(DVec3::new(-0.2, 0.0, -0.2), DVec3::new(1.0, 0.0, 1.0).normalize(), 0.4)],
        camera: Camera::looking(DVec3::new(0.0, 0.0, 0.0), DVec3::new(-0.3, 0.2, 1.0), 2.5, DVec3::Y),
    };
    let settings = by_screen(&[("screen_trace.rest", "none"), ("view.projection", "orthographic")]);
    let stats = scene.render(&mut stage, &settings, [200, 150]).reflection.unwrap();
    assert!(stats.mirror_pixels > 300 && stats.coverage > 0.5, "{stats:?}");
    let forward = scene.camera.forward();
    let normal = DVec3::new(1.0, 0.0, 1.0).normalize();
    let reflected = forward - normal * (2.0 * forward.dot(normal));
    let (places, found) = (vectors::<3>(&stage, Aov::Position), vectors::<4>(&stage, Aov::MirrorPosition));
    let mut on_side = 0;
    for (place, found) in places.iter().zip(&found).filter(|(_, found)| found[3] == 1.0) {
        let place = Vec3::from(*place).as_dvec3();
        let found = Vec3::new(found[0], found[1], found[2]).as_dvec3();
        let along = ((1.0 - place.x) / reflected.x).min((-1.0 - place.z) / reflected.z);
        let expected = place + reflected * along;
        on_side += u32::from(found.x > 0.99);
        // A pixel on the edge shows one of the walls alone.
        let beside_edge = (expected - DVec3::new(1.0, expected.y, -1.0)).length();
        assert!(found.distance(expected) < 1e-3 || beside_edge < 0.03, "{found}, not {expected}");
    }
    assert!(on_side > 50, "{on_side}");
}

#[test]
fn found_places_lie_on_a_slanted_wall_far_closer_than_its_pixels() {
    let mut stage = stage_or_skip!();
    // A wall behind a mirror that lies flat, turned away from the camera; few pixels.
    let turn = DQuat::from_rotation_y(0.9) * DQuat::from_rotation_x(0.3);
    let (across, up) = (turn * DVec3::X * 6.0, turn * DVec3::Y * 4.0);
    let middle = DVec3::new(0.0, 0.3, -1.5);
    let normal = across.cross(up).normalize();
    let scene = Scene {
        store: store_of(&stage, vec![wall(middle - (across + up) * 0.5, [across, up])], Material::default()),
        mirrors: vec![flat(DVec3::new(0.1, -0.6, 0.0), DVec3::new(0.0, 1.0, 0.1).normalize(), 0.5)],
        camera: Camera::looking(DVec3::new(0.0, 0.0, -1.0), DVec3::new(0.2, 0.5, 1.0), 3.0, DVec3::Y),
    };
    scene.render(&mut stage, &by_screen(&[("screen_trace.rest", "none")]), [60, 45]);
    let (places, normals) = (vectors::<3>(&stage, Aov::Position), vectors::<3>(&stage, Aov::Normal));
    let found = vectors::<4>(&stage, Aov::MirrorPosition);
    let (mut count, mut printed_is_off) = (0, 0);
    for pixel in (0..found.len()).filter(|pixel| found[*pixel][3] == 1.0) {
        let place = Vec3::new(found[pixel][0], found[pixel][1], found[pixel][2]).as_dvec3();
        let off = normal.dot(place - middle).abs();
        assert!(off < 1e-4, "{off} off the wall");
        count += 1;
        // As printed, with the direction in place of the origin: t = (p - d) . n / d . n for the wall's p and n.
        let (origin, mirror) = (Vec3::from(places[pixel]).as_dvec3(), Vec3::from(normals[pixel]).as_dvec3());
        let incoming = (origin - scene.camera.eye).normalize();
        let direction = incoming - mirror * (2.0 * incoming.dot(mirror));
        let along = (middle - direction).dot(normal) / direction.dot(normal);
        printed_is_off += u32::from(normal.dot(origin + direction * along - middle).abs() > 1e-2);
    }
    assert!(count > 50 && printed_is_off * 2 > count, "{printed_is_off} of {count}");
}

#[test]
fn rays_towards_the_eye_and_rays_to_nowhere_are_told_apart() {
    let mut stage = stage_or_skip!();
    // Nothing but a ball, before nothing: beside its middle, rays leave the picture; at its rim they go on into it for
    // ever, and are free.
    let store = store_of(
        &stage,
        vec![wall(DVec3::new(-0.05, -3.0, 0.0), [DVec3::X * 0.1, DVec3::Y * 0.1])],
        Material::default(),
    );
    let camera = Camera::looking(DVec3::ZERO, DVec3::Z, 3.0, DVec3::Y);
    let scene = Scene { store, mirrors: vec![sphere(DVec3::ZERO, 1.0)], camera };
    let stats = scene.render(&mut stage, &by_screen(&[("screen_trace.rest", "none")]), [80, 60]).reflection.unwrap();
    let unresolved = stats.unresolved.unwrap();
    assert!(stats.mirror_pixels > 500 && stats.coverage == 0.0, "{stats:?}");
    assert!((0.9..0.999).contains(&unresolved), "{unresolved}");
}

#[test]
fn a_layer_behind_tells_more_of_what_is_hidden_and_no_less_rightly() {
    let mut stage = stage_or_skip!();
    let scene = furnished(&stage);
    for projection in ["perspective", "orthographic"] {
        let mut found = |method: &str, back: &str| {
            let pairs = [
                ("reflection.method", method),
                ("screen_trace.rest", "none"),
                ("screen_trace.back", back),
                ("view.projection", projection),
            ];
            let stats = scene.render(&mut stage, &settings(&pairs), [240, 180]);
            (stats.reflection.unwrap(), vectors::<4>(&stage, Aov::MirrorPosition))
        };
        let truth = found("surfel_trace", "none").1;
        let place = |found: &[f32; 4]| Vec3::new(found[0], found[1], found[2]);
        let mut judge = |back: &str| {
            let (figures, seen) = found("screen_trace", back);
            let pairs = || seen.iter().zip(&truth).filter(|(a, b)| a[3] >= 0.75 && b[3] == 1.0);
            let wrong = pairs().filter(|(a, b)| place(a).distance(place(b)) > 0.03).count();
            let unproven = seen.iter().filter(|seen| seen[3] == 0.75).count();
            (figures.unresolved.unwrap(), pairs().count(), wrong, unproven)
        };
        let [none, culled, peeled] = ["none", "culled", "peeled"].map(&mut judge);
        println!("{projection}: unresolved, compared, wrong, unproven: {none:?}, {culled:?}, {peeled:?}");
        assert!(peeled.0 < none.0 - 0.01 && peeled.1 > none.1, "{none:?} {peeled:?}");
        assert!(peeled.2 * 25 < peeled.1 && peeled.3 * 8 < peeled.1, "{none:?} {peeled:?}");
        // Beside outlines nothing is proven.
        assert!(none.3 * 8 < none.1, "{none:?}");
        assert!(culled.1 >= none.1, "{none:?} {culled:?}");
    }
}

#[test]
fn published_criteria_find_more_and_less_rightly_and_are_marked_as_unproven() {
    let mut stage = stage_or_skip!();
    let scene = furnished(&stage);
    let mut found = |pairs: &[(&str, &str)]| {
        let pairs = [&[("reflection.method", "screen_trace"), ("screen_trace.rest", "none")], pairs].concat();
        let stats = scene.render(&mut stage, &settings(&pairs), [240, 180]);
        (stats.reflection.unwrap(), vectors::<4>(&stage, Aov::MirrorPosition))
    };
    let (traced, truth) = found(&[("reflection.method", "surfel_trace")]);
    let place = |found: &[f32; 4]| Vec3::new(found[0], found[1], found[2]);
    let pixels = f64::from(traced.mirror_pixels);
    // The shares that something is found in, and that something else should be.
    let mut judge = |pairs: &[(&str, &str)], is_proven: bool| {
        let (figures, seen) = found(pairs);
        // The other mirror, put in front by its formula, is proven.
        let there = seen.iter().filter(|seen| seen[3] >= 0.75).count() as f64;
        assert!((there / pixels - figures.coverage).abs() < 1e-3, "{pairs:?}: {there} of {pixels}, {figures:?}");
        assert!(is_proven || figures.uncertain > figures.coverage - 0.02, "{figures:?}");
        let is_wrong = |(a, b): &(&[f32; 4], &[f32; 4])| {
            a[3] >= 0.75 && (b[3].is_nan() || b[3] == 1.0 && place(a).distance(place(b)) > 0.05)
        };
        (there / pixels, seen.iter().zip(&truth).filter(is_wrong).count() as f64 / pixels)
    };
    let plane = judge(&[], true);
    let behind = judge(&[("screen_trace.criterion", "behind")], false);
    let thin = judge(&[("screen_trace.criterion", "thickness"), ("screen_trace.thickness", "0.02")], false);
    let layers = [("screen_trace.criterion", "layers"), ("screen_trace.back", "culled")];
    let layers = judge(&layers, false);
    let steps = judge(&[("screen_trace.sampling", "step")], true);
    let long_steps = judge(&[("screen_trace.sampling", "step"), ("screen_trace.step", "32")], true);
    println!("{plane:?} {behind:?} {thin:?} {layers:?} {steps:?} {long_steps:?}");
    assert!(behind.0 > plane.0 && behind.1 > 3.0 * plane.1, "{behind:?} {plane:?}");
    assert!(thin.0 < behind.0 && thin.1 < behind.1, "{thin:?} {behind:?}");
    assert!(layers.0 < behind.0 && layers.1 <= behind.1, "{layers:?} {behind:?}");
    assert!((steps.0 - plane.0).abs() < 0.1 && steps.1 < 0.05, "{steps:?} {plane:?}");
    assert!(long_steps.1 > 2.0 * steps.1, "{long_steps:?} {steps:?}");
}

#[test]
fn rays_that_leave_the_picture_end_on_the_walls_of_the_box() {
    let mut stage = stage_or_skip!();
    let mut scene = furnished(&stage);
    // From so near most of what the balls show is beside the picture.
    scene.camera = Camera::looking(DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0), 1.1, DVec3::Y);
    let size = [128, 96];
    let mut drawn = |pairs: &[(&str, &str)]| {
        let stats = scene.render(&mut stage, &by_screen(pairs), size);
        (vectors::<4>(&stage, Aov::MirrorPosition), stats.reflection.unwrap().unresolved.unwrap_or(0.0))
    };
    let (traced, _) = drawn(&[("reflection.method", "surfel_trace")]);
    let alone = [("screen_trace.rest", "none"), ("splat.close_gaps", "false")];
    let (without, left_without) = drawn(&alone);
    for from in ["points", "picture"] {
        let chosen = [("screen_trace.box_from", from), ("screen_trace.completion", "nearest")];
        let (found, left) = drawn(&[&alone[..], &chosen[..]].concat());
        let (mut on_walls, mut right) = (0, 0);
        for (pixel, [x, y, z, coverage]) in found.iter().enumerate() {
            if without[pixel][3] > 0.0 {
                assert_eq!(found[pixel], without[pixel], "the picture comes first");
            } else if *coverage > 0.0 {
                assert_eq!(*coverage, 0.75, "nothing proves what a wall shows");
                let place = Vec3::new(*x, *y, *z);
                assert!(place.abs().max_element() > 0.98, "{place} is on no wall");
                on_walls += 1;
                let offset = Vec3::from_slice(&traced[pixel][..3]) - place;
                right += usize::from(traced[pixel][3] > 0.0 && offset.length() < 0.1);
            }
        }
        println!("{from}: {on_walls} on walls, {right} as traced, {left_without} and {left} left");
        assert!(on_walls > 200 && right * 5 > on_walls * 4, "{from}: {right} of {on_walls}");
        assert!(left < left_without - 0.1, "{from}: {left_without} and {left}");
    }
}
