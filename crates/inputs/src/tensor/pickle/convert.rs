//! From the arena's objects to a tree of values.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::node::{Allowance, Arena, Array, Id, Node, node};
use super::numpy;
use crate::base::bytes::Storage;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::model::grid::Element;
use crate::tensor::value::check_name;
use crate::tensor::{Data, Tensor, Value};

/// Maximum depth of nested values. State dictionaries need about six.
const DEPTH: usize = 64;

/// The value of the object `root`, everything in it copied out.
pub(super) fn tree(arena: Arena<'_>, root: Id, base: u64, limits: &Limits) -> Result<Value> {
    let (nodes, allowance) = arena.into_parts();
    let place = Place::Offset(base);
    let (path, tensors) = (String::new(), 0);
    let mut copier = Copier { nodes: &nodes, allowance, place, path, tensors, limits };
    copier.value(root, DEPTH)
}

struct Copier<'n, 'a> {
    nodes: &'n [Node<'a>],
    allowance: Allowance,
    place: Place,
    /// Keys that lead to the value being copied, with dots between.
    path: String,
    tensors: u64,
    limits: &'n Limits,
}

impl Copier<'_, '_> {
    fn value(&mut self, id: Id, depth: usize) -> Result<Value> {
        let Some(depth) = depth.checked_sub(1) else {
            let found = format!("values nested {DEPTH} deep, or one that holds itself");
            return Err(Error::malformed(self.place.clone(), found, "a tree of plain values"));
        };
        self.allowance.object(size_of::<(String, Value)>(), &self.place)?;
        match node(self.nodes, id) {
            Node::None => Ok(Value::None),
            Node::Bool(value) => Ok(Value::Bool(*value)),
            Node::Int(value) => Ok(Value::Int(*value)),
            Node::Float(value) => Ok(Value::Float(*value)),
            Node::Text(text) => self.text(text).map(Value::Text),
            Node::Bytes(bytes) => self.text(&format!("{} bytes", bytes.len())).map(Value::Text),
            Node::Global(global) => self.text(&format!("{global:?}")).map(Value::Text),
            Node::NumpyType(code) => self.text(code).map(Value::Text),
            Node::Storage(..) => Ok(Value::Opaque("a storage without a tensor".to_owned())),
            Node::Opaque(kind) => self.text(kind).map(Value::Opaque),
            Node::UnreadTensor(kind, shape) => {
                self.count_tensor()?;
                let kind = self.text(kind)?;
                Tensor::unread(self.path.clone(), shape.clone(), kind).map(Value::Tensor)
            }
            Node::Tuple(items) | Node::List(items) => {
                let mut list = Vec::new();
                for (number, &item) in items.iter().enumerate() {
                    let value = self.under(&number.to_string(), |copier| copier.value(item, depth));
                    list.push(value?);
                }
                Ok(Value::List(list))
            }
            Node::Dict(items) => self.dict(items, depth),
            Node::Tensor { data, element, first, shape, strides } => {
                self.count_tensor()?;
                let (name, element, data) = (self.path.clone(), *element, data.clone());
                Tensor::new(name, element, shape.clone(), strides.clone(), *first, data)
                    .map(Value::Tensor)
            }
            Node::Array(Some(array)) => self.array(array),
            Node::Array(None) => {
                let found = "a NumPy array without a state";
                Err(Error::malformed(self.place.clone(), found, "its shape and values"))
            }
        }
    }

    fn dict(&mut self, items: &[(Id, Id)], depth: usize) -> Result<Value> {
        let mut dict: Vec<(String, Value)> = Vec::new();
        let mut numbers = BTreeMap::new();
        for (number, &(key, value)) in items.iter().enumerate() {
            let key = match node(self.nodes, key) {
                Node::Text(text) => self.text(text)?,
                Node::Int(value) => value.to_string(),
                Node::Float(value) => value.to_string(),
                Node::Bool(value) => value.to_string(),
                Node::None => "None".into(),
                // It is never requested, and must not hide another value.
                other => self.text(&format!("{} as key {number}", other.describe()))?,
            };
            let value = self.under(&key, |copier| copier.value(value, depth))?;
            // As in Python, a repeated key changes its value and keeps its place.
            match numbers.get(&key).and_then(|&number: &usize| dict.get_mut(number)) {
                Some((_, earlier)) => *earlier = value,
                None => {
                    numbers.insert(key.clone(), dict.len());
                    dict.push((key, value));
                }
            }
        }
        Ok(Value::Dict(dict))
    }

    /// An array without axes is a number.
    fn array(&mut self, array: &Array) -> Result<Value> {
        let place = Place::Tensor(self.path.clone());
        let kind = format!("a NumPy array of type {}", array.code);
        let Some(bytes) = &array.bytes else {
            self.count_tensor()?;
            let kind = format!("{kind}, whose values are Python objects");
            return Tensor::unread(self.path.clone(), array.shape.clone(), kind).map(Value::Tensor);
        };
        if array.shape.is_empty() {
            return Ok(match numpy::number(&array.code, bytes) {
                Some(Node::Bool(value)) => Value::Bool(value),
                Some(Node::Int(value)) => Value::Int(value),
                Some(Node::Float(value)) => Value::Float(value),
                _ => Value::Opaque(kind),
            });
        }
        self.count_tensor()?;
        let Some(element) = Element::from_numpy(&array.code) else {
            return Tensor::unread(self.path.clone(), array.shape.clone(), kind).map(Value::Tensor);
        };
        let data = Data::Stored(Storage::Memory(Arc::clone(bytes)));
        let make = if array.fortran { Tensor::fortran } else { Tensor::dense };
        let tensor = make(self.path.clone(), element, array.shape.clone(), data)?;
        if tensor.bytes() != bytes.len() as u64 {
            let found = format!("{} bytes for shape {:?}", bytes.len(), array.shape);
            return Err(Error::malformed(place, found, format!("{}", tensor.bytes())));
        }
        Ok(Value::Tensor(tensor))
    }

    fn count_tensor(&mut self) -> Result<()> {
        self.tensors += 1;
        limits::check(
            LimitName::Entries,
            "tensors",
            self.tensors,
            self.limits.entries,
            &self.place,
        )?;
        self.allowance.bytes(size_of::<Tensor>() + self.path.len(), &self.place)
    }

    fn text(&mut self, text: &str) -> Result<String> {
        self.allowance.bytes(text.len(), &self.place)?;
        Ok(text.to_owned())
    }

    /// Runs `copy` with `key` at the end of the path.
    fn under<T>(&mut self, key: &str, copy: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let length = self.path.len();
        if length > 0 {
            self.path.push('.');
        }
        self.path.push_str(key);
        check_name(self.path.len(), &self.place)?;
        let copied = copy(self);
        self.path.truncate(length);
        copied
    }
}
