//! Where the camera stands so that everything is in the picture, and how it gets there.

use std::time::Instant;

use cloud::Bounds;
use glam::DVec3;
use scene::{Camera, Settings, StandardView};
use world::mirrors;

use super::clouds::CloudEntry;
use super::lens::Lens;
use super::session::Session;

impl Session {
    /// Of what is visible, without stray points.
    pub fn bounds(&self) -> Bounds {
        let of = |entry: &CloudEntry| entry.figures.as_ref().map_or(entry.bounds, |figures| figures.bounds);
        let visible = self.clouds.iter().filter(|entry| entry.is_visible && entry.points > 0);
        let mut bounds = visible.fold(Bounds::EMPTY, |all, entry| all.union(of(entry)));
        if !bounds.is_empty() {
            self.objects
                .mirrors
                .iter()
                .flat_map(|placed| mirrors::outline(&placed.mirror))
                .for_each(|p| bounds.include(p));
        }
        bounds
    }

    pub fn up(&self) -> DVec3 {
        match self.settings.view.up {
            scene::UpAxis::Y => DVec3::Y,
            scene::UpAxis::Z => DVec3::Z,
            scene::UpAxis::Auto => self.clouds.first().map_or(DVec3::Z, |entry| entry.up),
        }
    }

    pub fn aspect(&self) -> f64 {
        f64::from(self.view_size[0].max(1)) / f64::from(self.view_size[1].max(1))
    }

    /// What sticks out furthest of the visible clouds: what framing has to keep in the picture.
    pub fn outline(&self) -> Vec<DVec3> {
        let visible = self.clouds.iter().filter(|entry| entry.is_visible);
        let of = |entry: &CloudEntry| match &entry.figures {
            Some(figures) => figures.outline.clone(),
            None if entry.bounds.is_empty() => Vec::new(),
            None => entry.bounds.corners().to_vec(),
        };
        let mirrors = self.objects.mirrors.iter().flat_map(|placed| mirrors::outline(&placed.mirror));
        visible.flat_map(of).chain(mirrors).collect()
    }

    pub fn framed(&self, outline: &[DVec3], view: StandardView) -> Camera {
        Camera::framing(outline, view, self.up(), self.settings.view.field_of_view, self.aspect())
    }

    /// Shows everything unless someone has chosen the camera: the clouds' outlines, or `bounds` while none is known.
    pub(super) fn frame_while_unplaced(&mut self, bounds: Bounds) {
        if self.camera_is_placed {
            return;
        }
        if self.clouds.iter().any(|entry| entry.is_visible && entry.figures.is_some()) {
            self.camera = self.framed(&self.outline(), StandardView::Isometric);
        } else if !bounds.is_empty() {
            self.camera = self.framed(&bounds.corners(), StandardView::Isometric);
        }
    }

    /// Pixels of the picture.
    pub fn set_view_size(&mut self, size: [u32; 2]) {
        if self.view_size != size {
            self.view_size = size;
            let bounds = self.bounds();
            self.frame_while_unplaced(bounds);
        }
    }

    /// Moves the camera at once, perhaps with other parameters: one step of undo.
    pub fn jump(&mut self, settings: Settings, camera: Camera) {
        self.history.before_jump(&self.settings, &self.objects, self.camera);
        self.settings = settings;
        self.camera = camera;
        self.camera_is_placed = true;
        self.history.after_jump(&self.settings, &self.objects);
        self.navigation.camera_moved(self.outside.now);
    }

    /// Puts the camera where a recording has it at `now`: no move that would be drawn in a hurry. Streamed clouds are looked at from
    /// there at once.
    pub fn stand(&mut self, camera: Camera, now: Instant) {
        self.outside.now = now;
        self.camera = camera;
        self.camera_is_placed = true;
        self.look_around();
    }

    pub fn lens(&self) -> Lens {
        Lens::new(&self.camera, &self.settings.view, self.view_size)
    }
}
