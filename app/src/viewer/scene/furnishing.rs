//! What a request to open something brings into the scene: view, objects, what is hidden, camera paths.

use std::time::Instant;

use scene::{Camera, Settings};
use world::Request;

use crate::viewer::objects::Origin;
use crate::viewer::requests::outside::Outside;
use crate::viewer::scene::Scene;

impl Scene {
    /// Brings everything but points, warnings and points that reflect. `is_empty` says that no cloud is open, so that
    /// the camera is the request's.
    pub fn furnish(&mut self, request: &mut Request, is_empty: bool, outside: &mut Outside) {
        let built_in_light = request.built_in_light();
        if let Some(view) = request.view.take() {
            match view.camera {
                Some(camera) if is_empty => self.begin(outside.now, view.settings, camera),
                _ => self.settings = view.settings,
            }
        }
        let built_in = built_in_light.map(|light| (light, Origin::BuiltIn));
        let lights = request.lights.drain(..).map(|light| (light, Origin::Person));
        self.bring_lights(lights.chain(built_in), outside);
        for mirror in request.mirrors.drain(..) {
            self.bring_mirror(mirror, None, outside);
        }
        self.bring_visibility(&request.visibility, std::mem::take(&mut request.clips));
        self.bring_objects(request.marks.drain(..));
        self.bring_paths(std::mem::take(&mut request.bookmarks), std::mem::take(&mut request.paths));
    }

    /// Shows the view of what is opened in an empty window. There is none before it that undo could go back to.
    fn begin(&mut self, now: Instant, settings: Settings, camera: Camera) {
        self.history.settle(&self.settings, &self.objects);
        self.history.bring_settings(&settings);
        (self.settings, self.camera, self.camera_is_placed) = (settings, camera, true);
        self.navigation.camera_moved(now);
    }
}
