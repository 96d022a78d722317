//! What the program finds around it: a desktop, a folder for settings.

use std::path::PathBuf;

/// Whether there is a desktop to open a window on. Windows and macOS always have one.
pub fn has_display() -> bool {
    let set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    cfg!(not(all(unix, not(target_os = "macos")))) || set("DISPLAY") || set("WAYLAND_DISPLAY")
}

/// Where settings and recent files are kept: `GLINT_CONFIG_DIR`, else the platform's place; `None` without a home.
pub fn settings_folder() -> Option<PathBuf> {
    let platform = || Some(directories::ProjectDirs::from("", "", "glint")?.config_dir().to_owned());
    world::folder_named_by("GLINT_CONFIG_DIR").or_else(platform)
}
