// Shows the search's error function for one point instead of the picture (Preiner 2010, figures 3.6, 3.9 and 3.11): the
// signs of the error along x and y in each mirror pixel, and the root lines, on which one of them vanishes. Where both
// lines cross, the mirror shows the point, unless the point lies behind the mirror, where the view is darker.
// One thread a pixel.
#import frame_group
#import mirror_space
#import tone

@group(1) @binding(0) var<uniform> shown: ShownPoint;
@group(1) @binding(1) var color_in: texture_2d<f32>;
// xyz: mirror point, w: specular intensity.
@group(1) @binding(2) var point_in: texture_2d<f32>;
@group(1) @binding(3) var normal_in: texture_2d<f32>;
// xyz: origin of the ray.
@group(1) @binding(4) var eye_in: texture_2d<f32>;
@group(1) @binding(5) var picture_out: texture_storage_2d<rgba8unorm, write>;

// Declared in crates/render/src/layout.rs.
struct ShownPoint {
    // xyz: relative to the eye.
    position: vec4f,
}

@compute @workgroup_size(8, 8)
fn show_error(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let own = error_at(id.xy);
    var color = screen_color(settings, textureLoad(color_in, id.xy, 0).rgb) * 0.25;
    if own.z > 0.0 {
        let right = error_at(min(id.xy + vec2u(1u, 0u), vec2u(frame.width, frame.height) - 1u));
        let below = error_at(min(id.xy + vec2u(0u, 1u), vec2u(frame.width, frame.height) - 1u));
        // Hues by the signs, brighter the larger the error.
        let hue = select(
            select(vec3f(0.2, 0.3, 0.7), vec3f(0.2, 0.6, 0.3), own.y > 0.0),
            select(vec3f(0.6, 0.2, 0.6), vec3f(0.7, 0.6, 0.2), own.y > 0.0),
            own.x > 0.0,
        );
        color = hue * (0.35 + 0.65 * min(length(own.xy) / 3.14159265, 1.0));
        let is_root = is_crossed(own, right) | is_crossed(own, below);
        color = select(color, vec3f(1.0, 0.15, 0.1), is_root.x);
        color = select(color, vec3f(0.1, 0.9, 1.0), is_root.y);
        color = select(color, vec3f(1.0), is_root.x && is_root.y);
        let offset = shown.position.xyz - textureLoad(point_in, id.xy, 0).xyz;
        color *= select(0.4, 1.0, dot(offset, textureLoad(normal_in, id.xy, 0).xyz) > 0.0);
    }
    textureStore(picture_out, id.xy, vec4f(color, 1.0));
}

// xy: the error, z: 1 on a mirror.
fn error_at(at: vec2u) -> vec3f {
    let point = textureLoad(point_in, at, 0);
    let toward_eye = normalize(textureLoad(eye_in, at, 0).xyz - point.xyz);
    let pixel = MirrorPixel(
        vec4u(bitcast<vec3u>(point.xyz), 0u),
        vec4u(bitcast<vec3u>(textureLoad(normal_in, at, 0).xyz), pack_direction(toward_eye)),
    );
    let error = mirror_space_error(reflected_in_mirror_space(pixel, frame.right.xyz, shown.position.xyz));
    return select(vec3f(0.0), vec3f(error, 1.0), point.w > 0.0);
}

// Whether the error along x or y changes its sign between two mirror pixels. Where light leaves backwards, the angles
// jump by a whole turn and have no root.
fn is_crossed(own: vec3f, other: vec3f) -> vec2<bool> {
    let changes = (own.xy > vec2f(0.0)) != (other.xy > vec2f(0.0));
    let is_near = abs(own.xy - other.xy) < vec2f(3.14159265);
    return changes & is_near & vec2<bool>(other.z > 0.0);
}
