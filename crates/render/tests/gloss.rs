//! Glossy mirrors: what the mean over their rays is in closed form, and the laws that it obeys for every method.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;

use std::sync::Arc;

use cloud::{Chunk, Cloud, pack_normal, pack_radius};
use glam::{DQuat, DVec3};
use render::{
    Aov, CloudId, ColorPlan, ColorSource, Error, Frame, FrameStats, GlossCache, Material, Objects, PointStore,
    ReflectionStats,
};
use scene::{Camera, METHODS, Method, Mirror, Settings, Shape, SpotLight, Supply};

use stage::Stage;

const SIZE: [u32; 2] = [64, 48];
/// The columns in the middle of a picture of `SIZE`: pixels have equal places and sizes in both.
const STRIP: [u32; 2] = [12, SIZE[1]];
const WHITE: [u8; 3] = [255; 3];
const BLACK: [u8; 3] = [0; 3];

/// The points of a box of edge 4 about the origin, seen from within; those at positive x have the second colour.
fn room(colors: [[u8; 3]; 2]) -> Chunk {
    const STEP: f64 = 0.1;
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            for cell in 0..1600 {
                let across = [cell % 40, cell / 40].map(|step| (f64::from(step) + 0.5) * STEP - 2.0);
                let at = [side * 2.0, across[0], across[1]];
                points.push([0, 1, 2].map(|part| at[(part + 3 - axis) % 3] as f32));
                let inward = [-side, 0.0, 0.0];
                normals.push(pack_normal(DVec3::from([0, 1, 2].map(|part| inward[(part + 3 - axis) % 3])).as_vec3()));
            }
        }
    }
    let color = |at: &[f32; 3]| {
        let [red, green, blue] = colors[usize::from(at[0] > 0.0)];
        [red, green, blue, 255]
    };
    let mut chunk = Chunk::new(0, DVec3::ZERO, points);
    chunk.colors = Some(Arc::new(chunk.positions.iter().map(color).collect()));
    chunk.radii = Some(Arc::new(vec![pack_radius(STEP as f32); chunk.len()]));
    chunk.normals = Some(Arc::new(normals));
    chunk
}

/// A lamp in the room, with a cone of these angles in degrees.
fn lamp(inner_degrees: f32, outer_degrees: f32) -> SpotLight {
    let (position, target) = (DVec3::new(-1.5, -1.0, 1.0), DVec3::new(2.0, 1.0, 0.0));
    SpotLight { position, target, intensity: [10.0; 3], inner_degrees, outer_degrees }
}

struct Scene {
    store: PointStore,
    room: CloudId,
    mirrors: Vec<Mirror>,
    lights: Vec<SpotLight>,
    camera: Camera,
}

impl Scene {
    /// A sphere in the middle of a room, of this specular power.
    fn new(stage: &Stage, colors: [[u8; 3]; 2], power: f32) -> Self {
        let mut store = PointStore::new(stage.gpu.clone());
        let mut add = |chunks: Vec<Chunk>, material| {
            let id = store.add_cloud(material);
            let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
            let cloud = Cloud { chunks, ..Cloud::default() };
            let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
            store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
            id
        };
        let room = add(vec![room(colors)], Material::default());
        let sphere = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Y, 0.7);
        let sphere = Mirror { position: DVec3::ZERO, specular_intensity: 1.0, specular_power: power, ..sphere };
        let material =
            Material { specular_intensity: 1.0, specular_power: power, has_formula: true, ..Material::default() };
        add(sphere.sample(2000, 1), material);
        let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.0, -1.0, 0.1), 1.7, DVec3::Z);
        Self { store, room, mirrors: vec![sphere], lights: Vec::new(), camera }
    }

    fn render(&self, stage: &mut Stage, settings: &Settings) -> FrameStats {
        self.try_render(stage, settings).unwrap()
    }

    /// Draws the middle of the picture.
    fn render_strip(&self, stage: &mut Stage, settings: &Settings) -> FrameStats {
        self.render_in(stage, settings, STRIP).unwrap()
    }

    fn try_render(&self, stage: &mut Stage, settings: &Settings) -> render::Result<FrameStats> {
        self.render_in(stage, settings, SIZE)
    }

    fn render_in(&self, stage: &mut Stage, settings: &Settings, size: [u32; 2]) -> render::Result<FrameStats> {
        let objects = Objects { mirrors: &self.mirrors, lights: &self.lights, ..Objects::default() };
        let frame = Frame::new(&self.camera, settings, objects, size);
        stage.renderer.render(&self.store, &Frame { effort: stage.effort, ..frame })
    }
}

