//! Smooth curves through points, and the rates at which they are followed.
//!
//! Between two points the curve is a cubic. Its parameter grows by the root of the points' distance (centripetal splines
//! after Catmull and Rom, "A class of local interpolating splines", 1974, which have neither cusps nor loops between
//! two points: Yuksel et al., "On the parameterization of Catmull-Rom curves", 2009). At a point the derivative is that
//! of the parabola through it and its neighbours, with two changes that keep the curve from passing a point and coming
//! back to it:
//!
//! - Where the curve turns by more than a right angle it decreases with the angle, down to zero where it turns back.
//! - It is at most three times the slope of the flatter of the two straight lines that meet there. Under this bound a
//!   cubic between values that rise only rises (Fritsch and Carlson, "Monotone piecewise cubic interpolation", 1980).

use glam::DVec3;

/// The number of pieces of a stretch whose lengths are kept.
const PIECES: usize = 32;
/// The steps of Newton's method from the place that the pieces give to that of a length.
const STEPS: usize = 3;

/// Values between which cubics run: places, or numbers.
pub trait Slope: Copy {
    fn times(self, factor: f64) -> Self;
    fn plus(self, other: Self) -> Self;
    fn size(self) -> f64;
    fn dot(self, other: Self) -> f64;
}

impl Slope for DVec3 {
    fn times(self, factor: f64) -> Self {
        self * factor
    }
    fn plus(self, other: Self) -> Self {
        self + other
    }
    fn size(self) -> f64 {
        self.length()
    }
    fn dot(self, other: Self) -> f64 {
        self.dot(other)
    }
}

impl Slope for f64 {
    fn times(self, factor: f64) -> Self {
        self * factor
    }
    fn plus(self, other: Self) -> Self {
        self + other
    }
    fn size(self) -> f64 {
        self.abs()
    }
    fn dot(self, other: Self) -> f64 {
        self * other
    }
}

/// The derivative where two stretches meet, from the slopes of their straight lines and their spans.
pub fn derivative<T: Slope>([arriving, leaving]: [T; 2], [before, after]: [f64; 2]) -> T {
    let parabola = arriving.times(after / (before + after)).plus(leaving.times(before / (before + after)));
    let sizes = [arriving.size(), leaving.size()];
    if sizes[0] == 0.0 || sizes[1] == 0.0 {
        return parabola.times(0.0);
    }
    let cosine = arriving.dot(leaving) / (sizes[0] * sizes[1]);
    let turned = parabola.times((1.0 + cosine).clamp(0.0, 1.0));
    let most = 3.0 * sizes[0].min(sizes[1]);
    if turned.size() > most { turned.times(most / turned.size()) } else { turned }
}

/// The derivatives at all points, from the slopes and spans of the stretches between them. In a loop the last point is
/// the first.
pub fn derivatives<T: Slope>(slopes: &[T], spans: &[f64], is_loop: bool) -> Vec<T> {
    let count = slopes.len();
    let at = |point: usize| {
        let before = if point > 0 { Some(point - 1) } else { is_loop.then(|| count - 1) };
        let after = if point < count { Some(point) } else { is_loop.then_some(0) };
        match (before, after) {
            (Some(before), Some(after)) => derivative([slopes[before], slopes[after]], [spans[before], spans[after]]),
            _ => slopes[point.min(count - 1)],
        }
    };
    if count == 0 { Vec::new() } else { (0..=count).map(at).collect() }
}

/// The weights of a cubic's ends and of its derivatives there, after a share of the way.
pub fn hermite(share: f64) -> [f64; 4] {
    let (squared, cubed) = (share * share, share * share * share);
    [1.0 - 3.0 * squared + 2.0 * cubed, 3.0 * squared - 2.0 * cubed, cubed - 2.0 * squared + share, cubed - squared]
}

/// A curve through points.
pub struct Curve {
    points: Vec<DVec3>,
    stretches: Vec<Stretch>,
}

/// The curve between two points.
struct Stretch {
    /// The derivatives at the ends, for a parameter from 0 to 1.
    tangents: [DVec3; 2],
    /// The lengths from the beginning to the ends of the pieces.
    lengths: [f64; PIECES],
}

