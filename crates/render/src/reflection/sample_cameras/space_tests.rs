//! Tests of cells of space: pinholes and trees against closed forms and against the rays themselves, then the GPU
//! against the same leaves in doubles.

use std::sync::atomic::AtomicBool;

use cloud::Bounds;
use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;
use scene::five_mirrors::{Variant, camera};
use scene::{CameraCells, SampleCameras as Parameters};

use super::pinhole::{Pinhole, across_axis};
use super::tests::{all_points, made, on_screen, place_on_sphere, plane_picture, quantile, walls};
use super::tree::{Builder, Leaf, Node, Ray, RayMap, Rules, Trees, plant};
use crate::Gpu;
use crate::layout::{CameraRay, POINTS_FOUND, POINTS_LISTED, RAYS_LEFT};
use crate::reflection::sscr::exact_mirrors::{picture, wall_points};
use crate::reflection::sscr::twin::{MirrorPicture, Random};

pub const RULES: Rules = Rules { accuracy: 1.0, near: 0.0, split_gain: 0.8, longest_list: 4096 };
const SIZE: glam::UVec2 = glam::UVec2::new(400, 300);

/// The rays of every few pixels of a mirror.
fn ray_map(picture: &MirrorPicture, stride: u32, scene: Bounds) -> RayMap {
    let [columns, rows] = [picture.size.x.div_ceil(stride), picture.size.y.div_ceil(stride)];
    let ray = |index: u32| {
        let at = glam::UVec2::new(index % columns, index / columns) * stride + stride / 2;
        let pixel = (at.cmplt(picture.size).all()).then(|| &picture.pixels[(at.y * picture.size.x + at.x) as usize]);
        pixel.and_then(Option::as_ref).map_or(CameraRay::default(), |pixel| {
            let direction = (2.0 * pixel.toward_eye.dot(pixel.normal) * pixel.normal - pixel.toward_eye).normalize();
            let at = at.as_vec2() + 0.5;
            CameraRay { point: pixel.point.extend(at.x), direction: direction.extend(at.y) }
        })
    };
    let rays: Vec<CameraRay> = (0..columns * rows).map(ray).collect();
    RayMap::new(columns as usize, &rays, scene, Some(DVec3::NEG_Z), |_| 0)
}

fn planted(map: &RayMap, rules: &Rules) -> Trees {
    plant(map, rules, &AtomicBool::new(false)).unwrap()
}

/// The tree of the only mirror.
fn tree(map: &RayMap, rules: &Rules) -> Node {
    let is_cancelled = AtomicBool::new(false);
    let gaps = map.gaps().into_iter().next().unwrap();
    Builder { map, rules, is_cancelled: &is_cancelled }.node(gaps, 1.0, 0).unwrap()
}

/// The leaf of a place.
fn leaf_of(mut node: &Node, place: DVec3) -> &Leaf {
    loop {
        match node {
            Node::Leaf { leaf, .. } => return leaf,
            Node::Plane { normal, offset, sides } => node = &sides[usize::from(normal.dot(place) <= *offset)],
        }
    }
}

/// The pixel in which the rays of a gap pass a place, in a plane across the axis.
pub fn pixel_in_gap(rays: [Ray; 4], place: DVec3, axis: DVec3) -> Option<DVec2> {
    let sides = across_axis(axis);
    let [a, b, c, d] = rays.map(|ray| {
        let from_place = ray.tail - place;
        let offset = from_place - ray.direction * (from_place.dot(axis) / ray.direction.dot(axis));
        DVec2::from(sides.map(|side| offset.dot(side)))
    });
    let (right, down, twist) = (b - a, c - a, d - c - b + a);
    let mut p = DVec2::splat(0.5);
    let mut is_found = false;
    for _ in 0..12 {
        let (by_x, by_y) = (right + p.y * twist, down + p.x * twist);
        let value = a + p.x * right + p.y * (down + p.x * twist);
        let moved = DVec2::new(value.perp_dot(by_y), by_x.perp_dot(value)) / by_x.perp_dot(by_y);
        p = (p - moved).clamp(DVec2::splat(-2.0), DVec2::splat(3.0));
        is_found = moved.length() < 1e-9;
        if is_found {
            break;
        }
    }
    let is_inside = (p - 0.5).abs().max_element() <= 0.5 + 1e-4;
    (is_found && is_inside).then(|| rays[0].at + p * (rays[3].at - rays[0].at))
}

