//! Films: files that play the pictures of a recording.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;

use crate::ffmpeg::{self, Ffmpeg};
use crate::gif::{self, Gif};
use crate::mp4::{self, Mp4};
use crate::{Error, Result};

/// The kind of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// MP4 with AV1, by an encoder of our own.
    Av1,
    /// MP4 with H.264, by `ffmpeg`.
    H264,
    Gif,
}

impl Format {
    /// Checks, before pictures are drawn, that films of this kind, size and rate can be made here.
    ///
    /// # Errors
    /// The encoder refuses them, or the program that makes them is missing or has no such encoder.
    pub fn check(self, size: [u32; 2], fps: u32) -> Result<()> {
        match self {
            Self::Av1 => mp4::check(size, fps),
            Self::H264 => ffmpeg::check(size, fps),
            Self::Gif => gif::check(size, fps).map(drop),
        }
    }
}

/// A film that is being written.
pub enum Film {
    Mp4(Box<Mp4<BufWriter<File>>>),
    Ffmpeg(Ffmpeg),
    Gif(Box<Gif<BufWriter<File>>>),
}

impl Film {
    /// Begins a film of `count` pictures of one size in a file.
    ///
    /// # Errors
    /// The file cannot be written, or the encoder cannot make such a film.
    pub fn new(format: Format, path: &Path, size: [u32; 2], fps: u32, count: usize) -> Result<Self> {
        let file = || File::create(path).map(BufWriter::new).map_err(Error::Io);
        Ok(match format {
            Format::Av1 => Self::Mp4(Box::new(Mp4::new(file()?, size, fps, count)?)),
            Format::H264 => Self::Ffmpeg(Ffmpeg::new(path, size, fps)?),
            Format::Gif => Self::Gif(Box::new(Gif::new(file()?, size, fps)?)),
        })
    }

    /// Adds a picture: rows of sRGB red, green and blue, the top row first.
    ///
    /// # Errors
    /// The encoder fails, or the file cannot be written.
    pub fn add(&mut self, rgb: &[u8]) -> Result<()> {
        match self {
            Self::Mp4(film) => film.add(rgb),
            Self::Ffmpeg(film) => film.add(rgb),
            Self::Gif(film) => film.add(rgb),
        }
    }

    /// Ends the film.
    ///
    /// # Errors
    /// The encoder fails, or the file cannot be written.
    pub fn end(self) -> Result<()> {
        match self {
            Self::Mp4(film) => film.end()?.flush().map_err(Error::Io),
            Self::Ffmpeg(film) => film.end(),
            Self::Gif(film) => film.end(),
        }
    }
}

#[cfg(test)]
mod tests {
    use shiguredo_mp4::boxes::SampleEntry;
    use shiguredo_mp4::demux::{Input, Mp4FileDemuxer};

    use super::*;

    /// Pictures with a bright square that moves.
    fn picture(frame: u32, [width, height]: [u32; 2]) -> Vec<u8> {
        let pixel = |x: u32, y: u32| {
            let is_inside = (x + width - frame) % width < 8 && y < 8;
            if is_inside { [250, 240, 30] } else { [(x * 2) as u8, (y * 3) as u8, 90] }
        };
        (0..height).flat_map(|y| (0..width).flat_map(move |x| pixel(x, y))).collect()
    }

