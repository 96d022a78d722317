//! Prepares mirrors for the renderer, in the same way for the window and the picture file: mirrors with a formula, with
//! the points that represent them, and points of clouds that are turned into mirrors.

use std::collections::BTreeMap;
use std::sync::Arc;

use cloud::{Chunk, Cloud, PointTest, Progress, SPLAT_OVERLAP, unpack_radius};
use glam::DVec3;
use render::{ChunkId, CloudId, ColorPlan, Material, PointStore};
use scene::{ColorBy, Mirror, MirrorNormals, MirrorPoints, Shape};
use stream::{MirrorBound, MirrorForm};

use crate::error::{Error, Result};
use crate::source::{column_of, read_column};

/// Any seed will do; the same one gives the same picture in the window and in a file.
const SEED: u64 = 1;
/// One point in this many is sampled: a prime, so that samples do not follow a scanner's pattern.
const LOOKED_AT: usize = 61;

/// The area of surface that a typical shown point of some clouds represents, in squared world units; NaN if no radius
/// is known.
pub fn area_per_point<'a>(clouds: impl Iterator<Item = &'a Cloud>, test: &PointTest) -> f64 {
    let mut radii: Vec<u16> = Vec::new();
    for cloud in clouds {
        let test = cloud.test(test);
        for chunk in &cloud.chunks {
            let Some(own) = &chunk.radii else { continue };
            let shown = test.shown(chunk, chunk.bounds());
            radii.extend(shown.indices(own.len()).map(|index| own[index]).step_by(LOOKED_AT));
        }
    }
    let middle = radii.len() / 2;
    if radii.is_empty() {
        return f64::NAN;
    }
    // Packed radii sort like the radii.
    let median = unpack_radius(*radii.select_nth_unstable(middle).1);
    let disc = median.map_or(f64::NAN, |radius| f64::from(radius / SPLAT_OVERLAP));
    std::f64::consts::PI * disc * disc
}

/// The points that represent a mirror next to a cloud whose points take `area_per_point` each.
pub fn sample(mirror: &Mirror, area_per_point: f64) -> Vec<Chunk> {
    mirror.sample(mirror.sample_count(area_per_point), SEED)
}

/// Adds the points of a mirror to the store, in its own colour.
///
/// # Errors
/// No more memory.
pub fn upload(store: &mut PointStore, mirror: &Mirror, samples: &[Chunk]) -> render::Result<(CloudId, Vec<ChunkId>)> {
    let id = store.add_cloud(Material::of_mirror(mirror));
    let ids = samples.iter().map(|chunk| store.add_chunk(id, chunk, None)).collect::<render::Result<Vec<_>>>()?;
    let cloud = Cloud { name: mirror.name.clone(), chunks: samples.to_vec(), ..Cloud::default() };
    let own = scene::Color { by: ColorBy::Rgb, ..scene::Color::default() };
    let (plan, _) = ColorPlan::new(&cloud, &own, DVec3::Z);
    store.set_color(id, &cloud, &ids, &plan, DVec3::Z)?;
    Ok((id, ids))
}

/// The ends of its reach along the axes, which framing keeps in the picture.
pub fn outline(mirror: &Mirror) -> [DVec3; 6] {
    let reach = mirror.shape.reach() * mirror.size;
    [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z].map(|axis| mirror.position + axis * reach)
}

/// What the choice of nodes of streamed clouds knows of a mirror.
pub fn bound(mirror: &Mirror) -> MirrorBound {
    let form = match mirror.shape {
        Shape::Plane { .. } => MirrorForm::Flat(mirror.rotation * DVec3::Z),
        Shape::Sphere => MirrorForm::Sphere,
        Shape::Paraboloid { .. }
        | Shape::Cylinder { .. }
        | Shape::Torus { .. }
        | Shape::Blob
        | Shape::Coral
        | Shape::Mesh(_) => MirrorForm::Other,
    };
    MirrorBound { center: mirror.position, radius: mirror.shape.reach() * mirror.size, form }
}

/// The points of a cloud that reflect: a list per chunk, in order.
pub struct Marked {
    marks: Vec<Vec<bool>>,
    /// The packed normals of all points of each chunk; `None` if they keep theirs.
    normals: Option<Vec<Vec<u32>>>,
    pub material: Material,
    pub count: u64,
}

/// A chunk of which some points reflect.
pub struct Parted {
    /// All points; those that reflect have no position (NaN), so that indices stay the file's.
    pub rest: Chunk,
    /// For each list of marks, the points that reflect by it, and their indices in the chunk.
    pub reflecting: Vec<(Chunk, Vec<u32>)>,
}

