// Draws the photons that lamps and the sun send toward mirrors: each has the origin and direction of its ray, and the power
// that it carries. One thread a photon.
#import frame_group
#import photons
#import vpl

@group(1) @binding(0) var<storage, read> beams: array<PhotonBeam>;
@group(1) @binding(1) var<uniform> run: PhotonRun;
// rgb: the power of each photon.
@group(1) @binding(2) var<storage, read_write> powers: array<vec4f>;
// xyz: the origin of the ray, w: 0 where there is none.
@group(1) @binding(3) var point_out: texture_storage_2d<rgba32float, write>;
// xyz: a place on the ray's line before its origin.
@group(1) @binding(4) var eye_out: texture_storage_2d<rgba32float, write>;

// Light that may meet one mirror. Declared in crates/render/src/layout.rs. Positions are relative to the photons' origin.
struct PhotonBeam {
    // Of a lamp, xyz: the unit vector amid the beam; w: one minus the cosine of its half angle. Of the sun, xyz: the middle
    // of the disc in which its rays start; w: the radius of that disc.
    axis_extent: vec4f,
    // xyz: position of the lamp; w: inner angle of its cone, radians.
    position_inner: vec4f,
    // xyz: unit axis of the lamp, or the direction of the sun's light; w: outer angle.
    axis_outer: vec4f,
    // rgb: radiant intensity in the lamp's inner cone, or irradiance across the sun's light; w: 1 for the sun.
    strength: vec4f,
    // The first beam of the same lamp, and how many it has.
    first: u32,
    count: u32,
    unused_0: u32,
    unused_1: u32,
}

// Which photons a pass works on.
struct PhotonRun {
    // The number of the first one.
    first: u32,
    // The number of photons of each beam.
    each: u32,
    // The number of all photons.
    total: u32,
    unused: u32,
}

// Photon `index` of a beam: its share of the beam's extent and of a turn, in [0, 1), on a spiral of even density whose steps
// are the golden section of a turn (Vogel 1979). Wherever smooth mirrors throw them, such photons lie as evenly as on a
// raster.
fn spread(index: u32) -> vec2f {
    return vec2f((f32(index) + 0.5) / f32(run.each), f32((index * 2654435769u) >> 8u) / 16777216.0);
}

// How many rays of a beam there are per steradian or per area at a ray, if the beam has one.
fn density(beam: PhotonBeam, place: vec3f) -> f32 {
    let extent = beam.axis_extent.w;
    let offset = place - beam.axis_extent.xyz;
    let squared = dot(offset, offset);
    if beam.strength.w > 0.0 {
        return select(0.0, 1.0 / (3.14159265 * extent * extent), squared <= extent * extent);
    }
    // Half of the squared distance of two unit vectors is one minus their cosine.
    return select(0.0, 1.0 / (6.2831853 * extent), squared * 0.5 <= extent);
}

@compute @workgroup_size(8, 8)
fn photon_start(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let photon = run.first + pixel;
    if photon >= run.total {
        textureStore(point_out, id.xy, vec4f(0.0));
        return;
    }
    let number = photon / run.each;
    let beam = beams[number];
    let numbers = spread(photon % run.each);
    let turn = 6.2831853 * numbers.y;
    let is_sun = beam.strength.w > 0.0;
    let extent = beam.axis_extent.w;
    let middle = select(beam.axis_extent.xyz, beam.axis_outer.xyz, is_sun);
    let tangent = tangent_of(middle);
    let sideways = tangent * cos(turn) + cross(middle, tangent) * sin(turn);
    var origin = beam.position_inner.xyz;
    var direction = beam.axis_outer.xyz;
    var power = beam.strength.rgb;
    var place: vec3f;
    if is_sun {
        origin = beam.axis_extent.xyz + sideways * (extent * sqrt(numbers.x));
        place = origin;
    } else {
        let height = extent * numbers.x;
        direction = normalize(middle * (1.0 - height) + sideways * sqrt(max(height * (2.0 - height), 0.0)));
        place = direction;
        let along = dot(direction, beam.axis_outer.xyz);
        let angle = atan2(length(direction - beam.axis_outer.xyz * along), along);
        let edge = max(beam.axis_outer.w - beam.position_inner.w, 1e-6);
        power *= clamp((beam.axis_outer.w - angle) / edge, 0.0, 1.0);
    }
    var all = 0.0;
    for (var i = 0u; i < beam.count; i++) {
        all += density(beams[beam.first + i], place);
    }
    // The beam that the ray is of counts, whatever rounding says.
    all = max(all, select(1.0 / (6.2831853 * extent), 1.0 / (3.14159265 * extent * extent), is_sun));
    powers[pixel] = vec4f(power / (all * f32(run.each)), 0.0);
    textureStore(point_out, id.xy, vec4f(origin, select(0.0, 1.0, any(power > vec3f(0.0)))));
    textureStore(eye_out, id.xy, vec4f(place_before(origin, direction), 1.0));
}
