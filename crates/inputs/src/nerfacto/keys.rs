//! The arrays of a checkpoint.
//!
//! | key, after `pipeline._model.` | shape | meaning |
//! |---|---|---|
//! | `field.aabb` | `[2, 3]` | the box |
//! | `field.num_levels`, `max_res`, `log2_hashmap_size` | `[]` | sizes of the table |
//! | `field.mlp_base.model.0.hash_table` | `[levels 2^T, features]` | the table |
//! | `field.mlp_base.model.1.layers.{0,1}.weight`, `.bias` | | from features to density and 15 more |
//! | `field.mlp_head.layers.{0,1,2}` | | from direction, those 15 and the appearance to colour |
//! | `field.embedding_appearance.embedding.weight` | `[pictures, width]` | appearances |
//! | `proposal_networks.N.` with `mlp_base.0`, `mlp_base.1` or `linear` | | the networks of proposals |
//!
//! With tiny-cuda-nn, the parameters of a network with its table are one array,
//! `field.mlp_base.model.params`; those of the others are `tcnn_encoding.params`. Widths follow
//! from their numbers. Rows and columns are padded to multiples of 16. Padded inputs are 0 for
//! networks behind a table, and 1 for the others.

use super::settings::Settings;
use super::table_sizes::TableSizes;
use crate::base::error::{Error, Place, Result};
use crate::model::harmonics::FUNCTIONS;
use crate::packets::{Levels, Sizes, Values};
use crate::tensor::{Tensor, TensorFile, Value};

/// Widths of tiny-cuda-nn's layers are multiples of this.
const MULTIPLE: u64 = 16;
/// Neurons of a layer, at most.
const WIDEST: u64 = 1024;
/// Matrices of a network, at most.
const MOST_LAYERS: usize = 16;
/// Networks of proposals, at most.
const MOST_PROPOSALS: usize = 16;
/// Outputs of tiny-cuda-nn's density network: the density, and 15 for the colour.
const GEOMETRY: u64 = 16;

/// A matrix with biases, if it has any.
#[derive(Debug, Clone)]
pub(super) struct LayerFile {
    pub(super) weights: Values,
    pub(super) biases: Option<Values>,
    pub(super) outputs: usize,
    pub(super) inputs: usize,
}

/// A table and the network behind it.
#[derive(Debug, Clone)]
pub(super) struct GridFile {
    pub(super) levels: Levels,
    pub(super) table: Values,
    pub(super) layers: Vec<LayerFile>,
    /// True if inputs beyond the features are 1.
    pub(super) filled_with_ones: bool,
}

/// All arrays, their shapes checked.
#[derive(Debug, Clone)]
pub(super) struct Arrays {
    pub(super) corners: [[f64; 3]; 2],
    pub(super) field: GridFile,
    /// Outputs of the density network beside the density.
    pub(super) geometry: usize,
    pub(super) color: Vec<LayerFile>,
    /// True with PyTorch's encoding of directions, false with tiny-cuda-nn's.
    pub(super) by_torch: bool,
    /// Appearances of pictures, and their width.
    pub(super) appearances: Option<(Values, [usize; 2])>,
    pub(super) proposals: Vec<GridFile>,
    /// Nodes along an axis of the field's finest level.
    pub(super) finest: u64,
}

/// The values of a model.
#[derive(Debug, Clone, Copy)]
pub(super) struct Keys<'a>(pub(super) &'a TensorFile);

fn path(name: &str) -> String {
    format!("pipeline._model.{name}")
}

