//! Carries out what a person asks for: each action goes to the part of the session that it concerns.

use scene::{MirrorPoints, Shape};
use serde_json::json;

use crate::shared::language::text;
use crate::viewer::filming;
use crate::viewer::loaded::Loaded;
use crate::viewer::requests::action::{Action, KeptStep, Measuring, Palette};
use crate::viewer::requests::columns::Naming;
use crate::viewer::requests::outside::Effect;
use crate::viewer::requests::path_prompt::{PathPrompt, Purpose};
use crate::viewer::requests::work::Work;
use crate::viewer::scene::STEP;
use crate::viewer::session::Session;
use crate::viewer::session::document::Leaving;
use crate::viewer::truth::sweep;

impl Session {
    /// Carries out everything that a panel or one paint of the window asked for.
    pub fn act_all(&mut self, actions: impl IntoIterator<Item = Action>) {
        actions.into_iter().for_each(|action| self.act(action));
    }

    pub fn act(&mut self, action: Action) {
        // While corners are given, undo takes the last one back.
        let action = match action {
            Action::Undo if self.tools.has_corners() => Action::Measuring(Measuring::RemoveCorner),
            action => action,
        };
        if let Some(action) = self.tools.clicked.keep(action) {
            self.carry_out(action);
        }
    }

    /// Carries out what has waited for clicks that are answered now.
    pub(super) fn carry_out_due(&mut self) {
        self.tools.clicked.due().into_iter().for_each(|action| self.carry_out(action));
    }

