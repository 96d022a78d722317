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

/// Checks that `ffmpeg` can be started.
///
/// # Errors
/// It is not on the PATH, or does not start.
pub fn check() -> Result<()> {
    let mut command = Command::new("ffmpeg");
    command.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().map(drop).map_err(not_started)
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
    pub fn new(path: &Path, [width, height]: [u32; 2], fps: u32) -> Result<Self> {
        let [size, rate] = [format!("{width}x{height}"), fps.to_string()];
        let input = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", &size, "-r", &rate, "-i", "-"];
        let output = ["-vf", FILTER, "-c:v", "libx264", "-crf", QUALITY, "-pix_fmt", "yuv420p", "-colorspace", "bt709"];
        let tags = ["-color_primaries", "bt709", "-color_trc", "bt709", "-movflags", "+faststart", "-f", "mp4"];
        // By itself a name such as `tour:1.mp4` would be an address.
        let mut place = OsString::from("file:");
        place.push(path);
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-nostdin", "-y"]).args(input).args(output).args(tags).arg(place);
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
        let last = said.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or("it ended without a word");
        Error::Ffmpeg { problem: last.to_owned() }
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        // A film that was not ended is given up.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
