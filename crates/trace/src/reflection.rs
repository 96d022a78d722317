//! Follows a picture's rays, directly and in mirrors.

use std::ops::Range;

use cloud::Progress;
use glam::DVec3;
use rayon::prelude::*;

use crate::refraction::{met, stronger};
use crate::{Geometry, Hit, PixelRays, Ray};

/// A point of a mirror and the ray that sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorPoint {
    pub position: DVec3,
    /// The normal, of any length but zero, on either side.
    pub normal: DVec3,
    /// The unit vector of the ray that arrives.
    pub incoming: DVec3,
}

impl MirrorPoint {
    /// The reflected ray; none if the point or its normal is missing (not finite, or a zero normal).
    pub fn reflected(&self) -> Option<Ray> {
        let normal = self.normal.try_normalize()?;
        let direction = mirrored(self.incoming, normal).try_normalize()?;
        (self.position.is_finite()).then(|| Ray::from_surface(self.position, direction))
    }
}

/// `direction` after a mirror with this unit normal, on either side.
pub fn mirrored(direction: DVec3, normal: DVec3) -> DVec3 {
    direction - 2.0 * direction.dot(normal) * normal
}

/// What is seen in a mirror point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflection {
    /// The unit vector of the ray that leaves the mirror; zero if the mirror point is missing.
    pub direction: DVec3,
    /// The first hit, whether it is a mirror or not: the Mirror G-Buffer of the first bounce.
    pub first: Option<Hit>,
    /// Where the ray ends after the mirrors that were followed.
    pub last: Option<Hit>,
}

/// Follows the rays from mirror points, over at most `bounces` mirrors, the mirror points included. `progress` counts
/// points. `None` when cancelled.
pub fn reflected(
    geometry: &impl Geometry,
    points: &[MirrorPoint],
    bounces: u32,
    progress: &Progress,
) -> Option<Vec<Reflection>> {
    in_parallel(points.len(), BATCH, progress, |index| {
        let Some(ray) = points[index].reflected() else {
            return Reflection { direction: DVec3::ZERO, first: None, last: None };
        };
        let direction = ray.direction;
        let first = geometry.nearest(&ray);
        let mut last = first.map(|hit| (hit, direction));
        for _ in 1..bounces {
            let Some((mirror, arriving)) = last.filter(|(hit, _)| hit.specular_intensity > 0.0) else {
                break;
            };
            let ray = stronger(geometry, &mirror, arriving);
            last = ray.and_then(|ray| Some((met(geometry, &mirror, &ray)?, ray.direction)));
        }
        Reflection { direction, first, last: last.map(|(hit, _)| hit) }
    })
}

/// The hit of each pixel's ray, row by row. `progress` counts pixels. `None` when cancelled.
pub fn primary(geometry: &impl Geometry, rays: &PixelRays, progress: &Progress) -> Option<Vec<Option<Hit>>> {
    in_parallel(rays.pixel_count(), BATCH, progress, |pixel| geometry.nearest(&rays.ray(pixel)))
}

/// The number of rays between two checks for a cancel: some milliseconds of work.
pub(crate) const BATCH: usize = 1024;

