//! Clouds on the GPU: the only way by which points reach the store, for the window and for headless pictures.

use std::collections::HashMap;
use std::sync::Arc;

use cloud::{Chunk, Cloud, CloudLayout};
use glam::DVec3;
use render::{ChunkId, CloudId, ColorPlan, Gpu, Material, PointStore, Result};

use crate::change::Change;
use crate::chunk_key::{ChunkKey, CloudKey, Part};
use crate::mirrors::{self, Marked};

pub struct Resident {
    pub store: PointStore,
    clouds: HashMap<CloudKey, ResidentCloud>,
    /// The origin of the points of a chunk in the store: the points of the key's chunk in their order, or those with
    /// these indices.
    origins: HashMap<ChunkId, (ChunkKey, Option<Vec<u32>>)>,
    /// Whether the store has refused points. It reports the first refusal; after that, chunks are left out until
    /// something is removed.
    is_full: bool,
}

struct ResidentCloud {
    id: CloudId,
    chunks: HashMap<Part, ChunkId>,
    /// The points of the cloud that reflect.
    reflecting: Vec<Reflecting>,
    /// How the cloud and its reflecting points are coloured.
    color: Option<(ColorPlan, DVec3)>,
    /// The points of a mirror.
    samples: Vec<Chunk>,
    is_visible: bool,
    /// The radius of points whose own is not known, before `size`.
    provisional_radius: f32,
    /// The radii of its points in the store, relative to their own.
    size: f32,
}

/// Points of a cloud that reflect, as a cloud of the store.
struct Reflecting {
    id: CloudId,
    /// For each part, the chunk in the store and the indices of its points in the part.
    chunks: HashMap<Part, (ChunkId, Vec<u32>)>,
}

/// Whether these are the points of a mirror that is resident, apart from their colour.
fn has_places(resident: &ResidentCloud, samples: &[Chunk]) -> bool {
    let is_same = |(known, sample): (&Chunk, &Chunk)| {
        let geometry = |chunk: &Chunk| (chunk.first_point, chunk.origin, chunk.radii.clone(), chunk.normals.clone());
        known.positions == sample.positions && geometry(known) == geometry(sample)
    };
    !samples.is_empty()
        && resident.samples.len() == samples.len()
        && resident.chunks.len() == samples.len()
        && resident.samples.iter().zip(samples).all(is_same)
}

impl ResidentCloud {
    fn new(id: CloudId) -> Self {
        Self {
            id,
            chunks: HashMap::new(),
            reflecting: Vec::new(),
            color: None,
            samples: Vec::new(),
            is_visible: true,
            provisional_radius: 0.0,
            size: 1.0,
        }
    }

    fn ids(&self) -> impl Iterator<Item = CloudId> {
        std::iter::once(self.id).chain(self.reflecting.iter().map(|reflecting| reflecting.id))
    }

    /// The chunks that are in the store, and their ids there: chunks that the store refused are left out.
    fn stored(&self, chunks: &[(Part, Chunk)]) -> (Cloud, Vec<ChunkId>) {
        let known = chunks.iter().filter_map(|(part, chunk)| Some((chunk.clone(), *self.chunks.get(part)?)));
        let (chunks, ids) = known.unzip();
        (Cloud { chunks, ..Cloud::default() }, ids)
    }
}

impl Reflecting {
    fn stored(&self, chunks: &[(Part, Chunk)]) -> (Cloud, Vec<ChunkId>) {
        let known = chunks.iter().filter_map(|(part, chunk)| {
            let (id, indices) = self.chunks.get(part)?;
            Some((chunk.select(indices), *id))
        });
        let (chunks, ids) = known.unzip();
        (Cloud { chunks, ..Cloud::default() }, ids)
    }
}

/// Points that represent mirrors come after those of all clouds.
const MIRRORS_FROM: u64 = 1 << 63;

