//! Channels of a grid from products of factors.

use super::parts::{Terms, components};
use super::product::{Factors, Tap};
use crate::base::error::{Error, Result};
use crate::base::limits::Budget;
use crate::model::grid::Nodes;
use crate::tensor::Tensor;

/// Channels of a grid of factors, at most.
const CHANNELS: u64 = 256;

/// The unread arrays of a grid of factors.
#[derive(Debug, Clone)]
pub struct FactorArrays {
    /// Factors, as [`components`] takes them.
    terms: Terms,
    /// Nodes of the grid.
    pub nodes: Nodes,
    mix: Option<Mix>,
    /// Channels of the grid.
    pub channels: usize,
}

/// A matrix from products to channels.
#[derive(Debug, Clone)]
pub struct Mix {
    /// Its weights.
    pub tensor: Tensor,
    /// True for `[components, channels]`, false for `[channels, components]`.
    pub by_component: bool,
}

/// A grid of factors in memory.
#[derive(Debug)]
pub struct Mixed {
    factors: Factors,
    /// For each component the weights of all channels; none for the plain sum of products.
    weights: Option<Vec<f32>>,
    channels: usize,
}

/// Memory for sums of products.
#[derive(Debug, Default)]
pub struct Scratch {
    sums: Vec<f64>,
    products: Vec<f64>,
}

impl FactorArrays {
    /// A grid with one channel, the sum of all products, or with channels from a matrix.
    ///
    /// # Errors
    /// `Malformed` if shapes do not fit.
    pub fn new(terms: Terms, nodes: Nodes, mix: Option<Mix>) -> Result<Self> {
        let components = components(&terms, nodes.0)? as u64;
        let Some(Mix { tensor, by_component }) = &mix else {
            return Ok(Self { terms, nodes, mix, channels: 1 });
        };
        let (channels, width) = match (tensor.shape(), by_component) {
            (&[channels, width], false) | (&[width, channels], true) => (channels, width),
            _ => (0, 0),
        };
        if width != components || !(1..=CHANNELS).contains(&channels) {
            let found = format!("shape {:?}", tensor.shape());
            let expected = match by_component {
                true => format!("[{components}, 1 to {CHANNELS} channels]"),
                false => format!("[1 to {CHANNELS} channels, {components}]"),
            };
            return Err(Error::malformed(tensor.place(), found, expected));
        }
        let channels = usize::try_from(channels).unwrap_or(0);
        Ok(Self { terms, nodes, mix, channels })
    }

    /// Bytes of the factors in the file.
    pub fn bytes(&self) -> u64 {
        self.tensors().map(Tensor::bytes).sum()
    }

    /// All arrays that determine values.
    pub(super) fn tensors(&self) -> impl Iterator<Item = &Tensor> {
        let factors = self.terms.iter().flatten().map(|part| &part.tensor);
        factors.chain(self.mix.as_ref().map(|mix| &mix.tensor))
    }

    /// Reads all of it.
    ///
    /// # Errors
    /// Errors of reading, and NaN values.
    pub fn load(&self, budget: &mut Budget) -> Result<Mixed> {
        let weights = self.mix.as_ref().map(|mix| self.weights(mix, budget)).transpose()?;
        let factors = Factors::load(&self.terms, self.nodes.0, budget)?;
        Ok(Mixed { factors, weights, channels: self.channels })
    }

    /// The matrix with the weights of a component side by side.
    fn weights(&self, mix: &Mix, budget: &mut Budget) -> Result<Vec<f32>> {
        let (tensor, channels) = (&mix.tensor, self.channels);
        let stored = tensor.read_f32(budget)?;
        if stored.iter().any(|value| !value.is_finite()) {
            return Err(Error::malformed(tensor.place(), "no number", "finite numbers"));
        }
        let components = stored.len() / channels;
        if mix.by_component {
            return Ok(stored);
        }
        let columns =
            (0..components).flat_map(|component| stored.iter().skip(component).step_by(components));
        Ok(columns.copied().collect())
    }
}

impl Mixed {
    /// All channels at a position.
    pub fn values(&self, at: &[Tap; 3], scratch: &mut Scratch) -> Vec<f64> {
        self.factors.products(at, &mut scratch.sums, &mut scratch.products);
        let Some(weights) = &self.weights else {
            return vec![scratch.products.iter().sum()];
        };
        // Channels side by side, so that their sums do not depend on one another.
        let mut values = vec![0.0; self.channels];
        for (row, product) in weights.chunks_exact(self.channels).zip(&scratch.products) {
            let terms = values.iter_mut().zip(row);
            terms.for_each(|(value, weight)| *value += f64::from(*weight) * product);
        }
        values
    }

    /// The sum of all products at a position.
    pub fn sum(&self, at: &[Tap; 3], scratch: &mut Scratch) -> f64 {
        self.factors.products(at, &mut scratch.sums, &mut scratch.products);
        scratch.products.iter().sum()
    }
}
