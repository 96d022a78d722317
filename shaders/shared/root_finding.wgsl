// Search for the pixel of a region in which a point is reflected: the root of the mirror-space error. The published search is
// interleaved bracketing and bisection (Preiner 2010, section 3.4.3, algorithm 3.1); the others take the slope of the error
// from neighbouring pixels, so the direction of the root lines on the screen does not matter to them.
// The importing pass defines `probe(search, at)`. CPU twin of interleaved and newton from random starts:
// crates/render/src/reflection/sscr/twin.rs.
#import hash
#import params

override solver: u32 = SSCR_SOLVER_INTERLEAVED;
override seeds: u32 = SSCR_SEEDS_RANDOM;
override per_region: bool = false;
// Whether points are shown where their search stands after some steps.
override shows_search: bool = false;

struct Search {
    // The bounds of the region.
    label: u32,
    first: vec2f,
    extent: vec2f,
    // The share of the pixels in its bounds that are its own.
    fill: f32,
    // The point, relative to the camera's eye.
    q: vec3f,
}

// A pixel coordinate, centres at halves, and the error there.
struct Probe {
    at: vec2f,
    error: vec2f,
    // Whether it is in the region.
    is_inside: bool,
}

const FOUND: u32 = 0u;
// The search left the region, or its steps became too small.
const LOST: u32 = 1u;
// The search ran out of steps.
const UNCONVERGED: u32 = 2u;

struct Outcome {
    // The pixel coordinate of the result, or where the search ended.
    at: vec2f,
    state: u32,
    steps: u32,
}

// Where the search starts: two pixel coordinates, or ANYWHERE in the region.
struct Start {
    first: vec2f,
    second: vec2f,
    step: vec2f,
}

const ANYWHERE: vec2f = vec2f(-1.0);

fn random(state: ptr<function, u32>) -> f32 {
    *state = hash(*state);
    return f32(*state >> 8u) / 16777216.0;
}

// Halton's sequence in base 2.
fn halton(index: u32) -> f32 {
    return f32(reverseBits(index) >> 8u) / 16777216.0;
}

// A step below this stays in its pixel more often than not (section 3.4.3 ends where "the step size fell below 1 pixel").
const LEAST_STEP: f32 = 0.5;
// The cells along each side of the grid of start pixels: 16 probes cost about as much as a search from a bad start.
const GRID: u32 = 4u;

fn random_place(search: Search, state: ptr<function, u32>) -> vec2f {
    let x = random(state);
    let y = random(state);
    return search.first + search.extent * vec2f(x, y);
}

// The number of steps after which a search ends.
fn most_steps() -> u32 {
    return select(settings.sscr.max_steps, min(settings.sscr.max_steps, settings.sscr.search_steps), shows_search);
}

// How often a start pixel outside the region is drawn again.
fn seed_attempts(search: Search) -> u32 {
    if per_region {
        // Often enough that one start in a hundred is lost to the holes of the region.
        return u32(clamp(log2(0.01) / log2(clamp(1.0 - search.fill, 1e-3, 0.999)), 1.0, 32.0));
    }
    return settings.sscr.seed_attempts;
}

fn random_seed(search: Search, state: ptr<function, u32>) -> Probe {
    var found = Probe(vec2f(0.0), vec2f(0.0), false);
    for (var attempt = 0u; attempt <= seed_attempts(search) && !found.is_inside; attempt++) {
        found = probe(search, random_place(search, state));
    }
    return found;
}

fn start_of(search: Search, last: vec2f) -> Start {
    var start = Start(ANYWHERE, ANYWHERE, search.extent * settings.sscr.initial_step);
    if per_region {
        // In regions a few pixels wide a share of the extent is no step at all.
        start.step = max(start.step, vec2f(settings.sscr.threshold));
    }
    if seeds == SSCR_SEEDS_LAST_FRAME && last.x >= 0.0 {
        // Between two frames the root moves by a few pixels.
        let side = select(vec2f(-2.0), vec2f(2.0), last < search.first + search.extent * 0.5);
        return Start(last, last + side, vec2f(2.0));
    }
    if seeds == SSCR_SEEDS_GRID {
        // The two best cells; anywhere, if holes of the region swallow the grid.
        var least = 3e38;
        var second_least = 3e38;
        for (var cell = 0u; cell < GRID * GRID; cell++) {
            let place = (vec2f(vec2u(cell % GRID, cell / GRID)) + 0.5) / f32(GRID);
            let found = probe(search, search.first + search.extent * place);
            let error = squared_error(found);
            if error < least {
                start.second = start.first;
                second_least = least;
                start.first = found.at;
                least = error;
            } else if error < second_least {
                start.second = found.at;
                second_least = error;
            }
        }
    }
    return start;
}

// The probe after `origin` by `step`, or by as many halves of it as are allowed until it stays in the region.
fn probe_after(search: Search, origin: vec2f, step: vec2f) -> Probe {
    var shortened = step;
    var found = probe(search, origin + shortened);
    for (var attempt = 0u; attempt < settings.sscr.step_attempts && !found.is_inside; attempt++) {
        shortened *= 0.5;
        found = probe(search, origin + shortened);
    }
    return found;
}

