//! The calls that the interpreter carries out itself.

use std::borrow::Cow;

use super::global::Global;
use super::machine::Machine;
use super::node::{Array, Id, Node};
use crate::base::error::{Error, Result};
use crate::input::tensor::Data;
use crate::model::grid::Element;

impl<'a> Machine<'a, '_> {
    /// `callable(*arguments)`.
    pub(super) fn call(&mut self, callable: Id, arguments: Id) -> Result<Id> {
        let &Node::Global(global) = self.arena.get(callable) else {
            return Err(self.unlike(callable, "a function to call"));
        };
        let Node::Tuple(arguments) = self.arena.get(arguments) else {
            return Err(self.unlike(arguments, "a tuple of arguments"));
        };
        let arguments = arguments.clone();
        self.arena.allowance.bytes(size_of_val(arguments.as_slice()), &self.place)?;
        let node = match (global, arguments.as_slice()) {
            (Global::OrderedDict, []) => Node::Dict(Vec::new()),
            (Global::OrderedDict, &[items]) => self.ordered(items)?,
            (Global::RebuildTensor, &[storage, first, shape, strides, ..]) => {
                self.tensor(storage, [first, shape, strides], None)?
            }
            (Global::RebuildTensorV3, &[storage, first, shape, strides, _, _, element, ..]) => {
                let &Node::Global(Global::ElementType(element)) = self.arena.get(element) else {
                    return Err(self.unlike(element, "an element type"));
                };
                self.tensor(storage, [first, shape, strides], Some(element))?
            }
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
            Node::Dict(_) | Node::Tensor { .. } => Ok(()),
            Node::NumpyType(_) => self.numpy_type_state(state),
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

    /// Python's text as bytes, one byte a character.
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
        crate::base::limits::check("axes", items.len() as u64, 64, &self.place)?;
        items.iter().map(|&item| self.count(item)).collect()
    }

    /// An array that lies in the pickle.
    pub(super) fn numpy_array(
        &mut self,
        shape: Id,
        element: Id,
        fortran: bool,
        bytes: Id,
    ) -> Result<Array> {
        let shape = self.counts(shape)?;
        let code = self.numpy_code(element)?;
        let Node::Bytes(bytes) = self.arena.get(bytes) else {
            let found = format!("a NumPy array of type {code} whose values are Python objects");
            return Err(Error::unsupported(self.place.clone(), found, "an array of numbers"));
        };
        let bytes = std::sync::Arc::from(&**bytes);
        let array = Array { code, shape, fortran, bytes };
        self.arena.allowance.bytes(array.bytes.len() + 256, &self.place)?;
        Ok(array)
    }
}
