//! Light that mirrors throw from lamps and the sun onto surfaces, against closed forms.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod hollow;
#[macro_use]
mod stage;
mod walls;

use std::f64::consts::{FRAC_1_PI, PI};

use cloud::Chunk;
use glam::{DVec3, Vec3};
use render::{Aov, Frame, Material, Objects, PointStore};
use scene::{Camera, Mirror, Quality, Settings, Shape, SpotLight};

use hollow::{cone, hollow_sphere};
use stage::Stage;
use walls::{ALBEDO, settings, store_of, wall};

const SIZE: [u32; 2] = [96, 96];
const REFLECTED: f64 = 0.8;

fn lamp() -> SpotLight {
    SpotLight {
        position: DVec3::new(0.5, 0.2, 2.0),
        target: DVec3::new(2.0, 0.0, 1.0),
        intensity: [10.0, 5.0, 1.0],
        inner_degrees: 20.0,
        outer_degrees: 50.0,
    }
}

/// The radiant intensity of `lamp` in a direction of unit length.
fn intensity(direction: DVec3) -> DVec3 {
    let axis = (lamp().target - lamp().position).normalize();
    let angle = axis.dot(direction).clamp(-1.0, 1.0).acos().to_degrees();
    DVec3::new(10.0, 5.0, 1.0) * ((50.0 - angle) / 30.0).clamp(0.0, 1.0)
}

/// A mirror about `position` that faces along `normal`; the x axis of its shape lies across `up`.
fn mirror(shape: Shape, position: DVec3, [normal, up]: [DVec3; 2], size: f64) -> Mirror {
    let standing = Mirror::standing(shape, position, normal, up, size);
    Mirror { position, specular_intensity: REFLECTED as f32, ..standing }
}

/// A mirror in the plane x = 2 that faces -x, from -1 to 1 in y and from half of one to one and a half in z.
fn pane() -> Mirror {
    mirror(Shape::Plane { height: 0.5 }, DVec3::new(2.0, 0.0, 1.0), [-DVec3::X, DVec3::Z], 1.0)
}

fn floor() -> Chunk {
    wall(DVec3::new(-2.0, -2.0, 0.0), [DVec3::X * 4.0, DVec3::Y * 4.0])
}

/// Direct light by photons alone, in the settings that `pairs` add to.
fn by_photons(photons: &str, pairs: &[(&str, &str)]) -> Settings {
    let usual =
        [("light.photons", photons), ("gi.bounces", "0"), ("sun.sky", "0"), ("reflection.method", "surfel_trace")];
    settings(&[&usual[..], pairs].concat())
}

fn draw(stage: &mut Stage, store: &PointStore, camera: &Camera, settings: &Settings, objects: Objects<'_>) {
    let frame = Frame::new(camera, settings, objects, SIZE);
    stage.renderer.render(store, &Frame { effort: stage.effort, ..frame }).unwrap();
}

fn read(stage: &Stage, aov: Aov) -> Vec<DVec3> {
    let image = stage.renderer.read_aov(aov).unwrap();
    image.data.as_chunks::<3>().0.iter().map(|rgb| Vec3::from(*rgb).as_dvec3()).collect()
}

/// The places that the camera sees and the irradiance there that photons add.
fn thrown(
    stage: &mut Stage,
    store: &PointStore,
    camera: &Camera,
    settings: &Settings,
    objects: Objects<'_>,
) -> Vec<(DVec3, DVec3)> {
    let mut without = settings.clone();
    without.light.photons = 0;
    let [with, without] = [settings, &without].map(|settings| {
        draw(stage, store, camera, settings, objects);
        read(stage, Aov::Direct)
    });
    let added = with.into_iter().zip(without).map(|(with, without)| (with - without) * PI / ALBEDO);
    read(stage, Aov::Position).into_iter().zip(added).filter(|(place, _)| place.is_finite()).collect()
}

/// Straight down on the floor of `floor`.
fn from_above() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::new(0.0, -0.1, 1.0), 3.6, DVec3::Z)
}

