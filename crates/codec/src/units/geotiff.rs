//! The coordinate system in the keys of GeoTIFF (OGC 19-008r4; before that, revision 1.0 of 2000).

use super::unit::{Unit, Units};
use super::{epsg, wkt};

/// The tags of the records that keys refer to: numbers, and texts.
const DOUBLES: u16 = 34736;
const ASCII: u16 = 34737;
/// The value of a key whose content other keys describe.
const USER_DEFINED: u16 = 32767;

/// The keys of a file, with the numbers and texts that they refer to.
#[derive(Default)]
pub struct GeoTiff<'a> {
    /// (key, tag, count, value or index).
    pub keys: Vec<[u16; 4]>,
    pub doubles: Vec<f64>,
    pub text: &'a [u8],
}

impl GeoTiff<'_> {
    fn find(&self, id: u16) -> Option<&[u16; 4]> {
        self.keys.iter().find(|key| key[0] == id)
    }

    fn value(&self, id: u16) -> Option<u16> {
        self.find(id).filter(|key| key[1] == 0).map(|key| key[3])
    }

    /// The code of a system.
    fn system(&self, id: u16) -> Option<u32> {
        self.value(id).filter(|code| ![0, USER_DEFINED].contains(code)).map(u32::from)
    }

    fn number(&self, id: u16) -> Option<f64> {
        let key = self.find(id).filter(|key| key[1] == DOUBLES)?;
        self.doubles.get(usize::from(key[3])).copied()
    }

    fn citation(&self, id: u16) -> Option<String> {
        let &[_, tag, count, start] = self.find(id)?;
        let (start, count) = (usize::from(start), usize::from(count));
        let citation = self.text.get(start..start + count).filter(|_| tag == ASCII)?;
        let citation = String::from_utf8_lossy(citation);
        let citation = citation.split('\0').next()?.trim_end_matches('|').trim();
        (!citation.is_empty()).then(|| citation.to_owned())
    }

    /// The name of the system: a citation, or else the code of the EPSG; behind it the code of the system of the heights,
    /// as in `EPSG:26910+5703`, unless the citation ends with that.
    pub fn name(&self) -> Option<String> {
        // The citations of the projected, the whole, the geographic system.
        let citation = [3073, 1026, 2049].into_iter().find_map(|id| self.citation(id));
        let last_number =
            |text: &str| -> Option<u32> { text.rsplit(|letter: char| !letter.is_ascii_digit()).next()?.parse().ok() };
        match (citation, self.system(4096)) {
            (Some(citation), Some(heights)) if last_number(&citation) != Some(heights) => {
                Some(format!("{citation} + EPSG:{heights}"))
            }
            (Some(citation), _) => Some(citation),
            (None, heights) => {
                let heights = heights.map_or(String::new(), |heights| format!("+{heights}"));
                self.code().map(|code| format!("EPSG:{code}{heights}"))
            }
        }
    }

    /// The code of the projected, or else of the geographic system.
    pub fn code(&self) -> Option<u32> {
        [3072, 2048].into_iter().find_map(|id| self.system(id))
    }

    /// The length that a key names; another key has the size in metres of a user-defined one.
    fn length(&self, id: u16, size: Option<u16>) -> Option<Unit> {
        let unit = match self.value(id)? {
            USER_DEFINED => Unit::of_metres(self.number(size?)?)?,
            code => epsg::unit(code)?,
        };
        (!unit.is_angle()).then_some(unit)
    }

    /// The unit of angles; a user-defined one has its size in radians.
    fn angle(&self) -> Option<Unit> {
        match self.value(2054)? {
            USER_DEFINED => Unit::of_degrees(self.number(2055)?.to_degrees()),
            code => epsg::unit(code).filter(|unit| unit.is_angle()),
        }
    }

    /// The units of the coordinates. Keys for units come before the code of a system, and that before citations. A unit
    /// that contradicts the code is reported.
    pub fn units(&self, warnings: &mut Vec<String>) -> Units {
        let of_system = |id: u16| self.system(id).and_then(epsg::units).unwrap_or_default();
        let (projected, geographic, vertical) = (of_system(3072), of_system(2048), of_system(4096));
        let (length, angle, height) = (self.length(3076, Some(3077)), self.angle(), self.length(4099, None));
        let is_projected = self.find(3072).is_some() || length.is_some();
        let level = match self.value(1024) {
            Some(3) => {
                let own = self.length(2052, Some(2053)).or(length);
                own.or(geographic.level).or(Some(Unit::Metre))
            }
            Some(2) => angle.or(geographic.level).or(Some(Unit::Degree)),
            None | Some(0 | USER_DEFINED) if !is_projected && self.find(2048).is_some() => angle.or(geographic.level),
            _ => {
                let own = self.told(3076, length, projected.level, warnings);
                own.or_else(|| [3073, 1026].into_iter().find_map(|id| unit_of_citation(&self.citation(id)?, false)))
            }
        };
        let own = self.told(4099, height, vertical.height, warnings);
        let cited = || unit_of_citation(&self.citation(4097)?, true);
        // A code for both, the map and the heights, is of neither kind, and found with the codes of the map all the same.
        Units { level, height: own.or(projected.height).or(geographic.height).or_else(cited) }
    }

    /// The unit of a key, or else that of the code of the system, with a warning where they differ.
    fn told(&self, key: u16, own: Option<Unit>, of_code: Option<Unit>, warnings: &mut Vec<String>) -> Option<Unit> {
        if let (Some(own), Some(of_code)) = (own, of_code)
            && own != of_code
        {
            let code = if key == 4099 { self.system(4096) } else { self.system(3072) }.unwrap_or_default();
            warnings.push(format!("GeoTIFF key {key} says {own}, and EPSG:{code} has {of_code}: taken for {own}"));
        }
        own.or(of_code)
    }
}

