//! Distances from the points of one cloud to another: to the nearest point, or along normals with the level of detection
//! (Lague, Brodu, Leroux: Accurate 3D comparison of complex topography with terrestrial laser scanner, 2013).

use cloud::Orientation;
use glam::DVec3;

use crate::error::{Error, Result};
use crate::fit::plane;
use crate::tree::PointTree;

/// Both clouds need this many points in the cylinder for a level of detection.
const LEAST_POINTS: u32 = 4;
/// A normal distribution holds 95 % within this many standard deviations of its mean.
const IN_95_PERCENT: f64 = 1.959_964;
/// The scales that are chosen, in units of the distance between neighbouring points: some 80 points for a normal and some
/// 50 in a cylinder of each cloud.
const NORMAL_SPACINGS: f64 = 10.0;
const CYLINDER_SPACINGS: f64 = 8.0;
/// The reach of cylinders that is chosen, in diameters.
const REACH_DIAMETERS: f64 = 10.0;
/// The number of points of which the distance to the nearest other is looked up, to tell the spacing.
const SAMPLED: usize = 1001;

/// The distances between neighbouring points, the median.
pub fn spacing(tree: &PointTree) -> Option<f64> {
    let step = tree.len().div_ceil(SAMPLED).max(1);
    let mut distances: Vec<f64> =
        tree.points().iter().step_by(step).filter_map(|point| tree.distance_to_other(*point)).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied()
}

/// How distances along normals are measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct M3c2 {
    /// The diameter of the sphere about a point of the first cloud whose points give the normal.
    pub normal_scale: f64,
    /// The diameter of the cylinder along the normal.
    pub cylinder_scale: f64,
    /// The reach of the cylinder to either side.
    pub reach: f64,
    pub orientation: Orientation,
}

/// The change at a point of the first cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// The distance along the normal between the mean places of both clouds.
    pub distance: f64,
    /// The least distance that is a change with a confidence of 95 %; `None` where too few points tell it.
    pub level: Option<f64>,
}

impl Change {
    pub fn is_significant(&self) -> bool {
        self.level.is_some_and(|level| self.distance.abs() > level)
    }
}

impl M3c2 {
    /// Chooses the scales that are not given by the spacing of the first cloud.
    ///
    /// # Errors
    /// A scale that is no length, or a cloud without a spacing.
    pub fn new(
        first: &PointTree,
        normal_scale: Option<f64>,
        cylinder_scale: Option<f64>,
        reach: Option<f64>,
        orientation: Orientation,
    ) -> Result<Self> {
        let spacing = spacing(first).ok_or(Error::TooFew { points: first.len(), least: 2 })?;
        let cylinder_scale = cylinder_scale.unwrap_or(CYLINDER_SPACINGS * spacing);
        let normal_scale = normal_scale.unwrap_or(NORMAL_SPACINGS * spacing);
        let reach = reach.unwrap_or(REACH_DIAMETERS * cylinder_scale);
        for length in [normal_scale, cylinder_scale, reach] {
            // NaN fails the comparison.
            if !(length > 0.0 && length.is_finite()) {
                return Err(Error::Scale { length });
            }
        }
        Ok(Self { normal_scale, cylinder_scale, reach, orientation })
    }

    /// The normal of the first cloud at a place; `None` where its points have no plane.
    fn normal(&self, first: &PointTree, place: DVec3, around: &mut Vec<DVec3>) -> Option<DVec3> {
        around.clear();
        first.within(place, self.normal_scale * 0.5, &mut |point| around.push(point));
        let plane = plane(around).ok()?;
        let toward = match self.orientation {
            Orientation::Up(up) => up.as_dvec3(),
            Orientation::Toward(eye) => eye - plane.center,
            Orientation::AwayFrom(middle) => plane.center - middle,
        };
        Some(if plane.normal.dot(toward) < 0.0 { -plane.normal } else { plane.normal })
    }

    /// The change at a place of the first cloud; `None` where it has no normal, or either cloud has no point in the
    /// cylinder. `around` is room for points.
    pub fn change(
        &self,
        first: &PointTree,
        second: &PointTree,
        place: DVec3,
        around: &mut Vec<DVec3>,
    ) -> Option<Change> {
        let normal = self.normal(first, place, around)?;
        let heights = |tree: &PointTree| {
            let mut heights = Heights::default();
            tree.in_cylinder(place, normal, self.cylinder_scale * 0.5, self.reach, &mut |height| heights.add(height));
            (heights.count > 0).then_some(heights)
        };
        let (first, second) = (heights(first)?, heights(second)?);
        let level = (first.count.min(second.count) >= LEAST_POINTS)
            .then(|| IN_95_PERCENT * (first.variance_of_mean() + second.variance_of_mean()).sqrt());
        Some(Change { distance: second.mean - first.mean, level })
    }
}

