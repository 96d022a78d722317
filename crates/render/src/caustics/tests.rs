//! The light that mirrors throw onto a surface by the GPU and by the CPU twin, and what merging photons leaves as it is.

use cloud::Cloud;
use glam::{DVec3, Vec3, Vec4};
use scene::five_mirrors::{self, Variant};
use scene::{MirrorSurface, Settings};

use super::grid::Grid;
use crate::gpu::Gpu;
use crate::layout::Landed;
use crate::{Aov, ColorPlan, Frame, Material, Objects, PointStore, Renderer};

#[test]
fn a_surface_gets_the_light_that_the_twin_says() {
    let Some(gpu) = Gpu::shared() else { return };
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let mut store = PointStore::new(gpu);
    let parts = five_mirrors::sample(Variant::Sphere, 60_000, 1);
    for part in parts.into_iter().filter(|part| part.mirror.is_none()) {
        let id = store.add_cloud(Material::default());
        let ids: Vec<_> = part.chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
        let cloud = Cloud { chunks: part.chunks, ..Cloud::default() };
        let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Y);
        store.set_color(id, &cloud, &ids, &plan, DVec3::Y).unwrap();
    }
    let (mirrors, lights) = (Variant::Sphere.mirrors(), [five_mirrors::light()]);
    let objects = Objects { mirrors: &mirrors, lights: &lights, ..Objects::default() };
    let mut settings = Settings::default();
    settings.gi.bounces = 0;
    settings.mirror.surface = MirrorSurface::Exact;
    let mut direct = [0, 20_000].map(|photons| {
        settings.light.photons = photons;
        renderer.render(&store, &Frame::new(&five_mirrors::camera(), &settings, objects, [64, 48])).unwrap();
        renderer.read_aov(Aov::Direct).unwrap().data
    });
    let [positions, normals, albedos, mirrors] =
        [Aov::Position, Aov::Normal, Aov::Albedo, Aov::Mirror].map(|aov| renderer.read_aov(aov).unwrap().data);
    let thrown = renderer.caustics.thrown().unwrap();
    let vector = |data: &[f32], pixel: usize| Vec3::from_slice(&data[3 * pixel..]);
    let (mut lit, mut compared) = (0, 0);
    for pixel in (0..mirrors.len()).filter(|pixel| mirrors[*pixel] == 0.0) {
        let expected = thrown.irradiance(vector(&positions, pixel).as_dvec3(), vector(&normals, pixel))
            * vector(&albedos, pixel)
            * std::f32::consts::FRAC_1_PI;
        let [without, with] = direct.each_mut().map(|light| vector(light, pixel));
        // Colours and light are halves.
        let most = 0.002 * (with.max_element() + expected.max_element()) + 1e-5;
        assert!(((with - without) - expected).abs().max_element() < most, "{pixel}: {with} {without} {expected}");
        lit += usize::from(expected.max_element() > 1e-3);
        compared += 1;
    }
    assert!(compared > 2000 && lit > 500, "{lit} of {compared} pixels are lit");
}

/// Photons on a square in z = 0 between 0 and 1, one in each cell of a raster that is shifted a little, all of equal power,
/// which is 1 together.
fn on_square(edge: u32, normal: Vec3) -> Vec<Landed> {
    let at = |i: u32| (i as f32 + 0.37) / edge as f32;
    let place = |i: u32| Vec4::new(at(i % edge), at(i / edge), 0.0, 1.0);
    let power = Vec4::splat(1.0 / (edge * edge) as f32);
    let normal = normal.extend(0.0);
    (0..edge * edge).map(|i| Landed { position: place(i), normal, power, ..Landed::default() }).collect()
}

#[test]
fn photons_that_lie_close_together_are_merged_without_loss_and_those_of_another_side_do_not_count() {
    for edge in [100, 500] {
        let mut landed = on_square(edge, Vec3::Z);
        landed.extend(on_square(edge, -Vec3::Z));
        landed.extend(on_square(edge, Vec3::X));
        let grid = Grid::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.5), 0.1, &mut landed);
        // A sixteenth of a cell for each side.
        let most = if edge == 100 { 3 * 1600 } else { 3 * 1600 + 300 };
        assert!(grid.vectors().count() <= 3 * most, "{} photons", grid.vectors().count() / 3);
        for place in [Vec3::new(0.5, 0.5, 0.0), Vec3::new(0.31, 0.72, 0.0), Vec3::new(0.31, 0.72, 0.01)] {
            let light = grid.irradiance(place, Vec3::Z);
            assert!((light.x - 1.0).abs() < 0.03, "{light} at {place} by {edge}");
        }
        let slanted = grid.irradiance(Vec3::new(0.5, 0.5, 0.0), Vec3::new(0.4, 0.0, 0.9));
        assert!((slanted.x - 1.0).abs() < 0.03, "{slanted}");
        assert_eq!(grid.irradiance(Vec3::new(0.5, 0.5, 0.0), Vec3::Y), Vec3::ZERO);
        assert_eq!(grid.irradiance(Vec3::new(0.5, 0.5, 0.2), Vec3::Z), Vec3::ZERO);
        assert_eq!(grid.irradiance(Vec3::splat(1e9), Vec3::Z), Vec3::ZERO);
    }
}
