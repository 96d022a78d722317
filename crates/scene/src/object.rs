//! The objects in a scene besides its clouds: one value for objects of any kind, and one table of what can be done with
//! each kind. Scene files keep a list for each kind.

use glam::{DQuat, DVec3};

use crate::{
    Clip, ClipShape, MOST_CLIPS, MOST_MEASUREMENTS, MOST_MIRRORS, MOST_NOTES, MOST_PROFILES, Measurement, Mirror, Note,
    Profile, SpotLight,
};

/// The distance between a light and its copy, relative to the distance to its target.
const LIGHT_ASIDE: f64 = 0.1;
/// The smallest and the largest factor of one change of size: an object must not vanish.
const FACTORS: [f64; 2] = [1e-3, 1e3];

#[derive(Clone, Debug, PartialEq)]
pub enum Object {
    Mirror(Mirror),
    Light(SpotLight),
    Clip(Clip),
    Measurement(Measurement),
    Note(Note),
    Profile(Profile),
}

/// What can be done with objects of a kind. All kinds can be selected, deleted and saved. The methods of `Object` have an
/// arm for what a kind can do, and none for what its row denies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectKind {
    /// The name in messages and events.
    pub name: &'static str,
    /// The places by which an object is moved. A kind without any is anchored to points of clouds: its objects stay
    /// where they are, and cannot be copied.
    pub places: &'static [&'static str],
    pub can_turn: bool,
    pub can_scale: bool,
    /// Whether an object is drawn as a symbol in the picture, by which it is selected. Others are selected by the
    /// points that represent them.
    pub has_symbol: bool,
    /// Whether an object is drawn over the finished picture, with its name beside it while it is switched on: a change
    /// of it draws no points again.
    pub is_over_picture: bool,
    /// The most objects of the kind in a scene.
    pub most: usize,
}

const MIRROR: ObjectKind = ObjectKind {
    name: "mirror",
    places: &["position"],
    can_turn: true,
    can_scale: true,
    has_symbol: false,
    is_over_picture: false,
    most: MOST_MIRRORS,
};

const LIGHT: ObjectKind = ObjectKind {
    name: "light",
    places: &["position", "target"],
    can_turn: false,
    can_scale: false,
    has_symbol: true,
    is_over_picture: false,
    most: usize::MAX,
};

const CLIP: ObjectKind = ObjectKind {
    name: "clip",
    places: &["position"],
    can_turn: true,
    can_scale: true,
    has_symbol: false,
    is_over_picture: false,
    most: MOST_CLIPS,
};

const SLAB: ObjectKind = ObjectKind { places: &["position", "lower side", "upper side"], ..CLIP };

const BOX: ObjectKind =
    ObjectKind { places: &["position", "-x side", "+x side", "-y side", "+y side", "-z side", "+z side"], ..CLIP };

const MEASUREMENT: ObjectKind = ObjectKind {
    name: "measurement",
    places: &[],
    can_turn: false,
    can_scale: false,
    has_symbol: false,
    is_over_picture: true,
    most: MOST_MEASUREMENTS,
};

const NOTE: ObjectKind = ObjectKind { name: "note", most: MOST_NOTES, ..MEASUREMENT };

/// The corners between the ends of a profile's line move with the whole.
const PROFILE: ObjectKind = ObjectKind {
    name: "profile",
    places: &["position", "start", "end"],
    can_turn: true,
    can_scale: false,
    has_symbol: false,
    is_over_picture: true,
    most: MOST_PROFILES,
};

