//! A renderer for tests, which take turns with it.

use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use render::{Gpu, Renderer};

pub struct Studio {
    pub gpu: Arc<Gpu>,
    pub renderer: Renderer,
}

static STUDIO: LazyLock<Option<Mutex<Studio>>> = LazyLock::new(|| {
    let gpu = match Gpu::headless(None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            return None;
        }
    };
    Some(Mutex::new(Studio { renderer: Renderer::new(gpu.clone()).unwrap(), gpu }))
});

/// Returns the renderer that the tests of a file share; `None` without an adapter.
pub fn studio() -> Option<MutexGuard<'static, Studio>> {
    STUDIO.as_ref().map(|studio| studio.lock().unwrap_or_else(PoisonError::into_inner))
}
