//! The noise of a scan and the share of its strays and mixed pixels, told from the neighbours of some of its points.

use rayon::prelude::*;

use crate::neighbours::{Points, Surroundings, Tiles};
use crate::shape::Shape;
use crate::strays::{Stray, kinds_of, strays_of};
use crate::surfels::{self, RadiusRule};
use crate::{Chunk, MIXED_RADIUS, Progress, hash};

/// The number of neighbours that a plane is fitted to, as when normals are estimated.
const NEIGHBOURS: usize = 16;
/// The squared distances of 17 points from the plane that fits them best add up to the variance times a number whose
/// median is this: chi squared with 14 degrees of freedom.
const MEDIAN_SUM: f64 = 13.339;
/// Where neighbourhoods are thicker than this share of their width, noise decides which points are neighbours, and the
/// plane does not show it. Of fewer points, neighbours are further away.
const THICKEST: f64 = 0.25;
/// One point in so many is left then, and so often.
const THINNED: u64 = 4;
const MOST_THINNINGS: u32 = 4;

/// What the neighbours of some points show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbourhoods {
    /// The number of points that were looked at.
    pub points: u64,
    /// The number of those that are lone strays, and mixed pixels, as radii that follow the spread find them. Those that
    /// know one another only across the border of a part that was looked at count as lone.
    pub strays: u64,
    pub mixed: u64,
    /// The standard deviation of points from the plane through them and their neighbours, in world units: what is
    /// rough or bent at that scale counts, too. `None` where most points are on no surface.
    pub noise: Option<f64>,
}

/// Looks at the neighbours of the points in up to so many parts of some 50 thousand points, from all over the cloud. Few
/// parts tell the noise, but not how many strays there are, which are in a few places. `None` when cancelled.
pub fn neighbourhoods(chunks: &[Chunk], most_parts: usize, progress: &Progress) -> Option<Neighbourhoods> {
    let mut looks = look(chunks, most_parts, progress)?;
    let (points, strays, mixed) = (looks.variances.len() as u64, looks.strays, looks.mixed);
    let mut thinned: Vec<Chunk> = Vec::new();
    for thinning in 0..MOST_THINNINGS {
        if looks.is_flat() || looks.variances.is_empty() {
            break;
        }
        let is_left = |index: u64| hash(index << 3 | u64::from(thinning)).is_multiple_of(THINNED);
        let thin = |chunk: &Chunk| {
            let bare = Chunk { positions: chunk.positions.clone(), ..Chunk::new(0, chunk.origin, Vec::new()) };
            let left = (0..chunk.len() as u32).filter(|index| is_left(chunk.first_point + u64::from(*index)));
            Chunk { first_point: chunk.first_point, ..bare.select(&left.collect::<Vec<_>>()) }
        };
        let before = if thinned.is_empty() { chunks } else { &thinned };
        thinned = before.par_iter().map(thin).collect();
        looks = look(&thinned, most_parts, progress)?;
    }
    let noise = if looks.is_flat() { median(&mut looks.variances).map(f64::sqrt) } else { None };
    Some(Neighbourhoods { points, strays, mixed, noise })
}

/// What neighbourhoods are like, one entry each.
#[derive(Default)]
struct Looks {
    /// The variance of the points from the plane, in squared world units.
    variances: Vec<f64>,
    /// How thick it is relative to its width.
    roughness: Vec<f64>,
    strays: u64,
    mixed: u64,
}

impl Looks {
    /// Whether most neighbourhoods are flat.
    fn is_flat(&self) -> bool {
        let flat = self.roughness.iter().filter(|roughness| **roughness < THICKEST).count();
        2 * flat > self.roughness.len()
    }
}

