//! `cargo xtask systems`: type-checks the workspace for Windows and macOS. That compiles what is written for them alone,
//! and runs nothing. Where the standard library of one of them is not installed, a copy of our own sources is checked by
//! that of this system, with each `cfg` as it is there: that sees less, since libraries stay those of this system.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};

use anyhow::{Context as _, Result, ensure};

/// A system that the program is meant for, and the C compiler that some crates ask for when they are checked for it.
struct System {
    target: &'static str,
    compiler: Option<&'static str>,
    /// The words of `cfg` that hold on it; those of `WORDS` that are not among them do not.
    holds: &'static [&'static str],
    /// Modules of the standard library that it lacks.
    lacks: &'static [&'static str],
}

const SYSTEMS: [System; 2] = [
    System {
        target: "x86_64-pc-windows-gnu",
        compiler: Some("x86_64-w64-mingw32-gcc"),
        holds: &["windows", "target_os = \"windows\""],
        lacks: &["std::os::unix", "std::os::linux", "std::os::fd"],
    },
    System {
        target: "aarch64-apple-darwin",
        compiler: None,
        holds: &["unix", "target_os = \"macos\"", "target_vendor = \"apple\""],
        lacks: &["std::os::linux", "std::os::windows"],
    },
];

/// What a `cfg` may say of the system.
const WORDS: [&str; 6] = [
    "target_os = \"linux\"",
    "target_os = \"macos\"",
    "target_os = \"windows\"",
    "target_vendor = \"apple\"",
    "unix",
    "windows",
];

/// Checks for all systems, `cargo` being a new command of cargo's, and `target` the folder of its results. Returns the names
/// of those that fail.
///
/// # Errors
/// A tool does not start, or the sources cannot be copied.
pub fn check(cargo: impl Fn() -> Command, root: &Path, target: &Path) -> Result<Vec<&'static str>> {
    let mut failed = Vec::new();
    for system in &SYSTEMS {
        let System { target: name, compiler, .. } = system;
        let mut command = cargo();
        command.args(["check", "--release", "--workspace", "--locked"]);
        if has_library(name)? {
            // Tests have a crate with C in it.
            let has_compiler = compiler.is_none_or(|name| Command::new(name).arg("--version").output().is_ok());
            let targets = if has_compiler { &["--all-targets"][..] } else { &["--lib", "--bins"] };
            println!("== {name}: cargo check {}", targets.join(" "));
            command.args(["--target", name]).args(targets).current_dir(root);
        } else {
            println!(
                "== {name}: its standard library is not installed (rustup target add {name}); our own sources are checked \
                 by that of this system, with each `cfg` as it is there"
            );
            let copy = copied(root, &target.join("systems").join(name), system)?;
            command.args(["--all-targets", "--target-dir"]).arg(target).current_dir(copy);
        }
        if !status(&mut command)?.success() {
            failed.push(*name);
        }
    }
    Ok(failed)
}

/// Copies all files that git tracks, with the sources as the system has them. Returns the folder. Files that are the same
/// as in an earlier copy keep their times, so that only what has changed is checked again.
fn copied(root: &Path, folder: &Path, system: &System) -> Result<PathBuf> {
    let listed =
        Command::new("git").args(["ls-files", "-z"]).current_dir(root).output().context("git does not start")?;
    ensure!(listed.status.success(), "git does not list the files of {}", root.display());
    for name in String::from_utf8(listed.stdout)?.split_terminator('\0') {
        let Ok(mut content) = std::fs::read(root.join(name)) else { continue };
        if Path::new(name).extension().is_some_and(|extension| extension == "rs")
            && !name.ends_with("xtask/src/systems.rs")
        {
            content = flipped(&String::from_utf8(content)?, system).into_bytes();
        }
        let copy = folder.join(name);
        if std::fs::read(&copy).is_ok_and(|known| known == content) {
            continue;
        }
        std::fs::create_dir_all(copy.parent().context("a file in a folder")?)?;
        std::fs::write(&copy, content).with_context(|| copy.display().to_string())?;
    }
    Ok(folder.to_owned())
}

