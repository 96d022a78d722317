//! The window's surface and what egui paints on it.

use std::sync::Arc;
use std::time::Duration;

use egui::ViewportId;
use egui_winit::accesskit_winit::{self, Adapter, WindowEvent};
use render::Gpu;
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::window::Window;

use crate::viewer::input::typed_ahead::TypedAhead;
use crate::viewer::picture::canvas::{Canvas, Picture};

pub struct Screen {
    pub window: Arc<Window>,
    pub gpu: Arc<Gpu>,
    pub context: egui::Context,
    pub input: egui_winit::State,
    typed_ahead: TypedAhead,
    surface: wgpu::Surface<'static>,
    configuration: wgpu::SurfaceConfiguration,
    canvas: Canvas,
    picture: Option<Picture>,
    /// True if the window may show something else than the canvas.
    is_stale: bool,
    /// Whether an assistive program listens.
    is_assisted: bool,
}

/// The result of painting a frame of the window.
pub enum Painted {
    /// egui wants the next frame after `delay`. `is_shown` is false where the window is hidden; `is_new` is false where
    /// the window showed it already.
    Next { delay: Duration, is_shown: bool, is_new: bool },
    /// The frame was not shown (the surface was resized) and must be painted again at once.
    Again,
    /// The surface was lost: nothing is shown before the device is opened again.
    Lost,
}

/// What became of shapes that were painted.
#[derive(Clone, Copy, PartialEq)]
enum Presented {
    Shown,
    /// The window is hidden.
    Hidden,
    /// The surface has changed, and they must be painted again.
    Changed,
    /// The surface is lost.
    Lost,
}

/// How often a device that was lost is opened again, and the pause in between.
const TRIES: u32 = 5;
const BETWEEN_TRIES: Duration = Duration::from_millis(400);

/// The program's icon; made from assets/desktop/glint.svg.
fn icon() -> Option<winit::window::Icon> {
    let image = image::load_from_memory(include_bytes!("../../../assets/desktop/glint.png")).ok()?.into_rgba8();
    let (width, height) = image.dimensions();
    winit::window::Icon::from_rgba(image.into_raw(), width, height).ok()
}

impl Screen {
    /// Opens the window. `wake` gets what screen readers and other assistive programs ask for.
    ///
    /// # Errors
    /// No window can be opened, or no adapter can show something in it.
    pub fn open<Wake: From<accesskit_winit::Event> + Send>(
        event_loop: &ActiveEventLoop,
        size: [u32; 2],
        wanted: Option<&str>,
        wake: EventLoopProxy<Wake>,
    ) -> anyhow::Result<Self> {
        let size = first_monitor(event_loop).map_or(size, |(monitor, scale)| fitted(size, monitor, scale));
        let attributes = Window::default_attributes()
            .with_title("glint")
            // Assistive programs must know of a window before it is shown.
            .with_visible(false)
            .with_inner_size(winit::dpi::LogicalSize::new(size[0], size[1]))
            .with_min_inner_size(winit::dpi::LogicalSize::new(LEAST_SIZE[0], LEAST_SIZE[1]));
        // By this name Wayland finds the icon, in the menu entry of a package.
        #[cfg(target_os = "linux")]
        let attributes = winit::platform::wayland::WindowAttributesExtWayland::with_name(attributes, "glint", "glint");
        let window = Arc::new(event_loop.create_window(attributes).map_err(|error| crate::viewer::no_screen(&error))?);
        // Not among the attributes, all of which GLINT_LOG=debug writes down.
        window.set_window_icon(icon());
        let assistive = Adapter::with_event_loop_proxy(event_loop, &window, wake);
        window.set_visible(true);
        let mut screen = Self::on(window, event_loop, wanted)?;
        screen.input.accesskit = Some(assistive);
        Ok(screen)
    }

