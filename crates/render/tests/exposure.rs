//! The exposure that is fitted to a picture, against closed forms.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;
mod walls;

use std::f64::consts::FRAC_1_PI;

use cloud::Chunk;
use glam::{DVec3, Vec3};
use render::{Adaptation, Aov, Frame, FrameStats, Material, Objects, PointStore};
use scene::{Camera, LightClues, Settings};

use stage::Stage;
use walls::{ALBEDO, settings, store_of, wall};

const SIZE: [u32; 2] = [64, 48];
/// What half of the lit pixels get at most, in stops of white.
const MIDDLE: f64 = -2.0;
/// The width of a bin of the histogram in stops.
const BIN: f64 = 24.0 / 256.0;

fn floor() -> Chunk {
    wall(DVec3::new(-0.5, -0.5, 0.0), [DVec3::X, DVec3::Y])
}

fn camera() -> Camera {
    Camera::looking(DVec3::ZERO, DVec3::Z, 2.0, DVec3::Y)
}

/// A sun in the zenith without a sky, which glint has guessed.
fn by_sun(more: &[(&str, &str)]) -> Settings {
    settings(&[&[("sun.elevation", "90"), ("sun.sky", "0"), ("gi.bounces", "0"), ("light.fill", "0")], more].concat())
}

fn under_open_sky() -> Objects<'static> {
    Objects { clues: LightClues { sky_is_open: true, ..LightClues::default() }, ..Objects::default() }
}

fn render(stage: &mut Stage, store: &PointStore, settings: &Settings) -> (FrameStats, Vec<u8>) {
    // North is -z where y points up, so the sun of the zenith shines along the camera's up.
    let camera = Camera { up: DVec3::Y, ..camera() };
    let frame = Frame::new(&camera, settings, under_open_sky(), SIZE);
    let stats = stage.renderer.render(store, &Frame { effort: stage.effort, ..frame }).unwrap();
    (stats, stage.renderer.read_picture().unwrap())
}

fn direct(stage: &Stage) -> Vec<DVec3> {
    let image = stage.renderer.read_aov(Aov::Direct).unwrap();
    image.data.as_chunks::<3>().0.iter().map(|rgb| Vec3::from(*rgb).as_dvec3()).collect()
}

/// A sun that shines along the line of sight onto the floor.
const ALONG: [(&str, &str); 2] = [("sun.elevation", "0"), ("sun.azimuth", "180")];

#[test]
fn an_even_surface_becomes_middle_grey_however_bright_its_light_is() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![floor()], Material::default());
    for irradiance in [0.02, 0.7, 2.5, 60.0] {
        let (stats, _) =
            render(&mut stage, &store, &by_sun(&[&ALONG[..], &[("sun.irradiance", &irradiance.to_string())]].concat()));
        let expected = MIDDLE - (irradiance * ALBEDO * FRAC_1_PI).log2();
        let exposure = stats.exposure.unwrap();
        assert!(
            !exposure.adapts && (f64::from(exposure.stops) - expected).abs() <= BIN,
            "{exposure:?}, expected {expected}"
        );
    }
}

#[test]
fn a_locked_exposure_of_the_same_stops_is_the_same_picture() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![floor()], Material::default());
    for own in ["0", "0.75"] {
        let by = [&ALONG[..], &[("sun.irradiance", "0.3"), ("tone.exposure", own)]].concat();
        let (stats, fitted) = render(&mut stage, &store, &by_sun(&by));
        let stops = stats.exposure.unwrap().stops.to_string();
        let locked = [&by[..], &[("tone.fit", "locked"), ("tone.exposure", &stops)]].concat();
        let (stats, picture) = render(&mut stage, &store, &by_sun(&locked));
        assert!(stats.exposure.is_none() && picture == fitted, "{stops}");
        let dark = [&by[..], &[("tone.fit", "locked")]].concat();
        assert!(render(&mut stage, &store, &by_sun(&dark)).1 != fitted);
        // What the ray tracer would have seen is mapped alike.
        let (_, fitted) = render(&mut stage, &store, &by_sun(&by));
        let image = stage.renderer.read_aov(Aov::Color).unwrap();
        for fits in [false, true] {
            let exposure = stage.renderer.present(&by_sun(&by), image.data.as_chunks::<3>().0, fits).unwrap();
            assert!(exposure.unwrap().stops.to_string() == stops && stage.renderer.read_picture().unwrap() == fitted);
        }
    }
}

