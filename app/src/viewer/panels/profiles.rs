//! Profiles: their list in the panel, and the window that shows one from the side.

use egui::epaint::Mesh;
use egui::{Color32, Pos2, Rect, RichText, Shape, Stroke, Ui, vec2};
use egui_plot::{AxisHints, GridMark, Plot, PlotPoint, PlotTransform};
use glam::DVec3;
use measure::Section;
use scene::{Object, Profile};

use crate::shared::language::{text, translated};
use crate::shared::profile_chart::{self, axis_units, in_brackets};
use crate::shared::profile_intervals::of_reading;
use crate::viewer::jobs::slices::{Slice, SlicePoint};
use crate::viewer::look::theme::{self, grouped};
use crate::viewer::look::widgets::{eye, name_field, name_label, number_field};
use crate::viewer::objects::{ObjectId, PlacedProfile};
use crate::viewer::panels::profile_ruler::{TOO_THIN, length, ruler};
use crate::viewer::requests::action::{Action, Measuring, Profiling};
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;
use crate::viewer::tools::measurements::units;
use crate::viewer::tools::profiles::MOST_STACKED;

/// The most points that are drawn at once: of those that are in view, evenly many are left out.
const MOST_DRAWN: usize = 50_000;
/// How far from a point the mouse still means it, in points of the window.
const REACH: f32 = 10.0;
/// The most names of profiles that are listed over the chart.
const MOST_NAMES: usize = 12;
/// How far apart lines are whose numbers begin to show, and show in full, in points of the window.
const X_LABELS: egui::Rangef = egui::Rangef { min: 24.0, max: 44.0 };
/// Half the width of a point, in points of the window.
const HALF: f32 = 1.1;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let begin = Action::Measuring(Measuring::BeginProfile);
    let help = text!(
        "Click the corners of a line ({begin}); Enter or a double-click ends",
        begin = bindings::shortcut(&begin)
    );
    let add = ui.add_enabled(!session.loaded.clouds.is_empty(), egui::Button::new(text!("Add profile")));
    actions.extend(add.on_hover_text(help).clicked().then_some(begin));
    let profiles = &session.scene.objects.profiles;
    if profiles.is_empty() {
        ui.label(RichText::new(text!("No profile is drawn.")).color(theme::WEAK));
    }
    for PlacedProfile { id, profile } in profiles {
        ui.push_id(id.0, |ui| row(ui, session, *id, profile, actions));
    }
    let selected = session.scene.selected.and_then(|id| profiles.iter().find(|placed| placed.id == id));
    if let Some(PlacedProfile { id, profile }) = selected {
        ui.push_id(("profile", id.0), |ui| details(ui, session, *id, profile, actions));
    }
}

fn row(ui: &mut Ui, session: &Session, id: ObjectId, profile: &Profile, actions: &mut Vec<Action>) {
    let name = profile.name.as_str();
    ui.horizontal(|ui| {
        if eye(ui, profile.on, name).clicked() {
            let switched = Profile { on: !profile.on, ..profile.clone() };
            actions.push(Action::ChangeObject(id, Box::new(Object::Profile(switched))));
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let delete = ui.small_button("×").on_hover_text(text!("Delete {name}", name));
            if delete.accessible_name(text!("Delete {name}", name)).clicked() {
                actions.extend([Action::Select(Some(id)), Action::Delete]);
            }
            let is_in_view = session.tools.profiles.in_view == Some(id);
            let view = ui.selectable_label(is_in_view, RichText::new(text!("From the side")).small());
            if view.on_hover_text(text!("Shows its points by distance along and height")).clicked() {
                actions.push(Action::Profile(Profiling::Look((!is_in_view).then_some(id))));
            }
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                let is_selected = session.scene.selected == Some(id);
                if ui.add(egui::Button::selectable(is_selected, name).truncate()).clicked() {
                    actions.push(Action::Select(if is_selected { None } else { Some(id) }));
                }
            });
        });
    });
}

