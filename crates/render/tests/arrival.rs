//! The picture does not depend on the order in which clouds and chunks arrive in the store, not even where points are
//! equally near: this holds for the camera's view, the light, and what any method finds for a mirror.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[macro_use]
mod stage;

use std::sync::Arc;

use cloud::{Chunk, Cloud};
use glam::DVec3;
use param::Choice as _;
use render::{ChunkId, ColorPlan, Frame, Material, Objects, PointStore};
use scene::five_mirrors::{self, Variant};
use scene::{LightClues, Method, Mirror, Settings};

use stage::Stage;

const SIZE: [u32; 2] = [96, 72];
const COLORS: [[u8; 4]; 2] = [[220, 60, 40, 255], [40, 90, 220, 255]];

/// The order in which things arrive in a store.
#[derive(Clone, Copy, PartialEq)]
enum Arrival {
    InOrder,
    /// The last cloud and the last chunk first, and some chunks twice.
    Mixed,
    /// In order, but the clouds have changed places.
    OtherOrder,
}

/// A mirror ball in a box whose walls exist twice, in two colours.
struct Walls {
    chunks: Vec<Chunk>,
    mirror: Mirror,
    samples: Vec<Chunk>,
}

fn walls() -> Walls {
    let (mirrors, walls): (Vec<_>, Vec<_>) =
        five_mirrors::sample(Variant::Sphere, 30_000, 1).into_iter().partition(|part| part.mirror.is_some());
    let ball = mirrors.into_iter().next().unwrap();
    let chunks: Vec<Chunk> = walls.into_iter().flat_map(|part| part.chunks).collect();
    assert!(chunks.len() > 2, "one chunk has no order");
    Walls { chunks, mirror: ball.mirror.unwrap(), samples: ball.chunks }
}

fn add(store: &mut PointStore, order: u64, material: Material, chunks: &[Chunk], arrival: Arrival) {
    let id = store.add_cloud(material);
    store.set_order(id, order);
    let mut ids: Vec<Option<ChunkId>> = vec![None; chunks.len()];
    let forward: Vec<usize> = (0..chunks.len()).collect();
    let backward: Vec<usize> = (0..chunks.len()).rev().chain((0..chunks.len()).step_by(2)).collect();
    for index in if arrival == Arrival::Mixed { backward } else { forward } {
        if let Some(before) = ids[index].take() {
            store.remove_chunk(before);
        }
        ids[index] = Some(store.add_chunk(id, &chunks[index], None).unwrap());
    }
    let ids: Vec<ChunkId> = ids.into_iter().flatten().collect();
    let cloud = Cloud { chunks: chunks.to_vec(), ..Cloud::default() };
    let (plan, _) = ColorPlan::new(&cloud, &Settings::default().color, DVec3::Z);
    store.set_color(id, &cloud, &ids, &plan, DVec3::Z).unwrap();
}

fn store(stage: &Stage, walls: &Walls, arrival: Arrival) -> PointStore {
    let mut store = PointStore::new(stage.gpu.clone());
    let painted = |color| -> Vec<Chunk> {
        let paint = |chunk: &Chunk| Chunk { colors: Some(Arc::new(vec![color; chunk.len()])), ..chunk.clone() };
        walls.chunks.iter().map(paint).collect()
    };
    let material = Material { specular_intensity: 1.0, has_formula: true, ..Material::default() };
    let clouds = [
        (0, Material::default(), painted(COLORS[0])),
        (1, Material::default(), painted(COLORS[1])),
        (2, material, walls.samples.clone()),
    ];
    let places = if arrival == Arrival::Mixed { [2, 1, 0] } else { [0, 1, 2] };
    for (order, material, chunks) in places.map(|place| &clouds[place]) {
        let is_wall = *order < 2;
        let order = if arrival == Arrival::OtherOrder && is_wall { 1 - order } else { *order };
        add(&mut store, order, *material, chunks, arrival);
    }
    store
}

fn picture(stage: &mut Stage, store: &PointStore, walls: &Walls, settings: &Settings) -> Vec<u8> {
    let objects = Objects {
        mirrors: std::slice::from_ref(&walls.mirror),
        lights: &[five_mirrors::light()],
        clues: LightClues::default(),
    };
    stage.renderer.forget();
    stage.renderer.render(store, &Frame::new(&five_mirrors::camera(), settings, objects, SIZE)).unwrap();
    stage.renderer.read_picture().unwrap()
}

#[test]
fn pictures_do_not_depend_on_the_order_in_which_points_come() {
    let mut stage = stage_or_skip!();
    let walls = walls();
    let [first, mixed, other] =
        [Arrival::InOrder, Arrival::Mixed, Arrival::OtherOrder].map(|arrival| store(&stage, &walls, arrival));
    let mut settings = Settings::default();
    settings.gi.vpls = 64;
    settings.set_text("splat.quality", "nearest").unwrap();
    for method in Method::NAMES {
        settings.set_text("reflection.method", method).unwrap();
        let [first, mixed, other] = [&first, &mixed, &other].map(|store| picture(&mut stage, store, &walls, &settings));
        let differing = first.iter().zip(&mixed).filter(|(a, b)| a != b).count();
        assert_eq!(differing, 0, "{method}: bytes of the picture");
        // Every point exists twice: only the order decides which one is visible.
        assert!(first != other, "{method}: the order of the clouds is not seen, so this proves nothing");
    }
}
