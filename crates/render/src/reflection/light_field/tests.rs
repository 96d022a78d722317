use glam::{DVec3, Vec3};
use proptest::prelude::*;
use scene::{Camera, Lighting, Method, SampleRule, SampleVisibility};

use super::super::cubemap_trace::tests::{color_of, furnished, vectors};
use super::super::depth_walk::texel_of;
use super::twin::{self, Found};
use super::*;
use crate::frame::Objects;
use crate::renderer::{Frame, Renderer};

/// The colours of an image of halves.
fn halves(gpu: &Gpu, image: &crate::targets::Image) -> Vec<Vec3> {
    let half = |pixel: &[u8], part: usize| half::f16::from_le_bytes([pixel[2 * part], pixel[2 * part + 1]]).to_f32();
    let bytes = gpu.read_texture(&image.texture).unwrap();
    bytes.chunks_exact(8).map(|pixel| Vec3::from([0, 1, 2].map(|part| half(pixel, part)))).collect()
}

/// Linear red, green and blue of sRGB bytes.
fn linear([red, green, blue, _]: [u8; 4]) -> Vec3 {
    Vec3::from([red, green, blue].map(|byte| {
        let value = f32::from(byte) / 255.0;
        if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    }))
}

#[test]
fn the_gpu_looks_up_as_its_twin_does() {
    let Some(gpu) = Gpu::shared() else { return };
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let (room, open) = (furnished(&gpu, true), furnished(&gpu, false));
    let (nearest, depth) = (SampleRule::Nearest, SampleVisibility::Depth);
    for (store, samples, size, corrections, rule, visible_by) in [
        (&room, 24, 64, 0, nearest, depth),
        (&room, 24, 64, 1, nearest, depth),
        (&room, 100, 33, 2, SampleRule::Ray, depth),
        (&open, 24, 50, 1, SampleRule::Angle, depth),
        (&open, 100, 50, 1, nearest, SampleVisibility::Angle),
        (&room, 24, 40, 0, SampleRule::Mean, depth),
        (&room, 24, 40, 1, SampleRule::Reflection, depth),
        (&room, 24, 40, 1, SampleRule::Normal, depth),
        (&room, 100, 40, 1, SampleRule::Smooth, depth),
    ] {
        let mut settings = Settings::default();
        settings.reflection.method = Method::LightField;
        settings.gi.bounces = 0;
        // The picture is of the points' colours alone.
        settings.light.by = Lighting::Colors;
        settings.splat.close_gaps = false;
        settings.set_text("view.background", "#000000").unwrap();
        let chosen = &mut settings.light_field;
        (chosen.samples, chosen.size, chosen.corrections, chosen.rule) = (samples, size, corrections, rule);
        (chosen.visible_by, chosen.rest, chosen.own) = (visible_by, SampleRest::None, OwnPoints::LeftOut);
        if visible_by == SampleVisibility::Angle {
            // Lower ones lie under the horizon of all but a few mirror points.
            chosen.offset = 0.25;
        }
        let chosen = chosen.clone();
        // The first picture makes other maps, so that there are several pages of them.
        let sides = [DVec3::new(-1.0, 0.4, 0.1), DVec3::new(0.3, -1.0, 0.2)];
        for side in sides {
            let camera = Camera::looking(DVec3::new(0.1, 0.0, 0.1), side, 1.4, DVec3::Z);
            renderer.render(store, &Frame::new(&camera, &settings, Objects::default(), [96, 80])).unwrap();
        }
        let reflections = renderer.reflections.as_ref().unwrap();
        let field = &reflections.methods.light_field;
        let kept = field.kept.as_ref().unwrap();
        assert_eq!(kept.fields.len(), 1);
        assert!(samples < 100 || kept.pages.len() > 1, "{}", kept.pages.len());
        let eye = renderer.camera.unwrap().eye;
        let layout = Layout::new(size);
        let pages: Vec<Vec<[u32; 4]>> = kept
            .pages
            .iter()
            .map(|page| bytemuck::pod_collect_to_vec(&gpu.read_buffer(&page.records, 0, page.records.size()).unwrap()))
            .collect();
        let faces = |slot: usize| {
            let page = kept.pages.iter().position(|page| slot < page.first + page.slots).unwrap();
            std::array::from_fn(|face| {
                let first = ((slot - kept.pages[page].first) * 6 + face) * layout.texels_of_face as usize;
                pages[page][first..][..(size * size) as usize].iter().map(|record| texel_of(*record)).collect()
            })
        };
        let slots = kept.slots_of_samples();
        let sample = |((surface, _), slot): (&(DVec3, [DVec3; 2]), &Option<usize>)| {
            let map = slot.and_then(|slot| Some((slot, kept.slots.0[slot].filter(|map| map.used == field.search)?)));
            twin::Sample {
                surface: (*surface - eye).as_vec3(),
                middle: map.map_or(Vec3::ZERO, |(_, map)| (map.place - eye).as_vec3()),
                faces: map.map(|(slot, _)| faces(slot)),
            }
        };
        let twin = twin::Field {
            samples: kept.fields[0].samples.iter().zip(&slots[0]).map(sample).collect(),
            size,
            neighbours: chosen.neighbours as usize,
            rule,
            exponent: chosen.exponent,
            visible_by,
            horizon: chosen.horizon.to_radians(),
            corrections,
        };
        let bounce = reflections.first().unwrap();
        let targets = renderer.targets.as_ref().unwrap();
        let normals = vectors(&gpu, &targets.surfaces[targets.shown].normal);
        let [points, eyes] = [&bounce.mirror.point, &bounce.mirror.eye].map(|image| vectors(&gpu, image));
        let hits = &reflections.methods.gather.as_ref().unwrap().hits;
        let hits: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(&gpu.read_buffer(hits, 0, hits.size()).unwrap());
        let vector = |part: &[f32; 4]| Vec3::new(part[0], part[1], part[2]);
        // What the last set of rays is, which statistics describe: the look that weighs most.
        let weights = vectors(&gpu, &reflections.methods.gather.as_ref().unwrap().views);
        let received = rule.blends().then(|| halves(&gpu, &reflections.gloss.as_ref().unwrap().received));
        let mut blended = [0_u32; 3];
        let (mut rays, mut apart, mut kinds) = (0_u32, 0_u32, [0_u32; 4]);
        for pixel in (0..points.len()).filter(|pixel| points[*pixel][3] > 0.0) {
            let (place, normal) = (vector(&points[pixel]), vector(&normals[pixel]));
            let direction = (place - vector(&eyes[pixel])).reflect(normal).normalize();
            let [key, found, distance, _] = hits[pixel];
            let distance = f32::from_bits(distance);
            let expected = twin.find(place, normal, direction);
            let is_same = match expected {
                Found::On { t, identity } => found == identity + 1 && (distance - t).abs() <= 1e-3 * (1.0 + t),
                Found::Beside { identity } => found == identity + 1 && distance < 0.0,
                Found::Open => found == 0 && key == 0,
                Found::Nothing => found == 0 && key == 1,
            };
            rays += 1;
            apart += u32::from(!is_same);
            if let Some(received) = received.as_ref().filter(|_| is_same) {
                let looks = twin.looks(place, normal, direction);
                let color = |found: &Found| match found {
                    Found::On { identity, .. } | Found::Beside { identity } => {
                        linear(color_of(store.identities().find(*identity).unwrap().1))
                    }
                    Found::Open | Found::Nothing => Vec3::ZERO,
                };
                let (sum, first) = match looks.first() {
                    Some((_, first)) => (looks.iter().map(|(found, weight)| color(found) * *weight).sum(), *first),
                    None => (color(&expected), 1.0),
                };
                blended[0] += 1;
                blended[1] +=
                    u32::from(received[pixel].distance(sum) > 0.02 || (weights[pixel][0] - first).abs() > 0.02);
                blended[2] += u32::from(looks.len() > 1 && received[pixel].distance(color(&looks[0].0)) > 0.1);
            }
            kinds[match expected {
                Found::On { .. } => 0,
                Found::Beside { .. } => 1,
                Found::Open => 2,
                Found::Nothing => 3,
            }] += 1;
        }
        // Rounding moves a look-up to the next texel, and nearly equal samples change their order.
        let about = format!("{samples} {size} {corrections} {rule:?} {visible_by:?}: {kinds:?}");
        assert!(rays > 500 && apart * 50 <= rays, "{about}: {apart} of {rays} differ");
        assert!(kinds[0] > 20, "{about}");
        assert!(
            !rule.blends() || blended[1] * 25 <= blended[0] && blended[2] * 50 > blended[0],
            "{about}: {blended:?}"
        );
        assert!(corrections > 0 || kinds[1] > rays / 5, "{about}");
    }
}

