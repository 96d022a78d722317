//! Puts points into the cells of a pyramid.

use std::sync::OnceLock;

use cloud::{ShownPoints, stretch_ratio, unpack_normal, unpack_radius};
use glam::{DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;
use scene::Settings;

use super::levels::{Levels, key_of, level_of};
use super::paint::Paint;
use crate::frame::FrameCamera;
use crate::store::draw_list::SeenChunk;

/// The camera in single precision, and what decides the sizes of splats.
pub struct View {
    pub view_from_world: Mat3,
    eye: DVec3,
    full: DMat3,
    pub size: [u32; 2],
    pub half: [f32; 2],
    pub focal: f32,
    pub near: f32,
    pub orthographic: bool,
    /// The depth to which differences of depths are compared in a parallel projection.
    pub reference_depth: f32,
    /// One point in so many is drawn.
    step: usize,
    /// What multiplies radii, and the limits of the diameters in pixels.
    pub scale: f32,
    least: f32,
    most: f32,
    hides_backs: bool,
}

impl View {
    pub fn new(frame: &FrameCamera, settings: &Settings, step: usize) -> Self {
        let splat = &settings.splat;
        Self {
            view_from_world: frame.view_from_world.as_mat3(),
            full: frame.view_from_world,
            eye: frame.eye,
            size: frame.size,
            half: frame.size.map(|edge| edge as f32 * 0.5),
            focal: frame.focal_pixels as f32,
            near: frame.near as f32,
            orthographic: frame.orthographic,
            reference_depth: frame.reference_depth as f32,
            step,
            // The larger splats cover as much of the picture as all would.
            scale: splat.size * (step as f32).sqrt(),
            least: splat.min_pixels,
            most: splat.max_pixels.max(splat.min_pixels),
            hides_backs: !splat.back_faces,
        }
    }

    /// The pixels of a world unit at a depth.
    #[inline(always)]
    pub fn pixels_per_unit(&self, depth: f32) -> f32 {
        if self.orthographic { self.focal } else { self.focal / depth }
    }

    /// The direction of the line of sight of a place in pixels, per unit of depth; in a parallel projection, the view-space
    /// place where it begins.
    #[inline(always)]
    pub fn slope(&self, x: f32, y: f32) -> [f32; 2] {
        [(x - self.half[0]) / self.focal, (self.half[1] - y) / self.focal]
    }
}

/// A chunk that is drawn.
pub struct Piece<'a> {
    pub positions: &'a [[f32; 3]],
    pub normals: Option<&'a [u32]>,
    radii: Option<&'a [u16]>,
    shown: &'a ShownPoints,
    sizes: &'static Sizes,
    pub first_identity: u32,
    provisional_radius: f32,
    /// The place of the chunk's origin in view space.
    pub origin: Vec3,
    is_mirror: bool,
    /// The factor by which splats are larger than their radii.
    enlarged: f32,
    paint: Paint<'a>,
}

/// The factor for random samples of a smooth surface: between some of them are holes that their radii do not reach over.
const OF_SAMPLES: f32 = 1.6;

/// The fourth byte of the colour of a mirror, whose own colour is not shown.
pub const MIRROR: u8 = 0;

/// The radius of each packed one but for its shape, and the square root of the ratio of each shape's axes.
struct Sizes {
    radii: [f32; 2048],
    widths: [f32; 32],
}

fn sizes() -> &'static Sizes {
    static SIZES: OnceLock<Sizes> = OnceLock::new();
    SIZES.get_or_init(|| Sizes {
        radii: std::array::from_fn(|place| unpack_radius(place as u16 * 32).unwrap_or(0.0)),
        widths: std::array::from_fn(|shape| stretch_ratio(32 + shape as u16).sqrt().recip()),
    })
}

impl<'a> Piece<'a> {
    pub fn new(chunk: &SeenChunk<'a>, view: &View) -> Self {
        let SeenChunk { points, shown, first_identity, provisional_radius, .. } = *chunk;
        Self {
            positions: &points.positions,
            normals: points.normals.as_ref().map(|normals| normals.as_slice()),
            radii: points.radii.as_ref().map(|radii| radii.as_slice()),
            shown,
            sizes: sizes(),
            first_identity,
            provisional_radius,
            origin: (view.full * (points.origin - view.eye)).as_vec3(),
            is_mirror: chunk.is_mirror,
            enlarged: if chunk.is_sampled { OF_SAMPLES } else { 1.0 },
            paint: Paint::new(chunk),
        }
    }

    /// The colour of a point in sRGB; the fourth byte is `MIRROR` for a mirror's.
    #[inline(always)]
    pub fn color(&self, index: usize) -> [u8; 4] {
        match self.is_mirror {
            true => [0, 0, 0, MIRROR],
            false => self.paint.color(index, self.positions[index]),
        }
    }

    /// The radius of a point's splat in world units; of an ellipse, that of the disc with its area.
    #[inline(always)]
    pub fn radius(&self, index: usize) -> f32 {
        let packed = match self.radii {
            Some(radii) => radii[index],
            None => 0,
        };
        let radius = match packed {
            0 => self.provisional_radius,
            packed => self.sizes.radii[usize::from(packed >> 5)] * self.sizes.widths[usize::from(packed & 31)],
        };
        radius * self.enlarged
    }

    #[inline(always)]
    pub fn place(&self, index: usize, view: &View) -> Vec3 {
        view.view_from_world * Vec3::from(self.positions[index]) + self.origin
    }

    fn is_turned_away(&self, index: usize, place: Vec3, view: &View) -> bool {
        let sight = if view.orthographic { Vec3::Z } else { place };
        // Points without a normal have no back.
        self.normals
            .and_then(|normals| unpack_normal(normals[index]))
            .is_some_and(|normal| (view.view_from_world * normal).dot(sight) > 0.0)
    }

    fn put(&self, range: std::ops::Range<usize>, view: &View, levels: &Levels) {
        let first = range.start.next_multiple_of(view.step);
        let shows_all = matches!(self.shown, ShownPoints::All);
        for index in (first..range.end).step_by(view.step) {
            let place = self.place(index, view);
            // Places that are no numbers are not in front of anything.
            if !(place.z > view.near && place.z < 3e38) || !shows_all && !self.shown.has(index) {
                continue;
            }
            if view.hides_backs && self.is_turned_away(index, place, view) {
                continue;
            }
            let scale = view.pixels_per_unit(place.z);
            let [x, y] = [view.half[0] + place.x * scale, view.half[1] - place.y * scale];
            let diameter = (2.0 * self.radius(index) * view.scale * scale).clamp(view.least, view.most);
            levels.put(level_of(diameter), x, y, key_of(place.z, self.first_identity + index as u32));
        }
    }
}

/// The number of points that one thread takes at once.
const SLICE: usize = 1 << 14;

/// Puts the points of all pieces into the cells.
pub fn put_all(pieces: &[Piece<'_>], view: &View, levels: &Levels) {
    let slice = SLICE * view.step.min(8);
    let slices: Vec<(&Piece<'_>, std::ops::Range<usize>)> = pieces
        .iter()
        .flat_map(|piece| {
            let points = piece.positions.len();
            (0..points).step_by(slice).map(move |first| (piece, first..(first + slice).min(points)))
        })
        .collect();
    slices.into_par_iter().for_each(|(piece, range)| piece.put(range, view, levels));
}
