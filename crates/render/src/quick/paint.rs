//! The colours of single points.

use std::borrow::Cow;

use cloud::{Column, stray_kind, unpack_normal};

use crate::coloring::{ColorSource, STRAY_KINDS, class_color, ramp_colors};
use crate::store::draw_list::SeenChunk;

/// What colours the points of a chunk. The colours are those of shaders/shared/color.wgsl.
pub enum Paint<'a> {
    Plain([u8; 4]),
    Rgb(&'a [[u8; 4]]),
    /// RGB, and where it is black the grey of a column or a plain colour.
    RgbOr(&'a [[u8; 4]], Option<OnRamp<'a>>, [u8; 4]),
    Normal(&'a [u32]),
    Class(Cow<'a, [u8]>),
    /// By the radii, which say what is on no surface.
    Stray(Option<&'a [u16]>),
    Height {
        axis: usize,
        origin: f64,
        on_ramp: OnRamp<'a>,
    },
    Column(OnRamp<'a>, [u8; 4]),
}

/// Values on a ramp of colours.
pub struct OnRamp<'a> {
    values: Option<&'a Column>,
    low: f64,
    inverse_range: f64,
    colors: [[u8; 4]; 256],
}

impl OnRamp<'_> {
    /// The place of a value on the ramp; `None` without one.
    fn place(&self, value: f64) -> Option<u8> {
        (!value.is_nan()).then(|| (((value - self.low) * self.inverse_range).clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
    }

    fn at(&self, index: usize) -> Option<u8> {
        self.place(self.values?.value(index))
    }
}

impl<'a> Paint<'a> {
    pub fn new(chunk: &SeenChunk<'a>) -> Self {
        let SeenChunk { points, colors, .. } = chunk;
        if let Some(tint) = colors.tint {
            return Self::Plain(tint);
        }
        let on_ramp = |column: Option<usize>| OnRamp {
            values: column.and_then(|column| points.columns.get(column)?.as_deref()),
            low: colors.low,
            inverse_range: if colors.high > colors.low { 1.0 / (colors.high - colors.low) } else { 0.0 },
            colors: ramp_colors(colors.ramp),
        };
        let own = points.colors.as_ref().map(|colors| colors.as_slice());
        match (colors.source, own) {
            (ColorSource::Rgb, Some(own)) => Self::Rgb(own),
            (ColorSource::RgbOr(grey), Some(own)) => {
                Self::RgbOr(own, grey.map(|column| on_ramp(Some(column))), colors.plain)
            }
            // Points without colours are white, as the store has them.
            (ColorSource::Rgb | ColorSource::RgbOr(_), None) => Self::Plain([u8::MAX; 4]),
            (ColorSource::Plain, _) => Self::Plain(colors.plain),
            (ColorSource::Normal, _) => {
                points.normals.as_ref().map_or(Self::Plain([128; 4]), |normals| Self::Normal(normals))
            }
            (ColorSource::Class, _) => {
                let classes = points.classes(chunk.layout.and_then(|layout| layout.class_column()));
                Self::Class(classes.unwrap_or_else(|| Cow::Owned(vec![0; points.len()])))
            }
            (ColorSource::Stray, _) => Self::Stray(points.radii.as_ref().map(|radii| radii.as_slice())),
            (ColorSource::Height, _) => {
                Self::Height { axis: colors.up_axis, origin: points.origin[colors.up_axis], on_ramp: on_ramp(None) }
            }
            (ColorSource::Column(column), _) => Self::Column(on_ramp(Some(column)), colors.plain),
        }
    }

    /// The colour of a point in sRGB.
    #[inline]
    pub fn color(&self, index: usize, position: [f32; 3]) -> [u8; 4] {
        match self {
            Self::Plain(color) => *color,
            Self::Rgb(colors) => colors[index],
            Self::RgbOr(colors, greys, plain) => match greys.as_ref().and_then(|greys| greys.at(index)) {
                _ if !cloud::is_black(colors[index]) => colors[index],
                Some(grey) => [grey, grey, grey, u8::MAX],
                None => *plain,
            },
            Self::Normal(normals) => {
                let normal = unpack_normal(normals[index]).unwrap_or_default();
                let [red, green, blue] = (normal * 0.5 + 0.5).to_array().map(|part| (part * 255.0 + 0.5) as u8);
                [red, green, blue, u8::MAX]
            }
            Self::Class(classes) => class_color(classes[index]),
            Self::Stray(radii) => STRAY_KINDS[usize::from(radii.map_or(0, |radii| stray_kind(radii[index])))].1,
            Self::Height { axis, origin, on_ramp } => {
                let place = on_ramp.place(origin + f64::from(position[*axis]));
                on_ramp.colors[usize::from(place.unwrap_or(0))]
            }
            Self::Column(on_ramp, plain) => {
                on_ramp.at(index).map_or(*plain, |place| on_ramp.colors[usize::from(place)])
            }
        }
    }
}
