//! The light that mirrors throw onto a surface by the GPU and by the CPU twin, and how photons spread theirs.

use cloud::Cloud;
use glam::{DVec3, Vec3, Vec4};
use scene::five_mirrors::{self, Variant};
use scene::{MirrorSurface, Settings};

use super::grid::{Grid, thin};
use super::near::{NEIGHBOURS, Tree};
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
    // In the small picture each pixel walks all photons, in the large one many take light from the nodes about them.
    for (size, most_off) in [([64, 48], 0.004), ([400, 300], 0.01)] {
        let mut direct = [0, 20_000].map(|photons| {
            settings.light.photons = photons;
            renderer.render(&store, &Frame::new(&five_mirrors::camera(), &settings, objects, size)).unwrap();
            renderer.read_aov(Aov::Direct).unwrap().data
        });
        let [positions, normals, albedos, mirrors] =
            [Aov::Position, Aov::Normal, Aov::Albedo, Aov::Mirror].map(|aov| renderer.read_aov(aov).unwrap().data);
        let thrown = renderer.caustics.thrown().unwrap();
        let vector = |data: &[f32], pixel: usize| Vec3::from_slice(&data[3 * pixel..]);
        let (mut lit, mut compared, mut interpolated, mut squares, mut sum) = (0, 0, 0, 0.0, 0.0);
        for pixel in (0..mirrors.len()).filter(|pixel| mirrors[*pixel] == 0.0) {
            let expected = thrown.irradiance(vector(&positions, pixel).as_dvec3(), vector(&normals, pixel))
                * vector(&albedos, pixel)
                * std::f32::consts::FRAC_1_PI;
            let [without, with] = direct.each_mut().map(|light| vector(light, pixel));
            let off = ((with - without) - expected).abs().max_element();
            // Colours and light are halves.
            let most = 0.002 * (with.max_element() + expected.max_element()) + 1e-5;
            assert!(size[0] > 64 || off < most, "{pixel}: {with} {without} {expected}");
            interpolated += usize::from(off >= most);
            (squares, sum) = (squares + f64::from(off).powi(2), sum + f64::from(expected.max_element()));
            lit += usize::from(expected.max_element() > 1e-3);
            compared += 1;
        }
        let off = (squares * f64::from(compared)).sqrt() / sum;
        println!("{size:?}: {compared} pixels, {lit} lit, {interpolated} interpolated, relative RMSE {off}");
        assert!(compared as usize > mirrors.len() / 2 && lit > mirrors.len() / 6, "{lit} of {compared} pixels are lit");
        assert!(off < most_off, "{off} at {size:?}");
        // Rounding alone, without light of nodes, makes no such difference.
        assert!(size[0] == 64 || interpolated * 100 > lit, "{interpolated} pixels take light from nodes");
    }
}

/// Photons of equal power on a square whose corner is the origin, one in each cell of a raster; together they have `power`.
fn on_square(edge: u32, sides: [Vec3; 2], power: f32) -> Vec<Landed> {
    let at = |i: u32| (i as f32 + 0.5) / edge as f32;
    let place = |i: u32| (sides[0] * at(i % edge) + sides[1] * at(i / edge)).extend(1.0);
    let power = Vec4::splat(power / (edge * edge) as f32);
    let normal = sides[0].cross(sides[1]).normalize().extend(0.0);
    (0..edge * edge).map(|i| Landed { position: place(i), normal, power, ..Landed::default() }).collect()
}

#[test]
fn a_floor_has_the_light_of_its_own_photons_up_to_the_wall_and_none_behind_it() {
    for edge in [40, 200] {
        let mut landed = on_square(edge, [Vec3::X, Vec3::Y], 1.0);
        landed.extend(on_square(edge / 2, [Vec3::Y, Vec3::Z], 8.0));
        // A ceiling beneath the floor.
        landed.extend(on_square(edge, [Vec3::Y, Vec3::X], 1.0));
        let grid = Grid::new(0.3, &mut landed);
        for x in [0.0, 0.01, 0.05, 0.1, 0.5] {
            for y in [0.31, 0.5, 0.72] {
                let light = grid.irradiance(Vec3::new(x, y, 0.0), Vec3::Z);
                assert!((light.x - 1.0).abs() < 0.02, "{light} at {x}, {y} by {edge}");
                let light = grid.irradiance(Vec3::new(0.0, y, x), Vec3::X);
                assert!((light.x - 8.0).abs() < 0.3, "{light} on the wall at {x}, {y} by {edge}");
            }
        }
        // No wall says that the floor ends on the other side, where its light fades into the dark.
        let fading = [0.999, 1.0, 1.01].map(|x| grid.irradiance(Vec3::new(x, 0.5, 0.0), Vec3::Z).x);
        assert!(fading[0] < 0.7 && fading[1] > 0.3 && fading[2] < fading[1], "{fading:?}");
        let slanted = grid.irradiance(Vec3::new(0.5, 0.5, 0.0), Vec3::new(0.4, 0.0, 0.9));
        assert!((slanted.x - 1.0).abs() < 0.02, "{slanted}");
        for (dark, normal) in [
            (Vec3::new(-0.03, 0.5, 0.0), Vec3::Z),
            (Vec3::new(0.5, 0.5, 0.0), Vec3::Y),
            (Vec3::new(0.5, 0.5, 0.3), Vec3::Z),
            (Vec3::splat(1e9), Vec3::Z),
            (Vec3::splat(-1e30), Vec3::Z),
        ] {
            assert_eq!(grid.irradiance(dark, normal), Vec3::ZERO, "{dark} {normal}");
        }
    }
}

