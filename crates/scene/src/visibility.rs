//! Which points of the clouds are shown, in the form that is kept, saved and undone. The test of a point is
//! `cloud::PointTest`, or on the GPU shaders/shared/visibility.wgsl.

use std::collections::BTreeSet;
use std::fmt;

use cloud::PointTest;
use serde::de::{Error, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// `[visibility]` of a scene file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Visibility {
    /// The classes whose points are hidden, in every cloud. Points without a class are shown.
    #[serde(default, deserialize_with = "classes")]
    pub hidden_classes: BTreeSet<u8>,
}

impl Visibility {
    pub fn shows_all(&self) -> bool {
        self.test().shows_all()
    }

    pub fn test(&self) -> PointTest {
        PointTest::hiding(self.hidden_classes.iter().copied())
    }

    /// Hides everything that `other` hides, too.
    pub fn hide(&mut self, other: &Self) {
        self.hidden_classes.extend(&other.hidden_classes);
    }
}

/// Numbers of classes, with an error that says in words what is expected.
fn classes<'a, D: Deserializer<'a>>(deserializer: D) -> Result<BTreeSet<u8>, D::Error> {
    struct List;
    struct Class(u8);

    impl<'a> Visitor<'a> for List {
        type Value = BTreeSet<u8>;

        fn expecting(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
            text.write_str("a list of classes, like [7, 18]")
        }

        fn visit_seq<A: SeqAccess<'a>>(self, mut list: A) -> Result<Self::Value, A::Error> {
            let mut classes = BTreeSet::new();
            while let Some(Class(class)) = list.next_element()? {
                classes.insert(class);
            }
            Ok(classes)
        }
    }

    impl Visitor<'_> for Class {
        type Value = Self;

        fn expecting(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
            text.write_str("a class, a whole number from 0 to 255")
        }

        fn visit_i64<E: Error>(self, class: i64) -> Result<Self, E> {
            let class = u8::try_from(class).map_err(|_| E::invalid_value(Unexpected::Signed(class), &self))?;
            Ok(Self(class))
        }
    }

    impl<'a> Deserialize<'a> for Class {
        fn deserialize<D: Deserializer<'a>>(deserializer: D) -> Result<Self, D::Error> {
            deserializer.deserialize_i64(Self(0))
        }
    }

    deserializer.deserialize_seq(List)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneFile;

    #[test]
    fn hidden_classes_survive_the_text_and_nothing_is_written_where_all_is_shown() {
        let visibility = Visibility { hidden_classes: [18, 0, 255, 7].into() };
        let file = SceneFile { visibility, ..SceneFile::default() };
        assert_eq!(file.to_text(), "[visibility]\nhidden_classes = [0, 7, 18, 255]\n");
        assert_eq!(SceneFile::parse(&file.to_text()).unwrap(), file);
        assert_eq!(SceneFile::default().to_text(), "");
        let twice = SceneFile::parse("[visibility]\nhidden_classes = [7, 7]\n").unwrap().visibility;
        assert!(!twice.test().shows(Some(7)) && twice.test().shows(Some(8)) && twice.test().shows(None));
        assert!(SceneFile::parse("[visibility]\n").unwrap().visibility.shows_all());
    }

    #[test]
    fn what_is_no_list_of_classes_is_refused_with_the_line() {
        let refusal = |value: &str| {
            let text = format!("clouds = []\n[visibility]\nhidden_classes = {value}\n");
            let error = SceneFile::parse(&text).unwrap_err().to_string();
            assert!(error.contains("line 3") && error.lines().count() == 1, "{value}: {error}");
            error
        };
        assert!(refusal("[7, 300]").contains("integer `300`, expected a class, a whole number from 0 to 255"));
        assert!(refusal("[-1]").contains("`-1`, expected a class"));
        assert!(refusal("[7.5]").contains("floating point `7.5`, expected a class"));
        assert!(refusal("[\"ground\"]").contains("expected a class"));
        assert!(refusal("7").contains("integer `7`, expected a list of classes"));
        assert!(refusal("{ ground = 2 }").contains("expected a list of classes"));
        let unknown = SceneFile::parse("[visibility]\nhiden_classes = [7]\n").unwrap_err().to_string();
        assert!(unknown.contains("line 2") && unknown.contains("hiden_classes"), "{unknown}");
    }
}
