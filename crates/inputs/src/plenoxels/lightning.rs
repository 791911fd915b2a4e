//! The quantized checkpoints of PeRFception, which PyTorch Lightning writes.
//!
//! | key | holds |
//! |---|---|
//! | `state_dict.model.links_idx` | for each row the number of its cell, z fastest |
//! | `state_dict.model.density_data` | density, as floats or as uint8 |
//! | `state_dict.model.sh_data` | coefficients, uint8: a value is `q * scale + min` by column |
//! | `state_dict.model.background_links`, `.background_data` | spheres behind the box, likewise |
//! | `model.sh_data_min`, `model.sh_data_scale` | and the same of other arrays where they are uint8 |
//!
//! No file states the cells along an axis, which are the same for all axes. Without an option, the
//! least power of 2 that holds all cells is assumed and reported.

use std::sync::Arc;

use super::arrays::Arrays;
use super::spheres::SphereFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::model::grid::{Element, Nodes};
use crate::sparse::{CellBox, Index, PlaneRows, RowArray};
use crate::tensor::{Tensor, TensorFile, Value};

/// The dictionary of weights.
const STATE: &str = "state_dict";
/// Cells along each axis, at least and at most.
const SIDES: [usize; 2] = [16, 1024];

/// A value of the weights, or of the file itself.
fn value<'a>(file: &'a TensorFile, key: &str) -> Option<&'a Value> {
    let root = &file.root;
    let nested = root.at(&[STATE, key]).or_else(|| root.get(&format!("{STATE}.{key}")));
    nested.or_else(|| root.get(key))
}

/// True for a file with the keys of PeRFception.
pub(super) fn knows(file: &TensorFile) -> bool {
    value(file, "model.links_idx").is_some() && value(file, "model.sh_data").is_some()
}

/// An array by its key.
fn tensor<'a>(file: &'a TensorFile, key: &str) -> Result<&'a Tensor> {
    value(file, key).and_then(Value::tensor).ok_or_else(|| {
        let place = Place::Tensor(key.to_owned());
        Error::malformed(place, "no such array", "an array of PeRFception's Plenoxels")
    })
}

/// Rows of `width` numbers, quantized or not.
fn rows(file: &TensorFile, data: &Tensor, width: usize, limits: &Limits) -> Result<RowArray> {
    match data.element() {
        Element::U8 => {}
        Element::I8 | Element::I16 | Element::U16 | Element::I32 | Element::I64 => {
            let found = format!("quantized numbers as {}", data.element().name());
            let error = Error::unsupported(data.place(), found, "uint8, or floats");
            return Err(error.advise("save the scene with 8 bits, or without quantization"));
        }
        _ => return RowArray::new(data, width, limits),
    }
    let name = data.name().trim_start_matches(STATE).trim_start_matches('.');
    let column = |name: String| -> Result<Vec<f32>> {
        let found = tensor(file, &name)?;
        let values = found.read_f32(&mut Budget::new(limits))?;
        match values.len() {
            1 => Ok(vec![values.first().copied().unwrap_or(0.0); width]),
            count if count == width => Ok(values),
            count => {
                let expected = format!("one for each of {width} columns");
                Err(Error::malformed(found.place(), format!("{count} numbers"), expected))
            }
        }
    };
    let factors = column(format!("{name}_scale"))?;
    let addends = column(format!("{name}_min"))?;
    let scales = factors.into_iter().zip(addends).map(|(factor, addend)| [factor, addend]);
    RowArray::quantized(data, scales.collect(), limits)
}

/// The spheres behind the box, if any.
pub(super) fn spheres(file: &TensorFile, limits: &Limits) -> Result<Option<Arc<SphereFile>>> {
    let Some(data) = value(file, "model.background_data").and_then(Value::tensor) else {
        return Ok(None);
    };
    // A scene without spheres has an array without layers.
    if data.count() == 0 {
        return Ok(None);
    }
    let links = tensor(file, "model.background_links")?;
    let rows = |data: &Tensor, width| rows(file, data, width, limits);
    Ok(Some(Arc::new(SphereFile::new(links, data, limits, rows)?)))
}

