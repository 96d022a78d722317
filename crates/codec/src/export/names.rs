//! Names of fields, each once: in a file that is written also within the length that the format gives them.

use std::collections::{HashMap, HashSet};

use crate::brief::brief;

/// The names that are taken.
#[derive(Default)]
pub struct Names {
    /// The number that is tried next for each name.
    taken: HashMap<String, usize>,
    /// Whether names may differ in upper and lower case alone, which some programs do not tell apart.
    has_case: bool,
}

/// The length in bytes of the name of an extra dimension of LAS.
pub const EXTRA_LENGTH: usize = 32;

impl Names {
    pub fn with_case() -> Self {
        Self { has_case: true, ..Self::default() }
    }

    /// Takes a name, or the nearest one that is free and has no more than `most` bytes.
    pub fn take(&mut self, name: &str, most: usize) -> String {
        let mut short = name;
        if short.len() > most {
            // CloudCompare puts it before all names in PLY files, and takes it off again.
            short = short.strip_prefix("scalar_").unwrap_or(short);
        }
        let key = |name: &str| if self.has_case { name.to_owned() } else { name.to_lowercase() };
        let first = cut(short, most).to_owned();
        let mut free = first.clone();
        let mut number = self.taken.get(&key(&first)).copied().unwrap_or(2);
        while self.taken.contains_key(&key(&free)) {
            let ending = format!("_{number}");
            free = format!("{}{ending}", cut(short, most.saturating_sub(ending.len())));
            number += 1;
        }
        let keys = [key(&first), key(&free)];
        self.taken.extend(keys.into_iter().zip([number, 2]));
        free
    }
}

/// Gives each of some names of a file that is there before a name that no other has. `what` says what has the names.
/// Returns what is to be said of that.
pub fn tell_apart<'a>(names: impl Iterator<Item = &'a mut String>, what: &str) -> Vec<String> {
    let (mut taken, mut known) = (Names::with_case(), HashSet::new());
    let mut further: Vec<&mut String> = names.collect();
    further.retain(|name| {
        let is_first = known.insert((*name).clone());
        if is_first {
            taken.take(name, usize::MAX);
        }
        !is_first
    });
    let renamed = further.into_iter().map(|name| {
        let free = taken.take(name, usize::MAX);
        let told = format!("a further {what} {} is called {} here", brief(name), brief(&free));
        *name = free;
        told
    });
    param::few(renamed.collect(), "names that are there twice")
}

/// The start of a text, whole characters of no more than `most` bytes.
fn cut(text: &str, most: usize) -> &str {
    &text[..text.floor_char_boundary(most)]
}

/// The start of a file's name, which leaves room for what makes a temporary name of it: most systems allow names of 255
/// bytes.
pub fn short_file_name(name: &str) -> &str {
    cut(name, 100)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_different_within_their_bytes() {
        let mut names = Names::default();
        let long = ["scalar_Roughness_radius_0.250000_m_a", "scalar_Roughness_radius_0.250000_m_b"];
        assert_eq!(long.map(|name| names.take(name, 32)), long.map(|name| name["scalar_".len()..].to_owned()));
        let same = "a very long name of a dimension, ";
        let taken = ["one", "two", "three"].map(|end| names.take(&format!("{same}{same}{end}"), 32));
        assert_eq!(
            taken,
            [
                "a very long name of a dimension,",
                "a very long name of a dimensio_2",
                "a very long name of a dimensio_3"
            ]
        );
        assert_eq!(
            (names.take("B", 32), names.take("b", 32), names.take("b_2", 32)),
            ("B".into(), "b_2".into(), "b_2_2".into())
        );
        // Whole characters.
        assert_eq!(names.take("ääääääääääääääääää", 33), "ä".repeat(16));
        assert_eq!(names.take("ääääääääääääääääää", 33), format!("{}_2", "ä".repeat(15)));
    }
}
