//! The panel for light: the choice of lighting, the list of spot lights with the numbers of the selected one, and the
//! parameters that matter for the choice.

use egui::{CollapsingHeader, RichText, Ui};
use render::MOST_LIGHTS;
use scene::{ExposureFit, Lighting, Object, SpotLight};

use crate::shared::language::{english, text, translated};
use crate::viewer::look::theme;
use crate::viewer::look::widgets::{name_label, number_field, number_field_in, three};
use crate::viewer::objects::{ObjectId, PlacedLight};
use crate::viewer::panels::mirrors::object_list;
use crate::viewer::panels::parameters::{parameter, parameters};
use crate::viewer::requests::action::Action;
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;

const CHOICES: [(Lighting, &str, &str); 6] = [
    (
        Lighting::Auto,
        english!("Auto"),
        english!(
            "Lights if there are any, else the data's own colours if they are RGB, else as the surroundings suggest, with fill"
        ),
    ),
    (
        Lighting::Surroundings,
        english!("Surroundings"),
        english!(
            "Lights if there are any, else a sun where the sky is open, else the lamp of the room that one is in, else one at the eye"
        ),
    ),
    (Lighting::Lights, english!("Lights"), english!("The lights in the list below, with shadows")),
    (Lighting::Sun, english!("Sun"), english!("A sun with shadows, and an even sky")),
    (Lighting::Headlight, english!("Headlight"), english!("A lamp at the eye, without shadows")),
    (Lighting::Colors, english!("Raw colours"), english!("The data's own colours, no light")),
];

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.spacing_mut().button_padding.x = 5.0;
        for (by, name, help) in CHOICES {
            let key = if by == Lighting::Colors { Action::ToggleLight } else { Action::NextLight };
            let shortcut = bindings::shortcut(&key);
            let button = ui.selectable_label(session.scene.settings.light.by == by, translated(name));
            if button.on_hover_text(format!("{} ({shortcut})", translated(help))).clicked() {
                actions.push(Action::LightBy(by));
            }
        }
    });
    ui.label(RichText::new(explanation(session)).small().color(theme::WEAK));
    ui.horizontal(|ui| {
        let help = text!(
            "Stands where you are and aims at the pivot, where white reaches the screen's white (short \
            of it by the filmic curve)"
        );
        let shortcut = bindings::shortcut(&Action::AddSpot);
        if ui.button(text!("Spot at the camera")).on_hover_text(format!("{help} ({shortcut})")).clicked() {
            actions.push(Action::AddSpot);
        }
        if session.scene.objects.lights.is_empty() {
            ui.label(RichText::new(text!("No lights.")).color(theme::WEAK));
        }
    });
    let name = |(index, placed): (usize, &PlacedLight)| {
        let unlit = if index < MOST_LIGHTS { "" } else { text!(" (does not shine)") };
        (placed.id, format!("{}{unlit}", session.scene.objects.label(placed.id).unwrap_or_default()))
    };
    object_list(ui, session, session.scene.objects.lights.iter().enumerate().map(name).collect(), actions);
    if let Some((id, light)) = session.scene.selected.and_then(|id| Some((id, *session.scene.objects.light(id)?))) {
        ui.separator();
        ui.push_id(id.0, |ui| numbers(ui, session, id, light, actions));
    }
    ui.separator();
    let settings = &session.scene.settings;
    parameter(ui, &settings.light, "show", actions);
    let lighting = session.loaded.lighting(&session.scene);
    if lighting == Lighting::Headlight {
        parameter(ui, &settings.light, "headlight", actions);
    }
    if lighting == Lighting::Sun {
        part(ui, english!("Sun and sky"), true, |ui| parameters(ui, &settings.sun, &[], actions));
    }
    if matches!(lighting, Lighting::Sun | Lighting::Lights) {
        part(ui, english!("Indirect light"), false, |ui| parameters(ui, &settings.gi, &[], actions));
        part(ui, english!("Shadows and highlights"), false, |ui| {
            parameters(ui, &settings.light, &["by", "show", "headlight"], actions);
        });
    }
    if lighting != Lighting::Colors {
        part(ui, english!("Tone"), false, |ui| {
            parameters(ui, &settings.tone, &[], actions);
            exposure(ui, session, actions);
        });
    }
    part(ui, english!("Eye-dome lighting"), false, |ui| parameters(ui, &settings.edl, &[], actions));
}

