//! The authorities that may have issued the certificates of servers.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use param::shown;
use ureq::tls::{Certificate, PemItem, RootCerts, parse_pem};

/// Names a file of certificates of authorities, in the form PEM, as it does for OpenSSL, curl and Python.
const VARIABLE: &str = "SSL_CERT_FILE";

/// The most bytes of such a file: a hundred times those of the list of Mozilla's browser.
const MOST_BYTES: u64 = 20_000_000;

/// The authorities of the file that [`VARIABLE`] names; `None` if it names none, for those that Mozilla's browser knows.
///
/// # Errors
/// The file cannot be read, or holds no certificate.
pub fn authorities() -> Result<Option<RootCerts>, String> {
    let named = std::env::var_os(VARIABLE).filter(|path| !path.is_empty());
    named.map(|path| of_file(Path::new(&path)).map(RootCerts::from)).transpose()
}

fn of_file(path: &Path) -> Result<Vec<Certificate<'static>>, String> {
    let told = |problem: String| format!("{VARIABLE} names {}: {problem}", shown(path));
    let mut text = Vec::new();
    let file = File::open(path).and_then(|file| file.take(MOST_BYTES).read_to_end(&mut text));
    if text.len() as u64 == MOST_BYTES {
        return Err(told(format!("it is longer than {} MB", MOST_BYTES / 1_000_000)));
    }
    file.map_err(|error| told(crate::brief::message(&error)))?;
    let certificate = |item| if let Ok(PemItem::Certificate(own)) = item { Some(own) } else { None };
    let found: Vec<Certificate<'static>> = parse_pem(&text).filter_map(certificate).collect();
    if found.is_empty() { Err(told("it holds no certificate in the form PEM".into())) } else { Ok(found) }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

    use super::*;

    #[test]
    fn certificates_are_read_from_among_other_text_and_a_file_without_any_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("authorities.pem");
        let one = "-----BEGIN CERTIFICATE-----\nMAA=\n-----END CERTIFICATE-----\n";
        std::fs::write(&path, format!("Of the institute\n{one}# another\n{one}")).unwrap();
        assert_eq!(of_file(&path).unwrap().len(), 2);
        std::fs::write(&path, "no certificate").unwrap();
        let error = of_file(&path).unwrap_err();
        assert!(error.contains("authorities.pem: it holds no certificate"), "{error}");
        assert!(of_file(&folder.path().join("missing.pem")).unwrap_err().starts_with("SSL_CERT_FILE names "));
    }
}
