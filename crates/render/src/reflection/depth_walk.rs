//! The CPU twin of shaders/shared/depth_walk.wgsl: rays through a picture of depths.
//!
//! A ray crosses the texels of a picture in order. Each texel is the plane of the disc that it shows, and the ray
//! either stays in front of it, meets it, or is hidden behind it, which the picture cannot tell more about.

use glam::{Vec2, Vec3};

/// From where, and how, the picture shows the scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    pub center: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    /// Texels along the edge.
    pub size: u32,
    /// Texels per unit of tangent.
    pub focal: f32,
}

/// A texel: the disc that it shows.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Texel {
    pub identity: u32,
    /// The linear depth of the disc's plane at the texel's middle; 0: nothing is there.
    pub depth: f32,
    /// Toward the view's centre, or along the line of sight where the disc has none or is seen edge-on.
    pub normal: Vec3,
    /// The disc's radius over the width of a texel at this depth.
    pub radius: f32,
    /// The disc's middle from the texel's middle, in texels.
    pub middle: Vec2,
}

/// The linear depths between which the planes of a cell's texels lie.
pub(super) type Bounds = [f32; 2];

/// A picture with its bounds, level by level from the texels on; each level halves the one before, rounded up.
pub(super) struct Picture {
    pub view: View,
    pub texels: Vec<Texel>,
    /// Level 1 first.
    pub levels: Vec<(u32, Vec<Bounds>)>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Choices {
    pub skip: bool,
    /// Depth steps up to this many texels are within one surface.
    pub jump: f32,
    /// How far beside its disc a plane counts, in texels.
    pub disc_slack: f32,
}

/// What the pictures say about a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Answer {
    Hit {
        t: f32,
        identity: u32,
    },
    /// The ray is free as far as it was asked for.
    Open,
    /// The ray is free up to this distance, and what comes after is not known.
    Hidden(f32),
}

/// A surface seen at a smaller angle than this sine has no slope that its depth would tell.
pub(super) const LEAST_COSINE: f32 = 0.16;
/// By how much bounds are widened, so that rounding never skips what a texel would have decided.
const MARGIN: f32 = 1e-5;

/// More cells than a ray can cross in the largest picture.
const MOST_CELLS: u32 = 8192;
/// The faces that a ray crosses are at most four; it may touch others at their corners.
const MOST_FACES: usize = 6;
/// How often a ray may change to another cube.
const MOST_ROUNDS: u32 = 8;

/// A linear function of the distance along the ray.
#[derive(Clone, Copy)]
struct Linear {
    at_zero: f32,
    slope: f32,
}

impl Linear {
    fn at(self, t: f32) -> f32 {
        self.at_zero + self.slope * t
    }

    /// Where it is zero.
    fn root(self) -> f32 {
        -self.at_zero / self.slope
    }
}

impl View {
    /// The line of sight at a place of the picture, in texels, with a linear depth of 1.
    fn sight(&self, x: f32, y: f32) -> Vec3 {
        let half = 0.5 * self.size as f32;
        self.forward + self.right * ((x - half) / self.focal) - self.up * ((y - half) / self.focal)
    }

    /// The product of a plane's normal with its places less the centre.
    fn plane(&self, texel: &Texel, x: u32, y: u32) -> f32 {
        texel.normal.dot(self.sight(x as f32 + 0.5, y as f32 + 0.5)) * texel.depth
    }
}

impl Picture {
    pub fn new(view: View, texels: Vec<Texel>) -> Self {
        let size = view.size;
        assert_eq!(texels.len(), (size * size) as usize);
        let of_texel = |x: u32, y: u32| {
            let texel = &texels[(y * size + x) as usize];
            if texel.depth == 0.0 {
                return [f32::MAX; 2];
            }
            let plane = view.plane(texel, x, y);
            let corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[dx, dy]| {
                let cosine = texel.normal.dot(view.sight((x + dx) as f32, (y + dy) as f32));
                if cosine < 0.0 { plane / cosine } else { f32::MAX }
            });
            let least = corners.into_iter().fold(f32::MAX, f32::min);
            let most = corners.into_iter().fold(0.0, f32::max);
            [least * (1.0 - MARGIN), if most < f32::MAX { most * (1.0 + MARGIN) } else { most }]
        };
        let mut levels: Vec<(u32, Vec<Bounds>)> = Vec::new();
        let mut edge = size;
        while edge > 1 {
            let finer = edge;
            edge = edge.div_ceil(2);
            let bounds = |x: u32, y: u32| match levels.last() {
                None => of_texel(x, y),
                Some((_, cells)) => cells[(y * finer + x) as usize],
            };
            let cell = |i: u32| {
                let (x, y) = (i % edge * 2, i / edge * 2);
                let inside = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[dx, dy]| [x + dx, y + dy]);
                let inside = inside.into_iter().filter(|at| at.iter().all(|at| *at < finer));
                inside.fold([f32::MAX, 0.0_f32], |[least, most], [x, y]| {
                    let [low, high] = bounds(x, y);
                    [least.min(low), most.max(high)]
                })
            };
            let cells = (0..edge * edge).map(cell).collect();
            levels.push((edge, cells));
        }
        Self { view, texels, levels }
    }
}

