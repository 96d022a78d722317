//! The CPU twin of shaders/light_field_look_up.wgsl.

use glam::{Vec2, Vec3};
use scene::{SampleRule, SampleVisibility};

use super::super::depth_walk::Texel;

/// A sample of a mirror; the faces of its map, if that stands.
pub struct Sample {
    pub surface: Vec3,
    pub middle: Vec3,
    pub faces: Option<[Vec<Texel>; 6]>,
}

pub struct Field {
    pub samples: Vec<Sample>,
    /// Texels along the edge of a face.
    pub size: u32,
    pub neighbours: usize,
    pub rule: SampleRule,
    pub exponent: f32,
    pub visible_by: SampleVisibility,
    /// Radians.
    pub horizon: f32,
    pub corrections: u32,
}

/// What the samples say about a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Found {
    Open,
    On { t: f32, identity: u32 },
    Beside { identity: u32 },
    Nothing,
}

/// A disc that a map shows.
struct Disc {
    identity: u32,
    place: Vec3,
    normal: Vec3,
    middle: Vec3,
    reach: f32,
}

impl Field {
    /// What the ray of a mirror point meets; only of a sample that resolves it, or the best that one has, too. Where
    /// looks are blended it is that of the sample that weighs most.
    pub fn find(&self, place: Vec3, normal: Vec3, direction: Vec3) -> Found {
        let mut beside = Found::Nothing;
        for (sample, _) in self.in_order(place, normal, direction) {
            let Some(faces) = &sample.faces else { continue };
            if !self.serves(sample, faces, place, normal) {
                continue;
            }
            match self.look_up(sample.middle, faces, place, direction) {
                found @ (Found::Open | Found::On { .. }) => return found,
                found if beside == Found::Nothing => beside = found,
                _ => {}
            }
            if self.corrections == 0 && beside != Found::Nothing {
                return beside;
            }
        }
        beside
    }

    /// The looks that are blended: what each sample that answers finds, with its weight. The weights sum up to 1.
    pub fn looks(&self, place: Vec3, normal: Vec3, direction: Vec3) -> Vec<(Found, f32)> {
        let mut looks = Vec::new();
        for (sample, weight) in self.in_order(place, normal, direction) {
            let Some(faces) = sample.faces.as_ref().filter(|faces| self.serves(sample, faces, place, normal)) else {
                continue;
            };
            match self.look_up(sample.middle, faces, place, direction) {
                Found::Nothing => {}
                Found::Beside { .. } if self.corrections > 0 => {}
                found => looks.push((found, weight)),
            }
        }
        let sum: f32 = looks.iter().map(|(_, weight)| weight).sum();
        let count = looks.len() as f32;
        looks.iter_mut().for_each(|(_, weight)| *weight = if sum > 0.0 { *weight / sum } else { 1.0 / count });
        looks
    }

    /// The nearest samples in the order of the rule, with their weights, which are not yet normalised.
    pub fn in_order(&self, place: Vec3, normal: Vec3, direction: Vec3) -> Vec<(&Sample, f32)> {
        let distance = |sample: &Sample| sample.surface.distance(place);
        let mut near: Vec<&Sample> = self.samples.iter().collect();
        near.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        let after = near.get(self.neighbours).map_or(0.0, |sample| 1.0 / distance(sample));
        near.truncate(self.neighbours);
        let cosine = |sample: &Sample, along: Vec3| (sample.middle - place).normalize_or_zero().dot(along);
        let power = |sample: &Sample, along: Vec3| {
            let largest = near.iter().map(|sample| cosine(sample, along)).fold(0.0, f32::max);
            if largest > 0.0 { (cosine(sample, along).max(0.0) / largest).powf(self.exponent) } else { 1.0 }
        };
        let key = |sample: &Sample| match self.rule {
            SampleRule::Nearest => 0.0,
            SampleRule::Angle => -cosine(sample, direction),
            SampleRule::Ray => (sample.middle - place).reject_from_normalized(direction).length(),
            SampleRule::Mean => -1.0,
            SampleRule::Reflection => -power(sample, direction),
            SampleRule::Normal => -power(sample, normal),
            SampleRule::Smooth => -(1.0 / distance(sample) - after).max(0.0),
        };
        let mut order: Vec<(&Sample, f32)> = near.iter().map(|sample| (*sample, -key(sample))).collect();
        order.sort_by(|a, b| b.1.total_cmp(&a.1));
        order
    }

