//! The errors of this crate.

use std::path::PathBuf;

pub type Result<T, E = Error> = std::result::Result<T, E>;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Words were given, but none of them names anything.
    #[error("{0}")]
    NothingNamed(String),
    /// A scene switches off all of its clouds.
    #[error("{0}: the scene hides all of its clouds")]
    AllHidden(String),
    /// Points are to be chosen by an attribute that their cloud does not have.
    #[error("{cloud}: has no attribute `{attribute}`")]
    NoAttribute { cloud: String, attribute: String },
    /// A filter, or hidden classes, of which no cloud has the attribute.
    #[error("{0}")]
    NoFilter(String),
    /// A mirror is to be made of a file that holds no mesh.
    #[error("{path}: {problem}")]
    NoMesh { path: String, problem: &'static str },
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
    /// Whether the person named something wrong or a file cannot be read, so that the program is not at fault.
    pub fn is_usage(&self) -> bool {
        match self {
            Self::NothingNamed(_)
            | Self::AllHidden(_)
            | Self::NoAttribute { .. }
            | Self::NoFilter(_)
            | Self::NoMesh { .. } => true,
            Self::File(error) => is_of_input(error),
            Self::Pages(error) => is_of_inputs(error),
            Self::NoCacheFolder | Self::IndexInUse { .. } => false,
        }
    }
}

/// Whether a file cannot be read, rather than written.
fn is_of_input(error: &codec::Error) -> bool {
    !matches!(error, codec::Error::NotWritten { .. })
}

/// Whether what could not be read may come when it is asked for later: a server or a disk has failed, and nothing is
/// damaged, refused or gone.
pub(crate) fn may_come(error: &stream::Error) -> bool {
    use std::io::ErrorKind::{InvalidData, NotFound, Other, PermissionDenied, UnexpectedEof};
    let (stream::Error::Io { reason, .. } | stream::Error::Input(codec::Error::Io { reason, .. })) = error else {
        return false;
    };
    // Other errors of servers are final.
    let is_final = matches!(reason.kind(), InvalidData | NotFound | Other | PermissionDenied | UnexpectedEof);
    reason.kind() == codec::NO_ANSWER || !is_final
}

/// Whether a streamed file cannot be read, rather than written.
pub(crate) fn is_of_inputs(error: &stream::Error) -> bool {
    match error {
        stream::Error::Input(error) => is_of_input(error),
        // Inputs without points, and inputs that are being written.
        stream::Error::Empty { .. } | stream::Error::Changed { .. } => true,
        _ => false,
    }
}
