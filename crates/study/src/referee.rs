//! Judges what is shown of a made scan by the surfaces that it is a scan of.
//!
//! The surface that a pixel's ray meets and the one that its reflection meets are known exactly, and so is whether any
//! station of the scanner saw them. What no station saw has no point, and is left out. So are reflections of a mirror,
//! which no scanner saw either. A surface that hides a mirror stands in front of what the mirror shows.

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
    /// The share whose surface is nearer by more than 1 %.
    pub in_front: f64,
    /// The share whose surface is farther away by more than 1 %.
    pub behind: f64,
    /// Nothing is shown.
    pub empty: f64,
    /// The pixels that are left out, because no station saw their surface. They are no part of the others.
    pub unscanned: usize,
}

/// The verdict on a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// Shares of the pixels that see no mirror; distances are from the eye.
    pub camera: Shares,
    /// Shares of the pixels that see a mirror; distances are from the mirror, along the reflected ray.
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

#[derive(Clone, Copy, Debug, PartialEq)]
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
                    let [own, before] = [point, three(&shown.position, 3 * pixel)].map(|at| at.distance(camera.eye));
                    let is_hidden = Outcome::of(before.is_finite().then_some(before), own) == Outcome::InFront;
                    let outcome = Outcome::of(is_found.then(|| place.distance(point)), distance);
                    mirrored.push(if is_hidden { Outcome::InFront } else { outcome });
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

    /// How often the exact surface lies within the interval that each pixel states for its error (`half_widths`, along the
    /// pixels' rays), of the pixels that see no mirror and are right. Not a number where there are none.
    pub fn held(
        &self,
        camera: &Camera,
        settings: &Settings,
        size: [u32; 2],
        shown: &Shown,
        half_widths: &[f32],
    ) -> f64 {
        let rays = PixelRays::new(camera, &settings.view, size, 0.0);
        let held = |pixel: usize| {
            let Truth::Surface { distance, .. } = self.truth(rays.ray(pixel)) else { return None };
            let place = DVec3::from([0, 1, 2].map(|axis| f64::from(shown.position[3 * pixel + axis])));
            let found = place.is_finite().then(|| place.distance(camera.eye))?;
            let is_right = Outcome::of(Some(found), distance) == Outcome::Right && !half_widths[pixel].is_nan();
            is_right.then(|| (found - distance).abs() <= f64::from(half_widths[pixel]))
        };
        let held: Vec<bool> = (0..rays.pixel_count()).into_par_iter().filter_map(held).collect();
        held.iter().filter(|held| **held).count() as f64 / held.len() as f64
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

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    const SIZE: [u32; 2] = [200, 150];

    fn settings() -> Settings {
        judged(&Settings::default())
    }

    /// A picture of the room that shows every pixel's truth, with what stands at `place` changed.
    fn shown(referee: &Referee, change: impl Fn(&Ray, Truth) -> (DVec3, DVec3, f32)) -> (Shown, Camera) {
        let camera = referee.scan.camera();
        let rays = PixelRays::new(&camera, &settings().view, SIZE, 0.0);
        let mut shown = Shown { position: Vec::new(), mirror_position: Vec::new() };
        for pixel in 0..rays.pixel_count() {
            let ray = rays.ray(pixel);
            let (position, mirrored, coverage) = change(&ray, referee.truth(ray));
            shown.position.extend(position.as_vec3().to_array());
            shown.mirror_position.extend(mirrored.as_vec3().extend(coverage).to_array());
        }
        (shown, camera)
    }

    /// What a perfect picture shows, with distances that are longer by this factor.
    fn right(ray: &Ray, truth: Truth, factor: f64) -> (DVec3, DVec3, f32) {
        match truth {
            Truth::Surface { distance, .. } => (ray.at(distance * factor), DVec3::NAN, 0.0),
            Truth::Mirror { point, distance, .. } => (point, point + DVec3::X * distance * factor, 1.0),
            Truth::Nothing => (DVec3::NAN, DVec3::NAN, 0.0),
        }
    }

    fn judge(change: impl Fn(&Ray, Truth) -> (DVec3, DVec3, f32)) -> Verdict {
        let referee = Referee::new(Tripod::Room);
        let (shown, camera) = shown(&referee, change);
        referee.judge(&camera, &settings(), SIZE, &shown)
    }

    fn shares(shares: Shares) -> [f64; 4] {
        [shares.right, shares.in_front, shares.behind, shares.empty]
    }

    #[test]
    fn what_is_right_near_far_or_missing_by_a_percent_is_counted_so() {
        for (factor, expected) in [
            (1.0, [1.0, 0.0, 0.0, 0.0]),
            (0.991, [1.0, 0.0, 0.0, 0.0]),
            (1.009, [1.0, 0.0, 0.0, 0.0]),
            (0.989, [0.0, 1.0, 0.0, 0.0]),
            (1.011, [0.0, 0.0, 1.0, 0.0]),
            (f64::NAN, [0.0, 0.0, 0.0, 1.0]),
        ] {
            let verdict = judge(|ray, truth| right(ray, truth, factor));
            assert_eq!([verdict.camera, verdict.mirrors].map(shares), [expected; 2], "{factor}");
            assert!(verdict.covered == if factor.is_nan() { 0.0 } else { 1.0 }, "{factor}: {}", verdict.covered);
            assert!(verdict.camera.pixels > 25_000 && verdict.mirrors.pixels > 2000, "{verdict:?}");
            assert!(verdict.camera.unscanned > 500 && verdict.mirrors.unscanned > 20, "{verdict:?}");
        }
    }

    #[test]
    fn half_widths_hold_where_the_exact_surface_is_within_them() {
        let referee = Referee::new(Tripod::Room);
        // All is 0.005 of its distance too far, which half widths of 0.02 hold up to a distance of 4.
        let (shown, camera) = shown(&referee, |ray, truth| right(ray, truth, 1.005));
        let held = |half_width: f32| {
            let half_widths = vec![half_width; (SIZE[0] * SIZE[1]) as usize];
            referee.held(&camera, &settings(), SIZE, &shown, &half_widths)
        };
        assert_eq!([held(0.0), held(1.0)], [0.0, 1.0]);
        assert!((0.05..0.95).contains(&held(0.02)) && held(f32::NAN).is_nan(), "{}", held(0.02));
    }

    #[test]
    fn a_closed_gap_is_shown_and_not_covered() {
        let verdict = judge(|ray, truth| {
            let (position, mirrored, coverage) = right(ray, truth, 1.0);
            (position, mirrored, coverage * 0.5)
        });
        assert_eq!((verdict.mirrors.right, verdict.covered), (1.0, 0.0));
    }

    #[test]
    fn a_wrong_disc_takes_the_pixels_that_its_angle_covers() {
        // The disc faces the camera 1 m before it, where the wall and no mirror is.
        let (distance, radius) = (1.0, 0.08);
        let camera = Tripod::Room.camera();
        let way = (DVec3::new(8.0, 1.9, 2.5) - camera.eye).normalize();
        let disc = |ray: &Ray, truth: Truth| {
            let at = ray.at(distance / ray.direction.dot(way));
            if at.distance(camera.eye + way * distance) < radius {
                (at, DVec3::NAN, 0.0)
            } else {
                right(ray, truth, 1.0)
            }
        };
        let verdict = judge(disc);
        // A pixel of a picture of 150 rows and 60 degrees is this wide at a distance of 1 along the axis; a disc aside
        // from the axis covers more of them, by the third power of the cosine.
        let pixel = 2.0 * 30.0_f64.to_radians().tan() / 150.0;
        let cosine = way.dot(camera.forward());
        let expected = PI * (radius / distance / pixel).powi(2) / cosine.powi(3);
        let found = verdict.camera.in_front * verdict.camera.pixels as f64;
        assert!((found / expected - 1.0).abs() < 0.03, "{found} pixels, expected {expected}");
        assert!((verdict.camera.right + verdict.camera.in_front - 1.0).abs() < 1e-12, "{verdict:?}");
        assert_eq!(verdict.mirrors.right, 1.0);
    }

    #[test]
    fn what_hides_a_mirror_is_in_front() {
        let verdict = judge(|ray, truth| match truth {
            Truth::Mirror { .. } => (ray.at(0.5), DVec3::NAN, 0.0),
            _ => right(ray, truth, 1.0),
        });
        assert_eq!((verdict.camera.right, verdict.mirrors.in_front), (1.0, 1.0));
    }
}