/// The order of a cloud of the store: clouds by their keys, each followed by the lists of its reflecting points. So
/// pictures depend neither on the order in which chunks come nor on that in which points are found to reflect.
fn order_of(cloud: CloudKey, list: usize) -> u64 {
    u64::from(cloud.0) << 24 | list as u64
}

impl Resident {
    pub fn new(gpu: Arc<Gpu>) -> Self {
        let store = PointStore::new(gpu);
        Self { store, clouds: HashMap::new(), origins: HashMap::new(), is_full: false }
    }

    /// Applies a change to the store. Changes of clouds that are not in the store are ignored: these have been closed
    /// meanwhile.
    ///
    /// # Errors
    /// No more memory. After that, further chunks are left out, without an error for each, until something is removed.
    pub fn apply(&mut self, change: Change) -> Result<()> {
        match change {
            Change::Open { cloud, provisional_radius } => {
                let id = self.store.add_cloud(Material::default());
                self.store.set_order(id, order_of(cloud, 0));
                self.store.set_provisional_radius(id, provisional_radius);
                self.clouds.insert(cloud, ResidentCloud { provisional_radius, ..ResidentCloud::new(id) });
            }
            Change::Expect { points } => self.store.reserve(points),
            Change::Bounds { cloud, bounds } => {
                if let Some(resident) = self.clouds.get(&cloud) {
                    self.store.set_bounds(resident.id, bounds);
                }
            }
            Change::Put { key, chunk, layout } => return self.put(key, chunk, &layout),
            Change::TakeOut { key } => {
                let chunks = self.clouds.get_mut(&key.cloud).map(|resident| &mut resident.chunks);
                if let Some(id) = chunks.and_then(|chunks| chunks.remove(&key.part)) {
                    self.store.remove_chunk(id);
                    self.origins.remove(&id);
                    self.is_full = false;
                }
            }
            Change::Tint { tints } => {
                for (key, tint) in tints {
                    if let Some(id) = self.clouds.get(&key.cloud).and_then(|resident| resident.chunks.get(&key.part)) {
                        self.store.set_tint(*id, tint);
                    }
                }
            }
            Change::Color { cloud, chunks, plan, up } => {
                let Some(resident) = self.clouds.get_mut(&cloud) else { return Ok(()) };
                let (known, ids) = resident.stored(&chunks);
                self.store.set_color(resident.id, &known, &ids, &plan, up)?;
                for reflecting in &resident.reflecting {
                    let (known, ids) = reflecting.stored(&chunks);
                    self.store.set_color(reflecting.id, &known, &ids, &plan, up)?;
                }
                resident.color = Some((plan, up));
            }
            Change::Show { cloud, is_visible } => {
                if let Some(resident) = self.clouds.get_mut(&cloud) {
                    resident.is_visible = is_visible;
                    resident.ids().for_each(|id| self.store.set_visible(id, is_visible));
                }
            }
            Change::Size { cloud, size } => {
                if let Some(resident) = self.clouds.get_mut(&cloud) {
                    resident.size = size;
                    self.store.set_provisional_radius(resident.id, resident.provisional_radius * size);
                }
            }
            Change::Visibility { test } => self.store.set_visibility(&test),
            Change::Mark { cloud, chunks, layout, marked } => return self.mark(cloud, &chunks, &layout, &marked),
            Change::Mirror { cloud, mirror, samples } => {
                if let Some(resident) = self.clouds.get_mut(&cloud).filter(|resident| has_places(resident, &samples)) {
                    // Only the look of the mirror has changed: all that is known of its points' places stays.
                    self.store.set_material(resident.id, Material::of_mirror(&mirror));
                    for sample in &samples {
                        let id = resident.chunks.get(&Part::Block(sample.first_point));
                        let color = sample.colors.as_ref().and_then(|colors| colors.first().copied());
                        if let Some(id) = id {
                            self.store.set_tint(*id, color);
                        }
                    }
                    return Ok(());
                }
                self.close(cloud);
                let (id, ids) = mirrors::upload(&mut self.store, &mirror, &samples)?;
                self.store.set_order(id, MIRRORS_FROM + order_of(cloud, 0));
                let parts = samples.iter().map(|chunk| Part::Block(chunk.first_point));
                let chunks: HashMap<Part, ChunkId> = parts.zip(ids).collect();
                self.origins.extend(chunks.iter().map(|(part, id)| (*id, (cloud.chunk(*part), None))));
                self.clouds.insert(cloud, ResidentCloud { chunks, samples, ..ResidentCloud::new(id) });
            }
            Change::Close { cloud } => self.close(cloud),
        }
        Ok(())
    }

