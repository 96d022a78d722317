// The upper level of hierarchical SSCR: bounds the reflected rays of each tile of 8 x 8 pixels by a beam, lets the
// nodes of a page's trees descend into it, and lists for each tile the runs of nodes that its rays may meet. A node is
// divided only while it is wider than the beam; below that, all its parts would be listed. One thread a tile.
#import frame_group
#import splat
#import surfel_tree
#import mirror_ray
#import beam

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> tops: array<Node>;
@group(1) @binding(4) var<storage, read> nodes: array<Node>;
// LIST_WORDS words a tile: the number of runs, then a place and a node for each.
@group(1) @binding(5) var<storage, read_write> lists: array<u32>;

@compute @workgroup_size(8, 8)
fn beam_lists(@builtin(global_invocation_id) id: vec3u) {
    let across = (frame.width + 7u) / 8u;
    let tile = whole_thread(frame, id).xy;
    if tile.x >= across || tile.y * 8u >= frame.height {
        return;
    }
    var beam = Beam(vec3f(3e38), vec3f(-3e38), vec3f(3e38), vec3f(-3e38));
    var is_mirror = false;
    for (var i = 0u; i < 64u; i++) {
        let pixel = tile * 8u + vec2u(i % 8u, i / 8u);
        // Beyond the picture's edge a load gives zero: no mirror.
        let point = textureLoad(point_in, pixel, 0);
        if point.w > 0.0 && pixel.x < frame.width && pixel.y < frame.height {
            let normal = textureLoad(normal_in, pixel, 0).xyz;
            let direction = reflected_direction(point.xyz, normal, textureLoad(eye_in, pixel, 0).xyz);
            beam.origin_low = min(beam.origin_low, point.xyz);
            beam.origin_high = max(beam.origin_high, point.xyz);
            beam.direction_low = min(beam.direction_low, direction);
            beam.direction_high = max(beam.direction_high, direction);
            is_mirror = true;
        }
    }
    let list = (tile.y * across + tile.x) * LIST_WORDS;
    var count = 0u;
    let top_count = select(0u, tops[0].low_skip.w, is_mirror);
    var i = 0u;
    while i < top_count {
        let top = tops[i];
        let entry = beam_entry(beam, bitcast<vec3f>(top.low_skip.xyz), bitcast<vec3f>(top.high_leaf.xyz));
        i = select(top.low_skip.w, i + 1u, entry >= 0.0);
        if entry >= 0.0 && top.high_leaf.w != INNER {
            count = list_tree(beam, top.high_leaf.w, list, count);
        }
    }
    // Too many nodes to list: the tile's rays start from the top of the tree.
    lists[list] = select(count, LIST_IS_FULL, count > LIST_RUNS);
}

fn list_tree(tile_beam: Beam, place_index: u32, list: u32, so_far: u32) -> u32 {
    let place = place_of(tops[tops[0].low_skip.w + place_index]);
    var beam = tile_beam;
    beam.origin_low -= place.origin_margin.xyz;
    beam.origin_high -= place.origin_margin.xyz;
    let margin = place.origin_margin.w;
    var count = so_far;
    var i = 0u;
    while i < place.end_node {
        let node = nodes[place.first_node + i];
        let low = bitcast<vec3f>(node.low_skip.xyz) - margin;
        let high = bitcast<vec3f>(node.high_leaf.xyz) + margin;
        let entry = beam_entry(beam, low, high);
        let extent = high - low;
        let is_listed =
            node.high_leaf.w != INNER || max(extent.x, max(extent.y, extent.z)) <= beam_width(beam, max(entry, 0.0));
        if entry >= 0.0 && is_listed {
            if count < LIST_RUNS {
                lists[list + 1u + count * 2u] = place_index;
                lists[list + 2u + count * 2u] = i;
            }
            count++;
        }
        i = select(i + 1u, node.low_skip.w, entry < 0.0 || is_listed);
    }
    return count;
}
