//! Splatting on the GPU against closed forms, and the laws that it obeys. All tests share one renderer: software Vulkan
//! compiles each pass for half a second.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;

use std::sync::Arc;

use cloud::{Attribute, Chunk, Cloud, CloudLayout, Column, ColumnType, PointTest, pack_normal, pack_radius};
use glam::{DMat3, DVec2, DVec3, Vec3};
use param::{Kind, Value};
use render::{Aov, ColorPlan, Effort, Frame, Material, Objects, PointStore};
use scene::{Camera, Settings};

use stage::Stage;

const SIZE: [u32; 2] = [160, 120];

/// A point in the form in which tests write it.
#[derive(Clone, Copy)]
struct Point {
    position: DVec3,
    normal: Vec3,
    color: [u8; 3],
    radius: f32,
}

fn chunk(points: &[Point], origin: DVec3) -> Chunk {
    let offset = |point: &Point| (point.position - origin).as_vec3().to_array();
    let mut chunk = Chunk::new(0, origin, points.iter().map(offset).collect());
    chunk.colors =
        Some(Arc::new(points.iter().map(|point| [point.color[0], point.color[1], point.color[2], 255]).collect()));
    chunk.normals = Some(Arc::new(points.iter().map(|point| pack_normal(point.normal)).collect()));
    chunk.radii = Some(Arc::new(points.iter().map(|point| pack_radius(point.radius)).collect()));
    chunk
}

/// A store with one cloud of these chunks, coloured by RGB, and drawn.
fn draw(stage: &mut Stage, chunks: Vec<Chunk>, camera: &Camera, settings: &Settings) -> (PointStore, Vec<u8>) {
    let mut store = PointStore::new(stage.gpu.clone());
    let id = store.add_cloud(Material::default());
    let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
    let cloud = Cloud { chunks, ..Cloud::default() };
    let (plan, _) = ColorPlan::new(&cloud, &settings.color, DVec3::Z);
    store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
    let frame = Frame::new(camera, settings, Objects::default(), SIZE);
    stage.renderer.render(&store, &Frame { effort: stage.effort, ..frame }).unwrap();
    let picture = stage.renderer.read_picture().unwrap();
    (store, picture)
}

/// A number from 0 to 1.
fn random(seed: u64) -> f64 {
    cloud::hash(seed) as f64 / u64::MAX as f64
}

/// A bumpy ball with colours and normals, densely sampled, in random order.
fn ball(count: u64) -> Vec<Point> {
    let point = |i: u64| {
        let z = 2.0 * random(i * 4) - 1.0;
        let angle = random(i * 4 + 1) * std::f64::consts::TAU;
        let ring = (1.0 - z * z).sqrt();
        let direction = DVec3::new(ring * angle.cos(), ring * angle.sin(), z);
        let color = [random(i * 4 + 2), z * 0.5 + 0.5, random(i * 4 + 3)].map(|c| (c * 255.0) as u8);
        Point { position: direction * (1.0 + 0.1 * (5.0 * z).sin()), normal: direction.as_vec3(), color, radius: 0.05 }
    };
    (0..count).map(point).collect()
}

fn front_camera() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::new(0.3, -1.0, 0.4), 3.0, DVec3::Z)
}

fn settings(pairs: &[(&str, &str)]) -> Settings {
    let mut settings = Settings::default();
    for (key, value) in pairs {
        settings.set_text(key, value).unwrap();
    }
    settings
}

fn most_different(a: &[u8], b: &[u8]) -> u8 {
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

/// The share of the bytes that differ by more than `levels`.
fn share_different(a: &[u8], b: &[u8], levels: u8) -> f64 {
    a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > levels).count() as f64 / a.len() as f64
}

#[test]
fn a_point_lands_on_the_pixel_and_depth_that_the_pinhole_formula_gives() {
    let mut stage = stage_or_skip!();
    for (projection, quality) in [("perspective", "nearest"), ("perspective", "high"), ("orthographic", "high")] {
        let settings =
            settings(&[("view.projection", projection), ("splat.quality", quality), ("view.field_of_view", "50")]);
        let camera = front_camera();
        for i in 0..10 {
            let position = DVec3::new(random(i), random(i + 100), random(i + 200)) - 0.5;
            let point = Point { position, normal: Vec3::ZERO, color: [255; 3], radius: 1e-4 };
            draw(&mut stage, vec![chunk(&[point], DVec3::ZERO)], &camera, &settings);
            let depth = stage.renderer.read_aov(Aov::Depth).unwrap();
            let hit: Vec<usize> = (0..depth.data.len()).filter(|pixel| !depth.data[*pixel].is_nan()).collect();
            let view = camera.view_from_world() * (position - camera.eye);
            let half_height =
                25_f64.to_radians().tan() * if projection == "perspective" { view.z } else { camera.distance() };
            let expected = DVec2::new(80.0 + view.x / half_height * 60.0, 60.0 - view.y / half_height * 60.0).floor();
            assert_eq!(hit, [(expected.y * 160.0 + expected.x) as usize], "{projection} {quality}");
            if projection == "perspective" {
                assert!((f64::from(depth.data[hit[0]]) / view.z - 1.0).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn a_sampled_plane_has_its_own_depth_normal_and_position_at_every_pixel() {
    let mut stage = stage_or_skip!();
    let normal = DVec3::new(0.4, -1.0, 0.3).normalize();
    let (side, other) = normal.any_orthonormal_pair();
    let point = |i: u32| {
        let (a, b) = (f64::from(i % 300) / 300.0 - 0.5, f64::from(i / 300) / 300.0 - 0.5);
        Point { position: side * a * 12.0 + other * b * 12.0, normal: normal.as_vec3(), color: [200; 3], radius: 0.12 }
    };
    let points: Vec<Point> = (0..90_000).map(point).collect();
    let camera = front_camera();
    for (projection, quality) in [("perspective", "high"), ("perspective", "nearest"), ("orthographic", "high")] {
        let settings = settings(&[("view.projection", projection), ("splat.quality", quality)]);
        draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &camera, &settings);
        let position = stage.renderer.read_aov(Aov::Position).unwrap();
        let normals = stage.renderer.read_aov(Aov::Normal).unwrap();
        for (at, n) in position.data.chunks_exact(3).zip(normals.data.chunks_exact(3)) {
            let at = Vec3::from_slice(at).as_dvec3();
            assert!(at.is_finite(), "{quality}: no holes");
            assert!(at.dot(normal).abs() < 2e-5, "{projection} {quality}: {} off the plane", at.dot(normal));
            assert!(Vec3::from_slice(n).as_dvec3().angle_between(normal).to_degrees() < 0.06, "{quality}: normal");
        }
    }
}

#[test]
fn point_order_does_not_change_the_picture() {
    let mut stage = stage_or_skip!();
    let points = ball(30_000);
    let mut shuffled = points.clone();
    shuffled.sort_by_key(|point| (point.position.x * 1e6) as i64);
    for (quality, atomics) in [("nearest", "auto"), ("high", "auto"), ("nearest", "32"), ("high", "32")] {
        let settings = settings(&[("splat.quality", quality), ("splat.atomics", atomics)]);
        let (_, a) = draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &front_camera(), &settings);
        let (_, b) = draw(&mut stage, vec![chunk(&shuffled, DVec3::ZERO)], &front_camera(), &settings);
        assert_eq!(most_different(&a, &b), 0, "{quality}, atomics {atomics}");
    }
}

#[test]
fn chunks_of_any_size_give_the_same_picture() {
    let mut stage = stage_or_skip!();
    let points = ball(30_000);
    let settings = Settings::default();
    let (_, whole) = draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &front_camera(), &settings);
    let parts = points.chunks(1777).map(|part| chunk(part, DVec3::ZERO)).collect();
    let (_, split) = draw(&mut stage, parts, &front_camera(), &settings);
    assert_eq!(most_different(&whole, &split), 0);
}

#[test]
fn a_scene_at_coordinates_of_seven_digits_looks_the_same_to_one_grey_level() {
    let mut stage = stage_or_skip!();
    let points = ball(30_000);
    let far = DVec3::new(6_326_726.0, 5_068_062.0, 2700.0);
    for quality in ["nearest", "high"] {
        let settings = settings(&[("splat.quality", quality)]);
        let (_, here) = draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &front_camera(), &settings);
        let moved: Vec<Point> = points.iter().map(|point| Point { position: point.position + far, ..*point }).collect();
        let mut camera = front_camera();
        camera.eye += far;
        camera.pivot += far;
        let (_, there) = draw(&mut stage, vec![chunk(&moved, far)], &camera, &settings);
        // f64 itself has steps of a nanometre at that distance: a fragment in a thousand may change sides of a pixel's
        // edge.
        assert!(share_different(&here, &there, 1) < 1e-3, "{quality}: {}", share_different(&here, &there, 1));
    }
}

#[test]
fn turning_scene_and_camera_together_changes_nothing() {
    let mut stage = stage_or_skip!();
    let points = ball(30_000);
    let turn = DMat3::from_rotation_z(1.1) * DMat3::from_rotation_x(0.4);
    let turned = |point: &Point| Point {
        position: turn * point.position,
        normal: (turn * point.normal.as_dvec3()).as_vec3(),
        ..*point
    };
    let camera = front_camera();
    let turned_camera = Camera { eye: turn * camera.eye, pivot: turn * camera.pivot, up: turn * camera.up };
    let settings = Settings::default();
    let (_, a) = draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &camera, &settings);
    let points: Vec<Point> = points.iter().map(turned).collect();
    let (_, b) = draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &turned_camera, &settings);
    // Packed normals round differently once turned: two grey levels, and single fragments at splat rims.
    assert!(share_different(&a, &b, 2) < 5e-3, "{}", share_different(&a, &b, 2));
}

