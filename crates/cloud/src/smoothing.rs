//! Makes normals for points that are to reflect: those of a scan are too rough. They come from the mean of the normals
//! around, from the plane through the neighbours, or from the plane through all points.

use std::collections::HashMap;

use glam::{DMat3, DVec3, Vec3};

use crate::shape::smallest_eigenvector;
use crate::{Bounds, Chunk, NO_NORMAL, Orientation, Progress, SurfelOptions, estimate, pack_normal, unpack_normal};

/// The mean normals of the points that `marks` names (one list per chunk, one entry per point), from those points
/// alone; others keep theirs. Returns a packed list per chunk. `progress` counts points; `None` when cancelled.
///
/// The mean is weighted: normals are distributed to the corners of a grid and gathered again, each time by a tent over
/// two cells, whose variance is a sixth of a cell squared. Two tents are as wide as an even disc of `radius` if a cell
/// is sqrt(3) / 2 of it. So the cost does not depend on the radius.
pub fn smoothed_normals(
    chunks: &[Chunk],
    marks: &[Vec<bool>],
    radius: f64,
    progress: &Progress,
) -> Option<Vec<Vec<u32>>> {
    let cell = radius * 0.75_f64.sqrt();
    let bounds = chunks.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
    let origin = if bounds.is_empty() { DVec3::ZERO } else { bounds.center() };
    progress.set_total(2 * chunks.iter().map(|chunk| chunk.len() as u64).sum::<u64>());
    let mut sums: HashMap<[i64; 3], Vec3> = HashMap::new();
    for (chunk, marks) in chunks.iter().zip(marks) {
        if progress.is_cancelled() {
            return None;
        }
        for index in (0..chunk.len()).filter(|index| marks[*index]) {
            if let Some(normal) = normal_of(chunk, index) {
                for (corner, weight) in corners((chunk.position(index) - origin) / cell) {
                    *sums.entry(corner).or_default() += normal * weight;
                }
            }
        }
        progress.add(chunk.len() as u64);
    }
    let mut smoothed = Vec::with_capacity(chunks.len());
    for (chunk, marks) in chunks.iter().zip(marks) {
        if progress.is_cancelled() {
            return None;
        }
        let normal = |index: usize| {
            let own = chunk.normals.as_ref().map_or(NO_NORMAL, |normals| normals[index]);
            if !marks[index] {
                return own;
            }
            let near = corners((chunk.position(index) - origin) / cell);
            let sum: Vec3 = near.iter().filter_map(|(corner, weight)| Some(*sums.get(corner)? * *weight)).sum();
            sum.try_normalize().map_or(own, pack_normal)
        };
        smoothed.push((0..chunk.len()).map(normal).collect());
        progress.add(chunk.len() as u64);
    }
    Some(smoothed)
}

fn normal_of(chunk: &Chunk, index: usize) -> Option<Vec3> {
    chunk.normals.as_ref().and_then(|normals| unpack_normal(normals[index]))
}

/// The grid corners around a position in cells, and their trilinear weights; corner 0 with weight 0 for a position that
/// is not finite.
fn corners(position: DVec3) -> [([i64; 3], f32); 8] {
    let low = position.floor();
    let part = position - low;
    let base = [low.x as i64, low.y as i64, low.z as i64];
    std::array::from_fn(|corner| {
        let bit = |axis: usize| corner >> axis & 1;
        let share = |axis: usize| if bit(axis) == 1 { part[axis] } else { 1.0 - part[axis] };
        let weight = (share(0) * share(1) * share(2)) as f32;
        let at = [0, 1, 2].map(|axis| base[axis].saturating_add(bit(axis) as i64));
        if weight.is_finite() { (at, weight) } else { ([0; 3], 0.0) }
    })
}

