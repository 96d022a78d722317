//! Passes that are submitted together and timed by the host's clock.

use std::collections::BTreeSet;
use std::time::Instant;

use scene::Settings;

use crate::gpu::PipelineKey;
use crate::recorder::Pipelines;

/// Passes that are submitted together and timed by the host's clock.
#[derive(Default)]
pub(crate) struct Together {
    /// Whether they splat what the camera sees.
    pub splats: bool,
    /// When the first of them was submitted, if one was.
    pub since: Option<Instant>,
    pub passes: BTreeSet<PipelineKey>,
    /// The milliseconds that they are estimated to take.
    pub estimated: f64,
}

impl Together {
    /// Corrects what is known of the passes by the time that they have taken together. Returns it, in milliseconds.
    pub fn learn(&self, pipelines: &mut Pipelines, settings: &Settings) -> f64 {
        let milliseconds = self.since.map_or(0.0, |since| since.elapsed().as_secs_f64() * 1000.0);
        if self.estimated > 0.0 {
            for pass in &self.passes {
                if let Some(compiled) = pipelines.get_mut(pass) {
                    compiled.correct(milliseconds / self.estimated, settings);
                }
            }
        }
        milliseconds
    }
}
