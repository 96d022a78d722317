//! Handles over the picture that move, turn and scale the selected mirror: three arrows along the world's axes, three
//! rings about them, a square that scales it, and a dot that moves it across the picture. Their size on the screen
//! suits a hand, whatever the mirror's size, and what is grabbed stays under the cursor. A light has the arrows and a
//! dot at its position, and a dot at its target. A clip volume has all of these and a dot on each side, by which it is
//! resized. While the panel of lights is open or a light is selected, each light
//! has a symbol; a click on it selects the light.

use egui::{Color32, Painter, PointerButton, Pos2, Rect, Response, Stroke, Vec2, pos2, vec2};
use glam::{DQuat, DVec2, DVec3};
use scene::{Lighting, Object};

use crate::overlays::lens::Lens;
use crate::viewer::input::outlines;
use crate::viewer::look::theme;
use crate::viewer::objects::ObjectId;
use crate::viewer::requests::action::{Action, Handles};
use crate::viewer::session::Session;

/// A part that can be grabbed. Numbers are world axes, 0 to 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    /// Moves the object along an axis.
    Arrow(usize),
    /// Moves a place of the object across the picture.
    Dot,
    /// Turns the object about an axis.
    Ring(usize),
    Square,
}

/// What the gizmo remembers between frames of the window, in egui's memory.
#[derive(Clone, Default, PartialEq)]
struct Gizmo {
    /// The handle under the cursor.
    hot: Option<Grip>,
    /// A light that is not selected and whose symbol is under the cursor.
    hot_light: Option<ObjectId>,
    drag: Option<Drag>,
}

/// The index of a place of the object, and a handle there. A light has two places: its position and its target.
type Grip = (usize, Handle);

#[derive(Clone, PartialEq)]
struct Drag {
    grip: Grip,
    /// The object as it was when it was grabbed.
    start: Object,
    /// Where the mouse button was pressed, in points of the window.
    pressed: Pos2,
    /// The handles as they were when one was grabbed.
    layout: Layout,
}

/// The selected object, with its name.
fn selected(session: &Session) -> Option<(ObjectId, String, Object)> {
    let id = session.scene.selected?;
    let (_, object) = session.scene.objects.get(id)?;
    Some((id, session.scene.objects.label(id)?, object))
}

/// The handles at each place of an object, of those kinds that the user chose. An object that can only be moved always
/// has all of its own.
fn layouts(object: &Object, stage: &PictureFrame, chosen: Handles) -> Vec<Option<Layout>> {
    let kind = object.kind();
    let shows = |part: Handles| chosen == Handles::All || chosen == part;
    let moves = shows(Handles::Move) || !(kind.can_turn || kind.can_scale);
    let layout = |(index, place): (usize, &DVec3)| {
        let is_first = index == 0;
        let parts = Parts {
            arrows: is_first && moves,
            // A place on a rail is a side, by which the object is resized.
            dot: if object.rail(index).is_some() { shows(Handles::Scale) } else { moves },
            rings: is_first && kind.can_turn && shows(Handles::Turn),
            square: is_first && kind.can_scale && shows(Handles::Scale),
        };
        Layout::new(stage, *place, parts)
    };
    object.places().iter().enumerate().map(layout).collect()
}

/// The kinds of handles that are shown.
#[derive(Clone, Copy)]
struct Parts {
    arrows: bool,
    dot: bool,
    rings: bool,
    square: bool,
}

/// Lengths in points of the window. An arrow is as long as a thumb is wide. The mouse is on a handle within `NEAR` of
/// it.
const ARROW: f64 = 84.0;
const RING: f64 = 62.0;
const SQUARE: f32 = 104.0;
const NEAR: f32 = 7.0;
/// The least length, in points of the window, of an arrow that is shown, and of a ring's radius at the grabbed place
/// that can be turned. Arrows that point at the eye, and rings that are seen from their edge, cannot be dragged.
const SHORTEST: f32 = 14.0;
const RING_STEPS: usize = 48;
/// The distance from the middle of a lamp's symbol to the ends of its rays.
const SYMBOL: f32 = 10.0;
/// A drag by this many points of the window doubles the size.
const DOUBLING: f32 = 100.0;

