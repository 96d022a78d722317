//! The methods that look rays up in maps or from elsewhere, against closed forms: they find what they claim to find,
//! which is not always the true reflection.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;
#[path = "baselines/light_field.rs"]
mod light_field;
#[path = "baselines/sample_cameras.rs"]
mod sample_cameras;
#[allow(dead_code, reason = "each test takes what it needs of it")]
mod walls;

use std::sync::Arc;

use cloud::{Chunk, Cloud};
use glam::{DVec3, Vec3};
use render::{Aov, CloudId, ColorPlan, Frame, FrameStats, Material, Objects, PointStore};
use scene::{Camera, Mirror, Settings, Shape};

use stage::Stage;
use walls::{DISC, settings, store_of, wall};

const SIZE: [u32; 2] = [64, 48];
/// Half the edges of the box that contains the mirrors; its middle is the origin.
const HALF: DVec3 = DVec3::new(1.0, 0.8, 1.2);
const RADIUS: f64 = 0.4;
const MIRROR: Material = Material {
    specular_intensity: 1.0,
    specular_power: 0.0,
    refraction: 0.0,
    has_formula: false,
    as_points: false,
    method: None,
};

/// The sRGB colour of the wall of each side of the box: sides 0 to 2 are at the upper end of an axis, 3 to 5 at the
/// lower.
fn color(side: usize) -> [u8; 3] {
    std::array::from_fn(|part| if part == side % 3 { 230 } else { 60 + 80 * (side / 3) as u8 })
}

/// The walls of the box, without some sides.
fn room(without: &[usize]) -> Vec<Chunk> {
    let side = |side: usize| {
        let axis = |offset: usize| DVec3::AXES[(side + offset) % 3];
        let corner = if side < 3 { axis(0) } else { -axis(0) } - axis(1) - axis(2);
        let mut chunk = wall(corner * HALF, [axis(1), axis(2)].map(|edge| edge * HALF * 2.0));
        let [red, green, blue] = color(side);
        chunk.colors = Some(Arc::new(vec![[red, green, blue, 255]; chunk.len()]));
        chunk
    };
    (0..6).filter(|index| !without.contains(index)).map(side).collect()
}

/// Where a ray from inside leaves the box, and through which side.
fn exit(origin: DVec3, direction: DVec3) -> (DVec3, usize) {
    let distances = (HALF * direction.signum() - origin) / direction;
    let axis = (0..3).min_by(|a, b| distances[*a].total_cmp(&distances[*b])).unwrap();
    (origin + direction * distances[axis], axis + if direction[axis] > 0.0 { 0 } else { 3 })
}

fn sphere(position: DVec3, size: f64) -> Mirror {
    Mirror { position, ..Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Y, size) }
}

/// Adds a mirror as points.
fn add_points(store: &mut PointStore, chunks: Vec<Chunk>, material: Material) -> CloudId {
    let id = store.add_cloud(material);
    let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
    let cloud = Cloud { chunks, ..Cloud::default() };
    let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
    store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
    id
}

/// A camera that looks along -z at the sphere in the middle, from before a side of the box.
fn front_camera() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0), 1.1, DVec3::Y)
}

struct Scene {
    store: PointStore,
    mirrors: Vec<Mirror>,
    camera: Camera,
}

impl Scene {
    fn new(stage: &Stage, chunks: Vec<Chunk>, mirrors: Vec<Mirror>) -> Self {
        Self { store: store_of(stage, chunks, Material::default()), mirrors, camera: front_camera() }
    }

    fn render(&self, stage: &mut Stage, settings: &Settings) -> FrameStats {
        let objects = Objects { mirrors: &self.mirrors, ..Objects::default() };
        let frame = Frame::new(&self.camera, settings, objects, SIZE);
        stage.renderer.render(&self.store, &Frame { effort: stage.effort, ..frame }).unwrap()
    }
}

/// A mirror pixel: its point, the reflected direction there, the position seen, if any, and that point's albedo.
struct Seen {
    pixel: usize,
    point: DVec3,
    reflected: DVec3,
    found: Option<DVec3>,
    albedo: Vec3,
}

fn pixels(stage: &Stage, camera: &Camera) -> Vec<Seen> {
    pixels_along(stage, |point| (point - camera.eye).normalize())
}

/// `line_of_sight` is the unit direction from the camera to a point.
fn pixels_along(stage: &Stage, line_of_sight: impl Fn(DVec3) -> DVec3) -> Vec<Seen> {
    let read = |aov| stage.renderer.read_aov(aov).unwrap().data;
    let [mask, place, normal, found, albedo] =
        [Aov::Mirror, Aov::Position, Aov::Normal, Aov::MirrorPosition, Aov::MirrorAlbedo].map(read);
    let three = |data: &[f32], pixel: usize| Vec3::from_slice(&data[pixel * 3..]);
    let seen = |pixel: usize| {
        let point = three(&place, pixel).as_dvec3();
        let (normal, from) = (three(&normal, pixel).as_dvec3().normalize(), line_of_sight(point));
        let found = Vec3::from_slice(&found[pixel * 4..]).as_dvec3();
        Seen {
            pixel,
            point,
            reflected: from - normal * (2.0 * from.dot(normal)),
            found: (!found.is_nan()).then_some(found),
            albedo: three(&albedo, pixel),
        }
    };
    (0..mask.len()).filter(|pixel| mask[*pixel] > 0.0).map(seen).collect()
}

