//! The radiance fields of a document, the nodes that name them, and the containers behind them.

use std::sync::Arc;

use super::document::{Asset, EXTENSION};
use super::json::{Members, Node};
use super::properties::RadianceField;
use super::uri;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, ErrorKind, Place, Result};

/// The extension's objects in a document.
#[derive(Debug)]
pub struct Fields<'a> {
    /// The fields' objects.
    pub objects: Vec<Node<'a>>,
    /// The nodes that name one.
    pub users: Vec<User<'a>>,
}

/// A node that names a field.
#[derive(Debug, Clone)]
pub struct User<'a> {
    /// Number of the node.
    pub node: usize,
    /// The node's whole object.
    pub object: Node<'a>,
    /// The value of `radianceField`.
    pub value: Node<'a>,
    /// The field that it names, which may not exist.
    pub field: usize,
}

impl<'a> Fields<'a> {
    /// Reads them from a document's root.
    pub fn read(asset: &Asset, root: &Members<'a>) -> Result<Self> {
        let own = extension(root)?;
        let objects = match own {
            None => Vec::new(),
            Some(own) => {
                let own = own.members()?;
                asset.list(&own, "radianceFields")?
            }
        };
        let mut users = Vec::new();
        for (node, object) in asset.list(root, "nodes")?.into_iter().enumerate() {
            let Some(own) = extension(&object.members()?)? else { continue };
            let value = own.get("radianceField")?.ok_or_else(|| {
                Error::malformed(own.place(), "no radianceField", "the number of a field")
            })?;
            users.push(User { node, object, field: value.index()?, value });
        }
        Ok(Self { objects, users })
    }
}

/// The extension's object in the `extensions` of another one.
pub fn extension<'a>(object: &Members<'a>) -> Result<Option<Node<'a>>> {
    object
        .get("extensions")
        .map(|extensions| extensions.get(EXTENSION))
        .transpose()
        .map(Option::flatten)
}

/// A container inside or beside an asset.
#[derive(Debug)]
pub struct ContainerBytes {
    /// Its bytes, as a file of their own.
    pub file: Arc<SourceFile>,
    /// Offset of their start in the containing file; 0 in a separate file, and in a data URI.
    pub offset: u64,
}

/// The container that a field names by `uri` or `bufferView`, with unchecked bytes.
pub fn container_bytes(
    asset: &Asset,
    root: &Members,
    field: &RadianceField,
    object: &Node,
) -> Result<ContainerBytes> {
    let key = |name: &str| Place::Pointer(format!("{}/{name}", object.pointer()));
    match (&field.uri, field.buffer_view) {
        (Some(uri), None) => {
            Ok(ContainerBytes { file: uri::open(uri, asset.path(), &key("uri"))?, offset: 0 })
        }
        (None, Some(number)) => view(asset, root, number, key("bufferView")),
        (uri, _) => {
            let found = if uri.is_some() { "uri and bufferView" } else { "no uri or bufferView" };
            Err(Error::malformed(object.place(), found, "one of the two"))
        }
    }
}

fn view(asset: &Asset, root: &Members, number: usize, place: Place) -> Result<ContainerBytes> {
    let views = asset.list(root, "bufferViews")?;
    let view = views.get(number).ok_or_else(|| missing(place, number, views.len()))?;
    let members = view.members()?;
    let whole = |name: &str| match members.get(name) {
        Some(value) => value.index(),
        None if name == "byteOffset" => Ok(0),
        None => Err(Error::malformed(view.place(), format!("no {name}"), "a whole number")),
    };
    let (buffer, offset, length) = (whole("buffer")?, whole("byteOffset")?, whole("byteLength")?);
    let (offset, length) = (offset as u64, length as u64);
    let (file, start) = buffer_bytes(asset, root, buffer, &view.place())?;
    let left = file.length().saturating_sub(offset);
    if length > left {
        return Err(Error::new(ErrorKind::Truncated { wanted: length, left }, view.place()));
    }
    let part = file.part(offset..offset + length)?;
    Ok(ContainerBytes { file: Arc::new(part), offset: start.saturating_add(offset) })
}

/// The bytes of a buffer, and where they start in their file.
fn buffer_bytes(
    asset: &Asset,
    root: &Members,
    number: usize,
    place: &Place,
) -> Result<(Arc<SourceFile>, u64)> {
    let buffers = asset.list(root, "buffers")?;
    let buffer =
        buffers.get(number).ok_or_else(|| missing(place.clone(), number, buffers.len()))?;
    let members = buffer.members()?;
    let length = members.get("byteLength").map(Node::index).transpose()?;
    let length = length
        .ok_or_else(|| Error::malformed(buffer.place(), "no byteLength", "a whole number from 1"))?
        as u64;
    let (file, start) = match (members.get("uri"), chunk_of(asset, number, &members)) {
        (Some(uri), _) => {
            let text: String = uri.parse("a URI")?;
            (uri::open(&text, asset.path(), &uri.place())?, 0)
        }
        (None, Some(bin)) => (Arc::new(asset.file().part(bin.clone())?), bin.start),
        (None, None) => {
            let expected = "a uri, or the chunk BIN of a GLB";
            return Err(Error::malformed(buffer.place(), "a buffer without bytes", expected));
        }
    };
    if length > file.length() {
        let kind = ErrorKind::Truncated { wanted: length, left: file.length() };
        return Err(Error::new(kind, buffer.place()));
    }
    Ok((Arc::new(file.part(0..length)?), start))
}

fn chunk_of(asset: &Asset, number: usize, buffer: &Members) -> Option<std::ops::Range<u64>> {
    let chunk = asset.chunks()?.bin.clone()?;
    (number == 0 && buffer.get("uri").is_none()).then_some(chunk)
}

/// True if the buffer of this number is the chunk BIN.
pub fn buffer_is_chunk(asset: &Asset, number: usize, buffer: &Node) -> Result<bool> {
    Ok(chunk_of(asset, number, &buffer.members()?).is_some())
}

fn missing(place: Place, number: usize, count: usize) -> Error {
    Error::malformed(place, format!("number {number}"), one_of(count))
}

/// The numbers of this many things, in words.
pub fn one_of(count: usize) -> String {
    match count {
        0 => "none: there is none".to_owned(),
        1 => "number 0, the only one".to_owned(),
        _ => format!("a number from 0 to {}", count - 1),
    }
}
