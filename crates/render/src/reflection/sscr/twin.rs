//! Screen-space curved reflections on the CPU, in plain code with the shaders' names. The GPU's labels, regions, error
//! values and solved pixels are tested against it, and it is tested against closed forms. Of the searches it has the
//! published one and Newton's, from random starts; the depths of the curvature map are those of a perspective view.
//!
//! Preiner 2010: the mirror-space error function is section 3.3, the search for the mirror pixel 3.4.3, the curvature
//! map and its labels 3.5. Labels are found by tracing contours (Chang, Chen, Lu 2004), as published; the GPU joins
//! trees instead.

use glam::{UVec2, Vec2, Vec3};
use scene::{Reading, Solver, Sscr};

/// One pixel of a mirror.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorPixel {
    /// P, relative to the camera's eye, world axes.
    pub point: Vec3,
    /// The unit normal towards the origin of the ray.
    pub normal: Vec3,
    /// The unit vector from P to the origin of the ray.
    pub toward_eye: Vec3,
    /// The depth as seen from there.
    pub linear_depth: f32,
}

/// The mirror pixels of a picture, row by row; `None` where there is no mirror.
#[derive(Clone)]
pub struct MirrorPicture {
    pub size: UVec2,
    pub pixels: Vec<Option<MirrorPixel>>,
    /// The view's axes in the world: `right` and `up`.
    pub right: Vec3,
    pub up: Vec3,
}

// Flags of the curvature map, two bits a direction: how the surface bends from the previous pixel to this one.
pub const CONVEX: u32 = 1;
pub const HOLLOW: u32 = 2;
pub const BENT: u32 = CONVEX | HOLLOW;
/// The shift of the bits of direction y.
pub const DIRECTION_BITS: u32 = 2;
/// A depth step from the left and from the upper pixel.
pub const STEP: [u32; 2] = [1 << 4, 1 << 5];
pub const MIRROR: u32 = 1 << 7;

/// The pixel before `index` along x (0) or y (1).
fn previous(width: usize, index: usize, direction: usize) -> Option<usize> {
    match direction {
        0 => (!index.is_multiple_of(width)).then(|| index - 1),
        _ => index.checked_sub(width),
    }
}

impl MirrorPicture {
    /// Whether the depth steps between two neighbouring pixels, of which `before` is the left or the upper one.
    fn is_depth_step(before: &MirrorPixel, pixel: &MirrorPixel, settings: &Sscr) -> bool {
        let change = pixel.linear_depth - before.linear_depth;
        change.abs() > settings.depth_step_threshold * before.linear_depth
    }

    /// The normals that the curvature map is made from: averages over neighbours with weights that fall linearly to
    /// both sides, along the rows, then along the columns, up to the mirror's rim and to depth steps.
    fn filtered_normals(&self, settings: &Sscr) -> Vec<Vec3> {
        let mut normals: Vec<Vec3> =
            self.pixels.iter().map(|pixel| pixel.map_or(Vec3::ZERO, |pixel| pixel.normal)).collect();
        let (width, radius) = (self.size.x as usize, settings.normal_filter as usize);
        if radius == 0 {
            return normals;
        }
        for direction in 0..2 {
            let sum = |index: usize| {
                if self.pixels[index].is_none() {
                    return Vec3::ZERO;
                }
                let mut sum = normals[index] * (radius + 1) as f32;
                for is_forward in [false, true] {
                    let mut here = index;
                    for distance in 1..=radius {
                        let next = if is_forward {
                            let next = here + if direction == 0 { 1 } else { width };
                            (next < self.pixels.len() && previous(width, next, direction) == Some(here)).then_some(next)
                        } else {
                            previous(width, here, direction)
                        };
                        let Some(next) = next.filter(|next| self.pixels[*next].is_some()) else { break };
                        let (before, after) = if is_forward { (here, next) } else { (next, here) };
                        let pair = self.pixels[before].as_ref().zip(self.pixels[after].as_ref());
                        if pair.is_some_and(|(before, after)| Self::is_depth_step(before, after, settings)) {
                            break;
                        }
                        sum += normals[next] * (radius + 1 - distance) as f32;
                        here = next;
                    }
                }
                sum
            };
            normals = (0..normals.len()).map(sum).collect();
        }
        normals.into_iter().map(Vec3::normalize_or_zero).collect()
    }

