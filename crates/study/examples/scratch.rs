use cloud::Progress;
use scene::five_mirrors::{Variant, camera, light, sample};
use scene::*;
use study::*;
fn raw(name: &str) -> Vec<f32> {
    std::fs::read(name).unwrap().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}
fn main() {
    let p = Progress::default();
    let prefix = std::env::args().nth(1).unwrap();
    let variant = *Variant::ALL.iter().find(|v| prefix.starts_with(&format!("{}-", v.name()))).unwrap();
    let n = std::env::args().nth(2).map_or(1_600_000, |n| n.parse().unwrap());
    let get = |n: &str| raw(&format!("{prefix}-{n}.raw"));
    let (position, normal, mirror, mirror_position, color) =
        (get("position"), get("normal"), get("mirror"), get("mp"), get("color"));
    let rays = PixelRays::new(&camera(), &ViewSettings::default(), [800, 600], 0.0);
    let image = MirrorImage {
        size: [800, 600],
        viewpoint: rays.viewpoint(),
        mirror: &mirror,
        position: &position,
        normal: &normal,
        mirror_position: &mirror_position,
    };
    let parts = sample(variant, n, 1);
    let parts: Vec<Part> = parts
        .iter()
        .map(|part| Part {
            chunks: &part.chunks,
            specular_intensity: part.mirror.as_ref().map_or(0.0, |m| m.specular_intensity),
            plain: [0.5; 3],
        })
        .collect();
    let surfels = Surfels::new(&parts, 1.0, &p).unwrap();
    let exact = Exact::five_mirrors(variant);
    for (name, a) in
        [("same", accuracy_same_input(&image, &surfels, &p)), ("exact", accuracy_exact(&image, &rays, &exact, &p))]
    {
        let a = a.unwrap();
        println!(
            "{prefix} {name}: mirrors {} coverage {:.4} closed {:.4} false {:.5} pixel {:.3} {:.3} {:.3} occlusion {:.4}",
            a.mirror_pixels,
            a.coverage,
            a.closed_coverage,
            a.false_fill,
            a.pixel_error.median,
            a.pixel_error.p95,
            a.pixel_error.p99,
            a.occlusion_error
        );
    }
    let points: Vec<_> = image.points().unwrap();
    let dense: Vec<_> = points.iter().flatten().copied().collect();
    let lights = [light()];
    let lighting =
        Lighting { lights: &lights, bounces: 1, mirror: &MirrorSettings::default(), background: glam::DVec3::ZERO };
    let mut truth = trace::reflected_picture(&surfels, &dense, &lighting, &p).unwrap().into_iter();
    let mask: Vec<bool> = mirror.iter().map(|m| *m > 0.0).collect();
    let reference: Vec<[f32; 3]> =
        mask.iter().map(|m| if *m { truth.next().unwrap().as_vec3().to_array() } else { [0.0; 3] }).collect();
    let t = std::time::Instant::now();
    println!("  image {:?} in {:?}", image_error(800, &mask, color.as_chunks::<3>().0, &reference), t.elapsed());
    println!("  visible points {}", visible_points(&image, &surfels, &p).unwrap().len());
    let masks = mask
        .iter()
        .zip(trace::primary(&exact, &rays, &p).unwrap())
        .filter(|(a, b)| **a != b.is_some_and(|h| h.specular_intensity > 0.0))
        .count();
    println!("  masks differ at {masks}");
}
