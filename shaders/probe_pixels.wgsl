// The values of four images at pixels of a list, put together in a buffer that is read back. One thread an entry.
#import frame_group

// Column | row << 16.
@group(1) @binding(0) var<storage, read> pixels: array<u32>;
@group(1) @binding(1) var first_in: texture_2d<f32>;
@group(1) @binding(2) var second_in: texture_2d<f32>;
@group(1) @binding(3) var third_in: texture_2d<f32>;
@group(1) @binding(4) var fourth_in: texture_2d<f32>;
// Four vectors an entry.
@group(1) @binding(5) var<storage, read_write> values: array<vec4f>;

@compute @workgroup_size(64)
fn probe_pixels(@builtin(global_invocation_id) thread: vec3u) {
    let entry = thread.x;
    if entry >= arrayLength(&pixels) {
        return;
    }
    let pixel = vec2u(pixels[entry] & 0xffffu, pixels[entry] >> 16u);
    values[entry * 4u] = textureLoad(first_in, pixel, 0);
    values[entry * 4u + 1u] = textureLoad(second_in, pixel, 0);
    values[entry * 4u + 2u] = textureLoad(third_in, pixel, 0);
    values[entry * 4u + 3u] = textureLoad(fourth_in, pixel, 0);
}
