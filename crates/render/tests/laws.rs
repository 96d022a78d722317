//! Laws that every reflection method obeys, whatever it finds and how: the tests walk `scene::METHODS`. If a method breaks
//! one for a known reason, `EXCEPTIONS` gives the reason, and the law's test accepts no more than that. The correctness of
//! results is tested beside the methods.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use cloud::{
    Attribute, Chunk, ClipVolume, Cloud, CloudLayout, Column, ColumnType, Orientation, PointTest, Progress, RadiusRule,
    SurfelOptions, Volume, VolumeShape, pack_normal, pack_radius,
};
use glam::{DMat3, DQuat, DVec3};
use param::{Field, Group, Kind, Value};
use render::{
    Aov, CloudId, ColorPlan, Effort, Frame, FrameStats, LightReuse, Material, Objects, PointStore, ReflectionStats,
};
use scene::{
    Camera, IndirectBy, METHODS, Method, MethodRow, Mirror, MirrorSurface, Quality, Settings, Shape, SpotLight, Supply,
    Tripod, five_mirrors,
};

use stage::Stage;

/// The laws, as in docs/methods/README.md.
const LAWS: [&str; 10] = [
    "finite",
    "any size",
    "no points",
    "hidden points",
    "equal stores",
    "kept",
    "given up",
    "coverage",
    "right angle",
    "finds something",
];

/// The law, the method, and the reason why the method breaks it.
const EXCEPTIONS: [(&str, &str, &str); 0] = [];

const SIZE: [u32; 2] = [64, 48];

/// Discs some three pixels wide in a picture of `SIZE`.
const DISC: f64 = 0.16;

/// A rectangle of one colour, sampled so that its discs close it.
fn wall(corner: DVec3, edges: [DVec3; 2], color: [u8; 3]) -> Chunk {
    let counts = edges.map(|edge| (edge.length() / DISC).ceil() as u32);
    let at = |i: u32, count: u32| (f64::from(i) + 0.5) / f64::from(count);
    let points: Vec<[f32; 3]> = (0..counts[0] * counts[1])
        .map(|i| {
            let (u, v) = (at(i % counts[0], counts[0]), at(i / counts[0], counts[1]));
            (corner + edges[0] * u + edges[1] * v).as_vec3().to_array()
        })
        .collect();
    let normal = pack_normal(edges[0].cross(edges[1]).normalize().as_vec3());
    let mut chunk = Chunk::new(0, DVec3::ZERO, points);
    chunk.colors = Some(Arc::new(vec![[color[0], color[1], color[2], 255]; chunk.len()]));
    chunk.normals = Some(Arc::new(vec![normal; chunk.len()]));
    chunk.radii = Some(Arc::new(vec![pack_radius(DISC as f32); chunk.len()]));
    chunk
}

const RED: [u8; 3] = [220, 30, 30];
const GREEN: [u8; 3] = [30, 220, 30];
const GREY: [u8; 3] = [190, 190, 190];
/// The class of the green points.
const GREEN_CLASS: u8 = 5;

struct Scene {
    store: PointStore,
    mirrors: Vec<Mirror>,
    camera: Camera,
    /// Makes a cloud of green points alone.
    green: CloudId,
    /// The mirror of points.
    of_points: CloudId,
}

/// What the columns of chunks with a class hold.
fn classified() -> Arc<CloudLayout> {
    let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
    Arc::new(CloudLayout { attributes, grid: None })
}

/// A clip volume that keeps one side of an upright box.
fn clip(middle: [f64; 3], size: [f64; 3], keeps_inside: bool) -> ClipVolume {
    let volume = Volume::new(VolumeShape::Box, middle.into(), DQuat::IDENTITY, size.into());
    ClipVolume { volume, keeps_inside }
}

/// The chunk with one class for all of its points.
fn of_class(chunk: &Chunk, class: u8) -> Chunk {
    Chunk { columns: vec![Some(Arc::new(Column::U8(vec![class; chunk.len()])))], ..chunk.clone() }
}

/// A corner of a room before a flat and a round mirror with a formula and a round one of points, all turned.
fn scene(stage: &Stage, turn: DMat3) -> Scene {
    scene_of(stage, turn, None)
}

/// The corner of `scene`; its mirrors have this index of refraction, if light goes through them.
fn scene_of(stage: &Stage, turn: DMat3, refraction: Option<f32>) -> Scene {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let camera = Camera::looking(DVec3::new(0.0, 0.4, 0.0), DVec3::new(-0.2, -1.0, 0.35), 3.2, z);
    let camera = Camera { eye: turn * camera.eye, pivot: turn * camera.pivot, up: turn * camera.up };
    let turned = |corner: DVec3, edges: [DVec3; 2], color| wall(turn * corner, edges.map(|edge| turn * edge), color);
    let mut store = PointStore::new(stage.gpu.clone());
    let mut add = |chunks: Vec<(Chunk, u8)>, material| {
        let id = store.add_cloud(material);
        let add =
            |(chunk, class): &(Chunk, u8)| store.add_chunk(id, &of_class(chunk, *class), Some(&classified())).unwrap();
        let ids: Vec<_> = chunks.iter().map(add).collect();
        let cloud = Cloud { chunks: chunks.into_iter().map(|(chunk, _)| chunk).collect(), ..Cloud::default() };
        let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
        store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
        id
    };
    let walls = vec![
        (turned(DVec3::new(-2.0, -2.6, -1.2), [x * 4.0, y * 4.2], GREY), 2),
        (turned(DVec3::new(-2.0, -2.6, -1.2), [y * 4.2, z * 2.4], RED), 2),
        (turned(DVec3::new(0.4, -2.6, -1.2), [x * 1.4, z * 2.0], GREEN), GREEN_CLASS),
    ];
    add(walls, Material::default());
    let green = add(vec![(turned(DVec3::new(1.9, -2.6, -1.2), [z * 2.4, y * 4.2], GREEN), 2)], Material::default());
    let mirror = |shape, position, facing: DVec3, size| {
        let mirror = Mirror::standing(shape, DVec3::ZERO, DVec3::Z, DVec3::Y, size);
        let rotation = DQuat::from_mat3(&turn) * DQuat::from_rotation_arc(DVec3::Z, facing);
        Mirror { position: turn * position, rotation, refraction, ..mirror }
    };
    let mirrors = vec![
        mirror(Shape::Plane { height: 0.8 }, DVec3::new(0.2, 1.5, 0.0), -DVec3::Y, 1.1),
        mirror(Shape::Sphere, DVec3::new(-0.3, 0.0, -0.4), DVec3::Z, 0.5),
    ];
    let reflecting = Material {
        specular_intensity: 1.0,
        specular_power: 1000.0,
        refraction: refraction.unwrap_or(0.0),
        ..Material::default()
    };
    for mirror in &mirrors {
        let samples = mirror.sample(600, 1).into_iter().map(|chunk| (chunk, 0)).collect();
        add(samples, Material { has_formula: true, ..reflecting });
    }
    let of_points = mirror(Shape::Sphere, DVec3::new(0.8, 0.3, 0.3), DVec3::Z, 0.4);
    let of_points = add(of_points.sample(600, 2).into_iter().map(|chunk| (chunk, 0)).collect(), reflecting);
    Scene { store, mirrors, camera, green, of_points }
}

