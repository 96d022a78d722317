//! `cargo xtask package`: a .deb and a .tar.gz of the program for Linux, with what desktops ask for: an entry for menus,
//! an icon, the types of point clouds, and a thumbnailer.
//!
//! Debian's own programs put the packages together (dpkg-deb, tar, objdump). What desktops ask for lies in
//! assets/desktop.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};

use crate::{needs, notices};

/// The newest glibc whose symbols a package may use: 2.35 is of February 2022, and linking on a newer system asks for its
/// `hypot`. Debian 12, Ubuntu 22.04, Fedora 36 and what came after them have it.
const GLIBC: (u32, u32) = (2, 35);

/// The shared libraries that the program may be linked with, and Debian's packages of them. It opens others by name at
/// run time.
const LINKED: [(&str, &str); 4] =
    [("libc.so.6", "libc6"), ("libm.so.6", "libc6"), ("ld-linux-", "libc6"), ("libgcc_s.so.1", "libgcc-s1")];

/// Where the files of assets/desktop go, below /usr or the archive's folder.
const FILES: [(&str, &str); 4] = [
    ("glint.desktop", "share/applications"),
    ("glint.svg", "share/icons/hicolor/scalable/apps"),
    ("glint.xml", "share/mime/packages"),
    ("glint.thumbnailer", "share/thumbnailers"),
];

/// Makes both packages in `target`/package from the program that is built in `target`. Returns their paths.
///
/// # Errors
/// A tool is missing, the program needs a newer glibc or an unknown library, or the licence of a dependency is unknown.
pub fn package(cargo: fn() -> Command, root: &Path, target: &Path) -> Result<Vec<PathBuf>> {
    let program = &target.join("release/glint");
    let symbols = output("objdump", &["-T"], program, "binutils")?;
    let newest = newest_glibc(&symbols);
    let [major, minor] = [newest.0, newest.1];
    ensure!(
        newest <= GLIBC,
        "the program needs glibc {major}.{minor}, and packages promise {}.{}; build it on an older system. Symbols: {}",
        GLIBC.0,
        GLIBC.1,
        symbols_above(&symbols, GLIBC).join(", ")
    );
    println!("The program needs glibc {major}.{minor}; packages promise to run with {}.{}.", GLIBC.0, GLIBC.1);
    let linked = packages_of(&output("objdump", &["-p"], program, "binutils")?)?;
    let folder = target.join("package");
    if folder.exists() {
        std::fs::remove_dir_all(&folder)?;
    }
    let (notices, crates) = notices::notices(cargo, root)?;
    let library = notices::library_notices()?;
    println!("{} has the licences of {crates} crates, {} KiB.", notices::FILE, notices.len() / 1024);
    let documents = |folder: &Path| -> Result<()> {
        for file in ["README.md", "LICENSE-MIT", "LICENSE-APACHE"] {
            put(&root.join(file), &folder.join(file), 0o644)?;
        }
        put(&library, &folder.join(notices::LIBRARY), 0o644)?;
        Ok(std::fs::write(folder.join(notices::FILE), &notices)?)
    };
    let version = env!("CARGO_PKG_VERSION");
    let name = format!("glint-{version}-{}-linux", std::env::consts::ARCH);
    // The archive: to unpack anywhere, or over /usr/local or ~/.local.
    let archive = folder.join(&name);
    stage(root, program, &archive)?;
    documents(&archive)?;
    let tar = folder.join(format!("{name}.tar.gz"));
    let words = ["--owner=0", "--group=0", "--numeric-owner", "--sort=name", "-C"];
    run(Command::new("tar").args(words).arg(&folder).arg("-czf").arg(&tar).arg(&name), "tar")?;
    // The package for Debian and Ubuntu. Their triggers bring menus, types and icons up to date.
    let tree = folder.join("deb");
    stage(root, program, &tree.join("usr"))?;
    let folder_of_documents = tree.join("usr/share/doc/glint");
    documents(&folder_of_documents)?;
    std::fs::write(
        folder_of_documents.join("copyright"),
        copyright(&std::fs::read_to_string(root.join("LICENSE-MIT"))?),
    )?;
    let architecture = debian_architecture(std::env::consts::ARCH);
    let kibibytes = bytes_below(&tree)?.div_ceil(1024);
    std::fs::create_dir_all(tree.join("DEBIAN"))?;
    std::fs::write(tree.join("DEBIAN/control"), control(version, architecture, kibibytes, &linked))?;
    let deb = folder.join(format!("glint_{version}_{architecture}.deb"));
    run(Command::new("dpkg-deb").args(["--build", "--root-owner-group"]).args([&tree, &deb]), "dpkg")?;
    for tree in [tree, archive] {
        std::fs::remove_dir_all(tree)?;
    }
    Ok(vec![deb, tar])
}

