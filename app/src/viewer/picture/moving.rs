//! Moving pictures where the adapter is a processor: `render::QuickPicture` draws them, in the light of the last picture at
//! rest.

use render::{Detail, FrameStats, Gpu, KnownLight, Picked, PictureRows, PointStore, QuickPicture, Renderer};
use scene::{LightClues, LightView, Lighting, Settings, SpotLight, Tone};

use crate::viewer::picture::frame_request::{FrameRequest, hurried};
use crate::viewer::picture::pace::Spared;

#[derive(Default)]
pub struct MovingPictures {
    quick: QuickPicture,
    /// The light of the last picture at rest.
    light: Option<(LightInputs, KnownLight)>,
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

/// Whether the points of a picture show their own colours, without light.
fn is_unlit(request: &FrameRequest) -> bool {
    request.settings.resolved_light(!request.lights.is_empty(), request.clues).by == Lighting::Colors
}

impl MovingPictures {
    /// Draws a hurried frame, if the adapter is a processor, nothing reflects, and the light on the points is known or
    /// there is none.
    pub fn draw(&mut self, gpu: &Gpu, store: &PointStore, request: &FrameRequest) -> Option<(FrameStats, PictureRows)> {
        let FrameRequest { camera, settings, mirrors, .. } = request;
        let is_plain = mirrors.is_empty() && !store.has_mirrors() && settings.light.show == LightView::Picture;
        let known = self.light.as_ref().filter(|(inputs, _)| *inputs == LightInputs::new(request));
        let light = known.map(|(_, light)| light).filter(|_| !is_unlit(request));
        self.is_shown = gpu.is_processor() && is_plain && (light.is_some() || is_unlit(request));
        if !self.is_shown {
            return None;
        }
        let Spared { divisor, most_points } = request.spared.unwrap_or(Spared::NOTHING);
        let detail = Detail { most_points, coarseness: divisor };
        let stats = self.quick.draw(store, camera, settings, request.drawn_size(), detail, light);
        Some((stats, self.quick.take_rows()))
    }

    /// Keeps the light of the frame that the renderer holds, which is a picture at rest, for the pictures that follow.
    ///
    /// # Errors
    /// The device was lost.
    pub fn keep_light(&mut self, gpu: &Gpu, renderer: &Renderer, request: &FrameRequest) -> render::Result<()> {
        self.is_shown = false;
        self.light = None;
        if gpu.is_processor() && !is_unlit(request) && request.mirrors.is_empty() {
            self.light = Some((LightInputs::new(request), renderer.known_light(&request.settings)?));
        }
        Ok(())
    }

    /// The point near a pixel of the picture in the window, which must be a quick one.
    pub fn pick(&self, store: &PointStore, pixel: [u32; 2], radius: u32) -> Option<Picked> {
        self.quick.pick(store, pixel, radius)
    }
}
