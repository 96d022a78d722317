// Imperfect shadow maps (Ritschel et al. 2008): each virtual light's subset of the points, as discs, into its map of distances.
// A disc covers the texels whose middle looks through it, and is as far there as its plane: points that cover less than a
// texel do not grow to one, and the surface that a light stands on does not rise into its sky. As published, points are
// squares instead: at least a texel wide, and as far everywhere as the point.
// One thread a point and light.
#import frame_group
#import finite
#import vpl

@group(1) @binding(0) var<uniform> lights: Virtual;
// xyz: bits of the position.
@group(1) @binding(1) var<storage, read> chosen: array<vec4u>;
// Two a point, see vpl_points.wgsl.
@group(1) @binding(2) var<storage, read> surfaces: array<vec4f>;
@group(1) @binding(3) var<storage, read> vpls: array<Vpl>;
@group(1) @binding(4) var<storage, read_write> shadow_maps: array<atomic<u32>>;
@group(1) @binding(5) var<uniform> work: Step;

@compute @workgroup_size(64)
fn vpl_shadow_splat(@builtin(global_invocation_id) id: vec3u) {
    let v = work.first_light + id.y;
    let light = vpls[v];
    let slot = id.x;
    let p = slot * lights.subsets + v % lights.subsets;
    if light.normal.w == VPL_NONE || p >= lights.point_count || slot > 0xffffu {
        return;
    }
    let surface = surfaces[p * OCCLUDER_VECTORS];
    if surface.w == 0.0 {
        return;
    }
    let center = bitcast<vec3f>(chosen[p].xyz);
    let radius = lights.disc_radius;
    let at = point_in_map(lights, light, center);
    let is_square = settings.gi.occluders == GI_OCCLUDERS_SQUARES;
    if light.normal.w == VPL_LOCAL {
        let offset = center - light.position.xyz;
        // Behind the light; or of the surface that it stands on, whose noise would shut it in.
        let is_alike = abs(dot(surface.xyz, light.normal.xyz)) > 0.5 || all(surface.xyz == vec3f(0.0));
        let is_same = at.distance < 2.0 * radius && is_alike;
        let least = select(-radius, 0.0, is_square);
        if dot(light.normal.xyz, offset) < least || is_same {
            return;
        }
    }
    let size = f32(lights.map_size);
    let middle = (at.map * 0.5 + 0.5) * size;
    var reach = radius * at.scale * 0.5 * size;
    if light.normal.w == VPL_LOCAL && at.distance < 2.0 * radius {
        // By the angle under which a ball is seen about the disc, since a radian is at most one unit of the map.
        // From inside of the ball, the disc is all around.
        reach = select(asin(radius / at.distance) * 0.5, 2.0, at.distance <= radius) * size;
    }
    reach = select(reach, max(reach, 0.5), is_square);
    let first = vec2i(max(ceil(middle - reach - 0.5), vec2f(0.0)));
    let last = vec2i(min(floor(middle + reach - 0.5), vec2f(size - 1.0)));
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            let texel = v * lights.map_stride + u32(y) * lights.map_size + u32(x);
            if is_square {
                atomicMax(&shadow_maps[texel], code_of_distance(lights, light.normal.w, at.distance) << 16u | slot);
                continue;
            }
            let map = (vec2f(vec2i(x, y)) + 0.5) / size * 2.0 - 1.0;
            let ray = ray_of_map(lights, light, map);
            let offset = center - ray.origin;
            // Points without a normal face the light.
            let normal = select(surface.xyz, at.direction, all(surface.xyz == vec3f(0.0)));
            let distance = dot(normal, offset) / dot(normal, ray.direction);
            let beside = ray.direction * distance - offset;
            // A plane through the light is not drawn. What lies beyond the scene under a light of the sky is as near as
            // the map's border.
            let is_before = distance > 0.0 || light.normal.w == VPL_SKY;
            if is_finite(distance) && is_before && dot(beside, beside) <= radius * radius {
                let code = code_of_distance(lights, light.normal.w, distance);
                atomicMax(&shadow_maps[texel], code << 16u | slot);
            }
        }
    }
}
