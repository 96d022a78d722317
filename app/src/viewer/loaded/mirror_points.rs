//! The points of mirrors: points that represent a mirror with a formula, and marked points of clouds.

use std::sync::Arc;

use cloud::{Chunk, Progress};
use scene::{Mirror, MirrorPoints, MirrorSurface, Shape};
use serde_json::json;
use world::mirrors::{self, Marked};
use world::{Change, CloudKey};

use crate::shared::language::text;
use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::clouds::Sample;
use crate::viewer::objects::{Marking, ObjectId, unnamed};
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::Outside;
use crate::viewer::requests::work::Work;

impl Loaded {
    /// Counts the points of a cloud that would reflect.
    pub fn count_points(&self, key: CloudKey, wanted: MirrorPoints, outside: &mut Outside) {
        if let Some(entry) = self.cloud(key) {
            outside.work(Work::CountPoints { cloud: entry.cloud.clone(), source: entry.source.clone(), wanted });
        }
    }

    /// Stops finding the points of a cloud that reflect.
    pub fn stop_marking(&self, key: CloudKey) {
        let marking = self.cloud(key).and_then(|entry| entry.marking.as_ref());
        marking.iter().for_each(|(_, progress)| progress.cancel());
    }

    /// Takes in the points of a mirror, and the triangles of its mesh. The mirror is taken away if its mesh cannot be
    /// read. The points are dropped if the mirror has been deleted meanwhile.
    pub fn on_samples(
        &mut self,
        id: ObjectId,
        mirror: Mirror,
        area_per_point: f64,
        result: Result<(Shape, Vec<Chunk>), String>,
        beside: &mut Beside<'_>,
    ) {
        self.samples.under_way = None;
        if !beside.mirrors().any(|(known, _)| known == id) {
            return;
        }
        match result {
            Ok((shape, chunks)) => {
                let is_unread = |mirror: &Mirror| matches!(&mirror.shape, Shape::Mesh(mesh) if mesh.surface.is_empty());
                if is_unread(&mirror) {
                    beside.scene.rewrite_objects(|objects| objects.learn_mesh(&shape));
                }
                self.put_samples(id, Mirror { shape, ..mirror }, Some(area_per_point), chunks, beside);
            }
            Err(error) => {
                let tracks = beside.scene.objects.track_count();
                beside.scene.rewrite_objects(|objects| objects.remove(id));
                beside.outside.say(Level::Error, text!("mirror `{mirror}`: {error}", mirror = mirror.name, error));
                beside.scene.tell_lost_tracks(tracks, beside.outside);
            }
        }
    }

    pub fn put_samples(
        &mut self,
        id: ObjectId,
        mirror: Mirror,
        area_per_point: Option<f64>,
        chunks: Vec<Chunk>,
        beside: &mut Beside<'_>,
    ) {
        let key = self.samples.of.get(&id).map(|sample| sample.key);
        let key = key.unwrap_or_else(|| self.next_cloud_key());
        beside.outside.change(Change::Mirror { cloud: key, mirror: mirror.clone(), samples: chunks.clone() });
        let with_bounds = |chunk: Chunk| {
            let bounds = chunk.bounds();
            (chunk, bounds)
        };
        let chunks = chunks.into_iter().map(with_bounds).collect();
        self.samples.of.insert(id, Sample { key, mirror, area_per_point, chunks });
        beside.frames.points_changed();
    }

