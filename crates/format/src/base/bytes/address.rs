//! Addresses in place of file names.

#[cfg(feature = "network")]
use std::path::Path;
use std::path::PathBuf;

/// The address, if a path is one.
#[cfg(feature = "network")]
pub fn address(path: &Path) -> Option<&str> {
    path.to_str().filter(|text| text.starts_with("https://") || text.starts_with("http://"))
}

/// An address for messages and reports: without a password, and without the query, which may
/// contain one.
pub fn shown(address: &str) -> PathBuf {
    let address = address.split(['?', '#']).next().unwrap_or_default();
    let (scheme, rest) = address.split_once("://").unwrap_or(("", address));
    let (host, path) = rest.split_at(rest.find('/').unwrap_or(rest.len()));
    let host = host.rsplit('@').next().unwrap_or_default();
    PathBuf::from(format!("{scheme}://{host}{path}"))
}

#[cfg(all(test, feature = "network"))]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_shown_without_secrets() {
        let shown = |address| shown(address).to_string_lossy().into_owned();
        assert_eq!(shown("https://me:word@host/a/b.tar?sign=1#x"), "https://host/a/b.tar");
        assert_eq!(shown("https://host"), "https://host");
        assert_eq!(address(Path::new("http://host/a")), Some("http://host/a"));
        assert_eq!(address(Path::new("https:/host/a")), None);
    }
}
