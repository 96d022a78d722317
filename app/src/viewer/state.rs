//! What the viewer knows: clouds, jobs, parameters, camera, picks. Plain data that panels edit and tests build without a
//! window. What has to happen outside (drawing, reading, the clipboard) is left in `effects` for the window to do.

use std::ffi::OsStr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use cloud::Progress;
use glam::DVec3;
use scene::{Camera, CameraPath, Lighting, Mirror, MirrorPoints, Settings, Visibility};
use serde_json::json;
use world::{Change, CloudKey, Input, Mailbox};

use super::action::{Handles, Mode};
use super::clouds::{CloudEntry, JobEntry, Samples, short_name};
use super::draft::Draft;
use super::frames::{Frames, Next};
use super::history::History;
use super::inspection::Inspection;
use super::light_search::LightSearch;
use super::messages::{Level, Messages};
use super::navigation::Navigation;
use super::objects::{ObjectId, Objects, Origin, Placed};
use super::pace::Pace;
use super::path_prompt::PathPrompt;
use super::pick::Pick;
use super::preferences::Preferences;
use super::reflection_figures::FigureHistory;
use super::render_thread::{self, Command, FrameRequest, Report};
use super::sweep::Sweep;
use super::sweep_range::SweepRange;
use super::theme::grouped;
use super::truth_view::TruthView;
use super::tuning::Tuning;
use super::work::{Found, Work};

/// What is to be done outside the state.
pub enum Effect {
    Render(Command),
    Load {
        inputs: Vec<Input>,
    },
    Work(Work),
    OpenDialog,
    Copy(String),
    SetFullScreen(bool),
    /// A line of the event log.
    Log(serde_json::Value),
}

pub struct State {
    pub clouds: Vec<CloudEntry>,
    pub jobs: Vec<JobEntry>,
    pub settings: Settings,
    pub objects: Objects,
    /// A mirror or a light.
    pub selected: Option<ObjectId>,
    /// What is around the points, once they are all there.
    pub(super) light_search: LightSearch,
    /// The lights are being looked after: they are shown in the picture.
    pub light_panel_is_open: bool,
    /// What lit the points before the data's own colours were asked for.
    pub lit_by: Lighting,
    /// Which handles the gizmo shows, and whether one of them is grabbed.
    pub handles: Handles,
    pub handle_is_grabbed: bool,
    pub inspection: Option<Inspection>,
    pub samples: Samples,
    /// Points that may be turned into a mirror.
    pub draft: Draft,
    /// Of scene files whose clouds are still to come.
    pub(super) awaited_markings: Vec<MirrorPoints>,
    pub figure_history: FigureHistory,
    pub camera: Camera,
    /// Someone chose the camera: loading no longer moves it.
    pub camera_is_placed: bool,
    pub mode: Mode,
    pub navigation: Navigation,
    pub picks: Vec<Pick>,
    pub pick_tool: bool,
    pub raw_colors: bool,
    pub truth: TruthView,
    pub tuning: Tuning,
    /// A sweep that is being set up, and one that is under way.
    pub sweep_asked: Option<SweepRange>,
    pub sweep: Option<Sweep>,
    pub history: History,
    pub messages: Messages,
    pub preferences: Preferences,
    pub path_prompt: Option<PathPrompt>,
    pub shortcuts_are_open: bool,
    pub interface_is_hidden: bool,
    pub is_full_screen: bool,
    /// Adapter that draws; `None` until its shaders are compiled.
    pub adapter: Option<String>,
    pub frames: Frames,
    /// Pixels of the picture.
    pub view_size: [u32; 2],
    pub effects: Vec<Effect>,
    /// The time, by the clock of whoever drives the state; set at every step and input.
    pub now: Instant,
    next_cloud: u32,
    next_job: u32,
    next_object: u32,
    /// Why nothing can be drawn any more.
    pub fatal: Option<String>,
    pub wants_to_quit: bool,
    /// Warnings that were given: not twice, though figures are renewed.
    pub(super) warned: Vec<String>,
    pub pace: Pace,
    /// Bytes of all indexes, once they are counted.
    pub cache_size: Option<u64>,
    /// Streamed points are coloured by level.
    pub(super) levels_are_shown: bool,
    /// As the render thread was told.
    pub(super) expected_points: u64,
    pub(super) drawn_visibility: Visibility,
    /// Ways of the camera that scene files bring.
    pub paths: Vec<CameraPath>,
    /// Pictures are recorded: only final ones are drawn, and none depends on those before it.
    pub is_recorded: bool,
}

