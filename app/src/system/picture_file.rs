//! Writes picture files: PNG for the picture, OpenEXR for the numbers behind it. A file appears whole or not at all: it
//! is written under another name in the same folder and renamed at the end. It keeps the permissions of a file that it
//! replaces, and a link to that.

use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use codec::Error;
use exr::prelude::{AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, Text, WritableImage as _};
use glam::DVec3;
use image::ImageEncoder as _;
use image::codecs::png::PngEncoder;
use record::Adapter;
use render::{Aov, AovImage, Gpu};
use scene::Camera;

use crate::system::terminal;

/// Writes an 8-bit RGB PNG. `rgba` holds sRGB rows of red, green, blue and opacity, the top row first. The opacity is
/// left out: it is 255 throughout a rendered picture. The file names the adapter that has drawn the picture.
///
/// # Errors
/// If the file cannot be written; the error names it.
pub fn write_png(path: &Path, size: [u32; 2], rgba: &[u8], adapter: Option<&Adapter>) -> anyhow::Result<()> {
    write_frame(path, size, rgba, adapter, None)
}

/// Writes a picture as `write_png` does; the file also says of which recording it is.
///
/// # Errors
/// Those of `write_png`.
pub fn write_frame(
    path: &Path,
    size: [u32; 2],
    rgba: &[u8],
    adapter: Option<&Adapter>,
    recording: Option<&str>,
) -> anyhow::Result<()> {
    let rgb: Vec<u8> = rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    // The encoder would hide why a file cannot be written, so it writes to memory.
    let mut bytes = Vec::new();
    let [width, height] = size;
    PngEncoder::new(&mut bytes).write_image(&rgb, width, height, image::ExtendedColorType::Rgb8)?;
    if let Some(adapter) = adapter {
        record::add_text(&mut bytes, record::SOURCE, &adapter.to_string());
    }
    if let Some(recording) = recording {
        record::add_text(&mut bytes, record::RECORDING, recording);
    }
    write_whole(path, |file| file.write_all(&bytes))
}

/// The adapter of a GPU, as pictures and recordings name it.
pub fn adapter(gpu: &Gpu) -> Adapter {
    Adapter {
        name: gpu.info.name.clone(),
        backend: format!("{:?}", gpu.info.backend),
        driver: format!("{} {}", gpu.info.driver, gpu.info.driver_info).trim().to_owned(),
    }
}

/// Coordinates up to here are kept by float32 to less than a thousandth.
const FARTHEST: f64 = 32_768.0;

/// What the positions of float images are relative to, which float32 would round to coarser steps than a thousandth
/// where coordinates are large: the camera's pivot in whole units. Else they are absolute.
pub fn origin(camera: &Camera) -> DVec3 {
    let is_far = [camera.eye, camera.pivot].iter().any(|place| place.abs().max_element() >= FARTHEST);
    if is_far { camera.pivot.round() } else { DVec3::ZERO }
}

/// The origin of a float image of this name; `None` if it has no positions.
pub fn origin_of(name: &str, camera: &Camera) -> Option<DVec3> {
    name.ends_with("position").then(|| origin(camera))
}

/// Moves the positions of a float image.
pub fn move_places(image: &mut AovImage, by: DVec3) {
    for place in image.data.chunks_exact_mut(image.channels.len().max(3)).filter(|_| by != DVec3::ZERO) {
        (0..3).for_each(|axis| place[axis] = (f64::from(place[axis]) + by[axis]) as f32);
    }
}

/// Warns of positions that are relative to an origin.
pub fn warn_of_origin<'a>(mut names: impl Iterator<Item = &'a str>, origin: DVec3) {
    if let Some(name) = names.find(|name| name.ends_with("position")).filter(|_| origin != DVec3::ZERO) {
        terminal::warn([format!(
            "--aov: {name} is relative to {} {} {}, as the file's attribute `origin` says: float32 would round such \
             coordinates to more than a millimetre",
            origin.x, origin.y, origin.z
        )]);
    }
}

/// Warns of light in an image that the renderer made, where it may have been more than the renderer can hold.
pub fn cut_warning(aov: Aov, image: &AovImage) -> Option<String> {
    let largest = aov.largest()?;
    let is_cut = |pixel: &&[f32]| pixel.iter().any(|value| *value >= largest);
    let pixels = image.data.chunks(image.channels.len()).filter(is_cut).count();
    let name = aov.name();
    (pixels > 0).then(|| format!(
        "--aov: {name} ends at {largest}, and {pixels} of its pixels have that; make the lights weaker to see how bright \
         they are"
    ))
}

