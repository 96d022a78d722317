//! The request for a frame: what it shows, and how much work it takes.

use scene::{Camera, Settings};

use crate::exposure::Adaptation;
use crate::frame::Objects;
use crate::gi::LightReuse;

/// A request for one frame. It says all that decides about the picture besides the points.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    pub camera: &'a Camera,
    pub settings: &'a Settings,
    pub objects: Objects<'a>,
    /// The width and the height of the picture in pixels.
    pub size: [u32; 2],
    pub effort: Effort,
}

impl<'a> Frame<'a> {
    /// A frame in full effort.
    pub fn new(camera: &'a Camera, settings: &'a Settings, objects: Objects<'a>, size: [u32; 2]) -> Self {
        Self { camera, settings, objects, size, effort: Effort::FULL }
    }
}

/// How much work a frame takes: what first, moving and final pictures of a view differ in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// The number of points that the camera sees of which the frame draws about so many, spread evenly and each
    /// larger; `None` in pictures at rest. Mirrors reflect others, too, and all points cast shadows. While something
    /// moves, a sun casts shadows by the map of the whole scene alone, because its finer map goes with the view.
    pub most_points: Option<u64>,
    /// The number of points of which methods search for about so many, or draw so many into maps, spread evenly; `None`
    /// for all. Rays that are traced through trees meet all points.
    pub most_reflected: Option<u64>,
    /// The number of samples of mirrors, and of rays of light of each pixel, that the frame adds to those of the frames
    /// before, at least one, as long as nothing else changes; `None` for all. The picture with all of them is the same
    /// either way.
    pub most_samples: Option<u32>,
    /// Whether the frame may be lit by the current virtual lights and shadow maps, and may walk rays through the
    /// current maps around mirrors, although points have come or gone since. Making them examines all points, which is
    /// worthwhile only for pictures that stay.
    pub light_may_lag: bool,
    /// What the frame does with the indirect light of earlier frames on the surfaces that the camera sees.
    pub light_reuse: LightReuse,
    /// How the exposure follows that of the picture before; `None` where it is the one that fits. An exposure that nobody
    /// can distinguish from the one that fits becomes that.
    pub adaptation: Option<Adaptation>,
    /// Whether each pass is timed. The choice matters on GPUs without timestamps, where the host's clock can only time
    /// what it waits for. Without it such a frame is submitted in two parts, as long as each of its passes has been
    /// timed before: what splats the points that the camera sees, and the rest.
    pub times_passes: bool,
}

impl Effort {
    /// The effort of final pictures: files, studies and comparisons with the truth.
    pub const FULL: Self = Self {
        most_points: None,
        most_reflected: None,
        most_samples: None,
        light_may_lag: false,
        light_reuse: LightReuse::Never,
        adaptation: None,
        times_passes: true,
    };

    /// Whether something moves in the picture.
    pub(crate) fn is_moving(self) -> bool {
        self.most_points.is_some()
    }
}

impl Default for Effort {
    fn default() -> Self {
        Self::FULL
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use rayon::prelude::*;
    use scene::{METHODS, Method, ScreenBox};

    use super::*;
    use crate::allocation::tests::Room;
    use crate::gpu::Clock;
    use crate::{Gpu, Renderer};

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
            renderer.forget();
            let frame = Frame::new(&room.camera, &settings, room.objects(), [64, 48]);
            let frame = Frame { effort: Effort { times_passes, ..Effort::FULL }, ..frame };
            let stats = renderer.render(&room.store, &frame).unwrap();
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
    fn reflections_of_some_of_the_points_leave_no_trace_in_the_next_picture() {
        let Some(gpu) = Gpu::shared() else { return };
        let room = Room::new(&gpu);
        let methods =
            [Method::Sscr, Method::EnvironmentMap, Method::CubemapTrace, Method::SampleCameras, Method::LightField];
        for method in methods {
            let settings = Room::settings(method);
            let draw = |renderer: &mut Renderer, most_reflected| {
                let frame = Frame::new(&room.camera, &settings, room.objects(), [64, 48]);
                let frame = Frame { effort: Effort { most_reflected, ..Effort::FULL }, ..frame };
                let stats = renderer.render(&room.store, &frame).unwrap();
                (stats.reflected, renderer.read_picture().unwrap())
            };
            let (share, whole) = draw(&mut Renderer::bare(gpu.clone()), None);
            assert_eq!(share, None, "{method:?}");
            let mut renderer = Renderer::bare(gpu.clone());
            let (share, some) = draw(&mut renderer, Some(4));
            let share = share.unwrap();
            assert!(some != whole && share.points < 0.5, "{method:?} reflects all points");
            let has_maps = [Method::EnvironmentMap, Method::CubemapTrace].contains(&method);
            assert_eq!(share.texels, if has_maps { 1.0 / 16.0 } else { 1.0 }, "{method:?}");
            assert!(draw(&mut renderer, None) == (None, whole.clone()), "{method:?} keeps what it made of some points");
            // Whole maps that are at hand show all points.
            assert!(
                !has_maps || draw(&mut renderer, Some(4)) == (None, whole),
                "{method:?} draws maps that are at hand"
            );
        }
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
            let mut draw = |known: Option<f64>| {
                for compiled in renderer.pipelines.values_mut().filter(|_| known.is_some()) {
                    compiled.group_milliseconds = known;
                }
                renderer.forget();
                let frame = Frame::new(&room.camera, &settings, room.objects(), [72, 56]);
                let frame = Frame { effort: Effort { times_passes: false, ..Effort::FULL }, ..frame };
                let stats = renderer.render(&room.store, &frame).unwrap();
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
            for compiled in renderer.pipelines.values_mut() {
                compiled.group_milliseconds = known.or(compiled.group_milliseconds);
            }
            renderer.forget();
            let frame = Frame::new(&room.camera, &settings, room.objects(), [64, 48]);
            let frame = Frame { effort: Effort { times_passes: known.is_none(), ..Effort::FULL }, ..frame };
            renderer.render(&room.store, &frame).unwrap();
            // The pass runs once a frame.
            let mut accumulating = renderer.pipelines.iter().filter(|(key, _)| key.0.starts_with("splat_accumulate"));
            accumulating.find_map(|(_, compiled)| compiled.group_milliseconds).unwrap_or(0.0)
        };
        draw(None);
        draw(None);
        // Much longer than was known, and then much less: one fast frame is not believed.
        assert!(draw(Some(1e-15)) > 1e-12);
        assert_eq!(draw(Some(50.0)), 50.0 * 0.97);
    }
}
