// Draws the ray that each pixel's surface sends out for indirect light: by the cosine about its normal, so that all rays
// count alike. A mirror reflects the ray that met it. One thread a pixel.
#import frame_group
#import brdf
#import gloss
#import vpl
#import light_path

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the origin of the ray before, w: 0 where there was none.
@group(1) @binding(3) var from_in: texture_2d<f32>;
@group(1) @binding(4) var<storage, read_write> paths: array<LightPath>;
// xyz: the origin of the ray, w: 0 where there is none.
@group(1) @binding(5) var point_out: texture_storage_2d<rgba32float, write>;
// xyz: a place on the ray's line before its origin, w: the distance to it.
@group(1) @binding(6) var eye_out: texture_storage_2d<rgba32float, write>;

// The number of the ray in its path.
override bounce: u32 = 0u;
override is_glossy: bool = false;
// Set if the first path of the frame goes on from what light_ray_reuse has found.
override reuses: bool = false;

@compute @workgroup_size(8, 8)
fn light_ray_draw(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let position = textureLoad(position_in, id.xy, 0);
    let surface = textureLoad(normal_in, id.xy, 0);
    let index = id.y * frame.width + id.x;
    let from_camera = bounce == 0u;
    var path = LightPath();
    if !from_camera || frame.sample > 0u || reuses {
        path = paths[index];
    }
    if from_camera {
        path.throughput = vec4f(1.0, 1.0, 1.0, 0.0);
        path.diffuse.w = 0.0;
        path.glossy.w = 0.0;
    }
    var is_alive = position.w > 0.0 && dot(surface.xyz, surface.xyz) > 0.0 && any(path.throughput.rgb > vec3f(0.0));
    if from_camera {
        is_alive = is_alive && path.count < f32(frame.samples);
    } else {
        is_alive = is_alive && textureLoad(from_in, id.xy, 0).w > 0.0;
    }
    var point = vec4f(0.0);
    var eye = vec4f(0.0);
    if is_alive {
        if from_camera {
            path.count += 1.0;
        }
        let normal = normalize(surface.xyz);
        var direction: vec3f;
        if path.glossy.w > 0.0 {
            direction = reflect(normalize(position.xyz - textureLoad(from_in, id.xy, 0).xyz), normal);
        } else {
            let numbers = path_numbers(id.xy, path.count, bounce);
            let turn = 6.2831853 * numbers.y;
            let tangent = tangent_of(normal);
            let sideways = tangent * cos(turn) + cross(normal, tangent) * sin(turn);
            direction = normalize(normal * sqrt(1.0 - numbers.x) + sideways * sqrt(numbers.x));
            path.diffuse.w += 1.0;
        }
        let before = max(length(position.xyz), 1e-6 * frame.scene_radius);
        point = vec4f(position.xyz, 1.0);
        eye = vec4f(position.xyz - direction * before, before);
        if is_glossy && from_camera {
            let gloss = gloss_of(settings, textureLoad(albedo_in, id.xy, 0).a, surface.w);
            if gloss.share > 0.0 {
                let toward_eye = toward_viewer(frame, position.xyz, true, vec3f(0.0));
                let shape = highlight(settings.light.highlight, normal, direction, toward_eye, gloss.power);
                path.throughput.w = 3.14159265 * gloss.share * shape;
            }
        }
    }
    textureStore(point_out, id.xy, point);
    textureStore(eye_out, id.xy, eye);
    paths[index] = path;
}
