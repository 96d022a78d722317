//! Reflections that fade by distance, and the published law of the angle, in closed form.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;

use std::sync::Arc;

use cloud::{Chunk, Cloud, pack_normal, pack_radius};
use glam::{DQuat, DVec3, Vec3};
use render::{Aov, CloudId, ColorPlan, Frame, FrameStats, Material, Objects, PointStore};
use scene::{Camera, Mirror, Settings, Shape};

use stage::Stage;

const SIZE: [u32; 2] = [96, 72];
/// The distance of a wall's points.
const STEP: f64 = 0.05;

/// A mirror in z = 0 that faces up, and a wall over part of it that climbs away from it.
struct Scene {
    store: PointStore,
    wall: CloudId,
    mirrors: Vec<Mirror>,
    camera: Camera,
}

/// The wall: x and y from -5 to `end`, at the height 1 + (x + 3) / 4.
fn wall(end: f64) -> Chunk {
    let normal = DVec3::new(0.25, 0.0, -1.0).normalize().as_vec3();
    let count = ((end + 5.0) / STEP) as u32;
    let place = |cell: u32| {
        let [x, y] = [cell % count, cell / count].map(|step| (f64::from(step) + 0.5) * STEP - 5.0);
        [x, y, 1.0 + (x + 3.0) / 4.0].map(|part| part as f32)
    };
    let mut chunk = Chunk::new(0, DVec3::ZERO, (0..count * count).map(place).collect());
    chunk.colors = Some(Arc::new(vec![[250, 120, 40, 255]; chunk.len()]));
    chunk.radii = Some(Arc::new(vec![pack_radius(STEP as f32); chunk.len()]));
    chunk.normals = Some(Arc::new(vec![pack_normal(normal); chunk.len()]));
    chunk
}

impl Scene {
    fn new(stage: &Stage, end: f64, specular_power: f32) -> Self {
        let mut store = PointStore::new(stage.gpu.clone());
        let mut add = |chunks: Vec<Chunk>, material| {
            let id = store.add_cloud(material);
            let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
            let cloud = Cloud { chunks, ..Cloud::default() };
            let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
            store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
            id
        };
        let wall = add(vec![wall(end)], Material::default());
        let mirror = Mirror {
            position: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            specular_intensity: 0.75,
            specular_power,
            color: [0.1, 0.5, 0.3],
            ..Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::ZERO, DVec3::Z, DVec3::Y, 1.0)
        };
        add(mirror.sample(2000, 1), Material::of_mirror(&mirror));
        let camera = Camera::from_eye(DVec3::new(1.5, -0.8, 0.9), DVec3::ZERO, DVec3::Z);
        Self { store, wall, mirrors: vec![mirror], camera }
    }

    fn render(&self, stage: &mut Stage, settings: &Settings) -> FrameStats {
        let objects = Objects { mirrors: &self.mirrors, ..Objects::default() };
        stage.renderer.render(&self.store, &Frame::new(&self.camera, settings, objects, SIZE)).unwrap()
    }
}

fn settings(pairs: &[(&str, &str)]) -> Settings {
    let mut settings = Settings::default();
    let common = [("light.by", "colors"), ("view.background", "#8090ff"), ("reflection.method", "surfel_trace")];
    for (key, value) in common.iter().chain(pairs) {
        settings.set_text(key, value).unwrap();
    }
    settings
}

fn vectors(stage: &Stage, aov: Aov) -> Vec<Vec3> {
    let image = stage.renderer.read_aov(aov).unwrap();
    let channels = image.channels.len();
    image.data.chunks_exact(channels).map(|texel| Vec3::from_slice(&texel[..3])).collect()
}

fn mirror_colors(stage: &Stage) -> Vec<Vec3> {
    let mirror = stage.renderer.read_aov(Aov::Mirror).unwrap().data;
    vectors(stage, Aov::Color)
        .into_iter()
        .zip(mirror)
        .filter(|(_, mirror)| *mirror > 0.0)
        .map(|(color, _)| color)
        .collect()
}

