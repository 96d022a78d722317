//! Traces the picture of a frame, coarsely at once and then ever finer: one pixel of 16, all mirrors, one of 4, all,
//! each with one path of indirect light; then more and more paths, mirrors first. Each pixel's light is the mean of
//! independent unbiased estimates, so that further ones only reduce noise.

use cloud::Progress;

use crate::accuracy::Result;
use crate::truth::{Seen, Surface, Tracer};

/// A picture that is being traced.
pub struct Refinement {
    /// The hits to trace from.
    seen: Seen,
    is_mirror: Vec<bool>,
    /// The mean radiance, linear red, green and blue.
    colors: Vec<[f32; 3]>,
    /// The number of estimates behind each colour.
    taken: Vec<u32>,
    width: usize,
    /// The number of estimates that each pixel should have.
    wanted: u32,
}

/// The pixels of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Pixels {
    /// One of this many in each row and column.
    Every(usize),
    Mirrors,
}

impl Refinement {
    /// Starts from what `tracer` sees at the frame's surface; nothing is traced yet.
    pub fn new(tracer: &Tracer, surface: &Surface) -> Self {
        let seen = tracer.seen(surface);
        let is_mirror = (0..surface.len()).map(|pixel| surface.is_mirror(pixel)).collect();
        let (colors, taken) = (vec![[f32::NAN; 3]; seen.len()], vec![0; seen.len()]);
        Self { seen, is_mirror, colors, taken, width: tracer.width(), wanted: tracer.samples().max(1) }
    }

    /// Traces the next step, of mirrors alone or of the whole picture; `tracer` is that of [`Refinement::new`]. Returns
    /// false if nothing is left to do.
    ///
    /// # Errors
    /// Cancelled; the picture is then unchanged.
    pub fn step(&mut self, tracer: &Tracer, mirrors_alone: bool, progress: &Progress) -> Result<bool> {
        let Some((pixels, until)) = self.next(mirrors_alone) else { return Ok(false) };
        let is_next: Vec<bool> = (0..self.seen.len()).map(|pixel| self.lacks(pixels, until, pixel)).collect();
        // All pixels of a step have equally many estimates.
        let before = is_next.iter().position(|next| *next).map_or(0, |pixel| self.taken[pixel]);
        let masked: Seen = self.seen.iter().zip(&is_next).map(|(seen, next)| seen.filter(|_| *next)).collect();
        // A seed that no earlier step had, so that the estimates are new.
        let seed = tracer.seed().wrapping_add(before);
        let traced = tracer.sampled_colors(&masked, until - before, seed, progress)?;
        let share = (until - before) as f32 / until as f32;
        for pixel in (0..is_next.len()).filter(|pixel| is_next[*pixel]) {
            let (color, new) = (&mut self.colors[pixel], traced[pixel]);
            for (mean, new) in color.iter_mut().zip(new) {
                *mean = if before == 0 { new } else { *mean + (new - *mean) * share };
            }
            self.taken[pixel] = until;
        }
        Ok(true)
    }

    /// The first step with pixels left: its pixels, and the number of estimates that each should have.
    fn next(&self, mirrors_alone: bool) -> Option<(Pixels, u32)> {
        let first = [Pixels::Every(4), Pixels::Mirrors, Pixels::Every(2), Pixels::Every(1)].map(|pixels| (pixels, 1));
        let doublings = || (1..=self.wanted.ilog2()).map(|power| 1 << power).chain([self.wanted]);
        let finer = [Pixels::Mirrors, Pixels::Every(1)].into_iter();
        let finer = finer.flat_map(|pixels| doublings().map(move |until| (pixels, until)));
        let wanted = |(pixels, _): &(Pixels, u32)| !mirrors_alone || *pixels == Pixels::Mirrors;
        let mut steps = first.into_iter().chain(finer).filter(wanted);
        steps.find(|(pixels, until)| (0..self.seen.len()).any(|pixel| self.lacks(*pixels, *until, pixel)))
    }

    fn lacks(&self, pixels: Pixels, until: u32, pixel: usize) -> bool {
        let is_among = match pixels {
            Pixels::Mirrors => self.is_mirror[pixel],
            Pixels::Every(stride) => {
                (pixel % self.width).is_multiple_of(stride) && (pixel / self.width).is_multiple_of(stride)
            }
        };
        is_among && self.seen[pixel].is_some() && self.taken[pixel] < until
    }

