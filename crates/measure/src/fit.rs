//! Planes, circles and cylinders through points, by least squares of the distances of the points from them.

use std::collections::HashMap;

use cloud::smallest_eigenvector;
use glam::{DMat3, DVec3};

use crate::error::{Error, Result};

/// A plane through points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// The mean of the points.
    pub center: DVec3,
    /// Unit vector; its sign is arbitrary.
    pub normal: DVec3,
    /// The root of the mean square of the points' distances.
    pub rms: f64,
    pub points: usize,
    /// The covariance of the points.
    covariance: DMat3,
    /// The design effect: by how much the variance of the slope is larger than if points erred independently.
    design_effect: f64,
}

/// A circle, or a cylinder, through points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// The middle of a circle, or the place on the axis of a cylinder amid the points.
    pub center: DVec3,
    /// Unit vector across the circle or along the cylinder; its sign is arbitrary.
    pub axis: DVec3,
    pub radius: f64,
    /// The standard deviation of the radius that follows from the points' scatter, and from how alike neighbours err.
    pub radius_deviation: f64,
    /// The root of the mean square of the points' distances from the circle or the cylinder.
    pub rms: f64,
    pub points: usize,
    /// How far the points reach along the axis.
    pub length: f64,
}

/// The axes that are tried for a cylinder, spread over half of a sphere.
const DIRECTIONS: u32 = 400;
/// How many of them are refined.
const REFINED: usize = 4;
/// The most points by which an axis is chosen; the fit itself takes all.
const MOST_TRIED: usize = 600;
/// The most steps of a refinement; a good start needs about five.
const MOST_STEPS: usize = 100;
/// The least number of clusters of neighbours by which a fit finds how alike they err.
const CLUSTERS: usize = 24;
/// The largest radius over the points' spread: beyond it, nothing tells an arc from a line.
const FLATTEST: f64 = 1e3;

impl Plane {
    /// The standard deviation of the points' distances, if they are from a plane: a plane fits three points anyhow.
    pub fn noise(&self) -> f64 {
        self.rms * (self.points as f64 / (self.points as f64 - 3.0).max(1.0)).sqrt()
    }

    /// The standard deviation of its height above the center, if the points scatter independently.
    pub fn deviation(&self) -> f64 {
        self.noise() / (self.points as f64).sqrt()
    }

    /// The standard deviation in radians of its slope along a direction in it (unit vector), by the points' scatter and
    /// how alike neighbours err.
    pub fn tilt_deviation(&self, along: DVec3) -> f64 {
        self.design_effect.sqrt() * self.deviation() / along.dot(self.covariance * along).max(0.0).sqrt()
    }
}

/// Numbers the occupied cells of a grid of cubes, which is made finer until they are enough. Returns the number of each
/// point's cell and how many there are.
fn clusters(points: &[DVec3]) -> (Vec<usize>, usize) {
    let (low, high) = points
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| (low.min(*point), high.max(*point)));
    let mut edge = (high - low).max_element() / 4.0;
    for _ in 0..MOST_STEPS {
        let mut numbers = HashMap::new();
        let number = |point: &DVec3| {
            let next = numbers.len();
            *numbers.entry(((*point - low) / edge).as_i64vec3()).or_insert(next)
        };
        let of_points: Vec<usize> = points.iter().map(number).collect();
        if numbers.len() >= CLUSTERS {
            return (of_points, numbers.len());
        }
        edge *= 0.8;
    }
    (vec![0; points.len()], 1)
}

/// The design effects of fitted values: by how much their variances are larger than if the points erred independently.
/// `added` is what each point adds to the errors of the values. It is summed over clusters of neighbours before it is
/// squared (Liang and Zeger 1986). One where that is within chance, and where points are few.
fn design_effect<const VALUES: usize>(points: &[DVec3], added: impl Fn(&DVec3) -> [f64; VALUES]) -> [f64; VALUES] {
    if points.len() < 4 * CLUSTERS {
        return [1.0; VALUES];
    }
    let (numbers, count) = clusters(points);
    let mut sums = vec![[(0.0, 0.0); VALUES]; count];
    for (point, number) in points.iter().zip(numbers) {
        for ((sum, squares), added) in sums[number].iter_mut().zip(added(point)) {
            *sum += added;
            *squares += added * added;
        }
    }
    std::array::from_fn(|value| {
        let of_clusters = || sums.iter().map(|sums| sums[value]);
        let alone: f64 = of_clusters().map(|(_, squares)| squares).sum();
        let together: f64 = of_clusters().map(|(sum, _)| sum * sum).sum();
        let chance = (2.0 * of_clusters().map(|(_, squares)| (squares / alone).powi(2)).sum::<f64>()).sqrt();
        let ratio = together / alone;
        if ratio > 1.0 + 3.0 * chance { ratio } else { 1.0 }
    })
}

