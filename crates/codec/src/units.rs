//! The units of a coordinate system: feet are feet.

use std::fmt;

/// A unit of lengths, or degrees.
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
}

/// The units of coordinates; `None` where the file does not tell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Units {
    /// That of the two coordinates on the map.
    pub level: Option<Unit>,
    /// That of the heights, if the file tells it.
    pub height: Option<Unit>,
}

/// A US survey foot in metres.
const SURVEY_FOOT: f64 = 1200.0 / 3937.0;
/// By how much, as a share, a unit may differ from the one that it is taken for. The two feet differ by 2e-6.
const SAME: f64 = 2e-7;
/// The deepest nesting of a text that is read.
const DEEPEST: usize = 64;

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Metre => f.write_str("m"),
            Self::Foot => f.write_str("ft"),
            Self::SurveyFoot => f.write_str("ftUS"),
            Self::Degree => f.write_str("°"),
            Self::Other(metres) => write!(f, "({metres} m)"),
        }
    }
}

impl Unit {
    fn of_metres(metres: f64) -> Option<Self> {
        let is = |known: f64| (metres / known - 1.0).abs() < SAME;
        match metres {
            _ if is(1.0) => Some(Self::Metre),
            _ if is(0.3048) => Some(Self::Foot),
            _ if is(SURVEY_FOOT) => Some(Self::SurveyFoot),
            _ => (metres > 0.0 && metres.is_finite()).then_some(Self::Other(metres)),
        }
    }

    /// How many metres it is; `None` for an angle.
    pub fn metres(self) -> Option<f64> {
        match self {
            Self::Metre => Some(1.0),
            Self::Foot => Some(0.3048),
            Self::SurveyFoot => Some(SURVEY_FOOT),
            Self::Other(metres) => Some(metres),
            Self::Degree => None,
        }
    }

    /// The unit with a code of the EPSG.
    fn of_code(code: u16) -> Option<Self> {
        match code {
            9001 => Some(Self::Metre),
            9002 => Some(Self::Foot),
            9003 => Some(Self::SurveyFoot),
            9036 => Some(Self::Other(1000.0)),
            9096 => Some(Self::Other(0.9144)),
            9102 | 9122 => Some(Self::Degree),
            _ => None,
        }
    }
}

impl Units {
    /// The unit of all lengths, if the level ones and heights have the same.
    pub fn length(&self) -> Option<Unit> {
        let is_one = self.height.is_none() || self.height == self.level;
        self.level.filter(|unit| is_one && *unit != Unit::Degree)
    }

    /// Whether lengths in slanting directions mean nothing, because coordinates have different units.
    pub fn are_mixed(&self) -> bool {
        self.level == Some(Unit::Degree) || self.level.is_some() && self.length().is_none()
    }

    /// From well-known text, versions 1 and 2. The unit of a system is its own, not that of one that it is made of.
    pub(crate) fn of_wkt(text: &str) -> Self {
        let mut units = Self::default();
        let mut is_geographic = false;
        // The words before the brackets that are open.
        let mut open: Vec<&str> = Vec::new();
        let (mut is_quoted, mut word_start) = (false, 0);
        for (at, character) in text.char_indices() {
            match character {
                '"' => is_quoted = !is_quoted,
                _ if is_quoted => {}
                '[' | '(' => {
                    let word = text[word_start..at].trim();
                    if matches!(word, "UNIT" | "LENGTHUNIT") {
                        let owner = open.iter().rev().find(|word| **word != "AXIS" && **word != "CS");
                        let unit = number_after_name(&text[at + 1..]).and_then(Unit::of_metres);
                        match owner.copied().unwrap_or_default() {
                            "PROJCS" | "PROJCRS" | "PROJECTEDCRS" | "GEOCCS" | "LOCAL_CS" | "ENGCRS" => {
                                units.level = units.level.or(unit);
                            }
                            "VERT_CS" | "VERTCRS" | "VERTICALCRS" => units.height = units.height.or(unit),
                            "GEODCRS" | "GEODETICCRS" if text.contains("CS[Cartesian") => {
                                units.level = units.level.or(unit);
                            }
                            _ => {}
                        }
                    }
                    is_geographic |= matches!(word, "GEOGCS" | "GEOGCRS" | "GEOGRAPHICCRS");
                    if open.len() == DEEPEST {
                        return Self::default();
                    }
                    open.push(word);
                    word_start = at + 1;
                }
                ']' | ')' => {
                    open.pop();
                    word_start = at + 1;
                }
                ',' => word_start = at + 1,
                _ => {}
            }
        }
        let is_projected = ["PROJCS", "PROJCRS", "PROJECTEDCRS"].iter().any(|word| text.contains(word));
        if is_geographic && !is_projected && units.level.is_none() {
            units.level = Some(Unit::Degree);
        }
        units
    }

