// Adds the light that the rays of light_ray_draw.wgsl meet to that of their paths, and lets the paths go on; behind the last
// ray of a path writes the mean over all paths so far. One thread a pixel.
#import frame_group
#import brdf
#import gloss
#import light_path

// Of the surface that the ray meets. a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// w: 0 where the ray meets nothing.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the origin of the ray, w: 0 where there is none.
@group(1) @binding(3) var point_in: texture_2d<f32>;
// xyz: a place on the ray's line before its origin.
@group(1) @binding(4) var eye_in: texture_2d<f32>;
// The radiance of what the ray meets, toward its origin.
@group(1) @binding(5) var direct_in: texture_2d<f32>;
@group(1) @binding(6) var indirect_in: texture_2d<f32>;
@group(1) @binding(7) var<storage, read_write> paths: array<LightPath>;
// rgb: irradiance over pi, a: the mean of one over the lengths of the first rays, in radii of the scene.
@group(1) @binding(8) var diffuse_out: texture_storage_2d<rgba16float, write>;
// Radiance of highlights, before the tint.
@group(1) @binding(9) var glossy_out: texture_storage_2d<rgba16float, write>;

// Set if light is reflected between surfaces; else there is that of the sky alone.
override is_lit: bool = true;
// Set if there is indirect light on what is met.
override has_indirect: bool = false;
// Set for the last ray of all paths.
override is_last: bool = true;
// The number of the ray in its path.
override bounce: u32 = 0u;
// The most rays of a path that are drawn by the cosine.
override ray_bounces: u32 = 1u;
override has_sky: bool = false;
override is_glossy: bool = false;
// Set if the reflections of mirrors are followed: a mirror's own light is then its diffuse part alone.
override is_mixed: bool = false;
// See shade.wgsl.
override is_published: bool = false;

// The first dimension by which chance chooses what a mirror does.
const MIRRORED: u32 = 64u;

@compute @workgroup_size(8, 8)
fn light_ray_sum(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let index = id.y * frame.width + id.x;
    var path = paths[index];
    let point = textureLoad(point_in, id.xy, 0);
    if point.w > 0.0 {
        let direction = normalize(point.xyz - textureLoad(eye_in, id.xy, 0).xyz);
        let met = textureLoad(position_in, id.xy, 0);
        let is_met = met.w > 0.0;
        if bounce == 0u && is_met {
            path.nearness += frame.scene_radius / max(distance(met.xyz, point.xyz), 1e-30);
        }
        let is_drawn_out = path.diffuse.w >= f32(ray_bounces);
        var light = vec3f(0.0);
        if is_met && is_lit {
            light = textureLoad(direct_in, id.xy, 0).rgb;
            if has_indirect && is_drawn_out {
                light += textureLoad(indirect_in, id.xy, 0).rgb;
            }
        } else if !is_met && has_sky && dot(direction, frame.world_up.xyz) > 0.0 {
            light = vec3f(settings.sun.sky / 3.14159265);
        }
        let arriving = path.throughput.rgb * light;
        path.diffuse += vec4f(arriving, 0.0);
        path.glossy += vec4f(arriving * path.throughput.w, 0.0);
        if !is_last {
            let albedo = textureLoad(albedo_in, id.xy, 0);
            let normal = textureLoad(normal_in, id.xy, 0);
            let grazing = grazing_share(settings, -dot(normal.xyz, direction), is_published);
            let reflected = select(0.0, mirror_share(albedo.a, grazing, is_published), albedo.a > 0.0 && is_mixed);
            // Behind the last ray that the cosine may draw, only mirrors go on; else chance chooses between both.
            let chance = select(reflected, 1.0, is_drawn_out && reflected > 0.0);
            var onward = vec3f(0.0);
            let is_mirrored = path_numbers(id.xy, path.count, MIRRORED + bounce).x < chance;
            if is_mirrored {
                onward = mirror_tint(settings, albedo.rgb, grazing) * reflected / chance;
            } else if !is_drawn_out {
                let matt = select(1.0 - gloss_of(settings, albedo.a, normal.w).share, 1.0 - reflected, albedo.a > 0.0);
                onward = albedo.rgb * settings.light.diffuse * matt / (1.0 - chance);
            }
            path.throughput = vec4f(select(vec3f(0.0), path.throughput.rgb * onward, is_met), path.throughput.w);
            path.glossy.w = select(0.0, 1.0, is_mirrored);
        }
    }
    paths[index] = path;
    if is_last {
        let count = max(path.count, 1.0);
        textureStore(diffuse_out, id.xy, vec4f(path.diffuse.rgb, min(path.nearness, 6e4 * count)) / count);
        if is_glossy {
            textureStore(glossy_out, id.xy, vec4f(path.glossy.rgb / count, 1.0));
        }
    }
}
