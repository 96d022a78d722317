//! Laws of reflected rays in doubles, whatever the mirror is: of the gaps between rays and the trees over them, of the
//! error along a ray, of the distances at which rays meet, and of the two ways of light.

use std::sync::atomic::AtomicBool;

use cloud::Bounds;
use glam::{DVec2, DVec3, UVec2, Vec3};
use proptest::prelude::*;
use scene::five_mirrors::{Variant, camera};
use scene::{JudgedBy, SampleCameras as Parameters};

use super::pinhole::Pinhole;
use super::space_tests::{RULES, bundle, pixel_in_gap};
use super::tests::{RADIUS, all_points, quantile, walls};
use super::tree::{Builder, Leaf, Node, Ray, RayMap, Rules, plant};
use super::twin::Bundles;
use crate::reflection::sscr::exact_mirrors::{picture, wall_points};
use crate::reflection::sscr::twin::{MirrorPicture, MirrorPixel};

/// The radius of the ball of the five mirrors, about the origin.
const BALL: f64 = 0.43;

/// Rays from a bumpy surface, which go apart (`bend` above 0) or meet (below), each turned a little by chance.
fn bumpy_rays(columns: usize, rows: usize, bend: f64, random: &[f64]) -> RayMap {
    let drawn = |ray: usize, number: usize| random[(7 * ray + number) % random.len()];
    let ray = |number: usize| {
        let (x, y) = ((number % columns) as f64 * 0.1, (number / columns) as f64 * 0.1);
        let tail = DVec3::new(x, y, 0.05 * drawn(number, 0));
        let slope = DVec2::new(x - 0.3, y - 0.3) * bend + 0.15 * DVec2::new(drawn(number, 1), drawn(number, 2));
        let direction = slope.extend(1.0).normalize();
        let at = DVec2::new((number % columns) as f64, (number / columns) as f64) * 4.0 + 2.5;
        Some(Ray { tail, direction, sight: direction, reach: 2.0 + drawn(number, 3), at, mirror: 0 })
    };
    RayMap { columns, rays: (0..columns * rows).map(ray).collect() }
}

/// The leaf of a place, with the gaps that it leaves to others.
fn node_of(mut node: &Node, place: DVec3) -> (&Leaf, &[u32]) {
    loop {
        match node {
            Node::Leaf { leaf, left, .. } => return (leaf, left),
            Node::Plane { normal, offset, sides } => node = &sides[usize::from(normal.dot(place) <= *offset)],
        }
    }
}

