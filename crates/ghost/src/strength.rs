//! How strong returns are. A pane sends back a share of the beam and lets the rest through, there and back, so that a ghost
//! and a point seen through the pane are weaker than returns of their surfaces elsewhere, each by a factor of its own. Where
//! a floor before a pane and the floor behind it are mirror images of each other, only that parts a ghost from it.
//!
//! The strength of a return falls with the squared range and the cosine of the incidence. Some scanners note that strength,
//! some its root, and some correct it for range and incidence. Which of these fits is what leaves the least variance among
//! points that were seen directly.

use std::sync::Mutex;
use std::sync::PoisonError;

use cloud::hash;

use crate::surface_map::{ByKey, Fit, Patch};

/// The powers of range and cosine that are taken out of what a scanner notes, and that of the share of light.
#[derive(Clone, Copy, Debug)]
struct Law {
    range: f64,
    cosine: f64,
    share: f64,
}

const LAWS: [Law; 3] = [
    Law { range: 0.0, cosine: 0.0, share: 1.0 },
    Law { range: 1.0, cosine: -0.5, share: 0.5 },
    Law { range: 2.0, cosine: -1.0, share: 1.0 },
];

/// A return: the logarithms of what the scanner noted, of the range, and of the cosine of the incidence.
#[derive(Clone, Copy, Debug)]
pub struct Return {
    pub noted: f64,
    pub range: f64,
    pub cosine: f64,
}

impl Return {
    /// `None` where nothing was noted.
    pub fn new(noted: f32, range: f64, cosine: f64) -> Option<Self> {
        let noted = f64::from(noted);
        (noted > 0.0 && noted.is_finite()).then(|| Self {
            noted: noted.ln(),
            range: range.ln(),
            cosine: cosine.abs().max(LEAST_COSINE).ln(),
        })
    }

    fn by(&self, law: &Law) -> f64 {
        self.noted + law.range * self.range + law.cosine * self.cosine
    }
}

/// At smaller cosines of the incidence, surfaces are too rough for any law.
const LEAST_COSINE: f64 = 0.05;
/// The cosine where none is known.
const USUAL_COSINE: f64 = 0.6;
/// Steps of a sum: whole numbers do not depend on the order in which points come.
const STEPS: f64 = 65_536.0;

/// The number of returns of a patch, and the sums and squared sums by each law.
type Sums = [i64; 1 + 2 * LAWS.len()];

/// Collects returns of surfaces that were seen directly, from any number of threads.
#[derive(Default)]
pub struct StrengthsBuilder(Mutex<ByKey<Sums>>);

impl StrengthsBuilder {
    pub fn add(&self, returns: impl Iterator<Item = (Fit, Return)>) {
        let mut own: ByKey<Sums> = ByKey::default();
        for (fit, one) in returns {
            let sums = own.entry(key_of(&fit.patch)).or_default();
            sums[0] += 1;
            for (index, law) in LAWS.iter().enumerate() {
                let value = one.by(law);
                sums[1 + 2 * index] += (value * STEPS).round() as i64;
                sums[2 + 2 * index] += (value * value * STEPS).round() as i64;
            }
        }
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for (key, sums) in own {
            all.entry(key).or_default().iter_mut().zip(sums).for_each(|(all, own)| *all += own);
        }
    }

    /// `None` without returns.
    pub fn finish(self) -> Option<Strengths> {
        let patches = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        let sum = |index: usize| patches.values().map(|sums| sums[index]).sum::<i64>() as f64 / STEPS;
        let count = sum(0) * STEPS;
        if count < FEWEST {
            return None;
        }
        let moments = |law: usize| {
            let mean = sum(1 + 2 * law) / count;
            (mean, sum(2 + 2 * law) / count - mean * mean)
        };
        let law = (0..LAWS.len()).min_by(|a, b| moments(*a).1.total_cmp(&moments(*b).1))?;
        let (mean, variance) = moments(law);
        let own_mean = |sums: &Sums| sums[1 + 2 * law] as f64 / STEPS / sums[0] as f64;
        let between =
            patches.values().map(|sums| sums[0] as f64 * (own_mean(sums) - mean).powi(2)).sum::<f64>() / count;
        let within = (variance - between).max(LEAST_VARIANCE);
        let of_patch = |(key, sums): (&u64, &Sums)| (*key, (own_mean(sums), within * (1.0 + 1.0 / sums[0] as f64)));
        let means = patches.iter().map(of_patch).collect();
        Some(Strengths { law: LAWS[law], means, usual: (mean, variance.max(LEAST_VARIANCE)) })
    }
}

/// The fewest returns from which a law follows.
const FEWEST: f64 = 1000.0;
/// The least variance of the logarithm of a return, for scans that are too good to be true.
const LEAST_VARIANCE: f64 = 0.01;

fn key_of(patch: &Patch) -> u64 {
    patch.center.to_array().into_iter().fold(u64::from(patch.edge.to_bits()), |key, value| hash(key ^ value.to_bits()))
}

/// How strong surfaces send light back.
pub struct Strengths {
    law: Law,
    /// The mean of each patch, and the variance of returns about it.
    means: ByKey<(f64, f64)>,
    usual: (f64, f64),
}

/// How much stronger a return is than those of its surface, as a logarithm, with its variance.
type Excess = (f64, f64);

/// A suspected return beside those of the surfaces that it may be of.
#[derive(Clone, Copy, Debug)]
pub struct Compared {
    ghost: Excess,
    real: Excess,
    share_power: f64,
}

