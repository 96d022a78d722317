//! The way of a scanner's beam by way of mirrors, from the straight line on which its point was written down.
//!
//! The scanner at S wrote a point down in the direction d at the range g. Its beam met a mirror at P = S + p d, where the
//! unit normal is n, and went on along r = d - 2 (d.n) n for the rest of the way: the point is at Q = P + (g - p) r. Each
//! further mirror on that way bends it again, for any shape whose first hit and normal are known.

use glam::DVec3;
use scene::Mirror;
use trace::scan::MOST_MEETINGS;
use trace::{Exact, Geometry as _, Hit, Ray};

/// A mirror, and what is known of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Reflector {
    pub mirror: Mirror,
    /// Whether the scanner may have seen points through it: a pane, or a mirror whose outline is only roughly known.
    pub is_open: bool,
    /// The standard deviation of its place along its normal, in world units.
    pub place_error: f64,
    /// The standard deviation of its normal, in radians.
    pub angle_error: f64,
}

impl Reflector {
    /// A mirror that is known exactly. Points are seen through it if it is clear.
    pub fn exact(mirror: Mirror) -> Self {
        let is_open = mirror.refraction.is_some();
        Self { mirror, is_open, place_error: 0.0, angle_error: 0.0 }
    }
}

/// The errors of a scanner, as standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScannerError {
    /// Of ranges, in world units.
    pub range: f64,
    /// Of directions, in radians.
    pub angle: f64,
}

/// Mirrors with a tree-free search: each has a ball about it that most rays miss.
#[derive(Clone, Debug)]
pub struct Mirrors {
    reflectors: Vec<Reflector>,
    exact: Exact,
    /// The reflector of each surface of `exact`.
    of_surface: Vec<usize>,
    balls: Vec<(DVec3, f64)>,
}

/// A way that a beam may have gone from the scanner to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// The place at its end.
    pub place: DVec3,
    /// The numbers, from 1, of the mirrors that bent it, in its order; 0 after the last.
    pub mirrors: [u8; MOST_MEETINGS],
    /// The length of the way behind the first of them; 0 for a straight way.
    pub rest: f64,
    /// The unit direction in which the beam comes to the place.
    pub arrival: DVec3,
    /// A bit for each mirror or pane that it met, in its order: whether that bent it.
    bends: u8,
    meetings: u8,
}

impl Way {
    /// Whether no mirror bent it: the point is where it was written down.
    pub fn is_straight(&self) -> bool {
        self.mirrors[0] == 0
    }

    /// The index of the first mirror that bent it.
    pub fn first(&self) -> Option<usize> {
        usize::from(self.mirrors[0]).checked_sub(1)
    }
}

/// The angle in radians by which a beam is turned to learn how the place at its end depends on its direction.
const SMALL_TURN: f64 = 1e-5;

impl Mirrors {
    /// At most 255 mirrors.
    pub fn new(reflectors: Vec<Reflector>) -> Self {
        let mirrors: Vec<Mirror> = reflectors.iter().map(|reflector| reflector.mirror.clone()).collect();
        // The order of the surfaces of `Exact::of_mirrors`: those with a formula first.
        let mut of_surface: Vec<usize> = (0..mirrors.len()).collect();
        of_surface.sort_by_key(|index| !mirrors[*index].shape.has_formula());
        let ball = |Mirror { shape, position, size, .. }: &Mirror| (*position, shape.reach() * size * (1.0 + 1e-6));
        Self { balls: mirrors.iter().map(ball).collect(), exact: Exact::of_mirrors(&mirrors), of_surface, reflectors }
    }

    pub fn reflectors(&self) -> &[Reflector] {
        &self.reflectors
    }

    /// Whether a sightline may meet a mirror: it passes the ball about one.
    pub fn may_meet(&self, station: DVec3, point: DVec3) -> bool {
        let (way, squared) = (point - station, point.distance_squared(station));
        self.balls.iter().any(|(middle, radius)| {
            let along = ((*middle - station).dot(way) / squared).clamp(0.0, 1.0);
            (station + way * along).distance_squared(*middle) <= radius * radius
        })
    }

    /// The first mirror that a ray meets before this distance: its hit and its index.
    fn meet(&self, ray: &Ray, before: f64) -> Option<(Hit, usize)> {
        let hit = self.exact.nearest(ray).filter(|hit| hit.distance < before)?;
        Some((hit, *self.of_surface.get(hit.surface as usize)?))
    }

