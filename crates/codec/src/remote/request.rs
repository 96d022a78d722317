//! Asks servers for parts of files. A server may be slow, cut connections, lie about ranges, send without end or send
//! elsewhere: every answer is checked against what was asked for, and no more is read than that.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read as _};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use ureq::config::Config;
use ureq::http::{HeaderMap, Response, Uri};
use ureq::tls::{RootCerts, TlsConfig};
use ureq::unversioned::resolver::{DefaultResolver, ResolvedSocketAddrs, Resolver};
use ureq::unversioned::transport::{DefaultConnector, NextTimeout};
use ureq::{Agent, Body};

use super::certificates::authorities;
use super::network::network;
use crate::address::Address;

/// The kind of errors where a server has no answer now, and may have one later.
pub const NO_ANSWER: io::ErrorKind = io::ErrorKind::HostUnreachable;

/// What is said of a file that is no longer the one that was opened.
pub const CHANGED: &str = "the file on the server has changed since it was opened; open it again";
/// What is said of a file whose fetch was stopped.
pub const STOPPED: &str = "stopped while it was fetched";
/// The number of addresses that one request may be sent on to.
const MOST_REDIRECTS: usize = 5;
/// The rate in bytes a second that an answer needs at least, in each span of `MOST_PATIENCE`.
const LEAST_RATE: u64 = 64;
/// In times of `Network::silence`: the spans in which the rate of an answer is judged, and how long a request waits at most in
/// all where a server asks to wait, half of it at a time.
const MOST_PATIENCE: u32 = 3;
/// How often a server that is silent is asked for a part, and how long it is left alone after that: many parts are asked
/// for, and each would wait anew.
const MOST_SILENCES: usize = 2;
const LEFT_ALONE: Duration = Duration::from_secs(15);
/// How long a file is left alone for which a server, asked again and again, had no answer, and how many such files in a
/// row it takes until the whole server is: one file of a server that is well may be what it fails at. Views ask again for
/// what they lack, so it is shorter than the time between their later tries.
const FILE_LEFT_ALONE: Duration = Duration::from_secs(5);
const MOST_FILES: usize = 3;
/// The longest wait in seconds that a server is believed to ask for: a day.
const MOST_ASKED: u64 = 24 * 60 * 60;
/// How often it is looked during a wait whether to go on.
const LOOK: Duration = Duration::from_millis(100);
/// The most bytes of an answer's head.
const MOST_HEAD: usize = 32 << 10;

/// What makes a file of a server the one that it was: its length and its ETag, or the time of its last change.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    pub length: u64,
    pub etag: String,
    pub modified: String,
}

impl Stamp {
    /// Whether another file of that server would have another stamp.
    pub fn is_sure(&self) -> bool {
        !(self.etag.is_empty() && self.modified.is_empty())
    }
}

/// An answer whose head was checked.
pub struct Answer {
    pub stamp: Stamp,
    /// The ETag if it is a weak one. The same one does not tell that all bytes are the same, but another one that they are not.
    pub weak: String,
    /// The bytes of the file that follow; all of them if the server does not give parts.
    pub range: Range<u64>,
    /// What the parts that a document there names lie beside.
    pub base: Address,
    body: Body,
}

/// What a first request brings.
pub enum First {
    Answer(Answer),
    /// The file is as it was; what its parts lie beside.
    Unchanged(Address),
}

/// Why a request has failed: again may help, or not.
pub enum Failure {
    /// An answer was cut.
    Again(String),
    /// The server has no answer, or there is no way to it.
    Unable(String),
    /// After this time, as the server says.
    Later(Duration, String),
    /// Nothing has come for a long time.
    Silent,
    Final(String),
}

