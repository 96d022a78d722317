// Lets photons land on what their rays meet after the first mirror, and mirrors reflect them. One thread a photon.
#import frame_group
#import brdf
#import photons

// Of what the ray meets. a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// w: 0 where the ray meets nothing.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the origin of the ray, w: 0 where there is none.
@group(1) @binding(3) var point_in: texture_2d<f32>;
// xyz: a place on the ray's line before its origin.
@group(1) @binding(4) var eye_in: texture_2d<f32>;
@group(1) @binding(5) var<storage, read_write> powers: array<vec4f>;
// Those of all photons after one mirror, then those after two, and so on.
@group(1) @binding(6) var<storage, read_write> landed: array<Landed>;
// The next ray, as `point_in` and `eye_in`.
@group(1) @binding(7) var point_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(8) var eye_out: texture_storage_2d<rgba32float, write>;

// The number of mirrors that have reflected the ray.
override mirrors: u32 = 0u;
// Set for the last ray.
override is_last: bool = true;
// See shade.wgsl.
override is_published: bool = false;

@compute @workgroup_size(8, 8)
fn photon_land(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let point = textureLoad(point_in, id.xy, 0);
    let position = textureLoad(position_in, id.xy, 0);
    let surface = textureLoad(normal_in, id.xy, 0).xyz;
    // What has no normal faces the light, and reflects none as a mirror.
    let is_met = point.w > 0.0 && position.w > 0.0;
    let direction = normalize(point.xyz - textureLoad(eye_in, id.xy, 0).xyz);
    let has_normal = dot(surface, surface) > 0.0;
    let normal = select(-direction, normalize(surface), has_normal);
    let albedo = textureLoad(albedo_in, id.xy, 0);
    let power = powers[pixel].rgb;
    if mirrors > 0u {
        let kept = select(0.0, 1.0, is_met);
        landed[(mirrors - 1u) * frame.width * frame.height + pixel] = Landed(
            vec4f(position.xyz, kept), vec4f(normal, 0.0), albedo, vec4f(power, 0.0), vec4f(direction, 0.0),
        );
    }
    var next = vec4f(0.0);
    if is_met && has_normal && !is_last && albedo.a > 0.0 {
        let grazing = grazing_share(settings, -dot(normal, direction), is_published);
        let reflected = mirror_tint(settings, albedo.rgb, grazing) * mirror_share(albedo.a, grazing, is_published);
        powers[pixel] = vec4f(power * reflected, 0.0);
        next = vec4f(position.xyz, 1.0);
        textureStore(eye_out, id.xy, vec4f(place_before(position.xyz, reflect(direction, normal)), 1.0));
    }
    textureStore(point_out, id.xy, next);
}
