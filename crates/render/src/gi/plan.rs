//! Decides which light each virtual light comes from: how many each lamp, the sun and the sky give rise to, and the
//! low-discrepancy numbers that place them. All of it is the same from frame to frame, and more lights take further
//! numbers of the same sequence.

use cloud::Bounds;
use glam::{DVec2, DVec3, Vec3, Vec4};
use scene::Gi;

use super::region::Region;
use super::sequence::{SpotFlux, even, halton, radical_inverse};
use crate::layout::{AIM_NONE, LAMP_MAP_SIZE, PARENT_NONE, VPL_SKY, VPL_TRIES, Vpl};
use crate::lighting::MappedLight;

/// An even sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sky {
    /// The up direction, a unit vector.
    pub up: DVec3,
    /// The irradiance of a surface that faces up.
    pub irradiance: f32,
    /// What its lights see more finely than the scene.
    pub near: Option<Region>,
}

/// A light that represents a part of the sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SkyLight {
    toward: DVec3,
    /// The irradiance of a surface that faces it, per unit of the sky's irradiance.
    share: f64,
}

impl SkyLight {
    pub fn to_gpu(self, irradiance: f32) -> Vpl {
        let toward = self.toward.as_vec3();
        let strength = self.share as f32 * irradiance;
        Vpl {
            normal: toward.extend(VPL_SKY),
            intensity: Vec4::new(strength, strength, strength, 0.0),
            tangent: tangent(toward).extend(0.0),
            ..Vpl::default()
        }
    }
}

