//! Uses the window at random, as `cargo xtask soak` says: keys, clicks, drags, the wheel, rows of the palette, files
//! that are opened and closed. Writes what the program takes meanwhile to a table and a chart, and fails where the program
//! ends by itself, does not answer, or takes more and more memory or handles.
//!
//! Arguments: minutes, the seed of the actions, the folder of the results.

use std::fmt::Write as _;
use std::fs::File;
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use cloud::Random;
use tests::{Session, Window, test_data};

/// The scene that the window comes back to before its memory is compared with that of earlier times.
const HOME: &str = "home.toml";
const HOME_SCENE: &str = "clouds = [\"five-mirrors/sphere\"]\n[parameters]\n\"scene.points\" = 20000\n";

/// How many actions lie between two returns to that scene.
const ACTIONS_BETWEEN: usize = 60;

/// How long the window may take to show it again once it is opened, and how often the palette is asked for it.
const PATIENCE: Duration = Duration::from_secs(120);
const ATTEMPTS: usize = 3;

/// What the program may take more at the end than a quarter of the time after its start: a share and MB of memory, and
/// handles. Compiled passes and caches with limits of their own fill in between.
const MORE_MEMORY: (f64, f64) = (0.25, 100.0);
const MORE_HANDLES: f64 = 16.0;

/// Keys that do not end the program, do not fill the screen and record nothing, in xdotool's names.
const KEYS: &str = "1 2 3 4 5 6 7 8 9 0 Home r n o z shift+z f v l shift+l u plus minus b p k j shift+j ctrl+j g t y \
    ctrl+d Delete m i alt+1 alt+2 alt+3 alt+4 alt+5 alt+6 alt+7 alt+8 alt+9 alt+0 Return BackSpace shift+n shift+i \
    period comma shift+x shift+F3 ctrl+F3 alt+F3 c ctrl+t space Escape Escape ctrl+z ctrl+shift+z ctrl+p F2 F1 Tab \
    shift+Tab KP_1 KP_3 KP_5 KP_7 ctrl+1 ctrl+6 ctrl+8 Prior Next F12 ctrl+c ctrl+v ctrl+shift+c ctrl+s ctrl+e ctrl+F12 \
    ctrl+period ctrl+shift+1 shift+1 Up Down Left Right";

/// Keys that act while they are down.
const HELD: &str = "w a s d q e h x F3 Left Right Up Down";

/// What is searched for in the palette.
const WORDS: [&str; 16] = [
    "add a mirror",
    "light",
    "use",
    "preset",
    "sweep",
    "clips",
    "profiles",
    "ghosts",
    "compare",
    "truth",
    "tab",
    "paths",
    "open five",
    "bounces",
    "reset",
    "close",
];

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let parsed = match arguments.as_slice() {
        [minutes, seed, folder] => minutes.parse().ok().zip(seed.parse().ok()).zip(Some(PathBuf::from(folder))),
        _ => None,
    };
    let Some(((minutes, seed), folder)) = parsed else {
        eprintln!("soak: use MINUTES SEED FOLDER");
        return ExitCode::from(2);
    };
    std::fs::create_dir_all(&folder).expect("the folder of the results");
    let mut soak = Soak::new(minutes, seed);
    let result = std::panic::catch_unwind(AssertUnwindSafe(|| soak.run()));
    soak.write(&folder);
    let problems = match result {
        Ok(()) => soak.growth(),
        Err(_) => vec!["the window was lost, or did not answer; the actions until then are in soak.csv".to_owned()],
    };
    println!("{}", soak.summary(seed, &folder));
    problems.iter().for_each(|problem| println!("soak: {problem}"));
    if problems.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// What the program took after an action.
#[derive(Default)]
struct Sample {
    seconds: f64,
    action: String,
    /// Whether the window had just come back to [`HOME`].
    is_home: bool,
    /// Resident memory, MB.
    memory: f64,
    handles: usize,
    threads: usize,
    /// Pictures since the sample before, and the longest time of one of them while something moved, milliseconds.
    frames: usize,
    longest: f64,
}

/// What a strip of the chart shows of a sample.
type Strip = fn(&Sample) -> f64;

struct Soak {
    time: Duration,
    random: Random,
    start: Instant,
    samples: Vec<Sample>,
}

impl Soak {
    fn new(minutes: f64, seed: u64) -> Self {
        let time = Duration::from_secs_f64(60.0 * minutes);
        Self { time, random: Random(seed), start: Instant::now(), samples: Vec::new() }
    }