    fn close(&mut self, cloud: CloudKey) {
        if let Some(resident) = self.clouds.remove(&cloud) {
            resident.ids().for_each(|id| self.store.remove_cloud(id));
            self.origins.retain(|_, (owner, _)| owner.cloud != cloud);
            self.is_full = false;
        }
    }

    /// The chunk from which point `index` of a chunk of the store came, and the point's index in it.
    pub fn origin(&self, chunk: ChunkId, index: usize) -> Option<(ChunkKey, usize)> {
        let (key, indices) = self.origins.get(&chunk)?;
        let index = match indices {
            Some(indices) => *indices.get(index)? as usize,
            None => index,
        };
        Some((*key, index))
    }

    /// The chunks of the store that hold points of a chunk: all of them in their order, or those with the indices that come
    /// with it.
    pub fn places_of(&self, key: ChunkKey) -> impl Iterator<Item = (ChunkId, Option<&[u32]>)> {
        let own = self.origins.iter().filter(move |(_, (origin, _))| *origin == key);
        own.map(|(id, (_, indices))| (*id, indices.as_deref()))
    }

    fn put(&mut self, key: ChunkKey, chunk: Chunk, layout: &Arc<CloudLayout>) -> Result<()> {
        let Some(resident) = self.clouds.get_mut(&key.cloud) else { return Ok(()) };
        let chunk = chunk.resized(resident.size);
        let id = match resident.chunks.get(&key.part) {
            Some(&id) => {
                if let Err(error) = self.store.update_chunk(id, &chunk, Some(layout)) {
                    // The chunk has no points left, or the store's chunk does not fit any more.
                    self.store.remove_chunk(id);
                    resident.chunks.remove(&key.part);
                    self.origins.remove(&id);
                    return Err(error);
                }
                id
            }
            None if self.is_full => return Ok(()),
            None => {
                let added = self.store.add_chunk(resident.id, &chunk, Some(layout));
                let id = added.inspect_err(|_| self.is_full = true)?;
                resident.chunks.insert(key.part, id);
                self.origins.insert(id, (key, None));
                id
            }
        };
        // A chunk that comes late gets the cloud's colours at once.
        let Some((plan, up)) = resident.color.as_ref().filter(|(plan, _)| plan.source.column().is_some()) else {
            return Ok(());
        };
        let cloud = Cloud { chunks: vec![chunk], ..Cloud::default() };
        self.store.set_color(resident.id, &cloud, &[id], plan, *up)
    }

