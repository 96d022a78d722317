//! What is fuzzed: a parser, and how to make inputs for it.

use std::path::Path;

use crate::dice::Dice;
use crate::mutate::{self, index, las, ply, text};
use crate::parsers;

/// Bytes that a mutator makes, at most: more only costs time.
pub const MOST_BYTES: usize = 256 << 10;

/// A parser, and how to make inputs for it.
pub struct Target {
    /// Also the name of its folder of seeds.
    pub name: &'static str,
    /// Parses bytes, with a folder for files, and looks at all that comes of them: how many points were decoded, or what is
    /// wrong with them.
    pub(crate) run: fn(&Path, &[u8]) -> Result<u64, String>,
    /// Changes a field.
    pub(crate) mutate: fn(&Dice, &mut Vec<u8>),
    /// Writes the checksums anew, without which nothing behind them is ever reached.
    pub(crate) repair: fn(&mut Vec<u8>),
}

/// One for each parser, and for each part of a file that has fields of its own.
pub const TARGETS: [Target; 14] = [
    Target { name: "las_header", run: parsers::cloud, mutate: |dice, bytes| las::header(dice, bytes), repair: nothing },
    Target { name: "las_records", run: parsers::cloud, mutate: las::records, repair: nothing },
    Target { name: "las_points", run: parsers::cloud, mutate: |dice, bytes| las::points(dice, bytes), repair: nothing },
    Target { name: "laz_chunks", run: parsers::cloud, mutate: |dice, bytes| las::chunks(dice, bytes), repair: nothing },
    Target { name: "copc", run: parsers::cloud, mutate: las::copc, repair: nothing },
    Target { name: "ply_header", run: parsers::cloud, mutate: ply::header, repair: nothing },
    Target { name: "ply_rows", run: parsers::cloud, mutate: ply::rows, repair: nothing },
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

    /// Changes `bytes` in one to five places, mostly fields. `others` are inputs that parts may come from.
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

    /// Mostly writes the checksums anew.
    pub fn restore(&self, dice: &Dice, bytes: &mut Vec<u8>) {
        if !dice.one_in(16) {
            self.repair(bytes);
        }
    }

    /// Writes the checksums anew.
    pub fn repair(&self, bytes: &mut Vec<u8>) {
        (self.repair)(bytes);
    }
}
