//! The points of mirrors: those that stand for a mirror with a formula, and those of clouds that reflect.

use std::sync::Arc;

use cloud::{Chunk, Progress};
use scene::{Mirror, MirrorPoints, MirrorSurface};
use serde_json::json;
use world::mirrors::{self, Marked};
use world::{Change, CloudKey};

use super::clouds::Sample;
use super::messages::Level;
use super::objects::{Marking, ObjectId, unnamed};
use super::session::Session;
use super::work::Work;

impl Session {
    /// Those of the scene, and the one that is held over it.
    pub fn all_mirrors(&self) -> impl Iterator<Item = (ObjectId, &Mirror)> {
        let placed = self.scene.objects.mirrors.iter().map(|placed| (placed.id, &placed.mirror));
        let held = self.inspection.iter().filter_map(|held| Some((held.id, held.mirror.as_ref()?)));
        placed.chain(held)
    }

    pub(super) fn put_samples(
        &mut self,
        id: ObjectId,
        mirror: Mirror,
        area_per_point: Option<f64>,
        chunks: Vec<Chunk>,
    ) {
        let key = self.samples.of.get(&id).map(|sample| sample.key);
        let key = key.unwrap_or_else(|| self.next_cloud_key());
        self.outside.change(Change::Mirror { cloud: key, mirror: mirror.clone(), samples: chunks.clone() });
        let with_bounds = |chunk: Chunk| {
            let bounds = chunk.bounds();
            (chunk, bounds)
        };
        let chunks = chunks.into_iter().map(with_bounds).collect();
        self.samples.of.insert(id, Sample { key, mirror, area_per_point, chunks });
        self.frames.points_changed();
    }

    /// Brings the render thread to what the objects say: points of mirrors that were added or changed, of clouds that begin or
    /// end to reflect. Called every frame of the window; what takes time is done elsewhere, one thing at a time, so that what
    /// is dragged is always the latest.
    pub fn sync_objects(&mut self) {
        let gone: Vec<ObjectId> =
            self.samples.of.keys().copied().filter(|id| self.all_mirrors().all(|(known, _)| known != *id)).collect();
        for id in gone {
            if let Some(sample) = self.samples.of.remove(&id) {
                self.outside.change(Change::Close { cloud: sample.key });
                self.frames.points_changed();
            }
        }
        if self.scene.selected.is_some_and(|id| self.scene.objects.get(id).is_none()) {
            self.scene.selected = None;
        }
        // The spacing of the points is known when they are all there.
        if self.is_loading() || self.clouds.is_empty() {
            return;
        }
        self.refuse_marking_streamed();
        let (clouds, test) = (&self.clouds, self.scene.objects.visibility.test());
        let area_per_point = *self
            .samples
            .area_per_point
            .get_or_insert_with(|| mirrors::area_per_point(clouds.iter().map(|entry| &entry.cloud), &test));
        if self.samples.under_way.is_none() {
            let is_current = |id: ObjectId, mirror: &Mirror| {
                self.samples.of.get(&id).is_some_and(|sample| {
                    let same_area = sample.area_per_point.is_none_or(|area| area.to_bits() == area_per_point.to_bits());
                    same_area && unnamed(mirror) == unnamed(&sample.mirror)
                })
            };
            // What moves and is drawn by its formula needs its points when it stands still.
            let is_held = |id: ObjectId| {
                let by_formula = self.scene.settings.mirror.surface != MirrorSurface::Points;
                self.inspection.as_ref().is_some_and(|held| held.id == id && by_formula)
                    || self.scene.selected == Some(id) && self.handle_is_grabbed && self.frames.is_slow()
            };
            let stale = self.all_mirrors().find(|(id, mirror)| !is_held(*id) && !is_current(*id, mirror));
            if let Some((id, mirror)) = stale.map(|(id, mirror)| (id, mirror.clone())) {
                self.samples.under_way = Some(id);
                self.outside.work(Work::SampleMirror { id, mirror, area_per_point });
            }
        }
        for entry in &mut self.clouds {
            let wanted: Vec<MirrorPoints> =
                self.scene.objects.markings.iter().filter(|m| m.key == entry.key).map(|m| m.points.clone()).collect();
            match &entry.marking {
                Some((under_way, progress)) if *under_way != wanted => progress.cancel(),
                Some(_) => {}
                None if entry.marked != wanted => {
                    let progress = Arc::<Progress>::default();
                    entry.marking = Some((wanted.clone(), progress.clone()));
                    let (key, cloud, source) = (entry.key, entry.cloud.clone(), entry.source.clone());
                    self.outside.work(Work::MarkPoints { key, cloud, source, wanted, progress });
                }
                None => {}
            }
        }
    }

    pub(super) fn on_marked(
        &mut self,
        key: CloudKey,
        wanted: Vec<MirrorPoints>,
        result: Result<Option<Vec<Marked>>, String>,
    ) {
        let Some(entry) = self.cloud_mut(key) else { return };
        entry.marking = None;
        match result {
            Ok(None) => {
                let now: Vec<&MirrorPoints> =
                    self.scene.objects.markings.iter().filter(|m| m.key == key).map(|m| &m.points).collect();
                // Unless it was overtaken by another wish, someone has stopped it: what reflects already stays.
                if now.into_iter().eq(&wanted) {
                    let kept = self.cloud(key).map_or(Vec::new(), |entry| entry.marked.clone());
                    self.scene.rewrite_objects(|objects| {
                        objects.markings.retain(|marking| marking.key != key || kept.contains(&marking.points));
                    });
                }
            }
            Ok(Some(marked)) => {
                let marked = Arc::new(marked);
                (entry.marked, entry.marks) = (wanted, marked.clone());
                let (chunks, classes, name) = (entry.chunks(), entry.cloud.class_column(), entry.cloud.name.clone());
                let count: u64 = marked.iter().map(|marked| marked.count).sum();
                self.outside.change(Change::Mark { cloud: key, chunks, classes, marked });
                self.frames.points_changed();
                self.outside.log(json!({ "event": "marked", "name": name, "points": count }));
            }
            Err(error) => {
                entry.marked = wanted.clone();
                self.scene.rewrite_objects(|objects| {
                    objects.markings.retain(|marking| marking.key != key || !wanted.contains(&marking.points));
                });
                self.outside.say(Level::Error, error);
            }
        }
    }

    /// Markings of scene files whose clouds have come.
    pub(super) fn place_awaited_markings(&mut self) {
        for points in std::mem::take(&mut self.awaited_markings) {
            let entry = self.clouds.iter().find(|entry| points.is_of(&entry.input, &entry.cloud.name));
            match entry.map(|entry| entry.key) {
                Some(key) => {
                    self.scene
                        .rewrite_objects(|objects| objects.markings.push(Marking { key, points: points.clone() }));
                }
                None => {
                    self.outside.say(Level::Warning, format!("mirror points: no cloud is called `{}`", points.cloud))
                }
            }
        }
    }
}