/// Compares with the light of the source behind the pane, which the pane's edges bound; `image` gives the irradiance at a
/// place of the floor without the pane, and the direction to the image.
fn assert_window(lit: &[(DVec3, DVec3)], image: impl Fn(DVec3) -> (DVec3, DVec3)) {
    let (mut inside, mut outside, mut squares) = (0, 0, 0.0);
    let (mut sum, mut expected_sum) = (DVec3::ZERO, DVec3::ZERO);
    // Photons spread their light over 0.06 to 0.1, and a floor ends beside its last half disc.
    let is_floor = |place: &DVec3| place.z.abs() < 1e-3 && place.truncate().abs().max_element() < 1.9;
    for (place, found) in lit.iter().filter(|(place, _)| is_floor(place)) {
        let (expected, toward) = image(*place);
        // How far within the pane the line to the image passes, as the floor sees it.
        let at = place + toward * ((2.0 - place.x) / toward.x);
        let within = (at.z - 0.5).min(1.5 - at.z).min(1.0 - at.y.abs());
        if within > 0.12 {
            squares += (found - expected).length_squared();
            (sum, expected_sum, inside) = (sum + found, expected_sum + expected, inside + 1);
        } else if within < -0.12 {
            assert_eq!(*found, DVec3::ZERO, "{place}");
            outside += 1;
        }
    }
    let (rmse, mean) = ((squares * f64::from(inside)).sqrt() / expected_sum.length(), sum / expected_sum);
    println!("{inside} places: relative RMSE {rmse}, mean {mean}; {outside} dark ones");
    assert!(inside > 300 && outside > 300, "{inside} {outside}");
    assert!(rmse < 0.015 && (mean - 1.0).abs().max_element() < 0.01, "{rmse} {mean}");
}

#[test]
fn a_plane_mirror_throws_the_light_of_the_lamp_behind_it_by_its_formula_and_as_points() {
    let mut stage = stage_or_skip!();
    let (camera, settings, lights, by_formula) = (from_above(), by_photons("65536", &[]), [lamp()], [pane()]);
    for mirrors in [&by_formula[..], &[]] {
        let mut store = store_of(&stage, vec![floor()], Material::default());
        if mirrors.is_empty() {
            let points = wall(DVec3::new(2.0, -1.0, 0.5), [DVec3::Z, DVec3::Y * 2.0]);
            let cloud = store.add_cloud(Material { specular_intensity: REFLECTED as f32, ..Material::default() });
            store.add_chunk(cloud, &points, None).unwrap();
        }
        let lit =
            thrown(&mut stage, &store, &camera, &settings, Objects { mirrors, lights: &lights, ..Objects::default() });
        assert_window(&lit, |place| {
            let behind = DVec3::new(3.5, 0.2, 2.0) - place;
            let direction = behind.normalize();
            let light = intensity(-direction * DVec3::new(-1.0, 1.0, 1.0));
            (light * direction.z / behind.length_squared() * REFLECTED, direction)
        });
    }
}

#[test]
fn a_plane_mirror_throws_the_light_of_the_sun_and_a_roof_keeps_it_off() {
    let mut stage = stage_or_skip!();
    // From the west, 45 degrees high.
    let sun = [("light.by", "sun"), ("sun.azimuth", "270"), ("sun.elevation", "45"), ("sun.irradiance", "3")];
    let (camera, settings, mirrors) = (from_above(), by_photons("65536", &sun), [pane()]);
    let direction = settings.sun.direction(DVec3::Z);
    let image = direction * DVec3::new(-1.0, 1.0, 1.0);
    let objects = Objects { mirrors: &mirrors, ..Objects::default() };
    let store = store_of(&stage, vec![floor()], Material::default());
    let lit = thrown(&mut stage, &store, &camera, &settings, objects);
    assert_window(&lit, |_| (DVec3::splat(3.0 * REFLECTED * direction.z), image));
    let roof = wall(DVec3::new(-2.0, -2.0, 3.0), [DVec3::X * 4.0, DVec3::Y * 4.0]);
    let west = wall(DVec3::new(-2.0, -2.0, 0.0), [DVec3::Y * 4.0, DVec3::Z * 3.0]);
    let store = store_of(&stage, vec![floor(), roof, west], Material::default());
    let low = Camera::looking(DVec3::ZERO, DVec3::new(0.0, -0.1, 1.0), 2.5, DVec3::Z);
    let dark = thrown(&mut stage, &store, &low, &settings, objects);
    assert!(dark.len() > 1000 && dark.iter().all(|(_, light)| *light == DVec3::ZERO));
}