fn mean(points: &[DVec3]) -> DVec3 {
    let first = points.first().copied().unwrap_or_default();
    first + points.iter().map(|point| *point - first).sum::<DVec3>() / points.len() as f64
}

/// # Errors
/// Fewer than four points, or no plane is the best one.
pub fn plane(points: &[DVec3]) -> Result<Plane> {
    if points.len() < 4 {
        return Err(Error::TooFew { points: points.len(), least: 4 });
    }
    let (center, count) = (mean(points), points.len() as f64);
    let covariance = points.iter().fold(DMat3::ZERO, |sum, point| {
        let offset = *point - center;
        sum + DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z)
    });
    let covariance = covariance * count.recip();
    let normal = smallest_eigenvector(covariance).ok_or(Error::NoPlane)?;
    let squares: f64 = points.iter().map(|point| (*point - center).dot(normal).powi(2)).sum();
    let (u, v) = normal.any_orthonormal_pair();
    let [along_u, along_v] = design_effect(points, |point| {
        let offset = *point - center;
        [u, v].map(|along| offset.dot(normal) * offset.dot(along))
    });
    let design_effect = along_u.max(along_v);
    Ok(Plane { center, normal, rms: (squares / count).sqrt(), points: points.len(), covariance, design_effect })
}

/// A circle: in the plane through the points. Three have exactly one circle, whose deviations are then unknown (NaN).
///
/// # Errors
/// Fewer than three points, or they are on no arc of a plane.
pub fn circle(points: &[DVec3]) -> Result<Round> {
    if points.len() < 3 {
        return Err(Error::TooFew { points: points.len(), least: 3 });
    }
    let scaled = Scaled::new(points);
    if let [a, b, c] = points {
        let normal = (*b - *a).cross(*c - *a).try_normalize().ok_or(Error::NotRound)?;
        let round = scaled.circle(&scaled.points, normal).filter(|round| round.radius < FLATTEST);
        let round = round.ok_or(Error::NotRound)?;
        return Ok(scaled.unscaled(Round { radius_deviation: f64::NAN, ..round }));
    }
    let Plane { normal, rms: off_plane, .. } = plane(points)?;
    let start = scaled.circle(&scaled.points, normal).ok_or(Error::NotRound)?;
    let round = scaled.unscaled(scaled.refined(&scaled.points, start, false)?);
    Ok(Round { rms: round.rms.hypot(off_plane), ..round })
}

/// # Errors
/// Fewer than nine points, or a plane fits them better than a cylinder.
pub fn cylinder(points: &[DVec3]) -> Result<Round> {
    if points.len() < 9 {
        return Err(Error::TooFew { points: points.len(), least: 9 });
    }
    let scaled = Scaled::new(points);
    let step = points.len().div_ceil(MOST_TRIED);
    let tried: Vec<DVec3> = scaled.points.iter().copied().step_by(step).collect();
    let direction = |number: u32| {
        // A spiral over half of a sphere, with equal areas (Swinbank and Purser 2006).
        let height = (f64::from(number) + 0.5) / f64::from(DIRECTIONS);
        let (sine, cosine) = (f64::from(number) * (5.0_f64.sqrt() - 1.0) * std::f64::consts::PI).sin_cos();
        let level = (1.0 - height * height).sqrt();
        DVec3::new(cosine * level, sine * level, height)
    };
    let mut starts: Vec<Round> = (0..DIRECTIONS).filter_map(|i| scaled.circle(&tried, direction(i))).collect();
    starts.sort_by(|a, b| a.rms.total_cmp(&b.rms));
    let refined = starts.into_iter().take(REFINED).filter_map(|start| scaled.refined(&tried, start, true).ok());
    let best = refined.min_by(|a, b| a.rms.total_cmp(&b.rms)).ok_or(Error::NotRound)?;
    let fit = scaled.unscaled(scaled.refined(&scaled.points, best, true)?);
    // Of points on a plane, the best cylinder is one without end.
    let is_flat = plane(points).is_ok_and(|plane| plane.rms <= fit.rms);
    if is_flat { Err(Error::NotRound) } else { Ok(fit) }
}