    fn run(&mut self) {
        let session = Session::start();
        let files = files(&session);
        session.folder.write(HOME, HOME_SCENE);
        let window = session.open([HOME]);
        window.wait_for_event("settled", 0, |_| true);
        self.start = Instant::now();
        while self.start.elapsed() < self.time {
            for _ in 0..ACTIONS_BETWEEN {
                // What was done last is known even where the window is lost by it.
                let action = self.next_action(&files);
                self.note(action.to_string(), false);
                action.carry_out(&window);
                self.measure(&session, &window);
                assert!(window.is_open(), "after {action}, the program ended: {}", window.messages());
                assert!(!window.messages().contains("panicked"), "after {action}: {}", window.messages());
                if self.start.elapsed() > self.time {
                    break;
                }
            }
            self.note("home".into(), true);
            go_home(&session, &window);
            self.measure(&session, &window);
        }
        assert!(window.quit_and_discard().success(), "the program ended with an error");
    }

    fn below(&mut self, end: usize) -> usize {
        self.random.below(end as u64) as usize
    }

    fn one_of<'a>(&mut self, words: &'a str) -> &'a str {
        let words: Vec<&str> = words.split_whitespace().collect();
        words[self.below(words.len())]
    }

    /// A place in the window: mostly of the picture, else of the panel at the left.
    fn place(&mut self) -> [i32; 2] {
        let (left, width) = if self.below(3) == 0 { (5, 290) } else { (320, 940) };
        [left + self.below(width) as i32, 5 + self.below(700) as i32]
    }

    fn next_action(&mut self, files: &[String]) -> Action {
        match self.below(100) {
            0..40 => Action::Press(self.one_of(KEYS).into()),
            40..50 => Action::Hold(self.one_of(HELD).into(), 200 + self.below(600) as u64),
            50..65 => Action::Click([1, 1, 1, 3][self.below(4)], self.place()),
            65..80 => Action::Drag([1, 1, 2, 3][self.below(4)], self.place(), self.place()),
            80..87 => Action::Turn([4, 5][self.below(2)], 1 + self.below(4), self.place()),
            87..94 => Action::Search(WORDS[self.below(WORDS.len())], self.below(4)),
            _ => Action::Open(files[self.below(files.len())].clone()),
        }
    }

    /// Adds a sample for what is about to happen.
    fn note(&mut self, action: String, is_home: bool) {
        let seconds = self.start.elapsed().as_secs_f64();
        self.samples.push(Sample { seconds, action, is_home, ..Sample::default() });
    }

    /// Fills the last sample with what the program takes now, and with the pictures since the one before.
    fn measure(&mut self, session: &Session, window: &Window<'_>) {
        let Some(sample) = self.samples.last_mut() else { return };
        let process = PathBuf::from("/proc").join(window.process().to_string());
        let entries = |name: &str| std::fs::read_dir(process.join(name)).map_or(0, Iterator::count);
        let status = std::fs::read_to_string(process.join("status")).unwrap_or_default();
        let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kibibytes: Option<f64> = resident.and_then(|line| line.split_whitespace().next()?.parse().ok());
        sample.memory = kibibytes.unwrap_or(0.0) / 1024.0;
        (sample.handles, sample.threads) = (entries("fd"), entries("task"));
        for event in window.events().iter().filter(|event| event["event"] == "frame") {
            sample.frames += 1;
            if event["moving"] == true {
                sample.longest = event["ms"].as_f64().unwrap_or(0.0).max(sample.longest);
            }
        }
        // The program appends to the file, so an emptied one goes on with the next event.
        let log = File::options().write(true).open(session.folder.path("events.jsonl"));
        log.and_then(|log| log.set_len(0)).expect("the log of events");
    }

    /// In which way the program takes more at the end than early on, by the times at which it showed the same scene.
    fn growth(&self) -> Vec<String> {
        let homes: Vec<&Sample> = self.samples.iter().filter(|sample| sample.is_home).collect();
        let quarter = homes.len() / 4;
        if quarter == 0 {
            println!("soak: too short to judge growth: the window came back to its first scene {} times", homes.len());
            return Vec::new();
        }
        let (early, late) = (&homes[quarter..2 * quarter], &homes[homes.len() - quarter..]);
        let memory = [early, late].map(|part| median(part.iter().map(|sample| sample.memory)));
        let handles = [early, late].map(|part| median(part.iter().map(|sample| sample.handles as f64)));
        let mut problems = Vec::new();
        if memory[1] > memory[0] * (1.0 + MORE_MEMORY.0) + MORE_MEMORY.1 {
            problems.push(format!("memory grew from {:.0} to {:.0} MB with the same scene", memory[0], memory[1]));
        }
        if handles[1] > handles[0] + MORE_HANDLES {
            problems.push(format!("open files grew from {} to {} with the same scene", handles[0], handles[1]));
        }
        problems
    }

    fn summary(&self, seed: u64, folder: &Path) -> String {
        let last = self.samples.last().map_or(0.0, |sample| sample.seconds);
        let homes = || self.samples.iter().filter(|sample| sample.is_home);
        let ends = |of: Strip| [homes().next(), homes().next_back()].map(|sample| sample.map_or(0.0, of));
        let ([memory, memory_then], [handles, handles_then]) = (ends(|one| one.memory), ends(|one| one.handles as f64));
        let most = self.samples.iter().map(|sample| sample.memory).fold(0.0, f64::max);
        let longest = self.samples.iter().map(|sample| sample.longest).fold(0.0, f64::max);
        let frames: usize = self.samples.iter().map(|sample| sample.frames).sum();
        format!(
            "soak: {} actions in {:.1} minutes (seed {seed}), {frames} pictures, the longest moving one {longest:.0} ms\n\
             soak: with the first scene again, at first and at last: {memory:.0} and {memory_then:.0} MB, {handles} and \
             {handles_then} handles; at most {most:.0} MB\n\
             soak: {}",
            self.samples.len(),
            last / 60.0,
            folder.join("soak.csv").display()
        )
    }

    fn write(&self, folder: &Path) {
        let mut table = "seconds,action,is_home,memory_mb,handles,threads,pictures,longest_moving_ms\n".to_owned();
        for Sample { seconds, action, is_home, memory, handles, threads, frames, longest } in &self.samples {
            let line =
                format!("{seconds:.1},{action},{is_home},{memory:.0},{handles},{threads},{frames},{longest:.0}\n");
            table += &line;
        }
        std::fs::write(folder.join("soak.csv"), table).expect("the table of the results");
        std::fs::write(folder.join("soak.svg"), self.chart()).expect("the chart of the results");
    }

    /// Memory, handles and the longest moving pictures over the minutes, each in a strip of its own.
    fn chart(&self) -> String {
        let strips: [(&str, Strip); 3] = [
            ("memory, MB", |sample| sample.memory),
            ("handles", |sample| sample.handles as f64),
            ("longest moving picture, ms", |sample| sample.longest),
        ];
        let end = self.samples.last().map_or(1.0, |sample| sample.seconds.max(1.0));
        let mut svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"900\" height=\"600\" \
                       font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"900\" height=\"600\" fill=\"white\"/>\n"
            .to_owned();
        for (row, (name, value)) in strips.iter().enumerate() {
            let (top, most) = (190 * row + 30, self.samples.iter().map(value).fold(1.0, f64::max));
            let place = |sample: &Sample| {
                let (x, y) = (70.0 + 810.0 * sample.seconds / end, (top + 150) as f64 - 140.0 * value(sample) / most);
                format!("{x:.1},{y:.1}")
            };
            let line: Vec<String> = self.samples.iter().map(place).collect();
            let _ = writeln!(
                svg,
                "<text x=\"70\" y=\"{top}\">{name}: up to {most:.0}, over {:.0} minutes</text>\n<path d=\"M70 {} v140 \
                 h810\" fill=\"none\" stroke=\"gray\"/>\n<polyline points=\"{}\" fill=\"none\" stroke=\"#1f6fb4\"/>",
                end / 60.0,
                top + 10,
                line.join(" ")
            );
            for home in self.samples.iter().filter(|sample| sample.is_home) {
                let at = place(home);
                let (x, y) = at.split_once(',').expect("two numbers");
                let _ = writeln!(svg, "<circle cx=\"{x}\" cy=\"{y}\" r=\"3\" fill=\"#c0392b\"/>");
            }
        }
        svg + "</svg>\n"
    }
}

