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
    stage.renderer.let_light_lag(true);
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
    stage.renderer.let_light_lag(false);
    stage.renderer.forget();
    scene.render(&mut stage, &settings);
    assert!(bits(&stage) == caught_up, "as at once");
}