/// Points about their mean, in units of their spread, so that all numbers of a fit are about one.
struct Scaled {
    points: Vec<DVec3>,
    mean: DVec3,
    spread: f64,
}

impl Scaled {
    fn new(points: &[DVec3]) -> Self {
        let mean = mean(points);
        let squares: f64 = points.iter().map(|point| point.distance_squared(mean)).sum();
        let spread = (squares / points.len() as f64).sqrt();
        Self { points: points.iter().map(|point| (*point - mean) / spread).collect(), mean, spread }
    }

    fn unscaled(&self, round: Round) -> Round {
        let Self { mean, spread, .. } = *self;
        Round {
            center: mean + round.center * spread,
            radius: round.radius * spread,
            radius_deviation: round.radius_deviation * spread,
            rms: round.rms * spread,
            length: round.length * spread,
            ..round
        }
    }

    /// The circle that solves the linear equations of points on a circle, as seen along an axis (Kåsa 1976). It is too
    /// small for a short arc with noise, but a good start.
    fn circle(&self, points: &[DVec3], axis: DVec3) -> Option<Round> {
        let (u, v) = axis.any_orthonormal_pair();
        let flat = || points.iter().map(|point| (point.dot(u), point.dot(v)));
        let mut system = System::new(3);
        for (x, y) in flat() {
            system.add(&[x, y, 1.0], x * x + y * y);
        }
        let [x, y, rest, ..] = system.solve(0.0)?;
        let (x, y) = (x * 0.5, y * 0.5);
        let radius = (rest + x * x + y * y).sqrt();
        let squares: f64 = flat().map(|(a, b)| ((a - x).hypot(b - y) - radius).powi(2)).sum();
        let rms = (squares / points.len() as f64).sqrt();
        let round = Round {
            center: u * x + v * y,
            axis,
            radius,
            radius_deviation: 0.0,
            rms,
            points: points.len(),
            length: 0.0,
        };
        rms.is_finite().then_some(round)
    }

    /// Turns and moves a circle's or cylinder's axis and changes its radius until the squares of the distances are least
    /// (Levenberg and Marquardt). The axis of a circle does not turn.
    fn refined(&self, points: &[DVec3], start: Round, turns: bool) -> Result<Round> {
        let unknowns = if turns { 5 } else { 3 };
        if points.len() <= unknowns {
            return Err(Error::TooFew { points: points.len(), least: unknowns + 1 });
        }
        let cost = |round: &Round| points.iter().map(|point| distance(round, *point).powi(2)).sum::<f64>();
        let (mut round, mut damping) = (start, 1e-3);
        let mut least = cost(&round);
        for _ in 0..MOST_STEPS {
            let system = linear(&round, points, unknowns);
            let Some(step) = system.solve(damping) else { break };
            let moved = stepped(&round, step);
            let now = cost(&moved);
            if now < least {
                let gain = least - now;
                (round, least, damping) = (moved, now, (damping * 0.1).max(1e-12));
                if gain <= least * 1e-14 {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e9 {
                    break;
                }
            }
        }
        if !(round.radius > 0.0 && round.radius < FLATTEST) {
            return Err(Error::NotRound);
        }
        let mut system = linear(&round, points, unknowns);
        system.right = std::array::from_fn(|row| if row + 1 == unknowns { 1.0 } else { 0.0 });
        // How the radius follows the equations of the points; its last number is the radius' own variance.
        let follows = system.solve(0.0).ok_or(Error::NotRound)?;
        let added = |point: &DVec3| {
            let slopes = slopes(&round, *point, unknowns);
            [slopes.iter().zip(follows).map(|(slope, share)| slope * share).sum::<f64>() * distance(&round, *point)]
        };
        let [design_effect] = design_effect(points, added);
        let own = follows[unknowns - 1];
        let (count, free) = (points.len() as f64, (points.len() - unknowns) as f64);
        let along = |point: &DVec3| (*point - round.center).dot(round.axis);
        let low = points.iter().map(along).fold(f64::INFINITY, f64::min);
        let high = points.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
        let shift = if turns { round.axis * ((low + high) * 0.5) } else { -round.axis * round.center.dot(round.axis) };
        Ok(Round {
            center: round.center + shift,
            radius_deviation: (least / free * own * design_effect).sqrt(),
            rms: (least / count).sqrt(),
            points: points.len(),
            length: high - low,
            ..round
        })
    }
}

/// How far outside of the lateral surface a point lies.
fn distance(round: &Round, point: DVec3) -> f64 {
    (point - round.center).reject_from_normalized(round.axis).length() - round.radius
}

/// By how much the distance of a point changes with the two coordinates of the center across the axis, with the axis'
/// two turns if they are free, and with the radius.
fn slopes(round: &Round, point: DVec3, unknowns: usize) -> [f64; MOST] {
    let (u, v) = round.axis.any_orthonormal_pair();
    let offset = point - round.center;
    let along = offset.dot(round.axis);
    let outward = (offset - round.axis * along).normalize_or_zero();
    let (a, b) = (outward.dot(u), outward.dot(v));
    if unknowns == 5 { [-a, -b, -along * a, -along * b, -1.0] } else { [-a, -b, -1.0, 0.0, 0.0] }
}

/// The equations of a step.
fn linear(round: &Round, points: &[DVec3], unknowns: usize) -> System {
    let mut system = System::new(unknowns);
    for point in points {
        system.add(&slopes(round, *point, unknowns)[..unknowns], -distance(round, *point));
    }
    system
}

fn stepped(round: &Round, step: [f64; MOST]) -> Round {
    let (u, v) = round.axis.any_orthonormal_pair();
    let (turn, radius) =
        if step[3..] == [0.0; 2] { (DVec3::ZERO, step[2]) } else { (u * step[2] + v * step[3], step[4]) };
    Round {
        center: round.center + u * step[0] + v * step[1],
        axis: (round.axis + turn).normalize_or(round.axis),
        radius: round.radius + radius,
        ..*round
    }
}

/// The most unknowns of a system.
const MOST: usize = 5;

/// The normal equations of a linear least-squares problem.
struct System {
    unknowns: usize,
    matrix: [[f64; MOST]; MOST],
    right: [f64; MOST],
}

impl System {
    fn new(unknowns: usize) -> Self {
        Self { unknowns, matrix: [[0.0; MOST]; MOST], right: [0.0; MOST] }
    }