    /// Takes the points that reflect out of a cloud and makes clouds of them, after undoing earlier marks.
    fn mark(
        &mut self,
        cloud: CloudKey,
        chunks: &[(Part, Chunk)],
        layout: &Arc<CloudLayout>,
        marked: &[Marked],
    ) -> Result<()> {
        let Some(resident) = self.clouds.get_mut(&cloud) else { return Ok(()) };
        for before in resident.reflecting.drain(..) {
            self.store.remove_cloud(before.id);
            before.chunks.values().for_each(|(id, _)| drop(self.origins.remove(id)));
        }
        for (number, marked) in marked.iter().enumerate() {
            let id = self.store.add_cloud(marked.material);
            self.store.set_order(id, order_of(cloud, number + 1));
            resident.reflecting.push(Reflecting { id, chunks: HashMap::new() });
        }
        for (index, (part, chunk)) in chunks.iter().enumerate() {
            let Some(id) = resident.chunks.get(part) else { continue };
            let parted = mirrors::part(chunk, index, marked);
            self.store.update_chunk(*id, &parted.rest.resized(resident.size), Some(layout))?;
            for (reflecting, (taken, indices)) in resident.reflecting.iter_mut().zip(parted.reflecting) {
                if taken.is_empty() {
                    continue;
                }
                let taken = taken.resized(resident.size);
                let id = self.store.add_chunk(reflecting.id, &taken, Some(layout))?;
                self.origins.insert(id, (cloud.chunk(*part), Some(indices.clone())));
                reflecting.chunks.insert(*part, (id, indices));
            }
        }
        for reflecting in &resident.reflecting {
            self.store.set_visible(reflecting.id, resident.is_visible);
            if let Some((plan, up)) = &resident.color {
                let (known, ids) = reflecting.stored(chunks);
                self.store.set_color(reflecting.id, &known, &ids, plan, *up)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use cloud::{Attribute, Column, ColumnType, pack_normal, pack_radius};
    use glam::Vec3;
    use render::{Frame, Objects, Renderer};
    use scene::{Camera, Color, ColorBy, Lighting, Mirror, Ramp, Settings, Shape};

    use super::*;

    /// A square of points with a value each, facing the camera of `shot`, in a cloud of its own.
    fn put_square(resident: &mut Resident, key: CloudKey, x: f64, ramp: Ramp, size: f32, radius: f32) {
        let positions: Vec<[f32; 3]> =
            (0..400).map(|at| [(at % 20) as f32 * 0.05, 0.0, (at / 20) as f32 * 0.05]).collect();
        let mut chunk = Chunk::new(0, DVec3::new(x, 0.0, -0.5), positions);
        chunk.columns = vec![Some(Arc::new(Column::F32((0..400).map(|at| at as f32).collect())))];
        chunk.normals = Some(Arc::new(vec![pack_normal(Vec3::NEG_Y); 400]));
        chunk.radii = Some(Arc::new(vec![pack_radius(radius); 400]));
        let attributes = vec![Attribute { name: "value".into(), column_type: ColumnType::F32 }];
        let cloud = Cloud { attributes, chunks: vec![chunk.clone()], ..Cloud::default() };
        let color = Color { by: ColorBy::Attribute, attribute: "value".into(), ramp, ..Color::default() };
        let (plan, _) = ColorPlan::new(&cloud, &color, DVec3::Z);
        let (layout, part) = (Arc::new(cloud.layout()), Part::Block(0));
        let all = [
            Change::Open { cloud: key, provisional_radius: radius },
            Change::Size { cloud: key, size },
            Change::Put { key: key.chunk(part), chunk: chunk.clone(), layout },
            Change::Color { cloud: key, chunks: vec![(part, chunk)], plan, up: DVec3::Z },
        ];
        all.into_iter().for_each(|change| resident.apply(change).unwrap());
    }

    #[test]
    fn clouds_beside_each_other_have_ramps_and_sizes_of_their_own() {
        let gpu = match Gpu::headless(None) {
            Ok(gpu) => gpu,
            Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
            Err(error) => return println!("skipped: {error}"),
        };
        let mut renderer = Renderer::new(gpu.clone()).unwrap();
        let mut shot = |resident: &Resident| {
            let camera = Camera::looking(DVec3::ZERO, DVec3::NEG_Y, 3.0, DVec3::Z);
            let mut settings = Settings::default();
            settings.light.by = Lighting::Colors;
            settings.edl.strength = 0.0;
            renderer.render(&resident.store, &Frame::new(&camera, &settings, Objects::default(), [64, 48])).unwrap();
            renderer.read_picture().unwrap()
        };
        let [left, right] = [(CloudKey(1), -1.4), (CloudKey(2), 0.4)];
        let mut both = Resident::new(gpu.clone());
        put_square(&mut both, left.0, left.1, Ramp::Viridis, 1.0, 0.03);
        put_square(&mut both, right.0, right.1, Ramp::Gray, 2.0, 0.01);
        let mut first = Resident::new(gpu.clone());
        put_square(&mut first, left.0, left.1, Ramp::Viridis, 1.0, 0.03);
        // Points of twice the size are those of twice the radius.
        let mut second = Resident::new(gpu);
        put_square(&mut second, right.0, right.1, Ramp::Gray, 1.0, 0.02);
        let [both, first, second] = [&both, &first, &second].map(&mut shot);
        let (mut of_left, mut of_right) = (0, 0);
        for (place, pixel) in both.as_chunks::<4>().0.iter().enumerate() {
            let [one, other] = [&first, &second].map(|alone| alone.as_chunks::<4>().0[place]);
            let is_left = place % 64 < 32;
            assert_eq!(*pixel, if is_left { one } else { other }, "pixel {place}");
            *(if is_left { &mut of_left } else { &mut of_right }) += usize::from(one != other);
        }
        assert!(of_left > 100 && of_right > 100, "{of_left} and {of_right} pixels");
    }

    #[test]
    fn a_mirror_of_another_look_is_not_uploaded_again_and_its_picture_is_that_of_a_new_one() {
        let gpu = match Gpu::headless(None) {
            Ok(gpu) => gpu,
            Err(error) if std::env::var_os("GLINT_REQUIRE_GPU").is_some() => panic!("{error}"),
            Err(error) => return println!("skipped: {error}"),
        };
        let mut renderer = Renderer::new(gpu.clone()).unwrap();
        let before = Mirror {
            color: [0.2, 0.5, 0.8],
            specular_intensity: 0.5,
            specular_power: 30.0,
            as_points: true,
            ..Mirror::standing(Shape::Torus { tube: 0.4 }, DVec3::ZERO, DVec3::Z, DVec3::Y, 1.0)
        };
        let after = Mirror {
            color: [0.9, 0.3, 0.1],
            specular_intensity: 0.8,
            specular_power: 300.0,
            method: Some(scene::Method::EnvironmentMap),
            ..before.clone()
        };
        let key = CloudKey(7);
        let put = |resident: &mut Resident, mirror: &Mirror| {
            let samples = mirror.sample(3000, 1);
            resident.apply(Change::Mirror { cloud: key, mirror: mirror.clone(), samples }).unwrap();
            resident.store.uploaded_bytes()
        };
        let mut picture = |resident: &Resident, mirror: &Mirror| {
            let camera = Camera::looking(DVec3::ZERO, DVec3::new(0.0, -1.0, 0.6), 3.0, DVec3::Z);
            let mut settings = Settings::default();
            settings.gloss.samples = 2;
            let objects = Objects { mirrors: std::slice::from_ref(mirror), ..Objects::default() };
            renderer.forget();
            renderer.render(&resident.store, &Frame::new(&camera, &settings, objects, [64, 48])).unwrap();
            renderer.read_picture().unwrap()
        };
        let mut changed = Resident::new(gpu.clone());
        let uploaded = put(&mut changed, &before);
        let first = picture(&changed, &before);
        assert!(uploaded > 0 && put(&mut changed, &after) == uploaded);
        let mut fresh = Resident::new(gpu);
        put(&mut fresh, &after);
        let shown = picture(&changed, &after);
        assert!(shown == picture(&fresh, &after) && shown != first);
        // A mirror that moves, and one of other points.
        let moved = Mirror { position: DVec3::X * 0.1, ..after.clone() };
        assert!(put(&mut changed, &moved) > uploaded);
        put(&mut fresh, &moved);
        assert!(picture(&changed, &moved) == picture(&fresh, &moved));
    }
}
