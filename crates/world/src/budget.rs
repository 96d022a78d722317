//! How many points and bytes streamed clouds may have.

use scene::{Settings, Stream, ViewSettings};

/// Bytes that a point takes on the GPU: 24 of the point itself, 4 of the attribute shown, 20 of the tree that reflections are traced
/// through, and a sixteenth more, since chunks begin at whole blocks.
const GPU_POINT_BYTES: u64 = 51;
/// Part of the points that may be resident that stays for the first cut while others are shown in its place.
pub(crate) const CUT_PART: u64 = 2;

/// Bytes that building an index may take, and as many that decoded points may take: half of the whole each.
pub fn half_of(host_bytes: param::Bytes) -> u64 {
    host_bytes.0 / 2
}

/// Points that may be resident at once.
pub fn most_points(view: &ViewSettings, stream: &Stream) -> u64 {
    u64::from(view.point_budget).min(stream.gpu_bytes.0 / GPU_POINT_BYTES)
}

/// Points that previews may have: the first cut must find room beside them.
pub fn most_preview_points(settings: &Settings) -> u64 {
    let held = most_points(&settings.view, &settings.stream);
    held - held.div_ceil(CUT_PART)
}
