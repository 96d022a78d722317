//! The inspection mirror: a plane or a shallow bulge that hovers over the scan at the cursor and shows what faces away
//! from the eye, as a dentist's mirror does. Its normal halves the angle between the direction to the eye and the
//! direction that it shows.
//!
//! The surface under the cursor is found by following the sight line through the points, on a worker thread. The
//! picture cannot show that, since it shows the mirror in front of the surface.

use std::sync::Arc;

use cloud::{Bounds, Chunk, ChunkTest, unpack_normal, unpack_radius};
use glam::{DMat3, DQuat, DVec3, Vec3};
use rayon::prelude::*;
use scene::{Mirror, Shape};

use crate::viewer::objects::ObjectId;

/// The mirror at the cursor.
pub struct Inspection {
    pub id: ObjectId,
    /// Set once a surface has been found.
    pub mirror: Option<Mirror>,
    pub pose: Pose,
    surface: Option<Surface>,
    /// The pixel whose sight line is being followed.
    pub asked: Option<[u32; 2]>,
    /// The pixel whose sight line was followed last.
    pub known: Option<[u32; 2]>,
}

/// How the mirror is held over a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The distance from the surface to the mirror's middle, over the distance from the surface to the eye.
    pub distance: f64,
    /// The angle by which the direction that the mirror shows is turned down from the direction to the eye, in radians.
    pub tilt: f64,
    /// Half the mirror's width, over the distance from the surface to the eye.
    pub size: f64,
    /// Whether the mirror is a shallow bulge instead of a plane: it shows more, but smaller.
    pub is_bulged: bool,
}

/// A place on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    pub position: DVec3,
    /// Unit vector that points to the side of the eye.
    pub normal: DVec3,
}

/// A sight line, and the chunks that it may meet.
pub struct Ray {
    pub origin: DVec3,
    /// Unit vector.
    pub direction: DVec3,
    /// By how much the line widens per unit of depth, and its width at the origin in world units. It covers a few
    /// pixels.
    pub spread: f64,
    pub width: f64,
    pub targets: Vec<Target>,
}

/// A chunk that a sight line may meet.
#[derive(Clone)]
pub struct Target {
    pub chunk: Chunk,
    pub bounds: Bounds,
    /// Decides which points are shown. The line does not meet the others.
    pub test: Arc<ChunkTest>,
}

/// Shares of the distance to the eye, so that the mirror has the same size on the screen near and far: a quarter of the
/// picture's height. It stays far enough from the eye not to hide what it is held over.
const DISTANCE: f64 = 0.2;
const SIZE: f64 = 0.12;
/// About 14 degrees, in radians. The mirror shows what lies below the eye: the backs of things between the eye and
/// itself.
const TILT: f64 = 0.25;
/// The focal length of the bulge over its radius. Its view is about twice as wide as a plane's.
const BULGE: f64 = 1.5;

/// The angle in radians by which one wheel notch tilts the mirror.
const TILT_STEP: f64 = 0.087;

impl Pose {
    /// Holds the mirror at so many times its distance.
    pub fn move_away(&mut self, factor: f32) {
        self.distance = (self.distance * f64::from(factor)).clamp(0.005, 0.9);
    }

    /// Tilts the mirror by notches of the wheel.
    pub fn lean(&mut self, notches: f32) {
        self.tilt = (self.tilt + TILT_STEP * f64::from(notches)).clamp(-3.0, 3.0);
    }
}

impl Inspection {
    pub fn new(id: ObjectId) -> Self {
        Self {
            id,
            mirror: None,
            pose: Pose { distance: DISTANCE, tilt: TILT, size: SIZE, is_bulged: false },
            surface: None,
            asked: None,
            known: None,
        }
    }

    /// Places the mirror over `surface`, or over the surface that it is at already; `eye` is where a place is seen from.
    pub fn update(&mut self, surface: Option<Surface>, eye: impl Fn(DVec3) -> DVec3, up: DVec3) {
        self.surface = surface.or(self.surface);
        if let Some(surface) = self.surface {
            self.mirror = Some(self.placed(surface, eye(surface.position), up));
        }
    }

