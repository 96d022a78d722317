//! The comments of a scene file that a person has written. When the program saves the file anew, they stay where the
//! thing that they stand at is still in the scene.

use toml_edit::{ArrayOfTables, DocumentMut, Item, Key, KeyMut, RawString, Table, Value};

/// The longest text whose comments are kept, in bytes: parsed with all blanks and comments, it takes many times as much.
const MOST_BYTES: usize = 1 << 20;
/// The keys that tell the elements of a list apart.
const NAMES: [&str; 3] = ["name", "text", "cloud"];

/// Returns the text of a scene file with the comments of the text that it replaces, and with that one's spelling of the
/// values that are the same. Comments at what is no longer in the scene are left out with it.
pub fn with_comments(text: &str, before: &str) -> String {
    if !before.contains('#') || text.len().max(before.len()) > MOST_BYTES {
        return text.to_owned();
    }
    let (Ok(old), Ok(mut new)) = (before.parse::<DocumentMut>(), text.parse::<DocumentMut>()) else {
        return text.to_owned();
    };
    take_over(new.as_table_mut(), old.as_table());
    if let Some(last) = comment(Some(old.trailing())) {
        new.set_trailing(last);
    }
    let commented = new.to_string();
    // The scene matters more than its comments.
    let values = |text: &str| toml::from_str::<toml::Table>(text).ok();
    if values(&commented) == values(text) { commented } else { text.to_owned() }
}

/// Blanks, if there is a comment between them.
fn comment(blanks: Option<&RawString>) -> Option<&str> {
    blanks.and_then(RawString::as_str).filter(|blanks| blanks.contains('#'))
}

/// Takes the comments of a table over for those of its entries that are in the other one, too.
fn take_over(new: &mut Table, old: &Table) {
    for (mut key, item) in new.iter_mut() {
        let Some((old_key, old_item)) = old.get_key_value(key.get()) else { continue };
        match (&mut *item, old_item) {
            (Item::Table(new), Item::Table(old)) => take_over(new, old),
            (Item::ArrayOfTables(new), Item::ArrayOfTables(old)) => take_over_list(new, old),
            (Item::Value(new), Item::Value(old)) if is_same(new, old) => *new = old.clone(),
            _ => {}
        }
        put(&mut key, item, of(old_key, old_item));
    }
}

/// The comments above an entry and behind its first line.
fn of<'a>(key: &'a Key, item: &'a Item) -> [Option<&'a str>; 2] {
    match item {
        Item::Value(value) => [comment(key.leaf_decor().prefix()), comment(value.decor().suffix())],
        Item::Table(table) => of_table(table),
        _ => [None, None],
    }
}

fn of_table(table: &Table) -> [Option<&str>; 2] {
    [comment(table.decor().prefix()), comment(table.decor().suffix())]
}

fn put(key: &mut KeyMut<'_>, item: &mut Item, [above, behind]: [Option<&str>; 2]) {
    match item {
        Item::Value(value) => {
            if let Some(above) = above {
                key.leaf_decor_mut().set_prefix(above.trim_start_matches('\n'));
            }
            if let Some(behind) = behind {
                value.decor_mut().set_suffix(behind);
            }
        }
        Item::Table(table) => put_table(table, [above, behind]),
        _ => {}
    }
}

fn put_table(table: &mut Table, [above, behind]: [Option<&str>; 2]) {
    if let Some(above) = above {
        table.decor_mut().set_prefix(format!("\n{}", above.trim_start_matches('\n')));
    }
    if let Some(behind) = behind {
        table.decor_mut().set_suffix(behind);
    }
}

/// Elements of lists are known by their names; others by being the same, or by their place in a list of the same
/// length.
fn take_over_list(new: &mut ArrayOfTables, old: &ArrayOfTables) {
    let is_as_long = new.len() == old.len();
    let mut left: Vec<(usize, &Table)> = old.iter().enumerate().collect();
    for (index, table) in new.iter_mut().enumerate() {
        let found = match name(table) {
            Some(own) => left.iter().position(|(_, known)| name(known) == Some(own)),
            None => {
                let same = left.iter().position(|(_, known)| is_same_table(known, table));
                let there = |(place, known): &(usize, &Table)| is_as_long && *place == index && name(known).is_none();
                same.or_else(|| left.iter().position(there))
            }
        };
        if let Some(found) = found {
            let (_, known) = left.remove(found);
            take_over(table, known);
            put_table(table, of_table(known));
        }
    }
}

