//! The map of the surfaces of a scan and a sample of its points: what mirrors are looked for in, and what one is measured
//! by while a person moves it.

use std::sync::{Mutex, PoisonError};

use cloud::{Progress, hash};
use glam::DVec3;
use rayon::prelude::*;
use scene::Mirror;

use crate::evidence::{Extent, Points};
use crate::refine::{Seen, fits, fitted, some_of};
use crate::surface_map::{MapBuilder, SurfaceMap};
use crate::unfold::{Mirrors, Reflector};

/// The points of the sample, of all stations together.
const SAMPLED: u64 = 400_000;
/// The grids of the map, the widest of which reaches eight of its finest edges to both sides of a surface.
const LEVELS: usize = 5;
/// The least distance of a ghost from a mirror, in edges of the finest cells.
pub(crate) const BEHIND: f64 = 4.0;
/// The points among which made columns were found (docs/ghosts.md).
const ENOUGH: usize = 300_000;
/// The fewest points that say where a mirror is.
const FEWEST_POINTS: usize = 60;

/// A point of the sample, with the normal of its surface.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    pub place: DVec3,
    pub station: Option<usize>,
    pub normal: Option<DVec3>,
}

/// The surfaces of a scan, and a sample of its points.
pub struct Gauge {
    pub(crate) stations: Vec<DVec3>,
    pub(crate) map: SurfaceMap,
    pub(crate) samples: Vec<Sample>,
}

/// How well points that were seen in a mirror fit the surfaces of the scan when they are unfolded by it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// The points of the sample that were seen in it, and those of them that have a surface near their unfolded place.
    pub points: u64,
    pub near: u64,
    /// The median distance from these surfaces in world units, of points that say where the mirror is: a floor does not of
    /// a column or an upright plane, to which it fits anywhere. `None` if there are none.
    pub median: Option<f64>,
}

impl Gauge {
    /// Reads points once, of which there are `total`. `None` when cancelled.
    ///
    /// # Errors
    /// The points cannot be read.
    pub fn of<P: Points>(
        points: &P,
        stations: &[DVec3],
        extent: Extent,
        total: u64,
        progress: &Progress,
    ) -> Result<Option<Self>, P::Error> {
        let step = total.div_ceil(SAMPLED).max(1);
        let builder = MapBuilder::new(extent.origin, extent.edge).with_levels(LEVELS);
        let samples = Mutex::new(Vec::new());
        points.read(&|block| {
            builder.add(block.places.iter().copied());
            let is_taken = |index: usize| hash(block.first_point + index as u64).is_multiple_of(step);
            let taken = (0..block.places.len()).filter(|index| is_taken(*index) && block.places[*index].is_finite());
            let sample = |index: usize| {
                let sample = Sample { place: block.places[index], station: block.station, normal: None };
                ((block.file, block.first_point + index as u64), sample)
            };
            let mut own: Vec<_> = taken.map(sample).collect();
            samples.lock().unwrap_or_else(PoisonError::into_inner).append(&mut own);
        })?;
        if progress.is_cancelled() {
            return Ok(None);
        }
        let map = builder.finish();
        let mut samples = samples.into_inner().unwrap_or_else(PoisonError::into_inner);
        samples.sort_unstable_by_key(|(place, _)| *place);
        let normal = |place: DVec3| map.nearest(place).map(|fit| fit.patch.normal.as_dvec3());
        let samples: Vec<Sample> =
            samples.into_par_iter().map(|(_, sample)| Sample { normal: normal(sample.place), ..sample }).collect();
        Ok(Some(Self { stations: stations.to_vec(), map, samples }))
    }

    /// The number of points, if there are so few that mirrors may be missed.
    pub fn too_few(&self) -> Option<usize> {
        Some(self.samples.len()).filter(|count| *count < ENOUGH)
    }

    /// The points of the sample that lie behind a mirror, as a station sees them.
    fn seen_in(&self, mirror: &Mirror) -> Vec<Seen> {
        let mirrors = Mirrors::new(vec![Reflector::exact(mirror.clone())]);
        let margin = BEHIND * self.map.edge();
        let seen = |sample: &Sample| {
            let own = sample.station.map_or(0..self.stations.len(), |station| station..station + 1);
            let stations = own.map(|station| self.stations[station]);
            let is_behind = |station: &DVec3| !mirrors.ways(*station, sample.place, margin).is_empty();
            stations.filter(is_behind).map(|station| (station, sample.place)).collect::<Vec<_>>()
        };
        self.samples.par_iter().flat_map_iter(seen).collect()
    }

    /// How well the points that were seen in a mirror fit when they are unfolded by it.
    pub fn measured(&self, mirror: &Mirror) -> Residual {
        let seen = self.seen_in(mirror);
        let fits = fits(mirror, &seen, &self.map);
        let telling = fits.iter().filter(|(_, tells)| *tells);
        let mut telling: Vec<f64> = telling.map(|(distance, _)| distance.abs()).collect();
        let middle = telling.len() / 2;
        let median = (!telling.is_empty()).then(|| *telling.select_nth_unstable_by(middle, f64::total_cmp).1);
        Residual { points: seen.len() as u64, near: fits.len() as u64, median }
    }

    /// The mirror moved from where it stands to where these points fit best; `None` if too few were seen in it.
    pub fn fitted(&self, mirror: &Mirror) -> Option<Mirror> {
        let seen = some_of(&self.seen_in(mirror));
        (seen.len() >= FEWEST_POINTS).then(|| fitted(mirror, &seen, &self.map))
    }
}