/// A ray with what of it the walk has yet to find out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub origin: Vec3,
    /// Unit length.
    pub direction: Vec3,
    /// Up to here it is known to be free.
    pub from: f32,
    /// Beyond it nothing is asked for.
    pub to: f32,
}

/// What walking one picture has told.
#[derive(Clone, Copy, Debug)]
struct Walk {
    answer: Answer,
    /// The cells that were looked at.
    cells: u32,
}

/// The sides of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Side {
    Left,
    Right,
    Above,
    Below,
}

/// Where a ray leaves what a picture shows, and through which side; no side if it ends within.
fn exit_of(view: &View, ray: &Ray) -> (f32, Option<Side>) {
    let [across, down, depth] = coordinates(view, ray);
    let size = view.size as f32;
    let over = |value: Linear| Linear {
        at_zero: size * depth.at_zero - value.at_zero,
        slope: size * depth.slope - value.slope,
    };
    // Each is not negative within the picture.
    let sides = [(across, Side::Left), (over(across), Side::Right), (down, Side::Above), (over(down), Side::Below)];
    let mut exit = (ray.to, None);
    for (within, side) in sides {
        if within.slope < 0.0 && within.root() < exit.0 {
            exit = (within.root(), Some(side));
        }
    }
    exit
}

/// The face that sees a direction: that of its largest part.
fn face_toward(direction: Vec3) -> usize {
    let parts = direction.abs();
    let axis = if parts.y > parts.x && parts.y >= parts.z {
        1
    } else if parts.z > parts.x {
        2
    } else {
        0
    };
    axis + if direction[axis] < 0.0 { 3 } else { 0 }
}

/// The face into which a ray goes through a side of a face: those to the left and right look along the axis after its
/// own, those above and below along the next one.
fn face_beside(face: usize, side: Side) -> usize {
    let axis = (face + if matches!(side, Side::Left | Side::Right) { 1 } else { 2 }) % 3;
    axis + if matches!(side, Side::Right | Side::Above) { 0 } else { 3 }
}

/// The ray's place in texels across and down, each times its linear depth; and that depth.
fn coordinates(view: &View, ray: &Ray) -> [Linear; 3] {
    let offset = ray.origin - view.center;
    let along = |axis: Vec3| Linear { at_zero: axis.dot(offset), slope: axis.dot(ray.direction) };
    let [p, q, w] = [view.right, view.up, view.forward].map(along);
    let half = 0.5 * view.size as f32;
    let place = |part: Linear, sign: f32| Linear {
        at_zero: half * w.at_zero + sign * view.focal * part.at_zero,
        slope: half * w.slope + sign * view.focal * part.slope,
    };
    [place(p, 1.0), place(q, -1.0), w]
}

/// One axis of the picture: when the ray crosses its integer borders.
struct Axis {
    value: Linear,
    depth: Linear,
    /// 1, -1, or 0 for a ray that stays where it is.
    step: i32,
}

impl Axis {
    fn new(value: Linear, depth: Linear) -> Self {
        let turn = value.slope * depth.at_zero - value.at_zero * depth.slope;
        Self {
            value,
            depth,
            step: if turn > 0.0 {
                1
            } else if turn < 0.0 {
                -1
            } else {
                0
            },
        }
    }

    fn crossing(&self, border: i32) -> f32 {
        let border = border as f32;
        let slope = self.value.slope - border * self.depth.slope;
        // A ray may come ever nearer to a border without reaching it.
        let reaches = slope * self.step as f32 > 0.0;
        if reaches { (border * self.depth.at_zero - self.value.at_zero) / slope } else { f32::MAX }
    }

    /// The border through which the ray leaves the cell `cell` of edge `edge`, and when.
    fn exit(&self, cell: i32, edge: i32, size: i32) -> (i32, f32) {
        let border = if self.step > 0 { ((cell + 1) * edge).min(size) } else { cell * edge };
        (border, self.crossing(border))
    }

