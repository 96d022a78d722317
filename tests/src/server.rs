//! A small server of files for tests: with ranges and ETags, and with habits that servers have. Members that cannot depend
//! on this one take this file in by its path.

use std::io::{BufRead as _, BufReader, Read as _, Seek as _, SeekFrom, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The number of requests that are kept for tests to look at.
const MOST_KEPT: usize = 10_000;

/// What a server is asked.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// The path with its query.
    pub path: String,
    /// Names in lower case, and values.
    pub headers: Vec<(String, String)>,
    /// The number of this request among all, the first being 1.
    pub number: u64,
}

impl Request {
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(own, _)| own == name).map(|(_, value)| value.as_str())
    }

    /// The first and the last byte that are asked for, if the last is named.
    pub fn range(&self) -> Option<(u64, u64)> {
        let (first, last) = self.header("range")?.strip_prefix("bytes=")?.split_once('-')?;
        Some((first.parse().ok()?, last.parse().ok()?))
    }
}

/// How a server of a folder behaves.
#[derive(Clone, Copy, Debug, Default)]
pub struct Habits {
    /// The wait before each answer.
    pub latency: Duration,
    /// The bytes a second that all connections share; 0 for no limit.
    pub rate: u64,
    /// One request in so many fails, half of them in the middle of the answer; 0 for none.
    pub fails: u64,
}

/// A server on this machine, until the process ends.
pub struct Server {
    /// `http://127.0.0.1:PORT`
    pub address: String,
    counts: Arc<Counts>,
}

#[derive(Default)]
struct Counts {
    requests: AtomicU64,
    bytes: AtomicU64,
    /// Added to ETags: another number says that files have changed.
    version: AtomicU64,
    /// The number of requests after which it only answers those for the first bytes of files; 0 for no such number.
    most: AtomicU64,
    asked: Mutex<Vec<Request>>,
    /// When the line is free again.
    busy: Mutex<Option<Instant>>,
}

impl Server {
    /// A server that answers each request by what `answer` writes.
    pub fn new(answer: impl Fn(&Request, &mut TcpStream) -> std::io::Result<()> + Send + Sync + 'static) -> Self {
        Self::with_counts(Arc::default(), answer)
    }

    /// A server of the files in a folder.
    pub fn of_folder(root: &Path, habits: Habits) -> Self {
        Self::of_folder_after(root, habits, |_| {})
    }

    /// A server of the files in a folder, each of whose answers comes when `wait` has ended.
    pub fn of_folder_after(root: &Path, habits: Habits, wait: impl Fn(&Request) + Send + Sync + 'static) -> Self {
        let counts = Arc::new(Counts::default());
        let (root, own) = (root.to_owned(), counts.clone());
        Self::with_counts(counts, move |request, stream| {
            wait(request);
            serve(&root, &habits, &own, request, stream)
        })
    }

    fn with_counts(
        counts: Arc<Counts>,
        answer: impl Fn(&Request, &mut TcpStream) -> std::io::Result<()> + Send + Sync + 'static,
    ) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let address = format!("http://{}", listener.local_addr().expect("its own address"));
        let (answer, own) = (Arc::new(answer), counts.clone());
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let (answer, own) = (answer.clone(), own.clone());
                std::thread::spawn(move || {
                    let Ok(copy) = stream.try_clone() else { return };
                    let (mut reader, mut stream) = (BufReader::new(copy), stream);
                    let _ = stream.set_nodelay(true);
                    while let Some(mut request) = request(&mut reader) {
                        request.number = own.requests.fetch_add(1, Ordering::Relaxed) + 1;
                        let mut asked = own.asked.lock().unwrap_or_else(PoisonError::into_inner);
                        if asked.len() < MOST_KEPT {
                            asked.push(request.clone());
                        }
                        drop(asked);
                        if answer(&request, &mut stream).is_err() {
                            break;
                        }
                    }
                    let _ = stream.shutdown(std::net::Shutdown::Both);
                });
            }
        });
        Self { address, counts }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        format!("{}/{name}", self.address).into()
    }

    /// The number of requests so far.
    pub fn requests(&self) -> u64 {
        self.counts.requests.load(Ordering::Relaxed)
    }

    /// The bytes of files that were sent so far.
    pub fn bytes(&self) -> u64 {
        self.counts.bytes.load(Ordering::Relaxed)
    }

    pub fn asked(&self) -> Vec<Request> {
        self.counts.asked.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// After so many requests of all, it only answers those for the first bytes of files; 0 for no such number.
    pub fn fail_after(&self, requests: u64) {
        self.counts.most.store(requests, Ordering::Relaxed);
    }

    /// From now on all files have other ETags.
    pub fn change(&self) {
        self.counts.version.fetch_add(1, Ordering::Relaxed);
    }
}

