//! The panel of ghosts: looks for mirrors, shows why each is taken for one, and hides ghosts or puts them back.

use egui::{RichText, Ui};

use crate::shared::ghosts::PROBABILITY;
use crate::shared::language::{text, translated};
use crate::viewer::jobs::ghosts::{Decision, Seen};
use crate::viewer::loaded::ghosts::{are_hidden, is_accepted};
use crate::viewer::look::theme;
use crate::viewer::look::theme::grouped;
use crate::viewer::look::widgets::{name_label, progress_bar};
use crate::viewer::objects::ObjectId;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::requests::action::{Action, Ghosting};
use crate::viewer::session::Session;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let ghosts = &session.loaded.ghosts;
    if session.loaded.clouds.is_empty() {
        ui.label(RichText::new(text!("Open a scan to look for what its scanner saw in mirrors.")).color(theme::WEAK));
        return;
    }
    let mut draft = ghosts.draft.clone();
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Scanner"));
        let help = text!("Where the scanner stood, as X,Y,Z; files of E57 and PTX know it themselves");
        let field =
            egui::TextEdit::singleline(&mut draft.station).hint_text(text!("as the file says")).desired_width(130.0);
        ui.add(field).labelled_by(label.id).on_hover_text(help);
        if ui.small_button(text!("Eye")).on_hover_text(text!("The scanner stood where the eye is now")).clicked() {
            let eye = session.scene.camera.eye;
            draft.station = format!("{:.4},{:.4},{:.4}", eye.x, eye.y, eye.z);
        }
    });
    let help = text!(
        "Mirrors and panes of the scene are always used; further planes, balls and columns are looked for if this is on"
    );
    ui.checkbox(&mut draft.finds, text!("Find planes, balls and columns")).on_hover_text(help);
    match &ghosts.under_way {
        Some(progress) => {
            ui.horizontal(|ui| {
                progress_bar(ui, progress.done() as f32 / progress.total().max(1) as f32);
                if ui.button(text!("Stop")).clicked() {
                    actions.push(Action::Ghosts(Ghosting::Stop));
                }
            });
            ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
        }
        None => {
            let help = text!("Reads the files of all shown clouds, and finds what was seen in mirrors");
            if ui.button(text!("Look for ghosts")).on_hover_text(help).clicked() {
                actions.push(Action::Ghosts(Ghosting::Look));
            }
        }
    }
    if let Some(seen) = &ghosts.seen {
        results(ui, session, seen, actions);
        put_back(ui, session, seen, &mut draft.output, actions);
    }
    if draft != ghosts.draft {
        actions.push(Action::Ghosts(Ghosting::Change(Box::new(draft))));
    }
}

/// What was found, mirror by mirror, and whether it is shown.
fn results(ui: &mut Ui, session: &Session, seen: &Seen, actions: &mut Vec<Action>) {
    let [ghosts, undecided] = seen.counts.map(grouped);
    ui.label(text!("{ghosts} ghosts, {undecided} undecided", ghosts, undecided));
    if seen.looked.found.is_empty() {
        ui.label(RichText::new(text!("No mirror was found.")).color(theme::WEAK));
    }
    for (index, found) in seen.looked.found.iter().enumerate() {
        ui.push_id(index, |ui| {
            let mirror = &found.reflector.mirror;
            let number = index + 1;
            ui.horizontal(|ui| {
                let kind = if found.reflector.is_open { text!("pane") } else { translated(mirror.shape.name()) };
                ui.label(format!("{number}  {kind}"))
                    .on_hover_text(text!("at {position}", position = format_args!("{:.3}", mirror.position)));
                decision(ui, session, seen, index, actions);
            });
            let (points, residual) = seen.figures[index];
            let residual = residual.map_or(String::new(), |residual| {
                text!(", {residual} from surfaces", residual = format_args!("{residual:.4}"))
            });
            let text =
                text!("{points} points{residual}; {reason}", points = grouped(points), residual, reason = found.reason);
            ui.add(egui::Label::new(RichText::new(text).small().color(theme::WEAK)).wrap());
            if let Decision::Accepted(id) = seen.decisions[index] {
                as_it_stands(ui, session, id, actions);
            }
        });
    }
    // Mirrors that were added to the scene after the search.
    for placed in &session.scene.objects.mirrors {
        if !seen.decisions.contains(&Decision::Accepted(placed.id)) {
            ui.label(&placed.mirror.name);
            as_it_stands(ui, session, placed.id, actions);
        }
    }
    let visible = || session.loaded.clouds.iter().filter(|entry| entry.is_visible);
    let lacks_verdicts = |entry: &&CloudEntry| {
        entry.streamed.is_some() && !entry.offered().any(|attribute| attribute.name == PROBABILITY)
    };
    let lacking = visible().filter(lacks_verdicts).count();
    if lacking > 0 {
        let text = text!(
            "Streamed clouds are not coloured by this. Put back writes a new file that has it; or open them in memory, \
             with stream.pages = never."
        );
        ui.label(RichText::new(text).small().color(theme::WARNING));
    }
    let is_hidden = are_hidden(&session.scene.objects.visibility.filters);
    let is_able = is_hidden || lacking < visible().count();
    let hide = ui.add_enabled(is_able, egui::Button::selectable(is_hidden, text!("Hide ghosts")));
    let help = text!("By a filter of ghost_probability, as in the tab Data; undecided points stay");
    let hide = hide.on_hover_text(help).on_disabled_hover_text(text!("A streamed cloud has no verdicts to hide by"));
    if hide.clicked() {
        actions.push(Action::Ghosts(Ghosting::Hide(!is_hidden)));
    }
}