#[test]
fn atomics_of_32_and_64_bits_agree() {
    let mut stage = stage_or_skip!();
    let points = ball(30_000);
    for quality in ["nearest", "high"] {
        let mut picture_and_depths = |atomics: &str| {
            let settings = settings(&[("splat.quality", quality), ("splat.atomics", atomics)]);
            let (_, picture) = draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &front_camera(), &settings);
            (picture, stage.renderer.read_aov(Aov::Depth).unwrap().data)
        };
        let (wide, wide_depths) = picture_and_depths("auto");
        let (narrow, narrow_depths) = picture_and_depths("32");
        // Two passes that were compiled apart may round otherwise.
        for (pixel, (wide, narrow)) in wide_depths.iter().zip(&narrow_depths).enumerate() {
            let is_same = wide.to_bits().abs_diff(narrow.to_bits()) <= 8;
            assert!(is_same, "{quality}: the depth of pixel {pixel} is {narrow} instead of {wide}");
        }
        let different = share_different(&wide, &narrow, 0);
        assert!(different < 1e-3, "{quality}: {different} of the picture differs");
    }
}

#[test]
fn a_pick_gives_the_point_that_is_seen_not_one_behind_it() {
    let mut stage = stage_or_skip!();
    let points = ball(5_000);
    let parts = points.chunks(700).map(|part| chunk(part, DVec3::ZERO)).collect();
    let (store, _) = draw(&mut stage, parts, &front_camera(), &Settings::default());
    let position = stage.renderer.read_aov(Aov::Position).unwrap();
    for pixel in [[80, 60], [70, 50], [95, 66]] {
        let picked = stage.renderer.pick(&store, pixel, 0).unwrap().unwrap();
        let at = (pixel[1] * SIZE[0] + pixel[0]) as usize * 3;
        let seen = Vec3::from_slice(&position.data[at..at + 3]).as_dvec3();
        // Chunk ids count up from 0 in this store.
        let point = points[picked.chunk.0 as usize * 700 + picked.index];
        assert!(point.position.distance(seen) < 0.08, "{} for {seen}", point.position);
    }
    // No pick returns a point behind the visible one.
    for y in (0..SIZE[1]).step_by(3) {
        for x in (0..SIZE[0]).step_by(3) {
            let shown = position.data[((y * SIZE[0] + x) * 3) as usize];
            if let Some(picked) = stage.renderer.pick(&store, [x, y], 0).unwrap() {
                let place = picked.pixel;
                let at = ((place[1] * SIZE[0] + place[0]) * 3) as usize;
                let seen = Vec3::from_slice(&position.data[at..at + 3]).as_dvec3();
                let point = points[picked.chunk.0 as usize * 700 + picked.index];
                assert!(point.position.distance(seen) < 0.12, "{place:?}: {} for {seen}", point.position);
            } else {
                assert!(shown.is_nan(), "nothing picked at {x} {y}, where something is shown");
            }
        }
    }
    assert_eq!(stage.renderer.pick(&store, [1, 1], 2).unwrap(), None);
    assert_eq!(stage.renderer.pick(&store, [5000, 1], 2).unwrap(), None);
}

#[test]
fn hidden_classes_and_hidden_clouds_are_not_drawn() {
    let mut stage = stage_or_skip!();
    let points = ball(2_000);
    let mut store = PointStore::new(stage.gpu.clone());
    let cloud = store.add_cloud(Material::default());
    let classes: Vec<u8> = (0..2_000).map(|i| if i % 2 == 0 { 2 } else { 200 }).collect();
    let mut chunk = chunk(&points, DVec3::ZERO);
    chunk.columns = vec![None, Some(Arc::new(Column::U8(classes)))];
    let attribute = |name: &str| Attribute { name: name.into(), column_type: ColumnType::U8 };
    let attributes = vec![attribute("return_number"), attribute("classification")];
    let layout = Arc::new(CloudLayout { attributes, grid: None });
    store.add_chunk(cloud, &chunk, Some(&layout)).unwrap();
    let mut drawn = |store: &PointStore| {
        stage
            .renderer
            .render(
                store,
                &Frame::new(
                    &front_camera(),
                    &settings(&[("splat.max_pixels", "1"), ("splat.rest_pixels", "1")]),
                    Objects::default(),
                    SIZE,
                ),
            )
            .unwrap();
        stage.renderer.read_aov(Aov::Depth).unwrap().data.iter().filter(|depth| !depth.is_nan()).count()
    };
    let all = drawn(&store);
    let hiding = |classes: &[u8]| PointTest::hiding(classes.iter().copied());
    store.set_visibility(&hiding(&[200]));
    let half = drawn(&store);
    assert!(half > all / 3 && half < all * 3 / 4, "{half} of {all}");
    store.set_visibility(&hiding(&[200, 2]));
    assert_eq!(drawn(&store), 0);
    assert!(store.bounds().is_empty());
    // Points without a class are not hidden by the class that they have on the GPU.
    let bare = store.add_cloud(Material::default());
    store.add_chunk(bare, &chunk, None).unwrap();
    store.set_visibility(&hiding(&[200, 2, 0]));
    assert_eq!(drawn(&store), all);
    store.remove_cloud(bare);
    store.set_visibility(&hiding(&[]));
    store.set_visible(cloud, false);
    assert_eq!(drawn(&store), 0);
}

