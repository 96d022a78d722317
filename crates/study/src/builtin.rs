//! The plans that are built into the program.

use crate::plan::{Plan, PlanError};

/// The name and the text of each plan.
const PLANS: [(&str, &str); 26] = [
    ("methods", include_str!("../../../assets/plans/methods.toml")),
    ("published", include_str!("../../../assets/plans/published.toml")),
    ("passes", include_str!("../../../assets/plans/passes.toml")),
    ("seed-attempts", include_str!("../../../assets/plans/seed-attempts.toml")),
    ("step-attempts", include_str!("../../../assets/plans/step-attempts.toml")),
    ("both-attempts", include_str!("../../../assets/plans/both-attempts.toml")),
    ("initial-step", include_str!("../../../assets/plans/initial-step.toml")),
    ("close-up", include_str!("../../../assets/plans/close-up.toml")),
    ("pull-levels", include_str!("../../../assets/plans/pull-levels.toml")),
    ("density", include_str!("../../../assets/plans/density.toml")),
    ("viewport", include_str!("../../../assets/plans/viewport.toml")),
    ("mirrors", include_str!("../../../assets/plans/mirrors.toml")),
    ("solvers", include_str!("../../../assets/plans/solvers.toml")),
    ("streamed", include_str!("../../../assets/plans/streamed.toml")),
    ("cubemap", include_str!("../../../assets/plans/cubemap.toml")),
    ("cameras", include_str!("../../../assets/plans/cameras.toml")),
    ("gloss", include_str!("../../../assets/plans/gloss.toml")),
    ("light-field", include_str!("../../../assets/plans/light-field.toml")),
    ("light", include_str!("../../../assets/plans/light.toml")),
    ("screen", include_str!("../../../assets/plans/screen.toml")),
    ("bounces", include_str!("../../../assets/plans/bounces.toml")),
    ("points", include_str!("../../../assets/plans/points.toml")),
    ("auto", include_str!("../../../assets/plans/auto.toml")),
    ("oracle", include_str!("../../../assets/plans/oracle.toml")),
    ("surfaces", include_str!("../../../assets/plans/surfaces.toml")),
    ("stability", include_str!("../../../assets/plans/stability.toml")),
];

/// The names of the plans.
pub fn names() -> impl Iterator<Item = &'static str> {
    PLANS.iter().map(|(name, _)| *name)
}

/// The plan of this name, if there is one.
///
/// # Errors
/// None: a test checks all of them.
pub fn plan(name: &str) -> Option<Result<Plan, PlanError>> {
    let (_, text) = PLANS.iter().find(|(known, _)| *known == name)?;
    Some(Plan::parse(name, text))
}

#[cfg(test)]
mod tests {
    use param::Choice as _;

    use super::*;

    #[test]
    fn every_plan_is_sound_and_survives_being_written() {
        for name in names() {
            let plan = plan(name).unwrap().unwrap();
            assert!(!plan.about.is_empty() && !plan.cases().is_empty(), "{name}");
            assert_eq!(Plan::parse(name, &plan.to_text()), Ok(plan));
        }
    }

    #[test]
    fn the_plan_of_methods_has_every_method_of_the_renderer() {
        let cases = plan("methods").unwrap().unwrap().cases();
        for name in scene::Method::NAMES.iter().filter(|name| **name != "auto") {
            let scenes = cases.iter().filter(|case| case.method == *name && case.swept.is_empty());
            assert!(scenes.count() >= 5, "{name}");
        }
    }
}
