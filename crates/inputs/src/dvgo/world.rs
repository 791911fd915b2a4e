//! An unbounded scene at positions of the world.

use std::sync::Arc;

use super::contraction::{Contraction, Spot};
use super::values::Values;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::checkpoint::StoredGrid;
use crate::lazy::Lazy;
use crate::model::activate;
use crate::model::field::{FreeSpace, Scene};
use crate::model::grid::Nodes;
use crate::nested::{ColoredWorld, World};
use crate::network::{Batch, BatchNetwork, Colors, Network, NetworkFile, Scratch};

/// Distance at which rays pass the middle of the inner box, in half sides. Boxes of a reference
/// scene come closest to its own pictures with this value: 32.5 dB, against 27.5 for steps along
/// the position, 23.0 for the geometric mean of all directions and 20.1 for steps across. The limit
/// for any constant medium is 32.8 dB, because the scene's renderer takes few samples beyond the
/// inner box.
const OFF_AXIS: f64 = 0.3;

/// A checkpoint of an unbounded scene, ready to be loaded.
#[derive(Debug)]
pub(super) struct WorldFile {
    pub(super) contraction: Contraction,
    pub(super) density: StoredGrid,
    pub(super) features: StoredGrid,
    /// Without a network, the first three features are logits of colours.
    pub(super) network: Option<NetworkFile>,
    /// In contracted space.
    pub(super) mask: Option<FreeSpace>,
    /// Activation and steps.
    pub(super) scene: Scene,
    pub(super) limits: Limits,
    pub(super) loaded: Lazy<Whole>,
}

/// A scene in memory.
#[derive(Debug)]
pub(super) struct Whole {
    density: Values,
    features: Values,
    network: Option<(Network, BatchNetwork)>,
}

/// Directions, prepared for the colours.
#[derive(Debug)]
pub(super) enum Along {
    Network(Batch),
    /// Colours do not depend on them.
    Count(usize),
}

impl WorldFile {
    /// Nodes of contracted space.
    fn nodes(&self) -> Nodes {
        self.density.nodes()
    }

    /// Contracted lengths between nodes.
    pub(super) fn spacing(&self) -> [f64; 3] {
        self.nodes().0.map(|count| 2.0 * self.contraction.reach() / (count - 1) as f64)
    }

    /// A position of contracted space, in nodes.
    fn in_nodes(&self, contracted: [f64; 3]) -> [f64; 3] {
        let mut at = contracted;
        let axes = at.iter_mut().zip(self.spacing());
        axes.for_each(|(at, spacing)| *at = (*at + self.contraction.reach()) / spacing);
        at
    }

    /// True if the scene takes samples at a position of contracted space.
    pub(super) fn is_free(&self, contracted: [f64; 3]) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask.contains(contracted))
    }

    /// Softplus of the raw density at a position of contracted space, for each base voxel's length.
    pub(super) fn density_at(&self, whole: &Whole, contracted: [f64; 3]) -> f64 {
        let raw = whole.density.at(self.nodes().0, self.in_nodes(contracted));
        self.scene.activation.density(raw.into_iter().sum())
    }

    /// The colour at a position of contracted space along a unit direction.
    pub(super) fn color_at(
        &self,
        whole: &Whole,
        contracted: [f64; 3],
        direction: [f64; 3],
    ) -> [f64; 3] {
        let features = whole.features.at(self.nodes().0, self.in_nodes(contracted));
        match &whole.network {
            Some((network, _)) => network.color(&features, [0.0; 3], direction),
            None => plain(&features),
        }
    }

    /// Converts optical depth per base voxel length to world units. The contracted length of a step
    /// depends on its direction: this uses rays that pass the middle at a distance of [`OFF_AXIS`].
    fn per_world_unit(&self, place: Spot) -> f64 {
        let [along, across] = self.contraction.stretches(place);
        let own = f64::from(self.scene.activation.interval) / self.scene.march.interval_length();
        let stretch = match place.norm <= 1.0 {
            true => along,
            false => libm::hypot(along, across * OFF_AXIS / place.norm),
        };
        own * stretch * self.contraction.radius()
    }
}