fn settings(method: Method, samples: u32, pairs: &[(&str, &str)]) -> Settings {
    let mut settings = Settings::default();
    settings.reflection.method = method;
    settings.gloss.samples = samples;
    // Maps are drawn for each picture that is made anew: their texels are still finer than the points.
    (settings.cubemap_trace.size, settings.environment_map.size) = (64, 64);
    settings.set_text("light.by", "colors").unwrap();
    settings.set_text("view.background", "#ffffff").unwrap();
    for (key, value) in pairs {
        settings.set_text(key, value).unwrap();
    }
    settings
}

/// The methods that know glossy mirrors.
fn methods() -> impl Iterator<Item = Method> {
    let known = METHODS.iter().filter(|row| row.supply != Supply::Nothing && row.method.chosen() == row.method);
    known.map(|row| row.method).filter(|method| *method != Method::MirroredViewpoint)
}

/// Samples that show the shape of a lobe. Methods that search for each ray anew take as long for it as others for many.
fn many(method: Method) -> u32 {
    if matches!(method, Method::Sscr | Method::SampleCameras) { 16 } else { 64 }
}

fn colors(stage: &Stage) -> Vec<[f32; 3]> {
    stage.renderer.read_aov(Aov::Color).unwrap().data.as_chunks::<3>().0.to_vec()
}

fn mirror_pixels(stage: &Stage) -> Vec<usize> {
    let mirror = stage.renderer.read_aov(Aov::Mirror).unwrap().data;
    (0..mirror.len()).filter(|pixel| mirror[*pixel] > 0.0).collect()
}

/// The normals that Ashikhmin and Shirley's lobe of one exponent draws about z, by a grid of equal shares.
fn drawn_normals(power: f64) -> Vec<DVec3> {
    let (rings, turns) = (100, 100);
    let drawn = (0..rings * turns).map(|cell| {
        let [ring, turn] = [cell % rings, cell / rings].map(|step| (f64::from(step) + 0.5) / f64::from(rings));
        let cosine = ring.powf(1.0 / (power + 1.0));
        let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
        (DVec3::new(cos, sin, 0.0) * (1.0 - cosine * cosine).sqrt()).with_z(cosine)
    });
    drawn.collect()
}

/// The share of an even light that a lobe with these normals reflects, seen at this cosine: the mean of
/// min(1, n.l / n.v).
fn reflected_of_even_light(normals: &[DVec3], from_view: f64) -> f64 {
    let view = DVec3::new((1.0 - from_view * from_view).sqrt(), 0.0, from_view);
    let share = |half: &DVec3| {
        let light = 2.0 * half.dot(view) * half.z - view.z;
        (light / from_view).clamp(0.0, 1.0)
    };
    normals.iter().map(share).sum::<f64>() / normals.len() as f64
}

#[test]
fn ashikhmin_and_shirleys_lobe_darkens_as_its_closed_form_says_by_every_method() {
    let mut stage = stage_or_skip!();
    for power in [10.0, 100.0] {
        let scene = Scene::new(&stage, [WHITE, WHITE], power);
        let normals = drawn_normals(f64::from(power));
        for method in methods() {
            let pairs = [("gloss.lobe", "ashikhmin_shirley"), ("gloss.across", "1"), ("gloss.cache_power", "500")];
            // The few samples that all pixels of a method share tend to one side in a strip.
            let size = if many(method) < 64 { SIZE } else { STRIP };
            scene.render_in(&mut stage, &settings(method, many(method), &pairs), size).unwrap();
            let shown = colors(&stage);
            let [position, normal] = [Aov::Position, Aov::Normal]
                .map(|aov| stage.renderer.read_aov(aov).unwrap().data.as_chunks::<3>().0.to_vec());
            let (mut sum, mut expected, mut squares) = (0.0, 0.0, 0.0);
            let pixels = mirror_pixels(&stage);
            for pixel in &pixels {
                let [position, normal] = [position[*pixel], normal[*pixel]].map(|v| DVec3::from(v.map(f64::from)));
                let cosine = (scene.camera.eye - position).normalize().dot(normal.normalize());
                let share = reflected_of_even_light(&normals, cosine.max(0.01));
                let found = f64::from(shown[*pixel][0]);
                (sum, expected, squares) = (sum + found, expected + share, squares + (found - share).powi(2));
            }
            let (mean, rmse) = (sum / expected, (squares / pixels.len() as f64).sqrt());
            let what = format!("{}, power {power}: {mean:.4} of it, off by {rmse:.4}", method.row().name);
            println!("{what}");
            assert!(expected < 0.95 * pixels.len() as f64, "the lobe darkens");
            // The noise of a mean falls with the root of its samples.
            let most = 0.12 / f64::from(many(method)).sqrt();
            assert!((mean - 1.0).abs() < 0.005 && rmse < most, "{what}, at most {most:.4}");
        }
    }
}

