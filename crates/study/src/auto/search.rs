//! Draws settings of a view, with their times and errors.

use render::FrameStats;
use scene::{Camera, Method, Settings};

use super::Hands;
use super::changes::{Change, NOISE, Squares, squares_of};
use crate::cost::{CostModel, Costs, Workload};
use crate::results::Spread;
use crate::still::{Still, StillError, drawn_size};

/// A setting that was drawn.
#[derive(Clone, Debug)]
pub struct Drawn {
    pub settings: Settings,
    pub milliseconds: f64,
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
        let (_, milliseconds) = self.timed(settings, size)?;
        let error = still.error(self.hands.renderer, self.camera, settings, drawn_size(size, settings))?;
        Ok(Drawn { settings: settings.clone(), milliseconds, error })
    }

    /// Draws a picture of `size` for each change of `base`, and returns what they add to the squares of its errors. Of
    /// changes whose times are known, one frame is drawn. Methods that take longer than `exact`, which makes no error,
    /// are left out. `work` is what a frame of the whole picture does with `base`.
    pub fn measured(
        &mut self,
        (base, work): (&Settings, &Workload),
        changes: &[Change],
        exact: Method,
        still: &Still,
        size: [u32; 2],
    ) -> anyhow::Result<Vec<Change>> {
        let time = |costs: &Costs, settings: &Settings| costs.predict(&work.with(base, settings), settings);
        let costs = self.local.costs();
        let mut traced = base.clone();
        traced.reflection.method = exact;
        let slowest = time(&costs, &traced).map_or(f64::INFINITY, |milliseconds| NOISE * milliseconds);
        let of_base = self.squares(base, true, still, size)?;
        let mut measured = Vec::new();
        for change in changes {
            let settings = change.of(base);
            let known = time(&costs, &settings);
            if change.is_of_method() && known.is_some_and(|milliseconds| milliseconds > slowest) {
                continue;
            }
            let own = match (settings != *base).then(|| self.squares(&settings, known.is_none(), still, size)) {
                Some(Ok(own)) => own,
                Some(Err(error)) if is_no_choice(&error) => continue,
                Some(Err(error)) => return Err(error),
                None => of_base,
            };
            measured.push(Change { squares: std::array::from_fn(|part| own[part] - of_base[part]), ..change.clone() });
        }
        let costs = self.local.costs();
        for change in &mut measured {
            change.milliseconds = time(&costs, &change.of(base)).unwrap_or_default();
        }
        Ok(measured)
    }

    /// Draws a setting, for its time, too, if that `is_wanted`. Returns the squares of its errors.
    fn squares(
        &mut self,
        settings: &Settings,
        is_wanted: bool,
        still: &Still,
        size: [u32; 2],
    ) -> anyhow::Result<Squares> {
        let drawn = drawn_size(size, settings);
        if is_wanted {
            self.timed(settings, size)?;
        } else {
            self.frame(settings, drawn)?;
        }
        Ok(squares_of(&still.error(self.hands.renderer, self.camera, settings, drawn)?))
    }
}

/// Whether a picture was refused because of its method: one that cannot show the scene's glossy mirrors, or not beside
/// the own methods of mirrors, is no choice.
pub fn is_no_choice(error: &anyhow::Error) -> bool {
    use render::Error::{OneMethodOnly, PerfectMirrorsOnly};
    matches!(error.downcast_ref(), Some(PerfectMirrorsOnly { .. } | OneMethodOnly { .. }))
}
