// Screen-space curved reflections (Preiner 2010, sections 3.4 and 4.5): draws a region for each point and searches it
// for the pixel that reflects the point. The result is kept for the passes that splat it. One workgroup a block of
// points.
#import blocks
#import counters
#import mirror_space
#import mirror_splat
#import region
#import root_finding

@group(2) @binding(0) var<uniform> round: Round;
@group(2) @binding(1) var<storage, read> mirror_pixels: array<MirrorPixel>;
@group(2) @binding(2) var<storage, read> regions: array<Region>;
// Indexed by point of the page. In: where the point was found last.
@group(2) @binding(3) var<storage, read_write> solutions: array<Solution>;
@group(2) @binding(4) var<storage, read_write> counters: array<atomic<u32>>;
// ENDING_WORDS words a pixel. Then, from a multiple of ENDING_ALIGNMENT words on, for each item, whether its chunk is
// searched for, see sscr_cull.wgsl.
@group(2) @binding(5) var<storage, read_write> endings: array<atomic<u32>>;

struct Round {
    // The number of this draw among a point's draws of a region.
    draw: u32,
    // The seed of the random numbers.
    seed: u32,
}

override cull: bool = false;
override cull_chunks: bool = false;
override count_points: bool = true;
// Set for reflections after the first.
override is_later: bool = false;
override record_endings: bool = false;

var<workgroup> tried: atomic<u32>;
var<workgroup> found: atomic<u32>;
var<workgroup> unconverged: atomic<u32>;

@compute @workgroup_size(128)
fn sscr_solve(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_block(group, groups, lane);
    if count_points {
        workgroupBarrier();
        if lane == 0u {
            atomicAdd(&counters[POINTS_TRIED], atomicLoad(&tried));
            atomicAdd(&counters[POINTS_FOUND], atomicLoad(&found));
            atomicAdd(&counters[POINTS_UNCONVERGED], atomicLoad(&unconverged));
        }
    }
}

fn splat_point(item: Item, walked: u32) {
    let pick = pick_of(walked);
    let index = pick.index;
    let point = points[index];
    let last = solutions[index];
    var solution = Solution(0u, 0.0);
    let q = bitcast<vec3f>(point.xyz) + item.origin_radius.xyz;
    let is_point = is_place(point.xyz) && dot(q, q) < 3e38;
    if regions[0].regions > 0u && pick.is_searched && is_point && is_shown(index) {
        let identity = identities_from + index;
        var last_at = vec2f(-1.0);
        var label = drawn_label(identity, round.draw);
        if seeds == SSCR_SEEDS_LAST_FRAME && last.place != 0u {
            let at = unpack_place(last.place);
            let last_label = label_at(at);
            if last_label != 0u {
                last_at = at;
                label = last_label;
            }
        }
        var region = regions[label];
        let is_reached = !cull_chunks || is_chunk_reached();
        var is_searched = is_reached && (!cull || may_reflect(region, q, 0.0));
        for (var draws = 1u; draws <= REDRAWS && is_reached && !is_searched; draws++) {
            label = drawn_label(identity, round.draw + draws * REDRAW);
            region = regions[label];
            is_searched = may_reflect(region, q, 0.0);
        }
        let extent = vec2f(vec2u(region.last_x - region.first_x, region.last_y - region.first_y) + 1u);
        let fill = f32(region.pixels) / (extent.x * extent.y);
        let search = Search(label, vec2f(vec2u(region.first_x, region.first_y)), extent, fill, q);
        var outcome = Outcome(vec2f(0.0), LOST, 0u);
        // A loop of at most one turn: software rasterisers run both sides of a branch.
        for (var turn = 0u; turn < 1u && is_searched; turn++) {
            var state = hash(identity ^ round.seed);
            outcome = find_root(search, start_of(search, last_at), &state);
            outcome.state = select(outcome.state, FOUND, shows_search && outcome.state == UNCONVERGED);
        }
        if outcome.state == FOUND {
            solution = solution_at(item, index, q, label, outcome.at);
        }
        if record_endings && outcome.steps > 0u {
            let size = vec2u(frame.width, frame.height);
            let ended = min(vec2u(max(outcome.at, vec2f(0.0))), size - 1u);
            let word = (ended.y * frame.width + ended.x) * ENDING_WORDS;
            atomicAdd(&endings[word], 1u);
            atomicAdd(&endings[word + 1u], outcome.steps);
            atomicAdd(&endings[word + 2u], select(0u, 1u, outcome.state == UNCONVERGED));
        }
        if count_points {
            atomicAdd(&tried, 1u);
            atomicAdd(&found, select(0u, 1u, solution.distance > 0.0));
            atomicAdd(&unconverged, select(0u, 1u, outcome.state == UNCONVERGED));
        }
    }
    // Points that are not found now keep the place of an earlier frame.
    if solution.distance == 0.0 && seeds == SSCR_SEEDS_LAST_FRAME {
        solution.place = last.place;
    }
    solutions[index] = solution;
}

fn is_chunk_reached() -> bool {
    let words = frame.width * frame.height * ENDING_WORDS;
    let first = (words + ENDING_ALIGNMENT - 1u) / ENDING_ALIGNMENT * ENDING_ALIGNMENT;
    return atomicLoad(&endings[first + item_of_block]) != 0u;
}

