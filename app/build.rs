//! Tells the program its version, with the commit that it is built from, where that is known: rows of a study name it.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let version = env!("CARGO_PKG_VERSION");
    let commit = commit_of_checkout().or_else(commit_of_archive);
    let version = commit.map_or(version.to_owned(), |commit| format!("{version} ({commit})"));
    println!("cargo::rustc-env=GLINT_VERSION={version}");
}

/// The commit that git writes into the file when it makes an archive of the sources.
fn commit_of_archive() -> Option<String> {
    println!("cargo::rerun-if-changed=commit.txt");
    let written = std::fs::read_to_string("commit.txt").ok()?;
    let commit = written.trim();
    let is_commit = commit.bytes().all(|byte| byte.is_ascii_hexdigit());
    commit.get(..12).filter(|_| is_commit).map(str::to_owned)
}

fn commit_of_checkout() -> Option<String> {
    let git = |words: &[&str]| {
        let output = Command::new("git").args(words).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
    };
    // Not outside of a checkout, and not without git; another checkout around it does not count.
    git(&["ls-files", "--error-unmatch", "build.rs"])?;
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    // Written by whatever changes the commit that is checked out.
    println!("cargo::rerun-if-changed={}", git(&["rev-parse", "--git-path", "logs/HEAD"])?);
    Some(commit)
}