fn look(chunks: &[Chunk], most_parts: usize, progress: &Progress) -> Option<Looks> {
    let points = Points::new(chunks);
    let tiles = Tiles::new(&points, progress)?;
    let searched = tiles.len().min(most_parts);
    let of_tile = |number: usize| {
        // The first and the last tiles are corners of the cloud, where strays are more frequent.
        let (mut own, mut points, tile) =
            (Looks::default(), Vec::new(), (2 * number + 1) * tiles.len() / (2 * searched));
        let visit = |index: u32, surroundings: &mut Surroundings<'_, '_, NEIGHBOURS>| {
            let around = surroundings.neighbourhood();
            let shape = Shape::of(around);
            let normal = shape.as_ref().and_then(Shape::normal);
            points.push(surfels::look([index, 0], around, shape.as_ref(), normal, RadiusRule::Spread));
            let Some(shape) = shape.filter(|_| around.count == NEIGHBOURS) else { return };
            own.roughness.push(f64::from(shape.roughness()));
            let squares = shape.thinnest() * f64::from(around.distance_squared) * (NEIGHBOURS + 1) as f64;
            own.variances.push(squares / MEDIAN_SUM);
        };
        tiles.search::<NEIGHBOURS>(tile, NEIGHBOURS, visit, progress);
        (own, strays_of(&tiles, tile, NEIGHBOURS, &points, progress))
    };
    let (parts, strays): (Vec<Looks>, Vec<Vec<Stray>>) = (0..searched).into_par_iter().map(of_tile).unzip();
    let strays: Vec<Stray> = strays.into_iter().flatten().collect();
    let kinds = kinds_of(&points, &strays.iter().collect::<Vec<_>>(), progress)?;
    let mixed = kinds.iter().filter(|kind| **kind == MIXED_RADIUS).count() as u64;
    let mut all = Looks { strays: kinds.len() as u64 - mixed, mixed, ..Looks::default() };
    for part in parts {
        all.variances.extend(part.variances);
        all.roughness.extend(part.roughness);
    }
    (!progress.is_cancelled()).then_some(all)
}

fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    fn unit(seed: u64) -> f64 {
        (hash(seed) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A normal deviate.
    fn normal(seed: u64) -> f64 {
        let radius = (-2.0 * (1.0 - unit(2 * seed)).ln()).sqrt();
        radius * (std::f64::consts::TAU * unit(2 * seed + 1)).cos()
    }

    /// A tilted square at coordinates of seven digits with so many points at random a metre apart, whose noise has
    /// this standard deviation.
    fn plane(points: u64, noise: f64) -> Vec<Chunk> {
        let side = (points as f64).sqrt();
        let position = |at: u64| {
            let place = DVec3::new(unit(7 * at) * side, unit(7 * at + 1) * side, noise * normal(7 * at + 2));
            tilted(place)
        };
        let positions: Vec<[f32; 3]> = (0..points).map(position).collect();
        let origin = DVec3::new(631_000.0, 5_077_000.0, 120.0);
        let chunk = |(number, part): (usize, &[[f32; 3]])| Chunk::new(1000 * number as u64, origin, part.to_vec());
        positions.chunks(1000).enumerate().map(chunk).collect()
    }

    fn tilted(place: DVec3) -> [f32; 3] {
        (DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 0.2) * place).as_vec3().to_array()
    }

    fn noise_of(chunks: &[Chunk]) -> Option<f64> {
        neighbourhoods(chunks, 6, &Progress::default()).unwrap().noise
    }

    #[test]
    fn noise_of_a_plane_is_its_standard_deviation_whatever_the_spacing() {
        // From a fiftieth of the distance between points to one and a half times that distance.
        for (points, noise) in [(40_000, 0.02), (40_000, 0.2), (120_000, 0.6), (120_000, 1.5)] {
            let found = noise_of(&plane(points, noise)).expect("a plane");
            assert!((found / noise - 1.0).abs() < 0.05, "{found} instead of {noise}");
        }
    }

    #[test]
    fn a_cloud_without_surfaces_has_no_noise_and_strays_are_counted() {
        let at = |seed: u64| [0, 1, 2].map(|axis| unit(3 * seed + axis) as f32 * 30.0);
        assert_eq!(noise_of(&[Chunk::new(0, DVec3::ZERO, (0..20_000).map(at).collect())]), None);
        assert_eq!(noise_of(&[Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0; 3]])]), None);
        assert_eq!(noise_of(&[]), None);
        let mut chunks = plane(40_000, 0.02);
        let clean = neighbourhoods(&chunks, 6, &Progress::default()).unwrap();
        assert_eq!(clean.points, 40_000);
        assert!(clean.strays < 8, "{} in corners", clean.strays);
        let above = |at: u32| tilted(DVec3::new(f64::from(40 + 60 * (at % 3)), f64::from(40 + 60 * (at / 3)), 12.0));
        chunks.push(Chunk::new(40_000, chunks[0].origin, (0..9).map(above).collect()));
        let found = neighbourhoods(&chunks, 6, &Progress::default()).unwrap();
        assert_eq!(found.strays, clean.strays + 9);
        assert!((found.noise.unwrap() / clean.noise.unwrap() - 1.0).abs() < 0.01);
        let cancelled = Progress::default();
        cancelled.cancel();
        assert_eq!(neighbourhoods(&chunks, 6, &cancelled), None);
    }
}
