//! Draws settings of a view, with their times and errors.

use render::FrameStats;
use scene::{Camera, Method, Settings};

use super::Hands;
use super::changes::{Change, Squares, squares_of};
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

/// Frames are drawn for a time until they took so many milliseconds.
const ENOUGH: f64 = 400.0;

/// Methods that are known to take so many times what an exact one takes are not tried.
const SLOW: f64 = 3.0;

pub struct Search<'a, 'b, 'c> {
    pub camera: &'a Camera,
    pub hands: &'a mut Hands<'b, 'c>,
    /// The cost model with more weight on this view.
    pub local: CostModel,
    pub frames: usize,
}

impl Search<'_, '_, '_> {
    /// Draws the still picture, once.
    pub fn still(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<(Still, FrameStats)> {
        let stats = self.frame(settings, size)?;
        Ok((Still::read(self.hands.renderer, self.camera, settings, size)?, stats))
    }

    /// Draws the still picture. Its milliseconds are those of one frame, unless shaders were compiled for it, or it is so
    /// quick that one frame is no median.
    pub fn timed_still(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<(Still, f64)> {
        let (still, stats) = self.still(settings, size)?;
        let is_time = !stats.has_compiled && stats.frame_milliseconds > ENOUGH;
        let milliseconds = if is_time { stats.frame_milliseconds } else { self.timed(settings, size)?.1 };
        Ok((still, milliseconds))
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

    /// Draws a frame of a picture of `size`, and again if shaders were compiled for it, or frames took less than
    /// [`ENOUGH`], at most five. Returns the milliseconds.
    pub fn timed(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<(FrameStats, f64)> {
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
    /// changes whose times are known, one frame is drawn. Methods that are known to take far longer than `exact`, which
    /// makes no error, are left out. `work` is what a frame of the whole picture does with `base`.
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
        let is_slow = slow(&costs, (base, work), exact, size);
        let of_base = self.squares(base, true, still, size)?;
        let mut measured = Vec::new();
        for change in changes {
            let settings = change.of(base);
            let known = time(&costs, &settings);
            if is_slow(change) {
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
            change.milliseconds = time(&costs, &change.of(base)).unwrap_or(f64::INFINITY);
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

/// Whether a change is to a method that is known to take far longer than `exact` in a picture of `size`. In small
/// pictures, in which they are tried, times are known best.
pub fn slow<'a>(
    costs: &'a Costs,
    (base, work): (&'a Settings, &'a Workload),
    exact: Method,
    size: [u32; 2],
) -> impl Fn(&Change) -> bool + 'a {
    let work = work.of_pixels(size.map(f64::from).iter().product::<f64>(), base);
    let time = move |settings: &Settings| costs.predict(&work.with(base, settings), settings);
    let mut traced = base.clone();
    traced.reflection.method = exact;
    let longest = time(&traced).map_or(f64::INFINITY, |milliseconds| SLOW * milliseconds);
    move |change| change.is_of_method() && time(&change.of(base)).is_some_and(|milliseconds| milliseconds > longest)
}

/// Whether a picture was refused because of its method: one that cannot show the scene's glossy mirrors, or not beside
/// the own methods of mirrors, is no choice.
pub fn is_no_choice(error: &anyhow::Error) -> bool {
    use render::Error::{OneMethodOnly, PerfectMirrorsOnly};
    matches!(error.downcast_ref(), Some(PerfectMirrorsOnly { .. } | OneMethodOnly { .. }))
}
