//! How clouds are coloured: worker threads compute figures and read the columns that colours need, and the render
//! thread receives the colours.

use std::collections::BTreeMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

use cloud::{COMPARED, Column, Progress};
use scene::ColorBy;
use serde_json::json;
use world::{Change, CloudKey};

use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::objects::figures::{Basis, Figures};
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;

impl Loaded {
    /// Requests colours, histograms, bounds and radii of clouds that have changed. Called every frame of the window.
    pub fn renew_figures(&mut self, beside: &mut Beside<'_>) {
        self.read_filtered(beside);
        self.renew_radii(beside);
        self.tell_lacking(beside);
        self.find_errors(beside);
        for entry in self.clouds.iter_mut().filter(|entry| entry.points > 0 && !entry.figures_under_way) {
            let basis = Basis {
                color: color_now(entry, beside.scene),
                test: beside.scene.objects.test(),
                doublings: if entry.is_read { 0 } else { entry.points.ilog2() },
                is_read: entry.is_read,
                late_columns: entry.late_columns(),
                columns: entry.paged_columns(),
                surfels: entry.surfels,
                rests: entry.streamed.as_ref().map_or(0, |streamed| streamed.rests),
            };
            // While a clip volume or the range of a filter is dragged, figures of all points would only slow that down.
            let is_dragged = beside.scene.navigation.is_held()
                && entry.figures_basis.as_ref().is_some_and(|old| old.test != basis.test);
            if entry.figures_basis.as_ref() != Some(&basis) && !is_dragged {
                entry.figures_under_way = true;
                let (key, cloud, up) = (entry.key, entry.cloud.clone(), entry.up);
                // The ramp of a streamed cloud must not change with the points that happen to be loaded. A catalogue has
                // figures of its first tiles while others are opened.
                let is_lasting = |old: &Basis| {
                    let is_whole = old.is_read || !entry.is_catalogue();
                    is_whole && old.color == basis.color && old.test == basis.test && old.columns == basis.columns
                };
                let lasts = entry.is_indexed() && entry.figures_basis.as_ref().is_some_and(is_lasting);
                let kept = entry.figures.as_ref().filter(|_| lasts);
                let kept = kept.cloned().map(Box::new);
                beside.outside.work(Work::FindFigures { key, cloud, basis, up, kept });
            }
        }
        self.measure_noise(beside);
    }

    /// Measures the noise of clouds that are read. The picture comes first.
    fn measure_noise(&mut self, beside: &mut Beside<'_>) {
        let is_at_rest = beside.frames.final_one().is_some();
        for entry in self.clouds.iter_mut().filter(|entry| is_at_rest && entry.is_read && entry.source.is_some()) {
            let lacks_noise = entry.figures.as_ref().is_some_and(|figures| figures.noise.is_none());
            if lacks_noise && !entry.noise_under_way {
                entry.noise_under_way = true;
                beside.outside.work(Work::MeasureNoise { key: entry.key, cloud: entry.cloud.clone() });
            }
        }
    }

    pub fn on_noise(&mut self, key: CloudKey, noise: Option<f64>) {
        let Some(entry) = self.cloud_mut(key) else { return };
        entry.noise_under_way = false;
        if let Some(figures) = &mut entry.figures {
            figures.noise = Some(noise);
        }
    }

    /// Finds out how sure the surfaces are that are coloured by that, once their normals are there.
    fn find_errors(&mut self, beside: &mut Beside<'_>) {
        for entry in self.clouds.iter_mut().filter(|entry| entry.is_read && entry.streamed.is_none()) {
            let color = beside.scene.objects.color_of(entry.key, &beside.scene.settings.color);
            let is_wanted = color.by == ColorBy::Certainty && entry.points > 0 && entry.lacks_errors();
            if is_wanted && !entry.is_finding_errors {
                entry.is_finding_errors = true;
                beside.outside.work(Work::FindErrors { key: entry.key, cloud: entry.cloud.clone() });
            }
        }
    }

    pub fn on_errors(&mut self, key: CloudKey, errors: BTreeMap<u64, Arc<Column>>, beside: &mut Beside<'_>) {
        let Some(entry) = self.cloud_mut(key) else { return };
        entry.is_finding_errors = false;
        entry.marked = Vec::new();
        entry.put_errors(errors).into_iter().for_each(|change| beside.outside.change(change));
    }

