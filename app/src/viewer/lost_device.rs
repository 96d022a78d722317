//! What the window does when its own device is lost, or has no memory left.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::json;
use winit::event_loop::ActiveEventLoop;

use super::screen::Screen;
use super::{Viewer, Wake};

use crate::shared::language::text;

/// A device that is lost twice within this time would be lost again.
const LOST_AGAIN: Duration = Duration::from_secs(60);

impl Viewer {
    /// Lets the window hear of what happens to its device.
    pub(super) fn watch(&mut self, screen: &Screen) {
        // The device before has a flag of its own.
        let lost = Arc::<AtomicBool>::default();
        self.device_lost = lost.clone();
        let wake = self.wake.clone();
        screen.gpu.device.set_device_lost_callback(move |_, _| {
            lost.store(true, Ordering::Relaxed);
            let _ = wake.send_event(Wake::Lost);
        });
        let (wake, is_told) = (self.wake.clone(), AtomicBool::new(false));
        screen.gpu.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let is_memory = matches!(error, wgpu::Error::OutOfMemory { .. });
            if is_memory && !is_told.swap(true, Ordering::Relaxed) {
                let _ = wake.send_event(Wake::NoMemory(error.to_string()));
            }
            tracing::error!("window: {error}");
        }));
    }

    /// Opens the window's device again after a loss: the restart of a driver loses all devices. The scene, its points and
    /// all that a person has done stay as they are.
    ///
    /// # Errors
    /// It was lost shortly before, or none can be opened.
    pub(super) fn open_again(&mut self, event_loop: &ActiveEventLoop) -> anyhow::Result<()> {
        self.keep_preferences();
        let Some(screen) = self.screen.take() else { return Ok(()) };
        if self.lost_at.replace(Instant::now()).is_some_and(|at| at.elapsed() < LOST_AGAIN) {
            anyhow::bail!("it was lost twice in a minute");
        }
        let screen = screen.opened_again(event_loop, self.wanted_gpu.as_deref())?;
        self.watch(&screen);
        self.effects.show_on(screen.gpu.clone());
        self.screen = Some(screen);
        self.log.write(&json!({ "event": "window" }));
        self.session.outside.warning(text!("The graphics device of the window was lost; it is opened again."));
        self.request_paint();
        Ok(())
    }
}
