// Light fields: each mirror pixel looks its reflected ray up in the map of a sample near to it. The disc found there
// tells where the ray meets its plane, and that place is looked up again. Runs once for each page of maps; what the
// first sample in order finds counts, whichever page it is on. Where looks are blended it runs over all pages to learn
// which samples tell, and once more to take one of their looks, of which the frame has the number. What no sample
// resolves is listed by the last page. One thread a pixel. CPU twin: reflection/light_field/twin.rs.
#import frame_group
#import light_field
#import cube_faces
#import mirror_ray
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
// See hit.wgsl. Between pages w holds the rank of what is found, or a bit for each sample that tells where looks are
// blended; and the rank of what shows something beside the ray.
@group(1) @binding(8) var<storage, read_write> hits: array<vec4u>;
// As in cubemap_trace.wgsl.
@group(1) @binding(9) var<storage, read_write> rest: array<atomic<u32>>;
// x: the weight of the look. z: the number of samples that were asked until one told.
@group(1) @binding(10) var views_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(11) var<storage, read_write> counters: array<atomic<u32>>;

// Set for the first bounce, whose figures are told.
override counts: bool = false;
override rule: u32 = LIGHT_FIELD_RULE_NEAREST;
// Set for the rules that blend.
override blends: bool = false;
override visible_by: u32 = LIGHT_FIELD_VISIBLE_BY_DEPTH;
override rest_of_rays: u32 = LIGHT_FIELD_REST_SURFEL_TRACE;