/// Writes 32-bit float scan lines, ZIP-compressed. NaN and values above 1 stay as they are. The file names the origin of
/// an image of positions in its attribute `origin`.
///
/// # Errors
/// If the file cannot be written; the error names it.
pub fn write_exr(path: &Path, picture: &AovImage, origin: Option<DVec3>) -> anyhow::Result<()> {
    let count = picture.channels.len();
    let channels = picture.channels.iter().enumerate().map(|(index, name)| {
        let samples = picture.data.iter().skip(index).step_by(count).copied().collect();
        AnyChannel::new(*name, FlatSamples::F32(samples))
    });
    let channels = AnyChannels::sort(channels.collect());
    let size = (picture.size[0] as usize, picture.size[1] as usize);
    let mut image = Image::from_encoded_channels(size, Encoding::SMALL_LOSSLESS, channels);
    if let Some(DVec3 { x, y, z }) = origin {
        let text = AttributeValue::Text(Text::from(format!("{x} {y} {z}").as_str()));
        image.layer_data.attributes.other.insert(Text::from("origin"), text);
    }
    // The EXR writer needs to seek, so it writes to memory. The compressed file is much smaller than the picture.
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes)?;
    write_whole(path, |file| file.write_all(bytes.get_ref()))
}

/// Whether a float image is there, with this size and to its last pixel.
pub fn is_exr(path: &Path, [width, height]: [u32; 2]) -> bool {
    let read = exr::prelude::read_all_flat_layers_from_file(path);
    let size = read.ok().and_then(|image| image.layer_data.first().map(|layer| layer.size));
    size == Some(exr::math::Vec2(width as usize, height as usize))
}

/// Writes a text file, such as that of `--stats`.
///
/// # Errors
/// If the file cannot be written; the error names it.
pub fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    write_bytes(path, text.as_bytes())
}

/// Writes a file of these bytes.
///
/// # Errors
/// If the file cannot be written; the error names it.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    write_whole(path, |file| file.write_all(bytes))
}

/// Writes a text file unless there is one of this name. Returns whether it was written: of several programs that write
/// it at once, one has written it.
///
/// # Errors
/// If the file cannot be written; the error names it.
pub fn write_new_text(path: &Path, text: &str) -> anyhow::Result<bool> {
    let partial = partial(path);
    let written = std::fs::write(&partial, text).and_then(|()| std::fs::hard_link(&partial, path));
    let _ = std::fs::remove_file(&partial);
    match written {
        Ok(()) => Ok(true),
        Err(reason) if reason.kind() == ErrorKind::AlreadyExists => Ok(false),
        // Not all disks have links.
        Err(_) if path.exists() => Ok(false),
        Err(_) => write_text(path, text).map(|()| true),
    }
}

/// Checks that a file can be written at `path`, before the work starts.
///
/// # Errors
/// If the folder is missing or cannot be written, or if `path` is a folder.
pub fn check_place(path: &Path) -> anyhow::Result<()> {
    let unwritten = |reason| Error::not_written(path, reason);
    if path.is_dir() || path.file_name().is_none() {
        return Err(unwritten(ErrorKind::IsADirectory.into()).into());
    }
    if !is_special(path) {
        // Only creating a file proves that the folder can be written: its permissions and the state of the disk do not.
        let partial = partial(&behind_links(path));
        File::create(&partial).map_err(unwritten)?;
        std::fs::remove_file(&partial).map_err(unwritten)?;
    }
    Ok(())
}

/// Whether something other than a regular file is at `path`, such as a device or a pipe, which a file cannot replace.
pub fn is_special(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|metadata| !metadata.is_file())
}

/// Returns the same path for all ways to write one place: that of the file behind links, in a folder without links or
/// detours.
pub fn place(path: &Path) -> PathBuf {
    let path = behind_links(path);
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    folder.join(path.file_name().unwrap_or_default())
}

/// The path of the file that a link names, also if that is not there yet; other paths as they are.
fn behind_links(path: &Path) -> PathBuf {
    /// As many as Linux follows.
    const MOST_LINKS: usize = 40;
    let mut path = path.to_owned();
    for _ in 0..MOST_LINKS {
        let Ok(named) = std::fs::read_link(&path) else { break };
        path = path.parent().unwrap_or(Path::new("")).join(named);
    }
    path
}

/// Makes an empty file for what is being written. Where it replaces another file, none but its owner can read it until
/// `keep_permissions`: that file may be private.
#[cfg(unix)]
fn create(partial: &Path, replaced: &Path) -> std::io::Result<File> {
    use std::os::unix::fs::OpenOptionsExt as _;
    if !replaced.exists() {
        return File::create(partial);
    }
    // One that a program of the same number has left behind may be readable.
    let _ = std::fs::remove_file(partial);
    File::options().write(true).create_new(true).mode(0o600).open(partial)
}

