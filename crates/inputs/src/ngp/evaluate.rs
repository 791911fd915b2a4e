//! A model in memory, evaluated at positions of its cube.

use super::frame::Frame;
use super::layout::Layout;
use super::perceptron::{LANES, Lanes, Perceptron};
use crate::model::activate;
use crate::model::harmonics::{FUNCTIONS, basis_f64};

/// Densities beyond this are opaque at any length.
const DENSEST: f64 = 1e30;

/// A table and its networks.
#[derive(Debug)]
pub(super) struct Ngp {
    pub(super) layout: Layout,
    pub(super) table: Vec<f32>,
    pub(super) density: Perceptron,
    /// From all outputs of the other, then harmonics of the direction.
    pub(super) color: Perceptron,
    /// The table spans a cube of so many unit cubes along an edge, around the same middle.
    pub(super) reach: f64,
    /// Density along an edge of the unit cube, for one along the model's own unit.
    pub(super) per_edge: f64,
}

impl Ngp {
    /// Outputs of the density network at up to [`LANES`] positions of the unit cube.
    pub(super) fn geometry(&self, positions: &[[f64; 3]]) -> Vec<Lanes> {
        let mut inputs = vec![[0.0; LANES]; self.layout.width()];
        for (lane, position) in positions.iter().enumerate() {
            let position = position.map(|at| (at - 0.5) / self.reach + 0.5);
            self.layout.encode(&self.table, position, |input, value| {
                let place = inputs.get_mut(input).and_then(|lanes| lanes.get_mut(lane));
                if let Some(place) = place {
                    *place = value;
                }
            });
        }
        self.density.run(&inputs)
    }

    /// Optical depth of an edge of the unit cube, lane by lane.
    pub(super) fn densities(&self, geometry: &[Lanes]) -> [f64; LANES] {
        let raw = geometry.first().copied().unwrap_or([f32::NEG_INFINITY; LANES]);
        raw.map(|raw| (self.per_edge * libm::exp(raw.into())).min(DENSEST))
    }

    /// Colours, lane by lane, of a geometry seen along directions.
    pub(super) fn colors(
        &self,
        geometry: &[Lanes],
        seen: &[Lanes; FUNCTIONS],
    ) -> [[f64; 3]; LANES] {
        let inputs: Vec<Lanes> = geometry.iter().chain(seen).copied().collect();
        let mut colors = [[0.0; 3]; LANES];
        for (channel, lanes) in self.color.run(&inputs).iter().take(3).enumerate() {
            for (color, value) in colors.iter_mut().zip(lanes) {
                if let Some(color) = color.get_mut(channel) {
                    *color = activate::sigmoid((*value).into());
                }
            }
        }
        colors
    }

    /// The colours of one position's geometry along directions of the world.
    pub(super) fn colors_along(
        &self,
        geometry: &[Lanes],
        lane: usize,
        directions: &[[Lanes; FUNCTIONS]],
    ) -> Vec<[f64; 3]> {
        let one = |lanes: &Lanes| [lanes.get(lane).copied().unwrap_or(0.0); LANES];
        let geometry: Vec<Lanes> = geometry.iter().map(one).collect();
        directions.iter().flat_map(|seen| self.colors(&geometry, seen)).collect()
    }
}

/// Harmonics of directions of the world, as the network takes them, [`LANES`] at a time.
pub(super) fn harmonics(directions: &[[f64; 3]]) -> Vec<[Lanes; FUNCTIONS]> {
    let packets = directions.chunks(LANES).map(|packet| {
        let mut seen = [[0.0; LANES]; FUNCTIONS];
        for (lane, &direction) in packet.iter().enumerate() {
            let basis = basis_f64(Frame::turned(direction));
            for (lanes, value) in seen.iter_mut().zip(basis) {
                if let Some(place) = lanes.get_mut(lane) {
                    #[expect(clippy::cast_possible_truncation, reason = "networks are float32")]
                    let value = value as f32;
                    *place = value;
                }
            }
        }
        seen
    });
    packets.collect()
}
