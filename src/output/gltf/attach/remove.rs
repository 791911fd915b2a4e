//! Fields out of an asset.

use std::collections::{BTreeMap, BTreeSet};

use super::record::Record;
use super::references::References;
use super::{list_of, write_edited};
use crate::base::bytes::Output;
use crate::base::error::{Error, Result};
use crate::output::gltf::asset::json::{Edits, List, Node};
use crate::output::gltf::asset::{Asset, EXTENSION, Fields};

/// What was taken out.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Detached {
    /// Fields that were taken out, by the numbers they had.
    pub fields: Vec<usize>,
    /// Fields that are left.
    pub left: usize,
}

/// Writes `asset` without a field, or without all of them, to `output`, complete but not yet finished.
///
/// # Errors
/// Documents that break their rules; an asset without fields; a container in the middle of what other
/// parts of the document refer to by number, which cannot be taken out without renumbering those.
pub fn detach(asset: &Asset, field: Option<usize>, output: &mut Output) -> Result<Detached> {
    Removal::new(asset, field)
        .and_then(|removal| removal.write(output))
        .map_err(|error| error.in_file(asset.path()))
}

/// A document being taken from.
pub(super) struct Removal<'a> {
    pub(super) asset: &'a Asset,
    pub(super) root: List<'a>,
    pub(super) fields: Fields<'a>,
    pub(super) gone: BTreeSet<usize>,
    pub(super) edits: Edits,
    /// By field; those of fields that stay change as others go.
    pub(super) records: Vec<Record>,
    /// Of all fields: what gets empty now may have been found by any of them.
    found: Record,
    /// Of the fields that go: what the first that stays has to know from now on.
    legacy: Record,
    /// What refers to nodes and buffer views by their numbers.
    pub(super) references: References,
}

impl<'a> Removal<'a> {
    fn new(asset: &'a Asset, field: Option<usize>) -> Result<Self> {
        let root = asset.document()?.members()?;
        let fields = Fields::read(asset, &root)?;
        let count = fields.objects.len();
        if field.is_some_and(|field| field >= count) || (count == 0 && fields.users.is_empty()) {
            return Err(Error::usage(format!(
                "{}: there are {count} radiance fields to take out",
                asset.path().display()
            )));
        }
        let gone = match field {
            Some(field) => BTreeSet::from([field]),
            None => (0..count).collect(),
        };
        let records = fields.objects.iter().map(Record::of).collect::<Result<Vec<_>>>()?;
        let (mut found, mut legacy) = (Record::default(), Record::default());
        for (number, record) in records.iter().enumerate() {
            found.absorb(record);
            if gone.contains(&number) {
                legacy.absorb(record);
            }
        }
        let references = References::of(asset)?;
        let edits = Edits::default();
        Ok(Self { asset, root, fields, gone, edits, records, found, legacy, references })
    }

    fn write(mut self, output: &mut Output) -> Result<Detached> {
        let bin = self.take_containers()?;
        self.nodes()?;
        if let Some(first) = (0..self.records.len()).find(|field| !self.gone.contains(field))
            && let Some(record) = self.records.get_mut(first)
        {
            record.absorb(&self.legacy);
        }
        self.properties()?;
        write_edited(self.asset, self.edits, &bin, output)?;
        let left = self.fields.objects.len() - self.gone.len();
        Ok(Detached { fields: self.gone.into_iter().collect(), left })
    }

    /// The extension's own objects, and its name among those in use.
    fn properties(&mut self) -> Result<()> {
        let stays = |(field, _): &(usize, &Record)| !self.gone.contains(field);
        for (field, record) in self.records.iter().enumerate().filter(stays) {
            let object = self.fields.objects.get(field);
            object.map_or(Ok(()), |object| record.replace(object, &mut self.edits))?;
        }
        if self.gone.len() < self.fields.objects.len() {
            let extensions = self.root.get("extensions").map(Node::members).transpose()?;
            let own = extensions.as_ref().and_then(|e| e.get(EXTENSION)).map(Node::members);
            let list = own.transpose()?.map(|own| list_of(&own, "radianceFields"));
            if let Some(list) = list.transpose()?.flatten() {
                self.edits.remove(&list, &self.gone.iter().copied().collect::<Vec<_>>());
            }
            return Ok(());
        }
        let root = &self.root;
        if let Some(extensions) = root.get("extensions").map(Node::members).transpose()?
            && let Some(own) = extensions.get(EXTENSION).map(Node::members).transpose()?
        {
            let list = list_of(&own, "radianceFields")?;
            let all: Vec<usize> = (0..self.fields.objects.len()).collect();
            match list {
                Some(list) if self.was_there("extensions.own.radianceFields") => {
                    self.edits.remove(&list, &all);
                }
                _ if self.was_there("extensions.own") || own.len() > 1 => {
                    self.edits.remove_member(&own, "radianceFields");
                }
                _ if extensions.len() > 1 || self.was_there("extensions") => {
                    self.edits.remove_member(&extensions, EXTENSION);
                }
                _ => self.edits.remove_member(root, "extensions"),
            }
        }
        for name in ["extensionsUsed", "extensionsRequired"] {
            if !self.was_there(&format!("{name}.own")) {
                self.unlist(name)?;
            }
        }
        Ok(())
    }