impl Answer {
    /// Passes the bytes to `give`, which gets the offset of each piece in the file.
    ///
    /// # Errors
    /// If the answer is shorter or longer than it said, or `give` fails.
    pub fn read(mut self, give: &mut dyn FnMut(u64, &[u8]) -> io::Result<()>) -> Result<(), Failure> {
        let mut reader = self.body.as_reader();
        let mut piece = vec![0; 64 << 10];
        let mut at = self.range.start;
        let (mut since, mut from) = (Instant::now(), at);
        while at < self.range.end {
            let wanted = piece.len().min((self.range.end - at) as usize);
            match reader.read(&mut piece[..wanted]) {
                Ok(0) => {
                    let missing = self.range.end - at;
                    return Err(Failure::Again(format!("the answer was cut, {missing} bytes before its end")));
                }
                Ok(count) => {
                    give(at, &piece[..count]).map_err(|error| Failure::Final(error.to_string()))?;
                    at += count as u64;
                    let span = since.elapsed();
                    if span >= network().silence * MOST_PATIENCE {
                        if at < self.range.end && at - from < LEAST_RATE * span.as_secs() {
                            return Err(Failure::Silent);
                        }
                        (since, from) = (Instant::now(), at);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(of_reading(&error)),
            }
        }
        match reader.read(&mut piece[..1]) {
            Ok(1..) => Err(Failure::Final("the server sends more than it said".into())),
            _ => Ok(()),
        }
    }
}

/// Asks for a file for the first time: for its first bytes, or for all of them. `known` is the stamp of what the cache has.
/// During waits `goes_on` says, several times a second, whether to wait on.
///
/// # Errors
/// Says why there is no answer that can be used.
pub fn first(
    address: &Address,
    most: Option<u64>,
    known: Option<&Stamp>,
    goes_on: &dyn Fn() -> bool,
) -> io::Result<First> {
    repeated(address, goes_on, || {
        let mut headers: Vec<(&str, String)> = Vec::new();
        headers.extend(most.map(|most| ("range", format!("bytes=0-{}", most.max(1) - 1))));
        if let Some(known) = known {
            match known.etag.is_empty() {
                false => headers.push(("if-none-match", known.etag.clone())),
                true => headers.push(("if-modified-since", known.modified.clone())),
            }
        }
        let (base, answer) = sent(address, &headers)?;
        match answer.status().as_u16() {
            304 if known.is_some() => Ok(First::Unchanged(base)),
            416 => {
                let headers = answer.headers();
                let (stamp, weak) = (stamp(headers, 0), weak(headers));
                Ok(First::Answer(Answer { stamp, weak, range: 0..0, base, body: answer.into_body() }))
            }
            _ => checked(base, answer, most.map(|most| 0..most), None).map(First::Answer),
        }
    })
}

/// Asks for a part of a file, whose bytes `give` gets. `weak` is the weak ETag of earlier answers, if they had one. An answer
/// that brings the whole file instead goes to `take_whole`. During waits `goes_on` says whether to wait on.
///
/// # Errors
/// Says why it cannot be had; if the file has changed.
pub fn part(
    address: &Address,
    range: Range<u64>,
    stamp: &Stamp,
    weak: &OnceLock<String>,
    give: &mut dyn FnMut(u64, &[u8]) -> io::Result<()>,
    take_whole: &mut dyn FnMut(Answer) -> Result<(), Failure>,
    goes_on: &dyn Fn() -> bool,
) -> io::Result<()> {
    let mut from = range.start;
    repeated(address, goes_on, || {
        // What came before an answer was cut is there.
        let wanted = from..range.end;
        if wanted.is_empty() {
            return Ok(());
        }
        let headers = [("range", format!("bytes={}-{}", wanted.start, wanted.end - 1))];
        let (base, answer) = sent(address, &headers)?;
        let answer = checked(base, answer, Some(wanted.clone()), Some(stamp))?;
        if !answer.weak.is_empty() && *weak.get_or_init(|| answer.weak.clone()) != answer.weak {
            return Err(Failure::Final(CHANGED.into()));
        }
        if answer.range != wanted {
            return take_whole(answer);
        }
        answer.read(&mut |at, bytes| {
            from = at + bytes.len() as u64;
            give(at, bytes)
        })
    })
}

/// When a server and its files may be asked again.
#[derive(Default)]
struct Rests {
    /// Until when nothing of it is asked for, and what is said meanwhile, if nobody waits for it.
    whole: Option<(Instant, Option<String>)>,
    /// The same of files for which it had no answer.
    files: BTreeMap<String, (Instant, String)>,
    /// Those of them since it last had an answer, up to [`MOST_FILES`], and when that was.
    failing: BTreeSet<String>,
    answered: Option<Instant>,
}

impl Rests {
    /// Takes note that the server is well.
    fn has_answered(&mut self) {
        self.failing.clear();
        self.answered = Some(Instant::now());
    }

    /// Until when a file is not asked for, and what is said meanwhile.
    fn of(&self, file: &str) -> Option<(Instant, Option<String>)> {
        let own = self.files.get(file).map(|(until, told)| (*until, Some(told.clone())));
        self.whole.clone().into_iter().chain(own).find(|(until, _)| Instant::now() < *until)
    }

    /// Leaves a file alone for which the server has had no answer since `began`, and the server if it was so with several.
    fn leave_alone(&mut self, file: String, began: Instant, told: String) {
        let now = Instant::now();
        self.files.retain(|_, (until, _)| now < *until);
        // One that is busy may still answer others, and several parts of a file may be asked for at once.
        if self.answered.is_some_and(|answered| answered > began) || self.files.contains_key(&file) {
            return;
        }
        let until = now + FILE_LEFT_ALONE;
        if self.failing.len() < MOST_FILES {
            self.failing.insert(file.clone());
        }
        self.files.insert(file, (until, told.clone()));
        if self.failing.len() >= MOST_FILES && self.whole.as_ref().is_none_or(|(known, _)| *known < until) {
            self.whole = Some((until, Some(told)));
        }
    }
}

/// Tries again, each time after a longer wait, what may only have failed for a moment. Errors are of the kind
/// [`NO_ANSWER`] where the server may have an answer later.
fn repeated<T>(
    address: &Address,
    goes_on: &dyn Fn() -> bool,
    mut work: impl FnMut() -> Result<T, Failure>,
) -> io::Result<T> {
    static SERVERS: Mutex<BTreeMap<String, Arc<Mutex<Rests>>>> = Mutex::new(BTreeMap::new());
    let mut servers = SERVERS.lock().unwrap_or_else(PoisonError::into_inner);
    let server = servers.entry(address.authority.clone()).or_default().clone();
    drop(servers);
    let rests = || server.lock().unwrap_or_else(PoisonError::into_inner);
    let file = address.text();
    let later = |problem: &str| format!("{problem}, and is not asked yet");
    let left_alone = |problem: &str| rests().whole = Some((Instant::now() + LEFT_ALONE, Some(later(problem))));
    let passing = |problem: String| match problem == STOPPED {
        true => io::Error::other(problem),
        false => io::Error::new(NO_ANSWER, problem),
    };
    let first_began = Instant::now();
    let mut waits = network().waits.iter();
    let mut again = |problem: String| match waits.next() {
        Some(millis) => wait(Instant::now() + Duration::from_millis(*millis), goes_on),
        None => Err(format!("{problem} (tried {})", times(network().waits.len() + 1))),
    };
    let (mut silences, mut silent, mut waiting) = (0, Duration::ZERO, Duration::ZERO);
    loop {
        let rest = rests().of(&file);
        match rest {
            Some((_, Some(problem))) => return Err(passing(problem)),
            Some((until, None)) => {
                wait(until, goes_on).map_err(passing)?;
                // Others may have been told more meanwhile.
                continue;
            }
            None => {}
        }
        let began = Instant::now();
        match work() {
            Ok(done) => {
                let mut rests = rests();
                rests.whole.take_if(|(_, told)| told.is_some());
                rests.files.remove(&file);
                rests.has_answered();
                return Ok(done);
            }
            Err(Failure::Final(problem)) => {
                rests().has_answered();
                return Err(io::Error::other(problem));
            }
            Err(Failure::Again(problem)) => again(problem).map_err(passing)?,
            Err(Failure::Unable(problem)) => again(problem).map_err(|told| {
                if told != STOPPED {
                    rests().leave_alone(file.clone(), first_began, later(&told));
                }
                passing(told)
            })?,
            Err(Failure::Later(time, problem)) => {
                let problem = format!("{problem} and asks to wait for {} s", time.as_secs());
                waiting = waiting.saturating_add(time);
                let patience = network().silence * MOST_PATIENCE;
                if time > patience / 2 || waiting > patience {
                    left_alone(&problem);
                    return Err(passing(problem));
                }
                // So do all others that ask it.
                let now = Instant::now();
                let mut rests = rests();
                let known = rests.whole.get_or_insert((now, None));
                if known.0 <= now || (known.1.is_none() && known.0 < now + time) {
                    *known = (now + time, None);
                }
            }
            Err(Failure::Silent) => {
                silences += 1;
                silent += began.elapsed();
                if silences == MOST_SILENCES {
                    left_alone("the server was silent a moment ago");
                    let (count, seconds) = (times(silences), silent.as_secs());
                    let told = format!("the server is silent, or too slow (waited {count}, {seconds} s in all)");
                    return Err(passing(told));
                }
            }
        }
    }
}

/// Waits while `goes_on` says so.
fn wait(until: Instant, goes_on: &dyn Fn() -> bool) -> Result<(), String> {
    loop {
        if !goes_on() {
            return Err(STOPPED.into());
        }
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(());
        }
        std::thread::sleep(left.min(LOOK));
    }
}

/// How often something was done.
fn times(count: usize) -> String {
    if count == 1 { "once".into() } else { format!("{count} times") }
}

/// Sends a request and follows where it is sent on to. Returns what the parts of a document there lie beside, too: the
/// address itself, or another one as long as the server sends on from folder to folder. Where it sends on to other names or
/// with keys, as stores do with each file by itself, the parts are found where they are named.
fn sent(address: &Address, headers: &[(&str, String)]) -> Result<(Address, Response<Body>), Failure> {
    let (mut address, mut base) = (address.clone(), address.clone());
    for _ in 0..=MOST_REDIRECTS {
        let (agent, problem) = agent();
        if let Some(problem) = problem.filter(|_| address.is_secure) {
            return Err(Failure::Final(problem.to_owned()));
        }
        let mut request = agent.get(address.text());
        for (name, value) in headers {
            request = request.header(*name, value);
        }
        if let Some(authorization) = network().authorization_for(&address) {
            request = request.header("authorization", authorization);
        }
        let answer = request.call().map_err(|error| failure(&error))?;
        let status = answer.status().as_u16();
        match status {
            301 | 302 | 303 | 307 | 308 => {
                let target = text(answer.headers(), "location");
                let next = address.sent_on(&target).map_err(|problem| {
                    let target = crate::brief::brief(&target);
                    Failure::Final(format!("the server sends on to `{target}`: {problem}"))
                })?;
                if address.is_secure && !next.is_secure {
                    return Err(Failure::Final("the server sends on from https to http, which is not followed".into()));
                }
                if base == address && address.is_moved_to(&next) {
                    base = next.clone();
                }
                address = next;
            }
            200 | 206 | 304 | 416 => return Ok((base, answer)),
            401 | 403 => {
                let problem =
                    "the server asks for credentials, or does not accept them; GLINT_AUTHORIZATION or --authorization";
                return Err(Failure::Final(format!("{problem} gives them (status {status})")));
            }
            404 | 410 => return Err(Failure::Final(format!("no such file on the server (status {status})"))),
            408 | 425 | 429 | 500 | 502 | 503 | 504 => {
                let problem = format!("the server is not able to answer now (status {status})");
                let time = text(answer.headers(), "retry-after").parse().ok().filter(|seconds| *seconds > 0);
                return Err(match time {
                    Some(seconds) => Failure::Later(Duration::from_secs(MOST_ASKED.min(seconds)), problem),
                    None => Failure::Unable(problem),
                });
            }
            _ => return Err(Failure::Final(format!("the server answers with status {status}"))),
        }
    }
    Err(Failure::Final(format!("the server sends on more than {MOST_REDIRECTS} times")))
}

/// Checks the head of an answer against what was asked for: a `wanted` part, of the file with this stamp.
fn checked(
    base: Address,
    answer: Response<Body>,
    wanted: Option<Range<u64>>,
    known: Option<&Stamp>,
) -> Result<Answer, Failure> {
    let headers = answer.headers();
    let encoding = text(headers, "content-encoding");
    if !matches!(encoding.to_ascii_lowercase().as_str(), "" | "identity") {
        let encoding = crate::brief::brief(&encoding);
        return Err(Failure::Final(format!("the answer is compressed (`{encoding}`), which was not asked for")));
    }
    let length = text(headers, "content-length").parse::<u64>().ok();
    let (range, total) = match (answer.status().as_u16(), &wanted) {
        (206, Some(wanted)) => {
            let told = text(headers, "content-range");
            let wrong =
                || Failure::Final(format!("a wrong part: `{}` for bytes {wanted:?}", crate::brief::brief(&told)));
            let (range, total) = content_range(&told).ok_or_else(wrong)?;
            let end = wanted.end.min(total);
            if range.start != wanted.start || range.end != end {
                return Err(wrong());
            }
            if let Some(length) = length.filter(|length| *length != end - range.start) {
                let told = crate::brief::brief(&told);
                return Err(Failure::Final(format!("the server sends {length} bytes as the part `{told}`")));
            }
            (range, total)
        }
        (200, _) => {
            let length = length.ok_or_else(|| Failure::Final("the server does not say how long the file is".into()))?;
            (0..length, length)
        }
        // A part of the file that was there would lie behind its end.
        (416, _) if known.is_some() => return Err(Failure::Final(CHANGED.into())),
        (status, _) => return Err(Failure::Final(format!("the server answers with status {status}"))),
    };
    let (stamp, weak) = (stamp(headers, total), weak(headers));
    if known.is_some_and(|known| *known != stamp) {
        return Err(Failure::Final(CHANGED.into()));
    }
    Ok(Answer { stamp, weak, range, base, body: answer.into_body() })
}

/// The part that an answer says it is, and the length of the whole.
fn content_range(text: &str) -> Option<(Range<u64>, u64)> {
    let (range, total) = text.strip_prefix("bytes")?.trim_start().split_once('/')?;
    let (start, last) = range.split_once('-')?;
    let [start, last, total] = [start, last, total].map(|number| number.trim().parse::<u64>().ok());
    let (start, last, total) = (start?, last?, total?);
    (start <= last && last < total).then(|| (start..last + 1, total))
}

fn stamp(headers: &HeaderMap, length: u64) -> Stamp {
    let etag = Some(text(headers, "etag")).filter(|etag| !is_weak(etag)).unwrap_or_default();
    Stamp { length, etag, modified: text(headers, "last-modified") }
}

fn weak(headers: &HeaderMap) -> String {
    Some(text(headers, "etag")).filter(|etag| is_weak(etag)).unwrap_or_default()
}

fn is_weak(etag: &str) -> bool {
    etag.starts_with("W/")
}

fn text(headers: &HeaderMap, name: &str) -> String {
    let value = headers.get(name).and_then(|value| value.to_str().ok()).unwrap_or_default();
    value.chars().filter(|c| !c.is_control()).take(2048).collect()
}

fn failure(error: &ureq::Error) -> Failure {
    match error {
        ureq::Error::HostNotFound => Failure::Unable("no such server, or no connection to the network".into()),
        ureq::Error::Io(error) if error.kind() == io::ErrorKind::PermissionDenied => Failure::Final(error.to_string()),
        ureq::Error::Io(error) => match of_reading(error) {
            Failure::Again(problem) => Failure::Unable(problem),
            failure => failure,
        },
        ureq::Error::Timeout(_) => Failure::Silent,
        ureq::Error::ConnectionFailed => Failure::Unable("no connection to the server".into()),
        ureq::Error::BadUri(_) | ureq::Error::Http(_) => Failure::Final("not an address".into()),
        error => Failure::Final(insecure(&error.to_string()).unwrap_or_else(|| crate::brief::message(error))),
    }
}

/// Why there is no connection by https that can be trusted, in plain words, if that is what an error says.
fn insecure(problem: &str) -> Option<String> {
    let wrong = problem.split_once("invalid peer certificate: ").map(|(_, wrong)| wrong);
    Some(match wrong {
        Some(wrong) if wrong.starts_with("UnknownIssuer") => {
            "glint does not know who has issued the server's certificate: it \
            knows the authorities that Mozilla's browser knows, or those of a file in PEM that SSL_CERT_FILE names"
                .into()
        }
        Some(wrong) => format!("the server's certificate is not valid: {}", crate::brief::brief(wrong)),
        None if problem.contains("InvalidContentType") => {
            "the server does not speak https at this port; an address with http:// may be meant".into()
        }
        None => return None,
    })
}

/// Why reading has failed.
fn of_reading(error: &io::Error) -> Failure {
    if let Some(ureq::Error::Timeout(_)) = error.get_ref().and_then(|inner| inner.downcast_ref::<ureq::Error>()) {
        return Failure::Silent;
    }
    if let Some(problem) = insecure(&error.to_string()) {
        return Failure::Final(problem);
    }
    Failure::Again(match error.kind() {
        io::ErrorKind::ConnectionRefused => "no server answers there".into(),
        io::ErrorKind::ConnectionReset | io::ErrorKind::ConnectionAborted | io::ErrorKind::UnexpectedEof => {
            "the connection was cut".into()
        }
        io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock => return Failure::Silent,
        io::ErrorKind::NetworkUnreachable | io::ErrorKind::HostUnreachable => "no connection to the network".into(),
        _ => crate::brief::message(error),
    })
}

/// The connections of this process; the first request makes them.
/// What is wrong with the authorities that a person names, which matters for https alone, comes with them.
fn agent() -> (&'static Agent, Option<&'static str>) {
    static AGENT: OnceLock<(Agent, Option<String>)> = OnceLock::new();
    let (agent, problem) = AGENT.get_or_init(|| {
        let (roots, problem) = match authorities() {
            Ok(roots) => (roots.unwrap_or(RootCerts::WebPki), None),
            Err(problem) => (RootCerts::WebPki, Some(problem)),
        };
        let config = Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .max_redirects_will_error(false)
            .user_agent(concat!("glint/", env!("CARGO_PKG_VERSION")))
            .accept_encoding("identity")
            .max_response_header_size(MOST_HEAD)
            .max_idle_connections_per_host(8)
            .timeout_resolve(Some(network().silence))
            .timeout_connect(Some(network().silence))
            .timeout_recv_response(Some(network().silence))
            .timeout_per_read(Some(network().silence))
            .tls_config(TlsConfig::builder().root_certs(roots).build())
            .build();
        (Agent::with_parts(config, DefaultConnector::default(), PublicResolver), problem)
    });
    (agent, problem.as_deref())
}

/// Finds the addresses of hosts, without private ones for hosts that no person has typed: a server elsewhere must not be
/// able to reach into the network of the person.
#[derive(Debug)]
struct PublicResolver;

impl Resolver for PublicResolver {
    fn resolve(&self, uri: &Uri, config: &Config, timeout: NextTimeout) -> Result<ResolvedSocketAddrs, ureq::Error> {
        let found = DefaultResolver::default().resolve(uri, config, timeout).map_err(|error| match error {
            ureq::Error::Io(_) => ureq::Error::HostNotFound,
            error => error,
        })?;
        let authority = uri.authority().map(|authority| authority.as_str().to_ascii_lowercase()).unwrap_or_default();
        let is_proxy = config.proxy().is_some_and(|proxy| Some(proxy.host()) == uri.host());
        if is_proxy || network().is_typed(&authority) {
            return Ok(found);
        }
        let mut public = self.empty();
        found.iter().filter(|address| !is_private(address)).for_each(|address| public.push(*address));
        if public.is_empty() {
            let problem = "a server in a private network, which is only asked where a person has typed its address: as an \
                           argument, in GLINT_SERVERS, or in the window, where \"Try again\" does, too";
            return Err(ureq::Error::Io(io::Error::new(io::ErrorKind::PermissionDenied, problem)));
        }
        Ok(public)
    }
}

/// Whether a server is on this machine or in a network of its own.
fn is_private(address: &SocketAddr) -> bool {
    let of_four = |ip: Ipv4Addr| {
        let [a, b, ..] = ip.octets();
        ip.is_private()
            || ip.is_loopback()
            || ip.is_link_local()
            || ip.is_unspecified()
            || ip.is_broadcast()
            || ip.is_multicast()
            || a == 0
            || (a == 100 && (64..128).contains(&b))
    };
    match address.ip() {
        IpAddr::V4(ip) => of_four(ip),
        IpAddr::V6(ip) => {
            let embedded = ip.to_ipv4_mapped().or_else(|| {
                // 64:ff9b::/96 leads to IPv4.
                let [first, second, third, fourth, fifth, sixth, high, low] = ip.segments();
                let is_translated = [first, second, third, fourth, fifth, sixth] == [0x64, 0xff9b, 0, 0, 0, 0];
                is_translated.then(|| Ipv4Addr::from((u32::from(high) << 16) | u32::from(low)))
            });
            embedded.is_some_and(of_four) || is_private_six(ip)
        }
    }
}

fn is_private_six(ip: Ipv6Addr) -> bool {
    ip.is_loopback() || ip.is_unspecified() || ip.is_multicast() || ip.is_unique_local() || ip.is_unicast_link_local()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn private_servers_are_told_from_public_ones() {
        let is = |text: &str| is_private(&SocketAddr::new(text.parse().unwrap(), 80));
        for text in [
            "127.0.0.1",
            "10.1.2.3",
            "192.168.0.1",
            "172.16.0.1",
            "169.254.169.254",
            "0.0.0.0",
            "100.64.0.1",
            "::1",
            "fd00::1",
            "fe80::1",
            "::ffff:10.0.0.1",
            "64:ff9b::7f00:1",
        ] {
            assert!(is(text), "{text}");
        }
        for text in ["1.1.1.1", "172.32.0.1", "100.128.0.1", "2606:4700::1111", "::ffff:1.1.1.1"] {
            assert!(!is(text), "{text}");
        }
    }

    #[test]
    fn a_certificate_that_is_not_trusted_ends_the_tries_in_plain_words() {
        let told = |problem: &str| match of_reading(&io::Error::new(io::ErrorKind::InvalidData, problem)) {
            Failure::Final(told) => told,
            _ => String::new(),
        };
        assert!(told("invalid peer certificate: UnknownIssuer").contains("does not know who has issued"));
        assert!(told("invalid peer certificate: Expired").ends_with("not valid: Expired"));
        assert!(told("received corrupt message of type InvalidContentType").contains("http:// may be meant"));
        assert_eq!(told("received corrupt message of type Other"), "");
    }

    #[test]
    fn one_try_is_told_as_one() {
        assert_eq!([1, 2, 5].map(times), ["once", "2 times", "5 times"]);
    }

    #[test]
    fn parts_are_what_they_say() {
        assert_eq!(content_range("bytes 0-99/1000"), Some((0..100, 1000)));
        for text in ["bytes 0-99/*", "bytes */1000", "bytes 99-0/1000", "bytes 0-1000/1000", "items 0-99/1000", ""] {
            assert_eq!(content_range(text), None, "{text}");
        }
    }
}
