//! Containers out of the buffers of an asset.
//!
//! Containers that were attached lie behind everything else, in the order of their buffer views. Taking
//! one out moves those behind it to where attaching would have put them had it never been there.

use super::remove::Removal;
use super::{ALIGNMENT, list_of};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::output::gltf::asset::json::Node;
use crate::output::gltf::asset::{Piece, buffer_is_chunk, padded};

/// A buffer view that holds a container.
#[derive(Debug, Clone)]
struct View<'a> {
    object: Node<'a>,
    number: usize,
    field: usize,
    buffer: usize,
    offset: u64,
    length: u64,
}

impl<'a> View<'a> {
    fn read(object: &Node<'a>, number: usize, field: usize) -> Result<Self> {
        let members = object.members()?;
        let whole = |name: &str| members.get(name).map_or(Ok(0), Node::index);
        Ok(Self {
            object: object.clone(),
            number,
            field,
            buffer: whole("buffer")?,
            offset: whole("byteOffset")? as u64,
            length: whole("byteLength")? as u64,
        })
    }

    fn end(&self) -> u64 {
        self.offset.saturating_add(self.length)
    }
}

impl<'a> Removal<'a> {
    /// Takes out the containers of the fields that go. The pieces of the chunk BIN that is left.
    pub(super) fn take_containers(&mut self) -> Result<Vec<Piece>> {
        let chunk = self.asset.chunks().and_then(|chunks| chunks.bin.clone());
        let chunk = chunk.map(|chunk| self.asset.file().part(chunk)).transpose()?;
        let views = self.views()?;
        let goes = |view: &View| self.gone.contains(&view.field);
        let Some(first) = views.iter().find(|view| goes(view)).map(|view| view.number) else {
            return Ok(chunk.map(Piece::File).into_iter().collect());
        };
        let all = self.asset.list(&self.root, "bufferViews")?;
        let tail: Vec<View<'a>> = views.into_iter().filter(|view| view.number >= first).collect();
        self.check_tail(&tail, first, all.len())?;
        let bin = self.lay_out(&tail, &all, first, chunk)?;
        self.drop_buffers(&tail, &all)?;
        let (going, staying): (Vec<_>, Vec<_>) =
            tail.iter().partition(|view| self.gone.contains(&view.field));
        for (new, view) in (first..).zip(staying) {
            let object = self.fields.objects.get(view.field);
            let value = object.map(|object| object.get("bufferView")).transpose()?.flatten();
            if let Some(value) = value.filter(|_| new != view.number) {
                self.edits.replace(&value, new.to_string());
            }
        }
        if let Some(list) = list_of(&self.root, "bufferViews")? {
            let going: Vec<usize> = going.iter().map(|view| view.number).collect();
            self.remove_items("bufferViews", &list, &going);
        }
        Ok(bin)
    }

