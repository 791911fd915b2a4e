//! Converts sums along rays to colours over the background.

use super::march::Gathered;
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::RAYS;
use crate::view::sample::View;

/// View-dependent colours of rays with these unit directions.
pub fn view_colors<const C: usize>(
    view: &View,
    gathered: &[Gathered<C>],
    directions: &[[f64; 3]],
) -> Vec<[f32; 3]> {
    let network = view.view_dependence.as_ref().and_then(ViewDependence::network);
    let Some(network) = network else { return vec![[0.0; 3]; gathered.len()] };
    let channels = 3 + view.features;
    let mut colors = Vec::with_capacity(gathered.len());
    for (rays, directions) in gathered.chunks(RAYS).zip(directions.chunks(RAYS)) {
        let accumulated: Vec<&[f32]> = rays.iter().map(|ray| &ray.color[..channels]).collect();
        colors.extend_from_slice(&network.colors(directions, &accumulated)[..rays.len()]);
    }
    colors
}

impl<const C: usize> Gathered<C> {
    /// The ray's colour over the background, not clamped.
    pub fn over_background(&self, view: &View, view_color: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|channel| {
            let behind = self.transmittance * view.background[channel];
            self.color[channel] + view_color[channel] + behind
        })
    }

    /// The expected distance in world units. Light that passes through the field has the distance
    /// `far`, if set.
    pub fn expected_distance(&self, view: &View) -> f32 {
        self.distance + self.transmittance * view.march.far.unwrap_or(0.0)
    }
}
