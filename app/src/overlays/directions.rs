//! The north arrow and the axes: directions of the world as they appear in the middle of the picture.

use codec::Units;
use egui::{Align2, Color32, FontId, Painter, Pos2, Stroke, Vec2, vec2};
use glam::{DMat3, DVec3};

use super::ground::SHADOW;

/// The colours of the axes, as in other programs: x red, y green, z blue.
const AXES: [(&str, DVec3, Color32); 3] = [
    ("x", DVec3::X, Color32::from_rgb(0xff, 0x6b, 0x5e)),
    ("y", DVec3::Y, Color32::from_rgb(0x7d, 0xd9, 0x5c)),
    ("z", DVec3::Z, Color32::from_rgb(0x6c, 0xa8, 0xff)),
];
/// The shortest arrow, relative to one across the line of sight; a shorter one would point nowhere.
const SHORTEST: f64 = 0.15;

/// The direction of grid north, if the file names a coordinate system that has one: on the map, y points north.
pub fn north(units: &Units, up: DVec3) -> Option<DVec3> {
    (units.level.is_some() && up.z > 0.9).then_some(DVec3::Y)
}

/// A direction of the world in the picture, y down, as a share of its length; and how far it points away from the eye.
/// `rows` are those of `Camera::view_from_world`.
fn in_picture(rows: &DMat3, direction: DVec3) -> (Vec2, f64) {
    let seen = *rows * direction;
    (vec2(seen.x as f32, -seen.y as f32), seen.z)
}

fn line(painter: &Painter, ends: [Pos2; 2], width: f32, color: Color32) {
    painter.line_segment(ends, Stroke::new(width * 2.2, SHADOW));
    painter.line_segment(ends, Stroke::new(width, color));
}

fn letter(painter: &Painter, at: Pos2, text: &str, size: f32, color: Color32) {
    let font = FontId::proportional(size);
    for offset in [vec2(1.0, 1.0), vec2(-1.0, 1.0), vec2(1.0, -1.0), vec2(-1.0, -1.0)] {
        painter.text(at + offset * (size * 0.07), Align2::CENTER_CENTER, text, font.clone(), SHADOW);
    }
    painter.text(at, Align2::CENTER_CENTER, text, font, color);
}

/// Draws the axes about a place, with arms of `reach`.
pub fn axes(painter: &Painter, at: Pos2, reach: f32, rows: &DMat3, size: f32) {
    let mut arms = AXES.map(|(name, axis, color)| (name, in_picture(rows, axis), color));
    // The farthest first.
    arms.sort_by(|a, b| b.1.1.total_cmp(&a.1.1));
    for (name, (arm, _), color) in arms {
        let end = at + arm * reach;
        line(painter, [at, end], size * 0.15, color);
        let aside = if arm.length() > 0.05 { arm.normalized() } else { vec2(0.7, 0.7) };
        letter(painter, end + aside * (size * 0.6), name, size, color);
    }
}

/// Draws an arrow to the north about a place. It is as much shorter as it points towards the eye or away from it.
pub fn north_arrow(painter: &Painter, at: Pos2, reach: f32, rows: &DMat3, north: DVec3, size: f32) {
    let (arm, _) = in_picture(rows, north);
    let length = arm.length();
    let direction = if f64::from(length) > SHORTEST { arm.normalized() } else { Vec2::ZERO };
    if direction == Vec2::ZERO {
        letter(painter, at, "N", size, Color32::WHITE);
        painter.circle_stroke(at, size * 0.8, Stroke::new(size * 0.12, Color32::WHITE));
        return;
    }
    let (tip, tail) = (at + arm * reach, at - arm * reach);
    let aside = direction.rot90() * (size * 0.42);
    let neck = tip - direction * (size * 0.9).min(length * reach);
    line(painter, [tail, neck], size * 0.15, Color32::WHITE);
    painter.add(egui::Shape::convex_polygon(
        vec![tip, neck + aside, neck - aside],
        Color32::WHITE,
        Stroke::new(size * 0.1, SHADOW),
    ));
    letter(painter, tip + direction * (size * 0.75), "N", size, Color32::WHITE);
}

#[cfg(test)]
mod tests {
    use codec::Unit;
    use scene::{Camera, Projection, ViewSettings};

    use super::*;
    use crate::overlays::lens::Lens;

    #[test]
    fn a_direction_in_the_picture_is_that_of_a_step_at_the_pivot() {
        let camera = Camera::looking(DVec3::new(5e5, 4e6, 10.0), DVec3::new(1.0, -2.0, 0.7), 40.0, DVec3::Z);
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let view = ViewSettings { projection, ..ViewSettings::default() };
            let lens = Lens::new(&camera, &view, [800, 600]);
            let scale = lens.units_per_pixel(camera.pivot).unwrap();
            for direction in [DVec3::X, DVec3::Y, DVec3::Z] {
                let step = 1e-3;
                let moved = lens.project(camera.pivot + direction * step).unwrap();
                let seen = (moved - lens.project(camera.pivot).unwrap()) * scale / step;
                let (arm, _) = in_picture(&camera.view_from_world(), direction);
                assert!((seen.x - f64::from(arm.x)).abs() < 1e-3 && (seen.y - f64::from(arm.y)).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn there_is_a_north_where_a_file_tells_a_system_on_the_map() {
        let metres = Units { level: Some(Unit::Metre), height: None };
        assert_eq!(north(&metres, DVec3::Z), Some(DVec3::Y));
        assert_eq!(north(&metres, DVec3::Y), None);
        assert_eq!(north(&Units::default(), DVec3::Z), None);
    }
}