fn name(table: &Table) -> Option<&str> {
    NAMES.iter().find_map(|key| table.get(key)?.as_str())
}

fn is_same_table(a: &Table, b: &Table) -> bool {
    a.len() == b.len() && a.iter().all(|(key, item)| b.get(key).is_some_and(|other| is_same_item(item, other)))
}

fn is_same_item(a: &Item, b: &Item) -> bool {
    match (a, b) {
        (Item::Value(a), Item::Value(b)) => is_same(a, b),
        (Item::Table(a), Item::Table(b)) => is_same_table(a, b),
        _ => false,
    }
}

/// Whether two values are the same, however they are written.
fn is_same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::String(a), Value::String(b)) => a.value() == b.value(),
        (Value::Integer(a), Value::Integer(b)) => a.value() == b.value(),
        (Value::Float(a), Value::Float(b)) => a.value() == b.value(),
        (Value::Boolean(a), Value::Boolean(b)) => a.value() == b.value(),
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_same(a, b)),
        (Value::InlineTable(a), Value::InlineTable(b)) => {
            a.len() == b.len() && a.iter().all(|(key, a)| b.get(key).is_some_and(|b| is_same(a, b)))
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneFile;

    const WRITTEN: &str = r#"# The hall, first floor.
clouds = [
    "a.laz", # of May
    "b.laz",
]

# Where the surveyor stood.
[camera] # by hand
eye = [1.50, 2.0, 3.0]  # metres
pivot = [0.0, 0.0, 1.0]
up = [0.0, 0.0, 1.0]

[parameters]
# Thin walls.
"splat.size" = 1.50

# The leak.
[[notes]]
text = "wet"
position = [1.0, 1.0, 0.0] # on the floor

[[notes]]
text = "dry"  # checked
position = [2.0, 1.0, 0.0]

[[clips]]
name = "room"
# The north side.
position = [0.0, 0.0, 0.0]
size = [1.0, 1.0, 1.0]

# That is all.
"#;

    #[test]
    fn comments_stay_at_what_they_stand_at_and_go_with_it() {
        let mut file = SceneFile::parse(WRITTEN).unwrap();
        let text = file.to_text();
        let saved = with_comments(&text, WRITTEN);
        for line in WRITTEN.lines().filter(|line| line.contains('#')) {
            assert!(saved.contains(line), "{line} is missing in\n{saved}");
        }
        assert!(saved.starts_with("# The hall, first floor.\nclouds = [\n"), "{saved}");
        assert_eq!(SceneFile::parse(&saved).unwrap(), file);
        assert_eq!(with_comments(&text, &saved), saved, "the next time they are the same");
        // Another order, another value, one more and one fewer.
        file.notes.swap(0, 1);
        let more = crate::Note { text: "new".into(), ..file.notes[0].clone() };
        file.notes.insert(0, more);
        file.clips.clear();
        file.clouds.pop();
        let saved = with_comments(&file.to_text(), WRITTEN);
        assert_eq!(SceneFile::parse(&saved).unwrap(), file);
        assert!(saved.contains("# The leak.\n[[notes]]\ntext = \"wet\"\n"), "{saved}");
        assert!(
            saved.contains("text = \"dry\"  # checked\n") && saved.contains("# Thin walls.\n\"splat.size\" = 1.50")
        );
        assert!(!saved.contains("The north side") && !saved.contains("of May"), "{saved}");
    }

    #[test]
    fn a_text_that_replaces_none_or_nonsense_stays_as_it_is() {
        let text = SceneFile::parse(WRITTEN).unwrap().to_text();
        for before in ["", "clouds = []\n", "# nonsense\n[[[\n", "# a\nclouds = { a = 1 }\n"] {
            let saved = with_comments(&text, before);
            assert_eq!(SceneFile::parse(&saved).unwrap(), SceneFile::parse(&text).unwrap(), "{before}");
        }
        assert_eq!(with_comments(&text, "# nonsense\n[[[\n"), text);
    }
}
