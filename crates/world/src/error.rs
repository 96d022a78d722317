//! The one error of this crate.

use std::path::PathBuf;

pub type Result<T, E = Error> = std::result::Result<T, E>;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Words were given and none of them names anything; a line for each.
    #[error("{0}")]
    NothingNamed(String),
    /// Points are to be chosen by an attribute that their cloud does not have.
    #[error("{cloud}: has no attribute `{attribute}`")]
    NoAttribute { cloud: String, attribute: String },
    #[error("no home folder for pages; GLINT_CACHE_DIR can name one")]
    NoCacheFolder,
    #[error("{folder}: in use elsewhere, so the index is kept")]
    IndexInUse { folder: PathBuf },
    #[error(transparent)]
    File(#[from] codec::Error),
    #[error(transparent)]
    Pages(#[from] stream::Error),
}

impl Error {
    /// Whether a person named something wrong or a file cannot be read: the program did what it could.
    pub fn is_usage(&self) -> bool {
        match self {
            Self::NothingNamed(_) | Self::NoAttribute { .. } | Self::File(_) => true,
            Self::Pages(error) => matches!(error, stream::Error::Input(_)),
            Self::NoCacheFolder | Self::IndexInUse { .. } => false,
        }
    }
}
