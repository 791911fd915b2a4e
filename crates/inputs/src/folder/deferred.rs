//! A network that runs once per ray, on the ray's accumulated values over the background.

use super::network::narrow;
use crate::base::error::{Error, Result};
use crate::model::view_mlp::ViewMlp;
use crate::options::{MlpChoice, SourceOptions, ViewChoice};
use crate::source::Assumption;

/// Refuses options that conflict with a folder's own network.
///
/// # Errors
/// `Usage` for harmonics, and for another network.
pub fn refuse_other_views(system: &str, options: &SourceOptions) -> Result<()> {
    if let (ViewChoice::Harmonics(_), _) | (_, MlpChoice::File(_)) = (options.view, &options.mlp) {
        return Err(Error::usage(format!(
            "a {system} folder has its own network, which runs once per ray: --view takes keep or none, --mlp \
             auto or none"
        )));
    }
    Ok(())
}

/// True if the network is dropped.
pub fn drops_network(options: &SourceOptions) -> bool {
    options.view == ViewChoice::None || options.mlp == MlpChoice::None
}

/// A property of such a network that a container cannot represent.
pub fn assumption(system: &str) -> Assumption {
    Assumption {
        key: "background",
        value: "before the network".to_owned(),
        message: format!(
            "{system}'s viewer adds the background before the network runs; a container adds it \
             after it: half-transparent pixels differ, and so do empty ones if the viewer's network \
             brightens them; a background other than white may become brighter; compare measures \
             the difference"
        ),
    }
}

/// The light that a network computes from a colour and features; none without a network.
pub fn added_light(
    network: Option<&ViewMlp>,
    direction: [f64; 3],
    color: [f64; 3],
    features: &[f64],
) -> [f64; 3] {
    let Some(network) = network else { return [0.0; 3] };
    let inputs: Vec<f32> = color.iter().chain(features).copied().map(narrow).collect();
    let [seen, ..] = network.colors(&[direction], &[&inputs]);
    seen.map(f64::from)
}
