// The Mirror G-Buffer from the point that each mirror pixel's ray meets. Runs once for each page of the point store and
// takes the pixels whose point lies in it; the first page also writes the pixels that see nothing, and those whose
// point is on no page: maps that lag may hold points that are hidden. One thread a pixel.
#import point_surface
#import mirror_ray
#import hit

@group(2) @binding(0) var point_in: texture_2d<f32>;
@group(2) @binding(1) var normal_in: texture_2d<f32>;
@group(2) @binding(2) var eye_in: texture_2d<f32>;
// See hit.wgsl.
@group(2) @binding(3) var<storage, read> hits: array<vec4u>;
@group(2) @binding(4) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(2) @binding(5) var normal_out: texture_storage_2d<rgba32float, write>;
// xyz: position relative to the eye, w: coverage, 0 where nothing was found.
@group(2) @binding(6) var position_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn gather_resolve(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    // Nothing reads the Mirror G-Buffer where there is no mirror.
    if id.x >= frame.width || id.y >= frame.height || textureLoad(point_in, id, 0).w == 0.0 {
        return;
    }
    var albedo = vec4f(0.0);
    var normal = vec4f(0.0);
    var position = vec4f(0.0);
    let point = textureLoad(point_in, id, 0);
    let hit = hits[id.y * frame.width + id.x];
    // Of a ray that ends in the camera's picture, the surface is already there.
    let is_point = !is_in_picture(hit);
    var is_ours = page.is_first == 1u && is_point;
    if hit.y != 0u && is_point {
        let index = index_of_identity(hit.y - 1u);
        if index < page.point_count {
            is_ours = true;
            let seen_from = textureLoad(eye_in, id, 0).xyz;
            let direction = reflected_direction(point.xyz, textureLoad(normal_in, id, 0).xyz, seen_from);
            let surface = surface_of_point(index, -direction);
            albedo = surface.albedo;
            normal = surface.normal;
            let along = bitcast<f32>(hit.z);
            position = vec4f(point.xyz + direction * along, coverage_of(hit));
            if along < 0.0 {
                position = vec4f(place_beside(index, point.xyz, direction), 0.75);
            }
        }
    }
    if is_ours {
        textureStore(albedo_out, id, albedo);
        textureStore(normal_out, id, normal);
        textureStore(position_out, id, position);
    }
}

// About the place of a point's disc that is nearest to a ray.
fn place_beside(index: u32, origin: vec3f, direction: vec3f) -> vec3f {
    let item = item_of_point(index);
    let point = points[index];
    let center = bitcast<vec3f>(point.xyz) + item.origin_radius.xyz;
    let own_radius = unpack_radius(point.w & 0xffffu);
    let radius = select(own_radius, item.origin_radius.w, own_radius == 0.0) * settings.splat.size;
    let normal = unpack_normal(attributes[index].y);
    let offset = origin + direction * max(dot(center - origin, direction), 0.0) - center;
    let in_plane = offset - normal * dot(normal, offset);
    return center + in_plane * min(1.0, radius / max(length(in_plane), 1e-30));
}
