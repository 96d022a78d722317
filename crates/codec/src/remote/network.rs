//! How servers are asked in this process, and which of them a person has named.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use crate::address::Address;

/// What fetched files may take on the disk by default.
const LIMIT: u64 = 10 << 30;

/// The waits before a request is made again, in milliseconds.
const WAITS: [u64; 4] = [200, 400, 800, 1600];

/// The time without a byte after which a server is given up.
const SILENCE: Duration = Duration::from_secs(20);

/// Called while a whole file is fetched: its address, bytes so far and bytes in all; and while an opening waits before it asks
/// again, with 0 bytes of 1. The last call says that all are there, even where the fetch has failed. Where a part is waited
/// for, it is called without bytes. Returns whether to go on.
type Watch = Box<dyn Fn(&Path, Option<(u64, u64)>) -> bool + Send + Sync>;

/// How servers are asked. A process has one; without one, nothing is kept.
pub struct Network {
    /// The folder of fetched files.
    pub folder: Option<PathBuf>,
    /// What fetched files may take there, in bytes; a longer file is not fetched as a whole.
    pub limit: u64,
    /// The value of the header `Authorization`, for servers whose address a person has typed.
    pub authorization: Option<String>,
    pub watch: Watch,
    /// The waits before a request that may only have failed for a moment is made again, in milliseconds.
    pub waits: &'static [u64],
    /// The time without a byte after which a server is given up.
    pub silence: Duration,
}

impl Default for Network {
    fn default() -> Self {
        let watch = Box::new(|_: &Path, _| true);
        Self { folder: None, limit: LIMIT, authorization: None, watch, waits: &WAITS, silence: SILENCE }
    }
}

static NETWORK: OnceLock<Network> = OnceLock::new();
/// The origins that a person has typed.
static TYPED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

pub fn network() -> &'static Network {
    NETWORK.get_or_init(Network::default)
}

fn typed() -> MutexGuard<'static, BTreeSet<String>> {
    TYPED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Says how servers are asked in this process. Later calls, and those after the first address was opened, do nothing.
///
/// # Errors
/// If the authorization is no text of one line.
pub fn use_network(network: Network) -> Result<(), String> {
    let is_plain = |value: &String| value.bytes().all(|byte| matches!(byte, b' '..=b'~'));
    if network.authorization.as_ref().is_some_and(|value| !is_plain(value)) {
        return Err("not a line of ASCII characters, such as `Bearer ...` or `Basic ...`".into());
    }
    // A second one is that of a test in the same process.
    let _ = NETWORK.set(network);
    Ok(())
}

/// Says that a person has typed an address: its server may be in a private network, and gets credentials. Returns whether
/// it is one.
pub fn trust_address(path: &Path) -> bool {
    let address = Address::parse(&path.to_string_lossy());
    if let Ok(address) = &address {
        typed().insert(origin(address));
    }
    address.is_ok()
}

fn origin(address: &Address) -> String {
    format!("{}://{}", if address.is_secure { "https" } else { "http" }, address.authority)
}

impl Network {
    pub fn authorization_for(&self, address: &Address) -> Option<&str> {
        self.authorization.as_deref().filter(|_| typed().contains(&origin(address)))
    }

    pub fn is_typed(&self, authority: &str) -> bool {
        let typed = typed();
        ["http", "https"].iter().any(|scheme| typed.contains(&format!("{scheme}://{authority}")))
    }
}
