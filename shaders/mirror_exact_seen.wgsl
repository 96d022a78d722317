// Puts mirrors with a formula into the Mirror G-Buffer where a reflected ray meets one before it meets a point. One thread a
// pixel.
#import frame_group
#import mirror_formula
#import mirror_ray

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var mirror_normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> mirrors: array<FormulaMirror>;
@group(1) @binding(4) var albedo_in: texture_2d<f32>;
@group(1) @binding(5) var normal_in: texture_2d<f32>;
// w: coverage.
@group(1) @binding(6) var position_in: texture_2d<f32>;
@group(1) @binding(7) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(8) var normal_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(9) var position_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn mirror_exact_seen(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, whole_thread(frame, thread));
    if id.x >= frame.width || id.y >= frame.height || textureLoad(point_in, id, 0).w == 0.0 {
        return;
    }
    var albedo = textureLoad(albedo_in, id, 0);
    var normal = textureLoad(normal_in, id, 0);
    var position = textureLoad(position_in, id, 0);
    let point = textureLoad(point_in, id, 0).xyz;
    let ray = mirror_ray(point, textureLoad(mirror_normal_in, id, 0).xyz, textureLoad(eye_in, id, 0).xyz);
    var nearest = select(3e38, distance(position.xyz, point), position.w > 0.0);
    for (var i = 0u; i < arrayLength(&mirrors); i++) {
        let mirror = mirrors[i];
        let hit = formula_hit(mirror, point, ray.direction, leave(mirror, point));
        if hit.distance > 0.0 && hit.distance < nearest {
            nearest = hit.distance;
            albedo = mirror.color_intensity;
            normal = vec4f(select(hit.normal, -hit.normal, dot(hit.normal, ray.direction) > 0.0), mirror.specular_power);
            position = vec4f(point + ray.direction * hit.distance, 1.0);
        }
    }
    textureStore(albedo_out, id, albedo);
    textureStore(normal_out, id, normal);
    textureStore(position_out, id, position);
}