// How far beside a disc, in texels, it still tells where a ray meets its surface: its texel shows so much more of it.
const BESIDE_DISC: f32 = 0.75;
// A surface seen at a smaller angle than this sine does not tell it.
const LEAST_SINE: f32 = 0.05;

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
    // The rank of the sample that tells what the ray meets, or a bit for each of them; the rank of one that shows
    // something beside it. Ranks count from 1.
    var told = hit.w & 0xffu;
    var beside = hit.w >> 8u;
    let near = in_order(ray, normal);
    let picks = fields.picks != 0u;
    let taken = rank_of_look(told);
    for (var rank = 1u; rank <= near.count; rank++) {
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
            let asked = select(select(told, taken, blends), near.count, told == 0u);
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

// How much the look counts among those of all samples that tell; their weights sum up to 1.
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

struct OrderedSamples {
    numbers: array<u32, MOST_NEAR>,
    // What they are ordered by, the smallest first; the negative weight where looks are blended.
    keys: array<f32, MOST_NEAR>,
    count: u32,
}

// The nearest samples in the order of the rule.
fn in_order(ray: MirrorRay, normal: vec3f) -> OrderedSamples {
    let most = settings.light_field.neighbours;
    // A smooth blend goes by the sample after the last, too.
    let near = samples_near(ray.origin, most + select(0u, 1u, rule == LIGHT_FIELD_RULE_SMOOTH));
    var ordered = OrderedSamples(near.numbers, array<f32, MOST_NEAR>(), min(near.count, most));
    if rule == LIGHT_FIELD_RULE_NEAREST {
        return ordered;
    }
    let along = select(ray.direction, normal, rule == LIGHT_FIELD_RULE_NORMAL);
    var largest = 0.0;
    for (var i = 0u; i < ordered.count; i++) {
        largest = max(largest, cosine_to(samples[near.numbers[i]].middle.xyz - ray.origin, along));
    }
    var after = 0.0;
    if near.count > most {
        after = inverse_distance(near.numbers[most], ray.origin);
    }
    for (var i = 0u; i < ordered.count; i++) {
        let number = near.numbers[i];
        let offset = samples[number].middle.xyz - ray.origin;
        var key = -1.0;
        if rule == LIGHT_FIELD_RULE_ANGLE {
            key = -cosine_to(offset, ray.direction);
        } else if rule == LIGHT_FIELD_RULE_RAY {
            key = length(offset - ray.direction * dot(offset, ray.direction));
        } else if rule == LIGHT_FIELD_RULE_SMOOTH {
            key = -max(inverse_distance(number, ray.origin) - after, 0.0);
        } else if rule != LIGHT_FIELD_RULE_MEAN && largest > 0.0 {
            // Relative to the largest, which keeps large powers from vanishing.
            let share = max(cosine_to(offset, along) / largest, 1e-30);
            key = -pow(share, settings.light_field.exponent);
        }
        var at = i;
        while at > 0u && ordered.keys[at - 1u] > key {
            ordered.keys[at] = ordered.keys[at - 1u];
            ordered.numbers[at] = ordered.numbers[at - 1u];
            at -= 1u;
        }
        ordered.keys[at] = key;
        ordered.numbers[at] = number;
    }
    return ordered;
}

fn cosine_to(offset: vec3f, direction: vec3f) -> f32 {
    return dot(offset, direction) / max(length(offset), 1e-30);
}

fn inverse_distance(number: u32, place: vec3f) -> f32 {
    return 1.0 / max(distance(samples[number].surface_slot.xyz, place), 1e-20);
}

// Whether nothing is known to hide a mirror point from the middle of a map.
fn serves(slot: u32, middle: vec3f, place: vec3f, normal: vec3f) -> bool {
    let offset = place - middle;
    let way = length(offset);
    var is_free = true;
    if visible_by == LIGHT_FIELD_VISIBLE_BY_ANGLE {
        is_free = dot(-offset, normal) > cos(radians(settings.light_field.horizon)) * way;
    } else if way > 0.0 {
        let face = face_toward(offset);
        let view = face_of_map(slot, middle, face);
        let record = records[index_in_page(view.picture, texel_toward(view, offset))];
        let texel = unpack_texel(record);
        let slack = (texel.radius + 1.0) * width_at(view, texel.depth);
        is_free = record.y == 0u || dot(view.forward, offset) <= texel.depth + slack;
    }
    return is_free;
}

// The disc that a map shows in a direction.
struct MapDisc {
    is_there: bool,
    identity: u32,
    // Where the line of sight through the middle of the texel meets its plane.
    place: vec3f,
    normal: vec3f,
    middle: vec3f,
    // Up to here from its middle it tells where a ray meets it.
    reach: f32,
}

fn face_of_map(slot: u32, middle: vec3f, face: u32) -> DepthView {
    return cube_face(middle, fields.size, face, slot * 6u + face, 0);
}

fn index_in_page(picture: u32, texel: vec2i) -> u32 {
    return picture * fields.texels_of_face + u32(texel.y) * fields.size + u32(texel.x);
}

fn disc_toward(slot: u32, middle: vec3f, direction: vec3f) -> MapDisc {
    let view = face_of_map(slot, middle, face_toward(direction));
    let at = texel_toward(view, direction);
    let record = records[index_in_page(view.picture, at)];
    let texel = unpack_texel(record);
    let place = vec2f(at) + 0.5;
    let sight = sight_of(view, place).direction;
    let plane = plane_of(Sight(vec3f(0.0), sight), texel.normal, texel.depth);
    let toward_disc = sight_of(view, place + texel.middle).direction;
    let slope = dot(texel.normal, toward_disc);
    // Beyond the plane's horizon the disc has no place on it.
    let depth = select(texel.depth, plane / slope, slope < 0.0);
    let width = width_at(view, texel.depth);
    return MapDisc(
        record.y != 0u, record.x, middle + sight * texel.depth, texel.normal, middle + toward_disc * depth,
        (texel.radius + BESIDE_DISC / max(-dot(texel.normal, sight) / length(sight), LEAST_COSINE)) * width,
    );
}

// Nothing is in the ray's direction.
const OPEN: u32 = 0u;
const ON_THE_RAY: u32 = 1u;
// What is found does not lie on the ray.
const BESIDE: u32 = 2u;
// Nothing is where the ray should meet something.
const LOST: u32 = 3u;

struct LookedUp {
    kind: u32,
    identity: u32,
    // The distance along the ray at which it meets the disc's plane, or passes it. Below 0 if that is not on the disc.
    distance: f32,
}

fn hit_of(seen: LookedUp) -> vec4u {
    let distance = bitcast<u32>(abs(seen.distance));
    let is_open = seen.kind == OPEN;
    return select(vec4u(distance, seen.identity + 1u, bitcast<u32>(seen.distance), 0u), vec4u(0u), is_open);
}

// The distance at which a ray meets the plane of a disc; where that tells nothing, the distance of the disc.
fn distance_to_disc(disc: MapDisc, ray: MirrorRay) -> vec2f {
    let sine = dot(disc.normal, ray.direction);
    let met = dot(disc.normal, disc.place - ray.origin) / sine;
    let is_met = abs(sine) >= LEAST_SINE && met > 0.0;
    return vec2f(select(distance(disc.place, ray.origin), met, is_met), select(0.0, 1.0, is_met));
}

fn look_up(slot: u32, middle: vec3f, ray: MirrorRay) -> LookedUp {
    let corrections = settings.light_field.corrections;
    var disc = disc_toward(slot, middle, ray.direction);
    var kind = select(OPEN, BESIDE, disc.is_there);
    var met = distance_to_disc(disc, ray);
    for (var i = 0u; i < corrections && kind == BESIDE; i++) {
        let offset = ray.origin + ray.direction * met.x - middle;
        if any(offset != vec3f(0.0)) {
            disc = disc_toward(slot, middle, offset);
            met = distance_to_disc(disc, ray);
            kind = select(LOST, BESIDE, disc.is_there);
        }
    }
    let is_on = met.y > 0.0 && distance(ray.origin + ray.direction * met.x, disc.middle) <= disc.reach;
    // Without corrections what is found counts, wherever it is.
    if kind == BESIDE && (is_on || corrections == 0u) {
        kind = ON_THE_RAY;
    }
    return LookedUp(kind, disc.identity, select(-met.x, met.x, is_on));
}
