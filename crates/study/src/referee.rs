//! Judges what is shown of a made scan by the surfaces that it is a scan of.
//!
//! The surface that a pixel's ray meets and the one that its reflection meets are known exactly, and so is whether any
//! station of the scanner saw them. What no station saw has no point, and is left out. So are reflections of a mirror,
//! which no scanner saw either.

use glam::DVec3;
use rayon::prelude::*;
use render::{Aov, Renderer};
use scene::solid::Solid;
use scene::{Camera, Lighting, Projection, Settings, Tripod, five_mirrors};
use serde::Serialize;
use trace::{Exact, Geometry as _, MirrorPoint, PixelRays, Ray};

use crate::sightlines::TOLERANCE;
use crate::subject::Subject;

/// The size of the picture that is judged, in pixels.
pub const JUDGED: [u32; 2] = [400, 300];

/// Shares of the pixels that are judged; not numbers where there are none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Shares {
    pub pixels: usize,
    /// What is shown is at the true distance, to 1 %.
    pub right: f64,
    /// It is nearer by more than 1 %.
    pub in_front: f64,
    /// It is farther away by more than 1 %.
    pub behind: f64,
    /// Nothing is shown.
    pub empty: f64,
    /// The pixels that are left out, because no station saw their surface. They are no part of the others.
    pub unscanned: usize,
}

/// The verdict on a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// Of the pixels that see no mirror; distances are from the eye.
    pub camera: Shares,
    /// Of the pixels that see a mirror; distances are along the reflected ray.
    pub mirrors: Shares,
    /// The share of the judged pixels of mirrors that found what they reflect and did not close a gap.
    pub covered: f64,
}

/// The pictures that are judged, row by row, positions in world coordinates.
#[derive(Clone, Debug)]
pub struct Shown {
    /// The position of each pixel's surface, three numbers; not numbers where there is none.
    pub position: Vec<f32>,
    /// The position of what each pixel's mirror shows, and its coverage: 0 for nothing, below 0.75 for a closed gap.
    pub mirror_position: Vec<f32>,
}

impl Shown {
    /// The picture that was rendered last.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn read(renderer: &Renderer) -> render::Result<Self> {
        let read = |aov| renderer.read_aov(aov).map(|image| image.data);
        Ok(Self { position: read(Aov::Position)?, mirror_position: read(Aov::MirrorPosition)? })
    }
}

/// Knows what a made scan is a scan of.
pub struct Referee {
    scan: Tripod,
    solids: Vec<Solid>,
    exact: Exact,
}

/// What a pixel should show.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Truth {
    /// A surface at this distance from the eye.
    Surface { distance: f64, is_scanned: bool },
    /// A mirror at `point`, which shows a surface at this distance from there.
    Mirror { point: DVec3, distance: f64, is_scanned: bool },
    /// Nothing, or a mirror that shows nothing or another mirror.
    Nothing,
}

#[derive(Clone, Copy, PartialEq)]
enum Outcome {
    Right,
    InFront,
    Behind,
    Empty,
}

impl Outcome {
    fn of(shown: Option<f64>, distance: f64) -> Self {
        match shown.map(|shown| shown / distance - 1.0) {
            None => Self::Empty,
            Some(error) if error < -TOLERANCE => Self::InFront,
            Some(error) if error > TOLERANCE => Self::Behind,
            Some(_) => Self::Right,
        }
    }
}

impl Shares {
    /// `outcomes` are those of the pixels whose surface was scanned.
    fn of(outcomes: &[Outcome], unscanned: usize) -> Self {
        let share = |wanted| {
            let count = outcomes.iter().filter(|outcome| **outcome == wanted).count();
            count as f64 / outcomes.len() as f64
        };
        Self {
            pixels: outcomes.len(),
            right: share(Outcome::Right),
            in_front: share(Outcome::InFront),
            behind: share(Outcome::Behind),
            empty: share(Outcome::Empty),
            unscanned,
        }
    }
}

