//! The objects that a pickle makes while it runs.

use std::borrow::Cow;
use std::sync::Arc;

use super::global::Global;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::model::grid::Element;
use crate::tensor::Data;

/// The number of an object in its [`Arena`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Id(u32);

/// An object.
#[derive(Debug, Clone)]
pub(super) enum Node<'a> {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(&'a str),
    Bytes(Cow<'a, [u8]>),
    Tuple(Vec<Id>),
    List(Vec<Id>),
    /// Keys and values in the order in which they were set; a later one replaces an equal key.
    Dict(Vec<(Id, Id)>),
    Global(Global),
    Storage(Data, Option<Element>),
    Tensor {
        data: Data,
        element: Element,
        first: u64,
        shape: Vec<u64>,
        strides: Vec<u64>,
    },
    /// A tensor of an unsupported kind: the kind, and the shape if known.
    UnreadTensor(String, Vec<u64>),
    /// An object, a function or a class of an unsupported kind: the kind. It is never run, and its
    /// state is discarded.
    Opaque(String),
    /// A NumPy type: its letter and size, as in `f4`, with `>` before it if it is big-endian.
    NumpyType(String),
    /// A NumPy array, empty until its state is set.
    Array(Option<Array>),
}

/// A NumPy array inside the pickle.
#[derive(Debug, Clone)]
pub(super) struct Array {
    pub(super) code: String,
    pub(super) shape: Vec<u64>,
    pub(super) fortran: bool,
    /// None of Python objects.
    pub(super) bytes: Option<Arc<[u8]>>,
}

impl Node<'_> {
    /// Its kind, for errors.
    pub(super) fn describe(&self) -> String {
        match self {
            Self::None => "None".into(),
            Self::Bool(value) => value.to_string(),
            Self::Int(value) => value.to_string(),
            Self::Float(value) => value.to_string(),
            Self::Text(text) => format!("{:?}", text.chars().take(80).collect::<String>()),
            Self::Bytes(bytes) => format!("{} bytes", bytes.len()),
            Self::Tuple(items) => format!("a tuple of {}", items.len()),
            Self::List(items) => format!("a list of {}", items.len()),
            Self::Dict(items) => format!("a dictionary of {}", items.len()),
            Self::Global(global) => format!("{global:?}"),
            Self::Storage(..) => "a storage".into(),
            Self::Tensor { .. } => "a tensor".into(),
            Self::UnreadTensor(kind, _) | Self::Opaque(kind) => kind.clone(),
            Self::NumpyType(code) => format!("the NumPy type {code}"),
            Self::Array(_) => "a NumPy array".into(),
        }
    }
}

/// The object that an unsupported function or class would make.
pub(super) fn made_by<'a>(kind: &str) -> Node<'a> {
    let name = kind.strip_prefix("the Python name ").unwrap_or(kind);
    let is_tensor =
        ["torch._utils._rebuild", "torch._tensor._rebuild"].iter().any(|s| name.starts_with(s));
    match is_tensor {
        true => Node::UnreadTensor(format!("a tensor that {name} makes"), Vec::new()),
        false if kind.starts_with("a Python object") => Node::Opaque(kind.to_owned()),
        false => Node::Opaque(format!("a Python object of {name}")),
    }
}

/// All objects of a pickle, and their remaining allowance.
#[derive(Debug)]
pub(super) struct Arena<'a> {
    nodes: Vec<Node<'a>>,
    pub(super) allowance: Allowance,
}

impl<'a> Arena<'a> {
    pub(super) fn new(limits: &Limits) -> Self {
        Self { nodes: Vec::new(), allowance: Allowance::new(limits) }
    }

    /// Adds an object.
    pub(super) fn add(&mut self, node: Node<'a>, place: &Place) -> Result<Id> {
        self.allowance.object(size_of::<Node<'_>>(), place)?;
        let number = u32::try_from(self.nodes.len())
            .map_err(|_| Error::new(ErrorKind::Overflow { what: "pickle" }, place.clone()))?;
        self.nodes.push(node);
        Ok(Id(number))
    }

    /// The object of this number; numbers come from [`Arena::add`], so there is one.
    pub(super) fn get(&self, id: Id) -> &Node<'a> {
        self.nodes.get(id.0 as usize).unwrap_or(&Node::None)
    }

    /// The same, mutable.
    pub(super) fn get_mut(&mut self, id: Id) -> Option<&mut Node<'a>> {
        self.nodes.get_mut(id.0 as usize)
    }

    /// Returns the objects and their remaining allowance.
    pub(super) fn into_parts(self) -> (Vec<Node<'a>>, Allowance) {
        (self.nodes, self.allowance)
    }
}

/// The object of this number among an arena's.
pub(super) fn node<'n, 'a>(nodes: &'n [Node<'a>], id: Id) -> &'n Node<'a> {
    nodes.get(id.0 as usize).unwrap_or(&Node::None)
}

/// The nodes and bytes that a pickle may still make.
#[derive(Debug)]
pub(super) struct Allowance {
    objects: u64,
    allowed: u64,
    bytes: u64,
    /// The limit on bytes, and its value.
    most: (LimitName, u64),
}

impl Allowance {
    fn new(limits: &Limits) -> Self {
        // State dictionaries take about twice the size of their pickle; growing lists take up to
        // half as much again.
        let header = (LimitName::HeaderBytes, limits.header_bytes.saturating_mul(2));
        Self { objects: 0, allowed: limits.pickle_objects, bytes: 0, most: header }
    }

    /// Counts an object of `bytes`.
    pub(super) fn object(&mut self, bytes: usize, place: &Place) -> Result<()> {
        self.objects += 1;
        limits::check(
            LimitName::PickleObjects,
            "pickle objects",
            self.objects,
            self.allowed,
            place,
        )?;
        self.bytes(bytes, place)
    }

    /// Counts bytes of an object.
    pub(super) fn bytes(&mut self, bytes: usize, place: &Place) -> Result<()> {
        self.bytes = self.bytes.saturating_add(bytes as u64);
        let (limit, most) = self.most;
        limits::check(limit, "bytes of pickle objects", self.bytes, most, place)
    }
}