impl Scene {
    fn render(&self, stage: &mut Stage, settings: &Settings, size: [u32; 2]) -> FrameStats {
        stage.renderer.render(&self.store, &Frame::new(&self.camera, settings, self.objects(), size)).unwrap()
    }

    fn objects(&self) -> Objects<'_> {
        Objects { mirrors: &self.mirrors, ..Objects::default() }
    }

    /// Renders a frame without anything kept from the frames before.
    fn render_anew(&self, stage: &mut Stage, settings: &Settings, size: [u32; 2]) -> FrameStats {
        stage.renderer.forget();
        self.render(stage, settings, size)
    }
}

/// A scan of a tripod in a hall, seen from its far end: radii differ by a factor of ten, and much is open.
fn scanned(stage: &Stage) -> Scene {
    let variant = five_mirrors::Variant::Tripod(Tripod::Hall);
    let mut store = PointStore::new(stage.gpu.clone());
    let mut green = None;
    let mut parts = five_mirrors::sample(variant, 8000, 1);
    let options = SurfelOptions { radii: RadiusRule::Spread, ..SurfelOptions::new(Orientation::Toward(DVec3::ONE)) };
    let estimated = cloud::estimate(&parts[0].chunks, &options, &Progress::default()).unwrap();
    for (chunk, surfels) in parts[0].chunks.iter_mut().zip(estimated) {
        (chunk.normals, chunk.radii) = (Some(surfels.normals.into()), Some(surfels.radii.into()));
    }
    for five_mirrors::SampledPart { chunks, mirror } in parts {
        let id = store.add_cloud(mirror.as_ref().map_or(Material::default(), Material::of_mirror));
        let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
        let cloud = Cloud { chunks, ..Cloud::default() };
        let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
        store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
        green.get_or_insert(id);
    }
    Scene {
        store,
        mirrors: variant.mirrors(),
        camera: variant.camera(),
        green: green.unwrap(),
        of_points: green.unwrap(),
    }
}

/// The settings of a method, without light from surface to surface, which is part of no method.
fn by(method: &MethodRow) -> Settings {
    let mut settings = Settings::default();
    settings.reflection.method = method.method;
    (settings.gi.bounces, settings.sun.sky) = (0, 0.0);
    // Maps are drawn for each picture that is made anew: half as fine as pictures of `SIZE`.
    (settings.light_field.samples, settings.light_field.size) = (4, 32);
    (settings.cubemap_trace.size, settings.environment_map.size) = (32, 32);
    settings
}

/// The methods that find something; `auto` is one of them.
fn finding() -> impl Iterator<Item = &'static MethodRow> {
    METHODS.iter().filter(|row| row.supply != Supply::Nothing && row.method.chosen() == row.method)
}

fn is_excepted(law: &str, method: &MethodRow) -> bool {
    EXCEPTIONS.iter().any(|(excepted, name, _)| *excepted == law && *name == method.name)
}

fn read(stage: &Stage, aov: Aov) -> Vec<f32> {
    stage.renderer.read_aov(aov).unwrap().data
}

/// The picture and everything found, to the bit.
fn bits(stage: &Stage) -> (Vec<u8>, [Vec<u32>; 4]) {
    let images = [Aov::Color, Aov::MirrorPosition, Aov::MirrorAlbedo, Aov::MirrorNormal];
    let bits = |aov| read(stage, aov).iter().map(|value| value.to_bits()).collect();
    (stage.renderer.read_picture().unwrap(), images.map(bits))
}

/// Checks that all colours are numbers where something is seen, and all positions where something is seen in a mirror.
/// Returns the number of pixels drawn, of mirror pixels, of those in which something was found, and of those found or
/// closed.
fn assert_finite(stage: &Stage, what: &str) -> [usize; 4] {
    let depth = read(stage, Aov::Depth);
    for aov in [Aov::Color, Aov::Direct] {
        for (depth, color) in depth.iter().zip(read(stage, aov).as_chunks::<3>().0) {
            assert!(depth.is_nan() || color.iter().all(|value| value.is_finite()), "{what}: {aov:?} {color:?}");
        }
    }
    let (mut found, mut closed) = (0, 0);
    for [x, y, z, coverage] in read(stage, Aov::MirrorPosition).as_chunks::<4>().0 {
        if *coverage > 0.0 {
            assert!([x, y, z].iter().all(|value| value.is_finite()) && *coverage <= 1.0, "{what}: sees {x} {y} {z}");
            (found, closed) = (found + usize::from(*coverage == 1.0), closed + 1);
        }
    }
    let mirrors = read(stage, Aov::Mirror).iter().filter(|value| **value > 0.0).count();
    [depth.iter().filter(|depth| !depth.is_nan()).count(), mirrors, found, closed]
}

