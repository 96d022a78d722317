//! Tests on the CPU whether a point is shown; everything that is computed from points asks it. `scene::Visibility`
//! keeps and saves what is hidden; shaders/shared/visibility.wgsl does the same test on the GPU.

use crate::{Chunk, Cloud, Column};

/// Decides which points are shown. A point without a class is never hidden by class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointTest {
    /// A bit for each class; 1 means shown.
    class_words: [u32; 8],
}

impl Default for PointTest {
    fn default() -> Self {
        Self { class_words: [u32::MAX; 8] }
    }
}

impl PointTest {
    pub fn hiding(classes: impl IntoIterator<Item = u8>) -> Self {
        let mut test = Self::default();
        classes.into_iter().for_each(|class| test.class_words[usize::from(class >> 5)] &= !(1 << (class & 31)));
        test
    }

    pub fn shows_all(&self) -> bool {
        *self == Self::default()
    }

    /// The words that the GPU tests: class `c` is shown if bit `c % 32` of word `c / 32` is set.
    pub fn class_words(&self) -> [u32; 8] {
        self.class_words
    }

    pub fn shows(&self, class: Option<u8>) -> bool {
        class.is_none_or(|class| self.class_words[usize::from(class >> 5)] & (1 << (class & 31)) != 0)
    }
}

impl Chunk {
    /// The classes of the points, if column `index` contains classes.
    pub fn classes(&self, index: Option<usize>) -> Option<&[u8]> {
        match self.columns.get(index?)?.as_deref()? {
            Column::U8(classes) => Some(classes),
            _ => None,
        }
    }

    /// The points that are shown; `classes` is the index of the column that holds their classes.
    pub fn shown(&self, classes: Option<usize>, test: &PointTest) -> Self {
        let Some(classes) = self.classes(classes).filter(|_| !test.shows_all()) else { return self.clone() };
        let is_shown = |index: &u32| test.shows(Some(classes[*index as usize]));
        let indices: Vec<u32> = (0..self.len() as u32).filter(is_shown).collect();
        if indices.len() == self.len() { self.clone() } else { self.select(&indices) }
    }
}

impl Cloud {
    /// The index of the column that holds the classes of the points.
    pub fn class_column(&self) -> Option<usize> {
        self.column_of("classification")
    }

    /// The points that are shown, in chunks of which none is empty.
    pub fn shown(&self, test: &PointTest) -> Self {
        let classes = self.class_column();
        let chunks = self.chunks.iter().map(|chunk| chunk.shown(classes, test)).filter(|chunk| !chunk.is_empty());
        let chunks = chunks.collect();
        Self { name: self.name.clone(), attributes: self.attributes.clone(), grid: self.grid, chunks }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::{Attribute, ColumnType};

    #[test]
    fn every_class_is_told_from_every_other() {
        for hidden in 0..=255 {
            let test = PointTest::hiding([hidden]);
            assert!((0..=255).all(|class| test.shows(Some(class)) == (class != hidden)), "{hidden}");
            assert_eq!(test.class_words().iter().map(|word| word.count_zeros()).sum::<u32>(), 1);
            assert!(test.shows(None) && !test.shows_all());
        }
        assert!(PointTest::hiding([]).shows_all());
    }

    #[test]
    fn a_cloud_shows_the_points_of_other_classes_and_all_points_without_a_class() {
        let chunk = |column| {
            let mut chunk = Chunk::new(0, DVec3::ZERO, (0..4).map(|at| [at as f32; 3]).collect());
            chunk.columns = vec![Some(Arc::new(column))];
            chunk
        };
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        let chunks =
            vec![chunk(Column::U8(vec![2, 6, 2, 7])), chunk(Column::U8(vec![7; 4])), chunk(Column::I8(vec![7; 4]))];
        let cloud = Cloud { attributes, chunks, ..Cloud::default() };
        let shown = cloud.shown(&PointTest::hiding([6, 7]));
        assert_eq!(shown.chunks.iter().map(Chunk::len).collect::<Vec<_>>(), [2, 4], "none is empty");
        assert_eq!(*shown.chunks[0].positions, [[0.0; 3], [2.0; 3]]);
        assert_eq!(cloud.shown(&PointTest::default()).len(), 12);
        let unnamed = Cloud { attributes: Vec::new(), ..cloud };
        assert_eq!(unnamed.shown(&PointTest::hiding([2, 6, 7])).len(), 12);
    }
}