#[test]
fn photons_spread_their_light_by_their_neighbours_and_lose_none() {
    // Half of the power in a hundredth of the width.
    let mut landed = on_square(50, [Vec3::X, Vec3::Y], 0.5);
    landed.extend(
        on_square(50, [Vec3::X * 0.01, Vec3::Y * 0.01], 0.5)
            .into_iter()
            .map(|photon| Landed { position: photon.position + Vec4::new(0.5, 0.5, 0.0, 0.0), ..photon }),
    );
    let grid = Grid::new(0.3, &mut landed);
    let light = |x: f32, y: f32| grid.irradiance(Vec3::new(x, y, 0.0), Vec3::Z).x;
    assert!((light(0.25, 0.3) - 0.5).abs() < 0.01, "{}", light(0.25, 0.3));
    assert!((light(0.505, 0.505) / 5000.0 - 1.0).abs() < 0.02, "{}", light(0.505, 0.505));
    assert!(light(0.515, 0.505) < 0.02 * 5000.0, "{}", light(0.515, 0.505));
    // All light on fine rasters about both.
    let sum = |low: f32, width: f32| {
        let at = |i: u32| low + width * (i as f32 + 0.5) / 400.0;
        let all = (0..160_000).map(|i| f64::from(light(at(i % 400), at(i / 400)))).sum::<f64>();
        all * f64::from(width * width) / 160_000.0
    };
    let (all, near) = (sum(-0.5, 2.0), sum(0.48, 0.05));
    assert!((all - 1.0).abs() < 0.03 && near > 0.49 && near < 0.51, "{all} {near}");
}

#[test]
fn the_radius_of_a_photon_reaches_the_neighbours_that_a_search_of_all_finds() {
    // Uneven: in each axis most lie near the origin; a quarter faces the other way.
    let place = |i: u32| Vec3::from([17, 29, 43].map(|step| ((i * step * 7919 % 3001) as f32 / 3001.0).powi(3)));
    let side = |i: u32| if i.is_multiple_of(4) { -Vec4::Z } else { Vec4::Z };
    let photon = |i: u32| Landed { position: place(i).extend(1.0), normal: side(i), ..Landed::default() };
    let mut landed: Vec<Landed> = (0..3000).map(photon).collect();
    let spreads = Tree::new(&mut landed).spreads([1e-6, 0.2]);
    for (photon, spread) in landed.iter().zip(&spreads) {
        let same = landed.iter().filter(|other| other.normal == photon.normal);
        let mut distances: Vec<f32> = same.map(|other| other.position.distance(photon.position)).collect();
        distances.sort_unstable_by(f32::total_cmp);
        let expected = distances[NEIGHBOURS].min(0.2);
        assert!((spread.radius / expected - 1.0).abs() < 1e-4, "{} {expected}", spread.radius);
        assert_eq!(spread.end, Vec4::W * (2.0 * spread.radius));
    }
}

#[test]
fn photons_of_a_focus_are_merged_without_loss() {
    let mut landed = on_square(300, [Vec3::X * 1e-3, Vec3::Y * 1e-3], 1.0);
    let grid = Grid::new(0.3, &mut landed);
    // By cubes of a quarter of the least radius, in four vectors each.
    assert!(grid.vectors().count() <= 4 * 5 * 5, "{} vectors", grid.vectors().count());
    let peak = 3.0 / (std::f32::consts::PI * (0.3_f32 / 256.0).powi(2));
    let light = grid.irradiance(Vec3::new(5e-4, 5e-4, 0.0), Vec3::Z).x / peak;
    assert!(light > 0.7 && light < 1.0, "{light}");
}

#[test]
fn too_many_photons_are_thinned_without_loss() {
    let mut landed = on_square(10, [Vec3::X, Vec3::Y], 1.0);
    let sum = |landed: &[Landed]| landed.iter().map(|photon| photon.power.truncate()).sum::<Vec3>();
    landed.iter_mut().step_by(3).for_each(|photon| photon.power *= Vec4::new(0.25, 4.0, 0.0, 1.0));
    let before = sum(&landed);
    thin(&mut landed, 30);
    let off = (sum(&landed) - before).abs();
    assert!(landed.len() == 25 && off.max_element() < 1e-5, "{} {off}", landed.len());
    thin(&mut landed, 25);
    assert_eq!(landed.len(), 25);
}