    /// Opens a device anew for the same window, after the old one or its surface was lost. What egui remembers stays; the
    /// picture comes with the next frame.
    ///
    /// # Errors
    /// No adapter can show something in the window any more.
    pub fn opened_again(self, event_loop: &ActiveEventLoop, wanted: Option<&str>) -> anyhow::Result<Self> {
        let Self { window, context, mut input, surface, canvas, picture, is_assisted, .. } = self;
        // A window has one surface at a time.
        drop((surface, canvas, picture));
        // A context sends its fonts to the device once. Another one knows all that this one does, and sends them again.
        let memory = context.memory(egui::Memory::clone);
        let mut tried = Self::on(window.clone(), event_loop, wanted);
        for _ in 1..TRIES {
            if tried.is_ok() {
                break;
            }
            // A driver that has just been restarted is not there at once.
            std::thread::sleep(BETWEEN_TRIES);
            tried = Self::on(window.clone(), event_loop, wanted);
        }
        let mut screen = tried?;
        // A window is made known to assistive programs once.
        screen.input.accesskit = input.accesskit.take();
        screen.is_assisted = is_assisted;
        if is_assisted {
            screen.context.enable_accesskit();
        }
        screen.context.memory_mut(|known| *known = memory);
        Ok(screen)
    }

    fn on(window: Arc<Window>, event_loop: &ActiveEventLoop, wanted: Option<&str>) -> anyhow::Result<Self> {
        let display = Box::new(event_loop.owned_display_handle());
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_with_display_handle(display));
        let surface = instance.create_surface(window.clone())?;
        let gpu = Gpu::for_surface(&instance, &surface, wanted)?;
        let physical = window.inner_size();
        let (width, height) = (physical.width.max(1), physical.height.max(1));
        let mut configuration = surface
            .get_default_config(&gpu.adapter, width, height)
            .ok_or_else(|| anyhow::anyhow!("{}: cannot show pictures in this window", gpu.info.name))?;
        let formats = surface.get_capabilities(&gpu.adapter).formats;
        configuration.format = format_of(&formats).unwrap_or(configuration.format);
        configuration.present_mode = wgpu::PresentMode::AutoVsync;
        // What the window shows is copied to it where it can be; elsewhere it is drawn.
        configuration.usage |= surface.get_capabilities(&gpu.adapter).usages & wgpu::TextureUsages::COPY_DST;
        surface.configure(&gpu.device, &configuration);
        let context = egui::Context::default();
        crate::viewer::look::theme::apply(&context);
        let side = gpu.device.limits().max_texture_dimension_2d as usize;
        let scale = Some(window.scale_factor() as f32);
        let input = egui_winit::State::new(context.clone(), ViewportId::ROOT, &window, scale, None, Some(side));
        let canvas = Canvas::new(gpu.clone(), configuration.format, [width, height])?;
        Ok(Self {
            window,
            gpu,
            context,
            input,
            surface,
            configuration,
            typed_ahead: TypedAhead::default(),
            canvas,
            picture: None,
            is_stale: true,
            is_assisted: false,
        })
    }

    /// Does what an assistive program asks for. The tree of controls is made only while one listens.
    pub fn assist(&mut self, event: WindowEvent) {
        match event {
            WindowEvent::InitialTreeRequested => {
                self.is_assisted = true;
                self.context.enable_accesskit();
            }
            WindowEvent::ActionRequested(action) => self.input.on_accesskit_action_request(action),
            WindowEvent::AccessibilityDeactivated => {
                self.is_assisted = false;
                self.context.disable_accesskit();
            }
        }
    }

    /// Takes the size that the window has now.
    ///
    /// # Errors
    /// There is no memory for it: the window goes on in the size that it had, with black beside it, and each paint tries
    /// again.
    pub fn resize(&mut self, size: winit::dpi::PhysicalSize<u32>) -> render::Result<()> {
        if size.width == 0 || size.height == 0 {
            return Ok(());
        }
        (self.configuration.width, self.configuration.height) = (size.width, size.height);
        self.surface.configure(&self.gpu.device, &self.configuration);
        self.canvas.resize([size.width, size.height])
    }

    /// Must be called when the system may have lost what the window showed: the next paint then shows all of it.
    pub fn show_again(&mut self) {
        self.is_stale = true;
    }

    /// The size of the window in pixels.
    pub fn pixel_size(&self) -> [u32; 2] {
        [self.configuration.width, self.configuration.height]
    }

    /// The size of the window in logical pixels.
    pub fn size(&self) -> [u32; 2] {
        let size = self.window.inner_size().to_logical::<u32>(self.window.scale_factor());
        [size.width, size.height]
    }

    /// Reads what the window shows, as `Canvas::pixels` does.
    pub fn pixels(&self) -> Option<([u32; 2], Vec<u8>)> {
        self.canvas.pixels()
    }

    /// Shows the render thread's texture from the next paint on. This must be called for each new content of it.
    pub fn set_picture(&mut self, texture: &wgpu::Texture) {
        self.picture = Some(self.canvas.picture(texture));
    }

    pub fn picture(&self) -> Option<Picture> {
        self.picture.clone()
    }

    /// Runs `contents` and shows the result.
    pub fn paint(&mut self, event_loop: &ActiveEventLoop, mut contents: impl FnMut(&mut egui::Ui)) -> Painted {
        let mut input = self.input.take_egui_input(&self.window);
        self.typed_ahead.delay(&mut input, self.context.text_edit_focused());
        if self.typed_ahead.is_waiting() {
            self.context.request_repaint();
        }
        if self.canvas.resize(self.pixel_size()).is_err() {
            let scale = egui_winit::pixels_per_point(&self.context, &self.window);
            let [width, height] = self.canvas.size().map(|side| side as f32 / scale);
            input.screen_rect = Some(egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(width, height)));
        }
        let mut passes = passes(input).into_iter();
        let mut output = self.context.run_ui(passes.next().unwrap_or_default(), &mut contents);
        for later in passes {
            output.append(self.context.run_ui(later, &mut contents));
        }
        let platform = std::mem::take(&mut output.platform_output);
        self.input.handle_platform_output_with_event_loop(&self.window, event_loop, platform);
        // The update stands before any early return because egui does not send textures twice.
        self.canvas.update_textures(&mut output.textures_delta);
        let freed = std::mem::take(&mut output.textures_delta.free);
        let delay =
            output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |viewport| viewport.repaint_delay);
        // Handing over a window of 1400 x 900 takes software Vulkan and the X server some 10 ms, and most moves of the
        // mouse change nothing.
        let is_new = self.is_stale || self.canvas.would_change(&output.shapes, output.pixels_per_point);
        let presented = if is_new { self.present(output.shapes, output.pixels_per_point) } else { Presented::Shown };
        self.canvas.free(freed);
        self.is_stale = presented != Presented::Shown;
        match presented {
            Presented::Shown | Presented::Hidden => {
                Painted::Next { delay, is_shown: presented == Presented::Shown, is_new }
            }
            Presented::Changed => Painted::Again,
            Presented::Lost => Painted::Lost,
        }
    }

    fn present(&mut self, shapes: Vec<egui::epaint::ClippedShape>, pixels_per_point: f32) -> Presented {
        use wgpu::CurrentSurfaceTexture as Current;
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let frame = match self.surface.get_current_texture() {
            Current::Success(frame) | Current::Suboptimal(frame) => frame,
            Current::Outdated => {
                self.surface.configure(device, &self.configuration);
                return Presented::Changed;
            }
            Current::Lost => return Presented::Lost,
            // The window is hidden, or the compositor is busy: the next event brings the next frame. Or the device is lost,
            // which it reports when it is asked.
            _ => {
                let _ = device.poll(wgpu::PollType::Poll);
                return Presented::Hidden;
            }
        };
        let commands = self.canvas.paint(&self.context, shapes, pixels_per_point, &frame.texture);
        queue.submit(commands);
        self.window.pre_present_notify();
        queue.present(frame);
        Presented::Shown
    }
}

