//! Ghosts: points that a scanner saw in mirrors and panes and wrote down behind them. They are parted from other points,
//! put back to where they are, and their mirrors are found.
//!
//! The crate knows points, stations and mirrors, and no files. Lengths are in the units of the coordinates, and angles in
//! radians.

mod columns;
mod evidence;
mod find;
mod found;
mod gauge;
mod planes;
mod range_image;
mod refine;
mod spheres;
mod strength;
mod surface_map;
mod unfold;

pub use evidence::{Block, Extent, GHOST_FROM, Kind, Points, Suspect, Verdicts, judge};
pub use find::find;
pub use found::Found;
pub use gauge::{Gauge, Residual};
pub use unfold::{Mirrors, Reflector, ScannerError, Way};