/// The normals of the points that `marks` names, from the planes through their nearest neighbours among those points,
/// turned to the side of each point's own normal; others keep theirs. `progress` counts points; `None` when cancelled.
pub fn refitted_normals(
    chunks: &[Chunk],
    marks: &[Vec<bool>],
    neighbours: usize,
    progress: &Progress,
) -> Option<Vec<Vec<u32>>> {
    let marked: Vec<Chunk> = chunks
        .iter()
        .zip(marks)
        .map(|(chunk, marks)| {
            let positions = chunk.positions.iter().zip(marks).filter(|(_, marked)| **marked);
            Chunk::new(chunk.first_point, chunk.origin, positions.map(|(position, _)| *position).collect())
        })
        .collect();
    let options = SurfelOptions {
        neighbours,
        orientation: Orientation::Up(Vec3::Z),
        radii: crate::RadiusRule::Full,
        seen_from: None,
    };
    let fitted = estimate(&marked, &options, progress)?;
    let refit = |((chunk, marks), fitted): ((&Chunk, &Vec<bool>), crate::Surfels)| {
        let mut fitted = fitted.normals.into_iter();
        let normal = |index: usize| {
            let own = chunk.normals.as_ref().map_or(NO_NORMAL, |normals| normals[index]);
            let found = if marks[index] { fitted.next().and_then(unpack_normal) } else { None };
            found.map_or(own, |normal| pack_normal(on_side_of(normal, unpack_normal(own))))
        };
        (0..chunk.len()).map(normal).collect()
    };
    Some(chunks.iter().zip(marks).zip(fitted).map(refit).collect())
}

/// The normal of the plane through all points that `marks` names, on the side of most of their normals; `None` for
/// points on a line.
pub fn plane_normal(chunks: &[Chunk], marks: &[Vec<bool>]) -> Option<Vec3> {
    let marked = || {
        let of_chunk = |(chunk, marks): (&'_ Chunk, &'_ Vec<bool>)| -> Vec<usize> {
            (0..chunk.len()).filter(|index| marks[*index] && chunk.position(*index).is_finite()).collect()
        };
        chunks
            .iter()
            .zip(marks)
            .flat_map(move |(chunk, marks)| of_chunk((chunk, marks)).into_iter().map(move |index| (chunk, index)))
    };
    let (mut count, mut mean, mut side) = (0.0, DVec3::ZERO, Vec3::ZERO);
    for (chunk, index) in marked() {
        count += 1.0;
        // A running mean, so that seven-digit coordinates keep their digits.
        mean += (chunk.position(index) - mean) / count;
        side += normal_of(chunk, index).unwrap_or_default();
    }
    let mut covariance = DMat3::ZERO;
    for (chunk, index) in marked() {
        let offset = chunk.position(index) - mean;
        covariance += DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z);
    }
    let normal = smallest_eigenvector(covariance * (1.0 / count))?.as_vec3();
    Some(on_side_of(normal, Some(side)))
}

