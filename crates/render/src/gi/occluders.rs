//! The points that cast indirect shadows: a subset of a store's points, chosen by the area that each stands for, so that a
//! scan's dense parts do not take the samples of its sparse ones (Ritschel et al. 2008 sample meshes evenly by area).

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::store::{PointStore, VisibleChunk};

/// Shadow maps take turns at so many subsets, so that what one subset misses is not missing from all maps.
const MOST_SUBSETS: usize = 8;

/// A subset of the points, for shaders/vpl_shadow_splat.wgsl.
#[derive(Default)]
pub(crate) struct Occluders {
    /// Bits of the position from the origin, and the identity in the store. Point `slot * subsets + subset` is number `slot` of
    /// a subset.
    pub points: Vec<[u32; 4]>,
    pub subsets: u32,
    /// Of a disc, such that those of one subset overlap as the points' own discs do at splat.size 1; world units.
    pub radius: f32,
    /// Of all surfaces, splat overlap included; square world units.
    pub area: f64,
}

impl Occluders {
    /// At most `per_subset` points in each subset, placed from `origin`. Systematic sampling over the summed squares of the
    /// splat radii: neighbours in memory, which are mostly neighbours in space, are passed over evenly.
    pub fn choose(store: &PointStore, origin: DVec3, per_subset: u32) -> Self {
        let chunks: Vec<VisibleChunk<'_>> = store.visible_chunks();
        let weights: Vec<f64> =
            chunks.par_iter().map(|chunk| (0..chunk.len()).map(|i| weight(chunk, i)).sum()).collect();
        let total: f64 = weights.iter().sum();
        let points: usize = chunks.iter().map(VisibleChunk::len).sum();
        if !(total > 0.0 && total.is_finite()) {
            return Self { subsets: 1, ..Self::default() };
        }
        let subsets = (points / per_subset.max(1) as usize).clamp(1, MOST_SUBSETS);
        let count = (subsets * per_subset as usize).min(points);
        let before: Vec<f64> = weights
            .iter()
            .scan(0.0, |sum, weight| {
                let before = *sum;
                *sum += weight;
                Some(before)
            })
            .collect();
        let step = total / count as f64;
        let choose = |(chunk, before): (&VisibleChunk<'_>, &f64)| {
            let mut chosen = Vec::new();
            let mut sum = *before;
            let mut next = (sum / step).floor().max(0.0) as usize;
            // The threshold of the cell that the chunk starts in may lie in the chunk before.
            if threshold(next) * step < sum {
                next += 1;
            }
            for index in 0..chunk.len() {
                let weight = weight(chunk, index);
                sum += weight;
                if weight > 0.0 && next < count && threshold(next) * step < sum {
                    let position = (chunk.points.position(index) - origin).as_vec3().to_array().map(f32::to_bits);
                    chosen.push([position[0], position[1], position[2], chunk.first_identity + index as u32]);
                    // A point that stands for more than a cell is taken once: the others are missed, not piled up.
                    next = next.max((sum / step) as usize);
                    if threshold(next) * step < sum {
                        next += 1;
                    }
                }
            }
            chosen
        };
        let points: Vec<[u32; 4]> = chunks.par_iter().zip(&before).flat_map_iter(choose).collect();
        let in_each = (points.len() / subsets).max(1) as f64;
        Self {
            points,
            subsets: subsets as u32,
            radius: (total / in_each).sqrt() as f32,
            area: total * std::f64::consts::PI,
        }
    }
}

/// Square of the splat radius; 0 of a point that is nowhere.
fn weight(chunk: &VisibleChunk<'_>, index: usize) -> f64 {
    if !Vec3::from(chunk.points.positions[index]).is_finite() {
        return 0.0;
    }
    let own = chunk.points.radii.as_ref().and_then(|radii| cloud::unpack_radius(radii[index]));
    let radius = f64::from(own.unwrap_or(chunk.provisional_radius));
    radius * radius
}

/// Place of the sample of cell `index`, in cells: jittered, so that the spacing of rows in memory cannot beat with it.
fn threshold(index: usize) -> f64 {
    // A multiplicative hash (Knuth): even over 32 bits.
    let hash = (index as u32).wrapping_add(1).wrapping_mul(2_654_435_769);
    index as f64 + f64::from(hash) / 4_294_967_296.0
}
