//! How events of jobs open, extend, change and close clouds.

use std::path::Path;

use cloud::{Chunk, PointTest, Surfels};
use render::ColorPlan;
use scene::{Strays, Visibility};
use serde_json::json;
use world::{Assembly, Change, CloudKey, CloudTask, Event, Opened, Part, TaskStatus};

use crate::shared::language::text;
use crate::system::fetching;
use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::look::theme::grouped;
use crate::viewer::objects::clouds::apart;
use crate::viewer::objects::clouds::{CloudEntry, JobEntry, short_name};
use crate::viewer::objects::{ObjectId, Origin, PlacedLight};
use crate::viewer::requests::messages::Level;
use crate::viewer::scene::confines::Confines;

impl Loaded {
    pub fn on_loading(&mut self, job: u32, event: Event, beside: &mut Beside<'_>) {
        match event {
            Event::Opened { cloud, opened } => self.on_opened(job, cloud, opened, beside),
            Event::Chunk { cloud, part, chunk } => self.on_chunk(job, cloud, part, chunk, beside),
            Event::Pages { cloud, pages } => self.on_pages(job, cloud, pages, beside),
            Event::Task { cloud, task: stage } => {
                let key = self.key_of(job, cloud);
                if let Some(entry) = key.and_then(|key| self.cloud_mut(key)) {
                    entry.task = Some(stage);
                }
            }
            Event::Dropped { cloud, part } => self.on_dropped(job, cloud, part, beside),
            Event::Stream(stats) => self.on_stream(job, stats, beside),
            Event::Mirror { input, mirror, samples } => {
                let id = beside.scene.bring_mirror(mirror.clone(), Some(input), beside.outside);
                self.put_samples(id, mirror, None, samples, beside);
            }
            Event::Read { cloud, summary } => self.on_read(job, cloud, &summary, beside),
            Event::Surfels { cloud, surfels } => self.on_surfels(job, cloud, surfels, beside),
            Event::Failed { input, error, .. } => {
                let name = short_name(&input).to_string();
                // Some errors already contain the file's name, with its path.
                let text = if error.contains(&name) { error } else { format!("{name}: {error}") };
                match codec::is_address(Path::new(&input)) {
                    true => beside.outside.say_of_address(text, input),
                    false => beside.outside.say(Level::Error, text),
                }
            }
            Event::Mended { input, problem, has_come } => {
                let name = short_name(&input).to_string();
                beside.outside.take_back(&name, &problem);
                if has_come {
                    beside.outside.say(Level::Note, text!("{name}: what was missing is there now", name));
                }
            }
            Event::Finished => self.finish_job(job, beside),
        }
    }

    pub fn key_of(&self, job: u32, cloud: usize) -> Option<CloudKey> {
        self.jobs.iter().find(|entry| entry.id == job)?.clouds.get(&cloud).copied()
    }

    fn on_opened(&mut self, job: u32, index: usize, opened: Opened, beside: &mut Beside<'_>) {
        for warning in &opened.warnings {
            beside.outside.say(Level::Warning, format!("{}: {warning}", opened.name));
        }
        beside
            .outside
            .log(json!({ "event": "opened", "name": opened.name, "expected_points": opened.expected_points }));
        // A streamed cloud has no source to look records up in; a built-in scene has no file.
        let is_file = opened.source.is_some() || Path::new(&opened.input).exists();
        if is_file && opened.input != codec::Bytes::STANDARD_INPUT {
            // The next start may be in another folder.
            let is_address = codec::is_address(Path::new(&opened.input));
            let whole = std::path::absolute(&opened.input).ok().filter(|_| !is_address);
            let whole = whole.map_or_else(|| opened.input.clone(), |path| path.display().to_string());
            beside.preferences.remember_file(&whole);
        }
        let bounds = opened.source.as_ref().and_then(|source| source.info().bounds);
        let key = self.next_cloud_key();
        let (assembly, change) = Assembly::open(key, opened);
        beside.outside.change(change);
        self.clouds.push(CloudEntry::new(assembly));
        if let Some(entry) = self.jobs.iter_mut().find(|entry| entry.id == job) {
            entry.clouds.insert(index, key);
        }
        self.place_awaited_settings(key, beside);
        self.make_room(beside);
        let is_visible = self.cloud(key).is_some_and(|entry| entry.is_visible);
        if let Some(bounds) = bounds.filter(|_| is_visible) {
            beside.scene.frame_while_unplaced(bounds, &self.clouds);
        }
    }

