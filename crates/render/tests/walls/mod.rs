//! Walls for tests to light, and the store that holds them.

use std::sync::Arc;

use cloud::{Chunk, Cloud, pack_normal, pack_radius};
use glam::DVec3;
use render::{ColorPlan, Material, PointStore};
use scene::Settings;

use crate::stage::Stage;

/// The sRGB colour of the walls, and its linear value.
pub const GREY: u8 = 188;
pub const ALBEDO: f64 = 0.502_886_5;
/// The radius of the walls' splats.
pub const DISC: f64 = 0.02;

/// A rectangle, sampled so that its discs close it.
pub fn wall(corner: DVec3, edges: [DVec3; 2]) -> Chunk {
    sheet(corner, edges, DISC)
}

/// A rectangle of splats of this radius.
pub fn sheet(corner: DVec3, edges: [DVec3; 2], disc: f64) -> Chunk {
    let counts = edges.map(|edge| (edge.length() / disc).ceil() as u32);
    let at = |i: u32, count: u32| (f64::from(i) + 0.5) / f64::from(count);
    let points: Vec<[f32; 3]> = (0..counts[0] * counts[1])
        .map(|i| {
            let (u, v) = (at(i % counts[0], counts[0]), at(i / counts[0], counts[1]));
            (corner + edges[0] * u + edges[1] * v).as_vec3().to_array()
        })
        .collect();
    let normal = edges[0].cross(edges[1]).normalize().as_vec3();
    let mut chunk = Chunk::new(0, DVec3::ZERO, points);
    chunk.colors = Some(Arc::new(vec![[GREY, GREY, GREY, 255]; chunk.len()]));
    chunk.normals = Some(Arc::new(vec![pack_normal(normal); chunk.len()]));
    chunk.radii = Some(Arc::new(vec![pack_radius(disc as f32); chunk.len()]));
    chunk
}

pub fn store_of(stage: &Stage, chunks: Vec<Chunk>, material: Material) -> PointStore {
    let mut store = PointStore::new(stage.gpu.clone());
    let id = store.add_cloud(material);
    let ids: Vec<_> = chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
    let cloud = Cloud { chunks, ..Cloud::default() };
    let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
    store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
    store
}

pub fn settings(pairs: &[(&str, &str)]) -> Settings {
    let mut settings = Settings::default();
    for (key, value) in pairs {
        settings.set_text(key, value).unwrap();
    }
    settings
}