impl State {
    pub fn new(preferences: Preferences) -> Self {
        let (settings, warnings) = preferences.settings();
        let mut messages = Messages::default();
        warnings.into_iter().for_each(|warning| messages.warning(format!("kept parameters: {warning}")));
        Self {
            clouds: Vec::new(),
            jobs: Vec::new(),
            settings,
            objects: Objects::default(),
            selected: None,
            light_search: LightSearch::default(),
            light_panel_is_open: false,
            lit_by: Lighting::Auto,
            handles: Handles::All,
            handle_is_grabbed: false,
            inspection: None,
            samples: Samples::default(),
            draft: Draft::default(),
            awaited_markings: Vec::new(),
            figure_history: FigureHistory::default(),
            camera: Camera::looking(DVec3::ZERO, DVec3::ONE, 5.0, DVec3::Z),
            camera_is_placed: false,
            mode: Mode::Orbit,
            navigation: Navigation::default(),
            picks: Vec::new(),
            pick_tool: false,
            raw_colors: false,
            truth: TruthView::new(),
            tuning: Tuning::default(),
            sweep_asked: None,
            sweep: None,
            history: History::default(),
            messages,
            preferences,
            path_prompt: None,
            shortcuts_are_open: false,
            interface_is_hidden: false,
            is_full_screen: false,
            adapter: None,
            frames: Frames::default(),
            view_size: [1, 1],
            effects: Vec::new(),
            now: Instant::now(),
            next_cloud: 0,
            next_job: 0,
            next_object: 0,
            fatal: None,
            wants_to_quit: false,
            warned: Vec::new(),
            pace: Pace::default(),
            cache_size: None,
            levels_are_shown: false,
            expected_points: 0,
            drawn_visibility: Visibility::default(),
            paths: Vec::new(),
            is_recorded: false,
        }
    }

    pub fn cloud(&self, key: CloudKey) -> Option<&CloudEntry> {
        self.clouds.iter().find(|entry| entry.key == key)
    }

    pub(super) fn cloud_mut(&mut self, key: CloudKey) -> Option<&mut CloudEntry> {
        self.clouds.iter_mut().find(|entry| entry.key == key)
    }

    pub fn render(&mut self, command: Command) {
        self.effects.push(Effect::Render(command));
    }

    pub(super) fn change(&mut self, change: Change) {
        self.render(Command::Change(change));
    }

    pub(super) fn next_cloud_key(&mut self) -> CloudKey {
        self.next_cloud += 1;
        CloudKey(self.next_cloud - 1)
    }

    pub fn log(&mut self, event: serde_json::Value) {
        self.effects.push(Effect::Log(event));
    }

    pub fn say(&mut self, level: Level, text: impl Into<String>) {
        let text = text.into();
        self.log(json!({ "event": "message", "level": level.name(), "text": text }));
        self.messages.push(level, text);
    }

    // ---- opening ----

    /// Opens what the words name: files, scenes, built-in scenes. Says what is wrong if they name nothing, and returns
    /// whether they do.
    pub fn open<Word: AsRef<OsStr>>(&mut self, words: &[Word]) -> bool {
        let request = world::resolve(words);
        match request.check() {
            Ok(()) => {
                self.open_request(request);
                true
            }
            Err(error) => {
                self.say(Level::Error, error.to_string());
                false
            }
        }
    }