impl Object {
    pub fn kind(&self) -> &'static ObjectKind {
        match self {
            Self::Mirror(_) => &MIRROR,
            Self::Light(_) => &LIGHT,
            Self::Clip(clip) => match clip.shape {
                ClipShape::Box | ClipShape::Sphere => &BOX,
                ClipShape::Slab => &SLAB,
                ClipShape::Prism(_) => &CLIP,
            },
            Self::Measurement(_) => &MEASUREMENT,
            Self::Note(_) => &NOTE,
            Self::Profile(_) => &PROFILE,
        }
    }

    /// Whether the object is switched on. Kinds without a switch always are.
    pub fn is_on(&self) -> bool {
        match self {
            Self::Mirror(_) | Self::Light(_) => true,
            Self::Clip(clip) => clip.on,
            Self::Measurement(measurement) => measurement.on,
            Self::Note(note) => note.on,
            Self::Profile(profile) => profile.on,
        }
    }

    /// The world positions of the kind's places, in order.
    pub fn places(&self) -> Vec<DVec3> {
        match self {
            Self::Mirror(mirror) => vec![mirror.position],
            Self::Light(light) => vec![light.position, light.target],
            Self::Clip(clip) => {
                let sides = clip.sides().into_iter().map(|side| clip.position + side);
                std::iter::once(clip.position).chain(sides).collect()
            }
            Self::Profile(profile) => {
                let ends = profile.line.first().into_iter().chain(profile.line.last());
                std::iter::once(profile.middle()).chain(ends.copied()).collect()
            }
            _ => Vec::new(),
        }
    }

    /// The direction (unit vector) along which a place moves, if it moves along a line.
    pub fn rail(&self, index: usize) -> Option<DVec3> {
        match self {
            Self::Clip(clip) => clip.sides().get(index.checked_sub(1)?)?.try_normalize(),
            _ => None,
        }
    }

    pub fn move_place(&mut self, index: usize, shift: DVec3) {
        match (self, index) {
            (Self::Mirror(mirror), 0) => mirror.position += shift,
            (Self::Light(light), 0) => light.position += shift,
            (Self::Light(light), 1) => light.target += shift,
            (Self::Clip(clip), 0) => clip.position += shift,
            (Self::Clip(clip), side) => clip.move_side(side - 1, shift),
            (Self::Profile(profile), 0) => profile.line.iter_mut().for_each(|corner| *corner += shift),
            (Self::Profile(profile), 1) => profile.line.first_mut().into_iter().for_each(|corner| *corner += shift),
            (Self::Profile(profile), 2) => profile.line.last_mut().into_iter().for_each(|corner| *corner += shift),
            _ => {}
        }
    }

    /// Turns it about its first place; a kind that cannot turn stays unchanged.
    pub fn turn(&mut self, rotation: DQuat) {
        match self {
            Self::Mirror(mirror) => mirror.rotation = (rotation * mirror.rotation).normalize(),
            Self::Clip(clip) => clip.rotation = (rotation * clip.rotation).normalize(),
            Self::Profile(profile) => {
                let middle = profile.middle();
                profile.line.iter_mut().for_each(|corner| *corner = middle + rotation * (*corner - middle));
            }
            _ => {}
        }
    }

    /// Scales it about its first place; a kind that cannot scale stays unchanged.
    pub fn scale(&mut self, factor: f64) {
        match self {
            Self::Mirror(mirror) => mirror.size *= factor.clamp(FACTORS[0], FACTORS[1]),
            Self::Clip(clip) => clip.size *= factor.clamp(FACTORS[0], FACTORS[1]),
            _ => {}
        }
    }

    /// The same one beside it in a direction (unit vector), so that both can be seen and grabbed; `None` if it is
    /// anchored to points.
    pub fn beside(&self, direction: DVec3) -> Option<Self> {
        Some(match self {
            Self::Mirror(mirror) => {
                let aside = direction * (mirror.shape.reach() * mirror.size);
                Self::Mirror(Mirror { position: mirror.position + aside, ..mirror.clone() })
            }
            Self::Light(light) => {
                let aside = direction * (light.position.distance(light.target) * LIGHT_ASIDE);
                Self::Light(SpotLight { position: light.position + aside, ..*light })
            }
            Self::Clip(clip) => {
                let aside = direction * clip.size.max_element();
                Self::Clip(Clip { position: clip.position + aside, ..clip.clone() })
            }
            Self::Profile(profile) => {
                let aside = direction * profile.width.max(profile.line[0].distance(profile.middle()) * LIGHT_ASIDE);
                let line = profile.line.iter().map(|corner| *corner + aside).collect();
                Self::Profile(Profile { line, ..profile.clone() })
            }
            _ => return None,
        })
    }

    /// What makes it none of its kind, in words, if anything does.
    pub fn problem(&self) -> Option<String> {
        match self {
            Self::Mirror(mirror) => mirror.problem(),
            Self::Light(light) => light.problem(),
            Self::Clip(clip) => clip.problem(),
            Self::Measurement(measurement) => measurement.problem(),
            Self::Note(note) => note.problem(),
            Self::Profile(profile) => profile.problem(),
        }
    }
}