/// How well a mirror of the scene fits where it stands now, and the button that moves it to where it fits best.
fn as_it_stands(ui: &mut Ui, session: &Session, id: ObjectId, actions: &mut Vec<Action>) {
    let live = &session.loaded.ghosts.live;
    let Some((mirror, residual)) = live.measured.get(&id) else { return };
    ui.horizontal_wrapped(|ui| {
        let distance = match residual.median {
            Some(median) => text!("median distance {median}", median = format_args!("{median:.4}")),
            None => text!("far from surfaces").to_owned(),
        };
        let text = text!(
            "now: {distance}, {near} of {points} points",
            distance,
            near = grouped(residual.near),
            points = grouped(residual.points)
        );
        let help = text!(
            "Of a sample of the points that lie behind the mirror as it stands now: how far they are from the \
                    surfaces of the scan when they are unfolded, and how many are near one"
        );
        ui.label(RichText::new(text).small()).on_hover_text(help);
        let button = ui.add_enabled(live.fitting.is_none(), egui::Button::new(text!("Fit")).small());
        let help = text!("Moves the mirror from where it stands to where these points fit best; undo moves it back");
        if button.accessible_name(text!("Fit {mirror}", mirror = mirror.name)).on_hover_text(help).clicked() {
            actions.push(Action::Ghosts(Ghosting::Fit(id)));
        }
    });
}

fn decision(ui: &mut Ui, session: &Session, seen: &Seen, index: usize, actions: &mut Vec<Action>) {
    let number = index + 1;
    if is_accepted(seen, index, &session.scene.objects) {
        ui.label(RichText::new(text!("in the scene")).color(theme::ACCENT));
        return;
    }
    let mut button = |text: &str, help: &str, step: Ghosting| {
        let button = ui.small_button(text).on_hover_text(help);
        if button.accessible_name(text!("{text} mirror {number}", text, number)).clicked() {
            actions.push(Action::Ghosts(step));
        }
    };
    button(text!("Accept"), text!("Makes it a mirror of the scene; undo takes it out again"), Ghosting::Accept(index));
    if seen.decisions[index] == Decision::Refused {
        ui.label(RichText::new(text!("refused")).color(theme::WEAK));
    } else {
        button(text!("Refuse"), text!("What was seen in it counts as real points"), Ghosting::Refuse(index));
    }
}

