//! What cannot be measured.

#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error("a line of {corners} corners, expected at least 2")]
    ShortLine { corners: usize },
    #[error("corners {} and {} are above one another", corner, corner + 1)]
    NoLength { corner: usize },
    #[error("a width of {width}, expected more than 0")]
    Width { width: f64 },
}

pub type Result<T> = std::result::Result<T, Error>;
