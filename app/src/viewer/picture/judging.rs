//! How far moving pictures are from the pictures at rest of the same views: a mode for measurements, because a number of
//! pictures a second says nothing without their quality.

use render::{PictureRows, Renderer};
use scene::Settings;

use crate::viewer::picture::frame_request::{FrameRequest, hurried};

/// One in so many moving pictures is judged.
const EACH: u32 = 10;

/// Judges moving pictures where the environment variable GLINT_EVENT_FLIP is set.
pub struct MovingJudge {
    is_on: bool,
    count: u32,
    /// The settings of the last picture at rest.
    still: Option<Settings>,
}

impl MovingJudge {
    pub fn from_environment() -> Self {
        let is_on = std::env::var_os("GLINT_EVENT_FLIP").is_some_and(|value| !value.is_empty());
        Self { is_on, count: 0, still: None }
    }

    /// Must be called with each picture at rest.
    pub fn on_still(&mut self, request: &FrameRequest) {
        if self.is_on {
            self.still = Some(request.settings.clone());
        }
    }

    /// Whether `still_of` counts a frame as the next one to judge.
    pub fn is_next(&self, request: &FrameRequest) -> bool {
        self.is_on && request.spared.is_some() && (self.count + 1).is_multiple_of(EACH)
    }

    /// The request of the picture at rest to which a moving one is compared; `None` if this one is not judged, or if
    /// values move and no camera.
    pub fn still_of(&mut self, request: &FrameRequest) -> Option<FrameRequest> {
        if !self.is_on || request.spared.is_none() {
            return None;
        }
        self.count += 1;
        let still = self.still.as_ref().filter(|_| self.count.is_multiple_of(EACH))?;
        (hurried(still, false) == request.settings).then(|| request.unhurried(still))
    }
}

/// The mean FLIP of a moving picture, enlarged as the window enlarges it, to the picture that the renderer holds.
///
/// # Errors
/// The device was lost.
pub fn flip_to_still(moving: &PictureRows, from: [u32; 2], renderer: &Renderer, size: [u32; 2]) -> render::Result<f64> {
    let still = renderer.read_picture()?;
    // Without depths nothing is told apart, as between the pixels of a texture.
    let depths = vec![1.0; (from[0] * from[1]) as usize];
    let moving = study::picture::enlarged(&moving.tight(), &depths, from, size);
    let [moving, still] = [moving, still].map(|picture| study::picture::linear(&picture));
    let flip = study::flip::flip(size[0] as usize, &moving, &still);
    Ok(flip.iter().sum::<f64>() / flip.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::picture::pace::Spared;

    #[test]
    fn it_is_known_beforehand_which_frames_are_judged() {
        let still = FrameRequest::any();
        let mut judge = MovingJudge { is_on: true, count: 0, still: Some(still.settings.clone()) };
        let settings = hurried(&still.settings, false);
        let moving = FrameRequest { settings, spared: Some(Spared::NOTHING), hurried: true, ..still };
        let judged: Vec<bool> = (0..2 * EACH)
            .map(|_| {
                let is_next = judge.is_next(&moving);
                assert_eq!(judge.still_of(&moving).is_some(), is_next);
                is_next
            })
            .collect();
        assert_eq!(judged.iter().filter(|is| **is).count(), 2);
    }
}