impl<'a> Keys<'a> {
    fn find(self, name: &str) -> Option<&'a Value> {
        self.0.root.at(&["pipeline", &format!("_model.{name}")])
    }

    fn tensor(self, name: &str) -> Option<&'a Tensor> {
        self.find(name).and_then(Value::tensor)
    }

    /// True for the arrays of a nerfacto model.
    pub(super) fn known(self) -> bool {
        let has = |names: [&str; 2]| names.iter().any(|name| self.find(name).is_some());
        has(["field.mlp_base.model.0.hash_table", "field.mlp_base.model.params"])
            && has(["field.mlp_head.layers.0.weight", "field.mlp_head.tcnn_encoding.params"])
            && self.proposals() > 0
    }

    /// Networks of proposals.
    pub(super) fn proposals(self) -> usize {
        let is_there = |number: &usize| {
            let within = |name: &str| self.find(&format!("proposal_networks.{number}.{name}"));
            ["aabb", "encoding.hash_table", "encoding.tcnn_encoding.params"]
                .iter()
                .any(|name| within(name).is_some())
        };
        (0..MOST_PROPOSALS).take_while(is_there).count()
    }

    /// Finds all arrays.
    ///
    /// # Errors
    /// `Malformed` for missing arrays, and for shapes that do not follow each other.
    pub(super) fn arrays(self, settings: &Settings) -> Result<Arrays> {
        let corners = self.corners()?;
        let own = [settings.base, settings.features];
        let sizes = self.sizes("field", own, settings.levels)?;
        let by_torch = self.find("field.mlp_base.model.0.hash_table").is_some();
        let appearances = self.appearances()?;
        let width = appearances.as_ref().map_or(0, |(_, [_, width])| *width);
        let (field, color) = match by_torch {
            true => (self.torch_field(&sizes)?, self.layers("field.mlp_head.layers")?),
            false => (self.tcnn_field(&sizes)?, self.tcnn_color(width)?),
        };
        let place = Place::Tensor(path("field.mlp_base"));
        let outputs = check(&field.layers, field.levels.width(), &place)?;
        let geometry = outputs.saturating_sub(1);
        if outputs < 2 {
            let found = format!("{outputs} outputs of the density network");
            return Err(Error::malformed(
                place,
                found,
                "one of density, and the features for colours",
            ));
        }
        let place = Place::Tensor(path("field.mlp_head"));
        let inputs = FUNCTIONS + geometry + width;
        if check(&color, inputs, &place)? < 3 {
            return Err(Error::malformed(place, "fewer than 3 outputs", "three colours"));
        }
        let mut proposals = Vec::new();
        for (number, own) in (0..self.proposals()).zip(&settings.proposals) {
            let proposal = self.proposal(number, *own)?;
            let place = Place::Tensor(path(&format!("proposal_networks.{number}")));
            check(&proposal.layers, proposal.levels.width(), &place)?;
            proposals.push(proposal);
        }
        let finest = sizes.finest;
        Ok(Arrays { corners, field, geometry, color, by_torch, appearances, proposals, finest })
    }

    /// The box of the scene.
    fn corners(self) -> Result<[[f64; 3]; 2]> {
        let name = path("field.aabb");
        let numbers = match self.find("field.aabb") {
            Some(value) => value.numbers(&name)?,
            None => Vec::new(),
        };
        match *numbers.as_slice() {
            [a, b, c, x, y, z]
                if numbers.iter().all(|at| at.is_finite()) && a < x && b < y && c < z =>
            {
                Ok([[a, b, c], [x, y, z]])
            }
            _ => {
                let found = format!("{numbers:?}");
                Err(Error::malformed(Place::Tensor(name), found, "the corners of a box"))
            }
        }
    }

    /// The sizes of the levels of a table.
    fn sizes(
        self,
        owner: &str,
        [base, features]: [u64; 2],
        stated: [Option<u64>; 3],
    ) -> Result<TableSizes> {
        let [levels, finest, log2_entries] = {
            let mut found = [0; 3];
            let names = ["num_levels", "max_res", "log2_hashmap_size"];
            for ((found, name), stated) in found.iter_mut().zip(names).zip(stated) {
                let name = format!("{owner}.{name}");
                let value =
                    self.find(&name).map(|value| value.integer(&path(&name))).transpose()?;
                let value = value.and_then(|value| u64::try_from(value).ok()).or(stated);
                *found = value.ok_or_else(|| {
                    let place = Place::Tensor(path(&name));
                    Error::malformed(place, "no such number", "an integer above 0")
                })?;
            }
            found
        };
        let sizes = Sizes { levels, features, log2_entries, base, more: 0 };
        sizes.check(&Place::Tensor(path(owner)))?;
        Ok(TableSizes { sizes, finest: finest.clamp(1, 1 << 20) })
    }

    /// A table of PyTorch's layout.
    fn torch_table(self, name: &str, sizes: &TableSizes) -> Result<(Levels, Values)> {
        let tensor = self.required(name)?;
        let &[rows, features] = tensor.shape() else {
            let found = format!("shape {:?}", tensor.shape());
            return Err(Error::malformed(tensor.place(), found, "[entries, features]"));
        };
        let sizes = TableSizes { sizes: Sizes { features, ..sizes.sizes }, ..*sizes };
        let levels = sizes.sizes.hashed_levels(sizes.finest, &tensor.place())?;
        if levels.entries() != rows {
            let found = format!("{rows} entries");
            let expected = format!("{} of {} levels", levels.entries(), sizes.sizes.levels);
            return Err(Error::malformed(tensor.place(), found, expected));
        }
        Ok((levels, Values::all(tensor)?))
    }

    fn torch_field(self, sizes: &TableSizes) -> Result<GridFile> {
        let (levels, table) = self.torch_table("field.mlp_base.model.0.hash_table", sizes)?;
        let layers = self.layers("field.mlp_base.model.1.layers")?;
        Ok(GridFile { levels, table, layers, filled_with_ones: false })
    }

    /// A network of proposals, of either layout.
    fn proposal(self, number: usize, own: [u64; 2]) -> Result<GridFile> {
        let owner = format!("proposal_networks.{number}");
        let sizes = self.sizes(&owner, own, [None; 3])?;
        let name = |name: &str| format!("{owner}.{name}");
        let by_torch = self.find(&name("encoding.hash_table")).is_some();
        let (levels, table) = match by_torch {
            true => self.torch_table(&name("encoding.hash_table"), &sizes)?,
            false => {
                let values = Values::all(self.required(&name("encoding.tcnn_encoding.params"))?)?;
                let features = sizes.sizes.features;
                let mut fits = sizes.candidates(&values.tensor.place())?.into_iter();
                let fit = fits.find(|levels| levels.entries() * features == values.count);
                (fit.ok_or_else(|| sizes.refuse(&values))?, values)
            }
        };
        if self.find(&name("linear.weight")).is_some() {
            let layers = vec![self.layer(&name("linear"))?];
            return Ok(GridFile { levels, table, layers, filled_with_ones: false });
        }
        let layers = match by_torch {
            true => self.layers(&name("mlp_base.1.layers"))?,
            false => {
                let values = Values::all(self.required(&name("mlp_base.1.tcnn_encoding.params"))?)?;
                let inputs = (levels.width() as u64).next_multiple_of(MULTIPLE);
                hidden(values.count, 1, inputs)
                    .map(|width| matrices(&values, &[inputs, width, MULTIPLE]))
                    .ok_or_else(|| refuse_widths(&values))?
            }
        };
        Ok(GridFile { levels, table, layers, filled_with_ones: !by_torch })
    }

    /// tiny-cuda-nn's network and table in one array.
    fn tcnn_field(self, sizes: &TableSizes) -> Result<GridFile> {
        let values = Values::all(self.required("field.mlp_base.model.params")?)?;
        let inputs = (sizes.sizes.levels * sizes.sizes.features).next_multiple_of(MULTIPLE);
        for levels in sizes.candidates(&values.tensor.place())? {
            let entries = levels.entries() * sizes.sizes.features;
            let Some(network) = values.count.checked_sub(entries) else { continue };
            let Some(width) = hidden(network, 1, inputs) else { continue };
            let layers = matrices(&values, &[inputs, width, GEOMETRY]);
            let table = values.part(network, entries);
            return Ok(GridFile { levels, table, layers, filled_with_ones: false });
        }
        Err(sizes.refuse(&values))
    }

    /// tiny-cuda-nn's network of colour.
    fn tcnn_color(self, appearance: usize) -> Result<Vec<LayerFile>> {
        let values = Values::all(self.required("field.mlp_head.tcnn_encoding.params")?)?;
        let inputs = FUNCTIONS as u64 + GEOMETRY - 1 + appearance as u64;
        let inputs = inputs.next_multiple_of(MULTIPLE);
        hidden(values.count, 2, inputs)
            .map(|width| matrices(&values, &[inputs, width, width, MULTIPLE]))
            .ok_or_else(|| refuse_widths(&values))
    }

    fn appearances(self) -> Result<Option<(Values, [usize; 2])>> {
        let name = "field.embedding_appearance.embedding.weight";
        let Some(tensor) = self.tensor(name) else { return Ok(None) };
        let &[pictures @ 1..=1_000_000, width @ 1..=WIDEST] = tensor.shape() else {
            let found = format!("shape {:?}", tensor.shape());
            return Err(Error::malformed(tensor.place(), found, "[pictures, width]"));
        };
        let shape = [pictures, width].map(|count| usize::try_from(count).unwrap_or(0));
        Ok(Some((Values::all(tensor)?, shape)))
    }

    fn required(self, name: &str) -> Result<&'a Tensor> {
        self.tensor(name).ok_or_else(|| {
            let expected = "an array of nerfstudio's nerfacto";
            Error::malformed(Place::Tensor(path(name)), "no such array", expected)
        })
    }

    /// Layers of PyTorch, first to last.
    fn layers(self, name: &str) -> Result<Vec<LayerFile>> {
        let names = (0..MOST_LAYERS).map(|number| format!("{name}.{number}"));
        let known = names.take_while(|name| self.find(&format!("{name}.weight")).is_some());
        known.map(|name| self.layer(&name)).collect()
    }

    fn layer(self, name: &str) -> Result<LayerFile> {
        let weights = self.required(&format!("{name}.weight"))?;
        let biases = self.required(&format!("{name}.bias"))?;
        match (weights.shape(), biases.shape()) {
            (&[outputs @ 1..=WIDEST, inputs @ 1..=WIDEST], &[count]) if count == outputs => {
                let [outputs, inputs] =
                    [outputs, inputs].map(|count| usize::try_from(count).unwrap_or(0));
                let (weights, biases) = (Values::all(weights)?, Some(Values::all(biases)?));
                Ok(LayerFile { weights, biases, outputs, inputs })
            }
            _ => {
                let found = format!("shapes {:?} and {:?}", weights.shape(), biases.shape());
                let expected = "[outputs, inputs], 1 to 1024, and as many biases";
                Err(Error::malformed(weights.place(), found, expected))
            }
        }
    }
}

