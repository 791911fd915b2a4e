//! The arrays of a file.

use std::sync::Arc;

use super::basis::Basis;
use super::quantized::Quantized;
use super::tree::Tree;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::sparse::RowArray;
use crate::tensor::{Tensor, TensorFile, Value};

/// Separator between a draw list's name and the tree's keys.
const SEPARATOR: &str = "__";

/// The arrays of a file.
#[derive(Debug)]
pub(super) struct Arrays {
    pub(super) tree: Arc<Tree>,
    pub(super) basis: Basis,
    /// Rows of all cells: colours, then density.
    pub(super) rows: Arc<RowArray>,
    /// Half the box's edges and its middle, in world units.
    pub(super) radius: [f64; 3],
    pub(super) center: [f64; 3],
    /// World units per unit of the tree's own world, which densities refer to.
    pub(super) unit: f64,
}

/// True for a file with the keys of svox.
pub fn knows(file: &TensorFile) -> bool {
    prefix(file).is_some()
}

/// The text before each key: nothing, or a draw list's name.
fn prefix(file: &TensorFile) -> Option<String> {
    let keys = file.root.entries().iter().map(|(key, _)| key);
    let mut prefixes = keys.filter_map(|key| key.strip_suffix("child"));
    let prefix = prefixes.find(|prefix| {
        let has = |key: &str| file.root.get(&format!("{prefix}{key}")).is_some();
        (prefix.is_empty() || prefix.ends_with(SEPARATOR)) && (has("data") || has("quant_map"))
    });
    prefix.map(str::to_owned)
}

impl Arrays {
    /// Finds the arrays, and reads the nodes of the tree.
    pub(super) fn find(file: &TensorFile, limits: &Limits) -> Result<Self> {
        let prefix = prefix(file).unwrap_or_default();
        let key = |key: &str| format!("{prefix}{key}");
        let value = |name: &str| file.setting(&key(name));
        let tensor = |name: &str| -> Result<&Tensor> {
            value(name).and_then(Value::tensor).ok_or_else(|| {
                let place = Place::Tensor(key(name));
                Error::malformed(place, "no such array", "an array of svox's PlenOctrees")
            })
        };
        let tree = Arc::new(Tree::load(tensor("child")?, limits)?);
        let cells = tree.cells();
        let rows = match value("data") {
            Some(_) => {
                let data = tensor("data")?;
                let width = match data.shape() {
                    &[nodes, 2, 2, 2, width @ 2..=76] if nodes * 8 == cells as u64 => width,
                    shape => {
                        let found = format!("shape {shape:?} for {} nodes", cells / 8);
                        let expected = "[nodes, 2, 2, 2, 2 to 76 channels]";
                        return Err(Error::malformed(data.place(), found, expected));
                    }
                };
                RowArray::new(data, usize::try_from(width).unwrap_or(0), limits)?
            }
            None => {
                let retained = value("data_retained").and_then(Value::tensor);
                let (sigma, colors, map) =
                    (tensor("sigma")?, tensor("quant_colors")?, tensor("quant_map")?);
                let made = Quantized::new(sigma, colors, map, retained, cells)?;
                let width = made.width();
                RowArray::made(Box::new(made), cells as u64, width, limits)
            }
        };
        let format = match value("data_format") {
            Some(Value::Text(text)) => Some(text.as_str()),
            _ => None,
        };
        let extra = value("extra_data").map(|value| value.numbers(&key("extra_data")));
        let extra = extra.transpose()?.unwrap_or_default();
        let basis = Basis::parse(format, rows.width(), &extra, !prefix.is_empty())?;
        let vector = |name: &str| -> Result<Option<[f64; 3]>> {
            let Some(value) = value(name) else { return Ok(None) };
            match *value.numbers(&key(name))?.as_slice() {
                [one] => Ok(Some([one; 3])),
                _ => value.vector3(&key(name)).map(Some),
            }
        };
        let per_unit = match vector("invradius3")? {
            Some(per_unit) => per_unit,
            None => vector("invradius")?.unwrap_or([1.0; 3]),
        };
        let offset = vector("offset")?.unwrap_or([0.0; 3]);
        if !per_unit.iter().all(|value| *value > 0.0 && value.is_finite()) {
            let place = Place::Key(key("invradius3"));
            return Err(Error::malformed(place, format!("{per_unit:?}"), "numbers above 0"));
        }
        let rotation = vector("rotation")?.unwrap_or_default();
        if rotation.iter().any(|angle| *angle != 0.0) {
            let place = Place::Key(key("rotation"));
            let expected = "a volume along the axes";
            return Err(Error::unsupported(place, format!("{rotation:?}"), expected));
        }
        let unit = match vector("scale")? {
            None => 1.0,
            Some([scale, y, z]) if scale > 0.0 && scale.is_finite() && [y, z] == [scale; 2] => {
                scale
            }
            Some(scale) => {
                let place = Place::Key(key("scale"));
                return Err(Error::unsupported(place, format!("{scale:?}"), "one number above 0"));
            }
        };
        let translation = vector("translation")?.unwrap_or_default();
        let (mut radius, mut center) = (per_unit, offset);
        let axes = radius.iter_mut().zip(&mut center).zip(translation);
        for ((radius, center), moved) in axes {
            (*radius, *center) = (0.5 * unit / *radius, (0.5 - *center) / *radius * unit + moved);
        }
        Ok(Self { tree, basis, rows: Arc::new(rows), radius, center, unit })
    }
}