/// The pixels in which a leaf sees a place.
fn pixels_of(map: &RayMap, leaf: &Leaf, place: DVec3) -> Vec<DVec2> {
    match leaf {
        Leaf::Open => Vec::new(),
        Leaf::Pinhole(pinhole) => {
            let uv = pinhole.place(place).filter(|uv| uv.abs().max_element() <= 1.001);
            uv.map(|uv| pinhole.pixel(uv)).into_iter().collect()
        }
        Leaf::List { parts, .. } => {
            let rays = |gap: &u32| map.corners(*gap as usize).map(|ray| map.rays[ray].unwrap());
            let of_part = |(axis, gaps): &(DVec3, Vec<u32>)| {
                gaps.iter().filter_map(|gap| pixel_in_gap(rays(gap), place, *axis)).collect::<Vec<DVec2>>()
            };
            parts.iter().flat_map(of_part).collect()
        }
    }
}

/// Rays from around a place, or parallel ones without it.
pub fn bundle(center: Option<DVec3>, axis: DVec3, reach: f64) -> Vec<Ray> {
    let sides = across_axis(axis);
    let ray = |index: i32| {
        let (x, y) = (f64::from(index % 5 - 2) * 0.05, f64::from(index / 5 - 2) * 0.07);
        let across = x * sides[0] + y * sides[1];
        let (tail, direction) = match center {
            Some(center) => {
                let direction = (axis + across).normalize();
                // Tails on no plane.
                (center + direction * (1.0 + 0.2 * x + 0.1 * (7.0 * y).sin()), direction)
            }
            None => (across + axis * (0.1 * x - 0.05 * y), axis),
        };
        Ray { tail, direction, sight: axis, reach, at: DVec2::new(100.0 * x, 100.0 * y), mirror: 0 }
    };
    (0..25).map(ray).collect()
}

proptest! {
    #[test]
    fn rays_through_one_place_have_their_pinhole_there(
        center in prop::array::uniform3(-5.0_f64..5.0), turn in prop::array::uniform3(-3.0_f64..3.0),
    ) {
        let (center, axis) = (DVec3::from(center), DQuat::from_scaled_axis(turn.into()) * DVec3::Z);
        let rays = bundle(Some(center), axis, 3.0);
        let pinhole = Pinhole::fit(&rays, 0.0).unwrap();
        prop_assert!(pinhole.center.unwrap().distance(center) < 1e-9 * (1.0 + center.length()), "{:?}", pinhole.center);
        prop_assert!(pinhole.error < 1e-6, "{}", pinhole.error);
        for ray in &rays {
            let uv = pinhole.place(ray.tail + ray.direction * 1.7).unwrap();
            prop_assert!(pinhole.pixel(uv).distance(ray.at) < 1e-6);
        }
    }

    #[test]
    fn parallel_rays_have_a_picture_without_a_centre(turn in prop::array::uniform3(-3.0_f64..3.0)) {
        let axis = DQuat::from_scaled_axis(turn.into()) * DVec3::Z;
        let rays = bundle(None, axis, 3.0);
        let pinhole = Pinhole::fit(&rays, 0.0).unwrap();
        prop_assert!(pinhole.center.is_none() && pinhole.error < 1e-6, "{pinhole:?}");
        let uv = pinhole.place(rays[7].tail + axis * 1.3).unwrap();
        prop_assert!(pinhole.pixel(uv).distance(rays[7].at) < 1e-6);
    }
}

