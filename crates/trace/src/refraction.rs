//! Light through clear surfaces: what Snell and Fresnel say of one interface, and the way of a ray through a solid.
//!
//! The definition, which is the renderer's. A clear surface splits the share of the light that a mirror reflects: the
//! part that Fresnel's equations give for unpolarised light is reflected, and the rest goes through. A solid (sphere,
//! torus, star) has a second interface. Where light can leave a solid it leaves with all that the ray carries, so that
//! nothing is lost; where it cannot (total reflection), it is reflected inside, up to [`INNER_REFLECTIONS`] times, and
//! then leaves straight on. Other surfaces (planes, paraboloids, cylinders, points of clouds) have one interface:
//! whatever lies behind the side that is seen lies in the medium. A ray in there meets no other surface of that kind,
//! and where it meets nothing it shows the surface's own colour, as deep water does.
//!
//! Of a clear surface that is seen in a mirror or through another one, only the stronger of the two parts is followed.
//! Clear surfaces cast no shadow: light of lamps goes straight through, so there are no caustics.

use glam::DVec3;

use crate::{Geometry, Hit, MirrorPoint, Ray, Side, mirrored};

/// The most total reflections inside a solid that are followed.
pub const INNER_REFLECTIONS: usize = 8;

/// The direction behind a surface with this unit normal, on either side; `ratio` is the index of refraction behind it
/// over that before it. `None` for total reflection.
pub fn refracted(direction: DVec3, normal: DVec3, ratio: f64) -> Option<DVec3> {
    let normal = if direction.dot(normal) > 0.0 { -normal } else { normal };
    let along = -direction.dot(normal);
    // Snell: the part across the normal is divided by the ratio.
    let across = (direction + normal * along) / ratio;
    let squared = 1.0 - across.length_squared();
    if squared > 0.0 { (across - normal * squared.sqrt()).try_normalize() } else { None }
}

/// The share of unpolarised light that a surface between two media reflects (Fresnel). `cosine` is that of the angle
/// between ray and normal; `ratio` is the index of refraction behind the surface over that before it.
pub fn reflected_share(cosine: f64, ratio: f64) -> f64 {
    let cosine = cosine.abs().min(1.0);
    let squared = 1.0 - (1.0 - cosine * cosine) / (ratio * ratio);
    if squared <= 0.0 {
        return 1.0;
    }
    let behind = squared.sqrt();
    let across = (cosine - ratio * behind) / (cosine + ratio * behind);
    let along = (ratio * cosine - behind) / (ratio * cosine + behind);
    0.5 * (across * across + along * along)
}

impl Hit {
    /// The part of the light that it does not scatter which it reflects, if the ray arrives in `direction`: all of it
    /// unless the surface is clear.
    pub fn reflected_part(&self, direction: DVec3) -> f64 {
        self.medium.map_or(1.0, |medium| reflected_share(direction.dot(self.normal), medium.ratio))
    }

    /// The same surface without its mirror, as it looks where nothing is seen through it.
    pub(crate) fn opaque(&self) -> Self {
        Self { specular_intensity: 0.0, specular_power: 0.0, medium: None, ..*self }
    }
}

/// The ray that goes on behind a clear surface, or behind the solid that it bounds, after one that arrives in
/// `direction`; or the ray inside the solid that meets something there. `None` for an opaque surface, and for total
/// reflection.
pub fn through(geometry: &impl Geometry, hit: &Hit, direction: DVec3) -> Option<Ray> {
    let medium = hit.medium?;
    let mut ray = Ray::from_surface(hit.position, refracted(direction, hit.normal, medium.ratio)?);
    match medium.side {
        Side::Beneath => return Some(Ray { is_beneath: true, ..ray }),
        Side::OutOfSolid => return Some(ray),
        Side::IntoSolid => {}
    }
    for reflections in 0..=INNER_REFLECTIONS {
        // Nothing is met if the solid is not closed.
        let inner = geometry.nearest(&ray).and_then(|hit| Some((hit, hit.medium?)));
        let Some((inner, medium)) = inner.filter(|(_, medium)| medium.side == Side::OutOfSolid) else { break };
        if let Some(outside) = refracted(ray.direction, inner.normal, medium.ratio) {
            return Some(Ray::from_surface(inner.position, outside));
        }
        let is_last = reflections == INNER_REFLECTIONS;
        let onward = if is_last { ray.direction } else { mirrored(ray.direction, inner.normal).normalize() };
        ray = Ray::from_surface(inner.position, onward);
    }
    Some(ray)
}

