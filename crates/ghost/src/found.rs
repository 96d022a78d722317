//! Mirrors, and why they are taken to be mirrors.

use scene::Mirror;

use crate::unfold::Reflector;

/// A mirror, and why it is taken to be one.
#[derive(Clone, Debug)]
pub struct Found {
    pub reflector: Reflector,
    /// In words, for people.
    pub reason: String,
}

impl Found {
    /// A mirror that a person named.
    pub fn given(mirror: Mirror) -> Self {
        let reason = if mirror.refraction.is_some() { "a pane that was given" } else { "a mirror that was given" };
        Self { reflector: Reflector::exact(mirror), reason: reason.to_owned() }
    }
}