/// A map of the walls of a box of edges of 2 about the origin, each texel a piece of a wall.
fn map_of_box(middle: Vec3, size: u32) -> [Vec<super::super::depth_walk::Texel>; 6] {
    let texel = |face: usize, x: u32, y: u32| {
        let axis = |turn: usize| Vec3::AXES[(face + turn) % 3];
        let forward = if face < 3 { axis(0) } else { -axis(0) };
        let slope = |at: u32| (at as f32 + 0.5) / (0.5 * size as f32) - 1.0;
        let sight = forward + axis(1) * slope(x) - axis(2) * slope(y);
        let place = exit_of_box(middle, sight);
        let wall = place.abs().max_position();
        super::super::depth_walk::Texel {
            identity: wall as u32 + if place[wall] < 0.0 { 3 } else { 0 },
            depth: (place - middle).dot(forward),
            normal: -Vec3::AXES[wall] * place[wall].signum(),
            radius: 1.0,
            middle: glam::Vec2::ZERO,
        }
    };
    std::array::from_fn(|face| (0..size * size).map(|at| texel(face, at % size, at / size)).collect())
}

/// Where a ray from inside leaves that box.
fn exit_of_box(from: Vec3, along: Vec3) -> Vec3 {
    let distances = (along.signum() - from) / along;
    from + along * distances.min_element()
}