struct Pick {
    index: u32,
    is_searched: bool,
}

// Each block searches for the first points of one order, in which any number of them lies evenly over the block
// (multiples of the golden ratio; a van der Corput sequence would agree with the regions that are drawn for the points):
// so more points add to fewer, as from a later bounce to the one before. The points of a whole block are walked in
// this order, so that those that are searched for keep whole rounds of the workgroup busy.
fn pick_of(walked: u32) -> Pick {
    let share = share_of_points();
    let most = u32(ceil(min(share, 1.0) * f32(BLOCK_POINTS)));
    let place = walked % BLOCK_POINTS;
    let is_turned = share < 1.0 && points_of_block == BLOCK_POINTS;
    let other = select(place, (place * BACK) % BLOCK_POINTS, is_turned);
    let rank = select((place * ORDER) % BLOCK_POINTS, place, is_turned);
    return Pick(walked - place + other, rank < most);
}

// BLOCK_POINTS over the golden ratio, and its inverse: their product is 1 modulo BLOCK_POINTS.
const ORDER: u32 = 633u;
const BACK: u32 = 969u;

// As many points a mirror pixel, however large the mirror is; where all points are taken, later reflections take as many a
// pixel as the first.
fn share_of_points() -> f32 {
    if settings.sscr.point_share >= 1.0 {
        return select(1.0, f32(regions[0].pixels) / max(f32(regions[0].first_pixels), 1.0), is_later);
    }
    let covered = f32(regions[0].pixels) / f32(frame.width * frame.height);
    return settings.sscr.point_share * covered / USUAL_COVER;
}

// The share of the picture that mirrors cover in the published scenes.
const USUAL_COVER: f32 = 0.1;

// How often a region is drawn anew for a point that no ray of its region can meet: on the five mirrors, more find nothing.
const REDRAWS: u32 = 4u;
// From one of these draws to the next: more than there are rounds, so that no round draws what another has drawn.
const REDRAW: u32 = 4099u;

// The label of the region in which a point is tried: drawn in proportion to the regions' pixels with a Halton number
// (section 4.5.1). The paper sorts the regions by size first; drawing from the running sum is the same in
// any order.
fn drawn_label(identity: u32, draw: u32) -> u32 {
    // Draws differ by the golden ratio, which spreads any number of them evenly: a product of integers wraps where one
    // of floats would run out of digits.
    let apart = f32((draw * 2654435769u) >> 8u) / 16777216.0;
    let number = fract(halton(identity) + apart);
    let place = min(u32(number * f32(regions[0].pixels)), regions[0].pixels - 1u);
    var low = 1u;
    var high = regions[0].regions;
    while low < high {
        let middle = (low + high) / 2u;
        if regions[middle].accumulated <= place {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low;
}

fn label_at(at: vec2f) -> u32 {
    let pixel = vec2u(at);
    if pixel.x >= frame.width || pixel.y >= frame.height {
        return 0u;
    }
    return mirror_pixels[pixel.y * frame.width + pixel.x].point_label.w;
}

fn probe(search: Search, at: vec2f) -> Probe {
    let size = vec2f(f32(frame.width), f32(frame.height));
    let is_in = all(at >= vec2f(0.0)) && all(at < size);
    let place = vec2u(select(vec2f(0.0), at, is_in));
    let pixel = mirror_pixels[place.y * frame.width + place.x];
    let is_inside = is_in && pixel.point_label.w == search.label;
    let reflected = reflected_in_mirror_space(pixel, frame.right.xyz, search.q);
    if solver == SSCR_SOLVER_INTERLEAVED {
        return Probe(at, mirror_space_error(reflected), is_inside);
    }
    return Probe(at, mapped_error(reflected), is_inside);
}

// The root to keep: none if the point is behind the mirror, or belongs to the mirror itself beside it. The listing also
// leaves out points that turn their back; clouds are drawn from both sides, and so the text's points are reflected.
fn solution_at(item: Item, index: u32, q: vec3f, label: u32, at: vec2f) -> Solution {
    if any(at < vec2f(0.0)) || label_at(at) != label {
        return Solution(0u, 0.0);
    }
    let pixel = mirror_pixels[u32(at.y) * frame.width + u32(at.x)];
    let offset = q - bitcast<vec3f>(pixel.point_label.xyz);
    let reach = length(offset);
    let own_radius = unpack_radius(points[index].w & 0xffffu);
    let radius = select(own_radius, item.origin_radius.w, own_radius == 0.0) * settings.splat.size;
    if dot(offset, bitcast<vec3f>(pixel.normal_eye.xyz)) <= 0.0 || reach <= OWN_SURFACE_RADII * radius {
        return Solution(0u, 0.0);
    }
    // A point without a normal has no back.
    let turns_back = dot(unpack_normal(attributes[index].y), offset) > 0.0;
    if settings.sscr.reading == SSCR_READING_LISTING && solver == SSCR_SOLVER_INTERLEAVED && turns_back {
        return Solution(0u, 0.0);
    }
    return Solution(pack_place(at), reach);
}
