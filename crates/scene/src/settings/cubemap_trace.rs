//! The choices of cubemap tracing.

use param::choices;

choices! {
    /// Where the maps of a mirror stand.
    pub enum CubePlacement { Middle = "middle", Surface = "surface" }
}
choices! {
    /// What finds the rays that no map resolves.
    pub enum CubeRest { None = "none", SurfelTrace = "surfel_trace", Candidate = "candidate", EnvironmentMap = "environment_map" }
}
choices! {
    /// Which of the hits in several maps counts.
    pub enum CubeHit { Relay = "relay", Nearest = "nearest", First = "first" }
}
choices! {
    /// When a ray meets what a texel shows.
    pub enum CubeCriterion {
        Plane = "plane",
        Sign = "sign",
        Threshold = "threshold",
        ThresholdThenSign = "threshold_then_sign",
        SignEither = "sign_either",
    }
}
choices! {
    /// Where along a ray its depth is compared with the map.
    pub enum CubeSampling { Texel = "texel", Step = "step", Angle = "angle" }
}
