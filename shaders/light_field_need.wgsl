// Counts which maps a picture needs: each mirror pixel asks for those of its nearest samples, the nearer the more. One
// thread a pixel.
#import frame_group
#import light_field

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var<storage, read> mirrors: MappedMirrors;
@group(1) @binding(2) var<storage, read> fields: Fields;
@group(1) @binding(3) var<storage, read> index: array<u32>;
@group(1) @binding(4) var<storage, read> samples: array<FieldSample>;
// For each sample, how much it is asked for.
@group(1) @binding(5) var<storage, read_write> needs: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn light_field_need(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    if point.w == 0.0 {
        return;
    }
    let near = samples_near(point.xyz, settings.light_field.neighbours);
    for (var rank = 0u; rank < near.count; rank++) {
        atomicAdd(&needs[near.numbers[rank]], near.count - rank);
    }
}