#[test]
fn an_even_surrounding_is_reflected_evenly() {
    let mut stage = stage_or_skip!();
    for power in [1.0, 100.0, 1e5] {
        let scene = Scene::new(&stage, [WHITE, WHITE], power);
        for method in methods() {
            for (samples, lobe, pattern, blur) in
                [(1, "phong", "shared", "0"), (3, "blinn", "pixel", "1"), (8, "phong", "pixel", "0")]
            {
                let settings = settings(
                    method,
                    samples,
                    &[
                        ("gloss.lobe", lobe),
                        ("gloss.pattern", pattern),
                        ("gloss.blur", blur),
                        ("reflection.bounces", "2"),
                    ],
                );
                let stats = scene.render_in(&mut stage, &settings, STRIP).unwrap();
                assert_eq!(stats.glossy_samples, [samples, samples]);
                let shown = colors(&stage);
                let mirrors = mirror_pixels(&stage);
                assert!(mirrors.len() > 300);
                let what = format!("{}, power {power}, {samples} samples {lobe} {pattern}", method.row().name);
                if method == Method::Sscr {
                    // SSCR may find the mirror's own points, which are grey.
                    let mean = mirrors.iter().map(|pixel| f64::from(shown[*pixel][0])).sum::<f64>();
                    let mean = mean / mirrors.len() as f64;
                    assert!((mean - 1.0).abs() < 0.02, "{what}: {mean}");
                    continue;
                }
                for pixel in mirrors {
                    assert!(shown[pixel].iter().all(|part| (part - 1.0).abs() < 1e-3), "{what}: {:?}", shown[pixel]);
                }
            }
        }
    }
}

#[test]
fn half_of_the_rays_see_the_bright_half() {
    let mut stage = stage_or_skip!();
    let [width, height] = STRIP.map(|edge| edge as usize);
    for power in [10.0, 100.0] {
        let scene = Scene::new(&stage, [WHITE, BLACK], power);
        for method in methods() {
            for (lobe, pattern) in [("phong", "shared"), ("blinn", "pixel")] {
                let settings = settings(method, many(method), &[("gloss.lobe", lobe), ("gloss.pattern", pattern)]);
                scene.render_in(&mut stage, &settings, STRIP).unwrap();
                let shown = colors(&stage);
                // The columns beside the plane between the halves, in the middle of the sphere.
                let column = |x: usize| {
                    let rows = height / 2 - 4..height / 2 + 4;
                    rows.map(|y| f64::from(shown[y * width + x][0])).sum::<f64>() / 8.0
                };
                let (left, right) = (column(width / 2 - 1), column(width / 2));
                let what = format!("{}, power {power}, {lobe} {pattern}: {left} {right}", method.row().name);
                assert!(((left + right) / 2.0 - 0.5).abs() < 0.06, "{what}");
                // A perfect mirror shows white beside black.
                assert!(left > right && left - right < 0.5, "{what}");
            }
        }
    }
}

#[test]
fn a_very_high_power_is_a_perfect_mirror() {
    let mut stage = stage_or_skip!();
    for lobe in ["phong", "blinn"] {
        let changed = |stage: &mut Stage, power| {
            let scene = Scene::new(stage, [WHITE, BLACK], power);
            let by =
                |samples| settings(Method::SurfelTrace, samples, &[("gloss.lobe", lobe), ("gloss.pattern", "pixel")]);
            scene.render(stage, &by(0));
            let perfect = colors(stage);
            scene.render(stage, &by(4));
            let (glossy, mirrors) = (colors(stage), mirror_pixels(stage));
            let differs = |pixel: &&usize| (glossy[**pixel][0] - perfect[**pixel][0]).abs() > 0.02;
            mirrors.iter().filter(differs).count() as f64 / mirrors.len() as f64
        };
        // Half of a pixel beside the edge between the halves may change.
        let (high, low) = (changed(&mut stage, 1e6), changed(&mut stage, 30.0));
        assert!(high < 0.02 && low > 0.1, "{lobe}: {high} and {low} of the pixels change");
    }
}

