//! Every parameter of the program, in groups. One line here is a flag, a slider, a line of the session file and of the docs.

use glam::DVec3;
use param::{Bytes, Field, Value, choices, params, settings};

pub use self::cubemap_trace::{CubeCriterion, CubeHit, CubePlacement, CubeRest, CubeSampling};
pub use self::light_field::{LightField, MapFill, SampleRest, SampleRule, SampleVisibility};
pub use self::mirror::{FresnelLaw, LastMirror, MirrorSettings, MirrorSurface};
pub use self::overlay::Overlay;
pub use self::sample_cameras::{BundleCull, BundleRest, BundleSplat, CameraCells, JudgedBy, SampleCameras};
pub use self::screen_trace::{ScreenBack, ScreenBox, ScreenCompletion, ScreenCriterion, ScreenRest, ScreenSampling};
use crate::{Method, Projection};

mod cubemap_trace;
mod light_field;
mod mirror;
mod overlay;
mod sample_cameras;
mod screen_trace;

choices! {
    /// Which world axis points up.
    pub enum UpAxis { Auto = "auto", Y = "y", Z = "z" }
}
choices! {
    /// What a pixel keeps of the points that fall on it.
    pub enum Quality { Nearest = "nearest", High = "high" }
}
choices! {
    /// Who covers the pixels of discs of more than 8 pixels in radius.
    pub enum LargeDiscs { Auto = "auto", Alone = "alone", Shared = "shared" }
}
choices! {
    /// Width of the atomics that find the nearest point of a pixel.
    pub enum Atomics { Auto = "auto", Bits32 = "32" }
}
choices! {
    /// What colours the points.
    pub enum ColorBy {
        Auto = "auto", Rgb = "rgb", Height = "height", Intensity = "intensity", Class = "class",
        ReturnNumber = "return", Normal = "normal", GpsTime = "gps-time", Attribute = "attribute", Stray = "stray",
        Plain = "plain", Certainty = "certainty",
    }
}
choices! {
    /// Colour ramps: the perceptually even ones of matplotlib, Google's turbo, grey, and one of grey, red and yellow, in
    /// which what is marked stands out.
    pub enum Ramp {
        Turbo = "turbo", Viridis = "viridis", Magma = "magma", Gray = "gray", Spectral = "spectral", Marks = "marks",
    }
}
choices! {
    /// What the radii of points follow.
    pub enum SurfaceRadii { Full = "full", Narrow = "narrow", Spread = "spread" }
}
choices! {
    /// How points are shown that are on no surface.
    pub enum Strays { Faded = "faded", Hidden = "hidden" }
}
choices! {
    /// What points of exact black are in a cloud of colours.
    pub enum Blank { Auto = "auto", Black = "black" }
}
choices! {
    /// Which way estimated normals point.
    pub enum SurfaceOrientation { Auto = "auto", Up = "up", Inward = "inward", Outward = "outward" }
}
choices! {
    /// What lights the points.
    pub enum Lighting {
        Auto = "auto", Lights = "lights", Sun = "sun", Headlight = "headlight", Colors = "colors",
        Surroundings = "surroundings",
    }
}
choices! {
    /// Shape of the highlight that a glossy surface shows of a light.
    pub enum Highlight { Phong = "phong", Blinn = "blinn" }
}
choices! {
    /// What is shown instead of the picture, to see where light comes from.
    pub enum LightView {
        Picture = "picture", Direct = "direct", Indirect = "indirect", Albedo = "albedo", Normal = "normal",
        Depth = "depth", LightBuffer = "light-buffer", VirtualLights = "virtual-lights", ShadowMaps = "shadow-maps",
    }
}
choices! {
    /// What brings indirect light to the surfaces that the camera sees.
    pub enum IndirectBy { Lights = "lights", Rays = "rays" }
}
choices! {
    /// What a virtual light is taken for.
    pub enum VirtualLight { Spherical = "spherical", Point = "point" }
}
choices! {
    /// What the points are that shadow maps of virtual lights are splatted from.
    pub enum Occluder { Discs = "discs", Squares = "squares" }
}
choices! {
    /// How linear light becomes the colours of the screen.
    pub enum Curve { Auto = "auto", Filmic = "filmic", Srgb = "srgb" }
}
choices! {
    /// Where the camera stands when a cloud opens.
    pub enum Start { Auto = "auto", Outside = "outside" }
}
choices! {
    /// Whether the exposure is fitted to the picture.
    pub enum ExposureFit { Auto = "auto", Always = "always", Locked = "locked" }
}
choices! {
    /// Lobe of the directions that a glossy mirror reflects.
    pub enum GlossLobe { Phong = "phong", Blinn = "blinn", AshikhminShirley = "ashikhmin_shirley" }
}
choices! {
    /// Whether all pixels of a glossy mirror draw the same directions.
    pub enum GlossPattern { Shared = "shared", Pixel = "pixel" }
}
choices! {
    /// Where an environment map is taken to be.
    pub enum Proxy { Infinity = "infinity", Box = "box" }
}
choices! {
    /// What the points of a mirror do in its own reflections.
    pub enum OwnPoints { Auto = "auto", LeftOut = "left_out", Trace = "trace", Drawn = "drawn" }
}
choices! {
    /// What is shown instead of the picture.
    pub enum Show {
        Picture = "picture", Uncertain = "uncertain", Borders = "borders", Curvature = "curvature", Regions = "regions", Search = "search", Steps = "steps",
        Unconverged = "unconverged", Error = "error", Coverage = "coverage", Distance = "distance", Albedo = "albedo", Normal = "normal", Position = "position",
    }
}
choices! {
    /// What a mirror pixel keeps of the points that are reflected into it.
    pub enum KeptPoints { Nearest = "nearest", Accumulated = "accumulated" }
}
choices! {
    /// Which of the thesis' two descriptions of the search is followed where they differ.
    pub enum Reading { Text = "text", Listing = "listing" }
}
choices! {
    /// What finds the mirror pixel of a point.
    pub enum Solver {
        Interleaved = "interleaved", Newton = "newton", Broyden = "broyden", NelderMead = "nelder-mead",
        ConjugateGradient = "conjugate-gradient",
    }
}
choices! {
    /// Where the search for a point's mirror pixel starts.
    pub enum Seeds { Random = "random", Grid = "grid", LastFrame = "last-frame" }
}
choices! {
    /// Which clouds are streamed from pages.
    pub enum Paging { Auto = "auto", Always = "always", Never = "never" }
}