#[cfg(not(unix))]
fn create(partial: &Path, _: &Path) -> std::io::Result<File> {
    File::create(partial)
}

/// Gives a file that is being written the group and the permissions of the one that it replaces.
#[cfg(unix)]
fn keep_permissions(partial: &File, replaced: &Path) {
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, fchown};
    let (Ok(before), Ok(own)) = (std::fs::metadata(replaced), partial.metadata()) else { return };
    let is_of_group = before.gid() == own.gid() || fchown(partial, None, Some(before.gid())).is_ok();
    let mode = before.mode() & 0o7777;
    // Where the group cannot be kept, the new one may do no more than all others.
    let mode = if is_of_group { mode } else { mode & 0o7707 | (mode & 0o7) << 3 };
    // Not all disks have permissions.
    let _ = partial.set_permissions(std::fs::Permissions::from_mode(mode));
}

/// Elsewhere the only permission is that to write, and a file without it cannot be replaced.
#[cfg(not(unix))]
fn keep_permissions(_: &File, _: &Path) {}

/// The path of a file while it is being written. Each call returns another one, so that no two threads or programs
/// share it.
fn partial(path: &Path) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{}.{}-{count}.partial", codec::short_file_name(&name), std::process::id()))
}

/// Has a file written by `write`, which gets the name of an empty file in the same folder. The file appears under its
/// own name when it is whole.
///
/// # Errors
/// Those of `write`, or if the file cannot be renamed.
pub fn write_by_name(path: &Path, write: impl FnOnce(&Path) -> anyhow::Result<()>) -> anyhow::Result<()> {
    // A device behind a link is not replaced.
    let place = if is_special(path) { path.to_owned() } else { behind_links(path) };
    let partial = partial(&place);
    let unwritten = |reason| anyhow::Error::from(Error::not_written(path, reason));
    let rename = || {
        if let Ok(file) = File::open(&partial) {
            keep_permissions(&file, &place);
        }
        std::fs::rename(&partial, &place).map_err(unwritten)
    };
    let created = create(&partial, &place).map(drop).map_err(unwritten);
    let written = created.and_then(|()| write(&partial)).and_then(|()| rename());
    if written.is_err() {
        let _ = std::fs::remove_file(&partial);
    }
    written
}

