//! The CPU twin of shaders/screen_trace.wgsl: rays through the camera's picture.

use super::depth_walk::{Answer, Choices, Picture, Ray, Walk, coordinates, exit_of, leaf, sides_of, walk};

/// Marks the pixels whose surface is seen edge-on, as in shaders/shared/hit.wgsl.
const EDGE_ON: u32 = 0x8000_0000;
/// The number of the pixel without the marks of that file.
const PIXEL_NUMBER: u32 = 0x1fff_ffff;

/// Walks a ray through what the camera sees. The mirror's own surface does not stop it before `own`, and nothing nearer
/// than `near` to the camera is in the picture. No other method continues it.
pub(super) fn walk_screen(picture: &Picture, ray: &Ray, own: f32, near: f32, choices: Choices) -> Walk {
    let view = &picture.view;
    let depth = coordinates(view, ray).depth;
    let is_within = sides_of(view, ray).iter().all(|(within, _)| within.at(own) >= 0.0) && depth.at(own) > near;
    let (exit, side) = exit_of(view, ray);
    let nearest = (near - depth.at_zero) / depth.slope;
    let comes_nearer = depth.slope < 0.0 && nearest < exit;
    let (exit, leaves) = if comes_nearer { (nearest, true) } else { (exit, side.is_some()) };
    if !is_within || exit <= own {
        return Walk { answer: Answer::Hidden(0.0), cells: 0 };
    }
    let walked = walk(picture, ray, [own, exit], true, choices, |picture, ray, at, part, starts, choices| {
        let texel = &picture.texels[(at[1] * view.size[0] as i32 + at[0]) as usize];
        // A ray may begin on a surface that is seen edge-on.
        if starts && texel.identity & EDGE_ON != 0 {
            return None;
        }
        let said = leaf(picture, ray, at, part, starts, choices);
        // Where a surface is met that hides the ray's beginning is not known.
        said.map(|said| match said {
            Answer::Hit { t, .. } if starts && t <= part[0] => Answer::Hidden(t),
            said => said,
        })
    });
    let answer = match walked.answer {
        Answer::Open if leaves => Answer::Hidden(exit),
        Answer::Hit { t, identity } if identity & EDGE_ON != 0 => Answer::Hidden(t),
        // The picture says nothing about the ray's beginning.
        Answer::Hidden(t) if t <= own => Answer::Hidden(0.0),
        Answer::Hit { t, identity } => Answer::Hit { t, identity: identity & PIXEL_NUMBER },
        answer => answer,
    };
    Walk { answer, ..walked }
}