params! {
    /// The view: projection, up axis, background.
    pub struct ViewSettings = "view" in "Splats and view" => affects(surface found truth) {
        /// Perspective or parallel projection.
        projection: Projection = Projection::Perspective;
        /// Vertical field of view; in parallel projection it still sets how much is seen at the pivot's distance.
        field_of_view: f32 = 60.0, 1.0..=150.0, "degrees";
        /// Axis that points up when a cloud is read; auto takes z for LAS and LAZ and for PLY clouds, y for PLY meshes.
        up: UpAxis = UpAxis::Auto => affects(points truth) not(kept swept);
        /// Where the camera stands when clouds open without one: auto inside of a closed room, or where a depth image was taken from, else outside, where it sees all of them.
        start: Start = Start::Auto => affects() not(swept);
        /// Colour where there is no point.
        background: param::Color = param::Color(0x1d20_25ff) => affects(shading truth);
        /// Most points of streamed clouds that are drawn at once.
        point_budget: u32 = 5_000_000, 100_000..=1_000_000_000, "points" => affects(truth) not(swept);
        /// Share of the picture's width and height that `glint render` and studies draw and then enlarge; no effect in the window.
        resolution: f32 = 1.0, 0.25..=1.0, "share" => affects() not(kept swept);
        /// The time that a frame may take while something moves: fewer pixels and points are drawn to keep it; 0 draws all.
        frame_ms: f32 = 40.0, 0.0..=1000.0, "ms" => affects() not(swept);
        /// In the window, the time of a picture at rest for which reflection.method = auto chooses settings; at 0 it chooses nothing.
        still_ms: f32 = 0.0, 0.0..=60_000.0, "ms" => affects() not(swept);
    }

    /// Splatting: how points become surfaces.
    pub struct Splat = "splat" in "Splats and view" => affects(surface found truth) {
        /// Nearest keeps the front point of a pixel; high averages all points within the depth offset of it, by their weights.
        quality: Quality = Quality::High;
        /// Splat radius relative to the one that the points' spacing asks for.
        size: f32 = 1.0, 0.05..=20.0, "x spacing";
        /// Smallest diameter of a splat on the screen.
        min_pixels: f32 = 1.0, 0.0..=64.0, "pixels";
        /// Largest diameter of a splat on the screen: bounds the cost of points close to the eye while something moves, in mirrors and in the maps of virtual lights.
        max_pixels: f32 = 64.0, 1.0..=512.0, "pixels";
        /// Largest diameter of a splat that the camera sees in pictures at rest, where it is above `max_pixels`, so that near surfaces stay closed.
        rest_pixels: f32 = 512.0, 1.0..=4096.0, "pixels" => affects(surface);
        /// High quality: how far behind the front point others still count, in splat radii.
        depth_offset: f32 = 1.0, 0.01..=10.0, "radii";
        /// Close pixels that see through a gap between splats, empty or far behind, with a nearer surface around them; and holes in a plane that are narrower than one and a half radii of the splats around them.
        close_gaps: bool = true;
        /// Draw surfaces whose back is turned to the camera, too. Without them one looks into a room from outside, as into a doll's house; mirrors and light see all.
        back_faces: bool = true => affects(surface found) not(kept);
        /// One point in so many is drawn of those that the camera sees, and each larger; mirrors and light still see all points.
        step: u32 = 1, 1..=64, "points" => affects(surface found);
        /// Stray points and mixed pixels, which surface.radii = spread finds when a cloud is read: faded to dots of splat.min_pixels that no ray meets, or hidden.
        strays: Strays = Strays::Faded;
        /// Width of the atomics; auto takes 64 bits where the adapter has them.
        atomics: Atomics = Atomics::Auto;
        /// Whether a large disc is covered by one invocation alone or shared by a workgroup; auto shares on GPUs, and on processors those of more than 64 pixels. The picture is the same, but alone, software Vulkan loses parts of such discs.
        large: LargeDiscs = LargeDiscs::Auto => affects(surface);
    }

    /// Colour of the points.
    pub struct Color = "color" in "Colour" => affects(surface found truth) not(kept swept) {
        /// What colours the points; auto takes RGB where a cloud has it; for LAS and LAZ without, height if the cloud is a landscape, wider than a building and much wider than high, else intensity, else height; else plain; certainty shows how far the surface may be off along its normal, the half width of an interval of 95 %, of clouds in memory.
        by: ColorBy = ColorBy::Auto;
        /// Name of the attribute shown when color.by is attribute (any extra byte or PLY property).
        attribute: String = String::new();
        /// Colour ramp of heights and attributes.
        ramp: Ramp = Ramp::Turbo;
        /// Share of the values below the ramp's lower end.
        low: f32 = 0.01, 0.0..=1.0, "share";
        /// Share of the values below the ramp's upper end.
        high: f32 = 0.99, 0.0..=1.0, "share";
        /// What points that are exactly black are in a cloud of colours. Scanners write black where they have no colour: where exact black is eight times as frequent as nearly black, auto shows these points in the grey of their intensity, else in color.plain; black shows them black.
        blank: Blank = Blank::Auto;
        /// Colour of points that have no other, sRGB.
        plain: param::Color = param::Color(0xc8c4_bcff);
    }

    /// Eye-dome lighting (Boucheny 2009): a depth cue from the depth image. The slope of a plane is no step of depth.
    pub struct Edl = "edl" in "Light" => affects(view) {
        /// Darkness of depth edges; 0 turns it off.
        strength: f32 = 0.4, 0.0..=10.0, "";
        /// Distance of the eight neighbours that are compared.
        radius: f32 = 1.4, 0.5..=10.0, "pixels";
        /// How far a pixel may lie behind its neighbours before it darkens, in radii of its splat, where splats are discs of 32 pixels and more, so that near surfaces show no rings around them; in part from 8 pixels on. On planes, how far its disc may lie off the plane at any size, the more so the more the plane is seen along it.
        ignored: f32 = 1.0, 0.0..=10.0, "radii";
    }

    /// Light.
    pub struct Light = "light" in "Light" => affects(shading truth) {
        /// What lights the points: the scene's lights, a sun and a sky, a lamp at the eye, or nothing (the data's own colours); surroundings takes the scene's lights, else a sun where the sky is open above the points, else inside of a closed room a lamp under its ceiling, else the lamp at the eye; auto takes the scene's lights, else the points' own colours where most points are shown in RGB, else what surroundings takes. A sun or a lamp that is not the scene's own shines with light.fill.
        by: Lighting = Lighting::Auto => not(kept);
        /// Share of the picture that a lamp at the eye lights by the normals; 0 shows the data's own colours.
        headlight: f32 = 0.5, 0.0..=1.0, "share";
        /// What a lamp at the eye adds where light.by = auto has guessed a sun or a lamp, so that no shadow is black: the radiance of white that faces it.
        fill: f32 = 0.15, 0.0..=1.0, "";
        /// Depth by which a surface may lie behind what the light sees before it is in shadow, in texels of the shadow map.
        shadow_bias: f32 = 3.0, 0.0..=64.0, "texels";
        /// Factor of the diffuse light that surfaces send back; above 1 they may send back more than arrives.
        diffuse: f32 = 1.0, 0.0..=100.0, "times";
        /// Share of the light that surfaces which are no mirrors reflect as a highlight.
        gloss: f32 = 0.0, 0.0..=1.0, "share";
        /// Specular power of these highlights: the larger, the smaller they are.
        gloss_power: f32 = 50.0, 1.0..=10_000.0, "";
        /// Shape of highlights (Phong 1975, Blinn 1977; both scaled to reflect no more than they receive).
        highlight: Highlight = Highlight::Phong;
        /// Photons that follow light of lamps and the sun over mirrors, to the surfaces that it shines on; with 0 mirrors throw none. Each spreads its light as far as its 24 nearest neighbours: 16,384 leave the light of a smooth mirror smooth, more make it sharper. They are traced anew when lights, mirrors or points change.
        photons: u32 = 0, 0..=1_000_000, "photons" => affects(shading);
        /// What is shown instead of the picture, to see where light comes from; reflection.show waits meanwhile.
        show: LightView = LightView::Picture => affects(view) not(kept);
    }

    /// Sun and sky.
    pub struct Sun = "sun" in "Light" => affects(shading truth) not(kept) {
        /// Where the sun stands, clockwise from north (the y axis, or -z where y points up).
        azimuth: f32 = 225.0, 0.0..=360.0, "degrees";
        /// How high it stands.
        elevation: f32 = 40.0, 0.0..=90.0, "degrees";
        /// Irradiance of a surface that faces the sun; at pi a white one is as bright as the screen at an exposure of 0, four fifths of it by the filmic curve.
        irradiance: f32 = 2.5, 0.0..=100.0, "";
        /// Irradiance by the whole sky of a surface that faces up; the sky is evenly bright.
        sky: f32 = 1.0, 0.0..=100.0, "";
    }

    /// Indirect light by virtual lights (Keller 1997) with imperfect shadow maps (Ritschel et al. 2008), or by rays.
    pub struct Gi = "gi" in "Light" => affects(shading) {
        /// What brings indirect light to the surfaces that the camera sees: the virtual lights, or rays that each pixel sends through the tree of discs. What a ray meets is lit by the scene's lights and, where it ends, by the virtual lights. Surfaces in mirrors and behind glass are lit by virtual lights either way.
        by: IndirectBy = IndirectBy::Lights;
        /// Rays of each pixel at rest, of which the first picture shows one and each further picture more; four times as many halve the noise. While something moves, each picture takes over those of the one before and adds one. Powers of two are spread most evenly.
        rays_per_pixel: u32 = 64, 1..=4096, "rays";
        /// Reflections between surfaces that rays follow themselves; the virtual lights give those beyond them, up to gi.bounces. Mirrors reflect rays besides, as often as reflection.bounces says.
        ray_bounces: u32 = 1, 1..=4, "bounces";
        /// Seed of the directions of rays; the same seed gives the same picture.
        ray_seed: u32 = 1;
        /// Times that light is reflected between surfaces before it reaches what is seen; 0 leaves direct light and that of the sky.
        bounces: u32 = 1, 0..=4, "bounces" => affects(shading truth);
        /// Virtual lights of each bounce.
        vpls: u32 = 256, 16..=4096, "lights";
        /// Spherical lights as large as the surface they stand for (after Hasan et al. 2009) do not sparkle; points are the published ones.
        vpl: VirtualLight = VirtualLight::Spherical;
        /// Most of its hemisphere that a surface sees one virtual light fill; 0 sets no bound. Less sparkles, and less light in corners.
        clamp: f32 = 0.0, 0.0..=1.0, "share";
        /// Lights that stand for the sky.
        sky_lights: u32 = 64, 4..=1024, "lights";
        /// Virtual lights cast shadows.
        shadows: bool = true;
        /// Texels along an edge of a virtual light's shadow map.
        shadow_size: u32 = 64, 16..=256, "texels";
        /// Points that each shadow map is splatted from.
        shadow_points: u32 = 8192, 256..=65_535, "points";
        /// What these points are in a map: discs that cover the texels that look through them, at the depth of their planes, or squares of at least a texel, at the points' own depth, as published.
        occluders: Occluder = Occluder::Discs;
        /// Distance that shadows keep from what casts them, in radii of the splats they are made of.
        shadow_bias: f32 = 1.0, 0.0..=8.0, "radii";
        /// Levels of the pull-push pyramid that closes holes of shadow maps.
        pull_levels: u32 = 2, 0..=3, "levels";
        /// Each pixel of a tile this wide is lit by its own share of the virtual lights; 1 lights all pixels by all.
        interleave: u32 = 4, 1..=8, "pixels";
        /// Average interleaved light, and that of rays, over a tile, as far as it lies on one surface.
        filtered: bool = true;
        /// Distance from a surface's plane at which another pixel is not averaged with it, relative to the distance from the eye.
        filter_depth: f32 = 0.01, 0.0..=1.0, "share";
        /// Angle between normals at which pixels are not averaged.
        filter_angle: f32 = 20.0, 0.0..=180.0, "degrees";
    }

    /// Tone mapping.
    pub struct Tone = "tone" in "Light" => affects(view) {
        /// Exposure: each stop doubles the brightness. It is added to what fits.
        exposure: f32 = 0.0, -10.0..=10.0, "stops" => not(kept);
        /// Fits the exposure to what is lit in the picture, so that the median is middle grey and little is burnt out: auto where light.by = auto has guessed the light, always under any light, locked never.
        fit: ExposureFit = ExposureFit::Auto => not(kept);
        /// Filmic rolls highlights off (Narkowicz 2015), srgb clips them; auto takes filmic where lights or a sun shine.
        curve: Curve = Curve::Auto;
    }

    /// The ray-traced truth.
    pub struct Trace = "trace" in "Truth" => affects(truth) {
        /// Paths per pixel that indirect light and glossy mirrors are averaged over.
        samples: u32 = 16, 1..=65_536, "paths";
        /// Rays through each pixel of the exact truth over which what its mirrors show is averaged.
        rays: u32 = 1, 1..=4096, "rays";
        /// Photons that follow light of lamps and the sun over mirrors, to the surfaces that it shines on; with 0 mirrors throw none. What they bring is blurred over the scene's radius divided by the cube root of their number.
        photons: u32 = 0, 0..=10_000_000, "photons";
        /// Seed of the paths and photons; the same seed gives the same picture.
        seed: u32 = 1;
    }

    /// Reflections.
    pub struct Reflection = "reflection" in "Reflections" => affects(found) {
        /// What finds the reflected points; auto takes sscr_hierarchical, or what measuring chooses for --budget, --error or view.still_ms.
        method: Method = Method::Auto;
        /// Whether mirrors that have a method of their own use it; else all mirrors use reflection.method.
        own_methods: bool = true;
        /// Reflections that are followed, one after the other.
        bounces: u32 = 1, 0..=8, "bounces" => affects(found truth);
        /// Share of the picture below which a further reflection is not followed: the product of what the mirrors on its way reflect. The mirror that it would leave shows what mirror.last says. At 0 all are followed; the first one always is, and so are all of the truth.
        least_weight: f32 = 0.02, 0.0..=1.0, "share";
        /// Rays of a mirror pixel from places spread over it: the mirror shows their mean, so what it shrinks is smooth. While something moves, one. Methods that draw from a viewpoint behind the mirror take one.
        samples: u32 = 1, 1..=256, "rays";
        /// Keep the reflected points while camera, points, mirrors and parameters stand still, and only shade them anew.
        keep: bool = true => affects() not(swept);
        /// What is shown instead of the picture: uncertain marks reflections that are not to be trusted, the others show how a method comes to its result; light.show comes first.
        show: Show = Show::Picture => affects(view);
        /// World position of the point whose error reflection.show = error shows, as in 0.5, -1, 2; the window takes the point picked last. Without one it is the point that the camera turns around.
        point: String = String::new() => affects(view) not(kept);
    }

    /// Glossy mirrors: mirrors with a specular power show the mean of what many rays meet (docs/methods/gloss.md).
    pub struct GlossSettings = "gloss" in "Reflections" => affects(found) {
        /// Rays of a mirror pixel whose surface has a specular power; at 0 all mirrors are perfect. Noise falls with the root of their number.
        samples: u32 = 0, 0..=256, "rays" => affects(found truth);
        /// Lobe of the directions: about the reflected ray (Phong 1975), or mirrored at normals about the mirror's own (Blinn 1977); or mirrored at normals that may spread more across than along, by a reflectance that loses light towards grazing angles (Ashikhmin and Shirley 2000).
        lobe: GlossLobe = GlossLobe::Phong => affects(found truth);
        /// Exponent of ashikhmin_shirley across the level direction of the surface, in times of that along it, which is the mirror's specular power: below 1 for brush strokes that run level, across which light spreads, above 1 for those that run up.
        across: f32 = 1.0, 0.0001..=10_000.0, "times" => affects(found truth);
        /// Shared takes the same directions for all pixels: smooth, few show as several pictures over each other; pixel draws them anew for each, which is noise. Forward methods always share them.
        pattern: GlossPattern = GlossPattern::Shared;
        /// Seed of the directions; the same seed gives the same picture.
        seed: u32 = 1;
        /// Keep what the rays meet, so that new colours and lights trace none. The picture is the same; 512 MB at most.
        cache: bool = true => affects();
        /// Specular power from whose lobe all glossy mirrors draw their rays; the rays then weigh by the mirror's own lobe, so that a change of the mirror's power traces no new rays. 0 draws from the mirror's own lobe.
        cache_power: f32 = 0.0, 0.0..=1_000_000.0, "";
        /// Every other ray is drawn from a lobe of so many times less power, for mirrors less polished than gloss.cache_power; 1 draws from one lobe, as published.
        cache_spread: f32 = 10.0, 1.0..=100.0, "ratio";
        /// Share of the rays that must count in effect; a pixel with less draws from its mirror's own lobe.
        cache_trust: f32 = 0.25, 0.0..=1.0, "share";
        /// Blurs what glossy mirrors show as far as their lobe reaches, times this: less noise with few rays, and softer than the truth. Near things stay sharp; perfect mirrors and 0 are not blurred.
        blur: f32 = 0.0, 0.0..=4.0, "lobes" => affects(shading);
        /// Most pixels along a row or column that the blur takes the mean of.
        blur_most: f32 = 33.0, 1.0..=65.0, "pixels" => affects(shading);
    }

    /// Environment maps: what the points around each mirror look like from its middle (Blinn, Newell 1976; Greene 1986).
    pub struct EnvironmentMap = "environment_map" in "Reflections" => affects(found) {
        /// Texels along the edge of a map's face; a map has six.
        size: u32 = 256, 16..=1024, "texels";
        /// Where a map is taken to be: infinitely far, so that directions alone count, or on the box about all points (Lagarde, Zanuttini 2012).
        proxy: Proxy = Proxy::Infinity;
    }

    /// Cubemap tracing: rays walk through pictures of the points around each mirror.
    pub struct CubemapTrace = "cubemap_trace" in "Reflections" => affects(found) {
        /// Maps of a mirror: where one cannot see behind something, another may. Fewer where they do not fit into a buffer of the adapter.
        maps: u32 = 2, 1..=16, "maps";
        /// Most maps that a ray may use.
        tries: u32 = 2, 1..=16, "maps";
        /// Texels along the edge of a map's face; a map has six. Outlines are as fine as a texel.
        size: u32 = 256, 16..=1024, "texels";
        /// Where maps stand: one in the mirror's middle, or all spread over its surface.
        placement: CubePlacement = CubePlacement::Surface;
        /// How far from the surface a map stands, along its normal; on the other side if more of the mirror is seen from there.
        offset: f32 = -0.25, -1.0..=2.0, "mirror radii";
        /// Where one map loses a ray, another goes on (relay, by planes; else like first); or the nearest hit in all maps; or that of the first map that has one, as published.
        hit: CubeHit = CubeHit::Relay;
        /// What is a hit: the plane of the disc that a texel shows; or, with one depth for a whole texel, a change from before it to behind it (sign), as published a change either way (sign_either) or a distance below the threshold, or the threshold, and sign where it finds nothing.
        criterion: CubeCriterion = CubeCriterion::Plane;
        /// How near to its texel's depth a ray meets it by the criterion threshold.
        threshold: f32 = 0.0015, 0.0..=0.1, "scene radii";
        /// Each texel that a ray crosses, or, for criteria other than plane, samples by equal steps, or by equal angles as seen from the map.
        sampling: CubeSampling = CubeSampling::Texel;
        /// From one sample to the next by equal steps; what is thinner is missed.
        step: f32 = 0.001, 0.0001..=0.1, "scene radii";
        /// From one sample to the next by equal angles.
        angle: f32 = 0.25, 0.05..=5.0, "degrees";
        /// Pass many texels at once where bounds of their depths say that a ray is before all of them; the picture is the same.
        skip: bool = true;
        /// Depth steps up to this size are within one surface: more closes cracks, and invents walls.
        jump: f32 = 1.0, 0.0..=8.0, "texels";
        /// How far beside its disc a texel's plane still counts: 0 leaves edges open, more widens things.
        disc_slack: f32 = 0.5, 0.0..=4.0, "texels";
        /// What a mirror's own points do, which its maps leave out: nothing, as on convex mirrors, or rays are traced through them first; drawn puts them into the maps, as published, where they hide most of what a convex mirror shows.
        own: OwnPoints = OwnPoints::Auto;
        /// What rays show that no map resolves: nothing, or what surfel_trace finds from where they are known to be free, or the first thing that may hide it, or what lies in its direction from the map.
        rest: CubeRest = CubeRest::SurfelTrace;
        /// Faces of maps that a frame of the viewer draws anew while points stream in or the view moves; the others show the points of before, marked as doubtful. A picture that stays has all.
        faces_per_frame: u32 = 6, 1..=96, "faces";
    }

    /// Screen-space tracing: rays walk through the camera's picture (after Johnsson 2012).
    pub struct ScreenTrace = "screen_trace" in "Reflections" => affects(found) {
        /// What a ray meets: plane takes each pixel for a plane, and says what it cannot decide; the others are published, and go by depth alone: whatever the ray is behind, by up to a thickness, or before the layer behind, which screen_trace.back must ask for.
        criterion: ScreenCriterion = ScreenCriterion::Plane;
        /// How thick every surface is taken to be where screen_trace.criterion = thickness: too much draws streaks, too little leaves holes.
        thickness: f32 = 0.05, 0.001..=10.0, "scene radii";
        /// Test each pixel that the ray crosses (texel), or the pixels at even steps in the picture (step), between which the ray is an interval of depths; or, as published, points at even steps along the ray alone (even), which planes nearly always lose.
        sampling: ScreenSampling = ScreenSampling::Texel;
        /// Length of a step in the picture: what is thinner is missed.
        step: f32 = 1.0, 1.0..=64.0, "pixels";
        /// Length of an even step along the ray: what is thinner or shallower is missed.
        stride: f32 = 0.005, 0.0001..=0.5, "scene radii";
        /// A second layer behind what the camera sees: the discs that face away, as published, or all that is farther than the nearest surface by two radii.
        back: ScreenBack = ScreenBack::None;
        /// Pass many pixels at once where bounds of their depths say that a ray is before all of them; the picture is the same.
        skip: bool = true;
        /// What rays meet that leave the picture, before the rest: nothing, or the walls of the box about all points, with the points beside each, or with the pixels that show it. What stands in the box is not in the way.
        box_from: ScreenBox = ScreenBox::None;
        /// Texels along the longer edge of a wall of the box.
        box_size: u32 = 256, 32..=1024, "texels";
        /// What stands on a wall where the camera does not see it: nothing, the nearest pixel of the row or column, or the pixel so many periods of the wall's pattern away, and the nearest where it has none.
        completion: ScreenCompletion = ScreenCompletion::Repeat;
        /// What rays show that leave the picture or pass behind something: nothing, or what surfel_trace or cubemap_trace finds from where they are known to be free, or what environment_map has in their direction.
        rest: ScreenRest = ScreenRest::SurfelTrace;
    }

    /// Screen-space curved reflections (Preiner 2010).
    pub struct Sscr = "sscr" in "Reflections" => affects(found) {
        /// Further random start pixels that are tried where one lies outside of its region; newton and its like also start anew from them.
        seed_attempts: u32 = 6, 0..=16, "attempts";
        /// Halvings that are tried for a step that leaves the region.
        step_attempts: u32 = 6, 0..=16, "attempts";
        /// First step, as a share of the region's extent.
        initial_step: f32 = 0.2, 0.005..=0.5, "share";
        /// Steps after which a point is given up.
        max_steps: u32 = 30, 1..=100, "steps";
        /// Steps after which reflection.show = search shows each point where its search stands.
        search_steps: u32 = 0, 0..=100, "steps";
        /// Distance of the two pixels of a bracket at which its root is interpolated.
        threshold: f32 = 2.0, 1.0..=16.0, "pixels";
        /// Which description of interleaved is followed: the thesis' text, or its algorithm 3.1 to the letter, which begins towards +x and +y, gives up at the first two pixels within the threshold that are no bracket, and leaves out points that turn their back to the mirror.
        reading: Reading = Reading::Text;
        /// Diameter of a point's splat on the mirror when it touches it.
        max_splat_size: f32 = 3.0, 1.0..=32.0, "pixels";
        /// Distance from the mirror at which splats have shrunk to one pixel, in scene radii; points beyond it are shown, too.
        mirror_z_far: f32 = 1.0, 0.01..=10.0, "radii";
        /// How far behind the nearest reflected point of a pixel others still count, in scene radii.
        mirror_depth_offset: f32 = 0.02, 0.0..=1.0, "radii";
        /// Levels of the pull-push pyramid that closes holes.
        pull_levels: u32 = 4, 0..=4, "levels";
        /// Change of the normal from pixel to pixel below which the mirror counts as planar.
        planar_normal_threshold: f32 = 0.004, 0.0..=0.1, "";
        /// Radius over which the mirror's normals are averaged before their changes count, against the noise of splats; 0, as published, takes them as they are. The search keeps to the mirror's own normals.
        normal_filter: u32 = 0, 0..=16, "pixels";
        /// Change of linear depth from pixel to pixel that parts regions, relative to the depth.
        depth_step_threshold: f32 = 0.05, 0.001..=1.0, "share";
        /// Keep the nearest point of a mirror pixel, for which points are searched for once, or the mean of all within the depth offset.
        visibility: KeptPoints = KeptPoints::Accumulated;
        /// Keep each point's pixel from the depth pass instead of searching for it twice.
        solve_once: bool = false;
        /// What finds the mirror pixel of a point; interleaved bracketing and bisection is the published one.
        solver: Solver = Solver::Interleaved;
        /// Where the search starts: random pixels, the best of a grid, or the last frame's pixel (then points are searched for once, and those without one drawn anew).
        seeds: Seeds = Seeds::Random;
        /// Regions that each point is tried in.
        regions_per_point: u32 = 1, 1..=16, "regions";
        /// Share of the points that are searched for where mirrors cover a tenth of the picture. Fewer pixels, as in later bounces, take fewer points, and more take more; 1 takes all, and in later bounces as many a pixel as in the first.
        point_share: f32 = 1.0, 0.001..=1.0, "share";
        /// Draw another region for points outside of the cone of their region's reflected rays, and do not search for those that no drawn region can reflect; each point is tested, not whole chunks.
        cull_points: bool = false;
        /// Do not search for the points of chunks that lie outside of the cones of all regions' reflected rays.
        cull_chunks: bool = false;
        /// Choose the first step and the number of start pixels by each region's size and shape.
        per_region: bool = false;
    }

    /// Surface estimation: normals and spacing of clouds that come without.
    pub struct Surface = "surface" in "When loading" => affects(points) not(swept) {
        /// Points that are spread over the triangles of a mesh when it is read, evenly by area; its vertices alone at 0, or if it has as many.
        mesh_points: u32 = 1_000_000, 0..=100_000_000, "points";
        /// Nearest neighbours that a plane is fitted to when a cloud is read.
        neighbours: u32 = 16, 4..=64, "points";
        /// Which way normals point that are estimated when a cloud is read; auto guesses from its shape.
        orientation: SurfaceOrientation = SurfaceOrientation::Auto;
        /// What the radii of points follow when a cloud is read: how far their neighbours reach (full), the same but smaller at the border of a surface (narrow), or how far their neighbours are spread among themselves (spread), which stray points and vegetation do not make larger.
        radii: SurfaceRadii = SurfaceRadii::Spread;
        /// End splats before they hide points that the scanner saw: in depth images, which are seen from the origin, scans whose file names the place of the scanner, and made scans, whose points name their stations.
        carve: bool = true;
    }

    /// Streaming: clouds that are larger than memory are drawn from pages on disk.
    pub struct Stream = "stream" in "When streaming" => affects(points) not(swept) {
        /// Which clouds are streamed; auto takes those that would fill more than half of host_bytes, and folders of several tiles.
        pages: Paging = Paging::Auto => not(kept);
        /// Memory of the machine that streamed points may take.
        host_bytes: Bytes = Bytes(4 << 30), Bytes(64 << 20)..=Bytes(1 << 50), "";
        /// Memory of the GPU that streamed points may take.
        gpu_bytes: Bytes = Bytes(4 << 30), Bytes(64 << 20)..=Bytes(1 << 50), "";
        /// Disk space that pages, and kept normals and radii, may take in the cache folder; the longest unused go first.
        cache_bytes: Bytes = Bytes(50 << 30), Bytes(256 << 20)..=Bytes(1 << 50), "";
        /// Distance of neighbouring points on the screen at which a place is fine enough.
        detail: f32 = 1.0, 0.25..=64.0, "pixels" => affects();
        /// How much places outside of the picture count beside those in it, where no mirror shows them larger: light comes from them.
        unseen: f32 = 0.25, 0.0..=1.0, "share" => affects();
        /// Colour points by the level of their page, and draw the boxes of pages.
        overlay: bool = false => affects() not(kept);
    }

    /// Built-in scenes: how they are sampled.
    pub struct SceneSettings = "scene" in "When loading" => affects(points) not(kept swept) {
        /// Points of a built-in scene, all its clouds together; of a made scan (tripod/...), rays of all its stations.
        points: u32 = 1_600_000, 1_000..=100_000_000, "points";
        /// Seed of the random positions; the same seed gives the same points.
        seed: u32 = 1;
    }
}

