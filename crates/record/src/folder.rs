//! The folder of a recording: a PNG file for each frame of the path, and `record.json`.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use image::{ColorType, ImageReader};
use scene::whole_file;

use crate::{Description, Error, Result, source};

/// The file that says what the pictures are of.
const DESCRIPTION: &str = "record.json";

/// The part of a picture's file that says what has drawn it.
const HEAD_BYTES: u64 = 4096;

/// The folder of a recording.
#[derive(Clone, Debug)]
pub struct Folder {
    pub path: PathBuf,
}

impl Folder {
    /// The file of a frame of the path.
    pub fn picture(&self, frame: u32) -> PathBuf {
        self.path.join(format!("frame-{frame:06}.png"))
    }

    /// The file of float images of a frame, such as its depth.
    pub fn image(&self, frame: u32, name: &str) -> PathBuf {
        self.path.join(format!("frame-{frame:06}.{name}.exr"))
    }

    /// The file of counts of a frame.
    pub fn stats(&self, frame: u32) -> PathBuf {
        self.path.join(format!("frame-{frame:06}.json"))
    }

    /// The file that says what the pictures are of.
    pub fn description_file(&self) -> PathBuf {
        self.path.join(DESCRIPTION)
    }

    /// Whether the picture of a frame is there, to its last pixel. One that does not say of what it is, as `glint render` and
    /// optimisers of PNG files write it, is taken for it if it has the size.
    ///
    /// # Errors
    /// A whole picture is there that says that it is something else, or has another size or kind of colours.
    pub fn has(&self, frame: u32, recording: &Description) -> Result<bool> {
        let file = self.picture(frame);
        let decoded = ImageReader::open(&file).map_err(image::ImageError::IoError).and_then(|reader| reader.decode());
        let Ok(picture) = decoded else { return Ok(false) };
        let is_own = self.text(frame, source::RECORDING).is_none_or(|own| own == recording.of_frame(frame));
        if is_own && picture.color() == ColorType::Rgb8 && [picture.width(), picture.height()] == recording.size {
            return Ok(true);
        }
        let problem = "it is no picture of this recording; move it away, or name another folder".to_owned();
        Err(Error::Malformed { name: scene::shown(&file), problem })
    }

    /// What has drawn the picture of a frame, where its file says that.
    pub fn source(&self, frame: u32) -> Option<String> {
        self.text(frame, source::SOURCE)
    }

    fn text(&self, frame: u32, keyword: &str) -> Option<String> {
        let mut head = Vec::new();
        File::open(self.picture(frame)).ok()?.take(HEAD_BYTES).read_to_end(&mut head).ok()?;
        source::text(&head, keyword)
    }

    /// The picture of a frame: rows of sRGB red, green and blue, the top row first.
    ///
    /// # Errors
    /// It is not there, not whole, or not of this size.
    pub fn read(&self, frame: u32, size: [u32; 2]) -> Result<Vec<u8>> {
        let file = self.picture(frame);
        let malformed = |problem: String| Error::Malformed { name: scene::shown(&file), problem };
        let picture = read_picture(&file).map_err(|error| malformed(error.to_string()))?;
        let [width, height] = [picture.width(), picture.height()];
        let expected = format!("it has {width}x{height} pixels, expected {}x{}", size[0], size[1]);
        if [width, height] == size { Ok(picture.into_raw()) } else { Err(malformed(expected)) }
    }

    /// What the pictures in the folder are of; `None` for a folder without a recording.
    ///
    /// # Errors
    /// There are pictures, and nothing that says of what; or the file that says it cannot be read.
    pub fn description(&self) -> Result<Option<Description>> {
        let file = self.description_file();
        if file.exists() {
            let problem = |error: serde_json::Error| Error::Malformed {
                name: scene::shown(&file),
                problem: format!("{error}; delete it together with the pictures, or name another folder"),
            };
            return serde_json::from_str(&whole_file::read(&file)?).map(Some).map_err(problem);
        }
        let entries = std::fs::read_dir(&self.path).into_iter().flatten().flatten();
        let is_picture = |name: &str| name.starts_with("frame-") && name.ends_with(".png");
        match entries.map(|entry| entry.file_name()).find(|name| is_picture(&name.to_string_lossy())) {
            Some(picture) => Err(Error::Other {
                name: scene::shown(&self.path),
                difference: format!("it holds {}, and no {DESCRIPTION} that says of what", scene::shown(picture)),
            }),
            None => Ok(None),
        }
    }

