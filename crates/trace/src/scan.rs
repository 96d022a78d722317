//! Made scans with mirrors: what a range scanner writes down where its beam meets mirrors and panes.
//!
//! A scanner sends its beam out on the grid of angles of `scene::tripod` and writes down one point for each ray, on the
//! straight line, at the length of the way. Where a mirror bends the way, that point is a ghost behind the mirror. A pane
//! reflects a share of the beam and lets the rest through; the scanner writes down the strongest of the returns.

use cloud::unit;
use glam::DVec3;
use scene::tripod::{Disturbance, Measured, sweep};

use crate::{Exact, Geometry as _, Hit, Ray};

/// The most mirrors and panes that one way meets. Longer ways are lost.
pub const MOST_MEETINGS: usize = 4;

/// Where the return comes from that a scanner wrote down for a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echo {
    /// The place that sent the light back, without noise.
    pub place: DVec3,
    /// The length of the way from the scanner to that place.
    pub length: f64,
    /// The linear albedo there.
    pub albedo: DVec3,
    /// The surfaces of `Exact` that reflected the beam, counted from 1 in the order of the way; 0 after the last.
    pub mirrors: [u8; MOST_MEETINGS],
    /// The strength of the return: the shares of all mirrors on the way there and back, the albedo and the cosine of the
    /// incidence, over the squared length, times the speckle of the surface.
    pub strength: f64,
}

impl Echo {
    /// Whether a mirror bent the way.
    pub fn is_ghost(&self) -> bool {
        self.mirrors[0] != 0
    }
}

/// Weaker returns are lost: those of a surface of albedo 0.1 that faces the scanner at 80 m.
const WEAKEST: f64 = 0.1 / (80.0 * 80.0);
/// The standard deviation of the logarithm of a return's strength: how rough surfaces look in laser light.
const SPECKLE: f64 = 0.5;
/// A pane that the beam meets at less than this angle to its normal, in radians, sends it straight back.
const STRAIGHT_BACK: f64 = 0.026;

/// The scan of one station. The disturbances, the grid and the draws are those of `sweep`.
pub fn scan(
    scene: &Exact,
    disturbance: &Disturbance,
    station: DVec3,
    rays: f64,
    seed: u64,
    number: usize,
) -> Vec<Measured<Echo>> {
    sweep(disturbance, rays, seed, number, |ray, direction| {
        let mut returns = Returns { scene, seed: seed ^ (number as u64) << 32 ^ ray as u64, count: 0, strongest: None };
        returns.follow(&Ray::from_eye(station, direction), Way::START);
        returns.strongest.map(|echo| (echo.length, echo))
    })
}

/// The part of a way that the beam has gone.
#[derive(Clone, Copy)]
struct Way {
    length: f64,
    /// The share of the light that is left.
    share: f64,
    mirrors: [u8; MOST_MEETINGS],
    meetings: usize,
}

impl Way {
    const START: Self = Self { length: 0.0, share: 1.0, mirrors: [0; MOST_MEETINGS], meetings: 0 };

    fn reflected(self, hit: &Hit, share: f64) -> Self {
        let mut mirrors = self.mirrors;
        if let Some(next) = mirrors.iter_mut().find(|mirror| **mirror == 0) {
            *next = hit.surface as u8 + 1;
        }
        Self { mirrors, ..self.passed(hit, share) }
    }

    fn passed(self, hit: &Hit, share: f64) -> Self {
        let length = self.length + hit.distance;
        Self { length, share: self.share * share, meetings: self.meetings + 1, ..self }
    }
}

/// The returns of one ray.
struct Returns<'a> {
    scene: &'a Exact,
    seed: u64,
    count: u64,
    strongest: Option<Echo>,
}

