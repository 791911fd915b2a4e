//! Adds a field to an asset.

use std::path::Path;

use serde_json::{Value, json};

use super::notes::Notes;
use super::tree::Tree;
use super::write::{ALIGNMENT, chunk_pieces, write_edited};
use crate::base::bytes::Output;
use crate::base::error::{Error, Place, Result};
use crate::container::Container;
use crate::gltf::asset::json::{Members, Node};
use crate::gltf::asset::properties::RadianceField;
use crate::gltf::asset::{
    Asset, Chunks, EXTENSION, Fields, Piece, buffer_is_chunk, one_of, padded, uri,
};

/// A quarter turn about x: training's up axis z becomes glTF's y.
pub(super) const Z_UP_TO_Y_UP: [f32; 4] =
    [-std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2];

/// Options of attaching.
#[derive(Debug, Clone, Default)]
pub struct AttachOptions {
    /// The node that shows the field. Default: a new one in the default scene, turned so that the
    /// field stands upright, without a mesh
    pub node: Option<NodeChoice>,
    /// True if a GLB names the container by a URI; a `.gltf` always does. Default: it embeds it
    pub external: bool,
}

/// A node of a document.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NodeChoice {
    /// By number.
    Index(usize),
    /// By its name, which must be unique.
    Name(String),
}

/// The attached field.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Attached {
    /// Number of the field in the document.
    pub field: usize,
    /// Number of the node that shows it.
    pub node: usize,
    /// True if the container is in the asset's file.
    pub embedded: bool,
    /// The container's digest.
    pub sha256: String,
}

/// Writes `asset` with the field in `container` to `output`, complete but not yet finished.
/// `container_path` is the container's name, and `output_path` that of the asset, for the URI
/// between them.
///
/// # Errors
/// Containers and documents that break their rules; options that do not fit the document.
pub fn attach(
    asset: &Asset,
    container: &Container,
    container_path: &Path,
    output_path: &Path,
    options: &AttachOptions,
    output: &mut Output,
) -> Result<Attached> {
    // A damaged container is refused here, not by the renderers that load the asset.
    container.read_head()?;
    container.for_each_part(|_, _| Ok(()))?;
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
    root: Members<'a>,
    fields: Fields<'a>,
    document: Tree<'a>,
    notes: Notes,
}

impl<'a> Insertion<'a> {
    fn new(asset: &'a Asset) -> Result<Self> {
        let document = asset.document()?;
        let root = document.members()?;
        let fields = Fields::read(asset, &root)?;
        let document = Tree::Kept(document);
        Ok(Self { asset, root, fields, document, notes: Notes::default() })
    }

    fn write(
        mut self,
        container: &Container,
        mut field: RadianceField,
        options: &AttachOptions,
        output: &mut Output,
    ) -> Result<Attached> {
        let bin = match field.uri {
            Some(_) => chunk_pieces(self.asset)?,
            None => self.embed(container, &mut field)?,
        };
        let number = self.fields.objects.len();
        let node = match &options.node {
            Some(choice) => self.name_on_node(choice, number)?,
            None => self.new_node(number)?,
        };
        self.list_extension()?;
        // Via a value, so that numbers are formatted like those of the container's metadata.
        let mut value = serde_json::to_value(&field).map_err(|error| {
            Error::malformed(
                Place::File,
                format!("numbers that JSON cannot hold: {error}"),
                "finite",
            )
        })?;
        self.notes.add_to(&mut value);
        let own = self.document.child("extensions")?.child(EXTENSION)?;
        own.list("radianceFields")?.push(Tree::New(value));
        write_edited(self.asset, &self.document, &bin, output)?;
        let embedded = field.uri.is_none();
        Ok(Attached { field: number, node, embedded, sha256: field.sha256 })
    }