settings! {
    /// All parameters.
    pub struct Settings {
        view: ViewSettings,
        splat: Splat,
        color: Color,
        overlay: Overlay,
        edl: Edl,
        light: Light,
        sun: Sun,
        gi: Gi,
        tone: Tone,
        trace: Trace,
        mirror: MirrorSettings,
        reflection: Reflection,
        gloss: GlossSettings,
        environment_map: EnvironmentMap,
        cubemap_trace: CubemapTrace,
        screen_trace: ScreenTrace,
        sample_cameras: SampleCameras,
        light_field: LightField,
        sscr: Sscr,
        surface: Surface,
        stream: Stream,
        scene: SceneSettings,
    }
}

impl Color {
    /// The attribute that the colours ask for by its name.
    pub fn asked_attribute(&self) -> Option<&str> {
        match self.by {
            ColorBy::Intensity => Some("intensity"),
            ColorBy::Class => Some("classification"),
            ColorBy::ReturnNumber => Some("return_number"),
            ColorBy::GpsTime => Some("gps_time"),
            ColorBy::Attribute => Some(&self.attribute),
            ColorBy::Auto | ColorBy::Rgb | ColorBy::Height | ColorBy::Normal | ColorBy::Stray => None,
            ColorBy::Plain | ColorBy::Certainty => None,
        }
    }
}

