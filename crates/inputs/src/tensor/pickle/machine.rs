//! The stack machine: one instruction after the other.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::global::Global;
use super::node::{Arena, Id, Node, made_by};
use super::storages::Storages;
use crate::base::bytes::ByteReader;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Limits;

/// A running pickle.
pub(super) struct Machine<'a, 's> {
    reader: ByteReader<'a>,
    pub(super) storages: &'s dyn Storages,
    pub(super) arena: Arena<'a>,
    stack: Vec<Id>,
    /// Heights of the stack at which marks lie; nothing below the last can be popped.
    marks: Vec<usize>,
    memo: BTreeMap<u64, Id>,
    /// Place of the running instruction.
    pub(super) place: Place,
}

impl<'a, 's> Machine<'a, 's> {
    pub(super) fn new(
        bytes: &'a [u8],
        base: u64,
        storages: &'s dyn Storages,
        limits: &Limits,
    ) -> Self {
        Self {
            reader: ByteReader::new(bytes, base),
            storages,
            arena: Arena::new(limits),
            stack: Vec::new(),
            marks: Vec::new(),
            memo: BTreeMap::new(),
            place: Place::Offset(base),
        }
    }

    /// Runs to the end; returns all objects and the result.
    pub(super) fn run(mut self) -> Result<(Arena<'a>, Id)> {
        if self.reader.array::<1>()? != [0x80] {
            return Err(self.malformed("no protocol at the start", "a pickle of protocol 2 to 5"));
        }
        let protocol = self.reader.u8()?;
        if !(2..=5).contains(&protocol) {
            let found = format!("pickle protocol {protocol}");
            return Err(Error::unsupported(self.place.clone(), found, "protocol 2 to 5"));
        }
        loop {
            self.place = self.reader.place();
            let code = self.reader.u8()?;
            if code == b'.' {
                let root = self.pop()?;
                if self.reader.left() > 0 {
                    let found = format!("{} bytes after the pickle's end", self.reader.left());
                    return Err(self.malformed(found, "none"));
                }
                return Ok((self.arena, root));
            }
            self.step(code)?;
        }
    }

    fn step(&mut self, code: u8) -> Result<()> {
        match code {
            // FRAME: a hint for readers of streams.
            0x95 => {
                let length = self.reader.u64()?;
                let left = self.reader.left() as u64;
                if length > left {
                    let kind = ErrorKind::Truncated { wanted: length, left };
                    return Err(Error::new(kind, self.place.clone()));
                }
                Ok(())
            }
            b'N' => self.push(Node::None),
            0x88 => self.push(Node::Bool(true)),
            0x89 => self.push(Node::Bool(false)),
            b'K' => {
                let value = self.reader.u8()?;
                self.push(Node::Int(value.into()))
            }
            b'M' => {
                let value = self.reader.u16()?;
                self.push(Node::Int(value.into()))
            }
            b'J' => {
                let value = self.reader.i32()?;
                self.push(Node::Int(value.into()))
            }
            0x8a => {
                let length = self.reader.u8()?;
                self.long(length.into())
            }
            0x8b => {
                let length = self.reader.u32()?;
                self.long(length.into())
            }
            // Alone among the numbers, floats are big-endian.
            b'G' => {
                let value = f64::from_be_bytes(self.reader.array()?);
                self.push(Node::Float(value))
            }
            0x8c | b'X' | 0x8d => {
                let text = self.text(code)?;
                self.push(Node::Text(text))
            }
            // Python 2's strings, which may be text or bytes.
            b'U' | b'T' => {
                let bytes = self.counted(code)?;
                self.push(match std::str::from_utf8(bytes) {
                    Ok(text) => Node::Text(text),
                    Err(_) => Node::Bytes(Cow::Borrowed(bytes)),
                })
            }
            b'C' | b'B' | 0x8e | 0x96 => {
                let bytes = self.counted(code)?;
                self.push(Node::Bytes(Cow::Borrowed(bytes)))
            }
            // READONLY_BUFFER
            0x98 => Ok(()),
            b'(' | b'0' | b'1' | b'2' | b'q' | b'r' | b'p' | 0x94 | b'h' | b'j' | b'g' => {
                self.shuffle(code)
            }
            b']'
            | b')'
            | b'}'
            | 0x85..=0x87
            | 0x8f..=0x91
            | b't'
            | b'l'
            | b'd'
            | b'a'
            | b'e'
            | b's'
            | b'u' => self.collect(code),
            b'c' => {
                let module = self.line()?;
                let name = self.line()?;
                self.global(module, name)
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                match (self.arena.get(module), self.arena.get(name)) {
                    (&Node::Text(module), &Node::Text(name)) => self.global(module, name),
                    _ => Err(self.malformed("a global whose name is no text", "two texts")),
                }
            }
            b'Q' => self.persistent(),
            b'R' => {
                let (arguments, callable) = (self.pop()?, self.pop()?);
                let made = self.call(callable, arguments)?;
                self.stack.push(made);
                Ok(())
            }
            // An object of a class: treated as a call, without running anything.
            0x81 => {
                let (arguments, class) = (self.pop()?, self.pop()?);
                let made = self.call(class, arguments)?;
                self.stack.push(made);
                Ok(())
            }
            0x92 => {
                let (_, _, class) = (self.pop()?, self.pop()?, self.pop()?);
                let made = made_by(&self.arena.get(class).describe());
                self.push(made)
            }
            b'o' => {
                let class = self.pop_to_mark()?.first().copied();
                let class =
                    class.ok_or_else(|| self.malformed("an object without a class", "one"))?;
                let made = made_by(&self.arena.get(class).describe());
                self.push(made)
            }
            b'b' => {
                let state = self.pop()?;
                let target = self.top()?;
                self.build(target, state)
            }
            _ => Err(Error::unsupported(
                self.place.clone(),
                format!("pickle instruction 0x{code:02x}"),
                "those that plain values and tensors need",
            )),
        }
    }

