//! The CPU twin of shaders/shared/depth_walk.wgsl: rays through a picture of depths.
//!
//! A ray crosses the texels of a picture in order. Each texel is the plane of the disc that it shows, and the ray
//! either stays in front of it, meets it, or is hidden behind it, which the picture shows no more of.

#[cfg(test)]
mod tests;

use glam::{Vec2, Vec3};

use super::depth_search::{come_out, flat_leaf};

/// From where, and how, the picture shows the scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    pub center: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    /// Texels across and down.
    pub size: [u32; 2],
    /// Texels per unit of tangent; of a parallel picture, per world unit.
    pub focal: f32,
    pub is_parallel: bool,
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
    /// Level 1 first, with the number of cells across and down.
    pub levels: Vec<([u32; 2], Vec<Bounds>)>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Choices {
    pub skip: bool,
    /// Depth steps up to this many texels are within one surface.
    pub jump: f32,
    /// How far beside its disc a plane counts, in texels.
    pub disc_slack: f32,
    /// After so many the ray is given up.
    pub most_cells: u32,
    /// The finest and the coarsest level of bounds that is used.
    pub levels: [usize; 2],
    pub criterion: Criterion,
}

/// When a ray meets what a texel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Criterion {
    Plane,
    /// A ray meets a texel where it goes behind the texel's depth.
    Sign,
    /// As published: a ray meets a texel where it goes behind the texel's depth, or comes out from behind it.
    SignEither,
    /// A ray meets a texel where it is that near to the texel's depth.
    Threshold(f32),
}

impl Choices {
    pub const DEFAULT: Self = Self {
        skip: true,
        jump: 1.0,
        disc_slack: 0.5,
        most_cells: MOST_CELLS,
        levels: [0, 31],
        criterion: Criterion::Plane,
    };

    pub fn threshold(self) -> f32 {
        if let Criterion::Threshold(threshold) = self.criterion { threshold } else { 0.0 }
    }

    /// Whether a part of a ray with these depths at its ends meets nothing in a cell with these bounds.
    fn passes(self, [nearest, farthest]: Bounds, depths: [f32; 2], goes_on: bool) -> bool {
        let is_before = depths[0].max(depths[1]) < nearest - self.threshold();
        let is_behind = depths[0].min(depths[1]) > farthest + self.threshold();
        is_before || (matches!(self.criterion, Criterion::Threshold(_)) && goes_on && is_behind)
    }

    pub fn level_below(self, level: usize) -> usize {
        if level <= self.levels[0] { 0 } else { level - 1 }
    }

    pub fn level_above(self, level: usize, count: usize) -> usize {
        let above = (level + 1).max(self.levels[0]);
        if above <= count.min(self.levels[1]) { above } else { level }
    }
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

/// A surface seen at a smaller angle than this sine has no slope that its depth would show.
pub(super) const LEAST_COSINE: f32 = 0.16;
/// By how much bounds are widened, so that rounding never skips what a texel would have decided.
const MARGIN: f32 = 1e-5;

/// More cells than a ray can cross in the largest picture.
pub(super) const MOST_CELLS: u32 = 8192;
/// The faces that a ray crosses are at most four; it may touch others at their corners.
const MOST_FACES: usize = 6;
/// How often a ray may change to another cube.
const MOST_ROUNDS: u32 = 8;

/// A linear function of the distance along the ray.
#[derive(Clone, Copy)]
pub(super) struct Linear {
    pub at_zero: f32,
    pub slope: f32,
}

impl Linear {
    pub fn at(self, t: f32) -> f32 {
        self.at_zero + self.slope * t
    }

    /// Where it is zero.
    pub fn root(self) -> f32 {
        -self.at_zero / self.slope
    }
}

impl View {
    /// The line of sight at a place of the picture, in texels: its place at a linear depth of 0, relative to the centre,
    /// and its way to a depth of 1 more.
    pub fn sight(&self, x: f32, y: f32) -> [Vec3; 2] {
        let half = self.size.map(|size| 0.5 * size as f32);
        let (across, down) = (self.right * ((x - half[0]) / self.focal), self.up * ((y - half[1]) / self.focal));
        if self.is_parallel { [across - down, self.forward] } else { [Vec3::ZERO, self.forward + across - down] }
    }

    /// The product of a plane's normal with its places less the centre.
    pub fn plane(&self, texel: &Texel, x: u32, y: u32) -> f32 {
        let [origin, direction] = self.sight(x as f32 + 0.5, y as f32 + 0.5);
        texel.normal.dot(origin) + texel.normal.dot(direction) * texel.depth
    }