/// What title bar, task bar and dock take of a monitor's height, in logical pixels.
const BARS: f64 = 80.0;
/// The least size of the window, in logical pixels.
const LEAST_SIZE: [u32; 2] = [480, 320];

/// The size of the monitor that the window is likely to open on, in pixels, and its scale.
fn first_monitor(event_loop: &ActiveEventLoop) -> Option<([u32; 2], f64)> {
    let monitor = event_loop.primary_monitor().or_else(|| event_loop.available_monitors().next())?;
    let size = monitor.size();
    Some(([size.width, size.height], monitor.scale_factor()))
}

/// The size of a window that lies within a monitor, in logical pixels.
fn fitted(size: [u32; 2], monitor: [u32; 2], scale: f64) -> [u32; 2] {
    // Some systems do not give the size.
    if monitor.contains(&0) || scale <= 0.0 {
        return size;
    }
    let logical = monitor.map(|side| f64::from(side) / scale);
    let room = [logical[0] as u32, (logical[1] - BARS).max(0.0) as u32];
    [0, 1].map(|axis| size[axis].min(room[axis]).max(LEAST_SIZE[axis]))
}

/// The format of the window among those that it can have. egui blends in sRGB, as browsers do, so it needs one that does
/// not convert, and pictures have eight bits. Some systems list ten bits or floats first.
fn format_of(formats: &[wgpu::TextureFormat]) -> Option<wgpu::TextureFormat> {
    let usual = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];
    let usual = formats.iter().find(|format| usual.contains(format));
    usual.or_else(|| formats.iter().find(|format| !format.is_srgb())).copied()
}

