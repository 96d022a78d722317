//! The error of a picture against the still picture: the same view at full resolution with all points, 1024 virtual
//! lights that light every pixel, and `surfel_trace`, with mirrors by their formulas where they have one. So it holds
//! the errors of resolution, points, lights and method. `auto` shares the lights of large ones among pixels. Where rays
//! bring light, it has all of them, and lights are shared where they end as the settings say.

use std::str::FromStr;

use glam::{DVec3, Vec3};
use palette::Lab;
use palette::color_difference::Ciede2000 as _;
use palette::white_point::D65;
use rayon::prelude::*;
use render::{Aov, Renderer};
use scene::{Camera, IndirectBy, Method, MirrorSurface, Projection, Settings};
use serde::{Deserialize, Serialize};
use trace::linear_from_srgb;

use crate::metrics::{MirrorPixel, lab, pixel_error};
use crate::picture::enlarged;

/// The virtual lights of each bounce, and of the sky, of the still picture.
pub const STILL_LIGHTS: u32 = 1024;

/// The error of a pixel that shows nothing where there is something, or something where there is nothing.
const WRONG: f64 = 1e4;

/// The CIEDE2000 differences of a part of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColorError {
    pub mean: f64,
    /// The 95th percentile.
    pub p95: f64,
}

impl ColorError {
    /// The error of these differences; `None` if there are no pixels.
    fn of(mut differences: Vec<f64>) -> Option<Self> {
        let mean = differences.iter().sum::<f64>() / differences.len() as f64;
        percentile_95(&mut differences).map(|p95| Self { mean, p95 })
    }
}

/// How far a picture is from the still picture. Colours count where a pixel shows something in one of the two pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StillError {
    /// The mean CIEDE2000 difference of all pixels.
    pub delta_e: f64,
    /// The colours of the pixels that are mirrors in the still picture; `None` if there are none.
    pub mirrors: Option<ColorError>,
    /// The colours of the other pixels; `None` if there are none.
    pub rest: Option<ColorError>,
    /// The 95th percentile of the pixel errors of mirror pixels, in pixels of the still picture. Of a view without
    /// mirrors: that of the distances between the centre of a pixel and of the drawn pixel that it shows.
    pub pixels: f64,
}

impl StillError {
    /// The means of the mirrors' colours and of the rest's; 0 where there are no such pixels.
    pub fn means(&self) -> [f64; 2] {
        [self.mirrors, self.rest].map(|part| part.map_or(0.0, |part| part.mean))
    }

    /// The error of colours that counts: the worse of the two means. The mean of all pixels would call a ball right that
    /// stays grey, as long as it is small in the picture.
    pub fn worse_delta_e(&self) -> f64 {
        self.means().into_iter().fold(0.0, f64::max)
    }
}

/// The 95th percentile by rank; `None` of no values.
fn percentile_95(values: &mut [f64]) -> Option<f64> {
    let rank = ((values.len() as f64 * 0.95).ceil() as usize).checked_sub(1)?;
    Some(*values.select_nth_unstable_by(rank, f64::total_cmp).1)
}

/// The settings of the still picture, from those of a picture. All its reflections are followed.
pub fn still_settings(settings: &Settings) -> Settings {
    let mut still = settings.clone();
    (still.reflection.method, still.reflection.own_methods) = (Method::SurfelTrace, false);
    (still.view.resolution, still.splat.step, still.reflection.least_weight) = (1.0, 1, 0.0);
    let gi = &mut still.gi;
    (gi.vpls, gi.sky_lights) = (gi.vpls.max(STILL_LIGHTS), gi.sky_lights.max(STILL_LIGHTS));
    // Where rays end, lights are averaged over all rays of a window.
    if gi.by == IndirectBy::Lights {
        gi.interleave = 1;
    }
    still
}

/// The settings of the still picture as one that judges others: mirrors that have a formula are drawn by it, unless the
/// settings say how, since what a person sees of a mirror's points is an error, too.
pub fn judging_settings(settings: &Settings) -> Settings {
    let mut still = still_settings(settings);
    if still.mirror.surface == MirrorSurface::Auto {
        still.mirror.surface = MirrorSurface::Exact;
    }
    still
}

