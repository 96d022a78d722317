//! A section: the points in an upright slice along a line, by their distance along it and their height.

use cloud::{Volume, VolumeShape};
use glam::{DMat2, DQuat, DVec2, DVec3};

use crate::error::{Error, Result};
use crate::scatter::{IN_95_PERCENT, SNAPPED, Scatter};

/// The variance of the way along a line to the nearest of the points that lie on it at random, as a share of the square
/// of their mean distance: the way is distributed exponentially, with half of that distance as its mean.
const IN_LINE: f64 = 0.5;
/// The most times that a strip may be narrower than the spacing of the surface's points. In narrower strips the nearest
/// point is often beyond the end of the surface.
const SPARSEST: f64 = 2.0;

/// How far a place along or across a line may be off by rounding, as a share of the largest coordinate.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// An upright slice of even width along a line of one or more straight pieces. The line counts as seen from above: the
/// heights of its corners do not matter. Where it bends, a point on the outer side that is beside neither piece is
/// outside, and one on the inner side belongs to the nearer piece.
#[derive(Clone, Debug)]
pub struct Section {
    pieces: Vec<Piece>,
    up: DVec3,
    half_width: f64,
}

#[derive(Clone, Debug)]
struct Piece {
    from: DVec3,
    /// Unit vector, level.
    along: DVec3,
    /// Unit vector to the left of the line.
    left: DVec3,
    length: f64,
    /// The length of the line before it.
    start: f64,
}

/// The place of a point in a section, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// The level distance along the line from its first corner.
    pub along: f64,
    /// The coordinate in the direction up.
    pub height: f64,
    /// The distance to the left of the line.
    pub across: f64,
}

impl Section {
    /// `width` is the whole thickness of the slice; its border counts as inside. `up` is a unit vector.
    ///
    /// # Errors
    /// Fewer than two corners, two of them above one another, or no width.
    pub fn new(line: &[DVec3], width: f64, up: DVec3) -> Result<Self> {
        if line.len() < 2 {
            return Err(Error::ShortLine { corners: line.len() });
        }
        // NaN fails the comparison.
        if !(width > 0.0 && width.is_finite()) {
            return Err(Error::Width { width });
        }
        let mut pieces = Vec::new();
        let mut start = 0.0;
        for (corner, ends) in line.windows(2).enumerate() {
            let level = (ends[1] - ends[0]).reject_from_normalized(up);
            let length = level.length();
            let along = level.try_normalize().ok_or(Error::NoLength { corner: corner + 1 })?;
            pieces.push(Piece { from: ends[0], along, left: up.cross(along), length, start });
            start += length;
        }
        Ok(Self { pieces, up, half_width: width * 0.5 })
    }

    /// The parts of space that the section consists of, a little wider than it, so that rounding leaves no point out.
    pub fn volumes(&self) -> Vec<Volume> {
        let of = |piece: &Piece| {
            let wider = 4.0 * ROUNDING * (piece.from.abs().max_element() + piece.length + self.half_width);
            let (behind, ahead) = (piece.along * -wider, piece.along * (piece.length + wider));
            let aside = piece.left * (self.half_width + wider);
            let points = vec![behind - aside, ahead - aside, ahead + aside, behind + aside];
            let shape = VolumeShape::Prism { points, direction: self.up, eye: None };
            Volume::new(shape, piece.from, DQuat::IDENTITY, DVec3::ONE)
        };
        self.pieces.iter().map(of).collect()
    }

    /// The length of the line.
    pub fn length(&self) -> f64 {
        self.pieces.last().map_or(0.0, |last| last.start + last.length)
    }

    /// Where a point lies in the section, if it is in it.
    pub fn place(&self, point: DVec3) -> Option<Placed> {
        self.piece_at(point).map(|(_, placed)| placed)
    }

    /// The covariance of a distance along the line and a height, where the point that the section shows nearest to a
    /// place on the line is read in its stead, by the points around that point. `None` for a point that is not in the
    /// section, and where the section is so thin that its nearest point may be on something else.
    pub fn covariance(&self, point: DVec3, scatter: &Scatter) -> Option<DMat2> {
        let (piece, _) = self.piece_at(point)?;
        let (normal, area) = (scatter.normal, scatter.spacing * scatter.spacing);
        let in_section = |axis: DVec3| DVec2::new(piece.along.dot(axis), self.up.dot(axis));
        let outer = |axis: DVec2, variance: f64| DMat2::from_cols(axis * axis.x, axis * axis.y) * variance;
        let across = outer(in_section(normal), (scatter.half_widths.point / IN_95_PERCENT).powi(2));
        // The section cuts a strip out of the surface, and shows it by so much less wide than it is.
        let cut = normal.cross(piece.left);
        let (sine, shown) = (cut.length(), normal.dot(piece.left).abs());
        if sine == 0.0 {
            return Some(across + DMat2::IDENTITY * (area * SNAPPED));
        }
        let width = 2.0 * self.half_width / sine;
        if scatter.spacing > SPARSEST * width {
            return None;
        }
        let along_cut = in_section(cut / sine);
        let gap = area / width;
        let along = area * shown * SNAPPED + gap * gap * IN_LINE;
        let aside = (area * shown * SNAPPED).min((width * shown).powi(2) / 12.0);
        Some(across + outer(along_cut, along) + outer(along_cut.perp(), aside))
    }