#[test]
fn a_thinned_picture_covers_about_as_much_with_fewer_points_and_leaves_no_trace() {
    let mut stage = stage_or_skip!();
    let mut store = PointStore::new(stage.gpu.clone());
    let cloud = store.add_cloud(Material::default());
    let mut large = chunk(&ball(20_000), DVec3::ZERO);
    large.radii = Some(Arc::new(vec![pack_radius(0.03); 20_000]));
    store.add_chunk(cloud, &large, None).unwrap();
    let speck = store.add_cloud(Material::default());
    store.add_chunk(speck, &chunk(&ball(1), DVec3::Z * -0.5), None).unwrap();
    let (camera, settings) = (front_camera(), settings(&[("splat.quality", "nearest")]));
    let mut drawn = |most_points| {
        let frame = Frame::new(&camera, &settings, Objects::default(), SIZE);
        let frame = Frame { effort: Effort { most_points, ..Effort::FULL }, ..frame };
        let stats = stage.renderer.render(&store, &frame).unwrap();
        let depth = stage.renderer.read_aov(Aov::Depth).unwrap().data;
        let covered = depth.iter().filter(|depth| !depth.is_nan()).count();
        (stats.points_drawn, covered, stage.renderer.read_picture().unwrap())
    };
    let (all, covered, picture) = drawn(None);
    for (most, step) in [(10_001, 2), (2_501, 8), (700, 29), (1, 64)] {
        let (points, thinly_covered, _) = drawn(Some(most));
        // Each of the blocks keeps its first point.
        assert!((all / step..=all / step + 21).contains(&points), "{points} of {most}");
        let ratio = thinly_covered as f64 / covered as f64;
        assert!((0.7..1.5).contains(&ratio), "{most}: {ratio}");
    }
    assert_eq!(drawn(Some(1_000_000)), (all, covered, picture.clone()), "enough for all");
    drawn(Some(100));
    assert_eq!(drawn(None), (all, covered, picture), "the picture after a thinned one");
}

/// Points without colours in a line from left to right.
fn line(count: i32) -> Chunk {
    let point = |i: i32| {
        let position = DVec3::new(f64::from(2 * i) / f64::from(count) - 1.0, 0.0, 0.0);
        Point { position, normal: Vec3::ZERO, color: [0; 3], radius: 0.01 }
    };
    chunk(&(0..count).map(point).collect::<Vec<_>>(), DVec3::ZERO)
}

/// The settings of a line whose colours are shown without light.
fn unlit(pairs: &[(&str, &str)]) -> Settings {
    let mut settings = settings(&[pairs, &[("edl.strength", "0")]].concat());
    settings.light.headlight = 0.0;
    settings
}

/// The albedo of each pixel of a line that is coloured by the settings; NaN where nothing is. Returns it with the plan
/// of the colours and what that warns of.
fn albedo_of(stage: &mut Stage, cloud: &Cloud, settings: &Settings) -> (Vec<[f32; 3]>, ColorPlan, Option<String>) {
    let mut store = PointStore::new(stage.gpu.clone());
    let id = store.add_cloud(Material::default());
    let ids = [store.add_chunk(id, &cloud.chunks[0], None).unwrap()];
    let (plan, warning) = ColorPlan::new(cloud, &settings.color, DVec3::Z);
    store.set_color(id, cloud, &ids, &plan, DVec3::Z).unwrap();
    let camera = Camera::looking(DVec3::ZERO, -DVec3::Y, 2.2, DVec3::Z);
    stage.renderer.render(&store, &Frame::new(&camera, settings, Objects::default(), SIZE)).unwrap();
    (stage.renderer.read_aov(Aov::Albedo).unwrap().data.as_chunks().0.to_vec(), plan, warning)
}

/// The pixels of a row through a line that show a point.
fn row_of(albedo: &[[f32; 3]]) -> Vec<[f32; 3]> {
    albedo[60 * SIZE[0] as usize..][..SIZE[0] as usize].iter().filter(|albedo| !albedo[0].is_nan()).copied().collect()
}

#[test]
fn an_attribute_of_large_values_is_coloured_across_its_whole_ramp() {
    let mut stage = stage_or_skip!();
    // GPS times of ten digits that differ by milliseconds: f32 alone would make them one colour.
    let mut chunk = line(256);
    let times = (0..256).map(|i| 1_234_567_890.0 + f64::from(i) * 1e-3).collect();
    chunk.columns = vec![Some(Arc::new(Column::F64(times)))];
    let attributes = vec![Attribute { name: "gps_time".into(), column_type: ColumnType::F64 }];
    let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
    let settings = unlit(&[("color.by", "gps-time"), ("color.ramp", "gray"), ("color.low", "0"), ("color.high", "1")]);
    let (albedo, ..) = albedo_of(&mut stage, &cloud, &settings);
    let shown: Vec<f32> = row_of(&albedo).into_iter().map(|albedo| albedo[0]).collect();
    assert!(shown.len() > 90 && shown[0] < 0.002 && shown[shown.len() - 1] > 0.97, "{shown:?}");
    assert!(shown.windows(2).all(|pair| pair[1] > pair[0] - 0.01), "rises from left to right: {shown:?}");
}

#[test]
fn points_without_a_value_are_plain_among_those_on_a_ramp() {
    let mut stage = stage_or_skip!();
    // The left half has values, and the right half none.
    let mut chunk = line(256);
    let heights = (0..256).map(|i| if i < 128 { i as f32 } else { f32::NAN }).collect();
    chunk.columns = vec![Some(Arc::new(Column::F32(heights)))];
    let attributes = vec![Attribute { name: "height_above".into(), column_type: ColumnType::F32 }];
    let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
    for quality in ["nearest", "high"] {
        let settings = unlit(&[
            ("color.by", "attribute"),
            ("color.attribute", "height_above"),
            ("color.ramp", "gray"),
            ("color.plain", "#ff0000"),
            ("splat.quality", quality),
        ]);
        let (albedo, plan, warning) = albedo_of(&mut stage, &cloud, &settings);
        assert_eq!((plan.full_range, warning), ((0.0, 127.0), None));
        assert_eq!(plan.histogram(&cloud, DVec3::Z, 4).0.iter().sum::<u32>(), 128);
        let shown = row_of(&albedo);
        let is_red = |albedo: &&[f32; 3]| albedo[0] > 0.99 && albedo[1] < 0.01;
        let red = shown.iter().rev().take_while(is_red).count();
        assert!(shown.len() > 90 && red.abs_diff(shown.len() / 2) < 3, "{quality}: {red} of {}", shown.len());
        let grey = &shown[..shown.len() - red - 2];
        assert!(grey.iter().all(|albedo| (albedo[0] - albedo[1]).abs() < 0.01), "{quality}: {grey:?}");
    }
}

#[test]
fn lone_strays_and_mixed_pixels_have_colours_of_their_own() {
    let mut stage = stage_or_skip!();
    // The left part is on a surface, then come lone strays, then mixed pixels.
    let mut chunk = line(384);
    let kinds = [cloud::pack_radius(0.01), cloud::STRAY_RADIUS, cloud::MIXED_RADIUS];
    chunk.radii = Some(Arc::new((0..384).map(|i| kinds[i / 128]).collect()));
    let cloud = Cloud { chunks: vec![chunk], ..Cloud::default() };
    for by in ["stray", "attribute"] {
        let settings = unlit(&[("color.by", by), ("color.attribute", "stray"), ("splat.quality", "nearest")]);
        let (albedo, plan, warning) = albedo_of(&mut stage, &cloud, &settings);
        assert_eq!((plan.label.as_str(), warning), ("stray", None));
        let shown: Vec<[f32; 3]> = albedo.into_iter().filter(|albedo| !albedo[0].is_nan()).collect();
        // Grey, magenta and orange, and nothing else.
        let counts = [[0.402, 0.402, 0.402], [1.0, 0.045, 0.578], [1.0, 0.305, 0.0]].map(|kind: [f32; 3]| {
            let is_kind = |albedo: &&[f32; 3]| albedo.iter().zip(kind).all(|(one, other)| (one - other).abs() < 0.01);
            shown.iter().filter(is_kind).count()
        });
        assert!(counts.iter().all(|count| *count > 20), "{by}: {counts:?}");
        assert_eq!(counts.iter().sum::<usize>(), shown.len(), "{by}");
    }
}

