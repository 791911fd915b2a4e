//! A scene whose colours are harmonics and whose densities may be negative: two glossy bodies in
//! empty space.

use mipvog::model::field::{DensityFunction, RadianceField};
use mipvog::model::harmonics::{Clamp, Evaluation, Harmonics};

use super::plain::all_nodes;

/// The rules of Plenoxels.
pub fn rules(degree: usize) -> Harmonics {
    Harmonics { degree, evaluation: Evaluation::Ray, offset: 0.5, clamp: Clamp::Zero }
}

/// A field of so many nodes along each axis. Far from the bodies densities are 0 and so are the
/// coefficients; next to them densities are negative. Colours stay above 0 in all directions.
pub fn harmonic_field(nodes: [usize; 3], harmonics: Harmonics) -> RadianceField {
    let functions = harmonics.functions();
    let count: usize = nodes.iter().product();
    let (mut density, mut color) = (vec![0.0; count], vec![0.0; 3 * functions * count]);
    for (number, at) in all_nodes(nodes).enumerate() {
        let [x, y, z] = [0, 1, 2].map(|a| 2.0 * at[a] as f32 / (nodes[a] - 1) as f32 - 1.0);
        let ball = 0.55 - ((x + 0.3).powi(2) + y * y + z * z).sqrt();
        let plate = 0.12 - (z + 0.5).abs().max((x.abs().max(y.abs()) - 0.6) * 0.5);
        let inside = ball.max(plate);
        if inside < -0.15 {
            continue;
        }
        density[number] = (60.0 * inside).clamp(-4.0, 30.0);
        for channel in 0..3 {
            let phase = channel as f32 * 2.1;
            color[channel * count + number] =
                0.5 * libm::sinf(3.0 * x + phase) * libm::cosf(4.0 * y);
            for function in 1..functions {
                let wave = libm::sinf(2.0 * x + 3.0 * z + function as f32 + phase);
                let band = (function as f32).sqrt().floor();
                color[(3 * function + channel) * count + number] = 0.08 / band * wave;
            }
        }
    }
    let higher = color.split_off(3 * count);
    let field = RadianceField::builder(nodes, density, color)
        .density_function(DensityFunction::Relu)
        .harmonics(higher, harmonics)
        .bounds([-1.0; 3], [1.0; 3]);
    field.build().expect("a field")
}
