//! How budgets are divided: the budgets of streaming among the open clouds, the time of a frame while something moves, and
//! the processors between frames and the window.

use std::time::Duration;

use render::FrameStats;

use crate::viewer::picture::frame_request::FrameRequest;

/// Divides a budget among clouds. Each demand is the share that the cloud would use if it were the only one. Clouds
/// that need little get what they need, and the others share the rest evenly. What nobody needs is added evenly to all.
pub fn shares(demands: &[f64]) -> Vec<f64> {
    // Demands are rounded up to steps: then small movements of the camera leave the shares as they are, and each share
    // is large enough for a node of any size.
    const STEPS: f64 = 16.0;
    let needs: Vec<f64> = demands.iter().map(|demand| (demand * STEPS).ceil().clamp(1.0, STEPS) / STEPS).collect();
    let mut shares = vec![0.0; needs.len()];
    let mut order: Vec<usize> = (0..needs.len()).collect();
    order.sort_by(|a, b| needs[*a].total_cmp(&needs[*b]));
    let mut left = 1.0;
    for (place, index) in order.iter().enumerate() {
        shares[*index] = needs[*index].min(left / (order.len() - place) as f64);
        left -= shares[*index];
    }
    let more = left / needs.len().max(1) as f64;
    shares.iter().map(|share| share + more).collect()
}

/// When the window is painted next: after the delay, or at once where something has changed, but not before the pause is
/// over.
pub fn next_paint(delay: Duration, is_changed: bool, pause: Option<Duration>) -> Duration {
    let wanted = if is_changed { Duration::ZERO } else { delay };
    wanted.max(pause.unwrap_or_default())
}

/// By how much a frame is coarser while something moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spared {
    /// The factor by which each side of the picture has fewer pixels.
    pub divisor: u32,
    /// The most points to draw; `None` draws all that the camera sees.
    pub most_points: Option<u64>,
    /// The most points that mirrors reflect; `None` for all.
    pub most_reflected: Option<u64>,
}

impl Spared {
    pub const NOTHING: Self = Self { divisor: 1, most_points: None, most_reflected: None };

    /// Returns the size of the picture in pixels, from the size that it fills in the window.
    pub fn size(self, size: [u32; 2]) -> [u32; 2] {
        size.map(|side| side.div_ceil(self.divisor))
    }
}

/// Chooses how coarse frames are while something moves. It learns from earlier frames how long a point and a pixel
/// take.
#[derive(Default)]
pub struct Haste {
    /// The milliseconds that each drawn point takes.
    per_point: f64,
    /// The milliseconds that each pixel takes.
    per_pixel: f64,
    /// The number of points drawn by the last frame without a limit on them.
    points: f64,
    chosen: Option<Spared>,
}

impl Haste {
    /// The largest divisor. Nobody recognises a coarser picture.
    const MOST_DIVISOR: u32 = 5;
    /// The least number of points per pixel. Fewer, larger points cost a picture less than fewer pixels do:
    /// docs/performance.md has the differences that a person sees.
    const LEAST_POINTS: f64 = 1.0;

    /// Learns from a frame that took `milliseconds` and should have taken `wanted`.
    pub fn learn(&mut self, stats: &FrameStats, request: &FrameRequest, milliseconds: f64, wanted: f64) {
        let pixels = request.drawn_size().map(f64::from).iter().product::<f64>().max(1.0);
        let drawn = stats.points_drawn as f64;
        if request.spared.is_none_or(|spared| spared.most_points.is_none()) {
            self.points = drawn;
        }
        // A frame that keeps the surfaces of the frame before measures no points. A frame in full quality only gives
        // the first estimate.
        let tells = stats.splatting_milliseconds > 0.0 && (request.hurried || self.per_point == 0.0);
        if !tells {
            return;
        }
        let per_point = stats.splatting_milliseconds / drawn.max(1.0);
        let per_pixel = (milliseconds - stats.splatting_milliseconds).max(0.0) / pixels;
        // The estimates follow the fastest recent frames. Other programs slow down single frames, and a coarser picture
        // would not help against that.
        let slower = |known: f64, measured: f64| if known > 0.0 { measured.min(known * 1.1) } else { measured };
        self.per_point = slower(self.per_point, per_point);
        self.per_pixel = slower(self.per_pixel, per_pixel);
        // Small deviations change nothing, because each new choice makes the picture jump.
        if !(0.5..1.2).contains(&(milliseconds / wanted.max(1.0))) {
            self.chosen = None;
        }
    }

    /// Returns how coarse frames of a movement are. The choice stays as long as its frames take about the wanted time.
    pub fn spare(&mut self, size: [u32; 2], wanted: f64) -> Spared {
        let spared = self.chosen.unwrap_or_else(|| self.choose(size, wanted));
        self.chosen = Some(spared);
        spared
    }

