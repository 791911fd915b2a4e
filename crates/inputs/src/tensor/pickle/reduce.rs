//! The calls that the interpreter emulates.

use std::borrow::Cow;

use super::global::Global;
use super::machine::Machine;
use super::node::{Array, Id, Node, made_by};
use crate::base::error::{Error, Result};
use crate::base::limits;
use crate::model::grid::Element;
use crate::tensor::Data;

impl<'a> Machine<'a, '_> {
    /// `callable(*arguments)`. Unsupported functions are not run: they return an object of an
    /// unsupported kind.
    pub(super) fn call(&mut self, mut callable: Id, mut arguments: Id) -> Result<Id> {
        // Functions that call another one, with its arguments among theirs.
        while let (Node::Global(Global::RebuildFromType), Node::Tuple(outer)) =
            (self.arena.get(callable), self.arena.get(arguments))
        {
            let &[function, _, inner, ..] = outer.as_slice() else { break };
            (callable, arguments) = (function, inner);
        }
        let global = match self.arena.get(callable) {
            &Node::Global(global) => global,
            Node::Opaque(kind) => {
                let made = made_by(kind);
                self.arena.allowance.bytes(256, &self.place)?;
                return self.arena.add(made, &self.place);
            }
            _ => return Err(self.unlike(callable, "a function to call")),
        };
        let Node::Tuple(arguments) = self.arena.get(arguments) else {
            return Err(self.unlike(arguments, "a tuple of arguments"));
        };
        let arguments = arguments.clone();
        self.arena.allowance.bytes(size_of_val(arguments.as_slice()), &self.place)?;
        let node = match (global, arguments.as_slice()) {
            (Global::OrderedDict, []) => Node::Dict(Vec::new()),
            (Global::OrderedDict, &[items]) => self.ordered(items)?,
            (Global::DefaultDict, _) => Node::Dict(Vec::new()),
            (Global::Counter, &[counts]) => match self.arena.get(counts) {
                Node::Dict(counts) => {
                    let counts = counts.clone();
                    self.arena.allowance.bytes(size_of_val(counts.as_slice()), &self.place)?;
                    Node::Dict(counts)
                }
                _ => return Err(self.unlike(counts, "a dictionary of counts")),
            },
            (Global::Counter, []) => Node::Dict(Vec::new()),
            (Global::Set, []) => Node::List(Vec::new()),
            (Global::Set, &[items]) => {
                let items = self.items(items)?.to_vec();
                self.arena.allowance.bytes(size_of_val(items.as_slice()), &self.place)?;
                Node::List(items)
            }
            (Global::RebuildTensor, &[storage, first, shape, strides, ref more @ ..]) => {
                match self.mark(more.get(2)) {
                    Some(mark) => self.unread_tensor(mark, shape)?,
                    None => self.tensor(storage, [first, shape, strides], None)?,
                }
            }
            (
                Global::RebuildTensorV3,
                &[storage, first, shape, strides, _, _, element, ref more @ ..],
            ) => match (self.mark(more.first()), self.arena.get(element)) {
                (Some(mark), _) => self.unread_tensor(mark, shape)?,
                (_, &Node::Global(Global::ElementType(element))) => {
                    self.tensor(storage, [first, shape, strides], Some(element))?
                }
                (_, Node::Opaque(kind)) => {
                    let kind = kind.clone();
                    self.unread_tensor(kind, shape)?
                }
                _ => return Err(self.unlike(element, "an element type")),
            },
            (Global::RebuildParameter, &[tensor, ..]) => return Ok(tensor),
            (Global::Size, &[sizes]) => {
                let sizes = self.items(sizes)?.to_vec();
                self.arena.allowance.bytes(size_of_val(sizes.as_slice()), &self.place)?;
                Node::Tuple(sizes)
            }
            (Global::Device, &[name, ..]) => match self.arena.get(name) {
                named @ (Node::Text(_) | Node::Int(_) | Node::None) => named.clone(),
                _ => return Err(self.unlike(name, "the name of a device")),
            },
            (Global::NumpyType, &[code, ..]) => match self.arena.get(code) {
                Node::Text(code) => Node::NumpyType((*code).to_owned()),
                _ => return Err(self.unlike(code, "the letters of a NumPy type")),
            },
            (Global::NumpyReconstruct, &[class, ..]) => match self.arena.get(class) {
                Node::Global(Global::NumpyArray) => Node::Array(None),
                Node::Opaque(kind) => made_by(kind),
                _ => return Err(self.unlike(class, "numpy.ndarray")),
            },
            (Global::NumpyScalar, &[element, bytes]) => self.numpy_scalar(element, bytes)?,
            (Global::NumpyFromBuffer, &[bytes, element, shape, order, ..]) => {
                let fortran = match self.arena.get(order) {
                    Node::Text("C") => false,
                    Node::Text("F") => true,
                    _ => {
                        let found = format!("NumPy order {}", self.arena.get(order).describe());
                        return Err(Error::unsupported(self.place.clone(), found, "C or F"));
                    }
                };
                Node::Array(Some(self.numpy_array(shape, element, fortran, bytes)?))
            }
            (Global::Encode, &[text, encoding]) => self.encode(text, encoding)?,
            (Global::Bytes, []) => Node::Bytes(Cow::Borrowed(&[])),
            _ => {
                let found = format!("{global:?} of {} arguments", arguments.len());
                return Err(self.malformed(found, "arguments as Python writes them"));
            }
        };
        self.arena.add(node, &self.place)
    }

    /// Replaces a persistent identifier by the storage that it names:
    /// `("storage", type, key, location, count)`.
    pub(super) fn persistent(&mut self) -> Result<()> {
        let id = self.pop()?;
        let items = self.items(id)?;
        let &[kind, class, key, _, count, ..] = items else {
            return Err(self.unlike(id, "the five parts of a storage"));
        };
        if let (Node::Text("storage"), Node::Opaque(kind)) =
            (self.arena.get(kind), self.arena.get(class))
        {
            let kind = kind.clone();
            return self.push(Node::Opaque(kind));
        }
        let parts = [kind, class, key, count].map(|part| self.arena.get(part));
        let [Node::Text("storage"), Node::Global(Global::Storage(element)), key, count] = parts
        else {
            return Err(self.unlike(id, "a typed storage"));
        };
        let (&Node::Text(key), &Node::Int(count)) = (key, count) else {
            return Err(self.unlike(id, "a storage's key and count"));
        };
        let Ok(count) = u64::try_from(count) else {
            return Err(self.malformed(format!("a storage of {count} elements"), "0 or more"));
        };
        let element = *element;
        let data = self.storages.find(key, element, count)?;
        self.push(Node::Storage(data, element))
    }

    /// Sets the state of an object just made.
    pub(super) fn build(&mut self, target: Id, state: Id) -> Result<()> {
        match self.arena.get(target) {
            // Attributes of dictionaries and tensors, such as a state dictionary's versions.
            Node::Dict(_) | Node::Tensor { .. } | Node::UnreadTensor(..) | Node::Opaque(_) => {
                Ok(())
            }
            Node::NumpyType(code) => {
                let changed = self.numpy_type_state(code, state)?;
                if let (Some(changed), Some(node)) = (changed, self.arena.get_mut(target)) {
                    *node = Node::NumpyType(changed);
                }
                Ok(())
            }
            Node::Array(_) => {
                let array = self.numpy_array_state(state)?;
                if let Some(node) = self.arena.get_mut(target) {
                    *node = Node::Array(Some(array));
                }
                Ok(())
            }
            _ => Err(self.unlike(target, "an object that has a state")),
        }
    }

    /// A dictionary from a list of pairs.
    fn ordered(&mut self, items: Id) -> Result<Node<'a>> {
        let items = self.items(items)?;
        let pairs: Option<Vec<(Id, Id)>> = items
            .iter()
            .map(|&pair| match self.arena.get(pair) {
                Node::Tuple(pair) | Node::List(pair) => match pair.as_slice() {
                    &[key, value] => Some((key, value)),
                    _ => None,
                },
                _ => None,
            })
            .collect();
        let pairs = pairs.ok_or_else(|| self.malformed("items that are no pairs", "pairs"))?;
        self.arena.allowance.bytes(size_of_val(pairs.as_slice()), &self.place)?;
        Ok(Node::Dict(pairs))
    }

    fn tensor(
        &mut self,
        storage: Id,
        [first, shape, strides]: [Id; 3],
        element: Option<Element>,
    ) -> Result<Node<'a>> {
        let (data, typed): (&Data, _) = match self.arena.get(storage) {
            Node::Storage(data, typed) => (data, *typed),
            Node::Opaque(kind) => {
                let kind = kind.clone();
                return self.unread_tensor(kind, shape);
            }
            _ => return Err(self.unlike(storage, "a storage")),
        };
        let Some(element) = element.or(typed) else {
            return Err(self.malformed("a storage without a type", "an element type"));
        };
        let node = Node::Tensor {
            data: data.clone(),
            element,
            first: self.count(first)?,
            shape: self.counts(shape)?,
            strides: self.counts(strides)?,
        };
        self.arena.allowance.bytes(256, &self.place)?;
        Ok(node)
    }

    /// A tensor of an unsupported kind.
    fn unread_tensor(&mut self, kind: String, shape: Id) -> Result<Node<'a>> {
        let shape = self.counts(shape)?;
        self.arena.allowance.bytes(256 + kind.len(), &self.place)?;
        Ok(Node::UnreadTensor(format!("a tensor of {kind}"), shape))
    }

    /// A flag that changes the meaning of a tensor's numbers: the key among a tensor's last
    /// arguments, such as `{'neg': True}`.
    fn mark(&self, marks: Option<&Id>) -> Option<String> {
        let Node::Dict(marks) = self.arena.get(*marks?) else { return None };
        marks.iter().find_map(|&(key, value)| match (self.arena.get(key), self.arena.get(value)) {
            (_, Node::Bool(false)) => None,
            (Node::Text(key), _) => Some(format!("numbers that are marked {key:?}")),
            _ => Some("numbers with a mark".to_owned()),
        })
    }

    /// Python's text as bytes, one byte per character.
    fn encode(&mut self, text: Id, encoding: Id) -> Result<Node<'a>> {
        let (&Node::Text(text), Node::Text("latin1" | "latin-1" | "iso-8859-1")) =
            (self.arena.get(text), self.arena.get(encoding))
        else {
            return Err(self.unlike(encoding, "text to encode as latin1"));
        };
        self.arena.allowance.bytes(text.len(), &self.place)?;
        let bytes: std::result::Result<Vec<u8>, _> =
            text.chars().map(|letter| u8::try_from(u32::from(letter))).collect();
        match bytes {
            Ok(bytes) => Ok(Node::Bytes(Cow::Owned(bytes))),
            Err(_) => Err(self.malformed("text beyond latin1", "characters up to 255")),
        }
    }

    /// The items of a tuple or list.
    pub(super) fn items(&self, id: Id) -> Result<&[Id]> {
        match self.arena.get(id) {
            Node::Tuple(items) | Node::List(items) => Ok(items),
            _ => Err(self.unlike(id, "a tuple")),
        }
    }

    /// A size or offset.
    fn count(&self, id: Id) -> Result<u64> {
        match self.arena.get(id) {
            &Node::Int(value) => u64::try_from(value).ok(),
            _ => None,
        }
        .ok_or_else(|| self.unlike(id, "a whole number of 0 or more"))
    }

    /// Sizes or strides.
    pub(super) fn counts(&self, id: Id) -> Result<Vec<u64>> {
        let items = self.items(id)?;
        limits::check_fixed("axes", items.len() as u64, 64, &self.place)?;
        items.iter().map(|&item| self.count(item)).collect()
    }

    /// An array inside the pickle.
    pub(super) fn numpy_array(
        &mut self,
        shape: Id,
        element: Id,
        fortran: bool,
        bytes: Id,
    ) -> Result<Array> {
        let shape = self.counts(shape)?;
        let code = self.numpy_code(element)?;
        let bytes = match self.arena.get(bytes) {
            Node::Bytes(bytes) => Some(std::sync::Arc::from(&**bytes)),
            _ => None,
        };
        let array = Array { code, shape, fortran, bytes };
        let length = array.bytes.as_ref().map_or(0, |bytes| bytes.len());
        self.arena.allowance.bytes(length + 256, &self.place)?;
        Ok(array)
    }
}
