//! The walk against walls and discs in closed form.

use glam::Quat;
use proptest::prelude::*;
use scene::{CubeHit, CubeSampling};

use super::super::depth_search::{Search, through_each};
use super::*;

const CHOICES: Choices = Choices::DEFAULT;

/// A disc of the scenes of these tests.
#[derive(Clone, Copy, Debug)]
struct Disc {
    middle: Vec3,
    normal: Vec3,
    radius: f32,
}

impl Disc {
    fn hit(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        let t = self.normal.dot(self.middle - origin) / self.normal.dot(direction);
        let beside = (origin + direction * t).distance(self.middle);
        (t > 4.0 * self.radius && beside <= self.radius).then_some(t)
    }
}

fn face(center: Vec3, face: usize, size: u32) -> View {
    let axis = |index: usize| Vec3::AXES[(face + index) % 3];
    let forward = if face < 3 { axis(0) } else { -axis(0) };
    View { center, right: axis(1), up: axis(2), forward, size: [size; 2], focal: 0.5 * size as f32, is_parallel: false }
}

/// A face as the GPU draws it: `seen` returns what a line of sight meets: identity, distance along it, normal,
/// radius and middle.
fn picture(view: View, seen: impl Fn(Vec3) -> Option<(u32, f32, Vec3, f32, Vec3)>) -> Picture {
    let texel = |i: u32| {
        let (x, y) = (i % view.size[0], i / view.size[0]);
        let [_, sight] = view.sight(x as f32 + 0.5, y as f32 + 0.5);
        let Some((identity, depth, normal, radius, middle)) = seen(sight) else { return Texel::default() };
        let cosine = normal.dot(sight.normalize());
        let toward = if cosine > 0.0 { -normal } else { normal };
        let normal = if cosine.abs() < LEAST_COSINE { -sight.normalize() } else { toward };
        let offset = middle - view.center;
        let depth_there = view.forward.dot(offset);
        let across = view.right.dot(offset) / depth_there * view.focal + 0.5 * view.size[0] as f32;
        let down = 0.5 * view.size[0] as f32 - view.up.dot(offset) / depth_there * view.focal;
        let middle = Vec2::new(across - x as f32 - 0.5, down - y as f32 - 0.5);
        Texel { identity, depth, normal, radius: radius / (depth / view.focal), middle }
    };
    Picture::new(view, (0..view.size[0] * view.size[1]).map(texel).collect())
}

fn cube(center: Vec3, size: u32, seen: impl Fn(Vec3) -> Option<(u32, f32, Vec3, f32, Vec3)>) -> [Picture; 6] {
    [0, 1, 2, 3, 4, 5].map(|index| picture(face(center, index, size), &seen))
}

/// Six walls at 1 from the origin, as planes without end.
fn box_cube(center: Vec3, size: u32) -> [Picture; 6] {
    cube(center, size, |sight| {
        let wall = (0..6).map(|wall| {
            let axis = wall % 3;
            let outward = if wall < 3 { Vec3::AXES[axis] } else { -Vec3::AXES[axis] };
            (wall, (1.0 - outward.dot(center)) / outward.dot(sight), outward)
        });
        let (wall, depth, outward) = wall.filter(|wall| wall.1 > 0.0).min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        Some((wall as u32, depth, outward, 0.0, center + sight * depth))
    })
}

fn discs_cube(center: Vec3, size: u32, discs: &[Disc]) -> [Picture; 6] {
    cube(center, size, |sight| {
        let hits = discs.iter().enumerate().filter_map(|(index, disc)| {
            let t = disc.normal.dot(disc.middle - center) / disc.normal.dot(sight);
            let beside = (center + sight * t).distance(disc.middle);
            (t > 0.0 && beside <= disc.radius).then_some((index, t, disc))
        });
        let (index, depth, disc) = hits.min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some((index as u32, depth, disc.normal, disc.radius, disc.middle))
    })
}

fn unit(angle: f32, height: f32) -> Vec3 {
    let flat = (1.0 - height * height).max(0.0).sqrt();
    Vec3::new(flat * angle.cos(), flat * angle.sin(), height)
}

/// Numbers from 0 to 1 that follow from a seed.
fn random(seed: u32) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    move || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
        ((word >> 22) ^ word) as f32 / 4_294_967_296.0
    }
}

fn ray(next: &mut impl FnMut() -> f32, extent: f32) -> Ray {
    let origin = Vec3::new(next() - 0.5, next() - 0.5, next() - 0.5) * extent;
    let direction = unit(next() * std::f32::consts::TAU, next() * 2.0 - 1.0);
    Ray { origin, direction, from: 0.0, to: 1e30 }
}

