//! What the window shows, kept in a texture from paint to paint, so that each paint draws only what has changed. On
//! software Vulkan the pixels are nearly all that a paint costs: egui's shader takes some 40 ns for each.

use std::sync::Arc;

use egui::epaint::{ClippedPrimitive, ClippedShape};
use egui::{PaintCallback, Rect, Shape};
use egui_wgpu::{CallbackResources, CallbackTrait, RendererOptions, ScreenDescriptor};
use render::Gpu;

use crate::viewer::picture::window_texture::window_texture;

/// A picture for the interface. It takes the whole of its texture, stretched to the rectangle that shows it.
#[derive(Clone)]
pub struct Picture(Arc<dyn std::any::Any + Send + Sync>);

impl Picture {
    /// The shape that shows the picture.
    pub fn within(&self, rect: Rect) -> Shape {
        Shape::Callback(PaintCallback { rect, callback: self.0.clone() })
    }
}

/// Draws a picture over egui's viewport.
struct PicturePass {
    pipeline: wgpu::RenderPipeline,
    bindings: wgpu::BindGroup,
}

impl CallbackTrait for PicturePass {
    fn paint(&self, _: egui::PaintCallbackInfo, pass: &mut wgpu::RenderPass<'static>, _: &CallbackResources) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bindings, &[]);
        pass.draw(0..3, 0..1);
    }
}

pub struct Canvas {
    gpu: Arc<Gpu>,
    painter: egui_wgpu::Renderer,
    texture: wgpu::Texture,
    /// The shapes on the texture, and the pixels of a point.
    shapes: Vec<ClippedShape>,
    pixels_per_point: f32,
    /// True if all of the texture must be drawn, whatever the shapes are.
    is_stale: bool,
    picture_pipeline: wgpu::RenderPipeline,
    black_pipeline: wgpu::RenderPipeline,
    sampler: wgpu::Sampler,
}

impl Canvas {
    /// `format` is that of the surface on which the canvas is shown.
    ///
    /// # Errors
    /// There is no memory for a canvas of this size.
    pub fn new(gpu: Arc<Gpu>, format: wgpu::TextureFormat, size: [u32; 2]) -> render::Result<Self> {
        // Noise against banding costs as much as the rest of the shader, and would change the picture's colours.
        let options = RendererOptions { dithering: false, ..RendererOptions::default() };
        let painter = egui_wgpu::Renderer::new(&gpu.device, format, options);
        let pipeline = |fragment| {
            let module = gpu.device.create_shader_module(wgpu::include_wgsl!("canvas.wgsl"));
            gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(fragment),
                layout: None,
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("corner"),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                primitive: Default::default(),
                depth_stencil: None,
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(fragment),
                    compilation_options: Default::default(),
                    targets: &[Some(format.into())],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("stretched"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let texture = texture(&gpu, format, size)?;
        Ok(Self {
            painter,
            texture,
            shapes: Vec::new(),
            pixels_per_point: 1.0,
            is_stale: true,
            picture_pipeline: pipeline("show_picture"),
            black_pipeline: pipeline("show_black"),
            sampler,
            gpu,
        })
    }

    /// Takes another size; all is then drawn anew.
    ///
    /// # Errors
    /// There is no memory for a canvas of this size: it stays as it is.
    pub fn resize(&mut self, size: [u32; 2]) -> render::Result<()> {
        if self.size() != size {
            self.texture = texture(&self.gpu, self.texture.format(), size)?;
            self.is_stale = true;
        }
        Ok(())
    }

    /// Reads what the window shows: its size, and rows of red, green, blue and opacity. `None` if the device is lost.
    pub fn pixels(&self) -> Option<([u32; 2], Vec<u8>)> {
        let [width, height] = self.size();
        let stride = (width * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("pixels of the window"),
            size: u64::from(stride) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride), rows_per_image: None };
        let mut encoder = device.create_command_encoder(&Default::default());
        let target = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(self.texture.as_image_copy(), target, self.texture.size());
        queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| {});
        device.poll(wgpu::PollType::wait_indefinitely()).ok()?;
        let mapped = buffer.get_mapped_range(..).ok()?;
        let mut rgba: Vec<u8> =
            mapped.chunks_exact(stride as usize).flat_map(|row| &row[..width as usize * 4]).copied().collect();
        if self.texture.format() == wgpu::TextureFormat::Bgra8Unorm {
            rgba.chunks_exact_mut(4).for_each(|pixel| pixel.swap(0, 2));
        }
        Some(([width, height], rgba))
    }