    /// The texel that contains the ray at `t`, within a cell: the same that stepping texel by texel finds. `is_first`
    /// says that this axis steps first where both borders are crossed at once.
    fn texel_at(&self, t: f32, cell: i32, edge: i32, size: i32, is_first: bool) -> i32 {
        let (low, high) = (cell * edge, ((cell + 1) * edge).min(size) - 1);
        let mut texel = ((self.value.at(t) / self.depth.at(t)).floor() as i32).clamp(low, high);
        let is_past = |border: i32| {
            let crossing = self.crossing(border);
            crossing < t || is_first && crossing == t
        };
        if self.step > 0 {
            if texel > low && !is_past(texel) {
                texel -= 1;
            }
            if texel < high && is_past(texel + 1) {
                texel += 1;
            }
        } else if self.step < 0 {
            if texel < high && !is_past(texel + 1) {
                texel += 1;
            }
            if texel > low && is_past(texel) {
                texel -= 1;
            }
        }
        texel
    }
}

/// Walks the part `part` of a ray through a picture. `starts` says that the ray begins there, so that the picture may
/// say nothing about it.
fn walk(picture: &Picture, ray: &Ray, part: [f32; 2], mut starts: bool, choices: Choices) -> Walk {
    let view = &picture.view;
    let size = view.size as i32;
    let [across, down, depth] = coordinates(view, ray);
    let axes = [Axis::new(across, depth), Axis::new(down, depth)];
    let mut t = part[0];
    let texel_of = |value: Linear| ((value.at(t) / depth.at(t)).floor() as i32).clamp(0, size - 1);
    let mut at = [texel_of(across), texel_of(down)];
    let mut level = 0;
    let mut cells = 0;
    loop {
        cells += 1;
        let edge = 1 << level;
        let cell = at.map(|at| at >> level);
        let exits = [0, 1].map(|axis| axes[axis].exit(cell[axis], edge, size));
        let out = exits[0].1.min(exits[1].1).min(part[1]).max(t);
        if level > 0 {
            let (count, bounds) = &picture.levels[level - 1];
            let [nearest, _] = bounds[(cell[1] * *count as i32 + cell[0]) as usize];
            if depth.at(t).max(depth.at(out)) >= nearest {
                level -= 1;
                continue;
            }
        } else if let Some(answer) = leaf(picture, ray, at, [t, out], starts, choices) {
            return Walk { answer, cells };
        }
        starts = false;
        if out >= part[1] {
            return Walk { answer: Answer::Open, cells };
        }
        if cells > MOST_CELLS {
            return Walk { answer: Answer::Hidden(t), cells };
        }
        let first = usize::from(exits[1].1 < exits[0].1);
        let other = 1 - first;
        // Before the border is crossed, because that changes the cell.
        at[other] = axes[other].texel_at(out, cell[other], edge, size, first == 1);
        at[first] = if axes[first].step > 0 { exits[first].0 } else { exits[first].0 - 1 };
        t = out;
        if choices.skip {
            level = (level + 1).min(picture.levels.len());
        }
    }
}

/// What a texel says about the ray between two distances; `None` if the ray goes on.
fn leaf(
    picture: &Picture,
    ray: &Ray,
    at: [i32; 2],
    [t_in, t_out]: [f32; 2],
    starts: bool,
    choices: Choices,
) -> Option<Answer> {
    let view = &picture.view;
    let texel = &picture.texels[(at[1] * view.size as i32 + at[0]) as usize];
    if texel.depth == 0.0 {
        return None;
    }
    let plane = view.plane(texel, at[0] as u32, at[1] as u32);
    let height =
        Linear { at_zero: texel.normal.dot(ray.origin - view.center) - plane, slope: texel.normal.dot(ray.direction) };
    let width = texel.depth / view.focal;
    let radius = texel.radius * width;
    let [before, after] = [t_in, t_out].map(|t| height.at(t));
    if starts && before <= -0.5 * choices.jump * width {
        return Some(Answer::Hidden(t_in));
    }
    let is_before = before >= 0.0;
    // Behind a plane, but not far: a step within one surface.
    let is_crack = !is_before && -before <= choices.jump * width + 0.02 * radius;
    if after > 0.0 && (is_before || is_crack) {
        return None;
    }
    if !is_before && !is_crack {
        return Some(Answer::Hidden(t_in));
    }
    let t = if is_before { t_in + (t_out - t_in) * before / (before - after).max(1e-30) } else { t_in };
    let middle = Vec2::new(at[0] as f32, at[1] as f32) + 0.5 + texel.middle;
    let sight = view.sight(middle.x, middle.y);
    let middle = view.center + sight * (plane / texel.normal.dot(sight));
    let beside = (ray.origin + ray.direction * t).distance(middle);
    // The surface on which the ray begins does not stop it.
    let counts = t > 4.0 * radius && beside <= radius + choices.disc_slack * width;
    Some(if counts { Answer::Hit { t, identity: texel.identity } } else { Answer::Hidden(t_in) })
}

