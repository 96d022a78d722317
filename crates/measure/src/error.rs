//! What cannot be measured.

#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error("a line of {corners} corners, expected at least 2")]
    ShortLine { corners: usize },
    #[error("corners {} and {} are above one another", corner, corner + 1)]
    NoLength { corner: usize },
    #[error("a width of {width}, expected more than 0")]
    Width { width: f64 },
    #[error("a scale of {length}, expected more than 0")]
    Scale { length: f64 },
    #[error("a registration off by {registration}, expected 0 or more")]
    Registration { registration: f64 },
    #[error("{points} points, expected at least {least}")]
    TooFew { points: usize, least: usize },
    #[error("the points lie on a line, or evenly in all directions: no plane goes through them")]
    NoPlane,
    #[error("the points have no curvature that can be fitted")]
    NotRound,
    #[error("the plane through the corners is upright: there is nothing above or below it")]
    Upright,
    #[error("the corners enclose no area as seen from above")]
    NoArea,
    #[error("its sides cross, expected corners in their order around it")]
    Crossed,
}

pub type Result<T> = std::result::Result<T, Error>;
