//! Colours and mixtures of the reference renderer, in float64.

use mipvog::model::harmonics::Clamp;
use mipvog::model::view_mlp::{ViewInput, ViewMlp};

use super::plain::sigmoid;

/// A colour within what a rule allows.
pub fn limit(clamp: Clamp, value: f64) -> f64 {
    match clamp {
        Clamp::Zero => value.max(0.0),
        Clamp::None => value,
        Clamp::Sigmoid => sigmoid(value),
    }
}

/// View-dependent colour of a ray's accumulated values.
pub fn specular(network: &ViewMlp, unit: [f64; 3], accumulated: &[f64]) -> [f64; 3] {
    let angles = || {
        let octaves = 0..network.frequencies as i32;
        unit.iter().flat_map(move |along| octaves.clone().map(move |k| along * 2f64.powi(k)))
    };
    let mut values = unit.to_vec();
    values.extend(angles().map(f64::sin));
    values.extend(angles().map(f64::cos));
    values.extend(match network.input {
        ViewInput::DiffuseAndFeatures => accumulated,
        ViewInput::Features => &accumulated[3..],
    });
    for (number, layer) in network.layers.iter().enumerate() {
        let rows = layer.weights.chunks_exact(layer.inputs).zip(&layer.bias);
        let sums = rows.map(|(weights, bias)| {
            let products = weights.iter().zip(&values).map(|(w, value)| f64::from(*w) * value);
            f64::from(*bias) + products.sum::<f64>()
        });
        values = match number + 1 == network.layers.len() {
            true => sums.map(sigmoid).collect(),
            false => sums.map(|sum| sum.max(0.0)).collect(),
        };
    }
    [values[0], values[1], values[2]]
}

/// Values of two levels, mixed.
pub fn blended(lambda: f64, mut value: impl FnMut(usize) -> f64) -> f64 {
    let (level, share) = (lambda as usize, lambda.fract());
    match share > 0.0 {
        true => (1.0 - share) * value(level) + share * value(level + 1),
        false => value(level),
    }
}

/// True if float32 may put a value on the other side of a threshold; nothing is below 0.
pub fn is_close(value: f64, threshold: f64) -> bool {
    threshold > 0.0 && (value - threshold).abs() <= 1e-4 * threshold
}

pub fn length([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}
