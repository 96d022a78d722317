//! Undo and redo of parameters and camera jumps. A slider's drag is one step: changes are gathered until nothing is held down
//! and nothing has changed for a moment.

use std::time::{Duration, Instant};

use scene::{Camera, Settings};

/// How things were before a step. `camera` is set where the step moved it at once (frame all, standard views, paste).
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    pub settings: Settings,
    pub camera: Option<Camera>,
}

#[derive(Default)]
pub struct History {
    past: Vec<Snapshot>,
    future: Vec<Snapshot>,
    /// The settings at the last step.
    settled: Option<Settings>,
    changed: Option<(Settings, Instant)>,
}

/// Quiet time that ends a step: longer than between two notches of a wheel, shorter than between two thoughts.
const QUIET: Duration = Duration::from_millis(400);
/// Steps kept: a snapshot is under a kilobyte.
const STEPS: usize = 500;

impl History {
    /// Watches the settings; called every frame of the window. `is_held`: a mouse button is down or text is being typed.
    /// Returns when to look again.
    pub fn watch(&mut self, settings: &Settings, is_held: bool) -> Option<Duration> {
        let Some(settled) = &self.settled else {
            self.settled = Some(settings.clone());
            return None;
        };
        if settled == settings {
            self.changed = None;
            return None;
        }
        match &mut self.changed {
            Some((changed, since)) if changed == settings => {
                if !is_held && since.elapsed() >= QUIET {
                    self.settle(settings);
                    return None;
                }
            }
            changed => *changed = Some((settings.clone(), Instant::now())),
        }
        Some(QUIET)
    }

    /// Ends the step under way.
    fn settle(&mut self, settings: &Settings) {
        self.changed = None;
        match &self.settled {
            Some(settled) if settled != settings => {
                let before = Snapshot { settings: settled.clone(), camera: None };
                self.push(before);
                self.settled = Some(settings.clone());
            }
            _ => {}
        }
    }

    fn push(&mut self, before: Snapshot) {
        self.past.push(before);
        self.future.clear();
        if self.past.len() > STEPS {
            self.past.remove(0);
        }
    }

    /// A jump is about to happen; `settings` may change with it.
    pub fn before_jump(&mut self, settings: &Settings, camera: Camera) {
        self.settle(settings);
        self.push(Snapshot { settings: settings.clone(), camera: Some(camera) });
    }

    /// A jump has happened.
    pub fn after_jump(&mut self, settings: &Settings) {
        self.settled = Some(settings.clone());
    }

    pub fn undo(&mut self, settings: &mut Settings, camera: &mut Camera) -> bool {
        self.settle(settings);
        let Some(step) = self.past.pop() else { return false };
        let now = self.apply(step, settings, camera);
        self.future.push(now);
        true
    }

    pub fn redo(&mut self, settings: &mut Settings, camera: &mut Camera) -> bool {
        self.settle(settings);
        let Some(step) = self.future.pop() else { return false };
        let now = self.apply(step, settings, camera);
        self.past.push(now);
        true
    }

    /// Returns how things were, in the form that leads back.
    fn apply(&mut self, step: Snapshot, settings: &mut Settings, camera: &mut Camera) -> Snapshot {
        let now = Snapshot { settings: settings.clone(), camera: step.camera.map(|_| *camera) };
        *settings = step.settings;
        if let Some(before) = step.camera {
            *camera = before;
        }
        self.settled = Some(settings.clone());
        now
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn camera(distance: f64) -> Camera {
        Camera::looking(DVec3::ZERO, DVec3::X, distance, DVec3::Z)
    }

    #[test]
    fn a_drag_is_one_step_and_comes_back_by_redo() {
        let (mut history, mut settings, mut camera) = (History::default(), Settings::default(), camera(1.0));
        history.watch(&settings, false);
        for step in 1..=20 {
            settings.splat.size = step as f32 * 0.1;
            history.watch(&settings, true);
        }
        assert!(history.undo(&mut settings, &mut camera));
        assert_eq!(settings, Settings::default());
        assert!(!history.undo(&mut settings, &mut camera));
        assert!(history.redo(&mut settings, &mut camera));
        assert_eq!(settings.splat.size, 2.0);
        assert!(!history.redo(&mut settings, &mut camera));
    }

    #[test]
    fn camera_jumps_are_undone_but_turning_by_hand_is_not() {
        let (mut history, mut settings, mut now) = (History::default(), Settings::default(), camera(1.0));
        history.watch(&settings, false);
        history.before_jump(&settings, now);
        now = camera(5.0);
        history.after_jump(&settings);
        now.orbit(0.3, 0.1);
        let turned = now;
        assert!(history.undo(&mut settings, &mut now));
        assert_eq!(now, camera(1.0));
        assert!(history.redo(&mut settings, &mut now));
        assert_eq!(now, turned);
    }

    #[test]
    fn a_parameter_undone_leaves_the_camera_where_it_is() {
        let (mut history, mut settings, mut now) = (History::default(), Settings::default(), camera(1.0));
        history.watch(&settings, false);
        settings.edl.strength = 3.0;
        history.watch(&settings, true);
        now.orbit(1.0, 0.0);
        let turned = now;
        assert!(history.undo(&mut settings, &mut now));
        assert_eq!((settings, now), (Settings::default(), turned));
    }
}
