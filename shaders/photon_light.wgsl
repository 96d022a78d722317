// The irradiance of light that mirrors throw onto a surface, seen by the camera or in a mirror: of photons in grids of cells,
// which crates/render/src/caustics/grid.rs fills, with the CPU twin. One thread a pixel.
//
// Photons are wide against pixels where they lie apart. So each workgroup finds their light at the nodes of a lattice within
// its tile, and pixels of the camera take that of the grids whose photons are wide against the lattice from the nodes about
// them. Each pixel walks the other grids by itself, and all of them in mirrors, which mostly show their surroundings small.
#import frame_group

// xyz: relative to the eye, w: coverage.
@group(1) @binding(0) var position_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// w: 0 where there is no mirror that sees the surface.
@group(1) @binding(2) var from_in: texture_2d<f32>;
// The first two elements describe the grids: the photons' origin relative to the eye, and the edge of the cells of the first
// grid, which is the largest radius of its photons and halves from each grid to the next; then the number of lists of a grid,
// and that of grids up to the finest that lists photons. Four follow for each photon: its position relative to the origin and
// the squared radius over which it spreads its light; the unit normal of the surface where it has landed, and the distance of
// the line where its surface ends, which is twice the radius if there is none; the irradiance amid its light; and the unit
// vector from the photon to the line.
@group(1) @binding(3) var<storage, read> photons: array<vec4f>;
// Where each list of each grid begins, the end of the last one, and then all lists: indices of photons.
@group(1) @binding(4) var<storage, read> cells: array<u32>;
@group(1) @binding(5) var irradiance_out: texture_storage_2d<rgba16float, write>;

override from_camera: bool = true;

const GRID_VECTORS: u32 = 2u;
const PHOTON_VECTORS: u32 = 4u;

// The least cosine between the normals of a place and of where a photon has landed that counts there: light passes
// neither through a wall nor around a corner.
const SAME_SIDE: f32 = 0.5;

// Discs of points go on beyond the line where their surface ends: up to this share of its radius a photon shines there.
const OVER_END: f32 = 0.2;

// The pixels from a node of the lattice to the next one, and the nodes within a tile of 8 x 8 pixels and along its ends.
const STEP: u32 = 4u;
const NODES: u32 = 9u;
// The grids whose light the nodes have: all of eight but the finest, so that each thread of a workgroup walks one list.
const NODE_LEVELS: u32 = 7u;

// Photons are wide if their radii are at least this many times as long as the way across a square of the lattice.
const WIDE: f32 = 1.4;

// A pixel is on the surface of a node if the cosine between their normals is larger.
const SAME_FACE: f32 = 0.9;

// A pixel that lies off the place amid the nodes counts as if the lattice were as coarse as this many times that distance.
const OFF_PLANE: f32 = 8.0;

// xyz: relative to the eye, w: 0 where there is no surface.
var<workgroup> node_places: array<vec4f, NODES>;
var<workgroup> node_normals: array<vec3f, NODES>;
// The irradiance by the photons of a grid, of all nodes one grid after the other; then that of all grids so far.
var<workgroup> node_light: array<vec3f, NODES * NODE_LEVELS>;

// The irradiance at a place relative to the photons' origin by those of a grid: the light of the photons about it, each
// weighed by the square of one minus the squared distance over that of its radius. What would lie beyond the line where the
// photon's surface ends is folded back.
fn light_of_grid(level: u32, place: vec3f, normal: vec3f) -> vec3f {
    let lists = u32(photons[1].x);
    let cell_place = clamp(floor(place / (edge_of(level))), vec3f(-1e9), vec3f(1e9));
    let cell = bitcast<vec3u>(vec3i(cell_place)) * vec3u(73856093u, 19349663u, 83492791u);
    let list = level * lists + ((cell.x ^ cell.y ^ cell.z) & (lists - 1u));
    let end = cells[list + 1u];
    var sum = vec3f(0.0);
    for (var i = cells[list]; i < end; i++) {
        let at = GRID_VECTORS + cells[i] * PHOTON_VECTORS;
        let middle = photons[at];
        let offset = place - middle.xyz;
        let weight = 1.0 - dot(offset, offset) / middle.w;
        if weight > 0.0 {
            let side = photons[at + 1u];
            var share = select(0.0, weight * weight, dot(side.xyz, normal) > SAME_SIDE);
            if side.w * side.w < middle.w {
                let before = side.w - dot(offset, photons[at + 3u].xyz);
                let is_before = before >= 0.0 || before * before < OVER_END * OVER_END * middle.w;
                let folded = max(weight - 4.0 * side.w * max(before, 0.0) / middle.w, 0.0);
                share = select(0.0, share + folded * folded, share > 0.0 && is_before);
            }
            sum += photons[at + 2u].rgb * share;
        }
    }
    return sum;
}