#[test]
fn pictures_without_gloss_are_those_of_perfect_mirrors() {
    let mut stage = stage_or_skip!();
    let names = |stats: &FrameStats| stats.passes.iter().map(|pass| pass.name).collect::<Vec<_>>();
    for method in METHODS.iter().map(|row| row.method) {
        // No power, or no samples.
        let perfect = Scene::new(&stage, [WHITE, BLACK], 0.0);
        let glossy = Scene::new(&stage, [WHITE, BLACK], 50.0);
        let mut drawn = Vec::new();
        for (scene, samples) in [(&perfect, 0), (&perfect, 64), (&glossy, 0)] {
            stage.renderer.forget();
            let stats = scene.render_strip(&mut stage, &settings(method, samples, &[]));
            assert_eq!(stats.glossy_samples, [0, 0]);
            drawn.push((stage.renderer.read_picture().unwrap(), names(&stats), stats.reflection));
        }
        assert!(drawn[0] == drawn[1] && drawn[0] == drawn[2], "{}", method.row().name);
    }
}

#[test]
fn samples_may_be_summed_over_frames_and_begin_anew_after_a_change() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, [WHITE, BLACK], 50.0);
    scene.lights = vec![lamp(50.0, 60.0)];
    for method in methods() {
        let few_lights = [("light.by", "lights"), ("gi.vpls", "16"), ("gi.shadow_points", "256")];
        let settings = settings(method, 7, &few_lights);
        stage.renderer.forget();
        stage.effort.most_samples = None;
        scene.render_strip(&mut stage, &settings);
        let whole = stage.renderer.read_picture().unwrap();
        // Nothing is left to sum.
        assert_eq!(scene.render_strip(&mut stage, &settings).glossy_samples, [7, 7]);
        assert!(stage.renderer.read_picture().unwrap() == whole, "{}: drawn again", method.row().name);
        stage.renderer.forget();
        stage.effort.most_samples = Some(3);
        let mut sums = Vec::new();
        for _ in 0..3 {
            sums.push(scene.render_strip(&mut stage, &settings).glossy_samples[0]);
        }
        let in_steps = stage.renderer.read_picture().unwrap();
        assert_eq!(sums, [3, 6, 7]);
        assert!(in_steps == whole, "{}: other pixels by steps", method.row().name);
        // Another light begins anew, and so does another camera.
        let mut brighter = settings.clone();
        brighter.light.diffuse = 1.5;
        assert_eq!(scene.render_strip(&mut stage, &brighter).glossy_samples, [3, 7]);
        scene.camera.eye.x += 0.01;
        assert_eq!(scene.render_strip(&mut stage, &brighter).glossy_samples, [3, 7]);
        scene.camera.eye.x -= 0.01;
        // The curve of the screen changes no light.
        scene.render_strip(&mut stage, &settings);
        let mut darker = settings.clone();
        darker.tone.exposure = -1.0;
        assert_eq!(scene.render_strip(&mut stage, &darker).glossy_samples, [6, 7]);
        stage.effort.most_samples = None;
    }
}

#[test]
fn a_method_of_perfect_mirrors_refuses_by_name() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, [WHITE, BLACK], 50.0);
    let error = scene.try_render(&mut stage, &settings(Method::MirroredViewpoint, 2, &[])).unwrap_err();
    assert!(matches!(error, Error::PerfectMirrorsOnly { method: "mirrored_viewpoint" }), "{error}");
    // Views of its work are of perfect mirrors.
    scene.render(&mut stage, &settings(Method::MirroredViewpoint, 2, &[("reflection.show", "coverage")]));
}

#[test]
fn samples_that_share_the_virtual_lights_are_as_bright_as_those_lit_by_all() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, [WHITE, WHITE], 50.0);
    // Only one wall is lit by the lamp; all others by that wall.
    scene.lights = vec![lamp(20.0, 25.0)];
    let mut mean = |interleave: &str, samples| {
        let light = [("light.by", "lights"), ("gi.shadow_points", "1024"), ("gi.interleave", interleave)];
        let settings = settings(Method::SurfelTrace, samples, &light);
        stage.renderer.forget();
        let stats = scene.render(&mut stage, &settings);
        let (shown, mirrors) = (colors(&stage), mirror_pixels(&stage));
        let spent = stats.passes.iter().find(|pass| pass.name == "mirror_light").map_or(0.0, |pass| pass.milliseconds);
        (mirrors.iter().map(|pixel| f64::from(shown[*pixel][0])).sum::<f64>() / mirrors.len() as f64, spent)
    };
    // With 256 lights and tiles of 8 pixels there are no runs to share, and with 17 samples none fit.
    let (all, _) = mean("8", 64);
    for (interleave, samples) in [("4", 64), ("1", 64), ("4", 17)] {
        let (found, spent) = mean(interleave, samples);
        println!("{interleave} {samples}: {found} instead of {all}, {spent:.0} ms");
        assert!((found / all - 1.0).abs() < 0.03, "{interleave} {samples}: {found} instead of {all}");
    }
}