/// The results of `work` for 0 .. count in order, computed on all cores, with `batch` items between two checks for a
/// cancel.
pub(crate) fn in_parallel<T: Send>(
    count: usize,
    batch: usize,
    progress: &Progress,
    work: impl Fn(usize) -> T + Sync,
) -> Option<Vec<T>> {
    // After other work that was counted.
    progress.set_total(progress.done() + count as u64);
    let some = |first: usize| {
        let items: Range<usize> = first * batch..((first + 1) * batch).min(count);
        let results: Vec<T> = if progress.is_cancelled() { Vec::new() } else { items.clone().map(&work).collect() };
        progress.add(results.len() as u64);
        results
    };
    let batches: Vec<Vec<T>> = (0..count.div_ceil(batch)).into_par_iter().map(some).collect();
    let results: Vec<T> = batches.into_iter().flatten().collect();
    (results.len() == count).then_some(results)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::{Albedo, Exact, Object};
    use crate::{Illuminant, Illumination, MaterialPoints, Surfels, picture};
    use cloud::sampling::{Placement, Surface};
    use scene::five_mirrors::{Variant, camera, light, sample};
    use scene::{MirrorSettings, ViewSettings};

    fn wall(z: f64, specular_intensity: f64) -> Object {
        let surface = Surface::Rectangle { corner: DVec3::new(-1.0, -1.0, z), edges: [DVec3::X * 2.0, DVec3::Y * 2.0] };
        Object::new(surface, Placement::ORIGIN, Albedo::Even([0.5; 3]), specular_intensity)
    }

    #[test]
    fn two_facing_mirrors_pass_a_ray_on_for_as_many_bounces_as_are_followed() {
        let geometry = Exact::new(vec![wall(0.0, 1.0), wall(1.0, 1.0)]);
        // Between the mirrors at a slope of 3 / 10: every crossing goes 0.3 sideways.
        let incoming = DVec3::new(0.3, 0.0, -1.0).normalize();
        let point = MirrorPoint { position: DVec3::X * -0.9, normal: -DVec3::Z, incoming };
        let x_after = |bounces| {
            let reflection = reflected(&geometry, &[point], bounces, &Progress::default()).unwrap()[0];
            assert!(reflection.first.unwrap().position.distance(DVec3::new(-0.6, 0.0, 1.0)) < 1e-12);
            reflection.last.map(|hit| hit.position.x)
        };
        for (bounces, x) in [(1, -0.6), (2, -0.3), (3, 0.0), (6, 0.9)] {
            assert!(x_after(bounces).is_some_and(|found| (found - x).abs() < 1e-9), "{bounces} bounces");
        }
        assert_eq!(x_after(7), None, "the ray has left the mirrors");
    }

    #[test]
    fn mirror_points_that_are_missing_reflect_nothing() {
        let geometry = Exact::new(vec![wall(1.0, 0.0)]);
        let fine = MirrorPoint { position: DVec3::ZERO, normal: DVec3::Z, incoming: -DVec3::Z };
        let points = [
            fine,
            MirrorPoint { position: DVec3::NAN, ..fine },
            MirrorPoint { normal: DVec3::ZERO, ..fine },
            MirrorPoint { normal: DVec3::NAN, ..fine },
            MirrorPoint { incoming: DVec3::NAN, ..fine },
        ];
        let seen = reflected(&geometry, &points, 2, &Progress::default()).unwrap();
        assert!(seen[0].first.is_some());
        assert!(seen[1..].iter().all(|reflection| reflection.first.is_none() && reflection.last.is_none()));
    }

    #[test]
    fn pictures_do_not_depend_on_the_number_of_threads() {
        let parts = sample(Variant::Torus, 50_000, 1);
        let mirrors = MirrorSettings::default();
        let (lights, rays) = ([light()], PixelRays::new(&camera(), &ViewSettings::default(), [96, 72], 0.0));
        let draw = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let parts: Vec<MaterialPoints> = parts
                    .iter()
                    .map(|part| {
                        let specular_intensity = part.mirror.as_ref().map_or(0.0, |mirror| mirror.specular_intensity);
                        MaterialPoints {
                            chunks: &part.chunks,
                            specular_intensity,
                            specular_power: 0.0,
                            clear: None,
                            plain: [0.5; 3],
                        }
                    })
                    .collect();
                let surfels = Surfels::new(&parts, 1.0, &Progress::default()).unwrap();
                let illumination =
                    Illumination { bounces: 2, ..Illumination::new(Illuminant::Lights(&lights), &mirrors) };
                picture(&surfels, &rays, &illumination, &Progress::default()).unwrap()
            })
        };
        let (one, three) = (draw(1), draw(3));
        assert_eq!(one, three);
        assert!(one.iter().flatten().filter(|color| color.max_element() > 0.0).count() > 1000);
    }

    #[test]
    fn work_that_is_cancelled_gives_nothing_and_other_work_is_counted() {
        let progress = Progress::default();
        assert_eq!(in_parallel(5000, BATCH, &progress, |index| index), Some((0..5000).collect()));
        assert_eq!((progress.done(), progress.total()), (5000, 5000));
        progress.cancel();
        assert_eq!(in_parallel(5000, BATCH, &progress, |index| index), None);
    }
}
