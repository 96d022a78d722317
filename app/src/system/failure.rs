//! Maps errors to exit statuses for scripts: each failure has the same status in every command. docs/errors.md lists
//! them.

use std::fmt;

/// The usage is bad or an input cannot be read; the exit status is 2.
#[derive(Debug)]
pub struct Usage(pub String);

/// There is no display or no adapter to show a picture with; the exit status is 3.
#[derive(Debug)]
pub struct NoScreen(pub String);

/// The user pressed Ctrl-C, or a signal has asked the program to end; the exit status is `interrupt::status`.
#[derive(Debug)]
pub struct Interrupted;

/// The exit statuses of failures; success is 0.
pub const FAILED: u8 = 1;
pub const UNUSABLE: u8 = 2;
pub const NO_SCREEN: u8 = 3;
/// 128 plus the number of the signal (SIGINT is 2), as shells report it.
pub const INTERRUPTED: u8 = 130;

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

impl fmt::Display for Interrupted {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("interrupted")
    }
}

impl std::error::Error for Usage {}
impl std::error::Error for NoScreen {}
impl std::error::Error for Interrupted {}

/// Makes a `Usage` error.
pub fn usage(message: impl Into<String>) -> anyhow::Error {
    Usage(message.into()).into()
}

/// Returns the message for the user. An interruption has the same message wherever it was noticed.
pub fn message(error: &anyhow::Error) -> String {
    if exit_status(error) == INTERRUPTED { Interrupted.to_string() } else { format!("{error:#}") }
}

/// Returns the exit status of an error: 1 if the work failed, 2 for bad usage or unreadable input, 3 without a display
/// or an adapter, 130 after Ctrl-C.
pub fn exit_status(error: &anyhow::Error) -> u8 {
    error.chain().find_map(status_of).unwrap_or(FAILED)
}

/// Returns the exit status that a cause implies, or `None` if it implies none.
fn status_of(cause: &(dyn std::error::Error + 'static)) -> Option<u8> {
    if cause.is::<Interrupted>() {
        return Some(INTERRUPTED);
    }
    if cause.is::<NoScreen>() {
        return Some(NO_SCREEN);
    }
    if let Some(error) = cause.downcast_ref::<record::Error>() {
        // Films of which no encoder makes any are refused beforehand, as bad usage.
        let has_failed =
            matches!(error, record::Error::Io(_) | record::Error::Encoder { .. } | record::Error::Ffmpeg { .. });
        return Some(if has_failed { FAILED } else { UNUSABLE });
    }
    if cause.is::<Usage>() || cause.is::<scene::Error>() || cause.is::<param::Error>() || cause.is::<study::PlanError>()
    {
        return Some(UNUSABLE);
    }
    if let Some(error) = cause.downcast_ref::<world::Error>() {
        return Some(match error {
            world::Error::File(error) => of_file(error),
            world::Error::Pages(error) => of_pages(error),
            error if error.is_usage() => UNUSABLE,
            _ => FAILED,
        });
    }
    if let Some(error) = cause.downcast_ref::<study::SightlineError>() {
        return match error {
            study::SightlineError::Cancelled => Some(INTERRUPTED),
            // What caused it follows in the chain.
            study::SightlineError::Render(_) => None,
            _ => Some(UNUSABLE),
        };
    }
    if let Some(error) = cause.downcast_ref::<study::FolderError>() {
        return Some(of_study(error));
    }
    if let Some(error) = cause.downcast_ref::<render::Error>() {
        return matches!(error, render::Error::NoAdapter { .. }).then_some(NO_SCREEN);
    }
    let pages = cause.downcast_ref().map(of_pages);
    pages.or_else(|| cause.downcast_ref().map(of_file))
}

fn of_file(error: &codec::Error) -> u8 {
    match error {
        codec::Error::NotWritten { .. } => FAILED,
        _ => UNUSABLE,
    }
}

fn of_pages(error: &stream::Error) -> u8 {
    match error {
        stream::Error::Cancelled => INTERRUPTED,
        stream::Error::Input(error) => of_file(error),
        // The inputs hold no points, or another program is writing them.
        stream::Error::Empty { .. } | stream::Error::Changed { .. } => UNUSABLE,
        _ => FAILED,
    }
}

fn of_study(error: &study::FolderError) -> u8 {
    match error {
        study::FolderError::Unwritten(_) => FAILED,
        // The user can avoid the other errors by naming another folder or another plan.
        _ => UNUSABLE,
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

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

    #[test]
    fn outputs_that_cannot_be_written_are_no_fault_of_the_input() {
        let full = || std::io::Error::from(std::io::ErrorKind::StorageFull);
        let unwritten = || codec::Error::not_written(Path::new("a.laz"), full());
        assert_eq!(exit_status(&unwritten().into()), 1);
        assert_eq!(exit_status(&stream::Error::Input(unwritten()).into()), 1);
        assert_eq!(exit_status(&world::Error::File(unwritten()).into()), 1);
        assert_eq!(exit_status(&study::FolderError::Unwritten(unwritten()).into()), 1);
        assert_eq!(exit_status(&codec::Error::io(Path::new("a.laz"), full()).into()), 2);
        let cancelled = anyhow::Error::from(stream::Error::Cancelled).context("a.laz");
        assert_eq!((exit_status(&cancelled), message(&cancelled).as_str()), (130, "interrupted"));
    }
}