/// Puts the program and what desktops ask for below a folder.
fn stage(root: &Path, program: &Path, prefix: &Path) -> Result<()> {
    put(program, &prefix.join("bin/glint"), 0o755)?;
    for (file, place) in FILES {
        put(&root.join("assets/desktop").join(file), &prefix.join(place).join(file), 0o644)?;
    }
    Ok(())
}

fn put(from: &Path, to: &Path, mode: u32) -> Result<()> {
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder)?;
    }
    std::fs::copy(from, to).with_context(|| format!("{} is not copied", from.display()))?;
    #[cfg(unix)]
    std::fs::set_permissions(to, std::os::unix::fs::PermissionsExt::from_mode(mode))?;
    #[cfg(not(unix))]
    let _ = mode;
    Ok(())
}

/// The control file of the Debian package.
fn control(version: &str, architecture: &str, kibibytes: u64, linked: &[String]) -> String {
    let opened = needs::needs_to_run(needs::Display::X11);
    let opened = opened.iter().filter(|need| need.package != DRIVER).map(|need| need.package.to_owned());
    let (major, minor) = GLIBC;
    let dated = |package: &String| match package.as_str() {
        "libc6" => format!("libc6 (>= {major}.{minor})"),
        other => other.to_owned(),
    };
    let depends: Vec<String> = linked.iter().map(dated).chain(opened).collect();
    format!(
        "Package: glint\n\
         Version: {version}\n\
         Architecture: {architecture}\n\
         Maintainer: glint developers <glint@localhost>\n\
         Installed-Size: {kibibytes}\n\
         Depends: {}\n\
         Recommends: {DRIVER} | vulkan-icd, shared-mime-info, desktop-file-utils\n\
         Suggests: libwayland-client0, xdg-desktop-portal\n\
         Section: graphics\n\
         Priority: optional\n\
         Description: viewer for large point clouds with indirect light and curved mirrors\n \
         glint shows point clouds in LAS, LAZ, COPC and PLY files, also those larger than\n \
         memory. It draws points as surfaces, lights them, and shows correct reflections\n \
         in curved mirrors. The same pictures are made without a window by its commands.\n",
        depends.join(", ")
    )
}

/// Debian's page about the licences of a package.
fn copyright(mit: &str) -> String {
    format!(
        "glint may be used under the terms of the MIT licence below, or of the Apache License, version 2.0 (LICENSE-APACHE\n\
         in this folder; /usr/share/common-licenses/Apache-2.0). It contains code and fonts of other people: {} and\n\
         {} in this folder have their licences.\n\n{mit}",
        notices::FILE,
        notices::LIBRARY
    )
}

/// Mesa's drivers. Other drivers do as well, so nobody is made to install them.
const DRIVER: &str = "mesa-vulkan-drivers";

fn debian_architecture(architecture: &str) -> &str {
    match architecture {
        "x86_64" => "amd64",
        "aarch64" => "arm64",
        other => other,
    }
}

/// The version of glibc that a symbol of `objdump -T` asks for.
fn glibc_of(line: &str) -> Option<(u32, u32)> {
    let (_, version) = line.split_once("GLIBC_")?;
    let mut numbers = version.split(|letter: char| !letter.is_ascii_digit()).map(str::parse);
    Some((numbers.next()?.ok()?, numbers.next()?.ok()?))
}

fn newest_glibc(symbols: &str) -> (u32, u32) {
    symbols.lines().filter_map(glibc_of).max().unwrap_or((0, 0))
}

/// The names of the symbols that ask for a newer glibc than this one.
fn symbols_above(symbols: &str, glibc: (u32, u32)) -> Vec<&str> {
    let above = symbols.lines().filter(|line| glibc_of(line).is_some_and(|version| version > glibc));
    above.filter_map(|line| line.split_whitespace().last()).collect()
}

