//! What the window and the thread that draws points send one another.

use std::path::PathBuf;
use std::sync::Arc;

use glam::DVec3;
use render::{Aov, AovImage, FrameStats, Gpu, Picked};
use scene::Camera;
use study::{Choice, CostModel, Drawn, Judged, Target};
use world::{Change, ChunkKey, Resident};

use crate::overlays::Facts;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::under_way::Pass;

/// What a picked point is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PickPurpose {
    /// The coordinates in the status bar, and the point to zoom toward.
    Hover,
    Select,
    Pivot,
    /// The next point of a measurement.
    Corner,
}

pub enum Command {
    /// A change of the points or of how they are shown.
    Change(Change),
    /// All commands for a chunk have been sent. Dropping the pass marks the chunk as received.
    Arrived(Pass),
    Frame(Box<FrameRequest>),
    /// The window has another device from now on, because the one before was lost: its picture is drawn again.
    ShowOn(Arc<Gpu>),
    Pick {
        pixel: [u32; 2],
        purpose: PickPurpose,
    },
    /// Writes a picture as a PNG file. The frame is drawn first unless it is the last one that was drawn.
    Save {
        request: Box<FrameRequest>,
        path: Arc<PathBuf>,
        /// What the overlays that are drawn over it say.
        facts: Box<Facts>,
    },
    /// Hands over a picture and float images of it. The frame is drawn first unless it is the last one that was drawn.
    Read {
        request: Box<FrameRequest>,
        images: Vec<Aov>,
    },
    /// Captures the images that the ray tracer needs to judge a frame; positions are relative to `origin`.
    Capture {
        request: Box<FrameRequest>,
        origin: DVec3,
    },
    /// Lets `auto` choose settings for the view of a frame; first without measuring errors, if it can, where `is_first`
    /// is set.
    Choose {
        request: Box<FrameRequest>,
        target: Target,
        is_first: bool,
        model: Box<CostModel>,
    },
    /// Draws a frame from scratch to measure its times.
    Measure(Box<FrameRequest>),
    /// Judges the frame in the window at some hundred random pixels, which `seed` decides.
    Estimate {
        request: Box<FrameRequest>,
        seed: u64,
    },
    /// Makes a picture of a frame from other colours: linear red, green and blue. `pass` identifies the answer, and
    /// `fits_exposure` has the meaning of the parameter of `Renderer::present`.
    Present {
        request: Box<FrameRequest>,
        colors: Arc<Vec<[f32; 3]>>,
        pass: u32,
        fits_exposure: bool,
    },
}

/// A picture with what a recording keeps of it.
pub struct Picture {
    pub camera: Camera,
    /// The revision of the frame.
    pub revision: u64,
    /// Rows of sRGB red, green, blue and opacity.
    pub rgba: Vec<u8>,
    /// The images that were asked for, in order.
    pub images: Vec<AovImage>,
}

/// The images of a frame.
pub struct Captured {
    pub request: FrameRequest,
    pub drawn: Drawn,
    /// Rows of sRGB red, green, blue and opacity.
    pub picture: Vec<u8>,
}

/// A finished picture.
pub struct Frame {
    pub request: FrameRequest,
    pub stats: FrameStats,
    /// Whether every pixel is of the colour of the background: nothing is in view.
    pub is_blank: bool,
    /// Milliseconds from the start of drawing until the picture is in the window's texture.
    pub total_milliseconds: f64,
    /// The device of the window that has the texture.
    pub window_gpu: Arc<Gpu>,
    /// A texture of the window's device. It stays as it is until the picture after the next is finished.
    pub texture: wgpu::Texture,
}

/// A point of a cloud that was found under a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PickedPoint {
    pub chunk: ChunkKey,
    /// The point's index in its chunk.
    pub index: usize,
}

impl PickedPoint {
    pub fn new(resident: &Resident, picked: Picked) -> Option<Self> {
        let (chunk, index) = resident.origin(picked.chunk, picked.index)?;
        Some(Self { chunk, index })
    }
}

pub enum Report {
    /// The shaders are compiled.
    Ready {
        adapter: String,
    },
    Frame(Box<Frame>),
    Picked {
        pixel: [u32; 2],
        purpose: PickPurpose,
        point: Option<PickedPoint>,
    },
    Saved(PathBuf),
    Read(Box<Picture>),
    Captured(Box<Captured>),
    /// What was chosen; nothing if another command came in between.
    Chosen {
        request: Box<FrameRequest>,
        choice: Box<Result<Option<Choice>, String>>,
        model: Box<CostModel>,
    },
    Measured {
        request: Box<FrameRequest>,
        stats: Box<FrameStats>,
    },
    Presented {
        request: Box<FrameRequest>,
        pass: u32,
        rgba: Vec<u8>,
    },
    /// The answer is `None` if another frame is in the window, or is wanted.
    Estimated {
        request: Box<FrameRequest>,
        answer: Result<Option<Judged>, String>,
    },
    /// Images or pictures that the truth asked for cannot be made.
    NotJudged(String),
    Problem(String),
    /// The latest frame failed; later frames may succeed.
    NotDrawn(String),
    /// Nothing can be drawn any more.
    Lost(String),
}
