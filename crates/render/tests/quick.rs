//! Quick pictures against the renderer's pictures at rest of the same views.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;

use std::sync::Arc;

use cloud::{Attribute, Chunk, Cloud, CloudLayout, Column, ColumnType, PointTest, hash, pack_normal, pack_radius};
use glam::DVec3;
use render::{
    Adaptation, Aov, ColorPlan, Detail, EarlierLight, Frame, Known, Material, Objects, PointStore, QuickPicture,
};
use scene::{Camera, Settings};

use stage::Stage;

const SIZE: [u32; 2] = [200, 150];
const ALL: Detail = Detail { most_points: None, coarseness: 1, most_as_discs: 0 };
/// Points as discs, and in cells.
const BOTH_WAYS: [Detail; 2] = [Detail { most_as_discs: u64::MAX, ..ALL }, ALL];

fn random(seed: u64) -> f64 {
    hash(seed) as f64 / u64::MAX as f64
}

/// A floor of 8 x 8 m with a ball on it, as a scanner at its edge sees them: ten times as dense near it as far away, with
/// noise, and with strays in the air. Colours follow the place; classes are 2 on the floor and 6 on the ball.
fn scan() -> Cloud {
    let (mut places, mut normals, mut colors, mut radii, mut classes) = (vec![], vec![], vec![], vec![], vec![]);
    let mut add = |place: DVec3, normal: DVec3, radius: f64, class: u8| {
        places.push(place);
        normals.push(pack_normal(normal.as_vec3()));
        radii.push(if radius > 0.0 { pack_radius(radius as f32) } else { cloud::STRAY_RADIUS });
        let [x, y, z] = (place * 1.3).to_array().map(|part| (part.sin() * 60.0 + 150.0) as u8);
        colors.push([x, y, z, 255]);
        classes.push(class);
    };
    for i in 0..90_000 {
        let noise = 0.003 * (random(i * 3 + 2) - 0.5);
        // The square of an even number is dense near 0.
        let (x, y) = (8.0 * random(i * 3).powi(2), 8.0 * random(i * 3 + 1) - 4.0);
        add(DVec3::new(x, y, noise), DVec3::Z, 0.02 + 0.03 * (x / 8.0).sqrt(), 2);
    }
    for i in 0..30_000 {
        let z = 2.0 * random(i * 2 + 700_000) - 1.0;
        let angle = random(i * 2 + 700_001) * std::f64::consts::TAU;
        let ring = (1.0 - z * z).sqrt();
        let direction = DVec3::new(ring * angle.cos(), ring * angle.sin(), z);
        add(DVec3::new(4.0, 0.0, 1.0) + direction, direction, 0.03, 6);
    }
    for i in 0..50 {
        let place = |k: u64| random(i * 3 + k + 900_000);
        add(DVec3::new(8.0 * place(0), 8.0 * place(1) - 4.0, 3.0 * place(2)), DVec3::Z, 0.0, 1);
    }
    let mut chunk = Chunk::of_places(0, &places);
    (chunk.normals, chunk.radii) = (Some(Arc::new(normals)), Some(Arc::new(radii)));
    chunk.colors = Some(Arc::new(colors));
    chunk.columns = vec![Some(Arc::new(Column::U8(classes)))];
    let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
    Cloud { attributes, chunks: vec![chunk], ..Cloud::default() }
}

fn camera() -> Camera {
    Camera::looking(DVec3::new(4.0, 0.0, 0.6), DVec3::new(-0.9, 0.25, 0.4), 5.0, DVec3::Z)
}

fn settings(pairs: &[(&str, &str)]) -> Settings {
    let mut settings = Settings::default();
    for (key, value) in pairs {
        settings.set_text(key, value).unwrap();
    }
    settings
}

fn store(stage: &Stage, cloud: &Cloud, settings: &Settings) -> PointStore {
    let mut store = PointStore::new(stage.gpu.clone());
    let id = store.add_cloud(Material::default());
    let layout = Arc::new(CloudLayout { attributes: cloud.attributes.clone(), ..CloudLayout::default() });
    let ids: Vec<_> = cloud.chunks.iter().map(|chunk| store.add_chunk(id, chunk, Some(&layout)).unwrap()).collect();
    let (plan, _) = ColorPlan::new(cloud, &settings.color, DVec3::Z);
    store.set_color(id, cloud, &ids, &plan, DVec3::Z).unwrap();
    store
}

