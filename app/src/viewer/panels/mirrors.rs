//! The panel of mirrors: adds, selects, names, copies and deletes them, and edits the numbers of the selected one.

use egui::{RichText, Ui};
use glam::{DQuat, DVec3, EulerRot};
use scene::{METHODS, Method, Mirror, MirrorSurface, Object, REFRACTION, Shape};

use crate::shared::language::{text, translated};
use crate::viewer::look::theme;
use crate::viewer::look::widgets::{
    choice, name_field, name_label, number_field, number_slider, number_slider_in, slider, three,
};
use crate::viewer::objects::ObjectId;
use crate::viewer::panels::marking;
use crate::viewer::requests::action::{Action, Filing};
use crate::viewer::requests::bindings;
use crate::viewer::requests::path_prompt::PathPrompt;
use crate::viewer::session::Session;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        add_menu(ui, actions);
        let is_held = session.tools.inspection.is_some();
        let inspect = ui.selectable_label(is_held, text!("Inspect")).on_hover_text(text!(
            "A mirror that follows the cursor and shows what faces away ({shortcut})",
            shortcut = bindings::shortcut(&Action::Inspect)
        ));
        if inspect.clicked() {
            actions.push(Action::Inspect);
        }
        let save = ui.button(text!("Save scene")).on_hover_text(text!(
            "Clouds, camera, parameters and mirrors as a file ({shortcut})",
            shortcut = bindings::shortcut(&Action::File(Filing::Save))
        ));
        if save.clicked() {
            actions.push(Action::File(Filing::Save));
        }
    });
    inspection(ui, session, actions);
    list(ui, session, actions);
    if let Some((id, mirror)) =
        session.scene.selected.and_then(|id| Some((id, session.scene.objects.mirror(id)?.clone())))
    {
        ui.separator();
        ui.push_id(id.0, |ui| numbers(ui, session, id, mirror, actions));
    }
    ui.add_space(4.0);
    egui::CollapsingHeader::new(text!("Turn points into a mirror"))
        .id_salt("marking")
        .show_unindented(ui, |ui| marking::show(ui, session, actions));
}

fn add_menu(ui: &mut Ui, actions: &mut Vec<Action>) {
    ui.menu_button(text!("Add"), |ui| {
        for shape in Shape::WITH_FORMULA {
            let help = text!("At the picked point, or at the pivot");
            if ui.button(capitalized(translated(shape.name()))).on_hover_text(help).clicked() {
                actions.push(Action::AddMirror(shape));
            }
        }
        ui.separator();
        if ui.button(text!("Mesh file…")).on_hover_text(text!("The faces of a PLY file as a mirror")).clicked() {
            actions.push(Action::ChangePrompt(Box::new(PathPrompt::for_mesh())));
        }
        if ui.button(text!("Cloud file…")).on_hover_text(text!("Opens a cloud whose points are the mirror")).clicked()
        {
            actions.push(Action::ChangePrompt(Box::new(PathPrompt::for_mirror_points())));
        }
    });
}

fn capitalized(name: &str) -> String {
    name[..1].to_uppercase() + &name[1..]
}

fn inspection(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let Some(before) = session.tools.inspection.as_ref().map(|held| held.pose) else { return };
    let mut pose = before;
    ui.label(RichText::new(text!("Click pins it, Esc takes it away.")).small().color(theme::WEAK));
    slider(ui, text!("Distance"), number_slider(&mut pose.distance, 0.005..=0.9).logarithmic(true))
        .on_hover_text(text!("From the surface, as a share of the way to the eye"));
    let mut tilt = pose.tilt.to_degrees();
    if slider(ui, text!("Tilt"), number_slider_in(&mut tilt, -170.0..=170.0, "°")).changed() {
        pose.tilt = tilt.to_radians();
    }
    slider(ui, text!("Size"), number_slider(&mut pose.size, 0.01..=0.5).logarithmic(true))
        .on_hover_text(text!("Half its width, as a share of the way to the eye"));
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Bulged"));
        ui.checkbox(&mut pose.is_bulged, "").labelled_by(label.id);
    });
    ui.separator();
    if pose != before {
        actions.push(Action::ChangeInspection(pose));
    }
}

fn list(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    if session.scene.objects.mirrors.is_empty() {
        ui.label(RichText::new(text!("No mirrors.")).color(theme::WEAK));
    }
    let mirrors = session.scene.objects.mirrors.iter().map(|placed| (placed.id, placed.mirror.name.clone()));
    object_list(ui, session, mirrors.collect(), actions);
}

