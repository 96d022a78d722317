// High quality: the sums of splat_accumulate over their weights, into the G-buffer. One thread a pixel.
#import splat

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> settings: Settings;
@group(1) @binding(0) var<storage, read> nearest: array<vec2u>;
@group(1) @binding(1) var<storage, read> color_sums: array<vec4u>;
@group(1) @binding(2) var<storage, read> surface_sums: array<vec4u>;
@group(1) @binding(3) var<storage, read> specular_sums: array<vec2u>;
// rgb: linear albedo, a: specular intensity.
@group(1) @binding(4) var albedo_out: texture_storage_2d<rgba16float, write>;
// xyz: world normal towards the eye, w: specular power.
@group(1) @binding(5) var normal_out: texture_storage_2d<rgba32float, write>;
// Linear depth, world units; 0: empty.
@group(1) @binding(6) var depth_out: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn splat_average(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let color = color_sums[pixel];
    if nearest[pixel].y == 0u || color.x == 0u {
        textureStore(albedo_out, id.xy, vec4f(0.0));
        textureStore(normal_out, id.xy, vec4f(0.0));
        textureStore(depth_out, id.xy, vec4f(0.0));
        return;
    }
    let weight = f32(color.x);
    let surface = surface_sums[pixel];
    let specular = vec2f(specular_sums[pixel]) / weight;
    let front = depth_from_nearness(nearest[pixel].y);
    let depth = front * (1.0 + f32(surface.w) / weight / (4.0 * 65535.0));
    let sum = vec3f(bitcast<vec3i>(surface.xyz));
    let ray = view_from_pixel(frame, vec2f(id.xy) + 0.5, depth);
    // Where no point had a normal, or they cancelled, the surface is taken to face the eye.
    let facing = -world_direction(frame, select(normalize(ray), vec3f(0.0, 0.0, 1.0), frame.orthographic != 0u));
    let normal = select(facing, normalize(sum), dot(sum, sum) > weight * weight);
    textureStore(albedo_out, id.xy, vec4f(vec3f(color.yzw) / (weight * 4095.0), specular.x / 1023.0));
    textureStore(normal_out, id.xy, vec4f(normal, specular.y));
    textureStore(depth_out, id.xy, vec4f(depth));
}
