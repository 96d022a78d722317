//! The lights of what is open: lights from files, lights that a person has placed, and the light that glint adds on its
//! own.

use cloud::Cloud;
use scene::{LightClues, Lighting, SpotLight};
use serde_json::json;
use world::AutoLight;

use crate::viewer::loaded::{Beside, Loaded};
use crate::viewer::objects::clouds::{CloudEntry, colored_chunks};
use crate::viewer::requests::work::Work;
use crate::viewer::scene::Scene;

impl Loaded {
    /// Asks a worker what surrounds the points of the clouds that are shown, once they are all loaded. Hidden points
    /// count: the light stays when somebody hides points.
    pub fn ask_surroundings(&mut self, beside: &mut Beside<'_>) {
        let visible = self.clouds.iter().filter(|entry| entry.is_visible);
        let clouds: Vec<Cloud> = visible.map(|entry| entry.cloud.clone()).collect();
        if !self.is_loading() && clouds.iter().any(|cloud| !cloud.chunks.is_empty()) {
            let (asked, up) = (self.light_search.ask(), beside.scene.up(&self.clouds));
            beside.outside.work(Work::FindSurroundings { asked, clouds, up });
        }
    }

    /// Adds a lamp to the scan of a room that has no light. Undo does not count this as a step.
    pub fn on_surroundings(&mut self, asked: u32, found: AutoLight, beside: &mut Beside<'_>) {
        if !self.light_search.answer(asked, found) {
            return;
        }
        let found = &self.light_search.light;
        let (id, lamp) = (beside.scene.next_object_id(), found.lamp());
        beside.scene.room = found.camera_inside(beside.scene.up(&self.clouds));
        beside.scene.confines.interior = found.interior.clone();
        beside.scene.frame_while_unplaced(beside.scene.bounds(&self.clouds), &self.clouds);
        beside.scene.rewrite_objects(|objects| objects.guess(id, lamp));
        beside.outside.log(json!({
            "event": "surroundings", "sky_is_open": self.sky_is_open(), "lights": beside.scene.objects.lights.len(),
        }));
    }

    /// Whether glint would add a light on its own if the same files were opened again.
    pub fn lacks_light(&self) -> bool {
        self.light_search.light.lamp().is_some() || self.clouds.iter().any(CloudEntry::is_built_in)
    }

    pub fn sky_is_open(&self) -> bool {
        self.light_search.light.sky_is_open()
    }

    /// The lights that shine. A room's lamp is left out when the camera is outside of the room, because it would light
    /// nothing that is visible.
    pub fn lights(&self, scene: &Scene) -> Vec<SpotLight> {
        let lights = scene.objects.lights.iter().map(|placed| placed.light).collect();
        let (by, eye) = (scene.settings.light.by, scene.camera.eye);
        world::shining(lights, scene.objects.has_guess(), &self.light_search.light, by, eye)
    }

    /// What decides about automatic light now, besides the lights.
    pub fn clues(&self, scene: &Scene) -> LightClues {
        self.light_search.light.clues(colored_chunks(&self.clouds, &scene.objects), scene.objects.has_guess())
    }

    /// How the points are lit: what `auto` means now.
    pub fn lighting(&self, scene: &Scene) -> Lighting {
        scene.settings.resolved_light(!self.lights(scene).is_empty(), self.clues(scene)).by
    }
}
