//! The network of a checkpoint, and the harmonics that are fitted to it.

use crate::base::error::Result;
use crate::checkpoint::{self, NamedValues};
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::network::{Inputs, NetworkFile};
use crate::options::ViewChoice;
use crate::tensor::Tensor;

/// Octaves of a direction, at most.
pub(super) const OCTAVES: u64 = 16;
/// Added to the sum of harmonics.
const OFFSET: f32 = 0.5;
/// Default degree of a fit.
const DEGREE: usize = 2;

/// The network of a checkpoint, which takes this many features of each sample.
///
/// # Errors
/// Those of [`NetworkFile::new`].
pub(super) fn network(names: &NamedValues<'_>, features: usize) -> Result<NetworkFile> {
    let octaves = names.tensor("viewfreq").map_or(0, Tensor::count);
    let direction = u32::try_from(octaves).unwrap_or(0);
    let inputs = Inputs { features: 0, position: 0, direction };
    let layers = checkpoint::layer_tensors(names)?;
    let layers = layers.into_iter().map(|layer| layer.map(Tensor::clone)).collect();
    match is_residual(names) {
        true => Ok(NetworkFile::new(layers, inputs, features.saturating_sub(3))?.residual()),
        false => NetworkFile::new(layers, inputs, features),
    }
}

/// True for a network that adds to the first three features, which are logits of colours:
/// `rgbnet_direct` is false. Contracted scenes have none.
pub(super) fn is_residual(names: &NamedValues<'_>) -> bool {
    names.setting("rgbnet_direct").is_some() && !names.flag("rgbnet_direct").unwrap_or(true)
}

/// The harmonics that are fitted to a network.
pub(super) fn harmonics(view: ViewChoice) -> Harmonics {
    let degree = match view {
        ViewChoice::Harmonics(wanted) => wanted.min(Harmonics::MAX_DEGREE),
        _ => DEGREE,
    };
    let (evaluation, clamp) = (Evaluation::Ray, Clamp::Zero);
    Harmonics { degree, evaluation, offset: OFFSET, clamp }
}
