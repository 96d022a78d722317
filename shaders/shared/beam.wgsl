// The rays of a tile, bounded by intervals: every ray starts in a box of origins and goes along a direction in a box of
// directions. crates/render/src/reflection/beam.rs is the CPU twin.

struct Beam {
    origin_low: vec3f,
    origin_high: vec3f,
    direction_low: vec3f,
    direction_high: vec3f,
}

// The earliest distance at which a ray of the beam can enter a box; negative if no ray can. For o + t d to lie between
// low and high for some o and d of the beam, t must satisfy t d_high >= low - o_high and t d_low <= high - o_low on
// each axis. The condition is necessary, so no ray that meets the box is lost.
fn beam_entry(beam: Beam, low: vec3f, high: vec3f) -> f32 {
    let least = low - beam.origin_high;
    let most = high - beam.origin_low;
    var entry = 0.0;
    var exit = 3e38;
    var is_possible = true;
    for (var axis = 0; axis < 3; axis++) {
        let up = beam.direction_high[axis];
        let down = beam.direction_low[axis];
        // t up >= least
        if up > 0.0 {
            entry = max(entry, least[axis] / up);
        } else if up < 0.0 {
            exit = min(exit, least[axis] / up);
        } else {
            is_possible = is_possible && least[axis] <= 0.0;
        }
        // t down <= most
        if down > 0.0 {
            exit = min(exit, most[axis] / down);
        } else if down < 0.0 {
            entry = max(entry, most[axis] / down);
        } else {
            is_possible = is_possible && most[axis] >= 0.0;
        }
    }
    // Divisions round: a share far above their error keeps the bound on the safe side.
    return select(-1.0, entry, is_possible && entry <= exit * 1.00001);
}

// The extent of the beam across at a distance.
fn beam_width(beam: Beam, distance: f32) -> f32 {
    let across = (beam.origin_high - beam.origin_low) + (beam.direction_high - beam.direction_low) * distance;
    return max(across.x, max(across.y, across.z));
}
