//! What the viewer knows, divided into parts that make their own changes. The session passes on everything that comes
//! in: a person's actions (`actions`), results of worker threads, reports of the render thread, events of jobs, and the
//! step after each paint. Whatever has to be done outside (drawing, reading files, the clipboard) is queued in `outside`
//! for the code that drives the session. Tests drive it without a window.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cloud::Bounds;
use glam::DVec3;
use scene::Settings;
use serde_json::json;
use world::CloudKey;

use crate::shared::language::text;
use crate::viewer::filming::{Filming, Wiping};
use crate::viewer::frames::Frames;
use crate::viewer::frames::auto::Auto;
use crate::viewer::jobs::tasks::Answer;
use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::look::reflection_figures::FigureHistory;
use crate::viewer::look::theme::bytes;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Command, Frame, Report};
use crate::viewer::requests::action::{Action, Filing};
use crate::viewer::requests::autosave::Home;
use crate::viewer::requests::columns::{self, ColumnsDraft, Naming};
use crate::viewer::requests::messages::{Level, Messages};
use crate::viewer::requests::outside::{Effect, News, Outside};
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::requests::work::{Found, Work};
use crate::viewer::scene::Scene;
use crate::viewer::scene::confines::Confines;
use crate::viewer::scene::scene_parameters::SceneParameters;
use crate::viewer::session::Session;
use crate::viewer::session::document::{Document, Leaving, Next};
use crate::viewer::session::first_look::FirstLook;
use crate::viewer::session::kept::Kept;
use crate::viewer::session::wanted;
use crate::viewer::tools::Tools;
use crate::viewer::truth::sweep::Sweeps;
use crate::viewer::truth::tuning::Tuning;
use crate::viewer::truth::view::{Taken, TruthView};
use crate::viewer::truth::{Around, sweep, tuning};

impl Session {
    pub fn new(preferences: Preferences) -> Self {
        let (settings, warnings) = preferences.settings();
        let mut messages = Messages::default();
        warnings.into_iter().for_each(|warning| messages.warning(text!("kept parameters: {warning}", warning)));
        Self {
            loaded: Loaded::default(),
            scene: Scene::new(settings),
            figure_history: FigureHistory::default(),
            tools: Tools::default(),
            raw_colors: false,
            truth: TruthView::new(),
            kept: Kept::new(),
            tuning: Tuning::default(),
            sweeps: Sweeps::default(),
            outside: Outside::new(messages),
            preferences,
            path_prompt: None,
            unnamed: Vec::new(),
            palette: None,
            search: String::new(),
            shortcuts_are_open: false,
            interface_is_hidden: false,
            is_full_screen: false,
            adapter: None,
            frames: Frames::default(),
            auto: Auto::default(),
            filming: Filming::default(),
            first_look: None,
            document: Document::default(),
            is_typing: false,
            fatal: None,
            wants_to_quit: false,
            is_recorded: false,
        }
    }

    // ---- the scene file ----

    pub(super) fn file(&mut self, filing: Filing) {
        match self.document.act(filing, &self.scene, &self.loaded, &mut self.preferences, &mut self.outside) {
            Some(Next::Leave(leaving)) => self.leave(leaving),
            Some(Next::Go(leaving)) => self.go(leaving),
            None => {}
        }
    }

    /// Whether a person's work would be lost if the program ended now.
    pub fn is_unsaved(&self) -> bool {
        self.first_look.is_none() && self.document.is_unsaved(&self.scene, &self.loaded)
    }

    /// Does what would lose unsaved work, or end work that runs, or lose what was computed, or asks first.
    pub(super) fn leave(&mut self, leaving: Leaving) {
        let loses = || !self.loaded.running().is_empty() || self.loaded.unsaved_values().next().is_some();
        let ends_work = leaving == Leaving::Quit && loses();
        self.leave_or_ask(leaving, ends_work);
    }