    /// Updates the points on the render thread to match the objects: points of mirrors that were added or changed, and
    /// points of clouds that begin or stop reflecting. Called every frame of the window. Slow work is done by workers,
    /// one piece at a time, so that a mirror that is being dragged is always up to date.
    pub fn sync_objects(&mut self, beside: &mut Beside<'_>) {
        let gone: Vec<ObjectId> =
            self.samples.of.keys().copied().filter(|id| beside.mirrors().all(|(known, _)| known != *id)).collect();
        for id in gone {
            if let Some(sample) = self.samples.of.remove(&id) {
                beside.outside.change(Change::Close { cloud: sample.key });
                beside.frames.points_changed();
            }
        }
        if beside.scene.selected.is_some_and(|id| beside.scene.objects.get(id).is_none()) {
            beside.scene.selected = None;
        }
        // The spacing of the points is known only when all points are loaded.
        if self.is_loading() || self.clouds.is_empty() {
            return;
        }
        self.refuse_marking_streamed(beside);
        // A clip that is dragged changes the spacing of what is shown, which only the points of mirrors need.
        if self.samples.under_way.is_none() && beside.mirrors().next().is_some() {
            let (clouds, test) = (&self.clouds, beside.scene.objects.test());
            let area_per_point = *self.samples.area_per_point.get_or_insert_with(|| {
                let visible = clouds.iter().filter(|entry| entry.is_visible);
                mirrors::area_per_point(visible.map(|entry| &entry.cloud), &test)
            });
            let is_dense = |sample: &Sample, area_per_point: f64| {
                sample.area_per_point.is_none_or(|area| area.to_bits() == area_per_point.to_bits())
            };
            let is_current = |id: ObjectId, mirror: &Mirror| {
                let sample = self.samples.of.get(&id);
                sample.is_some_and(|s| is_dense(s, area_per_point) && unnamed(mirror) == unnamed(&s.mirror))
            };
            // A moving mirror that is drawn by its formula needs its points only when it stands still.
            let is_held = |id: ObjectId, mirror: &Mirror| {
                let surface = beside.scene.settings.mirror.surface;
                let by_formula = mirror.shape.has_formula() && surface != MirrorSurface::Points;
                beside.inspection.as_ref().is_some_and(|held| held.id == id && by_formula)
                    || beside.scene.selected == Some(id) && beside.handle_is_grabbed && beside.frames.is_slow()
            };
            let stale = beside.mirrors().find(|(id, mirror)| !is_held(*id, mirror) && !is_current(*id, mirror));
            if let Some((id, mirror)) = stale.map(|(id, mirror)| (id, mirror.clone())) {
                let has_points =
                    |sample: &&Sample| is_dense(sample, area_per_point) && mirror.has_points_of(&sample.mirror);
                match self.samples.of.get(&id).filter(has_points) {
                    Some(Sample { area_per_point, chunks, .. }) => {
                        let chunks = chunks.iter().map(|(chunk, _)| chunk.clone()).collect();
                        self.put_samples(id, mirror, *area_per_point, chunks, beside);
                    }
                    None => {
                        self.samples.under_way = Some(id);
                        beside.outside.work(Work::SampleMirror { id, mirror, area_per_point });
                    }
                }
            }
        }
        for entry in &mut self.clouds {
            let wanted: Vec<MirrorPoints> =
                beside.scene.objects.markings.iter().filter(|m| m.key == entry.key).map(|m| m.points.clone()).collect();
            match &entry.marking {
                Some((under_way, progress)) if *under_way != wanted => progress.cancel(),
                Some(_) => {}
                None if entry.marked != wanted => {
                    let progress = Arc::<Progress>::default();
                    entry.marking = Some((wanted.clone(), progress.clone()));
                    let (key, cloud, source) = (entry.key, entry.cloud.clone(), entry.source.clone());
                    beside.outside.work(Work::MarkPoints { key, cloud, source, wanted, progress });
                }
                None => {}
            }
        }
    }

    pub fn on_marked(
        &mut self,
        key: CloudKey,
        wanted: Vec<MirrorPoints>,
        result: Result<Option<Vec<Marked>>, String>,
        beside: &mut Beside<'_>,
    ) {
        let Some(entry) = self.cloud_mut(key) else { return };
        entry.marking = None;
        match result {
            Ok(None) => {
                let now: Vec<&MirrorPoints> =
                    beside.scene.objects.markings.iter().filter(|m| m.key == key).map(|m| &m.points).collect();
                // Unless a newer request has replaced it, someone has stopped the search: points that already reflect
                // stay so.
                if now.into_iter().eq(&wanted) {
                    let kept = self.cloud(key).map_or(Vec::new(), |entry| entry.marked.clone());
                    beside.scene.rewrite_objects(|objects| {
                        objects.markings.retain(|marking| marking.key != key || kept.contains(&marking.points));
                    });
                }
            }
            Ok(Some(marked)) => {
                let marked = Arc::new(marked);
                (entry.marked, entry.marks) = (wanted, marked.clone());
                let (chunks, layout, name) = (entry.chunks(), entry.layout(), entry.cloud.name.clone());
                let count: u64 = marked.iter().map(|marked| marked.count).sum();
                beside.outside.change(Change::Mark { cloud: key, chunks, layout, marked });
                beside.frames.points_changed();
                beside.outside.log(json!({ "event": "marked", "name": name, "points": count }));
            }
            Err(error) => {
                entry.marked = wanted.clone();
                beside.scene.rewrite_objects(|objects| {
                    objects.markings.retain(|marking| marking.key != key || !wanted.contains(&marking.points));
                });
                beside.outside.say(Level::Error, error);
            }
        }
    }

    /// Applies markings of scene files to clouds that have been opened since.
    pub fn place_awaited_markings(&mut self, beside: &mut Beside<'_>) {
        for points in std::mem::take(&mut self.awaited_markings) {
            let entry = self.clouds.iter().find(|entry| points.is_of(&entry.input, &entry.cloud.name));
            match entry.map(|entry| entry.key) {
                Some(key) => {
                    beside
                        .scene
                        .rewrite_objects(|objects| objects.markings.push(Marking { key, points: points.clone() }));
                }
                None => beside
                    .outside
                    .say(Level::Warning, text!("mirror points: no cloud is called `{cloud}`", cloud = points.cloud)),
            }
        }
    }
}