    /// The number of estimates behind every mirror pixel, and behind every pixel; the wanted number if there are no
    /// such pixels.
    pub fn samples(&self) -> [u32; 2] {
        let least = |is_asked: &dyn Fn(usize) -> bool| {
            let asked = (0..self.seen.len()).filter(|pixel| self.seen[*pixel].is_some() && is_asked(*pixel));
            asked.map(|pixel| self.taken[pixel]).min().unwrap_or(self.wanted)
        };
        [least(&|pixel| self.is_mirror[pixel]), least(&|_| true)]
    }

    /// The number of estimates that each pixel should have: paths of indirect light, or 1 if there is none.
    pub fn wanted(&self) -> u32 {
        self.wanted
    }

    /// How many estimates are taken, how many the next step adds, and how many are wanted in all, of mirrors alone or of the
    /// whole picture.
    pub fn work(&self, mirrors_alone: bool) -> [u64; 3] {
        let next = self.next(mirrors_alone);
        let mut work = [0; 3];
        for pixel in (0..self.seen.len()).filter(|pixel| self.seen[*pixel].is_some()) {
            let taken = self.taken[pixel];
            if !mirrors_alone || self.is_mirror[pixel] {
                work[0] += u64::from(taken);
                work[2] += u64::from(self.wanted);
            }
            if let Some((_, until)) = next.filter(|(pixels, until)| self.lacks(*pixels, *until, pixel)) {
                work[1] += u64::from(until - taken);
            }
        }
        work
    }

    /// Whether all estimates are done, of the mirrors or of the picture.
    pub fn is_done(&self, mirrors_alone: bool) -> bool {
        self.next(mirrors_alone).is_none()
    }

    /// Whether every pixel has at least the colour of a nearby one, in the whole picture and not in mirrors alone.
    pub fn is_whole(&self) -> bool {
        !(0..self.seen.len()).any(|pixel| self.lacks(Pixels::Every(4), 1, pixel))
    }

    /// The linear red, green and blue, NaN where nothing is seen. A pixel that is not traced yet has the colour of a
    /// traced one nearby, or black.
    pub fn picture(&self) -> Vec<[f32; 3]> {
        let height = self.seen.len() / self.width.max(1);
        let color = |pixel: usize| {
            if self.taken[pixel] > 0 || self.seen[pixel].is_none() {
                return self.colors[pixel];
            }
            let (column, row) = (pixel % self.width, pixel / self.width);
            let nearby = [2, 4].into_iter().flat_map(|stride| {
                let corner = [column, row].map(|place| place - place % stride);
                [[0, 0], [1, 0], [0, 1], [1, 1]].map(|step| [0, 1].map(|axis| corner[axis] + step[axis] * stride))
            });
            let inside = nearby.filter(|[column, row]| *column < self.width && *row < height);
            let mut traced = inside.map(|[column, row]| row * self.width + column).filter(|near| self.taken[*near] > 0);
            traced.next().map_or([0.0; 3], |near| self.colors[near])
        };
        (0..self.seen.len()).map(color).collect()
    }
}

#[cfg(test)]
mod tests {
    use cloud::{Cloud, Progress};
    use render::Objects;
    use scene::five_mirrors::{self, Variant};
    use scene::{LightClues, Settings};

    use super::*;
    use crate::subject::SubjectPart;
    use crate::truth::{TracedScene, View};
    use crate::{Truth, mirrors_of};

    const SIZE: [u32; 2] = [33, 22];

    fn scene() -> TracedScene {
        let parts = five_mirrors::sample(Variant::Sphere, 4000, 1).into_iter().map(|part| {
            let cloud = Cloud { chunks: part.chunks, ..Cloud::default() };
            let wall = scene::Mirror { specular_intensity: 0.0, ..Variant::Sphere.mirrors()[0].clone() };
            SubjectPart::of_mirror(&part.mirror.unwrap_or(wall), cloud)
        });
        TracedScene::new(&parts.collect::<Vec<_>>(), None, 1.0, &Progress::default()).unwrap()
    }

    /// The frame that rays through the pixels' centres give.
    fn surface(scene: &TracedScene) -> Surface {
        let view = scene::ViewSettings::default();
        let camera = five_mirrors::camera();
        let eye = scene::Camera { eye: camera.eye - scene.origin, pivot: camera.pivot - scene.origin, up: camera.up };
        let rays = trace::PixelRays::new(&eye, &view, SIZE, 0.0);
        let seen = trace::primary(&scene.surfels, &rays, &Progress::default()).unwrap();
        Surface::of_hits(&seen)
    }

