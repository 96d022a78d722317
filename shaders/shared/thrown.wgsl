// The light that mirrors throw onto a surface: photons in a grid of cells. Filled by crates/render/src/caustics/grid.rs,
// which holds the CPU twin. The importing pass has the bindings `photons` and `cells`.

// The first two elements of `photons` describe the grid: its lower corner relative to the eye, and the radius about a place
// within which photons count, which is also the edge of a cell; then the bits of its columns, rows and layers. Three follow
// for each photon, cell by cell: its position relative to that corner, the unit normal of the surface where it has landed,
// and its power. `cells` has the number of photons before each cell, and of all.
const GRID_VECTORS: u32 = 2u;
const PHOTON_VECTORS: u32 = 3u;

// The least cosine between the normals of a place and of where a photon has landed that counts there: light passes
// neither through a wall nor around a corner.
const SAME_SIDE: f32 = 0.5;

// The irradiance at a place relative to the eye: the power of the photons about it, weighed by one minus their squared
// distance over that of the radius (Silverman 1986).
fn thrown_light(position: vec3f, normal: vec3f) -> vec3f {
    let low_radius = photons[0];
    let last_cell = vec3i(bitcast<vec3u>(photons[1].xyz)) - 1;
    let place = position - low_radius.xyz;
    let cell = vec3i(clamp(floor(place / low_radius.w), vec3f(-2.0), vec3f(last_cell) + 2.0));
    let low = clamp(cell - 1, vec3i(0), last_cell);
    let high = clamp(cell + 1, vec3i(0), last_cell);
    let squared = low_radius.w * low_radius.w;
    var sum = vec3f(0.0);
    for (var z = low.z; z <= high.z; z++) {
        for (var y = low.y; y <= high.y; y++) {
            let row = (z * (last_cell.y + 1) + y) * (last_cell.x + 1);
            let end = cells[row + high.x + 1];
            for (var i = cells[row + low.x]; i < end; i++) {
                let at = GRID_VECTORS + i * PHOTON_VECTORS;
                let offset = photons[at].xyz - place;
                let weight = 1.0 - dot(offset, offset) / squared;
                if weight > 0.0 && dot(photons[at + 1u].xyz, normal) > SAME_SIDE {
                    sum += photons[at + 2u].rgb * weight;
                }
            }
        }
    }
    return sum * (2.0 / (3.14159265 * squared));
}
