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
    /// Whether the pass draws shadow maps that stand until what they show changes: those of lamps, or those of virtual
    /// lights, if there are any, which are placed by passes of their own.
    pub fn draws_shadow_maps(&self, has_virtual_lights: bool) -> bool {
        self.name == "shadow_maps" || has_virtual_lights && self.name.starts_with("vpl_")
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
