//! The shape of the workspace: which crate may know which, and what no file may contain. docs/architecture.md says why.

mod dependencies;
mod imports;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use cargo_metadata::{Metadata, MetadataCommand, Package};
use imports::Imports;

/// Which crate of the workspace may depend on which. Anyone may depend on `param`; `tests` may depend on all.
const ARROWS: [(&str, &[&str]); 15] = [
    (
        "glint",
        &["record", "measure", "ghost", "study", "trace", "world", "render", "stream", "scene", "codec", "cloud"],
    ),
    ("fuzz", &["study", "stream", "scene", "codec", "cloud"]),
    ("study", &["render", "trace", "scene", "codec", "cloud"]),
    ("world", &["render", "stream", "scene", "codec", "cloud"]),
    ("render", &["scene", "cloud"]),
    ("trace", &["scene", "cloud"]),
    ("ghost", &["trace", "scene", "cloud"]),
    ("stream", &["codec", "cloud"]),
    ("scene", &["cloud"]),
    ("codec", &["cloud"]),
    ("measure", &["cloud"]),
    ("record", &["scene"]),
    ("cloud", &[]),
    ("param", &[]),
    ("xtask", &[]),
];

/// Outside crates that only some members may name: the front end's belong to the program, the GPU's to the renderer too.
const RESERVED: [(&str, &[&str]); 6] = [
    ("egui", &["glint"]),
    ("winit", &["glint"]),
    ("rfd", &["glint"]),
    ("clap", &["glint"]),
    ("wgpu", &["glint", "render"]),
    ("naga", &["glint", "render"]),
];

/// Imports that close circles of more than two files: the crate, who imports, and whom. This list may only shrink.
const KNOWN_CIRCLES: [(&str, &[(&str, &str)]); 1] = [("trace", &[("light.rs", "indirect.rs")])];

/// Folders that import one another: the crate, and the folders of a circle. This list may only shrink.
const KNOWN_FOLDER_CIRCLES: [(&str, &[&str]); 2] =
    [("codec", &["export", "las", "ply"]), ("study", &["plan", "results"])];

/// Functions of more than `MOST_LINES_OF_FUNCTION` lines: the file and the function. This list may only shrink.
const KNOWN_LONG_FUNCTIONS: &[(&str, &str)] = &[
    ("app/src/commands/profile.rs", "run"),
    ("app/src/commands/render.rs", "run"),
    ("app/src/commands/subject.rs", "open"),
    ("app/src/shared/comparing.rs", "compare"),
    ("app/src/viewer/picture/render_thread.rs", "run"),
    ("app/src/viewer/requests/work.rs", "run"),
    ("app/src/viewer/session/actions.rs", "carry_out"),
    ("crates/codec/src/las/header.rs", "read"),
    ("crates/codec/src/las/layout.rs", "new"),
];

/// Lines from the signature of a function to its last brace.
const MOST_LINES_OF_FUNCTION: usize = 100;

/// The folder that a source file counts to: the first one of its path, and in the viewer the one below. A file counts to
/// the folder of its own modules. The files beside `lib.rs` are what a crate stands on and what uses its folders, so they
/// count to none.
fn folder_of(file: &str, has_modules: impl Fn(&str) -> bool) -> Option<String> {
    let (viewer, inside) = file.strip_prefix("viewer/").map_or(("", file), |inside| ("viewer/", inside));
    let name = inside.split('/').next().unwrap_or(inside);
    let name = name.strip_suffix(".rs").map_or(Some(name), |module| has_modules(module).then_some(module));
    match name {
        Some(name) => Some(format!("{viewer}{name}")),
        None => (!viewer.is_empty()).then(|| "viewer".to_owned()),
    }
}

fn workspace() -> Metadata {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
    MetadataCommand::new().manifest_path(manifest).no_deps().exec().expect("cargo metadata")
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().expect("the workspace's folder")
}