/// What a person does.
enum Action {
    Press(String),
    /// A key, and for how many milliseconds it is down.
    Hold(String, u64),
    Click(u8, [i32; 2]),
    Drag(u8, [i32; 2], [i32; 2]),
    /// The wheel, by so many steps at a place.
    Turn(u8, usize, [i32; 2]),
    /// Words for the palette, and how many rows below the first one is taken.
    Search(&'static str, usize),
    Open(String),
}

impl std::fmt::Display for Action {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Press(key) => write!(formatter, "press {key}"),
            Self::Hold(key, time) => write!(formatter, "hold {key} for {time} ms"),
            Self::Click(button, [x, y]) => write!(formatter, "click {button} at {x} {y}"),
            Self::Drag(button, [x, y], [to_x, to_y]) => {
                write!(formatter, "drag {button} from {x} {y} to {to_x} {to_y}")
            }
            Self::Turn(button, steps, [x, y]) => write!(formatter, "turn {button} by {steps} at {x} {y}"),
            Self::Search(words, row) => write!(formatter, "search {words} and take row {row}"),
            Self::Open(file) => write!(formatter, "open {file}"),
        }
    }
}

impl Action {
    fn carry_out(&self, window: &Window<'_>) {
        match self {
            Self::Press(key) => window.press(key),
            Self::Hold(key, time) => {
                window.hold(key);
                std::thread::sleep(Duration::from_millis(*time));
                window.release(key);
            }
            Self::Click(button, at) => window.click(*button, *at),
            Self::Drag(button, from, to) => window.drag(*button, *from, *to),
            Self::Turn(button, steps, at) => (0..*steps).for_each(|_| window.click(*button, *at)),
            Self::Search(words, row) => {
                window.press("Escape Escape ctrl+p");
                window.type_text(words);
                (0..*row).for_each(|_| window.press("Down"));
                window.press("Return");
            }
            Self::Open(file) => {
                window.press("Escape Escape ctrl+shift+o");
                window.type_text(file);
                window.press("Return");
            }
        }
        // A person looks at what came of it.
        std::thread::sleep(Duration::from_millis(150));
    }
}