#[test]
fn a_perfect_mirror_shows_all_samples_of_a_glossy_one() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, [WHITE, BLACK], 0.0);
    // A glossy ball above the camera, between the bright and the dark half.
    scene.mirrors.push(Mirror {
        position: DVec3::new(0.0, -0.9, 1.2),
        size: 0.5,
        specular_power: 20.0,
        ..scene.mirrors[0].clone()
    });
    let mut values = |samples, bounces: &str| {
        let settings = settings(
            Method::SurfelTrace,
            samples,
            &[("reflection.bounces", bounces), ("gloss.pattern", "pixel"), ("mirror.surface", "exact")],
        );
        stage.renderer.forget();
        assert_eq!(scene.render(&mut stage, &settings).glossy_samples, [samples, samples]);
        let shown = colors(&stage);
        mirror_pixels(&stage).into_iter().map(|pixel| shown[pixel][0]).collect::<Vec<f32>>()
    };
    // Grey is what only a mean of several samples shows.
    let greys = |values: Vec<f32>| values.iter().filter(|value| (0.2..0.8).contains(*value)).count();
    let (one, many) = (greys(values(1, "2")), greys(values(16, "2")));
    assert!(many > one + 3, "{one} and {many} grey pixels");
    // Without a second reflection all samples of the perfect ball are one.
    assert!(values(16, "1") == values(1, "1"));
}

#[test]
fn rays_from_places_within_a_pixel_change_no_even_surrounding_and_no_figure() {
    let mut stage = stage_or_skip!();
    let scene = Scene::new(&stage, [WHITE, WHITE], 0.0);
    for surface in ["exact", "points"] {
        for method in methods() {
            let mut drawn = Vec::new();
            for samples in ["1", "4", "5"] {
                stage.renderer.forget();
                // Formulas stand for one ray through each pixel's centre; with several, squares find all of them.
                let values = [
                    ("reflection.samples", samples),
                    ("mirror.surface", surface),
                    ("sample_cameras.analytic", "false"),
                ];
                let settings = settings(method, 0, &values);
                let stats = scene.render_strip(&mut stage, &settings);
                let count: u32 = samples.parse().unwrap();
                assert_eq!(stats.glossy_samples, if count > 1 { [count; 2] } else { [0; 2] });
                let seen = stage.renderer.read_aov(Aov::MirrorPosition).unwrap().data;
                let what = format!("{}, {surface}, {samples} samples", method.row().name);
                if surface == "exact" && method != Method::Sscr {
                    // A mirror of points may show its own, which are grey.
                    let shown = colors(&stage);
                    for pixel in mirror_pixels(&stage) {
                        assert!(
                            shown[pixel].iter().all(|part| (part - 1.0).abs() < 1e-3),
                            "{what}: {:?}",
                            shown[pixel]
                        );
                    }
                }
                // The rays of all samples may need maps.
                let told = stats.reflection.map(|told| ReflectionStats { map_use: None, ..told });
                drawn.push((seen.into_iter().map(f32::to_bits).collect::<Vec<_>>(), told));
            }
            // What else is reported of the reflection is that of the rays through the centres of pixels.
            assert!(drawn[0] == drawn[1] && drawn[0] == drawn[2], "{}, {surface}", method.row().name);
        }
    }
}

#[test]
fn a_pixel_shows_the_share_of_its_area_that_an_edge_leaves_bright() {
    let mut stage = stage_or_skip!();
    // A flat mirror in the middle of the room shows the wall behind the eye, whose left half is bright.
    let mut scene = Scene::new(&stage, [WHITE, BLACK], 0.0);
    let plane = Mirror::standing(Shape::Plane { height: 0.7 }, DVec3::ZERO, DVec3::Z, DVec3::Y, 0.7);
    let rotation = DQuat::from_rotation_arc(DVec3::Z, DVec3::Y);
    scene.mirrors = vec![Mirror { position: DVec3::ZERO, rotation, specular_intensity: 1.0, ..plane }];
    let [width, height] = SIZE.map(|edge| edge as usize);
    let focal = height as f64 / 2.0 / 30.0_f64.to_radians().tan();
    for (samples, tolerance) in [(1, 0.5), (5, 0.12), (16, 0.05)] {
        for pixels in [0.05, 0.3, 0.45, 0.6, 0.8, 0.95] {
            // From here the wall's image is 3.7 away, and the edge in it so many pixels left of the picture's middle.
            let aside = pixels * 3.7 / focal;
            scene.camera = Camera::looking(DVec3::X * aside, -DVec3::Y, 1.7, DVec3::Z);
            let samples = samples.to_string();
            let settings =
                settings(Method::SurfelTrace, 0, &[("reflection.samples", &samples), ("mirror.surface", "exact")]);
            stage.renderer.forget();
            scene.render(&mut stage, &settings);
            let shown = colors(&stage);
            let found = shown[height / 2 * width + width / 2 - 1][0];
            let expected = 1.0 - pixels;
            let what = format!("{samples} rays, {pixels} of a pixel: {found} instead of {expected}");
            println!("{what}");
            assert!((f64::from(found) - expected).abs() <= tolerance, "{what}");
            assert!([2, 0].map(|beside| shown[height / 2 * width + width / 2 - beside][0]) == [1.0, 0.0], "{what}");
        }
    }
}

