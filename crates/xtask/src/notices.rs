//! The licences of the crates whose code the program contains, with their texts, for packages: the licences ask that
//! whoever gets the program gets these too.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};
use cargo_metadata::{Metadata, MetadataCommand};

/// The name of the file in packages.
pub const FILE: &str = "THIRD-PARTY-LICENSES.txt";

/// What the standard library is made of; the compiler's installation brings this page.
pub const LIBRARY: &str = "RUST-LIBRARY-LICENSES.html";

/// Words in the names of files with licences. The last two are licences of fonts.
const WORDS: [&str; 8] = ["LICENSE", "LICENCE", "COPYING", "NOTICE", "COPYRIGHT", "PATENTS", "OFL", "UFL"];

/// The folders of a crate that are no part of a program.
const LEFT_OUT: [&str; 4] = ["tests", "benches", "examples", "target"];

/// A text of a licence is shorter than this, in bytes.
const LONGEST: u64 = 1 << 20;

/// A crate of somebody else.
struct Crate {
    name: String,
    version: String,
    /// The SPDX expression of the licence.
    licence: Option<String>,
    /// Where its source is kept for the public.
    repository: Option<String>,
    /// The texts that its folder has, in the order of their paths.
    texts: Vec<String>,
}

/// Returns the text of `FILE`, and the number of crates in it.
///
/// # Errors
/// Cargo fails, a crate names no licence and brings none, or the text names a folder of this machine.
pub fn notices(cargo: fn() -> Command, root: &Path) -> Result<(String, usize)> {
    let crates = crates(cargo, root)?;
    let text = text(&crates)?;
    let places = [Some(root.to_owned()), std::env::var_os("CARGO_HOME").map(PathBuf::from), std::env::home_dir()];
    check(&text, &crates, &places.into_iter().flatten().collect::<Vec<_>>())?;
    Ok((text, crates.len()))
}

/// The page about the standard library.
///
/// # Errors
/// The compiler does not start, or its installation has no such page.
pub fn library_notices() -> Result<PathBuf> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc).args(["--print", "sysroot"]).output().context("rustc does not start")?;
    let folder = PathBuf::from(String::from_utf8(output.stdout)?.trim());
    let page = folder.join("share/doc/rust/COPYRIGHT-library.html");
    ensure!(
        page.is_file(),
        "{} is missing; rustup's toolchains have it, and packages bring it along, because the program contains the \
         standard library",
        page.display()
    );
    Ok(page)
}

/// The crates of others that are linked into the program on this machine's system: no build scripts and no macros,
/// whose code only runs while it is built.
fn crates(cargo: fn() -> Command, root: &Path) -> Result<Vec<Crate>> {
    let mut tree = cargo();
    tree.args(["tree", "--package", "glint", "--edges", "normal,no-proc-macro", "--prefix", "none", "--no-dedupe"]);
    let output = tree.args(["--locked", "--format", "{p}"]).current_dir(root).output()?;
    ensure!(output.status.success(), "cargo tree: {}", String::from_utf8_lossy(&output.stderr).trim());
    let mut linked: Vec<(String, String)> = String::from_utf8(output.stdout)?.lines().filter_map(named).collect();
    linked.sort();
    linked.dedup();
    let cargo = cargo().get_program().to_owned();
    let mut command = MetadataCommand::new();
    command.cargo_path(cargo).current_dir(root).other_options(["--locked".to_owned()]);
    let metadata = command.exec().context("cargo metadata")?;
    linked.into_iter().filter_map(|linked| described(&metadata, linked).transpose()).collect()
}

/// The name and version of a line of `cargo tree`: `name v1.2.3`, and more behind it.
fn named(line: &str) -> Option<(String, String)> {
    let mut words = line.split_whitespace();
    Some((words.next()?.to_owned(), words.next()?.strip_prefix('v')?.to_owned()))
}

/// What a crate says of itself; `None` for those of this workspace.
fn described(metadata: &Metadata, (name, version): (String, String)) -> Result<Option<Crate>> {
    let is_it = |package: &&cargo_metadata::Package| package.name == name && package.version.to_string() == version;
    let package = metadata.packages.iter().find(is_it).with_context(|| format!("cargo metadata lacks {name}"))?;
    if package.source.is_none() {
        return Ok(None);
    }
    let folder = package.manifest_path.parent().with_context(|| format!("{name} has no folder"))?;
    let mut files = Vec::new();
    find(folder.as_std_path(), &mut files)?;
    files.extend(package.license_file().map(PathBuf::from));
    files.sort();
    files.dedup();
    let texts = files.iter().map(|file| read(file)).collect::<Result<_>>()?;
    let (licence, repository) = (package.license.clone(), package.repository.clone());
    Ok(Some(Crate { name, version, licence, repository, texts }))
}

/// Finds the files with licences below a folder.
fn find(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    for entry in std::fs::read_dir(folder).with_context(|| format!("{} is not read", folder.display()))? {
        let (path, kind) = entry.and_then(|entry| Ok((entry.path(), entry.file_type()?)))?;
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        if kind.is_dir() && !LEFT_OUT.contains(&name.as_str()) {
            find(&path, files)?;
        } else if kind.is_file() && is_licence(&name) {
            files.push(path);
        }
    }
    Ok(())
}

fn is_licence(name: &str) -> bool {
    let is_code = [".rs", ".py", ".sh", ".toml"].iter().any(|end| name.ends_with(end));
    let name = name.to_uppercase();
    !is_code && WORDS.iter().any(|word| name.contains(word))
}

