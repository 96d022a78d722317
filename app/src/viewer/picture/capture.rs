//! Records what the window shows, while a person uses it: a picture for each frame of the film in which the window has
//! changed. A thread writes them, and makes the film when the recording ends. Pictures for which it has no time are
//! counted, and the film shows the one before for longer.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use record::Folder;
use scene::CaptureFormat;

use crate::system::film::{self, Codec, Output};
use crate::system::{interrupt, picture_file};

/// The pictures of a film of the window in a second.
pub const FPS: u32 = 30;
/// The pictures that wait to be written, at most: half a second of them, some 60 MB of a large window.
const MOST_WAITING: usize = 15;

enum Message {
    /// A picture, with the number of its frame: rows of red, green, blue and opacity.
    Picture(u32, Vec<u8>),
    /// The end, with the number of frames.
    End(u32),
}

/// What has become of a recording of the window.
#[derive(Clone, Debug, PartialEq)]
pub struct Captured {
    /// The number of frames, or why they ended.
    pub result: Result<u32, String>,
}

/// A recording of the window.
pub struct Capture {
    /// The size of the window in pixels, which all pictures have.
    size: [u32; 2],
    started: Instant,
    /// The number of the last frame that has a picture.
    last: Option<u32>,
    /// Whether the window has changed since.
    is_stale: bool,
    sender: Option<SyncSender<Message>>,
    begin: Option<(Output, Receiver<Message>)>,
    dropped: Arc<AtomicU64>,
    is_given_up: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    tell: Arc<dyn Fn(Captured) + Send + Sync>,
}

/// A name for a recording of the window that nothing has yet, of whatever format, nor its folder of pictures.
pub fn free_name(folder: &Path, format: CaptureFormat) -> PathBuf {
    let extensions = ["", "mp4", "gif", "frames"];
    let is_free = |name: &PathBuf| extensions.iter().all(|extension| !name.with_extension(extension).exists());
    let names = (1..u32::MAX).map(|number| folder.join(format!("glint-window-{number}")));
    let name = names.into_iter().find(is_free).unwrap_or_else(|| folder.join("glint-window"));
    name.with_extension(match format {
        CaptureFormat::Mp4 | CaptureFormat::Av1 | CaptureFormat::H264 => "mp4",
        CaptureFormat::Gif => "gif",
        CaptureFormat::Pictures => "",
    })
}

/// The folder of the pictures of a recording of this name.
pub fn folder_of(name: &Path) -> PathBuf {
    if name.extension().is_some() { film::folder_of(name) } else { name.to_owned() }
}

impl Capture {
    /// Begins a recording of this name, of a window with so many pixels. `dropped` counts the pictures for which there
    /// is no time. `tell` is called once, with the end.
    ///
    /// # Errors
    /// The film cannot be written there, or such films cannot be made.
    pub fn new(
        name: &Path,
        format: CaptureFormat,
        size: [u32; 2],
        dropped: Arc<AtomicU64>,
        tell: impl Fn(Captured) + Send + Sync + 'static,
    ) -> anyhow::Result<Self> {
        let output = |codec| Output::new(name, codec, size, FPS);
        let output = match format {
            // H.264 takes a tenth of the time of AV1.
            CaptureFormat::Mp4 => output(Some(Codec::H264)).or_else(|_| output(Some(Codec::Av1))),
            CaptureFormat::Av1 => output(Some(Codec::Av1)),
            CaptureFormat::H264 => output(Some(Codec::H264)),
            CaptureFormat::Gif | CaptureFormat::Pictures => output(None),
        }?;
        let folder = &output.folder.path;
        std::fs::create_dir(folder).map_err(|reason| codec::Error::not_written(folder, reason))?;
        let (sender, receiver) = sync_channel(MOST_WAITING);
        Ok(Self {
            size,
            started: Instant::now(),
            last: None,
            is_stale: true,
            sender: Some(sender),
            begin: Some((output, receiver)),
            dropped,
            is_given_up: Arc::default(),
            thread: None,
            tell: Arc::new(tell),
        })
    }

