// The Mirror G-Buffer of the rays that end on a pixel of the camera's picture: its colour and normal, at the place on the
// ray. One thread a pixel.
#import frame_group
#import hit
#import mirror_ray

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> hits: array<vec4u>;
// The camera's surface.
@group(1) @binding(4) var picture_albedo_in: texture_2d<f32>;
@group(1) @binding(5) var picture_normal_in: texture_2d<f32>;
@group(1) @binding(6) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(7) var normal_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(8) var position_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn screen_resolve(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    let hit = hits[id.y * frame.width + id.x];
    if point.w == 0.0 || !is_in_picture(hit) {
        return;
    }
    let seen = vec2u((hit.y - 1u) % frame.width, (hit.y - 1u) / frame.width);
    let direction =
        reflected_direction(point.xyz, textureLoad(normal_in, id, 0).xyz, textureLoad(eye_in, id, 0).xyz);
    let normal = textureLoad(picture_normal_in, seen, 0);
    let outward = select(normal.xyz, -normal.xyz, dot(normal.xyz, direction) > 0.0);
    textureStore(albedo_out, id, textureLoad(picture_albedo_in, seen, 0));
    textureStore(normal_out, id, vec4f(outward, normal.w));
    textureStore(position_out, id, vec4f(point.xyz + direction * bitcast<f32>(hit.z), coverage_of(hit)));
}
