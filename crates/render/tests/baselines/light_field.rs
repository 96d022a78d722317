//! Light fields in boxes, where closed forms say what rays meet.

use render::{Error, MapLimit};

use super::*;

fn by_field(pairs: &[(&str, &str)]) -> Settings {
    let all = [("reflection.method", "light_field"), ("light_field.size", "64"), ("splat.close_gaps", "false")];
    settings(&[&all, pairs].concat())
}

/// How far what is seen lies from what rays meet in an empty box; and the number of pixels that see nothing.
fn errors(stage: &Stage, scene: &Scene) -> (Vec<f64>, usize) {
    let pixels = pixels(stage, &scene.camera);
    let error = |seen: &Seen| Some(seen.found?.distance(exit(seen.point, seen.reflected).0));
    let errors: Vec<f64> = pixels.iter().filter_map(error).collect();
    let open = pixels.len() - errors.len();
    (errors, open)
}

#[test]
fn a_corrected_look_up_is_exact_on_walls_and_a_plain_one_is_not() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::new(0.3, 0.1, -0.4), RADIUS)]);
    let mut seen = |pairs: &[(&str, &str)]| {
        let stats = scene.render(&mut stage, &by_field(&[&[("light_field.rest", "none")], pairs].concat()));
        (errors(&stage, &scene), stats.reflection.unwrap())
    };
    let ((plain, open), found) = seen(&[("light_field.samples", "16"), ("light_field.corrections", "0")]);
    assert!(plain.len() > 300 && open == 0 && found.unresolved == Some(0.0), "{} {open} {found:?}", plain.len());
    // From nearer places less is off.
    let ((finer, _), _) = seen(&[("light_field.samples", "200"), ("light_field.corrections", "0")]);
    let [coarse, fine] = [plain, finer].map(median);
    assert!(coarse > 0.03 && fine < 0.5 * coarse, "{coarse}, {fine}");
    for (corrections, most) in [("1", 12), ("2", 40)] {
        for rule in ["nearest", "angle", "ray"] {
            let pairs =
                [("light_field.samples", "16"), ("light_field.corrections", corrections), ("light_field.rule", rule)];
            let ((errors, open), found) = seen(&pairs);
            // Beside the edges of the room two look-ups may meet two walls.
            let off = errors.iter().filter(|error| **error > 0.003).count();
            let what = format!("{corrections} {rule}: {off} of {} are off, {open} open, {found:?}", errors.len());
            assert!(off * most < errors.len() && open * 100 < errors.len(), "{what}");
            assert!(found.unresolved.unwrap() < 0.08, "{what}");
        }
    }
}

#[test]
fn few_samples_with_a_correction_are_better_than_many_without() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::new(0.2, 0.1, -0.3), RADIUS)]);
    let mut of = |samples, corrections| {
        let pairs = [("light_field.samples", samples), ("light_field.corrections", corrections)];
        scene.render(
            &mut stage,
            &by_field(&[("light_field.memory", "1GiB")].into_iter().chain(pairs).collect::<Vec<_>>()),
        );
        let (mut errors, open) = errors(&stage, &scene);
        errors.sort_by(f64::total_cmp);
        assert!(errors.len() > 300 && open * 100 < errors.len(), "{samples}: {open} of {} are open", errors.len());
        [errors[errors.len() / 2], errors[errors.len() * 95 / 100]]
    };
    let [few, many] = [of("32", "1"), of("512", "0")];
    assert!(few[0] <= many[0] && few[1] < 0.1 * many[1], "{few:?}, {many:?}");
}

/// The root of the mean square error of grey levels, and the 99th percentile of how much that error changes from a
/// mirror pixel to the next, in a room whose walls have a smooth pattern.
fn grey_errors(stage: &Stage, scene: &Scene) -> [f64; 2] {
    let colors = stage.renderer.read_aov(Aov::Color).unwrap().data;
    let pixels = pixels(stage, &scene.camera);
    let grey = |linear: f32| 255.0 * (1.055 * f64::from(linear).max(0.0).powf(1.0 / 2.4) - 0.055);
    let error = |seen: &Seen| grey(colors[seen.pixel * 3]) - f64::from(pattern(exit(seen.point, seen.reflected).0));
    let errors: std::collections::HashMap<usize, f64> = pixels.iter().map(|seen| (seen.pixel, error(seen))).collect();
    let squares = errors.values().map(|error| error * error).sum::<f64>();
    let (errors, width) = (&errors, SIZE[0] as usize);
    let steps = errors.iter().flat_map(|(pixel, error)| {
        [pixel + 1, pixel + width].into_iter().filter_map(move |next| Some((errors.get(&next)? - error).abs()))
    });
    let mut steps: Vec<f64> = steps.collect();
    steps.sort_by(f64::total_cmp);
    [(squares / errors.len() as f64).sqrt(), steps[steps.len() * 99 / 100]]
}

