//! Handles over the picture that move, turn and scale the selected mirror: three arrows along the world's axes, three rings
//! about them, a square to scale by, a dot to move it across the picture. They are as large as a hand needs, whatever the
//! mirror's size, and what is grabbed stays under the cursor.

use egui::{Color32, Painter, PointerButton, Pos2, Rect, Response, Stroke, Vec2, pos2, vec2};
use glam::{DQuat, DVec2, DVec3};
use scene::Mirror;
use serde_json::json;

use super::navigation::Lens;
use super::state::State;
use super::theme;

/// What of the gizmo is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Handles {
    #[default]
    All,
    Move,
    Turn,
    Scale,
}

/// A part that can be grabbed. Numbers are world axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    /// Along an axis.
    Arrow(usize),
    /// Across the picture.
    Dot,
    /// About an axis.
    Ring(usize),
    Square,
}

/// What the gizmo remembers between frames of the window.
#[derive(Default)]
pub struct Gizmo {
    pub handles: Handles,
    /// Under the cursor.
    hot: Option<Handle>,
    drag: Option<Drag>,
}

struct Drag {
    handle: Handle,
    /// The mirror as it was when it was grabbed.
    start: Mirror,
    /// Points of the window.
    pressed: Pos2,
    /// Where the handles were.
    layout: Layout,
}

/// Lengths in points of the window: a thumb's width for an arrow, a hand's precision for what counts as on it.
const ARROW: f64 = 84.0;
const RING: f64 = 62.0;
const SQUARE: f32 = 104.0;
const NEAR: f32 = 7.0;
/// Arrows that point at the eye, and rings seen from the edge, cannot be dragged: shorter than this they are left out.
const SHORTEST: f32 = 14.0;
const RING_STEPS: usize = 48;
/// Points that double the size.
const DOUBLING: f32 = 100.0;

const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];
const COLORS: [Color32; 3] =
    [Color32::from_rgb(0xe8, 0x5b, 0x54), Color32::from_rgb(0x7c, 0xc2, 0x4f), Color32::from_rgb(0x5b, 0x9c, 0xf0)];

impl Gizmo {
    /// Whether the mouse is its own: the camera is not to follow.
    pub fn has_mouse(&self) -> bool {
        self.hot.is_some() || self.drag.is_some()
    }

    pub fn is_dragging(&self) -> bool {
        self.drag.is_some()
    }
}

/// Between the window and the world: a lens and the rectangle its picture fills.
pub struct Stage {
    lens: Lens,
    rect: Rect,
    /// Pixels of the picture per point of the window.
    scale: DVec2,
}

impl Stage {
    /// Of the picture that is shown, so that handles stick to what is seen.
    fn of(state: &State, rect: Rect) -> Option<Self> {
        let request = &state.shown.as_ref()?.request;
        let lens = Lens::new(&request.camera, &request.settings.view, request.size);
        Some(Self::new(lens, request.size, rect))
    }

    fn new(lens: Lens, size: [u32; 2], rect: Rect) -> Self {
        let scale = DVec2::new(
            f64::from(size[0]) / f64::from(rect.width().max(1.0)),
            f64::from(size[1]) / f64::from(rect.height().max(1.0)),
        );
        Self { lens, rect, scale }
    }

    fn place(&self, world: DVec3) -> Option<Pos2> {
        let at = self.lens.project(world)? / self.scale;
        Some(self.rect.min + vec2(at.x as f32, at.y as f32))
    }

    fn ray(&self, at: Pos2) -> (DVec3, DVec3) {
        let from_corner = at - self.rect.min;
        self.lens.ray(DVec2::new(f64::from(from_corner.x), f64::from(from_corner.y)) * self.scale)
    }

    /// World units per point of the window.
    fn units(&self, world: DVec3) -> Option<f64> {
        Some(self.lens.units_per_pixel(world)? * self.scale.y)
    }
}

/// The handles on the screen.
#[derive(Clone)]
struct Layout {
    center: Pos2,
    arrows: [Option<Pos2>; 3],
    rings: [Option<Vec<Pos2>>; 3],
    square: Option<Pos2>,
    dot: bool,
}