/// Divides chunk `index` of a cloud; all of `marked` were found for that cloud. The last list that marks a point takes
/// it.
pub fn part(chunk: &Chunk, index: usize, marked: &[Marked]) -> Parted {
    let taker = |point: usize| marked.iter().rposition(|marked| marked.marks[index][point]);
    let takers: Vec<Option<usize>> = (0..chunk.len()).map(taker).collect();
    if takers.iter().all(Option::is_none) {
        return Parted {
            rest: chunk.clone(),
            reflecting: marked.iter().map(|_| (chunk.select(&[]), Vec::new())).collect(),
        };
    }
    let reflecting = marked.iter().enumerate().map(|(list, marked)| {
        let indices: Vec<u32> = (0..chunk.len() as u32).filter(|i| takers[*i as usize] == Some(list)).collect();
        let mut taken = chunk.select(&indices);
        if let Some(normals) = &marked.normals {
            taken.normals = Some(Arc::new(indices.iter().map(|i| normals[index][*i as usize]).collect()));
        }
        (taken, indices)
    });
    let reflecting = reflecting.collect();
    let kept = chunk.positions.iter().zip(&takers);
    let positions = kept.map(|(position, taker)| if taker.is_some() { [f32::NAN; 3] } else { *position }).collect();
    Parted { rest: Chunk { positions: Arc::new(positions), ..chunk.clone() }, reflecting }
}

/// Divides the shown points of a cloud: first those that reflect nothing, then the points of each list, without empty
/// chunks.
pub fn parts(cloud: &Cloud, marked: &[Marked], test: &PointTest) -> Vec<(Material, Vec<Chunk>)> {
    let test = cloud.test(test);
    let materials = std::iter::once(Material::default()).chain(marked.iter().map(|marked| marked.material));
    let mut parts: Vec<(Material, Vec<Chunk>)> = materials.map(|material| (material, Vec::new())).collect();
    for (index, chunk) in cloud.chunks.iter().enumerate() {
        let Parted { rest, reflecting } = part(chunk, index, marked);
        let taken = std::iter::once(rest).chain(reflecting.into_iter().map(|(taken, _)| taken));
        for ((_, chunks), part) in parts.iter_mut().zip(taken) {
            let shown = part.shown(&test);
            chunks.extend((!shown.is_empty()).then_some(shown));
        }
    }
    parts
}

/// Finds the points of `cloud` that `wanted` describes, and their normals. An attribute that is not in memory is read
/// from `source`. `None` when cancelled.
///
/// # Errors
/// The cloud has no such attribute, or the file cannot be read any more.
pub fn mark(
    cloud: &Cloud,
    source: Option<&codec::Source>,
    wanted: &MirrorPoints,
    progress: &Progress,
) -> Result<Option<Marked>> {
    let mut cloud = cloud.clone();
    if let Some(name) = wanted.points.attribute() {
        let Some(index) = cloud.column_of(name) else {
            return Err(Error::NoAttribute { cloud: cloud.name, attribute: name.to_owned() });
        };
        let is_loaded = |chunk: &Chunk| chunk.columns.get(index).is_some_and(Option::is_some);
        if let (false, Some(source)) = (cloud.chunks.iter().all(is_loaded), source) {
            put_columns(&mut cloud, index, &read_column(source, index, progress)?);
        }
    }
    let marks: Vec<Vec<bool>> = cloud.chunks.iter().map(|chunk| wanted.points.marks(&cloud, chunk)).collect();
    let count = marks.iter().flatten().filter(|marked| **marked).count() as u64;
    let material = Material {
        specular_intensity: if wanted.gloss { -wanted.specular_intensity } else { wanted.specular_intensity },
        specular_power: wanted.specular_power,
        refraction: wanted.refraction.unwrap_or(0.0),
        ..Material::default()
    };
    let lists = match wanted.normals {
        MirrorNormals::Own => return Ok(Some(Marked { marks, normals: None, material, count })),
        MirrorNormals::Smooth { radius } => cloud::smoothed_normals(&cloud.chunks, &marks, radius, progress),
        MirrorNormals::Fit { neighbours } => {
            cloud::refitted_normals(&cloud.chunks, &marks, neighbours as usize, progress)
        }
        MirrorNormals::Flatten => Some(flattened(&cloud.chunks, &marks)),
    };
    Ok(lists.map(|lists| Marked { marks, normals: Some(lists), material, count }))
}

fn put_columns(cloud: &mut Cloud, index: usize, columns: &BTreeMap<u64, Arc<cloud::Column>>) {
    for chunk in &mut cloud.chunks {
        if let Some(column) = column_of(chunk, columns) {
            let known = chunk.columns.len().max(index + 1);
            chunk.columns.resize(known, None);
            chunk.columns[index] = Some(column);
        }
    }
}

fn flattened(chunks: &[Chunk], marks: &[Vec<bool>]) -> Vec<Vec<u32>> {
    let plane = cloud::plane_normal(chunks, marks).map(cloud::pack_normal);
    let flatten = |(chunk, marks): (&Chunk, &Vec<bool>)| {
        let own = |index: usize| chunk.normals.as_ref().map_or(cloud::NO_NORMAL, |normals| normals[index]);
        (0..chunk.len()).map(|index| plane.filter(|_| marks[index]).unwrap_or_else(|| own(index))).collect()
    };
    chunks.iter().zip(marks).map(flatten).collect()
}

