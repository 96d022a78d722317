//! The scene as the tracks of a path have it at a time, for recordings and for the timeline. Its own values are kept
//! meanwhile: undo, scene files and edits know only those.

use std::time::{Duration, Instant};

use scene::{Bookmark, CameraPath, Caption, Ease, Handle, Track, WipeState};

use crate::shared::language::text;
use crate::viewer::objects::posed::Posed;
use crate::viewer::requests::outside::Outside;
use crate::viewer::scene::Scene;

impl Scene {
    /// Sets parameters and objects as the tracks of a path have them at a time of it, in seconds, until `unpose`, and
    /// shows the captions of that time.
    ///
    /// # Errors
    /// A track names nothing in the scene, or gives it a value that it cannot have: with the number of the track. The
    /// scene has its own values then.
    pub fn pose(&mut self, path: &CameraPath, time: f64) -> Result<(), (usize, String)> {
        self.unpose();
        let (settings, objects, of_path) = (self.settings.clone(), self.objects.clone(), self.settings.clone());
        let (touched, captions) = (Vec::new(), Vec::new());
        self.posed = Some(Posed { settings, objects, touched, captions, wipe: None, is_wiped: false, of_path });
        for (index, track) in path.tracks.iter().enumerate() {
            if let Err(problem) = self.pose_one(track, time) {
                self.unpose();
                return Err((index, problem));
            }
        }
        let shown = path.captions.iter().filter(|caption| caption.is_shown(time));
        let captions: Vec<Caption> = shown.map(|caption| caption.with_values(&self.settings)).collect();
        if let Some(posed) = &mut self.posed {
            (posed.captions, posed.wipe) = (captions, path.wipe_marks(time));
            posed.of_path.clone_from(&self.settings);
        }
        Ok(())
    }

    fn pose_one(&mut self, track: &Track, time: f64) -> Result<(), String> {
        match track.handle()? {
            Handle::Parameter(key) => {
                track.set_parameter(key, &mut self.settings, time).map_err(|error| error.to_string())
            }
            // Which states the lines divide is no value of the scene: `show_state` sets those.
            Handle::Wipe => Ok(()),
            Handle::Object { kind, name, value } => {
                let (id, mut object) = self.objects.named(kind, name)?;
                track.set_object(value, &mut object, time);
                if let Some(problem) = object.problem() {
                    return Err(format!("{kind} `{name}` at {time} s: {problem}"));
                }
                self.objects.set(id, object);
                self.posed.iter_mut().for_each(|posed| posed.touched.push(id));
                Ok(())
            }
        }
    }

    /// Sets the parameters of a state of a wipe, while the scene is as a path has it.
    ///
    /// # Errors
    /// A parameter takes no such value.
    pub fn show_state(&mut self, state: &WipeState) -> Result<(), param::Error> {
        if let Some(posed) = &mut self.posed {
            posed.is_wiped = true;
            self.settings.clone_from(&posed.of_path);
            state.apply(&mut self.settings)?;
        }
        Ok(())
    }

    /// Gives the scene its own values back.
    pub fn unpose(&mut self) {
        if let Some(posed) = self.posed.take() {
            posed.touched.iter().for_each(|id| self.objects.restore(*id, &posed.objects));
            self.settings = posed.settings;
        }
    }

    /// Notes for undo what has changed of the scene's own values; the arguments are those of `History::watch`.
    pub fn watch(&mut self, is_held: bool, now: Instant) -> Option<Duration> {
        let Some(posed) = &self.posed else {
            return self.history.watch(&self.settings, &self.objects, is_held, now);
        };
        let mut objects = self.objects.clone();
        posed.touched.iter().for_each(|id| objects.restore(*id, &posed.objects));
        self.history.watch(&posed.settings, &objects, is_held, now)
    }

    /// What a key of a track is now.
    pub fn value_now(&self, key: &str) -> Result<toml::Value, String> {
        let track = Track { key: key.to_owned(), times: Vec::new(), values: Vec::new(), ease: Ease::Smooth };
        let value = match track.handle()? {
            Handle::Parameter(key) => Track::value_of_parameter(key, &self.settings),
            Handle::Wipe => None,
            Handle::Object { kind, name, value } => {
                let (_, object) = self.objects.named(kind, name)?;
                Track::value_of_object(value, &object)
            }
        };
        value.ok_or_else(|| format!("{key}: there is no value that it could keep"))
    }

    /// Tells that fewer tracks are left in the paths than before an object was removed.
    pub fn tell_lost_tracks(&self, before: usize, outside: &mut Outside) {
        let lost = before.saturating_sub(self.objects.track_count());
        if lost > 0 {
            outside.note(text!("Tracks of paths that are removed with it: {lost}", lost));
        }
    }

    /// Adds bookmarks and paths of scene files. A path replaces the one of the same name.
    pub fn bring_paths(&mut self, bookmarks: Vec<Bookmark>, paths: Vec<CameraPath>) {
        if bookmarks.is_empty() && paths.is_empty() {
            return;
        }
        self.rewrite_objects(|objects| {
            let new = bookmarks.iter().filter(|bookmark| !objects.bookmarks.contains(bookmark)).cloned();
            let new: Vec<Bookmark> = new.collect();
            objects.bookmarks.extend(new);
            objects.paths.retain(|known| !paths.iter().any(|path| path.name == known.name));
            objects.paths.extend(paths.iter().cloned());
        });
    }
}
