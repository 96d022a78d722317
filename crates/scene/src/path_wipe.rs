//! Where the lines of a wipe stand along a path, and what that makes of its pictures.

use std::ops::Range;

use crate::track::{WIPE, numbers};
use crate::{CameraPath, WipeMarks, WipeState};

impl CameraPath {
    /// The lines between its states at a time in seconds: shares of the picture's width, none to the left of the one
    /// before it. Without a track the states have equal parts. Empty for a path without states.
    pub fn lines(&self, time: f64) -> Vec<f64> {
        let count = self.states.len().saturating_sub(1);
        let track = self.tracks.iter().rfind(|track| track.key == WIPE);
        let given = track.and_then(|track| numbers(&track.value(time))).filter(|given| given.len() == count);
        let mut lines = given.unwrap_or_else(|| (1..=count).map(|line| line as f64 / (count + 1) as f64).collect());
        let mut least = 0.0_f64;
        for line in &mut lines {
            least = line.clamp(least, 1.0);
            *line = least;
        }
        lines
    }

    /// Which columns of a picture show which state at a time in seconds: the number of the state with its columns,
    /// from left to right, without states that have none. Empty for a path without states.
    pub fn parts(&self, time: f64, width: u32) -> Vec<(usize, Range<u32>)> {
        let lines = self.lines(time).into_iter().map(|line| (line * f64::from(width)).round() as u32);
        let edges: Vec<u32> = [0].into_iter().chain(lines).chain([width]).collect();
        let parts = edges.windows(2).map(|ends| ends[0]..ends[1]).take(self.states.len()).enumerate();
        parts.filter(|(_, columns)| !columns.is_empty()).collect()
    }

    /// What is drawn over its wipe at a time in seconds; nothing if no state has a name.
    pub fn wipe_marks(&self, time: f64) -> Option<WipeMarks> {
        let names: Vec<String> = self.states.iter().map(|state| state.name.trim().to_owned()).collect();
        names.iter().any(|name| !name.is_empty()).then(|| WipeMarks { lines: self.lines(time), names })
    }

    /// Gives the path other states. The lines between those that stay stand where they stood; a new state begins at
    /// the right edge. Without states there is no track of lines.
    pub fn set_states(&mut self, states: Vec<WipeState>) {
        let count = states.len().saturating_sub(1);
        self.states = states;
        if count == 0 {
            self.tracks.retain(|track| track.key != WIPE);
        }
        for track in self.tracks.iter_mut().filter(|track| track.key == WIPE) {
            for value in &mut track.values {
                let mut lines = numbers(value).unwrap_or_default();
                lines.resize(count, 1.0);
                *value = line_value(&lines);
            }
        }
    }
}

