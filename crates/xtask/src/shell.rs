//! Starts other programs: cargo, installers, and what the commands of this one need of the system.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, ExitStatus, Stdio};

use anyhow::{Context as _, Result, bail, ensure};

use crate::needs::{self, Machine, Need, Remedy};

/// Installs what is missing, or says how to. Fails if the user has to act first.
pub fn provide(needs: Vec<Need>) -> Result<()> {
    let machine = Machine::look();
    let missing = machine.missing(needs);
    if missing.is_empty() {
        return Ok(());
    }
    let names = names(&missing);
    let root = succeeds(Command::new("sh").args(["-c", "test $(id -u) -eq 0"]));
    let sudo = !root && machine.has("sudo") && succeeds(Command::new("sudo").args(["-n", "true"]));
    match needs::remedy(&missing, &machine, root, sudo) {
        Remedy::Install(commands) => {
            println!("Missing: {names}. Installing:");
            for words in commands {
                println!("  {}", words.join(" "));
                let status = status(Command::new(&words[0]).args(&words[1..]))?;
                ensure!(status.success(), "`{}` failed ({status}); see its messages above", words.join(" "));
            }
            let missing = Machine::look().missing(missing);
            ensure!(missing.is_empty(), "still missing after the installation: {}", self::names(&missing));
            Ok(())
        }
        Remedy::Tell(line) => bail!("missing: {names}. Type this, then run the command again:\n  {line}"),
        Remedy::Unknown => {
            eprintln!("xtask: not found, and there is no apt-get to install it with: {names}. Going on without.");
            Ok(())
        }
    }
}

fn names(needs: &[Need]) -> String {
    needs.iter().map(|need| need.what).collect::<Vec<_>>().join(", ")
}

/// The cargo that runs this program.
pub fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// The checkout this program was built in.
pub fn root() -> Result<PathBuf> {
    let own = std::env::var_os("CARGO_MANIFEST_DIR").context("start this with `cargo xtask`")?;
    // Not canonical: such a path of Windows begins with a mark behind which `..` and `/` mean nothing.
    Ok(Path::new(&own).ancestors().nth(2).context("this is not in crates/xtask of a checkout")?.to_owned())
}

/// Where cargo puts what it builds.
pub fn target_folder(root: &Path) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), |folder| root.join(folder))
}

pub fn installed(subcommand: &str) -> bool {
    succeeds(cargo().args([subcommand, "--version"]))
}

fn succeeds(command: &mut Command) -> bool {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

pub fn status(command: &mut Command) -> Result<ExitStatus> {
    command.status().with_context(|| format!("{} does not start", command.get_program().display()))
}

/// The exit status of a child as this program's own; a signal counts as failure.
pub fn exit_code(status: ExitStatus) -> ExitCode {
    status.code().and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from)
}
