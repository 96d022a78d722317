//! The CPU twin of shaders/screen_trace.wgsl: rays through the camera's picture.

use std::cell::Cell;

use super::depth_walk::{
    Answer, Choices, Linear, Picture, Ray, Texel, Walk, coordinates, exit_of, leaf, sides_of, walk,
};

/// Marks the pixels whose surface is seen edge-on, as in shaders/shared/hit.wgsl.
const EDGE_ON: u32 = 0x8000_0000;
/// The number of the pixel without the marks of that file.
const PIXEL_NUMBER: u32 = 0x1fff_ffff;
/// How far beside a disc of the layer behind its plane counts, in pixels.
const BACK_SLACK: f32 = 0.5;

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rule {
    Plane,
    /// All that it is behind, as published, as are the following.
    Behind,
    /// What it is behind by no more than this.
    Thickness(f32),
    /// What it is between a layer and the one behind.
    Layers,
}

/// The layers of what the camera sees.
pub(super) struct Layers {
    pub front: Picture,
    pub back: Option<Picture>,
    /// Whether the layer behind may have something before it.
    pub hides_more: bool,
}

/// What a walk has found, and whether what the ray meets is in the layer behind.
pub(super) struct ScreenWalk {
    pub walk: Walk,
    pub is_in_back: bool,
}

/// What a ray has come through so far.
#[derive(Clone, Copy)]
struct Way {
    is_between: bool,
    is_in_back: bool,
    /// Where it first passed behind something that may hide more.
    passed_behind: f32,
}

fn texel(picture: &Picture, at: [i32; 2]) -> &Texel {
    &picture.texels[(at[1] * picture.view.size[0] as i32 + at[0]) as usize]
}

impl Layers {
    /// Walks a ray through what the camera sees. The mirror's own surface does not stop it before `own`, and nothing
    /// nearer than `near` to the camera is in the picture. No other method continues it.
    pub fn walk(&self, ray: &Ray, own: f32, near: f32, rule: Rule, choices: Choices) -> ScreenWalk {
        let view = &self.front.view;
        let depth = coordinates(view, ray).depth;
        let is_within = sides_of(view, ray).iter().all(|(within, _)| within.at(own) >= 0.0) && depth.at(own) > near;
        let (exit, side) = exit_of(view, ray);
        let nearest = (near - depth.at_zero) / depth.slope;
        let comes_nearer = depth.slope < 0.0 && nearest < exit;
        let (exit, leaves) = if comes_nearer { (nearest, true) } else { (exit, side.is_some()) };
        if !is_within || exit <= own {
            return ScreenWalk { walk: Walk { answer: Answer::Hidden(0.0), cells: 0 }, is_in_back: false };
        }
        let way = Cell::new(Way { is_between: false, is_in_back: false, passed_behind: f32::MAX });
        let walked = walk(&self.front, ray, [own, exit], true, choices, |_, ray, at, part, starts, choices| {
            let mut so_far = way.get();
            let said = match rule {
                Rule::Plane => self.by_plane(&mut so_far, ray, at, part, starts, choices),
                _ => self.by_depth(&mut so_far, rule, depth, ray, at, part),
            };
            way.set(so_far);
            said
        });
        let Way { is_in_back, passed_behind, .. } = way.get();
        let answer = match walked.answer {
            Answer::Hit { t, identity } if !is_in_back => Answer::Hit { t, identity: identity & PIXEL_NUMBER },
            Answer::Open if !leaves && passed_behind == f32::MAX => Answer::Open,
            Answer::Hit { .. } => walked.answer,
            Answer::Open | Answer::Hidden(_) => {
                let free = if let Answer::Hidden(t) = walked.answer { t } else { exit }.min(passed_behind);
                // The picture says nothing about the ray's beginning.
                Answer::Hidden(if free > own { free } else { 0.0 })
            }
        };
        ScreenWalk { walk: Walk { answer, ..walked }, is_in_back }
    }

