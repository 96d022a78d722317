//! Clouds that cannot be seen together: tiles that lie far apart, or have different coordinate systems.

use std::collections::BTreeSet;

use cloud::Bounds;
use codec::Units;

/// Clouds with a gap of more than so many times the larger one's diameter are apart: seen together, each would be a few
/// pixels wide.
const FAR: f64 = 10.0;

/// What is wrong with seeing clouds together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Apart {
    /// For each cloud, whether it is near the one with the most points.
    pub is_near: Vec<bool>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

impl Apart {
    pub fn of(places: &[Place]) -> Self {
        let bounds: Vec<Bounds> = places.iter().map(|place| place.bounds).collect();
        let groups = groups(&bounds);
        let seen = (0..places.len()).filter(|index| !bounds[*index].is_empty());
        let Some(largest) = seen.max_by_key(|index| (places[*index].points, usize::MAX - index)) else {
            return Self { is_near: vec![true; places.len()], warnings: Vec::new() };
        };
        let shown = &places[largest];
        let is_near: Vec<bool> = groups.iter().map(|group| *group == groups[largest]).collect();
        let mut warnings = Vec::new();
        for (place, is_near) in places.iter().zip(&is_near).filter(|(place, _)| !place.bounds.is_empty()) {
            let difference = place.difference(shown);
            if !is_near {
                // Between coordinates of several systems or units, no unit is that of the number.
                let unit =
                    shown.units.length().filter(|unit| difference.is_none() && place.units.length() == Some(*unit));
                let unit = unit.map_or("units".into(), |unit| unit.to_string());
                warnings.push(format!(
                    "{} lies {} {unit} away from {}{}",
                    place.name,
                    rounded(gap(shown.bounds, place.bounds)),
                    shown.name,
                    difference.map_or(String::new(), |difference| format!("; it has {difference}"))
                ));
            } else if let Some(difference) = difference {
                warnings.push(format!("{} has {difference} than {}", place.name, shown.name));
            }
        }
        // Clouds with the same units are reported once.
        let mut told = BTreeSet::new();
        let mixed = places.iter().filter_map(|place| Some((place.name, place.units.warning()?)));
        let mixed = mixed.filter(|(_, warning)| told.insert(warning.clone()));
        warnings.extend(mixed.map(|(name, warning)| format!("{name}: {warning}")));
        Self { is_near, warnings }
    }
}

/// The distance between two clouds that are far apart; `None` for others.
pub fn far_gap(one: Bounds, other: Bounds) -> Option<f64> {
    let is_far = !one.is_empty() && !other.is_empty() && !are_near(one, other);
    is_far.then(|| gap(one, other))
}

/// A number for each of these bounds, the same for those that are near each other: what is near something near is near.
/// What is empty is near nothing.
pub(crate) fn groups(bounds: &[Bounds]) -> Vec<usize> {
    let mut groups: Vec<usize> = (0..bounds.len()).collect();
    for first in 0..bounds.len() {
        let mut next = vec![first];
        while let Some(from) = next.pop().filter(|_| groups[first] == first) {
            for other in first + 1..bounds.len() {
                if groups[other] == other && are_near(bounds[from], bounds[other]) {
                    groups[other] = first;
                    next.push(other);
                }
            }
        }
    }
    groups
}

/// Where a cloud lies.
pub struct Place<'a> {
    pub(crate) name: &'a str,
    /// Without stray points.
    pub(crate) bounds: Bounds,
    pub(crate) points: u64,
    /// The name of its coordinate system.
    pub(crate) system: Option<&'a str>,
    pub(crate) units: Units,
}

impl Place<'_> {
    /// How its coordinate system differs from another one.
    fn difference(&self, other: &Self) -> Option<String> {
        codec::system_difference((self.system, &self.units), (other.system, &other.units))
    }
}

/// A distance with commas between groups of three digits.
fn rounded(distance: f64) -> String {
    if distance < 10.0 {
        return format!("{distance:.2}");
    }
    let digits = format!("{distance:.0}");
    let mut grouped = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    grouped
}

fn are_near(a: Bounds, b: Bounds) -> bool {
    let largest = a.radius().max(b.radius()) * 2.0;
    !a.is_empty() && !b.is_empty() && gap(a, b) <= FAR * largest.max(f64::MIN_POSITIVE)
}