    #[test]
    fn steps_end_at_the_mean_of_as_many_paths_as_are_wanted_mirrors_first() {
        let (scene, progress) = (scene(), Progress::default());
        let (camera, lights) = (five_mirrors::camera(), [five_mirrors::light()]);
        let mut settings = Settings::default();
        settings.trace.samples = 5;
        let objects = Objects { mirrors: &[], lights: &lights, clues: LightClues::default() };
        let tracer = Tracer::new(&scene, View { camera: &camera, settings: &settings, objects, size: SIZE });
        let surface = surface(&scene);
        let mut refinement = Refinement::new(&tracer, &surface);
        assert!(refinement.is_mirror.iter().any(|mirror| *mirror));
        let mut pixels_traced = Vec::new();
        let mut mirrors_were_done = false;
        let mut expected_work = refinement.work(false);
        assert_eq!((expected_work[0], refinement.work(true)[2] > 0), (0, true));
        while refinement.step(&tracer, false, &progress).unwrap() {
            let work = refinement.work(false);
            assert_eq!((work[0], work[2]), (expected_work[0] + expected_work[1], expected_work[2]), "as announced");
            expected_work = work;
            pixels_traced.push(refinement.taken.iter().filter(|taken| **taken > 0).count());
            mirrors_were_done |= refinement.is_done(true) && !refinement.is_done(false);
            let picture = refinement.picture();
            let is_hole = |pixel: usize| refinement.seen[pixel].is_some() && !picture[pixel][0].is_finite();
            assert!(!(0..picture.len()).any(is_hole));
        }
        assert_eq!((refinement.samples(), mirrors_were_done), ([5, 5], true));
        assert_eq!((expected_work[0], expected_work[1]), (expected_work[2], 0));
        assert!(pixels_traced[0] <= 9 * 6 && pixels_traced.is_sorted(), "{pixels_traced:?}");
        // Computed by hand: paths 1, 1, 2 and 1, each step with a seed of its own.
        let mut expected = vec![[0.0_f64; 3]; surface.len()];
        for (samples, seed) in [(1, 0), (1, 1), (2, 2), (1, 4)] {
            let mut settings = settings.clone();
            (settings.trace.samples, settings.trace.seed) = (samples, settings.trace.seed + seed);
            let tracer = Tracer::new(&scene, View { camera: &camera, settings: &settings, objects, size: SIZE });
            let colors = tracer.colors(Truth::SameInput, &tracer.seen(&surface), &progress).unwrap();
            for (sum, color) in expected.iter_mut().flatten().zip(colors.as_flattened()) {
                *sum += f64::from(*color) * f64::from(samples) / 5.0;
            }
        }
        let picture = refinement.picture();
        let worst = picture.as_flattened().iter().zip(expected.as_flattened());
        let worst = worst.map(|(found, sum)| (f64::from(*found) - sum).abs()).filter(|off| off.is_finite());
        assert!(worst.fold(0.0, f64::max) < 1e-5);
    }

    #[test]
    fn a_cancelled_step_changes_nothing_and_mirrors_alone_leave_the_rest() {
        let (scene, camera, settings) = (scene(), five_mirrors::camera(), Settings::default());
        let view = View { camera: &camera, settings: &settings, objects: Objects::default(), size: SIZE };
        let tracer = Tracer::new(&scene, view);
        let surface = surface(&scene);
        let mut refinement = Refinement::new(&tracer, &surface);
        let cancelled = Progress::default();
        cancelled.cancel();
        assert!(refinement.step(&tracer, true, &cancelled).is_err());
        assert_eq!(refinement.taken.iter().max(), Some(&0));
        let progress = Progress::default();
        // A lamp at the eye has no indirect light: one estimate is exact.
        assert!(
            refinement.step(&tracer, true, &progress).unwrap() && !refinement.step(&tracer, true, &progress).unwrap()
        );
        assert!(refinement.is_done(true) && !refinement.is_done(false) && !refinement.is_whole());
        let colors = tracer.colors(Truth::SameInput, &mirrors_of(&tracer.seen(&surface)), &progress).unwrap();
        let pixels = (0..surface.len()).filter(|pixel| surface.is_mirror(*pixel));
        for pixel in pixels.clone() {
            assert_eq!(refinement.colors[pixel], colors[pixel]);
        }
        assert_eq!(refinement.taken.iter().filter(|taken| **taken > 0).count(), pixels.count());
    }
}
