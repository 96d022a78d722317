//! What the rays of glossy mirrors meet, kept from frame to frame: new colours, lights and powers then trace only the
//! rays that change. A ray is known by its key, on the GPU (shaders/gloss_normals.wgsl), so that a picture from kept
//! hits is, to the bit, the one that traces them all.

use std::collections::HashMap;

use scene::{Color, Mirror, MirrorSettings, Settings};

use super::gather::Gather;
use super::task::{MirrorSurface, Task};
use crate::frame::FrameCamera;
use crate::gpu::{Gpu, Result};
use crate::identities::CloudId;
use crate::layout::KEPT_WORD_BYTES;
use crate::method;
use crate::passes;
use crate::recorder::Recorder;
use crate::store::PointStore;
use crate::targets::storage;

/// The most bytes of kept hits.
pub(crate) const MOST_KEPT_BYTES: u64 = 512 << 20;

/// The words of a kept hit (shaders/shared/gloss_pixel.wgsl).
const KEPT_WORDS: u64 = 3;

/// Whether what the rays of a frame's glossy mirrors meet is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GlossCache {
    /// Mirrors are perfect.
    NoGloss,
    Kept,
    /// `gloss.cache` is off.
    Off,
    /// The method follows no rays, or keeps no hits of them.
    NoHits,
    /// The scene has glass or water, whose rays are not kept.
    Clear,
    /// The hits would take so many bytes.
    TooLarge(u64),
}

/// All that decides what a ray meets, besides the ray.
#[derive(Clone, PartialEq)]
pub(crate) struct Scenery {
    camera: FrameCamera,
    /// Without those of colours.
    settings: Settings,
    /// `None` if all rays are followed.
    weights: Option<Weights>,
    step: u32,
    geometry_revision: u64,
    /// Without colours and powers.
    mirrors: Vec<Mirror>,
}

/// All that decides how much rays count, and so which are followed.
#[derive(Clone, PartialEq)]
struct Weights {
    laws: MirrorSettings,
    of_mirrors: Vec<f32>,
    of_points: HashMap<CloudId, f32>,
    /// Where mirrors tint: the settings of colours, the revision of the points, and the colours of mirrors.
    tints: Option<(Color, u64, Vec<[f32; 3]>)>,
}

impl Scenery {
    /// `settings` affect what is found, and `laws` how much rays count, if some are not followed; one point in `step` is
    /// drawn for the camera.
    pub fn new(
        camera: FrameCamera,
        (settings, laws): (&Settings, Option<&MirrorSettings>),
        step: u32,
        store: &PointStore,
        mirrors: &[Mirror],
    ) -> Self {
        let colors = || mirrors.iter().map(|mirror| mirror.color).collect();
        let weights = laws.map(|laws| Weights {
            laws: laws.clone(),
            of_mirrors: mirrors.iter().map(|mirror| mirror.specular_intensity).collect(),
            of_points: store.intensities(),
            tints: (laws.tint > 0.0).then(|| (settings.color.clone(), store.revision(), colors())),
        });
        let settings = Settings { color: Default::default(), ..settings.clone() };
        let bare = |mirror: &Mirror| Mirror {
            name: String::new(),
            color: [0.0; 3],
            specular_intensity: if mirror.specular_intensity > 0.0 { 1.0 } else { 0.0 },
            specular_power: 0.0,
            ..mirror.clone()
        };
        let mirrors = mirrors.iter().map(bare).collect();
        Self { camera, settings, weights, step, geometry_revision: store.geometry_revision(), mirrors }
    }
}

/// Hits for one scenery.
struct Hits {
    scenery: Scenery,
    /// For each set of rays its bounces.
    sets: Vec<Vec<wgpu::Buffer>>,
    /// The counters of the search for the rays of perfect mirrors, once all of them are known.
    counters: Option<wgpu::Buffer>,
}

/// The kept hits. A scenery of which a frame draws only one sample, as pictures while something moves do, does not
/// drive out that of the picture before.
#[derive(Default)]
pub(crate) struct KeptHits {
    known: Option<Hits>,
    begun: Option<Hits>,
    /// Whether the frame's hits are those of `begun`.
    takes_begun: bool,
    /// The counters of the frame's search for perfect mirrors; they count once the frame has ended.
    found_counters: Option<wgpu::Buffer>,
}

/// The bytes of the hits of all samples and of perfect mirrors.
fn bytes_of(samples: u32, bounces: usize, places: u64) -> u64 {
    (u64::from(samples) + 1) * bounces as u64 * places * KEPT_WORDS * KEPT_WORD_BYTES
}

