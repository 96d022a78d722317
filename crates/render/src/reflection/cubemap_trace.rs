//! Cubemap tracing (after a thesis of 2017 on accurate reflections by searching depth in cubemaps): reflected rays walk
//! through pictures of the points around each mirror. A ray that one map loses behind something goes on in another one,
//! and what no map resolves is left to `surfel_trace`, from where it is known to be free. docs/methods/cubemap_trace.md
//! has the rules.
//!
//! The maps do not depend on the camera and are kept until points, mirrors or splats change. A texel is the disc of its
//! nearest point, by its identity, so colours may change.

use cloud::Bounds;
use glam::DVec3;
use scene::{CubeCriterion, CubePlacement, CubeRest, OwnPoints, Settings};

use super::cubemaps::{Drawn, Layout, MapCount, Maps, catch_up, draw, grain_of_task, radius_of, upload_cubes};
use super::gather::{Gather, rest_list};
use super::mirror_places::{MirrorMap, MirrorPlace, mirror_places, upload};
use super::surfel_index::SurfelIndex;
use super::surfel_trace::{self, Rays};
use super::task::Task;
use crate::gpu::{Error, Result};
use crate::identities::{ChunkId, CloudId};
use crate::passes;
use crate::recorder::Recorder;

/// The maps, with the inputs from which they were drawn.
#[derive(Default)]
pub(crate) struct CubemapTrace {
    maps: Option<Maps>,
    /// The rays that no map resolves.
    pub(crate) rest: Option<wgpu::Buffer>,
    /// Whether the frame may do with maps that lack the newest points, and whether it has drawn its faces of them.
    may_lag: bool,
    has_caught_up: bool,
    /// Whether the frame has drawn faces of them.
    is_new: bool,
}

impl CubemapTrace {
    pub fn bytes(&self) -> u64 {
        let maps = self.maps.iter().flat_map(|maps| [&maps.records, &maps.bounds]);
        maps.chain(&self.rest).map(wgpu::Buffer::size).sum()
    }

    /// What one of how many points the maps show, and the texels along an edge of theirs.
    pub fn grain(&self) -> Option<[u32; 2]> {
        self.maps.as_ref().map(|maps| [maps.drawn.splat.step, maps.drawn.size])
    }

    /// Makes the next frame draw the maps anew.
    pub fn forget(&mut self) {
        self.maps = None;
    }

    /// Begins a frame. With `may_lag` it draws at most `faces_per_frame` faces of maps for points that came or went. If
    /// the one before was given up, maps of which it has drawn faces are not kept.
    pub fn begin(&mut self, was_unfinished: bool, may_lag: bool) {
        if std::mem::take(&mut self.is_new) && was_unfinished {
            self.forget();
        }
        (self.may_lag, self.has_caught_up) = (may_lag, false);
    }

    /// Whether some faces lack the newest points.
    pub fn lags(&self) -> bool {
        self.maps.as_ref().is_some_and(|maps| !maps.stale.is_empty())
    }

    /// The number of maps that stand, beside those asked for.
    pub fn count(&self) -> Option<MapCount> {
        self.maps.as_ref().map(|maps| MapCount { drawn: maps.places.len() as u32, asked: maps.asked })
    }

