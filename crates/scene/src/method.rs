//! The reflection methods: a row each in `methods!`. The menu, `--method`, `glint methods`, studies and the law suite walk the
//! table; what a method does is an arm of `run` in crates/render/src/method.rs, and its page is docs/methods/NAME.md.

/// The points in which a method searches reflections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Supply {
    /// None: it finds nothing.
    Nothing,
    /// All points that are shown. Mirrors that are drawn by their formula are intersected by it.
    Everything,
    /// Also the samples of mirrors that are drawn by their formula: the method sees mirrors only by their points.
    WithMirrors,
}

/// A row of the table.
#[derive(Clone, Copy, Debug)]
pub struct MethodRow {
    pub method: Method,
    /// The name in `reflection.method`.
    pub name: &'static str,
    /// One line for people.
    pub help: &'static str,
    pub supply: Supply,
    /// The group of its parameters.
    pub group: Option<&'static str>,
    /// Other values of these parameters, one at a time, that `auto` tries: cheaper or better ones than the defaults.
    pub variants: &'static [(&'static str, &'static str)],
}

/// Declares the methods: `Variant = "name", "help", supply, parameter group, variants`.
macro_rules! methods {
    ($($Method:ident = $name:literal, $help:literal, $supply:ident, $group:expr, $variants:expr;)*) => {
        param::choices! {
            /// How mirrors show what they reflect.
            pub enum Method { $($Method = $name),* }
        }

        /// Every method, in the order of the menu.
        pub const METHODS: &[MethodRow] = &[$(MethodRow {
            method: Method::$Method,
            name: $name,
            help: $help,
            supply: Supply::$supply,
            group: $group,
            variants: &$variants,
        }),*];
    };
}

methods! {
    Auto = "auto", "sscr_hierarchical; what measuring chooses for --budget, --error or view.still_ms", Everything, None, [];
    None = "none", "Mirrors stay plain grey: the scene without reflections", Nothing, None, [];
    EnvironmentMap = "environment_map",
        "A picture of the surroundings from each mirror's middle, looked up by direction alone",
        Everything, Some("environment_map"), [("environment_map.size", "64"), ("environment_map.proxy", "box")];
    MirroredViewpoint = "mirrored_viewpoint",
        "The scene from an eye behind each mirror's plane: exact for flat mirrors; four of them, one reflection",
        Everything, None, [];
    Sscr = "sscr",
        "Screen-space curved reflections as published (Preiner 2010): a root search for each point",
        WithMirrors, Some("sscr"), [("sscr.seed_attempts", "1")];
    SscrHierarchical = "sscr_hierarchical",
        "Nodes of points descend into beams of reflected rays; each ray ends at the disc it meets",
        Everything, None, [];
    SurfelTrace = "surfel_trace", "Reflected rays traced through the points as discs, on the GPU", Everything, None, [];
    CubemapTrace = "cubemap_trace",
        "Reflected rays walk through pictures of depths around each mirror; what they do not show is traced",
        Everything, Some("cubemap_trace"),
        [("cubemap_trace.size", "128"), ("cubemap_trace.maps", "1"), ("cubemap_trace.rest", "none")];
    ScreenTrace = "screen_trace",
        "Reflected rays walk through the depths of the camera's picture; what it does not show is traced",
        Everything, Some("screen_trace"), [("screen_trace.rest", "none")];
    SampleCameras = "sample_cameras",
        "Bundles of reflected rays, fitted to squares of the mirror's picture, project each point",
        Everything, Some("sample_cameras"), [("sample_cameras.degree", "3"), ("sample_cameras.rest", "none")];
    LightField = "light_field",
        "Maps of the points that stand all over each mirror, looked up where each ray meets what they show",
        Everything, Some("light_field"), [];
}

/// The ray tracer as a method; the renderer does not have it.
pub const RAY_TRACE: &str = "ray_trace";

impl Method {
    pub fn row(self) -> &'static MethodRow {
        &METHODS[self as usize]
    }

    /// The method that is run, with `auto` resolved.
    pub fn chosen(self) -> Self {
        if self == Self::Auto { Self::SscrHierarchical } else { self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Settings;

    #[test]
    fn every_row_is_found_by_its_method_and_names_a_group_of_parameters() {
        let settings = Settings::default();
        let groups: Vec<&str> = settings.groups().iter().map(|params| params.group().name).collect();
        for row in METHODS {
            assert_eq!(row.method.row().name, row.name);
            assert!(row.group.is_none_or(|group| groups.contains(&group)), "{}", row.name);
            let mut settings = settings.clone();
            for (key, value) in row.variants {
                assert!(row.group.is_some_and(|group| key.starts_with(&format!("{group}."))), "{key}");
                settings.set_text(key, value).unwrap();
            }
            assert!(!row.help.is_empty() && !row.help.contains('\n'), "{}", row.name);
            assert!(row.name != RAY_TRACE);
            assert_eq!(row.method.chosen().row().supply, row.supply, "{}", row.name);
        }
    }
}
