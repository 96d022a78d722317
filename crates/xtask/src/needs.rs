//! What the program and its tests need from the system, and how to find out what is missing.
//!
//! glint links nothing but libc: the Vulkan loader and the window system's libraries are opened by name at run time, so
//! a build succeeds on a machine where the program then finds no adapter or no display. The checks here look for those
//! very names. Everything that decides takes plain values; only `Machine::look` touches the system.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// One thing the system must have, and the Debian and Ubuntu package that brings it.
#[derive(Debug, PartialEq, Eq)]
pub struct Need {
    pub what: &'static str,
    pub package: &'static str,
    proof: Proof,
}

#[derive(Debug, PartialEq, Eq)]
enum Proof {
    /// A shared library under the name that is opened at run time.
    Library(&'static str),
    Program(&'static str),
    VulkanDriver,
}

const fn library(package: &'static str, name: &'static str) -> Need {
    Need { what: name, package, proof: Proof::Library(name) }
}

const fn program(package: &'static str, name: &'static str) -> Need {
    Need { what: name, package, proof: Proof::Program(name) }
}

/// What every picture needs, on screen or not. Mesa's package holds a software driver that runs everywhere.
const PICTURE: [Need; 2] = [
    library("libvulkan1", "libvulkan.so.1"),
    Need { what: "a Vulkan driver", package: "mesa-vulkan-drivers", proof: Proof::VulkanDriver },
];

/// The names winit's X11 back end opens (x11-dl, xkbcommon-dl); libX11 brings libxcb, which x11rb opens.
const X11: [Need; 6] = [
    library("libx11-6", "libX11.so.6"),
    library("libx11-xcb1", "libX11-xcb.so.1"),
    library("libxcursor1", "libXcursor.so.1"),
    library("libxi6", "libXi.so.6"),
    library("libxkbcommon0", "libxkbcommon.so.0"),
    library("libxkbcommon-x11-0", "libxkbcommon-x11.so.0"),
];

/// The names winit's Wayland back end opens.
const WAYLAND: [Need; 2] =
    [library("libwayland-client0", "libwayland-client.so.0"), library("libxkbcommon0", "libxkbcommon.so.0")];

/// Window tests run on a private Xvfb and are driven with xdotool. spirv-val judges the passes as drivers of Vulkan get
/// them.
const TEST_TOOLS: [Need; 3] =
    [program("xvfb", "Xvfb"), program("xdotool", "xdotool"), program("spirv-tools", "spirv-val")];

/// Decodes the films that tests have made. Tests pass without it, and say that nothing was decoded.
const DECODER: [Need; 1] = [program("ffmpeg", "ffmpeg")];

/// Where the program will show its window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Display {
    /// The display of Windows or macOS.
    Native,
    Wayland,
    X11,
    None,
}

impl Display {
    /// winit's choice on a system (`std::env::consts::OS`): Wayland before X11 where there may be either; a variable that
    /// is set but empty counts as unset.
    pub fn from_environment(system: &str, variable: impl Fn(&str) -> Option<String>) -> Display {
        let set = |name| variable(name).is_some_and(|value| !value.is_empty());
        if matches!(system, "windows" | "macos") {
            Display::Native
        } else if set("WAYLAND_DISPLAY") || set("WAYLAND_SOCKET") {
            Display::Wayland
        } else if set("DISPLAY") {
            Display::X11
        } else {
            Display::None
        }
    }
}

pub fn needs_to_run(display: Display) -> Vec<Need> {
    let window: Vec<Need> = match display {
        // Windows and macOS bring all that a window and a picture need.
        Display::Native => return Vec::new(),
        Display::Wayland => WAYLAND.into(),
        Display::X11 => X11.into(),
        Display::None => Vec::new(),
    };
    PICTURE.into_iter().chain(window).collect()
}

pub fn needs_to_test() -> Vec<Need> {
    PICTURE.into_iter().chain(X11).chain(TEST_TOOLS).collect()
}

pub fn needs_to_decode() -> Vec<Need> {
    DECODER.into()
}

/// What was found on this machine.
#[derive(Debug, Default)]
pub struct Machine {
    libraries: BTreeSet<String>,
    programs: BTreeSet<String>,
    vulkan_driver: bool,
}

impl Machine {
    /// Looks for shared libraries in the loader's cache, for programs in `PATH`, and for Vulkan drivers where the
    /// Vulkan loader looks.
    pub fn look() -> Machine {
        let libraries = libraries_in_cache(&loader_cache(), std::env::consts::ARCH);
        let tools = TEST_TOOLS.iter().chain(&DECODER).chain(&INSTALLERS).filter_map(|need| match need.proof {
            Proof::Program(name) => Some(name),
            _ => None,
        });
        let programs = tools.filter(|name| in_path(name)).map(str::to_owned).collect();
        let vulkan_driver = driver_manifests(|name| std::env::var(name).ok())
            .iter()
            .filter_map(|path| Some((path, std::fs::read_to_string(path).ok()?)))
            .any(|(path, manifest)| names_present_library(&manifest, path, &libraries));
        Machine { libraries, programs, vulkan_driver }
    }

