//! What a person asks `Record…` for. It is the command line of `glint record`, which makes the film.

use std::ffi::OsString;

/// A recording that is asked for, as in the fields of the dialog.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// The name of the path.
    pub path: String,
    /// The film or the folder.
    pub output: String,
    pub size: [u32; 2],
    pub fps: u32,
    /// The first frame and the one after the last; all frames if it is empty.
    pub frames: [u32; 2],
    pub is_h264: bool,
    pub subframes: u32,
    pub shutter: f64,
    pub supersample: u32,
    /// Whether the dialog has been drawn, so that its first field has the keyboard.
    pub is_shown: bool,
}

impl Wanted {
    /// The words that follow `glint record SCENE`. `adapter` is the one that draws the window.
    pub fn words(&self, adapter: Option<&str>) -> Vec<OsString> {
        let [width, height] = self.size;
        let mut words: Vec<OsString> = vec![
            "--path".into(),
            self.path.clone().into(),
            "--output".into(),
            self.output.clone().into(),
            "--size".into(),
            format!("{width}x{height}").into(),
            "--fps".into(),
            self.fps.to_string().into(),
        ];
        let mut more = |flag: &str, value: String| words.extend([flag.into(), value.into()]);
        if self.frames[0] < self.frames[1] {
            more("--frames", format!("{}..{}", self.frames[0], self.frames[1]));
        }
        if self.is_h264 && self.output.ends_with(".mp4") {
            more("--codec", "h264".into());
        }
        if self.subframes > 1 {
            more("--subframes", self.subframes.to_string());
            more("--shutter", self.shutter.to_string());
        }
        if self.supersample > 1 {
            more("--supersample", self.supersample.to_string());
        }
        if let Some(adapter) = adapter {
            more("--gpu", adapter.to_owned());
        }
        words
    }
}