    /// The curvature map (section 3.5.1), before it is smoothed.
    pub fn curvature(&self, settings: &Sscr) -> Vec<u32> {
        let normals = self.filtered_normals(settings);
        let of_pixel = |index: usize| {
            let Some(pixel) = self.pixels[index] else { return 0 };
            let mut flags = MIRROR;
            for direction in 0..2 {
                let previous = previous(self.size.x as usize, index, direction);
                let Some((index_before, before)) =
                    previous.and_then(|previous| Some((previous, self.pixels[previous]?)))
                else {
                    continue;
                };
                // Rows run downwards, so along a column the normal of a convex surface turns against the view's up.
                let axis = [self.right, -self.up][direction];
                let turn = (normals[index] - normals[index_before]).dot(axis);
                if Self::is_depth_step(&before, &pixel, settings) {
                    // A change of the normal from one surface to another is no curvature.
                    flags |= STEP[direction];
                } else if turn.abs() > settings.planar_normal_threshold {
                    let bend = if turn > 0.0 { CONVEX } else { HOLLOW };
                    flags |= bend << (DIRECTION_BITS * direction as u32);
                }
            }
            flags
        };
        (0..self.pixels.len()).map(of_pixel).collect()
    }
}

/// Whether two neighbours bend opposite ways along x or along y.
fn is_border(flags: u32, previous: u32) -> bool {
    let are_opposite = |shift: u32| ((flags | previous) >> shift) & BENT == BENT;
    are_opposite(0) || are_opposite(DIRECTION_BITS)
}

/// Whether a pixel of the smoothed curvature map lies at a border between regions (section 3.5.2, 2).
fn is_suppressed(curvature: &[u32], width: usize, index: usize) -> bool {
    (0..2).any(|direction| {
        curvature[index] & STEP[direction] != 0
            || previous(width, index, direction).is_some_and(|previous| {
                curvature[previous] & MIRROR != 0 && is_border(curvature[index], curvature[previous])
            })
    })
}

/// Gives a planar pixel the bend of its predecessor, up to the next depth step or gap (section 3.5.2, 1).
pub fn smooth(curvature: &mut [u32], size: UVec2) {
    let (width, height) = (size.x as usize, size.y as usize);
    for direction in 0..2 {
        let shift = DIRECTION_BITS * direction as u32;
        let (lines, length, across, along) =
            if direction == 0 { (height, width, width, 1) } else { (width, height, 1, width) };
        for line in 0..lines {
            let mut bend = 0;
            for place in 0..length {
                let flags = &mut curvature[line * across + place * along];
                if *flags & MIRROR == 0 || *flags & STEP[direction] != 0 {
                    bend = 0;
                }
                let own = (*flags >> shift) & BENT;
                if own != 0 {
                    bend = own;
                } else if *flags & MIRROR != 0 {
                    *flags |= bend << shift;
                }
            }
        }
    }
}