fn depth_of(node: &Node) -> u32 {
    match node {
        Node::Leaf { .. } => 0,
        Node::Plane { sides, .. } => 1 + sides.iter().map(depth_of).max().unwrap(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Whatever planes part the rays: a gap goes wherever one of its four rays goes, or a place between them.
    #[test]
    fn every_place_of_every_ray_reaches_a_leaf_that_has_the_gaps_of_this_ray(
        columns in 3_usize..8, rows in 3_usize..8, bend in -1.5_f64..1.5,
        random in prop::collection::vec(-1.0_f64..1.0, 97), shares in prop::collection::vec(0.0_f64..1.0, 31),
        accuracy in 0.02_f64..2.0, split_gain in 0.5_f64..1.0, longest_list in prop::sample::select(vec![4_usize, 4096]),
    ) {
        let map = bumpy_rays(columns, rows, bend, &random);
        let rules = Rules { accuracy, split_gain, longest_list, ..RULES };
        let is_cancelled = AtomicBool::new(false);
        let gaps = map.gaps().into_iter().next().unwrap_or_default();
        let tree = Builder { map: &map, rules: &rules, is_cancelled: &is_cancelled }.node(gaps.clone(), 1.0, 0).unwrap();
        prop_assert!(depth_of(&tree) <= 40);
        let trees = plant(&map, &rules, &is_cancelled).unwrap();
        prop_assert!(trees.copies <= 128 * trees.rays.max(1), "{} of {}", trees.copies, trees.rays);
        for (number, gap) in gaps.iter().enumerate() {
            let rays = map.corners(*gap as usize).map(|ray| map.rays[ray].unwrap());
            let share = |of: usize| shares[(5 * number + of) % shares.len()];
            let along = |ray: &Ray, share: f64| ray.tail + ray.direction * (ray.reach * share);
            for corner in 0..4 {
                let ray = &rays[corner];
                for place in [0.0, share(corner), 1.0].map(|share| along(ray, share)) {
                    let (leaf, left) = node_of(&tree, place);
                    match leaf {
                        Leaf::Pinhole(pinhole) => {
                            let uv = pinhole.place(place);
                            let is_in = uv.is_some_and(|uv| uv.abs().max_element() <= 1.0 + 1e-6);
                            prop_assert!(is_in, "{gap}, {corner}: {uv:?}");
                            let off = pinhole.pixel(uv.unwrap()).distance(ray.at);
                            prop_assert!(off <= accuracy + 1e-6, "{gap}, {corner}: {off} pixels");
                        }
                        Leaf::List { parts, .. } => prop_assert!(
                            left.contains(gap) || parts.iter().any(|(_, gaps)| gaps.contains(gap)), "{gap}, {corner}"
                        ),
                        Leaf::Open => prop_assert!(left.contains(gap), "{gap}, {corner}"),
                    }
                }
            }
            // Between the four rays.
            let (x, y, far) = (share(4), share(5), share(6));
            let weights = [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y];
            let place: DVec3 = (0..4).map(|corner| along(&rays[corner], far) * weights[corner]).sum();
            let (leaf, left) = node_of(&tree, place);
            let has_it = match leaf {
                Leaf::Pinhole(pinhole) => pinhole.place(place).is_some_and(|uv| uv.abs().max_element() <= 1.0 + 1e-6),
                Leaf::List { parts, .. } => left.contains(gap) || parts.iter().any(|(_, gaps)| gaps.contains(gap)),
                Leaf::Open => left.contains(gap),
            };
            prop_assert!(has_it, "between the rays of {gap}");
        }
    }

    /// The paper's unit frustum.
    #[test]
    fn a_gap_is_exact_on_its_rays_and_joins_its_neighbour_without_a_step(
        bend in -0.2_f64..0.5, random in prop::collection::vec(-0.05_f64..0.05, 47), depth in 0.2_f64..1.8,
        x in 0.01_f64..0.99, y in 0.01_f64..0.99,
    ) {
        let map = bumpy_rays(3, 2, bend, &random);
        let gap = |gap: usize| map.corners(gap).map(|ray| map.rays[ray].unwrap());
        let (here, beside) = (gap(0), gap(1));
        let axis = DVec3::Z;
        let on = |ray: &Ray| ray.tail + ray.direction * ((depth - ray.tail.z) / ray.direction.z);
        for ray in &here {
            let at = pixel_in_gap(here, on(ray), axis);
            prop_assert!(at.is_some_and(|at| at.distance(ray.at) < 1e-6), "{at:?}, {}", ray.at);
        }
        // On the face that both share.
        let place = on(&here[1]).lerp(on(&here[3]), y);
        let [one, other] = [here, beside].map(|rays| pixel_in_gap(rays, place, axis));
        let truth = here[1].at.lerp(here[3].at, y);
        prop_assert!(one.is_some_and(|at| at.distance(truth) < 1e-6), "{one:?}");
        prop_assert!(other.is_some_and(|at| at.distance(truth) < 1e-6), "{other:?}");
        // A place inside belongs to one of them, and one outside to none.
        let mix = |rays: &[Ray; 4], x: f64, y: f64| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|corner| on(&rays[corner]));
            a.lerp(b, x).lerp(c.lerp(d, x), y)
        };
        let inside = mix(&here, x, y);
        let truth = here[0].at + DVec2::new(x, y) * (here[3].at - here[0].at);
        let at = pixel_in_gap(here, inside, axis);
        prop_assert!(at.is_some_and(|at| at.distance(truth) < 1e-6), "{at:?}, {truth}");
        prop_assert!(pixel_in_gap(beside, inside, axis).is_none());
        for (x, y) in [(-0.2 - x, y), (x, -0.2 - y), (x, 1.2 + y)] {
            prop_assert!(pixel_in_gap(here, mix(&here, x, y), axis).is_none(), "{x} {y}");
        }
    }

    /// Between the ends of a ray the error of a pinhole is that of both, by their shares, less a part of its quadratic
    /// term; so its largest is known without a search.
    #[test]
    fn the_error_along_a_ray_is_its_closed_form(
        bends in prop::collection::vec(-0.4_f64..0.4, 6), shift in prop::array::uniform3(-1.0_f64..1.0),
    ) {
        let mut rays = bundle(Some(DVec3::from(shift)), DVec3::Z, 2.0);
        for (number, ray) in rays.iter_mut().enumerate() {
            let bend = DVec3::new(bends[number % 6], bends[(number * 5 + 1) % 6], 0.0) * 0.1;
            ray.direction = (ray.direction + bend).normalize();
        }
        let Some(pinhole) = Pinhole::fit(&rays, 0.0) else { return Ok(()) };
        let (mut bound, mut most, mut largest_bend) = (0.0_f64, 0.0_f64, 0.0_f64);
        for ray in &rays {
            let place = |share: f64| pinhole.place(ray.tail + ray.direction * (ray.reach * share)).unwrap();
            let error_at = |uv: DVec2| pinhole.pixel(uv) - ray.at;
            let (tail, head) = (place(0.0), place(1.0));
            let [first, last] = [tail, head].map(error_at);
            let bend = 2.0 * (first + last - 2.0 * error_at(tail.lerp(head, 0.5)));
            for sample in 0..=1000 {
                let uv = place(f64::from(sample) / 1000.0);
                let share = (uv - tail).dot(head - tail) / (head - tail).length_squared();
                prop_assert!(uv.distance(tail.lerp(head, share)) < 1e-9, "a ray is straight in the picture");
                let closed = first.lerp(last, share) - bend * share * (1.0 - share);
                prop_assert!(closed.distance(error_at(uv)) < 1e-7, "{closed} {}", error_at(uv));
                most = most.max(error_at(uv).length());
            }
            bound = bound.max(first.length().max(last.length()) + 0.25 * bend.length());
            largest_bend = largest_bend.max(bend.length());
        }
        prop_assert!((pinhole.error - bound).abs() < 1e-7, "{} {bound}", pinhole.error);
        prop_assert!(most <= bound + 1e-9 && bound <= most + 0.25 * largest_bend + 1e-9, "{most} {bound}");
    }
}

