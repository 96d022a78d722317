//! Distances from the points of one cloud to another: to the nearest point, or along normals with the level of detection
//! (Lague, Brodu, Leroux: Accurate 3D comparison of complex topography with terrestrial laser scanner, 2013).

use cloud::{Bounds, Orientation};
use glam::DVec3;

use crate::error::{Error, Result};
use crate::fit::plane;
use crate::scatter::IN_95_PERCENT;
use crate::tree::{Cylinder, PointTree};

/// The number of points that each cloud needs in the cylinder for a level of detection.
const LEAST_POINTS: u32 = 4;
/// The scales that are chosen, in units of the distance between neighbouring points: some 80 points for a normal and some
/// 50 in a cylinder of each cloud.
const NORMAL_SPACINGS: f64 = 10.0;
const CYLINDER_SPACINGS: f64 = 8.0;
/// The reach of cylinders that is chosen, in diameters.
const REACH_DIAMETERS: f64 = 10.0;
/// Places are measured in blocks of neighbours, which look their points up together. A block is at most this large, as a
/// share of the smaller radius of normals and cylinders: the points for a larger one are mostly not those of a place.
const BLOCK_SHARE: f64 = 1.5;
const MOST_IN_BLOCK: usize = 64;
/// The places of a block have a cylinder in common as far as their own ones are within this many of their radii.
const COMMON_RADII: f64 = 2.0;
/// The number of points of which the distance to the nearest other is looked up, to estimate the spacing.
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
    /// How far the clouds may be off as a whole: the level of detection holds the standard deviation of their
    /// registration (Lague et al. 2013, equation 1).
    pub registration: f64,
    pub orientation: Orientation,
}

