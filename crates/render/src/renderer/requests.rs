//! What is asked of the frames that follow, beside what they show.

use std::sync::Arc;

use super::Renderer;
use crate::gi::LightReuse;
use crate::recorder::IsGivenUp;

impl Renderer {
    /// Lets the frames that follow move the exposure this share of the way from that of the frame before to the one that
    /// fits, or all the way for `None`. Exposures that nobody can tell apart from the one that fits become that.
    pub fn adapt_exposure(&mut self, share: Option<f32>) {
        self.exposure.share = share;
    }

    /// Whether the following frames may be lit by the current virtual lights and shadow maps, and walk rays through the
    /// current maps around mirrors, although points have come or gone since: making them examines all points, which is
    /// worthwhile only for pictures that stay.
    pub fn let_light_lag(&mut self, may_lag: bool) {
        self.gi.may_lag = may_lag;
    }

    /// What the frames that follow do with the indirect light of earlier frames on the surfaces that the camera sees.
    pub fn reuse_light(&mut self, reuse: LightReuse) {
        self.gi.keeper.reuse = reuse;
    }

    /// Lets the frames that follow draw about `most_points` of the points that the camera sees, spread evenly and each
    /// larger, or all for `None`. This is for pictures while something moves: a sun then casts shadows by the map of
    /// the whole scene alone, because its finer map goes with the view. Mirrors reflect all points, and all points cast
    /// shadows.
    pub fn thin(&mut self, most_points: Option<u64>) {
        self.most_points = most_points;
    }

    /// Lets the frames that follow add at most `samples` of the samples of glossy mirrors to those of the frames before, as
    /// long as nothing else changes, or all for `None`. The picture with all samples is the same either way.
    pub fn sum_at_once(&mut self, samples: Option<u32>) {
        self.samples_at_once = samples.map(|samples| samples.max(1));
    }

    /// Lets the frames that follow end with `Error::GivenUp` before their next pass once `is_given_up` says so, because
    /// another picture is wanted; it is asked before each pass. The frame after it is made as if that one had not been begun. Where the GPU times the
    /// passes, what is recorded is not waited for, so that a frame is given up only while it is recorded. Elsewhere long
    /// passes are cut into several (`cut_passes`), which changes no picture.
    pub fn give_up_when(&mut self, is_given_up: Option<Arc<IsGivenUp>>) {
        self.given_up = is_given_up;
    }

    /// Sets how many milliseconds a pass over points, of indirect light or of rays is meant to take at most where a
    /// frame can be given up; 25 unless set.
    pub fn cut_passes(&mut self, longest_piece: f64) {
        self.longest_piece = longest_piece;
    }

    /// Sets whether the frames that follow time each pass; they do unless set. It matters on GPUs without timestamps, where
    /// the host's clock can only time what it waits for. Without it such frames are submitted in two parts, as long as
    /// each of their passes has been timed before: what splats the points that the camera sees, and the rest.
    pub fn time_passes(&mut self, each: bool) {
        self.times_passes = each;
    }
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;
    use scene::{METHODS, Method, ScreenBox};

    use super::*;
    use crate::Gpu;
    use crate::allocation::tests::Room;
    use crate::gpu::Clock;

    /// What a processor is where it acts like a GPU without timestamps.
    fn without_timestamps() -> Option<Arc<Gpu>> {
        let mut gpu = Gpu::for_test()?;
        let acting = Arc::get_mut(&mut gpu).unwrap();
        (acting.is_watched, acting.clock) = (true, Clock::Host);
        Some(gpu)
    }