#[test]
fn a_box_of_walls_is_met_where_it_is() {
    let mut next = random(1);
    let choices = Choices { disc_slack: 1000.0, ..CHOICES };
    let mut left_out = 0;
    for _ in 0..20 {
        let center = Vec3::new(next() - 0.5, next() - 0.5, next() - 0.5) * 1.6;
        let size = [16, 33, 128][(next() * 2.99) as usize];
        let cube = box_cube(center, size);
        for _ in 0..500 {
            let ray = ray(&mut next, 1.9);
            let exits = (ray.direction.signum() - ray.origin) / ray.direction;
            let exact = exits.min_element();
            // The nearest edge of the box to the end of the ray, as seen from the centre of the cube.
            let end = ray.origin + ray.direction * exact;
            let mut parts = (Vec3::ONE - end.abs()).to_array();
            parts.sort_by(f32::total_cmp);
            let texels = parts[1] * 0.5 * size as f32 / end.distance(center) / 3.0;
            // A wall that a texel sees edge-on has no slope there.
            let wall = exits.to_array().iter().position(|exit| *exit == exact).unwrap();
            let is_steep = (end - center).normalize()[wall].abs() < 2.0 * LEAST_COSINE;
            let (answer, _) = walk_cube(&cube, &ray, choices);
            match answer {
                Answer::Hit { t, .. } if texels > 1.0 && !is_steep => {
                    assert!((t - exact).abs() < 2e-5 * (1.0 + exact), "{t}, not {exact}: {center} {ray:?}");
                }
                // A texel on an edge shows one of its walls alone.
                _ if texels <= 1.0 || is_steep => left_out += 1,
                other => panic!("{other:?}, not {exact}: {center} {size} {ray:?}"),
            }
        }
    }
    assert!(left_out < 6000, "{left_out} of 10,000");
}

fn scene(next: &mut impl FnMut() -> f32, count: usize) -> Vec<Disc> {
    let mut disc = || Disc {
        middle: unit(next() * std::f32::consts::TAU, next() * 2.0 - 1.0) * (0.6 + 2.0 * next()),
        normal: unit(next() * std::f32::consts::TAU, next() * 2.0 - 1.0),
        radius: 0.02 + 0.3 * next() * next(),
    };
    (0..count).map(|_| disc()).collect()
}

#[test]
fn what_bounds_skip_changes_no_answer() {
    let mut next = random(2);
    for size in [1, 2, 16, 17, 100, 255] {
        let discs = scene(&mut next, 60);
        let cubes = [[0.1, 0.0, 0.0], [-0.1, 0.1, 0.0]].map(|center| discs_cube(center.into(), size, &discs));
        let mut walked = [0, 0];
        for _ in 0..2000 {
            let ray = ray(&mut next, 0.4);
            let answers = [true, false].map(|skip| relay(&cubes, &ray, 2, Choices { skip, ..CHOICES }));
            assert_eq!(answers[0].0, answers[1].0, "{size}: {ray:?}");
            (0..2).for_each(|i| walked[i] += answers[i].1);
        }
        assert!(size < 100 || walked[0] * 2 < walked[1], "{size}: {walked:?} cells");
    }
}

/// The published searches: by sign and by threshold, in each texel, at equal steps and at equal angles.
fn searches() -> impl Iterator<Item = (Criterion, Search)> {
    let search = |sampling, then_sign| Search {
        sampling,
        hit: CubeHit::Nearest,
        step: 0.01,
        angle: 0.01,
        refine: 2,
        reach: 8.0,
        then_sign,
    };
    [CubeSampling::Texel, CubeSampling::Step, CubeSampling::Angle].into_iter().flat_map(move |sampling| {
        [
            (Criterion::Sign, search(sampling, false)),
            (Criterion::SignEither, search(sampling, false)),
            (Criterion::Threshold(0.015), search(sampling, false)),
            (Criterion::Threshold(0.015), search(sampling, true)),
        ]
    })
}

