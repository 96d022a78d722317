//! The real and malformed files that tests read. Members that cannot depend on this one take this file in by its path.

use std::path::{Path, PathBuf};

/// The folder of the files: `GLINT_TEST_DATA`, else `shared/data` beside the checkout. If there is none, prints that
/// the test is skipped, or fails the test if `GLINT_REQUIRE_DATA` is set.
pub fn test_data() -> Option<PathBuf> {
    // The members of the workspace lie at different depths.
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    let checkout = own.ancestors().find(|folder| folder.join("Cargo.lock").exists()).unwrap_or(own);
    let folder = std::env::var_os("GLINT_TEST_DATA").map_or_else(|| checkout.join("../shared/data"), PathBuf::from);
    let found = folder.canonicalize().ok().filter(|folder| folder.is_dir());
    if found.is_none() {
        let problem = format!("no test data at {}", folder.display());
        assert!(std::env::var_os("GLINT_REQUIRE_DATA").is_none(), "{problem}, and GLINT_REQUIRE_DATA is set");
        println!("skipped: {problem}");
    }
    found
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// Runs `the_files_are_looked_for` as a program of its own, without files. Returns whether it passed, and what it
    /// printed.
    fn without_files(is_required: bool) -> (bool, String) {
        let mut command = Command::new(std::env::current_exe().expect("the path of this test"));
        // The test's name begins with the module that includes this file, without the crate.
        let (_, module) = module_path!().split_once("::").expect("a crate and a module");
        command.args(["--exact", &format!("{module}::the_files_are_looked_for"), "--nocapture"]);
        command.env("GLINT_TEST_DATA", "/nonexistent").env_remove("GLINT_REQUIRE_DATA");
        if is_required {
            command.env("GLINT_REQUIRE_DATA", "1");
        }
        let output = command.output().expect("this test starts");
        let text = [output.stdout, output.stderr].concat();
        (output.status.success(), String::from_utf8_lossy(&text).into_owned())
    }

    #[test]
    fn the_files_are_looked_for() {
        assert!(test_data().is_none_or(|folder| folder.is_dir()));
    }

    #[test]
    fn missing_files_are_told_and_fail_the_test_where_they_are_required() {
        let (passed, text) = without_files(false);
        assert!(passed && text.contains("skipped: no test data at /nonexistent"), "{text}");
        let (passed, text) = without_files(true);
        assert!(!passed && text.contains("GLINT_REQUIRE_DATA is set"), "{text}");
    }
}
