// A pass that runs twice over the points: first for the nearness of each pixel's nearest fragment, then for the point to
// which that fragment belongs. A uniform tells the runs apart, so that both are one compiled pass and compute the same
// bits: of two compilations one may round otherwise, and a pixel without a point that fits would stay empty. The
// importing pass binds it as `run`.

struct Run {
    // 1 in the second run.
    finds_identity: u32,
    unused_0: u32,
    unused_1: u32,
    unused_2: u32,
}