    fn by_plane(
        &self,
        way: &mut Way,
        ray: &Ray,
        at: [i32; 2],
        part: [f32; 2],
        starts: bool,
        choices: Choices,
    ) -> Option<Answer> {
        let is_edge_on = texel(&self.front, at).identity & EDGE_ON != 0;
        let mut said = None;
        // A ray may begin on a surface that is seen edge-on.
        let is_its_own = starts && is_edge_on;
        if !way.is_between && !is_its_own {
            said = leaf(&self.front, ray, at, part, starts, choices).map(|said| match said {
                // Where such a surface is met is not known, nor where one that hides the ray's beginning is.
                Answer::Hit { t, .. } if is_edge_on || starts && t <= part[0] => Answer::Hidden(t),
                said => said,
            });
        }
        if let (Some(Answer::Hidden(t)), true) = (said, self.back.is_some()) {
            way.is_between = true;
            if self.hides_more {
                way.passed_behind = way.passed_behind.min(t);
            }
        }
        match &self.back {
            Some(back) if way.is_between => self.between(back, way, ray, at, part, starts, choices),
            _ => said,
        }
    }

    /// What the two layers say about a ray between them.
    fn between(
        &self,
        back: &Picture,
        way: &mut Way,
        ray: &Ray,
        at: [i32; 2],
        part: [f32; 2],
        starts: bool,
        choices: Choices,
    ) -> Option<Answer> {
        let (view, front) = (&self.front.view, texel(&self.front, at));
        let height = Linear {
            at_zero: front.normal.dot(ray.origin - view.center) - view.plane(front, at[0] as u32, at[1] as u32),
            slope: front.normal.dot(ray.direction),
        };
        let [before, after] = part.map(|t| height.at(t));
        let said = if front.depth == 0.0 || before >= 0.0 {
            // The ray comes out beside an outline.
            way.is_between = false;
            leaf(&self.front, ray, at, part, false, choices)
        } else if after > 0.0 {
            // The ray meets the nearest surface from behind.
            let t = part[0] + (part[1] - part[0]) * before / (before - after);
            Some(Answer::Hit { t, identity: front.identity })
        } else {
            let by_disc = Choices { disc_slack: BACK_SLACK, ..choices };
            let said = leaf(back, ray, at, part, starts, by_disc);
            way.is_in_back = matches!(said, Some(Answer::Hit { .. }));
            said
        };
        match said {
            Some(Answer::Hit { .. }) if !way.is_in_back && front.identity & EDGE_ON != 0 => {
                Some(Answer::Hidden(part[0]))
            }
            said => said,
        }
    }

    fn by_depth(
        &self,
        way: &mut Way,
        rule: Rule,
        along: Linear,
        ray: &Ray,
        at: [i32; 2],
        part: [f32; 2],
    ) -> Option<Answer> {
        let front = texel(&self.front, at);
        let [enters, leaves] = part.map(|t| along.at(t));
        let back = self.back.as_ref().filter(|_| rule == Rule::Layers).map(|back| texel(back, at));
        let back = back.filter(|back| back.depth != 0.0);
        let end = match rule {
            Rule::Thickness(thickness) => front.depth + thickness,
            _ => back.map_or(f32::MAX, |back| back.depth),
        };
        if front.depth == 0.0 || enters.max(leaves) <= front.depth {
            return None;
        }
        if enters.min(leaves) >= end {
            way.passed_behind = way.passed_behind.min(part[0]);
            return None;
        }
        // Where it gets behind the pixel, or before the end of what it shows.
        let border = if enters < front.depth { front.depth } else { enters.min(end) };
        let way_there = if border == enters { 0.0 } else { (border - enters) / along.slope };
        let t = (part[0] + way_there).clamp(part[0], part[1]);
        // The back side is shown where it is nearer to the ray, and faces it.
        let met = along.at(t);
        let nearer = back.filter(|_| (met - front.depth).abs() > (met - end).abs());
        let shown = nearer.filter(|back| ray.direction.dot(back.normal) > 0.0);
        way.is_in_back = shown.is_some();
        Some(Answer::Hit { t, identity: shown.unwrap_or(front).identity })
    }
}
