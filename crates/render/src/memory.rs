//! Tests: what images and buffers of the picture's size each method needs, for docs/gpu.md, and that it gives them up when
//! another method is chosen.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::Arc;

use scene::{METHODS, Method, Settings};

use crate::allocation::tests::made;
use crate::gi::LightReuse;
use crate::gpu::{Error, Gpu};
use crate::reflection::sscr::threads;
use crate::rehearsal::Cast;
use crate::renderer::Renderer;

/// Two sizes: what grows with the picture's pixels differs between them.
const SIZES: [[u32; 2]; 2] = [[256, 256], [512, 512]];
const MORE_PIXELS: u64 = 512 * 512 - 256 * 256;

/// A frame with a formula mirror, a lamp and indirect light, as the method is by default.
fn cast(method: Method) -> Cast {
    let mut settings = Settings::default();
    settings.reflection.method = method;
    // Bent mirrors need squares of the picture.
    settings.sample_cameras.analytic = false;
    Cast {
        settings,
        lights: 1,
        clues: scene::LightClues::default(),
        mirrors: [true, false, false],
        has_highlights: false,
        clear: [false; 2],
        filters: false,
        own_methods: Vec::new(),
        has_near: false,
        moves: false,
        light_reuse: LightReuse::Never,
    }
}

/// Makes what frames of some methods need, one after the other.
fn rehearsed(gpu: &Arc<Gpu>, methods: &[Method], size: [u32; 2]) -> Renderer {
    let mut renderer = Renderer::bare(gpu.clone());
    for method in methods {
        let cast = cast(*method);
        let stage = renderer.stage(&cast, &cast.settings).unwrap();
        match renderer.missing_at(&stage, size) {
            Ok(_) | Err(Error::GivenUp) => {}
            Err(error) => panic!("{error}"),
        }
    }
    renderer
}

/// The bytes for each pixel that a method's frame makes, by label.
fn bytes_of_a_pixel(gpu: &Arc<Gpu>, method: Method) -> BTreeMap<String, f64> {
    let [small, large] = SIZES.map(|size| {
        made();
        rehearsed(gpu, &[method], size);
        made()
    });
    let each = |(label, bytes): (String, u64)| {
        let more = bytes.saturating_sub(small.get(&label).copied().unwrap_or(0));
        (label, more as f64 / MORE_PIXELS as f64)
    };
    large.into_iter().map(each).filter(|(_, bytes)| *bytes > 0.01).collect()
}

#[test]
fn a_method_that_is_left_gives_up_its_images() {
    let Some(gpu) = Gpu::for_test() else { return };
    let grows_by = |methods: &[Method]| {
        let [small, large] = SIZES.map(|size| {
            let renderer = rehearsed(&gpu, methods, size);
            renderer.reflections.map_or(0, |reflections| reflections.bytes())
        });
        large - small
    };
    let alone = grows_by(&[Method::None]);
    for row in METHODS.iter().filter(|row| row.method.chosen() == row.method && row.method != Method::None) {
        let (with, left) = (grows_by(&[row.method]), grows_by(&[row.method, Method::None]));
        assert!(with > alone, "{}: {with}", row.name);
        // The lists of nodes belong to the trees over the points.
        let lists = if row.method == Method::SscrHierarchical { left - alone } else { 0 };
        assert!(left == alone + lists && left * 3 < with, "{}: {left} bytes of {with} stay", row.name);
    }
}

/// The parts of docs/gpu.md about memory and about regions.
pub(crate) fn page(gpu: &Arc<Gpu>) -> String {
    let mut page = String::from(
        "\n## Memory\n\n\
         Bytes for each pixel of the picture: what a frame with a mirror, a lamp and indirect light makes at the default\n\
         settings. Images of a method are given up in the first frame that does not use it: all but the first column's and the\n\
         lists of nodes. The trees over the points (20 bytes a point) and the maps around mirrors stay. `sscr` and\n\
         `sample_cameras` sum what they find in the sums of the camera's surface. A picture for which there is no memory is\n\
         an error that says so. `sample_cameras` needs less if all mirrors are planes and balls that are drawn by their formula.\n\n\
         | image or buffer | every frame |",
    );
    let common = bytes_of_a_pixel(gpu, Method::None);
    let rows: Vec<_> = METHODS
        .iter()
        .filter(|row| row.method.chosen() == row.method && row.method != Method::None)
        .map(|row| (row.name, bytes_of_a_pixel(gpu, row.method)))
        .collect();
    rows.iter().for_each(|(name, _)| page.extend([" `", name, "` |"]));
    page.push_str("\n|---|---|");
    rows.iter().for_each(|_| page.push_str("---|"));
    let mut labels: Vec<&String> = common.keys().chain(rows.iter().flat_map(|(_, made)| made.keys())).collect();
    labels.sort();
    labels.dedup();
    for label in labels {
        let own = common.get(label).copied().unwrap_or(0.0);
        let _ = write!(page, "\n| {label} | {} |", shown(own));
        for (_, made) in &rows {
            let _ = write!(page, " {} |", shown(made.get(label).copied().unwrap_or(0.0) - own));
        }
    }
    let total = |made: &BTreeMap<String, f64>| made.values().sum::<f64>();
    let _ = write!(page, "\n| all together | {} |", shown(total(&common)));
    for (_, made) in &rows {
        let _ = write!(page, " {} |", shown(total(made)));
    }
    let gigabytes = |made: &BTreeMap<String, f64>| total(made) * 3840.0 * 2160.0 / 1e9;
    let _ = write!(page, "\n| GB at 3840 x 2160 | {:.2} |", gigabytes(&common));
    for (_, made) in &rows {
        let _ = write!(page, " {:.2} |", gigabytes(made));
    }
    page.push('\n');
    page + &labelling()
}

fn shown(bytes: f64) -> String {
    if bytes.abs() < 0.01 { String::new() } else { format!("{bytes:.1}").trim_end_matches(".0").to_owned() }
}

/// What the labelling of regions costs where many threads work at once.
fn labelling() -> String {
    let mut part = String::from(
        "\n## Labels\n\n\
         `sscr` labels the regions of mirrors by trees of pixels. Software Vulkan runs one workgroup after the other; on a GPU\n\
         thousands of threads walk up trees that others have not joined yet. The table is of a simulation in which so many\n\
         threads take one step of memory each in turn, in a picture of 960 x 536 pixels. The labels are the same in all. Tiles of\n\
         8 x 8 pixels are joined in workgroup memory first, and a workgroup adds up the pixels of its first region.\n\n\
         | threads at once | loads a pixel, by pixels | in tiles | longest way, by pixels | in tiles | most atomics on a word, by pixels | in tiles |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let size = glam::UVec2::new(960, 536);
    let inside = threads::regions(size);
    let pixels = inside.iter().filter(|is_inside| **is_inside).count() as f64;
    for live in [64, 27_000, 270_000] {
        let [before, after] = [false, true].map(|in_tiles| threads::label(&inside, size, live, in_tiles));
        assert!(before.labels == after.labels);
        let each = |loads: u64| loads as f64 / pixels;
        let _ = writeln!(
            part,
            "| {live} | {:.0} | {:.1} | {} | {} | {} | {} |",
            each(before.loads),
            each(after.loads),
            before.longest_way,
            after.longest_way,
            before.most_on_a_word,
            after.most_on_a_word
        );
    }
    part
}