    /// Chooses how coarse a frame of `size` pixels must be to take `wanted` milliseconds. It first reduces the pixels,
    /// until there is time for enough points for those that are left, and then the points.
    pub fn choose(&self, size: [u32; 2], wanted: f64) -> Spared {
        let choice = |divisor: u32| {
            let pixels = Spared { divisor, ..Spared::NOTHING }.size(size).map(f64::from).iter().product::<f64>();
            let affordable = (wanted - self.per_pixel * pixels) / self.per_point.max(1e-9);
            (affordable, pixels * Self::LEAST_POINTS)
        };
        let divisors = 1..=Self::MOST_DIVISOR;
        let fitting = divisors.clone().find(|divisor| {
            let (affordable, least) = choice(*divisor);
            affordable >= least.min(self.points)
        });
        let divisor = fitting.unwrap_or(Self::MOST_DIVISOR);
        let (affordable, least) = choice(divisor);
        // If even the least number of points takes too long, the frame draws it all the same.
        let most = affordable.max(least);
        Spared { divisor, most_points: (most < self.points).then_some(most as u64), ..Spared::NOTHING }
    }
}

/// Chooses how coarse quick pictures are (`render::QuickPicture`). It learns from earlier ones how long a point and a pixel
/// take.
pub struct QuickPace {
    /// The milliseconds that each point takes, and each pixel.
    per_point: f64,
    per_pixel: f64,
    /// The number of points that the last picture without a limit on them drew.
    points: f64,
    /// Whether a picture has been measured.
    has_learned: bool,
    chosen: Option<Spared>,
}

impl Default for QuickPace {
    fn default() -> Self {
        // A processor with two cores, until a picture has been measured.
        Self { per_point: 1e-5, per_pixel: 4e-5, points: 0.0, has_learned: false, chosen: None }
    }
}

impl QuickPace {
    /// The largest divisor: a coarser picture cannot be read. It comes before fewer points do: in the same time, all points
    /// at half of the pixels along each side differ less from the picture at rest (docs/performance.md).
    const MOST_DIVISOR: u32 = 2;
    /// The least number of points per pixel.
    const LEAST_POINTS: f64 = 1.0;

    /// Learns from a picture that should have taken `wanted` milliseconds. What mirrors show counts apart.
    pub fn learn(&mut self, stats: &FrameStats, request: &FrameRequest, wanted: f64) {
        let milliseconds = stats.frame_milliseconds;
        let pixels = request.drawn_size().map(f64::from).iter().product::<f64>().max(1.0);
        if request.spared.is_none_or(|spared| spared.most_points.is_none()) {
            self.points = stats.points_drawn as f64;
        }
        // The estimates follow the fastest recent pictures, because other programs slow down single ones.
        let most = if self.has_learned { 1.1 } else { f64::INFINITY };
        let slower = |known: f64, measured: f64| measured.min(known * most);
        self.per_point = slower(self.per_point, stats.splatting_milliseconds / stats.points_drawn.max(1) as f64);
        self.per_pixel = slower(self.per_pixel, (milliseconds - stats.splatting_milliseconds).max(0.0) / pixels);
        self.has_learned = true;
        // Small deviations change nothing, because each new choice makes the picture jump.
        if !(0.4..1.25).contains(&(milliseconds / wanted.max(1.0))) {
            self.chosen = None;
        }
    }

    /// Returns how coarse pictures of a movement are. The choice stays as long as they take about the wanted time.
    pub fn spare(&mut self, size: [u32; 2], wanted: f64) -> Spared {
        let spared = self.chosen.unwrap_or_else(|| self.choose(size, wanted));
        self.chosen = Some(spared);
        spared
    }

    /// Chooses how coarse a picture of `size` pixels must be to take `wanted` milliseconds.
    pub fn choose(&self, size: [u32; 2], wanted: f64) -> Spared {
        let pixels =
            |divisor: u32| Spared { divisor, ..Spared::NOTHING }.size(size).map(f64::from).iter().product::<f64>();
        let affordable = |divisor: u32| (wanted - self.per_pixel * pixels(divisor)) / self.per_point.max(1e-9);
        let divisors = 1..=Self::MOST_DIVISOR;
        let divisor = divisors.clone().find(|divisor| affordable(*divisor) >= self.points);
        let divisor = divisor.unwrap_or(Self::MOST_DIVISOR);
        // If even the least number of points takes too long, the picture draws it all the same.
        let most = affordable(divisor).max(Self::LEAST_POINTS * pixels(divisor));
        Spared { divisor, most_points: (most < self.points).then_some(most as u64), ..Spared::NOTHING }
    }
}

/// How long the exposure takes to go two thirds of its way: eyes take longer, but nobody wants to wait.
const ADAPTATION: Duration = Duration::from_millis(250);

/// The longest time that counts between two frames: after a rest, the way begins when the picture changes.
const LONGEST_STEP: Duration = Duration::from_millis(100);
/// The longest time that counts before a picture at rest, which may take long to draw, as may those that follow until the
/// exposure fits.
const LONGEST_STEP_AT_REST: Duration = Duration::from_millis(500);