    /// Puts the container at the end of the chunk BIN, under a buffer view of its own.
    fn embed(&mut self, container: &Container, field: &mut RadianceField) -> Result<Vec<Piece>> {
        let buffers = self.asset.list(&self.root, "buffers")?;
        let bytes = container.file().length();
        let (mut pieces, offset) = match (buffers.first(), self.asset.chunks()) {
            (None, Some(Chunks { bin: None, .. })) => {
                self.push("buffers", json!({ "byteLength": bytes }))?;
                (Vec::new(), 0)
            }
            (Some(buffer), Some(Chunks { bin: Some(bin), .. }))
                if buffer_is_chunk(self.asset, 0, buffer)? =>
            {
                let length = buffer.get("byteLength")?.ok_or_else(|| {
                    Error::malformed(buffer.place(), "no byteLength", "a whole number from 1")
                })?;
                let (stated, chunk) = (length.index()? as u64, bin.end - bin.start);
                if stated > chunk {
                    let found = format!("{stated} bytes");
                    let expected = format!("at most the {chunk} of the chunk BIN");
                    return Err(Error::malformed(length.place(), found, expected));
                }
                let filled = padded(stated);
                let offset = filled.next_multiple_of(ALIGNMENT);
                self.notes.byte_length = (stated != offset).then_some(stated);
                self.document.element("buffers", 0)?.set("byteLength", offset + bytes)?;
                let chunk = self.asset.file().part(bin.start..bin.start + filled)?;
                let zeros = vec![0; (offset - filled) as usize];
                (vec![Piece::File(chunk), Piece::Bytes(zeros)], offset)
            }
            _ => {
                let found = "an asset whose buffer 0 is not the chunk BIN of a GLB";
                let expected = "external, which names the container by a URI";
                return Err(Error::invalid_option("external", found, expected));
            }
        };
        pieces.push(Piece::File(container.file().part(0..bytes)?));
        let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes });
        field.buffer_view = Some(self.push("bufferViews", view)?);
        Ok(pieces)
    }

    fn name_on_node(&mut self, choice: &NodeChoice, field: usize) -> Result<usize> {
        let nodes = self.asset.list(&self.root, "nodes")?;
        let number = chosen(&nodes, choice)?;
        let refuse = |expected: String| {
            Err(Error::invalid_option("node", format!("node {number}"), expected))
        };
        if number >= nodes.len() {
            return refuse(one_of(nodes.len()));
        }
        if self.fields.users.iter().any(|user| user.node == number) {
            return refuse("a node that has no radiance field already".to_owned());
        }
        let node = self.document.element("nodes", number)?;
        node.child("extensions")?.set(EXTENSION, json!({ "radianceField": field }))?;
        Ok(number)
    }

    fn new_node(&mut self, field: usize) -> Result<usize> {
        self.notes.node = true;
        let node = json!({
            "name": "radiance field",
            "rotation": Z_UP_TO_Y_UP,
            "extensions": { EXTENSION: { "radianceField": field } },
        });
        let number = self.push("nodes", node)?;
        let scenes = self.asset.list(&self.root, "scenes")?.len();
        let default = self.root.get("scene");
        let scene = default.map(Node::index).transpose()?.unwrap_or(0);
        match default {
            _ if scene < scenes => {
                // Does not extend a list that other programs cannot read.
                let scenes = self.asset.list(&self.root, "scenes")?;
                let nodes =
                    scenes.get(scene).map(|scene| scene.get("nodes")).transpose()?.flatten();
                for node in nodes.map_or(Ok(Vec::new()), |nodes| nodes.elements())? {
                    node.index()?;
                }
                let scene = self.document.element("scenes", scene)?;
                scene.list("nodes")?.push(Tree::New(number.into()));
            }
            Some(default) => {
                let expected = format!("one of {scenes} from 0");
                return Err(Error::malformed(default.place(), format!("scene {scene}"), expected));
            }
            None => {
                self.notes.scene = true;
                self.push("scenes", json!({ "nodes": [number] }))?;
                self.document.set("scene", 0)?;
            }
        }
        Ok(number)
    }

    fn list_extension(&mut self) -> Result<()> {
        for name in self.asset.list(&self.root, "extensionsUsed")? {
            if name.parse::<String>("a name")? == EXTENSION {
                return Ok(());
            }
        }
        self.push("extensionsUsed", EXTENSION.into()).map(|_| ())
    }

    /// Appends an element to a list of the root. Returns its number.
    fn push(&mut self, name: &str, element: Value) -> Result<usize> {
        let list = self.document.list(name)?;
        list.push(Tree::New(element));
        Ok(list.len() - 1)
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
    let refuse = |expected| Err(Error::invalid_option("node", format!("{name:?}"), expected));
    match found.as_slice() {
        [number] => Ok(*number),
        [] => refuse("the name of a node, or its number".to_owned()),
        _ => refuse(format!("a name that one node has, or a number of {found:?}")),
    }
}
