//! The `VMLP` chunk: per layer, the weights `[out, in]`, then the biases, as f32.

use crate::base::bytes::ByteReader;
use crate::base::error::{Error, Place, Result};
use crate::base::limits;
use crate::model::baked::{Metadata, NetworkMetadata};
use crate::model::view_mlp::{Layer, ViewMlp};

/// Writes the chunk.
pub fn to_bytes(network: &ViewMlp) -> Vec<u8> {
    let values = network.layers.iter().flat_map(|layer| layer.weights.iter().chain(&layer.bias));
    values.flat_map(|value| value.to_le_bytes()).collect()
}

/// Reads the network that the metadata describes.
pub fn read(
    view: &NetworkMetadata,
    metadata: &Metadata,
    reader: &mut ByteReader,
    place: &Place,
) -> Result<ViewMlp> {
    let mut layers = Vec::new();
    for pair in view.widths.windows(2) {
        let &[inputs, outputs] = pair else { continue };
        let count = limits::product(&[inputs as u64, outputs as u64], "weight count", place)?;
        layers.push(Layer {
            inputs,
            outputs,
            weights: floats(reader, count)?,
            bias: floats(reader, outputs)?,
        });
    }
    if reader.left() > 0 {
        let found = format!("{} bytes after the last layer", reader.left());
        return Err(Error::malformed(reader.place(), found, "the end of the chunk"));
    }
    let network = ViewMlp::new(layers, view.frequencies, metadata.features, place)?;
    if network.input != view.input {
        let found = format!("input {:?}", view.input);
        return Err(Error::malformed(place.clone(), found, format!("{:?}", network.input)));
    }
    Ok(network)
}

fn floats(reader: &mut ByteReader, count: usize) -> Result<Vec<f32>> {
    let place = reader.place();
    let bytes = reader.take(count.saturating_mul(4))?;
    let values: Vec<f32> =
        bytes.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
    if values.iter().any(|value| !value.is_finite()) {
        return Err(Error::malformed(place, "a weight that is not finite", "finite weights"));
    }
    Ok(values)
}
