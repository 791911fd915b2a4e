//! Tables of numbers in texts and messages.

use super::array::Tensor;
use super::value::Value;
use super::zip::Data;
use crate::base::bytes::Storage;
use crate::base::error::Result;
use crate::model::grid::Element;

/// A list of values; rows of equal length become a tensor `[rows, columns]`, float64.
pub(super) fn list(key: String, items: Vec<Value>) -> Result<Value> {
    let Some((columns, numbers)) = numbers(&items) else { return Ok(Value::List(items)) };
    let bytes: Vec<u8> = numbers.into_iter().flat_map(f64::to_le_bytes).collect();
    let shape = vec![items.len() as u64, columns as u64];
    let data = Data::Stored(Storage::Memory(bytes.into()));
    Tensor::dense(key, Element::F64, shape, data).map(Value::Tensor)
}

/// The columns of a table, and its numbers row by row; none for other lists.
fn numbers(items: &[Value]) -> Option<(usize, Vec<f64>)> {
    let (mut columns, mut numbers) = (None, Vec::new());
    for item in items {
        let Value::List(row) = item else { return None };
        if row.is_empty() || columns.is_some_and(|columns| columns != row.len()) {
            return None;
        }
        columns = Some(row.len());
        for value in row {
            numbers.push(match value {
                Value::Int(value) => *value as f64,
                Value::Float(value) => *value,
                _ => return None,
            });
        }
    }
    Some((columns?, numbers))
}
