//! What can be wrong with the files of a recording.

pub type Result<T> = std::result::Result<T, Error>;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error(transparent)]
    Unreadable(#[from] scene::Error),
    #[error("{name}: {problem}")]
    Malformed { name: String, problem: String },
    /// The pictures in the folder are of something else.
    #[error("{name}: {difference}; name another folder")]
    Other { name: String, difference: String },
}
