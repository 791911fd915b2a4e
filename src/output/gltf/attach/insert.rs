//! A field into an asset.

use std::path::Path;

use serde_json::json;

use super::record::Record;
use super::{ALIGNMENT, list_of, write_edited};
use crate::base::bytes::Output;
use crate::base::error::{Error, Place, Result};
use crate::codec::container::Container;
use crate::output::gltf::asset::json::{Edits, List, Node};
use crate::output::gltf::asset::properties::RadianceField;
use crate::output::gltf::asset::{Asset, EXTENSION, Fields, Piece, buffer_is_chunk, padded, uri};

/// A quarter turn about x: training's z, which is up there, becomes glTF's y.
pub(super) const Z_UP_TO_Y_UP: [f32; 4] =
    [-std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2];

/// How a field is attached.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct AttachOptions {
    /// The node that shows the field. Default: a new one in the default scene, turned so that the
    /// field stands upright, without a mesh
    pub node: Option<NodeChoice>,
    /// Whether a GLB names the container by a URI; a `.gltf` always does. Default: it embeds it
    pub external: bool,
}

/// A node of a document.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NodeChoice {
    /// By number.
    Index(usize),
    /// By its name, which no other node may have.
    Name(String),
}

/// What was attached.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Attached {
    /// Number of the field in the document.
    pub field: usize,
    /// Number of the node that shows it.
    pub node: usize,
    /// Whether the container is in the asset's file.
    pub embedded: bool,
    /// The container's digest.
    pub sha256: String,
}

/// Writes `asset` with the field in `container` to `output`, complete but not yet finished.
/// `container_path` is the container's name, and `output_path` that of the asset, for the URI between
/// them.
///
/// # Errors
/// Containers and documents that break their rules; usage, where the options do not fit the document.
pub fn attach(
    asset: &Asset,
    container: &Container,
    container_path: &Path,
    output_path: &Path,
    options: &AttachOptions,
    output: &mut Output,
) -> Result<Attached> {
    // What is embedded or named is whole; a damaged container would be found by whoever renders it.
    container.read_head()?;
    container.for_each_level(|_, _| Ok(()))?;
    let mut field = RadianceField::with_digest(container)?;
    let embedded = asset.chunks().is_some() && !options.external;
    if !embedded {
        field.uri = Some(uri::relative(output_path, container_path)?);
    }
    Insertion::new(asset)
        .and_then(|insertion| insertion.write(container, field, options, output))
        .map_err(|error| error.in_file(asset.path()))
}

/// A document being added to.
struct Insertion<'a> {
    asset: &'a Asset,
    root: List<'a>,
    fields: Fields<'a>,
    edits: Edits,
    record: Record,
}

impl<'a> Insertion<'a> {
    fn new(asset: &'a Asset) -> Result<Self> {
        let root = asset.document()?.members()?;
        let fields = Fields::read(asset, &root)?;
        Ok(Self { asset, root, fields, edits: Edits::default(), record: Record::default() })
    }

    fn write(
        mut self,
        container: &Container,
        mut field: RadianceField,
        options: &AttachOptions,
        output: &mut Output,
    ) -> Result<Attached> {
        let bin = match field.uri {
            Some(_) => self.chunk_as_it_is()?,
            None => self.embed(container, &mut field)?,
        };
        let number = self.fields.objects.len();
        let node = match &options.node {
            Some(choice) => self.name_on_node(choice, number)?,
            None => self.new_node(number)?,
        };
        self.list_extension()?;
        self.add_field(&field)?;
        write_edited(self.asset, self.edits, &bin, output)?;
        let embedded = field.uri.is_none();
        Ok(Attached { field: number, node, embedded, sha256: field.sha256 })
    }

    fn chunk_as_it_is(&self) -> Result<Vec<Piece>> {
        let bin = self.asset.chunks().and_then(|chunks| chunks.bin.clone());
        bin.map(|bin| Ok(Piece::File(self.asset.file().part(bin)?))).into_iter().collect()
    }