#[test]
fn a_blur_is_as_wide_as_the_lobe_where_rays_end_and_keeps_sums() {
    let mut stage = stage_or_skip!();
    const SIZE: [u32; 2] = [160, 120];
    const WIDE: usize = SIZE[0] as usize;
    let focal = 60.0 / 30.0_f64.to_radians().tan();
    // A flat mirror shows the wall behind the eye, whose left half is bright: from the mirror the wall is so far, and
    // the eye.
    for (power, far, eye, lobe, blur) in [
        (100.0, 2.0, 1.7, "phong", 1.0),
        (100.0, 1.5, 0.9, "phong", 1.0),
        (30.0, 2.0, 1.0, "phong", 0.5),
        (300.0, 2.0, 1.7, "blinn", 1.0),
    ] {
        let mut scene = Scene::new(&stage, [WHITE, BLACK], 0.0);
        let plane = Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::ZERO, DVec3::Z, DVec3::Y, 1.0);
        let rotation = DQuat::from_rotation_arc(DVec3::Z, DVec3::Y);
        let position = -DVec3::Y * (2.0 - far);
        scene.mirrors =
            vec![Mirror { position, rotation, specular_intensity: 1.0, specular_power: power as f32, ..plane }];
        scene.camera = Camera::looking(position, -DVec3::Y, eye, DVec3::Z);
        let mut drawn = |blur: f64| {
            let blur = blur.to_string();
            let settings = settings(
                Method::SurfelTrace,
                1,
                &[("mirror.surface", "exact"), ("gloss.lobe", lobe), ("gloss.blur", &blur), ("gloss.blur_most", "65")],
            );
            let objects = Objects { mirrors: &scene.mirrors, lights: &scene.lights, ..Objects::default() };
            stage.renderer.render(&scene.store, &Frame::new(&scene.camera, &settings, objects, SIZE)).unwrap();
            let shown = colors(&stage);
            let columns = WIDE / 2 - 30..WIDE / 2 + 30;
            (55..65).map(|y| columns.clone().map(|x| f64::from(shown[y * WIDE + x][0])).collect()).collect()
        };
        let (sharp, blurred): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (drawn(0.0), drawn(blur));
        let sum = |rows: &[Vec<f64>]| rows.iter().flatten().sum::<f64>();
        // An edge that is blurred over w pixels has a sum of v (1 - v) of w / 6.
        let spread: f64 = blurred.iter().flatten().map(|value| value * (1.0 - value)).sum();
        let found = 6.0 * spread / 10.0;
        let median = 2.0_f64.powf(-1.0 / (power + 1.0)).acos() * if lobe == "blinn" { 2.0 } else { 1.0 };
        let expected = blur * 2.0 * focal * median.tan() * far / (far + eye);
        let what = format!("power {power}, {far}, {eye}, {lobe}: {found} pixels instead of {expected}");
        println!("{what}; sums {} and {}", sum(&sharp), sum(&blurred));
        assert!((found - expected).abs() < 0.8, "{what}");
        assert!((sum(&blurred) / sum(&sharp) - 1.0).abs() < 5e-3, "{what}: {} {}", sum(&sharp), sum(&blurred));
    }
}

#[test]
fn a_blur_leaves_perfect_mirrors_as_they_are_to_the_bit() {
    let mut stage = stage_or_skip!();
    let mut scene = Scene::new(&stage, [WHITE, BLACK], 0.0);
    let ball = |x: f64, power| Mirror {
        position: DVec3::new(x, -0.2, 0.0),
        size: 0.4,
        specular_power: power,
        ..scene.mirrors[0].clone()
    };
    scene.mirrors = vec![ball(-0.5, 0.0), ball(0.5, 100.0)];
    let mut drawn = |blur: &str| {
        let settings = settings(Method::SurfelTrace, 2, &[("mirror.surface", "exact"), ("gloss.blur", blur)]);
        scene.render(&mut stage, &settings);
        (colors(&stage), mirror_pixels(&stage))
    };
    let ((sharp, mirrors), (blurred, _)) = (drawn("0"), drawn("1"));
    let width = SIZE[0] as usize;
    let changed = |is_left: bool| {
        let on_side = mirrors.iter().filter(|pixel| (**pixel % width < width / 2) == is_left);
        let (all, changed): (Vec<usize>, Vec<bool>) =
            on_side.map(|pixel| (*pixel, sharp[*pixel] != blurred[*pixel])).unzip();
        (all.len(), changed.into_iter().filter(|changed| *changed).count())
    };
    let mut counts = [changed(true), changed(false)];
    // The camera looks from either side.
    counts.sort_by_key(|(_, changed)| *changed);
    assert!(counts.iter().all(|(all, _)| *all > 100), "{counts:?}");
    assert!(counts[0].1 == 0 && counts[1].1 > 30, "{counts:?}");
}

