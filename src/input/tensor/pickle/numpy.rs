//! NumPy's types, numbers and the states of its arrays.

use super::machine::Machine;
use super::node::{Array, Id, Node};
use crate::base::error::{Error, Result};

/// The number that `bytes` spell in a NumPy type.
pub(super) fn number(code: &str, bytes: &[u8]) -> Option<Node<'static>> {
    Some(match code {
        "b1" => Node::Bool(<[u8; 1]>::try_from(bytes).ok()? != [0]),
        "u1" => Node::Int(u8::from_le_bytes(bytes.try_into().ok()?).into()),
        "u2" => Node::Int(u16::from_le_bytes(bytes.try_into().ok()?).into()),
        "u4" => Node::Int(u32::from_le_bytes(bytes.try_into().ok()?).into()),
        "u8" => Node::Int(u64::from_le_bytes(bytes.try_into().ok()?).try_into().ok()?),
        "i1" => Node::Int(i8::from_le_bytes(bytes.try_into().ok()?).into()),
        "i2" => Node::Int(i16::from_le_bytes(bytes.try_into().ok()?).into()),
        "i4" => Node::Int(i32::from_le_bytes(bytes.try_into().ok()?).into()),
        "i8" => Node::Int(i64::from_le_bytes(bytes.try_into().ok()?)),
        "f2" => Node::Float(half::f16::from_le_bytes(bytes.try_into().ok()?).to_f64()),
        "f4" => Node::Float(f32::from_le_bytes(bytes.try_into().ok()?).into()),
        "f8" => Node::Float(f64::from_le_bytes(bytes.try_into().ok()?)),
        _ => return None,
    })
}

impl<'a> Machine<'a, '_> {
    /// A NumPy number from its type and bytes.
    pub(super) fn numpy_scalar(&mut self, element: Id, bytes: Id) -> Result<Node<'a>> {
        let code = self.numpy_code(element)?;
        let Node::Bytes(spelled) = self.arena.get(bytes) else {
            return Err(self.unlike(bytes, "the bytes of a NumPy number"));
        };
        number(&code, spelled).ok_or_else(|| {
            let found = format!("a NumPy number of type {code} in {} bytes", spelled.len());
            Error::unsupported(self.place.clone(), found, "b1, i1 to i8, u1 to u8 or f2 to f8")
        })
    }

    /// The letters of a NumPy type.
    pub(super) fn numpy_code(&self, element: Id) -> Result<String> {
        match self.arena.get(element) {
            Node::NumpyType(code) => Ok(code.trim_start_matches(['<', '|', '=']).to_owned()),
            _ => Err(self.unlike(element, "a NumPy type")),
        }
    }

    /// The state of a type: `(version, byte order, base type, field names, fields, ...)`.
    pub(super) fn numpy_type_state(&self, state: Id) -> Result<()> {
        let parts: Vec<&Node<'_>> =
            self.items(state)?.iter().take(5).map(|&part| self.arena.get(part)).collect();
        let found = match parts.as_slice() {
            [_, Node::Text("<" | "|" | "="), Node::None, Node::None, Node::None] => return Ok(()),
            [_, Node::Text(">"), ..] => "a big-endian NumPy type",
            [_, Node::Text(_), ..] => "a structured NumPy type",
            _ => return Err(self.unlike(state, "the state of a NumPy type")),
        };
        Err(Error::unsupported(self.place.clone(), found, "a plain little-endian number"))
    }

    /// The state of an array: `(version, shape, type, whether in Fortran order, bytes)`; without
    /// the version in old pickles.
    pub(super) fn numpy_array_state(&mut self, state: Id) -> Result<Array> {
        let items = self.items(state)?;
        let (&[_, shape, element, fortran, bytes] | &[shape, element, fortran, bytes]) = items
        else {
            return Err(self.unlike(state, "the state of a NumPy array"));
        };
        let &Node::Bool(fortran) = self.arena.get(fortran) else {
            return Err(self.unlike(fortran, "whether an array is in Fortran order"));
        };
        self.numpy_array(shape, element, fortran, bytes)
    }
}