/// A unit vector across `normal`, equal to `tangent_of` in shaders/shared/vpl.wgsl.
pub(super) fn tangent(normal: Vec3) -> Vec3 {
    let side = if normal.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (side + normal.z);
    Vec3::new(1.0 + side * normal.x * normal.x * a, side * normal.x * normal.y * a, -side * normal.x)
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LightPlan {
    pub sky: Vec<SkyLight>,
    pub bounces: u32,
    /// `VPL_TRIES` of each light of the first bounce: layer << 24 | texel of the shadow map.
    pub aims: Vec<u32>,
    /// For each lamp, the flux of each of its virtual lights at an intensity or irradiance of 1.
    pub flux: Vec<f64>,
    /// For each virtual light, bounce by bounce, the values that shaders/vpl_bounce.wgsl reads.
    pub births: Vec<[u32; 4]>,
    /// Whether a light of the first bounce comes from the sky.
    pub has_sky_births: bool,
    /// The numbers of the lights of the first bounce that stand where photons have landed.
    pub thrown: Vec<u32>,
}

impl LightPlan {
    /// `thrown` is the flux of what mirrors throw from lights onto surfaces.
    pub fn new(
        gi: &Gi,
        lights: &[MappedLight],
        (thrown, sky): (f64, Option<Sky>),
        origin: DVec3,
        radius: f64,
        bounds: Bounds,
    ) -> Self {
        // The finer map of a sun is for direct light.
        let sun = lights.first().filter(|light| light.camera.orthographic);
        let lamps = if sun.is_some() { &lights[..1] } else { lights };
        let sky = sky.filter(|sky| sky.irradiance > 0.0);
        let sky_lights: Vec<SkyLight> = sky.map_or_else(Vec::new, |sky| sky_lights(sky.up, gi.sky_lights));
        let mut plan = Self { sky: sky_lights, bounces: gi.bounces, ..Self::default() };
        if gi.bounces == 0 {
            return plan;
        }
        let brightness = |light: &MappedLight| light.intensity.iter().map(|value| f64::from(*value)).sum::<f64>() / 3.0;
        let fluxes: Vec<Flux> = lamps.iter().map(|light| Flux::new(light, bounds)).collect();
        let rectangles: Vec<[DVec2; 2]> =
            plan.sky.iter().map(|light| rectangle_of_sky(light.toward, origin, radius, bounds)).collect();
        let of_sky: Vec<f64> = plan
            .sky
            .iter()
            .zip(&rectangles)
            .map(|(light, [low, high])| light.share * area(*low, *high) * radius * radius)
            .collect();
        let sky_flux = of_sky.iter().sum::<f64>() * sky.map_or(0.0, |sky| f64::from(sky.irradiance));
        let mut weights: Vec<f64> =
            lamps.iter().zip(&fluxes).map(|(light, flux)| flux.total() * brightness(light)).collect();
        weights.push(sky_flux);
        if thrown > 0.0 {
            weights.push(thrown);
        }
        let total: f64 = weights.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            plan.bounces = 0;
            return plan;
        }
        // For each light its source, and how many lights came from that source before.
        let mut counts = vec![0_u32; weights.len()];
        let sources: Vec<(usize, u32)> = (0..gi.vpls)
            .map(|index| {
                let mut left = radical_inverse(5, index + 1) * total;
                let source = weights.iter().position(|weight| {
                    left -= weight;
                    left < 0.0
                });
                let source = source.unwrap_or(weights.len() - 1);
                counts[source] += 1;
                (source, counts[source] - 1)
            })
            .collect();
        let sky_source = lamps.len();
        plan.flux = fluxes.iter().zip(&counts).map(|(flux, count)| flux.total() / f64::from((*count).max(1))).collect();
        plan.has_sky_births = counts[sky_source] > 0;
        let sky_total: f64 = of_sky.iter().sum();
        for (source, number) in sources {
            let aims = (0..VPL_TRIES).map(|attempt| match fluxes.get(source) {
                // Further tries come from another sequence, and far on in it, so that they do not depend on the numbers
                // of the first, which missed. The step has no factor in common with its bases.
                Some(flux) if attempt > 0 => (source as u32) << 24 | flux.texel(halton(number + attempt * 10_007)),
                Some(flux) => (source as u32) << 24 | flux.texel(even(number)),
                None => AIM_NONE,
            });
            plan.aims.extend(aims);
            let mut birth = [PARENT_NONE, 0, 0, 0];
            if source == sky_source {
                let mut left = radical_inverse(7, number + 1) * sky_total;
                let parent = of_sky.iter().position(|flux| {
                    left -= flux;
                    left < 0.0
                });
                let parent = parent.unwrap_or(of_sky.len() - 1);
                let [low, high] = rectangles[parent];
                let map = low + (high - low) * halton(number);
                // All carry the same flux, which is expressed as an area of the parent's map.
                let share = sky_total / f64::from(counts[sky_source]) / plan.sky[parent].share;
                birth = [parent as u32, (map.x as f32).to_bits(), (map.y as f32).to_bits(), (share as f32).to_bits()];
            }
            if source > sky_source {
                plan.thrown.push(plan.births.len() as u32);
            }
            plan.births.push(birth);
        }
        for bounce in 2..=gi.bounces {
            for index in 0..gi.vpls {
                let parent = plan.sky.len() as u32 + (bounce - 2) * gi.vpls + index;
                // Each bounce shifts the numbers around the square by another irrational step (Cranley and Patterson
                // 1976).
                let turn = DVec2::new(0.754_877_666, 0.569_840_291) * f64::from(bounce - 1);
                let numbers = (halton(index) + turn).fract().as_vec2();
                plan.births.push([parent, numbers.x.to_bits(), numbers.y.to_bits(), 1_f32.to_bits()]);
            }
        }
        plan
    }
}

/// The directions of an even sky; each represents the same solid angle. A spiral from the top to the horizon has them more
/// evenly than a sequence (Swinbank and Purser 2006). They come in the order of the points of Halton's sequence that are
/// nearest to them, because interleaved pixels are lit by runs of neighbours.
fn sky_lights(up: DVec3, count: u32) -> Vec<SkyLight> {
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let (right, forward) = up.any_orthonormal_pair();
    let on_spiral = |step: f64| DVec2::new((step + 0.5) / f64::from(count), (step * GOLDEN).fract());
    let mut left: Vec<DVec2> = (0..count).map(|step| on_spiral(f64::from(step))).collect();
    (0..count)
        .map(|index| {
            let wanted = halton(index);
            let off = |place: &DVec2| {
                let off = *place - wanted;
                DVec2::new(off.x, off.y - off.y.round()).length_squared()
            };
            let nearest = (0..left.len()).min_by(|a, b| off(&left[*a]).total_cmp(&off(&left[*b])));
            let numbers = left.swap_remove(nearest.unwrap_or_default());
            let (height, turn) = (numbers.x, numbers.y * std::f64::consts::TAU);
            let across = (1.0 - height * height).max(0.0).sqrt();
            let toward = right * (across * turn.cos()) + forward * (across * turn.sin()) + up * height;
            // An even sky of radiance L gives pi L to a surface that faces up, and its lights share 2 pi L.
            SkyLight { toward, share: 2.0 / f64::from(count) }
        })
        .collect()
}