fn still(stage: &mut Stage, store: &PointStore, camera: &Camera, settings: &Settings) -> Vec<u8> {
    stage.renderer.render(store, &Frame::new(camera, settings, Objects::default(), SIZE)).unwrap();
    stage.renderer.read_picture().unwrap()
}

/// The mean difference of the bytes of two pictures.
fn difference(a: &[u8], b: &[u8]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
}

#[test]
fn a_quick_picture_is_like_the_picture_at_rest_in_both_projections_and_with_fewer_points() {
    let mut stage = stage_or_skip!();
    let cloud = scan();
    let projections = ["perspective", "orthographic"];
    for (way, projection) in BOTH_WAYS.into_iter().flat_map(|way| projections.map(|projection| (way, projection))) {
        let settings = settings(&[("view.projection", projection), ("light.by", "colors")]);
        let store = store(&stage, &cloud, &settings);
        let rest = still(&mut stage, &store, &camera(), &settings);
        let mut quick = QuickPicture::default();
        let mut draw = |most_points| {
            let detail = Detail { most_points, ..way };
            let stats = quick.draw(&store, &camera(), &settings, SIZE, detail, Known::default());
            (stats.points_drawn, difference(&quick.take_rows().tight(), &rest))
        };
        let (points, all) = draw(None);
        assert_eq!(points, cloud.len());
        let (some_points, some) = draw(Some(30_000));
        assert!((20_000..=31_000).contains(&some_points), "{some_points}");
        // A picture without points differs by 60 and more.
        assert!(all < 4.0 && some < 8.0, "{projection}: {all} and {some} of 255");
        let (again, same) = draw(None);
        assert_eq!((again, same), (points, all), "the picture does not depend on the one before");
    }
}

/// A red wall of random points that leads away from the eye, with splats of uneven sizes, before a green one.
fn walls() -> Cloud {
    let (mut places, mut normals, mut colors, mut radii) = (vec![], vec![], vec![], vec![]);
    let density = 4000.0;
    // Six splats lie over each place in the mean.
    let radius = (6.0 / (std::f64::consts::PI * density)).sqrt();
    let mut add = |place: DVec3, normal: DVec3, color: [u8; 4], radius: f64| {
        places.push(place);
        normals.push(pack_normal(normal.as_vec3()));
        colors.push(color);
        radii.push(pack_radius(radius as f32));
    };
    for i in 0..(12.0 * 4.0 * density) as u64 {
        let (along, z) = (12.0 * random(i * 3), 4.0 * random(i * 3 + 1) - 2.0);
        let place = DVec3::new(1.0 + 0.8 * along, 2.0 - 0.6 * along, z);
        add(place, DVec3::new(-0.6, -0.8, 0.0), [255, 0, 0, 255], radius * (0.8 + 0.5 * random(i * 3 + 2)));
    }
    for i in 0..100_000 {
        let place = |k: u64| 40.0 * random(i * 2 + k + 1_000_000) - 20.0;
        add(DVec3::new(20.0, place(0), place(1)), -DVec3::X, [0, 255, 0, 255], 0.2);
    }
    let mut chunk = Chunk::of_places(0, &places);
    (chunk.normals, chunk.radii) = (Some(Arc::new(normals)), Some(Arc::new(radii)));
    chunk.colors = Some(Arc::new(colors));
    Cloud { chunks: vec![chunk], ..Cloud::default() }
}

#[test]
fn a_thinned_wall_of_random_points_shows_nothing_behind_it() {
    let stage = stage_or_skip!();
    let (cloud, settings) = (walls(), settings(&[("light.by", "colors"), ("edl.strength", "0")]));
    let store = store(&stage, &cloud, &settings);
    let camera = Camera::from_eye(DVec3::ZERO, DVec3::X, DVec3::Z);
    let size = [400, 300];
    let tangent = (f64::from(settings.view.field_of_view).to_radians() / 2.0).tan();
    let mut quick = QuickPicture::default();
    let limits = [None, Some(100_000), Some(40_000), Some(15_000), Some(6_000)];
    for most_points in limits {
        quick.draw(&store, &camera, &settings, size, Detail { most_points, ..ALL }, Known::default());
        let picture = quick.take_rows().tight();
        let green = |x: u32, y: u32| picture[((y * size[0] + x) * 4 + 1) as usize];
        // The lines of sight that meet the wall far from its borders.
        let (mut inside, mut wrong) = (0, 0);
        for (x, y) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))) {
            let half = f64::from(size[1]) / 2.0;
            let across = (f64::from(size[0]) / 2.0 - f64::from(x) - 0.5) / half * tangent;
            let up = (half - f64::from(y) - 0.5) / half * tangent;
            let distance = 2.2 / (0.6 + 0.8 * across);
            let along = (distance - 1.0) / 0.8;
            if !(0.7..11.3).contains(&along) || (distance * up).abs() > 1.6 {
                continue;
            }
            inside += 1;
            wrong += u32::from(green(x, y) > 30);
        }
        // No splat covers 0.3 % of the wall.
        assert!(inside > 50_000 && wrong * 100 < inside, "{most_points:?}: {wrong} of {inside} pixels");
    }
}