    /// All ways on which the beam may have gone from the scanner to a point; none if its sightline meets no mirror, or
    /// meets the first one less than `margin` before the point, which is then a return from the mirror itself. Ways that
    /// meet more than `MOST_MEETINGS` mirrors are left out.
    pub fn ways(&self, station: DVec3, point: DVec3, margin: f64) -> Vec<Way> {
        let mut ways = Vec::new();
        let range = point.distance(station);
        if range > 0.0 && self.may_meet(station, point) {
            let ray = Ray::from_eye(station, (point - station) / range);
            if self.meet(&ray, range - margin).is_some() {
                let (mirrors, arrival) = ([0; MOST_MEETINGS], ray.direction);
                let start = Way { place: point, mirrors, rest: 0.0, arrival, bends: 0, meetings: 0 };
                self.follow(&ray, range, margin, start, &mut ways);
            }
        }
        ways
    }

    fn follow(&self, ray: &Ray, rest: f64, margin: f64, way: Way, ways: &mut Vec<Way>) {
        let Some((hit, mirror)) = self.meet(ray, rest - margin) else {
            ways.push(Way { place: ray.at(rest), arrival: ray.direction, ..way });
            return;
        };
        if usize::from(way.meetings) == MOST_MEETINGS {
            return;
        }
        let rest = rest - hit.distance;
        let met = Way { meetings: way.meetings + 1, ..way };
        if self.reflectors[mirror].is_open {
            self.follow(&Ray::from_surface(hit.position, ray.direction), rest, margin, met, ways);
        }
        let mut bent = Way { bends: way.bends | 1 << way.meetings, ..met };
        if way.is_straight() {
            bent.rest = rest;
        }
        if let Some(next) = bent.mirrors.iter_mut().find(|mirror| **mirror == 0) {
            *next = mirror as u8 + 1;
        }
        self.follow(&Ray::from_surface(hit.position, reflected(ray.direction, hit.normal)), rest, margin, bent, ways);
    }

    /// The end of the way of a beam that bends where another one did, and where it met the first mirror that bent it,
    /// with the normal there; `None` if it misses one of the mirrors.
    fn along(&self, station: DVec3, direction: DVec3, length: f64, like: &Way) -> Option<(DVec3, DVec3, DVec3)> {
        let (mut ray, mut rest, mut first) = (Ray::from_eye(station, direction), length, None);
        for meeting in 0..like.meetings {
            let (hit, _) = self.meet(&ray, rest)?;
            rest -= hit.distance;
            let is_bent = like.bends >> meeting & 1 == 1;
            if is_bent {
                first.get_or_insert((hit.position, hit.normal));
            }
            let onward = if is_bent { reflected(ray.direction, hit.normal) } else { ray.direction };
            ray = Ray::from_surface(hit.position, onward);
        }
        let (position, normal) = first?;
        Some((ray.at(rest), position, normal))
    }

    /// The standard deviation of the place at the end of a way, along the direction in which it is largest: from the
    /// scanner's errors, and from those of the mirror. A place off by t along the normal moves the end by 2 t at most, and
    /// a normal off by e turns the rest of the way by 2 e. A curved mirror spreads the beam, and its normal changes where
    /// its place is off.
    pub fn error(&self, station: DVec3, point: DVec3, way: &Way, scanner: ScannerError) -> f64 {
        let Some(mirror) = way.first() else { return scanner.range.hypot(scanner.angle * point.distance(station)) };
        let Reflector { place_error, angle_error, .. } = self.reflectors[mirror];
        let range = point.distance(station);
        let direction = (point - station) / range;
        let aside = direction.any_orthonormal_vector();
        let sides = [aside, direction.cross(aside)];
        let (mut spread, mut curvature) = (0.0_f64, 0.0_f64);
        if let Some((end, met, normal)) = self.along(station, direction, range, way) {
            for side in sides {
                let turned = [SMALL_TURN, -SMALL_TURN]
                    .into_iter()
                    .find_map(|turn| self.along(station, (direction + side * turn).normalize(), range, way));
                if let Some((other_end, other_met, other_normal)) = turned {
                    spread = spread.hypot(other_end.distance(end) / SMALL_TURN);
                    curvature = curvature.max(other_normal.distance(normal) / other_met.distance(met));
                }
            }
        }
        let turned = 2.0 * (angle_error + curvature * place_error) * way.rest;
        [scanner.range, spread * scanner.angle, 2.0 * place_error, turned].into_iter().fold(0.0, f64::hypot)
    }
}

