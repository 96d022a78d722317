//! Glass and water on the GPU against rays traced through the same scene, and laws that need no truth.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod studio;

use std::sync::Arc;

use cloud::sampling::Placement;
use cloud::{Chunk, Cloud, Progress, pack_normal, pack_radius};
use glam::{DVec3, Vec3};
use render::{Aov, ColorPlan, Material, PointStore};
use scene::five_mirrors::{self, SampledPart, Variant};
use scene::{Camera, LightClues, METHODS, Method, Mirror, Settings, Shape, Supply};
use study::{Drawn, Subject, SubjectPart, TracedScene, Tracer, Truth, View, clear_points, delta_e};
use trace::Exact;
use trace::exact::{Albedo, Object};

use studio::{Studio, studio};

const SIZE: [u32; 2] = [128, 96];
const POINTS: u32 = 200_000;

/// Pictures in the points' own colours, so that they differ by geometry alone.
fn settings(method: &str) -> Settings {
    let mut settings = Settings::default();
    settings.scene.points = POINTS;
    settings.set_text("reflection.method", method).unwrap();
    settings.set_text("light.by", "colors").unwrap();
    settings
}

/// What lies within another mirror: a ball around a place, which is given in the axes of that mirror, its size being 1.
struct Inner {
    place: DVec3,
    radius: f64,
    is_mirror: bool,
}

/// The box of the five mirrors with one mirror of its middle, made of a clear material and drawn by its formula.
fn in_box(studio: &Studio, shape: Shape, size: f64, refraction: Option<f32>, settings: &Settings) -> Subject {
    filled_in_box(studio, shape, size, refraction, None, settings)
}

/// The box of `in_box` with something inside the mirror.
fn filled_in_box(
    studio: &Studio,
    shape: Shape,
    size: f64,
    refraction: Option<f32>,
    inner: Option<Inner>,
    settings: &Settings,
) -> Subject {
    let mut parts = five_mirrors::sample(Variant::None, POINTS.into(), 1);
    let surface = DVec3::ZERO;
    let mirror = Mirror { position: surface, refraction, ..Mirror::standing(shape, surface, DVec3::Z, DVec3::Y, size) };
    let walls = Variant::None.walls();
    let walls =
        walls.into_iter().map(|(surface, albedo)| Object::new(surface, Placement::ORIGIN, Albedo::At(albedo), 0.0));
    let (own, placement) = mirror.surface();
    let object = Object::new(own, placement, Albedo::Even(mirror.color.map(f64::from)), 1.0);
    let object = refraction.map(|index| object.clone().with_refraction(index.into())).unwrap_or(object);
    let mut objects: Vec<Object> = walls.chain([object]).collect();
    let chunks = mirror.sample(20_000, 1);
    if let Some(Inner { place, radius, is_mirror }) = inner {
        let (place, radius) = (mirror.position + mirror.rotation * (place * mirror.size), radius * mirror.size);
        let ball = Mirror { position: place, ..Mirror::standing(Shape::Sphere, place, DVec3::Z, DVec3::Y, radius) };
        let (surface, placement) = ball.surface();
        let albedo = if is_mirror { ball.color.map(f64::from) } else { [1.0, 0.0, 0.0] };
        objects.push(Object::new(surface, placement, Albedo::Even(albedo), f64::from(u8::from(is_mirror))));
        let mut chunks = ball.sample(20_000, 1);
        for chunk in &mut chunks {
            chunk.colors = Some(Arc::new(vec![[255, 0, 0, 255]; chunk.len()]));
        }
        parts.push(SampledPart { chunks, mirror: is_mirror.then_some(ball) });
    }
    let exact = Exact::new(objects);
    parts.push(SampledPart { chunks, mirror: Some(mirror) });
    let lights = vec![five_mirrors::light()];
    Subject::sampled(&studio.gpu, parts, lights, five_mirrors::camera(), Some(exact), settings).unwrap()
}