/// Members a package depends on, for its build, its tests or its benches.
fn members_named<'a>(package: &'a Package, workspace: &'a Metadata) -> impl Iterator<Item = &'a str> {
    let is_member = |name: &str| workspace.packages.iter().any(|member| member.name == name);
    package.dependencies.iter().map(|dependency| dependency.name.as_str()).filter(move |name| is_member(name))
}

/// Tracked files that hold text, with their paths from the workspace root. Empty outside a git checkout (a source archive).
fn tracked_texts() -> Vec<(String, String)> {
    let root = root();
    let listing = Command::new("git").args(["ls-files", "-z"]).current_dir(&root).output();
    let Some(listing) = listing.ok().filter(|listing| listing.status.success()) else {
        println!("skipped: not a git checkout");
        return Vec::new();
    };
    let names = String::from_utf8(listing.stdout).expect("tracked names are UTF-8");
    names
        .split_terminator('\0')
        .filter_map(|name| Some((name.to_owned(), std::fs::read_to_string(root.join(name)).ok()?)))
        .collect()
}

/// `name:line: text` of every line that any of `words` occurs in.
fn lines_with(texts: &[(String, String)], words: &[String]) -> Vec<String> {
    let hits = |name: &str, text: &str| -> Vec<String> {
        let numbered = text.lines().enumerate();
        let hit = numbered.filter(|(_, line)| words.iter().any(|word| contains_from_boundary(line, word)));
        hit.map(|(number, line)| format!("{name}:{}: {}", number + 1, line.trim())).collect()
    };
    texts.iter().flat_map(|(name, text)| hits(name, text)).collect()
}

/// Whether `word` occurs in `line` and is not the tail of a longer word or path.
fn contains_from_boundary(line: &str, word: &str) -> bool {
    line.match_indices(word).any(|(start, _)| {
        let before = line[..start].chars().next_back();
        before.is_none_or(|before| !before.is_alphanumeric() && !"._-/}*".contains(before))
    })
}

#[test]
fn crates_depend_only_along_the_arrows() {
    let workspace = workspace();
    let mut wrong = Vec::new();
    for package in workspace.packages.iter().filter(|package| package.name != "tests") {
        let arrow = ARROWS.iter().find(|(from, _)| package.name == *from);
        let Some((_, allowed)) = arrow else {
            wrong.push(format!("{} has no line in ARROWS", package.name));
            continue;
        };
        for member in members_named(package, &workspace) {
            if member != "param" && !allowed.contains(&member) {
                wrong.push(format!("{} -> {member}", package.name));
            }
        }
    }
    assert!(wrong.is_empty(), "edges that docs/architecture.md does not draw: {wrong:#?}");
}

#[test]
fn no_source_file_is_so_long_that_it_has_several_subjects() {
    const MOST_LINES: usize = 700;
    let is_source = |name: &str| name.ends_with(".rs") && name.contains("/src/") && !name.ends_with("tests.rs");
    let lengths = tracked_texts().into_iter().map(|(name, text)| (name, text.lines().count()));
    let long: Vec<_> = lengths.filter(|(name, lines)| is_source(name) && *lines > MOST_LINES).collect();
    assert!(long.is_empty(), "above {MOST_LINES} lines; split them by subject: {long:#?}");
}

/// The names and lines of the functions of a source file, without its modules of tests. Formatted code ends a function
/// by the first brace that stands under its signature.
fn functions(text: &str) -> Vec<(&str, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let is_test = |pair: &[&str]| pair[0] == "#[cfg(test)]" && pair[1].contains("mod ") && pair[1].ends_with('{');
    let end = lines.windows(2).position(is_test).unwrap_or(lines.len());
    let words = ["pub", "pub(crate)", "pub(super)", "const", "async"];
    let mut functions = Vec::new();
    for (first, line) in lines[..end].iter().enumerate() {
        let signature = line.trim_start();
        let indent = &line[..line.len() - signature.len()];
        let Some((before, after)) = signature.split_once("fn ") else { continue };
        if !before.split_whitespace().all(|word| words.contains(&word)) {
            continue;
        }
        let name = after.split(['(', '<']).next().unwrap_or(after);
        let is_last = |line: &&str| line.strip_prefix(indent) == Some("}");
        let is_only_declared = |line: &str| line.ends_with(';') && line.len() - line.trim_start().len() == indent.len();
        let body = &lines[first..end];
        let length = body.iter().position(is_last).map_or(0, |last| last + 1);
        if !body.first().is_some_and(|line| is_only_declared(line) || line.ends_with('}')) {
            functions.push((name, length));
        }
    }
    functions
}

