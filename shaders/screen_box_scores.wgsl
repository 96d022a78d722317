// How well each wall of the box agrees with itself when it is moved: the mean product of its changes of brightness and
// those so many texels farther. One workgroup a number of texels, axis and wall.
#import screen_box

@group(1) @binding(0) var<storage, read> screen: Screen;
// See screen_box_edges.wgsl.
@group(1) @binding(1) var<storage, read> edges: array<f32>;
// For each wall across and down: the scores of 2, 3, ... texels.
@group(1) @binding(2) var<storage, read_write> scores: array<f32>;

const THREADS: u32 = 64u;
// Above any change.
const KNOWN: f32 = 1e8;

var<workgroup> sums: array<vec2f, THREADS>;

@compute @workgroup_size(64)
fn screen_box_scores(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    // The workgroups before those of this dispatch count.
    let whole = group.xy + vec2u(frame.first_column, frame.first_row);
    let moved = i32(whole.x) + 2;
    let wall = whole.y / 2u;
    let axis = whole.y % 2u;
    let step = select(vec2i(moved, 0), vec2i(0, moved), axis == 1u);
    let size = box_edge();
    var sum = vec2f(0.0);
    for (var i = i32(thread); i < size * size; i += i32(THREADS)) {
        let at = vec2i(i % size, i / size);
        let other = min(at + step, vec2i(size - 1));
        let pair = vec2f(
            edges[6u * axis * texels_of_wall() + index_in_box(wall, at)],
            edges[6u * axis * texels_of_wall() + index_in_box(wall, other)],
        );
        let is_pair = all(other == at + step) && all(pair < vec2f(KNOWN));
        sum += select(vec2f(0.0), vec2f(pair.x * pair.y, 1.0), is_pair);
    }
    sums[thread] = sum;
    workgroupBarrier();
    if thread == 0u {
        var all_sums = vec2f(0.0);
        for (var i = 0u; i < THREADS; i++) {
            all_sums += sums[i];
        }
        // A row of pairs says nothing.
        let is_told = all_sums.y >= 2.0 * f32(size);
        scores[whole.y * frame.columns + whole.x] = select(0.0, all_sums.x / max(all_sums.y, 1.0), is_told);
    }
}
