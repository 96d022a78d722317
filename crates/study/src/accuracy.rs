//! Compares a renderer's images with the truth.

use std::collections::HashMap;

use cloud::Progress;
use glam::{DVec3, Vec3};
use trace::{Exact, Geometry, Hit, MirrorPoint, PixelRays, Reflection, Surfels, Viewpoint, primary, reflected};

use crate::metrics::{Accuracy, MirrorPixel, PixelError, Truth, accuracy, pixel_error, surface_error};

/// Why a frame could not be judged.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error("image {name} holds {found} values, expected {expected} for {width} x {height} pixels")]
    ImageSize { name: &'static str, found: usize, expected: usize, width: u32, height: u32 },
    #[error("no surfaces are known behind these points; only built-in scenes and meshes have an exact truth")]
    NoSurfaces,
    #[error("the comparison was cancelled")]
    Cancelled,
}

pub type Result<T, E = Error> = std::result::Result<T, E>;

/// The images of one frame, in the form of the output variables of the same names: rows top to bottom, channels
/// interleaved, world coordinates, NaN where a pixel is empty.
#[derive(Clone, Copy, Debug)]
pub struct MirrorImage<'a> {
    pub size: [u32; 2],
    pub viewpoint: Viewpoint,
    /// One channel, above 0 where a mirror is seen.
    pub mirror: &'a [f32],
    /// Three channels.
    pub position: &'a [f32],
    /// Three channels.
    pub normal: &'a [f32],
    /// Three channels and the coverage.
    pub mirror_position: &'a [f32],
}

impl MirrorImage<'_> {
    /// The mirror's points and the rays that see them, `None` where there is no mirror.
    ///
    /// # Errors
    /// An image whose size is not that of the frame.
    pub fn points(&self) -> Result<Vec<Option<MirrorPoint>>> {
        let [width, height] = self.size;
        let pixels = width as usize * height as usize;
        let images = [
            ("mirror", self.mirror, 1),
            ("position", self.position, 3),
            ("normal", self.normal, 3),
            ("mirror_position", self.mirror_position, 4),
        ];
        for (name, image, channels) in images {
            let (found, expected) = (image.len(), pixels * channels);
            if found != expected {
                return Err(Error::ImageSize { name, found, expected, width, height });
            }
        }
        let [positions, normals] = [self.position, self.normal].map(|image| image.as_chunks::<3>().0);
        let point = |((mirror, position), normal): ((&f32, &[f32; 3]), &[f32; 3])| {
            let position = Vec3::from(*position).as_dvec3();
            let incoming = self.viewpoint.toward(position);
            (*mirror > 0.0).then_some(MirrorPoint { position, normal: Vec3::from(*normal).as_dvec3(), incoming })
        };
        Ok(self.mirror.iter().zip(positions).zip(normals).map(point).collect())
    }

    /// Pairs what was found with the truth. `reflections` are in the order of those `points` that are some.
    fn pixels(&self, points: &[Option<MirrorPoint>], reflections: &[Reflection]) -> Vec<Option<MirrorPixel>> {
        let mut reflections = reflections.iter();
        let pixel = |(point, found): (&Option<MirrorPoint>, &[f32; 4])| {
            let (point, reflection) = (point.as_ref()?, reflections.next()?);
            let [x, y, z, coverage] = found.map(f64::from);
            // An empty pixel may have a coverage of NaN as well as of 0.
            let coverage = if coverage.is_nan() { 0.0 } else { coverage };
            Some(MirrorPixel {
                position: point.position,
                incoming: point.incoming,
                reflected: reflection.direction,
                found: DVec3::new(x, y, z),
                coverage,
                truth: reflection.first.map(|hit| hit.position),
            })
        };
        points.iter().zip(self.mirror_position.as_chunks::<4>().0).map(pixel).collect()
    }

    fn judge(
        &self,
        truth: Truth,
        points: &[Option<MirrorPoint>],
        geometry: &impl Geometry,
        progress: &Progress,
    ) -> Result<Accuracy> {
        let reflections = first_reflections(points, geometry, progress)?;
        Ok(accuracy(truth, self.size[0] as usize, &self.pixels(points, &reflections)))
    }
}