#[cfg(test)]
mod tests {
    use cloud::{Attribute, Column, ColumnType};
    use scene::{PointChoice, Shape};

    use super::*;

    #[test]
    fn a_mirror_among_points_is_as_dense_as_they_are() {
        let walls = scene::five_mirrors::sample(scene::five_mirrors::Variant::None, 1_000_000, 1).remove(0);
        let walls = Cloud { chunks: walls.chunks, ..Cloud::default() };
        let area = area_per_point([&walls].into_iter(), &PointTest::default());
        // 40 square units, with the radii's overlap of 1.5 instead of that of estimated ones.
        let expected = 40.0 / 1e6 * (1.5 / f64::from(SPLAT_OVERLAP)).powi(2);
        assert!((area / expected - 1.0).abs() < 1e-2, "{area} instead of {expected}");
        assert!(area_per_point(std::iter::empty(), &PointTest::default()).is_nan());
        let mirror = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Z, 0.3);
        let points: usize = sample(&mirror, area).iter().map(Chunk::len).sum();
        assert_eq!(points, mirror.sample_count(area));
    }

    /// Four points in a row, of which the two in the middle are water.
    fn lake() -> Cloud {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.1, 0.0], [3.0, 0.0, 1.0]];
        let normal = cloud::pack_normal(glam::Vec3::new(0.1, 0.0, 1.0).normalize());
        let mut chunk = Chunk::new(0, DVec3::ZERO, positions);
        chunk.normals = Some(Arc::new(vec![normal; 4]));
        chunk.columns = vec![Some(Arc::new(Column::U8(vec![2, 9, 9, 2])))];
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        Cloud { name: "lake.laz".into(), attributes, chunks: vec![chunk], ..Cloud::default() }
    }

    fn wanted(points: PointChoice, normals: MirrorNormals) -> MirrorPoints {
        let whole = MirrorPoints::whole("lake.laz".into());
        MirrorPoints { points, specular_power: 100.0, normals, ..whole }
    }

    #[test]
    fn points_that_are_marked_get_their_normals_and_the_others_keep_theirs() {
        let (cloud, progress) = (lake(), Progress::default());
        let of = |normals| mark(&cloud, None, &wanted(PointChoice::Class(9), normals), &progress).unwrap().unwrap();
        let own = of(MirrorNormals::Own);
        assert_eq!((own.marks, own.count), (vec![vec![false, true, true, false]], 2));
        assert!(own.normals.is_none() && own.material.specular_intensity == 1.0 && !own.material.is_clear());
        let clear = MirrorPoints { refraction: Some(1.33), ..wanted(PointChoice::Class(9), MirrorNormals::Own) };
        assert!(mark(&cloud, None, &clear, &progress).unwrap().unwrap().material.is_clear());
        let glossy = MirrorPoints { gloss: true, ..wanted(PointChoice::Class(9), MirrorNormals::Own) };
        let glossy = mark(&cloud, None, &glossy, &progress).unwrap().unwrap();
        assert_eq!((glossy.material.specular_intensity, glossy.material.specular_power), (-1.0, 100.0));
        for normals in [MirrorNormals::Smooth { radius: 5.0 }, MirrorNormals::Flatten] {
            let normals = of(normals).normals.unwrap();
            let before = cloud.chunks[0].normals.as_ref().unwrap();
            assert_eq!((normals[0][0], normals[0][3]), (before[0], before[3]));
        }
    }

    #[test]
    fn a_parted_chunk_has_every_point_once_and_the_last_mark_decides() {
        let (cloud, progress) = (lake(), Progress::default());
        let found = |points, normals| mark(&cloud, None, &wanted(points, normals), &progress).unwrap().unwrap();
        let bounds = (DVec3::new(1.5, -1.0, -1.0), DVec3::new(9.0, 1.0, 0.5));
        let near = PointChoice::Box { min: bounds.0, max: bounds.1 };
        let marked = [found(PointChoice::Class(9), MirrorNormals::Own), found(near, MirrorNormals::Flatten)];
        let Parted { rest, reflecting } = part(&cloud.chunks[0], 0, &marked);
        let indices: Vec<&[u32]> = reflecting.iter().map(|(_, indices)| indices.as_slice()).collect();
        assert_eq!(indices, [&[1][..], &[2]]);
        assert_eq!(reflecting[1].0.position(0), cloud.chunks[0].position(2));
        let stays: Vec<bool> = (0..4).map(|index| rest.position(index).is_finite()).collect();
        assert_eq!(stays, [true, false, false, true]);
        let whole = part(&cloud.chunks[0], 0, &[]);
        assert!(whole.reflecting.is_empty() && whole.rest.positions == cloud.chunks[0].positions);
    }

    #[test]
    fn an_attribute_that_is_not_there_is_named() {
        let choice = PointChoice::Attribute { name: "wetness".into(), low: 0.0, high: 1.0 };
        let error = mark(&lake(), None, &wanted(choice, MirrorNormals::Own), &Progress::default()).err();
        assert!(error.is_some_and(|error| error.to_string().contains("`wetness`")));
    }
}
