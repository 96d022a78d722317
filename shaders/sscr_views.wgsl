// Images of the work of the search and its preparation at each pixel. One thread a pixel.
#import frame_group
#import mirror_space
#import region

@group(1) @binding(0) var<storage, read> curvature_map: array<u32>;
@group(1) @binding(1) var<storage, read> mirror_pixels: array<MirrorPixel>;
// Three words a pixel: searches that ended there, their steps, those of them that ran out of steps.
@group(1) @binding(2) var<storage, read> endings: array<u32>;
// OUTSIDE at pixels between regions.
@group(1) @binding(3) var<storage, read> parents: array<u32>;
// Flags of the curvature map, label, mean steps, share out of steps.
@group(1) @binding(4) var views_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn sscr_views(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let searches = f32(max(endings[pixel * ENDING_WORDS], 1u));
    let steps = f32(endings[pixel * ENDING_WORDS + 1u]) / searches;
    let unconverged = f32(endings[pixel * ENDING_WORDS + 2u]) / searches;
    let label = f32(mirror_pixels[pixel].point_label.w);
    let curvature = curvature_map[pixel];
    let is_suppressed = (curvature & MIRROR) != 0u && parents[pixel] == OUTSIDE;
    let flags = curvature | select(0u, SUPPRESSED, is_suppressed);
    textureStore(views_out, id.xy, vec4f(f32(flags), label, steps, unconverged));
}