/// Draws a row for each mirror or light: a click on the name selects it, buttons copy and delete it.
pub fn object_list(ui: &mut Ui, session: &Session, objects: Vec<(ObjectId, String)>, actions: &mut Vec<Action>) {
    for (id, name) in objects {
        ui.push_id(id.0, |ui| {
            ui.horizontal(|ui| {
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    let delete = ui.small_button("×").on_hover_text(text!("Delete"));
                    if delete.accessible_name(text!("Delete {name}", name)).clicked() {
                        actions.extend([Action::Select(Some(id)), Action::Delete]);
                    }
                    if ui.small_button(text!("Copy")).accessible_name(text!("Copy {name}", name)).clicked() {
                        actions.extend([Action::Select(Some(id)), Action::Duplicate]);
                    }
                    ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                        let is_selected = session.scene.selected == Some(id);
                        if ui.selectable_label(is_selected, &name).clicked() {
                            actions.push(Action::Select(if is_selected { None } else { Some(id) }));
                        }
                    });
                });
            });
        });
    }
}

/// Edits the numbers of a mirror. A change is taken only if the numbers still describe a mirror.
fn numbers(ui: &mut Ui, session: &Session, id: ObjectId, mut mirror: Mirror, actions: &mut Vec<Action>) {
    let before = mirror.clone();
    let step = mirror.size * 0.01;
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Name"));
        let free_name = |wanted: &str| session.scene.objects.free_name("mirror", wanted, Some(id));
        name_field(ui, &mut mirror.name, 150.0, free_name).labelled_by(label.id);
    });
    if let Some(position) = three(ui, text!("Position"), mirror.position, step, "") {
        mirror.position = position;
    }
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Size"));
        let drag = number_field(&mut mirror.size).speed(step).range(1e-9..=1e9).max_decimals(6);
        ui.add(drag).labelled_by(label.id);
    });
    let angles = remembered_angles(ui, mirror.rotation, session.up());
    if let Some(angles) = three(ui, text!("Yaw pitch roll"), angles, 0.5, "°") {
        mirror.rotation = from_angles(angles, session.up());
        remember_angles(ui, mirror.rotation, angles);
    }
    match &mut mirror.shape {
        Shape::Plane { height } => {
            drop(slider(ui, text!("Height"), number_slider(height, 0.01..=10.0).logarithmic(true)))
        }
        Shape::Cylinder { height } => {
            slider(ui, text!("Height"), number_slider(height, 0.01..=100.0).logarithmic(true));
        }
        Shape::Paraboloid { focal_length } => {
            slider(ui, text!("Focal length"), number_slider(focal_length, 0.05..=50.0).logarithmic(true));
        }
        Shape::Torus { tube } => drop(slider(ui, text!("Tube"), number_slider(tube, 0.01..=0.99))),
        Shape::Mesh(mesh) => {
            ui.label(RichText::new(&mesh.name).color(theme::WEAK));
            if session.scene.settings.mirror.surface == MirrorSurface::Exact {
                let told = text!("Drawn as points: mirror.surface = exact needs a formula, which a mesh lacks.");
                ui.label(RichText::new(told).small().color(theme::WEAK));
            }
        }
        Shape::Sphere | Shape::Blob | Shape::Coral => {}
    }
    slider(ui, text!("Reflectance"), number_slider(&mut mirror.specular_intensity, 0.0..=1.0))
        .on_hover_text(text!("Share of the light that is reflected; the rest is diffuse"));
    slider(ui, text!("Specular power"), number_slider(&mut mirror.specular_power, 0.0..=100_000.0).logarithmic(true))
        .on_hover_text(text!("Sharpness of the highlights that it shows of lights; 0: none"));
    if mirror.shape.has_formula() {
        refraction(ui, &mut mirror.refraction);
    }
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Colour"));
        egui::color_picker::color_edit_button_rgb(ui, &mut mirror.color).labelled_by(label.id);
    })
    .response
    .on_hover_text(text!("Of its diffuse part, and the tint of its reflections"));
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("As points"));
        ui.checkbox(&mut mirror.as_points, "")
            .labelled_by(label.id)
            .on_hover_text(text!("Drawn as points even where its formula could be"));
    });
    let methods = METHODS.iter().filter(|row| ![Method::Auto, Method::None].contains(&row.method));
    let methods = methods.map(|row| (Some(row.method), row.name));
    choice(ui, text!("Method"), &mut mirror.method, std::iter::once((None, text!("as the scene"))).chain(methods))
        .on_hover_text(text!(
            "What finds that which it shows; else reflection.method (reflection.own_methods turns it off)"
        ));
    if mirror != before && mirror.problem().is_none() {
        actions.push(Action::ChangeObject(id, Box::new(Object::Mirror(mirror))));
    }
}

