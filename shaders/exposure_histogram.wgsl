// Counts the lit pixels by the logarithm of their luminance (ITU-R BT.709). One thread a pixel.
#import frame_group
#import exposure
#import finite

@group(1) @binding(0) var color_in: texture_2d<f32>;
@group(1) @binding(1) var depth_in: texture_2d<f32>;
@group(1) @binding(2) var<storage, read_write> histogram: array<atomic<u32>>;

// Of a workgroup, which begin at zero.
var<workgroup> counts: array<atomic<u32>, EXPOSURE_BINS>;

@compute @workgroup_size(16, 16)
fn exposure_histogram(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) bin: u32) {
    if id.x < frame.width && id.y < frame.height && textureLoad(depth_in, id.xy, 0).x > 0.0 {
        let luminance = dot(textureLoad(color_in, id.xy, 0).rgb, vec3f(0.2126, 0.7152, 0.0722));
        if !is_nan(luminance) && luminance >= exp2(EXPOSURE_LOWEST) {
            let place = (log2(min(luminance, 1e6)) - EXPOSURE_LOWEST) * (f32(EXPOSURE_BINS) / EXPOSURE_STOPS);
            atomicAdd(&counts[u32(clamp(place, 0.0, f32(EXPOSURE_BINS - 1u)))], 1u);
        }
    }
    workgroupBarrier();
    let count = atomicLoad(&counts[bin]);
    if count > 0u {
        atomicAdd(&histogram[bin], count);
    }
}
