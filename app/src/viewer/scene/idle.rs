//! Parameters that change nothing as the others of their group stand: the panel says so, and nothing is drawn for them.

use param::{Field, Params, Value};
use scene::Settings;

use crate::shared::language::text;

/// While a parameter of a group has a value, or another one than that, others of the group change nothing.
struct Rule {
    group: &'static str,
    by: &'static str,
    while_it: While,
    idle: &'static [&'static str],
}

enum While {
    Is(&'static str),
    IsNot(&'static str),
}

const RULES: [Rule; 7] = [
    Rule {
        group: "gloss",
        by: "samples",
        while_it: While::Is("0"),
        idle: &[
            "lobe",
            "across",
            "pattern",
            "seed",
            "cache",
            "cache_power",
            "cache_spread",
            "cache_trust",
            "blur",
            "blur_most",
        ],
    },
    Rule { group: "gloss", by: "lobe", while_it: While::IsNot("ashikhmin_shirley"), idle: &["across"] },
    Rule {
        group: "gloss",
        by: "lobe",
        while_it: While::Is("ashikhmin_shirley"),
        idle: &["cache_power", "cache_spread", "cache_trust"],
    },
    Rule { group: "gloss", by: "cache_power", while_it: While::Is("0"), idle: &["cache_spread", "cache_trust"] },
    Rule { group: "gloss", by: "blur", while_it: While::Is("0"), idle: &["blur_most"] },
    Rule { group: "gi", by: "by", while_it: While::Is("lights"), idle: &["rays_per_pixel", "ray_bounces", "ray_seed"] },
    Rule { group: "edl", by: "strength", while_it: While::Is("0"), idle: &["radius", "ignored"] },
];

impl Rule {
    fn holds(&self, params: &dyn Params) -> bool {
        let fields = params.group().fields.iter().zip(params.values());
        let found = fields.filter(|(field, _)| field.name == self.by).map(|(field, value)| field.format(&value)).next();
        match self.while_it {
            While::Is(wanted) => found.is_some_and(|found| found == wanted),
            While::IsNot(other) => found.is_some_and(|found| found != other),
        }
    }

    fn text(&self) -> String {
        let Self { group, by, .. } = self;
        match self.while_it {
            While::Is(value) => text!("{group}.{by} is {value}: these change nothing.", group, by, value),
            While::IsNot(value) => text!("{group}.{by} is not {value}: these change nothing.", group, by, value),
        }
    }
}

/// Why a parameter changes nothing now, for people.
pub fn reason(params: &dyn Params, name: &str) -> Option<String> {
    rule(params, name).map(Rule::text)
}

/// The rule by which a parameter changes nothing now.
fn rule(params: &dyn Params, name: &str) -> Option<&'static Rule> {
    let group = params.group().name;
    RULES.iter().filter(|rule| rule.group == group && rule.idle.contains(&name)).find(|rule| rule.holds(params))
}

/// What a picture is drawn with: parameters that change nothing are at their defaults, so that nothing is drawn anew where
/// one of them changes.
pub fn drawn(settings: &Settings) -> Settings {
    let mut drawn = settings.drawn();
    for params in drawn.groups_mut() {
        let group = params.group();
        let fields = group.fields.iter().zip(params.values());
        let is_idle = |field: &Field| rule(&*params, field.name).is_some();
        let value = |(field, value): (&Field, Value)| if is_idle(field) { field.default() } else { value };
        let values: Vec<Value> = fields.map(value).collect();
        params.set_values(&values);
    }
    drawn
}

#[cfg(test)]
mod tests {
    use param::Kind;

    use super::*;
    use crate::viewer::bench::Bench;

    /// Settings in which a rule holds and no other one of the same parameters.
    fn settings_of(rule: &Rule, before: &Settings) -> Settings {
        let mut settings = before.clone();
        let mut set = |key: &str, text: &str| settings.set_text(key, text).expect("a value");
        set("gloss.samples", "2");
        set("gloss.cache_power", "200");
        set("gloss.blur", "1");
        let value = match rule.while_it {
            While::Is(value) => value,
            While::IsNot(_) => "blinn",
        };
        set(&format!("{}.{}", rule.group, rule.by), value);
        settings
    }

    /// Another value of each of these parameters.
    fn moved(settings: &mut Settings, group: &str, names: &[&str]) {
        for params in settings.groups_mut().into_iter().filter(|params| params.group().name == group) {
            for (field, value) in params.group().fields.iter().zip(params.values()) {
                let other = match (&field.kind, value) {
                    (Kind::Bool { .. }, Value::Bool(on)) => Value::Bool(!on),
                    (Kind::F32 { min, max, .. }, Value::F32(now)) => Value::F32(if now == *max { *min } else { *max }),
                    (Kind::U32 { min, max, .. }, Value::U32(now)) => Value::U32(if now == *max { *min } else { *max }),
                    (Kind::Choice { names, .. }, Value::Choice(now)) => Value::Choice((now + 1) % names.len() as u32),
                    (_, value) => value,
                };
                if names.contains(&field.name) {
                    params.set(field.name, other).expect("a value in range");
                }
            }
        }
    }

    #[test]
    fn what_is_said_to_change_nothing_changes_no_picture() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        bench.session.scene.objects.mirrors[0].mirror.specular_power = 60.0;
        bench.session.scene.settings.set_text("reflection.method", "surfel_trace").unwrap();
        bench.settle();
        let request = bench.session.frames.shown.as_ref().unwrap().request.clone();
        for rule in &RULES {
            let mut settings = settings_of(rule, &request.settings);
            let picture = bench.read_of(request.unhurried(&settings));
            let groups = settings.groups();
            let params = groups.iter().find(|params| params.group().name == rule.group).unwrap();
            let mut idle = rule.idle.iter().filter(|name| reason(*params, name) == Some(rule.text()));
            assert!(idle.clone().count() > 0 && idle.all(|name| *name != rule.by), "{}", rule.text());
            moved(&mut settings, rule.group, rule.idle);
            assert!(bench.read_of(request.unhurried(&settings)) == picture, "{}", rule.text());
            assert_eq!(drawn(&settings), drawn(&settings_of(rule, &request.settings)), "{}", rule.text());
        }
    }

    #[test]
    fn a_value_that_changes_nothing_asks_for_no_picture() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let shown = |bench: &Bench| bench.session.frames.shown.as_ref().unwrap().request.clone();
        let before = shown(&bench);
        bench.session.scene.settings.gloss.cache_power = 300.0;
        bench.settle();
        assert!(shown(&bench) == before && bench.session.frames.time_to_late(std::time::Instant::now()).is_none());
        bench.session.scene.settings.gloss.samples = 2;
        bench.settle();
        assert!(shown(&bench).settings.gloss.cache_power == 300.0);
    }
}