    /// The size in pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.texture.width(), self.texture.height()]
    }

    /// Returns a picture for the interface. A new content of the same texture needs a new picture, or it is not drawn.
    pub fn picture(&self, texture: &wgpu::Texture) -> Picture {
        let pass = PicturePass { pipeline: self.picture_pipeline.clone(), bindings: self.bindings(texture) };
        Picture(egui_wgpu::Callback::new_paint_callback(Rect::ZERO, pass).callback)
    }

    fn bindings(&self, texture: &wgpu::Texture) -> wgpu::BindGroup {
        let view = texture.create_view(&Default::default());
        let resources = [wgpu::BindingResource::TextureView(&view), wgpu::BindingResource::Sampler(&self.sampler)];
        let entries =
            [0, 1].map(|binding| wgpu::BindGroupEntry { binding, resource: resources[binding as usize].clone() });
        self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("picture"),
            layout: &self.picture_pipeline.get_bind_group_layout(0),
            entries: &entries,
        })
    }

    /// Takes egui's changes of its textures; `free` must be called after the paint.
    pub fn update_textures(&mut self, changes: &mut egui::TexturesDelta) {
        for (id, deltas) in std::mem::take(&mut changes.set) {
            for delta in deltas {
                self.painter.update_texture(&self.gpu.device, &self.gpu.queue, id, &delta);
            }
            self.is_stale = true;
        }
    }

    pub fn free(&mut self, textures: impl IntoIterator<Item = egui::TextureId>) {
        textures.into_iter().for_each(|id| self.painter.free_texture(&id));
    }

    /// Whether `paint` would change the canvas.
    pub fn would_change(&self, shapes: &[ClippedShape], pixels_per_point: f32) -> bool {
        self.is_stale || self.pixels_per_point != pixels_per_point || self.shapes != shapes
    }

    /// Draws shapes, and copies the result to a texture of the same format, from the upper left corner on where their sizes
    /// differ. Returns the commands to submit, in order.
    pub fn paint(
        &mut self,
        context: &egui::Context,
        shapes: Vec<ClippedShape>,
        pixels_per_point: f32,
        frame: &wgpu::Texture,
    ) -> Vec<wgpu::CommandBuffer> {
        let size = self.size();
        let is_whole = self.is_stale || self.pixels_per_point != pixels_per_point;
        let changed = if is_whole {
            vec![[0, 0, size[0], size[1]]]
        } else {
            let rects = changed(&self.shapes, &shapes);
            merged(rects.into_iter().map(|rect| pixels(rect, pixels_per_point, size)))
        };
        (self.is_stale, self.pixels_per_point, self.shapes) = (false, pixels_per_point, shapes.clone());
        let jobs = context.tessellate(shapes, pixels_per_point);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let mut commands = if changed.is_empty() {
            Vec::new()
        } else {
            self.draw(&mut encoder, jobs, &changed, ScreenDescriptor { size_in_pixels: size, pixels_per_point })
        };
        self.copy(&mut encoder, frame);
        commands.push(encoder.finish());
        commands
    }

    /// Draws the parts of the texture within `changed` anew.
    fn draw(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        mut jobs: Vec<ClippedPrimitive>,
        changed: &[[u32; 4]],
        screen: ScreenDescriptor,
    ) -> Vec<wgpu::CommandBuffer> {
        let Self { gpu, painter, .. } = self;
        let commands = painter.update_buffers(&gpu.device, &gpu.queue, encoder, &jobs, &screen);
        let mut pass = render_pass(encoder, &self.texture, wgpu::LoadOp::Load);
        let clips: Vec<Rect> = jobs.iter().map(|job| job.clip_rect).collect();
        let [width, height] = screen.size_in_pixels;
        for &[left, top, right, bottom] in changed {
            pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
            pass.set_scissor_rect(left, top, right - left, bottom - top);
            pass.set_pipeline(&self.black_pipeline);
            pass.draw(0..3, 0..1);
            let corner = |x: u32, y: u32| egui::pos2(x as f32, y as f32) / screen.pixels_per_point;
            let part = Rect::from_min_max(corner(left, top), corner(right, bottom));
            for (job, clip) in jobs.iter_mut().zip(&clips) {
                job.clip_rect = clip.intersect(part);
            }
            self.painter.render(&mut pass, &jobs, &screen);
        }
        commands
    }

    /// Copies the canvas to a texture of the window.
    fn copy(&self, encoder: &mut wgpu::CommandEncoder, frame: &wgpu::Texture) {
        let [width, height] = self.size();
        if frame.usage().contains(wgpu::TextureUsages::COPY_DST) {
            let (width, height) = (width.min(frame.width()), height.min(frame.height()));
            let common = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
            encoder.copy_texture_to_texture(self.texture.as_image_copy(), frame.as_image_copy(), common);
            return;
        }
        let mut pass = render_pass(encoder, frame, wgpu::LoadOp::Clear(wgpu::Color::BLACK));
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass.set_pipeline(&self.picture_pipeline);
        pass.set_bind_group(0, &self.bindings(&self.texture), &[]);
        pass.draw(0..3, 0..1);
    }
}