/// The two ends of a parameter's range, or all of its choices.
fn ends(field: &Field) -> Vec<Value> {
    match &field.kind {
        Kind::F32 { min, max, .. } => vec![Value::F32(*min), Value::F32(*max)],
        Kind::U32 { min, max, .. } => vec![Value::U32(*min), Value::U32(*max)],
        Kind::Choice { names, .. } => (0..names.len() as u32).map(Value::Choice).collect(),
        Kind::Bool { .. } => vec![Value::Bool(false), Value::Bool(true)],
        Kind::Color { .. } | Kind::Bytes { .. } | Kind::Text { .. } => Vec::new(),
    }
}

/// Whether a method's picture may differ where a parameter of a group does. Parameters of light and display affect all
/// methods alike, and are tried with the one that `auto` resolves to. Colours are laid on the points, 8 bits each, before
/// a picture is drawn of them: no picture of a scene that has its points differs by the parameters of colour.
fn concerns(method: &MethodRow, group: &Group, field: &Field) -> bool {
    let is_others = METHODS.iter().any(|row| row.group == Some(group.name) && row.name != method.name);
    let is_drawn = group.name != "color" && (field.affects.found || field.affects.shading || field.affects.view);
    is_drawn && !is_others && (field.affects.found || method.method == Method::Auto.chosen())
}

#[test]
fn finite_at_every_end_of_every_parameter() {
    let mut stage = stage_or_skip!();
    let scene = scene(&stage, DMat3::IDENTITY);
    for method in finding() {
        // Many an end is the default: no picture is drawn twice.
        let mut drawn_before = Vec::new();
        for params in Settings::default().groups() {
            let group = params.group();
            for field in group.fields.iter().filter(|field| concerns(method, group, field)) {
                // A row for each method is what the method's own ends are.
                for end in ends(field).into_iter().filter(|_| (group.name, field.name) != ("reflection", "method")) {
                    let key = format!("{}.{}", group.name, field.name);
                    let mut settings = by(method);
                    // Hundreds of samples for each pixel take long, so they have one bounce and fewer pixels; two bounces are
                    // drawn with the other parameters of gloss.
                    let has_samples = field.name == "samples";
                    // The frame, not the method, counts and sums samples of pixels and of gloss: that all of them come to
                    // finite sums is tried with one method, and with the others that each sample is finite.
                    let is_summed = has_samples && group.name != "light_field";
                    let end = match end {
                        Value::U32(most) if is_summed && method.method != Method::Auto.chosen() => {
                            Value::U32(most.min(16))
                        }
                        end => end,
                    };
                    // Photons are followed 65,536 at a time: a million is more of the same.
                    let end = match end {
                        Value::U32(most) if key == "light.photons" => Value::U32(most.min(70_000)),
                        // Rays of a pixel are summed one after the other.
                        Value::U32(most) if key == "gi.rays_per_pixel" => Value::U32(most.min(64)),
                        end => end,
                    };
                    let text = field.format(&end);
                    settings.reflection.bounces = if has_samples { 1 } else { 2 };
                    // Rays of light go on from each pixel for bounce after bounce.
                    let has_rays = group.name == "gi" && field.name.starts_with("ray");
                    let is_small = has_samples || has_rays || group.name == "gloss";
                    let size = if is_small { SIZE.map(|side| side / 2) } else { SIZE };
                    if !field.affects.found {
                        // Light of all kinds, with few virtual lights.
                        settings.set_text("light.by", "sun").unwrap();
                        settings.sun.sky = 1.0;
                        (settings.gi.bounces, settings.gi.vpls, settings.gi.sky_lights) = (1, 16, 4);
                        (settings.gi.shadow_points, settings.gi.shadow_size) = (256, 16);
                        settings.gi.rays_per_pixel = 8;
                    }
                    if has_rays {
                        // Where virtual lights shine, rays count for nothing; no ray goes on for more bounces than light.
                        (settings.gi.by, settings.gi.bounces) = (IndirectBy::Rays, 4);
                    }
                    if group.name == "gloss" {
                        settings.gloss.samples = 2;
                    }
                    // The criterion `layers` asks for a second layer.
                    if key == "screen_trace.criterion" && text == "layers" {
                        settings.screen_trace.back = scene::ScreenBack::Culled;
                    }
                    settings.set_text(&key, &text).unwrap();
                    let what = format!("{}, {key}={text}", method.name);
                    if method.method == Method::MirroredViewpoint && settings.gloss.samples > 0 {
                        let drawn = stage
                            .renderer
                            .render(&scene.store, &Frame::new(&scene.camera, &settings, scene.objects(), SIZE));
                        assert!(matches!(drawn, Err(render::Error::PerfectMirrorsOnly { .. })), "{what}");
                        continue;
                    }
                    let drawing = (settings.clone(), size);
                    if drawn_before.contains(&drawing) {
                        continue;
                    }
                    drawn_before.push(drawing);
                    let stats = scene.render(&mut stage, &settings, size);
                    assert!(!has_rays || stats.light_rays == [settings.gi.rays_per_pixel; 2], "{what}: {stats:?}");
                    let [drawn, mirrors, found, _] = assert_finite(&stage, &what);
                    let least = (size[0] * size[1] / 6) as usize;
                    assert!(drawn > least && mirrors > 10, "{what}: {drawn} pixels, {mirrors} mirror pixels");
                    assert!(
                        found == 0 || settings.reflection.bounces > 0,
                        "{what}: {found} mirror pixels see something"
                    );
                }
            }
        }
    }
}

/// What the camera's mirrors show, to the bit, pixel by pixel: colour, position, albedo and normal.
fn shown(stage: &Stage) -> Vec<[Vec<u32>; 4]> {
    let images = [(Aov::Color, 3), (Aov::MirrorPosition, 4), (Aov::MirrorAlbedo, 3), (Aov::MirrorNormal, 3)];
    let images = images.map(|(aov, channels)| {
        let bits: Vec<u32> = read(stage, aov).iter().map(|value| value.to_bits()).collect();
        bits.chunks(channels).map(<[u32]>::to_vec).collect::<Vec<_>>()
    });
    (0..images[0].len()).map(|pixel| images.each_ref().map(|image| image[pixel].clone())).collect()
}