/// The length that a citation names: as well-known text, behind `Units =`, or in brackets at its end. Citations of whole
/// systems name that of the map first, and behind ` + ` that of the heights.
fn unit_of_citation(citation: &str, is_height: bool) -> Option<Unit> {
    let of_wkt = wkt::units(citation);
    if let Some(unit) = if is_height { of_wkt.height } else { of_wkt.level } {
        return Some(unit).filter(|unit| !unit.is_angle());
    }
    let part = if is_height { citation } else { citation.split(" + ").next()? };
    let named = part.split(['|', '\n', ';']).find_map(|part| {
        let (name, unit) = part.split_once('=')?;
        let name = name.trim().to_ascii_lowercase();
        ["units", "lunits", "linear units"].contains(&name.as_str()).then(|| Unit::of_name(unit))?
    });
    let in_brackets = || Unit::of_name(part.trim_end_matches([')', '|', ' ']).rsplit_once('(')?.1);
    named.or_else(in_brackets)
}

#[cfg(test)]
mod tests {
    use super::*;

    const METRE: Option<Unit> = Some(Unit::Metre);
    const SURVEY: Option<Unit> = Some(Unit::SurveyFoot);

    fn told(keys: &[[u16; 4]], doubles: &[f64], text: &str) -> (Option<Unit>, Option<Unit>, Vec<String>) {
        let mut warnings = Vec::new();
        let keys = GeoTiff { keys: keys.to_vec(), doubles: doubles.to_vec(), text: text.as_bytes() };
        let Units { level, height } = keys.units(&mut warnings);
        (level, height, warnings)
    }

    fn of(keys: &[[u16; 4]]) -> (Option<Unit>, Option<Unit>) {
        let (level, height, warnings) = told(keys, &[], "");
        assert_eq!(warnings, [""; 0]);
        (level, height)
    }

    #[test]
    fn keys_say_units_or_a_system_that_has_them() {
        assert_eq!(of(&[[1024, 0, 1, 1], [3072, 0, 1, 26917], [3076, 0, 1, 9001], [4099, 0, 1, 9001]]), (METRE, METRE));
        assert_eq!(of(&[[1024, 0, 1, 1], [3072, 0, 1, 2229], [4099, 0, 1, 9003]]), (SURVEY, SURVEY));
        assert_eq!(of(&[[1024, 0, 1, 1], [3072, 0, 1, 2927], [4096, 0, 1, 5703]]), (SURVEY, METRE));
        assert_eq!(of(&[[1024, 0, 1, 1], [3072, 0, 1, 2927], [4096, 0, 1, 5103]]), (SURVEY, None), "a datum");
        assert_eq!(of(&[[3072, 0, 1, 2927]]), (SURVEY, None));
        assert_eq!(of(&[[1024, 0, 1, 1], [3072, 0, 1, 32767]]), (None, None));
        assert_eq!(of(&[[1024, 0, 1, 1], [3072, 0, 1, 8800]]), (SURVEY, SURVEY), "a compound system");
        assert_eq!(of(&[[1024, 0, 1, 3]]), (METRE, None));
        assert_eq!(of(&[]), (None, None));
    }