fn texture(gpu: &Gpu, format: wgpu::TextureFormat, [width, height]: [u32; 2]) -> render::Result<wgpu::Texture> {
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let usage =
        wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
    window_texture(gpu, "interface of the window", size, format, usage)
}

fn render_pass(
    encoder: &mut wgpu::CommandEncoder,
    texture: &wgpu::Texture,
    load: wgpu::LoadOp<wgpu::Color>,
) -> wgpu::RenderPass<'static> {
    let view = texture.create_view(&Default::default());
    let attachment = wgpu::RenderPassColorAttachment {
        view: &view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
    };
    let descriptor = wgpu::RenderPassDescriptor {
        label: Some("interface"),
        color_attachments: &[Some(attachment)],
        ..Default::default()
    };
    encoder.begin_render_pass(&descriptor).forget_lifetime()
}

/// Returns what must be drawn anew to show other shapes, in points.
fn changed(before: &[ClippedShape], now: &[ClippedShape]) -> Vec<Rect> {
    let bounds = |shape: &ClippedShape| shape.shape.visual_bounding_rect().intersect(shape.clip_rect);
    if before.len() == now.len() {
        let differing = before.iter().zip(now).filter(|(before, now)| before != now);
        return differing.flat_map(|(before, now)| [bounds(before), bounds(now)]).collect();
    }
    // Shapes have come or gone between equal beginnings and ends.
    let start = before.iter().zip(now).take_while(|(before, now)| before == now).count();
    let ends = before[start..].iter().rev().zip(now[start..].iter().rev());
    let end = ends.take_while(|(before, now)| before == now).count();
    let between = |shapes: &[ClippedShape]| shapes[start..shapes.len() - end].iter().map(bounds).collect::<Vec<_>>();
    [between(before), between(now)].concat()
}

/// The pixels that a rectangle of points may touch: left, top, right and bottom. Nothing gives an empty rectangle.
fn pixels(rect: Rect, pixels_per_point: f32, size: [u32; 2]) -> [u32; 4] {
    // Edges are smoothed over a pixel.
    const MARGIN: f32 = 2.0;
    let low = |from: f32, edge: u32| (from * pixels_per_point - MARGIN).floor().clamp(0.0, edge as f32) as u32;
    let high = |to: f32, edge: u32| (to * pixels_per_point + MARGIN).ceil().clamp(0.0, edge as f32) as u32;
    [low(rect.left(), size[0]), low(rect.top(), size[1]), high(rect.right(), size[0]), high(rect.bottom(), size[1])]
}