#[test]
fn a_hollow_mirror_throws_the_beam_of_the_lamp_in_its_focus_where_it_belongs_and_loses_nothing() {
    let mut stage = stage_or_skip!();
    // A ray that leaves the focus at the distance r from the mirror goes straight down, with the irradiance I / r^2.
    let (focal_length, height): (f64, f64) = (0.5, 3.0);
    let dish = mirror(Shape::Paraboloid { focal_length }, DVec3::Z * height, [-DVec3::Z, DVec3::Y], 1.0);
    let lights = [SpotLight {
        position: DVec3::Z * (height - focal_length),
        target: DVec3::Z * height,
        intensity: [10.0; 3],
        inner_degrees: 80.0,
        outer_degrees: 80.0,
    }];
    let store = store_of(&stage, vec![floor()], Material::default());
    let (camera, settings) =
        (Camera::looking(DVec3::ZERO, DVec3::new(0.0, -0.1, 1.0), 2.4, DVec3::Z), by_photons("65536", &[]));
    let mirrors = [dish];
    let lit = thrown(
        &mut stage,
        &store,
        &camera,
        &settings,
        Objects { mirrors: &mirrors, lights: &lights, ..Objects::default() },
    );
    // The rim at the radius 1, and the edge of the lamp's cone.
    let (mut places, mut off, mut sum, mut expected_sum) = (0, 0.0_f64, 0.0, 0.0);
    for (place, light) in &lit {
        let radius = place.truncate().length();
        let distance = focal_length + radius * radius / (4.0 * focal_length);
        let expected = REFLECTED * 10.0 / (distance * distance);
        let rim = (2.0 * focal_length * (40_f64).to_radians().tan()).min(1.0);
        if radius < rim - 0.1 {
            places += 1;
            off += (light.x / expected - 1.0).powi(2);
            (sum, expected_sum) = (sum + light.x, expected_sum + expected);
        } else if radius > rim + 0.1 {
            assert_eq!(*light, DVec3::ZERO, "{place}");
        }
    }
    let (off, mean) = ((off / f64::from(places)).sqrt(), sum / expected_sum);
    println!("{places} places: relative RMSE {off}, mean {mean}");
    assert!(places > 1000 && off < 0.015 && (mean - 1.0).abs() < 0.01, "{places} {off} {mean}");
}

/// The mean irradiance of the wall of a hollow sphere of radius 2, by light that the camera sees in six directions from its
/// middle: each pixel counts by the solid angle in which it sees the wall.
fn over_sphere(stage: &mut Stage, store: &PointStore, settings: &Settings, objects: Objects<'_>) -> [f64; 2] {
    let mut settings = settings.clone();
    settings.view.field_of_view = 90.0;
    let (mut sums, mut angles) = ([0.0; 2], 0.0);
    for axis in [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z] {
        let up = axis.any_orthonormal_vector();
        let camera = Camera::looking(axis * 1.9, -axis, 1.9, up);
        draw(stage, store, &camera, &settings, objects);
        let [places, direct, indirect] = [Aov::Position, Aov::Direct, Aov::Indirect].map(|aov| read(stage, aov));
        for ((place, direct), indirect) in places.into_iter().zip(direct).zip(indirect) {
            if (place.length() - 2.0).abs() < 0.02 {
                let angle = place.normalize().dot(axis).powi(3);
                angles += angle;
                for (sum, light) in sums.iter_mut().zip([direct, indirect]) {
                    *sum += light.x * angle * PI / ALBEDO;
                }
            }
        }
    }
    sums.map(|sum| sum / angles)
}