/// The side of the box that has this colour.
fn side_of(albedo: Vec3) -> Option<usize> {
    let linear = |byte: u8| ((f64::from(byte) / 255.0 + 0.055) / 1.055).powf(2.4) as f32;
    (0..6).find(|side| albedo.distance(Vec3::from(color(*side).map(linear))) < 0.01)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn by_map(pairs: &[(&str, &str)]) -> Settings {
    settings(&[&[("reflection.method", "environment_map")], pairs].concat())
}

/// The largest world size of a texel, of a map with faces of 128 texels, on a wall of the box, seen from the middle: at
/// its corner, slanted.
const TEXEL: f64 = 2.0 / 128.0 * 1.2 * 2.0;

#[test]
fn a_map_shows_the_wall_that_the_reflected_direction_meets_from_the_mirrors_middle() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::ZERO, RADIUS)]);
    for atomics in ["auto", "32"] {
        scene.render(&mut stage, &by_map(&[("environment_map.size", "128"), ("splat.atomics", atomics)]));
        let pixels = pixels(&stage, &scene.camera);
        assert!(pixels.len() > 500, "{}", pixels.len());
        let (mut right_colors, mut parallax) = (0, Vec::new());
        for seen in &pixels {
            let (expected, side) = exit(DVec3::ZERO, seen.reflected);
            let found = seen.found.unwrap();
            assert!(found.distance(expected) < TEXEL, "{found}, not {expected}");
            right_colors += usize::from(side_of(seen.albedo) == Some(side));
            parallax.push(found.distance(exit(seen.point, seen.reflected).0));
        }
        // Along the edges of the room a texel may hold either wall.
        assert!(right_colors * 20 > pixels.len() * 19, "{right_colors} of {}", pixels.len());
        // The position reported is that of the point, not the place where the mirror should see it.
        let parallax = median(parallax);
        assert!(parallax > 0.1, "{parallax}");
    }
}

#[test]
fn the_box_proxy_shows_an_empty_box_where_it_is_reflected() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::new(0.3, 0.1, -0.4), RADIUS)]);
    scene.render(&mut stage, &by_map(&[("environment_map.size", "128"), ("environment_map.proxy", "box")]));
    let pixels = pixels(&stage, &scene.camera);
    assert!(pixels.len() > 200, "{}", pixels.len());
    let error = |seen: &Seen| seen.found.unwrap().distance(exit(seen.point, seen.reflected).0);
    let errors: Vec<f64> = pixels.iter().map(error).collect();
    assert!(errors.iter().all(|error| *error < TEXEL), "{errors:?}");
    // A texel identifies the visible point; its plane gives the position.
    assert!(median(errors) < DISC / 10.0);
}

#[test]
fn an_open_side_stays_open_in_a_map() {
    let mut stage = stage_or_skip!();
    // Towards the camera, where a sphere shows most of its surroundings.
    let scene = Scene::new(&stage, room(&[2]), vec![sphere(DVec3::ZERO, RADIUS)]);
    scene.render(&mut stage, &by_map(&[]));
    let (mut open, mut filled, mut missed) = (0, 0, 0);
    let pixels = pixels(&stage, &scene.camera);
    for seen in &pixels {
        let is_open = exit(DVec3::ZERO, seen.reflected).1 == 2;
        open += usize::from(is_open);
        filled += usize::from(is_open && seen.found.is_some());
        missed += usize::from(!is_open && seen.found.is_none());
    }
    assert!(open > 50 && open + 50 < pixels.len(), "{open} of {}", pixels.len());
    assert!(filled * 100 < pixels.len() && missed * 100 < pixels.len(), "{filled} filled, {missed} missed");
}

#[test]
fn mirrors_of_points_show_one_another_and_not_themselves() {
    let mut stage = stage_or_skip!();
    let places = [DVec3::new(-0.45, 0.0, -0.2), DVec3::new(0.45, 0.0, -0.2)];
    let mut scene = Scene::new(&stage, room(&[]), Vec::new());
    for place in places {
        add_points(&mut scene.store, sphere(place, RADIUS).sample(4000, 1), MIRROR);
    }
    scene.render(&mut stage, &by_map(&[]));
    let pixels = pixels(&stage, &scene.camera);
    let (mut of_other, mut of_box) = (0, 0);
    for seen in &pixels {
        let own = usize::from(seen.point.x > 0.0);
        let Some(found) = seen.found else { panic!("a closed box") };
        assert!(found.distance(places[own]) > RADIUS * 1.2, "{found} is of the mirror itself");
        of_other += usize::from((found.distance(places[1 - own]) - RADIUS).abs() < 0.05);
        of_box += usize::from((found.abs() - HALF).abs().min_element() < 0.01);
    }
    assert!(of_other > 30 && of_box > 200, "{of_other}, {of_box}");
    assert!((of_other + of_box) * 50 > pixels.len() * 49, "{of_other} and {of_box} of {}", pixels.len());
}

