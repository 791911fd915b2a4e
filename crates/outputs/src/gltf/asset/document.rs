//! An open asset: its document, and the places of its chunks.

use std::path::Path;
use std::sync::Arc;

use super::glb::{self, Chunks};
use super::json::{Members, Node};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::base::text::without_mark;
use mipvog_inputs::tensor::{describe, is_parameters};

/// The extension's name.
pub const EXTENSION: &str = "MIPVOG_radiance_field";

/// An open asset: its document as text, and the places of everything else in the file.
#[derive(Debug)]
pub struct Asset {
    file: Arc<SourceFile>,
    text: String,
    chunks: Option<Chunks>,
    limits: Limits,
}

/// True if a file starts like an asset: with GLB's magic, or with a JSON object that does not
/// describe a folder of pictures.
pub fn is_asset(file: &SourceFile) -> bool {
    let mut start = vec![0; file.length().min(64) as usize];
    let read = file.read_into(0, &mut start).is_ok();
    let text = without_mark(&start);
    let first = text.iter().find(|byte| !byte.is_ascii_whitespace());
    let is_text = first == Some(&b'{') && !is_parameters(file).unwrap_or(false);
    read && (start.starts_with(&glb::MAGIC) || is_text)
}

impl Asset {
    /// Opens an asset and checks its chunks, the syntax of its JSON and the version of glTF.
    pub fn open(file: Arc<SourceFile>, limits: &Limits) -> Result<Self> {
        let path = file.path().to_owned();
        Self::read(file, limits).map_err(|error| error.in_file(&path))
    }

    /// A document that is not in a file yet; of a GLB if there are bytes for a chunk BIN, whose
    /// length is a multiple of 4.
    pub fn in_memory(text: String, bin: Option<Vec<u8>>, path: &Path, limits: &Limits) -> Self {
        let length = bin.as_ref().map(|bin| bin.len() as u64);
        let file = Arc::new(SourceFile::decoded(bin.unwrap_or_default(), path));
        let chunks = length.map(|end| Chunks { bin: Some(0..end), others: end..end, behind: 0 });
        Self { file, text, chunks, limits: limits.clone() }
    }

    fn read(file: Arc<SourceFile>, limits: &Limits) -> Result<Self> {
        if !is_asset(&file) {
            return Err(Error::wrong_kind(describe(&file)?, "a glTF asset (.glb or .gltf)"));
        }
        let mut magic = [0; 4];
        let is_glb = file.read_into(0, &mut magic).is_ok() && magic == glb::MAGIC;
        let (json, chunks) = match is_glb {
            true => {
                let (json, chunks) = glb::read(&file)?;
                (json, Some(chunks))
            }
            false => (0..file.length(), None),
        };
        let bytes = file.read(json.start, json.end - json.start, limits.header_bytes)?;
        let bytes = if is_glb { bytes } else { without_mark(&bytes).to_vec() };
        let text = String::from_utf8(bytes).map_err(|error| {
            let at = json.start + error.utf8_error().valid_up_to() as u64;
            Error::malformed(Place::Offset(at), "a byte that is no UTF-8", "JSON in UTF-8")
        })?;
        let asset = Self { file, text, chunks, limits: limits.clone() };
        asset.check_version()?;
        Ok(asset)
    }

    fn check_version(&self) -> Result<()> {
        let place = Place::Pointer("/asset/version".to_owned());
        let asset = self.document()?.get("asset")?;
        let version = asset.as_ref().map(|asset| asset.get("version")).transpose()?.flatten();
        let Some(version) = version else {
            return Err(self.without_version(place)?);
        };
        let version: String = version.parse("\"2.0\"")?;
        if !matches!(version.split_once('.'), Some(("2", _))) {
            return Err(Error::unsupported(place, format!("glTF {version}"), "glTF 2"));
        }
        // The document may require a newer version of glTF than this reader's.
        let least = asset.map(|asset| asset.get("minVersion")).transpose()?.flatten();
        let least = least.map(|least| least.parse::<String>("\"2.0\"")).transpose()?;
        match least.filter(|least| least != "2.0") {
            None => Ok(()),
            Some(least) => {
                let place = Place::Pointer("/asset/minVersion".to_owned());
                Err(Error::unsupported(place, format!("glTF {least}"), "glTF 2.0"))
            }
        }
    }

    /// The error for a JSON text without a version of glTF, with its kind if known.
    fn without_version(&self, place: Place) -> Result<Error> {
        let document = self.document()?;
        let has = |key: &str| -> Result<bool> { Ok(document.get(key)?.is_some()) };
        Ok(if has("snapshot")? && has("encoding")? {
            let found = "a snapshot of Instant-NGP as JSON";
            Error::unsupported(Place::File, found, "one as .ingp or .msgpack")
                .advise("save it with Instant-NGP as .ingp or .msgpack")
        } else if has("asset")? {
            Error::malformed(place, "no version of glTF", "\"2.0\"")
        } else {
            let found = match has("frames")? || has("camera_path")? {
                true => "a camera file",
                false => "a JSON text without the member asset",
            };
            Error::malformed(place, found, "a glTF asset")
        })
    }

    /// The file.
    pub fn file(&self) -> &SourceFile {
        &self.file
    }

    /// Its name.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Limits on the sizes that it may ask for.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The document's text, with the white space around it.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Chunks beside the document; `None` where the file is no GLB.
    pub fn chunks(&self) -> Option<&Chunks> {
        self.chunks.as_ref()
    }

    /// The document's root.
    pub fn document(&self) -> Result<Node<'_>> {
        Node::document(&self.text)
    }

    /// The elements of a list of the root, empty if missing, and at most as many as the limits
    /// allow.
    pub fn list<'a>(&self, root: &Members<'a>, name: &str) -> Result<Vec<Node<'a>>> {
        let Some(list) = root.get(name) else { return Ok(Vec::new()) };
        let elements = list.elements()?;
        let count = elements.len() as u64;
        limits::check(
            LimitName::Entries,
            "elements of a list",
            count,
            self.limits.entries,
            &list.place(),
        )?;
        Ok(elements)
    }
}
