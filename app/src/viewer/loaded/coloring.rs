//! How clouds are coloured: worker threads compute figures and read the columns that colours need, and the render
//! thread receives the colours.

use std::collections::BTreeMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

use cloud::{Column, Progress};
use serde_json::json;
use world::{Change, CloudKey};

use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::objects::figures::{Basis, Figures};
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::work::Work;

impl Loaded {
    /// Requests colours, histograms, bounds and radii of clouds that have changed. Called every frame of the window.
    pub fn renew_figures(&mut self, beside: &mut Beside<'_>) {
        self.read_filtered(beside);
        self.renew_radii(beside);
        self.tell_lacking(beside);
        for entry in self.clouds.iter_mut().filter(|entry| entry.points > 0 && !entry.figures_under_way) {
            let basis = Basis {
                color: beside.scene.objects.color_of(entry.key, &beside.scene.settings.color),
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
                let is_same =
                    |old: &Basis| old.color == basis.color && old.test == basis.test && old.columns == basis.columns;
                let same_color = entry.figures_basis.as_ref().is_some_and(is_same);
                // The ramp of a streamed cloud must not change with the points that happen to be loaded.
                let kept = entry.figures.as_ref().filter(|_| same_color && entry.is_indexed());
                let kept = kept.cloned().map(Box::new);
                let is_measured = entry.figures.as_ref().is_some_and(|figures| figures.noise.is_some());
                let measures_noise = basis.is_read && entry.source.is_some() && !is_measured;
                beside.outside.work(Work::FindFigures { key, cloud, basis, up, kept, measures_noise });
            }
        }
    }

    /// Says what colours ask for and clouds that are shown lack. What the first points have in common, others may not.
    fn tell_lacking(&mut self, beside: &mut Beside<'_>) {
        // What is awaited comes, and what has come may be newer than the figures.
        let knows_all = |entry: &CloudEntry| {
            let columns = entry.figures_basis.as_ref().map_or(0, |basis| basis.columns);
            !entry.is_indexed() || entry.awaited.is_empty() && columns == entry.cloud.attributes.len()
        };
        let is_told = |entry: &&CloudEntry| entry.is_visible && entry.is_read && knows_all(entry);
        let read = self.clouds.iter().filter(is_told);
        for warning in read.filter_map(|entry| entry.figures.as_ref()?.warning.as_ref()) {
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
        let same_points = entry.figures_basis.as_ref().is_some_and(|old| {
            old.doublings == basis.doublings && old.is_read == basis.is_read && old.late_columns == basis.late_columns
        });
        // The camera stays where it is when someone hides points.
        let same_visibility = entry.figures_basis.as_ref().is_none_or(|old| old.test == basis.test);
        // Chunks of streamed clouds are coloured when they arrive.
        let same_points = same_points || entry.is_indexed();
        entry.figures_basis = Some(basis);
        let outline_changed = entry.figures.as_ref().is_none_or(|old| old.outline != figures.outline);
        let (name, up, plan) = (entry.cloud.name.clone(), entry.up, figures.plan.clone());
        entry.figures = Some(figures);
        let chunks = entry.chunks();
        if !(same_plan && same_points) {
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

    /// The attributes whose columns are being read now, with the progress of each.
    pub fn columns_under_way(&self) -> impl Iterator<Item = (&str, &Progress)> {
        self.clouds.iter().flat_map(|entry| {
            let reads = entry.column_reads.iter();
            let reads = reads.filter_map(|(attribute, progress)| Some((*attribute, progress.as_deref()?)));
            reads.map(|(attribute, progress)| (entry.cloud.attributes[attribute].name.as_str(), progress))
        })
    }
}
