//! Units of lengths and angles, and those of the coordinates of a cloud.

use std::fmt;

/// A unit of lengths or angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unit {
    Metre,
    /// The international foot of 0.3048 m.
    Foot,
    /// The US survey foot of 1200/3937 m.
    SurveyFoot,
    Degree,
    /// Another length, in metres.
    Other(f64),
    /// Another angle, in degrees.
    Angle(f64),
}

/// The units of coordinates; `None` where the file does not say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Units {
    /// The unit of the two coordinates on the map: x and y.
    pub level: Option<Unit>,
    /// The unit of the heights: z.
    pub height: Option<Unit>,
}

/// A US survey foot in metres.
const SURVEY_FOOT: f64 = 1200.0 / 3937.0;
/// A gon in degrees.
const GON: f64 = 0.9;
/// By how much, as a share, a length may differ from the one that it is taken for. The two feet differ by 2e-6.
const SAME_LENGTH: f64 = 2e-7;
/// By how much, as a share, an angle may differ from the one that it is taken for: files write six digits.
const SAME_ANGLE: f64 = 1e-5;
/// By how much a number may differ from the unit of its name: a file may write 0.304801 for the US survey foot.
const SAME_NAME: f64 = 5e-6;

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Metre => f.write_str("m"),
            Self::Foot => f.write_str("ft"),
            Self::SurveyFoot => f.write_str("ftUS"),
            Self::Degree => f.write_str("°"),
            Self::Other(1000.0) => f.write_str("km"),
            Self::Other(0.01) => f.write_str("cm"),
            Self::Other(0.001) => f.write_str("mm"),
            Self::Other(metres) => write!(f, "({metres} m)"),
            Self::Angle(GON) => f.write_str("gon"),
            Self::Angle(degrees) => write!(f, "({degrees}°)"),
        }
    }
}

impl Unit {
    /// The unit of so many metres; `None` for what is no length.
    pub(crate) fn of_metres(metres: f64) -> Option<Self> {
        let is = |known: f64| (metres / known - 1.0).abs() < SAME_LENGTH;
        let round = [1000.0, 0.01, 0.001].into_iter().find(|known| is(*known));
        match metres {
            _ if is(1.0) => Some(Self::Metre),
            _ if is(0.3048) => Some(Self::Foot),
            _ if is(SURVEY_FOOT) => Some(Self::SurveyFoot),
            _ => (metres > 0.0 && metres.is_finite()).then_some(Self::Other(round.unwrap_or(metres))),
        }
    }

    /// The unit of so many degrees; `None` for what is no angle.
    pub(crate) fn of_degrees(degrees: f64) -> Option<Self> {
        let is = |known: f64| (degrees / known - 1.0).abs() < SAME_ANGLE;
        match degrees {
            _ if is(1.0) => Some(Self::Degree),
            _ if is(GON) => Some(Self::Angle(GON)),
            _ => (degrees > 0.0 && degrees.is_finite()).then_some(Self::Angle(degrees)),
        }
    }

    /// The length with a name as files write it.
    pub(crate) fn of_name(name: &str) -> Option<Self> {
        let letters: String = name.chars().filter(char::is_ascii_alphanumeric).collect();
        match letters.to_ascii_lowercase().as_str() {
            "m" | "metre" | "meter" | "metres" | "meters" => Some(Self::Metre),
            "ft" | "foot" | "feet" | "ift" | "internationalfoot" | "internationalfeet" | "footinternational"
            | "intlft" | "intlfoot" | "intlfeet" | "ftint" => Some(Self::Foot),
            "ftus" | "usft" | "usfoot" | "usfeet" | "footus" | "feetus" | "ussurveyfoot" | "ussurveyfeet"
            | "surveyfoot" | "surveyfeet" | "footsurveyus" | "ussft" | "sft" | "sfoot" | "sfeet" | "ftsurvey" => {
                Some(Self::SurveyFoot)
            }
            "km" | "kilometre" | "kilometer" | "kilometres" | "kilometers" => Some(Self::Other(1000.0)),
            "cm" | "centimetre" | "centimeter" | "centimetres" | "centimeters" => Some(Self::Other(0.01)),
            "mm" | "millimetre" | "millimeter" | "millimetres" | "millimeters" => Some(Self::Other(0.001)),
            _ => None,
        }
    }