#[test]
fn more_mirrors_than_maps_take_the_nearest_map() {
    let mut stage = stage_or_skip!();
    let row = |i: i32| sphere(DVec3::new(0.18 * f64::from(i) - 0.81, 0.0, -0.5), 0.08);
    let scene = Scene::new(&stage, room(&[]), (0..10).map(row).collect());
    scene.render(&mut stage, &by_map(&[("environment_map.size", "32")]));
    let pixels = pixels(&stage, &scene.camera);
    let of_last = pixels.iter().filter(|seen| seen.point.x > 0.7).count();
    assert!(pixels.len() > 100 && of_last > 10, "{of_last} of {}", pixels.len());
    assert!(pixels.iter().all(|seen| seen.found.is_some()));
}

fn draws_maps(stats: &FrameStats) -> bool {
    stats.passes.iter().any(|pass| ["environment_map", "cubemaps"].contains(&pass.name))
}

#[test]
fn maps_are_kept_while_the_camera_moves_and_drawn_anew_when_points_or_mirrors_change() {
    let mut stage = stage_or_skip!();
    for method in ["environment_map", "cubemap_trace", "light_field"] {
        let mut scene = Scene::new(&stage, room(&[2]), vec![sphere(DVec3::ZERO, RADIUS)]);
        let mut settings =
            by_map(&[("reflection.method", method), ("environment_map.size", "64"), ("cubemap_trace.size", "64")]);
        // So few samples are all needed wherever the camera is.
        (settings.light_field.size, settings.light_field.samples) = (64, 4);
        assert!(draws_maps(&scene.render(&mut stage, &settings)));

        type Change = fn(&mut Scene, &mut Settings);
        let changes: [(&str, bool, Change); 9] = [
            ("nothing", false, |_, _| ()),
            ("the camera", false, |scene, _| scene.camera.orbit(0.1, 0.05)),
            ("the quality", false, |_, settings| settings.set_text("splat.quality", "nearest").unwrap()),
            ("the proxy", false, |_, settings| settings.set_text("environment_map.proxy", "box").unwrap()),
            ("the walk", false, |_, settings| settings.set_text("cubemap_trace.jump", "2").unwrap()),
            ("the mirror's place", true, |scene, _| scene.mirrors[0].position.x += 0.05),
            ("the texels", true, |_, settings| {
                (settings.environment_map.size, settings.cubemap_trace.size, settings.light_field.size) = (50, 50, 50);
            }),
            ("the splats", true, |_, settings| settings.splat.size = 1.2),
            ("more points", true, |scene, _| {
                let screen = wall(DVec3::new(-0.9, -0.5, -0.9), [DVec3::X * 0.5, DVec3::Y * 0.6]);
                add_points(&mut scene.store, vec![screen], Material::default());
            }),
        ];
        for (name, is_anew, change) in changes {
            change(&mut scene, &mut settings);
            assert_eq!(draws_maps(&scene.render(&mut stage, &settings)), is_anew, "{method}: {name}");
            let kept = stage.renderer.read_picture().unwrap();
            stage.renderer.forget();
            assert!(draws_maps(&scene.render(&mut stage, &settings)), "{method}: {name}, forgotten");
            assert!(stage.renderer.read_picture().unwrap() == kept, "{method}: {name}: a kept map fits one made anew");
        }
    }
}

#[test]
fn rays_through_cubemaps_end_where_rays_through_the_points_end() {
    let mut stage = stage_or_skip!();
    let mirrors = vec![sphere(DVec3::new(0.3, 0.0, -0.2), RADIUS), sphere(DVec3::new(-0.5, 0.3, 0.1), RADIUS)];
    let scene = Scene::new(&stage, room(&[]), mirrors);
    let mut found = |method: &str, rest: &str| {
        scene.render(&mut stage, &by_map(&[("reflection.method", method), ("cubemap_trace.rest", rest)]));
        pixels(&stage, &scene.camera)
    };
    let truth = found("surfel_trace", "none");
    let filled = truth.iter().filter(|seen| seen.found.is_some()).count();
    for (rest, least) in [("none", 95), ("surfel_trace", 99)] {
        let traced = found("cubemap_trace", rest);
        assert_eq!(traced.len(), truth.len());
        let is_alike = |(a, b): &(&Seen, &Seen)| match (a.found, b.found) {
            (Some(a), Some(b)) => a.distance(b) < 0.02,
            (a, b) => a.is_some() == b.is_some(),
        };
        let alike = traced.iter().zip(&truth).filter(is_alike).count();
        assert!(filled > 1000 && alike * 100 >= truth.len() * least, "{rest}: {alike} of {}", truth.len());
    }
}