    fn leave_or_ask(&mut self, leaving: Leaving, ends_work: bool) {
        self.scene.history.settle(&self.scene.settings, &self.scene.objects);
        if (ends_work || self.is_unsaved()) && self.fatal.is_none() {
            self.outside.log(json!({ "event": "asked" }));
            self.document.asked = Some(leaving);
        } else {
            self.go(leaving);
        }
    }

    fn go(&mut self, leaving: Leaving) {
        match leaving {
            Leaving::Quit => self.wants_to_quit = true,
            Leaving::Close(key) => self.remove_cloud(key),
            Leaving::Open(path) => self.open_instead(&path, None),
            Leaving::Restore => {
                if let Some((path, home)) = self.document.restore() {
                    self.open_instead(&path, Some(home));
                }
            }
        }
    }

    /// Closes everything and opens a scene, or the work that was kept of the file `restored`.
    fn open_instead(&mut self, path: &Path, restored: Option<Option<Home>>) {
        let mut request = world::resolve(&[path]);
        if let Err(error) = request.check() {
            return self.outside.say(Level::Error, error.to_string());
        }
        self.leave_first_look();
        self.with_loaded(Loaded::close_all);
        self.preferences.remember_settings(&self.scene.own_settings());
        self.scene.clear(self.preferences.settings().0);
        let Tools { light_panel_is_open, clicked, .. } = std::mem::take(&mut self.tools);
        self.tools = Tools { light_panel_is_open, clicked, ..Tools::default() };
        self.tools.clicked.drop_waiting();
        self.document.forget();
        let is_file = restored.is_some() || !request.scene_files.is_empty();
        if restored.is_some() {
            request.scene_files.clear();
        }
        self.open_scene(request, is_file);
        // What a person has chosen does not make room for the next file.
        self.first_look = None;
        restored.into_iter().for_each(|home| self.document.on_restored(home));
    }

    pub(super) fn remove_cloud(&mut self, key: CloudKey) {
        let input = self.loaded.cloud(key).map(|entry| entry.input.clone()).unwrap_or_default();
        let tracks = self.scene.objects.track_count();
        self.with_loaded(|loaded, beside| loaded.remove_cloud(key, beside));
        if !self.loaded.clouds.is_empty() {
            self.scene.tell_lost_tracks(tracks, &mut self.outside);
        }
        self.document.closed(&input, &self.loaded);
        if self.loaded.clouds.is_empty() {
            self.leave_first_look();
            self.tools.clicked.drop_waiting();
        }
        if self.loaded.is_empty() {
            self.scene.take_own_settings();
        }
    }

    // ---- opening ----

    /// Opens the files, scene files or built-in scenes that words name. Returns whether there are any, or says why not.
    pub fn open<Word: AsRef<OsStr>>(&mut self, words: &[Word]) -> bool {
        let request = world::resolve(words);
        if let Err(error) = request.check() {
            self.outside.say(Level::Error, error.to_string());
            return false;
        }
        self.open_request(request);
        true
    }

    /// Opens files that a person has chosen by hand. Tables are opened when their columns are known. Returns false if nothing
    /// has a name among them.
    pub fn open_by_hand(&mut self, paths: Vec<PathBuf>) -> bool {
        let (tables, others): (Vec<PathBuf>, Vec<PathBuf>) =
            paths.into_iter().partition(|path| columns::is_of_table(path) && path.is_file());
        let is_open = others.is_empty() || self.open(&others);
        tables.into_iter().for_each(|path| self.outside.work(Work::LookAtTable(path)));
        is_open
    }

    /// Opens what the program was started with, but asks about the columns of tables that nothing names. Scene files have
    /// more to say of their clouds than columns, so theirs are opened as they are.
    pub fn open_at_start(&mut self, mut request: world::Request) {
        let mut unnamed = Vec::new();
        let is_alone = request.scene_files.is_empty();
        request.inputs.retain(|input| {
            let world::Input::File(path) = input else { return true };
            let table = (is_alone && columns::is_of_table(path)).then(|| codec::unnamed_table(path)).flatten();
            let draft = table.and_then(|table| ColumnsDraft::asking(path, table));
            let is_known = draft.is_none();
            unnamed.extend(draft);
            is_known
        });
        self.open_request(request);
        self.unnamed.append(&mut unnamed);
    }

