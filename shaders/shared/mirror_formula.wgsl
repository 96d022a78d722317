// Mirrors by their formulas (crates/scene/src/mirror.rs): where a ray meets them, and the normal there. Filled by
// crates/render/src/reflection/formula.rs.

struct FormulaMirror {
    // The rows of the rotation from world axes to the mirror's own. w of the first: the shape; of the second: its
    // parameter; of the third: the size in world units.
    x_kind: vec4f,
    y_parameter: vec4f,
    z_size: vec4f,
    // xyz: position relative to the eye. w: radius in world units of a sphere about it that contains the whole mirror.
    position_reach: vec4f,
    // rgb: linear albedo. a: specular intensity.
    color_intensity: vec4f,
    specular_power: f32,
    // The index of refraction; 0 where no light goes through.
    refraction: f32,
    // 1 for a mirror that is drawn as points: only its inside follows the formula.
    as_points: u32,
    // The number of its method among those of a frame that has several.
    part: u32,
}
const PLANE: f32 = 0.0;
const SPHERE: f32 = 1.0;
const PARABOLOID: f32 = 2.0;
const CYLINDER: f32 = 3.0;
const TORUS: f32 = 4.0;
const BLOB: f32 = 5.0;
const CORAL: f32 = 6.0;

struct FormulaHit {
    // The distance along the ray in world units; 0 for a miss.
    distance: f32,
    // The normal in world axes, on either side.
    normal: vec3f,
}

// The distance from a mirror, in mirror sizes, at which rays leave it: rounding puts the mirror point a little in or
// out.
const LEAVE: f32 = 1e-3;

// `origin` is relative to the eye, `direction` has unit length. Hits nearer than `least` (world units) do not count.
fn formula_hit(mirror: FormulaMirror, origin: vec3f, direction: vec3f, least: f32) -> FormulaHit {
    let miss = FormulaHit(0.0, vec3f(0.0));
    let size = mirror.z_size.w;
    let offset = origin - mirror.position_reach.xyz;
    // The part of the ray within reach.
    let along = -dot(offset, direction);
    let across = offset + direction * along;
    let half_squared = mirror.position_reach.w * mirror.position_reach.w - dot(across, across);
    let half = sqrt(max(half_squared, 0.0));
    let begin = max(along - half, least) / size;
    let end = (along + half) / size;
    if half_squared <= 0.0 || end <= begin {
        return miss;
    }
    // From here on in the mirror's own axes, its size being 1. The origin is moved to the ray's middle: far eyes cost digits.
    let x = mirror.x_kind.xyz;
    let y = mirror.y_parameter.xyz;
    let z = mirror.z_size.xyz;
    let shift = along / size;
    let o = vec3f(dot(across, x), dot(across, y), dot(across, z)) / size;
    let d = vec3f(dot(direction, x), dot(direction, y), dot(direction, z));
    let hit = shape_hit(mirror.x_kind.w, mirror.y_parameter.w, o, d, begin - shift, end - shift);
    if hit.distance <= begin - shift {
        return miss;
    }
    let normal = x * hit.normal.x + y * hit.normal.y + z * hit.normal.z;
    return FormulaHit((hit.distance + shift) * size, normalize(normal));
}

// The first hit between begin and end, in the mirror's own coordinates; at `begin` for a miss.
fn shape_hit(kind: f32, parameter: f32, o: vec3f, d: vec3f, begin: f32, end: f32) -> FormulaHit {
    let miss = FormulaHit(begin, vec3f(0.0));
    if kind == PLANE {
        let t = -o.z / d.z;
        let p = o + d * t;
        let inside = t > begin && abs(p.x) <= 1.0 && abs(p.y) <= parameter;
        return FormulaHit(select(begin, t, inside), vec3f(0.0, 0.0, 1.0));
    }
    if kind == SPHERE {
        let roots = quadratic(1.0, dot(o, d), dot(o, o) - 1.0);
        let t = first_after(roots, begin);
        return FormulaHit(t, o + d * t);
    }
    if kind == PARABOLOID || kind == CYLINDER {
        // x^2 + y^2 = 4 f z inside the rim; x^2 + y^2 = 1 between both ends.
        let is_bowl = kind == PARABOLOID;
        let slope = select(0.0, 2.0 * parameter, is_bowl);
        let rest = dot(o.xy, o.xy) - select(1.0, 2.0 * slope * o.z, is_bowl);
        let roots = quadratic(dot(d.xy, d.xy), dot(o.xy, d.xy) - slope * d.z, rest);
        for (var i = 0; i < 2; i++) {
            let t = roots[i];
            let p = o + d * t;
            let is_within = select(abs(p.z) <= parameter, dot(p.xy, p.xy) <= 1.0, is_bowl);
            if t > begin && t < 3e38 && is_within {
                return FormulaHit(t, vec3f(-p.xy, slope));
            }
        }
        return miss;
    }
    // By steps that cannot pass the surface, then by bisection of the last one. Mesa writes out loops whose length it
    // knows, and processors then run all rounds under a mask, for mirrors of other shapes, too.
    let rounds = select(0, 20, kind > CYLINDER);
    var t = begin;
    var step = 0.0;
    let start = implicit(kind, parameter, o + d * begin);
    for (var i = 0; i < MOST_STEPS && t < end; i++) {
        let value = implicit(kind, parameter, o + d * t);
        if value * start < 0.0 {
            break;
        }
        step = max(abs(value), SHORTEST_STEP);
        t += step;
    }
    if t >= end || implicit(kind, parameter, o + d * t) * start > 0.0 {
        return miss;
    }
    var before = t - step;
    for (var i = 0; i < rounds; i++) {
        let middle = (before + t) * 0.5;
        let is_before = implicit(kind, parameter, o + d * middle) * start > 0.0;
        before = select(before, middle, is_before);
        t = select(middle, t, is_before);
    }
    let p = o + d * t;
    // Central differences: the gradients of the star shapes have longer formulas, which are no more exact in 32 bits.
    var normal = vec3f(0.0);
    for (var axis = 0; axis < min(rounds, 3); axis++) {
        let e = 2e-3 * vec3f(vec3i(axis) == vec3i(0, 1, 2));
        let slope = implicit(kind, parameter, p + e) - implicit(kind, parameter, p - e);
        normal = select(normal, vec3f(slope), vec3i(axis) == vec3i(0, 1, 2));
    }
    return FormulaHit(t, normal);
}

