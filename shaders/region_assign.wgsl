// The labelled homogeneous curvature map (Preiner 2010, section 3.5.2, step 4): every mirror pixel's region, those on borders
// the one to their right, else below; the regions' bounds; and all that the search reads of a pixel, side by side.
// One thread a pixel.
#import frame_group
#import mirror_space
#import region

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> parents: array<u32>;
// The labels of the roots.
@group(1) @binding(4) var<storage, read> sizes: array<u32>;
// REGION_WORDS words each.
@group(1) @binding(5) var<storage, read_write> regions: array<atomic<u32>>;
@group(1) @binding(6) var<storage, read_write> mirror_pixels: array<MirrorPixel>;

// Whether the bounds of the reflected rays are needed.
override bound_rays: bool = false;

@compute @workgroup_size(8, 8)
fn region_assign(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let index = id.y * frame.width + id.x;
    let point = textureLoad(point_in, id.xy, 0);
    var label = 0u;
    if point.w > 0.0 {
        label = label_of(index);
        if parents[index] == OUTSIDE {
            if id.x + 1u < frame.width {
                label = label_of(index + 1u);
            }
            if label == 0u && id.y + 1u < frame.height {
                label = label_of(index + frame.width);
            }
        }
    }
    let normal = textureLoad(normal_in, id.xy, 0).xyz;
    let toward_eye = normalize(textureLoad(eye_in, id.xy, 0).xyz - point.xyz);
    var pixel = MirrorPixel(vec4u(0u), vec4u(0u));
    if point.w > 0.0 {
        pixel.point_label = vec4u(bitcast<vec3u>(point.xyz), label);
        pixel.normal_eye = vec4u(bitcast<vec3u>(normal), pack_direction(toward_eye));
    }
    mirror_pixels[index] = pixel;
    if label == 0u {
        return;
    }
    let region = label * REGION_WORDS;
    lower(region + REGION_FIRST, id.x);
    lower(region + REGION_FIRST + 1u, id.y);
    raise(region + REGION_LAST, id.x);
    raise(region + REGION_LAST + 1u, id.y);
    if bound_rays {
        let reflected = 2.0 * normal * dot(normal, toward_eye) - toward_eye;
        for (var axis = 0u; axis < 3u; axis++) {
            lower(region + REGION_POINT_LOW + axis, ordered(point[axis]));
            raise(region + REGION_POINT_HIGH + axis, ordered(point[axis]));
            lower(region + REGION_DIRECTION_LOW + axis, ordered(reflected[axis]));
            raise(region + REGION_DIRECTION_HIGH + axis, ordered(reflected[axis]));
        }
    }
}

fn label_of(index: u32) -> u32 {
    let root = parents[index];
    if root == OUTSIDE {
        return 0u;
    }
    return sizes[root];
}

// Reading first saves nearly all atomics: bounds settle after a few pixels.
fn lower(word: u32, value: u32) {
    if atomicLoad(&regions[word]) > value {
        atomicMin(&regions[word], value);
    }
}

fn raise(word: u32, value: u32) {
    if atomicLoad(&regions[word]) < value {
        atomicMax(&regions[word], value);
    }
}