    /// The width of a texel at a depth.
    pub fn width(&self, depth: f32) -> f32 {
        if self.is_parallel { 1.0 / self.focal } else { depth / self.focal }
    }
}

impl Picture {
    pub fn new(view: View, texels: Vec<Texel>) -> Self {
        let [columns, rows] = view.size;
        assert_eq!(texels.len(), (columns * rows) as usize);
        let of_texel = |x: u32, y: u32| {
            let texel = &texels[(y * columns + x) as usize];
            if texel.depth == 0.0 {
                return [f32::MAX; 2];
            }
            let plane = view.plane(texel, x, y);
            let corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[dx, dy]| {
                let [origin, direction] = view.sight((x + dx) as f32, (y + dy) as f32);
                let cosine = texel.normal.dot(direction);
                if cosine < 0.0 { (plane - texel.normal.dot(origin)) / cosine } else { f32::MAX }
            });
            let least = corners.into_iter().fold(f32::MAX, f32::min);
            let most = corners.into_iter().fold(0.0, f32::max);
            [least * (1.0 - MARGIN), if most < f32::MAX { most * (1.0 + MARGIN) } else { most }]
        };
        let mut levels: Vec<([u32; 2], Vec<Bounds>)> = Vec::new();
        let mut edges = view.size;
        while edges != [1; 2] {
            let finer = edges;
            edges = edges.map(|edge| edge.div_ceil(2));
            let bounds = |x: u32, y: u32| match levels.last() {
                None => of_texel(x, y),
                Some((_, cells)) => cells[(y * finer[0] + x) as usize],
            };
            let cell = |i: u32| {
                let (x, y) = (i % edges[0] * 2, i / edges[0] * 2);
                let inside = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[dx, dy]| [x + dx, y + dy]);
                let inside = inside.into_iter().filter(|[x, y]| *x < finer[0] && *y < finer[1]);
                inside.fold([f32::MAX, 0.0_f32], |[least, most], [x, y]| {
                    let [low, high] = bounds(x, y);
                    [least.min(low), most.max(high)]
                })
            };
            let cells = (0..edges[0] * edges[1]).map(cell).collect();
            levels.push((edges, cells));
        }
        Self { view, texels, levels }
    }
}

/// A record of a texel, as shaders/shared/depth_texel.wgsl reads it.
pub(super) fn texel_of([identity, depth, normal_radius, middle]: [u32; 4]) -> Texel {
    let part = |word: u32| (word & 2047) as f32 / 2047.0 * 2.0 - 1.0;
    let folded = Vec2::new(part(normal_radius), part(normal_radius >> 11));
    let z = 1.0 - folded.x.abs() - folded.y.abs();
    let turned = (1.0 - Vec2::new(folded.y, folded.x).abs()) * Vec2::ONE.copysign(folded);
    let flat = if z >= 0.0 { folded } else { turned };
    Texel {
        identity,
        depth: f32::from_bits(depth),
        normal: flat.extend(z).normalize(),
        radius: ((normal_radius >> 22) as f32 / 64.0 - 8.0).exp2(),
        middle: Vec2::new(f32::from(middle as u16 as i16), f32::from((middle >> 16) as u16 as i16)) / 32.0,
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

/// What walking one picture has found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    pub answer: Answer,
    /// The cells that were looked at.
    pub cells: u32,
}

/// The sides of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Side {
    Left,
    Right,
    Above,
    Below,
}

/// The sides of a picture, each with a function that is not negative within it.
pub(super) fn sides_of(view: &View, ray: &Ray) -> [(Linear, Side); 4] {
    let Coordinates { across, down, divisor, .. } = coordinates(view, ray);
    let over = |value: Linear, size: u32| Linear {
        at_zero: size as f32 * divisor.at_zero - value.at_zero,
        slope: size as f32 * divisor.slope - value.slope,
    };
    [
        (across, Side::Left),
        (over(across, view.size[0]), Side::Right),
        (down, Side::Above),
        (over(down, view.size[1]), Side::Below),
    ]
}

/// Where a ray leaves what a picture shows, and through which side; no side if it ends within.
pub(super) fn exit_of(view: &View, ray: &Ray) -> (f32, Option<Side>) {
    let mut exit = (ray.to, None);
    for (within, side) in sides_of(view, ray) {
        if within.slope < 0.0 && within.root() < exit.0 {
            exit = (within.root(), Some(side));
        }
    }
    exit
}