/// The mirror of each pixel of the scene: flat, round, round of points; `None` without one, and within three pixels of
/// another one, where gaps are closed from other pixels.
fn mirror_numbers(stage: &Stage, scene: &Scene) -> Vec<Option<usize>> {
    let position = read(stage, Aov::Position);
    let spheres = [(scene.mirrors[1].position, 0.5), (DVec3::new(0.8, 0.3, 0.3), 0.4)];
    let number = |(place, mirror): (&[f32; 3], &f32)| {
        let place = DVec3::from(place.map(f64::from));
        let on = |(center, radius): &(DVec3, f64)| (place.distance(*center) - radius).abs() < 0.1;
        (*mirror > 0.0).then(|| spheres.iter().position(on).map_or(0, |sphere| sphere + 1))
    };
    let all: Vec<_> = position.as_chunks::<3>().0.iter().zip(&read(stage, Aov::Mirror)).map(number).collect();
    let [width, height] = SIZE.map(|side| side as usize);
    let is_apart = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(3)..(y + 4).min(height);
        let mut near = rows.flat_map(|y| (x.saturating_sub(3)..(x + 4).min(width)).map(move |x| y * width + x));
        near.all(|other| all[other].is_none() || all[other] == all[pixel])
    };
    (0..all.len()).map(|pixel| all[pixel].filter(|_| is_apart(pixel))).collect()
}

/// Gives the scene's mirrors, flat, round, round of points, methods of their own.
fn give_methods(scene: &mut Scene, own: [Option<Method>; 3]) {
    (scene.mirrors[0].method, scene.mirrors[1].method) = (own[0], own[1]);
    scene.store.set_material(
        scene.of_points,
        Material { specular_intensity: 1.0, specular_power: 1000.0, method: own[2], ..Material::default() },
    );
}

#[test]
fn a_mirror_with_a_method_of_its_own_looks_as_in_the_picture_of_that_method() {
    let mut stage = stage_or_skip!();
    let mut scene = scene(&stage, DMat3::IDENTITY);
    let methods: Vec<&MethodRow> = finding().collect();
    // SSCR shares its points out among all mirrors of its pictures.
    let is_shared = |method: &MethodRow| method.method == Method::Sscr;
    for bounces in [1, 2] {
        let with = |method: &MethodRow| {
            let mut settings = by(method);
            settings.reflection.bounces = bounces;
            settings
        };
        give_methods(&mut scene, [None; 3]);
        let alone: Vec<_> = methods
            .iter()
            .map(|method| {
                scene.render_anew(&mut stage, &with(method), SIZE);
                shown(&stage)
            })
            .collect();
        let numbers = mirror_numbers(&stage, &scene);
        for first in 0..methods.len() {
            let own = [0, 1, 2].map(|mirror| (first + mirror * 2) % methods.len());
            give_methods(&mut scene, own.map(|method| Some(methods[method].method)));
            let stats = scene.render_anew(&mut stage, &with(methods[(first + 1) % methods.len()]), SIZE);
            let mixed = shown(&stage);
            let names = own.map(|method| methods[method].name);
            let mut compared = [0; 3];
            for (pixel, mirror) in numbers.iter().enumerate().filter_map(|(pixel, mirror)| Some((pixel, (*mirror)?))) {
                let method = methods[own[mirror]];
                if is_shared(method) {
                    continue;
                }
                compared[mirror] += 1;
                let at = [pixel as u32 % SIZE[0], pixel as u32 / SIZE[0]];
                let what = format!("{names:?}, {bounces} bounces: mirror {mirror}, {at:?}");
                assert!(mixed[pixel] == alone[own[mirror]][pixel], "{what} shows something else");
            }
            let is_compared = |mirror: usize| compared[mirror] > 30 || is_shared(methods[own[mirror]]);
            assert!((0..3).all(is_compared), "{compared:?} pixels");
            let reflection = stats.reflection.unwrap();
            // Each mirror pixel is counted once.
            let count = |values: &[f32], least: f32| values.iter().filter(|value| **value >= least).count() as u32;
            let mirrors = count(&read(&stage, Aov::Mirror), 1e-6);
            let coverage = read(&stage, Aov::MirrorPosition).iter().skip(3).step_by(4).copied().collect::<Vec<f32>>();
            let found = (reflection.coverage * f64::from(mirrors)).round() as u32;
            assert_eq!((reflection.mirror_pixels, found), (mirrors, count(&coverage, 0.75)), "{names:?}");
            assert!(reflection.coverage > 0.1, "{names:?}: {}", reflection.coverage);
            // Each method has passes in the list of times.
            let passes: Vec<&str> = stats.passes.iter().map(|pass| pass.name).collect();
            for name in names.iter().filter(|name| ["environment_map", "mirrored_viewpoint"].contains(name)) {
                let is_last = bounces == 1 || *name != "mirrored_viewpoint";
                assert!(passes.contains(name) || !is_last, "{names:?}: {passes:?}");
            }
        }
    }
}

#[test]
fn methods_of_mirrors_can_be_changed_turned_off_and_all_be_the_same() {
    let mut stage = stage_or_skip!();
    let mut scene = scene(&stage, DMat3::IDENTITY);
    let row = |method: Method| method.row();
    let (traced, mapped) = (by(row(Method::SurfelTrace)), by(row(Method::EnvironmentMap)));
    let mut drawn = |scene: &Scene, settings: &Settings| {
        scene.render(&mut stage, settings, SIZE);
        bits(&stage)
    };
    let [all_traced, all_mapped] = [&traced, &mapped].map(|settings| drawn(&scene, settings));
    assert!(all_traced != all_mapped);
    give_methods(&mut scene, [None, Some(Method::EnvironmentMap), None]);
    let mixed = drawn(&scene, &traced);
    assert!(mixed != all_traced && mixed != all_mapped, "a new method draws no new picture");
    let off = |settings: &Settings| {
        let mut settings = settings.clone();
        settings.reflection.own_methods = false;
        settings
    };
    assert!(drawn(&scene, &off(&traced)) == all_traced && drawn(&scene, &traced) == mixed);
    give_methods(&mut scene, [Some(Method::EnvironmentMap); 3]);
    assert!(drawn(&scene, &traced) == all_mapped, "all mirrors have the same method");
    let mut none = traced.clone();
    none.reflection.method = Method::None;
    let hidden = drawn(&scene, &none).0;
    give_methods(&mut scene, [None; 3]);
    assert!(drawn(&scene, &none).0 == hidden);
}

