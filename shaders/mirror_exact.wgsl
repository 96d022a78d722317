// Draws mirrors by their formulas into the camera's G-buffer: a ray a pixel, where a mirror may be seen. One thread a
// pixel.
#import frame_group
#import mirror_formula

// The surface without these mirrors; the images that are written hold it as well.
@group(1) @binding(0) var depth_in: texture_2d<f32>;
@group(1) @binding(1) var<storage, read> mirrors: array<FormulaMirror>;
@group(1) @binding(2) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(3) var normal_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(4) var depth_out: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn mirror_exact(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, whole_thread(frame, thread));
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    var albedo = vec4f(0.0);
    var normal = vec4f(0.0);
    var depth = textureLoad(depth_in, id, 0).x;
    var is_hit = false;
    let is_parallel = frame.orthographic != 0u;
    let through = view_from_pixel(frame, vec2f(id) + 0.5, select(1.0, 0.0, is_parallel));
    let origin = select(vec3f(0.0), world_direction(frame, through), is_parallel);
    let direction = select(normalize(world_direction(frame, through)), frame.forward.xyz, is_parallel);
    let depth_of_unit = dot(direction, frame.forward.xyz);
    for (var i = 0u; i < arrayLength(&mirrors); i++) {
        let mirror = mirrors[i];
        let hit = formula_hit(mirror, origin, direction, frame.near);
        let hit_depth = hit.distance * depth_of_unit;
        if hit.distance > 0.0 && hit_depth > frame.near && (depth == 0.0 || hit_depth < depth) {
            albedo = mirror.color_intensity;
            normal = vec4f(select(hit.normal, -hit.normal, dot(hit.normal, direction) > 0.0), mirror.specular_power);
            depth = hit_depth;
            is_hit = true;
        }
    }
    if is_hit {
        textureStore(albedo_out, id, albedo);
        textureStore(normal_out, id, normal);
        textureStore(depth_out, id, vec4f(depth));
    }
}