impl Returns<'_> {
    /// Follows all ways on which light of this ray goes out and comes back.
    fn follow(&mut self, ray: &Ray, way: Way) {
        let Some(hit) = self.scene.nearest(ray) else { return };
        let reflected = hit.specular_intensity.clamp(0.0, 1.0);
        let facing = -hit.normal.dot(ray.direction);
        if reflected == 0.0 {
            self.add(&hit, way, facing);
            return;
        }
        if hit.medium.is_none() && reflected < 1.0 {
            // A dull mirror scatters the rest.
            self.add(&hit, way, facing * (1.0 - reflected));
        }
        if hit.medium.is_some() && facing > STRAIGHT_BACK.cos() {
            self.add(&hit, way, reflected);
        }
        if way.meetings == MOST_MEETINGS {
            return;
        }
        let bent = ray.direction + hit.normal * (2.0 * facing);
        self.follow(&Ray::from_surface(hit.position, bent), way.reflected(&hit, reflected));
        if hit.medium.is_some() {
            let beyond = Ray::from_surface(hit.position, ray.direction);
            self.follow(&beyond, way.passed(&hit, 1.0 - reflected));
        }
    }

    fn add(&mut self, hit: &Hit, way: Way, scattered: f64) {
        let length = way.length + hit.distance;
        let albedo = hit.albedo.element_sum() / 3.0;
        let strength = way.share * way.share * albedo * scattered / (length * length);
        let [one, other] = [2 * self.count, 2 * self.count + 1].map(|draw| unit(self.seed, draw));
        self.count += 1;
        // Box and Muller (1958).
        let normal = (-2.0 * (1.0 - one).ln()).sqrt() * (std::f64::consts::TAU * other).cos();
        let seen = strength * (SPECKLE * normal).exp();
        if strength > WEAKEST && self.strongest.is_none_or(|strongest| seen > strongest.strength) {
            let Way { mirrors, .. } = way;
            self.strongest = Some(Echo { place: hit.position, length, albedo: hit.albedo, mirrors, strength: seen });
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use scene::solid::Solid;
    use scene::{Mirror, Shape};

    use super::*;

    /// A wall at x = 4 and one at x = -6, and a mirror or pane at x = 2 that faces the origin.
    fn between(change: impl Fn(&mut Mirror)) -> Exact {
        let turned = DQuat::from_rotation_arc(DVec3::Z, DVec3::NEG_X);
        let mut mirror = Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::X * 2.0, DVec3::Z, DVec3::Y, 1.0);
        (mirror.position, mirror.rotation) = (DVec3::X * 2.0, turned);
        change(&mut mirror);
        let walls =
            [[4.0, 5.0], [-7.0, -6.0]].map(|[from, to]| Solid::block([from, -9.0, -9.0], [to, 9.0, 9.0], [0.5; 3]));
        Exact::of_mirrors(&[mirror]).with_solids(walls.to_vec())
    }

    #[test]
    fn a_mirror_puts_a_ghost_behind_itself_at_the_length_of_the_way() {
        let points = scan(&between(|_| ()), &Disturbance::default(), DVec3::ZERO, 50_000.0, 1, 0);
        let ghosts: Vec<_> = points.iter().filter(|point| point.met.is_ghost()).collect();
        assert!(ghosts.len() > 500, "{}", ghosts.len());
        for ghost in ghosts {
            // The mirror image of the wall at -6 in the mirror at 2 lies at 10.
            let place = ghost.direction * ghost.range;
            assert!((place.x - 10.0).abs() < 1e-9 && (ghost.met.place.x + 6.0).abs() < 1e-9, "{place}");
            assert!((place.y - ghost.met.place.y).abs() < 1e-9, "{place}");
        }
        assert!(points.iter().all(|point| point.is_whole && (point.range - point.met.length).abs() < 1e-12));
    }

    #[test]
    fn a_pane_gives_ghosts_and_what_is_behind_it_by_the_share_that_it_reflects() {
        let share = |reflected: f32| {
            let scene = between(|pane| (pane.specular_intensity, pane.refraction) = (reflected, Some(1.0)));
            let points = scan(&scene, &Disturbance::default(), DVec3::ZERO, 50_000.0, 1, 0);
            let is_at_pane = |way: DVec3| way.x > 0.5 && way.y.abs().max(way.z.abs()) < 0.5 * way.x;
            let seen = points.iter().filter(|point| is_at_pane(point.direction));
            let ghosts: Vec<bool> = seen.map(|point| point.met.is_ghost()).collect();
            ghosts.iter().filter(|ghost| **ghost).count() as f64 / ghosts.len() as f64
        };
        let [weak, half, strong] = [0.1, 0.7, 0.95].map(share);
        assert!(weak < 0.02 && (0.05..0.95).contains(&half) && strong > 0.98, "{weak} {half} {strong}");
    }

    #[test]
    fn weak_returns_are_lost() {
        let reach = |reflected: f32| {
            let scene = between(|mirror| (mirror.specular_intensity, mirror.color) = (reflected, [0.0; 3]));
            let points = scan(&scene, &Disturbance::default(), DVec3::ZERO, 20_000.0, 1, 0);
            points.iter().filter(|point| point.met.is_ghost()).count()
        };
        assert!(reach(1.0) > 100 && reach(0.02) == 0);
    }
}
