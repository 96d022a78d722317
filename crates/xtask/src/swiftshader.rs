//! Finds SwiftShader, a Vulkan driver for processors that shares no code with Mesa's: browsers built on Chromium bring it.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

/// The name of the file that names the driver to Vulkan's loader, which lies beside the driver.
const MANIFEST: &str = "vk_swiftshader_icd.json";
/// The folders of systems in which browsers keep it.
const FOLDERS: [&str; 3] = ["/usr/lib/chromium", "/usr/lib/chromium-browser", "/opt/google/chrome"];
/// The variable that names another folder.
const VARIABLE: &str = "GLINT_SWIFTSHADER";

/// The driver's manifest.
///
/// # Errors
/// There is none, with the lines that bring it.
pub fn manifest(target: &Path) -> Result<PathBuf> {
    let named = std::env::var_os(VARIABLE).map(PathBuf::from);
    let unpacked = target.join("swiftshader");
    let folders = named.into_iter().chain([unpacked.join("usr/lib/chromium")]).chain(FOLDERS.map(PathBuf::from));
    if let Some(found) = folders.map(|folder| folder.join(MANIFEST)).find(|path| path.is_file()) {
        return Ok(found);
    }
    let unpacked = unpacked.display();
    bail!(
        "no {MANIFEST} in {}, nor in the folder that {VARIABLE} names. Debian's package chromium-common brings it; to unpack \
         it without installing a browser:\n  apt-get download chromium-common\n  dpkg -x chromium-common_*.deb {unpacked}",
        FOLDERS.join(", ")
    )
}
