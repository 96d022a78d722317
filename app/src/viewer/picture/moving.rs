//! Moving pictures where the adapter is a processor: `render::QuickPicture` draws them, in the light of the last picture at
//! rest.

use std::time::{Duration, Instant};

use render::{Detail, FrameStats, Gpu, Known, KnownLight, Picked, PictureRows, PointStore, QuickPicture, Renderer};
use scene::{LightClues, LightView, Lighting, Mirror, Settings, SpotLight, Tone};

use crate::viewer::picture::frame_request::{FrameRequest, hurried};
use crate::viewer::picture::pace::Spared;

#[derive(Default)]
pub struct MovingPictures {
    quick: QuickPicture,
    /// The light of the last picture at rest.
    light: Option<(LightInputs, KnownLight)>,
    /// What mirrors show in a coarse frame, and when and of what that was drawn.
    mirrors: Option<(Instant, MirrorInputs, KnownLight)>,
    /// Whether the picture in the window is a quick one.
    pub is_shown: bool,
}

/// What the light of a picture depends on, besides points and camera.
#[derive(PartialEq)]
struct LightInputs {
    /// The settings that affect shading; the others are at their defaults.
    settings: Settings,
    tone: Tone,
    lights: Vec<SpotLight>,
    clues: LightClues,
}

impl LightInputs {
    fn new(request: &FrameRequest) -> Self {
        // A picture at rest and a hurried one of the same values have the same light.
        let settings = hurried(&request.settings, false);
        let tone = settings.tone.clone();
        let settings = settings.only(|field| field.affects.shading);
        Self { settings, tone, lights: request.lights.clone(), clues: request.clues }
    }
}

/// What mirrors show depends on, besides points and camera.
#[derive(PartialEq)]
struct MirrorInputs {
    light: LightInputs,
    settings: Settings,
    mirrors: Vec<Mirror>,
}

impl MirrorInputs {
    fn new(request: &FrameRequest) -> Self {
        let settings = request.settings.only(|field| field.affects.found);
        Self { light: LightInputs::new(request), settings, mirrors: request.mirrors.clone() }
    }
}

/// Whether the points of a picture show their own colours, without light.
fn is_unlit(request: &FrameRequest) -> bool {
    request.settings.resolved_light(!request.lights.is_empty(), request.clues).by == Lighting::Colors
}

/// What a hurried frame needs before it can be a quick picture.
pub enum Moving {
    Drawn(FrameStats, PictureRows),
    /// The renderer must draw this coarse frame first, which `keep_mirrors` is then told.
    Mirrors(FrameRequest),
    /// The renderer must draw the frame itself.
    Never,
}

/// How long what mirrors show may stay, fixed to their surfaces, while the camera moves.
const MIRRORS_STAY: Duration = Duration::from_millis(300);
/// The pixels of the screen that each pixel of the coarse frame fills, along each side.
const OF_MIRRORS: u32 = 5;

impl MovingPictures {
    /// Draws a hurried frame, if the adapter is a processor, and the light on the points and what mirrors show is known.
    pub fn draw(&mut self, gpu: &Gpu, store: &PointStore, request: &FrameRequest) -> Moving {
        let FrameRequest { camera, settings, mirrors, .. } = request;
        self.is_shown = false;
        if !gpu.is_processor() || settings.light.show != LightView::Picture {
            return Moving::Never;
        }
        let inputs = LightInputs::new(request);
        let reflects = !mirrors.is_empty() || store.has_mirrors();
        let is_new = |(at, of, _): &&(Instant, MirrorInputs, KnownLight)| {
            at.elapsed() < MIRRORS_STAY && *of == MirrorInputs::new(request)
        };
        let shown = self.mirrors.as_ref().filter(|_| reflects).filter(is_new).map(|(.., known)| known);
        if reflects && shown.is_none() {
            let size = request.size.map(|edge| u64::from(edge / OF_MIRRORS));
            let spared = Spared { divisor: OF_MIRRORS, most_points: Some(size[0] * size[1]) };
            return Moving::Mirrors(FrameRequest { spared: Some(spared), ..request.clone() });
        }
        // The coarse frame knows the light, too.
        let known = self.light.as_ref().filter(|(of, _)| *of == inputs).map(|(_, light)| light).or(shown);
        let light = known.filter(|_| !is_unlit(request));
        if light.is_none() && !is_unlit(request) {
            return Moving::Never;
        }
        let Spared { divisor, most_points } = request.spared.unwrap_or(Spared::NOTHING);
        let detail = Detail { most_points, coarseness: divisor };
        let known = Known { light, mirrors: shown };
        let stats = self.quick.draw(store, camera, settings, request.drawn_size(), detail, known);
        self.is_shown = true;
        Moving::Drawn(stats, self.quick.take_rows())
    }

    /// Keeps what mirrors show in the coarse frame that the renderer holds.
    ///
    /// # Errors
    /// The device was lost.
    pub fn keep_mirrors(&mut self, renderer: &Renderer, request: &FrameRequest) -> render::Result<()> {
        let known = renderer.known_light(&request.settings)?;
        self.mirrors = Some((Instant::now(), MirrorInputs::new(request), known));
        Ok(())
    }

    /// Keeps the light of the frame that the renderer holds, which is a picture at rest, for the pictures that follow.
    ///
    /// # Errors
    /// The device was lost.
    pub fn keep_light(&mut self, gpu: &Gpu, renderer: &Renderer, request: &FrameRequest) -> render::Result<()> {
        self.is_shown = false;
        self.light = None;
        if gpu.is_processor() && !is_unlit(request) {
            self.light = Some((LightInputs::new(request), renderer.known_light(&request.settings)?));
        }
        Ok(())
    }

    /// The point near a pixel of the picture in the window, which must be a quick one.
    pub fn pick(&self, store: &PointStore, pixel: [u32; 2], radius: u32) -> Option<Picked> {
        self.quick.pick(store, pixel, radius)
    }
}