    pub fn lacks(&self, need: &Need) -> bool {
        match need.proof {
            Proof::Library(name) => !self.libraries.contains(name),
            Proof::Program(name) => !self.programs.contains(name),
            Proof::VulkanDriver => !self.vulkan_driver,
        }
    }

    pub fn missing(&self, needs: Vec<Need>) -> Vec<Need> {
        needs.into_iter().filter(|need| self.lacks(need)).collect()
    }

    pub fn has(&self, name: &str) -> bool {
        self.programs.contains(name)
    }
}

/// The programs that can install the rest.
const INSTALLERS: [Need; 2] = [program("apt", "apt-get"), program("sudo", "sudo")];

/// `ldconfig -p`. Debian keeps it in /sbin, which is not in an ordinary user's `PATH`.
fn loader_cache() -> String {
    ["ldconfig", "/sbin/ldconfig", "/usr/sbin/ldconfig"]
        .iter()
        .find_map(|program| Command::new(program).arg("-p").output().ok().filter(|output| output.status.success()))
        .map(|output| String::from_utf8_lossy(&output.stdout).into_owned())
        .unwrap_or_default()
}

/// The names in the text of `ldconfig -p` that a program of this architecture can open. A 32-bit library beside a
/// 64-bit system does not count.
fn libraries_in_cache(cache: &str, architecture: &str) -> BTreeSet<String> {
    let kind = match architecture {
        "x86_64" => "x86-64",
        "aarch64" => "AArch64",
        _ => "",
    };
    cache
        .lines()
        .filter_map(|line| line.trim_start().split_once(" ("))
        .filter(|(_, rest)| rest.split(')').next().is_some_and(|tags| tags.contains(kind)))
        .map(|(name, _)| name.to_owned())
        .collect()
}

fn in_path(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
}

/// The driver manifests that the Vulkan loader would read: those that the two variables name or, if neither is set,
/// those in the folders of the loader's documentation ("Driver Discovery on Linux").
fn driver_manifests(variable: impl Fn(&str) -> Option<String>) -> Vec<PathBuf> {
    let set = |name| variable(name).filter(|value| !value.is_empty());
    let listed = set("VK_DRIVER_FILES").or_else(|| set("VK_ICD_FILENAMES"));
    let places: Vec<PathBuf> = match listed {
        Some(list) => std::env::split_paths(&list).collect(),
        None => {
            let home = variable("HOME").unwrap_or_default();
            let user = set("XDG_DATA_HOME").unwrap_or_else(|| format!("{home}/.local/share"));
            ["/etc", "/usr/local/etc", "/usr/local/share", "/usr/share", &user]
                .iter()
                .map(|place| Path::new(place).join("vulkan/icd.d"))
                .collect()
        }
    };
    places.into_iter().flat_map(manifests_at).collect()
}

/// Returns `place` itself if it is a manifest, or the manifests in it if it is a folder.
fn manifests_at(place: PathBuf) -> Vec<PathBuf> {
    match std::fs::read_dir(&place) {
        Ok(entries) => entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| path.extension().is_some_and(|extension| extension == "json"))
            .collect(),
        Err(_) => vec![place],
    }
}