impl KeptHits {
    /// Whether hits can be kept; `places` is the number of pixels in the tiles where mirrors may be.
    pub fn can(settings: &Settings, samples: u32, places: u64, has_clear: bool, gpu: &Gpu) -> GlossCache {
        let bytes = bytes_of(samples, settings.reflection.bounces as usize, places);
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        let fits = bytes <= MOST_KEPT_BYTES && places * KEPT_WORDS * KEPT_WORD_BYTES <= limit;
        match samples {
            0 => GlossCache::NoGloss,
            _ if !settings.gloss.cache => GlossCache::Off,
            _ if !method::follows_rays(settings) => GlossCache::NoHits,
            _ if has_clear => GlossCache::Clear,
            _ if !fits => GlossCache::TooLarge(bytes),
            _ => GlossCache::Kept,
        }
    }

    /// Begins a frame, whose rays are those of this scenery.
    pub fn begin(&mut self, scenery: Scenery) {
        self.found_counters = None;
        let is_of = |hits: &Option<Hits>| hits.as_ref().is_some_and(|hits| hits.scenery == scenery);
        self.takes_begun = !is_of(&self.known);
        if self.takes_begun && !is_of(&self.begun) {
            self.begun = Some(Hits { scenery, sets: Vec::new(), counters: None });
        }
    }

    /// Ends a frame: what was traced for perfect mirrors is known from now on.
    pub fn end(&mut self) {
        if let Some(counters) = self.found_counters.take()
            && let Some(hits) = &mut self.known
        {
            hits.counters = Some(counters);
        }
    }

    pub fn forget(&mut self) {
        *self = Self::default();
    }

    pub fn bytes(&self) -> u64 {
        let buffers = [&self.known, &self.begun].into_iter().flatten().flat_map(|hits| hits.sets.iter().flatten());
        buffers.map(wgpu::Buffer::size).sum()
    }

    /// Begins a set of rays of the frame. The second one decides that the frame's hits are worth keeping.
    pub fn take_up(&mut self, set: u32) {
        if self.takes_begun && set > 0 {
            self.known = self.begun.take();
            self.takes_begun = false;
        }
    }

    /// The kept hits of a set of rays for a bounce; empty at first.
    pub fn of_bounce(&mut self, gpu: &Gpu, set: u32, bounce: usize, places: u64) -> Option<&wgpu::Buffer> {
        let hits = if self.takes_begun { self.begun.as_mut()? } else { self.known.as_mut()? };
        let set = set as usize;
        while hits.sets.len() <= set {
            hits.sets.push(Vec::new());
        }
        while hits.sets[set].len() <= bounce {
            hits.sets[set].push(storage(&gpu.device, "kept hits", places * KEPT_WORDS * KEPT_WORD_BYTES));
        }
        Some(&hits.sets[set][bounce])
    }

    /// Keeps the counters of the search for perfect mirrors.
    pub fn keep_counters(&mut self, recorder: &mut Recorder<'_>, counters: &wgpu::Buffer, bytes: std::ops::Range<u64>) {
        let copy = storage(&recorder.gpu.device, "kept counters", bytes.end);
        recorder.copy_part(counters, &copy, bytes);
        self.found_counters = Some(copy);
    }

    /// Whether all rays of perfect mirrors are known, with the counters of their search.
    pub fn known_counters(&self) -> Option<&wgpu::Buffer> {
        self.known.as_ref().filter(|_| !self.takes_begun)?.counters.as_ref()
    }
}

/// What is known of a bounce's rays.
pub(crate) struct KnownRays<'a> {
    pub kept: &'a wgpu::Buffer,
    /// What the passes of glossy mirrors note for each pixel.
    pub pixels: &'a wgpu::Buffer,
    /// The rays of which it is not known what they meet, if some are known.
    pub unknown: Option<&'a MirrorSurface>,
    /// Whether all rays are known.
    pub all: bool,
}

impl KnownRays<'_> {
    /// Keeps the hits of the rays that were traced, and adds those of the rays that are known.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn exchange(&self, recorder: &mut Recorder<'_>, gather: &Gather, task: &Task<'_>) -> Result<()> {
        let bindings = passes::gloss_keep {
            point_in: task.mirror.point.bind(),
            pixels: self.pixels.as_entire_binding(),
            kept: self.kept.as_entire_binding(),
            hits: gather.hits.as_entire_binding(),
            counters: task.counters.as_entire_binding(),
        };
        let known = if self.all { ALL_KNOWN } else { u32::from(self.unknown.is_none()) * NONE_KNOWN };
        recorder.over_mirrors(&[("known", known)], task.supply, bindings)
    }
}

/// The choices of the pass `gloss_keep`; by default the pixels decide.
const NONE_KNOWN: u32 = 1;
const ALL_KNOWN: u32 = 2;
