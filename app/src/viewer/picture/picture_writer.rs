//! The thread that writes finished pictures into textures of the window's device, while the render thread begins the next
//! frame. Reports pass through it as well, so that the window hears of everything in the order in which it happened.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Instant;

use render::{FrameStats, Gpu, PictureRows};

use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Frame, Report};
use crate::viewer::picture::window_texture::picture_texture;

/// What the render thread hands over.
pub enum Finished {
    Drawn(Box<DrawnFrame>),
    /// Anything else that is reported to the window.
    Told(Report),
}

/// A frame whose picture still lies in a buffer of the renderer's device.
pub struct DrawnFrame {
    pub request: FrameRequest,
    pub stats: FrameStats,
    pub rows: PictureRows,
    /// When drawing began.
    pub started: Instant,
    /// The device that shows the picture.
    pub window_gpu: Arc<Gpu>,
}

/// Starts the thread, which calls `report`. It ends when the sender is dropped. A sender waits until the picture before is
/// written, so the render thread is at most one frame ahead.
///
/// # Errors
/// No thread can be started.
pub fn start(report: impl Fn(Report) + Send + 'static) -> std::io::Result<(SyncSender<Finished>, JoinHandle<()>)> {
    let (sender, finished) = sync_channel(0);
    let work = move || {
        let write = || write_all(&finished, &report);
        // wgpu panics when a driver violates its contract. The window survives to report it.
        if std::panic::catch_unwind(std::panic::AssertUnwindSafe(write)).is_err() {
            report(Report::Lost("the renderer stopped unexpectedly".into()));
        }
    };
    Ok((sender, std::thread::Builder::new().name("pictures".into()).spawn(work)?))
}

fn write_all(finished: &Receiver<Finished>, report: &impl Fn(Report)) {
    let mut textures = Textures::default();
    for finished in finished {
        report(match finished {
            Finished::Drawn(drawn) => match textures.write(*drawn) {
                Ok(frame) => Report::Frame(Box::new(frame)),
                Err(error) => Report::NotDrawn(error.to_string()),
            },
            Finished::Told(told) => told,
        });
    }
}

/// Whether every pixel is of the colour of the background. A picture of something says so within its first rows.
fn is_blank(rows: &PictureRows, width: u32, background: param::Color) -> bool {
    let [red, green, blue, _] = background.bytes();
    let mut rows = rows.bytes().chunks(rows.stride as usize).map(|row| row.get(..width as usize * 4).unwrap_or(row));
    rows.all(|row| row.as_chunks::<4>().0.iter().all(|pixel| pixel[..3] == [red, green, blue]))
}

/// The textures of the picture in the window and of the one before it, which the next one takes: the window may still
/// show the picture before.
#[derive(Default)]
struct Textures {
    shown: Option<(Arc<Gpu>, wgpu::Texture)>,
    free: Option<(Arc<Gpu>, wgpu::Texture)>,
}

impl Textures {
    /// Writes a picture into the texture whose turn it is.
    ///
    /// # Errors
    /// The window's device has no memory for a texture.
    fn write(&mut self, drawn: DrawnFrame) -> render::Result<Frame> {
        let DrawnFrame { request, stats, rows, started, window_gpu } = drawn;
        let [width, height] = request.drawn_size();
        let is_blank = is_blank(&rows, width, request.settings.view.background);
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let texture = match self.free.take() {
            Some((gpu, texture)) if Arc::ptr_eq(&gpu, &window_gpu) && texture.size() == size => texture,
            _ => picture_texture(&window_gpu, size)?,
        };
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(rows.stride), rows_per_image: None };
        window_gpu.queue.write_texture(texture.as_image_copy(), rows.bytes(), layout, size);
        // The bytes are kept until something is submitted, and where nobody paints, as in recordings, nothing else is.
        window_gpu.queue.submit([]);
        self.free = self.shown.replace((window_gpu.clone(), texture.clone()));
        let total_milliseconds = started.elapsed().as_secs_f64() * 1e3;
        Ok(Frame { request, stats, is_blank, total_milliseconds, window_gpu, texture })
    }
}