#[test]
fn pictures_that_have_room_for_one_method_are_refused_with_the_reason() {
    let mut stage = stage_or_skip!();
    let mut scene = scene(&stage, DMat3::IDENTITY);
    let refused = |stage: &mut Stage, scene: &Scene, settings: &Settings| {
        let frame = Frame::new(&scene.camera, settings, scene.objects(), SIZE);
        stage.renderer.render(&scene.store, &frame).unwrap_err().to_string()
    };
    let settings = by(Method::SurfelTrace.row());
    let mut glossy = settings.clone();
    glossy.gloss.samples = 2;
    let mut several = settings.clone();
    several.reflection.samples = 4;
    let mut blended = settings.clone();
    blended.light_field.rule = scene::SampleRule::Mean;
    for (own, settings, reason) in [
        (Method::Sscr, &glossy, "take one draw for all pixels"),
        (Method::MirroredViewpoint, &glossy, "mirrored_viewpoint shows perfect mirrors only"),
        (Method::MirroredViewpoint, &several, "one ray for each pixel"),
        (Method::LightField, &blended, "blends several looks"),
    ] {
        give_methods(&mut scene, [None, Some(own), None]);
        let error = refused(&mut stage, &scene, settings);
        assert!(error.contains(reason), "{own:?}: {error}");
        let mut off = settings.clone();
        off.reflection.own_methods = false;
        scene.render(&mut stage, &off, SIZE);
    }
    give_methods(&mut scene, [None, Some(Method::EnvironmentMap), None]);
    // Other methods may have glossy mirrors and several rays.
    for settings in [&glossy, &several, &blended] {
        scene.render(&mut stage, settings, SIZE);
        assert_finite(&stage, "glossy mirrors of two methods");
    }
    let mut clear = scene_of(&stage, DMat3::IDENTITY, Some(1.5));
    clear.mirrors[0].method = Some(Method::EnvironmentMap);
    let error = refused(&mut stage, &clear, &settings);
    assert!(
        error.contains("glass and water are drawn by one method, and mirrors have several: environment_map"),
        "{error}"
    );
}

/// Glass and water have images and rays of their own: the laws of numbers, of what is kept and of equal stores hold for
/// them too.
#[test]
fn clear_mirrors_obey_the_laws_of_opaque_ones() {
    let mut stage = stage_or_skip!();
    for refraction in [scene::REFRACTION.start(), &1.5, scene::REFRACTION.end()] {
        let [scene, other] = [0; 2].map(|_| scene_of(&stage, DMat3::IDENTITY, Some(*refraction)));
        let opaque = scene_of(&stage, DMat3::IDENTITY, None);
        for method in finding() {
            let what = format!("{}, {refraction}", method.name);
            let mut settings = by(method);
            settings.reflection.bounces = 3;
            settings.set_text("light.by", "headlight").unwrap();
            scene.render_anew(&mut stage, &settings, SIZE);
            assert_finite(&stage, &what);
            let clear = read(&stage, Aov::Refraction);
            let count = |low: f32, high: f32| clear.iter().filter(|index| (low..=high).contains(*index)).count();
            assert!(count(*refraction, *refraction) > 20 && count(-*refraction, -*refraction) > 20, "{what}");
            let anew = bits(&stage);
            scene.render(&mut stage, &settings, SIZE);
            assert!(bits(&stage) == anew, "{what}: kept");
            other.render_anew(&mut stage, &settings, SIZE);
            assert!(bits(&stage) == anew, "{what}: of another store");
            // Light alone changes: what was found is kept.
            settings.light.headlight = 0.9;
            scene.render(&mut stage, &settings, SIZE);
            scene.render(&mut stage, &settings, SIZE);
            let kept = bits(&stage);
            assert!(kept.0 != anew.0, "{what}: another light");
            scene.render_anew(&mut stage, &settings, SIZE);
            assert!(bits(&stage) == kept, "{what}: lit anew");
            // Nothing is left of glass where there is none.
            opaque.render(&mut stage, &settings, SIZE);
            let after_glass = bits(&stage);
            assert!(read(&stage, Aov::Refraction).iter().all(|index| *index == 0.0 || index.is_nan()), "{what}");
            opaque.render_anew(&mut stage, &settings, SIZE);
            assert!(bits(&stage) == after_glass && after_glass != kept, "{what}: opaque again");
        }
    }
}

#[test]
fn pictures_of_any_size_are_made() {
    let mut stage = stage_or_skip!();
    let mut scene = scene(&stage, DMat3::IDENTITY);
    // So near that the one pixel of the smallest picture is a mirror.
    scene.camera = Camera::looking(DVec3::new(0.2, 1.5, 0.0), DVec3::new(0.0, -1.0, 0.1), 1.2, DVec3::Z);
    for method in METHODS {
        for size in [[1, 1], [1, 9], [17, 1], [33, 19]] {
            let stats = scene.render(&mut stage, &by(method), size);
            let what = format!("{}, {size:?}", method.name);
            let [drawn, mirrors, ..] = assert_finite(&stage, &what);
            assert!(drawn > 0 && mirrors > 0, "{what}: {drawn} pixels, {mirrors} mirror pixels");
            assert_eq!(stats.reflection.is_some(), method.supply != Supply::Nothing, "{what}");
            assert_eq!(stage.renderer.read_picture().unwrap().len(), (size[0] * size[1] * 4) as usize, "{what}");
        }
    }
}

#[test]
fn without_points_mirrors_show_nothing() {
    let mut stage = stage_or_skip!();
    let scene = Scene { store: PointStore::new(stage.gpu.clone()), ..scene(&stage, DMat3::IDENTITY) };
    for method in METHODS {
        let stats = scene.render(&mut stage, &by(method), SIZE);
        let [_, mirrors, ..] = assert_finite(&stage, method.name);
        assert!(mirrors > 100, "{}: {mirrors} mirror pixels", method.name);
        let points = read(&stage, Aov::MirrorAlbedo);
        // Mirrors with a formula show one another.
        let formula = scene.mirrors[0].color.map(|value| value);
        let is_of_points = |color: &&[f32; 3]| !color[0].is_nan() && (color[0] - formula[0]).abs() > 0.01;
        assert_eq!(points.as_chunks::<3>().0.iter().filter(is_of_points).count(), 0, "{}", method.name);
        assert!(stats.reflection.is_none_or(|found| found.hit_rate.unwrap_or(0.0) == 0.0), "{}", method.name);
    }
}

