//! The cost and the content of a frame.

use scene::Method;

use crate::exposure::Exposure;
use crate::gpu::Clock;
use crate::method::ReflectedShare;
use crate::pass_times::PassTime;
use crate::reflection::ReflectionStats;
use crate::reflection::kept_hits::GlossCache;

/// The cost and the content of a frame.
#[derive(Clone, Debug)]
pub struct FrameStats {
    /// The passes in order; a pass that runs once a page is summed. None if they were timed together
    /// (`Effort::times_passes`).
    pub passes: Vec<PassTime>,
    /// The time from the first pass to the last; where passes are timed together, with the copy of the picture.
    pub frame_milliseconds: f64,
    /// The part of it that splats the points that the camera sees; it grows with their number.
    pub splatting_milliseconds: f64,
    pub points_drawn: u64,
    pub points_resident: u64,
    pub gpu_bytes: u64,
    pub clock: Clock,
    /// Whether passes were compiled for the frame: drivers then compile at their first dispatch, which counts in the
    /// times.
    pub has_compiled: bool,
    /// The number of dispatches: more than passes where long ones were cut (`Renderer::give_up_when`).
    pub dispatches: u32,
    /// The number of times that the CPU waited for the GPU.
    pub waits: u32,
    /// The number of virtual lights that lit the frame; 0 without indirect light.
    pub virtual_lights: u32,
    /// The number of samples of mirrors that the picture shows, and the number asked for; 0 of 0 if mirrors are perfect
    /// and one ray a pixel is followed.
    pub glossy_samples: [u32; 2],
    /// The number of rays of light of each pixel that the picture shows, and the number asked for; 0 of 0 if no rays
    /// bring indirect light.
    pub light_rays: [u32; 2],
    /// The exposure of the picture, if it was fitted.
    pub exposure: Option<Exposure>,
    /// Whether what the rays of glossy mirrors meet is kept for the next frame.
    pub glossy_hits: GlossCache,
    /// If it is: the number of rays of glossy mirrors that the frame traced, and of those whose hits it knew from
    /// frames before.
    pub glossy_rays: [u64; 2],
    /// The methods of the mirrors that may be seen, in the order of the menu: more than one if mirrors have their own.
    pub methods: Vec<Method>,
    /// The statistics of the reflections, if they were asked for.
    pub reflection: Option<ReflectionStats>,
    /// What mirrors of the frame reflect; `None` if it is all that they could.
    pub reflected: Option<ReflectedShare>,
    /// Whether the processor has drawn the frame (`QuickPicture`).
    pub is_quick: bool,
    /// The mean FLIP to the picture at rest of the same view, where somebody has judged it.
    pub flip: Option<f64>,
}

impl FrameStats {
    /// The numbers of samples that the picture shows and that are asked for, of what is summed over frames and lags
    /// most: mirrors, or rays of light.
    pub fn samples(&self) -> [u32; 2] {
        let left = |[summed, asked]: [u32; 2]| asked.saturating_sub(summed);
        if left(self.light_rays) > left(self.glossy_samples) { self.light_rays } else { self.glossy_samples }
    }
}
