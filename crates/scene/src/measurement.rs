//! Measurements and notes that a scene keeps. Both are anchored to points of its clouds.

use std::ops::RangeInclusive;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::Camera;

/// The most measurements of a scene: more could not be read over the picture.
pub const MOST_MEASUREMENTS: usize = 1000;

/// The most notes of a scene.
pub const MOST_NOTES: usize = 1000;

/// The most corners of a measurement.
const MOST_CORNERS: usize = 1000;
/// The most characters of a note.
const MOST_TEXT: usize = 10_000;
/// Amber, as on the screen.
const AMBER: [f32; 3] = [1.0, 0.76, 0.28];

/// What is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MeasurementKind {
    Point,
    #[default]
    Distance,
    /// The length of a line through several points.
    Polyline,
    /// How much higher the second point is than the first.
    Height,
    /// The angle at the second of three points.
    Angle,
    /// The area of a polygon.
    Area,
    /// The plane through the points of the clouds around some places.
    Plane,
    /// The circle through some points.
    Circle,
    /// The cylinder through the points of the clouds around some places.
    Cylinder,
    /// The volume between the points of the clouds over a polygon and a plane.
    Volume,
}

/// A measurement, as `[[measurements]]` of a scene file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measurement {
    #[serde(default)]
    pub name: String,
    pub kind: MeasurementKind,
    /// Whether it is drawn over the picture.
    #[serde(default = "yes")]
    pub on: bool,
    /// Red, green and blue as on the screen, 0 to 1.
    #[serde(default = "amber")]
    pub color: [f32; 3],
    /// The points on the clouds, in world units.
    pub points: Vec<DVec3>,
    /// Of a plane and a cylinder: the points of the clouds within this distance of `points` are fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<f64>,
    /// Of a volume: the height of a level plane. Without it the plane goes through `points`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level: Option<f64>,
}

/// A note, as `[[notes]]` of a scene file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Note {
    pub text: String,
    /// Whether it is drawn over the picture.
    #[serde(default = "yes")]
    pub on: bool,
    /// Red, green and blue as on the screen, 0 to 1.
    #[serde(default = "amber")]
    pub color: [f32; 3],
    /// The point that it is about, in world units.
    pub position: DVec3,
    /// The view in which it was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
}

fn yes() -> bool {
    true
}

fn amber() -> [f32; 3] {
    AMBER
}

fn problem_of_color(color: [f32; 3]) -> Option<String> {
    let is_share = |value: &f32| (0.0..=1.0).contains(value);
    (!color.iter().all(is_share)).then(|| format!("color is {color:?}, expected shares from 0 to 1"))
}

impl MeasurementKind {
    pub const ALL: [Self; 10] = [
        Self::Point,
        Self::Distance,
        Self::Polyline,
        Self::Height,
        Self::Angle,
        Self::Area,
        Self::Plane,
        Self::Circle,
        Self::Cylinder,
        Self::Volume,
    ];

    /// The name in a scene file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Point => "point",
            Self::Distance => "distance",
            Self::Polyline => "polyline",
            Self::Height => "height",
            Self::Angle => "angle",
            Self::Area => "area",
            Self::Plane => "plane",
            Self::Circle => "circle",
            Self::Cylinder => "cylinder",
            Self::Volume => "volume",
        }
    }

    /// How many points it has.
    pub fn corners(self) -> RangeInclusive<usize> {
        match self {
            Self::Point => 1..=1,
            Self::Distance | Self::Height => 2..=2,
            Self::Angle => 3..=3,
            Self::Polyline => 2..=MOST_CORNERS,
            Self::Area | Self::Circle | Self::Volume => 3..=MOST_CORNERS,
            Self::Plane | Self::Cylinder => 1..=MOST_CORNERS,
        }
    }

    /// Whether its points are the corners of a polygon.
    pub fn is_polygon(self) -> bool {
        matches!(self, Self::Area | Self::Volume)
    }

    /// Whether it is fitted to the points of the clouds around its own.
    pub fn has_reach(self) -> bool {
        matches!(self, Self::Plane | Self::Cylinder)
    }
}

impl Measurement {
    /// What makes it no measurement, in words, if anything does.
    pub(crate) fn problem(&self) -> Option<String> {
        let (kind, count) = (self.kind.name(), self.points.len());
        let (least, most) = self.kind.corners().into_inner();
        if !(least..=most).contains(&count) {
            let expected = if least == most { least.to_string() } else { format!("{least} to {most}") };
            return Some(format!("points are {count}, expected {expected} for a measurement of kind `{kind}`"));
        }
        if let Some(point) = self.points.iter().find(|point| !Camera::is_near(**point)) {
            return Some(format!("the point {point} is not finite, or too far away"));
        }
        match self.reach {
            Some(_) if !self.kind.has_reach() => return Some(format!("reach has no meaning for the kind `{kind}`")),
            Some(reach) if !(reach > 0.0 && reach <= Camera::MOST_COORDINATE) => {
                return Some(format!("reach is {reach}, expected a distance above 0"));
            }
            None if self.kind.has_reach() => {
                return Some(format!(
                    "reach is missing, expected the distance within which points are part of the {kind}"
                ));
            }
            _ => {}
        }
        match self.level {
            Some(_) if self.kind != MeasurementKind::Volume => {
                Some(format!("level has no meaning for the kind `{kind}`"))
            }
            Some(level) if !Camera::is_near(DVec3::splat(level)) => {
                Some(format!("level is {level}, expected a height"))
            }
            _ => problem_of_color(self.color),
        }
    }
}

