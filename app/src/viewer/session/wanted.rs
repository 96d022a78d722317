//! The frame that the session wants now.

use std::time::Instant;

use scene::{Lighting, Show};

use crate::viewer::frames::Situation;
use crate::viewer::loaded::{Loaded, all_mirrors};
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::scene::{Scene, idle};
use crate::viewer::tools::Tools;

/// The request for the current view in full quality. `revision` is the number of the present points.
pub fn picture(scene: &Scene, loaded: &Loaded, tools: &Tools, revision: u64, raw_colors: bool) -> FrameRequest {
    let mut settings = scene.settings.clone();
    if raw_colors {
        settings.edl.strength = 0.0;
        settings.light.by = Lighting::Colors;
    }
    if let Some(pick) = tools.pick.as_ref().filter(|_| settings.reflection.show == Show::Error) {
        settings.reflection.point = pick.world.to_array().map(|value| value.to_string()).join(", ");
    }
    FrameRequest {
        camera: scene.camera,
        settings: idle::drawn(&settings),
        mirrors: all_mirrors(&scene.objects, tools.inspection.as_ref()).map(|(_, mirror)| mirror.clone()).collect(),
        lights: loaded.lights(scene),
        clues: loaded.clues(scene),
        size: scene.view_size,
        test: loaded.drawn_test.clone(),
        revision,
        spared: None,
        hurried: false,
        light_may_lag: loaded.light_may_lag(),
    }
}

/// What decides how good the next frame has to be.
pub fn situation(scene: &Scene, loaded: &Loaded, tools: &Tools, now: Instant, is_recorded: bool) -> Situation {
    let is_mirror = scene.selected.is_some_and(|id| scene.objects.mirror(id).is_some());
    Situation {
        points_come: loaded.points_come(),
        light_comes: !loaded.light_search.is_known(),
        soon_changes: loaded.soon_changes(),
        rest: scene.navigation.time_to_rest(now),
        a_mirror_is_dragged: is_mirror && tools.handle_is_grabbed,
        is_recorded,
        milliseconds: f64::from(scene.settings.view.frame_ms),
    }
}
