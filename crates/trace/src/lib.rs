//! The truth: a CPU ray tracer over the same surfels that the renderer draws, and over exact surfaces: formulas and
//! triangles.
//!
//! The ray tracer judges the renderer and therefore shares no code with it. Everything that decides where a ray ends is f64.
//! Pictures are computed on all cores and do not depend on their number.
//!
//! Rays are traced in [`Surfels`] and [`Exact`]; [`PixelRays`] are the rays of a picture's pixel centres; [`reflected`]
//! follows the eye's rays from a camera G-buffer into mirrors; [`picture`] lights what they see, and
//! [`indirect_picture`] computes the part of that light that comes from other surfaces and the sky. [`Caustics`] are
//! what mirrors throw from lamps and the sun.

mod camera;
mod caustics;
pub mod exact;
mod fading;
mod half_lobe;
mod indirect;
mod light;
mod mesh;
mod photons;
mod ray;
mod reflectance;
mod reflection;
mod refraction;
pub mod scan;
mod share;
mod surfels;
mod tree;

pub use camera::{PixelRays, Viewpoint};
pub use caustics::Caustics;
pub use exact::Exact;
pub use half_lobe::{HalfLobe, Lobe};
pub use indirect::{Indirect, indirect, indirect_picture};
pub use light::{Fill, Illuminant, Illumination, Sunlight, direct, picture, radiance, reflected_picture};
pub use mesh::{Mesh, Vertex};
pub use photons::Photons;
pub use ray::{Clear, Geometry, Hit, Medium, Ray, SELF_DISTANCE, Side};
pub use reflectance::Gloss;
pub use reflection::{MirrorPoint, Reflection, mirrored, primary, reflected};
pub use refraction::{INNER_REFLECTIONS, reflected_share, refracted, through};
pub use surfels::{MaterialPoints, Surfels, linear_from_srgb};