    pub fn open_request(&mut self, request: world::Request) {
        let built_in_light = request.built_in_light();
        for warning in request.warnings {
            self.say(Level::Warning, warning);
        }
        if let Some(view) = request.view {
            // The camera of a built-in scene comes without parameters of its own: those at hand stay.
            let settings =
                if view.settings == Settings::default() { self.settings.clone() } else { view.settings.clone() };
            match view.camera {
                Some(camera) if self.clouds.is_empty() => self.jump(settings, camera),
                _ => self.settings = settings,
            }
        }
        let built_in = built_in_light.map(|light| (light, Origin::BuiltIn));
        self.bring_lights(request.lights.into_iter().map(|light| (light, Origin::Person)).chain(built_in));
        for mirror in request.mirrors {
            self.bring_mirror(mirror, None);
        }
        self.awaited_markings.extend(request.mirror_points);
        self.rewrite_objects(|objects| objects.visibility.hide(&request.visibility));
        self.paths.retain(|known| !request.paths.iter().any(|path| path.name == known.name));
        self.paths.extend(request.paths);
        if !request.inputs.is_empty() {
            self.effects.push(Effect::Load { inputs: request.inputs });
        }
    }

    /// The job that the window started for `inputs`; returns its number.
    pub fn add_job(&mut self, inputs: &[Input], progress: Arc<Progress>, mailbox: Arc<Mailbox>) -> u32 {
        let id = self.next_job;
        self.next_job += 1;
        self.jobs.push(JobEntry::new(id, inputs, progress, mailbox, self.now));
        id
    }

    pub fn on_found(&mut self, found: Found) {
        match found {
            Found::Figures { key, basis, figures } => self.on_figures(key, basis, *figures),
            Found::Column { key, attribute, result } => self.on_column(key, attribute, result),
            Found::Record { picked, record, result } => {
                for pick in self.picks.iter_mut().filter(|pick| pick.point == picked) {
                    pick.record = Some(result.clone());
                }
                let attributes: serde_json::Map<_, _> =
                    result.unwrap_or_default().into_iter().map(|(name, value)| (name, value.into())).collect();
                self.log(json!({ "event": "record", "point": record, "attributes": attributes }));
            }
            Found::Samples { id, mirror, area_per_point, samples } => {
                self.samples.under_way = None;
                // Of a mirror that has been deleted meanwhile there is nothing to show.
                if self.all_mirrors().any(|(known, _)| known == id) {
                    self.put_samples(id, mirror, Some(area_per_point), samples);
                }
            }
            Found::Marked { key, wanted, result } => self.on_marked(key, wanted, result),
            Found::Counted { wanted, result } => self.draft.on_counted(wanted, result),
            Found::Surroundings { asked, found } => self.on_surroundings(asked, found),
            Found::Surface(surface) => self.on_surface(surface),
            Found::Truth(answer) => self.on_truth(*answer),
            Found::AddedToStudy { plan, result } => self.on_added_to_study(&plan, result),
            Found::SweepSaved { folder, result } => self.on_sweep_saved(&folder, result),
            Found::SceneSaved { path, result } => match result {
                Ok(()) => {
                    self.log(json!({ "event": "scene_saved", "path": path }));
                    self.messages.note(format!("Scene saved: {}", path.display()));
                }
                Err(error) => self.say(Level::Error, error),
            },
            Found::IndexDeleted { kept, result } => self.on_index_deleted(&kept, result),
            Found::CacheSize(bytes) => self.cache_size = Some(bytes),
        }
    }

    // ---- mirrors ----

    /// Changes the objects in one step of undo.
    pub fn edit_objects(&mut self, change: impl FnOnce(&mut Objects)) {
        self.history.settle(&self.settings, &self.objects);
        change(&mut self.objects);
        self.history.settle(&self.settings, &self.objects);
        self.navigation.camera_moved(self.now);
    }

    /// Whole clouds to be turned into mirrors when they have come.
    pub fn await_marking(&mut self, points: MirrorPoints) {
        self.awaited_markings.push(points);
    }

    pub fn next_object_id(&mut self) -> ObjectId {
        self.next_object += 1;
        ObjectId(self.next_object - 1)
    }

    /// Changes the objects in a way that is no step of undo: something came or went with a file.
    pub(super) fn rewrite_objects(&mut self, change: impl Fn(&mut Objects)) {
        self.history.settle(&self.settings, &self.objects);
        change(&mut self.objects);
        self.history.rewrite(change);
    }

