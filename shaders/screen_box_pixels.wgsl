// The pictures of the walls of the box about all points, from the camera's picture: a pixel that lies beside a wall, and
// faces as the wall does, is put there; of several in one texel that nearest to the wall stays. Runs twice: for the
// nearest distance, and for the pixel that has it. One thread a pixel.
#import screen_box

@group(1) @binding(0) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(1) var position_in: texture_2d<f32>;
@group(1) @binding(2) var<storage, read> screen: Screen;
@group(1) @binding(3) var<storage, read_write> texels: array<atomic<u32>>;

override finds_pixel: bool = false;

// Pixels this near to a wall lie on it, in scene radii, if their normals are within 30 degrees of its own.
const WALL_DEPTH: f32 = 0.02;
const WALL_COSINE: f32 = 0.8660254;

@compute @workgroup_size(8, 8)
fn screen_box_pixels(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let position = textureLoad(position_in, id.xy, 0);
    if position.w == 0.0 {
        return;
    }
    let normal = textureLoad(normal_in, id.xy, 0).xyz;
    let pixel = id.y * frame.width + id.x;
    let most = WALL_DEPTH * frame.scene_radius;
    for (var wall = 0u; wall < 6u; wall++) {
        let axis = wall % 3u;
        let is_low = wall >= 3u;
        let off = abs(select(screen.box_high[axis], screen.box_low[axis], is_low) - position[axis]);
        let inward = select(-normal[axis], normal[axis], is_low);
        if off <= most && inward >= WALL_COSINE {
            let place = 2u * index_in_box(wall, texel_in_box(wall, position.xyz));
            let nearness = 0xffffffffu - bitcast<u32>(off);
            if !finds_pixel {
                atomicMax(&texels[place + 1u], nearness);
            } else if atomicLoad(&texels[place + 1u]) == nearness {
                atomicMax(&texels[place], pixel);
            }
        }
    }
}
