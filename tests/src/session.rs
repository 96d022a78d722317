//! A private X session without a window manager: Xvfb, the program in it, xdotool for its input, and the server's own
//! file of the screen for screenshots.

use std::cell::RefCell;
use std::ffi::OsStr;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use image::RgbaImage;

use crate::Folder;

/// How long a window or a picture may take to appear: shaders are compiled before the first one, see `program`.
const PATIENCE: Duration = Duration::from_secs(120);

/// The pause between two looks at the screen or at what was logged.
const PAUSE: Duration = Duration::from_millis(100);

/// An X server for one test. It ends with the value.
pub struct Session {
    pub folder: Folder,
    server: Child,
    display: String,
}

impl Session {
    pub fn start() -> Session {
        let folder = Folder::new();
        let mut server = Command::new("Xvfb")
            // The server picks a free display and writes its number to descriptor 1.
            .args(["-displayfd", "1", "-screen", "0", "1280x1024x24", "-nolisten", "tcp", "-noreset"])
            // What is on the screen is in a file, without the pointer, which the server would draw into it.
            .args(["-nocursor", "-fbdir"])
            .arg(folder.path(""))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts; `cargo xtask test` installs it");
        let mut output = BufReader::new(server.stdout.take().expect("piped"));
        let (sender, receiver) = mpsc::channel();
        std::thread::spawn(move || {
            let mut number = String::new();
            // If the server took too long, nobody listens any more.
            let _ = sender.send(output.read_line(&mut number).map(|_| number));
        });
        let number = receiver.recv_timeout(PATIENCE).expect("Xvfb tells its display").expect("Xvfb's output");
        // From here on a failed test ends the server.
        let session = Session { folder, server, display: format!(":{}", number.trim()) };
        assert!(session.display.len() > 1, "Xvfb ended without a display");
        session
    }

    /// Starts `glint ARGUMENTS`, and waits until its window is there and has the keyboard.
    pub fn open<I: IntoIterator<Item: AsRef<OsStr>>>(&self, arguments: I) -> Window<'_> {
        self.open_acting_like("", arguments)
    }

    /// Starts `glint ARGUMENTS` with words of GLINT_ACT_LIKE, and waits as `open` does.
    pub fn open_acting_like<I: IntoIterator<Item: AsRef<OsStr>>>(&self, words: &str, arguments: I) -> Window<'_> {
        let messages = File::create(self.folder.path("messages.txt")).expect("a file in a temporary folder");
        let mut command = self.folder.command(arguments);
        command.env("DISPLAY", &self.display).env("GLINT_EVENT_LOG", self.folder.path("events.jsonl"));
        if !words.is_empty() {
            command.env("GLINT_ACT_LIKE", words);
        }
        command.stdout(Stdio::null()).stderr(messages);
        let program = command.spawn().expect("the program starts");
        let mut window = Window { session: self, program, id: String::new() };
        let process = window.program.id().to_string();
        window.id = window.wait_for("its window", |window| {
            let found = window.session.xdotool(&["search", "--onlyvisible", "--pid", &process])?;
            found.lines().next().map(str::to_owned)
        });
        // Without a window manager no other program gives it the keyboard.
        window.wait_for("the keyboard", |window| {
            window.session.xdotool(&["windowfocus", &window.id])?;
            let focused = window.session.xdotool(&["getwindowfocus"])?;
            (focused.trim() == window.id).then_some(())
        });
        window
    }

    /// The output of `xdotool ARGUMENTS`, if it succeeds.
    fn xdotool(&self, arguments: &[&str]) -> Option<String> {
        let mut command = Command::new("xdotool");
        let output = command.args(arguments).env("DISPLAY", &self.display).output().expect("xdotool starts");
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// What is on the screen, unless that changes all the time.
    fn screen(&self) -> Option<RgbaImage> {
        const MOST_READS: usize = 20;
        let read = || std::fs::read(self.folder.path("Xvfb_screen0")).ok();
        let mut file = read()?;
        // A file that is read while the server draws may hold half of a picture. The server answers once it has drawn that.
        for _ in 0..MOST_READS {
            self.xdotool(&["getmouselocation"])?;
            let again = read()?;
            if again == file {
                return picture_of(&file);
            }
            file = again;
        }
        None
    }

    /// What is on the screen where a window is, which is given by its number.
    fn screenshot(&self, window: &str) -> Option<RgbaImage> {
        let told = self.xdotool(&["getwindowgeometry", "--shell", window])?;
        let side = |name: &str| {
            let value = told.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='))?;
            value.parse::<u32>().ok()
        };
        let (x, y, width, height) = (side("X")?, side("Y")?, side("WIDTH")?, side("HEIGHT")?);
        Some(image::imageops::crop_imm(&self.screen()?, x, y, width, height).to_image())
    }
}