/// The numbers of the selected profile.
fn details(ui: &mut Ui, session: &Session, id: ObjectId, before: &Profile, actions: &mut Vec<Action>) {
    let mut profile = before.clone();
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Name"));
        let free_name = |wanted: &str| session.scene.objects.free_name("profile", wanted, Some(id));
        name_field(ui, &mut profile.name, 130.0, free_name).labelled_by(label.id);
        let mut bytes = profile.color.map(|share| (share * 255.0).round() as u8);
        if ui.color_edit_button_srgb(&mut bytes).accessible_name(text!("Colour of the profile")).changed() {
            profile.color = bytes.map(|byte| f32::from(byte) / 255.0);
        }
    });
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Thickness"));
        let drag = number_field(&mut profile.width).speed(before.width * 0.01).range(1e-6..=1e9);
        ui.add(drag).labelled_by(label.id);
        if let Some(unit) = axis_units(&units(&session.loaded), session.scene.up(&session.loaded.clouds))[0] {
            ui.label(RichText::new(unit.to_string()).color(theme::WEAK));
        }
    });
    if profile != *before {
        actions.push(Action::ChangeObject(id, Box::new(Object::Profile(profile))));
    }
    // How many copies, and how far apart: kept by the panel alone.
    let memory = ui.scope_id().with("stack");
    let known: Option<(u32, f64)> = ui.data(|data| data.get_temp(memory));
    let (mut count, mut spacing) = known.unwrap_or((4, before.width * 2.0));
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let label = name_label(ui, text!("Copies"));
        ui.add(number_field(&mut count).range(1..=MOST_STACKED)).labelled_by(label.id);
        ui.label(text!("at"));
        let every = ui.add(number_field(&mut spacing).speed(before.width * 0.05).max_decimals(4));
        every
            .accessible_name(text!("Spacing of the copies"))
            .on_hover_text(text!("How far each copy is from the one before"));
        let stack = ui
            .button(text!("Stack"))
            .on_hover_text(text!("Adds so many parallel profiles to the left at this spacing"));
        if stack.clicked() {
            actions.extend([
                Action::Profile(Profiling::Look(Some(id))),
                Action::Profile(Profiling::Stack(count, spacing)),
            ]);
        }
    });
    ui.data_mut(|data| data.insert_temp(memory, (count, spacing)));
}

/// Draws the window of the profile that is in view.
pub fn window(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    let Some(profile) = session.tools.profiles.profile(&session.scene) else { return };
    let mut is_open = true;
    let area = default_area(context, session, profile);
    egui::Window::new(text!("Profile: {profile}", profile = profile.name))
        .id(egui::Id::unique("profile"))
        .open(&mut is_open)
        .default_size(area.size())
        .default_pos(area.min)
        .show(context, |ui| contents(ui, session, profile, actions));
    actions.extend((!is_open).then_some(Action::Profile(Profiling::Look(None))));
}

/// Where the window opens: in that half of the picture in which the line is not.
fn default_area(context: &egui::Context, session: &Session, profile: &Profile) -> Rect {
    let whole = context.content_rect();
    let [width, height] = session.scene.view_size.map(|side| side as f32 / context.pixels_per_point());
    // The picture ends at the right, and its upper end is that of the window.
    let left = (whole.right() - width).max(whole.left()) + 20.0;
    let middle = profile.line.iter().sum::<DVec3>() / profile.line.len().max(1) as f64;
    let at = session.scene.lens().project(middle);
    let is_low = at.is_some_and(|at| at.y > f64::from(session.scene.view_size[1]) * 0.5);
    let size = vec2((width - 40.0).clamp(320.0, 640.0), 300.0);
    let top = if is_low { whole.top() + 20.0 } else { (whole.top() + height - size.y - 60.0).max(20.0) };
    Rect::from_min_size(Pos2::new(left, top), size)
}

