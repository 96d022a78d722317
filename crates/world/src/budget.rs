//! The numbers of points and bytes that streamed clouds may have.

use scene::{Settings, Stream, ViewSettings};

/// The memory of a point on the GPU in bytes: 24 of the point itself, 4 of the attribute shown, 20 of the tree through
/// which reflections are traced, and a sixteenth more, since chunks begin at whole blocks.
const GPU_POINT_BYTES: u64 = 51;
/// The part of the points that may be resident that is reserved for the first cut (one in this number) while previews
/// are shown in its place.
pub(crate) const CUT_PART: u64 = 2;

/// The memory in bytes for building an index, and also that for decoded points: half of the whole each.
pub fn half_of(host_bytes: param::Bytes) -> u64 {
    host_bytes.0 / 2
}

/// The number of points that may be resident at once.
pub fn most_points(view: &ViewSettings, stream: &Stream) -> u64 {
    u64::from(view.point_budget).min(stream.gpu_bytes.0 / GPU_POINT_BYTES)
}

/// The number of points that previews may have: the first cut must find room beside them.
pub fn most_preview_points(settings: &Settings) -> u64 {
    let held = most_points(&settings.view, &settings.stream);
    held - held.div_ceil(CUT_PART)
}
