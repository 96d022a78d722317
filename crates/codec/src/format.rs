//! The names of the formats that are read, and the endings of their files.

/// The extension that E57 has for normals, and ours for all that it has no name for: prefix and address.
pub const E57_NORMALS: (&str, &str) = ("nor", "http://www.libe57.org/E57_NOR_surface_normals.txt");
pub const E57_OTHERS: (&str, &str) = ("glint", "https://glint.invalid/attributes");

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Las,
    Laz,
    Ply,
    E57,
    Pts,
    Ptx,
    Pcd,
    Xyz,
    Ept,
}

impl Format {
    pub const ALL: [Self; 9] =
        [Self::Las, Self::Laz, Self::Ply, Self::E57, Self::Pts, Self::Ptx, Self::Pcd, Self::Xyz, Self::Ept];

    /// The name in reports, which is also the usual ending of a file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Las => "las",
            Self::Laz => "laz",
            Self::Ply => "ply",
            Self::E57 => "e57",
            Self::Pts => "pts",
            Self::Ptx => "ptx",
            Self::Pcd => "pcd",
            Self::Xyz => "xyz",
            Self::Ept => "ept",
        }
    }

    /// The endings of files that have this format.
    pub fn endings(self) -> &'static [&'static str] {
        match self {
            Self::Las => &["las"],
            Self::Laz => &["laz"],
            Self::Ply => &["ply"],
            Self::E57 => &["e57"],
            Self::Pts => &["pts"],
            Self::Ptx => &["ptx"],
            Self::Pcd => &["pcd"],
            Self::Xyz => &["xyz", "csv", "txt", "asc"],
            // `ept.json`, in a folder of its own.
            Self::Ept => &["json"],
        }
    }

    /// All endings, as dialogs offer them.
    pub fn all_endings() -> impl Iterator<Item = &'static str> {
        Self::ALL.into_iter().flat_map(|format| format.endings().iter().copied())
    }

    /// Whether a file of a folder that has this ending is taken for a cloud. Tables of any content end in `csv` and `txt`,
    /// so only those that end in `xyz` are.
    pub fn is_of_cloud(ending: &str) -> bool {
        Self::ALL.iter().any(|format| ending.eq_ignore_ascii_case(format.name()))
    }
}