#[cfg(test)]
mod tests {
    use cloud::Bounds;

    use super::*;
    use crate::{Camera, MeasurementKind, Prism, Shape, five_mirrors};

    fn clip(shape: ClipShape) -> Clip {
        let rotation = DQuat::from_rotation_z(0.5);
        Clip { rotation, ..Clip::around(shape, Bounds { min: DVec3::ZERO, max: DVec3::new(1.0, 2.0, 3.0) }) }
    }

    fn one_of_each() -> Vec<Object> {
        let mirror = Mirror::standing(Shape::Blob, DVec3::new(1.0, 2.0, 3.0), DVec3::Z, DVec3::Z, 0.5);
        let points = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        let prism = ClipShape::Prism(Prism { points, direction: DVec3::Z, eye: None });
        let measurement = Measurement {
            name: "height".into(),
            kind: MeasurementKind::Height,
            on: true,
            color: [1.0; 3],
            points: vec![DVec3::ZERO, DVec3::Z],
            reach: None,
            level: None,
        };
        let note = Note::new("here".into(), DVec3::ONE, Camera::from_eye(DVec3::X, DVec3::ZERO, DVec3::Z));
        vec![
            Object::Mirror(mirror),
            Object::Light(five_mirrors::light()),
            Object::Clip(clip(prism)),
            Object::Measurement(measurement),
            Object::Note(note),
            Object::Profile(Profile::new(vec![DVec3::ZERO, DVec3::new(3.0, 4.0, 5.0)], 0.5)),
        ]
    }

    #[test]
    fn a_side_of_a_clip_moves_along_its_axis_and_the_others_stay() {
        for shape in [ClipShape::Box, ClipShape::Sphere, ClipShape::Slab] {
            let before = Object::Clip(clip(shape));
            assert_eq!(before.places().len(), before.kind().places.len());
            assert_eq!(before.rail(0), None);
            for side in 1..before.places().len() {
                let rail = before.rail(side).unwrap();
                let mut moved = before.clone();
                moved.move_place(side, rail * 0.25 + rail.any_orthogonal_vector());
                let opposite = if side % 2 == 1 { side + 1 } else { side - 1 };
                let (places, now) = (before.places(), moved.places());
                assert!((now[side] - places[side]).distance(rail * 0.25) < 1e-12, "{side}");
                assert!(now[opposite].distance(places[opposite]) < 1e-12, "{side}");
                assert!((rail.dot(places[side] - places[0])) > 0.0);
                // Sides do not pass one another.
                moved.move_place(side, rail * -90.0);
                assert_eq!(moved.problem(), None);
            }
        }
    }

    #[test]
    fn objects_can_do_what_the_table_says_of_their_kinds_and_nothing_else() {
        for object in one_of_each() {
            let (kind, changed) = (object.kind(), |change: &dyn Fn(&mut Object)| {
                let mut changed = object.clone();
                change(&mut changed);
                assert_eq!(changed.kind(), object.kind());
                assert_eq!(changed.problem(), None, "{}", object.kind().name);
                (changed != object, changed)
            });
            assert_eq!(object.places().len(), kind.places.len());
            for place in 0..kind.places.len() + 1 {
                let (is_changed, moved) = changed(&|object| object.move_place(place, DVec3::X));
                assert_eq!(is_changed, place < kind.places.len(), "{} {place}", kind.name);
                for (index, (before, after)) in object.places().into_iter().zip(moved.places()).enumerate() {
                    // The middle of a profile's line moves with all of it, and with each end.
                    let is_bound = matches!(object, Object::Profile(_)) && (place == 0 || index == 0);
                    if index == place || !is_bound {
                        assert_eq!(after - before, if index == place { DVec3::X } else { DVec3::ZERO });
                    }
                }
            }
            assert_eq!(changed(&|object| object.turn(DQuat::from_rotation_y(0.4))).0, kind.can_turn, "{}", kind.name);
            assert_eq!(changed(&|object| object.scale(2.0)).0, kind.can_scale, "{}", kind.name);
            assert!(changed(&|object| object.scale(0.0)).1.problem().is_none());
            let copy = object.beside(DVec3::X).map(|copy| copy.places()[0].x > object.places()[0].x);
            assert_eq!(copy, (!kind.places.is_empty()).then_some(true), "{}", kind.name);
        }
    }
}
