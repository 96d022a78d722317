//! Small files made from people's reports, each with the right value (docs/real_files.md). They lie in the folder `cases`
//! beside that of the real files.

mod cases {
    pub mod attributes;
    pub mod readers;
    pub mod units;
    pub mod writers;
}

use std::path::PathBuf;

/// The folder of the cases. `None`, with a note, where it is missing and no test data is required.
pub fn folder() -> Option<PathBuf> {
    let data = tests::test_data()?;
    let folder = data.parent().expect("a folder with a parent").join("cases");
    if !folder.is_dir() {
        println!("skipped: no cases at {}", folder.display());
        return None;
    }
    Some(folder)
}
