//! The units of the coordinate systems of the EPSG. epsg.txt has all of its projected, geographic, geocentric, vertical
//! and compound systems; it was made from the database of PROJ, whose numbers come from the EPSG.

use super::unit::{Unit, Units};

const TABLE: &str = include_str!("epsg.txt");

/// The unit with a code of the EPSG.
pub fn unit(code: u16) -> Option<Unit> {
    let line = TABLE.lines().filter(|line| line.starts_with(['l', 'a'])).find_map(|line| {
        let mut words = line.split(' ');
        let kind = words.next()?;
        let is_it = words.next()?.parse() == Ok(code);
        is_it.then(|| words.next()?.parse::<f64>().ok().map(|number| (kind, number)))?
    });
    match line? {
        ("length", metres) => Unit::of_metres(metres),
        (_, degrees) => Unit::of_degrees(degrees),
    }
}

/// The units of the coordinates in the system with a code of the EPSG. A system on the map says nothing of heights, and a
/// vertical one nothing of places on the map.
pub fn units(code: u32) -> Option<Units> {
    let has = |codes: &str| {
        let (first, last) = codes.split_once('-').unwrap_or((codes, codes));
        first.parse().is_ok_and(|first: u32| first <= code) && last.parse().is_ok_and(|last: u32| code <= last)
    };
    TABLE.lines().filter_map(|line| line.strip_prefix("units ")).find_map(|line| {
        let mut words = line.split(' ');
        let (level, height) = (words.next()?, words.next()?);
        let of = |code: &str| code.parse().ok().and_then(unit);
        words.any(has).then(|| Units { level: of(level), height: of(height) })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_of_the_epsg_have_their_units() {
        let of = |code: u32| units(code).map(|units| (units.level, units.height));
        let (metre, foot, survey) = (Some(Unit::Metre), Some(Unit::Foot), Some(Unit::SurveyFoot));
        assert_eq!(of(26910), Some((metre, None)));
        assert_eq!(of(32767), None);
        assert_eq!(of(2927), Some((survey, None)));
        assert_eq!(of(2994), Some((foot, None)));
        assert_eq!(of(4326), Some((Some(Unit::Degree), None)));
        assert_eq!(of(4979), Some((Some(Unit::Degree), metre)));
        assert_eq!(of(4978), Some((metre, None)));
        assert_eq!(of(4807), Some((Some(Unit::Angle(0.9)), None)));
        assert_eq!(of(5703), Some((None, metre)));
        assert_eq!(of(6360), Some((None, survey)));
        assert_eq!(of(8228), Some((None, foot)));
        assert_eq!(of(22300), Some((Some(Unit::Other(1000.0)), None)));
        assert_eq!(of(8800), Some((survey, survey)), "a compound system");
        assert_eq!((of(0), of(1), of(99_999)), (None, None, None));
    }

    #[test]
    fn each_system_of_the_table_has_units_that_the_table_knows() {
        let mut systems = 0;
        for line in TABLE.lines().filter_map(|line| line.strip_prefix("units ")) {
            let words: Vec<&str> = line.split(' ').collect();
            for code in words[..2].iter().filter(|code| **code != "-") {
                assert!(unit(code.parse().unwrap()).is_some(), "{line}");
            }
            for codes in &words[2..] {
                let (first, last) = codes.split_once('-').unwrap_or((codes, codes));
                let [first, last] = [first, last].map(|code| code.parse::<u32>().unwrap());
                systems += last - first + 1;
            }
        }
        assert_eq!(systems, 7537);
    }
}
