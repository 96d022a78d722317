//! The targets of fuzzing: parsers, and how to make inputs for them.

use std::path::Path;

use crate::dice::Dice;
use crate::mutate::{self, e57, index, las, ply, table, text, words};
use crate::parsers;

/// The most bytes of an input that a mutator makes; more would only cost time.
pub const MOST_BYTES: usize = 256 << 10;

/// A parser, and how to make inputs for it.
pub struct Target {
    /// The name of the target and of its folder of seeds.
    pub name: &'static str,
    /// Parses bytes, with a folder for files, and checks all results. Returns how many points were decoded, or what is
    /// wrong with the results.
    pub(crate) run: fn(&Path, &[u8]) -> Result<u64, String>,
    /// Changes a field of an input.
    pub(crate) mutate: fn(&Dice, &mut Vec<u8>),
    /// Computes the checksums again. With wrong ones, readers refuse an input before they reach its other fields.
    pub(crate) repair: fn(&mut Vec<u8>),
}

/// A target for each parser, and for each part of a file that has fields of its own.
pub const TARGETS: [Target; 20] = [
    Target { name: "las_header", run: parsers::cloud, mutate: |dice, bytes| las::header(dice, bytes), repair: nothing },
    Target { name: "las_records", run: parsers::cloud, mutate: las::records, repair: nothing },
    Target { name: "las_points", run: parsers::cloud, mutate: |dice, bytes| las::points(dice, bytes), repair: nothing },
    Target { name: "laz_chunks", run: parsers::cloud, mutate: |dice, bytes| las::chunks(dice, bytes), repair: nothing },
    Target { name: "copc", run: parsers::cloud, mutate: las::copc, repair: nothing },
    Target { name: "ply_header", run: parsers::cloud, mutate: ply::header, repair: nothing },
    Target { name: "ply_rows", run: parsers::cloud, mutate: ply::rows, repair: nothing },
    Target { name: "e57", run: parsers::cloud, mutate: |dice, bytes| e57::change(dice, bytes), repair: e57::repair },
    Target { name: "pcd", run: parsers::cloud, mutate: table::change, repair: nothing },
    Target { name: "table", run: parsers::cloud, mutate: table::change, repair: nothing },
    Target { name: "ept", run: parsers::ept, mutate: words::ept, repair: nothing },
    Target { name: "catalogue", run: parsers::catalogue, mutate: words::change, repair: nothing },
    Target { name: "answers", run: parsers::answers, mutate: words::answer, repair: nothing },
    Target { name: "index_nodes", run: parsers::index, mutate: index::nodes, repair: index::repair },
    Target { name: "index_pages", run: parsers::index, mutate: index::pages, repair: index::repair },
    Target { name: "index_surfels", run: parsers::index, mutate: index::surfels, repair: index::repair },
    Target { name: "scene", run: parsers::scene, mutate: text::change, repair: nothing },
    Target { name: "view", run: parsers::view, mutate: text::change, repair: nothing },
    Target { name: "plan", run: parsers::plan, mutate: text::change, repair: nothing },
    Target { name: "preferences", run: parsers::preferences, mutate: text::change, repair: nothing },
];

fn nothing(_: &mut Vec<u8>) {}

impl Target {
    pub fn named(name: &str) -> Option<&'static Self> {
        TARGETS.iter().find(|target| target.name == name)
    }

    /// Changes `bytes` in one to five places, mostly fields. Parts of `others` may be copied into it.
    pub fn mutate(&self, dice: &Dice, bytes: &mut Vec<u8>, others: &[Vec<u8>]) {
        for _ in 0..dice.pick(&[1, 1, 1, 2, 2, 3, 5]) {
            match dice.below(12) {
                0 => mutate::flip(dice, bytes),
                1 => mutate::cut(dice, bytes),
                2 => mutate::splice(dice, bytes, others),
                _ => (self.mutate)(dice, bytes),
            }
            bytes.truncate(MOST_BYTES);
        }
        self.restore(dice, bytes);
    }

    /// Computes the checksums again, in all but one of 16 cases.
    pub fn restore(&self, dice: &Dice, bytes: &mut Vec<u8>) {
        if !dice.one_in(16) {
            self.repair(bytes);
        }
    }

    /// Computes the checksums again.
    pub fn repair(&self, bytes: &mut Vec<u8>) {
        (self.repair)(bytes);
    }
}
