//! The walk against walls and discs in closed form.

use glam::Quat;
use proptest::prelude::*;

use super::*;

const CHOICES: Choices = Choices { skip: true, jump: 1.0, disc_slack: 0.5, most_cells: MOST_CELLS };

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