/// Shows the exposure that was fitted to the picture, which can be locked.
fn exposure(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let Some(fitted) = session.frames.shown.as_ref().and_then(|shown| shown.stats.exposure) else { return };
    ui.horizontal(|ui| {
        ui.label(
            RichText::new(text!("Fitted: {stops} stops", stops = format_args!("{:+.2}", fitted.stops)))
                .small()
                .color(theme::WEAK),
        );
        if ui
            .small_button(text!("Lock"))
            .on_hover_text(text!("The exposure stays as it is now, whatever is seen"))
            .clicked()
        {
            let mut settings = session.scene.settings.clone();
            (settings.tone.fit, settings.tone.exposure) = (ExposureFit::Locked, fitted.stops.clamp(-10.0, 10.0));
            actions.push(Action::ChangeSettings(Box::new(settings)));
        }
    });
}

/// Explains which light results from the choice.
fn explanation(session: &Session) -> &'static str {
    let by = session.scene.settings.light.by;
    let is_auto = matches!(by, Lighting::Auto | Lighting::Surroundings);
    let lights = &session.scene.objects.lights;
    match session.loaded.lighting(&session.scene) {
        Lighting::Lights if lights.is_empty() => text!("There is no light in the scene: it is dark."),
        Lighting::Lights if is_auto && session.scene.objects.has_guess() => {
            text!("A closed room without a light: a lamp is guessed.")
        }
        Lighting::Lights if is_auto => text!("The scene has lights."),
        Lighting::Lights => text!("The lights of the scene."),
        Lighting::Sun if is_auto => text!("No lights in the scene, and the sky is open."),
        Lighting::Sun => text!("A sun and a sky."),
        Lighting::Colors if by == Lighting::Auto => text!("The scan's own colours; press U for light."),
        _ if is_auto && session.loaded.is_loading() => text!("A lamp at the eye until everything is read."),
        _ if is_auto && session.scene.objects.has_guess() => {
            text!("A lamp at the eye; in the room, the lamp that is guessed.")
        }
        Lighting::Headlight if is_auto => text!("No lights in the scene: a lamp at the eye."),
        Lighting::Headlight | Lighting::Auto | Lighting::Surroundings => text!("A lamp at the eye."),
        Lighting::Colors => text!("Data colours, no light."),
    }
}

/// Draws a part that can be folded, by its English title.
fn part(ui: &mut Ui, title: &str, is_open: bool, contents: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(translated(title)).id_salt(title).default_open(is_open).show_unindented(ui, contents);
}

/// Edits the numbers of a light. A change is taken only if the numbers still describe a light.
fn numbers(ui: &mut Ui, session: &Session, id: ObjectId, mut light: SpotLight, actions: &mut Vec<Action>) {
    let before = light;
    let step = light.position.distance(light.target) * 0.01;
    for (name, place) in [(text!("Position"), &mut light.position), (text!("Target"), &mut light.target)] {
        *place = three(ui, name, *place, step, "").unwrap_or(*place);
    }
    let strength = light.intensity.into_iter().fold(0.0, f32::max);
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Intensity"));
        let mut edited = strength;
        // Editing stops above 0, where the light would lose its colour. To show a light of strength 0 does not change
        // it.
        let drag = number_field(&mut edited).range(1e-6..=1e12).clamp_existing_to_range(false);
        let drag = drag.speed((strength * 0.01).max(1e-3));
        let is_edited =
            ui.add(drag).labelled_by(label.id).on_hover_text(text!("Radiant intensity, per steradian")).changed();
        let color = light.intensity.map(|part| if strength > 0.0 { part / strength } else { 1.0 });
        let mut picked = color;
        let button = egui::color_picker::color_edit_button_rgb(ui, &mut picked);
        if button.on_hover_text(text!("Its colour")).changed() {
            light.intensity = hue(picked).unwrap_or(color).map(|part| part * strength);
        } else if is_edited {
            light.intensity = color.map(|part| part * edited);
        }
    });
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Cone"));
        let angle = |value| number_field_in(value, "°").speed(0.2).max_decimals(3).clamp_existing_to_range(false);
        let (inner, outer) = (light.inner_degrees, light.outer_degrees);
        let inner_drag = angle(&mut light.inner_degrees).range(0.0..=outer);
        ui.add(inner_drag).labelled_by(label.id).on_hover_text(text!("From the axis: as bright as it gets up to here"));
        let outer_drag = angle(&mut light.outer_degrees).range(inner.max(0.1)..=SpotLight::WIDEST_DEGREES);
        ui.add(outer_drag)
            .on_hover_text(text!("From the axis: dark from here on"))
            .accessible_name(text!("Angle of the outer cone"));
    });
    ui.horizontal(|ui| {
        if ui
            .button(text!("Move to camera"))
            .on_hover_text(text!("It stands where you are and aims at the pivot"))
            .clicked()
        {
            (light.position, light.target) = (session.scene.camera.eye, session.scene.camera.pivot);
        }
        if ui
            .button(text!("Look from it"))
            .on_hover_text(text!("You stand where it is and look at its target"))
            .clicked()
        {
            actions.push(Action::LookAlong { eye: light.position, pivot: light.target });
        }
    });
    if light != before {
        actions.push(Action::ChangeObject(id, Box::new(Object::Light(light))));
    }
}

