// Nearest quality: the G-buffer from the identity of each pixel's nearest point. Runs once for each page of the point store
// and takes the pixels whose point lies in it; the first page also writes the empty pixels. One thread a pixel.
#import point_surface

@group(2) @binding(0) var<storage, read> nearest: array<vec2u>;
// rgb: linear albedo, a: specular intensity.
@group(2) @binding(1) var albedo_out: texture_storage_2d<rgba16float, write>;
// xyz: world normal towards the eye, w: specular power.
@group(2) @binding(2) var normal_out: texture_storage_2d<rgba32float, write>;
// The linear depth in world units; 0 if empty.
@group(2) @binding(3) var depth_out: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn splat_resolve(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let key = nearest[id.y * frame.width + id.x];
    var albedo = vec4f(0.0);
    var normal = vec4f(0.0);
    var depth = 0.0;
    var is_ours = page.is_first == 1u;
    if key.y != 0u {
        let index = index_of_identity(key.x);
        is_ours = index < page.point_count;
        if is_ours {
            depth = depth_from_nearness(key.y);
            let ray = view_from_pixel(frame, vec2f(id.xy) + 0.5, depth);
            let toward_eye = -world_direction(frame, select(normalize(ray), vec3f(0.0, 0.0, 1.0), frame.orthographic != 0u));
            let surface = surface_of_point(index, toward_eye);
            albedo = surface.albedo;
            normal = surface.normal;
        }
    }
    // One place to write from: on software rasterisers each store costs whether or not it is taken.
    if is_ours {
        textureStore(albedo_out, id.xy, albedo);
        textureStore(normal_out, id.xy, normal);
        textureStore(depth_out, id.xy, vec4f(depth));
    }
}
