//! What a word of a command line names: a file, a folder of tiles or a built-in scene.

use std::path::PathBuf;

use scene::{five_mirrors, shown};

/// An input that a person named.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    File(PathBuf),
    /// A folder with several files that are one cloud.
    Tiles {
        folder: PathBuf,
        /// The files, in the order of their names.
        files: Vec<PathBuf>,
    },
    BuiltIn {
        variant: five_mirrors::Variant,
        /// The names of its mirrors that are left out because others have taken their places.
        without: Vec<String>,
    },
    /// A word that names nothing, or a scene file that cannot be read. It keeps its place, and fails when it is loaded.
    Unknown {
        name: String,
        error: String,
    },
}

impl Input {
    /// The name as a person would type it.
    pub fn name(&self) -> String {
        match self {
            Self::File(path) | Self::Tiles { folder: path, .. } => shown(path),
            Self::BuiltIn { variant, .. } => built_in_name(*variant),
            Self::Unknown { name, .. } => name.clone(),
        }
    }

    /// The files that are read.
    pub fn files(&self) -> &[PathBuf] {
        match self {
            Self::File(path) => std::slice::from_ref(path),
            Self::Tiles { files, .. } => files,
            Self::BuiltIn { .. } | Self::Unknown { .. } => &[],
        }
    }

    /// Whether it is an address.
    pub(crate) fn is_far(&self) -> bool {
        matches!(self, Self::File(path) if codec::is_address(path))
    }

    /// Whether its files are one cloud, unless some lie apart: a folder or a catalogue.
    pub(crate) fn has_tiles(&self) -> bool {
        match self {
            Self::File(path) => path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vpc")),
            Self::Tiles { .. } => true,
            Self::BuiltIn { .. } | Self::Unknown { .. } => false,
        }
    }
}

pub fn built_in_name(variant: five_mirrors::Variant) -> String {
    format!("{}/{}", variant.family(), variant.name())
}

/// The name of the cloud of a built-in scene, beside its mirrors.
pub(crate) fn walls_name(variant: five_mirrors::Variant) -> String {
    format!("{}, walls", built_in_name(variant))
}
