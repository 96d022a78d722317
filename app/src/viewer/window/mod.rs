//! The window's parts outside of the session: its surface, the threads that draw the points and hand pictures over, the
//! event log, and effects.

pub mod canvas;
pub mod capture;
pub mod effects;
pub mod event_log;
pub mod frame_request;
pub mod picture_writer;
pub mod render_thread;
pub mod screen;
pub mod under_way;
pub mod window_texture;
