//! The thread that draws the points, so that the window never waits for them.
//!
//! It owns the renderer and the points on the GPU, on a device of its own: waiting for a device holds a lock that presenting
//! on the same device needs, and a frame too long for the driver's watchdog then takes the pictures with it, not the window.
//! Commands come in order; of frames that wait only the latest is drawn. A finished picture is written into a texture of the
//! window's device, whose queue shows it from the window's next frame on, whole or not at all.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use cloud::{Bounds, Chunk, Cloud};
use glam::DVec3;
use render::{ChunkId, CloudId, ColorPlan, ColorSource, FrameStats, Gpu, Material, Objects, PointStore, Renderer};
use scene::{Camera, Mirror, MirrorSurface, Quality, Settings, SpotLight};
use study::Drawn;
use world::mirrors::{self, Marked};

use super::under_way::Pass;
use crate::picture_file;

/// A cloud, the same in the window, here and in events. Never used twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CloudKey(pub u32);

/// A picture to draw.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRequest {
    pub camera: Camera,
    pub settings: Settings,
    pub mirrors: Vec<Mirror>,
    pub lights: Vec<SpotLight>,
    pub sky_is_open: bool,
    /// Pixels.
    pub size: [u32; 2],
    /// Counts changes of the points and their colours.
    pub revision: u64,
    /// Drawn fast because the camera moves; a better one follows.
    pub hurried: bool,
    /// Indirect light may be that of the points before: they come and go.
    pub light_may_lag: bool,
}

/// What a picked point is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PickPurpose {
    /// Coordinates in the status bar, and the point that zooming goes to.
    Hover,
    Select,
    Pivot,
}

pub enum Command {
    AddCloud {
        key: CloudKey,
        provisional_radius: f32,
    },
    /// So many points will be there at once, of all clouds together, whatever was expected before.
    Expect {
        points: u64,
    },
    /// All of a cloud lies in these bounds.
    SetBounds {
        key: CloudKey,
        bounds: Bounds,
    },
    /// Adds the chunk, or replaces the one with the same `first_point`. `classes` is the column of that index.
    Chunk {
        key: CloudKey,
        chunk: Chunk,
        classes: Option<usize>,
    },
    /// The commands of a chunk that was under way have been sent.
    Arrived(Pass),
    /// Takes the chunk with this `first_point` out. One that is not there is none.
    RemoveChunk {
        key: CloudKey,
        first_point: u64,
    },
    /// Shows chunks, by `first_point`, in one colour each or again in their own.
    Tint {
        key: CloudKey,
        tints: Vec<(u64, Option<[u8; 4]>)>,
    },
    /// `cloud` has the column that the plan shows.
    Color {
        key: CloudKey,
        cloud: Cloud,
        plan: ColorPlan,
        up: DVec3,
    },
    SetVisible {
        key: CloudKey,
        visible: bool,
    },
    SetVisibleClasses {
        key: CloudKey,
        visible: Box<[bool; 256]>,
    },
    Remove {
        key: CloudKey,
    },
    /// Points that stand for a mirror, in place of those that did under the same key.
    Mirror {
        key: CloudKey,
        mirror: Mirror,
        samples: Vec<Chunk>,
    },
    /// Which points of a cloud reflect, by lists for these chunks; they are clouds of their own on the GPU.
    Mark {
        key: CloudKey,
        cloud: Cloud,
        classes: Option<usize>,
        marked: Arc<Vec<Marked>>,
    },
    Frame(Box<FrameRequest>),
    Pick {
        pixel: [u32; 2],
        purpose: PickPurpose,
    },
    /// Draws once more and writes a PNG file.
    Save {
        request: Box<FrameRequest>,
        path: PathBuf,
    },
    /// Hands over what the ray tracer judges a frame by, positions from `origin`.
    Capture {
        request: Box<FrameRequest>,
        origin: DVec3,
    },
    /// Draws a frame from scratch, for its times.
    Measure(Box<FrameRequest>),
    /// Makes a frame's picture of other colours: linear red, green and blue. `pass` tells the answers apart.
    Present {
        request: Box<FrameRequest>,
        colors: Arc<Vec<[f32; 3]>>,
        pass: u32,
    },
}