impl Strengths {
    /// What a return of a range is beside others of a surface that the beam meets with a cosine.
    fn excess(&self, noted: f32, range: f64, surface: Option<(Fit, f64)>) -> Option<Excess> {
        let known = surface.and_then(|(fit, cosine)| Some((*self.means.get(&key_of(&fit.patch))?, cosine)));
        let ((mean, variance), cosine) = known.unwrap_or((self.usual, USUAL_COSINE));
        Some((Return::new(noted, range, cosine)?.by(&self.law) - mean, variance))
    }

    /// A return beside the surface that it is of if it is a ghost, and the one if it is real, each with the cosine at which
    /// the beam meets it.
    pub fn compared(
        &self,
        noted: f32,
        range: f64,
        ghost: Option<(Fit, f64)>,
        real: Option<(Fit, f64)>,
    ) -> Option<Compared> {
        let share_power = 2.0 * self.law.share;
        Some(Compared { ghost: self.excess(noted, range, ghost)?, real: self.excess(noted, range, real)?, share_power })
    }
}

/// The share of returns that are none of both, and how wide they are spread.
const OUTLIERS: f64 = 0.03;
const SPREAD: f64 = 8.0;

fn density((excess, variance): Excess, factor: f64) -> f64 {
    let squared = (excess - factor).powi(2) / variance;
    (1.0 - OUTLIERS) * (-0.5 * squared).exp() / (variance * std::f64::consts::TAU).sqrt() + OUTLIERS / SPREAD
}

impl Compared {
    /// How likely the return is as a ghost and as a real point, if a share of the light is reflected.
    fn likely(&self, reflected: f64) -> [f64; 2] {
        let factor = |share: f64| self.share_power * share.ln();
        [density(self.ghost, factor(reflected)), density(self.real, factor(1.0 - reflected))]
    }

    /// The logarithm of how much likelier it is as a ghost than as a real point.
    pub fn log_ratio(&self, reflected: f64) -> f64 {
        let [ghost, real] = self.likely(reflected);
        (ghost / real).ln()
    }
}

/// The shares of light that a pane may reflect, and those of ghosts among the points behind it.
const REFLECTED: [f64; 19] =
    [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95];
const GHOSTS: [f64; 5] = [0.02, 0.2, 0.5, 0.8, 0.98];

/// How well each share fits what was seen behind a pane.
#[derive(Clone)]
pub struct ShareFit([i64; REFLECTED.len() * GHOSTS.len()]);

impl Default for ShareFit {
    fn default() -> Self {
        Self([0; REFLECTED.len() * GHOSTS.len()])
    }
}

impl ShareFit {
    /// `log_ratio` is what speaks for a ghost besides the strength.
    pub fn add(&mut self, compared: &Compared, log_ratio: f64) {
        let places = log_ratio.exp();
        for (row, reflected) in self.0.chunks_mut(GHOSTS.len()).zip(REFLECTED) {
            let [ghost, real] = compared.likely(reflected);
            for (fit, share) in row.iter_mut().zip(GHOSTS) {
                *fit += ((share * places * ghost + (1.0 - share) * real).ln() * STEPS) as i64;
            }
        }
    }

    pub fn join(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(all, own)| *all += own);
    }

    /// The share that is reflected.
    pub fn best(&self) -> f64 {
        let best = (0..self.0.len()).max_by_key(|index| self.0[*index]).unwrap_or(0);
        REFLECTED[best / GHOSTS.len()]
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;

    /// Floors of two reflectances, and a scanner that notes the root of a strength with speckle.
    #[test]
    fn the_law_and_the_share_of_a_pane_are_learnt_and_tell_ghosts_of_floors_that_look_alike() {
        let mut draw = 0_u64;
        let mut unit = move || {
            draw += 1;
            cloud::unit(5, draw)
        };
        let patch = |x: f64| Fit {
            distance: 0.0,
            patch: Patch { center: DVec3::X * x, normal: Vec3::Z, thickness: 0.0, count: 50, edge: 0.1 },
        };
        let floors = [(patch(0.0), 0.6), (patch(1.0), 0.2)];
        let mut noted = |albedo: f64, share: f64, range: f64, cosine: f64| {
            let speckle = (unit() + unit() + unit() - 1.5).exp();
            (share * share * albedo * cosine / (range * range) * speckle).sqrt() as f32
        };
        let builder = StrengthsBuilder::default();
        for index in 0..6000 {
            let (fit, albedo) = floors[index % 2];
            let (range, cosine) = (1.0 + (index % 97) as f64 * 0.1, 0.1 + (index % 89) as f64 * 0.01);
            let one = Return::new(noted(albedo, 1.0, range, cosine), range, cosine).unwrap();
            builder.add([(fit, one)].into_iter());
        }
        let strengths = builder.finish().unwrap();
        assert_eq!(strengths.law.range, 1.0);
        for reflected in [0.2, 0.3, 0.7, 0.9] {
            let mut shares = ShareFit::default();
            let mut seen = Vec::new();
            for index in 0..2000 {
                let (is_ghost, (fit, albedo)) = (index % 3 == 0, floors[index % 2]);
                let share = if is_ghost { reflected } else { 1.0 - reflected };
                let value = noted(albedo, share, 4.0, 0.5);
                let compared = strengths.compared(value, 4.0, Some((fit, 0.5)), Some((fit, 0.5))).unwrap();
                // From places of a few points follows which share is that of the ghosts.
                let by_place = if is_ghost { 2.0 } else { -2.0 };
                shares.add(&compared, if index % 10 == 0 { by_place } else { 0.0 });
                seen.push((is_ghost, compared));
            }
            let best = shares.best();
            assert!((best - reflected).abs() < 0.06, "{reflected}: {best}");
            let right = seen.iter().filter(|(is_ghost, one)| (one.log_ratio(best) > 0.0) == *is_ghost).count();
            assert!(right > 1850, "{reflected}: {right}");
        }
    }
}
