//! Captions: text over the pictures of a path.

use serde::{Deserialize, Serialize};

use crate::{Settings, Track};

/// The most captions of a path.
pub(crate) const MOST_CAPTIONS: usize = 256;
/// The most characters of a caption: a page of text.
const MOST_LETTERS: usize = 2000;
/// The height of the text that is usual for films, as a share of the picture's height.
const USUAL_SIZE: f32 = 0.045;
/// How many digits of a number are shown: more cannot be read while it changes.
const DIGITS: i32 = 4;

/// A text over the pictures of a path, as `[[paths.captions]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Caption {
    /// One or more lines. The key of a parameter in braces stands for its value: `{reflection.method}`.
    pub text: String,
    /// When it appears, in seconds from the beginning of the path.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub start: f64,
    /// When it is gone; it stays until the end of the path if it is `None`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<f64>,
    #[serde(default, skip_serializing_if = "Place::is_bottom")]
    pub place: Place,
    /// The height of the text as a share of the picture's height.
    #[serde(default = "usual_size", skip_serializing_if = "is_usual_size")]
    pub size: f32,
}

/// Where in the picture a caption is. Several in one place stand one above the other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    Top,
    Middle,
    #[default]
    Bottom,
}

impl Place {
    fn is_bottom(&self) -> bool {
        *self == Self::Bottom
    }
}

fn is_zero(time: &f64) -> bool {
    *time == 0.0
}

fn usual_size() -> f32 {
    USUAL_SIZE
}

fn is_usual_size(size: &f32) -> bool {
    *size == USUAL_SIZE
}

impl Caption {
    pub fn new(text: String, start: f64, end: Option<f64>) -> Self {
        Self { text, start, end, place: Place::default(), size: USUAL_SIZE }
    }

    /// Whether it is shown at a time of its path, in seconds.
    pub fn is_shown(&self, time: f64) -> bool {
        self.start <= time && self.end.is_none_or(|end| time < end)
    }

    /// The caption with the values of parameters in its text. What stands in braces and is no parameter stays.
    pub fn with_values(&self, settings: &Settings) -> Self {
        let of = |piece: &Piece<'_>| match piece {
            Piece::Plain(text) => (*text).to_owned(),
            Piece::Braced(key) => value_text(key, settings).unwrap_or_else(|| format!("{{{key}}}")),
        };
        Self { text: pieces(&self.text).iter().map(of).collect(), ..self.clone() }
    }

    /// What stands in braces and is no parameter.
    pub fn unknown_keys(&self) -> Vec<&str> {
        let settings = Settings::default();
        let braced = |piece| if let Piece::Braced(key) = piece { Some(key) } else { None };
        let keys = pieces(&self.text).into_iter().filter_map(braced);
        keys.filter(|key| value_text(key, &settings).is_none()).collect()
    }

    /// Why it is not valid, with the key of what is wrong.
    pub(crate) fn problem(&self) -> Option<(&'static str, String)> {
        let letters = self.text.chars().count();
        if letters > MOST_LETTERS {
            return Some(("text", format!("{letters} characters, expected at most {MOST_LETTERS}")));
        }
        // Comparisons that a NaN fails.
        if !(self.start >= 0.0 && self.start.is_finite()) {
            return Some(("start", format!("{}, expected seconds from 0 on", self.start)));
        }
        if let Some(end) = self.end.filter(|end| !(*end > self.start && end.is_finite())) {
            return Some(("end", format!("{end}, expected more than the start, {}", self.start)));
        }
        // Larger letters leave no room for a word.
        let is_fine = (0.01..=0.1).contains(&self.size);
        (!is_fine)
            .then(|| ("size", format!("{}, expected a share of the picture's height from 0.01 to 0.1", self.size)))
    }
}

