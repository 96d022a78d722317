//! What a drag turns: the head, or the eye about a point, which gives way to what stands between.

use glam::DVec3;
use scene::Camera;

use crate::viewer::scene::confines::Confines;

/// The number of halvings that find how far a move of the mouse may go: to a thirtieth of it.
const HALVINGS: u32 = 5;

/// What a drag turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turn {
    Head,
    About(Orbit),
}

/// A turn about a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    pub center: DVec3,
    /// The camera as it would be if nothing stood in its way.
    free: Camera,
    /// The camera as this orbit has left it.
    shown: Camera,
    /// Whether the eye comes nearer where something would come between it and the centre.
    yields: bool,
    /// Whether the point under the cursor is still being looked up.
    pub awaits: bool,
}

impl Orbit {
    /// A camera that was pulled nearer before, and not moved since, begins where it would be without that.
    pub fn new(center: DVec3, camera: Camera, before: Option<&Self>, confines: &Confines) -> Self {
        let free = before.filter(|before| before.shown == camera && before.center == center).map(|before| before.free);
        let free = free.unwrap_or(camera);
        let arm = confines.arm(center, free.eye, camera.up);
        let yields = arm.is_some_and(|arm| arm >= center.distance(camera.eye) * (1.0 - 1e-9));
        Self { center, free, shown: camera, yields, awaits: false }
    }

    /// Turns by two angles, as far as nothing stops the eye. Returns the camera that is shown.
    pub fn turn(&mut self, turn: f64, tilt: f64, now: Camera, confines: &Confines) -> Camera {
        if now != self.shown {
            self.free = now;
        }
        for [turn, tilt] in [[turn, 0.0], [0.0, tilt]] {
            let turned = |share: f64| {
                let mut camera = self.free;
                camera.orbit_about(self.center, turn * share, tilt * share);
                let shown = self.pulled(camera, confines);
                confines.lets(self.shown.eye, shown.eye, shown.up).then_some((camera, shown))
            };
            let (mut low, mut high) = (0.0, 1.0);
            let mut best = turned(high);
            for _ in 0..if best.is_some() { 0 } else { HALVINGS } {
                let middle = (low + high) * 0.5;
                match turned(middle) {
                    Some(found) => (low, best) = (middle, Some(found)),
                    None => high = middle,
                }
            }
            (self.free, self.shown) = best.unwrap_or((self.free, self.shown));
        }
        self.shown
    }

    /// The camera, nearer to the centre where something comes between.
    fn pulled(&self, mut camera: Camera, confines: &Confines) -> Camera {
        let distance = self.center.distance(camera.eye);
        let arm = confines.arm(self.center, camera.eye, camera.up).filter(|_| self.yields);
        if let Some(arm) = arm.filter(|arm| *arm < distance) {
            camera.zoom_toward(self.center, arm / distance);
        }
        camera
    }

    /// Takes in that the pivot of the camera was moved along the line of sight.
    pub fn on_pivot(&mut self, camera: Camera) {
        if self.free.eye == camera.eye {
            (self.free, self.shown) = (camera, camera);
        }
    }
}
