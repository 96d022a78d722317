//! What a renderer does after a frame that failed.

use super::Renderer;
use crate::gpu::{Error, Result};

impl Renderer {
    /// Returns the failure from which others follow, if there is one: a buffer without memory, for example, is only told
    /// of after the fact. What is kept from frame to frame may lack something then, and is given up.
    pub(crate) fn checked<T>(&mut self, outcome: Result<T>) -> Result<T> {
        let is_failed = outcome.as_ref().is_err_and(|error| !matches!(error, Error::GivenUp));
        let known = if is_failed { self.gpu.wait() } else { self.gpu.failure() };
        let outcome = known.and(outcome);
        if matches!(outcome, Err(Error::Device { .. } | Error::NoMemory { .. } | Error::Lost(_))) {
            self.release();
        }
        outcome
    }

    /// Gives up all images and buffers.
    pub(crate) fn release(&mut self) {
        let pipelines = std::mem::take(&mut self.pipelines);
        let bare = Self::bare(self.gpu.clone());
        let before = std::mem::replace(self, bare);
        self.pipelines = pipelines;
        (self.samples_at_once, self.most_points) = (before.samples_at_once, before.most_points);
        (self.given_up, self.longest_piece) = (before.given_up, before.longest_piece);
        (self.exposure.share, self.prepared) = (before.exposure.share, before.prepared);
        (self.gi.may_lag, self.gi.keeper.reuse) = (before.gi.may_lag, before.gi.keeper.reuse);
    }
}
