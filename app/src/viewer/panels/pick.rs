//! The card of the picked point: its coordinates, and everything the file says of it.

use egui::{Align2, RichText, Ui};

use crate::shared::language::text;
use crate::shared::measuring::{PointError, decimals};
use crate::viewer::look::theme;
use crate::viewer::requests::action::Action;
use crate::viewer::session::Session;
use crate::viewer::tools::measurements::units;

/// Draws the card in the lower right corner of the picture, if a point is picked.
pub fn show(context: &egui::Context, rect: egui::Rect, session: &Session, actions: &mut Vec<Action>) {
    if session.tools.pick.is_none() {
        return;
    }
    let mut is_open = true;
    let corner = rect.right_bottom() - egui::vec2(12.0, 12.0);
    egui::Window::new(text!("Picked point"))
        .id(egui::Id::unique("picked point"))
        .open(&mut is_open)
        .collapsible(true)
        .resizable(false)
        .pivot(Align2::RIGHT_BOTTOM)
        .default_pos(corner)
        .constrain_to(rect)
        .default_width(290.0)
        .show(context, |ui| contents(ui, session, actions));
    if !is_open {
        actions.push(Action::ClearPick);
    }
}

fn contents(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    ui.set_width(290.0);
    let Some(pick) = &session.tools.pick else { return };
    ui.horizontal(|ui| {
        ui.add(egui::Label::new(RichText::new(&pick.cloud).strong()).truncate());
        if !pick.is_streamed {
            ui.label(RichText::new(text!("point {number}", number = pick.number)).color(theme::WEAK));
        }
    });
    ui.label(RichText::new(pick.coordinates()).monospace());
    if let Some(error) = pick.error {
        let unit = units(&session.loaded).length().map_or(String::new(), |unit| format!(" {unit}"));
        let PointError { across, sight, is_thinned, .. } = error;
        let told = |length: f64| format!("± {length:.*}{unit}", decimals(length));
        let text = text!(
            "{across} across the surface, {sight} along the line of sight",
            across = told(across),
            sight = told(sight)
        );
        ui.label(RichText::new(text).small()).on_hover_text(text!(
            "The surface lies within, in 19 of 20 cases: from the spacing and the scatter of the points around. Errors \
             that all points share, as those of a registration, are not in it."
        ));
        if is_thinned {
            let text =
                text!("by the points that are loaded: the file has more here; pick again from nearer to be more exact");
            ui.label(RichText::new(text).small().color(theme::WEAK));
        }
    }
    match &pick.record {
        None => {
            ui.horizontal(|ui| {
                ui.spinner();
                ui.label(text!("looking it up in the file"));
            });
        }
        Some(Err(error)) => {
            ui.colored_label(theme::ERROR, error);
        }
        Some(Ok(_)) => {
            egui::ScrollArea::vertical().max_height(260.0).show(ui, |ui| {
                egui::Grid::new("record").num_columns(2).striped(true).spacing([16.0, 2.0]).show(ui, |ui| {
                    // What is 0 says least, and comes last.
                    let mut attributes: Vec<_> = pick.attributes().collect();
                    attributes.sort_by_key(|(_, value)| value.parse() == Ok(0.0));
                    for (name, value) in attributes {
                        let value = if value.is_empty() { text!("no value") } else { value };
                        ui.label(RichText::new(name).size(12.0));
                        ui.add(egui::Label::new(RichText::new(value).monospace().size(11.5)).selectable(true));
                        ui.end_row();
                    }
                });
            });
        }
    }
    if pick.is_streamed {
        let text = text!("A streamed cloud: its pages keep these attributes. The file may have others.");
        ui.label(RichText::new(text).small().color(theme::WEAK));
    }
    ui.horizontal(|ui| {
        if ui.button(text!("Copy")).clicked() {
            actions.push(Action::CopyPick);
        }
        if ui.button(text!("Close")).on_hover_text(text!("Forgets the picked point")).clicked() {
            actions.push(Action::ClearPick);
        }
    });
}