    /// Finds what the rays of a bounce meet.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn search(
        &mut self,
        recorder: &mut Recorder<'_>,
        index: &mut SurfelIndex,
        gather: &Gather,
        task: &Task<'_>,
    ) -> Result<()> {
        recorder.clear(&gather.hits);
        self.trace(recorder, index, gather, task, None)
    }

    /// Finds what rays meet; `listed` are the only ones (see `rest_list`).
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn trace(
        &mut self,
        recorder: &mut Recorder<'_>,
        index: &mut SurfelIndex,
        gather: &Gather,
        task: &Task<'_>,
        listed: Option<&wgpu::Buffer>,
    ) -> Result<()> {
        let settings = &task.settings.cubemap_trace;
        let mirrors = mirror_places(task);
        let kept = self.maps.as_ref().map(|maps| (&maps.drawn.splat, maps.drawn.size));
        let (splat, size) = grain_of_task(task, settings.size, kept);
        let layout = Layout::new(size);
        let limit = recorder.gpu.device.limits().max_storage_buffer_binding_size;
        if layout.record_bytes() > limit {
            let adapter = recorder.gpu.info.name.clone();
            let advice = "; lower cubemap_trace.size";
            return Err(Error::TooLarge { what: "cubemap", bytes: layout.record_bytes(), limit, adapter, advice });
        }
        let wanted: Vec<Vec<[DVec3; 2]>> = mirrors
            .iter()
            .zip(maps_of_mirrors(mirrors.len(), settings.maps as usize, (limit / layout.record_bytes()) as usize))
            .map(|(mirror, count)| wanted_places(mirror, task.settings, count))
            .collect();
        let has_maps: Vec<bool> = wanted.iter().map(|places| !places.is_empty()).collect();
        let mapped = || (0..mirrors.len()).filter(|mirror| has_maps[*mirror]);
        let drawn = Drawn {
            revision: task.store.geometry_revision(),
            splat,
            surface: task.settings.mirror.surface,
            size,
            wanted: mapped()
                .flat_map(|mirror| wanted[mirror].iter().map(move |places| (mirror, *places)))
                .map(|(mirror, places)| (mirrors[mirror].cloud.filter(|_| settings.own != OwnPoints::Drawn), places))
                .collect(),
        };
        let of_maps: Vec<&MirrorPlace> =
            mapped().flat_map(|mirror| vec![&mirrors[mirror]; wanted[mirror].len()]).collect();
        let has_all = |maps: &Maps| maps.stale.is_empty() && maps.drawn == drawn;
        let may_lag =
            |maps: &Maps| self.may_lag && maps.drawn == Drawn { revision: maps.drawn.revision, ..drawn.clone() };
        let maps = match self.maps.take() {
            Some(maps) if has_all(&maps) => maps,
            Some(mut maps) if may_lag(&maps) => {
                if !std::mem::replace(&mut self.has_caught_up, true) {
                    self.is_new = true;
                    catch_up(recorder, task, &layout, &mut maps, drawn, &of_maps)?;
                }
                maps
            }
            _ => {
                self.is_new = true;
                draw(recorder, task, &layout, drawn, &of_maps)?
            }
        };
        let maps = self.maps.insert(maps);
        let most = settings.maps as usize;
        maps.asked = mirrors.iter().map(|mirror| wanted_places(mirror, task.settings, most).len() as u32).sum();

        let eye = task.supply.camera.eye;
        let cubes = upload_cubes(recorder, &layout, &maps.places, eye, !maps.stale.is_empty());
        let first_of =
            |mirror: usize| (0..mirror).filter(|before| has_maps[*before]).map(|before| wanted[before].len()).sum();
        let middle = |mirror: usize| mirrors[mirror].bounds.center();
        let map_of = |mirror: usize| {
            let distance = |other: &usize| middle(*other).distance_squared(middle(mirror));
            let with_maps = if has_maps[mirror] {
                Some(mirror)
            } else {
                mapped().min_by(|a, b| distance(a).total_cmp(&distance(b)))
            }?;
            let view = glam::Vec4::new(wanted[with_maps].len() as f32, 0.0, 0.0, 0.0);
            Some(MirrorMap { map: first_of(with_maps), view })
        };
        let places = upload(recorder.gpu, &mirrors, task.store.bounds(), eye, map_of);

        let own = own_chunks(task, &mirrors, settings.own, eye);
        if !own.is_empty() {
            surfel_trace::trace(recorder, index, gather, task, &own, listed.map_or(Rays::All, Rays::Listed))?;
        }
        let rest = rest_list(recorder, &mut self.rest, task.supply.size);
        walk(recorder, gather, task, maps, [&places, &cubes, rest], listed)?;
        if settings.rest == CubeRest::SurfelTrace {
            surfel_trace::trace(recorder, index, gather, task, &task.supply.chunks, Rays::Listed(rest))?;
        }
        Ok(())
    }
}