fn find_root(search: Search, start: Start, state: ptr<function, u32>) -> Outcome {
    if solver == SSCR_SOLVER_INTERLEAVED {
        return interleaved(search, start, state);
    }
    var first = probe(search, start.first);
    if !first.is_inside {
        first = random_seed(search, state);
    }
    if !first.is_inside {
        return Outcome(vec2f(0.0), LOST, 0u);
    }
    if solver == SSCR_SOLVER_NELDER_MEAD {
        return nelder_mead(search, first, start.step);
    }
    return descent(search, first, start.step, state);
}

// Interleaved bracketing and bisection. Two pixels, the last two of a walk: along each axis it goes on while the error
// falls, turns round where it grows, and turns with half the step where the error changes its sign. One probe a turn of
// the loop, of a start pixel, a step or a shortened step: threads that run in step wait for each other by probes, not
// by steps.
fn interleaved(search: Search, start: Start, state: ptr<function, u32>) -> Outcome {
    var p1 = Probe(vec2f(0.0), vec2f(0.0), false);
    var p2 = p1;
    var step = start.step;
    var dir = vec2f(1.0);
    var shortened = vec2f(0.0);
    var given = start.first;
    var attempts = 0u;
    var steps = 0u;
    var outcome = UNCONVERGED;
    var is_over = false;
    while !is_over {
        var at = p2.at + shortened;
        if !p2.is_inside {
            at = given;
            if attempts > 0u || given.x < 0.0 {
                at = random_place(search, state);
            }
        }
        let found = probe(search, at);
        if !found.is_inside {
            shortened *= 0.5;
            attempts++;
            if attempts > select(seed_attempts(search), settings.sscr.step_attempts, p2.is_inside) {
                outcome = LOST;
                is_over = true;
            }
        } else if !p1.is_inside {
            p1 = found;
            given = start.second;
            attempts = 0u;
        } else {
            if p2.is_inside {
                p1 = p2;
                steps++;
            } else {
                // The text begins towards the second pixel, the listing towards (1, 1).
                let begins_left = found.at < p1.at & vec2<bool>(settings.sscr.reading == SSCR_READING_TEXT);
                dir = select(vec2f(1.0), vec2f(-1.0), begins_left);
            }
            p2 = found;
            attempts = 0u;
            let crossed = p1.error * p2.error < vec2f(0.0);
            let is_near = distance(p1.at, p2.at) < settings.sscr.threshold;
            let turned = crossed | (abs(p2.error) >= abs(p1.error));
            dir = select(dir, -dir, turned);
            step = select(step, step * 0.5, crossed);
            shortened = dir * step;
            if is_near && all(crossed) {
                let share = abs(p1.error) / (abs(p1.error) + abs(p2.error));
                p2.at = p1.at + (p2.at - p1.at) * share;
                outcome = FOUND;
                is_over = true;
            } else if steps >= most_steps() {
                is_over = true;
            } else if (is_near && settings.sscr.reading == SSCR_READING_LISTING) || max(step.x, step.y) < LEAST_STEP {
                outcome = LOST;
                is_over = true;
            }
        }
    }
    return Outcome(p2.at, outcome, steps);
}

// The change of the error over a pixel along x and along y.
struct Slope {
    along_x: vec2f,
    along_y: vec2f,
    // Whether the region has the neighbours that are needed.
    is_known: bool,
}

fn slope_at(search: Search, here: Probe) -> Slope {
    var side = vec2f(1.0);
    var x = probe(search, here.at + vec2f(1.0, 0.0));
    if !x.is_inside {
        side.x = -1.0;
        x = probe(search, here.at - vec2f(1.0, 0.0));
    }
    var y = probe(search, here.at + vec2f(0.0, 1.0));
    if !y.is_inside {
        side.y = -1.0;
        y = probe(search, here.at - vec2f(0.0, 1.0));
    }
    return Slope((x.error - here.error) * side.x, (y.error - here.error) * side.y, x.is_inside && y.is_inside);
}

// The step to the root of the plane through an error with a slope; huge where the plane is level.
fn newton_step(slope: Slope, error: vec2f) -> vec2f {
    let determinant = slope.along_x.x * slope.along_y.y - slope.along_y.x * slope.along_x.y;
    let step = vec2f(
        slope.along_y.x * error.y - slope.along_y.y * error.x,
        slope.along_x.y * error.x - slope.along_x.x * error.y
    );
    return step / select(determinant, 1e-20, abs(determinant) < 1e-20);
}

// A root within one pixel of a pixel's centre, by the slope there, counts as found: pixels are no more precise.
const ROOT_REACH: f32 = 1.0;

