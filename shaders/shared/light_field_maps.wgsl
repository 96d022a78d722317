// What the map of a sample shows about the reflected ray of a mirror point. The importing pass binds what light_field.wgsl
// asks for, and the maps of a page as `records`, texel by texel; see depth_texel.wgsl.
#import light_field
#import cube_faces
#import mirror_ray

override rule: u32 = LIGHT_FIELD_RULE_NEAREST;
// Set for the rules that blend.
override blends: bool = false;
override visible_by: u32 = LIGHT_FIELD_VISIBLE_BY_DEPTH;
// Set if texels are traced when they are first looked at.
override is_partial: bool = false;

// How far beside a disc, in texels, it still shows where a ray meets its surface: its texel shows so much more of it.
const BESIDE_DISC: f32 = 0.75;
// A surface seen at a smaller angle than this sine does not show it.
const LEAST_SINE: f32 = 0.05;

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

// How many of these samples are asked: where texels are traced for it only the first, or those that are blended.
fn asked_samples(near: OrderedSamples) -> u32 {
    return select(near.count, min(near.count, 1u), is_partial && !blends);
}

// Whether a texel is not traced yet. One that is, and in which nothing is, is marked by its third word.
fn is_untraced(record: vec4u) -> bool {
    return is_partial && record.y == 0u && record.z == 0u;
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
    // Whether the texel is traced, and shows something.
    is_known: bool,
    is_there: bool,
    identity: u32,
    // Where the line of sight through the middle of the texel meets its plane.
    place: vec3f,
    normal: vec3f,
    middle: vec3f,
    // Up to here from its middle it shows where a ray meets it.
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
        !is_untraced(record), record.y != 0u, record.x, middle + sight * texel.depth, texel.normal, middle + toward_disc * depth,
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

// The distance at which a ray meets the plane of a disc; where that says nothing, the distance of the disc.
fn distance_to_disc(disc: MapDisc, ray: MirrorRay) -> vec2f {
    let sine = dot(disc.normal, ray.direction);
    let met = dot(disc.normal, disc.place - ray.origin) / sine;
    let is_met = abs(sine) >= LEAST_SINE && met > 0.0;
    return vec2f(select(distance(disc.place, ray.origin), met, is_met), select(0.0, 1.0, is_met));
}

fn look_up(slot: u32, middle: vec3f, ray: MirrorRay) -> LookedUp {
    let corrections = settings.light_field.corrections;
    var disc = disc_toward(slot, middle, ray.direction);
    var kind = select(select(LOST, OPEN, disc.is_known), BESIDE, disc.is_there);
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
