//! Draws settings of a view, with their times and errors.

use render::{FrameStats, PassStage, PassTime};
use scene::{Camera, Method, Settings};

use super::Hands;
use super::changes::{Change, Squares, squares_of};
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
/// single frame decides, which other programs may have disturbed. A first frame tells the time alone if it agrees with
/// what is `expected`, or took less. `None` while another frame is wanted.
fn telling(times: &[f64], expected: f64) -> Option<usize> {
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
    match order[..] {
        [] => None,
        [only] => (times[only] <= AGREE * expected).then_some(only),
        [first, second, ..] => (times[second] <= AGREE * times[first] || times.len() >= MOST_FRAMES).then_some(second),
    }
}

/// Times of methods agree if they differ by no more than a fifth and this share of a fifth of the frame.
const SMALL_SHARE: f64 = 0.25;

/// What the cost model knows of a change before it is tried: the milliseconds of the passes of its method and of those of
/// the exact one, and whether it knows the whole frame.
struct Known {
    own: f64,
    exact: f64,
    is_whole: bool,
}

/// Methods whose passes are known to take so many times what those of an exact one take are not tried.
pub const SLOW: f64 = 1.5;

/// Adds to the passes of a frame those of `base` that drew the shadow maps with which the frame was drawn: those of lamps,
/// or of virtual lights, and those that placed these, as far as it has none of its own: where reflections are followed or no
/// longer, the lights are placed anew and keep their maps. A frame without virtual lights has neither. Returns the
/// milliseconds that were added.
fn add_standing_maps(passes: &mut Vec<PassTime>, base: &[PassTime], has_virtual_lights: bool) -> f64 {
    let drawn = passes.len();
    let of_lights = passes.iter().filter(|pass| pass.is_of_virtual_lights());
    let (places, draws) = (of_lights.clone().next().is_some(), of_lights.clone().any(is_of_virtual_maps));
    let stands = |pass: &&PassTime| match pass.is_of_virtual_lights() {
        true => has_virtual_lights && !(if is_of_virtual_maps(pass) { draws } else { places }),
        false => pass.is_of_lamps() && !passes.iter().any(PassTime::is_of_lamps),
    };
    let standing: Vec<PassTime> = base.iter().filter(stands).cloned().collect();
    passes.extend(standing);
    passes[drawn..].iter().map(|pass| pass.milliseconds).sum()
}

/// Whether a pass of virtual lights draws their shadow maps.
fn is_of_virtual_maps(pass: &PassTime) -> bool {
    pass.name.starts_with("vpl_shadow")
}

/// What is known of the picture before any change, and the size in which changes are tried.
pub struct Unchanged {
    pub settings: Settings,
    /// What a frame of the whole picture does.
    pub work: Workload,
    pub size: [u32; 2],
    /// The squares of its errors, and its passes.
    pub squares: Squares,
    pub passes: Vec<PassTime>,
}

pub struct Search<'a, 'b, 'c> {
    pub camera: &'a Camera,
    pub hands: &'a mut Hands<'b, 'c>,
    /// The cost model with more weight on this view.
    pub local: CostModel,
    pub frames: usize,
}