    fn carry_out(&mut self, action: Action) {
        use Action::{
            AddSpot, AskHover, ColorBy, DollHouse, Duplicate, EndDrag, Fast, Fly, FlySpeed, FrameAll, GoInside,
            LastView, LightBy, Look, LookAlong, LookFrom, Mark, NextLight, NextView, Orbit, Pan, Paste, PasteView,
            PivotHere, PointAt, PointSize, RawColors, ReturnTo, Select, SetParameter, ShowKept, ShowTruth, Slow,
            ToggleEdl, ToggleLight, ToggleMode, Travel, Unmark, Zoom,
        };
        self.filming.before(&action, &mut self.scene);
        let Some(action) = self.scene.act(action, &self.loaded.clouds, &mut self.outside) else { return };
        match action {
            // `Travel` and `Hold` report keys that are held down, and `Paste` brings the clipboard's text.
            Fly(_) | Fast | Slow | RawColors | ShowTruth | ShowKept | PasteView => {}
            Action::Hold { raw_colors, truth, kept } => {
                (self.raw_colors, self.kept.is_held) = (raw_colors, kept);
                // Without clouds there is no truth to show.
                let is_held = truth && (self.truth.is_held || !self.loaded.clouds.is_empty());
                self.truth.hold(is_held, &mut self.outside);
            }
            Action::Open(path) => drop(self.open_by_hand(vec![path])),
            Action::Name(step) => self.name_columns(step),
            Action::OpenDialog => self.outside.push(Effect::OpenDialog),
            Action::OpenPrompt => self.path_prompt = Some(PathPrompt::default()),
            Action::ChangePrompt(prompt) => self.path_prompt = Some(*prompt),
            Action::OpenPrompted(path) => self.open_prompted(path),
            Action::ClosePrompt => self.close_prompt(),
            Action::Copy(text) => self.outside.push(Effect::Copy(text)),
            Action::CopyView => self.scene.copy_view(&self.loaded, &mut self.outside),
            Action::CopyCommandLine => self.scene.copy_command_line(&self.loaded, &mut self.outside),
            Action::File(filing) => self.file(filing),
            Action::Export(step) => self.loaded.export(step, &self.scene, &mut self.outside),
            Action::SavePicture(step) => {
                let Self { tools, scene, frames, loaded, outside, kept, truth, .. } = self;
                let is_saved = tools.save_picture(step, scene, frames, loaded, outside);
                if is_saved && (kept.is_asked_for() || truth.is_asked_for()) {
                    outside.note(text!("The present picture is saved alone, without what it is compared with"));
                }
            }
            Action::Compare(step) => self.with_loaded(|loaded, beside| loaded.compare(step, beside)),
            Action::Ghosts(step) => self.with_loaded(|loaded, beside| loaded.ghost(step, beside)),
            Action::Kept(step) => self.act_kept(step),
            Action::StopLoading => self.with_loaded(Loaded::stop_loading),
            Action::StopAll => {
                self.loaded.running().iter().for_each(|work| work.progress.cancel());
                self.with_loaded(Loaded::stop_loading);
            }
            Action::ShowCloud(key, on) => self.with_loaded(|loaded, beside| loaded.set_visible(key, on, beside)),
            Action::ChangeCloud(key, own) => self.with_loaded(|loaded, beside| loaded.set_own(key, *own, beside)),
            Action::RemoveCloud(key) if self.loaded.clouds.len() > 1 => self.remove_cloud(key),
            Action::RemoveCloud(key) => self.leave(Leaving::Close(key)),
            Action::StopMaking(key) => self.loaded.stop_making(key),
            Action::ResumeMaking(key) => self.loaded.resume_making(key),
            Action::DeleteIndex(key) => self.with_loaded(|loaded, beside| loaded.delete_index(key, beside)),
            Action::AddMirror(shape) => self.tools.add_mirror(shape, &mut self.scene, &self.loaded, &mut self.outside),
            Action::Clip(clipping) => self.tools.clip(clipping, &mut self.scene, &self.loaded, &mut self.outside),
            Action::Gizmo(handles) => self.tools.show_handles(handles),
            Action::GrabHandle(is_grabbed) => self.tools.grab(is_grabbed, &mut self.scene, &mut self.outside),
            Action::ShowLights(are_shown) => self.tools.light_panel_is_open = are_shown,
            Action::Inspect => self.tools.toggle_inspection(&mut self.scene, &self.loaded, &mut self.outside),
            Action::InspectDistance(notches) => self.tools.change_pose(|pose| pose.move_away(STEP.powf(notches))),
            Action::InspectTilt(notches) => self.tools.change_pose(|pose| pose.lean(notches)),
            Action::ChangeInspection(changed) => self.tools.change_pose(|pose| *pose = changed),
            Action::ChangeDraft(draft) => self.tools.draft = *draft,
            Action::CountPoints(key, wanted) => self.loaded.count_points(key, *wanted, &mut self.outside),
            Action::StopMarking(key) => self.loaded.stop_marking(key),
            Action::BeginDrag => self.tools.begin_drag(&mut self.scene, &self.loaded, &mut self.outside),
            Action::Pick => self.tools.click(&mut self.scene, &mut self.outside),
            Action::PickMiddle => {
                let middle = self.scene.view_size.map(|side| side / 2);
                self.act_all([Action::PointAt(Some(middle)), Action::Pick]);
            }
            Action::UndoPick => self.tools.pick = self.scene.navigation.pick_before.take(),
            Action::CopyPick => self.tools.copy_pick(&mut self.outside),
            Action::ClearPick => self.tools.pick = None,
            Action::Measuring(measuring) => {
                self.tools.measure(measuring, &mut self.scene, &self.loaded, &mut self.outside)
            }
            Action::Profile(one) => self.tools.profile(one, &mut self.scene, &self.loaded, &mut self.outside),
            Action::Film(film) => {
                let (kept, adapter) = (self.kept.settings(), self.adapter.as_deref());
                let around = filming::Around::new(&self.loaded, &self.frames, &self.tuning, kept, adapter);
                self.filming.act(film, &mut self.scene, &around, &mut self.preferences, &mut self.outside)
            }
            Action::PinTruth => self.truth.is_pinned = !self.truth.is_pinned,
            Action::LookAtTruth(look) => self.truth.look = look,
            Action::MeasureTruth(measure) => self.truth.measure = measure,
            Action::SplitTruth(share) => self.truth.split = share,
            Action::KeepTruthReady(is_on) => self.truth.keeps_ready = is_on,
            Action::JudgeSettings(is_on) => self.truth.judges = is_on,
            Action::EstimateErrors(is_on) => self.truth.live.is_on = is_on,
            Action::StopTruth => self.stop_truth(),
            Action::ToggleChart => {
                self.tuning.toggle(&mut self.preferences, &mut self.interface_is_hidden, &mut self.search)
            }
            Action::ForgetTrials => self.tuning.forget_trials(),
            Action::AddToStudy => self.scene.add_to_study(&self.loaded, &mut self.outside),
            Action::AskSweep(key) => self.sweeps.ask(&key, &self.scene.settings, &mut self.outside),
            Action::ChangeSweep(range) => self.sweeps.asked = range.map(|range| *range),
            Action::StartSweep { key, values } => self.start_sweep(&key, values, &sweep::places()),
            Action::EndSweep => self.sweeps.stop(&mut self.outside),
            Action::EndTool => self.end_tool(),
            Action::ToggleInterface => self.interface_is_hidden = !self.interface_is_hidden,
            Action::TogglePanel => self.preferences.panel_is_open = !self.preferences.panel_is_open,
            Action::OpenTab(tab) => {
                self.preferences.tab = tab.name().to_owned();
                self.search.clear();
            }
            Action::Speak(language) => self.preferences.language = language,
            Action::Search(text) => self.search = text,
            Action::FindParameter(key) => {
                (self.search, self.preferences.panel_is_open, self.interface_is_hidden) = (key, true, false);
            }
            Action::TogglePalette => {
                self.palette = Some(Palette::default()).filter(|_| self.palette.is_none());
                self.outside.log(json!({ "event": "palette" }));
            }
            Action::ChangePalette(palette) => self.palette = palette.map(|palette| *palette),
            Action::ToggleFullScreen => {
                self.is_full_screen = !self.is_full_screen;
                self.outside.push(Effect::SetFullScreen(self.is_full_screen));
            }
            Action::ToggleShortcuts => self.shortcuts_are_open = !self.shortcuts_are_open,
            Action::Warn(text) => self.outside.warning(text),
            Action::ListMessages(is_open) => self.outside.messages.list_is_open = is_open,
            Action::DismissMessage(place) => self.outside.messages.dismiss(place),
            Action::Resize(size) => self.set_view_size(size),
            Action::Quit => self.leave(Leaving::Quit),
            // The scene has already carried these out.
            LookAlong { .. } | SetParameter { .. } | Action::Undo | Action::Redo | Action::Delete => {}
            EndDrag
            | Orbit(_)
            | Look(_)
            | Pan(_)
            | Zoom(_)
            | Action::FieldOfView(_)
            | FlySpeed(_)
            | Travel(_)
            | FrameAll
            | GoInside
            | DollHouse
            | Action::FrameCloud(_)
            | ToggleMode
            | LookFrom(_)
            | Action::ToggleProjection
            | LastView
            | NextView
            | PointAt(_)
            | AskHover
            | PivotHere
            | Action::ChangeSettings(_)
            | PointSize(_)
            | ColorBy(_)
            | Action::ShowClasses(..)
            | ToggleEdl
            | ToggleLight
            | NextLight
            | LightBy(_)
            | Paste(_)
            | AddSpot
            | Select(_)
            | Action::ChangeObject(..)
            | Duplicate
            | Mark(_)
            | Unmark(_)
            | ReturnTo(_)
            | Action::Reset(_) => {}
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
        if let Some(action) = Action::saving(purpose, &path) {
            self.path_prompt = None;
            self.act(action);
        } else if purpose == Purpose::Mesh {
            self.path_prompt = None;
            self.outside.work(Work::ReadMesh(Shape::Mesh(path.into())));
        } else if self.open_by_hand(vec![path.clone().into()]) {
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
            self.close_prompt();
        } else if let Some(first) = self.unnamed.first() {
            self.name_columns(Naming::Cancel(first.path.clone()));
        } else if self.sweeps.asked.take().is_some()
            || self.tools.end_one(&mut self.scene, &mut self.outside)
            || std::mem::take(&mut self.tuning.is_open)
        {
        } else if self.is_full_screen {
            self.act(Action::ToggleFullScreen);
        }
    }

    fn close_prompt(&mut self) {
        self.path_prompt = None;
        self.document.on_no_place();
    }
}