/// What each mirror pixel shows, and what it is to show by its share, given the distance of what it reflects in mirror
/// radii (infinite for nothing) and the cosine of its line of sight; and that distance. `tint` is `mirror.tint`.
fn compared(stage: &Stage, scene: &Scene, tint: f32, share: impl Fn(f64, f64) -> f64) -> Vec<(Vec3, Vec3, f64)> {
    let [color, albedo, position] = [Aov::Color, Aov::Albedo, Aov::Position].map(|aov| vectors(stage, aov));
    let [seen_at, seen_albedo] = [Aov::MirrorPosition, Aov::MirrorAlbedo].map(|aov| vectors(stage, aov));
    let coverage = stage.renderer.read_aov(Aov::MirrorPosition).unwrap().data;
    let mirror = stage.renderer.read_aov(Aov::Mirror).unwrap().data;
    let background = Vec3::from([0x80, 0x90, 0xff].map(linear));
    let pixels = (0..mirror.len()).filter(|pixel| mirror[*pixel] > 0.0);
    let each = pixels.map(|pixel| {
        let found = coverage[4 * pixel + 3] > 0.0;
        // The box about the mirror's points is square.
        let radii =
            if found { f64::from(seen_at[pixel].distance(position[pixel])) / 2.0_f64.sqrt() } else { f64::INFINITY };
        let to_eye = (scene.camera.eye - position[pixel].as_dvec3()).normalize();
        let share = share(radii, to_eye.z) as f32;
        let reflected = if found { seen_albedo[pixel] } else { background };
        let reflected = reflected * Vec3::ONE.lerp(albedo[pixel], tint);
        (color[pixel], albedo[pixel] * (1.0 - share) + reflected * share, radii)
    });
    each.collect()
}

fn linear(value: u8) -> f32 {
    let value = f32::from(value) / 255.0;
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn assert_near(compared: &[(Vec3, Vec3, f64)], what: &str) {
    // Colours are half floats, and the box about 1024 places of the mirror is a little smaller than the mirror.
    let off = compared.iter().map(|(found, expected, _)| (found - expected).abs().max_element()).fold(0.0, f32::max);
    assert!(compared.len() > 1000 && off < 4e-3, "{what}: {off} of {}", compared.len());
}

#[test]
fn reflections_fade_by_the_square_of_what_is_left_of_the_way() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, 1.0, 0.0);
    let mut shares = Vec::new();
    for method in ["surfel_trace", "sscr_hierarchical", "cubemap_trace", "light_field"] {
        for (distance, least) in [(0.0, 0.5), (1.9, 0.0), (2.5, 0.25), (4.0, 0.0), (10.0, 0.1), (10.0, 1.0)] {
            let settings = settings(&[
                ("reflection.method", method),
                ("mirror.fade_distance", &distance.to_string()),
                ("mirror.fade_least", &least.to_string()),
            ]);
            scene.render(&mut stage, &settings);
            let share = |radii: f64, _| {
                let rest = if distance > 0.0 { 1.0 - (radii / distance).min(1.0) } else { 1.0 };
                0.75 * (least + (1.0 - least) * rest * rest)
            };
            let compared = compared(&stage, &scene, 0.0, share);
            assert_near(&compared, &format!("{method}, {distance}, {least}"));
            let open = compared.iter().filter(|(.., radii)| radii.is_infinite()).count();
            assert!(open > 100, "{open} mirror pixels see nothing");
            shares.extend(compared.iter().map(|(.., radii)| share(*radii, 0.0)));
        }
    }
    assert!([0.02, 0.2, 0.5].iter().all(|share| shares.iter().any(|found| (found - share).abs() < 0.05)));
}

