// Sample-based cameras: empties the divided squares of one level that have a bundle in none of their parts, so that no
// point descends into them. One thread a square.
#import frame_group
#import bundle

@group(1) @binding(0) var<uniform> grid: BundleGrid;
@group(1) @binding(1) var<storage, read_write> nodes: array<BundleNode>;

@compute @workgroup_size(64)
fn bundle_prune(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.y * groups.x * 64u + id.x;
    if index >= (grid.columns * grid.rows) << (2u * grid.level) {
        return;
    }
    let node = first_of_level(grid, grid.level) + index;
    let first = first_of_level(grid, grid.level + 1u) + 4u * index;
    var has_bundle = nodes[node].origin_low.w != NODE_DIVIDED;
    for (var part = first; part < first + 4u && !has_bundle; part++) {
        has_bundle = nodes[part].origin_low.w != NODE_EMPTY;
    }
    if !has_bundle {
        nodes[node].origin_low.w = NODE_EMPTY;
    }
}
