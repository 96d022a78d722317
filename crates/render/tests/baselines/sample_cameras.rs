//! Cells of space of sample-based cameras in boxes: what they find, and when they are made anew.

use super::*;

fn by_space(pairs: &[(&str, &str)]) -> Settings {
    let all = [
        ("reflection.method", "sample_cameras"),
        ("sample_cameras.cells", "space"),
        ("sample_cameras.down_sampling", "1"),
        ("splat.close_gaps", "false"),
    ];
    settings(&[&all, pairs].concat())
}

/// A wall before the mirrors, inside the box.
fn screen(x: f64) -> Chunk {
    wall(DVec3::new(x, -0.5, 0.5), [DVec3::X * 0.3, DVec3::Y * 0.6])
}

fn cameras(stats: &FrameStats) -> render::CameraCount {
    stats.reflection.and_then(|found| found.cameras).unwrap()
}

#[test]
fn cells_of_space_show_the_walls_and_say_what_they_do_not_project() {
    let mut stage = stage_or_skip!();
    let mirrors = vec![sphere(DVec3::new(0.45, 0.1, -0.4), RADIUS), sphere(DVec3::new(-0.45, 0.1, -0.4), 0.3)];
    let scene = Scene::new(&stage, room(&[]), mirrors);
    let mut seen = |pairs: &[(&str, &str)]| {
        let stats = scene.render(&mut stage, &by_space(pairs));
        let pixels = pixels(&stage, &scene.camera);
        // The other mirror is seen by its formula.
        let is_wall = |place: DVec3| scene.mirrors.iter().all(|mirror| place.distance(mirror.position) > 0.41);
        let error = |seen: &Seen| {
            let truth = exit(seen.point, seen.reflected).0;
            Some(seen.found.filter(|found| is_wall(*found))?.distance(truth))
        };
        let errors: Vec<f64> = pixels.iter().filter_map(error).collect();
        let found = stats.reflection.unwrap().coverage;
        (median(errors), found, stats.reflection.unwrap())
    };
    let (off, found, stats) = seen(&[]);
    let count = stats.cameras.unwrap();
    assert!(count.pinholes + count.lists > 4 && count.milliseconds > 0.0 && !count.is_late, "{count:?}");
    assert_eq!(stats.regions, Some(count.pinholes + count.lists));
    // The outermost pixels of a ball have no neighbour beyond.
    let left = stats.unresolved.unwrap();
    assert!(off < 0.03 && found > 0.9 && left > 0.02 && left < 0.5, "{off} {found} {stats:?}");
    let (_, alone, stats) = seen(&[("sample_cameras.rest", "none")]);
    assert!(stats.unresolved == Some(left) && alone < found, "{alone} {found} {stats:?}");
    let (_, none, stats) = seen(&[
        ("sample_cameras.rest", "none"),
        ("sample_cameras.longest_list", "4"),
        ("sample_cameras.accuracy", "0.25"),
    ]);
    assert!(stats.unresolved.unwrap() > left && none < alone, "{none} {alone} {stats:?}");
}

#[test]
fn cells_of_space_stay_while_points_move_and_show_what_a_fresh_frame_shows() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::ZERO, RADIUS)]);
    let settings = by_space(&[("sample_cameras.rest", "none")]);
    let made = cameras(&scene.render(&mut stage, &settings));
    let before = bits(&stage);
    add_points(&mut scene.store, vec![screen(-0.9)], Material::default());
    let kept = cameras(&scene.render(&mut stage, &settings));
    assert_eq!(made.milliseconds, kept.milliseconds, "the points have changed, and not the rays");
    let with_screen = bits(&stage);
    assert!(with_screen != before);
    // Trees of other rules drive them out.
    let finer = cameras(&scene.render(&mut stage, &by_space(&[("sample_cameras.accuracy", "0.5")])));
    let new = cameras(&scene.render(&mut stage, &settings));
    assert!(new.milliseconds != made.milliseconds && bits(&stage) == with_screen);
    // Another view and another place of the mirror have trees of their own, too.
    scene.camera = Camera::looking(DVec3::ZERO, DVec3::new(0.0, 0.3, 1.0), 1.1, DVec3::Y);
    let turned = cameras(&scene.render(&mut stage, &settings));
    scene.mirrors[0].position.x += 0.1;
    let moved = cameras(&scene.render(&mut stage, &settings));
    let times = [made, finer, new, turned, moved].map(|count| count.milliseconds);
    assert!((0..4).all(|at| times[at] != times[at + 1]), "{times:?}");
}

#[test]
fn a_frame_that_may_lag_shows_the_cells_of_an_earlier_view_and_says_so() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::ZERO, RADIUS)]);
    let settings = by_space(&[]);
    scene.render(&mut stage, &settings);
    stage.effort.light_may_lag = true;
    scene.camera = Camera::looking(DVec3::ZERO, DVec3::new(0.0, 0.3, 1.0), 1.1, DVec3::Y);
    let late = cameras(&scene.render(&mut stage, &settings));
    assert!(late.is_late, "{late:?}");
    let mut now = late;
    for _ in 0..2000 {
        if !now.is_late {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
        now = cameras(&scene.render(&mut stage, &settings));
    }
    assert!(!now.is_late);
    let caught_up = bits(&stage);
    stage.effort.light_may_lag = false;
    stage.renderer.forget();
    scene.render(&mut stage, &settings);
    assert!(bits(&stage) == caught_up, "as at once");
}

