// The mirrors of the scene, each with a picture of its surroundings (a map). Filled by
// crates/render/src/reflection/mirror_places.rs. The importing pass binds them as `mirrors`.

struct MappedMirror {
    // xyz: lower corner of its box, relative to the eye. w: number of its map; below 0 if nothing is seen in it.
    low_map: vec4f,
    // xyz: upper corner.
    high: vec4f,
    // The viewpoint of the map, relative to the eye: for an environment map a place, w: its texels along an edge; for a
    // mirrored viewpoint a plane, as its unit normal and its product with a place on it.
    view: vec4f,
}

struct MappedMirrors {
    // xyz: corners of the box about all points, relative to the eye.
    scene_low: vec4f,
    scene_high: vec4f,
    places: array<MappedMirror>,
}

// The mirror on which a place lies: the one whose box is nearest, and among boxes that contain the place the smallest.
fn mirror_at(place: vec3f) -> MappedMirror {
    var best = mirrors.places[0];
    var best_distance = 3e38;
    var best_extent = 3e38;
    for (var i = 0u; i < arrayLength(&mirrors.places); i++) {
        let mirror = mirrors.places[i];
        let outside = max(max(mirror.low_map.xyz - place, place - mirror.high.xyz), vec3f(0.0));
        let distance = dot(outside, outside);
        let extent = length(mirror.high.xyz - mirror.low_map.xyz);
        if distance < best_distance || (distance == best_distance && extent < best_extent) {
            best = mirror;
            best_distance = distance;
            best_extent = extent;
        }
    }
    return best;
}
