//! Tells the program which commit it is built from, where that is known: rows of a study name it.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let git = |words: &[&str]| {
        let output = Command::new("git").args(words).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
    };
    // Outside of a checkout, or without git, the version is all there is to tell; another checkout around it does not count.
    if git(&["ls-files", "--error-unmatch", "build.rs"]).is_none() {
        return;
    }
    let (Some(commit), Some(log)) =
        (git(&["rev-parse", "--short=12", "HEAD"]), git(&["rev-parse", "--git-path", "logs/HEAD"]))
    else {
        return;
    };
    println!("cargo::rustc-env=GLINT_COMMIT={commit}");
    // Written by whatever changes the commit that is checked out.
    println!("cargo::rerun-if-changed={log}");
}