/// The picture as bytes, and all images that are read from it.
fn images(stage: &Stage) -> Vec<Vec<u8>> {
    let bits = |aov| -> Vec<u8> {
        stage.renderer.read_aov(aov).unwrap().data.iter().flat_map(|value| value.to_bits().to_le_bytes()).collect()
    };
    vec![stage.renderer.read_picture().unwrap(), bits(Aov::Color), bits(Aov::MirrorPosition)]
}

#[test]
fn new_colors_lights_and_powers_trace_only_rays_that_change_and_show_the_same_as_tracing_all() {
    let mut stage = stage_or_skip!();
    for method in methods() {
        let mut scene = Scene::new(&stage, [WHITE, BLACK], 50.0);
        // Another glossy ball, which the first one shows, and whose power stays.
        scene.mirrors.push(Mirror {
            position: DVec3::new(0.5, -0.9, 0.9),
            size: 0.4,
            specular_power: 20.0,
            ..scene.mirrors[0].clone()
        });
        scene.lights = vec![lamp(50.0, 60.0)];
        let chosen = [
            ("light.by", "lights"),
            ("gi.vpls", "16"),
            ("gi.shadow_points", "256"),
            ("gloss.pattern", "pixel"),
            ("reflection.bounces", "2"),
            ("mirror.surface", "exact"),
            ("reflection.samples", "2"),
            ("screen_trace.rest", "environment_map"),
        ];
        let mut settings = settings(method, 5, &chosen);
        stage.renderer.forget();
        let built = scene.render_strip(&mut stage, &settings);
        let looks_up = matches!(method, Method::EnvironmentMap | Method::LightField);
        let keeps = !looks_up && !matches!(method, Method::Sscr | Method::SampleCameras);
        let name = method.row().name;
        assert_eq!(built.glossy_hits, if keeps { GlossCache::Kept } else { GlossCache::NoHits }, "{name}");
        if !keeps {
            assert_eq!(built.glossy_rays, [0, 0]);
            continue;
        }
        let all = built.glossy_rays[0];
        let seen = mirror_pixels(&stage).len() as u64;
        assert!(built.glossy_rays[1] == 0 && all > 6 * seen, "{name}: {:?} rays for {seen} pixels", built.glossy_rays);
        // Each change in turn; the picture must be that of a renderer that has drawn nothing before.
        for change in ["light", "color", "exposure", "tint", "power"] {
            match change {
                "light" => scene.lights[0].intensity = [4.0, 6.0, 8.0],
                "color" => {
                    let (plan, _) = ColorPlan::new(&Cloud::default(), &Settings::default().color, DVec3::Z);
                    let plan = ColorPlan { source: ColorSource::Plain, plain: [200, 40, 90, 255], ..plan };
                    scene.store.set_color(scene.room, &Cloud::default(), &[], &plan, DVec3::Z).unwrap();
                }
                "exposure" => settings.light.diffuse = 1.5,
                "tint" => scene.mirrors[1].color = [0.9, 0.5, 0.2],
                _ => scene.mirrors[1].specular_power = 60.0,
            }
            // A picture of less quality in between, as while a slider moves.
            let mut hurried = settings.clone();
            hurried.splat.quality = scene::Quality::Nearest;
            stage.effort.most_samples = Some(1);
            scene.render_strip(&mut stage, &hurried);
            // The picture at rest, in steps.
            stage.effort.most_samples = Some(2);
            let (mut traced, mut known) = (0, 0);
            let told = loop {
                let stats = scene.render_strip(&mut stage, &settings);
                (traced, known) = (traced + stats.glossy_rays[0], known + stats.glossy_rays[1]);
                if stats.glossy_samples == [5, 5] {
                    break stats.reflection;
                }
            };
            stage.effort.most_samples = None;
            let shown = images(&stage);
            stage.renderer.forget();
            let fresh = scene.render_strip(&mut stage, &settings);
            assert!(images(&stage) == shown, "{name}, {change}: another picture than from scratch");
            assert_eq!(fresh.reflection, told, "{name}, {change}");
            assert_eq!((traced + known, fresh.glossy_rays[1]), (fresh.glossy_rays[0], 0), "{name}, {change}");
            if change == "power" {
                // The rays of the first ball stay, and those of perfect mirrors.
                assert!(traced > 0 && traced < all / 2, "{name}: {traced} of {all} rays traced");
            } else {
                assert_eq!((traced, known), (0, all), "{name}, {change}");
            }
        }
        // What mirrors reflect decides which second reflections are followed, and by a tint their colours do.
        settings.reflection.least_weight = 0.5;
        scene.mirrors[1].specular_intensity = 0.8;
        scene.render_strip(&mut stage, &settings);
        for change in ["intensity", "law", "tint"] {
            match change {
                "intensity" => scene.mirrors[1].specular_intensity = 0.3,
                "law" => settings.mirror.tint = 1.0,
                _ => scene.mirrors[1].color = [0.9, 0.95, 0.9],
            }
            scene.render_strip(&mut stage, &settings);
            let shown = images(&stage);
            stage.renderer.forget();
            scene.render_strip(&mut stage, &settings);
            assert!(images(&stage) == shown, "{name}, {change}: another picture than from scratch");
        }
        // Another camera, and another mirror, trace all.
        scene.camera.eye.x += 0.01;
        assert_eq!(scene.render_strip(&mut stage, &settings).glossy_rays[1], 0, "{name}");
        scene.mirrors[0].size += 0.01;
        assert_eq!(scene.render_strip(&mut stage, &settings).glossy_rays[1], 0, "{name}");
        settings.gloss.cache = false;
        let stats = scene.render_strip(&mut stage, &settings);
        assert_eq!((stats.glossy_hits, stats.glossy_rays), (GlossCache::Off, [0, 0]));
        let without = images(&stage);
        settings.gloss.cache = true;
        stage.renderer.forget();
        scene.render_strip(&mut stage, &settings);
        assert!(images(&stage) == without, "{name}: another picture with the cache");
    }
}