    fn on_table(&mut self, path: PathBuf, unnamed: Option<Box<codec::UnnamedTable>>) {
        match unnamed.and_then(|table| ColumnsDraft::asking(&path, *table)) {
            Some(draft) => self.unnamed.push(draft),
            None => drop(self.open(&[path])),
        }
    }

    /// Carries out a step of naming the columns of the table that waits first.
    pub fn name_columns(&mut self, step: Naming) {
        let Some(first) = self.unnamed.first_mut() else { return };
        match step {
            Naming::Change(draft) => *first = *draft,
            // Esc may come from the window and as the key that ends tools.
            Naming::Cancel(path) => {
                self.unnamed.retain(|draft| draft.path != path);
                self.loaded.awaited_markings.retain(|points| Path::new(&points.cloud) != path);
            }
            Naming::Open => {
                let named = first.names().and_then(|_| codec::name_columns_of(&first.path, &first.entered()));
                match named {
                    Ok(()) => {
                        let draft = self.unnamed.remove(0);
                        self.loaded.await_columns(&draft);
                        self.open(&[draft.path]);
                    }
                    Err(problem) => self.outside.say(Level::Error, problem),
                }
            }
        }
    }

    pub fn open_request(&mut self, request: world::Request) {
        let is_scene_file = !request.scene_files.is_empty();
        self.open_scene(request, is_scene_file);
    }

    fn open_scene(&mut self, mut request: world::Request, is_scene_file: bool) {
        if self.first_look.is_none() {
            request.warn_of_open(&self.loaded.clouds.iter().map(|entry| entry.input.as_str()).collect());
        }
        if !request.inputs.is_empty() {
            self.leave_first_look();
            self.document.add_inputs(request.inputs.iter().map(world::Input::name));
            self.scene.confines = Confines { ground: request.ground(), walls: request.walls(), interior: None };
            let is_alone = self.loaded.clouds.is_empty() && !self.loaded.is_loading() && !self.is_recorded;
            let may_be_first = is_alone && !is_scene_file;
            self.first_look = may_be_first.then(|| FirstLook::of(&mut request, &self.scene.own_settings())).flatten();
            self.scene.opening = self.first_look.as_ref().map(|first| first.camera);
        }
        for warning in std::mem::take(&mut request.warnings) {
            self.outside.say(Level::Warning, warning);
        }
        let mut brought = None;
        if let Some(view) = &mut request.view {
            // A built-in scene may bring a camera without parameters of its own: the current ones stay.
            view.settings = if is_scene_file || view.settings != Settings::default() {
                brought.insert(SceneParameters::new(view, self.scene.own_settings())).given().clone()
            } else {
                self.scene.settings.clone()
            };
        }
        self.loaded.await_settings(&mut request);
        self.scene.furnish(&mut request, self.loaded.clouds.is_empty(), &mut self.outside);
        if brought.is_some() {
            self.scene.brought = brought;
        }
        if self.loaded.is_empty() {
            self.scene.history.settle(&self.scene.settings, &self.scene.objects);
            self.document.opened(&request.scene_files, &self.scene, &mut self.preferences);
        }
        if !request.inputs.is_empty() {
            self.outside.push(Effect::Load { inputs: request.inputs });
        }
    }

    fn leave_first_look(&mut self) {
        if self.first_look.take().is_some() {
            self.with_loaded(FirstLook::leave);
            self.document.forget();
        }
    }

    /// Takes in a message from another thread.
    pub fn on_news(&mut self, news: News) {
        match news {
            News::Loading(job, event, pass) => {
                self.document.on_event(&event, &self.loaded);
                self.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
                if let Some(first) = &mut self.first_look {
                    first.offer_ball(&mut self.scene);
                }
                pass.into_iter().for_each(|pass| self.outside.render(Command::Arrived(pass)));
            }
            News::Report(report) => self.on_report(report),
            News::Found(found) => self.on_found(found),
        }
    }