impl Search<'_, '_, '_> {
    /// Draws the still picture, once, with the shadow maps of the frame before if their passes are given as `maps`.
    /// Returns its milliseconds, too, unless shaders were compiled for it, and its passes.
    pub fn still(
        &mut self,
        settings: &Settings,
        size: [u32; 2],
        maps: Option<&[PassTime]>,
    ) -> anyhow::Result<(Still, Option<f64>, Vec<PassTime>)> {
        let mut stats = match maps {
            Some(_) => self.frame_with_maps(settings, size)?,
            None => self.frame(settings, size)?,
        };
        stats.frame_milliseconds +=
            add_standing_maps(&mut stats.passes, maps.unwrap_or_default(), stats.virtual_lights > 0);
        let milliseconds = (!stats.has_compiled).then(|| self.learn(&stats, settings, size));
        Ok((Still::read(self.hands.renderer, self.camera, settings, size)?, milliseconds, stats.passes))
    }

    /// Draws a frame from scratch but for the shadow maps of the frame before, if it needs the same.
    fn frame_with_maps(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<FrameStats> {
        self.frames += 1;
        self.hands.renderer.forget_all_but_shadow_maps();
        (self.hands.draw)(self.hands.renderer, settings, size)
    }

    /// Draws a frame from scratch.
    fn frame(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<FrameStats> {
        self.frames += 1;
        self.hands.renderer.forget();
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
    /// enough if it agrees with what the cost model expects, and takes no longer than what matters.
    pub fn timed(&mut self, settings: &Settings, size: [u32; 2], matters: f64) -> anyhow::Result<FrameStats> {
        let size = drawn_size(size, settings);
        let costs = self.local.costs();
        let expected = |stats: &FrameStats| {
            let known = costs.predict(&Workload::of(stats, settings, size), settings);
            known.unwrap_or(0.0).min(matters / AGREE)
        };
        let draw = |search: &mut Self| search.frame(settings, size);
        let stats = self.told(draw, |stats| stats.frame_milliseconds, (expected, matters))?;
        self.learn(&stats, settings, size);
        Ok(stats)
    }

    /// Draws frames until one tells the time of what is measured, as [`Self::timed`] does.
    fn told(
        &mut self,
        mut draw: impl FnMut(&mut Self) -> anyhow::Result<FrameStats>,
        measured: impl Fn(&FrameStats) -> f64,
        (expected, matters): (impl Fn(&FrameStats) -> f64, f64),
    ) -> anyhow::Result<FrameStats> {
        let (mut frames, mut far): (Vec<FrameStats>, usize) = (Vec::new(), 0);
        loop {
            let stats = draw(self)?;
            if stats.has_compiled {
                continue;
            }
            far += usize::from(measured(&stats) > FAR * matters);
            let expected = expected(&stats);
            frames.push(stats);
            let times: Vec<f64> = frames.iter().map(&measured).collect();
            let is_far = (far > 1).then_some(frames.len() - 1);
            if let Some(index) = telling(&times, expected).or(is_far) {
                return Ok(frames.swap_remove(index));
            }
        }
    }

    /// The milliseconds of one more frame of a setting.
    pub fn again(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<f64> {
        Ok(self.frame(settings, drawn_size(size, settings))?.frame_milliseconds)
    }

    /// Draws a setting in a picture of `size`, with its error; `matters` is that of [`Self::timed`].
    pub fn drawn(&mut self, settings: &Settings, still: &Still, size: [u32; 2], matters: f64) -> anyhow::Result<Drawn> {
        let milliseconds = self.timed(settings, size, matters)?.frame_milliseconds;
        let error = still.error(self.hands.renderer, self.camera, settings, drawn_size(size, settings))?;
        Ok(Drawn { settings: settings.clone(), milliseconds, error })
    }

    /// Draws a small picture without any change. Returns its error and its passes.
    pub fn base_of_small(
        &mut self,
        base: &Settings,
        still: &Still,
        size: [u32; 2],
    ) -> anyhow::Result<(StillError, Vec<PassTime>)> {
        let passes = self.timed(base, size, f64::INFINITY)?.passes;
        let error = still.error(self.hands.renderer, self.camera, base, drawn_size(size, base))?;
        Ok((error, passes))
    }

    /// Draws a picture of a change, and returns its error. It is drawn with the shadow maps of the frame before where they
    /// are the same; the cost models learn that these took what they took without the change. Of a method the time of its
    /// passes is measured; other changes are timed with the rest, unless shaders are compiled for them and their time is
    /// known.
    fn tried(
        &mut self,
        change: &Change,
        settings: &Settings,
        (unchanged, still): (&Unchanged, &Still),
        known: Known,
    ) -> anyhow::Result<StillError> {
        let (size, is_of_method) = (drawn_size(unchanged.size, settings), change.is_of_method());
        // After the still picture its maps may stand, of more lights than the picture without the change has.
        let mut has_own_maps = change.set.iter().any(|(key, _)| *key == "gi.vpls");
        let mut draw = |search: &mut Self| {
            // After a frame for which shaders were compiled, the maps that it drew are drawn again to be timed. Those of a
            // method are the same as without the change, whose time is known.
            if has_own_maps {
                return search.frame(settings, size);
            }
            let stats = search.frame_with_maps(settings, size)?;
            has_own_maps = !is_of_method && stats.passes.iter().any(PassTime::is_of_shadow_maps);
            Ok(stats)
        };
        let mut stats = match is_of_method {
            true => {
                // A difference that is small beside the frame decides nothing.
                let small = SMALL_SHARE * unchanged.passes.iter().map(|pass| pass.milliseconds).sum::<f64>();
                let of_method = |stats: &FrameStats| small + PassTime::of_stage(&stats.passes, PassStage::Method);
                self.told(draw, of_method, (|_: &FrameStats| small + known.own, small + known.exact))?
            }
            false if known.is_whole => draw(self)?,
            false => self.told(draw, |_| 0.0, (|_: &FrameStats| 0.0, f64::INFINITY))?,
        };
        add_standing_maps(&mut stats.passes, &unchanged.passes, stats.virtual_lights > 0);
        if !stats.has_compiled {
            self.learn(&stats, settings, size);
        }
        Ok(still.error(self.hands.renderer, self.camera, settings, size)?)
    }

    /// Draws a small picture for each change, and returns what the changes add to the squares of the errors. What needs no
    /// other shadow maps is drawn with those of the frame before. A method whose time agrees with what is known is
    /// drawn once. Methods that are [`slow`] beside `exact`, which makes no error, are left out.
    pub fn measured(
        &mut self,
        unchanged: &Unchanged,
        still: &Still,
        changes: &[Change],
        exact: Method,
    ) -> anyhow::Result<Vec<Change>> {
        let Unchanged { settings: base, work, squares: of_base, .. } = unchanged;
        let small = small_work(base, work, unchanged.size);
        let mut traced = base.clone();
        traced.reflection.method = exact;
        let mut measured = Vec::new();
        for change in changes {
            let (settings, costs) = (change.of(base), self.local.costs());
            if slow(&costs, (base, work), exact, unchanged.size)(change) {
                continue;
            }
            let time =
                |settings: &Settings| costs.predict_stage(PassStage::Method, &small.with(base, settings), settings);
            let known = Known {
                own: time(&settings).unwrap_or(0.0),
                exact: time(&traced).unwrap_or(f64::INFINITY),
                is_whole: costs.predict(&small.with(base, &settings), &settings).is_some(),
            };
            let own = match (settings != *base).then(|| self.tried(change, &settings, (unchanged, still), known)) {
                Some(Ok(error)) => squares_of(&error),
                Some(Err(error)) if is_no_choice(&error) => continue,
                Some(Err(error)) => return Err(error),
                None => *of_base,
            };
            measured.push(Change { squares: std::array::from_fn(|part| own[part] - of_base[part]), ..change.clone() });
        }
        Ok(measured)
    }
}

/// What a frame of a picture of `size` does with `base`, of which `work` is what one of the whole picture does.
fn small_work(base: &Settings, work: &Workload, size: [u32; 2]) -> Workload {
    work.of_pixels(drawn_size(size, base).map(f64::from).iter().product(), base)
}

/// Whether a change is to a method whose passes are known to take [`SLOW`] times those of `exact`, in the whole picture and
/// in one of `size`: in small pictures, in which methods are tried, times are known best.
pub fn slow<'a>(
    costs: &'a Costs,
    (base, work): (&'a Settings, &'a Workload),
    exact: Method,
    size: [u32; 2],
) -> impl Fn(&Change) -> bool + 'a {
    let small = small_work(base, work, size);
    let mut traced = base.clone();
    traced.reflection.method = exact;
    let is_longer = move |settings: &Settings, work: &Workload| {
        let time = |settings| costs.predict_stage(PassStage::Method, &work.with(base, settings), settings);
        matches!((time(settings), time(&traced)), (Some(own), Some(exact)) if own > SLOW * exact)
    };
    move |change| {
        let settings = change.of(base);
        change.is_of_method() && [&small, work].into_iter().all(|work| is_longer(&settings, work))
    }
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
    fn maps_that_stand_take_what_they_took_and_others_nothing() {
        let pass = |(name, milliseconds): &(&'static str, f64)| PassTime {
            name,
            stage: PassStage::Light,
            milliseconds: *milliseconds,
        };
        let base: Vec<PassTime> =
            [("shadow_maps", 40.0), ("vpl_bounce", 5.0), ("vpl_shadow_splat", 60.0), ("indirect", 9.0)]
                .iter()
                .map(pass)
                .collect();
        let sum = |drawn: &[(&'static str, f64)], has_virtual_lights: bool| {
            let mut passes: Vec<PassTime> = drawn.iter().map(pass).collect();
            add_standing_maps(&mut passes, &base, has_virtual_lights);
            passes.iter().map(|pass| pass.milliseconds).sum::<f64>()
        };
        assert_eq!(sum(&[("indirect", 9.0)], true), 114.0, "all maps stand");
        assert_eq!(sum(&[("shade", 1.0)], false), 41.0, "without virtual lights");
        assert_eq!(
            sum(&[("vpl_bounce", 5.0), ("indirect", 9.0)], true),
            114.0,
            "lights are placed, and keep their maps"
        );
        assert_eq!(sum(&[("vpl_shadow_splat", 30.0), ("indirect", 9.0)], true), 79.0, "fewer lights of one bounce");
        assert_eq!(sum(&[("shadow_maps", 20.0), ("vpl_shadow_splat", 30.0)], true), 50.0, "all maps are drawn");
    }

    #[test]
    fn no_single_frame_tells_a_time_unless_it_agrees_with_what_is_expected() {
        assert_eq!(telling(&[], 0.0), None);
        assert_eq!((telling(&[70.0], 0.0), telling(&[70.0], 58.0), telling(&[70.0], 59.0)), (None, None, Some(0)));
        assert_eq!((telling(&[70.0, 400.0], 60.0), telling(&[400.0, 70.0], 0.0)), (None, None));
        assert_eq!(telling(&[70.0, 400.0, 72.0], 0.0), Some(2));
        assert_eq!(telling(&[10.0, 71.0, 72.0], 0.0), None, "a frame that is too quick decides nothing either");
        assert_eq!(telling(&[10.0, 71.0, 100.0, 140.0], 0.0), Some(1), "four frames are enough");
    }
}
