//! What can be wrong with the files of a recording.

use rav1e::prelude::EncoderStatus;

pub type Result<T> = std::result::Result<T, Error>;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error(transparent)]
    Unreadable(#[from] scene::Error),
    #[error("{name}: {problem}")]
    Malformed { name: String, problem: String },
    /// A film cannot be written; whoever knows its name adds it.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("the encoder refuses: {reason}")]
    Encoder { reason: String },
    /// `ffmpeg` is missing, or fails.
    #[error("ffmpeg: {problem}")]
    Ffmpeg { problem: String },
    /// The pictures in the folder are of something else.
    #[error("{name}: {difference}; name another folder")]
    Other { name: String, difference: String },
}

impl Error {
    pub(crate) fn encoder(status: EncoderStatus) -> Self {
        Self::Encoder { reason: status.to_string() }
    }

    pub(crate) fn muxer(reason: impl std::fmt::Display) -> Self {
        Self::Encoder { reason: reason.to_string() }
    }
}
