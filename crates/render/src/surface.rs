//! The surface that the camera sees: splatted points, and mirrors that are drawn by their formula.

use scene::{Quality, Settings};

use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::{Image, Targets};

/// Splats the points as the camera sees them, and closes gaps and holes. `with_radii` asks for the radius of the point that
/// the camera sees at each pixel, which holes are judged by, too.
///
/// # Errors
/// A shader is refused.
pub(crate) fn splat_surface(
    recorder: &mut Recorder<'_>,
    inputs: &Inputs,
    settings: &Settings,
    targets: &mut Targets,
    (atomics64, with_radii): (bool, bool),
) -> Result<()> {
    recorder.clear(&targets.nearest);
    let nearest = targets.nearest.as_entire_binding();
    let shares = recorder.gpu.shares_large_discs(&settings.splat);
    let switches = [("hides_backs", !settings.splat.back_faces), ("shares", shares)];
    // A switch that is off is left out, so that shadow maps take the same kernels.
    let switches: Vec<(&str, u32)> = switches.into_iter().filter(|(_, on)| *on).map(|(name, _)| (name, 1)).collect();
    recorder.nearest_points(&switches, inputs, nearest.clone(), atomics64)?;
    let [albedo, normal, depth] = targets.surfaces[0].bind();
    match (settings.splat.quality, &targets.sums) {
        (Quality::High, Some(sums)) => {
            for buffer in sums {
                recorder.clear(buffer);
            }
            let [color_sums, surface_sums, specular_sums, carries] =
                sums.each_ref().map(|sums| sums.as_entire_binding());
            let (nearest_in, color, surface) = (nearest.clone(), color_sums.clone(), surface_sums.clone());
            let (specular, carried) = (specular_sums.clone(), carries.clone());
            let pairs = recorder.gpu.sums_pairs(&settings.splat);
            let has_materials = ("has_materials", u32::from(inputs.has_materials));
            let switches = [&switches[..], &[has_materials]].concat();
            if pairs {
                let bindings = passes::splat_accumulate_pairs {
                    nearest: nearest_in,
                    color_sums: color,
                    surface_sums: surface,
                    specular_sums: specular,
                    carries: carried,
                };
                recorder.over_points(&switches, inputs, bindings)?;
            } else {
                let bindings = passes::splat_accumulate {
                    nearest: nearest_in,
                    color_sums: color,
                    surface_sums: surface,
                    specular_sums: specular,
                    carries: carried,
                };
                recorder.over_points(&switches, inputs, bindings)?;
            }
            let bindings = passes::splat_average {
                nearest,
                color_sums,
                surface_sums,
                specular_sums,
                carries,
                albedo_out: albedo.clone(),
                normal_out: normal.clone(),
                depth_out: depth.clone(),
            };
            recorder.over_pixels(&[("pairs", u32::from(pairs)), has_materials], inputs, bindings)?;
        }
        _ => {
            let bindings = passes::splat_resolve {
                nearest,
                albedo_out: albedo.clone(),
                normal_out: normal.clone(),
                depth_out: depth.clone(),
            };
            recorder.over_page_pixels(inputs, bindings, inputs.pixel_groups())?;
        }
    }
    targets.splatted = 0;
    if with_radii || settings.splat.close_gaps {
        see_radii(recorder, inputs, targets)?;
    }
    if settings.splat.close_gaps {
        let [surface, closed] = &targets.surfaces;
        let [[albedo, normal, depth], [albedo_out, normal_out, depth_out]] = [surface.bind(), closed.bind()];
        // Few pixels change. The others are copied, since a copy costs less than a pass that reads and writes all of them.
        recorder.copy_surface(surface, closed);
        let bindings = passes::close_holes {
            albedo_in: albedo.clone(),
            normal_in: normal.clone(),
            depth_in: depth.clone(),
            radius_in: targets.radii.as_ref().map_or_else(|| depth.clone(), Image::bind),
            albedo_out: albedo_out.clone(),
            normal_out: normal_out.clone(),
            depth_out: depth_out.clone(),
        };
        recorder.over_pixels(&[], inputs, bindings)?;
        recorder.copy_surface(closed, surface);
        let bindings = passes::close_gaps {
            albedo_in: albedo_out,
            normal_in: normal_out,
            depth_in: depth_out,
            albedo_out: albedo,
            normal_out: normal,
            depth_out: depth,
        };
        recorder.over_pixels(&[], inputs, bindings)?;
    }
    Ok(())
}

/// Looks up the radius of the splat of the point that the camera sees at each pixel.
///
/// # Errors
/// A shader is refused.
fn see_radii(recorder: &mut Recorder<'_>, inputs: &Inputs, targets: &mut Targets) -> Result<()> {
    let size = targets.size;
    let make = || Image::new(&recorder.gpu.device, size, "radii", wgpu::TextureFormat::R32Float);
    let image = targets.radii.get_or_insert_with(make);
    let bindings = passes::splat_radii { nearest: targets.nearest.as_entire_binding(), radius_out: image.bind() };
    recorder.over_page_pixels(inputs, bindings, inputs.pixel_groups())
}

/// Looks up the index of refraction of the points that the camera sees.
///
/// # Errors
/// A shader is refused.
pub(crate) fn see_clear_points(recorder: &mut Recorder<'_>, inputs: &Inputs, targets: &mut Targets) -> Result<()> {
    let size = targets.size;
    let make = || Image::new(&recorder.gpu.device, size, "clear points", wgpu::TextureFormat::R32Float);
    let image = targets.clear_points.get_or_insert_with(make);
    let bindings = passes::clear_points { nearest: targets.nearest.as_entire_binding(), index_out: image.bind() };
    recorder.over_page_pixels(inputs, bindings, inputs.pixel_groups())
}

/// Lays the mirrors that are drawn by their formula over the surface of the points, and computes the world position of
/// each pixel.
///
/// # Errors
/// A shader is refused.
pub(crate) fn lay_mirrors(
    recorder: &mut Recorder<'_>,
    inputs: &Inputs,
    targets: &mut Targets,
    formulas: Option<&wgpu::Buffer>,
) -> Result<()> {
    targets.shown = targets.splatted;
    if let Some(formulas) = formulas {
        let (from, to) = (targets.surface(), &targets.surfaces[1 - targets.splatted]);
        recorder.copy_surface(from, to);
        let [albedo_out, normal_out, depth_out] = to.bind();
        let bindings = passes::mirror_exact {
            depth_in: from.depth.bind(),
            mirrors: formulas.as_entire_binding(),
            albedo_out,
            normal_out,
            depth_out,
        };
        recorder.by_rows(&[], inputs, bindings, inputs.mirror_groups())?;
        targets.shown = 1 - targets.splatted;
    }
    let bindings =
        passes::camera_position { depth_in: targets.surface().depth.bind(), position_out: targets.position.bind() };
    recorder.over_pixels(&[], inputs, bindings)
}