impl Layout {
    fn new(stage: &Stage, center: DVec3, handles: Handles) -> Option<Self> {
        let shows = |part: Handles| handles == Handles::All || handles == part;
        let middle = stage.place(center)?;
        let units = stage.units(center)?;
        let arrow = |axis: usize| {
            let end = stage.place(center + AXES[axis] * (ARROW * units))?;
            (shows(Handles::Move) && end.distance(middle) >= SHORTEST).then_some(end)
        };
        let ring = |axis: usize| {
            let (u, v) = (AXES[(axis + 1) % 3], AXES[(axis + 2) % 3]);
            let at = |step: usize| {
                let (sin, cos) = (step as f64 / RING_STEPS as f64 * std::f64::consts::TAU).sin_cos();
                stage.place(center + (u * cos + v * sin) * (RING * units))
            };
            let points: Vec<Pos2> = (0..=RING_STEPS).map(at).collect::<Option<_>>()?;
            shows(Handles::Turn).then_some(points)
        };
        let square = shows(Handles::Scale).then(|| middle + vec2(1.0, -1.0).normalized() * SQUARE);
        let dot = shows(Handles::Move);
        Some(Self { center: middle, arrows: [0, 1, 2].map(arrow), rings: [0, 1, 2].map(ring), square, dot })
    }

    /// The handle at a place of the window; the nearest if there are several.
    fn at(&self, pointer: Pos2) -> Option<Handle> {
        let mut found: Vec<(f32, Handle)> = Vec::new();
        if self.dot {
            // Before what begins there.
            found.push((pointer.distance(self.center) - NEAR, Handle::Dot));
        }
        found.extend(self.square.map(|at| (pointer.distance(at) - NEAR * 0.5, Handle::Square)));
        for axis in 0..3 {
            let arrow = self.arrows[axis].map(|end| to_segment(pointer, self.center, end));
            found.extend(arrow.map(|distance| (distance, Handle::Arrow(axis))));
            let ring = self.rings[axis].iter().flat_map(|ring| ring.windows(2));
            let nearest = ring.map(|ends| to_segment(pointer, ends[0], ends[1])).fold(f32::INFINITY, f32::min);
            // A ring that is seen from its edge lies on an arrow, which is easier to mean.
            found.push((nearest + 1.0, Handle::Ring(axis)));
        }
        let near = found.into_iter().filter(|(distance, _)| *distance < NEAR);
        near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, handle)| handle)
    }
}

fn to_segment(point: Pos2, from: Pos2, to: Pos2) -> f32 {
    let along = to - from;
    let share = ((point - from).dot(along) / along.length_sq().max(1e-6)).clamp(0.0, 1.0);
    point.distance(from + along * share)
}

/// Lets the mouse grab and drag the handles of the selected mirror; before the camera has its turn.
pub fn interact(picture: &Response, state: &mut State) {
    let Some(id) = state.selected else {
        state.gizmo.hot = None;
        state.gizmo.drag = None;
        return;
    };
    let (Some(stage), Some(mirror)) = (Stage::of(state, picture.rect), state.objects.mirror(id).cloned()) else {
        return;
    };
    let Some(layout) = Layout::new(&stage, mirror.position, state.gizmo.handles) else { return };
    let input = picture.ctx.input(|input| (input.pointer.latest_pos(), input.pointer.press_origin()));
    let (Some(pointer), pressed) = input else {
        state.gizmo.hot = None;
        return;
    };
    if !picture.ctx.input(|input| input.pointer.button_down(PointerButton::Primary)) {
        if state.gizmo.drag.take().is_some() {
            state.log(json!({ "event": "mirror_moved", "name": mirror.name, "position": mirror.position.to_array() }));
        }
        state.gizmo.hot = if picture.contains_pointer() { layout.at(pointer) } else { None };
    } else if let (None, Some(pressed), true) = (&state.gizmo.drag, pressed, picture.is_pointer_button_down_on()) {
        // From where it was pressed: a quick hand is elsewhere by now.
        if let Some(handle) = layout.at(pressed) {
            state.gizmo.hot = Some(handle);
            state.gizmo.drag = Some(Drag { handle, start: mirror.clone(), pressed, layout });
        }
    }
    let Some(drag) = &state.gizmo.drag else { return };
    let moved = dragged(&stage, drag, pointer);
    if moved != mirror {
        if let Some(mirror) = state.objects.mirror_mut(id) {
            *mirror = moved;
        }
        state.navigation.camera_moved();
    }
}