    fn on_chunk(&mut self, job: u32, cloud: usize, part: Part, chunk: Chunk, beside: &mut Beside<'_>) {
        let key = self.key_of(job, cloud);
        let Some(entry) = key.and_then(|key| self.cloud_mut(key)) else { return };
        let change = entry.put(part, chunk);
        let (key, bounds) = (entry.key, entry.bounds);
        let is_first = entry.figures.is_none() && entry.cloud.chunks.len() == 1;
        let uncolored = is_first.then(|| (entry.cloud.clone(), entry.chunks(), entry.up));
        let has_header_bounds = entry.source.as_ref().is_some_and(|source| source.info().bounds.is_some());
        beside.outside.change(change);
        if let Some((cloud, chunks, up)) = uncolored {
            // Points that are drawn before the figures are known have colours, too.
            let shown = cloud.shown(&beside.scene.objects.test());
            let color = beside.scene.objects.color_of(key, &beside.scene.settings.color);
            let (plan, _) = ColorPlan::of_shown(&cloud, &shown, &color, up);
            if plan.missing_column(&cloud).is_none() {
                beside.outside.change(Change::Color { cloud: key, chunks, plan, up });
            }
        }
        self.tint_chunk(key, part, beside);
        beside.frames.points_changed();
        if !has_header_bounds && beside.frames.shown.is_none() {
            beside.scene.frame_while_unplaced(bounds, &self.clouds);
        }
    }

    fn on_dropped(&mut self, job: u32, cloud: usize, part: Part, beside: &mut Beside<'_>) {
        let key = self.key_of(job, cloud);
        let change = key.and_then(|key| self.cloud_mut(key)).and_then(|entry| entry.take_out(part));
        if let Some(change) = change {
            beside.outside.change(change);
            beside.frames.points_changed();
        }
    }

    fn on_read(&mut self, job: u32, cloud: usize, summary: &codec::Summary, beside: &mut Beside<'_>) {
        let key = self.key_of(job, cloud);
        let Some(entry) = key.and_then(|key| self.cloud_mut(key)) else { return };
        let warnings = entry.end(summary);
        let (name, points) = (entry.cloud.name.clone(), entry.points);
        for warning in warnings {
            beside.outside.say(Level::Warning, format!("{name}: {warning}"));
        }
        if summary.cancelled {
            let rest =
                if points > 0 { format!("; the {} points read so far stay", grouped(points)) } else { String::new() };
            beside.outside.say(Level::Note, text!("{name}: stopped{rest}", name, rest));
        }
        beside.outside.log(json!({ "event": "read", "name": name, "points": points, "cancelled": summary.cancelled }));
        // The index could not be made, which has been reported.
        let is_lost = |entry: &CloudEntry| entry.streamed.is_some() && !entry.is_indexed() && entry.points == 0;
        if let Some(key) = key.filter(|key| !summary.cancelled && self.cloud(*key).is_some_and(is_lost)) {
            self.remove_cloud(key, beside);
        }
        self.note_loaded(beside);
    }

    /// Jobs with streamed clouds stay under way: they count as loaded when the points for their first view are loaded.
    fn note_loaded(&mut self, beside: &mut Beside<'_>) {
        for index in 0..self.jobs.len() {
            let of_job = || self.clouds.iter().filter(|entry| self.jobs[index].owns(entry.key));
            let is_loaded = of_job().any(|entry| entry.streamed.is_some()) && of_job().all(|entry| entry.is_read);
            if is_loaded && !std::mem::replace(&mut self.jobs[index].is_loaded, true) {
                self.on_loaded(beside);
            }
        }
    }

    fn on_surfels(&mut self, job: u32, cloud: usize, surfels: Vec<Surfels>, beside: &mut Beside<'_>) {
        let key = self.key_of(job, cloud);
        let Some(entry) = key.and_then(|key| self.cloud_mut(key)) else { return };
        let changes = entry.put_surfels(surfels);
        entry.radii_test = PointTest::default();
        // The new normals and radii require that the reflecting points are found again.
        entry.marked = Vec::new();
        // Normals can change the colours of points. Figures that are under way do not know them.
        entry.figures_basis = None;
        entry.surfels += 1;
        let name = entry.cloud.name.clone();
        changes.into_iter().for_each(|change| beside.outside.change(change));
        beside.frames.points_changed();
        beside.outside.log(json!({ "event": "surfels", "name": name }));
    }

