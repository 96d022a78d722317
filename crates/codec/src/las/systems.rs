//! The coordinate system of a file that is written. Point formats 6 to 10 have it as well-known text, and the header's bit
//! says so (LAS 1.4 R15, 2.4 and 3); older files have it as keys of GeoTIFF, of which text is made here where their codes
//! say everything.

use std::fmt::Write as _;
use std::io::{self, Read as _};

use super::LasSource;
use super::layout::{bytes, text};
use crate::units::{Unit, Units, wkt};

/// The header's bit that says that the coordinate system is well-known text.
pub const WKT: u16 = 16;
/// The most bytes of a record of keys.
const MOST_BYTES: u64 = 1 << 20;
/// The most bytes of a text in a record, which ends with a zero.
const MOST_TEXT: usize = u16::MAX as usize - 1;
const PROJECTION: &str = "LASF_Projection";
/// The identifiers of the records of GeoTIFF, and of well-known text.
const KEYS: u16 = 34735;
const TEXTS: u16 = 34737;
const TEXT: u16 = 2112;
/// The value of a code that stands for a system described by other keys.
const USER_DEFINED: u16 = 32767;

/// Codes whose text in `crs-definitions` is not read by PROJ 9, or puts places elsewhere than PROJ does.
const WRONG: [u16; 18] =
    [2062, 3167, 3973, 3974, 3993, 6200, 6201, 6202, 6966, 6996, 6997, 8857, 8858, 8859, 22300, 22700, 26591, 26592];

/// What a file that is written says of its system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct System {
    /// The text of a record that the other file does not have.
    pub added: Option<String>,
    keeps_keys: bool,
    keeps_text: bool,
    /// What is said of it.
    pub word: Option<String>,
}

impl System {
    /// The system of a file of a point format that keeps the records of another one, if there is one.
    pub fn new(first: Option<&LasSource>, format: u8) -> io::Result<Self> {
        let all = Self { keeps_keys: true, keeps_text: true, ..Self::default() };
        let Some(first) = first.filter(|_| format >= 6) else { return Ok(all) };
        let (mut keys, mut text_of_keys, mut has_text) = (Vec::new(), Vec::new(), false);
        for (extended, place) in &first.records {
            let head: [u8; 20] = first.file.bytes_at(place.start)?.unwrap_or([0; 20]);
            let identifier = u16::from_le_bytes(bytes(&head, 18));
            if text(&head[2..18]) != PROJECTION || place.end - place.start > MOST_BYTES {
                continue;
            }
            let data = || {
                let start = place.start + if *extended { 60 } else { 54 };
                let mut data = Vec::new();
                first.file.section(start.min(place.end), place.end).read_to_end(&mut data)?;
                Ok::<_, io::Error>(data)
            };
            match identifier {
                KEYS => keys = data()?,
                TEXTS => text_of_keys = data()?,
                TEXT => has_text |= !text(&data()?).is_empty(),
                _ => {}
            }
        }
        // The entry of the directory itself comes first.
        let entries = keys.chunks_exact(8).skip(1);
        let keys: Vec<[u16; 4]> =
            entries.map(|entry| std::array::from_fn(|i| u16::from_le_bytes(bytes(entry, 2 * i)))).collect();
        // Versions before 1.4 have no such bit.
        let is_text_counted = first.global_encoding & WKT != 0 || first.version < (1, 4);
        if keys.is_empty() || has_text && is_text_counted {
            return Ok(all);
        }
        // The bit is clear, so the keys count, and a text beside them is an old one.
        let stale = if has_text { "; a WKT record, which did not count, is left out" } else { "" };
        Ok(match wkt_of(&keys, &text_of_keys, &first.info.units) {
            Some(Made { text, is_whole: true }) => {
                let word = has_text.then(|| format!("its GeoTIFF keys count, and became WKT{stale}"));
                Self { added: Some(text), word, ..Self::default() }
            }
            Some(Made { text, .. }) => {
                let word = format!("its WKT says nothing of heights: their system is in GeoTIFF records alone{stale}");
                Self { added: Some(text), keeps_keys: true, word: Some(word), ..Self::default() }
            }
            None => {
                let word = format!(
                    "its coordinate system cannot be written as WKT, which point formats 6 to 10 ask for: it is in GeoTIFF \
                     records, which some programs leave unread{stale}"
                );
                Self { keeps_keys: true, word: Some(word), ..Self::default() }
            }
        })
    }

    /// The system of points of other formats, whose coordinates have these units, by its text.
    pub fn of_text(text: &str, units: &Units) -> Self {
        let refusal = match () {
            () if !wkt::is_text(text) => "is no WKT, which LAS asks for",
            () if text.len() > MOST_TEXT => "is longer than a record of LAS",
            () if wkt::units(text).contradict(units) => "has other units than the coordinates",
            () => return Self { added: Some(text.into()), ..Self::default() },
        };
        Self { word: Some(format!("the coordinate system {refusal}: it is left out")), ..Self::default() }
    }

