//! `light.show`: views of where light comes from, instead of the picture. They read the inputs of the frame and change
//! none of them; their passes share `shaders/shared/light_view.wgsl`.

use cloud::Bounds;
use glam::Vec4;
use scene::{LightView, Settings};

use crate::frame::FrameCamera;
use crate::gi::VirtualLights;
use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::layout::LightViews;
use crate::lighting::{Lights, MOST_LIGHTS, MappedLight};
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::{Image, Targets, uniform_buffer};

/// The inputs and images of a frame that the views of lights read.
pub(crate) struct FrameInputs<'a> {
    pub targets: &'a Targets,
    pub lights: &'a Lights,
    pub mapped: &'a [MappedLight],
    /// The virtual lights, if there is indirect light.
    pub virtual_lights: Option<VirtualLights<'a>>,
    /// The indirect light of the surface that the camera sees.
    pub indirect: Option<&'a Image>,
    /// The bounds of all points.
    pub bounds: Bounds,
    pub is_filmic: bool,
}

impl LightViews {
    /// `count` square cells, at least one, as large as fit in a picture of `size`.
    fn grid(count: u32, size: [u32; 2]) -> Self {
        let edge_of = |columns: u32| (size[0] / columns).min(size[1] / count.div_ceil(columns));
        let columns = (1..=count).max_by_key(|columns| (edge_of(*columns), count - columns)).unwrap_or(1);
        // More cells than pixels cannot be shown.
        Self { columns: columns.min(size[0]), edge: edge_of(columns).max(1), count, ..Self::default() }
    }

    /// The range of depths within `bounds` as `camera` sees it. If the camera is inside, a perspective range begins at
    /// a 32nd of the farthest depth: five doublings of the distance are distinguishable.
    fn range(camera: &FrameCamera, bounds: Bounds) -> [f32; 2] {
        let forward = camera.view_from_world.row(2);
        let (middle, half) = (forward.dot(bounds.center() - camera.eye), forward.abs().dot(bounds.size() * 0.5));
        // All of it may be behind the camera, or flat as seen from it; the range must still be valid.
        let farthest = if middle + half > 0.0 { middle + half } else { 1.0 };
        let least = if camera.orthographic { 0.0 } else { farthest / 32.0 };
        [(middle - half).clamp(least, farthest * 0.999) as f32, farthest as f32]
    }
}

/// Writes the picture. A view that has nothing to show, without lamps or without indirect light, is the dimmed picture.
///
/// # Errors
/// A shader is refused.
pub(crate) fn show(
    recorder: &mut Recorder<'_>,
    inputs: &Inputs,
    settings: &Settings,
    shown: &FrameInputs<'_>,
) -> Result<()> {
    let FrameInputs { targets, lights, mapped, virtual_lights, .. } = shown;
    let surface = targets.surface();
    let with_maps = virtual_lights.as_ref().and_then(|lights| Some((lights, lights.maps?)));
    let picture_out = targets.picture.bind();
    match settings.light.show {
        LightView::LightBuffer if !mapped.is_empty() => {
            let mut views = LightViews::grid(mapped.len() as u32, inputs.size);
            for (index, light) in mapped.iter().enumerate().take(MOST_LIGHTS) {
                [views.nearest[index], views.farthest[index]] = LightViews::range(&light.camera, shown.bounds);
            }
            let views = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&views));
            let bindings = passes::show_light_buffer {
                views: views.as_entire_binding(),
                lights: lights.lights.as_entire_binding(),
                shadows: lights.shadows.as_entire_binding(),
                picture_out,
            };
            recorder.over_pixels(&[], inputs, bindings)?;
            draw_lights(recorder, inputs, shown, &views, true)
        }
        LightView::ShadowMaps if let Some((lights, maps)) = with_maps => {
            let views = LightViews::grid(lights.count, inputs.size);
            let views = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&views));
            let bindings = passes::show_shadow_maps {
                views: views.as_entire_binding(),
                virtual_lights: lights.constants.as_entire_binding(),
                vpls: lights.vpls.as_entire_binding(),
                shadow_maps: maps.as_entire_binding(),
                picture_out,
            };
            recorder.over_pixels(&[], inputs, bindings)
        }
        view => {
            let [nearest, farthest] = LightViews::range(&inputs.camera, shown.bounds);
            let views =
                LightViews { nearest: Vec4::splat(nearest), farthest: Vec4::splat(farthest), ..LightViews::default() };
            let views = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&views));
            let image = match view {
                LightView::Direct => Some(&targets.direct),
                LightView::Indirect => shown.indirect,
                LightView::Albedo => Some(&surface.albedo),
                LightView::Normal => Some(&surface.normal),
                _ => Some(&targets.color),
            };
            let switches = [("is_filmic", u32::from(shown.is_filmic)), ("has_light", u32::from(image.is_some()))];
            let bindings = passes::show_light {
                views: views.as_entire_binding(),
                image_in: image.unwrap_or(&targets.color).bind(),
                depth_in: surface.depth.bind(),
                picture_out,
            };
            recorder.over_pixels(&switches, inputs, bindings)?;
            if view == LightView::VirtualLights { draw_lights(recorder, inputs, shown, &views, false) } else { Ok(()) }
        }
    }
}

/// Draws the virtual lights over the picture.
fn draw_lights(
    recorder: &mut Recorder<'_>,
    inputs: &Inputs,
    shown: &FrameInputs<'_>,
    views: &wgpu::Buffer,
    in_light_buffer: bool,
) -> Result<()> {
    let Some(lights) = &shown.virtual_lights else { return Ok(()) };
    let bindings = passes::show_virtual_lights {
        views: views.as_entire_binding(),
        virtual_lights: lights.constants.as_entire_binding(),
        vpls: lights.vpls.as_entire_binding(),
        lights: shown.lights.lights.as_entire_binding(),
        shadows: shown.lights.shadows.as_entire_binding(),
        depth_in: shown.targets.surface().depth.bind(),
        picture_out: shown.targets.picture.bind(),
    };
    let switches = [("is_filmic", u32::from(shown.is_filmic)), ("in_light_buffer", u32::from(in_light_buffer))];
    recorder.by_rows(&switches, inputs, bindings, inputs.pixel_groups())
}