fn on_side_of(normal: Vec3, side: Option<Vec3>) -> Vec3 {
    if side.is_some_and(|side| normal.dot(side) < 0.0) { -normal } else { normal }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    /// Water: a square of points 0.1 apart in a plane tilted by 5 degrees, whose normals have waves of 10 degrees with
    /// a mean of zero; then one point of the shore.
    fn water() -> (Vec<Chunk>, Vec<Vec<bool>>, Vec3) {
        let tilt = 5.0_f32.to_radians();
        let up = Vec3::new(-tilt.sin(), 0.0, tilt.cos());
        let mut positions: Vec<[f32; 3]> = Vec::new();
        let mut normals = Vec::new();
        for i in 0..100 {
            for j in 0..100 {
                let (x, y) = (i as f32 * 0.1, j as f32 * 0.1);
                positions.push([x * tilt.cos(), y, x * tilt.sin()]);
                let sign = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
                normals.push(pack_normal((up + Vec3::Y * sign * 10.0_f32.to_radians().tan()).normalize()));
            }
        }
        positions.push([0.0, 0.0, 3.0]);
        normals.push(pack_normal(Vec3::X));
        let mut marks = vec![true; positions.len()];
        marks[10_000] = false;
        let origin = DVec3::new(635_000.0, 5_077_000.0, 100.0);
        let chunk = Chunk { normals: Some(Arc::new(normals)), ..Chunk::new(0, origin, positions) };
        (vec![chunk], vec![marks], up)
    }

    fn worst_degrees(normals: &[u32], truth: Vec3, indices: impl Iterator<Item = usize>) -> f32 {
        let angle = |index: usize| {
            let normal = unpack_normal(normals[index]).unwrap();
            normal.cross(truth).length().atan2(normal.dot(truth)).to_degrees()
        };
        indices.map(angle).fold(0.0, f32::max)
    }

    #[test]
    fn waves_are_smoothed_out_and_the_shore_keeps_its_normal() {
        let (chunks, marks, up) = water();
        let smoothed = smoothed_normals(&chunks, &marks, 0.5, &Progress::default()).unwrap().remove(0);
        // Not at the edge, where the waves are cut off.
        let inside = (0..10_000).filter(|index| (20..80).contains(&(index % 100)) && (20..80).contains(&(index / 100)));
        assert!(worst_degrees(&smoothed, up, inside) < 0.1);
        assert_eq!(unpack_normal(smoothed[10_000]), Some(Vec3::X));
    }

    #[test]
    fn smoothing_is_as_wide_as_its_radius_says() {
        // Normals along a ramp that bend at x = 0: the mean over an even disc of radius R in the middle of one side, at
        // a distance of 0.25 R from the bend, is known.
        let mut positions = Vec::new();
        let mut normals = Vec::new();
        let bend = 0.1_f32;
        for i in -100..100 {
            for j in -50..50 {
                let x = (i as f32 + 0.5) * 0.02;
                positions.push([x, j as f32 * 0.02, 0.0]);
                let slope = if x < 0.0 { -bend } else { bend };
                normals.push(pack_normal(Vec3::new(slope, 0.0, 1.0).normalize()));
            }
        }
        let count = positions.len();
        let chunk = Chunk { normals: Some(Arc::new(normals)), ..Chunk::new(0, DVec3::ZERO, positions) };
        let smoothed =
            smoothed_normals(std::slice::from_ref(&chunk), &[vec![true; count]], 0.6, &Progress::default()).unwrap();
        let share = |x: f32| {
            let index = (0..count).min_by(|a, b| {
                let far = |i: &usize| Vec3::from(chunk.positions[*i]).distance(Vec3::new(x, 0.0, 0.0));
                far(a).total_cmp(&far(b))
            });
            let normal = unpack_normal(smoothed[0][index.unwrap()]).unwrap();
            normal.x / normal.z / bend
        };
        // The share of a disc beyond a chord at 0.25 R: 0.685 on one side, 0.315 on the other.
        assert!((share(0.15) - 0.37).abs() < 0.12, "{}", share(0.15));
        assert!(share(0.9) > 0.98 && share(-0.9) < -0.98);
    }

    #[test]
    fn planes_through_neighbours_and_through_all_ignore_rough_normals() {
        let (chunks, marks, up) = water();
        let fitted = refitted_normals(&chunks, &marks, 16, &Progress::default()).unwrap().remove(0);
        assert!(worst_degrees(&fitted, up, 0..10_000) < 0.1);
        assert_eq!(unpack_normal(fitted[10_000]), Some(Vec3::X));
        let plane = plane_normal(&chunks, &marks).unwrap();
        assert!(plane.cross(up).length().asin().to_degrees() < 0.01 && plane.dot(up) > 0.0, "{plane}");
        assert_eq!(plane_normal(&chunks, &[vec![false; 10_001]]), None);
    }

    #[test]
    fn smoothing_stops_when_it_is_cancelled() {
        let (chunks, marks, _) = water();
        let progress = Progress::default();
        progress.cancel();
        assert!(smoothed_normals(&chunks, &marks, 0.5, &progress).is_none());
        assert!(refitted_normals(&chunks, &marks, 16, &progress).is_none());
    }
}
