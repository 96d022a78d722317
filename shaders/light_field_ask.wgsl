// Lists the texels of a page of maps that the mirror pixels look at and that are not traced yet, each once. Runs once more
// for each correction, when it is known where that looks. One thread a pixel.
#import frame_group
#import light_field_maps
#import counters

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> mirrors: MappedMirrors;
@group(1) @binding(4) var<storage, read> fields: Fields;
@group(1) @binding(5) var<storage, read> index: array<u32>;
@group(1) @binding(6) var<storage, read> samples: array<FieldSample>;
@group(1) @binding(7) var<storage, read> records: array<vec4u>;
// A bit for each texel of the page that was listed before.
@group(1) @binding(8) var<storage, read_write> listed: array<atomic<u32>>;
// The number of texels that are asked for, or a larger one if the list is full, then the texels by their number in the page.
@group(1) @binding(9) var<storage, read_write> asked: array<atomic<u32>>;
@group(1) @binding(10) var<storage, read_write> counters: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn light_field_ask(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    if point.w == 0.0 {
        return;
    }
    let normal = textureLoad(normal_in, id, 0).xyz;
    let ray = mirror_ray(point.xyz, normal, textureLoad(eye_in, id, 0).xyz);
    let near = in_order(ray, normal);
    for (var rank = 0u; rank < asked_samples(near); rank++) {
        let sample = samples[near.numbers[rank]];
        let slot = i32(sample.surface_slot.w) - i32(fields.first_slot);
        if slot >= 0 && slot < i32(fields.slots) {
            let middle = sample.middle.xyz;
            let offset = ray.origin - middle;
            if visible_by == LIGHT_FIELD_VISIBLE_BY_DEPTH && any(offset != vec3f(0.0)) {
                _ = is_traced(u32(slot), middle, offset);
            }
            ask_along(u32(slot), middle, ray);
        }
    }
}

// Asks for the texel in the ray's direction, and for that which a correction looks at as far as it is known.
fn ask_along(slot: u32, middle: vec3f, ray: MirrorRay) {
    var offset = ray.direction;
    for (var i = 0u; i <= settings.light_field.corrections; i++) {
        if !is_traced(slot, middle, offset) {
            return;
        }
        let disc = disc_toward(slot, middle, offset);
        if !disc.is_there {
            return;
        }
        let next = ray.origin + ray.direction * distance_to_disc(disc, ray).x - middle;
        if any(next != vec3f(0.0)) {
            offset = next;
        }
    }
}

// Whether the texel in a direction is traced; lists it if it is not.
fn is_traced(slot: u32, middle: vec3f, direction: vec3f) -> bool {
    let view = face_of_map(slot, middle, face_toward(direction));
    let texel = index_in_page(view.picture, texel_toward(view, direction));
    let is_known = !is_untraced(records[texel]);
    if !is_known {
        let bit = 1u << (texel & 31u);
        if (atomicOr(&listed[texel >> 5u], bit) & bit) == 0u {
            let place = 1u + atomicAdd(&asked[0], 1u);
            if place < arrayLength(&asked) {
                atomicStore(&asked[place], texel);
                atomicAdd(&counters[TEXELS_TRACED], 1u);
            } else {
                // There is no room; the pass runs once more.
                atomicAnd(&listed[texel >> 5u], ~bit);
            }
        }
    }
    return is_known;
}