impl Reflection {
    /// The method of a mirror that may have its own.
    pub fn method_of(&self, own: Option<Method>) -> Method {
        own.filter(|_| self.own_methods).unwrap_or(self.method).chosen()
    }

    /// The point of `reflection.point`; `None` if that is not three numbers.
    pub fn shown_point(&self) -> Option<DVec3> {
        let parts = self.point.split(|sign: char| sign == ',' || sign.is_whitespace()).filter(|part| !part.is_empty());
        let number = |part: &str| part.parse().ok().filter(|number: &f64| number.is_finite());
        let numbers: Vec<f64> = parts.map(number).collect::<Option<_>>()?;
        <[f64; 3]>::try_from(numbers).ok().map(DVec3::from)
    }
}

/// Parameters that older versions kept in files under another name: the old key and the new one.
const RENAMED: [(&str, &str); 2] = [("stream.frame_ms", "view.frame_ms"), ("sscr.stop", "sscr.reading")];

impl Settings {
    /// What a picture is drawn with: the data's own colours are shown as they are, whatever exposure and curve are for light.
    pub fn drawn(&self) -> Self {
        let tone = if self.light.by == Lighting::Colors { Tone::default() } else { self.tone.clone() };
        Self { tone, ..self.clone() }
    }

    /// The wanted parameters as they are, all others at their defaults: what depends on no others is the same where these are.
    pub fn only(&self, is_wanted: impl Fn(&Field) -> bool) -> Self {
        let mut settings = self.clone();
        for params in settings.groups_mut() {
            let fields = params.group().fields.iter().zip(params.values());
            let value = |(field, value): (&Field, Value)| if is_wanted(field) { value } else { field.default() };
            let values: Vec<Value> = fields.map(value).collect();
            params.set_values(&values);
        }
        settings
    }