/// Walks the rays of a task, or those that are `listed`, through maps. The buffers hold the places of mirrors, the
/// cubes of the maps, and room for the rays that are left.
///
/// # Errors
/// The shader is refused.
fn walk(
    recorder: &mut Recorder<'_>,
    gather: &Gather,
    task: &Task<'_>,
    maps: &Maps,
    [places, cubes, rest]: [&wgpu::Buffer; 3],
    listed: Option<&wgpu::Buffer>,
) -> Result<()> {
    let settings = &task.settings.cubemap_trace;
    let bindings = passes::cubemap_trace {
        point_in: task.mirror.point.bind(),
        normal_in: task.normal.bind(),
        eye_in: task.mirror.eye.bind(),
        mirrors: places.as_entire_binding(),
        cubes: cubes.as_entire_binding(),
        records: maps.records.as_entire_binding(),
        bounds: maps.bounds.as_entire_binding(),
        hits: gather.hits.as_entire_binding(),
        rest: rest.as_entire_binding(),
        views_out: gather.views.bind(),
        counters: task.counters.as_entire_binding(),
        listed: listed.unwrap_or(cubes).as_entire_binding(),
    };
    let switches = [
        ("use_listed", u32::from(listed.is_some())),
        ("counts", u32::from(task.bounce == 0)),
        ("only_planes", u32::from(settings.criterion == CubeCriterion::Plane)),
        ("criterion", settings.criterion as u32),
        ("sampling", settings.sampling as u32),
        ("hit", settings.hit as u32),
        ("rest_of_rays", settings.rest as u32),
    ];
    recorder.by_rows(&switches, task.supply, bindings, task.supply.mirror_groups())
}

/// How many maps each mirror has, where `wanted` of each are asked for and `room` fit into a binding: the same for all
/// mirrors; if not even one of each fits, the last mirrors have none and use those of the one nearest to them.
fn maps_of_mirrors(mirrors: usize, wanted: usize, room: usize) -> impl Iterator<Item = usize> {
    let each = wanted.min((room / mirrors.max(1)).max(1));
    (0..mirrors).map(move |mirror| if mirror < room { each } else { 0 })
}

/// The places of a mirror's maps, at most `count`, each with the one on the other side of the surface.
fn wanted_places(mirror: &MirrorPlace, settings: &Settings, count: usize) -> Vec<[DVec3; 2]> {
    let settings = &settings.cubemap_trace;
    if count > 0 && (settings.placement == CubePlacement::Middle || mirror.samples.is_empty()) {
        return vec![[mirror.bounds.center(); 2]];
    }
    let offset = f64::from(settings.offset) * radius_of(&mirror.bounds);
    // From inside, a mirror that is drawn hides everything, but all of it is seen.
    let other = if settings.own == OwnPoints::Drawn { offset } else { -offset };
    let beside = |(place, normal): &(DVec3, DVec3)| [*place + *normal * offset, *place + *normal * other];
    farthest(&mirror.samples, 0, count).iter().map(|sample| beside(&mirror.samples[*sample])).collect()
}

/// Chooses samples that lie far from one another: after the first each is the farthest from those before (Gonzalez 1985).
pub(super) fn farthest(samples: &[(DVec3, DVec3)], first: usize, count: usize) -> Vec<usize> {
    let mut chosen: Vec<usize> = (first..samples.len()).take(count.min(1)).collect();
    let mut distances = vec![f64::INFINITY; samples.len()];
    while chosen.len() < count.min(samples.len()) {
        let last = samples[chosen[chosen.len() - 1]].0;
        for (distance, (place, _)) in distances.iter_mut().zip(samples) {
            *distance = distance.min(place.distance_squared(last));
        }
        let next = (0..samples.len()).reduce(|a, b| if distances[b] > distances[a] { b } else { a });
        chosen.extend(next);
    }
    chosen
}