/// The picture of a file in X's format of window dumps, as a server without a screen writes its own: a header of numbers of
/// 32 bits, a table of colours, and rows of pixels of 32 bits, which are blue, green, red and nothing.
fn picture_of(file: &[u8]) -> Option<RgbaImage> {
    let number = |index: usize| {
        let bytes = file.get(4 * index..)?.first_chunk()?;
        usize::try_from(u32::from_be_bytes(*bytes)).ok()
    };
    let (header, colors, row) = (number(0)?, number(19)?, number(12).filter(|row| *row > 0)?);
    let (width, height) = (number(4)?, number(5)?);
    // Pixels of 32 bits whose first byte is the lowest, and the place of red in them.
    let format = [number(7)?, number(11)?, number(14)?];
    assert_eq!(format, [0, 32, 0xff_0000], "the bytes of the screen's file have another order");
    let rows = file.get(header + 12 * colors..)?.chunks_exact(row).take(height);
    let mut rgba = rows.map(|row| row.get(..4 * width)).collect::<Option<Vec<_>>>()?.concat();
    for pixel in rgba.as_chunks_mut::<4>().0 {
        pixel.swap(0, 2);
        pixel[3] = 255;
    }
    RgbaImage::from_raw(width as u32, height as u32, rgba)
}

impl Drop for Session {
    fn drop(&mut self) {
        end(&mut self.server);
    }
}

/// The program's window. Positions are pixels from its upper left corner. The program ends with the value.
pub struct Window<'a> {
    session: &'a Session,
    program: Child,
    id: String,
}

