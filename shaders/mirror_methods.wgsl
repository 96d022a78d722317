// Which of a frame's methods finds what each mirror pixel shows: that of the mirror that the camera sees. One thread a
// pixel.
#import frame_group
#import mirror_formula

// xyz: relative to the eye, w: coverage.
@group(1) @binding(0) var position_in: texture_2d<f32>;
// x: identity of the pixel's nearest point. y: nearness, 0: empty.
@group(1) @binding(1) var<storage, read> nearest: array<vec2u>;
// The identities of mirrors' points: the first, the one beyond the last, the number of the method.
@group(1) @binding(2) var<storage, read> runs: array<vec4u>;
@group(1) @binding(3) var<storage, read> mirrors: array<FormulaMirror>;
@group(1) @binding(4) var method_out: texture_storage_2d<r32float, write>;

// The method of mirror pixels of which no mirror is known.
override usual: u32 = 0u;

const UNKNOWN: u32 = 0xffffffffu;

@compute @workgroup_size(8, 8)
fn mirror_methods(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, whole_thread(frame, thread));
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    var method = method_of_formula(textureLoad(position_in, id, 0).xyz);
    // The nearest point of a pixel may be no mirror's, and pixels that are closed have none.
    for (var i = 0; i < 25 && method == UNKNOWN; i++) {
        let at = vec2u(clamp(vec2i(id) + nth_step(i), vec2i(0), vec2i(i32(frame.width), i32(frame.height)) - 1));
        let key = nearest[at.y * frame.width + at.x];
        if key.y != 0u {
            method = method_of_point(key.x);
        }
    }
    textureStore(method_out, id, vec4f(f32(select(method, usual, method == UNKNOWN))));
}

// The method of the mirror that is drawn by its formula and on which a place lies.
fn method_of_formula(place: vec3f) -> u32 {
    var method = UNKNOWN;
    var nearest_off = 3e38;
    for (var i = 0u; i < arrayLength(&mirrors); i++) {
        let mirror = mirrors[i];
        let off = abs(value_at(mirror, place));
        let is_near = distance(place, mirror.position_reach.xyz) <= mirror.position_reach.w;
        if is_near && off < LEAVE && off * mirror.z_size.w < nearest_off {
            nearest_off = off * mirror.z_size.w;
            method = mirror.part;
        }
    }
    return method;
}

fn method_of_point(identity: u32) -> u32 {
    var method = UNKNOWN;
    for (var i = 0u; i < arrayLength(&runs); i++) {
        let run = runs[i];
        method = select(method, run.z, identity >= run.x && identity < run.y);
    }
    return method;
}
