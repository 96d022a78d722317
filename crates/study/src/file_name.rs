//! Makes names of files from titles that people wrote.

/// Returns a name that every file system accepts. It is empty if the text has neither a letter from a to z nor a digit.
pub fn file_name(text: &str) -> String {
    let plain = |character: char| if character.is_ascii_alphanumeric() { character.to_ascii_lowercase() } else { '-' };
    let words: String = text.chars().map(plain).collect();
    words.split('-').filter(|word| !word.is_empty()).collect::<Vec<_>>().join("-")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_name_keeps_letters_and_digits_only() {
        assert_eq!(file_name("Newton, culled (2)"), "newton-culled-2");
        assert_eq!(file_name("(·)"), "");
    }
}