/// In doubles; `a_plane_mirror_has_one_pinhole_at_the_mirrored_eye` takes the single precision of a picture.
#[test]
fn a_flat_mirror_is_one_pinhole_in_perspective_and_in_parallel_views() {
    let (normal, middle) = (DVec3::new(0.3, -0.2, 1.0).normalize(), DVec3::new(0.0, 0.0, -1.5));
    let forward = DVec3::NEG_Z;
    for is_parallel in [false, true] {
        let ray = |number: usize| {
            let at = DVec2::new((number % 40) as f64, (number / 40) as f64) * 4.0 + 2.5;
            let across = ((at - DVec2::new(80.0, 60.0)) / 200.0).extend(0.0);
            let (eye, sight) =
                if is_parallel { (across, forward) } else { (DVec3::ZERO, (across + forward).normalize()) };
            let tail = eye + sight * ((middle - eye).dot(normal) / sight.dot(normal));
            let mirrored = |along: DVec3| along - 2.0 * along.dot(normal) * normal;
            let (direction, sight) = (mirrored(sight), mirrored(if is_parallel { sight } else { forward }));
            Some(Ray { tail, direction, sight, reach: 3.0 + 0.01 * at.x, at, mirror: 0 })
        };
        let map = RayMap { columns: 40, rays: (0..40 * 30).map(ray).collect() };
        let trees = plant(&map, &Rules { accuracy: 0.25, ..RULES }, &AtomicBool::new(false)).unwrap();
        assert_eq!((trees.count, trees.pinholes, trees.lists), (1, 1, 0), "parallel: {is_parallel}");
        let rays: Vec<Ray> = map.rays.iter().copied().flatten().collect();
        let pinhole = Pinhole::fit(&rays, 0.0).unwrap();
        assert!(pinhole.error < 1e-6, "parallel: {is_parallel}, {} pixels", pinhole.error);
        let off = pinhole.center.map(|center| center.distance(normal * (2.0 * middle.dot(normal))));
        assert!(off.map_or(is_parallel, |off| !is_parallel && off < 1e-9), "parallel: {is_parallel}, {off:?}");
    }
}