/// The chunks of the mirrors that may see themselves: they are left out of their own maps, so rays are traced through
/// their points.
pub(super) fn own_chunks(task: &Task<'_>, mirrors: &[MirrorPlace], own: OwnPoints, eye: DVec3) -> Vec<ChunkId> {
    let sees_itself = |mirror: &MirrorPlace| match own {
        OwnPoints::Auto => !is_convex(&mirror.samples, eye),
        OwnPoints::LeftOut | OwnPoints::Drawn => false,
        OwnPoints::Trace => true,
    };
    let clouds: Vec<CloudId> = mirrors.iter().filter(|mirror| sees_itself(mirror)).filter_map(|m| m.cloud).collect();
    let chunks: Vec<ChunkId> = task
        .store
        .mirror_clouds(task.settings)
        .into_iter()
        .filter(|(cloud, _)| clouds.contains(cloud))
        .flat_map(|(_, chunks)| chunks)
        .collect();
    task.supply.chunks.iter().filter(|chunk| chunks.contains(chunk)).copied().collect()
}

/// Whether no ray that a mirror reflects meets the mirror again: its surface curves away from the eye's side
/// everywhere. A closed surface hides its inner side.
fn is_convex(samples: &[(DVec3, DVec3)], eye: DVec3) -> bool {
    let step = samples.len().div_ceil(128).max(1);
    let some: Vec<&(DVec3, DVec3)> = samples.iter().step_by(step).collect();
    let mut bounds = Bounds::EMPTY;
    some.iter().for_each(|(place, _)| bounds.include(*place));
    let extent = bounds.size().length();
    let mean = some.iter().map(|(_, normal)| *normal).sum::<DVec3>() / some.len().max(1) as f64;
    // Over a closed surface, the mean of place times normal is a third of its volume along each axis (Gauss), and a
    // pipe with open ends has none along its own.
    let middle = bounds.center();
    let flux = some.iter().map(|(place, normal)| (*place - middle) * *normal).sum::<DVec3>();
    let is_closed = mean.length() < 0.1 && flux.min_element() > 0.5 * flux.max_element();
    some.iter().all(|(place, normal)| {
        // Points are seen from both sides.
        let facing = if is_closed || normal.dot(eye - *place) >= 0.0 { *normal } else { -*normal };
        some.iter().all(|(other, _)| facing.dot(*other - *place) <= 0.01 * extent)
    })
}

#[cfg(test)]
pub(super) mod tests {
    use std::collections::HashMap;
    use std::sync::Arc;

    use cloud::{Chunk, Cloud, pack_normal, pack_radius};
    use glam::{DQuat, Vec3};
    use scene::{Camera, CubeHit, CubeSampling, Method, Mirror, Shape};

    use super::super::depth_search::{Search, through_each};
    use super::super::depth_walk::{Answer, Choices, Criterion, Picture, Ray, View, relay, texel_of};
    use super::*;
    use crate::frame::Objects;
    use crate::gpu::Gpu;
    use crate::renderer::{Frame, Renderer};
    use crate::store::PointStore;
    use crate::{ColorPlan, Material};

    /// The colour of a point by its index in its chunk.
    pub fn color_of(index: usize) -> [u8; 4] {
        let [red, green, blue, ..] = cloud::hash(index as u64).to_le_bytes();
        [red, green, blue, 255]
    }