#[test]
fn the_published_law_reflects_less_the_flatter_a_mirror_is_seen() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, 1.0, 0.0);
    for fresnel in [0.0, 0.5, 1.0] {
        for (tint, distance) in [(0.0, 0.0), (0.0, 4.0), (1.0, 0.0)] {
            let settings = settings(&[
                ("mirror.fresnel_law", "published"),
                ("mirror.fresnel", &fresnel.to_string()),
                ("mirror.fade_distance", &distance.to_string()),
                ("mirror.tint", &tint.to_string()),
            ]);
            scene.render(&mut stage, &settings);
            let share = |radii: f64, cosine: f64| {
                let rest = if distance > 0.0 { 1.0 - (radii / distance).min(1.0) } else { 1.0 };
                0.75 * (1.0 - fresnel * (1.0 - cosine * cosine)) * rest * rest
            };
            let compared = compared(&stage, &scene, tint, share);
            assert_near(&compared, &format!("{fresnel}, {tint}, {distance}"));
        }
    }
}

#[test]
fn several_rays_fade_one_by_one() {
    let mut stage = stage_or_skip!();
    let fading = [("mirror.fade_distance", "4"), ("mirror.fade_least", "0.1")];
    let with = |pairs: &[(&str, &str)]| settings(&[&fading[..], pairs].concat());
    // Where the distance changes little within a pixel, their mean is what one ray shows.
    let scene = Scene::new(&stage, 4.0, 0.0);
    scene.render(&mut stage, &with(&[]));
    let one = mirror_colors(&stage);
    scene.render(&mut stage, &with(&[("reflection.samples", "5")]));
    let five = mirror_colors(&stage);
    let mut off: Vec<f32> = one.iter().zip(&five).map(|(a, b)| (a - b).abs().max_element()).collect();
    off.sort_by(f32::total_cmp);
    assert!(off[off.len() * 19 / 20] < 4e-3 && five != one, "{}", off[off.len() * 19 / 20]);
    // A lobe sees near and far: all of a mirror's light is its own or reflected, so a mirror in its own colour stays so.
    let mut scene = Scene::new(&stage, 4.0, 20.0);
    let wall = vectors(&stage, Aov::MirrorAlbedo).into_iter().find(|albedo| albedo.is_finite()).unwrap();
    scene.mirrors[0].color = wall.to_array();
    for blur in ["0", "1"] {
        let settings = with(&[("gloss.samples", "8"), ("gloss.blur", blur), ("view.background", "#fa7828")]);
        let stats = scene.render(&mut stage, &settings);
        assert_eq!(stats.glossy_samples, [8, 8]);
        for shown in mirror_colors(&stage) {
            // Sums and means are half floats.
            assert!(shown.distance(wall) < 8e-3, "{shown} instead of {wall}");
        }
    }
}

