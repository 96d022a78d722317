//! The scale bar: a round length in the unit of the coordinates, as it appears at the depth of the pivot.

use codec::Units;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, pos2, vec2};

use super::ground;
use crate::shared::language::text;
use crate::shared::steps;

/// A length and how long it is in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleBar {
    /// In world units.
    pub length: f64,
    /// In points of the window, or pixels of a picture.
    pub points: f64,
}

impl ScaleBar {
    /// The longest bar of a round length that is at most `most` points long. `scale` is the number of world units in a
    /// point.
    pub fn fitting(scale: f64, most: f64) -> Option<Self> {
        let length = steps::round_below(scale * most)?;
        Some(Self { length, points: length / scale })
    }

    /// The length with its unit. In perspective it says where it holds.
    pub fn text(&self, units: &Units, is_parallel: bool) -> String {
        let unit = units.length().map_or(text!(" units").into(), |unit| format!(" {unit}"));
        let place = if is_parallel { "" } else { text!(" at the pivot") };
        format!("{}{unit}{place}", steps::text(self.length, self.length, self.length))
    }
}

/// Draws the bar with its lower left corner at a place.
pub fn paint(painter: &Painter, corner: Pos2, bar: Option<ScaleBar>, text: &str, size: f32) {
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(size), Color32::WHITE);
    let width = bar.map_or(0.0, |bar| bar.points as f32);
    let (gap, height) = (size * 0.4, size * 0.4);
    let inner = vec2(width.max(galley.size().x), galley.size().y + bar.map_or(0.0, |_| gap + height));
    let area = Rect::from_min_size(pos2(corner.x + gap * 1.5, corner.y - inner.y - gap), inner);
    ground::paint(painter, area, size);
    if bar.is_some() {
        // Two halves, dark and light, so that one of them shows against any picture.
        let bottom = area.bottom();
        for (index, color) in [Color32::WHITE, Color32::from_gray(40)].into_iter().enumerate() {
            let left = area.left() + width * 0.5 * index as f32;
            painter.rect_filled(
                Rect::from_min_max(pos2(left, bottom - height), pos2(left + width * 0.5, bottom)),
                0.0,
                color,
            );
        }
        let outline = Rect::from_min_max(pos2(area.left(), bottom - height), pos2(area.left() + width, bottom));
        painter.rect_stroke(outline, 0.0, Stroke::new(size * 0.08, Color32::WHITE), egui::StrokeKind::Inside);
    }
    painter.text(area.left_top(), Align2::LEFT_TOP, text, FontId::proportional(size), Color32::WHITE);
}

#[cfg(test)]
mod tests {
    use codec::Unit;
    use glam::DVec3;
    use scene::{Camera, Projection, ViewSettings};

    use super::*;
    use crate::overlays::lens::Lens;

    #[test]
    fn a_bar_is_as_long_as_its_length_is_in_the_picture_at_the_pivot() {
        let mut lengths = Vec::new();
        for projection in [Projection::Perspective, Projection::Orthographic] {
            for (distance, field_of_view) in [(0.3, 60.0), (7.0, 60.0), (41.0, 25.0), (5200.0, 100.0)] {
                let pivot = DVec3::new(635_000.0, 5_077_000.0, 120.0);
                let camera = Camera::looking(pivot, DVec3::new(1.0, -2.0, 0.7), distance, DVec3::Z);
                let view = ViewSettings { projection, field_of_view, ..ViewSettings::default() };
                let lens = Lens::new(&camera, &view, [800, 600]);
                let bar = ScaleBar::fitting(lens.units_per_pixel(pivot).unwrap(), 200.0).unwrap();
                // Two places at the depth of the pivot that are the bar's length apart.
                let half = camera.right() * (bar.length * 0.5);
                let ends = [pivot - half, pivot + half].map(|end| lens.project(end).unwrap());
                assert!((ends[0].distance(ends[1]) - bar.points).abs() < 1e-3, "{bar:?} {ends:?}");
                assert!(bar.points <= 200.0 + 1e-6 && bar.points > 79.0, "{bar:?}");
                lengths.push(bar.length);
            }
        }
        lengths.iter().for_each(|length| {
            let digit = length / 10_f64.powi((length * 1.000_001).log10().floor() as i32);
            assert!([1.0, 2.0, 5.0].iter().any(|one| (digit - one).abs() < 1e-6), "{length}");
        });
    }

    #[test]
    fn its_text_tells_the_unit_and_in_perspective_where_it_holds() {
        let feet = Units { level: Some(Unit::Foot), height: Some(Unit::Foot) };
        let bar = |length| ScaleBar { length, points: 10.0 };
        assert_eq!(bar(0.05).text(&feet, true), "0.05 ft");
        assert_eq!(bar(2000.0).text(&feet, false), "2000 ft at the pivot");
        assert_eq!(bar(5.0).text(&Units::default(), true), "5 units");
    }
}