    /// Whether a record of the other file goes on to this one.
    pub fn keeps(&self, user: &str, identifier: u16) -> bool {
        match identifier {
            _ if user != PROJECTION => true,
            KEYS..=TEXTS => self.keeps_keys,
            TEXT => self.keeps_text,
            _ => true,
        }
    }
}

/// Well-known text, and whether it says all that the keys say.
#[derive(Debug, PartialEq)]
struct Made {
    text: String,
    is_whole: bool,
}

/// Well-known text of the system with a code of the EPSG.
pub fn text_of(code: u16) -> Option<&'static str> {
    Some(crs_definitions::from_code(code).filter(|_| !WRONG.contains(&code))?.wkt)
}

/// Well-known text (OGC 01-009) of a system that keys of GeoTIFF name by its code.
fn wkt_of(keys: &[[u16; 4]], texts: &[u8], units: &Units) -> Option<Made> {
    let value = |id: u16| keys.iter().find(|key| key[0] == id && key[1] == 0).map(|key| key[3]);
    let code = |id: u16| value(id).filter(|code| *code != 0 && *code != USER_DEFINED);
    let level = text_of(code(if value(1024) == Some(2) { 2048 } else { 3072 })?)?;
    let is_first_version = ["PROJCS[", "GEOGCS[", "GEOCCS[", "COMPD_CS["].iter().any(|word| level.starts_with(word));
    let of_text = wkt::units(level);
    let contradicts = |own: Option<Unit>, other: Option<Unit>| own.zip(other).is_some_and(|(own, other)| own != other);
    if !is_first_version || contradicts(units.level, of_text.level) {
        return None;
    }
    let whole = |text: String| Some(Made { text, is_whole: true });
    if level.starts_with("COMPD_CS[") {
        return if contradicts(units.height, of_text.height) { None } else { whole(level.into()) };
    }
    if code(4096).is_none() && units.height.is_none() {
        return whole(level.into());
    }
    // The code of NAVD88 was that of its datum in GeoTIFF 1.0.
    let is_of = |known: &&Vertical, code: u16| known.code == code || known.datum == code && code == 5103;
    let known = code(4096).and_then(|code| {
        VERTICAL.iter().find(|known| is_of(known, code) && !contradicts(units.height, Some(known.unit)))
    });
    let Some(unit) = units.height.or(known.map(|known| known.unit)) else {
        return Some(Made { text: level.into(), is_whole: false });
    };
    let citation = citation(keys, texts).unwrap_or_else(|| "unknown height".into());
    let name = known.map_or(citation.as_str(), |known| known.name);
    let authority = |code: u16| format!(",AUTHORITY[\"EPSG\",\"{code}\"]");
    let (datum, of_datum) =
        known.map_or(("unknown", String::new()), |known| (known.datum_name, authority(known.datum)));
    let is_unknown = |code: &u16| VERTICAL.iter().all(|known| !is_of(&known, *code));
    let own_code = known.map(|known| known.code).or(code(4096).filter(is_unknown));
    let mut text = format!("COMPD_CS[\"{} + {name}\",{level},VERT_CS[\"{name}\",", level.split('"').nth(1)?);
    let (unit, length, of_unit) = match unit {
        Unit::Metre => ("metre", "1".into(), authority(9001)),
        Unit::Foot => ("foot", "0.3048".into(), authority(9002)),
        Unit::SurveyFoot => ("US survey foot", "0.304800609601219".into(), authority(9003)),
        Unit::Other(metres) => ("unknown", metres.to_string(), String::new()),
        Unit::Degree | Unit::Angle(_) => return None,
    };
    let _ = write!(text, "VERT_DATUM[\"{datum}\",2005{of_datum}],UNIT[\"{unit}\",{length}{of_unit}],");
    let _ = write!(text, "AXIS[\"Gravity-related height\",UP]{}]]", own_code.map(authority).unwrap_or_default());
    whole(text)
}

/// The name of the vertical system, without what would end a text.
fn citation(keys: &[[u16; 4]], texts: &[u8]) -> Option<String> {
    let &[_, _, count, start] = keys.iter().find(|key| key[0] == 4097 && key[1] == TEXTS)?;
    let own = texts.get(usize::from(start)..usize::from(start) + usize::from(count))?;
    let own = text(own).trim_end_matches('|').replace(['"', '[', ']'], " ").trim().to_owned();
    (!own.is_empty()).then_some(own)
}

/// A vertical system of the EPSG.
struct Vertical {
    code: u16,
    name: &'static str,
    datum: u16,
    datum_name: &'static str,
    unit: Unit,
}

