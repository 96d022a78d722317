//! What the viewer knows (`state`), what happens to it as a whole (documents, views, the kept state), and the effects
//! that it asks for.

pub mod document;
pub mod effects;
pub mod first_look;
mod judging;
mod kept;
mod state;
pub mod views;
mod wanted;

pub use state::Session;
