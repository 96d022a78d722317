//! What the viewer knows, divided into parts that make their own changes. The session passes on everything that comes
//! in: a person's actions, results of worker threads, reports of the render thread, events of jobs, and the step after
//! each paint. Whatever has to be done outside (drawing, reading files, the clipboard) is queued in `outside` for the
//! code that drives the session. Tests drive it without a window.

use std::ffi::OsStr;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cloud::Bounds;
use glam::DVec3;
use scene::{Camera, Lighting, MirrorPoints, Settings, Shape, Show};
use serde_json::json;

use crate::viewer::action::{Action, Handles, KeptStep, Palette};
use crate::viewer::auto::Auto;
use crate::viewer::filming::Filming;
use crate::viewer::first_look::FirstLook;
use crate::viewer::frames::{Frames, Situation};
use crate::viewer::kept::Kept;
use crate::viewer::loaded::clouds::CloudEntry;
use crate::viewer::loaded::{Beside, Loaded, all_mirrors};
use crate::viewer::messages::{Level, Messages};
use crate::viewer::objects::Origin;
use crate::viewer::outside::{Effect, News, Outside};
use crate::viewer::panels::path_prompt::{PathPrompt, Purpose};
use crate::viewer::preferences::Preferences;
use crate::viewer::reflection_figures::FigureHistory;
use crate::viewer::scene::{STEP, Scene};
use crate::viewer::theme::bytes;
use crate::viewer::tools::Tools;
use crate::viewer::truth::sweep::Sweeps;
use crate::viewer::truth::tasks::Answer;
use crate::viewer::truth::tuning::Tuning;
use crate::viewer::truth::view::{Taken, TruthView};
use crate::viewer::truth::{Around, sweep, tuning};
use crate::viewer::window::render_thread::{Command, Frame, FrameRequest, Report};
use crate::viewer::work::{Found, Work};

pub struct Session {
    pub loaded: Loaded,
    pub scene: Scene,
    pub figure_history: FigureHistory,
    pub tools: Tools,
    pub raw_colors: bool,
    pub truth: TruthView,
    pub kept: Kept,
    pub tuning: Tuning,
    pub sweeps: Sweeps,
    pub outside: Outside,
    pub preferences: Preferences,
    pub path_prompt: Option<PathPrompt>,
    pub palette: Option<Palette>,
    /// What is searched for among the parameters.
    pub search: String,
    pub shortcuts_are_open: bool,
    pub interface_is_hidden: bool,
    pub is_full_screen: bool,
    /// The name of the adapter that draws; `None` until its shaders are compiled.
    pub adapter: Option<String>,
    pub frames: Frames,
    pub auto: Auto,
    pub filming: Filming,
    /// Set while the window shows what it does when nothing is named.
    pub first_look: Option<FirstLook>,
    /// The reason why nothing can be drawn any more.
    pub fatal: Option<String>,
    pub wants_to_quit: bool,
    /// True while pictures are recorded: only final pictures are drawn, and none depends on the pictures before it.
    pub is_recorded: bool,
}

