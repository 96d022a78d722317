//! What the window and the commands do alike.

pub mod command_line;
pub mod comparing;
pub mod measuring;
pub mod profile_chart;
