//! The free-space mask: outside it training dropped every sample.

use crate::grid::Nodes;

/// A coarse grid on its own nodes, found by an affine map from world positions.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeSpace {
    /// Nodes of the mask.
    pub nodes: Nodes,
    /// A world position `p` lies at `p * scale + shift` in the mask's index space.
    pub scale: [f64; 3],
    /// See `scale`.
    pub shift: [f64; 3],
    /// How a position between nodes is looked up.
    pub lookup: Lookup,
}

/// How a position between the mask's nodes is looked up. Positions outside the mask's nodes are
/// outside the mask.
#[derive(Debug, Clone, PartialEq)]
pub enum Lookup {
    /// The nearest node decides (DirectVoxGO's boolean mask). Halves round to even.
    Nearest(Vec<bool>),
    /// Trilinear interpolation of `values`, inside where it is at least `threshold` (Mip-VoG's
    /// coarse raw density).
    Trilinear {
        /// Raw coarse density, z fastest.
        values: Vec<f32>,
        /// Raw coarse density at which opacity reaches the mask's threshold.
        threshold: f32,
    },
}