    fn placed(&self, surface: Surface, eye: DVec3, up: DVec3) -> Mirror {
        let reach = surface.position.distance(eye).max(f64::MIN_POSITIVE);
        let position = surface.position + surface.normal * (self.pose.distance * reach);
        let to_eye = (eye - position).normalize_or(up);
        let level = up.cross(to_eye).normalize_or(to_eye.any_orthonormal_vector());
        // By the right-hand rule, a rotation about the level axis turns the direction to the eye down.
        let shown = DQuat::from_axis_angle(level, self.pose.tilt) * to_eye;
        let normal = (to_eye + shown).normalize_or(to_eye);
        // The bulge's outer side is the one that the paraboloid does not open to.
        let (shape, z) = if self.pose.is_bulged {
            (Shape::Paraboloid { focal_length: BULGE }, -normal)
        } else {
            (Shape::Plane { height: 0.75 }, normal)
        };
        let y = (normal.cross(level)).normalize_or(up);
        let x = y.cross(z);
        Mirror {
            name: "inspection mirror".into(),
            position,
            rotation: DQuat::from_mat3(&DMat3::from_cols(x, y, z)),
            ..Mirror::standing(shape, position, z, up, self.pose.size * reach)
        }
    }
}

/// How much deeper than the nearest hit a point may lie to count as the same surface, in widths of the sight line
/// there.
const SAME_SURFACE: f64 = 4.0;

/// The surface that a sight line meets first, as the mean of the points around it. `None` if it meets no point.
pub fn cast(ray: &Ray) -> Option<Surface> {
    let is_reached = |target: &&Target| {
        let (depth, aside) = ray.depth_and_distance(target.bounds.center() - ray.origin);
        let radius = target.bounds.radius();
        depth > -radius && aside <= radius + ray.width_at(depth + radius)
    };
    let reached: Vec<&Target> = ray.targets.iter().filter(is_reached).collect();
    // The depths of the points that the ray meets. f32 offsets from the chunk's origin are precise enough for a ray
    // that is a few pixels wide.
    let hits = |Target { chunk, test, .. }: &Target| -> Vec<(f64, usize)> {
        let is_shown = |index: &usize| test.shows(chunk, *index);
        let origin = (ray.origin - chunk.origin).as_vec3();
        let direction = ray.direction.as_vec3();
        let hit = |(index, position): (usize, &[f32; 3])| {
            let offset = Vec3::from(*position) - origin;
            let depth = offset.dot(direction);
            let width = ray.width_at(f64::from(depth)) as f32;
            let radius = chunk.radii.as_ref().and_then(|radii| unpack_radius(radii[index])).unwrap_or(0.0);
            let reach = width.max(radius);
            // The difference of two large squares would be too rough in parallel views, whose lines begin far away.
            let aside = offset - direction * depth;
            (depth > 0.0 && aside.length_squared() < reach * reach).then_some((f64::from(depth), index))
        };
        chunk.positions.iter().enumerate().filter_map(hit).filter(|(_, index)| is_shown(index)).collect()
    };
    let found: Vec<(&Chunk, Vec<(f64, usize)>)> =
        reached.par_iter().map(|target| (&target.chunk, hits(target))).collect();
    let nearest = found.iter().flat_map(|(_, hits)| hits).map(|(depth, _)| *depth).reduce(f64::min)?;
    let deepest = nearest + SAME_SURFACE * ray.width_at(nearest);
    let (mut count, mut depths, mut normals) = (0.0, 0.0, Vec3::ZERO);
    for (chunk, hits) in &found {
        for (depth, index) in hits.iter().filter(|(depth, _)| *depth <= deepest) {
            count += 1.0;
            depths += depth;
            let normal = chunk.normals.as_ref().and_then(|normals| unpack_normal(normals[*index])).unwrap_or_default();
            // Normals of a scan may point to either side.
            normals += if normal.dot(ray.direction.as_vec3()) > 0.0 { -normal } else { normal };
        }
    }
    Some(Surface {
        position: ray.origin + ray.direction * (depths / count),
        normal: normals.as_dvec3().normalize_or(-ray.direction),
    })
}

impl Ray {
    fn depth_and_distance(&self, offset: DVec3) -> (f64, f64) {
        let depth = offset.dot(self.direction);
        (depth, (offset.length_squared() - depth * depth).max(0.0).sqrt())
    }