#[test]
fn points_have_the_colours_in_which_the_renderer_shows_them() {
    let mut stage = stage_or_skip!();
    let cloud = scan();
    let sources: [&[(&str, &str)]; 7] = [
        &[("color.by", "rgb")],
        &[("color.by", "plain")],
        &[("color.by", "normal")],
        &[("color.by", "class")],
        &[("color.by", "height")],
        &[("color.by", "stray")],
        &[("color.by", "attribute"), ("color.attribute", "classification")],
    ];
    for source in sources {
        let mut settings = settings(source);
        for (key, value) in [("light.by", "colors"), ("edl.strength", "0")] {
            settings.set_text(key, value).unwrap();
        }
        let store = store(&stage, &cloud, &settings);
        let rest = still(&mut stage, &store, &camera(), &settings);
        let mut quick = QuickPicture::default();
        for way in BOTH_WAYS {
            quick.draw(&store, &camera(), &settings, SIZE, way, Known::default());
            let difference = difference(&quick.take_rows().tight(), &rest);
            assert!(difference < 3.0, "{source:?}, {way:?}: {difference} of 255");
        }
    }
}

#[test]
fn a_quick_picture_shows_no_point_that_is_hidden_and_nothing_before_the_eye() {
    let stage = stage_or_skip!();
    let cloud = scan();
    let settings = settings(&[("light.by", "colors"), ("color.by", "class"), ("edl.strength", "0")]);
    let mut store = store(&stage, &cloud, &settings);
    let mut quick = QuickPicture::default();
    for way in BOTH_WAYS {
        let mut shows = |store: &PointStore, camera: &Camera| {
            quick.draw(store, camera, &settings, SIZE, way, Known::default());
            let picture = quick.take_rows().tight();
            [2, 6].map(|class| picture.chunks_exact(4).any(|pixel| pixel[..3] == render::class_color(class)[..3]))
        };
        assert_eq!(shows(&store, &camera()), [true, true]);
        store.set_visibility(&PointTest::hiding([6]));
        assert_eq!(shows(&store, &camera()), [true, false]);
        store.set_visibility(&PointTest::hiding([2, 6]));
        assert_eq!(shows(&store, &camera()), [false, false]);
        store.set_visibility(&PointTest::default());
        // The whole scan lies behind the eye.
        let away = Camera::looking(DVec3::new(20.0, 0.0, 1.0), -DVec3::X, 5.0, DVec3::Z);
        assert_eq!(shows(&store, &away), [false, false]);
    }
}

#[test]
fn a_quick_picture_takes_over_the_light_of_a_picture_at_rest_into_other_views() {
    let mut stage = stage_or_skip!();
    let cloud = scan();
    let settings = settings(&[("light.by", "sun"), ("color.by", "plain"), ("gi.bounces", "0"), ("tone.fit", "locked")]);
    let store = store(&stage, &cloud, &settings);
    let turned = Camera::looking(DVec3::new(4.0, 0.0, 0.6), DVec3::new(-0.85, 0.4, 0.4), 5.0, DVec3::Z);
    let other = still(&mut stage, &store, &turned, &settings);
    still(&mut stage, &store, &camera(), &settings);
    let known = stage.renderer.known_light(&settings).unwrap();
    let mut quick = QuickPicture::default();
    let mut error = |light| {
        quick.draw(&store, &turned, &settings, SIZE, ALL, Known { light, ..Known::default() });
        difference(&quick.take_rows().tight(), &other)
    };
    let (lit, unlit) = (error(Some(&known)), error(None));
    assert!(lit < 8.0 && unlit > 2.0 * lit, "{lit} with the light and {unlit} without it");
}