#[test]
fn other_colours_of_a_frame_have_its_exposure_or_the_one_that_fits_them() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![floor()], Material::default());
    let by = by_sun(&[&ALONG[..], &[("sun.irradiance", "0.3")]].concat());
    let (stats, picture) = render(&mut stage, &store, &by);
    let stops = stats.exposure.unwrap().stops;
    // Four times as bright, which is two stops.
    let image = stage.renderer.read_aov(Aov::Color).unwrap().data;
    let brighter: Vec<[f32; 3]> = image.as_chunks::<3>().0.iter().map(|color| color.map(|value| value * 4.0)).collect();
    for (fits, expected) in [(true, stops - 2.0), (false, stops), (true, stops - 2.0)] {
        let exposure = stage.renderer.present(&by, &brighter, fits).unwrap().unwrap();
        assert!(!exposure.adapts && (f64::from(exposure.stops - expected)).abs() <= BIN, "{exposure:?}, {expected}");
        let brightness = |picture: &[u8]| picture.iter().map(|value| u64::from(*value)).sum::<u64>() as f64;
        let share = brightness(&stage.renderer.read_picture().unwrap()) / brightness(&picture);
        assert!(if fits { (share - 1.0).abs() < 0.02 } else { share > 1.05 }, "{fits}: {share}");
    }
    let locked = by_sun(&[&ALONG[..], &[("tone.fit", "locked")]].concat());
    render(&mut stage, &store, &locked);
    assert!(stage.renderer.present(&locked, &brighter, true).unwrap().is_none());
}

#[test]
fn only_guessed_light_is_fitted_unless_all_is_asked_for_and_data_colours_never() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![floor()], Material::default());
    for (pairs, is_fitted) in [
        (&[][..], true),
        (&[("light.by", "sun")], false),
        (&[("light.by", "surroundings")], true),
        (&[("light.by", "sun"), ("tone.fit", "always")], true),
        (&[("light.by", "headlight"), ("tone.fit", "always")], true),
        (&[("light.by", "colors"), ("tone.fit", "always")], false),
        (&[("tone.fit", "locked")], false),
    ] {
        let (stats, _) = render(&mut stage, &store, &settings(pairs));
        assert_eq!(stats.exposure.is_some(), is_fitted, "{pairs:?}");
    }
}

#[test]
fn adaptation_goes_a_share_of_the_way_and_ends_at_the_exposure_that_fits() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![floor()], Material::default());
    let by = |irradiance| by_sun(&[&ALONG[..], &[("sun.irradiance", irradiance)]].concat());
    let (dark, still) = render(&mut stage, &store, &by("0.3"));
    let dark = dark.exposure.unwrap().stops;
    let follow = |before| Some(Adaptation { before, share: 0.5 });
    stage.effort.adaptation = follow(dark);
    let (bright, _) = render(&mut stage, &store, &by("2.4"));
    let bright = bright.exposure.unwrap();
    // Three stops brighter, of which half is made up for.
    assert!(bright.adapts && (bright.stops - dark + 1.5).abs() <= 2.0 * BIN as f32, "{bright:?} after {dark}");
    let mut before = bright.stops;
    for frame in 1.. {
        stage.effort.adaptation = follow(before);
        let (stats, picture) = render(&mut stage, &store, &by("0.3"));
        let exposure = stats.exposure.unwrap();
        before = exposure.stops;
        if !exposure.adapts {
            assert!(exposure.stops == dark && picture == still, "after {frame} frames");
            break;
        }
        assert!(frame < 20 && exposure.stops < dark, "{exposure:?}");
    }
}

#[test]
fn fill_lights_what_the_guessed_sun_does_not_reach() {
    let mut stage = stage_or_skip!();
    let store = store_of(&stage, vec![floor()], Material::default());
    // The sun stands behind the floor.
    let behind = [("sun.elevation", "0"), ("sun.azimuth", "0"), ("light.headlight", "0")];
    for (fill, by, expected) in [("0.25", "auto", 0.25), ("0", "auto", 0.0), ("0.25", "sun", 0.0)] {
        let by = [&behind[..], &[("light.fill", fill), ("light.by", by)]].concat();
        render(&mut stage, &store, &by_sun(&by));
        let lit: Vec<DVec3> = direct(&stage).into_iter().filter(|color| !color.is_nan()).collect();
        assert!(lit.len() > 200);
        for color in lit {
            assert!(
                (color - DVec3::splat(expected * ALBEDO)).abs().max_element() < 1e-3,
                "{color}, expected {expected}"
            );
        }
    }
}
