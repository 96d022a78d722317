//! Tests what the command line takes, and what it says of what it does not.

use clap::CommandFactory as _;

use super::*;

fn message(words: &[&str]) -> String {
    brief(CommandLine::try_parse_from(words).unwrap_err())
}

#[test]
fn the_definition_is_consistent() {
    CommandLine::command().debug_assert();
}

#[test]
fn words_without_a_command_are_inputs_of_the_viewer() {
    let line = CommandLine::try_parse_from(["glint", "a.laz", "five-mirrors/sphere", "--gpu", "cpu"]).unwrap();
    assert!(line.command.is_none());
    assert_eq!(line.view.inputs, ["a.laz", "five-mirrors/sphere"]);
    assert_eq!(line.view.gpu.gpu.as_deref(), Some("cpu"));
}

#[test]
fn sizes_are_two_numbers_of_pixels() {
    assert_eq!(parse_size("1280x720"), Ok([1280, 720]));
    for wrong in ["", "x", "800", "800x", "800x0", "-1x5", "800x600x2", "1e3x4", "99999x10", "800*600"] {
        assert!(parse_size(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn frames_are_from_a_number_to_before_another() {
    assert_eq!(parse_frames("10..12"), Ok(10..12));
    for wrong in ["", "5", "..", "5..", "..5", "5..5", "6..5", "-1..5", "1...5", "1..=5", "0..99999999999"] {
        assert!(parse_frames(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn pairs_are_split_at_the_first_equals_sign() {
    assert_eq!(parse_pair("color.attribute=a=b"), Ok(("color.attribute".into(), "a=b".into())));
    assert_eq!(parse_pair("color.attribute="), Ok(("color.attribute".into(), String::new())));
    assert!(parse_pair("splat.size").is_err());
    assert!(parse_pair("=2").is_err());
}

#[test]
fn words_that_are_quoted_are_escaped() {
    let evil = "--\u{1b}[31mx\nglint: done\u{7}";
    let text = message(&["glint", "info", "a.laz", evil]);
    assert!(text.contains(r"--\u{1b}[31mx\nglint: done\u{7}"), "{text}");
    let text = message(&["glint", "render", "a.laz", "-o", "a.png", "--size", "8\u{202e}\nx"]);
    assert!(text.contains(r"8\u{202e}\nx"), "{text}");
}

#[test]
fn an_option_that_stands_where_a_value_is_missing_is_not_taken_for_one() {
    for words in [["--size", "-o"], ["--budget", "--json"]] {
        let text = message(&[&["glint", "render", "a.laz"], &words[..], &["a.png"]].concat());
        assert!(text.starts_with(&format!("a value is required for '{} <", words[0])), "{text}");
    }
    let text = message(&["glint", "render", "a.laz", "-o", "a.png", "--size", "-5x3"]);
    assert!(text.contains("invalid value '-5x3' for '--size"), "{text}");
}

#[test]
fn images_are_a_name_and_a_path() {
    assert_eq!(parse_image("depth=a=b.exr".into()), Ok(("depth".into(), "a=b.exr".into())));
    assert!(parse_image("depth".into()).is_err() && parse_image("=a.exr".into()).is_err());
}

#[test]
fn usage_errors_are_one_line() {
    for words in [
        &["glint", "render"][..],
        &["glint", "render", "a.laz", "-o", "a.png", "--size", "big"],
        &["glint", "render", "a.laz", "-o", "a.png", "--sise", "8x8"],
        &["glint", "render", "a.laz", "-o", "a.png", "--frames", "0"],
        &["glint", "render", "a.laz", "-o", "a.png", "--truth", "exact"],
        &["glint", "render", "a.laz", "-o", "a.png", "--estimate"],
        &["glint", "render", "a.laz", "-o", "a.png", "--stats", "a.json", "--truth", "no"],
        &["glint", "render", "a.laz", "-o", "a.png", "--set", "splat.size"],
        &["glint", "render", "a.laz", "-o", "a.png", "--time", "-1"],
        &["glint", "render", "a.laz", "-o", "a.png", "--time", "1e300"],
        &["glint", "render", "a.laz", "-o", "a.png", "--preset", "publshed"],
        &["glint", "info"],
        &["glint", "record", "a.toml"],
        &["glint", "record", "a.toml", "-o", "a", "--frames", "3..3"],
        &["glint", "record", "a.toml", "-o", "a", "--fps", "0"],
        &["glint", "index"],
        &["glint", "study"],
        &["glint", "study", "methods"],
        &["glint", "study", "methods", "-o", "a", "--shard", "3/2"],
        &["glint", "study", "methods", "-o", "a", "--repeats", "0"],
        &["glint", "study", "merge", "-o", "a"],
        &["glint", "export", "a.laz"],
        &["glint", "surfaces"],
        &["glint", "measure"],
        &["glint", "measure", "a.toml", "b.toml"],
        &["glint", "surfaces", "a.laz", "--holdout", "0"],
        &["glint", "surfaces", "a.laz", "--holdout", "1"],
        &["glint", "surfaces", "a.laz", "--holdout", "-0.5"],
        &["glint", "surfaces", "a.laz", "--holdout", "NaN"],
        &["glint", "surfaces", "a.laz", "--scanner", "1,2"],
        &["glint", "surfaces", "a.laz", "--scanner", "-1,nan,2"],
        &["glint", "--nonsense"],
    ] {
        let message = message(words);
        assert_eq!(message.lines().count(), 1, "{words:?}: {message}");
        assert!(message.split("; ").all(|part| !part.trim().is_empty()), "{words:?}: {message}");
    }
    assert!(message(&["glint", "render", "a.laz", "-o", "a.png", "--sise", "8x8"]).contains("--size"));
}

#[test]
fn negative_numbers_are_out_of_range_and_no_flags() {
    let render = ["glint", "render", "a.laz", "-o", "a.png"];
    let cases: [(&[&str], [&str; 2], &str); 10] = [
        (&render, ["--seed", "-1"], "-1 is not in 0..=4294967295"),
        (&render, ["--bounces", "-1"], "-1 is not in 0..=4294967295"),
        (&render, ["--frames", "-3"], "-3 is not in 1..=100000"),
        (&render, ["--size", "-1x4"], "expected WIDTHxHEIGHT"),
        (&render, ["--time", "-2.5"], "expected seconds from 0"),
        (&render, ["--budget", "-5ms"], "expected a time above 0"),
        (&["glint", "record", "a.toml", "-o", "a"], ["--frames", "-1..5"], "expected the first frame"),
        (&["glint", "surfaces", "a.laz"], ["--seed", "-1"], "expected a whole number from 0 to 18446744073709551615"),
        (&["glint", "study", "scan", "-o", "a.laz"], ["--rays", "-1"], "-1 is not in 1000..=100000000"),
        (&["glint", "study", "scan", "-o", "a.laz"], ["--noise", "-1"], "expected a length of at least 0"),
    ];
    for (command, words, told) in cases {
        let message = message(&[command, &words].concat());
        let start = format!("invalid value '{}' for '{} ", words[1], words[0]);
        assert!(message.starts_with(&start) && message.contains(told), "{message}");
    }
    let mut commands = vec![CommandLine::command()];
    while let Some(command) = commands.pop() {
        commands.extend(command.get_subcommands().cloned());
        for argument in command.get_arguments() {
            let names = argument.get_value_names().unwrap_or_default();
            let is_number = names.iter().any(|name| {
                ["N", "SECONDS", "SHARE", "LENGTH", "WIDTH", "DISTANCE", "TIME", "ERROR"].contains(&name.as_str())
            });
            let takes_negative = argument.is_allow_negative_numbers_set() || argument.is_allow_hyphen_values_set();
            assert!(!is_number || takes_negative, "{} {argument}", command.get_name());
        }
    }
}

#[test]
fn names_with_blanks_and_quotes_survive_the_shell() {
    assert_eq!(quoted("a/b.laz"), "a/b.laz");
    assert_eq!(quoted("my scan.laz"), "'my scan.laz'");
    assert_eq!(quoted("it's"), r"'it'\''s'");
    assert_eq!(quoted("view.background=#ffffff"), "'view.background=#ffffff'");
}