#[test]
fn a_quick_picture_takes_over_the_light_of_a_later_picture_where_the_first_knows_none() {
    let mut stage = stage_or_skip!();
    let cloud = scan();
    let settings = settings(&[("light.by", "sun"), ("color.by", "plain"), ("gi.bounces", "0"), ("tone.fit", "locked")]);
    let store = store(&stage, &cloud, &settings);
    // The other side of the ball.
    let [before, behind] =
        [-0.9, 0.9].map(|x| Camera::looking(DVec3::new(4.0, 0.0, 0.6), DVec3::new(x, 0.25, 0.4), 5.0, DVec3::Z));
    still(&mut stage, &store, &before, &settings);
    let first = stage.renderer.known_light(&settings).unwrap();
    // That side is dark, so that its own exposure is another one, which the quick picture fits, too.
    for fit in ["locked", "always"] {
        let mut own = settings.clone();
        own.set_text("tone.fit", fit).unwrap();
        let rest = still(&mut stage, &store, &behind, &own);
        let later = stage.renderer.known_light(&own).unwrap();
        let mut quick = QuickPicture::default();
        let mut error = |coarse| {
            let adaptation = (fit == "always").then_some(Adaptation { before: 0.0, share: 1.0 });
            let known = Known { light: Some(&first), coarse, adaptation, ..Known::default() };
            quick.draw(&store, &behind, &settings, SIZE, ALL, known);
            (difference(&quick.take_rows().tight(), &rest), quick.unlit())
        };
        let ((both, unlit), (alone, unlit_alone)) = (error(Some(&later)), error(None));
        assert!(unlit == unlit_alone && unlit > 0.3, "the picture at rest knows the light but for {unlit}");
        assert!(alone > 1.5 * both, "{fit}: {both} with the later picture and {alone} without it");
    }
}

#[test]
fn a_quick_picture_takes_over_the_light_of_pictures_before_the_last_one() {
    let mut stage = stage_or_skip!();
    let cloud = scan();
    let settings = settings(&[("light.by", "sun"), ("color.by", "plain"), ("gi.bounces", "0"), ("tone.fit", "locked")]);
    let store = store(&stage, &cloud, &settings);
    // The dark side of the ball, and then the bright one.
    let [dark, bright] =
        [0.9, -0.9].map(|x| Camera::looking(DVec3::new(4.0, 0.0, 0.6), DVec3::new(x, 0.25, 0.4), 5.0, DVec3::Z));
    let rest = still(&mut stage, &store, &dark, &settings);
    for fit in ["locked", "always"] {
        let mut own = settings.clone();
        own.set_text("tone.fit", fit).unwrap();
        still(&mut stage, &store, &dark, &own);
        let before = stage.renderer.known_light(&own).unwrap();
        still(&mut stage, &store, &bright, &settings);
        let last = stage.renderer.known_light(&settings).unwrap();
        let mut earlier = EarlierLight::default();
        [&before, &last].into_iter().for_each(|known| earlier.add(known));
        let mut quick = QuickPicture::default();
        let mut error = |earlier| {
            let known = Known { light: Some(&last), earlier, ..Known::default() };
            quick.draw(&store, &dark, &settings, SIZE, ALL, known);
            difference(&quick.take_rows().tight(), &rest)
        };
        let (both, alone) = (error(Some(&earlier)), error(None));
        assert!(alone > 1.5 * both, "{fit}: {both} with the picture before and {alone} without it");
    }
}