/// A frame's images.
pub struct Captured {
    pub request: FrameRequest,
    pub drawn: Drawn,
    /// Rows of sRGB red, green, blue and opacity.
    pub picture: Vec<u8>,
}

/// A picture that is ready to be shown.
pub struct Frame {
    pub request: FrameRequest,
    pub stats: FrameStats,
    /// Milliseconds from the request's turn to the picture in the window's texture.
    pub total_milliseconds: f64,
    /// Of the window's device. The same texture as long as the size stays.
    pub texture: wgpu::Texture,
}

/// A point of the file, found under a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PickedPoint {
    pub key: CloudKey,
    /// Index in the file.
    pub point: u64,
}

pub enum Report {
    /// Shaders are compiled.
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
    Captured(Box<Captured>),
    Measured {
        request: Box<FrameRequest>,
        stats: FrameStats,
    },
    Presented {
        request: Box<FrameRequest>,
        pass: u32,
        rgba: Vec<u8>,
    },
    /// What was asked for the truth cannot be had.
    NotJudged(String),
    Problem(String),
    /// The latest frame failed; others may follow.
    NotDrawn(String),
    /// Nothing can be drawn any more.
    Lost(String),
}

/// The window's end. Dropping it ends the thread after the frame it is at.
pub struct RenderThread {
    commands: Sender<Command>,
}

/// Pixels around the cursor in which a point counts as meant: a fingertip's precision with a mouse.
const PICK_RADIUS: u32 = 6;
/// Longest time that points are uploaded before a waiting frame gets its turn.
const UPLOAD_SLICE: Duration = Duration::from_millis(50);

impl RenderThread {
    /// `window_gpu` is the device that shows the pictures; `wanted` as in `Gpu::headless`. `report` is called from the thread.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn start(
        window_gpu: Arc<Gpu>,
        wanted: Option<String>,
        report: impl Fn(Report) + Send + 'static,
    ) -> std::io::Result<Self> {
        let (commands, receiver) = channel();
        let work = move || {
            let draw = || match Worker::new(window_gpu, wanted.as_deref()) {
                Ok(mut worker) => {
                    report(Report::Ready { adapter: worker.gpu.info.name.clone() });
                    worker.run(&receiver, &report);
                }
                Err(error) => report(Report::Lost(error.to_string())),
            };
            // wgpu panics where a driver breaks its word; the window lives to say so.
            if std::panic::catch_unwind(std::panic::AssertUnwindSafe(draw)).is_err() {
                report(Report::Lost("the renderer stopped unexpectedly".into()));
            }
        };
        std::thread::Builder::new().name("render".into()).spawn(work)?;
        Ok(Self { commands })
    }

    pub fn send(&self, command: Command) {
        // A thread that has ended has reported why.
        let _ = self.commands.send(command);
    }
}

struct Resident {
    id: CloudId,
    /// By `first_point`.
    chunks: HashMap<u64, ChunkId>,
    /// Points of it that reflect.
    reflecting: Vec<Reflecting>,
    /// How it is drawn, which those share.
    color: Option<(ColorPlan, DVec3)>,
    is_visible: bool,
    visible_classes: Option<Box<[bool; 256]>>,
}

/// Points of a cloud that reflect, as a cloud of the store.
struct Reflecting {
    id: CloudId,
    /// By `first_point` of the chunks they were taken from, with their indices in them.
    chunks: HashMap<u64, (ChunkId, Vec<u32>)>,
}

impl Resident {
    fn new(id: CloudId) -> Self {
        let chunks = HashMap::new();
        Self { id, chunks, reflecting: Vec::new(), color: None, is_visible: true, visible_classes: None }
    }

