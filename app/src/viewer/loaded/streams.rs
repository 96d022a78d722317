//! Streamed clouds in the window: the state of their indexes, the views that they are loaded for, and what cannot be done
//! with them.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use cloud::{Attribute, Bounds, Placement, attribute_named};
use scene::Settings;
use serde_json::json;
use world::{Change, CloudKey, IndexState, Part, StreamStats, StreamView, most_points};

use crate::shared::language::text;
use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::clouds::{CloudEntry, JobEntry, Streamed};
use crate::viewer::picture::pace::shares;
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;

impl Loaded {
    pub fn on_pages(&mut self, job: u32, cloud: usize, pages: IndexState, beside: &mut Beside<'_>) {
        if let Some(entry) = self.jobs.iter_mut().find(|entry| entry.id == job) {
            entry.has_streamed = true;
        }
        let key = self.key_of(job, cloud);
        let Some(entry) = key.and_then(|key| self.cloud_mut(key)) else { return };
        let rests = entry.streamed.as_ref().map_or(0, |streamed| streamed.rests);
        let was_indexed = entry.is_indexed();
        let has_surfels = matches!(pages, IndexState::Indexed { has_surfels: true, .. });
        let is_kept = pages.entry().is_some();
        let change = entry.page(pages);
        entry.streamed = Some(Streamed::new(entry.octree().map(Arc::as_ref), rests));
        let bounds = entry.index_bounds().unwrap_or(Bounds::EMPTY);
        let (key, name) = (entry.key, entry.cloud.name.clone());
        beside.outside.change(change);
        self.make_room(beside);
        if self.cloud(key).is_some_and(CloudEntry::is_indexed) {
            let total = self.cloud(key).map_or(0, |entry| entry.total());
            beside.outside.log(json!({ "event": "pages", "name": name, "points": total, "surfels": has_surfels }));
            if is_kept {
                beside.outside.work(Work::MeasureCache);
            }
            if !was_indexed {
                beside.scene.frame_while_unplaced(bounds, &self.clouds);
            }
        } else {
            beside.outside.log(json!({ "event": "indexing", "name": name }));
        }
    }

    /// Informs the render thread how many points will be resident at once, if that number has changed: all points of
    /// clouds held in memory, and as many points of streamed clouds as the budgets allow.
    pub fn make_room(&mut self, beside: &mut Beside<'_>) {
        let total = |is_streamed: bool| -> u64 {
            let clouds = self.clouds.iter().filter(|entry| entry.streamed.is_some() == is_streamed);
            clouds.map(|entry| entry.total()).sum()
        };
        let chunks = self.samples.of.values().flat_map(|sample| &sample.chunks);
        let samples: u64 = chunks.map(|(chunk, _)| chunk.len() as u64).sum();
        let most = most_points(&beside.scene.settings.view, &beside.scene.settings.stream);
        let points = total(false) + samples + total(true).min(most);
        if std::mem::replace(&mut self.expected_points, points) != points {
            beside.outside.change(Change::Expect { points });
        }
    }

    fn streaming_jobs(&self) -> usize {
        self.jobs.iter().filter(|job| job.has_streamed).count()
    }

    /// The settings for the next job: its share of the budgets already holds for the preview.
    pub fn settings_of_next_job(&self, settings: &Settings) -> Settings {
        let mut settings = settings.clone();
        let jobs = self.streaming_jobs() + 1;
        settings.view.point_budget /= jobs as u32;
        settings.stream.gpu_bytes.0 /= jobs as u64;
        settings.stream.host_bytes.0 /= jobs as u64;
        settings
    }

    pub fn on_stream(&mut self, job: u32, stats: StreamStats, beside: &mut Beside<'_>) {
        let Some(entry) = self.jobs.iter_mut().find(|entry| entry.id == job) else { return };
        let comes_to_rest = stats.is_settled && entry.is_streaming();
        entry.stream = stats;
        if !comes_to_rest || entry.is_streaming() {
            return;
        }
        // What was asked for again in vain changes nothing.
        let rested = Some((stats.view_number, stats.nodes, stats.points_resident));
        if std::mem::replace(&mut entry.rested, rested) == rested {
            return;
        }
        let keys: Vec<CloudKey> = entry.clouds.values().copied().collect();
        for entry in self.clouds.iter_mut().filter(|entry| keys.contains(&entry.key)) {
            if let Some(streamed) = &mut entry.streamed {
                streamed.rests += 1;
            }
        }
        beside.outside.log(json!({
            "event": "streamed", "points": stats.points_resident, "nodes": stats.nodes, "host_bytes": stats.host_bytes,
        }));
    }