fn area(low: DVec2, high: DVec2) -> f64 {
    (high.x - low.x) * (high.y - low.y)
}

/// The part of a sky light's map that contains the points, in map units from -1 to 1.
fn rectangle_of_sky(toward: DVec3, origin: DVec3, radius: f64, bounds: Bounds) -> [DVec2; 2] {
    let normal = toward.as_vec3();
    let right = tangent(normal);
    let up = normal.cross(right);
    let (right, up) = (right.as_dvec3() / radius, up.as_dvec3() / radius);
    rectangle(bounds, |corner| DVec2::new((corner - origin).dot(right), (corner - origin).dot(up)), -1.0, 1.0)
}

/// The rectangle around the projections of a box's corners, clamped to `least` and `most`.
fn rectangle(bounds: Bounds, place: impl Fn(DVec3) -> DVec2, least: f64, most: f64) -> [DVec2; 2] {
    let corners = (0..8).map(|index| {
        let part = DVec3::new(f64::from(index & 1), f64::from(index >> 1 & 1), f64::from(index >> 2 & 1));
        place(bounds.min + (bounds.max - bounds.min) * part)
    });
    let empty = [DVec2::INFINITY, DVec2::NEG_INFINITY];
    let [low, high] = corners.fold(empty, |[low, high], corner| [low.min(corner), high.max(corner)]);
    [low, high].map(|corner| corner.clamp(DVec2::splat(least), DVec2::splat(most)))
}

/// The distribution of a lamp's flux, or the sun's, over its shadow map.
enum Flux {
    Spot {
        flux: SpotFlux,
        focal: f64,
    },
    /// The texels that contain the points.
    Sun {
        low: DVec2,
        high: DVec2,
        focal: f64,
    },
}

impl Flux {
    fn new(light: &MappedLight, bounds: Bounds) -> Self {
        let focal = light.camera.focal_pixels;
        if !light.camera.orthographic {
            return Self::Spot { flux: SpotFlux::new(f64::from(light.inner), f64::from(light.outer)), focal };
        }
        let middle = f64::from(LAMP_MAP_SIZE) / 2.0;
        let place = |corner: DVec3| {
            let view = light.camera.view_from_world * (corner - light.camera.eye);
            DVec2::new(middle + view.x * focal, middle - view.y * focal)
        };
        let [low, high] = rectangle(bounds, place, 0.0, f64::from(LAMP_MAP_SIZE));
        Self::Sun { low, high, focal }
    }

    /// The flux at an intensity or irradiance of 1.
    fn total(&self) -> f64 {
        match self {
            Self::Spot { flux, .. } => flux.total(),
            Self::Sun { low, high, focal } => area(*low, *high) / (focal * focal),
        }
    }

    fn texel(&self, numbers: DVec2) -> u32 {
        let middle = f64::from(LAMP_MAP_SIZE) / 2.0;
        let place = match self {
            Self::Spot { flux, focal } => {
                let direction = flux.direction(numbers);
                let slope = DVec2::new(direction.x, -direction.y) / direction.z.max(1e-6) * *focal;
                slope + middle
            }
            Self::Sun { low, high, .. } => *low + (*high - *low) * numbers,
        };
        let [x, y] = place.to_array().map(|texel| (texel.max(0.0) as u32).min(LAMP_MAP_SIZE - 1));
        y * LAMP_MAP_SIZE + x
    }
}
