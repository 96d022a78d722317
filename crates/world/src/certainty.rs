//! How sure the surface of a cloud in memory is, as an attribute of the cloud.

use std::collections::BTreeMap;
use std::sync::Arc;

use cloud::{Attribute, Cloud, Column, ColumnType, Progress, SURFACE_ERROR};

use crate::assembly::Assembly;
use crate::change::Change;

/// The half widths of the intervals for the error of the surface, by the first records of the chunks. `None` when
/// cancelled.
pub fn surface_errors(cloud: &Cloud, progress: &Progress) -> Option<BTreeMap<u64, Arc<Column>>> {
    progress.set_total(cloud.len());
    let errors = cloud::surface_errors(&cloud.chunks, progress)?;
    let column = |(chunk, errors): (&cloud::Chunk, Vec<f32>)| (chunk.first_point, Arc::new(Column::F32(errors)));
    Some(cloud.chunks.iter().zip(errors).map(column).collect())
}

impl Assembly {
    /// The column of how sure the surface is, once it is known. A file may have an attribute of that name, which stands
    /// before it.
    pub fn error_column(&self) -> Option<usize> {
        let own = self.source.as_ref().map_or(0, |source| source.info().attributes.len());
        let index = self.cloud.attributes.iter().rposition(|known| known.name == SURFACE_ERROR)?;
        (index >= own && self.pages.is_none()).then_some(index)
    }

    /// Whether it is not known yet how sure the surface is, and can be found out: all points are in memory with their
    /// normals.
    pub fn lacks_errors(&self) -> bool {
        let is_ready = |chunk: &cloud::Chunk| chunk.normals.is_some();
        self.error_column().is_none() && self.pages.is_none() && self.cloud.chunks.iter().all(is_ready)
    }

    /// Adds how sure the surface is, as `surface_errors` found it.
    pub fn put_errors(&mut self, errors: BTreeMap<u64, Arc<Column>>) -> Vec<Change> {
        let attribute = self.error_column().unwrap_or_else(|| {
            self.cloud.attributes.push(Attribute { name: SURFACE_ERROR.into(), column_type: ColumnType::F32 });
            self.cloud.attributes.len() - 1
        });
        self.put_late_column(attribute, errors)
    }
}

#[cfg(test)]
mod tests {
    use cloud::{Chunk, Surfels};
    use glam::DVec3;

    use super::*;
    use crate::chunk_key::{CloudKey, Part};
    use crate::event::Opened;

    #[test]
    fn a_cloud_knows_how_sure_it_is_once_its_normals_are_there() {
        let opened = Opened { expected_points: 50, up: DVec3::Z, ..Opened::default() };
        let mut cloud = Assembly::open(CloudKey(0), opened).0;
        let block = |first: u64| {
            let points = (first..first + 25).map(|at| [(at / 5) as f32, (at % 5) as f32, 0.01 * (at % 3) as f32]);
            Chunk::new(first, DVec3::ZERO, points.collect())
        };
        for first in [0, 25] {
            drop(cloud.put(Part::Block(first), block(first)));
        }
        assert!(!cloud.lacks_errors(), "there are no normals yet");
        let up = cloud::pack_normal(glam::Vec3::Z);
        drop(
            cloud.put_surfels(
                [25; 2].map(|points| Surfels { normals: vec![up; points], radii: vec![7; points] }).into(),
            ),
        );
        assert!(cloud.lacks_errors() && cloud.error_column().is_none());
        let errors = surface_errors(&cloud.cloud, &Progress::default()).unwrap();
        assert_eq!(cloud.put_errors(errors).len(), 2);
        let column = cloud.error_column().unwrap();
        let values = cloud.chunk(Part::Block(25)).unwrap().columns[column].clone().unwrap();
        assert!(!cloud.lacks_errors() && cloud.cloud.attributes[column].name == SURFACE_ERROR);
        assert!((0..25).all(|point| (0.01..0.05).contains(&values.value(point))));
    }
}