/// Walks a ray through the six faces of a cube, of which it crosses at most four. Returns the answer and the number of
/// cells.
pub(super) fn walk_cube(faces: &[Picture; 6], ray: &Ray, choices: Choices) -> (Answer, u32) {
    let mut t = ray.from;
    let mut face = face_toward(ray.origin + ray.direction * t - faces[0].view.center);
    let mut cells = 0;
    let mut starts = true;
    for _ in 0..MOST_FACES {
        let (exit, side) = exit_of(&faces[face].view, ray);
        if exit > t {
            let walked = walk(&faces[face], ray, [t, exit], starts, choices);
            cells += walked.cells;
            starts = false;
            t = exit;
            if walked.answer != Answer::Open {
                return (walked.answer, cells);
            }
        }
        let Some(side) = side else { return (Answer::Open, cells) };
        face = face_beside(face, side);
    }
    // A ray right through a corner of the cube or its middle.
    (Answer::Hidden(t), cells)
}

/// Walks a ray through several cubes, the nearest to its origin first: where one cannot see on, the others may.
pub(super) fn relay(cubes: &[[Picture; 6]], ray: &Ray, tries: usize, choices: Choices) -> (Answer, u32) {
    let mut order: Vec<usize> = (0..cubes.len()).collect();
    let distance = |cube: usize| cubes[cube][0].view.center.distance_squared(ray.origin);
    order.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
    order.truncate(tries);
    let mut ray = *ray;
    let mut cells = 0;
    let mut last = usize::MAX;
    'rounds: for _ in 0..MOST_ROUNDS {
        for cube in &order {
            if *cube == last {
                continue;
            }
            let (answer, walked) = walk_cube(&cubes[*cube], &ray, choices);
            cells += walked;
            match answer {
                Answer::Hidden(t) if t > ray.from => {
                    (ray.from, last) = (t, *cube);
                    continue 'rounds;
                }
                Answer::Hidden(_) => {}
                answer => return (answer, cells),
            }
        }
        break;
    }
    (Answer::Hidden(ray.from), cells)
}

#[cfg(test)]
mod tests {
    use glam::Quat;
    use proptest::prelude::*;

    use super::*;

    const CHOICES: Choices = Choices { skip: true, jump: 1.0, disc_slack: 0.5 };

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
        View { center, right: axis(1), up: axis(2), forward, size, focal: 0.5 * size as f32 }
    }

    /// A face as the GPU draws it: `seen` returns what a line of sight meets: identity, distance along it, normal,
    /// radius and middle.
    fn picture(view: View, seen: impl Fn(Vec3) -> Option<(u32, f32, Vec3, f32, Vec3)>) -> Picture {
        let texel = |i: u32| {
            let (x, y) = (i % view.size, i / view.size);
            let sight = view.sight(x as f32 + 0.5, y as f32 + 0.5);
            let Some((identity, depth, normal, radius, middle)) = seen(sight) else { return Texel::default() };
            let cosine = normal.dot(sight.normalize());
            let toward = if cosine > 0.0 { -normal } else { normal };
            let normal = if cosine.abs() < LEAST_COSINE { -sight.normalize() } else { toward };
            let offset = middle - view.center;
            let depth_there = view.forward.dot(offset);
            let across = view.right.dot(offset) / depth_there * view.focal + 0.5 * view.size as f32;
            let down = 0.5 * view.size as f32 - view.up.dot(offset) / depth_there * view.focal;
            let middle = Vec2::new(across - x as f32 - 0.5, down - y as f32 - 0.5);
            Texel { identity, depth, normal, radius: radius / (depth / view.focal), middle }
        };
        Picture::new(view, (0..view.size * view.size).map(texel).collect())
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
                    assert_eq!(bounds.len() as u32, count * count);
                    for (i, texel) in face.texels.iter().enumerate().filter(|(_, texel)| texel.depth > 0.0) {
                        let [x, y] = [i as u32 % size, i as u32 / size];
                        let cell = (y >> (level + 1)) * count + (x >> (level + 1));
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
}
