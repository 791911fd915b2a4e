//! The served site: the viewer, which is part of the program, and one file.

use std::sync::Arc;

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Result};
use crate::container::is_container;
use crate::html::site::{DECODERS, PAGE, SCRIPT, STYLE, WORKER};
use mipvog_inputs::tensor::describe;

/// The viewer's own files.
const VIEWER: [(&str, &str, &str); 5] = [
    ("/", "text/html; charset=utf-8", PAGE),
    ("/viewer.js", "text/javascript; charset=utf-8", SCRIPT),
    ("/worker.js", "text/javascript; charset=utf-8", WORKER),
    ("/decoders.js", "text/javascript; charset=utf-8", DECODERS),
    ("/style.css", "text/css; charset=utf-8", STYLE),
];

/// Headers of every answer: the page runs only its own scripts, contacts no other host and is not
/// cached.
pub const SAFETY_HEADERS: &str = "Cache-Control: no-store\r\n\
    Content-Security-Policy: default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; \
    worker-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
    connect-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\n\
    Referrer-Policy: no-referrer\r\n\
    X-Content-Type-Options: nosniff\r\n";

/// The kind of the served file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A `.mipvog` container.
    Container,
    /// A binary glTF asset.
    Asset,
}

impl Kind {
    /// Detected from the first bytes.
    ///
    /// # Errors
    /// The file is neither.
    pub fn of(file: &SourceFile) -> Result<Self> {
        if is_container(file) {
            return Ok(Self::Container);
        }
        let mut start = [0; 4];
        if file.read_into(0, &mut start).is_ok() && &start == b"glTF" {
            return Ok(Self::Asset);
        }
        let expected = "a .mipvog container or a .glb asset, to show it";
        Err(Error::wrong_kind(describe(file)?, expected).in_file(file.path()))
    }

    /// The name under which it is served.
    pub fn name(self) -> &'static str {
        match self {
            Self::Container => "field.mipvog",
            Self::Asset => "asset.glb",
        }
    }

    fn media_type(self) -> &'static str {
        match self {
            Self::Container => "model/vnd.mipvog",
            Self::Asset => "model/gltf-binary",
        }
    }
}

/// The names that are served.
#[derive(Debug)]
pub struct Site {
    file: Arc<SourceFile>,
    kind: Kind,
}

/// Something that is served.
pub struct Resource {
    /// Its media type.
    pub media_type: &'static str,
    /// Its bytes.
    pub body: Body,
}

/// The place of a resource's bytes.
pub enum Body {
    /// In the program.
    Inside(&'static [u8]),
    /// In the file.
    File(Arc<SourceFile>),
}

impl Site {
    /// The viewer and `file`.
    ///
    /// # Errors
    /// The viewer cannot show the file.
    pub fn new(file: SourceFile) -> Result<Self> {
        Ok(Self { kind: Kind::of(&file)?, file: Arc::new(file) })
    }

    /// The file's kind.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The file's own name, without its folders.
    pub fn file_name(&self) -> String {
        let name = self.file.path().file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// The resource under a path, which must match exactly.
    pub fn get(&self, path: &str) -> Option<Resource> {
        if path.strip_prefix('/') == Some(self.kind.name()) {
            let body = Body::File(Arc::clone(&self.file));
            return Some(Resource { media_type: self.kind.media_type(), body });
        }
        let (_, media_type, bytes) = VIEWER.into_iter().find(|(name, ..)| *name == path)?;
        Some(Resource { media_type, body: Body::Inside(bytes.as_bytes()) })
    }
}

impl Resource {
    /// Its length in bytes.
    pub fn length(&self) -> u64 {
        match &self.body {
            Body::Inside(bytes) => bytes.len() as u64,
            Body::File(file) => file.length(),
        }
    }
}
