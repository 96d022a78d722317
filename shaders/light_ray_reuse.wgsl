// Takes over the sums of rays of light from the frame before, for pictures while something moves: the light that arrives at a
// place is the same from every eye. Rays are added until a place has as many as at rest. One thread a pixel.
#import frame_group
#import gloss
#import kept_place
#import light_path

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// See kept_place.wgsl. clip.w: the most rays that are taken over.
@group(1) @binding(3) var<uniform> before: Frame;
// w: the number of rays.
@group(1) @binding(4) var<storage, read> kept: array<vec4u>;
// See light_ray_keep.wgsl.
@group(1) @binding(5) var<storage, read> kept_light: array<vec4f>;
@group(1) @binding(6) var<storage, read_write> paths: array<LightPath>;

@compute @workgroup_size(8, 8)
fn light_ray_reuse(@builtin(global_invocation_id) thread: vec3u) {
    let id = thread.xy;
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let position = textureLoad(position_in, id, 0);
    let normal = textureLoad(normal_in, id, 0);
    var path = LightPath();
    // Highlights depend on the eye.
    if position.w > 0.0 && gloss_of(settings, textureLoad(albedo_in, id, 0).a, normal.w).share == 0.0 {
        let pixel = kept_pixel(position.xyz, normal.xyz);
        if pixel != NOWHERE {
            let place = kept[pixel];
            let light = kept_light[pixel];
            path.count = min(f32(place.w), before.clip.w);
            path.diffuse = vec4f(light.rgb * path.count, 0.0);
            path.nearness = light.a * path.count;
            let apart = bitcast<vec3f>(place.xyz) - before.clip.xyz - position.xyz;
            let offset = clamp(apart / own_spacing(position.xyz), vec3f(-6e4), vec3f(6e4));
            path.offset = vec2u(pack2x16float(offset.xy), pack2x16float(vec2f(offset.z, 0.0)));
        }
    }
    paths[id.y * frame.width + id.x] = path;
}
