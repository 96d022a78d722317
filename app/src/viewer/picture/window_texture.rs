//! Textures of the window's device. There may be no memory for one, and a test can refuse it.

use render::{Error, Gpu};

/// What a person reads when the window's device has no memory left.
pub const NO_MEMORY: &str =
    "The graphics device has no memory left for the window. Make it smaller, or show fewer points.";

/// Makes a texture of one level for the window. `label` is its name in messages.
///
/// # Errors
/// There is no memory for it, or the adapter has no textures of this size.
pub fn window_texture(
    gpu: &Gpu,
    label: &str,
    size: wgpu::Extent3d,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> render::Result<wgpu::Texture> {
    #[cfg(test)]
    let size = if tests::is_refused(gpu) { wgpu::Extent3d { width: 1 << 30, ..size } } else { size };
    // The one that is pushed last is popped first.
    let memory = gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
    let limits = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    });
    let errors = [limits, memory].map(|scope| pollster::block_on(scope.pop()));
    errors.into_iter().flatten().next().map_or(Ok(texture), |error| Err(told(&error, label, &gpu.info.name)))
}

/// Makes the texture of a picture of the render thread.
///
/// # Errors
/// Those of `window_texture`.
pub fn picture_texture(gpu: &Gpu, size: wgpu::Extent3d) -> render::Result<wgpu::Texture> {
    let usage = wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::TEXTURE_BINDING;
    window_texture(gpu, "picture in the window", size, wgpu::TextureFormat::Rgba8Unorm, usage)
}

fn told(error: &wgpu::Error, label: &str, adapter: &str) -> Error {
    let (adapter, problem) = (adapter.to_owned(), format!("{label}: {error}"));
    match error {
        wgpu::Error::OutOfMemory { .. } => Error::NoMemory { adapter, problem },
        _ => Error::Device { adapter, problem },
    }
}

#[cfg(test)]
pub mod tests {
    use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

    use super::*;

    /// The devices that refuse textures, from whatever thread they are asked. To wgpu those of two instances are equal.
    static REFUSING: Mutex<Vec<Arc<Gpu>>> = Mutex::new(Vec::new());

    fn refusing() -> MutexGuard<'static, Vec<Arc<Gpu>>> {
        REFUSING.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets a device refuse all textures of the window until it is dropped.
    pub struct Refusal(Arc<Gpu>);

    impl Refusal {
        pub fn of(gpu: &Arc<Gpu>) -> Self {
            refusing().push(gpu.clone());
            Self(gpu.clone())
        }
    }

    impl Drop for Refusal {
        fn drop(&mut self) {
            refusing().retain(|gpu| !Arc::ptr_eq(gpu, &self.0));
        }
    }

    pub(super) fn is_refused(gpu: &Gpu) -> bool {
        refusing().iter().any(|refusing| std::ptr::eq(Arc::as_ptr(refusing), gpu))
    }

    #[test]
    fn a_lack_of_memory_is_told_from_a_size_that_the_adapter_does_not_have() {
        let source = || Box::new(std::io::Error::other("a reason"));
        let no_memory = told(&wgpu::Error::OutOfMemory { source: source() }, "window", "an adapter");
        assert!(
            matches!(&no_memory, Error::NoMemory { problem, .. } if problem.starts_with("window: ")),
            "{no_memory}"
        );
        let refused = wgpu::Error::Validation { source: source(), description: "a size".into() };
        assert!(matches!(told(&refused, "window", "an adapter"), Error::Device { .. }));
    }
}
