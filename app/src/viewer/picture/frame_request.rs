//! What a picture is drawn of, and how much of it where something moves.

use cloud::PointTest;
use render::{Effort, FrameStats, LightReuse, Objects};
use scene::{
    Camera, GlossPattern, IndirectBy, LightClues, Method, Mirror, MirrorSurface, Quality, Settings, SpotLight,
};

use crate::viewer::picture::pace::Spared;

/// A picture to draw.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRequest {
    pub camera: Camera,
    pub settings: Settings,
    pub mirrors: Vec<Mirror>,
    pub lights: Vec<SpotLight>,
    /// What decides about automatic light, besides the lights.
    pub clues: LightClues,
    /// The size in pixels that the picture fills in the window.
    pub size: [u32; 2],
    /// What the frame spares, if it is drawn fast because something moves.
    pub spared: Option<Spared>,
    /// Decides which points are shown. The thread is told by `Change::Visibility`; here it tells frames that hide other
    /// points from frames of other points.
    pub test: PointTest,
    /// A counter that grows with each change of the points and their colours.
    pub revision: u64,
    /// True if this is a hurried frame, which a better one follows.
    pub hurried: bool,
    /// True if indirect light may be that of earlier points while points are loaded and removed.
    pub light_may_lag: bool,
}

impl FrameRequest {
    /// The frame in full quality.
    pub fn unhurried(&self, settings: &Settings) -> Self {
        Self { settings: settings.clone(), spared: None, hurried: false, light_may_lag: false, ..self.clone() }
    }

    /// Whether the frame's picture is final: nothing is left to be added, and its exposure is the one that fits. While
    /// something moves, one sample of glossy mirrors and one ray of light are all, and the exposure follows.
    pub fn is_whole(&self, stats: &FrameStats) -> bool {
        let [summed, asked] = stats.samples();
        summed == asked && !stats.exposure.is_some_and(|exposure| exposure.adapts) || self.hurried
    }

    /// A frame of the same surface without indirect light and reflections, from which points are picked: all rays of light,
    /// and all samples of glossy mirrors, take up to a minute.
    pub fn surface_alone(&self) -> Self {
        let mut settings = self.settings.clone();
        (settings.gi.by, settings.gi.bounces, settings.sun.sky) = (IndirectBy::Lights, 0, 0.0);
        (settings.light.photons, settings.reflection.method) = (0, Method::None);
        Self { settings, ..self.clone() }
    }

    /// The size in pixels in which the frame is drawn.
    pub fn drawn_size(&self) -> [u32; 2] {
        self.spared.unwrap_or(Spared::NOTHING).size(self.size)
    }

    /// The pixel of the drawn picture at a pixel of the window, and the distance in pixels within which a point counts as
    /// picked.
    pub fn picked(&self, pixel: [u32; 2]) -> ([u32; 2], u32) {
        let divisor = self.spared.unwrap_or(Spared::NOTHING).divisor;
        (pixel.map(|place| place / divisor), PICK_RADIUS.div_ceil(divisor))
    }
}

/// A point counts as picked within this many pixels of the cursor: a mouse is about as precise as a fingertip.
const PICK_RADIUS: u32 = 6;

/// A frame for the window, whose exposure and samples are those of a picture at rest.
pub fn frame_of(request: &FrameRequest) -> render::Frame<'_> {
    let FrameRequest { camera, settings, mirrors, lights, clues, .. } = request;
    let effort = Effort {
        most_points: request.spared.map(|spared| spared.most_points.unwrap_or(u64::MAX)),
        most_reflected: request.spared.and_then(|spared| spared.most_reflected),
        light_may_lag: request.light_may_lag,
        light_reuse: if request.hurried { LightReuse::Reuse } else { LightReuse::Keep },
        times_passes: !request.hurried,
        ..Effort::FULL
    };
    let objects = Objects { mirrors, lights, clues: *clues };
    render::Frame { camera, settings, objects, size: request.drawn_size(), effort }
}

/// The settings for a hurried frame: one point for each pixel, and mirrors that show no further mirrors. A mirror that
/// is being dragged is drawn by its formula, because its points are made later.
pub fn hurried(settings: &Settings, a_mirror_is_dragged: bool) -> Settings {
    let mut hurried = settings.clone();
    hurried.splat.quality = Quality::Nearest;
    hurried.reflection.bounces = settings.reflection.bounces.min(1);
    hurried.reflection.samples = 1;
    // The second search finds points in the places of the first one.
    hurried.sscr.solve_once = true;
    if settings.gloss.samples > 0 {
        // The one sample that is drawn would else show a perfect mirror that is turned aside.
        hurried.gloss.pattern = GlossPattern::Pixel;
    }
    if a_mirror_is_dragged {
        hurried.mirror.surface = MirrorSurface::Exact;
    }
    hurried
}