    fn serves(&self, sample: &Sample, faces: &[Vec<Texel>; 6], place: Vec3, normal: Vec3) -> bool {
        let offset = place - sample.middle;
        if self.visible_by == SampleVisibility::Angle {
            return normal.dot(-offset) > self.horizon.cos() * offset.length();
        }
        let (face, at) = self.texel_toward(offset);
        let texel = self.texel(&faces[face], at);
        let slack = (texel.radius + 1.0) * texel.depth / self.focal();
        texel.depth == 0.0 || offset.dot(axes(face)[0]) <= texel.depth + slack
    }

    fn look_up(&self, middle: Vec3, faces: &[Vec<Texel>; 6], place: Vec3, direction: Vec3) -> Found {
        let Some(mut disc) = self.disc_toward(middle, faces, direction) else { return Found::Open };
        for _ in 0..self.corrections {
            let (t, _) = distance(&disc, place, direction);
            match self.disc_toward(middle, faces, place + direction * t - middle) {
                Some(corrected) => disc = corrected,
                None => return Found::Nothing,
            }
        }
        let (t, is_met) = distance(&disc, place, direction);
        let identity = disc.identity;
        if is_met && (place + direction * t).distance(disc.middle) <= disc.reach {
            Found::On { t, identity }
        } else {
            Found::Beside { identity }
        }
    }

    /// Where the middle of the texel is that the first sample's map has in a direction.
    pub fn place_in_direction(&self, direction: Vec3) -> Vec3 {
        let sample = &self.samples[0];
        let disc = sample.faces.as_ref().and_then(|faces| self.disc_toward(sample.middle, faces, direction));
        disc.unwrap().place
    }

    fn focal(&self) -> f32 {
        0.5 * self.size as f32
    }

    fn texel(&self, face: &[Texel], at: [u32; 2]) -> Texel {
        face[(at[1] * self.size + at[0]) as usize]
    }

    /// The face and the texel of a map in a direction.
    fn texel_toward(&self, direction: Vec3) -> (usize, [u32; 2]) {
        let axis = direction.abs().max_position();
        let face = if direction[axis] < 0.0 { axis + 3 } else { axis };
        let [forward, right, up] = axes(face);
        let slope = Vec2::new(direction.dot(right), -direction.dot(up)) / direction.dot(forward);
        let at = (slope + 1.0) * self.focal();
        (face, [at.x, at.y].map(|at| (at as u32).min(self.size - 1)))
    }

    fn disc_toward(&self, middle: Vec3, faces: &[Vec<Texel>; 6], direction: Vec3) -> Option<Disc> {
        let (face, at) = self.texel_toward(direction);
        let texel = self.texel(&faces[face], at);
        if texel.depth == 0.0 {
            return None;
        }
        let [forward, right, up] = axes(face);
        let center = Vec2::new(at[0] as f32 + 0.5, at[1] as f32 + 0.5);
        let sight = |at: Vec2| {
            let slope = at / self.focal() - 1.0;
            forward + right * slope.x - up * slope.y
        };
        let (here, there) = (sight(center) * texel.depth, sight(center + texel.middle));
        let slope = texel.normal.dot(there);
        let depth = if slope < 0.0 { texel.normal.dot(here) / slope } else { texel.depth };
        Some(Disc {
            identity: texel.identity,
            place: middle + here,
            normal: texel.normal,
            middle: middle + there * depth,
            reach: (texel.radius + 0.75 / (-texel.normal.dot(here.normalize())).max(0.16)) * texel.depth / self.focal(),
        })
    }
}

/// The direction of a face, and the axes that point right and up in it.
fn axes(face: usize) -> [Vec3; 3] {
    let axis = |turn: usize| Vec3::AXES[(face + turn) % 3];
    [if face < 3 { axis(0) } else { -axis(0) }, axis(1), axis(2)]
}

/// Where a ray meets the plane of a disc; or how far away the disc is, if the ray does not.
fn distance(disc: &Disc, place: Vec3, direction: Vec3) -> (f32, bool) {
    let sine = disc.normal.dot(direction);
    let t = disc.normal.dot(disc.place - place) / sine;
    if sine.abs() >= 0.05 && t > 0.0 { (t, true) } else { (disc.place.distance(place), false) }
}
