//! Places in nested boxes.

use super::Bounds;

/// A box in the outermost one: `(share - offset) * scale` converts a position in shares of the
/// outermost box to one in shares of this box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoxFrame {
    /// The box's lowest corner, in shares of the outermost box.
    pub offset: [f64; 3],
    /// The outermost box's extents divided by this box's, 1 or more.
    pub scale: [f64; 3],
}

impl BoxFrame {
    /// From a box in another one.
    pub fn new(own: &Bounds, outer: &Bounds) -> Self {
        let (extent, own_extent) = (outer.extent(), own.extent());
        let low = |bounds: &Bounds, axis: usize| f64::from(bounds.min[axis]);
        let offset = [0, 1, 2].map(|axis| (low(own, axis) - low(outer, axis)) / extent[axis]);
        Self { offset, scale: [0, 1, 2].map(|axis| extent[axis] / own_extent[axis]) }
    }

    /// The places of several boxes in the last of them; empty for a single box.
    pub fn of_boxes(boxes: &[Bounds]) -> Vec<Self> {
        match boxes {
            [_, .., outer] => boxes.iter().map(|own| Self::new(own, outer)).collect(),
            _ => Vec::new(),
        }
    }

    /// A place in shares of the box, not clamped.
    #[inline(always)]
    pub fn place(&self, share: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = share;
        let [ox, oy, oz] = self.offset;
        let [sx, sy, sz] = self.scale;
        [(x - ox) * sx, (y - oy) * sy, (z - oz) * sz]
    }

    /// A place in shares of the box, clamped to it.
    #[inline(always)]
    pub fn place_within(&self, share: [f64; 3]) -> [f64; 3] {
        self.place(share).map(|at| at.clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_those_of_the_same_point() {
        let own = Bounds { min: [-1.0, 0.5, 2.0], max: [1.0, 2.5, 3.0] };
        let outer = Bounds { min: [-2.0, 0.5, 0.0], max: [4.0, 6.5, 3.0] };
        let frame = BoxFrame::new(&own, &outer);
        for share in [[0.0; 3], [0.25, 0.5, 1.0], [1.0; 3]] {
            let place = frame.place(share);
            for axis in 0..3 {
                let world = f64::from(outer.min[axis]) + share[axis] * outer.extent()[axis];
                let again = f64::from(own.min[axis]) + place[axis] * own.extent()[axis];
                assert!((world - again).abs() < 1e-12);
            }
        }
        assert_eq!(BoxFrame::of_boxes(&[own]), []);
        assert_eq!(BoxFrame::of_boxes(&[own, outer]).len(), 2);
    }
}
