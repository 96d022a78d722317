//! How reflections are found: the method, its presets and parameters, and what measures them. Parameters of methods that
//! are not in use are folded, and say so.

use egui::{RichText, Ui};
use param::{Field, Group, Params, Value};
use scene::{METHODS, MethodRow, Reflection};

use crate::shared::language::{text, translated};
use crate::viewer::loaded::all_mirrors;
use crate::viewer::look::reflection_figures::reflected_text;
use crate::viewer::look::theme;
use crate::viewer::panels::{parameters, presets, side};
use crate::viewer::requests::action::Action;
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;

/// The section of the parameter tables.
const SECTION: &str = "Reflections";

/// The method that the parameters of a group are of, if nothing in the picture reads them.
pub fn unused(session: &Session, group: &Group) -> Option<&'static MethodRow> {
    let row = METHODS.iter().find(|row| row.group == Some(group.name))?;
    let mirrors = all_mirrors(&session.scene.objects, session.tools.inspection.as_ref());
    let own: Vec<_> = mirrors.map(|(_, mirror)| mirror.method).collect();
    (!session.scene.settings.groups_of_methods(&own).contains(&group.name)).then_some(row)
}

/// Makes a method the one in use.
pub fn use_method(row: &MethodRow) -> Action {
    Action::set(Reflection::table().name, "method", Value::Choice(row.method as u32))
}

/// Says that the parameters of a group change nothing, and offers their method, where that is not in use.
pub fn unused_notice(ui: &mut Ui, session: &Session, group: &Group, actions: &mut Vec<Action>) {
    let Some(row) = unused(session, group) else { return };
    let text = text!("{row} is not in use: these change nothing.", row = row.name);
    ui.label(RichText::new(text).small().color(theme::WARNING));
    // A link that is wrapped within a line is two controls, one of them without a name.
    if ui.link(RichText::new(text!("Use {row}", row = row.name)).small()).on_hover_text(translated(row.help)).clicked()
    {
        actions.push(use_method(row));
    }
}

/// The groups of the section: the method, then its own parameters, then those of all methods. Of the methods that are not
/// in use, the second list.
fn groups(session: &Session) -> (Vec<&dyn Params>, Vec<&dyn Params>) {
    let all = session.scene.settings.groups().into_iter().filter(|params| params.group().section == SECTION);
    let (others, mut used): (Vec<&dyn Params>, Vec<&dyn Params>) =
        all.partition(|params| unused(session, params.group()).is_some());
    let own = session.scene.settings.reflection.method.chosen().row().group;
    used.sort_by_key(|params| {
        let name = params.group().name;
        (name != Reflection::table().name, own != Some(name))
    });
    (used, others)
}

/// The keys of the parameters that a sweep can vary and that the method in use reads, with their names.
pub fn swept(session: &Session) -> Vec<(String, String)> {
    let fields = groups(session).0.into_iter().flat_map(|params| {
        let group = params.group();
        group.fields.iter().filter(|field| field.can_be_swept()).map(move |field| (group, field))
    });
    let fields: Vec<_> = fields.collect();
    let name = |(group, field): &(&Group, &Field)| {
        let title = parameters::title(field.name);
        let count = fields.iter().filter(|(_, other)| other.name == field.name).count();
        let title = if count > 1 { format!("{title} ({})", group.name) } else { title };
        (format!("{}.{}", group.name, field.name), title)
    };
    fields.iter().map(name).collect()
}

/// Says what mirrors of the picture reflect while something moves, in a row that is there anyway: what is under the mouse
/// stays where it is.
fn share(ui: &mut Ui, session: &Session) {
    let shown = session.frames.shown.as_ref();
    let Some(share) = shown.and_then(|shown| shown.stats.reflected.as_ref()) else { return };
    let text = reflected_text(share);
    let help = text!("While values or the view change, mirrors reflect {text}; the picture at rest reflects all", text);
    let short = text.replace(" of mirror", "").replace(" of", "");
    ui.add(egui::Label::new(RichText::new(short).small().color(theme::ACCENT)).truncate()).on_hover_text(help);
}

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        ui.menu_button(text!("Sweep…"), |ui| {
            egui::ScrollArea::vertical().max_height(420.0).show(ui, |ui| {
                for (key, name) in swept(session) {
                    if ui.button(name).on_hover_text(&key).clicked() {
                        actions.push(Action::AskSweep(key));
                        ui.close();
                    }
                }
            });
        })
        .response
        .on_hover_text(text!("Draws, times and judges this view with a range of values of one parameter"));
        let help = text!(
            "Every setting tried, time against error ({shortcut})",
            shortcut = bindings::shortcut(&Action::ToggleChart)
        );
        if ui.selectable_label(session.tuning.is_open, text!("Chart")).on_hover_text(help).clicked() {
            actions.push(Action::ToggleChart);
        }
        share(ui, session);
    });
    let mirrors = session.scene.objects.mirrors.iter().map(|placed| &placed.mirror);
    presets::show(ui, &session.scene.settings, mirrors, actions);
    let (used, others) = groups(session);
    for params in used {
        side::parameter_group(ui, session, params, true, actions);
    }
    let header = egui::CollapsingHeader::new(RichText::new(text!("Other methods")).color(theme::WEAK));
    let shown = header.id_salt("other methods").show_unindented(ui, |ui| {
        for params in others {
            unused_notice(ui, session, params.group(), actions);
            side::parameter_group(ui, session, params, true, actions);
        }
    });
    shown.header_response.on_hover_text(text!("Parameters of methods that are not in use now"));
}