#[test]
fn no_criterion_sampling_or_range_of_levels_depends_on_what_is_skipped() {
    // Of 300 rays each, for pictures of a texel, of 17 and of 100 a side; the searches are those of `searches()`.
    const HITS: [[i32; 12]; 3] = [
        [18, 20, 15, 21, 14, 22, 11, 21, 21, 18, 7, 16],
        [40, 41, 12, 47, 38, 30, 17, 28, 29, 42, 8, 33],
        [32, 40, 10, 33, 42, 28, 12, 26, 34, 31, 3, 27],
    ];
    let mut next = random(5);
    let mut counted = Vec::new();
    for size in [1, 17, 100] {
        let discs = scene(&mut next, 40);
        let cubes = [[0.1, 0.0, 0.0], [-0.1, 0.1, 0.0]].map(|center| discs_cube(center.into(), size, &discs));
        for (criterion, search) in searches() {
            let choices = Choices { criterion, ..CHOICES };
            let (mut hits, mut apart) = (0, 0);
            let rays = 300;
            for _ in 0..rays {
                let ray = ray(&mut next, 0.4);
                let expected = through_each(&cubes, &ray, 2, Choices { skip: false, ..choices }, search).0;
                hits += i32::from(matches!(expected, Answer::Hit { .. }));
                for levels in [[0, 31], [2, 3], [4, 31], [9, 10]] {
                    let answer = through_each(&cubes, &ray, 2, Choices { levels, ..choices }, search).0;
                    if search.sampling == CubeSampling::Texel {
                        assert_eq!(answer, expected, "{size} {criterion:?} {search:?} {levels:?}: {ray:?}");
                    }
                    apart += i32::from(answer != expected);
                }
            }
            counted.push(hits);
            // A sample on the border of two cells may count to either.
            assert!(apart * 50 <= rays, "{size} {criterion:?} {search:?}: {apart}");
        }
    }
    assert_eq!(counted, HITS.as_flattened());
}

#[test]
fn the_nearest_hit_does_not_depend_on_the_order_of_the_cubes() {
    let mut next = random(6);
    let discs = scene(&mut next, 60);
    let cubes = |centers: [[f32; 3]; 2]| centers.map(|center| discs_cube(center.into(), 64, &discs));
    let (a, b) = ([0.1, 0.0, 0.0], [-0.1, 0.1, 0.0]);
    let (ordered, turned) = (cubes([a, b]), cubes([b, a]));
    let planes = Search { sampling: CubeSampling::Texel, ..searches().next().unwrap().1 };
    let mut first_differs = 0;
    for (criterion, search) in searches().chain([(Criterion::Plane, planes)]) {
        for _ in 0..300 {
            // Equally far from both.
            let ray = Ray { origin: Vec3::new(0.0, 0.05, 0.3 * next()), ..ray(&mut next, 0.4) };
            let ray = Ray { origin: ray.origin + Vec3::new(0.0, 0.0, 0.1), ..ray };
            let choices = Choices { criterion, ..CHOICES };
            let nearest = [&ordered, &turned].map(|cubes| through_each(cubes, &ray, 2, choices, search).0);
            assert_eq!(nearest[0], nearest[1], "{criterion:?} {search:?}: {ray:?}");
            let first = through_each(&ordered, &ray, 2, choices, Search { hit: CubeHit::First, ..search }).0;
            first_differs += i32::from(first != nearest[0]);
        }
    }
    assert!(first_differs > 20, "{first_differs}");
}

#[test]
fn published_searches_meet_a_wall_within_a_texel_and_a_step() {
    let mut next = random(7);
    let cube = [box_cube(Vec3::new(0.2, -0.1, 0.1), 128)];
    for (criterion, search) in searches() {
        let (mut near, mut rays) = (0, 0);
        for _ in 0..500 {
            let ray = ray(&mut next, 1.2);
            let exact = ((ray.direction.signum() - ray.origin) / ray.direction).min_element();
            let answer = through_each(&cube, &ray, 1, Choices { criterion, ..CHOICES }, search).0;
            rays += 1;
            // A texel at a wall's edge is up to three times as deep as it is wide.
            near += i32::from(matches!(answer, Answer::Hit { t, .. } if (t - exact).abs() < 0.08));
        }
        // Steps beyond the threshold pass through walls that they meet steeply.
        assert!(f64::from(near) > 0.8 * f64::from(rays), "{criterion:?} {search:?}: {near} of {rays}");
    }
}

#[test]
fn cells_hold_the_planes_of_their_texels() {
    let mut next = random(3);
    let discs = scene(&mut next, 60);
    for size in [16, 17, 100] {
        for face in &discs_cube(Vec3::new(0.1, 0.0, -0.1), size, &discs) {
            for (level, (count, bounds)) in face.levels.iter().enumerate() {
                assert_eq!(bounds.len() as u32, count[0] * count[1]);
                for (i, texel) in face.texels.iter().enumerate().filter(|(_, texel)| texel.depth > 0.0) {
                    let [x, y] = [i as u32 % size, i as u32 / size];
                    let cell = (y >> (level + 1)) * count[0] + (x >> (level + 1));
                    let [least, most] = bounds[cell as usize];
                    assert!(least <= texel.depth && texel.depth <= most);
                }
            }
        }
    }
}