/// The CIEDE2000 differences of a frame from the truth, over the mirror pixels, in order of size.
fn differences(studio: &mut Studio, subject: &Subject, settings: &Settings, truth: Truth) -> Vec<f32> {
    subject.render(&mut studio.renderer, settings, SIZE).unwrap();
    let progress = Progress::default();
    let traced = TracedScene::new(&subject.parts, subject.exact.clone(), settings.splat.size, &progress).unwrap();
    let view = View { camera: &subject.camera, settings, objects: subject.objects(), size: SIZE };
    let tracer = Tracer::new(&traced, view);
    let drawn: Drawn = tracer.drawn(&studio.renderer).unwrap();
    let seen = match truth {
        Truth::Exact => tracer.exactly_seen(&progress).unwrap(),
        Truth::SameInput => tracer.seen(&drawn.surface),
    };
    let colors = tracer.colors(truth, &seen, &progress).unwrap();
    let is_mirror = |pixel: &usize| {
        drawn.surface.is_mirror(*pixel) && seen[*pixel].is_some_and(|(hit, _)| hit.specular_intensity > 0.0)
    };
    let pixels: Vec<usize> = (0..colors.len()).filter(is_mirror).collect();
    let of = |colors: &[[f32; 3]]| pixels.iter().map(|pixel| colors[*pixel]).collect::<Vec<_>>();
    let mut differences = delta_e(&of(&drawn.color), &of(&colors));
    differences.sort_unstable_by(f32::total_cmp);
    differences
}

fn quantile(sorted: &[f32], share: f64) -> f32 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

#[test]
fn glass_of_every_closed_shape_shows_what_rays_through_it_meet() {
    let Some(mut studio) = studio() else { return };
    let settings = settings("surfel_trace");
    // The first run gave 0.10 and 0.12 for each, which is the rounding of the points' colours.
    for (shape, size, bounds) in [
        (Shape::Sphere, 0.43, [0.3, 1.0]),
        (Shape::Torus { tube: 0.4 }, 0.33, [0.3, 1.0]),
        (Shape::Blob, 0.4, [0.3, 1.0]),
    ] {
        let subject = in_box(&studio, shape.clone(), size, Some(1.5), &settings);
        let found = differences(&mut studio, &subject, &settings, Truth::Exact);
        let [median, p90] = [0.5, 0.9].map(|share| quantile(&found, share));
        println!("{}: median {median:.2}, 90th percentile {p90:.2} of {} pixels", shape.name(), found.len());
        assert!(found.len() > 800, "{} pixels", found.len());
        assert!(median < bounds[0] && p90 < bounds[1], "{}: {median}, {p90}", shape.name());
        // An opaque mirror shows something else.
        let opaque = in_box(&studio, shape.clone(), size, None, &settings);
        opaque.render(&mut studio.renderer, &settings, SIZE).unwrap();
        let drawn = studio.renderer.read_aov(Aov::Color).unwrap().data;
        subject.render(&mut studio.renderer, &settings, SIZE).unwrap();
        let clear = studio.renderer.read_aov(Aov::Color).unwrap().data;
        let changed = drawn.iter().zip(&clear).filter(|(a, b)| (**a - **b).abs() > 0.05).count();
        assert!(changed > 1000, "{changed} values");
    }
}