/// The grey of a place of a wall: waves a third of the room long.
fn pattern(place: DVec3) -> u8 {
    let waves = (place * 9.0).to_array().map(f64::sin);
    (128.0 + 100.0 * (waves[0] + waves[1] + waves[2]) / 3.0) as u8
}

/// As in the thesis, the nearest sample errs less than a blend about the reflected ray, and that less than the sample in
/// the ray's direction; and a blend about the normal changes least from pixel to pixel. Unlike there, blends about the
/// normal also err less than the nearest sample: this pattern is smooth, so that the errors of samples on opposite sides
/// of a ray cancel, which those of sharp edges do not.
#[test]
fn the_nearest_sample_errs_less_than_those_by_angle_and_blends_about_the_normal_are_smoothest() {
    let mut stage = stage_or_skip!();
    let mut walls = room(&[]);
    for wall in &mut walls {
        let origin = wall.origin;
        let grey = |point: &[f32; 3]| {
            let grey = pattern(origin + Vec3::from(*point).as_dvec3());
            [grey, grey, grey, 255]
        };
        wall.colors = Some(Arc::new(wall.positions.iter().map(grey).collect()));
    }
    let scene = Scene::new(&stage, walls, vec![sphere(DVec3::new(0.2, 0.1, -0.3), RADIUS)]);
    let mut of = |rule: &str, exponent: &str| {
        let pairs = [
            ("light_field.rule", rule),
            ("light_field.exponent", exponent),
            ("light_field.samples", "64"),
            ("light_field.corrections", "0"),
            ("light_field.visible_by", "angle"),
            ("light_field.offset", "0.1"),
            ("light.by", "colors"),
            ("gi.bounces", "0"),
        ];
        scene.render(&mut stage, &by_field(&pairs));
        grey_errors(&stage, &scene)
    };
    let rules = [
        ("nearest", "4"),
        ("angle", "4"),
        ("mean", "4"),
        ("reflection", "4"),
        ("normal", "1"),
        ("normal", "4"),
        ("normal", "16"),
        ("smooth", "4"),
    ];
    let found = rules.map(|(rule, exponent)| of(rule, exponent));
    let [nearest, angle, mean, reflection, first, fourth, last, smooth] = found;
    assert!(nearest[0] < reflection[0] && reflection[0] < angle[0], "{found:?}");
    assert!([first, fourth, smooth].iter().all(|blend| blend[0] < nearest[0]), "{found:?}");
    let others = [nearest, angle, mean, reflection, last];
    assert!([first, fourth, smooth].iter().all(|blend| others.iter().all(|other| blend[1] < other[1])), "{found:?}");
}

#[test]
fn what_samples_do_not_resolve_is_traced_or_open_or_from_the_mirrors_middle() {
    let mut stage = stage_or_skip!();
    let mirrors = vec![sphere(DVec3::new(0.3, 0.0, -0.2), RADIUS), sphere(DVec3::new(-0.5, 0.3, 0.1), RADIUS)];
    let scene = Scene::new(&stage, room(&[]), mirrors);
    let mut found = |pairs: &[(&str, &str)]| {
        let stats = scene.render(&mut stage, &by_field(pairs));
        (pixels(&stage, &scene.camera), stats.reflection.unwrap())
    };
    let (truth, _) = found(&[("reflection.method", "surfel_trace")]);
    let (traced, stats) = found(&[]);
    let is_alike = |(a, b): &(&Seen, &Seen)| match (a.found, b.found) {
        (Some(a), Some(b)) => a.distance(b) < 0.02,
        (a, b) => a.is_some() == b.is_some(),
    };
    let alike = traced.iter().zip(&truth).filter(is_alike).count();
    assert!(truth.len() > 1000 && alike * 100 >= truth.len() * 97, "{alike} of {}", truth.len());
    assert!(stats.unresolved.is_some_and(|share| share < 0.02), "{stats:?}");
    // No sample is above a horizon of 45 degrees.
    let hidden = [("light_field.visible_by", "angle"), ("light_field.horizon", "45"), ("light_field.samples", "2")];
    let with_rest = |rest| [&hidden[..], &[("light_field.rest", rest)]].concat();
    let (open, stats) = found(&with_rest("none"));
    let unresolved = stats.unresolved.unwrap();
    assert!(unresolved > 0.9, "{unresolved}");
    let is_of_other = |seen: &&Seen| seen.found.is_some_and(|found| (found.abs() - HALF).abs().min_element() < 0.01);
    assert!(open.iter().filter(is_of_other).count() * 10 < open.len());
    let (mapped, _) = found(&with_rest("environment_map"));
    let (of_middle, _) = found(&[("reflection.method", "environment_map")]);
    let same = mapped.iter().zip(&of_middle).filter(is_alike).count();
    assert!(same * 10 > mapped.len() * 9, "{same} of {}", mapped.len());
    let (traced, _) = found(&with_rest("surfel_trace"));
    let alike = traced.iter().zip(&truth).filter(is_alike).count();
    assert!(alike * 100 >= truth.len() * 99, "{alike} of {}", truth.len());
}