    #[test]
    fn a_gpu_without_timestamps_is_waited_for_twice_a_frame_where_nobody_asks_for_the_times_of_passes() {
        let Some(gpu) = without_timestamps() else { return };
        let room = Room::new(&gpu);
        let settings = Room::settings(Method::SurfelTrace);
        let draw = |renderer: &mut Renderer, times_passes| {
            renderer.time_passes(times_passes);
            renderer.forget();
            let stats = renderer.render(&room.store, &room.camera, &settings, room.objects(), [64, 48]).unwrap();
            (stats, renderer.read_picture().unwrap())
        };
        let mut renderer = Renderer::bare(gpu.clone());
        // The first one compiles; the second one is timed.
        let [_, (each, picture)] = [0, 1].map(|_| draw(&mut renderer, true));
        assert!(each.waits > 20 && each.passes.len() > 10, "{each:?}");
        let (together, same) = draw(&mut renderer, false);
        assert_eq!((together.waits, together.passes.len()), (2, 0));
        assert!(picture == same, "how passes are timed changes the picture");
        let [splatting, whole] = [together.splatting_milliseconds, together.frame_milliseconds];
        assert!(0.0 < splatting && splatting < whole, "{splatting} of {whole} ms");
        // Passes that nobody has timed are timed one by one, so that long ones are cut by what they take.
        let mut anew = Renderer::bare(gpu.clone());
        let [(first, _), (second, _), (third, same)] = [0, 1, 2].map(|_| draw(&mut anew, false));
        assert!(first.waits > 20 && second.waits > 20, "{} and {}", first.waits, second.waits);
        assert!(third.waits == 2 && picture == same);
        assert!(anew.pipelines.values().all(|compiled| compiled.group_milliseconds.is_some()));
    }

    #[test]
    fn passes_that_are_cut_into_single_workgroups_make_the_same_picture() {
        let Some(gpu) = without_timestamps() else { return };
        let room = Room::new(&gpu);
        let methods = METHODS.iter().map(|row| row.method).filter(|method| method.chosen() == *method);
        methods.collect::<Vec<_>>().into_par_iter().for_each(|method| {
            let mut settings = Room::settings(method);
            settings.screen_trace.box_from = ScreenBox::Picture;
            let mut renderer = Renderer::bare(gpu.clone());
            renderer.time_passes(false);
            let mut draw = |known: Option<f64>| {
                for compiled in renderer.pipelines.values_mut().filter(|_| known.is_some()) {
                    compiled.group_milliseconds = known;
                }
                renderer.forget();
                let stats = renderer.render(&room.store, &room.camera, &settings, room.objects(), [72, 56]).unwrap();
                (stats, renderer.read_picture().unwrap())
            };
            draw(None);
            let (whole, picture) = draw(Some(1e-9));
            let (cut, same) = draw(Some(1000.0));
            assert!(cut.dispatches > whole.dispatches + 100, "{method:?}: {} dispatches", cut.dispatches);
            assert!(picture == same, "{method:?} makes another picture");
            assert_eq!(cut.reflection, whole.reflection, "{method:?}");
        });
    }

    #[test]
    fn what_is_known_of_passes_follows_the_time_that_they_take_together() {
        let Some(gpu) = without_timestamps() else { return };
        let room = Room::new(&gpu);
        let settings = Room::settings(Method::None);
        let mut renderer = Renderer::bare(gpu.clone());
        let mut draw = |known: Option<f64>| {
            renderer.time_passes(known.is_none());
            for compiled in renderer.pipelines.values_mut() {
                compiled.group_milliseconds = known.or(compiled.group_milliseconds);
            }
            renderer.forget();
            renderer.render(&room.store, &room.camera, &settings, room.objects(), [64, 48]).unwrap();
            // It runs once a frame.
            let mut accumulating = renderer.pipelines.iter().filter(|(key, _)| key.0 == "splat_accumulate");
            accumulating.find_map(|(_, compiled)| compiled.group_milliseconds).unwrap_or(0.0)
        };
        draw(None);
        draw(None);
        // Much longer than was known, and then much less: one fast frame is not believed.
        assert!(draw(Some(1e-15)) > 1e-12);
        assert_eq!(draw(Some(50.0)), 50.0 * 0.97);
    }
}