/// A source with what each `cfg` says of the system put in its place, and with modules that its standard library lacks
/// under names that no library has.
fn flipped(source: &str, system: &System) -> String {
    let mut flipped = String::with_capacity(source.len());
    let mut rest = source;
    while let Some(at) =
        ["cfg(", "cfg!(", "cfg_attr("].iter().filter_map(|word| Some(rest.find(word)? + word.len())).min()
    {
        let (before, after) = rest.split_at(at);
        let end = end_of_brackets(after);
        flipped.push_str(before);
        flipped.push_str(&with_values(&after[..end], system.holds));
        rest = &after[end..];
    }
    flipped.push_str(rest);
    for module in system.lacks {
        flipped = flipped.replace(module, &module.replace("std::os::", "std::os::not_here_"));
    }
    flipped
}

/// The place of the bracket that closes the one before the text.
fn end_of_brackets(text: &str) -> usize {
    let mut open = 1;
    let is_end = |(place, letter): (usize, char)| {
        open += match letter {
            '(' => 1,
            ')' => -1,
            _ => 0,
        };
        (open == 0).then_some(place)
    };
    text.char_indices().find_map(is_end).unwrap_or(text.len())
}

/// The condition of a `cfg` with `all()`, which holds, in place of words that hold, and `any()`, which does not, in place of
/// the others.
fn with_values(condition: &str, holds: &[&str]) -> String {
    let mut with_values = String::new();
    let mut rest = condition;
    while let Some(letter) = rest.chars().next() {
        let is_within =
            with_values.ends_with(|letter: char| letter.is_alphanumeric() || letter == '_' || letter == '"');
        let is_whole = |word: &str| {
            let after = &rest[word.len()..];
            !after.starts_with(|letter: char| letter.is_alphanumeric() || letter == '_' || letter == '"')
        };
        let word = WORDS.iter().find(|word| !is_within && rest.starts_with(**word) && is_whole(word));
        let taken = word.map_or(letter.len_utf8(), |word| word.len());
        match word {
            Some(word) => with_values.push_str(if holds.contains(word) { "all()" } else { "any()" }),
            None => with_values.push(letter),
        }
        rest = &rest[taken..];
    }
    with_values
}

/// Whether the compiler has the standard library of a target.
fn has_library(target: &str) -> Result<bool> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc).args(["--print", "target-libdir", "--target", target]).output();
    let output = output.context("rustc does not start")?;
    let folder = String::from_utf8_lossy(&output.stdout);
    Ok(std::fs::read_dir(folder.trim()).is_ok_and(|mut files| files.next().is_some()))
}

fn status(command: &mut Command) -> Result<ExitStatus> {
    command.status().context("cargo does not start")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_as_another_system_has_them() {
        let [windows, macos] = &SYSTEMS;
        let source = "#[cfg(unix)]\nuse std::os::unix::fs::FileExt;\n#[cfg(not(any(unix, windows)))]\nfn unix() {}\n\
                      if cfg!(all(unix, not(target_os = \"macos\"))) {}\n#[cfg(test)]\n#[cfg(unixes)]";
        assert_eq!(
            flipped(source, windows),
            "#[cfg(any())]\nuse std::os::not_here_unix::fs::FileExt;\n#[cfg(not(any(any(), all())))]\nfn unix() {}\n\
             if cfg!(all(any(), not(any()))) {}\n#[cfg(test)]\n#[cfg(unixes)]"
        );
        assert_eq!(
            flipped(source, macos),
            "#[cfg(all())]\nuse std::os::unix::fs::FileExt;\n#[cfg(not(any(all(), any())))]\nfn unix() {}\n\
             if cfg!(all(all(), not(all()))) {}\n#[cfg(test)]\n#[cfg(unixes)]"
        );
    }
}