fn within(reach: f32) -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(-reach..reach).prop_map(Vec3::from)
}

/// A direction with no part so small that a texel of a map says nothing about it.
fn any_direction() -> impl Strategy<Value = Vec3> {
    within(1.0).prop_filter_map("too short", |direction| {
        (direction.length() > 0.1 && direction.abs().min_element() > 1e-3).then(|| direction.normalize())
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// The angle by which a plain look-up is off is that of the sample's distance from the ray, as seen from what is
    /// found; a sample on the mirror point is off by nothing. With a correction the ray ends on its wall, if that is the
    /// one which both look-ups meet.
    #[test]
    fn a_plain_look_up_is_off_by_what_its_sample_lies_beside_the_ray(
        middle in within(0.6), place in within(0.8), direction in any_direction(), is_there in prop::bool::weighted(0.1),
    ) {
        let size = 128;
        let place = if is_there { middle } else { place };
        let field = |corrections| twin::Field {
            samples: vec![twin::Sample { surface: middle, middle, faces: Some(map_of_box(middle, size)) }],
            size,
            neighbours: 1,
            rule: SampleRule::Nearest,
            exponent: 1.0,
            visible_by: SampleVisibility::Depth,
            horizon: 1.5,
            corrections,
        };
        let shown = field(0).place_in_direction(direction);
        let beside = (middle - place).reject_from_normalized(direction).length();
        let away = shown.distance(place);
        // A texel is seen under up to this angle from the mirror point.
        let slack = 2.0 / size as f32 * (shown - middle).length() * 1.8 / away;
        let (expected, angle) = ((beside / away).min(1.0).asin(), (shown - place).angle_between(direction));
        // The arc sine is the steeper the nearer the angle is to a right one.
        let slack = slack / expected.cos().max(0.1);
        prop_assert!((angle - expected).abs() < slack || angle.max(expected) > 1.3, "{angle}, {expected}");
        let truth = exit_of_box(place, direction);
        let wall = |place: Vec3| {
            let wall = place.abs().max_position();
            (wall, place[wall] > 0.0)
        };
        let met = field(1).find(place, Vec3::Z, direction);
        let of_truth = field(1).place_in_direction((truth - middle).normalize());
        if wall(shown) == wall(truth) && wall(of_truth) == wall(truth) {
            let Found::On { t, .. } = met else { panic!("{met:?}") };
            prop_assert!((place + direction * t).distance(truth) < 1e-3, "{t}, {truth}");
        }
    }
}

/// Samples all over a sphere, and mirror points on a way over it: the weights of all rules are shares of one, equal ones
/// where the power vanishes, and only the smooth ones change without a jump where the neighbours change.
#[test]
fn weights_are_shares_and_smooth_ones_do_not_jump() {
    let on_sphere = |number: u32, of: u32| {
        let z = 1.0 - 2.0 * (number as f32 + 0.5) / of as f32;
        let (sin, cos) = (number as f32 * 2.399_963).sin_cos();
        Vec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
    };
    // Each map shows its own number in all directions.
    let size = 2;
    let faces = |identity: u32| -> [Vec<super::super::depth_walk::Texel>; 6] {
        std::array::from_fn(|_| {
            let texel = super::super::depth_walk::Texel {
                identity,
                depth: 9.0,
                normal: Vec3::X,
                radius: 1.0,
                middle: glam::Vec2::ZERO,
            };
            vec![texel; (size * size) as usize]
        })
    };
    let samples = || {
        (0..60).map(|number| {
            let place = on_sphere(number, 60);
            twin::Sample { surface: place, middle: place * 1.01, faces: Some(faces(number)) }
        })
    };
    let steps: u32 = 2000;
    let along = |step: u32| {
        let (sin, cos) = (step as f32 / steps as f32 * 3.0).sin_cos();
        Vec3::new(cos * 0.9, sin * 0.9, 0.436)
    };
    let mut largest = Vec::new();
    for (rule, exponent) in [
        (SampleRule::Mean, 4.0),
        (SampleRule::Reflection, 0.0),
        (SampleRule::Normal, 0.0),
        (SampleRule::Reflection, 64.0),
        (SampleRule::Normal, 4.0),
        (SampleRule::Smooth, 4.0),
    ] {
        let field = twin::Field {
            samples: samples().collect(),
            size,
            neighbours: 4,
            rule,
            exponent,
            visible_by: SampleVisibility::Depth,
            horizon: 1.5,
            corrections: 0,
        };
        let weights = |step: u32| {
            let place = along(step);
            let mut weights = [0.0; 60];
            for (found, weight) in field.looks(place, place, Vec3::new(0.3, 0.2, 0.9).normalize()) {
                let (Found::On { identity, .. } | Found::Beside { identity }) = found else { panic!("{found:?}") };
                assert!((0.0..=1.0).contains(&weight), "{rule:?}: {weight}");
                weights[identity as usize] += weight;
            }
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-4, "{rule:?}");
            let is_mean = rule == SampleRule::Mean || exponent == 0.0;
            assert!(!is_mean || weights.iter().all(|weight| [0.0, 0.25].contains(weight)), "{rule:?}: {weights:?}");
            weights
        };
        let jump = |step| {
            let (before, after) = (weights(step), weights(step + 1));
            before.iter().zip(after).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        largest.push((0..steps).map(jump).fold(0.0, f32::max));
    }
    let [mean, .., normal, smooth] = largest[..] else { panic!("six rules") };
    assert!(mean > 0.24 && normal > 0.02 && smooth < 0.02, "{largest:?}");
}
