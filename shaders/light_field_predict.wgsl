// Predicts by how much look-ups are off if only the samples that are chosen so far have maps, each mirror pixel by the
// first that it asks, for one mirror pixel in four. Counts them for each sample that may be chosen: those to which it is
// the nearest, and how many of these are off by more than `light_field.accuracy`. Runs once for each page of maps.
#import frame_group
#import light_field_maps
#import direction_step

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// w: the linear depth of the mirror point.
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> mirrors: MappedMirrors;
// The grids of the chosen samples, then those of all.
@group(1) @binding(4) var<storage, read> fields: Fields;
@group(1) @binding(5) var<storage, read> index: array<u32>;
@group(1) @binding(6) var<storage, read> samples: array<FieldSample>;
@group(1) @binding(7) var<storage, read> records: array<vec4u>;
// For each sample the number of its pixels, and of those that are off.
@group(1) @binding(8) var<storage, read_write> predicted: array<atomic<u32>>;

// Where the sample says nothing about the ray.
const UNTOLD: f32 = 3e38;

@compute @workgroup_size(8, 8)
fn light_field_predict(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, 2u * thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    if point.w == 0.0 {
        return;
    }
    let normal = textureLoad(normal_in, id, 0).xyz;
    let eye = textureLoad(eye_in, id, 0);
    let ray = mirror_ray(point.xyz, normal, eye.xyz);
    let near = in_order(ray, normal);
    if near.count == 0u {
        return;
    }
    let sample = samples[near.numbers[0]];
    let slot = i32(sample.surface_slot.w) - i32(fields.first_slot);
    if slot < 0 || slot >= i32(fields.slots) {
        return;
    }
    var off = UNTOLD;
    if serves(u32(slot), sample.middle.xyz, ray.origin, normal) {
        off = pixels_off(u32(slot), sample.middle.xyz, ray, direction_step(id, ray.direction), eye.w);
    }
    let asked = samples_near_in(fields.first_of_all + u32(mirror_at(point.xyz).low_map.w), point.xyz, 1u).numbers[0];
    atomicAdd(&predicted[2u * asked], 1u);
    atomicAdd(&predicted[2u * asked + 1u], select(0u, 1u, off > settings.light_field.accuracy));
}

// What is seen in the ray's direction from the sample lies beside the ray by the distance of the sample from the ray.
// Corrected, what is met is on the ray.
fn pixels_off(slot: u32, middle: vec3f, ray: MirrorRay, step: f32, depth: f32) -> f32 {
    let seen = look_up(slot, middle, ray);
    if seen.kind == OPEN {
        return 0.0;
    }
    if settings.light_field.corrections > 0u {
        return select(UNTOLD, 0.0, seen.kind == ON_THE_RAY);
    }
    let offset = middle - ray.origin;
    let beside = length(offset - ray.direction * dot(offset, ray.direction));
    let place = disc_toward(slot, middle, ray.direction).place;
    let turned = asin(min(beside / max(distance(place, ray.origin), 1e-30), 1.0));
    // Where rays are parallel, pixels are as wide as on the mirror.
    return select(beside * pixels_per_unit(frame, depth), turned / step, step > STEADY);
}
