//! Which points are ghosts: evidence for each point whose sightline meets a mirror, and what is decided by it.
//!
//! Points are read three times, block by block. First, points on sightlines that meet no mirror make a map of the
//! surfaces and the range images of the stations. Then each suspected point is weighed: unfolded it fits a surface or
//! not; another station sees through it, or sees a surface there. Its neighbours behind the mirror say what share of
//! them are ghosts, by the likelihoods of all of them (expectation and maximisation), and that share is the probability
//! from which the point's own evidence starts. Memory is that of the map, of the neighbourhoods and of the suspects.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use cloud::{Progress, hash};
use glam::DVec3;
use trace::scan::MOST_MEETINGS;

use crate::range_image::{RangeImage, Sight};
use crate::strength::{Compared, Return, ShareFit, Strengths, StrengthsBuilder};
use crate::surface_map::{ByKey, Fit, MapBuilder, SurfaceMap, key_of};
use crate::unfold::{Mirrors, ScannerError, Way};

/// Some points of a file in a row.
pub struct Block {
    pub file: usize,
    /// The index in the file of the first point.
    pub first_point: u64,
    /// The index of the station that saw them, if the file names it.
    pub station: Option<usize>,
    /// Points that are hidden or not finite are NaN.
    pub places: Vec<DVec3>,
    /// What the scanner noted of the strength of each return, in any unit; empty if it is not known.
    pub intensities: Vec<f32>,
}

impl Block {
    fn intensity(&self, index: usize) -> Option<f32> {
        self.intensities.get(index).copied()
    }

    /// The station, where it is known.
    fn only_station(&self, stations: usize) -> Option<usize> {
        self.station.or((stations == 1).then_some(0))
    }
}

/// Points that can be read again and again.
pub trait Points: Sync {
    type Error;

    /// Calls `give` with all points, block by block, from any number of threads. It may stop early when the task is
    /// cancelled.
    ///
    /// # Errors
    /// The points cannot be read.
    fn read(&self, give: &(dyn Fn(&Block) + Sync)) -> Result<(), Self::Error>;
}

/// What a point is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Real,
    Ghost,
    Undecided,
}

impl Kind {
    /// The number in files: 0 real, 1 ghost, 2 undecided.
    pub fn number(self) -> u8 {
        match self {
            Self::Real => 0,
            Self::Ghost => 1,
            Self::Undecided => 2,
        }
    }
}

/// A point whose sightline meets a mirror.
#[derive(Clone, Copy, Debug)]
pub struct Suspect {
    /// The index of the point among those of its block.
    pub index: u32,
    pub kind: Kind,
    /// The numbers, from 1, of the mirrors on its way, in its order; 0 after the last, and for a real point.
    pub mirrors: [u8; MOST_MEETINGS],
    /// How probable it is that the point is a ghost.
    pub probability: f32,
    /// Where it is if it is a ghost.
    pub place: DVec3,
    /// The half width of the interval about `place` that holds the point in 95 of 100 cases.
    pub error: f32,
    /// How far `place` is from a surface, if one is near.
    pub distance: Option<f32>,
}

impl Suspect {
    /// The number, from 1, of the mirror that it was seen in first.
    pub fn mirror(&self) -> u8 {
        self.mirrors[0]
    }
}

/// What each suspect among the points is.
pub struct Verdicts {
    /// The suspects of each block, by file and first point, in their order.
    pub suspects: BTreeMap<(usize, u64), Vec<Suspect>>,
    /// The standard deviation of ranges.
    pub noise: f64,
}

impl Verdicts {
    pub fn count(&self, kind: Kind) -> u64 {
        self.suspects.values().flatten().filter(|suspect| suspect.kind == kind).count() as u64
    }

    /// The verdicts if only these mirrors are: all other suspects are real.
    pub fn of_mirrors(&self, is_one: impl Fn(usize) -> bool) -> Self {
        let is_kept = |suspect: &&Suspect| {
            let met = suspect.mirrors.iter().filter_map(|mirror| usize::from(*mirror).checked_sub(1));
            suspect.kind != Kind::Real && met.into_iter().all(&is_one)
        };
        let kept = |suspects: &Vec<Suspect>| suspects.iter().filter(is_kept).copied().collect();
        let suspects = self.suspects.iter().map(|(place, suspects)| (*place, kept(suspects))).collect();
        Self { suspects, noise: self.noise }
    }

