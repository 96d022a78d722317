// Lets each virtual light give what it reflects, no more and no less: squares and discs of lights reach over the edges
// of walls, and what lies beyond is lost. The light's own shadow map holds what it shines on. The pass sums what the
// light gives there as a surface and as a point, which loses nothing, and keeps the quotient. One workgroup a virtual
// light.
#import frame_group
#import vpl
#import vpl_transfer

@group(1) @binding(0) var<uniform> lights: Virtual;
@group(1) @binding(1) var<storage, read> shadow_maps: array<u32>;
// Two a point, see vpl_points.wgsl.
@group(1) @binding(2) var<storage, read> surfaces: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> vpls: array<Vpl>;
@group(1) @binding(4) var<uniform> work: Step;

// The most that a surface gives to a place, as a multiple of what a point gives: it has no bound where light grazes.
const MOST_SHARE: f32 = 16.0;

// Discs whose normal differs less from a right angle to the ray, as a cosine, are seen edge on, and get nothing.
const EDGE_ON: f32 = 1e-4;

// x: as a point, y: as a surface.
var<workgroup> given: array<vec2f, 64>;

@compute @workgroup_size(64)
fn vpl_balance(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let v = work.first_light + group.x;
    let light = vpls[v];
    // Of larger maps, as many texels as 64 x 64 have.
    let step = (lights.map_size + 63u) / 64u;
    let size = lights.map_size / step;
    var sum = vec2f(0.0);
    for (var i = thread; i < size * size; i += 64u) {
        let texel = vec2u(i % size, i / size) * step + step / 2u;
        let map = (vec2f(texel) + 0.5) / f32(lights.map_size) * 2.0 - 1.0;
        if dot(map, map) >= 1.0 {
            continue;
        }
        let ray = ray_of_map(lights, light, map);
        // Texels near the rim see a smaller solid angle.
        let widening = 1.0 + dot(map, map);
        let cosine_there = dot(light.normal.xyz, ray.direction);
        let as_point = cosine_there / (widening * widening);
        let code = shadow_maps[v * lights.map_stride + texel.y * lights.map_size + texel.x];
        var share = 1.0;
        if code != 0u {
            let point = (code & 0xffffu) * lights.subsets + v % lights.subsets;
            let surface = surfaces[point * OCCLUDER_VECTORS].xyz;
            let cosine = dot(surface, ray.direction);
            // Points without a normal face the light, and so does one side of each disc.
            let normal = select(surface * select(1.0, -1.0, cosine > 0.0), -ray.direction, all(surface == vec3f(0.0)));
            if abs(dot(normal, ray.direction)) < EDGE_ON {
                continue;
            }
            let distance = distance_of_code(lights, light.normal.w, code >> 16u);
            let point_transfer = -dot(normal, ray.direction) * cosine_there / (distance * distance);
            let transfer = transfer_of_light(light, -ray.direction * distance, normal);
            share = min(transfer / max(point_transfer, 1e-30), MOST_SHARE);
        }
        sum += as_point * vec2f(1.0, share);
    }
    given[thread] = sum;
    workgroupBarrier();
    if thread != 0u || light.normal.w != VPL_LOCAL {
        return;
    }
    for (var other = 1u; other < 64u; other++) {
        sum += given[other];
    }
    vpls[v].tangent.w = clamp(sum.x / max(sum.y, 1e-30), 0.5, 2.0);
}