/// The mirror with the handle under `pointer`.
fn dragged(stage: &Stage, drag: &Drag, pointer: Pos2) -> Mirror {
    let mut mirror = drag.start.clone();
    match drag.handle {
        Handle::Arrow(axis) => {
            let along = |at: Pos2| along_axis(stage.ray(at), drag.start.position, AXES[axis]);
            if let (Some(from), Some(to)) = (along(drag.pressed), along(pointer)) {
                mirror.position += AXES[axis] * (to - from);
            }
        }
        Handle::Dot => {
            let on_plane = |at: Pos2| {
                let (origin, direction) = stage.ray(at);
                let facing = stage.lens.forward();
                origin + direction * ((drag.start.position - origin).dot(facing) / direction.dot(facing))
            };
            let shift = on_plane(pointer) - on_plane(drag.pressed);
            if shift.is_finite() {
                mirror.position += shift;
            }
        }
        Handle::Ring(axis) => {
            let angle = drag.layout.rings[axis].as_deref().map_or(0.0, |ring| turned(ring, drag.pressed, pointer));
            mirror.rotation = (DQuat::from_axis_angle(AXES[axis], angle) * drag.start.rotation).normalize();
        }
        Handle::Square => {
            let outward: Vec2 = vec2(1.0, -1.0).normalized();
            let factor = ((pointer - drag.pressed).dot(outward) / DOUBLING).exp2();
            mirror.size = (drag.start.size * f64::from(factor)).clamp(drag.start.size * 1e-3, drag.start.size * 1e3);
        }
    }
    mirror
}

/// Where on a line through `center` the sight line comes closest; `None` if they are nearly parallel.
fn along_axis((origin, direction): (DVec3, DVec3), center: DVec3, axis: DVec3) -> Option<f64> {
    let between = center - origin;
    let cosine = axis.dot(direction);
    let sine_squared = 1.0 - cosine * cosine;
    (sine_squared > 1e-3).then(|| (cosine * direction.dot(between) - axis.dot(between)) / sine_squared)
}

/// Radians by which a drag turns a ring: as if it was pulled along its tangent where it was grabbed.
fn turned(ring: &[Pos2], pressed: Pos2, pointer: Pos2) -> f64 {
    let grabbed =
        (0..RING_STEPS).min_by(|a, b| pressed.distance_sq(ring[*a]).total_cmp(&pressed.distance_sq(ring[*b])));
    let step = grabbed.unwrap_or(0);
    // Per radian: over the two steps about the grabbed one.
    let before = ring[(step + RING_STEPS - 1) % RING_STEPS];
    let tangent = (ring[step + 1] - before) * (RING_STEPS as f32 / (2.0 * std::f32::consts::TAU));
    let length = tangent.length_sq();
    if length < SHORTEST * SHORTEST {
        return 0.0;
    }
    f64::from((pointer - pressed).dot(tangent) / length)
}