#[test]
fn a_mirror_ball_throws_all_light_of_a_lamp_onto_the_closed_wall_about_it_and_the_wall_sends_it_on() {
    let mut stage = stage_or_skip!();
    let mut store = store_of(&stage, vec![hollow_sphere(2.0, 60_000)], Material::default());
    let ball = mirror(Shape::Sphere, DVec3::new(0.0, 0.0, -1.3), [DVec3::Z, DVec3::Y], 0.25);
    let ball = Mirror { specular_intensity: 1.0, ..ball };
    // Its points cast its shadow.
    let cloud = store.add_cloud(Material::of_mirror(&ball));
    for chunk in ball.sample(5000, 1) {
        store.add_chunk(cloud, &chunk, None).unwrap();
    }
    // The cone lies within the ball, so that nothing is lit but by it.
    let (lamp, flux) = cone(DVec3::new(0.0, 0.3, -0.3), ball.position, 10.0);
    let lights = [lamp];
    let irradiance = flux / (4.0 * PI * 4.0);
    let mirrors = [ball];
    let objects = Objects { mirrors: &mirrors, lights: &lights, ..Objects::default() };
    // Virtual lights lose what falls on the ball, and some of the rest.
    for (by, most) in [("lights", 0.06), ("rays", 0.03)] {
        let mut settings = by_photons("16384", &[("gi.by", by), ("gi.rays_per_pixel", "4")]);
        settings.gi.bounces = 1;
        let [direct, indirect] = over_sphere(&mut stage, &store, &settings, objects).map(|light| light / irradiance);
        println!("{by}: {direct} of the lamp's light is thrown, {} of that sent on", indirect / ALBEDO);
        // The ball hides a hundredth of the wall, which it throws no light on.
        assert!((direct - 1.0).abs() < 0.02, "{direct}");
        assert!((indirect / ALBEDO - 1.0).abs() < most, "{by}: {indirect} instead of {ALBEDO}");
        settings.light.photons = 0;
        let dark = over_sphere(&mut stage, &store, &settings, objects);
        assert!(dark.iter().all(|light| *light < 0.01 * irradiance), "the lamp shines past the ball: {dark:?}");
    }
}

#[test]
fn two_mirrors_in_a_row_throw_light_where_two_reflections_are_followed() {
    let mut stage = stage_or_skip!();
    // Light goes to +x, is turned by 90 degrees upward, then by 90 degrees back to -x, onto a wall in x = -2.
    let turn =
        |center, normal: DVec3| mirror(Shape::Plane { height: 1.0 }, center, [normal.normalize(), DVec3::Y], 0.6);
    let mirrors = [
        turn(DVec3::new(1.0, 0.0, 0.0), DVec3::new(-1.0, 0.0, 1.0)),
        turn(DVec3::new(1.0, 0.0, 1.5), DVec3::new(-1.0, 0.0, -1.0)),
    ];
    let lights = [SpotLight {
        position: DVec3::new(-1.5, 0.0, 0.0),
        target: mirrors[0].position,
        intensity: [10.0; 3],
        inner_degrees: 5.0,
        outer_degrees: 5.0,
    }];
    let screen = wall(DVec3::new(-2.0, -2.0, -1.0), [DVec3::Y * 4.0, DVec3::Z * 4.0]);
    let store = store_of(&stage, vec![screen], Material::default());
    let camera = Camera::looking(DVec3::new(-2.0, 0.0, 1.5), DVec3::X, 1.8, DVec3::Z);
    let objects = Objects { mirrors: &mirrors, lights: &lights, ..Objects::default() };
    let mut middle = |bounces: &str| {
        let settings = by_photons("16384", &[("reflection.bounces", bounces)]);
        let lit = thrown(&mut stage, &store, &camera, &settings, objects);
        let near: Vec<f64> = lit
            .iter()
            .filter(|(place, _)| place.distance(DVec3::new(-2.0, 0.0, 1.5)) < 0.2)
            .map(|(_, light)| light.x)
            .collect();
        assert!(near.len() > 100, "{}", near.len());
        near.iter().sum::<f64>() / near.len() as f64
    };
    // The way is 2.5 + 1.5 + 3 long.
    let (one, two) = (middle("1"), middle("2") / (10.0 * REFLECTED * REFLECTED / 49.0));
    println!("{two} of the light of two mirrors");
    assert!(one == 0.0 && (two - 1.0).abs() < 0.02, "{one} {two}");
}