const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];
const COLORS: [Color32; 3] =
    [Color32::from_rgb(0xe8, 0x5b, 0x54), Color32::from_rgb(0x7c, 0xc2, 0x4f), Color32::from_rgb(0x5b, 0x9c, 0xf0)];

impl Gizmo {
    fn id() -> egui::Id {
        egui::Id::unique("gizmo")
    }

    fn remembered(context: &egui::Context) -> Self {
        context.data(|data| data.get_temp(Self::id())).unwrap_or_default()
    }

    fn remember(self, context: &egui::Context) {
        context.data_mut(|data| data.insert_temp(Self::id(), self));
    }

    /// Whether the gizmo uses the mouse, so that the camera must not follow it.
    fn has_mouse(&self) -> bool {
        self.hot.is_some() || self.hot_light.is_some() || self.drag.is_some()
    }
}

/// Converts between the window and the world, by a lens and the rectangle that its picture fills.
pub struct PictureFrame {
    lens: Lens,
    rect: Rect,
    /// Pixels of the picture per point of the window.
    scale: DVec2,
}

impl PictureFrame {
    /// Uses the camera of the picture that is shown, so that handles stick to what is seen.
    fn of(session: &Session, rect: Rect) -> Option<Self> {
        let request = &session.frames.shown.as_ref()?.request;
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

    pub fn place(&self, world: DVec3) -> Option<Pos2> {
        let at = self.lens.project(world)? / self.scale;
        Some(self.rect.min + vec2(at.x as f32, at.y as f32))
    }

    fn ray(&self, at: Pos2) -> (DVec3, DVec3) {
        let from_corner = at - self.rect.min;
        self.lens.ray(DVec2::new(f64::from(from_corner.x), f64::from(from_corner.y)) * self.scale)
    }

    /// World units per point of the window at the depth of `world`; `None` behind the eye.
    fn units(&self, world: DVec3) -> Option<f64> {
        Some(self.lens.units_per_pixel(world)? * self.scale.y)
    }
}

/// The handles on the screen.
#[derive(Clone, PartialEq)]
struct Layout {
    center: Pos2,
    arrows: [Option<Pos2>; 3],
    rings: [Option<Vec<Pos2>>; 3],
    square: Option<Pos2>,
    dot: bool,
}

impl Layout {
    fn new(stage: &PictureFrame, center: DVec3, parts: Parts) -> Option<Self> {
        let middle = stage.place(center)?;
        let units = stage.units(center)?;
        let arrow = |axis: usize| {
            let end = stage.place(center + AXES[axis] * (ARROW * units))?;
            (parts.arrows && end.distance(middle) >= SHORTEST).then_some(end)
        };
        let ring = |axis: usize| {
            if !parts.rings {
                return None;
            }
            let (u, v) = (AXES[(axis + 1) % 3], AXES[(axis + 2) % 3]);
            let at = |step: usize| {
                let (sin, cos) = (step as f64 / RING_STEPS as f64 * std::f64::consts::TAU).sin_cos();
                stage.place(center + (u * cos + v * sin) * (RING * units))
            };
            (0..=RING_STEPS).map(at).collect::<Option<Vec<Pos2>>>()
        };
        let square = parts.square.then(|| middle + vec2(1.0, -1.0).normalized() * SQUARE);
        Some(Self { center: middle, arrows: [0, 1, 2].map(arrow), rings: [0, 1, 2].map(ring), square, dot: parts.dot })
    }

