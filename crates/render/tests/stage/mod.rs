//! The renderer of a test program: all of its tests share one, since software Vulkan compiles each pass for half a
//! second.

use std::sync::{Arc, LazyLock, Mutex, MutexGuard};

use render::{Gpu, Renderer};

pub struct Stage {
    pub gpu: Arc<Gpu>,
    pub renderer: Renderer,
}

static STAGE: LazyLock<Option<Mutex<Stage>>> = LazyLock::new(|| {
    let gpu = match Gpu::headless(None) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            return None;
        }
    };
    let renderer = Renderer::new(gpu.clone()).expect("every pass compiles");
    Some(Mutex::new(Stage { gpu, renderer }))
});

/// The renderer; `None` if there is no adapter and none is required.
pub fn stage() -> Option<MutexGuard<'static, Stage>> {
    STAGE.as_ref().map(|stage| stage.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

macro_rules! stage_or_skip {
    () => {
        match crate::stage::stage() {
            Some(stage) => stage,
            None => return,
        }
    };
}