impl Curve {
    pub fn new(points: Vec<DVec3>, is_loop: bool) -> Self {
        let ways: Vec<DVec3> = points.windows(2).map(|ends| ends[1] - ends[0]).collect();
        let spans: Vec<f64> = ways.iter().map(|way| way.length().sqrt()).collect();
        // Where nothing moves the parameter does not grow either.
        let slopes: Vec<DVec3> =
            ways.iter().zip(&spans).map(|(way, span)| *way / span.max(f64::MIN_POSITIVE)).collect();
        let mut tangents =
            derivatives(&slopes, &spans.iter().map(|span| span.max(1e-300)).collect::<Vec<_>>(), is_loop);
        for (index, tangent) in tangents.iter_mut().enumerate() {
            // Before and after a pause the curve follows its one neighbour.
            let around = [index.checked_sub(1), Some(index)].map(|at| at.and_then(|at| slopes.get(at)));
            let moving: Vec<&DVec3> = around.into_iter().flatten().filter(|slope| **slope != DVec3::ZERO).collect();
            if let ([only], true) = (moving.as_slice(), *tangent == DVec3::ZERO) {
                *tangent = **only;
            }
        }
        let stretch = |index: usize| {
            let tangents = [tangents[index], tangents[index + 1]].map(|tangent| tangent * spans[index]);
            let mut stretch = Stretch { tangents, lengths: [0.0; PIECES] };
            let mut length = 0.0;
            for piece in 0..PIECES {
                let [from, to] = [piece, piece + 1].map(|piece| piece as f64 / PIECES as f64);
                length += stretch.length(ways[index], from, to);
                stretch.lengths[piece] = length;
            }
            stretch
        };
        let stretches = (0..ways.len()).map(stretch).collect();
        Self { points, stretches }
    }

    /// The length of the curve from one point to the next.
    pub fn length(&self, stretch: usize) -> f64 {
        self.stretches[stretch].lengths[PIECES - 1]
    }

    /// The cosine of the angle by which the points turn at one of them; 1 where one of its neighbours is in its place.
    pub fn cosine(&self, before: usize, after: usize) -> f64 {
        let way = |stretch: usize| (self.points[stretch + 1] - self.points[stretch]).normalize_or_zero();
        let (arriving, leaving) = (way(before), way(after));
        if arriving == DVec3::ZERO || leaving == DVec3::ZERO { 1.0 } else { arriving.dot(leaving) }
    }

    /// The place after a length of the way from one point to the next.
    pub fn place(&self, index: usize, length: f64) -> DVec3 {
        let [from, to] = [self.points[index], self.points[index + 1]];
        let Stretch { tangents, lengths } = &self.stretches[index];
        let whole = lengths[PIECES - 1];
        if length <= 0.0 || whole == 0.0 {
            return from;
        }
        if length >= whole {
            return to;
        }
        let piece = lengths.partition_point(|end| *end <= length).min(PIECES - 1);
        let start = piece.checked_sub(1).map_or(0.0, |before| lengths[before]);
        let [least, most] = [piece, piece + 1].map(|piece| piece as f64 / PIECES as f64);
        let mut share = least + (length - start) / (lengths[piece] - start) / PIECES as f64;
        for _ in 0..STEPS {
            let stretch = &self.stretches[index];
            let wrong = start + stretch.length(to - from, least, share) - length;
            let speed = stretch.speed(to - from, share);
            if speed > 0.0 {
                share = (share - wrong / speed).clamp(least, most);
            }
        }
        let [_, end, leaving, arriving] = hermite(share);
        from + (to - from) * end + tangents[0] * leaving + tangents[1] * arriving
    }
}

impl Stretch {
    /// The length of the derivative; `way` leads from one end to the other.
    fn speed(&self, way: DVec3, share: f64) -> f64 {
        let squared = share * share;
        let ends = way * (6.0 * share - 6.0 * squared);
        let leaving = self.tangents[0] * (3.0 * squared - 4.0 * share + 1.0);
        (ends + leaving + self.tangents[1] * (3.0 * squared - 2.0 * share)).length()
    }

    /// The length between two parameters, by Gauss' rule of three places.
    fn length(&self, way: DVec3, from: f64, to: f64) -> f64 {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let aside = half * 0.6_f64.sqrt();
        let [a, b, c] = [middle - aside, middle, middle + aside].map(|share| self.speed(way, share));
        half * (5.0 * a + 8.0 * b + 5.0 * c) / 9.0
    }
}