    fn finish_job(&mut self, job: u32, beside: &mut Beside<'_>) {
        let Some(index) = self.jobs.iter().position(|entry| entry.id == job) else { return };
        let job = self.jobs.remove(index);
        for entry in self.clouds.iter_mut().filter(|entry| job.owns(entry.key)) {
            entry.is_read = true;
        }
        // A file that could be opened but holds no points would be an entry without a picture.
        let empty = |entry: &CloudEntry| job.owns(entry.key) && entry.points == 0;
        let empty: Vec<(CloudKey, String)> = self
            .clouds
            .iter()
            .filter(|entry| empty(entry))
            .map(|entry| (entry.key, entry.cloud.name.clone()))
            .collect();
        for (key, name) in empty {
            self.remove_cloud(key, beside);
            if !job.progress.is_cancelled() {
                beside.outside.say(Level::Warning, text!("{name}: has no points", name));
            }
        }
        if !job.is_loaded {
            self.on_loaded(beside);
        }
    }

    /// Called when the points of a job are loaded, or as many as the first view needs.
    fn on_loaded(&mut self, beside: &mut Beside<'_>) {
        self.samples.area_per_point = None;
        self.place_awaited_markings(beside);
        self.end_awaiting();
        if !self.is_loading() {
            // What was named and is not there has been reported, or its points were not waited for.
            let strange = self.settings_of_absent().filter(|own| !self.words.contains(&own.cloud));
            let strange = strange.map(world::no_cloud).collect();
            self.warn_once(strange, "cloud settings without a cloud", beside);
        }
        self.ask_surroundings(beside);
        let visible: Vec<&CloudEntry> = self.clouds.iter().filter(|entry| entry.is_visible).collect();
        let elsewhere = apart(&visible).warnings;
        self.warn_once(elsewhere, "warnings about where clouds lie", beside);
        self.tell_idle_filters(beside);
        let points = self.points();
        beside.outside.log(json!({ "event": "loaded", "points": points, "clouds": self.clouds.len() }));
    }

    /// Says which filters, and hidden classes, hide nothing because clouds that are shown lack their attributes.
    pub fn tell_idle_filters(&mut self, beside: &mut Beside<'_>) {
        let test = beside.scene.objects.test();
        if test.tests_attributes() && !self.is_loading() {
            let visible = self.clouds.iter().filter(|entry| entry.is_visible);
            let offers: Vec<_> = visible.map(|entry| entry.offer(&beside.scene.settings)).collect();
            let idle = world::check_filters(&test, &offers).unwrap_or_else(|error| vec![error.to_string()]);
            self.warn_once(idle, "filters that hide nothing of a cloud", beside);
        }
    }

    /// Says why nothing is lit, once it is known that the scene has no light.
    pub fn tell_darkness(&mut self, beside: &mut Beside<'_>) {
        if !self.clouds.is_empty() && !self.is_loading() && self.light_search.is_known() {
            let dark = world::dark_warning(beside.scene.settings.light.by, &self.lights(beside.scene));
            self.warn_once(dark.into_iter().collect(), "warnings about light", beside);
        }
    }

    /// Says what has not been said yet; `what` names the kind of these warnings.
    fn warn_once(&mut self, warnings: Vec<String>, what: &str, beside: &mut Beside<'_>) {
        let unsaid = warnings.into_iter().filter(|warning| !self.warned.contains(warning)).collect::<Vec<_>>();
        self.warned.extend(unsaid.iter().cloned());
        param::few(unsaid, what).into_iter().for_each(|warning| beside.outside.say(Level::Warning, warning));
    }

    /// Whether points are still being loaded, regardless of the view.
    /// Whether nothing is open, and nothing is being opened.
    pub fn is_empty(&self) -> bool {
        let is_over = |job: &JobEntry| job.is_loaded || job.progress.is_cancelled();
        self.clouds.is_empty() && self.jobs.iter().all(is_over)
    }

    /// Whether a built-in scene is being loaded, whose mirrors are still to come.
    pub fn is_loading_built_in(&self) -> bool {
        let is_built_in = |job: &JobEntry| self.clouds.iter().any(|entry| job.owns(entry.key) && entry.is_built_in());
        self.jobs.iter().any(|job| !job.is_loaded && is_built_in(job))
    }

    /// Stops loading, and closes all clouds.
    pub fn close_all(&mut self, beside: &mut Beside<'_>) {
        self.stop_loading(beside);
        self.awaited_settings.clear();
        self.ghosts.under_way.iter().for_each(|progress| progress.cancel());
        self.ghosts.seen = None;
        self.ghosts.live = Default::default();
        let keys: Vec<CloudKey> = self.clouds.iter().map(|entry| entry.key).collect();
        for key in keys {
            self.remove_cloud(key, beside);
        }
    }

    pub fn is_loading(&self) -> bool {
        self.jobs.iter().any(|job| !job.is_loaded)
    }