/// The number of mirror pixels that show something green.
fn green_pixels(stage: &Stage) -> usize {
    let data = read(stage, Aov::MirrorAlbedo);
    data.as_chunks::<3>().0.iter().filter(|[red, green, _]| *green > 2.0 * red).count()
}

#[test]
fn hidden_points_are_never_reflected() {
    let mut stage = stage_or_skip!();
    let mut scene = scene(&stage, DMat3::IDENTITY);
    for method in finding() {
        let settings = by(method);
        let mut green = |scene: &Scene| {
            scene.render(&mut stage, &settings, SIZE);
            green_pixels(&stage)
        };
        let all = green(&scene);
        scene.store.set_visible(scene.green, false);
        let of_class = green(&scene);
        assert!(all > of_class && of_class > 0, "{}: {all}, {of_class} green pixels", method.name);
        let clipped = PointTest::new([], Vec::new(), vec![clip([1.1, -2.6, -0.2], [1.45, 0.02, 2.05], false)]);
        for test in [PointTest::hiding([GREEN_CLASS]), clipped] {
            scene.store.set_visibility(&test);
            assert_eq!(green(&scene), 0, "{}: {test:?}", method.name);
        }
        scene.store.set_visibility(&PointTest::hiding([GREEN_CLASS]));
        scene.store.set_visible(scene.green, true);
        let of_cloud = green(&scene);
        assert!(of_cloud > 0 && of_cloud < all, "{}: {of_cloud} of {all}", method.name);
        scene.store.set_visibility(&PointTest::default());
        assert_eq!(green(&scene), all, "{}: what is shown again is reflected again", method.name);
    }
}

/// Hidden points neither block anything, nor widen the scene, nor take the places of shown points among those that cast
/// indirect shadows.
#[test]
fn hidden_points_leave_no_trace() {
    let mut stage = stage_or_skip!();
    let mut scene = scene(&stage, DMat3::IDENTITY);
    let lamp = SpotLight {
        position: DVec3::new(0.0, 1.0, 1.0),
        target: DVec3::new(0.0, -1.0, -1.0),
        intensity: [10.0; 3],
        inner_degrees: 40.0,
        outer_degrees: 60.0,
    };
    let mut render = |scene: &Scene, method| {
        let mut settings = by(method);
        (settings.gi.bounces, settings.gi.vpls, settings.gi.shadow_points) = (1, 32, 1000);
        let objects = Objects { mirrors: &scene.mirrors, lights: &[lamp], ..Objects::default() };
        stage.renderer.forget();
        let stats = stage.renderer.render(&scene.store, &Frame::new(&scene.camera, &settings, objects, SIZE)).unwrap();
        (bits(&stage), read(&stage, Aov::Indirect).iter().map(|value| value.to_bits()).collect::<Vec<_>>(), stats)
    };
    let without: Vec<_> = METHODS.iter().map(|method| render(&scene, method)).collect();
    let near = wall(DVec3::new(-1.0, 0.8, -1.0), [DVec3::X * 2.0, DVec3::Z * 2.0], GREEN);
    let far = wall(DVec3::new(30.0, 40.0, 20.0), [DVec3::X * 5.0, DVec3::Z * 5.0], GREEN);
    let cloud = scene.store.add_cloud(Material::default());
    for chunk in [near, far] {
        scene.store.add_chunk(cloud, &of_class(&chunk, GREEN_CLASS + 1), Some(&classified())).unwrap();
    }
    for (method, (picture, ..)) in METHODS.iter().zip(&without) {
        assert!(render(&scene, method).0 != *picture, "{}: the points are seen", method.name);
    }
    // All but the wall far away, and nothing of the near one.
    let clips = vec![clip([0.0, -0.5, 0.0], [4.2, 4.4, 2.6], true), clip([0.0, 0.8, 0.0], [2.1, 0.1, 2.1], false)];
    for test in [PointTest::hiding([GREEN_CLASS + 1]), PointTest::new([], Vec::new(), clips)] {
        scene.store.set_visibility(&test);
        for (method, (picture, indirect, stats)) in METHODS.iter().zip(&without) {
            let hidden = render(&scene, method);
            assert!(hidden.0 == *picture, "{}: {test:?}", method.name);
            assert!(hidden.1 == *indirect, "{}: indirect light, {test:?}", method.name);
            assert_eq!(hidden.2.points_drawn, stats.points_drawn, "{}: {test:?}", method.name);
        }
    }
}

#[test]
fn equal_stores_give_equal_pictures() {
    let mut stage = stage_or_skip!();
    let scenes = [scene(&stage, DMat3::IDENTITY), scene(&stage, DMat3::IDENTITY)];
    for method in METHODS {
        let [first, second] = scenes.each_ref().map(|scene| {
            scene.render_anew(&mut stage, &by(method), SIZE);
            bits(&stage)
        });
        assert!(first == second, "{}", method.name);
    }
}

