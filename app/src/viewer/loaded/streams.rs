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
        let waits: Vec<bool> = streaming().map(|job| self.has_first_tiles(job)).collect();
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

    /// Whether the tiles of a catalogue are opened from which its colours, light and the first camera come, wherever the view
    /// is.
    fn has_first_tiles(&self, job: &JobEntry) -> bool {
        self.clouds.iter().any(|entry| job.owns(entry.key) && entry.is_catalogue() && !entry.is_read)
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
mod tests {
    use cloud::{Attribute, Chunk, Column, ColumnType, Grid};
    use glam::DVec3;
    use scene::MirrorPoints;
    use stream::{NodeId, Octree};
    use world::{Event, Opened};

    use super::*;
    use crate::viewer::bench::devices;
    use crate::viewer::objects::Marking;
    use crate::viewer::objects::figures::Figures;
    use crate::viewer::picture::messages::{Command, PickPurpose, PickedPoint, Report};
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::requests::work::Found;
    use crate::viewer::session::Session;

    const GRID: Option<Grid> = Some(Grid::new(DVec3::splat(0.01), DVec3::ZERO));

    /// A root of two points with two children of three points each. The first child has no points of its own; its child
    /// holds all three.
    fn octree() -> Octree {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::splat(8.0) };
        let node = |level, points, total, first_point, parent: Option<u32>| stream::Node {
            level,
            bounds,
            points,
            is_exact: false,
            total,
            first_point,
            parent: parent.map(NodeId),
            children: [None; 8],
        };
        let mut nodes = vec![
            node(0, 2, 8, 0, None),
            node(1, 0, 3, 2, Some(0)),
            node(2, 3, 3, 2, Some(1)),
            node(1, 3, 3, 5, Some(0)),
        ];
        (nodes[0].children[0], nodes[0].children[7], nodes[1].children[0]) =
            (Some(NodeId(1)), Some(NodeId(3)), Some(NodeId(2)));
        Octree::new(DVec3::ZERO, 8.0, 1.0, nodes)
    }

    fn chunk(first_point: u64, places: &[f32]) -> Chunk {
        let mut chunk = Chunk::new(first_point, DVec3::ZERO, places.iter().map(|at| [*at; 3]).collect());
        chunk.columns = vec![Some(Arc::new(Column::U8(places.iter().map(|at| *at as u8).collect())))];
        chunk
    }

    fn put(session: &mut Session, node: u32, places: &[f32]) {
        let first_point = octree().nodes[node as usize].first_point;
        let chunk = chunk(first_point, places);
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, Event::Chunk { cloud: 0, part: Part::Node(NodeId(node)), chunk }, beside)
        });
    }

    fn drop_chunk(session: &mut Session, node: u32) {
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, Event::Dropped { cloud: 0, part: Part::Node(NodeId(node)) }, beside)
        });
    }

    fn opened(attributes: Vec<Attribute>) -> Event {
        let (name, input) = ("survey".into(), "survey".into());
        let opened = Opened { name, input, attributes, expected_points: 9, up: DVec3::Z, ..Opened::default() };
        Event::Opened { cloud: 0, opened }
    }

    /// A session with a streamed cloud of job 0, whose index exists, and the chunk of its root.
    fn streamed() -> Session {
        let mut session = Session::new(Preferences::default());
        session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
        let intensity = Attribute { name: "intensity".into(), column_type: ColumnType::U8 };
        session.with_loaded(|loaded, beside| loaded.on_loading(0, opened(vec![intensity.clone()]), beside));
        let pages = IndexState::Indexed {
            octree: Arc::new(octree()),
            attributes: vec![intensity],
            grid: GRID,
            was_built: false,
            has_surfels: true,
            entry: None,
        };
        session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Pages { cloud: 0, pages }, beside));
        put(&mut session, 0, &[1.0, 7.0]);
        session.scene.history.watch(&session.scene.settings, &session.scene.objects, false, session.outside.now);
        session
    }

    /// Reports that all points for the last view are loaded.
    fn settle(session: &mut Session) {
        session.with_loaded(Loaded::look_around);
        let stats =
            StreamStats { view_number: session.loaded.jobs[0].look, is_settled: true, ..StreamStats::default() };
        session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Stream(stats), beside));
    }

    fn commands(session: &mut Session) -> Vec<Change> {
        let effects = std::mem::take(&mut session.outside.effects).into_iter();
        let change = |effect| if let Effect::Render(Command::Change(change)) = effect { Some(change) } else { None };
        effects.filter_map(change).collect()
    }

    #[test]
    fn points_and_bounds_are_counted_right_while_chunks_come_change_and_go() {
        let mut session = Session::new(Preferences::default());
        session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
        session.with_loaded(|loaded, beside| loaded.on_loading(0, opened(Vec::new()), beside));
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, Event::Pages { cloud: 0, pages: IndexState::Indexing }, beside)
        });
        put(&mut session, 0, &[1.0]);
        put(&mut session, 3, &[2.0, 6.0, 8.0]);
        put(&mut session, 0, &[1.0, 3.0]);
        let revision = session.frames.revision;
        assert_eq!(
            (session.loaded.clouds[0].points, session.loaded.points(), session.loaded.clouds[0].cloud.len()),
            (5, 5, 5)
        );
        assert_eq!(session.bounds().max, DVec3::splat(8.0));
        drop_chunk(&mut session, 3);
        assert_eq!((session.loaded.clouds[0].points, session.loaded.clouds[0].cloud.len()), (2, 2));
        assert_eq!((session.bounds().min, session.bounds().max), (DVec3::ONE, DVec3::splat(3.0)));
        assert!(session.frames.revision > revision && session.loaded.clouds[0].chunk_bounds().len() == 1);
        let removed =
            |command: &Change| matches!(command, Change::TakeOut { key } if key.part == Part::Node(NodeId(3)));
        assert_eq!(commands(&mut session).iter().filter(|command| removed(command)).count(), 1);
        let revision = session.frames.revision;
        drop_chunk(&mut session, 3);
        assert!(commands(&mut session).is_empty() && session.frames.revision == revision, "it has gone already");
    }

    #[test]
    fn what_is_drawn_first_has_its_colours() {
        let mut session = streamed();
        let sent = commands(&mut session);
        let chunk = sent.iter().position(|command| matches!(command, Change::Put { .. }));
        let color = sent.iter().position(
            |command| matches!(command, Change::Color { plan, .. } if plan.source == render::ColorSource::Column(0)),
        );
        assert!(chunk.is_some() && color > chunk, "{chunk:?}, {color:?}");
        put(&mut session, 3, &[2.0, 3.0, 4.0]);
        assert!(!commands(&mut session).iter().any(|command| matches!(command, Change::Color { .. })));
    }

    #[test]
    fn points_take_no_more_of_the_gpu_than_they_may() {
        let Some([_, gpu]) = devices() else { return };
        let mut settings = Settings::default();
        settings.stream.gpu_bytes.0 = 96 << 20;
        let points = most_points(&settings.view, &settings.stream);
        let mut store = render::PointStore::new(gpu);
        store.reserve(points);
        let cloud = store.add_cloud(render::Material::default());
        // Chunks of this size are as large as small nodes.
        let chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 10_001]);
        for _ in 0..points / chunk.len() as u64 {
            store.add_chunk(cloud, &chunk, None).unwrap();
        }
        // Without spare room a point takes 48 bytes. This store holds 24 of them, because it has no attribute and no
        // mirrors.
        let bytes = store.gpu_bytes() * 2;
        // Memory is allocated in units of this many points.
        let grain = 48 << 18;
        assert!(bytes <= settings.stream.gpu_bytes.0 + grain, "{bytes}");
        assert!(bytes > settings.stream.gpu_bytes.0 / 2, "{bytes}: much less than it may be");
    }

    #[test]
    fn bounds_and_number_of_a_streamed_cloud_are_those_of_its_index() {
        let mut session = streamed();
        assert_eq!(session.bounds(), octree().nodes[0].bounds);
        put(&mut session, 3, &[2.0, 3.0, 4.0]);
        drop_chunk(&mut session, 0);
        assert_eq!(session.bounds(), octree().nodes[0].bounds);
        assert_eq!((session.loaded.points(), session.loaded.all_points(), session.loaded.clouds[0].total()), (3, 8, 8));
        assert_eq!(session.document.title(false, &session.loaded), "survey - 8 points - glint");
        let room = |session: &mut Session| {
            let commands = commands(session).into_iter();
            commands
                .filter_map(|command| if let Change::Expect { points } = command { Some(points) } else { None })
                .last()
        };
        assert_eq!(room(&mut session), Some(8), "no more room is made than all points take");
        session.scene.settings.view.point_budget = 4;
        session.with_loaded(Loaded::look_around);
        assert_eq!(room(&mut session), Some(4), "nor than may be there");
        session.with_loaded(Loaded::look_around);
        assert_eq!(room(&mut session), None);
    }

    #[test]
    fn a_streamed_cloud_is_loaded_with_its_first_look_and_at_rest_with_its_last() {
        let mut session = streamed();
        assert!(session.loaded.is_loading() && session.loaded.points_come());
        settle(&mut session);
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, Event::Read { cloud: 0, summary: codec::Summary::default() }, beside)
        });
        assert!(!session.loaded.is_loading() && !session.loaded.points_come());
        assert!(session.loaded.soon_changes(), "the light is searched for");
        let asked = session.loaded.light_search.ask();
        session.loaded.light_search.answer(asked, Default::default());
        session.loaded.clouds.iter_mut().for_each(|entry| entry.figures_under_way = false);
        assert!(!session.loaded.soon_changes());
        assert!(
            session.outside.effects.iter().any(|effect| matches!(effect, Effect::Work(Work::FindSurroundings { .. })))
        );
        session.scene.camera.eye += DVec3::ONE;
        session.with_loaded(Loaded::look_around);
        assert!(!session.loaded.is_loading() && session.loaded.points_come() && session.loaded.soon_changes());
        let late =
            StreamStats { view_number: session.loaded.jobs[0].look - 1, is_settled: true, ..StreamStats::default() };
        session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Stream(late), beside));
        assert!(session.loaded.points_come(), "that is about an earlier look");
        settle(&mut session);
        assert!(!session.loaded.points_come() && !session.loaded.soon_changes());
        let rests = |session: &Session| session.loaded.clouds[0].streamed.as_ref().unwrap().rests;
        assert_eq!(rests(&session), 2);
        // What could not be read is asked for again, in vain and then not.
        let view_number = session.loaded.jobs[0].look;
        for (points_resident, expected) in [(0, 2), (7, 3)] {
            for is_settled in [false, true] {
                let stats = StreamStats { view_number, is_settled, points_resident, ..StreamStats::default() };
                session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Stream(stats), beside));
            }
            assert_eq!(rests(&session), expected);
        }
        session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Finished, beside));
        assert!(session.loaded.jobs.is_empty() && session.loaded.clouds.len() == 1);
    }

    #[test]
    fn ramp_and_camera_of_a_catalogue_are_those_of_its_first_look_and_not_of_the_tiles_that_come_first() {
        let mut session = streamed();
        let tiles = |numbers: std::ops::Range<u32>| {
            let mut catalogue = octree();
            catalogue.paged.tiles = numbers.map(|tile| (tile, Arc::new(octree()))).collect();
            let (octree, attributes) = (Arc::new(catalogue), session.loaded.clouds[0].cloud.attributes.clone());
            let entry = None;
            let pages =
                IndexState::Indexed { octree, attributes, grid: GRID, was_built: false, has_surfels: true, entry };
            Event::Pages { cloud: 0, pages }
        };
        let (first, all) = (tiles(0..1), tiles(0..2));
        let put = |session: &mut Session, tile: u32, places: &[f32]| {
            let (part, chunk) = (Part::Tile(tile, NodeId(0)), chunk(u64::from(tile) * 8, places));
            session.with_loaded(|loaded, beside| {
                loaded.on_loading(0, Event::Chunk { cloud: 0, part, chunk }, beside);
                loaded.look_around(beside);
            });
        };
        let found = |session: &mut Session| {
            session.with_loaded(Loaded::renew_figures);
            for effect in std::mem::take(&mut session.outside.effects) {
                if let Effect::Work(Work::FindFigures { key, cloud, basis, up, kept }) = effect {
                    let new = Figures::of(&cloud, &basis.color, &basis.test, up);
                    let figures = kept.map_or(new, |kept| kept.recounted(&cloud, &basis.test, up));
                    session.on_found(Found::Figures { key, basis, figures: Box::new(figures) });
                }
            }
            let figures = session.loaded.clouds[0].figures.as_ref().unwrap();
            (figures.bounds.max.x, figures.plan.full_range.1)
        };
        drop_chunk(&mut session, 0);
        session.scene.settings.set_text("color.by", "height").unwrap();
        session.with_loaded(|loaded, beside| loaded.on_loading(0, first, beside));
        put(&mut session, 0, &[1.0, 2.0]);
        assert_eq!(found(&mut session), (2.0, 2.0));
        session.with_loaded(|loaded, beside| loaded.on_loading(0, all, beside));
        put(&mut session, 1, &[6.0, 7.0]);
        assert_eq!(session.loaded.jobs[0].look, 0, "no view is asked for before the first look is whole");
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, Event::Read { cloud: 0, summary: codec::Summary::default() }, beside);
            loaded.look_around(beside);
        });
        assert!(session.loaded.jobs[0].look > 0);
        assert_eq!(found(&mut session), (7.0, 7.0));
        // What a view shows changes them no more.
        put(&mut session, 0, &[1.0, 2.0, 8.0]);
        settle(&mut session);
        assert_eq!(found(&mut session), (7.0, 7.0));
    }

    #[test]
    fn a_streamed_point_is_picked_with_all_that_its_page_holds_and_no_record_is_looked_up() {
        let mut session = streamed();
        put(&mut session, 3, &[2.0, 3.251, 4.0]);
        commands(&mut session);
        let point = Some(PickedPoint { chunk: session.loaded.clouds[0].key.chunk(Part::Node(NodeId(3))), index: 1 });
        session.on_report(Report::Picked { pixel: [0, 0], purpose: PickPurpose::Select, point });
        let pick = session.tools.pick.as_ref().unwrap();
        assert_eq!((pick.world, pick.is_streamed), (DVec3::splat(3.25), true));
        assert_eq!(pick.record, Some(Ok(vec![("intensity".to_string(), "3".to_string())])));
        assert!(!session.outside.effects.iter().any(|effect| matches!(effect, Effect::Work(Work::ReadRecord { .. }))));
    }

    #[test]
    fn a_ramp_stays_while_chunks_come_and_go_and_the_histogram_counts_what_is_there() {
        let mut session = streamed();
        session.scene.settings.color.by = scene::ColorBy::Height;
        let found = |session: &mut Session| {
            session.with_loaded(Loaded::renew_figures);
            let effects = std::mem::take(&mut session.outside.effects);
            let asked = effects.into_iter().find_map(|effect| match effect {
                Effect::Work(Work::FindFigures { key, cloud, basis, up, kept, .. }) => {
                    Some((key, cloud, basis, up, kept))
                }
                _ => None,
            });
            let Some((key, cloud, basis, up, kept)) = asked else { return false };
            let figures = match kept {
                Some(kept) => kept.recounted(&cloud, &basis.test, up),
                None => crate::viewer::objects::figures::Figures::of(&cloud, &basis.color, &basis.test, up),
            };
            session.on_found(Found::Figures { key, basis, figures: Box::new(figures) });
            true
        };
        assert!(found(&mut session));
        let counted =
            |session: &Session| session.loaded.clouds[0].figures.as_ref().unwrap().histogram.iter().sum::<u32>();
        let plan = session.loaded.clouds[0].figures.as_ref().unwrap().plan.clone();
        assert_eq!(counted(&session), 2);
        put(&mut session, 3, &[2.0, 3.0, 4.0]);
        drop_chunk(&mut session, 0);
        put(&mut session, 2, &[6.0]);
        settle(&mut session);
        commands(&mut session);
        assert!(found(&mut session), "what is there is counted when it is complete");
        assert_eq!(session.loaded.clouds[0].figures.as_ref().unwrap().plan, plan);
        assert_eq!(counted(&session), 4);
        assert!(!commands(&mut session).iter().any(|command| matches!(command, Change::Color { .. })));
        session.scene.settings.color.high = 0.5;
        assert!(found(&mut session) && session.loaded.clouds[0].figures.as_ref().unwrap().plan != plan);
    }

    #[test]
    fn levels_are_shown_of_what_is_there_and_of_what_comes_and_end() {
        let mut session = streamed();
        session.scene.settings.stream.overlay = true;
        commands(&mut session);
        session.with_loaded(Loaded::sync_levels);
        put(&mut session, 2, &[6.0, 6.5, 7.0]);
        let tints: Vec<_> = commands(&mut session)
            .into_iter()
            .filter_map(|command| if let Change::Tint { tints } = command { Some(tints) } else { None })
            .flatten()
            .collect();
        assert_eq!(
            tints.iter().map(|(key, _)| key.part).collect::<Vec<_>>(),
            [0, 2].map(|node| Part::Node(NodeId(node)))
        );
        assert!(tints[0].1.is_some() && tints[1].1.is_some() && tints[0].1 != tints[1].1, "{tints:?}");
        let boxes = session.loaded.clouds[0].shown_boxes();
        assert_eq!(boxes.len(), 2, "the node between them is not there, so the root is the last above");
        session.scene.settings.stream.overlay = false;
        session.with_loaded(Loaded::sync_levels);
        let ends = |command: &Change| matches!(command, Change::Tint { tints } if tints.len() == 2 && tints.iter().all(|(_, tint)| tint.is_none()));
        assert!(commands(&mut session).iter().any(ends));
    }

    #[test]
    fn points_of_a_streamed_cloud_are_no_mirror_and_that_is_said() {
        let mut session = streamed();
        settle(&mut session);
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, Event::Read { cloud: 0, summary: codec::Summary::default() }, beside)
        });
        let key = session.loaded.clouds[0].key;
        session.scene.edit_objects(session.outside.now, |objects| {
            objects.markings.push(Marking { key, points: MirrorPoints::whole("survey".into()) })
        });
        session.with_loaded(Loaded::sync_objects);
        assert!(session.scene.objects.markings.is_empty());
        assert!(!session.outside.effects.iter().any(|effect| matches!(effect, Effect::Work(Work::MarkPoints { .. }))));
        assert!(session.outside.messages.all.last().is_some_and(|message| message.text.contains("stream.pages")));
    }

    #[test]
    fn an_attribute_of_the_file_is_asked_for_when_colours_or_filters_need_it() {
        let mut session = Session::new(Preferences::default());
        session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
        let time = Attribute { name: "gps_time".into(), column_type: ColumnType::U8 };
        let Event::Opened { cloud, mut opened } = opened(Vec::new()) else { panic!("it is opened") };
        opened.offered = vec![time.clone()];
        session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Opened { cloud, opened }, beside));
        let page = |session: &mut Session, attributes: Vec<Attribute>| {
            let entry = Some(world::IndexEntry { folder: "/cache/0123".into(), bytes: 1 });
            let (octree, grid) = (Arc::new(octree()), GRID);
            let pages = IndexState::Indexed { octree, attributes, grid, was_built: false, has_surfels: true, entry };
            session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Pages { cloud: 0, pages }, beside));
        };
        page(&mut session, Vec::new());
        settle(&mut session);
        let said = |session: &Session| {
            let texts = session.outside.messages.all.iter().map(|message| message.text.as_str());
            texts.filter(|text| text.contains("made again, with gps_time")).count()
        };
        let look = session.loaded.jobs[0].look;
        assert_eq!((said(&session), session.loaded.clouds[0].awaited.len()), (0, 0));
        session.scene.settings.color.by = scene::ColorBy::GpsTime;
        settle(&mut session);
        session.scene.settings.color.low = 0.1;
        settle(&mut session);
        assert!(session.loaded.jobs[0].look > look, "a view that asks for more is another one");
        assert_eq!((said(&session), session.loaded.clouds[0].awaited.as_slice()), (1, &["gps_time".to_owned()][..]));
        let before = session.loaded.clouds[0].paged_columns();
        page(&mut session, vec![time]);
        put(&mut session, 0, &[1.0, 7.0]);
        settle(&mut session);
        assert!(session.loaded.clouds[0].awaited.is_empty());
        assert_eq!((before, session.loaded.clouds[0].paged_columns()), (0, 1), "then its colours are found");
    }

    #[test]
    fn what_is_opened_later_gets_half_until_it_tells_what_it_needs() {
        let mut session = streamed();
        session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
        session.loaded.jobs[1].has_streamed = true;
        settle(&mut session);
        assert_eq!([session.loaded.jobs[0].share, session.loaded.jobs[1].share], [0.5, 0.5]);
        for (job, demand) in [(0, 0.01), (1, 1.0)] {
            session.with_loaded(|loaded, beside| {
                loaded.on_loading(job, Event::Stream(StreamStats { demand, ..StreamStats::default() }), beside)
            });
        }
        session.with_loaded(Loaded::look_around);
        assert!(session.loaded.jobs[0].share < 0.1 && session.loaded.jobs[1].share > 0.9);
    }

    #[test]
    fn a_hidden_cloud_is_not_looked_at() {
        let mut session = streamed();
        settle(&mut session);
        let (key, look) = (session.loaded.clouds[0].key, session.loaded.jobs[0].look);
        session.with_loaded(|loaded, beside| loaded.set_visible(key, false, beside));
        session.with_loaded(Loaded::look_around);
        assert!(session.loaded.jobs[0].look > look, "that is another look");
        assert_eq!(session.loaded.hidden(&session.loaded.jobs[0]), BTreeSet::from([0]));
        session.with_loaded(|loaded, beside| loaded.set_visible(key, true, beside));
        session.with_loaded(Loaded::look_around);
        assert!(session.loaded.hidden(&session.loaded.jobs[0]).is_empty());
    }
}