/// The ray that goes on after one that arrives in `direction` at a mirror or a clear surface which is not the first:
/// behind the surface, or reflected, whichever is the stronger part. `None` if the surface has no normal.
pub(crate) fn stronger(geometry: &impl Geometry, hit: &Hit, direction: DVec3) -> Option<Ray> {
    let is_mirror = hit.reflected_part(direction) >= 0.5;
    let beyond = if is_mirror { None } else { through(geometry, hit, direction) };
    let point = MirrorPoint { position: hit.position, normal: hit.normal, incoming: direction };
    beyond.or_else(|| point.reflected())
}

/// What a ray meets that comes from the surface `hit`: the surface itself if the ray is beneath it and meets nothing.
pub(crate) fn met(geometry: &impl Geometry, hit: &Hit, ray: &Ray) -> Option<Hit> {
    geometry.nearest(ray).or_else(|| ray.is_beneath.then(|| hit.opaque()))
}

#[cfg(test)]
mod tests {
    use cloud::sampling::{Placement, StarShape, Surface};
    use cloud::{Chunk, Progress, pack_normal, pack_radius};
    use scene::MirrorSettings;

    use super::*;
    use crate::exact::{Albedo, Exact, Object};
    use crate::{Clear, Illuminant, Illumination, MaterialPoints, Surfels, radiance};

    const GLASS: f64 = 1.5;
    const WATER: f64 = 1.33;

    fn ball(radius: f64, index: f64) -> Object {
        Object::new(Surface::Sphere { radius }, Placement::ORIGIN, Albedo::Even([0.5; 3]), 1.0).with_refraction(index)
    }

    /// A square in z = `z`.
    fn floor(z: f64, color: [f64; 3], specular_intensity: f64) -> Object {
        let corner = DVec3::new(-50.0, -50.0, z);
        let surface = Surface::Rectangle { corner, edges: [DVec3::X * 100.0, DVec3::Y * 100.0] };
        Object::new(surface, Placement::ORIGIN, Albedo::Even(color), specular_intensity)
    }

