//! Paths as people see them. On Unix a name may be any bytes.

use std::path::Path;

/// The path as text, with `\xe4` for each byte that is not text: different paths give different texts.
pub fn shown(path: impl AsRef<Path>) -> String {
    let mut text = String::new();
    for chunk in path.as_ref().as_os_str().as_encoded_bytes().utf8_chunks() {
        text.push_str(chunk.valid());
        chunk.invalid().iter().for_each(|byte| text.push_str(&format!("\\x{byte:02x}")));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stays_and_other_bytes_are_told_apart() {
        assert_eq!(shown("a/Wäld.laz"), "a/Wäld.laz");
        #[cfg(unix)]
        {
            use std::ffi::OsStr;
            use std::os::unix::ffi::OsStrExt as _;
            assert_eq!(shown(OsStr::from_bytes(b"w\xe4l\xff\xfed")), r"w\xe4l\xff\xfed");
        }
    }
}