    /// Views of containers, by their numbers.
    fn views(&self) -> Result<Vec<View<'a>>> {
        let all = self.asset.list(&self.root, "bufferViews")?;
        let mut views = Vec::new();
        for (field, object) in self.fields.objects.iter().enumerate() {
            let Some(number) = object.get("bufferView")? else { continue };
            let number = number.index()?;
            if let Some(view) = all.get(number) {
                views.push(View::read(view, number, field)?);
            }
        }
        views.sort_by_key(|view| view.number);
        Ok(views)
    }

    /// From the first view that goes on, each is one field's, and nothing else refers to it.
    fn check_tail(&self, tail: &[View], first: usize, count: usize) -> Result<()> {
        let own = |number: usize| {
            let fields = tail.iter().filter(|view| view.number == number).count();
            let all = self.references.views.get(&(number as u64)).copied();
            fields == 1 && all == Some(1)
        };
        match (first..count).find(|number| !own(*number)) {
            None => Ok(()),
            Some(number) => Err(behind(number, first)),
        }
    }

    /// Moves what stays in the chunk BIN to where it belongs without what goes.
    fn lay_out(
        &mut self,
        tail: &[View<'a>],
        all: &[Node<'a>],
        first: usize,
        chunk: Option<SourceFile>,
    ) -> Result<Vec<Piece>> {
        let buffers = self.asset.list(&self.root, "buffers")?;
        let in_chunk = |view: &&View| match buffers.get(view.buffer) {
            Some(buffer) => buffer_is_chunk(self.asset, view.buffer, buffer),
            None => Ok(false),
        };
        let mut own = Vec::new();
        for view in tail {
            if in_chunk(&view)? {
                own.push(view);
            }
        }
        let Some(chunk) = chunk else { return Ok(Vec::new()) };
        let (Some(lowest), Some(buffer)) = (own.first(), buffers.first()) else {
            return Ok(vec![Piece::File(chunk)]);
        };
        // Nothing else lies behind the containers, and they lie in order.
        let mut end = 0;
        for (number, object) in all.iter().enumerate().take(first) {
            let other = View::read(object, number, 0)?;
            end = if other.buffer == 0 { other.end().max(end) } else { end };
        }
        for view in &own {
            if view.offset < end || view.end() > chunk.length() {
                return Err(behind(view.number, first));
            }
            end = view.end();
        }
        let record = self.records.get(lowest.field).cloned().unwrap_or_default();
        let mut length = record.byte_length.unwrap_or(lowest.offset);
        let mut filled = record.chunk_length.unwrap_or(padded(length.min(lowest.offset)));
        let kept = filled.min(lowest.offset);
        if length > kept || filled > padded(lowest.offset) {
            let found = format!("a buffer of {length} bytes in a chunk of {filled}");
            let expected = format!("at most {}, where the container starts", lowest.offset);
            return Err(Error::malformed(lowest.object.place(), found, expected));
        }
        let mut pieces = vec![Piece::File(chunk.part(0..kept)?)];
        pieces.push(Piece::Bytes(vec![0; (filled - kept) as usize]));
        for view in own.into_iter().filter(|view| !self.gone.contains(&view.field)) {
            let offset = filled.next_multiple_of(ALIGNMENT);
            if let Some(record) = self.records.get_mut(view.field) {
                record.byte_length = (length != offset).then_some(length);
                record.chunk_length = (padded(length) != filled).then_some(filled);
            }
            if let Some(value) = view.object.get("byteOffset")? {
                self.edits.replace(&value, offset.to_string());
            }
            pieces.push(Piece::Bytes(vec![0; (offset - filled) as usize]));
            pieces.push(Piece::File(chunk.part(view.offset..view.end())?));
            length = offset + view.length;
            filled = padded(length);
        }
        if length > 0 {
            if let Some(value) = buffer.get("byteLength")? {
                self.edits.replace(&value, length.to_string());
            }
            return Ok(pieces);
        }
        if buffers.len() > 1 {
            let found = "the buffer of the chunk BIN, which nothing is left of, before others";
            return Err(Error::unsupported(buffer.place(), found, "no other buffer"));
        }
        if let Some(list) = list_of(&self.root, "buffers")? {
            self.remove_items("buffers", &list, &[0]);
        }
        Ok(Vec::new())
    }

    /// Removes the last buffer where it held nothing but a container that goes. Others stay, though
    /// nothing may refer to them any more: their numbers are known to others.
    fn drop_buffers(&mut self, tail: &[View], all: &[Node]) -> Result<()> {
        let Some(list) = list_of(&self.root, "buffers")? else { return Ok(()) };
        let Some((last, buffer)) = list.values().iter().enumerate().next_back() else {
            return Ok(());
        };
        if buffer_is_chunk(self.asset, last, buffer)? {
            return Ok(());
        }
        let mut users = 0;
        for (number, object) in all.iter().enumerate() {
            users += usize::from(View::read(object, number, 0)?.buffer == last);
        }
        let goes = |view: &&View| view.buffer == last && self.gone.contains(&view.field);
        if users > 0 && tail.iter().filter(goes).count() == users {
            self.remove_items("buffers", &list, &[last]);
        }
        Ok(())
    }
}

fn behind(number: usize, first: usize) -> Error {
    let place = Place::Pointer(format!("/bufferViews/{number}"));
    let found = format!("buffer view {number} behind that of a radiance field, {first}");
    Error::unsupported(place, found, "the containers of radiance fields behind all else")
}