#[test]
fn no_function_beside_the_known_ones_has_more_than_a_hundred_lines() {
    let texts = tracked_texts();
    let is_source = |name: &str| name.ends_with(".rs") && name.contains("/src/") && !name.ends_with("tests.rs");
    let sources = texts.iter().filter(|(name, _)| is_source(name));
    let mut long: Vec<(&str, &str)> = Vec::new();
    for (file, text) in sources {
        let of_file = functions(text).into_iter().filter(|(_, lines)| *lines > MOST_LINES_OF_FUNCTION);
        long.extend(of_file.map(|(function, _)| (file.as_str(), function)));
    }
    let new: Vec<_> = long.iter().filter(|found| !KNOWN_LONG_FUNCTIONS.contains(found)).collect();
    assert!(new.is_empty(), "above {MOST_LINES_OF_FUNCTION} lines; give their chapters names: {new:#?}");
    let gone: Vec<_> = KNOWN_LONG_FUNCTIONS.iter().filter(|known| !long.contains(known)).collect();
    assert!(texts.is_empty() || gone.is_empty(), "shorter now; take them off KNOWN_LONG_FUNCTIONS: {gone:#?}");
}

#[test]
fn one_file_of_the_program_writes_to_the_terminal() {
    let is_program = |name: &str| name.starts_with("app/src/") && name.ends_with(".rs");
    // Tests say what they skip. Modules of tests stand at the end of a file.
    let is_test = |name: &str| name.ends_with("tests.rs") || name.ends_with("/bench.rs");
    let program = |name: &str| is_program(name) && !is_test(name);
    let texts = tracked_texts().into_iter().filter(|(name, _)| program(name)).map(|(name, text)| {
        let end = text.find("#[cfg(test)]\nmod tests").unwrap_or(text.len());
        (name, text[..end].to_owned())
    });
    let texts: Vec<(String, String)> = texts.collect();
    let words = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
    let writers =
        ["print!", "println!", "eprint!", "eprintln!", "dbg!", "stdout()", "stderr()", "io::stdout", "io::stderr"];
    let wrong = |allowed: &str, found: &[&str]| -> Vec<String> {
        lines_with(&texts, &words(found)).into_iter().filter(|line| !line.starts_with(allowed)).collect()
    };
    assert_eq!(wrong("app/src/system/terminal.rs:", &writers), [""; 0]);
    // Bars write for themselves, so what they show is escaped there.
    assert_eq!(wrong("app/src/system/progress_bar.rs:", &["indicatif"]), [""; 0]);
    let is_found = |name: &str| texts.iter().any(|(found, _)| found == name);
    assert!(texts.is_empty() || is_found("app/src/system/terminal.rs") && is_found("app/src/system/progress_bar.rs"));
}