    /// The handle at a place of the window, and how near it is. If there are several, the nearest.
    fn at(&self, pointer: Pos2) -> Option<(f32, Handle)> {
        let mut found: Vec<(f32, Handle)> = Vec::new();
        if self.dot {
            // The dot comes before the arrows that begin there.
            found.push((pointer.distance(self.center) - NEAR, Handle::Dot));
        }
        found.extend(self.square.map(|at| (pointer.distance(at) - NEAR * 0.5, Handle::Square)));
        for axis in 0..3 {
            let arrow = self.arrows[axis].map(|end| to_segment(pointer, self.center, end));
            found.extend(arrow.map(|distance| (distance, Handle::Arrow(axis))));
            let ring = self.rings[axis].iter().flat_map(|ring| ring.windows(2));
            let nearest = ring.map(|ends| to_segment(pointer, ends[0], ends[1])).fold(f32::INFINITY, f32::min);
            // A ring that is seen from its edge lies on an arrow. The arrow is then the likelier choice.
            found.push((nearest + 1.0, Handle::Ring(axis)));
        }
        let near = found.into_iter().filter(|(distance, _)| *distance < NEAR);
        near.min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

fn grip_at(layouts: &[Option<Layout>], pointer: Pos2) -> Option<Grip> {
    let found = layouts.iter().enumerate().filter_map(|(place, layout)| {
        let (distance, handle) = layout.as_ref()?.at(pointer)?;
        Some((distance, (place, handle)))
    });
    found.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, grip)| grip)
}

fn to_segment(point: Pos2, from: Pos2, to: Pos2) -> f32 {
    let along = to - from;
    let share = ((point - from).dot(along) / along.length_sq().max(1e-6)).clamp(0.0, 1.0);
    point.distance(from + along * share)
}

/// Lets the mouse grab and drag the handles of the selected object, and select lights by their symbols. Runs before the
/// camera reads the mouse. Returns whether the gizmo uses the mouse, so that the camera must not follow it.
pub fn interact(picture: &Response, session: &Session, actions: &mut Vec<Action>) -> bool {
    let mut gizmo = Gizmo::remembered(&picture.ctx);
    let was_grabbed = gizmo.drag.is_some();
    gizmo.hot_light = None;
    if session.tools.is_drawing() {
        // The clicks are for what is drawn.
        (gizmo.hot, gizmo.drag) = (None, None);
    } else if let Some(stage) = PictureFrame::of(session, picture.rect) {
        handles(picture, session, &stage, &mut gizmo, actions);
        point_at_light(picture, session, &stage, &mut gizmo, actions);
    }
    if gizmo.drag.is_some() != was_grabbed {
        actions.push(Action::GrabHandle(gizmo.drag.is_some()));
    }
    let has_mouse = gizmo.has_mouse();
    gizmo.remember(&picture.ctx);
    has_mouse
}

fn point_at_light(
    picture: &Response,
    session: &Session,
    stage: &PictureFrame,
    gizmo: &mut Gizmo,
    actions: &mut Vec<Action>,
) {
    // A drag that passes over a symbol, above all one that moves the camera, must not stop there.
    let is_pressed = picture.ctx.input(|input| input.pointer.any_down());
    if gizmo.hot.is_some() || gizmo.drag.is_some() || is_pressed || !picture.contains_pointer() {
        return;
    }
    let Some(pointer) = picture.ctx.input(|input| input.pointer.latest_pos()) else { return };
    let near = symbols(session, stage).into_iter().filter(|(_, at, _)| at.distance(pointer) < SYMBOL + 4.0);
    gizmo.hot_light = near.min_by(|a, b| a.1.distance(pointer).total_cmp(&b.1.distance(pointer))).map(|near| near.0);
    if picture.clicked() && gizmo.hot_light.is_some() {
        actions.push(Action::Select(gizmo.hot_light));
    }
}

fn handles(picture: &Response, session: &Session, stage: &PictureFrame, gizmo: &mut Gizmo, actions: &mut Vec<Action>) {
    let Some((id, _, object)) = selected(session) else {
        (gizmo.hot, gizmo.drag) = (None, None);
        return;
    };
    let layouts = layouts(&object, stage, session.tools.handles);
    let input = picture
        .ctx
        .input(|input| (input.pointer.latest_pos(), input.pointer.press_origin(), input.pointer.primary_pressed()));
    let (Some(pointer), pressed, is_pressed_now) = input else {
        gizmo.hot = None;
        return;
    };
    if !picture.ctx.input(|input| input.pointer.button_down(PointerButton::Primary)) {
        gizmo.drag = None;
        gizmo.hot = if picture.contains_pointer() { grip_at(&layouts, pointer) } else { None };
    } else if let (Some(pressed), true, true) = (pressed, is_pressed_now, picture.is_pointer_button_down_on()) {
        // The place where the button was pressed counts: a quick hand is elsewhere by now. It counts at that moment
        // only: a handle that comes there later, while the camera turns, is not meant.
        if let Some((grip, layout)) = grip_at(&layouts, pressed).and_then(|grip| Some((grip, layouts[grip.0].clone()?)))
        {
            gizmo.hot = Some(grip);
            gizmo.drag = Some(Drag { grip, start: object.clone(), pressed, layout });
        }
    }
    let Some(drag) = &gizmo.drag else { return };
    let moved = dragged(stage, drag, pointer);
    if moved != object {
        actions.push(Action::ChangeObject(id, Box::new(moved)));
    }
}

/// Returns the object so that the dragged handle is under `pointer`.
fn dragged(stage: &PictureFrame, drag: &Drag, pointer: Pos2) -> Object {
    let mut object = drag.start.clone();
    let (place, handle) = drag.grip;
    let Some(&start) = object.places().get(place) else { return object };
    match handle {
        Handle::Arrow(axis) => {
            let along = |at: Pos2| along_axis(stage.ray(at), start, AXES[axis]);
            if let (Some(from), Some(to)) = (along(drag.pressed), along(pointer)) {
                object.move_place(place, AXES[axis] * (to - from));
            }
        }
        Handle::Dot if object.rail(place).is_some() => {
            let rail = object.rail(place).unwrap_or_default();
            let along = |at: Pos2| along_axis(stage.ray(at), start, rail);
            if let (Some(from), Some(to)) = (along(drag.pressed), along(pointer)) {
                object.move_place(place, rail * (to - from));
            }
        }
        Handle::Dot => {
            let on_plane = |at: Pos2| {
                let (origin, direction) = stage.ray(at);
                let facing = stage.lens.forward();
                origin + direction * ((start - origin).dot(facing) / direction.dot(facing))
            };
            let shift = on_plane(pointer) - on_plane(drag.pressed);
            if shift.is_finite() {
                object.move_place(place, shift);
            }
        }
        Handle::Ring(axis) => {
            let angle = drag.layout.rings[axis].as_deref().map_or(0.0, |ring| turned(ring, drag.pressed, pointer));
            object.turn(DQuat::from_axis_angle(AXES[axis], angle));
        }
        Handle::Square => {
            let outward: Vec2 = vec2(1.0, -1.0).normalized();
            object.scale(f64::from(((pointer - drag.pressed).dot(outward) / DOUBLING).exp2()));
        }
    }
    object
}

/// How far along a line from `center` the sight line comes closest to it. `None` if they are nearly parallel.
fn along_axis((origin, direction): (DVec3, DVec3), center: DVec3, axis: DVec3) -> Option<f64> {
    let between = center - origin;
    let cosine = axis.dot(direction);
    let sine_squared = 1.0 - cosine * cosine;
    (sine_squared > 1e-3).then(|| (cosine * direction.dot(between) - axis.dot(between)) / sine_squared)
}

/// The radians by which a drag turns a ring, as if it pulled the ring along its tangent where it was grabbed.
fn turned(ring: &[Pos2], pressed: Pos2, pointer: Pos2) -> f64 {
    let grabbed =
        (0..RING_STEPS).min_by(|a, b| pressed.distance_sq(ring[*a]).total_cmp(&pressed.distance_sq(ring[*b])));
    let step = grabbed.unwrap_or(0);
    // The tangent per radian, measured over the two steps around the grabbed one.
    let before = ring[(step + RING_STEPS - 1) % RING_STEPS];
    let tangent = (ring[step + 1] - before) * (RING_STEPS as f32 / (2.0 * std::f32::consts::TAU));
    let length = tangent.length_sq();
    if length < SHORTEST * SHORTEST {
        return 0.0;
    }
    f64::from((pointer - pressed).dot(tangent) / length)
}

/// Where the symbols of objects are. All are shown while the panel of lights is open or an object with a symbol is
/// selected, else none. A guessed lamp that does not shine has none: nobody has put it there.
fn symbols(session: &Session, stage: &PictureFrame) -> Vec<(ObjectId, Pos2, Color32)> {
    let has_symbol = |object: &Object| object.kind().has_symbol;
    let is_selected = selected(session).is_some_and(|(.., object)| has_symbol(&object));
    let is_dark = session.scene.objects.has_guess() && session.loaded.lighting(&session.scene) != Lighting::Lights;
    if !is_selected && (is_dark || !session.tools.light_panel_is_open) {
        return Vec::new();
    }
    let objects = session.scene.objects.all().filter(|(.., object)| has_symbol(object));
    objects.filter_map(|(id, _, object)| Some((id, stage.place(object.places()[0])?, color_of(&object)))).collect()
}

/// The colour that an object reflects or sends out, as bright as the screen can show it.
fn color_of(object: &Object) -> Color32 {
    let color = match object {
        Object::Mirror(mirror) => mirror.color,
        Object::Light(light) => light.intensity,
        _ => [1.0; 3],
    };
    let strongest = color.into_iter().fold(f32::MIN_POSITIVE, f32::max);
    let [red, green, blue] = color.map(|part| part / strongest);
    egui::Rgba::from_rgb(red, green, blue).into()
}

/// Draws a lamp: a disc and rays.
fn lamp(painter: &Painter, at: Pos2, color: Color32, is_hot: bool) {
    let size = if is_hot { SYMBOL + 1.5 } else { SYMBOL };
    for (width, color) in [(3.5, Color32::from_black_alpha(150)), (1.5, color)] {
        for ray in 0..8 {
            let direction = Vec2::angled(ray as f32 * std::f32::consts::FRAC_PI_4);
            painter.line_segment([at + direction * size * 0.75, at + direction * size], Stroke::new(width, color));
        }
        painter.circle_filled(at, size * 0.45 + width * 0.5, color);
    }
    if is_hot {
        painter.circle_stroke(at, size + 3.0, Stroke::new(1.5, theme::ACCENT));
    }
}

/// Draws the handles of the selected object, and the symbols of lights.
pub fn paint(painter: &Painter, rect: Rect, session: &Session) {
    let Some(stage) = PictureFrame::of(session, rect) else { return };
    let painter = painter.with_clip_rect(rect);
    let (selected, gizmo) = (selected(session), Gizmo::remembered(painter.ctx()));
    if let Some((.., object @ Object::Light(light))) = &selected {
        outlines::cone(&painter, &stage, light, color_of(object));
    }
    if let Some((.., Object::Clip(clip))) = &selected {
        outlines::border(&painter, &stage, clip);
    }
    if let Some(draft) = &session.tools.prism {
        outlines::polygon(&painter, &stage, &draft.corners);
    }
    for (id, at, color) in symbols(session, &stage) {
        lamp(&painter, at, color, gizmo.hot_light == Some(id));
    }
    let Some((_, name, object)) = selected.filter(|_| !session.tools.is_drawing()) else { return };
    let held = gizmo.drag.as_ref().map(|drag| drag.grip);
    let hot = held.or(gizmo.hot);
    let layouts = layouts(&object, &stage, session.tools.handles);
    let places: Vec<Pos2> = layouts.iter().flatten().map(|layout| layout.center).collect();
    for (place, layout) in layouts.into_iter().enumerate() {
        let Some(layout) = layout else { continue };
        // While a handle is dragged, those at other places would be in the way.
        let at_place = |grip: Grip| (grip.0 == place).then_some(grip.1);
        if held.is_none_or(|held| held.0 == place) {
            paint_layout(&painter, &layout, held.and_then(at_place), hot.and_then(at_place));
        }
        if place == 0 && !has_label(&object) {
            name_tag(&painter, &layout, &places, &name);
        }
    }
}

/// Whether the picture already shows the object's name beside it.
fn has_label(object: &Object) -> bool {
    object.kind().is_over_picture && object.is_on()
}

/// Writes the name below the handles, and below a dot that is at one of `places` there.
fn name_tag(painter: &Painter, layout: &Layout, places: &[Pos2], name: &str) {
    let name = painter.layout_no_wrap(name.to_string(), egui::FontId::proportional(12.0), Color32::WHITE);
    let mut corner = pos2(layout.center.x - name.size().x * 0.5, layout.center.y + ARROW as f32 + 16.0);
    let area = Rect::from_min_size(corner, name.size()).expand(8.0);
    let covered = places.iter().filter(|place| area.contains(**place)).map(|place| place.y + 10.0);
    corner.y = covered.fold(corner.y, f32::max);
    painter.rect_filled(Rect::from_min_size(corner, name.size()).expand(3.0), 3.0, Color32::from_black_alpha(130));
    painter.galley(corner, name, Color32::WHITE);
}

fn paint_layout(painter: &Painter, layout: &Layout, held: Option<Handle>, hot: Option<Handle>) {
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
}

#[cfg(test)]
mod tests {
    use cloud::Bounds;
    use scene::{Camera, Clip, ClipShape, Mirror, Projection, Shape, ViewSettings};