#[test]
fn mirrors_see_themselves_if_they_are_hollow_and_others_always() {
    let mut stage = stage_or_skip!();
    let bowl = Shape::Paraboloid { focal_length: 0.1 };
    let mut scene = Scene::new(&stage, room(&[]), Vec::new());
    let bowl =
        Mirror { position: DVec3::new(0.0, 0.0, -0.4), ..Mirror::standing(bowl, DVec3::ZERO, DVec3::Z, DVec3::Y, 0.5) };
    add_points(&mut scene.store, bowl.sample(20_000, 1), MIRROR);
    let of_bowl = |own: &str| {
        scene.render(&mut stage, &by_field(&[("light_field.rest", "none"), ("light_field.own", own)]));
        let is_own = |seen: &&Seen| seen.found.is_some_and(|found| (found.abs() - HALF).abs().min_element() > 0.05);
        pixels(&stage, &scene.camera).iter().filter(is_own).count()
    };
    let [traced, left_out, drawn] = ["auto", "left_out", "drawn"].map(of_bowl);
    assert!(traced > 20 && left_out < traced / 4 && drawn * 3 > traced, "{traced}, {left_out}, {drawn}");
}

#[test]
fn maps_are_drawn_for_the_pixels_that_need_them_and_kept_within_the_memory() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, room(&[2]), vec![sphere(DVec3::ZERO, RADIUS)]);
    scene.camera = Camera::looking(DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0), 0.75, DVec3::Y);
    let counted = |stats: &FrameStats| stats.reflection.and_then(|found| found.maps).unwrap();
    // A map of 64 texels takes 6 x 64 x 64 x 16 bytes, so that 42 fit.
    for (memory, most) in [("16 MiB", 42), ("256 MiB", 300)] {
        let settings = by_field(&[("light_field.samples", "300"), ("light_field.memory", memory)]);
        stage.renderer.forget();
        let before = scene.render(&mut stage, &by_field(&[("reflection.method", "surfel_trace")])).gpu_bytes;
        for turn in 0..3 {
            scene.camera.orbit(0.7, 0.3);
            let stats = scene.render(&mut stage, &settings);
            let maps = counted(&stats);
            let used = stats.reflection.and_then(|found| found.map_use).unwrap();
            assert!(used.bytes <= settings.light_field.memory.0 && used.bytes > 0, "{used:?}");
            assert_eq!(used.limit, (maps.asked > most).then_some(MapLimit::Memory), "{maps:?}");
            assert!(turn > 0 || used.kept == 0 && used.missed == 1.0 && used.new == maps.drawn, "{used:?}");
            assert!(turn == 0 || used.kept > 0 && used.missed < 1.0 && used.new <= maps.drawn, "{used:?}");
            // A place beside the camera needs the same maps, unless they did not all fit.
            let mut beside = scene.camera;
            beside.orbit(1e-4, 0.0);
            std::mem::swap(&mut scene.camera, &mut beside);
            let again = scene.render(&mut stage, &settings).reflection.and_then(|found| found.map_use).unwrap();
            std::mem::swap(&mut scene.camera, &mut beside);
            assert!((again.missed < 0.01) == (maps.asked <= most), "{memory}: {again:?}, {maps:?}");
            let stats = scene.render(&mut stage, &settings);
            assert!(maps.asked > 45 && maps.asked < 290 && maps.drawn == maps.asked.min(most), "{memory}: {maps:?}");
            // The index of so many samples takes 2 MiB.
            assert!(memory != "16 MiB" || stats.gpu_bytes - before < (19 << 20), "{} - {before}", stats.gpu_bytes);
            let wandered = bits(&stage);
            // What has gone before makes no difference, though the maps are elsewhere.
            stage.renderer.forget();
            let anew = scene.render(&mut stage, &settings);
            assert!(bits(&stage) == wandered && counted(&anew) == maps, "{memory}");
            // What no map shows is traced.
            let (_, open) = errors(&stage, &scene);
            scene.render(&mut stage, &by_field(&[("reflection.method", "surfel_trace")]));
            let (_, truly_open) = errors(&stage, &scene);
            assert!(open <= truly_open + 20, "{memory}: {open}, {truly_open}");
        }
    }
    // Whether maps fit or not, the picture is the same, once all else is traced.
    let mut with_memory = |memory: &str| {
        stage.renderer.forget();
        scene.render(&mut stage, &by_field(&[("light_field.samples", "300"), ("light_field.memory", memory)]));
        pixels(&stage, &scene.camera)
    };
    let (few, all) = (with_memory("16 MiB"), with_memory("256 MiB"));
    let is_alike = |(few, all): &(&Seen, &Seen)| match (few.found, all.found) {
        (Some(few), Some(all)) => few.distance(all) < 0.01,
        (few, all) => few.is_some() == all.is_some(),
    };
    let alike = few.iter().zip(&all).filter(is_alike).count();
    assert!(alike * 100 >= few.len() * 97, "{alike} of {}", few.len());
    let too_large = by_field(&[("light_field.size", "512"), ("light_field.memory", "16 MiB")]);
    let objects = Objects { mirrors: &scene.mirrors, ..Objects::default() };
    let refused =
        stage.renderer.render(&scene.store, &Frame::new(&scene.camera, &too_large, objects, SIZE)).unwrap_err();
    assert!(matches!(refused, Error::TooLarge { .. }), "{refused}");
    assert!(refused.to_string().contains("light_field.memory allows; lower light_field.size"), "{refused}");
}

