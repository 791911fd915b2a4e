//! Rows of numbers in a file.

use std::fmt::Debug;
use std::sync::Mutex;

use crate::base::bytes::Storage;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, Budget, Limits};
use crate::base::lock::lock;
use crate::model::grid::{Element, Nodes};
use crate::tensor::Tensor;

/// The remedy for values that are not finite, if no option helps.
const NOT_FINITE: &str = "retrain: these values are part of the scene";
/// Rows closer than this many bytes are read as one, because a gap costs less than a call.
const BRIDGED_BYTES: u64 = 4096;
/// Bytes that are read at once, at most, unless one row is longer.
const READ_BYTES: u64 = 1 << 20;
/// Samples in a digest, evenly spaced from the first byte to the last, and bytes of each.
const SAMPLES: u64 = 64;
const SAMPLE_BYTES: u64 = 4096;

/// Computes the bytes of rows that no file holds directly.
pub trait MakeBytes: Debug + Send + Sync {
    /// All rows, one after the other.
    ///
    /// # Errors
    /// Errors of reading, and more bytes than the limits allow.
    fn make(&self, limits: &Limits) -> Result<Storage>;

    /// Bytes that it takes in memory, at most.
    fn memory_bytes(&self) -> u64;
}

#[derive(Debug)]
enum Source {
    Tensor(Tensor),
    Made(Box<dyn MakeBytes>),
}

/// An array of rows: the last axes make a row, all axes before them count rows.
#[derive(Debug)]
pub struct RowArray {
    source: Source,
    element: Element,
    place: Place,
    rows: u64,
    width: usize,
    /// For each column, the factor and the addend that make values of stored numbers.
    scales: Option<Vec<[f32; 2]>>,
    limits: Limits,
    /// The bytes after first use: checksums are verified, entries inflated.
    storage: Mutex<Option<Storage>>,
}

impl RowArray {
    /// The rows of `tensor`, each `width` numbers of its last axes.
    ///
    /// # Errors
    /// `Malformed` for numbers other than floats, and for incomplete rows.
    pub fn new(tensor: &Tensor, width: usize, limits: &Limits) -> Result<Self> {
        if !matches!(tensor.element(), Element::F16 | Element::BF16 | Element::F32 | Element::F64) {
            let found = format!("{} numbers", tensor.element().name());
            let expected = "float16, bfloat16, float32 or float64";
            return Err(Error::malformed(tensor.place(), found, expected));
        }
        Self::of_tensor(tensor, width, None, limits)
    }

    /// The same of uint8 numbers: column by column, a value is a number times a factor and an
    /// addend.
    ///
    /// # Errors
    /// `Malformed` for other numbers, and for incomplete rows.
    pub fn quantized(tensor: &Tensor, scales: Vec<[f32; 2]>, limits: &Limits) -> Result<Self> {
        if tensor.element() != Element::U8 {
            let found = format!("{} numbers", tensor.element().name());
            return Err(Error::malformed(tensor.place(), found, "uint8"));
        }
        Self::of_tensor(tensor, scales.len(), Some(scales), limits)
    }

    fn of_tensor(
        tensor: &Tensor,
        width: usize,
        scales: Option<Vec<[f32; 2]>>,
        limits: &Limits,
    ) -> Result<Self> {
        let place = tensor.place();
        let rows = tensor.count().checked_div(width as u64).unwrap_or(0);
        if rows.checked_mul(width as u64) != Some(tensor.count()) {
            let found = format!("shape {:?}", tensor.shape());
            return Err(Error::malformed(place, found, format!("rows of {width} numbers")));
        }
        let (element, source) = (tensor.element(), Source::Tensor(tensor.clone()));
        let (limits, storage) = (limits.clone(), Mutex::new(None));
        Ok(Self { source, element, place, rows, width, scales, limits, storage })
    }

    /// Rows of float16 that are computed on first use.
    pub fn made(source: Box<dyn MakeBytes>, rows: u64, width: usize, limits: &Limits) -> Self {
        let (source, place) = (Source::Made(source), Place::File);
        let (limits, storage) = (limits.clone(), Mutex::new(None));
        let scales = None;
        Self { source, element: Element::F16, place, rows, width, scales, limits, storage }
    }

