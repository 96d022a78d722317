//! The splats of points, and how they are put into the cells of a pyramid.

use std::ops::Range;
use std::sync::OnceLock;

use cloud::{ShownPoints, stretch_ratio, unpack_normal, unpack_radius};
use glam::{DMat3, DVec3, Mat3, Vec3, Vec4};
use rayon::prelude::*;
use scene::{Quality, Settings};

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
    /// So many radii behind the nearest splat of a pixel, others are mixed with it; `None` shows it alone.
    pub mixed_behind: Option<f32>,
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
            mixed_behind: (splat.quality == Quality::High).then_some(splat.depth_offset),
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

/// The disc of a splat, in view space.
#[derive(Clone, Copy)]
pub struct Disc {
    pub center: Vec3,
    /// Zero if it faces the eye.
    pub normal: Vec3,
    /// The product of normal and middle.
    offset: f32,
    pub inverse_square: f32,
    pub color: [u8; 4],
}

pub const NO_DISC: Disc =
    Disc { center: Vec3::ZERO, normal: Vec3::ZERO, offset: 0.0, inverse_square: f32::INFINITY, color: [0; 4] };

impl Disc {
    #[inline(always)]
    pub fn new(piece: &Piece<'_>, index: usize, center: Vec3, radius: f32, view: &View) -> Self {
        let normal = piece.normals.and_then(|normals| unpack_normal(normals[index])).unwrap_or(Vec3::ZERO);
        let normal = view.view_from_world * normal;
        let color = piece.color(index);
        Self { center, normal, offset: normal.dot(center), inverse_square: 1.0 / (radius * radius), color }
    }

    /// The depth at a line of sight, and the square of the distance from the middle in radii.
    #[inline(always)]
    pub fn meet(&self, [x, y]: [f32; 2], view: &View) -> (f32, f32) {
        let Self { center, normal, .. } = *self;
        let depth = if normal == Vec3::ZERO {
            center.z
        } else if view.orthographic {
            (self.offset - normal.x * x - normal.y * y) / normal.z
        } else {
            self.offset / (normal.x * x + normal.y * y + normal.z)
        };
        let across = if view.orthographic { 1.0 } else { depth };
        let beside = Vec3::new(x * across, y * across, depth) - center;
        (depth, beside.length_squared() * self.inverse_square)
    }

    /// The same at four lines of sight side by side, whose slopes across the picture are `x`.
    #[inline(always)]
    pub fn meet_four(&self, x: Vec4, y: f32, view: &View) -> (Vec4, Vec4) {
        let Self { center, normal, .. } = *self;
        let depth = if normal == Vec3::ZERO {
            Vec4::splat(center.z)
        } else if view.orthographic {
            (self.offset - normal.x * x - normal.y * y) / normal.z
        } else {
            self.offset / (normal.x * x + normal.y * y + normal.z)
        };
        let across = if view.orthographic { Vec4::ONE } else { depth };
        let (right, up, behind) = (x * across - center.x, y * across - center.y, depth - center.z);
        (depth, (right * right + up * up + behind * behind) * self.inverse_square)
    }

    /// How far from its middle the disc may cover pixels, across and down the picture; its radius is `pixels` there.
    pub fn reach(&self, radius: f32, pixels: f32, view: &View) -> [f32; 2] {
        let Self { center, normal, .. } = *self;
        // The margins are wider than what rounding moves its rim.
        let nearest = center.z - 1.01 * radius * (1.0 - normal.z * normal.z).max(0.0).sqrt();
        if normal == Vec3::ZERO || nearest <= view.near {
            return [pixels; 2];
        }
        [0, 1].map(|axis| {
            // At right angles to the upright or level plane of sight through its middle.
            let slope = if view.orthographic { 0.0 } else { center[axis] / center.z };
            let across = normal[axis] - slope * normal.z;
            let width = ((1.0 + slope * slope - across * across).max(0.0) + 1e-4).sqrt();
            pixels.min(1.01 * view.pixels_per_unit(nearest) * radius * width + 0.05)
        })
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

    /// Whether a point's splat is an ellipse of twice its width and more.
    pub fn is_long(&self, index: usize) -> bool {
        let packed = self.radii.map_or(0, |radii| radii[index]);
        self.sizes.widths[usize::from(packed & 31)] < 0.71
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

    /// Where a point is on the screen in pixels, the pixels of a world unit there, and the radius of its splat in pixels.
    #[inline(always)]
    pub fn on_screen(&self, index: usize, place: Vec3, view: &View) -> ([f32; 2], f32, f32) {
        let scale = view.pixels_per_unit(place.z);
        let middle = [view.half[0] + place.x * scale, view.half[1] - place.y * scale];
        (middle, scale, (self.radius(index) * view.scale * scale).max(0.5 * view.least))
    }

    /// Calls `draw` with each point of a range that is drawn, and its place in view space.
    #[inline(always)]
    pub fn each(&self, range: Range<usize>, view: &View, mut draw: impl FnMut(usize, Vec3)) {
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
            draw(index, place);
        }
    }

    fn put(&self, range: Range<usize>, view: &View, levels: &Levels) {
        self.each(range, view, |index, place| {
            let ([x, y], _, radius) = self.on_screen(index, place, view);
            levels.put(
                level_of((2.0 * radius).min(view.most)),
                x,
                y,
                key_of(place.z, self.first_identity + index as u32),
            );
        });
    }
}

/// The number of points that one thread takes at once.
const SLICE: usize = 1 << 14;

/// The points of all pieces, in parts for one thread each.
pub fn slices<'a>(pieces: &'a [Piece<'a>], view: &View) -> Vec<(&'a Piece<'a>, Range<usize>)> {
    let slice = SLICE * view.step.min(8);
    let of_piece = |piece: &'a Piece<'a>| {
        let points = piece.positions.len();
        (0..points).step_by(slice).map(move |first| (piece, first..(first + slice).min(points)))
    };
    pieces.iter().flat_map(of_piece).collect()
}

/// Puts the points of all pieces into the cells.
pub fn put_all(pieces: &[Piece<'_>], view: &View, levels: &Levels) {
    slices(pieces, view).into_par_iter().for_each(|(piece, range)| piece.put(range, view, levels));
}
