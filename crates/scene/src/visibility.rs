//! Which points of the clouds are shown, in the form that is kept, saved and undone. The test of a point is
//! `cloud::PointTest`.

use std::collections::BTreeSet;
use std::fmt;

use cloud::PointTest;
use serde::de::{Error, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use crate::Clip;

/// `[visibility]` of a scene file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Visibility {
    /// The classes whose points are hidden, in every cloud. Points without a class are shown.
    #[serde(default, deserialize_with = "classes")]
    pub hidden_classes: BTreeSet<u8>,
    /// The ranges of attributes outside of which points are hidden. Points are shown that pass all of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub filters: Vec<Filter>,
}

/// Hides the points whose attribute is outside of a range; its ends are inside. A point without a value is in no range.
/// Clouds without the attribute are shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Filter {
    /// The name of the attribute, as `glint info` gives it.
    pub attribute: String,
    #[serde(default = "lowest", skip_serializing_if = "is_infinite")]
    pub low: f64,
    #[serde(default = "highest", skip_serializing_if = "is_infinite")]
    pub high: f64,
}

fn lowest() -> f64 {
    f64::NEG_INFINITY
}

fn highest() -> f64 {
    f64::INFINITY
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_infinite(end: &f64) -> bool {
    end.is_infinite()
}

impl Filter {
    /// Why it is not a valid filter, in words.
    pub(crate) fn problem(&self) -> Option<String> {
        let Self { attribute, low, high } = self;
        // NaN fails the comparison.
        let is_range = low <= high && *low < f64::INFINITY && *high > f64::NEG_INFINITY;
        if attribute.is_empty() {
            return Some("the attribute has no name".into());
        }
        (!is_range).then(|| format!("the range of {attribute} from {low} to {high} is empty"))
    }
}

impl Visibility {
    /// Whether neither classes nor filters hide a point.
    pub fn shows_all(&self) -> bool {
        *self == Self::default()
    }

    /// The test of points by these rules and by the clip volumes that are on.
    pub fn test<'a>(&self, clips: impl IntoIterator<Item = &'a Clip>) -> PointTest {
        let filter = |Filter { attribute, low, high }: &Filter| cloud::Filter {
            attribute: attribute.clone(),
            low: *low,
            high: *high,
        };
        let volumes = clips.into_iter().filter(|clip| clip.on).map(Clip::volume);
        let filters = self.filters.iter().map(filter);
        PointTest::new(self.hidden_classes.iter().copied(), filters.collect(), volumes.collect())
    }

    /// Hides everything that `other` hides, too.
    pub fn hide(&mut self, other: &Self) {
        self.hidden_classes.extend(&other.hidden_classes);
        self.filters.extend(other.filters.iter().cloned());
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
        let visibility = Visibility { hidden_classes: [18, 0, 255, 7].into(), ..Visibility::default() };
        let file = SceneFile { visibility, ..SceneFile::default() };
        assert_eq!(file.to_text(), "[visibility]\nhidden_classes = [0, 7, 18, 255]\n");
        assert_eq!(SceneFile::parse(&file.to_text()).unwrap(), file);
        assert_eq!(SceneFile::default().to_text(), "");
        let twice = SceneFile::parse("[visibility]\nhidden_classes = [7, 7]\n").unwrap().visibility;
        let test = twice.test([]);
        assert!(!test.shows_class(7) && test.shows_class(8));
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

    #[test]
    fn filters_survive_the_text_and_odd_ones_are_refused_by_number() {
        let filter = |attribute: &str, low, high| Filter { attribute: attribute.into(), low, high };
        let filters = vec![
            filter("intensity", 100.0, 4000.0),
            filter("Deviation, 2nd", -0.1, f64::INFINITY),
            filter("gps_time", f64::NEG_INFINITY, 1.0 / 3.0),
        ];
        let visibility = Visibility { filters, ..Visibility::default() };
        let file = SceneFile { visibility, ..SceneFile::default() };
        assert_eq!(SceneFile::parse(&file.to_text()).unwrap(), file, "{}", file.to_text());
        let short = "[visibility]\nfilters = [{ attribute = \"intensity\", low = 100, high = 4000.0 }]\n";
        assert_eq!(SceneFile::parse(short).unwrap().visibility.filters, file.visibility.filters[..1]);
        let refusal = |odd: &str| {
            let text = format!("[visibility]\nfilters = [{{ attribute = \"a\" }}, {odd}]\n");
            SceneFile::parse(&text).unwrap_err().to_string()
        };
        for (odd, problem) in [
            ("{ attribute = \"b\", low = 2.0, high = 1.0 }", "filter 2 (`b`): the range of b from 2 to 1 is empty"),
            ("{ attribute = \"b\", low = nan }", "is empty"),
            ("{ attribute = \"b\", low = inf }", "is empty"),
            ("{ attribute = \"\", low = 1.0 }", "has no name"),
            ("{ low = 1.0 }", "attribute"),
            ("{ attribute = \"b\", least = 1.0 }", "least"),
        ] {
            assert!(refusal(odd).contains(problem), "{odd}: {}", refusal(odd));
        }
    }
}