#[test]
fn raw_colours_come_back_exactly_when_light_is_off() {
    let mut stage = stage_or_skip!();
    // A board of every grey level, and its opposite, squares apart.
    let point = |i: u32| Point {
        position: DVec3::new(f64::from(i % 16) - 7.5, 0.0, f64::from(i / 16) - 7.5) * 0.2,
        normal: Vec3::NEG_Y,
        color: [i as u8, 255 - i as u8, (i * 7) as u8],
        radius: 0.08,
    };
    let points: Vec<Point> = (0..256).map(point).collect();
    let camera = Camera::looking(DVec3::ZERO, -DVec3::Y, 4.0, DVec3::Z);
    let focal = 60.0 / 30_f64.to_radians().tan();
    for quality in ["nearest", "high"] {
        for by in ["colors", "headlight"] {
            let settings = settings(&[
                ("splat.quality", quality),
                ("light.by", by),
                ("light.headlight", "0"),
                ("edl.strength", "0"),
            ]);
            let (_, picture) = draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &camera, &settings);
            for point in &points {
                let at = [80.0 + point.position.x / 4.0 * focal, 60.0 - point.position.z / 4.0 * focal];
                let pixel = (at[1] as usize * SIZE[0] as usize + at[0] as usize) * 4;
                assert_eq!(picture[pixel..pixel + 3], point.color, "{quality}, {by}");
            }
        }
    }
}

#[test]
fn a_specular_cloud_is_a_mirror_in_both_qualities() {
    let mut stage = stage_or_skip!();
    for quality in ["nearest", "high"] {
        let mut store = PointStore::new(stage.gpu.clone());
        let mirror = store.add_cloud(Material { specular_intensity: 1.0, ..Default::default() });
        store.add_chunk(mirror, &chunk(&ball(5_000), DVec3::ZERO), None).unwrap();
        let wall = store.add_cloud(Material::default());
        let shifted = |point: Point| Point { position: point.position + DVec3::X * 2.5, ..point };
        let shifted: Vec<Point> = ball(5_000).into_iter().map(shifted).collect();
        store.add_chunk(wall, &chunk(&shifted, DVec3::ZERO), None).unwrap();
        stage
            .renderer
            .render(
                &store,
                &Frame::new(&front_camera(), &settings(&[("splat.quality", quality)]), Objects::default(), SIZE),
            )
            .unwrap();
        let mask = stage.renderer.read_aov(Aov::Mirror).unwrap().data;
        assert_eq!(mask[60 * 160 + 80], 1.0, "{quality}");
        assert!(mask.contains(&0.0) && mask[0].is_nan(), "{quality}");
    }
}

#[test]
fn poisoned_points_and_every_end_of_every_parameter_give_a_finite_picture() {
    let mut stage = stage_or_skip!();
    let mut points = ball(500);
    for (i, poison) in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e38, -1e38, 1e-45].into_iter().enumerate() {
        points[i].position.x = poison;
        points[i + 20].normal = Vec3::splat(poison as f32);
        points[i + 40].radius = poison as f32;
    }
    for params in Settings::default().groups() {
        let group = params.group();
        for field in &group.fields {
            let ends = match &field.kind {
                Kind::F32 { min, max, .. } => vec![Value::F32(*min), Value::F32(*max)],
                Kind::U32 { min, .. } => vec![Value::U32(*min)],
                Kind::Choice { names, .. } => (0..names.len() as u32).map(Value::Choice).collect(),
                _ => continue,
            };
            for end in ends {
                let (key, text) = (format!("{}.{}", group.name, field.name), field.format(&end));
                draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &front_camera(), &settings(&[(&key, &text)]));
                let depth = stage.renderer.read_aov(Aov::Depth).unwrap();
                for aov in [Aov::Color, Aov::Normal, Aov::Depth] {
                    let image = stage.renderer.read_aov(aov).unwrap();
                    for (pixel, values) in image.data.chunks_exact(image.channels.len()).enumerate() {
                        let empty = depth.data[pixel].is_nan();
                        assert!(empty || values.iter().all(|value| value.is_finite()), "{key}={text}: {aov:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn gaps_between_splats_are_closed_and_outlines_stay() {
    let mut stage = stage_or_skip!();
    // A wall with every seventh point missing, in front of a far one; and nothing beside it.
    let camera = Camera::looking(DVec3::ZERO, -DVec3::Y, 4.0, DVec3::Z);
    let pixel = 2.0 * 4.0 * 30_f64.to_radians().tan() / 120.0;
    let wall = |depth: f64, gap: u32, color| {
        let at = move |i: u32| DVec3::new((f64::from(i % 80) - 39.5) * pixel, 0.0, (f64::from(i / 80) - 39.5) * pixel);
        let point = move |i| Point {
            position: camera.eye + (at(i) - camera.eye) * depth,
            normal: Vec3::NEG_Y,
            color,
            radius: 1e-5,
        };
        (0..6400).filter(move |i| gap == 0 || i % gap != 3).map(point)
    };
    let points: Vec<Point> = wall(1.0, 7, [200, 0, 0]).chain(wall(2.0, 0, [0, 200, 0])).collect();
    let count = |stage: &mut Stage, close: &str| {
        let settings = settings(&[("splat.close_gaps", close), ("light.headlight", "0"), ("edl.strength", "0")]);
        draw(stage, vec![chunk(&points, DVec3::ZERO)], &camera, &settings);
        let albedo = stage.renderer.read_aov(Aov::Albedo).unwrap().data;
        let red = albedo.chunks_exact(3).filter(|rgb| rgb[0] > 0.1).count();
        (
            red,
            albedo.chunks_exact(3).filter(|rgb| rgb[1] > 0.1).count(),
            albedo.chunks_exact(3).filter(|rgb| rgb[0].is_nan()).count(),
        )
    };
    let (red, green, empty) = count(&mut stage, "false");
    assert_eq!((red, green, empty), (5486, 914, 160 * 120 - 6400));
    let (red, green, empty) = count(&mut stage, "true");
    // Along the outline a gap has three to five neighbours of its surface: those gaps stay open, all others close.
    assert!(red > 6330 && red + green == 6400 && empty == 160 * 120 - 6400, "{red} {green} {empty}");
}

/// The pixels that show a near wall of red discs, a far green one through its hole, and nothing. The wall is seen at an angle
/// of 30 degrees; its discs are `spacing` apart and three quarters of that wide, and those within `half` of its middle are
/// missing.
fn seen_through_a_hole(stage: &mut Stage, spacing: f64, half: f64, close: &str) -> [Vec<usize>; 3] {
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.5, -3_f64.sqrt() / 2.0, 0.0), 4.0, DVec3::Z);
    let steps = (1.6 / spacing) as i32;
    let grid = |spacing: f64, steps: i32, depth: f64, color| {
        let along = (-steps..=steps).flat_map(move |x| (-steps..=steps).map(move |z| [x, z].map(f64::from)));
        along.map(move |[x, z]| Point {
            position: DVec3::new(x * spacing, depth, z * spacing),
            normal: Vec3::NEG_Y,
            color,
            radius: (0.75 * spacing) as f32,
        })
    };
    let is_left = |point: &Point| point.position.x.abs() > half || point.position.z.abs() > half;
    let near = grid(spacing, steps, 0.0, [200, 0, 0]).filter(is_left);
    let points: Vec<Point> = near.chain(grid(0.1, 60, 2.0, [0, 200, 0])).collect();
    let pairs =
        [("splat.close_gaps", close), ("light.headlight", "0"), ("edl.strength", "0"), ("view.field_of_view", "60")];
    draw(stage, vec![chunk(&points, DVec3::ZERO)], &camera, &settings(&pairs));
    let albedo = stage.renderer.read_aov(Aov::Albedo).unwrap().data;
    let of = |is_of: fn(&[f32]) -> bool| {
        albedo.chunks_exact(3).enumerate().filter(|(_, rgb)| is_of(rgb)).map(|(pixel, _)| pixel).collect()
    };
    [of(|rgb| rgb[0] > 0.1 && rgb[1] < 0.05), of(|rgb| rgb[1] > 0.1 && rgb[0] < 0.05), of(|rgb| rgb[0].is_nan())]
}

#[test]
fn holes_close_that_are_narrower_than_their_surface_is_sampled_and_windows_stay() {
    let mut stage = stage_or_skip!();
    // One disc of a wall is missing: what lies behind it shows through a hole of a third of a disc.
    let [[before, hole, _], [wall, through, _]] =
        ["false", "true"].map(|close| seen_through_a_hole(&mut stage, 0.2, 0.05, close));
    let middle = 60 * 160 + 80;
    assert!(hole.contains(&middle) && !through.contains(&middle) && wall.contains(&middle), "{hole:?}");
    let depth = stage.renderer.read_aov(Aov::Depth).unwrap().data[middle];
    assert!((depth - 4.0).abs() < 0.02, "the wall's plane at the hole: {depth}");
    assert!(before.iter().all(|pixel| wall.contains(pixel)), "nothing of the wall is lost");
    // A window of the same wall is many discs wide, and so is a smaller one of a wall of denser points. Of both, notches
    // between the discs of the outline, several hundred pixels long, are filled.
    for (spacing, half) in [(0.2, 0.7), (0.02, 0.2)] {
        let [[_, hole, beside], [_, through, beside_after]] =
            ["false", "true"].map(|close| seen_through_a_hole(&mut stage, spacing, half, close));
        assert!(hole.contains(&middle) && through.contains(&middle), "{spacing}: the middle of the window");
        let lost = hole.iter().filter(|pixel| !through.contains(pixel)).count();
        assert!(lost <= 40, "{spacing}: {lost} pixels that show what lies behind");
        assert!(beside.len().abs_diff(beside_after.len()) <= 10, "{spacing}: the outline of the picture's surfaces");
    }
}

#[test]
fn a_pixel_takes_a_hundred_thousand_points_as_it_takes_one() {
    let mut stage = stage_or_skip!();
    let normal = Vec3::new(0.3, -1.0, 0.4).normalize();
    let at = Point { position: DVec3::ZERO, normal, color: [250, 90, 255], radius: 1e-6 };
    let camera = front_camera();
    for discs in ["1", "3"] {
        // Pairs of sums where the adapter adds to 64 bits, and each for itself.
        let both = ["auto", "32"].map(|atomics| {
            let settings =
                settings(&[("splat.min_pixels", discs), ("splat.max_pixels", discs), ("splat.atomics", atomics)]);
            let mut seen = |count| {
                draw(&mut stage, vec![chunk(&vec![at; count], DVec3::ZERO)], &camera, &settings);
                [Aov::Albedo, Aov::Normal].map(|aov| stage.renderer.read_aov(aov).unwrap().data)
            };
            let [one, many] = [1, 100_000].map(&mut seen);
            for (one, many) in one.iter().zip(&many) {
                let differences =
                    one.iter().zip(many).filter(|(a, b)| !(a.is_nan() && b.is_nan() || (*a - *b).abs() < 2e-3));
                assert_eq!(differences.count(), 0, "discs of {discs} pixels, atomics {atomics}");
            }
            many.map(|data| data.into_iter().map(f32::to_bits).collect::<Vec<u32>>())
        });
        assert!(both[0] == both[1], "sums in pairs are others, discs of {discs} pixels");
    }
}

#[test]
fn a_parallel_picture_does_not_depend_on_where_along_the_line_of_sight_the_eye_is() {
    let mut stage = stage_or_skip!();
    let points = ball(30_000);
    let settings = settings(&[("view.projection", "orthographic")]);
    let near = front_camera();
    let (_, a) = draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &near, &settings);
    let at = |stage: &Stage| stage.renderer.read_aov(Aov::Depth).unwrap().data[60 * 160 + 80];
    let depth = at(&stage);
    // The zoom goes through the ball: the pivot's distance, which sets the scale, stays.
    let shift = near.forward() * 2.5;
    let inside = Camera { eye: near.eye + shift, pivot: near.pivot + shift, ..near };
    let (_, b) = draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &inside, &settings);
    assert!(share_different(&a, &b, 2) < 2e-3, "{}", share_different(&a, &b, 2));
    assert!((depth - at(&stage) - 2.5).abs() < 1e-3, "depths are the camera's own");
}