    /// A mirror that a file or a built-in scene brings.
    pub(super) fn bring_mirror(&mut self, mirror: Mirror, input: Option<String>) -> ObjectId {
        let id = self.next_object_id();
        let mirror = Mirror { name: self.objects.free_name(&mirror.name, None), ..mirror };
        self.log(json!({ "event": "mirror", "name": mirror.name }));
        self.rewrite_objects(|objects| {
            objects.mirrors.push(Placed { id, mirror: mirror.clone(), input: input.clone() });
        });
        id
    }

    // ---- frames ----

    /// Goes on from what has happened since the last step: asks for the frame, the figures and the truth that are wanted now,
    /// and notes what can be undone. The window and tests take it after each paint. `now` is the time by the caller's clock;
    /// `is_held`: a mouse button is down or text is being typed. Returns after how long the next step is due, if nothing
    /// happens before.
    pub fn step(&mut self, now: Instant, is_held: bool) -> Option<Duration> {
        self.now = now;
        let zoom = self.end_zoom_wait();
        self.follow_cursor();
        let steps = self.history.steps();
        let quiet = self.history.watch(&self.settings, &self.objects, is_held, now);
        self.sync_visibility();
        let frame = self.request_frame();
        if self.history.steps() != steps {
            self.log(json!({ "event": "step" }));
        }
        self.renew_figures();
        self.look_around();
        self.sync_levels();
        self.sync_objects();
        self.sync_sweep();
        let truth = self.sync_truth();
        [quiet, zoom, frame, truth].into_iter().flatten().min()
    }

    /// Sends the frame that is wanted now, unless it is drawn or shown already. Returns when to look again.
    pub fn request_frame(&mut self) -> Option<Duration> {
        let is_first = self.frames.shown.is_none();
        let is_empty = self.clouds.is_empty() || is_first && self.points() == 0 && self.is_loading();
        if self.adapter.is_none() || self.view_size.contains(&0) || is_empty {
            return None;
        }
        if self.is_recorded && (self.points_come() || !self.light_search.is_known()) {
            return None;
        }
        let mut settings = self.settings.clone();
        if self.raw_colors {
            settings.edl.strength = 0.0;
            settings.light.by = Lighting::Colors;
        }
        let settings = settings.drawn();
        let mut wanted = FrameRequest {
            camera: self.camera,
            settings,
            mirrors: self.all_mirrors().map(|(_, mirror)| mirror.clone()).collect(),
            lights: self.lights(),
            sky_is_open: self.sky_is_open(),
            size: self.view_size,
            revision: self.frames.revision,
            hurried: false,
            light_may_lag: self.light_may_lag(),
        };
        let rest = self.navigation.time_to_rest(self.now);
        let is_mirror = self.selected.is_some_and(|id| self.objects.mirror(id).is_some());
        let is_dragged = is_mirror && self.handle_is_grabbed;
        // The first picture comes soon, and a better one after it.
        let is_hurried = !self.is_recorded && (is_first || rest.is_some() && self.frames.is_slow());
        let hurried = is_hurried.then(|| render_thread::hurried(&wanted.settings, is_dragged));
        if let Some(settings) = hurried.filter(|hurried| *hurried != wanted.settings) {
            wanted.settings = settings;
            wanted.hurried = true;
        }
        match self.frames.want(&wanted, self.points_come(), self.now) {
            Next::Draw => {}
            Next::Wait => return None,
            Next::WaitFor(time) => return Some(time),
            Next::Nothing => {
                if self.frames.comes_to_rest(!self.light_search.is_known() || self.points_come()) {
                    self.log(json!({ "event": "settled" }));
                }
                return rest;
            }
        }
        if is_first {
            self.jobs.iter().for_each(|job| job.mailbox.draw_first(true));
        }
        self.render(Command::Frame(Box::new(wanted)));
        rest
    }

    /// The frame that is wanted now, as far as it has been asked for.
    pub fn wanted_frame(&self) -> Option<&FrameRequest> {
        self.frames.requested.as_ref()
    }

