//! Addresses of the web among paths: which path is one, and which addresses lie beside it.

use std::path::{Path, PathBuf};

/// Whether a path is an address that is fetched.
pub fn is_address(path: &Path) -> bool {
    let is_of = |scheme: &str| {
        let start = path.as_os_str().as_encoded_bytes().get(..scheme.len());
        start.is_some_and(|start| start.eq_ignore_ascii_case(scheme.as_bytes()))
    };
    is_of("http://") || is_of("https://")
}

/// An address in parts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    pub is_secure: bool,
    /// Host and port, in lower case, without the port that the scheme has anyway.
    pub authority: String,
    /// The path, which begins with a slash.
    pub path: String,
    /// What follows the path: empty, or a question mark and more.
    pub query: String,
}

impl Address {
    /// # Errors
    /// Says what is wrong with the address.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (scheme, rest) = text.split_once("://").ok_or("not an address")?;
        let is_secure = match scheme.to_ascii_lowercase().as_str() {
            "https" => true,
            "http" => false,
            _ => return Err("not an address of http or https".into()),
        };
        let rest = rest.split('#').next().unwrap_or_default();
        let end = rest.find(['/', '?']).unwrap_or(rest.len());
        let (authority, rest) = rest.split_at(end);
        if authority.contains('@') {
            return Err("a password in an address is not sent; GLINT_AUTHORIZATION or --authorization takes it".into());
        }
        // The colons of an IPv6 address stand in brackets.
        let with_port = authority.rsplit_once(':').filter(|(_, port)| !port.ends_with(']'));
        let (host, port) = with_port.unwrap_or((authority, ""));
        if host.is_empty() || host.contains(|c: char| c.is_whitespace() || c.is_control() || c == '\\') {
            return Err("an address without a host".into());
        }
        let is_port = |port: &str| {
            port.bytes().all(|byte| byte.is_ascii_digit()) && port.parse::<u16>().is_ok_and(|port| port > 0)
        };
        if !port.is_empty() && !is_port(port) {
            return Err(format!("`{}` is no port, which is a number from 1 to 65535", crate::brief::brief(port)));
        }
        // The port of the scheme is the one without a port, or with an empty one.
        let usual = if is_secure { 443 } else { 80 };
        let authority = if port.is_empty() || port.parse() == Ok(usual) { host } else { authority };
        let (path, query) = rest.split_at(rest.find('?').unwrap_or(rest.len()));
        let path = if path.is_empty() { "/" } else { path };
        let (path, query) = (encoded(path), encoded(query));
        Ok(Self { is_secure, authority: authority.to_ascii_lowercase(), path, query })
    }

    pub fn text(&self) -> String {
        let scheme = if self.is_secure { "https" } else { "http" };
        format!("{scheme}://{}{}{}", self.authority, self.path, self.query)
    }

    /// The address that a reference in a document at this address stands for. It gets the document's query where it has none:
    /// keys open what lies beside a document, too.
    ///
    /// # Errors
    /// If it is one of another kind than http and https.
    pub fn joined(&self, reference: &str) -> Result<Self, String> {
        let own = self.sent_on(reference)?;
        let is_beside = !has_scheme(reference) && !reference.starts_with("//");
        let query = if is_beside && own.query.is_empty() { self.query.clone() } else { own.query };
        Ok(Self { query, ..own })
    }

    /// The address that a server sends on to from this one, by RFC 3986, section 5.2.
    ///
    /// # Errors
    /// If it is one of another kind than http and https.
    pub fn sent_on(&self, reference: &str) -> Result<Self, String> {
        if has_scheme(reference) {
            return Self::parse(reference);
        }
        if let Some(rest) = reference.strip_prefix("//") {
            let scheme = if self.is_secure { "https" } else { "http" };
            return Self::parse(&format!("{scheme}://{rest}"));
        }
        let reference = reference.split('#').next().unwrap_or_default();
        let (path, query) = reference.split_at(reference.find('?').unwrap_or(reference.len()));
        let folder = self.path.rsplit_once('/').map_or("", |(folder, _)| folder);
        let (path, own_query) = match path {
            "" => (self.path.clone(), self.query.as_str()),
            path if path.starts_with('/') => (encoded(&without_dots(path)), ""),
            path => (encoded(&without_dots(&format!("{folder}/{path}"))), ""),
        };
        let query = if query.is_empty() { own_query.to_owned() } else { encoded(query) };
        Ok(Self { path, query, ..self.clone() })
    }

    /// Whether what lies beside a file at this address lies beside one at another, too, which a server sends on to: the name
    /// is the same, without a key of its own, or one of both is a folder.
    pub fn is_moved_to(&self, other: &Self) -> bool {
        let name = |address: &Self| address.path.rsplit('/').next().unwrap_or_default().to_owned();
        let has_no_key = other.query.is_empty() || other.query == self.query;
        other.path.ends_with('/') || (has_no_key && (self.path.ends_with('/') || name(self) == name(other)))
    }
}

