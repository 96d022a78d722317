// Counts mirror pixels, and those in which something was found; marks the doubtful ones, for any method, from the found
// surfaces alone. One thread a pixel.
#import frame_group
#import counters
#import direction_step
#import hit

// xyz: mirror point, w: specular intensity.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// xyz: normal of the mirror.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: origin of the ray.
@group(1) @binding(2) var eye_in: texture_2d<f32>;
// xyz: position found, w: coverage.
@group(1) @binding(3) var seen_in: texture_2d<f32>;
// xyz: its normal.
@group(1) @binding(4) var seen_normal_in: texture_2d<f32>;
// 0: trusted, or known to be open; else the reason.
@group(1) @binding(5) var doubt_out: texture_storage_2d<r32float, write>;
@group(1) @binding(6) var<storage, read_write> counters: array<atomic<u32>>;
// See hit.wgsl.
@group(1) @binding(7) var<storage, read> hits: array<vec4u>;

// Set if the method marks which rays it knows nothing about.
override knows_rest: bool = false;
// Set if the pixels of other methods keep what they have.
override is_further: bool = false;

// Closed from its neighbours.
const CLOSED: f32 = 1.0;
// The position found is more than a pixel beside the reflected ray.
const OFF_ITS_RAY: f32 = 2.0;
// The neighbours of the pixel show other surfaces: one of them hides the other, or is missing.
const ALONE: f32 = 3.0;
// Found, but something may stand before it; or nothing was found, and nothing is known.
const UNPROVEN: f32 = 4.0;
// The coverage from which on something was found, and that from which on it is proven.
const FOUND: f32 = 0.75;
const PROVEN: f32 = 1.0;

// The distance from a neighbour's surface, relative to that from the mirror, at which it is another: the tolerance of
// the occlusion error.
const OTHER_SURFACE: f32 = 0.05;

// The counts of a workgroup: one word of the counters is too hot for all pixels.
var<workgroup> mirrors: atomic<u32>;
var<workgroup> found: atomic<u32>;
var<workgroup> closed: atomic<u32>;
var<workgroup> doubted: atomic<u32>;

@compute @workgroup_size(8, 8)
fn mirror_doubt(@builtin(global_invocation_id) thread: vec3u, @builtin(local_invocation_index) lane: u32) {
    let id = mirror_pixel(frame, thread);
    if id.x < frame.width && id.y < frame.height {
        judge(id);
    }
    workgroupBarrier();
    if lane == 0u {
        atomicAdd(&counters[MIRROR_PIXELS], atomicLoad(&mirrors));
        atomicAdd(&counters[FOUND_PIXELS], atomicLoad(&found));
        atomicAdd(&counters[CLOSED_PIXELS], atomicLoad(&closed));
        atomicAdd(&counters[DOUBTED_PIXELS], atomicLoad(&doubted));
    }
}

fn judge(id: vec2u) {
    let point = textureLoad(point_in, id, 0);
    var doubt = 0.0;
    if point.w > 0.0 {
        let seen = textureLoad(seen_in, id, 0);
        atomicAdd(&mirrors, 1u);
        if seen.w > 0.0 {
            let is_found = seen.w >= FOUND;
            if is_found {
                atomicAdd(&found, 1u);
            } else {
                atomicAdd(&closed, 1u);
            }
            doubt = CLOSED;
            if is_found {
                doubt = select(select(0.0, ALONE, is_alone(id, point.xyz, seen.xyz)), OFF_ITS_RAY, is_off(id, point.xyz, seen.xyz));
            }
            if is_found && seen.w < PROVEN {
                doubt = UNPROVEN;
            }
        } else if knows_rest && is_unknown(hits[id.y * frame.width + id.x]) {
            doubt = UNPROVEN;
        }
        if doubt > 0.0 {
            atomicAdd(&doubted, 1u);
        }
    }
    if point.w > 0.0 || !is_further {
        textureStore(doubt_out, id, vec4f(doubt));
    }
}

fn is_off(id: vec2u, point: vec3f, seen: vec3f) -> bool {
    let direction = reflected(id);
    let step = direction_step(id, direction);
    let offset = seen - point;
    // A pixel without neighbours cannot be compared; one on the mirror point itself has no direction.
    return dot(offset, offset) == 0.0 || (step >= 0.0 && angle(normalize(offset), direction) > max(step, STEADY));
}

// Whether less than a third of the neighbours that found something are on the same surface.
fn is_alone(id: vec2u, point: vec3f, seen: vec3f) -> bool {
    let normal = textureLoad(seen_normal_in, id, 0).xyz;
    let most = OTHER_SURFACE * distance(seen, point);
    var found = 0u;
    var same = 0u;
    for (var i = 0u; i < 9u; i++) {
        let at = vec2i(id) + vec2i(i32(i % 3u) - 1, i32(i / 3u) - 1);
        if i == 4u || any(at < vec2i(0)) || u32(at.x) >= frame.width || u32(at.y) >= frame.height {
            continue;
        }
        let other = textureLoad(seen_in, vec2u(at), 0);
        if textureLoad(point_in, vec2u(at), 0).w == 0.0 || other.w == 0.0 {
            continue;
        }
        found++;
        let offset = other.xyz - seen;
        let off_plane = min(abs(dot(offset, normal)), abs(dot(offset, textureLoad(seen_normal_in, vec2u(at), 0).xyz)));
        same += u32(off_plane < most);
    }
    return 3u * same < found;
}
