//! The units of a coordinate system that is well-known text: versions 1 and 2, and the dialect of ESRI. Keywords may be
//! in any case.

use super::epsg;
use super::unit::{Unit, Units};

/// The deepest nesting of a text that is read.
const DEEPEST: usize = 64;
/// The most keywords and values of a text that is read: a system has some hundreds.
const MOST_PARTS: usize = 20_000;

/// A keyword with what its brackets hold.
#[derive(Default)]
struct Node<'a> {
    word: &'a str,
    /// Texts, without their quotes, and numbers.
    values: Vec<&'a str>,
    nodes: Vec<Node<'a>>,
}

/// Systems that are made of others.
const COMPOUND: [&str; 6] = ["COMPD_CS", "COMPOUNDCRS", "BOUNDCRS", "SOURCECRS", "FITTED_CS", "COORDINATEMETADATA"];

const PROJECTED: [&str; 5] = ["PROJCS", "PROJCRS", "PROJECTEDCRS", "DERIVEDPROJCRS", "DERIVEDPROJECTED"];
const OF_LENGTHS: [&str; 4] = ["GEOCCS", "LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"];
const GEOGRAPHIC: [&str; 3] = ["GEOGCS", "GEOGCRS", "GEOGRAPHICCRS"];
const GEODETIC: [&str; 2] = ["GEODCRS", "GEODETICCRS"];
const VERTICAL: [&str; 4] = ["VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"];

/// The units of a system, and of several systems beside one another: of a text that is none, and of one that is too long
/// or too deep, nothing is known. The units of a system are its own, not those of one that it is made of.
pub fn units(text: &str) -> Units {
    parse(text).map(|nodes| all(&nodes)).unwrap_or_default()
}

/// The code of the EPSG that the text gives its system.
pub fn code(text: &str) -> Option<u32> {
    parse(text)?.first()?.code()
}

/// Whether it is well-known text of a system. Names of systems have brackets, too.
pub fn is_text(text: &str) -> bool {
    let kinds: [&[&str]; 6] = [&COMPOUND, &PROJECTED, &OF_LENGTHS, &GEOGRAPHIC, &GEODETIC, &VERTICAL];
    parse(text).is_some_and(|nodes| nodes.iter().any(|node| kinds.iter().any(|words| node.is(words))))
}

/// The code of the EPSG of the system on the map, which may be a part of the whole.
pub fn level_code(text: &str) -> Option<u32> {
    parse(text)?.iter().find_map(Node::level_code)
}

fn parse(text: &str) -> Option<Vec<Node<'_>>> {
    // The text itself, and the keywords whose brackets are open.
    let mut open = vec![Node::default()];
    let (mut is_quoted, mut start, mut parts) = (false, 0, 0);
    for (at, character) in text.char_indices() {
        if character == '"' {
            is_quoted = !is_quoted;
        }
        if is_quoted || !matches!(character, '[' | '(' | ']' | ')' | ',') {
            continue;
        }
        let before = text[start..at].trim();
        start = at + 1;
        parts += 1;
        if parts > MOST_PARTS {
            return None;
        }
        if matches!(character, '[' | '(') {
            if open.len() > DEEPEST {
                return None;
            }
            let is_letter = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
            let word = before.rsplit(|letter| !is_letter(letter)).next().unwrap_or_default();
            open.push(Node { word, ..Node::default() });
            continue;
        }
        if let Some(node) = open.last_mut().filter(|_| !before.is_empty()) {
            node.values.push(before.trim_matches('"'));
        }
        if character != ',' {
            close(&mut open);
        }
    }
    // A text may be cut short.
    while open.len() > 1 {
        close(&mut open);
    }
    open.pop().map(|text| text.nodes)
}

/// Ends the last of the keywords that are open. A bracket too many ends nothing.
fn close(open: &mut Vec<Node<'_>>) {
    if let [.., _, _] = open.as_slice()
        && let (Some(node), Some(outer)) = (open.pop(), open.last_mut())
    {
        outer.nodes.push(node);
    }
}

