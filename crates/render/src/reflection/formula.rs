//! Mirrors that are drawn by their formula, a ray a pixel: selects them and uploads them.

use glam::{DMat3, DVec3, Vec4};
use scene::{Mirror, Settings, Shape};

use crate::gpu::Gpu;
use crate::layout::{BLOB, CORAL, CYLINDER, FormulaMirror, PARABOLOID, PLANE, SPHERE, TORUS};
use crate::targets::storage;

/// The mirrors that are drawn by their formula.
pub(crate) fn exact<'a>(settings: &Settings, mirrors: &'a [Mirror]) -> impl Iterator<Item = &'a Mirror> {
    mirrors.iter().filter(|mirror| mirror.is_exact(settings.mirror.surface))
}

/// Uploads the mirrors that are drawn by their formula; `None` if there are none.
pub(crate) fn upload(gpu: &Gpu, settings: &Settings, mirrors: &[Mirror], eye: DVec3) -> Option<wgpu::Buffer> {
    upload_all(gpu, exact(settings, mirrors).filter_map(|mirror| formula(mirror, settings, eye)).collect())
}

/// Whether light goes through a mirror that has a formula.
pub(crate) fn is_clear(mirror: &Mirror) -> bool {
    mirror.refraction.is_some() && mirror.specular_intensity > 0.0 && mirror.shape.has_formula()
}

/// Uploads the mirrors on whose formulas rays through clear surfaces depend: those that are drawn by theirs, and clear
/// ones that are drawn as points.
pub(crate) fn upload_with_clear(
    gpu: &Gpu,
    settings: &Settings,
    mirrors: &[Mirror],
    eye: DVec3,
) -> Option<wgpu::Buffer> {
    let mirrors = mirrors.iter().filter(|mirror| is_clear(mirror) || mirror.is_exact(settings.mirror.surface));
    upload_all(gpu, mirrors.filter_map(|mirror| formula(mirror, settings, eye)).collect())
}

/// The most mirrors whose reflections of points are computed by their formula: each point tries all of them.
const MOST_ANALYTIC: usize = 16;

/// The first of these mirrors for which a formula says where they reflect a point.
pub(crate) fn analytic<'a>(mirrors: impl Iterator<Item = &'a Mirror>, eye: DVec3) -> impl Iterator<Item = &'a Mirror> {
    let has_place = move |mirror: &&Mirror| match mirror.shape {
        Shape::Plane { .. } => true,
        // Seen from inside, a sphere has up to four such places.
        Shape::Sphere => mirror.position.distance(eye) > mirror.size,
        _ => false,
    };
    mirrors.filter(|mirror| mirror.specular_intensity > 0.0).filter(has_place).take(MOST_ANALYTIC)
}

/// Uploads mirrors for shaders/shared/analytic.wgsl, which takes a size of 0 for none.
pub(crate) fn upload_analytic<'a>(
    gpu: &Gpu,
    settings: &Settings,
    mirrors: impl Iterator<Item = &'a Mirror>,
    eye: DVec3,
) -> wgpu::Buffer {
    let mut mirrors: Vec<FormulaMirror> = mirrors.filter_map(|mirror| formula(mirror, settings, eye)).collect();
    if mirrors.is_empty() {
        mirrors.push(FormulaMirror::default());
    }
    let bytes: &[u8] = bytemuck::cast_slice(&mirrors);
    let buffer = storage(&gpu.device, "mirrors with a closed formula", bytes.len() as u64);
    gpu.queue.write_buffer(&buffer, 0, bytes);
    buffer
}

fn upload_all(gpu: &Gpu, mirrors: Vec<FormulaMirror>) -> Option<wgpu::Buffer> {
    if mirrors.is_empty() {
        return None;
    }
    let bytes: &[u8] = bytemuck::cast_slice(&mirrors);
    let buffer = storage(&gpu.device, "mirrors", bytes.len() as u64);
    gpu.queue.write_buffer(&buffer, 0, bytes);
    Some(buffer)
}

/// The bounding spheres of the mirrors that are drawn by their formula.
pub(crate) fn mirror_spheres(settings: &Settings, mirrors: &[Mirror]) -> impl Iterator<Item = (DVec3, f64)> {
    exact(settings, mirrors).map(|mirror| (mirror.position, f64::from(reach(mirror))))
}

/// The radius of a ball that contains the mirror: a little more, for rays that touch the rim.
pub(super) fn reach(mirror: &Mirror) -> f32 {
    (mirror.shape.reach() * mirror.size * 1.001) as f32
}

/// `None` for a mesh.
pub(super) fn formula(mirror: &Mirror, settings: &Settings, eye: DVec3) -> Option<FormulaMirror> {
    let (kind, parameter) = match mirror.shape {
        Shape::Plane { height } => (PLANE, height),
        Shape::Sphere => (SPHERE, 0.0),
        Shape::Paraboloid { focal_length } => (PARABOLOID, focal_length),
        Shape::Cylinder { height } => (CYLINDER, height),
        Shape::Torus { tube } => (TORUS, tube),
        Shape::Blob => (BLOB, 0.0),
        Shape::Coral => (CORAL, 0.0),
        Shape::Mesh(_) => return None,
    };
    let rows = DMat3::from_quat(mirror.rotation.normalize()).transpose();
    let row = |index| rows.row(index).as_vec3();
    let [red, green, blue] = mirror.color;
    Some(FormulaMirror {
        x_kind: row(0).extend(kind),
        y_parameter: row(1).extend(parameter as f32),
        z_size: row(2).extend(mirror.size as f32),
        position_reach: (mirror.position - eye).as_vec3().extend(reach(mirror)),
        color_intensity: Vec4::new(red, green, blue, mirror.specular_intensity),
        specular_power: mirror.specular_power,
        refraction: mirror.refraction.filter(|_| is_clear(mirror)).unwrap_or(0.0),
        as_points: u32::from(!mirror.is_exact(settings.mirror.surface)),
        ..Default::default()
    })
}