    /// Whether points that the picture needs are still being loaded.
    pub fn points_come(&self) -> bool {
        self.is_loading() || self.jobs.iter().any(JobEntry::is_streaming)
    }

    /// Whether the picture is about to change by itself: points that it needs are being read or moved, their colours are
    /// computed, or the light around them is searched for. Normals and radii take longer than people wait, so they do
    /// not count.
    pub fn soon_changes(&self) -> bool {
        let is_read =
            |job: &JobEntry| job.is_fetching() || self.clouds.iter().any(|entry| job.owns(entry.key) && !entry.is_read);
        // The colours of all points follow those of the first ones.
        let lacks_figures = |entry: &CloudEntry| {
            entry.figures_under_way && entry.figures_basis.as_ref().is_none_or(|basis| !basis.is_read)
        };
        let changes = |entry: &CloudEntry| entry.is_placing || lacks_figures(entry);
        self.jobs.iter().any(is_read) || self.clouds.iter().any(changes) || !self.light_search.is_known()
    }

    /// Whether indirect light may stay while points are loaded and removed. At first there is no light that could stay.
    pub fn light_may_lag(&self) -> bool {
        !self.is_loading() && self.jobs.iter().any(JobEntry::is_fetching)
    }

    /// Sends the current view to the jobs of streamed clouds, if it has changed. Called every frame of the window.
    pub fn look_around(&mut self, beside: &mut Beside<'_>) {
        self.make_room(beside);
        let view = beside.scene.settings.view.clone();
        let (camera, size, stream) =
            (beside.scene.camera, beside.scene.view_size, beside.scene.settings.stream.clone());
        let mirrors: Vec<_> = beside.mirrors().map(|(_, mirror)| world::mirrors::bound(mirror)).collect();
        let (test, is_alone) = (beside.scene.objects.test(), beside.is_recorded);
        let asked = self.asked_attributes(beside.scene);
        self.await_attributes(&asked, beside);
        let streaming = || self.jobs.iter().filter(|job| job.has_streamed);
        let demands: Vec<f64> = streaming().map(|job| if job.look == 0 { 1.0 } else { job.stream.demand }).collect();
        let clouds: Vec<_> = streaming().map(|job| (self.hidden(job), self.placed(job))).collect();
        // Whoever moves the camera wants to see what is there.
        let is_moving = beside.scene.navigation.time_to_rest(beside.outside.now).is_some();
        let waits: Vec<bool> = streaming().map(|job| !is_moving && self.awaits_first_tiles(job)).collect();
        let jobs = self.jobs.iter_mut().filter(|job| job.has_streamed);
        for ((job, waits), ((hidden, placed), share)) in jobs.zip(waits).zip(clouds.into_iter().zip(shares(&demands))) {
            let (view, stream, mirrors) = (view.clone(), stream.clone(), mirrors.clone());
            let (test, asked) = (test.clone(), asked.clone());
            job.share = share;
            if waits {
                continue;
            }
            let view = StreamView { camera, size, view, stream, mirrors, hidden, placed, test, asked, share, is_alone };
            job.look = job.mailbox.set_view(view);
        }
    }

    /// Whether no view was sent yet, since the tiles of a catalogue are opened from which its colours, light and the first
    /// camera come, wherever the view is.
    fn awaits_first_tiles(&self, job: &JobEntry) -> bool {
        let is_opened = |entry: &CloudEntry| job.owns(entry.key) && entry.is_catalogue() && !entry.is_read;
        job.look == 0 && self.clouds.iter().any(is_opened)
    }

    /// The names of the attributes that the colours and filters of the scene ask for. Points of streamed clouds become no
    /// mirrors here.
    pub fn asked_attributes(&self, scene: &Scene) -> BTreeSet<String> {
        let own = scene.objects.own_settings.iter().map(|own| &own.settings);
        let own = own.chain(&self.awaited_settings);
        world::asked_attributes(&scene.settings, &scene.objects.visibility, own, &[])
    }

    /// Notes which attributes streamed clouds are to get, and says so where that takes a while.
    fn await_attributes(&mut self, asked: &BTreeSet<String>, beside: &mut Beside<'_>) {
        for entry in self.clouds.iter_mut().filter(|entry| entry.is_indexed()) {
            let is_awaited = |name: &&String| {
                let offered: Vec<Attribute> = entry.offered().cloned().collect();
                entry.cloud.column_of(name).is_none() && attribute_named(&offered, name).is_some()
            };
            let awaited: Vec<String> = asked.iter().filter(is_awaited).cloned().collect();
            let is_more = awaited.iter().any(|name| !entry.awaited.contains(name));
            if is_more && entry.pages.as_ref().is_some_and(|pages| pages.entry().is_some()) {
                let (name, awaited) = (&entry.cloud.name, awaited.join(", "));
                beside
                    .outside
                    .say(Level::Note, text!("{name}: its index is made again, with {awaited}", name, awaited));
            }
            entry.awaited = awaited;
        }
    }

