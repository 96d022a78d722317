//! The picture while something moves, where the adapter is a processor: every pixel of the picture and as many points as
//! its time allows, computed without the GPU's passes.
//!
//! Where points are few, each is drawn as a disc (discs.rs). Else each point is put once into a pyramid of cells
//! (levels.rs), at the level whose cells are a quarter to half as wide as its splat, so a point costs the same however large
//! its splat is. Each pixel then looks up the few points around it (look_up.rs).
//! Schuetz et al. 2021 splat points with one atomic minimum each, as here; docs/performance.md has the times.

mod discs;
mod earlier;
mod levels;
mod light;
mod look_up;
mod paint;
mod splat;

use std::sync::Arc;
use std::time::Instant;

use rayon::ThreadPool;
use scene::{Camera, Settings};

use crate::frame::FrameCamera;
use crate::gpu::Clock;
use crate::handed::PictureRows;
use crate::identities::Identities;
use crate::pass_times::PassTime;
use crate::passes::PassStage;
use crate::read_back::Picked;
use crate::reflection::kept_hits::GlossCache;
use crate::renderer::FrameStats;
use crate::store::PointStore;
pub use earlier::EarlierLight;
use levels::{EMPTY, Levels, depth_of, identity_of};
pub use light::{Known, KnownLight};
pub(crate) use light::{StillImages, StillMirrors};
use look_up::Pixels;
use splat::{Piece, View};

/// Draws quick pictures.
pub struct QuickPicture {
    /// Threads for these pictures alone, which do not wait for what is read, decoded or compiled on the others; `None` if
    /// the system has none left.
    threads: Option<ThreadPool>,
    levels: Levels,
    pixels: Pixels,
    /// The size and the identities of the last picture.
    size: [u32; 2],
    drawn: Arc<Identities>,
}

impl Default for QuickPicture {
    fn default() -> Self {
        let threads = rayon::ThreadPoolBuilder::new().thread_name(|_| "quick picture".into()).build().ok();
        let (levels, pixels, size, drawn) = Default::default();
        Self { threads, levels, pixels, size, drawn }
    }
}

/// How coarse a quick picture is.
#[derive(Clone, Copy, Debug)]
pub struct Detail {
    /// About how many points are drawn, spread evenly and each larger; `None` draws all.
    pub most_points: Option<u64>,
    /// The pixels of the screen that each pixel of the picture fills, along each side.
    pub coarseness: u32,
    /// Clouds of up to so many points in all, if none is left out and their splats cover few pixels, are drawn as discs; else
    /// points go into cells.
    pub most_as_discs: u64,
}

impl Detail {
    /// So many points on 0.24 million pixels take up to twice as long as discs as in cells.
    pub const MOST_AS_DISCS: u64 = 1 << 17;
}

impl QuickPicture {
    /// Draws a picture of `size` pixels of the points that `camera` sees. They are lit as `known` says, or show their own
    /// colours, and mirrors show what it says, or else the mean colour of all others.
    pub fn draw(
        &mut self,
        store: &PointStore,
        camera: &Camera,
        settings: &Settings,
        size: [u32; 2],
        detail: Detail,
        known: Known<'_>,
    ) -> FrameStats {
        let threads = self.threads.take();
        let mut draw = || self.draw_here(store, camera, settings, size, detail, known);
        let stats = match &threads {
            Some(threads) => threads.install(draw),
            None => draw(),
        };
        self.threads = threads;
        stats
    }

