//! The light on what lies around the eye, beside the view of the last frame: whoever turns the head finds it lit.

use scene::{IndirectBy, Quality, Settings};

use super::plan::{Before, Plan};
use super::{Frame, Renderer, chapters};
use crate::frame::FrameCamera;
use crate::gi::LightReuse;
use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::recorder::Recorder;
use crate::reflection::{self, SurfaceImages};
use crate::shading::FrameLight;
use crate::store::PointStore;
use crate::targets::Targets;

impl Renderer {
    /// Shades the surfaces in another view from the eye of the last frame, of which nothing is lost, without what mirrors show.
    /// Returns the view and its images, to which `gi.met` adds the indirect light if the flag is set; `None` if the view has
    /// another eye, a parallel projection, or light by rays.
    ///
    /// # Errors
    /// A shader is refused, there is no memory, the frame was given up, or the device was lost.
    pub(crate) fn shade_around(
        &mut self,
        store: &PointStore,
        frame: &Frame<'_>,
    ) -> Result<Option<(FrameCamera, Targets, bool)>> {
        let mut settings: Settings = frame.settings.clone();
        settings.splat.quality = Quality::Nearest;
        let frame = Frame { settings: &settings, ..*frame };
        let nothing = Before { made_from: None, splatted_from: None, lacks_points: false };
        let plan = Plan::new(store, &frame, &settings, &nothing)?;
        let is_same = |eye| eye == plan.camera.eye && !plan.camera.orthographic;
        if settings.gi.by == IndirectBy::Rays || !self.camera.is_some_and(|camera| is_same(camera.eye)) {
            return Ok(None);
        }
        let mut targets = Targets::new(&self.gpu.device, frame.size);
        let Self { gpu, pipelines, lights, gi, caustics, given_up, longest_piece, .. } = self;
        let mut recorder = Recorder::new(gpu, pipelines, &settings);
        recorder.give_up_when(given_up.as_deref().map(|asked| asked as _), *longest_piece);
        let inputs = Inputs::new(gpu, plan.camera, &settings, &plan.points);
        let formulas = reflection::upload(gpu, &settings, plan.objects.mirrors, plan.camera.eye);
        chapters::surface(&mut recorder, &plan, &inputs, &mut targets, formulas.as_ref())?;
        // The light on the surface of the last frame stays what the next one takes over.
        gi.keeper.reuse = LightReuse::Never;
        let mut light = FrameLight {
            settings: &settings,
            lights,
            thrown: caustics.thrown(),
            gi: plan.has_indirect.then_some(&mut *gi),
            shading: plan.shading,
            camera: SurfaceImages::of_camera(&targets),
            bounces: 0,
            received: None,
            direct: &targets.direct,
            color: &targets.color,
            first_receiver: 0,
            brought: None,
            // The light goes into images beside those of the frame's surfaces.
            met_bounces: Some(u32::MAX),
        };
        light.shade(&mut recorder, &inputs, &[], 0)?;
        recorder.finish()?;
        Ok(Some((plan.camera, targets, plan.has_indirect)))
    }
}