#[test]
fn the_light_around_the_eye_is_known_and_the_picture_at_rest_stays() {
    let mut stage = stage_or_skip!();
    let cloud = scan();
    let pairs = [("light.by", "sun"), ("color.by", "plain"), ("gi.vpls", "16"), ("tone.fit", "locked")];
    let settings = settings(&pairs);
    let store = store(&stage, &cloud, &settings);
    // The floor, and then the ball.
    let eye = DVec3::new(2.0, -1.0, 1.5);
    let [floor, ball] = [DVec3::new(-0.6, -1.0, -1.0), DVec3::new(2.0, 1.0, -0.4)]
        .map(|direction| Camera::from_eye(eye, eye + 2.0 * direction.normalize(), DVec3::Z));
    let ball = Camera { eye: floor.eye, ..ball };
    let rest = still(&mut stage, &store, &ball, &settings);
    let here = still(&mut stage, &store, &floor, &settings);
    let known = stage.renderer.known_light(&settings).unwrap();
    let mut around = |settings: &Settings, camera: &Camera| {
        let frame = Frame::new(camera, settings, Objects::default(), SIZE);
        stage.renderer.light_around(&store, &frame).unwrap()
    };
    let mut earlier = EarlierLight::default();
    assert_eq!(earlier.directions_from(eye).count(), 0);
    earlier.add_coarse(&around(&settings, &ball).unwrap());
    let direction = earlier.directions_from(floor.eye).next().unwrap();
    assert!(direction.distance(ball.forward()) < 1e-9, "{direction}");
    // Of other eyes, of parallel projections, and of rays nothing is known.
    let elsewhere = Camera { eye: eye + 0.1 * DVec3::X, ..ball };
    assert!(around(&settings, &elsewhere).is_none());
    for (key, value) in [("view.projection", "orthographic"), ("gi.by", "rays")] {
        let mut other = settings.clone();
        other.set_text(key, value).unwrap();
        assert!(around(&other, &ball).is_none(), "{key}");
    }
    let mut quick = QuickPicture::default();
    let mut error = |earlier| {
        let known = Known { light: Some(&known), earlier, ..Known::default() };
        quick.draw(&store, &ball, &settings, SIZE, ALL, known);
        (difference(&quick.take_rows().tight(), &rest), quick.unlit())
    };
    let ((with, unlit), (without, unknown)) = (error(Some(&earlier)), error(None));
    assert!(unlit < 0.05 && unknown > 0.3, "{unlit} is unlit with the light around the eye and {unknown} without it");
    assert!(with < 8.0 && without > 1.5 * with, "{with} with the light around the eye and {without} without it");
    // The renderer holds what it held.
    let frame = Frame::new(&floor, &settings, Objects::default(), SIZE);
    let stats = stage.renderer.render(&store, &frame).unwrap();
    assert!(stats.passes.iter().all(|pass| !pass.name.starts_with("splat")), "{:?}", stats.passes);
    assert!(stage.renderer.read_picture().unwrap() == here);
}

#[test]
fn the_exposure_of_a_quick_picture_follows_what_it_shows() {
    let mut stage = stage_or_skip!();
    let cloud = scan();
    let pairs = [("light.by", "sun"), ("color.by", "plain"), ("gi.bounces", "0"), ("tone.fit", "always")];
    let settings = settings(&pairs);
    let store = store(&stage, &cloud, &settings);
    let camera = camera();
    let frame = Frame::new(&camera, &settings, Objects::default(), SIZE);
    let fitting = stage.renderer.render(&store, &frame).unwrap().exposure.unwrap().stops;
    let rest = stage.renderer.read_picture().unwrap();
    let known = stage.renderer.known_light(&settings).unwrap();
    let mut quick = QuickPicture::default();
    let mut draw = |adaptation| {
        let known = Known { light: Some(&known), adaptation, ..Known::default() };
        let stats = quick.draw(&store, &camera, &settings, SIZE, ALL, known);
        (stats.exposure, difference(&quick.take_rows().tight(), &rest))
    };
    let (none, right) = draw(None);
    assert!(none.is_none() && right < 8.0, "{right}");
    for before in [fitting - 2.0, fitting + 2.0] {
        for (share, left) in [(0.0, 1.0), (0.5, 0.5), (1.0, 0.0)] {
            let (exposure, apart) = draw(Some(Adaptation { before, share }));
            let exposure = exposure.unwrap();
            let expected = fitting + (before - fitting) * left;
            assert!((exposure.stops - expected).abs() < 0.15, "{share} from {before}: {exposure:?}, not {expected}");
            assert_eq!(exposure.adapts, left > 0.0, "{share} from {before}: {exposure:?}, fit {fitting}");
            assert!(if left > 0.0 { apart > 1.5 * right } else { apart < 1.5 * right }, "{share}: {apart} for {right}");
        }
    }
}

