// The periods of the walls of the box: the first number of texels at which a wall agrees with itself better than at its
// neighbours, and by half more than the mean. One thread an axis and wall.
#import screen_box

@group(1) @binding(0) var<storage, read> screen: Screen;
// See screen_box_scores.wgsl.
@group(1) @binding(1) var<storage, read> scores: array<f32>;
// See screen_box_edges.wgsl.
@group(1) @binding(2) var<storage, read_write> periods: array<u32>;

// How much better than the mean.
const LEAST_RATIO: f32 = 1.5;

@compute @workgroup_size(1)
fn screen_box_periods(@builtin(workgroup_id) group: vec3u) {
    let count = settings.screen_trace.box_size / 2u - 1u;
    let first = group.x * count;
    var sum = 0.0;
    for (var i = 0u; i < count; i++) {
        sum += abs(scores[first + i]);
    }
    var period = 0u;
    for (var i = 1u; i + 1u < count && period == 0u; i++) {
        let score = scores[first + i];
        let is_peak = score > scores[first + i - 1u] && score >= scores[first + i + 1u];
        if is_peak && score * f32(count) > LEAST_RATIO * sum {
            period = i + 2u;
        }
    }
    periods[group.x] = period;
}