    /// Adds the equation `slopes · x = value`.
    fn add(&mut self, slopes: &[f64], value: f64) {
        for (row, slope) in slopes.iter().enumerate() {
            self.right[row] += slope * value;
            for (column, other) in slopes.iter().enumerate() {
                self.matrix[row][column] += slope * other;
            }
        }
    }

    /// The lower triangle whose square is the matrix with a larger diagonal (Cholesky).
    fn triangle(&self, damping: f64) -> Option<[[f64; MOST]; MOST]> {
        let mut lower = [[0.0; MOST]; MOST];
        for row in 0..self.unknowns {
            for column in 0..=row {
                let known: f64 = (0..column).map(|k| lower[row][k] * lower[column][k]).sum();
                let own = self.matrix[row][column] * if row == column { 1.0 + damping } else { 1.0 };
                let rest = own - known;
                if row == column {
                    // What is left of a diagonal that rounding alone fills is nothing.
                    if rest.is_nan() || rest <= own * 1e-14 {
                        return None;
                    }
                    lower[row][column] = rest.sqrt();
                } else {
                    lower[row][column] = rest / lower[column][column];
                }
            }
        }
        Some(lower)
    }

    fn solve(&self, damping: f64) -> Option<[f64; MOST]> {
        let lower = self.triangle(damping)?;
        let mut solution = self.right;
        for row in 0..self.unknowns {
            let known: f64 = (0..row).map(|k| lower[row][k] * solution[k]).sum();
            solution[row] = (solution[row] - known) / lower[row][row];
        }
        for row in (0..self.unknowns).rev() {
            let known: f64 = (row + 1..self.unknowns).map(|k| lower[k][row] * solution[k]).sum();
            solution[row] = (solution[row] - known) / lower[row][row];
        }
        Some(solution)
    }
}

#[cfg(test)]
pub mod tests {
    use std::f64::consts::TAU;

    use cloud::Random;
    use glam::DQuat;

    use super::*;

    /// Draws numbers for made-up scans.
    pub struct Dice(Random);

    impl Dice {
        pub fn new(seed: u64) -> Self {
            Self(Random(seed))
        }

        /// A number from 0 to 1.
        pub fn share(&mut self) -> f64 {
            (self.0.draw() >> 11) as f64 / (1_u64 << 53) as f64
        }

        /// A number of the normal distribution (Box and Muller).
        pub fn noise(&mut self, deviation: f64) -> f64 {
            let (a, b) = (self.share(), self.share());
            (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos() * deviation
        }
    }

    const PLACE: DVec3 = DVec3::new(635_000.0, 5_077_000.0, 120.0);