/// The texels that a walk asks along a ray through a cube without anything, each with the distances between which the
/// ray is in it.
fn walked_texels(center: Vec3, size: u32, ray: &Ray) -> Vec<(usize, [i32; 2], [f32; 2])> {
    let empty = |index| Picture { view: face(center, index, size), texels: Vec::new(), levels: Vec::new() };
    let faces = [0, 1, 2, 3, 4, 5].map(empty);
    let walked = std::cell::RefCell::new(Vec::new());
    let ask = |picture: &Picture, _: &Ray, at: [i32; 2], part: [f32; 2], _: bool, _: Choices| {
        walked.borrow_mut().push((face_toward(picture.view.forward), at, part));
        None
    };
    let (answer, _) = through_faces(&faces, ray, Choices { skip: false, ..CHOICES }, ask);
    assert!(answer == Answer::Open || walked.borrow().len() < 4 * size as usize, "{answer:?}");
    walked.into_inner()
}

#[test]
fn a_walk_asks_the_texels_that_dense_samples_lie_in() {
    let mut next = random(8);
    let center = Vec3::new(0.2, -0.1, 0.3);
    for size in [1_u32, 2, 16, 17, 100, 255, 256, 1000, 1024] {
        let mut rays: Vec<Ray> = (0..12)
            .map(|_| {
                let ray = ray(&mut next, 1.5);
                Ray { origin: ray.origin + center, ..ray }
            })
            .collect();
        let special = |origin: Vec3, direction: Vec3| Ray {
            origin: center + origin,
            direction: direction.normalize(),
            from: 0.0,
            to: 1e30,
        };
        let border = 2.0 * (size / 3) as f32 / size as f32 - 1.0;
        rays.extend([
            // From the centre, and close by it: of rays within rounding of it, texels say nothing.
            special(Vec3::ZERO, Vec3::new(0.3, 0.7, -0.2)),
            special(Vec3::new(-0.3, -0.7, 0.22), Vec3::new(0.3, 0.7, -0.2)),
            // Along an axis, along a face's diagonal, and along a border of texels.
            special(Vec3::new(0.1, -0.5, 0.2317), Vec3::X),
            special(Vec3::new(0.11, -0.5, 0.1313), Vec3::new(1.0, -1.0, 0.0)),
            special(Vec3::new(0.31, -0.5, border * 0.31), Vec3::Y),
        ]);
        for ray in rays {
            let texels = walked_texels(center, size, &ray);
            let mut faces: Vec<usize> = texels.iter().map(|(face, ..)| *face).collect();
            faces.dedup();
            assert!(faces.len() <= 4, "{size}: {faces:?} {ray:?}");
            // The pieces follow one another.
            assert!(texels.windows(2).all(|pair| pair[0].2[1] <= pair[1].2[0]), "{size}: {ray:?}");
            let foot = (center - ray.origin).dot(ray.direction);
            let beside = center.distance(ray.origin + ray.direction * foot);
            assert!(beside > 1e-5 || faces.len() == 1, "{size}: {faces:?} {ray:?}");
            let angle_of = |t: f32| (t - foot).atan2(beside.max(1e-4));
            let samples = 4000;
            let (first, last) = (angle_of(0.0), std::f32::consts::FRAC_PI_2 - 0.01);
            let step = (last - first) / samples as f32;
            let mut sampled = vec![false; texels.len()];
            for i in 0..samples {
                let t = foot + beside.max(1e-4) * (first + (i as f32 + 0.5) * step).tan();
                let offset = ray.origin + ray.direction * t - center;
                let index = face_toward(offset);
                let view = face(center, index, size);
                let depth = view.forward.dot(offset);
                let half = 0.5 * size as f32;
                let place = [view.right.dot(offset), -view.up.dot(offset)].map(|part| half + half * part / depth);
                // Rounding decides beside a border.
                let near = |place: f32| (place - place.round()).abs() < 2e-6 * size as f32 * (1.0 + 0.5 / depth);
                if depth < 1e-3 || place.into_iter().any(near) {
                    continue;
                }
                let at = place.map(|place| (place.floor() as i32).clamp(0, size as i32 - 1));
                let found = texels.iter().position(|(face, texel, _)| (*face, *texel) == (index, at));
                assert!(found.is_some(), "{size}: {index} {at:?} at {t} is not asked: {ray:?}");
                sampled[found.unwrap_or_default()] = true;
            }
            for ((face, at, [t_in, t_out]), is_sampled) in texels.iter().zip(sampled) {
                let is_long = angle_of(t_out.min(1e6)).min(last) - angle_of(*t_in) > 2.0 * step;
                // A ray along a border is in either of two texels.
                let is_border = ray.direction == Vec3::Y || beside < 1e-5;
                assert!(is_sampled || !is_long || is_border, "{size}: {face} {at:?} is asked in vain: {ray:?}");
            }
        }
    }
}