/// The size in which a picture of `size` pixels is drawn before it is enlarged.
pub fn drawn_size(size: [u32; 2], settings: &Settings) -> [u32; 2] {
    size.map(|side| ((f64::from(side) * f64::from(settings.view.resolution)).round() as u32).max(1))
}

/// A frame that was drawn, as far as errors follow from it.
pub struct Shown {
    size: [u32; 2],
    /// Red, green, blue and opacity as on a screen.
    picture: Vec<u8>,
    depth: Vec<f32>,
    /// The positions seen in mirrors, relative to the eye, and the coverage; none where no reflections were looked for.
    found: Option<Vec<f32>>,
}

impl Shown {
    /// Takes the frame that was rendered last; `size` is that in which it was drawn.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn read(renderer: &Renderer, camera: &Camera, settings: &Settings, size: [u32; 2]) -> render::Result<Self> {
        let is_reflected = settings.reflection.method != Method::None && settings.reflection.bounces > 0;
        let found = is_reflected.then(|| renderer.read_aov_from(Aov::MirrorPosition, camera.eye));
        let depth = renderer.read_aov(Aov::Depth)?.data;
        Ok(Self { size, picture: renderer.read_picture()?, depth, found: found.transpose()?.map(|image| image.data) })
    }

    /// The frame with other positions seen in mirrors, four values a pixel, the first three relative to a place that is
    /// `offset` from the eye.
    pub fn finding(self, found: &[f32], offset: DVec3) -> Self {
        let from_eye = |[x, y, z, coverage]: &[f32; 4]| {
            let [x, y, z] = (Vec3::new(*x, *y, *z).as_dvec3() + offset).as_vec3().to_array();
            [x, y, z, *coverage]
        };
        Self { found: Some(found.as_chunks::<4>().0.iter().flat_map(from_eye).collect()), ..self }
    }

    /// The index of the pixel that shows what pixel `index` of a picture of `size` shows.
    fn place(&self, index: usize, size: [u32; 2]) -> usize {
        let (column, row) = (index % size[0] as usize, index / size[0] as usize);
        let along = |at: usize, axis: usize| at * self.size[axis] as usize / size[axis] as usize;
        along(row, 1) * self.size[0] as usize + along(column, 0)
    }

    fn found(&self, index: usize) -> (DVec3, f64) {
        let Some(found) = &self.found else { return (DVec3::NAN, 0.0) };
        let [x, y, z, coverage] = [0, 1, 2, 3].map(|channel| f64::from(found[index * 4 + channel]));
        // An empty pixel may have a coverage of NaN as well as of 0.
        (DVec3::new(x, y, z), if coverage > 0.0 { coverage } else { 0.0 })
    }
}

/// The still picture.
pub struct Still {
    shown: Shown,
    colors: Vec<Lab<D65, f64>>,
    /// The mirror's points and what they see, `None` where there is no mirror.
    mirrors: Vec<Option<MirrorPixel>>,
}

