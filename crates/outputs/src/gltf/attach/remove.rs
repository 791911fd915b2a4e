//! Removes fields from an asset.

use std::collections::{BTreeMap, BTreeSet};

use super::notes::Notes;
use super::references::References;
use super::tree::Tree;
use super::write::write_edited;
use crate::base::bytes::Output;
use crate::base::error::{Error, Result};
use crate::gltf::asset::json::{Members, Node};
use crate::gltf::asset::{Asset, EXTENSION, Fields};

/// The removed fields.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Detached {
    /// Their numbers before.
    pub fields: Vec<usize>,
    /// Fields that are left.
    pub left: usize,
}

/// Writes `asset` without a field, or without all of them, to `output`, complete but not yet
/// finished.
///
/// # Errors Documents that break their rules; an asset without that field; a container between
/// parts that the document refers to by number, which cannot be taken out without renumbering
/// those.
pub fn detach(asset: &Asset, field: Option<usize>, output: &mut Output) -> Result<Detached> {
    Removal::new(asset, field)
        .and_then(|removal| removal.write(output))
        .map_err(|error| error.in_file(asset.path()))
}

/// A document during removal.
pub(super) struct Removal<'a> {
    pub(super) asset: &'a Asset,
    pub(super) root: Members<'a>,
    pub(super) fields: Fields<'a>,
    pub(super) gone: BTreeSet<usize>,
    pub(super) document: Tree<'a>,
    /// By field; notes of remaining fields change as others are removed.
    pub(super) notes: Vec<Notes>,
    /// References to nodes and buffer views by their numbers.
    pub(super) references: References,
}

impl<'a> Removal<'a> {
    fn new(asset: &'a Asset, field: Option<usize>) -> Result<Self> {
        let document = asset.document()?;
        let root = document.members()?;
        let fields = Fields::read(asset, &root)?;
        let count = fields.objects.len();
        if count == 0 && fields.users.is_empty() {
            return Err(Error::usage("the asset has no radiance field"));
        }
        if let Some(field) = field.filter(|field| *field >= count) {
            let expected = format!("a number below {count}");
            return Err(Error::invalid_option("field", field.to_string(), expected));
        }
        let gone = match field {
            Some(field) => BTreeSet::from([field]),
            None => (0..count).collect(),
        };
        let notes = fields.objects.iter().map(Notes::of).collect::<Result<Vec<_>>>()?;
        let references = References::of(asset)?;
        let document = Tree::Kept(document);
        Ok(Self { asset, root, fields, gone, document, notes, references })
    }

    fn write(mut self, output: &mut Output) -> Result<Detached> {
        let before = self.notes.clone();
        let bin = self.take_containers()?;
        self.take_nodes()?;
        for (number, notes) in self.notes.iter().enumerate() {
            if !self.gone.contains(&number) && before.get(number) != Some(notes) {
                let own = self.document.child("extensions")?.child(EXTENSION)?;
                notes.store(own.element("radianceFields", number)?)?;
            }
        }
        self.take_properties()?;
        write_edited(self.asset, &self.document, &bin, output)?;
        let left = self.fields.objects.len() - self.gone.len();
        Ok(Detached { fields: self.gone.into_iter().collect(), left })
    }

    /// The extension's own objects, and its name among those in use.
    fn take_properties(&mut self) -> Result<()> {
        if self.root.contains_key("extensions") {
            let extensions = self.document.child("extensions")?;
            let own = extensions.child(EXTENSION)?;
            own.remove_elements("radianceFields", |number| self.gone.contains(&number))?;
            extensions.remove_if_empty(EXTENSION)?;
            self.document.remove_if_empty("extensions")?;
        }
        if self.gone.len() < self.fields.objects.len() {
            return Ok(());
        }
        for name in ["extensionsUsed", "extensionsRequired"] {
            let names = self.asset.list(&self.root, name)?;
            let is_own =
                |value: &Node| value.parse::<String>("a name").is_ok_and(|n| n == EXTENSION);
            if names.iter().any(is_own) {
                let goes = |number: usize| names.get(number).is_some_and(is_own);
                self.document.remove_elements(name, goes)?;
            }
        }
        Ok(())
    }