    use super::*;
    use crate::viewer::objects::spot;

    fn stage(projection: Projection) -> PictureFrame {
        let camera =
            Camera::looking(DVec3::new(635_000.0, 848_000.0, 40.0), DVec3::new(0.7, -1.0, 0.5), 12.0, DVec3::Z);
        let view = ViewSettings { projection, ..ViewSettings::default() };
        // A screen with two pixels per point of the window.
        let rect = Rect::from_min_size(pos2(310.0, 20.0), vec2(800.0, 600.0));
        PictureFrame::new(Lens::new(&camera, &view, [1600, 1200]), [1600, 1200], rect)
    }

    fn mirror() -> Mirror {
        Mirror::standing(Shape::Sphere, DVec3::new(635_001.0, 848_000.5, 40.0), DVec3::Z, DVec3::Z, 0.8)
    }

    fn drag(stage: &PictureFrame, handle: Handle, pressed: Pos2) -> Drag {
        grab(stage, Object::Mirror(mirror()), (0, handle), pressed)
    }

    fn grab(stage: &PictureFrame, start: Object, grip: Grip, pressed: Pos2) -> Drag {
        let layout = layouts(&start, stage, Handles::All).swap_remove(grip.0).unwrap();
        Drag { grip, start, pressed, layout }
    }

