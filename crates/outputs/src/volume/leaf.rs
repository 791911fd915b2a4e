//! Leaves: cubes of points whose values are stored together.

/// Points along a leaf's edge.
pub const SIDE: usize = 8;
/// Points of a leaf.
pub const POINTS: usize = SIDE * SIDE * SIDE;

/// One bit per point; bit `n % 64` of word `n / 64` is point `n`.
pub type LeafMask = [u64; POINTS / 64];

/// The values of a leaf's points, z fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Leaf {
    /// Number of the leaf along each axis: its first point's, divided by [`SIDE`].
    pub at: [i32; 3],
    /// Occupied points.
    pub occupied: LeafMask,
    /// Optical depth per world unit; 0 in empty points.
    pub density: Vec<f32>,
    /// Points with a colour: occupied ones, and their neighbours.
    pub colored: LeafMask,
    /// Linear light, red, green, blue; 0 without a colour. Empty until colours are computed.
    pub color: Vec<[f32; 3]>,
    /// Channels of features, one after the other; 0 in empty points.
    pub features: Vec<f32>,
}

impl Leaf {
    /// Without density and colours.
    pub fn empty(at: [i32; 3]) -> Self {
        let none = [0; POINTS / 64];
        let (density, color) = (vec![0.0; POINTS], Vec::new());
        Self { at, occupied: none, density, colored: none, color, features: Vec::new() }
    }

    /// Bytes of a leaf with this many feature channels, after colours are computed.
    pub const fn bytes(features: usize) -> usize {
        POINTS * size_of::<f32>() * (4 + features) + size_of::<Self>()
    }
}

/// The place of a leaf's point in the leaf.
pub const fn place_of(point: usize) -> [usize; 3] {
    [point / SIDE / SIDE, point / SIDE % SIDE, point % SIDE]
}

/// The points of a mask, in order.
pub fn points(mask: &LeafMask) -> impl Iterator<Item = usize> + '_ {
    (0..POINTS).filter(|&point| mask[point / 64] >> (point % 64) & 1 == 1)
}

/// Adds a point to a mask.
pub fn insert(mask: &mut LeafMask, point: usize) {
    mask[point / 64] |= 1 << (point % 64);
}

/// True if a mask has a point.
pub fn contains(mask: &LeafMask, point: usize) -> bool {
    mask[point / 64] >> (point % 64) & 1 == 1
}