const MOST_STEPS: i32 = 400;
// A grazing ray may slip through parts thinner than this, a three-hundredth of the mirror.
const SHORTEST_STEP: f32 = 3e-3;

// Negative inside or behind. For torus, blob and coral its absolute value is no more than the distance to the surface.
fn implicit(kind: f32, parameter: f32, p: vec3f) -> f32 {
    if kind == PLANE {
        return p.z;
    }
    if kind == SPHERE {
        return length(p) - 1.0;
    }
    if kind == PARABOLOID {
        return p.z - dot(p.xy, p.xy) / (4.0 * parameter);
    }
    if kind == CYLINDER {
        return length(p.xy) - 1.0;
    }
    if kind == TORUS {
        return length(vec2f(length(p.xy) - 1.0, p.z)) - parameter;
    }
    let r = length(p);
    let q = p / max(r, 1e-6);
    // Processors compute both branches of a choice, and sines cost most of it: both shapes share them.
    let is_blob = kind == BLOB;
    let x = sin(select(19.0 * q.x, 6.0 * q.x + 1.0, is_blob));
    let y = sin(select(17.0 * q.y, 5.0 * q.y, is_blob));
    let z = sin(select(23.0 * q.z, 7.0 * q.z, is_blob));
    if is_blob {
        // |grad| <= sqrt(1 + (0.6 + 0.5)^2 + ...) < 1.8 where r >= 0.8
        return (r - (1.0 + 0.10 * x * y + 0.06 * z)) / 1.8;
    }
    // |grad| <= sqrt(1 + (1.84 + 1.23)^2) < 3.6 where r >= 0.89
    return (r - (1.0 + 0.08 * x * y * z + 0.03 * sin(41.0 * q.x + 3.0 * q.y))) / 3.6;
}

// The mirror's implicit function at a point; its absolute value is about the distance in mirror sizes.
fn value_at(mirror: FormulaMirror, point: vec3f) -> f32 {
    let offset = (point - mirror.position_reach.xyz) / mirror.z_size.w;
    let p = vec3f(dot(offset, mirror.x_kind.xyz), dot(offset, mirror.y_parameter.xyz), dot(offset, mirror.z_size.xyz));
    return implicit(mirror.x_kind.w, mirror.y_parameter.w, p);
}

// The distance that a ray from a point must go before it can meet the mirror; small if the point lies on it.
fn leave(mirror: FormulaMirror, point: vec3f) -> f32 {
    let lies_on_it = abs(value_at(mirror, point)) < LEAVE;
    return select(0.0, LEAVE * mirror.z_size.w, lies_on_it);
}

// The roots of a t^2 + 2 b t + c, smaller first; 3e38 if there are none.
fn quadratic(a: f32, b: f32, c: f32) -> vec2f {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        return vec2f(3e38);
    }
    // The form that does not cancel.
    let q = -(b + select(-1.0, 1.0, b >= 0.0) * sqrt(discriminant));
    let first = select(3e38, q / a, abs(a) > 1e-12);
    let second = select(3e38, c / q, abs(q) > 0.0);
    return vec2f(min(first, second), max(first, second));
}

fn first_after(roots: vec2f, begin: f32) -> f32 {
    let first = select(roots.y, roots.x, roots.x > begin);
    return select(begin, first, first > begin && first < 3e38);
}