#[test]
fn what_lies_inside_a_solid_is_seen_through_it() {
    let Some(mut studio) = studio() else { return };
    let off_center = DVec3::new(0.3, -0.2, 0.25);
    // In the tube of the torus, which rays may cross by total reflections.
    let in_tube = DVec3::X;
    let torus = Shape::Torus { tube: 0.4 };
    for (shape, size, place, radius, is_mirror, method, bounces) in [
        (Shape::Sphere, 0.43, off_center, 0.35, false, "surfel_trace", 1),
        (Shape::Sphere, 0.43, off_center, 0.35, false, "screen_trace", 1),
        (Shape::Sphere, 0.43, off_center, 0.35, false, "cubemap_trace", 2),
        (Shape::Sphere, 0.43, off_center, 0.35, true, "surfel_trace", 3),
        (torus, 0.33, in_tube, 0.3, false, "sscr_hierarchical", 1),
        (Shape::Blob, 0.4, off_center, 0.3, false, "surfel_trace", 1),
    ] {
        let mut settings = settings(method);
        settings.reflection.bounces = bounces;
        let inner = Inner { place, radius, is_mirror };
        let subject = filled_in_box(&studio, shape.clone(), size, Some(1.5), Some(inner), &settings);
        let found = differences(&mut studio, &subject, &settings, Truth::Exact);
        let [median, p95] = [0.5, 0.95].map(|share| quantile(&found, share));
        let filled = studio.renderer.read_aov(Aov::Color).unwrap().data;
        let empty = in_box(&studio, shape.clone(), size, Some(1.5), &settings);
        empty.render(&mut studio.renderer, &settings, SIZE).unwrap();
        let empty = studio.renderer.read_aov(Aov::Color).unwrap().data;
        let (filled, empty) = (filled.as_chunks::<3>().0, empty.as_chunks::<3>().0);
        let changed = delta_e(filled, empty).iter().filter(|difference| **difference > 10.0).count();
        let name = shape.name();
        println!(
            "{name} {method} {bounces}: median {median:.2}, 95th percentile {p95:.2}, {changed} pixels of the ball"
        );
        assert!(changed > 50 && median < 0.3 && p95 < 3.0, "{name}, {method}: {median}, {p95}, {changed} pixels");
    }
}

#[test]
fn glass_without_an_index_of_its_own_is_invisible() {
    let Some(mut studio) = studio() else { return };
    let settings = settings("surfel_trace");
    let nothing = Subject::five_mirrors(&studio.gpu, Variant::None, &settings).unwrap();
    nothing.render(&mut studio.renderer, &settings, SIZE).unwrap();
    let without = studio.renderer.read_aov(Aov::Color).unwrap().data;
    for shape in [Shape::Sphere, Shape::Torus { tube: 0.4 }, Shape::Plane { height: 0.7 }] {
        let subject = in_box(&studio, shape.clone(), 0.4, Some(1.0), &settings);
        subject.render(&mut studio.renderer, &settings, SIZE).unwrap();
        let index = studio.renderer.read_aov(Aov::Refraction).unwrap().data;
        let with = studio.renderer.read_aov(Aov::Color).unwrap().data;
        let (with, without) = (with.as_chunks::<3>().0, without.as_chunks::<3>().0);
        let clear: Vec<usize> = (0..index.len()).filter(|pixel| index[*pixel].abs() == 1.0).collect();
        let of = |colors: &[[f32; 3]]| clear.iter().map(|pixel| colors[*pixel]).collect::<Vec<_>>();
        let mut found = delta_e(&of(with), &of(without));
        found.sort_unstable_by(f32::total_cmp);
        let [median, p90] = [0.5, 0.9].map(|share| quantile(&found, share));
        println!("{}: median {median:.2}, 90th percentile {p90:.2} of {} pixels", shape.name(), clear.len());
        assert!(clear.len() > 800 && median < 0.1 && p90 < 0.5, "{}: {median}, {p90}", shape.name());
    }
}

#[test]
fn every_method_shows_what_is_behind_glass() {
    let Some(mut studio) = studio() else { return };
    for row in METHODS.iter().filter(|row| row.supply != Supply::Nothing && row.method != Method::Auto) {
        let settings = settings(row.name);
        let subject = in_box(&studio, Shape::Sphere, 0.43, Some(1.5), &settings);
        let found = differences(&mut studio, &subject, &settings, Truth::Exact);
        let [median, p90] = [0.5, 0.9].map(|share| quantile(&found, share));
        println!("{}: median {median:.2}, 90th percentile {p90:.2}", row.name);
        // An environment map shows everything as if it were far away.
        let most = if row.method == Method::EnvironmentMap { 30.0 } else { 3.0 };
        assert!(median < most, "{}: {median}", row.name);
    }
}

