//! A point that a person picked, and what is known of it.

use cloud::{Chunk, Cloud};
use glam::DVec3;

use super::render_thread::PickedPoint;

/// A point someone clicked on.
#[derive(Clone)]
pub struct Pick {
    pub point: PickedPoint,
    /// The number of its record in the file.
    pub number: u64,
    pub cloud: String,
    /// The file's own coordinates.
    pub world: DVec3,
    /// Everything the file says of it; `None` until it is looked up.
    pub record: Option<Result<Vec<(String, String)>, String>>,
    /// The point comes from the pages of an index, which keep neither its number in the file nor its other attributes.
    pub is_streamed: bool,
}

/// World units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    pub total: f64,
    pub horizontal: f64,
    /// Along the up axis; negative if the second point is lower.
    pub vertical: f64,
}

/// What is known of a point without a file.
pub fn loaded_attributes(cloud: &Cloud, chunk: &Chunk, index: usize) -> Vec<(String, String)> {
    let mut attributes = Vec::new();
    if let Some(colors) = &chunk.colors {
        let [red, green, blue, _] = colors[index];
        attributes.push(("color".into(), format!("{red} {green} {blue}")));
    }
    if let Some(normal) = chunk.normals.as_ref().and_then(|normals| cloud::unpack_normal(normals[index])) {
        attributes.push(("normal".into(), format!("{:.4} {:.4} {:.4}", normal.x, normal.y, normal.z)));
    }
    for (attribute, column) in cloud.attributes.iter().zip(&chunk.columns) {
        if let Some(column) = column {
            attributes.push((attribute.name.clone(), column.text(index)));
        }
    }
    attributes
}