#[test]
fn rays_that_meet_before_their_heads_have_no_pinhole() {
    // From outside towards the centre, and beyond it.
    let rays: Vec<Ray> = bundle(Some(DVec3::ZERO), DVec3::Z, 3.0)
        .into_iter()
        .map(|ray| Ray { direction: -ray.direction, sight: -ray.sight, ..ray })
        .collect();
    assert!(Pinhole::fit(&rays, 0.0).is_none());
    // Rays that end before the crossing have one.
    let short: Vec<Ray> = rays.iter().map(|ray| Ray { reach: 0.5, ..*ray }).collect();
    let pinhole = Pinhole::fit(&short, 0.0).unwrap();
    assert!(pinhole.center.unwrap().length() < 1e-9 && pinhole.error < 1e-6, "{pinhole:?}");
}

#[test]
fn a_plane_mirror_has_one_pinhole_at_the_mirrored_eye() {
    let (mut picture, normal, middle) = plane_picture(SIZE);
    // A part beside the middle: its rays' mean direction is not the mirrored line of sight.
    let is_hidden = |index: usize| index % (SIZE.x as usize) < 220 || index / (SIZE.x as usize) > 200;
    picture.pixels.iter_mut().enumerate().filter(|(index, _)| is_hidden(*index)).for_each(|(_, pixel)| *pixel = None);
    let map = ray_map(&picture, 4, walls());
    let trees = planted(&map, &Rules { accuracy: 0.25, ..RULES });
    assert_eq!((trees.count, trees.pinholes, trees.lists), (1, 1, 0));
    let Node::Leaf { leaf: Leaf::Pinhole(pinhole), .. } = tree(&map, &RULES) else { panic!("no pinhole") };
    let mirrored = normal * (2.0 * middle.dot(normal));
    // The rays are those of single precision.
    let center = pinhole.center.unwrap();
    assert!(center.distance(mirrored) < 1e-5, "{center} {mirrored}");
    assert!(pinhole.error < 1e-3, "{}", pinhole.error);
}

#[test]
fn every_place_between_four_rays_reaches_a_leaf_that_sees_it_there() {
    // Where rays cross, a list may have several answers, and no interpolation near caustics.
    for (mirror, stride, most_lost, share) in
        [(Variant::Sphere, 4, 3, 0.999), (Variant::Torus, 8, 150, 0.95), (Variant::Parabolic, 8, 150, 0.95)]
    {
        let map = ray_map(&picture(mirror, SIZE), stride, walls());
        let tree = tree(&map, &RULES);
        let gaps = map.gaps().into_iter().next().unwrap();
        let mut random = Random(3);
        let (mut off, mut lost) = (Vec::new(), 0);
        for _ in 0..3000 {
            let gap = gaps[(random.next() * gaps.len() as f32) as usize % gaps.len()];
            let rays = map.corners(gap as usize).map(|ray| map.rays[ray].unwrap());
            let corner = rays[(random.next() * 4.0) as usize % 4];
            // A ray of the map, anywhere along it: it belongs to a gap, so a leaf must have it.
            let place = corner.tail + corner.direction * (corner.reach * f64::from(0.02 + 0.96 * random.next()));
            let found = pixels_of(&map, leaf_of(&tree, place), place);
            match found.iter().map(|at| at.distance(corner.at)).min_by(f64::total_cmp) {
                Some(distance) => off.push(distance),
                None => lost += 1,
            }
        }
        let most = quantile(off, share);
        assert!(lost <= most_lost && most <= RULES.accuracy * 1.01, "{mirror:?}: {most} pixels, {lost} lost");
    }
}

#[test]
fn the_sphere_needs_lists_where_it_bends_and_copies_stay_few() {
    let map = ray_map(&picture(Variant::Sphere, SIZE), 4, walls());
    let usual = planted(&map, &RULES);
    assert!(usual.pinholes > 10 && usual.lists > 10, "{} {}", usual.pinholes, usual.lists);
    assert!(usual.copies < 12 * usual.rays, "{} of {}", usual.copies, usual.rays);
    // A larger error lets pinholes stand for more.
    let rough = planted(&map, &Rules { accuracy: 4.0, ..RULES });
    assert!(rough.lists * usual.pinholes < usual.lists * rough.pinholes);
    // Splits that gain little make copies.
    let letter = planted(&map, &Rules { split_gain: 1.0, ..RULES });
    assert!(letter.copies > usual.copies && letter.pinholes + letter.lists > usual.pinholes + usual.lists);
    // Lists that are too long leave their rays.
    let short = planted(&map, &Rules { longest_list: 4, ..RULES });
    let standing = |trees: &Trees| trees.standing.iter().map(|word| word.count_ones()).sum::<u32>();
    assert!(standing(&short) < standing(&usual) && standing(&usual) > 0);
    assert!(short.lists < usual.lists && short.pinholes == usual.pinholes);
}