/// The packages of the libraries that a program is linked with, from the text of `objdump -p`.
fn packages_of(headers: &str) -> Result<Vec<String>> {
    let mut packages = Vec::new();
    for library in headers.lines().filter_map(|line| line.trim().strip_prefix("NEEDED")).map(str::trim) {
        let known = LINKED.iter().find(|(name, _)| library.starts_with(name));
        let Some((_, package)) = known else {
            bail!("the program is linked with {library}, and crates/xtask/src/package.rs knows no package of it");
        };
        if !packages.iter().any(|known| known == package) {
            packages.push((*package).to_owned());
        }
    }
    Ok(packages)
}

fn bytes_below(folder: &Path) -> Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        bytes += if entry.file_type()?.is_dir() { bytes_below(&entry.path())? } else { entry.metadata()?.len() };
    }
    Ok(bytes)
}

/// What a tool prints about a file.
fn output(tool: &str, words: &[&str], file: &Path, package: &str) -> Result<String> {
    let output = Command::new(tool).args(words).arg(file).output().with_context(|| lacks(tool, package))?;
    ensure!(output.status.success(), "{tool}: {}", String::from_utf8_lossy(&output.stderr).trim());
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

fn run(command: &mut Command, package: &str) -> Result<()> {
    let tool = command.get_program().to_string_lossy().into_owned();
    let status = command.status().with_context(|| lacks(&tool, package))?;
    ensure!(status.success(), "{tool} failed ({status}); see its message above");
    Ok(())
}

fn lacks(tool: &str, package: &str) -> String {
    format!("{tool} does not start; on Debian and Ubuntu the package {package} has it")
}

#[cfg(test)]
mod tests {
    use super::*;

    const SYMBOLS: &str = "\
0000000000000000      DF *UND*  0000000000000000 (GLIBC_2.2.5) free\n\
0000000000000000      DF *UND*  0000000000000000 (GLIBC_2.34) pthread_create\n\
0000000000000000      DF *UND*  0000000000000000 (GCC_3.0)   _Unwind_Backtrace\n\
0000000000000000  w   DF *UND*  0000000000000000 (GLIBC_2.9) pipe2\n";

    #[test]
    fn the_newest_glibc_is_told_by_number_and_not_by_letter() {
        assert_eq!(newest_glibc(SYMBOLS), (2, 34));
        assert_eq!(symbols_above(SYMBOLS, (2, 33)), ["pthread_create"]);
        assert!(symbols_above(SYMBOLS, (2, 34)).is_empty());
        assert_eq!(newest_glibc(""), (0, 0));
    }

    #[test]
    fn a_library_without_a_package_is_an_error() {
        let headers = "  NEEDED               libgcc_s.so.1\n  NEEDED               libm.so.6\n  NEEDED               libc.so.6\n";
        assert_eq!(packages_of(headers).unwrap(), ["libgcc-s1", "libc6"]);
        let error = packages_of("  NEEDED               libz.so.1\n").unwrap_err().to_string();
        assert!(error.contains("libz.so.1"), "{error}");
    }

    #[test]
    fn the_package_asks_for_what_the_program_opens_by_name() {
        let control = control("1.2.3", "amd64", 42, &["libc6".to_owned()]);
        let line = |name: &str| control.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
        let depends = line("Depends");
        assert!(depends.contains("libc6 (>= 2.35)") && depends.contains("libvulkan1"), "{depends}");
        assert!(depends.contains("libxkbcommon-x11-0") && !depends.contains(DRIVER), "{depends}");
        assert!(line("Recommends").contains("mesa-vulkan-drivers | vulkan-icd"));
        assert!(control.ends_with('\n') && !control.contains("\n\n"), "{control}");
    }

    #[test]
    fn menus_types_and_thumbnails_name_the_same_types() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/desktop");
        let text = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
        let declared: Vec<String> = text("glint.xml")
            .split("<mime-type type=\"")
            .skip(1)
            .filter_map(|rest| Some(rest.split_once('"')?.0.to_owned()))
            .collect();
        assert_eq!(declared.len(), 4);
        for file in ["glint.desktop", "glint.thumbnailer"] {
            let text = text(file);
            let line = text.lines().find_map(|line| line.strip_prefix("MimeType=")).unwrap();
            let named: Vec<&str> = line.split_terminator(';').collect();
            assert_eq!(named, declared, "{file}");
        }
    }
}