    /// The number of loaded points of all clouds, and of the mirrors of built-in scenes.
    pub fn points(&self) -> u64 {
        let brought = self.samples.of.values().filter(|sample| sample.area_per_point.is_none());
        let of_mirrors = brought.flat_map(|sample| &sample.chunks).map(|(chunk, _)| chunk.len() as u64).sum::<u64>();
        self.clouds.iter().map(|entry| entry.points).sum::<u64>() + of_mirrors
    }

    /// The number of points, including the points of streamed clouds that are not loaded.
    pub fn all_points(&self) -> u64 {
        let elsewhere = self.clouds.iter().filter(|entry| entry.streamed.is_some());
        self.points() + elsewhere.map(|entry| entry.total() - entry.points).sum::<u64>()
    }

    /// The task under way for one of a job's clouds, or the next task.
    pub fn stage_of(&self, job: &JobEntry) -> Option<(&CloudEntry, &CloudTask)> {
        let of_job = self.clouds.iter().filter(|entry| job.owns(entry.key));
        let pending =
            of_job.filter_map(|entry| Some((entry, entry.task.as_deref().filter(|stage| stage.is_pending())?)));
        pending.min_by_key(|(_, stage)| stage.status() == TaskStatus::Queued)
    }

    /// Whether a job shows its progress: it loads points, or a task is under way for one of its clouds.
    pub fn is_at_work(&self, job: &JobEntry) -> bool {
        !job.is_loaded || self.stage_of(job).is_some()
    }

    /// Stops loading. Points that have been read stay.
    pub fn stop_loading(&mut self, beside: &mut Beside<'_>) {
        for job in self.jobs.iter().filter(|job| self.is_at_work(job)) {
            job.progress.cancel();
            job.mailbox.stop_all();
        }
        fetching::stop_all();
        beside.outside.log(json!({ "event": "cancelled" }));
    }

    pub fn remove_cloud(&mut self, key: CloudKey, beside: &mut Beside<'_>) {
        let Some(index) = self.clouds.iter().position(|entry| entry.key == key) else { return };
        let input = self.clouds.remove(index).input.clone();
        self.samples.area_per_point = None;
        let is_last = self.clouds.is_empty();
        // Built-in scenes have no file.
        let is_built_in_left = self.clouds.iter().any(CloudEntry::is_built_in);
        // Closing a built-in scene removes its mirrors, and closing the last one removes its lights. Closing the last
        // cloud removes all objects, and shows hidden points again.
        beside.scene.rewrite_objects(|objects| {
            if is_last {
                objects.visibility = Visibility::default();
            }
            let goes = |placed: &&PlacedLight| !is_built_in_left && placed.origin == Origin::BuiltIn;
            let lights = objects.lights.iter().filter(goes).map(|placed| placed.id);
            let mirrors = objects.mirrors.iter().filter(|placed| placed.input.as_ref() == Some(&input));
            let gone: Vec<ObjectId> = mirrors.map(|placed| placed.id).chain(lights).collect();
            objects.keep(|id| !is_last && !gone.contains(&id));
            objects.no_guess &= !is_last;
            objects.markings.retain(|marking| marking.key != key);
            objects.own_settings.retain(|own| own.key != key);
        });
        beside.outside.change(Change::Close { cloud: key });
        beside.frames.points_changed();
        // The job of a closed cloud does not need to go on.
        for job in &self.jobs {
            if let Some((index, _)) = job.clouds.iter().find(|(_, cloud)| **cloud == key) {
                job.mailbox.close(*index);
            }
            if !job.clouds.is_empty() && !self.clouds.iter().any(|entry| job.owns(entry.key)) {
                job.progress.cancel();
                job.mailbox.end();
            }
        }
        self.note_loaded(beside);
        if is_last {
            beside.scene.camera_is_placed = false;
            beside.scene.room = None;
            beside.scene.confines = Confines::default();
            beside.scene.rewrite_objects(|objects| {
                objects.paths.clear();
                objects.bookmarks.clear();
            });
            beside.frames.shown = None;
            self.light_search.forget();
        }
        self.ask_surroundings(beside);
    }

    /// Updates the render thread to the current visibility. Called before each frame is requested.
    pub fn sync_visibility(&mut self, beside: &mut Beside<'_>) {
        self.sync_own_settings(beside);
        let hides_strays = beside.scene.settings.splat.strays == Strays::Hidden;
        let test = beside.scene.objects.test().hiding_strays(hides_strays);
        if test != self.drawn_test {
            self.drawn_test = test.clone();
            beside.outside.change(Change::Visibility { test });
            self.samples.area_per_point = None;
            beside.frames.points_changed();
        }
    }
}
