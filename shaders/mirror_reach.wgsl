// How far the rays of mirrors go, by which reflections fade: from each mirror pixel to what its ray meets, in radii of its
// mirror. One thread a pixel.
#import frame_group
#import mirror_places

// xyz: mirror point, w: specular intensity, 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// xyz: the reflected surface, w: its coverage.
@group(1) @binding(1) var seen_in: texture_2d<f32>;
// 0 where the surface is opaque.
@group(1) @binding(2) var index_in: texture_2d<f32>;
// x of a view: the mirror's radius.
@group(1) @binding(3) var<storage, read> mirrors: MappedMirrors;
// NOTHING_MET where the ray meets nothing; 0 at clear surfaces, whose reflections do not fade.
@group(1) @binding(4) var reach_out: texture_storage_2d<r32float, write>;

// Set if some surfaces are clear.
override has_clear: bool = false;

// More than any mirror.fade_distance.
const NOTHING_MET: f32 = 1e30;

@compute @workgroup_size(8, 8)
fn mirror_reach(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    var reach = 0.0;
    let is_opaque = !has_clear || textureLoad(index_in, id, 0).x == 0.0;
    if point.w > 0.0 && is_opaque {
        let seen = textureLoad(seen_in, id, 0);
        reach = NOTHING_MET;
        if seen.w > 0.0 {
            reach = min(distance(seen.xyz, point.xyz) / max(mirror_at(point.xyz).view.x, 1e-30), NOTHING_MET);
        }
    }
    textureStore(reach_out, id, vec4f(reach));
}