impl Still {
    /// Takes the frame that was rendered last, with the settings of a still picture.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn read(renderer: &Renderer, camera: &Camera, settings: &Settings, size: [u32; 2]) -> render::Result<Self> {
        let shown = Shown::read(renderer, camera, settings, size)?;
        let mirror = renderer.read_aov(Aov::Mirror)?.data;
        let position = renderer.read_aov_from(Aov::Position, camera.eye)?.data;
        let pixel = |(index, position): (usize, &[f32; 3])| {
            let position = Vec3::from(*position).as_dvec3();
            let (found, coverage) = shown.found(index);
            let incoming = match settings.view.projection {
                Projection::Perspective => position.normalize_or_zero(),
                Projection::Orthographic => camera.forward(),
            };
            let truth = (coverage > 0.0).then_some(found);
            let reflected = truth.map_or(DVec3::ZERO, |truth| (truth - position).normalize_or_zero());
            (mirror[index] > 0.0).then_some(MirrorPixel { position, incoming, reflected, found, coverage, truth })
        };
        let mirrors = position.as_chunks::<3>().0.iter().enumerate().map(pixel).collect();
        Ok(Self { colors: colors(&shown.picture), shown, mirrors })
    }

    /// Whether a mirror is seen.
    pub fn has_mirrors(&self) -> bool {
        self.mirrors.iter().any(Option::is_some)
    }

    /// The error of the frame that was rendered last, of the same view; `size` is that in which it was drawn.
    ///
    /// # Errors
    /// Nothing was rendered yet, or the device was lost.
    pub fn error(
        &self,
        renderer: &Renderer,
        camera: &Camera,
        settings: &Settings,
        size: [u32; 2],
    ) -> render::Result<StillError> {
        let shown = Shown::read(renderer, camera, settings, size)?;
        Ok(self.error_of(&shown))
    }

    /// The error of the still picture itself.
    pub fn none(&self) -> StillError {
        self.error_of(&self.shown)
    }

    /// The error of a frame of the same view.
    pub fn error_of(&self, shown: &Shown) -> StillError {
        let [mirrors, rest] = self.differences(shown);
        let count = (mirrors.len() + rest.len()).max(1) as f64;
        let delta_e = mirrors.iter().chain(&rest).sum::<f64>() / count;
        let [mirrors, rest] = [mirrors, rest].map(ColorError::of);
        StillError { delta_e, mirrors, rest, pixels: self.pixels(shown) }
    }

    /// The colour differences of the mirrors' pixels, and of the others.
    fn differences(&self, shown: &Shown) -> [Vec<f64>; 2] {
        let picture = enlarged(&shown.picture, &shown.depth, shown.size, self.shown.size);
        let is_seen = |index: &usize| {
            let other = shown.depth[shown.place(*index, self.shown.size)];
            !(self.shown.depth[*index].is_nan() && other.is_nan())
        };
        let picture = colors(&picture);
        let difference = |index: usize| picture[index].difference(self.colors[index]);
        let of_part = |is_mirror: bool| {
            let seen = (0..self.shown.depth.len()).into_par_iter().filter(is_seen);
            seen.filter(|index| self.mirrors[*index].is_some() == is_mirror).map(difference).collect()
        };
        [of_part(true), of_part(false)]
    }

    fn pixels(&self, shown: &Shown) -> f64 {
        let width = self.shown.size[0] as usize;
        let mut errors: Vec<f64> = if self.has_mirrors() {
            let mut pixels = self.mirrors.clone();
            for (index, pixel) in pixels.iter_mut().enumerate() {
                if let Some(pixel) = pixel {
                    (pixel.found, pixel.coverage) = shown.found(shown.place(index, self.shown.size));
                }
            }
            let error = |index: usize| {
                let pixel = pixels[index]?;
                match (pixel.truth.is_some(), pixel.coverage > 0.0) {
                    (true, true) => {
                        let error = pixel_error(width, &pixels, index)?;
                        // Where directions do not change, nothing is between right and wrong.
                        let steady = || error.is_off.map(|is_off| if is_off { WRONG } else { 0.0 });
                        error.pixels.map(|error| error.min(WRONG)).or_else(steady)
                    }
                    (false, false) => Some(0.0),
                    _ => Some(WRONG),
                }
            };
            (0..pixels.len()).into_par_iter().filter_map(error).collect()
        } else {
            let error = |index: usize| {
                let place = shown.place(index, self.shown.size);
                match (self.shown.depth[index].is_nan(), shown.depth[place].is_nan()) {
                    (false, false) => Some(self.offset(index, place, shown.size)),
                    (true, true) => None,
                    _ => Some(WRONG),
                }
            };
            (0..self.shown.depth.len()).into_par_iter().filter_map(error).collect()
        };
        percentile_95(&mut errors).unwrap_or(0.0)
    }

    /// The distance between the centre of a pixel and that of the pixel of a picture of `size` that it shows.
    fn offset(&self, index: usize, place: usize, size: [u32; 2]) -> f64 {
        let own = self.shown.size;
        let center = |at: usize, size: [u32; 2], axis: usize| {
            let at = [at % size[0] as usize, at / size[0] as usize][axis];
            (at as f64 + 0.5) / f64::from(size[axis]) * f64::from(own[axis])
        };
        let [x, y] = [0, 1].map(|axis| center(index, own, axis) - center(place, size, axis));
        x.hypot(y)
    }
}

/// The colours of a picture of four bytes a pixel.
fn colors(picture: &[u8]) -> Vec<Lab<D65, f64>> {
    let pixels = picture.as_chunks::<4>().0.par_iter();
    pixels.map(|[red, green, blue, _]| lab([*red, *green, *blue].map(linear_from_srgb))).collect()
}