#[test]
fn a_mirrors_own_light_is_what_its_reflections_leave_of_it() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, 1.0, 0.0);
    let lit = [("light.by", "sun"), ("sun.azimuth", "90"), ("gi.vpls", "16"), ("gi.sky_lights", "16")];
    let with = |pairs: &[(&str, &str)]| settings(&[&lit[..], pairs].concat());
    let lights = [Aov::Direct, Aov::Indirect];
    scene.render(&mut stage, &with(&[("reflection.bounces", "0")]));
    let whole = lights.map(|aov| vectors(&stage, aov));
    let mirror = stage.renderer.read_aov(Aov::Mirror).unwrap().data;
    for (rays, law) in [("1", "schlick"), ("1", "published"), ("5", "schlick")] {
        scene.render(
            &mut stage,
            &with(&[
                ("mirror.fade_distance", "4"),
                ("mirror.fade_least", "0.1"),
                ("mirror.fresnel", "1"),
                ("mirror.fresnel_law", law),
                ("reflection.samples", rays),
            ]),
        );
        let share = |radii: f64, cosine: f64| {
            let rest = (1.0 - radii / 4.0).max(0.0).powi(2);
            let of_angle = if law == "schlick" { 0.75 + 0.25 * (1.0 - cosine).powi(5) } else { 0.75 * cosine * cosine };
            of_angle * (0.1 + 0.9 * rest)
        };
        let position = vectors(&stage, Aov::Position);
        let met = compared(&stage, &scene, 0.0, |_, _| 0.0);
        let (mut lit, mut off) = (0, 0);
        for (aov, whole) in lights.into_iter().zip(&whole) {
            let own = vectors(&stage, aov);
            for (pixel, (.., radii)) in (0..mirror.len()).filter(|pixel| mirror[*pixel] > 0.0).zip(&met) {
                let to_eye = (scene.camera.eye - position[pixel].as_dvec3()).normalize();
                let expected = whole[pixel] * (1.0 - share(*radii, to_eye.z) as f32);
                lit += u32::from(expected.max_element() > 0.01);
                off += u32::from(!(own[pixel] - expected).abs().cmple(expected * 0.01 + 1e-3).all());
            }
        }
        // The share of several rays is a mean, which differs where the wall ends.
        assert!(lit > 2000 && off * 20 < lit, "{rays} {law}: {off} of {lit}");
    }
}

#[test]
fn only_the_first_fading_searches_anew_and_kept_parts_fit_those_made_anew() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, 1.0, 0.0);
    let searched = |stats: &FrameStats| stats.passes.iter().any(|pass| pass.name == "surfel_trace");
    let mut pictures = Vec::new();
    let changes = [("0", "1", true), ("3", "1", true), ("4", "1", false), ("4", "0.5", false), ("0", "0.5", true)];
    for (distance, amount, anew) in changes {
        let settings = settings(&[
            ("mirror.fade_distance", distance),
            ("mirror.fresnel", amount),
            ("mirror.fresnel_law", "published"),
            ("light.by", "sun"),
            ("gi.vpls", "16"),
        ]);
        assert_eq!(searched(&scene.render(&mut stage, &settings)), anew, "{distance} {amount}");
        let kept = vectors(&stage, Aov::Color);
        stage.renderer.forget();
        scene.render(&mut stage, &settings);
        let same = |(a, b): (&Vec3, &Vec3)| a.to_array().map(f32::to_bits) == b.to_array().map(f32::to_bits);
        assert!(kept.iter().zip(&vectors(&stage, Aov::Color)).all(same), "{distance} {amount}");
        pictures.push(kept);
    }
    assert!(pictures.windows(2).all(|pair| pair[0] != pair[1]));
}

#[test]
fn a_mirror_of_points_fades_as_one_with_a_formula() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, 4.0, 0.0);
    let mut pictures = ["exact", "points"].map(|surface| {
        let settings = settings(&[("mirror.fade_distance", "3"), ("mirror.surface", surface)]);
        scene.render(&mut stage, &settings);
        let mirror = stage.renderer.read_aov(Aov::Mirror).unwrap().data;
        vectors(&stage, Aov::Color).into_iter().zip(mirror).collect::<Vec<_>>()
    });
    let [exact, points] = &mut pictures;
    let both = exact.iter().zip(points).filter(|(a, b)| a.1 > 0.0 && b.1 > 0.0);
    let mut off: Vec<f32> = both.map(|(a, b)| (a.0 - b.0).abs().max_element()).collect();
    off.sort_by(f32::total_cmp);
    assert!(off.len() > 1000 && off[off.len() * 19 / 20] < 0.01, "{} {}", off.len(), off[off.len() * 19 / 20]);
    // A mirror without its wall shows its own colour alone.
    scene.store.remove_cloud(scene.wall);
    let settings = settings(&[("mirror.fade_distance", "3"), ("mirror.surface", "exact")]);
    scene.render(&mut stage, &settings);
    assert_near(&compared(&stage, &scene, 0.0, |_, _| 0.0), "nothing to reflect");
}
