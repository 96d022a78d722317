//! The timeline: one path of the scene at a time is edited, shown at any time of it, and played. It has no paths of its
//! own: it changes those that scene files keep.

use std::time::Instant;

use scene::{CameraPath, Motion, WIPE, WipeState, line_value};
use serde_json::json;

use crate::shared::language::text;
use crate::viewer::filming::wiping::{View, Wiping};
use crate::viewer::objects::numbered;
use crate::viewer::requests::action::Film;
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::Outside;
use crate::viewer::scene::Scene;

#[derive(Default)]
pub struct Timeline {
    pub is_open: bool,
    /// The time of the path that is shown, in seconds.
    pub time: f64,
    /// Whether playing begins again at the end.
    pub repeats: bool,
    /// How high above a measurement new paths fly, in world units; at the height of a person's eyes if none was chosen.
    pub height: Option<f64>,
    /// The name of the path that is edited; the first one if no path has the name.
    chosen: String,
    /// Whether the picture follows the path.
    is_followed: bool,
    /// When playing began, and the time of the path then.
    playing: Option<(Instant, f64)>,
    /// The path and the time that the picture shows, and the state that the window draws of a wipe.
    posed: Option<(CameraPath, f64, usize)>,
    pub wiping: Wiping,
}

/// The most paths of a scene file.
const MOST_PATHS: usize = 64;

impl Timeline {
    /// The path that is edited.
    pub fn path<'a>(&self, scene: &'a Scene) -> Option<&'a CameraPath> {
        scene.objects.paths.get(self.index(scene))
    }

    fn index(&self, scene: &Scene) -> usize {
        scene.objects.paths.iter().position(|path| path.name == self.chosen).unwrap_or(0)
    }

    pub fn is_playing(&self) -> bool {
        self.playing.is_some()
    }

    /// Whether the picture shows the path at the time.
    pub fn is_followed(&self) -> bool {
        self.is_followed
    }

    pub fn pause(&mut self) {
        self.playing = None;
    }

    /// From now on the picture does not follow the path.
    pub fn leave(&mut self) {
        (self.playing, self.is_followed, self.posed) = (None, false, None);
        self.wiping.end();
    }

    /// Adds a path, and shows it.
    pub fn add(&mut self, path: CameraPath, scene: &mut Scene, outside: &mut Outside) {
        if scene.objects.paths.len() >= MOST_PATHS {
            return outside.note(text!("There are {MOST_PATHS} paths, and no room for more", MOST_PATHS));
        }
        outside.log(json!({ "event": "path", "name": path.name }));
        self.leave();
        (self.chosen, self.time, self.is_open) = (path.name.clone(), 0.0, true);
        scene.edit_objects(outside.now, |objects| objects.paths.push(path));
    }

    pub fn act(&mut self, film: Film, scene: &mut Scene, outside: &mut Outside) {
        let index = self.index(scene);
        match film {
            Film::Toggle => {
                self.is_open = !self.is_open;
                if !self.is_open {
                    self.leave();
                    scene.unpose();
                }
            }
            Film::Choose(name) => {
                self.leave();
                scene.unpose();
                (self.chosen, self.time) = (name, 0.0);
            }
            Film::Change(changed) => {
                let others = scene.objects.paths.iter().enumerate().filter(|(other, _)| *other != index);
                let name = numbered(&changed.name, others.map(|(_, path)| path.name.as_str()));
                let changed = CameraPath { name, ..*changed };
                match (changed.check(), scene.objects.paths.get_mut(index)) {
                    (Ok(()), Some(path)) => {
                        self.chosen = changed.name.clone();
                        *path = changed;
                    }
                    (Err(problem), _) => outside.note(problem),
                    (Ok(()), None) => {}
                }
            }
            Film::Remove => {
                self.leave();
                if index < scene.objects.paths.len() {
                    scene.edit_objects(outside.now, |objects| drop(objects.paths.remove(index)));
                }
            }
            Film::Key(key) => {
                let now = scene.value_now(&key);
                let Some(path) = scene.objects.paths.get_mut(index) else { return };
                let value = if key == WIPE { Ok(line_value(&path.lines(self.time))) } else { now };
                if let Err(problem) = value.and_then(|value| path.set_key(&key, self.time, value)) {
                    outside.note(problem);
                }
            }
            Film::Scrub(time) => {
                self.playing = None;
                self.time = time.max(0.0);
                self.is_followed = true;
            }
            Film::Play if !self.is_open => {}
            Film::Play => {
                let Some(path) = self.path(scene) else { return outside.note(text!("There is no path to play")) };
                let start = if self.time < path.duration() { self.time } else { 0.0 };
                self.playing = if self.playing.is_some() { None } else { Some((outside.now, start)) };
                self.is_followed = true;
                outside.log(json!({ "event": "play", "path": path.name, "plays": self.is_playing() }));
            }
            Film::Repeat(repeats) => self.repeats = repeats,
            Film::FlyAt(height) => self.height = Some(height),
            // Other actions are not the timeline's.
            Film::Keep(_)
            | Film::FlyToDigit(_)
            | Film::FlyTo(_)
            | Film::ChangeBookmark(..)
            | Film::RemoveBookmark(_)
            | Film::Add(_)
            | Film::AskRecording
            | Film::ChangeRecording(_)
            | Film::StartRecording
            | Film::StopRecording
            | Film::Capture
            | Film::CaptureAs(_) => {}
        }
    }

    /// The path and the time that the picture shows, while it follows the path.
    pub fn shown(&self) -> Option<(&CameraPath, f64)> {
        self.posed.as_ref().map(|(path, time, _)| (path, *time))
    }

    /// Moves the time while the path plays, and shows the path at its time. Returns whether it plays on.
    pub fn step(&mut self, scene: &mut Scene, outside: &mut Outside) -> bool {
        if !self.is_followed {
            return false;
        }
        let Some(path) = self.path(scene).cloned() else {
            self.leave();
            scene.unpose();
            return false;
        };
        if let Some((since, start)) = self.playing {
            let passed = start + outside.now.saturating_duration_since(since).as_secs_f64();
            let end = path.duration();
            self.time = if passed < end {
                passed
            } else if self.repeats && end > 0.0 {
                passed % end
            } else {
                self.playing = None;
                end
            };
        }
        self.wiping.choose(scene, &path, self.time);
        let turn = self.wiping.turn;
        let is_shown = scene.posed.is_some()
            && self
                .posed
                .as_ref()
                .is_some_and(|(known, time, state)| *time == self.time && *state == turn && *known == path);
        if !is_shown {
            let before = View::of(scene, &WipeState::default());
            if let Err((track, problem)) = scene.pose(&path, self.time) {
                outside.say(
                    Level::Error,
                    text!("path `{path}`, track {track}: {problem}", path = path.name, track = track + 1, problem),
                );
                self.leave();
                return false;
            }
            if let Some(motion) = Motion::new(&path) {
                scene.camera = motion.camera(self.time);
            }
            // A line that moves, or another state, leaves all else as it was.
            if path.states.is_empty() || View::of(scene, &WipeState::default()) != before {
                scene.camera_moved_by_hand(outside.now);
            }
            if let Some(Err(problem)) = path.states.get(turn).map(|state| scene.show_state(state)) {
                outside.say(
                    Level::Error,
                    text!("path `{path}`, state {turn}: {problem}", path = path.name, turn = turn + 1, problem),
                );
            }
            self.posed = Some((path, self.time, turn));
        }
        if let Some((path, ..)) = &self.posed {
            self.wiping.show(scene, path);
        }
        self.is_playing()
    }
}