/// Labels of the 4-connected parts of `inside`, from 1 in the order of their first pixels; 0 outside. Contour tracing (Chang,
/// Chen, Lu 2004) with the paper's changes (section 4.4.1): four neighbours, and marks kept with the pixel.
pub fn label_by_contours(inside: &[bool], size: UVec2) -> Vec<u32> {
    let (width, height) = (size.x as i32, size.y as i32);
    // Right, down, left, up: turning right adds one.
    const MOVES: [[i32; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];
    const RIGHT: usize = 0;
    const DOWN: usize = 1;
    const LEFT: usize = 2;
    let neighbor = |index: usize, heading: usize| {
        let (x, y) = (index as i32 % width + MOVES[heading][0], index as i32 / width + MOVES[heading][1]);
        let is_in = x >= 0 && y >= 0 && x < width && y < height;
        (is_in && inside[(y * width + x) as usize]).then(|| (y * width + x) as usize)
    };
    let mut labels = vec![0; inside.len()];
    // Whether the contour below a pixel has been traced. A pixel can lie between two contours, so its side is recorded,
    // too.
    let mut traced_below = vec![false; inside.len()];
    // Follows the contour on the left hand of `heading`, all around.
    let trace = |labels: &mut [u32], traced_below: &mut [bool], start: usize, heading: usize, label: u32| {
        let (mut at, mut toward, mut first) = (start, heading, None);
        loop {
            labels[at] = label;
            let mut next = None;
            for turn in [3, 0, 1, 2] {
                let heading = (toward + turn) % 4;
                next = neighbor(at, heading).map(|pixel| (pixel, heading));
                if next.is_some() {
                    break;
                }
                traced_below[at] |= heading == DOWN;
            }
            let Some((pixel, heading)) = next else { return };
            if at == start && first == Some(heading) {
                return;
            }
            first = first.or(Some(heading));
            (at, toward) = (pixel, heading);
        }
    };
    let mut count = 0;
    for index in 0..inside.len() {
        if !inside[index] {
            continue;
        }
        if labels[index] == 0 && neighbor(index, 3).is_none() {
            count += 1;
            trace(&mut labels, &mut traced_below, index, RIGHT, count);
        }
        if labels[index] == 0 {
            // Not on a contour from the left or from above: it belongs to the part of its left neighbour.
            labels[index] = labels[index - 1];
        }
        if neighbor(index, DOWN).is_none() && !traced_below[index] {
            let label = labels[index];
            trace(&mut labels, &mut traced_below, index, LEFT, label);
        }
    }
    labels
}

/// The smallest region that a bracket fits in: two by two pixels.
pub const LEAST_REGION: u32 = 4;

/// A part of the mirror that bends one way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// The first and the last pixel.
    pub first: UVec2,
    pub last: UVec2,
    pub pixels: u32,
    /// The number of pixels of this region and all before it.
    pub accumulated: u32,
}

impl Region {
    fn extent(&self) -> Vec2 {
        (self.last - self.first).as_vec2() + 1.0
    }
}

/// The labelled homogeneous curvature map and its regions; label n is region n - 1, 0 is none.
pub struct Regions {
    pub labels: Vec<u32>,
    pub regions: Vec<Region>,
}

impl Regions {
    pub fn new(picture: &MirrorPicture, settings: &Sscr) -> Self {
        let mut curvature = picture.curvature(settings);
        smooth(&mut curvature, picture.size);
        Self::of_curvature(&curvature, picture.size)
    }

    /// The regions of a smoothed curvature map.
    pub fn of_curvature(curvature: &[u32], size: UVec2) -> Self {
        let width = size.x as usize;
        let is_mirror = |index: usize| curvature[index] & MIRROR != 0;
        let suppressed: Vec<bool> =
            (0..curvature.len()).map(|index| is_mirror(index) && is_suppressed(curvature, width, index)).collect();
        let inside: Vec<bool> = (0..curvature.len()).map(|index| is_mirror(index) && !suppressed[index]).collect();
        let parts = label_by_contours(&inside, size);
        let mut sizes = vec![0; parts.iter().max().map_or(0, |most| *most as usize) + 1];
        parts.iter().for_each(|part| sizes[*part as usize] += 1);
        let (mut numbers, mut regions, mut accumulated) = (vec![0; sizes.len()], Vec::new(), 0);
        for part in 1..sizes.len() {
            if sizes[part] >= LEAST_REGION {
                accumulated += sizes[part];
                regions.push(Region { first: UVec2::MAX, last: UVec2::ZERO, pixels: sizes[part], accumulated });
                numbers[part] = regions.len() as u32;
            }
        }
        let numbered: Vec<u32> = parts.iter().map(|part| numbers[*part as usize]).collect();
        let mut labels = numbered.clone();
        for index in 0..labels.len() {
            if suppressed[index] {
                // Section 3.5.2, 4: the label of the right, else the lower pixel.
                let right = if index % width + 1 < width { numbered[index + 1] } else { 0 };
                labels[index] = if right != 0 { right } else { numbered.get(index + width).copied().unwrap_or(0) };
            }
            if let Some(region) = labels[index].checked_sub(1).map(|region| &mut regions[region as usize]) {
                let at = UVec2::new((index % width) as u32, (index / width) as u32);
                (region.first, region.last) = (region.first.min(at), region.last.max(at));
            }
        }
        Self { labels, regions }
    }

