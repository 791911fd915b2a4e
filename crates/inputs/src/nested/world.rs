//! A model of a whole scene.

use std::fmt::Debug;
use std::sync::Arc;

use crate::base::error::Result;
use crate::network::Colors;

/// A model with values everywhere in the world.
pub trait World: Debug + Send + Sync {
    /// Its values in memory.
    type Loaded: Debug + Send + Sync;

    /// Reads the values.
    ///
    /// # Errors
    /// Errors of reading.
    fn load(&self) -> Result<Arc<Self::Loaded>>;

    /// Bytes of the values in memory, at most.
    fn memory_bytes(&self) -> u64;

    /// Feeds a digest with samples of the bytes that represent all values.
    ///
    /// # Errors
    /// Errors of reading.
    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()>;

    /// The model's resolution at a position, in world units.
    fn detail(&self, position: [f64; 3]) -> f64;

    /// True for a model that is slow to evaluate and has no occupancy: it is probed for matter, and
    /// space far from all hits is empty.
    fn is_probed(&self) -> bool {
        false
    }

    /// Adds the optical depth per world unit at each position. With `masked`, it is 0 where the
    /// model takes no samples.
    fn densities(
        &self,
        loaded: &Self::Loaded,
        positions: &[[f64; 3]],
        masked: bool,
        densities: &mut Vec<f64>,
    );
}

/// A model whose colours depend on the view, sample by sample.
pub trait ColoredWorld: World {
    /// Directions, prepared for its colours.
    type Along;
    /// The inputs of colours beside the direction, at many positions.
    type Places: Default;

    /// Prepares unit directions into the scene.
    fn along(&self, loaded: &Self::Loaded, directions: &[[f64; 3]]) -> Self::Along;

    /// Prepares positions, and adds the optical depth per world unit at each; 0 where the model
    /// takes no samples.
    fn places(
        &self,
        loaded: &Self::Loaded,
        positions: &[[f64; 3]],
        places: &mut Self::Places,
        densities: &mut Vec<f64>,
    );

    /// The colours at one of the positions, by its number, along directions.
    fn colors(
        &self,
        loaded: &Self::Loaded,
        along: &Self::Along,
        places: &mut Self::Places,
        number: usize,
        colors: &mut Colors,
    );
}
