//! What the overlays of a picture say about what is open.

use scene::Visibility;

use crate::overlays::Facts;
use crate::overlays::labels::Mark;
use crate::viewer::loaded::Loaded;
use crate::viewer::scene::Scene;
use crate::viewer::tools::measurements::{Measurements, units};

/// What overlays say about the visible clouds, the measurements and notes that are switched on,
/// and the captions and the wipe of the path that the picture follows.
pub fn facts(scene: &Scene, loaded: &Loaded, measurements: &Measurements) -> Facts {
    let units = units(loaded);
    let mut facts = Facts::new(units, scene.up(&loaded.clouds));
    let Visibility { hidden_classes, .. } = &scene.objects.visibility;
    for entry in loaded.clouds.iter().filter(|entry| entry.is_visible) {
        if let Some(figures) = &entry.figures {
            let classes = figures.shown_classes.iter().map(|(class, _)| *class);
            let shown = classes.filter(|class| !hidden_classes.contains(class));
            facts.add_legend(&entry.cloud.name, &entry.input, &figures.plan, &entry.units, shown);
        }
    }
    for placed in scene.objects.measurements.iter().filter(|placed| placed.measurement.on) {
        let mark = Mark::of_measurement(&placed.measurement, measurements.figures(placed.id), &units);
        facts.marks.push(Mark { is_selected: scene.selected == Some(placed.id), ..mark });
    }
    for placed in scene.objects.notes.iter().filter(|placed| placed.note.on) {
        let is_selected = scene.selected == Some(placed.id);
        facts.marks.push(Mark { is_selected, ..Mark::of_note(&placed.note) });
    }
    for placed in scene.objects.profiles.iter().filter(|placed| placed.profile.on) {
        let is_selected = scene.selected == Some(placed.id);
        facts.marks.push(Mark { is_selected, ..Mark::of_profile(&placed.profile, facts.up) });
    }
    if let Some(posed) = &scene.posed {
        (facts.captions, facts.wipe) = (posed.captions.clone(), posed.wipe.clone());
    }
    facts
}