    #[test]
    fn geographic_keys_say_angles() {
        let degree = Some(Unit::Degree);
        assert_eq!(of(&[[1024, 0, 1, 2], [4099, 0, 1, 9001]]), (degree, METRE));
        assert_eq!(of(&[[2048, 0, 1, 4326]]), (degree, None));
        assert_eq!(of(&[[1024, 0, 1, 2], [2048, 0, 1, 4807]]), (Some(Unit::Angle(0.9)), None));
        assert_eq!(of(&[[1024, 0, 1, 2], [2048, 0, 1, 4979]]), (degree, METRE));
        let own = [[1024, 0, 1, 2], [2054, 0, 1, 32767], [2055, DOUBLES, 1, 1]];
        assert_eq!(told(&own, &[9.0, 0.9_f64.to_radians()], "").0, Some(Unit::Angle(0.9)));
    }

    #[test]
    fn user_defined_units_have_the_size_of_their_key() {
        let keys = [[1024, 0, 1, 1], [3072, 0, 1, 32767], [3076, 0, 1, 32767], [3077, DOUBLES, 1, 0]];
        assert_eq!(told(&keys, &[1200.0 / 3937.0], "").0, SURVEY);
        assert_eq!(told(&keys, &[5.0292], "").0, Some(Unit::Other(5.0292)));
        assert_eq!(told(&keys, &[f64::NAN], "").0, None);
        assert_eq!(told(&keys, &[], "").0, None);
        let keys = [[1024, 0, 1, 3], [2052, 0, 1, 32767], [2053, DOUBLES, 1, 0]];
        assert_eq!(told(&keys, &[0.3048], "").0, Some(Unit::Foot));
    }

    #[test]
    fn citations_say_units_where_no_key_and_no_code_does() {
        let level = |text: &str| told(&[[1024, 0, 1, 1], [1026, ASCII, text.len() as u16, 0]], &[], text).0;
        assert_eq!(level("NAD83(HARN) / Washington South (ftUS)|"), SURVEY);
        assert_eq!(level("PCS Name = NAD_1983|Linear Units = Foot_US|"), SURVEY);
        assert_eq!(level("Projection Name = UTM\nUnits = meters\n"), METRE);
        assert_eq!(level("ESRI PE String = PROJCS[\"a\",UNIT[\"Foot_US\",0.3048006096012192]]|"), SURVEY);
        assert_eq!(level("a (ft) + NAVD88 height (m)"), Some(Unit::Foot));
        assert_eq!(level("NAD83 / UTM zone 15N"), None);
        let height = |text: &str| told(&[[4097, ASCII, text.len() as u16, 0]], &[], text).1;
        assert_eq!(height("NAVD88 height (ftUS)"), SURVEY);
        assert_eq!(height("NAVD88 - Geoid12B (Meters)|"), METRE);
        assert_eq!(height("NAVD88"), None);
    }

    #[test]
    fn the_code_of_the_heights_stands_behind_any_citation_that_does_not_end_with_it() {
        let name = |text: &str| {
            let keys = [[1026, ASCII, text.len() as u16, 0], [4096, 0, 1, 5703]];
            GeoTiff { keys: keys.to_vec(), doubles: Vec::new(), text: text.as_bytes() }.name().unwrap()
        };
        assert_eq!(name("NAD83 / UTM zone 10N|"), "NAD83 / UTM zone 10N + EPSG:5703");
        assert_eq!(name("GDA94+Zone 55|"), "GDA94+Zone 55 + EPSG:5703");
        assert_eq!(name("a grid + a height|"), "a grid + a height + EPSG:5703");
        assert_eq!(name("EPSG:26910+5703|"), "EPSG:26910+5703");
    }

    #[test]
    fn a_unit_that_contradicts_the_code_is_told() {
        let (level, _, warnings) = told(&[[3072, 0, 1, 2927], [3076, 0, 1, 9001]], &[], "");
        assert_eq!(level, METRE);
        assert_eq!(warnings, ["GeoTIFF key 3076 says m, and EPSG:2927 has ftUS: taken for m"]);
    }

    #[test]
    fn keys_that_refer_to_nothing_say_nothing() {
        let keys = [[1026, ASCII, u16::MAX, u16::MAX], [3076, 0, 1, 32767], [3077, DOUBLES, 1, u16::MAX]];
        assert_eq!(told(&keys, &[], "short"), (None, None, Vec::new()));
    }
}