    /// Marks, pops and the memo.
    fn shuffle(&mut self, code: u8) -> Result<()> {
        match code {
            b'(' => {
                self.arena.allowance.object(size_of::<usize>(), &self.place)?;
                self.marks.push(self.stack.len());
                Ok(())
            }
            b'0' if self.marks.last() == Some(&self.stack.len()) => {
                self.marks.pop();
                Ok(())
            }
            b'0' => self.pop().map(|_| ()),
            b'1' => self.pop_to_mark().map(|_| ()),
            b'2' => self.push_again(self.top()?),
            b'q' | b'r' | b'p' => {
                let number = self.memo_number(code)?;
                self.remember(number)
            }
            0x94 => self.remember(self.memo.len() as u64),
            _ => {
                let number = self.memo_number(code)?;
                let Some(&id) = self.memo.get(&number) else {
                    return Err(
                        self.malformed(format!("memo {number}, never set"), "one set before")
                    );
                };
                self.push_again(id)
            }
        }
    }

    /// Tuples, lists and dictionaries.
    fn collect(&mut self, code: u8) -> Result<()> {
        match code {
            // Sets are lists here.
            b']' | 0x8f => self.push(Node::List(Vec::new())),
            b')' => self.push(Node::Tuple(Vec::new())),
            b'}' => self.push(Node::Dict(Vec::new())),
            0x85..=0x87 => {
                let mut items = Vec::with_capacity(3);
                for _ in 0x84..code {
                    items.push(self.pop()?);
                }
                items.reverse();
                self.push(Node::Tuple(items))
            }
            b't' | b'l' | b'd' | 0x91 => {
                let items = self.pop_to_mark()?;
                match code {
                    b't' => self.push(Node::Tuple(items)),
                    b'l' | 0x91 => self.push(Node::List(items)),
                    _ => {
                        let pairs = self.pairs(&items)?;
                        self.push(Node::Dict(pairs))
                    }
                }
            }
            b'a' | b'e' | 0x90 => {
                let items = if code == b'a' { vec![self.pop()?] } else { self.pop_to_mark()? };
                let target = self.top()?;
                match self.arena.get_mut(target) {
                    Some(Node::List(list)) => {
                        list.extend(items);
                        Ok(())
                    }
                    Some(Node::Opaque(_)) => Ok(()),
                    _ => Err(self.unlike(target, "a list to append to")),
                }
            }
            _ => {
                let items = if code == b's' {
                    let (value, key) = (self.pop()?, self.pop()?);
                    vec![key, value]
                } else {
                    self.pop_to_mark()?
                };
                let pairs = self.pairs(&items)?;
                let target = self.top()?;
                match self.arena.get_mut(target) {
                    Some(Node::Dict(dict)) => {
                        dict.extend(pairs);
                        Ok(())
                    }
                    Some(Node::Opaque(_)) => Ok(()),
                    _ => Err(self.unlike(target, "a dictionary to set items of")),
                }
            }
        }
    }

