//! How often the intervals held that a surface states for its own error (`cloud::surface_errors`).

use std::f64::consts::PI;

use cloud::{SPLAT_OVERLAP, STATED};
use serde::Serialize;

/// The least angles between sightlines and normals of bins, in degrees.
const INCIDENCES: [f64; 4] = [0.0, 30.0, 60.0, 75.0];
/// Bins of distance and of spacing hold as many sightlines each, in so many parts.
const PARTS: usize = 4;

/// What a surface states where a sightline meets it, and its true error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stated {
    /// How far behind the point that was held out the surface is, in world units.
    pub error: f64,
    /// The half width of the interval along the sightline.
    pub half_width: f64,
    pub distance: f64,
    /// The angle between sightline and normal, in degrees.
    pub incidence: f64,
    /// The distance between neighbouring points.
    pub spacing: f64,
}

/// How often the stated interval held, over the sightlines of a bin that meet the surface within 1 % of their distance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// `all`, or the quantity with its least and its largest value: `distance 1.2 to 3.45`.
    pub bin: String,
    pub rays: usize,
    /// How often the interval should hold.
    pub stated: f64,
    /// How often it held.
    pub held: f64,
    /// The median half width along the sightline, in world units: wide intervals hold more easily.
    pub half_width: f64,
}

/// The spacing of points whose splats have this radius along their long axis, and this ratio of axes: a splat has
/// `SPLAT_OVERLAP` squared times its point's share of area.
pub(crate) fn spacing(radius: f64, ratio: f64) -> f64 {
    (PI / ratio).sqrt() * radius / f64::from(SPLAT_OVERLAP)
}

/// All sightlines, and those of bins of distance, of incidence and of spacing. Bins without any are left out.
pub(crate) fn intervals(stated: &[Stated]) -> Vec<Interval> {
    let known: Vec<&Stated> = stated.iter().filter(|stated| !stated.half_width.is_nan()).collect();
    let bins = |name: &str, edges: &[f64], value: &dyn Fn(&Stated) -> f64| -> Vec<Interval> {
        let is_last = |at: usize| at + 2 == edges.len();
        let ends = edges.windows(2).enumerate();
        let bin = |(at, ends): (usize, &[f64])| {
            let is_in = |value: f64| value >= ends[0] && (value < ends[1] || is_last(at) && value <= ends[1]);
            let own: Vec<&Stated> = known.iter().copied().filter(|stated| is_in(value(stated))).collect();
            Interval::of(format!("{name} {} to {}", short(ends[0]), short(ends[1])), &own)
        };
        ends.filter_map(bin).collect()
    };
    let mut found: Vec<Interval> = Interval::of("all".into(), &known).into_iter().collect();
    let quarters = |value: &dyn Fn(&Stated) -> f64| quantiles(known.iter().map(|stated| value(stated)).collect());
    let incidences: Vec<f64> = INCIDENCES.into_iter().chain([90.0]).collect();
    found.extend(bins("distance", &quarters(&|stated| stated.distance), &|stated| stated.distance));
    found.extend(bins("incidence", &incidences, &|stated| stated.incidence));
    found.extend(bins("spacing", &quarters(&|stated| stated.spacing), &|stated| stated.spacing));
    found
}

impl Interval {
    fn of(bin: String, stated: &[&Stated]) -> Option<Self> {
        let held = stated.iter().filter(|stated| stated.error.abs() <= stated.half_width).count();
        let mut widths: Vec<f64> = stated.iter().map(|stated| stated.half_width).collect();
        let middle = widths.len() / 2;
        (!stated.is_empty()).then(|| Self {
            bin,
            rays: stated.len(),
            stated: STATED,
            held: held as f64 / stated.len() as f64,
            half_width: *widths.select_nth_unstable_by(middle, f64::total_cmp).1,
        })
    }
}

/// The values between equal parts of all, ends included.
fn quantiles(mut values: Vec<f64>) -> Vec<f64> {
    values.retain(|value| value.is_finite());
    values.sort_unstable_by(f64::total_cmp);
    match values.len() {
        0 => Vec::new(),
        count => (0..=PARTS).map(|part| values[(count - 1) * part / PARTS]).collect(),
    }
}

/// A number of three digits for people.
fn short(value: f64) -> String {
    let decimals = if value > 0.0 { (2 - value.log10().floor() as i32).clamp(0, 9) as usize } else { 0 };
    let text = format!("{value:.decimals$}");
    if decimals > 0 { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hundred sightlines of which the nearer half is off by half of what is stated, and the others by twice that.
    fn sightlines() -> Vec<Stated> {
        let one = |at: usize| Stated {
            error: if at < 50 { 0.05 } else { -0.2 },
            half_width: 0.1,
            distance: 1.0 + at as f64,
            incidence: 50.0,
            spacing: 0.02,
        };
        (0..100).map(one).collect()
    }

    #[test]
    fn what_holds_is_counted_by_bins() {
        let found = intervals(&sightlines());
        let of = |name: &str| -> Vec<(usize, f64)> {
            found.iter().filter(|bin| bin.bin.starts_with(name)).map(|bin| (bin.rays, bin.held)).collect()
        };
        assert_eq!(of("all"), [(100, 0.5)]);
        let distances = of("distance");
        assert_eq!(distances.iter().map(|(_, held)| *held).collect::<Vec<_>>(), [1.0, 1.0, 0.04, 0.0], "{found:?}");
        assert_eq!(distances.iter().map(|(rays, _)| rays).sum::<usize>(), 100);
        assert_eq!(of("incidence 30 to 60"), [(100, 0.5)]);
        assert_eq!(of("incidence").len(), 1, "bins without sightlines are left out");
        // All have one spacing, which is in one bin.
        assert_eq!(of("spacing 0.02 to 0.02"), [(100, 0.5)]);
        assert!(found.iter().all(|bin| bin.stated == 0.95 && bin.half_width == 0.1));
    }

    #[test]
    fn sightlines_without_an_interval_count_nowhere() {
        let unknown = Stated { half_width: f64::NAN, ..sightlines()[0] };
        assert_eq!(intervals(&[unknown]), []);
        assert_eq!(intervals(&[]), []);
    }

    #[test]
    fn spacings_follow_from_radii_of_splats() {
        // A disc of an even unit grid has four times the area of a cell.
        let radius = 2.0 / PI.sqrt();
        assert!((spacing(radius, 1.0) - 1.0).abs() < 1e-12 && (spacing(radius * 2.0, 4.0) - 1.0).abs() < 1e-12);
    }
}