fn request(reader: &mut BufReader<TcpStream>) -> Option<Request> {
    let mut line = String::new();
    reader.read_line(&mut line).ok().filter(|count| *count > 0)?;
    let path = line.split(' ').nth(1)?.to_owned();
    let mut headers = Vec::new();
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).ok().filter(|count| *count > 0)?;
        let Some((name, value)) = line.trim().split_once(':') else {
            return Some(Request { path, headers, number: 0 });
        };
        headers.push((name.to_ascii_lowercase(), value.trim().to_owned()));
    }
}

fn serve(
    root: &Path,
    habits: &Habits,
    counts: &Counts,
    request: &Request,
    stream: &mut TcpStream,
) -> std::io::Result<()> {
    std::thread::sleep(habits.latency);
    let fails = habits.fails > 0 && request.number.is_multiple_of(habits.fails);
    let most = counts.most.load(Ordering::Relaxed);
    let is_over = most > 0 && request.number > most && request.range().is_some_and(|(first, _)| first > 0);
    if is_over || (fails && request.number.is_multiple_of(2 * habits.fails)) {
        return write!(stream, "HTTP/1.1 503 Busy\r\ncontent-length: 0\r\n\r\n");
    }
    let path = request.path.split('?').next().unwrap_or_default().trim_start_matches('/');
    let file = std::fs::File::open(root.join(path)).and_then(|file| Ok((file.metadata()?, file)));
    let Some((metadata, mut file)) = file.ok().filter(|(metadata, _)| metadata.is_file()) else {
        return write!(stream, "HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n");
    };
    let length = metadata.len();
    let etag = format!("\"{length:x}-{}\"", counts.version.load(Ordering::Relaxed));
    if request.header("if-none-match") == Some(&etag) {
        return write!(stream, "HTTP/1.1 304 Not Modified\r\netag: {etag}\r\n\r\n");
    }
    let (first, last, head) = match request.range() {
        Some((first, last)) if first < length => {
            let last = last.min(length - 1);
            (first, last, format!("HTTP/1.1 206 Partial Content\r\ncontent-range: bytes {first}-{last}/{length}\r\n"))
        }
        Some(_) => return write!(stream, "HTTP/1.1 416 No Such Range\r\ncontent-length: 0\r\n\r\n"),
        None => (0, length.saturating_sub(1), "HTTP/1.1 200 OK\r\n".to_owned()),
    };
    let count = if length == 0 { 0 } else { last - first + 1 };
    write!(stream, "{head}etag: {etag}\r\ncontent-length: {count}\r\n\r\n")?;
    file.seek(SeekFrom::Start(first))?;
    let mut left = if fails { count / 2 } else { count };
    let mut piece = vec![0; 16 << 10];
    while left > 0 {
        let wanted = piece.len().min(left as usize);
        file.read_exact(&mut piece[..wanted])?;
        if habits.rate > 0 {
            let mut busy = counts.busy.lock().unwrap_or_else(PoisonError::into_inner);
            let start = busy.unwrap_or_else(Instant::now).max(Instant::now());
            let end = start + Duration::from_secs_f64(wanted as f64 / habits.rate as f64);
            *busy = Some(end);
            drop(busy);
            std::thread::sleep(end.saturating_duration_since(Instant::now()));
        }
        // Before they go: who has them may ask for the count at once.
        counts.bytes.fetch_add(wanted as u64, Ordering::Relaxed);
        stream.write_all(&piece[..wanted])?;
        left -= wanted as u64;
    }
    if fails { Err(std::io::Error::other("cut")) } else { Ok(()) }
}