#[test]
fn photons_are_the_same_to_the_bit_kept_while_all_stands_and_none_where_nothing_throws_them() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![floor()], Material::default());
    let (camera, lights, mirrors) = (from_above(), [lamp()], [pane()]);
    let objects = Objects { mirrors: &mirrors, lights: &lights, ..Objects::default() };
    let settings = by_photons("10000", &[]);
    let has_traced = |stage: &mut Stage, settings: &Settings, camera: &Camera, objects: Objects<'_>| {
        let frame = Frame::new(camera, settings, objects, SIZE);
        let stats = stage.renderer.render(&store, &frame).unwrap();
        stats.passes.iter().any(|pass| pass.name == "photons")
    };
    let bits = |stage: &Stage| {
        let image = stage.renderer.read_aov(Aov::Direct).unwrap().data;
        image.iter().map(|value| value.to_bits()).collect::<Vec<_>>()
    };
    stage.renderer.forget();
    assert!(has_traced(&mut stage, &settings, &camera, objects));
    let first = bits(&stage);
    assert!(!has_traced(&mut stage, &settings, &camera, objects), "a still frame traces them anew");
    let elsewhere = Camera::looking(DVec3::ZERO, DVec3::new(0.3, -1.0, 1.0), 3.0, DVec3::Z);
    assert!(!has_traced(&mut stage, &settings, &elsewhere, objects), "another view traces them anew");
    let mut brighter = settings.clone();
    brighter.light.diffuse = 2.0;
    assert!(!has_traced(&mut stage, &brighter, &camera, objects), "other matt surfaces trace them anew");
    let mut hurried = settings.clone();
    (hurried.splat.quality, hurried.sscr.solve_once) = (Quality::Nearest, true);
    assert!(!has_traced(&mut stage, &hurried, &camera, objects), "a hurried frame traces them anew");
    // Each of these changes what is thrown.
    let lower = [Mirror { position: DVec3::new(2.0, 0.0, 0.9), ..pane() }];
    let dimmer = [SpotLight { intensity: [1.0; 3], ..lamp() }];
    let mut fewer = settings.clone();
    fewer.light.photons = 5000;
    for (settings, objects) in [
        (&settings, Objects { mirrors: &lower, ..objects }),
        (&settings, Objects { lights: &dimmer, ..objects }),
        (&fewer, objects),
    ] {
        assert!(has_traced(&mut stage, settings, &camera, objects));
        assert!(bits(&stage) != first);
    }
    stage.renderer.forget();
    assert!(has_traced(&mut stage, &settings, &camera, objects));
    assert!(bits(&stage) == first, "the same scene has another picture");
    // Without mirrors, without their pictures, or without lamps there are none, and the picture is that of no photons.
    let mut without_pictures = settings.clone();
    without_pictures.reflection.bounces = 0;
    let mut at_the_eye = settings.clone();
    at_the_eye.set_text("light.by", "headlight").unwrap();
    for (settings, objects) in
        [(&settings, Objects { mirrors: &[], ..objects }), (&without_pictures, objects), (&at_the_eye, objects)]
    {
        assert!(!has_traced(&mut stage, settings, &camera, objects));
        let with = bits(&stage);
        let mut dark = settings.clone();
        dark.light.photons = 0;
        has_traced(&mut stage, &dark, &camera, objects);
        assert!(bits(&stage) == with);
    }
}

#[test]
fn what_mirrors_show_has_the_light_that_they_throw() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![floor()], Material::default());
    // The camera sees the floor in the pane, at the place that the pane lights.
    let (lights, mirrors) = ([lamp()], [pane()]);
    let objects = Objects { mirrors: &mirrors, lights: &lights, ..Objects::default() };
    let camera = Camera::looking(pane().position, DVec3::new(-1.0, 0.0, 0.5), 0.7, DVec3::Z);
    let colors = ["0", "65536"].map(|photons| {
        draw(&mut stage, &store, &camera, &by_photons(photons, &[]), objects);
        read(&stage, Aov::Color)
    });
    let seen = stage.renderer.read_aov(Aov::MirrorPosition).unwrap().data;
    let mut compared = 0;
    for ((place, without), with) in seen.as_chunks::<4>().0.iter().zip(&colors[0]).zip(&colors[1]) {
        let place = DVec3::new(place[0].into(), place[1].into(), place[2].into());
        let behind = DVec3::new(3.5, 0.2, 2.0) - place;
        let at = place + behind * ((2.0 - place.x) / behind.x);
        let within = (at.z - 0.5).min(1.5 - at.z).min(1.0 - at.y.abs());
        if place.is_finite() && within > 0.12 && place.truncate().abs().max_element() < 1.9 {
            let direction = behind.normalize();
            let light = intensity(-direction * DVec3::new(-1.0, 1.0, 1.0)) * direction.z / behind.length_squared();
            let expected = light * REFLECTED * REFLECTED * ALBEDO * FRAC_1_PI;
            let found = with - without;
            assert!((found / expected - 1.0).abs().max_element() < 0.3, "{place}: {found} instead of {expected}");
            compared += 1;
        }
    }
    assert!(compared > 100, "{compared}");
}