#[test]
fn splats_widened_on_the_screen_reach_in_from_beyond_its_edge() {
    let mut stage = stage_or_skip!();
    let settings = settings(&[("splat.min_pixels", "40")]);
    let camera = Camera::looking(DVec3::ZERO, -DVec3::Y, 4.0, DVec3::Z);
    // Ten pixels beyond the right edge.
    let x = 90.0 / 60.0 * 4.0 * 30_f64.to_radians().tan();
    let point = Point { position: DVec3::new(x, 0.0, 0.0), normal: Vec3::NEG_Y, color: [255; 3], radius: 1e-4 };
    draw(&mut stage, vec![chunk(&[point], DVec3::ZERO)], &camera, &settings);
    let covered = stage.renderer.read_aov(Aov::Depth).unwrap().data.iter().filter(|depth| !depth.is_nan()).count();
    assert!(covered > 100, "{covered}");
}

#[test]
fn an_empty_store_shows_the_background() {
    let mut stage = stage_or_skip!();
    let store = PointStore::new(stage.gpu.clone());
    for quality in ["nearest", "high"] {
        let settings = settings(&[("splat.quality", quality), ("view.background", "#123456")]);
        stage.renderer.render(&store, &Frame::new(&front_camera(), &settings, Objects::default(), SIZE)).unwrap();
        assert_eq!(stage.renderer.read_picture().unwrap()[..4], [0x12, 0x34, 0x56, 255]);
    }
}

#[test]
fn removed_clouds_give_their_room_back() {
    let stage = stage_or_skip!();
    let mut store = PointStore::new(stage.gpu.clone());
    let points = ball(60_000);
    let first = store.add_cloud(Material::default());
    store.add_chunk(first, &chunk(&points, DVec3::ZERO), None).unwrap();
    let bytes = store.gpu_bytes();
    for _ in 0..40 {
        let cloud = store.add_cloud(Material::default());
        store.add_chunk(cloud, &chunk(&points, DVec3::ZERO), None).unwrap();
        store.remove_cloud(cloud);
    }
    assert_eq!((store.points(), store.gpu_bytes()), (60_000, bytes));
    store.remove_cloud(first);
    assert_eq!((store.points(), store.gpu_bytes()), (0, 0));
    assert!(store.bounds().is_empty());
}

