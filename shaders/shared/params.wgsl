// Generated from the parameter table (crates/scene/src/settings.rs); a test keeps it so. Do not edit.

// The view: projection, up axis, background.
struct View {
    projection: u32,
    field_of_view: f32,
    up: u32,
    start: u32,
    background: u32,
    point_budget: u32,
    resolution: f32,
    frame_ms: f32,
    still_ms: f32,
}
const VIEW_PROJECTION_PERSPECTIVE: u32 = 0u;
const VIEW_PROJECTION_ORTHOGRAPHIC: u32 = 1u;
const VIEW_UP_AUTO: u32 = 0u;
const VIEW_UP_Y: u32 = 1u;
const VIEW_UP_Z: u32 = 2u;
const VIEW_START_AUTO: u32 = 0u;
const VIEW_START_OUTSIDE: u32 = 1u;

// Splatting: how points become surfaces.
struct Splat {
    quality: u32,
    size: f32,
    min_pixels: f32,
    max_pixels: f32,
    rest_pixels: f32,
    depth_offset: f32,
    close_gaps: u32,
    back_faces: u32,
    step: u32,
    strays: u32,
    atomics: u32,
    large: u32,
}
const SPLAT_QUALITY_NEAREST: u32 = 0u;
const SPLAT_QUALITY_HIGH: u32 = 1u;
const SPLAT_STRAYS_FADED: u32 = 0u;
const SPLAT_STRAYS_HIDDEN: u32 = 1u;
const SPLAT_ATOMICS_AUTO: u32 = 0u;
const SPLAT_ATOMICS_32: u32 = 1u;
const SPLAT_LARGE_AUTO: u32 = 0u;
const SPLAT_LARGE_ALONE: u32 = 1u;
const SPLAT_LARGE_SHARED: u32 = 2u;