#[test]
fn trees_that_nobody_waits_for_are_given_up() {
    let map = ray_map(&picture(Variant::Sphere, SIZE), 4, walls());
    assert!(plant(&map, &RULES, &AtomicBool::new(true)).is_none());
}

fn in_space() -> Parameters {
    Parameters { cells: CameraCells::Space, longest_list: 4096, down_sampling: 4, ..all_points() }
}

#[test]
fn the_gpu_finds_what_the_leaves_see_in_doubles() {
    let Some(gpu) = Gpu::shared() else { return };
    let points = wall_points(3000);
    // Near caustics, as of the torus, the last bits decide whether a gap has a place.
    let picture = picture(Variant::Sphere, SIZE);
    let map = ray_map(&picture, 4, walls());
    let tree = tree(&map, &RULES);
    let made = made(&gpu, &picture, &points, &in_space());
    let mut off = Vec::new();
    for (q, roots) in points.iter().zip(&made.roots) {
        let q = q.as_dvec3();
        let mut seen = pixels_of(&map, leaf_of(&tree, q), q);
        seen.retain(|at| {
            let place = at.as_uvec2();
            let is_in = place.cmplt(picture.size).all() && at.min_element() >= 0.0;
            let pixel = is_in.then(|| picture.pixels[(place.y * picture.size.x + place.x) as usize].as_ref());
            pixel.flatten().is_some_and(|pixel| {
                let offset = q - pixel.point.as_dvec3();
                offset.dot(pixel.normal.as_dvec3()) > 0.0
            })
        });
        let nearest = |at: &DVec2| roots.iter().map(|root| root.at.distance(*at)).fold(f64::INFINITY, f64::min);
        off.extend(seen.iter().map(nearest));
    }
    let count = off.len();
    let [median, most] = [0.5, 0.95].map(|share| quantile(off.clone(), share));
    // Places are kept to a quarter of a pixel, and one of two that are nearer than a pixel.
    assert!(count > 800 && median < 0.25 && most < 1.2, "{count} places, {median} {most}");
    assert!(made.counters[POINTS_LISTED] > 0 && made.counters[POINTS_LISTED] <= made.counters[POINTS_FOUND]);
}

#[test]
fn cells_of_space_find_points_where_the_sphere_reflects_them() {
    let Some(gpu) = Gpu::shared() else { return };
    let picture = picture(Variant::Sphere, SIZE);
    let points = wall_points(3000);
    let made = made(&gpu, &picture, &points, &in_space());
    let mut errors = Vec::new();
    let (mut seen, mut found) = (0, 0);
    for (q, roots) in points.iter().zip(&made.roots) {
        let truth = place_on_sphere(-camera().eye, 0.43, q.as_dvec3()).map(|place| on_screen(place, picture.size));
        // Nearer to the rim than this there are no four rays.
        let is_mirror = |side: DVec2| {
            let at = truth.map_or(DVec2::ZERO, |truth| truth + 6.0 * side).clamp(DVec2::ZERO, SIZE.as_dvec2() - 1.0);
            picture.pixels[(at.y as u32 * SIZE.x + at.x as u32) as usize].is_some()
        };
        let truth = truth.filter(|_| [DVec2::X, DVec2::Y, -DVec2::X, -DVec2::Y].into_iter().all(is_mirror));
        seen += usize::from(truth.is_some());
        let Some(truth) = truth else { continue };
        if let Some(off) = roots.iter().map(|root| root.at.distance(truth)).min_by(f64::total_cmp) {
            found += 1;
            errors.push(off);
        }
    }
    let [median, p95] = [0.5, 0.95].map(|share| quantile(errors.clone(), share));
    assert!(
        seen > 1000 && found as f64 > 0.99 * seen as f64 && median < 0.5 && p95 < 1.5,
        "{found} of {seen}: {median} {p95}"
    );
    let rim = f64::from(made.counters[RAYS_LEFT]) / picture.pixels.iter().flatten().count() as f64;
    assert!(rim > 0.0 && rim < 0.15, "{rim}");
}

