//! What `--budget` and `--error` let `auto` choose, for `glint render` and `glint record`.

use std::collections::BTreeMap;

use param::Choice as _;
use render::{Gpu, Renderer};
use scene::{Method, Settings};
use serde::{Deserialize, Serialize};
use study::{Choice, StillError, Subject, Target, auto};

use crate::commands::listing;
use crate::shared::command_line::TargetArguments;
use crate::system::failure::usage;
use crate::system::{costs, interrupt, terminal};

/// The object `auto` of `--stats`. The error's unit is that of the target, colours for a time.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AutoStats {
    pub target: String,
    pub method: String,
    pub set: BTreeMap<String, serde_json::Value>,
    pub predicted_ms: f64,
    pub predicted_error: f64,
    pub error_unit: String,
    /// All errors against the still picture; `None` in records of versions that did not take them apart.
    #[serde(default)]
    pub errors: Option<StillError>,
    pub why: String,
    /// The seconds that choosing took, and the frames that were drawn for it.
    pub seconds: f64,
    pub frames: usize,
}

impl AutoStats {
    pub fn new(target: Target, choice: &Choice, settings: &Settings) -> Self {
        let mut set = BTreeMap::new();
        for params in settings.groups() {
            let group = params.group();
            for (field, value) in group.fields.iter().zip(params.values()) {
                let key = format!("{}.{}", group.name, field.name);
                if choice.set.contains_key(&key) {
                    set.insert(key, listing::value_json(field, &value));
                }
            }
        }
        Self {
            target: target.to_string(),
            method: settings.reflection.method.name().to_owned(),
            set,
            predicted_ms: choice.predicted_ms,
            predicted_error: choice.predicted_error,
            error_unit: target.error_unit().to_owned(),
            errors: choice.errors,
            why: choice.why.clone(),
            seconds: choice.seconds,
            frames: choice.frames,
        }
    }
}

impl TargetArguments {
    /// The target that was named, if any.
    pub fn target(&self) -> Option<Target> {
        self.budget.or(self.error)
    }
}

/// Refuses a target where there is nothing to choose.
///
/// # Errors
/// Bad usage: the method is the ray tracer, which is measured by nothing.
pub fn check(target: Option<Target>, method: Option<&str>) -> anyhow::Result<()> {
    match target {
        Some(target) if method == Some(study::RAY_TRACE) => Err(usage(format!(
            "{target}: the method {} runs on the CPU and keeps to no target; leave --method out, or name another one",
            study::RAY_TRACE
        ))),
        _ => Ok(()),
    }
}

/// The parameters that stay as they are: those that the command line names, and the method if anything names one.
pub fn fixed(set: &[(String, String)], settings: &Settings) -> Vec<String> {
    let mut fixed: Vec<String> = set.iter().map(|(key, _)| key.clone()).collect();
    if settings.reflection.method != Method::Auto {
        fixed.push("reflection.method".to_owned());
    }
    fixed
}

/// Lets `auto` choose for a picture of `size` pixels, and sets what it chose. `fixed` names the parameters that stay.
/// The choice is reported on standard output, and what was measured for it is kept for the next one.
///
/// # Errors
/// If the device was lost, there is no memory for a frame, or on Ctrl-C.
pub fn choose(
    target: Target,
    settings: &mut Settings,
    fixed: &[String],
    subject: &Subject,
    size: [u32; 2],
    gpu: &Gpu,
    renderer: &mut Renderer,
) -> anyhow::Result<AutoStats> {
    let (mut model, problem) = costs::load(&gpu.info.name);
    terminal::warn(problem);
    let mut draw = |renderer: &mut Renderer, settings: &Settings, size: [u32; 2]| {
        interrupt::check()?;
        Ok(subject.render_next(renderer, settings, size)?)
    };
    let view = (&subject.camera, size);
    let mut hands = auto::Hands { renderer, draw: &mut draw, model: &mut model };
    let chosen = auto::choose(target, settings, fixed, view, &mut hands);
    // The choice is not lost where the times cannot be kept.
    terminal::warn(costs::save(&gpu.info.name, &model).err().map(|error| format!("{error:#}")));
    let choice = chosen?;
    choice.apply(settings)?;
    let set: Vec<String> = choice.set.iter().map(|(key, value)| format!("{key}={value}")).collect();
    terminal::print([format!("auto: {}: {}", set.join(" "), choice.why)])?;
    Ok(AutoStats::new(target, &choice, settings))
}