    fn downward(degrees: f64) -> DVec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(sin, 0.0, -cos)
    }

    #[test]
    fn rays_bend_by_snells_law_and_turn_back_beyond_the_critical_angle() {
        for index in [1.0, WATER, GLASS, 2.4] {
            for degrees in [0.0, 10.0, 45.0, 80.0, 89.9] {
                let behind = refracted(downward(degrees), DVec3::Z, index).unwrap();
                assert!((behind.x * index - degrees.to_radians().sin()).abs() < 1e-12 && behind.z < 0.0);
                // Rays from the other side bend alike, and back again.
                assert_eq!(refracted(downward(degrees), -DVec3::Z, index), Some(behind));
                let back = refracted(-behind, DVec3::Z, 1.0 / index).unwrap();
                assert!(back.distance(-downward(degrees)) < 1e-7, "{index} at {degrees}: {back}");
            }
            let critical = (1.0 / index).asin().to_degrees();
            let leaves = |degrees: f64| refracted(downward(degrees), DVec3::Z, 1.0 / index).is_some();
            let cosine = |degrees: f64| degrees.to_radians().cos();
            assert!(leaves(critical - 1e-6) && (index == 1.0 || !leaves(critical + 1e-6)));
            assert!(reflected_share(cosine(critical - 1.0), 1.0 / index) < 1.0);
            assert!(index == 1.0 || reflected_share(cosine(critical + 1e-6), 1.0 / index) == 1.0);
        }
    }

    #[test]
    fn a_slab_shifts_a_ray_and_does_not_turn_it() {
        let (thickness, degrees) = (0.3, 50.0_f64);
        let inside = refracted(downward(degrees), DVec3::Z, GLASS).unwrap();
        let after = refracted(inside, DVec3::Z, 1.0 / GLASS).unwrap();
        assert!(after.distance(downward(degrees)) < 1e-12);
        let leaves_at = inside * (thickness / -inside.z);
        let shift = leaves_at.reject_from_normalized(after).length();
        let (sin, cos) = degrees.to_radians().sin_cos();
        let expected = thickness * sin * (1.0 - cos / (GLASS * GLASS - sin * sin).sqrt());
        assert!((shift - expected).abs() < 1e-12, "{shift} instead of {expected}");
    }

    #[test]
    fn what_is_not_reflected_goes_through() {
        for ratio in [WATER, GLASS, 1.0 / GLASS, 2.4] {
            let straight = ((ratio - 1.0) / (ratio + 1.0)).powi(2);
            assert!((reflected_share(1.0, ratio) - straight).abs() < 1e-15);
            for degrees in [1.0, 20.0, 40.0, 60.0, 85.0] {
                let (angle, share) = (f64::to_radians(degrees), reflected_share(f64::to_radians(degrees).cos(), ratio));
                let Some(behind) = refracted(downward(degrees), DVec3::Z, ratio) else {
                    assert_eq!(share, 1.0);
                    continue;
                };
                // The transmittances of the two polarisations in the form that has both angles.
                let other = behind.x.asin();
                let across = (2.0 * angle).sin() * (2.0 * other).sin() / (angle + other).sin().powi(2);
                let along = across / (angle - other).cos().powi(2);
                assert!((share + 0.5 * (across + along) - 1.0).abs() < 1e-12, "{ratio} at {degrees}: {share}");
                let back = reflected_share(other.cos(), 1.0 / ratio);
                assert!((share - back).abs() < 1e-12, "both ways alike");
            }
            // At Brewster's angle one polarisation is not reflected at all.
            let across = ((ratio * ratio - 1.0) / (ratio * ratio + 1.0)).powi(2);
            assert!((reflected_share(ratio.atan().cos(), ratio) - 0.5 * across).abs() < 1e-12);
        }
        assert_eq!(reflected_share(0.0, GLASS), 1.0, "a grazing ray");
        assert!(reflected_share(0.3, 1.0) < 1e-30, "no other medium");
    }

    #[test]
    fn a_ball_of_glass_has_its_focal_length() {
        for (radius, index) in [(1.0, GLASS), (0.43, WATER), (2.0, 1.9)] {
            let scene = Exact::new(vec![ball(radius, index)]);
            let height = 1e-4 * radius;
            let ray = Ray::from_eye(DVec3::new(height, 0.0, 3.0 * radius), -DVec3::Z);
            let hit = scene.nearest(&ray).unwrap();
            let after = through(&scene, &hit, ray.direction).unwrap();
            let crosses = after.at(after.origin.x / -after.direction.x);
            let focal_length = index * radius / (2.0 * (index - 1.0));
            assert!((crosses.z + focal_length).abs() < 1e-6 * radius, "{crosses} instead of -{focal_length}");
            // Far from the axis the ray turns by twice the bend at each interface.
            let ray = Ray::from_eye(DVec3::new(0.8 * radius, 0.0, 3.0 * radius), -DVec3::Z);
            let hit = scene.nearest(&ray).unwrap();
            let after = through(&scene, &hit, ray.direction).unwrap();
            let turned = 2.0 * (0.8_f64.asin() - (0.8 / index).asin());
            assert!((ray.direction.dot(after.direction) - turned.cos()).abs() < 1e-12);
        }
    }

    #[test]
    fn an_index_of_one_is_invisible_in_every_solid() {
        fn bumpy(d: DVec3) -> f64 {
            1.0 + 0.1 * (5.0 * d.x).sin() * (5.0 * d.y).sin()
        }
        fn slope(d: DVec3) -> DVec3 {
            let ((sin_x, cos_x), (sin_y, cos_y)) = ((5.0 * d.x).sin_cos(), (5.0 * d.y).sin_cos());
            DVec3::new(0.5 * cos_x * sin_y, 0.5 * sin_x * cos_y, 0.0)
        }
        let shapes = [
            Surface::Sphere { radius: 1.0 },
            Surface::Torus { ring: 0.8, tube: 0.3 },
            Surface::Star(StarShape { radius: bumpy, gradient: slope }),
        ];
        for shape in shapes {
            let solid = |index: f64| {
                let object = Object::new(shape.clone(), Placement::ORIGIN, Albedo::Even([0.5; 3]), 1.0);
                Exact::new(vec![object.with_refraction(index)])
            };
            let (air, glass) = (solid(1.0), solid(GLASS));
            let mut met = 0;
            for step in 0..400 {
                let at = |k: u32| f64::from((step * 7919 + k * 104_729) % 1000) / 500.0 - 1.0;
                let origin = DVec3::new(at(1), at(2), 3.0);
                let ray = Ray::from_eye(origin, (DVec3::new(at(3), at(4), 0.0) - origin).normalize());
                let Some(hit) = air.nearest(&ray) else { continue };
                met += 1;
                let after = through(&air, &hit, ray.direction).unwrap();
                assert!(after.direction.distance(ray.direction) < 1e-9 && hit.reflected_part(ray.direction) < 1e-20);
                assert!((after.origin - ray.origin).reject_from_normalized(ray.direction).length() < 1e-9);
                // Rays that leave glass, after total reflections too, are outside of it.
                let after = through(&glass, &glass.nearest(&ray).unwrap(), ray.direction).unwrap();
                let next = glass.nearest(&after).and_then(|hit| hit.medium);
                assert!(next.is_none_or(|medium| medium.side == Side::IntoSolid), "{shape:?}");
            }
            assert!(met > 100, "{met}");
        }
    }

    #[test]
    fn discs_of_a_ball_bend_rays_as_the_ball_does() {
        let count = 60_000;
        let points = Surface::Sphere { radius: 1.0 }.sample(count, 1);
        let chunk = Chunk {
            normals: Some(std::sync::Arc::new(points.iter().map(|p| pack_normal(p.normal.as_vec3())).collect())),
            radii: Some(std::sync::Arc::new(vec![pack_radius(0.03); count])),
            ..Chunk::new(0, DVec3::ZERO, points.iter().map(|p| p.position.as_vec3().to_array()).collect())
        };
        let clear = Some(Clear { index: GLASS, is_solid: true });
        let part =
            MaterialPoints { chunks: &[chunk], specular_intensity: 1.0, specular_power: 0.0, clear, plain: [0.5; 3] };
        let discs = Surfels::new(&[part], 1.0, &Progress::default()).unwrap();
        let exact = Exact::new(vec![ball(1.0, GLASS)]);
        for step in 0..30 {
            let ray = Ray::from_eye(DVec3::new(0.02 * f64::from(step), 0.1, 3.0), -DVec3::Z);
            let after = |hit: Hit| through(&discs, &hit, ray.direction).unwrap();
            let found = after(discs.nearest(&ray).unwrap());
            let hit = exact.nearest(&ray).unwrap();
            let expected = through(&exact, &hit, ray.direction).unwrap();
            let apart = found.direction.angle_between(expected.direction).to_degrees();
            let off = found.origin.distance(expected.origin);
            assert!(apart < 3.0 && off < 0.08, "{step}: {apart} degrees, {off} off");
            assert!(!discs.is_blocked(&ray, 9.0), "glass casts no shadow");
        }
    }

    #[test]
    fn water_shows_its_bottom_refracted_and_its_own_colour_where_there_is_none() {
        let settings = MirrorSettings::default();
        let black = DVec3::ZERO;
        let illumination =
            Illumination { bounces: 1, background: black, ..Illumination::new(Illuminant::Headlight(0.0), &settings) };
        let water = || floor(0.0, [0.1, 0.3, 0.2], 1.0).with_refraction(WATER);
        let stripes = |p: DVec3| if p.x > 1.0 { [0.9, 0.1, 0.1] } else { [0.1, 0.1, 0.9] };
        let corner = DVec3::new(-50.0, -50.0, -1.0);
        let surface = Surface::Rectangle { corner, edges: [DVec3::X * 100.0, DVec3::Y * 100.0] };
        let bottom = Object::new(surface, Placement::ORIGIN, Albedo::At(stripes), 0.0);
        let light = |scene: &Exact, degrees: f64| {
            let ray = Ray::from_eye(-downward(degrees), downward(degrees));
            let hit = scene.nearest(&ray).unwrap();
            radiance(scene, &hit, ray.direction, 0, &illumination)
        };
        // The stripe begins where a ray at this angle arrives under one unit of water.
        let border = (WATER * 1.0_f64.atan().sin()).asin().to_degrees();
        let lake = Exact::new(vec![water(), bottom]);
        for (degrees, color) in [(border - 0.1, [0.1, 0.1, 0.9]), (border + 0.1, [0.9, 0.1, 0.1])] {
            let share = reflected_share(degrees.to_radians().cos(), WATER);
            assert!(light(&lake, degrees).distance((1.0 - share) * DVec3::from(color)) < 1e-12, "{degrees}");
        }
        let deep = Exact::new(vec![water()]);
        for degrees in [5.0, 60.0, 85.0] {
            let share = reflected_share(f64::to_radians(degrees).cos(), WATER);
            assert!(light(&deep, degrees).distance((1.0 - share) * DVec3::new(0.1, 0.3, 0.2)) < 1e-12, "{degrees}");
        }
        // With something above it that is reflected, the shares add up: white above and below is white.
        let white = [1.0; 3];
        let closed = Exact::new(vec![water(), floor(-1.0, white, 0.0), floor(2.0, white, 0.0)]);
        for degrees in [0.0, 30.0, 60.0] {
            assert!(light(&closed, degrees).distance(DVec3::ONE) < 1e-12, "{degrees}");
        }
    }
}
