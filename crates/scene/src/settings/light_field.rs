//! The parameters of light fields.

use param::{Bytes, choices, params};

use super::OwnPoints;

choices! {
    /// Which of the samples near to a mirror point are looked up, and in which order; or how what they show is blended.
    pub enum SampleRule {
        Nearest = "nearest",
        Angle = "angle",
        Ray = "ray",
        Mean = "mean",
        Reflection = "reflection",
        Normal = "normal",
        Smooth = "smooth",
    }
}

impl SampleRule {
    /// Whether the colours of what several samples show are blended.
    pub fn blends(self) -> bool {
        matches!(self, Self::Mean | Self::Reflection | Self::Normal | Self::Smooth)
    }
}

choices! {
    /// How a sample that something hides from a mirror point is recognised.
    pub enum SampleVisibility { Depth = "depth", Angle = "angle" }
}
choices! {
    /// How maps are made.
    pub enum MapFill { Draw = "draw", Trace = "trace", OnDemand = "on_demand" }
}
choices! {
    /// What finds the rays that no sample resolves.
    pub enum SampleRest { None = "none", SurfelTrace = "surfel_trace", EnvironmentMap = "environment_map" }
}

params! {
    /// Offset surface light fields (after Ang 2003): rays are looked up in maps that stand on the mirror.
    pub struct LightField = "light_field" in "Reflections" => affects(found) {
        /// Places of a mirror's surface at which maps stand, far from one another. Only those are drawn that a picture needs.
        samples: u32 = 32, 1..=1024, "maps";
        /// Begin with one of these places on each mirror and add others only until no more than a twentieth of its pixels are predicted to be off by more; 0 takes all places. With corrections it is the rays that the nearest sample does not resolve that count as off.
        accuracy: f32 = 0.0, 0.0..=16.0, "pixels";
        /// Texels along the edge of a map's face; a map has six.
        size: u32 = 128, 16..=512, "texels";
        /// How maps are made: by drawing all points around, or by tracing a ray for each texel through the points, whose time grows less with their number; on demand a texel is traced when a picture first looks at it, and each ray asks one sample alone, or those that are blended.
        fill: MapFill = MapFill::Draw;
        /// How far before the surface a map stands, along its normal; behind it if more of the mirror is seen from there.
        offset: f32 = 0.01, 0.0005..=0.25, "mirror radii";
        /// Nearest samples of a mirror point of which one is looked up: the next where something hides one, or where what it shows is not on the ray.
        neighbours: u32 = 4, 1..=8, "samples";
        /// Which of them comes first: the nearest, or that in the direction of the ray by its angle, or by its distance from the ray. The others blend the colours of all that meet something, with equal weights, by the cosine of their angle to the ray or to the normal, or so that nothing jumps where the neighbours change.
        rule: SampleRule = SampleRule::Nearest;
        /// The power of the cosine in the weights of reflection and normal; at 0 all weigh the same.
        exponent: f32 = 4.0, 0.0..=64.0, "";
        /// How samples find that something hides from the mirror point: by the depth in their map, or, as published, by their angle to the normal.
        visible_by: SampleVisibility = SampleVisibility::Depth;
        /// The largest angle to the normal of a sample, where that decides whether it is hidden.
        horizon: f32 = 85.0, 45.0..=90.0, "degrees";
        /// How often the place that a look-up finds is looked up in place of the ray's direction. Without, as published, whatever lies in that direction is shown.
        corrections: u32 = 1, 0..=4, "look-ups";
        /// What a mirror's own points do, which its maps leave out: nothing, as on convex mirrors, or rays are traced through them; drawn puts them into the maps, as published.
        own: OwnPoints = OwnPoints::Auto;
        /// What rays show that no sample resolves: the best that one has, if any, or what surfel_trace finds, or what lies in their direction from the mirror's middle.
        rest: SampleRest = SampleRest::SurfelTrace;
        /// Maps that a frame of the viewer draws while points stream in or the view moves; missing ones are left to other samples and to the rest. A picture that stays has all that it needs.
        maps_per_frame: u32 = 2, 1..=64, "maps";
        /// Memory of the GPU that maps may take. Where a picture needs more of them, those that most of its pixels need are drawn.
        memory: Bytes = Bytes(256 << 20), Bytes(16 << 20)..=Bytes(16 << 30), "";
    }
}
