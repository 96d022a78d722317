//! What is found under a pixel of the picture, and what comes of it.

use cloud::{Bounds, Chunk};
use glam::DVec3;
use serde_json::json;

use super::inspection::{self, Target};
use super::objects::{ObjectId, Placed};
use super::pick::{Distance, Pick, loaded_attributes};
use super::render_thread::{PickPurpose, PickedPoint};
use super::session::Session;
use super::work::Work;

impl Session {
    /// World position of a point: the file's own coordinates.
    pub fn world_position(&self, picked: PickedPoint) -> Option<DVec3> {
        let entry = self.loaded.cloud(picked.chunk.cloud)?;
        let chunk = entry.chunk(picked.chunk.part).filter(|chunk| picked.index < chunk.len())?;
        Some(entry.cloud.world_position(chunk, picked.index))
    }

    /// Normal of a point, if it has one.
    pub fn normal_at(&self, picked: PickedPoint) -> Option<DVec3> {
        let chunk = self.loaded.cloud(picked.chunk.cloud)?.chunk(picked.chunk.part)?;
        let normal = *chunk.normals.as_ref()?.get(picked.index)?;
        Some(cloud::unpack_normal(normal)?.as_dvec3())
    }

    pub(super) fn on_picked(&mut self, pixel: [u32; 2], purpose: PickPurpose, point: Option<PickedPoint>) {
        let found = point.and_then(|point| Some((point, self.world_position(point)?)));
        // Where a mirror is drawn by its formula there is no point, and where it stands in front the point is not meant.
        let lens = self.scene.lens();
        let depth = |world: DVec3| lens.forward().dot(world - self.scene.camera.eye);
        let mirror = self.mirror_at(pixel);
        let mirror = mirror.filter(|(_, at)| found.is_none_or(|(_, world)| depth(*at) <= depth(world)));
        let world = mirror.map(|(_, world)| world).or(found.map(|(_, world)| world));
        match (purpose, world) {
            (PickPurpose::Hover, world) => {
                self.scene.navigation.on_hover(pixel, world);
                self.scene.apply_pending_zoom(true, self.outside.now);
            }
            (PickPurpose::Pivot, Some(world)) => {
                let mut camera = self.scene.camera;
                camera.recenter(world);
                self.scene.jump(self.outside.now, self.scene.settings.clone(), camera);
                self.scene.navigation.show_pivot(self.outside.now);
                self.outside.log(json!({ "event": "pivot", "world": world.to_array() }));
            }
            (PickPurpose::Pivot, None) => self.outside.note("No point there to turn about"),
            (PickPurpose::Select, _) => match (mirror, found) {
                (Some((id, _)), _) => {
                    self.scene.selected = Some(id);
                    self.outside
                        .log(json!({ "event": "selected", "mirror": self.scene.objects.mirror(id).map(|m| &m.name) }));
                }
                (None, Some((point, world))) => {
                    self.scene.selected = None;
                    self.select(point, world);
                }
                (None, None) => {}
            },
        }
    }

    /// The mirror under a pixel, and where: by the points that stand for it.
    fn mirror_at(&self, pixel: [u32; 2]) -> Option<(ObjectId, DVec3)> {
        let lens = self.scene.lens();
        let hit = |placed: &Placed| {
            let sample = self.loaded.samples.of.get(&placed.id)?;
            let target =
                |(chunk, bounds): &(Chunk, Bounds)| Target { chunk: chunk.clone(), bounds: *bounds, classes: None };
            let ray = self.scene.sight_line(pixel, sample.chunks.iter().map(target).collect());
            Some((placed.id, inspection::cast(&ray)?.position))
        };
        let depth = |world: DVec3| lens.forward().dot(world - self.scene.camera.eye);
        let hits = self.scene.objects.mirrors.iter().filter_map(hit);
        hits.min_by(|a, b| depth(a.1).total_cmp(&depth(b.1)))
    }

    fn select(&mut self, point: PickedPoint, world: DVec3) {
        let Some(entry) = self.loaded.cloud(point.chunk.cloud) else { return };
        let Some(chunk) = entry.chunk(point.chunk.part) else { return };
        let number = chunk.first_point + point.index as u64;
        let is_streamed = entry.streamed.is_some();
        let source = entry.source.clone().filter(|_| !is_streamed);
        let cloud = entry.cloud.name.clone();
        let record = source.is_none().then(|| Ok(loaded_attributes(&entry.cloud, chunk, point.index)));
        if self.picks.len() == 2 {
            self.picks.remove(0);
        }
        self.outside.log(json!({ "event": "picked", "cloud": cloud, "point": number, "world": world.to_array() }));
        self.picks.push(Pick { point, number, cloud, world, record, is_streamed });
        if let Some(source) = source {
            self.outside.work(Work::ReadRecord { picked: point, record: number, source });
        }
        if let Some(distance) = self.distance() {
            self.outside.log(json!({
                "event": "distance", "total": distance.total, "horizontal": distance.horizontal,
                "vertical": distance.vertical,
            }));
        }
    }

    /// Between the two picked points.
    pub fn distance(&self) -> Option<Distance> {
        let [first, second] = self.picks.as_slice() else { return None };
        let difference = second.world - first.world;
        let vertical = difference.dot(self.up());
        let horizontal = (difference - self.up() * vertical).length();
        Some(Distance { total: difference.length(), horizontal, vertical })
    }
}