#[test]
fn maps_that_may_lag_are_drawn_a_few_a_frame_and_end_as_those_drawn_at_once() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::ZERO, RADIUS)]);
    let settings =
        by_field(&[("light_field.maps_per_frame", "3"), ("light_field.neighbours", "1"), ("light_field.rest", "none")]);
    let maps = |stats: FrameStats| stats.reflection.and_then(|found| found.maps).unwrap();
    stage.renderer.forget();
    stage.effort.light_may_lag = true;
    let first = maps(scene.render(&mut stage, &settings));
    assert!(first.drawn == 3 && first.asked > 6, "{first:?}");
    let (seen, open) = errors(&stage, &scene);
    assert!(open > 100 && seen.len() > 30, "{open} are open, {} not", seen.len());
    for frame in 2..=first.asked.div_ceil(3) {
        let now = maps(scene.render(&mut stage, &settings));
        assert_eq!(now.drawn, now.asked.min(3 * frame));
    }
    assert!(!draws_maps(&scene.render(&mut stage, &settings)), "all stand");
    let caught_up = bits(&stage);
    stage.effort.light_may_lag = false;
    stage.renderer.forget();
    scene.render(&mut stage, &settings);
    assert!(bits(&stage) == caught_up, "as at once");

    // Points that come: old maps are used until they are drawn anew, and a picture that stays has none.
    let before = errors(&stage, &scene).1;
    stage.effort.light_may_lag = true;
    let screen = wall(DVec3::new(-0.9, -0.5, 0.9), [DVec3::X * 0.5, DVec3::Y * 1.1]);
    add_points(&mut scene.store, vec![screen], Material::default());
    let mut one = settings.clone();
    one.light_field.maps_per_frame = 1;
    let stats = scene.render(&mut stage, &one);
    assert!(maps(stats).drawn == 1 && errors(&stage, &scene).1 <= before + 5);
    let lagging = bits(&stage);
    stage.effort.light_may_lag = false;
    scene.render(&mut stage, &settings);
    let settled = bits(&stage);
    stage.renderer.forget();
    scene.render(&mut stage, &settings);
    assert!(bits(&stage) == settled, "settled");
    assert!(settled != lagging, "some maps were old");
}

#[test]
fn light_fields_of_odd_mirrors_give_finite_pictures() {
    let mut stage = stage_or_skip!();
    let mut odd = room(&[2]);
    odd.push(Chunk::new(0, DVec3::ZERO, vec![[f32::NAN; 3], [f32::INFINITY, 0.0, 0.0], [0.0, -1e38, 0.0]]));
    for mirrors in [vec![sphere(DVec3::ZERO, RADIUS), sphere(DVec3::new(0.6, 0.0, 0.0), 1e-9)], Vec::new()] {
        for (samples, neighbours, corrections) in [("1", "8", "4"), ("40", "1", "0"), ("7", "8", "1")] {
            let scene = Scene::new(&stage, odd.clone(), mirrors.clone());
            scene.render(
                &mut stage,
                &by_field(&[
                    ("light_field.samples", samples),
                    ("light_field.neighbours", neighbours),
                    ("light_field.corrections", corrections),
                    ("light_field.size", "33"),
                ]),
            );
            let seen = pixels(&stage, &scene.camera);
            let filled = seen.iter().filter(|seen| seen.found.is_some()).count();
            assert!(mirrors.is_empty() || filled > 200, "{samples}: {filled} of {}", seen.len());
            assert!(seen.iter().filter_map(|seen| seen.found).all(|found| found.is_finite()), "{samples}");
        }
    }
}