/// Where the ray of a place of the picture meets the ball, relative to the eye, if it does.
fn on_ball(eye: DVec3, sight: DVec3) -> Option<DVec3> {
    let along = -eye.dot(sight);
    let squared = BALL * BALL - (eye.length_squared() - along * along);
    (squared > 0.0).then(|| sight * (along - squared.sqrt()))
}

/// The directions of pixels of an eye that looks at the origin.
fn sights(eye: DVec3, size: UVec2) -> impl Fn(DVec2) -> DVec3 {
    let forward = -eye.normalize();
    let right = forward.cross(DVec3::Y).normalize();
    let up = right.cross(forward);
    let focal = f64::from(size.y) * 0.5 / 30.0_f64.to_radians().tan();
    let middle = size.as_dvec2() * 0.5;
    move |at| (right * (at.x - middle.x) + up * (middle.y - at.y) + forward * focal).normalize()
}

/// The ball as an eye sees it that looks at its middle.
fn ball_from(eye: DVec3, size: UVec2) -> MirrorPicture {
    let sight_of = sights(eye, size);
    let pixel = |index: u32| {
        let sight = sight_of(DVec2::new(f64::from(index % size.x), f64::from(index / size.x)) + 0.5);
        let point = on_ball(eye, sight)?;
        let (normal, linear_depth) = (((point + eye) / BALL).as_vec3(), point.length() as f32);
        Some(MirrorPixel { point: point.as_vec3(), normal, toward_eye: -sight.as_vec3(), linear_depth })
    };
    MirrorPicture { size, pixels: (0..size.x * size.y).map(pixel).collect(), right: Vec3::X, up: Vec3::Y }
}

/// Light takes the same way in both directions: Fermat's principle knows no eye.
#[test]
fn an_eye_sees_a_point_where_the_point_would_see_the_eye() {
    let size = UVec2::new(400, 300);
    let settings = Parameters { accuracy: 0.25, ..all_points() };
    let eye = camera().eye;
    /// The walls of the five mirrors, as far as they go in front of the eye.
    fn seen_from(eye: DVec3) -> Bounds {
        let world = Bounds { min: walls().min + camera().eye, max: walls().max + camera().eye };
        Bounds { min: world.min - eye, max: world.max.max(camera().eye) - eye }
    }
    let reflected = |from: DVec3, picture: &MirrorPicture, point: DVec3| {
        let bundles = Bundles::new(picture, &settings, seen_from(from), 2.5);
        let roots = bundles.roots(point - from, RADIUS.into());
        assert!(roots.len() <= 1, "a ball reflects each point once: {roots:?}");
        roots.first().map(|root| from + on_ball(from, sights(from, size)(root.at)).unwrap_or(DVec3::NAN))
    };
    let of_eye = ball_from(eye, size);
    let mut apart = Vec::new();
    for point in wall_points(24).into_iter().map(|point| point.as_dvec3() + eye) {
        let there = reflected(eye, &of_eye, point);
        let back = reflected(point, &ball_from(point, size), eye);
        let Some((there, back)) = there.zip(back) else { continue };
        apart.push(there.distance(back));
    }
    // A pixel is about a hundredth wide on the ball; the rim is seen at a slant.
    let (found, middle, most) = (apart.len(), quantile(apart.clone(), 0.5), quantile(apart, 0.9));
    assert!(found > 10 && middle < 0.003 && most < 0.012, "{found} points, {middle} {most}");
}