fn all(nodes: &[Node]) -> Units {
    nodes.iter().map(Node::units).fold(Units::default(), Units::or)
}

impl Node<'_> {
    fn is(&self, words: &[&str]) -> bool {
        words.iter().any(|word| self.word.eq_ignore_ascii_case(word))
    }

    fn units(&self) -> Units {
        if self.is(&COMPOUND) {
            return all(&self.nodes);
        }
        let own = if self.is(&PROJECTED) || self.is(&OF_LENGTHS) {
            self.own(false)
        } else if self.is(&GEOGRAPHIC) {
            self.own(true)
        } else if self.is(&GEODETIC) {
            let kind = self.nodes.iter().find(|node| node.is(&["CS"])).and_then(|node| node.values.first().copied());
            match kind.unwrap_or_default().to_ascii_lowercase().as_str() {
                "ellipsoidal" => self.own(true),
                "cartesian" => self.own(false),
                _ => Units::default(),
            }
        } else if self.is(&VERTICAL) {
            let mut axes = self.nodes.iter().filter(|node| node.is(&["AXIS"]));
            Units { level: None, height: self.unit(false).or_else(|| axes.find_map(|axis| axis.unit(false))) }
        } else {
            return Units::default();
        };
        own.or(self.code().and_then(epsg::units).unwrap_or_default())
    }

    /// The units of the axes of a system; `is_angular` says that those on the map are angles.
    fn own(&self, is_angular: bool) -> Units {
        let is_up = |axis: &&Self| axis.values.get(1).is_some_and(|way| ["up", "down"].contains(&&*way.to_lowercase()));
        let axes = || self.nodes.iter().filter(|node| node.is(&["AXIS"]));
        let level = axes().filter(|axis| !is_up(axis)).find_map(|axis| axis.unit(is_angular));
        let level = level.or_else(|| self.unit(is_angular)).or(is_angular.then_some(Unit::Degree));
        let up = axes().find(is_up);
        let height = up.and_then(|axis| axis.unit(false).or_else(|| self.unit(false).filter(|_| !is_angular)));
        // ESRI has no axes, and a unit of heights beside that of angles.
        Units { level, height: height.or_else(|| self.unit_called(&["LINUNIT"], false)) }
    }

    /// The unit that stands in these brackets themselves.
    fn unit(&self, is_angular: bool) -> Option<Unit> {
        self.unit_called(&["UNIT", if is_angular { "ANGLEUNIT" } else { "LENGTHUNIT" }], is_angular)
    }

    fn unit_called(&self, words: &[&str], is_angular: bool) -> Option<Unit> {
        let node = self.nodes.iter().find(|node| node.is(words))?;
        let (name, number) = (node.values.first()?, node.values.get(1).map(|number| number.parse::<f64>().ok()));
        match number {
            // What should be a number and is none is no unit.
            Some(None) => None,
            Some(Some(number)) if is_angular => Unit::of_degrees(number.to_degrees()),
            number => Unit::of_name_and_metres(name, number.flatten()),
        }
    }

    fn level_code(&self) -> Option<u32> {
        if self.is(&COMPOUND) {
            return self.nodes.iter().find_map(Self::level_code);
        }
        self.code().filter(|_| self.is(&PROJECTED) || self.is(&GEOGRAPHIC) || self.is(&GEODETIC))
    }

    fn code(&self) -> Option<u32> {
        let id = self.nodes.iter().find(|node| node.is(&["ID", "AUTHORITY"]))?;
        let [authority, code, ..] = id.values.as_slice() else { return None };
        code.parse().ok().filter(|_| authority.eq_ignore_ascii_case("EPSG"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const METRE: Option<Unit> = Some(Unit::Metre);
    const DEGREE: Option<Unit> = Some(Unit::Degree);
    const GEOGRAPHIC: &str =
        r#"GEOGCS["WGS 84",DATUM["x",SPHEROID["y",6378137,298.2]],UNIT["degree",0.0174532925199433]]"#;

    fn of(text: &str) -> (Option<Unit>, Option<Unit>) {
        let Units { level, height } = units(text);
        (level, height)
    }

    #[test]
    fn well_known_text_of_version_1_says_its_own_units() {
        assert_eq!(of(GEOGRAPHIC), (DEGREE, None));
        let metres =
            format!(r#"PROJCS["a [ft]",{GEOGRAPHIC},PARAMETER["z",1],UNIT["metre",1,AUTHORITY["EPSG","9001"]]]"#);
        assert_eq!(of(&metres), (METRE, None));
        let vertical = r#"VERT_CS["h",VERT_DATUM["d",2005],UNIT["US survey foot",0.304800609601219],AXIS["Up",UP]]"#;
        let both = (METRE, Some(Unit::SurveyFoot));
        assert_eq!(of(&format!(r#"COMPD_CS["both",{metres},{vertical}]"#)), both);
        assert_eq!(of(&format!(r#"fitted_cs["f",PARAM_MT["Affine"],{metres}]"#)), (METRE, None));
        assert_eq!(of(r#"LOCAL_CS["site",LOCAL_DATUM["d",0],UNIT["foot",0.3048],AXIS["E",EAST]]"#).0, Some(Unit::Foot));
        assert_eq!(of(r#"GEOCCS["c",DATUM["x",SPHEROID["y",6378137,298.2]],UNIT["metre",1]]"#), (METRE, None));
        let gons = GEOGRAPHIC.replace("0.0174532925199433", "0.0157079632679489");
        assert_eq!(of(&gons), (Some(Unit::Angle(0.9)), None));
    }

    #[test]
    fn well_known_text_of_version_2_says_the_units_of_its_axes() {
        let base = r#"BASEGEOGCRS["c",DATUM["d",ELLIPSOID["e",6378137,298,LENGTHUNIT["metre",1]]],
            PRIMEM["Greenwich",0,ANGLEUNIT["degree",0.0174532925199433]]]"#;
        let feet = r#"LENGTHUNIT["foot",0.3048]"#;
        let projected = format!(
            r#"PROJCRS["b",{base},CONVERSION["v",METHOD["m"],PARAMETER["p",0,LENGTHUNIT["metre",1]]],
            CS[Cartesian,2],AXIS["(E)",east,ORDER[1],{feet}],AXIS["(N)",north,ORDER[2],{feet}]]"#
        );
        assert_eq!(of(&projected), (Some(Unit::Foot), None));
        let height = r#"VERTCRS["h",VDATUM["d"],CS[vertical,1],AXIS["height (H)",up,LENGTHUNIT["metre",1]]]"#;
        let compound = format!(r#"COMPOUNDCRS["both",{projected},{height}]"#);
        assert_eq!(of(&compound), (Some(Unit::Foot), METRE));
        let bound = format!(r#"BOUNDCRS[SOURCECRS[{compound}],TARGETCRS[{GEOGRAPHIC}],ABRIDGEDTRANSFORMATION["t"]]"#);
        assert_eq!(of(&bound), (Some(Unit::Foot), METRE));
        // The unit may stand once, behind the axes, and a third axis may have another one.
        let once = format!(r#"PROJECTEDCRS["b",{base},CS[Cartesian,2],AXIS["x",east],AXIS["y",north],{feet}]"#);
        assert_eq!(of(&once), (Some(Unit::Foot), None));
        let flat = projected.strip_suffix(']').unwrap();
        assert_eq!(of(&format!(r#"{flat},AXIS["h",up,LENGTHUNIT["metre",1]]]"#)), (Some(Unit::Foot), METRE));
        let geodetic = |kind: &str| {
            let axis =
                if kind == "Cartesian" { r#"LENGTHUNIT["metre",1]"# } else { r#"ANGLEUNIT["degree",0.01745329252]"# };
            format!(
                r#"GEODCRS["g",DATUM["d",ELLIPSOID["e",6378137,298]],CS[{kind},3],AXIS["a",north,{axis}],
            AXIS["h",up,LENGTHUNIT["US survey foot",0.304800609601219]]]"#
            )
        };
        assert_eq!(of(&geodetic("ellipsoidal")), (DEGREE, Some(Unit::SurveyFoot)));
        assert_eq!(of(&geodetic("Cartesian")), (METRE, Some(Unit::SurveyFoot)));
        assert_eq!(of(&geodetic("spherical")), (None, None));
        for text in [projected, compound, bound, once, geodetic("ellipsoidal")] {
            assert_eq!(of(&text.to_lowercase()), of(&text), "{text}");
            assert_eq!(of(&text.replace('[', " (").replace(']', ")\r\n")), of(&text), "{text}");
        }
    }

    #[test]
    fn the_dialect_of_esri_puts_heights_beside_the_map() {
        let text = r#"PROJCS["NAD_1983_StatePlane",GEOGCS["g",DATUM["d",SPHEROID["s",6378137.0,298.2]],PRIMEM["Greenwich",0.0],
            UNIT["Degree",0.0174532925199433]],PROJECTION["Lambert"],UNIT["Foot_US",0.3048006096012192]],
            VERTCS["NAVD_1988",VDATUM["v"],PARAMETER["Vertical_Shift",0.0],PARAMETER["Direction",1.0],UNIT["Meter",1.0]]"#;
        assert_eq!(of(text), (Some(Unit::SurveyFoot), METRE));
        let solid = GEOGRAPHIC.replace("433]]", r#"433],LINUNIT["Meter",1.0]]"#);
        assert_eq!(of(&solid), (DEGREE, METRE));
        assert_eq!(of(&format!("ESRI PE String = {text}")), (Some(Unit::SurveyFoot), METRE));
    }

    #[test]
    fn a_system_without_a_unit_has_that_of_its_code() {
        assert_eq!(of(r#"PROJCS["x",AUTHORITY["EPSG","2927"]]"#), (Some(Unit::SurveyFoot), None));
        assert_eq!(of(r#"PROJCRS["x",ID["EPSG",2927]]"#), (Some(Unit::SurveyFoot), None));
        assert_eq!(of(r#"VERT_CS["x",AUTHORITY["EPSG","5703"]]"#), (None, METRE));
        assert_eq!(of(r#"PROJCS["x",AUTHORITY["ESRI","2927"]]"#), (None, None));
        assert_eq!(code(r#"PROJCRS["x",ID["EPSG",2927]]"#), Some(2927));
        let whole = r#"COMPD_CS["x",PROJCS["y",AUTHORITY["EPSG","2927"]],VERT_CS["z",AUTHORITY["EPSG","5703"]],AUTHORITY["EPSG","1"]]"#;
        assert_eq!((level_code(whole), is_text(whole), is_text("NAD83 / BC Albers")), (Some(2927), true, false));
        assert!(!is_text("NAD83(HARN) / Washington South (ftUS)"));
        assert_eq!(level_code(r#"VERTCRS["x",ID["EPSG",5703]]"#), None);
    }

    #[test]
    fn what_is_no_system_says_no_units() {
        let deep = "UNIT[".repeat(100_000);
        let long = format!(r#"PROJCS["a",UNIT["metre",1]{}]"#, ",1".repeat(MOST_PARTS));
        for odd in ["", "NAD83 / UTM zone 15N", "PROJCS[UNIT[", "]]]UNIT[\"m\",1]", "é[\"", &deep, &long] {
            assert_eq!(of(odd), (None, None), "{:.30}", odd);
        }
        assert_eq!(of(r#"PROJCS["a",UNIT["none",0]]"#), (None, None));
        assert_eq!(of(r#"PROJCS["a",UNIT["metre",one]]"#), (None, None));
        // Cut short behind its unit.
        assert_eq!(of(r#"PROJCS["a",UNIT["metre",1],AUTHORITY["EP"#), (METRE, None));
    }
}
