//! A CPU twin of `shaders/shared/vpl.wgsl` and `shaders/indirect.wgsl`, and tests of both.

use std::sync::{Arc, LazyLock, Mutex, MutexGuard};

use cloud::Cloud;
use glam::{DVec3, Vec2, Vec3, Vec4Swizzles as _};
use scene::five_mirrors::{self, Variant};
use scene::{Settings, SpotLight};

use crate::layout::{VPL_SKY, Virtual, Vpl};
use crate::{Aov, ColorPlan, Frame, Gpu, Material, Objects, PointStore, Renderer};

const VPL_NONE: f32 = 0.0;

fn map_from_direction(direction: Vec3) -> Vec2 {
    direction.truncate() / (1.0 + direction.z)
}

fn direction_from_map(map: Vec2) -> Vec3 {
    let squared = map.length_squared();
    (2.0 * map).extend(1.0 - squared) / (1.0 + squared)
}

fn distance_of_code(lights: &Virtual, kind: f32, code: u32) -> f32 {
    let steps = (65536 - code) as f32;
    if kind == VPL_SKY {
        return steps / 65534.0 * 2.0 * lights.eye_radius.w;
    }
    lights.nearest * (steps / lights.steps).exp2()
}

/// The origin and direction of the ray through a place of a light's map; `map` is -1 to 1.
fn ray_of_map(lights: &Virtual, light: &Vpl, map: Vec2) -> (Vec3, Vec3) {
    let (normal, tangent) = (light.normal.xyz(), light.tangent.xyz());
    let bitangent = normal.cross(tangent);
    if light.normal.w == VPL_SKY {
        return ((tangent * map.x + bitangent * map.y + normal) * lights.eye_radius.w, -normal);
    }
    let direction = direction_from_map(map);
    (light.position.xyz(), tangent * direction.x + bitangent * direction.y + normal * direction.z)
}

/// The place of a point in the light's map, and its distance.
fn point_in_map(lights: &Virtual, light: &Vpl, point: Vec3) -> (Vec2, f32) {
    let (normal, tangent) = (light.normal.xyz(), light.tangent.xyz());
    let bitangent = normal.cross(tangent);
    if light.normal.w == VPL_SKY {
        let radius = lights.eye_radius.w;
        return (Vec2::new(tangent.dot(point), bitangent.dot(point)) / radius, radius - normal.dot(point));
    }
    let offset = point - light.position.xyz();
    let direction = offset.normalize();
    let z = normal.dot(direction).max(-0.5);
    (map_from_direction(Vec3::new(tangent.dot(direction), bitangent.dot(direction), z)), offset.length())
}

/// Whether light `index` sees the surface at `at`, according to its shadow map.
fn is_seen(lights: &Virtual, maps: &[u32], index: usize, light: &Vpl, at: Vec3, normal: Vec3, bias: f32) -> bool {
    let (map, distance) = point_in_map(lights, light, at);
    let size = lights.map_size as f32;
    let texel = ((map * 0.5 + 0.5) * size).floor().clamp(Vec2::ZERO, Vec2::splat(size - 1.0));
    let code =
        maps[index * lights.map_stride as usize + texel.y as usize * lights.map_size as usize + texel.x as usize];
    let (origin, direction) = ray_of_map(lights, light, (texel + 0.5) / size * 2.0 - 1.0);
    let plane = normal.dot(at - origin) / normal.dot(direction);
    let expected = if plane > 0.5 * distance && plane < distance { plane } else { distance };
    code == 0 || distance_of_code(lights, light.normal.w, code >> 16) >= expected - bias * lights.disc_radius
}

