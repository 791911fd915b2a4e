//! Leaves with colours as codebook indices.

use crate::base::bytes::{SourceFile, Storage};
use crate::base::error::{Error, Result};
use crate::base::limits::{self, Budget, Limits};
use crate::model::grid::Element;
use crate::sparse::MakeBytes;
use crate::tensor::Tensor;

/// Longer rows wait in a file.
const IN_MEMORY: u64 = 64 << 20;
/// Cells that are decoded at once.
const PIECE: usize = 1 << 14;

/// A compressed tree. Its rows are decoded to the plain layout in float16: all functions of red, of
/// green, of blue, then density.
#[derive(Debug)]
pub(super) struct Quantized {
    /// `[n, 2, 2, 2]`.
    sigma: Tensor,
    /// `[books, entries, 3]`.
    colors: Tensor,
    /// uint16 `[books, n, 2, 2, 2]`.
    map: Tensor,
    /// `[functions, n, 2, 2, 2, 3]`.
    retained: Option<Tensor>,
    cells: usize,
    books: usize,
    entries: usize,
    kept: usize,
}

impl Quantized {
    /// Of a tree of this many cells.
    ///
    /// # Errors
    /// `Malformed` for arrays that do not fit it.
    pub(super) fn new(
        sigma: &Tensor,
        colors: &Tensor,
        map: &Tensor,
        retained: Option<&Tensor>,
        cells: usize,
    ) -> Result<Self> {
        let of_cells = |tensor: &Tensor, before: u64, after: u64| {
            let wanted = before.checked_mul(cells as u64).and_then(|n| n.checked_mul(after));
            if wanted == Some(tensor.count()) {
                return Ok(());
            }
            let found = format!("shape {:?}", tensor.shape());
            Err(Error::malformed(
                tensor.place(),
                found,
                format!("an entry for each of {cells} cells"),
            ))
        };
        let &[books, entries, 3] = colors.shape() else {
            let found = format!("shape {:?}", colors.shape());
            return Err(Error::malformed(colors.place(), found, "[books, entries, 3]"));
        };
        if map.element() != Element::U16 && books > 0 {
            let found = format!("{} numbers", map.element().name());
            return Err(Error::malformed(map.place(), found, "uint16"));
        }
        of_cells(sigma, 1, 1)?;
        of_cells(map, books, 1)?;
        let kept = retained.map_or(0, |tensor| tensor.shape().first().copied().unwrap_or(0));
        if let Some(tensor) = retained {
            of_cells(tensor, kept, 3)?;
        }
        let place = colors.place();
        limits::check_fixed("functions of a colour", books.saturating_add(kept), 25, &place)?;
        let count = |number: u64| limits::product(&[number], "code books", &place);
        let (books, entries, kept) = (count(books)?, count(entries)?, count(kept)?);
        let (sigma, colors, map) = (sigma.clone(), colors.clone(), map.clone());
        Ok(Self { sigma, colors, map, retained: retained.cloned(), cells, books, entries, kept })
    }

    /// Numbers of a row.
    pub(super) fn width(&self) -> usize {
        3 * (self.books + self.kept) + 1
    }

    fn row_bytes(&self) -> u64 {
        2 * self.width() as u64 * self.cells as u64
    }
}