#[test]
fn chunks_that_come_and_go_for_long_stay_in_one_page_and_keep_picture_and_picks_right() {
    let mut stage = stage_or_skip!();
    let points = ball(60_000);
    let pool: Vec<Chunk> = (0..24)
        .map(|i| {
            let first = (random(i) * 30_000.0) as usize;
            chunk(&points[first..first + 1 + (random(i + 50) * 30_000.0) as usize], DVec3::ZERO)
        })
        .collect();
    let mut store = PointStore::new(stage.gpu.clone());
    let cloud = store.add_cloud(Material::default());
    // As many as fit into the smallest page.
    let most = 1 << 20;
    let room = |chunk: &Chunk| (chunk.len() as u64).next_multiple_of(1024);
    let mut held: Vec<(render::ChunkId, &Chunk)> = Vec::new();
    let taken = |held: &[(render::ChunkId, &Chunk)]| held.iter().map(|(_, chunk)| room(chunk)).sum::<u64>();
    for step in 0..700 {
        let next = &pool[(random(step + 1000) * 24.0) as usize % 24];
        while taken(&held) + room(next) > most {
            let gone = held.swap_remove((random(step + 2000) * held.len() as f64) as usize % held.len());
            store.remove_chunk(gone.0);
        }
        if step % 5 == 0 && !held.is_empty() {
            // Another number of its points.
            let index = step as usize % held.len();
            held[index].1 = next;
            if taken(&held) <= most {
                store.update_chunk(held[index].0, next, None).unwrap();
                continue;
            }
            held[index].1 = &pool[0];
            store.update_chunk(held[index].0, &pool[0], None).unwrap();
        }
        if taken(&held) + room(next) <= most {
            held.push((store.add_chunk(cloud, next, None).unwrap(), next));
        }
    }
    // 24 bytes a point, and a bit.
    assert_eq!(store.gpu_bytes(), most * 24 + most / 8);
    assert_eq!(store.points(), held.iter().map(|(_, chunk)| chunk.len() as u64).sum::<u64>());
    // The same chunks in a store of their own, in the order of their numbers.
    held.sort_by_key(|(id, _)| *id);
    let mut fresh = PointStore::new(stage.gpu.clone());
    let other = fresh.add_cloud(Material::default());
    for (_, chunk) in &held {
        fresh.add_chunk(other, chunk, None).unwrap();
    }
    let mut draw = |store: &PointStore| {
        stage.renderer.render(store, &Frame::new(&front_camera(), &settings(&[]), Objects::default(), SIZE)).unwrap();
        stage.renderer.read_picture().unwrap()
    };
    let expected = draw(&fresh);
    assert!(share_different(&draw(&store), &expected, 2) < 1e-3);
    let position = stage.renderer.read_aov(Aov::Position).unwrap();
    let mut picks = 0;
    for (x, y) in (20..140).step_by(12).flat_map(|x| (20..100).step_by(12).map(move |y| (x, y))) {
        let Some(picked) = stage.renderer.pick(&store, [x, y], 1).unwrap() else { continue };
        let at = ((picked.pixel[1] * SIZE[0] + picked.pixel[0]) * 3) as usize;
        let seen = Vec3::from_slice(&position.data[at..at + 3]).as_dvec3();
        let (_, chunk) = held.iter().find(|(id, _)| *id == picked.chunk).unwrap();
        assert!(chunk.position(picked.index).distance(seen) < 0.12, "{picked:?} for {seen}");
        picks += 1;
    }
    assert!(picks > 20, "{picks}");
    // A point that came after the picture is not picked from it.
    let picked = stage.renderer.pick(&store, [80, 60], 1).unwrap().unwrap();
    let (gone, chunk) = *held.iter().find(|(id, _)| *id == picked.chunk).unwrap();
    store.remove_chunk(gone);
    store.add_chunk(cloud, chunk, None).unwrap();
    let again = stage.renderer.pick(&store, [80, 60], 1).unwrap();
    assert!(again.is_none_or(|again| held.iter().any(|(id, _)| *id == again.chunk && *id != gone)), "{again:?}");
}

#[test]
fn colours_and_normals_that_stay_are_not_sent_again() {
    let mut stage = stage_or_skip!();
    let points = ball(30_000);
    let before = chunk(&points, DVec3::ZERO);
    let larger = Chunk { radii: Some(Arc::new(vec![pack_radius(0.1); points.len()])), ..before.clone() };
    let green = Chunk { colors: Some(Arc::new(vec![[0, 255, 0, 255]; points.len()])), ..larger.clone() };
    let bare = Chunk { colors: None, normals: None, ..green.clone() };
    let gpu = stage.gpu.clone();
    let mut store = PointStore::new(gpu.clone());
    let cloud = store.add_cloud(Material::default());
    let id = store.add_chunk(cloud, &before, None).unwrap();
    let mut sent = vec![store.uploaded_bytes()];
    let mut draw = |store: &PointStore| {
        stage.renderer.render(store, &Frame::new(&front_camera(), &settings(&[]), Objects::default(), SIZE)).unwrap();
        [Aov::Albedo, Aov::Normal, Aov::Depth].map(|aov| stage.renderer.read_aov(aov).unwrap().data)
    };
    for next in [&larger, &green, &bare, &bare] {
        store.update_chunk(id, next, None).unwrap();
        sent.push(store.uploaded_bytes());
        let mut fresh = PointStore::new(gpu.clone());
        let alone = fresh.add_cloud(Material::default());
        fresh.add_chunk(alone, next, None).unwrap();
        let bits = |images: [Vec<f32>; 3]| images.map(|image| image.into_iter().map(f32::to_bits).collect::<Vec<_>>());
        assert!(bits(draw(&store)) == bits(draw(&fresh)));
    }
    let sent: Vec<u64> = sent.windows(2).map(|sent| (sent[1] - sent[0]) / points.len() as u64).collect();
    assert_eq!(sent, [16, 24, 24, 16], "bytes a point");
}

#[test]
fn a_cloud_is_given_little_more_than_what_was_announced_of_it() {
    let stage = stage_or_skip!();
    let mut store = PointStore::new(stage.gpu.clone());
    store.reserve(3_000_000);
    let cloud = store.add_cloud(Material::default());
    store.add_chunk(cloud, &chunk(&ball(10), DVec3::ZERO), None).unwrap();
    assert!((3_000_000 * 24..3_600_000 * 24).contains(&store.gpu_bytes()), "{}", store.gpu_bytes());
    store.remove_cloud(cloud);
    store.reserve(10);
    let small = store.add_cloud(Material::default());
    store.add_chunk(small, &chunk(&ball(10), DVec3::ZERO), None).unwrap();
    let least = (24 << 20) + (1 << 17);
    assert_eq!(store.gpu_bytes(), least, "what was announced before counts no more");
}

#[test]
fn a_picture_too_large_for_the_adapter_is_a_named_error() {
    let mut stage = stage_or_skip!();
    let store = PointStore::new(stage.gpu.clone());
    let result = stage
        .renderer
        .render(&store, &Frame::new(&front_camera(), &Settings::default(), Objects::default(), [200_000, 10]));
    let error = result.unwrap_err().to_string();
    assert!(error.contains("ask for a smaller picture"), "{error}");
}

#[test]
fn a_scene_without_mirrors_runs_no_pass_of_reflections() {
    let mut stage = stage_or_skip!();
    let mut store = PointStore::new(stage.gpu.clone());
    let cloud = store.add_cloud(Default::default());
    store.add_chunk(cloud, &Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]]), None).unwrap();
    let stats = stage
        .renderer
        .render(&store, &Frame::new(&front_camera(), &Settings::default(), Objects::default(), SIZE))
        .unwrap();
    let passes: Vec<&str> = stats.passes.iter().map(|pass| pass.name).collect();
    assert!(passes.contains(&"present"), "{passes:?}");
    assert!(!passes.iter().any(|name| name.starts_with("mirror") || name.contains("trace")), "{passes:?}");
    assert_eq!(stats.reflection.unwrap().mirror_pixels, 0);
    let seen = stage.renderer.read_aov(Aov::MirrorPosition).unwrap();
    assert!(seen.data.iter().all(|value| value.is_nan()));
}

