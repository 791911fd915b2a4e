//! The arrays of a file, and those that no container can hold.

use std::sync::Arc;

use super::arrays::Arrays;
use super::lightning;
use super::spheres::SphereFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::options::SourceOptions;
use crate::sparse::{CellBox, Index, RowArray};
use crate::tensor::{Tensor, TensorFile, Value};

/// The number that svox2 gives to harmonics among its bases.
const HARMONICS: i64 = 1;
/// Cells of a scene in normalised device coordinates: more than this along x, this many along z.
const DEVICE_X: u64 = 1000;
const DEVICE_Z: u64 = 128;

/// True for a file with the keys of svox2.
pub fn knows(file: &TensorFile) -> bool {
    let has = |key: &str| file.root.get(key).is_some();
    lightning::knows(file) || has("links") && (has("sh_data") || has("density_data") || has("data"))
}

/// True for files that do not state their cells; an option can.
pub fn takes_resolution(file: &TensorFile) -> bool {
    lightning::knows(file)
}

/// Finds the arrays, without reading svox2's own.
pub(super) fn find(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Arrays> {
    let root = &file.root;
    refuse_basis(root)?;
    if lightning::knows(file) {
        let arrays = lightning::find(file, options.resolution, limits)?;
        return arrays.checked(&Place::Tensor("model.sh_data".to_owned()));
    }
    let tensor = |key: &str| tensor(root, key);
    let (density, color, columns) = match root.get("data") {
        Some(_) => {
            let data = Arc::new(rows(tensor("data")?, limits)?);
            (Arc::clone(&data), data, [0, 1])
        }
        None => {
            let density = rows(tensor("density_data")?, limits)?;
            (Arc::new(density), Arc::new(rows(tensor("sh_data")?, limits)?), [0, 0])
        }
    };
    let links = tensor("links")?;
    if let &[x, _, DEVICE_Z] = links.shape()
        && x > DEVICE_X
    {
        let found = format!("{:?} cells, a scene in normalised device coordinates", links.shape());
        return Err(Error::unsupported(links.place(), found, "a scene in world coordinates"));
    }
    let index = Arc::new(Index::links(links, density.rows(), limits)?);
    let vector = |key: &str, default: f64| match root.get(key) {
        None => Ok([default; 3]),
        Some(value) => match *value.numbers(key)?.as_slice() {
            [x, y, z] => Ok([x, y, z]),
            [one] => Ok([one; 3]),
            _ => value.vector3(key),
        },
    };
    let (radius, center) = (vector("radius", 1.0)?, vector("center", 0.0)?);
    let cells = CellBox { radius, center, cells: index.nodes() };
    let functions = (color.width() - columns[1]) / 3;
    let arrays = Arrays { index, density, color, columns, functions, cells };
    let name = if columns == [0, 1] { "data" } else { "sh_data" };
    arrays.checked(&Place::Tensor(name.to_owned()))
}

/// The spheres behind the box, if any.
///
/// # Errors
/// Those of [`SphereFile::new`], and `Malformed` for values without links.
pub(super) fn spheres(file: &TensorFile, limits: &Limits) -> Result<Option<Arc<SphereFile>>> {
    if lightning::knows(file) {
        return lightning::spheres(file, limits);
    }
    let Some(data) = file.root.get("background_data").and_then(Value::tensor) else {
        return Ok(None);
    };
    let links = tensor(&file.root, "background_links")?;
    let spheres =
        SphereFile::new(links, data, limits, |data, width| RowArray::new(data, width, limits))?;
    Ok(Some(Arc::new(spheres)))
}

/// An array by its key.
fn tensor<'a>(root: &'a Value, key: &str) -> Result<&'a Tensor> {
    root.get(key).and_then(Value::tensor).ok_or_else(|| {
        let place = Place::Tensor(key.to_owned());
        Error::malformed(place, "no such array", "an array of svox2's Plenoxels")
    })
}

/// The rows of `[n, width]`, or of `[n]`.
fn rows(tensor: &Tensor, limits: &Limits) -> Result<RowArray> {
    let width = match tensor.shape() {
        &[_] => 1,
        &[_, width @ 1..=64] => width,
        shape => {
            let found = format!("shape {shape:?}");
            return Err(Error::malformed(tensor.place(), found, "[rows, at most 64 numbers]"));
        }
    };
    RowArray::new(tensor, usize::try_from(width).unwrap_or(0), limits)
}

/// Refuses colours that are not harmonics.
fn refuse_basis(root: &Value) -> Result<()> {
    let Some(basis) = root.get("basis_type") else { return Ok(()) };
    let found = match basis.integer("basis_type")? {
        HARMONICS => return Ok(()),
        4 => "a texture as the basis of colours (3D_TEXTURE)".to_owned(),
        255 => "a network as the basis of colours (MLP)".to_owned(),
        number => format!("basis {number}"),
    };
    let place = Place::Key("basis_type".to_owned());
    Err(Error::unsupported(place, found, "spherical harmonics (1)"))
}