    /// Two boxes of points and a mirror of points, in a room or without its walls.
    pub fn furnished(gpu: &Arc<Gpu>, has_walls: bool) -> PointStore {
        let mut store = PointStore::new(gpu.clone());
        let mut add = |material, chunk: &Chunk| {
            let id = store.add_cloud(material);
            let chunk_id = store.add_chunk(id, chunk, None).unwrap();
            let cloud = Cloud { chunks: vec![chunk.clone()], ..Cloud::default() };
            let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
            store.set_color(id, &cloud, &[chunk_id], &plan, DVec3::Z).unwrap();
        };
        let boxes = [(DVec3::ZERO, 2.0), (DVec3::new(0.9, 0.9, -0.8), 0.3), (DVec3::new(-0.8, 0.7, 0.5), 0.2)];
        for (middle, half) in boxes.into_iter().skip(usize::from(!has_walls)) {
            let steps = 40;
            let (mut points, mut normals) = (Vec::new(), Vec::new());
            for i in 0..6 * steps * steps {
                let (side, row, column) = (i / (steps * steps), i / steps % steps, i % steps);
                let along = |step: i32| (f64::from(step) + 0.5) / f64::from(steps) * 2.0 - 1.0;
                let axis = |turn: i32| DVec3::AXES[((side + turn) % 3) as usize];
                let outward = axis(0) * if side < 3 { 1.0 } else { -1.0 };
                let place = outward + axis(1) * along(row) + axis(2) * along(column);
                points.push((middle + place * half).as_vec3().to_array());
                normals.push(pack_normal(outward.as_vec3()));
            }
            let radius = 1.5 * half / f64::from(steps);
            let mut chunk = Chunk::new(0, DVec3::ZERO, points);
            chunk.radii = Some(Arc::new(vec![pack_radius(radius as f32); chunk.len()]));
            chunk.normals = Some(Arc::new(normals));
            chunk.colors = Some(Arc::new((0..chunk.len()).map(color_of).collect()));
            add(Material::default(), &chunk);
        }
        let mirror = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Y, 0.4);
        let mirror = Mirror { position: DVec3::new(0.1, 0.0, 0.1), rotation: DQuat::IDENTITY, ..mirror };
        let reflecting = Material { specular_intensity: 1.0, specular_power: 1000.0, ..Material::default() };
        mirror.sample(3000, 1).iter().for_each(|chunk| add(reflecting, chunk));
        store
    }

    pub fn vectors(gpu: &Gpu, image: &crate::targets::Image) -> Vec<[f32; 4]> {
        bytemuck::pod_collect_to_vec(&gpu.read_texture(&image.texture).unwrap())
    }

    #[test]
    fn the_gpu_walks_as_its_twin_does() {
        let Some(gpu) = Gpu::shared() else { return };
        let mut renderer = Renderer::new(gpu.clone()).unwrap();
        let store = furnished(&gpu, true);
        let camera = Camera::looking(DVec3::new(0.1, 0.0, 0.1), DVec3::new(0.3, -1.0, 0.2), 1.4, DVec3::Z);
        let plane = (CubeCriterion::Plane, CubeSampling::Texel, CubeHit::Relay);
        let published = |criterion, sampling| (criterion, sampling, CubeHit::First);
        for (size, maps, skip, (criterion, sampling, hit)) in [
            (64, 2, true, plane),
            (50, 3, true, plane),
            (33, 1, false, plane),
            (50, 3, true, (CubeCriterion::Plane, CubeSampling::Texel, CubeHit::Nearest)),
            (50, 2, true, (CubeCriterion::Sign, CubeSampling::Texel, CubeHit::Nearest)),
            (50, 2, true, published(CubeCriterion::Threshold, CubeSampling::Texel)),
            (33, 2, true, published(CubeCriterion::Sign, CubeSampling::Step)),
            (33, 2, false, published(CubeCriterion::ThresholdThenSign, CubeSampling::Angle)),
            (50, 2, true, published(CubeCriterion::SignEither, CubeSampling::Texel)),
            (33, 2, true, published(CubeCriterion::SignEither, CubeSampling::Step)),
        ] {
            let mut settings = Settings::default();
            settings.reflection.method = Method::CubemapTrace;
            settings.gi.bounces = 0;
            let chosen = &mut settings.cubemap_trace;
            (chosen.size, chosen.maps, chosen.tries, chosen.skip, chosen.rest) =
                (size, maps, maps, skip, CubeRest::None);
            (chosen.criterion, chosen.sampling, chosen.hit) = (criterion, sampling, hit);
            (chosen.threshold, chosen.step, chosen.angle) = (0.015, 0.01, 1.0);
            let chosen = chosen.clone();
            let picture = [96, 80];
            let stats = renderer.render(&store, &Frame::new(&camera, &settings, Objects::default(), picture)).unwrap();
            let reflections = renderer.reflections.as_ref().unwrap();
            let cubes = &reflections.methods.cubemaps;
            let drawn = cubes.maps.as_ref().unwrap();
            let eye = renderer.camera.unwrap().eye;
            let layout = Layout::new(size);
            let records: Vec<[u32; 4]> =
                bytemuck::pod_collect_to_vec(&gpu.read_buffer(&drawn.records, 0, drawn.records.size()).unwrap());
            let face = |map: usize, face: usize| {
                let axis = |turn: usize| Vec3::AXES[(face + turn) % 3];
                let view = View {
                    center: (drawn.places[map] - eye).as_vec3(),
                    right: axis(1),
                    up: axis(2),
                    forward: if face < 3 { axis(0) } else { -axis(0) },
                    size: [size; 2],
                    focal: 0.5 * size as f32,
                    is_parallel: false,
                };
                let first = (map * 6 + face) * layout.texels_of_face as usize;
                Picture::new(view, records[first..][..(size * size) as usize].iter().map(|r| texel_of(*r)).collect())
            };
            let pictures: Vec<[Picture; 6]> =
                (0..drawn.places.len()).map(|map| [0, 1, 2, 3, 4, 5].map(|index| face(map, index))).collect();
            let radius = renderer.camera.unwrap().scene_radius as f32;
            let rule = match criterion {
                CubeCriterion::Plane => Criterion::Plane,
                CubeCriterion::Sign => Criterion::Sign,
                CubeCriterion::SignEither => Criterion::SignEither,
                _ => Criterion::Threshold(chosen.threshold * radius),
            };
            let choices = Choices { skip, levels: [0, 10], criterion: rule, ..Choices::DEFAULT };
            let search = Search {
                sampling,
                hit,
                step: chosen.step * radius,
                angle: chosen.angle.to_radians(),
                refine: 1,
                reach: 2.01 * radius,
                then_sign: criterion == CubeCriterion::ThresholdThenSign,
            };

            let bounce = reflections.first().unwrap();
            let targets = renderer.targets.as_ref().unwrap();
            let normals = vectors(&gpu, &targets.surfaces[targets.shown].normal);
            let [points, eyes] = [&bounce.mirror.point, &bounce.mirror.eye].map(|image| vectors(&gpu, image));
            let hits = &reflections.methods.gather.as_ref().unwrap().hits;
            let hits: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(&gpu.read_buffer(hits, 0, hits.size()).unwrap());
            let rest = cubes.rest.as_ref().unwrap();
            let rest: Vec<u32> = bytemuck::pod_collect_to_vec(&gpu.read_buffer(rest, 0, rest.size()).unwrap());
            let left: HashMap<u32, f32> =
                rest[1..][..2 * rest[0] as usize].chunks(2).map(|pair| (pair[0], f32::from_bits(pair[1]))).collect();
            let share = stats.reflection.unwrap().unresolved.unwrap();

            let vector = |part: &[f32; 4]| Vec3::new(part[0], part[1], part[2]);
            // Places at even angles go through tangents, which differ in their last digits.
            let most_off = if sampling == CubeSampling::Angle { 3e-5 } else { 1e-5 };
            let (mut rays, mut apart, mut kinds, mut farthest) = (0_u32, 0_u32, [0; 3], 0.0_f32);
            for pixel in (0..points.len()).filter(|pixel| points[*pixel][3] > 0.0) {
                let origin = vector(&points[pixel]);
                let direction = (origin - vector(&eyes[pixel])).reflect(vector(&normals[pixel])).normalize();
                let ray = Ray { origin, direction, from: 0.0, to: 1e30 };
                let (expected, cells) = if hit == CubeHit::Relay {
                    relay(&pictures, &ray, maps as usize, choices)
                } else {
                    through_each(&pictures, &ray, maps as usize, choices, search)
                };
                let [_, found, distance, walked] = hits[pixel];
                let mut off = 0.0_f32;
                let mut near = |t: f32, other: f32| {
                    off = (t - other).abs() / (1.0 + other);
                    off <= most_off
                };
                let is_same = match expected {
                    // Two maps may show another disc at the same distance.
                    Answer::Hit { t, identity } => {
                        let is_named = hit == CubeHit::Nearest && found > 0 || found == identity + 1;
                        is_named && near(f32::from_bits(distance), t)
                    }
                    Answer::Open => found == 0 && !left.contains_key(&(pixel as u32)),
                    Answer::Hidden(t) => left.get(&(pixel as u32)).is_some_and(|from| near(*from, t)),
                };
                kinds[match expected {
                    Answer::Hit { .. } => 0,
                    Answer::Open => 1,
                    Answer::Hidden(_) => 2,
                }] += 1;
                if is_same {
                    farthest = farthest.max(off);
                }
                rays += 1;
                // Whether a sample lies before or behind a cell's border is rounding's, too.
                let most_cells = if sampling == CubeSampling::Texel { 1 } else { 8 };
                // The twin passes no cell unseen by the change of either sign.
                let is_as_long = walked.abs_diff(cells) <= most_cells || criterion == CubeCriterion::SignEither;
                apart += u32::from(!is_same || !is_as_long);
            }
            // Rounding decides for a ray that passes through the corner of a texel, and where a texel has one depth,
            // for rays that are about as deep.
            let most = if hit == CubeHit::Relay { 200 } else { 50 };
            let about = format!("{size} {criterion:?} {sampling:?} {hit:?}: {kinds:?}, {farthest:.1e} apart");
            println!("{about}: {apart} of {rays} differ");
            assert!(rays > 500 && apart * most <= rays, "{about}: {apart} of {rays} differ");
            assert!(kinds[0] > rays / 2, "{about}");
            assert!(hit != CubeHit::Relay || (kinds[0] > 10 * kinds[2] && kinds[2] > 0), "{about}");
            assert!((share - f64::from(kinds[2]) / f64::from(rays)).abs() < 0.01, "{share} {kinds:?}");
        }
    }

    #[test]
    fn maps_are_spread_over_the_mirrors() {
        let line: Vec<(DVec3, DVec3)> = (0..11).map(|i| (DVec3::X * f64::from(i), DVec3::Z)).collect();
        assert_eq!(farthest(&line, 0, 4), [0, 10, 5, 2]);
        assert_eq!(farthest(&line, 5, 3), [5, 0, 10]);
        assert_eq!(farthest(&line[..2], 0, 4).len(), 2);
        assert!(farthest(&line, 0, 0).is_empty());
        let maps = |mirrors, wanted, room| maps_of_mirrors(mirrors, wanted, room).collect::<Vec<_>>();
        assert_eq!((maps(2, 2, 9), maps(3, 4, 7)), (vec![2, 2], vec![2, 2, 2]));
        assert_eq!((maps(1, 2, 1), maps(3, 2, 2), maps(0, 2, 2)), (vec![1], vec![1, 1, 0], vec![]));
    }

    #[test]
    fn convex_mirrors_do_not_see_themselves() {
        let of = |shape: Shape, size| {
            let mirror = Mirror::standing(shape, DVec3::ZERO, DVec3::Z, DVec3::Y, size);
            let sampled = mirror.sample(2000, 1);
            super::super::mirror_places::samples(&super::super::mirror_places::whole(&sampled))
        };
        let eye = DVec3::new(0.0, -5.0, 1.0);
        assert!(is_convex(&of(Shape::Sphere, 1.0), eye));
        assert!(is_convex(&of(Shape::Plane { height: 1.0 }, 1.0), eye));
        assert!(is_convex(&of(Shape::Plane { height: 1.0 }, 1.0), -eye));
        assert!(is_convex(&of(Shape::Paraboloid { focal_length: 0.5 }, 1.0), DVec3::new(0.0, -0.5, -5.0)));
        // The inner side of a column is seen through its open end.
        let column = Shape::Cylinder { height: 1.5 };
        let seeing = [column, Shape::Coral, Shape::Torus { tube: 0.3 }, Shape::Paraboloid { focal_length: 0.5 }];
        assert!(seeing.into_iter().all(|shape| !is_convex(&of(shape, 1.0), DVec3::Z * 5.0)));
    }
}