    fn unlist(&mut self, name: &str) -> Result<()> {
        let Some(list) = list_of(&self.root, name)? else { return Ok(()) };
        let is_own = |value: &Node| value.parse::<String>("a name").is_ok_and(|n| n == EXTENSION);
        let own: Vec<usize> =
            list.values().iter().enumerate().filter(|(_, v)| is_own(v)).map(|(i, _)| i).collect();
        self.remove_items(name, &list, &own);
        Ok(())
    }

    /// Removes elements of a list of the root; the list too, where none are left and it was not there
    /// before.
    pub(super) fn remove_items(&mut self, name: &str, list: &List, numbers: &[usize]) {
        if numbers.is_empty() {
            return;
        }
        if numbers.len() == list.len() && !self.was_there(name) {
            self.edits.remove_member(&self.root, name);
        } else {
            self.edits.remove(list, numbers);
        }
    }

    fn was_there(&self, name: &str) -> bool {
        self.found.found.contains(name)
    }

    /// The nodes that name fields: without the extension, and without those that were made for it, as
    /// far as they are the last ones and nothing else was made of them.
    fn nodes(&mut self) -> Result<()> {
        let nodes = self.asset.list(&self.root, "nodes")?;
        let mut removed = BTreeSet::new();
        let mut moved = BTreeMap::new();
        let first = self.first_made(nodes.len())?;
        for user in self.fields.users.clone() {
            let goes = self.gone.contains(&user.field) || user.field >= self.records.len();
            if goes && user.node >= first {
                removed.insert(user.node);
                continue;
            }
            if goes {
                self.strip(&user.object, user.field)?;
            } else {
                let before = self.gone.range(..user.field).count();
                if before > 0 {
                    self.edits.replace(&user.value, (user.field - before).to_string());
                }
                if !removed.is_empty() {
                    moved.insert(user.node, user.node - removed.len());
                }
            }
        }
        if let Some(list) = list_of(&self.root, "nodes")? {
            self.remove_items("nodes", &list, &removed.iter().copied().collect::<Vec<_>>());
        }
        self.scenes(&removed, &moved)
    }

    /// The first of the last nodes that all were made for fields and show nothing else.
    fn first_made(&self, count: usize) -> Result<usize> {
        let mut first = count;
        for user in self.fields.users.iter().rev() {
            let made = self.records.get(user.field).is_some_and(|record| record.node);
            let users = self.fields.users.iter().filter(|other| other.field == user.field);
            let plain = user.object.members()?.iter().all(|(name, value)| match name {
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

    fn strip(&mut self, node: &Node, field: usize) -> Result<()> {
        let members = node.members()?;
        let Some(extensions) = members.get("extensions").map(Node::members).transpose()? else {
            return Ok(());
        };
        let record = self.records.get(field);
        let was_there = record.is_some_and(|record| record.found.contains("node.extensions"));
        if extensions.len() > 1 || was_there {
            self.edits.remove_member(&extensions, EXTENSION);
        } else {
            self.edits.remove_member(&members, "extensions");
        }
        Ok(())
    }

    fn scenes(&mut self, removed: &BTreeSet<usize>, moved: &BTreeMap<usize, usize>) -> Result<()> {
        let scenes = list_of(&self.root, "scenes")?;
        for scene in scenes.iter().flat_map(List::values) {
            let members = scene.members()?;
            let Some(list) = list_of(&members, "nodes")? else { continue };
            let mut going = Vec::new();
            for (i, value) in list.values().iter().enumerate() {
                let node = value.index()?;
                if removed.contains(&node) {
                    going.push(i);
                } else if let Some(new) = moved.get(&node) {
                    self.edits.replace(value, new.to_string());
                }
            }
            if going.is_empty() {
                continue;
            }
            let alone = scenes.as_ref().is_some_and(|scenes| scenes.len() == 1);
            if going.len() < list.len() || self.was_there("scene.nodes") {
                self.edits.remove(&list, &going);
            } else if self.found.scene && alone && members.len() == 1 {
                self.edits.remove_member(&self.root, "scene");
                self.legacy.scene = false;
                self.legacy.found.remove("scenes");
                if let Some(scenes) = &scenes {
                    self.remove_items("scenes", scenes, &[0]);
                }
            } else {
                self.edits.remove_member(&members, "nodes");
            }
        }
        Ok(())
    }
}
