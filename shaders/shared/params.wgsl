// Generated from the parameter table (crates/scene/src/settings.rs); a test keeps it so. Do not edit.

// The view: projection, up axis, background.
struct View {
    projection: u32,
    field_of_view: f32,
    up: u32,
    background: u32,
}
const VIEW_PROJECTION_PERSPECTIVE: u32 = 0u;
const VIEW_PROJECTION_ORTHOGRAPHIC: u32 = 1u;
const VIEW_UP_AUTO: u32 = 0u;
const VIEW_UP_Y: u32 = 1u;
const VIEW_UP_Z: u32 = 2u;

// Splatting: how points become surfaces.
struct Splat {
    quality: u32,
    size: f32,
    min_pixels: f32,
    max_pixels: f32,
    depth_offset: f32,
    close_gaps: u32,
    atomics: u32,
}
const SPLAT_QUALITY_NEAREST: u32 = 0u;
const SPLAT_QUALITY_HIGH: u32 = 1u;
const SPLAT_ATOMICS_AUTO: u32 = 0u;
const SPLAT_ATOMICS_32: u32 = 1u;

// Colour of the points.
struct Color {
    by: u32,
    ramp: u32,
    low: f32,
    high: f32,
    plain: u32,
}
const COLOR_BY_AUTO: u32 = 0u;
const COLOR_BY_RGB: u32 = 1u;
const COLOR_BY_HEIGHT: u32 = 2u;
const COLOR_BY_INTENSITY: u32 = 3u;
const COLOR_BY_CLASS: u32 = 4u;
const COLOR_BY_RETURN: u32 = 5u;
const COLOR_BY_NORMAL: u32 = 6u;
const COLOR_BY_GPS_TIME: u32 = 7u;
const COLOR_BY_ATTRIBUTE: u32 = 8u;
const COLOR_BY_PLAIN: u32 = 9u;
const COLOR_RAMP_TURBO: u32 = 0u;
const COLOR_RAMP_VIRIDIS: u32 = 1u;
const COLOR_RAMP_MAGMA: u32 = 2u;
const COLOR_RAMP_GRAY: u32 = 3u;
const COLOR_RAMP_SPECTRAL: u32 = 4u;

// Eye-dome lighting (Boucheny 2009): a depth cue from the depth image alone.
struct Edl {
    strength: f32,
    radius: f32,
}

// Light.
struct Light {
    headlight: f32,
}

// Surface estimation: normals and spacing of clouds that come without.
struct Surface {
    neighbours: u32,
    orientation: u32,
}
const SURFACE_ORIENTATION_AUTO: u32 = 0u;
const SURFACE_ORIENTATION_UP: u32 = 1u;
const SURFACE_ORIENTATION_INWARD: u32 = 2u;
const SURFACE_ORIENTATION_OUTWARD: u32 = 3u;

// Built-in scenes: how they are sampled.
struct Scene {
    points: u32,
    seed: u32,
}

// All parameters, in the order of Settings::groups.
struct Settings {
    view: View,
    splat: Splat,
    color: Color,
    edl: Edl,
    light: Light,
    surface: Surface,
    scene: Scene,
}
