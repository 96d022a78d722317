// The samples of a mirror near to a place: maps stand on them. Filled by crates/render/src/reflection/light_field.rs; CPU
// twin: reflection/light_field/twin.rs. The importing pass binds `mirrors`, `fields`, `index` and `samples`.
#import mirror_places
#import params

// The cells of a mirror's box, each with the samples that are nearest to its middle.
struct SampleGrid {
    // xyz: lower corner of the box, relative to the eye. w: cells to a world unit.
    low_scale: vec4f,
    columns: u32,
    rows: u32,
    layers: u32,
    // The first cell in `index`.
    first: u32,
}

// The maps of a page, and the grids of the mirrors.
struct Fields {
    // Texels along the edge of a face.
    size: u32,
    // The room of a face in a page.
    texels_of_face: u32,
    // The first slot of the page, and how many it has. A slot is the room of a map.
    first_slot: u32,
    slots: u32,
    // Whether the page is the first one that is looked into, or the last one.
    is_first: u32,
    is_last: u32,
    // Whether it is known which samples answer, and one of their looks is taken, where looks are blended.
    picks: u32,
    // The number of the first grid of all samples, behind those of the samples that are chosen.
    first_of_all: u32,
    grids: array<SampleGrid>,
}

struct FieldSample {
    // xyz: where it is on the surface, relative to the eye. w: the slot of its map; below 0 if it has none.
    surface_slot: vec4f,
    // xyz: the middle of its map.
    middle: vec4f,
}

// The number of samples that a cell has room for.
const CELL_SAMPLES: u32 = 16u;
const NO_SAMPLE: u32 = 0xffffffffu;
// The most neighbours, and the one after them.
const MOST_NEAR: u32 = 9u;

struct NearSamples {
    numbers: array<u32, MOST_NEAR>,
    count: u32,
}

// The nearest samples of the mirror on which a place lies, at most `most`, nearest first.
fn samples_near(place: vec3f, most: u32) -> NearSamples {
    let mirror = mirror_at(place);
    if mirror.low_map.w < 0.0 {
        return NearSamples(array<u32, MOST_NEAR>(), 0u);
    }
    return samples_near_in(u32(mirror.low_map.w), place, most);
}

// The nearest samples of a grid.
fn samples_near_in(grid_number: u32, place: vec3f, most: u32) -> NearSamples {
    var near = NearSamples(array<u32, MOST_NEAR>(), 0u);
    var distances = array<f32, MOST_NEAR>();
    let grid = fields.grids[grid_number];
    let cells = vec3f(vec3u(grid.columns, grid.rows, grid.layers));
    let at = vec3u(clamp((place - grid.low_scale.xyz) * grid.low_scale.w, vec3f(0.0), cells - 0.5));
    let cell = grid.first + (at.z * grid.rows + at.y) * grid.columns + at.x;
    for (var i = 0u; i < CELL_SAMPLES; i++) {
        let number = index[cell * CELL_SAMPLES + i];
        if number != NO_SAMPLE {
            let offset = samples[number].surface_slot.xyz - place;
            let distance = dot(offset, offset);
            // Farther ones move back, and the last one drops out.
            var at_rank = min(near.count, most);
            while at_rank > 0u && distances[at_rank - 1u] > distance {
                if at_rank < most {
                    distances[at_rank] = distances[at_rank - 1u];
                    near.numbers[at_rank] = near.numbers[at_rank - 1u];
                }
                at_rank -= 1u;
            }
            if at_rank < most {
                distances[at_rank] = distance;
                near.numbers[at_rank] = number;
                near.count = min(near.count + 1u, most);
            }
        }
    }
    return near;
}