/// As seen from a mirror so small all its places are one: wherever samples stand, and however they are chosen, what a
/// direction shows is what it shows from the mirror's middle.
#[test]
fn before_far_walls_every_rule_shows_what_an_environment_map_shows() {
    let mut stage = stage_or_skip!();
    let middle = DVec3::new(0.3, 0.1, -0.4);
    let tiny = 1e-4;
    let mut scene = Scene::new(&stage, room(&[]), vec![sphere(middle, tiny)]);
    scene.camera = Camera::looking(middle, DVec3::new(0.1, 0.2, 1.0), 2.75 * tiny, DVec3::Y);
    let texel = TEXEL * 2.0;
    scene.render(&mut stage, &by_map(&[("environment_map.size", "64"), ("splat.close_gaps", "false")]));
    let by_map = pixels(&stage, &scene.camera);
    assert!(by_map.len() > 500, "{}", by_map.len());
    // All samples are on the mirror point, so that they see what its ray meets.
    scene.render(&mut stage, &by_field(&[("reflection.method", "surfel_trace")]));
    let traced = pixels(&stage, &scene.camera);
    for (rule, exponent, corrections, offset, samples, visible_by) in [
        ("nearest", "4", "0", "0.01", "1", "depth"),
        ("nearest", "4", "1", "0.01", "12", "depth"),
        ("angle", "4", "0", "0.01", "12", "depth"),
        ("ray", "4", "2", "0.01", "12", "depth"),
        ("mean", "4", "0", "0.01", "12", "depth"),
        ("reflection", "0", "0", "0.01", "12", "depth"),
        ("reflection", "64", "0", "0.25", "12", "angle"),
        ("normal", "16", "1", "0.25", "12", "depth"),
        ("smooth", "4", "0", "0.25", "12", "depth"),
        ("nearest", "4", "0", "0.0005", "12", "depth"),
    ] {
        let pairs = [
            ("light_field.rule", rule),
            ("light_field.exponent", exponent),
            ("light_field.corrections", corrections),
            ("light_field.offset", offset),
            ("light_field.samples", samples),
            ("light_field.visible_by", visible_by),
            ("light_field.rest", "none"),
        ];
        scene.render(&mut stage, &by_field(&pairs));
        let by_field = pixels(&stage, &scene.camera);
        let (mut off, mut compared) = (0, 0);
        for ((field, map), traced) in by_field.iter().zip(&by_map).zip(&traced) {
            assert!(field.pixel == map.pixel && field.pixel == traced.pixel);
            // Samples below the horizon answer nothing where angles decide.
            let Some(((found, of_map), traced)) = field.found.zip(map.found).zip(traced.found) else { continue };
            compared += 1;
            let others = [of_map, traced, exit(field.point, field.reflected).0];
            off += usize::from(others.iter().any(|other| found.distance(*other) > texel));
        }
        let least = if visible_by == "angle" { by_map.len() / 3 } else { by_map.len() * 99 / 100 };
        assert!(compared >= least && off == 0, "{pairs:?}: {off} of {compared} are off, of {}", by_map.len());
    }
}

/// In an empty box one corrected sample finds what the box does, and what no sample answers is left to the box itself.
#[test]
fn in_an_empty_box_one_sample_shows_what_the_box_of_an_environment_map_shows() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::new(0.3, 0.1, -0.4), RADIUS)]);
    let with_box = [("environment_map.size", "128"), ("environment_map.proxy", "box")];
    scene.render(&mut stage, &by_map(&[&with_box[..], &[("splat.close_gaps", "false")]].concat()));
    let by_box = pixels(&stage, &scene.camera);
    let mut alike = |pairs: &[(&str, &str)], most: f64| {
        let all = [("light_field.samples", "1"), ("light_field.size", "128"), ("light_field.rest", "environment_map")];
        let stats = scene.render(&mut stage, &by_field(&[&with_box[..], &all, pairs].concat()));
        let found = pixels(&stage, &scene.camera);
        let is_near = |(field, by_box): &(&Seen, &Seen)| {
            field.found.zip(by_box.found).is_some_and(|(field, by_box)| field.distance(by_box) < most)
        };
        let alike = found.iter().zip(&by_box).filter(is_near).count();
        (alike as f64 / by_box.len() as f64, stats.reflection.unwrap().unresolved.unwrap())
    };
    let (by_sample, unresolved) = alike(&[], 0.01);
    assert!(by_sample > 0.95 && unresolved < 0.1, "{by_sample} alike, {unresolved} left");
    let hidden = [("light_field.visible_by", "angle"), ("light_field.horizon", "45")];
    let (by_rest, unresolved) = alike(&hidden, 1e-5);
    assert!(by_rest > 0.9 && unresolved > 0.9, "{by_rest} alike, {unresolved} left");
    // Without corrections, one sample beside the middle is no box.
    let (plain, _) = alike(&[("light_field.corrections", "0")], 0.01);
    assert!(plain < 0.5, "{plain}");
}