impl Referee {
    pub fn new(scan: Tripod) -> Self {
        let exact = Exact::five_mirrors(five_mirrors::Variant::Tripod(scan));
        Self { scan, solids: scan.solids(), exact }
    }

    /// Draws the scene by the default method, or by that of the settings, and judges the picture.
    ///
    /// # Errors
    /// The device was lost, or the picture is too large.
    pub fn draw_and_judge(
        &self,
        subject: &Subject,
        renderer: &mut Renderer,
        settings: &Settings,
    ) -> render::Result<Verdict> {
        let settings = judged(settings);
        subject.render(renderer, &settings, JUDGED)?;
        Ok(self.judge(&subject.camera, &settings, JUDGED, &Shown::read(renderer)?))
    }

    /// Judges a picture of this camera and size in perspective.
    pub fn judge(&self, camera: &Camera, settings: &Settings, size: [u32; 2], shown: &Shown) -> Verdict {
        let rays = PixelRays::new(camera, &settings.view, size, 0.0);
        let three = |image: &[f32], start: usize| DVec3::from([0, 1, 2].map(|axis| f64::from(image[start + axis])));
        let truths: Vec<Truth> =
            (0..rays.pixel_count()).into_par_iter().map(|pixel| self.truth(rays.ray(pixel))).collect();
        let (mut seen, mut mirrored) = (Vec::new(), Vec::new());
        let (mut unseen, mut unmirrored, mut covered) = (0, 0, 0);
        for (pixel, truth) in truths.into_iter().enumerate() {
            match truth {
                Truth::Surface { is_scanned: false, .. } => unseen += 1,
                Truth::Mirror { is_scanned: false, .. } => unmirrored += 1,
                Truth::Surface { distance, .. } => {
                    let place = three(&shown.position, 3 * pixel);
                    let found = place.is_finite().then(|| place.distance(camera.eye));
                    seen.push(Outcome::of(found, distance));
                }
                Truth::Mirror { point, distance, .. } => {
                    let (place, coverage) =
                        (three(&shown.mirror_position, 4 * pixel), shown.mirror_position[4 * pixel + 3]);
                    let is_found = place.is_finite() && coverage > 0.0;
                    covered += usize::from(is_found && coverage >= 0.75);
                    mirrored.push(Outcome::of(is_found.then(|| place.distance(point)), distance));
                }
                Truth::Nothing => {}
            }
        }
        Verdict {
            covered: covered as f64 / mirrored.len() as f64,
            camera: Shares::of(&seen, unseen),
            mirrors: Shares::of(&mirrored, unmirrored),
        }
    }

    fn truth(&self, ray: Ray) -> Truth {
        let Some(hit) = self.exact.nearest(&ray) else { return Truth::Nothing };
        let is_scanned = |place| self.scan.is_scanned(&self.solids, place);
        if hit.specular_intensity == 0.0 {
            return Truth::Surface { distance: hit.distance, is_scanned: is_scanned(hit.position) };
        }
        let mirror = MirrorPoint { position: hit.position, normal: hit.normal, incoming: ray.direction };
        let Some(reflected) = mirror.reflected() else { return Truth::Nothing };
        let end = self.exact.nearest(&reflected).filter(|end| end.specular_intensity == 0.0);
        let mirror = |end: trace::Hit| Truth::Mirror {
            point: hit.position,
            distance: end.distance,
            is_scanned: is_scanned(end.position),
        };
        end.map_or(Truth::Nothing, mirror)
    }
}

/// The parameters of a picture that is judged: with exact mirrors and one reflection, without light.
fn judged(settings: &Settings) -> Settings {
    let mut settings = settings.clone();
    settings.view.projection = Projection::Perspective;
    settings.view.resolution = 1.0;
    settings.light.by = Lighting::Colors;
    settings.gi.bounces = 0;
    settings.mirror.surface = scene::MirrorSurface::Exact;
    settings.reflection.bounces = 1;
    settings
}