    /// The number of ghosts of a mirror, and the median distance of their unfolded places from surfaces.
    pub fn of_mirror(&self, mirror: usize) -> (u64, Option<f64>) {
        let is_own = |suspect: &&Suspect| suspect.kind == Kind::Ghost && usize::from(suspect.mirror()) == mirror + 1;
        let own = || self.suspects.values().flatten().filter(is_own);
        let mut distances: Vec<f32> = own().filter_map(|suspect| suspect.distance).collect();
        let middle = distances.len() / 2;
        let residual =
            (!distances.is_empty()).then(|| f64::from(*distances.select_nth_unstable_by(middle, f32::total_cmp).1));
        (own().count() as u64, residual)
    }
}

/// The share of ghosts that have a surface near their unfolded place, and of other points.
const NEAR_GHOST: f64 = 0.85;
const NEAR_OTHER: f64 = 0.2;
/// The share of the ghosts near a surface that are on it.
const ON_SURFACE: f64 = 0.9;
/// The logarithms of how much likelier a point is real where a station sees a surface, sees through, or is hidden.
const SEEN_ON: f64 = 1.1;
const SEEN_THROUGH: f64 = -1.9;
const IS_HIDDEN: f64 = -3.0;
/// How much likelier a point is that lies on a surface of points that are beyond suspicion.
const ON_KNOWN: f64 = 1.4;
/// Points are ghosts from this probability on, and real up to the other one.
pub const GHOST_FROM: f64 = 0.8;
const REAL_TO: f64 = 0.2;
/// A sightline ends at a mirror that it meets less than this share of the map's edge before the point.
const MARGIN: f64 = 0.3;
/// The edge of a neighbourhood, in edges of the map.
const NEIGHBOURHOOD: f64 = 8.0;
/// The steps of the scale on which likelihoods of a neighbourhood are counted, and its end.
const BINS: usize = 24;
const LAST_BIN: f64 = 6.0;
/// How far a point is from the plane of the surface that it fits unfolded, where that surface may go on behind the
/// mirror, in edges of the map; and how much farther for each unit of distance, as the normal of a patch is not exact.
const CONTINUED: f64 = 1.0;
const SLOPE: f64 = 0.5;
/// As many points as the share of ghosts before any evidence counts for.
const PRIOR_POINTS: f64 = 2.0;

/// One of so many suspects serves to find what share of light a pane reflects.
const OF_SUSPECTS: u64 = 8;
/// From this logarithm on, the strength of a return parts a ghost from a real point.
const TELLING: f64 = 0.7;

/// What speaks for a point being a ghost.
struct Weight {
    /// The logarithm of the likelihood as a ghost over that as a real point; infinite where it cannot be real.
    log_ratio: f64,
    station: usize,
    way: Way,
    error: f64,
    fit: Option<Fit>,
    /// Whether the unfolded place parts a ghost from a real point. A floor before a mirror and the floor behind it are mirror
    /// images of each other, so points on it fit in any case.
    is_telling: bool,
    /// Whether the point lies on the surface that goes on from where it is unfolded.
    is_image: bool,
    /// The strength of the return beside those of the surfaces that it may be of.
    strength: Option<Compared>,
}

/// Everything by which points are weighed.
struct Scales<'a> {
    stations: &'a [DVec3],
    mirrors: &'a Mirrors,
    map: SurfaceMap,
    images: Vec<RangeImage>,
    margin: f64,
    scanner: ScannerError,
    /// What is known of the strength of returns, and the shares that panes reflect.
    strengths: Option<Strengths>,
    reflected: ByKey<f64>,
}

/// The number of points by the logarithm of their likelihoods.
type Counts = [u32; BINS];
/// The counts of a neighbourhood, with the key of all points of its mirrors.
type Neighbourhood = (Counts, Option<u64>);

