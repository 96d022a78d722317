//! `cargo xtask soak`: random use of the window for a long time. `tests/examples/soak.rs` is the hand.

use std::path::Path;
use std::process::{Command, ExitCode};

use anyhow::Result;

use crate::shell::{cargo, exit_code, provide, root, status, target_folder};
use crate::{needs, testing};

/// What `cargo xtask soak` does.
#[derive(Debug, PartialEq)]
pub struct Soaking {
    minutes: f64,
    /// The seed of the actions.
    seed: u64,
}

/// The longest time: a week.
const MOST_MINUTES: f64 = 7.0 * 24.0 * 60.0;

impl Soaking {
    /// Parses the words after `soak`; `None` if they are not understood.
    pub fn parse(words: &[&str]) -> Option<Self> {
        let mut soaking = Self { minutes: 60.0, seed: 1 };
        for pair in words.chunks(2) {
            match pair {
                ["--minutes", minutes] => soaking.minutes = minutes.parse().ok()?,
                ["--seed", seed] => soaking.seed = seed.parse().ok()?,
                _ => return None,
            }
        }
        (soaking.minutes > 0.0 && soaking.minutes <= MOST_MINUTES).then_some(soaking)
    }
}

/// Builds the program and uses it. The results lie in `target/soak`.
pub fn soak(soaking: &Soaking) -> Result<ExitCode> {
    provide(needs::needs_to_test())?;
    let root = root()?;
    let target = target_folder(&root);
    let mut building = cargo();
    // The whole workspace is selected, so that dependencies are compiled with the features they always have.
    building.args(["build", "--release", "--workspace", "--locked", "--bin", "glint", "--example", "soak"]);
    let built = status(building.current_dir(&root))?;
    if !built.success() {
        return Ok(exit_code(built));
    }
    let program =
        |name: &str| target.join("release").join(Path::new(name).with_extension(std::env::consts::EXE_EXTENSION));
    let mut hand = Command::new(program("examples/soak"));
    hand.args([soaking.minutes.to_string(), soaking.seed.to_string()]).arg(target.join("soak"));
    hand.env("GLINT_TEST_PROGRAM", program("glint"));
    if let Some(folder) = testing::runtime_folder()? {
        hand.env("XDG_RUNTIME_DIR", folder);
    }
    Ok(exit_code(status(&mut hand)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_give_the_time_and_the_seed() {
        assert_eq!(Soaking::parse(&[]), Some(Soaking { minutes: 60.0, seed: 1 }));
        assert_eq!(Soaking::parse(&["--seed", "7", "--minutes", "0.5"]), Some(Soaking { minutes: 0.5, seed: 7 }));
        for words in [&["--minutes"] as &[&str], &["--minutes", "0"], &["--minutes", "NaN"], &["--seed", "-1"], &["7"]]
        {
            assert_eq!(Soaking::parse(words), None, "{words:?}");
        }
    }
}