/// Finds the arrays, and reads the cells of all rows.
pub(super) fn find(file: &TensorFile, side: Option<usize>, limits: &Limits) -> Result<Arrays> {
    let rows = |name: &str| -> Result<RowArray> {
        let data = tensor(file, &format!("model.{name}"))?;
        let width = match data.shape() {
            &[_] => 1,
            &[_, width @ 1..=64] => usize::try_from(width).unwrap_or(0),
            shape => {
                let found = format!("shape {shape:?}");
                return Err(Error::malformed(data.place(), found, "[rows, at most 64 numbers]"));
            }
        };
        rows(file, data, width, limits)
    };
    let (density, color) = (Arc::new(rows("density_data")?), Arc::new(rows("sh_data")?));
    let links = tensor(file, "model.links_idx")?;
    let cells = Cells::read(links, side, limits)?;
    if cells.rows.len() as u64 != density.rows() {
        let found = format!("{} cells", cells.rows.len());
        let expected = format!("{}, as density_data has", density.rows());
        return Err(Error::malformed(links.place(), found, expected));
    }
    let nodes = Nodes([cells.side; 3]);
    let place = links.place();
    let index = Index::other(nodes, density.rows(), Box::new(cells), &place)?;
    let vector = |key: &str, default: f64| match value(file, key) {
        None => Ok([default; 3]),
        Some(value) => value.vector3(key),
    };
    let radius = vector("model.radius", 1.0)?;
    let center = vector("model.center", 0.0)?;
    let functions = color.width() / 3;
    let cells = CellBox { radius, center, cells: nodes };
    Ok(Arrays { index: Arc::new(index), density, color, columns: [0, 0], functions, cells })
}

/// The cells of rows, ascending.
#[derive(Debug)]
struct Cells {
    side: usize,
    /// Cell and row.
    rows: Vec<(u32, u32)>,
}

impl Cells {
    fn read(tensor: &Tensor, side: Option<usize>, limits: &Limits) -> Result<Self> {
        let place = tensor.place();
        if !matches!(tensor.element(), Element::I32 | Element::I64) {
            let found = format!("{} numbers", tensor.element().name());
            return Err(Error::malformed(place, found, "int32 or int64"));
        }
        let numbers = tensor.read_f64(&mut Budget::new(limits))?;
        let [least, most] = SIDES;
        let end = most.pow(3) as f64;
        if let Some(wrong) = numbers.iter().find(|number| !(0.0..end).contains(*number)) {
            let expected = format!("cells of a grid of at most {most} cells per side");
            return Err(Error::malformed(place, format!("cell {wrong}"), expected));
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in range")]
        let cells = numbers.iter().map(|number| *number as u32);
        let mut rows: Vec<(u32, u32)> = cells.zip(0..).collect();
        rows.sort_unstable();
        let last = rows.last().map_or(0, |(cell, _)| *cell as usize);
        if let Some(side) = side {
            let least = (2..=most).find(|side| side.pow(3) > last).unwrap_or(most);
            let expected =
                format!("{least} to {most} cells, because the last cell is number {last}");
            let holds = (least..=most).contains(&side);
            Error::require_option(holds, "resolution", side, &expected)?;
            return Ok(Self { side, rows });
        }
        let mut side = least;
        while side.pow(3) <= last {
            side *= 2;
        }
        Ok(Self { side, rows })
    }
}

impl PlaneRows for Cells {
    fn fill(&self, x: usize, rows: &mut [u32]) -> Result<()> {
        let first = x * self.side * self.side;
        let start = self.rows.partition_point(|(cell, _)| (*cell as usize) < first);
        for &(cell, row) in self.rows.get(start..).unwrap_or_default() {
            match rows.get_mut(cell as usize - first) {
                Some(own) => *own = row,
                None => break,
            }
        }
        Ok(())
    }

    fn memory_bytes(&self) -> u64 {
        8 * self.rows.len() as u64
    }
}