#[cfg(test)]
pub mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;
    use measure::Scatter;
    use world::{CloudKey, Part};

    use super::*;
    use crate::viewer::picture::messages::PickedPoint;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::pick::Pick;
    use crate::viewer::requests::preferences::Preferences;

    pub fn pick(world: DVec3) -> Pick {
        // The coordinates of the file, and a column of another thing that has the name of one.
        let record = [("X", "3"), ("y", "0.0"), ("returns", "0"), ("Z", "-400"), ("intensity", "1234")];
        let places = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE];
        let error = PointError {
            across: 0.00612,
            sight: 0.0123,
            place: world,
            scatter: Scatter::around(DVec3::ZERO, &places).expect("a plane"),
            reach: 0.1,
            is_thinned: false,
        };
        let record = Some(Ok(record.map(|(name, value)| (name.into(), value.into())).to_vec()));
        Pick {
            point: PickedPoint { chunk: CloudKey(0).chunk(Part::Block(0)), index: 77 },
            number: 77,
            cloud: "office.laz".into(),
            world,
            record,
            added: vec![("distance".into(), "0.25".into())],
            error: Some(error),
            is_streamed: false,
            is_moved: false,
        }
    }

    #[test]
    fn the_coordinates_have_the_digits_of_the_record_unless_the_cloud_was_moved() {
        let mut single = pick(DVec3::new(f64::from(15.108_f32), f64::from(1.62_f32), 3.0));
        let record = [("x", "15.108"), ("y", "1.62"), ("z", "3.5"), ("red", "192")];
        single.record = Some(Ok(record.map(|(name, value)| (name.into(), value.into())).to_vec()));
        assert_eq!(single.coordinates(), "15.108  1.62  3", "its z is another");
        let names: Vec<&str> = single.attributes().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["z", "red", "distance"]);
        // Beside a northing, two metres are less than a millionth.
        let record = [("x", "500012.25"), ("y", "4500002.5"), ("z", "3")];
        let mut northing = pick(DVec3::new(500_012.25, 4_500_004.5, 3.0));
        northing.record = Some(Ok(record.map(|(name, value)| (name.into(), value.into())).to_vec()));
        assert_eq!(northing.coordinates(), "500012.25  4500004.5  3");
        // A cloud that was moved by less than rounding is elsewhere all the same.
        let moved = Pick { is_moved: true, ..pick(DVec3::new(3.000_000_1, 0.0, -4.0)) };
        assert_eq!(moved.coordinates(), "3.0000001  0  -4");
        assert!(moved.attributes().any(|(name, _)| name == "X"));
    }

    #[test]
    fn a_pick_shows_its_record_and_can_be_copied() {
        let mut session = Session::new(Preferences::default());
        session.tools.pick = Some(pick(DVec3::new(3.0, 0.0, -4.0)));
        let mut harness = Harness::builder().with_size([400.0, 400.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| contents(ui, session, actions)),
            session,
        );
        harness.run();
        assert!(harness.query_by_label("3  0  -4").is_some());
        assert!(harness.query_by_label("± 0.0061 across the surface, ± 0.012 along the line of sight").is_some());
        let top = |label: &str| harness.get_by_label(label).rect().top();
        assert!(top("returns") > top("distance"), "what is 0 comes last");
        assert!(harness.query_by_label("1234").is_some() && harness.query_by_label("0.25").is_some());
        let is_listed = |name: &str| harness.query_by_label(name).is_some();
        assert_eq!(["X", "y", "Z"].map(is_listed), [false, false, true], "the coordinates stand above");
        harness.get_by_label("Copy").click();
        harness.run();
        let copied = harness.state().outside.effects.iter().find_map(|effect| match effect {
            Effect::Copy(text) => Some(text.clone()),
            _ => None,
        });
        let is_thinned =
            |harness: &Harness<'_, Session>| harness.query_by_label_contains("the file has more").is_some();
        assert!(!is_thinned(&harness));
        harness
            .state_mut()
            .tools
            .pick
            .iter_mut()
            .flat_map(|pick| &mut pick.error)
            .for_each(|error| error.is_thinned = true);
        harness.run();
        assert!(is_thinned(&harness));
        assert!(copied.is_some_and(|text| {
            text.contains(
                "point 77\t3\t0\t-4\nreturns\t0\nZ\t-400\nintensity\t1234\ndistance\t0.25\n± across\t0.00612\n± sight\t0.0123\n",
            )
        }));
    }
}