    fn ids(&self) -> impl Iterator<Item = CloudId> {
        std::iter::once(self.id).chain(self.reflecting.iter().map(|reflecting| reflecting.id))
    }
}

/// What of `cloud` is in the store, and as what: chunks that the store refused are left out.
fn stored(cloud: &Cloud, chunks: &HashMap<u64, ChunkId>) -> (Cloud, Vec<ChunkId>) {
    let known = cloud.chunks.iter().filter_map(|chunk| Some((chunk.clone(), *chunks.get(&chunk.first_point)?)));
    let (chunks, ids) = known.unzip();
    (Cloud { chunks, ..cloud.clone() }, ids)
}

impl Reflecting {
    fn stored(&self, cloud: &Cloud) -> (Cloud, Vec<ChunkId>) {
        let known = cloud.chunks.iter().filter_map(|chunk| {
            let (id, indices) = self.chunks.get(&chunk.first_point)?;
            Some((chunk.select(indices), *id))
        });
        let (chunks, ids) = known.unzip();
        (Cloud { chunks, ..cloud.clone() }, ids)
    }
}

/// The classes of a chunk whose column `index` they are.
fn classes_of(chunk: &Chunk, index: Option<usize>) -> Option<&[u8]> {
    match chunk.columns.get(index?)?.as_deref()? {
        cloud::Column::U8(classes) => Some(classes.as_slice()),
        _ => None,
    }
}

struct Worker {
    gpu: Arc<Gpu>,
    window_gpu: Arc<Gpu>,
    renderer: Renderer,
    store: PointStore,
    clouds: HashMap<CloudKey, Resident>,
    /// Where the points of a chunk come from: their indices in the file follow one another, or are these after the first.
    first_points: HashMap<ChunkId, (CloudKey, u64, Option<Vec<u32>>)>,
    shown: Option<wgpu::Texture>,
    /// The frame that the renderer holds, and whether its picture is of its own colours.
    held: Option<(FrameRequest, bool)>,
    /// The frame in the window: what is picked from.
    on_screen: Option<FrameRequest>,
    /// The store refused points: said once, not for each chunk.
    is_full: bool,
}

impl Worker {
    fn new(window_gpu: Arc<Gpu>, wanted: Option<&str>) -> render::Result<Self> {
        // The window's adapter, unless another is asked for: the one that presents is the one with the screen.
        let name = window_gpu.info.name.clone();
        let gpu = Gpu::headless(Some(wanted.unwrap_or(&name)))?;
        Ok(Self {
            renderer: Renderer::new(gpu.clone())?,
            store: PointStore::new(gpu.clone()),
            gpu,
            window_gpu,
            clouds: HashMap::new(),
            first_points: HashMap::new(),
            shown: None,
            held: None,
            on_screen: None,
            is_full: false,
        })
    }

    fn run(&mut self, commands: &Receiver<Command>, report: &impl Fn(Report)) {
        while let Ok(first) = commands.recv() {
            let mut frame = None;
            let mut next = Some(first);
            let started = Instant::now();
            while let Some(command) = next {
                let result = match command {
                    Command::Frame(request) => {
                        frame = Some(request);
                        Ok(())
                    }
                    other => self.obey(other, report),
                };
                if let Err(error) = result {
                    if is_fatal(&error) {
                        return report(Report::Lost(error.to_string()));
                    }
                    report(Report::Problem(error.to_string()));
                }
                if frame.is_some() && started.elapsed() > UPLOAD_SLICE {
                    break;
                }
                next = commands.try_recv().ok();
            }
            if let Some(request) = frame {
                match self.draw(*request) {
                    Ok(frame) => report(Report::Frame(Box::new(frame))),
                    Err(error) if is_fatal(&error) => return report(Report::Lost(error.to_string())),
                    Err(error) => report(Report::NotDrawn(error.to_string())),
                }
            }
        }
    }