/// Judges which points are ghosts. `edge` is that of the map's finest cells (see `Extent`), `angle_error` the standard
/// deviation of the scanner's directions in radians. `None` when cancelled.
///
/// # Errors
/// The points cannot be read.
pub fn judge<P: Points>(
    points: &P,
    stations: &[DVec3],
    mirrors: &Mirrors,
    extent: Extent,
    angle_error: f64,
    progress: &Progress,
) -> Result<Option<Verdicts>, P::Error> {
    let margin = MARGIN * extent.edge;
    let own = |block: &Block| block.station.map_or(0..stations.len(), |station| station..station + 1);
    let is_suspect = |block: &Block, place: DVec3| {
        own(block).any(|station| {
            let ways = mirrors.ways(stations[station], place, margin);
            ways.iter().any(|way| !way.is_straight())
        })
    };
    let images: Vec<RangeImage> = stations.iter().map(|station| RangeImage::new(*station)).collect();
    let builder = MapBuilder::new(extent.origin, extent.edge);
    let has_strengths = AtomicBool::new(false);
    points.read(&|block| {
        if block.intensities.iter().any(|noted| *noted > 0.0) {
            has_strengths.store(true, Ordering::Relaxed);
        }
        let is_plain = |place: &DVec3| place.is_finite() && !is_suspect(block, *place);
        let plain: Vec<DVec3> = block.places.iter().copied().filter(is_plain).collect();
        builder.add(plain.iter().copied());
        for station in own(block) {
            plain.iter().for_each(|place| images[station].add(*place));
        }
    })?;
    if progress.is_cancelled() {
        return Ok(None);
    }
    let map = builder.finish();
    let scanner = ScannerError { range: map.range_noise(stations), angle: angle_error };
    let (strengths, reflected) = (None, ByKey::default());
    let mut scales = Scales { stations, mirrors, map, images, margin, scanner, strengths, reflected };
    // Behind an opaque mirror all points are ghosts.
    if has_strengths.into_inner() && mirrors.reflectors().iter().any(|reflector| reflector.is_open) {
        scales.strengths = scales.learnt(points, is_suspect)?;
        scales.reflected = scales.shares(points)?;
    }
    let shards: Vec<Mutex<ByKey<Neighbourhood>>> = (0..64).map(|_| Mutex::default()).collect();
    let shard = |key: u64| shards[(hash(key) % 64) as usize].lock().unwrap_or_else(PoisonError::into_inner);
    points.read(&|block| {
        let mut found: ByKey<Neighbourhood> = ByKey::default();
        for (index, place) in block.places.iter().enumerate() {
            let Some(weight) = scales.weigh(*place, block.station, block.intensity(index)) else { continue };
            if weight.log_ratio.is_finite() {
                let bin = bin_of(weight.log_ratio);
                let all = of_mirrors(&weight);
                let (own, mirrors) = found.entry(scales.neighbourhood(*place, &weight)).or_default();
                (own[bin], *mirrors) = (own[bin] + 1, Some(all));
                if weight.is_telling {
                    found.entry(all).or_default().0[bin] += 1;
                }
            }
        }
        for (key, (counts, mirrors)) in found {
            let mut shard = shard(key);
            let known = shard.entry(key).or_default();
            known.0.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
            known.1 = mirrors.or(known.1);
        }
    })?;
    if progress.is_cancelled() {
        return Ok(None);
    }
    let whole = |shard: Mutex<ByKey<Neighbourhood>>| shard.into_inner().unwrap_or_else(PoisonError::into_inner);
    let counts: ByKey<Neighbourhood> = shards.into_iter().flat_map(whole).collect();
    // The verdict on all points of the mirrors is what is known of a neighbourhood before it is looked at.
    let of_all = |key: u64| counts.get(&key).map_or(0.5, |(all, _)| ghost_share(all, 0.5));
    let mut before: ByKey<f64> = ByKey::default();
    counts.values().filter_map(|(_, key)| *key).for_each(|key| {
        before.entry(key).or_insert_with(|| of_all(key));
    });
    let share_of = |(key, (own, mirrors)): (&u64, &Neighbourhood)| {
        let before = mirrors.and_then(|mirrors| before.get(&mirrors)).copied().unwrap_or(0.5);
        (*key, ghost_share(own, before))
    };
    let shares: ByKey<f64> = counts.iter().map(share_of).collect();
    let suspects = Mutex::new(BTreeMap::new());
    points.read(&|block| {
        let suspect = |(index, place): (usize, &DVec3)| {
            let weight = scales.weigh(*place, block.station, block.intensity(index))?;
            let share = shares.get(&scales.neighbourhood(*place, &weight)).copied().unwrap_or(0.5);
            Some(suspect_of(index, &weight, share))
        };
        let found: Vec<Suspect> = block.places.iter().enumerate().filter_map(suspect).collect();
        if !found.is_empty() {
            let mut suspects = suspects.lock().unwrap_or_else(PoisonError::into_inner);
            suspects.insert((block.file, block.first_point), found);
        }
    })?;
    let suspects = suspects.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok((!progress.is_cancelled()).then_some(Verdicts { suspects, noise: scales.scanner.range }))
}

