//! Lines drawn over the picture: the cone of the selected light, the border of the selected clip volume, and the
//! polygon of a prism that is being drawn.

use egui::{Color32, Painter, Stroke};
use glam::DVec3;
use scene::{Clip, SpotLight};

use crate::viewer::input::gizmo::PictureFrame;

/// The number of pieces of a line of the world.
const LINE_STEPS: u32 = 12;
/// The number of pieces of the rim of a light's cone.
const RIM_STEPS: usize = 48;
/// The colour of clip volumes.
const CLIP: Color32 = Color32::from_rgb(0xff, 0xdc, 0x62);

/// Draws a line of the world in pieces, since some may lie behind the eye.
fn world_line(painter: &Painter, stage: &PictureFrame, from: DVec3, to: DVec3, stroke: Stroke) {
    for step in 0..LINE_STEPS {
        let at = |step: u32| stage.place(from.lerp(to, f64::from(step) / f64::from(LINE_STEPS)));
        if let (Some(from), Some(to)) = (at(step), at(step + 1)) {
            painter.line_segment([from, to], stroke);
        }
    }
}

/// Draws the border of a clip volume.
pub fn border(painter: &Painter, stage: &PictureFrame, clip: &Clip) {
    let color = if clip.on { CLIP } else { CLIP.gamma_multiply(0.5) };
    for (width, color) in [(3.0, Color32::from_black_alpha(110)), (1.4, color)] {
        for [from, to] in clip.outline() {
            world_line(painter, stage, from, to, Stroke::new(width, color));
        }
    }
}

/// Draws the corners of a prism that is being drawn, and its sides so far.
pub fn polygon(painter: &Painter, stage: &PictureFrame, corners: &[DVec3]) {
    for sides in corners.windows(2) {
        world_line(painter, stage, sides[0], sides[1], Stroke::new(2.0, CLIP));
    }
    let pointer = painter.ctx().input(|input| input.pointer.latest_pos());
    if let (Some(last), Some(pointer)) = (corners.last().and_then(|corner| stage.place(*corner)), pointer) {
        painter.line_segment([last, pointer], Stroke::new(1.0, CLIP));
    }
    for at in corners.iter().filter_map(|corner| stage.place(*corner)) {
        painter.circle_filled(at, 5.0, Color32::from_black_alpha(160));
        painter.circle_filled(at, 3.5, CLIP);
    }
}

/// Draws the axis of a light, and the rim of its cone at the distance of its target.
pub fn cone(painter: &Painter, stage: &PictureFrame, light: &SpotLight, color: Color32) {
    let (axis, distance) = ((light.target - light.position).normalize_or_zero(), light.position.distance(light.target));
    let (u, v) = axis.any_orthonormal_pair();
    let rim = |degrees: f32, share: f64| {
        let (sine, cosine) = f64::from(degrees).to_radians().sin_cos();
        let (sin, cos) = (share * std::f64::consts::TAU).sin_cos();
        light.position + (axis * cosine + (u * cos + v * sin) * sine) * distance
    };
    let line = |from: DVec3, to: DVec3, stroke: Stroke| world_line(painter, stage, from, to, stroke);
    line(light.position, light.target, Stroke::new(1.0, color.gamma_multiply(0.7)));
    for (degrees, strength) in [(light.inner_degrees, 0.35), (light.outer_degrees, 0.8)] {
        let stroke = Stroke::new(1.2, color.gamma_multiply(strength));
        for step in 0..RIM_STEPS {
            let at = |step: usize| stage.place(rim(degrees, step as f64 / RIM_STEPS as f64));
            if let (Some(from), Some(to)) = (at(step), at(step + 1)) {
                painter.line_segment([from, to], stroke);
            }
        }
    }
    for quarter in 0..4 {
        let to = rim(light.outer_degrees, f64::from(quarter) * 0.25);
        line(light.position, to, Stroke::new(1.0, color.gamma_multiply(0.5)));
    }
}