/// Opens the first scene anew, and waits until it is shown. What a dialog asks on the way is answered as a person does who
/// wants to be rid of it.
fn go_home(session: &Session, window: &Window<'_>) {
    for _ in 0..ATTEMPTS {
        session.folder.write(HOME, HOME_SCENE);
        window.press("Escape Escape Escape ctrl+p");
        // The row that closes what is open; a path that is typed would be opened beside it.
        window.type_text(&format!("open: {HOME}"));
        window.press("Return");
        let asked_for = Instant::now();
        let (mut is_answered, mut is_opened) = (false, false);
        while asked_for.elapsed() < if is_opened { PATIENCE } else { PATIENCE / 4 } {
            let events = window.events();
            let first = |name: &str| events.iter().position(|event| event["event"] == name);
            if !is_answered && first("asked").is_some() {
                // "Save" has the keyboard at first, and "Discard" follows.
                std::thread::sleep(Duration::from_secs(1));
                window.press("Tab Return");
                is_answered = true;
            }
            let opened = first("opened");
            is_opened = opened.is_some();
            if opened.is_some_and(|at| events[at..].iter().any(|event| event["event"] == "settled")) {
                return;
            }
            std::thread::sleep(Duration::from_millis(200));
        }
    }
    let picture = std::env::temp_dir().join("glint-soak.png");
    let is_kept = window.screenshot().save(&picture).is_ok();
    let kept = if is_kept { format!("; the window: {}", picture.display()) } else { String::new() };
    panic!("the first scene does not come back: {}{kept}", window.messages());
}

/// Writes small files to open: sound ones of several formats, a damaged one and one that is missing. Real ones are added
/// where they are found.
fn files(session: &Session) -> Vec<String> {
    let points = |count: usize| -> String {
        let line = |i: usize| format!("{} {} {} {}\n", i % 50, i / 50, (i % 7) as f64 * 0.25, i % 256);
        (0..count).map(line).collect()
    };
    session.folder.write("table.xyz", points(2500));
    session.folder.write("broken.las", b"LASF and nothing more");
    let header = "ply\nformat ascii 1.0\nelement vertex 900\nproperty float x\nproperty float y\nproperty float z\n\
                  property uchar intensity\nend_header\n";
    session.folder.write("square.ply", header.to_owned() + &points(900));
    let mut files: Vec<String> =
        ["table.xyz", "square.ply", "broken.las", "missing.laz", "five-mirrors/all", "courtyard/pool"]
            .map(str::to_owned)
            .into();
    if let Some(data) = test_data() {
        for name in [
            "copc/lone_star_las14_pf6.copc.laz",
            "e57/pump_structured_scan_rgb_intensity.e57",
            "las_matrix/las12_pf2_color.las",
        ] {
            let path = data.join(name);
            files.extend(path.is_file().then(|| path.display().to_string()));
        }
    }
    files
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