fn suspect_of(index: usize, weight: &Weight, share: f64) -> Suspect {
    let odds = share / (1.0 - share) * weight.log_ratio.exp();
    let probability = if odds.is_finite() { odds / (1.0 + odds) } else { 1.0 };
    let kind = match probability {
        probability if probability >= GHOST_FROM => Kind::Ghost,
        probability if probability <= REAL_TO => Kind::Real,
        _ => Kind::Undecided,
    };
    Suspect {
        index: index as u32,
        kind,
        mirrors: if kind == Kind::Real { Default::default() } else { weight.way.mirrors },
        probability: probability as f32,
        place: weight.way.place,
        error: (1.96 * weight.error) as f32,
        distance: weight.fit.map(|fit| fit.distance.abs() as f32),
    }
}

impl Scales<'_> {
    /// Weighs a point; `None` if it cannot be a ghost. `own` is the station that saw it, if that is known.
    fn weigh(&self, place: DVec3, own: Option<usize>, noted: Option<f32>) -> Option<Weight> {
        if !place.is_finite() {
            return None;
        }
        let (mut real, mut ghost): (Option<f64>, Option<Weight>) = (None, None);
        for station in own.map_or(0..self.stations.len(), |station| station..station + 1) {
            let ways = self.mirrors.ways(self.stations[station], place, self.margin);
            let is_seen = ways.is_empty() || ways.iter().any(Way::is_straight);
            if is_seen {
                // Only points beyond suspicion are in the image, and none of those is seen through a pane.
                let seen = if ways.is_empty() { self.seen_by(station, place) } else { 0.0 };
                real = Some(real.map_or(seen, |known: f64| known.max(seen)));
            }
            for way in ways.into_iter().filter(|way| !way.is_straight()) {
                let weight = self.weigh_way(station, place, way, noted);
                if ghost.as_ref().is_none_or(|known| weight.log_ratio > known.log_ratio) {
                    ghost = Some(weight);
                }
            }
        }
        let mut ghost = ghost?;
        ghost.log_ratio = match real {
            None => f64::INFINITY,
            // Of mirror images of each other, a surface is there whatever the point is.
            Some(seen) if ghost.is_image && ghost.strength.is_some() => {
                ghost.log_ratio - seen - self.seen_by_others(place, own).min(0.0)
            }
            Some(seen) => ghost.log_ratio - seen - self.known_at(place) - self.seen_by_others(place, own),
        };
        Some(ghost)
    }

    /// Learns from points that were seen directly how strong the returns of their surfaces are.
    fn learnt<P: Points>(
        &self,
        points: &P,
        is_suspect: impl Fn(&Block, DVec3) -> bool + Sync,
    ) -> Result<Option<Strengths>, P::Error> {
        let builder = StrengthsBuilder::default();
        points.read(&|block| {
            let Some(station) = block.only_station(self.stations.len()) else { return };
            let one = |(index, place): (usize, &DVec3)| {
                let noted = block.intensity(index).filter(|_| place.is_finite() && !is_suspect(block, *place))?;
                let fit = self.map.nearest(*place).filter(|fit| self.is_on(fit))?;
                let way = *place - self.stations[station];
                Some((fit, Return::new(noted, way.length(), cosine(&fit, way.normalize()))?))
            };
            builder.add(block.places.iter().enumerate().filter_map(one));
        })?;
        Ok(builder.finish())
    }

    /// The shares of light that the mirrors of ways reflect where points are seen through them, too.
    fn shares<P: Points>(&self, points: &P) -> Result<ByKey<f64>, P::Error> {
        let all: Mutex<ByKey<ShareFit>> = Mutex::default();
        points.read(&|block| {
            let mut own: ByKey<ShareFit> = ByKey::default();
            for (index, place) in block.places.iter().enumerate() {
                if !hash(block.first_point + index as u64).is_multiple_of(OF_SUSPECTS) {
                    continue;
                }
                let Some(weight) = self.weigh(*place, block.station, block.intensity(index)) else { continue };
                if let Some(compared) = weight.strength.filter(|_| weight.log_ratio.is_finite()) {
                    own.entry(of_mirrors(&weight)).or_default().add(&compared, weight.log_ratio);
                }
            }
            let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
            own.iter().for_each(|(key, fit)| all.entry(*key).or_default().join(fit));
        })?;
        let all = all.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(all.into_iter().map(|(key, fit)| (key, fit.best())).collect())
    }

    fn weigh_way(&self, station: usize, point: DVec3, way: Way, noted: Option<f32>) -> Weight {
        let error = self.mirrors.error(self.stations[station], point, &way, self.scanner);
        let fit = self.map.nearest(way.place);
        let is_telling = !fit.is_some_and(|fit| {
            let off = fit.patch.normal.as_dvec3().dot(point - fit.patch.center).abs();
            off < CONTINUED.max(SLOPE * point.distance(fit.patch.center)) * self.map.edge() || off < 5.0 * error
        });
        let log_ratio = match &fit {
            _ if !is_telling => 0.0,
            None => ((1.0 - NEAR_GHOST) / (1.0 - NEAR_OTHER)).ln(),
            Some(Fit { distance, patch }) => {
                let width = f64::from(patch.edge);
                let deviation = error.hypot(f64::from(patch.thickness).max(0.01 * width));
                let density =
                    (-0.5 * (distance / deviation).powi(2)).exp() / (deviation * std::f64::consts::TAU.sqrt());
                ((ON_SURFACE * density * width + 1.0 - ON_SURFACE) * NEAR_GHOST / NEAR_OTHER).ln()
            }
        };
        let is_image = !is_telling;
        let mut weight = Weight { log_ratio, station, way, error, fit, is_telling, is_image, strength: None };
        if let (Some(strengths), Some(noted)) = (&self.strengths, noted) {
            let sight = point - self.stations[station];
            let ghost = fit.filter(|fit| self.is_on(fit)).map(|fit| (fit, cosine(&fit, way.arrival)));
            let real = self.map.nearest(point).filter(|fit| self.is_on(fit));
            let real = real.map(|fit| (fit, cosine(&fit, sight.normalize())));
            weight.strength = strengths.compared(noted, sight.length(), ghost, real);
            let reflected = self.reflected.get(&of_mirrors(&weight));
            if let (Some(compared), Some(reflected)) = (weight.strength, reflected) {
                let ratio = compared.log_ratio(*reflected);
                weight.log_ratio += ratio;
                weight.is_telling |= ratio.abs() > TELLING;
            }
        }
        weight
    }

    /// Whether a point is on the surface that it is nearest to.
    fn is_on(&self, fit: &Fit) -> bool {
        fit.distance.abs() < 3.0 * self.scanner.range.hypot(f64::from(fit.patch.thickness))
    }

    fn sight(&self, station: usize, place: DVec3) -> Sight {
        self.images[station].sight(place, 2.0 * self.map.edge())
    }

    /// How much likelier a point is that this station may have seen, by what the station sees around it.
    fn seen_by(&self, station: usize, place: DVec3) -> f64 {
        match self.sight(station, place) {
            Sight::Unknown => 0.0,
            Sight::On => SEEN_ON,
            Sight::Through => SEEN_THROUGH,
            Sight::Hidden => IS_HIDDEN,
        }
    }

    /// How much likelier a point is by what other stations see than the one that saw it. Nothing follows from what is hidden
    /// from them.
    fn seen_by_others(&self, place: DVec3, own: Option<usize>) -> f64 {
        let Some(own) = own else { return 0.0 };
        let others = (0..self.stations.len()).filter(|station| *station != own);
        let clear = others.filter(|station| !self.mirrors.may_meet(self.stations[*station], place));
        let weights = clear.map(|station| match self.sight(station, place) {
            Sight::Unknown | Sight::Hidden => 0.0,
            Sight::On => SEEN_ON,
            Sight::Through => SEEN_THROUGH,
        });
        weights.sum()
    }

    /// How much likelier a point is by the surfaces where it was written down.
    fn known_at(&self, place: DVec3) -> f64 {
        if self.map.nearest(place).is_some_and(|fit| self.is_on(&fit)) { ON_KNOWN } else { 0.0 }
    }

    /// The key of the points about one that the same station saw by way of the same mirrors.
    fn neighbourhood(&self, place: DVec3, weight: &Weight) -> u64 {
        let cell = (place / (NEIGHBOURHOOD * self.map.edge())).floor().as_i64vec3();
        hash(key_of(cell).unwrap_or(u64::MAX) ^ of_mirrors(weight))
    }
}

