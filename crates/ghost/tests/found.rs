//! Mirrors that are found without help, in made scans of which everything is known.

mod made;

use std::f64::consts::FRAC_PI_2;

use cloud::Progress;
use ghost::{Found, Gauge, Mirrors, find};
use glam::{DQuat, DVec3};
use made::{HEAD, Made, NOISES, column, facing, moved, pane, sphere, wall_mirror, with_window};
use scene::solid::Solid;
use scene::{Mirror, Shape, Tripod};

fn gauge(made: &Made) -> Gauge {
    Gauge::of(made, &made.stations, made.extent(), made.count(), &Progress::default())
        .expect("no error")
        .expect("nobody cancels")
}

fn found(made: &Made) -> Vec<Found> {
    find(&gauge(made), &Progress::default()).expect("nobody cancels")
}

fn mirrors(found: &[Found]) -> Mirrors {
    Mirrors::new(found.iter().map(|found| found.reflector.clone()).collect())
}

type Case = (&'static str, Vec<Solid>, Vec<Mirror>);

fn cases() -> Vec<Case> {
    let room = || Tripod::Room.solids();
    let tilted = moved(&wall_mirror(), 2.0, DVec3::ZERO);
    let cylinder = |place: [f64; 3], rotation, height, size| {
        let (position, shape) = (DVec3::from(place), Shape::Cylinder { height });
        vec![Mirror { position, rotation, shape, size, ..column() }]
    };
    let upright = DQuat::IDENTITY;
    let leaning = DQuat::from_rotation_x(3.0_f64.to_radians());
    let along_x = DQuat::from_rotation_y(FRAC_PI_2);
    vec![
        ("plane", room(), vec![wall_mirror()]),
        ("plane, 2 degrees off its wall", room(), vec![tilted]),
        ("two facing planes", room(), facing()),
        ("column", room(), vec![column()]),
        ("column up to the ceiling", room(), cylinder([4.4, 3.9, 1.5], upright, 10.0, 0.15)),
        ("column of 5 cm", room(), cylinder([4.4, 3.9, 1.2], upright, 24.0, 0.05)),
        ("column of 0.4 m", room(), cylinder([4.4, 3.9, 1.2], upright, 3.0, 0.4)),
        ("column that leans by 3 degrees", room(), cylinder([4.4, 3.9, 1.2], leaning, 8.0, 0.15)),
        ("pipe from wall to wall", room(), cylinder([4.0, 4.5, 2.0], along_x, 40.0, 0.1)),
        ("window, 0.3 reflected", with_window(), vec![pane(0.3)]),
        ("window, 0.5 reflected", with_window(), vec![pane(0.5)]),
        ("window, 0.7 reflected", with_window(), vec![pane(0.7)]),
        ("window, 0.9 reflected", with_window(), vec![pane(0.9)]),
    ]
}

/// Run with `--ignored --nocapture` for the tables of docs/ghosts.md.
#[test]
#[ignore = "takes minutes: it prints the tables of docs/ghosts.md"]
fn figures() {
    println!("{HEAD}");
    for (name, solids, exact) in cases() {
        for stations in [1, 2] {
            for noise in NOISES {
                let places = Tripod::Four.stations()[..stations].to_vec();
                let made = Made::of(solids.clone(), exact.clone(), places, noise, 500_000.0);
                let found = found(&made);
                println!("{}", made.judge(&made.verdicts(&mirrors(&found)), noise).row(name, stations));
                for Found { reflector, reason } in &found {
                    let Mirror { position, rotation, size, .. } = &reflector.mirror;
                    let normal = *rotation * DVec3::Z;
                    println!("    at {position:.4}, normal {normal:.5}, size {size:.3}; {reason}");
                }
            }
        }
    }
    println!("\n| scan without mirrors | points | mirrors found | points called ghosts, % |\n|---|---|---|---|");
    for tripod in [Tripod::Room, Tripod::Four, Tripod::Hall40, Tripod::Street, Tripod::Church] {
        for noise in NOISES {
            let made = Made::of(tripod.solids(), Vec::new(), tripod.stations(), noise, 500_000.0);
            let found = found(&made);
            let figures = made.judge(&made.verdicts(&mirrors(&found)), noise);
            let share = 100.0 * figures.wrong as f64 / made.count() as f64;
            println!("| {}, {:.0} mm | {} | {} | {share:.4} |", tripod.name(), noise * 1e3, made.count(), found.len());
            found.iter().for_each(|found| println!("    {:?} {}", found.reflector.mirror.position, found.reason));
        }
    }
}

#[test]
fn a_mirror_on_a_wall_is_found_where_it_is() {
    let made = Made::new(vec![wall_mirror()], 1, 0.002, 400_000.0);
    let found = found(&made);
    assert_eq!(found.len(), 1, "{found:?}");
    let Mirror { position, rotation, .. } = found[0].reflector.mirror;
    let normal = rotation * DVec3::Z;
    assert!(normal.dot(DVec3::NEG_Y) > 1.0 - 1e-6, "{normal}");
    assert!((position - wall_mirror().position).dot(normal).abs() < 0.001, "{position}");
    let figures = made.judge(&made.verdicts(&mirrors(&found)), 0.002);
    println!("{}", figures.row("plane, found", 1));
    assert!(figures.f1() > 0.9 && figures.wrong * 1000 <= figures.real, "{figures:?}");
    assert!(figures.median < 0.004, "{figures:?}");
}

/// A scanner that stands upright sees a thin column in so few rows of points that one always fits.
#[test]
fn a_sparse_scan_has_its_mirror_and_no_column_by_chance() {
    let stations = Tripod::Room.stations();
    let made = Made::seeded(Tripod::Room.solids(), vec![wall_mirror()], stations, 0.002, 150_000.0, 1);
    let gauge = gauge(&made);
    assert!(gauge.too_few().is_some_and(|count| count < 150_001));
    let found = find(&gauge, &Progress::default()).expect("nobody cancels");
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(matches!(found[0].reflector.mirror.shape, Shape::Plane { .. }), "{found:?}");
    let figures = made.judge(&made.verdicts(&mirrors(&found)), 0.002);
    println!("{}", figures.row("plane, found in a sparse scan", 1));
    assert!(figures.f1() > 0.95 && figures.wrong * 1000 <= figures.real, "{figures:?}");
}

#[test]
fn a_window_is_found_by_its_frame() {
    let made = Made::of(with_window(), vec![pane(0.8)], Tripod::Room.stations(), 0.002, 400_000.0);
    let found = found(&made);
    assert_eq!(found.len(), 1, "{found:?}");
    let figures = made.judge(&made.verdicts(&mirrors(&found)), 0.002);
    println!("{}", figures.row("window, 0.8 reflected, found", 1));
    assert!(figures.f1() > 0.9 && figures.wrong * 1000 <= figures.real, "{figures:?}");
}

#[test]
fn a_ball_is_found_by_its_outline() {
    let made = Made::new(vec![sphere()], 1, 0.002, 400_000.0);
    let found = found(&made);
    assert_eq!(found.len(), 1, "{found:?}");
    let Mirror { position, size, .. } = found[0].reflector.mirror;
    assert!(position.distance(sphere().position) < 0.01 && (size - 0.4).abs() < 0.005, "{position} {size}");
    let figures = made.judge(&made.verdicts(&mirrors(&found)), 0.002);
    println!("{}", figures.row("sphere, found", 1));
    assert!(figures.f1() > 0.9 && figures.wrong * 1000 <= figures.real, "{figures:?}");
}

#[test]
fn a_column_is_found_by_its_straight_outlines() {
    let made = Made::new(vec![column()], 1, 0.002, 400_000.0);
    let found = found(&made);
    assert_eq!(found.len(), 1, "{found:?}");
    let Mirror { position, rotation, size, shape, .. } = &found[0].reflector.mirror;
    let (off, axis) = ((*position - column().position).truncate().length(), *rotation * DVec3::Z);
    println!("off by {off:.4}, radius {size:.4}, axis {axis:.4}, {shape:?}, middle {position:.3}: {}", found[0].reason);
    assert!(off < 0.005 && (size - 0.15).abs() < 0.003 && axis.z.abs() > 0.9999, "{found:?}");
    let figures = made.judge(&made.verdicts(&mirrors(&found)), 0.002);
    println!("{}", figures.row("column, found", 1));
    assert!(figures.f1() > 0.95 && figures.wrong * 1000 <= figures.real, "{figures:?}");
}

/// The second station stands below the pipe and sees a part of it that the first one does not.
#[test]
fn a_pipe_is_as_long_as_both_stations_see_it() {
    let (.., exact) = cases().into_iter().find(|(name, ..)| *name == "pipe from wall to wall").expect("a case");
    let made = Made::new(exact, 2, 0.002, 300_000.0);
    let found = found(&made);
    assert_eq!(found.len(), 1, "{found:?}");
    let figures = made.judge(&made.verdicts(&mirrors(&found)), 0.002);
    println!("{} {:?}", figures.row("pipe, found", 2), found[0].reflector.mirror);
    assert!(figures.f1() > 0.9 && figures.wrong * 1000 <= figures.real, "{figures:?}");
}

/// A mirror that a person has placed by hand is measured, and put where it is.
#[test]
fn a_mirror_that_is_moved_is_measured_and_fitted() {
    let shifted = |mirror: &Mirror| moved(mirror, 1.5, DVec3::new(0.01, 0.03, 0.005));
    for exact in [wall_mirror(), sphere(), column()] {
        let name = exact.shape.name();
        let made = Made::new(vec![exact.clone()], 1, 0.002, 400_000.0);
        let gauge = gauge(&made);
        let [right, off] = [&exact, &shifted(&exact)].map(|mirror| gauge.measured(mirror));
        println!("{name}: {right:?} {off:?}");
        assert!(right.points > 1000 && right.near as f64 > 0.95 * right.points as f64, "{name}: {right:?}");
        assert!(right.median.is_some_and(|median| median < 0.002), "{name}: {right:?}");
        assert!(off.median.is_some_and(|median| median > 0.008), "{name}: {off:?}");
        let fitted = gauge.fitted(&shifted(&exact)).expect("there are enough points");
        let after = gauge.measured(&fitted);
        assert!(after.median.is_some_and(|median| median < 0.0025), "{name}: {after:?} {fitted:?}");
        let apart = fitted.position - exact.position;
        let off = match exact.shape {
            Shape::Plane { .. } => apart.dot(exact.rotation * DVec3::Z).abs(),
            Shape::Cylinder { .. } => apart.reject_from_normalized(exact.rotation * DVec3::Z).length(),
            _ => apart.length(),
        };
        println!("    fitted: {after:?}, off by {off:.4}, size {:.4}", fitted.size);
        assert!(off < 0.005, "{name}: {fitted:?}");
    }
    // A mirror that is moved along its normal leaves the floor in it where it is.
    let made = Made::new(vec![pane(0.9)], 1, 0.002, 100_000.0);
    let off = gauge(&made).measured(&moved(&pane(0.9), 0.0, DVec3::new(0.03, 0.0, 0.0)));
    assert!(off.median.is_some_and(|median| median > 0.03), "{off:?}");
    let made = Made::new(vec![wall_mirror()], 1, 0.002, 50_000.0);
    let aside = moved(&wall_mirror(), 0.0, DVec3::new(0.0, 50.0, 0.0));
    let gauge = gauge(&made);
    assert_eq!((gauge.measured(&aside).points, gauge.fitted(&aside)), (0, None));
}

#[test]
fn scans_without_mirrors_have_none() {
    for tripod in [Tripod::Room, Tripod::Hall40, Tripod::Street, Tripod::Church] {
        let made = Made::of(tripod.solids(), Vec::new(), tripod.stations(), 0.002, 100_000.0);
        let found = found(&made);
        let figures = made.judge(&made.verdicts(&mirrors(&found)), 0.002);
        assert!(figures.wrong as f64 <= 1e-3 * made.count() as f64, "{tripod:?}: {found:?} {figures:?}");
    }
}