/// The errors of what is found in pixels, by the angle by which the reflected direction changes to the next pixel, of the
/// pixels that have neighbours on both axes.
fn pixel_errors(stage: &Stage, scene: &Scene) -> Vec<f64> {
    let pixels = pixels(stage, &scene.camera);
    let reflected: std::collections::HashMap<usize, DVec3> =
        pixels.iter().map(|seen| (seen.pixel, seen.reflected)).collect();
    let width = SIZE[0] as usize;
    let error = |seen: &Seen| {
        let change = |other: usize| reflected.get(&other).map(|other| seen.reflected.angle_between(*other));
        let smaller = |a: Option<f64>, b: Option<f64>| Some(a.unwrap_or(f64::MAX).min(b?));
        let sideways = smaller(change(seen.pixel.wrapping_sub(1)), change(seen.pixel + 1))?;
        let upright = smaller(change(seen.pixel.wrapping_sub(width)), change(seen.pixel + width))?;
        Some((seen.found? - seen.point).angle_between(seen.reflected) / sideways.max(upright))
    };
    pixels.iter().filter_map(error).collect()
}

/// Nothing is corrected, so that what is off is off by the distance of samples: the prediction, and by closed form.
#[test]
fn samples_are_added_until_few_pixels_are_predicted_to_be_off_and_few_are() {
    let mut stage = stage_or_skip!();
    let plain = [("light_field.corrections", "0"), ("light_field.rest", "none"), ("light_field.memory", "1GiB")];
    let told = |stage: &mut Stage, scene: &Scene, accuracy: &str, samples: &str| {
        let pairs = [("light_field.accuracy", accuracy), ("light_field.samples", samples)];
        let found = scene.render(stage, &by_field(&[&plain[..], &pairs].concat())).reflection.unwrap();
        let errors = pixel_errors(stage, scene);
        assert!(errors.len() > 300, "{}", errors.len());
        let most: f64 = accuracy.parse().unwrap();
        let off = errors.iter().filter(|error| **error > most).count() as f64 / errors.len() as f64;
        (found.maps.unwrap(), found.map_use.unwrap(), off)
    };
    let scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::new(0.2, 0.1, -0.3), RADIUS)]);
    // The finer the picture is to be, the more maps it takes, and what is predicted is what is.
    let mut maps = Vec::new();
    for accuracy in ["4", "2", "1", "0.5"] {
        let (count, used, off) = told(&mut stage, &scene, accuracy, "256");
        let predicted = used.off.unwrap();
        assert!(predicted <= 0.05 && count.drawn == count.asked, "{accuracy}: {used:?}");
        // What is shown is the place of a disc that is nearest to the ray, which is less off than its middle.
        assert!(off < predicted + 0.02 && predicted < 2.5 * off + 0.03, "{accuracy}: {predicted} predicted, {off}");
        maps.push(count.drawn);
    }
    assert!(maps.windows(2).all(|pair| pair[0] < pair[1]) && maps[3] < 200, "{maps:?}");
    // With fewer places than it takes all have maps, and the more there are, the less is off.
    let mut shares = Vec::new();
    for samples in ["1", "4", "16", "64"] {
        let (_, used, off) = told(&mut stage, &scene, "0.5", samples);
        let predicted = used.off.unwrap();
        assert!(off < predicted + 0.02 && predicted < 2.5 * off + 0.03, "{samples}: {predicted} predicted, {off}");
        shares.push(predicted);
    }
    assert!(shares.windows(2).all(|pair| pair[0] > pair[1]) && shares[3] > 0.05, "{shares:?}");
    let (count, used, _) = told(&mut stage, &scene, "0", "64");
    assert!(count.asked > 30 && used.off.is_none(), "{count:?}, {used:?}");
    // Of a small mirror, from which all is far, one map shows all.
    let middle = DVec3::new(0.2, 0.1, -0.3);
    let mut small = Scene::new(&stage, room(&[]), vec![sphere(middle, 0.01)]);
    small.camera = Camera::looking(middle, DVec3::new(0.1, 0.2, 1.0), 0.0275, DVec3::Y);
    let (count, _, off) = told(&mut stage, &small, "1", "256");
    assert!(count.asked == 1 && off < 0.05, "{count:?}, {off}");
}