/// The cosine of the angle at which a beam meets a surface.
fn cosine(fit: &Fit, direction: DVec3) -> f64 {
    fit.patch.normal.as_dvec3().dot(direction).abs()
}

/// The key of all points that the same station saw by way of the same mirrors.
fn of_mirrors(weight: &Weight) -> u64 {
    let mirrors =
        weight.way.mirrors.into_iter().fold(weight.station as u64, |key, mirror| key << 8 | u64::from(mirror));
    hash(mirrors)
}

fn bin_of(log_ratio: f64) -> usize {
    let share = (log_ratio / LAST_BIN).clamp(-1.0, 1.0) * 0.5 + 0.5;
    ((share * BINS as f64) as usize).min(BINS - 1)
}

/// The share of the points of a neighbourhood that are ghosts, which makes their likelihoods greatest.
fn ghost_share(counts: &Counts, before: f64) -> f64 {
    let ratio = |bin: usize| ((((bin as f64 + 0.5) / BINS as f64) * 2.0 - 1.0) * LAST_BIN).exp();
    let total: f64 = counts.iter().map(|count| f64::from(*count)).sum();
    let mut share = before;
    for _ in 0..50 {
        let ghosts = |(bin, count): (usize, &u32)| {
            let likely = share * ratio(bin);
            f64::from(*count) * likely / (likely + 1.0 - share)
        };
        let sum: f64 = counts.iter().enumerate().map(ghosts).sum();
        share = (sum + before * PRIOR_POINTS) / (total + PRIOR_POINTS);
    }
    share
}

