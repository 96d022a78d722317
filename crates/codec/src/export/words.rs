//! What is said of a file that is written: where it is not what its files are. Few words, however many files there are.

use std::path::{Path, PathBuf};

use param::shown;

#[derive(Default)]
pub struct Words {
    /// Each word, and the files of which it is true.
    said: Vec<(String, Vec<PathBuf>)>,
}

impl Words {
    pub fn say(&mut self, path: &Path, word: impl Into<String>) {
        let word = word.into();
        match self.said.iter_mut().find(|(said, _)| *said == word) {
            Some((_, paths)) if paths.last().is_some_and(|last| last == path) => {}
            Some((_, paths)) => paths.push(path.to_owned()),
            None => self.said.push((word, vec![path.to_owned()])),
        }
    }

    /// The lines that are shown to people.
    pub fn lines(self) -> Vec<String> {
        let line = |(word, paths): (String, Vec<PathBuf>)| match &paths[..] {
            [] => word,
            [one] => format!("{}: {word}", shown(one)),
            [first, others @ ..] => {
                let files = if others.len() == 1 { "file" } else { "files" };
                format!("{} and {} more {files}: {word}", shown(first), others.len())
            }
        };
        self.said.into_iter().map(line).collect()
    }
}

/// Names in a line: the first of them, and the number of the others.
pub fn few_names(names: &[&str]) -> String {
    const FEW: usize = 6;
    let shown = names[..names.len().min(FEW)].join(", ");
    match names.len().saturating_sub(FEW) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_is_said_once_of_all_files_of_which_it_is_true() {
        let mut words = Words::default();
        for name in ["a", "a", "b", "c"] {
            words.say(Path::new(name), "no colours");
        }
        words.say(Path::new("b"), "rounded");
        assert_eq!(words.lines(), ["a and 2 more files: no colours", "b: rounded"]);
        assert_eq!(few_names(&["a", "b"]), "a, b");
        assert_eq!(few_names(&["a", "b", "c", "d", "e", "f", "g", "h"]), "a, b, c, d, e, f and 2 more");
    }
}