/// The irradiance of a diffuse surface by all lights, for spherical lights without a clamp.
fn irradiance(lights: &Virtual, vpls: &[Vpl], maps: &[u32], at: Vec3, normal: Vec3, bias: f32) -> Vec3 {
    let of_light = |(index, light): (usize, &Vpl)| {
        let is_sky = light.normal.w == VPL_SKY;
        let offset = if is_sky { light.normal.xyz() } else { light.position.xyz() - at };
        let toward = offset.normalize();
        let cosine = normal.dot(toward);
        let there = if is_sky { 1.0 } else { -light.normal.xyz().dot(toward) };
        if light.normal.w == VPL_NONE || cosine <= 0.0 || there <= 0.0 {
            return Vec3::ZERO;
        }
        let transfer = if is_sky {
            cosine
        } else if offset.length_squared() < 25.0 * light.position.w {
            transfer_of_square(light, offset, normal)
        } else {
            // The mean over the light's disc to the second order in its radius.
            let facing = normal.dot(light.normal.xyz()) * there / cosine;
            let bend = light.position.w / offset.length_squared() * (1.0 - 3.0 * there * there - facing).min(2.0);
            let mean = if bend < 0.0 { 1.0 / (1.0 - bend) } else { 1.0 + bend };
            cosine * there / offset.length_squared() * mean
        };
        let seen = is_seen(lights, maps, index, light, at, normal, bias);
        let factor = if is_sky { 1.0 } else { light.tangent.w };
        light.intensity.xyz() * transfer * factor * f32::from(u8::from(seen))
    };
    vpls.iter().enumerate().map(of_light).sum()
}

/// The cosines over squared distance of a near light, which is taken for a square.
fn transfer_of_square(light: &Vpl, offset: Vec3, normal: Vec3) -> f32 {
    let (light_normal, tangent) = (light.normal.xyz(), light.tangent.xyz());
    let half = 0.9 * (std::f32::consts::PI * light.position.w).sqrt();
    // The surface that the light stands on.
    if light_normal.dot(offset).abs() < 0.05 * half && light_normal.dot(normal).abs() > 0.9 {
        return 0.0;
    }
    let across = light_normal.cross(tangent);
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y): (f32, f32)| offset + (tangent * x + across * y) * half);
    // The part of it above the surface (Sutherland and Hodgman 1974).
    let mut above = Vec::new();
    for (before, corner) in (0..4).map(|index| (corners[(index + 3) % 4], corners[index])) {
        let (from, to) = (normal.dot(before), normal.dot(corner));
        if (from > 0.0) != (to > 0.0) {
            above.push(before.lerp(corner, from / (from - to)));
        }
        if to > 0.0 {
            above.push(corner);
        }
    }
    let (mut light, mut area) = (0.0, 0.0);
    for (start, end) in (0..above.len()).map(|index| (above[index], above[(index + 1) % above.len()])) {
        let turn = start.cross(end);
        light += turn.length().atan2(start.dot(end)) * normal.dot(turn.normalize_or_zero());
        area += light_normal.dot(turn);
    }
    light.abs() / area.abs().max(1e-20)
}

/// The virtual lights that the GPU has placed.
pub(super) struct Placed {
    pub lights: Virtual,
    /// The world position to which all others are relative.
    pub origin: DVec3,
    pub vpls: Vec<Vpl>,
    pub maps: Vec<u32>,
}

/// The GPU that the tests share: drivers take a while to compile each pass.
struct TestGpu {
    gpu: Arc<Gpu>,
    renderer: Renderer,
}

static STAGE: LazyLock<Option<Mutex<TestGpu>>> = LazyLock::new(|| {
    let gpu = Gpu::shared()?;
    Renderer::new(gpu.clone()).ok().map(|renderer| Mutex::new(TestGpu { gpu, renderer }))
});

fn stage() -> Option<MutexGuard<'static, TestGpu>> {
    STAGE.as_ref().map(|stage| stage.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

fn store_of(gpu: &Arc<Gpu>, variant: Variant, points: u64) -> PointStore {
    let mut store = PointStore::new(gpu.clone());
    for part in five_mirrors::sample(variant, points, 1) {
        let id = store.add_cloud(Material {
            specular_intensity: part.mirror.as_ref().map_or(0.0, |mirror| mirror.specular_intensity),
            ..Material::default()
        });
        let ids: Vec<_> = part.chunks.iter().map(|chunk| store.add_chunk(id, chunk, None).unwrap()).collect();
        let cloud = Cloud { chunks: part.chunks, ..Cloud::default() };
        let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Y);
        store.set_color(id, &cloud, &ids, &plan, DVec3::Y).unwrap();
    }
    store
}