    /// The frame on the screen, if it is the final one and nothing is under way that would change it.
    pub fn still_frame(&self) -> Option<&FrameRequest> {
        let is_busy = |entry: &CloudEntry| entry.marking.is_some() || entry.figures_under_way;
        let may_change = self.points_come() || self.samples.under_way.is_some() || self.inspection.is_some();
        self.frames.final_one().filter(|_| !may_change && !self.clouds.iter().any(is_busy))
    }

    /// What the render thread says, except the picture itself, which the window has taken.
    pub fn on_report(&mut self, report: Report) {
        if matches!(report, Report::Frame(_) | Report::NotDrawn(_) | Report::Lost(_)) {
            self.jobs.iter().for_each(|job| job.mailbox.draw_first(false));
        }
        match report {
            Report::Ready { adapter } => {
                self.log(json!({ "event": "ready", "adapter": adapter }));
                self.adapter = Some(adapter);
                // The window is painted before the frame is asked for.
                let has_points = self.points() > 0;
                self.jobs.iter().for_each(|job| job.mailbox.draw_first(has_points));
            }
            // Of clouds that have been removed since.
            Report::Frame(_) if self.clouds.is_empty() => self.frames.give_up(),
            Report::Frame(frame) => {
                self.keep_pace(frame.total_milliseconds);
                self.log(json!({
                    "event": "frame", "points": frame.stats.points_drawn, "ms": frame.total_milliseconds,
                }));
                if !frame.request.hurried {
                    self.figure_history.push(&frame.stats);
                }
                self.frames.show(*frame);
            }
            Report::Picked { pixel, purpose, point } => self.on_picked(pixel, purpose, point),
            Report::Saved(path) => {
                self.log(json!({ "event": "saved", "path": path }));
                self.messages.note(format!("Picture saved: {}", path.display()));
            }
            Report::Captured(captured) => self.on_captured(*captured),
            Report::Measured { request, stats } => self.on_measured(&request, &stats),
            Report::Presented { request, pass, rgba } => self.on_presented(*request, pass, rgba),
            Report::NotJudged(problem) => self.on_not_judged(&problem),
            Report::Problem(problem) => self.say(Level::Error, problem),
            Report::NotDrawn(problem) => {
                self.frames.give_up();
                self.say(Level::Error, problem);
            }
            Report::Lost(problem) => {
                self.log(json!({ "event": "lost", "text": problem }));
                self.fatal = Some(problem);
            }
        }
    }

    // ---- words for the outside ----

    pub fn title(&self) -> String {
        let points = self.all_points();
        match self.inputs().as_slice() {
            [] => "glint".into(),
            [one] => format!("{} - {} points - glint", short_name(one), grouped(points)),
            several => format!("{} clouds - {} points - glint", several.len(), grouped(points)),
        }
    }

    /// The words of the command line that give what is visible.
    pub fn inputs(&self) -> Vec<String> {
        let mut inputs: Vec<String> = Vec::new();
        for entry in self.clouds.iter().filter(|entry| entry.is_visible) {
            if !inputs.contains(&entry.input) {
                inputs.push(entry.input.clone());
            }
        }
        inputs
    }
}

#[cfg(test)]
impl State {
    /// A scene of two points that is completely read, for tests of the panels.
    pub fn with_two_points() -> Self {
        use world::{Event, Opened, Part};

        use super::preferences::Preferences;
        let mut state = Self::new(Preferences::default());
        let job = state.add_job(&[], Arc::default(), Arc::default());
        let (name, input) = ("cloud.ply".into(), "cloud.ply".into());
        let opened = Opened { name, input, expected_points: 2, up: DVec3::Z, ..Opened::default() };
        state.on_loading(job, Event::Opened { cloud: 0, opened });
        let chunk = cloud::Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [10.0, 10.0, 0.0]]);
        state.on_loading(job, Event::Chunk { cloud: 0, part: Part::Block(0), chunk });
        state.on_loading(job, Event::Finished);
        state.history.watch(&state.settings, &state.objects, false, state.now);
        state
    }

    /// Draws a panel and does what it asks for.
    pub fn show_and_act(&mut self, show: impl FnOnce(&Self, &mut Vec<super::action::Action>)) {
        let mut actions = Vec::new();
        show(self, &mut actions);
        self.act_all(actions);
    }
}