    /// From the keys of GeoTIFF: (key, tag, count, value).
    pub(crate) fn of_geotiff(keys: &[[u16; 4]]) -> Self {
        let value = |id: u16| keys.iter().find(|key| key[0] == id && key[1] == 0).map(|key| key[3]);
        let unit = |id: u16| value(id).and_then(Unit::of_code);
        let level = match value(1024) {
            Some(2) => Some(Unit::Degree),
            // Projected, or about the centre of the earth.
            _ => unit(3076).or_else(|| unit_of_system(value(3072)?)),
        };
        Self { level, height: unit(4099) }
    }
}

/// The number after a quoted name, as in `"metre",1.0,...`.
fn number_after_name(text: &str) -> Option<f64> {
    let rest = text.trim_start().strip_prefix('"')?;
    let (_, rest) = rest.split_once('"')?;
    let number = rest.trim_start().strip_prefix(',')?;
    number.split([',', ']', ')']).next()?.trim().parse().ok()
}

/// The unit of common projected systems of the EPSG, for files that only tell the code: the zones of UTM, and those of
/// the State Plane of 1983 in feet.
fn unit_of_system(code: u16) -> Option<Unit> {
    match code {
        3857 | 25828..=25838 | 26901..=26923 | 32601..=32660 | 32701..=32760 => Some(Unit::Metre),
        2222..=2224 | 2251..=2253 | 2256 | 2265 | 2266 | 2269 | 2270 | 2273 | 2280..=2282 => Some(Unit::Foot),
        2225..=2289 => Some(Unit::SurveyFoot),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn units(level: Option<Unit>, height: Option<Unit>) -> Units {
        Units { level, height }
    }

    #[test]
    fn well_known_text_of_both_versions_tells_its_own_units() {
        let degrees = r#"GEOGCS["WGS 84",DATUM["x",SPHEROID["y",6378137,298.2]],UNIT["degree",0.0174532925199433]]"#;
        assert_eq!(Units::of_wkt(degrees), units(Some(Unit::Degree), None));
        let metres = format!(r#"PROJCS["a [ft]",{degrees},PARAMETER["z",1],UNIT["metre",1,AUTHORITY["EPSG","9001"]]]"#);
        assert_eq!(Units::of_wkt(&metres), units(Some(Unit::Metre), None));
        let vertical = r#"VERT_CS["h",VERT_DATUM["d",2005],UNIT["US survey foot",0.304800609601219]]"#;
        let both = Units::of_wkt(&format!(r#"COMPD_CS["both",{metres},{vertical}]"#));
        assert_eq!(both, units(Some(Unit::Metre), Some(Unit::SurveyFoot)));
        assert!(both.length().is_none() && both.are_mixed());
        let second = r#"PROJCRS["b",BASEGEOGCRS["c",DATUM["d",ELLIPSOID["e",6378137,298,LENGTHUNIT["metre",1]]]],
            CS[Cartesian,2],AXIS["E",east,ORDER[1],LENGTHUNIT["foot",0.3048]],AXIS["N",north,LENGTHUNIT["foot",0.3048]]]"#;
        assert_eq!(Units::of_wkt(second), units(Some(Unit::Foot), None));
        assert_eq!(Units::of_wkt(second).length(), Some(Unit::Foot));
        for odd in ["", "NAD83 / UTM zone 15N", "PROJCS[UNIT[", "]]]UNIT[\"m\",1]", &"UNIT[".repeat(100_000)] {
            assert_eq!(Units::of_wkt(odd), Units::default(), "{}", &odd[..odd.len().min(30)]);
        }
        assert_eq!(Units::of_wkt(r#"PROJCS["a",UNIT["rod",5.0292]]"#).level, Some(Unit::Other(5.0292)));
        assert_eq!(Units::of_wkt(r#"PROJCS["a",UNIT["none",0]]"#).level, None);
    }

    #[test]
    fn keys_of_geotiff_tell_units_or_a_system_that_has_one() {
        let utm = [[1024, 0, 1, 1], [3072, 0, 1, 26917], [3076, 0, 1, 9001], [4099, 0, 1, 9001]];
        assert_eq!(Units::of_geotiff(&utm).length(), Some(Unit::Metre));
        let california = [[1024, 0, 1, 1], [3072, 0, 1, 2229], [4099, 0, 1, 9003]];
        assert_eq!(Units::of_geotiff(&california).length(), Some(Unit::SurveyFoot));
        let geographic = Units::of_geotiff(&[[1024, 0, 1, 2], [4099, 0, 1, 9001]]);
        assert!(geographic.length().is_none() && geographic.are_mixed());
        assert_eq!(Units::of_geotiff(&[]), Units::default());
        assert!(!Units::default().are_mixed());
    }
}