    fn turn() -> DQuat {
        DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.9)
    }

    /// Points of a square wall with noise across it; and its normal.
    pub fn wall(dice: &mut Dice, count: usize, edge: f64, noise: f64) -> (DVec3, Vec<DVec3>) {
        let mut point = || DVec3::new((dice.share() - 0.5) * edge, (dice.share() - 0.5) * edge, dice.noise(noise));
        (turn() * DVec3::Z, (0..count).map(|_| PLACE + turn() * point()).collect())
    }

    /// Points of a part of a tube, in shares of its turn; and its axis.
    fn tube(dice: &mut Dice, count: usize, radius: f64, share: f64, length: f64, noise: f64) -> (DVec3, Vec<DVec3>) {
        let mut point = || {
            let (sine, cosine) = (dice.share() * share * TAU).sin_cos();
            let away = radius + dice.noise(noise);
            DVec3::new(cosine * away, sine * away, (dice.share() - 0.5) * length)
        };
        (turn() * DVec3::Z, (0..count).map(|_| PLACE + turn() * point()).collect())
    }

    #[test]
    fn a_plane_through_a_wall_has_its_normal_and_noise() {
        let mut dice = Dice::new(1);
        let (normal, points) = wall(&mut dice, 10_000, 4.0, 0.01);
        let plane = plane(&points).unwrap();
        assert!((plane.noise() / 0.01 - 1.0).abs() < 0.03, "{plane:?}");
        // The normal is off by the noise over the root of the number and the spread, 4 / sqrt(12).
        let off = plane.normal.cross(normal).length();
        assert!(off < 4.0 * 0.01 / (100.0 * 4.0 / 12.0_f64.sqrt()), "{off}");
        assert!((plane.center - PLACE).dot(normal).abs() < 4.0 * plane.deviation());
        assert!((plane.deviation() - 0.0001).abs() < 1e-5);
        let along = normal.any_orthonormal_vector();
        let tilt = 0.0001 / (4.0 / 12.0_f64.sqrt());
        assert!((plane.tilt_deviation(along) / tilt - 1.0).abs() < 0.05, "{}", plane.tilt_deviation(along));
        let (_, exact) = wall(&mut dice, 100, 4.0, 0.0);
        assert!(super::plane(&exact).unwrap().rms < 1e-8);
    }

    #[test]
    fn a_circle_through_an_arc_has_its_radius_within_the_stated_deviation() {
        let mut dice = Dice::new(2);
        for share in [1.0, 0.5, 0.2] {
            let (axis, points) = tube(&mut dice, 2000, 1.5, share, 0.0, 0.004);
            let circle = circle(&points).unwrap();
            assert!((circle.radius - 1.5).abs() < 4.0 * circle.radius_deviation, "{share}: {circle:?}");
            assert!(circle.center.distance(PLACE) < 0.02 && circle.axis.dot(axis).abs() > 1.0 - 1e-9, "{circle:?}");
            assert!((circle.rms / 0.004 - 1.0).abs() < 0.1, "{circle:?}");
        }
        // Of a whole turn, the radius is known to the noise over the root of the number.
        let (_, points) = tube(&mut dice, 2000, 1.5, 1.0, 0.0, 0.004);
        let deviation = circle(&points).unwrap().radius_deviation;
        assert!((deviation / (0.004 / 2000.0_f64.sqrt()) - 1.0).abs() < 0.1, "{deviation}");
    }

    #[test]
    fn three_points_have_one_circle() {
        let corner = |degrees: f64| {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            PLACE + turn() * DVec3::new(cosine, sine, 0.0) * 2.5
        };
        let round = circle(&[10.0, 80.0, 200.0].map(corner)).unwrap();
        assert!((round.radius - 2.5).abs() < 1e-8 && round.center.distance(PLACE) < 1e-8, "{round:?}");
        assert!(round.radius_deviation.is_nan());
        let line = [0.0, 1.0, 3.0].map(|x| PLACE + DVec3::X * x);
        assert!(matches!(circle(&line), Err(Error::NotRound)));
        assert!(matches!(circle(&line[..2]), Err(Error::TooFew { points: 2, least: 3 })));
    }