/// The change at a point of the first cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// The distance along the normal between the mean places of both clouds.
    pub distance: f64,
    /// The least distance that is a change with a confidence of 95 %; `None` where too few points give it.
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
        registration: f64,
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
        if !(registration >= 0.0 && registration.is_finite()) {
            return Err(Error::Registration { registration });
        }
        Ok(Self { normal_scale, cylinder_scale, reach, registration, orientation })
    }

    /// The normal of the plane through the points about a place; `None` where they have none.
    fn normal(&self, around: &[DVec3]) -> Option<DVec3> {
        let plane = plane(around).ok()?;
        let toward = match self.orientation {
            Orientation::Up(up) => up.as_dvec3(),
            Orientation::Toward(eye) => eye - plane.center,
            Orientation::AwayFrom(middle) => plane.center - middle,
        };
        Some(if plane.normal.dot(toward) < 0.0 { -plane.normal } else { plane.normal })
    }

    /// The changes at places of the first cloud, one for each: `None` where it has no normal, or either cloud has no
    /// point in the cylinder.
    pub fn changes(&self, first: &PointTree, second: &PointTree, places: &[DVec3]) -> Vec<Option<Change>> {
        let mut found = vec![None; places.len()];
        let largest = BLOCK_SHARE * 0.5 * self.normal_scale.min(self.cylinder_scale);
        let (mut near, mut around) = (Vec::new(), Vec::new());
        let mut block: Vec<(usize, DVec3)> = Vec::new();
        for members in blocks(places, largest) {
            let bounds = bounds_of(members.iter().map(|index| places[*index]));
            near.clear();
            first.near_box(bounds, self.normal_scale * 0.5, &mut |points| near.extend_from_slice(points));
            let squared = (self.normal_scale * 0.5).powi(2);
            block.clear();
            for index in members {
                around.clear();
                around.extend(near.iter().filter(|point| point.distance_squared(places[index]) <= squared));
                block.extend(self.normal(&around).map(|normal| (index, normal)));
            }
            self.measure([first, second], places, &block, &mut near, &mut found);
        }
        found
    }

    /// Measures the places of a block, which come with their normals. `near` is room for points.
    fn measure(
        &self,
        clouds: [&PointTree; 2],
        places: &[DVec3],
        block: &[(usize, DVec3)],
        near: &mut Vec<DVec3>,
        found: &mut [Option<Change>],
    ) {
        if block.is_empty() {
            return;
        }
        let bounds = bounds_of(block.iter().map(|(index, _)| places[*index]));
        let sum = block.iter().map(|(_, normal)| *normal).sum::<DVec3>();
        let axis = sum.try_normalize().unwrap_or(block[0].1);
        let leans = |normal: &DVec3| if normal.dot(axis) > 0.0 { normal.cross(axis).length() } else { f64::INFINITY };
        let lean = block.iter().map(|(_, normal)| leans(normal)).fold(0.0, f64::max);
        let radius = self.cylinder_scale * 0.5;
        if lean * self.reach > COMMON_RADII * radius && block.len() > 1 {
            let (lower, upper) = block.split_at(block.len() / 2);
            self.measure(clouds, places, lower, near, found);
            return self.measure(clouds, places, upper, near, found);
        }
        let cylinder = |place, axis| Cylinder { place, axis, radius, reach: self.reach };
        let common = match block {
            [(index, normal)] => cylinder(places[*index], *normal),
            _ => Cylinder {
                radius: radius + bounds.radius() + lean * self.reach,
                reach: self.reach + bounds.radius() + lean * radius,
                ..cylinder(bounds.center(), axis)
            },
        };
        let mut heights = [vec![None; block.len()], vec![None; block.len()]];
        for (tree, heights) in clouds.into_iter().zip(&mut heights) {
            near.clear();
            tree.near_cylinder(&common, &mut |points| near.extend_from_slice(points));
            for ((index, normal), heights) in block.iter().zip(heights) {
                let own = cylinder(places[*index], *normal);
                let mut sum = Heights::default();
                near.iter().filter_map(|point| own.height_of(*point)).for_each(|height| sum.add(height));
                *heights = (sum.count > 0).then_some(sum);
            }
        }
        let [first, second] = heights;
        for (((index, _), first), second) in block.iter().zip(first).zip(second) {
            found[*index] = first.zip(second).map(|(first, second)| self.change(first, second));
        }
    }

    fn change(&self, first: Heights, second: Heights) -> Change {
        let deviation = (first.variance_of_mean() + second.variance_of_mean()).sqrt();
        let level =
            (first.count.min(second.count) >= LEAST_POINTS).then_some(IN_95_PERCENT * (deviation + self.registration));
        Change { distance: second.mean - first.mean, level }
    }
}

fn bounds_of(places: impl Iterator<Item = DVec3>) -> Bounds {
    let mut bounds = Bounds::EMPTY;
    places.for_each(|place| bounds.include(place));
    bounds
}

/// Divides the places that are finite into blocks of neighbours, whose diagonals are at most `largest`. The blocks follow
/// a curve through space (Morton 1966), so that what one looks up the next finds in the processor's cache.
fn blocks(places: &[DVec3], largest: f64) -> Vec<Vec<usize>> {
    let order = along_curve(places);
    let mut blocks: Vec<Vec<usize>> = Vec::new();
    let mut bounds = Bounds::EMPTY;
    for index in order {
        let place = places[index];
        bounds.include(place);
        match blocks.last_mut() {
            Some(block) if block.len() < MOST_IN_BLOCK && bounds.radius() * 2.0 <= largest => block.push(index),
            _ => {
                bounds = Bounds { min: place, max: place };
                blocks.push(vec![index]);
            }
        }
    }
    blocks
}

/// The numbers of the places that are finite, in the order of a curve through space.
fn along_curve(places: &[DVec3]) -> Vec<usize> {
    let bounds = bounds_of(places.iter().copied());
    let longest = bounds.size().max_element();
    let cells = f64::from(1 << BITS) - 1.0;
    let scale = if longest > 0.0 { cells / longest } else { 0.0 };
    let code = |place: &DVec3| {
        let cell = (*place - bounds.min) * scale;
        spread_bits(cell.x as u64) | spread_bits(cell.y as u64) << 1 | spread_bits(cell.z as u64) << 2
    };
    let finite = places.iter().enumerate().filter(|(_, place)| place.is_finite());
    let mut order: Vec<(u64, usize)> = finite.map(|(index, place)| (code(place), index)).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, index)| index).collect()
}

