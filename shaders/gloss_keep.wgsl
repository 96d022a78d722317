// Keeps what the rays of glossy mirrors meet, and hands out what is known of those that were not traced. One thread a
// pixel.
#import frame_group
#import counters
#import gloss_pixel
#import hit

// w: 0 where there is no ray.
@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var<storage, read> pixels: array<GlossPixel>;
// See gloss_pixel.wgsl.
@group(1) @binding(2) var<storage, read_write> kept: array<u32>;
// See hit.wgsl.
@group(1) @binding(3) var<storage, read_write> hits: array<vec4u>;
@group(1) @binding(4) var<storage, read_write> counters: array<atomic<u32>>;

// Which rays are known: those of the pixels that are marked so, none, or all.
override known: u32 = BY_PIXEL;
const BY_PIXEL: u32 = 0u;
const NONE_KNOWN: u32 = 1u;
const ALL_KNOWN: u32 = 2u;

@compute @workgroup_size(8, 8)
fn gloss_keep(@builtin(global_invocation_id) thread: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let is_ray = textureLoad(point_in, id, 0).w > 0.0;
    let place = place_of_thread(thread, groups);
    let words = KEPT_WORDS * place;
    let pixel = id.y * frame.width + id.x;
    let noted = pixels[place];
    let is_known = select(noted.is_anew == 0u, known == ALL_KNOWN, known != BY_PIXEL);
    if is_known {
        let is_hit = kept[words] != 0u;
        let distance = kept[words + 1u] & ~TOP_BIT;
        let in_picture = (kept[words + 2u] & TOP_BIT) != 0u;
        let key = select(distance, HIT_IN_PICTURE, in_picture) | (kept[words + 1u] & TOP_BIT);
        if is_ray {
            hits[pixel] = select(vec4u(kept[words + 1u], 0u, 0u, 0u), vec4u(key, kept[words], distance, 0u), is_hit);
        }
    } else {
        let hit = hits[pixel];
        let is_hit = is_ray && hit.y != 0u;
        kept[words] = select(0u, hit.y, is_hit);
        let unmet = select(0u, HIT_UNKNOWN, is_ray && is_unknown(hit));
        kept[words + 1u] = select(unmet, hit.z | (hit.x & HIT_UNPROVEN), is_hit);
        kept[words + 2u] = noted.key | select(0u, TOP_BIT, is_hit && is_in_picture(hit));
    }
    if is_ray {
        let counter = select(RAYS_TRACED, RAYS_KEPT, is_known);
        let before = atomicAdd(&counters[counter], 1u);
        atomicAdd(&counters[counter + 1u], select(0u, 1u, before == 0xffffffffu));
    }
}
