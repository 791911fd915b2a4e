//! NumPy's types, numbers and the states of its arrays.

use super::machine::Machine;
use super::node::{Array, Id, Node};
use crate::base::error::Result;

/// Decodes `bytes` as a number of a NumPy type.
pub(super) fn number(code: &str, bytes: &[u8]) -> Option<Node<'static>> {
    Some(match code {
        "b1" => Node::Bool(<[u8; 1]>::try_from(bytes).ok()? != [0]),
        "u1" => Node::Int(u8::from_le_bytes(bytes.try_into().ok()?).into()),
        "u2" => Node::Int(u16::from_le_bytes(bytes.try_into().ok()?).into()),
        "u4" => Node::Int(u32::from_le_bytes(bytes.try_into().ok()?).into()),
        "u8" => {
            let value = u64::from_le_bytes(bytes.try_into().ok()?);
            i64::try_from(value).map_or(Node::Float(value as f64), Node::Int)
        }
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
        let spelled = match self.arena.get(bytes) {
            Node::Bytes(spelled) => number(&code, spelled),
            _ => None,
        };
        Ok(spelled.unwrap_or_else(|| Node::Opaque(format!("a NumPy number of type {code}"))))
    }

    /// The letters of a NumPy type.
    pub(super) fn numpy_code(&self, element: Id) -> Result<String> {
        match self.arena.get(element) {
            Node::NumpyType(code) => Ok(code.trim_start_matches(['<', '|', '=']).to_owned()),
            _ => Err(self.unlike(element, "a NumPy type")),
        }
    }

    /// The letters of a type once its state is set: `(version, byte order, base type, field names,
    /// fields, ...)`. None if they do not change.
    pub(super) fn numpy_type_state(&self, code: &str, state: Id) -> Result<Option<String>> {
        let parts: Vec<&Node<'_>> =
            self.items(state)?.iter().take(5).map(|&part| self.arena.get(part)).collect();
        match parts.as_slice() {
            [_, Node::Text("<" | "|" | "="), Node::None, Node::None, Node::None] => Ok(None),
            [_, Node::Text(">"), ..] => Ok(Some(format!(">{code}"))),
            [_, Node::Text(_), ..] => Ok(Some(format!("{code} with parts"))),
            _ => Err(self.unlike(state, "the state of a NumPy type")),
        }
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