/// Edits whether light goes through a mirror, and how much it bends.
pub fn refraction(ui: &mut Ui, refraction: &mut Option<f32>) {
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Glass or water"));
        let mut is_clear = refraction.is_some();
        ui.checkbox(&mut is_clear, "")
            .labelled_by(label.id)
            .on_hover_text(text!("Light goes through, as through glass and water: at a flat angle more is reflected"));
        if is_clear != refraction.is_some() {
            *refraction = is_clear.then_some(GLASS);
        }
    });
    if let Some(index) = refraction {
        slider(ui, text!("Refraction"), number_slider(index, REFRACTION))
            .on_hover_text(text!("Index of refraction: water 1.33, glass 1.5"));
    }
}

/// The index of refraction of window glass.
const GLASS: f32 = 1.5;

/// The order of rotations: yaw about the axis that points up, then pitch about the mirror's x axis, then roll. The
/// angles are in degrees.
fn order(up: DVec3) -> EulerRot {
    if up.y.abs() > up.z.abs() { EulerRot::YXZ } else { EulerRot::ZXY }
}

pub fn from_angles(degrees: DVec3, up: DVec3) -> DQuat {
    let [yaw, pitch, roll] = degrees.to_array().map(f64::to_radians);
    DQuat::from_euler(order(up), yaw, pitch, roll)
}

fn angles(rotation: DQuat, up: DVec3) -> DVec3 {
    let (yaw, pitch, roll) = rotation.to_euler(order(up));
    // Rounding removes -0, digits that come from the conversion only, and others for which fields have no room.
    DVec3::new(yaw, pitch, roll).map(|angle| (angle.to_degrees() * 1e4).round() / 1e4 + 0.0)
}

/// Returns the angles that the user last set, if they still give this rotation: several triples of angles give the same
/// one, and while a person turns one angle the others must stay.
pub fn remembered_angles(ui: &Ui, rotation: DQuat, up: DVec3) -> DVec3 {
    let remembered: Option<(DQuat, DVec3)> = ui.data(|data| data.get_temp(ui.scope_id().with("angles")));
    remembered.filter(|(known, _)| *known == rotation).map_or_else(|| angles(rotation, up), |(_, angles)| angles)
}

pub fn remember_angles(ui: &Ui, rotation: DQuat, angles: DVec3) {
    ui.data_mut(|data| data.insert_temp(ui.scope_id().with("angles"), (rotation, angles)));
}

#[cfg(test)]
mod tests {

    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use scene::MirrorMesh;
    use world::Change;

    use super::*;
    use crate::viewer::loaded::Loaded;
    use crate::viewer::picture::messages::Command;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::work::{Found, Work};

    /// The panel with a scene of two points.
    fn harness() -> Harness<'static, Session> {
        let session = Session::with_two_points();
        Harness::builder().with_size([340.0, 900.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        )
    }

    fn names(harness: &Harness<'static, Session>) -> Vec<String> {
        harness.state().scene.objects.mirrors.iter().map(|placed| placed.mirror.name.clone()).collect()
    }

    fn add(harness: &mut Harness<'static, Session>, shape: &str) {
        harness.get_by_label("Add").click();
        harness.run_ok();
        harness.get_by_label(shape).click();
        harness.run_ok();
    }

    #[test]
    fn mirrors_are_added_copied_deleted_and_come_back_by_undo() {
        let mut harness = harness();
        harness.run_ok();
        add(&mut harness, "Sphere");
        assert_eq!(names(&harness), ["sphere"]);
        let added = harness.state().scene.objects.mirrors[0].clone();
        assert_eq!(harness.state().scene.selected, Some(added.id));
        // The mirror spans about a tenth of the scene, and stands on the pivot.
        let radius = harness.state().bounds().radius();
        assert!(added.mirror.size > 0.03 * radius && added.mirror.size < 0.2 * radius, "{}", added.mirror.size);
        harness.get_by_label("Copy sphere").click();
        harness.run_ok();
        assert_eq!(names(&harness), ["sphere", "sphere 2"]);
        harness.get_by_label("Delete sphere").click();
        harness.run_ok();
        assert_eq!(names(&harness), ["sphere 2"]);
        for expected in [&["sphere", "sphere 2"][..], &["sphere"], &[]] {
            harness.state_mut().act(Action::Undo);
            assert_eq!(names(&harness), expected);
        }
        harness.state_mut().act(Action::Redo);
        assert_eq!(harness.state().scene.objects.mirrors[0], added);
    }