impl Note {
    pub fn new(text: String, position: DVec3, camera: Camera) -> Self {
        Self { text, on: true, color: AMBER, position, camera: Some(camera) }
    }

    /// The first line of the note, for lists and labels.
    pub fn title(&self) -> &str {
        self.text.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or("note")
    }

    /// What makes it no note, in words, if anything does.
    pub(crate) fn problem(&self) -> Option<String> {
        if self.text.chars().count() > MOST_TEXT {
            return Some(format!("its text is longer than {MOST_TEXT} characters"));
        }
        if !Camera::is_near(self.position) {
            return Some(format!(
                "position is {}, expected a place that is finite and not too far away",
                self.position
            ));
        }
        if let Some((key, problem)) = self.camera.as_ref().and_then(Camera::problem) {
            return Some(format!("the camera's {key} is {problem}"));
        }
        problem_of_color(self.color)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneFile;

    fn refusal(text: &str) -> String {
        SceneFile::parse(text).unwrap_err().to_string()
    }

    #[test]
    fn measurements_and_notes_survive_the_text_to_the_last_digit() {
        let measurement = |kind: MeasurementKind| Measurement {
            name: format!("the {}", kind.name()),
            kind,
            on: kind != MeasurementKind::Area,
            color: [0.1, 0.2, 1.0],
            points: (0..*kind.corners().start())
                .map(|i| DVec3::new(635_619.123_456_7 + i as f64, 0.1, 1.0 / 3.0))
                .collect(),
            reach: kind.has_reach().then_some(0.1),
            level: (kind == MeasurementKind::Volume).then_some(-7.3),
        };
        let camera = Camera::from_eye(DVec3::new(1e6 + 0.1, 2.0, 3.0), DVec3::ZERO, DVec3::Z);
        let note = Note::new("Crack \"A\"\nsince 2019".into(), DVec3::new(0.1, 1e6 / 3.0, -0.2), camera);
        let file = SceneFile {
            measurements: MeasurementKind::ALL.map(measurement).to_vec(),
            notes: vec![Note { camera: None, on: false, ..note.clone() }, note],
            ..SceneFile::default()
        };
        let text = file.to_text();
        assert_eq!(SceneFile::parse(&text).unwrap(), file, "{text}");
    }

    #[test]
    fn a_measurement_needs_kind_and_points_and_a_note_text_and_place() {
        let text = "[[measurements]]\nkind = \"distance\"\npoints = [[0, 0, 0], [1, 2, 2]]\n\
                    [[notes]]\ntext = \"here\"\nposition = [1, 2, 3]\n";
        let file = SceneFile::parse(text).unwrap();
        assert!(file.measurements[0].on && file.notes[0].on && file.notes[0].camera.is_none());
    }

    #[test]
    fn what_cannot_be_measured_is_refused_by_number_and_name() {
        let first = "[[measurements]]\nkind = \"point\"\npoints = [[0, 0, 0]]\n";
        let second = |rest: &str| refusal(&format!("{first}[[measurements]]\nname = \"b\"\n{rest}\n"));
        for (rest, problem) in [
            (
                "kind = \"distance\"\npoints = [[0, 0, 0]]",
                "measurement 2 (`b`): points are 1, expected 2 for a measurement of kind `distance`",
            ),
            ("kind = \"area\"\npoints = [[0, 0, 0], [1, 0, 0]]", "points are 2, expected 3 to 1000"),
            ("kind = \"point\"\npoints = [[nan, 0, 0]]", "is not finite"),
            ("kind = \"point\"\npoints = [[1e300, 0, 0]]", "too far away"),
            ("kind = \"point\"\npoints = [[0, 0, 0]]\nreach = 1.0", "reach has no meaning for the kind `point`"),
            ("kind = \"plane\"\npoints = [[0, 0, 0]]", "reach is missing"),
            ("kind = \"cylinder\"\npoints = [[0, 0, 0]]\nreach = 0", "reach is 0, expected a distance above 0"),
            ("kind = \"point\"\npoints = [[0, 0, 0]]\nlevel = 1.0", "level has no meaning"),
            ("kind = \"point\"\npoints = [[0, 0, 0]]\ncolor = [0, 0, 2]", "color is [0.0, 0.0, 2.0]"),
            ("kind = \"points\"\npoints = [[0, 0, 0]]", "unknown variant `points`"),
            ("kind = \"point\"\npoint = [[0, 0, 0]]", "unknown field `point`"),
            ("points = [[0, 0, 0]]", "missing field `kind`"),
        ] {
            assert!(second(rest).contains(problem), "{rest}: {}", second(rest));
        }
        assert!(refusal("[[notes]]\ntext = \"a\"\nposition = [inf, 0, 0]\n").contains("note 1 (`a`): position is"));
        let far = "[[notes]]\ntext = \"a\"\nposition = [0, 0, 0]\ncamera = { eye = [nan, 0, 0], pivot = [0, 0, 0], up = [0, 0, 1] }\n";
        assert!(refusal(far).contains("note 1 (`a`): the camera's"), "{}", refusal(far));
        assert!(refusal(&first.repeat(1001)).contains("1001 measurements, expected at most 1000"));
    }
}
