//! A field of two networks: one behind a table of features, and one from its outputs and a
//! direction.

use super::grid::gathered;
use super::network::{Directions, HashNetwork, Places, Scratch, ViewNetwork};
use super::perceptron::Number;
use super::real::{LANES, Lanes, Real};
use crate::network::Colors;

/// A model whose density is an exponential of the first output, and whose colours are sigmoids.
#[derive(Debug)]
pub struct HashField {
    /// The density network, whose other outputs are inputs of the colour network.
    pub shape: HashNetwork,
    /// The colour network.
    pub color: ViewNetwork,
    /// Outputs of the density network that the colour network does not take.
    pub skipped: usize,
}

/// Memory of a field at work.
#[derive(Debug)]
pub struct FieldScratch<T> {
    shape: Scratch<T>,
    color: Scratch<T>,
}

impl<T> Default for FieldScratch<T> {
    fn default() -> Self {
        Self { shape: Scratch::default(), color: Scratch::default() }
    }
}

/// The evaluated positions, packet by packet.
#[derive(Debug, Default)]
pub struct Found {
    packets: Vec<Places<f32>>,
    scratch: FieldScratch<f32>,
}

impl Found {
    /// Evaluates new positions, up to [`LANES`] at a time.
    pub fn fill(
        &mut self,
        positions: &[[f64; 3]],
        mut find: impl FnMut(&[[f64; 3]], &mut FieldScratch<f32>, &mut Places<f32>),
    ) {
        self.packets.resize_with(positions.len().div_ceil(LANES), Places::default);
        for (packet, positions) in self.packets.iter_mut().zip(positions.chunks(LANES)) {
            find(positions, &mut self.scratch, packet);
        }
    }
}

impl HashField {
    /// Adds the exponential of the first output at each position of the table's cube.
    pub fn densities<T: Number>(
        &self,
        positions: &[[f64; 3]],
        scratch: &mut FieldScratch<T>,
        densities: &mut Vec<f64>,
    ) {
        for packet in positions.chunks(LANES) {
            let outputs = self.shape.run(&gathered(packet), &mut scratch.shape);
            let raw = outputs.first().copied().unwrap_or_default();
            densities.extend(raw.iter().take(packet.len()).map(|raw| raw.exponential()));
        }
    }

    /// Evaluates up to [`LANES`] positions of the table's cube. Returns their densities.
    pub fn places<T: Number>(
        &self,
        positions: &[[f64; 3]],
        scratch: &mut FieldScratch<T>,
        places: &mut Places<T>,
    ) -> Lanes<f64> {
        let outputs = self.shape.run(&gathered(positions), &mut scratch.shape);
        self.color.places(outputs.get(self.skipped..).unwrap_or_default(), places);
        outputs.first().copied().unwrap_or_default().map(Real::exponential)
    }

    /// The colours at a place along directions.
    pub fn colors_along<T: Number>(
        &self,
        directions: &Directions<T>,
        places: &Places<T>,
        place: usize,
        scratch: &mut FieldScratch<T>,
        colors: &mut Colors,
    ) {
        colors.iter_mut().for_each(Vec::clear);
        self.color.along(directions, places, place, &mut scratch.color, |outputs, count| {
            for (colors, output) in colors.iter_mut().zip(outputs) {
                colors.extend(output.iter().take(count).map(|value| value.sigmoid()));
            }
        });
    }

    /// The colours at one of many positions along directions.
    pub fn colors_of_found(
        &self,
        directions: &Directions<f32>,
        Found { packets, scratch }: &mut Found,
        number: usize,
        colors: &mut Colors,
    ) {
        if let Some(places) = packets.get(number / LANES) {
            self.colors_along(directions, places, number % LANES, scratch, colors);
        }
    }

    /// The colours at all places of a packet along the first of the directions.
    pub fn colors_at<T: Number>(
        &self,
        directions: &Directions<T>,
        places: &Places<T>,
        scratch: &mut FieldScratch<T>,
    ) -> Lanes<[f64; 3]> {
        let mut colors = [[0.0; 3]; LANES];
        let outputs = self.color.at_places(directions, places, &mut scratch.color);
        for (channel, output) in outputs.iter().take(3).enumerate() {
            for (color, value) in colors.iter_mut().zip(output) {
                if let Some(out) = color.get_mut(channel) {
                    *out = value.sigmoid();
                }
            }
        }
        colors
    }
}