    fn pairs(&self, items: &[Id]) -> Result<Vec<(Id, Id)>> {
        match items.as_chunks::<2>() {
            (pairs, []) => Ok(pairs.iter().map(|&[key, value]| (key, value)).collect()),
            _ => Err(self.malformed("a key without a value", "keys with values")),
        }
    }

    /// Bytes with their count before them: one, four or eight bytes of it.
    fn counted(&mut self, code: u8) -> Result<&'a [u8]> {
        let length = match code {
            b'U' | b'C' | 0x8c => self.reader.u8()?.into(),
            b'T' | b'B' | b'X' => self.reader.u32()?.into(),
            _ => self.reader.u64()?,
        };
        self.take(length)
    }

    pub(super) fn take(&mut self, length: u64) -> Result<&'a [u8]> {
        self.reader.take(usize::try_from(length).unwrap_or(usize::MAX))
    }

    fn text(&mut self, code: u8) -> Result<&'a str> {
        let bytes = self.counted(code)?;
        std::str::from_utf8(bytes).map_err(|_| self.malformed("text that is not UTF-8", "UTF-8"))
    }

    fn line(&mut self) -> Result<&'a str> {
        let bytes = self.reader.line()?;
        std::str::from_utf8(bytes).map_err(|_| self.malformed("a name that is not UTF-8", "UTF-8"))
    }

    fn memo_number(&mut self, code: u8) -> Result<u64> {
        match code {
            b'q' | b'h' => Ok(self.reader.u8()?.into()),
            b'r' | b'j' => Ok(self.reader.u32()?.into()),
            _ => {
                let line = self.line()?;
                line.parse().map_err(|_| self.malformed(format!("memo {line:?}"), "a number"))
            }
        }
    }

    fn remember(&mut self, number: u64) -> Result<()> {
        let top = self.top()?;
        self.arena.allowance.bytes(size_of::<(u64, Id)>(), &self.place)?;
        self.memo.insert(number, top);
        Ok(())
    }

    fn global(&mut self, module: &str, name: &str) -> Result<()> {
        let Some(global) = Global::find(module, name) else {
            let short = |text: &str| text.chars().take(80).collect::<String>();
            let kind = format!("the Python name {}.{}", short(module), short(name));
            self.arena.allowance.bytes(kind.len(), &self.place)?;
            return self.push(Node::Opaque(kind));
        };
        self.push(Node::Global(global))
    }

    /// A new object.
    pub(super) fn push(&mut self, node: Node<'a>) -> Result<()> {
        let id = self.arena.add(node, &self.place)?;
        self.stack.push(id);
        Ok(())
    }

    /// A reference to an existing object; counted, because a stack of references takes memory too.
    fn push_again(&mut self, id: Id) -> Result<()> {
        self.arena.allowance.object(size_of::<Id>(), &self.place)?;
        self.stack.push(id);
        Ok(())
    }

    pub(super) fn pop(&mut self) -> Result<Id> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    fn top(&self) -> Result<Id> {
        let bottom = self.marks.last().copied().unwrap_or(0);
        self.stack
            .get(bottom..)
            .and_then(<[Id]>::last)
            .copied()
            .ok_or_else(|| self.malformed("an instruction that needs a value", "one before it"))
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>> {
        let Some(height) = self.marks.pop() else {
            return Err(self.malformed("an instruction that needs a mark", "one before it"));
        };
        Ok(self.stack.split_off(height.min(self.stack.len())))
    }

    pub(super) fn malformed(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::malformed(self.place.clone(), found, expected)
    }

    pub(super) fn unlike(&self, id: Id, expected: &str) -> Error {
        self.malformed(self.arena.get(id).describe(), expected)
    }
}