/// Draws the handles of the selected mirror.
pub fn paint(painter: &Painter, rect: Rect, state: &State) {
    let mirror = state.selected.and_then(|id| state.objects.mirror(id));
    let (Some(stage), Some(mirror)) = (Stage::of(state, rect), mirror) else { return };
    let Some(layout) = Layout::new(&stage, mirror.position, state.gizmo.handles) else { return };
    let painter = painter.with_clip_rect(rect);
    let held = state.gizmo.drag.as_ref().map(|drag| drag.handle);
    let hot = held.or(state.gizmo.hot);
    // While something is dragged the others would be in the way.
    let shown = |handle: Handle| held.is_none_or(|held| held == handle);
    let style = |handle: Handle, color: Color32| {
        let width = if hot == Some(handle) { 3.5 } else { 2.0 };
        Stroke::new(width, if hot == Some(handle) { theme::ACCENT } else { color })
    };
    let shadow = Stroke::new(5.0, Color32::from_black_alpha(110));
    for axis in 0..3 {
        if let Some(ring) = layout.rings[axis].as_ref().filter(|_| shown(Handle::Ring(axis))) {
            painter.add(egui::Shape::line(ring.clone(), shadow));
            painter.add(egui::Shape::line(ring.clone(), style(Handle::Ring(axis), COLORS[axis].gamma_multiply(0.85))));
        }
    }
    for axis in 0..3 {
        if let Some(end) = layout.arrows[axis].filter(|_| shown(Handle::Arrow(axis))) {
            let stroke = style(Handle::Arrow(axis), COLORS[axis]);
            painter.line_segment([layout.center, end], shadow);
            painter.line_segment([layout.center, end], stroke);
            let tip = (end - layout.center).normalized();
            let side = tip.rot90() * 5.0;
            let head = vec![end + tip * 12.0, end + side, end - side];
            painter.add(egui::Shape::convex_polygon(head, stroke.color, Stroke::NONE));
        }
    }
    if let Some(at) = layout.square.filter(|_| shown(Handle::Square)) {
        let stroke = style(Handle::Square, Color32::WHITE);
        painter.line_segment([layout.center, at], Stroke::new(1.0, stroke.color.gamma_multiply(0.5)));
        painter.rect_filled(Rect::from_center_size(at, vec2(11.0, 11.0)), 2.0, Color32::from_black_alpha(160));
        painter.rect_filled(Rect::from_center_size(at, vec2(9.0, 9.0)), 2.0, stroke.color);
    }
    if layout.dot && shown(Handle::Dot) {
        painter.circle_filled(layout.center, 6.0, Color32::from_black_alpha(160));
        painter.circle_filled(layout.center, 4.5, style(Handle::Dot, Color32::WHITE).color);
    }
    let name = painter.layout_no_wrap(mirror.name.clone(), egui::FontId::proportional(12.0), Color32::WHITE);
    let corner = pos2(layout.center.x - name.size().x * 0.5, layout.center.y + ARROW as f32 + 16.0);
    painter.rect_filled(Rect::from_min_size(corner, name.size()).expand(3.0), 3.0, Color32::from_black_alpha(130));
    painter.galley(corner, name, Color32::WHITE);
}

#[cfg(test)]
mod tests {
    use scene::{Camera, Projection, Shape, ViewSettings};

    use super::*;

    fn stage(projection: Projection) -> Stage {
        let camera =
            Camera::looking(DVec3::new(635_000.0, 848_000.0, 40.0), DVec3::new(0.7, -1.0, 0.5), 12.0, DVec3::Z);
        let view = ViewSettings { projection, ..ViewSettings::default() };
        // A screen of two pixels a point.
        let rect = Rect::from_min_size(pos2(310.0, 20.0), vec2(800.0, 600.0));
        Stage::new(Lens::new(&camera, &view, [1600, 1200]), [1600, 1200], rect)
    }

    fn mirror() -> Mirror {
        Mirror::standing(Shape::Sphere, DVec3::new(635_001.0, 848_000.5, 40.0), DVec3::Z, DVec3::Z, 0.8)
    }

    fn drag(stage: &Stage, handle: Handle, pressed: Pos2) -> Drag {
        let start = mirror();
        let layout = Layout::new(stage, start.position, Handles::All).unwrap();
        Drag { handle, start, pressed, layout }
    }