    /// Rows.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Numbers of a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Type of the numbers.
    pub fn element(&self) -> Element {
        self.element
    }

    /// Bytes of a row.
    pub fn row_bytes(&self) -> usize {
        self.width * self.element().size()
    }

    /// Bytes that it takes in memory, at most: those of entries that have to be inflated.
    pub fn memory_bytes(&self) -> u64 {
        match &self.source {
            Source::Tensor(tensor) if tensor.is_compressed() => tensor.bytes(),
            Source::Tensor(_) => 0,
            Source::Made(made) => made.memory_bytes(),
        }
    }

    /// All values, as float32.
    ///
    /// # Errors
    /// Errors of reading, and more memory than the budget has.
    pub fn values(&self, budget: &mut Budget) -> Result<Vec<f32>> {
        let count = limits::product(&[self.rows, self.width as u64], "rows", &self.place)?;
        let mut values = budget.zeroed(count, "bytes of rows", &self.place)?;
        let mut rest = &mut values[..];
        self.for_each_piece(|piece| {
            let (own, left) = std::mem::take(&mut rest).split_at_mut(piece.len());
            own.copy_from_slice(piece);
            rest = left;
        })?;
        Ok(values)
    }

    /// Calls `visit` with all rows in order, some at a time.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn for_each_piece(&self, mut visit: impl FnMut(&[f32])) -> Result<()> {
        let mut values = Vec::new();
        self.for_each_stored(|bytes| {
            values.resize(bytes.len() / self.row_bytes() * self.width, 0.0);
            for (bytes, row) in
                bytes.chunks_exact(self.row_bytes()).zip(values.chunks_exact_mut(self.width))
            {
                self.decode(0, bytes, row);
            }
            visit(&values);
        })
    }

    /// Calls `visit` with the bytes of all rows in order, some rows at a time.
    fn for_each_stored(&self, mut visit: impl FnMut(&[u8])) -> Result<()> {
        let storage = self.storage()?;
        let at_once = (READ_BYTES / self.row_bytes().max(1) as u64).max(1);
        let (mut bytes, mut first) = (Vec::new(), 0);
        while first < self.rows {
            let count = at_once.min(self.rows - first);
            let rows = limits::product(&[count], "rows", &self.place)?;
            bytes.resize(rows * self.row_bytes(), 0);
            storage.read_into(first * self.row_bytes() as u64, &mut bytes)?;
            visit(&bytes);
            first += count;
        }
        Ok(())
    }

    /// Values of stored numbers, starting at a column.
    pub(super) fn decode(&self, column: usize, bytes: &[u8], out: &mut [f32]) {
        self.element.decode(bytes, out);
        let scales = self.scales.as_ref().and_then(|scales| scales.get(column..));
        for (value, [factor, addend]) in out.iter_mut().zip(scales.unwrap_or_default()) {
            *value = *value * factor + addend;
        }
    }

    /// A column of rows as stored.
    pub(super) fn decode_column(&self, column: usize, rows: &[u8], out: &mut Vec<f32>) {
        let at = column * self.element.size();
        self.element.decode_column(rows, self.row_bytes(), at, out);
        if let Some([factor, addend]) = self.scales.as_ref().and_then(|scales| scales.get(column)) {
            out.iter_mut().for_each(|value| *value = *value * factor + addend);
        }
    }

    /// Refuses values that are not finite, for rows that are not nodes.
    ///
    /// # Errors
    /// `Malformed`, with the number of the first one's row.
    pub fn check_finite(&self, values: &[f32]) -> Result<()> {
        let Some(at) = values.iter().position(|value| !value.is_finite()) else { return Ok(()) };
        let count = values.iter().filter(|value| !value.is_finite()).count();
        let (row, column) = (at / self.width, at % self.width);
        let found =
            format!("{count} values that are not finite, first in row {row}, column {column}");
        Err(Error::malformed(self.place.clone(), found, "finite numbers").advise(NOT_FINITE))
    }

    /// Refuses values that are not finite at nodes; `row` gives the row of each node. Rows without
    /// a node are ignored.
    ///
    /// # Errors
    /// `NonFinite`, with the first node.
    pub(super) fn check_nodes(
        &self,
        values: &[f32],
        nodes: Nodes,
        row: impl Fn([usize; 3]) -> Option<usize>,
    ) -> Result<()> {
        if values.iter().all(|value| value.is_finite()) {
            return Ok(());
        }
        let (mut count, mut first) = (0, None);
        let [nx, ny, nz] = nodes.0;
        for at in 0..nx * ny * nz {
            let [x, y, z] = [at / (ny * nz), at / nz % ny, at % nz];
            let start = row([x, y, z]).map_or(usize::MAX, |row| row.saturating_mul(self.width));
            let values = values.get(start..start.saturating_add(self.width)).unwrap_or_default();
            for (column, _) in values.iter().enumerate().filter(|(_, value)| !value.is_finite()) {
                count += 1;
                first.get_or_insert([column, x, y, z]);
            }
        }
        match first {
            Some(first) => {
                Err(Error::new(ErrorKind::NonFinite { count, first }, self.place.clone()))
            }
            None => Ok(()),
        }
    }

    /// Calls `visit` with one column of all rows, in pieces.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn column(&self, column: usize, mut visit: impl FnMut(&[f32])) -> Result<()> {
        let mut values = Vec::new();
        self.for_each_stored(|bytes| {
            self.decode_column(column, bytes, &mut values);
            visit(&values);
        })
    }

    /// Visits samples of the bytes, for a digest.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn sample(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        let storage = self.storage()?;
        let size = storage.length().min(SAMPLE_BYTES);
        let mut piece = vec![0; limits::product(&[size], "sample", &self.place)?];
        for sample in 0..SAMPLES {
            storage.read_into((storage.length() - size) * sample / (SAMPLES - 1), &mut piece)?;
            hash(&piece);
        }
        Ok(())
    }

    /// Reads consecutive rows, starting at one of them.
    pub(super) fn rows_from(&self, first: u64, out: &mut [u8]) -> Result<()> {
        self.storage()?.read_into(first * self.row_bytes() as u64, out)
    }

    /// Copies rows to their places in `out`. `wanted` holds row numbers, below [`Self::rows`]; this
    /// sorts it. Returns the bytes that were read.
    pub(super) fn gather(&self, wanted: &mut [(u32, u32)], out: &mut [u8]) -> Result<u64> {
        if !wanted.is_sorted() {
            wanted.sort_unstable();
        }
        let (storage, size) = (self.storage()?, self.row_bytes());
        let (mut read, mut bytes) = (0, Vec::new());
        let mut left = &wanted[..];
        while let Some(&(first, _)) = left.first() {
            let start = u64::from(first) * size as u64;
            let mut end = start;
            let count = left.iter().take_while(|(row, _)| {
                let from = u64::from(*row) * size as u64;
                let to = from + size as u64;
                let joins =
                    from <= end + BRIDGED_BYTES && (to - start <= READ_BYTES || end == start);
                if joins {
                    end = to;
                }
                joins
            });
            let (run, rest) = left.split_at(count.count());
            bytes.resize(limits::product(&[end - start], "rows", &self.place)?, 0);
            storage.read_into(start, &mut bytes)?;
            read += end - start;
            for &(row, place) in run {
                let at = (row - first) as usize * size;
                let to = place as usize * size;
                if let (Some(from), Some(to)) =
                    (bytes.get(at..at + size), out.get_mut(to..to + size))
                {
                    to.copy_from_slice(from);
                }
            }
            left = rest;
        }
        Ok(read)
    }

    /// The bytes, verified at the first call.
    fn storage(&self) -> Result<Storage> {
        let mut kept = lock(&self.storage);
        if let Some(storage) = &*kept {
            return Ok(storage.clone());
        }
        let storage = match &self.source {
            Source::Tensor(tensor) => tensor.storage(&mut Budget::new(&self.limits))?,
            Source::Made(made) => made.make(&self.limits)?,
        };
        *kept = Some(storage.clone());
        Ok(storage)
    }
}