fn contents(ui: &mut Ui, session: &Session, profile: &Profile, actions: &mut Vec<Action>) {
    let tool = &session.tools.profiles;
    let memory = ui.scope_id().with("even scale");
    let mut is_even = ui.data(|data| data.get_temp(memory)).unwrap_or(true);
    ui.horizontal(|ui| {
        if ui
            .selectable_label(is_even, "1:1")
            .on_hover_text(text!("Lengths along and up have the same scale"))
            .clicked()
        {
            is_even = !is_even;
        }
        let is_out = tool.ruler.is_some();
        if ui
            .selectable_label(is_out, text!("Ruler"))
            .on_hover_text(text!("Two clicks measure the distance between them"))
            .clicked()
        {
            actions.push(Action::Profile(Profiling::Ruler(!is_out)));
        }
        let help = text!("Shows the other profiles that are switched on behind this one, each in a colour");
        if ui.selectable_label(tool.is_together, text!("All")).on_hover_text(help).clicked() {
            actions.push(Action::Profile(Profiling::Together(!tool.is_together)));
        }
        ui.separator();
        let of = if tool.is_together { text!("all profiles that are shown") } else { text!("the profile") };
        for (ending, help) in [
            ("csv", text!("Writes the points of the files that are in {of} as a table", of)),
            ("laz", text!("Writes the points of the files that are in {of}, with all attributes", of)),
            ("png", text!("Writes a chart of the points that were found in {of}", of)),
            ("svg", text!("Writes a chart of the points that were found in {of}", of)),
        ] {
            let button = ui.add_enabled(!tool.is_writing, egui::Button::new(ending.to_uppercase()).small());
            if button.on_hover_text(help).clicked() {
                actions.push(Action::Profile(Profiling::Save(ending)));
            }
        }
        ui.separator();
        if tool.is_writing {
            ui.add(egui::Spinner::new().size(12.0))
                .on_hover_text(text!("The points are read from the files, and written"));
        }
        status(ui, session);
    });
    ui.data_mut(|data| data.insert_temp(memory, is_even));
    if !tool.others.is_empty() {
        ui.horizontal_wrapped(|ui| {
            for (index, (name, _)) in tool.others.iter().enumerate().take(MOST_NAMES) {
                ui.label(RichText::new(name).small().color(color_behind(index, tool.others.len())));
            }
        });
    }
    let section = Section::new(&profile.line, profile.width, session.up()).ok();
    if let Some(text) = section.as_ref().and_then(|section| picked(session, section)) {
        ui.label(RichText::new(text).small()).on_hover_text(text!(
            "± is the half width of an interval of 95 %: of a place on the surface that is read off this \
                point. How the \
             surface differs across the profile is not in it."
        ));
    }
    match &tool.slice {
        Some(Ok(slice)) => chart(ui, session, section.as_ref(), slice, is_even, actions),
        Some(Err(problem)) => drop(ui.colored_label(theme::ERROR, problem)),
        None => drop(ui.spinner()),
    }
}

/// How many points there are, and which are left out.
fn status(ui: &mut Ui, session: &Session) {
    let Some(Ok(slice)) = &session.tools.profiles.slice else { return };
    let kept = slice.points.len() as u64;
    let count = if kept < slice.total {
        text!("{kept} of {total} points", kept = grouped(kept), total = grouped(slice.total))
    } else {
        text!("{total} points", total = grouped(slice.total))
    };
    let others = &session.tools.profiles.others;
    let all = slice.total + others.iter().map(|(_, other)| other.total).sum::<u64>();
    let count =
        if others.is_empty() { count } else { text!("{count}, {all} with the others", count, all = grouped(all)) };
    let is_streamed = session.loaded.clouds.iter().any(|entry| entry.streamed.is_some() || entry.is_cut);
    let loaded = if is_streamed { text!(" (loaded)") } else { "" };
    let help = text!(
        "At most {most} are drawn at once, evenly chosen from those in view{rest}",
        most = grouped(MOST_DRAWN as u64),
        rest = if is_streamed { text!("; CSV and LAZ have all points of the files") } else { "" }
    );
    ui.label(RichText::new(format!("{count}{loaded}")).small().color(theme::WEAK)).on_hover_text(help);
}