    /// Draws on the threads on which it is called.
    fn draw_here(
        &mut self,
        store: &PointStore,
        camera: &Camera,
        settings: &Settings,
        size: [u32; 2],
        detail: Detail,
        known: Known<'_>,
    ) -> FrameStats {
        let began = Instant::now();
        let size = size.map(|edge| edge.max(1));
        let reach = store.reach();
        let (center, radius) = if reach.is_empty() { (camera.pivot, 1.0) } else { (reach.center(), reach.radius()) };
        let frame = FrameCamera::new(camera, &settings.view, size, center, radius);
        let chunks = store.seen_chunks(&frame, settings);
        let seen: u64 = chunks.iter().map(|chunk| chunk.points.len() as u64).sum();
        let step = seen.div_ceil(detail.most_points.unwrap_or(u64::MAX).max(1)).max(1) as usize;
        let view = View::new(&frame, settings, step);
        let pieces: Vec<Piece<'_>> = chunks.iter().map(|chunk| Piece::new(chunk, &view)).collect();
        let points_drawn = chunks.iter().map(|chunk| chunk.points.len().div_ceil(step) as u64).sum();
        // All points count, and not those in the view alone, so that a turn of the camera changes nothing.
        let is_few = step == 1 && store.points() <= detail.most_as_discs;
        let largest = settings.splat.max_pixels.max(settings.splat.rest_pixels) / detail.coarseness as f32;
        let splats = if is_few { discs::splats(&pieces, &view, largest) } else { Vec::new() };
        if splats.is_empty() {
            self.levels.begin(size);
            splat::put_all(&pieces, &view, &self.levels);
            self.levels.close_gaps();
        }
        let splatting = began.elapsed().as_secs_f64() * 1e3;
        let began = Instant::now();
        match splats.is_empty() {
            true => self.pixels.look_up(&pieces, &view, &self.levels),
            false => self.pixels.draw(&splats, &view),
        }
        self.pixels.shade(&view, &frame, settings, known, detail.coarseness as f32);
        (self.size, self.drawn) = (size, store.identities().clone());
        let shading = began.elapsed().as_secs_f64() * 1e3;
        let pass = |name, stage, milliseconds| PassTime { name, stage, milliseconds };
        FrameStats {
            passes: vec![
                pass(if splats.is_empty() { "quick_splat" } else { "quick_discs" }, PassStage::Surface, splatting),
                pass("quick_look_up", PassStage::View, shading),
            ],
            frame_milliseconds: splatting + shading,
            splatting_milliseconds: splatting,
            points_drawn,
            points_resident: store.points(),
            gpu_bytes: store.gpu_bytes(),
            clock: Clock::Host,
            has_compiled: false,
            dispatches: 0,
            waits: 0,
            virtual_lights: 0,
            glossy_samples: [0; 2],
            light_rays: [0; 2],
            exposure: self.pixels.exposure,
            glossy_hits: GlossCache::NoGloss,
            glossy_rays: [0; 2],
            methods: Vec::new(),
            reflection: None,
            reflected: None,
            is_quick: true,
            flip: None,
        }
    }

    /// The picture that was drawn last; the next one is drawn elsewhere.
    pub fn take_rows(&mut self) -> PictureRows {
        PictureRows::own(std::mem::take(&mut self.pixels.picture), self.size[0])
    }

    /// The share of the pixels of the last picture that need light and whose light no picture at rest knows.
    pub fn unlit(&self) -> f32 {
        self.pixels.unlit
    }

    /// The point drawn nearest to a pixel of the last picture, at most `radius` pixels from it.
    pub fn pick(&self, store: &PointStore, pixel: [u32; 2], radius: u32) -> Option<Picked> {
        let [across, down] = [0, 1].map(|axis| {
            let last = self.size[axis].saturating_sub(1);
            pixel[axis].saturating_sub(radius)..=(pixel[axis] + radius).min(last)
        });
        let places = down.flat_map(|y| across.clone().map(move |x| [x, y]));
        let key = |[x, y]: [u32; 2]| match self.pixels.keys.get((y * self.size[0] + x) as usize) {
            Some(key) => *key,
            None => self.levels.nearest(x as usize, y as usize),
        };
        // A cell may have a point where its splat does not reach.
        let found = places.map(|place| (place, key(place)));
        let found =
            found.filter(|(place, key)| *key != EMPTY && self.pixels.shows(self.size[0], *place, depth_of(*key)));
        let distance = |[x, y]: [u32; 2]| x.abs_diff(pixel[0]).pow(2) + y.abs_diff(pixel[1]).pow(2);
        let (pixel, key) = found.min_by_key(|(place, _)| distance(*place))?;
        let (cloud, chunk, index) = store.find(identity_of(key), &self.drawn)?;
        Some(Picked { cloud, chunk, index, linear_depth: depth_of(key), pixel })
    }
}