/// A disc that faces the origin.
fn disc_at(place: DVec3) -> Chunk {
    let mut chunk = Chunk::new(0, DVec3::ZERO, vec![place.as_vec3().to_array()]);
    chunk.colors = Some(Arc::new(vec![[255; 4]]));
    chunk.normals = Some(Arc::new(vec![cloud::pack_normal(-place.normalize().as_vec3())]));
    chunk.radii = Some(Arc::new(vec![cloud::pack_radius(0.04)]));
    chunk
}

/// Light takes the same way in both directions, so the mirror point of two places does not say which is the eye.
#[test]
fn an_eye_sees_a_point_where_the_point_would_see_the_eye() {
    const LARGE: [u32; 2] = [160, 120];
    let mut stage = stage_or_skip!();
    // The corners of the room keep the box about all points as it is.
    let corners: Vec<Chunk> = (0..8)
        .map(|corner| {
            disc_at(DVec3::from([0, 1, 2].map(|axis| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 })) * 1.2)
        })
        .collect();
    let mut seen = |eye: DVec3, point: DVec3, pairs: &[(&str, &str)]| {
        let store = store_of(&stage, [corners.clone(), vec![disc_at(point)]].concat(), Material::default());
        let mirrors = [sphere(DVec3::ZERO, RADIUS)];
        let camera = Camera::looking(DVec3::ZERO, eye, eye.length(), DVec3::Y);
        let all = [
            ("reflection.method", "sample_cameras"),
            ("sample_cameras.rest", "none"),
            ("sample_cameras.points_per_pixel", "0"),
            // A point alone would be seen all around.
            ("sscr.pull_levels", "0"),
        ];
        let objects = Objects { mirrors: &mirrors, ..Objects::default() };
        stage
            .renderer
            .render(&store, &Frame::new(&camera, &settings(&[&all, pairs].concat()), objects, LARGE))
            .unwrap();
        let places = pixels(&stage, &camera);
        let places = places.iter().filter(|seen| seen.found.is_some_and(|found| found.distance(point) < 0.06));
        let (sum, count) = places.fold((DVec3::ZERO, 0), |(sum, count), seen| (sum + seen.point, count + 1));
        assert!(count > 0, "{eye} does not see {point} with {pairs:?}");
        sum / f64::from(count)
    };
    for pairs in [
        &[][..],
        &[("sample_cameras.analytic", "false")],
        &[("sample_cameras.cells", "space"), ("sample_cameras.down_sampling", "1")],
    ] {
        for (eye, point) in [
            (DVec3::new(0.1, 0.2, 1.1), DVec3::new(0.9, -0.5, 0.3)),
            (DVec3::new(-0.8, 0.3, 0.6), DVec3::new(0.4, 0.7, 0.9)),
            (DVec3::new(0.2, -0.6, 0.9), DVec3::new(-0.9, 0.4, 0.1)),
        ] {
            let (there, back) = (seen(eye, point, pairs), seen(point, eye, pairs));
            // A pixel is a hundredth of the room wide on the ball.
            assert!(there.distance(back) < 0.015, "{pairs:?}: {there} and {back}");
        }
    }
}

/// The ray of a pixel is the same from every place on it, and so is what it meets.
#[test]
fn an_eye_that_moves_along_a_line_of_sight_sees_the_same_there() {
    let mut stage = stage_or_skip!();
    let by_cameras =
        [("reflection.method", "sample_cameras"), ("sample_cameras.rest", "none"), ("sscr.pull_levels", "0")];
    let formula = by_cameras.to_vec();
    let squares = [&by_cameras[..], &[("sample_cameras.analytic", "false")]].concat();
    let space = [&by_cameras[..], &[("sample_cameras.cells", "space"), ("sample_cameras.down_sampling", "1")]].concat();
    let maps = vec![
        ("reflection.method", "light_field"),
        ("light_field.size", "64"),
        ("light_field.samples", "8"),
        ("light_field.rest", "none"),
    ];
    let bowl = Shape::Paraboloid { focal_length: 0.2 };
    for (shape, position, size, methods) in [
        (Shape::Sphere, DVec3::ZERO, RADIUS, vec![&squares, &space, &maps]),
        (Shape::Plane { height: 1.0 }, DVec3::ZERO, RADIUS, vec![&formula]),
        (bowl, DVec3::new(0.0, 0.0, -0.3), 0.5, vec![&squares]),
        (Shape::Blob, DVec3::ZERO, RADIUS, vec![&squares]),
    ] {
        let mirror = Mirror { position, ..Mirror::standing(shape, DVec3::ZERO, DVec3::Z, DVec3::Y, size) };
        let mut scene = Scene::new(&stage, room(&[]), vec![mirror]);
        let shape = scene.mirrors[0].shape.name();
        for pairs in methods {
            let settings = settings(&[&pairs[..], &[("splat.close_gaps", "false")]].concat());
            scene.camera = front_camera();
            scene.render(&mut stage, &settings);
            let before = pixels(&stage, &scene.camera);
            let mut apart = Vec::new();
            // Pixels all over the mirror.
            for chosen in (1..5).map(|part| &before[before.len() * part / 5]) {
                let Some(found) = chosen.found else { continue };
                let camera = front_camera();
                let step = (chosen.point - camera.eye) * 0.2;
                scene.camera = Camera { eye: camera.eye + step, pivot: camera.pivot + step, ..camera };
                scene.render(&mut stage, &settings);
                let after = pixels(&stage, &scene.camera);
                let same = after.iter().find(|seen| seen.pixel == chosen.pixel).unwrap();
                assert!(same.point.distance(chosen.point) < 1e-3, "{shape}: the same mirror point");
                apart.extend(same.found.map(|other| other.distance(found)));
            }
            assert!(apart.len() >= 2, "{shape}, {pairs:?}: {apart:?}");
            assert!(median(apart.clone()) < 1e-3, "{shape}, {pairs:?}: {apart:?}");
        }
    }
}