/// The numbers on the axes begin as the coordinates do.
fn chart(
    ui: &mut Ui,
    session: &Session,
    section: Option<&Section>,
    slice: &Slice,
    is_even: bool,
    actions: &mut Vec<Action>,
) {
    let units = axis_units(&units(&session.loaded), session.scene.up(&session.loaded.clouds));
    let [of_along, of_height] = units.map(in_brackets);
    let others = &session.tools.profiles.others;
    let behind = others.iter().flat_map(|(_, other)| &other.points);
    let heights = slice.points.iter().chain(behind).map(|point| point.dot.height);
    let heights = cloud::robust_range(heights, slice.length);
    let mut plot = Plot::new("profile")
        .height(ui.available_height().max(140.0))
        .custom_x_axes(vec![AxisHints::new_x().label(text!("along{unit}", unit = of_along)).label_spacing(X_LABELS)])
        .y_axis_label(text!("height{unit}", unit = of_height))
        .label_formatter(|_| None)
        .y_axis_formatter(|mark: GridMark, _: &std::ops::RangeInclusive<f64>| format!("{}", mark.value as f32))
        .allow_boxed_zoom(false)
        .include_x(0.0)
        .include_x(others.iter().map(|(_, other)| other.length).fold(slice.length, f64::max));
    if let Some((low, high)) = heights {
        plot = plot.include_y(low).include_y(high);
    }
    if is_even {
        plot = plot.data_aspect(1.0);
    }
    let shown = plot.show(ui, |_| ());
    let (transform, response) = (shown.transform, shown.response);
    let painter = ui.painter().with_clip_rect(*transform.frame());
    for (index, (_, other)) in others.iter().enumerate() {
        painter.add(Shape::mesh(dots(other, &transform, Some(color_behind(index, others.len()).gamma_multiply(0.5)))));
    }
    painter.add(Shape::mesh(dots(slice, &transform, None)));
    // What the picture points at, and what is picked there.
    let mark = |world: Option<DVec3>, radius: f32, color: Color32| {
        let placed = section.and_then(|section| section.place(world?));
        if let Some(placed) = placed {
            let at = transform.position_from_point(&PlotPoint::new(placed.along, placed.height));
            painter.circle_stroke(at, radius, Stroke::new(3.0, Color32::BLACK));
            painter.circle_stroke(at, radius, Stroke::new(1.5, color));
        }
    };
    mark(session.scene.hovered(), 6.0, Color32::WHITE);
    mark(session.tools.pick.as_ref().map(|pick| pick.world), 7.0, theme::ACCENT);
    let pointer = response.hover_pos().filter(|at| transform.frame().contains(*at));
    let pointed = pointer.and_then(|pointer| nearest(slice, &transform, pointer));
    if let Some(SlicePoint { dot, .. }) = pointed {
        let at = transform.position_from_point(&PlotPoint::new(dot.along, dot.height));
        painter.circle_stroke(at, 5.0, Stroke::new(1.5, theme::ACCENT));
    }
    let hovered = pointed.map(|point| point.point);
    if hovered != session.tools.profiles.hovered {
        actions.push(Action::Profile(Profiling::Hover(hovered)));
    }
    let at_pointer = pointer.map(|pointer| {
        // A ruler snaps to the points.
        let value = transform.value_from_position(pointer);
        pointed.map_or([value.x, value.y], |point| [point.dot.along, point.dot.height])
    });
    if let (true, Some(place)) = (response.clicked(), at_pointer) {
        match (&session.tools.profiles.ruler, pointed) {
            (Some(_), _) => {
                actions.push(Action::Profile(Profiling::Rule(place, pointed.map(|point| point.point))));
            }
            (None, Some(point)) => actions.push(Action::Profile(Profiling::Pick(point.point))),
            (None, None) => {}
        }
    }
    if let Some(ends) = &session.tools.profiles.ruler {
        ruler(&painter, &transform, ends, at_pointer, section, units);
    }
}

/// Where the picked point is in the profile, with the intervals of what is read there, if it is in it.
fn picked(session: &Session, section: &Section) -> Option<String> {
    let pick = session.tools.pick.as_ref()?;
    let placed = section.place(pick.world)?;
    let [of_along, of_height] = axis_units(&units(&session.loaded), session.up());
    let intervals = pick.error.and_then(|error| of_reading(section, error.place, &error.scatter));
    let [along, height] = [0, 1].map(|axis| intervals.map(|intervals| intervals[axis]));
    let by = match pick.error {
        Some(_) if intervals.is_none() => translated(TOO_THIN),
        Some(error) if error.is_thinned => text!(", by the points that are loaded"),
        _ => "",
    };
    let (along, height) = (length(placed.along, along, of_along), length(placed.height, height, of_height));
    Some(text!("Picked: along {along}   height {height}{by}", along, height, by))
}