    pub fn on_found(&mut self, found: Found) {
        match found {
            Found::Figures { key, basis, figures } => {
                self.with_loaded(|loaded, beside| loaded.on_figures(key, basis, *figures, beside))
            }
            Found::Noise { key, noise } => self.loaded.on_noise(key, noise),
            Found::Radii { key, test, radii } => {
                self.with_loaded(|loaded, beside| loaded.on_radii(key, &test, radii, beside))
            }
            Found::Errors { key, errors } => self.with_loaded(|loaded, beside| loaded.on_errors(key, errors, beside)),
            Found::Placed { key, moved } => self.with_loaded(|loaded, beside| loaded.on_placed(key, moved, beside)),
            Found::Column { key, attribute, result } => {
                self.with_loaded(|loaded, beside| loaded.on_column(key, attribute, result, beside))
            }
            Found::PointError { picked, error } => self.tools.on_point_error(picked, error, &mut self.outside),
            Found::Record { picked, record, result } => {
                self.tools.on_record(picked, record, result, &mut self.outside);
            }
            Found::Samples { id, mirror, area_per_point, result } => {
                self.with_loaded(|loaded, beside| loaded.on_samples(id, mirror, area_per_point, result, beside))
            }
            Found::Mesh(Ok(shape)) => self.act(Action::AddMirror(shape)),
            Found::Mesh(Err(error)) => self.outside.say(Level::Error, error),
            Found::Marked { key, wanted, result } => {
                self.with_loaded(|loaded, beside| loaded.on_marked(key, wanted, result, beside))
            }
            Found::Counted { wanted, result } => self.tools.draft.on_counted(wanted, result),
            Found::Surroundings { asked, found } => {
                self.with_loaded(|loaded, beside| loaded.on_surroundings(asked, found, beside))
            }
            Found::Surface(surface) => self.tools.on_surface(surface, &mut self.scene, &self.loaded, &mut self.outside),
            Found::Measured { id, measurement, figures } => {
                self.tools.measurements.on_measured(id, measurement, figures, &self.scene, &mut self.outside)
            }
            Found::Profile(found) => self.tools.profiles.on_found(found, &mut self.outside),
            Found::Truth(answer) => self.on_truth(*answer),
            Found::AddedToStudy { plan, result } => tuning::on_added_to_study(&plan, result, &mut self.outside),
            Found::SweepSaved { folder, result } => sweep::on_saved(&folder, result, &mut self.outside),
            Found::SceneSaved { path, result } => {
                let then = self.document.on_saved(&path, &result, &mut self.preferences, &mut self.outside);
                self.outside.scene_saved(&path, result.map(drop));
                // The question before has named the work that runs.
                then.into_iter().for_each(|leaving| self.leave_or_ask(leaving, false));
            }
            Found::SceneChanged { path } => self.document.on_changed(&path, &mut self.outside),
            Found::Kept(result) => self.document.on_kept(result, &mut self.outside),
            Found::Exported { path, result } => self.loaded.on_exported(&path, result, &mut self.outside),
            Found::Compared(comparison) => self.with_loaded(|loaded, beside| loaded.on_compared(*comparison, beside)),
            Found::Ghosts(outcome) => self.with_loaded(|loaded, beside| loaded.on_ghosts(outcome, beside)),
            Found::Recording(stage) => self.filming.recording.on_stage(stage, &self.outside),
            Found::Captured(captured) => self.filming.on_captured(captured, &mut self.outside),
            Found::Recorded(ended) => self.filming.recording.on_end(ended, &mut self.outside),
            Found::Table { path, unnamed } => self.on_table(path, unnamed),
            Found::IndexDeleted { kept, result } => self.outside.index_deleted(&bytes(kept.bytes), result),
            Found::CacheSize(bytes) => self.loaded.cache_size = Some(bytes),
        }
    }

