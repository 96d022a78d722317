//! Made scans with mirrors, and how well their ghosts are judged.

use std::sync::Arc;

use cloud::{Progress, TriangleMesh};
use ghost::{Block, Extent, Kind, Mirrors, Points, Reflector, Verdicts, judge};
use glam::{DQuat, DVec3};
use scene::solid::Solid;
use scene::tripod::Disturbance;
use scene::{Mirror, MirrorMesh, Shape, Tripod};
use trace::Exact;
use trace::scan::{self, Echo};

/// A scan of the made room of 8 by 6 by 3 m.
pub struct Made {
    pub stations: Vec<DVec3>,
    #[allow(dead_code, reason = "not all programs of tests ask for them")]
    pub mirrors: Vec<Mirror>,
    blocks: Vec<Block>,
    /// Of each point of each block: what it is of, and whether it is of one surface.
    truth: Vec<Vec<(Echo, bool)>>,
}

pub const NOISES: [f64; 3] = [0.0, 0.001, 0.003];

fn mirror(shape: Shape, position: [f64; 3], toward: DVec3, size: f64) -> Mirror {
    let position = DVec3::from(position);
    Mirror { position, ..Mirror::standing(shape, position, toward, DVec3::Z, size) }
}

#[allow(dead_code, reason = "not all programs of tests have all mirrors")]
pub fn wall_mirror() -> Mirror {
    mirror(Shape::Plane { height: 0.8 }, [3.4, 5.96, 1.6], DVec3::NEG_Y, 0.9)
}

#[allow(dead_code, reason = "not all programs of tests have all mirrors")]
pub fn sphere() -> Mirror {
    mirror(Shape::Sphere, [4.4, 3.9, 1.0], DVec3::Z, 0.4)
}

/// A column of chrome that stands on the floor and ends below the ceiling.
#[allow(dead_code, reason = "not all programs of tests have all mirrors")]
pub fn column() -> Mirror {
    mirror(Shape::Cylinder { height: 8.0 }, [4.4, 3.9, 1.2], DVec3::Z, 0.15)
}

/// A pane across the room, 2 m wide and as high as a door.
#[allow(dead_code, reason = "not all programs of tests have all mirrors")]
pub fn pane(reflected: f32) -> Mirror {
    let pane = mirror(Shape::Plane { height: 1.05 }, [5.2, 2.6, 1.1], DVec3::NEG_X, 1.0);
    Mirror { specular_intensity: reflected, refraction: Some(1.0), ..pane }
}

/// The made room with a wall across it at x = 5.2, and a window in that wall which `pane` fills.
#[allow(dead_code, reason = "not all programs of tests have all mirrors")]
pub fn with_window() -> Vec<Solid> {
    let wall = |low: [f64; 2], high: [f64; 2]| Solid::block([5.15, low[0], low[1]], [5.25, high[0], high[1]], [0.7; 3]);
    let mut solids = Tripod::Room.solids();
    solids.extend([
        wall([0.0, 0.0], [1.6, 3.0]),
        wall([3.6, 0.0], [6.0, 3.0]),
        wall([1.6, 0.0], [3.6, 0.05]),
        wall([1.6, 2.15], [3.6, 3.0]),
    ]);
    solids
}

#[allow(dead_code, reason = "not all programs of tests have all mirrors")]
pub fn facing() -> Vec<Mirror> {
    let other = mirror(Shape::Plane { height: 0.8 }, [3.0, 0.04, 1.6], DVec3::Y, 0.9);
    vec![wall_mirror(), other]
}