/// Judges a frame by rays from its own mirror points, with its own normals, into the points from which it was drawn: so
/// all errors are the method's. `progress` counts mirror pixels.
///
/// # Errors
/// Images of the wrong size; cancelled.
pub fn accuracy_same_input(image: &MirrorImage, surfels: &Surfels, progress: &Progress) -> Result<Accuracy> {
    let points = image.points()?;
    let reflections = first_reflections(&points, surfels, progress)?;
    let recall = recall(&points, &reflections, image.mirror_position, surfels);
    let accuracy = accuracy(Truth::SameInput, image.size[0] as usize, &image.pixels(&points, &reflections));
    Ok(Accuracy { recall: Some(recall), ..accuracy })
}

/// The error of each filled mirror pixel of a frame, judged as by [`accuracy_same_input`].
///
/// # Errors
/// Images of the wrong size; cancelled.
pub fn pixel_errors_same_input(
    image: &MirrorImage,
    surfels: &Surfels,
    progress: &Progress,
) -> Result<Vec<Option<PixelError>>> {
    let points = image.points()?;
    let pixels = image.pixels(&points, &first_reflections(&points, surfels, progress)?);
    Ok((0..pixels.len()).map(|index| pixel_error(image.size[0] as usize, &pixels, index)).collect())
}

/// The reflections at those points that are some, in order.
fn first_reflections(
    points: &[Option<MirrorPoint>],
    geometry: &impl Geometry,
    progress: &Progress,
) -> Result<Vec<Reflection>> {
    let mirrors: Vec<MirrorPoint> = points.iter().copied().flatten().collect();
    reflected(geometry, &mirrors, 1, progress).ok_or(Error::Cancelled)
}

/// Judges a frame by the rays through its pixel centres, which exact mirrors reflect into exact surfaces. Only pixels
/// count that are mirrors both in the frame and in truth. `progress` counts pixels, then mirror pixels.
///
/// # Errors
/// Images of the wrong size, or of another size than that of `rays`; cancelled.
pub fn accuracy_exact(image: &MirrorImage, rays: &PixelRays, exact: &Exact, progress: &Progress) -> Result<Accuracy> {
    let drawn = image.points()?;
    let seen = primary(exact, rays, progress).ok_or(Error::Cancelled)?;
    if seen.len() != drawn.len() {
        let [width, height] = rays.size;
        let (found, expected) = (drawn.len(), seen.len());
        return Err(Error::ImageSize { name: "mirror", found, expected, width, height });
    }
    let point = |(pixel, (drawn, hit)): (usize, (&Option<MirrorPoint>, &Option<Hit>))| {
        let hit = hit.filter(|hit| drawn.is_some() && hit.specular_intensity > 0.0)?;
        let incoming = rays.ray(pixel).direction;
        Some(MirrorPoint { position: hit.position, normal: hit.normal, incoming })
    };
    let points: Vec<_> = drawn.iter().zip(&seen).enumerate().map(point).collect();
    let positions: Vec<DVec3> =
        image.position.as_chunks::<3>().0.iter().map(|position| Vec3::from(*position).as_dvec3()).collect();
    let truly: Vec<DVec3> = seen.iter().map(|hit| hit.map_or(DVec3::NAN, |hit| hit.position)).collect();
    let surface = Some(surface_error(&positions, &truly));
    Ok(Accuracy { surface, ..image.judge(Truth::Exact, &points, exact, progress)? })
}