#[test]
fn no_circle_of_imports_has_more_than_two_files() {
    let mut wrong = String::new();
    for package in &workspace().packages {
        let known = KNOWN_CIRCLES.iter().find(|(name, _)| package.name == *name).map_or(&[][..], |(_, known)| known);
        let of_targets = package.targets.iter().filter(|target| target.is_lib() || target.is_bin());
        for imports in of_targets.map(|target| Imports::of(target.src_path.as_std_path())) {
            let is_large = |circle: &Vec<String>| circle.len() > 2;
            for circle in imports.circles(known).into_iter().filter(is_large) {
                wrong += &format!("{}, a circle of {} files:\n{}", package.name, circle.len(), imports.within(&circle));
            }
            let all: Vec<Vec<String>> = imports.circles(&[]).into_iter().filter(is_large).collect();
            for (from, to) in known {
                let is_in_one =
                    all.iter().any(|circle| [from, to].iter().all(|file| circle.iter().any(|is| is == *file)));
                if !is_in_one || !imports.has((from, to)) {
                    wrong += &format!("{}: {from} -> {to} closes no circle; take it off KNOWN_CIRCLES\n", package.name);
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn the_folders_of_a_crate_form_no_circle() {
    let mut wrong = String::new();
    for package in &workspace().packages {
        for target in package.targets.iter().filter(|target| target.is_lib() || target.is_bin()) {
            let root = target.src_path.as_std_path();
            let has_modules = |name: &str| root.with_file_name(name).is_dir();
            let folders = Imports::of(root).of_folders(|file| folder_of(file, has_modules));
            let known = KNOWN_FOLDER_CIRCLES.iter().filter(|(name, _)| package.name == *name);
            let mut known: Vec<&[&str]> = known.map(|(_, circle)| *circle).collect();
            for circle in folders.circles(&[]) {
                match known.iter().position(|known| *known == circle) {
                    Some(index) => drop(known.remove(index)),
                    None => wrong += &format!("{}, a circle of folders:\n{}", package.name, folders.within(&circle)),
                }
            }
            for circle in known {
                wrong += &format!("{}: {circle:?} is no circle; take it off KNOWN_FOLDER_CIRCLES\n", package.name);
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn only_the_program_knows_the_front_end_and_only_it_and_the_renderer_the_gpu() {
    let mut wrong = Vec::new();
    for package in &workspace().packages {
        for dependency in &package.dependencies {
            let family = |(name, _): &&(&str, &[&str])| {
                dependency.name == *name
                    || dependency.name.starts_with(&format!("{name}-"))
                    || dependency.name.starts_with(&format!("{name}_"))
            };
            if let Some((_, allowed)) = RESERVED.iter().find(family)
                && !allowed.contains(&package.name.as_str())
            {
                wrong.push(format!("{} names {}", package.name, dependency.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn members_take_lints_and_versions_from_the_workspace() {
    let mut wrong = Vec::new();
    for package in &workspace().packages {
        let manifest = std::fs::read_to_string(&package.manifest_path).expect("a manifest that cargo just read");
        let mut section = "";
        let mut lints = false;
        for line in manifest.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')) {
            if line.starts_with('[') {
                section = line;
            } else if section == "[lints]" {
                lints |= line == "workspace = true";
            } else if section.ends_with("dependencies]") && !line.contains("workspace = true") {
                wrong.push(format!("{}: {line}", package.name));
            }
        }
        if !lints {
            wrong.push(format!("{}: no [lints] workspace = true", package.name));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn no_tracked_file_names_a_place_on_somebodys_machine() {
    let homes = ["home", "root", "Users"].map(|folder| format!("/{folder}/"));
    // The checkout itself, unless it lies right under `/`, where its name may be a word of the project (`/app/`).
    let checkout = root();
    let checkout = (checkout.components().count() > 2).then(|| format!("{}/", checkout.display()));
    let places: Vec<String> = homes.into_iter().chain(checkout).collect();
    let found = lines_with(&tracked_texts(), &places);
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
fn an_archive_of_the_sources_tells_its_commit() {
    if tracked_texts().is_empty() {
        return;
    }
    let git = |words: &[&str]| {
        let output = Command::new("git").args(words).current_dir(root()).output().expect("git runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    };
    let archive = git(&["archive", "--format=tar", "HEAD", "app/commit.txt"]);
    // Once in the archive's own header, and once in the file that app/build.rs reads.
    assert_eq!(archive.matches(&git(&["rev-parse", "HEAD"])).count(), 2, "{archive}");
}

#[test]
fn no_source_file_is_left_unfinished() {
    let sources: Vec<_> = tracked_texts().into_iter().filter(|(name, _)| name.contains("src/")).collect();
    let words = ["todo!(", "unimplemented!(", "dbg!("].map(str::to_owned);
    let found = lines_with(&sources, &words);
    assert!(found.is_empty(), "{found:#?}");
}

/// What stands in a table, `NAME! { ... }` from the start of a line.
fn table<'a>(texts: &'a [(String, String)], file: &str, name: &str) -> &'a str {
    let text = texts.iter().find(|(known, _)| known == file).map(|(_, text)| text.as_str());
    let table = text.and_then(|text| text.split_once(&format!("\n{name}! {{\n"))?.1.split_once("\n}\n"));
    table.unwrap_or_else(|| panic!("{file} has no table {name}!")).0
}

/// Names of the passes.
fn passes(texts: &[(String, String)]) -> Vec<&str> {
    let name = |row: &'_ str| Some(row.split_once(" over ")?.0.split_once(':')?.0.len());
    let rows = table(texts, "crates/render/src/passes.rs", "passes").lines();
    rows.filter_map(|row| Some(row[..name(row)?].trim())).collect()
}

/// Variants and names of the methods.
fn methods(texts: &[(String, String)]) -> Vec<(&str, &str)> {
    let rows = table(texts, "crates/scene/src/method.rs", "methods").lines();
    let rows = rows.filter_map(|row| row.trim().split_once(" = \""));
    rows.filter_map(|(variant, rest)| Some((variant, rest.split_once('"')?.0))).collect()
}

/// Source files of the program, without their modules of tests.
fn program(texts: &[(String, String)]) -> impl Iterator<Item = (&str, &str)> {
    let sources = texts.iter().filter(|(name, _)| name.starts_with("app/src/") && name.ends_with(".rs"));
    let sources = sources.filter(|(name, _)| !name.ends_with("tests.rs") && !name.ends_with("/bench.rs"));
    sources.map(|(name, text)| (name.as_str(), text.split("\n#[cfg(test)]").next().unwrap_or(text)))
}

/// Panels read the session and push actions. What runs its effects reports back what came of them.
#[test]
fn only_the_window_and_what_runs_effects_change_the_session() {
    let texts = tracked_texts();
    let files = ["session/state.rs", "mod.rs", "session/effects.rs"].map(|name| format!("app/src/viewer/{name}"));
    let changes = |text: &str| text.contains("&mut Session");
    let found: Vec<&str> = program(&texts).filter(|(_, text)| changes(text)).map(|(name, _)| name).collect();
    let wrong: Vec<&&str> = found.iter().filter(|name| !files.iter().any(|file| file == *name)).collect();
    assert!(wrong.is_empty(), "{wrong:?} change the session");
    assert!(texts.is_empty() || !found.is_empty(), "no file is found that does");
}

/// Each part of the session owns its update; the session hands on what comes in: actions in one file, and all else in
/// the other.
#[test]
fn the_session_stands_in_two_files() {
    let texts = tracked_texts();
    let stands = |text: &str| text.contains("\nimpl Session {");
    let found: Vec<&str> = program(&texts).filter(|(_, text)| stands(text)).map(|(name, _)| name).collect();
    let files = ["actions.rs", "state.rs"].map(|name| format!("app/src/viewer/session/{name}"));
    assert!(texts.is_empty() || found == files, "{found:?}");
}

/// From the rows of the passes and what their shaders import, and those import, on and on.
#[test]
fn every_shader_is_used_by_a_pass() {
    let texts = tracked_texts();
    let text = |name: &str| texts.iter().find(|(known, _)| known == name).map(|(_, text)| text.as_str());
    let mut open: Vec<String> = passes(&texts).iter().map(|name| format!("shaders/{name}.wgsl")).collect();
    let mut used: BTreeSet<String> = BTreeSet::new();
    while let Some(file) = open.pop() {
        let shader = text(&file).unwrap_or_else(|| panic!("{file} is not there"));
        if used.insert(file) {
            let imports = shader.lines().filter_map(|line| line.strip_prefix("#import "));
            open.extend(imports.map(|name| format!("shaders/shared/{}.wgsl", name.trim())));
        }
    }
    // The window has a shader of its own, which no pass of the renderer runs.
    let shaders = texts.iter().map(|(name, _)| name).filter(|name| name.starts_with("shaders/"));
    let unused: Vec<&String> = shaders.filter(|name| !used.contains(*name)).collect();
    assert!(unused.is_empty(), "no pass reaches {unused:?}");
}

/// Every pass that reads points asks one function whether they are shown.
#[test]
fn one_shader_reads_which_points_are_shown() {
    let texts = tracked_texts();
    let shaders = || texts.iter().filter(|(name, _)| name.ends_with(".wgsl"));
    // `shown_word` hands over a word of bits, from where a pass has it, and nothing else reads them.
    let is_read = |line: &str| line.contains("shown[") && line.trim() != "return shown[word];";
    let asks = |line: &str| line.contains("shown_word(") && !line.starts_with("fn ") && !line.starts_with("//");
    let readers: Vec<&String> = shaders()
        .filter(|(_, text)| text.lines().any(|line| is_read(line) || asks(line)))
        .map(|(name, _)| name)
        .collect();
    assert!(texts.is_empty() || readers == ["shaders/shared/visibility.wgsl"], "{readers:?}");
}

/// Whoever needs to know something of each pass or method reads it from the tables: a list beside them would go out of date. Names
/// of one word, like `show`, mean other things too.
#[test]
fn only_the_tables_list_passes_and_methods() {
    let texts = tracked_texts();
    let (passes, methods) = (passes(&texts), methods(&texts));
    assert!(passes.len() > 40 && methods.len() > 5, "{passes:?}, {methods:?}");
    let tables = ["crates/render/src/passes.rs", "crates/render/src/method.rs"];
    let mut lists = Vec::new();
    for (file, text) in &texts {
        let is_ours = ["app/src/", "crates/render/src/", "crates/study/src/", "crates/world/src/"]
            .iter()
            .any(|folder| file.starts_with(folder));
        let is_source = is_ours && file.ends_with(".rs") && !file.ends_with("tests.rs");
        if !is_source || tables.contains(&file.as_str()) {
            continue;
        }
        let tests = ["\n#[cfg(test)]\nmod tests", "\n#[cfg(test)]\npub(crate) mod tests"];
        let code = tests.iter().fold(text.as_str(), |code, tests| code.split(tests).next().unwrap_or(code));
        let is_quoted = |name: &str| name.contains('_') && code.contains(&format!("\"{name}\""));
        let named = passes.iter().filter(|name| is_quoted(name)).count();
        let is_variant = |variant: &str| {
            let after =
                |(at, found): (usize, &str)| code[at + found.len()..].starts_with(|c: char| c.is_alphanumeric());
            let path = format!("Method::{variant}");
            !["Auto", "None"].contains(&variant) && code.match_indices(&path).any(|found| !after(found))
        };
        let chosen = methods.iter().filter(|(variant, name)| is_quoted(name) || is_variant(variant)).count();
        if named > 1 || chosen > 1 {
            lists.push(format!("{file}: {named} passes, {chosen} methods"));
        }
    }
    assert!(lists.is_empty(), "{lists:#?}");
}

#[test]
fn a_path_is_found_only_where_it_starts() {
    assert!(contains_from_boundary("see /disk/me/scan.las", "/disk/"));
    assert!(contains_from_boundary("\"/disk/me\"", "/disk/"));
    assert!(!contains_from_boundary("docs/disk/page.md", "/disk/"));
    assert!(!contains_from_boundary("not_todo!(now)", "todo!("));
}

#[test]
fn one_folder_of_the_program_asks_servers() {
    let texts = tracked_texts();
    // The fuzzer plays the server whose answers are read.
    let others = ["tests/", "crates/fuzz/"];
    let is_of_program = |file: &str| {
        file.ends_with(".rs") && file.contains("/src/") && !others.iter().any(|other| file.starts_with(other))
    };
    let others = texts.iter().filter(|(file, _)| is_of_program(file) && !file.starts_with("crates/codec/src/remote"));
    for (file, text) in others {
        for word in ["ureq::", "std::net::", "TcpStream", "UdpSocket"] {
            assert!(!text.contains(word), "{file} names {word}: only crates/codec/src/remote/ opens connections");
        }
    }
}
