//! Mirror pixels of the reference scene's mirrors by rays cast at their formulas, for tests: what a camera's G-buffer
//! would hold if it were exact.

use std::sync::{Mutex, PoisonError};

use glam::{DVec3, UVec2, Vec3};
use rayon::prelude::*;
use scene::five_mirrors::{Variant, camera};

use super::twin::{MirrorPicture, MirrorPixel, Random};
use crate::Gpu;
use crate::targets::Image;

/// Negative inside, positive outside; for the paraboloid negative behind it.
fn distance(mirror: Variant, p: DVec3) -> f64 {
    let d = p.normalize_or_zero();
    match mirror {
        Variant::Sphere => p.length() - 0.43,
        Variant::Parabolic => p.z - (p.x * p.x + p.y * p.y - 0.2),
        Variant::Blob => {
            p.length() - 0.40 * (1.0 + 0.10 * (6.0 * d.x + 1.0).sin() * (5.0 * d.y).sin() + 0.06 * (7.0 * d.z).sin())
        }
        Variant::Torus => {
            let (sin, cos) = 55.0_f64.to_radians().sin_cos();
            let along = p.dot(DVec3::new(0.0, sin, cos));
            let across = (p.length_squared() - along * along).max(0.0).sqrt();
            (across - 0.33).hypot(along) - 0.14
        }
        Variant::Coral => {
            let bumps = 0.08 * (19.0 * d.x).sin() * (17.0 * d.y).sin() * (23.0 * d.z).sin();
            p.length() - 0.36 * (1.0 + bumps + 0.03 * (41.0 * d.x + 3.0 * d.y).sin())
        }
        _ => f64::INFINITY,
    }
}

/// Where a ray from `origin` first meets the mirror.
fn cast(mirror: Variant, origin: DVec3, direction: DVec3) -> Option<DVec3> {
    // All mirrors lie in this sphere; steps are a fifth of the coral's smallest bumps.
    const REACH: f64 = 0.56;
    const STEPS: usize = 500;
    let nearest = -origin.dot(direction);
    let squared = REACH * REACH - (origin.length_squared() - nearest * nearest);
    if squared < 0.0 {
        return None;
    }
    let half = squared.sqrt();
    let at = |place: f64| origin + direction * (nearest + half * (2.0 * place / STEPS as f64 - 1.0));
    let mut reached = distance(mirror, at(0.0));
    (0..STEPS).map(|step| step as f64).find_map(|step| {
        let (mut near, mut far) = (step, step + 1.0);
        let before = std::mem::replace(&mut reached, distance(mirror, at(far)));
        if before * reached > 0.0 {
            return None;
        }
        for _ in 0..45 {
            let middle = (near + far) * 0.5;
            let is_before = before * distance(mirror, at(middle)) > 0.0;
            if is_before { near = middle } else { far = middle }
        }
        let hit = at(far);
        (mirror != Variant::Parabolic || hit.x.hypot(hit.y) <= 0.45).then_some(hit)
    })
}

/// The mirror as the scene's camera sees it. Many tests take the same few pictures, so each is cast once.
pub fn picture(mirror: Variant, size: UVec2) -> MirrorPicture {
    static CAST: Mutex<Vec<(Variant, MirrorPicture)>> = Mutex::new(Vec::new());
    let all = || CAST.lock().unwrap_or_else(PoisonError::into_inner);
    let known = all().iter().find(|(known, picture)| *known == mirror && picture.size == size).cloned();
    let (_, picture) = known.unwrap_or_else(|| {
        let cast = (mirror, cast_picture(mirror, size));
        all().push(cast.clone());
        cast
    });
    picture
}

fn cast_picture(mirror: Variant, size: UVec2) -> MirrorPicture {
    let eye = camera().eye;
    let focal_pixels = f64::from(size.y) * 0.5 / 30.0_f64.to_radians().tan();
    let of_pixel = |index: u32| {
        let (x, y) = (f64::from(index % size.x) + 0.5, f64::from(index / size.x) + 0.5);
        let (x, y) = (x - f64::from(size.x) * 0.5, f64::from(size.y) * 0.5 - y);
        let ray = DVec3::new(x, y, -focal_pixels).normalize();
        let hit = cast(mirror, eye, ray)?;
        let step = 1e-6;
        let slope = |axis: DVec3| distance(mirror, hit + axis * step) - distance(mirror, hit - axis * step);
        let normal = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z)).normalize();
        let normal = if normal.dot(ray) > 0.0 { -normal } else { normal };
        Some(MirrorPixel {
            point: (hit - eye).as_vec3(),
            normal: normal.as_vec3(),
            toward_eye: -ray.as_vec3(),
            linear_depth: (eye.z - hit.z) as f32,
        })
    };
    let pixels = (0..size.x * size.y).into_par_iter().map(of_pixel).collect();
    MirrorPicture { size, pixels, right: Vec3::X, up: Vec3::Y }
}

/// Points of the box's walls, evenly by area, relative to the eye.
pub fn wall_points(count: u32) -> Vec<Vec3> {
    let mut random = Random(1);
    let eye = camera().eye.as_vec3();
    let mut point = || {
        // Four walls of eight square units, two of four.
        let (place, u, v) = (random.next() * 40.0, random.next() * 2.0 - 1.0, random.next() * 2.0 - 1.0);
        let side = |place: f32| if place < 0.5 { -1.0 } else { 1.0 };
        let position = match place {
            0.0..16.0 => Vec3::new(side(place / 16.0), u, v * 2.0),
            16.0..32.0 => Vec3::new(u, side(place / 16.0 - 1.0), v * 2.0),
            _ => Vec3::new(u, v, side(place / 8.0 - 4.0) * 2.0),
        };
        position - eye
    };
    (0..count).map(|_| point()).collect()
}

/// Writes a texel of each mirror pixel.
pub fn fill(gpu: &Gpu, picture: &MirrorPicture, image: &Image, texel: impl Fn(&MirrorPixel) -> [f32; 4]) {
    let texels: Vec<[f32; 4]> = picture.pixels.iter().map(|pixel| pixel.as_ref().map_or([0.0; 4], &texel)).collect();
    gpu.queue.write_texture(
        image.texture.as_image_copy(),
        bytemuck::cast_slice(&texels),
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(picture.size.x * 16), rows_per_image: None },
        image.texture.size(),
    );
}
