//! The crates that the workspace is built from, on all platforms: their licences, versions that are there twice, and known
//! vulnerabilities.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use cargo_metadata::semver::{Version, VersionReq};
use cargo_metadata::{Metadata, MetadataCommand};

/// Licences that ask for no more than their own text in a distribution, or for nothing, and the MPL, which asks for the sources of changed
/// files only.
const ALLOWED_LICENCES: [&str; 13] = [
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    // The list of authorities that https trusts.
    "CDLA-Permissive-2.0",
    "ISC",
    "MIT",
    "MPL-2.0",
    "OFL-1.1",
    "Ubuntu-font-1.0",
    "Unicode-3.0",
    "Zlib",
];

/// Crates that the lock file names and no build of the program holds, with licences beside the allowed ones: rav1e takes
/// libfuzzer-sys where it is fuzzed.
const NOT_BUILT: [&str; 1] = ["libfuzzer-sys"];

/// Crates that are there in more than one version, because crates that we take ask for different ones. This list may only
/// shrink. Each version is compiled and shipped.
const KNOWN_DUPLICATES: [(&str, usize); 29] = [
    ("bitflags", 2),
    ("block2", 2),
    ("calloop", 2),
    ("calloop-wayland-source", 2),
    ("foldhash", 2),
    // The third one is that of the cryptography of https.
    ("getrandom", 3),
    ("hashbrown", 3),
    ("itertools", 3),
    ("jni-sys", 2),
    ("linux-raw-sys", 2),
    ("miniz_oxide", 2),
    ("objc2", 2),
    ("objc2-app-kit", 2),
    ("objc2-foundation", 2),
    ("objc2-metal", 2),
    ("objc2-quartz-core", 2),
    ("objc2-ui-kit", 2),
    ("pollster", 2),
    ("r-efi", 2),
    ("rand", 2),
    ("rand_core", 2),
    ("redox_syscall", 3),
    ("rustc-hash", 2),
    ("rustix", 2),
    ("smithay-client-toolkit", 2),
    ("syn", 2),
    ("thiserror", 2),
    ("thiserror-impl", 2),
    ("windows-sys", 3),
];

/// All packages of the lock file.
fn packages() -> Metadata {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
    let mut command = MetadataCommand::new();
    command.manifest_path(manifest).other_options(["--locked".to_owned()]).exec().expect("cargo metadata")
}

/// Whether a licence expression (SPDX) lets us choose allowed licences only. Strict where `AND` and `OR` are mixed without
/// brackets.
fn is_allowed(expression: &str) -> bool {
    let alternatives = |part: &str| part.replace('/', " OR ").replace(['(', ')'], "");
    let is_listed = |name: &str| ALLOWED_LICENCES.contains(&name.trim());
    expression.split(" AND ").all(|part| alternatives(part).split(" OR ").any(is_listed))
}

#[test]
fn every_licence_is_an_allowed_one() {
    let wrong: Vec<String> = packages()
        .packages
        .iter()
        .filter(|package| !NOT_BUILT.contains(&package.name.as_str()))
        .filter(|package| !package.license.as_deref().is_some_and(is_allowed))
        .map(|package| format!("{} {}: {:?}", package.name, package.version, package.license))
        .collect();
    assert!(wrong.is_empty(), "licences that ALLOWED_LICENCES does not list: {wrong:#?}");
}