/// Scales a colour so that its strongest part is 1; picking a colour then keeps the intensity. `None` for black, which
/// has no hue.
fn hue(picked: [f32; 3]) -> Option<[f32; 3]> {
    let strongest = picked.into_iter().fold(0.0, f32::max);
    (strongest > 0.0).then(|| picked.map(|part| part / strongest))
}

#[cfg(test)]
mod tests {

    use cloud::Bounds;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;
    use scene::{Room, Surroundings};
    use world::AutoLight;

    use super::*;
    use crate::viewer::objects::{GUESSED_LAMP, Origin, spot};
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::work::{Found, Work};

    fn lighting(session: &Session) -> Lighting {
        session.loaded.lighting(&session.scene)
    }

    fn light_of(surroundings: Surroundings) -> AutoLight {
        AutoLight { surroundings: Some(surroundings), ..AutoLight::default() }
    }

    fn harness() -> Harness<'static, Session> {
        let mut harness = Harness::builder().with_size([340.0, 900.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            Session::with_two_points(),
        );
        harness.run_ok();
        harness
    }

    fn names(session: &Session) -> Vec<&str> {
        session.scene.objects.lights.iter().map(|placed| placed.name.as_str()).collect()
    }

    /// Answers the session's last request for the surroundings, as a worker thread would.
    fn answer(session: &mut Session, found: Surroundings) {
        let asked = std::mem::take(&mut session.outside.effects).into_iter().rev().find_map(|effect| match effect {
            Effect::Work(Work::FindSurroundings { asked, .. }) => Some(asked),
            _ => None,
        });
        session.on_found(Found::Surroundings {
            asked: asked.expect("the surroundings are asked for"),
            found: light_of(found),
        });
    }

    /// A room around the camera.
    fn room(session: &Session) -> Surroundings {
        let lamp = spot(DVec3::new(5.0, 5.0, 2.7), DVec3::new(5.0, 5.0, 0.0), 140.0);
        let (eye, half) = (session.scene.camera.eye, DVec3::ONE);
        let inside = Bounds { min: eye - half, max: eye + half };
        Surroundings::Room(Room { lamp, inside, eye, pivot: session.scene.camera.pivot })
    }

    #[test]
    fn a_spot_at_the_camera_takes_one_click_shines_and_is_undone() {
        let mut harness = harness();
        assert!(harness.query_by_label("No lights.").is_some());
        harness.get_by_label("Spot at the camera").click();
        harness.run_ok();
        let session = harness.state();
        let added = session.scene.objects.lights[0].clone();
        assert_eq!((session.scene.selected, lighting(session)), (Some(added.id), Lighting::Lights));
        assert_eq!((added.light.position, added.light.target), (session.scene.camera.eye, session.scene.camera.pivot));
        assert_eq!(added.light.problem(), None);
        harness.get_by_label("Copy 1: spot").click();
        harness.run_ok();
        assert_eq!(names(harness.state()), ["spot", "spot"]);
        harness.get_by_label("Delete 1: spot").click();
        harness.run_ok();
        assert_eq!(names(harness.state()), ["spot"]);
        assert!(harness.query_by_label("1: spot").is_some(), "the list numbers lights as tracks do");
        for expected in [&["spot", "spot"][..], &["spot"], &[]] {
            harness.state_mut().act(Action::Undo);
            assert_eq!(names(harness.state()), expected);
        }
        harness.state_mut().act(Action::Redo);
        assert_eq!(harness.state().scene.objects.lights, [added]);
    }