/// The share of the points truly visible by reflection that were found. A point is truly visible if its disc is the
/// first that the reflected ray of some mirror pixel meets; it is found if, in one of these pixels, the position found
/// lies on its disc. `reflections` are in the order of those `points` that are some. NaN if no point is visible.
fn recall(
    points: &[Option<MirrorPoint>],
    reflections: &[Reflection],
    mirror_position: &[f32],
    surfels: &Surfels,
) -> f64 {
    let pixels = points.iter().zip(mirror_position.as_chunks::<4>().0).filter(|(point, _)| point.is_some());
    let mut found: HashMap<(u32, u32), bool> = HashMap::new();
    for (reflection, (_, pixel)) in reflections.iter().zip(pixels) {
        let Some(hit) = reflection.first else { continue };
        let (center, radius) = surfels.disc(&hit);
        // In a gap between discs the ray meets none of them.
        if hit.position.distance(center) > radius * 1.01 {
            continue;
        }
        let [x, y, z, coverage] = pixel.map(f64::from);
        // A hundredth more: images hold 32-bit positions, and renderers pack their discs.
        let is_on_disc = coverage > 0.0 && DVec3::new(x, y, z).distance(center) <= radius * 1.01;
        *found.entry((hit.surface, hit.point)).or_default() |= is_on_disc;
    }
    found.values().filter(|is_found| **is_found).count() as f64 / found.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::image_error;
    use scene::five_mirrors::{Variant, camera, light, sample, walls};
    use scene::{MirrorSettings, ViewSettings};
    use trace::exact::{Albedo, Object};
    use trace::{Illuminant, Illumination, MaterialPoints, Ray, mirrored, picture};

    const SIZE: [u32; 2] = [120, 90];

    fn rays() -> PixelRays {
        PixelRays::new(&camera(), &ViewSettings::default(), SIZE, 0.0)
    }

    /// The images that a renderer would give.
    #[derive(Clone)]
    struct Frame {
        mirror: Vec<f32>,
        position: Vec<f32>,
        normal: Vec<f32>,
        mirror_position: Vec<f32>,
    }

    impl Frame {
        /// A frame without any error; `broken` turns the mirrors' normals before they reflect.
        fn traced(geometry: &impl Geometry, broken: fn(DVec3) -> DVec3) -> Self {
            let mut frame = Self { mirror: vec![], position: vec![], normal: vec![], mirror_position: vec![] };
            for pixel in 0..rays().pixel_count() {
                let ray = rays().ray(pixel);
                let hit = geometry.nearest(&ray);
                let [position, normal] = [hit.map(|hit| hit.position), hit.map(|hit| hit.normal)];
                let mirror = hit.filter(|hit| hit.specular_intensity > 0.0);
                let end = mirror.and_then(|hit| {
                    let normal = broken(hit.normal).normalize();
                    geometry.nearest(&Ray::from_surface(hit.position, mirrored(ray.direction, normal).normalize()))
                });
                let values = |position: Option<DVec3>| position.unwrap_or(DVec3::NAN).as_vec3().to_array();
                frame.mirror.push(if mirror.is_some() { 1.0 } else { 0.0 });
                frame.position.extend(values(position));
                frame.normal.extend(values(normal));
                frame.mirror_position.extend(values(end.map(|hit| hit.position)));
                frame.mirror_position.push(if end.is_some() { 1.0 } else { f32::NAN });
            }
            frame
        }

        fn image(&self) -> MirrorImage<'_> {
            let Self { mirror, position, normal, mirror_position } = self;
            MirrorImage { size: SIZE, viewpoint: rays().viewpoint(), mirror, position, normal, mirror_position }
        }

        fn exact(&self) -> Accuracy {
            let scene = Exact::five_mirrors(Variant::Sphere);
            accuracy_exact(&self.image(), &rays(), &scene, &Progress::default()).unwrap()
        }
    }

    fn sphere() -> Frame {
        Frame::traced(&Exact::five_mirrors(Variant::Sphere), |normal| normal)
    }

    fn surfels(points: u64) -> Surfels {
        let parts = sample(Variant::Sphere, points, 1);
        let parts: Vec<MaterialPoints> = parts
            .iter()
            .map(|part| {
                let specular_intensity = part.mirror.as_ref().map_or(0.0, |mirror| mirror.specular_intensity);
                MaterialPoints {
                    chunks: &part.chunks,
                    specular_intensity,
                    specular_power: 0.0,
                    clear: None,
                    plain: [0.5; 3],
                }
            })
            .collect();
        Surfels::new(&parts, 1.0, &Progress::default()).unwrap()
    }

    #[test]
    fn a_right_result_has_no_errors() {
        let figures = sphere().exact();
        assert!(figures.mirror_pixels > 1000, "{figures:?}");
        assert_eq!((figures.coverage, figures.closed_coverage, figures.false_fill), (1.0, 1.0, 0.0));
        // f32 of the images: 1e-7 of a direction is some 1e-5 degrees.
        assert!(figures.angle_error.p99 < 1e-4 && figures.pixel_error.p99 < 1e-3, "{figures:?}");
        assert_eq!(figures.occlusion_error, 0.0);
        let surface = figures.surface.expect("what the eye sees");
        assert_eq!((surface.missing, surface.false_fill), (0.0, 0.0));
        assert!(surface.position_error.p99 < 1e-6, "{surface:?}");
    }

    #[test]
    fn surfaces_that_are_missing_added_or_elsewhere_are_told() {
        let mut frame = sphere();
        let pixels = frame.mirror.len();
        // A tenth is missing, the others are five thousandths too far to the right.
        for (pixel, position) in frame.position.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            if pixel % 10 == 0 { position.fill(f32::NAN) } else { position[0] += 0.005 }
        }
        let surface = frame.exact().surface.expect("what the eye sees");
        assert!((surface.missing - 0.1).abs() < 1.0 / pixels as f64 && surface.false_fill == 0.0, "{surface:?}");
        assert!((surface.position_error.median - 0.005).abs() < 1e-6, "{surface:?}");
        // The truth sees nothing in a world without surfaces.
        let nothing = Exact::new(Vec::new());
        let figures = accuracy_exact(&sphere().image(), &rays(), &nothing, &Progress::default()).unwrap();
        let surface = figures.surface.expect("what the eye sees");
        assert!(surface.missing.is_nan() && surface.false_fill == 1.0, "{surface:?}");
        assert!(surface.position_error.median.is_nan());
    }

    #[test]
    fn a_shift_by_one_pixel_is_an_error_of_one_pixel() {
        let mut frame = sphere();
        frame.mirror_position.rotate_right(4);
        let figures = frame.exact();
        assert!((0.6..1.2).contains(&figures.pixel_error.median), "{figures:?}");
    }

    #[test]
    fn a_scale_of_five_percent_is_caught() {
        let mut frame = sphere();
        frame.mirror_position.as_chunks_mut::<4>().0.iter_mut().for_each(|[x, y, z, _]| {
            [x, y, z].into_iter().for_each(|value| *value *= 1.05);
        });
        let figures = frame.exact();
        assert!(figures.occlusion_error > 0.5, "{figures:?}");
    }

    #[test]
    fn flipped_normals_are_caught() {
        let scene = Exact::five_mirrors(Variant::Sphere);
        let sideways = Frame::traced(&scene, |normal| normal * DVec3::new(-1.0, 1.0, 1.0)).exact();
        assert!(sideways.pixel_error.median > 5.0, "{sideways:?}");
        let through = Frame::traced(&scene, |normal| normal * DVec3::new(1.0, 1.0, -1.0)).exact();
        assert!(through.pixel_error.median > 5.0, "{through:?}");
    }

    #[test]
    fn missing_and_closed_pixels_are_told_apart() {
        let mut frame = sphere();
        let mirrors: Vec<usize> = (0..frame.mirror.len()).filter(|&pixel| frame.mirror[pixel] > 0.0).collect();
        for (order, pixel) in mirrors.iter().enumerate() {
            match order % 4 {
                0 => frame.mirror_position[4 * pixel..4 * pixel + 4].fill(f32::NAN),
                1 => frame.mirror_position[4 * pixel + 3] = 0.5,
                _ => {}
            }
        }
        let figures = frame.exact();
        assert!((figures.coverage - 0.5).abs() < 1e-3 && (figures.closed_coverage - 0.75).abs() < 1e-3, "{figures:?}");
        assert!(figures.pixel_error.p99 < 1e-3);
    }

    #[test]
    fn filling_what_is_open_is_false() {
        // The box without its front, which is the last wall: the sphere sees out past the camera.
        let mut frame = sphere();
        let wall =
            |(surface, albedo)| Object::new(surface, cloud::sampling::Placement::ORIGIN, Albedo::At(albedo), 0.0);
        let mirror = &Variant::Sphere.mirrors()[0];
        let (surface, placement) = mirror.surface();
        let objects = walls().into_iter().take(5).map(wall);
        let sphere = Object::new(surface, placement, Albedo::Even([0.5; 3]), 1.0);
        let open = Exact::new(objects.chain([sphere]).collect());
        let judge = |frame: &Frame| accuracy_exact(&frame.image(), &rays(), &open, &Progress::default()).unwrap();
        let filled = judge(&frame);
        let seen = Frame::traced(&open, |normal| normal);
        let open_pixels = (seen.mirror.iter().zip(seen.mirror_position.as_chunks::<4>().0))
            .filter(|(mirror, found)| **mirror > 0.0 && found[3].is_nan())
            .count();
        let share = open_pixels as f64 / filled.mirror_pixels as f64;
        assert!(share > 0.05 && (filled.false_fill - share).abs() < 1e-12, "{share}, {filled:?}");
        frame.mirror_position = seen.mirror_position;
        assert_eq!(judge(&frame).false_fill, 0.0);
    }

    #[test]
    fn the_same_input_is_judged_without_the_error_of_sampling() {
        let surfels = surfels(200_000);
        let frame = Frame::traced(&surfels, |normal| normal);
        let figures = accuracy_same_input(&frame.image(), &surfels, &Progress::default()).unwrap();
        assert_eq!((figures.truth, figures.coverage, figures.false_fill), (Truth::SameInput, 1.0, 0.0));
        assert!(figures.pixel_error.p99 < 1e-3 && figures.occlusion_error < 1e-3, "{figures:?}");
        let exact = frame.exact();
        assert_eq!(exact.truth, Truth::Exact);
        assert!(exact.pixel_error.median > 10.0 * figures.pixel_error.median, "{exact:?}");
        assert!(exact.pixel_error.p95 < 5.0 && exact.coverage > 0.99, "{exact:?}");
        let mut shifted = frame.clone();
        shifted.mirror_position.rotate_right(4);
        let figures = accuracy_same_input(&shifted.image(), &surfels, &Progress::default()).unwrap();
        assert!(figures.pixel_error.median > 0.5, "{figures:?}");
    }

    #[test]
    fn broken_pictures_are_caught() {
        let settings = MirrorSettings::default();
        let lights = [light()];
        let illumination = Illumination { bounces: 1, ..Illumination::new(Illuminant::Lights(&lights), &settings) };
        let scene = Exact::five_mirrors(Variant::Sphere);
        let colors = picture(&scene, &rays(), &illumination, &Progress::default()).unwrap();
        let colors: Vec<[f32; 3]> =
            colors.into_iter().map(|color| color.unwrap_or(DVec3::ZERO).as_vec3().to_array()).collect();
        let mirror: Vec<bool> = sphere().mirror.iter().map(|mirror| *mirror > 0.0).collect();
        let error = |picture: &[[f32; 3]]| image_error(SIZE[0] as usize, &mirror, picture, &colors);
        assert_eq!(error(&colors).rmse, 0.0);
        let mut shifted = colors.clone();
        shifted.rotate_right(1);
        let dimmed: Vec<[f32; 3]> = colors.iter().map(|color| color.map(|value| value * 0.5)).collect();
        for (broken, what) in [(shifted, "shifted"), (dimmed, "dimmed")] {
            let error = error(&broken);
            assert!(error.rmse > 0.005 && error.delta_e > 0.3 && error.flip > 0.01, "{what}: {error:?}");
        }
    }

    #[test]
    fn images_of_the_wrong_size_and_cancelling_are_errors() {
        let mut frame = sphere();
        let scene = Exact::five_mirrors(Variant::Sphere);
        let cancelled = Progress::default();
        cancelled.cancel();
        assert!(matches!(accuracy_exact(&frame.image(), &rays(), &scene, &cancelled), Err(Error::Cancelled)));
        frame.normal.pop();
        let error = accuracy_exact(&frame.image(), &rays(), &scene, &Progress::default()).unwrap_err();
        let expected = "image normal holds 32399 values, expected 32400 for 120 x 90 pixels";
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn recall_is_the_share_of_the_visible_points_that_were_found() {
        // The eye is at z = 2 above a mirror of |x|, |y| <= 1 in z = 0, under a ceiling at z = 3: seen through the
        // mirror from z = -2, it shows |x|, |y| <= 2.5.
        let radius = 0.1;
        let positions: Vec<[f32; 3]> = (0..10_000)
            .map(|index| [(index % 100) as f32 * 0.1 - 4.95, (index / 100) as f32 * 0.1 - 4.95, 3.0])
            .collect();
        let chunk = cloud::Chunk {
            normals: Some(vec![cloud::pack_normal(Vec3::Z); positions.len()].into()),
            radii: Some(vec![cloud::pack_radius(radius); positions.len()].into()),
            ..cloud::Chunk::new(0, DVec3::ZERO, positions.clone())
        };
        let part = MaterialPoints {
            chunks: &[chunk],
            specular_intensity: 0.0,
            specular_power: 0.0,
            clear: None,
            plain: [0.5; 3],
        };
        let surfels = Surfels::new(&[part], 1.0, &Progress::default()).unwrap();
        let mirror = |index: usize| [(index % 200) as f32 * 0.01 - 0.995, (index / 200) as f32 * 0.01 - 0.995, 0.0];
        let position: Vec<f32> = (0..40_000).flat_map(mirror).collect();
        let normal = [0.0, 0.0, 1.0].repeat(40_000);
        let judge = |mirror_position: &[f32]| {
            let viewpoint = Viewpoint::Eye(DVec3::Z * 2.0);
            let mirror = vec![1.0; 40_000];
            let image = MirrorImage {
                size: [200, 200],
                viewpoint,
                mirror: &mirror,
                position: &position,
                normal: &normal,
                mirror_position,
            };
            accuracy_same_input(&image, &surfels, &Progress::default()).unwrap().recall.unwrap()
        };
        // The mirror is halfway between the eye and its image: a place of the mirror shows a point at 2.5 times its
        // coordinates.
        let seen = |index: usize, coverage: f32| {
            let [x, y, _] = mirror(index);
            [x * 2.5, y * 2.5, 3.0, coverage]
        };
        assert_eq!(judge(&(0..40_000).flat_map(|index| seen(index, 1.0)).collect::<Vec<_>>()), 1.0);
        assert_eq!(judge(&vec![0.0; 160_000]), 0.0);
        // Nothing in the left half; discs on the border are seen from both sides.
        let half = judge(
            &(0..40_000).flat_map(|index| seen(index, if index % 200 < 100 { 0.0 } else { 1.0 })).collect::<Vec<_>>(),
        );
        assert!((half - 0.5).abs() < 0.02, "{half}");
        // A splat's width beside the truth.
        let beside = |index: usize| seen(index, 1.0).map(|v| if v == 3.0 { v } else { v + 2.5 * radius });
        assert!(judge(&(0..40_000).flat_map(beside).collect::<Vec<_>>()) < 0.01);
    }
}
