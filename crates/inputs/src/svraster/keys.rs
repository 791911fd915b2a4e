//! The arrays and settings of a file.

use super::ply_rows::PlyRows;
use super::settings::check_harmonics;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, Limits};
use crate::model::grid::Element;
use crate::sparse::RowArray;
use crate::tensor::{FileKind, Tensor, TensorFile, Value};

/// Raw densities at corners.
const CORNERS: &str = "_geo_grid_pts";
/// Alternative names of codebooks and paths in other programs.
const KEYS: [&str; 3] = ["octpath", "octlevel", "_sh0"];
/// Entries of a codebook, at most: indices are bytes.
const BOOK: u64 = 256;

/// True for a file of SVRaster, or one that svraster-webgl converted.
pub fn knows(file: &TensorFile) -> bool {
    match file.kind {
        FileKind::Ply => file.root.at(&["properties", "octlevel"]).is_some(),
        _ => KEYS.iter().all(|key| file.root.get(key).is_some()),
    }
}

/// Numbers of voxels or corners.
#[derive(Debug)]
pub(super) enum Numbers {
    /// As they are.
    Plain(RowArray),
    /// Entries of a codebook.
    Coded { indices: RowArray, book: Vec<f32> },
}

/// The arrays of a checkpoint.
#[derive(Debug)]
pub(super) struct Arrays {
    pub(super) paths: Tensor,
    pub(super) levels: Tensor,
    /// Raw densities at corners, one number a row.
    pub(super) corners: Numbers,
    /// Parts of harmonics, side by side: the first column of each, and its values.
    pub(super) harmonics: Vec<(usize, Numbers)>,
    pub(super) voxels: usize,
    columns: usize,
}

/// The voxels of either kind of file.
#[derive(Debug)]
pub(super) enum Stored {
    Checkpoint(Box<Arrays>),
    Ply(PlyRows),
}

impl Stored {
    pub(super) fn find(file: &TensorFile, limits: &Limits) -> Result<Self> {
        match file.kind {
            FileKind::Ply => PlyRows::find(file).map(Self::Ply),
            _ => Arrays::find(file, limits).map(|arrays| Self::Checkpoint(Box::new(arrays))),
        }
    }

    /// Voxels.
    pub(super) fn voxels(&self) -> usize {
        match self {
            Self::Checkpoint(arrays) => arrays.voxels,
            Self::Ply(rows) => rows.count,
        }
    }

    /// Harmonics of a colour channel.
    pub(super) fn functions(&self) -> usize {
        match self {
            Self::Checkpoint(arrays) => arrays.columns / 3,
            Self::Ply(rows) => rows.functions(),
        }
    }

    /// The harmonics of all voxels, in rows of `width` numbers; longer ones are cut.
    pub(super) fn harmonics(&self, width: usize, out: &mut [f32]) -> Result<()> {
        match self {
            Self::Ply(rows) => rows.harmonics(width, out),
            Self::Checkpoint(arrays) => {
                let wanted = arrays.harmonics.iter().filter(|(first, _)| *first < width);
                wanted.clone().try_for_each(|(first, numbers)| numbers.columns(*first, width, out))
            }
        }
    }

    /// Visits samples of the bytes, for a digest.
    pub(super) fn sample(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        match self {
            Self::Ply(rows) => rows.sample(hash),
            Self::Checkpoint(arrays) => {
                let parts = arrays.harmonics.iter().map(|(_, numbers)| numbers);
                std::iter::once(&arrays.corners)
                    .chain(parts)
                    .try_for_each(|numbers| numbers.rows().sample(hash))
            }
        }
    }
}

impl Numbers {
    fn rows(&self) -> &RowArray {
        match self {
            Self::Plain(rows) | Self::Coded { indices: rows, .. } => rows,
        }
    }

    /// From an array, or from a dictionary of `index` and `codebook`, with this many numbers per
    /// row.
    fn find(value: Option<&Value>, name: &str, width: usize, limits: &Limits) -> Result<Self> {
        let expected = "numbers, or a dictionary of index and codebook";
        let place = Place::Key(name.to_owned());
        let malformed = |found: String| Err(Error::malformed(place.clone(), found, expected));
        let Some(value) = value else { return malformed("nothing".to_owned()) };
        if let Value::Tensor(tensor) = value {
            return Ok(Self::Plain(RowArray::new(tensor, width, limits)?));
        }
        let part = |key: &str| value.get(key).and_then(Value::tensor);
        let (Some(index), Some(book)) = (part("index"), part("codebook")) else {
            return malformed(value.describe());
        };
        limits::check_fixed("entries of a codebook", book.count(), BOOK, &book.place())?;
        let indices = RowArray::quantized(index, vec![[1.0, 0.0]; width], limits)?;
        let book = book.read_f32(&mut Budget::new(limits))?;
        Ok(Self::Coded { indices, book })
    }

    /// Calls `visit` with all numbers in order, some rows at a time.
    fn for_each_piece(&self, mut visit: impl FnMut(&[f32])) -> Result<()> {
        match self {
            Self::Plain(rows) => rows.for_each_piece(visit),
            Self::Coded { indices, book } => {
                let (mut values, mut beyond) = (Vec::new(), None);
                indices.for_each_piece(|piece| {
                    values.clear();
                    values.extend(piece.iter().map(|&index| {
                        #[expect(clippy::cast_possible_truncation, reason = "a byte")]
                        let found = book.get(index as usize).copied();
                        if found.is_none() {
                            beyond = Some(index);
                        }
                        found.unwrap_or(0.0)
                    }));
                    visit(&values);
                })?;
                let Some(index) = beyond else { return Ok(()) };
                let found = format!("entry {index} of a codebook of {}", book.len());
                Err(Error::malformed(Place::Key("codebook".to_owned()), found, "its entries"))
            }
        }
    }