    /// Removes the extension from the nodes that name fields, and removes nodes that were made for
    /// it if they are the last ones and have no other use.
    fn take_nodes(&mut self) -> Result<()> {
        let count = self.asset.list(&self.root, "nodes")?.len();
        let (mut removed, mut moved) = (BTreeSet::new(), BTreeMap::new());
        let first = self.first_made(count)?;
        for user in &self.fields.users {
            if self.gone.contains(&user.field) || user.field >= self.notes.len() {
                if user.node >= first {
                    removed.insert(user.node);
                } else {
                    let node = self.document.element("nodes", user.node)?;
                    node.child("extensions")?.remove(EXTENSION)?;
                    node.remove_if_empty("extensions")?;
                }
                continue;
            }
            let before = self.gone.range(..user.field).count();
            if before > 0 {
                let node = self.document.element("nodes", user.node)?;
                let own = node.child("extensions")?.child(EXTENSION)?;
                own.set("radianceField", user.field - before)?;
            }
            if !removed.is_empty() {
                moved.insert(user.node, user.node - removed.len());
            }
        }
        if !removed.is_empty() {
            self.document.remove_elements("nodes", |number| removed.contains(&number))?;
        }
        self.take_from_scenes(&removed, &moved)
    }

    /// The start of the trailing nodes that were made for fields and have no other content.
    fn first_made(&self, count: usize) -> Result<usize> {
        let mut first = count;
        for user in self.fields.users.iter().rev() {
            let made = self.notes.get(user.field).is_some_and(|notes| notes.node);
            let users = self.fields.users.iter().filter(|other| other.field == user.field);
            let plain = user.object.members()?.iter().all(|(name, value)| match name.as_str() {
                "extensions" => value.members().is_ok_and(|extensions| extensions.len() == 1),
                name => ["name", "rotation"].contains(&name),
            });
            let referred = self.references.nodes.contains(&(user.node as u64));
            if user.node + 1 != first || !made || !plain || referred || users.count() != 1 {
                break;
            }
            first = user.node;
        }
        Ok(first)
    }

    /// Removes the nodes from their scenes, and a scene that was made for them.
    fn take_from_scenes(
        &mut self,
        removed: &BTreeSet<usize>,
        moved: &BTreeMap<usize, usize>,
    ) -> Result<()> {
        let made = self.notes.iter().any(|notes| notes.scene);
        let scenes = self.asset.list(&self.root, "scenes")?;
        for (number, scene) in scenes.iter().enumerate() {
            let members = scene.members()?;
            let listed = members.get("nodes").map(Node::elements).transpose()?.unwrap_or_default();
            let listed = listed.iter().map(Node::index).collect::<Result<Vec<_>>>()?;
            if !listed.iter().any(|node| removed.contains(node) || moved.contains_key(node)) {
                continue;
            }
            let scene = self.document.element("scenes", number)?;
            for (element, node) in scene.list("nodes")?.iter_mut().zip(&listed) {
                if let Some(&new) = moved.get(node) {
                    *element = Tree::New(new.into());
                }
            }
            scene.remove_elements("nodes", |i| removed.contains(&listed[i]))?;
            let is_empty = listed.iter().all(|node| removed.contains(node)) && members.len() == 1;
            if made && is_empty && scenes.len() == 1 {
                self.document.remove("scenes")?;
                self.document.remove("scene")?;
                self.notes.iter_mut().for_each(|notes| notes.scene = false);
            }
        }
        // The first remaining field takes over the note.
        let known = self.gone.iter().any(|&field| self.notes[field].scene);
        let stays = (0..self.notes.len()).find(|field| !self.gone.contains(field));
        if let (true, Some(field)) = (known, stays) {
            self.notes[field].scene = true;
        }
        Ok(())
    }
}