    /// Refuses to add pictures of `wanted` to those that are there. `is_mixed` lets another adapter draw them.
    ///
    /// # Errors
    /// Those of `description`, and if the pictures are of something else.
    pub fn check(&self, wanted: &Description, is_mixed: bool) -> Result<Option<Description>> {
        let made = self.description()?;
        match made.as_ref().and_then(|made| made.difference(wanted, is_mixed)) {
            Some(difference) => Err(Error::Other { name: scene::shown(self.description_file()), difference }),
            None => Ok(made),
        }
    }
}

/// Reads a picture that a recording has written.
fn read_picture(path: &Path) -> image::ImageResult<image::RgbImage> {
    let picture = ImageReader::open(path)?.decode()?;
    if picture.color() == ColorType::Rgb8 {
        Ok(picture.into_rgb8())
    } else {
        Err(image::ImageError::IoError(std::io::ErrorKind::InvalidData.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Adapter, Averaging};

    fn recording(path: &str) -> Description {
        let adapter = Adapter { name: "card".into(), backend: "Vulkan".into(), driver: "1.2".into() };
        let (set, averaging) = (Default::default(), Averaging::NONE);
        let (version, scene, path) = ("0.1.0".into(), "aa".into(), path.into());
        Description { version, scene, path, size: [40, 30], fps: 30, adapter, set, averaging, auto: None }
    }

    /// The file of a picture that is of a frame of a recording.
    fn png(of: Option<String>) -> Vec<u8> {
        let picture = image::RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8, y as u8, (x * y) as u8]));
        let mut bytes = Vec::new();
        picture.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
        of.iter().for_each(|of| source::add_text(&mut bytes, source::RECORDING, of));
        bytes
    }

    #[test]
    fn a_picture_counts_if_it_is_there_whole_and_of_its_size() {
        let temporary = tempfile::tempdir().unwrap();
        let (folder, tour) = (Folder { path: temporary.path().to_owned() }, recording("tour"));
        let has = || folder.has(7, &tour).unwrap();
        assert!(!has());
        let file = folder.picture(7);
        assert!(file.ends_with("frame-000007.png"));
        let bytes = png(Some(tour.of_frame(7)));
        std::fs::write(&file, &bytes).unwrap();
        assert!(has());
        assert_eq!(folder.read(7, [40, 30]).unwrap()[3 * 42..][..3], [2, 1, 2]);
        assert!(folder.read(7, [30, 40]).unwrap_err().to_string().contains("it has 40x30 pixels, expected 30x40"));
        for length in [0, 8, bytes.len() / 2, bytes.len() - 30] {
            std::fs::write(&file, &bytes[..length]).unwrap();
            assert!(!has(), "{length} of {} bytes", bytes.len());
        }
        let mut damaged = bytes.clone();
        let middle = bytes.len() / 2;
        damaged[middle] ^= 0x10;
        std::fs::write(&file, &damaged).unwrap();
        assert!(!has(), "the checksum of the file says so");
    }

    #[test]
    fn a_picture_of_something_else_is_neither_taken_nor_replaced() {
        let temporary = tempfile::tempdir().unwrap();
        let (folder, tour) = (Folder { path: temporary.path().to_owned() }, recording("tour"));
        let larger = Description { set: [("splat.size".into(), "2".into())].into(), ..tour.clone() };
        for of in [tour.of_frame(8), recording("way back").of_frame(7), larger.of_frame(7)] {
            std::fs::write(folder.picture(7), png(Some(of))).unwrap();
            let told = folder.has(7, &tour).unwrap_err().to_string();
            assert!(told.contains("frame-000007.png: it is no picture of this recording; move it away"), "{told}");
        }
        let other = Description { adapter: Adapter { name: "other".into(), ..tour.adapter.clone() }, ..tour.clone() };
        std::fs::write(folder.picture(7), png(Some(other.of_frame(7)))).unwrap();
        assert!(folder.has(7, &tour).unwrap(), "--mixed decides about adapters");
        // One that says nothing is taken if it has the size.
        std::fs::write(folder.picture(7), png(None)).unwrap();
        assert!(folder.has(7, &tour).unwrap());
        assert!(folder.has(7, &Description { size: [30, 40], ..tour }).is_err());
    }

    #[test]
    fn pictures_of_which_nothing_says_what_they_are_are_left_alone() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = Folder { path: temporary.path().to_owned() };
        assert!(folder.description().unwrap().is_none());
        std::fs::write(temporary.path().join("notes.txt"), "mine").unwrap();
        assert!(folder.description().unwrap().is_none());
        std::fs::write(folder.picture(0), "").unwrap();
        let told = folder.description().unwrap_err().to_string();
        assert!(told.contains("it holds frame-000000.png, and no record.json"), "{told}");
        std::fs::write(folder.description_file(), "{").unwrap();
        let told = folder.description().unwrap_err().to_string();
        assert!(told.contains("record.json: ") && told.contains("name another folder"), "{told}");
    }
}