    fn piece_at(&self, point: DVec3) -> Option<(&Piece, Placed)> {
        let mut nearest: Option<(&Piece, Placed)> = None;
        for piece in &self.pieces {
            let offset = point - piece.from;
            let (along, across) = (offset.dot(piece.along), offset.dot(piece.left));
            // A line often begins and ends at points of the cloud, which rounding must not leave out.
            let rounding = ROUNDING * point.abs().max(piece.from.abs()).max_element();
            let beyond = f64::max(-along, along - piece.length).max(across.abs() - self.half_width);
            let (along, across) = (along.clamp(0.0, piece.length), across.clamp(-self.half_width, self.half_width));
            if beyond <= rounding && nearest.is_none_or(|(_, nearest)| across.abs() < nearest.across.abs()) {
                nearest = Some((piece, Placed { along: piece.start + along, height: point.dot(self.up), across }));
            }
        }
        nearest
    }
}

#[cfg(test)]
mod tests {
    use cloud::HalfWidths;

    use super::*;

    fn grid(step: f64) -> impl Iterator<Item = DVec3> {
        (-100..=100).flat_map(move |x| (-100..=100).map(move |y| DVec3::new(f64::from(x), f64::from(y), 0.0) * step))
    }

    #[test]
    fn a_section_of_a_slope_is_a_line_of_the_slope() {
        // Heights rise by 0.3 along x and fall by 0.2 along y, at coordinates of seven digits.
        let origin = DVec3::new(635_000.0, 5_077_000.0, 120.0);
        let height = |x: f64, y: f64| 0.3 * x - 0.2 * y;
        let (from, to) = (DVec3::new(-3.0, -4.0, 9.0), DVec3::new(3.0, 4.0, -7.0));
        let section = Section::new(&[origin + from, origin + to], 0.5, DVec3::Z).unwrap();
        let slope = (height(3.0, 4.0) - height(-3.0, -4.0)) / 10.0;
        let mut count = 0;
        for point in grid(0.1) {
            let Some(placed) = section.place(origin + DVec3::new(point.x, point.y, height(point.x, point.y))) else {
                continue;
            };
            count += 1;
            assert!((0.0..=10.0).contains(&placed.along) && placed.across.abs() <= 0.25);
            // Across the line, the slope is that of its normal (-0.8, 0.6).
            let expected = 120.0 + height(-3.0, -4.0) + slope * placed.along + height(-0.8, 0.6) * placed.across;
            assert!((placed.height - expected).abs() < 1e-8, "{placed:?}: {expected}");
        }
        // As many points as the slice's area, 5 square metres at 100 points each.
        assert!((450..550).contains(&count), "{count}");
    }

    #[test]
    fn points_at_the_ends_of_a_line_are_in_its_section_wherever_it_lies() {
        let mut random = cloud::Random(7);
        for _ in 0..1000 {
            let mut place = |size: f64| DVec3::from_array([0; 3].map(|_| size * (random.below(1 << 40) as f64 / 1e12)));
            let [from, to] = [place(5e6), place(5e6)];
            let section = Section::new(&[from, to], 0.01, DVec3::Z).unwrap();
            let [first, last] = [from, to].map(|end| section.place(end).expect("an end").along);
            assert!((0.0..=1e-8).contains(&first) && (section.length() - last).abs() < 1e-8, "{first} {last}");
            assert_eq!(section.place(from + (from - to).normalize() * 1e-6), None, "outside is outside");
        }
    }

    #[test]
    fn a_bent_line_counts_on_and_points_belong_to_the_nearer_piece() {
        let corners = [DVec3::ZERO, DVec3::X * 4.0, DVec3::new(4.0, 3.0, 50.0)];
        let section = Section::new(&corners, 1.0, DVec3::Z).unwrap();
        let along = |x: f64, y: f64| section.place(DVec3::new(x, y, 7.0)).map(|placed| (placed.along, placed.across));
        assert_eq!(along(1.0, 0.5), Some((1.0, 0.5)));
        assert_eq!(along(1.0, 0.500_001), None);
        assert_eq!(along(4.25, 1.0), Some((5.0, -0.25)));
        assert_eq!(along(3.9, 0.4), Some((4.4, 4.0 - 3.9)), "nearer to the second piece");
        assert_eq!(along(4.2, -0.2), None, "beyond the outer side of the bend");
        assert_eq!(along(4.0, 3.0), Some((7.0, 0.0)));
        assert_eq!(along(-0.1, 0.0), None);
        assert_eq!(section.place(DVec3::NAN), None);
    }