/// Mean and variance of numbers that come one after the other (Welford 1962).
#[derive(Clone, Copy, Default)]
struct Heights {
    count: u32,
    mean: f64,
    squares: f64,
}

impl Heights {
    fn add(&mut self, height: f64) {
        self.count += 1;
        let off = height - self.mean;
        self.mean += off / f64::from(self.count);
        self.squares += off * (height - self.mean);
    }

    fn variance_of_mean(&self) -> f64 {
        self.squares / f64::from(self.count - 1) / f64::from(self.count)
    }
}

/// What the distances of many points amount to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceFigures {
    /// The number of points that have a distance.
    pub points: u64,
    pub mean: f64,
    pub median: f64,
    /// The standard deviation about the mean.
    pub std: f64,
    /// The root of the mean square.
    pub rms: f64,
    /// 95 % of the distances are no longer than this.
    pub p95: f64,
    /// The longest distance.
    pub max: f64,
}

impl DistanceFigures {
    /// Distances that are not finite do not count; `None` if there is no other.
    pub fn of(mut distances: Vec<f32>) -> Option<Self> {
        distances.retain(|distance| distance.is_finite());
        let count = distances.len();
        let mean = distances.iter().map(|distance| f64::from(*distance)).sum::<f64>() / count as f64;
        let square = |distance: &f32, about: f64| (f64::from(*distance) - about).powi(2);
        let spread = |about: f64| (distances.iter().map(|d| square(d, about)).sum::<f64>() / count as f64).sqrt();
        let (std, rms) = (spread(mean), spread(0.0));
        let mut ranked =
            |rank: usize| (rank < count).then(|| *distances.select_nth_unstable_by(rank, f32::total_cmp).1);
        let (lower, upper) = (ranked(count.checked_sub(1)? / 2)?, ranked(count / 2)?);
        let median = (f64::from(lower) + f64::from(upper)) * 0.5;
        distances.iter_mut().for_each(|distance| *distance = distance.abs());
        let rank = (count * 95).div_ceil(100) - 1;
        let p95 = *distances.select_nth_unstable_by(rank, f32::total_cmp).1;
        let max = distances.iter().copied().fold(0.0, f32::max);
        Some(Self { points: count as u64, mean, median, std, rms, p95: p95.into(), max: max.into() })
    }
}

#[cfg(test)]
mod tests {
    use cloud::Random;
    use glam::{DQuat, Vec3};

    use super::*;

    /// A normally distributed number (Box and Muller).
    fn normal(random: &mut Random) -> f64 {
        let mut unit = || (random.below(1 << 40) as f64 + 0.5) / (1_u64 << 40) as f64;
        (-2.0 * unit().ln()).sqrt() * (unit() * std::f64::consts::TAU).cos()
    }

    /// A square of 20 units in the plane of x and y, with 25 points on a unit, that deviate across it.
    fn sheet(height: f64, spread: f64, seed: u64) -> Vec<DVec3> {
        let mut random = Random(seed);
        let mut point = |index: usize| {
            let (column, row) = (index % 100, index / 100);
            let place = |number: usize, random: &mut Random| (number as f64 + random.below(1000) as f64 / 1000.0) * 0.2;
            let (x, y) = (place(column, &mut random), place(row, &mut random));
            DVec3::new(x, y, height + spread * normal(&mut random))
        };
        (0..10_000).map(&mut point).collect()
    }

    /// Distances of a plane to itself moved by `shift`, both with spreads, away from the borders.
    fn changes(shift: f64, spreads: [f64; 2], turn: DQuat) -> (M3c2, Vec<Change>) {
        let at =
            |points: Vec<DVec3>| points.into_iter().map(|point| turn * point + DVec3::new(6e5, 5e6, 0.0)).collect();
        let places = sheet(0.0, spreads[0], 1);
        let trees = [PointTree::new(at(places.clone())), PointTree::new(at(sheet(shift, spreads[1], 2)))];
        let up = Orientation::Up((turn * DVec3::Z).as_vec3());
        let method = M3c2::new(&trees[0], Some(4.0), Some(2.0), Some(3.0), up).unwrap();
        let is_inner = |place: &&DVec3| place.x > 3.0 && place.x < 17.0 && place.y > 3.0 && place.y < 17.0;
        let inner: Vec<DVec3> = at(places.iter().filter(is_inner).step_by(7).copied().collect());
        let mut around = Vec::new();
        let change = |place: &DVec3| method.change(&trees[0], &trees[1], *place, &mut around).unwrap();
        (method, inner.iter().map(change).collect())
    }