#[test]
fn the_ray_tracer_as_the_method_sees_through_glass_and_water() {
    // It starts from a frame without reflections, which knows what is clear all the same.
    let Some(mut studio) = studio() else { return };
    let (followed, mut alone) = (settings("surfel_trace"), settings("none"));
    let opaque = in_box(&studio, Shape::Sphere, 0.43, None, &followed);
    for bounces in [1, 3] {
        let mut followed = followed.clone();
        (followed.reflection.bounces, alone.reflection.bounces) = (bounces, bounces);
        let ball = in_box(&studio, Shape::Sphere, 0.43, Some(1.5), &followed);
        let torus = in_box(&studio, Shape::Torus { tube: 0.4 }, 0.33, Some(1.5), &followed);
        for (name, subject) in [("ball", ball), ("torus", torus), ("pool", pool(&studio, 1.33, &followed))] {
            subject.render(&mut studio.renderer, &followed, SIZE).unwrap();
            let [expected, index] =
                [Aov::Color, Aov::Refraction].map(|aov| studio.renderer.read_aov(aov).unwrap().data);
            // Kept frames know it as well.
            for _ in 0..2 {
                subject.render(&mut studio.renderer, &alone, SIZE).unwrap();
                let own = studio.renderer.read_aov(Aov::Refraction).unwrap().data;
                let off = (0..index.len()).filter(|pixel| own[*pixel].to_bits() != index[*pixel].to_bits());
                assert_eq!(off.count(), 0, "{name}, {bounces}: pixels with another index of refraction");
            }
            let progress = Progress::default();
            let traced = TracedScene::new(&subject.parts, None, alone.splat.size, &progress).unwrap();
            let view = View { camera: &subject.camera, settings: &alone, objects: subject.objects(), size: SIZE };
            let tracer = Tracer::new(&traced, view);
            let mut drawn = tracer.drawn(&studio.renderer).unwrap();
            tracer.ray_trace(&mut drawn, &progress).unwrap();
            let clear: Vec<usize> = (0..index.len()).filter(|pixel| index[*pixel].abs() > 1.0).collect();
            let of = |colors: &[[f32; 3]]| clear.iter().map(|pixel| colors[*pixel]).collect::<Vec<_>>();
            let mut found = delta_e(&of(&drawn.color), &of(expected.as_chunks::<3>().0));
            found.sort_unstable_by(f32::total_cmp);
            let [median, p90] = [0.5, 0.9].map(|share| quantile(&found, share));
            println!("{name}: median {median:.2}, 90th percentile {p90:.2} of {} pixels", found.len());
            assert!(found.len() > 800 && median < 0.3 && p90 < 2.0, "{name}: {median}, {p90}");
        }
    }
    opaque.render(&mut studio.renderer, &alone, SIZE).unwrap();
    let index = studio.renderer.read_aov(Aov::Refraction).unwrap().data;
    assert!(index.iter().all(|index| *index == 0.0 || index.is_nan()), "nothing is clear");
}

/// A square of points in z = `z`, `edge` wide.
fn square(z: f64, edge: f64, step: f64, color: impl Fn(DVec3) -> [u8; 3]) -> Chunk {
    let count = (edge / step) as i32;
    let places: Vec<DVec3> = (0..count * count)
        .map(|i| DVec3::new(f64::from(i % count) + 0.5, f64::from(i / count) + 0.5, 0.0) * step)
        .map(|place| place + DVec3::new(-0.5 * edge, -0.5 * edge, z))
        .collect();
    let mut chunk = Chunk::new(0, DVec3::ZERO, places.iter().map(|place| place.as_vec3().to_array()).collect());
    let colors = places.iter().map(|place| {
        let [red, green, blue] = color(*place);
        [red, green, blue, 255]
    });
    chunk.colors = Some(Arc::new(colors.collect()));
    chunk.normals = Some(Arc::new(vec![pack_normal(Vec3::Z); places.len()]));
    chunk.radii = Some(Arc::new(vec![pack_radius(step as f32); places.len()]));
    chunk
}

