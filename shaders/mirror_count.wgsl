// Counts mirror pixels, and those in which something was found. One thread a pixel.
#import frame
#import params
#import counters

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> settings: Settings;
// w: specular intensity.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// w: coverage.
@group(1) @binding(1) var seen_in: texture_2d<f32>;
@group(1) @binding(2) var<storage, read_write> counters: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn mirror_count(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height || textureLoad(point_in, id, 0).w == 0.0 {
        return;
    }
    let coverage = textureLoad(seen_in, id, 0).w;
    atomicAdd(&counters[MIRROR_PIXELS], 1u);
    if coverage > 0.0 {
        atomicAdd(&counters[select(CLOSED_PIXELS, FOUND_PIXELS, coverage >= 1.0)], 1u);
    }
}
