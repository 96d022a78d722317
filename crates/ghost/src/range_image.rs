//! How far a station sees in each direction: the range of the nearest surface.

use std::f64::consts::{PI, TAU};
use std::sync::atomic::{AtomicU32, Ordering};

use glam::DVec3;

/// Pixels around, and half as many from pole to pole: half a degree each.
const COLUMNS: usize = 720;
const ROWS: usize = COLUMNS / 2;

/// The least range of the points in each direction about a station.
pub struct RangeImage {
    station: DVec3,
    /// The bits of positive floats, which are in the order of the floats.
    ranges: Vec<AtomicU32>,
}

/// What a station knows of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sight {
    /// No point in that direction.
    Unknown,
    /// The station sees a surface behind the place.
    Through,
    /// The place is where the station sees a surface.
    On,
    /// A surface stands before the place.
    Hidden,
}

impl RangeImage {
    pub fn new(station: DVec3) -> Self {
        Self { station, ranges: (0..COLUMNS * ROWS).map(|_| AtomicU32::new(f32::INFINITY.to_bits())).collect() }
    }

    fn pixel(&self, place: DVec3) -> Option<(usize, f64)> {
        let way = place - self.station;
        let range = way.length();
        if !(range > 0.0 && range.is_finite()) {
            return None;
        }
        let across = (way.y.atan2(way.x) / TAU + 0.5) * COLUMNS as f64;
        let down = (way.z / range).clamp(-1.0, 1.0).acos() / PI * ROWS as f64;
        Some(((down as usize).min(ROWS - 1) * COLUMNS + (across as usize).min(COLUMNS - 1), range))
    }

    pub fn add(&self, place: DVec3) {
        if let Some((pixel, range)) = self.pixel(place) {
            self.ranges[pixel].fetch_min((range as f32).to_bits(), Ordering::Relaxed);
        }
    }

    /// `tolerance` is how far a place may be from a surface that it is on. A surface that is seen aslant covers more
    /// ranges within a pixel.
    pub fn sight(&self, place: DVec3, tolerance: f64) -> Sight {
        let Some((pixel, range)) = self.pixel(place) else { return Sight::Unknown };
        let seen = f64::from(f32::from_bits(self.ranges[pixel].load(Ordering::Relaxed)));
        let tolerance = tolerance + range * (TAU / COLUMNS as f64) * 3.0;
        match seen {
            seen if seen.is_infinite() => Sight::Unknown,
            seen if range < seen - tolerance => Sight::Through,
            seen if range > seen + tolerance => Sight::Hidden,
            _ => Sight::On,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_station_sees_through_places_before_a_wall_and_none_behind_it() {
        let station = DVec3::new(1.0, 2.0, 1.5);
        let image = RangeImage::new(station);
        for index in 0..40_000 {
            image.add(
                station + DVec3::new(5.0, f64::from(index % 200) * 0.02 - 2.0, f64::from(index / 200) * 0.02 - 2.0),
            );
        }
        let sight = |x: f64| image.sight(station + DVec3::new(x, 0.1 * x, 0.1 * x), 0.05);
        assert_eq!([sight(3.0), sight(5.0), sight(7.0)], [Sight::Through, Sight::On, Sight::Hidden]);
        assert_eq!(image.sight(station - DVec3::X, 0.05), Sight::Unknown);
    }
}