    fn width_at(&self, depth: f64) -> f64 {
        self.width + self.spread * depth.max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use cloud::{Attribute, Cloud, Column, ColumnType, PointTest, pack_normal, pack_radius};

    use super::*;

    /// Two walls across the x axis, at x = 10 and x = 20, at coordinates of seven digits.
    fn walls() -> Vec<Target> {
        let wall = |x: f32, first_point: u64| {
            let positions: Vec<[f32; 3]> =
                (0..10_000).map(|i| [x, (i % 100) as f32 * 0.1 - 5.0, (i / 100) as f32 * 0.1 - 5.0]).collect();
            let chunk = Chunk {
                // The normals point away from the eye, as a wrong estimate would make them.
                normals: Some(Arc::new(vec![pack_normal(Vec3::X); positions.len()])),
                radii: Some(Arc::new(vec![pack_radius(0.1); positions.len()])),
                ..Chunk::new(first_point, DVec3::new(635_000.0, 848_000.0, 0.0), positions)
            };
            Target { bounds: chunk.bounds(), chunk, test: Arc::new(Cloud::default().test(&PointTest::default())) }
        };
        vec![wall(20.0, 0), wall(10.0, 10_000)]
    }

    fn ray(direction: DVec3) -> Ray {
        let origin = DVec3::new(635_000.0, 848_000.0, 0.0);
        Ray { origin, direction: direction.normalize(), spread: 1e-3, width: 0.0, targets: walls() }
    }

    #[test]
    fn a_sight_line_meets_the_nearest_surface_and_its_side_towards_the_eye() {
        let surface = cast(&ray(DVec3::new(1.0, 0.123, -0.2))).unwrap();
        let expected = DVec3::new(635_010.0, 848_001.23, -2.0);
        assert!(surface.position.distance(expected) < 0.05, "{}", surface.position);
        assert!(surface.normal.dot(-DVec3::X) > 0.999);
        assert_eq!(cast(&ray(DVec3::NEG_X)), None);
        assert_eq!(cast(&ray(DVec3::Z)), None);
        assert_eq!(cast(&Ray { targets: Vec::new(), ..ray(DVec3::X) }), None);
    }

    #[test]
    fn a_sight_line_passes_hidden_points() {
        let mut ray = ray(DVec3::X);
        let near = &mut ray.targets[1];
        near.chunk.columns = vec![Some(Arc::new(Column::U8(vec![7; near.chunk.len()])))];
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        let classified = Cloud { attributes, ..Cloud::default() };
        let distance = |ray: &Ray| (cast(ray).unwrap().position.x - ray.origin.x).round();
        assert_eq!(distance(&ray), 10.0);
        ray.targets[1].test = Arc::new(classified.test(&PointTest::hiding([7])));
        assert_eq!(distance(&ray), 20.0);
    }

    #[test]
    fn the_mirror_shows_the_eye_what_lies_in_the_hidden_direction() {
        let surface = Surface { position: DVec3::new(10.0, 0.0, 0.0), normal: -DVec3::X };
        let eye = DVec3::new(0.0, 1.0, 2.0);
        for is_bulged in [false, true] {
            let mut inspection = Inspection::new(ObjectId(0));
            inspection.pose.is_bulged = is_bulged;
            inspection.update(Some(surface), |_| eye, DVec3::Z);
            let mirror = inspection.mirror.clone().unwrap();
            assert_eq!(mirror.problem(), None);
            let reach = eye.distance(surface.position);
            assert!((mirror.position.distance(surface.position) - inspection.pose.distance * reach).abs() < 1e-9);
            assert!((mirror.size - inspection.pose.size * reach).abs() < 1e-9);
            // The normal of the side that reflects, in the middle of the mirror.
            let normal = mirror.rotation * if is_bulged { -DVec3::Z } else { DVec3::Z };
            let to_eye = (eye - mirror.position).normalize();
            let shown = 2.0 * normal.dot(to_eye) * normal - to_eye;
            assert!((shown.angle_between(to_eye) - inspection.pose.tilt).abs() < 1e-6);
            // The shown direction points to the eye's side, and lower.
            assert!(shown.dot(-DVec3::X) > 0.0 && shown.z < to_eye.z, "{shown}");
            // The mirror's long side is level.
            assert!((mirror.rotation * DVec3::X).z.abs() < 1e-9);
        }
    }

    #[test]
    fn distance_and_tilt_change_the_mirror_where_it_is() {
        let surface = Surface { position: DVec3::ZERO, normal: DVec3::Z };
        let mut inspection = Inspection::new(ObjectId(0));
        inspection.update(None, |_| DVec3::ONE, DVec3::Z);
        assert!(inspection.mirror.is_none());
        inspection.update(Some(surface), |_| DVec3::ONE * 5.0, DVec3::Z);
        inspection.pose.distance *= 2.0;
        inspection.update(None, |_| DVec3::ONE * 5.0, DVec3::Z);
        let height = inspection.mirror.as_ref().unwrap().position.z;
        assert!((height - 2.0 * DISTANCE * (DVec3::ONE * 5.0).length()).abs() < 1e-9);
    }
}