/// A mirror of 4 x 4 m above a floor and before a wall of coloured squares. Light goes through it where it has an index of
/// refraction.
fn mirror_and_wall(stage: &Stage, settings: &Settings, refraction: f32) -> PointStore {
    let square = |origin: DVec3, across: DVec3, up: DVec3, color: fn(u64, u64) -> [u8; 4]| {
        const EDGE: u64 = 200;
        let share = |i: u64| i as f64 / EDGE as f64;
        let place = |i: u64| origin + across * share(i % EDGE) + up * share(i / EDGE);
        let mut chunk = Chunk::of_places(0, &(0..EDGE * EDGE).map(place).collect::<Vec<_>>());
        let normal = pack_normal(across.cross(up).normalize().as_vec3());
        chunk.normals = Some(Arc::new(vec![normal; chunk.len()]));
        chunk.radii = Some(Arc::new(vec![pack_radius((across.length() / EDGE as f64) as f32); chunk.len()]));
        chunk.colors = Some(Arc::new((0..EDGE * EDGE).map(|i| color(i % EDGE / 20, i / EDGE / 20)).collect()));
        chunk
    };
    let squares =
        |x: u64, y: u64| [[220, 60, 20, 255], [30, 80, 200, 255], [240, 240, 90, 255]][((x + y) % 3) as usize];
    let wall = square(DVec3::new(8.0, 4.0, 0.0), -DVec3::Y * 8.0, DVec3::Z * 8.0, squares);
    let floor = square(DVec3::new(2.0, 2.0, 0.0), -DVec3::Y * 4.0, DVec3::X * 4.0, |_, _| [255; 4]);
    let ground = square(DVec3::new(2.0, 2.0, -0.3), -DVec3::Y * 4.0, DVec3::X * 4.0, squares);
    let mut store = store(stage, &Cloud { chunks: vec![wall, ground], ..Cloud::default() }, settings);
    let mirror = store.add_cloud(Material { specular_intensity: 1.0, refraction, ..Material::default() });
    store.add_chunk(mirror, &floor, None).unwrap();
    store
}

