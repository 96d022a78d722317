//! What a person asks of the session (`action`), and what the session asks of others (`outside`, `work`) or says (`messages`).

pub mod action;
pub mod autosave;
pub mod bindings;
pub mod columns;
pub mod draft;
pub mod file_names;
pub mod messages;
pub mod outside;
pub mod path_prompt;
pub mod pick;
pub mod preferences;
pub mod recording;
pub mod work;