    /// Copies the numbers to rows of `width`, from column `first` on.
    fn columns(&self, first: usize, width: usize, out: &mut [f32]) -> Result<()> {
        let own = self.rows().width();
        let mut rows = out.chunks_exact_mut(width);
        self.for_each_piece(|piece| {
            for (values, row) in piece.chunks_exact(own).zip(&mut rows) {
                let out = row.get_mut(first..).unwrap_or_default();
                out.iter_mut().zip(values).for_each(|(out, value)| *out = *value);
            }
        })
    }
}

impl Arrays {
    fn find(file: &TensorFile, limits: &Limits) -> Result<Self> {
        let root = &file.root;
        let column = |name: &str, element: Element| {
            let expected = format!("{} numbers, one per voxel", element.name());
            let place = Place::Tensor(name.to_owned());
            let value = root.get(name);
            match value.and_then(Value::tensor) {
                Some(tensor)
                    if tensor.element() == element
                        && tensor.shape().first() == Some(&tensor.count()) =>
                {
                    Ok(tensor.clone())
                }
                _ => {
                    let found = value.map_or_else(|| "nothing".to_owned(), Value::describe);
                    Err(Error::malformed(place, found, expected))
                }
            }
        };
        let paths = column("octpath", Element::I64)?;
        let levels = column("octlevel", Element::I8)?;
        let corners = Numbers::find(root.get(CORNERS), CORNERS, 1, limits)?;
        let harmonics = harmonics(root, limits)?;
        let columns = harmonics.iter().map(|(_, numbers)| numbers.rows().width()).sum();
        check_harmonics(columns, &Place::Key("_shs".to_owned()))?;
        let voxels = paths.count();
        let counts = std::iter::once(levels.count())
            .chain(harmonics.iter().map(|(_, numbers)| numbers.rows().rows()));
        for (name, count) in ["octlevel", "_sh0", "_shs", "_shs"].into_iter().zip(counts) {
            if count != voxels {
                let found = format!("{count} rows for {voxels} voxels");
                let place = Place::Key(name.to_owned());
                return Err(Error::malformed(place, found, "one for each"));
            }
        }
        let voxels = limits::product(&[voxels], "voxels", &paths.place())?;
        Ok(Self { paths, levels, corners, harmonics, voxels, columns })
    }

    /// Raw densities at distinct corners.
    ///
    /// # Errors
    /// `Malformed` for another count of them than the voxels have corners.
    pub(super) fn table(&self, corners: usize, budget: &mut Budget) -> Result<Vec<f32>> {
        let place = Place::Tensor(CORNERS.to_owned());
        let found = self.corners.rows().rows();
        if found != corners as u64 {
            let expected = format!("{corners}, one per distinct corner of the voxels");
            return Err(Error::malformed(place, format!("{found} raw densities"), expected));
        }
        let mut table = budget.zeroed(corners, "bytes of corners", &place)?;
        self.corners.columns(0, 1, &mut table)?;
        Ok(table)
    }

    /// Paths and levels of all voxels.
    pub(super) fn places(&self, budget: &mut Budget) -> Result<(Vec<u64>, Vec<u8>)> {
        let mut paths: Vec<u64> =
            budget.zeroed(self.voxels, "bytes of voxels", &self.paths.place())?;
        let mut levels: Vec<u8> =
            budget.zeroed(self.voxels, "bytes of voxels", &self.levels.place())?;
        // Paths have 48 bits, which float64 represents exactly; other values do not cast to below
        // 2^48.
        #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
        let whole = |value: f64| if value < 0.0 { u64::MAX } else { value as u64 };
        let stored = self.paths.read_f64(budget)?;
        paths.iter_mut().zip(&stored).for_each(|(out, value)| *out = whole(*value));
        let stored = self.levels.read_f32(budget)?;
        #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
        levels.iter_mut().zip(stored).for_each(|(out, value)| *out = value as u8);
        Ok((paths, levels))
    }
}

/// The parts of harmonics: two arrays, or for each function three books or one.
fn harmonics(root: &Value, limits: &Limits) -> Result<Vec<(usize, Numbers)>> {
    let mut parts = Vec::new();
    let (first, rest) = (root.get("_sh0"), root.get("_shs"));
    match first {
        Some(Value::List(channels)) => {
            for (channel, value) in channels.iter().enumerate().take(3) {
                parts.push((channel, Numbers::find(Some(value), "_sh0", 1, limits)?));
            }
        }
        _ => parts.push((0, Numbers::find(first, "_sh0", 3, limits)?)),
    }
    match rest {
        Some(Value::List(functions)) => {
            for (function, value) in functions.iter().enumerate().take(15) {
                parts.push((3 * (function + 1), Numbers::find(Some(value), "_shs", 3, limits)?));
            }
        }
        Some(Value::Tensor(tensor)) => {
            let width = match tensor.shape() {
                [_, functions @ 1..=15, 3] => 3 * usize::try_from(*functions).unwrap_or(0),
                [_, 0, ..] => return Ok(parts),
                shape => {
                    let found = format!("shape {shape:?}");
                    return Err(Error::malformed(tensor.place(), found, "[voxels, functions, 3]"));
                }
            };
            parts.push((3, Numbers::find(rest, "_shs", width, limits)?));
        }
        _ => {}
    }
    Ok(parts)
}