/// A pool of water made of points, half a unit deep, over a chequered floor that ends in the middle; a wall stands
/// behind it.
fn pool(studio: &Studio, refraction: f32, settings: &Settings) -> Subject {
    let check = |place: DVec3| {
        let odd = ((place.x * 4.0).floor() + (place.y * 4.0).floor()).rem_euclid(2.0) == 1.0;
        if odd { [200, 190, 170] } else { [70, 60, 40] }
    };
    let mut floor = square(-0.5, 4.0, 0.02, check);
    let half: Vec<u32> = (0..floor.len() as u32).filter(|i| floor.position(*i as usize).x < 0.0).collect();
    floor = floor.select(&half);
    let mut wall = square(0.0, 4.0, 0.02, |place| if place.x < 0.3 { [180, 40, 40] } else { [40, 40, 180] });
    let upright = wall.positions.iter().map(|[x, y, _]| [*x, 2.0, y + 2.0]).collect();
    wall.positions = Arc::new(upright);
    wall.normals = Some(Arc::new(vec![pack_normal(-Vec3::Y); wall.len()]));
    let water = square(0.0, 4.0, 0.02, |_| [20, 90, 70]);
    let mut store = PointStore::new(studio.gpu.clone());
    let clear = Material { specular_intensity: 1.0, refraction, ..Material::default() };
    let mut parts = Vec::new();
    for (chunks, material) in [(vec![floor, wall], Material::default()), (vec![water], clear)] {
        let id = store.add_cloud(material);
        let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
        let cloud = Cloud { chunks, ..Cloud::default() };
        let (plan, _) = ColorPlan::new(&cloud, &settings.color, DVec3::Z);
        store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
        parts.push(SubjectPart {
            cloud,
            specular_intensity: material.specular_intensity,
            specular_power: 0.0,
            clear: clear_points(&material),
            plan,
            up: DVec3::Z,
        });
    }
    let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.1, -1.0, 0.5), 3.0, DVec3::Z);
    let (mirrors, lights) = (Vec::new(), Vec::new());
    Subject { parts, store, mirrors, lights, clues: LightClues::default(), camera, exact: None }
}

#[test]
fn water_of_points_shows_its_floor_its_own_colour_and_what_it_reflects() {
    let Some(mut studio) = studio() else { return };
    for method in ["surfel_trace", "sscr_hierarchical", "cubemap_trace"] {
        let settings = settings(method);
        let subject = pool(&studio, 1.33, &settings);
        let found = differences(&mut studio, &subject, &settings, Truth::SameInput);
        let [median, p90] = [0.5, 0.9].map(|share| quantile(&found, share));
        println!("{method}: median {median:.2}, 90th percentile {p90:.2} of {} pixels", found.len());
        assert!(found.len() > 4000 && median < 0.1 && p90 < 0.5, "{method}: {median}, {p90}");
    }
}

#[test]
fn water_casts_no_shadow_on_its_floor() {
    let Some(mut studio) = studio() else { return };
    let mut settings = settings("surfel_trace");
    settings.set_text("light.by", "sun").unwrap();
    settings.set_text("gi.bounces", "0").unwrap();
    settings.set_text("sun.sky", "0").unwrap();
    let lit = |studio: &mut Studio, refraction: f32| {
        let mut subject = pool(studio, refraction, &settings);
        // From below, where the floor ends.
        subject.camera = Camera::looking(DVec3::new(-1.0, 0.0, -0.5), DVec3::new(0.8, -0.3, 0.25), 1.2, DVec3::Z);
        subject.render(&mut studio.renderer, &settings, SIZE).unwrap();
        let position = studio.renderer.read_aov(Aov::Position).unwrap().data;
        let direct = studio.renderer.read_aov(Aov::Direct).unwrap().data;
        let floor = position.as_chunks::<3>().0.iter().zip(direct.as_chunks::<3>().0);
        let floor: Vec<f32> = floor.filter(|(at, _)| (at[2] + 0.5).abs() < 0.01).map(|(_, light)| light[0]).collect();
        assert!(floor.len() > 500, "{}", floor.len());
        floor.iter().sum::<f32>() / floor.len() as f32
    };
    let [through_water, under_a_mirror] = [1.33, 0.0].map(|refraction| lit(&mut studio, refraction));
    assert!(through_water > 0.02 && under_a_mirror < 0.2 * through_water, "{through_water}, {under_a_mirror}");
}