fn put_back(ui: &mut Ui, session: &Session, seen: &Seen, output: &mut String, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("New file"));
        let help = text!(
            "All points and, at the places that were seen, the ghosts of accepted mirrors are written to this file, \
                    which is opened in place of the scan"
        );
        let hint =
            if session.loaded.shows_streamed() { "glint-…-put-back-1.copc.laz" } else { "glint-…-put-back-1.laz" };
        let field = egui::TextEdit::singleline(output).hint_text(hint).desired_width(180.0);
        ui.add(field).labelled_by(label.id).on_hover_text(help);
    });
    let is_able = session.loaded.ghosts.under_way.is_none()
        && (0..seen.decisions.len()).any(|mirror| is_accepted(seen, mirror, &session.scene.objects));
    let button = ui.add_enabled(is_able, egui::Button::new(text!("Put back")));
    if button.on_disabled_hover_text(text!("Accept a mirror first")).clicked() {
        actions.push(Action::Ghosts(Ghosting::PutBack));
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::sync::Arc;

    use cloud::Progress;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use ghost::{Block, Extent, Found, Gauge, Kind, Points, Residual, Suspect, Verdicts};
    use glam::DVec3;
    use scene::{Mirror, Shape};

    use super::*;
    use crate::shared::ghosts::Looked;
    use crate::viewer::objects::clouds::Streamed;

    struct NoPoints;

    impl Points for NoPoints {
        type Error = Infallible;

        fn read(&self, _: &(dyn Fn(&Block) + Sync)) -> Result<(), Infallible> {
            Ok(())
        }
    }

    /// A mirror that explains one ghost.
    fn seen() -> Seen {
        let mirror = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Z, 1.0);
        let suspect = Suspect {
            index: 1,
            kind: Kind::Ghost,
            mirrors: [1, 0, 0, 0],
            probability: 1.0,
            place: DVec3::ZERO,
            error: 0.0,
            distance: Some(0.0012),
        };
        let verdicts = Verdicts { suspects: [((0, 0), vec![suspect])].into(), noise: 0.0 };
        let found = vec![Found { reason: "for a reason".into(), ..Found::given(mirror) }];
        let extent = Extent { origin: DVec3::ZERO, edge: 1.0 };
        let gauge = Gauge::of(&NoPoints, &[], extent, 0, &Progress::default()).expect("points").expect("no cancel");
        let (gauge, warnings) = (Arc::new(gauge), Default::default());
        let looked = Looked { stations: Vec::new(), found, gauge, verdicts, warnings, missing: 0 };
        Seen::new(looked, Vec::new(), Vec::new())
    }

    #[test]
    fn a_found_mirror_is_told_with_its_reason_and_is_refused_or_accepted() {
        let mut session = Session::with_two_points();
        session.loaded.ghosts.seen = Some(seen());
        let mut harness = Harness::builder().with_size([360.0, 600.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_ok();
        let has = |harness: &Harness<'_, Session>, text: &str| harness.query_by_label(text).is_some();
        assert!(has(&harness, "1 ghosts, 0 undecided"));
        assert!(has(&harness, "1 points, 0.0012 from surfaces; for a reason"));
        harness.get_by_label("Refuse mirror 1").click();
        harness.run_ok();
        assert!(has(&harness, "refused") && has(&harness, "0 ghosts, 0 undecided"));
        harness.get_by_label("Accept mirror 1").click();
        harness.run_ok();
        assert!(has(&harness, "in the scene") && has(&harness, "1 ghosts, 0 undecided"));
        let placed = harness.state().scene.objects.mirrors[0].clone();
        assert_eq!(placed.mirror.name, "found sphere");
        let residual = Residual { points: 2000, near: 1980, median: Some(0.00141) };
        harness.state_mut().loaded.ghosts.live.measured.insert(placed.id, (placed.mirror, residual));
        harness.run_ok();
        assert!(has(&harness, "now: median distance 0.0014, 1,980 of 2,000 points"));
        harness.get_by_label("Fit found sphere").click();
        harness.run_ok();
        assert_eq!(harness.state().loaded.ghosts.live.fitting, Some(placed.id));
        let is_told = |harness: &Harness<'_, Session>| {
            harness.query_by_label_contains("Streamed clouds are not coloured by this").is_some()
        };
        harness.state_mut().loaded.clouds[0].streamed = Some(Streamed::default());
        harness.run_ok();
        harness.get_by_label("Hide ghosts").click();
        harness.run_ok();
        assert!(is_told(&harness) && !are_hidden(&harness.state().scene.objects.visibility.filters));
        harness.state_mut().loaded.clouds[0].streamed = None;
        harness.run_ok();
        assert!(!is_told(&harness));
        harness.get_by_label("Hide ghosts").click();
        harness.run_ok();
        assert!(are_hidden(&harness.state().scene.objects.visibility.filters));
        harness.get_by_label("Eye").click();
        harness.run_ok();
        assert!(harness.state().loaded.ghosts.draft.station.contains(','));
    }
}