fn settings(pairs: &[(&str, &str)]) -> Settings {
    let mut settings = Settings::default();
    for (key, value) in pairs {
        settings.set_text(key, value).unwrap();
    }
    settings
}

const SIZE: [u32; 2] = [64, 48];

impl TestGpu {
    fn render(&mut self, store: &PointStore, settings: &Settings, lights: &[SpotLight]) {
        let objects = Objects { lights, ..Objects::default() };
        self.renderer.render(store, &Frame::new(&five_mirrors::camera(), settings, objects, SIZE)).unwrap();
    }

    fn placed(&self) -> Placed {
        self.renderer.gi.read(&self.gpu).unwrap().unwrap()
    }

    fn aov(&self, aov: Aov) -> Vec<Vec3> {
        let data = self.renderer.read_aov(aov).unwrap().data;
        data.chunks_exact(3).map(Vec3::from_slice).collect()
    }
}

#[test]
fn virtual_lights_carry_the_lamp_s_flux_and_stand_where_it_shines() {
    let Some(mut stage) = stage() else { return };
    let store = store_of(&stage.gpu, Variant::None, 60_000);
    stage.render(&store, &settings(&[("gi.vpls", "256")]), &[five_mirrors::light()]);
    let Placed { origin, vpls, .. } = stage.placed();
    let light = five_mirrors::light();
    let axis = (light.target - light.position).normalize();
    let (inner, outer) = (20f64.to_radians(), 25f64.to_radians());
    let ring = inner.cos() - (outer.sin() - inner.sin()) / (outer - inner);
    let flux = 10.0 * std::f64::consts::TAU * ((1.0 - inner.cos()) + ring);
    let mut sum = 0.0;
    for vpl in &vpls {
        assert!(vpl.normal.w != VPL_NONE);
        let at = vpl.position.xyz().as_dvec3() + origin;
        assert!((at - light.position).normalize().dot(axis) > outer.cos() - 1e-4);
        let off = (DVec3::new(1.0, 1.0, 2.0) - at.abs()).abs().min_element();
        assert!(off < 1e-3, "{at} is not on a wall");
        // Only the right wall's green, which is one number; other surfaces have others.
        if at.x > 0.999 {
            sum += f64::from(vpl.intensity.y) * std::f64::consts::PI / 0.45 / (flux / 256.0);
        }
    }
    let on_wall = vpls.iter().filter(|vpl| f64::from(vpl.position.x) + origin.x > 0.999).count();
    assert!((sum / on_wall as f64 - 1.0).abs() < 0.01, "{} of the flux", sum / on_wall as f64);
}

/// Images of the surfaces that the camera sees, one entry a pixel.
struct SurfaceImages {
    at: Vec<Vec3>,
    normal: Vec<Vec3>,
    albedo: Vec<Vec3>,
    indirect: Vec<Vec3>,
}

impl TestGpu {
    fn shown(&self, origin: DVec3) -> SurfaceImages {
        let at = self.renderer.read_aov_from(Aov::Position, origin).unwrap().data;
        SurfaceImages {
            at: at.chunks_exact(3).map(Vec3::from_slice).collect(),
            normal: self.aov(Aov::Normal),
            albedo: self.aov(Aov::Albedo),
            indirect: self.aov(Aov::Indirect),
        }
    }
}