    fn obey(&mut self, command: Command, report: &impl Fn(Report)) -> render::Result<()> {
        match command {
            Command::AddCloud { key, provisional_radius } => {
                let id = self.store.add_cloud(Material::default());
                self.store.set_provisional_radius(id, provisional_radius);
                self.clouds.insert(key, Resident::new(id));
            }
            Command::Expect { points } => self.store.reserve(points),
            Command::SetBounds { key, bounds } => {
                if let Some(resident) = self.clouds.get(&key) {
                    self.store.set_bounds(resident.id, bounds);
                }
            }
            Command::Chunk { key, chunk, classes } => return self.put(key, chunk, classes),
            Command::RemoveChunk { key, first_point } => {
                if let Some(id) = self.clouds.get_mut(&key).and_then(|resident| resident.chunks.remove(&first_point)) {
                    self.store.remove_chunk(id);
                    self.first_points.remove(&id);
                    self.is_full = false;
                }
            }
            Command::Tint { key, tints } => {
                if let Some(resident) = self.clouds.get(&key) {
                    let known = tints.iter().filter_map(|(first, tint)| Some((*resident.chunks.get(first)?, *tint)));
                    known.for_each(|(id, tint)| self.store.set_tint(id, tint));
                }
            }
            Command::Color { key, cloud, plan, up } => {
                if let Some(resident) = self.clouds.get_mut(&key) {
                    let (known, ids) = stored(&cloud, &resident.chunks);
                    self.store.set_color(resident.id, &known, &ids, &plan, up)?;
                    for reflecting in &resident.reflecting {
                        let (known, ids) = reflecting.stored(&cloud);
                        self.store.set_color(reflecting.id, &known, &ids, &plan, up)?;
                    }
                    resident.color = Some((plan, up));
                }
            }
            Command::SetVisible { key, visible } => {
                if let Some(resident) = self.clouds.get_mut(&key) {
                    resident.is_visible = visible;
                    resident.ids().for_each(|id| self.store.set_visible(id, visible));
                }
            }
            Command::SetVisibleClasses { key, visible } => {
                if let Some(resident) = self.clouds.get_mut(&key) {
                    resident.ids().for_each(|id| self.store.set_visible_classes(id, &visible));
                    resident.visible_classes = Some(visible);
                }
            }
            Command::Remove { key } => self.remove(key),
            Command::Mark { key, cloud, classes, marked } => return self.mark(key, &cloud, classes, &marked),
            Command::Mirror { key, mirror, samples } => {
                self.remove(key);
                let (id, ids) = mirrors::upload(&mut self.store, &mirror, &samples)?;
                let chunks: HashMap<u64, ChunkId> = samples.iter().map(|chunk| chunk.first_point).zip(ids).collect();
                self.first_points.extend(chunks.iter().map(|(first_point, id)| (*id, (key, *first_point, None))));
                self.clouds.insert(key, Resident { chunks, ..Resident::new(id) });
            }
            Command::Pick { pixel, purpose } => {
                if let Some(request) = self.on_screen.clone() {
                    self.hold(&request, false)?;
                }
                let picked = self.renderer.pick(&self.store, pixel, PICK_RADIUS)?;
                let point = picked.and_then(|picked| {
                    let (key, first_point, indices) = self.first_points.get(&picked.chunk)?;
                    let index = indices.as_ref().map_or(picked.index as u64, |indices| indices[picked.index].into());
                    Some(PickedPoint { key: *key, point: first_point + index })
                });
                report(Report::Picked { pixel, purpose, point });
            }
            Command::Save { request, path } => {
                self.render(&request)?;
                let pixels = self.renderer.read_picture()?;
                report(match picture_file::write_png(&path, request.size, &pixels) {
                    Ok(()) => Report::Saved(path),
                    Err(error) => Report::Problem(format!("{error:#}")),
                });
            }
            Command::Capture { .. } | Command::Measure(_) | Command::Present { .. } => {
                match self.judge(command, report) {
                    Err(error) if !is_fatal(&error) => report(Report::NotJudged(error.to_string())),
                    result => return result,
                }
            }
            Command::Arrived(pass) => drop(pass),
            Command::Frame(_) => {}
        }
        Ok(())
    }