/// By how much the pixels of a mirror in a quick picture differ in the mean from those of the picture at rest, if it takes
/// over what the mirror shows in another view.
fn error_of_mirror(stage: &mut Stage, refraction: f32) -> f64 {
    let settings = settings(&[("light.by", "colors"), ("edl.strength", "0")]);
    let store = mirror_and_wall(stage, &settings, refraction);
    let view = |side: f64| Camera::from_eye(DVec3::new(-1.0, side, 3.0), DVec3::new(4.0, side, 0.0), DVec3::Z);
    let rest = still(stage, &store, &view(0.5), &settings);
    let is_mirror = stage.renderer.read_aov(Aov::Mirror).unwrap().data;
    still(stage, &store, &view(0.0), &settings);
    let known = stage.renderer.known_light(&settings).unwrap();
    let mut quick = QuickPicture::default();
    quick.draw(&store, &view(0.5), &settings, SIZE, ALL, Known { coarse: Some(&known), ..Known::default() });
    let picture = quick.take_rows().tight();
    let pixels = is_mirror.iter().zip(picture.chunks_exact(4).zip(rest.chunks_exact(4)));
    let errors: Vec<f64> = pixels.filter(|(is, _)| **is == 1.0).map(|(_, (a, b))| difference(a, b)).collect();
    assert!(errors.len() > 2000, "{} pixels", errors.len());
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn what_a_plane_mirror_shows_stands_behind_it_in_quick_pictures_of_other_views() {
    let mut stage = stage_or_skip!();
    let error = error_of_mirror(&mut stage, 0.0);
    // What sticks to the mirror differs by 58.
    assert!(error < 8.0, "{error} of 255");
}

#[test]
fn what_is_seen_through_water_sticks_to_it_in_quick_pictures_of_other_views() {
    let mut stage = stage_or_skip!();
    let error = error_of_mirror(&mut stage, 1.33);
    // What moves as an image behind the surface differs by 47.
    assert!(error < 20.0, "{error} of 255");
}

#[test]
fn a_mirror_of_which_nobody_knows_what_it_shows_has_the_colour_of_what_else_is_seen() {
    let stage = stage_or_skip!();
    let settings = settings(&[("light.by", "colors")]);
    let wall = |depth: f64, half: f64| {
        let step = |i: u32| half * (f64::from(i) / 30.0 - 1.0);
        let place = |i: u32| DVec3::new(depth, step(i % 61), step(i / 61));
        let mut chunk = Chunk::of_places(0, &(0..61 * 61).map(place).collect::<Vec<_>>());
        chunk.normals = Some(Arc::new(vec![pack_normal(-glam::Vec3::X); chunk.len()]));
        chunk.radii = Some(Arc::new(vec![pack_radius(half as f32 / 15.0); chunk.len()]));
        chunk.colors = Some(Arc::new(vec![[200, 100, 50, 255]; chunk.len()]));
        chunk
    };
    let mut store = store(&stage, &Cloud { chunks: vec![wall(4.0, 6.0)], ..Cloud::default() }, &settings);
    let mirror = store.add_cloud(Material { specular_intensity: 1.0, ..Material::default() });
    store.add_chunk(mirror, &wall(2.0, 0.5), None).unwrap();
    let ahead = Camera::from_eye(DVec3::ZERO, DVec3::X, DVec3::Z);
    let mut quick = QuickPicture::default();
    for way in BOTH_WAYS {
        quick.draw(&store, &ahead, &settings, SIZE, way, Known::default());
        let picture = quick.take_rows().tight();
        let middle = ((SIZE[1] / 2 * SIZE[0] + SIZE[0] / 2) * 4) as usize;
        assert_eq!(picture[middle..middle + 4], [200, 100, 50, 255], "{way:?}");
    }
}

#[test]
fn the_point_under_a_pixel_of_a_quick_picture_is_that_of_the_picture_at_rest() {
    let mut stage = stage_or_skip!();
    let cloud = scan();
    let settings = settings(&[("light.by", "colors")]);
    let store = store(&stage, &cloud, &settings);
    still(&mut stage, &store, &camera(), &settings);
    let depth = stage.renderer.read_aov(Aov::Depth).unwrap().data;
    let mut quick = QuickPicture::default();
    let at = |x: u32, y: u32| depth[(y * SIZE[0] + x) as usize];
    for way in BOTH_WAYS {
        quick.draw(&store, &camera(), &settings, SIZE, way, Known::default());
        let mut count = 0;
        for (x, y) in (5..SIZE[1] - 5).step_by(7).flat_map(|y| (5..SIZE[0] - 5).step_by(7).map(move |x| (x, y))) {
            let around = [at(x, y), at(x - 3, y - 3), at(x + 3, y - 3), at(x - 3, y + 3), at(x + 3, y + 3)];
            // Beside an outline either surface may be picked.
            if around.iter().any(|depth| depth.is_nan() || (depth / around[0] - 1.0).abs() > 0.1) {
                continue;
            }
            let Some(picked) = quick.pick(&store, [x, y], 2) else { panic!("{x}, {y}: nothing at {} m", around[0]) };
            assert!((picked.linear_depth / around[0] - 1.0).abs() < 0.05, "{x}, {y}: {picked:?}, {} m", around[0]);
            let place = cloud.chunks[0].position(picked.index);
            let own = (camera().view_from_world() * (place - camera().eye)).z;
            // Of a splat that is drawn as a disc, the depth is that of the disc at the pixel.
            let off = if way.most_as_discs > 0 { 0.05 } else { 1e-5 };
            assert!((own / f64::from(picked.linear_depth) - 1.0).abs() < off, "{picked:?} is {own} m away");
            count += 1;
        }
        assert!(count > 100, "{count} pixels");
        // Six pixels from all that the picture at rest shows.
        let is_sky = |x: u32, y: u32| (y - 6..=y + 6).all(|y| (x - 6..=x + 6).all(|x| at(x, y).is_nan()));
        let mut places = (6..SIZE[1] - 6).flat_map(|y| (6..SIZE[0] - 6).map(move |x| (x, y)));
        let (x, y) = places.find(|(x, y)| is_sky(*x, *y)).unwrap();
        assert!(quick.pick(&store, [x, y], 1).is_none(), "the sky has no points");
    }
}

/// Discs of all directions and colours, each apart from the others, before a wall of another colour.
fn discs() -> Cloud {
    let (mut places, mut normals, mut colors, mut radii) = (vec![], vec![], vec![], vec![]);
    let mut add = |place: DVec3, normal: DVec3, color: [u8; 4], radius: f32| {
        places.push(place);
        normals.push(pack_normal(normal.normalize().as_vec3()));
        colors.push(color);
        radii.push(pack_radius(radius));
    };
    for i in 0..300 {
        let part = |k: u64| random(i * 9 + k);
        let place = DVec3::new(4.0 + 2.0 * part(0), 4.0 * part(1) - 2.0, 3.0 * part(2) - 1.5);
        let normal = DVec3::new(-1.0, part(3) - 0.5, part(4) - 0.5);
        let color = [5, 6, 7].map(|k| (part(k) * 255.0) as u8);
        add(place, normal, [color[0], color[1], color[2], 255], 0.12 + 0.12 * part(8) as f32);
    }
    for (y, z) in (-40..=40).flat_map(|y| (-30..=30).map(move |z| (y, z))) {
        add(DVec3::new(9.0, f64::from(y) * 0.2, f64::from(z) * 0.2), -DVec3::X, [40, 90, 40, 255], 0.2);
    }
    let mut chunk = Chunk::of_places(0, &places);
    (chunk.normals, chunk.radii) = (Some(Arc::new(normals)), Some(Arc::new(radii)));
    chunk.colors = Some(Arc::new(colors));
    Cloud { chunks: vec![chunk], ..Cloud::default() }
}

#[test]
fn few_splats_are_drawn_as_the_discs_that_they_are_at_rest() {
    let mut stage = stage_or_skip!();
    let cloud = discs();
    let camera = Camera::from_eye(DVec3::ZERO, DVec3::X * 5.0, DVec3::Z);
    let usual = [("view.projection", "perspective"), ("splat.quality", "high"), ("splat.depth_offset", "1")];
    let others = [("view.projection", "orthographic"), ("splat.quality", "nearest"), ("splat.depth_offset", "0.1")];
    let mut pictures = Vec::new();
    for changed in 0..4 {
        let mut values = vec![("light.by", "colors"), ("edl.strength", "0")];
        values.extend((0..3).map(|index| if index + 1 == changed { others[index] } else { usual[index] }));
        let settings = settings(&values);
        let store = store(&stage, &cloud, &settings);
        let rest = still(&mut stage, &store, &camera, &settings);
        let mut quick = QuickPicture::default();
        let [discs, cells] = BOTH_WAYS.map(|way| {
            quick.draw(&store, &camera, &settings, SIZE, way, Known::default());
            quick.take_rows().tight()
        });
        let [of_discs, of_cells] = [&discs, &cells].map(|picture| difference(picture, &rest));
        assert!(of_discs < 1.5 && of_cells > 3.0 * of_discs, "{values:?}: {of_discs} of 255 and {of_cells} in cells");
        pictures.push((discs, rest));
    }
    // By the usual settings they would not be within that bound of pictures at rest by others.
    let of_usual = [2, 3].map(|changed| difference(&pictures[0].0, &pictures[changed].1));
    println!("off by {of_usual:?} of 255 by the usual settings");
    assert!(of_usual.iter().all(|off| *off > 1.5), "{of_usual:?}");
}

#[test]
fn splats_that_are_many_large_or_long_go_into_cells() {
    let stage = stage_or_skip!();
    let camera = Camera::from_eye(DVec3::ZERO, DVec3::X * 5.0, DVec3::Z);
    let way = |cloud: &Cloud, size: [u32; 2], splat_size: &str, most_as_discs: u64| {
        let settings = settings(&[("light.by", "colors"), ("splat.size", splat_size)]);
        let store = store(&stage, cloud, &settings);
        let detail = Detail { most_as_discs, ..ALL };
        QuickPicture::default().draw(&store, &camera, &settings, size, detail, Known::default()).passes[0].name
    };
    let round = discs();
    let mut long = discs();
    let shape = (0..32).find(|shape| cloud::stretch_ratio(32 + shape) > 3.0).unwrap();
    let radii = long.chunks[0].radii.as_ref().unwrap().iter().map(|radius| radius / 32 * 32 + shape).collect();
    long.chunks[0].radii = Some(Arc::new(radii));
    assert_eq!(way(&round, SIZE, "1", round.len()), "quick_discs");
    assert_eq!(way(&round, SIZE, "1", round.len() - 1), "quick_splat");
    assert_eq!(way(&round, [1600, 1200], "4", u64::MAX), "quick_splat");
    assert_eq!(way(&long, SIZE, "1", u64::MAX), "quick_splat");
}

#[test]
fn a_disc_before_the_eye_is_no_larger_than_at_rest() {
    let mut stage = stage_or_skip!();
    let mut chunk = Chunk::of_places(0, &[DVec3::X * 0.3]);
    chunk.normals = Some(Arc::new(vec![pack_normal(-glam::Vec3::X)]));
    chunk.radii = Some(Arc::new(vec![pack_radius(0.5)]));
    chunk.colors = Some(Arc::new(vec![[200, 100, 50, 255]]));
    let cloud = Cloud { chunks: vec![chunk], ..Cloud::default() };
    let settings = settings(&[
        ("light.by", "colors"),
        ("edl.strength", "0"),
        ("splat.max_pixels", "16"),
        ("splat.rest_pixels", "64"),
    ]);
    let store = store(&stage, &cloud, &settings);
    let camera = Camera::from_eye(DVec3::ZERO, DVec3::X, DVec3::Z);
    let covered = |picture: &[u8]| picture.chunks_exact(4).filter(|pixel| pixel[0] > 100).count();
    let rest = covered(&still(&mut stage, &store, &camera, &settings));
    let mut quick = QuickPicture::default();
    quick.draw(&store, &camera, &settings, SIZE, BOTH_WAYS[0], Known::default());
    let moving = covered(&quick.take_rows().tight());
    assert!(rest > 2000 && moving.abs_diff(rest) * 50 < rest, "{moving} pixels in place of {rest}");
}