fn read(file: &Path) -> Result<String> {
    let bytes = file.metadata()?.len();
    ensure!(bytes < LONGEST, "{} has {bytes} bytes, too many for a licence", file.display());
    let text = String::from_utf8_lossy(&std::fs::read(file)?).replace("\r\n", "\n");
    Ok(text.trim_start_matches('\u{feff}').trim().to_owned())
}

/// Writes the file: the crates, then each text once, with the names of those that bring it.
fn text(crates: &[Crate]) -> Result<String> {
    let mut text = String::from(
        "glint contains code of other people, in the crates below. Each line has a crate's name, version and licence as an\n\
         SPDX expression, and where its source is found. The texts that the crates bring follow; each has the names of its\n\
         crates above it. Crates that bring no text are marked with a star. Where a licence offers a choice, glint takes the\n\
         first of MIT, Apache-2.0, BSD, Zlib and the others that is offered.\n\n",
    );
    let mut brought: BTreeMap<String, (String, Vec<String>)> = BTreeMap::new();
    for Crate { name, version, licence, repository, texts } in crates {
        if licence.is_none() && texts.is_empty() {
            bail!("{name} {version} names no licence and brings none: nobody may pass it on");
        }
        let licence = licence.as_deref().unwrap_or("see its text");
        let star = if texts.is_empty() { " *" } else { "" };
        let repository = repository.as_deref().map(|place| format!(", {place}")).unwrap_or_default();
        let _ = writeln!(text, "{name} {version}: {licence}{repository}{star}");
        for words in texts {
            let (_, names) = brought.entry(in_one_line(words)).or_insert_with(|| (words.clone(), Vec::new()));
            let named = format!("{name} {version}");
            if names.last() != Some(&named) {
                names.push(named);
            }
        }
    }
    let mut brought: Vec<(String, Vec<String>)> = brought.into_values().collect();
    brought.sort_by(|a, b| a.1.cmp(&b.1));
    for (words, names) in brought {
        let _ = write!(text, "\n{}\n{}\n\n{words}\n", "=".repeat(80), names.join(", "));
    }
    Ok(text)
}

/// Texts that differ in their line breaks only are one.
fn in_one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Fails where a crate or one of its texts is not in the file, or where the file names a folder of this machine.
fn check(text: &str, crates: &[Crate], places: &[PathBuf]) -> Result<()> {
    ensure!(!crates.is_empty(), "cargo tree names no crates");
    let whole = in_one_line(text);
    for Crate { name, version, texts, .. } in crates {
        ensure!(text.contains(&format!("\n{name} {version}: ")), "{FILE} lacks {name} {version}");
        for words in texts {
            ensure!(whole.contains(&in_one_line(words)), "{FILE} lacks a text of {name}");
        }
    }
    for place in places.iter().filter(|place| place.components().count() > 1) {
        let place = place.to_string_lossy();
        ensure!(!text.contains(&*place), "{FILE} names {place}, a folder of this machine");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named_crate(name: &str, licence: Option<&str>, texts: &[&str]) -> Crate {
        Crate {
            name: name.to_owned(),
            version: "1.0.0".to_owned(),
            licence: licence.map(str::to_owned),
            repository: None,
            texts: texts.iter().map(|text| (*text).to_owned()).collect(),
        }
    }

    #[test]
    fn a_text_that_two_crates_bring_stands_once_under_the_names_of_both() {
        let crates = [
            named_crate("a", Some("MIT"), &["Permission is\ngranted", "Copyright A"]),
            named_crate("b", Some("MIT"), &["Permission is granted"]),
            named_crate("c", Some("Zlib"), &[]),
        ];
        let text = text(&crates).unwrap();
        assert_eq!(text.matches("granted").count(), 1, "{text}");
        assert!(text.contains("\na 1.0.0, b 1.0.0\n\nPermission"), "{text}");
        assert!(text.contains("\nc 1.0.0: Zlib *\n"), "{text}");
        check(&text, &crates, &[]).unwrap();
        let more = named_crate("d", Some("MIT"), &["Copyright D"]);
        assert!(check(&text, &[more], &[]).unwrap_err().to_string().contains("lacks d 1.0.0"));
    }

    #[test]
    fn a_crate_without_any_licence_and_a_path_of_this_machine_are_refused() {
        let error = text(&[named_crate("a", None, &[])]).unwrap_err().to_string();
        assert!(error.contains("a 1.0.0 names no licence"), "{error}");
        let crates = [named_crate("a", None, &["see /disk/someone/notes"])];
        let text = text(&crates).unwrap();
        check(&text, &crates, &["/".into(), "/disk/other".into()]).unwrap();
        assert!(check(&text, &crates, &["/disk/someone".into()]).is_err());
    }

    #[test]
    fn licences_are_told_from_code_by_their_names() {
        for name in ["LICENSE-MIT", "license.txt", "UNLICENSE", "COPYING", "OFL.txt", "LICENCE.md", "NOTICE"] {
            assert!(is_licence(name), "{name}");
        }
        for name in ["copying.rs", "README.md", "Cargo.toml"] {
            assert!(!is_licence(name), "{name}");
        }
    }

    #[test]
    fn every_crate_of_the_program_is_named_with_a_licence() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap();
        let cargo = || Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        let (text, crates) = notices(cargo, &root).unwrap();
        assert!(crates > 100, "{crates}");
        // The fonts in the program have licences of their own.
        for words in ["\nwgpu ", "\nepaint_default_fonts ", "SIL OPEN FONT LICENSE", "UBUNTU FONT LICENCE"] {
            assert!(text.contains(words), "{words}");
        }
        assert!(!text.contains("\nrender ") && !text.contains("\nclap_derive "));
    }
}
