//! Removes containers from the buffers of an asset.
//!
//! Attached containers follow everything else, in the order of their buffer views. Removing one
//! moves those behind it to their places without it.

use super::remove::Removal;
use super::write::{ALIGNMENT, chunk_pieces};
use crate::base::error::{Error, Place, Result};
use crate::gltf::asset::json::Node;
use crate::gltf::asset::{EXTENSION, Piece, buffer_is_chunk, padded};

/// A buffer view.
#[derive(Debug, Clone, Copy)]
struct View {
    number: usize,
    buffer: usize,
    offset: u64,
    length: u64,
}

impl View {
    fn read((number, object): (usize, &Node)) -> Result<Self> {
        let members = object.members()?;
        let whole = |name: &str| members.get(name).map_or(Ok(0), Node::index);
        let (offset, length) = (whole("byteOffset")? as u64, whole("byteLength")? as u64);
        Ok(Self { number, buffer: whole("buffer")?, offset, length })
    }

    fn end(&self) -> u64 {
        self.offset.saturating_add(self.length)
    }
}

impl Removal<'_> {
    /// Removes the containers of removed fields. Returns the pieces of the remaining chunk BIN.
    pub(super) fn take_containers(&mut self) -> Result<Vec<Piece>> {
        let all = self.asset.list(&self.root, "bufferViews")?;
        let all = all.iter().enumerate().map(View::read).collect::<Result<Vec<_>>>()?;
        // Views of containers with their fields, by the views' numbers.
        let mut held = Vec::new();
        for (field, object) in self.fields.objects.iter().enumerate() {
            let number = object.get("bufferView")?.as_ref().map(Node::index).transpose()?;
            held.extend(number.and_then(|number| all.get(number)).map(|&view| (view, field)));
        }
        held.sort_by_key(|(view, _)| view.number);
        let Some(first) = held.iter().position(|(_, field)| self.gone.contains(field)) else {
            return chunk_pieces(self.asset);
        };
        let (others, tail) = (&all[..held[first].0.number], held.split_off(first));
        self.check_tail(&tail, others.len(), all.len())?;
        let bin = self.lay_out(&tail, others)?;
        self.drop_last_buffer(&tail, &all)?;
        let goes = |number: usize| {
            tail.iter().any(|(view, field)| view.number == number && self.gone.contains(field))
        };
        let staying = tail.iter().filter(|(_, field)| !self.gone.contains(field));
        for (new, (_, field)) in (others.len()..).zip(staying) {
            let own = self.document.child("extensions")?.child(EXTENSION)?;
            own.element("radianceFields", *field)?.set("bufferView", new)?;
        }
        self.document.remove_elements("bufferViews", goes)?;
        Ok(bin)
    }

    /// From the first removed view on, each belongs to one field, and nothing else refers to it.
    fn check_tail(&self, tail: &[(View, usize)], first: usize, count: usize) -> Result<()> {
        let is_own = |number: usize| {
            let fields = tail.iter().filter(|(view, _)| view.number == number).count();
            fields == 1 && self.references.views.get(&(number as u64)) == Some(&1)
        };
        match (first..count).find(|number| !is_own(*number)) {
            None => Ok(()),
            Some(number) => Err(behind(number, first)),
        }
    }

    /// Closes the gaps of removed bytes in the chunk BIN.
    fn lay_out(&mut self, tail: &[(View, usize)], others: &[View]) -> Result<Vec<Piece>> {
        let buffers = self.asset.list(&self.root, "buffers")?;
        let mut pieces = chunk_pieces(self.asset)?;
        let (Some(buffer), Some(Piece::File(chunk))) = (buffers.first(), pieces.pop()) else {
            return Ok(Vec::new());
        };
        let own: Vec<_> = match buffer_is_chunk(self.asset, 0, buffer)? {
            true => tail.iter().filter(|(view, _)| view.buffer == 0).collect(),
            false => Vec::new(),
        };
        let Some((lowest, field)) = own.first() else { return Ok(vec![Piece::File(chunk)]) };
        // Containers are last, and in order.
        let ends = others.iter().filter(|other| other.buffer == 0).map(View::end);
        let mut end = ends.max().unwrap_or(0);
        for (view, _) in &own {
            if view.offset < end || view.end() > chunk.length() {
                return Err(behind(view.number, others.len()));
            }
            end = view.end();
        }
        let mut length = self.notes[*field].byte_length.unwrap_or(lowest.offset);
        if length > lowest.offset {
            let found = format!("a buffer of {length} bytes");
            let expected = format!("at most {}, where the container starts", lowest.offset);
            let place = Place::Pointer(format!("/bufferViews/{}", lowest.number));
            return Err(Error::malformed(place, found, expected));
        }
        let mut filled = padded(length).min(lowest.offset);
        pieces.push(Piece::File(chunk.part(0..filled)?));
        for (view, field) in own.into_iter().filter(|(_, field)| !self.gone.contains(field)) {
            let offset = filled.next_multiple_of(ALIGNMENT);
            self.notes[*field].byte_length = (length != offset).then_some(length);
            self.document.element("bufferViews", view.number)?.set("byteOffset", offset)?;
            pieces.push(Piece::Bytes(vec![0; (offset - filled) as usize]));
            pieces.push(Piece::File(chunk.part(view.offset..view.end())?));
            length = offset + view.length;
            filled = padded(length);
        }
        if length > 0 {
            self.document.element("buffers", 0)?.set("byteLength", length)?;
            return Ok(pieces);
        }
        if buffers.len() > 1 {
            let found = "the buffer of the chunk BIN, which nothing is left of, before others";
            return Err(Error::unsupported(buffer.place(), found, "no other buffer"));
        }
        self.document.remove("buffers")?;
        Ok(Vec::new())
    }

    /// Removes the last buffer if it held only a removed container. Other buffers stay, even if
    /// nothing refers to them: other extensions may use their numbers.
    fn drop_last_buffer(&mut self, tail: &[(View, usize)], all: &[View]) -> Result<()> {
        let buffers = self.asset.list(&self.root, "buffers")?;
        let Some((last, buffer)) = buffers.iter().enumerate().next_back() else { return Ok(()) };
        let users = all.iter().filter(|view| view.buffer == last).count();
        let goes =
            tail.iter().filter(|(view, field)| view.buffer == last && self.gone.contains(field));
        if users == 0 || goes.count() < users || buffer_is_chunk(self.asset, last, buffer)? {
            return Ok(());
        }
        self.document.remove_elements("buffers", |number| number == last)
    }
}

fn behind(number: usize, first: usize) -> Error {
    let place = Place::Pointer(format!("/bufferViews/{number}"));
    let found = format!("buffer view {number} after that of a radiance field, {first}");
    Error::unsupported(place, found, "the containers of radiance fields after everything else")
}
