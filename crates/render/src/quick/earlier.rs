//! The light that pictures at rest knew before the last one: whoever looks back at a place finds its light again.

use std::collections::VecDeque;
use std::sync::Arc;

use super::light::{Before, KnownLight, LIGHT, SeenLight};

/// The light of the pictures at rest before the last one, as long as they show places that later ones do not.
#[derive(Default)]
pub struct EarlierLight {
    /// The latest one first, with `SeenLight::normals`.
    views: VecDeque<(Arc<SeenLight>, Vec<[i8; 4]>)>,
}

impl EarlierLight {
    /// The most views: a look around, for 12 bytes a pixel each.
    const MOST: usize = 8;
    /// A view of which the next one knows so much is forgotten.
    const MOST_KNOWN: f32 = 0.9;
    /// One pixel in so many says how much that is.
    const SAMPLED: usize = 61;

    /// Keeps what `last` knows before `next` takes its place as the last picture at rest, and forgets views of which `next`
    /// knows nearly everything.
    pub fn keep(&mut self, last: &KnownLight, next: &KnownLight) {
        self.views.push_front((last.seen.clone(), last.seen.normals()));
        let normals = next.seen.normals();
        self.views.retain(|(view, _)| known_share(view, (&next.seen, &normals)) < Self::MOST_KNOWN);
        self.views.truncate(Self::MOST);
    }

    pub(super) fn views(&self) -> impl Iterator<Item = (&SeenLight, &[[i8; 4]])> {
        self.views.iter().map(|(view, normals)| (&**view, &normals[..]))
    }
}

/// The share of the light in a view that another one knows, too: 1 if it has none.
fn known_share(view: &SeenLight, (other, normals): (&SeenLight, &[[i8; 4]])) -> f32 {
    let before = Before::new(other, &view.camera);
    let lit = (0..view.light.len()).step_by(EarlierLight::SAMPLED).filter(|pixel| view.light[*pixel][3] == LIGHT);
    let (mut all, mut known) = (0, 0);
    for pixel in lit {
        all += 1;
        let (x, y) = (pixel % view.size[0], pixel / view.size[0]);
        known += u32::from(before.light_of_side(normals, x, y, view.depth[pixel]).is_some());
    }
    if all == 0 { 1.0 } else { known as f32 / all as f32 }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

    use glam::DVec3;
    use scene::{Camera, Settings};

    use super::*;
    use crate::frame::FrameCamera;
    use crate::quick::light::StillImages;

    const SIZE: [u32; 2] = [40, 30];

    /// A view of the plane x = 0 from a place, and its light, which is brighter on the side of positive x.
    fn view(from: DVec3, projection: &str) -> (FrameCamera, KnownLight) {
        let mut settings = Settings::default();
        settings.set_text("view.projection", projection).unwrap();
        let target = DVec3::new(0.0, from.y - 0.5 * from.y.clamp(-1.0, 1.0), 0.0);
        let camera = Camera::from_eye(from, target, DVec3::Z);
        let frame = FrameCamera::new(&camera, &settings.view, SIZE, DVec3::ZERO, 10.0);
        let place = |pixel: usize| {
            let [x, y] = [pixel % 40, pixel / 40].map(|place| place as f64 + 0.5);
            let [right, up] = [(x - 20.0) / frame.focal_pixels, (15.0 - y) / frame.focal_pixels];
            let axis = |row| frame.view_from_world.row(row);
            let across = axis(0) * right + axis(1) * up;
            let (start, sight) = match frame.orthographic {
                true => (frame.eye + across, axis(2)),
                false => (frame.eye, axis(2) + across),
            };
            (-start.x / sight.x) as f32
        };
        let pixels = (SIZE[0] * SIZE[1]) as usize;
        let depth: Vec<f32> = (0..pixels).map(place).collect();
        assert!(depth.iter().all(|depth| *depth > 0.0), "the view leaves the plane");
        let light = if from.x > 0.0 { 0.8 } else { 0.2 };
        let images = StillImages {
            depth,
            albedo: [0.5, 0.5, 0.5, 0.0].repeat(pixels),
            color: vec![light * 0.5; 4 * pixels],
            mirrors: None,
        };
        (frame, KnownLight::new(frame, images, 0.0, false))
    }

    #[test]
    fn light_is_taken_over_from_the_own_side_of_a_surface_alone() {
        for projection in ["perspective", "orthographic"] {
            let (_, before) = view(DVec3::new(4.0, 0.0, 0.0), projection);
            let places = [DVec3::new(3.0, 1.0, 0.5), DVec3::new(4.0, -1.5, 0.0), DVec3::new(-4.0, 0.5, 0.0)];
            for (place, is_same) in places.into_iter().zip([true, true, false]) {
                let (frame, now) = view(place, projection);
                let normals = before.seen.normals();
                let before = Before::new(&before.seen, &frame);
                let depth = now.seen.depth[15 * 40 + 20];
                assert!(before.light(20, 15, depth).is_some(), "{projection}: the place is not in the picture before");
                assert_eq!(
                    before.light_of_side(&normals, 20, 15, depth).is_some(),
                    is_same,
                    "{projection} from {place}"
                );
            }
        }
    }

    #[test]
    fn views_that_the_next_one_knows_are_forgotten_and_so_are_the_oldest() {
        let at = |x: f64, y: f64| view(DVec3::new(x, y, 0.0), "perspective").1;
        let mut earlier = EarlierLight::default();
        earlier.keep(&at(4.0, 0.0), &at(4.0, 0.05));
        assert_eq!(earlier.views.len(), 0, "the same view twice");
        earlier.keep(&at(4.0, 0.0), &at(-4.0, 0.0));
        assert_eq!(earlier.views.len(), 1, "the other side");
        earlier.keep(&at(-4.0, 0.0), &at(4.0, 0.05));
        assert_eq!(earlier.views.len(), 1, "that side again");
        for step in 0..20 {
            let [last, next] = [step, step + 1].map(|step| at(4.0, 20.0 * f64::from(step)));
            earlier.keep(&last, &next);
        }
        assert_eq!(earlier.views.len(), EarlierLight::MOST);
    }
}
