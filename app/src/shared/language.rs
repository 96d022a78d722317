//! The texts of the window in the language that it speaks. The English text is the key; what a table lacks stays
//! English.

use std::cell::Cell;
use std::collections::HashMap;
use std::fmt::Display;
use std::sync::LazyLock;

use scene::Language;

/// The texts of one language by their English ones.
pub type Table = HashMap<String, String>;

/// The tables, by the code that names of locales begin with.
static TABLES: LazyLock<[(Language, &str, Table); 1]> = LazyLock::new(|| {
    let german = toml::from_str(include_str!("../../../assets/languages/de.toml")).expect("a test reads the table");
    [(Language::German, "de", german)]
});

thread_local! {
    /// The table of the language that this thread speaks; without one it speaks English, as commands do.
    static SPOKEN: Cell<Option<&'static Table>> = const { Cell::new(None) };
}

/// A text of the window. `text!("Open…")` is the text in the window's language, `text!("{count} points", count = 3)` a
/// `String` with values at its named places. Values that are variables of that name need no more than the name.
macro_rules! text {
    ($english:literal $(,)?) => { $crate::shared::language::translated($english) };
    ($english:literal, $($name:ident $(= $value:expr)?),+ $(,)?) => {
        $crate::shared::language::filled(
            $english,
            &[$((stringify!($name), &$crate::shared::language::text!(@value $name $(= $value)?))),+],
        )
    };
    (@value $name:ident) => { $name };
    (@value $name:ident = $value:expr) => { $value };
}
pub(crate) use text;

/// Marks a text of the window in a constant; where it is shown, it is `translated`.
macro_rules! english {
    ($english:literal) => {
        $english
    };
}
pub(crate) use english;

/// The tables with the codes of their languages.
#[cfg(test)]
pub fn tables() -> impl Iterator<Item = (&'static str, &'static Table)> {
    TABLES.iter().map(|(_, code, table)| (*code, table))
}

/// The language of the window from now on, for this thread.
pub fn speak(language: Language) {
    let system = || {
        let names = ["LC_ALL", "LC_MESSAGES", "LANG"].map(|name| std::env::var(name).unwrap_or_default());
        names.into_iter().find(|name| !name.is_empty()).unwrap_or_default()
    };
    let is_spoken = |(known, code, _): &&(Language, &str, Table)| match language {
        Language::System => system().split(['_', '.', '@']).next() == Some(code),
        _ => *known == language,
    };
    SPOKEN.set(TABLES.iter().find(is_spoken).map(|(_, _, table)| table));
}

/// What is made while this thread speaks English.
pub fn in_english<T>(make: impl FnOnce() -> T) -> T {
    let spoken = SPOKEN.replace(None);
    let made = make();
    SPOKEN.set(spoken);
    made
}

/// Whether this thread speaks English.
pub fn is_english() -> bool {
    SPOKEN.get().is_none()
}

/// The text in the language of this thread, or itself where there is none.
pub fn translated(english: &str) -> &str {
    SPOKEN.get().and_then(|table| table.get(english)).map_or(english, String::as_str)
}

/// The text in the language of this thread with the values at its places.
pub fn filled(english: &str, values: &[(&str, &dyn Display)]) -> String {
    let mut rest = translated(english);
    let mut filled = String::with_capacity(rest.len() + 16);
    while let Some((before, (place, after))) =
        rest.split_once('{').and_then(|(before, after)| Some((before, after.split_once('}')?)))
    {
        filled += before;
        match values.iter().find(|(name, _)| *name == place) {
            Some((_, value)) => filled += &value.to_string(),
            None => filled += &format!("{{{place}}}"),
        }
        rest = after;
    }
    filled + rest
}