    /// What the truth asks for.
    fn judge(&mut self, command: Command, report: &impl Fn(Report)) -> render::Result<()> {
        match command {
            Command::Capture { request, origin } => {
                self.hold(&request, true)?;
                let drawn = Drawn::read(&self.renderer, &request.settings, origin)?;
                let picture = self.renderer.read_picture()?;
                report(Report::Captured(Box::new(Captured { request: *request, drawn, picture })));
            }
            Command::Measure(request) => {
                self.renderer.forget();
                let stats = self.render(&request)?;
                report(Report::Measured { request, stats });
            }
            Command::Present { request, colors, pass } => {
                self.hold(&request, false)?;
                self.renderer.present(&self.store, &request.settings, &colors)?;
                self.held = self.held.take().map(|(request, _)| (request, false));
                let rgba = self.renderer.read_picture()?;
                report(Report::Presented { request, pass, rgba });
            }
            _ => {}
        }
        Ok(())
    }

    /// Draws a frame unless the renderer holds it; `with_picture`: and its picture.
    fn hold(&mut self, request: &FrameRequest, with_picture: bool) -> render::Result<()> {
        let is_held = |(held, has_picture): &(FrameRequest, bool)| held == request && (*has_picture || !with_picture);
        if !self.held.as_ref().is_some_and(is_held) {
            self.render(request)?;
        }
        Ok(())
    }

    fn remove(&mut self, key: CloudKey) {
        if let Some(resident) = self.clouds.remove(&key) {
            resident.ids().for_each(|id| self.store.remove_cloud(id));
            self.first_points.retain(|_, (owner, ..)| *owner != key);
            self.is_full = false;
        }
    }

    fn render(&mut self, request: &FrameRequest) -> render::Result<FrameStats> {
        let FrameRequest { mirrors, lights, sky_is_open, .. } = request;
        let objects = Objects { mirrors, lights, sky_is_open: *sky_is_open };
        self.held = None;
        self.renderer.let_light_lag(request.light_may_lag);
        let stats = self.renderer.render(&self.store, &request.camera, &request.settings, objects, request.size)?;
        self.held = Some((request.clone(), true));
        Ok(stats)
    }

    /// Takes the points that reflect out of a cloud and makes clouds of them, after putting back those that did before.
    fn mark(&mut self, key: CloudKey, cloud: &Cloud, classes: Option<usize>, marked: &[Marked]) -> render::Result<()> {
        let Some(resident) = self.clouds.get_mut(&key) else { return Ok(()) };
        for before in resident.reflecting.drain(..) {
            self.store.remove_cloud(before.id);
            before.chunks.values().for_each(|(id, _)| drop(self.first_points.remove(id)));
        }
        for marked in marked {
            let id = self.store.add_cloud(marked.material);
            resident.reflecting.push(Reflecting { id, chunks: HashMap::new() });
        }
        for (index, chunk) in cloud.chunks.iter().enumerate() {
            let Some(id) = resident.chunks.get(&chunk.first_point) else { continue };
            let parted = mirrors::part(chunk, index, marked);
            self.store.update_chunk(*id, &parted.rest, classes_of(chunk, classes))?;
            for (reflecting, (taken, indices)) in resident.reflecting.iter_mut().zip(parted.reflecting) {
                if taken.is_empty() {
                    continue;
                }
                let id = self.store.add_chunk(reflecting.id, &taken, classes_of(&taken, classes))?;
                self.first_points.insert(id, (key, chunk.first_point, Some(indices.clone())));
                reflecting.chunks.insert(chunk.first_point, (id, indices));
            }
        }
        for reflecting in &resident.reflecting {
            self.store.set_visible(reflecting.id, resident.is_visible);
            if let Some(visible) = &resident.visible_classes {
                self.store.set_visible_classes(reflecting.id, visible);
            }
            if let Some((plan, up)) = &resident.color {
                let (known, ids) = reflecting.stored(cloud);
                self.store.set_color(reflecting.id, &known, &ids, plan, *up)?;
            }
        }
        Ok(())
    }