fn has_scheme(reference: &str) -> bool {
    reference.split(['/', '?', '#']).next().is_some_and(|first| first.contains(':'))
}

/// A path that begins with a slash, without the parts `.` and `..`. Empty parts stay: some servers have them in names.
fn without_dots(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    let mut rest = path.split('/').skip(1).peekable();
    while let Some(part) = rest.next() {
        let is_last = rest.peek().is_none();
        match part {
            "." | ".." => {
                if part == ".." {
                    parts.pop();
                }
                parts.extend(is_last.then_some(""));
            }
            part => parts.push(part),
        }
    }
    format!("/{}", parts.join("/"))
}

/// A part of an address without bytes that have no place there.
fn encoded(part: &str) -> String {
    let byte = |byte: u8| match byte {
        b'!'..=b'~' if !matches!(byte, b'"' | b'<' | b'>' | b'\\' | b'^' | b'`' | b'{' | b'|' | b'}') => {
            char::from(byte).to_string()
        }
        byte => format!("%{byte:02X}"),
    };
    part.bytes().map(byte).collect()
}

/// A part of an address with the bytes that its escapes stand for; `None` if it has none.
pub fn decoded(part: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(part.len());
    let mut rest = part.as_bytes();
    while let [byte, more @ ..] = rest {
        let digits = more.first_chunk::<2>().filter(|digits| *byte == b'%' && digits.iter().all(u8::is_ascii_hexdigit));
        let escaped = digits.and_then(|digits| u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok());
        bytes.push(escaped.unwrap_or(*byte));
        rest = if escaped.is_some() { &more[2..] } else { more };
    }
    String::from_utf8(bytes).ok().filter(|decoded| decoded != part)
}

/// The file of this name in the folder of another one, or what lies beside an address.
pub fn beside(path: &Path, name: &str) -> PathBuf {
    let address = is_address(path).then(|| Address::parse(&path.to_string_lossy()).ok()).flatten();
    match address.and_then(|address| address.joined(name).ok()) {
        Some(address) => address.text().into(),
        None => path.parent().unwrap_or(Path::new("")).join(name),
    }
}