impl Window<'_> {
    /// Presses keys one after the other, in xdotool's names: `2`, `Home`, `ctrl+c`, `Escape`.
    pub fn press(&self, keys: &str) {
        self.hands(&["key", "--delay", "50"], &keys.split_whitespace().collect::<Vec<_>>());
    }

    /// Holds a key down until [`Window::release`].
    pub fn hold(&self, key: &str) {
        self.hands(&["keydown"], &[key]);
    }

    pub fn release(&self, key: &str) {
        self.hands(&["keyup"], &[key]);
    }

    pub fn type_text(&self, text: &str) {
        self.hands(&["type", "--delay", "20"], &[text]);
    }

    pub fn move_to(&self, [x, y]: [i32; 2]) {
        self.hands(&["mousemove", "--window", &self.id], &[&x.to_string(), &y.to_string()]);
    }

    /// Clicks a button: 1 left, 2 middle, 3 right; 4 and 5 turn the wheel.
    pub fn click(&self, button: u8, at: [i32; 2]) {
        self.move_to(at);
        self.hands(&["click"], &[&button.to_string()]);
    }

    /// Drags in steps, as a hand does: a program that follows movements does not take a single jump for a drag.
    pub fn drag(&self, button: u8, from: [i32; 2], to: [i32; 2]) {
        const STEPS: i32 = 8;
        self.move_to(from);
        self.hands(&["mousedown"], &[&button.to_string()]);
        for step in 1..=STEPS {
            let along = |axis: usize| from[axis] + (to[axis] - from[axis]) * step / STEPS;
            self.move_to([along(0), along(1)]);
            // Slow enough for a busy machine's window to see the button held in several of its frames.
            std::thread::sleep(Duration::from_millis(80));
        }
        self.hands(&["mouseup"], &[&button.to_string()]);
    }

    /// Takes the window off the screen and puts it back: the X server does not keep what it showed.
    pub fn hide_and_show(&self) {
        self.hands(&["windowunmap", "--sync"], &[&self.id]);
        self.hands(&["windowmap", "--sync"], &[&self.id]);
    }

    pub fn screenshot(&self) -> RgbaImage {
        self.wait_for("a screenshot", |window| window.session.screenshot(&window.id))
    }

    /// The first picture that fulfils `condition`. Fails the test, with the last picture kept, when none does in time.
    pub fn wait_for_picture(&self, what: &str, condition: impl Fn(&RgbaImage) -> bool) -> RgbaImage {
        self.wait_for(what, |window| window.session.screenshot(&window.id).filter(&condition))
    }

    /// Interrupts the program as Ctrl-C in its terminal does, and waits until it has ended.
    pub fn interrupt(mut self) -> std::process::ExitStatus {
        let sent = Command::new("kill").args(["-INT", &self.program.id().to_string()]).status();
        assert!(sent.is_ok_and(|status| status.success()));
        self.ended()
    }

    /// Kills the program, which cannot do anything about it.
    pub fn kill(mut self) {
        self.program.kill().expect("the program runs");
        self.ended();
    }

    /// Saves the scene under the name that the program proposes. Returns the file's path.
    pub fn save_scene_as(&self) -> String {
        let seen = self.events().len();
        self.press("ctrl+shift+s");
        self.wait_until_painted("prompt", seen);
        self.press("Return");
        let saved = self.wait_for_event("scene_saved", seen, |_| true);
        saved["path"].as_str().expect("a path").to_owned()
    }

    /// Waits until the program has ended.
    pub fn end(mut self) -> std::process::ExitStatus {
        self.ended()
    }

    /// Quits the program, and waits until it has ended.
    pub fn quit(mut self) -> std::process::ExitStatus {
        self.press("ctrl+q");
        self.ended()
    }

    fn ended(&mut self) -> std::process::ExitStatus {
        let start = Instant::now();
        loop {
            if let Some(status) = self.program.try_wait().expect("a child can be waited for") {
                return status;
            }
            assert!(start.elapsed() < PATIENCE, "the program does not end");
            std::thread::sleep(PAUSE);
        }
    }

    /// Quits the program, gives up changes that are not saved, and waits until it has ended.
    pub fn quit_and_discard(mut self) -> std::process::ExitStatus {
        self.press("Escape Escape ctrl+q");
        std::thread::sleep(Duration::from_secs(1));
        if self.is_open() {
            // "Save" has the keyboard, and "Discard" follows.
            self.press("Tab Return");
        }
        self.ended()
    }

    /// The number of the program's process.
    pub fn process(&self) -> u32 {
        self.program.id()
    }

    /// Whether the program still runs.
    pub fn is_open(&self) -> bool {
        std::fs::read_to_string(format!("/proc/{}/stat", self.program.id()))
            // A child that ended and was not waited for yet is a zombie: state Z, after the name in brackets.
            .is_ok_and(|stat| !stat.rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with('Z')))
    }

    /// What the program wrote to standard error so far.
    pub fn messages(&self) -> String {
        std::fs::read_to_string(self.session.folder.path("messages.txt")).unwrap_or_default()
    }

    /// What the program logged so far, oldest first.
    pub fn events(&self) -> Vec<serde_json::Value> {
        let text = std::fs::read_to_string(self.session.folder.path("events.jsonl")).unwrap_or_default();
        text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
    }

    /// The first event of this name, of those after the first `skipped` events of any name, that fulfils `condition`.
    pub fn wait_for_event(
        &self,
        name: &str,
        skipped: usize,
        condition: impl Fn(&serde_json::Value) -> bool,
    ) -> serde_json::Value {
        self.wait_for(&format!("the event `{name}`"), |window| {
            let events = window.events().into_iter().skip(skipped);
            events.filter(|event| event["event"] == name).find(|event| condition(event))
        })
    }

    /// Waits until the window has painted the result of an event: the first one of this name after the first `skipped`
    /// ones.
    pub fn wait_until_painted(&self, name: &str, skipped: usize) {
        self.wait_for(&format!("the window painted after the event `{name}`"), |window| {
            let events = window.events().into_iter().skip(skipped);
            events.skip_while(|event| event["event"] != name).find(|event| event["event"] == "painted").map(drop)
        });
    }

    /// The picture once everything is loaded, drawn in full and on the screen, later than the first `skipped` events.
    pub fn settled(&self, skipped: usize) -> RgbaImage {
        self.wait_until_painted("settled", skipped);
        // The X server takes a moment to show what was painted: two screenshots in a row are the same once it has.
        let last = RefCell::new(None);
        self.wait_for_picture("a picture that stays", |picture| {
            let right_of_the_panel = image::imageops::crop_imm(picture, 320, 60, 940, 640).to_image();
            last.replace(Some(right_of_the_panel.clone())) == Some(right_of_the_panel)
        })
    }

    /// The first event of this name after the first `skipped` ones that fulfils `condition`, and the picture that settles
    /// after it. One that settles before it belongs to what was done earlier.
    pub fn settled_after(
        &self,
        name: &str,
        skipped: usize,
        condition: impl Fn(&serde_json::Value) -> bool,
    ) -> (serde_json::Value, RgbaImage) {
        let event = self.wait_for_event(name, skipped, &condition);
        let is_it = |event: &serde_json::Value| event["event"] == name && condition(event);
        let before = self.events().iter().skip(skipped).position(is_it).expect("just seen");
        (event, self.settled(skipped + before))
    }

    fn hands(&self, action: &[&str], on: &[&str]) {
        let arguments = [action, on].concat();
        assert!(self.session.xdotool(&arguments).is_some(), "xdotool {} failed", arguments.join(" "));
    }

    fn wait_for<T>(&self, what: &str, look: impl Fn(&Self) -> Option<T>) -> T {
        let start = Instant::now();
        loop {
            if let Some(found) = look(self) {
                return found;
            }
            let state = if self.is_open() { "is open" } else { "has ended" };
            if start.elapsed() > PATIENCE || !self.is_open() {
                let picture = std::env::temp_dir().join(format!("glint-test-{}.png", self.program.id()));
                let kept = self.session.screen().is_some_and(|screen| screen.save(&picture).is_ok());
                let kept = if kept { format!("; the screen: {}", picture.display()) } else { String::new() };
                panic!("waited for {what}: the program {state} and said: {}{kept}", self.messages());
            }
            std::thread::sleep(PAUSE);
        }
    }
}

impl Drop for Window<'_> {
    fn drop(&mut self) {
        end(&mut self.program);
    }
}

/// Different colours in a picture: one for an empty window, hundreds for a cloud.
pub fn colors(picture: &RgbaImage) -> usize {
    picture.pixels().collect::<std::collections::HashSet<_>>().len()
}

/// Ends a child that may have ended already, and leaves no zombie.
fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_has_a_screen_of_its_own() {
        let (one, other) = (Session::start(), Session::start());
        assert_ne!(one.display, other.display);
        let screen = one.screen().expect("its screen");
        assert_eq!(screen.dimensions(), (1280, 1024));
        assert_eq!(colors(&screen), 1);
    }

    #[test]
    fn the_pointer_goes_where_it_is_sent() {
        let session = Session::start();
        session.xdotool(&["mousemove", "321", "123"]).expect("xdotool moves the pointer");
        let place = session.xdotool(&["getmouselocation"]).expect("xdotool finds the pointer");
        assert!(place.starts_with("x:321 y:123 "), "{place}");
    }
}
