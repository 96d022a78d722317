//! Draws settings of a view, with their times and errors.

use render::FrameStats;
use scene::{Camera, Method, Settings};

use super::Hands;
use super::changes::{Change, squares_of};
use crate::cost::{CostModel, Costs, Workload};
use crate::still::{Still, StillError, drawn_size};

/// A setting that was drawn.
#[derive(Clone, Debug)]
pub struct Drawn {
    pub settings: Settings,
    pub milliseconds: f64,
    pub error: StillError,
}

/// The most frames that are drawn for one time.
const MOST_FRAMES: usize = 4;

/// Frames of equal work agree if one takes at most so many times the other.
const AGREE: f64 = 1.2;

/// A frame that takes so many times what matters is out of reach.
const FAR: f64 = 4.0;

/// The frame that tells the time of frames of equal work: the second quickest, once the quickest agrees with it. So no
/// single frame decides, which other programs may have disturbed. A first frame tells the time alone if it took no
/// longer than `expected`. `None` while another frame is wanted.
fn telling(times: &[f64], expected: f64) -> Option<usize> {
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
    match order[..] {
        [] => None,
        [only] => (times[only] <= expected).then_some(only),
        [first, second, ..] => (times[second] <= AGREE * times[first] || times.len() >= MOST_FRAMES).then_some(second),
    }
}

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
    /// Draws the still picture, once. Returns its milliseconds, too, unless shaders were compiled for it.
    pub fn still(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<(Still, Option<f64>)> {
        let stats = self.frame(settings, size)?;
        let milliseconds = (!stats.has_compiled).then(|| self.learn(&stats, settings, size));
        Ok((Still::read(self.hands.renderer, self.camera, settings, size)?, milliseconds))
    }

    fn frame(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<FrameStats> {
        self.frames += 1;
        (self.hands.draw)(self.hands.renderer, settings, size)
    }

    /// Lets the cost models learn from a frame. Returns its milliseconds.
    fn learn(&mut self, stats: &FrameStats, settings: &Settings, size: [u32; 2]) -> f64 {
        self.hands.model.learn(stats, settings, size);
        self.local.learn(stats, settings, size);
        stats.frame_milliseconds
    }

    /// Draws frames of a picture of `size` until one tells its time, or two took [`FAR`] times what `matters`. The cost
    /// models learn from that frame, which is returned. Frames for which shaders were compiled tell no time. One frame is
    /// enough if it takes no longer than `expected`.
    pub fn timed(
        &mut self,
        settings: &Settings,
        size: [u32; 2],
        (expected, matters): (f64, f64),
    ) -> anyhow::Result<FrameStats> {
        let size = drawn_size(size, settings);
        let (mut frames, mut far): (Vec<FrameStats>, usize) = (Vec::new(), 0);
        loop {
            let stats = self.frame(settings, size)?;
            if stats.has_compiled {
                continue;
            }
            far += usize::from(stats.frame_milliseconds > FAR * matters);
            frames.push(stats);
            let times: Vec<f64> = frames.iter().map(|stats| stats.frame_milliseconds).collect();
            let is_far = (far > 1).then_some(frames.len() - 1);
            if let Some(index) = telling(&times, expected).or(is_far) {
                let stats = frames.swap_remove(index);
                self.learn(&stats, settings, size);
                return Ok(stats);
            }
        }
    }

    /// The milliseconds of one more frame of a setting.
    pub fn again(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<f64> {
        Ok(self.frame(settings, drawn_size(size, settings))?.frame_milliseconds)
    }

    /// Draws a setting in a picture of `size`, with its error; `times` are those of [`Self::timed`].
    pub fn drawn(
        &mut self,
        settings: &Settings,
        still: &Still,
        size: [u32; 2],
        times: (f64, f64),
    ) -> anyhow::Result<Drawn> {
        let milliseconds = self.timed(settings, size, times)?.frame_milliseconds;
        let error = still.error(self.hands.renderer, self.camera, settings, drawn_size(size, settings))?;
        Ok(Drawn { settings: settings.clone(), milliseconds, error })
    }

    /// Draws a picture of `size` for each change of `base`, and returns the squares of the errors of `base`, and what the
    /// changes add to them. A method that takes no longer than its known time is drawn once. Methods that are known to
    /// take far longer than `exact`, which makes no error, are left out. `work` is what a frame of the whole picture
    /// does with `base`.
    pub fn measured(
        &mut self,
        (base, work): (&Settings, &Workload),
        changes: &[Change],
        exact: Method,
        still: &Still,
        size: [u32; 2],
    ) -> anyhow::Result<(StillError, Vec<Change>)> {
        let small = work.of_pixels(size.map(f64::from).iter().product(), base);
        let mut traced = base.clone();
        traced.reflection.method = exact;
        let error_of_base = self.drawn(base, still, size, (0.0, f64::INFINITY))?.error;
        let of_base = squares_of(&error_of_base);
        let mut measured = Vec::new();
        for change in changes {
            let (settings, costs) = (change.of(base), self.local.costs());
            if slow(&costs, (base, work), exact, size)(change) {
                continue;
            }
            let time = |settings: &Settings| costs.predict(&small.with(base, settings), settings);
            // What costs the same passes as other changes is timed with them. A method rests on its own frames.
            let expected = time(&settings).map_or(0.0, |own| if change.is_of_method() { own } else { f64::INFINITY });
            let times = (expected, time(&traced).unwrap_or(f64::INFINITY));
            let own = match (settings != *base).then(|| self.drawn(&settings, still, size, times)) {
                Some(Ok(drawn)) => squares_of(&drawn.error),
                Some(Err(error)) if is_no_choice(&error) => continue,
                Some(Err(error)) => return Err(error),
                None => of_base,
            };
            measured.push(Change { squares: std::array::from_fn(|part| own[part] - of_base[part]), ..change.clone() });
        }
        let costs = self.local.costs();
        for change in &mut measured {
            let settings = change.of(base);
            change.milliseconds = costs.predict(&work.with(base, &settings), &settings).unwrap_or(f64::INFINITY);
        }
        Ok((error_of_base, measured))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_single_frame_tells_a_time_unless_it_is_as_quick_as_expected() {
        assert_eq!(telling(&[], 0.0), None);
        assert_eq!((telling(&[70.0], 0.0), telling(&[70.0], 69.0), telling(&[70.0], 70.0)), (None, None, Some(0)));
        assert_eq!((telling(&[70.0, 400.0], 60.0), telling(&[400.0, 70.0], 0.0)), (None, None));
        assert_eq!(telling(&[70.0, 400.0, 72.0], 0.0), Some(2));
        assert_eq!(telling(&[10.0, 71.0, 72.0], 0.0), None, "a frame that is too quick decides nothing either");
        assert_eq!(telling(&[10.0, 71.0, 100.0, 140.0], 0.0), Some(1), "four frames are enough");
    }
}