#[test]
fn no_crate_is_there_twice_but_the_known_ones() {
    let mut versions: BTreeMap<String, BTreeSet<Version>> = BTreeMap::new();
    for package in packages().packages {
        versions.entry(package.name.to_string()).or_default().insert(package.version);
    }
    let mut wrong = Vec::new();
    for (name, versions) in versions.iter().filter(|(_, versions)| versions.len() > 1) {
        let known = KNOWN_DUPLICATES.iter().find(|(known, _)| known == name).map_or(1, |(_, count)| *count);
        if versions.len() > known {
            let versions: Vec<String> = versions.iter().map(Version::to_string).collect();
            wrong.push(format!("{name} is there as {}; {known} known", versions.join(", ")));
        }
    }
    for (name, known) in KNOWN_DUPLICATES {
        let count = versions.get(name).map_or(0, BTreeSet::len);
        if count < known {
            wrong.push(format!("{name}: {count} versions are left of {known}; shorten KNOWN_DUPLICATES"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// A known vulnerability of a crate, as the RustSec database has it.
struct Advisory {
    id: String,
    package: String,
    /// Versions that do not have it any more, or never had it.
    safe: Vec<VersionReq>,
    /// Only reported: `unmaintained`, `notice`. `unsound` is a defect like any other.
    is_notice: bool,
}

impl Advisory {
    /// `None` for one that was withdrawn.
    fn parse(text: &str) -> Result<Option<Self>, String> {
        let header = text.strip_prefix("```toml").and_then(|rest| rest.split("```").next()).ok_or("no header")?;
        let header: toml::Table = header.parse().map_err(|error| format!("{error}"))?;
        let advisory = header.get("advisory").and_then(toml::Value::as_table).ok_or("no [advisory]")?;
        if advisory.contains_key("withdrawn") {
            return Ok(None);
        }
        let text = |key: &str| advisory.get(key).and_then(toml::Value::as_str).map(str::to_owned);
        let requirements = |key: &str| header.get("versions")?.get(key)?.as_array().cloned();
        let safe = ["patched", "unaffected"].into_iter().filter_map(requirements).flatten();
        let safe = safe.map(|requirement| {
            let text = requirement.as_str().ok_or("a requirement that is no text")?;
            VersionReq::parse(text).map_err(|error| format!("{text}: {error}"))
        });
        Ok(Some(Self {
            id: text("id").ok_or("no id")?,
            package: text("package").ok_or("no package")?,
            safe: safe.collect::<Result<_, String>>()?,
            is_notice: text("informational").is_some_and(|kind| kind != "unsound"),
        }))
    }

    fn concerns(&self, name: &str, version: &Version) -> bool {
        self.package == name && !self.safe.iter().any(|safe| safe.matches(version))
    }
}

/// The advisories about a crate in a checkout of the RustSec database.
fn advisories_about(database: &Path, name: &str) -> Vec<Advisory> {
    let files = std::fs::read_dir(database.join("crates").join(name)).into_iter().flatten().flatten();
    let files = files.map(|file| file.path()).filter(|path| path.extension().is_some_and(|kind| kind == "md"));
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).expect("an advisory that was just listed");
        Advisory::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    files.filter_map(read).collect()
}

/// A checkout of the RustSec database: where `GLINT_ADVISORIES` says, else where cargo-audit and cargo-deny keep theirs.
fn database() -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os("GLINT_ADVISORIES") {
        return Some(PathBuf::from(folder));
    }
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| Some(std::env::home_dir()?.join(".cargo")))?;
    let of_deny =
        std::fs::read_dir(home.join("advisory-dbs")).into_iter().flatten().flatten().map(|entry| entry.path());
    std::iter::once(home.join("advisory-db")).chain(of_deny).find(|folder| folder.join("crates").is_dir())
}

#[test]
fn no_crate_has_a_known_vulnerability() {
    let Some(database) = database() else {
        println!(
            "skipped: no advisory database; `cargo audit` or `cargo deny` fetches one, GLINT_ADVISORIES names one"
        );
        return;
    };
    assert!(database.join("crates").is_dir(), "{} is no advisory database", database.display());
    let mut wrong = Vec::new();
    for package in packages().packages {
        for advisory in advisories_about(&database, &package.name) {
            if advisory.concerns(&package.name, &package.version) {
                let line = format!("{} {}: {}", package.name, package.version, advisory.id);
                if advisory.is_notice {
                    println!("notice: {line}");
                } else {
                    wrong.push(line);
                }
            }
        }
    }
    assert!(wrong.is_empty(), "known vulnerabilities: {wrong:#?}");
}

#[test]
fn a_licence_may_be_chosen_among_alternatives_but_all_parts_must_be_allowed() {
    for allowed in ["MIT", "GPL-3.0 OR MIT", "GPL-3.0/Apache-2.0", "(MIT OR GPL-2.0) AND Unicode-3.0"] {
        assert!(is_allowed(allowed), "{allowed}");
    }
    for refused in ["GPL-3.0", "MIT AND GPL-3.0", "(MIT OR Apache-2.0) AND LGPL-2.1", "", "MITX"] {
        assert!(!is_allowed(refused), "{refused}");
    }
}

#[test]
fn an_advisory_concerns_the_versions_that_are_not_safe() {
    let database = tempfile::tempdir().expect("a folder");
    let folder = database.path().join("crates/leaky");
    std::fs::create_dir_all(&folder).expect("a folder");
    let header = |id: &str, more: &str| {
        format!(
            "```toml\n[advisory]\nid = \"{id}\"\npackage = \"leaky\"\n{more}\n[versions]\npatched = [\">= 1.2.3\"]\nunaffected = [\"< 1.1\"]\n```\n# Leaks\n"
        )
    };
    let advisories = [
        ("RUSTSEC-1", header("RUSTSEC-1", "")),
        ("RUSTSEC-2", header("RUSTSEC-2", "withdrawn = \"2024-01-01\"")),
        ("RUSTSEC-3", header("RUSTSEC-3", "informational = \"unmaintained\"")),
    ];
    for (name, text) in advisories {
        std::fs::write(folder.join(format!("{name}.md")), text).expect("a file");
    }
    let mut found = advisories_about(database.path(), "leaky");
    found.sort_by(|a, b| a.id.cmp(&b.id));
    let told: Vec<(&str, bool)> = found.iter().map(|advisory| (advisory.id.as_str(), advisory.is_notice)).collect();
    assert_eq!(told, [("RUSTSEC-1", false), ("RUSTSEC-3", true)]);
    for (version, is_concerned) in
        [("1.0.9", false), ("1.1.0", true), ("1.2.2", true), ("1.2.3", false), ("2.0.0", false)]
    {
        let version = Version::parse(version).expect("a version");
        assert_eq!(found[0].concerns("leaky", &version), is_concerned, "{version}");
        assert!(!found[0].concerns("other", &version));
    }
    assert!(advisories_about(database.path(), "sound").is_empty());
    assert!(Advisory::parse("no header").is_err());
}