/// Places of lines as a value of their track.
pub fn line_value(lines: &[f64]) -> toml::Value {
    match lines {
        [line] => toml::Value::Float(*line),
        lines => toml::Value::Array(lines.iter().copied().map(toml::Value::Float).collect()),
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::{Ease, Keyframe, Method, RAY_TRACE, SceneFile, Settings, Track};

    fn path(states: &[&str], lines: Option<(&[f64], &str)>) -> CameraPath {
        let keyframe = Keyframe { time: 0.0, eye: DVec3::Y, pivot: DVec3::ZERO, up: DVec3::Z };
        let track = |(times, values): (&[f64], &str)| {
            let values = format!("a = {values}").parse::<toml::Table>().unwrap()["a"].as_array().unwrap().clone();
            Track { key: WIPE.into(), times: times.to_vec(), values, ease: Ease::Linear }
        };
        CameraPath {
            name: "wipe".into(),
            keyframes: vec![keyframe],
            states: states.iter().map(|method| WipeState::of_method(method)).collect(),
            tracks: lines.map(track).into_iter().collect(),
            ..CameraPath::default()
        }
    }

    #[test]
    fn parts_cover_the_picture_once_from_left_to_right() {
        let two = path(&["sscr", "ray_trace"], Some((&[0.0, 4.0], "[1, 0.0]")));
        assert_eq!(two.check(), Ok(()));
        assert_eq!(two.duration(), 4.0);
        assert_eq!(two.parts(0.0, 100), [(0, 0..100)], "the left state alone");
        assert_eq!(two.parts(1.0, 100), [(0, 0..75), (1, 75..100)]);
        assert_eq!(two.parts(4.0, 100), [(1, 0..100)], "the right state alone");
        assert_eq!(path(&["sscr", "none"], None).parts(9.0, 101), [(0, 0..51), (1, 51..101)], "halves without a track");
        assert!(path(&[], None).parts(0.0, 100).is_empty());
        let three = path(&["sscr", "none", "ray_trace"], Some((&[0.0, 1.0], "[[0.2, 0.6], [1.0, 0.5]]")));
        assert_eq!(three.check(), Ok(()));
        assert_eq!(three.parts(0.0, 10), [(0, 0..2), (1, 2..6), (2, 6..10)]);
        assert_eq!(three.parts(1.0, 10), [(0, 0..10)], "no line passes the one to its left");
        for step in 0..=50 {
            let mut end = 0;
            for (_, columns) in three.parts(f64::from(step) / 50.0, 97) {
                assert!(columns.start == end && columns.end > end);
                end = columns.end;
            }
            assert_eq!(end, 97);
        }
    }

    #[test]
    fn a_state_changes_what_it_names_and_nothing_else() {
        let base = Settings::default();
        let mut settings = base.clone();
        WipeState::default().apply(&mut settings).unwrap();
        assert_eq!(settings, base);
        let parameters = [("gi.vpls".to_owned(), 16.into()), ("view.background".to_owned(), "#102030".into())];
        let state = WipeState { parameters: parameters.into(), ..WipeState::of_method("sscr") };
        assert_eq!(state.problem(), None);
        state.apply(&mut settings).unwrap();
        assert_eq!((settings.gi.vpls, settings.reflection.method), (16, Method::Sscr));
        // A method is that of all mirrors, also of those that have their own.
        assert!(!settings.reflection.own_methods);
        assert_eq!(settings.differing().len(), 4);
        let traced = WipeState::of_method(RAY_TRACE);
        traced.apply(&mut settings).unwrap();
        assert!(traced.is_traced() && settings.reflection.method == Method::None);
    }

    #[test]
    fn states_survive_the_text_of_their_scene_and_odd_ones_are_refused_by_line() {
        let mut wipe = path(&["sscr", "ray_trace"], Some((&[0.0, 4.0], "[1.0, 0.0]")));
        wipe.states[0].parameters = [("gi.vpls".to_owned(), 16.into())].into();
        let file = SceneFile { paths: vec![wipe], ..SceneFile::default() };
        let text = file.to_text();
        assert_eq!(SceneFile::parse(&text).unwrap(), file);
        let refused = |from: &str, to: &str| {
            assert!(text.contains(from), "{text}");
            SceneFile::parse(&text.replacen(from, to, 1)).unwrap_err().to_string()
        };
        let method = refused("method = \"ray_trace\"", "method = \"ray_trac\"");
        assert!(method.contains("state 2: method: `ray_trac` is unknown; available: ") && method.contains("line "));
        assert!(method.contains("sscr_hierarchical") && method.contains(", ray_trace"), "{method}");
        assert!(refused("\"gi.vpls\" = 16", "\"gi.vplss\" = 16").contains("state 1: parameters: gi.vplss: no such"));
        assert!(refused("\"gi.vpls\" = 16", "\"gi.vpls\" = -1").contains("state 1: parameters: gi.vpls"));
        assert!(
            refused("\"gi.vpls\" = 16", "\"scene.points\" = 2000").contains("`scene.points` says how points are read")
        );
        assert!(refused("\"gi.vpls\" = 16", "\"reflection.method\" = \"none\"").contains("stands in `method`"));
        assert!(refused("name = \"sscr\"", "name = \"two\\nlines\"").contains("state 1: name: expected one line"));
        assert!(
            refused("values = [1.0, 0.0]", "values = [1.5, 0.0]").contains("track 1: values: 1.5, expected shares")
        );
        let lists = refused("values = [1.0, 0.0]", "values = [[0.5, 1.0], [0.0, 0.0]]");
        assert!(lists.contains("track 1: values: [0.5, 1.0], expected a number each for 2 states"), "{lists}");
        assert!(refused("values = [1.0, 0.0]", "values = [true, 0.0]").contains("track 1: values: true"));
        let none = SceneFile { paths: vec![path(&[], Some((&[0.0], "[0.5]")))], ..SceneFile::default() };
        let none = SceneFile::parse(&none.to_text()).unwrap_err().to_string();
        assert!(none.contains("track 1: key: `wipe` divides states, and the path has none"), "{none}");
        for states in [&["sscr"][..], &["sscr"; 4]] {
            let odd = SceneFile { paths: vec![path(states, None)], ..SceneFile::default() };
            let odd = SceneFile::parse(&odd.to_text()).unwrap_err().to_string();
            assert!(odd.contains(&format!("states: {}, expected two or three", states.len())), "{odd}");
        }
    }

    #[test]
    fn states_that_come_and_go_leave_a_path() {
        let mut wipe = path(&["sscr", "none"], Some((&[0.0, 4.0], "[1.0, 0.25]")));
        let states = |names: &[&str]| names.iter().map(|name| WipeState::of_method(name)).collect::<Vec<_>>();
        wipe.set_states(states(&["sscr", "none", "ray_trace"]));
        assert_eq!((wipe.check(), wipe.lines(4.0)), (Ok(()), vec![0.25, 1.0]));
        wipe.set_states(states(&["sscr", "ray_trace"]));
        assert_eq!((wipe.check(), wipe.lines(4.0)), (Ok(()), vec![0.25]));
        wipe.set_states(Vec::new());
        assert_eq!((wipe.check(), wipe.tracks.len()), (Ok(()), 0));
    }
}
