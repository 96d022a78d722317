//! H.264 in MP4, for slides and old phones, through the program `ffmpeg`.

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::{Error, Result};

/// The quality, 0 (lossless) to 51: at 16 no difference is seen.
const QUALITY: &str = "16";
/// Colours are those of BT.709 in limited range, and sides are even numbers.
const FILTER: &str = "scale=out_color_matrix=bt709:out_range=tv,pad=ceil(iw/2)*2:ceil(ih/2)*2";

/// A film that `ffmpeg` is writing.
pub struct Ffmpeg {
    child: Child,
}

/// Checks that `ffmpeg` makes films of this size and rate: it encodes one picture, of which nothing is kept.
///
/// # Errors
/// It is not on the PATH, or does not encode the picture.
pub fn check(size: [u32; 2], fps: u32) -> Result<()> {
    let mut film = Ffmpeg::start(size, fps, &["-f", "null", "-"].map(OsString::from))?;
    let row = vec![0; size[0] as usize * 3];
    let encoded = (0..size[1]).try_for_each(|_| film.add(&row)).and_then(|()| film.end());
    encoded.map_err(|error| match error {
        Error::Ffmpeg { problem } => {
            let [width, height] = size;
            let what = format!("it makes no H.264 of {width}x{height} pixels at {fps} a second");
            Error::Ffmpeg { problem: format!("{what}: {problem}; leave --codec out for AV1") }
        }
        other => other,
    })
}

fn not_started(error: std::io::Error) -> Error {
    let problem = match error.kind() {
        std::io::ErrorKind::NotFound => {
            "it is not on the PATH, and makes the films of --codec h264; install it, or leave --codec out for AV1"
                .into()
        }
        _ => error.to_string(),
    };
    Error::Ffmpeg { problem }
}

impl Ffmpeg {
    /// Begins a film.
    ///
    /// # Errors
    /// There is no `ffmpeg` on the PATH.
    pub fn new(path: &Path, size: [u32; 2], fps: u32) -> Result<Self> {
        // By itself a name such as `tour:1.mp4` would be an address.
        let mut place = OsString::from("file:");
        place.push(path);
        let file = ["-movflags", "+faststart", "-f", "mp4"].map(OsString::from);
        Self::start(size, fps, &file.into_iter().chain([place]).collect::<Vec<_>>())
    }

    /// Starts `ffmpeg`; `file` says where the film goes.
    fn start([width, height]: [u32; 2], fps: u32, file: &[OsString]) -> Result<Self> {
        let [size, rate] = [format!("{width}x{height}"), fps.to_string()];
        let input = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", &size, "-r", &rate, "-i", "-"];
        let output = ["-vf", FILTER, "-c:v", "libx264", "-crf", QUALITY, "-pix_fmt", "yuv420p", "-colorspace", "bt709"];
        let tags = ["-color_primaries", "bt709", "-color_trc", "bt709"];
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-nostdin", "-y"]).args(input).args(output).args(tags).args(file);
        let started = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
        Ok(Self { child: started.map_err(not_started)? })
    }

    /// Adds a picture: rows of sRGB red, green and blue, the top row first.
    ///
    /// # Errors
    /// `ffmpeg` has ended, with its own words.
    pub fn add(&mut self, rgb: &[u8]) -> Result<()> {
        let written = self.child.stdin.as_mut().map_or(Ok(()), |input| input.write_all(rgb));
        if written.is_err() { Err(self.words()) } else { Ok(()) }
    }

    /// Ends the film.
    ///
    /// # Errors
    /// `ffmpeg` has failed, with its own words.
    pub fn end(mut self) -> Result<()> {
        drop(self.child.stdin.take());
        let is_done = self.child.wait().is_ok_and(|status| status.success());
        if is_done { Ok(()) } else { Err(self.words()) }
    }

    /// What `ffmpeg` said before it ended.
    fn words(&mut self) -> Error {
        let mut said = String::new();
        drop(self.child.stdin.take());
        if let Some(mut output) = self.child.stderr.take() {
            let _ = std::io::Read::read_to_string(&mut output, &mut said);
        }
        // The first line names the cause, and those after it what came of it.
        let first = said.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or("it ended without a word");
        // Before it may stand the part of the program that speaks, with its address in memory.
        let words = first.split_once("] ").filter(|_| first.starts_with('[')).map_or(first, |(_, words)| words);
        Error::Ffmpeg { problem: words.to_owned() }
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        // A film that was not ended is given up.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