    fn layout(stage: &PictureFrame, handles: Handles) -> Layout {
        layouts(&Object::Mirror(mirror()), stage, handles).remove(0).unwrap()
    }

    fn as_mirror(object: Object) -> Mirror {
        match object {
            Object::Mirror(mirror) => mirror,
            _ => panic!("a mirror became something else"),
        }
    }

    fn found(layout: &Layout, pointer: Pos2) -> Option<Handle> {
        layout.at(pointer).map(|(_, handle)| handle)
    }

    #[test]
    fn what_is_grabbed_stays_under_the_cursor() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let stage = stage(projection);
            for axis in 0..3 {
                let end = layout(&stage, Handles::All).arrows[axis].unwrap();
                let drag = drag(&stage, Handle::Arrow(axis), end);
                // The cursor moves along the arrow on the screen and off it. Only the way along it counts.
                let center = drag.layout.center;
                let along = end - center;
                let moved = as_mirror(dragged(&stage, &drag, end + along * 1.5));
                let shift = moved.position - mirror().position;
                assert!(shift.dot(AXES[axis]) > 0.0 && shift.cross(AXES[axis]).length() < 1e-6, "{axis}: {shift}");
                let units = stage.units(mirror().position).unwrap();
                let tip = stage.place(moved.position + AXES[axis] * (ARROW * units)).unwrap();
                assert!(tip.distance(end + along * 1.5) < 0.1, "{axis}: {tip} instead of {}", end + along * 1.5);
            }
            let drag = drag(&stage, Handle::Dot, pos2(700.0, 300.0));
            let moved = as_mirror(dragged(&stage, &drag, pos2(750.0, 260.0)));
            let place = |mirror: &Mirror| stage.place(mirror.position).unwrap();
            assert!((place(&moved) - place(&mirror()) - vec2(50.0, -40.0)).length() < 0.1);
        }
    }

    #[test]
    fn pulling_a_ring_turns_the_mirror_with_it() {
        let stage = stage(Projection::Orthographic);
        for axis in 0..3 {
            let layout = layout(&stage, Handles::All);
            let ring = layout.rings[axis].clone().unwrap();
            for step in [3, 20, 41] {
                let drag = drag(&stage, Handle::Ring(axis), ring[step]);
                let moved = as_mirror(dragged(&stage, &drag, ring[step + 1]));
                // The grabbed point has moved to the cursor, but for the bend of the ring.
                let turn = moved.rotation * mirror().rotation.inverse();
                let (turned_axis, angle) = turn.to_axis_angle();
                let expected = std::f64::consts::TAU / RING_STEPS as f64;
                assert!(
                    (angle * turned_axis.dot(AXES[axis]) - expected).abs() < 0.25 * expected,
                    "{axis} {step}: {angle}"
                );
                assert_eq!(moved.position, mirror().position);
            }
        }
    }

    #[test]
    fn the_square_doubles_and_halves() {
        let stage = stage(Projection::Perspective);
        let drag = drag(&stage, Handle::Square, pos2(500.0, 300.0));
        let outward = vec2(1.0, -1.0).normalized() * DOUBLING;
        let size = |offset: Vec2| as_mirror(dragged(&stage, &drag, drag.pressed + offset)).size / mirror().size;
        assert!((size(outward) - 2.0).abs() < 1e-5 && (size(-outward) - 0.5).abs() < 1e-5);
        assert!(size(vec2(-1e6, 1e6)) >= 1e-3, "a mirror must not vanish");
    }

    #[test]
    fn handles_are_found_where_they_are_drawn() {
        let stage = stage(Projection::Perspective);
        let layout = layout(&stage, Handles::All);
        assert_eq!(found(&layout, layout.center), Some(Handle::Dot));
        assert_eq!(found(&layout, layout.square.unwrap()), Some(Handle::Square));
        for axis in 0..3 {
            assert_eq!(found(&layout, layout.arrows[axis].unwrap()), Some(Handle::Arrow(axis)));
        }
        assert_eq!(found(&layout, layout.center + vec2(300.0, 200.0)), None);
        let turning = layouts(&Object::Mirror(mirror()), &stage, Handles::Turn).remove(0).unwrap();
        assert_eq!(found(&turning, turning.center), None);
        assert!(found(&turning, turning.rings[2].as_ref().unwrap()[5]).is_some());
    }

    #[test]
    fn an_arrow_that_points_at_the_eye_cannot_be_grabbed() {
        let camera = Camera::looking(mirror().position, DVec3::X, 12.0, DVec3::Z);
        let rect = Rect::from_min_size(pos2(0.0, 0.0), vec2(800.0, 600.0));
        let stage = PictureFrame::new(Lens::new(&camera, &ViewSettings::default(), [800, 600]), [800, 600], rect);
        let layout = layout(&stage, Handles::All);
        assert!(layout.arrows[0].is_none() && layout.arrows[1].is_some() && layout.arrows[2].is_some());
        assert_eq!(along_axis(stage.ray(pos2(400.0, 300.0)), mirror().position, DVec3::X), None);
    }

    #[test]
    fn a_side_of_a_clip_stays_under_the_cursor_and_the_opposite_one_where_it_is() {
        let bounds = Bounds { min: mirror().position - 1.0, max: mirror().position + 2.0 };
        let clip = Object::Clip(Clip { rotation: mirror().rotation, ..Clip::around(ClipShape::Box, bounds) });
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let stage = stage(projection);
            for side in 1..7 {
                let at = |object: &Object, side: usize| stage.place(object.places()[side]).unwrap();
                let (drag, rail) = (grab(&stage, clip.clone(), (side, Handle::Dot), at(&clip, side)), clip.rail(side));
                let beyond = stage.place(clip.places()[side] + rail.unwrap() * 0.7).unwrap();
                let moved = dragged(&stage, &drag, beyond);
                assert!(at(&moved, side).distance(beyond) < 0.1, "{side}: {} {beyond}", at(&moved, side));
                let opposite = if side % 2 == 1 { side + 1 } else { side - 1 };
                assert!(moved.places()[opposite].distance(clip.places()[opposite]) < 1e-9, "{side}");
            }
            let moving = layouts(&clip, &stage, Handles::Move);
            assert!(moving[0].is_some() && moving[1..].iter().flatten().all(|layout| !layout.dot));
        }
    }

    #[test]
    fn a_guessed_lamp_has_a_symbol_only_while_it_shines() {
        let mut session = Session::with_two_points();
        let pivot = session.scene.camera.pivot;
        let id = session.scene.next_object_id();
        session.scene.objects.guess(id, Some(spot(pivot, session.scene.camera.eye, 60.0)));
        session.tools.light_panel_is_open = true;
        let stage = stage(Projection::Perspective);
        let stage = PictureFrame { lens: session.scene.lens(), ..stage };
        let mut shown = |by, selected| {
            (session.scene.settings.light.by, session.scene.selected) = (by, selected);
            symbols(&session, &stage).len()
        };
        assert_eq!((shown(Lighting::Lights, None), shown(Lighting::Headlight, None)), (1, 0));
        assert_eq!(shown(Lighting::Headlight, Some(id)), 1, "a list selects it all the same");
    }

    #[test]
    fn a_light_is_moved_where_it_stands_and_at_its_target() {
        let stage = stage(Projection::Perspective);
        let light = crate::viewer::objects::spot(
            DVec3::new(635_001.0, 848_000.5, 43.0),
            DVec3::new(635_000.0, 848_000.0, 40.0),
            60.0,
        );
        let places = [light.position, light.target].map(|place| stage.place(place).unwrap());
        let layouts = super::layouts(&Object::Light(light), &stage, Handles::All);
        for (place, at) in places.into_iter().enumerate() {
            assert_eq!(grip_at(&layouts, at), Some((place, Handle::Dot)));
            let drag = grab(&stage, Object::Light(light), (place, Handle::Dot), at);
            let Object::Light(moved) = dragged(&stage, &drag, at + vec2(30.0, -20.0)) else { panic!("no light") };
            let now = [moved.position, moved.target].map(|place| stage.place(place).unwrap());
            assert!((now[place] - at - vec2(30.0, -20.0)).length() < 0.1);
            assert_eq!(now[1 - place], places[1 - place], "the other end stays");
        }
        // The lamp moves up along its arrow, and has no handles that would turn or scale it.
        let end = layouts[0].as_ref().unwrap().arrows[2].unwrap();
        let drag = grab(&stage, Object::Light(light), (0, Handle::Arrow(2)), end);
        let Object::Light(moved) = dragged(&stage, &drag, end - vec2(0.0, 25.0)) else { panic!("no light") };
        let shift = moved.position - light.position;
        assert!(shift.z > 0.0 && shift.truncate().length() < 1e-6 && moved.target == light.target, "{shift}");
        assert!(layouts.iter().flatten().all(|layout| layout.square.is_none() && layout.rings[0].is_none()));
    }
}
