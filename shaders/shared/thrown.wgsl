// The light that mirrors throw onto a surface: photons in grids of cells. Filled by crates/render/src/caustics/grid.rs,
// which holds the CPU twin. The importing pass has the bindings `photons` and `cells`.

// The first two elements of `photons` describe the grids: the photons' origin relative to the eye, and the edge of the cells
// of the first grid, each of which has cells half as wide as the one before; then the number of lists of a grid. Four follow
// for each photon: its position relative to the origin and the squared radius over which it spreads its light; the unit
// normal of the surface where it has landed; the irradiance amid its light; and the line where its surface ends, as the unit
// vector from the photon to the line and the distance, which is twice the radius if there is none. `cells` has where each
// list of each grid begins, the end of the last one, and then all lists: indices of photons.
const GRID_VECTORS: u32 = 2u;
const PHOTON_VECTORS: u32 = 4u;
const GRID_LEVELS: u32 = 8u;

// The least cosine between the normals of a place and of where a photon has landed that counts there: light passes
// neither through a wall nor around a corner.
const SAME_SIDE: f32 = 0.5;

// Discs of points go on beyond the line where their surface ends: up to this share of its radius a photon shines there.
const OVER_END: f32 = 0.2;

// The irradiance at a place relative to the eye: the light of the photons about it, each weighed by the square of one minus
// the squared distance over that of its radius. What would lie beyond the line where the photon's surface ends is folded
// back.
fn thrown_light(position: vec3f, normal: vec3f) -> vec3f {
    let origin_edge = photons[0];
    let lists = u32(photons[1].x);
    let place = position - origin_edge.xyz;
    var edge = origin_edge.w;
    var sum = vec3f(0.0);
    for (var level = 0u; level < GRID_LEVELS; level++) {
        let cell = bitcast<vec3u>(vec3i(clamp(floor(place / edge), vec3f(-1e9), vec3f(1e9)))) * vec3u(73856093u, 19349663u, 83492791u);
        let list = level * lists + ((cell.x ^ cell.y ^ cell.z) & (lists - 1u));
        let end = cells[list + 1u];
        for (var i = cells[list]; i < end; i++) {
            let at = GRID_VECTORS + cells[i] * PHOTON_VECTORS;
            let middle = photons[at];
            let offset = place - middle.xyz;
            let weight = 1.0 - dot(offset, offset) / middle.w;
            if weight > 0.0 && dot(photons[at + 1u].xyz, normal) > SAME_SIDE {
                let line = photons[at + 3u];
                let before = line.w - dot(offset, line.xyz);
                let is_before = before >= 0.0 || before * before < OVER_END * OVER_END * middle.w;
                let folded = max(weight - 4.0 * line.w * max(before, 0.0) / middle.w, 0.0);
                sum += photons[at + 2u].rgb * select(0.0, weight * weight + folded * folded, is_before);
            }
        }
        edge *= 0.5;
    }
    return sum;
}
