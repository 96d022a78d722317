//! The radii of points while others are hidden.

use std::sync::Arc;

use rayon::prelude::*;

use crate::{Chunk, Cloud, NO_RADIUS, PointTest, Progress, ShownPoints, SurfelOptions, estimate};

/// The radii of a cloud's points, one list for each chunk, where those that `test` shows count their neighbours among
/// themselves: a surface is no denser for the points that are hidden in it. Hidden points keep their radii. `None` when
/// cancelled.
pub fn radii_among(
    cloud: &Cloud,
    test: &PointTest,
    options: &SurfelOptions,
    progress: &Progress,
) -> Option<Vec<Arc<Vec<u16>>>> {
    let test = cloud.test(test);
    let shown: Vec<ShownPoints> = cloud.chunks.par_iter().map(|chunk| test.shown(chunk, chunk.bounds())).collect();
    let own = |chunk: &Chunk| chunk.radii.clone().unwrap_or_else(|| Arc::new(vec![NO_RADIUS; chunk.len()]));
    if shown.iter().all(|shown| *shown == ShownPoints::All) {
        return Some(cloud.chunks.iter().map(own).collect());
    }
    let indices = |shown: &ShownPoints, chunk: &Chunk| -> Vec<u32> {
        shown.indices(chunk.len()).map(|index| index as u32).collect()
    };
    let select = |(chunk, shown): (&Chunk, &ShownPoints)| {
        let (positions, normals, station) = (chunk.positions.clone(), chunk.normals.clone(), chunk.station);
        Chunk { positions, normals, station, ..Chunk::new(0, chunk.origin, Vec::new()) }.select(&indices(shown, chunk))
    };
    let selected: Vec<Chunk> = cloud.chunks.par_iter().zip(&shown).map(select).collect();
    let estimated = estimate(&selected, options, progress)?;
    let merge = |((chunk, shown), estimated): ((&Chunk, &ShownPoints), crate::Surfels)| {
        let mut radii = own(chunk);
        let places = Arc::make_mut(&mut radii);
        for (index, radius) in shown.indices(chunk.len()).zip(estimated.radii) {
            places[index] = radius;
        }
        radii
    };
    Some(cloud.chunks.iter().zip(&shown).zip(estimated).map(merge).collect())
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::{Attribute, Column, ColumnType, Orientation, unpack_radius};

    /// A level square of points a metre apart in class 2, among so many that all are a quarter of a metre apart, the
    /// others of class 7.
    fn square() -> Cloud {
        let side = 0..81_i32;
        let (mut positions, mut classes) = (Vec::new(), Vec::new());
        for (x, y) in side.clone().flat_map(|x| side.clone().map(move |y| (x, y))) {
            positions.push([x as f32 / 4.0, y as f32 / 4.0, 0.0]);
            classes.push(if x % 4 == 0 && y % 4 == 0 { 2 } else { 7 });
        }
        let chunk = |(number, (positions, classes)): (usize, (&[[f32; 3]], &[u8]))| Chunk {
            columns: vec![Some(Arc::new(Column::U8(classes.to_vec())))],
            ..Chunk::new(1000 * number as u64, DVec3::new(5e5, 4e6, 100.0), positions.to_vec())
        };
        let chunks = positions.chunks(1000).zip(classes.chunks(1000)).enumerate().map(chunk).collect();
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        let mut cloud = Cloud { attributes, chunks, ..Cloud::default() };
        let surfels = estimate(&cloud.chunks, &options(), &Progress::default()).unwrap();
        for (chunk, surfels) in cloud.chunks.iter_mut().zip(surfels) {
            (chunk.normals, chunk.radii) = (Some(Arc::new(surfels.normals)), Some(Arc::new(surfels.radii)));
        }
        cloud
    }

    fn options() -> SurfelOptions {
        SurfelOptions::new(Orientation::Up(Vec3::Z))
    }

    /// The median radius of the points of a class.
    fn median(cloud: &Cloud, radii: &[Arc<Vec<u16>>], class: u8) -> f32 {
        let of_chunk = |(chunk, radii): (&Chunk, &Arc<Vec<u16>>)| -> Vec<u16> {
            let classes = chunk.classes(Some(0)).unwrap();
            radii.iter().zip(classes.iter()).filter(|(_, own)| **own == class).map(|(radius, _)| *radius).collect()
        };
        let mut all: Vec<u16> = cloud.chunks.iter().zip(radii).flat_map(of_chunk).collect();
        all.sort_unstable();
        unpack_radius(all[all.len() / 2]).unwrap()
    }

    #[test]
    fn points_of_a_shown_class_have_the_radii_of_their_own_density() {
        let cloud = square();
        let of = |hidden: &[u8]| {
            let test = PointTest::hiding(hidden.iter().copied());
            radii_among(&cloud, &test, &options(), &Progress::default()).unwrap()
        };
        let (all, sparse) = (of(&[]), of(&[7]));
        let own: Vec<Arc<Vec<u16>>> = cloud.chunks.iter().map(|chunk| chunk.radii.clone().unwrap()).collect();
        assert_eq!(all, own);
        // Points four times as far from one another, by the sixteen nearest of each.
        let growth = median(&cloud, &sparse, 2) / median(&cloud, &all, 2);
        assert!((growth - 4.0).abs() < 0.01, "{growth}");
        assert_eq!(median(&cloud, &sparse, 7), median(&cloud, &all, 7), "the hidden ones keep theirs");
        // Radii are those of a file that has the shown points alone.
        let alone = cloud.shown(&PointTest::hiding([7]));
        let alone = Cloud { chunks: alone.chunks, ..cloud.clone() };
        let bare = alone.chunks.iter().map(|chunk| Chunk { radii: None, ..chunk.clone() }).collect::<Vec<_>>();
        let expected: Vec<u16> = estimate(&bare, &options(), &Progress::default())
            .unwrap()
            .into_iter()
            .flat_map(|surfels| surfels.radii)
            .collect();
        let found: Vec<u16> = cloud
            .chunks
            .iter()
            .zip(&sparse)
            .flat_map(|(chunk, radii)| {
                let classes = chunk.classes(Some(0)).unwrap().to_vec();
                radii
                    .iter()
                    .copied()
                    .zip(classes)
                    .filter(|(_, class)| *class == 2)
                    .map(|(radius, _)| radius)
                    .collect::<Vec<_>>()
            })
            .collect();
        assert_eq!(found, expected);
        let cancelled = Progress::default();
        cancelled.cancel();
        assert!(radii_among(&cloud, &PointTest::hiding([7]), &options(), &cancelled).is_none());
    }
}