#[test]
fn what_is_kept_equals_what_is_made_anew() {
    let mut stage = stage_or_skip!();
    for method in METHODS {
        let mut scene = scene(&stage, DMat3::IDENTITY);
        let mut settings = by(method);
        // Indirect light is kept for each surface.
        settings.set_text("light.by", "sun").unwrap();
        settings.sun.sky = 1.0;
        (settings.gi.bounces, settings.gi.vpls, settings.gi.sky_lights, settings.gi.shadow_points) = (1, 16, 4, 256);
        type Change = fn(&mut Scene, &mut Settings);
        let changes: [(&str, Change); 10] = [
            ("nothing", |_, _| ()),
            ("the tint", |_, settings| settings.mirror.tint = 0.5),
            ("the camera", |scene, _| scene.camera.orbit(0.02, 0.01)),
            ("a cloud less", |scene, _| scene.store.set_visible(scene.green, false)),
            ("a class less", |scene, _| scene.store.set_visibility(&PointTest::hiding([GREEN_CLASS]))),
            ("a clip", |scene, _| {
                let volumes = vec![clip([0.0; 3], [9.0, 9.0, 1.5], true)];
                scene.store.set_visibility(&PointTest::new([GREEN_CLASS], Vec::new(), volumes))
            }),
            ("a mirror elsewhere", |scene, _| scene.mirrors[1].position.x += 0.1),
            ("another bounce", |_, settings| settings.reflection.bounces = 2),
            ("a mirror less", |scene, _| scene.mirrors.truncate(1)),
            ("mirrors of points", |_, settings| settings.mirror.surface = MirrorSurface::Points),
        ];
        scene.render_anew(&mut stage, &settings, SIZE);
        for (name, change) in changes {
            change(&mut scene, &mut settings);
            let kept = scene.render(&mut stage, &settings, SIZE);
            let with_kept = bits(&stage);
            let anew = scene.render_anew(&mut stage, &settings, SIZE);
            assert!(with_kept == bits(&stage), "{}: {name}", method.name);
            // How many maps a frame draws depends on what is kept.
            let told = |stats: FrameStats| stats.reflection.map(|told| ReflectionStats { map_use: None, ..told });
            assert_eq!(told(kept), told(anew), "{}: {name}", method.name);
        }
    }
}

/// Gives the frames that follow up once they have asked so often whether they are; counts how often they have.
fn give_up_after(stage: &mut Stage, most: u32) -> Arc<AtomicU32> {
    let asked = Arc::new(AtomicU32::new(0));
    let count = asked.clone();
    stage.renderer.give_up_when(Some(Arc::new(move || count.fetch_add(1, Ordering::Relaxed) >= most)));
    asked
}

#[test]
fn a_frame_that_was_given_up_leaves_no_trace() {
    let mut stage = stage_or_skip!();
    for method in METHODS {
        let mut scene = scene(&stage, DMat3::IDENTITY);
        let mut settings = by(method);
        settings.gi.bounces = 1;
        // The surface of the points is kept where only a mirror has moved.
        let change = |scene: &mut Scene, part: u32| {
            if part.is_multiple_of(2) {
                scene.camera.orbit(0.02, 0.01);
            } else {
                scene.mirrors[1].position.x += 0.02;
            }
        };
        scene.render_anew(&mut stage, &settings, SIZE);
        // How often a frame asks whether it is given up, after either change.
        let asked = [0, 1].map(|part| {
            change(&mut scene, part);
            let asked = give_up_after(&mut stage, u32::MAX);
            scene.render(&mut stage, &settings, SIZE);
            asked.load(Ordering::Relaxed)
        });
        let mut given_up = 0;
        for part in 0..8 {
            change(&mut scene, part);
            give_up_after(&mut stage, asked[part as usize % 2] * part / 8);
            let ended =
                stage.renderer.render(&scene.store, &Frame::new(&scene.camera, &settings, scene.objects(), SIZE));
            stage.renderer.give_up_when(None);
            if let Err(error) = ended {
                assert!(matches!(error, render::Error::GivenUp), "{}: {error}", method.name);
                given_up += 1;
            }
            scene.render(&mut stage, &settings, SIZE);
            let after = bits(&stage);
            scene.render_anew(&mut stage, &settings, SIZE);
            assert!(after == bits(&stage), "{}: given up after {part} eighths", method.name);
        }
        // A coarse frame with less effort, as one for moving pictures.
        let mut coarse = settings.clone();
        (coarse.splat.quality, coarse.reflection.samples) = (Quality::Nearest, 1);
        let effort = |part: u32| Effort {
            most_points: Some(4000),
            // Maps of fewer points are never those of a picture at rest.
            most_reflected: (part < 4).then_some(2000),
            most_samples: Some(1),
            light_may_lag: true,
            light_reuse: LightReuse::Reuse,
            times_passes: false,
            ..Effort::FULL
        };
        let draw = |stage: &mut Stage, scene: &Scene, part| {
            let frame = Frame::new(&scene.camera, &coarse, scene.objects(), SIZE.map(|edge| edge / 3));
            stage.renderer.render(&scene.store, &Frame { effort: effort(part), ..frame })
        };
        let asked = give_up_after(&mut stage, u32::MAX);
        change(&mut scene, 1);
        draw(&mut stage, &scene, 4).unwrap();
        let asked = asked.load(Ordering::Relaxed);
        for part in 0..8 {
            scene.render(&mut stage, &settings, SIZE);
            change(&mut scene, part);
            give_up_after(&mut stage, asked * (part % 4) / 4);
            let ended = draw(&mut stage, &scene, part);
            stage.renderer.give_up_when(None);
            assert!(matches!(ended, Ok(_) | Err(render::Error::GivenUp)), "{}", method.name);
            given_up += u32::from(ended.is_err());
            let stats = scene.render(&mut stage, &settings, SIZE);
            let draws_maps = stats.passes.iter().any(|pass| ["environment_map", "cubemaps"].contains(&pass.name));
            let keeps_maps = part.is_multiple_of(2) && method.method != Method::LightField;
            assert!(!(keeps_maps && draws_maps), "{}: the maps of the frame before are drawn anew", method.name);
            let after = bits(&stage);
            scene.render_anew(&mut stage, &settings, SIZE);
            assert!(after == bits(&stage), "{}: coarse frame {part} given up", method.name);
        }
        // Passes are cut by what is known of their times, which differ on a busy machine, and so does how often a frame
        // asks.
        assert!(given_up >= 8, "{}: {given_up} frames were given up", method.name);
    }
}

