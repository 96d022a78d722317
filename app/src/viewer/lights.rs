//! The lights of what is open: those that files bring, those that a person sets, and the one that comes of itself.

use cloud::Cloud;
use scene::{Lighting, SpotLight};
use serde_json::json;
use world::AutoLight;

use super::clouds::CloudEntry;
use super::session::Session;
use super::work::Work;

impl Session {
    /// Asks what is around the points that are shown, once they are all there.
    pub(super) fn ask_surroundings(&mut self) {
        let visible = self.clouds.iter().filter(|entry| entry.is_visible);
        let clouds: Vec<Cloud> = visible.map(|entry| entry.cloud.clone()).collect();
        if !self.is_loading() && clouds.iter().any(|cloud| !cloud.chunks.is_empty()) {
            let (asked, up) = (self.light_search.ask(), self.up());
            let test = self.scene.objects.visibility.test();
            self.outside.work(Work::FindSurroundings { asked, clouds, test, up });
        }
    }

    /// A scan of a room that has no light gets a lamp, which is no step of undo.
    pub(super) fn on_surroundings(&mut self, asked: u32, found: AutoLight) {
        if !self.light_search.answer(asked, found) {
            return;
        }
        let (id, lamp) = (self.scene.next_object_id(), found.lamp());
        self.scene.rewrite_objects(|objects| objects.guess(id, lamp));
        self.outside.log(json!({
            "event": "surroundings", "sky_is_open": self.sky_is_open(), "lights": self.scene.objects.lights.len(),
        }));
    }

    /// Whether a light would come of itself if what is open were opened anew.
    pub fn lacks_light(&self) -> bool {
        self.light_search.light.lamp().is_some() || self.clouds.iter().any(CloudEntry::is_built_in)
    }

    pub fn sky_is_open(&self) -> bool {
        self.light_search.light.sky_is_open()
    }

    /// The lights that are there to shine. From outside of a room its lamp would light nothing that is seen.
    pub(super) fn lights(&self) -> Vec<SpotLight> {
        let light = &self.light_search.light;
        if self.scene.objects.has_guess() && !light.lamp_shines(self.scene.settings.light.by, self.scene.camera.eye) {
            return Vec::new();
        }
        self.scene.objects.lights.iter().map(|placed| placed.light).collect()
    }

    /// What lights the points: what `auto` stands for now.
    pub fn lighting(&self) -> Lighting {
        self.scene.settings.light.lighting(!self.lights().is_empty(), self.sky_is_open())
    }

    /// Whether the picture shows the data's own colours.
    pub fn is_unlit(&self) -> bool {
        self.raw_colors || self.scene.settings.light.by == Lighting::Colors
    }
}
