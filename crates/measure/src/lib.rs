//! Measurements on points: sections along a line; lengths, angles and areas; planes, circles and cylinders fitted to
//! points; volumes between points and a plane; distances between clouds; and how certain all of these are.
//!
//! The crate knows points, and no files, no scene and no GPU. Lengths are in the units of the coordinates, and angles in
//! radians.

mod compare;
mod error;
mod figures;
mod fit;
mod nearest;
mod scatter;
mod section;
mod tree;
mod triangles;
mod volume;

pub use compare::{Change, DistanceFigures, M3c2, nearest_distances, spacing};
pub use error::{Error, Result};
pub use figures::{angle, area, crosses_itself, height, length};
pub use fit::{Plane, Round, circle, cylinder, plane};
pub use nearest::Nearest;
pub use scatter::{IN_95_PERCENT, Scatter, spread};
pub use section::{Placed, Section};
pub use tree::{Cylinder, PointTree};
pub use triangles::TriangleTree;
pub use volume::{Volume, VolumeGrid};
