//! The samples of a mirror by place: cells of its box, each with the samples nearest to its middle.

use cloud::Bounds;
use glam::DVec3;
use rayon::prelude::*;

use crate::layout::{CELL_SAMPLES, NO_SAMPLE, SampleGrid};

/// The most cells along an edge of a box.
const MOST_CELLS: f64 = 32.0;

/// The cells of a mirror's box.
pub struct Grid {
    low: DVec3,
    /// The edge of a cell.
    edge: f64,
    counts: [u32; 3],
    /// The samples of each cell by their number among the mirror's, the nearest first; then `NO_SAMPLE`.
    pub cells: Vec<[u32; CELL_SAMPLES]>,
}

impl Grid {
    /// Cells of half the distance of neighbouring samples.
    pub fn new(samples: &[DVec3], bounds: &Bounds) -> Self {
        let size = bounds.size();
        let across = if samples.len() > CELL_SAMPLES {
            (2.0 * (samples.len() as f64).sqrt()).ceil().min(MOST_CELLS)
        } else {
            1.0
        };
        // A box without extent is one cell.
        let edge = (size.max_element() / across).max(f64::from(f32::MIN_POSITIVE));
        let counts = size.to_array().map(|length| ((length / edge).ceil().clamp(1.0, across)) as u32);
        let nearest = |cell: u32| {
            let [columns, rows, _] = counts;
            let at = [cell % columns, cell / columns % rows, cell / columns / rows];
            let middle = bounds.min + DVec3::from(at.map(|at| (f64::from(at) + 0.5) * edge));
            let mut by_distance: Vec<(f64, u32)> =
                samples.iter().map(|s| s.distance_squared(middle)).zip(0..).collect();
            let before = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
            if by_distance.len() > CELL_SAMPLES {
                by_distance.select_nth_unstable_by(CELL_SAMPLES, before);
                by_distance.truncate(CELL_SAMPLES);
            }
            by_distance.sort_unstable_by(before);
            std::array::from_fn(|place| by_distance.get(place).map_or(NO_SAMPLE, |(_, sample)| *sample))
        };
        let cells = (0..counts.iter().product()).into_par_iter().map(nearest).collect();
        Self { low: bounds.min, edge, counts, cells }
    }

    /// The layout of the shaders; `first` is the number of its first cell among those of all mirrors.
    pub fn to_gpu(&self, eye: DVec3, first: u32) -> SampleGrid {
        let [columns, rows, layers] = self.counts;
        let low_scale = (self.low - eye).as_vec3().extend((1.0 / self.edge) as f32);
        SampleGrid { low_scale, columns, rows, layers, first }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cell_of_a_place_has_its_nearest_samples() {
        // A spiral on a sphere.
        for count in [1_u32, 16, 17, 200, 1024] {
            let place = |i: f64, count: f64| {
                let z = 1.0 - 2.0 * (i + 0.5) / count;
                let (sin, cos) = (i * 2.399_963).sin_cos();
                DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
            };
            let samples: Vec<DVec3> = (0..count).map(|i| place(i.into(), count.into())).collect();
            let bounds = Bounds { min: DVec3::splat(-1.05), max: DVec3::splat(1.05) };
            let grid = Grid::new(&samples, &bounds);
            let gpu = grid.to_gpu(DVec3::ZERO, 0);
            for i in 0..500_u32 {
                let at = place(i.into(), 500.0);
                let cell = ((at - bounds.min) * f64::from(gpu.low_scale.w)).as_uvec3();
                let cell = (cell.z * gpu.rows + cell.y) * gpu.columns + cell.x;
                let listed = grid.cells[cell as usize];
                let mut nearest: Vec<u32> = (0..count).collect();
                let distance = |sample: &u32| samples[*sample as usize].distance_squared(at);
                nearest.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
                let most = nearest.len().min(5);
                assert!(nearest[..most].iter().all(|sample| listed.contains(sample)), "{count}, {at}");
                let known = listed.iter().filter(|sample| **sample != NO_SAMPLE).count();
                assert_eq!(known, samples.len().min(CELL_SAMPLES));
            }
        }
    }

    #[test]
    fn a_box_without_extent_is_one_cell() {
        let bounds = Bounds { min: DVec3::ONE, max: DVec3::ONE };
        let grid = Grid::new(&vec![DVec3::ONE; 40], &bounds);
        assert_eq!(grid.counts, [1; 3]);
        assert!(grid.to_gpu(DVec3::ZERO, 0).low_scale.is_finite());
    }
}