/// Where points are, and how fine their map is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    pub origin: DVec3,
    /// The edge of the finest cells of a map.
    pub edge: f64,
}

/// The finest cells of a map to the diagonal of the box about most points.
const CELLS: f64 = 300.0;
/// The number of points from which the box follows.
const SAMPLED: u64 = 50_000;

impl Extent {
    /// Reads points once, of which there are `total`. `None` without points.
    ///
    /// # Errors
    /// The points cannot be read.
    pub fn of<P: Points>(points: &P, total: u64) -> Result<Option<Self>, P::Error> {
        let step = total.div_ceil(SAMPLED).max(1);
        let (sample, count) = (Mutex::new(Vec::new()), AtomicU64::new(0));
        points.read(&|block| {
            count.fetch_add(block.places.len() as u64, Ordering::Relaxed);
            let taken = |index: usize| hash(block.first_point + index as u64).is_multiple_of(step);
            let places = block.places.iter().enumerate().filter(|(index, place)| place.is_finite() && taken(*index));
            let mut own: Vec<DVec3> = places.map(|(_, place)| *place).collect();
            sample.lock().unwrap_or_else(PoisonError::into_inner).append(&mut own);
        })?;
        let sample = sample.into_inner().unwrap_or_else(PoisonError::into_inner);
        if sample.is_empty() {
            return Ok(None);
        }
        let ends = |axis: usize| {
            let mut values: Vec<f64> = sample.iter().map(|place| place[axis]).collect();
            values.sort_unstable_by(f64::total_cmp);
            let at = |share: f64| values[((values.len() - 1) as f64 * share) as usize];
            [at(0.02), at(0.98)]
        };
        let [x, y, z] = std::array::from_fn(ends);
        let low = DVec3::new(x[0], y[0], z[0]);
        let diagonal = low.distance(DVec3::new(x[1], y[1], z[1]));
        // A whole number, so that the cells do not depend on the last digits.
        Ok((diagonal > 0.0).then(|| Self { origin: low.floor(), edge: diagonal / CELLS }))
    }
}