    fn film(format: Format, size: [u32; 2], fps: u32, count: u32) -> Result<Vec<u8>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film");
        let mut film = Film::new(format, &path, size, fps, count as usize)?;
        for frame in 0..count {
            film.add(&picture(frame, size))?;
        }
        film.end()?;
        Ok(std::fs::read(&path).unwrap())
    }

    #[test]
    fn an_mp4_tells_its_pictures_before_it_brings_them() {
        for (size, count) in [([64, 48], 25), ([65, 49], 1)] {
            let file = film(Format::Av1, size, 10, count).unwrap();
            let place = |name: &[u8]| file.windows(4).position(|word| word == name).unwrap();
            assert!(place(b"moov") < place(b"mdat"));
            let mut demuxer = Mp4FileDemuxer::new();
            while let Some(required) = demuxer.required_input() {
                let position = required.position as usize;
                let size = required.size.unwrap_or(file.len() - position);
                demuxer.handle_input(Input { position: required.position, data: &file[position..position + size] });
            }
            let mut keys = Vec::new();
            let mut number = 0;
            while let Some(sample) = demuxer.next_sample().unwrap() {
                assert_eq!((sample.track.timescale.get(), sample.timestamp, sample.duration), (10, number, 1));
                if let Some(SampleEntry::Av01(entry)) = sample.sample_entry {
                    assert_eq!([u32::from(entry.visual.width), u32::from(entry.visual.height)], size);
                }
                if sample.keyframe {
                    keys.push(number);
                }
                number += 1;
            }
            assert_eq!(number, u64::from(count));
            // Players can jump to every second second.
            assert_eq!(keys, if count > 20 { vec![0, 20] } else { vec![0] });
        }
    }

    /// A disk with room for so many bytes.
    struct SmallDisk(u64, std::io::Cursor<Vec<u8>>);

    impl std::io::Write for SmallDisk {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            if self.1.position() + bytes.len() as u64 > self.0 {
                return Err(std::io::ErrorKind::StorageFull.into());
            }
            self.1.write(bytes)
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    impl std::io::Seek for SmallDisk {
        fn seek(&mut self, place: std::io::SeekFrom) -> std::io::Result<u64> {
            self.1.seek(place)
        }
    }

    #[test]
    fn a_disk_that_is_full_is_told_wherever_the_film_meets_its_end() {
        let (size, count) = ([64, 48], 3);
        let film = |room: u64| -> Result<u64> {
            let mut film = Mp4::new(SmallDisk(room, std::io::Cursor::default()), size, 10, count as usize)?;
            for frame in 0..count {
                film.add(&picture(frame, size))?;
            }
            Ok(film.end()?.1.into_inner().len() as u64)
        };
        let whole = film(u64::MAX).unwrap();
        assert_eq!(film(whole).unwrap(), whole);
        for room in [0, 10, whole / 2, whole - 1] {
            let error = film(room).unwrap_err();
            let is_full = matches!(&error, Error::Io(reason) if reason.kind() == std::io::ErrorKind::StorageFull);
            assert!(is_full, "{room} of {whole} bytes: {error}");
        }
    }

    #[test]
    fn the_same_pictures_make_the_same_film() {
        for format in [Format::Av1, Format::Gif] {
            assert!(film(format, [64, 48], 10, 5).unwrap() == film(format, [64, 48], 10, 5).unwrap(), "{format:?}");
        }
    }

    #[test]
    fn a_gif_has_every_picture_and_lasts_as_long_as_they_do() {
        let file = film(Format::Gif, [64, 48], 30, 45).unwrap();
        let mut options = ::gif::DecodeOptions::new();
        options.set_color_output(::gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(file.as_slice()).unwrap();
        assert_eq!((decoder.width(), decoder.height()), (64, 48));
        let (mut count, mut hundredths) = (0, 0);
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            let bright = frame.buffer.chunks(4).filter(|pixel| pixel[0] > 200 && pixel[2] < 80).count();
            assert!((50..=64).contains(&bright), "{bright} of 64 pixels");
            (count, hundredths) = (count + 1, hundredths + u32::from(frame.delay));
        }
        assert_eq!((count, hundredths), (45, 150));
        let refused = film(Format::Gif, [64, 48], 60, 1).unwrap_err().to_string();
        assert!(refused.contains("at most 50 pictures a second"), "{refused}");
    }

    #[test]
    fn what_the_check_lets_pass_is_made_and_what_it_refuses_is_not() {
        for format in [Format::Av1, Format::Gif] {
            for (size, fps) in [([16, 16], 50), ([16, 15], 30), ([15, 16], 30), ([64, 16], 51)] {
                let (checked, made) = (format.check(size, fps), film(format, size, fps, 1));
                let reason = |result: Result<()>| result.err().map(|error| error.to_string());
                assert_eq!(reason(checked), reason(made.map(drop)), "{format:?} {size:?} {fps}");
            }
            assert!(format.check([70_000, 16], 30).is_err(), "{format:?}");
        }
    }
}
