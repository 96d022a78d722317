//! The program answers without files, display or adapter. Being here, this test also has cargo build the `glint` binary in a
//! build of the whole workspace, where the end-to-end tests of the member crate `tests` find it.

use std::process::Command;

fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_glint")).args(arguments).output().expect("the program starts");
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn help_names_every_command() {
    let (status, help, complaint) = run(&["--help"]);
    assert_eq!((status, complaint.as_str()), (Some(0), ""));
    for command in ["view", "info", "render", "methods", "scenes", "doctor"] {
        assert!(help.contains(&format!("  {command}")), "{command} is missing in\n{help}");
    }
}

#[test]
fn a_misspelt_flag_is_bad_usage_and_named() {
    let (status, answer, complaint) = run(&["render", "five-mirrors/none", "-o", "x.png", "--sise", "10x10"]);
    assert_eq!((status, answer.as_str()), (Some(2), ""));
    assert!(complaint.contains("--sise") && complaint.lines().count() <= 2, "{complaint}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_display_that_does_not_answer_is_named_without_the_insides() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_glint"));
    command.arg("five-mirrors/sphere").env("DISPLAY", ":98765").env_remove("WAYLAND_DISPLAY");
    let output = command.output().expect("the program starts");
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{complaint}");
    assert!(complaint.contains("DISPLAY") && complaint.contains("glint render"), "{complaint}");
    assert!(!complaint.contains(".rs") && complaint.lines().count() <= 2, "{complaint}");
}
