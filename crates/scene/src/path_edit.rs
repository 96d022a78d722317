//! Changes of a path by hand: keyframes and keys of tracks that are added, moved and removed. What comes out is a path
//! again, if there was one before.

use crate::camera_path::MOST_TRACKS;
use crate::{Camera, CameraPath, Ease, Keyframe, Track};

/// The least time between two keyframes that are moved by hand, in seconds: a frame at 100 a second.
pub const LEAST_GAP: f64 = 0.01;

impl CameraPath {
    /// Why it is not a path that a scene file may have.
    ///
    /// # Errors
    /// In words, with the keyframe or the track.
    pub fn check(&self) -> Result<(), String> {
        let Some(odd) = self.problem() else { return Ok(()) };
        let place = odd.place.map_or(String::new(), |(list, number)| {
            format!("{} {}: ", list.strip_suffix('s').unwrap_or(list), number + 1)
        });
        Err(format!("path `{}`: {place}{}: {}", self.name, odd.key, odd.problem))
    }

    /// Adds a keyframe at a time, or replaces the one that is there. Returns its index.
    pub fn set_keyframe(&mut self, time: f64, Camera { eye, pivot, up }: Camera) -> usize {
        let time = time.max(0.0);
        let keyframe = Keyframe { time, eye, pivot, up };
        let index = match self.keyframes.iter().position(|known| (known.time - time).abs() < LEAST_GAP) {
            Some(known) => {
                self.keyframes[known] = Keyframe { time: self.keyframes[known].time, ..keyframe };
                known
            }
            None => {
                let index = self.keyframes.partition_point(|known| known.time < time);
                self.keyframes.insert(index, keyframe);
                index
            }
        };
        // The two ends of a loop are one view.
        self.close_from(if index + 1 == self.keyframes.len() { index } else { 0 });
        index
    }

    /// Moves a keyframe to a time between its neighbours, or as near as it can come.
    pub fn move_keyframe(&mut self, index: usize, time: f64) {
        if index < self.keyframes.len() {
            let times: Vec<f64> = self.keyframes.iter().map(|keyframe| keyframe.time).collect();
            self.keyframes[index].time = between(&times, index, time);
        }
    }

    /// Removes a keyframe, unless it is the only one.
    pub fn remove_keyframe(&mut self, index: usize) {
        if self.keyframes.len() > 1 && index < self.keyframes.len() {
            self.keyframes.remove(index);
            self.is_loop &= self.keyframes.len() > 1;
            self.close_from(0);
            self.leave_out_speed_at_rest();
        }
    }

    /// Lets the camera stand at a keyframe for so many seconds: all later keyframes come so much later.
    pub fn hold_keyframe(&mut self, index: usize, seconds: f64) {
        let Some(held) = self.keyframes.get(index).copied() else { return };
        self.keyframes[index + 1..].iter_mut().for_each(|later| later.time += seconds);
        self.keyframes.insert(index + 1, Keyframe { time: held.time + seconds, ..held });
    }

    /// Makes the path a loop, for which it gets a last keyframe where the first one is; or no loop.
    pub fn set_loop(&mut self, is_loop: bool) {
        self.is_loop = is_loop;
        let (Some(first), Some(last)) = (self.keyframes.first().copied(), self.keyframes.last().copied()) else {
            return;
        };
        let is_closed = self.keyframes.len() > 1 && Keyframe { time: last.time, ..first } == last;
        if is_loop && !is_closed {
            let mean = (last.time - first.time) / self.keyframes.len().saturating_sub(1).max(1) as f64;
            self.keyframes.push(Keyframe { time: last.time + mean.max(1.0), ..first });
        }
    }

    /// Sets the constant speed of the eye. It needs an eye that moves, and takes the place of the ease.
    pub fn set_speed(&mut self, speed: Option<f64>) {
        self.speed = speed.filter(|speed| *speed > 0.0 && speed.is_finite());
        if self.speed.is_some() {
            self.ease = Ease::Smooth;
        }
        self.leave_out_speed_at_rest();
    }

    pub fn set_ease(&mut self, ease: Ease) {
        self.ease = ease;
        if ease != Ease::Smooth {
            self.speed = None;
        }
    }

    fn leave_out_speed_at_rest(&mut self) {
        if !self.keyframes.windows(2).any(|ends| ends[0].eye != ends[1].eye) {
            self.speed = None;
        }
    }

    /// Gives the other end of a loop the view of the keyframe at one end.
    fn close_from(&mut self, index: usize) {
        let last = self.keyframes.len().saturating_sub(1);
        if self.is_loop && last > 0 {
            let other = if index == last { 0 } else { last };
            let from = self.keyframes[if index == last { last } else { 0 }];
            self.keyframes[other] = Keyframe { time: self.keyframes[other].time, ..from };
        }
    }

    /// Sets what a key is at a time: a parameter's, or that of an object's value. A key without a track gets one.
    ///
    /// # Errors
    /// The key has no track or takes no such value, or there are too many tracks: the path stays as it was.
    pub fn set_key(&mut self, key: &str, time: f64, value: toml::Value) -> Result<(), String> {
        let time = time.max(0.0);
        let known = self.tracks.iter().position(|track| track.key == key);
        let mut track = known.map_or_else(
            || {
                // Between names and switches there is nothing.
                let is_mixed = matches!(value, toml::Value::Float(_) | toml::Value::Integer(_) | toml::Value::Array(_));
                let ease = if is_mixed { Ease::Smooth } else { Ease::Hold };
                Track { key: key.to_owned(), times: Vec::new(), values: Vec::new(), ease }
            },
            |known| self.tracks[known].clone(),
        );
        match track.times.iter().position(|known| (known - time).abs() < LEAST_GAP) {
            Some(index) => track.values[index] = value,
            None => {
                let index = track.times.partition_point(|known| *known < time);
                track.times.insert(index, time);
                track.values.insert(index, value);
            }
        }
        if let Some((_, problem)) = track.problem() {
            return Err(problem);
        }
        match known {
            Some(known) => self.tracks[known] = track,
            None if self.tracks.len() < MOST_TRACKS => self.tracks.push(track),
            None => return Err(format!("a path has at most {MOST_TRACKS} tracks")),
        }
        Ok(())
    }