/// Splits input that holds both a press and its release. Otherwise egui would see the button up again before it sees a
/// drag: on a slow machine a quick drag falls between two frames of the window, and must not be lost.
fn passes(mut input: egui::RawInput) -> Vec<egui::RawInput> {
    let events = std::mem::take(&mut input.events);
    let is_button =
        |event: &egui::Event, wanted| matches!(event, egui::Event::PointerButton { pressed, .. } if *pressed == wanted);
    if !(events.iter().any(|event| is_button(event, true)) && events.iter().any(|event| is_button(event, false))) {
        return vec![egui::RawInput { events, ..input }];
    }
    // A press ends a pass, a release begins one.
    let mut parts: Vec<Vec<egui::Event>> = vec![Vec::new()];
    let mut begin = false;
    for event in events {
        if begin || is_button(&event, false) {
            parts.push(Vec::new());
        }
        begin = is_button(&event, true);
        if let Some(part) = parts.last_mut() {
            part.push(event);
        }
    }
    parts.retain(|part| !part.is_empty());
    let mut passes: Vec<egui::RawInput> =
        parts.into_iter().map(|events| egui::RawInput { events, ..input.clone() }).collect();
    for later in passes.iter_mut().skip(1) {
        later.dropped_files.clear();
    }
    passes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn button(pressed: bool) -> egui::Event {
        let (pos, modifiers) = (egui::Pos2::ZERO, egui::Modifiers::NONE);
        egui::Event::PointerButton { pos, button: egui::PointerButton::Primary, pressed, modifiers }
    }

    #[test]
    fn a_drag_within_one_frame_is_press_move_and_release() {
        let moved = || egui::Event::PointerMoved(egui::Pos2::ZERO);
        let events = vec![moved(), button(true), moved(), moved(), button(false), moved()];
        let passes = passes(egui::RawInput { events, ..Default::default() });
        let lengths: Vec<usize> = passes.iter().map(|pass| pass.events.len()).collect();
        assert_eq!(lengths, [2, 2, 2]);
    }

    #[test]
    fn other_input_stays_in_one_frame() {
        for events in [vec![], vec![button(true)], vec![button(false)]] {
            let count = events.len();
            let passes = passes(egui::RawInput { events, ..Default::default() });
            assert_eq!((passes.len(), passes[0].events.len()), (1, count));
        }
    }

    #[test]
    fn the_first_window_lies_within_its_monitor_at_any_scale() {
        assert_eq!(fitted([1280, 800], [1920, 1080], 1.0), [1280, 800]);
        assert_eq!(fitted([1280, 800], [1366, 768], 1.0), [1280, 688]);
        assert_eq!(fitted([1280, 800], [2560, 1600], 2.5), [1024, 560]);
        assert_eq!(fitted([3000, 2000], [800, 400], 1.0), [800, 320]);
        assert_eq!(fitted([1280, 800], [0, 0], 1.0), [1280, 800]);
    }

    #[test]
    fn the_window_has_an_icon() {
        assert!(icon().is_some());
    }

    #[test]
    fn the_window_has_eight_bits_that_are_not_converted() {
        use wgpu::TextureFormat::{Bgra8Unorm, Bgra8UnormSrgb, Rgb10a2Unorm, Rgba8Unorm, Rgba8UnormSrgb, Rgba16Float};
        assert_eq!(format_of(&[Rgba16Float, Rgb10a2Unorm, Bgra8UnormSrgb, Bgra8Unorm]), Some(Bgra8Unorm));
        assert_eq!(format_of(&[Rgba8UnormSrgb, Rgba8Unorm, Bgra8Unorm]), Some(Rgba8Unorm));
        assert_eq!(format_of(&[Bgra8UnormSrgb, Rgb10a2Unorm]), Some(Rgb10a2Unorm));
        assert_eq!(format_of(&[Bgra8UnormSrgb]), None);
    }
}