    /// Says what colours ask for and clouds that are shown lack. What the first points have in common, others may not.
    fn tell_lacking(&mut self, beside: &mut Beside<'_>) {
        // What is awaited comes, and what has come may be newer than the figures.
        let knows_all = |entry: &CloudEntry| {
            let columns = entry.figures_basis.as_ref().map_or(0, |basis| basis.columns);
            !entry.is_indexed() || entry.awaited.is_empty() && columns == entry.cloud.attributes.len()
        };
        // Whoever colours by what a comparison has found knows that the other clouds do not have it.
        let is_of_another = |entry: &CloudEntry| {
            let color = beside.scene.objects.color_of(entry.key, &beside.scene.settings.color);
            let is_added = |other: &CloudEntry| {
                let is_new =
                    COMPARED.contains(&color.attribute.as_str()) && other.cloud.column_of(&color.attribute).is_some();
                is_new || other.added.iter().any(|(name, _)| *name == color.attribute)
            };
            color.by == ColorBy::Attribute
                && entry.cloud.column_of(&color.attribute).is_none()
                && self.clouds.iter().any(is_added)
        };
        // Figures of earlier colours say nothing of those that are wanted now.
        let is_new = |entry: &CloudEntry| {
            entry.figures_basis.as_ref().is_some_and(|basis| basis.color == color_now(entry, beside.scene))
        };
        let is_told = |entry: &&CloudEntry| {
            entry.is_visible && entry.is_read && knows_all(entry) && is_new(entry) && !is_of_another(entry)
        };
        let read = self.clouds.iter().filter(is_told);
        let of_strays = world::stray_warning(&beside.scene.settings);
        for warning in read.filter_map(|entry| entry.figures.as_ref()?.warning.as_ref()).chain(&of_strays) {
            if !self.warned.contains(warning) {
                beside.outside.say(Level::Warning, warning.clone());
                self.warned.push(warning.clone());
            }
        }
    }

    /// Reads the columns that filters test and that are not in memory.
    fn read_filtered(&mut self, beside: &mut Beside<'_>) {
        let test = beside.scene.objects.test();
        for entry in self.clouds.iter_mut().filter(|entry| entry.is_read && entry.streamed.is_none()) {
            let Some(source) = entry.source.clone() else { continue };
            let key = entry.key;
            for attribute in entry.cloud.lacks(&test) {
                if let Entry::Vacant(read) = entry.column_reads.entry(attribute) {
                    let (source, progress) = (source.clone(), Arc::<Progress>::default());
                    read.insert(Some(progress.clone()));
                    beside.outside.work(Work::ReadColumn { key, source, attribute, progress });
                }
            }
        }
    }

    pub fn on_figures(&mut self, key: CloudKey, basis: Basis, mut figures: Figures, beside: &mut Beside<'_>) {
        let Some(entry) = self.cloud_mut(key) else { return };
        entry.figures_under_way = false;
        figures.noise = figures.noise.or_else(|| entry.figures.as_ref()?.noise);
        if let Some((attribute, source)) = entry.column_to_read(&figures) {
            // The colours on the screen stay until the column has been read.
            entry.figures_basis = Some(basis);
            if let Entry::Vacant(read) = entry.column_reads.entry(attribute) {
                let progress = Arc::<Progress>::default();
                read.insert(Some(progress.clone()));
                beside.outside.work(Work::ReadColumn { key, source, attribute, progress });
            }
            return;
        }
        let same_plan = entry.figures.as_ref().is_some_and(|old| old.plan == figures.plan);
        // Points are coloured when they arrive; columns that are read later are not.
        let same_columns = entry.figures_basis.as_ref().is_some_and(|old| old.late_columns == basis.late_columns);
        let same_columns = same_columns || entry.is_indexed();
        // The camera stays where it is when someone hides points.
        let same_visibility = entry.figures_basis.as_ref().is_none_or(|old| old.test == basis.test);
        entry.figures_basis = Some(basis);
        let outline_changed = entry.figures.as_ref().is_none_or(|old| old.outline != figures.outline);
        let (name, up, plan) = (entry.cloud.name.clone(), entry.up, figures.plan.clone());
        entry.figures = Some(figures);
        let chunks = entry.chunks();
        if !(same_plan && same_columns) {
            beside.outside.log(json!({ "event": "colored", "name": name, "by": plan.label }));
            beside.outside.change(Change::Color { cloud: key, chunks, plan, up });
            beside.frames.points_changed();
        }
        self.tell_lacking(beside);
        self.tell_idle_filters(beside);
        if outline_changed && same_visibility {
            beside.scene.frame_while_unplaced(beside.scene.bounds(&self.clouds), &self.clouds);
        }
    }

    pub fn on_column(
        &mut self,
        key: CloudKey,
        attribute: usize,
        result: Result<BTreeMap<u64, Arc<Column>>, String>,
        beside: &mut Beside<'_>,
    ) {
        let Some(entry) = self.cloud_mut(key) else { return };
        match result {
            Ok(columns) => {
                entry.column_reads.remove(&attribute);
                let changes = entry.put_late_column(attribute, columns);
                if !changes.is_empty() {
                    entry.marked = Vec::new();
                }
                changes.into_iter().for_each(|change| beside.outside.change(change));
            }
            Err(error) => {
                entry.column_reads.insert(attribute, None);
                let name = entry.cloud.attributes.get(attribute).map_or(String::new(), |known| known.name.clone());
                beside.outside.say(Level::Error, format!("{name}: {error}"));
            }
        }
    }