#[test]
fn a_copy_of_a_cube_changes_nothing_and_one_more_proves_no_less() {
    let mut next = random(9);
    let (mut rays, mut resolved) = (0, [0_i32; 3]);
    for _ in 0..4 {
        let discs = scene(&mut next, 80);
        let centers = [[0.15, 0.0, 0.0], [-0.15, 0.1, 0.0], [0.0, -0.1, 0.15], [0.1, 0.1, -0.1]];
        let draw = |index: usize| discs_cube(centers[index].into(), 128, &discs);
        let (cubes, with_copy) = ([0, 1, 2, 3].map(draw), [0, 0, 1].map(draw));
        for _ in 0..1500 {
            let ray = ray(&mut next, 0.4);
            rays += 1;
            let once = relay(&cubes[..2], &ray, 2, CHOICES).0;
            assert_eq!(relay(&with_copy, &ray, 3, CHOICES).0, once, "{ray:?}");
            for (count, resolved) in (2..).zip(&mut resolved) {
                let answer = relay(&cubes[..count], &ray, count, CHOICES).0;
                *resolved += i32::from(!matches!(answer, Answer::Hidden(_)));
            }
        }
    }
    let share = resolved.map(|resolved| f64::from(resolved) / f64::from(rays));
    assert!(share[0] > 0.8 && share.windows(2).all(|pair| pair[1] > pair[0] - 0.002), "{share:?}");
}

#[test]
fn what_is_proven_is_so() {
    let mut next = random(4);
    let (mut rays, mut wrong, mut resolved, mut missed) = (0, 0, 0, 0);
    for _ in 0..6 {
        let discs = scene(&mut next, 80);
        let centers = [[0.15, 0.0, 0.0], [-0.15, 0.1, 0.0], [0.0, -0.1, 0.15]];
        let cubes = centers.map(|center| discs_cube(center.into(), 200, &discs));
        for _ in 0..2000 {
            let ray = ray(&mut next, 0.4);
            let truth = discs.iter().filter_map(|disc| disc.hit(ray.origin, ray.direction)).min_by(f32::total_cmp);
            rays += 1;
            // The width of a texel three units away.
            let texel = 0.03;
            match relay(&cubes, &ray, 3, CHOICES).0 {
                Answer::Hit { t, .. } => {
                    resolved += 1;
                    wrong += u32::from(truth.is_none_or(|truth| (t - truth).abs() > 0.05 * truth + texel));
                }
                Answer::Open => {
                    resolved += 1;
                    wrong += u32::from(truth.is_some());
                }
                Answer::Hidden(from) => missed += u32::from(truth.is_some_and(|truth| truth < from - texel)),
            }
        }
    }
    let share = |part: u32| f64::from(part) / f64::from(rays);
    let figures = [share(resolved), share(wrong), share(missed)];
    assert!(figures[0] > 0.9 && figures[1] < 0.02 && figures[2] < 0.002, "{figures:?}");
}

proptest! {
    #[test]
    fn any_ray_ends(origin in prop::array::uniform3(-3.0_f32..3.0), turn in prop::array::uniform3(-3.2_f32..3.2),
        axis in 0_usize..3, size in 1_u32..40, from in 0.0_f32..3.0) {
        let turn = Quat::from_euler(glam::EulerRot::XYZ, turn[0], turn[1], turn[2]);
        let cube = box_cube(Vec3::new(0.2, 0.1, -0.3), size);
        for direction in [Vec3::AXES[axis], turn * Vec3::X, Vec3::new(1.0, 1.0, 0.0).normalize()] {
            for origin in [Vec3::from(origin), Vec3::new(0.2, 0.1, -0.3)] {
                let ray = Ray { origin, direction, from, to: 1e30 };
                let (answer, cells) = walk_cube(&cube, &ray, CHOICES);
                prop_assert!(cells <= 4 * (4 * size + 8), "{cells} cells: {answer:?}");
                if let Answer::Hit { t, .. } | Answer::Hidden(t) = answer {
                    prop_assert!(t >= from && t.is_finite());
                }
            }
        }
    }
}
