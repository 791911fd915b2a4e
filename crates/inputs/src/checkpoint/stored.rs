//! A grid of a checkpoint: an array of nodes, or factors of their values.

use std::sync::Arc;

use super::names::NamedValues;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::factors::{FactorArrays, FactorGrid, Mix, Part};
use crate::model::field::{Grid, Volume};
use crate::model::grid::Nodes;
use crate::tensor::Tensor;

/// A plane's name and the axes of its rows and columns; the name and the axis of its line.
type Term = (&'static str, [usize; 2], &'static str, usize);

/// The terms of a `TensoRFGrid`.
const TERMS: [Term; 3] = [
    ("xy_plane", [0, 1], "z_vec", 2),
    ("xz_plane", [0, 2], "y_vec", 1),
    ("yz_plane", [1, 2], "x_vec", 0),
];

/// A grid with unread values.
#[derive(Debug, Clone)]
pub struct StoredGrid {
    /// The tensor that errors name.
    pub name: String,
    values: Values,
    /// The first channels that are used.
    pub channels: usize,
    limits: Limits,
}

#[derive(Debug, Clone)]
enum Values {
    Dense(Volume),
    Factors(FactorArrays),
}

impl StoredGrid {
    /// A grid under its name of either generation, or a `TensoRFGrid`.
    ///
    /// # Errors
    /// `WrongKind` if there is none, `Malformed` if shapes do not fit.
    pub fn find(names: &NamedValues<'_>, name: &str, limits: &Limits) -> Result<Self> {
        let newer = format!("{name}.grid");
        let (name, values) =
            if let Some(tensor) = names.tensor(&newer).or_else(|| names.tensor(name)) {
                (tensor.name().to_owned(), Values::Dense(tensor.volume(limits)?))
            } else if let Some(plane) = names.tensor(&format!("{name}.xy_plane")) {
                (plane.name().to_owned(), Values::Factors(factors(names, name, limits)?))
            } else {
                let found = format!("tensors without a grid {name} or {newer}");
                let expected = "a Mip-VoG or DirectVoxGO model, with density and k0";
                return Err(Error::wrong_kind(found, expected));
            };
        let channels = match &values {
            Values::Dense(volume) => volume.channels,
            Values::Factors(arrays) => arrays.channels,
        };
        Ok(Self { name, values, channels, limits: limits.clone() })
    }

    /// Its nodes.
    pub fn nodes(&self) -> Nodes {
        match &self.values {
            Values::Dense(volume) => volume.nodes,
            Values::Factors(arrays) => arrays.nodes,
        }
    }

    /// The factors, if it has any.
    pub fn factors(&self) -> Option<&FactorArrays> {
        match &self.values {
            Values::Dense(_) => None,
            Values::Factors(arrays) => Some(arrays),
        }
    }

    /// The channels that are used, as a field has them.
    pub fn into_grid(self) -> Grid {
        match self.values {
            Values::Dense(volume) => volume.with_channels(0..self.channels).into(),
            Values::Factors(arrays) => {
                Grid::Values(Arc::new(FactorGrid::new(arrays, self.channels, &self.limits)))
            }
        }
    }
}

/// The factors of a grid, and the matrix of one with several channels.
fn factors(names: &NamedValues<'_>, grid: &str, limits: &Limits) -> Result<FactorArrays> {
    let tensor = |part: &str| -> Result<&Tensor> {
        let name = format!("{grid}.{part}");
        names.tensor(&name).ok_or_else(|| {
            let expected = "the planes and lines of a TensoRFGrid";
            Error::malformed(Place::Tensor(name.clone()), "no such tensor", expected)
        })
    };
    let rows = |line: &str| tensor(line).map(|line| line.shape().get(2).copied().unwrap_or(0));
    let sizes = [rows("x_vec")?, rows("y_vec")?, rows("z_vec")?];
    let nodes = Nodes::checked(sizes, limits, &tensor("x_vec")?.place())?;
    let terms = TERMS.iter().map(|&(plane, [rows, columns], line, axis)| {
        let plane = Part { tensor: tensor(plane)?.clone(), axes: (rows, Some(columns)) };
        Ok(vec![plane, Part { tensor: tensor(line)?.clone(), axes: (axis, None) }])
    });
    let mix = names.tensor(&format!("{grid}.f_vec")).cloned();
    let mix = mix.map(|tensor| Mix { tensor, by_component: true });
    FactorArrays::new(terms.collect::<Result<_>>()?, nodes, mix)
}