    /// The region in which a point with this number from 0 to 1 is tried, in proportion to the regions' pixels (section
    /// 4.5.1). The paper sorts the regions first; drawing from the running sum is the same in any order.
    pub fn draw(&self, number: f32) -> Option<u32> {
        let total = self.regions.last()?.accumulated;
        let place = ((number * total as f32) as u32).min(total - 1);
        Some(self.regions.partition_point(|region| region.accumulated <= place) as u32)
    }
}

/// Halton's sequence in base 2.
pub fn halton(index: u32) -> f32 {
    (index.reverse_bits() >> 8) as f32 / 16_777_216.0
}

/// PCG's output permutation as a hash (Jarzynski, Olano 2020).
pub fn hash(value: u32) -> u32 {
    let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// A sequence of numbers from 0 to 1.
#[derive(Clone, Copy)]
pub struct Random(pub u32);

impl Random {
    pub fn next(&mut self) -> f32 {
        self.0 = hash(self.0);
        (self.0 >> 8) as f32 / 16_777_216.0
    }
}

/// The direction in which light from Q leaves P, in mirror space: z to the eye, x in the plane of z and the view's x
/// axis (section 3.2).
pub fn reflected_in_mirror_space(pixel: &MirrorPixel, right: Vec3, q: Vec3) -> Vec3 {
    let z = pixel.toward_eye;
    let x = (right - z * right.dot(z)).normalize_or_zero();
    let y = z.cross(x);
    let incoming = (pixel.point - q).normalize_or_zero();
    let rho = incoming - 2.0 * pixel.normal * pixel.normal.dot(incoming);
    Vec3::new(rho.dot(x), rho.dot(y), rho.dot(z))
}

/// The signed error angles along x and y (section 3.3). The printed formula takes the angles of rho - e, both of whose
/// components vanish at the root; here they are those of the reflected direction rho itself, which is e at the root and
/// only there.
pub fn mirror_space_error(reflected: Vec3) -> Vec2 {
    Vec2::new(reflected.x.atan2(reflected.z), reflected.y.atan2(reflected.z))
}

/// The same error as a place on Lambert's azimuthal map, for searches that follow its slope: it tears only where light
/// leaves away from the eye, and over a distant sphere it is linear in the pixels.
pub fn mapped_error(reflected: Vec3) -> Vec2 {
    reflected.truncate() * (2.0 / (1.0 + reflected.z).max(1e-6)).sqrt()
}

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// The pixel coordinates, with centres at halves.
    Found(Vec2),
    /// The search left the region, or its steps became too small.
    Lost,
    /// The search reached `max_steps`.
    Unconverged,
}

/// The pixels in which a point's mirror pixel is searched.
pub struct Search<'a> {
    pub picture: &'a MirrorPicture,
    pub regions: &'a Regions,
    pub settings: &'a Sscr,
}

/// A step below this stays in its pixel more often than not (section 3.4.3 ends where "the step size fell below 1
/// pixel").
const LEAST_STEP: f32 = 0.5;
/// A root within one pixel of a pixel's centre, by the slope there, counts as found: pixels are no more precise.
const ROOT_REACH: f32 = 1.0;
/// The mirror does not reflect its own surface around the mirror point: points nearer than this many splat radii are
/// rejected.
const OWN_SURFACE_RADII: f32 = 4.0;