fn write_whole(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>) -> anyhow::Result<()> {
    let finish = |file: File| {
        let mut file = BufWriter::new(file);
        write(&mut file)?;
        file.flush()
    };
    let written = if is_special(path) {
        File::create(path).and_then(finish)
    } else {
        let place = behind_links(path);
        let partial = partial(&place);
        let created = create(&partial, &place).inspect(|file| keep_permissions(file, &place));
        let moved = created.and_then(finish).and_then(|()| std::fs::rename(&partial, &place));
        if moved.is_err() {
            let _ = std::fs::remove_file(&partial);
        }
        moved
    };
    Ok(written.map_err(|reason| Error::not_written(path, reason))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn float_pictures_come_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("position.exr");
        let data = vec![1.0, -2.5, 1e30, f32::NAN, f32::NAN, f32::NAN, 635_619.1, 0.1, -0.0, 4.0, 5.0, 6.0];
        let picture = AovImage { size: [2, 2], channels: &["R", "G", "B"], data };
        let origin = DVec3::new(635_619.0, -4_100_000.5, 0.0);
        write_exr(&path, &picture, Some(origin)).unwrap();
        let back = exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
        assert_eq!(back.layer_data.size, exr::prelude::Vec2(2, 2));
        let kept = back.layer_data.attributes.other.get(&Text::from("origin"));
        assert_eq!(kept, Some(&AttributeValue::Text(Text::from("635619 -4100000.5 0"))));
        for (index, name) in picture.channels.iter().enumerate() {
            let channel = back.layer_data.channel_data.list.iter().find(|channel| channel.name.eq(name)).unwrap();
            let FlatSamples::F32(samples) = &channel.sample_data else { panic!("not float32") };
            let bits: Vec<u32> = samples.iter().map(|value| value.to_bits()).collect();
            let expected: Vec<u32> = picture.data.iter().skip(index).step_by(3).map(|value| value.to_bits()).collect();
            assert_eq!(bits, expected, "{name}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside the picture");
    }

    #[test]
    fn colours_of_a_png_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        write_png(&path, [2, 1], &[1, 2, 3, 255, 250, 128, 0, 255], None).unwrap();
        let back = image::open(&path).unwrap();
        assert_eq!(back.color(), image::ColorType::Rgb8);
        assert_eq!(back.to_rgb8().as_raw(), &[1, 2, 3, 250, 128, 0]);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        std::fs::write(&path, "old").unwrap();
        let result = write_whole(&path, |file| {
            file.write_all(b"half of it")?;
            Err(ErrorKind::StorageFull.into())
        });
        let error = format!("{:#}", result.unwrap_err());
        let told = "picture.png: cannot be written: the disk is full; make room there, or name another place";
        assert!(error.ends_with(told), "{error}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_film_that_fails_leaves_nothing_and_one_that_is_whole_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.mp4");
        let half = |partial: &Path| {
            std::fs::write(partial, "half")?;
            Err(anyhow::anyhow!("the encoder fails"))
        };
        assert!(write_by_name(&path, half).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        write_by_name(&path, |partial| Ok(std::fs::write(partial, "whole")?)).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "whole");
    }

    #[cfg(unix)]
    #[test]
    fn a_file_that_is_replaced_keeps_its_permissions_and_the_links_to_it() {
        use std::os::unix::fs::{PermissionsExt as _, symlink};
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::create_dir(path("kept")).unwrap();
        std::fs::write(path("kept/hall.toml"), "old").unwrap();
        std::fs::set_permissions(path("kept/hall.toml"), std::fs::Permissions::from_mode(0o600)).unwrap();
        symlink("kept/hall.toml", path("link.toml")).unwrap();
        symlink(path("link.toml"), path("second.toml")).unwrap();
        symlink("kept/new.toml", path("dangling.toml")).unwrap();
        let mode = |name: &str| std::fs::metadata(path(name)).unwrap().permissions().mode() & 0o777;
        let text = |name: &str| std::fs::read_to_string(path(name)).unwrap();
        check_place(&path("second.toml")).unwrap();
        write_text(&path("second.toml"), "new").unwrap();
        assert_eq!((text("kept/hall.toml").as_str(), mode("kept/hall.toml")), ("new", 0o600));
        write_by_name(&path("link.toml"), |partial| Ok(std::fs::write(partial, "film")?)).unwrap();
        assert_eq!((text("kept/hall.toml").as_str(), mode("kept/hall.toml")), ("film", 0o600));
        symlink("/dev/null", path("null.mp4")).unwrap();
        write_by_name(&path("null.mp4"), |partial| Ok(std::fs::write(partial, "film")?)).unwrap();
        assert!(is_special(Path::new("/dev/null")) && text("null.mp4") == "film");
        write_text(&path("dangling.toml"), "first").unwrap();
        assert_eq!(text("kept/new.toml"), "first");
        assert!(["link.toml", "second.toml", "dangling.toml"].iter().all(|link| path(link).is_symlink()));
        assert_eq!(place(&path("second.toml")), place(&path("kept/hall.toml")));
        assert_eq!(std::fs::read_dir(path("kept")).unwrap().count(), 2, "nothing is left beside them");
        // While it is written, nobody else can read it, whatever its permissions were; the encoder opens it by name.
        let film = |partial: &Path| {
            assert_eq!(std::fs::metadata(partial)?.permissions().mode() & 0o777, 0o600);
            Ok(std::fs::write(partial, "film")?)
        };
        for kept in [0o600, 0o640, 0o444] {
            std::fs::set_permissions(path("kept/hall.toml"), std::fs::Permissions::from_mode(kept)).unwrap();
            write_by_name(&path("link.toml"), film).unwrap();
            assert_eq!(mode("kept/hall.toml"), kept);
        }
        // Its folder may be written.
        std::fs::set_permissions(path("kept/hall.toml"), std::fs::Permissions::from_mode(0o444)).unwrap();
        write_text(&path("kept/hall.toml"), "again").unwrap();
        assert_eq!((text("kept/hall.toml").as_str(), mode("kept/hall.toml")), ("again", 0o444));
    }

    #[test]
    fn a_text_that_is_there_is_not_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("record.json");
        assert!(write_new_text(&path, "first").unwrap());
        assert!(!write_new_text(&path, "second").unwrap());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "first");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");
        assert!(write_new_text(&folder.path().join("missing/record.json"), "").is_err());
    }

    #[test]
    fn places_that_cannot_be_written_are_refused_beforehand() {
        let folder = tempfile::tempdir().unwrap();
        assert!(check_place(&folder.path().join("a.png")).is_ok());
        assert!(check_place(Path::new("a.png")).is_ok());
        assert!(check_place(&folder.path().join("missing/a.png")).is_err());
        assert!(check_place(folder.path()).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left");
    }
}
