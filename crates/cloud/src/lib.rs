//! Points and their attributes in memory: chunks, bounds, normals, spacing, sampling of analytic surfaces and meshes.
//!
//! The crate knows no files, no paths and no GPU. A cloud is a list of chunks; a chunk has an f64 origin of its own
//! and f32 offsets from it, so that coordinates of seven digits lose no precision on the way to the screen.

mod blank;
mod bounds;
mod carve;
mod cells;
mod certainty;
mod chunk;
mod column;
mod leaves;
mod mesh_points;
mod names;
mod neighbours;
mod noise;
mod origin;
mod packing;
mod picture;
mod placement;
mod progress;
mod random;
mod robust;
mod rows;
pub mod sampling;
mod shape;
mod shown_radii;
mod smoothing;
mod strays;
mod surfels;
mod triangle_mesh;
mod visibility;
mod volume;

pub use blank::{ColorCount, is_black};
pub use bounds::Bounds;
pub use carve::{are_seen_from_stations, is_depth_image, is_seen_from};
pub use certainty::{HalfWidths, STATED, error_along, half_widths, surface_errors};
pub use chunk::{Chunk, Cloud, Grid};
pub use column::{Attribute, Column, ColumnType, ValueRange, number};
pub use mesh_points::MeshPoints;
pub use names::{
    COMPARED, GHOST_ERROR, SURFACE_ERROR, attribute_named, attributes_named, is_length, is_numbered, standard_name,
};
pub use noise::{Neighbourhoods, neighbourhoods};
pub use origin::{Amid, amid, offset_from};
pub use packing::{
    MIXED_RADIUS, NO_NORMAL, NO_RADIUS, RADIUS_SHAPES, RADIUS_STEPS, STRAY_RADIUS, Stretch, grown_radius, pack_ellipse,
    pack_normal, pack_radius, resized_radius, stray_kind, stretch_ratio, unpack_normal, unpack_radius, unpack_stretch,
};
pub use placement::Placement;
pub use progress::Progress;
pub use random::{Random, hash, unit};
pub use robust::{
    Scalar, constant, histogram, percentile_range, robust_bounds, robust_extent, robust_range, scene_fence,
    spread_sample, value_range,
};
pub use shape::smallest_eigenvector;
pub use shown_radii::radii_among;
pub use smoothing::{plane_normal, refitted_normals, smoothed_normals};
pub use surfels::{
    ESTIMATOR, MeshNormals, Orientation, RadiusRule, SPLAT_OVERLAP, SeenFrom, SurfelOptions, Surfels, estimate,
    estimate_part, guess_orientation, normals_from_triangles, provisional_radius,
};
pub use triangle_mesh::TriangleMesh;
pub use visibility::{ChunkTest, ClipVolume, CloudLayout, Filter, PointTest, STRAY, ShownPoints};
pub use volume::{Cover, Volume, VolumeShape};

/// The most points of a chunk when a reader is free to choose (2.4 MB of 36-byte LAS records).
pub const CHUNK_POINTS: usize = 65_536;