/// The colour of features without a network.
fn plain(features: &[f64]) -> [f64; 3] {
    let mut color = [0.0; 3];
    color.iter_mut().zip(features).for_each(|(out, value)| *out = activate::sigmoid(*value));
    color
}

impl World for WorldFile {
    type Loaded = Whole;

    fn load(&self) -> Result<Arc<Whole>> {
        self.loaded.get(|| {
            let mut budget = Budget::new(&self.limits);
            let network = self.network.as_ref().map(|file| file.load(&mut budget)).transpose()?;
            Ok(Whole {
                density: Values::load(&self.density, &mut budget)?,
                features: Values::load(&self.features, &mut budget)?,
                network: network.map(|network| {
                    let batches = BatchNetwork::new(&network);
                    (network, batches)
                }),
            })
        })
    }

    fn memory_bytes(&self) -> u64 {
        let grids = [&self.density, &self.features];
        grids.map(|grid| grid.clone().into_grid().memory_bytes()).into_iter().sum()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        for grid in [&self.density, &self.features] {
            let grid = grid.clone().into_grid();
            // The checksums of an archive, if any, cover all values.
            let Nodes([nx, ny, nz]) = grid.nodes();
            grid.read_plane(0, nx / 2, &mut vec![0.0; ny * nz], &mut *hash)?;
        }
        Ok(())
    }

    fn detail(&self, position: [f64; 3]) -> f64 {
        let [_, across] = self.contraction.stretches(self.contraction.place(position));
        self.spacing().into_iter().fold(f64::INFINITY, f64::min) / across
    }

    fn densities(
        &self,
        whole: &Whole,
        positions: &[[f64; 3]],
        masked: bool,
        densities: &mut Vec<f64>,
    ) {
        densities.extend(positions.iter().map(|position| {
            let place = self.contraction.place(*position);
            let contracted = self.contraction.contracted(place);
            if masked && !self.is_free(contracted) {
                return 0.0;
            }
            self.density_at(whole, contracted) * self.per_world_unit(place)
        }));
    }
}

impl ColoredWorld for WorldFile {
    type Along = Along;
    /// Features.
    type Places = Vec<Vec<f64>>;

    fn along(&self, whole: &Whole, directions: &[[f64; 3]]) -> Along {
        match &whole.network {
            Some((network, batches)) => Along::Network(batches.batch(network, directions)),
            None => Along::Count(directions.len()),
        }
    }

    fn places(
        &self,
        whole: &Whole,
        positions: &[[f64; 3]],
        places: &mut Vec<Vec<f64>>,
        densities: &mut Vec<f64>,
    ) {
        self.densities(whole, positions, true, densities);
        places.clear();
        places.extend(positions.iter().map(|position| {
            let contracted = self.contraction.contracted(self.contraction.place(*position));
            whole.features.at(self.nodes().0, self.in_nodes(contracted))
        }));
    }

    fn colors(
        &self,
        whole: &Whole,
        along: &Along,
        places: &mut Vec<Vec<f64>>,
        number: usize,
        colors: &mut Colors,
    ) {
        let features = places.get(number).map(Vec::as_slice).unwrap_or_default();
        match (&whole.network, along) {
            (Some((network, batches)), Along::Network(batch)) => {
                let scratch = &mut Scratch::default();
                batches.colors(network, batch, features, [0.0; 3], scratch, colors);
            }
            (_, Along::Count(count)) => {
                for (colors, value) in colors.iter_mut().zip(plain(features)) {
                    colors.clear();
                    colors.resize(*count, value);
                }
            }
            (None, Along::Network(_)) => colors.iter_mut().for_each(Vec::clear),
        }
    }
}
