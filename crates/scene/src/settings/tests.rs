//! Tests of the table of parameters.

use super::*;

#[test]
fn a_shown_point_is_three_numbers() {
    let shown = |text: &str| {
        let mut settings = Settings::default();
        settings.set_text("reflection.point", text).unwrap();
        settings.reflection.shown_point()
    };
    assert_eq!(shown("635619.123456, -1 2e3"), Some(DVec3::new(635_619.123_456, -1.0, 2e3)));
    assert_eq!(shown(""), None);
    for odd in ["1, 2", "1, 2, 3, 4", "a, b, c", "nan, 0, 0"] {
        let mut settings = Settings::default();
        let refusal = settings.set_text("reflection.point", odd).unwrap_err().to_string();
        assert!(refusal.contains(&format!("reflection.point: {odd} is no point, expected three numbers")), "{refusal}");
        assert!(settings.reflection.point.is_empty());
    }
}

#[test]
fn differing_values_rebuild_the_settings() {
    let mut settings = Settings::default();
    settings.set_text("splat.size", "2.5").unwrap();
    settings.set_text("color.by", "attribute").unwrap();
    settings.set_text("color.attribute", "Deviation, 2nd").unwrap();
    settings.set_text("view.background", "#ffffff").unwrap();
    let mut back = Settings::default();
    for (key, text) in settings.differing() {
        back.set_text(&key, &text).unwrap();
    }
    assert_eq!(back, settings);
    assert_eq!(settings.differing().len(), 4);
}

#[test]
fn changes_are_taken_over_and_nothing_else_is() {
    let of = |pairs: &[(&str, &str)]| {
        let mut settings = Settings::default();
        pairs.iter().for_each(|(key, text)| settings.set_text(key, text).unwrap());
        settings
    };
    let own = of(&[("splat.size", "2"), ("edl.strength", "0.1")]);
    let before = of(&[("splat.size", "3"), ("light.by", "sun"), ("view.frame_ms", "50")]);
    let now = of(&[("splat.size", "3"), ("light.by", "lights"), ("edl.radius", "2")]);
    let expected = of(&[("splat.size", "2"), ("edl.strength", "0.1"), ("light.by", "lights"), ("edl.radius", "2")]);
    assert_eq!(own.with_changes(&before, &now), expected);
    assert_eq!(own.with_changes(&now, &now), own);
}

#[test]
fn unknown_keys_name_the_nearest_known_one() {
    let mut settings = Settings::default();
    let message = |settings: &mut Settings, key: &str| settings.set_text(key, "1").unwrap_err().to_string();
    assert_eq!(message(&mut settings, "splat.sise"), "splat.sise: no such parameter; did you mean `splat.size`?");
    assert_eq!(message(&mut settings, "spalt.size"), "spalt.size: no such parameter; did you mean `splat.size`?");
    assert_eq!(message(&mut settings, "nonsense"), "nonsense: no such parameter; `glint methods` lists them");
    for (old, new) in RENAMED {
        let expected = format!("{old}: no such parameter; did you mean `{new}`?");
        assert_eq!(message(&mut settings, old), expected);
        assert!(settings.all().iter().any(|(key, _)| key == new));
    }
}

#[test]
fn keys_are_unique() {
    let mut keys: Vec<String> = Settings::default().all().into_iter().map(|(key, _)| key).collect();
    let count = keys.len();
    keys.sort();
    keys.dedup();
    assert_eq!(keys.len(), count);
}