// Colour of the points.
struct Color {
    by: u32,
    ramp: u32,
    low: f32,
    high: f32,
    blank: u32,
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
const COLOR_BY_STRAY: u32 = 9u;
const COLOR_BY_PLAIN: u32 = 10u;
const COLOR_BY_CERTAINTY: u32 = 11u;
const COLOR_RAMP_TURBO: u32 = 0u;
const COLOR_RAMP_VIRIDIS: u32 = 1u;
const COLOR_RAMP_MAGMA: u32 = 2u;
const COLOR_RAMP_GRAY: u32 = 3u;
const COLOR_RAMP_SPECTRAL: u32 = 4u;
const COLOR_RAMP_MARKS: u32 = 5u;
const COLOR_BLANK_AUTO: u32 = 0u;
const COLOR_BLANK_BLACK: u32 = 1u;

// Overlays: what is drawn over the picture to read it by, in the window, in pictures and in films.
struct Overlay {
    scale_bar: u32,
    legend: u32,
    north: u32,
    axes: u32,
    labels: u32,
    text: f32,
}

// Eye-dome lighting (Boucheny 2009): a depth cue from the depth image. The slope of a plane is no step of depth.
struct Edl {
    strength: f32,
    radius: f32,
    ignored: f32,
}

// Light.
struct Light {
    by: u32,
    headlight: f32,
    fill: f32,
    shadow_bias: f32,
    diffuse: f32,
    gloss: f32,
    gloss_power: f32,
    highlight: u32,
    photons: u32,
    show: u32,
}
const LIGHT_BY_AUTO: u32 = 0u;
const LIGHT_BY_LIGHTS: u32 = 1u;
const LIGHT_BY_SUN: u32 = 2u;
const LIGHT_BY_HEADLIGHT: u32 = 3u;
const LIGHT_BY_COLORS: u32 = 4u;
const LIGHT_BY_SURROUNDINGS: u32 = 5u;
const LIGHT_HIGHLIGHT_PHONG: u32 = 0u;
const LIGHT_HIGHLIGHT_BLINN: u32 = 1u;
const LIGHT_SHOW_PICTURE: u32 = 0u;
const LIGHT_SHOW_DIRECT: u32 = 1u;
const LIGHT_SHOW_INDIRECT: u32 = 2u;
const LIGHT_SHOW_ALBEDO: u32 = 3u;
const LIGHT_SHOW_NORMAL: u32 = 4u;
const LIGHT_SHOW_DEPTH: u32 = 5u;
const LIGHT_SHOW_LIGHT_BUFFER: u32 = 6u;
const LIGHT_SHOW_VIRTUAL_LIGHTS: u32 = 7u;
const LIGHT_SHOW_SHADOW_MAPS: u32 = 8u;

// Sun and sky.
struct Sun {
    azimuth: f32,
    elevation: f32,
    irradiance: f32,
    sky: f32,
}

// Indirect light by virtual lights (Keller 1997) with imperfect shadow maps (Ritschel et al. 2008), or by rays.
struct Gi {
    by: u32,
    rays_per_pixel: u32,
    ray_bounces: u32,
    ray_seed: u32,
    bounces: u32,
    vpls: u32,
    vpl: u32,
    clamp: f32,
    sky_lights: u32,
    shadows: u32,
    shadow_size: u32,
    shadow_points: u32,
    occluders: u32,
    shadow_bias: f32,
    pull_levels: u32,
    interleave: u32,
    filtered: u32,
    filter_depth: f32,
    filter_angle: f32,
}
const GI_BY_LIGHTS: u32 = 0u;
const GI_BY_RAYS: u32 = 1u;
const GI_VPL_SPHERICAL: u32 = 0u;
const GI_VPL_POINT: u32 = 1u;
const GI_OCCLUDERS_DISCS: u32 = 0u;
const GI_OCCLUDERS_SQUARES: u32 = 1u;

// Tone mapping.
struct Tone {
    exposure: f32,
    fit: u32,
    curve: u32,
}
const TONE_FIT_AUTO: u32 = 0u;
const TONE_FIT_ALWAYS: u32 = 1u;
const TONE_FIT_LOCKED: u32 = 2u;
const TONE_CURVE_AUTO: u32 = 0u;
const TONE_CURVE_FILMIC: u32 = 1u;
const TONE_CURVE_SRGB: u32 = 2u;

// The ray-traced truth.
struct Trace {
    samples: u32,
    rays: u32,
    photons: u32,
    seed: u32,
}

// Mirrors.
struct Mirror {
    surface: u32,
    last: u32,
    tint: f32,
    fresnel: f32,
    fresnel_law: u32,
    fade_distance: f32,
    fade_least: f32,
}
const MIRROR_SURFACE_AUTO: u32 = 0u;
const MIRROR_SURFACE_EXACT: u32 = 1u;
const MIRROR_SURFACE_POINTS: u32 = 2u;
const MIRROR_LAST_MATT: u32 = 0u;
const MIRROR_LAST_DARK: u32 = 1u;
const MIRROR_FRESNEL_LAW_SCHLICK: u32 = 0u;
const MIRROR_FRESNEL_LAW_PUBLISHED: u32 = 1u;

// Reflections.
struct Reflection {
    method: u32,
    own_methods: u32,
    bounces: u32,
    least_weight: f32,
    samples: u32,
    keep: u32,
    show: u32,
}
const REFLECTION_METHOD_AUTO: u32 = 0u;
const REFLECTION_METHOD_NONE: u32 = 1u;
const REFLECTION_METHOD_ENVIRONMENT_MAP: u32 = 2u;
const REFLECTION_METHOD_MIRRORED_VIEWPOINT: u32 = 3u;
const REFLECTION_METHOD_SSCR: u32 = 4u;
const REFLECTION_METHOD_SSCR_HIERARCHICAL: u32 = 5u;
const REFLECTION_METHOD_SURFEL_TRACE: u32 = 6u;
const REFLECTION_METHOD_CUBEMAP_TRACE: u32 = 7u;
const REFLECTION_METHOD_SCREEN_TRACE: u32 = 8u;
const REFLECTION_METHOD_SAMPLE_CAMERAS: u32 = 9u;
const REFLECTION_METHOD_LIGHT_FIELD: u32 = 10u;
const REFLECTION_SHOW_PICTURE: u32 = 0u;
const REFLECTION_SHOW_UNCERTAIN: u32 = 1u;
const REFLECTION_SHOW_BORDERS: u32 = 2u;
const REFLECTION_SHOW_CURVATURE: u32 = 3u;
const REFLECTION_SHOW_REGIONS: u32 = 4u;
const REFLECTION_SHOW_SEARCH: u32 = 5u;
const REFLECTION_SHOW_STEPS: u32 = 6u;
const REFLECTION_SHOW_UNCONVERGED: u32 = 7u;
const REFLECTION_SHOW_ERROR: u32 = 8u;
const REFLECTION_SHOW_COVERAGE: u32 = 9u;
const REFLECTION_SHOW_DISTANCE: u32 = 10u;
const REFLECTION_SHOW_ALBEDO: u32 = 11u;
const REFLECTION_SHOW_NORMAL: u32 = 12u;
const REFLECTION_SHOW_POSITION: u32 = 13u;

// Glossy mirrors: mirrors with a specular power show the mean of what many rays meet (docs/methods/gloss.md).
struct Gloss {
    samples: u32,
    lobe: u32,
    across: f32,
    pattern: u32,
    seed: u32,
    cache: u32,
    cache_power: f32,
    cache_spread: f32,
    cache_trust: f32,
    blur: f32,
    blur_most: f32,
}
const GLOSS_LOBE_PHONG: u32 = 0u;
const GLOSS_LOBE_BLINN: u32 = 1u;
const GLOSS_LOBE_ASHIKHMIN_SHIRLEY: u32 = 2u;
const GLOSS_PATTERN_SHARED: u32 = 0u;
const GLOSS_PATTERN_PIXEL: u32 = 1u;

// Environment maps: what the points around each mirror look like from its middle (Blinn, Newell 1976; Greene 1986).
struct EnvironmentMap {
    size: u32,
    proxy: u32,
}
const ENVIRONMENT_MAP_PROXY_INFINITY: u32 = 0u;
const ENVIRONMENT_MAP_PROXY_BOX: u32 = 1u;

// Cubemap tracing: rays walk through pictures of the points around each mirror.
struct CubemapTrace {
    maps: u32,
    tries: u32,
    size: u32,
    placement: u32,
    offset: f32,
    hit: u32,
    criterion: u32,
    threshold: f32,
    sampling: u32,
    step: f32,
    angle: f32,
    skip: u32,
    jump: f32,
    disc_slack: f32,
    own: u32,
    rest: u32,
    faces_per_frame: u32,
}
const CUBEMAP_TRACE_PLACEMENT_MIDDLE: u32 = 0u;
const CUBEMAP_TRACE_PLACEMENT_SURFACE: u32 = 1u;
const CUBEMAP_TRACE_HIT_RELAY: u32 = 0u;
const CUBEMAP_TRACE_HIT_NEAREST: u32 = 1u;
const CUBEMAP_TRACE_HIT_FIRST: u32 = 2u;
const CUBEMAP_TRACE_CRITERION_PLANE: u32 = 0u;
const CUBEMAP_TRACE_CRITERION_SIGN: u32 = 1u;
const CUBEMAP_TRACE_CRITERION_THRESHOLD: u32 = 2u;
const CUBEMAP_TRACE_CRITERION_THRESHOLD_THEN_SIGN: u32 = 3u;
const CUBEMAP_TRACE_CRITERION_SIGN_EITHER: u32 = 4u;
const CUBEMAP_TRACE_SAMPLING_TEXEL: u32 = 0u;
const CUBEMAP_TRACE_SAMPLING_STEP: u32 = 1u;
const CUBEMAP_TRACE_SAMPLING_ANGLE: u32 = 2u;
const CUBEMAP_TRACE_OWN_AUTO: u32 = 0u;
const CUBEMAP_TRACE_OWN_LEFT_OUT: u32 = 1u;
const CUBEMAP_TRACE_OWN_TRACE: u32 = 2u;
const CUBEMAP_TRACE_OWN_DRAWN: u32 = 3u;
const CUBEMAP_TRACE_REST_NONE: u32 = 0u;
const CUBEMAP_TRACE_REST_SURFEL_TRACE: u32 = 1u;
const CUBEMAP_TRACE_REST_CANDIDATE: u32 = 2u;
const CUBEMAP_TRACE_REST_ENVIRONMENT_MAP: u32 = 3u;

// Screen-space tracing: rays walk through the camera's picture (after Johnsson 2012).
struct ScreenTrace {
    criterion: u32,
    thickness: f32,
    sampling: u32,
    step: f32,
    stride: f32,
    back: u32,
    skip: u32,
    box_from: u32,
    box_size: u32,
    completion: u32,
    rest: u32,
}
const SCREEN_TRACE_CRITERION_PLANE: u32 = 0u;
const SCREEN_TRACE_CRITERION_BEHIND: u32 = 1u;
const SCREEN_TRACE_CRITERION_THICKNESS: u32 = 2u;
const SCREEN_TRACE_CRITERION_LAYERS: u32 = 3u;
const SCREEN_TRACE_SAMPLING_TEXEL: u32 = 0u;
const SCREEN_TRACE_SAMPLING_STEP: u32 = 1u;
const SCREEN_TRACE_SAMPLING_EVEN: u32 = 2u;
const SCREEN_TRACE_BACK_NONE: u32 = 0u;
const SCREEN_TRACE_BACK_CULLED: u32 = 1u;
const SCREEN_TRACE_BACK_PEELED: u32 = 2u;
const SCREEN_TRACE_BOX_FROM_NONE: u32 = 0u;
const SCREEN_TRACE_BOX_FROM_POINTS: u32 = 1u;
const SCREEN_TRACE_BOX_FROM_PICTURE: u32 = 2u;
const SCREEN_TRACE_COMPLETION_NONE: u32 = 0u;
const SCREEN_TRACE_COMPLETION_NEAREST: u32 = 1u;
const SCREEN_TRACE_COMPLETION_REPEAT: u32 = 2u;
const SCREEN_TRACE_REST_NONE: u32 = 0u;
const SCREEN_TRACE_REST_SURFEL_TRACE: u32 = 1u;
const SCREEN_TRACE_REST_CUBEMAP_TRACE: u32 = 2u;
const SCREEN_TRACE_REST_ENVIRONMENT_MAP: u32 = 3u;

// Sample-based cameras (after Popescu, Sacks and Mei 2006): bundles of the mirror's rays project points.
struct SampleCameras {
    cells: u32,
    accuracy: f32,
    down_sampling: u32,
    degree: u32,
    least_square: u32,
    largest_square: u32,
    judged_by: u32,
    near: f32,
    split_gain: f32,
    longest_list: u32,
    roots: u32,
    analytic: u32,
    cull: u32,
    polish: u32,
    points_per_pixel: f32,
    rest: u32,
    splat: u32,
}
const SAMPLE_CAMERAS_CELLS_IMAGE: u32 = 0u;
const SAMPLE_CAMERAS_CELLS_SPACE: u32 = 1u;
const SAMPLE_CAMERAS_JUDGED_BY_SOLVE: u32 = 0u;
const SAMPLE_CAMERAS_JUDGED_BY_RAY: u32 = 1u;
const SAMPLE_CAMERAS_CULL_NONE: u32 = 0u;
const SAMPLE_CAMERAS_CULL_BLOCKS: u32 = 1u;
const SAMPLE_CAMERAS_REST_NONE: u32 = 0u;
const SAMPLE_CAMERAS_REST_SURFEL_TRACE: u32 = 1u;
const SAMPLE_CAMERAS_SPLAT_PUBLISHED: u32 = 0u;
const SAMPLE_CAMERAS_SPLAT_FOOTPRINT: u32 = 1u;

// Offset surface light fields (after Ang 2003): rays are looked up in maps that stand on the mirror.
struct LightField {
    samples: u32,
    accuracy: f32,
    size: u32,
    fill: u32,
    offset: f32,
    neighbours: u32,
    rule: u32,
    exponent: f32,
    visible_by: u32,
    horizon: f32,
    corrections: u32,
    own: u32,
    rest: u32,
    maps_per_frame: u32,
}
const LIGHT_FIELD_FILL_DRAW: u32 = 0u;
const LIGHT_FIELD_FILL_TRACE: u32 = 1u;
const LIGHT_FIELD_FILL_ON_DEMAND: u32 = 2u;
const LIGHT_FIELD_RULE_NEAREST: u32 = 0u;
const LIGHT_FIELD_RULE_ANGLE: u32 = 1u;
const LIGHT_FIELD_RULE_RAY: u32 = 2u;
const LIGHT_FIELD_RULE_MEAN: u32 = 3u;
const LIGHT_FIELD_RULE_REFLECTION: u32 = 4u;
const LIGHT_FIELD_RULE_NORMAL: u32 = 5u;
const LIGHT_FIELD_RULE_SMOOTH: u32 = 6u;
const LIGHT_FIELD_VISIBLE_BY_DEPTH: u32 = 0u;
const LIGHT_FIELD_VISIBLE_BY_ANGLE: u32 = 1u;
const LIGHT_FIELD_OWN_AUTO: u32 = 0u;
const LIGHT_FIELD_OWN_LEFT_OUT: u32 = 1u;
const LIGHT_FIELD_OWN_TRACE: u32 = 2u;
const LIGHT_FIELD_OWN_DRAWN: u32 = 3u;
const LIGHT_FIELD_REST_NONE: u32 = 0u;
const LIGHT_FIELD_REST_SURFEL_TRACE: u32 = 1u;
const LIGHT_FIELD_REST_ENVIRONMENT_MAP: u32 = 2u;

// Screen-space curved reflections (Preiner 2010).
struct Sscr {
    seed_attempts: u32,
    step_attempts: u32,
    initial_step: f32,
    max_steps: u32,
    search_steps: u32,
    threshold: f32,
    reading: u32,
    max_splat_size: f32,
    mirror_z_far: f32,
    mirror_depth_offset: f32,
    pull_levels: u32,
    planar_normal_threshold: f32,
    normal_filter: u32,
    depth_step_threshold: f32,
    visibility: u32,
    solve_once: u32,
    solver: u32,
    seeds: u32,
    regions_per_point: u32,
    point_share: f32,
    cull_points: u32,
    cull_chunks: u32,
    per_region: u32,
}
const SSCR_READING_TEXT: u32 = 0u;
const SSCR_READING_LISTING: u32 = 1u;
const SSCR_VISIBILITY_NEAREST: u32 = 0u;
const SSCR_VISIBILITY_ACCUMULATED: u32 = 1u;
const SSCR_SOLVER_INTERLEAVED: u32 = 0u;
const SSCR_SOLVER_NEWTON: u32 = 1u;
const SSCR_SOLVER_BROYDEN: u32 = 2u;
const SSCR_SOLVER_NELDER_MEAD: u32 = 3u;
const SSCR_SOLVER_CONJUGATE_GRADIENT: u32 = 4u;
const SSCR_SEEDS_RANDOM: u32 = 0u;
const SSCR_SEEDS_GRID: u32 = 1u;
const SSCR_SEEDS_LAST_FRAME: u32 = 2u;

// Surface estimation: normals and spacing of clouds that come without.
struct Surface {
    mesh_points: u32,
    neighbours: u32,
    orientation: u32,
    radii: u32,
    carve: u32,
}
const SURFACE_ORIENTATION_AUTO: u32 = 0u;
const SURFACE_ORIENTATION_UP: u32 = 1u;
const SURFACE_ORIENTATION_INWARD: u32 = 2u;
const SURFACE_ORIENTATION_OUTWARD: u32 = 3u;
const SURFACE_RADII_FULL: u32 = 0u;
const SURFACE_RADII_NARROW: u32 = 1u;
const SURFACE_RADII_SPREAD: u32 = 2u;

// Streaming: clouds that are larger than memory are drawn from pages on disk.
struct Stream {
    pages: u32,
    detail: f32,
    unseen: f32,
    overlay: u32,
}
const STREAM_PAGES_AUTO: u32 = 0u;
const STREAM_PAGES_ALWAYS: u32 = 1u;
const STREAM_PAGES_NEVER: u32 = 2u;

// Built-in scenes: how they are sampled.
struct Scene {
    points: u32,
    seed: u32,
}

// All parameters, in the order of Settings::groups. In uniforms, structs begin at every 16th byte.
struct Settings {
    @align(16) view: View,
    @align(16) splat: Splat,
    @align(16) color: Color,
    @align(16) overlay: Overlay,
    @align(16) edl: Edl,
    @align(16) light: Light,
    @align(16) sun: Sun,
    @align(16) gi: Gi,
    @align(16) tone: Tone,
    @align(16) trace: Trace,
    @align(16) mirror: Mirror,
    @align(16) reflection: Reflection,
    @align(16) gloss: Gloss,
    @align(16) environment_map: EnvironmentMap,
    @align(16) cubemap_trace: CubemapTrace,
    @align(16) screen_trace: ScreenTrace,
    @align(16) sample_cameras: SampleCameras,
    @align(16) light_field: LightField,
    @align(16) sscr: Sscr,
    @align(16) surface: Surface,
    @align(16) stream: Stream,
    @align(16) scene: Scene,
}
