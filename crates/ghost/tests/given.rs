//! Ghosts of mirrors that are given, in made scans of which everything is known.

mod made;

use made::{HEAD, Made, NOISES, column, facing, floor_mirror, pane, sphere, wall_mirror, wavy_water};
use scene::Mirror;

type Case = (&'static str, Vec<Mirror>, f64);

/// The mirrors, and the least F1 of the specification.
fn cases() -> Vec<Case> {
    vec![
        ("plane", vec![wall_mirror()], 0.98),
        ("plane on the floor", vec![floor_mirror()], 0.98),
        ("wavy water on the floor", vec![wavy_water()], 0.95),
        ("two facing planes", facing(), 0.98),
        ("sphere", vec![sphere()], 0.95),
        ("column", vec![column()], 0.95),
        ("pane, 0.1 reflected", vec![pane(0.1)], 0.0),
        ("pane, 0.3 reflected", vec![pane(0.3)], 0.0),
        ("pane, 0.5 reflected", vec![pane(0.5)], 0.0),
        ("pane, 0.7 reflected", vec![pane(0.7)], 0.5),
        ("pane, 0.9 reflected", vec![pane(0.9)], 0.6),
    ]
}

/// Run with `--ignored --nocapture` for the table of docs/ghosts.md.
#[test]
#[ignore = "takes minutes: it prints the table of docs/ghosts.md"]
fn figures() {
    println!("{HEAD}");
    let mut held = [[0; 2]; 10];
    for (name, mirrors, _) in cases() {
        for stations in [1, 2] {
            for noise in NOISES {
                let made = Made::new(mirrors.clone(), stations, noise, 400_000.0);
                let figures = made.judge(&made.verdicts(&made.exact_mirrors()), noise);
                println!("{}", figures.row(name, stations));
                if name.starts_with("pane") {
                    held.iter_mut().zip(figures.held).for_each(|(all, own)| {
                        (all[0], all[1]) = (all[0] + own[0], all[1] + own[1]);
                    });
                }
            }
        }
        let made = Made::new(mirrors.clone(), 2, 0.003, 400_000.0).merged();
        println!("{}", made.judge(&made.verdicts(&made.exact_mirrors()), 0.003).row(&format!("{name}, one file"), 2));
    }
    println!("\n| probability | points of panes | ghosts, % |\n|---|---|---|");
    for (tenth, [points, ghosts]) in held.into_iter().enumerate() {
        let share = 100.0 * ghosts as f64 / points as f64;
        println!("| {:.1} to {:.1} | {points} | {share:.1} |", tenth as f64 / 10.0, (tenth + 1) as f64 / 10.0);
    }
}

#[test]
fn ghosts_of_given_mirrors_are_told_and_put_back() {
    for (name, mirrors, least) in cases() {
        let made = Made::new(mirrors, 2, 0.002, 300_000.0);
        let figures = made.judge(&made.verdicts(&made.exact_mirrors()), 0.002);
        println!("{}", figures.row(name, 2));
        assert!(figures.f1() >= least, "{name}: {figures:?}");
        // Of a pane, floors before and behind it are mirror images of each other: such points stay undecided.
        assert!(figures.wrong * 500 <= figures.real, "{name}: {figures:?}");
        if least > 0.0 {
            assert!(figures.median <= 0.004 && (0.92..=0.99).contains(&figures.coverage()), "{name}: {figures:?}");
        }
    }
}
