// Virtual lights as discs in the colour that their surface reflects, over the picture: where the camera sees them, or
// where they are in the lamps' maps. Those of further bounces are smaller, hidden ones darker. One thread a pixel; the
// threads of a tile search its discs together.
#import frame_group
#import light
#import light_view
#import tone
#import vpl

@group(1) @binding(0) var<uniform> views: LightViews;
@group(1) @binding(1) var<uniform> virtual_lights: Virtual;
@group(1) @binding(2) var<storage, read> vpls: array<Vpl>;
@group(1) @binding(3) var<storage, read> lights: array<LightSource>;
@group(1) @binding(4) var<storage, read> shadows: array<vec2u>;
@group(1) @binding(5) var depth_in: texture_2d<f32>;
@group(1) @binding(6) var picture_out: texture_storage_2d<rgba8unorm, write>;

// Draws into each cell of the lamps' maps the lights of the first bounce that come from that lamp.
override in_light_buffer: bool = false;

struct Mark {
    center: vec2f,
    // The radius in pixels; 0 if it is not drawn.
    radius: f32,
    depth: f32,
    color: vec3f,
    index: u32,
}

const NO_MARK: Mark = Mark(vec2f(0.0), 0.0, 3e38, vec3f(0.0), 0u);

// The number of threads of a tile.
var<workgroup> marks: array<Mark, 64>;
var<workgroup> found: atomic<u32>;

@compute @workgroup_size(8, 8)
fn show_virtual_lights(@builtin(global_invocation_id) thread: vec3u, @builtin(local_invocation_index) lane: u32) {
    let id = whole_thread(frame, thread);
    let middle = vec2f(id.xy / 8u * 8u) + 4.0;
    let at = vec2f(id.xy) + 0.5;
    var nearest = NO_MARK;
    var count = virtual_lights.lights_per_bounce * virtual_lights.bounces;
    if in_light_buffer {
        count = virtual_lights.lights_per_bounce * views.count;
    }
    for (var first = 0u; first < count; first += 64u) {
        if lane == 0u {
            atomicStore(&found, 0u);
        }
        workgroupBarrier();
        if first + lane < count {
            let mark = mark_of(first + lane);
            if mark.radius > 0.0 && all(abs(mark.center - middle) <= vec2f(4.0 + mark.radius)) {
                marks[atomicAdd(&found, 1u)] = mark;
            }
        }
        workgroupBarrier();
        for (var i = 0u; i < atomicLoad(&found); i++) {
            let mark = marks[i];
            // Ordered by number if they are at one place: the order in which they are found varies.
            let is_before = mark.depth < nearest.depth || (mark.depth == nearest.depth && mark.index < nearest.index);
            if is_before && distance(mark.center, at) <= mark.radius {
                nearest = mark;
            }
        }
        workgroupBarrier();
    }
    if nearest.radius > 0.0 && id.x < frame.width && id.y < frame.height {
        textureStore(picture_out, id.xy, vec4f(nearest.color, 1.0));
    }
}

fn mark_of(index: u32) -> Mark {
    if in_light_buffer {
        return mark_in_map(index / virtual_lights.lights_per_bounce, index % virtual_lights.lights_per_bounce);
    }
    return mark_in_picture(index);
}

fn mark_in_picture(index: u32) -> Mark {
    let light = vpls[virtual_lights.sky_lights + index];
    let view = view_from_relative(frame, light.position.xyz - virtual_lights.eye_radius.xyz);
    if light.normal.w != VPL_LOCAL || view.z <= frame.near {
        return NO_MARK;
    }
    let center = pixel_from_view(frame, view);
    let size = vec2i(i32(frame.width), i32(frame.height));
    let seen = textureLoad(depth_in, clamp(vec2i(floor(center)), vec2i(0), size - 1), 0).x;
    // Two percent: depths that differ by less are of one surface, as in close_gaps.wgsl.
    let is_hidden = seen > 0.0 && depth_step(frame, seen, view.z) > 0.02;
    let bounce = index / virtual_lights.lights_per_bounce;
    let radius = max(f32(frame.height) / 150.0 * pow(0.65, f32(bounce)), 1.0);
    return Mark(center, radius, view.z, color_of(light) * select(1.0, 0.3, is_hidden), index);
}

fn mark_in_map(map: u32, index: u32) -> Mark {
    let light = vpls[virtual_lights.sky_lights + index];
    let lamp = lights[map];
    let offset = light.position.xyz - virtual_lights.eye_radius.xyz - lamp.position_inner.xyz;
    let is_sun = lamp.axis_outer.w == 0.0;
    let toward = select(-normalize(offset), -lamp.axis_outer.xyz, is_sun);
    let place = shadow_texel(lamp, offset);
    let is_inside = all(place.xy >= vec2f(0.0)) && all(place.xy < vec2f(f32(SHADOW_SIZE)));
    // Lights of other lamps, and of the sky, come from elsewhere: a degree is coarse compared with rounding and fine
    // compared with the angle between two lamps.
    if light.normal.w != VPL_LOCAL || dot(light.incoming.xyz, toward) < 0.9998 || !is_inside {
        return NO_MARK;
    }
    let corner = vec2f(cell_corner(views, vec2u(frame.width, frame.height), map));
    let center = corner + place.xy / f32(SHADOW_SIZE) * f32(views.edge);
    return Mark(center, max(f32(views.edge) / 200.0, 1.0), place.z, color_of(light), index);
}

// The radiance of the surface that it represents, in screen colours; at least six tenths of the screen's brightness, so
// that it is visible.
fn color_of(light: Vpl) -> vec3f {
    let strength = light.intensity.rgb + light.glossy.rgb / 3.14159265;
    let shown = screen_color(settings, strength / max(light.position.w * 3.14159265, 1e-20));
    let most = max(shown.r, max(shown.g, shown.b));
    return shown * (max(most, 0.6) / max(most, 1e-6));
}