/// All that is found, to the bit.
fn bits(stage: &Stage) -> [Vec<u32>; 3] {
    [Aov::MirrorPosition, Aov::MirrorAlbedo, Aov::MirrorNormal]
        .map(|aov| stage.renderer.read_aov(aov).unwrap().data.iter().map(|value| value.to_bits()).collect())
}

fn by_cubemaps(pairs: &[(&str, &str)]) -> Settings {
    by_map(&[&[("reflection.method", "cubemap_trace"), ("cubemap_trace.size", "64")], pairs].concat())
}

#[test]
fn where_maps_tell_nothing_cubemap_trace_is_surfel_trace() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, room(&[2]), vec![sphere(DVec3::ZERO, RADIUS)]);
    let settings = |method, placement| {
        by_cubemaps(&[
            ("reflection.method", method),
            ("reflection.bounces", "2"),
            ("cubemap_trace.placement", placement),
        ])
    };
    // A closed box within the mirror, about its map.
    let mut hidden = Scene::new(&stage, room(&[2]), scene.mirrors.clone());
    let half = 0.2;
    let within: Vec<Chunk> = (0..6)
        .map(|side| {
            let axis = |turn: usize| DVec3::AXES[(side + turn) % 3] * half;
            wall(if side < 3 { axis(0) } else { -axis(0) } - axis(1) - axis(2), [axis(1) * 2.0, axis(2) * 2.0])
        })
        .collect();
    add_points(&mut hidden.store, within, Material::default());
    hidden.render(&mut stage, &settings("surfel_trace", "middle"));
    let traced = bits(&stage);
    let stats = hidden.render(&mut stage, &settings("cubemap_trace", "middle"));
    assert_eq!(stats.reflection.and_then(|found| found.unresolved), Some(1.0));
    assert!(bits(&stage) == traced);
    // Without the box maps do find something.
    let stats = scene.render(&mut stage, &settings("cubemap_trace", "middle"));
    let unresolved = stats.reflection.and_then(|found| found.unresolved).unwrap();
    assert!(unresolved < 0.1 && bits(&stage) != traced, "{unresolved}");
}

#[test]
fn maps_show_the_points_that_stand_whatever_came_and_went() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::ZERO, RADIUS)]);
    let settings = by_cubemaps(&[("cubemap_trace.rest", "none")]);
    let screen = |x: f64| wall(DVec3::new(x, -0.5, -0.9), [DVec3::X * 0.4, DVec3::Y * 0.6]);
    let drawn = |scene: &Scene, stage: &mut Stage| (draws_maps(&scene.render(stage, &settings)), bits(stage));
    let (_, empty) = drawn(&scene, &mut stage);
    let cloud = scene.store.add_cloud(Material::default());
    let first = scene.store.add_chunk(cloud, &screen(-0.9), None).unwrap();
    let second = scene.store.add_chunk(cloud, &screen(0.5), None).unwrap();
    let (is_drawn, both) = drawn(&scene, &mut stage);
    assert!(is_drawn && both != empty);
    // Points that came after the walls, and those of a store that had them from the start.
    let mut whole = Scene::new(&stage, room(&[]), scene.mirrors.clone());
    let cloud_of_whole = whole.store.add_cloud(Material::default());
    for x in [-0.9, 0.5] {
        whole.store.add_chunk(cloud_of_whole, &screen(x), None).unwrap();
    }
    assert!(drawn(&whole, &mut stage).1 == both, "added alone, drawn whole");

    // A chunk that slides into the place of another has other identities.
    drawn(&scene, &mut stage);
    scene.store.remove_chunk(first);
    let slid = scene.store.add_chunk(cloud, &screen(-0.9), None).unwrap();
    let (is_drawn, after) = drawn(&scene, &mut stage);
    stage.renderer.forget();
    assert!(is_drawn && after == drawn(&scene, &mut stage).1, "slid chunks");
    let position = |bits: &[Vec<u32>; 3]| bits[0].clone();
    assert!(position(&after) == position(&both), "the same points stand");

    for chunk in [second, slid] {
        scene.store.remove_chunk(chunk);
    }
    let (is_drawn, without) = drawn(&scene, &mut stage);
    assert!(is_drawn && without == empty, "chunks that went");
}