fn refuse_widths(values: &Values) -> Error {
    let found = format!("{} parameters", values.count);
    Error::malformed(values.tensor.place(), found, "those of layers of 16 to 1024 neurons")
}

/// The neurons of this many hidden layers of a network with 16 outputs and `count` parameters.
fn hidden(count: u64, layers: u64, inputs: u64) -> Option<u64> {
    let mut widths = (1..=WIDEST / MULTIPLE).map(|number| number * MULTIPLE);
    widths.find(|width| width * (inputs + MULTIPLE + (layers - 1) * width) == count)
}

/// Matrices between layers of these widths.
fn matrices(values: &Values, widths: &[u64]) -> Vec<LayerFile> {
    let mut first = 0;
    let mut next = |inputs: u64, outputs: u64| {
        let weights = values.part(first, inputs * outputs);
        first += inputs * outputs;
        let [outputs, inputs] = [outputs, inputs].map(|width| usize::try_from(width).unwrap_or(0));
        LayerFile { weights, biases: None, outputs, inputs }
    };
    widths.iter().zip(widths.iter().skip(1)).map(|(from, to)| next(*from, *to)).collect()
}

/// Refuses inconsistent layers for this many inputs, padded or not. Returns the outputs.
fn check(layers: &[LayerFile], inputs: usize, place: &Place) -> Result<usize> {
    let mut width = inputs;
    for layer in layers {
        let filled = match layer.biases {
            Some(_) => width,
            None => width.next_multiple_of(16),
        };
        if filled != layer.inputs {
            let found = format!("a layer [{}, {}]", layer.outputs, layer.inputs);
            return Err(Error::malformed(place.clone(), found, format!("one of {filled} inputs")));
        }
        width = layer.outputs;
    }
    match layers {
        [] => Err(Error::malformed(place.clone(), "no layers", "one or more")),
        _ => Ok(width),
    }
}
