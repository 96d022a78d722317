//! Draws over the picture in the window: the pivot, the picked point, handles, and the overlays that pictures have, too. All are projected through
//! the camera of the picture that is shown, so that marks stick to their points.

use cloud::Bounds;
use egui::{Color32, Painter, Pos2, Rect, Stroke, vec2};
use glam::DVec3;
use scene::Settings;

use crate::overlays;
use crate::overlays::ground::SHADOW;
use crate::overlays::labels::seen;
use crate::overlays::lens::Lens;
use crate::viewer::input::gizmo;
use crate::viewer::look::theme;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::panels::labels;
use crate::viewer::requests::action::Action;
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;
use crate::viewer::tools::facts::facts;

/// The most boxes of index nodes that are drawn; more would be a tangle.
const MOST_BOXES: usize = 2000;

pub fn paint(painter: &Painter, rect: Rect, session: &Session) {
    let Some(shown) = &session.frames.shown else { return };
    let size = shown.request.size;
    let lens = Lens::new(&shown.request.camera, &shown.request.settings.view, size);
    let place = |world: DVec3| -> Option<Pos2> {
        let pixel = lens.project(world)?;
        let x = pixel.x as f32 / size[0] as f32 * rect.width();
        let y = pixel.y as f32 / size[1] as f32 * rect.height();
        Some(rect.min + vec2(x, y))
    };
    let painter = painter.with_clip_rect(rect);
    if session.scene.settings.stream.overlay {
        let boxes = session.loaded.clouds.iter().filter(|entry| entry.is_visible).flat_map(CloudEntry::shown_boxes);
        for (bounds, [red, green, blue, _]) in boxes.take(MOST_BOXES) {
            wire(&painter, &place, bounds, Stroke::new(1.0, Color32::from_rgb(red, green, blue)));
        }
    }
    let marked = session.scene.navigation.pivot_mark(session.outside.now).map(|(at, _)| at);
    if let Some(at) = marked.and_then(place) {
        pivot(&painter, at);
    }
    if let Some(at) = session.tools.pick.as_ref().and_then(|pick| place(pick.world)) {
        cross(&painter, at);
    }
    let hovered = session.tools.profiles.hovered.and_then(|point| session.loaded.world_position(point));
    if let Some(at) = hovered.and_then(place) {
        cross(&painter, at);
    }
    let facts = facts(&session.scene, &session.loaded, &session.tools.measurements);
    overlays::paint_marks(&painter, &place, &session.scene.settings, &facts);
    labels::placing(&painter, &place, session);
    // The camera and the projection are those of the picture.
    let settings = Settings { overlay: session.scene.settings.overlay.clone(), ..shown.request.settings.clone() };
    overlays::paint(&painter, rect, &shown.request.camera, size, &settings, &facts);
    gizmo::paint(&painter, rect, session);
}

/// Draws the edges of a box.
fn wire(painter: &Painter, place: &impl Fn(DVec3) -> Option<Pos2>, bounds: Bounds, stroke: Stroke) {
    let corners = bounds.corners();
    for (from, axis) in (0..8).flat_map(|corner| (0..3).map(move |axis| (corner, axis))) {
        // Each corner begins the edges along those axes on which it is the lower end.
        if from >> axis & 1 == 0
            && let Some(ends) = seen(place, corners[from], corners[from | 1 << axis])
        {
            painter.line_segment(ends, stroke);
        }
    }
}

fn pivot(painter: &Painter, at: Pos2) {
    for (width, color) in [(3.5, SHADOW), (1.5, Color32::WHITE)] {
        painter.circle_stroke(at, 7.0, Stroke::new(width, color));
        painter.circle_filled(at, width, color);
    }
}

fn cross(painter: &Painter, at: Pos2) {
    for (width, color) in [(4.0, SHADOW), (1.6, theme::ACCENT)] {
        let stroke = Stroke::new(width, color);
        painter.circle_stroke(at, 6.0, stroke);
        for direction in [vec2(1.0, 0.0), vec2(-1.0, 0.0), vec2(0.0, 1.0), vec2(0.0, -1.0)] {
            painter.line_segment([at + direction * 6.0, at + direction * 12.0], stroke);
        }
    }
}

/// Marks the middle of the picture, with the key that picks there.
pub fn middle(painter: &Painter, rect: Rect) {
    cross(painter, rect.center());
    let (place, font) = (rect.center() + vec2(15.0, 4.0), egui::FontId::proportional(12.0));
    let text = bindings::shortcut(&Action::PickMiddle);
    for (offset, color) in [(vec2(1.0, 1.0), SHADOW), (vec2(0.0, 0.0), theme::ACCENT)] {
        painter.text(place + offset, egui::Align2::LEFT_TOP, &text, font.clone(), color);
    }
}

#[cfg(test)]
mod tests {
    use egui::pos2;

    use super::*;

    /// A camera that sees places with a z above 0, each at its x and y.
    fn place(world: DVec3) -> Option<Pos2> {
        (world.z > 0.0).then(|| pos2(world.x as f32, world.y as f32))
    }

    /// Returns the shapes that a closure paints.
    fn shapes(paint: impl Fn(&Painter)) -> Vec<egui::Shape> {
        let context = egui::Context::default();
        let output = context.run_ui(egui::RawInput::default(), |ui| paint(ui.painter()));
        output.shapes.into_iter().map(|clipped| clipped.shape).collect()
    }

    #[test]
    fn a_box_has_twelve_edges_and_those_behind_the_eye_are_left_out() {
        let count = |bounds: Bounds| {
            let painted = shapes(|painter| wire(painter, &place, bounds, Stroke::new(1.0, Color32::WHITE)));
            painted.iter().filter(|shape| matches!(shape, egui::Shape::LineSegment { .. })).count()
        };
        let bounds = |low: f64| Bounds { min: DVec3::new(0.0, 0.0, low), max: DVec3::new(9.0, 9.0, low + 2.0) };
        assert_eq!(count(bounds(1.0)), 12);
        // The four edges of the near side remain, and the four that lead to it.
        assert_eq!(count(bounds(-1.0)), 8);
        assert_eq!(count(bounds(-5.0)), 0);
    }

    #[test]
    fn nothing_is_painted_before_there_is_a_picture() {
        let mut session = Session::with_two_points();
        session.scene.settings.stream.overlay = true;
        session.scene.navigation.show_pivot(DVec3::ZERO, session.outside.now);
        let rect = Rect::from_min_size(Pos2::ZERO, vec2(100.0, 100.0));
        assert!(
            shapes(|painter| paint(painter, rect, &session)).iter().all(|shape| matches!(shape, egui::Shape::Noop))
        );
    }
}