    /// Sets the parameter `key` (`group.name`) from text.
    ///
    /// # Errors
    /// Unknown key (with its new name or the nearest known one), not parsable, out of range.
    pub fn set_text(&mut self, key: &str, text: &str) -> Result<(), param::Error> {
        let (group_name, name) = key.split_once('.').unwrap_or((key, ""));
        let unknown = |hint: Option<&str>| param::Error::UnknownKey {
            key: param::shortened(key, param::MOST_QUOTED),
            hint: hint.map_or("; `glint methods` lists them".into(), |near| format!("; did you mean `{near}`?")),
        };
        if let Some((_, new)) = RENAMED.iter().find(|(old, _)| *old == key) {
            return Err(unknown(Some(new)));
        }
        let names: Vec<&str> = self.groups().iter().map(|group| group.group().name).collect();
        let is_point = || Reflection { point: text.into(), ..Reflection::default() }.shown_point().is_some();
        match self.groups_mut().into_iter().find(|group| group.group().name == group_name) {
            Some(_) if key == "reflection.point" && !text.trim().is_empty() && !is_point() => {
                let problem =
                    format!("{} is no point, expected three numbers", param::shortened(text, param::MOST_QUOTED));
                Err(param::Error::Value { key: key.into(), problem })
            }
            Some(group) if !name.is_empty() => group.set_text(name, text),
            Some(_) => Err(unknown(None)),
            None => {
                let near = param::nearest(group_name, names.into_iter());
                let near = near.map(|near| param::shortened(&format!("{near}.{name}"), param::MOST_QUOTED));
                Err(unknown(near.as_deref()))
            }
        }
    }