/// The last part of a path, or of the path of an address.
pub fn last_part(path: &Path) -> String {
    let whole = path.to_string_lossy();
    let text = match is_address(path) {
        true => whole.split(['?', '#']).next().unwrap_or_default(),
        false => &whole,
    };
    Path::new(text).file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_told_from_a_path_and_taken_apart() {
        for (text, is) in
            [("https://a/b", true), ("HTTP://a", true), ("http:/a", false), ("a/https://b", false), ("", false)]
        {
            assert_eq!(is_address(Path::new(text)), is, "{text}");
        }
        let address = Address::parse("https://Host.org:8443/a b/c.laz?key=1#part").unwrap();
        assert_eq!(address.text(), "https://host.org:8443/a%20b/c.laz?key=1");
        for (text, authority) in [
            ("http://[::1]/a", "[::1]"),
            ("http://[::1]:80/a", "[::1]"),
            ("http://[::1]:/a", "[::1]"),
            ("http://a:/b", "a"),
            ("http://a:80/b", "a"),
            ("https://a:443", "a"),
            ("https://a:80/b", "a:80"),
            ("http://a:443/b", "a:443"),
        ] {
            assert_eq!(Address::parse(text).unwrap().authority, authority, "{text}");
        }
        for text in [
            "https://",
            "https:///path",
            "ftp://a/b",
            "https://user:secret@host/a",
            "https://a b/c",
            "http://a:99999/b",
            "http://a:0/b",
            "http://:80/b",
            "http://:/b",
            "http://a:+80/b",
            "http://[::1]:port/b",
        ] {
            assert!(Address::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn escapes_stand_for_bytes() {
        for (part, expected) in
            [("a%20b%23%C3%a4", Some("a b#ä")), ("a%2", None), ("%+1", None), ("%ff", None), ("", None)]
        {
            assert_eq!(decoded(part).as_deref(), expected, "{part}");
        }
    }

    #[test]
    fn a_server_sends_on_by_the_rules_of_addresses() {
        let base = Address::parse("https://host/a//b/c?key=1").unwrap();
        for (reference, expected) in [
            ("/d/", "https://host/d/"),
            ("d/", "https://host/a//b/d/"),
            ("..", "https://host/a//"),
            ("../../..", "https://host/"),
            ("./x//y", "https://host/a//b/x//y"),
            ("?other", "https://host/a//b/c?other"),
            ("", "https://host/a//b/c?key=1"),
            ("d?other", "https://host/a//b/d?other"),
        ] {
            assert_eq!(base.sent_on(reference).unwrap().text(), expected, "{reference}");
        }
    }

    #[test]
    fn a_folder_that_has_moved_is_told_from_a_store_of_single_files() {
        let base = Address::parse("https://host/a/ept.json?key=1").unwrap();
        for (other, is) in [
            ("/b/ept.json", true),
            ("/b/ept.json?key=1", true),
            ("/b/?key=2", true),
            ("https://other/b/ept.json", true),
            ("/b/ept.json?key=2", false),
            ("/blob/17", false),
        ] {
            assert_eq!(base.is_moved_to(&base.sent_on(other).unwrap()), is, "{other}");
        }
        let folder = Address::parse("https://host/a/").unwrap();
        assert!(folder.is_moved_to(&folder.sent_on("ept.json").unwrap()));
        assert!(!folder.is_moved_to(&folder.sent_on("/blob/17?key=1").unwrap()));
    }

    #[test]
    fn references_lead_to_what_lies_beside_a_document() {
        let base = Address::parse("https://host/a/b/c.json?key=1").unwrap();
        for (reference, expected) in [
            ("d.laz", "https://host/a/b/d.laz?key=1"),
            ("./d/e.laz", "https://host/a/b/d/e.laz?key=1"),
            ("../../../e.laz?x", "https://host/e.laz?x"),
            ("/e.laz", "https://host/e.laz?key=1"),
            ("//other/e.laz", "https://other/e.laz"),
            ("http://other/e.laz", "http://other/e.laz"),
            ("d//e.laz", "https://host/a/b/d//e.laz?key=1"),
        ] {
            assert_eq!(base.joined(reference).unwrap().text(), expected, "{reference}");
        }
        assert!(base.joined("file:///etc/passwd").is_err());
        let beside = beside(Path::new("http://host/a/ept.json?key=1"), "ept-data/0-0-0-0.laz");
        assert_eq!(beside, Path::new("http://host/a/ept-data/0-0-0-0.laz?key=1"));
        assert_eq!(last_part(Path::new("http://host/a/ept.json?key=a/b")), "ept.json");
    }
}