    #[test]
    fn readings_deviate_by_how_far_the_nearest_point_is_that_a_section_shows() {
        let corners = [DVec3::ZERO, DVec3::X * 4.0, DVec3::new(4.0, 3.0, 0.0)];
        let deviations = |width: f64, place: DVec3, normal: DVec3| {
            let half_widths = HalfWidths { point: 0.01 * IN_95_PERCENT, further: 0.0 };
            let scatter = Scatter { spacing: 0.1, noise: 0.01, normal, half_widths };
            let section = Section::new(&corners, width, DVec3::Z).unwrap();
            let of_axes = section.covariance(place, &scatter)?;
            Some([of_axes.x_axis.x, of_axes.y_axis.y].map(f64::sqrt))
        };
        let is_near = |found: Option<[f64; 2]>, expected: [f64; 2]| {
            let found = found.unwrap();
            assert!((0..2).all(|axis| (found[axis] - expected[axis]).abs() < 1e-9), "{found:?}, not {expected:?}");
        };
        let (first, second) = (DVec3::new(1.0, 0.0, 5.0), DVec3::new(4.0, 2.0, 5.0));
        // A floor is seen from its edge: 0.1 x 0.1 / 0.2 = 0.05 from point to point along the line, whichever its piece.
        for place in [first, second] {
            is_near(deviations(0.2, place, DVec3::Z), [0.05 * IN_LINE.sqrt(), 0.01]);
            is_near(deviations(0.05, place, DVec3::Z), [0.2 * IN_LINE.sqrt(), 0.01]);
            assert_eq!(deviations(0.049, place, DVec3::Z), None, "narrower than half of the spacing");
        }
        // A wall along the first piece is seen as a whole, and one across the second piece from its edge.
        is_near(deviations(0.2, first, DVec3::Y), [0.1 * SNAPPED.sqrt(); 2]);
        is_near(deviations(0.2, second, DVec3::Y), [0.01, 0.05 * IN_LINE.sqrt()]);
        // A slope of 60 degrees across the line: the strip is 0.1 / sin 30 wide.
        let slope = DVec3::new(0.0, 0.75_f64.sqrt(), 0.5);
        let gap = 0.01 / 0.2;
        let along = 0.01 * 0.75_f64.sqrt() * SNAPPED + gap * gap * IN_LINE;
        let up = 0.25e-4 + 0.01 * 0.75_f64.sqrt() * SNAPPED;
        is_near(deviations(0.1, first, slope), [along.sqrt(), up.sqrt()]);
        assert_eq!(deviations(0.2, DVec3::new(1.0, 0.6, 5.0), DVec3::Z), None, "beside the section");
    }

    #[test]
    fn its_volumes_contain_the_points_that_have_a_place_in_it() {
        let origin = DVec3::new(635_000.0, 5_077_000.0, 120.0);
        let corners = [DVec3::new(-3.02, -2.51, 9.0), DVec3::new(2.03, 1.04, 0.0), DVec3::new(3.05, -3.06, 50.0)];
        let line: Vec<DVec3> = corners.into_iter().map(|corner| origin + corner).collect();
        let section = Section::new(&line, 1.3, DVec3::Z).unwrap();
        let volumes = section.volumes();
        let mut counts = [0; 2];
        for point in grid(0.0411).map(|point| origin + point) {
            let is_in = section.place(point).is_some();
            assert_eq!(volumes.iter().any(|volume| volume.contains(point)), is_in, "{point}");
            counts[usize::from(is_in)] += 1;
        }
        assert!(counts[0] > 1000 && counts[1] > 1000, "{counts:?}");
        let expected = (corners[1] - corners[0]).truncate().length() + (corners[2] - corners[1]).truncate().length();
        assert!((section.length() - expected).abs() < 1e-6);
    }

    #[test]
    fn what_is_no_section_is_refused() {
        let refusal = |line: &[DVec3], width: f64| Section::new(line, width, DVec3::Z).unwrap_err().to_string();
        assert!(refusal(&[DVec3::ZERO], 1.0).contains("line of 1 corners"));
        assert!(refusal(&[DVec3::X, DVec3::ZERO, DVec3::Z], 1.0).contains("corners 2 and 3"));
        assert!(refusal(&[DVec3::X, DVec3::ZERO], 0.0).contains("width of 0"));
        assert!(refusal(&[DVec3::X, DVec3::ZERO], f64::NAN).contains("width of NaN"));
    }
}