    #[test]
    fn white_has_radiance_one_where_a_spot_aims() {
        let (eye, pivot) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, -2.0, 3.0));
        let light = spot(eye, pivot, 60.0);
        let irradiance = f64::from(light.intensity[0]) / eye.distance_squared(pivot);
        assert!((irradiance / std::f64::consts::PI - 1.0).abs() < 1e-6);
        assert!((30.0 - light.outer_degrees).abs() < 1e-4 && light.inner_degrees < light.outer_degrees);
        for field_of_view in [1.0, 150.0] {
            assert_eq!(spot(eye, pivot, field_of_view).problem(), None);
        }
    }

    #[test]
    fn a_light_that_is_added_shines_whatever_was_chosen_before() {
        for by in [Lighting::Auto, Lighting::Sun, Lighting::Headlight, Lighting::Colors] {
            let mut session = Session::with_two_points();
            session.scene.settings.light.by = by;
            session.scene.history.settle(&session.scene.settings, &session.scene.objects);
            session.act(Action::AddSpot);
            assert_eq!(lighting(&session), Lighting::Lights);
            session.act(Action::Undo);
            assert_eq!(
                (session.scene.settings.light.by, session.scene.objects.lights.len()),
                (by, 0),
                "one step of undo"
            );
        }
    }

    #[test]
    fn the_fifth_light_is_said_not_to_shine() {
        let mut harness = harness();
        for _ in 0..4 {
            harness.state_mut().act(Action::AddSpot);
        }
        assert!(harness.state().outside.messages.all.is_empty());
        harness.state_mut().act(Action::AddSpot);
        harness.run_ok();
        assert!(harness.state().outside.messages.all.iter().any(|message| message.text.contains("first 4")));
        assert!(harness.query_by_label("5: spot (does not shine)").is_some());
    }

    #[test]
    fn a_picked_colour_leaves_the_intensity() {
        assert_eq!(hue([0.5, 0.25, 0.0]), Some([1.0, 0.5, 0.0]));
        assert_eq!(hue([0.0; 3]), None);
    }

    #[test]
    fn selecting_a_light_does_not_change_it() {
        for (intensity, outer_degrees) in [(0.0, 0.05), (1e-7, 85.0), (12_345.678, 33.333)] {
            let mut harness = harness();
            let session = harness.state_mut();
            session.act(Action::AddSpot);
            let placed = &mut session.scene.objects.lights[0];
            let odd =
                SpotLight { intensity: [intensity; 3], inner_degrees: outer_degrees, outer_degrees, ..placed.light };
            assert_eq!(odd.problem(), None);
            placed.light = odd;
            harness.run_ok();
            assert_eq!(harness.state().scene.objects.lights[0].light, odd);
        }
    }

    #[test]
    fn a_lamp_that_was_deleted_does_not_come_back_of_itself() {
        let mut session = Session::with_two_points();
        let found = room(&session);
        answer(&mut session, found);
        let id = session.scene.objects.lights[0].id;
        session.scene.selected = Some(id);
        session.with_loaded(|loaded, beside| loaded.ask_surroundings(beside));
        answer(&mut session, found);
        assert_eq!(session.scene.objects.lights[0].id, id, "a new answer moves it");
        session.act(Action::Delete);
        session.with_loaded(|loaded, beside| loaded.ask_surroundings(beside));
        answer(&mut session, found);
        assert!(session.scene.objects.lights.is_empty());
        session.act(Action::Undo);
        assert_eq!(names(&session), [GUESSED_LAMP]);
    }

    #[test]
    fn two_equal_lights_of_a_file_are_two_and_those_that_are_there_do_not_come_again() {
        let mut session = Session::with_two_points();
        let light = scene::five_mirrors::light();
        let file = world::Request { lights: vec![light, light], ..Default::default() };
        session.open_request(file.clone());
        assert_eq!(names(&session), ["spot", "spot"]);
        session.open_request(file.clone());
        assert_eq!(names(&session), ["spot", "spot"]);
        // Each step of undo keeps its own lights.
        session.scene.selected = Some(session.scene.objects.lights[0].id);
        session.act(Action::Delete);
        session.scene.selected = Some(session.scene.objects.lights[0].id);
        session.act(Action::Delete);
        session.open_request(file);
        assert_eq!(session.scene.objects.lights.len(), 2);
        session.act(Action::Undo);
        assert_eq!(session.scene.objects.lights.len(), 1);
    }

    #[test]
    fn a_fifth_light_of_a_file_or_a_view_is_said_not_to_shine() {
        let lights = vec![scene::five_mirrors::light(); 5];
        let says =
            |session: &Session| session.outside.messages.all.iter().any(|message| message.text.contains("first 4"));
        let mut session = Session::with_two_points();
        session.open_request(world::Request { lights: lights.clone(), ..Default::default() });
        assert!(says(&session));
        let mut session = Session::with_two_points();
        session.act(Action::Paste(scene::SceneFile { lights, ..Default::default() }.to_text()));
        assert!(says(&session));
    }

    #[test]
    fn a_late_answer_puts_no_lamp_into_an_empty_scene() {
        let mut session = Session::with_two_points();
        let found = room(&session);
        let (hidden, shown) = (session.loaded.clouds[0].key, false);
        session.outside.effects.clear();
        session.with_loaded(|loaded, beside| loaded.set_visible(hidden, shown, beside));
        let asks = |effect: &Effect| matches!(effect, Effect::Work(Work::FindSurroundings { .. }));
        assert!(!session.outside.effects.iter().any(asks), "there is nothing to be seen");
        session.with_loaded(|loaded, beside| loaded.set_visible(hidden, true, beside));
        let asked = session.outside.effects.iter().find_map(|effect| match effect {
            Effect::Work(Work::FindSurroundings { asked, .. }) => Some(*asked),
            _ => None,
        });
        session.with_loaded(|loaded, beside| loaded.remove_cloud(hidden, beside));
        session.on_found(Found::Surroundings { asked: asked.unwrap(), found: light_of(found) });
        assert!(session.scene.objects.lights.is_empty());
    }

    #[test]
    fn a_room_gets_a_lamp_that_becomes_ones_own_when_it_is_changed() {
        let mut harness = harness();
        assert_eq!(lighting(harness.state()), Lighting::Headlight, "nothing is known yet");
        let found = room(harness.state());
        answer(harness.state_mut(), found);
        harness.run_ok();
        assert_eq!((names(harness.state()), lighting(harness.state())), (vec![GUESSED_LAMP], Lighting::Lights));
        harness.state_mut().act(Action::Undo);
        assert_eq!(names(harness.state()), [GUESSED_LAMP], "what comes with a file is no step of undo");
        harness.get_by_label(&format!("1: {GUESSED_LAMP}")).click();
        harness.run_ok();
        harness.get_by_label("Move to camera").click();
        harness.run_ok();
        let session = harness.state();
        assert_eq!((names(session), session.scene.objects.lights[0].origin), (vec!["lamp"], Origin::Person));
        assert_eq!(session.scene.objects.lights[0].light.position, session.scene.camera.eye);
    }

    #[test]
    fn a_guessed_lamp_shines_while_one_is_inside_and_stays_when_another_light_is_added() {
        let mut session = Session::with_two_points();
        let found = room(&session);
        answer(&mut session, found);
        let inside = session.scene.camera;
        session.scene.camera.fly(DVec3::new(0.0, 0.0, -9.0));
        assert_eq!(lighting(&session), Lighting::Headlight, "from outside it would be dark");
        session.scene.settings.light.by = Lighting::Lights;
        assert_eq!(lighting(&session), Lighting::Lights);
        session.scene.settings.light.by = Lighting::Auto;
        session.act(Action::AddSpot);
        assert_eq!((names(&session), lighting(&session)), (vec!["lamp", "spot"], Lighting::Lights));
        session.act(Action::Undo);
        session.scene.camera = inside;
        assert_eq!((names(&session), lighting(&session)), (vec![GUESSED_LAMP], Lighting::Lights));
    }

    #[test]
    fn the_open_sky_lets_the_sun_in_and_other_lights_keep_the_lamp_out() {
        let mut session = Session::with_two_points();
        answer(&mut session, Surroundings::OpenSky);
        assert_eq!(lighting(&session), Lighting::Sun);
        let mut session = Session::with_two_points();
        session.act(Action::AddSpot);
        let found = room(&session);
        answer(&mut session, found);
        assert_eq!(names(&session), ["spot"]);
        // An answer to an older request changes nothing.
        session.on_found(Found::Surroundings { asked: 0, found: light_of(Surroundings::OpenSky) });
        assert!(!session.loaded.sky_is_open());
    }

    #[test]
    fn a_guess_goes_when_a_file_brings_lights_and_when_its_cloud_is_closed() {
        let mut session = Session::with_two_points();
        let found = room(&session);
        answer(&mut session, found);
        session.open_request(world::Request { lights: vec![scene::five_mirrors::light()], ..Default::default() });
        assert_eq!(names(&session), ["spot"]);
        let mut session = Session::with_two_points();
        let found = room(&session);
        answer(&mut session, found);
        session.with_loaded(|loaded, beside| loaded.remove_cloud(loaded.clouds[0].key, beside));
        assert!(session.scene.objects.lights.is_empty());
    }

    #[test]
    fn data_colours_come_and_go_with_one_key() {
        let mut session = Session::with_two_points();
        session.scene.settings.light.by = Lighting::Headlight;
        session.act(Action::ToggleLight);
        assert!(session.is_unlit());
        session.act(Action::ToggleLight);
        assert_eq!(session.scene.settings.light.by, Lighting::Headlight);
        let seen: Vec<Lighting> = (0..6)
            .map(|_| {
                session.act(Action::NextLight);
                session.scene.settings.light.by
            })
            .collect();
        let expected = [
            Lighting::Colors,
            Lighting::Surroundings,
            Lighting::Auto,
            Lighting::Lights,
            Lighting::Sun,
            Lighting::Headlight,
        ];
        assert_eq!(seen, expected);
    }

    #[test]
    fn lights_without_a_light_are_said_to_be_dark_once_it_is_known() {
        let mut session = Session::with_two_points();
        session.scene.settings.light.by = Lighting::Lights;
        let said = |session: &mut Session| {
            session.step(session.outside.now, false);
            let all = session.outside.messages.all.iter();
            all.filter(|message| message.text.contains("the scene has no light, so nothing is lit")).count()
        };
        assert_eq!(said(&mut session), 0, "a room might bring a lamp");
        answer(&mut session, Surroundings::OpenSky);
        assert_eq!([said(&mut session), said(&mut session)], [1, 1]);
        let mut session = Session::with_two_points();
        session.scene.settings.light.by = Lighting::Lights;
        let found = room(&session);
        answer(&mut session, found);
        assert_eq!(said(&mut session), 0, "the lamp of the room shines");
    }

    #[test]
    fn parameters_are_shown_where_they_matter() {
        let mut harness = harness();
        for (by, shown, hidden) in [
            (Lighting::Sun, &["Azimuth", "Indirect light", "Tone"][..], &["Headlight share"][..]),
            (Lighting::Lights, &["Indirect light", "Shadows and highlights"], &["Azimuth"]),
            (Lighting::Colors, &["Eye-dome lighting"], &["Azimuth", "Indirect light", "Tone"]),
        ] {
            harness.state_mut().scene.settings.light.by = by;
            harness.run_ok();
            for title in shown {
                assert!(harness.query_all_by_label(title).next().is_some(), "{by:?} lacks {title}");
            }
            for title in hidden {
                assert!(harness.query_all_by_label(title).next().is_none(), "{by:?} has {title}");
            }
        }
    }

    #[test]
    fn a_view_brings_its_lights_back() {
        let mut session = Session::with_two_points();
        session.act(Action::AddSpot);
        let before = session.scene.objects.lights[0].light;
        session.act(Action::CopyView);
        let Some(Effect::Copy(text)) = session.outside.effects.pop() else { panic!("nothing was copied") };
        let id = session.scene.objects.lights[0].id;
        session.scene.objects.set(id, Object::Light(SpotLight { position: DVec3::splat(9.0), ..before }));
        session.act(Action::Paste(text));
        assert_eq!(session.scene.objects.lights.iter().map(|placed| placed.light).collect::<Vec<_>>(), [before]);
    }
}