/// The distances of both foci of a narrow bundle of rays that a curved mirror reflects (Coddington 1829): that in the
/// plane of incidence, and that across it. Below 0: behind the mirror. The radius is above 0 on a ball seen from outside,
/// and below 0 on one seen from inside.
fn coddington(eye_distance: f64, radius: f64, cosine: f64) -> [f64; 2] {
    [-1.0 / eye_distance - 2.0 / (radius * cosine), -1.0 / eye_distance - 2.0 * cosine / radius]
        .map(|power| 1.0 / power)
}

/// The foci of all exact bundles of a picture against those of Coddington: by how much they are off, relative to them.
/// `meets` says where a line of sight meets the mirror, relative to the eye.
fn foci_off(
    bundles: &Bundles,
    eye: DVec3,
    size: UVec2,
    radius: f64,
    meets: impl Fn(DVec3) -> Option<DVec3>,
) -> Vec<f64> {
    let sight_of = sights(eye, size);
    let mut errors = Vec::new();
    for leaf in bundles.leaves.iter().filter(|leaf| leaf.is_exact) {
        let sight = sight_of(leaf.center);
        let Some(point) = meets(sight) else { continue };
        let cosine = -sight.dot((point + eye) / radius);
        // The plane of incidence and that across it are one in the middle, and the rim bends without end.
        if !(0.3..0.98).contains(&cosine) {
            continue;
        }
        let (_, mut found) = leaf.foci(leaf.center, point);
        let mut truth = coddington(point.length(), radius, cosine);
        found.sort_by(f64::total_cmp);
        truth.sort_by(f64::total_cmp);
        errors.extend(found.iter().zip(truth).map(|(found, truth)| (found / truth - 1.0).abs()));
    }
    errors
}

#[test]
fn rays_of_a_ball_meet_in_the_foci_of_coddington() {
    let eye = camera().eye;
    let size = UVec2::new(400, 300);
    let picture = ball_from(eye, size);
    let settings = Parameters { degree: 3, accuracy: 0.25, ..all_points() };
    let bundles = Bundles::new(&picture, &settings, walls(), 2.5);
    let errors = foci_off(&bundles, eye, size, BALL, |sight| on_ball(eye, sight));
    let (count, median, most) = (errors.len(), quantile(errors.clone(), 0.5), quantile(errors, 0.95));
    assert!(count > 200 && median < 0.01 && most < 0.05, "{count} foci: {median} {most}");
}

/// Seen from inside, the rays of a ball meet in front of it.
#[test]
fn rays_of_a_hollow_ball_meet_in_the_foci_of_coddington() {
    // Nearer to the middle than to the wall, and not in the middle, where all rays come back.
    let eye = DVec3::new(0.1, -0.2, 0.15);
    let size = UVec2::new(400, 300);
    let inside = |sight: DVec3| {
        let along = -eye.dot(sight);
        Some(sight * (along + (BALL * BALL - (eye.length_squared() - along * along)).sqrt()))
    };
    let sight_of = sights(eye, size);
    let pixel = |index: u32| {
        let sight = sight_of(DVec2::new(f64::from(index % size.x), f64::from(index / size.x)) + 0.5);
        let point = inside(sight)?;
        let (normal, linear_depth) = ((-(point + eye) / BALL).as_vec3(), point.length() as f32);
        Some(MirrorPixel { point: point.as_vec3(), normal, toward_eye: -sight.as_vec3(), linear_depth })
    };
    let pixels = (0..size.x * size.y).map(pixel).collect();
    let picture = MirrorPicture { size, pixels, right: Vec3::X, up: Vec3::Y };
    let settings = Parameters { degree: 3, accuracy: 0.25, judged_by: JudgedBy::Ray, ..all_points() };
    let room = Bounds { min: DVec3::splat(-BALL) - eye, max: DVec3::splat(BALL) - eye };
    let bundles = Bundles::new(&picture, &settings, room, BALL);
    let errors = foci_off(&bundles, eye, size, -BALL, inside);
    let (count, median, most) = (errors.len(), quantile(errors.clone(), 0.5), quantile(errors, 0.95));
    assert!(count > 50 && median < 0.001 && most < 0.02, "{count} foci: {median} {most}");
}

