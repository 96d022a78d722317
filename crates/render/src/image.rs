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
    /// The share of the light that is reflected, 0 to 1.
    SpecularIntensity,
    /// Exponent of the highlights of mirrors.
    SpecularPower,
    /// The index of refraction of what is behind a surface through which light goes: above 0 for a solid, below 0 for a
    /// surface that bounds none; 0 for opaque surfaces, and where no reflections are followed.
    Refraction,
    /// World position.
    Position,
    /// Shaded colour before tone mapping, linear RGB.
    Color,
    /// The radiance of direct light, linear RGB; for a mirror, the part that remains beside the reflection.
    Direct,
    /// The radiance of light from the sky and of light that surfaces have reflected before, without reflections, linear
    /// RGB.
    Indirect,
    /// The world position seen by one reflection; coverage.
    MirrorPosition,
    /// The linear RGB of the surface seen by one reflection.
    MirrorAlbedo,
    /// The world normal of the surface seen by one reflection.
    MirrorNormal,
    /// The flags of SSCR's curvature map: 1 convex and 2 hollow along x, 4 and 8 along y, 16 and 32 a step of depth.
    Curvature,
    /// The numbers of SSCR's regions, from 1; 0 outside of all regions.
    Regions,
    /// Why the point seen by one reflection is doubtful: 1 closed from its neighbours, 2 more than a pixel beside the
    /// reflected ray, 3 alone among neighbours that show other surfaces; 0 if it is trusted.
    Uncertain,
}

impl Aov {
    pub const ALL: [Self; 17] = [
        Self::Depth,
        Self::Normal,
        Self::Albedo,
        Self::Mirror,
        Self::SpecularIntensity,
        Self::SpecularPower,
        Self::Refraction,
        Self::Position,
        Self::Color,
        Self::Direct,
        Self::Indirect,
        Self::MirrorPosition,
        Self::MirrorAlbedo,
        Self::MirrorNormal,
        Self::Curvature,
        Self::Regions,
        Self::Uncertain,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Normal => "normal",
            Self::Albedo => "albedo",
            Self::Mirror => "mirror",
            Self::SpecularIntensity => "specular_intensity",
            Self::SpecularPower => "specular_power",
            Self::Refraction => "refraction",
            Self::Position => "position",
            Self::Color => "color",
            Self::Direct => "direct",
            Self::Indirect => "indirect",
            Self::MirrorPosition => "mirror_position",
            Self::MirrorAlbedo => "mirror_albedo",
            Self::MirrorNormal => "mirror_normal",
            Self::Curvature => "curvature",
            Self::Regions => "regions",
            Self::Uncertain => "uncertain",
        }
    }

    /// Whether the image is empty except where a mirror is seen.
    pub(crate) fn is_of_mirrors(self) -> bool {
        use Aov::{Curvature, MirrorAlbedo, MirrorNormal, MirrorPosition, Regions, Uncertain};
        matches!(self, MirrorPosition | MirrorAlbedo | MirrorNormal | Curvature | Regions | Uncertain)
    }

    /// The largest value that the renderer's own image holds, if it is of 16-bit floats and values may be larger.
    pub fn largest(self) -> Option<f32> {
        matches!(self, Self::Color | Self::Direct | Self::Indirect).then_some(65504.0)
    }

    /// The channel names of OpenEXR.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Depth => &["Z"],
            Self::Mirror
            | Self::SpecularIntensity
            | Self::SpecularPower
            | Self::Refraction
            | Self::Curvature
            | Self::Regions
            | Self::Uncertain => &["Y"],
            Self::Albedo | Self::Color | Self::Direct | Self::Indirect | Self::MirrorAlbedo => &["R", "G", "B"],
            Self::MirrorPosition => &["X", "Y", "Z", "A"],
            Self::Normal | Self::Position | Self::MirrorNormal => &["X", "Y", "Z"],
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