#[test]
fn a_large_disc_covers_the_pixels_and_depths_of_its_ellipse() {
    let mut stage = stage_or_skip!();
    let packed = pack_normal(Vec3::new(0.5, -1.0, 0.3).normalize());
    let normal = cloud::unpack_normal(packed).unwrap();
    let (position, radius) = (DVec3::new(0.1, 0.2, -0.1), 1.1);
    let disc = Point { position, normal, color: [200; 3], radius };
    let normal = normal.as_dvec3();
    let radius = f64::from(cloud::unpack_radius(pack_radius(radius)).unwrap());
    let camera = Camera::looking(DVec3::ZERO, -DVec3::Y, 2.2, DVec3::Z);
    let focal = 60.0 / 30_f64.to_radians().tan();
    let center = camera.view_from_world() * (position - camera.eye);
    let middle = DVec2::new(80.0 + focal * center.x / center.z, 60.0 - focal * center.y / center.z);
    for (quality, atomics) in [("nearest", "auto"), ("nearest", "32"), ("high", "auto")] {
        let settings = settings(&[
            ("splat.quality", quality),
            ("splat.atomics", atomics),
            ("splat.large", "shared"),
            ("splat.close_gaps", "false"),
            ("view.field_of_view", "60"),
        ]);
        draw(&mut stage, vec![chunk(&[disc], DVec3::ZERO)], &camera, &settings);
        let depth = stage.renderer.read_aov(Aov::Depth).unwrap().data;
        let mut covered = 0;
        for (pixel, depth) in depth.iter().enumerate() {
            let at = DVec2::new((pixel % 160) as f64 + 0.5, (pixel / 160) as f64 + 0.5);
            let slope = DVec3::new((at.x - 80.0) / focal, (60.0 - at.y) / focal, 1.0);
            let direction = camera.view_from_world().transpose() * slope;
            let expected = normal.dot(position - camera.eye) / normal.dot(direction);
            let outside = (camera.eye + direction * expected).distance(position) / radius;
            // Pixels are looked for in the square about a ball of that radius; the near side of the ellipse may leave it.
            let aside = (at - middle).abs().max_element() / (radius * focal / center.z);
            if (outside - 1.0).abs() > 1e-3 && (aside - 1.0).abs() > 1e-3 {
                assert_eq!(
                    !depth.is_nan(),
                    outside < 1.0 && aside < 1.0,
                    "{quality} {atomics}: pixel {at}, {outside} radii"
                );
            }
            if !depth.is_nan() {
                covered += 1;
                // The nearest of all points is found with discs that are hollow by a thousandth of the radius.
                let error = f64::from(*depth) - expected;
                assert!((-1e-4..1.1e-3 * radius).contains(&error), "{quality} {atomics}: {error} at {at}");
            }
        }
        assert!(covered > 5_000, "{covered} pixels");
    }
}

#[test]
fn a_near_wall_is_closed_at_rest_and_capped_while_moving() {
    let mut stage = stage_or_skip!();
    let point = |i: u32| Point {
        position: DVec3::new(f64::from(i % 9) - 4.0, 0.0, f64::from(i / 9) - 4.0),
        normal: Vec3::NEG_Y,
        color: [(i * 3) as u8, 90, 200],
        radius: 0.8,
    };
    let wall: Vec<Point> = (0..81).map(point).collect();
    let camera = Camera::looking(DVec3::ZERO, -DVec3::Y, 1.7, DVec3::Z);
    let near = |stage: &mut Stage, pairs: &[(&str, &str)], moves: bool| {
        let settings = settings(&[pairs, &[("view.field_of_view", "60"), ("splat.close_gaps", "false")]].concat());
        stage.effort.most_points = moves.then_some(u64::MAX);
        let (_, picture) = draw(stage, vec![chunk(&wall, DVec3::ZERO)], &camera, &settings);
        stage.effort = Effort::FULL;
        let depth = stage.renderer.read_aov(Aov::Depth).unwrap().data;
        (depth.iter().filter(|depth| depth.is_nan()).count(), picture)
    };
    for quality in ["nearest", "high"] {
        let quality = ("splat.quality", quality);
        assert_eq!(near(&mut stage, &[quality], false).0, 0);
        let (moving, capped) = (near(&mut stage, &[quality], true), [quality, ("splat.rest_pixels", "1")]);
        assert!(moving.0 > 1_000, "{} pixels are open", moving.0);
        assert_eq!(near(&mut stage, &capped, false), moving);
        // A workgroup makes the same picture as one invocation, with small discs and with large ones.
        for size in ["1", "0.2"].map(|size| ("splat.size", size)) {
            let [alone, shared] =
                ["alone", "shared"].map(|large| near(&mut stage, &[quality, size, ("splat.large", large)], false));
            assert!(alone == shared, "{quality:?} {size:?}");
        }
    }
}

#[test]
fn of_discs_that_fill_the_picture_the_nearest_one_is_seen_everywhere() {
    // Each has more pixels than the 65,535 turns after which software Vulkan ends all loops of an invocation, and the
    // nearest comes last.
    let mut stage = stage_or_skip!();
    const COUNT: i32 = 40;
    let point = |i: i32| Point {
        position: DVec3::Y * (f64::from(COUNT - 1 - i) * 0.02),
        normal: Vec3::NEG_Y,
        color: if i == COUNT - 1 { [200, 40, 40] } else { [40, 200, 40] },
        radius: 40.0,
    };
    let points: Vec<Point> = (0..COUNT).map(point).collect();
    let camera = Camera::looking(DVec3::ZERO, -DVec3::Y, 4.0, DVec3::Z);
    let settings = settings(&[("splat.quality", "nearest"), ("light.by", "colors"), ("edl.strength", "0")]);
    let mut store = PointStore::new(stage.gpu.clone());
    let cloud = store.add_cloud(Material::default());
    store.add_chunk(cloud, &chunk(&points, DVec3::ZERO), None).unwrap();
    let size = [400, 300];
    stage.renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), size)).unwrap();
    // Discs are hollow by a thousandth of their radius, which is 4 here.
    let depth = stage.renderer.read_aov(Aov::Depth).unwrap().data;
    let wrong = depth.iter().filter(|depth| (**depth - 4.0).abs() > 0.005).count();
    assert_eq!(wrong, 0, "of {} pixels, with {:?}", depth.len(), [0, 400, 60_200, 119_999].map(|pixel| depth[pixel]));
    let picked = stage.renderer.pick(&store, [3, 290], 0).unwrap().unwrap();
    assert_eq!(picked.index, COUNT as usize - 1);
}

#[test]
fn eye_dome_lighting_shows_no_steps_from_disc_to_disc_and_all_larger_ones() {
    let mut stage = stage_or_skip!();
    // A wall as rough as half a radius of its discs, and a board before it.
    let spot = |i: u32, step: f64, depth: f64| Point {
        position: DVec3::new(f64::from(i % 40) - 19.5, depth / step, f64::from(i / 40) - 19.5) * step,
        normal: Vec3::NEG_Y,
        color: [200; 3],
        radius: 0.15,
    };
    let wall = (0..1600).map(|i| spot(i, 0.1, if i % 9 == 0 { -0.07 } else { 0.0 }));
    let board = (0..1600).map(|i| spot(i, 0.01, -0.4));
    let camera = Camera::looking(DVec3::ZERO, -DVec3::Y, 1.5, DVec3::Z);
    let mut seen = |points: Vec<Point>, strength: &str, ignored: &str| {
        let settings = settings(&[
            ("splat.quality", "nearest"),
            ("light.by", "colors"),
            ("edl.strength", strength),
            ("edl.ignored", ignored),
        ]);
        draw(&mut stage, vec![chunk(&points, DVec3::ZERO)], &camera, &settings).1
    };
    let wall: Vec<Point> = wall.collect();
    let plain = seen(wall.clone(), "0", "1");
    assert_eq!(seen(wall.clone(), "0.4", "1"), plain);
    let ringed = share_different(&seen(wall.clone(), "0.4", "0"), &plain, 8);
    assert!(ringed > 0.05, "{ringed}");
    let both: Vec<Point> = wall.into_iter().chain(board).collect();
    let plain = seen(both.clone(), "0", "1");
    let outlined = share_different(&seen(both, "0.4", "1"), &plain, 8);
    assert!(outlined > 0.002 && outlined < 0.05, "{outlined}");
}

