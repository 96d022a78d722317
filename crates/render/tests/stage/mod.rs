//! The renderer of a test program: all of its tests share one, since software Vulkan compiles each pass for half a
//! second.

use std::sync::{Arc, LazyLock, Mutex, MutexGuard};

use render::{Effort, Gpu, Renderer};

pub struct Stage {
    pub gpu: Arc<Gpu>,
    pub renderer: Renderer,
    /// The effort of the frames that a test draws by its stage.
    pub effort: Effort,
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
    Some(Mutex::new(Stage { gpu, renderer, effort: Effort::FULL }))
});

/// The renderer; `None` if there is no adapter and none is required.
pub fn stage() -> Option<MutexGuard<'static, Stage>> {
    let mut stage = STAGE.as_ref()?.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    stage.effort = Effort::FULL;
    Some(stage)
}

macro_rules! stage_or_skip {
    () => {
        match crate::stage::stage() {
            Some(stage) => stage,
            None => return,
        }
    };
}