#[test]
fn maps_that_may_lag_are_drawn_a_few_faces_a_frame_and_end_as_those_drawn_at_once() {
    let mut stage = stage_or_skip!();
    let places = [DVec3::new(-0.4, 0.0, 0.0), DVec3::new(0.5, 0.0, 0.0)];
    let mut scene = Scene::new(&stage, room(&[2]), places.map(|place| sphere(place, 0.3)).to_vec());
    let found = |stage: &Stage| stage.renderer.read_aov(Aov::MirrorPosition).unwrap().data;
    let proven = |data: &[f32]| data.as_chunks::<4>().0.iter().filter(|pixel| pixel[3] == 1.0).count();
    // Four maps of six faces.
    let settings = by_cubemaps(&[("cubemap_trace.rest", "none"), ("cubemap_trace.faces_per_frame", "5")]);
    assert!(draws_maps(&scene.render(&mut stage, &settings)));
    let before = found(&stage);
    let counted = scene.render(&mut stage, &settings).reflection.and_then(|found| found.maps).unwrap();
    assert_eq!((counted.drawn, counted.asked), (4, 4));
    assert!(proven(&before) > 500);
    stage.effort.light_may_lag = true;
    assert!(!draws_maps(&scene.render(&mut stage, &settings)), "nothing has changed");
    let screen = |x: f64| wall(DVec3::new(x, -0.5, 0.5), [DVec3::X * 0.3, DVec3::Y * 0.6]);
    add_points(&mut scene.store, vec![screen(-0.9)], Material::default());
    for frame in 1..=5 {
        assert!(draws_maps(&scene.render(&mut stage, &settings)), "frame {frame}");
        let lagging = found(&stage);
        // The other mirror is put in front by its formula.
        let is_unproven = |pixel: &[f32; 4]| {
            let found = Vec3::from_slice(pixel).as_dvec3();
            pixel[3] != 1.0 || places.iter().any(|place| found.distance(*place) < 0.301)
        };
        let is_doubted = lagging.as_chunks::<4>().0.iter().all(is_unproven);
        assert_eq!(is_doubted, frame < 5, "frame {frame}: what stale maps show is not proven");
    }
    let caught_up = bits(&stage);
    assert!(!draws_maps(&scene.render(&mut stage, &settings)), "all faces are drawn");
    stage.effort.light_may_lag = false;
    stage.renderer.forget();
    scene.render(&mut stage, &settings);
    assert!(bits(&stage) == caught_up, "as at once");

    // A picture that stays draws all that is left, though nothing else has changed.
    stage.effort.light_may_lag = true;
    add_points(&mut scene.store, vec![screen(0.6)], Material::default());
    scene.render(&mut stage, &settings);
    stage.effort.light_may_lag = false;
    assert!(draws_maps(&scene.render(&mut stage, &settings)));
    let settled = bits(&stage);
    stage.renderer.forget();
    scene.render(&mut stage, &settings);
    assert!(bits(&stage) == settled, "settled");
}

#[test]
fn faces_that_lag_show_the_points_of_before_by_their_new_identities_and_none_that_went() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, Vec::new(), vec![sphere(DVec3::ZERO, RADIUS)]);
    // Points count by clouds, so that those of the room come after those of the screens.
    let clouds = [0; 2].map(|_| scene.store.add_cloud(Material::default()));
    let screens = [-0.9, 0.4].map(|x| wall(DVec3::new(x, -0.5, 0.9), [DVec3::X * 0.5, DVec3::Y * 1.1]));
    let first = scene.store.add_chunk(clouds[0], &screens[0], None).unwrap();
    scene.store.add_chunk(clouds[1], &screens[1], None).unwrap();
    add_points(&mut scene.store, room(&[]), Material::default());
    let settings = by_cubemaps(&[
        ("cubemap_trace.rest", "none"),
        ("cubemap_trace.maps", "1"),
        ("cubemap_trace.faces_per_frame", "1"),
        ("splat.close_gaps", "false"),
    ]);
    let seen = |scene: &Scene, stage: &mut Stage| {
        assert!(draws_maps(&scene.render(stage, &settings)));
        pixels(stage, &scene.camera)
    };
    let before = seen(&scene, &mut stage);
    let is_of_screen = |seen: &Seen| seen.found.is_some() && side_of(seen.albedo).is_none();
    let walls_are_kept = |after: &[Seen]| {
        let walls = before.iter().zip(after).filter(|(before, _)| side_of(before.albedo).is_some());
        let (same, all) = walls.fold((0, 0), |(same, all), (before, after)| {
            (same + usize::from(side_of(before.albedo) == side_of(after.albedo)), all + 1)
        });
        assert!(all > 300 && same == all, "{same} of {all}");
    };
    let of_screens = before.iter().filter(|seen| is_of_screen(seen)).count();
    assert!(of_screens > 50, "{of_screens}");

    stage.effort.light_may_lag = true;
    scene.store.remove_chunk(first);
    scene.store.set_visible(clouds[1], false);
    let without = seen(&scene, &mut stage);
    walls_are_kept(&without);
    assert!(!without.iter().any(is_of_screen));
    // Five of six faces do not know yet what is behind the screens.
    let empty = without.iter().filter(|seen| seen.found.is_none()).count();
    assert!(empty * 2 > of_screens, "{empty} of {of_screens}");

    scene.store.add_chunk(clouds[0], &screens[0], None).unwrap();
    scene.store.set_visible(clouds[1], true);
    walls_are_kept(&seen(&scene, &mut stage));
    stage.effort.light_may_lag = false;
}