    /// Returns the parameters with the values of `now` where `before` and `now` differ.
    pub fn with_changes(&self, before: &Self, now: &Self) -> Self {
        let mut settings = self.clone();
        for ((params, before), now) in settings.groups_mut().into_iter().zip(before.groups()).zip(now.groups()) {
            let values = params.values().into_iter().zip(before.values()).zip(now.values());
            let values: Vec<Value> = values.map(|((own, before), now)| if before == now { own } else { now }).collect();
            params.set_values(&values);
        }
        settings
    }

    /// Keys and values, as text, of all parameters that differ from their defaults.
    pub fn differing(&self) -> Vec<(String, String)> {
        let mut all = Vec::new();
        for params in self.groups() {
            let group = params.group();
            for (field, value) in group.fields.iter().zip(params.values()) {
                if field.default() != value {
                    all.push((format!("{}.{}", group.name, field.name), field.format(&value)));
                }
            }
        }
        all
    }

    /// Key and value of every parameter.
    pub fn all(&self) -> Vec<(String, Value)> {
        let mut all = Vec::new();
        for params in self.groups() {
            let group = params.group();
            all.extend(
                group
                    .fields
                    .iter()
                    .zip(params.values())
                    .map(|(field, value)| (format!("{}.{}", group.name, field.name), value)),
            );
        }
        all
    }
}

#[cfg(test)]
mod tests;
