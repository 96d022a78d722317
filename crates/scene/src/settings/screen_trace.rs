//! The choices of screen-space tracing.

use param::choices;

choices! {
    /// What of the camera's picture a ray meets.
    pub enum ScreenCriterion { Plane = "plane", Behind = "behind", Thickness = "thickness", Layers = "layers" }
}
choices! {
    /// Which pixels a ray is tested against.
    pub enum ScreenSampling { Texel = "texel", Step = "step", Even = "even" }
}
choices! {
    /// The second layer of the camera's picture.
    pub enum ScreenBack { None = "none", Culled = "culled", Peeled = "peeled" }
}
choices! {
    /// What finds the rays that the camera's picture does not resolve.
    pub enum ScreenRest {
        None = "none",
        SurfelTrace = "surfel_trace",
        CubemapTrace = "cubemap_trace",
        EnvironmentMap = "environment_map",
    }
}
choices! {
    /// What rays meet that leave the camera's picture.
    pub enum ScreenBox { None = "none", Points = "points", Picture = "picture" }
}
choices! {
    /// What stands on a wall of the box where the camera does not see it.
    pub enum ScreenCompletion { None = "none", Nearest = "nearest", Repeat = "repeat" }
}
