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
    /// What the ray of a mirror point meets; only of a sample that resolves it, or the best that one has, too.
    pub fn find(&self, place: Vec3, normal: Vec3, direction: Vec3) -> Found {
        let mut order: Vec<&Sample> = self.samples.iter().collect();
        order.sort_by(|a, b| a.surface.distance(place).total_cmp(&b.surface.distance(place)));
        order.truncate(self.neighbours);
        let key = |sample: &Sample| {
            let offset = sample.middle - place;
            match self.rule {
                SampleRule::Nearest => 0.0,
                SampleRule::Angle => -offset.normalize_or_zero().dot(direction),
                SampleRule::Ray => offset.reject_from_normalized(direction).length(),
            }
        };
        order.sort_by(|a, b| key(a).total_cmp(&key(b)));
        let mut beside = Found::Nothing;
        for sample in order {
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