    /// The length with a name and a number of metres. The number counts; where it has few digits, the name says which
    /// length is meant.
    pub(crate) fn of_name_and_metres(name: &str, metres: Option<f64>) -> Option<Self> {
        let named = Self::of_name(name);
        let Some(metres) = metres else { return named };
        let of_number = Self::of_metres(metres)?;
        let is_near = |unit: &Self| unit.metres().is_some_and(|known| (metres / known - 1.0).abs() < SAME_NAME);
        match of_number {
            Self::Other(_) => named.filter(is_near).or(Some(of_number)),
            _ => Some(of_number),
        }
    }

    /// The name that the EPSG gives it in short, such as `m`, `ftUS` and `deg`.
    pub fn short_name(self) -> String {
        match self {
            Self::Degree => "deg".into(),
            _ => self.to_string(),
        }
    }

    pub fn is_angle(self) -> bool {
        matches!(self, Self::Degree | Self::Angle(_))
    }

    /// How many metres it is; `None` for an angle.
    pub fn metres(self) -> Option<f64> {
        match self {
            Self::Metre => Some(1.0),
            Self::Foot => Some(0.3048),
            Self::SurveyFoot => Some(SURVEY_FOOT),
            Self::Other(metres) => Some(metres),
            Self::Degree | Self::Angle(_) => None,
        }
    }
}

impl Units {
    /// The units of several clouds together, of which those that say nothing are taken to be in the units of the others.
    /// Nothing is said where two of them differ.
    pub fn in_common(all: impl IntoIterator<Item = Self>) -> Self {
        let mut told = all.into_iter().filter(|units| *units != Self::default());
        let Some(first) = told.next() else { return Self::default() };
        let is_same = |other: Self| (other.level, other.rise()) == (first.level, first.rise());
        if told.all(is_same) { first } else { Self::default() }
    }

    /// The unit of all lengths, if the level ones and heights have the same.
    pub fn length(&self) -> Option<Unit> {
        let is_one = self.height.is_none() || self.height == self.level;
        self.level.filter(|unit| is_one && !unit.is_angle())
    }

    /// The unit of lengths along z. A file that says nothing of heights has them in the unit of its level lengths.
    pub fn rise(&self) -> Option<Unit> {
        self.height.or(self.level.filter(|unit| !unit.is_angle()))
    }

    /// Whether lengths in slanting directions mean nothing, because coordinates have different units.
    pub fn are_mixed(&self) -> bool {
        self.level.is_some_and(|level| level.is_angle() || self.length().is_none())
    }

    /// What a person should know of coordinates in mixed units.
    pub fn warning(&self) -> Option<String> {
        let level = self.level.filter(|_| self.are_mixed())?;
        let heights = self.height.map_or("in an unknown unit".into(), |height| format!("in {height}"));
        let shape = if level.is_angle() { ", and pictures are out of shape" } else { "" };
        Some(format!(
            "the units are mixed: x and y are in {level}, heights {heights}; lengths, areas and angles across both have \
             no unit{shape}"
        ))
    }

    /// The units by their short names: `m`, or `ftUS, heights in m`.
    pub fn text(&self) -> String {
        let level = self.level.map_or("unknown".into(), Unit::short_name);
        match self.height {
            Some(height) if self.level != Some(height) => format!("{level}, heights in {}", height.short_name()),
            _ => level,
        }
    }

    /// Takes what these units lack from `other`.
    pub(crate) fn or(self, other: Self) -> Self {
        Self { level: self.level.or(other.level), height: self.height.or(other.height) }
    }

    /// Whether both say something of the same coordinate, and not the same.
    pub fn contradict(&self, other: &Self) -> bool {
        self.difference(other).is_some()
    }