    #[test]
    fn a_plane_that_is_moved_is_found_as_far_as_it_was_moved_and_the_level_follows_its_formula() {
        let (shift, spreads) = (0.15, [0.05, 0.1]);
        for turn in [DQuat::IDENTITY, DQuat::from_rotation_x(1.1), DQuat::from_rotation_y(2.0)] {
            let (method, found) = changes(shift, spreads, turn);
            // Points in a disc of the cylinder's diameter.
            let count = 25.0 * std::f64::consts::PI * (method.cylinder_scale * 0.5).powi(2);
            let deviation = (spreads[0].powi(2) / count + spreads[1].powi(2) / count).sqrt();
            let mean = found.iter().map(|change| change.distance).sum::<f64>() / found.len() as f64;
            assert!((mean - shift).abs() < deviation, "{mean}");
            let level = found.iter().map(|change| change.level.unwrap()).sum::<f64>() / found.len() as f64;
            assert!((level / (1.96 * deviation) - 1.0).abs() < 0.05, "{level}: {}", 1.96 * deviation);
            assert!(found.iter().all(|change| (change.distance - shift).abs() < 5.0 * deviation));
            assert!(found.iter().all(Change::is_significant));
        }
    }

    #[test]
    fn without_a_change_one_point_in_twenty_is_beyond_the_level() {
        let (_, found) = changes(0.0, [0.05, 0.05], DQuat::from_rotation_x(0.4));
        let share = found.iter().filter(|change| change.is_significant()).count() as f64 / found.len() as f64;
        assert!((0.02..0.09).contains(&share), "{share}");
    }

    #[test]
    fn what_either_cloud_lacks_has_no_change_and_few_points_no_level() {
        let first = PointTree::new(sheet(0.0, 0.01, 1));
        let up = Orientation::Up(Vec3::Z);
        let method = M3c2::new(&first, None, None, None, up).unwrap();
        let spacing = spacing(&first).unwrap();
        assert!((0.05..0.2).contains(&spacing), "{spacing}");
        assert_eq!((method.normal_scale, method.cylinder_scale), (10.0 * spacing, 8.0 * spacing));
        let place = DVec3::new(10.0, 10.0, 0.0);
        let change = |second: Vec<DVec3>| method.change(&first, &PointTree::new(second), place, &mut Vec::new());
        assert_eq!(change(Vec::new()), None);
        assert_eq!(change(vec![place + DVec3::Z * 99.0]), None);
        let three = change(vec![place + DVec3::Z; 3]).unwrap();
        assert!((three.distance - 1.0).abs() < 0.02 && three.level.is_none() && !three.is_significant());
        assert!(change(vec![place - DVec3::Z; 4]).unwrap().is_significant());
        assert!(M3c2::new(&first, Some(0.0), None, None, up).is_err());
        assert!(M3c2::new(&first, None, None, Some(f64::NAN), up).is_err());
        assert!(M3c2::new(&PointTree::new(vec![DVec3::ONE; 3]), None, None, None, up).is_err());
    }

    #[test]
    fn figures_are_those_of_the_distances() {
        let figures = DistanceFigures::of(vec![3.0, -4.0, f32::NAN, 0.0, 1.0]).unwrap();
        assert_eq!((figures.points, figures.mean, figures.median), (4, 0.0, 0.5));
        assert_eq!((figures.std, figures.rms), (6.5_f64.sqrt(), 6.5_f64.sqrt()));
        assert_eq!((figures.p95, figures.max), (4.0, 4.0));
        let hundred = DistanceFigures::of((1..=100).map(|number| number as f32).collect()).unwrap();
        assert_eq!((hundred.mean, hundred.median, hundred.p95, hundred.max), (50.5, 50.5, 95.0, 100.0));
        assert_eq!(DistanceFigures::of(vec![f32::NAN]), None);
    }
}
