//! Draws settings of a view, with their times and errors.

use render::{FrameStats, PassStage};
use scene::{Camera, Settings};

use super::Hands;
use super::changes::{Change, Squares, squares_of};
use crate::cost::CostModel;
use crate::results::{Spread, stage_ms};
use crate::still::{Still, StillError, drawn_size};

/// A setting that was drawn.
#[derive(Clone, Debug)]
pub struct Drawn {
    pub settings: Settings,
    pub milliseconds: f64,
    /// The part of it that finds reflections.
    pub method_milliseconds: f64,
    pub error: StillError,
}

pub struct Search<'a, 'b, 'c> {
    pub camera: &'a Camera,
    pub hands: &'a mut Hands<'b, 'c>,
    /// The cost model with more weight on this view.
    pub local: CostModel,
    pub frames: usize,
}

impl Search<'_, '_, '_> {
    /// Draws the still picture, once. Returns its milliseconds, too, those of compiling among them.
    pub fn still(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<(Still, f64)> {
        let milliseconds = self.frame(settings, size)?.frame_milliseconds;
        Ok((Still::read(self.hands.renderer, self.camera, settings, size)?, milliseconds))
    }

    /// Draws a frame. The cost models learn from it unless shaders were compiled for it.
    fn frame(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<FrameStats> {
        let Hands { renderer, draw, model } = &mut *self.hands;
        let stats = draw(renderer, settings, size)?;
        self.frames += 1;
        if !stats.has_compiled {
            model.learn(&stats, settings, size);
            self.local.learn(&stats, settings, size);
        }
        Ok(stats)
    }

    /// Draws a frame of a picture of `size`, and again if shaders were compiled for it. Returns the milliseconds.
    pub fn timed(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<(FrameStats, f64)> {
        /// Frames are drawn until they took so many milliseconds, at least one and at most so many.
        const ENOUGH: f64 = 400.0;
        const MOST: usize = 5;
        let size = drawn_size(size, settings);
        let mut times: Vec<f64> = Vec::new();
        loop {
            let stats = self.frame(settings, size)?;
            if stats.has_compiled {
                continue;
            }
            times.push(stats.frame_milliseconds);
            if times.len() >= MOST || times.iter().sum::<f64>() > ENOUGH {
                let median = Spread::of(times).map_or(0.0, |spread| spread.median);
                return Ok((stats, median));
            }
        }
    }

    /// Draws a setting in full, with its error.
    pub fn drawn(&mut self, settings: &Settings, still: &Still, size: [u32; 2]) -> anyhow::Result<Drawn> {
        let (stats, milliseconds) = self.timed(settings, size)?;
        let error = still.error(self.hands.renderer, self.camera, settings, drawn_size(size, settings))?;
        let method_milliseconds = stage_ms(&stats.passes, PassStage::Method);
        Ok(Drawn { settings: settings.clone(), milliseconds, method_milliseconds, error })
    }

    /// Draws a picture of `size` for each change of `base`, and returns what they add to the squares of its errors,
    /// which come first.
    pub fn measured(
        &mut self,
        base: &Settings,
        changes: Vec<Change>,
        still: &Still,
        size: [u32; 2],
    ) -> anyhow::Result<(Squares, Vec<Change>)> {
        let first = self.drawn(base, still, size)?;
        let of_base = squares_of(&first.error);
        let mut measured = Vec::new();
        for mut change in changes {
            let settings = change.of(base);
            let drawn = match (settings != *base).then(|| self.drawn(&settings, still, size)) {
                Some(Ok(drawn)) => drawn,
                Some(Err(error)) if is_no_choice(&error) => continue,
                Some(Err(error)) => return Err(error),
                None => first.clone(),
            };
            let own = squares_of(&drawn.error);
            change.squares = std::array::from_fn(|part| own[part] - of_base[part]);
            change.method_milliseconds = drawn.method_milliseconds;
            measured.push(change);
        }
        Ok((of_base, measured))
    }
}

/// Whether a picture was refused because of its method: one that cannot show the scene's glossy mirrors, or not beside
/// the own methods of mirrors, is no choice.
pub fn is_no_choice(error: &anyhow::Error) -> bool {
    use render::Error::{OneMethodOnly, PerfectMirrorsOnly};
    matches!(error.downcast_ref(), Some(PerfectMirrorsOnly { .. } | OneMethodOnly { .. }))
}