    #[test]
    fn what_is_grabbed_stays_under_the_cursor() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let stage = stage(projection);
            for axis in 0..3 {
                let end = Layout::new(&stage, mirror().position, Handles::All).unwrap().arrows[axis].unwrap();
                let drag = drag(&stage, Handle::Arrow(axis), end);
                // Along the arrow on the screen, and off it: only the way along it counts.
                let center = drag.layout.center;
                let along = end - center;
                let moved = dragged(&stage, &drag, end + along * 1.5);
                let shift = moved.position - drag.start.position;
                assert!(shift.dot(AXES[axis]) > 0.0 && shift.cross(AXES[axis]).length() < 1e-6, "{axis}: {shift}");
                let units = stage.units(mirror().position).unwrap();
                let tip = stage.place(moved.position + AXES[axis] * (ARROW * units)).unwrap();
                assert!(tip.distance(end + along * 1.5) < 0.1, "{axis}: {tip} instead of {}", end + along * 1.5);
            }
            let drag = drag(&stage, Handle::Dot, pos2(700.0, 300.0));
            let moved = dragged(&stage, &drag, pos2(750.0, 260.0));
            let place = |mirror: &Mirror| stage.place(mirror.position).unwrap();
            assert!((place(&moved) - place(&drag.start) - vec2(50.0, -40.0)).length() < 0.1);
        }
    }

    #[test]
    fn pulling_a_ring_turns_the_mirror_with_it() {
        let stage = stage(Projection::Orthographic);
        for axis in 0..3 {
            let layout = Layout::new(&stage, mirror().position, Handles::All).unwrap();
            let ring = layout.rings[axis].clone().unwrap();
            for step in [3, 20, 41] {
                let drag = drag(&stage, Handle::Ring(axis), ring[step]);
                let moved = dragged(&stage, &drag, ring[step + 1]);
                // The point that was grabbed has gone to where the cursor is, up to the bend of the ring.
                let turn = moved.rotation * drag.start.rotation.inverse();
                let (turned_axis, angle) = turn.to_axis_angle();
                let expected = std::f64::consts::TAU / RING_STEPS as f64;
                assert!(
                    (angle * turned_axis.dot(AXES[axis]) - expected).abs() < 0.25 * expected,
                    "{axis} {step}: {angle}"
                );
                assert_eq!(moved.position, drag.start.position);
            }
        }
    }

    #[test]
    fn the_square_doubles_and_halves() {
        let stage = stage(Projection::Perspective);
        let drag = drag(&stage, Handle::Square, pos2(500.0, 300.0));
        let outward = vec2(1.0, -1.0).normalized() * DOUBLING;
        let size = |offset: Vec2| dragged(&stage, &drag, drag.pressed + offset).size / drag.start.size;
        assert!((size(outward) - 2.0).abs() < 1e-5 && (size(-outward) - 0.5).abs() < 1e-5);
        assert!(size(vec2(-1e6, 1e6)) >= 1e-3, "a mirror must not vanish");
    }

    #[test]
    fn handles_are_found_where_they_are_drawn() {
        let stage = stage(Projection::Perspective);
        let layout = Layout::new(&stage, mirror().position, Handles::All).unwrap();
        assert_eq!(layout.at(layout.center), Some(Handle::Dot));
        assert_eq!(layout.at(layout.square.unwrap()), Some(Handle::Square));
        for axis in 0..3 {
            assert_eq!(layout.at(layout.arrows[axis].unwrap()), Some(Handle::Arrow(axis)));
        }
        assert_eq!(layout.at(layout.center + vec2(300.0, 200.0)), None);
        let turning = Layout::new(&stage, mirror().position, Handles::Turn).unwrap();
        assert_eq!(turning.at(turning.center), None);
        assert!(turning.at(turning.rings[2].as_ref().unwrap()[5]).is_some());
    }

    #[test]
    fn an_arrow_that_points_at_the_eye_cannot_be_grabbed() {
        let camera = Camera::looking(mirror().position, DVec3::X, 12.0, DVec3::Z);
        let rect = Rect::from_min_size(pos2(0.0, 0.0), vec2(800.0, 600.0));
        let stage = Stage::new(Lens::new(&camera, &ViewSettings::default(), [800, 600]), [800, 600], rect);
        let layout = Layout::new(&stage, mirror().position, Handles::All).unwrap();
        assert!(layout.arrows[0].is_none() && layout.arrows[1].is_some() && layout.arrows[2].is_some());
        assert_eq!(along_axis(stage.ray(pos2(400.0, 300.0)), mirror().position, DVec3::X), None);
    }
}