/// The bits of the numbers of cells along the curve.
const BITS: u32 = 21;

/// Puts two zeros between the lowest 21 bits of a number.
fn spread_bits(number: u64) -> u64 {
    let steps = [(32, 0x001f_0000_0000_ffff), (16, 0x001f_0000_ff00_00ff), (8, 0x100f_00f0_0f00_f00f)];
    let steps = steps.into_iter().chain([(4, 0x10c3_0c30_c30c_30c3), (2, 0x1249_2492_4924_9249)]);
    steps.fold(number & 0x001f_ffff, |bits, (shift, mask)| (bits | bits << shift) & mask)
}

/// The distances to the nearest point of a cloud, one for each place; NaN where a place is not finite.
pub fn nearest_distances(tree: &PointTree, places: &[DVec3]) -> Vec<f64> {
    let mut found = vec![f64::NAN; places.len()];
    for index in along_curve(places) {
        found[index] = tree.distance(places[index]).unwrap_or(f64::NAN);
    }
    found
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
    pub fn of(mut distances: Vec<f64>) -> Option<Self> {
        distances.retain(|distance| distance.is_finite());
        let count = distances.len();
        let mean = distances.iter().sum::<f64>() / count as f64;
        let square = |distance: &f64, about: f64| (distance - about).powi(2);
        let spread = |about: f64| (distances.iter().map(|d| square(d, about)).sum::<f64>() / count as f64).sqrt();
        let (std, rms) = (spread(mean), spread(0.0));
        let mut ranked =
            |rank: usize| (rank < count).then(|| *distances.select_nth_unstable_by(rank, f64::total_cmp).1);
        let (lower, upper) = (ranked(count.checked_sub(1)? / 2)?, ranked(count / 2)?);
        let median = (lower + upper) * 0.5;
        distances.iter_mut().for_each(|distance| *distance = distance.abs());
        let rank = (count * 95).div_ceil(100) - 1;
        let p95 = *distances.select_nth_unstable_by(rank, f64::total_cmp).1;
        let max = distances.iter().copied().fold(0.0, f64::max);
        Some(Self { points: count as u64, mean, median, std, rms, p95, max })
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
        let method = M3c2::new(&trees[0], Some(4.0), Some(2.0), Some(3.0), 0.0, up).unwrap();
        let is_inner = |place: &&DVec3| place.x > 3.0 && place.x < 17.0 && place.y > 3.0 && place.y < 17.0;
        let inner: Vec<DVec3> = at(places.iter().filter(is_inner).step_by(7).copied().collect());
        let found = method.changes(&trees[0], &trees[1], &inner);
        (method, found.into_iter().map(Option::unwrap).collect())
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
        let method = M3c2::new(&first, None, None, None, 0.0, up).unwrap();
        let spacing = spacing(&first).unwrap();
        assert!((0.05..0.2).contains(&spacing), "{spacing}");
        assert_eq!((method.normal_scale, method.cylinder_scale), (10.0 * spacing, 8.0 * spacing));
        let place = DVec3::new(10.0, 10.0, 0.0);
        let change = |second: Vec<DVec3>| method.changes(&first, &PointTree::new(second), &[place])[0];
        assert_eq!(change(Vec::new()), None);
        assert_eq!(change(vec![place + DVec3::Z * 99.0]), None);
        let three = change(vec![place + DVec3::Z; 3]).unwrap();
        assert!((three.distance - 1.0).abs() < 0.02 && three.level.is_none() && !three.is_significant());
        assert!(change(vec![place - DVec3::Z; 4]).unwrap().is_significant());
        assert!(M3c2::new(&first, Some(0.0), None, None, 0.0, up).is_err());
        assert!(M3c2::new(&first, None, None, Some(f64::NAN), 0.0, up).is_err());
        assert!(M3c2::new(&PointTree::new(vec![DVec3::ONE; 3]), None, None, None, 0.0, up).is_err());
        assert!(M3c2::new(&first, None, None, None, -0.1, up).is_err());
    }

    #[test]
    fn blocks_find_what_each_place_finds_alone() {
        // Two sheets that meet at an edge, so that normals of neighbours differ, and points off them.
        let turn = DQuat::from_rotation_y(0.7);
        let mut random = Random(9);
        let mut points: Vec<DVec3> = sheet(0.0, 0.02, 3);
        points.extend(sheet(0.0, 0.02, 4).into_iter().map(|point| turn * point));
        let mut unit = || random.below(1 << 20) as f64 / f64::from(1 << 20);
        points.extend((0..500).map(|_| DVec3::new(unit(), unit(), unit()) * 20.0));
        let second = PointTree::new(points.iter().map(|point| *point + DVec3::new(0.03, 0.01, 0.1)).collect());
        let first = PointTree::new(points.clone());
        let method = M3c2::new(&first, Some(1.5), Some(1.0), Some(4.0), 0.0, Orientation::Up(Vec3::Z)).unwrap();
        points.push(DVec3::NAN);
        points.push(DVec3::splat(1e7));
        let found = method.changes(&first, &second, &points);
        for (place, found) in points.iter().zip(&found).step_by(13).chain(points.iter().zip(&found).rev().take(3)) {
            let alone = method.changes(&first, &second, &[*place])[0];
            match found.zip(alone) {
                Some((a, b)) => {
                    assert!((a.distance - b.distance).abs() < 1e-9, "{a:?} {b:?}");
                    assert_eq!(a.level.is_some(), b.level.is_some());
                    assert!(a.level.zip(b.level).is_none_or(|(a, b)| (a - b).abs() < 1e-9), "{a:?} {b:?}");
                }
                None => assert!(found.is_none() && alone.is_none(), "{place}: {found:?} {alone:?}"),
            }
        }
        assert!(found.iter().filter(|change| change.is_some()).count() > 20_000);
        let distances = nearest_distances(&second, &points);
        let alone = |place: &DVec3| second.distance(*place).unwrap_or(f64::NAN);
        assert!(points.iter().zip(&distances).all(|(place, found)| found.to_bits() == alone(place).to_bits()));
    }

    #[test]
    fn the_registration_adds_its_deviation_to_that_of_the_means() {
        let (first, second) = (PointTree::new(sheet(0.0, 0.05, 1)), PointTree::new(sheet(0.2, 0.05, 2)));
        let level = |registration: f64| {
            let up = Orientation::Up(Vec3::Z);
            let method = M3c2::new(&first, Some(4.0), Some(2.0), Some(3.0), registration, up).unwrap();
            let change = method.changes(&first, &second, &[DVec3::new(10.0, 10.0, 0.0)])[0].unwrap();
            (change.level.unwrap(), change.is_significant())
        };
        let (alone, is_significant) = level(0.0);
        assert!(is_significant && (level(0.01).0 - alone - 0.0196).abs() < 1e-6);
        assert!(!level(0.1).1, "0.2 is within 1.96 * 0.1 and the deviation of the means");
    }

    #[test]
    fn figures_are_those_of_the_distances() {
        let figures = DistanceFigures::of(vec![3.0, -4.0, f64::NAN, 0.0, 1.0]).unwrap();
        assert_eq!((figures.points, figures.mean, figures.median), (4, 0.0, 0.5));
        assert_eq!((figures.std, figures.rms), (6.5_f64.sqrt(), 6.5_f64.sqrt()));
        assert_eq!((figures.p95, figures.max), (4.0, 4.0));
        let hundred = DistanceFigures::of((1..=100).map(f64::from).collect()).unwrap();
        assert_eq!((hundred.mean, hundred.median, hundred.p95, hundred.max), (50.5, 50.5, 95.0, 100.0));
        assert_eq!(DistanceFigures::of(vec![f64::NAN]), None);
    }
}
