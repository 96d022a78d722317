//! The CPU twin of the published searches of shaders/cubemap_trace.wgsl and shaders/shared/cubemaps.wgsl: a texel has one
//! depth, a ray is sampled in each texel, by equal steps or by equal angles, and each map is walked from the ray's
//! beginning.

use std::cell::Cell;

use glam::Vec3;
use scene::{CubeHit, CubeSampling};

use super::depth_walk::{
    Answer, Axis, Choices, Criterion, Linear, Picture, Ray, coordinates, face_toward, nearest_first, walk_cube,
};

/// What of the parameters concerns the published searches.
#[derive(Clone, Copy, Debug)]
pub(super) struct Search {
    pub sampling: CubeSampling,
    pub hit: CubeHit,
    /// In world units.
    pub step: f32,
    /// In radians.
    pub angle: f32,
    pub refine: u32,
    /// How far samples reach.
    pub reach: f32,
    /// Where nothing is near enough, a change of sign counts.
    pub then_sign: bool,
}

/// What a texel says about the part of a ray that crosses it; `None` if the ray goes on.
pub(super) fn flat_leaf(
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
    let width = view.width(texel.depth);
    let behind = Linear {
        at_zero: view.forward.dot(ray.origin - view.center) - texel.depth,
        slope: view.forward.dot(ray.direction),
    };
    let [enters, leaves] = [t_in, t_out].map(|t| behind.at(t));
    let (depth, is_within, meets);
    if let Criterion::Threshold(threshold) = choices.criterion {
        depth = if enters < 0.0 { -threshold } else { threshold };
        is_within = enters.abs() <= threshold;
        meets = is_within || (enters < depth && leaves >= depth) || (enters > depth && leaves <= depth);
        // The ray ends behind the texel.
        if !meets && leaves > threshold && t_out >= ray.to {
            return Some(Answer::Hidden(t_in));
        }
    } else {
        (depth, is_within, meets) = (0.0, enters > 0.0, leaves > 0.0);
        if starts && enters > 0.5 * choices.jump * width {
            return Some(Answer::Hidden(t_in));
        }
    }
    let change = if leaves == enters { 1.0 } else { leaves - enters };
    let t = if is_within { t_in } else { t_in + (t_out - t_in) * ((depth - enters) / change) };
    // The surface on which the ray begins does not stop it.
    (meets && t > 4.0 * texel.radius * width).then_some(Answer::Hit { t, identity: texel.identity })
}

/// What a texel says by the change of either sign: as [`flat_leaf`], but a ray whose beginning is hidden goes on until
/// it comes out. `inside` is the point behind which it is.
pub(super) fn come_out(
    inside: &Cell<Option<u32>>,
    picture: &Picture,
    ray: &Ray,
    at: [i32; 2],
    part: [f32; 2],
    starts: bool,
    choices: Choices,
) -> Option<Answer> {
    let view = &picture.view;
    let texel = &picture.texels[(at[1] * view.size[0] as i32 + at[0]) as usize];
    let said = inside.get().is_none().then(|| flat_leaf(picture, ray, at, part, starts, choices)).flatten();
    if starts && matches!(said, Some(Answer::Hidden(_))) {
        inside.set(Some(texel.identity));
    }
    let Some(last) = inside.get() else { return said };
    let [enters, leaves] = part.map(|t| view.forward.dot(ray.origin + ray.direction * t - view.center) - texel.depth);
    let is_behind = texel.depth != 0.0 && enters > 0.0;
    let identity = if is_behind { texel.identity } else { last };
    inside.set(Some(identity));
    if texel.depth != 0.0 && leaves > 0.0 {
        return None;
    }
    inside.set(None);
    let change = if leaves == enters { 1.0 } else { leaves - enters };
    Some(Answer::Hit { t: if is_behind { part[0] - (part[1] - part[0]) * enters / change } else { part[0] }, identity })
}

/// Walks a ray through several cubes, each from its beginning: the first hit counts, or the nearest.
pub(super) fn through_each(
    cubes: &[[Picture; 6]],
    ray: &Ray,
    tries: usize,
    choices: Choices,
    search: Search,
) -> (Answer, u32) {
    let mut found = Answer::Hidden(0.0);
    let mut cells = 0;
    for cube in nearest_first(cubes, ray, tries) {
        let mut through = |choices: Choices| {
            let (answer, walked) = if search.sampling == CubeSampling::Texel || choices.criterion == Criterion::Plane {
                walk_cube(&cubes[cube], ray, choices)
            } else {
                through_samples(&cubes[cube], ray, choices, search)
            };
            cells += walked;
            answer
        };
        let mut answer = through(choices);
        if search.then_sign && !matches!(answer, Answer::Hit { .. }) {
            answer = through(Choices { criterion: Criterion::Sign, ..choices });
        }
        found =
            match (found, answer) {
                (Answer::Hit { t: a, identity: one }, Answer::Hit { t: b, identity: other }) => {
                    if (b, other) < (a, one) { answer } else { found }
                }
                (_, Answer::Hit { .. }) | (Answer::Hidden(_), Answer::Open) => answer,
                (Answer::Hidden(a), Answer::Hidden(b)) if b > a => answer,
                _ => found,
            };
        if search.hit != CubeHit::Nearest && !matches!(answer, Answer::Hidden(_)) {
            break;
        }
    }
    if matches!(found, Answer::Hidden(_)) && choices.criterion != Criterion::Plane {
        // Nothing is proven.
        found = Answer::Hidden(ray.from);
    }
    (found, cells)
}

