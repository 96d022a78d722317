//! The light that pictures at rest knew before the last one, and what is known besides: whoever looks back at a place finds
//! its light again, and who turns the head finds what lies around lit.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::DVec3;

use super::light::{Before, KnownLight, LIGHT, SeenLight};

/// A view with what `SeenLight::normals` says of it.
type View = (Arc<SeenLight>, Vec<[i8; 4]>);

/// The light of pictures at rest. The pictures before the last one are kept as long as they show places that later ones do
/// not show.
#[derive(Default)]
pub struct EarlierLight {
    last: Option<View>,
    /// Those before it, the latest one first.
    views: VecDeque<View>,
    /// Coarser views: of what lies around the eyes of pictures at rest, and of what coarse frames showed, the latest one
    /// first.
    coarse: VecDeque<View>,
}

/// The most views before the last one: a look around.
const MOST: usize = 8;
/// The most pixels of all of them, which take 12 bytes each.
const MOST_PIXELS: usize = 10_000_000;
/// The most coarser views: what lies around two eyes, and as many of coarse frames.
const MOST_COARSE: usize = 24;
/// A view of which the next one knows so much is forgotten.
const MOST_KNOWN: f32 = 0.9;
/// One pixel in so many along each side says how much that is.
const SAMPLED: usize = 8;

impl EarlierLight {
    /// Adds the light of a picture at rest, and forgets pictures of which it knows nearly everything.
    pub fn add(&mut self, known: &KnownLight) {
        let next = (known.seen.clone(), known.seen.normals());
        self.views.extend(self.last.take());
        self.views.rotate_right(1.min(self.views.len()));
        self.views.retain(|view| known_share(view, &next) < MOST_KNOWN);
        self.views.truncate(MOST);
        let mut pixels = 0;
        let mut is_within = |(seen, _): &View| {
            pixels += seen.light.len();
            pixels <= MOST_PIXELS
        };
        let within = self.views.iter().take_while(|view| is_within(view)).count();
        self.views.truncate(within);
        self.last = Some(next);
    }

    /// Adds the light of a coarser picture, which is not that of a place that pictures at rest show.
    pub fn add_coarse(&mut self, known: &KnownLight) {
        self.coarse.push_front((known.seen.clone(), known.seen.normals()));
        self.coarse.truncate(MOST_COARSE);
    }

    /// The directions in which coarser pictures from an eye look.
    pub fn directions_from(&self, eye: DVec3) -> impl Iterator<Item = DVec3> {
        let cameras = self.coarse.iter().map(|(view, _)| &view.camera);
        cameras.filter(move |camera| camera.eye == eye).map(|camera| camera.view_from_world.row(2))
    }

    /// The views before the last one, and the coarser ones.
    pub(super) fn views(&self) -> impl Iterator<Item = (&SeenLight, &[[i8; 4]])> {
        self.views.iter().chain(&self.coarse).map(|(view, normals)| (&**view, &normals[..]))
    }
}

/// The share of the light in a view, as far as other views may take it over, that another view knows, too: 1 if it has none.
fn known_share((view, normals): &View, (other, of_other): &View) -> f32 {
    let before = Before::new(other, &view.camera);
    let [width, height] = view.size;
    let (mut all, mut known) = (0, 0);
    for (x, y) in (0..height).step_by(SAMPLED).flat_map(|y| (0..width).step_by(SAMPLED).map(move |x| (x, y))) {
        let pixel = y * width + x;
        if view.light[pixel][3] == LIGHT && normals[pixel] != [0; 4] {
            all += 1;
            known += u32::from(before.light_of_side(of_other, x, y, view.depth[pixel]).is_some());
        }
    }
    if all == 0 { 1.0 } else { known as f32 / all as f32 }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

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
        let mut kept = |known: KnownLight| {
            earlier.add(&known);
            earlier.views.iter().map(|(view, _)| view.camera.eye.x).collect::<Vec<_>>()
        };
        assert_eq!(kept(at(4.0, 0.0)), []);
        assert_eq!(kept(at(4.1, 0.05)), [], "the same view twice");
        assert_eq!(kept(at(-4.0, 0.0)), [4.1], "the other side");
        assert_eq!(kept(at(4.2, 0.05)), [-4.0], "that side again");
        let many: Vec<_> = (1..=20).map(|step| kept(at(4.0 + f64::from(step), 30.0 * f64::from(step)))).collect();
        assert_eq!(many[19], [23.0, 22.0, 21.0, 20.0, 19.0, 18.0, 17.0, 16.0]);
        // Where every other line of pixels is empty, the same view is the same, too.
        let mut earlier = EarlierLight::default();
        for _ in 0..3 {
            let mut known = at(4.0, 0.0);
            let seen = Arc::get_mut(&mut known.seen).unwrap();
            let empty = |pixel: &usize| (pixel / 40) % 3 == 1;
            for pixel in (0..seen.depth.len()).filter(empty) {
                (seen.depth[pixel], seen.light[pixel]) = (0.0, [0; 4]);
            }
            earlier.add(&known);
        }
        assert_eq!(earlier.views.len(), 0);
    }

    #[test]
    fn what_mirrors_show_is_brightened_as_the_rest_is() {
        let (_, known) = view(DVec3::new(4.0, 0.0, 0.0), "perspective");
        let linear = |srgb: f32| if srgb <= 0.040_45 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) };
        let srgb = |linear: f32| {
            let linear = linear.min(1.0);
            if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
        };
        for stops in [-1.5_f32, 0.0, 0.7] {
            let exposed = known.exposed(stops);
            for part in 0..255 {
                let expected = srgb(linear(part as f32 / 255.0) * stops.exp2()) * 255.0;
                let found = f32::from(exposed[part]);
                assert!(
                    (found - expected).abs() <= 1.5 * stops.exp2().max(1.0),
                    "{part}, {stops}: {found}, {expected}"
                );
            }
        }
    }
}
