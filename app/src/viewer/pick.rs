//! A point that a person picked, and what is known of it.

use glam::DVec3;

use super::render_thread::PickedPoint;

/// A point someone clicked on.
#[derive(Clone)]
pub struct Pick {
    pub point: PickedPoint,
    pub cloud: String,
    /// The file's own coordinates.
    pub world: DVec3,
    /// Everything the file says of it; `None` until it is looked up.
    pub record: Option<Result<Vec<(String, String)>, String>>,
    /// The point comes from the pages of an index, which keep neither its number in the file nor its other attributes.
    pub is_streamed: bool,
}
