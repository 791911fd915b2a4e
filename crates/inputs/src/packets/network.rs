//! A table of features with the network behind it, and a network of directions.

use super::encode::Coordinates;
use super::grid::HashGrid;
use super::perceptron::{Both, Layer, Number};
use super::real::{LANES, Lanes};

/// Memory of a packet at work.
#[derive(Debug)]
pub struct Scratch<T> {
    features: Vec<Lanes<T>>,
    sums: Vec<Lanes<T>>,
    next: Vec<Lanes<T>>,
}

impl<T> Default for Scratch<T> {
    fn default() -> Self {
        Self { features: Vec::new(), sums: Vec::new(), next: Vec::new() }
    }
}

/// A table with the network that takes its features.
#[derive(Debug)]
pub struct HashNetwork {
    grid: HashGrid,
    network: Both,
}

impl HashNetwork {
    /// Of a table, and of layers that take all its features.
    pub fn new(grid: HashGrid, layers: &[Layer]) -> Self {
        Self { grid, network: Both::new(layers) }
    }

    /// Outputs at the positions of a packet.
    pub fn run<'a, T: Number>(
        &self,
        at: &Coordinates,
        scratch: &'a mut Scratch<T>,
    ) -> &'a [Lanes<T>] {
        let (network, Scratch { features, sums, next }) = (self.network.of::<T>(), scratch);
        self.grid.encode(at, features);
        network.begin(sums);
        network.add(0, features, sums);
        network.finish(sums, next);
        sums
    }
}

/// A network of place inputs and direction inputs, in either order.
///
/// The first layer's sums are split into a place part and a direction part, each of which is
/// computed once and reused.
#[derive(Debug)]
pub struct ViewNetwork {
    network: Both,
    /// Offsets of the place inputs and of the direction inputs.
    firsts: [usize; 2],
}

/// Directions as network inputs.
#[derive(Debug, Clone)]
pub struct Directions<T> {
    count: usize,
    /// Sums of the first layer with its biases, [`LANES`] directions after the other.
    packets: Vec<Vec<Lanes<T>>>,
}

/// The place inputs of a packet, for a network of directions.
#[derive(Debug, Clone, Default)]
pub struct Places<T> {
    /// Sums of the first layer.
    sums: Vec<Lanes<T>>,
}

impl ViewNetwork {
    /// From layers of which the first takes place inputs and direction inputs from the given
    /// columns on.
    pub fn new(layers: &[Layer], firsts: [usize; 2]) -> Self {
        Self { network: Both::new(layers), firsts }
    }

    /// Prepares directions: inputs of each, as long as the network takes.
    pub fn directions<T: Number, const N: usize>(&self, inputs: &[[f64; N]]) -> Directions<T> {
        let network = self.network.of::<T>();
        let [_, first] = self.firsts;
        let packets = inputs.chunks(LANES).map(|packet| {
            let mut lanes = [[T::default(); LANES]; N];
            for (lane, inputs) in packet.iter().enumerate() {
                for (lanes, value) in lanes.iter_mut().zip(inputs) {
                    if let Some(out) = lanes.get_mut(lane) {
                        *out = T::of(*value);
                    }
                }
            }
            let mut sums = Vec::new();
            network.begin(&mut sums);
            network.add(first, &lanes, &mut sums);
            sums
        });
        Directions { count: inputs.len(), packets: packets.collect() }
    }

    /// Prepares places: their inputs.
    pub fn places<T: Number>(&self, inputs: &[Lanes<T>], places: &mut Places<T>) {
        let network = self.network.of::<T>();
        let [first, _] = self.firsts;
        network.begin(&mut places.sums);
        places.sums.fill([T::default(); LANES]);
        network.add(first, inputs, &mut places.sums);
    }

    /// Outputs at a place along all directions, packet by packet. `found` gets the number of used
    /// lanes.
    pub fn along<T: Number>(
        &self,
        directions: &Directions<T>,
        places: &Places<T>,
        place: usize,
        scratch: &mut Scratch<T>,
        mut found: impl FnMut(&[Lanes<T>], usize),
    ) {
        let network = self.network.of::<T>();
        let mut left = directions.count;
        for packet in &directions.packets {
            let Scratch { sums, next, .. } = scratch;
            sums.clone_from(packet);
            for (sums, own) in sums.iter_mut().zip(&places.sums) {
                let own = own.get(place).copied().unwrap_or_default();
                sums.iter_mut().for_each(|sum| *sum += own);
            }
            network.finish(sums, next);
            found(sums, left.min(LANES));
            left = left.saturating_sub(LANES);
        }
    }

    /// Outputs at all places of a packet, along the first of the directions.
    pub fn at_places<'a, T: Number>(
        &self,
        directions: &Directions<T>,
        places: &Places<T>,
        scratch: &'a mut Scratch<T>,
    ) -> &'a [Lanes<T>] {
        let Scratch { sums, next, .. } = scratch;
        sums.clone_from(&places.sums);
        let packet = directions.packets.first().map(Vec::as_slice).unwrap_or_default();
        for (sums, [own, ..]) in sums.iter_mut().zip(packet) {
            sums.iter_mut().for_each(|sum| *sum += *own);
        }
        self.network.of::<T>().finish(sums, next);
        sums
    }
}