/// The vertical systems that files of points name.
const VERTICAL: [Vertical; 27] = {
    const fn own(code: u16, name: &'static str, datum: u16, datum_name: &'static str, unit: Unit) -> Vertical {
        Vertical { code, name, datum, datum_name, unit }
    }
    use Unit::{Foot, Metre, SurveyFoot};
    const NAVD: &str = "North American Vertical Datum 1988";
    const NGVD: &str = "National Geodetic Vertical Datum 1929";
    [
        own(5703, "NAVD88 height", 5103, NAVD, Metre),
        own(6360, "NAVD88 height (ftUS)", 5103, NAVD, SurveyFoot),
        own(8228, "NAVD88 height (ft)", 5103, NAVD, Foot),
        own(5702, "NGVD29 height (ftUS)", 5102, NGVD, SurveyFoot),
        own(7968, "NGVD29 height (m)", 5102, NGVD, Metre),
        own(3855, "EGM2008 height", 1027, "EGM2008 geoid", Metre),
        own(5773, "EGM96 height", 5171, "EGM96 geoid", Metre),
        own(5714, "MSL height", 5100, "Mean Sea Level", Metre),
        own(5701, "ODN height", 5101, "Ordnance Datum Newlyn", Metre),
        own(5705, "Baltic 1977 height", 5105, "Baltic 1977", Metre),
        own(5709, "NAP height", 5109, "Normaal Amsterdams Peil", Metre),
        own(5710, "Ostend height", 5110, "Ostend", Metre),
        own(5711, "AHD height", 5111, "Australian Height Datum", Metre),
        own(5713, "CGVD28 height", 5114, "Canadian Geodetic Vertical Datum of 1928", Metre),
        own(6647, "CGVD2013(CGG2013) height", 1127, "Canadian Geodetic Vertical Datum of 2013 (CGG2013)", Metre),
        own(5720, "NGF-IGN69 height", 5119, "Nivellement General de la France - IGN69", Metre),
        own(5728, "LN02 height", 5127, "Landesnivellement 1902", Metre),
        own(5729, "LHN95 height", 5128, "Landeshohennetz 1995", Metre),
        own(5783, "DHHN92 height", 5181, "Deutsches Haupthoehennetz 1992", Metre),
        own(7837, "DHHN2016 height", 1170, "Deutsches Haupthoehennetz 2016", Metre),
        own(5941, "NN2000 height", 1096, "Norway Normal Null 2000", Metre),
        own(5613, "RH2000 height", 5177, "Rikets hojdsystem 2000", Metre),
        own(3900, "N2000 height", 1030, "N2000", Metre),
        own(5799, "DVR90 height", 5206, "Dansk Vertikal Reference 1990", Metre),
        own(5621, "EVRF2007 height", 5215, "European Vertical Reference Frame 2007", Metre),
        own(7839, "NZVD2016 height", 1169, "New Zealand Vertical Datum 2016", Metre),
        own(5782, "Alicante height", 5180, "Alicante", Metre),
    ]
};

#[cfg(test)]
mod tests {
    use super::*;

    fn made(keys: &[(u16, u16)], units: Units) -> Option<Made> {
        let keys: Vec<[u16; 4]> = keys.iter().map(|(id, value)| [*id, 0, 1, *value]).collect();
        wkt_of(&keys, &[], &units)
    }

    #[test]
    fn codes_become_well_known_text_with_heights() {
        let utm = made(&[(1024, 1), (3072, 26910)], Units::default()).unwrap();
        assert!(utm.is_whole && utm.text.starts_with("PROJCS[\"NAD83 / UTM zone 10N\",GEOGCS["), "{utm:?}");
        let degrees = made(&[(1024, 2), (2048, 4326)], Units::default()).unwrap();
        assert!(degrees.text.starts_with("GEOGCS[\"WGS 84\""), "{degrees:?}");
        let feet = Units { level: Some(Unit::SurveyFoot), height: Some(Unit::Metre) };
        let mixed = made(&[(1024, 1), (3072, 2927), (4096, 5703)], feet).unwrap();
        assert_eq!(wkt::units(&mixed.text), feet);
        assert!(mixed.is_whole && mixed.text.ends_with("AUTHORITY[\"EPSG\",\"5703\"]]]"), "{mixed:?}");
        assert_eq!(mixed.text.matches('[').count(), mixed.text.matches(']').count());
        // A unit of heights alone.
        let heights = Units { level: None, height: Some(Unit::SurveyFoot) };
        let text = made(&[(3072, 2927)], heights).unwrap().text;
        assert_eq!(wkt::units(&text), Units { level: Some(Unit::SurveyFoot), ..heights });
    }

    #[test]
    fn what_keys_say_otherwise_or_nobody_knows_becomes_no_text() {
        let metres = Units { level: Some(Unit::Metre), height: None };
        assert_eq!(made(&[(1024, 1), (3072, 2927)], metres), None);
        for keys in [&[(3072, USER_DEFINED)][..], &[(3072, WRONG[0])], &[(3072, 1)], &[(1024, 1)], &[]] {
            assert_eq!(made(keys, Units::default()), None, "{keys:?}");
        }
        let unknown = made(&[(3072, 26910), (4096, 9999)], Units::default()).unwrap();
        assert!(!unknown.is_whole && unknown.text.starts_with("PROJCS"));
    }
}
