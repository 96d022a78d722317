// The records of the camera's picture: the plane of the surface at each pixel's centre, so that a ray loads one record a
// pixel. One thread a pixel.
#import frame_group
#import depth_texel
#import hit

@group(1) @binding(0) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(1) var position_in: texture_2d<f32>;
@group(1) @binding(2) var<storage, read_write> records: array<vec4u>;

@compute @workgroup_size(8, 8)
fn screen_planes(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let position = textureLoad(position_in, id.xy, 0);
    let pixel = id.y * frame.width + id.x;
    if position.w == 0.0 {
        records[pixel] = vec4u(0u);
        return;
    }
    let own = textureLoad(normal_in, id.xy, 0).xyz;
    let sight = select(normalize(position.xyz), frame.forward.xyz, frame.orthographic != 0u);
    let cosine = dot(own, sight);
    let has_slope = abs(cosine) >= LEAST_COSINE || settings.screen_trace.criterion != SCREEN_TRACE_CRITERION_PLANE;
    let normal = select(-sight, select(own, -own, cosine > 0.0), has_slope);
    let depth = dot(position.xyz, frame.forward.xyz);
    // Seen edge-on, the surface reaches far to both sides of the depth at the centre: a ray is free up to its near end.
    let reach = 0.7 / max(abs(cosine), 0.05) / pixels_per_unit(frame, depth);
    let first = max(select(depth - reach, depth, has_slope), 0.01 * depth);
    // The disc is not known: its plane counts all over the pixel.
    records[pixel] = pack_texel(DepthTexel(select(pixel | EDGE_ON, pixel, has_slope), first, normal, 0.0, vec2f(0.0)));
}
