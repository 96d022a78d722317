//! What the window and the commands do alike.

pub mod command_line;
pub mod comparing;
pub mod core_points;
pub mod export;
pub mod ghost_arguments;
pub mod ghosts;
pub mod language;
pub mod measuring;
pub mod moved_points;
pub mod numbers;
pub mod profile_chart;
pub mod profile_intervals;
pub mod profiles;
pub mod steps;
pub mod viewpoint;