fn reflected(direction: DVec3, normal: DVec3) -> DVec3 {
    direction - normal * (2.0 * direction.dot(normal))
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use scene::solid::Solid;
    use scene::tripod::Disturbance;
    use scene::{MirrorMesh, Shape};
    use trace::scan;

    use super::*;

    fn room() -> Vec<Solid> {
        let wall = |low, high| Solid::block(low, high, [0.6; 3]);
        vec![
            wall([-5.0, -5.0, -1.0], [5.0, 5.0, 0.0]),
            wall([-5.0, -5.0, 3.0], [5.0, 5.0, 4.0]),
            wall([-5.0, -5.0, 0.0], [-4.0, 5.0, 3.0]),
            wall([4.0, -5.0, 0.0], [5.0, 5.0, 3.0]),
            wall([-4.0, -5.0, 0.0], [4.0, -4.0, 3.0]),
            wall([-4.0, 4.0, 0.0], [4.0, 5.0, 3.0]),
        ]
    }

    fn standing(shape: Shape, place: DVec3, toward: DVec3, size: f64) -> Mirror {
        Mirror { position: place, ..Mirror::standing(shape, place, toward, DVec3::Z, size) }
    }

    /// Scans a room with mirrors and unfolds each point by the way on which the scanner saw it; returns the number of ghosts
    /// by their number of mirrors, and the largest error.
    fn fold_and_unfold(mirrors: Vec<Mirror>) -> ([usize; MOST_MEETINGS + 1], f64) {
        let station = DVec3::new(-1.0, 0.3, 1.5);
        let scene = Exact::of_mirrors(&mirrors).with_solids(room());
        let mirrors = Mirrors::new(mirrors.into_iter().map(Reflector::exact).collect());
        let (mut counts, mut worst) = ([0; MOST_MEETINGS + 1], 0.0_f64);
        for measured in scan::scan(&scene, &Disturbance::default(), station, 20_000.0, 1, 0) {
            let point = station + measured.direction * measured.range;
            let echo = measured.met;
            let ways = mirrors.ways(station, point, 1e-9);
            let bends = echo.mirrors.iter().filter(|mirror| **mirror != 0).count();
            counts[bends] += 1;
            let is_of = |way: &&Way| way.mirrors == echo.mirrors;
            match ways.iter().find(is_of) {
                Some(way) => worst = worst.max(way.place.distance(echo.place)),
                None => assert!(!echo.is_ghost() && ways.is_empty(), "{echo:?} {ways:?}"),
            }
        }
        (counts, worst)
    }

    #[test]
    fn unfolding_gives_back_what_the_scanner_folded_for_every_shape() {
        for shape in Shape::WITH_FORMULA.into_iter().chain([Shape::Mesh(MirrorMesh::hare())]) {
            let mirror = standing(shape.clone(), DVec3::new(1.2, 0.0, 1.3), DVec3::new(-1.0, 0.1, 0.05), 0.7);
            let (counts, worst) = fold_and_unfold(vec![mirror]);
            assert!(counts[1] > 50 && worst < 1e-6, "{shape:?}: {counts:?} {worst}");
        }
    }

    #[test]
    fn unfolding_goes_by_way_of_several_mirrors_and_through_panes() {
        let facing =
            |x: f64| standing(Shape::Plane { height: 1.0 }, DVec3::new(x, 0.0, 1.5), DVec3::X * -x.signum(), 1.4);
        let (counts, worst) = fold_and_unfold(vec![facing(3.0), facing(-3.0)]);
        assert!(counts[1] > 200 && counts[2] > 50 && counts[3] > 0 && worst < 1e-6, "{counts:?} {worst}");
        let mut pane = facing(2.0);
        (pane.specular_intensity, pane.refraction) = (0.7, Some(1.0));
        let ball = standing(Shape::Sphere, DVec3::new(3.0, 0.0, 1.5), DVec3::Z, 0.5);
        let (counts, worst) = fold_and_unfold(vec![pane, ball]);
        assert!(counts[1] > 200 && worst < 1e-6, "{counts:?} {worst}");
    }

    #[test]
    fn a_plane_gives_the_mirror_image_and_the_way_keeps_its_length() {
        let normal = DVec3::new(-0.8, 0.0, 0.6);
        let plane = standing(Shape::Plane { height: 1.0 }, DVec3::new(2.0, 0.0, 0.0), normal, 3.0);
        let mirrors = Mirrors::new(vec![Reflector::exact(plane.clone())]);
        for point in [DVec3::new(4.0, 0.3, 0.2), DVec3::new(3.0, -0.4, -1.0)] {
            let ways = mirrors.ways(DVec3::ZERO, point, 0.0);
            assert_eq!(ways.len(), 1);
            let image = point - normal * (2.0 * normal.dot(point - plane.position));
            assert!(ways[0].place.distance(image) < 1e-12, "{ways:?}");
            let met = point * (normal.dot(plane.position) / normal.dot(point));
            let length = met.length() + met.distance(ways[0].place);
            assert!((length - point.length()).abs() < 1e-12, "{length}");
            assert!((ways[0].rest - met.distance(point)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_point_on_the_mirror_or_before_it_is_no_ghost() {
        let plane = standing(Shape::Plane { height: 1.0 }, DVec3::X * 2.0, DVec3::NEG_X, 1.0);
        let mirrors = Mirrors::new(vec![Reflector::exact(plane)]);
        for x in [1.0, 1.99, 2.005] {
            assert!(mirrors.ways(DVec3::ZERO, DVec3::X * x, 0.01).is_empty());
        }
        assert!(mirrors.ways(DVec3::ZERO, DVec3::new(4.0, 3.0, 0.0), 0.01).is_empty(), "beside the mirror");
        assert_eq!(mirrors.ways(DVec3::ZERO, DVec3::X * 2.02, 0.01).len(), 1);
    }

    /// The stated error against places unfolded by mirrors that are off and points that are off.
    #[test]
    fn the_stated_error_covers_what_errors_of_range_direction_and_mirror_do() {
        let station = DVec3::new(-1.0, 0.3, 1.5);
        let scanner = ScannerError { range: 0.002, angle: 1e-4 };
        for shape in [Shape::Plane { height: 1.0 }, Shape::Sphere] {
            let mirror = standing(shape.clone(), DVec3::new(1.2, 0.0, 1.3), DVec3::NEG_X, 0.7);
            let known = Reflector { place_error: 0.001, angle_error: 5e-4, ..Reflector::exact(mirror.clone()) };
            let mirrors = Mirrors::new(vec![known]);
            let mut normal = (1..).map(|draw| {
                let [one, other] = [2 * draw, 2 * draw + 1].map(|draw| cloud::unit(7, draw));
                (-2.0 * (1.0 - one).ln()).sqrt() * (std::f64::consts::TAU * other).cos()
            });
            let mut normal = move || normal.next().unwrap_or_default();
            let (mut within, mut count) = (0_u32, 0_u32);
            for _ in 0..600 {
                let aim = mirror.position + DVec3::new(0.0, normal() * 0.12, normal() * 0.12);
                let direction = (aim - station).normalize();
                let point = station + direction * 7.0;
                let Some(way) = mirrors.ways(station, point, 0.0).first().copied() else { continue };
                let stated = 1.96 * mirrors.error(station, point, &way, scanner);
                let turn = DVec3::new(normal(), normal(), normal()) * 5e-4;
                let off = Mirror {
                    position: mirror.position - direction * (0.001 * normal()),
                    rotation: DQuat::from_scaled_axis(turn) * mirror.rotation,
                    ..mirror.clone()
                };
                let other = Mirrors::new(vec![Reflector::exact(off)]);
                let way_off = (direction + DVec3::new(normal(), normal(), normal()) * 1e-4).normalize();
                let read = station + way_off * (7.0 + 0.002 * normal());
                let Some(real) = other.ways(station, read, 0.0).first().copied() else { continue };
                count += 1;
                within += u32::from(real.place.distance(way.place) <= stated);
            }
            let share = f64::from(within) / f64::from(count);
            assert!(count > 400 && share > 0.85, "{shape:?}: {share} of {count}");
        }
    }
}
