//! A tensor in a file: type, sizes, strides, and the place of its bytes.
//!
//! Element `(i0, i1, ...)` is element `first + i0 * strides[0] + i1 * strides[1] + ...` of the
//! storage. Every size, stride and offset is checked against the storage's length when the tensor
//! is made, so that no later read can leave it.

use std::ops::Range;

use super::load::load;
use super::unread::Unread;
use super::zip::Data;
use crate::base::bytes::Storage;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, Budget};
use crate::model::grid::Element;

/// Most axes of a tensor; the same bound as PyTorch's and NumPy's.
const AXES: u64 = 64;

/// A strided array of numbers.
#[derive(Debug, Clone)]
pub struct Tensor {
    name: String,
    pub(super) element: Element,
    pub(super) shape: Vec<u64>,
    pub(super) strides: Vec<u64>,
    pub(super) first: u64,
    pub(super) count: u64,
    pub(super) data: Data,
}

impl Tensor {
    /// A strided tensor over `data`.
    ///
    /// # Errors
    /// `Malformed` if it would reach beyond `data`, `Overflow` if its sizes overflow.
    pub fn new(
        name: String,
        element: Element,
        shape: Vec<u64>,
        strides: Vec<u64>,
        first: u64,
        data: Data,
    ) -> Result<Self> {
        let place = Place::Tensor(name.clone());
        limits::check_fixed("axes", shape.len() as u64, AXES, &place)?;
        if shape.len() != strides.len() {
            let found = format!("{} sizes and {} strides", shape.len(), strides.len());
            return Err(Error::malformed(place, found, "one stride for each size"));
        }
        let count = limits::product(&shape, "element count", &place)? as u64;
        let overflow = || Error::new(ErrorKind::Overflow { what: "tensor" }, place.clone());
        count.checked_mul(element.size() as u64).ok_or_else(overflow)?;
        let mut end = first;
        if count > 0 {
            for (&size, &stride) in shape.iter().zip(&strides) {
                let reach = (size - 1).checked_mul(stride).ok_or_else(overflow)?;
                end = end.checked_add(reach).ok_or_else(overflow)?;
            }
            end = end.checked_add(1).ok_or_else(overflow)?;
        }
        let held = data.length() / element.size() as u64;
        if end > held {
            return Err(Error::malformed(
                place,
                format!("shape {shape:?}, strides {strides:?}, offset {first} in {held} elements"),
                "a tensor inside its storage",
            ));
        }
        Ok(Self { name, element, shape, strides, first, count, data })
    }

    /// A tensor in C order that starts with `data`.
    pub fn dense(name: String, element: Element, shape: Vec<u64>, data: Data) -> Result<Self> {
        let strides = dense_strides(&shape);
        Self::new(name, element, shape, strides, 0, data)
    }

    /// A tensor in Fortran order (first axis fastest) that starts with `data`.
    pub fn fortran(name: String, element: Element, shape: Vec<u64>, data: Data) -> Result<Self> {
        let reversed: Vec<u64> = shape.iter().rev().copied().collect();
        let strides = dense_strides(&reversed).into_iter().rev().collect();
        Self::new(name, element, shape, strides, 0, data)
    }

    /// A tensor of an unsupported kind, which `what` names, with its stated shape.
    ///
    /// # Errors
    /// `Overflow` if its sizes overflow.
    pub fn unread(name: String, shape: Vec<u64>, what: String) -> Result<Self> {
        let count = limits::product(&shape, "element count", &Place::Tensor(name.clone()))? as u64;
        let data = Data::Unread(Unread { tensor: name.clone(), what }.into());
        let strides = vec![0; shape.len()];
        Ok(Self { name, element: Element::F32, shape, strides, first: 0, count, data })
    }

    /// The kind of an unsupported tensor.
    pub fn unread_kind(&self) -> Option<&str> {
        match &self.data {
            Data::Unread(unread) => Some(&unread.what),
            _ => None,
        }
    }

    /// Refuses an unsupported tensor.
    pub(super) fn check_read(&self) -> Result<()> {
        match &self.data {
            Data::Unread(unread) => Err(unread.error()),
            _ => Ok(()),
        }
    }

    /// Its name: the keys that lead to it, with dots between.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Type of its numbers.
    pub fn element(&self) -> Element {
        self.element
    }

    /// Sizes, slowest axis first.
    pub fn shape(&self) -> &[u64] {
        &self.shape
    }

    /// Elements in all.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Bytes of its elements; none for unsupported kinds.
    pub fn bytes(&self) -> u64 {
        if self.unread_kind().is_some() {
            return 0;
        }
        self.count * self.element.size() as u64
    }

    /// Offset of its first element in the file, unless it is compressed or in a pickle.
    pub fn offset(&self) -> Option<u64> {
        match &self.data {
            Data::Stored(Storage::File { range, .. }) => {
                Some(range.start + self.first * self.element.size() as u64)
            }
            _ => None,
        }
    }

    /// True if its bytes must be inflated for reading.
    pub fn is_compressed(&self) -> bool {
        matches!(self.data, Data::Deflated { .. })
    }