#[test]
fn a_surface_is_lit_as_the_twin_says_by_lamps_and_by_the_sky() {
    let Some(mut stage) = stage() else { return };
    let store = store_of(&stage.gpu, Variant::Sphere, 60_000);
    for by in ["lights", "sun"] {
        let settings = settings(&[
            ("gi.interleave", "1"),
            ("gi.vpls", "64"),
            ("gi.bounces", "2"),
            ("gi.sky_lights", "16"),
            ("gi.shadow_points", "2000"),
            ("gi.shadow_size", "32"),
            ("light.by", by),
            ("sun.sky", "2"),
            ("sun.elevation", "80"),
            ("reflection.method", "none"),
        ]);
        stage.render(&store, &settings, &[five_mirrors::light()]);
        let Placed { lights, origin, vpls, maps } = stage.placed();
        assert_eq!(vpls.len(), if by == "sun" { 16 + 128 } else { 128 });
        let shown = stage.shown(origin);
        let (mut compared, mut differing, mut lit) = (0, 0, 0);
        for pixel in (0..shown.at.len()).filter(|pixel| shown.at[*pixel].is_finite()) {
            let light = irradiance(&lights, &vpls, &maps, shown.at[pixel], shown.normal[pixel], 1.0);
            let expected = shown.albedo[pixel] * light * std::f32::consts::FRAC_1_PI;
            compared += 1;
            // The differences come from half floats, and from rays that graze a texel's border and may fall on either
            // side of it.
            let most = 0.004 * expected.max_element() + 1e-5;
            // The comparison is false for NaN.
            let is_same = (shown.indirect[pixel] - expected).abs().max_element() <= most;
            differing += usize::from(!is_same);
            lit += usize::from(expected.max_element() > 1e-3);
        }
        assert!(
            compared > 2000 && lit * 2 > compared && differing * 50 < compared,
            "{by}: {differing} of {compared} pixels differ"
        );
    }
}

#[test]
fn shadow_maps_are_wrong_about_few_pairs_of_pixel_and_light() {
    let Some(mut stage) = stage() else { return };
    let store = store_of(&stage.gpu, Variant::Sphere, 400_000);
    let [discs, squares, farther] = [("discs", 1.0), ("squares", 1.0), ("squares", 8.0)]
        .map(|(occluders, bias)| wrong_pairs(&mut stage, &store, occluders, bias));
    assert!(discs < 0.08, "{:.1} % of the pairs are wrong", discs * 100.0);
    // The published squares let the surface that a light stands on rise into its view.
    assert!(squares > farther && farther > discs, "squares: {squares}, at the largest distance: {farther}");
}

/// The share of wrong pairs.
fn wrong_pairs(stage: &mut TestGpu, store: &PointStore, occluders: &str, bias: f32) -> f64 {
    let settings = settings(&[("gi.interleave", "1"), ("gi.occluders", occluders)]);
    stage.render(store, &settings, &[five_mirrors::light()]);
    let Placed { lights, origin, vpls, maps } = stage.placed();
    let shown = stage.shown(origin);
    // The box hides nothing from itself; the sphere is in its middle.
    let (center, radius) = ((DVec3::ZERO - origin).as_vec3(), 0.43);
    let is_hidden = |from: Vec3, to: Vec3| {
        let along = (to - from).normalize();
        let nearest = (center - from).dot(along).clamp(0.0, (to - from).length());
        (from + along * nearest).distance(center) < radius
    };
    let (mut pairs, mut wrong, mut dark) = (0, 0, 0);
    let on_wall = |pixel: &usize| shown.at[*pixel].is_finite() && shown.at[*pixel].distance(center) > radius + 0.05;
    for pixel in (0..shown.at.len()).filter(on_wall) {
        for (index, light) in vpls.iter().enumerate().filter(|(_, light)| light.normal.w != VPL_NONE) {
            let (at, normal) = (shown.at[pixel], shown.normal[pixel]);
            let toward = (light.position.xyz() - at).normalize();
            if normal.dot(toward) <= 0.0 || light.normal.xyz().dot(toward) >= 0.0 {
                continue;
            }
            let truth = !is_hidden(at, light.position.xyz());
            let seen = is_seen(&lights, &maps, index, light, at, normal, bias);
            pairs += 1;
            dark += usize::from(!truth);
            wrong += usize::from(truth != seen);
        }
    }
    let share = |part: usize| part as f64 / pairs as f64;
    println!(
        "{occluders}, bias {bias}: {pairs} pairs, {:.2} % hidden, {:.2} % wrong",
        share(dark) * 100.0,
        share(wrong) * 100.0
    );
    assert!(pairs > 100_000 && share(dark) > 0.02);
    share(wrong)
}
