//! What makes the picture: the threads that draw points and hand pictures over, frame requests, and the event log.

pub mod beginning;
pub mod canvas;
pub mod capture;
pub mod event_log;
pub mod frame_request;
pub mod judging;
pub mod messages;
pub mod moving;
pub mod pace;
pub mod picture_writer;
pub mod render_thread;
pub mod under_way;
pub mod window_texture;