// Newton, Broyden and conjugate gradient: from pixel centre to pixel centre by steps of at most the first step's
// length. If no step stays in the region they start anew: walks from a bad start end at its rim.
fn descent(search: Search, start: Probe, first_step: vec2f, state: ptr<function, u32>) -> Outcome {
    var here = centered(start);
    var slope = slope_at(search, here);
    var direction = vec2f(0.0);
    var gradient = vec2f(0.0);
    var restarts = 0u;
    let longest = max(first_step, vec2f(1.0));
    var outcome = Outcome(here.at, UNCONVERGED, 0u);
    while outcome.state == UNCONVERGED && outcome.steps < most_steps() {
        var step = newton_step(slope, here.error);
        if solver == SSCR_SOLVER_BROYDEN && all(abs(step) <= vec2f(ROOT_REACH)) {
            // The slope learned on the way may be wrong here.
            slope = slope_at(search, here);
            step = newton_step(slope, here.error);
        }
        if slope.is_known && all(abs(step) <= vec2f(ROOT_REACH)) {
            outcome.at = here.at + step;
            outcome.state = FOUND;
        } else {
            if solver == SSCR_SOLVER_CONJUGATE_GRADIENT {
                // The gradient of half the squared error, with Polak and Ribiere's weight, started anew where it turns
                // negative. The length is that to the minimum along the direction if the slope stays the same.
                let steepest = vec2f(dot(slope.along_x, here.error), dot(slope.along_y, here.error));
                let weight = dot(steepest, steepest - gradient) / max(dot(gradient, gradient), 1e-20);
                direction = -steepest + direction * max(weight, 0.0);
                gradient = steepest;
                let change = slope.along_x * direction.x + slope.along_y * direction.y;
                step = direction * (-dot(here.error, change) / max(dot(change, change), 1e-20));
            }
            let excess = abs(step) / longest;
            step /= max(max(excess.x, excess.y), 1.0);
            // At least to the next pixel.
            step *= max(1.0, 1.0 / max(max(abs(step.x), abs(step.y)), 1e-20));
            var next = centered(probe_after(search, here.at, step));
            let moved = next.at - here.at;
            let is_stuck = !slope.is_known || !next.is_inside || dot(moved, moved) == 0.0;
            if is_stuck {
                restarts++;
                next = centered(random_seed(search, state));
                direction = vec2f(0.0);
                gradient = vec2f(0.0);
            }
            if solver == SSCR_SOLVER_BROYDEN && !is_stuck {
                // The least change of the slope that explains the error at the new pixel.
                let predicted = slope.along_x * moved.x + slope.along_y * moved.y;
                let surprise = (next.error - here.error - predicted) / dot(moved, moved);
                slope.along_x += surprise * moved.x;
                slope.along_y += surprise * moved.y;
            } else {
                slope = slope_at(search, next);
            }
            here = next;
            outcome.at = here.at;
            outcome.steps++;
            let goes_on = here.is_inside && restarts <= settings.sscr.seed_attempts;
            outcome.state = select(LOST, UNCONVERGED, goes_on);
        }
    }
    return outcome;
}

// The whole pixel has the error of its centre.
fn centered(found: Probe) -> Probe {
    return Probe(floor(found.at) + 0.5, found.error, found.is_inside);
}

fn squared_error(found: Probe) -> f32 {
    return select(3e38, dot(found.error, found.error), found.is_inside);
}

// The simplex of Nelder and Mead 1965 on the squared error, which is infinite outside the region.
fn nelder_mead(search: Search, start: Probe, first_step: vec2f) -> Outcome {
    var best = start;
    var middle = probe_after(search, best.at, vec2f(first_step.x, 0.0));
    var worst = probe_after(search, best.at, vec2f(0.0, first_step.y));
    var outcome = Outcome(best.at, UNCONVERGED, 0u);
    while outcome.state == UNCONVERGED && outcome.steps < most_steps() {
        // In order of their errors.
        if squared_error(middle) < squared_error(best) {
            let swapped = best;
            best = middle;
            middle = swapped;
        }
        if squared_error(worst) < squared_error(middle) {
            let swapped = middle;
            middle = worst;
            worst = swapped;
        }
        if squared_error(middle) < squared_error(best) {
            let swapped = best;
            best = middle;
            middle = swapped;
        }
        outcome.at = best.at;
        if max(distance(best.at, middle.at), distance(best.at, worst.at)) < 1.0 {
            outcome.state = LOST;
        } else {
            let center = (best.at + middle.at) * 0.5;
            let away = center - worst.at;
            let reflected = probe(search, center + away);
            var next = reflected;
            if squared_error(reflected) < squared_error(best) {
                let further = probe(search, center + away * 2.0);
                if squared_error(further) < squared_error(reflected) {
                    next = further;
                }
            } else if squared_error(reflected) >= squared_error(middle) {
                let is_better = squared_error(reflected) < squared_error(worst);
                next = probe(search, center + away * select(-0.5, 0.5, is_better));
                if squared_error(next) >= min(squared_error(worst), squared_error(reflected)) {
                    middle = probe(search, (best.at + middle.at) * 0.5);
                    next = probe(search, (best.at + worst.at) * 0.5);
                }
            }
            worst = next;
            outcome.steps++;
        }
    }
    let here = probe(search, floor(outcome.at) + 0.5);
    let slope = slope_at(search, here);
    let step = newton_step(slope, here.error);
    if outcome.state == LOST && slope.is_known && all(abs(step) <= vec2f(ROOT_REACH)) {
        outcome.at = here.at + step;
        outcome.state = FOUND;
    }
    return outcome;
}