    /// How they contradict others, in words that `than` can follow: `another unit of heights (ft, not m)`.
    pub fn difference(&self, other: &Self) -> Option<String> {
        let differing = |own: Option<Unit>, other: Option<Unit>| own.zip(other).filter(|(own, other)| own != other);
        let pairs = (differing(self.level, other.level), differing(self.height, other.height));
        let told = |of: &str, (own, other): (Unit, Unit)| {
            format!("another unit{of} ({}, not {})", own.short_name(), other.short_name())
        };
        match pairs {
            (Some(level), Some(height)) if level == height => Some(told("", level)),
            (Some(level), Some(height)) => Some(told(" of x and y", level) + " and " + &told(" of heights", height)),
            (Some(level), None) => Some(told(" of x and y", level)),
            (None, Some(height)) => Some(told(" of heights", height)),
            (None, None) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_says_which_foot_and_a_name_does_where_digits_are_missing() {
        let of = Unit::of_name_and_metres;
        assert_eq!(of("foot", Some(0.304800609601219)), Some(Unit::SurveyFoot));
        assert_eq!(of("US survey foot", Some(0.3048)), Some(Unit::Foot));
        assert_eq!(of("foot_survey_us", Some(0.304801)), Some(Unit::SurveyFoot));
        assert_eq!(of("Foot_US", None), Some(Unit::SurveyFoot));
        assert_eq!(of("rod", Some(5.0292)), Some(Unit::Other(5.0292)));
        assert_eq!(of("metre", Some(0.0)), None);
        assert_eq!(of("Clarke's foot", Some(0.3047972654)), Some(Unit::Other(0.3047972654)));
        assert_eq!(Unit::of_degrees(1.0_f64.to_radians() * 57.29578), Some(Unit::Degree));
    }

    #[test]
    fn clouds_in_different_units_have_none_in_common() {
        let units = |level, height| Units { level, height };
        let (metre, feet, none) = (Some(Unit::Metre), Some(Unit::Foot), Units::default());
        assert_eq!((Units::in_common([]), Units::in_common([none, none])), (none, none));
        assert_eq!(Units::in_common([none, units(feet, None), none]), units(feet, None));
        assert_eq!(Units::in_common([units(metre, None), units(metre, metre)]), units(metre, None));
        for differing in [[units(feet, None), units(metre, None)], [units(metre, feet), units(metre, metre)]] {
            assert_eq!(Units::in_common(differing), none);
        }
    }

    #[test]
    fn units_that_are_mixed_are_told_and_leave_slanting_lengths_without_a_unit() {
        let units = |level, height| Units { level, height };
        let (metre, feet, degree) = (Some(Unit::Metre), Some(Unit::SurveyFoot), Some(Unit::Degree));
        let mixed = units(feet, metre);
        assert!(mixed.are_mixed() && mixed.length().is_none() && mixed.rise() == metre);
        let told = mixed.warning().unwrap();
        assert!(told.contains("x and y are in ftUS, heights in m;") && !told.contains("out of shape"), "{told}");
        let told = units(degree, metre).warning().unwrap();
        assert!(told.contains("x and y are in °, heights in m;") && told.contains("out of shape"), "{told}");
        assert!(units(degree, None).warning().is_some() && units(degree, None).rise().is_none());
        for even in [units(None, None), units(metre, None), units(feet, feet), units(None, metre)] {
            assert_eq!(even.warning(), None);
        }
        assert_eq!(units(feet, None).rise(), feet);
    }

    #[test]
    fn units_that_contradict_others_are_named_with_those() {
        let difference = |[level, height]: [Option<Unit>; 2], [other, other_height]: [Option<Unit>; 2]| {
            Units { level, height }.difference(&Units { level: other, height: other_height }).unwrap_or_default()
        };
        let (metre, foot, degree) = (Some(Unit::Metre), Some(Unit::SurveyFoot), Some(Unit::Degree));
        assert_eq!(difference([foot, foot], [metre, metre]), "another unit (ftUS, not m)");
        assert_eq!(difference([degree, None], [metre, metre]), "another unit of x and y (deg, not m)");
        assert_eq!(difference([metre, metre], [metre, foot]), "another unit of heights (m, not ftUS)");
        let both = "another unit of x and y (deg, not ftUS) and another unit of heights (m, not ftUS)";
        assert_eq!(difference([degree, metre], [foot, foot]), both);
        assert_eq!([difference([metre, None], [metre, foot]), difference([None, foot], [metre, foot])], ["", ""]);
    }

    #[test]
    fn units_are_told_and_heights_apart_where_theirs_are_others() {
        let text = |level, height| Units { level, height }.text();
        let (metre, foot) = (Some(Unit::Metre), Some(Unit::SurveyFoot));
        assert_eq!(text(None, None), "unknown");
        assert_eq!([text(metre, None), text(metre, metre)], ["m", "m"]);
        assert_eq!(text(foot, metre), "ftUS, heights in m");
        assert_eq!(text(None, metre), "unknown, heights in m");
        assert_eq!(text(Some(Unit::Degree), metre), "deg, heights in m");
    }
}