#[test]
fn a_cache_of_one_power_shows_others_without_a_ray() {
    let mut stage = stage_or_skip!();
    for (lobe, pattern, method) in
        [("phong", "pixel", Method::SurfelTrace), ("blinn", "shared", Method::SscrHierarchical)]
    {
        let mut scene = Scene::new(&stage, [WHITE, BLACK], 1000.0);
        let chosen = [("gloss.lobe", lobe), ("gloss.pattern", pattern), ("gloss.cache_power", "1000")];
        let cached = settings(method, 16, &chosen);
        stage.renderer.forget();
        let all = scene.render_strip(&mut stage, &cached).glossy_rays[0];
        for power in [3000.0, 300.0, 100.0, 1000.0] {
            (scene.mirrors[0].specular_power, scene.mirrors[0].color) = (power, [power / 3000.0, 0.5, 0.9]);
            let stats = scene.render_strip(&mut stage, &cached);
            assert_eq!(stats.glossy_rays, [0, all], "{lobe}, power {power}");
            let shown = images(&stage);
            stage.renderer.forget();
            scene.render_strip(&mut stage, &cached);
            assert!(images(&stage) == shown, "{lobe}, power {power}: another picture than from scratch");
        }
        // Rays of so wide a lobe cannot be told from those of a narrow one: pixels trace their own, as without a cache.
        scene.mirrors[0].specular_power = 3.0;
        let stats = scene.render_strip(&mut stage, &cached);
        assert!(stats.glossy_rays[0] > all / 2, "{lobe}: {:?} of {all}", stats.glossy_rays);
        let trusts_none = [
            ("gloss.lobe", lobe),
            ("gloss.pattern", pattern),
            ("gloss.cache_power", "1000"),
            ("gloss.cache_trust", "1"),
        ];
        scene.render_strip(&mut stage, &settings(method, 16, &trusts_none));
        let shown = images(&stage);
        scene.render_strip(&mut stage, &settings(method, 16, &trusts_none[..2]));
        assert!(images(&stage) == shown, "{lobe}: another picture than by the own lobe");
        // An even surrounding stays even.
        let white = Scene::new(&stage, [WHITE, WHITE], 200.0);
        white.render_strip(&mut stage, &cached);
        let shown = colors(&stage);
        for pixel in mirror_pixels(&stage) {
            assert!(shown[pixel].iter().all(|part| (part - 1.0).abs() < 1e-3), "{lobe}: {:?}", shown[pixel]);
        }
    }
}
