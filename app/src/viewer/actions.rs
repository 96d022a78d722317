//! What each action does to the session.

use param::Choice as _;
use scene::{Lighting, Mirror, MirrorPoints, Object, Projection, Shape, StandardView};
use world::CloudKey;

use super::action::{Action, Handles, Mode};
use super::clouds::CloudEntry;
use super::inspection::{Inspection, Surface, Target};
use super::loaded::Loaded;
use super::outside::Effect;
use super::path_prompt::PathPrompt;
use super::render_thread::{Command, PickPurpose};
use super::session::Session;
use super::work::Work;
use super::{pick, sweep};

/// Growth of splats and of the field of view per notch: seven notches double.
const STEP: f32 = 1.1;
/// Radians that a notch tilts the inspection mirror.
const TILT_STEP: f64 = 0.087;

impl Session {
    /// Does all that a panel or a painting of the window asked for.
    pub fn act_all(&mut self, actions: impl IntoIterator<Item = Action>) {
        actions.into_iter().for_each(|action| self.act(action));
    }

    pub fn act(&mut self, action: Action) {
        match action {
            // Keys that are held come as `Travel` and `Hold`, the clipboard as `Paste`.
            Action::Fly(_) | Action::Fast | Action::Slow => {}
            Action::RawColors | Action::ShowTruth | Action::PasteView => {}

            Action::Orbit(_) | Action::Look(_) | Action::Pan(_) => self.scene.drag_camera(&action, self.outside.now),
            Action::Zoom(notches) => self.scene.zoom(notches, &mut self.outside),
            Action::FieldOfView(notches) => {
                let view = &self.scene.settings.view;
                self.scene.settings.view.field_of_view = scaled(view, "field_of_view", view.field_of_view, notches);
            }
            Action::FlySpeed(notches) => {
                // Six doublings either way: from an ant's pace to a jet's.
                self.scene.navigation.speed = (self.scene.navigation.speed + notches * 0.5).clamp(-6.0, 6.0);
                self.outside.note(format!("Speed × {:.2}", self.scene.navigation.speed.exp2()));
            }
            Action::Travel(way) => self.scene.travel(way, self.outside.now),
            Action::PivotHere => self.pick_under_cursor(PickPurpose::Pivot),
            Action::FrameAll => self.scene.frame_all(&self.loaded.clouds, self.outside.now),
            Action::FrameCloud(key) => self.frame_cloud(key),
            Action::ToggleMode => {
                self.scene.mode = if self.scene.mode == Mode::Orbit { Mode::Fly } else { Mode::Orbit };
                let text = if self.scene.is_flying() { "Fly: drag to look, W A S D Q E to move" } else { "Orbit" };
                self.outside.note(text);
            }
            Action::LookFrom(view) => self.scene.look_from(view, &self.loaded.clouds, self.outside.now),
            Action::LookAlong { eye, pivot } => self.scene.look_along(eye, pivot, self.outside.now),
            Action::ToggleProjection => {
                let projection = &mut self.scene.settings.view.projection;
                *projection = match projection {
                    Projection::Perspective => Projection::Orthographic,
                    Projection::Orthographic => Projection::Perspective,
                };
            }
            Action::PointAt(pixel) => self.scene.navigation.point_at(pixel, self.outside.now),
            Action::AskHover => self.scene.ask_hover(&mut self.outside),

            Action::SetParameter { key, value } => self.scene.set_parameter(&key, value, self.outside.now),
            Action::ChangeSettings(settings) => self.scene.settings = *settings,
            Action::PointSize(notches) => {
                self.scene.settings.splat.size =
                    scaled(&self.scene.settings.splat, "size", self.scene.settings.splat.size, notches);
            }
            Action::ColorBy(by) => self.scene.color_by(by, &self.loaded.clouds, &mut self.outside),
            Action::ShowClasses(classes, is_shown) => self.scene.show_classes(classes, is_shown, self.outside.now),
            Action::ToggleEdl => {
                let strength = &mut self.scene.settings.edl.strength;
                *strength = if *strength > 0.0 { 0.0 } else { scene::Edl::default().strength };
            }
            Action::Hold { raw_colors, truth } => {
                self.raw_colors = raw_colors;
                // The truth of nothing cannot be shown.
                let is_held = truth && (self.truth.is_held || !self.loaded.clouds.is_empty());
                self.truth.hold(is_held, &mut self.outside);
            }
            Action::ToggleLight => {
                let is_lit = self.scene.settings.light.by != Lighting::Colors;
                self.scene.light_by(if is_lit { Lighting::Colors } else { self.scene.lit_by }, &mut self.outside);
            }
            Action::NextLight => {
                let next = (self.scene.settings.light.by as u32 + 1) % Lighting::NAMES.len() as u32;
                self.scene.light_by(Lighting::from_index(next).unwrap_or(Lighting::Auto), &mut self.outside);
            }
            Action::LightBy(by) => self.scene.light_by(by, &mut self.outside),
            Action::Undo => self.scene.undo(&mut self.outside),
            Action::Redo => self.scene.redo(&mut self.outside),

            Action::Open(path) => drop(self.open(&[path])),
            Action::OpenDialog => self.outside.push(Effect::OpenDialog),
            Action::OpenPrompt => self.path_prompt = Some(PathPrompt::default()),
            Action::PromptForMirror => self.path_prompt = Some(PathPrompt::for_mirror()),
            Action::ChangePrompt(prompt) => self.path_prompt = Some(*prompt),
            Action::OpenPrompted(path) => self.open_prompted(path),
            Action::ClosePrompt => self.path_prompt = None,
            Action::Copy(text) => self.outside.push(Effect::Copy(text)),
            Action::CopyView => {
                self.outside.push(Effect::Copy(self.scene.view_as_text(&self.loaded)));
                self.outside.note("View copied as text");
            }
            Action::Paste(text) => self.scene.paste_view(&text, &mut self.outside),
            Action::CopyCommandLine => {
                self.outside.push(Effect::Copy(self.scene.command_line(&self.loaded)));
                self.outside.note("Command line copied");
            }
            Action::SaveScene => self.scene.save_scene(&self.loaded, &mut self.outside),
            Action::SavePicture => self.scene.save_picture(&self.frames, &self.loaded, &mut self.outside),
            Action::StopLoading => self.with_loaded(Loaded::stop_loading),
            Action::ShowCloud(key, is_visible) => {
                self.with_loaded(|loaded, beside| loaded.set_visible(key, is_visible, beside))
            }
            Action::RemoveCloud(key) => self.with_loaded(|loaded, beside| loaded.remove_cloud(key, beside)),
            Action::StopMaking(key) => self.loaded.stop_making(key),
            Action::ResumeMaking(key) => self.loaded.resume_making(key),
            Action::DeleteIndex(key) => self.with_loaded(|loaded, beside| loaded.delete_index(key, beside)),

            Action::AddMirror(shape) => self.tools.add_mirror(shape, &mut self.scene, &self.loaded, &mut self.outside),
            Action::AddSpot => self.scene.add_spot(&mut self.outside),
            Action::Select(id) => self.scene.selected = id,
            Action::ChangeObject(id, object) => self.scene.change_object(id, *object, self.outside.now),
            Action::Gizmo(handles) => {
                self.tools.handles = if self.tools.handles == handles { Handles::All } else { handles };
            }
            Action::GrabHandle(is_grabbed) => {
                if std::mem::replace(&mut self.tools.handle_is_grabbed, is_grabbed) && !is_grabbed {
                    self.scene.log_moved(&mut self.outside);
                }
            }
            Action::Duplicate => self.scene.duplicate(&mut self.outside),
            Action::Delete => {
                if let Some(id) = self.scene.selected.take() {
                    self.scene.edit_objects(self.outside.now, |objects| objects.remove(id));
                }
            }
            Action::ShowLights(are_shown) => self.tools.light_panel_is_open = are_shown,
            Action::Inspect => self.tools.toggle_inspection(&mut self.scene, &self.loaded, &mut self.outside),
            Action::InspectDistance(notches) => {
                if let Some(Inspection { pose, .. }) = &mut self.tools.inspection {
                    pose.distance = (pose.distance * f64::from(STEP.powf(notches))).clamp(0.005, 0.9);
                }
            }
            Action::InspectTilt(notches) => {
                if let Some(Inspection { pose, .. }) = &mut self.tools.inspection {
                    pose.tilt = (pose.tilt + TILT_STEP * f64::from(notches)).clamp(-3.0, 3.0);
                }
            }
            Action::ChangeInspection(pose) => {
                if let Some(held) = &mut self.tools.inspection {
                    held.pose = pose;
                }
            }
            Action::ChangeDraft(draft) => self.tools.draft = *draft,
            Action::CountPoints(key, wanted) => {
                if let Some(entry) = self.loaded.cloud(key) {
                    let (cloud, source, wanted) = (entry.cloud.clone(), entry.source.clone(), *wanted);
                    self.outside.work(Work::CountPoints { cloud, source, wanted });
                }
            }
            Action::Mark(marking) => {
                self.scene.edit_objects(self.outside.now, |objects| objects.markings.push(*marking))
            }
            Action::Unmark(marking) => {
                self.scene.edit_objects(self.outside.now, |objects| {
                    let index = objects.markings.iter().position(|known| *known == *marking);
                    index.map(|index| objects.markings.remove(index));
                });
            }
            Action::StopMarking(key) => {
                let marking = self.loaded.cloud(key).and_then(|entry| entry.marking.as_ref());
                marking.iter().for_each(|(_, progress)| progress.cancel());
            }

            Action::Pick => {
                self.scene.navigation.picks_before = self.tools.picks.clone();
                match self.tools.inspection {
                    Some(_) => self.tools.pin_inspection(&mut self.scene, &mut self.outside),
                    None => self.pick_under_cursor(PickPurpose::Select),
                }
            }
            Action::UndoPick => self.tools.picks = std::mem::take(&mut self.scene.navigation.picks_before),
            Action::PickTool => self.tools.pick_tool = !self.tools.pick_tool,
            Action::CopyPicks => {
                self.outside.push(Effect::Copy(pick::as_text(&self.tools.picks)));
                self.outside.note("Picked points copied");
            }
            Action::ClearPicks => self.tools.picks.clear(),

            Action::PinTruth => self.truth.is_pinned = !self.truth.is_pinned,
            Action::LookAtTruth(look) => self.truth.look = look,
            Action::MeasureTruth(measure) => self.truth.measure = measure,
            Action::SplitTruth(share) => self.truth.split = share,
            Action::KeepTruthReady(is_on) => self.truth.keeps_ready = is_on,
            Action::JudgeSettings(is_on) => self.truth.judges = is_on,
            Action::StopTruth => self.stop_truth(),
            Action::ToggleChart => self.tuning.is_open = !self.tuning.is_open,
            Action::ReturnTo(settings) => self.scene.return_to(*settings, &mut self.outside),
            Action::ForgetTrials => self.tuning.forget_trials(),
            Action::AddToStudy => self.add_to_study(),
            Action::AskSweep(key) => self.sweeps.ask(&key, &self.scene.settings, &mut self.outside),
            Action::ChangeSweep(range) => self.sweeps.asked = range.map(|range| *range),
            Action::StartSweep { key, values } => self.start_sweep(&key, values, &sweep::places()),
            Action::EndSweep => self.sweeps.stop(&mut self.outside),

            Action::EndTool => self.end_tool(),
            Action::ToggleInterface => self.interface_is_hidden = !self.interface_is_hidden,
            Action::TogglePanel => self.preferences.panel_is_open = !self.preferences.panel_is_open,
            Action::ToggleFullScreen => {
                self.is_full_screen = !self.is_full_screen;
                self.outside.push(Effect::SetFullScreen(self.is_full_screen));
            }
            Action::ToggleShortcuts => self.shortcuts_are_open = !self.shortcuts_are_open,
            Action::ListMessages(is_open) => self.outside.messages.list_is_open = is_open,
            Action::DismissMessage(place) => self.outside.messages.dismiss(place),
            Action::Resize(size) => self.set_view_size(size),
            Action::Quit => self.wants_to_quit = true,
        }
    }