/// With a correction it is what the nearest sample does not resolve that counts.
#[test]
fn corrected_look_ups_need_few_samples_in_a_box_and_more_among_things() {
    let mut stage = stage_or_skip!();
    let mirror = || vec![sphere(DVec3::new(0.2, 0.1, -0.3), RADIUS)];
    let maps = |stage: &mut Stage, scene: &Scene, accuracy: &str| {
        let pairs = [("light_field.accuracy", accuracy), ("light_field.samples", "128"), ("light_field.rest", "none")];
        let found = scene.render(stage, &by_field(&pairs)).reflection.unwrap();
        (found.maps.unwrap().drawn, found.map_use.unwrap().off, median(errors(stage, scene).0))
    };
    let empty = Scene::new(&stage, room(&[]), mirror());
    let (few, off, error) = maps(&mut stage, &empty, "1");
    let (all, ..) = maps(&mut stage, &empty, "0");
    assert!(few < 8 && all > 60 && off.unwrap() <= 0.05 && error < 0.003, "{few} of {all}, {off:?}, {error}");
    // Strips of wall stand about the mirror.
    let mut walls = room(&[]);
    for strip in 0..8 {
        let (sin, cos) = (f64::from(strip) * 0.785).sin_cos();
        let corner = DVec3::new(0.2 + 0.6 * cos, -0.5, -0.3 + 0.6 * sin);
        walls.push(wall(corner, [DVec3::Y * 1.2, DVec3::new(-sin, 0.0, cos) * 0.12]));
    }
    let among = Scene::new(&stage, walls, mirror());
    let (among, ..) = maps(&mut stage, &among, "1");
    assert!(among > 2 * few, "{among}, {few} in the empty box");
}

#[test]
fn maps_by_rays_show_what_drawn_maps_show() {
    let mut stage = stage_or_skip!();
    let mirrors = vec![sphere(DVec3::new(0.3, 0.0, -0.2), RADIUS), sphere(DVec3::new(-0.5, 0.3, 0.1), RADIUS)];
    let scene = Scene::new(&stage, room(&[2]), mirrors);
    let mut found = |fill: &str, corrections: &str| {
        let pairs =
            [("light_field.fill", fill), ("light_field.corrections", corrections), ("light_field.rest", "none")];
        let stats = scene.render(&mut stage, &by_field(&pairs));
        assert!(draws_maps(&stats));
        (pixels(&stage, &scene.camera), stats.reflection.unwrap())
    };
    for corrections in ["0", "1"] {
        let [(drawn, of_drawn), (traced, of_traced)] = ["draw", "trace"].map(|fill| found(fill, corrections));
        assert!(drawn.len() > 1000 && of_drawn.maps == of_traced.maps, "{of_drawn:?}, {of_traced:?}");
        // Of discs that overlap one or the other may be the nearer one; texels at the edge of the open side may hold it or
        // not.
        let is_alike = |(a, b): &(&Seen, &Seen)| match (a.found, b.found) {
            (Some(a), Some(b)) => a.distance(b) < DISC,
            (a, b) => a.is_some() == b.is_some(),
        };
        let alike = drawn.iter().zip(&traced).filter(is_alike).count();
        assert!(alike * 100 >= drawn.len() * 97, "{corrections}: {alike} of {}", drawn.len());
    }
}

/// Boxes about all places at which the only map of a flat mirror may stand, or a screen between two halves of the mirror,
/// hide it from most mirror points.
#[test]
fn a_map_within_a_box_and_one_across_a_rim_are_not_asked() {
    let mut stage = stage_or_skip!();
    let flat = |size: f64| {
        let plane = Shape::Plane { height: 1.0 };
        Mirror { position: DVec3::ZERO, ..Mirror::standing(plane, DVec3::ZERO, DVec3::Z, DVec3::Y, size) }
    };
    let one = [("light_field.samples", "1"), ("light_field.rest", "none"), ("light_field.own", "left_out")];
    let mut found = |walls: Vec<Chunk>, offset: &str| {
        let mut scene = Scene::new(&stage, walls, vec![flat(0.5)]);
        scene.camera = Camera::looking(DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0), 0.8, DVec3::Y);
        let stats = scene.render(&mut stage, &by_field(&[&one[..], &[("light_field.offset", offset)]].concat()));
        (pixels(&stage, &scene.camera), stats.reflection.unwrap().unresolved.unwrap())
    };
    let share = |pixels: &[&Seen]| {
        let told = pixels.iter().filter(|seen| seen.found.is_some()).count();
        assert!(pixels.len() > 30, "{}", pixels.len());
        told as f64 / pixels.len() as f64
    };
    let (all, unresolved) = found(room(&[]), "0.2");
    let told = share(&all.iter().collect::<Vec<_>>());
    assert!(told > 0.98 && unresolved < 0.3, "{told}, {unresolved}");

    // The map stands at a corner of the mirror, a tenth before or behind it.
    let half = 0.2;
    let mut walls = room(&[]);
    for corner in [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)].map(|(x, y)| DVec3::new(x, y, 0.0)) {
        walls.extend((0..6).map(|side| {
            let axis = |turn: usize| DVec3::AXES[(side + turn) % 3] * half;
            let middle = corner + if side < 3 { axis(0) } else { -axis(0) };
            wall(middle - axis(1) - axis(2), [axis(1) * 2.0, axis(2) * 2.0])
        }));
    }
    let (boxed, unresolved) = found(walls, "0.2");
    let outside: Vec<&Seen> = boxed.iter().filter(|seen| seen.point.x.abs().min(seen.point.y.abs()) < 0.26).collect();
    assert!(share(&outside) < 0.02 && unresolved > 0.8, "{}, {unresolved}", share(&outside));

    // A screen stands on the middle of the mirror, across both of its sides.
    let mut walls = room(&[]);
    walls.push(wall(DVec3::new(0.0, -0.6, -0.4), [DVec3::Y * 1.2, DVec3::Z * 0.8]));
    let (halves, _) = found(walls, "0.05");
    let [left, right] =
        [-1.0, 1.0].map(|side| share(&halves.iter().filter(|seen| seen.point.x * side > 0.04).collect::<Vec<_>>()));
    assert!(left.min(right) < 0.03 && left.max(right) > 0.9, "{left}, {right}");
}