/// The face that sees a direction: that of its largest part.
pub(super) fn face_toward(direction: Vec3) -> usize {
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

/// A ray along its way.
pub(super) struct Coordinates {
    /// The place of the ray in texels, each times the divisor.
    pub across: Linear,
    pub down: Linear,
    /// The linear depth; 1 in a parallel picture.
    pub divisor: Linear,
    pub depth: Linear,
}

pub(super) fn coordinates(view: &View, ray: &Ray) -> Coordinates {
    let offset = ray.origin - view.center;
    let along = |axis: Vec3| Linear { at_zero: axis.dot(offset), slope: axis.dot(ray.direction) };
    let [p, q, depth] = [view.right, view.up, view.forward].map(along);
    let divisor = if view.is_parallel { Linear { at_zero: 1.0, slope: 0.0 } } else { depth };
    let half = view.size.map(|size| 0.5 * size as f32);
    let place = |part: Linear, half: f32, sign: f32| Linear {
        at_zero: half * divisor.at_zero + sign * view.focal * part.at_zero,
        slope: half * divisor.slope + sign * view.focal * part.slope,
    };
    Coordinates { across: place(p, half[0], 1.0), down: place(q, half[1], -1.0), divisor, depth }
}

/// One axis of the picture: when the ray crosses its integer borders.
pub(super) struct Axis {
    value: Linear,
    divisor: Linear,
    /// 1, -1, or 0 for a ray that stays where it is.
    step: i32,
}

impl Axis {
    pub fn new(value: Linear, divisor: Linear) -> Self {
        let turn = value.slope * divisor.at_zero - value.at_zero * divisor.slope;
        Self {
            value,
            divisor,
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
        let slope = self.value.slope - border * self.divisor.slope;
        // A ray may come ever nearer to a border without reaching it.
        let reaches = slope * self.step as f32 > 0.0;
        if reaches { (border * self.divisor.at_zero - self.value.at_zero) / slope } else { f32::MAX }
    }

    /// The border through which the ray leaves the cell `cell` of edge `edge`, and when.
    pub fn exit(&self, cell: i32, edge: i32, size: i32) -> (i32, f32) {
        let border = if self.step > 0 { ((cell + 1) * edge).min(size) } else { cell * edge };
        (border, self.crossing(border))
    }

    /// The texel that contains the ray at `t`, within a cell: the same that stepping texel by texel finds. `is_first`
    /// says that this axis steps first where both borders are crossed at once.
    fn texel_at(&self, t: f32, cell: i32, edge: i32, size: i32, is_first: bool) -> i32 {
        let (low, high) = (cell * edge, ((cell + 1) * edge).min(size) - 1);
        let mut texel = ((self.value.at(t) / self.divisor.at(t)).floor() as i32).clamp(low, high);
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
/// say nothing about it. `leaf` decides what a texel says, like the function of this name.
pub(super) fn walk(
    picture: &Picture,
    ray: &Ray,
    part: [f32; 2],
    mut starts: bool,
    choices: Choices,
    leaf: impl Fn(&Picture, &Ray, [i32; 2], [f32; 2], bool, Choices) -> Option<Answer>,
) -> Walk {
    let view = &picture.view;
    let size = view.size.map(|size| size as i32);
    let Coordinates { across, down, divisor, depth } = coordinates(view, ray);
    let axes = [Axis::new(across, divisor), Axis::new(down, divisor)];
    let mut t = part[0];
    // A ray that begins at the centre is in one texel, which its direction decides.
    let has_depth = divisor.at(t) != 0.0;
    let place = |value: Linear| if has_depth { value.at(t) / divisor.at(t) } else { value.slope / divisor.slope };
    let texel_of = |value: Linear, size: i32| (place(value).floor() as i32).clamp(0, size - 1);
    let mut at = [texel_of(across, size[0]), texel_of(down, size[1])];
    let mut level = 0;
    let mut cells = 0;
    loop {
        cells += 1;
        let edge = 1 << level;
        let cell = at.map(|at| at >> level);
        let exits = [0, 1].map(|axis| axes[axis].exit(cell[axis], edge, size[axis]));
        let out = exits[0].1.min(exits[1].1).min(part[1]).max(t);
        if level > 0 {
            let (count, bounds) = &picture.levels[level - 1];
            let bounds = bounds[(cell[1] * count[0] as i32 + cell[0]) as usize];
            if !choices.passes(bounds, [depth.at(t), depth.at(out)], out < ray.to) {
                level = choices.level_below(level);
                continue;
            }
        } else if let Some(answer) = leaf(picture, ray, at, [t, out], starts, choices) {
            return Walk { answer, cells };
        }
        starts = false;
        if out >= part[1] {
            return Walk { answer: Answer::Open, cells };
        }
        if cells > choices.most_cells {
            return Walk { answer: Answer::Hidden(t), cells };
        }
        let first = usize::from(exits[1].1 < exits[0].1);
        let other = 1 - first;
        // Before the border is crossed, because that changes the cell.
        at[other] = axes[other].texel_at(out, cell[other], edge, size[other], first == 1);
        at[first] = if axes[first].step > 0 { exits[first].0 } else { exits[first].0 - 1 };
        t = out;
        if choices.skip {
            level = choices.level_above(level, picture.levels.len());
        }
    }
}

/// What a texel says about the ray between two distances; `None` if the ray goes on.
pub(super) fn leaf(
    picture: &Picture,
    ray: &Ray,
    at: [i32; 2],
    [t_in, t_out]: [f32; 2],
    starts: bool,
    choices: Choices,
) -> Option<Answer> {
    let view = &picture.view;
    let texel = &picture.texels[(at[1] * view.size[0] as i32 + at[0]) as usize];
    if texel.depth == 0.0 {
        return None;
    }
    let plane = view.plane(texel, at[0] as u32, at[1] as u32);
    let height =
        Linear { at_zero: texel.normal.dot(ray.origin - view.center) - plane, slope: texel.normal.dot(ray.direction) };
    let width = view.width(texel.depth);
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
    let [origin, direction] = view.sight(middle.x, middle.y);
    let depth = (plane - texel.normal.dot(origin)) / texel.normal.dot(direction);
    let middle = view.center + origin + direction * depth;
    let beside = (ray.origin + ray.direction * t).distance(middle);
    // The surface on which the ray begins does not stop it.
    let counts = t > 4.0 * radius && beside <= radius + choices.disc_slack * width;
    Some(if counts { Answer::Hit { t, identity: texel.identity } } else { Answer::Hidden(t_in) })
}

/// Walks a ray through the six faces of a cube. Returns the answer and the number of cells.
pub(super) fn walk_cube(faces: &[Picture; 6], ray: &Ray, choices: Choices) -> (Answer, u32) {
    if choices.criterion == Criterion::SignEither {
        return either_sign(faces, ray, choices);
    }
    through_faces(faces, ray, choices, if choices.criterion == Criterion::Plane { leaf } else { flat_leaf })
}

/// Walks a ray through a cube by the change of either sign. No cell is passed unseen.
fn either_sign(faces: &[Picture; 6], ray: &Ray, choices: Choices) -> (Answer, u32) {
    let inside = std::cell::Cell::new(None);
    let choices = Choices { skip: false, ..choices };
    let (answer, cells) = through_faces(faces, ray, choices, |picture, ray, at, part, starts, choices| {
        come_out(&inside, picture, ray, at, part, starts, choices)
    });
    (if answer == Answer::Open && inside.get().is_some() { Answer::Hidden(ray.from) } else { answer }, cells)
}

/// Walks a ray through the faces of a cube, of which it crosses at most four; `says` is what a texel says.
fn through_faces(
    faces: &[Picture; 6],
    ray: &Ray,
    choices: Choices,
    says: impl Fn(&Picture, &Ray, [i32; 2], [f32; 2], bool, Choices) -> Option<Answer>,
) -> (Answer, u32) {
    let mut t = ray.from;
    let offset = ray.origin + ray.direction * t - faces[0].view.center;
    let mut face = face_toward(if offset == Vec3::ZERO { ray.direction } else { offset });
    let mut cells = 0;
    let mut starts = true;
    for _ in 0..MOST_FACES {
        let (exit, side) = exit_of(&faces[face].view, ray);
        if exit > t {
            let walked = walk(&faces[face], ray, [t, exit], starts, choices, &says);
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

/// The cubes in the order of their distance from a ray's origin.
pub(super) fn nearest_first(cubes: &[[Picture; 6]], ray: &Ray, tries: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..cubes.len()).collect();
    let distance = |cube: usize| cubes[cube][0].view.center.distance_squared(ray.origin);
    order.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
    order.truncate(tries);
    order
}

/// Walks a ray through several cubes, the nearest to its origin first: where one cannot see on, the others may.
pub(super) fn relay(cubes: &[[Picture; 6]], ray: &Ray, tries: usize, choices: Choices) -> (Answer, u32) {
    let order = nearest_first(cubes, ray, tries);
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