    /// Some numbers of the second axis at one of the first, as an array `[1, ...]` over the same
    /// bytes.
    ///
    /// # Errors
    /// `Malformed` for fewer than two axes, or too few numbers on them.
    pub fn part(&self, number: u64, range: Range<u64>) -> Result<Self> {
        let mut part = self.clone();
        let (Some(parts), Some(count), Some(&[by, step])) = (
            self.shape.first(),
            self.shape.get(1),
            self.strides.get(..2).and_then(|s| s.first_chunk()),
        ) else {
            let found = format!("shape {:?}", self.shape);
            return Err(Error::malformed(self.place(), found, "at least two axes"));
        };
        if number >= *parts || range.start >= range.end || range.end > *count {
            let found = format!("shape {:?}", self.shape);
            let expected = format!("parts up to {number}, and components up to {}", range.end);
            return Err(Error::malformed(self.place(), found, expected));
        }
        // Both are inside the array if it has elements, because each of them was checked.
        if self.count > 0 {
            part.first += number * by + range.start * step;
        }
        part.count = self.count / parts / count * (range.end - range.start);
        part.shape.splice(..2, [1, range.end - range.start]);
        Ok(part)
    }

    /// The place of errors about it.
    pub fn place(&self) -> Place {
        Place::Tensor(self.name.clone())
    }

    pub(super) fn length(&self) -> Result<usize> {
        limits::product(&[self.count], "element count", &self.place())
    }

    /// The storage's elements from the first that belongs to the tensor to the last.
    fn span(&self) -> Range<u64> {
        let reach = self.shape.iter().zip(&self.strides).map(|(&n, &stride)| (n - 1) * stride);
        self.first..self.first + reach.sum::<u64>() + 1
    }

    /// Elements of [`Self::span`].
    pub(super) fn span_length(&self) -> u64 {
        if self.count == 0 {
            return 0;
        }
        let span = self.span();
        span.end - span.start
    }

    pub(super) fn is_dense(&self) -> bool {
        if self.count == 0 {
            return true;
        }
        let mut dense = 1;
        self.shape.iter().zip(&self.strides).rev().all(|(&size, &stride)| {
            let fits = size == 1 || stride == dense;
            dense *= size;
            fits
        })
    }

    /// The elements' bytes in C order.
    pub(super) fn packed(&self, budget: &mut Budget) -> Result<Vec<u8>> {
        self.check_read()?;
        if self.count == 0 {
            return Ok(Vec::new());
        }
        let place = self.place();
        let storage = self.data.storage(budget)?;
        let span = self.span();
        let size = self.element.size();
        let bytes = load(&storage, span.start, span.end, size as u64, budget, &place)?;
        if self.is_dense() {
            return Ok(bytes);
        }
        let count = limits::product(&[self.count, size as u64], "tensor", &place)?;
        let mut packed: Vec<u8> = budget.zeroed(count, "tensor bytes", &place)?;
        let mut index = vec![0; self.shape.len()];
        let mut at = 0u64;
        for element in packed.chunks_exact_mut(size) {
            let start = usize::try_from(at).unwrap_or(usize::MAX).saturating_mul(size);
            if let Some(source) = bytes.get(start..start.saturating_add(size)) {
                element.copy_from_slice(source);
            }
            let axes = index.iter_mut().zip(&self.shape).zip(&self.strides);
            for ((i, &nodes), &stride) in axes.rev() {
                // The stride of an axis of one node may be any number; its addend is subtracted
                // again below.
                *i += 1;
                at = at.wrapping_add(stride);
                if *i < nodes {
                    break;
                }
                at = at.wrapping_sub(stride.wrapping_mul(nodes));
                *i = 0;
            }
        }
        Ok(packed)
    }
}

fn dense_strides(shape: &[u64]) -> Vec<u64> {
    let mut next = 1u64;
    let mut strides: Vec<u64> = shape
        .iter()
        .rev()
        .map(|&size| {
            let stride = next;
            next = next.saturating_mul(size.max(1));
            stride
        })
        .collect();
    strides.reverse();
    strides
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::limits::Limits;

    fn stored(bytes: impl IntoIterator<Item = u8>) -> Data {
        Data::Stored(Storage::Memory(bytes.into_iter().collect()))
    }

    fn budget() -> Budget {
        Budget::new(&Limits::default())
    }

    #[test]
    fn strides_are_followed() {
        let transposed = |shape, strides, first| {
            Tensor::new("t".into(), Element::U8, shape, strides, first, stored(0..24))
        };
        let t = transposed(vec![3, 2], vec![1, 4], 5).expect("inside");
        assert_eq!(t.read_f32(&mut budget()).expect("memory"), [5., 9., 6., 10., 7., 11.]);
        let t = transposed(vec![2, 3], vec![0, 1], 21).expect("inside");
        assert_eq!(t.read_f64(&mut budget()).expect("memory"), [21., 22., 23., 21., 22., 23.]);
        let t = transposed(vec![2, 1, 2], vec![1, u64::MAX, 9], 0).expect("inside");
        assert_eq!(t.read_f32(&mut budget()).expect("memory"), [0., 9., 1., 10.]);
        assert!(transposed(vec![2, 3], vec![0, 1], 22).is_err());
        assert!(transposed(vec![2], vec![u64::MAX], 1).is_err());
        assert!(transposed(vec![0, u64::MAX], vec![1, 1], 24).is_ok());
        assert!(transposed(vec![0], vec![1], 25).is_err());
        assert!(transposed(vec![1 << 32, 1 << 32], vec![0, 0], 0).is_err());
    }

    #[test]
    fn grids_with_another_fastest_axis_are_copied() {
        let bytes: Vec<u8> = (0..24u8).flat_map(|i| f32::from(i).to_le_bytes()).collect();
        let shape = vec![2, 3, 4];
        let t = Tensor::fortran("t".into(), Element::F32, shape, stored(bytes)).expect("24 values");
        let volume = t.volume(&Limits::default()).expect("a grid");
        let (mut out, mut scratch) = ([0.0; 4], Vec::new());
        volume.read_run(0, [1, 2, 0], &mut out, &mut scratch, |_| {}).expect("inside");
        assert_eq!(out, [5., 11., 17., 23.]);
    }
}