#[test]
fn rays_of_lists_that_are_too_long_are_counted_and_project_nothing() {
    let Some(gpu) = Gpu::shared() else { return };
    let picture = picture(Variant::Parabolic, SIZE);
    let points = wall_points(500);
    // The rays of a hollow mirror cross, so that its only list is longer than allowed: nothing projects, and it is said.
    let made = made(&gpu, &picture, &points, &Parameters { longest_list: 4, accuracy: 0.25, ..in_space() });
    let pixels = picture.pixels.iter().flatten().count() as u32;
    assert!(made.counters[RAYS_LEFT] > pixels * 9 / 10, "{} of {pixels}", made.counters[RAYS_LEFT]);
    assert!(made.counters[POINTS_FOUND] < 50);
}

/// Two points of a ray that lie in different leaves are told apart by their distance from the mirror: each leaf has a
/// plane of its own, so that depths behind these mean nothing to one another.
#[test]
fn the_point_nearer_to_the_mirror_is_seen_although_another_leaf_projects_it() {
    let Some(gpu) = Gpu::shared() else { return };
    let parameters = Parameters { down_sampling: 2, ..in_space() };
    let picture = picture(Variant::Sphere, SIZE);
    let map = ray_map(&picture, 2, walls());
    let tree = tree(&map, &RULES);
    let (mut pairs, mut points) = (Vec::new(), Vec::new());
    // Every other ray and row, so that splats do not meet.
    let is_apart = |number: usize| number.is_multiple_of(2) && (number / map.columns).is_multiple_of(2);
    for ray in map.rays.iter().enumerate().filter(|(number, _)| is_apart(*number)).filter_map(|(_, ray)| *ray) {
        let at = |distance: f64| ray.tail + ray.direction * distance;
        let leaf = |distance: f64| leaf_of(&tree, at(distance));
        // Points whose distances differ by less than the depth offset, 0.05, are averaged.
        let steps = (ray.reach / 0.07) as u32;
        let parted = (4..steps).map(|step| f64::from(step) * 0.07).find(|distance| {
            let [near, far] = [leaf(*distance), leaf(distance + 0.07)];
            let both = [near, far].map(|leaf| !matches!(leaf, Leaf::Open));
            !std::ptr::eq(near, far) && both == [true; 2]
        });
        let Some(distance) = parted else { continue };
        // In both orders.
        let near_far = [at(distance), at(distance + 0.07)];
        points.extend(if pairs.len() % 2 == 0 { near_far } else { [near_far[1], near_far[0]] }.map(|at| at.as_vec3()));
        pairs.push((ray, near_far));
    }
    let made = made(&gpu, &picture, &points, &parameters);
    let (mut near, mut far) = (0, 0);
    for (number, (ray, places)) in pairs.iter().enumerate() {
        // Two places in one pixel are needed, or there is nothing to tell apart.
        let is_here = |point: usize| made.roots[point].iter().any(|root| root.at.floor() == ray.at.floor());
        if !(is_here(2 * number) && is_here(2 * number + 1)) {
            continue;
        }
        let pixel = ray.at.as_uvec2();
        let [x, y, z, coverage] = made.position[(pixel.y * SIZE.x + pixel.x) as usize].map(f32::from_bits);
        let shown = DVec3::new(x.into(), y.into(), z.into());
        assert_eq!(coverage, 1.0);
        if shown.distance(places[0]) < shown.distance(places[1]) { near += 1 } else { far += 1 }
    }
    assert!(near > 60 && far == 0, "{near} pixels show the near point, {far} the far one, of {} pairs", pairs.len());
}
