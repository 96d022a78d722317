//! Follows one ray by way of mirrors through the exact surfaces of a built-in scene:
//! `cargo run --release --example trace_ray`.

use glam::DVec3;
use scene::five_mirrors::{self, Variant};
use trace::{Exact, Geometry as _, Ray, mirrored};

const MOST_REFLECTIONS: usize = 8;

fn main() {
    let scene = Exact::five_mirrors(Variant::Sphere);
    let camera = five_mirrors::camera();
    // A little off the middle of the picture.
    let direction = (camera.pivot - camera.eye).normalize() + DVec3::new(0.02, 0.01, 0.0);
    let mut ray = Ray::from_eye(camera.eye, direction.normalize());
    for _ in 0..=MOST_REFLECTIONS {
        let Some(hit) = scene.nearest(&ray) else {
            println!("the ray leaves the scene");
            return;
        };
        let [x, y, z] = hit.position.to_array();
        println!("after {:.4} it meets object {} at {x:.4} {y:.4} {z:.4}", hit.distance, hit.surface);
        if hit.specular_intensity <= 0.0 {
            println!("object {} is no mirror, and has the linear colour {:.3}", hit.surface, hit.albedo);
            return;
        }
        ray = Ray::from_surface(hit.position, mirrored(ray.direction, hit.normal));
    }
    println!("more than {MOST_REFLECTIONS} reflections");
}