    #[test]
    fn while_a_name_is_typed_that_another_mirror_has_it_is_not_taken() {
        let mut harness = harness();
        harness.run_ok();
        add(&mut harness, "Sphere");
        add(&mut harness, "Torus");
        harness.get_by_role_and_label(egui::accesskit::Role::TextInput, "Name").focus();
        harness.run_ok();
        for (typed, expected) in [("sphere", "torus"), ("spheres", "spheres"), ("", "spheres"), ("sphere", "spheres")] {
            harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
            harness.run_ok();
            match typed {
                "" => harness.key_press(egui::Key::Backspace),
                typed => harness.get_by_role_and_label(egui::accesskit::Role::TextInput, "Name").type_text(typed),
            }
            harness.run_ok();
            assert_eq!(names(&harness), ["sphere", expected], "{typed}");
        }
        harness.key_press(egui::Key::Enter);
        harness.run_ok();
        assert_eq!(names(&harness), ["sphere", "sphere 2"], "another is free when the field is left");
    }

    #[test]
    fn a_mirror_becomes_glass_and_opaque_again_by_undo() {
        let mut harness = harness();
        harness.run_ok();
        add(&mut harness, "Sphere");
        let refraction =
            |harness: &Harness<'static, Session>| harness.state().scene.objects.mirrors[0].mirror.refraction;
        assert!(refraction(&harness).is_none() && harness.query_by_label("Refraction").is_none());
        harness.get_by_label("Glass or water").click();
        harness.run_ok();
        assert_eq!(refraction(&harness), Some(GLASS));
        assert!(harness.query_all_by_label("Refraction").next().is_some());
        harness.state_mut().act(Action::Undo);
        assert_eq!(refraction(&harness), None);
    }

    #[test]
    fn a_mirror_gets_a_method_of_its_own_and_loses_it_by_undo() {
        let mut harness = harness();
        harness.run_ok();
        add(&mut harness, "Sphere");
        let method = |harness: &Harness<'static, Session>| harness.state().scene.objects.mirrors[0].mirror.method;
        assert_eq!(method(&harness), None);
        harness.get_by_role_and_label(egui::accesskit::Role::ComboBox, "Method").click();
        harness.run_ok();
        assert!(harness.query_by_label("none").is_none() && harness.query_by_label("auto").is_none());
        harness.get_by_label("environment_map").click();
        harness.run_ok();
        assert_eq!(method(&harness), Some(Method::EnvironmentMap));
        harness.state_mut().act(Action::Undo);
        assert_eq!(method(&harness), None);
    }

    #[test]
    fn every_shape_can_be_added_and_shows_its_numbers() {
        let mut harness = harness();
        harness.run_ok();
        let all = [
            ("Plane", "Height"),
            ("Paraboloid", "Focal length"),
            ("Cylinder", "Height"),
            ("Torus", "Tube"),
            ("Blob", "Size"),
        ];
        for (shape, own) in all {
            add(&mut harness, shape);
            assert!(harness.query_all_by_label(own).next().is_some(), "{shape} has no {own}");
            assert_eq!(harness.state().scene.objects.mirrors.last().unwrap().mirror.problem(), None);
        }
        assert!(names(&harness).contains(&"torus".to_string()));
    }