/// What `auto` is to keep to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// The time of a frame.
    Milliseconds(f64),
    /// [`StillError::pixels`].
    Pixels(f64),
    /// [`StillError::worse_delta_e`].
    DeltaE(f64),
}

impl Target {
    /// The error that counts: that of colours for a time, for it holds all others.
    pub fn error(self, error: &StillError) -> f64 {
        match self {
            Self::Pixels(_) => error.pixels,
            Self::Milliseconds(_) | Self::DeltaE(_) => error.worse_delta_e(),
        }
    }

    /// Whether a frame keeps to it.
    pub fn is_kept(self, milliseconds: f64, error: f64) -> bool {
        match self {
            Self::Milliseconds(most) => milliseconds <= most,
            Self::Pixels(most) | Self::DeltaE(most) => error <= most,
        }
    }

    /// The unit of that error.
    pub fn error_unit(self) -> &'static str {
        match self {
            Self::Pixels(_) => "px",
            Self::Milliseconds(_) | Self::DeltaE(_) => "dE",
        }
    }
}

impl FromStr for Target {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let split = text.find(|letter: char| letter.is_ascii_alphabetic()).unwrap_or(text.len());
        let (number, unit) = text.split_at(split);
        let number = number.parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
        match (number, unit) {
            (Some(number), "ms") => Ok(Self::Milliseconds(number)),
            (Some(number), "s") => Ok(Self::Milliseconds(number * 1000.0)),
            (Some(number), "px") => Ok(Self::Pixels(number)),
            (Some(number), "dE") => Ok(Self::DeltaE(number)),
            _ => Err("expected a time as in 50ms, or an error as in 1px or 2dE, above 0".into()),
        }
    }
}

impl std::fmt::Display for Target {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Milliseconds(time) => write!(formatter, "{time}ms"),
            Self::Pixels(error) => write!(formatter, "{error}px"),
            Self::DeltaE(error) => write!(formatter, "{error}dE"),
        }
    }
}

impl std::fmt::Display for StillError {
    /// The colours of mirrors and of the rest apart, each with its 95th percentile, and the pixels.
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (name, part) in [("mirrors", self.mirrors), ("the rest", self.rest)] {
            if let Some(ColorError { mean, p95 }) = part {
                write!(formatter, "{name} {mean:.2} dE, 95th percentile {p95:.2}; ")?;
            }
        }
        write!(formatter, "{:.2} px", self.pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of one line of pixels in grey.
    fn shown(greys: &[u8]) -> Shown {
        let picture = greys.iter().flat_map(|grey| [*grey, *grey, *grey, 255]).collect();
        Shown { size: [greys.len() as u32, 1], picture, depth: vec![1.0; greys.len()], found: None }
    }

    #[test]
    fn a_small_mirror_that_stays_grey_is_not_hidden_by_the_rest_of_the_picture() {
        let mirror = MirrorPixel {
            position: DVec3::Z,
            incoming: DVec3::Z,
            reflected: DVec3::ZERO,
            found: DVec3::NAN,
            coverage: 0.0,
            truth: None,
        };
        let bright = shown(&[200; 100]);
        let mut mirrors = vec![None; 100];
        mirrors[..2].fill(Some(mirror));
        let still = Still { colors: colors(&bright.picture), shown: bright, mirrors };
        let mut greys = [200; 100];
        greys[..2].fill(100);
        let error = still.error_of(&shown(&greys));
        let [mirrors, rest] = error.means();
        assert!(mirrors > 20.0 && rest == 0.0 && error.delta_e < 1.0, "{error:?}");
        assert_eq!(error.worse_delta_e(), mirrors);
        assert!(!Target::DeltaE(1.0).is_kept(1.0, error.worse_delta_e()), "the mean of all pixels would keep to it");
        assert!((error.delta_e - mirrors * 0.02).abs() < 1e-9, "{error:?}");
        // Of the rest, the worse tenth is what the percentile shows and the mean does not.
        let mut greys = [200; 100];
        greys[90..].fill(100);
        let error = still.error_of(&shown(&greys));
        let rest = error.rest.expect("pixels beside mirrors");
        assert!(rest.p95 > 20.0 && rest.mean < 0.11 * rest.p95 && error.mirrors.is_some_and(|part| part.p95 == 0.0));
        let own = still.none();
        assert_eq!((own.worse_delta_e(), own.pixels, own.mirrors.is_some()), (0.0, 0.0, true));
    }
}
