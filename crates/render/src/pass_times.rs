//! The times of a frame and of its passes.

use crate::passes::PassStage;

/// The time of one pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassTime {
    /// The name of the pass's shader, or `clear`; for splatting on behalf of a reflection method, the method's name for
    /// it.
    pub name: &'static str,
    pub stage: PassStage,
    pub milliseconds: f64,
}

impl PassTime {
    /// The milliseconds of all passes of one stage.
    pub fn of_stage(passes: &[Self], stage: PassStage) -> f64 {
        // The sum of nothing begins with a negative zero.
        passes.iter().filter(|pass| pass.stage == stage).fold(0.0, |sum, pass| sum + pass.milliseconds)
    }

    /// Whether the pass draws the shadow maps of lamps, which stand until what they show changes.
    pub fn is_of_lamps(&self) -> bool {
        self.name == "shadow_maps"
    }

    /// Whether the pass places virtual lights or draws their shadow maps, which stand as long.
    pub fn is_of_virtual_lights(&self) -> bool {
        self.name.starts_with("vpl_")
    }

    /// Whether it is one of either.
    pub fn is_of_shadow_maps(&self) -> bool {
        self.is_of_lamps() || self.is_of_virtual_lights()
    }
}

/// The times of a frame, milliseconds.
pub(crate) struct Times {
    /// In order; passes that ran several times are summed. None if they were timed together.
    pub passes: Vec<PassTime>,
    /// From the first pass to the last.
    pub total: f64,
    /// The part that splats the points that the camera sees.
    pub splatting: f64,
    pub dispatches: u32,
    /// How often the GPU was waited for.
    pub waits: u32,
}

/// Adds up the times of passes of the same name, in the order in which the first of each ran.
pub(crate) fn summed(times: Vec<PassTime>) -> Vec<PassTime> {
    let mut sums: Vec<PassTime> = Vec::new();
    for time in times {
        match sums.iter_mut().find(|sum| sum.name == time.name) {
            Some(sum) => sum.milliseconds += time.milliseconds,
            None => sums.push(time),
        }
    }
    sums
}