impl Search<'_> {
    fn pixel(&self, region: u32, at: Vec2) -> Option<&MirrorPixel> {
        let size = self.picture.size.as_vec2();
        if !(at.cmpge(Vec2::ZERO).all() && at.cmplt(size).all()) {
            return None;
        }
        let index = (at.y as usize) * self.picture.size.x as usize + at.x as usize;
        self.picture.pixels[index].as_ref().filter(|_| self.regions.labels[index] == region + 1)
    }

    /// The error at a pixel coordinate; `None` outside the region.
    fn error(&self, region: u32, at: Vec2, q: Vec3) -> Option<Vec2> {
        let reflected = reflected_in_mirror_space(self.pixel(region, at)?, self.picture.right, q);
        Some(match self.settings.solver {
            Solver::Interleaved => mirror_space_error(reflected),
            Solver::Newton | Solver::Broyden | Solver::NelderMead | Solver::ConjugateGradient => {
                mapped_error(reflected)
            }
        })
    }

    /// A random pixel of the region and the error there.
    fn seed(&self, region: u32, q: Vec3, random: &mut Random) -> Option<(Vec2, Vec2)> {
        let bounds = self.regions.regions[region as usize];
        let first = bounds.first.as_vec2();
        let extent = bounds.extent();
        (0..=self.settings.seed_attempts).find_map(|_| {
            let at = first + extent * Vec2::new(random.next(), random.next());
            self.error(region, at, q).map(|error| (at, error))
        })
    }

    /// The probe after `origin` by `step`, or by as many halves of it as are allowed until it stays in the region.
    fn after(&self, region: u32, origin: Vec2, step: Vec2, q: Vec3) -> Option<(Vec2, Vec2)> {
        (0..=self.settings.step_attempts).find_map(|attempt| {
            let at = origin + step * 0.5_f32.powi(attempt as i32);
            self.error(region, at, q).map(|error| (at, error))
        })
    }

    /// The pixel that reflects a point, in the region drawn for it, and its distance from the mirror. A `normal` of zero
    /// is none.
    pub fn solve(&self, identity: u32, q: Vec3, normal: Vec3, radius: f32) -> (Outcome, f32) {
        let Some(region) = self.regions.draw(halton(identity)) else { return (Outcome::Lost, 0.0) };
        let mut random = Random(hash(identity));
        let outcome = match self.settings.solver {
            Solver::Newton => self.newton(region, q, &mut random),
            Solver::Interleaved => self.interleaved(region, q, &mut random),
            other @ (Solver::Broyden | Solver::NelderMead | Solver::ConjugateGradient) => {
                panic!("{other:?} has no twin")
            }
        };
        let Outcome::Found(at) = outcome else { return (outcome, 0.0) };
        let Some(pixel) = self.pixel(region, at) else { return (Outcome::Lost, 0.0) };
        let offset = q - pixel.point;
        let settings = self.settings;
        let has_back = settings.reading == Reading::Listing && settings.solver == Solver::Interleaved;
        let turns_back = has_back && offset.dot(normal) > 0.0;
        let is_seen = offset.dot(pixel.normal) > 0.0 && offset.length() > OWN_SURFACE_RADII * radius && !turns_back;
        if is_seen { (outcome, offset.length()) } else { (Outcome::Lost, 0.0) }
    }

    /// Interleaved bracketing and bisection (algorithm 3.1): two pixels, the last two of a walk. Along each axis it
    /// goes on while the error falls, turns round where it grows, and turns with half the step where the error changes
    /// its sign.
    fn interleaved(&self, region: u32, q: Vec3, random: &mut Random) -> Outcome {
        let settings = self.settings;
        let extent = self.regions.regions[region as usize].extent();
        let Some((mut p1, mut delta1)) = self.seed(region, q, random) else { return Outcome::Lost };
        let Some((mut p2, mut delta2)) = self.seed(region, q, random) else { return Outcome::Lost };
        let mut step = extent * settings.initial_step;
        let is_listing = settings.reading == Reading::Listing;
        let mut dir = if is_listing { Vec2::ONE } else { Vec2::select(p2.cmplt(p1), Vec2::NEG_ONE, Vec2::ONE) };
        for steps in 0..=settings.max_steps {
            let crossed = (delta1 * delta2).cmplt(Vec2::ZERO);
            let is_near = p1.distance(p2) < settings.threshold;
            if is_near && crossed.all() {
                let share = delta1.abs() / (delta1.abs() + delta2.abs());
                return Outcome::Found(p1 + (p2 - p1) * share);
            }
            if steps == settings.max_steps {
                break;
            }
            let turned = crossed | delta2.abs().cmpge(delta1.abs());
            dir = Vec2::select(turned, -dir, dir);
            step = Vec2::select(crossed, step * 0.5, step);
            if (is_near && is_listing) || step.max_element() < LEAST_STEP {
                return Outcome::Lost;
            }
            let Some((at, error)) = self.after(region, p2, dir * step, q) else { return Outcome::Lost };
            (p1, delta1, p2, delta2) = (p2, delta2, at, error);
        }
        Outcome::Unconverged
    }

    /// Newton's method from pixel centre to pixel centre, by steps of at most the first step's length. If no step stays
    /// in the region it starts anew.
    fn newton(&self, region: u32, q: Vec3, random: &mut Random) -> Outcome {
        let longest = (self.regions.regions[region as usize].extent() * self.settings.initial_step).max(Vec2::ONE);
        let mut restarts = 0;
        let Some(mut here) = self.centered_seed(region, q, random) else { return Outcome::Lost };
        for _ in 0..self.settings.max_steps {
            let step = self.newton_step(region, here, q);
            if let Some(step) = step.filter(|step| step.abs().cmple(Vec2::splat(ROOT_REACH)).all()) {
                return Outcome::Found(here + step);
            }
            let next = step.and_then(|step| self.centered_after(region, here, step, longest, q));
            let Some(next) = next.or_else(|| {
                restarts += 1;
                self.centered_seed(region, q, random).filter(|_| restarts <= self.settings.seed_attempts)
            }) else {
                return Outcome::Lost;
            };
            here = next;
        }
        Outcome::Unconverged
    }

    /// The step to the root of the plane through the errors of a pixel and its neighbours; `None` if they have none.
    fn newton_step(&self, region: u32, here: Vec2, q: Vec3) -> Option<Vec2> {
        let error = self.error(region, here, q)?;
        let along = |axis: Vec2| {
            let difference = |side: f32| Some((self.error(region, here + axis * side, q)? - error) * side);
            difference(1.0).or_else(|| difference(-1.0))
        };
        let (along_x, along_y) = (along(Vec2::X)?, along(Vec2::Y)?);
        let determinant = along_x.x * along_y.y - along_y.x * along_x.y;
        let determinant = if determinant.abs() < 1e-20 { 1e-20 } else { determinant };
        let step = Vec2::new(along_y.x * error.y - along_y.y * error.x, along_x.y * error.x - along_x.x * error.y);
        Some(step / determinant)
    }

    fn centered_seed(&self, region: u32, q: Vec3, random: &mut Random) -> Option<Vec2> {
        self.seed(region, q, random).map(|(seed, _)| seed.floor() + 0.5)
    }

    /// The centre of another pixel of the region, one step further.
    fn centered_after(&self, region: u32, here: Vec2, step: Vec2, longest: Vec2, q: Vec3) -> Option<Vec2> {
        let step = step / (step.abs() / longest).max_element().max(1.0);
        // At least to the next pixel.
        let step = step * (1.0 / step.abs().max_element().max(1e-20)).max(1.0);
        let (next, _) = self.after(region, here, step, q)?;
        Some(next.floor() + 0.5).filter(|next| *next != here)
    }
}