#[test]
fn pictures_of_another_size_keep_the_maps() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::ZERO, RADIUS)]);
    for method in ["environment_map", "cubemap_trace"] {
        let settings = by_cubemaps(&[("reflection.method", method)]);
        let mut render = |size| {
            let objects = Objects { mirrors: &scene.mirrors, ..Objects::default() };
            let stats =
                stage.renderer.render(&scene.store, &Frame::new(&scene.camera, &settings, objects, size)).unwrap();
            (draws_maps(&stats), bits(&stage))
        };
        render(SIZE);
        let (is_drawn, kept) = render([80, 60]);
        assert!(!is_drawn, "{method}");
        stage.renderer.forget();
        let objects = Objects { mirrors: &scene.mirrors, ..Objects::default() };
        stage.renderer.render(&scene.store, &Frame::new(&scene.camera, &settings, objects, [80, 60])).unwrap();
        assert!(bits(&stage) == kept, "{method}");
    }
}

#[test]
fn new_colours_draw_no_map_and_change_no_place() {
    let mut stage = stage_or_skip!();
    let chunks = room(&[]);
    let mut scene = Scene::new(&stage, Vec::new(), vec![sphere(DVec3::ZERO, RADIUS)]);
    let cloud = scene.store.add_cloud(Material::default());
    let ids: Vec<_> = chunks.iter().map(|chunk| scene.store.add_chunk(cloud, chunk, None).unwrap()).collect();
    let settings = by_cubemaps(&[]);
    scene.render(&mut stage, &settings);
    let [places, albedo, _] = bits(&stage);
    let colored = Cloud { chunks, ..Cloud::default() };
    let (plan, _) = ColorPlan::new(&colored, &Settings::default().color, DVec3::Z);
    scene.store.set_color(cloud, &colored, &ids, &plan, DVec3::Z).unwrap();
    assert!(!draws_maps(&scene.render(&mut stage, &settings)));
    let after = bits(&stage);
    assert!(after[0] == places && after[1] != albedo);
}

#[test]
fn atomics_of_32_bits_draw_the_same_maps() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, room(&[2]), vec![sphere(DVec3::ZERO, RADIUS)]);
    let [wide, narrow] = ["auto", "32"].map(|atomics| {
        let settings = by_cubemaps(&[("cubemap_trace.rest", "none"), ("splat.atomics", atomics)]);
        assert!(draws_maps(&scene.render(&mut stage, &settings)));
        bits(&stage)
    });
    assert!(wide == narrow);
}

#[test]
fn maps_of_odd_mirrors_and_points_give_finite_pictures() {
    let mut stage = stage_or_skip!();
    let mut odd = room(&[2]);
    // Points that are nowhere, and points without a normal.
    let mut positions = vec![[f32::NAN; 3], [f32::INFINITY, 0.0, 0.0], [0.0, -1e38, 0.0]];
    positions.extend((0..200).map(|i| [0.004 * i as f32 - 0.4, 0.5, 0.5]));
    odd.push(Chunk::new(0, DVec3::ZERO, positions));
    let mirrors = [
        vec![sphere(DVec3::ZERO, RADIUS)],
        // Outside of the box, and next to nothing in size.
        vec![sphere(DVec3::new(0.0, 0.0, 0.2), 0.3), sphere(DVec3::new(4.0, 0.0, -3.0), 0.5)],
        vec![sphere(DVec3::ZERO, RADIUS), sphere(DVec3::new(0.6, 0.0, 0.0), 1e-9)],
        Vec::new(),
    ];
    // With an offset of 0, maps stand on the mirror, where rays begin.
    for (mirrors, offset) in mirrors.into_iter().zip(["0", "-0.25", "2", "-1"]) {
        for placement in ["surface", "middle"] {
            let count = mirrors.len();
            let scene = Scene::new(&stage, odd.clone(), mirrors.clone());
            scene.render(
                &mut stage,
                &by_cubemaps(&[("cubemap_trace.offset", offset), ("cubemap_trace.placement", placement)]),
            );
            let seen = pixels(&stage, &scene.camera);
            let filled = seen.iter().filter(|seen| seen.found.is_some()).count();
            assert!(count == 0 || filled > 200, "{count} mirrors, {offset}: {filled} of {}", seen.len());
            assert!(seen.iter().filter_map(|seen| seen.found).all(|found| found.is_finite()), "{count} {offset}");
        }
    }
}

