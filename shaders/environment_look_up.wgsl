// The Mirror G-Buffer from environment maps: each mirror pixel looks its reflected direction up in the map of its
// mirror. Runs once for each page of the point store and takes the pixels whose point lies in it; the first page also
// writes the pixels that see nothing. One thread a pixel.
#import mirror_places
#import point_surface
#import mirror_ray
#import hit

@group(2) @binding(0) var point_in: texture_2d<f32>;
@group(2) @binding(1) var normal_in: texture_2d<f32>;
@group(2) @binding(2) var eye_in: texture_2d<f32>;
// x: identity of the texel's nearest point. y: nearness, 0: empty.
@group(2) @binding(3) var<storage, read> maps: array<vec2u>;
@group(2) @binding(4) var<storage, read> mirrors: MappedMirrors;
// See hit.wgsl.
@group(2) @binding(5) var<storage, read> hits: array<vec4u>;
@group(2) @binding(6) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(2) @binding(7) var normal_out: texture_storage_2d<rgba32float, write>;
// xyz: position relative to the eye, w: coverage, 0 where nothing was found.
@group(2) @binding(8) var position_out: texture_storage_2d<rgba32float, write>;
// A look-up takes no steps.
@group(2) @binding(9) var views_out: texture_storage_2d<rgba32float, write>;

// Set for the rest of another method: the rays of which it knows nothing. What they show is not proven.
override only_rest: bool = false;

@compute @workgroup_size(8, 8)
fn environment_look_up(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height || textureLoad(point_in, id, 0).w == 0.0 {
        return;
    }
    if only_rest && !is_unknown(hits[id.y * frame.width + id.x]) {
        return;
    }
    let point = textureLoad(point_in, id, 0).xyz;
    let reflected = reflected_direction(point, textureLoad(normal_in, id, 0).xyz, textureLoad(eye_in, id, 0).xyz);
    let mirror = mirror_at(point);
    let center = mirror.view.xyz;
    let direction = looked_up(point, reflected, center);
    var key = vec2u(0u);
    if mirror.low_map.w >= 0.0 {
        key = maps[texel_of_direction(u32(mirror.low_map.w), u32(mirror.view.w), direction)];
    }
    var albedo = vec4f(0.0);
    var normal = vec4f(0.0);
    var position = vec4f(0.0);
    var is_ours = page.is_first == 1u;
    if key.y != 0u {
        let index = index_of_identity(key.x);
        is_ours = index < page.point_count;
        if is_ours {
            let depth = depth_from_nearness(key.y);
            // The ray at linear depth 1, as the face sees it.
            let along = direction / largest_part(direction);
            let width = 2.0 * depth / mirror.view.w;
            let place = center + along * distance_to_point(index, center, along, depth, width);
            position = vec4f(place, select(1.0, 0.75, only_rest));
            let surface = surface_of_point(index, normalize(point - position.xyz));
            albedo = surface.albedo;
            normal = surface.normal;
        }
    }
    if is_ours {
        textureStore(albedo_out, id, albedo);
        textureStore(normal_out, id, normal);
        textureStore(position_out, id, position);
        if !only_rest {
            textureStore(views_out, id, vec4f(0.0));
        }
    }
}

// The direction to look up in a map: the reflected one, or that from the map's middle to the place where the reflected
// ray leaves the scene's box.
fn looked_up(point: vec3f, reflected: vec3f, center: vec3f) -> vec3f {
    if settings.environment_map.proxy != ENVIRONMENT_MAP_PROXY_BOX {
        return reflected;
    }
    let inverse = 1.0 / reflected;
    let exits = max((mirrors.scene_low.xyz - point) * inverse, (mirrors.scene_high.xyz - point) * inverse);
    let exit = min(exits.x, min(exits.y, exits.z));
    // A mirror that is drawn by its formula may be outside the box of the points.
    return select(reflected, point + reflected * exit - center, exit > 0.0);
}

fn largest_part(direction: vec3f) -> f32 {
    let parts = abs(direction);
    return max(parts.x, max(parts.y, parts.z));
}

// The place of a direction in a map, as seen by face_camera of crates/render/src/reflection/environment_map.rs.
// Its faces have `size` texels along each edge.
fn texel_of_direction(map: u32, size: u32, direction: vec3f) -> u32 {
    let parts = abs(direction);
    // The component along the face's axis, then those to its right and up.
    var turned = direction;
    var axis = 0u;
    if parts.y > parts.x && parts.y >= parts.z {
        turned = direction.yzx;
        axis = 1u;
    } else if parts.z > parts.x {
        turned = direction.zxy;
        axis = 2u;
    }
    let face = map * 6u + axis + select(0u, 3u, turned.x < 0.0);
    let slope = turned.yz / abs(turned.x);
    let pixel = (vec2f(slope.x, -slope.y) + 1.0) * 0.5 * f32(size);
    let texel = vec2u(clamp(pixel, vec2f(0.0), vec2f(f32(size) - 0.5)));
    // Faces start at multiples of 32 texels.
    let face_texels = (size * size + 31u) / 32u * 32u;
    return face * face_texels + texel.y * size + texel.x;
}