/// Water on the floor as `floor_mirror`, with waves of 4 mm that are half a metre long.
#[allow(dead_code, reason = "not all programs of tests have all mirrors")]
pub fn wavy_water() -> Mirror {
    const CELLS: u32 = 100;
    let place = |corner: u32| {
        let [x, y] =
            [corner % (CELLS + 1), corner / (CELLS + 1)].map(|at| 2.0 * f64::from(at) / f64::from(CELLS) - 1.0);
        let (wave, height) = (2.0 * std::f64::consts::TAU, 0.004);
        let (sin, cos) = (wave * (x + 0.5 * y)).sin_cos();
        let slope = height * wave * cos;
        let normal = DVec3::new(-slope, -0.5 * slope, 1.0).normalize();
        (DVec3::new(x, y, height * sin), normal.as_vec3())
    };
    let (positions, normals): (Vec<_>, Vec<_>) = (0..(CELLS + 1) * (CELLS + 1)).map(place).unzip();
    let cells = (0..CELLS).flat_map(|y| (0..CELLS).map(move |x| y * (CELLS + 1) + x));
    let halves = |at: u32| [[at, at + 1, at + CELLS + 1], [at + 1, at + CELLS + 2, at + CELLS + 1]];
    let surface = TriangleMesh::new(&positions, &normals, &cells.flat_map(halves).collect::<Vec<_>>());
    let mesh = MirrorMesh { name: "water".to_owned(), surface: Arc::new(surface) };
    mirror(Shape::Mesh(mesh), [2.2, 1.4, 0.01], DVec3::Z, std::f64::consts::SQRT_2)
}

/// Water on the floor, which reflects a third of the beam and lets the rest through to a bottom that is too dark.
#[allow(dead_code, reason = "not all programs of tests have all mirrors")]
pub fn floor_mirror() -> Mirror {
    mirror(Shape::Plane { height: 0.7 }, [2.2, 1.4, 0.01], DVec3::Z, 1.0)
}

#[allow(dead_code, reason = "not all programs of tests ask all")]
impl Made {
    /// A scan of the made room.
    pub fn new(mirrors: Vec<Mirror>, stations: usize, noise: f64, rays: f64) -> Self {
        let stations = Tripod::Four.stations()[..stations].to_vec();
        Self::of(Tripod::Room.solids(), mirrors, stations, noise, rays)
    }

    pub fn of(solids: Vec<Solid>, mirrors: Vec<Mirror>, stations: Vec<DVec3>, noise: f64, rays: f64) -> Self {
        Self::seeded(solids, mirrors, stations, noise, rays, 7)
    }

    pub fn seeded(
        solids: Vec<Solid>,
        mirrors: Vec<Mirror>,
        stations: Vec<DVec3>,
        noise: f64,
        rays: f64,
        seed: u64,
    ) -> Self {
        let scene = Exact::of_mirrors(&mirrors).with_solids(solids);
        let disturbance = Disturbance { noise, mixed: 1e-3, strays: 0.0 };
        let (mut blocks, mut truth) = (Vec::new(), Vec::new());
        for (number, station) in stations.iter().enumerate() {
            let measured = scan::scan(&scene, &disturbance, *station, rays, seed, number);
            for (part, points) in measured.chunks(1 << 14).enumerate() {
                let places = points.iter().map(|point| *station + point.direction * point.range).collect();
                let first_point = (part << 14) as u64;
                let intensities = points.iter().map(|point| point.met.strength.sqrt() as f32).collect();
                blocks.push(Block { file: number, first_point, station: Some(number), places, intensities });
                truth.push(points.iter().map(|point| (point.met, point.is_whole)).collect());
            }
        }
        Self { stations, mirrors, blocks, truth }
    }

    /// The scan as one file that does not say which station saw a point.
    pub fn merged(mut self) -> Self {
        self.blocks.iter_mut().for_each(|block| block.station = None);
        self
    }

    pub fn count(&self) -> u64 {
        self.blocks.iter().map(|block| block.places.len() as u64).sum()
    }

    pub fn extent(&self) -> Extent {
        Extent::of(self, self.count()).expect("no error").expect("points, and nobody cancels")
    }

    pub fn exact_mirrors(&self) -> Mirrors {
        Mirrors::new(self.mirrors.iter().cloned().map(Reflector::exact).collect())
    }

    pub fn verdicts(&self, mirrors: &Mirrors) -> Verdicts {
        judge(self, &self.stations, mirrors, self.extent(), 0.0, &Progress::default())
            .expect("no error")
            .expect("points, and nobody cancels")
    }