/// Light on what is mirrored is that towards the mirror point, not towards the camera: a ball's highlight in a mirror is
/// elsewhere on the ball than the highlight that the camera sees.
#[test]
fn the_highlight_of_a_mirrored_ball_is_that_towards_the_mirror() {
    const LARGE: [u32; 2] = [320, 240];
    let mut stage = stage_or_skip!();
    let (middle, radius) = (DVec3::ZERO, 0.3);
    let mut store = PointStore::new(stage.gpu.clone());
    let mut ball = sphere(middle, radius).sample(60_000, 1);
    for chunk in &mut ball {
        chunk.colors = Some(Arc::new(vec![[20, 20, 20, 255]; chunk.len()]));
    }
    add_points(&mut store, ball, Material::default());
    let plane = DVec3::new(-0.9, 0.0, 0.4);
    let mirror = Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::ZERO, DVec3::X, DVec3::Y, 1.0);
    let mirrors = [Mirror { position: plane, ..mirror }];
    let lamp = scene::SpotLight {
        position: DVec3::new(0.9, 1.2, 1.0),
        target: middle,
        intensity: [4.0; 3],
        inner_degrees: 40.0,
        outer_degrees: 50.0,
    };
    let eye = DVec3::new(0.2, 0.1, 2.0);
    let camera = Camera { eye, pivot: DVec3::new(-0.5, 0.0, 0.6), up: DVec3::Y };
    // Where the normal halves the angle between lamp and eye.
    let highlight = |eye: DVec3| {
        let halved = |place: DVec3| (lamp.position - place).normalize() + (eye - place).normalize();
        (0..50).fold(middle + DVec3::Z * radius, |place, _| middle + radius * halved(place).normalize())
    };
    // From a mirror point light comes as towards the mirrored eye.
    let mirrored = eye - DVec3::X * (2.0 * (eye - plane).x);
    let expected = [highlight(eye), highlight(mirrored)];
    assert!(expected[0].distance(expected[1]) > 0.1, "{expected:?}");
    for pairs in [
        &[("reflection.method", "sample_cameras"), ("sample_cameras.rest", "none")][..],
        &[("reflection.method", "sample_cameras"), ("sample_cameras.rest", "none"), ("sample_cameras.cells", "space")],
        &[("reflection.method", "surfel_trace")],
    ] {
        let all = [("light.gloss", "0.5"), ("light.gloss_power", "300"), ("gi.bounces", "0"), ("light.by", "lights")];
        let settings = settings(&[&all, pairs].concat());
        let objects = Objects { mirrors: &mirrors, lights: &[lamp], ..Objects::default() };
        stage.renderer.render(&store, &Frame::new(&camera, &settings, objects, LARGE)).unwrap();
        let read = |aov| stage.renderer.read_aov(aov).unwrap().data;
        let [mask, color, own, seen] = [Aov::Mirror, Aov::Color, Aov::Position, Aov::MirrorPosition].map(read);
        let brightest = |is_mirror: bool| {
            let pixels =
                (0..mask.len()).filter(|pixel| (mask[*pixel] > 0.0) == is_mirror && !color[3 * pixel].is_nan());
            let pixel = pixels.max_by(|a, b| color[3 * a].total_cmp(&color[3 * b])).unwrap();
            let place = if is_mirror { &seen[4 * pixel..] } else { &own[3 * pixel..] };
            assert!(color[3 * pixel] > 0.5, "a highlight, not {}", color[3 * pixel]);
            Vec3::from_slice(place).as_dvec3()
        };
        for (found, expected) in [false, true].map(brightest).iter().zip(expected) {
            assert!(found.distance(expected) < 0.03, "{pairs:?}: {found}, expected {expected}");
        }
    }
}
