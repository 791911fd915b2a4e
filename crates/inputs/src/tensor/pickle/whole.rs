//! Whole numbers of any length.

use super::machine::Machine;
use super::node::Node;
use crate::base::error::Result;

impl Machine<'_, '_> {
    /// A whole number of `length` bytes, two's complement, little-endian. Integers of more than 8
    /// bytes, such as seeds, become the nearest float.
    pub(super) fn long(&mut self, length: u64) -> Result<()> {
        let bytes = self.take(length)?;
        let negative = bytes.last().is_some_and(|&byte| byte >= 0x80);
        let mut padded = [if negative { 0xff } else { 0 }; 8];
        if let Some(head) = padded.get_mut(..bytes.len()) {
            head.copy_from_slice(bytes);
            return self.push(Node::Int(i64::from_le_bytes(padded)));
        }
        let (last, rest) = bytes.split_last().unwrap_or((&0, &[]));
        let first = f64::from(i8::from_le_bytes([*last]));
        let value = rest.iter().rev().fold(first, |sum, &byte| sum * 256.0 + f64::from(byte));
        match value.is_finite() {
            true => self.push(Node::Float(value)),
            false => self.push(Node::Opaque(format!("a whole number of {length} bytes"))),
        }
    }
}
