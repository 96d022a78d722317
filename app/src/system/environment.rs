//! Finds out what surrounds the program: whether there is a desktop, and where settings are kept.

use std::path::PathBuf;

/// Whether there is a desktop to open a window on. Windows and macOS always have one.
pub fn has_display() -> bool {
    let set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    cfg!(not(all(unix, not(target_os = "macos")))) || set("DISPLAY") || set("WAYLAND_DISPLAY")
}

/// The folder of settings and recent files: `GLINT_CONFIG_DIR` if it is set, else the platform's folder. `None` without
/// a home folder.
pub fn settings_folder() -> Option<PathBuf> {
    let platform = || Some(directories::ProjectDirs::from("", "", "glint")?.config_dir().to_owned());
    world::folder_named_by("GLINT_CONFIG_DIR").or_else(platform)
}