/// Joins rectangles until only a few are left, which cover them all.
fn merged(rects: impl Iterator<Item = [u32; 4]>) -> Vec<[u32; 4]> {
    const MOST: usize = 4;
    let area = |[left, top, right, bottom]: [u32; 4]| u64::from(right - left) * u64::from(bottom - top);
    let union = |a: [u32; 4], b: [u32; 4]| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])];
    let mut parts: Vec<[u32; 4]> = Vec::new();
    for rect in rects.filter(|rect| rect[0] < rect[2] && rect[1] < rect[3]) {
        let mut rect = rect;
        // A part that grows may then join with others.
        let is_near = |part: &[u32; 4], rect: [u32; 4]| area(union(*part, rect)) <= area(*part) + area(rect);
        while let Some(place) = parts.iter().position(|part| is_near(part, rect)) {
            rect = union(rect, parts.swap_remove(place));
        }
        parts.push(rect);
        if parts.len() > MOST {
            let growth = |a: usize, b: usize| area(union(parts[a], parts[b])) - area(parts[a]).max(area(parts[b]));
            let pairs = (0..parts.len()).flat_map(|a| (a + 1..parts.len()).map(move |b| (a, b)));
            if let Some((a, b)) = pairs.min_by_key(|(a, b)| growth(*a, *b)) {
                parts[a] = union(parts[a], parts[b]);
                parts.swap_remove(b);
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::bench::{devices, own_device};
    use crate::viewer::picture::window_texture::tests::Refusal;

    const SIZE: [u32; 2] = [320, 240];
    const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Bgra8Unorm;

    /// A texture with a usage of its own, and bytes in it if there are any.
    fn filled(gpu: &Gpu, size: [u32; 2], usage: wgpu::TextureUsages, bytes: &[u8]) -> wgpu::Texture {
        let [width, height] = size;
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: if bytes.is_empty() { FORMAT } else { wgpu::TextureFormat::Rgba8Unorm },
            usage,
            view_formats: &[],
        });
        if !bytes.is_empty() {
            let layout =
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 4), rows_per_image: None };
            gpu.queue.write_texture(texture.as_image_copy(), bytes, layout, texture.size());
        }
        texture
    }

    /// A picture in which each pixel has another colour.
    fn colorful(canvas: &Canvas, size: [u32; 2], seed: u32) -> Picture {
        let pixels = (0..size[0] * size[1]).map(|index| (index.wrapping_mul(2_654_435_761) ^ seed) | 0xff00_0000);
        let bytes: Vec<u8> = pixels.flat_map(u32::to_le_bytes).collect();
        let usage = wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::TEXTURE_BINDING;
        canvas.picture(&filled(&canvas.gpu, size, usage, &bytes))
    }

    #[test]
    fn what_is_painted_in_parts_equals_what_is_painted_whole() {
        let Some([gpu, _]) = devices() else { return };
        let mut canvas = Canvas::new(gpu.clone(), FORMAT, SIZE).unwrap();
        let context = egui::Context::default();
        let pictures = [1, 2].map(|seed| colorful(&canvas, [100, 80], seed));
        let stretched = colorful(&canvas, [33, 27], 3);
        let area = Rect::from_min_size(egui::pos2(200.0, 20.0), egui::vec2(100.0, 80.0));
        // The picture, a text and whether a window lies over both.
        let states = [
            (&pictures[0], "one", false),
            (&pictures[0], "another", false),
            (&pictures[1], "another", false),
            (&pictures[1], "one", true),
            (&stretched, "a third", true),
            (&stretched, "a third", false),
            (&stretched, "a third", false),
        ];
        let [copied, drawn] = [wgpu::TextureUsages::COPY_DST, wgpu::TextureUsages::RENDER_ATTACHMENT]
            .map(|usage| filled(&gpu, SIZE, usage | wgpu::TextureUsages::COPY_SRC, &[]));
        let mut before = Vec::new();
        for (number, (picture, text, has_window)) in states.into_iter().enumerate() {
            let size = egui::vec2(SIZE[0] as f32, SIZE[1] as f32);
            let input =
                egui::RawInput { screen_rect: Some(Rect::from_min_size(egui::Pos2::ZERO, size)), ..Default::default() };
            let mut output = context.run_ui(input, |ui| {
                ui.label(text);
                ui.add(egui::Slider::new(&mut 0.5, 0.0..=1.0));
                ui.painter().add(picture.within(area));
                ui.painter().circle_filled(area.left_top(), 9.0, egui::Color32::from_black_alpha(90));
                if has_window {
                    let window = egui::Window::new("over").fixed_pos([150.0, 30.0]);
                    window.show(ui.ctx(), |ui| ui.label("both"));
                }
            });
            canvas.update_textures(&mut output.textures_delta);
            output.textures_delta.clear();
            let show = |canvas: &mut Canvas, frame: &wgpu::Texture| {
                gpu.queue.submit(canvas.paint(&context, output.shapes.clone(), 1.0, frame));
                gpu.read_texture(frame).unwrap()
            };
            let is_whole = canvas.is_stale;
            // Only the last state is the one before it.
            assert_eq!(canvas.would_change(&output.shapes, 1.0), is_whole || number != 6, "state {number}");
            let in_parts = show(&mut canvas, &copied);
            assert!(!canvas.would_change(&output.shapes, 1.0) && canvas.would_change(&output.shapes, 2.0));
            assert!(show(&mut canvas, &drawn) == in_parts, "state {number}: a copy that is drawn");
            canvas.is_stale = true;
            assert!(show(&mut canvas, &copied) == in_parts, "state {number}");
            // The picture's pixels are shown as they are: nothing is left out of them, and no noise is added.
            let corner = ((40 * SIZE[0] + 290) * 4) as usize;
            let blue = (20 * 100 + 90_u32).wrapping_mul(2_654_435_761) ^ 1;
            assert!(number > 0 || in_parts[corner] == blue.to_le_bytes()[2], "{:?}", &in_parts[corner..corner + 4]);
            let parts = merged(changed(&before, &output.shapes).into_iter().map(|rect| pixels(rect, 1.0, SIZE)));
            let area: u32 = parts.iter().map(|[left, top, right, bottom]| (right - left) * (bottom - top)).sum();
            let least = u32::from(number != 6);
            let most = if number == 0 { SIZE[0] * SIZE[1] } else { SIZE[0] * SIZE[1] / 2 };
            assert!((least..=most).contains(&area), "state {number}, {is_whole}: {parts:?}");
            before = output.shapes;
        }
    }

    #[test]
    fn a_window_for_which_there_is_no_memory_goes_on_in_the_size_that_it_had() {
        let Some(gpu) = own_device() else { return };
        let mut canvas = Canvas::new(gpu.clone(), FORMAT, SIZE).unwrap();
        let context = egui::Context::default();
        let input = egui::RawInput {
            screen_rect: Some(Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(SIZE[0] as f32, SIZE[1] as f32))),
            ..Default::default()
        };
        let mut output = context.run_ui(input, |ui| {
            ui.painter().rect_filled(Rect::EVERYTHING, 0.0, egui::Color32::from_rgb(10, 200, 90));
        });
        canvas.update_textures(&mut output.textures_delta);
        output.textures_delta.clear();
        let refusal = Refusal::of(&gpu);
        assert!(Canvas::new(gpu.clone(), FORMAT, SIZE).is_err());
        // Larger, smaller, and one of each.
        for size in [[400, 300], [160, 120], [400, 120]] {
            assert!(canvas.resize(size).is_err() && canvas.size() == SIZE);
            for usage in [wgpu::TextureUsages::COPY_DST, wgpu::TextureUsages::RENDER_ATTACHMENT] {
                let frame = filled(&gpu, size, usage | wgpu::TextureUsages::COPY_SRC, &[]);
                gpu.queue.submit(canvas.paint(&context, output.shapes.clone(), 1.0, &frame));
                let shown = gpu.read_texture(&frame).unwrap();
                for (place, pixel) in shown.as_chunks::<4>().0.iter().enumerate() {
                    let [x, y] = [place as u32 % size[0], place as u32 / size[0]];
                    let expected = if x < SIZE[0] && y < SIZE[1] { [90, 200, 10] } else { [0; 3] };
                    assert_eq!(pixel[..3], expected, "{size:?}, {usage:?}: pixel {x}, {y}");
                }
            }
        }
        drop(refusal);
        canvas.resize([400, 300]).unwrap();
        assert_eq!(canvas.size(), [400, 300]);
    }

    #[test]
    fn few_parts_cover_all_that_has_changed() {
        let rects: Vec<[u32; 4]> = (0..40)
            .map(|index| [index * 37 % 300, index * 91 % 200, index * 37 % 300 + 9, index * 91 % 200 + 5])
            .collect();
        let parts = merged(rects.iter().copied().chain([[0; 4], [7, 7, 3, 9]]));
        assert!((1..=4).contains(&parts.len()), "{parts:?}");
        let is_within = |rect: &[u32; 4], part: &[u32; 4]| {
            part[0] <= rect[0] && part[1] <= rect[1] && part[2] >= rect[2] && part[3] >= rect[3]
        };
        assert!(rects.iter().all(|rect| parts.iter().any(|part| is_within(rect, part))), "{parts:?}");
        assert_eq!(merged([[0, 0, 9, 9], [200, 100, 209, 109]].into_iter()).len(), 2, "what lies apart stays apart");
    }
}