/// A paraboloid takes rays along its axis to its focus: both foci of each bundle lie there.
#[test]
fn rays_along_the_axis_of_a_paraboloid_meet_in_its_focus() {
    let (focal_length, height) = (0.4, 2.0);
    let size = UVec2::new(160, 160);
    let pixel = |index: u32| {
        let at = DVec2::new(f64::from(index % size.x), f64::from(index / size.x)) + 0.5 - size.as_dvec2() * 0.5;
        let across = DVec2::new(at.x, -at.y) / 160.0;
        let point = across.extend(across.length_squared() / (4.0 * focal_length) - height);
        let normal = (across * (-0.5 / focal_length)).extend(1.0).normalize().as_vec3();
        let pixel = MirrorPixel { point: point.as_vec3(), normal, toward_eye: Vec3::Z, linear_depth: -point.z as f32 };
        Some(pixel)
    };
    let picture =
        MirrorPicture { size, pixels: (0..size.x * size.y).map(pixel).collect(), right: Vec3::X, up: Vec3::Y };
    let settings = Parameters { judged_by: JudgedBy::Ray, largest_square: 16, ..all_points() };
    let room = Bounds { min: DVec3::splat(-2.0), max: DVec3::splat(2.0) };
    let bundles = Bundles::new(&picture, &settings, room, 2.5);
    let focus = DVec3::new(0.0, 0.0, focal_length - height);
    let mut errors = Vec::new();
    for leaf in bundles.leaves.iter().filter(|leaf| leaf.is_exact) {
        let middle = leaf.center.as_uvec2();
        // Four pixels meet in the middle of a square.
        let point = picture.pixels[(middle.y * size.x + middle.x) as usize].unwrap().point.as_dvec3();
        let (_, found) = leaf.foci(leaf.center + 0.5, point);
        errors.extend(found.map(|found| (found / point.distance(focus) - 1.0).abs()));
    }
    let (count, most) = (errors.len(), quantile(errors, 0.99));
    assert!(count > 100 && most < 0.02, "{count} foci: {most}");
}

/// Reflected rays stay across a surface (Malus and Dupin), so that both foci are real: where none are, pixels of several
/// surfaces or noise were taken for one bundle.
#[test]
fn neighbouring_rays_of_exact_mirrors_have_real_foci() {
    for mirror in [Variant::Sphere, Variant::Parabolic, Variant::Blob, Variant::Torus] {
        let picture = picture(mirror, UVec2::new(200, 150));
        let settings = Parameters { judged_by: JudgedBy::Ray, accuracy: 0.25, ..all_points() };
        let bundles = Bundles::new(&picture, &settings, walls(), 2.5);
        let share = |leaf: &super::twin::Leaf| leaf.foci(leaf.center, DVec3::ZERO).0;
        let shares: Vec<f64> = bundles.leaves.iter().filter(|leaf| leaf.is_exact).map(share).collect();
        let (count, least) = (shares.len(), -quantile(shares.iter().map(|share| -share).collect(), 0.99));
        assert!(count > 40 && least > -0.01, "{mirror:?}: {count} bundles, {least}");
    }
    // A picture whose normals are turned about the line of sight, by an angle that grows across it: no surface has
    // such normals, and the test says so.
    let mut twisted = picture(Variant::Sphere, UVec2::new(200, 150));
    for pixel in twisted.pixels.iter_mut().flatten() {
        let turn = 6.0 * Vec3::new(pixel.point.y, -pixel.point.x, 0.0);
        pixel.normal = (pixel.normal + turn).normalize();
    }
    let settings = Parameters { judged_by: JudgedBy::Ray, ..all_points() };
    let bundles = Bundles::new(&twisted, &settings, walls(), 2.5);
    let shares: Vec<f64> = bundles.leaves.iter().map(|leaf| leaf.foci(leaf.center, DVec3::ZERO).0).collect();
    assert!(quantile(shares.clone(), 0.2) < -0.01, "{:?}", quantile(shares, 0.2));
}
