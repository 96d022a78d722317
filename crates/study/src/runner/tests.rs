//! Orders of rounds, shards, and which settings are shown.

use super::*;

fn cases() -> Vec<Case> {
    let text = "title = \"a\"\n[[group]]\nscenes = [\"b\", \"a\"]\nmethods = [\"sscr\", \"none\"]\n\
                sweep = { \"splat.size\" = [1, 2, 3, 4, 5] }";
    Plan::parse("test", text).unwrap().cases()
}

fn indices(order: &[&Case]) -> Vec<usize> {
    order.iter().map(|case| case.index).collect()
}

#[test]
fn every_round_draws_all_settings_in_an_order_of_its_own() {
    let cases = cases();
    let rounds: Vec<Vec<usize>> = (0..4).map(|round| indices(&in_order(&cases, round))).collect();
    // Scene by scene.
    assert_eq!(rounds[0], (10..20).chain(0..10).collect::<Vec<_>>());
    for (round, order) in rounds.iter().enumerate() {
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..cases.len()).collect::<Vec<_>>(), "round {round}");
        assert!(rounds[..round].iter().all(|other| other != order), "round {round}");
    }
    assert_eq!(rounds[2], indices(&in_order(&cases, 2)), "and each time the same");
}

#[test]
fn each_setting_is_in_one_shard() {
    let shards: Vec<Shard> = ["1/3", "2/3", "3/3"].map(|text| text.parse().unwrap()).into();
    for case in 0..20 {
        assert_eq!(shards.iter().filter(|shard| shard.has(case)).count(), 1);
    }
    assert!((0..20).all(|case| Shard::WHOLE.has(case)));
    for wrong in ["0/3", "4/3", "1", "1/0", "a/b", ""] {
        assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
    }
}

#[test]
fn the_worst_setting_is_that_of_least_recall_and_of_largest_error() {
    let text = "title = \"a\"\n[[group]]\nscenes = [\"a\"]\npictures = true\nsweep = { \"splat.size\" = [1, 2, 3] }";
    let mut plan = Plan::parse("test", text).unwrap();
    let run = |(case, value): (usize, f64)| {
        let names = ["same_input_recall", "same_input_delta_e"];
        Run { case, figures: names.map(|name| (name.to_owned(), value)).into(), ..Run::default() }
    };
    let runs: Vec<Run> = [0.5, 0.2, 0.9].into_iter().enumerate().map(run).collect();
    let rows = results::rows(&plan, &plan.cases(), &runs);
    for (figure, expected) in [("same_input_recall", 1), ("same_input_delta_e", 2)] {
        plan.errors = vec![figure.into()];
        let shown: Vec<usize> = shown(&plan, &rows).iter().map(|(_, row)| row.case.index).collect();
        assert_eq!(shown, [expected], "{figure}");
    }
}

#[test]
fn scenes_are_loaded_anew_for_what_they_are_read_and_sampled_by_alone() {
    let cases = cases();
    let key = |parameter: &str, value: &str| {
        let mut settings = Settings::default();
        settings.set_text(parameter, value).unwrap();
        loading_key(&cases[0], &settings)
    };
    let default = loading_key(&cases[0], &Settings::default());
    assert_eq!(
        [key("splat.size", "3"), key("sscr.max_steps", "3"), key("trace.seed", "3")],
        [(); 3].map(|()| default.clone())
    );
    for (parameter, value) in [("scene.points", "5000"), ("color.by", "height"), ("view.up", "y"), ("light.by", "sun")]
    {
        assert_ne!(key(parameter, value), default, "{parameter}");
    }
}