/// The distance between two boxes that are not empty; 0 if they touch.
fn gap(a: Bounds, b: Bounds) -> f64 {
    (b.min - a.max).max(a.min - b.max).max(glam::DVec3::ZERO).length()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn place(name: &'static str, x: f64, points: u64, system: Option<&'static str>) -> Place<'static> {
        let min = DVec3::new(x, 0.0, 0.0);
        Place { name, bounds: Bounds { min, max: min + DVec3::splat(100.0) }, points, system, units: Units::default() }
    }

    #[test]
    fn the_largest_tile_and_its_neighbours_are_near_and_others_are_told_with_their_distance() {
        let places = [
            place("small", 9e5, 10, Some("A")),
            place("large", 100.0, 1000, Some("A")),
            place("beside", 200.0, 5, Some("A")),
            place("row", 1500.0, 5, None),
            place("other", 5e6, 7, Some("B")),
        ];
        let apart = Apart::of(&places);
        assert_eq!(apart.is_near, [false, true, true, true, false]);
        assert_eq!(
            apart.warnings,
            [
                "small lies 899,800 units away from large",
                "other lies 4,999,800 units away from large; it has another coordinate system"
            ]
        );
    }

    #[test]
    fn a_distance_has_a_unit_only_where_all_of_its_coordinates_have_that() {
        let in_unit = |name, x, points, unit, system| {
            let units = codec::Units { level: unit, height: unit };
            Place { units, ..place(name, x, points, system) }
        };
        let (metre, foot) = (Some(codec::Unit::Metre), Some(codec::Unit::Foot));
        let told = |other, system| {
            let places = [in_unit("a", 0.0, 9, metre, Some("A")), in_unit("b", 5e6, 1, other, Some(system))];
            Apart::of(&places).warnings.concat()
        };
        assert_eq!(told(metre, "A"), "b lies 4,999,900 m away from a");
        assert_eq!(told(metre, "B"), "b lies 4,999,900 units away from a; it has another coordinate system");
        assert_eq!(told(None, "A"), "b lies 4,999,900 units away from a");
        assert!(told(foot, "A").starts_with("b lies 4,999,900 units away from a; it has "), "{}", told(foot, "A"));
    }

    #[test]
    fn mixed_units_are_told_once_for_all_clouds_that_have_them() {
        let mut places = [place("a", 0.0, 2, None), place("b", 50.0, 1, None), place("c", 99.0, 1, None)];
        let (degree, metre) = (Some(codec::Unit::Degree), Some(codec::Unit::Metre));
        places[1].units = Units { level: degree, height: metre };
        places[2].units = places[1].units;
        let warnings = Apart::of(&places).warnings;
        assert!(
            warnings.len() == 1 && warnings[0].starts_with("b: the units are mixed: x and y are in °"),
            "{warnings:?}"
        );
    }

    #[test]
    fn the_gap_between_clouds_is_told_where_it_is_far() {
        let [a, b, c] = [0.0, 1000.0, 5000.0].map(|x| place("", x, 1, None).bounds);
        assert_eq!((far_gap(a, b), far_gap(a, c), far_gap(a, Bounds::EMPTY)), (None, Some(4900.0), None));
    }

    #[test]
    fn tiles_side_by_side_with_different_systems_are_told() {
        let apart = Apart::of(&[place("a", 0.0, 2, Some("A")), place("b", 50.0, 1, Some("B"))]);
        assert_eq!(apart.is_near, [true, true]);
        assert_eq!(apart.warnings, ["b has another coordinate system than a"]);
        let mut places = [place("a", 0.0, 2, Some("A")), place("b", 50.0, 1, Some("A"))];
        places[0].units.level = Some(codec::Unit::Metre);
        places[1].units.level = Some(codec::Unit::Foot);
        assert_eq!(Apart::of(&places).warnings, ["b has another unit of x and y (ft, not m) than a"]);
        let empty = Place { name: "c", bounds: Bounds::EMPTY, points: 0, system: None, units: Units::default() };
        assert_eq!(Apart::of(&[empty]), Apart { is_near: vec![true], warnings: Vec::new() });
    }
}