    #[test]
    fn a_sampled_mirror_is_wanted_once_per_change() {
        let mut harness = harness();
        harness.run_ok();
        add(&mut harness, "Sphere");
        let wanted = |harness: &mut Harness<'static, Session>| {
            let session = harness.state_mut();
            session.with_loaded(Loaded::sync_objects);
            let effects = std::mem::take(&mut session.outside.effects);
            effects.into_iter().find_map(|effect| match effect {
                Effect::Work(Work::SampleMirror { id, mirror, area_per_point }) => Some((id, mirror, area_per_point)),
                _ => None,
            })
        };
        let (id, mirror, area_per_point) = wanted(&mut harness).expect("its points");
        assert!(wanted(&mut harness).is_none(), "asked for twice");
        let samples = world::mirrors::sample(&mirror, area_per_point);
        let result = Ok((mirror.shape.clone(), samples));
        harness.state_mut().on_found(Found::Samples { id, mirror, area_per_point, result });
        assert!(wanted(&mut harness).is_none(), "asked for again");
        harness.state_mut().scene.objects.mirrors[0].mirror.name = "ball".into();
        assert!(wanted(&mut harness).is_none(), "a name is no change");
        harness.state_mut().scene.objects.mirrors[0].mirror.method = Some(Method::EnvironmentMap);
        let session = harness.state_mut();
        session.with_loaded(Loaded::sync_objects);
        let effects = std::mem::take(&mut session.outside.effects);
        let changed = |effect: &Effect| match effect {
            Effect::Render(Command::Change(Change::Mirror { mirror, samples, .. })) => {
                Some((mirror.method, samples.len()))
            }
            _ => None,
        };
        let changes: Vec<_> = effects.iter().filter_map(changed).collect();
        assert!(matches!(changes[..], [(Some(Method::EnvironmentMap), 1..)]), "the new method is drawn");
        assert!(!effects.iter().any(|effect| matches!(effect, Effect::Work(_))), "with the points that are known");
        assert!(wanted(&mut harness).is_none(), "once");
        harness.state_mut().scene.objects.mirrors[0].mirror.size *= 2.0;
        assert!(wanted(&mut harness).is_some(), "a new size is one");
    }

    #[test]
    fn a_mesh_is_read_before_it_is_added_and_one_that_cannot_be_read_is_told_and_taken_away() {
        let mut harness = harness();
        harness.run_ok();
        let session = harness.state_mut();
        session.act(Action::ChangePrompt(Box::new(PathPrompt::for_mesh())));
        session.act(Action::OpenPrompted("gone.ply".into()));
        let is_asked = |effect: &Effect| matches!(effect, Effect::Work(Work::ReadMesh(Shape::Mesh(_))));
        assert!(session.outside.effects.iter().any(is_asked) && session.path_prompt.is_none());
        let count = session.scene.objects.mirrors.len();
        session.on_found(Found::Mesh(Ok(Shape::Mesh(MirrorMesh::hare()))));
        assert_eq!(session.scene.objects.mirrors.len(), count + 1);
        // A scene file names its mesh, which is read when the mirror's points are made.
        let shape = Shape::Mesh("gone.ply".to_owned().into());
        let mirror = Mirror::standing(shape, DVec3::ZERO, DVec3::Z, DVec3::Z, 1.0);
        let id = session.scene.bring_mirror(mirror.clone(), None, &mut session.outside);
        let result = Err("gone.ply: no such file".to_owned());
        session.on_found(Found::Samples { id, mirror: mirror.clone(), area_per_point: 1.0, result });
        assert!(session.scene.objects.mirror(id).is_none());
        let id = session.scene.bring_mirror(mirror.clone(), None, &mut session.outside);
        let read = MirrorMesh { name: "gone.ply".into(), ..MirrorMesh::hare() };
        let result = Ok((Shape::Mesh(read), Vec::new()));
        session.on_found(Found::Samples { id, mirror, area_per_point: 1.0, result });
        let Some(Shape::Mesh(mesh)) = session.scene.objects.mirror(id).map(|mirror| &mirror.shape) else {
            panic!("the mirror is gone");
        };
        assert!(!mesh.surface.is_empty(), "the triangles would be read again for each place");
    }

    #[test]
    fn a_mesh_says_that_it_is_not_drawn_by_a_formula_where_formulas_are_asked_for() {
        let mut harness = harness();
        let session = harness.state_mut();
        let mirror = Mirror::standing(Shape::Mesh(MirrorMesh::hare()), DVec3::ZERO, DVec3::Z, DVec3::Z, 1.0);
        let id = session.scene.bring_mirror(mirror, None, &mut session.outside);
        session.scene.selected = Some(id);
        for (surface, is_told) in [(MirrorSurface::Exact, true), (MirrorSurface::Points, false)] {
            harness.state_mut().scene.settings.mirror.surface = surface;
            harness.run_ok();
            assert_eq!(harness.query_by_label_contains("needs a formula").is_some(), is_told, "{surface:?}");
        }
    }

    #[test]
    fn angles_come_back_whichever_axis_points_up() {
        for up in [DVec3::Y, DVec3::Z] {
            for degrees in [DVec3::new(30.0, -40.0, 170.0), DVec3::ZERO, DVec3::new(-179.0, 89.0, 3.0)] {
                let back = angles(from_angles(degrees, up), up);
                assert!(back.distance(degrees) < 1e-5, "{degrees} became {back}");
            }
            // Yaw does not turn the up axis.
            let turned = from_angles(DVec3::new(70.0, 0.0, 0.0), up) * up;
            assert!(turned.distance(up) < 1e-12);
        }
    }
}