/// The face and the texel in the direction `offset` from a cube's middle.
fn texel_toward(faces: &[Picture; 6], offset: Vec3) -> (&Picture, [i32; 2]) {
    let picture = &faces[face_toward(offset)];
    let view = &picture.view;
    let slope = [view.right.dot(offset), -view.up.dot(offset)].map(|part| part / view.forward.dot(offset));
    let place = [0, 1].map(|axis| 0.5 * view.size[axis] as f32 + view.focal * slope[axis]);
    (picture, [0, 1].map(|axis| (place[axis].floor() as i32).clamp(0, view.size[axis] as i32 - 1)))
}

/// By how much a place lies behind its texel's depth; the texel's identity; up to which distance from its origin a ray
/// does not meet it.
fn sample(faces: &[Picture; 6], offset: Vec3) -> (f32, u32, f32) {
    let (picture, at) = texel_toward(faces, offset);
    let texel = &picture.texels[(at[1] * picture.view.size[0] as i32 + at[0]) as usize];
    if texel.depth == 0.0 {
        return (-f32::MAX, u32::MAX, 0.0);
    }
    let behind = picture.view.forward.dot(offset) - texel.depth;
    (behind, texel.identity, 4.0 * texel.radius * picture.view.width(texel.depth))
}

/// Compares the ray's depth with that of the texel at each sample.
fn through_samples(faces: &[Picture; 6], ray: &Ray, choices: Choices, search: Search) -> (Answer, u32) {
    let center = faces[0].view.center;
    let foot = (center - ray.origin).dot(ray.direction);
    let beside = center.distance(ray.origin + ray.direction * foot).max(1e-6);
    let first_angle = (-foot / beside).atan();
    let half_turn = 1.5706;
    let is_by_angle = search.sampling == CubeSampling::Angle;
    let place = |i: u32| {
        let angle = first_angle + i as f32 * search.angle;
        match is_by_angle {
            true if angle >= half_turn => f32::MAX,
            true => foot + beside * angle.tan(),
            false => i as f32 * search.step,
        }
    };
    let index_before = |t: f32| {
        let by_angle = (((t - foot) / beside).atan() - first_angle) / search.angle - 0.01;
        (if is_by_angle { by_angle } else { t / search.step }).clamp(0.0, 1e6) as u32
    };
    let offset_at = |t: f32| ray.origin + ray.direction * t - center;
    let refined = |mut before: f32, mut after: f32| {
        let mut height = sample(faces, offset_at(before)).0;
        let mut last = sample(faces, offset_at(after));
        let mut t = after;
        for _ in 0..search.refine {
            t = before + (after - before) * (height / (height - last.0));
            let here = sample(faces, offset_at(t));
            if here.0 > 0.0 { (after, last) = (t, here) } else { (before, height) = (t, here.0) }
        }
        (t, last.1)
    };
    let end = ray.to.min(search.reach);
    let is_either = choices.criterion == Criterion::SignEither;
    let is_sign = is_either || choices.criterion == Criterion::Sign;
    let threshold = choices.threshold();
    let (mut level, mut i, mut cells, mut is_behind) = (0, 1, 0, false);
    loop {
        let t = place(i);
        cells += 1;
        if t > end || cells > 8 * choices.most_cells {
            return (if is_behind { Answer::Hidden(ray.from) } else { Answer::Open }, cells);
        }
        if level > 0 {
            let (picture, at) = texel_toward(faces, offset_at(t));
            let (count, bounds) = &picture.levels[level - 1];
            let cell = at.map(|at| at >> level);
            let along = coordinates(&picture.view, ray);
            let exits = [(along.across, 0), (along.down, 1)].map(|(value, axis)| {
                let size = picture.view.size[axis] as i32;
                Axis::new(value, along.divisor).exit(cell[axis], 1 << level, size).1
            });
            let out = exits[0].min(exits[1]).min(end).max(t);
            let depths = [t, out].map(|t| along.depth.at(t));
            let [nearest, farthest] = bounds[(cell[1] * count[0] as i32 + cell[0]) as usize];
            let lies_behind = depths[0].min(depths[1]) > farthest + threshold;
            let is_before = depths[0].max(depths[1]) < nearest - threshold && !(is_either && is_behind);
            if is_before || (lies_behind && (is_behind || !is_sign)) {
                is_behind = lies_behind;
                i = (i + 1).max(index_before(out));
                level = choices.level_above(level, picture.levels.len());
            } else {
                level = choices.level_below(level);
            }
            continue;
        }
        let (behind, identity, own) = sample(faces, offset_at(t));
        let was_behind = std::mem::replace(&mut is_behind, behind > 0.0);
        let met = match (is_sign, behind.abs() <= threshold) {
            (true, _) if i == 1 || is_behind == was_behind => None,
            (true, _) if is_behind => Some(refined(place(i - 1), t)),
            (true, _) => is_either.then(|| refined(t, place(i - 1))),
            (false, is_near) => is_near.then_some((t, identity)),
        };
        if let Some((t, identity)) = met.filter(|met| met.0 > own) {
            return (Answer::Hit { t, identity }, cells);
        }
        i += 1;
        if choices.skip {
            level = choices.level_above(0, faces[0].levels.len());
        }
    }
}