    /// Compares the verdicts on the points that are of one surface with the truth.
    pub fn judge(&self, verdicts: &Verdicts, noise: f64) -> Figures {
        let mut figures = Figures::default();
        let mut errors = Vec::new();
        for (block, truth) in self.blocks.iter().zip(&self.truth) {
            let suspects = verdicts.suspects.get(&(block.file, block.first_point)).map_or(&[][..], Vec::as_slice);
            let mut suspects = suspects.iter().peekable();
            for (index, (echo, is_whole)) in truth.iter().enumerate() {
                let suspect = suspects.next_if(|suspect| suspect.index as usize == index);
                if !is_whole {
                    continue;
                }
                let kind = suspect.map_or(Kind::Real, |suspect| suspect.kind);
                match (echo.is_ghost(), kind) {
                    (true, Kind::Ghost) => figures.right += 1,
                    (true, _) => figures.missed += 1,
                    (false, Kind::Ghost) => figures.wrong += 1,
                    (false, _) => figures.real += 1,
                }
                figures.undecided += usize::from(kind == Kind::Undecided);
                if let Some(suspect) = suspect {
                    let bin = ((suspect.probability * 10.0) as usize).min(9);
                    figures.held[bin][0] += 1;
                    figures.held[bin][1] += usize::from(echo.is_ghost());
                    if echo.is_ghost() && kind == Kind::Ghost {
                        let error = suspect.place.distance(echo.place);
                        figures.covered += usize::from(error <= f64::from(suspect.error).max(1e-9));
                        errors.push(error);
                    }
                }
            }
        }
        errors.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| errors.get((errors.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
        (figures.median, figures.p95, figures.noise) = (at(0.5), at(0.95), noise);
        figures
    }
}

impl Points for Made {
    type Error = std::convert::Infallible;

    fn read(&self, give: &(dyn Fn(&Block) + Sync)) -> Result<(), Self::Error> {
        use rayon::prelude::*;
        self.blocks.par_iter().for_each(give);
        Ok(())
    }
}

#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// Ghosts that are called so, ghosts that are not, real points called ghosts, and the others.
    pub right: usize,
    pub missed: usize,
    pub wrong: usize,
    pub real: usize,
    pub undecided: usize,
    /// The errors of unfolded places, in m, and how many are within their intervals.
    pub median: f64,
    pub p95: f64,
    pub covered: usize,
    pub noise: f64,
    /// Of each tenth of probability: the suspects, and those that are ghosts.
    pub held: [[usize; 2]; 10],
}

impl Figures {
    pub fn f1(&self) -> f64 {
        2.0 * self.right as f64 / (2 * self.right + self.missed + self.wrong) as f64
    }

    pub fn coverage(&self) -> f64 {
        self.covered as f64 / self.right as f64
    }

    /// The row of a table.
    pub fn row(&self, name: &str, stations: usize) -> String {
        let ghosts = self.right + self.missed;
        format!(
            "| {name} | {stations} | {:.0} | {ghosts} | {:.4} | {:.3} | {:.3} | {:.2} | {:.2} | {:.1} |",
            self.noise * 1000.0,
            self.f1(),
            100.0 * self.wrong as f64 / (self.real + self.wrong) as f64,
            100.0 * self.undecided as f64 / (self.real + self.wrong + ghosts) as f64,
            self.median * 1000.0,
            self.p95 * 1000.0,
            self.coverage() * 100.0
        )
    }
}

pub const HEAD: &str = "| mirror | stations | noise, mm | ghosts | F1 | real called ghosts, % | undecided, % | \
                        put back, median, mm | p95, mm | within their interval, % |\n\
                        |---|---|---|---|---|---|---|---|---|---|";

/// Turns a mirror about the vertical, in degrees, and moves it.
#[allow(dead_code, reason = "not all programs of tests have all mirrors")]
pub fn moved(mirror: &Mirror, degrees: f64, by: DVec3) -> Mirror {
    let turn = DQuat::from_rotation_z(degrees.to_radians());
    Mirror { position: mirror.position + by, rotation: turn * mirror.rotation, ..mirror.clone() }
}
