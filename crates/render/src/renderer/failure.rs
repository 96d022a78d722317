//! What a renderer does after a frame that failed.

use super::Renderer;
use crate::gpu::{Error, Result};

impl Renderer {
    /// Returns the failure from which others follow, if there is one: a buffer without memory, for example, is only
    /// reported after the fact. What is kept from frame to frame may lack something then, and is given up.
    pub(crate) fn checked<T>(&mut self, outcome: Result<T>) -> Result<T> {
        let is_failed = outcome.as_ref().is_err_and(|error| !matches!(error, Error::GivenUp));
        let known = if is_failed { self.gpu.wait() } else { self.gpu.failure() };
        let outcome = known.and(outcome);
        if matches!(outcome, Err(Error::Device { .. } | Error::NoMemory { .. } | Error::Lost(_))) {
            self.release();
        }
        outcome
    }

    /// Gives up all images and buffers.
    pub(crate) fn release(&mut self) {
        let pipelines = std::mem::take(&mut self.pipelines);
        let bare = Self::bare(self.gpu.clone());
        let before = std::mem::replace(self, bare);
        self.pipelines = pipelines;
        (self.given_up, self.longest_piece, self.prepared) = (before.given_up, before.longest_piece, before.prepared);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    use glam::DVec3;
    use rayon::prelude::*;
    use scene::{Camera, METHODS, Method, Settings};

    use super::*;
    use crate::allocation::tests::Room;
    use crate::{Frame, Gpu, Objects, PointStore};

    #[test]
    fn a_pass_that_would_take_seconds_at_a_time_is_refused_on_a_gpu_and_tried_again() {
        let Some(mut gpu) = Gpu::for_test() else { return };
        let watched = Arc::get_mut(&mut gpu).unwrap();
        (watched.is_watched, watched.refuses_long) = (true, true);
        let store = PointStore::new(gpu.clone());
        let mut renderer = Renderer::bare(gpu);
        let mut settings = Settings::default();
        settings.reflection.method = Method::None;
        let camera = Camera::looking(DVec3::ZERO, DVec3::X, 1.0, DVec3::Z);
        let mut draw = |seconds: Option<f64>| {
            for compiled in renderer.pipelines.iter_mut().filter(|(key, _)| key.0 == "present") {
                let groups = 8.0 * 8.0;
                compiled.1.group_milliseconds =
                    seconds.map_or(compiled.1.group_milliseconds, |seconds| Some(seconds * 1000.0 / groups));
            }
            let outcome = renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), [64, 64]));
            outcome.and_then(|_| renderer.read_picture()).map_err(|error| error.to_string())
        };
        let whole = draw(None).unwrap();
        assert!(draw(Some(1.9)).unwrap() == whole);
        let refused = draw(Some(6.0)).unwrap_err();
        assert!(refused.contains("`present` would keep") && refused.contains("busy for 6.0 s"), "{refused}");
        // One slow frame is not believed for ever.
        assert!(draw(None).unwrap_err().contains("3.0 s"));
        assert!(draw(None).unwrap() == whole);
    }

    #[test]
    fn a_device_that_is_lost_in_the_middle_of_a_frame_ends_the_frame_of_every_method_with_an_error() {
        if Gpu::for_test().is_none() {
            return;
        }
        let methods = METHODS.iter().map(|row| row.method).filter(|method| method.chosen() == *method);
        methods.collect::<Vec<_>>().into_par_iter().for_each(|method| {
            let gpu = Gpu::for_test().unwrap();
            let room = Room::new(&gpu);
            let mut renderer = Renderer::bare(gpu.clone());
            let settings = Room::settings(method);
            let passed = Arc::new(AtomicU32::new(0));
            let mut draw = |last: u32| {
                passed.store(0, Ordering::Relaxed);
                let (passed, gpu) = (passed.clone(), gpu.clone());
                // Asked before each pass.
                let destroy = move || {
                    if passed.fetch_add(1, Ordering::Relaxed) == last {
                        gpu.device.destroy();
                    }
                    false
                };
                renderer.give_up_when(Some(Arc::new(destroy)));
                renderer.forget();
                renderer.render(&room.store, &Frame::new(&room.camera, &settings, room.objects(), [16, 12])).map(drop)
            };
            draw(u32::MAX).unwrap();
            let passes = passed.load(Ordering::Relaxed);
            assert!(passes > 8, "{method:?}: {passes}");
            for _ in 0..2 {
                let lost = draw(passes / 2);
                assert!(matches!(lost, Err(Error::Lost(_))), "{method:?}, pass {} of {passes}: {lost:?}", passes / 2);
            }
        });
    }
}