    /// The hidden clouds of a job, by the job's own cloud numbers.
    fn hidden(&self, job: &JobEntry) -> BTreeSet<usize> {
        let is_hidden = |key: &CloudKey| self.cloud(*key).is_some_and(|entry| !entry.is_visible);
        job.clouds.iter().filter(|(_, key)| is_hidden(key)).map(|(cloud, _)| *cloud).collect()
    }

    /// How the clouds of a job are moved, by the job's own cloud numbers.
    fn placed(&self, job: &JobEntry) -> BTreeMap<usize, Placement> {
        let placement = |key: &CloudKey| self.cloud(*key)?.placement();
        job.clouds.iter().filter_map(|(cloud, key)| Some((*cloud, placement(key)?))).collect()
    }

    /// The job under way for a cloud, and the cloud's number in that job.
    pub fn job_of(&self, key: CloudKey) -> Option<(&JobEntry, usize)> {
        self.jobs.iter().find_map(|job| {
            let (cloud, _) = job.clouds.iter().find(|(_, other)| **other == key)?;
            Some((job, *cloud))
        })
    }

    /// Stops the tasks for a cloud.
    pub fn stop_making(&mut self, key: CloudKey) {
        if let Some((job, cloud)) = self.job_of(key) {
            job.mailbox.stop(cloud);
        }
    }

    /// Resumes the tasks for a cloud that were stopped.
    pub fn resume_making(&mut self, key: CloudKey) {
        let Some((job, cloud)) = self.job_of(key) else { return };
        job.mailbox.resume(cloud);
        if let Some(entry) = self.cloud_mut(key) {
            entry.task = None;
        }
    }

    /// Closes a cloud and deletes its index.
    pub fn delete_index(&mut self, key: CloudKey, beside: &mut Beside<'_>) {
        let kept = self.cloud(key).and_then(|entry| entry.pages.as_ref()?.entry().cloned());
        if let Some(kept) = kept {
            self.remove_cloud(key, beside);
            beside.outside.work(Work::DeleteIndex(kept));
        }
    }

    // ---- levels ----

    /// Colours a new chunk by its level, if levels are shown.
    pub fn tint_chunk(&mut self, key: CloudKey, part: Part, beside: &mut Beside<'_>) {
        if self.levels_are_shown
            && let Some(color) = self.cloud(key).and_then(|entry| entry.level_color(part))
        {
            beside.outside.change(Change::Tint { tints: vec![(key.chunk(part), Some(color))] });
        }
    }

    /// Starts or stops colouring points by level. Called every frame of the window.
    pub fn sync_levels(&mut self, beside: &mut Beside<'_>) {
        if self.levels_are_shown == beside.scene.settings.stream.overlay {
            return;
        }
        self.levels_are_shown = beside.scene.settings.stream.overlay;
        let is_shown = self.levels_are_shown;
        let tints = |entry: &CloudEntry| {
            let parts = entry.chunk_bounds().map(|(part, _)| part);
            let tints = parts.map(|part| (entry.key.chunk(part), entry.level_color(part).filter(|_| is_shown)));
            tints.collect::<Vec<_>>()
        };
        let streamed = self.clouds.iter().filter(|entry| entry.streamed.is_some());
        let all: Vec<Vec<_>> = streamed.map(tints).collect();
        for tints in all {
            beside.outside.change(Change::Tint { tints });
            beside.frames.points_changed();
        }
    }

    // ---- what cannot be done with streamed clouds ----

    /// Refuses to mark points of streamed clouds: they are loaded and removed, so they cannot be divided into mirror
    /// and other points once and for all.
    pub fn refuse_marking_streamed(&mut self, beside: &mut Beside<'_>) {
        let is_marked = |entry: &&CloudEntry| {
            entry.streamed.is_some() && beside.scene.objects.markings.iter().any(|marking| marking.key == entry.key)
        };
        let refused: Vec<(CloudKey, String)> =
            self.clouds.iter().filter(is_marked).map(|entry| (entry.key, entry.cloud.name.clone())).collect();
        for (key, name) in refused {
            beside.scene.rewrite_objects(|objects| objects.markings.retain(|marking| marking.key != key));
            beside.outside.say(Level::Error, format!("{name}: {NOT_MARKED}"));
        }
    }
}

/// The reason why points of a streamed cloud cannot be turned into a mirror, and what the user can do.
pub const NOT_MARKED: &str = "is streamed, so its points come and go and cannot be turned into a mirror; \
    with stream.pages set to never it is held in memory";

#[cfg(test)]
mod tests;
