//! URIs of glTF documents: `data:` and relative references to files.

use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};

/// All characters that RFC 3986 requires to be escaped in a path segment.
const RESERVED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

/// True if the bytes are in the URI itself.
pub fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

/// Opens what a URI names; relative ones from the folder of the file `base`.
///
/// # Errors
/// URIs that need a network or name a place of this machine are not supported.
pub fn open(uri: &str, base: &Path, place: &Place) -> Result<Arc<SourceFile>> {
    if is_data(uri) {
        let (_, text) = uri.split_once(";base64,").ok_or_else(|| {
            Error::unsupported(place.clone(), "a data URI of another form", "one in base64")
        })?;
        let bytes = STANDARD.decode(text).map_err(|error| {
            Error::malformed(place.clone(), format!("a data URI with an {error}"), "base64")
        })?;
        return Ok(Arc::new(SourceFile::decoded(bytes, base)));
    }
    let refuse = |found: &str| {
        let expected = "a relative path or a data URI";
        Err(Error::unsupported(place.clone(), format!("{found} {uri:?}"), expected))
    };
    let first = uri.split(['/', '?', '#']).next().unwrap_or_default();
    if first.contains(':') {
        return refuse("the URI with a scheme");
    }
    if uri.contains(['?', '#']) {
        return refuse("the URI with a query or fragment");
    }
    let path = percent_decode_str(uri).decode_utf8().map_err(|_| {
        Error::malformed(place.clone(), format!("the URI {uri:?}"), "a path in UTF-8")
    })?;
    let path = Path::new(path.as_ref());
    if path.has_root() || path.components().any(|part| matches!(part, Component::Prefix(_))) {
        return refuse("the absolute path");
    }
    let folder = base.parent().unwrap_or(Path::new(""));
    SourceFile::open(&folder.join(path)).map(Arc::new)
}

/// The path that a relative URI names from the folder of the file `base`. `None` if it is not text.
pub fn path(uri: &str, base: &Path) -> Option<PathBuf> {
    let name = percent_decode_str(uri).decode_utf8().ok()?;
    Some(base.parent().unwrap_or(Path::new("")).join(Path::new(name.as_ref())))
}

/// The relative reference from a file in the folder of `from` to the file `to`. The files need not
/// exist yet, but their folders must.
pub fn relative(from: &Path, to: &Path) -> Result<String> {
    let folder = |file: &Path| {
        let folder = match file.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        folder.canonicalize().map_err(|error| Error::io(error, folder))
    };
    let (from, to_folder) = (folder(from)?, folder(to)?);
    let shared = from.components().zip(to_folder.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(shared).map(|_| "..".to_owned());
    let names = to_folder.components().skip(shared).map(|part| part.as_os_str());
    let mut segments: Vec<String> = up.collect();
    for name in names.chain(to.file_name()) {
        let name = name.to_str().filter(|_| shared > 0).ok_or_else(|| {
            let expected = "a path that a relative URI can name";
            Error::invalid_option("external", to.display().to_string(), expected)
        })?;
        segments.push(utf8_percent_encode(name, RESERVED).to_string());
    }
    Ok(segments.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_survive_the_way_there_and_back() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let deep = folder.path().join("a b").join("ü%20");
        std::fs::create_dir_all(&deep).expect("writable");
        for (from, to) in [
            (folder.path().join("x.gltf"), deep.join("f#1?.mipvog")),
            (deep.join("x.gltf"), folder.path().join("100%.mipvog")),
            (deep.join("x.gltf"), deep.join("c:d")),
        ] {
            std::fs::write(&to, to.to_string_lossy().as_bytes()).expect("writable");
            let uri = relative(&from, &to).expect("a URI");
            let opened = open(&uri, &from, &Place::File).expect("the file");
            let bytes = opened.read(0, opened.length(), 1000).expect("read");
            assert_eq!(bytes, to.to_string_lossy().as_bytes(), "{uri}");
        }
        assert_eq!(relative(&deep.join("x"), &deep.join("y z")).expect("a URI"), "y%20z");
        assert!(relative(&folder.path().join("missing/x"), &deep).is_err());
    }

    #[test]
    fn other_uris_are_refused() {
        let open = |uri: &str| open(uri, Path::new("x.gltf"), &Place::File);
        for uri in ["https://example.org/a", "file:///etc/passwd", "/etc/passwd", "a?b", "C:\\a"] {
            let error = open(uri).expect_err(uri);
            assert!(
                matches!(error.kind(), crate::base::error::ErrorKind::Unsupported { .. }),
                "{uri}"
            );
        }
        assert!(open("data:a/b;base64,AA==").is_ok_and(|file| file.length() == 1));
        for uri in ["data:a/b,AA", "data:a/b;base64,A", "%ff", "missing"] {
            assert!(open(uri).is_err(), "{uri}");
        }
    }
}