/// A level floor from x = 0 to 7 whose points lie a centimetre apart and 2.5 mm off it, with normals a few degrees off.
fn rough_floor() -> Vec<Point> {
    let normal_spread = |index: u64| random(index) + random(index + 1) + random(index + 2) - 1.5;
    let point = |index: u64| {
        let [x, y] = [index % 700, index / 700].map(|place| place as f64 * 0.01);
        let [dx, dy] = [1, 2].map(|axis| 0.006 * (random(index * 16 + axis) - 0.5));
        Point {
            // Sums of three have the spread of half a unit.
            position: DVec3::new(x + dx, y - 1.0 + dy, 0.005 * normal_spread(index * 16 + 3)),
            normal: DVec3::new(0.08 * normal_spread(index * 16 + 6), 0.08 * normal_spread(index * 16 + 9), 1.0)
                .normalize()
                .as_vec3(),
            color: [200; 3],
            radius: 0.0095,
        }
    };
    (0..700 * 200).map(point).collect()
}

/// A rectangle of points half a centimetre apart.
fn board(corner: DVec3, edges: [DVec3; 2]) -> impl Iterator<Item = Point> {
    let counts = edges.map(|edge| (edge.length() / 0.005).ceil() as u32);
    let normal = edges[0].cross(edges[1]).normalize().as_vec3();
    let at = |index: u32, count: u32| (f64::from(index) + 0.5) / f64::from(count);
    (0..counts[0] * counts[1]).map(move |index| Point {
        position: corner + edges[0] * at(index % counts[0], counts[0]) + edges[1] * at(index / counts[0], counts[1]),
        normal,
        color: [200; 3],
        radius: 0.005,
    })
}

/// The depths of a picture, and how much light eye-dome lighting leaves each pixel.
fn eye_dome(stage: &mut Stage, points: &[Point], camera: &Camera, quality: &str, size: [u32; 2]) -> [Vec<f64>; 2] {
    let mut store = PointStore::new(stage.gpu.clone());
    let chunks: Vec<Chunk> = points.chunks(65_536).map(|points| chunk(points, DVec3::ZERO)).collect();
    let id = store.add_cloud(Material::default());
    let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
    let cloud = Cloud { chunks, ..Cloud::default() };
    let mut draw = |strength: &str| {
        let settings = settings(&[("splat.quality", quality), ("light.by", "colors"), ("edl.strength", strength)]);
        let (plan, _) = ColorPlan::new(&cloud, &settings.color, DVec3::Z);
        store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
        stage.renderer.render(&store, &Frame::new(camera, &settings, Objects::default(), size)).unwrap();
        // Linear light of the sRGB values.
        let linear = |value: u8| ((f64::from(value) / 255.0 + 0.055) / 1.055).powf(2.4);
        let picture = stage.renderer.read_picture().unwrap();
        picture.chunks_exact(4).map(|color| linear(color[0])).collect::<Vec<f64>>()
    };
    let (lit, plain) = (draw("0.4"), draw("0"));
    let depths = stage.renderer.read_aov(Aov::Depth).unwrap().data.iter().map(|depth| f64::from(*depth)).collect();
    [depths, lit.iter().zip(&plain).map(|(lit, plain)| lit / plain).collect()]
}

#[test]
fn eye_dome_lighting_draws_no_rims_on_a_rough_plane_seen_at_one_to_ten_degrees() {
    let mut stage = stage_or_skip!();
    let (floor, size) = (rough_floor(), [320, 240]);
    for (height, quality) in [(0.05, "high"), (0.05, "nearest"), (0.3, "high"), (0.3, "nearest")] {
        let camera = Camera { eye: DVec3::new(-0.6, 0.0, height), pivot: DVec3::new(3.0, 0.0, 0.0), up: DVec3::Z };
        let [depths, light] = eye_dome(&mut stage, &floor, &camera, quality, size);
        let positions = stage.renderer.read_aov(Aov::Position).unwrap().data;
        let (mut seen, mut dark) = ([0; 3], [0; 3]);
        for (pixel, at) in positions.as_chunks::<3>().0.iter().enumerate().filter(|(pixel, _)| depths[*pixel] > 0.0) {
            let at = Vec3::from(*at).as_dvec3();
            let degrees = (height / at.distance(camera.eye)).asin().to_degrees();
            // Away from the floor's ends.
            if (1.0..10.0).contains(&degrees) && at.x < 6.9 && at.y.abs() < 0.95 {
                let bin = [3.0, 6.0].iter().filter(|end| degrees >= **end).count();
                seen[bin] += 1;
                dark[bin] += usize::from(light[pixel] < 0.95);
            }
        }
        println!("{height} {quality}: {dark:?} of {seen:?}");
        assert!(seen.iter().sum::<usize>() > 3000, "{seen:?}");
        assert!(dark.iter().sum::<usize>() * 100 <= seen.iter().sum::<usize>(), "{height} {quality}: {dark:?}");
    }
}

#[test]
fn eye_dome_lighting_darkens_real_steps_as_their_depths_say_and_by_lines_one_pixel_wide() {
    let mut stage = stage_or_skip!();
    // A wall at x = 3, a pole half a unit before it, and a box on a floor, seen from the side and from above.
    let (y, z) = (DVec3::Y, DVec3::Z);
    let wall = board(DVec3::new(3.0, -1.5, -1.0), [y * 3.0, z * 2.0]);
    let pole = board(DVec3::new(2.5, -0.05, -1.0), [y * 0.1, z * 2.0]);
    let upright: Vec<Point> = wall.chain(pole).collect();
    let front = Camera { eye: DVec3::ZERO, pivot: DVec3::X * 2.5, up: z };
    let floor = board(DVec3::new(1.0, -1.0, 0.0), [DVec3::X * 3.0, y * 2.0]);
    let lid = board(DVec3::new(2.0, -0.3, 0.3), [DVec3::X * 0.3, y * 0.6]);
    let side = board(DVec3::new(2.0, -0.3, 0.0), [y * 0.6, z * 0.3]);
    let boxed: Vec<Point> = floor.chain(lid).chain(side).collect();
    let slanted = Camera { eye: DVec3::new(0.0, 0.0, 1.0), pivot: DVec3::new(2.2, 0.0, 0.1), up: z };
    for (points, camera, size, name) in [
        (&upright, front, [160, 120], "a pole before a wall"),
        (&upright, front, [640, 480], "a pole before a wall, four times as fine"),
        (&boxed, slanted, [160, 120], "a box on a floor"),
        (&boxed, slanted, [640, 480], "a box on a floor, four times as fine"),
    ] {
        let [depths, light] = eye_dome(&mut stage, points, &camera, "nearest", size);
        let [width, height] = size.map(|edge| edge as usize);
        let (mut compared, mut lines) = (0, vec![0; height]);
        for pixel in (0..width * height).filter(|pixel| depths[*pixel] > 0.0) {
            let (column, row) = (pixel % width, pixel / width);
            if column == 0 || row == 0 || column == width - 1 || row == height - 1 {
                continue;
            }
            // The published rule: the eight neighbours' depths alone.
            let around = [1, width + 1, width, width - 1].into_iter().flat_map(|by| [pixel - by, pixel + by]);
            let steps = around.filter(|other| depths[*other] > 0.0).map(|other| depths[pixel] / depths[other] - 1.0);
            let steps: Vec<f64> = steps.collect();
            let sum: f64 = steps.iter().map(|step| (1.0 + step.max(0.0)).log2()).sum();
            let published = (-300.0 * 0.4 * sum / 8.0).exp();
            // Far beyond any slope here, and far below one.
            if steps.iter().any(|step| *step > 0.15) {
                compared += 1;
                lines[row] += 1;
                assert!(light[pixel] < published + 0.1, "{name}: {} instead of {published}", light[pixel]);
            } else if steps.iter().all(|step| step.abs() < 0.003) {
                assert!(light[pixel] > 0.95, "{name}: {} at {column} {row} without a step", light[pixel]);
            }
        }
        println!("{name}: {compared} pixels at steps");
        assert!(compared > 40, "{name}: {compared}");
        // On each side of the pole one pixel.
        assert!(!name.starts_with("a pole") || lines[height / 2] == 2, "{name}: {} a row", lines[height / 2]);
    }
}