#[test]
fn the_second_reflection_is_looked_up_like_the_first() {
    let mut stage = stage_or_skip!();
    let places = [DVec3::new(-0.45, 0.0, -0.2), DVec3::new(0.45, 0.0, -0.2)];
    let scene = Scene::new(&stage, room(&[]), places.map(|place| sphere(place, RADIUS)).to_vec());
    let mut colors = |bounces: &str| {
        scene.render(&mut stage, &by_map(&[("reflection.bounces", bounces), ("light.by", "colors")]));
        let color = stage.renderer.read_aov(Aov::Color).unwrap().data;
        (pixels(&stage, &scene.camera), color)
    };
    let ((pixels, once), (_, twice)) = (colors("1"), colors("2"));
    let at = |data: &[f32], pixel: usize| Vec3::from_slice(&data[pixel * 3..]);
    let on_a_mirror = |seen: &&Seen| {
        seen.found.is_some_and(|found| places.iter().any(|place| (found.distance(*place) - RADIUS).abs() < 1e-3))
    };
    let doubly: Vec<_> = pixels.iter().filter(on_a_mirror).collect();
    // Without a second reflection the mirror in the reflection is plain grey.
    let grey = doubly.iter().filter(|seen| side_of(at(&once, seen.pixel)).is_none()).count();
    let walls = doubly.iter().filter(|seen| side_of(at(&twice, seen.pixel)).is_some()).count();
    assert!(doubly.len() > 20 && grey == doubly.len(), "{grey} of {}", doubly.len());
    // At outlines, and where the second reflection is of a mirror again, the colour is that of no wall.
    assert!(walls * 4 > doubly.len() * 3, "{walls} of {}", doubly.len());
}

const FLAT: Shape = Shape::Plane { height: 0.7 };

/// A flat mirror that faces a direction.
fn flat(position: DVec3, normal: DVec3, size: f64) -> Mirror {
    Mirror { position, ..Mirror::standing(FLAT, DVec3::ZERO, normal, DVec3::Y, size) }
}

fn by_mirrored_eye(pairs: &[(&str, &str)]) -> Settings {
    settings(&[&[("reflection.method", "mirrored_viewpoint")], pairs].concat())
}

#[test]
fn a_flat_mirror_shows_the_points_before_it_where_the_closed_form_does() {
    let mut stage = stage_or_skip!();
    let (at, normal) = (DVec3::new(0.05, -0.1, -0.8), DVec3::new(0.15, 0.25, 1.0).normalize());
    // The wall behind the mirror would block the mirrored eye's view.
    let mut scene = Scene::new(&stage, room(&[]), vec![flat(at, normal, 0.6)]);
    scene.camera = Camera::looking(at, DVec3::new(-0.2, 0.1, 1.0), 1.5, DVec3::Y);
    // By its formula, as points with their normals to either side, and in parallel projection, from beyond the side
    // that is left out.
    let points = [normal, -normal].map(|normal| {
        let mut of_points = Scene::new(&stage, room(&[]), Vec::new());
        of_points.camera = scene.camera;
        add_points(&mut of_points.store, flat(at, normal, 0.6).sample(4000, 1), MIRROR);
        of_points
    });
    let [front, back] = &points;
    let slanted = DVec3::new(0.8, 0.1, 1.0).normalize();
    let mut parallel = Scene::new(&stage, room(&[2]), vec![flat(at, slanted, 0.6)]);
    parallel.camera = scene.camera;
    let cases = [
        (&scene, normal, "perspective", "auto"),
        (&scene, normal, "perspective", "32"),
        (front, normal, "perspective", "auto"),
        (back, normal, "perspective", "auto"),
        (&parallel, slanted, "orthographic", "auto"),
    ];
    for (case, (scene, normal, projection, atomics)) in cases.into_iter().enumerate() {
        let settings = by_mirrored_eye(&[("view.projection", projection), ("splat.atomics", atomics)]);
        scene.render(&mut stage, &settings);
        let camera = &scene.camera;
        let parallel = projection == "orthographic";
        let pixels =
            pixels_along(&stage, |point| if parallel { camera.forward() } else { (point - camera.eye).normalize() });
        let (mut errors, mut right_colors) = (Vec::new(), 0);
        for seen in &pixels {
            let (expected, side) = exit(seen.point, seen.reflected);
            if case == 4 && side == 2 {
                continue;
            }
            let found = seen.found.unwrap();
            assert!((found - at).dot(normal) > -DISC, "case {case}: {found} is behind the mirror");
            errors.push(found.distance(expected));
            right_colors += usize::from(side_of(seen.albedo) == Some(side));
        }
        // A pixel is 0.04 wide on the visible walls; the points of mirrors are a little off the plane.
        let far = errors.iter().filter(|error| **error > 0.04).count();
        let count = errors.len();
        assert!(count > 400 && far * 50 < count && median(errors) < DISC / 10.0, "case {case}: {far} of {count}");
        assert!(right_colors * 20 > count * 19, "case {case}: {right_colors} of {count}");
    }
}