    /// Whether clouds that are shown are about to have other colours than they have: their figures are to be found, or
    /// what their points are coloured by is being read or computed.
    pub fn colors_come(&self, scene: &Scene) -> bool {
        let comes = |entry: &CloudEntry| {
            let is_other =
                |basis: &Basis| basis.color != color_now(entry, scene) || basis.late_columns != entry.late_columns();
            entry.is_finding_errors
                || entry.column_reads.values().any(Option::is_some)
                || entry.figures_basis.as_ref().is_some_and(is_other)
        };
        self.clouds.iter().any(|entry| entry.is_visible && entry.is_read && comes(entry))
    }

    /// The attributes whose columns are being read now, with the progress of each.
    pub fn columns_under_way(&self) -> impl Iterator<Item = (&str, &Progress)> {
        self.clouds.iter().flat_map(|entry| {
            let reads = entry.column_reads.iter();
            let reads = reads.filter_map(|(attribute, progress)| Some((*attribute, progress.as_deref()?)));
            reads.map(|(attribute, progress)| (entry.cloud.attributes[attribute].name.as_str(), progress))
        })
    }
}

/// What a cloud is coloured by now. Until it is known how sure its surface is, it has the colours that it would have by
/// itself.
fn color_now(entry: &CloudEntry, scene: &Scene) -> scene::Color {
    let mut color = scene.objects.color_of(entry.key, &scene.settings.color);
    if color.by == ColorBy::Certainty && entry.streamed.is_none() && entry.error_column().is_none() {
        color.by = ColorBy::Auto;
    }
    color
}

#[cfg(test)]
mod tests {
    use cloud::{Chunk, SURFACE_ERROR, Surfels};
    use glam::DVec3;
    use scene::Settings;
    use world::{Event, Opened, Part};

    use super::*;
    use crate::viewer::requests::action::Action;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::session::Session;

    /// Runs the figures and searches that are asked for, until none is; returns how many searches ran.
    fn work(session: &mut Session) -> usize {
        let mut searches = 0;
        loop {
            session.with_loaded(Loaded::renew_figures);
            let work = std::mem::take(&mut session.outside.effects).into_iter().filter_map(|effect| match effect {
                Effect::Work(work @ (Work::FindErrors { .. } | Work::FindFigures { .. })) => Some(work),
                _ => None,
            });
            let work: Vec<Work> = work.collect();
            if work.is_empty() {
                return searches;
            }
            for work in work {
                searches += usize::from(matches!(work, Work::FindErrors { .. }));
                assert!(session.loaded.clouds[0].is_busy());
                let found = std::cell::RefCell::new(Vec::new());
                work.run(&Settings::default().stream, |news| found.borrow_mut().push(news));
                found.into_inner().into_iter().for_each(|news| session.on_found(news));
            }
        }
    }

    #[test]
    fn certainty_is_found_out_once_normals_are_there_and_colours_the_points_then() {
        let mut session = Session::new(Preferences::default());
        let job = session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
        let opened = Opened { name: "plate".into(), expected_points: 400, up: DVec3::Z, ..Opened::default() };
        let point = |at: usize| [(at % 20) as f32, (at / 20) as f32, if at % 20 < 10 { 0.0 } else { (at % 3) as f32 }];
        let chunk = Chunk::new(0, DVec3::ZERO, (0..400).map(point).collect());
        let up = cloud::pack_normal(glam::Vec3::Z);
        let surfels = vec![Surfels { normals: vec![up; 400], radii: vec![cloud::pack_radius(1.0); 400] }];
        let read = Event::Read { cloud: 0, summary: codec::Summary::default() };
        for event in [Event::Opened { cloud: 0, opened }, Event::Chunk { cloud: 0, part: Part::Block(0), chunk }, read]
        {
            session.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
        }
        let comes = |session: &Session| session.loaded.colors_come(&session.scene);
        work(&mut session);
        assert!(!comes(&session));
        session.act(Action::ColorBy(ColorBy::Height));
        assert!(comes(&session), "the figures are to be found");
        work(&mut session);
        assert!(!comes(&session));
        session.act(Action::ColorBy(ColorBy::Certainty));
        let label =
            |session: &Session| session.loaded.clouds[0].figures.as_ref().map(|figures| figures.plan.label.clone());
        assert_eq!((work(&mut session), label(&session).as_deref()), (0, Some("plain")), "there are no normals yet");
        session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Surfels { cloud: 0, surfels }, beside));
        assert_eq!((work(&mut session), label(&session).as_deref()), (1, Some(SURFACE_ERROR)));
        assert_eq!(session.loaded.clouds[0].figures.as_ref().and_then(|figures| figures.warning.clone()), None);
        assert!(!comes(&session));
        session.act(Action::ColorBy(ColorBy::Height));
        session.act(Action::ColorBy(ColorBy::Certainty));
        assert_eq!((work(&mut session), label(&session).as_deref()), (0, Some(SURFACE_ERROR)), "it is known");
    }
}