#[test]
fn no_light_is_lost_at_a_ball_of_glass() {
    // A closed white box stays white behind glass: what is reflected and what goes through add up to all.
    let Some(mut studio) = studio() else { return };
    let settings = settings("surfel_trace");
    let mut subject = in_box(&studio, Shape::Sphere, 0.43, Some(1.5), &settings);
    for part in subject.parts.iter_mut().take(1) {
        for chunk in &mut part.cloud.chunks {
            chunk.colors = Some(Arc::new(vec![[255; 4]; chunk.len()]));
        }
    }
    let parts = subject.parts.iter().enumerate().map(|(index, part)| {
        let mirror = (index > 0).then(|| subject.mirrors[0].clone());
        SampledPart { chunks: part.cloud.chunks.clone(), mirror }
    });
    let parts = parts.collect();
    let white = Subject::sampled(&studio.gpu, parts, Vec::new(), five_mirrors::camera(), None, &settings).unwrap();
    white.render(&mut studio.renderer, &settings, SIZE).unwrap();
    let color = studio.renderer.read_aov(Aov::Color).unwrap().data;
    let index = studio.renderer.read_aov(Aov::Refraction).unwrap().data;
    let glass = color.as_chunks::<3>().0.iter().zip(&index).filter(|(_, index)| **index > 0.0);
    let off: Vec<f32> =
        glass.map(|(color, _)| color.map(|value| (value - 1.0).abs()).into_iter().fold(0.0, f32::max)).collect();
    let worst = off.iter().copied().fold(0.0, f32::max);
    assert!(off.len() > 800 && worst < 0.01, "{worst} among {} pixels", off.len());
}

#[test]
fn glass_and_water_in_mirrors_are_seen_through_as_well() {
    // What is behind a second clear surface takes a second bounce: the stronger part of its light, on both sides.
    let Some(mut studio) = studio() else { return };
    let mut settings = settings("surfel_trace");
    settings.reflection.bounces = 3;
    let subject = in_box(&studio, Shape::Torus { tube: 0.4 }, 0.33, Some(1.5), &settings);
    let found = differences(&mut studio, &subject, &settings, Truth::Exact);
    let [median, p90] = [0.5, 0.9].map(|share| quantile(&found, share));
    println!("torus, 3 bounces: median {median:.2}, 90th percentile {p90:.2}");
    assert!(median < 0.3 && p90 < 2.0, "{median}, {p90}");
    // A mirror above the pool shows its water.
    let mut subject = pool(&studio, 1.33, &settings);
    let ceiling = square(1.0, 4.0, 0.02, |_| [128; 3]);
    let material = Material { specular_intensity: 1.0, ..Material::default() };
    let id = subject.store.add_cloud(material);
    let ids = [subject.store.add_chunk(id, &ceiling, None).unwrap()];
    let cloud = Cloud { chunks: vec![ceiling], ..Cloud::default() };
    let (plan, _) = ColorPlan::new(&cloud, &settings.color, DVec3::Z);
    subject.store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
    let part = SubjectPart { cloud, specular_intensity: 1.0, specular_power: 0.0, clear: None, plan, up: DVec3::Z };
    subject.parts.push(part);
    subject.camera = Camera::looking(DVec3::Z, DVec3::new(0.1, -1.0, -0.3), 1.5, DVec3::Z);
    let found = differences(&mut studio, &subject, &settings, Truth::SameInput);
    let [median, p90] = [0.5, 0.9].map(|share| quantile(&found, share));
    println!("water in a mirror: median {median:.2}, 90th percentile {p90:.2} of {} pixels", found.len());
    assert!(found.len() > 4000 && median < 0.3 && p90 < 2.0, "{median}, {p90}");
}