#[derive(Clone, Copy)]
enum Piece<'a> {
    Plain(&'a str),
    Braced(&'a str),
}

/// The text in pieces: between braces, and not.
fn pieces(text: &str) -> Vec<Piece<'_>> {
    let (mut pieces, mut rest) = (Vec::new(), text);
    while let Some((before, after)) = rest.split_once('{') {
        let Some((key, left)) = after.split_once('}') else { break };
        pieces.extend([Piece::Plain(before), Piece::Braced(key)]);
        rest = left;
    }
    pieces.push(Piece::Plain(rest));
    pieces
}

/// What a parameter is, for people; `None` if there is none of this key.
fn value_text(key: &str, settings: &Settings) -> Option<String> {
    Some(match Track::value_of_parameter(key, settings)? {
        toml::Value::String(text) => text,
        toml::Value::Float(number) => rounded(number),
        other => other.to_string(),
    })
}

/// A number with few digits.
fn rounded(number: f64) -> String {
    let before_point = if number == 0.0 { 1 } else { number.abs().log10().floor() as i32 + 1 };
    let text = format!("{number:.*}", (DIGITS - before_point).clamp(0, 9) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CameraPath, Keyframe, SceneFile};

    #[test]
    fn parameters_in_braces_become_their_values_and_all_else_stays() {
        let mut settings = Settings::default();
        settings.set_text("reflection.method", "sscr").unwrap();
        (settings.sun.elevation, settings.gi.vpls) = (12.345_678, 64);
        let told = |text: &str| Caption::new(text.into(), 0.0, None).with_values(&settings).text;
        assert_eq!(told("by {reflection.method}, the sun at {sun.elevation}°"), "by sscr, the sun at 12.35°");
        assert_eq!(told("{gi.vpls} lights, {splat.back_faces}"), "64 lights, true");
        assert_eq!(told("a {set} of }{ {reflection.method"), "a {set} of }{ {reflection.method");
        let unknown = Caption::new("{sun.elevatio} {gi.vpls} {}".into(), 0.0, None);
        assert_eq!(unknown.unknown_keys(), ["sun.elevatio", ""]);
        let numbers = [(0.0, "0"), (0.000_123_456, "0.0001235"), (-2.5, "-2.5"), (123_456.7, "123457"), (9.9999, "10")];
        numbers.into_iter().for_each(|(number, text)| assert_eq!(rounded(number), text));
    }

    #[test]
    fn a_caption_is_shown_from_its_start_until_before_its_end() {
        let caption = Caption::new("a".into(), 1.0, Some(2.0));
        assert_eq!([0.999, 1.0, 1.999, 2.0].map(|time| caption.is_shown(time)), [false, true, true, false]);
        assert!(Caption::new("a".into(), 0.0, None).is_shown(1e6));
    }

    #[test]
    fn captions_survive_the_text_of_their_scene_and_impossible_ones_are_refused_by_line() {
        let keyframe = Keyframe { time: 0.0, eye: glam::DVec3::Y, pivot: glam::DVec3::ZERO, up: glam::DVec3::Z };
        let odd = Caption { place: Place::Top, size: 0.07, ..Caption::new("two\nlines".into(), 1.0 / 3.0, Some(0.5)) };
        let captions = vec![Caption::new("{sun.elevation}".into(), 0.0, None), odd];
        let path = CameraPath { name: "tour".into(), keyframes: vec![keyframe], captions, ..CameraPath::default() };
        let file = SceneFile { paths: vec![path], ..SceneFile::default() };
        let text = file.to_text();
        assert_eq!(SceneFile::parse(&text).unwrap(), file);
        let refused = |from: &str, to: &str| {
            assert!(text.contains(from), "{text}");
            SceneFile::parse(&text.replace(from, to)).unwrap_err().to_string()
        };
        let end = refused("end = 0.5", "end = 0.25");
        assert!(end.contains("caption 2: end: 0.25, expected more than the start") && end.contains("line "), "{end}");
        assert!(refused("size = 0.07", "size = 0.2").contains("caption 2: size: 0.2, expected a share"));
        assert!(refused("start = 0.3", "start = -0.3").contains("caption 2: start: -0.3"));
        assert!(refused("place = \"top\"", "place = \"left\"").contains("unknown variant `left`"));
    }
}
