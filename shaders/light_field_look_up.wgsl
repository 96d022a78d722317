// Light fields: each mirror pixel looks its reflected ray up in the map of a sample near to it. The disc found there
// shows where the ray meets its plane, and that place is looked up again. Runs once for each page of maps; what the
// first sample in order finds counts, whichever page it is on. Where looks are blended it runs over all pages to learn
// which samples answer, and once more to take one of their looks, of which the frame has the number. What no sample
// resolves is listed by the last page. One thread a pixel. CPU twin: reflection/light_field/twin.rs.
#import frame_group
#import light_field_maps
#import counters
#import hit

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> mirrors: MappedMirrors;
@group(1) @binding(4) var<storage, read> fields: Fields;
@group(1) @binding(5) var<storage, read> index: array<u32>;
@group(1) @binding(6) var<storage, read> samples: array<FieldSample>;
// The maps of the page, texel by texel; see depth_texel.wgsl.
@group(1) @binding(7) var<storage, read> records: array<vec4u>;
// See hit.wgsl. Between pages w holds the rank of what is found, or a bit for each sample that answers where looks are
// blended; and the rank of what shows something beside the ray.
@group(1) @binding(8) var<storage, read_write> hits: array<vec4u>;
// As in cubemap_trace.wgsl.
@group(1) @binding(9) var<storage, read_write> rest: array<atomic<u32>>;
// x: the weight of the look. z: the number of samples that were asked until one answered.
@group(1) @binding(10) var views_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(11) var<storage, read_write> counters: array<atomic<u32>>;

// Set for the first bounce, whose figures are reported.
override counts: bool = false;
override rest_of_rays: u32 = LIGHT_FIELD_REST_SURFEL_TRACE;

@compute @workgroup_size(8, 8)
fn light_field_look_up(@builtin(global_invocation_id) invocation: vec3u) {
    let id = mirror_pixel(frame, whole_thread(frame, invocation));
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    if point.w == 0.0 {
        return;
    }
    let normal = textureLoad(normal_in, id, 0).xyz;
    let ray = mirror_ray(point.xyz, normal, textureLoad(eye_in, id, 0).xyz);
    let pixel = id.y * frame.width + id.x;
    var hit = select(hits[pixel], vec4u(0u), fields.is_first != 0u);
    // The rank of the sample that shows what the ray meets, or a bit for each of them; the rank of one that shows
    // something beside it. Ranks count from 1.
    var told = hit.w & 0xffu;
    var beside = hit.w >> 8u;
    let near = in_order(ray, normal);
    let picks = fields.picks != 0u;
    let taken = rank_of_look(told);
    for (var rank = 1u; rank <= asked_samples(near); rank++) {
        let sample = samples[near.numbers[rank - 1u]];
        let slot = i32(sample.surface_slot.w) - i32(fields.first_slot);
        let is_here = slot >= 0 && slot < i32(fields.slots);
        let is_asked = select(told == 0u || rank < told, !picks || rank == taken, blends);
        if is_here && is_asked && serves(u32(slot), sample.middle.xyz, ray.origin, normal) {
            let seen = look_up(u32(slot), sample.middle.xyz, ray);
            let is_shown = seen.kind == BESIDE && rest_of_rays == LIGHT_FIELD_REST_NONE && told == 0u && !picks;
            let tells = seen.kind == ON_THE_RAY || seen.kind == OPEN;
            if tells && (picks || !blends) {
                hit = hit_of(seen);
            }
            if tells {
                told = select(rank, told | (1u << (rank - 1u)), blends);
            } else if is_shown && (beside == 0u || rank < beside) {
                hit = hit_of(seen);
                beside = rank;
            }
        }
    }
    hit.w = told | (beside << 8u);
    if fields.is_last != 0u {
        hit.w = 0u;
        let is_first_look = !blends || frame.look == 0u;
        var weight = select(0.0, 1.0, is_first_look);
        if told != 0u && blends {
            weight = weight_of_look(near, told);
        }
        if blends && !is_first_look && taken == 0u {
            // There are not so many looks.
            hit = vec4u(0u);
        } else if told == 0u {
            if hit.y == 0u {
                hit.x = select(HIT_UNKNOWN, 0u, rest_of_rays == LIGHT_FIELD_REST_SURFEL_TRACE);
            }
            let place = atomicAdd(&rest[0], 1u);
            atomicStore(&rest[1u + 2u * place], pixel);
            atomicStore(&rest[2u + 2u * place], 0u);
        }
        if counts {
            let asked = select(select(told, taken, blends), asked_samples(near), told == 0u);
            textureStore(views_out, id, vec4f(weight, 0.0, f32(asked), 0.0));
            atomicAdd(&counters[RAYS_LEFT], select(0u, 1u, told == 0u));
        }
    }
    hits[pixel] = hit;
}

// The rank of the sample whose look is taken, of those with a bit: the first for the first look, and so on. 0 if there
// are not so many.
fn rank_of_look(telling: u32) -> u32 {
    var bits = telling;
    for (var i = 0u; i < frame.look; i++) {
        bits &= bits - select(0u, 1u, bits != 0u);
    }
    return firstTrailingBit(bits) + 1u;
}

// How much the look counts among those of all samples that answer; their weights sum up to 1.
fn weight_of_look(near: OrderedSamples, telling: u32) -> f32 {
    var sum = 0.0;
    for (var i = 0u; i < near.count; i++) {
        sum -= select(0.0, near.keys[i], (telling & (1u << i)) != 0u);
    }
    let taken = rank_of_look(telling);
    // Where all weights vanish, all count the same.
    let weight = select(1.0 / f32(countOneBits(telling)), -near.keys[max(taken, 1u) - 1u] / sum, sum > 0.0);
    return select(weight, 0.0, taken == 0u);
}

fn hit_of(seen: LookedUp) -> vec4u {
    let distance = bitcast<u32>(abs(seen.distance));
    let is_open = seen.kind == OPEN;
    return select(vec4u(distance, seen.identity + 1u, bitcast<u32>(seen.distance), 0u), vec4u(0u), is_open);
}