    // ---- frames ----

    /// Changes what is loaded, together with the parts that depend on it.
    pub fn with_loaded<R>(&mut self, act: impl FnOnce(&mut Loaded, &mut Beside<'_>) -> R) -> R {
        let mut beside = Beside {
            scene: &mut self.scene,
            frames: &mut self.frames,
            preferences: &mut self.preferences,
            inspection: self.tools.inspection.as_ref(),
            handle_is_grabbed: self.tools.handle_is_grabbed,
            is_recorded: self.is_recorded,
            outside: &mut self.outside,
        };
        let result = act(&mut self.loaded, &mut beside);
        self.tools.follow_pick(&self.scene, &self.loaded, &mut self.outside);
        result
    }

    /// Whether the picture shows the data's own colours.
    pub fn is_unlit(&self) -> bool {
        self.raw_colors || self.scene.is_unlit(&self.loaded.clouds)
    }

    /// The bounds of the visible points, without stray points.
    pub fn bounds(&self) -> Bounds {
        self.scene.bounds(&self.loaded.clouds)
    }

    pub fn up(&self) -> DVec3 {
        self.scene.up(&self.loaded.clouds)
    }

    /// Sets the size of the picture in pixels.
    pub fn set_view_size(&mut self, size: [u32; 2]) {
        if self.scene.view_size != size {
            self.scene.view_size = size;
            let bounds = self.bounds();
            self.scene.frame_while_unplaced(bounds, &self.loaded.clouds);
        }
    }

    /// Acts on all that has happened since the last step: requests the frame, the figures and the truth that are wanted
    /// now, and notes what can be undone. It is called after each paint. `now` is the time by the caller's clock.
    /// `is_held` says that a mouse button is down. Returns when the next step is due at the latest.
    pub fn step(&mut self, now: Instant, is_held: bool) -> Option<Duration> {
        self.outside.now = now;
        let zoom = self.scene.end_zoom_wait(self.outside.now);
        self.tools.follow_cursor(&mut self.scene, &self.loaded, &mut self.outside);
        self.scene.navigation.hold(is_held, now);
        let steps = self.scene.history.steps();
        let still = self.still_frame().filter(|_| !self.is_recorded).cloned();
        let film = self.filming.step(&mut self.scene, still.as_ref(), &mut self.outside);
        let quiet = self.scene.watch(is_held || self.is_typing, now);
        let view = self.scene.past_views.watch(self.scene.camera, self.scene.camera_is_placed, is_held, now);
        self.with_loaded(Loaded::sync_visibility);
        let frame = self.request_frame();
        if self.scene.history.steps() != steps {
            self.outside.log(json!({ "event": "step" }));
        }
        self.tools.sync_measurements(&self.scene, &self.loaded, &mut self.outside);
        self.with_loaded(Loaded::renew_figures);
        self.with_loaded(Loaded::look_around);
        self.with_loaded(Loaded::sync_levels);
        self.with_loaded(Loaded::sync_objects);
        self.with_loaded(Loaded::tell_darkness);
        self.with_loaded(Loaded::sync_ghosts);
        let still = self.still_frame().cloned();
        self.kept.sync(still.as_ref(), &self.loaded, &mut self.outside);
        let truth = self.sync_truth();
        let kept = self.document.sync(self.is_unsaved(), &self.scene, &self.loaded, &mut self.outside);
        let still = self.still_frame().and(self.frames.shown.as_ref()).filter(|_| !self.is_recorded);
        let still = still.map(|shown| shown.stats.frame_milliseconds);
        let auto = self.auto.sync(self.picture(), still, &mut self.outside);
        // Once the panel says it, only the next picture changes that.
        let late = self.frames.time_to_late(now).filter(|left| !left.is_zero());
        [quiet, view, kept, zoom, frame, truth, late, auto, film].into_iter().flatten().min()
    }

    /// Requests the frame that is wanted now, unless it is drawn or shown. Returns the time after which to call again.
    pub fn request_frame(&mut self) -> Option<Duration> {
        let is_first = self.frames.shown.is_none();
        let is_empty =
            self.loaded.clouds.is_empty() || is_first && self.loaded.points() == 0 && self.loaded.is_loading();
        if self.scene.view_size.contains(&0) || is_empty {
            return None;
        }
        let situation = wanted::situation(&self.scene, &self.loaded, &self.tools, self.outside.now, self.is_recorded);
        let under_way = self.frames.under_way;
        self.frames.note_coloring(self.loaded.colors_come(&self.scene), self.outside.now);
        let again = self.frames.request(self.auto.applied(self.picture()), &situation, &mut self.outside);
        if is_first && self.adapter.is_some() && self.frames.under_way > under_way {
            self.loaded.jobs.iter().for_each(|job| job.mailbox.draw_first(true));
        }
        again
    }

    /// The request for the current view in full quality.
    pub fn picture(&self) -> FrameRequest {
        wanted::picture(&self.scene, &self.loaded, &self.tools, self.frames.revision, self.raw_colors)
    }

    /// The frame on the screen, if it is final and no work is under way that would change it.
    pub fn still_frame(&self) -> Option<&FrameRequest> {
        let may_change =
            self.loaded.points_come() || self.loaded.samples.under_way.is_some() || self.tools.inspection.is_some();
        self.frames.final_one().filter(|_| !may_change && !self.loaded.clouds.iter().any(CloudEntry::is_busy))
    }

    /// Handles a report of the render thread. The window has already taken the picture itself.
    pub fn on_report(&mut self, report: Report) {
        if matches!(report, Report::Frame(_) | Report::NotDrawn(_) | Report::Lost(_)) {
            self.loaded.jobs.iter().for_each(|job| job.mailbox.draw_first(false));
        }
        let Some(report) = self.filming.timeline.wiping.take(report, &mut self.outside) else { return };
        match report {
            Report::Ready { adapter } => {
                self.outside.log(json!({ "event": "ready", "adapter": adapter }));
                self.auto.ready(&adapter, &mut self.outside);
                self.adapter = Some(adapter);
                // The window is painted before it requests the next frame.
                let is_first = self.loaded.points() > 0 && self.frames.shown.is_none();
                self.loaded.jobs.iter().for_each(|job| job.mailbox.draw_first(is_first));
            }
            // The frame shows clouds that have been removed since.
            Report::Frame(_) if self.loaded.clouds.is_empty() => self.frames.give_up(),
            Report::Frame(frame) => {
                if !frame.request.hurried && frame.request.is_whole(&frame.stats) {
                    self.figure_history.push(&frame.stats);
                    self.auto.learn(&frame.request, &frame.stats);
                }
                let Frame { request, stats, is_blank, total_milliseconds, .. } = *frame;
                self.scene.navigation.on_picture(request.spared.is_some());
                self.frames.show(request, stats, total_milliseconds, f64::from(self.scene.settings.view.frame_ms));
                self.frames.is_blank = is_blank;
            }
            Report::Picked { pixel, purpose, point } => {
                self.tools.on_picked(pixel, purpose, point, &mut self.scene, &self.loaded, &mut self.outside);
                self.carry_out_due();
            }
            Report::Saved(path) => self.outside.saved(&path),
            Report::Read(picture) => {
                if let Some(picture) = self.filming.on_picture(*picture) {
                    self.kept.on_read(picture.rgba, &mut self.outside);
                }
            }
            Report::Captured(captured) => {
                if let Some(captured) = self.sweeps.on_images(*captured, &self.truth, &mut self.outside) {
                    self.truth.on_captured(captured, self.frames.revision);
                }
            }
            Report::Chosen { request, choice, model } => {
                self.auto.on_chosen(*request, *choice, *model, &mut self.outside)
            }
            Report::Measured { request, stats } if self.sweeps.on_frame(&request, &stats) => {}
            Report::Measured { request, stats } => self.tuning.on_measured(&request, &stats),
            Report::Presented { request, pass, rgba } => {
                self.truth.on_presented(*request, pass, rgba, self.frames.revision, &mut self.outside);
            }
            Report::NotJudged(problem) => self.on_not_judged(&problem),
            Report::Estimated { request, answer } => self.truth.live.on_answer(*request, answer, &mut self.outside),
            Report::Problem(problem) => {
                self.kept.on_problem();
                self.outside.say(Level::Error, problem);
            }
            Report::NotDrawn(problem) => {
                self.frames.give_up();
                self.outside.say(Level::Error, problem);
            }
            Report::Lost(problem) => {
                self.outside.log(json!({ "event": "lost", "text": problem }));
                self.fatal = Some(problem);
                self.tools.clicked.give_up();
            }
        }
    }

    /// Calls `act` with what the truth and a sweep read from the session, and with the parts that they change.
    fn with_truth<R>(
        &mut self,
        act: impl FnOnce(&Around<'_>, &mut TruthView, &mut Tuning, &mut Sweeps, &mut Wiping, &mut Outside) -> R,
    ) -> R {
        let around = Around {
            still: self.still_frame().cloned(),
            clouds: &self.loaded.clouds,
            samples: &self.loaded.samples,
            settings: &self.scene.settings,
            test: self.scene.objects.test(),
            frames: &self.frames,
            raw_colors: self.raw_colors,
            is_taken: self.sweeps.under_way.is_some() || self.filming.timeline.wiping.is_tracing(),
        };
        let wiping = &mut self.filming.timeline.wiping;
        act(&around, &mut self.truth, &mut self.tuning, &mut self.sweeps, wiping, &mut self.outside)
    }

    /// Advances the sweep and the truth by one step. Returns the time after which to call again.
    pub fn sync_truth(&mut self) -> Option<Duration> {
        self.with_truth(|around, truth, _, sweeps, _, outside| sweeps.sync(around, truth, outside));
        // A sweep draws other frames.
        let still = self.still_frame().filter(|_| self.sweeps.under_way.is_none()).cloned();
        let estimate = self.truth.live.sync(still.as_ref(), &mut self.outside);
        self.with_truth(|around, truth, _, _, wiping, outside| wiping.sync(around, truth, outside));
        let truth = self.with_truth(|around, truth, tuning, _, _, outside| truth.sync(around, tuning, outside));
        estimate.into_iter().chain(truth).min()
    }

    pub fn start_sweep(&mut self, key: &str, values: Vec<String>, places: &[PathBuf]) {
        self.with_truth(|around, _, _, sweeps, _, outside| sweeps.start(key, values, places, around, outside));
    }

    /// Stops all work for the truth, the chart and a sweep.
    pub fn stop_truth(&mut self) {
        self.truth.stop();
        self.tuning.is_open = false;
        self.sweeps.stop(&mut self.outside);
    }

    /// Handles a truth that cannot be computed: nothing more is requested, or the current value of a sweep has failed.
    fn on_not_judged(&mut self, problem: &str) {
        self.truth.on_not_judged();
        self.tuning.forget_measuring();
        if !self.sweeps.on_failed(problem, &mut self.outside) {
            self.stop_truth();
            self.outside.say(Level::Error, text!("The truth cannot be shown: {problem}", problem));
        }
    }

    pub fn on_truth(&mut self, answer: Answer) {
        let Some(answer) = self.filming.timeline.wiping.take_answer(answer, &mut self.outside) else { return };
        match self.truth.on_answer(answer, self.frames.revision) {
            Taken::Nothing => {}
            Taken::Log(event) => self.outside.log(event),
            Taken::Swept(swept) => self.sweeps.on_judged(swept, &mut self.tuning),
            Taken::Failed(problem) => self.on_not_judged(&problem),
        }
    }
}

#[cfg(test)]
#[path = "state_tests.rs"]
mod tests;