/// Texels that are traced when rays first look at them are those of maps that are traced as a whole, each is traced once,
/// and what a picture shows does not depend on the pictures before.
#[test]
fn texels_are_traced_once_when_rays_first_look_at_them() {
    let mut stage = stage_or_skip!();
    let mirrors = [sphere(DVec3::new(0.3, 0.0, -0.2), RADIUS), sphere(DVec3::new(-0.5, 0.3, 0.1), RADIUS)];
    let mut scene = Scene::new(&stage, room(&[2]), Vec::new());
    // One is drawn by its formula; the other's points are left out of its own maps.
    scene.mirrors.push(mirrors[0].clone());
    add_points(&mut scene.store, mirrors[1].sample(6000, 1), MIRROR);
    let on_demand = |pairs: &[(&str, &str)]| by_field(&[&[("light_field.fill", "on_demand")], pairs].concat());
    let texels = |stats: FrameStats| stats.reflection.unwrap().map_use.unwrap().texels;
    let is_alike = |(a, b): &(&Seen, &Seen)| match (a.found, b.found) {
        (Some(a), Some(b)) => a.distance(b) < 0.01,
        (a, b) => a.is_some() == b.is_some(),
    };
    for (rule, corrections) in [("nearest", "1"), ("nearest", "0"), ("angle", "2"), ("smooth", "1")] {
        let neighbours = if rule == "smooth" { "4" } else { "1" };
        let same = [
            ("light_field.rule", rule),
            ("light_field.corrections", corrections),
            ("light_field.neighbours", neighbours),
            ("light_field.rest", "none"),
            ("light_field.own", "left_out"),
        ];
        let whole = [("light_field.fill", "trace")];
        let stats = scene.render(&mut stage, &by_field(&[&same[..], &whole].concat()));
        assert_eq!(texels(stats), None);
        let traced = pixels(&stage, &scene.camera);
        let stats = scene.render(&mut stage, &on_demand(&same));
        let asked = texels(stats).unwrap() as usize;
        let most = if rule == "smooth" { 16 } else { 4 } * traced.len();
        assert!(asked > traced.len() && asked <= most, "{asked} texels for {} pixels", traced.len());
        let found = pixels(&stage, &scene.camera);
        let alike = found.iter().zip(&traced).filter(is_alike).count();
        assert!(traced.len() > 500 && alike * 100 >= traced.len() * 98, "{rule}: {alike} of {}", traced.len());
    }
    let settings = on_demand(&[]);
    stage.renderer.forget();
    let first = texels(scene.render(&mut stage, &settings)).unwrap();
    // A picture that asks for the same: the renderer keeps what is found unless something changes.
    let mut other = settings.clone();
    other.light_field.rest = scene::SampleRest::None;
    assert_eq!(texels(scene.render(&mut stage, &other)), Some(0), "all are traced");
    for turn in 0..3 {
        scene.camera.orbit(0.02, 0.01);
        let more = texels(scene.render(&mut stage, &settings)).unwrap();
        let wandered = bits(&stage);
        stage.renderer.forget();
        let anew = texels(scene.render(&mut stage, &settings)).unwrap();
        assert!(bits(&stage) == wandered, "{turn}");
        assert!(more > 0 && more < anew && anew.abs_diff(first) * 5 < first, "{more}, {anew}, {first}");
    }
    // With few samples chosen by their predicted error, too.
    let stats = scene.render(&mut stage, &on_demand(&[("light_field.accuracy", "1")]));
    let found = stats.reflection.unwrap();
    assert!(found.map_use.unwrap().off.unwrap() <= 0.05, "{found:?}");
    let alone = by_field(&[("reflection.method", "surfel_trace")]);
    let by_maps = pixels(&stage, &scene.camera);
    scene.render(&mut stage, &alone);
    let alike = pixels(&stage, &scene.camera).iter().zip(&by_maps).filter(is_alike).count();
    assert!(alike * 100 >= by_maps.len() * 95, "{alike} of {}", by_maps.len());
}