    fn put(&mut self, key: CloudKey, chunk: Chunk, classes: Option<usize>) -> render::Result<()> {
        let Some(resident) = self.clouds.get_mut(&key) else { return Ok(()) };
        let classes = classes_of(&chunk, classes);
        let id = match resident.chunks.get(&chunk.first_point) {
            Some(&id) => {
                let result = self.store.update_chunk(id, &chunk, classes);
                if let Err(error) = result {
                    // Nothing is left of it, or what is left is not what is wanted.
                    self.store.remove_chunk(id);
                    resident.chunks.remove(&chunk.first_point);
                    self.first_points.remove(&id);
                    return Err(error);
                }
                id
            }
            None if self.is_full => return Ok(()),
            None => {
                let added = self.store.add_chunk(resident.id, &chunk, classes);
                let id = added.inspect_err(|_| self.is_full = true)?;
                resident.chunks.insert(chunk.first_point, id);
                self.first_points.insert(id, (key, chunk.first_point, None));
                id
            }
        };
        // What comes late is coloured as the cloud is, at once.
        let Some((plan, up)) =
            resident.color.as_ref().filter(|(plan, _)| matches!(plan.source, ColorSource::Column(_)))
        else {
            return Ok(());
        };
        let cloud = Cloud { chunks: vec![chunk], ..Cloud::default() };
        self.store.set_color(resident.id, &cloud, &[id], plan, *up)
    }

    fn draw(&mut self, request: FrameRequest) -> render::Result<Frame> {
        let started = Instant::now();
        let stats = self.render(&request)?;
        tracing::debug!(hurried = request.hurried, points = stats.points_drawn, passes = ?stats.passes, "frame");
        let pixels = self.renderer.read_picture()?;
        let [width, height] = request.size;
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let texture = match self.shown.take() {
            Some(texture) if texture.size() == size => texture,
            _ => self.window_gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("picture in the window"),
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rgba8Unorm,
                usage: wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            }),
        };
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None };
        self.window_gpu.queue.write_texture(texture.as_image_copy(), &pixels, layout, size);
        self.shown = Some(texture.clone());
        self.on_screen = Some(request.clone());
        Ok(Frame { request, stats, total_milliseconds: started.elapsed().as_secs_f64() * 1e3, texture })
    }
}

/// Whether no further frame can be expected after this error.
fn is_fatal(error: &render::Error) -> bool {
    matches!(error, render::Error::Lost(_))
}

impl FrameRequest {
    /// The same picture with nothing spared.
    pub fn unhurried(&self, settings: &Settings) -> Self {
        Self { settings: settings.clone(), hurried: false, light_may_lag: false, ..self.clone() }
    }
}

/// The settings for a frame while the camera or a mirror moves and better ones take too long: one point a pixel, and mirrors
/// that show no further mirrors. A mirror that is dragged is drawn by its formula: its points come later.
pub fn hurried(settings: &Settings, a_mirror_is_dragged: bool) -> Settings {
    let mut hurried = settings.clone();
    hurried.splat.quality = Quality::Nearest;
    hurried.reflection.bounces = settings.reflection.bounces.min(1);
    if a_mirror_is_dragged {
        hurried.mirror.surface = MirrorSurface::Exact;
    }
    hurried
}

#[cfg(test)]
#[path = "render_thread_tests.rs"]
mod tests;