    fn pick_under_cursor(&mut self, purpose: PickPurpose) {
        if let Some(pixel) = self.scene.cursor() {
            self.outside.render(Command::Pick { pixel, purpose });
        }
    }

    /// If what was typed names nothing, the prompt stays.
    fn open_prompted(&mut self, path: String) {
        let is_for_mirror = self.path_prompt.as_ref().is_some_and(|prompt| prompt.is_for_mirror);
        if self.open(std::slice::from_ref(&path)) {
            self.path_prompt = None;
            if is_for_mirror {
                self.loaded.await_marking(MirrorPoints::whole(path));
            }
        }
    }

    /// Looks at a cloud as at what is looked at now.
    fn frame_cloud(&mut self, key: CloudKey) {
        let figures = self.loaded.cloud(key).and_then(|entry| entry.figures.as_ref());
        let outline = figures.map(|figures| figures.outline.clone());
        if let Some(outline) = outline.filter(|outline| !outline.is_empty()) {
            let mut camera = self.scene.framed(&outline, StandardView::Isometric, &self.loaded.clouds);
            camera.eye = camera.pivot - self.scene.camera.forward() * camera.distance();
            camera.frame(&outline, self.scene.settings.view.field_of_view, self.scene.aspect());
            self.scene.jump(self.outside.now, self.scene.settings.clone(), camera);
        }
    }

