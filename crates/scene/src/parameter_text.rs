//! The values of parameters in files.

/// A parameter's value in the form in which files hold it: numbers and switches are written as such, so that a person
/// may edit them without quotes.
pub(crate) fn value_of(key: &str, text: &str) -> toml::Value {
    let value = toml::Value::String(text.to_owned());
    let plain = text.parse().map(toml::Value::Integer).or_else(|_| text.parse().map(toml::Value::Float));
    let plain = plain.or_else(|_| text.parse().map(toml::Value::Boolean));
    if key == "color.attribute" { value } else { plain.unwrap_or(value) }
}

/// The text of a parameter's value in a file.
pub(crate) fn text_of(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}