    /// Whether it still takes pictures.
    pub fn is_running(&self) -> bool {
        self.sender.is_some()
    }

    /// Must be called when the window shows something else.
    pub fn changed(&mut self) {
        self.is_stale = true;
    }

    /// Takes a picture, if the window has changed and a new frame has begun. Returns the time after which to call this
    /// again. `pixels` returns the size of the window and its rows of red, green, blue and opacity.
    pub fn step(&mut self, now: Instant, pixels: impl FnOnce() -> Option<([u32; 2], Vec<u8>)>) -> Option<Duration> {
        if !self.is_stale || !self.is_running() {
            return None;
        }
        let passed = now.saturating_duration_since(self.started).as_secs_f64();
        let frame = (passed * f64::from(FPS)) as u32;
        if let Some(last) = self.last.filter(|last| *last >= frame) {
            return Some(Duration::from_secs_f64((f64::from(last + 1) / f64::from(FPS) - passed).max(0.001)));
        }
        // What cannot be read now is read in the next frame.
        let (size, rgba) = pixels()?;
        if self.size != size {
            self.end(now);
            return None;
        }
        if let Some((output, receiver)) = self.begin.take() {
            self.start(output, receiver, size);
        }
        match self.sender.as_ref().map(|sender| sender.try_send(Message::Picture(frame, rgba))) {
            Some(Err(TrySendError::Full(_))) => drop(self.dropped.fetch_add(1, Ordering::Relaxed)),
            Some(Err(TrySendError::Disconnected(_))) => self.sender = None,
            Some(Ok(())) | None => {}
        }
        (self.last, self.is_stale) = (Some(frame), false);
        None
    }

    fn start(&mut self, output: Output, receiver: Receiver<Message>, size: [u32; 2]) {
        let (is_given_up, tell) = (self.is_given_up.clone(), self.tell.clone());
        let work = move || {
            let result = write(&output, &receiver, size, &is_given_up).map_err(|error| format!("{error:#}"));
            drop(receiver);
            tell(Captured { result });
        };
        match std::thread::Builder::new().name("capture".into()).spawn(work) {
            Ok(thread) => self.thread = Some(thread),
            Err(error) => {
                self.sender = None;
                (self.tell)(Captured { result: Err(error.to_string()) });
            }
        }
    }

    /// Ends the recording: the thread goes on to make the film.
    pub fn end(&mut self, now: Instant) {
        let passed = now.saturating_duration_since(self.started).as_secs_f64();
        let frames = ((passed * f64::from(FPS)).ceil() as u32).max(self.last.map_or(0, |last| last + 1));
        if let Some(sender) = self.sender.take() {
            // The thread writes what waits before, which takes a moment.
            std::thread::spawn(move || sender.send(Message::End(frames)));
        }
        if let Some((output, _)) = self.begin.take() {
            // The call removes the folder only if there is nothing in it.
            let _ = std::fs::remove_dir(&output.folder.path);
            (self.tell)(Captured { result: Ok(0) });
        }
    }