fn color_behind(index: usize, count: usize) -> Color32 {
    let [red, green, blue] = profile_chart::color_behind(index, count);
    Color32::from_rgb(red, green, blue)
}

/// The points that are in view as small squares, in one colour or in their own.
fn dots(slice: &Slice, transform: &PlotTransform, color: Option<Color32>) -> Mesh {
    let frame = transform.frame().expand(HALF);
    let mut mesh = Mesh::default();
    let mut count = 0;
    for SlicePoint { dot, .. } in &slice.points {
        let at = transform.position_from_point(&PlotPoint::new(dot.along, dot.height));
        if frame.contains(at) {
            let [red, green, blue] = dot.color;
            mesh.add_colored_rect(
                Rect::from_center_size(at, vec2(HALF, HALF) * 2.0),
                color.unwrap_or(Color32::from_rgb(red, green, blue)),
            );
            count += 1;
            if count == MOST_DRAWN {
                break;
            }
        }
    }
    mesh
}

/// The point that the mouse means: the nearest of those that are drawn.
fn nearest(slice: &Slice, transform: &PlotTransform, pointer: Pos2) -> Option<SlicePoint> {
    let frame = transform.frame();
    let placed = slice
        .points
        .iter()
        .map(|point| (point, transform.position_from_point(&PlotPoint::new(point.dot.along, point.dot.height))));
    let drawn = placed.filter(|(_, at)| frame.contains(*at)).take(MOST_DRAWN);
    let near = drawn.map(|(point, at)| (point, at.distance(pointer))).filter(|(_, distance)| *distance <= REACH);
    near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(point, _)| *point)
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::{DMat2, DVec2};
    use world::Part;

    use super::*;
    use crate::viewer::jobs::slices::ProfileWork;
    use crate::viewer::panels::profile_ruler::measured;
    use crate::viewer::picture::messages::{PickPurpose, PickedPoint, Report};
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::work::Work;

    fn harness(mut session: Session) -> Harness<'static, Session> {
        session.scene.view_size = [400, 300];
        Harness::builder().with_size([900.0, 900.0]).build_ui_state(
            |ui, session: &mut Session| {
                session.show_and_act(|session, actions| {
                    show(ui, session, actions);
                    window(ui.ctx(), session, actions);
                })
            },
            session,
        )
    }

    fn click(session: &mut Session, index: usize) {
        session.act(Action::PointAt(Some([10, 10])));
        session.act(Action::Pick);
        let point = PickedPoint { chunk: session.loaded.clouds[0].key.chunk(Part::Block(0)), index };
        session.on_report(Report::Picked { pixel: [10, 10], purpose: PickPurpose::Corner, point: Some(point) });
    }

    /// Carries out all work until there is none.
    fn work(session: &mut Session) {
        for _ in 0..20 {
            session.step(session.outside.now, false);
            let found = std::cell::RefCell::new(Vec::new());
            for effect in std::mem::take(&mut session.outside.effects) {
                if let Effect::Work(work @ (Work::FindFigures { .. } | Work::Profile(_) | Work::FindPointError(_))) =
                    effect
                {
                    work.run(&scene::Stream::default(), |one| found.borrow_mut().push(one));
                }
            }
            found.into_inner().into_iter().for_each(|found| session.on_found(found));
        }
    }

    fn total(session: &Session) -> u64 {
        session.tools.profiles.slice.as_ref().unwrap().as_ref().unwrap().total
    }

    fn all_texts<'a>(harness: &'a Harness<'_, Session>) -> impl Iterator<Item = &'a str> {
        harness.output().shapes.iter().filter_map(|clipped| match &clipped.shape {
            Shape::Text(text) => Some(text.galley.text()),
            _ => None,
        })
    }

    /// How many texts begin so.
    fn texts(harness: &Harness<'_, Session>, beginning: &str) -> usize {
        all_texts(harness).filter(|text| text.starts_with(beginning)).count()
    }

    /// The first half width in a text that begins so.
    fn half_width(harness: &Harness<'_, Session>, beginning: &str) -> Option<f64> {
        let after = |text: &str| text.split(" ± ").nth(1)?.split_whitespace().next()?.parse().ok();
        all_texts(harness).filter(|text| text.starts_with(beginning)).find_map(after)
    }

    /// A click as egui takes it: the button goes down in one frame and up in another.
    fn click_at(harness: &mut Harness<'static, Session>, pos: Pos2) {
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        harness.hover_at(pos);
        harness.run_steps(2);
        for pressed in [true, false] {
            harness.event(egui::Event::PointerButton { pos, button, pressed, modifiers });
            harness.run_steps(2);
        }
    }

    #[test]
    fn the_mouse_points_at_points_of_the_chart_picks_them_and_measures_between_them() {
        let mut harness = harness(Session::with_two_points());
        harness.run_ok();
        let session = harness.state_mut();
        session.act(Action::Measuring(Measuring::BeginProfile));
        click(session, 0);
        click(session, 1);
        session.act(Action::Measuring(Measuring::End));
        work(session);
        let Some(Ok(slice)) = session.tools.profiles.slice.clone() else { panic!("no points") };
        harness.run_steps(5);
        // Each dot of the chart is a square of four corners.
        let dots: Vec<Pos2> = harness
            .output()
            .shapes
            .iter()
            .filter_map(|clipped| match &clipped.shape {
                Shape::Mesh(mesh) if mesh.vertices.len() == 4 * slice.points.len() => Some(mesh),
                _ => None,
            })
            .flat_map(|mesh| mesh.vertices.chunks(4).map(|dot| dot[0].pos.lerp(dot[3].pos, 0.5)))
            .collect();
        assert_eq!(dots.len(), 2, "the chart has the points of the profile");
        let hovered = |harness: &Harness<'_, Session>| harness.state().tools.profiles.hovered;
        for (at, point) in dots.iter().zip(&slice.points) {
            harness.hover_at(*at + vec2(3.0, -3.0));
            harness.run_steps(2);
            assert_eq!(hovered(&harness), Some(point.point));
        }
        harness.hover_at(dots[0].lerp(dots[1], 0.5));
        harness.run_steps(2);
        assert_eq!(hovered(&harness), None, "there is no point between them");
        click_at(&mut harness, dots[1]);
        let picked = |harness: &Harness<'_, Session>| harness.state().tools.pick.as_ref().map(|pick| pick.point);
        assert_eq!(picked(&harness), Some(slice.points[1].point));
        // With the ruler, clicks measure and pick nothing.
        harness.get_by_label("Ruler").click();
        harness.run_steps(3);
        for at in [dots[0] + vec2(-2.0, 2.0), dots[1] + vec2(2.0, 2.0)] {
            click_at(&mut harness, at);
            harness.run_steps(20);
        }
        let ends: Vec<([f64; 2], PickedPoint)> =
            slice.points.iter().map(|point| ([point.dot.along, point.dot.height], point.point)).collect();
        let ruler = harness.state().tools.profiles.ruler.as_ref().unwrap();
        let snapped: Vec<([f64; 2], PickedPoint)> = ruler.iter().map(|end| (end.at, end.point.unwrap())).collect();
        assert_eq!(snapped, ends, "its ends snap to the points");
        assert_eq!(picked(&harness), Some(slice.points[1].point));
        let length = format!("{:.4}   along", 200_f64.sqrt());
        assert_eq!(texts(&harness, &length), 1, "the chart shows the length");
    }

    #[test]
    fn the_ruler_and_the_picked_point_have_intervals_once_these_are_found() {
        let floor = (0..961).map(|index| [(index % 31) as f32 * 0.1, (index / 31) as f32 * 0.1, 0.0]);
        let mut harness = harness(Session::with_points(floor.collect()));
        harness.run_ok();
        let of_row = |index: usize| 15 * 31 + index;
        let session = harness.state_mut();
        session.act(Action::Measuring(Measuring::BeginProfile));
        click(session, of_row(2));
        click(session, of_row(28));
        session.act(Action::Measuring(Measuring::End));
        work(session);
        let chunk = session.loaded.clouds[0].key.chunk(Part::Block(0));
        let point = |index| PickedPoint { chunk, index: of_row(index) };
        session.act(Action::Profile(Profiling::Pick(point(5))));
        session.act(Action::Profile(Profiling::Ruler(true)));
        session.act(Action::Profile(Profiling::Rule([0.3, 0.0], Some(point(5)))));
        session.act(Action::Profile(Profiling::Rule([2.3, 0.0], Some(point(25)))));
        harness.run_steps(3);
        assert_eq!(texts(&harness, "2.0000   along 2.0000   up 0.0000"), 1);
        assert_eq!(texts(&harness, "Picked: along 0.3000   height 0.0000"), 1);
        assert_eq!(["2.0", "Picked"].map(|beginning| half_width(&harness, beginning)), [None; 2]);
        work(harness.state_mut());
        harness.run_steps(3);
        // The profile is a fiftieth of its length thick, half of the spacing, and so shows a point each 0.19 on average.
        let one = 1.96 * 0.1 * 0.1 / 0.052 * 0.5_f64.sqrt();
        for (beginning, expected) in [("2.0", one * 2.0_f64.sqrt()), ("Picked: along 0.3", one)] {
            let found = half_width(&harness, beginning).unwrap();
            assert!((0.8..1.2).contains(&(found / expected)), "{beginning}: {found}, not {expected}");
        }
        // In a profile so thin that few points are in it, none is stated, and the reason is.
        let session = harness.state_mut();
        let placed = session.scene.objects.profiles[0].clone();
        let thin = Object::Profile(Profile { width: 0.01, ..placed.profile.clone() });
        session.act(Action::ChangeObject(placed.id, Box::new(thin)));
        work(session);
        harness.run_steps(3);
        assert_eq!(texts(&harness, "Picked: along 0.3000   height 0.0000, no ±"), 1);
        assert_eq!(texts(&harness, "2.0000   along 2.0000   up 0.0000, no ±"), 1);
        // An end in a gap has no interval, and neither has what depends on it.
        let session = harness.state_mut();
        session.act(Action::Profile(Profiling::Rule([0.3, 0.0], Some(point(5)))));
        session.act(Action::Profile(Profiling::Rule([1.3, 1.0], None)));
        work(session);
        harness.run_steps(3);
        assert_eq!(texts(&harness, "1.4142   along 1.0000   up 1.0000"), 1);
    }

    #[test]
    fn a_profile_is_drawn_followed_live_measured_stacked_saved_and_undone() {
        let mut harness = harness(Session::with_two_points());
        harness.run_ok();
        harness.get_by_label("Add profile").click();
        harness.run_ok();
        let session = harness.state_mut();
        click(session, 0);
        click(session, 1);
        session.act(Action::Measuring(Measuring::End));
        work(session);
        let placed = session.scene.objects.profiles[0].clone();
        assert_eq!(placed.profile.line, [DVec3::ZERO, DVec3::new(10.0, 10.0, 0.0)]);
        assert_eq!((session.tools.profiles.in_view, total(session)), (Some(placed.id), 2), "it is shown at once");
        let Some(Ok(slice)) = session.tools.profiles.slice.clone() else { panic!("no points") };
        assert!((slice.length - 200_f64.sqrt()).abs() < 1e-12);
        harness.run_steps(3);
        assert_eq!(harness.query_all_by_label("2 points").count(), 1);
        // A point of the profile is one of the picture.
        let session = harness.state_mut();
        session.act(Action::Profile(Profiling::Pick(slice.points[0].point)));
        assert_eq!(session.tools.pick.as_ref().unwrap().point, slice.points[0].point);
        // The slice follows the handles while they are held.
        session.tools.handle_is_grabbed = true;
        let aside: Vec<DVec3> = placed.profile.line.iter().map(|corner| *corner + DVec3::X).collect();
        let moved = Object::Profile(Profile { line: aside, ..placed.profile.clone() });
        session.act(Action::ChangeObject(placed.id, Box::new(moved)));
        work(session);
        assert_eq!(total(session), 0);
        session.tools.handle_is_grabbed = false;
        session.act(Action::Undo);
        work(session);
        assert_eq!(total(session), 2);
        // The ruler begins anew with the third click.
        session.act(Action::Profile(Profiling::Ruler(true)));
        for place in [[0.0, 0.0], [3.0, 4.0], [1.0, 1.0]] {
            session.act(Action::Profile(Profiling::Rule(place, None)));
        }
        let ends: Vec<[f64; 2]> = session.tools.profiles.ruler.iter().flatten().map(|end| end.at).collect();
        assert_eq!(ends, [[1.0, 1.0]]);
        let of = |along, up| measured([0.0, 0.0], [3.0, 4.0], None, [along, up]);
        assert_eq!(of(None, None), "5.0000   along 3.0000   up 4.0000");
        let (metre, feet) = (Some(codec::Unit::Metre), Some(codec::Unit::SurveyFoot));
        assert_eq!(of(metre, metre), "5.0000 m   along 3.0000 m   up 4.0000 m");
        assert_eq!(of(feet, metre), "along 3.0000 ftUS   up 4.0000 m");
        // Deviations of 0.01 along and 0.02 up, and half widths of 1.96 times as much.
        let covariance = DMat2::from_diagonal(DVec2::new(1e-4, 4e-4));
        let text = measured([0.0, 0.0], [3.0, 4.0], Some(covariance), [metre, metre]);
        assert_eq!(text, "5.000 ± 0.033 m   along 3.000 ± 0.020 m   up 4.000 ± 0.039 m");
        session.act(Action::Profile(Profiling::Stack(3, 2.0)));
        assert_eq!(session.scene.objects.profiles.len(), 4);
        // Together, the points of the others lie behind; those beside the cloud have none.
        assert!(session.tools.profiles.others.is_empty());
        session.act(Action::Profile(Profiling::Together(true)));
        work(session);
        let of_others = |session: &Session| -> Vec<(String, u64)> {
            session.tools.profiles.others.iter().map(|(name, slice)| (name.clone(), slice.total)).collect()
        };
        let names: Vec<String> =
            session.scene.objects.profiles[1..].iter().map(|one| one.profile.name.clone()).collect();
        assert_eq!(of_others(session), names.iter().map(|name| (name.clone(), 0)).collect::<Vec<_>>());
        let second = session.scene.objects.profiles[1].clone();
        let wide = Profile { width: 5.0, ..second.profile.clone() };
        session.act(Action::ChangeObject(second.id, Box::new(Object::Profile(wide))));
        work(session);
        assert_eq!((of_others(session)[0].1, total(session)), (2, 2));
        // What is saved is what is shown together.
        let mut saved = |ending: &'static str| {
            session.act(Action::Profile(Profiling::Save(ending)));
            session.tools.profiles.is_writing = false;
            let saved = session.outside.effects.pop();
            match saved {
                Some(Effect::Work(Work::Profile(work))) => match *work {
                    ProfileWork::Write { profiles, .. } => profiles.into_iter().map(|one| one.name).collect(),
                    ProfileWork::Draw { name, others, .. } => {
                        std::iter::once(name).chain(others.iter().map(|(name, _)| name.clone())).collect()
                    }
                    ProfileWork::Cut { .. } => Vec::new(),
                },
                _ => Vec::new(),
            }
        };
        let together: Vec<String> = std::iter::once(&placed.profile.name).chain(&names).cloned().collect();
        assert_eq!((saved("csv"), saved("svg")), (together.clone(), together));
        session.act(Action::Undo);
        session.act(Action::Profile(Profiling::Together(false)));
        work(session);
        assert!(session.tools.profiles.others.is_empty());
        let last = &session.scene.objects.profiles[3].profile;
        let expected = DVec3::new(-1.0, 1.0, 0.0).normalize() * 6.0;
        assert!((last.line[0] - expected).length() < 1e-9, "{last:?}");
        let file = scene::SceneFile::parse(&session.scene.whole_file(&session.loaded).to_text()).unwrap();
        assert_eq!(file.profiles.len(), 4);
        assert_eq!(file.profiles[0], placed.profile);
        session.act(Action::Undo);
        assert_eq!(session.scene.objects.profiles.len(), 1, "the stack is one step");
        session.scene.selected = Some(placed.id);
        session.act(Action::Delete);
        work(session);
        assert_eq!((session.scene.objects.profiles.len(), session.tools.profiles.in_view), (0, None));
        session.act(Action::Undo);
        let told = &session.outside.messages.all;
        assert!(told.iter().any(|message| message.text == "Undone: profile `profile`"), "undo tells");
    }
}