// The edge of the cells of a grid.
fn edge_of(level: u32) -> f32 {
    return photons[0].w / f32(1u << level);
}

@compute @workgroup_size(8, 8)
fn photon_light(
    @builtin(global_invocation_id) invocation: vec3u,
    @builtin(local_invocation_id) local: vec3u,
    @builtin(local_invocation_index) index: u32,
) {
    let thread = whole_thread(frame, invocation);
    var id = thread.xy;
    if !from_camera {
        id = mirror_pixel(frame, thread);
    }
    let grids = u32(photons[1].y);
    let last = vec2u(frame.width, frame.height) - 1u;
    let first = id - local.xy;
    if from_camera && index < NODES * NODE_LEVELS {
        let node = index % NODES;
        let level = index / NODES;
        let pixel = min(first + STEP * vec2u(node % 3u, node / 3u), last);
        let position = textureLoad(position_in, pixel, 0);
        let normal = textureLoad(normal_in, pixel, 0).xyz;
        if level == 0u {
            node_places[node] = position;
            node_normals[node] = normal;
        }
        node_light[index] = vec3f(0.0);
        if position.w > 0.0 && level < grids {
            node_light[index] = light_of_grid(level, position.xyz - photons[0].xyz, normal);
        }
    }
    workgroupBarrier();
    if from_camera && index < NODES {
        for (var i = index + NODES; i < NODES * NODE_LEVELS; i += NODES) {
            node_light[i] += node_light[i - NODES];
        }
    }
    workgroupBarrier();
    if any(id > last) || (!from_camera && textureLoad(from_in, id, 0).w == 0.0) {
        return;
    }
    let position = textureLoad(position_in, id, 0);
    if position.w == 0.0 {
        return;
    }
    let normal = textureLoad(normal_in, id, 0).xyz;
    let square = local.xy / STEP;
    let low = first + STEP * square;
    let along = vec2f(id - low) / vec2f(max(min(low + STEP, last) - low, vec2u(1u)));
    let corner = square.y * 3u + square.x;
    var is_smooth = from_camera;
    var middle = vec3f(0.0);
    for (var k = 0u; k < 4u; k++) {
        let node = corner + k % 2u + 3u * (k / 2u);
        is_smooth = is_smooth && node_places[node].w > 0.0 && dot(node_normals[node], normal) > SAME_FACE;
        middle += node_places[node].xyz * share_of(k, along);
    }
    var level = 0u;
    var sum = vec3f(0.0);
    if is_smooth {
        let one = distance(node_places[corner].xyz, node_places[corner + 4u].xyz);
        let other = distance(node_places[corner + 1u].xyz, node_places[corner + 3u].xyz);
        let reach = max(max(one, other), OFF_PLANE * distance(middle, position.xyz));
        // A photon's radius is at least half of the edge of its grid's cells.
        while level < NODE_LEVELS && edge_of(level) * 0.5 >= WIDE * reach {
            level++;
        }
        if level > 0u {
            for (var k = 0u; k < 4u; k++) {
                let node = corner + k % 2u + 3u * (k / 2u);
                sum += node_light[(level - 1u) * NODES + node] * share_of(k, along);
            }
        }
    }
    for (; level < grids; level++) {
        sum += light_of_grid(level, position.xyz - photons[0].xyz, normal);
    }
    // The image has halves, of which this is the largest.
    textureStore(irradiance_out, id, vec4f(min(sum, vec3f(65504.0)), 1.0));
}

// The share of a corner of a square at a place within.
fn share_of(corner: u32, along: vec2f) -> f32 {
    return select(1.0 - along.x, along.x, corner % 2u == 1u) * select(1.0 - along.y, along.y, corner / 2u == 1u);
}
