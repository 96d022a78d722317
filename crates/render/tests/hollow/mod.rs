//! A closed room whose walls get the same light everywhere, and a lamp of a known flux in it.

use std::f64::consts::PI;
use std::sync::Arc;

use cloud::{Chunk, SPLAT_OVERLAP, pack_normal, pack_radius};
use glam::DVec3;
use scene::SpotLight;

use crate::walls::GREY;

/// The inside of a sphere about the origin, of `points` discs as large as those that are estimated for scans.
pub fn hollow_sphere(radius: f64, points: u32) -> Chunk {
    let place = |index: u32| {
        // A spiral of even density (Vogel 1979).
        let z = 1.0 - (2.0 * f64::from(index) + 1.0) / f64::from(points);
        let turn = f64::from(index) * PI * (3.0 - 5_f64.sqrt());
        DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
    };
    let directions: Vec<DVec3> = (0..points).map(place).collect();
    let at = |direction: &DVec3| (*direction * radius).as_vec3().to_array();
    let mut chunk = Chunk::new(0, DVec3::ZERO, directions.iter().map(at).collect());
    chunk.normals = Some(Arc::new(directions.iter().map(|direction| pack_normal(-direction.as_vec3())).collect()));
    chunk.colors = Some(Arc::new(vec![[GREY, GREY, GREY, 255]; chunk.len()]));
    let disc = f64::from(SPLAT_OVERLAP) * radius * (4.0 / f64::from(points)).sqrt();
    chunk.radii = Some(Arc::new(vec![pack_radius(disc as f32); chunk.len()]));
    chunk
}

/// A lamp whose cone of light ends sharply at an angle from its axis, and its flux.
pub fn cone(position: DVec3, target: DVec3, degrees: f32) -> (SpotLight, f64) {
    let lamp = SpotLight { position, target, intensity: [10.0; 3], inner_degrees: degrees, outer_degrees: degrees };
    (lamp, 10.0 * 2.0 * PI * (1.0 - f64::from(degrees).to_radians().cos()))
}
