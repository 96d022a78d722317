//! Failures whose exit status is not simply 1. Scripts tell a typing error from a broken machine by the status alone.

use std::fmt;

/// Bad usage or unreadable input: exit status 2.
#[derive(Debug)]
pub struct Usage(pub String);

/// Nothing to show it on, no display or no adapter: exit status 3.
#[derive(Debug)]
pub struct NoScreen(pub String);

impl fmt::Display for Usage {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl fmt::Display for NoScreen {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl std::error::Error for Usage {}
impl std::error::Error for NoScreen {}

/// `Usage` as an `anyhow::Error`.
pub fn usage(message: impl Into<String>) -> anyhow::Error {
    Usage(message.into()).into()
}

/// Exit status of an error: 1 the work failed, 2 bad usage or unreadable input, 3 nothing to show it on.
pub fn exit_status(error: &anyhow::Error) -> u8 {
    for cause in error.chain() {
        if cause.is::<NoScreen>() || matches!(cause.downcast_ref(), Some(render::Error::NoAdapter { .. })) {
            return 3;
        }
        if matches!(cause.downcast_ref(), Some(stream::Error::Input(_)))
            || cause.downcast_ref().is_some_and(world::Error::is_usage)
        {
            return 2;
        }
        if cause.is::<Usage>() || cause.is::<codec::Error>() || cause.is::<scene::Error>() || cause.is::<param::Error>()
        {
            return 2;
        }
    }
    1
}

#[cfg(test)]
mod tests {
    use anyhow::Context as _;

    use super::*;

    #[test]
    fn the_status_is_found_under_added_context() {
        let broken = std::io::Error::other("disk full");
        assert_eq!(exit_status(&anyhow::Error::from(broken).context("a.png")), 1);
        assert_eq!(exit_status(&usage("no such file").context("a.laz")), 2);
        let unknown = scene::Settings::default().set_text("splat.sise", "1");
        assert_eq!(exit_status(&unknown.context("--set").unwrap_err()), 2);
        assert_eq!(exit_status(&NoScreen("no display".into()).into()), 3);
    }
}