/// Whether the library that a driver manifest names is there: containers often keep a vendor's manifest without its
/// driver. A name with a slash is a path, relative to the manifest; the loader looks up a name without one.
fn names_present_library(manifest: &str, path: &Path, libraries: &BTreeSet<String>) -> bool {
    let Some(library) = manifest.split("\"library_path\"").nth(1).and_then(|rest| rest.split('"').nth(1)) else {
        return false;
    };
    if library.contains('/') {
        path.parent().is_some_and(|folder| folder.join(library).exists())
    } else {
        libraries.contains(library)
    }
}

/// How to get what is missing.
#[derive(Debug, PartialEq, Eq)]
pub enum Remedy {
    /// Run these, one after the other.
    Install(Vec<Vec<String>>),
    /// Not allowed to install: the line for the user to type.
    Tell(String),
    /// No apt-get here: name what is needed and go on.
    Unknown,
}

pub fn remedy(missing: &[Need], machine: &Machine, root: bool, sudo_without_password: bool) -> Remedy {
    if !machine.has("apt-get") {
        return Remedy::Unknown;
    }
    let packages: BTreeSet<&str> = missing.iter().map(|need| need.package).collect();
    let packages: Vec<&str> = packages.into_iter().collect();
    let install = ["apt-get", "install", "-y", "--no-install-recommends"];
    let words = |command: &[&str], rest: &[&str]| -> Vec<String> {
        // `env` carries the variable through sudo, which drops most of the environment.
        let front: &[&str] = if root { &[] } else { &["sudo", "-n"] };
        let front = front.iter().chain(&["env", "DEBIAN_FRONTEND=noninteractive"]);
        front.chain(command).chain(rest).map(|word| word.to_string()).collect()
    };
    if root || sudo_without_password {
        Remedy::Install(vec![words(&["apt-get", "update"], &[]), words(&install, &packages)])
    } else {
        let (update, install) = ("sudo apt-get update", install.join(" "));
        Remedy::Tell(format!("{update} && sudo {install} {}", packages.join(" ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CACHE: &str = "\
3 libs found in cache `/etc/ld.so.cache'
\tlibvulkan.so.1 (libc6,x86-64) => /lib/x86_64-linux-gnu/libvulkan.so.1
\tlibX11.so.6 (libc6) => /lib/i386-linux-gnu/libX11.so.6
\tlibXi.so.6 (libc6,AArch64, OS ABI: Linux 3.7.0) => /lib/aarch64-linux-gnu/libXi.so.6
Cache generated by: ldconfig (Debian GLIBC 2.36-9) stable release version 2.36
";

    fn names(set: &BTreeSet<String>) -> Vec<&str> {
        set.iter().map(String::as_str).collect()
    }

    fn machine(libraries: &[&str], programs: &[&str], vulkan_driver: bool) -> Machine {
        let own = |names: &[&str]| names.iter().map(|name| name.to_string()).collect();
        Machine { libraries: own(libraries), programs: own(programs), vulkan_driver }
    }

    fn packages(missing: &[Need]) -> Vec<&str> {
        missing.iter().map(|need| need.package).collect()
    }

    #[test]
    fn only_libraries_of_this_architecture_count() {
        assert_eq!(names(&libraries_in_cache(CACHE, "x86_64")), ["libvulkan.so.1"]);
        assert_eq!(names(&libraries_in_cache(CACHE, "aarch64")), ["libXi.so.6"]);
        assert_eq!(libraries_in_cache("", "x86_64").len(), 0);
    }

    #[test]
    fn a_bare_machine_lacks_everything_a_test_needs() {
        let missing = Machine::default().missing(needs_to_test());
        let expected = "libvulkan1 mesa-vulkan-drivers libx11-6 libx11-xcb1 libxcursor1 libxi6 libxkbcommon0 \
                        libxkbcommon-x11-0 xvfb xdotool spirv-tools";
        assert_eq!(packages(&missing).join(" "), expected);
    }

    #[test]
    fn without_a_display_a_loader_and_a_driver_are_enough() {
        let bare = machine(&["libvulkan.so.1"], &[], true);
        assert_eq!(bare.missing(needs_to_run(Display::None)), []);
        assert_eq!(packages(&bare.missing(needs_to_run(Display::Wayland))), ["libwayland-client0", "libxkbcommon0"]);
        assert_eq!(bare.missing(needs_to_run(Display::X11)).len(), X11.len());
    }

    #[test]
    fn a_loader_without_a_driver_is_not_enough() {
        let missing = machine(&["libvulkan.so.1"], &[], false).missing(needs_to_run(Display::None));
        assert_eq!(packages(&missing), ["mesa-vulkan-drivers"]);
    }

    #[test]
    fn another_program_of_a_package_does_not_count() {
        let tools = machine(&[], &["Xvfb", "xdotool", "spirv-as"], false);
        assert!(tools.missing(needs_to_test()).iter().any(|need| need.package == "spirv-tools"));
    }

    #[test]
    fn wayland_comes_before_x11_and_empty_means_unset() {
        let display = |set: &[(&str, &str)]| {
            let found = |name: &str| set.iter().find(|(key, _)| *key == name).map(|(_, value)| value.to_string());
            Display::from_environment("linux", found)
        };
        assert_eq!(display(&[("DISPLAY", ":0"), ("WAYLAND_DISPLAY", "wayland-0")]), Display::Wayland);
        assert_eq!(display(&[("DISPLAY", ":0"), ("WAYLAND_DISPLAY", "")]), Display::X11);
        assert_eq!(display(&[("DISPLAY", "")]), Display::None);
    }

    #[test]
    fn windows_and_macos_have_a_display_and_lack_no_library_of_linux() {
        for system in ["windows", "macos"] {
            let display = Display::from_environment(system, |_| None);
            assert_eq!(display, Display::Native, "{system}");
            assert_eq!(Machine::default().missing(needs_to_run(display)), []);
        }
    }

    #[test]
    fn a_manifest_counts_only_with_its_library() {
        let libraries = BTreeSet::from(["libGLX_nvidia.so.0".to_owned()]);
        let manifest = |library: &str| format!("{{\"ICD\": {{\"library_path\" : \"{library}\"}}}}");
        let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("driver.json");
        assert!(names_present_library(&manifest("libGLX_nvidia.so.0"), &here, &libraries));
        assert!(!names_present_library(&manifest("libvulkan_radeon.so"), &here, &libraries));
        assert!(names_present_library(&manifest("./Cargo.toml"), &here, &libraries));
        assert!(!names_present_library(&manifest("/no/such/driver.so"), &here, &libraries));
        assert!(!names_present_library("not a manifest", &here, &libraries));
    }

    #[test]
    fn named_driver_files_replace_the_usual_folders() {
        let variable = |name: &str| (name == "VK_DRIVER_FILES").then(|| "/a/one.json:/b/two.json".to_owned());
        assert_eq!(driver_manifests(variable), [PathBuf::from("/a/one.json"), PathBuf::from("/b/two.json")]);
    }

    #[test]
    fn installs_only_when_allowed_and_otherwise_gives_one_line() {
        let debian = machine(&[], &["apt-get"], false);
        let missing = || debian.missing(needs_to_run(Display::None));
        let Remedy::Install(commands) = remedy(&missing(), &debian, true, false) else { panic!("root may install") };
        assert_eq!(commands[0].join(" "), "env DEBIAN_FRONTEND=noninteractive apt-get update");
        assert!(commands[1].join(" ").ends_with("--no-install-recommends libvulkan1 mesa-vulkan-drivers"));
        let Remedy::Install(commands) = remedy(&missing(), &debian, false, true) else { panic!("sudo may install") };
        assert_eq!(commands[0][..2], ["sudo", "-n"]);
        let line =
            "sudo apt-get update && sudo apt-get install -y --no-install-recommends libvulkan1 mesa-vulkan-drivers";
        assert_eq!(remedy(&missing(), &debian, false, false), Remedy::Tell(line.to_owned()));
    }

    #[test]
    fn a_package_that_brings_two_needs_is_installed_once() {
        let debian = machine(&[], &["apt-get"], false);
        let needs = needs_to_run(Display::Wayland).into_iter().chain(needs_to_run(Display::X11)).collect();
        let Remedy::Tell(line) = remedy(&debian.missing(needs), &debian, false, false) else { panic!("not allowed") };
        assert_eq!(line.matches("libxkbcommon0").count(), 1);
    }

    #[test]
    fn without_apt_nothing_is_installed() {
        let other = Machine::default();
        assert_eq!(remedy(&other.missing(needs_to_test()), &other, true, true), Remedy::Unknown);
    }
}
