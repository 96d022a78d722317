//! Arbitrary output variables: the frame's linear float images, read back.

/// An image besides the picture. Linear, full float; NaN where a pixel is empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aov {
    /// Linear depth, world units.
    Depth,
    /// World normal, towards the eye.
    Normal,
    /// Linear RGB.
    Albedo,
    /// 1 where the specular intensity is above 0, else 0.
    Mirror,
    /// World position.
    Position,
    /// Shaded colour before tone mapping, linear RGB.
    Color,
}

impl Aov {
    pub const ALL: [Self; 6] = [Self::Depth, Self::Normal, Self::Albedo, Self::Mirror, Self::Position, Self::Color];

    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Normal => "normal",
            Self::Albedo => "albedo",
            Self::Mirror => "mirror",
            Self::Position => "position",
            Self::Color => "color",
        }
    }

    /// Channel names as OpenEXR has them.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Depth => &["Z"],
            Self::Mirror => &["Y"],
            Self::Albedo | Self::Color => &["R", "G", "B"],
            Self::Normal | Self::Position => &["X", "Y", "Z"],
        }
    }
}

/// A float image: rows top to bottom, channels interleaved.
#[derive(Clone, Debug)]
pub struct AovImage {
    pub size: [u32; 2],
    pub channels: &'static [&'static str],
    pub data: Vec<f32>,
}