    #[test]
    fn deviations_of_many_fits_are_what_each_of_them_states() {
        let mut dice = Dice::new(3);
        let (mut squares, mut stated, fits) = (0.0, 0.0, 60);
        for _ in 0..fits {
            let (_, points) = tube(&mut dice, 300, 0.4, 0.4, 1.0, 0.005);
            let fit = cylinder(&points).unwrap();
            squares += (fit.radius - 0.4).powi(2);
            stated += fit.radius_deviation.powi(2);
        }
        let ratio = (squares / stated).sqrt();
        // The root of a sum of 60 squares scatters by 9 %.
        assert!((0.7..1.35).contains(&ratio), "{ratio}");
    }

    #[test]
    fn deviations_hold_where_patches_of_the_surface_are_off_together() {
        let mut dice = Dice::new(5);
        let (mut radii, mut slopes, fits) = ([0.0; 2], [0.0; 2], 60);
        for _ in 0..fits {
            // Leaves of a tenth of a meter, each 2 cm off.
            let leaves: Vec<f64> = (0..400).map(|_| dice.noise(0.02)).collect();
            let leaf = |x: f64, y: f64| leaves[(x / 0.1) as usize % 20 * 20 + (y / 0.1) as usize % 20];
            let place = |_| (dice.share() * 2.0, dice.share() * 2.0, dice.noise(0.002));
            let places: Vec<_> = (0..4000).map(place).collect();
            let bent = |(x, y, noise): &(f64, f64, f64)| {
                let (sine, cosine) = x.sin_cos();
                PLACE + turn() * (DVec3::new(cosine, sine, 0.0) * (1.0 + noise + leaf(*x, *y)) + DVec3::Z * *y)
            };
            let fit = cylinder(&places.iter().map(bent).collect::<Vec<_>>()).unwrap();
            radii[0] += (fit.radius - 1.0).powi(2);
            radii[1] += fit.radius_deviation.powi(2);
            let level = |(x, y, noise): &(f64, f64, f64)| PLACE + turn() * DVec3::new(*x, *y, noise + leaf(*x, *y));
            let fit = plane(&places.iter().map(level).collect::<Vec<_>>()).unwrap();
            slopes[0] += (turn() * DVec3::X).dot(fit.normal / fit.normal.dot(turn() * DVec3::Z)).powi(2);
            slopes[1] += fit.tilt_deviation(turn() * DVec3::X).powi(2);
        }
        for [squares, stated] in [radii, slopes] {
            let ratio = (squares / stated).sqrt();
            assert!((0.7..1.35).contains(&ratio), "{ratio}");
        }
    }

    #[test]
    fn a_cylinder_through_a_pipe_has_its_axis_radius_length_and_noise() {
        let mut dice = Dice::new(4);
        for (radius, share, length) in [(0.15, 1.0, 2.0), (0.15, 0.4, 2.0), (3.0, 0.3, 1.0), (1.0, 1.0, 0.5)] {
            let (axis, points) = tube(&mut dice, 5000, radius, share, length, 0.002);
            let fit = cylinder(&points).unwrap();
            assert!((fit.radius - radius).abs() < 4.0 * fit.radius_deviation, "{fit:?}");
            assert!((fit.rms / 0.002 - 1.0).abs() < 0.1, "{fit:?}");
            assert!(fit.axis.cross(axis).length() < 0.01, "{fit:?}");
            assert!((fit.length / length - 1.0).abs() < 0.02, "{fit:?}");
            assert!((fit.center - PLACE).reject_from_normalized(axis).length() < 0.02, "{fit:?}");
        }
        let (_, exact) = tube(&mut dice, 50, 0.5, 0.6, 2.0, 0.0);
        let fit = cylinder(&exact).unwrap();
        assert!((fit.radius - 0.5).abs() < 1e-6 && fit.rms < 1e-7, "{fit:?}");
    }

    #[test]
    fn what_has_no_plane_or_curvature_is_refused() {
        let line: Vec<DVec3> = (0..20).map(|i| PLACE + DVec3::new(1.0, 2.0, 3.0) * f64::from(i)).collect();
        assert!(matches!(plane(&line), Err(Error::NoPlane)), "{:?}", plane(&line));
        assert!(matches!(plane(&line[..3]), Err(Error::TooFew { points: 3, least: 4 })));
        assert!(matches!(cylinder(&line[..8]), Err(Error::TooFew { points: 8, least: 9 })));
        assert!(cylinder(&line).is_err() && circle(&line).is_err());
        let level: Vec<DVec3> = (0..400).map(|i| DVec3::new(f64::from(i % 20), f64::from(i / 20), 0.0)).collect();
        assert!(matches!(cylinder(&level), Err(Error::NotRound)), "{:?}", cylinder(&level));
    }
}
