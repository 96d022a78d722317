//! Runs the program and keeps what it wrote. Tests read and write nothing of the user's: each has a home folder of its
//! own.

use std::ffi::OsStr;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tempfile::TempDir;

/// The first dispatch compiles shaders, which takes seconds on software Vulkan, and minutes on a busy machine. A
/// program that needs longer than this hangs.
const TIME_LIMIT: Duration = Duration::from_secs(180);

/// The program: the one that `GLINT_TEST_PROGRAM` names (`cargo xtask test` sets it), else the one that cargo builds for
/// these tests, which it has built already where the whole workspace was tested.
pub(crate) fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| std::env::var_os("GLINT_TEST_PROGRAM").map_or_else(build, PathBuf::from))
}

/// Builds the program with the features that tests of the whole workspace have, so that nothing is compiled twice.
fn build() -> PathBuf {
    let own = std::env::current_exe().expect("the path of this test");
    let release = own.ancestors().nth(2).expect("a test lies in TARGET/release/deps");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args(["test", "--quiet", "--release", "--locked", "--workspace", "--no-run", "--test", "program"]);
    command.arg("--target-dir").arg(release.parent().expect("TARGET"));
    command.current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."));
    assert!(command.status().expect("cargo starts").success(), "the program does not build");
    release.join("glint")
}

/// How a run ended.
pub struct Outcome {
    /// The command line, for messages.
    pub command: String,
    /// Exit status; none when a signal ended it.
    pub status: Option<i32>,
    pub output: Vec<u8>,
    /// Standard error.
    pub messages: String,
    /// The most memory that it held, in bytes. It is sampled, so short peaks may be missed.
    pub peak_memory: u64,
}

impl Outcome {
    /// Parses the output as JSON. If it is not JSON, fails the test with everything that the program wrote.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.output).unwrap_or_else(|error| panic!("{error}, in the output of {self}"))
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.output).into_owned()
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Outcome { command, status, messages, .. } = self;
        write!(formatter, "`{command}`\nstatus: {status:?}\noutput: {}\nmessages: {messages}", self.text())
    }
}

/// Whether a run must be passed over for want of an adapter.
pub fn lacks_adapter(outcome: &Outcome) -> bool {
    let lacks = outcome.status == Some(3) && std::env::var_os("GLINT_REQUIRE_GPU").is_none();
    if lacks {
        println!("skipped: no adapter: {}", outcome.messages.trim());
    }
    lacks
}

/// A folder for one test: the program's working folder and home. It is removed with the value.
pub struct Folder {
    folder: TempDir,
}

impl Folder {
    #[expect(clippy::new_without_default, reason = "it makes a folder on disk")]
    pub fn new() -> Folder {
        let folder = TempDir::with_prefix("glint-test-").expect("a temporary folder");
        // Access for its owner alone, as the specification of XDG_RUNTIME_DIR asks.
        let mut builder = std::fs::DirBuilder::new();
        // What Unix's window systems ask for.
        #[cfg(unix)]
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        builder.create(folder.path().join("runtime")).expect("a folder inside it");
        Folder { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file and returns its path.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.path(name), content).expect("a file in a temporary folder");
        self.path(name)
    }

    /// Runs `glint ARGUMENTS`, without a display.
    pub fn glint<I: IntoIterator<Item: AsRef<OsStr>>>(&self, arguments: I) -> Outcome {
        self.glint_within(TIME_LIMIT, arguments)
    }

    /// Runs `glint ARGUMENTS` without a display, and fails the test if the program runs longer than `limit`.
    pub fn glint_within<I: IntoIterator<Item: AsRef<OsStr>>>(&self, limit: Duration, arguments: I) -> Outcome {
        let mut command = self.command(arguments);
        let words: Vec<_> = command.get_args().map(|word| word.to_string_lossy()).collect();
        let line = format!("glint {}", words.join(" "));
        let mut program = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts");
        let output = read_all(program.stdout.take().expect("piped"));
        let messages = read_all(program.stderr.take().expect("piped"));
        let (status, peak_memory) = watch(&mut program, limit);
        let output = output.join().expect("its output");
        let messages = String::from_utf8_lossy(&messages.join().expect("its messages")).into_owned();
        let Some(status) = status else { panic!("`{line}` still ran after {limit:?} and said: {messages}") };
        Outcome { command: line, status: status.code(), output, messages, peak_memory }
    }

    /// The program in this folder. It sees no display, no desktop services and no files of the user.
    pub fn command<I: IntoIterator<Item: AsRef<OsStr>>>(&self, arguments: I) -> Command {
        let mut command = Command::new(binary());
        command.args(arguments).current_dir(self.folder.path()).stdin(Stdio::null());
        for display in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DBUS_SESSION_BUS_ADDRESS"] {
            command.env_remove(display);
        }
        for home in ["XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME", "GLINT_CACHE_DIR"] {
            command.env_remove(home);
        }
        command.env("HOME", self.folder.path()).env("XDG_RUNTIME_DIR", self.path("runtime"));
        command.envs(shader_cache().map(|folder| ("MESA_SHADER_CACHE_DIR", folder)));
        command
    }
}

/// The folder of shaders that Mesa has compiled, beside the user's other caches. All runs share it: compiling the
/// passes of one picture takes three seconds of a core, which is more than drawing it.
pub fn shader_cache() -> Option<PathBuf> {
    let folder = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    folder("MESA_SHADER_CACHE_DIR")
        .or_else(|| folder("XDG_CACHE_HOME"))
        .or_else(|| folder("HOME").map(|home| home.join(".cache")))
}

fn read_all(mut stream: impl Read + Send + 'static) -> JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        // A stream that breaks has ended: the test judges what was written until then.
        let _ = stream.read_to_end(&mut bytes);
        bytes
    })
}

/// Waits until the program ends, and ends it after `limit`. Returns its status, if it ended by itself, and its peak
/// memory in bytes.
fn watch(program: &mut Child, limit: Duration) -> (Option<std::process::ExitStatus>, u64) {
    let start = Instant::now();
    let mut peak_memory = 0;
    loop {
        peak_memory = peak_memory.max(peak_memory_of(program.id()));
        if let Some(status) = program.try_wait().expect("a child can be waited for") {
            return (Some(status), peak_memory);
        }
        if start.elapsed() > limit {
            program.kill().expect("a child can be ended");
            program.wait().expect("a child can be waited for");
            return (None, peak_memory);
        }
        // Each look at a process takes a part of a millisecond of a processor.
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// `VmHWM` of proc(5), bytes; 0 for a process that has just ended.
fn peak_memory_of(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kibibytes = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    kibibytes.unwrap_or(0) * 1024
}
