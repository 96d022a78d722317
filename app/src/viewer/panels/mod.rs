//! The panels and what is drawn over the picture. They read the session and push actions.

pub mod bookmarks;
pub mod clips;
pub mod clouds;
pub mod colors;
pub mod comparing;
pub mod labels;
pub mod leaving;
pub mod light;
pub mod marking;
pub mod measurements;
pub mod mirrors;
pub mod overlay;
pub mod palette;
pub mod parameters;
pub mod path_prompt;
pub mod pick;
pub mod picture;
pub mod presets;
pub mod recording;
pub mod side;
pub mod streaming;
pub mod sweep;
pub mod timeline;
pub mod timings;
pub mod truth;
pub mod tuning;