    /// Esc: closes what lies on top, else ends the tool, else clears the picks.
    fn end_tool(&mut self) {
        if self.shortcuts_are_open {
            self.shortcuts_are_open = false;
        } else if self.path_prompt.is_some() {
            self.path_prompt = None;
        } else if self.tools.inspection.is_some() {
            self.tools.inspection = None;
            self.scene.navigation.camera_moved(self.outside.now);
        } else if self.tools.pick_tool {
            self.tools.pick_tool = false;
        } else if self.scene.selected.is_some() {
            self.scene.selected = None;
        } else if !self.tools.picks.is_empty() {
            self.tools.picks.clear();
        } else if self.is_full_screen {
            self.act(Action::ToggleFullScreen);
        }
    }
}

/// `value` after `notches` steps, within the range of the parameter.
fn scaled(params: &dyn param::Params, name: &str, value: f32, notches: f32) -> f32 {
    let field = params.group().fields.iter().find(|field| field.name == name);
    let range = field.map(|field| &field.kind);
    let wanted = value * STEP.powf(notches);
    match range {
        Some(param::Kind::F32 { min, max, .. }) => wanted.clamp(*min, *max),
        _ => wanted,
    }
}

#[cfg(test)]
mod tests {
    use scene::MOST_MIRRORS;

    use super::super::preferences::Preferences;
    use super::*;

    #[test]
    fn mirrors_are_added_up_to_the_number_that_a_scene_may_have() {
        let mut session = Session::new(Preferences::default());
        for _ in 0..MOST_MIRRORS + 2 {
            session.act(Action::AddMirror(Shape::Sphere));
        }
        assert_eq!(session.scene.objects.mirrors.len(), MOST_MIRRORS);
        assert!(session.outside.messages.all.last().is_some_and(|message| message.text.contains("64 mirrors")));
    }

    #[test]
    fn point_size_and_field_of_view_stop_at_their_ranges() {
        let mut session = Session::new(Preferences::default());
        for _ in 0..200 {
            session.act(Action::PointSize(1.0));
            session.act(Action::FieldOfView(-1.0));
        }
        assert_eq!((session.scene.settings.splat.size, session.scene.settings.view.field_of_view), (20.0, 1.0));
    }
}
