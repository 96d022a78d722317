//! Points of built-in scenes and of mirrors: evenly on a surface, with a colour at each place.

use std::f64::consts::PI;
use std::sync::Arc;

use cloud::sampling::{SurfacePoint, sort_along_curve};
use cloud::{CHUNK_POINTS, Chunk, pack_normal, pack_radius};
use glam::DVec3;

/// The splat radius relative to the radius of a disc with a point's share of area.
const OVERLAP: f32 = 1.5;

/// The linear red, green and blue at a world position.
pub type Albedo = fn(DVec3) -> [f64; 3];

/// The world radius of the splats of `points` that share an area evenly.
pub fn splat_radius(area: f64, points: u64) -> f32 {
    OVERLAP * (area / (PI * points.max(1) as f64)).sqrt() as f32
}

/// Appends a surface's points in chunks of neighbours.
pub fn append(chunks: &mut Vec<Chunk>, mut points: Vec<SurfacePoint>, radius: f32, albedo: impl Fn(DVec3) -> [f64; 3]) {
    sort_along_curve(&mut points);
    let mut first_point = chunks.last().map_or(0, |chunk| chunk.first_point + chunk.len() as u64);
    // Most neighbours have one colour, which is converted once.
    let mut last = ([0.0; 3], srgb([0.0; 3]));
    let mut color = |point: &SurfacePoint| {
        let linear = albedo(point.position);
        if linear != last.0 {
            last = (linear, srgb(linear));
        }
        last.1
    };
    for run in points.chunks(CHUNK_POINTS) {
        let positions = run.iter().map(|point| point.position.as_vec3().to_array()).collect();
        chunks.push(Chunk {
            colors: Some(Arc::new(run.iter().map(&mut color).collect())),
            normals: Some(Arc::new(run.iter().map(|point| pack_normal(point.normal.as_vec3())).collect())),
            radii: Some(Arc::new(vec![pack_radius(radius); run.len()])),
            ..Chunk::new(first_point, DVec3::ZERO, positions)
        });
        first_point += run.len() as u64;
    }
}

/// Converts linear values to opaque 8-bit sRGB (IEC 61966-2-1).
pub(crate) fn srgb(linear: [f64; 3]) -> [u8; 4] {
    let encode = |v: f64| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    let [red, green, blue] = linear.map(|v| (255.0 * encode(v)).round() as u8);
    [red, green, blue, 255]
}