/// The share of its way that the exposure goes in the time between two frames, of which the second may be a hurried one.
pub fn adapted_share(time: Duration, hurried: bool) -> f32 {
    let longest = if hurried { LONGEST_STEP } else { LONGEST_STEP_AT_REST };
    1.0 - (-time.min(longest).as_secs_f32() / ADAPTATION.as_secs_f32()).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_is_painted_at_once_after_a_change_but_not_while_the_processors_draw_a_frame() {
        let [soon, pause, late] = [0, 30, 400].map(Duration::from_millis);
        assert_eq!((next_paint(late, false, None), next_paint(late, true, None)), (late, soon));
        assert_eq!((next_paint(late, false, Some(pause)), next_paint(soon, false, Some(pause))), (late, pause));
        assert_eq!(next_paint(late, true, Some(pause)), pause);
    }

    #[test]
    fn budgets_go_to_who_needs_them() {
        assert_eq!(shares(&[1.0]), [1.0]);
        assert_eq!(shares(&[1.0, 1.0]), [0.5, 0.5]);
        // A cloud that needs little gets what it needs, not half.
        let uneven = shares(&[0.01, 1.0]);
        assert!(uneven[0] < 0.1 && uneven[1] > 0.9 && uneven.iter().sum::<f64>() <= 1.0, "{uneven:?}");
        // The order does not matter, and clouds that need too much get equal shares.
        let several = shares(&[1.0, 0.1, 0.8, 0.0]);
        assert!(several[0] == several[2] && several[0] > 0.4 && several[1] >= 0.1 && several[3] > 0.0, "{several:?}");
        // What no cloud needs is shared evenly.
        assert_eq!(shares(&[0.0, 0.0]), [0.5, 0.5]);
        assert!(shares(&[1.0; 100]).iter().all(|share| (share - 0.01).abs() < 1e-9));
        assert!(shares(&[0.0; 100]).iter().all(|share| (share - 0.01).abs() < 1e-9));
    }

    const SIZE: [u32; 2] = [1400, 900];

    /// Returns the statistics and the time of a frame of `points` points. `machine` holds the nanoseconds that the
    /// machine takes for a point and for a pixel.
    fn frame(machine: [f64; 2], points: u64, request: &FrameRequest) -> (FrameStats, f64) {
        let [per_point, per_pixel] = machine.map(|nanoseconds| nanoseconds * 1e-6);
        let most = request.spared.and_then(|spared| spared.most_points);
        let drawn = most.map_or(points, |most| most.min(points));
        let pixels = request.drawn_size().map(u64::from).iter().product::<u64>();
        let splatting = drawn as f64 * per_point;
        let milliseconds = splatting + pixels as f64 * per_pixel;
        let stats = FrameStats {
            passes: Vec::new(),
            frame_milliseconds: milliseconds,
            splatting_milliseconds: splatting,
            points_drawn: drawn,
            points_resident: points,
            gpu_bytes: 0,
            clock: render::Clock::Host,
            virtual_lights: 0,
            glossy_samples: [0; 2],
            light_rays: [0; 2],
            exposure: None,
            glossy_hits: render::GlossCache::NoGloss,
            glossy_rays: [0; 2],
            has_compiled: false,
            dispatches: 0,
            waits: 0,
            reflection: None,
            methods: Vec::new(),
            reflected: None,
            is_quick: false,
            flip: None,
        };
        (stats, milliseconds)
    }

    #[test]
    fn a_frame_of_a_moving_picture_takes_the_time_that_it_may() {
        // The machines are a fast one, one without a graphics card, and the same one with indirect light.
        for machine in [[1.0, 2.0], [40.0, 200.0], [40.0, 1500.0]] {
            for points in [8_000, 3_000_000, 12_000_000] {
                let mut haste = Haste::default();
                let still = FrameRequest { size: SIZE, ..FrameRequest::any() };
                // In high quality each point takes four times as long.
                let (stats, milliseconds) = frame([4.0 * machine[0], machine[1]], points, &still);
                haste.learn(&stats, &still, milliseconds, 40.0);
                let mut last = (Spared::NOTHING, 0.0);
                for _ in 0..4 {
                    let spared = haste.spare(SIZE, 40.0);
                    let moving = FrameRequest { spared: Some(spared), hurried: true, ..still.clone() };
                    let (stats, milliseconds) = frame(machine, points, &moving);
                    haste.learn(&stats, &moving, milliseconds, 40.0);
                    last = (spared, milliseconds);
                }
                let (spared, milliseconds) = last;
                let is_least = spared.divisor == Haste::MOST_DIVISOR;
                assert!(milliseconds < 48.0 || is_least && milliseconds < 150.0, "{machine:?} {points}: {last:?}");
                // The frame is not coarser than it has to be.
                let all = frame(machine, points, &still).1;
                assert!(all > 20.0 || spared == Spared::NOTHING, "{machine:?} {points}: {last:?}");
                assert_eq!(haste.spare(SIZE, 40.0), spared, "it does not swing");
            }
        }
    }
}