#[test]
fn a_picture_of_passes_cut_into_pieces_is_the_same_to_the_bit() {
    let mut stage = stage_or_skip!();
    for method in METHODS {
        let mut scene = scene(&stage, DMat3::IDENTITY);
        // The parts of a list of points have at least 16 blocks of 1024 points.
        let floor = wall(DVec3::new(-20.0, -20.0, -1.3), [DVec3::X * 40.0, DVec3::Y * 40.0], GREY);
        let cloud = scene.store.add_cloud(Material::default());
        scene.store.add_chunk(cloud, &floor, None).unwrap();
        let mut settings = by(method);
        settings.gi.bounces = 1;
        let whole = scene.render_anew(&mut stage, &settings, SIZE);
        let picture = bits(&stage);
        stage.renderer.give_up_when(Some(Arc::new(|| false)));
        stage.renderer.cut_passes(0.01);
        // The first one learns how long the passes take.
        let [_, cut] = [0, 1].map(|_| scene.render_anew(&mut stage, &settings, SIZE));
        stage.renderer.give_up_when(None);
        stage.renderer.cut_passes(25.0);
        assert!(picture == bits(&stage), "{}", method.name);
        assert_eq!(cut.reflection, whole.reflection, "{}", method.name);
        let dispatches = [&whole, &cut].map(|stats| stats.dispatches);
        let are_cut = dispatches[1] >= dispatches[0] + 9 || stage.gpu.clock == render::Clock::Gpu;
        assert!(are_cut, "{}: {dispatches:?}", method.name);
    }
}

#[test]
fn mirrors_see_something_and_stated_coverage_is_what_can_be_counted() {
    let mut stage = stage_or_skip!();
    let scene = scene(&stage, DMat3::IDENTITY);
    for method in finding() {
        for closes in [true, false] {
            let mut settings = by(method);
            settings.splat.close_gaps = closes;
            let stats = scene.render(&mut stage, &settings, SIZE).reflection.unwrap();
            let [_, mirrors, found, closed] = assert_finite(&stage, method.name);
            assert_eq!(stats.mirror_pixels as usize, mirrors, "{}", method.name);
            let count = |share: f64| (share * mirrors as f64).round() as usize;
            let stated = [count(stats.coverage), count(stats.closed_coverage)];
            assert_eq!(stated, [found, closed], "{}, of {mirrors} mirror pixels", method.name);
            assert!(found * 4 > mirrors, "{}: {found} of {mirrors} mirror pixels see something", method.name);
        }
    }
}

#[test]
fn on_a_scan_of_a_tripod_pictures_are_finite_equal_and_covered_as_stated() {
    let mut stage = stage_or_skip!();
    let scenes = [scanned(&stage), scanned(&stage)];
    for method in finding() {
        let [first, second] = scenes.each_ref().map(|scene| {
            let stats = scene.render_anew(&mut stage, &by(method), SIZE).reflection.unwrap();
            let [drawn, mirrors, found, closed] = assert_finite(&stage, method.name);
            assert!(drawn > 500 && mirrors > 100, "{}: {drawn} pixels, {mirrors} of mirrors", method.name);
            let count = |share: f64| (share * mirrors as f64).round() as usize;
            assert_eq!([count(stats.coverage), count(stats.closed_coverage)], [found, closed], "{}", method.name);
            assert!(found > 0, "{}: no mirror pixel sees anything", method.name);
            bits(&stage)
        });
        assert!(first == second, "{}", method.name);
    }
}

#[test]
fn turning_scene_and_camera_by_a_right_angle_changes_nothing() {
    let mut stage = stage_or_skip!();
    // Exact in 32 bits: x becomes y, y becomes -x.
    let turn = DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z);
    let scenes = [scene(&stage, DMat3::IDENTITY), scene(&stage, turn)];
    let size = [128, 96];
    for method in METHODS {
        let mut settings = by(method);
        settings.set_text("light.by", "headlight").unwrap();
        // Coarser maps show more steps, which lie elsewhere in turned maps.
        (settings.light_field.samples, settings.light_field.size) = (8, 64);
        (settings.cubemap_trace.size, settings.environment_map.size) = (64, 64);
        let [here, there] = scenes.each_ref().map(|scene| {
            let stats = scene.render_anew(&mut stage, &settings, size);
            (stats.reflection, stage.renderer.read_picture().unwrap())
        });
        // Each point draws the region in which it is searched; its random numbers depend on its place in memory.
        if let Some([here, there]) =
            here.0.zip(there.0).map(|(here, there)| [here, there]).filter(|[here, _]| here.hit_rate.is_some())
        {
            for (name, here, there) in [
                ("coverage", here.coverage, there.coverage),
                ("closed coverage", here.closed_coverage, there.closed_coverage),
                ("hit rate", here.hit_rate.unwrap_or(0.0), there.hit_rate.unwrap_or(0.0)),
            ] {
                assert!((here / there - 1.0).abs() < 0.02, "{}, {name}: {here}, {there}", method.name);
            }
            continue;
        }
        let pairs = here.1.as_chunks::<4>().0.iter().zip(there.1.as_chunks::<4>().0);
        let differs = |(a, b): &(&[u8; 4], &[u8; 4])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2);
        let differing = pairs.filter(differs).count();
        assert!(differing * 1000 <= 2 * (size[0] * size[1]) as usize, "{}: {differing} pixels differ", method.name);
    }
}

/// The table of methods and laws, in the form of the page.
fn table() -> String {
    let mut table = format!("| method | {} |\n|---|{}\n", LAWS.join(" | "), "---|".repeat(LAWS.len()));
    for method in METHODS {
        let cell = |law: &&str| if is_excepted(law, method) { "no" } else { "holds" };
        table += &format!("| `{}` | {} |\n", method.name, LAWS.iter().map(cell).collect::<Vec<_>>().join(" | "));
    }
    let reasons: BTreeMap<_, _> = EXCEPTIONS.iter().map(|(law, method, why)| ((method, law), why)).collect();
    for ((method, law), why) in reasons {
        table += &format!("\n`{method}`, {law}: {why}\n");
    }
    table
}

#[test]
fn the_page_of_methods_has_the_table_of_laws() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/methods/README.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = page.split_once("<!-- laws -->\n").expect("a place for the table");
    let (_, after) = rest.split_once("<!-- end -->").expect("its end");
    let expected = format!("{before}<!-- laws -->\n{}<!-- end -->{after}", table());
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    let page = std::fs::read_to_string(&path).unwrap();
    assert!(page == expected, "docs/methods/README.md is out of date: run the tests with UPDATE=1 to write it anew");
}