    /// Moves a key of a track to a time between its neighbours, or as near as it can come.
    pub fn move_key(&mut self, track: usize, index: usize, time: f64) {
        if let Some(track) = self.tracks.get_mut(track).filter(|track| index < track.times.len()) {
            track.times[index] = between(&track.times, index, time);
        }
    }

    /// Removes a key of a track, and the track with its last key.
    pub fn remove_key(&mut self, track: usize, index: usize) {
        let Some(keys) = self.tracks.get_mut(track).filter(|track| index < track.times.len()) else { return };
        keys.times.remove(index);
        keys.values.remove(index);
        if keys.times.is_empty() {
            self.tracks.remove(track);
        }
    }
}

/// The time nearest to `time` between the neighbours of an index.
fn between(times: &[f64], index: usize, time: f64) -> f64 {
    let low = if index > 0 { times[index - 1] + LEAST_GAP } else { 0.0 };
    let high = times.get(index + 1).map_or(f64::MAX, |next| next - LEAST_GAP);
    // Neighbours that a file has closer together leave no room.
    if low <= high && time.is_finite() { time.clamp(low, high) } else { times[index] }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::Motion;

    fn camera(x: f64) -> Camera {
        Camera::from_eye(DVec3::new(x, -5.0, 1.0), DVec3::new(x, 0.0, 1.0), DVec3::Z)
    }

    fn path(times: &[f64]) -> CameraPath {
        let mut path = CameraPath { name: "tour".into(), ..CameraPath::default() };
        for time in times {
            path.set_keyframe(*time, camera(*time));
        }
        path
    }

    #[test]
    fn whatever_is_done_leaves_a_path() {
        let mut path = path(&[0.0, 3.0, 1.0]);
        let mut step = 0_u32;
        let mut next = move || {
            step = step.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (step >> 16) as usize
        };
        for _ in 0..3000 {
            let (index, time) = (next() % (path.keyframes.len() + 1), (next() % 900) as f64 * 0.01 - 1.0);
            match next() % 10 {
                0 => drop(path.set_keyframe(time, camera((next() % 4) as f64))),
                1 => path.move_keyframe(index, time),
                2 | 3 => path.remove_keyframe(index),
                4 if path.keyframes.len() < 12 => path.hold_keyframe(index, 0.5),
                5 => path.set_loop(next() % 2 == 0),
                6 => path.set_speed((next() % 2 == 0).then_some(time)),
                7 => path.set_ease([Ease::Smooth, Ease::Linear, Ease::Hold][next() % 3]),
                8 => path.set_key("sun.elevation", time, toml::Value::Float(time.abs())).unwrap(),
                _ => {
                    path.move_key(0, index, time);
                    path.remove_key(next() % 2, next() % 3);
                }
            }
            assert_eq!(path.check(), Ok(()), "{path:?}");
        }
    }

    #[test]
    fn keyframes_are_kept_in_order_and_neighbours_stay_apart() {
        let mut path = path(&[0.0, 2.0, 4.0]);
        path.move_keyframe(1, 9.0);
        assert_eq!(path.keyframes[1].time, 4.0 - LEAST_GAP);
        path.move_keyframe(1, 1.0);
        assert_eq!(path.set_keyframe(1.004, camera(7.0)), 1);
        assert_eq!((path.keyframes.len(), path.keyframes[1].time, path.keyframes[1].eye.x), (3, 1.0, 7.0));
        path.hold_keyframe(1, 2.0);
        assert_eq!(path.keyframes.iter().map(|keyframe| keyframe.time).collect::<Vec<_>>(), [0.0, 1.0, 3.0, 6.0]);
        let motion = Motion::new(&path).unwrap();
        assert!(motion.camera(2.0).eye.distance(motion.camera(1.0).eye) < 1e-9, "it stands");
    }

    #[test]
    fn a_loop_is_closed_and_stays_so_when_one_end_changes() {
        let mut path = path(&[0.0, 2.0, 4.0]);
        path.set_loop(true);
        assert_eq!((path.keyframes.len(), path.keyframes[3].time, path.keyframes[3].eye.x), (4, 6.0, 0.0));
        path.set_keyframe(0.0, camera(1.5));
        assert_eq!(path.keyframes[3].eye.x, 1.5);
        path.set_keyframe(6.0, camera(2.5));
        assert_eq!((path.keyframes[0].eye.x, path.check()), (2.5, Ok(())));
    }

    #[test]
    fn a_key_that_cannot_be_is_refused_and_changes_nothing() {
        let mut path = path(&[0.0]);
        path.set_key("reflection.method", 1.0, toml::Value::String("sscr".into())).unwrap();
        assert_eq!(path.tracks[0].ease, Ease::Hold);
        let before = path.clone();
        assert!(path.set_key("sun.elevatio", 0.0, toml::Value::Float(1.0)).is_err());
        assert!(path.set_key("reflection.method", 2.0, toml::Value::String("mirror".into())).is_err());
        assert!(path.set_key("scene.points", 2.0, toml::Value::Integer(5000)).unwrap_err().contains("done once"));
        assert_eq!(path, before);
        path.remove_key(0, 0);
        assert!(path.tracks.is_empty());
    }
}