#[cfg(test)]
mod tests {
    use world::{Event, Opened, Part};

    use super::super::objects::Marking;
    use super::*;

    /// A cloud with one attribute whose header has been read, by job 0.
    fn opened() -> (State, CloudKey) {
        let mut state = State::new(Preferences::default());
        let job = state.add_job(&[], Arc::default(), Arc::default());
        let attributes = vec![cloud::Attribute { name: "intensity".into(), column_type: cloud::ColumnType::U8 }];
        let (name, input) = ("cloud.ply".into(), "cloud.ply".into());
        let opened = Opened { name, input, attributes, expected_points: 3, up: DVec3::Z, ..Opened::default() };
        state.on_loading(job, Event::Opened { cloud: 0, opened });
        let key = state.clouds[0].key;
        (state, key)
    }

    #[test]
    fn a_column_that_cannot_be_read_is_no_longer_under_way() {
        let (mut state, key) = opened();
        state.clouds[0].column_reads.insert(0, Some(Arc::default()));
        assert_eq!(state.columns_under_way().map(|(name, _)| name).collect::<Vec<_>>(), ["intensity"]);
        state.on_found(Found::Column { key, attribute: 0, result: Err("gone".into()) });
        assert_eq!(state.columns_under_way().count(), 0);
        assert!(state.messages.all.last().is_some_and(|message| message.text == "intensity: gone"));
    }

    #[test]
    fn a_cloud_that_is_opened_as_a_mirror_reflects_when_it_has_come_and_is_no_step_of_undo() {
        let (mut state, key) = opened();
        state.history.watch(&state.settings, &state.objects, false, state.now);
        state.await_marking(MirrorPoints::whole("cloud.ply".into()));
        state.await_marking(MirrorPoints::whole("gone.ply".into()));
        let chunk = cloud::Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0; 3]]);
        state.on_loading(0, Event::Chunk { cloud: 0, part: Part::Block(0), chunk });
        state.sync_objects();
        assert!(state.objects.markings.is_empty(), "its points are still to come");
        state.on_loading(0, Event::Finished);
        assert_eq!(state.objects.markings, [Marking { key, points: MirrorPoints::whole("cloud.ply".into()) }]);
        assert!(state.messages.all.last().is_some_and(|message| message.text.contains("gone.ply")));
        assert!(!state.history.undo(&mut state.settings, &mut state.objects, &mut state.camera));
        state.sync_objects();
        assert!(state.effects.iter().any(|effect| matches!(effect, Effect::Work(Work::MarkPoints { .. }))));
        state.remove_cloud(key);
        assert!(state.objects.markings.is_empty());
    }

    #[test]
    fn a_cloud_without_points_leaves_the_renderer_too() {
        let (mut state, removed) = opened();
        state.on_loading(0, Event::Finished);
        assert!(state.clouds.is_empty());
        let is_removal = |effect: &Effect| matches!(effect, Effect::Render(Command::Change(Change::Close { cloud })) if *cloud == removed);
        assert!(state.effects.iter().any(is_removal));
    }

    #[test]
    fn a_frame_that_cannot_be_drawn_ends_neither_the_window_nor_later_frames() {
        let (mut state, _) = opened();
        state.on_report(Report::Ready { adapter: "any".into() });
        state.request_frame();
        assert_eq!(state.frames.under_way, 0, "there is nothing to show yet");
        let chunk = cloud::Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0; 3]]);
        state.on_loading(0, Event::Chunk { cloud: 0, part: Part::Block(0), chunk });
        state.request_frame();
        assert_eq!(state.frames.under_way, 1);
        assert!(state.frames.requested.as_ref().is_some_and(|request| request.hurried), "the first picture comes soon");
        state.on_report(Report::NotDrawn("too large".into()));
        assert_eq!((state.frames.under_way, state.fatal.as_deref()), (0, None));
    }
}