    /// Puts the container at the end of the chunk BIN, under a buffer view of its own.
    fn embed(&mut self, container: &Container, field: &mut RadianceField) -> Result<Vec<Piece>> {
        let mut pieces = self.chunk_as_it_is()?;
        let buffers = self.asset.list(&self.root, "buffers")?;
        let chunk = pieces.first().map_or(0, Piece::length);
        let offset = chunk.next_multiple_of(ALIGNMENT);
        let bytes = container.file().length();
        match buffers.first() {
            None if pieces.is_empty() => {
                self.push("buffers", &json!({ "byteLength": bytes }).to_string())?;
            }
            Some(buffer) if buffer_is_chunk(self.asset, 0, buffer)? => {
                let length = buffer.get("byteLength")?.ok_or_else(|| {
                    Error::malformed(buffer.place(), "no byteLength", "a whole number from 1")
                })?;
                let stated = length.index()? as u64;
                if stated > chunk {
                    let found = format!("{stated} bytes");
                    let expected = format!("at most the {chunk} of the chunk BIN");
                    return Err(Error::malformed(length.place(), found, expected));
                }
                self.record.byte_length = (stated != offset).then_some(stated);
                self.record.chunk_length = (padded(stated) != chunk).then_some(chunk);
                self.edits.replace(&length, (offset + bytes).to_string());
            }
            _ => {
                return Err(Error::usage(format!(
                    "{}: buffer 0 is not the chunk BIN of the GLB, so nothing can be embedded; \
                     --external names the container by a URI",
                    self.asset.path().display()
                )));
            }
        }
        pieces.push(Piece::Bytes(vec![0; (offset - chunk) as usize]));
        pieces.push(Piece::File(container.file().part(0..bytes)?));
        let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes });
        field.buffer_view = Some(self.push("bufferViews", &view.to_string())?);
        Ok(pieces)
    }

    fn name_on_node(&mut self, choice: &NodeChoice, field: usize) -> Result<usize> {
        let nodes = self.asset.list(&self.root, "nodes")?;
        let number = chosen(&nodes, choice)?;
        let taken = self.fields.users.iter().any(|user| user.node == number);
        let node = nodes.get(number).filter(|_| !taken).ok_or_else(|| {
            Error::usage(match taken {
                true => format!("node {number} has a radiance field already"),
                false => format!("--node asks for node {number} of {} from 0", nodes.len()),
            })
        })?;
        let own = format!("\"{EXTENSION}\":{{\"radianceField\":{field}}}");
        let members = node.members()?;
        match members.get("extensions").map(Node::members).transpose()? {
            Some(extensions) => {
                if extensions.is_empty() {
                    self.record.found.insert("node.extensions".to_owned());
                }
                self.edits.append(&extensions, &own);
            }
            None => self.edits.append(&members, &format!("\"extensions\":{{{own}}}")),
        }
        Ok(number)
    }

    fn new_node(&mut self, field: usize) -> Result<usize> {
        self.record.node = true;
        let node = json!({
            "name": "radiance field",
            "rotation": Z_UP_TO_Y_UP,
            "extensions": { EXTENSION: { "radianceField": field } },
        });
        let number = self.push("nodes", &node.to_string())?;
        let scenes = self.asset.list(&self.root, "scenes")?;
        let default = self.root.get("scene");
        let scene = default.map(Node::index).transpose()?.unwrap_or(0);
        match (scenes.get(scene), default) {
            (Some(scene), _) => {
                let members = scene.members()?;
                match list_of(&members, "nodes")? {
                    Some(list) => {
                        if list.is_empty() {
                            self.record.found.insert("scene.nodes".to_owned());
                        }
                        self.edits.append(&list, &number.to_string());
                    }
                    None => self.edits.append(&members, &format!("\"nodes\":[{number}]")),
                }
            }
            (None, Some(default)) => {
                let expected = format!("one of {} from 0", scenes.len());
                return Err(Error::malformed(default.place(), format!("scene {scene}"), expected));
            }
            (None, None) => {
                self.record.scene = true;
                self.push("scenes", &format!("{{\"nodes\":[{number}]}}"))?;
                self.edits.append(&self.root, "\"scene\":0");
            }
        }
        Ok(number)
    }

    fn list_extension(&mut self) -> Result<()> {
        let used = self.asset.list(&self.root, "extensionsUsed")?;
        for name in &used {
            if name.parse::<String>("a name")? == EXTENSION {
                if self.fields.objects.is_empty() {
                    self.record.found.insert("extensionsUsed.own".to_owned());
                }
                return Ok(());
            }
        }
        self.push("extensionsUsed", &format!("\"{EXTENSION}\"")).map(|_| ())
    }

    fn add_field(&mut self, field: &RadianceField) -> Result<()> {
        // By way of a value: numbers are then written as those of the container's metadata are.
        let text = serde_json::to_value(field).map(|value| value.to_string());
        let text = text.map_err(|error| {
            Error::malformed(Place::File, format!("numbers that are no JSON: {error}"), "finite")
        })?;
        let extensions = self.root.get("extensions").map(Node::members).transpose()?;
        let own = extensions.as_ref().and_then(|extensions| extensions.get(EXTENSION));
        let own = own.map(Node::members).transpose()?;
        let list = own.as_ref().map(|own| list_of(own, "radianceFields")).transpose()?.flatten();
        let empty = |list: &Option<List>| list.as_ref().is_some_and(List::is_empty);
        let found = [
            ("extensions", empty(&extensions)),
            ("extensions.own", empty(&own)),
            ("extensions.own.radianceFields", empty(&list)),
        ];
        let found = found.into_iter().filter(|(_, empty)| *empty);
        self.record.found.extend(found.map(|(name, _)| name.to_owned()));
        let text = format!("{}{}}}", text.strip_suffix('}').unwrap_or(&text), self.record.member());
        let fields = format!("\"radianceFields\":[{text}]");
        match (&list, &own, &extensions) {
            (Some(list), ..) => self.edits.append(list, &text),
            (None, Some(own), _) => self.edits.append(own, &fields),
            (None, None, Some(extensions)) => {
                self.edits.append(extensions, &format!("\"{EXTENSION}\":{{{fields}}}"));
            }
            (None, None, None) => {
                let own = format!("\"extensions\":{{\"{EXTENSION}\":{{{fields}}}}}");
                self.edits.append(&self.root, &own);
            }
        }
        Ok(())
    }

    /// Appends an element to a list of the root, which is made where it is not there. Its number.
    fn push(&mut self, name: &str, element: &str) -> Result<usize> {
        let Some(list) = list_of(&self.root, name)? else {
            self.edits.append(&self.root, &format!("\"{name}\":[{element}]"));
            return Ok(0);
        };
        if list.is_empty() {
            self.record.found.insert(name.to_owned());
        }
        self.edits.append(&list, element);
        Ok(list.len())
    }
}

fn chosen(nodes: &[Node], choice: &NodeChoice) -> Result<usize> {
    let name = match choice {
        NodeChoice::Index(number) => return Ok(*number),
        NodeChoice::Name(name) => name,
    };
    let mut found = Vec::new();
    for (number, node) in nodes.iter().enumerate() {
        if let Some(own) = node.get("name")?
            && own.parse::<String>("a name")? == *name
        {
            found.push(number);
        }
    }
    match found.as_slice() {
        [number] => Ok(*number),
        [] => Err(Error::usage(format!("--node asks for {name:?}, but no node has that name"))),
        _ => Err(Error::usage(format!(
            "--node asks for {name:?}, the name of the nodes {found:?}; say one by its number"
        ))),
    }
}
