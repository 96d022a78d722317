//! Where a recording goes: a folder of pictures, and a film of them if the name is one of a film.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use record::{Film, Folder, Format};

use crate::system::failure::usage;
use crate::system::picture_file;
use crate::system::progress_bar::Bar;

/// The encoder of a film, as `--codec`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Codec {
    /// AV1, which browsers and recent phones play; needs nothing else
    #[default]
    Av1,
    /// H.264, for slides and old phones; needs the program ffmpeg
    H264,
}

/// The folder of the pictures of a film.
pub fn folder_of(film: &Path) -> PathBuf {
    film.with_extension("frames")
}

/// The output of a recording.
#[derive(Clone, Debug)]
pub struct Output {
    pub folder: Folder,
    film: Option<(PathBuf, Format)>,
}

impl Output {
    /// The output of this name: a film by its extension, and else a folder. The pictures of `tour.mp4` are in the folder
    /// `tour.frames` beside it.
    ///
    /// # Errors
    /// The film would be of a kind that is not made, or not of this size and rate, or cannot be written where it is to
    /// be.
    pub fn new(name: &Path, codec: Option<Codec>, size: [u32; 2], fps: u32) -> anyhow::Result<Self> {
        let extension = name.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let shown = scene::shown(name);
        let format = match (extension.as_deref(), codec) {
            (Some("mp4"), None | Some(Codec::Av1)) => Some(Format::Av1),
            (Some("mp4"), Some(Codec::H264)) => Some(Format::H264),
            (_, Some(_)) => return Err(usage(format!("{shown}: --codec is for films that end in .mp4"))),
            (Some("gif"), None) => Some(Format::Gif),
            (Some("webm" | "webp" | "mkv" | "mov" | "avi"), None) => {
                return Err(usage(format!("{shown}: films end in .mp4 or .gif; any other name is a folder's")));
            }
            _ => None,
        };
        let Some(format) = format else { return Ok(Self { folder: Folder { path: name.to_owned() }, film: None }) };
        format.check(size, fps).map_err(|error| usage(format!("{shown}: {error}")))?;
        picture_file::check_place(name)?;
        Ok(Self { folder: Folder { path: folder_of(name) }, film: Some((name.to_owned(), format)) })
    }

    /// The name of the film, if there is to be one.
    pub fn film(&self) -> Option<&Path> {
        self.film.as_ref().map(|(path, _)| path.as_path())
    }

    /// Makes the film of these frames, all of which are there. It appears under its name when it is whole.
    ///
    /// # Errors
    /// A picture cannot be read, the encoder fails, the film cannot be written, or `check` fails, which is called
    /// between pictures.
    pub fn encode(
        &self,
        frames: &[u32],
        size: [u32; 2],
        fps: u32,
        check: impl Fn() -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let Some((path, format)) = &self.film else { return Ok(()) };
        let bar = Bar::pictures("encoding");
        picture_file::write_by_name(path, |partial| {
            let unwritten = |error: record::Error| match error {
                record::Error::Io(reason) => codec::Error::not_written(path, reason).into(),
                error => anyhow::Error::from(error).context(scene::shown(path)),
            };
            let mut film = Film::new(*format, partial, size, fps, frames.len()).map_err(unwritten)?;
            for (done, frame) in frames.iter().enumerate() {
                check()?;
                bar.set(done as u64, frames.len() as u64);
                film.add(&self.folder.read(*frame, size)?).map_err(unwritten)?;
            }
            film.end().map_err(unwritten)
        })?;
        bar.end();
        Ok(())
    }
}