impl Session {
    pub fn new(preferences: Preferences) -> Self {
        let (settings, warnings) = preferences.settings();
        let mut messages = Messages::default();
        warnings.into_iter().for_each(|warning| messages.warning(format!("kept parameters: {warning}")));
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
            fatal: None,
            wants_to_quit: false,
            is_recorded: false,
        }
    }

    // ---- actions ----

    /// Carries out everything that a panel or one paint of the window asked for.
    pub fn act_all(&mut self, actions: impl IntoIterator<Item = Action>) {
        actions.into_iter().for_each(|action| self.act(action));
    }

    pub fn act(&mut self, action: Action) {
        use Action::{
            AddSpot, AskHover, ChangeObject, ChangeSettings, ColorBy, DollHouse, Duplicate, FieldOfView, FlySpeed,
            FrameAll, FrameCloud, GoInside, LastView, LightBy, Look, LookAlong, LookFrom, Mark, NextLight, NextView,
            Orbit, Pan, Paste, PivotHere, PointAt, PointSize, ReturnTo, Select, SetParameter, ShowClasses, ToggleEdl,
            ToggleLight, ToggleMode, ToggleProjection, Travel, Unmark, Zoom,
        };
        self.filming.before(&action, &mut self.scene);
        let Some(action) = self.scene.act(action, &self.loaded.clouds, &mut self.outside) else { return };
        match action {
            // `Travel` and `Hold` report keys that are held down, and `Paste` brings the clipboard's text.
            Action::Fly(_) | Action::Fast | Action::Slow => {}
            Action::RawColors | Action::ShowTruth | Action::ShowKept | Action::PasteView => {}
            Action::Hold { raw_colors, truth, kept } => {
                (self.raw_colors, self.kept.is_held) = (raw_colors, kept);
                // Without clouds there is no truth to show.
                let is_held = truth && (self.truth.is_held || !self.loaded.clouds.is_empty());
                self.truth.hold(is_held, &mut self.outside);
            }
            Action::Open(path) => drop(self.open(&[path])),
            Action::OpenDialog => self.outside.push(Effect::OpenDialog),
            Action::OpenPrompt => self.path_prompt = Some(PathPrompt::default()),
            Action::ChangePrompt(prompt) => self.path_prompt = Some(*prompt),
            Action::OpenPrompted(path) => self.open_prompted(path),
            Action::ClosePrompt => self.path_prompt = None,
            Action::Copy(text) => self.outside.push(Effect::Copy(text)),
            Action::CopyView => self.scene.copy_view(&self.loaded, &mut self.outside),
            Action::CopyCommandLine => {
                self.outside.push(Effect::Copy(self.scene.command_line(&self.loaded)));
                self.outside.note("Command line copied");
            }
            Action::SaveScene => self.scene.save_scene(&self.loaded, &mut self.outside),
            Action::Export(step) => self.loaded.export(step, &self.scene, &mut self.outside),
            Action::SavePicture => self.tools.save_picture(&self.scene, &self.frames, &self.loaded, &mut self.outside),
            Action::Compare(step) => self.with_loaded(|loaded, beside| loaded.compare(step, beside)),
            Action::Kept(step) => self.act_kept(step),
            Action::StopLoading => self.with_loaded(Loaded::stop_loading),
            Action::ShowCloud(key, is_visible) => {
                self.with_loaded(|loaded, beside| loaded.set_visible(key, is_visible, beside))
            }
            Action::RemoveCloud(key) => {
                self.with_loaded(|loaded, beside| loaded.remove_cloud(key, beside));
                if self.loaded.clouds.is_empty() {
                    self.leave_first_look();
                }
            }
            Action::StopMaking(key) => self.loaded.stop_making(key),
            Action::ResumeMaking(key) => self.loaded.resume_making(key),
            Action::DeleteIndex(key) => self.with_loaded(|loaded, beside| loaded.delete_index(key, beside)),
            Action::AddMirror(shape) => self.tools.add_mirror(shape, &mut self.scene, &self.loaded, &mut self.outside),
            Action::Clip(clipping) => self.tools.clip(clipping, &mut self.scene, &self.loaded, &mut self.outside),
            Action::Gizmo(handles) => {
                self.tools.handles = if self.tools.handles == handles { Handles::All } else { handles };
            }
            Action::GrabHandle(is_grabbed) => {
                if std::mem::replace(&mut self.tools.handle_is_grabbed, is_grabbed) && !is_grabbed {
                    self.scene.log_moved(&mut self.outside);
                }
            }
            Action::ShowLights(are_shown) => self.tools.light_panel_is_open = are_shown,
            Action::Inspect => self.tools.toggle_inspection(&mut self.scene, &self.loaded, &mut self.outside),
            Action::InspectDistance(notches) => self.tools.change_pose(|pose| pose.move_away(STEP.powf(notches))),
            Action::InspectTilt(notches) => self.tools.change_pose(|pose| pose.lean(notches)),
            Action::ChangeInspection(changed) => self.tools.change_pose(|pose| *pose = changed),
            Action::ChangeDraft(draft) => self.tools.draft = *draft,
            Action::CountPoints(key, wanted) => {
                if let Some(entry) = self.loaded.cloud(key) {
                    let (cloud, source, wanted) = (entry.cloud.clone(), entry.source.clone(), *wanted);
                    self.outside.work(Work::CountPoints { cloud, source, wanted });
                }
            }
            Action::StopMarking(key) => {
                let marking = self.loaded.cloud(key).and_then(|entry| entry.marking.as_ref());
                marking.iter().for_each(|(_, progress)| progress.cancel());
            }
            Action::Pick => self.tools.click(&mut self.scene, &mut self.outside),
            Action::UndoPick => self.tools.pick = self.scene.navigation.pick_before.take(),
            Action::CopyPick => self.tools.copy_pick(&mut self.outside),
            Action::ClearPick => self.tools.pick = None,
            Action::Measuring(measuring) => {
                self.tools.measure(measuring, &mut self.scene, &self.loaded, &mut self.outside)
            }
            Action::Film(film) => {
                let drawn_by = self.adapter.as_deref();
                self.filming.act(film, &mut self.scene, &self.loaded, drawn_by, &mut self.outside)
            }
            Action::PinTruth => self.truth.is_pinned = !self.truth.is_pinned,
            Action::LookAtTruth(look) => self.truth.look = look,
            Action::MeasureTruth(measure) => self.truth.measure = measure,
            Action::SplitTruth(share) => self.truth.split = share,
            Action::KeepTruthReady(is_on) => self.truth.keeps_ready = is_on,
            Action::JudgeSettings(is_on) => self.truth.judges = is_on,
            Action::EstimateErrors(is_on) => self.truth.live.is_on = is_on,
            Action::StopTruth => self.stop_truth(),
            Action::ToggleChart => self.tuning.is_open = !self.tuning.is_open,
            Action::ForgetTrials => self.tuning.forget_trials(),
            Action::AddToStudy => self.scene.add_to_study(&self.loaded, &mut self.outside),
            Action::AskSweep(key) => self.sweeps.ask(&key, &self.scene.settings, &mut self.outside),
            Action::ChangeSweep(range) => self.sweeps.asked = range.map(|range| *range),
            Action::StartSweep { key, values } => self.start_sweep(&key, values, &sweep::places()),
            Action::EndSweep => self.sweeps.stop(&mut self.outside),
            Action::EndTool => self.end_tool(),
            Action::ToggleInterface => self.interface_is_hidden = !self.interface_is_hidden,
            Action::TogglePanel => self.preferences.panel_is_open = !self.preferences.panel_is_open,
            Action::OpenTab(tab) => self.preferences.tab = tab.name().to_owned(),
            Action::Search(text) => self.search = text,
            Action::FindParameter(key) => {
                (self.search, self.preferences.panel_is_open, self.interface_is_hidden) = (key, true, false);
            }
            Action::TogglePalette => self.palette = Some(Palette::default()).filter(|_| self.palette.is_none()),
            Action::ChangePalette(palette) => self.palette = palette.map(|palette| *palette),
            Action::ToggleFullScreen => {
                self.is_full_screen = !self.is_full_screen;
                self.outside.push(Effect::SetFullScreen(self.is_full_screen));
            }
            Action::ToggleShortcuts => self.shortcuts_are_open = !self.shortcuts_are_open,
            Action::ListMessages(is_open) => self.outside.messages.list_is_open = is_open,
            Action::DismissMessage(place) => self.outside.messages.dismiss(place),
            Action::Resize(size) => self.set_view_size(size),
            Action::Quit => self.wants_to_quit = true,
            // The scene has already carried these out.
            LookAlong { .. } | SetParameter { .. } | Action::Undo | Action::Redo | Action::Delete => {}
            Orbit(_) | Look(_) | Pan(_) | Zoom(_) | FieldOfView(_) | FlySpeed(_) | Travel(_) | FrameAll | GoInside
            | DollHouse | FrameCloud(_) | ToggleMode | LookFrom(_) | ToggleProjection | LastView | NextView
            | PointAt(_) | AskHover | PivotHere | ChangeSettings(_) | PointSize(_) | ColorBy(_) | ShowClasses(..)
            | ToggleEdl | ToggleLight | NextLight | LightBy(_) | Paste(_) | AddSpot | Select(_) | ChangeObject(..)
            | Duplicate | Mark(_) | Unmark(_) | ReturnTo(_) => {}
        }
    }

    fn act_kept(&mut self, step: KeptStep) {
        let request = self.auto.applied(self.picture());
        let mut kept = std::mem::take(&mut self.kept);
        self.with_loaded(|loaded, beside| kept.act(step, request, loaded, beside));
        self.kept = kept;
    }

    /// If the typed text names nothing, the prompt stays open.
    fn open_prompted(&mut self, path: String) {
        let purpose = self.path_prompt.as_ref().map_or(Purpose::Open, |prompt| prompt.purpose);
        if purpose == Purpose::Mesh {
            self.path_prompt = None;
            self.outside.work(Work::ReadMesh(Shape::Mesh(path.into())));
        } else if self.open(std::slice::from_ref(&path)) {
            self.path_prompt = None;
            if purpose == Purpose::MirrorPoints {
                self.loaded.await_marking(MirrorPoints::whole(path));
            }
        }
    }

    /// Handles Esc: closes what lies on top; otherwise ends the tool; otherwise clears the pick.
    fn end_tool(&mut self) {
        if self.shortcuts_are_open {
            self.shortcuts_are_open = false;
        } else if self.path_prompt.is_some() {
            self.path_prompt = None;
        } else if !self.tools.end_one(&mut self.scene, &mut self.outside) && self.is_full_screen {
            self.act(Action::ToggleFullScreen);
        }
    }

    // ---- opening ----

    /// Opens what the words name: files, scene files or built-in scenes. Reports what is wrong if they name nothing,
    /// and returns whether they name something.
    pub fn open<Word: AsRef<OsStr>>(&mut self, words: &[Word]) -> bool {
        let request = world::resolve(words);
        match request.check() {
            Ok(()) => {
                self.open_request(request);
                true
            }
            Err(error) => {
                self.outside.say(Level::Error, error.to_string());
                false
            }
        }
    }

    pub fn open_request(&mut self, mut request: world::Request) {
        if !request.inputs.is_empty() {
            self.leave_first_look();
            self.scene.ground = request.ground();
            let is_alone = self.loaded.clouds.is_empty() && !self.loaded.is_loading() && !self.is_recorded;
            self.first_look = FirstLook::of(&mut request, &self.scene.settings).filter(|_| is_alone);
        }
        let built_in_light = request.built_in_light();
        for warning in request.warnings {
            self.outside.say(Level::Warning, warning);
        }
        if let Some(view) = request.view {
            // A built-in scene brings a camera without parameters of its own: the current ones stay.
            let settings =
                if view.settings == Settings::default() { self.scene.settings.clone() } else { view.settings.clone() };
            match view.camera {
                Some(camera) if self.loaded.clouds.is_empty() => self.scene.jump(self.outside.now, settings, camera),
                _ => self.scene.settings = settings,
            }
        }
        let built_in = built_in_light.map(|light| (light, Origin::BuiltIn));
        self.scene.bring_lights(
            request.lights.into_iter().map(|light| (light, Origin::Person)).chain(built_in),
            &mut self.outside,
        );
        for mirror in request.mirrors {
            self.scene.bring_mirror(mirror, None, &mut self.outside);
        }
        self.loaded.awaited_markings.extend(request.mirror_points);
        self.scene.bring_visibility(&request.visibility, request.clips);
        self.scene.bring_measurements(request.measurements, request.notes);
        self.scene.bring_paths(request.bookmarks, request.paths);
        if !request.inputs.is_empty() {
            self.outside.push(Effect::Load { inputs: request.inputs });
        }
    }

    fn leave_first_look(&mut self) {
        if let Some(first) = self.first_look.take() {
            self.with_loaded(|loaded, beside| first.leave(loaded, beside));
        }
    }

    /// Takes in a message from another thread.
    pub fn on_news(&mut self, news: News) {
        match news {
            News::Loading(job, event, pass) => {
                self.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
                if let Some(first) = &mut self.first_look {
                    first.offer_ball(&mut self.scene);
                }
                if let Some(pass) = pass {
                    self.outside.render(Command::Arrived(pass));
                }
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
            Found::Radii { key, test, radii } => {
                self.with_loaded(|loaded, beside| loaded.on_radii(key, &test, radii, beside))
            }
            Found::Column { key, attribute, result } => {
                self.with_loaded(|loaded, beside| loaded.on_column(key, attribute, result, beside))
            }
            Found::Record { picked, record, result } => {
                for pick in self.tools.pick.iter_mut().filter(|pick| pick.point == picked) {
                    pick.record = Some(result.clone());
                }
                let attributes: serde_json::Map<_, _> =
                    result.unwrap_or_default().into_iter().map(|(name, value)| (name, value.into())).collect();
                self.outside.log(json!({ "event": "record", "point": record, "attributes": attributes }));
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
            Found::Truth(answer) => self.on_truth(*answer),
            Found::AddedToStudy { plan, result } => tuning::on_added_to_study(&plan, result, &mut self.outside),
            Found::SweepSaved { folder, result } => sweep::on_saved(&folder, result, &mut self.outside),
            Found::SceneSaved { path, result } => self.outside.scene_saved(&path, result),
            Found::Exported { path, result } => self.loaded.on_exported(&path, result, &mut self.outside),
            Found::Compared(comparison) => self.with_loaded(|loaded, beside| loaded.on_compared(*comparison, beside)),
            Found::Recording(stage) => self.filming.recording.on_stage(stage, &self.outside),
            Found::Captured(captured) => self.filming.on_captured(captured, &mut self.outside),
            Found::Recorded(ended) => self.filming.recording.on_end(ended, &mut self.outside),
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
        // A pick on a cloud is removed with the cloud.
        self.tools.pick = self.tools.pick.take().filter(|pick| self.loaded.cloud(pick.point.chunk.cloud).is_some());
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

    /// The place of the point under the cursor, if it is known.
    pub fn hovered(&self) -> Option<DVec3> {
        self.scene.navigation.hovered.and_then(|(_, world)| world)
    }

    pub fn up(&self) -> DVec3 {
        self.scene.up(&self.loaded.clouds)
    }

    /// Frames everything unless someone has placed the camera: the clouds' outlines, or `bounds` while no outline is
    /// known.
    pub fn frame_while_unplaced(&mut self, bounds: Bounds) {
        self.scene.frame_while_unplaced(bounds, &self.loaded.clouds);
    }

    /// Sets the size of the picture in pixels.
    pub fn set_view_size(&mut self, size: [u32; 2]) {
        if self.scene.view_size != size {
            self.scene.view_size = size;
            let bounds = self.bounds();
            self.frame_while_unplaced(bounds);
        }
    }

    /// Puts the camera where a recording has it at time `now`. This does not count as a move, so no hurried frame is
    /// drawn. Streamed clouds load for the new view at once.
    pub fn stand(&mut self, camera: Camera, now: Instant) {
        self.outside.now = now;
        self.scene.camera = camera;
        self.scene.camera_is_placed = true;
        self.with_loaded(Loaded::look_around);
    }

    /// Acts on everything that has happened since the last step: requests the frame, the figures and the truth that are
    /// wanted now, and notes what can be undone. The window and tests call it after each paint. `now` is the time by
    /// the caller's clock. `is_held` says that a mouse button is down or text is being typed. Returns the time after
    /// which the next step is due if nothing happens before.
    pub fn step(&mut self, now: Instant, is_held: bool) -> Option<Duration> {
        self.outside.now = now;
        let zoom = self.scene.end_zoom_wait(self.outside.now);
        self.tools.follow_cursor(&mut self.scene, &self.loaded, &mut self.outside);
        self.scene.navigation.hold(is_held, now);
        let steps = self.scene.history.steps();
        let still = self.still_frame().filter(|_| !self.is_recorded).cloned();
        let film = self.filming.step(&mut self.scene, still.as_ref(), &mut self.outside);
        let quiet = self.scene.watch(is_held, now);
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
        let still = self.still_frame().cloned();
        self.kept.sync(still.as_ref(), &self.loaded, &mut self.outside);
        let truth = self.sync_truth();
        let still = self.still_frame().and(self.frames.shown.as_ref()).filter(|_| !self.is_recorded);
        let still = still.map(|shown| shown.stats.frame_milliseconds);
        let auto = self.auto.sync(self.picture(), still, &mut self.outside);
        // Once the panel says it, only the next picture changes that.
        let late = self.frames.time_to_late(now).filter(|left| !left.is_zero());
        [quiet, view, zoom, frame, truth, late, auto, film].into_iter().flatten().min()
    }

    /// Requests the frame that is wanted now, unless it is already drawn or shown. Returns the time after which to call
    /// again.
    pub fn request_frame(&mut self) -> Option<Duration> {
        let is_first = self.frames.shown.is_none();
        let is_empty =
            self.loaded.clouds.is_empty() || is_first && self.loaded.points() == 0 && self.loaded.is_loading();
        if self.adapter.is_none() || self.scene.view_size.contains(&0) || is_empty {
            return None;
        }
        let is_mirror = self.scene.selected.is_some_and(|id| self.scene.objects.mirror(id).is_some());
        let situation = Situation {
            points_come: self.loaded.points_come(),
            light_comes: !self.loaded.light_search.is_known(),
            soon_changes: self.loaded.soon_changes(),
            rest: self.scene.navigation.time_to_rest(self.outside.now),
            a_mirror_is_dragged: is_mirror && self.tools.handle_is_grabbed,
            is_recorded: self.is_recorded,
            milliseconds: f64::from(self.scene.settings.view.frame_ms),
        };
        let under_way = self.frames.under_way;
        let again = self.frames.request(self.auto.applied(self.picture()), &situation, &mut self.outside);
        if is_first && self.frames.under_way > under_way {
            self.loaded.jobs.iter().for_each(|job| job.mailbox.draw_first(true));
        }
        again
    }

    /// The request for the current view in full quality.
    pub fn picture(&self) -> FrameRequest {
        let mut settings = self.scene.settings.clone();
        if self.raw_colors {
            settings.edl.strength = 0.0;
            settings.light.by = Lighting::Colors;
        }
        if let Some(pick) = self.tools.pick.as_ref().filter(|_| settings.reflection.show == Show::Error) {
            settings.reflection.point = pick.world.to_array().map(|value| value.to_string()).join(", ");
        }
        FrameRequest {
            camera: self.scene.camera,
            settings: settings.drawn(),
            mirrors: all_mirrors(&self.scene.objects, self.tools.inspection.as_ref())
                .map(|(_, mirror)| mirror.clone())
                .collect(),
            lights: self.loaded.lights(&self.scene),
            clues: self.loaded.clues(&self.scene),
            size: self.scene.view_size,
            revision: self.frames.revision,
            spared: None,
            hurried: false,
            light_may_lag: self.loaded.light_may_lag(),
        }
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
        match report {
            Report::Ready { adapter } => {
                self.outside.log(json!({ "event": "ready", "adapter": adapter }));
                self.auto.ready(&adapter, &mut self.outside);
                self.adapter = Some(adapter);
                // The window is painted before it requests the next frame.
                let has_points = self.loaded.points() > 0;
                self.loaded.jobs.iter().for_each(|job| job.mailbox.draw_first(has_points));
            }
            // The frame shows clouds that have been removed since.
            Report::Frame(_) if self.loaded.clouds.is_empty() => self.frames.give_up(),
            Report::Frame(frame) => {
                if !frame.request.hurried && frame.request.is_whole(&frame.stats) {
                    self.figure_history.push(&frame.stats);
                    self.auto.learn(&frame.request, &frame.stats);
                }
                let Frame { request, stats, total_milliseconds, .. } = *frame;
                self.scene.navigation.on_picture(request.spared.is_some());
                self.frames.show(request, stats, total_milliseconds, f64::from(self.scene.settings.view.frame_ms));
            }
            Report::Picked { pixel, purpose, point } => {
                self.tools.on_picked(pixel, purpose, point, &mut self.scene, &self.loaded, &mut self.outside);
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
                self.auto.on_chosen(*request, choice, *model, &mut self.outside)
            }
            Report::Measured { request, stats } => {
                if !self.sweeps.on_frame(&request, &stats) {
                    self.tuning.on_measured(&request, &stats);
                }
            }
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
            }
        }
    }

    // ---- truth ----

    /// Calls `act` with what the truth and a sweep read from the session, and with the parts that they change.
    fn with_truth<R>(
        &mut self,
        act: impl FnOnce(&Around<'_>, &mut TruthView, &mut Tuning, &mut Sweeps, &mut Outside) -> R,
    ) -> R {
        let around = Around {
            still: self.still_frame().cloned(),
            clouds: &self.loaded.clouds,
            samples: &self.loaded.samples,
            settings: &self.scene.settings,
            test: self.scene.objects.test(),
            frames: &self.frames,
            raw_colors: self.raw_colors,
            is_swept: self.sweeps.under_way.is_some(),
        };
        act(&around, &mut self.truth, &mut self.tuning, &mut self.sweeps, &mut self.outside)
    }

    /// Advances the sweep and the truth by one step. Returns the time after which to call again.
    pub fn sync_truth(&mut self) -> Option<Duration> {
        self.with_truth(|around, truth, _, sweeps, outside| sweeps.sync(around, truth, outside));
        // A sweep draws other frames.
        let still = self.still_frame().filter(|_| self.sweeps.under_way.is_none()).cloned();
        let estimate = self.truth.live.sync(still.as_ref(), &mut self.outside);
        let truth = self.with_truth(|around, truth, tuning, _, outside| truth.sync(around, tuning, outside));
        estimate.into_iter().chain(truth).min()
    }

    pub fn start_sweep(&mut self, key: &str, values: Vec<String>, places: &[PathBuf]) {
        self.with_truth(|around, _, _, sweeps, outside| sweeps.start(key, values, places, around, outside));
    }

    /// The frame whose truth belongs in the picture now. `None` if the view has changed and its picture is not drawn
    /// yet: the traced truth belongs to the view before.
    pub fn truth_frame(&self) -> Option<FrameRequest> {
        let request = &self.frames.shown.as_ref().filter(|_| self.truth.is_asked_for())?.request;
        let is_current =
            request.camera == self.scene.camera && request.size == self.scene.view_size && !request.hurried;
        is_current.then(|| request.clone())
    }

    /// Stops all work for the truth, the chart and a sweep.
    pub fn stop_truth(&mut self) {
        self.truth.stop();
        self.tuning.is_open = false;
        self.sweeps.stop(&mut self.outside);
    }

    /// Handles a truth that cannot be computed: the truth requests nothing more. During a sweep, the current value has
    /// failed.
    fn on_not_judged(&mut self, problem: &str) {
        self.truth.on_not_judged();
        self.tuning.forget_measuring();
        if !self.sweeps.on_failed(problem, &mut self.outside) {
            self.stop_truth();
            self.outside.say(Level::Error, format!("The truth cannot be shown: {problem}"));
        }
    }

    pub fn on_truth(&mut self, answer: Answer) {
        match self.truth.on_answer(answer, self.frames.revision) {
            Taken::Nothing => {}
            Taken::Log(event) => self.outside.log(event),
            Taken::Swept { request, figures, picture } => self.sweeps.on_judged(&request, *figures, picture),
            Taken::Failed(problem) => self.on_not_judged(&problem),
        }
    }
}

#[cfg(test)]
#[path = "session_tests.rs"]
mod tests;