    /// Waits until the pictures that were taken are written. The film is not made.
    pub fn give_up(mut self) {
        self.is_given_up.store(true, Ordering::Relaxed);
        self.sender = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Writes the pictures and then the film. Returns the number of frames.
fn write(
    output: &Output,
    messages: &Receiver<Message>,
    size: [u32; 2],
    is_given_up: &AtomicBool,
) -> anyhow::Result<u32> {
    let folder = scene::shown(&output.folder.path);
    let mut made: Vec<u32> = Vec::new();
    let mut end = None;
    for message in messages {
        match message {
            Message::Picture(frame, rgba) => {
                let kept = |error: anyhow::Error| error.context(format!("{} pictures are in {folder}", made.len()));
                picture_file::write_png(&output.folder.picture(frame), size, &rgba, None).map_err(kept)?;
                made.push(frame);
            }
            Message::End(frames) => {
                end = Some(frames);
                break;
            }
        }
    }
    let frames = shown(&made, end.unwrap_or_else(|| made.last().map_or(0, |last| last + 1)));
    let check = || {
        interrupt::check()?;
        let problem = format!("the film was not made; its {} pictures are in {folder}", made.len());
        if is_given_up.load(Ordering::Relaxed) { Err(anyhow!(problem)) } else { Ok(()) }
    };
    let kept = |error: anyhow::Error| error.context(format!("{} pictures are in {folder}", made.len()));
    match output.film() {
        Some(_) => check().and_then(|()| output.encode(&frames, size, FPS, check).map_err(kept))?,
        None => fill(&output.folder, &frames).map_err(kept)?,
    }
    Ok(frames.len() as u32)
}

/// Gives each frame without a picture the one that it shows, so that the folder holds one for each.
fn fill(folder: &Folder, frames: &[u32]) -> anyhow::Result<()> {
    for (frame, shown) in (0..).zip(frames) {
        let (picture, from) = (folder.picture(frame), folder.picture(*shown));
        // Not all disks have links.
        if *shown != frame && std::fs::hard_link(&from, &picture).is_err() {
            std::fs::copy(&from, &picture).map_err(|reason| codec::Error::not_written(&picture, reason))?;
        }
    }
    Ok(())
}

/// The picture that each frame shows: its own, or the last one before it.
fn shown(made: &[u32], count: u32) -> Vec<u32> {
    let last = |frame: u32| made[..made.partition_point(|known| *known <= frame)].last().or(made.first()).copied();
    (0..count).filter_map(last).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    const SIZE: [u32; 2] = [32, 16];
    const MP4: CaptureFormat = CaptureFormat::Mp4;

    fn grey(value: u8) -> Option<([u32; 2], Vec<u8>)> {
        Some((SIZE, vec![value; 32 * 16 * 4]))
    }

    #[test]
    fn a_frame_without_a_picture_shows_the_one_before() {
        assert_eq!(shown(&[0, 2, 5], 8), [0, 0, 2, 2, 2, 5, 5, 5]);
        assert_eq!(shown(&[1], 3), [1, 1, 1]);
        assert!(shown(&[], 3).is_empty());
    }

    #[test]
    fn a_film_lasts_as_long_as_the_window_was_recorded_and_keeps_its_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let name = free_name(folder.path(), MP4);
        let (sender, ended) = channel();
        let dropped = Arc::<AtomicU64>::default();
        let mut capture = Capture::new(&name, MP4, SIZE, dropped.clone(), move |end| drop(sender.send(end))).unwrap();
        assert_ne!(free_name(folder.path(), MP4), name, "the folder of pictures takes the name, too");
        let start = capture.started;
        let at = |seconds: f64| start + Duration::from_secs_f64(seconds);
        assert_eq!(capture.step(at(0.0), || grey(10)), None);
        capture.changed();
        let wait = capture.step(at(0.01), || panic!("the frame has a picture")).unwrap();
        assert!(wait > Duration::from_millis(20) && wait < Duration::from_millis(24), "{wait:?}");
        capture.step(at(0.04), || grey(200));
        assert_eq!(capture.step(at(0.5), || panic!("nothing has changed")), None);
        capture.end(at(1.0));
        assert!(!capture.is_running());
        let end = ended.recv_timeout(Duration::from_secs(60)).unwrap();
        assert_eq!((end.result, dropped.load(Ordering::Relaxed)), (Ok(30), 0));
        assert!(std::fs::metadata(&name).unwrap().len() > 500);
        let pictures = std::fs::read_dir(name.with_extension("frames")).unwrap().count();
        assert_eq!(pictures, 2);
    }

    #[test]
    fn each_format_has_its_kind_of_file_and_a_folder_has_a_picture_for_each_frame() {
        for format in [CaptureFormat::Av1, CaptureFormat::Gif, CaptureFormat::Pictures] {
            let folder = tempfile::tempdir().unwrap();
            let name = free_name(folder.path(), format);
            let (sender, ended) = channel();
            let tell = move |end| drop(sender.send(end));
            let mut capture = Capture::new(&name, format, SIZE, Arc::default(), tell).unwrap();
            let others = [CaptureFormat::Mp4, CaptureFormat::Gif, CaptureFormat::Pictures];
            assert!(others.iter().all(|other| free_name(folder.path(), *other) != name.with_extension("")));
            let at = |seconds: f64| Duration::from_secs_f64(seconds);
            let start = capture.started;
            capture.step(start, || grey(10));
            capture.changed();
            capture.step(start + at(0.1), || grey(200));
            capture.end(start + at(0.2));
            assert_eq!(ended.recv_timeout(Duration::from_secs(60)).unwrap().result, Ok(6), "{format:?}");
            let pictures = Folder { path: folder_of(&name) };
            if format == CaptureFormat::Pictures {
                assert!(name.is_dir() && name.ends_with("glint-window-1"));
                let greys = (0..6).map(|frame| pictures.read(frame, SIZE).unwrap()[0]);
                assert_eq!(greys.collect::<Vec<_>>(), [10, 10, 10, 200, 200, 200]);
            } else {
                let whole = std::fs::read(&name).unwrap();
                assert!(whole.starts_with(b"GIF89a") == (format == CaptureFormat::Gif) && whole.len() > 100);
                assert_eq!(std::fs::read_dir(&pictures.path).unwrap().count(), 2);
            }
            assert!(!pictures.picture(6).exists(), "no more than were shown");
        }
    }

    #[test]
    fn a_recording_that_is_given_up_leaves_its_pictures_and_says_where() {
        let folder = tempfile::tempdir().unwrap();
        let name = free_name(folder.path(), MP4);
        let (sender, ended) = channel();
        let mut capture = Capture::new(&name, MP4, SIZE, Arc::default(), move |end| drop(sender.send(end))).unwrap();
        capture.step(Instant::now(), || grey(10));
        capture.give_up();
        let told = ended.try_recv().unwrap().result.unwrap_err();
        assert!(told.contains("its 1 pictures are in ") && told.contains("glint-window-1.frames"), "{told}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no half film");
    }

    #[test]
    fn pictures_that_cannot_be_written_end_the_recording_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let name = free_name(folder.path(), MP4);
        let (sender, ended) = channel();
        let mut capture = Capture::new(&name, MP4, SIZE, Arc::default(), move |end| drop(sender.send(end))).unwrap();
        std::fs::remove_dir(name.with_extension("frames")).unwrap();
        capture.step(capture.started, || grey(10));
        let told = ended.recv_timeout(Duration::from_secs(60)).unwrap().result.unwrap_err();
        assert!(told.contains("0 pictures are in ") && told.contains("frame-000000.png: cannot be written"), "{told}");
        capture.changed();
        capture.step(Instant::now() + Duration::from_secs(1), || grey(10));
        assert!(!capture.is_running());
    }

    #[test]
    fn pictures_for_which_there_is_no_time_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let dropped = Arc::<AtomicU64>::default();
        let mut capture = Capture::new(&free_name(folder.path(), MP4), MP4, SIZE, dropped.clone(), |_| {}).unwrap();
        // Nobody writes them.
        let waiting = capture.begin.take();
        for frame in 0..MOST_WAITING + 4 {
            capture.changed();
            capture.step(capture.started + Duration::from_secs_f64((frame as f64 + 0.5) / f64::from(FPS)), || grey(1));
        }
        assert_eq!(dropped.load(Ordering::Relaxed), 4);
        drop(waiting);
    }
}