impl MakeBytes for Quantized {
    fn make(&self, limits: &Limits) -> Result<Storage> {
        let mut budget = Budget::new(limits);
        let place = self.map.place();
        budget.spend(self.row_bytes(), "bytes of leaves", &place)?;
        let books = self.colors.read_f32(&mut budget)?;
        let sigma = self.sigma.read_f32(&mut budget)?;
        let map = self.map.storage(&mut budget)?;
        let retained = self
            .retained
            .as_ref()
            .map(|tensor| RetainedBytes::new(tensor, self.cells, self.kept, &mut budget));
        let retained = retained.transpose()?;
        let (functions, width) = (self.books + self.kept, self.width());
        let mut rows = Rows::new(self.row_bytes(), self.map.place())?;
        for first in (0..self.cells).step_by(PIECE) {
            let count = PIECE.min(self.cells - first);
            let mut piece = vec![0.0f32; count * width];
            let cells = || piece_rows(first, count, &sigma);
            for (row, density) in piece.chunks_exact_mut(width).zip(cells()) {
                if let Some(last) = row.last_mut() {
                    *last = *density;
                }
            }
            if let Some(retained) = &retained {
                retained.fill(first, count, &mut piece, [width, functions])?;
            }
            let mut bytes = vec![0; 2 * count];
            for book in 0..self.books {
                map.read_into(2 * (book * self.cells + first) as u64, &mut bytes)?;
                let entries = bytes.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b));
                for ((row, entry), density) in
                    piece.chunks_exact_mut(width).zip(entries).zip(cells())
                {
                    // The entry of an empty leaf is unspecified.
                    if *density <= 0.0 {
                        continue;
                    }
                    let at = 3 * (book * self.entries + usize::from(entry));
                    let color = books.get(at..at + 3).filter(|_| usize::from(entry) < self.entries);
                    let Some(color) = color else {
                        let found = format!("entry {entry} of code book {book}");
                        let expected = format!("entries below {}", self.entries);
                        return Err(Error::malformed(place, found, expected));
                    };
                    let columns = row.iter_mut().skip(self.kept + book).step_by(functions);
                    columns.zip(color).for_each(|(value, color)| *value = *color);
                }
            }
            rows.append(&piece)?;
        }
        Ok(rows.finish())
    }

    fn memory_bytes(&self) -> u64 {
        self.row_bytes().min(IN_MEMORY) + self.sigma.bytes() * 2
    }
}

fn piece_rows(first: usize, count: usize, sigma: &[f32]) -> std::slice::Iter<'_, f32> {
    sigma.get(first..first + count).unwrap_or_default().iter()
}

/// Functions without a codebook.
struct RetainedBytes {
    storage: Storage,
    element: Element,
    cells: usize,
    functions: usize,
}

impl RetainedBytes {
    fn new(tensor: &Tensor, cells: usize, functions: usize, budget: &mut Budget) -> Result<Self> {
        let (storage, element) = (tensor.storage(budget)?, tensor.element());
        Ok(Self { storage, element, cells, functions })
    }

    /// Fills the first functions of some cells' rows.
    fn fill(
        &self,
        first: usize,
        count: usize,
        piece: &mut [f32],
        [width, functions]: [usize; 2],
    ) -> Result<()> {
        let size = self.element.size();
        let (mut bytes, mut values) = (vec![0; 3 * count * size], vec![0.0; 3 * count]);
        for own in 0..self.functions {
            let start = 3 * size * (own * self.cells + first);
            self.storage.read_into(start as u64, &mut bytes)?;
            self.element.decode(&bytes, &mut values);
            for (row, color) in piece.chunks_exact_mut(width).zip(values.as_chunks::<3>().0) {
                let columns = row.iter_mut().skip(own).step_by(functions);
                columns.zip(color).for_each(|(value, color)| *value = *color);
            }
        }
        Ok(())
    }
}

/// Rows in memory or, if there are many, in a file.
enum Rows {
    Memory(Vec<u8>),
    File { file: std::fs::File, length: u64 },
}

impl Rows {
    fn new(length: u64, place: crate::base::error::Place) -> Result<Self> {
        if length <= IN_MEMORY {
            return Ok(Self::Memory(Vec::with_capacity(limits::product(
                &[length],
                "rows",
                &place,
            )?)));
        }
        let folder = std::env::temp_dir();
        let file = tempfile::tempfile().map_err(|error| Error::io(error, &folder))?;
        Ok(Self::File { file, length: 0 })
    }

    fn append(&mut self, values: &[f32]) -> Result<()> {
        let bytes = values.iter().flat_map(|value| half::f16::from_f32(*value).to_le_bytes());
        match self {
            Self::Memory(rows) => rows.extend(bytes),
            Self::File { file, length } => {
                let bytes: Vec<u8> = bytes.collect();
                let written = std::io::Write::write_all(file, &bytes);
                written.map_err(|error| Error::io(error, &std::env::temp_dir()))?;
                *length += bytes.len() as u64;
            }
        }
        Ok(())
    }

    fn finish(self) -> Storage {
        match self {
            Self::Memory(rows) => Storage::Memory(rows.into()),
            Self::File { file, length } => {
                let file = SourceFile::nameless(file, &std::env::temp_dir(), length);
                Storage::File { file: file.into(), range: 0..length, crc32: None }
            }
        }
    }
}
