// The records of the camera's picture: the plane of the surface at each pixel's centre, so that a ray loads one record
// a pixel. One thread a pixel.
#import frame_group
#import depth_texel
#import hit

@group(1) @binding(0) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(1) var position_in: texture_2d<f32>;
@group(1) @binding(2) var<storage, read_write> records: array<vec4u>;
// w: specular intensity.
@group(1) @binding(3) var albedo_in: texture_2d<f32>;

// Set if another method continues rays that come near to what is not sure.
override is_continued: bool = false;

// Where the normals of neighbouring pixels of a mirror differ by more, its bumps are hardly wider than a pixel.
const ROUGH_COSINE: f32 = 0.98;
// A neighbour that is farther off a pixel's plane is another surface, in pixels.
const SAME_PIXELS: f32 = 4.0;

@compute @workgroup_size(8, 8)
fn screen_planes(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let position = textureLoad(position_in, id.xy, 0);
    let pixel = id.y * frame.width + id.x;
    if position.w == 0.0 {
        records[pixel] = vec4u(0u);
        return;
    }
    let own = textureLoad(normal_in, id.xy, 0).xyz;
    let sight = select(normalize(position.xyz), frame.forward.xyz, frame.orthographic != 0u);
    let cosine = dot(own, sight);
    let by_depth = settings.screen_trace.criterion != SCREEN_TRACE_CRITERION_PLANE;
    let beside = what_is_beside(vec2i(id.xy), own, position.xyz);
    let is_blind = is_continued && beside.is_rough && !by_depth;
    let has_slope = (abs(cosine) >= LEAST_COSINE && !is_blind) || by_depth;
    let normal = select(-sight, select(own, -own, cosine > 0.0), has_slope);
    let depth = dot(position.xyz, frame.forward.xyz);
    // Seen edge-on, the surface reaches far to both sides of the depth at the centre: a ray is free up to its near end.
    let reach = 0.7 / max(abs(cosine), 0.05) / pixels_per_unit(frame, depth);
    let first = max(select(depth - reach, depth, has_slope), 0.01 * depth);
    let is_unsure = (beside.is_rough || beside.is_outline) && !by_depth;
    let identity = pixel | select(EDGE_ON, 0u, has_slope) | select(0u, BLIND, is_blind) | select(0u, UNSURE, is_unsure);
    // The disc is not known: its plane counts all over the pixel.
    records[pixel] = pack_texel(DepthTexel(identity, first, normal, 0.0, vec2f(0.0)));
}

struct Beside {
    // A mirror whose slope changes from pixel to pixel, so that no plane shows where it is met. What it reflects of
    // itself is so near that it matters.
    is_rough: bool,
    // Another surface begins beside the pixel, so that the pixel may show both.
    is_outline: bool,
}

fn what_is_beside(pixel: vec2i, normal: vec3f, place: vec3f) -> Beside {
    var beside = Beside(false, false);
    let is_mirror = textureLoad(albedo_in, pixel, 0).w > 0.0;
    let most = SAME_PIXELS / pixels_per_unit(frame, dot(place, frame.forward.xyz));
    for (var i = 0; i < 8; i++) {
        let at = clamp(pixel + neighbor(i), vec2i(0), vec2i(i32(frame.width), i32(frame.height)) - 1);
        let other = textureLoad(position_in, at, 0);
        let other_normal = textureLoad(normal_in, at, 0).xyz;
        let offset = other.xyz - place;
        // A slanted surface is off the plane of one of them, not of both.
        let is_same = other.w > 0.0 && min(abs(dot(offset, normal)), abs(dot(offset, other_normal))) < most;
        beside.is_rough = beside.is_rough || (is_mirror && is_same && dot(other_normal, normal) < ROUGH_COSINE);
        beside.is_outline = beside.is_outline || !is_same;
    }
    return beside;
}