#[test]
fn an_open_side_stays_open_before_a_flat_mirror() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, room(&[0]), vec![flat(DVec3::Z * -0.8, DVec3::new(0.3, 0.0, 1.0), 0.6)]);
    scene.camera = Camera::looking(DVec3::Z * -0.8, DVec3::new(-0.2, 0.1, 1.0), 1.5, DVec3::Y);
    scene.render(&mut stage, &by_mirrored_eye(&[]));
    let pixels = pixels(&stage, &scene.camera);
    let is_open = |seen: &&Seen| exit(seen.point, seen.reflected).1 == 0;
    let open = pixels.iter().filter(is_open).count();
    let wrong = pixels.iter().filter(|seen| is_open(seen) == seen.found.is_some()).count();
    assert!(open > 100 && open + 100 < pixels.len(), "{open} of {}", pixels.len());
    assert!(wrong * 50 < pixels.len(), "{wrong} of {}", pixels.len());
}

#[test]
fn what_a_curved_mirror_shows_is_reported_where_it_is() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, room(&[]), vec![sphere(DVec3::ZERO, RADIUS)]);
    scene.render(&mut stage, &by_mirrored_eye(&[]));
    let pixels = pixels(&stage, &scene.camera);
    let on_walls = |seen: &&Seen| (seen.found.unwrap().abs() - HALF).abs().min_element() < 0.01;
    assert!(pixels.len() > 500 && pixels.iter().filter(on_walls).count() * 50 > pixels.len() * 49);
    let errors = pixels.iter().map(|seen| seen.found.unwrap().distance(exit(seen.point, seen.reflected).0));
    assert!(median(errors.collect()) > 0.3, "a flat mirror is no sphere");
}

#[test]
fn a_fifth_flat_mirror_stays_empty_and_one_out_of_sight_takes_no_picture() {
    let mut stage = stage_or_skip!();
    let row = |i: i32| flat(DVec3::new(0.3 * f64::from(i) - 0.6, 0.0, -0.8), DVec3::Z, 0.12);
    // Behind the camera.
    let hidden = flat(DVec3::Z * 1.15, -DVec3::Z, 0.1);
    let scene = Scene::new(&stage, room(&[]), std::iter::once(hidden).chain((0..5).map(row)).collect());
    scene.render(&mut stage, &by_mirrored_eye(&[]));
    let mut counts = [[0; 2]; 5];
    for seen in pixels(&stage, &scene.camera) {
        let mirror = ((seen.point.x + 0.6) / 0.3).round() as usize;
        counts[mirror][usize::from(seen.found.is_some())] += 1;
    }
    for (mirror, [empty, found]) in counts.into_iter().enumerate() {
        let (most, least) = if mirror < 4 { (found, empty) } else { (empty, found) };
        assert!(most > 10 && least == 0, "{mirror}: {counts:?}");
    }
}

#[test]
fn the_second_reflection_of_a_mirrored_viewpoint_is_empty() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, room(&[]), Vec::new());
    scene.camera = Camera::looking(DVec3::Z * -0.9, DVec3::new(0.0, 0.2, 1.0), 1.5, DVec3::Y);
    for side in [-0.9, 0.9] {
        let mirror = flat(DVec3::Z * side, DVec3::Z * -side, 0.7);
        add_points(&mut scene.store, mirror.sample(4000, 1), MIRROR);
    }
    let mut color = |method: &str, bounces: &str| {
        let by = [("reflection.method", method), ("reflection.bounces", bounces), ("light.by", "colors")];
        scene.render(&mut stage, &settings(&by));
        let found = pixels(&stage, &scene.camera).into_iter().filter_map(|seen| Some((seen.pixel, seen.found?)));
        let other = found
            .filter(|(_, at)| (at.z - 0.9).abs() < 0.01 && at.x.abs() < 0.6 && at.y.abs() < 0.4)
            .map(|(pixel, _)| pixel);
        (other.collect::<Vec<_>>(), stage.renderer.read_aov(Aov::Color).unwrap().data)
    };
    let (doubly, twice) = color("mirrored_viewpoint", "2");
    let (_, traced) = color("surfel_trace", "2");
    let at = |data: &[f32], pixel: usize| Vec3::from_slice(&data[pixel * 3..]);
    let of_walls = |data: &[f32]| doubly.iter().filter(|pixel| side_of(at(data, **pixel)).is_some()).count();
    assert!(doubly.len() > 50, "{}", doubly.len());
    // A ray that leaves the scene is treated in the same way.
    assert!(doubly.iter().all(|pixel| at(&twice, *pixel).distance(at(&twice, doubly[0])) < 0.01));
    assert_eq!(of_walls(&twice), 0);
    assert!(of_walls(&traced) * 4 > doubly.len(), "{} of {}", of_walls(&traced), doubly.len());
}
