//! Presets of screen-space curved reflections: values of its parameters that belong together. The published values
//! depend on the shape of the mirror (Preiner 2010, figure 5.2).

use crate::{Method, Mirror, Settings, Shape, Sscr};

/// Values of the parameters of `sscr` that belong together.
#[derive(Debug, PartialEq)]
pub struct Preset {
    pub name: &'static str,
    pub help: &'static str,
    /// Keys and values. Parameters that are not named get their defaults.
    values: &'static [(&'static str, &'static str)],
    /// Whether splats, threshold and pull levels are those published for the scene's mirrors.
    is_by_mirror: bool,
}

pub const PRESETS: [Preset; 3] = [
    Preset {
        name: "Published",
        help: "As in the thesis (Preiner 2010, figure 5.2), by the shape of the mirror",
        values: &[("sscr.initial_step", "0.2"), ("sscr.seed_attempts", "6"), ("sscr.step_attempts", "6")],
        is_by_mirror: true,
    },
    Preset {
        name: "Fast",
        help: "Solves each point once with two further attempts, and only in regions whose rays can meet it",
        values: &[
            ("sscr.solve_once", "true"),
            ("sscr.cull_points", "true"),
            ("sscr.seed_attempts", "2"),
            ("sscr.step_attempts", "2"),
            ("sscr.pull_levels", "4"),
        ],
        is_by_mirror: false,
    },
    Preset {
        name: "Accurate",
        help: "Newton's method from a grid of starts, in four regions a point",
        values: &[
            ("sscr.solve_once", "true"),
            ("sscr.cull_points", "true"),
            ("sscr.solver", "newton"),
            ("sscr.seeds", "grid"),
            ("sscr.seed_attempts", "8"),
            ("sscr.regions_per_point", "4"),
            ("sscr.pull_levels", "1"),
        ],
        is_by_mirror: false,
    },
];

impl Preset {
    /// The preset of a name, in any case.
    ///
    /// # Errors
    /// There is none of that name; the message lists all.
    pub fn named(name: &str) -> Result<&'static Self, String> {
        PRESETS.iter().find(|preset| preset.name.eq_ignore_ascii_case(name)).ok_or_else(|| {
            let name = param::shortened(name, param::MOST_QUOTED);
            format!(
                "preset `{name}` is unknown; available: {}",
                PRESETS.each_ref().map(|preset| preset.name.to_lowercase()).join(", ")
            )
        })
    }

    /// Returns `settings` with this preset for a scene with these mirrors, and with its method.
    pub fn applied<'a>(&self, settings: &Settings, mirrors: impl Iterator<Item = &'a Mirror>) -> Settings {
        let mut settings = Settings { sscr: Sscr::default(), ..settings.clone() };
        settings.reflection.method = Method::Sscr;
        for (key, value) in self.values {
            // Setting cannot fail: a test checks the table against the parameters.
            let _ = settings.set_text(key, value);
        }
        if self.is_by_mirror {
            // Among several mirrors, the finest splats, the smallest threshold and the most levels serve all: a splat
            // that is too large for one mirror smudges it, one that is too small is closed by the levels.
            let all = mirrors.map(|mirror| published(&mirror.shape)).reduce(|a, b| Published {
                max_splat_size: a.max_splat_size.min(b.max_splat_size),
                threshold: a.threshold.min(b.threshold),
                pull_levels: a.pull_levels.max(b.pull_levels),
            });
            let Published { max_splat_size, threshold, pull_levels } = all.unwrap_or(Published::BUNNY);
            settings.sscr = Sscr { max_splat_size, threshold, pull_levels, ..settings.sscr };
        }
        settings
    }
}

/// What the thesis chose for one of its mirrors (figure 5.2).
struct Published {
    /// "Max. splat size", in pixels.
    max_splat_size: f32,
    /// "Threshold accuracy": the distance in pixels at which a bracket is interpolated.
    threshold: f32,
    /// "Pull-push levels".
    pull_levels: u32,
}

impl Published {
    const SPHERE: Self = Self { max_splat_size: 2.0, threshold: 2.0, pull_levels: 4 };
    const PARABOLIC: Self = Self { max_splat_size: 3.0, threshold: 4.0, pull_levels: 4 };
    const BLOB: Self = Self { max_splat_size: 3.0, threshold: 4.0, pull_levels: 4 };
    const TORUS: Self = Self { max_splat_size: 2.0, threshold: 3.0, pull_levels: 3 };
    const BUNNY: Self = Self { max_splat_size: 2.0, threshold: 2.0, pull_levels: 4 };
}

/// The published values of a shape. Those that the thesis does not have take the bunny's, whose surface is arbitrary.
fn published(shape: &Shape) -> Published {
    match shape {
        Shape::Sphere => Published::SPHERE,
        Shape::Paraboloid { .. } => Published::PARABOLIC,
        Shape::Blob => Published::BLOB,
        Shape::Torus { .. } => Published::TORUS,
        _ => Published::BUNNY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Solver;
    use crate::five_mirrors::Variant;

    #[test]
    fn every_value_of_a_preset_is_one_of_its_parameter() {
        for preset in &PRESETS {
            for (key, value) in preset.values {
                assert!(key.starts_with("sscr."), "{key}");
                Settings::default().set_text(key, value).unwrap();
            }
        }
    }

    #[test]
    fn the_published_values_are_those_of_the_mirror() {
        let values = |variant: Variant| {
            let mirrors = variant.mirrors();
            let sscr = Preset::named("published").unwrap().applied(&Settings::default(), mirrors.iter()).sscr;
            assert_eq!((sscr.initial_step, sscr.seed_attempts, sscr.step_attempts), (0.2, 6, 6), "{variant:?}");
            (sscr.max_splat_size, sscr.threshold, sscr.pull_levels)
        };
        assert_eq!(values(Variant::Sphere), (2.0, 2.0, 4));
        assert_eq!(values(Variant::Parabolic), (3.0, 4.0, 4));
        assert_eq!(values(Variant::Blob), (3.0, 4.0, 4));
        assert_eq!(values(Variant::Torus), (2.0, 3.0, 3));
        assert_eq!(values(Variant::Bunny), (2.0, 2.0, 4));
        assert_eq!(values(Variant::Coral), (2.0, 2.0, 4));
        assert_eq!(values(Variant::All), (2.0, 2.0, 4));
        assert_eq!(values(Variant::None), (2.0, 2.0, 4));
    }

    #[test]
    fn a_preset_sets_its_method_and_replaces_all_parameters_of_its_group() {
        let mut settings = Settings::default();
        settings.splat.size = 2.0;
        settings.sscr.max_steps = 7;
        let applied = Preset::named("ACCURATE").unwrap().applied(&settings, std::iter::empty());
        assert_eq!((applied.reflection.method, applied.splat.size), (Method::Sscr, 2.0));
        assert_eq!((applied.sscr.solver, applied.sscr.max_steps), (Solver::Newton, Sscr::default().max_steps));
    }

    #[test]
    fn an_unknown_preset_is_told_which_there_are() {
        let problem = Preset::named("publshed").unwrap_err();
        assert_eq!(problem, "preset `publshed` is unknown; available: published, fast, accurate");
    }
}
